use proptest::prelude::*;
use serde::Deserialize;

use crate::Intrinsics;

#[derive(Deserialize)]
struct Golden {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    coefficients: usize,
    distortion: Vec<f64>,
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    points: Vec<[f64; 3]>,
    pixels: Vec<[f64; 2]>,
    rays: Vec<[f64; 2]>,
}

impl Case {
    fn lens(&self) -> Intrinsics {
        let &Case { width, height, fx, fy, cx, cy, .. } = self;
        Intrinsics { width, height, fx, fy, cx, cy, distortion: self.distortion.clone() }
    }
}

fn golden() -> Vec<Case> {
    let golden: Golden = serde_json::from_str(include_str!("../../tests/golden/cameras.json")).unwrap();
    golden.cases
}

#[test]
fn projects_as_opencv_does() {
    let cases = golden();
    assert_eq!(cases.iter().map(|case| case.coefficients).collect::<Vec<_>>(), [0, 4, 5, 8, 12, 14]);
    for case in cases {
        for (point, expected) in case.points.iter().zip(&case.pixels) {
            let [u, v] = case.lens().project(*point).unwrap();
            let miss = (u - expected[0]).hypot(v - expected[1]);
            assert!(miss < 1e-8, "{} coefficients: off by {miss} pixels", case.coefficients);
        }
    }
}

#[test]
fn unprojects_as_opencv_does() {
    for case in golden() {
        for ([u, v], expected) in case.pixels.iter().zip(&case.rays) {
            let [x, y, z] = case.lens().unproject(*u, *v);
            let miss = (x - expected[0]).hypot(y - expected[1]);
            assert!(z == 1.0 && miss < 1e-10, "{} coefficients: off by {miss}", case.coefficients);
        }
    }
}

#[test]
fn nothing_is_seen_behind_the_camera() {
    let lens = golden().remove(0).lens();
    assert_eq!(lens.project([0.0, 0.0, -1.0]), None);
    assert_eq!(lens.project([0.0, 0.0, 0.0]), None);
    assert_eq!(lens.project([0.0, 0.0, 2.0]), Some([lens.cx, lens.cy]));
}

#[test]
fn resizing_keeps_the_edges() {
    let lens = golden().remove(2).lens();
    let half = lens.resized(lens.width / 2, lens.height / 2);
    for (u, v) in [(-0.5, -0.5), (f64::from(lens.width) - 0.5, f64::from(lens.height) - 0.5)] {
        let [x, y, _] = lens.unproject(u, v);
        let [hx, hy, _] = half.unproject((u + 0.5) / 2.0 - 0.5, (v + 0.5) / 2.0 - 0.5);
        assert!((x - hx).hypot(y - hy) < 1e-9);
    }
    let back = half.resized(lens.width, lens.height);
    assert!((back.fx - lens.fx).abs() < 1e-9 && (back.cx - lens.cx).abs() < 1e-9);
}

#[test]
fn impossible_lenses_are_named() {
    let good = golden().remove(1).lens();
    assert_eq!(good.fault(), None);
    let faulty = [
        Intrinsics { width: 0, ..good.clone() },
        Intrinsics { height: 60_000, ..good.clone() },
        Intrinsics { fx: -2000.0, ..good.clone() },
        Intrinsics { fy: f64::NAN, ..good.clone() },
        Intrinsics { cx: 1e12, ..good.clone() },
        Intrinsics { distortion: vec![0.1; 3], ..good.clone() },
        Intrinsics { distortion: vec![f64::INFINITY; 4], ..good.clone() },
    ];
    for lens in faulty {
        assert!(lens.fault().is_some(), "{lens:?}");
    }
}

#[test]
fn a_folding_lens_is_seen() {
    let good = golden().remove(1).lens();
    assert!(good.round_trip_error() < 1e-6);
    let folding = Intrinsics { distortion: vec![-20.0, 0.0, 0.0, 0.0], ..good };
    assert!(folding.round_trip_error() > 1.0);
}

proptest! {
    #[test]
    fn any_lens_gives_finite_rays(
        distortion in prop::collection::vec(-10.0..10.0f64, 14),
        u in -1e5..1e5f64,
        v in -1e5..1e5f64,
    ) {
        let lens = Intrinsics { distortion, ..golden().remove(0).lens() };
        let ray = lens.unproject(u, v);
        prop_assert!(ray.iter().all(|x| x.is_finite()), "{ray:?}");
    }

    #[test]
    fn mild_lenses_round_trip(
        radial in -0.1..0.1f64,
        tangential in -0.002..0.002f64,
        u in 0.0..1439.0f64,
        v in 0.0..1079.0f64,
    ) {
        let lens = Intrinsics {
            distortion: vec![radial, -radial / 3.0, tangential, -tangential],
            ..golden().remove(0).lens()
        };
        let [x, y] = lens.project(lens.unproject(u, v)).unwrap();
        prop_assert!((x - u).hypot(y - v) < 1e-8);
    }
}
