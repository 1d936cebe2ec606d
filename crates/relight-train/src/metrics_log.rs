//! `metrics.jsonl`: what is reported while a field is trained, one JSON object a line.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::run::refuse_special;

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
    pub fn open(path: &Path, keep: u64) -> Result<Self, TrainError> {
        refuse_special(path)?;
        let opened = || {
            let file = OpenOptions::new().append(true).create(true).open(path)?;
            let bytes = file.metadata()?.len().min(keep);
            file.set_len(bytes)?;
            Ok((file, bytes))
        };
        let (file, bytes) = opened().map_err(TrainError::io(path))?;
        Ok(Self { file, path: path.to_owned(), bytes })
    }

    /// Adds a line.
    pub fn add(&mut self, report: &Report) -> Result<(), TrainError> {
        let mut line =
            serde_json::to_string(report).map_err(|e| TrainError::run(&self.path, e.to_string()))?;
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

    #[test]
    fn reopening_drops_lines_after_the_checkpoint() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let mut report = Report {
            step: 1,
            seconds: 0.5,
            rays: 4,
            pixels: 8,
            pixels_per_second: 16.0,
            loss: 0.25,
            learning_rate: 0.01,
            depth_spread: 0.0,
            psnr: None,
            ssim: None,
        };
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
