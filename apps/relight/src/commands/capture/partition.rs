//! `relight capture partition`: equal-area cells of a spherical region.

use relight_capture::trajectory::{MAX_CELLS, Partition, Region};
use serde::Serialize;

use crate::console::{print_json, print_line};

/// Part the sphere, or a region of it, into cells of equal area.
///
/// Cameras and lights that stand over the cells' centres see and light the object evenly from all sides of the region.
/// The whole sphere is parted as by Kegerreis et al. 2019; of a region exactly the region is parted, in rings
/// whose cells are as square as can be, with a polar cap only where it holds the pole.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  relight capture partition --cells 50 --colatitude 48,68 --azimuth -118.5,-61.5 --json\n\n\
                  Colatitude is 0 at the zenith (+Z) and 90 at the horizon; azimuth runs from +X towards +Y.\n\
                  Writes {\"rings\":[cells per ring],\"cells\":[{\"colatitude\":[lo,hi],\"azimuth\":[lo,hi],\
                  \"centre\":[colatitude,azimuth],\"area\"}]}: degrees, and steradians for areas."
)]
pub struct Args {
    /// How many cells.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MAX_CELLS as i64))]
    cells: u32,
    /// Least and greatest colatitude, degrees, within 0..180.
    #[arg(long, value_name = "LO,HI", value_parser = colatitude, default_value = "0,180", allow_hyphen_values = true)]
    colatitude: [f64; 2],
    /// Least and greatest azimuth, degrees, within -360..720.
    #[arg(long, value_name = "LO,HI", value_parser = azimuth, default_value = "0,360", allow_hyphen_values = true)]
    azimuth: [f64; 2],
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

/// The partition in degrees and steradians.
#[derive(Serialize)]
struct Parted {
    rings: Vec<usize>,
    cells: Vec<PartedCell>,
}

#[derive(Serialize)]
struct PartedCell {
    colatitude: [f64; 2],
    azimuth: [f64; 2],
    centre: [f64; 2],
    area: f64,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let region = Region::new(args.colatitude, args.azimuth)?;
    let partition = Partition::new(&region, args.cells as usize)?;
    let degrees = |angles: [f64; 2]| angles.map(f64::to_degrees);
    let cells = partition.cells.iter().map(|cell| PartedCell {
        colatitude: degrees(cell.colatitude),
        azimuth: degrees(cell.azimuth),
        centre: degrees(cell.centre()),
        area: cell.area(),
    });
    let parted = Parted { cells: cells.collect(), rings: partition.rings };
    if args.json { print_json(&parted) } else { print_line(&table(&parted, region.area())) }
}

/// The rings for people.
fn table(parted: &Parted, area: f64) -> String {
    let count = parted.cells.len();
    let mut lines = vec![
        format!("{count} cells of {:.6} sr each, {area:.6} sr in all; degrees", area / count as f64),
        format!("{:>5} {:>6}  {:>21}  {:>10}  {:>10}", "ring", "cells", "colatitude", "centre", "azimuth by"),
    ];
    let mut above = 0;
    for (ring, &count) in parted.rings.iter().enumerate() {
        let Some(PartedCell { colatitude, azimuth, centre, .. }) = parted.cells.get(above) else { break };
        above += count;
        lines.push(format!(
            "{ring:>5} {count:>6}  {:>10.5} {:>10.5}  {:>10.5}  {:>10.5}",
            colatitude[0],
            colatitude[1],
            centre[0],
            azimuth[1] - azimuth[0]
        ));
    }
    lines.join("\n")
}

/// A range of colatitudes, radians.
fn colatitude(text: &str) -> Result<[f64; 2], String> {
    let range = radians(text)?;
    Region::new(range, Region::SPHERE.azimuth()).map_err(|fault| fault.to_string())?;
    Ok(range)
}

/// A range of azimuths, radians.
fn azimuth(text: &str) -> Result<[f64; 2], String> {
    let range = radians(text)?;
    Region::new(Region::SPHERE.colatitude(), range).map_err(|fault| fault.to_string())?;
    Ok(range)
}

/// Two angles in degrees with a comma between, in radians.
fn radians(text: &str) -> Result<[f64; 2], String> {
    let (lo, hi) = text.split_once(',').ok_or("not LO,HI: two angles in degrees with a comma between")?;
    let angle = |text: &str| match text.trim().parse::<f64>() {
        Ok(degrees) => Ok(degrees.to_radians()),
        Err(_) => Err(format!("\"{text}\" is not a number")),
    };
    Ok([angle(lo)?, angle(hi)?])
}
