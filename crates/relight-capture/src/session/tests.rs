use std::collections::BTreeMap;
use std::fs;

use relight_scene::Image;

use super::*;

mod care;

/// A rig whose photographs tell where camera and light are, and which fails or stops when told to.
#[derive(Default)]
struct Toy {
    at: Option<(usize, usize)>,
    view: usize,
    /// Photographs that were asked for.
    shots: usize,
    /// Numbers of shots that arrive torn.
    torn: BTreeSet<usize>,
    /// The shot at which the camera breaks.
    breaks: Option<usize>,
}

impl Rig for Toy {
    fn view(&mut self, view: usize) -> Result<(), RigFault> {
        (self.view, self.at) = (view, None);
        Ok(())
    }

    fn light(&mut self, light: usize) -> Result<(), RigFault> {
        self.at = Some((self.view, light));
        Ok(())
    }

    fn shoot(&mut self) -> Result<Frame, CameraError> {
        self.shots += 1;
        if self.breaks == Some(self.shots) {
            return Err(CameraError::Failed { problem: "it fell".into(), mend: "Pick it up." });
        }
        let (view, light) = self.at.expect("a light after each view");
        let mut data: Vec<u8> = (0..3 * 8 * 6).map(|i| (i * (3 + view) + 7 * light) as u8).collect();
        if self.torn.contains(&self.shots) {
            data.truncate(50);
        }
        Ok(Frame::Developed(Image { width: 8, height: 6, data }))
    }
}

fn shots() -> Shots {
    let on = |x: f64, z: f64| Pose::look_at([x, -0.5, z], [0.0; 3]);
    Shots {
        intrinsics: Intrinsics {
            width: 8,
            height: 6,
            fx: 9.0,
            fy: 9.0,
            cx: 3.5,
            cy: 2.5,
            distortion: Vec::new(),
        },
        cameras: (0..6).map(|i| on(0.1 * i as f64, 0.3)).collect(),
        lights: (0..5).map(|i| on(0.1 * i as f64, 0.5)).collect(),
        view_order: vec![2, 0, 1, 5, 4, 3],
        light_order: vec![4, 2, 0, 1, 3],
        development: Development::default(),
    }
}

fn subject(object: &str) -> Subject {
    Subject::from_iter([("object".to_owned(), object.into())])
}

fn run(rig: &mut Toy, out: &Path, resume: bool, stop_at: Option<usize>) -> Result<Ending, SessionError> {
    let mut progress = |progress: Progress| {
        if Some(progress.done) == stop_at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    capture(rig, &shots(), &subject("cup"), out, resume, &mut progress)
}

/// Every file of a folder.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            found
                .extend(contents(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            found.insert(name, fs::read(&path).unwrap());
        }
    }
    found
}

#[test]
fn a_session_shoots_each_pair_once_and_ends_in_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = Toy::default();
    let ending = run(&mut rig, folder.path(), false, None).unwrap();
    assert_eq!((ending, rig.shots), (Ending::Complete { blurred: Vec::new(), moved: Vec::new() }, 30));
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (6, 5, 30));
    let frame = scene.frame(4, 3).unwrap();
    assert_eq!(scene.read_frame(frame).unwrap().data[1], 3 + 4 + 7 * 3);
    assert_eq!(scene.cameras[4].pose, shots().cameras[4]);
    // The splits that were written are those that any later reader would draw.
    let written = Splits::of(&scene).unwrap();
    fs::remove_file(folder.path().join("splits.json")).unwrap();
    assert_eq!(Splits::peek(&scene).unwrap(), written);
    // Nothing is left to do.
    let mut idle = Toy::default();
    run(&mut idle, folder.path(), true, None).unwrap();
    assert_eq!(idle.shots, 0);
}

