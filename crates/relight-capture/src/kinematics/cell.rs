//! A cell: arms with their tools, the table, the object, and how near they are to each other.

use std::fmt;

use glam::{DAffine3, DVec3};
use relight_scene::{Pose, PoseFault};

use super::bodies::{Body, bodies, can_meet};
use super::rigid::{checked, from_pose, inverse, to_pose};
use super::shapes::Segment;
use super::{ArmModel, Capsule, Joints, Tool, Unreachable};
use crate::trajectory::ObjectBox;

/// Links that a table which the base stands on cannot meet: base and shoulder.
const ON_TABLE: usize = 2;

/// An arm in its place, with what it carries.
#[derive(Clone, Debug)]
pub struct Arm {
    /// What messages call it: "camera arm".
    pub name: String,
    /// Which arm it is.
    pub model: ArmModel,
    /// Base to world, metres.
    pub base: Pose,
    /// What it carries.
    pub tool: Tool,
}

impl Arm {
    /// Where the tool is in the world.
    pub fn tool_pose(&self, joints: &Joints) -> Pose {
        let flange = from_pose(&self.base) * from_pose(&self.model.forward(joints));
        to_pose(&(flange * from_pose(&self.tool.mount)))
    }

    /// All joint angles within their ranges that bring the tool to a pose in the world, turned to be nearest to `near`.
    ///
    /// # Errors
    /// If there are none, the reason.
    pub fn reach(&self, tool: &Pose, near: &Joints) -> Result<Vec<Joints>, Unreachable> {
        checked(tool)?;
        let in_base = inverse(&from_pose(&self.base)) * from_pose(tool);
        let flange = in_base * inverse(&from_pose(&self.tool.mount));
        self.model.inverse_within_limits(&to_pose(&flange), near)
    }
}

/// Something that must not be met.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    /// A link of an arm, or its tool.
    Link {
        /// The arm's name.
        arm: String,
        /// One of [`LINK_NAMES`](super::LINK_NAMES), or "tool".
        link: &'static str,
    },
    /// The table.
    Table,
    /// The object's box.
    Object,
    /// A wall, by its number from 0.
    Wall(usize),
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Link { arm, link } => write!(f, "the {arm}'s {link}"),
            Self::Table => f.write_str("the table"),
            Self::Object => f.write_str("the object's box"),
            Self::Wall(number) => write!(f, "wall {}", number + 1),
        }
    }
}

/// Two parts and how far they are from each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// Which parts.
    pub parts: [Part; 2],
    /// From surface to surface, metres; negative where they overlap.
    pub distance: f64,
}

impl fmt::Display for Contact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b] = &self.parts;
        if self.distance > 0.0 {
            write!(f, "{a} comes within {:.1} mm of {b}", self.distance * 1000.0)
        } else {
            write!(f, "{a} runs into {b}")
        }
    }
}

/// Why things make no cell.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CellError {
    /// A pose is not rigid.
    #[error("the {arm}'s {what} is no rigid pose: {fault}")]
    Pose {
        /// The arm's name.
        arm: String,
        /// Which of its poses.
        what: &'static str,
        /// What is wrong with it.
        fault: PoseFault,
    },
    /// A tool's hull has no size.
    #[error(
        "the hull of the {arm}'s tool has a coordinate that is not finite, or a radius that is not positive"
    )]
    Hull {
        /// The arm's name.
        arm: String,
    },
    /// The table has no height.
    #[error("the height of the table is not a finite number of metres")]
    Table,
    /// The object's box is inside out or endless.
    #[error("the object's box from {lo:?} to {hi:?} must be finite and have its lowest corner first")]
    Object {
        /// What should be its lowest corner.
        lo: [f64; 3],
        /// What should be its highest corner.
        hi: [f64; 3],
    },
    /// A wall is inside out or endless.
    #[error("wall {} from {:?} to {:?} must be finite and have its lowest corner first", number + 1, wall.lo, wall.hi)]
    Wall {
        /// Its number, from 0.
        number: usize,
        /// The box.
        wall: ObjectBox,
    },
    /// The clearance is negative or no number.
    #[error("a clearance of {0} m: it must be finite and not negative")]
    Clearance(f64),
}

/// One or more arms around an object on a table, between walls.
///
/// Links are taken as capsules that are larger than they are. What an arm carries is checked against its own links but the
/// last two, which it is built around.
#[derive(Clone, Debug)]
pub struct Cell<const ARMS: usize> {
    arms: [Arm; ARMS],
    bases: [DAffine3; ARMS],
    table: Option<f64>,
    object: Option<(DVec3, DVec3)>,
    walls: Vec<(DVec3, DVec3)>,
    clearance: f64,
    bodies: Vec<Body>,
    pub(super) pairs: Vec<Pair>,
}

/// Two things whose distance matters.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    body: usize,
    other: Other,
}

#[derive(Clone, Copy, Debug)]
enum Other {
    /// A body; if of the same arm, nearer to the base.
    Body(usize),
    Table,
    Object,
    Wall(usize),
}

