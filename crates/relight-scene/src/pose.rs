//! Rigid poses.

use crate::vector::{Vector, add, cross, dot, sub};

/// The largest departure of `R^T R` from the identity that rounding in a text file explains.
const ORTHONORMAL: f64 = 1e-3;
/// Positions farther out than this are no metres.
const FARTHEST: f64 = 1e6;

/// A rigid pose `[R | t]`, to-world, metres: it takes a point of the camera's or light's own frame into the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose(pub [[f64; 4]; 3]);

/// Why a matrix is not a rigid pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoseFault {
    /// An entry is infinite or not a number.
    #[error("an entry is not a finite number")]
    NotFinite,
    /// The last row is not 0 0 0 1, but the last column is.
    #[error("the matrix is transposed: the translation stands in the last row")]
    Transposed,
    /// The last row is not 0 0 0 1.
    #[error("the last row is not 0 0 0 1")]
    LastRow,
    /// The rotation part is a rotation times a number.
    #[error("the rotation part is scaled by {0:.4}")]
    Scaled(f64),
    /// The rotation part is not orthonormal.
    #[error("the rotation part is not orthonormal (largest error {0:.2})")]
    NotOrthonormal(f64),
    /// The rotation part is orthonormal and mirrors.
    #[error("the rotation part mirrors (its determinant is -1)")]
    Mirrored,
    /// The position is absurdly far out.
    #[error("the position lies more than {FARTHEST:e} m from the origin along an axis")]
    TooFar,
}

impl Pose {
    /// The identity.
    pub const IDENTITY: Pose = Pose([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]);

    /// The pose in a 4x4 matrix, row-major.
    ///
    /// # Errors
    /// If the matrix is not a rigid transform of finite numbers.
    pub fn from_matrix(m: &[f64; 16]) -> Result<Pose, PoseFault> {
        if !m.iter().all(|v| v.is_finite()) {
            return Err(PoseFault::NotFinite);
        }
        let is_unit = |v: [f64; 4]| v.iter().zip([0.0, 0.0, 0.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-6);
        if !is_unit([m[12], m[13], m[14], m[15]]) {
            let transposed = is_unit([m[3], m[7], m[11], m[15]]);
            return Err(if transposed { PoseFault::Transposed } else { PoseFault::LastRow });
        }
        let pose = Pose([[m[0], m[1], m[2], m[3]], [m[4], m[5], m[6], m[7]], [m[8], m[9], m[10], m[11]]]);
        pose.check()?;
        Ok(pose)
    }

    fn check(&self) -> Result<(), PoseFault> {
        let columns = [self.axis(0), self.axis(1), self.axis(2)];
        let mut gram = [[0.0; 3]; 3];
        for (i, row) in gram.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = dot(columns[i], columns[j]);
            }
        }
        let error_with = |scale: f64| {
            let departure = |i: usize, j: usize| (gram[i][j] - if i == j { scale } else { 0.0 }).abs();
            (0..9).map(|k| departure(k / 3, k % 3)).fold(0.0, f64::max)
        };
        let error = error_with(1.0);
        if error > ORTHONORMAL {
            let scale = (gram[0][0] + gram[1][1] + gram[2][2]) / 3.0;
            let scaled = scale > 1e-12 && error_with(scale) < ORTHONORMAL * scale;
            return Err(if scaled {
                PoseFault::Scaled(scale.sqrt())
            } else {
                PoseFault::NotOrthonormal(error)
            });
        }
        if dot(cross(columns[0], columns[1]), columns[2]) < 0.0 {
            return Err(PoseFault::Mirrored);
        }
        Pose::check_position(self.position())
    }

    /// Checks that a position can be one in metres.
    ///
    /// # Errors
    /// If a coordinate is not finite or larger than a million.
    pub fn check_position(position: [f64; 3]) -> Result<(), PoseFault> {
        if !position.iter().all(|v| v.is_finite()) {
            return Err(PoseFault::NotFinite);
        }
        if position.iter().any(|v| v.abs() > FARTHEST) { Err(PoseFault::TooFar) } else { Ok(()) }
    }

    /// A pose at `position` that looks at `target` along +Z, with +Y as far down (world -Z) as it can be.
    pub fn look_at(position: [f64; 3], target: [f64; 3]) -> Pose {
        let forward = crate::vector::unit(sub(target, position)).unwrap_or([0.0, 0.0, -1.0]);
        let right = crate::vector::unit(cross(forward, [0.0, 0.0, 1.0])).unwrap_or([1.0, 0.0, 0.0]);
        let down = cross(forward, right);
        Pose(std::array::from_fn(|i| [right[i], down[i], forward[i], position[i]]))
    }

    /// A direction, taken into the world.
    pub fn rotate(&self, v: [f64; 3]) -> [f64; 3] {
        self.0.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
    }

    /// A point, taken into the world.
    pub fn transform(&self, p: [f64; 3]) -> [f64; 3] {
        add(self.rotate(p), self.position())
    }

    /// A world point, taken into the pose's own frame.
    pub fn inverse_transform(&self, p: [f64; 3]) -> [f64; 3] {
        let from = sub(p, self.position());
        [dot(self.axis(0), from), dot(self.axis(1), from), dot(self.axis(2), from)]
    }

    /// The pose that undoes this one.
    pub fn inverse(&self) -> Pose {
        let position = self.inverse_transform([0.0; 3]);
        Pose(std::array::from_fn(|i| [self.0[0][i], self.0[1][i], self.0[2][i], position[i]]))
    }

    /// The origin of the pose's own frame in the world, metres.
    pub fn position(&self) -> [f64; 3] {
        self.0.map(|row| row[3])
    }

    /// The largest difference of an entry from that of another pose.
    pub(crate) fn difference(&self, other: &Pose) -> f64 {
        let entries = self.0.iter().flatten().zip(other.0.iter().flatten());
        entries.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    /// One of the pose's own axes (0, 1, 2) in the world; axis 2 of a camera is where it looks.
    pub(crate) fn axis(&self, axis: usize) -> Vector {
        self.0.map(|row| row[axis])
    }

    /// The same place with Y and Z reversed: turns OpenGL's camera axes into OpenCV's and back.
    pub(crate) fn flip_camera_axes(&self) -> Pose {
        Pose(self.0.map(|[x, y, z, t]| [x, -y, -z, t]))
    }

    /// The pose as a 4x4 matrix, row-major: what [`Pose::from_matrix`] takes.
    pub fn to_matrix(&self) -> [f64; 16] {
        let [a, b, c] = self.0;
        let rows = [a, b, c, [0.0, 0.0, 0.0, 1.0]];
        std::array::from_fn(|i| rows[i / 4][i % 4])
    }

    /// `[R | t]` row by row.
    pub fn row_major_f32(&self) -> [f32; 12] {
        std::array::from_fn(|i| self.0[i / 4][i % 4] as f32)
    }
}
