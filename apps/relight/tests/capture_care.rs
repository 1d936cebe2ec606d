//! What a session does around its photographs, as a rig file asks for it.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

mod common;

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Instant;

use relight_scene::{Image, Scene};
use tempfile::TempDir;

use common::contents;

const RUN: &str = "capture run --rig rig.toml --object wheel --size 48x36 --samples 4";
/// Simulated arms, two views and three lights.
const RIG: &str = "[camera]\nwaypoints = 2\ncolatitude-degrees = [48, 68]\nazimuth-degrees = [-118.5, -61.5]\n\
    radius-metres = [0.602, 0.623]\n\
    [light]\nwaypoints = 3\ncolatitude-degrees = [5, 43]\nradius-metres = [0.363, 0.414]\n\
    [arms]\ncamera = { model = \"ec66\", base-metres = [0, -1, 0] }\n\
    light = { model = \"ur5e\", base-metres = [0, 0.48, 0.03] }\n";
const RAW: &str = "[development]\nblack-level = 8\n[photographs]\nfrom = \"virtual\"\nraw = true\n";
const DEVELOPED: &str = "[photographs]\nfrom = \"virtual\"\n";

fn folder() -> TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.current_dir(folder).args(arguments.split_whitespace()).stdin(Stdio::null());
    command
}

fn run(folder: &TempDir, rig: &str, arguments: &str) -> Output {
    fs::write(folder.path().join("rig.toml"), rig).unwrap();
    command(folder.path(), &format!("{RUN} {arguments}")).output().unwrap()
}

/// What a command says on standard error that must succeed.
fn succeed(folder: &TempDir, rig: &str, arguments: &str) -> String {
    let output = run(folder, rig, arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    said
}

/// Light of a scene's photographs in three rows and three columns of each, all added up.
fn blocks(scene: &Path) -> [f64; 9] {
    let scene = Scene::open(scene).unwrap();
    let mut sums = [0.0; 9];
    for frame in 0..scene.frames.len() {
        let image = scene.read_frame(frame).unwrap();
        let (width, height) = (image.width as usize, image.height as usize);
        for (pixel, bytes) in image.data.chunks(3).enumerate() {
            let (column, row) = (3 * (pixel % width) / width, 3 * (pixel / width) / height);
            let light = bytes.iter().map(|&byte| (f64::from(byte) / 255.0).powf(2.2)).sum::<f64>();
            sums[3 * row + column] += light;
        }
    }
    sums
}

/// How much the ratio of two scenes' light differs over the picture.
fn unevenness(a: [f64; 9], b: [f64; 9]) -> f64 {
    let ratios = a.iter().zip(b).map(|(a, b)| a / b);
    ratios.clone().fold(0.0, f64::max) / ratios.fold(f64::INFINITY, f64::min)
}

#[test]
fn dark_and_flat_frames_take_out_of_raw_photographs_what_is_the_cameras() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    succeed(&folder, &format!("{RIG}{DEVELOPED}"), "--out true");
    succeed(&folder, &format!("{RIG}{RAW}"), "--out raw");
    let careful = format!("{RIG}{RAW}[session]\ndark-frames = 4\nflat-frames = 4\n");
    succeed(&folder, &careful, "--out even");
    let truth = blocks(&at("true"));
    let [raw, even] = ["raw", "even"].map(|name| unevenness(blocks(&at(name)), truth));
    // The lens lets a quarter less light through in the corners.
    assert!(raw > 1.15 && even < 1.06, "{raw} {even}");
    // Both references are kept, and a session that has them does not shoot them again.
    let dark = at("even/.capture/dark.json");
    let kept = fs::read(&dark).unwrap();
    fs::remove_file(at("even/.capture/flat.json")).unwrap();
    succeed(&folder, &careful, "--out even --resume");
    assert_eq!(fs::read(&dark).unwrap(), kept);
    assert!(at("even/.capture/flat.json").exists());
    // A camera that develops its frames has none to correct, and that is said before anything is made.
    let output = run(&folder, &format!("{RIG}{DEVELOPED}[session]\nflat-frames = 1\n"), "--out none");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && said.contains("raw = true"), "{said}");
    assert!(!at("none").exists());
}

