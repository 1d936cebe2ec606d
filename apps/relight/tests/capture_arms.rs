//! Capturing with arms whose controllers are processes of their own.

#![allow(clippy::unwrap_used)]

mod common;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use relight_capture::trajectory::Plan;
use relight_scene::{Pose, Scene};
use serde_json::{Value, json};
use tempfile::TempDir;

use common::contents;

/// Both arms wait upright.
const UPRIGHT: [&str; 2] = ["0,-90,0,-90,90,0", "0,-90,0,-90,-90,0"];
const RUN: &str = "capture run --rig rig.toml --object wheel --size 24x18 --samples 4";

fn relight(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.current_dir(folder).args(arguments.split_whitespace()).stdin(Stdio::null());
    command
}

fn run(folder: &TempDir, arguments: &str) -> Output {
    relight(folder.path(), arguments).output().unwrap()
}

fn succeed(folder: &TempDir, arguments: &str) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// What a command says that must fail with 1.
fn fail(folder: &TempDir, arguments: &str) -> String {
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8(output.stderr).unwrap()
}

/// A controller in a process of its own, and where its ports begin.
struct Controller {
    process: Child,
    port: u16,
}

impl Controller {
    /// `ports` in a row must be free, which somebody else may take meanwhile.
    fn start(make: &str, ports: u16, more: &str) -> Controller {
        for _ in 0..20 {
            let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
            if port > u16::MAX - ports {
                continue;
            }
            let arguments = format!(
                "capture controller {make} --listen 127.0.0.1:{port} --time-scale 200 --noise-of target {more}"
            );
            let mut command = relight(Path::new("."), &arguments);
            let mut process = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
            let lines = BufReader::new(process.stdout.take().unwrap()).lines().take(ports.into());
            if lines.count() == usize::from(ports) {
                return Controller { process, port };
            }
            process.wait().unwrap();
        }
        panic!("no ports are free");
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Both controllers and a rig file of two views and three lights that names them.
fn rig(folder: &TempDir, light_fault: &str) -> [Controller; 2] {
    let camera = Controller::start("ec", 2, &format!("--joints {}", UPRIGHT[0]));
    let light = Controller::start("ur", 4, &format!("--seed 1 --joints {} {light_fault}", UPRIGHT[1]));
    let file = format!(
        "[camera]\nwaypoints = 2\ncolatitude-degrees = [48, 68]\nazimuth-degrees = [-118.5, -61.5]\n\
         radius-metres = [0.602, 0.623]\n\
         [light]\nwaypoints = 3\ncolatitude-degrees = [5, 43]\nradius-metres = [0.363, 0.414]\n\
         [arms]\ncamera = {{ model = \"ec66\", base-metres = [0, -1, 0] }}\n\
         light = {{ model = \"ur5e\", base-metres = [0, 0.48, 0.03] }}\n\
         [controllers]\ncamera = \"127.0.0.1:{}\"\nlight = \"127.0.0.1:{}\"\n\
         [motion]\nspeed-degrees = 60\nacceleration-degrees = 80\nsettle-seconds = 0\n\
         [photographs]\nfrom = \"virtual\"\n",
        camera.port, light.port
    );
    fs::write(folder.path().join("rig.toml"), file).unwrap();
    [camera, light]
}

/// Somebody releases a protective stop at the dashboard.
fn release(light: &Controller) {
    let mut dashboard = TcpStream::connect(("127.0.0.1", light.port + 2)).unwrap();
    dashboard.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    dashboard.write_all(b"unlock protective stop\n").unwrap();
    let mut answer = [0; 512];
    let mut said = String::new();
    while !said.contains("releas") {
        let n = dashboard.read(&mut answer).unwrap();
        assert!(n > 0, "{said}");
        said.push_str(&String::from_utf8_lossy(&answer[..n]).to_lowercase());
    }
}

/// Two controllers and a camera that saves to a folder.
#[test]
fn a_board_is_photographed_by_arms_and_a_camera_of_their_own() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let _controllers = rig(&folder, "");
    let file = fs::read_to_string(folder.path().join("rig.toml")).unwrap();
    fs::create_dir(folder.path().join("shots")).unwrap();
    relight_scene::Image { width: 8, height: 6, data: vec![90; 3 * 48] }
        .write_png(&folder.path().join("grey.png"))
        .unwrap();
    let camera = "[photographs]\nfrom = \"folder\"\nfolder = \"shots\"\nsize = [8, 6]\n\
                  command = [\"sh\", \"-c\", \"cp ../grey.png $(ls | wc -l).png\"]\n";
    let file = file.replace("[photographs]\nfrom = \"virtual\"\n", camera);
    fs::write(folder.path().join("rig.toml"), file).unwrap();
    let said = succeed(&folder, "capture shoot-board --rig rig.toml --out session");
    assert!(said.contains("from 2 waypoints") && said.contains("[[touches]]"), "{said}");
    let session = folder.path().join("session");
    let photographs = || fs::read_dir(session.join("board")).unwrap().count();
    assert_eq!(photographs(), 2);
    let board = fs::read_to_string(session.join("board.toml")).unwrap();
    assert!(board.contains("columns") && !board.contains("touches"), "{board}");
    // What somebody adds stays, and only what is missing is shot.
    fs::write(session.join("board.toml"), format!("# mine\n{board}")).unwrap();
    fs::remove_file(session.join("board/00001.png")).unwrap();
    assert!(fail(&folder, "capture shoot-board --rig rig.toml --out session").contains("--resume"));
    succeed(&folder, "capture shoot-board --rig rig.toml --out session --resume");
    assert_eq!(photographs(), 2);
    assert!(fs::read_to_string(session.join("board.toml")).unwrap().starts_with("# mine"));
    let shots = fs::read_dir(folder.path().join("shots")).unwrap().count();
    assert_eq!(shots, 3);
    let error = fail(&folder, "capture shoot-board --rig rig.toml --out session --resume --views 3");
    assert!(error.contains("other waypoints"), "{error}");
    // Nothing is made where nobody answers.
    let text = fs::read_to_string(folder.path().join("rig.toml")).unwrap();
    let (before, rest) = text.split_once("[controllers]").unwrap();
    let motion = &rest[rest.find("[motion]").unwrap()..];
    let nobody = "[controllers]\ncamera = \"127.0.0.1:1\"\nlight = \"127.0.0.1:1\"\n";
    fs::write(folder.path().join("rig.toml"), format!("{before}{nobody}{motion}")).unwrap();
    fail(&folder, "capture shoot-board --rig rig.toml --out other");
    assert!(!folder.path().join("other").exists());
}

#[test]
fn a_protective_stop_is_released_and_the_session_ends_as_one_without() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let controllers = rig(&folder, "");
    succeed(&folder, &format!("{RUN} --out straight"));
    drop(controllers);
    let scene = Scene::open(&folder.path().join("straight")).unwrap();
    assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (2, 3, 6));

    let controllers = rig(&folder, "--fault protective-stop@6");
    let error = fail(&folder, &format!("{RUN} --out stopped"));
    assert!(error.contains("the light arm") && error.contains("in protective stop"), "{error}");
    let journal = folder.path().join("stopped/.capture/journal.jsonl");
    let frames = fs::read_to_string(&journal).unwrap().lines().count() - 1;
    assert!((1..6).contains(&frames), "{frames}");
    // Nothing moves before somebody has looked.
    let error = fail(&folder, &format!("{RUN} --out stopped --resume"));
    assert!(error.contains("in protective stop"), "{error}");
    release(&controllers[1]);
    succeed(&folder, &format!("{RUN} --out stopped --resume"));
    let [straight, stopped] = ["straight", "stopped"].map(|name| contents(&folder.path().join(name)));
    assert_eq!(straight.keys().collect::<Vec<_>>(), stopped.keys().collect::<Vec<_>>());
    // Frames come in the order of visit, whatever lay between: the journal too is the same.
    assert!(straight == stopped);

    // The arms went home, so that another session can begin; this one without a camera.
    let said = succeed(&folder, &format!("{RUN} --out none --skip-camera"));
    assert!(said.starts_with("all waypoints were visited: "), "{said}");
    assert!(!folder.path().join("none").exists());
}

