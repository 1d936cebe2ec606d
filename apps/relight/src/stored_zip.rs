//! Zips of pictures, stored as they are: PNG files do not shrink further.

use std::io::{self, Write};

use rawzip::{CompressionMethod, ZipArchiveWriter};

/// Adds a file that anybody may read.
///
/// # Errors
/// If it cannot be written, or the name is none for a zip.
pub fn add<W: Write>(zip: &mut ZipArchiveWriter<W>, name: &str, bytes: &[u8]) -> io::Result<()> {
    let file = zip.new_file(name).compression_method(CompressionMethod::STORE).unix_permissions(0o100_644);
    let (mut entry, config) = file.start().map_err(io::Error::other)?;
    let mut data = config.wrap(&mut entry);
    data.write_all(bytes)?;
    let (_, descriptor) = data.finish().map_err(io::Error::other)?;
    entry.finish(descriptor).map_err(io::Error::other)?;
    Ok(())
}
