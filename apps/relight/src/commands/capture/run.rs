//! `relight capture run`: every view under every light.

use std::io::{IsTerminal, stdin};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, bail, ensure};
use relight_capture::camera::{Camera, FolderCamera};
use relight_capture::rig::{AttendedCamera, Eye, HandRig, Photographs, RigFile};
use relight_capture::session::{self, Ending, Reshoot, Rig, STATE, Shots, Subject};
use relight_capture::trajectory::Plan;
use relight_capture::virtual_rig::VirtualCapture;
use relight_capture::virtual_rig::objects::ALL;
use relight_scene::Intrinsics;
use serde_json::json;

use super::{arms, attendant};
use crate::commands::render::size;
use crate::console::{Progress, cancel_flag, print_line, unless};
use crate::places;

/// The rig that needs no file.
pub const VIRTUAL: &str = "virtual";
/// Size of virtual photographs.
const SIZE: (u32, u32) = (320, 240);

/// Shoot a capture: every view under every light.
///
/// A rig file says where the arms stand and listen, and what takes the photographs; `virtual` is a rig of simulated arms and a
/// path tracer, driven by the very same code. All motions are planned and checked before the first of them. Every frame is
/// journalled: --resume goes on after a kill or a fault at any moment, without a lost or a doubled frame. The folder that comes
/// out is of the official ReNe layout, with its splits.
#[derive(clap::Args)]
#[command(after_help = format!(
    "Examples:\n  relight capture run --object fern --out scenes/fern --size 320x240\n  \
     relight capture run --object teapot.glb --out scenes/teapot --resume\n  \
     relight capture run --rig rig.toml --object teapot --out scenes/teapot --dry-run\n  \
     relight capture run --rig rig.toml --object teapot --out scenes/teapot --calibration SESSION/calibration.json\n\n\
     {RIG_HELP}\n\n\
     Built-in objects of the virtual rig:\n{}",
    ALL.map(|object| format!("  {:<14} {}", object.name, object.about)).join("\n")
))]
pub struct Args {
    /// What shoots: `virtual`, or a rig file.
    #[arg(long, default_value = VIRTUAL, value_name = "virtual|FILE")]
    pub rig: String,
    /// What stands there: its name; on the virtual rig a built-in object, or a mesh as .glb, .gltf or .obj.
    #[arg(long, value_name = "NAME|FILE")]
    pub object: String,
    /// Folder of the scene, made anew.
    #[arg(long, value_name = "SCENE")]
    pub out: PathBuf,
    /// Size of virtual photographs [default: 320x240].
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<(u32, u32)>,
    /// Views [default: 50, or the rig file's].
    #[arg(long, value_name = "N")]
    pub views: Option<usize>,
    /// Lights [default: 40, or the rig file's].
    #[arg(long, value_name = "N")]
    pub lights: Option<usize>,
    /// Camera rays a pixel of virtual photographs.
    #[arg(long, value_name = "N", default_value_t = 32)]
    pub samples: u32,
    /// Seed of the virtual rig: of paths, of the sensor's noise, and of where simulated arms come to rest.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Lens and poses as `capture calibrate` found them. Without it, the virtual rig knows them exactly, and a real one writes
    /// where its arms believe that they are.
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// Go on with the session in SCENE; begin it if there is none.
    #[arg(long)]
    pub resume: bool,
    /// Photographs of the session in SCENE to take again: all of the views during which something moved, all of a view, or one;
    /// may be given several times.
    #[arg(long, value_name = "moved|VIEW|VIEW,LIGHT", requires = "resume", value_parser = str::parse::<Reshoot>)]
    pub reshoot: Vec<Reshoot>,
    /// Plan everything and say what would be done; connect to nothing, move nothing, shoot nothing.
    #[arg(long)]
    pub dry_run: bool,
    /// Shoot without arms: somebody brings camera and lamp to each place. The virtual rig's stand exactly where they are planned.
    #[arg(long)]
    pub skip_robots: bool,
    /// Take the arms through all waypoints, and shoot nothing.
    #[arg(long, conflicts_with = "skip_robots")]
    pub skip_camera: bool,
}

