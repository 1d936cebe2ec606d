//! Both arms through a session: only planned motions, whatever goes wrong, wherever they stand.

#![allow(clippy::unwrap_used)]

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use relight_capture::camera::{CameraError, Frame};
use relight_capture::kinematics::{ArmPlace, ArmsSettings, Joints, Make};
use relight_capture::rig::{
    ArmsRig, CAMERA, Eye, HOME, LIGHT, NoEye, Pace, Prepared, RigFile, SimulatedArms, Stance, Walk, station,
    walk,
};
use relight_capture::robot::{Arm, ArmError, ArmState, ArmStatus, DryRun, JointSpeed, PlannedMotion};
use relight_capture::session::{Rig, RigFault, Shots, Target};
use relight_capture::trajectory::PlanSettings;
use relight_scene::{Image, Intrinsics};

const PACE: Pace = Pace { speed: JointSpeed::USUAL, settle: Duration::ZERO };

fn arms() -> ArmsSettings {
    let place =
        |model, base_metres, yaw_degrees| ArmPlace { model, base_metres, yaw_degrees, home_degrees: None };
    ArmsSettings {
        camera: place(Make::Ec66, [0.0, -1.0, 0.0], 0.0),
        light: place(Make::Ur5e, [0.0, 0.48, 0.03], 180.0),
        table_metres: 0.0,
        walls: Vec::new(),
        clearance_metres: 0.01,
    }
}

fn prepared(views: usize, lights: usize) -> Prepared {
    let mut settings = PlanSettings::default();
    (settings.camera.waypoints, settings.light.waypoints) = (views, lights);
    Prepared::new(&settings, &arms()).unwrap()
}

fn shots(prepared: &Prepared) -> Shots {
    let (width, height) = (4, 3);
    let distortion = Vec::new();
    let lens = Intrinsics { width, height, fx: 5.0, fy: 5.0, cx: 1.5, cy: 1.0, distortion };
    prepared.shots(&RigFile::default(), lens, |arm, label| prepared.itinerary.pose(arm, label))
}

/// What happened to both arms, in order.
#[derive(Clone, Debug, PartialEq)]
enum Event {
    Moved(usize, Joints, Joints),
    Stopped(usize),
}

type Record = Arc<Mutex<Vec<Event>>>;

/// An arm that keeps a record, and fails when told to.
struct Recorded {
    which: usize,
    arm: DryRun,
    record: Record,
    /// The motion, of both arms together and from 0, in the middle of which it stops.
    fails: Option<usize>,
    /// The motion during which this arm, waiting, goes into emergency stop.
    pressed: Option<usize>,
    /// The motion during which somebody pushes it out of its place.
    pushed: Option<usize>,
    /// Set as it begins to move.
    interrupt: Option<Arc<AtomicBool>>,
}

impl Arm for Recorded {
    fn state(&mut self) -> Result<ArmState, ArmError> {
        let count = moves(&self.record).len();
        let status = if self.pressed.is_some_and(|at| count > at) {
            ArmStatus::EmergencyStop
        } else {
            ArmStatus::Idle
        };
        let mut state = ArmState { status, ..self.arm.state()? };
        if self.pushed.is_some_and(|at| count > at) {
            state.joints[2] += 0.02;
        }
        Ok(state)
    }

    fn move_while(
        &mut self,
        motion: &PlannedMotion,
        go_on: &mut dyn FnMut() -> Result<(), ArmError>,
    ) -> Result<ArmState, ArmError> {
        let count = moves(&self.record).len();
        self.record.lock().unwrap().push(Event::Moved(self.which, *motion.from(), *motion.to()));
        if let Some(interrupt) = &self.interrupt {
            interrupt.store(true, Ordering::Relaxed);
        }
        if self.fails == Some(count) {
            return Err(ArmError::Stopped { address: "arm".to_owned(), status: ArmStatus::ProtectiveStop });
        }
        self.arm.move_while(motion, go_on)
    }

