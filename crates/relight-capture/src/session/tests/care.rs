//! What is done around each photograph, with a rig whose light is known in closed form.

use super::*;
use serde_json::Value;

use crate::camera::BayerPattern;

const SIZE: (u32, u32) = (32, 24);
const BLACK: f64 = 8.0;

/// A raw camera with dark current and a lens that darkens towards its right edge, before waves or an even grey.
struct Bench {
    view: usize,
    light: usize,
    multiple: f64,
    target: Target,
    /// Photographs since the lamp arrived.
    since: usize,
    /// All photographs.
    shots: usize,
    /// How many photographs after each arrival are shaken.
    shakes: usize,
    /// The photograph from which on the camera stands elsewhere.
    bumped: usize,
    /// The photograph at which the camera breaks.
    breaks: usize,
    /// Level of an even scene; waves without it.
    even: Option<f64>,
    shown: Vec<Target>,
}

impl Default for Bench {
    fn default() -> Self {
        Bench {
            view: 0,
            light: 0,
            multiple: 1.0,
            target: Target::Scene,
            since: 0,
            shots: 0,
            shakes: 0,
            bumped: usize::MAX,
            breaks: usize::MAX,
            even: None,
            shown: Vec::new(),
        }
    }
}

/// Dark current of a pixel, levels at the session's exposure.
fn dark(x: usize, y: usize) -> f64 {
    ((x + 3 * y) % 3) as f64
}

/// Share of light that the lens lets through.
fn shade(x: usize) -> f64 {
    1.0 - 0.5 * x as f64 / f64::from(SIZE.0)
}

impl Rig for Bench {
    fn view(&mut self, view: usize) -> Result<(), RigFault> {
        self.view = view;
        Ok(())
    }

    fn light(&mut self, light: usize) -> Result<(), RigFault> {
        (self.light, self.since) = (light, 0);
        Ok(())
    }

    fn shoot(&mut self) -> Result<Frame, CameraError> {
        self.shots += 1;
        self.since += 1;
        if self.shots == self.breaks {
            return Err(CameraError::Failed { problem: "it fell".into(), mend: "Pick it up." });
        }
        let shift = if self.shots >= self.bumped { 0.7 } else { 0.0 }
            + if self.since <= self.shakes { 0.5 * self.since as f64 } else { 0.0 };
        let level = |x: usize, y: usize| match self.target {
            Target::Dark => dark(x, y),
            Target::Flat => dark(x, y) + 180.0 * shade(x),
            // The lamp loses a tenth of its brightness from each place to the next.
            Target::Card(card) => {
                let [u, v, w] = bench_shots().lights[self.light].position();
                let (x2, y2, z) = ((u - card[0]).powi(2), (v - card[1]).powi(2), w - card[2]);
                let lamp = 0.9f64.powi(self.light as i32);
                self.multiple * (dark(x, y) + shade(x) * 100.0 * lamp * z / (x2 + y2 + z * z).powf(1.5))
            }
            Target::Scene => {
                let (u, v) = (x as f64 - shift, y as f64);
                let waves = 60.0 + 40.0 * (0.6 * u + self.view as f64).sin() * (0.5 * v).cos();
                let light = self.even.unwrap_or(waves / (1.0 + 0.2 * self.light as f64));
                self.multiple * (dark(x, y) + shade(x) * light)
            }
        };
        let places = (0..SIZE.1 as usize).flat_map(|y| (0..SIZE.0 as usize).map(move |x| (x, y)));
        let data = places.map(|(x, y)| (BLACK + level(x, y)).round().clamp(0.0, 255.0) as u8).collect();
        Ok(Frame::Raw { width: SIZE.0, height: SIZE.1, pattern: BayerPattern::Rggb, data })
    }

    fn expose(&mut self, multiple: f64) -> Result<(), CameraError> {
        self.multiple = multiple;
        Ok(())
    }

