//! How much memory a job takes, and how much there is.

use std::fs;

use relight_scene::{Scene, Splits};
use relight_train::recipe::Recipe;

/// Bytes that a job takes whatever it trains on: samples and gradients of a step, stereo, pictures.
const BASE: u64 = 400 << 20;
/// Numbers of four bytes to an entry of the grid: weight, gradient, two moments of Adam, and a copy for a checkpoint
/// and for the best weights.
const NUMBERS_AN_ENTRY: u64 = 7;
/// Share of the available memory that jobs may take.
const SHARE: f64 = 0.8;

/// What a job needs, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// The scene's training pixels, which jobs of one scene share.
    pub pixels: u64,
    /// All that is a job's own: the photographs that it is scored on, too.
    pub own: u64,
}

impl Need {
    /// An estimate from above: a fitted grid is taken for the largest.
    pub fn of(scene: &Scene, splits: &Splits, recipe: &Recipe) -> Self {
        let pixels = |&frame: &usize| {
            let lens = &scene.cameras[scene.frames[frame].camera].intrinsics;
            3 * u64::from(lens.width) * u64::from(lens.height)
        };
        let pixels = |frames: &[usize]| frames.iter().map(pixels).sum::<u64>();
        let scored = [&splits.val, &splits.easy, &splits.hard].map(|frames| pixels(frames));
        let scored = scored.into_iter().max().unwrap_or(0);
        let grid = recipe.grid.unwrap_or_default();
        let entries = (grid.levels as u64 * grid.features as u64) << grid.log2_table;
        let own = BASE + scored + 4 * NUMBERS_AN_ENTRY * entries;
        Self { pixels: pixels(&splits.train), own }
    }

    /// How many of the jobs with the needs `all` fit into `available` bytes at once, whichever they are; at least one.
    pub fn together(all: &[Need], available: u64) -> usize {
        let largest = all.iter().map(|need| need.pixels + need.own).max().unwrap_or(0);
        ((available as f64 * SHARE / largest.max(1) as f64) as usize).max(1)
    }
}

/// Memory that new work can take, bytes: what the system or the container of the process leaves, whichever is less.
/// `None` where neither tells.
pub fn available_memory() -> Option<u64> {
    let system = fs::read_to_string("/proc/meminfo").ok().and_then(|text| of_meminfo(&text));
    let number = |path: &str| fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let limit = number("/sys/fs/cgroup/memory.max");
    let used = number("/sys/fs/cgroup/memory.current");
    let container = limit.zip(used).map(|(limit, used)| limit.saturating_sub(used));
    system.into_iter().chain(container).min()
}

fn of_meminfo(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_jobs_as_fit_and_at_least_one() {
        let need = |pixels, own| Need { pixels, own };
        assert_eq!(Need::together(&[need(600, 200), need(100, 100)], 10_000), 10);
        assert_eq!(Need::together(&[need(600, 200)], 1_999), 1);
        assert_eq!(Need::together(&[need(600, 200)], 2_001), 2);
        assert_eq!(Need::together(&[need(600, 200)], 0), 1);
    }

    #[test]
    fn available_memory_is_read_from_what_linux_tells() {
        let text = "MemTotal:       24691664 kB\nMemFree:        1 kB\nMemAvailable:   24000000 kB\n";
        assert_eq!(of_meminfo(text), Some(24_000_000 * 1024));
        assert_eq!(of_meminfo("MemTotal: 5 kB\n"), None);
        assert_eq!(of_meminfo("MemAvailable: 99999999999999999999 kB\n"), None);
    }
}