    fn stop(&mut self) -> Result<(), ArmError> {
        self.record.lock().unwrap().push(Event::Stopped(self.which));
        Ok(())
    }
}

fn moves(record: &Record) -> Vec<(usize, Joints, Joints)> {
    let events = record.lock().unwrap();
    let moved = |event: &Event| match event {
        Event::Moved(arm, from, to) => Some((*arm, *from, *to)),
        Event::Stopped(_) => None,
    };
    events.iter().filter_map(moved).collect()
}

/// A rig of recorded arms that stand somewhere.
fn rig<'a>(
    prepared: &'a Prepared,
    stands: [Joints; 2],
    fails: Option<usize>,
    record: &Record,
) -> Result<ArmsRig<'a>, String> {
    rig_of(
        prepared,
        [CAMERA, LIGHT].map(|which| {
            let arm = DryRun::new(prepared.itinerary.arm(which).name.clone(), stands[which]);
            Recorded {
                which,
                arm,
                record: Arc::clone(record),
                fails,
                pressed: None,
                pushed: None,
                interrupt: None,
            }
        }),
    )
}

fn rig_of(prepared: &Prepared, arms: [Recorded; 2]) -> Result<ArmsRig<'_>, String> {
    let arms = arms.map(|arm| Box::new(arm) as Box<dyn Arm>);
    ArmsRig::new(&prepared.itinerary, prepared.labels.clone(), arms, Box::new(NoEye), PACE)
        .map_err(|fault| fault.to_string())
}

fn homes(prepared: &Prepared) -> [Joints; 2] {
    [CAMERA, LIGHT].map(|arm| *prepared.itinerary.joints(arm, HOME))
}

fn middle(from: &Joints, to: &Joints) -> Joints {
    std::array::from_fn(|i| 0.5 * (from[i] + to[i]))
}

/// Where both arms stand after some motions.
fn after(moves: &[(usize, Joints, Joints)], stands: [Joints; 2]) -> [Joints; 2] {
    moves.iter().fold(stands, |mut stands, (arm, _, to)| {
        stands[*arm] = *to;
        stands
    })
}

