//! The arm behind a simulated controller: programs, motions, stops.

use std::collections::VecDeque;
use std::time::Instant;

use super::super::arm::{Joints, largest_difference};
use super::super::trapezoid::Trapezoid;
use super::fault::{Fault, FaultKind};
use super::{Repeatability, SimulatedModel, SimulationSettings};

/// Most steps of a program.
const LONGEST_PROGRAM: usize = 1000;

/// A step of a program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    /// Go to `target` (rad), the leading joint at most at `speed` (rad/s) and `acceleration` (rad/s^2).
    Move { target: Joints, speed: f64, acceleration: f64 },
    /// Wait, seconds.
    Wait(f64),
}

/// Why an arm takes no program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    NotRemote,
    /// Stopped, or its servos are off.
    NotReady,
    /// A target out of reach, a speed that is none, a program too long.
    Bad,
}

/// What safety says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Health {
    Well,
    ProtectiveStop,
    EmergencyStop,
    Error,
}

/// The arm at one moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Snapshot {
    /// Simulated seconds since the start.
    pub time: f64,
    pub joints: Joints,
    /// Rad/s.
    pub speeds: Joints,
    pub is_running: bool,
    pub is_paused: bool,
    pub is_remote: bool,
    pub health: Health,
    pub model: &'static SimulatedModel,
}

/// A step under way.
#[derive(Clone, Copy, Debug)]
struct Underway {
    from: Joints,
    /// Where it really ends.
    to: Joints,
    began: f64,
    pace: Pace,
    /// When a fault comes, in seconds of this step.
    trips: Option<(f64, FaultKind)>,
}

#[derive(Clone, Copy, Debug)]
enum Pace {
    Moving(Trapezoid),
    Waiting(f64),
    /// Slowing down evenly over so many seconds.
    Stopping(f64),
}

impl Underway {
    fn duration(&self) -> f64 {
        match self.pace {
            Pace::Moving(profile) => profile.duration(),
            Pace::Waiting(seconds) | Pace::Stopping(seconds) => seconds,
        }
    }

    fn at(&self, time: f64) -> (Joints, Joints) {
        let seconds = time - self.began;
        let (part, rate) = match self.pace {
            Pace::Moving(profile) => profile.at(seconds),
            Pace::Waiting(_) => (1.0, 0.0),
            Pace::Stopping(duration) => {
                let left = (1.0 - seconds / duration).clamp(0.0, 1.0);
                (1.0 - left * left, 2.0 * left / duration)
            }
        };
        let between = |i: usize| self.to[i] - self.from[i];
        (
            std::array::from_fn(|i| self.from[i] + part * between(i)),
            std::array::from_fn(|i| rate * between(i)),
        )
    }
}

#[derive(Debug)]
pub(super) struct SimulatedArm {
    model: &'static SimulatedModel,
    repeatability: Repeatability,
    faults: Vec<Fault>,
    started: Instant,
    time_scale: f64,
    /// Where it rests between steps.
    joints: Joints,
    underway: Option<Underway>,
    program: VecDeque<Step>,
    /// Motions begun so far.
    motions: u64,
    health: Health,
    is_remote: bool,
    is_paused: bool,
}

impl SimulatedArm {
    pub fn new(model: &'static SimulatedModel, settings: &SimulationSettings) -> Self {
        Self {
            model,
            repeatability: Repeatability::of(settings.noise_of, settings.seed),
            faults: settings.faults.clone(),
            started: Instant::now(),
            time_scale: settings.time_scale,
            joints: settings.joints.unwrap_or(model.home),
            underway: None,
            program: VecDeque::new(),
            motions: 0,
            health: Health::Well,
            is_remote: true,
            is_paused: false,
        }
    }

    fn now(&self) -> f64 {
        self.started.elapsed().as_secs_f64() * self.time_scale
    }

    /// The arm now.
    pub fn snapshot(&mut self) -> Snapshot {
        self.snapshot_at(self.now())
    }

    /// Replaces the program by `steps`.
    pub fn run(&mut self, steps: Vec<Step>) -> Result<(), Refusal> {
        self.run_at(self.now(), steps)
    }

    /// Ends the program and slows down at `deceleration` (rad/s^2).
    pub fn halt(&mut self, deceleration: f64) {
        self.halt_at(self.now(), deceleration);
    }

    /// Stops in the middle of a motion that `resume` goes on with.
    pub fn pause(&mut self) {
        let now = self.now();
        self.advance(now);
        if let Some(underway) = self.underway
            && let Pace::Moving(_) = underway.pace
            && !self.is_paused
        {
            let rest = Step::Move {
                target: underway.to,
                speed: self.model.full_speed,
                acceleration: self.model.acceleration,
            };
            let program = std::mem::take(&mut self.program);
            self.halt_at(now, self.model.acceleration);
            self.program = program;
            self.program.push_front(rest);
            self.is_paused = true;
        }
    }

