//! Plane sweep: the depth at which a view's pixels look most like those of its neighbours.

use crate::descriptor::{CHANNELS, View};

/// Half the window over which costs are averaged, pixels.
const WINDOW: usize = 2;
/// Neighbours whose costs count: the best of them, since a point may be hidden from the others.
const BEST: usize = 2;
/// Cost of a pixel that a neighbour does not see: as bad as a poor match.
const UNSEEN: u16 = 40 * CHANNELS as u16;
/// A match counts only if every other depth (further than two planes) costs this much more.
const DISTINCT: f32 = 1.15;

/// Depths (along the optical axis, metres) at which planes are tried: evenly spaced in inverse depth.
pub fn planes(near: f64, far: f64, count: usize) -> Vec<f64> {
    (0..count)
        .map(|i| {
            let share = i as f64 / (count - 1) as f64;
            1.0 / (1.0 / near + share * (1.0 / far - 1.0 / near))
        })
        .collect()
}

/// Depth along the optical axis of every pixel of `views[index]`, metres; NaN where no depth stands out.
pub fn sweep(views: &[View], index: usize, neighbours: &[usize], planes: &[f64]) -> Vec<f32> {
    let view = &views[index];
    let size = view.width * view.height;
    let mut volume = vec![0u16; size * planes.len()];
    let mut costs = vec![vec![0u16; size]; neighbours.len()];
    let mut scratch = vec![0u32; size];
    for (slice, &depth) in volume.chunks_exact_mut(size).zip(planes) {
        for (cost, &n) in costs.iter_mut().zip(neighbours) {
            warp_cost(view, &views[n], depth, cost);
            box_filter(cost, view.width, view.height, &mut scratch);
        }
        for (p, out) in slice.iter_mut().enumerate() {
            let mut best = [u16::MAX; BEST];
            for cost in &costs {
                let mut c = cost[p];
                for b in &mut best {
                    if c < *b {
                        std::mem::swap(b, &mut c);
                    }
                }
            }
            let used = BEST.min(costs.len());
            *out = (best[..used].iter().map(|&b| u32::from(b)).sum::<u32>() / used as u32) as u16;
        }
    }
    (0..size).map(|p| select(&volume, size, p, planes)).collect()
}

/// Sum of absolute differences between each pixel and what the neighbour sees where it would be at `depth`.
fn warp_cost(view: &View, other: &View, depth: f64, cost: &mut [u16]) {
    // Projection is linear in homogeneous pixel coordinates: three numbers that step along a row.
    let homogeneous = |x: f64, y: f64| {
        let d = view.direction(x, y).map(|v| v * depth);
        let p = other.pose.inverse_transform(view.pose.transform(d));
        let [fx, fy, cx, cy] = other.pinhole;
        [fx * p[0] + cx * p[2], fy * p[1] + cy * p[2], p[2]]
    };
    let (origin, right, down) = (homogeneous(0.0, 0.0), homogeneous(1.0, 0.0), homogeneous(0.0, 1.0));
    let (limit_x, limit_y) = ((other.width - 1) as f32, (other.height - 1) as f32);
    for (y, row) in cost.chunks_exact_mut(view.width).enumerate() {
        let start: [f64; 3] = std::array::from_fn(|a| origin[a] + y as f64 * (down[a] - origin[a]));
        for (x, cost) in row.iter_mut().enumerate() {
            let q: [f32; 3] = std::array::from_fn(|a| (start[a] + x as f64 * (right[a] - origin[a])) as f32);
            let (u, v) = (q[0] / q[2], q[1] / q[2]);
            let inside = q[2] > 0.0 && u >= 0.0 && v >= 0.0 && u < limit_x && v < limit_y;
            *cost = if inside { difference(&view.pixels[y * view.width + x], other, u, v) } else { UNSEEN };
        }
    }
}

/// Sum of absolute differences between a descriptor and the other view, interpolated at `(u, v)`.
fn difference(descriptor: &[u8; CHANNELS], other: &View, u: f32, v: f32) -> u16 {
    let (x, y) = (u as usize, v as usize);
    let (fu, fv) = (((u - x as f32) * 16.0) as u16, ((v - y as f32) * 16.0) as u16);
    let weights = [(16 - fu) * (16 - fv), fu * (16 - fv), (16 - fu) * fv, fu * fv];
    let at = y * other.width + x;
    let corners = [at, at + 1, at + other.width, at + other.width + 1].map(|i| &other.pixels[i]);
    let mut sum = 0u16;
    for c in 0..CHANNELS {
        let mixed = corners.iter().zip(weights).map(|(p, w)| u16::from(p[c]) * w).sum::<u16>() >> 8;
        sum += mixed.abs_diff(u16::from(descriptor[c]));
    }
    sum
}

