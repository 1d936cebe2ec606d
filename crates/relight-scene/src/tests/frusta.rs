use proptest::prelude::*;

use crate::{Camera, Frustum, Intrinsics, Pose};

/// A camera with this lens that looks from a place at the origin.
fn camera(position: [f64; 3], distortion: &[f64]) -> Camera {
    let intrinsics = Intrinsics {
        width: 64,
        height: 48,
        fx: 60.0,
        fy: 50.0,
        cx: 30.0,
        cy: 25.0,
        distortion: distortion.to_vec(),
    };
    Camera { label: 0, intrinsics, pose: Pose::look_at(position, [0.0; 3]) }
}

/// The point that a pixel shows at a distance along the camera's axis; behind the camera if that is negative.
fn point(camera: &Camera, (u, v): (f64, f64), z: f64) -> [f64; 3] {
    camera.pose.transform(camera.intrinsics.unproject(u, v).map(|d| d * z))
}

proptest! {
    #[test]
    fn a_frustum_holds_what_its_image_shows(
        position in [-2f64..2.0, -2f64..2.0, 0.1f64..2.0], u in -0.5f64..63.5, v in -0.5f64..47.5, z in 1e-3f64..10.0,
        bent in any::<bool>(),
    ) {
        let camera = camera(position, if bent { &[-0.2, 0.05, 0.002, -0.003][..] } else { &[] });
        // Between the places that are looked up, a bent edge may reach a little further.
        let slack = if bent { 1e-3 * z } else { 1e-9 };
        prop_assert!(Frustum::of(&camera).depth_of(point(&camera, (u, v), z)) > -slack);
    }

    #[test]
    fn without_distortion_it_holds_nothing_else(
        position in [-2f64..2.0, -2f64..2.0, 0.1f64..2.0], u in -100f64..160.0, v in -100f64..140.0, z in 1e-3f64..10.0,
    ) {
        prop_assume!(!(-0.5..=63.5).contains(&u) || !(-0.5..=47.5).contains(&v));
        let camera = camera(position, &[]);
        let frustum = Frustum::of(&camera);
        prop_assert!(frustum.depth_of(point(&camera, (u, v), z)) < 0.0);
        prop_assert!(frustum.depth_of(point(&camera, (30.0, 25.0), -z)) < 0.0, "behind the camera");
    }
}

#[test]
fn depths_are_distances_from_the_nearest_side() {
    // A quarter of a turn from side to side, and less from top to bottom.
    let lens =
        Intrinsics { width: 100, height: 50, fx: 50.0, fy: 50.0, cx: 49.5, cy: 24.5, distortion: Vec::new() };
    let camera = Camera { label: 0, intrinsics: lens, pose: Pose::look_at([0.0, -3.0, 0.0], [0.0; 3]) };
    let frustum = Frustum::of(&camera);
    let [across, up] = [0.5f64.sqrt(), 1.0 / 1.25f64.sqrt()];
    for (point, depth) in [
        ([0.0, 1.0, 0.0], 2.0 * up),
        ([3.5, 1.0, 0.0], 0.5 * across),
        ([5.0, 1.0, 0.0], -across),
        ([0.0, 1.0, -3.0], -up),
    ] {
        assert!((frustum.depth_of(point) - depth).abs() < 1e-9, "{point:?}: {}", frustum.depth_of(point));
    }
}
