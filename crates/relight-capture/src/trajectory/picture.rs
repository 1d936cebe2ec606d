//! A plan as a picture.

use std::f64::consts::TAU;

use glam::DVec3;
use relight_scene::drawing::{BACKGROUND, Canvas, Colour, View};
use relight_scene::{Image, Intrinsics};

use super::dome::direction;
use super::partition::Cell;
use super::plan::{Plan, Trajectory};

/// Side of the large square, of each of the two small ones beside it, and height of the legend above, pixels.
const LARGE: u32 = 1000;
const SMALL: u32 = LARGE / 2;
const LEGEND: u32 = 86;
/// Around what must be seen, pixels.
const MARGIN: f64 = 34.0;

const TEXT: Colour = [215; 3];
const FAINT_TEXT: Colour = [150; 3];
const RULE: Colour = [60; 3];
const TABLE: Colour = [58, 60, 64];
const OBJECT: Colour = [205; 3];
const UNREACHABLE: Colour = [255, 70, 70];
const AXES: [Colour; 3] = [[230, 60, 60], [60, 200, 60], [80, 120, 255]];

/// How one arm's things are coloured.
struct Palette {
    waypoint: Colour,
    way: Colour,
    cell: Colour,
    reach: Colour,
}
const CAMERA: Palette =
    Palette { waypoint: [130, 185, 255], way: [40, 205, 190], cell: [44, 78, 128], reach: [70, 88, 118] };
const LIGHT: Palette =
    Palette { waypoint: [255, 222, 90], way: [236, 132, 50], cell: [112, 92, 36], reach: [112, 96, 66] };

/// Length of a drawn camera, of the axes, and between the table's lines, metres.
const CAMERA_LENGTH: f64 = 0.04;
const AXIS: f64 = 0.08;
const TABLE_PITCH: f64 = 0.1;
/// Most lines of the table either way from its middle.
const TABLE_LINES: f64 = 20.0;
/// Straight pieces that a full turn is drawn with.
const PIECES: f64 = 120.0;

/// How far an arm reaches.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    /// Its name, ASCII.
    pub name: String,
    /// The middle of the sphere that it reaches to, world, metres: its shoulder.
    pub shoulder: [f64; 3],
    /// Radius of that sphere, metres.
    pub radius: f64,
}

/// Draws a plan aslant from the camera's side, from above and from the side: the cells of both domes; cameras as
/// pyramids, lights as dots, unreachable ones red and crossed; the orders of visit from a ring to a square; the object's
/// box; the plane z = 0 as the table, a line each 0.1 m; the world's axes, 0.08 m long; where given, the reach of the
/// camera's and the light's arm as the outline of its sphere and where that meets the table. What is farther is dimmer.
pub fn picture(plan: &Plan, camera_arm: Option<&Reach>, light_arm: Option<&Reach>) -> Image {
    let mut canvas = Canvas::new(LARGE + SMALL, LEGEND + LARGE);
    let toward_cameras = middle(&plan.camera).with_z(0.0).try_normalize().unwrap_or(DVec3::NEG_Y);
    let aside = DVec3::Z.cross(toward_cameras);
    let views = [
        ("", 0.5 * toward_cameras + 0.75 * aside + 0.42 * DVec3::Z, [0, LEGEND], LARGE),
        ("from above", DVec3::Z, [LARGE, LEGEND], SMALL),
        ("from the side", aside, [LARGE, LEGEND + SMALL], SMALL),
    ];
    let arms = [(camera_arm, &CAMERA), (light_arm, &LIGHT)];
    let seen = points(plan, camera_arm.into_iter().chain(light_arm));
    for (name, from, [left, top], side) in views {
        let mut square = Canvas::new(side, side);
        let view = View::fitting(from.into(), &seen, [side; 2], MARGIN);
        let depth = seen.iter().map(|&p| view.nearness(p).abs()).fold(1e-3, f64::max);
        let scale = (f64::from(side) / f64::from(LARGE)).max(0.7);
        let mut drawing = Drawing { canvas: &mut square, side: side.into(), view, depth, scale };
        drawing.table(&seen);
        for (arm, palette) in arms {
            if let Some(arm) = arm {
                drawing.reach(arm, palette);
            }
        }
        drawing.plan(plan);
        square.text(name, 10.0, 8.0, FAINT_TEXT);
        canvas.paste(&square.into_image(), left, top);
    }
    let [right, bottom] = [LARGE + SMALL, LEGEND + LARGE].map(f64::from);
    let [large, legend, small] = [LARGE, LEGEND, LEGEND + SMALL].map(f64::from);
    canvas.line([0.0, legend], [right, legend], 1.0, RULE);
    canvas.line([large, legend], [large, bottom], 1.0, RULE);
    canvas.line([large, small], [right, small], 1.0, RULE);
    legend_of(plan, &mut canvas);
    canvas.into_image()
}

