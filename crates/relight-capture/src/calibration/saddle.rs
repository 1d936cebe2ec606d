//! Corners of a chessboard to a small part of a pixel.

use nalgebra::{Cholesky, Matrix2, SMatrix, SVector, Vector2};

/// Radius of the pixels that are fitted, as a share of the distance of the lines, and its limits in pixels.
const RADIUS: f64 = 0.45;
const RADII: [f64; 2] = [3.0, 10.0];
/// Distance, pixels, over which blur may carry what is no part of the corner.
const BLUR: f64 = 2.0;
/// Fewest pixels that determine a corner.
const FEWEST_PIXELS: usize = 30;
/// Farthest that a corner may lie from where it was expected, pixels.
const FARTHEST: f64 = 1.5;
/// Least contrast, grey levels from black to white.
const LEAST_CONTRAST: f64 = 6.0;
/// Largest misfit, as a share of the contrast.
const LARGEST_MISFIT: f64 = 0.15;
/// Largest standard error of a corner that is worth keeping, pixels.
const LARGEST_ERROR: f64 = 0.15;
const STEPS: usize = 30;
/// Movement, pixels, below which the fit has ended.
const CONVERGED: f64 = 1e-4;
/// Sharpest edge, pixels: sharper ones fall between samples.
const SHARPEST: f64 = 0.15;
/// Where in a pixel the model is sampled, along both axes: a pixel is the mean over its area.
const SAMPLES: [f64; 3] = [-1.0 / 3.0, 0.0, 1.0 / 3.0];
const SHARE: f64 = 1.0 / 9.0;

/// A grey image, rows from the top.
pub(super) struct Grey {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) data: Vec<u8>,
}

impl Grey {
    /// The picture at twice its size, interpolated linearly.
    pub(super) fn doubled(&self) -> Grey {
        let (width, height) = (2 * self.width, 2 * self.height);
        // Three quarters of the nearer pixel, one of the other; at the edge, the same one twice.
        let pair = |place: usize, size: usize| {
            let near = place / 2;
            let far = if place.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(size - 1) };
            [(near, 3), (far, 1)]
        };
        let pixel = |place: usize| {
            let (x, y) = (place % width, place / width);
            let rows = pair(y, self.height);
            let sum: u32 = rows
                .into_iter()
                .flat_map(|row| pair(x, self.width).map(|column| (row, column)))
                .map(|((y, v), (x, u))| u * v * u32::from(self.data[y * self.width + x]))
                .sum();
            ((sum + 8) / 16) as u8
        };
        Grey { width, height, data: (0..width * height).map(pixel).collect() }
    }

    /// A place of the doubled picture in the picture itself.
    pub(super) fn halved(at: Vector2<f64>) -> Vector2<f64> {
        (at - Vector2::repeat(0.5)) / 2.0
    }
}

/// What is known of a corner before it is fitted.
pub(super) struct Expected {
    /// Where it should be, pixels.
    pub(super) at: Vector2<f64>,
    /// One square along the board's x (first column) and y (second), in pixels.
    pub(super) axes: Matrix2<f64>,
    /// Whether the square ahead of it along both axes, and the one opposite, are black; the other two are white.
    pub(super) black_ahead: bool,
    /// White rim around a marker, as a share of the square.
    pub(super) margin: f64,
}

/// The corner nearest to where it is expected: the least-squares fit of two blurred edges that cross, with a brightness that
/// may slope. The model is symmetric about the corner, as the picture is, so that neither the kind of blur nor clipped
/// highlights pull it aside. Markers are left out. `None` if the picture shows no such corner there.
pub(super) fn fit(image: &Grey, expected: &Expected) -> Option<Vector2<f64>> {
    // Once more from where it was found: only pixels that lie evenly around the corner leave no bias.
    let first = fit_once(image, expected)?;
    let at = fit_once(image, &Expected { at: first, ..*expected })?;
    ((at - expected.at).norm() < FARTHEST).then_some(at)
}

