//! Where a camera stood over the board.

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};
use relight_scene::Pose;

use super::lens::{LENS, Lens};

/// Number of parameters of a viewpoint.
pub(super) const VIEWPOINT: usize = 6;

/// A camera in the board's frame: `p_camera = rotation (p_board - centre)`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Viewpoint {
    pub(super) rotation: Rotation3<f64>,
    pub(super) centre: Vector3<f64>,
}

/// A corner of the board and the pixel where it was seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    /// In the board's plane, metres.
    pub(super) on_board: Vector2<f64>,
    pub(super) pixel: Vector2<f64>,
}

/// A residual, observed less predicted, pixels, and how the prediction moves.
pub(super) struct Residual {
    pub(super) pixels: Vector2<f64>,
    /// Distance along the camera's axis, metres.
    pub(super) depth: f64,
    pub(super) by_lens: SMatrix<f64, 2, LENS>,
    /// By a rotation vector in the camera's frame, then by the centre in the board's.
    pub(super) by_viewpoint: SMatrix<f64, 2, VIEWPOINT>,
}

impl Viewpoint {
    /// The viewpoint that a homography from the board to the image means (Zhang 2000, section 3.1), for a lens whose distortion
    /// is left out of account. `None` if the board would lie behind the camera.
    pub(super) fn of_homography(h: &Matrix3<f64>, lens: &Lens) -> Option<Viewpoint> {
        let [fx, fy, cx, cy, ..] = <[f64; LENS]>::from(lens.0);
        let inverse = Matrix3::new(1.0 / fx, 0.0, -cx / fx, 0.0, 1.0 / fy, -cy / fy, 0.0, 0.0, 1.0);
        let b = inverse * h;
        let scale = 2.0 / (b.column(0).norm() + b.column(1).norm()) * b[(2, 2)].signum();
        let b = b * scale;
        let (x, y) = (b.column(0).into_owned(), b.column(1).into_owned());
        let nearly = Matrix3::from_columns(&[x, y, x.cross(&y)]);
        let svd = nearly.svd(true, true);
        let rotation = svd.u? * svd.v_t?;
        if rotation.determinant() < 0.0 {
            return None;
        }
        let translation = b.column(2).into_owned();
        let centre = -(rotation.transpose() * translation);
        // The printed face looks along -z.
        let is_before = centre.z < 0.0 && centre.iter().all(|v| v.is_finite());
        is_before.then(|| Viewpoint { rotation: Rotation3::from_matrix_unchecked(rotation), centre })
    }

    /// The camera-to-board pose.
    pub(super) fn pose(&self) -> Pose {
        let to_board = self.rotation.transpose();
        Pose(std::array::from_fn(|i| [to_board[(i, 0)], to_board[(i, 1)], to_board[(i, 2)], self.centre[i]]))
    }

    pub(super) fn of_pose(camera_to_board: &Pose) -> Viewpoint {
        let rotation = Matrix3::from_fn(|i, j| camera_to_board.0[j][i]);
        Viewpoint {
            rotation: Rotation3::from_matrix_unchecked(rotation),
            centre: Vector3::from(camera_to_board.position()),
        }
    }

    pub(super) fn moved(&self, step: &SVector<f64, VIEWPOINT>) -> Viewpoint {
        let turn = Rotation3::new(step.fixed_rows::<3>(0).into_owned());
        let mut rotation = turn * self.rotation;
        rotation.renormalize();
        Viewpoint { rotation, centre: self.centre + step.fixed_rows::<3>(3) }
    }

    /// `None` if the corner would lie behind the camera.
    pub(super) fn residual(&self, lens: &Lens, sighting: &Sighting) -> Option<Residual> {
        let from = Vector3::new(sighting.on_board.x, sighting.on_board.y, 0.0) - self.centre;
        let point = self.rotation * from;
        let projection = lens.project(&point)?;
        let mut by_viewpoint = SMatrix::<f64, 2, VIEWPOINT>::zeros();
        by_viewpoint.fixed_columns_mut::<3>(0).copy_from(&(-projection.by_point * point.cross_matrix()));
        by_viewpoint.fixed_columns_mut::<3>(3).copy_from(&(-projection.by_point * self.rotation.matrix()));
        Some(Residual {
            pixels: sighting.pixel - projection.pixel,
            depth: point.z,
            by_lens: projection.by_lens,
            by_viewpoint,
        })
    }
}
