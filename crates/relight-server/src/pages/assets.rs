//! The style, the script and the icon: parts of the program, under names that change with what they hold.

use std::sync::LazyLock;

use sha2::{Digest, Sha256};

use crate::receipt::to_hex;

/// A file that pages refer to.
pub struct Asset {
    /// What kind of file it is.
    pub kind: &'static str,
    /// What it holds.
    pub text: &'static str,
    file: String,
}

impl Asset {
    fn new(name: &str, extension: &str, kind: &'static str, text: &'static str) -> Asset {
        let hash = to_hex(&Sha256::digest(text));
        Asset { kind, text, file: format!("{name}-{}.{extension}", &hash[..16]) }
    }

    /// Where it is.
    pub fn address(&self) -> String {
        format!("/static/{}", self.file)
    }
}

/// The style of all pages.
pub static STYLE: LazyLock<Asset> = LazyLock::new(|| {
    Asset::new("style", "css", "text/css; charset=utf-8", include_str!("../static/style.css"))
});
/// What pages do beyond what they do without it.
pub static SCRIPT: LazyLock<Asset> = LazyLock::new(|| {
    Asset::new("script", "js", "text/javascript; charset=utf-8", include_str!("../static/script.js"))
});
/// The icon.
pub static ICON: LazyLock<Asset> =
    LazyLock::new(|| Asset::new("icon", "svg", "image/svg+xml", include_str!("../static/icon.svg")));

/// The asset of that file name.
pub fn find(file: &str) -> Option<&'static Asset> {
    [&STYLE, &SCRIPT, &ICON].into_iter().map(|asset| &**asset).find(|asset| asset.file == file)
}
