//! The folders that scenes lie in, one file a format.

mod camera_file;
mod pose_file;
mod rene;

use std::path::Path;

use crate::conventions;
use crate::error::{FaultKind, Faults};
use crate::files;
use crate::scene::Scene;

/// Reads a scene in whatever format it is, with all faults that show without opening an image. Where there are none
/// that are errors there is a scene.
pub(crate) fn read(path: &Path) -> (Option<Scene>, Faults) {
    let mut faults = Faults::default();
    let scene = read_into(path, &mut faults);
    if let Some(scene) = &scene {
        conventions::check(scene, &mut faults);
    }
    (scene, faults)
}

fn read_into(path: &Path, faults: &mut Faults) -> Option<Scene> {
    let entries = faults.keep(files::list(path))?;
    if entries.iter().any(|(name, _)| rene::light_number(name).is_some()) {
        return rene::read(path, &entries, faults);
    }
    faults.error(
        FaultKind::Missing,
        path,
        "holds no scene: neither folders lset000, lset001, … (ReNe) nor a file transforms.json or transforms_train.json",
        "Name the scene's own folder, the one that holds these.",
    );
    None
}

/// The name of a folder, for people.
fn name_of(root: &Path) -> String {
    let absolute = root.canonicalize().unwrap_or_else(|_| root.to_owned());
    absolute.file_name().map_or_else(|| "scene".to_owned(), |name| name.to_string_lossy().into_owned())
}