/// The mean of where an arm's waypoints stand.
fn middle(trajectory: &Trajectory) -> DVec3 {
    let positions = trajectory.waypoints.iter().map(|w| DVec3::from(w.pose.position()));
    positions.sum::<DVec3>() / trajectory.waypoints.len().max(1) as f64
}

/// What must be seen.
fn points<'a>(plan: &Plan, arms: impl Iterator<Item = &'a Reach>) -> Vec<[f64; 3]> {
    let waypoints = plan.camera.waypoints.iter().chain(&plan.light.waypoints).map(|w| w.pose.position());
    let corners = [&plan.camera, &plan.light].into_iter().flat_map(|trajectory| {
        let on_sphere = sphere(trajectory);
        trajectory.waypoints.iter().flat_map(move |waypoint| {
            let Cell { colatitude: [top, bottom], azimuth: [lo, hi] } = waypoint.cell;
            [[top, lo], [top, hi], [bottom, lo], [bottom, hi]].map(|angles| on_sphere(angles).into())
        })
    });
    let shoulders = arms.map(|arm| arm.shoulder);
    let object = [plan.object.lo, plan.object.hi, [0.0; 3]].into_iter();
    object.chain(waypoints).chain(corners).chain(shoulders).collect()
}

/// Where colatitudes and azimuths lie on the sphere that a trajectory's cells are drawn on.
fn sphere(trajectory: &Trajectory) -> impl Fn([f64; 2]) -> DVec3 + Copy + use<> {
    let [near, far] = trajectory.radius;
    let (centre, radius) = (DVec3::from(trajectory.centre), (near + far) / 2.0);
    move |angles| centre + radius * direction(angles)
}

/// One view under way.
struct Drawing<'a> {
    canvas: &'a mut Canvas,
    /// Of the canvas, pixels.
    side: f64,
    view: View,
    /// The farthest that anything lies before or behind the view's middle, metres.
    depth: f64,
    /// Of lines and marks.
    scale: f64,
}