/// Whatever a session was at when it stopped, files half written included, its end is the same to the byte.
#[test]
fn interrupted_sessions_end_as_others_do() {
    let straight = tempfile::tempdir().unwrap();
    run(&mut Toy::default(), straight.path(), false, None).unwrap();
    let expected = contents(straight.path());
    for breaks in (1..30).step_by(4) {
        let folder = tempfile::tempdir().unwrap();
        let mut rig = Toy { breaks: Some(breaks), ..Toy::default() };
        let error = run(&mut rig, folder.path(), true, None).unwrap_err().to_string();
        assert!(error.contains("it fell. Pick it up."), "{error}");
        // What a kill may leave of the next frame.
        let torn = folder.path().join("lset004/data/00002_image.png.part");
        fs::write(torn, b"half").unwrap();
        let mut rest = Toy::default();
        let stopped = breaks / 2 + 15;
        assert_eq!(run(&mut rest, folder.path(), true, Some(stopped)).unwrap(), Ending::Stopped);
        assert_eq!(rest.shots, stopped + 1 - breaks);
        // The last frame, of which the journal does not tell.
        let journal = folder.path().join(STATE).join("journal.jsonl");
        let text = fs::read_to_string(&journal).unwrap();
        let last = text.trim_end().rfind('\n').unwrap();
        fs::write(&journal, &text[..last + 1 + breaks % 7]).unwrap();
        run(&mut Toy::default(), folder.path(), true, None).unwrap();
        let mut ended = contents(folder.path());
        if breaks > 1 {
            // That of a frame that was on disk already; a kill leaves none there.
            ended.remove("lset004/data/00002_image.png.part");
        }
        assert!(ended == expected, "{:?}", ended.keys().collect::<Vec<_>>());
    }
}

#[test]
fn incomplete_frames_are_shot_again_and_not_for_ever() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = Toy { torn: BTreeSet::from([2, 3, 11]), ..Toy::default() };
    run(&mut rig, folder.path(), false, None).unwrap();
    assert_eq!(rig.shots, 33);
    let folder = tempfile::tempdir().unwrap();
    let mut rig = Toy { torn: (4..20).collect(), ..Toy::default() };
    let error = run(&mut rig, folder.path(), false, None).unwrap_err().to_string();
    assert!(
        error.starts_with("view 2 under light 1: 5 tries, each time an incomplete frame: 50 of"),
        "{error}"
    );
}

#[test]
fn only_the_same_session_is_resumed() {
    let folder = tempfile::tempdir().unwrap();
    run(&mut Toy::default(), folder.path(), true, Some(4)).unwrap();
    let again = |subject_: &Subject, shots: &Shots, resume| {
        let mut go = |_: Progress| ControlFlow::Continue(());
        capture(&mut Toy::default(), shots, subject_, folder.path(), resume, &mut go).unwrap_err().to_string()
    };
    assert!(again(&subject("cup"), &shots(), false).contains("holds a session already"));
    let other = again(&subject("can"), &shots(), true);
    assert!(other.contains("begun with object \"cup\", not \"can\""), "{other}");
    let mut moved = shots();
    moved.lights[2] = moved.lights[1];
    assert!(again(&subject("cup"), &moved, true).contains("other poses"));
    // An image that somebody overwrote is not taken for what was shot.
    let image = folder.path().join("lset004/data/00002_image.png");
    let kept = fs::read(&image).unwrap();
    fs::write(&image, b"other").unwrap();
    assert!(again(&subject("cup"), &shots(), true).contains("00002_image.png: is not what was shot"));
    fs::write(&image, kept).unwrap();
    run(&mut Toy::default(), folder.path(), true, None).unwrap();
    // Folders of something else are left alone.
    let elsewhere = tempfile::tempdir().unwrap();
    fs::write(elsewhere.path().join("thesis.tex"), "").unwrap();
    let error = run(&mut Toy::default(), elsewhere.path(), true, None).unwrap_err().to_string();
    assert!(error.contains("is not empty, and holds no session"), "{error}");
}
