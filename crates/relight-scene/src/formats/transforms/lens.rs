//! What a `transforms.json` says of a lens, for all frames or for one.

use std::f64::consts::PI;

use serde::Deserialize;

use crate::camera::{Intrinsics, LONGEST_SIDE};

/// Whatever is said of a lens, in a file or for a frame.
#[derive(Clone, Default, Deserialize)]
pub(super) struct Lens {
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    /// `[cx, cy, fx, fy]`
    camera_intrinsics: Option<Vec<f64>>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

impl Lens {
    /// This lens where it says something, else the shared one.
    pub(super) fn over(&self, shared: &Lens) -> Lens {
        let (mine, all) = (self.clone(), shared.clone());
        // A frame's own focal length must not be overruled by the file's other way of stating one.
        let own_focal =
            mine.camera_intrinsics.is_some() || mine.fl_x.is_some() || mine.camera_angle_x.is_some();
        let focal = if own_focal { &mine } else { &all };
        Lens {
            camera_angle_x: focal.camera_angle_x,
            camera_angle_y: focal.camera_angle_y,
            camera_intrinsics: focal.camera_intrinsics.clone(),
            fl_x: focal.fl_x,
            fl_y: focal.fl_y,
            cx: mine.cx.or(all.cx),
            cy: mine.cy.or(all.cy),
            w: mine.w.or(all.w),
            h: mine.h.or(all.h),
            k1: mine.k1.or(all.k1),
            k2: mine.k2.or(all.k2),
            k3: mine.k3.or(all.k3),
            k4: mine.k4.or(all.k4),
            p1: mine.p1.or(all.p1),
            p2: mine.p2.or(all.p2),
        }
    }

    /// The image size, if it is stated.
    pub(super) fn size(&self) -> Option<(f64, f64)> {
        Some((self.w?, self.h?))
    }

    /// The lens, over images of the given size if it states none itself.
    pub(super) fn intrinsics(&self, size: Option<(u32, u32)>) -> Result<Intrinsics, String> {
        let size = self.size().or(size.map(|(w, h)| (f64::from(w), f64::from(h))));
        let (w, h) = size.ok_or("has no image size (w, h)")?;
        let pixels =
            |n: f64| (n.fract() == 0.0 && (1.0..=f64::from(LONGEST_SIDE)).contains(&n)).then_some(n as u32);
        let (Some(width), Some(height)) = (pixels(w), pixels(h)) else {
            return Err(format!(
                "the image size {w} x {h} is not a whole number of 1 to {LONGEST_SIDE} pixels a side"
            ));
        };
        if self.k4.is_some_and(|k4| k4 != 0.0) {
            return Err("k4 belongs to a fisheye lens, which is not supported".to_owned());
        }
        let from_angle =
            |side: f64, angle: f64| (angle > 0.0 && angle < PI).then(|| side / 2.0 / (angle / 2.0).tan());
        let (fx, fy, cx, cy) = match (self.camera_intrinsics.as_deref(), self.fl_x, self.camera_angle_x) {
            (Some(&[cx, cy, fx, fy]), ..) => (fx, fy, Some(cx), Some(cy)),
            (Some(_), ..) => return Err("camera_intrinsics is not [cx, cy, fx, fy]".to_owned()),
            (None, Some(fx), _) => (fx, self.fl_y.unwrap_or(fx), self.cx, self.cy),
            (None, None, Some(angle)) => {
                let fx =
                    from_angle(w, angle).ok_or("camera_angle_x is not an angle between 0 and pi radians")?;
                let fy = self.camera_angle_y.and_then(|angle| from_angle(h, angle));
                (fx, fy.unwrap_or(fx), self.cx, self.cy)
            }
            (None, None, None) => return Err("has no focal length".to_owned()),
        };
        let coefficient = |k: Option<f64>| k.unwrap_or(0.0);
        let distortion = [self.k1, self.k2, self.p1, self.p2, self.k3].map(coefficient).to_vec();
        let lens = Intrinsics {
            width,
            height,
            fx,
            fy,
            // From the corner of the image to the centre of its first pixel.
            cx: cx.unwrap_or(w / 2.0) - 0.5,
            cy: cy.unwrap_or(h / 2.0) - 0.5,
            distortion: if distortion.iter().all(|&k| k == 0.0) { Vec::new() } else { distortion },
        };
        lens.fault().map_or(Ok(lens), Err)
    }
}
