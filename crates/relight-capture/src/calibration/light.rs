//! Where the light's arm stands: its tip touches points of the board.

use nalgebra::{Matrix3, Vector3};
use relight_scene::Pose;

use super::frames::compose;

/// Fewest touches that give a rotation.
const FEWEST: usize = 3;
/// The touches' spread across their longest line must be this much at least, metres and as a share of their length: nearer to
/// a line, the rotation about it is not determined.
const NARROWEST: f64 = 0.005;
const NARROWEST_SHARE: f64 = 0.05;

/// The arm's tip on a known point of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The point in the board's frame, metres; `[0, 0, 0]` is the outer corner at the top left.
    pub on_board: [f64; 3],
    /// The tip in the frame of the arm's base, metres.
    pub in_arm: [f64; 3],
}

/// Where the light's arm stands.
#[derive(Clone, Debug, PartialEq)]
pub struct LightRegistration {
    /// Base-of-the-arm-to-world.
    pub base_to_world: Pose,
    /// Whether the rotation was measured by the touches, not declared.
    pub is_rotation_measured: bool,
    /// How far each touch misses its point, metres.
    pub residuals: Vec<f64>,
    /// Their root mean square, metres.
    pub rms: f64,
}

/// Why touches do not register the light's arm.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TouchError {
    /// Nothing was touched.
    #[error("no touches: let the light's arm touch a point of the board")]
    None,
    /// Too few touches for a rotation.
    #[error(
        "{0} touches fix the translation of the light's arm, not its rotation; touch {FEWEST} or more points of the board that do not \
         lie on a line, or declare the alignment"
    )]
    TooFew(usize),
    /// The touches lie on a line.
    #[error(
        "the touches lie within {:.1} mm of a line, so that the rotation about it is not known; touch a point farther aside, or declare \
         the alignment", .0 * 1e3
    )]
    OnALine(f64),
    /// A coordinate is infinite or not a number.
    #[error("touch {0} has a coordinate that is not a finite number")]
    NotFinite(usize),
}

impl LightRegistration {
    /// The light-to-world pose of a light at a pose in the arm's base.
    pub fn light_to_world(&self, light_to_base: &Pose) -> Pose {
        compose(&self.base_to_world, light_to_base)
    }
}

/// Registers the light's arm by touches of the board.
///
/// With a declared alignment (base-to-world; its translation is not used) the touches give the translation alone, and one is
/// enough. Without, three or more that do not lie on a line give the whole pose (Kabsch, A solution for the best rotation to
/// relate two sets of vectors, 1976).
///
/// # Errors
/// If the touches do not determine the pose.
pub fn register_light(
    touches: &[Touch],
    board_to_world: &Pose,
    declared_alignment: Option<&Pose>,
) -> Result<LightRegistration, TouchError> {
    if touches.is_empty() {
        return Err(TouchError::None);
    }
    let is_finite = |touch: &Touch| touch.on_board.iter().chain(&touch.in_arm).all(|v| v.is_finite());
    if let Some(index) = touches.iter().position(|touch| !is_finite(touch)) {
        return Err(TouchError::NotFinite(index));
    }
    let world: Vec<_> = touches.iter().map(|t| Vector3::from(board_to_world.transform(t.on_board))).collect();
    let arm: Vec<_> = touches.iter().map(|t| Vector3::from(t.in_arm)).collect();
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let (world_mean, arm_mean) = (mean(&world), mean(&arm));
    let rotation = match declared_alignment {
        Some(pose) => Matrix3::from_fn(|i, j| pose.0[i][j]),
        None if touches.len() < FEWEST => return Err(TouchError::TooFew(touches.len())),
        None => {
            check_spread(&arm, &arm_mean)?;
            check_spread(&world, &world_mean)?;
            let pairs = arm.iter().zip(&world);
            let correlation: Matrix3<f64> =
                pairs.map(|(a, w)| (w - world_mean) * (a - arm_mean).transpose()).sum();
            // Touches in a plane leave the sign of the third axis open; a rotation does not mirror.
            let svd = correlation.svd(true, true);
            let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(TouchError::OnALine(0.0)) };
            let sign = (u * v_t).determinant().signum();
            u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t
        }
    };
    let translation = world_mean - rotation * arm_mean;
    let residuals: Vec<f64> =
        arm.iter().zip(&world).map(|(a, w)| (rotation * a + translation - w).norm()).collect();
    let rms = (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt();
    let row = |i: usize| [rotation[(i, 0)], rotation[(i, 1)], rotation[(i, 2)], translation[i]];
    let base_to_world = Pose(std::array::from_fn(row));
    Ok(LightRegistration {
        base_to_world,
        is_rotation_measured: declared_alignment.is_none(),
        residuals,
        rms,
    })
}

