//! `relight capture run` with arms: real ones, or simulated ones.

use std::ops::ControlFlow;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail, ensure};
use relight_capture::calibration::{Calibration, load};
use relight_capture::kinematics::{ArmsSettings, Joints};
use relight_capture::rig::{
    Arms, ArmsRig, CAMERA, Eye, HOME, LIGHT, NoEye, Pace, Photographs, Prepared, SetupError, SimulatedArms,
    Travel, Walk, connect, station, walk,
};
use relight_capture::robot::DryRun;
use relight_capture::session::{self, Ending, Shots};
use relight_scene::{Intrinsics, Pose};

use super::run::{Job, developed, headline, real_eye, time};
use crate::console::{print_line, stop_flag};

/// How far a calibration of the virtual rig may have points from where its lens has them, in widths of a picture.
const MOST_APART: f64 = 7e-3;

pub fn run(job: &Job, quiet: bool) -> anyhow::Result<()> {
    let arms = job.file.arms.clone().with_context(|| {
        format!(
            "{}: has no arms; add a table [arms], or move camera and lamp yourself (--skip-robots)",
            job.args.rig
        )
    })?;
    let is_virtual = matches!(job.file.photographs, Some(Photographs::Virtual { .. }));
    let is_raw = matches!(job.file.photographs, Some(Photographs::Virtual { raw: true }));
    if is_virtual {
        // What is wrong with the object is told before anything is planned.
        job.virtual_capture.rehearse()?;
    }
    let calibration = job.args.calibration.as_deref().map(load).transpose()?;
    let prepared = Prepared::new(&job.file.plan_settings(), &arms).context(job.args.rig.clone())?;
    let session = Session { job, arms, prepared, is_virtual, is_raw };
    if job.args.dry_run {
        return session.rehearse();
    }
    session.warn_of_unreached();
    session.run(calibration, quiet)
}

struct Session<'a> {
    job: &'a Job<'a>,
    arms: ArmsSettings,
    prepared: Prepared,
    /// Whether the path tracer takes the photographs, and raw ones.
    is_virtual: bool,
    is_raw: bool,
}

