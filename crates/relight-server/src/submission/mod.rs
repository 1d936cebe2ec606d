//! Whether a zip is a submission.
//!
//! Uploads are hostile: a zip is refused for anything that an honest one does not have, every refusal says which entry, why and
//! how to mend it, and nothing is unpacked, decoded or allocated beyond what the benchmark's own images can need.

mod archive;
mod entry;
mod names;
mod picture;
mod problem;

use std::fs::File;
use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use relight_scene::Split;

pub use problem::{Code, Problem, Refusal};

use crate::benchmark::{Benchmark, SCORED, TestImage};
use crate::parallel::{Progress, in_parallel};
use archive::Packed;
use entry::{EntryError, unpack};
use names::Names;
use problem::Problems;

/// What a zip may hold at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of the zip.
    pub zip_bytes: u64,
    /// Entries of the zip.
    pub entries: usize,
    /// Bytes of one entry, unpacked. Besides, an entry may not be much longer than its image's pixels.
    pub entry_bytes: u64,
    /// Bytes of all entries together, unpacked.
    pub total_bytes: u64,
    /// Unpacked bytes of an entry for each of its packed ones.
    pub ratio: u64,
    /// Pixels of an image.
    pub pixels: u64,
    /// Problems told; the others are only counted.
    pub problems: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            zip_bytes: 16 << 30,
            entries: 20_000,
            entry_bytes: 256 << 20,
            total_bytes: 16 << 30,
            ratio: 200,
            pixels: 1 << 26,
            problems: 1000,
        }
    }
}

/// A zip whose entries are the images that a benchmark asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submission {
    /// The zip.
    pub zip: PathBuf,
    /// Bytes of the zip.
    pub bytes: u64,
    /// The splits that it shows, each whole: validation, or easy and hard, or all three.
    pub splits: Vec<Split>,
    /// Its images, in the benchmark's order.
    pub images: Vec<SubmittedImage>,
}

/// An image of a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SubmittedImage {
    /// Index of its scene in the benchmark.
    pub scene: usize,
    /// Index of the image in its scene.
    pub image: usize,
    packed: Packed,
}

/// Why a zip was not checked to its end, or did not pass.
#[derive(Debug, thiserror::Error)]
pub enum SubmissionError {
    /// It is no submission.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// It cannot be read from the disk. No fault of its own.
    #[error("{path}: cannot be read: {source}")]
    Io {
        /// The zip.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The caller asked to stop.
    #[error("stopped before all images were checked")]
    Stopped,
}

/// Holds a zip against a benchmark as far as that goes without unpacking its images: structure, names, stated sizes and ratios,
/// which images are there. Takes milliseconds; ground truth is not looked at.
///
/// # Errors
/// [`SubmissionError::Refused`] with all that is wrong.
pub fn inspect(zip: &Path, benchmark: &Benchmark, limits: &Limits) -> Result<Submission, SubmissionError> {
    let unreadable = |source| SubmissionError::Io { path: zip.to_owned(), source };
    let file = File::open(zip).map_err(unreadable)?;
    let metadata = file.metadata().map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(unreadable(io::Error::other("is not a file")));
    }
    let bytes = metadata.len();
    if bytes > limits.zip_bytes {
        let message = format!("has {bytes} bytes, and at most {} are taken", limits.zip_bytes);
        let problems = vec![Problem::of_zip(Code::ZipTooLarge, message)];
        return Err(Refusal { problems, more: 0 }.into());
    }
    let mut problems = Problems::new(limits.problems);
    let mut found: Vec<Vec<Option<Packed>>> =
        benchmark.scenes.iter().map(|scene| vec![None; scene.images.len()]).collect();
    let names = Names::new(benchmark);
    let seen_whole = archive::walk(file, limits, &mut problems, &mut |name, packed, problems| {
        check_size(name, &packed, limits, problems);
        match names.find(name) {
            Ok((scene, image)) => {
                let place = &mut found[scene][image];
                if place.is_some() {
                    let message = "is there twice: leave out one of the two";
                    problems.push(Problem::of_entry(Code::DuplicateName, name, message));
                }
                let most = longest_png(&benchmark.scenes[scene].images[image]);
                if packed.unpacked <= limits.entry_bytes && packed.unpacked > most {
                    problems.push(too_large(name, &packed, most));
                }
                *place = Some(packed);
            }
            Err(problem) => problems.push(problem),
        }
    })
    .map_err(unreadable)?;
    // Nothing is called missing that may only not have been reached.
    let splits = if seen_whole { check_completeness(benchmark, &found, &mut problems) } else { Vec::new() };
    problems.into_result()?;
    let packed = found.into_iter().enumerate().flat_map(|(scene, images)| {
        let images = images.into_iter().enumerate();
        images.filter_map(move |(image, packed)| Some(SubmittedImage { scene, image, packed: packed? }))
    });
    Ok(Submission { zip: zip.to_owned(), bytes, splits, images: packed.collect() })
}

