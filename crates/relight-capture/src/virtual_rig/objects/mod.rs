//! Objects that need no files: twenty, for what makes relighting hard.
//!
//! Each stands on z = 0 within the box of [`super::stage`], 0.22 m along x and y and 0.2 m high.

use glam::{DVec3, dvec3};

use super::Model;
use super::error::RigError;
use super::random::{hash, uniform};

mod contrast;
mod leaves;
mod metal;
mod parts;
mod round;
mod thin;
mod translucent;

/// A built-in object.
#[derive(Clone, Copy)]
pub struct BuiltIn {
    /// Its name.
    pub name: &'static str,
    /// What it is, and what is hard about it.
    pub about: &'static str,
    build: fn() -> Model,
}

impl BuiltIn {
    /// Builds the object, without a stage.
    pub fn model(&self) -> Model {
        (self.build)()
    }
}

/// All built-in objects.
pub const ALL: [BuiltIn; 20] = [
    BuiltIn {
        name: "wire-cube",
        about: "a cube of thin rods on its corner: thin shadows",
        build: thin::wire_cube,
    },
    BuiltIn {
        name: "birdcage",
        about: "a cage of wires with a bird in it: seen through",
        build: thin::birdcage,
    },
    BuiltIn { name: "wheel", about: "a wheel with spokes and a tyre: thin and crossing", build: thin::wheel },
    BuiltIn { name: "fern", about: "fronds with toothed leaves: jagged, translucent", build: leaves::fern },
    BuiltIn {
        name: "thistle",
        about: "a spiny flower head on a stem: a thousand points",
        build: leaves::thistle,
    },
    BuiltIn {
        name: "cabbage",
        about: "ruffled leaves around each other: folds and depth",
        build: leaves::cabbage,
    },
    BuiltIn {
        name: "mirrors",
        about: "chrome and rough steel spheres: mirrored stage",
        build: metal::mirrors,
    },
    BuiltIn { name: "bells", about: "brass and copper bells: coloured metal, hollow", build: metal::bells },
    BuiltIn { name: "gears", about: "meshing steel gears: flat metal with teeth", build: metal::gears },
    BuiltIn {
        name: "lantern",
        about: "a pleated paper lantern: light from within",
        build: translucent::lantern,
    },
    BuiltIn {
        name: "sandals",
        about: "rubber sandals with thin straps: straps let light through",
        build: translucent::sandals,
    },
    BuiltIn {
        name: "tapes",
        about: "rolls of tape, one with a loose end: glossy rings, translucent strips",
        build: translucent::tapes,
    },
    BuiltIn {
        name: "bricks",
        about: "a tower of studded toy bricks: many small glossy parts",
        build: parts::bricks,
    },
    BuiltIn {
        name: "marbles",
        about: "a heap of marbles in a tray: many small highlights",
        build: parts::marbles,
    },
    BuiltIn { name: "skyline", about: "a town of blocks: narrow gaps, deep shade", build: parts::skyline },
    BuiltIn {
        name: "fruit",
        about: "apple, oranges, banana and grapes: round and soft",
        build: round::fruit,
    },
    BuiltIn {
        name: "plates",
        about: "stacked plates and a cup: flat and round, glazed",
        build: round::plates,
    },
    BuiltIn {
        name: "snail",
        about: "a snail with a coiled shell: smooth curves, stripes",
        build: round::snail,
    },
    BuiltIn {
        name: "chess",
        about: "black and white chessmen on their board: dark and bright",
        build: contrast::chess,
    },
    BuiltIn {
        name: "snowman",
        about: "white balls with coal and a hat: near-white beside near-black",
        build: contrast::snowman,
    },
];

/// The built-in object of a name.
///
/// # Errors
/// [`RigError::UnknownObject`], which lists the names there are.
pub fn named(name: &str) -> Result<Model, RigError> {
    match ALL.iter().find(|object| object.name == name) {
        Some(object) => Ok(object.model()),
        None => {
            let known = ALL.map(|object| object.name).join(", ");
            Err(RigError::UnknownObject { name: name.to_owned(), known })
        }
    }
}

/// Random numbers for shapes: the same at every run.
struct Draws {
    seed: u64,
    drawn: u64,
}

impl Draws {
    fn new(seed: u64) -> Self {
        Self { seed, drawn: 0 }
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        self.drawn += 1;
        low + (high - low) * f64::from(uniform(hash(&[self.seed, self.drawn])))
    }
}

/// A point at an angle and a distance from the z axis.
fn polar(angle: f64, distance: f64, height: f64) -> DVec3 {
    dvec3(distance * angle.cos(), distance * angle.sin(), height)
}
