//! The folders that scenes lie in, one file a format.

pub(crate) mod camera_file;
mod lenses;
pub(crate) mod pose_file;
mod rene;
mod rene_writer;
pub(crate) mod transforms;

use std::path::{Path, PathBuf};

pub use rene_writer::ReneWriter;

use crate::conventions;
use crate::error::{FaultKind, Faults};
use crate::files;
use crate::scene::Scene;

/// Reads a scene in whatever format it is, with all faults that show without opening an image. Where there are none
/// that are errors there is a scene.
pub(crate) fn read(path: &Path) -> (Option<Scene>, Faults) {
    let mut faults = Faults::default();
    let found = read_into(path, &mut faults);
    let scene = found.map(|Found { scene, camera_files, light_files }| {
        conventions::check(&scene, &camera_files, &light_files, &mut faults);
        scene
    });
    (scene, faults)
}

/// A scene, and where it was found.
struct Found {
    scene: Scene,
    /// For each camera the file that places it.
    camera_files: Vec<PathBuf>,
    /// For each light the file that places it.
    light_files: Vec<PathBuf>,
}

fn read_into(path: &Path, faults: &mut Faults) -> Option<Found> {
    if path.extension().is_some_and(|extension| extension == "json") && path.is_file() {
        let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        return transforms::read(folder, &[(path.to_owned(), None)], faults);
    }
    let entries = faults.keep(files::list(path))?;
    if entries.iter().any(|(name, _)| rene::light_number(name).is_some()) {
        return rene::read(path, &entries, faults);
    }
    let transforms = transforms::find(&entries);
    if !transforms.is_empty() {
        return transforms::read(path, &transforms, faults);
    }
    let inside = entries.iter().find(|(_, path)| path.join("lset000").is_dir());
    let mend = match inside {
        Some((_, scene)) => {
            format!("There are scenes inside: name one of them, such as {}.", scene.display())
        }
        None => "Name the scene's own folder, the one that holds these.".to_owned(),
    };
    faults.error(
        FaultKind::Missing,
        path,
        "holds no scene: neither folders lset000, lset001, … (ReNe) nor transforms.json or transforms_train.json",
        &mend,
    );
    None
}

/// The name of a folder, for people.
fn name_of(root: &Path) -> String {
    let absolute = root.canonicalize().unwrap_or_else(|_| root.to_owned());
    absolute.file_name().map_or_else(|| "scene".to_owned(), |name| name.to_string_lossy().into_owned())
}