#[test]
fn a_rehearsal_connects_to_nothing_and_tells_motions_and_time() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    drop(rig(&folder, ""));
    let said = succeed(&folder, &format!("{RUN} --out scene --dry-run"));
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], "2 views under 3 lights: 6 photographs of 24x18 pixels");
    assert!(lines[1].starts_with("view ") && lines[1].contains("of the light arm, "), "{said}");
    assert!(lines.last().unwrap().starts_with("in all, and home: "), "{said}");
    let error = fail(&folder, &format!("{RUN} --out scene"));
    assert!(error.contains("the camera arm: 127.0.0.1:") && error.contains("cannot connect"), "{error}");
    assert!(!folder.path().join("scene").exists());
}

#[test]
fn arms_elsewhere_and_rigs_that_lack_something_are_told_with_the_mend() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let [camera, _light] = rig(&folder, "");
    let file = folder.path().join("rig.toml");
    let text = fs::read_to_string(&file).unwrap();
    // A controller as it comes from its maker does not stand at the home that the rig file names.
    let elsewhere = Controller::start("ec", 2, "");
    fs::write(&file, text.replace(&camera.port.to_string(), &elsewhere.port.to_string())).unwrap();
    let error = fail(&folder, &format!("{RUN} --out scene"));
    assert!(error.contains("the camera arm stands at joints [0.00, -90.00, 90.00"), "{error}");
    assert!(error.contains("to [0.00, -90.00, 0.00, -90.00, 90.00, 0.00] degrees"), "{error}");
    assert!(!folder.path().join("scene").exists());

    let without = |table: &str| {
        let (before, rest) = text.split_once(table).unwrap();
        let after = rest.find("\n[").map_or("", |end| &rest[end..]);
        fs::write(&file, format!("{before}{after}")).unwrap();
    };
    without("[arms]");
    assert!(fail(&folder, &format!("{RUN} --out scene")).contains("add a table [arms]"));
    without("[photographs]");
    let bare = RUN.replace("--size 24x18 ", "");
    assert!(fail(&folder, &format!("{bare} --out scene")).contains("add a table [photographs]"));
    fs::write(&file, text.replace("\"virtual\"", "\"folder\"\nfolder = \".\"\nsize = [4, 3]")).unwrap();
    assert!(fail(&folder, &format!("{bare} --out scene")).contains("add a table [lens]"));
    if !cfg!(feature = "gige") {
        let camera = "\"gige\"\nserial = \"21\"\nsize = [4, 3]\nexposure-microseconds = 9\n[lens]\nfocal-pixels = [5, 5]";
        fs::write(&file, text.replace("\"virtual\"", camera)).unwrap();
        let error = fail(&folder, &format!("{bare} --out scene"));
        assert!(error.contains("built without GigE Vision") && error.contains("--features gige"), "{error}");
        assert!(succeed(&folder, &format!("{bare} --out scene --dry-run")).contains("of 4x3 pixels"));
    }
    fs::write(&file, format!("{text}\n[motions]\n")).unwrap();
    assert!(fail(&folder, &format!("{RUN} --out scene")).contains("did you mean `motion`?"));
}