/// The segments of all bodies in the world.
pub(super) struct Posed(Vec<Segment>);

impl<const ARMS: usize> Cell<ARMS> {
    /// A cell.
    ///
    /// `table` is the height of its top in the world; each arm is taken to stand on it or beside it, so that base and
    /// shoulder are not checked against it. Parts must stay `clearance` metres away from each other.
    ///
    /// # Errors
    /// If a pose is not rigid, a length no number, or a box inside out.
    pub fn new(
        arms: [Arm; ARMS],
        table: Option<f64>,
        object: Option<ObjectBox>,
        clearance: f64,
    ) -> Result<Self, CellError> {
        for Arm { name, base, tool, .. } in &arms {
            let fault = |what| move |fault| CellError::Pose { arm: name.clone(), what, fault };
            checked(base).map_err(fault("base"))?;
            checked(&tool.mount).map_err(fault("tool's mount"))?;
            if !tool.hull.iter().all(Capsule::is_sound) {
                return Err(CellError::Hull { arm: name.clone() });
            }
        }
        if !table.is_none_or(f64::is_finite) {
            return Err(CellError::Table);
        }
        if !(clearance.is_finite() && clearance >= 0.0) {
            return Err(CellError::Clearance(clearance));
        }
        if let Some(object) = object
            && !is_sound(&object)
        {
            return Err(CellError::Object { lo: object.lo, hi: object.hi });
        }
        let bases = std::array::from_fn(|i| from_pose(&arms[i].base));
        let bodies: Vec<Body> = arms.iter().enumerate().flat_map(|(i, arm)| bodies(i, arm)).collect();
        let object = object.map(|object| corners(&object));
        let mut pairs = Vec::new();
        for (body, a) in bodies.iter().enumerate() {
            if table.is_some() && a.link >= ON_TABLE {
                pairs.push(Pair { body, other: Other::Table });
            }
            if object.is_some() {
                pairs.push(Pair { body, other: Other::Object });
            }
            let before = bodies.iter().enumerate().take(body);
            pairs.extend(
                before.filter(|(_, b)| can_meet(a, b)).map(|(j, _)| Pair { body, other: Other::Body(j) }),
            );
        }
        Ok(Self { arms, bases, table, object, walls: Vec::new(), clearance, bodies, pairs })
    }

    /// The cell with walls, or other boxes that nothing may meet. An arm's base stands where it was put, and is not checked.
    ///
    /// # Errors
    /// If a box is inside out or endless.
    pub fn with_walls(mut self, walls: &[ObjectBox]) -> Result<Self, CellError> {
        for (number, wall) in walls.iter().enumerate() {
            if !is_sound(wall) {
                return Err(CellError::Wall { number, wall: *wall });
            }
            let moving = self.bodies.iter().enumerate().filter(|(_, body)| body.link > 0);
            self.pairs.extend(moving.map(|(body, _)| Pair { body, other: Other::Wall(self.walls.len()) }));
            self.walls.push(corners(wall));
        }
        Ok(self)
    }

    /// The arms, in their order.
    pub fn arms(&self) -> &[Arm; ARMS] {
        &self.arms
    }

    /// How far parts must stay away from each other, metres.
    pub fn clearance(&self) -> f64 {
        self.clearance
    }

    /// The two parts that are nearest to each other; none if the cell holds nothing that could meet.
    pub fn closest(&self, joints: &[Joints; ARMS]) -> Option<Contact> {
        let posed = self.posed(joints);
        let distances = self.pairs.iter().map(|pair| (pair, self.distance(pair, &posed)));
        let (pair, distance) = distances.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        Some(self.contact(pair, distance))
    }

    pub(super) fn posed(&self, joints: &[Joints; ARMS]) -> Posed {
        let frames: [[DAffine3; 7]; ARMS] = std::array::from_fn(|i| {
            self.arms[i].model.link_frames(&joints[i]).map(|frame| self.bases[i] * frame)
        });
        Posed(self.bodies.iter().map(|body| body.capsule.segment(&frames[body.arm][body.link])).collect())
    }

    /// From surface to surface, metres.
    pub(super) fn distance(&self, pair: &Pair, posed: &Posed) -> f64 {
        let segment = &posed.0[pair.body];
        let between = match pair.other {
            Other::Body(other) => segment.distance(&posed.0[other]) - self.bodies[other].capsule.radius,
            Other::Table => self.table.map_or(f64::INFINITY, |height| segment.height_over(height)),
            Other::Object => self.object.map_or(f64::INFINITY, |(lo, hi)| segment.distance_to_box(lo, hi)),
            Other::Wall(wall) => {
                let (lo, hi) = self.walls[wall];
                segment.distance_to_box(lo, hi)
            }
        };
        between - self.bodies[pair.body].capsule.radius
    }

