//! OpenCV's lens distortion: radial (polynomial or rational), tangential, thin prism, tilted sensor.
//!
//! Coefficients in OpenCV's order `k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]`, acting on normalised image
//! coordinates; the formulas stand under "Detailed Description" of OpenCV's module `calib3d`.

/// Numbers of coefficients that OpenCV knows.
pub(crate) const LENGTHS: [usize; 6] = [0, 4, 5, 8, 12, 14];

const NEWTON_STEPS: usize = 20;
const HALVINGS: usize = 8;

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

/// The inverse of [`distort`]: Newton's method with step halving, started at the distorted point. Where the model folds
/// and no inverse exists, the nearest that the iteration finds.
pub(crate) fn undistort(coefficients: &[f64], point: [f64; 2]) -> [f64; 2] {
    let lens = Lens::new(coefficients);
    let target = lens.tilt.map_or(point, |tilt| homography(&adjugate(&Lens::tilt_matrix(tilt)), point));
    let miss = |[x, y]: [f64; 2]| {
        let (to, jacobian) = lens.bend([x, y]);
        let error = [to[0] - target[0], to[1] - target[1]];
        (error, jacobian, error[0] * error[0] + error[1] * error[1])
    };
    let mut at = target;
    let (mut error, mut jacobian, mut squared) = miss(at);
    for _ in 0..NEWTON_STEPS {
        let [[a, b], [c, d]] = jacobian;
        let determinant = a * d - b * c;
        if squared < 1e-28 || determinant == 0.0 {
            break;
        }
        let step = [(d * error[0] - b * error[1]) / determinant, (a * error[1] - c * error[0]) / determinant];
        let better = (0..HALVINGS).find_map(|halvings| {
            let share = 0.5f64.powi(halvings as i32);
            let next = [at[0] - share * step[0], at[1] - share * step[1]];
            let (error, jacobian, less) = miss(next);
            (less < squared).then_some((next, error, jacobian, less))
        });
        let Some(next) = better else { break };
        (at, error, jacobian, squared) = next;
    }
    if at.iter().all(|v| v.is_finite()) { at } else { target }
}
