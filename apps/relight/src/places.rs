//! Whether something can be written somewhere, found out before the work that makes it.

use std::path::Path;

use anyhow::ensure;

/// Checks that a file can be made at `path`: that its folder is there, and no folder is in its place.
pub fn check_file(path: &Path) -> anyhow::Result<()> {
    ensure!(!path.is_dir(), "{}: is a folder; name a file", path.display());
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    ensure!(
        folder.is_dir(),
        "{}: there is no folder {}; make it, or choose another place",
        path.display(),
        folder.display()
    );
    Ok(())
}

/// Checks that a folder can be at `path`: that no file is in its place.
pub fn check_folder(path: &Path) -> anyhow::Result<()> {
    ensure!(!path.is_file(), "{}: is a file; name a folder", path.display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_need_a_folder_and_a_name_of_their_own() {
        check_file(Path::new("picture.png")).unwrap();
        let missing = check_file(Path::new("/nowhere/picture.png")).unwrap_err().to_string();
        assert!(missing.contains("/nowhere/picture.png: there is no folder /nowhere;"), "{missing}");
        assert!(check_file(Path::new(".")).unwrap_err().to_string().contains("name a file"));
    }
}