    /// The most by which a pair's distance can change while the joints move by `step`, metres.
    pub(super) fn travel(&self, pair: &Pair, step: &[Joints; ARMS]) -> f64 {
        let body = &self.bodies[pair.body];
        match pair.other {
            Other::Body(other) => {
                let other = &self.bodies[other];
                if other.arm == body.arm {
                    // Joints before the other link move both.
                    body.travel(&step[body.arm], other.link)
                } else {
                    body.travel(&step[body.arm], 0) + other.travel(&step[other.arm], 0)
                }
            }
            Other::Table | Other::Object | Other::Wall(_) => body.travel(&step[body.arm], 0),
        }
    }

    pub(super) fn contact(&self, pair: &Pair, distance: f64) -> Contact {
        let part = |index: usize| {
            let body = &self.bodies[index];
            Part::Link { arm: self.arms[body.arm].name.clone(), link: body.name }
        };
        let other = match pair.other {
            Other::Body(other) => part(other),
            Other::Table => Part::Table,
            Other::Object => Part::Object,
            Other::Wall(wall) => Part::Wall(wall),
        };
        Contact { parts: [part(pair.body), other], distance }
    }
}

fn is_sound(ObjectBox { lo, hi }: &ObjectBox) -> bool {
    (0..3).all(|i| lo[i].is_finite() && hi[i].is_finite() && lo[i] <= hi[i])
}

fn corners(ObjectBox { lo, hi }: &ObjectBox) -> (DVec3, DVec3) {
    (DVec3::from_array(*lo), DVec3::from_array(*hi))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use proptest::prelude::*;

    use super::super::{EC66, UR5E};
    use super::*;

    fn alone(model: &ArmModel) -> Cell<1> {
        let (base, tool) = (Pose::IDENTITY, Tool::camera());
        let arm = Arm { name: "arm".to_owned(), model: model.clone(), base, tool };
        Cell::new([arm], Some(-1.0), None, 0.0).unwrap()
    }

    fn joints() -> impl Strategy<Value = Joints> {
        prop::array::uniform6(-PI..PI)
    }

    proptest! {
        #[test]
        fn no_point_of_a_link_moves_farther_than_the_bound(from in joints(), step in prop::array::uniform6(-0.5..0.5f64)) {
            for model in [&UR5E, &EC66] {
                let cell = alone(model);
                let to = std::array::from_fn(|i| from[i] + step[i]);
                let (before, after) = (cell.posed(&[from]), cell.posed(&[to]));
                for (i, body) in cell.bodies.iter().enumerate() {
                    let moved = [
                        before.0[i].start.distance(after.0[i].start),
                        before.0[i].end.distance(after.0[i].end),
                    ];
                    let bound = body.travel(&step, 0);
                    prop_assert!(moved.iter().all(|m| *m <= bound + 1e-12), "{}: {moved:?} > {bound}", body.name);
                }
            }
        }

        #[test]
        fn no_distance_changes_more_than_the_bound(from in joints(), step in prop::array::uniform6(-0.3..0.3f64)) {
            let wall = ObjectBox { lo: [0.2, -1.0, -0.5], hi: [0.3, 1.0, 0.4] };
            let cell = alone(&UR5E).with_walls(&[wall]).unwrap();
            let to = std::array::from_fn(|i| from[i] + step[i]);
            let (before, after) = (cell.posed(&[from]), cell.posed(&[to]));
            for pair in &cell.pairs {
                let change = (cell.distance(pair, &after) - cell.distance(pair, &before)).abs();
                prop_assert!(change <= cell.travel(pair, &[step]) + 1e-12);
            }
        }
    }

    #[test]
    fn the_bound_of_a_stretched_arm_is_nearly_what_it_moves() {
        let cell = alone(&UR5E);
        let (stretched, turned) = ([0.0; 6], [0.0, 1e-3, 0.0, 0.0, 0.0, 0.0]);
        let (before, after) = (cell.posed(&[stretched]), cell.posed(&[turned]));
        let forearm = 3;
        let moved = before.0[forearm].end.distance(after.0[forearm].end);
        let bound = cell.bodies[forearm].travel(&turned, 0);
        assert!(moved > 0.999 * bound && moved <= bound, "{moved} {bound}");
    }

    #[test]
    fn neighbours_and_links_that_never_meet_are_left_out() {
        let cell = alone(&UR5E);
        let names = |pair: &Pair| match pair.other {
            Other::Body(other) => Some((cell.bodies[other].name, cell.bodies[pair.body].name)),
            _ => None,
        };
        let pairs: Vec<_> = cell.pairs.iter().filter_map(names).collect();
        for absent in [
            ("base", "shoulder"),
            ("base", "upper arm"),
            ("second wrist", "tool"),
            ("third wrist", "tool"),
            ("tool", "tool"),
        ] {
            assert!(!pairs.contains(&absent), "{absent:?}");
        }
        for present in
            [("base", "forearm"), ("shoulder", "forearm"), ("first wrist", "tool"), ("base", "tool")]
        {
            assert!(pairs.contains(&present), "{present:?}");
        }
    }
}