const RIG_HELP: &str = "\
A rig file is that of `relight capture plan` (see its --help) with more tables:\n\n  \
[controllers]                          # HOST (the maker's ports) or HOST:PORT\n  \
camera = \"192.168.0.11\"\n  \
light = \"192.168.0.12\"\n\n  \
[motion]                               # of the joint that goes farthest\n  \
speed-degrees = 30.0                   # a second\n  \
acceleration-degrees = 45.8            # a second squared\n  \
settle-seconds = 0.3                   # to wait before each photograph\n\n  \
[photographs]\n  \
from = \"folder\"                        # where the camera's own program saves; or \"virtual\"\n  \
folder = \"shots\"                       # beside the rig file\n  \
command = [\"gphoto2\", \"--capture-image-and-download\"]    # what shoots; nothing: somebody does\n  \
patience-seconds = 30.0\n  \
size = [1440, 1080]\n\n  \
[photographs]                          # or a camera that speaks GigE Vision (a build with --features gige)\n  \
from = \"gige\"\n  \
address = \"192.168.1.20\"               # or serial = \"21234567\"\n  \
size = [1440, 1080]                    # as it is set in the camera\n  \
exposure-microseconds = 12000.0        # fixed for the session\n  \
# gain, pattern = \"rggb\", patience-seconds, packet-size = 1500, packet-delay-microseconds\n\n  \
[lens]                                 # roughly, for sessions without --calibration\n  \
focal-pixels = [2350.0, 2350.0]\n  \
centre-pixels = [719.5, 539.5]\n\n  \
[board]                                # that calibrates the rig, for board, detect, calibrate, shoot-board\n  \
columns = 12                           # squares\n  \
rows = 9\n  \
square-metres = 0.027                  # measured on the print\n  \
marker-metres = 0.02025\n  \
dictionary = \"DICT_5X5_100\"\n\n  \
[development]                          # of raw photographs\n  \
white-balance = [1.0, 1.0, 1.0]\n  \
black-level = 0.0";

/// What is told of progress, and whether to go on.
type Told<'a> = dyn FnMut(session::Progress) -> ControlFlow<()> + 'a;

/// A session that is ready to be begun.
pub struct Job<'a> {
    pub args: &'a Args,
    pub file: RigFile,
    /// What the virtual camera would see.
    pub virtual_capture: VirtualCapture,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    places::check_folder(&args.out)?;
    let job = Job::new(args)?;
    if !args.skip_robots {
        return arms::run(&job, quiet);
    }
    ensure!(
        args.calibration.is_none(),
        "--calibration says where arms bring camera and lamp; without --skip-robots it is used"
    );
    if args.rig == VIRTUAL {
        return job.traced(quiet);
    }
    job.by_hand(quiet)
}

