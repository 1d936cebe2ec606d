//! A whole capture on the virtual rig, as the paper's rig would have made it.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use relight_scene::{Camera, Intrinsics, Light, Pose};

use super::objects::named;
use super::{CaptureRig, Lamp, Model, RigError, Sensor, Settings, Stage, VirtualEye, VirtualRig, read_model};
use crate::camera::Development;
use crate::kinematics::{Arm, ArmPlace, ArmsSettings, Joints, Make};
use crate::session::{self, Ending, Progress, SessionError, Shots, Subject};
use crate::trajectory::{Plan, PlanError, PlanSettings, Waypoint};

/// The real rig's camera: a Basler acA1440-73gc with an 8 mm lens, as the dataset's `camera.yml` has it.
pub(super) const LENS: Intrinsics = Intrinsics {
    width: 1440,
    height: 1080,
    fx: 2321.0,
    fy: 2388.0,
    cx: 868.0,
    cy: 454.0,
    distortion: Vec::new(),
};
/// Where its wedge of 57 degrees lies on the virtual stage: both walls are seen.
const AZIMUTH_DEGREES: [f64; 2] = [-73.5, -16.5];
/// The paper's arms, from where they reach all its cameras and lights: the camera's before the open corner of the stage, the
/// light's on a bracket over the corner of the walls, above both.
const CAMERA_ARM: ArmPlace =
    ArmPlace { model: Make::Ec66, base_metres: [0.707, -0.707, 0.0], yaw_degrees: 45.0, home_degrees: None };
const LIGHT_ARM: ArmPlace =
    ArmPlace { model: Make::Ur5e, base_metres: [-0.40, 0.38, 0.35], yaw_degrees: 135.0, home_degrees: None };

/// What is captured, and how finely. All numbers together make the capture what it is: equal ones, equal bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VirtualCapture {
    /// A built-in object's name, or a mesh's file (with an extension).
    pub object: String,
    /// Cameras.
    pub views: usize,
    /// Lights.
    pub lights: usize,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Camera rays a pixel.
    pub samples: u32,
    /// Seed of paths and of the sensor's noise.
    pub seed: u64,
}

/// Why there is no capture.
#[derive(Debug, thiserror::Error)]
pub enum VirtualCaptureError {
    /// The object or the rig cannot be.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The waypoints cannot be.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The session ended early.
    #[error(transparent)]
    Session(#[from] SessionError),
}

impl VirtualCapture {
    /// Looks whether all is there that [`shoot`](VirtualCapture::shoot) needs, and says what it would do.
    ///
    /// # Errors
    /// As [`shoot`](VirtualCapture::shoot), but for those of the session.
    pub fn rehearse(&self) -> Result<Plan, VirtualCaptureError> {
        let plan = self.plan()?;
        self.tracer(&self.model()?)?;
        Ok(plan)
    }

    /// Where cameras and lights stand: on the domes of the paper's rig.
    pub fn plan_settings(&self) -> PlanSettings {
        let mut settings = VirtualCapture::domes();
        settings.camera.waypoints = self.views;
        settings.light.waypoints = self.lights;
        settings
    }

    /// The domes of the paper's rig about the virtual stage, with all their waypoints.
    pub fn domes() -> PlanSettings {
        let mut settings = PlanSettings::default();
        settings.camera.azimuth_degrees = AZIMUTH_DEGREES;
        settings
    }

    fn plan(&self) -> Result<Plan, PlanError> {
        Plan::new(&self.plan_settings())
    }

    /// Where the arms stand that carry camera and lamp.
    pub fn arms() -> ArmsSettings {
        ArmsSettings {
            camera: CAMERA_ARM,
            light: LIGHT_ARM,
            table_metres: 0.0,
            walls: Stage::default().walls().to_vec(),
            clearance_metres: 0.01,
        }
    }

    /// The lens.
    pub fn lens(&self) -> Intrinsics {
        LENS.resized(self.width, self.height)
    }

    /// A camera on the first of two arms, a lamp on the second, before the object, as [`VirtualEye::new`] has it.
    ///
    /// # Errors
    /// If the object or the rig cannot be.
    pub fn eye(&self, arms: [Arm; 2], foreseen: [Vec<Joints>; 2]) -> Result<VirtualEye, VirtualCaptureError> {
        Ok(VirtualEye::new(self.tracer(&self.model()?)?, self.lens(), arms, foreseen))
    }