/// A camera whose program saves what lies ready, and somebody who moves things.
#[test]
fn a_camera_without_arms_shoots_at_the_planned_names() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    fs::create_dir(folder.path().join("shots")).unwrap();
    let picture = relight_scene::Image { width: 8, height: 6, data: vec![90; 8 * 6 * 3] };
    picture.write_png(&folder.path().join("ready.png")).unwrap();
    let file = "[camera]\nwaypoints = 2\ncolatitude-degrees = [48, 68]\nradius-metres = [0.6, 0.6]\n\
                [light]\nwaypoints = 2\ncolatitude-degrees = [5, 43]\nradius-metres = [0.4, 0.4]\n\
                [lens]\nfocal-pixels = [12, 12]\n\
                [photographs]\nfrom = \"folder\"\nfolder = \"shots\"\nsize = [8, 6]\n\
                command = [\"sh\", \"-c\", \"cp ../ready.png $(ls | wc -l).png\"]\n";
    fs::write(folder.path().join("rig.toml"), file).unwrap();
    let shoot = "capture run --rig rig.toml --object cup --out scene --skip-robots";
    let output = run(&folder, shoot);
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{told}");
    assert!(told.contains("view 0, camera at") && told.contains("under light 1 at"), "{told}");
    let scene = Scene::open(&folder.path().join("scene")).unwrap();
    assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (2, 2, 4));
    assert_eq!(scene.read_frame(0).unwrap().data, picture.data);
    assert!(fail(&folder, &format!("{shoot} --size 8x6")).contains("[photographs]"));
    assert_eq!(run(&folder, &format!("{shoot} --skip-camera")).status.code(), Some(2));
}