    /// Goes on after a pause.
    pub fn resume(&mut self) -> Result<(), Refusal> {
        self.check_ready()?;
        let now = self.now();
        self.advance(now);
        self.is_paused = false;
        self.advance(now);
        Ok(())
    }

    /// Releases a protective stop or clears an error. An emergency stop stays: its button is real.
    pub fn release(&mut self) -> bool {
        self.advance(self.now());
        if self.health != Health::EmergencyStop {
            self.health = Health::Well;
        }
        self.health == Health::Well
    }

    fn check_ready(&self) -> Result<(), Refusal> {
        if !self.is_remote {
            return Err(Refusal::NotRemote);
        }
        if self.health == Health::Well { Ok(()) } else { Err(Refusal::NotReady) }
    }

    fn snapshot_at(&mut self, now: f64) -> Snapshot {
        self.advance(now);
        let (joints, speeds) = self.underway.map_or((self.joints, [0.0; 6]), |underway| underway.at(now));
        Snapshot {
            time: now,
            joints,
            speeds,
            is_running: self.underway.is_some() || (!self.program.is_empty() && !self.is_paused),
            is_paused: self.is_paused && self.underway.is_none(),
            is_remote: self.is_remote,
            health: self.health,
            model: self.model,
        }
    }

    fn run_at(&mut self, now: f64, steps: Vec<Step>) -> Result<(), Refusal> {
        self.advance(now);
        self.check_ready()?;
        let is_positive = |v: f64| v.is_finite() && v > 0.0;
        let is_good = |step: &Step| match step {
            Step::Move { target, speed, acceleration } => {
                let reaches = target.iter().zip(&self.model.reach).all(|(q, most)| q.abs() <= *most);
                reaches && is_positive(*speed) && is_positive(*acceleration)
            }
            Step::Wait(seconds) => seconds.is_finite() && *seconds >= 0.0,
        };
        if steps.len() > LONGEST_PROGRAM || !steps.iter().all(is_good) {
            return Err(Refusal::Bad);
        }
        self.joints = self.underway.map_or(self.joints, |underway| underway.at(now).0);
        self.underway = None;
        self.is_paused = false;
        self.program = steps.into();
        self.begin(now);
        self.advance(now);
        Ok(())
    }

    fn halt_at(&mut self, now: f64, deceleration: f64) {
        self.advance(now);
        self.program.clear();
        self.is_paused = false;
        let Some(underway) = self.underway.take() else { return };
        let (joints, speeds) = underway.at(now);
        let (_, fastest) = largest_difference(&speeds, &[0.0; 6]);
        self.joints = joints;
        if fastest > 0.0 && deceleration > 0.0 {
            let duration = fastest / deceleration;
            let to = std::array::from_fn(|i| joints[i] + 0.5 * duration * speeds[i]);
            let pace = Pace::Stopping(duration);
            self.underway = Some(Underway { from: joints, to, began: now, pace, trips: None });
        }
    }

    /// Lets everything happen that happens until `now`.
    fn advance(&mut self, now: f64) {
        while let Some(underway) = self.underway {
            if let Some((seconds, kind)) = underway.trips
                && now >= underway.began + seconds
            {
                self.joints = underway.at(underway.began + seconds).0;
                self.underway = None;
                self.program.clear();
                match kind {
                    FaultKind::ProtectiveStop => self.health = Health::ProtectiveStop,
                    FaultKind::EmergencyStop => self.health = Health::EmergencyStop,
                    FaultKind::LeaveRemote => self.is_remote = false,
                    _ => self.health = Health::Error,
                }
                return;
            }
            let end = underway.began + underway.duration();
            if now < end {
                return;
            }
            self.joints = underway.to;
            self.underway = None;
            self.begin(end);
        }
        if !self.is_paused {
            self.begin(now);
            if self.underway.is_some_and(|underway| underway.duration() <= 0.0) {
                self.advance(now);
            }
        }
    }

