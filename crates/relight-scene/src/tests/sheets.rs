use super::{Rig, SMALL};
use crate::{Scene, SceneInfo, contact_sheet};

#[test]
fn a_sheet_shows_images_and_poses() {
    let folder = Rig { views: 20, lights: 11, width: 32, height: 24 }.write();
    let sheet = contact_sheet(&Scene::open(folder.path()).unwrap()).unwrap();
    assert_eq!(sheet.data.len(), 3 * sheet.width as usize * sheet.height as usize);
    // 8 columns and rows of images enlarged to 160 pixels, and the drawings beside them.
    assert_eq!((sheet.width, sheet.height), (24 + 8 * 164 + 480, 24 + 8 * 124));
    let at = |x: u32, y: u32| {
        let start = 3 * (y * sheet.width + x) as usize;
        [sheet.data[start], sheet.data[start + 1]]
    };
    // The last view and light are among those shown; red tells the view, green the light.
    assert_eq!(at(24 + 7 * 164 + 80, 24 + 7 * 124 + 60), [10 + 19, 100 + 10]);
    assert_eq!(at(24 + 80, 24 + 60), [10, 100]);
    let has = |colour: [u8; 3]| sheet.data.chunks_exact(3).any(|pixel| pixel == colour);
    for colour in [[110, 160, 255], [80, 220, 120], [255, 80, 80], [255, 220, 80], [255, 140, 30], [130; 3]] {
        assert!(has(colour), "{colour:?} is not drawn");
    }
}

#[test]
fn looking_at_a_scene_writes_nothing() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    contact_sheet(&scene).unwrap();
    SceneInfo::of(&scene).unwrap();
    assert!(!folder.path().join("splits.json").exists());
}

#[test]
fn damaged_images_stop_a_sheet() {
    let folder = SMALL.write();
    std::fs::write(super::image_path(folder.path(), 0, 0), "").unwrap();
    assert!(contact_sheet(&Scene::open(folder.path()).unwrap()).is_err());
}