    fn show(&mut self, target: Target) -> Result<(), RigFault> {
        self.target = target;
        self.shown.push(target);
        Ok(())
    }
}

fn bench_shots() -> Shots {
    let mut shots = shots();
    (shots.intrinsics.width, shots.intrinsics.height) = SIZE;
    shots.cameras.truncate(3);
    shots.lights.truncate(4);
    (shots.view_order, shots.light_order) = (vec![1, 0, 2], vec![3, 0, 2, 1]);
    shots.development.black_level = BLACK as f32;
    shots
}

fn shoot(rig: &mut Bench, care: &Care, out: &Path) -> Result<Ending, SessionError> {
    let mut go = |_: Progress| ControlFlow::Continue(());
    capture_with(rig, &bench_shots(), care, &subject("cup"), out, true, &mut go)
}

fn complete(moved: &[(usize, usize)]) -> Ending {
    Ending::Complete { blurred: Vec::new(), moved: moved.to_vec() }
}

fn everything() -> Care {
    Care {
        dark_frames: 3,
        flat_frames: 2,
        exposures: vec![1.0, 4.0, 0.25],
        tone: Some(0.8),
        exr: true,
        settle_tries: 4,
        movement: true,
        movement_every: 2,
        when_moved: WhenMoved::Tell,
        light_gains: Vec::new(),
        light_gain_frames: 2,
        card_metres: [0.01, 0.0, 0.0],
    }
}

#[test]
fn an_even_scene_becomes_even_and_light_beyond_one_exposure_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = Bench { even: Some(500.0), ..Bench::default() };
    let care = Care { light_gain_frames: 0, ..everything() };
    assert_eq!(shoot(&mut rig, &care, folder.path()).unwrap(), complete(&[]));
    assert_eq!(rig.shown, [Target::Dark, Target::Flat, Target::Scene]);
    let path = hdr_file::path(folder.path(), 2, 1);
    let read = exr::prelude::read_first_flat_layer_from_file(path).unwrap();
    // The mean of the lens is what a flat frame leaves: 0.766 in even columns, 0.75 in odd ones.
    for channel in &read.layer_data.channel_data.list {
        for value in channel.sample_data.values_as_f32() {
            assert!((value - 500.0 * 0.758 / 247.0).abs() < 0.05, "{value}");
        }
    }
    // Fully lit at this tone; a lower one would show it.
    let scene = Scene::open(folder.path()).unwrap();
    assert!(scene.read_frame(0).unwrap().data.iter().all(|&byte| byte == 255));
    // Without correction and bracket the lens shows.
    let plain = tempfile::tempdir().unwrap();
    let mut rig = Bench { even: Some(200.0), ..Bench::default() };
    shoot(&mut rig, &Care::default(), plain.path()).unwrap();
    let image = Scene::open(plain.path()).unwrap().read_frame(0).unwrap();
    assert!(image.data[0] > image.data[3 * 31] + 40);
    assert!(!plain.path().join(STATE).join(CHECKS).exists());
}

/// With all that can be asked for, a session that breaks anywhere and is resumed ends in the same bytes.
#[test]
fn careful_sessions_that_were_interrupted_end_as_others_do() {
    let straight = tempfile::tempdir().unwrap();
    let mut rig = Bench { shakes: 1, ..Bench::default() };
    shoot(&mut rig, &everything(), straight.path()).unwrap();
    // Dark and flat; two photographs of the card a light, which nothing shakes; then two more exposures than one a photograph and two for the shaken one; and two checks a view.
    let total = rig.shots;
    assert_eq!(total, 3 + 2 + 2 * 4 * (3 + 1) + (3 * 4 + 3 * 2) * (3 + 2));
    let expected = contents(straight.path());
    for breaks in (1..=total).step_by(5) {
        let folder = tempfile::tempdir().unwrap();
        let mut rig = Bench { breaks, shakes: 1, ..Bench::default() };
        let error = shoot(&mut rig, &everything(), folder.path()).unwrap_err().to_string();
        assert!(error.contains("it fell"), "{error}");
        shoot(&mut Bench { shakes: 1, ..Bench::default() }, &everything(), folder.path()).unwrap();
        let ended = contents(folder.path());
        assert!(ended == expected, "at {breaks}: {:?}", ended.keys().collect::<Vec<_>>());
    }
}

