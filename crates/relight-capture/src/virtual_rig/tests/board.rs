//! Printed boards lie where they are said to lie.

use glam::dvec3;
use relight_scene::Pose;

use super::super::{PrintedBoard, Settings};
use super::{camera, light, rig, settings, white_lamp};

#[test]
fn edges_of_a_print_are_true_to_hundredths_of_a_pixel() {
    // Two texels, dark and bright, of 0.1 m: the edge is at x = 0.1 on the board, turned half a degree against the rows.
    let picture = [0u8, 255, 0, 255];
    let (sine, cosine) = 0.009f64.sin_cos();
    // Board axes: +X along world x, +Y down, that is along -y; seen from above.
    let pose = Pose([[cosine, sine, 0.0, -0.1], [sine, -cosine, 0.0, 0.1], [0.0, 0.0, -1.0, 0.0]]);
    let board =
        PrintedBoard { columns: 2, rows: 2, picture: &picture, texel: 0.1, pose, reflectance: [0.05, 0.85] };
    let mut view = camera(dvec3(0.03, -0.12, 0.5), dvec3(0.0, 0.0, 0.0), [64, 48], 900.0);
    view.intrinsics.distortion = vec![-0.11, 0.14, 0.0011, -0.0007];
    let settings = Settings { samples: 64, ..settings(64) };
    let picture = &rig(&board.model().unwrap(), white_lamp(0.0), settings)
        .radiance(&view, &[light(0, dvec3(0.0, 0.0, 5.0))])[0];
    let (mut worst, mut mean, mut rows) = (0.0f64, 0.0, 0.0);
    for y in 4..44 {
        let row: Vec<f64> = (0..64).map(|x| picture.at(x, y)[0]).collect();
        // Light falls so evenly that both sides are flat: the row's sum tells where the edge is.
        let dark_share = row.iter().map(|v| (row[63] - v) / (row[63] - row[0])).sum::<f64>();
        let found = dark_share - 0.5;
        // Where the true edge crosses the row: walk along it.
        let crossing = (0..=20_000).map(|k| f64::from(k) / 20_000.0 * 0.2).map(|down| {
            view.intrinsics.project(view.pose.inverse_transform(pose.transform([0.1, down, 0.0]))).unwrap()
        });
        let true_x = crossing
            .min_by(|a, b| (a[1] - f64::from(y)).abs().total_cmp(&(b[1] - f64::from(y)).abs()))
            .unwrap()[0];
        worst = worst.max((found - true_x).abs());
        mean += found - true_x;
        rows += 1.0;
    }
    assert!((mean / rows).abs() < 0.01, "{}", mean / rows);
    assert!(worst < 0.05, "{worst}");
}