    /// Captures into the folder `out`, as [`session::capture`] does.
    ///
    /// # Errors
    /// [`VirtualCaptureError`]; what is shot by then is kept.
    pub fn shoot(
        &self,
        out: &Path,
        resume: bool,
        progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Ending, VirtualCaptureError> {
        let (subject, model) = (self.subject()?, self.model()?);
        let shots = self.shots(&self.plan()?);
        let mut rig = self.rig(&model, &shots)?;
        Ok(session::capture(&mut rig, &shots, &subject, out, resume, progress)?)
    }

    fn is_file(&self) -> bool {
        Path::new(&self.object).extension().is_some()
    }

    /// The object on its stage.
    fn model(&self) -> Result<Model, RigError> {
        let object = if self.is_file() { read_model(Path::new(&self.object))? } else { named(&self.object)? };
        Ok(object.with(Stage::default().model()?))
    }

    fn shots(&self, plan: &Plan) -> Shots {
        let poses = |waypoints: &[Waypoint]| -> Vec<Pose> {
            waypoints.iter().map(|waypoint| waypoint.pose).collect()
        };
        Shots {
            intrinsics: self.lens(),
            cameras: poses(&plan.camera.waypoints),
            lights: poses(&plan.light.waypoints),
            view_order: plan.camera.order.clone(),
            light_order: plan.light.order.clone(),
            development: Development::default(),
        }
    }

    fn tracer(&self, model: &Model) -> Result<VirtualRig, RigError> {
        let settings = Settings { samples: self.samples, seed: self.seed, ..Settings::default() };
        VirtualRig::new(model, Lamp::default(), Sensor::default(), settings)
    }

    fn rig(&self, model: &Model, shots: &Shots) -> Result<CaptureRig, RigError> {
        let rig = self.tracer(model)?;
        let intrinsics = || shots.intrinsics.clone();
        let cameras = shots.cameras.iter().enumerate();
        let lights = shots.lights.iter().enumerate();
        Ok(CaptureRig::new(
            rig,
            cameras.map(|(label, &pose)| Camera { label, intrinsics: intrinsics(), pose }).collect(),
            lights.map(|(label, &pose)| Light { label, pose }).collect(),
        ))
    }

    /// All that makes the photographs what they are.
    ///
    /// # Errors
    /// If the object's file cannot be read.
    pub fn subject(&self) -> Result<Subject, SessionError> {
        let mut subject = Subject::from_iter([
            ("rig".to_owned(), "virtual".into()),
            ("object".to_owned(), self.object.clone().into()),
            ("size".to_owned(), format!("{}x{}", self.width, self.height).into()),
            ("views".to_owned(), self.views.into()),
            ("lights".to_owned(), self.lights.into()),
            ("samples".to_owned(), self.samples.into()),
            ("seed".to_owned(), self.seed.into()),
        ]);
        if self.is_file() {
            let bytes = fs::read(&self.object).map_err(SessionError::io(&self.object))?;
            subject.insert("crc32 of the object".to_owned(), crc32fast::hash(&bytes).into());
        }
        Ok(subject)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Prepared;
    use relight_scene::Scene;

    const CAPTURE: VirtualCapture = VirtualCapture {
        object: String::new(),
        views: 3,
        lights: 2,
        width: 24,
        height: 18,
        samples: 4,
        seed: 7,
    };

    fn go(_: Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    #[test]
    fn the_arms_keep_clear_of_the_walls_and_leave_nothing_out() {
        let (domes, arms) = (VirtualCapture::domes(), VirtualCapture::arms());
        let prepared = Prepared::new(&domes, &arms).unwrap();
        assert_eq!(prepared.labels.each_ref().map(Vec::len), [50, 40], "{:?}", prepared.left_out());
        // Between the walls there is no room for the light's arm.
        let mut inside = arms;
        inside.light.base_metres = [-0.34, 0.34, 0.03];
        let error = Prepared::new(&domes, &inside).unwrap_err().to_string();
        assert!(error.contains("the light arm's upper arm runs into wall 2"), "{error}");
    }

    #[test]
    fn objects_and_meshes_become_scenes() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = folder.path().join("roof.obj");
        fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0.5\nf 1 2 3\n").unwrap();
        for object in ["wheel".to_owned(), mesh.display().to_string()] {
            let out = folder.path().join(format!("scene-of-{}", object.len()));
            let capture = VirtualCapture { object, ..CAPTURE };
            capture.shoot(&out, false, &mut go).unwrap();
            let scene = Scene::open(&out).unwrap();
            assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (3, 2, 6));
            let image = scene.read_frame(0).unwrap();
            assert_eq!((image.width, image.height), (24, 18));
            assert!(image.data.iter().any(|&byte| byte > 60), "something is lit");
        }
        // The same mesh by name, and another in it.
        fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0.7\nf 1 2 3\n").unwrap();
        let object = mesh.display().to_string();
        let out = folder.path().join(format!("scene-of-{}", object.len()));
        let error = VirtualCapture { object, ..CAPTURE }.shoot(&out, true, &mut go).unwrap_err().to_string();
        assert!(error.contains("begun with crc32 of the object"), "{error}");
    }

    #[test]
    fn what_is_not_there_is_told_before_anything_is_made() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("scene");
        let mut stop = |_: Progress| -> ControlFlow<()> { panic!("nothing is to be shot") };
        for object in ["unicorn", "unicorn.glb"] {
            let capture = VirtualCapture { object: object.to_owned(), ..CAPTURE };
            let error = capture.shoot(&out, false, &mut stop).unwrap_err().to_string();
            assert!(error.contains("unicorn"), "{error}");
        }
        let none = VirtualCapture { object: "wheel".to_owned(), views: 0, ..CAPTURE };
        assert!(matches!(none.shoot(&out, false, &mut stop), Err(VirtualCaptureError::Plan(_))));
        assert!(!out.exists());
    }
}
