//! `metrics.jsonl`: what is reported while a field is trained, one JSON object a line. The first says the file's format.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::run::refuse_special;

/// Format and version of the file.
const FORMAT: &str = "relight-metrics-1";
/// A line's longest length, bytes: those written have about 250.
const LONGEST_LINE: u64 = 1 << 14;

/// The first line.
#[derive(Serialize)]
struct FirstLine<'a> {
    format: &'static str,
    #[serde(flatten)]
    report: &'a Report,
}

/// What the first line of any version tells; nothing in files from before they had one.
#[derive(Deserialize)]
struct Version {
    format: Option<String>,
}

/// One line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Steps taken.
    pub step: u64,
    /// Seconds of training, over all resumptions, validation included.
    pub seconds: f64,
    /// Camera rays marched so far.
    pub rays: u64,
    /// Pixel-light pairs compared so far.
    pub pixels: u64,
    /// Pairs a second since the last line, validation left out.
    pub pixels_per_second: f64,
    /// Mean squared error over the steps since the last line.
    pub loss: f64,
    /// Adam's learning rate at the last step.
    pub learning_rate: f64,
    /// Mean standard deviation of depth along the rays since the last line, metres.
    pub depth_spread: f64,
    /// At a validation, its PSNR, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr: Option<f64>,
    /// At a validation, its SSIM.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ssim: Option<f64>,
}

/// The file, open for lines to be added.
pub(crate) struct MetricsLog {
    file: File,
    path: PathBuf,
    bytes: u64,
}

impl MetricsLog {
    /// Opens the file at `path`, keeping its first `keep` bytes: the lines that a checkpoint knows of.
    ///
    /// # Errors
    /// [`TrainError::Run`] if it is of a format that this version does not write; [`TrainError::Io`] if it cannot be
    /// opened.
    pub fn open(path: &Path, keep: u64) -> Result<Self, TrainError> {
        refuse_special(path)?;
        let open = || OpenOptions::new().read(true).append(true).create(true).open(path);
        let file = open().map_err(TrainError::io(path))?;
        let mut line = Vec::new();
        let first = BufReader::new(&file).take(LONGEST_LINE).read_until(b'\n', &mut line);
        first.map_err(TrainError::io(path))?;
        // Of a line that a kill cut short, nothing is kept anyway.
        match serde_json::from_slice(&line) {
            Ok(Version { format: Some(other) }) if other != FORMAT => {
                let problem =
                    format!("format \"{other}\" is unknown to this version, which writes \"{FORMAT}\"");
                return Err(TrainError::run(path, problem));
            }
            _ => {}
        }
        let cut = || {
            let bytes = file.metadata()?.len().min(keep);
            file.set_len(bytes).map(|()| bytes)
        };
        let bytes = cut().map_err(TrainError::io(path))?;
        Ok(Self { file, path: path.to_owned(), bytes })
    }

    /// Adds a line.
    pub fn add(&mut self, report: &Report) -> Result<(), TrainError> {
        let line = if self.bytes == 0 {
            serde_json::to_string(&FirstLine { format: FORMAT, report })
        } else {
            serde_json::to_string(report)
        };
        let mut line = line.map_err(|e| TrainError::run(&self.path, e.to_string()))?;
        line.push('\n');
        self.file.write_all(line.as_bytes()).map_err(TrainError::io(&self.path))?;
        self.bytes += line.len() as u64;
        Ok(())
    }

    /// Length of the file.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(step: u64) -> Report {
        Report {
            step,
            seconds: 0.5,
            rays: 4,
            pixels: 8,
            pixels_per_second: 16.0,
            loss: 0.25,
            learning_rate: 0.01,
            depth_spread: 0.0,
            psnr: None,
            ssim: None,
        }
    }

    #[test]
    fn the_first_line_says_the_format_and_unknown_ones_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let mut log = MetricsLog::open(&path, 0).unwrap();
        log.add(&report(1)).unwrap();
        log.add(&report(2)).unwrap();
        let known = log.bytes();
        let written = std::fs::read_to_string(&path).unwrap();
        let format = "\"format\":\"relight-metrics-1\",";
        let lines: Vec<&str> = written.lines().collect();
        assert!(lines[0].starts_with(&format!("{{{format}\"step\":1")) && !lines[1].contains("format"));
        MetricsLog::open(&path, known).unwrap();

        let other = written.replace("relight-metrics-1", "relight-metrics-9");
        std::fs::write(&path, &other).unwrap();
        for keep in [known, 0] {
            let told = MetricsLog::open(&path, keep).err().unwrap().to_string();
            assert!(told.contains("metrics.jsonl: ") && told.contains("relight-metrics-9"), "{told}");
        }
        assert_eq!(std::fs::read_to_string(&path).unwrap(), other, "it is left as it is");

        // Runs of before, and what a kill left of a first line, go on.
        let old = written.replace(format, "");
        std::fs::write(&path, &old).unwrap();
        let mut log = MetricsLog::open(&path, old.len() as u64).unwrap();
        log.add(&report(3)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with(&old) && text.lines().count() == 3 && !text.contains("format"));
        std::fs::write(&path, &written[..30]).unwrap();
        MetricsLog::open(&path, 0).unwrap().add(&report(1)).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().next(), Some(lines[0]));
    }

    #[test]
    fn reopening_drops_lines_after_the_checkpoint() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let mut report = report(1);
        let mut log = MetricsLog::open(&path, 0).unwrap();
        log.add(&report).unwrap();
        let known = log.bytes();
        report.step = 2;
        report.psnr = Some(20.0);
        log.add(&report).unwrap();
        drop(log);
        let mut log = MetricsLog::open(&path, known).unwrap();
        report.step = 3;
        log.add(&report).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let steps: Vec<u64> = text.lines().map(|l| serde_json::from_str::<Report>(l).unwrap().step).collect();
        assert_eq!(steps, [1, 3]);
        assert!(!text.lines().next().unwrap().contains("psnr"));
    }
}