    /// Begins the next step of the program, if there is one.
    fn begin(&mut self, began: f64) {
        if self.underway.is_some() || self.is_paused {
            return;
        }
        let Some(step) = self.program.pop_front() else { return };
        let from = self.joints;
        self.underway = Some(match step {
            Step::Wait(seconds) => {
                Underway { from, to: from, began, pace: Pace::Waiting(seconds), trips: None }
            }
            Step::Move { target, speed, acceleration } => {
                self.motions += 1;
                let to = self.repeatability.reached(self.motions, &target);
                let (_, distance) = largest_difference(&from, &to);
                let profile = Trapezoid::new(distance, speed.min(self.model.full_speed), acceleration);
                let due = |fault: &&Fault| !fault.kind.counts_messages() && fault.at == self.motions;
                let trips = self.faults.iter().find(due).map(|fault| (0.5 * profile.duration(), fault.kind));
                Underway { from, to, began, pace: Pace::Moving(profile), trips }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm(faults: &[&str]) -> SimulatedArm {
        let faults = faults.iter().map(|fault| fault.parse().unwrap()).collect();
        let settings = SimulationSettings { joints: Some([0.0; 6]), faults, ..SimulationSettings::default() };
        SimulatedArm::new(&SimulatedModel::UR5E, &settings)
    }

    fn step(target: f64) -> Step {
        Step::Move { target: [target; 6], speed: 1.0, acceleration: 2.0 }
    }

    #[test]
    fn a_program_goes_on_step_by_step() {
        let mut arm = arm(&[]);
        arm.run_at(1.0, vec![step(1.0), Step::Wait(2.0), step(2.0)]).unwrap();
        let at = |arm: &mut SimulatedArm, time| {
            let snapshot = arm.snapshot_at(time);
            (snapshot.joints[3], snapshot.speeds[3], snapshot.is_running)
        };
        let near = |seen: (f64, f64, bool), joint: f64, speed: f64| {
            assert!((seen.0 - joint).abs() < 1e-3 && (seen.1 - speed).abs() < 1e-3 && seen.2, "{seen:?}");
        };
        // Half a second of ramp, a quarter of a radian; then one second for a radian in all, wait, the same again.
        near(at(&mut arm, 1.5), 0.25, 1.0);
        near(at(&mut arm, 2.0), 0.75, 1.0);
        near(at(&mut arm, 3.0), 1.0, 0.0);
        near(at(&mut arm, 5.0), 1.25, 1.0);
        let end = arm.snapshot_at(6.1);
        assert!(!end.is_running && (end.joints[0] - 2.0).abs() < 1e-3);
        assert_eq!(end.joints, Repeatability::new(0).reached(2, &[2.0; 6]));
    }

    #[test]
    fn a_late_look_sees_the_same_as_many() {
        let steps = || vec![step(1.0), Step::Wait(0.0), step(1.0), step(-0.5), Step::Wait(0.3), step(0.2)];
        let (mut often, mut once) = (arm(&["protective-stop@4"]), arm(&["protective-stop@4"]));
        often.run_at(0.0, steps()).unwrap();
        once.run_at(0.0, steps()).unwrap();
        for i in 0..1000 {
            often.snapshot_at(f64::from(i) * 0.01);
        }
        let (a, b) = (often.snapshot_at(10.0), once.snapshot_at(10.0));
        assert!(largest_difference(&a.joints, &b.joints).1 < 1e-12);
        assert_eq!((a.health, b.health), (Health::ProtectiveStop, Health::ProtectiveStop));
    }

    #[test]
    fn a_stop_slows_down_and_ends_the_program() {
        let mut arm = arm(&[]);
        arm.run_at(0.0, vec![step(3.0), step(0.0)]).unwrap();
        arm.halt_at(1.0, 2.0);
        // 0.75 rad were behind, at 1 rad/s; half a second more.
        let halfway = arm.snapshot_at(1.25);
        assert!(halfway.is_running && (halfway.speeds[0] - 0.5).abs() < 1e-3);
        let end = arm.snapshot_at(1.6);
        assert!(!end.is_running && (end.joints[0] - 1.0).abs() < 1e-3, "{:?}", end.joints);
    }

    #[test]
    fn faults_come_half_way_and_hold_the_arm() {
        for (name, health, is_remote) in [
            ("protective-stop@2", Health::ProtectiveStop, true),
            ("emergency-stop@2", Health::EmergencyStop, true),
            ("error@2", Health::Error, true),
            ("leave-remote@2", Health::Well, false),
        ] {
            let mut arm = arm(&[name]);
            arm.run_at(0.0, vec![step(1.0), step(2.0)]).unwrap();
            let before = arm.snapshot_at(2.2);
            assert!(before.is_running && before.health == Health::Well && before.is_remote, "{name}");
            let after = arm.snapshot_at(9.0);
            assert!((after.joints[0] - 1.5).abs() < 1e-3 && !after.is_running, "{name}");
            assert_eq!((after.health, after.is_remote), (health, is_remote), "{name}");
            assert!(arm.run_at(9.0, vec![step(0.0)]).is_err(), "{name}");
            assert_eq!(arm.release(), health != Health::EmergencyStop, "{name}");
        }
    }

    #[test]
    fn programs_that_no_arm_can_follow_are_refused() {
        let mut arm = arm(&[]);
        let bad = |target, speed, acceleration| Step::Move { target, speed, acceleration };
        for step in [
            bad([7.0; 6], 1.0, 1.0),
            bad([f64::NAN; 6], 1.0, 1.0),
            bad([1.0; 6], 0.0, 1.0),
            bad([1.0; 6], 1.0, f64::INFINITY),
            Step::Wait(-1.0),
        ] {
            assert_eq!(arm.run_at(0.0, vec![step]), Err(Refusal::Bad), "{step:?}");
        }
        assert_eq!(arm.run_at(0.0, vec![Step::Wait(0.0); LONGEST_PROGRAM + 1]), Err(Refusal::Bad));
        assert_eq!(arm.snapshot_at(1.0).joints, [0.0; 6]);
    }
}
