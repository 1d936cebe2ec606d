//! The bodies that an arm is made of, and how far its joints can move them.

use glam::DVec3;

use super::{Arm, ArmModel, Capsule, Joints, LINK_NAMES};

/// Links that their shape keeps apart in every configuration, though capsules, being larger, might meet. The arms'
/// MoveIt configurations leave out the same pairs; for the UR5e (forearm, second wrist) follows from its meshes.
const NEVER_MEET: [(usize, usize); 3] = [(0, 2), (3, 5), (4, 6)];
/// The link that a tool is fixed to.
const FLANGE: usize = 6;

/// A capsule of a link.
#[derive(Clone, Debug)]
pub struct Body {
    pub arm: usize,
    /// Which link, from 0 for the base; a tool is of the last.
    pub link: usize,
    pub name: &'static str,
    pub capsule: Capsule,
    /// For each joint that moves it: the farthest that its segment can be from the joint's axis, metres.
    reach: Vec<f64>,
}

impl Body {
    /// The most that a point of it moves while the joints move by `step`, as seen from link `first`, metres.
    pub fn travel(&self, step: &Joints, first: usize) -> f64 {
        self.reach.iter().zip(step).skip(first).fold(0.0, |sum, (reach, angle)| sum + reach * angle.abs())
    }
}

/// All bodies of arm number `index`, from the base on.
pub fn bodies(index: usize, arm: &Arm) -> Vec<Body> {
    let named = LINK_NAMES.into_iter().zip(arm.model.capsules).enumerate();
    let links = named.flat_map(|(link, (name, all))| all.iter().map(move |capsule| (link, name, *capsule)));
    let tool = arm.tool.hull.iter().map(|capsule| (FLANGE, "tool", *capsule));
    let body = |(link, name, capsule)| {
        let reach = reach(&arm.model, link, &capsule);
        Body { arm: index, link, name, capsule, reach }
    };
    links.chain(tool).map(body).collect()
}

/// For each joint that moves a link: how far a capsule of it can be from the joint's axis, whatever the joints between.
fn reach(model: &ArmModel, link: usize, capsule: &Capsule) -> Vec<f64> {
    let steps = model.steps();
    let mut farthest = vec![0.0_f64; link];
    for end in [capsule.start, capsule.end].map(DVec3::from_array) {
        let (mut from_origin, mut from_axis) = (end.length(), end.truncate().length());
        for joint in (0..link).rev() {
            farthest[joint] = farthest[joint].max(from_axis);
            let step = &steps[joint];
            from_origin += step.a.hypot(step.d);
            // An offset along an axis that is parallel to the one before leads no farther from that.
            from_axis = if step.twist == 0.0 { from_axis + step.a.abs() } else { from_origin };
        }
    }
    farthest
}

/// Whether the distance between two bodies matters.
pub fn can_meet(a: &Body, b: &Body) -> bool {
    let pair = (a.link.min(b.link), a.link.max(b.link));
    let tool = a.name == "tool" || b.name == "tool";
    let fixed = if tool { pair.0 >= FLANGE - 1 } else { pair.1 - pair.0 < 2 || NEVER_MEET.contains(&pair) };
    a.arm != b.arm || !fixed
}