impl Session<'_> {
    fn run(&self, calibration: Option<(Calibration, u64)>, quiet: bool) -> anyhow::Result<()> {
        let job = self.job;
        let simulated = self
            .is_simulated()
            .then(|| SimulatedArms::start(&self.prepared.itinerary, &self.arms, job.args.seed))
            .transpose()?;
        let foreseen = simulated.as_ref().map(|simulated| self.foreseen(simulated));
        if let Some((_, made)) = &calibration
            && !quiet
        {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
            eprintln!("calibrated {} ago", time(now.saturating_sub(*made) as f64));
        }
        let shots = self.shots(calibration.map(|(calibration, _)| calibration), foreseen.as_ref())?;
        // Cameras are opened before arms are spoken to.
        let eye = self.eye(foreseen)?;
        let connected = self.connect(simulated.as_ref())?;
        let mut rig = self.rig(connected, eye)?;
        let standing = "; the arms stand where they are";
        if job.args.skip_camera {
            let counts = [shots.view_order.len(), shots.light_order.len()];
            let walked = job.follow(counts, quiet, &mut |progress| Ok(walk(&mut rig, &shots, progress)?))?;
            ensure!(walked != Walk::Stopped, "stopped{standing}");
            return print_line(&format!("all waypoints were visited: {}", told(&rig.travel())));
        }
        let mut subject = if self.is_virtual { job.virtual_capture.subject()? } else { job.subject(&shots) };
        if self.is_raw {
            subject.insert(session::CAMERA.to_owned(), "virtual, raw".into());
            subject.extend(developed(&shots));
        }
        let ending = job.shoot(&mut rig, &shots, &subject, quiet)?;
        if matches!(ending, Ending::Complete { .. }) {
            rig.park()?;
        }
        job.told(ending, [shots.cameras.len(), shots.lights.len()], standing)
    }

    /// Where simulated arms will come to rest, by the session's numbers.
    fn foreseen(&self, simulated: &SimulatedArms) -> [Vec<Joints>; 2] {
        [CAMERA, LIGHT].map(|arm| {
            let joints =
                |&label: &usize| simulated.foresee(arm, self.prepared.itinerary.joints(arm, station(label)));
            self.prepared.labels[arm].iter().map(joints).collect()
        })
    }

    fn shots(
        &self,
        calibration: Option<Calibration>,
        foreseen: Option<&[Vec<Joints>; 2]>,
    ) -> anyhow::Result<Shots> {
        let (file, prepared) = (&self.job.file, &self.prepared);
        let planned = |arm: usize, label: usize| prepared.itinerary.pose(arm, label);
        if self.job.args.skip_camera {
            return Ok(prepared.shots(file, self.job.virtual_capture.lens(), planned));
        }
        let Some(calibration) = calibration else {
            let lens = self.uncalibrated_lens()?;
            // Only the virtual rig knows better than its plan.
            return Ok(prepared.shots(file, lens, |arm, label| match foreseen {
                Some(foreseen) => {
                    let number = prepared.labels[arm].binary_search(&label).unwrap_or_default();
                    prepared.itinerary.arm(arm).tool_pose(&foreseen[arm][number])
                }
                None => planned(arm, label),
            }));
        };
        let poses: Box<dyn Fn(usize, usize) -> Pose> = Box::new(prepared.calibrated(&calibration)?);
        for waypoint in calibration.waypoints.iter().filter(|waypoint| waypoint.is_bad) {
            tracing::warn!("camera waypoint {} is badly calibrated; calibrate it again", waypoint.label);
        }
        if calibration.light.is_none() {
            tracing::warn!("the light's arm is not registered: it is taken to stand where the rig file says");
        }
        Ok(prepared.shots(file, self.calibrated_lens(&calibration.intrinsics)?, poses))
    }

    /// The size of a real camera's photographs.
    fn size(&self) -> Option<[u32; 2]> {
        self.job.file.photographs.as_ref().and_then(Photographs::size)
    }

    fn uncalibrated_lens(&self) -> anyhow::Result<Intrinsics> {
        match self.size() {
            Some(size) => self.job.rough_lens(size),
            None => Ok(self.job.virtual_capture.lens()),
        }
    }

    fn calibrated_lens(&self, lens: &Intrinsics) -> anyhow::Result<Intrinsics> {
        let Some([width, height]) = self.size() else {
            let capture = &self.job.virtual_capture;
            let (found, truth) =
                (lens.resized(capture.width, capture.height), self.job.virtual_capture.lens());
            let apart = farthest_apart(&found, &truth);
            if apart > MOST_APART * f64::from(capture.width) {
                tracing::warn!(
                    "the calibration is of another lens than the virtual rig's: points of a picture are up to {apart:.1} px \
                     apart. Shoot its board without --distortion"
                );
            }
            return Ok(found);
        };
        ensure!(
            (lens.width, lens.height) == (width, height),
            "the calibration is of {}x{} pixels, and photographs have {width}x{height}; calibrate with photographs of \
             that size",
            lens.width,
            lens.height
        );
        Ok(lens.clone())
    }

    fn eye(&self, foreseen: Option<[Vec<Joints>; 2]>) -> anyhow::Result<Box<dyn Eye>> {
        if self.job.args.skip_camera {
            return Ok(Box::new(NoEye));
        }
        if self.is_virtual {
            let arms = self.prepared.itinerary.cell().arms().clone();
            let eye = self.job.virtual_capture.eye(arms, foreseen.unwrap_or_default())?;
            return Ok(Box::new(if self.is_raw { eye.raw() } else { eye }));
        }
        real_eye(&self.job.file, &self.job.args.rig)
    }

    fn connect(&self, simulated: Option<&SimulatedArms>) -> anyhow::Result<Arms> {
        let itinerary = &self.prepared.itinerary;
        match (simulated, &self.job.file.controllers) {
            (Some(simulated), _) => Ok(simulated.connect(itinerary, &self.arms)?),
            (None, Some(controllers)) => Ok(connect(itinerary, &self.arms, controllers)?),
            (None, None) => {
                bail!("{}: nobody knows where the arms listen; add a table [controllers]", self.job.args.rig)
            }
        }
    }

    fn rig<'b>(&'b self, arms: Arms, eye: Box<dyn Eye + 'b>) -> anyhow::Result<ArmsRig<'b>> {
        let [camera, light] = arms;
        let labels = self.prepared.labels.clone();
        let rig = ArmsRig::new(&self.prepared.itinerary, labels, [camera, light], eye, self.pace());
        Ok(rig.map_err(SetupError::from)?.interruptible(stop_flag()))
    }

    /// Whether the arms are simulated in this process.
    fn is_simulated(&self) -> bool {
        self.is_virtual && self.job.file.controllers.is_none()
    }

    /// How the arms move; nothing swings on where nothing is.
    fn pace(&self) -> Pace {
        let pace = self.job.file.pace();
        if self.is_simulated() { Pace { settle: Duration::ZERO, ..pace } } else { pace }
    }

    /// Goes through the whole session with arms that do not exist.
    fn rehearse(&self) -> anyhow::Result<()> {
        let itinerary = &self.prepared.itinerary;
        let arms = [CAMERA, LIGHT].map(|arm| {
            let name = &itinerary.arm(arm).name;
            Box::new(DryRun::new(name, *itinerary.joints(arm, HOME))) as Box<dyn relight_capture::robot::Arm>
        });
        let lens = self.job.virtual_capture.lens();
        let shots =
            self.prepared.shots(&self.job.file, lens.clone(), |arm, label| itinerary.pose(arm, label));
        let mut rig = self.rig(arms, Box::new(NoEye))?;
        let walked = walk(&mut rig, &shots, &mut |_| ControlFlow::Continue(()))?;
        let size = self.size().unwrap_or([lens.width, lens.height]);
        print_line(&headline(shots.view_order.len(), shots.light_order.len(), size))?;
        for line in self.prepared.left_out() {
            print_line(&line)?;
        }
        let Walk::Complete(travels) = walked else { return Ok(()) };
        for (view, travel) in shots.view_order.iter().zip(&travels) {
            print_line(&format!("view {view:>3}: {}", told(travel)))?;
        }
        print_line(&format!("in all, and home: {}, before photographs", told(&rig.travel())))
    }

    fn warn_of_unreached(&self) {
        for line in self.prepared.left_out() {
            tracing::warn!("{line}; the scene's views and lights are counted without it");
        }
    }
}

/// How far two lenses at most have the corners and sides of a picture apart, pixels.
fn farthest_apart(a: &Intrinsics, b: &Intrinsics) -> f64 {
    let places = |side: u32| [0.0, 0.5, 1.0].map(|part| part * f64::from(side));
    let points = places(a.width).into_iter().flat_map(|x| places(a.height).map(|y| [x, y]));
    let apart = |[x, y]: [f64; 2]| {
        let seen = [(x - b.cx) / b.fx, (y - b.cy) / b.fy, 1.0];
        let [here, there] = [a, b].map(|lens| lens.project(seen));
        here.zip(there).map_or(f64::INFINITY, |(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]))
    };
    points.map(apart).fold(0.0, f64::max)
}

fn told(travel: &Travel) -> String {
    let [camera, light] = travel.motions;
    format!(
        "{camera} motions of the camera arm, {light} of the light arm, {}",
        time(travel.time.as_secs_f64())
    )
}
