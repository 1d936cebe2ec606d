//! Two arms and a camera, driven along the motions of an itinerary.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use super::error::ArmsFault;
use super::itinerary::{CAMERA, Itinerary, LIGHT, station};
use super::roadmap::HOME;
use super::whereabouts::{NEAR, Whereabouts, locate};
use crate::camera::{CameraError, Frame};
use crate::kinematics::Joints;
use crate::robot::{
    Arm, ArmError, ArmState, ArmStatus, JointSpeed, MotionPlan, PlannedMotion, largest_difference,
};
use crate::session::{Rig, RigFault, Target};

/// An arm may be measured this far from its station when a photograph is taken, radians; farther, something moved it. While it waits
/// for the other it may be [`NEAR`], as it may be where it begins to move.
const STANDS: f64 = 2e-3;
/// How often the arm that waits is looked at while the other moves.
const LOOK: Duration = Duration::from_millis(100);
/// Where states come from that tell no address.
const ITS_CONTROLLER: &str = "its controller";

/// Where everything is when a photograph is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stance {
    /// The view's number.
    pub view: usize,
    /// The light's number.
    pub light: usize,
    /// Measured joints of the camera's arm and the light's, radians.
    pub joints: [Joints; 2],
}

/// What takes the photographs of a rig with arms: any camera, or a virtual one that must know where it is.
pub trait Eye {
    /// Takes a photograph.
    ///
    /// # Errors
    /// As [`Camera::shoot`](crate::camera::Camera::shoot).
    fn shoot(&mut self, stance: &Stance) -> Result<Frame, CameraError>;

    /// Lets the following photographs be exposed for a multiple of the session's time.
    ///
    /// # Errors
    /// As [`Camera::expose`](crate::camera::Camera::expose).
    fn expose(&mut self, multiple: f64) -> Result<(), CameraError> {
        if multiple == 1.0 { Ok(()) } else { Err(CameraError::fixed_exposure()) }
    }

    /// Sees something else than the scene from now on, or the scene again.
    ///
    /// # Errors
    /// As [`Rig::show`].
    fn show(&mut self, target: Target) -> Result<(), RigFault>;
}

/// How arms move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// How fast.
    pub speed: JointSpeed,
    /// How long everything swings on after the arms came to rest.
    pub settle: Duration,
}

/// How far the arms went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Travel {
    /// Motions of the camera's arm and the light's.
    pub motions: [usize; 2],
    /// How long these take as planned, and settling.
    pub time: Duration,
}

/// A rig of two arms. Every motion is one of the itinerary's, and is checked again, with both arms where they stand, before it
/// is ordered. Whatever goes wrong, both arms are told to stop.
pub struct ArmsRig<'a> {
    itinerary: &'a Itinerary,
    /// Labels of views and lights, by their number in the session.
    labels: [Vec<usize>; 2],
    arms: [Box<dyn Arm + 'a>; 2],
    eye: Box<dyn Eye + 'a>,
    pace: Pace,
    stands: [Whereabouts; 2],
    stance: Option<Stance>,
    travel: Travel,
    interrupt: Option<&'a AtomicBool>,
}

impl<'a> ArmsRig<'a> {
    /// A rig of arms that are ready and stand anywhere along the itinerary: at home, at a waypoint, or where a motion was
    /// interrupted. Nothing moves yet. `labels` says which waypoints the session's views and lights are.
    ///
    /// # Errors
    /// If an arm is not ready, or stands elsewhere.
    pub fn new(
        itinerary: &'a Itinerary,
        labels: [Vec<usize>; 2],
        arms: [Box<dyn Arm + 'a>; 2],
        eye: Box<dyn Eye + 'a>,
        pace: Pace,
    ) -> Result<ArmsRig<'a>, ArmsFault> {
        let (stands, stance, travel) = ([Whereabouts::At(HOME); 2], None, Travel::default());
        let interrupt = None;
        let mut rig = ArmsRig { itinerary, labels, arms, eye, pace, stands, stance, travel, interrupt };
        let joints = [rig.ready(CAMERA)?, rig.ready(LIGHT)?];
        let astray = |arm: usize| ArmsFault::Astray {
            arm: itinerary.arm(arm).name.clone(),
            joints: joints[arm],
            home: *itinerary.joints(arm, HOME),
        };
        let camera = locate(itinerary, CAMERA, HOME, &joints[CAMERA]).ok_or_else(|| astray(CAMERA))?;
        // The camera moves only while the light is at home.
        let beside = if let Whereabouts::At(station) = camera { station } else { HOME };
        let light = locate(itinerary, LIGHT, beside, &joints[LIGHT]);
        let is_possible = |light: &Whereabouts| {
            matches!((camera, light), (Whereabouts::At(_), _) | (_, Whereabouts::At(HOME)))
        };
        let light = light.filter(is_possible).ok_or_else(|| astray(LIGHT))?;
        rig.stands = [camera, light];
        Ok(rig)
    }