fn fit_once(image: &Grey, expected: &Expected) -> Option<Vector2<f64>> {
    let pixels = pixels_of(image, expected)?;
    let mut model = Saddle::start(&pixels, expected)?;
    let mut damping = 1e-3;
    let (mut normal, mut slope, mut squares) = model.linearise(&pixels);
    for _ in 0..STEPS {
        let step = model.step(&normal, &slope, damping)?;
        let next = model.moved(&step);
        let (next_normal, next_slope, next_squares) = next.linearise(&pixels);
        if next_squares <= squares {
            (model, normal, slope, squares) = (next, next_normal, next_slope, next_squares);
            damping = (damping * 0.2).max(1e-9);
            if step.fixed_rows::<2>(0).norm() < CONVERGED {
                break;
            }
        } else {
            damping *= 10.0;
        }
    }
    let variance = squares / (pixels.len() - 9) as f64;
    let covariance = Cholesky::new(normal)?.inverse() * variance;
    let error = (covariance[(0, 0)] + covariance[(1, 1)]).sqrt();
    let contrast = 2.0 * if expected.black_ahead { -model.half_contrast() } else { model.half_contrast() };
    let is_corner = contrast > LEAST_CONTRAST
        && variance.sqrt() < LARGEST_MISFIT * contrast
        && error < LARGEST_ERROR
        && (model.at() - expected.at).norm() < FARTHEST;
    is_corner.then(|| model.at())
}

/// A pixel and its grey level.
type Pixel = (Vector2<f64>, f64);

/// Pixels that the corner's own four squares alone determine.
fn pixels_of(image: &Grey, expected: &Expected) -> Option<Vec<Pixel>> {
    let lines = Lines::of(&expected.axes)?;
    let spacing = lines.spacing;
    let radius = (RADIUS * spacing[0].min(spacing[1])).clamp(RADII[0], RADII[1]);
    let rim = spacing.map(|s| expected.margin * s - BLUR);
    let is_own = |offset: Vector2<f64>| {
        let d = lines.distances(offset);
        let is_near = d[0].abs() < spacing[0] - BLUR && d[1].abs() < spacing[1] - BLUR;
        let is_white = (d[0] * d[1] > 0.0) != expected.black_ahead;
        let is_marker = is_white && d[0].abs() > rim[0] && d[1].abs() > rim[1];
        // The lines themselves, wherever exactly they run, are never a marker's.
        let is_line = d[0].abs() < 1.0 || d[1].abs() < 1.0;
        is_near && (is_line || !is_marker)
    };
    let range = |at: f64, end: usize| {
        let first = (at - radius).ceil().max(0.0);
        let last = (at + radius).floor().min(end as f64 - 1.0);
        (first <= last).then_some(first as usize..=last as usize)
    };
    let columns = range(expected.at.x, image.width)?;
    let mut pixels = Vec::new();
    for y in range(expected.at.y, image.height)? {
        for x in columns.clone() {
            let offset = Vector2::new(x as f64, y as f64) - expected.at;
            if offset.norm() <= radius && is_own(offset) {
                pixels.push((offset + expected.at, f64::from(*image.data.get(y * image.width + x)?)));
            }
        }
    }
    (pixels.len() >= FEWEST_PIXELS).then_some(pixels)
}

/// The two lines of a corner: normals that point along the board's axes, and the distance to the next line.
struct Lines {
    normals: [Vector2<f64>; 2],
    spacing: [f64; 2],
}

impl Lines {
    fn of(axes: &Matrix2<f64>) -> Option<Lines> {
        let (x, y) = (axes.column(0), axes.column(1));
        let area = axes.determinant();
        let normals = [Vector2::new(y[1], -y[0]) / y.norm(), Vector2::new(-x[1], x[0]) / x.norm()]
            .map(|n| n * area.signum());
        let spacing = [area.abs() / y.norm(), area.abs() / x.norm()];
        // The radius is to stay within the squares.
        (spacing[0].min(spacing[1]) > RADII[0] + BLUR).then_some(Lines { normals, spacing })
    }

    fn distances(&self, offset: Vector2<f64>) -> [f64; 2] {
        self.normals.map(|n| n.dot(&offset))
    }
}

/// `(level + half_contrast tanh(d0 / width) tanh(d1 / width)) (1 + slope . p)`, its mean over a pixel: place (2), angles of
/// the normals (2), width, level, half contrast, slope (2).
#[derive(Clone, Copy)]
struct Saddle(SVector<f64, 9>);

type Normal = SMatrix<f64, 9, 9>;

