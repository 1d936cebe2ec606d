//! Small pictures whose pixels are vectors of brightness under many lights.

use relight_scene::{Intrinsics, PixelStore, Pose, Scene};

/// Numbers in a descriptor: brightness under [`LIGHTS`] lights, then two of mean colour.
pub const CHANNELS: usize = 16;
/// Lights in a descriptor.
pub const LIGHTS: usize = CHANNELS - 2;

/// A pinhole picture of descriptors.
pub struct View {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Focal lengths and principal point, pixels; centres at integers.
    pub pinhole: [f64; 4],
    /// Camera-to-world.
    pub pose: Pose,
    /// `[height][width]` descriptors.
    pub pixels: Vec<[u8; CHANNELS]>,
}

impl View {
    /// Camera-frame direction with z = 1 of a pixel.
    pub fn direction(&self, x: f64, y: f64) -> [f64; 3] {
        let [fx, fy, cx, cy] = self.pinhole;
        [(x - cx) / fx, (y - cy) / fy, 1.0]
    }

    /// Pixel of a camera-frame point in front of the camera.
    pub fn project(&self, p: [f64; 3]) -> [f64; 2] {
        let [fx, fy, cx, cy] = self.pinhole;
        [fx * p[0] / p[2] + cx, fy * p[1] / p[2] + cy]
    }

    /// Index of the pixel that a place of the picture belongs to; `None` outside.
    pub fn pixel(&self, place: [f64; 2]) -> Option<usize> {
        let [x, y] = place.map(f64::round);
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        inside.then(|| y as usize * self.width + x as usize)
    }
}

/// Lights that every view was photographed under, at most [`LIGHTS`] of them, far from each other.
pub fn common_lights(scene: &Scene, store: &PixelStore) -> Vec<u32> {
    let mut common: Vec<u32> = store.lights(0).to_vec();
    for view in 1..store.views() {
        common.retain(|l| store.lights(view).contains(l));
    }
    let position = |l: u32| scene.lights[l as usize].pose.position();
    let distance =
        |a: u32, b: u32| -> f64 { position(a).iter().zip(position(b)).map(|(a, b)| (a - b) * (a - b)).sum() };
    let mut chosen: Vec<u32> = common.first().copied().into_iter().collect();
    while chosen.len() < LIGHTS.min(common.len()) {
        let nearest = |l: u32| chosen.iter().map(|&c| distance(l, c)).fold(f64::INFINITY, f64::min);
        let farthest = common.iter().copied().max_by(|&a, &b| nearest(a).total_cmp(&nearest(b)));
        chosen.extend(farthest);
    }
    chosen.sort_unstable();
    chosen
}

/// Width and height, pixels, of a photograph through the lens `full`, reduced by a factor.
pub fn reduced(full: &Intrinsics, scale: usize) -> [usize; 2] {
    [full.width, full.height].map(|n| (n as usize / scale).max(1))
}

/// The descriptor picture of one view, `scale` times smaller than the photographs, averaged over the pixels that it
/// covers; lens distortion removed.
pub fn describe(scene: &Scene, store: &PixelStore, view: usize, lights: &[u32], scale: usize) -> View {
    let camera = &scene.cameras[store.camera(view)];
    let full = &camera.intrinsics;
    let [width, height] = reduced(full, scale);
    let small = full.resized(width as u32, height as u32);
    let ideal = Intrinsics { distortion: Vec::new(), ..small };
    let slots: Vec<usize> =
        lights.iter().filter_map(|l| store.lights(view).iter().position(|s| s == l)).collect();
    let size = (full.width as usize, full.height as usize);
    let ratio = (size.0 as f64 / width as f64, size.1 as f64 / height as f64);
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            // The middle of the block of photograph pixels that this pixel covers.
            let centre = if full.distortion.iter().all(|&k| k == 0.0) {
                [(x as f64 + 0.5) * ratio.0 - 0.5, (y as f64 + 0.5) * ratio.1 - 0.5]
            } else {
                full.project(ideal.unproject(x as f64, y as f64)).unwrap_or([-1e9; 2])
            };
            pixels.push(average(store, view, &slots, size, centre, scale));
        }
    }
    View { width, height, pinhole: [ideal.fx, ideal.fy, ideal.cx, ideal.cy], pose: camera.pose, pixels }
}

/// Descriptor of the block of `scale` by `scale` photograph pixels around `centre`; zeros outside.
fn average(
    store: &PixelStore,
    view: usize,
    slots: &[usize],
    (width, height): (usize, usize),
    centre: [f64; 2],
    scale: usize,
) -> [u8; CHANNELS] {
    let half = (scale as f64 - 1.0) / 2.0;
    let (x0, y0) = ((centre[0] - half).round(), (centre[1] - half).round());
    let mut brightness = [0u32; LIGHTS];
    let mut colour = [0u32; 3];
    let mut count = 0u32;
    for dy in 0..scale {
        for dx in 0..scale {
            let (x, y) = (x0 + dx as f64, y0 + dy as f64);
            if x < 0.0 || y < 0.0 || x >= width as f64 || y >= height as f64 {
                continue;
            }
            count += 1;
            let pixel = store.pixel(view, y as usize * width + x as usize);
            for (sum, &slot) in brightness.iter_mut().zip(slots) {
                let [r, g, b] = pixel[slot].map(u32::from);
                *sum += (r + 2 * g + b) / 4;
                colour[0] += r;
                colour[1] += g;
                colour[2] += b;
            }
        }
    }
    let mut descriptor = [0; CHANNELS];
    let count = count.max(1);
    for (d, sum) in descriptor.iter_mut().zip(brightness) {
        *d = (sum / count) as u8;
    }
    let [r, g, b] = colour.map(|c| i64::from(c) / (i64::from(count) * slots.len().max(1) as i64));
    descriptor[LIGHTS] = (128 + r - g).clamp(0, 255) as u8;
    descriptor[LIGHTS + 1] = (128 + b - g).clamp(0, 255) as u8;
    descriptor
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_directions_belong_together() {
        let view = View {
            width: 9,
            height: 7,
            pinhole: [10.0, 12.0, 4.0, 3.5],
            pose: Pose::look_at([1.0, 2.0, 3.0], [0.0; 3]),
            pixels: Vec::new(),
        };
        for (x, y) in [(0.0, 0.0), (8.0, 6.0), (3.3, 5.7)] {
            let [u, v] = view.project(view.direction(x, y).map(|d| 2.5 * d));
            assert!((u - x).abs() < 1e-12 && (v - y).abs() < 1e-12);
        }
        assert_eq!(view.pixel([0.0, 0.0]), Some(0));
        assert_eq!(view.pixel([8.49, 6.4]), Some(62));
        assert_eq!(view.pixel([-0.4, 0.6]), Some(9));
        for outside in [[-0.6, 0.0], [8.6, 0.0], [0.0, -0.6], [0.0, 6.6], [f64::NAN, 0.0]] {
            assert_eq!(view.pixel(outside), None);
        }
    }
}
