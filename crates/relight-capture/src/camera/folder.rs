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

/// Takes the photographs that appear in a folder from when it is asked for one. A command may be given that shoots (`gphoto2
/// --capture-image-and-download`, say); without one, somebody or something else is to press the button. Of the files of one
/// photograph (raw and developed, say) one may be an image that can be read.
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
        // What has come since the last photograph is of another moment.
        self.seen.extend(files(&self.folder)?);
        self.press()?;
        let started = Instant::now();
        loop {
            // A file that is still being written cannot be read whole: it is looked at again until time is up.
            let new = files(&self.folder)?.into_iter().filter(|path| !self.seen.contains(path));
            let (mut images, mut others) = (Vec::new(), Vec::new());
            for path in new {
                match read_image(&path) {
                    Ok(image) => images.push((image, path)),
                    Err(error) => others.push((error, path)),
                }
            }
            if let [(_, first), (_, second), ..] = &images[..] {
                return Err(CameraError::Failed {
                    problem: format!("{} and {} have come at once", first.display(), second.display()),
                    mend: "Let the camera save one image of each photograph.",
                });
            }
            match (images.pop(), others.pop()) {
                (Some((image, path)), _) => {
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
                (None, Some((error, path))) if started.elapsed() > self.patience => {
                    self.seen.insert(path);
                    return Err(CameraError::Incomplete(error.to_string()));
                }
                (None, None) if started.elapsed() > self.patience => {
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
        // One that came while nobody asked: the button was pressed on the way, or a second file is late.
        image(2).write_png(&folder.path().join("2.png")).unwrap();
        assert!(matches!(camera.shoot(), Err(CameraError::NoPhotograph { .. })));
        let later = folder.path().join("3.png");
        let pressed = std::thread::spawn(move || {
            sleep(Duration::from_millis(100));
            image(3).write_png(&later).unwrap();
        });
        assert_eq!(camera.shoot().unwrap(), Frame::Developed(image(3)));
        pressed.join().unwrap();
        assert!(matches!(camera.shoot(), Err(CameraError::NoPhotograph { .. })));
    }

    #[test]
    fn a_raw_file_beside_the_image_is_left_alone_and_two_images_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let shelf = folder.path().join("elsewhere");
        fs::create_dir(&shelf).unwrap();
        fs::write(shelf.join("1.raw"), "no image").unwrap();
        image(7).write_png(&shelf.join("2.png")).unwrap();
        image(8).write_png(&shelf.join("3.png")).unwrap();
        let mut both = camera(folder.path(), &["cp", "elsewhere/1.raw", "elsewhere/2.png", "."]);
        assert_eq!(both.shoot().unwrap(), Frame::Developed(image(7)));
        fs::remove_file(folder.path().join("2.png")).unwrap();
        let mut two = camera(folder.path(), &["cp", "elsewhere/2.png", "elsewhere/3.png", "."]);
        let error = two.shoot().unwrap_err().to_string();
        assert!(error.contains("2.png and") && error.contains("3.png have come at once"), "{error}");
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
        let shelf = folder.path().join("elsewhere");
        fs::create_dir(&shelf).unwrap();
        fs::write(shelf.join("1.png"), &image(1).png().unwrap()[..30]).unwrap();
        Image { width: 2, height: 1, data: vec![0; 6] }.write_png(&shelf.join("2.png")).unwrap();
        let mut damaged = camera(folder.path(), &["cp", "elsewhere/1.png", "."]);
        assert!(matches!(damaged.shoot(), Err(CameraError::Incomplete(_))));
        let error = camera(folder.path(), &["cp", "elsewhere/2.png", "."]).shoot().unwrap_err().to_string();
        assert!(error.contains("is 2x1, not 4x3"), "{error}");
    }
}
