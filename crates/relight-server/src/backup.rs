//! Backups: one tar file of all that a server knows, and the way back.
//!
//! ```text
//! relight-backup.json    {"format":"relight-backup","version":1,…}
//! server.db              the database as of one moment
//! receipt-key
//! submissions/ID.zip, pictures/ID/…png
//! SHA256SUMS             of all files before it, as `sha256sum --check` reads it; last, so that a torn backup has none
//! ```
//! The benchmarks' ground truth is not in it: it lies where the admin put it, and is not the server's.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};

use relight_scene::write_whole;

use crate::data_folder::{DataFolder, FolderError, io_at};
use crate::digest::{Hashing, sha256};
use crate::receipt::{KeyError, ReceiptKey};
use crate::store::{Store, StoreError};
use crate::time::Time;

/// The first file's name.
const HEAD: &str = "relight-backup.json";
/// The last file's name.
const SUMS: &str = "SHA256SUMS";
/// The format's version.
const VERSION: u64 = 1;
/// The longest list of sums, bytes.
const LONGEST: u64 = 1 << 28;

/// Why there is no backup, or none was restored.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// A file or folder.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The database.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The key of receipts.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The file is no backup, or a damaged one.
    #[error("{path}: {problem}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// There is something where the backup would be restored.
    #[error("{0}: is there already. Restore to another folder, or move this one away")]
    Occupied(PathBuf),
}

/// Writes a backup to `file` while a server may be running; how many files it holds. Without `zips`, zips of submissions that
/// have scores are left out: they are most of it, and only those that wait are needed to go on.
///
/// # Errors
/// [`BackupError`]; no file is left then.
pub async fn backup(
    folder: &DataFolder,
    store: &Store,
    file: &Path,
    zips: bool,
) -> Result<usize, BackupError> {
    let beside = file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let scratch = tempfile::tempdir_in(beside).map_err(io_at(beside))?;
    let copy = scratch.path().join("server.db");
    store.copy_to(&copy).await?;
    // What the copy speaks of, not what there is by now.
    let copied = Store::open(&copy).await?;
    let (kept, waiting) = (copied.kept_zips().await?, copied.waiting().await?);
    copied.close().await;
    // The server makes it at its first start, which may be still to come.
    ReceiptKey::open(&folder.receipt_key())?;
    let mut files = vec![("server.db".to_owned(), copy), ("receipt-key".to_owned(), folder.receipt_key())];
    for id in kept.keys() {
        if zips || waiting.contains(id) {
            files.push((format!("submissions/{id}.zip"), folder.zip(id)));
        }
        let pictures = folder.pictures_of(id);
        if pictures.is_dir() {
            for entry in fs::read_dir(&pictures).map_err(io_at(&pictures))? {
                let entry = entry.map_err(io_at(&pictures))?;
                files.push((format!("pictures/{id}/{}", entry.file_name().to_string_lossy()), entry.path()));
            }
        }
    }
    let mut count = 0;
    write_whole(file, |out| {
        count = write_tar(out, &files)?;
        Ok(())
    })
    .map_err(io_at(file))?;
    Ok(count)
}

/// Writes all files that are still there, then their sums.
fn write_tar(out: &mut File, files: &[(String, PathBuf)]) -> io::Result<usize> {
    let mut tar = tar::Builder::new(io::BufWriter::new(out));
    let mut sums = String::new();
    let head = format!(
        "{{\"format\":\"relight-backup\",\"version\":{VERSION},\"made_at\":\"{}\",\"relight\":\"{}\"}}\n",
        Time::now(),
        env!("CARGO_PKG_VERSION")
    );
    append(&mut tar, HEAD, head.len() as u64, &mut head.as_bytes())?;
    let mut count = 0;
    for (name, path) in files {
        let mut file = match File::open(path) {
            Ok(file) => file,
            // Withdrawn or refused since the database was copied: a server started from the backup copes with it.
            Err(error) if error.kind() == io::ErrorKind::NotFound && name.contains('/') => continue,
            Err(error) => return Err(error),
        };
        let length = file.metadata()?.len();
        let mut hashing = Hashing::new((&mut file).take(length));
        append(&mut tar, name, length, &mut hashing)?;
        sums.push_str(&format!("{}  {name}\n", hashing.finish()));
        count += 1;
    }
    append(&mut tar, SUMS, sums.len() as u64, &mut sums.as_bytes())?;
    tar.into_inner()?.flush()?;
    Ok(count)
}

fn append(
    tar: &mut tar::Builder<impl Write>,
    name: &str,
    length: u64,
    data: &mut dyn Read,
) -> io::Result<()> {
    let mut header = tar::Header::new_gnu();
    header.set_size(length);
    header.set_mode(0o600);
    header.set_mtime(Time::now().0.unsigned_abs() / 1000);
    tar.append_data(&mut header, name, data)
}