impl Saddle {
    fn start(pixels: &[Pixel], expected: &Expected) -> Option<Saddle> {
        let lines = Lines::of(&expected.axes)?;
        let [first, second] = lines.normals.map(|n| n.y.atan2(n.x));
        let mean = pixels.iter().map(|p| p.1).sum::<f64>() / pixels.len() as f64;
        let spread = pixels.iter().map(|p| (p.1 - mean).abs()).sum::<f64>() / pixels.len() as f64;
        let half_contrast = if expected.black_ahead { -spread } else { spread };
        let at = expected.at;
        Some(Saddle(SVector::from([at.x, at.y, first, second, 1.0, mean, half_contrast, 0.0, 0.0])))
    }

    fn at(&self) -> Vector2<f64> {
        Vector2::new(self.0[0], self.0[1])
    }

    fn half_contrast(&self) -> f64 {
        self.0[6]
    }

    /// A damped step; an edge that is as sharp as can be gets no sharper.
    fn step(&self, normal: &Normal, slope: &SVector<f64, 9>, damping: f64) -> Option<SVector<f64, 9>> {
        let (mut damped, mut slope) = (*normal, *slope);
        if self.0[4] <= SHARPEST && slope[4] < 0.0 {
            damped.row_mut(4).fill(0.0);
            damped.column_mut(4).fill(0.0);
            damped[(4, 4)] = 1.0;
            slope[4] = 0.0;
        }
        for i in 0..9 {
            damped[(i, i)] *= 1.0 + damping;
        }
        Some(Cholesky::new(damped)?.solve(&slope))
    }

    fn moved(&self, step: &SVector<f64, 9>) -> Saddle {
        let mut next = self.0 + step;
        next[4] = next[4].max(SHARPEST);
        Saddle(next)
    }