/// Replaces each number by the mean of the window around it (cut at the borders).
fn box_filter(values: &mut [u16], width: usize, height: usize, rows: &mut [u32]) {
    for (row, sums) in values.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        let mut sum: u32 = row[..WINDOW.min(width)].iter().map(|&v| u32::from(v)).sum();
        for x in 0..width {
            if x + WINDOW < width {
                sum += u32::from(row[x + WINDOW]);
            }
            if x > WINDOW {
                sum -= u32::from(row[x - WINDOW - 1]);
            }
            sums[x] = sum;
        }
    }
    for x in 0..width {
        let span = (x + WINDOW).min(width - 1) - x.saturating_sub(WINDOW) + 1;
        let mut sum: u32 = (0..WINDOW.min(height)).map(|y| rows[y * width + x]).sum();
        for y in 0..height {
            if y + WINDOW < height {
                sum += rows[(y + WINDOW) * width + x];
            }
            if y > WINDOW {
                sum -= rows[(y - WINDOW - 1) * width + x];
            }
            let tall = (y + WINDOW).min(height - 1) - y.saturating_sub(WINDOW) + 1;
            values[y * width + x] = (sum / (span * tall) as u32) as u16;
        }
    }
}

/// The depth of the cheapest plane, between planes by a parabola through its neighbours; NaN unless it stands out.
fn select(volume: &[u16], size: usize, p: usize, planes: &[f64]) -> f32 {
    let cost = |i: usize| f32::from(volume[i * size + p]);
    let Some(best) = (0..planes.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b))) else { return f32::NAN };
    let second = (0..planes.len()).filter(|i| i.abs_diff(best) > 2).map(cost).fold(f32::INFINITY, f32::min);
    if best == 0 || best + 1 == planes.len() || second < DISTINCT * cost(best) + 4.0 {
        return f32::NAN;
    }
    let (a, b, c) = (cost(best - 1), cost(best), cost(best + 1));
    let bend = a - 2.0 * b + c;
    let shift = if bend > 0.0 { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    // Planes are even in inverse depth.
    let (inverse, step) = (1.0 / planes[best], 1.0 / planes[1] - 1.0 / planes[0]);
    (1.0 / (inverse + f64::from(shift) * step)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_even_in_inverse_depth() {
        let planes = planes(0.5, 2.0, 4);
        let expected = [0.5, 1.0 / 1.5, 1.0, 2.0];
        assert!(planes.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{planes:?}");
    }

    #[test]
    fn the_filter_takes_means_of_windows_cut_at_the_borders() {
        for (width, height) in [(1, 1), (2, 1), (1, 6), (3, 2), (5, 5), (9, 7)] {
            let before: Vec<u16> = (0..width * height).map(|i| (i * 7919 % 4000) as u16).collect();
            let mut after = before.clone();
            box_filter(&mut after, width, height, &mut vec![0; width * height]);
            for (p, &mean) in after.iter().enumerate() {
                let near = |q: &usize| {
                    (q % width).abs_diff(p % width) <= WINDOW && (q / width).abs_diff(p / width) <= WINDOW
                };
                let window: Vec<usize> = (0..before.len()).filter(near).collect();
                let sum: usize = window.iter().map(|&q| usize::from(before[q])).sum();
                assert_eq!(usize::from(mean), sum / window.len(), "{width}x{height}, {p}");
            }
        }
    }

    /// Depth chosen for costs that are one pixel's.
    fn chosen(costs: &[u16]) -> f32 {
        select(costs, 1, 0, &planes(1.0, 2.0, costs.len()))
    }

    #[test]
    fn depths_lie_between_planes_where_costs_say_so() {
        // A parabola with its lowest point a quarter of a plane beyond the fifth.
        let costs: Vec<u16> = (0..11).map(|i| (100.0 * (f64::from(i) - 5.25).powi(2)) as u16 + 10).collect();
        let inverse = 1.0 - 5.25 / 10.0 * 0.5;
        assert!((chosen(&costs) - 1.0 / inverse).abs() < 1e-3, "{}", chosen(&costs));
    }

    #[test]
    fn depths_must_stand_out() {
        let valley = |depths: &[(usize, u16)]| {
            let mut costs = [400u16; 11];
            depths.iter().for_each(|&(at, cost)| costs[at] = cost);
            chosen(&costs)
        };
        assert!(valley(&[(5, 100)]).is_finite());
        assert!(valley(&[]).is_nan(), "all the same");
        assert!(valley(&[(5, 100), (8, 110)]).is_nan(), "two of a kind");
        assert!(valley(&[(5, 100), (6, 110)]).is_finite(), "a broad one");
        assert!(valley(&[(0, 100)]).is_nan() && valley(&[(10, 100)]).is_nan(), "at the ends");
        assert!(chosen(&[]).is_nan() && chosen(&[5]).is_nan());
    }
}
