//! Printed boards: a plane with a picture of known size.

use std::sync::Arc;

use glam::DVec3;
use relight_scene::Pose;

use super::error::{RigError, within};
use super::material::Material;
use super::shapes::quad;
use super::texture::{Raster, Texture};
use super::{Model, Part};
use crate::calibration::Board;

/// A picture printed on a flat board. Texels are sharp squares: an edge between two of them lies exactly where the print
/// has it, at any resolution of the picture.
#[derive(Clone, Debug)]
pub struct PrintedBoard<'a> {
    /// Columns of the picture.
    pub columns: usize,
    /// Rows of the picture.
    pub rows: usize,
    /// Brightness of each texel, row-major from the top left, 0 for ink and 255 for paper; linear between.
    pub picture: &'a [u8],
    /// Size of a texel, metres.
    pub texel: f64,
    /// Board-to-world. The board's origin is the picture's top left corner, +X goes along its rows, +Y down its columns.
    pub pose: Pose,
    /// Reflectance of ink and of paper.
    pub reflectance: [f64; 2],
}

impl PrintedBoard<'_> {
    /// The board as a model: a matt sheet.
    ///
    /// # Errors
    /// If the picture does not hold what its size says, or a number is out of range.
    pub fn model(&self) -> Result<Model, RigError> {
        within("the size of a board's texel", self.texel, [1e-6, 1.0], "1e-6 to 1 m")?;
        let [ink, paper] = self.reflectance;
        within("the reflectance of ink", ink, [0.0, 1.0], "0 to 1")?;
        within("the reflectance of paper", paper, [0.0, 1.0], "0 to 1")?;
        if self.columns.checked_mul(self.rows) != Some(self.picture.len()) {
            let (width, height, held) = (self.columns, self.rows, self.picture.len());
            return Err(RigError::Texture { width, height, channels: 1, held });
        }
        let grey = |value: u8| [(ink + (paper - ink) * f64::from(value) / 255.0) as f32; 3];
        let texels = self.picture.iter().map(|&value| grey(value)).collect();
        let raster = Raster::linear(self.columns, self.rows, texels)?.sharp();
        let axis = |v: [f64; 3]| DVec3::from_array(self.pose.rotate(v));
        let (across, down) = (self.texel * self.columns as f64, self.texel * self.rows as f64);
        let mesh = quad(
            DVec3::from_array(self.pose.position()),
            across * axis([1.0, 0.0, 0.0]),
            down * axis([0.0, 1.0, 0.0]),
        );
        let reflectance = Texture::Raster(Arc::new(raster));
        Ok(Model { parts: vec![Part { mesh, material: Material::Lambert { reflectance } }] })
    }
}

/// Fineness of a ChArUco board's picture, texels a square: the least, the most that is tried so that markers fall on whole
/// texels, and what is taken where none of these do. Corners of squares are exact with any.
const TEXELS: std::ops::RangeInclusive<u32> = 8..=112;
const FINE_TEXELS: u32 = 96;
/// How far from a whole texel an edge may lie, texels.
const ROUNDING: f64 = 1e-6;
/// Reflectance of ink and of paper.
const PRINT: [f64; 2] = [0.04, 0.8];

/// A ChArUco board as it comes from the printer, with a white margin of one square around it. `board_to_world` is that of the
/// [`Board`]'s own frame.
///
/// # Errors
/// If a texel would be smaller or larger than boards have.
pub fn charuco_board(board: &Board, board_to_world: &Pose) -> Result<Model, RigError> {
    let margin = (1.0 - board.marker() / board.square()) / 2.0;
    let cell = board.marker() / board.square() / (board.dictionary().cells() as f64 + 2.0);
    let is_whole = |texels: f64| (texels - texels.round()).abs() < ROUNDING;
    let fits = |&n: &u32| is_whole(margin * f64::from(n)) && is_whole(cell * f64::from(n));
    let a_square = TEXELS.into_iter().find(fits).unwrap_or(FINE_TEXELS);
    let texel = board.square() / f64::from(a_square);
    let [columns, rows] = [board.columns(), board.rows()].map(|squares| (a_square * (squares + 2)) as usize);
    let at = |texels: usize| (texels as f64 + 0.5) * texel - board.square();
    let picture: Vec<u8> = (0..rows)
        .flat_map(|row| (0..columns).map(move |column| (column, row)))
        .map(|(column, row)| if board.is_black(at(column), at(row)) { 0 } else { 255 })
        .collect();
    let corner = board_to_world.transform([-board.square(), -board.square(), 0.0]);
    let axes = board_to_world.0;
    let pose = Pose(std::array::from_fn(|i| [axes[i][0], axes[i][1], axes[i][2], corner[i]]));
    PrintedBoard { columns, rows, picture: &picture, texel, pose, reflectance: PRINT }.model()
}