impl Job<'_> {
    fn new(args: &Args) -> anyhow::Result<Job<'_>> {
        let mut file = if args.rig == VIRTUAL {
            RigFile { photographs: Some(Photographs::Virtual { raw: false }), ..RigFile::default() }
        } else {
            RigFile::read(Path::new(&args.rig))?
        };
        let is_virtual = matches!(file.photographs, Some(Photographs::Virtual { .. }));
        ensure!(
            is_virtual || args.size.is_none(),
            "--size is for virtual photographs; the size of others stands in {}, [photographs]",
            args.rig
        );
        let (width, height) = args.size.unwrap_or(SIZE);
        let mut settings = file.plan_settings();
        let virtual_capture = VirtualCapture {
            object: args.object.clone(),
            views: args.views.unwrap_or(settings.camera.waypoints),
            lights: args.lights.unwrap_or(settings.light.waypoints),
            width,
            height,
            samples: args.samples,
            seed: args.seed,
        };
        if args.rig == VIRTUAL {
            settings = virtual_capture.plan_settings();
            file.arms = Some(VirtualCapture::arms());
        }
        settings.camera.waypoints = virtual_capture.views;
        settings.light.waypoints = virtual_capture.lights;
        (file.object, file.camera, file.light) =
            (Some(settings.object), Some(settings.camera), Some(settings.light));
        Ok(Job { args, file, virtual_capture })
    }

    /// The virtual rig without arms.
    fn traced(&self, quiet: bool) -> anyhow::Result<()> {
        let capture = &self.virtual_capture;
        if self.args.dry_run {
            return rehearse(&capture.rehearse()?, [capture.width, capture.height]);
        }
        self.forget()?;
        let ending = self.follow([capture.views, capture.lights], quiet, &mut |progress| {
            Ok(capture.shoot(&self.args.out, self.args.resume, progress)?)
        })?;
        self.told(ending, [capture.views, capture.lights], "")
    }

    /// A real camera, and somebody who moves it.
    fn by_hand(&self, quiet: bool) -> anyhow::Result<()> {
        let plan = Plan::new(&self.file.plan_settings()).with_context(|| self.args.rig.clone())?;
        let size = self.file.photographs.as_ref().and_then(Photographs::size).with_context(|| {
            format!(
                "{}: without arms, virtual photographs are those of the built-in rig: leave --rig out, or --skip-robots. A real \
                 camera has a table [photographs] with from = \"folder\" or \"gige\"",
                self.args.rig
            )
        })?;
        if self.args.dry_run {
            return rehearse(&plan, size);
        }
        let intrinsics = self.rough_lens(size)?;
        let eye = real_eye(&self.file, &self.args.rig)?;
        let [cameras, lights] =
            [&plan.camera, &plan.light].map(|t| t.waypoints.iter().map(|w| w.pose).collect::<Vec<_>>());
        let place = |view: usize, light: usize| {
            let at = |pose: &relight_scene::Pose| {
                let [x, y, z] = pose.position();
                format!("{x:.3} {y:.3} {z:.3} m")
            };
            eprintln!(
                "view {view}, camera at {}, under light {light} at {}",
                at(&cameras[view]),
                at(&lights[light])
            );
            if stdin().is_terminal() {
                eprintln!("press Enter when both are there");
                // The end of the input counts as Enter.
                let _ = stdin().read_line(&mut String::new());
            }
            Ok(())
        };
        let shots = Shots {
            intrinsics,
            cameras: cameras.clone(),
            lights: lights.clone(),
            view_order: plan.camera.order.clone(),
            light_order: plan.light.order.clone(),
            development: self.file.development(),
        };
        let mut rig = HandRig::new(eye, Box::new(place));
        let ending = self.shoot(&mut rig, &shots, &self.subject(&shots), quiet)?;
        self.told(ending, [cameras.len(), lights.len()], "")
    }

    /// Shoots a session with any rig.
    pub fn shoot(
        &self,
        rig: &mut dyn Rig,
        shots: &Shots,
        subject: &Subject,
        quiet: bool,
    ) -> anyhow::Result<Ending> {
        self.forget()?;
        let counts = [shots.view_order.len(), shots.light_order.len()];
        let (out, resume) = (&self.args.out, self.args.resume);
        self.follow(counts, quiet, &mut |progress| {
            Ok(session::capture_with(rig, shots, &self.file.session, subject, out, resume, progress)?)
        })
    }

    /// Takes out of the journal what is to be shot again.
    fn forget(&self) -> anyhow::Result<()> {
        if !self.args.reshoot.is_empty() {
            let forgotten = session::forget(&self.args.out, &self.args.reshoot)?;
            tracing::info!("{} photographs are shot again", forgotten.len());
        }
        Ok(())
    }

    /// Does something long with so many views and lights while its progress is shown.
    pub fn follow<T>(
        &self,
        [views, lights]: [usize; 2],
        quiet: bool,
        work: &mut dyn FnMut(&mut Told) -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        let cancel = cancel_flag()?;
        let bar = Progress::new(
            if self.args.skip_camera { "walking" } else { "shooting" },
            (views * lights) as u64,
            quiet,
        );
        let ended = work(&mut |progress| {
            bar.count(progress.done, progress.total, "photographs");
            unless(cancel)
        });
        bar.clear();
        ended
    }

    /// Says how a session ended.
    pub fn told(&self, ending: Ending, [views, lights]: [usize; 2], stopped: &str) -> anyhow::Result<()> {
        let out = &self.args.out;
        let Ending::Complete { blurred, moved } = ending else {
            bail!(
                "stopped{stopped}; go on with the same command and --resume. What is shot so far: {}",
                out.join(STATE).join(session::SHEET).display()
            );
        };
        for (view, light) in blurred {
            tracing::warn!("view {view} under light {light} is blurred beside the others");
        }
        let any_moved = !moved.is_empty();
        for (view, light) in moved {
            tracing::warn!("view {view} under light {light}: something moved while the view was shot");
        }
        if any_moved {
            tracing::warn!("shoot these again by the same command with --resume --reshoot moved");
        }
        print_line(&format!("{}: {views} views under {lights} lights", out.display()))
    }

    /// The lens that the rig file tells.
    pub fn rough_lens(&self, size: [u32; 2]) -> anyhow::Result<Intrinsics> {
        let lens = self.file.lens.with_context(|| {
            format!("{}: nobody knows the lens; name a --calibration, or add a table [lens]", self.args.rig)
        })?;
        tracing::warn!(
            "without a calibration, poses are where the plan has them and the lens is a rough one"
        );
        Ok(lens.intrinsics(size))
    }

    /// What a session with a real camera is.
    pub fn subject(&self, shots: &Shots) -> Subject {
        let lens = &shots.intrinsics;
        let mut subject = Subject::from_iter([
            ("rig".to_owned(), self.args.rig.clone().into()),
            ("object".to_owned(), self.args.object.clone().into()),
            ("size".to_owned(), format!("{}x{}", lens.width, lens.height).into()),
        ]);
        subject.extend(developed(shots));
        if let Some(Photographs::Gige(settings)) = &self.file.photographs {
            subject.insert(session::CAMERA.to_owned(), json!(settings));
        }
        subject
    }
}

