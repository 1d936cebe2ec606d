//! Tries the crate on real captures, which the repository does not hold: set RELIGHT_SCENES to a folder of ReNe scenes
//! and run with `--ignored`.

use std::ops::ControlFlow;
use std::path::PathBuf;

use relight_scene::{PixelStore, Scene, SceneInfo, Splits, check, contact_sheet, scene_bounds};

fn scenes() -> Vec<PathBuf> {
    let root = std::env::var_os("RELIGHT_SCENES").expect("RELIGHT_SCENES names a folder of scenes");
    let folders = std::fs::read_dir(root)
        .expect("the folder can be listed")
        .map(|entry| entry.expect("an entry").path());
    let scenes: Vec<PathBuf> = folders.filter(|path| path.join("lset000").is_dir()).collect();
    assert!(!scenes.is_empty(), "RELIGHT_SCENES holds no scene");
    scenes
}

#[test]
#[ignore = "needs captures: set RELIGHT_SCENES"]
fn captures_open_and_load() {
    for path in scenes() {
        let start = std::time::Instant::now();
        let scene = Scene::open(&path).unwrap();
        println!("{}: opened in {:?}, {:?}", scene.name, start.elapsed(), scene_bounds(&scene));
        let splits = Splits::of(&scene).unwrap();
        let counts = [&splits.train, &splits.val, &splits.easy, &splits.hard].map(Vec::len);
        assert_eq!(counts, [1628, 9, 111, 9]);
        for round in 0..2 {
            let start = std::time::Instant::now();
            let store = PixelStore::load(&scene, &splits.train, &|_, _| ControlFlow::Continue(())).unwrap();
            println!("round {round}: {} views in {:?}", store.views(), start.elapsed());
            let frame = splits.train[700];
            let image = scene.read_frame(frame).unwrap();
            let (camera, light) = (scene.frames[frame].camera, scene.frames[frame].light);
            let view = (0..store.views()).find(|&view| store.camera(view) == camera).unwrap();
            let slot = store.lights(view).iter().position(|&l| l as usize == light).unwrap();
            for pixel in 0..store.pixels(view) {
                assert_eq!(store.pixel(view, pixel)[slot], image.data[3 * pixel..3 * pixel + 3]);
            }
        }
    }
}

#[test]
#[ignore = "needs captures: set RELIGHT_SCENES; writes sheets to RELIGHT_SHEETS"]
fn captures_check_clean_and_sum_up() {
    for path in scenes() {
        let start = std::time::Instant::now();
        let report = check(&path, &|_, _| {});
        println!("checked in {:?}: {:?}", start.elapsed(), report.faults);
        assert!(report.faults.is_empty());
        let scene = Scene::open(&path).unwrap();
        println!("{:?}", SceneInfo::of(&scene).unwrap());
        let sheet = contact_sheet(&scene).unwrap();
        if let Some(folder) = std::env::var_os("RELIGHT_SHEETS") {
            sheet.write_png(&PathBuf::from(folder).join(format!("{}.png", scene.name))).unwrap();
        }
    }
}
