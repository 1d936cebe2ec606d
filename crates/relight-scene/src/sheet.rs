//! A scene at a glance: some of its images, and its poses drawn in 3D.

mod wireframe;

use image::imageops;
use rayon::prelude::*;

use crate::drawing::{Canvas, Colour};
use crate::error::SceneError;
use crate::image_file::Image;
use crate::scene::Scene;
use crate::splits::Splits;

/// Rows and columns of images, at most.
const MOST: usize = 8;
/// The longer side of an image on the sheet, pixels.
const THUMBNAIL: u32 = 160;
/// Around every image, and left and above for numbers.
const GAP: u32 = 4;
const MARGIN: u32 = 24;
/// Side of each of the two drawings of the poses, pixels.
const DRAWING: u32 = 480;
const TEXT: Colour = [220; 3];

/// Draws up to 8 views (rows, with their labels) under up to 8 lights (columns), evenly chosen. Where cameras and
/// lights do not meet in a grid the images are simply evenly chosen frames. Beside them the poses, seen aslant from
/// above and straight from above: training cameras blue, validation green, test red; training lights yellow, test lights
/// orange; the box grey; the world's axes, 0.1 of the box long, red, green and blue. Nothing is written.
///
/// # Errors
/// If an image cannot be decoded or the splits cannot be had.
pub fn contact_sheet(scene: &Scene) -> Result<Image, SceneError> {
    let splits = Splits::peek(scene)?;
    let cells = cells(scene);
    let thumbnails: Vec<(Cell, Image)> = cells
        .into_par_iter()
        .map(|cell| Ok((cell, thumbnail(&scene.read_frame(cell.frame)?))))
        .collect::<Result<_, SceneError>>()?;
    let size = |side: fn(&Image) -> u32| thumbnails.iter().map(|(_, image)| side(image)).max().unwrap_or(1);
    let (width, height) = (size(|image| image.width), size(|image| image.height));
    let count =
        |place: fn(&Cell) -> u32| thumbnails.iter().map(|(cell, _)| place(cell) + 1).max().unwrap_or(0);
    let (columns, rows) = (count(|cell| cell.column), count(|cell| cell.row));
    let (grid_width, grid_height) = (MARGIN + columns * (width + GAP), MARGIN + rows * (height + GAP));
    let mut canvas = Canvas::new(grid_width + DRAWING, grid_height.max(2 * DRAWING));
    for (cell, image) in &thumbnails {
        let (x, y) = (MARGIN + cell.column * (width + GAP), MARGIN + cell.row * (height + GAP));
        canvas.paste(image, x, y);
        let (camera, light) = (scene.frames[cell.frame].camera, scene.frames[cell.frame].light);
        let mut number = |label: usize, x: u32, y: u32| {
            canvas.text(&label.to_string(), f64::from(x), f64::from(y), TEXT);
        };
        number(scene.cameras[camera].label, 1, y + height / 2);
        number(scene.lights[light].label, x + width / 2, 6);
    }
    wireframe::draw(scene, &splits, &mut canvas, [grid_width, 0], DRAWING);
    Ok(canvas.into_image())
}

/// A place on the sheet.
#[derive(Clone, Copy)]
struct Cell {
    row: u32,
    column: u32,
    frame: usize,
}

/// Up to [`MOST`] numbers below `count`, evenly apart, first and last among them.
fn evenly(count: usize) -> Vec<usize> {
    let chosen = count.min(MOST);
    (0..chosen).map(|i| if chosen > 1 { i * (count - 1) / (chosen - 1) } else { 0 }).collect()
}

fn cells(scene: &Scene) -> Vec<Cell> {
    let is_grid = scene.frames.len() >= scene.cameras.len().max(scene.lights.len()) * 2;
    if !is_grid {
        let count = scene.frames.len().min(MOST * MOST);
        let place = |i: usize| Cell {
            row: (i / MOST) as u32,
            column: (i % MOST) as u32,
            frame: i * scene.frames.len() / count,
        };
        return (0..count).map(place).collect();
    }
    let (cameras, lights) = (evenly(scene.cameras.len()), evenly(scene.lights.len()));
    let places =
        cameras.iter().enumerate().flat_map(|row| lights.iter().enumerate().map(move |column| (row, column)));
    places
        .filter_map(|((row, &camera), (column, &light))| {
            Some(Cell { row: row as u32, column: column as u32, frame: scene.frame(camera, light)? })
        })
        .collect()
}

fn thumbnail(image: &Image) -> Image {
    let longer = image.width.max(image.height);
    let side = |side: u32| (u64::from(side) * u64::from(THUMBNAIL) / u64::from(longer)).max(1) as u32;
    let (width, height) = (side(image.width), side(image.height));
    let Some(view) =
        image::ImageBuffer::<image::Rgb<u8>, &[u8]>::from_raw(image.width, image.height, &image.data)
    else {
        return image.clone();
    };
    Image { width, height, data: imageops::thumbnail(&view, width, height).into_raw() }
}
