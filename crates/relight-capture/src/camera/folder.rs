//! A camera whose own program saves photographs to a folder: any camera that can be tethered.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use relight_scene::read_image;

use super::{Camera, CameraError, Frame};

/// How often the folder is looked at.
const LOOK: Duration = Duration::from_millis(50);

/// Takes the photographs that appear in a folder. A command may be given that shoots (`gphoto2
/// --capture-image-and-download`, say); without one, somebody or something else is to press the button.
pub struct FolderCamera {
    folder: PathBuf,
    /// The program that shoots, and its arguments.
    shoot: Vec<String>,
    patience: Duration,
    size: (u32, u32),
    seen: BTreeSet<PathBuf>,
}

impl FolderCamera {
    /// A camera that saves to `folder`, whose photographs are of a known size. What lies there already is not looked at.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn new(
        folder: &Path,
        shoot: Vec<String>,
        patience: Duration,
        size: (u32, u32),
    ) -> Result<FolderCamera, CameraError> {
        let seen = files(folder)?;
        Ok(FolderCamera { folder: folder.to_owned(), shoot, patience, size, seen })
    }

    /// Runs the program that shoots.
    fn press(&self) -> Result<(), CameraError> {
        let Some((program, arguments)) = self.shoot.split_first() else { return Ok(()) };
        let failed = |problem: String| CameraError::Failed {
            problem: format!("{program}: {problem}"),
            mend: "Try the command by hand in the folder of the photographs.",
        };
        let output = Command::new(program)
            .args(arguments)
            .current_dir(&self.folder)
            .output()
            .map_err(|error| failed(error.to_string()))?;
        if output.status.success() {
            return Ok(());
        }
        let said = String::from_utf8_lossy(&output.stderr);
        Err(failed(format!("{}: {}", output.status, said.trim())))
    }
}

impl Camera for FolderCamera {
    fn size(&self) -> (u32, u32) {
        self.size
    }

    fn shoot(&mut self) -> Result<Frame, CameraError> {
        self.press()?;
        let started = Instant::now();
        loop {
            let new = files(&self.folder)?.into_iter().find(|path| !self.seen.contains(path));
            // A file that is still being written cannot be read whole: it is looked at again until time is up.
            let image = new.map(|path| (read_image(&path), path));
            match image {
                Some((Ok(image), path)) => {
                    self.seen.insert(path.clone());
                    if (image.width, image.height) != self.size {
                        let (w, h) = self.size;
                        let problem =
                            format!("{}: is {}x{}, not {w}x{h}", path.display(), image.width, image.height);
                        let mend = "Set the camera to one size for the whole session, and state that size.";
                        return Err(CameraError::Failed { problem, mend });
                    }
                    return Ok(Frame::Developed(image));
                }
                Some((Err(error), path)) if started.elapsed() > self.patience => {
                    self.seen.insert(path);
                    return Err(CameraError::Incomplete(error.to_string()));
                }
                None if started.elapsed() > self.patience => {
                    let seconds = self.patience.as_secs_f64();
                    return Err(CameraError::NoPhotograph { folder: self.folder.clone(), seconds });
                }
                _ => sleep(LOOK),
            }
        }
    }
}

/// The files of a folder, but for hidden ones.
fn files(folder: &Path) -> Result<BTreeSet<PathBuf>, CameraError> {
    let failed = |error: std::io::Error| CameraError::Failed {
        problem: format!("{}: {error}", folder.display()),
        mend: "Name the folder that the camera's program saves to.",
    };
    let mut files = BTreeSet::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        if !entry.file_name().to_string_lossy().starts_with('.') && entry.path().is_file() {
            files.insert(entry.path());
        }
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_scene::Image;

    fn image(value: u8) -> Image {
        Image { width: 4, height: 3, data: vec![value; 36] }
    }

    fn camera(folder: &Path, shoot: &[&str]) -> FolderCamera {
        let shoot = shoot.iter().map(|&word| word.to_owned()).collect();
        FolderCamera::new(folder, shoot, Duration::from_millis(300), (4, 3)).unwrap()
    }

    #[test]
    fn the_next_photograph_is_taken_and_no_older_one() {
        let folder = tempfile::tempdir().unwrap();
        image(1).write_png(&folder.path().join("1.png")).unwrap();
        let mut camera = camera(folder.path(), &[]);
        assert!(matches!(camera.shoot(), Err(CameraError::NoPhotograph { .. })));
        image(2).write_png(&folder.path().join("2.png")).unwrap();
        assert_eq!(camera.shoot().unwrap(), Frame::Developed(image(2)));
        assert!(matches!(camera.shoot(), Err(CameraError::NoPhotograph { .. })));
    }

    #[test]
    fn a_command_shoots_and_its_failure_is_told() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("elsewhere")).unwrap();
        image(7).write_png(&folder.path().join("elsewhere/shot.png")).unwrap();
        let mut camera_ = camera(folder.path(), &["cp", "elsewhere/shot.png", "."]);
        assert_eq!(camera_.shoot().unwrap(), Frame::Developed(image(7)));
        let error = camera(folder.path(), &["cp", "no-such-file", "."]).shoot().unwrap_err().to_string();
        assert!(error.contains("cp: exit status: 1") && error.contains("no-such-file"), "{error}");
    }

    #[test]
    fn damaged_and_ill_sized_photographs_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let mut camera = camera(folder.path(), &[]);
        fs::write(folder.path().join("1.png"), &image(1).png().unwrap()[..30]).unwrap();
        assert!(matches!(camera.shoot(), Err(CameraError::Incomplete(_))));
        Image { width: 2, height: 1, data: vec![0; 6] }.write_png(&folder.path().join("2.png")).unwrap();
        let error = camera.shoot().unwrap_err().to_string();
        assert!(error.contains("is 2x1, not 4x3"), "{error}");
    }
}