impl Drawing<'_> {
    /// A colour at a place: dimmer where it is farther away.
    fn at(&self, place: DVec3, colour: Colour) -> Colour {
        let near = (0.5 + 0.5 * self.view.nearness(place.into()) / self.depth).clamp(0.0, 1.0);
        let share = 0.45 + 0.55 * near;
        std::array::from_fn(|channel| {
            let [back, full] = [BACKGROUND[channel], colour[channel]].map(f64::from);
            (back + share * (full - back)).round() as u8
        })
    }

    fn line(&mut self, from: DVec3, to: DVec3, width: f64, colour: Colour) {
        let colour = self.at((from + to) / 2.0, colour);
        self.view.line(self.canvas, from.into(), to.into(), width * self.scale, colour);
    }

    /// A curve over `0..=1`, in enough pieces for `turn` radians.
    fn curve(&mut self, turn: f64, width: f64, colour: Colour, place: impl Fn(f64) -> DVec3) {
        let pieces = (PIECES * turn.abs() / TAU).ceil().clamp(1.0, PIECES) as u32;
        for piece in 0..pieces {
            let [from, to] = [piece, piece + 1].map(|end| place(f64::from(end) / f64::from(pieces)));
            self.line(from, to, width, colour);
        }
    }

    fn dot(&mut self, place: DVec3, radius: f64, colour: Colour) {
        let colour = self.at(place, colour);
        self.canvas.disc(self.view.place(place.into()), radius * self.scale, colour);
    }

    fn table(&mut self, seen: &[[f64; 3]]) {
        let widest = seen.iter().map(|p| p[0].abs().max(p[1].abs())).fold(TABLE_PITCH, f64::max);
        let lines = (widest / TABLE_PITCH).ceil().min(TABLE_LINES) as i32;
        let edge = f64::from(lines) * TABLE_PITCH;
        for line in -lines..=lines {
            let at = f64::from(line) * TABLE_PITCH;
            self.line(DVec3::new(at, -edge, 0.0), DVec3::new(at, edge, 0.0), 1.0, TABLE);
            self.line(DVec3::new(-edge, at, 0.0), DVec3::new(edge, at, 0.0), 1.0, TABLE);
        }
        for (axis, colour) in DVec3::AXES.into_iter().zip(AXES) {
            self.line(DVec3::ZERO, AXIS * axis, 2.0, colour);
        }
    }

    fn reach(&mut self, arm: &Reach, palette: &Palette) {
        let shoulder = DVec3::from(arm.shoulder);
        let [x, y] = self.view.place(arm.shoulder);
        let outline = arm.radius * self.view.pixels_a_metre();
        let around = |piece: f64| {
            let (sine, cosine) = (TAU * piece / PIECES).sin_cos();
            [x + outline * cosine, y + outline * sine]
        };
        // Dashes: the outline is no thing that stands there.
        for piece in (0..PIECES as u32).map(f64::from) {
            self.canvas.line(around(piece), around(piece + 0.5), 1.5 * self.scale, palette.reach);
        }
        let on_table = arm.radius.powi(2) - shoulder.z.powi(2);
        if on_table > 0.0 {
            let foot = shoulder.with_z(0.0);
            self.curve(TAU, 1.0, palette.reach, |share| {
                foot + on_table.sqrt() * DVec3::new((TAU * share).cos(), (TAU * share).sin(), 0.0)
            });
            self.line(foot, shoulder, 3.0, palette.reach);
        }
        self.dot(shoulder, 6.0, palette.reach);
        let (beside, width) = (10.0 * self.scale, f64::from(Canvas::text_width(&arm.name)));
        let left = if x + beside + width < self.side { x + beside } else { x - beside - width };
        self.canvas.text(&arm.name, left, y - f64::from(Canvas::TEXT_HEIGHT) / 2.0, palette.waypoint);
    }

    fn plan(&mut self, plan: &Plan) {
        for (trajectory, palette) in [(&plan.light, &LIGHT), (&plan.camera, &CAMERA)] {
            for waypoint in &trajectory.waypoints {
                self.cell(trajectory, &waypoint.cell, palette.cell);
            }
        }
        self.view.cuboid(self.canvas, plan.object.lo, plan.object.hi, 2.0 * self.scale, OBJECT);
        for (trajectory, palette) in [(&plan.light, &LIGHT), (&plan.camera, &CAMERA)] {
            self.way(trajectory, palette);
        }
        let lens = lens();
        for waypoint in &plan.camera.waypoints {
            let reached = waypoint.unreachable.is_none();
            let place = DVec3::from(waypoint.pose.position());
            let colour = self.at(place, if reached { CAMERA.waypoint } else { UNREACHABLE });
            let width = 1.5 * self.scale;
            self.view.camera(self.canvas, &waypoint.pose, &lens, CAMERA_LENGTH, width, colour);
        }
        for waypoint in &plan.light.waypoints {
            let colour = if waypoint.unreachable.is_none() { LIGHT.waypoint } else { UNREACHABLE };
            self.dot(waypoint.pose.position().into(), 5.0, colour);
        }
        for waypoint in plan.camera.waypoints.iter().chain(&plan.light.waypoints) {
            if waypoint.unreachable.is_some() {
                self.cross(waypoint.pose.position());
            }
        }
    }

    fn cell(&mut self, trajectory: &Trajectory, cell: &Cell, colour: Colour) {
        let on_sphere = sphere(trajectory);
        let Cell { colatitude: [top, bottom], azimuth: [lo, hi] } = *cell;
        let mut edge = |from: [f64; 2], to: [f64; 2]| {
            let turn = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
            self.curve(turn, 1.2, colour, |share| {
                on_sphere([0, 1].map(|i| from[i] + share * (to[i] - from[i])))
            });
        };
        edge([top, lo], [top, hi]);
        edge([bottom, lo], [bottom, hi]);
        // A cap has no meridians.
        if !cell.is_cap() {
            edge([top, lo], [bottom, lo]);
            edge([top, hi], [bottom, hi]);
        }
    }

    /// The order of visit, from a ring to a square.
    fn way(&mut self, trajectory: &Trajectory, palette: &Palette) {
        let stops: Vec<DVec3> = trajectory.visited().map(|w| w.pose.position().into()).collect();
        for pair in stops.windows(2) {
            self.line(pair[0], pair[1], 2.2, palette.way);
        }
        let half = 9.0 * self.scale;
        if let Some(&first) = stops.first() {
            let [x, y] = self.view.place(first.into());
            let around = |piece: u32| {
                let (sine, cosine) = (TAU * f64::from(piece) / 24.0).sin_cos();
                [x + half * cosine, y + half * sine]
            };
            for piece in 0..24 {
                self.canvas.line(around(piece), around(piece + 1), 2.0 * self.scale, palette.way);
            }
        }
        if let Some(&last) = stops.last() {
            let [x, y] = self.view.place(last.into());
            let corners =
                [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[a, b]| [x + a, y + b]);
            for (corner, from) in corners.into_iter().enumerate() {
                self.canvas.line(from, corners[(corner + 1) % 4], 2.0 * self.scale, palette.way);
            }
        }
    }

    fn cross(&mut self, place: [f64; 3]) {
        let [x, y] = self.view.place(place);
        let half = 8.0 * self.scale;
        for up in [-half, half] {
            self.canvas.line([x - half, y - up], [x + half, y + up], 2.0 * self.scale, UNREACHABLE);
        }
    }
}