/// Refuses points that lie on a line or nearly so.
fn check_spread(points: &[Vector3<f64>], mean: &Vector3<f64>) -> Result<(), TouchError> {
    let spread: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let mut values: [f64; 3] = spread.symmetric_eigenvalues().map(|v| v.max(0.0).sqrt()).into();
    values.sort_by(f64::total_cmp);
    let [_, narrow, wide] = values;
    if narrow >= NARROWEST.max(NARROWEST_SHARE * wide) { Ok(()) } else { Err(TouchError::OnALine(narrow)) }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;

    const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.21, 0.0, 0.0], [0.21, 0.15, 0.0], [0.0, 0.15, 0.0]];

    fn board_to_world() -> Pose {
        Pose([[1.0, 0.0, 0.0, -0.1], [0.0, -1.0, 0.0, 0.07], [0.0, 0.0, -1.0, 0.01]])
    }

    fn base_to_world(turn: [f64; 3], at: [f64; 3]) -> Pose {
        let r = Rotation3::new(Vector3::from(turn));
        Pose(std::array::from_fn(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)], at[i]]))
    }

    fn touches(truth: &Pose, points: &[[f64; 3]]) -> Vec<Touch> {
        let touch = |&on_board: &[f64; 3]| Touch {
            on_board,
            in_arm: truth.inverse_transform(board_to_world().transform(on_board)),
        };
        points.iter().map(touch).collect()
    }

    fn difference(a: &Pose, b: &Pose) -> f64 {
        let both = a.0.iter().flatten().zip(b.0.iter().flatten());
        both.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn three_touches_give_the_whole_pose(
            turn in prop::array::uniform3(-3.0..3.0f64),
            at in prop::array::uniform3(-1.0..1.0f64),
            count in 3usize..5,
        ) {
            let truth = base_to_world(turn, at);
            let found = register_light(&touches(&truth, &CORNERS[..count]), &board_to_world(), None).unwrap();
            prop_assert!(difference(&found.base_to_world, &truth) < 1e-12);
            prop_assert!(found.rms < 1e-12 && found.is_rotation_measured);
        }
    }

    #[test]
    fn one_touch_gives_the_translation_with_a_declared_alignment() {
        let truth = base_to_world([0.1, -0.2, 2.9], [0.6, -0.3, 0.02]);
        let touches = touches(&truth, &CORNERS[..1]);
        let declared = base_to_world([0.1, -0.2, 2.9], [9.0, 9.0, 9.0]);
        let found = register_light(&touches, &board_to_world(), Some(&declared)).unwrap();
        assert!(difference(&found.base_to_world, &truth) < 1e-12);
        assert!(!found.is_rotation_measured);
        let light = Pose([[1.0, 0.0, 0.0, 0.3], [0.0, 1.0, 0.0, 0.2], [0.0, 0.0, 1.0, 0.5]]);
        let at = found.light_to_world(&light).position();
        let expected = truth.transform([0.3, 0.2, 0.5]);
        assert!((0..3).all(|i| (at[i] - expected[i]).abs() < 1e-12));
    }

    #[test]
    fn a_touch_beside_its_point_shows_in_the_residuals() {
        let truth = base_to_world([0.0, 0.0, 1.0], [0.5, 0.0, 0.0]);
        let mut touches = touches(&truth, &CORNERS);
        touches[2].in_arm[2] += 0.004;
        let found = register_light(&touches, &board_to_world(), None).unwrap();
        // The plane that fits best shares the miss between all four corners of a rectangle.
        assert!(found.residuals.iter().all(|r| (r - 0.001).abs() < 1e-5), "{:?}", found.residuals);
        assert!((found.rms - 0.001).abs() < 1e-5);
    }

    #[test]
    fn a_declared_alignment_that_is_wrong_shows_in_the_residuals() {
        let touches = touches(&base_to_world([0.0, 0.0, 1.0], [0.5, 0.0, 0.0]), &CORNERS);
        let found =
            register_light(&touches, &board_to_world(), Some(&base_to_world([0.0, 0.0, 1.02], [0.0; 3])))
                .unwrap();
        assert!(found.rms > 0.002);
    }

    #[test]
    fn touches_that_leave_the_rotation_open_are_refused() {
        let truth = base_to_world([0.3, 0.0, 1.0], [0.5, 0.0, 0.0]);
        let register =
            |points: &[[f64; 3]]| register_light(&touches(&truth, points), &board_to_world(), None);
        assert_eq!(register(&[]), Err(TouchError::None));
        assert_eq!(register(&CORNERS[..1]), Err(TouchError::TooFew(1)));
        assert_eq!(register(&CORNERS[..2]), Err(TouchError::TooFew(2)));
        let line = [[0.0, 0.0, 0.0], [0.1, 0.05, 0.0], [0.2, 0.1, 0.0], [0.3, 0.15, 0.0]];
        assert!(matches!(register(&line), Err(TouchError::OnALine(_))));
        let same = [[0.1, 0.1, 0.0]; 3];
        assert!(register(&same).unwrap_err().to_string().contains("0.0 mm"));
        let mut touches = touches(&truth, &CORNERS);
        touches[1].in_arm[0] = f64::NAN;
        assert_eq!(register_light(&touches, &board_to_world(), None), Err(TouchError::NotFinite(1)));
    }
}
