//! Going along a motion, whatever the make: order it, watch until the arm rests at its end, stop it if anything is wrong.

use std::time::{Duration, Instant};

use super::arm::{Arm, ArmState, ArmStatus, Joints, largest_difference};
use super::error::ArmError;
use super::feed::Feed;
use super::link::TimeLimits;
use super::planned_motion::PlannedMotion;

/// An arm that rests this near the end has arrived, radians.
const ARRIVED: f64 = 1e-3;
/// An arm that moves less than this is still, radians.
const STILL: f64 = 2e-4;
/// A motion must begin within this, or within the time that a reply may take.
const BEGIN: Duration = Duration::from_secs(3);
/// A motion may take so much longer than twice its time.
const SLACK: Duration = Duration::from_secs(5);
/// A stop must be over within this.
const STOP: Duration = Duration::from_secs(3);

/// What every driver has.
#[derive(Debug)]
pub(super) struct Watch {
    /// Where errors say that they come from.
    pub address: String,
    pub limits: TimeLimits,
    /// States as they come. They may not know about remote control.
    pub feed: Feed,
}

/// What differs from make to make.
pub(super) trait Controller: Send {
    fn watched(&self) -> &Watch;
    /// The state now, remote control included.
    fn state_now(&mut self) -> Result<ArmState, ArmError>;
    /// Orders a motion.
    fn begin(&mut self, motion: &PlannedMotion) -> Result<(), ArmError>;
    /// Called between states while the arm moves, for what the feed does not tell.
    fn watch(&mut self) -> Result<(), ArmError>;
    /// Orders a stop by every way there is.
    fn order_stop(&mut self) -> Result<(), ArmError>;
}

impl<C: Controller> Arm for C {
    fn state(&mut self) -> Result<ArmState, ArmError> {
        self.state_now()
    }

    fn move_while(
        &mut self,
        motion: &PlannedMotion,
        go_on: &mut dyn FnMut() -> Result<(), ArmError>,
    ) -> Result<ArmState, ArmError> {
        let state = self.state_now()?;
        if state.status != ArmStatus::Idle {
            return Err(stopped(self, state.status));
        }
        motion.check_start(&self.watched().address, &state.joints)?;
        let arrived = self.begin(motion).and_then(|()| arrive(self, motion, &state.joints, go_on));
        arrived.map_err(|cause| match stop(self) {
            Ok(()) => cause,
            Err(stop) => ArmError::NotStopped { cause: Box::new(cause), stop: Box::new(stop) },
        })
    }

    fn stop(&mut self) -> Result<(), ArmError> {
        stop(self)
    }
}

impl Watch {
    pub fn newest(&self) -> Result<(u64, ArmState), ArmError> {
        self.feed.newest(self.limits.silence)
    }

    fn after(&self, count: u64) -> Result<(u64, ArmState), ArmError> {
        self.feed.after(count, self.limits.silence)
    }
}

fn stop(arm: &mut impl Controller) -> Result<(), ArmError> {
    let ordered = arm.order_stop();
    // Whoever does not take the order may stand all the same: stopped by its own safety, or by hand.
    rest(arm).map_err(|unseen| ordered.err().unwrap_or(unseen))
}

fn stopped(arm: &impl Controller, status: ArmStatus) -> ArmError {
    ArmError::Stopped { address: arm.watched().address.clone(), status }
}

fn late(arm: &impl Controller, awaited: &'static str, limit: Duration) -> ArmError {
    ArmError::TimedOut { address: arm.watched().address.clone(), awaited, seconds: limit.as_secs_f64() }
}

/// Since when the joints have not moved.
struct Stillness {
    since: Instant,
    joints: Joints,
}

impl Stillness {
    fn new(joints: Joints) -> Self {
        Self { since: Instant::now(), joints }
    }

    fn update(&mut self, joints: &Joints) -> Duration {
        if largest_difference(&self.joints, joints).1 > STILL {
            *self = Self::new(*joints);
        }
        self.since.elapsed()
    }
}

/// `start` is where the arm stood before the order.
fn arrive(
    arm: &mut impl Controller,
    motion: &PlannedMotion,
    start: &Joints,
    go_on: &mut dyn FnMut() -> Result<(), ArmError>,
) -> Result<ArmState, ArmError> {
    let begun = Instant::now();
    // The controller may choose to be slower than asked, not much.
    let limit = motion.duration().saturating_mul(2).saturating_add(SLACK.max(arm.watched().limits.reply));
    let (rest, rest_unseen) = (arm.watched().limits.rest, arm.watched().limits.rest.saturating_mul(3));
    let (mut count, state) = arm.watched().newest()?;
    let mut stillness = Stillness::new(state.joints);
    let mut has_moved = false;
    loop {
        arm.watch()?;
        go_on()?;
        let (newer, state) = arm.watched().after(count)?;
        count = newer;
        let still = stillness.update(&state.joints);
        let (joint, difference) = largest_difference(&state.joints, motion.to());
        // A short motion may be over before it is seen.
        has_moved |= largest_difference(&state.joints, start).1 > ARRIVED;
        match state.status {
            ArmStatus::Running => has_moved = true,
            ArmStatus::Idle if difference <= ARRIVED => {
                if still >= if has_moved { rest } else { rest_unseen } {
                    return Ok(state);
                }
            }
            ArmStatus::Idle if has_moved => {
                if still >= rest_unseen {
                    return Err(ArmError::NotAtEnd {
                        address: arm.watched().address.clone(),
                        joint,
                        difference,
                    });
                }
            }
            ArmStatus::Idle => {
                let begin = BEGIN.max(arm.watched().limits.reply);
                if begun.elapsed() > begin {
                    return Err(late(arm, "beginning of the motion", begin));
                }
            }
            status => return Err(stopped(arm, status)),
        }
        if begun.elapsed() > limit {
            return Err(late(arm, "end of the motion", limit));
        }
    }
}

/// Waits until the arm neither moves nor is about to.
fn rest(arm: &impl Controller) -> Result<(), ArmError> {
    let ordered = Instant::now();
    let (mut count, state) = arm.watched().newest()?;
    let mut stillness = Stillness::new(state.joints);
    loop {
        let (newer, state) = arm.watched().after(count)?;
        count = newer;
        let still = stillness.update(&state.joints);
        if still >= arm.watched().limits.rest
            && !matches!(state.status, ArmStatus::Running | ArmStatus::Paused)
        {
            return Ok(());
        }
        if ordered.elapsed() > STOP {
            return Err(late(arm, "standstill", STOP));
        }
    }
}