/// The camera of a rig file, called `named`.
pub fn real_eye(file: &RigFile, named: &str) -> anyhow::Result<Box<dyn Eye>> {
    match &file.photographs {
        Some(Photographs::Folder { folder, command, patience_seconds, size: [width, height] }) => {
            let patience = Duration::try_from_secs_f64(*patience_seconds)?;
            let camera = FolderCamera::new(folder, command.clone(), patience, (*width, *height))?;
            Ok(attended(Box::new(camera)))
        }
        Some(Photographs::Gige(settings)) => Ok(attended(settings.open().with_context(|| named.to_owned())?)),
        Some(Photographs::Virtual { .. }) | None => {
            bail!("{named}: has no camera; add a table [photographs], or walk with --skip-camera")
        }
    }
}

/// What of a session tells how raw photographs become images.
pub fn developed(shots: &Shots) -> Subject {
    Subject::from_iter([
        ("white balance".to_owned(), format!("{:?}", shots.development.white_balance).into()),
        ("black level".to_owned(), f64::from(shots.development.black_level).into()),
    ])
}

/// A real camera, and somebody at the terminal.
fn attended(camera: Box<dyn Camera>) -> Box<dyn Eye> {
    Box::new(AttendedCamera::new(camera, Box::new(attendant::show)))
}

/// Tells what would be shot without arms.
fn rehearse(plan: &Plan, [width, height]: [u32; 2]) -> anyhow::Result<()> {
    let (views, lights) = (plan.camera.order.len(), plan.light.order.len());
    print_line(&format!(
        "{}\ncamera: {:.2} m from first view to last\nlight: {:.2} m from first light to last, once a view",
        headline(views, lights, [width, height]),
        plan.camera.length(),
        plan.light.length()
    ))
}

/// How much there is to shoot.
pub fn headline(views: usize, lights: usize, [width, height]: [u32; 2]) -> String {
    let photographs = views * lights;
    format!("{views} views under {lights} lights: {photographs} photographs of {width}x{height} pixels")
}

/// A time for people.
pub fn time(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match (whole / 86_400, whole / 3600 % 24, whole / 60 % 60, whole % 60) {
        (0, 0, 0, seconds) => format!("{seconds} s"),
        (0, 0, minutes, seconds) => format!("{minutes} min {seconds:02} s"),
        (0, hours, minutes, _) => format!("{hours} h {minutes:02} min"),
        (days, hours, ..) => format!("{days} days {hours} h"),
    }
}
