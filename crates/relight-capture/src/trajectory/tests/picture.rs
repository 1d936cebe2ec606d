use relight_scene::Image;

use super::super::picture::{Reach, picture};
use super::super::{Plan, PlanSettings};

const RED: [u8; 3] = [255, 70, 70];

fn arm(name: &str, shoulder: [f64; 3], radius: f64) -> Reach {
    Reach { name: name.into(), shoulder, radius }
}

fn count(image: &Image, is: impl Fn([u8; 3]) -> bool) -> usize {
    image.data.as_chunks::<3>().0.iter().filter(|&&pixel| is(pixel)).count()
}

#[test]
fn a_picture_shows_domes_arms_and_what_is_unreachable() {
    let mut plan = Plan::new(&PlanSettings::default()).unwrap();
    let plain = picture(&plan, None, None);
    assert_eq!((plain.width, plain.height, plain.data.len()), (1500, 1086, 3 * 1500 * 1086));
    let blue = |[r, _, b]: [u8; 3]| i32::from(b) > i32::from(r) + 30;
    let yellow = |[r, _, b]: [u8; 3]| i32::from(r) > i32::from(b) + 60;
    assert!(count(&plain, blue) > 5000 && count(&plain, yellow) > 5000);
    assert_eq!(count(&plain, |pixel| pixel == RED), 0);
    plan.light.waypoints[5].unreachable = Some("the arm would hit the table".into());
    plan.light.order.retain(|&label| label != 5);
    let marked = picture(&plan, None, None);
    // A cross of plain red in each view, and beneath it a dot, dimmer where it is farther.
    let reddish = |[r, g, b]: [u8; 3]| r > 120 && i32::from(r) > 2 * i32::from(g) && g.abs_diff(b) < 12;
    let (cross, all) = (count(&marked, |pixel| pixel == RED), count(&marked, reddish));
    assert!(cross > 100 && all > cross + 290, "{cross} {all}");
    let arms = [arm("EC66", [0.0, -0.9, 0.1], 0.8), arm("UR5e", [0.6, 0.5, 0.16], 0.85)];
    let reached = picture(&plan, Some(&arms[0]), Some(&arms[1]));
    assert!(reached != marked);
    if let Some(folder) = std::env::var_os("RELIGHT_PLAN_PICTURES") {
        let folder = std::path::PathBuf::from(folder);
        for (name, image) in [("plain", plain), ("marked", marked), ("reached", reached)] {
            image.write_png(&folder.join(format!("{name}.png"))).unwrap();
        }
    }
}

#[test]
fn small_and_empty_plans_are_drawn_too() {
    let mut settings = super::small();
    settings.camera.waypoints = 1;
    settings.light.waypoints = 1;
    settings.light.colatitude_degrees = [0.0, 180.0];
    let mut plan = Plan::new(&settings).unwrap();
    for trajectory in [&mut plan.camera, &mut plan.light] {
        trajectory.order.clear();
        trajectory.waypoints[0].unreachable = Some("nothing is reachable".into());
    }
    let far = arm("far", [90.0, 90.0, 90.0], 1e9);
    assert!(count(&picture(&plan, Some(&far), None), |pixel| pixel == RED) > 100);
}