/// Restores a backup to `root`, which must not exist or be empty. Everything is checked before it gets its name.
///
/// # Errors
/// [`BackupError`]; nothing is left then.
pub async fn restore(file: &Path, root: &Path) -> Result<usize, BackupError> {
    let empty = match fs::read_dir(root) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => true,
        Err(error) => return Err(io_at(root)(error).into()),
    };
    if !empty {
        return Err(BackupError::Occupied(root.to_owned()));
    }
    let beside = root.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let scratch = tempfile::tempdir_in(beside).map_err(io_at(beside))?;
    let damaged = |problem: String| BackupError::Damaged { path: file.to_owned(), problem };
    let data = scratch.path().join("data");
    let count = unpack(file, &data).map_err(|error| damaged(error.to_string()))?;
    let folder = DataFolder::open(&data)?;
    // Refuses a database of another format.
    let store = Store::open(&folder.database()).await?;
    let kept = store.kept_zips().await?;
    store.close().await;
    for (id, sum) in &kept {
        let zip = folder.zip(id);
        if zip.is_file() && sha256(&zip).map_err(io_at(&zip))? != *sum {
            return Err(damaged(format!("the zip of submission {id} is not the one that was submitted")));
        }
    }
    if root.is_dir() {
        fs::remove_dir(root).map_err(io_at(root))?;
    }
    fs::rename(&data, root).map_err(io_at(root))?;
    Ok(count)
}

/// Unpacks into a new folder and holds all against the sums; how many files there are.
fn unpack(file: &Path, data: &Path) -> io::Result<usize> {
    let bad = |problem: String| io::Error::new(io::ErrorKind::InvalidData, problem);
    let mut archive = tar::Archive::new(io::BufReader::new(File::open(file)?));
    let mut found = BTreeMap::new();
    let mut listed = None;
    for (index, entry) in archive.entries()?.enumerate() {
        let mut entry = entry.map_err(|error| bad(format!("is no whole backup: {error}")))?;
        let name = entry.path()?.to_string_lossy().into_owned();
        if index == 0 {
            check_head(&name, &mut entry)?;
            continue;
        }
        if listed.is_some() || !entry.header().entry_type().is_file() {
            return Err(bad(format!("holds {name}, which no backup of ours does")));
        }
        if name == SUMS {
            let mut text = String::new();
            entry.take(LONGEST).read_to_string(&mut text)?;
            listed = Some(text);
            continue;
        }
        let path = data
            .join(place(&name).ok_or_else(|| bad(format!("holds {name}, which no backup of ours does")))?);
        fs::create_dir_all(path.parent().unwrap_or(data))?;
        let mut out = File::options().write(true).create_new(true).open(&path)?;
        let mut hashing = Hashing::new(entry);
        io::copy(&mut hashing, &mut out)?;
        out.sync_all()?;
        found.insert(name, hashing.finish());
    }
    let listed = listed.ok_or_else(|| bad(format!("is torn: it does not end with {SUMS}")))?;
    let sums: String = found.iter().map(|(name, sum)| format!("{sum}  {name}\n")).collect();
    let sorted = |text: &str| {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.sort();
        lines
    };
    if sorted(&listed) != sorted(&sums) {
        return Err(bad(format!("is damaged: its files are not those of its {SUMS}")));
    }
    keep_private(&data.join("receipt-key"))?;
    Ok(found.len())
}

fn check_head(name: &str, entry: &mut impl Read) -> io::Result<()> {
    let bad = |problem: String| io::Error::new(io::ErrorKind::InvalidData, problem);
    let mut text = String::new();
    entry.take(10_000).read_to_string(&mut text)?;
    let head: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    match head.get("version").and_then(serde_json::Value::as_u64) {
        Some(VERSION) if name == HEAD && head["format"] == "relight-backup" => Ok(()),
        Some(version) if name == HEAD => {
            Err(bad(format!("is a backup of format {version}, and only {VERSION} is known")))
        }
        _ => Err(bad("is no backup of a relight server".to_owned())),
    }
}

/// Where a file of a backup goes, if it is one that a backup holds.
fn place(name: &str) -> Option<&Path> {
    let path = Path::new(name);
    let parts: Option<Vec<&str>> = path
        .components()
        .map(|part| match part {
            Component::Normal(part) => part.to_str(),
            _ => None,
        })
        .collect();
    let fits = match parts?.as_slice() {
        ["server.db" | "receipt-key"] => true,
        ["submissions", file] => file.ends_with(".zip"),
        ["pictures", _, file] => file.ends_with(".png"),
        _ => false,
    };
    fits.then_some(path)
}

#[cfg(unix)]
fn keep_private(path: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(path, fs::Permissions::from_mode(0o600))
}

#[cfg(not(unix))]
fn keep_private(_: &Path) -> io::Result<()> {
    Ok(())
}