    /// Ends motions as soon as a flag is set: both arms are told to stop.
    #[must_use]
    pub fn interruptible(mut self, flag: &'a AtomicBool) -> ArmsRig<'a> {
        self.interrupt = Some(flag);
        self
    }

    /// How far the arms went so far.
    pub fn travel(&self) -> Travel {
        self.travel
    }

    /// Brings both arms home.
    ///
    /// # Errors
    /// As going to a view.
    pub fn park(&mut self) -> Result<(), ArmsFault> {
        self.stance = None;
        self.go(LIGHT, HOME).and_then(|()| self.go(CAMERA, HOME)).map_err(|fault| self.halt(fault))
    }

    /// The measured joints of an arm that is at rest and ready.
    fn ready(&mut self, arm: usize) -> Result<Joints, ArmsFault> {
        let name = || self.itinerary.arm(arm).name.clone();
        let joints = self.arms[arm].state().and_then(idle);
        joints.map_err(|fault| ArmsFault::Arm { arm: name(), fault })
    }

    /// Takes an arm to a station by planned motions.
    fn go(&mut self, arm: usize, to: usize) -> Result<(), ArmsFault> {
        if self.stands[arm] == Whereabouts::At(to) {
            return Ok(());
        }
        let itinerary = self.itinerary;
        let name = || itinerary.arm(arm).name.clone();
        let no_way = || ArmsFault::NoWay { arm: name(), label: to.saturating_sub(1) };
        let other = 1 - arm;
        let Whereabouts::At(beside) = self.stands[other] else { return Err(no_way()) };
        let map = itinerary.roadmap(arm, beside).ok_or_else(no_way)?;
        let mut stops = Vec::new();
        let from = match self.stands[arm] {
            Whereabouts::At(station) => station,
            Whereabouts::Between { joints, nearest } => {
                stops.push(joints);
                nearest
            }
        };
        stops.push(*itinerary.joints(arm, from));
        let way = map.way(from, to).ok_or_else(no_way)?;
        stops.extend(way.iter().map(|&station| *itinerary.joints(arm, station)));
        let mut both = [*itinerary.joints(other, beside); 2];
        let mut at = |joints: &Joints| {
            both[arm] = *joints;
            both
        };
        let plan = MotionPlan::through(&stops, self.pace.speed, |from, to| {
            itinerary.cell().check_motion(&at(from), &at(to))
        });
        let plan = plan.map_err(|fault| ArmsFault::Refused { arm: name(), fault })?;
        for motion in plan.motions() {
            self.move_along(arm, motion, itinerary.joints(other, beside))?;
            self.travel.motions[arm] += 1;
            self.travel.time = self.travel.time.saturating_add(motion.duration());
        }
        self.stands[arm] = Whereabouts::At(to);
        Ok(())
    }

    /// Moves an arm while the other stands ready at its station, of joints `beside`.
    fn move_along(&mut self, arm: usize, motion: &PlannedMotion, beside: &Joints) -> Result<(), ArmsFault> {
        let name = |arm: usize| self.itinerary.arm(arm).name.clone();
        let interrupt = self.interrupt;
        let is_interrupted = || interrupt.is_some_and(|flag| flag.load(Ordering::Relaxed));
        let [camera, light] = &mut self.arms;
        let (moving, waiting) = if arm == CAMERA { (camera, light) } else { (light, camera) };
        let mut look = || {
            if is_interrupted() {
                return Err(ArmsFault::Interrupted);
            }
            let state = waiting.state();
            let state = state.and_then(idle).map_err(|fault| ArmsFault::Arm { arm: name(1 - arm), fault })?;
            displaced(&state, beside, NEAR, || name(1 - arm)).map_or(Ok(()), Err)
        };
        look()?;
        let (mut looked, mut reason) = (None::<Instant>, None);
        let moved = moving.move_while(motion, &mut || {
            if !is_interrupted() && looked.is_some_and(|looked| looked.elapsed() < LOOK) {
                return Ok(());
            }
            looked = Some(Instant::now());
            look().map_err(|fault| {
                reason = Some(fault);
                ArmError::Stopped { address: ITS_CONTROLLER.to_owned(), status: ArmStatus::Idle }
            })
        });
        match (moved, reason) {
            (Ok(_), _) => Ok(()),
            // The moving arm failed for that reason; that it was then not stopped weighs more.
            (Err(fault), Some(reason)) if !matches!(fault, ArmError::NotStopped { .. }) => Err(reason),
            (Err(fault), _) => Err(ArmsFault::Arm { arm: name(arm), fault }),
        }
    }

    /// The waypoint of a view or light of the session.
    fn waypoint(&self, arm: usize, number: usize) -> Result<usize, ArmsFault> {
        let label = self.labels[arm].get(number).copied();
        label
            .map(station)
            .ok_or_else(|| ArmsFault::NoWay { arm: self.itinerary.arm(arm).name.clone(), label: number })
    }

    fn go_to_view(&mut self, view: usize) -> Result<(), ArmsFault> {
        let to = self.waypoint(CAMERA, view)?;
        if self.stands[CAMERA] != Whereabouts::At(to) {
            self.go(LIGHT, HOME)?;
            self.go(CAMERA, to)?;
        }
        self.stance = Some(Stance { view, light: 0, joints: [[0.0; 6]; 2] });
        Ok(())
    }

    fn go_to_light(&mut self, light: usize) -> Result<(), ArmsFault> {
        let to = self.waypoint(LIGHT, light)?;
        self.go(LIGHT, to)?;
        thread::sleep(self.pace.settle);
        let joints = [self.standing(CAMERA)?, self.standing(LIGHT)?];
        if let Some(stance) = &mut self.stance {
            (stance.light, stance.joints) = (light, joints);
        }
        Ok(())
    }

    /// The measured joints of an arm that stands where it was brought.
    fn standing(&mut self, arm: usize) -> Result<Joints, ArmsFault> {
        let joints = self.ready(arm)?;
        if let Whereabouts::At(station) = self.stands[arm] {
            let (expected, name) =
                (self.itinerary.joints(arm, station), || self.itinerary.arm(arm).name.clone());
            if let Some(moved) = displaced(&joints, expected, STANDS, name) {
                return Err(moved);
            }
        }
        Ok(joints)
    }

    /// Stops both arms after a fault.
    fn halt(&mut self, fault: ArmsFault) -> ArmsFault {
        self.stance = None;
        let mut fault = fault;
        for (arm, place) in self.arms.iter_mut().zip([CAMERA, LIGHT]) {
            let name = &self.itinerary.arm(place).name;
            // An arm whose own stop is known to have failed has said so.
            let has_said =
                matches!(&fault, ArmsFault::Arm { arm, fault: ArmError::NotStopped { .. } } if arm == name);
            if !has_said && let Err(stop) = arm.stop() {
                fault = ArmsFault::NotStopped { fault: Box::new(fault), arm: name.clone(), stop };
            }
        }
        fault
    }
}

/// The joints of an arm that is at rest and ready.
fn idle(state: ArmState) -> Result<Joints, ArmError> {
    match state.status {
        ArmStatus::Idle => Ok(state.joints),
        status => Err(ArmError::Stopped { address: ITS_CONTROLLER.to_owned(), status }),
    }
}

/// What is wrong with an arm, of some name, that is farther than `near` from where it is to stand.
fn displaced(
    joints: &Joints,
    expected: &Joints,
    near: f64,
    name: impl FnOnce() -> String,
) -> Option<ArmsFault> {
    let (joint, off) = largest_difference(joints, expected);
    (off > near).then(|| ArmsFault::Moved { arm: name(), joint, off })
}

impl Rig for ArmsRig<'_> {
    fn view(&mut self, view: usize) -> Result<(), RigFault> {
        let gone = self.go_to_view(view).map_err(|fault| self.halt(fault));
        gone.map_err(|fault| RigFault::Motion(Box::new(fault)))
    }

    fn light(&mut self, light: usize) -> Result<(), RigFault> {
        self.travel.time = self.travel.time.saturating_add(self.pace.settle);
        let gone = self.go_to_light(light).map_err(|fault| self.halt(fault));
        gone.map_err(|fault| RigFault::Motion(Box::new(fault)))
    }

    fn shoot(&mut self) -> Result<Frame, CameraError> {
        let stance = self.stance.as_ref().ok_or_else(|| CameraError::Failed {
            problem: "no view was gone to".to_owned(),
            mend: "Go to a view first.",
        })?;
        self.eye.shoot(stance)
    }

    fn expose(&mut self, multiple: f64) -> Result<(), CameraError> {
        self.eye.expose(multiple)
    }

    /// Both arms wait at home meanwhile: somebody may have to come near.
    fn show(&mut self, target: Target) -> Result<(), RigFault> {
        let motion = |fault: ArmsFault| RigFault::Motion(Box::new(fault));
        self.park().map_err(motion)?;
        let joints = [self.standing(CAMERA), self.standing(LIGHT)];
        let [camera, light] = joints.map(|joints| joints.map_err(motion));
        self.stance = Some(Stance { view: 0, light: 0, joints: [camera?, light?] });
        self.eye.show(target)
    }
}