/// A rig without arms of two views and two lights, whose camera is a script in the folder of its photographs.
fn by_hand(folder: &TempDir, script: &str, session: &str) -> String {
    fs::create_dir_all(folder.path().join("shots")).unwrap();
    fs::write(folder.path().join("shoot.sh"), script).unwrap();
    format!(
        "[camera]\nwaypoints = 2\ncolatitude-degrees = [48, 68]\nradius-metres = [0.6, 0.6]\n\
         [light]\nwaypoints = 2\ncolatitude-degrees = [5, 43]\nradius-metres = [0.3, 0.4]\n\
         [lens]\nfocal-pixels = [60, 60]\n\
         [photographs]\nfrom = \"folder\"\nfolder = \"shots\"\nsize = [32, 24]\n\
         command = [\"sh\", \"../shoot.sh\"]\n\
         [session]\n{session}\n"
    )
}

const BY_HAND: &str = "capture run --rig rig.toml --object cup --out scene --skip-robots";

/// Waves that are shifted to the right.
fn waves(shift: f64) -> Image {
    let places = (0..24).flat_map(|y| (0..32).map(move |x| (f64::from(x), f64::from(y))));
    let level = |(x, y): (f64, f64)| (120.0 + 80.0 * (0.6 * (x - shift)).sin() * (0.5 * y).cos()) as u8;
    Image { width: 32, height: 24, data: places.flat_map(|place| [level(place); 3]).collect() }
}

#[test]
fn a_session_stops_where_something_moved_and_shoots_it_again() {
    let folder = folder();
    let script = "n=$(ls | wc -l)\nif [ $n -lt 2 ] || [ -e ../calm ]; then cp ../before.png $n.png\n\
                  else cp ../after.png $n.png; fi\n";
    let rig = by_hand(&folder, script, "movement = true\nwhen-moved = \"stop\"");
    waves(0.0).write_png(&folder.path().join("before.png")).unwrap();
    waves(0.7).write_png(&folder.path().join("after.png")).unwrap();
    fs::write(folder.path().join("rig.toml"), rig).unwrap();
    let shoot = |more: &str| command(folder.path(), &format!("{BY_HAND} {more}")).output().unwrap();
    let fail = |more: &str| {
        let output = shoot(more);
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    for more in ["", "--resume"] {
        let error = fail(more);
        assert!(error.contains("something moved") && error.contains("--reshoot moved"), "{error}");
    }
    let journal = || fs::read_to_string(folder.path().join("scene/.capture/journal.jsonl")).unwrap();
    assert_eq!(journal().lines().count(), 1 + 2);
    fs::write(folder.path().join("calm"), "").unwrap();
    let output = shoot("--resume --reshoot moved");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(journal().lines().count(), 1 + 4);
    let checks = fs::read_to_string(folder.path().join("scene/.capture/checks.jsonl")).unwrap();
    assert!(checks.lines().count() == 1 + 2 && !checks.contains("\"moved\":true"), "{checks}");
}

#[test]
fn sessions_go_on_with_their_own_lens_and_development() {
    let folder = folder();
    let rig = by_hand(&folder, "cp ../grey.png $(ls | wc -l).png", "");
    Image { width: 32, height: 24, data: vec![120; 32 * 24 * 3] }
        .write_png(&folder.path().join("grey.png"))
        .unwrap();
    let shoot = |rig: &str, more: &str| {
        fs::write(folder.path().join("rig.toml"), rig).unwrap();
        let output = command(folder.path(), &format!("{BY_HAND} {more}")).output().unwrap();
        (output.status.success(), String::from_utf8(output.stderr).unwrap())
    };
    assert!(shoot(&rig, "").0);
    let (succeeded, said) = shoot(&rig.replace("[60, 60]", "[70, 70]"), "--resume");
    assert!(!succeeded && said.contains("begun with another lens"), "{said}");
    assert!(shoot(&rig, "--resume").0);
    succeed(&folder, &format!("{RIG}{RAW}"), "--out raw");
    let other = format!("{RIG}{}", RAW.replace("black-level = 8", "black-level = 9"));
    let said = String::from_utf8(run(&folder, &other, "--out raw --resume").stderr).unwrap();
    assert!(said.contains("begun with black level 8.0, not 9.0"), "{said}");
}

#[test]
fn a_session_with_care_killed_at_twenty_moments_ends_as_one_that_never_was() {
    let folder = folder();
    let rig = format!(
        "{RIG}{RAW}[session]\ndark-frames = 2\nflat-frames = 2\nexr = true\nmovement = true\n\
         movement-every = 2\nlight-gain-frames = 1\n"
    );
    let begun = Instant::now();
    succeed(&folder, &rig, "--out straight");
    let whole = begun.elapsed();
    for moment in 0..20 {
        let mut child = command(folder.path(), &format!("{RUN} --out killed --resume -q")).spawn().unwrap();
        // All over what happens, in no order.
        sleep(whole * (1 + 7 * moment % 19) / 20);
        child.kill().unwrap();
        child.wait().unwrap();
    }
    succeed(&folder, &rig, "--out killed --resume");
    let [straight, killed] = ["straight", "killed"].map(|name| contents(&folder.path().join(name)));
    assert_eq!(straight.keys().collect::<Vec<_>>(), killed.keys().collect::<Vec<_>>());
    assert!(straight.keys().any(|name| name.ends_with(".exr")));
    assert!(straight == killed);
}

/// A constant picture of a card that the lamp lights from several places: what differs is all the lamp's.
const GREY: &str = "cp ../grey.png $(ls | wc -l).png";

#[test]
fn nobody_is_asked_where_there_is_no_terminal() {
    let folder = folder();
    fs::write(folder.path().join("rig.toml"), by_hand(&folder, GREY, "light-gain-frames = 2")).unwrap();
    let output = command(folder.path(), BY_HAND).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("lay a matt grey card") && said.contains("Begin the session in a terminal"),
        "{said}"
    );
}

