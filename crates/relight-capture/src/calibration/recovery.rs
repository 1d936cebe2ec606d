//! Corners that the search has missed: where they must be, their neighbours say.

use nalgebra::Vector2;

use super::board::Board;
use super::homography;
use super::saddle::{self, Expected, Grey};

/// Neighbours that say where a corner is: the nearest ones, so that a lens that bends lines does not matter, and no fewer than
/// determine a homography well.
const NEIGHBOURS: usize = 12;
const FEWEST: usize = 6;
/// A missed corner is looked for beside found ones, squares: from farther away, it would be a guess.
const BESIDE: f64 = 1.5;
/// Corners nearer to the image's edge than this are not looked for, pixels.
const EDGE: f64 = 3.0;

/// A corner that was found: its number, its place on the board, and in the image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub(super) id: u32,
    pub(super) on_board: Vector2<f64>,
    pub(super) at: Vector2<f64>,
}

/// Fits the corners that a search has found, and then, outward from them, those that it has missed. A corner is kept only if the
/// picture shows it: two edges that cross there, dark and bright where the board has them so.
pub(super) fn refine(image: &Grey, board: &Board, searched: &[Found]) -> Vec<Found> {
    let mut found: Vec<Found> = searched
        .iter()
        .filter_map(|corner| {
            let expected = expected(board, searched, corner.id, corner.on_board)?;
            let at = saddle::fit(image, &Expected { at: corner.at, ..expected })?;
            Some(Found { at, ..*corner })
        })
        .collect();
    loop {
        let is_found = |id: u32| found.iter().any(|f| f.id == id);
        let missed = (0..board.corners()).filter(|&id| !is_found(id));
        let more: Vec<Found> = missed.filter_map(|id| look_for(image, board, &found, id)).collect();
        if more.is_empty() {
            found.sort_by_key(|corner| corner.id);
            return found;
        }
        found.extend(more);
    }
}

fn look_for(image: &Grey, board: &Board, found: &[Found], id: u32) -> Option<Found> {
    let on_board = Vector2::from(board.corner(id)?);
    let beside = |f: &&Found| (f.on_board - on_board).norm() < BESIDE * board.square();
    if found.iter().filter(beside).count() < 2 {
        return None;
    }
    let expected = expected(board, found, id, on_board)?;
    let [right, bottom] = [image.width, image.height].map(|size| size as f64 - 1.0 - EDGE);
    let is_inside = (EDGE..right).contains(&expected.at.x) && (EDGE..bottom).contains(&expected.at.y);
    if !is_inside {
        return None;
    }
    saddle::fit(image, &expected).map(|at| Found { id, on_board, at })
}

/// What the nearest of the found corners say of a corner.
fn expected(board: &Board, found: &[Found], id: u32, on_board: Vector2<f64>) -> Option<Expected> {
    let mut nearest: Vec<&Found> = found.iter().collect();
    nearest.sort_by(|a, b| (a.on_board - on_board).norm().total_cmp(&(b.on_board - on_board).norm()));
    // Those as near as the last one too: a row of corners alone would lie on a line.
    let reach =
        nearest.get(NEIGHBOURS.min(nearest.len()).checked_sub(1)?).map(|f| (f.on_board - on_board).norm())?;
    let is_near = |f: &&&Found| (f.on_board - on_board).norm() <= reach * (1.0 + 1e-9);
    let pairs: Vec<_> = nearest.iter().filter(is_near).map(|f| (f.on_board, f.at)).collect();
    if pairs.len() < FEWEST.min(found.len()) {
        return None;
    }
    // Too few around it, or on a line: all together.
    let plane = homography::fit(&pairs)
        .or_else(|| homography::fit(&found.iter().map(|f| (f.on_board, f.at)).collect::<Vec<_>>()))?;
    let (at, jacobian) = homography::apply(&plane, on_board)?;
    let along = board.columns() - 1;
    Some(Expected {
        at,
        axes: jacobian * board.square(),
        black_ahead: (id % along + id / along).is_multiple_of(2),
        margin: (1.0 - board.marker() / board.square()) / 2.0,
    })
}