/// [`inspect`], and decodes every image: all rules that a submission must keep. Ground truth is not looked at. As many images at a
/// time as the current rayon pool has threads.
///
/// # Errors
/// As [`inspect`]; also if `progress` asks to stop.
pub fn check(
    zip: &Path,
    benchmark: &Benchmark,
    limits: &Limits,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Submission, SubmissionError> {
    let submission = inspect(zip, benchmark, limits)?;
    submission.each_image(benchmark, limits, |_, _| Ok::<_, SubmissionError>(()), progress)?;
    Ok(submission)
}

impl Submission {
    /// Decodes every image and gives it to `work`, with its index; if any image is bad all are looked at, for a whole list.
    pub(crate) fn each_image<T: Send, E: From<SubmissionError> + Send>(
        &self,
        benchmark: &Benchmark,
        limits: &Limits,
        work: impl Fn(usize, &[u8]) -> Result<T, E> + Sync,
        progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Vec<T>, E> {
        let unreadable = |source| E::from(SubmissionError::Io { path: self.zip.clone(), source });
        let one = |reader: &mut ImageReader, index: usize| -> Result<Result<T, Vec<Problem>>, E> {
            match self.read(reader, benchmark, limits, index).map_err(unreadable)? {
                Ok(()) => work(index, &reader.rgb).map(Ok),
                Err(problems) => Ok(Err(problems)),
            }
        };
        let looked = in_parallel(self.images.len(), ImageReader::default, one, progress)
            .ok_or_else(|| E::from(SubmissionError::Stopped))?;
        let (mut problems, mut results) = (Problems::new(limits.problems), Vec::with_capacity(looked.len()));
        for one in looked {
            match one? {
                Ok(result) => results.push(result),
                Err(bad) => bad.into_iter().for_each(|problem| problems.push(problem)),
            }
        }
        problems.into_result().map_err(|refusal| E::from(refusal.into()))?;
        Ok(results)
    }

    /// Unpacks and decodes an image into `reader.rgb`.
    pub(crate) fn read(
        &self,
        reader: &mut ImageReader,
        benchmark: &Benchmark,
        limits: &Limits,
        index: usize,
    ) -> io::Result<Result<(), Vec<Problem>>> {
        let SubmittedImage { scene, image, packed } = &self.images[index];
        let image = &benchmark.scenes[*scene].images[*image];
        let problem = |(code, message)| Problem::of_entry(code, image.entry.as_bytes(), message);
        let zip = match &reader.zip {
            Some(zip) => zip,
            None => reader.zip.insert(File::open(&self.zip)?),
        };
        match unpack(zip, packed, &mut reader.png) {
            Err(EntryError::Io(error)) => return Err(error),
            Err(EntryError::Bad(code, message)) => return Ok(Err(vec![problem((code, message))])),
            Ok(()) => {}
        }
        let decoded =
            picture::decode(&reader.png, (image.width, image.height), limits.pixels, &mut reader.rgb);
        Ok(decoded.map_err(|bad| bad.into_iter().map(problem).collect()))
    }
}

/// What a thread reads images with: the zip, and room for one image.
#[derive(Default)]
pub(crate) struct ImageReader {
    zip: Option<File>,
    png: Vec<u8>,
    /// The pixels of the image read last.
    pub(crate) rgb: Vec<u8>,
}

/// The longest PNG file that a writer can make of an image without meaning to: stored rather than compressed, in small chunks, with
/// notes beside the pixels.
fn longest_png(image: &TestImage) -> u64 {
    let pixels = (3 * u64::from(image.width) + 1) * u64::from(image.height);
    pixels + pixels / 8 + (1 << 20)
}

/// Adds what is wrong with the stated size of an entry.
fn check_size(name: &[u8], packed: &Packed, limits: &Limits, problems: &mut Problems) {
    if packed.unpacked > limits.entry_bytes {
        problems.push(too_large(name, packed, limits.entry_bytes));
    }
    if packed.unpacked > packed.packed.saturating_mul(limits.ratio) {
        let message = format!(
            "unpacks {} bytes from {}: more than {} times as many, as no image does",
            packed.unpacked, packed.packed, limits.ratio
        );
        problems.push(Problem::of_entry(Code::Ratio, name, message));
    }
}

fn too_large(name: &[u8], packed: &Packed, most: u64) -> Problem {
    let message = format!(
        "unpacks to {} bytes, and its image needs at most {most}: write 8-bit RGB PNG without more",
        packed.unpacked
    );
    Problem::of_entry(Code::EntryTooLarge, name, message)
}

/// Which splits are shown, and what is missing of them: validation is whole or absent, easy and hard both whole or both absent.
fn check_completeness(
    benchmark: &Benchmark,
    found: &[Vec<Option<Packed>>],
    problems: &mut Problems,
) -> Vec<Split> {
    let images =
        || benchmark.scenes.iter().zip(found).flat_map(|(scene, found)| scene.images.iter().zip(found));
    let is_val = |image: &TestImage| image.split == Split::Val;
    let shows = |val| images().any(|(image, found)| is_val(image) == val && found.is_some());
    let (val, test) = (shows(true), shows(false));
    if !val && !test {
        let message = "holds none of the images that the benchmark asks for";
        problems.push(Problem::of_zip(Code::NoImages, message));
    }
    let shown = |split| if split == Split::Val { val } else { test };
    for (image, _) in images().filter(|(image, found)| shown(image.split) && found.is_none()) {
        let whole = if is_val(image) { "validation" } else { "the test" };
        let message = format!("is missing: a submission shows all images of {whole} or none");
        problems.push(Problem::of_entry(Code::MissingImage, image.entry.as_bytes(), message));
    }
    let is_asked = |split: &Split| images().any(|(image, _)| image.split == *split);
    SCORED.into_iter().filter(|&split| shown(split)).filter(is_asked).collect()
}
