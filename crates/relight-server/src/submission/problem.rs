//! What can be wrong with a zip, and how it is said.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Characters of an entry's name that are shown.
const SHOWN: usize = 200;

/// What is wrong with an entry or with the zip: stable names for machines, explained in `docs/submissions.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Code {
    /// The file is no zip.
    NotAZip,
    /// The zip has more bytes than it may have.
    ZipTooLarge,
    /// The zip's directory or an entry's header is cut off or contradicts itself.
    ZipDamaged,
    /// Bytes that belong to no entry.
    HiddenData,
    /// Two entries share bytes of the zip.
    OverlappingEntries,
    /// The zip has more entries than it may have.
    TooManyEntries,
    /// All entries together unpack to more bytes than they may.
    TotalTooLarge,
    /// An entry unpacks to more bytes than its image can need.
    EntryTooLarge,
    /// An entry is packed more tightly than any image.
    Ratio,
    /// An entry's own header says something else than the zip's directory.
    HeaderMismatch,
    /// An entry is encrypted.
    Encrypted,
    /// An entry is packed in another way than stored or deflated.
    CompressionMethod,
    /// An entry is a symbolic link.
    Symlink,
    /// An entry is a device, a pipe or a socket.
    SpecialFile,
    /// An entry's name is not text.
    NameEncoding,
    /// An entry's name is an absolute path.
    AbsolutePath,
    /// An entry's name climbs out of its folder.
    PathTraversal,
    /// An entry is a folder, or lies in one.
    InFolder,
    /// Two entries have the same name.
    DuplicateName,
    /// An entry's name would be right in other letters: capitals, or another encoding of the same text.
    NameSpelling,
    /// An entry that the benchmark does not ask for.
    UnexpectedEntry,
    /// An image that the benchmark asks for is not there.
    MissingImage,
    /// None of the images that the benchmark asks for is there.
    NoImages,
    /// An entry's packed bytes cannot be unpacked.
    PackedDamaged,
    /// An entry unpacks to another number of bytes than stated.
    SizeMismatch,
    /// An entry's bytes do not have the stated checksum.
    ChecksumMismatch,
    /// An image is no PNG file.
    NotPng,
    /// A PNG file is cut off.
    PngTruncated,
    /// A PNG file is damaged or breaks the rules of the format.
    PngDamaged,
    /// A part of a PNG file does not have its checksum.
    PngChecksum,
    /// Bytes follow the end of a PNG file.
    PngTrailingData,
    /// An image has more pixels than are ever decoded.
    TooManyPixels,
    /// An image is not of its camera's size.
    WrongSize,
    /// An image has another number of bits a channel than eight.
    PngBitDepth,
    /// An image has a palette.
    PngPalette,
    /// An image is grey.
    PngGrey,
    /// An image has transparency.
    PngAlpha,
    /// An image is interlaced.
    PngInterlaced,
    /// An image is animated.
    PngAnimated,
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// One thing wrong with a zip.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// What it is, for machines.
    pub code: Code,
    /// The entry at fault, made fit to print; none if it is the zip itself.
    pub entry: Option<String>,
    /// What is wrong and how to mend it.
    pub message: String,
}

impl Problem {
    /// A problem of the zip itself.
    pub(crate) fn of_zip(code: Code, message: impl Into<String>) -> Problem {
        Problem { code, entry: None, message: message.into() }
    }

    /// A problem of an entry, whatever bytes its name has.
    pub(crate) fn of_entry(code: Code, name: &[u8], message: impl Into<String>) -> Problem {
        Problem { code, entry: Some(printable(name)), message: message.into() }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} [{}]", self.entry.as_deref().unwrap_or("the zip"), self.message, self.code)
    }
}

/// Why a zip is no submission.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("the zip is no submission to this benchmark; {}", told(problems, *more))]
pub struct Refusal {
    /// What is wrong, at least one thing.
    pub problems: Vec<Problem>,
    /// How many more problems there are.
    pub more: usize,
}

fn told(problems: &[Problem], more: usize) -> String {
    match (problems.first(), problems.len() + more) {
        (None, _) => "nothing is told of why".to_owned(),
        (Some(first), 1) => first.to_string(),
        (Some(first), all) => format!("the first of {all} problems: {first}"),
    }
}

/// Problems as they are found; those beyond a number are only counted.
pub(crate) struct Problems {
    found: Vec<Problem>,
    more: usize,
    most: usize,
}

impl Problems {
    /// None yet, and at most so many to keep.
    pub(crate) fn new(most: usize) -> Problems {
        Problems { found: Vec::new(), more: 0, most: most.max(1) }
    }

    pub(crate) fn push(&mut self, problem: Problem) {
        if self.found.len() < self.most { self.found.push(problem) } else { self.more += 1 }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// A refusal, if there is any problem.
    pub(crate) fn into_result(self) -> Result<(), Refusal> {
        if self.is_empty() { Ok(()) } else { Err(Refusal { problems: self.found, more: self.more }) }
    }
}

/// A name that may be shown on terminals and pages: without control characters, and not longer than a line or two.
fn printable(name: &[u8]) -> String {
    // A character has at most four bytes: long names are cut before they are looked at.
    let shown = String::from_utf8_lossy(&name[..name.len().min(4 * SHOWN)]);
    let is_fit = |c: &char| !c.is_control() && !is_direction_mark(*c);
    let mut text: String =
        shown.chars().take(SHOWN).map(|c| if is_fit(&c) { c } else { char::REPLACEMENT_CHARACTER }).collect();
    if shown.chars().count() > SHOWN || name.len() > 4 * SHOWN {
        text.push('…');
    }
    text
}

/// Characters that reorder the text round them, so that a name looks like another.
fn is_direction_mark(c: char) -> bool {
    matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_read_as_they_are_written() {
        assert_eq!(Code::NotAZip.to_string(), "not-a-zip");
        assert_eq!(serde_json::to_string(&Code::PngBitDepth).unwrap(), "\"png-bit-depth\"");
    }

    #[test]
    fn names_are_made_fit_to_print() {
        assert_eq!(printable(b"a\n\x1b[31mb\xff.png"), "a\u{fffd}\u{fffd}[31mb\u{fffd}.png");
        assert_eq!(printable("a\u{202e}gnp.b".as_bytes()), "a\u{fffd}gnp.b");
        assert_eq!(printable(&[b'x'; 70_000]).chars().count(), SHOWN + 1);
    }

    #[test]
    fn problems_beyond_a_number_are_counted() {
        let mut problems = Problems::new(2);
        for _ in 0..5 {
            problems.push(Problem::of_zip(Code::NotAZip, "is none"));
        }
        let refusal = problems.into_result().unwrap_err();
        assert_eq!((refusal.problems.len(), refusal.more), (2, 3));
        assert!(refusal.to_string().contains("first of 5 problems"), "{refusal}");
    }
}