    /// The normal matrix, the right-hand side and the sum of squares.
    fn linearise(&self, pixels: &[Pixel]) -> (Normal, SVector<f64, 9>, f64) {
        let p = &self.0;
        let (width, level, half) = (p[4], p[5], p[6]);
        let directions = [p[2].sin_cos(), p[3].sin_cos()];
        let (mut normal, mut slope, mut squares) = (Normal::zeros(), SVector::zeros(), 0.0);
        for (at, grey) in pixels {
            let (dx, dy) = (at.x - p[0], at.y - p[1]);
            let mut row = SVector::<f64, 9>::zeros();
            for (sx, sy) in SAMPLES.into_iter().flat_map(|sy| SAMPLES.map(|sx| (sx, sy))) {
                let (dx, dy) = (dx + sx, dy + sy);
                let [d0, d1] = directions.map(|(sin, cos)| cos * dx + sin * dy);
                let (t0, t1) = ((d0 / width).tanh(), (d1 / width).tanh());
                let (by_d0, by_d1) = (SHARE * (1.0 - t0 * t0) * t1, SHARE * (1.0 - t1 * t1) * t0);
                let (by_d0, by_d1) = (half / width * by_d0, half / width * by_d1);
                let [(s0, c0), (s1, c1)] = directions;
                row[0] -= by_d0 * c0 + by_d1 * c1;
                row[1] -= by_d0 * s0 + by_d1 * s1;
                row[2] += by_d0 * (c0 * dy - s0 * dx);
                row[3] += by_d1 * (c1 * dy - s1 * dx);
                row[4] -= (by_d0 * d0 + by_d1 * d1) / width;
                row[6] += SHARE * t0 * t1;
            }
            let (even, gain) = (level + half * row[6], 1.0 + p[7] * dx + p[8] * dy);
            row[5] = 1.0;
            row *= gain;
            row[0] -= even * p[7];
            row[1] -= even * p[8];
            row[7] = even * dx;
            row[8] = even * dy;
            let residual = grey - even * gain;
            normal += row * row.transpose();
            slope += row * residual;
            squares += residual * residual;
        }
        (normal, slope, squares)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 41;

    /// Two crossing edges, each pixel the mean of 16 x 16 samples that thin out to `spread` pixels from its centre, seen
    /// through `tone`.
    fn picture(at: [f64; 2], axes: &Matrix2<f64>, spread: f64, tone: impl Fn(f64, f64) -> f64) -> Grey {
        let inverse = axes.try_inverse().unwrap();
        let sample = |k: u32| {
            let share = (f64::from(k) + 0.5) / 16.0;
            let aside = |rest: f64| 1.0 - (2.0 * rest).sqrt();
            spread * if share < 0.5 { -aside(share) } else { aside(1.0 - share) }
        };
        let grey = |pixel: usize| {
            let (x, y) = ((pixel % SIDE) as f64, (pixel / SIDE) as f64);
            let black = (0..256).filter(|k| {
                let board = inverse * Vector2::new(x + sample(k % 16) - at[0], y + sample(k / 16) - at[1]);
                board.x * board.y > 0.0
            });
            tone(1.0 - black.count() as f64 / 256.0, x).round().clamp(0.0, 255.0) as u8
        };
        Grey { width: SIDE, height: SIDE, data: (0..SIDE * SIDE).map(grey).collect() }
    }

    fn expected(axes: Matrix2<f64>) -> Expected {
        Expected { at: Vector2::new(20.0, 20.0), axes, black_ahead: true, margin: 0.125 }
    }

    fn axes() -> [Matrix2<f64>; 3] {
        [
            Matrix2::new(30.0, 4.0, -5.0, 28.0),
            Matrix2::new(3.0, -30.0, 31.0, 2.0),
            Matrix2::new(30.0, 18.0, 12.0, 36.0),
        ]
    }

    /// The largest miss over places in the pixel and directions of the edges.
    fn worst(spread: f64, tone: impl Fn(f64, f64) -> f64) -> f64 {
        let places = (0..16).map(|k| [19.6 + 0.27 * f64::from(k % 4), 19.55 + 0.25 * f64::from(k / 4)]);
        let miss = |(at, axes): ([f64; 2], Matrix2<f64>)| {
            let found = fit(&picture(at, &axes, spread, &tone), &expected(axes)).unwrap();
            (found - Vector2::from(at)).norm()
        };
        places.flat_map(|at| axes().map(|axes| (at, axes))).map(miss).fold(0.0, f64::max)
    }

    #[test]
    fn a_doubled_picture_shows_the_same_places() {
        let ramp = |k: usize| (8 * (k % 12) + 4 * (k / 12)) as u8;
        let small = Grey { width: 12, height: 9, data: (0..12 * 9).map(ramp).collect() };
        let large = small.doubled();
        assert_eq!((large.width, large.height, large.data.len()), (24, 18, 24 * 18));
        // Away from the edges, where the last pixel counts twice.
        for (x, y) in (1..17).flat_map(|y| (1..23).map(move |x| (x, y))) {
            let at = Grey::halved(Vector2::new(f64::from(x), f64::from(y)));
            let grey = f64::from(large.data[(y * 24 + x) as usize]);
            assert!((grey - (8.0 * at.x + 4.0 * at.y)).abs() <= 0.5, "{x} {y}: {grey}");
        }
    }

    #[test]
    fn a_corner_anywhere_in_its_pixel_is_found() {
        let tone = |v: f64, _| 30.0 + 190.0 * v;
        let blurred = worst(1.5, tone);
        assert!(blurred < 0.02, "{blurred}");
        // Sharper than lenses are: what lies between the pixels is lost.
        let sharp = worst(0.75, tone);
        assert!(sharp < 0.04, "{sharp}");
    }

    #[test]
    fn neither_clipped_highlights_nor_a_slope_of_brightness_pull_it_aside() {
        let clipped = worst(1.5, |v, _| 60.0 + 300.0 * v);
        assert!(clipped < 0.05, "{clipped}");
        let sloping = worst(1.5, |v, x| (30.0 + 150.0 * v) * (1.0 + 0.01 * (x - 20.0)));
        assert!(sloping < 0.03, "{sloping}");
    }

    #[test]
    fn what_is_no_such_corner_is_none() {
        let axes = axes()[0];
        let corner = picture([20.3, 19.8], &axes, 1.5, |v, _| 30.0 + 190.0 * v);
        assert!(fit(&corner, &expected(axes)).is_some());
        assert!(
            fit(&corner, &Expected { black_ahead: false, ..expected(axes) }).is_none(),
            "black for white"
        );
        let away = Expected { at: Vector2::new(24.0, 20.0), ..expected(axes) };
        assert!(fit(&corner, &away).is_none(), "too far");
        let outside = Expected { at: Vector2::new(-20.0, 20.0), ..expected(axes) };
        assert!(fit(&corner, &outside).is_none(), "outside");
        assert!(fit(&picture([20.3, 19.8], &axes, 1.5, |_, _| 90.0), &expected(axes)).is_none(), "flat");
        assert!(fit(&corner, &expected(axes / 10.0)).is_none(), "squares of three pixels");
        assert!(fit(&corner, &expected(Matrix2::zeros())).is_none(), "no axes");
    }
}