/// The lens of the paper's rig, by its data sheet.
fn lens() -> Intrinsics {
    let (width, height, focal) = (1440, 1080, 2321.0);
    let [cx, cy] = [width, height].map(|side| (f64::from(side) - 1.0) / 2.0);
    Intrinsics { width, height, fx: focal, fy: focal, cx, cy, distortion: Vec::new() }
}

/// What there is, in words.
fn legend_of(plan: &Plan, canvas: &mut Canvas) {
    let columns = [("camera", &plan.camera, &CAMERA), ("light", &plan.light, &LIGHT)];
    for (row, (name, trajectory, palette)) in columns.into_iter().enumerate() {
        let top = 10.0 + 24.0 * row as f64;
        let unreachable = trajectory.waypoints.iter().filter(|w| w.unreachable.is_some()).count();
        let [near, far] = trajectory.radius;
        let mut left = 16.0;
        let mut entry = |text: &str, mark: Option<Colour>, colour: Colour| {
            if let Some(mark) = mark {
                let middle = top + f64::from(Canvas::TEXT_HEIGHT) / 2.0;
                canvas.line([left, middle], [left + 18.0, middle], 4.0, mark);
                left += 28.0;
            }
            canvas.text(text, left, top, colour);
            left += f64::from(Canvas::text_width(text)) + 26.0;
        };
        let count = trajectory.waypoints.len();
        entry(
            &format!("{name:<6} {count:>4} waypoints at {near:.3}-{far:.3} m"),
            Some(palette.waypoint),
            TEXT,
        );
        let travel = trajectory.length();
        entry(&format!("order of visit, {travel:>6.2} m"), Some(palette.way), TEXT);
        entry("cells of equal area", Some(palette.cell), TEXT);
        if unreachable > 0 {
            entry(&format!("{unreachable} unreachable"), Some(UNREACHABLE), TEXT);
        }
    }
    let key = "white: the object's box   grey: the plane z = 0, a line each 0.1 m   red, green, blue: X, Y, Z   ring: first stop   \
               square: last stop   dashes: an arm's reach";
    canvas.text(key, 16.0, 58.0, FAINT_TEXT);
}
