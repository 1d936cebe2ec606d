//! The backdrop's texture: woven cane over a board.
//!
//! Two strands across, two strands down and one each way aslant, over and under in turn, each strand a little other in
//! brightness: fine detail that looks alike nowhere, so that views can be told apart by it.

use std::f64::consts::TAU;

use super::error::RigError;
use super::random::{hash, uniform};
use super::texture::Raster;

/// A weave: colours are linear-light reflectances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weave {
    /// Colour of the strands.
    pub strand: [f64; 3],
    /// Colour of a strand's edge, where it turns away.
    pub edge: [f64; 3],
    /// Colour of the board behind.
    pub board: [f64; 3],
    /// Size of a cell of the weave, metres.
    pub cell: f64,
    /// Which of many.
    pub seed: u64,
}

/// Cells of the texture along each side; then it repeats.
const CELLS: usize = 16;
/// Texels of a cell along each side.
const TEXELS: usize = 56;
/// Half the width of strands across and down, and of those aslant, in cells.
const STRAIGHT: f64 = 0.095;
const ASLANT: f64 = 0.075;
/// Distance of a pair's strands from the cell's middle line.
const PAIR: f64 = 0.105;

impl Weave {
    /// Length of the texture along each side, metres.
    pub fn period(&self) -> f64 {
        CELLS as f64 * self.cell
    }

    /// Draws the texture.
    pub(super) fn raster(&self) -> Result<Raster, RigError> {
        let side = CELLS * TEXELS;
        let texels = (0..side * side).map(|k| {
            let at = |i: usize| (i as f64 + 0.5) / TEXELS as f64;
            self.colour(at(k % side), at(k / side))
        });
        Raster::linear(side, side, texels.collect())
    }

    /// The colour at a place, in cells.
    fn colour(&self, x: f64, y: f64) -> [f32; 3] {
        let wobble = |stream: u64| 0.018 * self.noise(x, y, 2, stream);
        let (x, y) = (x + wobble(1), y + wobble(2));
        let mut colour = self.board;
        for (kind, across, along) in [(0, x - y, x + y), (1, x + y, x - y)] {
            let index = across.floor();
            let distance = (across - index - 0.5) / std::f64::consts::SQRT_2;
            self.lay(&mut colour, distance, ASLANT, kind, index as i64, along / 2.0);
        }
        let down_first = (x.round() as i64 + y.round() as i64).rem_euclid(2) == 0;
        for down in [down_first, !down_first] {
            let (across, along) = if down { (x, y) } else { (y, x) };
            for (k, offset) in [-PAIR, PAIR].into_iter().enumerate() {
                let distance = across - across.round() - offset;
                let kind = 2 + 2 * u64::from(down) + k as u64;
                self.lay(&mut colour, distance, STRAIGHT, kind, across.round() as i64, along);
            }
        }
        let patches = 1.0 + 0.07 * self.noise(x, y, 1, 3) + 0.05 * self.noise(x, y, 4, 4);
        colour.map(|c| (c * patches).clamp(0.01, 0.9) as f32)
    }

    /// Lays one strand over a colour, and its shade beside it.
    fn lay(&self, colour: &mut [f64; 3], distance: f64, half: f64, kind: u64, index: i64, along: f64) {
        let away = distance.abs();
        let shade = 1.0 - 0.45 * (1.0 - smooth(half, half + 0.07, away));
        let cover = 1.0 - smooth(half - 0.018, half + 0.018, away);
        let round = (1.0 - (distance / (1.04 * half)).powi(2)).max(0.0).powf(0.375);
        let own = uniform(hash(&[self.seed, 10 + kind, index.rem_euclid(CELLS as i64) as u64]));
        // A whole number of waves a period, and fibres that run along the strand.
        let fibre = self.noise(12.0 * distance + 3.0 * kind as f64, along, 8, 20 + kind);
        let brightness = 0.84 + 0.28 * f64::from(own) + 0.05 * (TAU * along).sin() + 0.06 * fibre;
        for (k, c) in colour.iter_mut().enumerate() {
            let strand = (self.edge[k] + (self.strand[k] - self.edge[k]) * round) * brightness;
            *c = *c * shade * (1.0 - cover) + strand * cover;
        }
    }

    /// Value noise between -1 and 1, `rate` values a cell, that repeats with the texture.
    fn noise(&self, x: f64, y: f64, rate: i64, stream: u64) -> f64 {
        let (x, y) = (x * rate as f64, y * rate as f64);
        let (i, j) = (x.floor(), y.floor());
        let (fx, fy) = (smooth(0.0, 1.0, x - i), smooth(0.0, 1.0, y - j));
        let value = |di: i64, dj: i64| {
            let wrapped = [i as i64 + di, j as i64 + dj].map(|v| v.rem_euclid(CELLS as i64 * rate) as u64);
            2.0 * f64::from(uniform(hash(&[self.seed, stream, wrapped[0], wrapped[1]]))) - 1.0
        };
        let (top, bottom) =
            (value(0, 0) + (value(1, 0) - value(0, 0)) * fx, value(0, 1) + (value(1, 1) - value(0, 1)) * fx);
        top + (bottom - top) * fy
    }
}

fn smooth(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