fn go(_: relight_capture::session::Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Walks the whole session, and checks each motion as it was ordered.
fn walked(prepared: &Prepared, stands: [Joints; 2]) -> Vec<(usize, Joints, Joints)> {
    let record = Record::default();
    let mut rig = rig(prepared, stands, None, &record).unwrap();
    let walked = walk(&mut rig, &shots(prepared), &mut go).unwrap();
    assert!(matches!(walked, Walk::Complete(_)));
    let moves = moves(&record);
    let mut both = stands;
    for (arm, from, to) in &moves {
        assert_eq!(both[*arm], *from, "a motion begins where the arm is");
        let mut next = both;
        next[*arm] = *to;
        prepared.itinerary.cell().check_motion(&both, &next).unwrap();
        both = next;
    }
    assert_eq!(both, homes(prepared));
    moves
}

#[test]
fn a_session_visits_everything_by_checked_motions_and_ends_at_home() {
    let prepared = prepared(4, 6);
    let moves = walked(&prepared, homes(&prepared));
    let itinerary = &prepared.itinerary;
    for (arm, count, visits) in [(CAMERA, 4, 1), (LIGHT, 6, 4)] {
        for label in 0..count {
            let there = itinerary.joints(arm, station(label));
            let arrivals = moves.iter().filter(|(moved, _, to)| (*moved, to) == (arm, there)).count();
            assert!(arrivals >= visits, "{arm} {label}: {arrivals}");
        }
    }
    // The tools are where the plan wants them, a lamp turned about its own axis at most.
    for label in 0..4 {
        let (there, planned) = (itinerary.pose(CAMERA, label), prepared.plan.camera.waypoints[label].pose);
        assert!(there.0.iter().flatten().zip(planned.0.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-5));
    }
    for label in 0..6 {
        let (there, planned) = (itinerary.pose(LIGHT, label), prepared.plan.light.waypoints[label].pose);
        for row in 0..3 {
            assert!((2..4).all(|column| (there.0[row][column] - planned.0[row][column]).abs() < 1e-5));
        }
    }
}

#[test]
fn a_fault_stops_both_arms_and_they_are_taken_up_from_where_they_stand() {
    let prepared = prepared(2, 3);
    let all = walked(&prepared, homes(&prepared)).len();
    for fails in 0..all {
        let record = Record::default();
        let mut broken = rig(&prepared, homes(&prepared), Some(fails), &record).unwrap();
        let fault = walk(&mut broken, &shots(&prepared), &mut go).unwrap_err().to_string();
        assert!(fault.contains("in protective stop"), "{fault}");
        let events = record.lock().unwrap().clone();
        assert_eq!(events[events.len() - 2..], [Event::Stopped(CAMERA), Event::Stopped(LIGHT)]);
        // Half-way through the motion that failed.
        let moves = moves(&record);
        let (arm, from, to) = moves[fails];
        assert_eq!(moves.len(), fails + 1, "nothing moves after a fault");
        let mut stands = after(&moves[..fails], homes(&prepared));
        stands[arm] = middle(&from, &to);
        walked(&prepared, stands);
    }
}

#[test]
fn an_arm_does_not_go_on_when_the_waiting_one_is_stopped() {
    let prepared = prepared(2, 3);
    let stands = homes(&prepared);
    // The first motion is the camera's.
    let cases = [
        (Some(0), None, "in emergency stop"),
        (None, Some(0), "has moved since it arrived: joint 3 is 0.0200"),
    ];
    for (pressed, pushed, says) in cases {
        let record = Record::default();
        let arms = [(CAMERA, None, None), (LIGHT, pressed, pushed)].map(|(which, pressed, pushed)| {
            let arm = DryRun::new(prepared.itinerary.arm(which).name.clone(), stands[which]);
            Recorded {
                which,
                arm,
                record: Arc::clone(&record),
                fails: None,
                pressed,
                pushed,
                interrupt: None,
            }
        });
        let fault =
            walk(&mut rig_of(&prepared, arms).unwrap(), &shots(&prepared), &mut go).unwrap_err().to_string();
        assert!(fault.contains("the light arm") && fault.contains(says), "{fault}");
        let events = record.lock().unwrap().clone();
        assert!(matches!(events[0], Event::Moved(CAMERA, ..)));
        assert_eq!(events[1..], [Event::Stopped(CAMERA), Event::Stopped(LIGHT)]);
    }
}

#[test]
fn arms_stop_in_the_midst_of_a_motion_when_they_are_told_to() {
    let prepared = prepared(2, 3);
    let stops = [Event::Stopped(CAMERA), Event::Stopped(LIGHT)];
    // In the midst of the light's motion, or before it.
    for is_moving in [true, false] {
        let (record, stop) = (Record::default(), Arc::new(AtomicBool::new(false)));
        let arms = [CAMERA, LIGHT].map(|which| {
            let arm = DryRun::new(prepared.itinerary.arm(which).name.clone(), homes(&prepared)[which]);
            let interrupt = (is_moving && which == LIGHT).then(|| Arc::clone(&stop));
            let record = Arc::clone(&record);
            Recorded { which, arm, record, fails: None, pressed: None, pushed: None, interrupt }
        });
        let mut rig = rig_of(&prepared, arms).unwrap().interruptible(&stop);
        rig.view(0).unwrap();
        let before = record.lock().unwrap().len();
        stop.store(!is_moving, Ordering::Relaxed);
        let fault = rig.light(1).unwrap_err().to_string();
        assert!(fault.contains("told to stop") && fault.contains("--resume"), "{fault}");
        let events = record.lock().unwrap()[before..].to_vec();
        assert_eq!(matches!(events[0], Event::Moved(LIGHT, ..)), is_moving);
        assert_eq!(events[usize::from(is_moving)..], stops);
    }
}

#[test]
fn arms_that_stand_where_nothing_was_planned_do_not_move() {
    let prepared = prepared(2, 3);
    let homes = homes(&prepared);
    for (arm, name) in [(CAMERA, "the camera arm stands"), (LIGHT, "the light arm stands")] {
        let mut stands = homes;
        stands[arm][1] += 0.2;
        let record = Record::default();
        let fault = rig(&prepared, stands, None, &record).map(|_| ()).unwrap_err();
        assert!(fault.contains(name) && fault.contains("home by hand"), "{fault}");
        assert!(record.lock().unwrap().is_empty());
    }
    // Nor does the camera while the light is not at home.
    let itinerary = &prepared.itinerary;
    let stands =
        [middle(&homes[CAMERA], itinerary.joints(CAMERA, station(0))), *itinerary.joints(LIGHT, station(0))];
    assert!(rig(&prepared, stands, None, &Record::default()).is_err());
}

/// What the camera saw.
struct Watcher(Arc<Mutex<Vec<Stance>>>);

impl Eye for Watcher {
    fn shoot(&mut self, stance: &Stance) -> Result<Frame, CameraError> {
        self.0.lock().unwrap().push(*stance);
        Ok(Frame::Developed(Image { width: 1, height: 1, data: vec![0; 3] }))
    }

    fn show(&mut self, _: Target) -> Result<(), RigFault> {
        Ok(())
    }
}

#[test]
fn simulated_arms_come_to_rest_where_it_was_foreseen() {
    let prepared = prepared(2, 3);
    let itinerary = &prepared.itinerary;
    let simulated = SimulatedArms::start(itinerary, &arms(), 5).unwrap();
    let connected = simulated.connect(itinerary, &arms()).unwrap();
    let [camera, light] = connected;
    let seen = Arc::default();
    let mut rig = ArmsRig::new(
        itinerary,
        prepared.labels.clone(),
        [camera, light],
        Box::new(Watcher(Arc::clone(&seen))),
        PACE,
    )
    .unwrap();
    for view in [1, 0] {
        rig.view(view).unwrap();
        for light in [2, 0, 1] {
            rig.light(light).unwrap();
            rig.shoot().unwrap();
        }
    }
    let seen: Vec<Stance> = seen.lock().unwrap().clone();
    assert_eq!(seen.len(), 6);
    for stance in seen {
        for (arm, label) in [(CAMERA, stance.view), (LIGHT, stance.light)] {
            let planned = itinerary.joints(arm, station(label));
            let foreseen = simulated.foresee(arm, planned);
            for ((measured, foreseen), planned) in stance.joints[arm].iter().zip(foreseen).zip(planned) {
                assert!((measured - foreseen).abs() < 1e-8, "{arm} {label}");
                assert!((1e-8..3e-4).contains(&(measured - planned).abs()), "{arm} {label}");
            }
        }
    }
}

/// Cameras and lights that would stand in each other's way.
#[test]
fn what_cannot_be_shot_together_is_left_out_with_its_reason() {
    let mut settings = PlanSettings::default();
    (settings.camera.waypoints, settings.light.waypoints) = (4, 12);
    settings.camera.colatitude_degrees = [20.0, 50.0];
    settings.camera.radius_metres = [0.4, 0.45];
    let prepared = Prepared::new(&settings, &arms()).unwrap();
    let plan = &prepared.plan;
    let reasons: Vec<&String> = plan
        .camera
        .waypoints
        .iter()
        .chain(&plan.light.waypoints)
        .filter_map(|w| w.unreachable.as_ref())
        .collect();
    assert!(reasons.iter().any(|reason| reason.contains("cannot be shot together")), "{reasons:?}");
    // What is left is shot, counted without gaps.
    let shots = shots(&prepared);
    let left = [&plan.camera, &plan.light].map(|trajectory| trajectory.order.len());
    assert_eq!([shots.cameras.len(), shots.lights.len()], left);
    let mut numbers = shots.light_order.clone();
    numbers.sort_unstable();
    assert_eq!(numbers, (0..left[LIGHT]).collect::<Vec<_>>());
    walked(&prepared, homes(&prepared));
}