/// A calibration of a plan that is off by some millimetres: cameras by `off`, the light's arm by (1, 0, -2) mm.
fn calibration(plan: &Plan, light_base: [f64; 3], off: [f64; 3]) -> Value {
    let moved = |pose: &Pose| {
        let mut matrix = pose.to_matrix();
        (0..3).for_each(|i| matrix[4 * i + 3] += off[i]);
        matrix
    };
    let waypoints: Vec<Value> = plan
        .camera
        .waypoints
        .iter()
        .map(|w| {
            json!({"label": w.label, "camera_to_world": moved(&w.pose), "corners": 48, "rms_pixels": 0.1,
                   "worst_pixels": 0.3, "rms_metres": 2e-5, "position_error": 3e-5, "rotation_error": 5e-5, "is_bad": false})
        })
        .collect();
    let [x, y, z] = light_base;
    let information: [[f64; 9]; 9] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
    json!({
        "format": "relight-calibration-2", "made": 1_700_000_000,
        "board": {"columns": 9, "rows": 7, "square": 0.02, "marker": 0.015, "dictionary": "DICT_4X4_50"},
        "board_to_world": [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1],
        "lens": {"width": 1440, "height": 1080, "fx": 2300, "fy": 2310, "cx": 715, "cy": 535,
                 "distortion": [-0.1, 0.05, 0, 0, 0], "errors": [1, 1, 1, 1, 0, 0, 0, 0, 0],
                 "information": information, "corner_variance": 0.01},
        "lens_shift": null, "lens_photographs": [],
        "rms_pixels": 0.1, "waypoints": waypoints, "left_out": [],
        "light": {"base_to_world": [1, 0, 0, x + 1e-3, 0, 1, 0, y, 0, 0, 1, z - 2e-3, 0, 0, 0, 1],
                  "is_rotation_measured": true, "residuals": [1e-5], "rms": 1e-5}
    })
}

#[test]
fn lens_and_poses_are_those_of_a_calibration_that_fits() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    drop(rig(&folder, ""));
    // Without controllers simulated ones are started.
    let file = folder.path().join("rig.toml");
    let text = fs::read_to_string(&file).unwrap();
    let (before, rest) = text.split_once("[controllers]").unwrap();
    fs::write(&file, format!("{before}{}", &rest[rest.find("[motion]").unwrap()..])).unwrap();
    succeed(&folder, "capture plan --rig rig.toml --out plan.json");
    let plan = Plan::read(&folder.path().join("plan.json")).unwrap();
    let calibrated = |name: &str, off: [f64; 3]| {
        let text = calibration(&plan, [0.0, 0.48, 0.03], off).to_string();
        fs::write(folder.path().join(name), text).unwrap();
        format!("{RUN} --out scene --calibration {name}")
    };
    let error = fail(&folder, &calibrated("other.json", [0.0, 0.12, 0.0]));
    assert!(error.contains("not of this plan") && error.contains("camera waypoint 0 120 mm"), "{error}");
    assert!(!folder.path().join("scene").exists());
    succeed(&folder, &format!("{RUN} --out exact"));
    let output = run(&folder, &calibrated("own.json", [2e-3, 0.0, -1e-3]));
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && told.contains("calibrated ") && told.contains(" ago"), "{told}");
    let scene = |name: &str| Scene::open(&folder.path().join(name)).unwrap();
    let (exact, scene) = (scene("exact"), scene("scene"));
    let apart = |a: &Pose, b: &Pose| {
        let (a, b) = (a.position(), b.position());
        [0, 1, 2].map(|i| a[i] - b[i])
    };
    let near = |a: [f64; 3], b: [f64; 3], limit: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() < limit);
    for (camera, waypoint) in scene.cameras.iter().zip(&plan.camera.waypoints) {
        assert!(near(apart(&camera.pose, &waypoint.pose), [2e-3, 0.0, -1e-3], 1e-6));
        assert!((camera.intrinsics.fx - 2300.0 * 24.0 / 1440.0).abs() < 0.1, "{:?}", camera.intrinsics);
        assert!((camera.intrinsics.distortion[0] + 0.1).abs() < 1e-9);
    }
    for (light, exact) in scene.lights.iter().zip(&exact.lights) {
        // The exact one knows where the arm came to rest beside the plan, the calibrated one does not.
        let apart = apart(&light.pose, &exact.pose);
        assert!(near(apart, [1e-3, 0.0, -2e-3], 2e-4) && !near(apart, [1e-3, 0.0, -2e-3], 1e-7), "{apart:?}");
    }
    // Photographs show what is there, whatever is believed of it.
    let pictures = |scene: &Scene| scene.read_frame(0).unwrap().data;
    assert_eq!(pictures(&scene), pictures(&exact));
}