#[test]
fn a_grey_card_evens_the_lamp_out() {
    let folder = tempfile::tempdir().unwrap();
    let care = Care { dark_frames: 1, flat_frames: 1, light_gain_frames: 1, ..Care::default() };
    let mut rig = Bench { even: Some(100.0), ..Bench::default() };
    shoot(&mut rig, &care, folder.path()).unwrap();
    assert_eq!(rig.shown, [Target::Dark, Target::Flat, Target::Scene, Target::Card([0.0; 3]), Target::Scene]);
    let read = || -> Value {
        let text = fs::read_to_string(folder.path().join(STATE).join("gains.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    };
    let lamp = [0, 1, 2, 3].map(|light| 0.9f64.powi(light));
    let all = lamp.iter().sum::<f64>() / 4.0;
    for (gain, lamp) in read()["gains"].as_array().unwrap().iter().zip(lamp) {
        let (gain, expected) = (gain.as_f64().unwrap(), all / lamp);
        assert!((gain / expected - 1.0).abs() < 0.02, "{gain} {expected}");
    }
    // Photographs are multiplied by them: of an even scene, each light's by its own.
    let scene = Scene::open(folder.path()).unwrap();
    let level = |light: usize| {
        let frame = scene.frames.iter().position(|frame| frame.light == light).unwrap();
        let bytes = scene.read_frame(frame).unwrap().data;
        (f64::from(bytes[3 * 400 + 1]) / 255.0).powf(2.2)
    };
    assert!((level(3) / level(0) - lamp[0] / lamp[3]).abs() < 0.07, "{} {}", level(3), level(0));
    // They are the session's: another card is refused, damage too.
    let path = folder.path().join(STATE).join("gains.json");
    let text = fs::read_to_string(&path).unwrap();
    for (from, to, problem) in [
        ("\"frames\": 1", "\"frames\": 2", "of another card, camera"),
        ("relight-light-gains-1", "relight-light-gains-2", "is of format relight-light-gains-2"),
        ("\"gains\": [", "\"gains\": [-1, ", "of another card, camera"),
        ("\"gains\"", "\"gain\"", "is no file of relight-light-gains-1"),
    ] {
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let error = shoot(&mut Bench::default(), &care, folder.path()).unwrap_err().to_string();
        assert!(error.contains(problem) && error.contains("gains.json"), "{error}");
    }
    // A card that the first view does not see.
    let beside = tempfile::tempdir().unwrap();
    let care = Care { light_gain_frames: 1, card_metres: [5.0, 0.0, 0.0], ..Care::default() };
    let error = shoot(&mut Bench::default(), &care, beside.path()).unwrap_err().to_string();
    assert!(error.contains("the first view does not show it"), "{error}");
}

#[test]
fn the_photograph_that_counts_is_one_at_rest() {
    let settled = Care { settle_tries: 5, ..Care::default() };
    let (calm, shaken) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    shoot(&mut Bench::default(), &Care::default(), calm.path()).unwrap();
    shoot(&mut Bench { shakes: 3, ..Bench::default() }, &settled, shaken.path()).unwrap();
    for image in ["lset000/data/00000_image.png", "lset003/data/00002_image.png"] {
        assert_eq!(fs::read(calm.path().join(image)).unwrap(), fs::read(shaken.path().join(image)).unwrap());
    }
    let never = tempfile::tempdir().unwrap();
    let error =
        shoot(&mut Bench { shakes: 99, ..Bench::default() }, &settled, never.path()).unwrap_err().to_string();
    assert!(
        error.starts_with("view 1 under light 3: not at rest after 5 tries: the picture is shifted"),
        "{error}"
    );
}

#[test]
fn what_moved_is_named_and_shot_again_on_request() {
    let care = Care { movement: true, ..Care::default() };
    let (calm, folder) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    shoot(&mut Bench::default(), &care, calm.path()).unwrap();
    // In the midst of the second view, number 0: each takes four photographs and a check.
    let mut rig = Bench { bumped: 8, ..Bench::default() };
    let affected = [(0, 0), (0, 1), (0, 2), (0, 3)];
    assert_eq!(shoot(&mut rig, &care, folder.path()).unwrap(), complete(&affected));
    let mut idle = Bench::default();
    assert_eq!(shoot(&mut idle, &care, folder.path()).unwrap(), complete(&affected));
    assert_eq!(idle.shots, 0);
    assert_eq!(forget(folder.path(), &[Reshoot::Moved]).unwrap(), affected);
    assert_eq!(forget(folder.path(), &[Reshoot::Moved]).unwrap(), []);
    let mut again = Bench::default();
    assert_eq!(shoot(&mut again, &care, folder.path()).unwrap(), complete(&[]));
    assert_eq!(again.shots, 5);
    for light in 0..4 {
        let image = format!("lset{light:03}/data/00000_image.png");
        assert_eq!(
            fs::read(calm.path().join(&image)).unwrap(),
            fs::read(folder.path().join(&image)).unwrap()
        );
    }
    // One by one, and what was never taken not at all.
    let error = forget(folder.path(), &[Reshoot::Frame(1, 2), Reshoot::View(7)]).unwrap_err().to_string();
    assert!(error.contains("view 7 was not shot yet"), "{error}");
    assert_eq!(forget(folder.path(), &[Reshoot::Frame(1, 2)]).unwrap(), [(1, 2)]);
    let mut once = Bench::default();
    assert_eq!(shoot(&mut once, &care, folder.path()).unwrap(), complete(&[]));
    // Before it, since the session was interrupted there, and at the view's end.
    assert_eq!(once.shots, 3);
    let error = forget(&folder.path().join("elsewhere"), &[Reshoot::Moved]).unwrap_err().to_string();
    assert!(error.contains("holds no session"), "{error}");
    assert_eq!("moved".parse(), Ok(Reshoot::Moved));
    assert_eq!("4, 17".parse(), Ok(Reshoot::Frame(4, 17)));
    assert_eq!("4".parse(), Ok(Reshoot::View(4)));
    assert!("4,".parse::<Reshoot>().is_err() && "-1".parse::<Reshoot>().is_err());
}

/// The camera is bumped in the midst of a view, before its end or while nobody is there.
#[test]
fn what_moved_is_found_as_soon_as_it_can_be_and_the_session_stops_or_shoots_again() {
    let calm = tempfile::tempdir().unwrap();
    shoot(&mut Bench::default(), &Care { movement: true, ..Care::default() }, calm.path()).unwrap();
    let image = |folder: &Path| fs::read(folder.join("lset002/data/00001_image.png")).unwrap();
    let care =
        |when_moved, movement_every| Care { movement: true, movement_every, when_moved, ..Care::default() };
    // After the second photograph of the first view, which has four: the next look is after the third of them.
    let stopped = tempfile::tempdir().unwrap();
    let stop = care(WhenMoved::Stop, 3);
    let mut rig = Bench { bumped: 3, ..Bench::default() };
    let error = shoot(&mut rig, &stop, stopped.path()).unwrap_err().to_string();
    assert!(error.contains("view 1: something moved") && error.contains("--reshoot moved"), "{error}");
    assert_eq!(rig.shots, 4);
    // It stays so until it is shot again.
    assert!(shoot(&mut Bench::default(), &stop, stopped.path()).is_err());
    assert_eq!(forget(stopped.path(), &[Reshoot::Moved]).unwrap(), [(1, 0), (1, 2), (1, 3)]);
    assert_eq!(shoot(&mut Bench::default(), &stop, stopped.path()).unwrap(), complete(&[]));
    assert_eq!(image(stopped.path()), image(calm.path()));
    // Shot again at once, from where the camera stands now; the later views know nothing of it.
    let again = tempfile::tempdir().unwrap();
    let mut rig = Bench { bumped: 3, ..Bench::default() };
    assert_eq!(shoot(&mut rig, &care(WhenMoved::Reshoot, 0), again.path()).unwrap(), complete(&[]));
    assert_eq!(rig.shots, 5 + 3 * 5);
    assert_ne!(image(again.path()), image(calm.path()));
    // Bumped while the session was interrupted: that is seen before anything else is shot.
    let broken = tempfile::tempdir().unwrap();
    let stop = care(WhenMoved::Stop, 0);
    shoot(&mut Bench { breaks: 3, ..Bench::default() }, &stop, broken.path()).unwrap_err();
    let mut rig = Bench { bumped: 1, ..Bench::default() };
    let error = shoot(&mut rig, &stop, broken.path()).unwrap_err().to_string();
    assert!(error.contains("something moved"), "{error}");
    assert_eq!(rig.shots, 1);
    let error = shoot(&mut Bench::default(), &Care { movement: false, ..stop }, calm.path()).unwrap_err();
    assert!(error.to_string().contains("want movement = true"), "{error}");
}

#[test]
fn settings_that_cannot_be_are_refused_and_others_stay_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    for (care, problem) in [
        (Care { exposures: vec![1.0, f64::NAN], ..Care::default() }, "exposures holds NaN"),
        (Care { exposures: vec![1.0; 17], ..Care::default() }, "at most 16"),
        (Care { tone: Some(0.0), ..Care::default() }, "tone or light-gains holds 0"),
        (Care { light_gains: vec![1.0; 3], ..Care::default() }, "3 factors for 4 lights"),
        (Care { light_gain_frames: 1, light_gains: vec![1.0; 4], ..Care::default() }, "one of the two"),
        (Care { dark_frames: 5000, ..Care::default() }, "dark-frames is 5000"),
    ] {
        let error = shoot(&mut Bench::default(), &care, folder.path()).unwrap_err().to_string();
        assert!(error.contains(problem), "{error}");
    }
    let session = folder.path().join(STATE).join("session.json");
    assert!(!session.exists());
    shoot(&mut Bench { breaks: 9, ..Bench::default() }, &everything(), folder.path()).unwrap_err();
    assert!(fs::read_to_string(&session).unwrap().contains("\"version\": 2"));
    let other = Care { tone: None, ..everything() };
    let error = shoot(&mut Bench::default(), &other, folder.path()).unwrap_err().to_string();
    assert!(error.contains("begun with the settings"), "{error}");
    // A session without settings is as it always was.
    let plain = tempfile::tempdir().unwrap();
    shoot(&mut Bench::default(), &Care::default(), plain.path()).unwrap();
    let text = fs::read_to_string(plain.path().join(STATE).join("session.json")).unwrap();
    assert!(text.contains("\"version\": 1") && !text.contains("care"), "{text}");
    // Rigs without targets, and cameras of fixed exposure.
    for (care, problem) in [
        (Care { dark_frames: 1, ..Care::default() }, "dark frames: this rig has nothing dark"),
        (Care { exposures: vec![2.0], ..Care::default() }, "its exposure cannot be set"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let mut go = |_: Progress| ControlFlow::Continue(());
        let ended =
            capture_with(&mut Toy::default(), &shots(), &care, &subject("cup"), folder.path(), true, &mut go);
        let error = ended.unwrap_err().to_string();
        assert!(error.contains(problem), "{error}");
    }
    let read: Care = toml::from_str("movement = true\nexposures = [1, 4]").unwrap();
    assert_eq!(read, Care { movement: true, exposures: vec![1.0, 4.0], ..Care::default() });
    assert!(toml::from_str::<Care>("movements = true").is_err());
}
