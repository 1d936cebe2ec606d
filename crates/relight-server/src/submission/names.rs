//! Which image an entry is, by its name.

use std::cell::OnceCell;
use std::collections::HashMap;

use unicode_normalization::UnicodeNormalization;

use super::problem::{Code, Problem};
use crate::benchmark::Benchmark;

/// Longer names are no image's.
const LONGEST: usize = 1024;

/// Finds a benchmark's images by the names of entries, and says what is wrong with other names.
pub(super) struct Names<'a> {
    benchmark: &'a Benchmark,
    /// The right name of each [`folded`] one, made when it is first needed.
    by_folded: OnceCell<HashMap<String, &'a str>>,
}

impl<'a> Names<'a> {
    pub(super) fn new(benchmark: &'a Benchmark) -> Names<'a> {
        Names { benchmark, by_folded: OnceCell::new() }
    }

    /// Scene and image of an entry, as indices.
    pub(super) fn find(&self, name: &[u8]) -> Result<(usize, usize), Problem> {
        let problem = |code, message: String| Problem::of_entry(code, name, message);
        let Ok(text) = std::str::from_utf8(name) else {
            let message = "the name is not UTF-8: zip with a program that writes names as UTF-8";
            return Err(problem(Code::NameEncoding, message.to_owned()));
        };
        if let Some(found) = self.benchmark.find(text) {
            return Ok(found);
        }
        if is_absolute(text) {
            let message = "the name is an absolute path: images lie at the root of the zip, without a folder";
            return Err(problem(Code::AbsolutePath, message.to_owned()));
        }
        if text.split(['/', '\\']).any(|part| part == "..") {
            let message = "the name leads out of the zip: images lie at its root, without a folder";
            return Err(problem(Code::PathTraversal, message.to_owned()));
        }
        if text.contains(['/', '\\']) {
            return Err(problem(Code::InFolder, in_folder(text)));
        }
        if let Some(right) = self.right_spelling(text) {
            return Err(problem(Code::NameSpelling, format!("is spelt otherwise: rename it to {right}")));
        }
        Err(problem(Code::UnexpectedEntry, self.unexpected(text)))
    }

    fn right_spelling(&self, name: &str) -> Option<&str> {
        let by_folded = self.by_folded.get_or_init(|| {
            let images = self.benchmark.scenes.iter().flat_map(|scene| &scene.images);
            images.map(|image| (folded(&image.entry), image.entry.as_str())).collect()
        });
        if name.len() > LONGEST { None } else { by_folded.get(&folded(name)).copied() }
    }

    fn unexpected(&self, name: &str) -> String {
        let example = self.benchmark.scenes.iter().flat_map(|scene| &scene.images).next_back();
        let example = example.map_or("", |image| &image.entry);
        let is_png = name.len() >= 4 && name.as_bytes()[name.len() - 4..].eq_ignore_ascii_case(b".png");
        let what = if is_png { "this image" } else { "such a file" };
        format!(
            "the benchmark does not ask for {what}: leave it out. Images are named {{scene}}_{{light}}_{{camera}}.png with two \
             digits each, such as {example}"
        )
    }
}

fn in_folder(name: &str) -> String {
    if name.starts_with("__MACOSX") {
        "macOS adds such entries: zip on the command line with `zip -X`, or leave them out".to_owned()
    } else if name.ends_with('/') {
        "is a folder: images lie at the root of the zip, so zip the files rather than their folder".to_owned()
    } else {
        "lies in a folder: images lie at the root of the zip, so zip the files rather than their folder"
            .to_owned()
    }
}

/// Whether a name is absolute on any system.
fn is_absolute(name: &str) -> bool {
    let bytes = name.as_bytes();
    name.starts_with(['/', '\\'])
        || bytes.first().is_some_and(u8::is_ascii_alphabetic) && bytes.get(1) == Some(&b':')
}

/// A form in which names are equal that some file system takes for the same.
fn folded(name: &str) -> String {
    name.nfkc().flat_map(char::to_lowercase).nfkc().collect()
}
