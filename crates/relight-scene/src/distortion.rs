//! OpenCV's lens distortion: radial (polynomial or rational), tangential, thin prism, tilted sensor.
//!
//! Coefficients in OpenCV's order `k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]`, acting on normalised image
//! coordinates; the formulas stand under "Detailed Description" of OpenCV's module `calib3d`.

/// Numbers of coefficients that OpenCV knows.
pub(crate) const LENGTHS: [usize; 6] = [0, 4, 5, 8, 12, 14];

const NEWTON_STEPS: usize = 20;
const HALVINGS: i32 = 8;
const FIRST_HALVINGS: i32 = 60;
/// Squared error, in normalised coordinates, that rounding leaves.
const CONVERGED: f64 = 1e-28;

struct Lens {
    k: [f64; 6],
    p: [f64; 2],
    s: [f64; 4],
    tilt: Option<[f64; 2]>,
}

impl Lens {
    fn new(coefficients: &[f64]) -> Lens {
        let c = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
        let tilt = [c(12), c(13)];
        Lens {
            k: [c(0), c(1), c(4), c(5), c(6), c(7)],
            p: [c(2), c(3)],
            s: [c(8), c(9), c(10), c(11)],
            tilt: (tilt != [0.0; 2]).then_some(tilt),
        }
    }

    /// Where the lens takes a point, before the tilt, and the Jacobian `[[dx/dx, dx/dy], [dy/dx, dy/dy]]`.
    fn bend(&self, [x, y]: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let ([k1, k2, k3, k4, k5, k6], [p1, p2], [s1, s2, s3, s4]) = (self.k, self.p, self.s);
        let r2 = x * x + y * y;
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let radial = above / below;
        // Derivatives by r^2.
        let above_slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let below_slope = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
        let slope = (above_slope - radial * below_slope) / below;
        let (prism_x, prism_y) = (s1 + 2.0 * r2 * s2, s3 + 2.0 * r2 * s4);
        let to = [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4),
        ];
        let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let jacobian = [
            [
                radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * x * prism_x,
                cross + 2.0 * y * prism_x,
            ],
            [
                cross + 2.0 * x * prism_y,
                radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + 2.0 * y * prism_y,
            ],
        ];
        (to, jacobian)
    }

    /// The homography of a sensor tilted by angles about x and y (OpenCV's `computeTiltProjectionMatrix`).
    fn tilt_matrix([tx, ty]: [f64; 2]) -> [[f64; 3]; 3] {
        let ((sx, cx), (sy, cy)) = (tx.sin_cos(), ty.sin_cos());
        // R = Ry Rx
        let r = [[cy, sy * sx, -sy * cx], [0.0, cx, sx], [sy, -cy * sx, cy * cx]];
        let (a, b, c) = (r[2][2], r[0][2], r[1][2]);
        let row = |keep: usize, lose: f64| std::array::from_fn(|j| a * r[keep][j] - lose * r[2][j]);
        [row(0, b), row(1, c), r[2]]
    }
}

fn homography(m: &[[f64; 3]; 3], [x, y]: [f64; 2]) -> [f64; 2] {
    let [u, v, w] = m.map(|row| row[0] * x + row[1] * y + row[2]);
    [u / w, v / w]
}

/// The adjugate: the inverse up to a factor, which a homography does not feel.
fn adjugate(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let minor = |r0: usize, r1: usize, c0: usize, c1: usize| m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0];
    [
        [minor(1, 2, 1, 2), minor(0, 2, 2, 1), minor(0, 1, 1, 2)],
        [minor(1, 2, 2, 0), minor(0, 2, 0, 2), minor(0, 1, 2, 0)],
        [minor(1, 2, 0, 1), minor(0, 2, 1, 0), minor(0, 1, 0, 1)],
    ]
}

/// Normalised image coordinates as the distorting lens shows them.
pub(crate) fn distort(coefficients: &[f64], point: [f64; 2]) -> [f64; 2] {
    let lens = Lens::new(coefficients);
    let (bent, _) = lens.bend(point);
    lens.tilt.map_or(bent, |tilt| homography(&Lens::tilt_matrix(tilt), bent))
}

/// The inverse of [`distort`]: Newton's method with step halving, from the distorted point or, where the model has
/// folded there, from nearer the middle. It never crosses a fold: where there is no inverse on this side, it ends at the
/// nearest that it finds.
pub(crate) fn undistort(coefficients: &[f64], point: [f64; 2]) -> [f64; 2] {
    let lens = Lens::new(coefficients);
    let target = lens.tilt.map_or(point, |tilt| homography(&adjugate(&Lens::tilt_matrix(tilt)), point));
    let start = (0..FIRST_HALVINGS).map(|halvings| {
        let share = 0.5f64.powi(halvings);
        Trial::new(&lens, [share * target[0], share * target[1]], target)
    });
    let Some(mut trial) = start.into_iter().find(Trial::is_before_fold) else { return point };
    for _ in 0..NEWTON_STEPS {
        if trial.squared < CONVERGED {
            break;
        }
        let [dx, dy] = trial.newton_step();
        let better = (0..HALVINGS).find_map(|halvings| {
            let share = 0.5f64.powi(halvings);
            let next = Trial::new(&lens, [trial.at[0] - share * dx, trial.at[1] - share * dy], target);
            (next.is_before_fold() && next.squared < trial.squared).then_some(next)
        });
        let Some(better) = better else { break };
        trial = better;
    }
    trial.at
}

/// A guess at the undistorted point.
struct Trial {
    at: [f64; 2],
    error: [f64; 2],
    squared: f64,
    jacobian: [[f64; 2]; 2],
    determinant: f64,
}

impl Trial {
    fn new(lens: &Lens, at: [f64; 2], target: [f64; 2]) -> Trial {
        let (to, jacobian) = lens.bend(at);
        let error = [to[0] - target[0], to[1] - target[1]];
        let [[a, b], [c, d]] = jacobian;
        let squared = error[0] * error[0] + error[1] * error[1];
        Trial { at, error, squared, jacobian, determinant: a * d - b * c }
    }

    /// Whether the lens keeps the orientation here, as it does in the middle.
    fn is_before_fold(&self) -> bool {
        self.determinant > 0.0 && self.squared.is_finite()
    }

    fn newton_step(&self) -> [f64; 2] {
        let ([[a, b], [c, d]], [ex, ey]) = (self.jacobian, self.error);
        [(d * ex - b * ey) / self.determinant, (a * ey - c * ex) / self.determinant]
    }
}
