//! The folder in which a server keeps all that it knows.
//!
//! ```text
//! server.db (and -wal, -shm)   the database: users, benchmarks, submissions, scores, audit log
//! receipt-key                  the key that signs receipts, readable by its owner alone
//! submissions/ID.zip           what was submitted; appears whole, by renaming
//! pictures/ID/…png             pictures of validation images, made while scoring; appear as a whole folder
//! incoming/                    zips that are being received; emptied at every start
//! scoring/                     pictures that are being drawn; emptied at every start
//! server.lock                  held by the one process that serves
//! ```
//! The format's version is the database's (`PRAGMA user_version`): the folder is of no use without it.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

/// Why a data folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// A file or folder in it cannot be read, made or removed.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What happened.
        source: io::Error,
    },
    /// There is no server's data.
    #[error(
        "{0}: holds no server's data. `relight serve --data DIR` or `relight serve admin --data DIR add-benchmark …` makes it"
    )]
    Empty(PathBuf),
    /// Another process serves it.
    #[error("{0}: another relight server serves this folder. Stop it first, or name another folder")]
    Served(PathBuf),
}

/// Names what failed.
pub(crate) fn io_at(path: &Path) -> impl FnOnce(io::Error) -> FolderError {
    let path = path.to_owned();
    move |source| FolderError::Io { path, source }
}

/// A server's folder.
#[derive(Clone, Debug)]
pub struct DataFolder {
    root: PathBuf,
}

/// Held while a process serves.
#[derive(Debug)]
pub struct Serving {
    _lock: File,
}

impl DataFolder {
    /// The folder at `root`, made if there is none.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn create(root: &Path) -> Result<DataFolder, FolderError> {
        let folder = DataFolder { root: root.to_owned() };
        for inner in [
            folder.root.clone(),
            folder.submissions(),
            folder.pictures(),
            folder.incoming(),
            folder.scoring(),
        ] {
            fs::create_dir_all(&inner).map_err(io_at(&inner))?;
        }
        keep_private(root).map_err(io_at(root))?;
        // Absolute, for it is handed to other processes.
        folder.root.canonicalize().map(|root| DataFolder { root }).map_err(io_at(&folder.root))
    }

    /// The folder at `root`.
    ///
    /// # Errors
    /// If no server's data is there.
    pub fn open(root: &Path) -> Result<DataFolder, FolderError> {
        let folder = DataFolder { root: root.to_owned() };
        if !folder.database().is_file() {
            return Err(FolderError::Empty(root.to_owned()));
        }
        DataFolder::create(root)
    }

    /// Claims the right to serve, for as long as what is returned lives.
    ///
    /// # Errors
    /// [`FolderError::Served`] if another process has it.
    pub fn serve(&self) -> Result<Serving, FolderError> {
        let path = self.root.join("server.lock");
        let lock =
            File::options().create(true).truncate(false).write(true).open(&path).map_err(io_at(&path))?;
        match lock.try_lock() {
            Ok(()) => Ok(Serving { _lock: lock }),
            Err(TryLockError::WouldBlock) => Err(FolderError::Served(self.root.clone())),
            Err(TryLockError::Error(error)) => Err(io_at(&path)(error)),
        }
    }

    /// The database.
    pub fn database(&self) -> PathBuf {
        self.root.join("server.db")
    }

    /// The key that signs receipts.
    pub fn receipt_key(&self) -> PathBuf {
        self.root.join("receipt-key")
    }

    /// Folder of the submitted zips.
    pub fn submissions(&self) -> PathBuf {
        self.root.join("submissions")
    }

    /// The zip of a submission.
    pub fn zip(&self, id: &str) -> PathBuf {
        self.submissions().join(format!("{id}.zip"))
    }

    /// Folder of the folders of pictures.
    pub fn pictures(&self) -> PathBuf {
        self.root.join("pictures")
    }

    /// Folder of the pictures of a submission: see [`crate::worker::pictures`].
    pub fn pictures_of(&self, id: &str) -> PathBuf {
        self.pictures().join(id)
    }

    /// Folder of zips that have not come whole.
    pub fn incoming(&self) -> PathBuf {
        self.root.join("incoming")
    }

    /// Folder of what scorers are making.
    pub fn scoring(&self) -> PathBuf {
        self.root.join("scoring")
    }

    /// Removes what a server that was killed left behind: all that is unfinished, and zips and pictures that are not `kept`,
    /// by the names of their submissions. For the one process that serves, before it does.
    ///
    /// # Errors
    /// What cannot be removed.
    pub fn sweep(&self, kept: impl Fn(&str) -> bool) -> Result<(), FolderError> {
        for path in list(&self.incoming())?.into_iter().chain(list(&self.scoring())?) {
            remove(&path)?;
        }
        for path in list(&self.submissions())?.into_iter().chain(list(&self.pictures())?) {
            let id = path.file_stem().and_then(|stem| stem.to_str());
            if !id.is_some_and(&kept) {
                remove(&path)?;
            }
        }
        Ok(())
    }

    /// Removes the zip and the pictures of a submission, if there are any.
    ///
    /// # Errors
    /// What cannot be removed.
    pub fn forget(&self, id: &str) -> Result<(), FolderError> {
        remove(&self.zip(id))?;
        remove(&self.pictures_of(id))
    }
}

fn list(folder: &Path) -> Result<Vec<PathBuf>, FolderError> {
    let entries = fs::read_dir(folder).map_err(io_at(folder))?;
    entries.map(|entry| entry.map(|entry| entry.path()).map_err(io_at(folder))).collect()
}

/// How often a folder is tried to be removed that someone writes into.
const TRIES: u32 = 100;
/// Between two tries.
const BETWEEN: Duration = Duration::from_millis(50);

/// Removes a file or a folder, if there is one. The scorer of a server that was killed may write for a moment more.
pub(crate) fn remove(path: &Path) -> Result<(), FolderError> {
    let mut tries = 0;
    loop {
        let removed = match fs::symlink_metadata(path) {
            Ok(metadata) if metadata.is_dir() => fs::remove_dir_all(path),
            Ok(_) => fs::remove_file(path),
            Err(error) => Err(error),
        };
        match removed {
            Err(error) if error.kind() == ErrorKind::DirectoryNotEmpty && tries < TRIES => {
                tries += 1;
                thread::sleep(BETWEEN);
            }
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(io_at(path)(error)),
            _ => return Ok(()),
        }
    }
}

/// Makes the names in a folder survive a loss of power.
pub(crate) fn sync_folder(folder: &Path) -> Result<(), FolderError> {
    #[cfg(unix)]
    File::open(folder).and_then(|file| file.sync_all()).map_err(io_at(folder))?;
    Ok(())
}

/// Addresses, hashes and unpublished submissions are nobody else's.
#[cfg(unix)]
fn keep_private(root: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(root, fs::Permissions::from_mode(0o700))
}

#[cfg(not(unix))]
fn keep_private(_: &Path) -> io::Result<()> {
    Ok(())
}