/// Somebody at a terminal, which `script` of util-linux makes, lays the card in place and takes it away.
#[cfg(target_os = "linux")]
#[test]
fn somebody_at_a_terminal_shows_the_card_and_the_lamp_is_evened_out() {
    use std::io::Write;

    let folder = folder();
    let grey = Image { width: 32, height: 24, data: vec![120; 32 * 24 * 3] };
    grey.write_png(&folder.path().join("grey.png")).unwrap();
    fs::write(folder.path().join("rig.toml"), by_hand(&folder, GREY, "light-gain-frames = 2")).unwrap();
    let shoot = format!("'{}' {BY_HAND}", env!("CARGO_BIN_EXE_relight"));
    let mut script = Command::new("script");
    script.args(["-q", "-e", "-c", &shoot, "/dev/null"]).current_dir(folder.path());
    let mut child = script.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    // More often than is asked: to show the card, under two lights, to take it away, and four photographs.
    child.stdin.take().unwrap().write_all(&[b'\n'; 40]).unwrap();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    let card = said.find("lay a matt grey card flat in the scene's place, its middle at 0 0 0 m").unwrap();
    assert!(said[card..].contains("put the scene in its place"), "{said}");
    let scene = Scene::open(&folder.path().join("scene")).unwrap();
    let text = fs::read_to_string(folder.path().join("scene/.capture/gains.json")).unwrap();
    let gains: serde_json::Value = serde_json::from_str(&text).unwrap();
    let gains = [0, 1].map(|light| gains["gains"][light].as_f64().unwrap());
    // The pictures are alike, so that the lamp must have been brighter from where less of it arrives.
    let explained = [0, 1].map(|light: usize| {
        let [x, y, z] = scene.lights[light].pose.position();
        z / (x * x + y * y + z * z).powf(1.5)
    });
    assert!((explained[0] / explained[1] - 1.0).abs() > 0.05, "{explained:?}");
    assert!((gains[0] / gains[1] - explained[0] / explained[1]).abs() < 1e-4, "{gains:?} {explained:?}");
    let levels = [0, 1].map(|light| scene.read_frame(scene.frame(0, light).unwrap()).unwrap().data[0]);
    assert_eq!(levels[0] > levels[1], gains[0] > gains[1], "{levels:?}");
}

#[test]
fn the_virtual_rig_lays_the_card_itself_and_its_lamp_is_even() {
    let folder = folder();
    let rig = format!("{RIG}{DEVELOPED}[session]\nlight-gain-frames = 1\n");
    succeed(&folder, &rig, "--out scene");
    let text = fs::read_to_string(folder.path().join("scene/.capture/gains.json")).unwrap();
    let gains: serde_json::Value = serde_json::from_str(&text).unwrap();
    for gain in gains["gains"].as_array().unwrap() {
        // The floor and walls throw light on the card too, and not alike from everywhere.
        assert!((gain.as_f64().unwrap() - 1.0).abs() < 0.1, "{gains}");
    }
}
