//! Colour and visibility of points under lights: the networks `rgb` and `vis` on all pairs of a tile.
//!
//! A point has features (`h` and `e`), a position and a ray; each point meets the same number of lights, and a pair
//! is a column of the networks: all points under one light lie side by side, then all under the next.

use fearless_simd::Level;
use relight_field::architecture::{HARMONICS, LightInput};

use crate::aligned::Aligned;
use crate::dense::padded;
use crate::exponential::sigmoid;
use crate::harmonics::spherical_harmonics;
use crate::mlp::Tape;
use crate::networks::{Gradients, Networks};

/// A light as the networks want it.
#[derive(Clone, Debug)]
pub struct CodedLight {
    /// Position, metres.
    pub position: [f32; 3],
    /// `gamma(R, t)`, where the architecture takes it; empty otherwise.
    pub code: Vec<f32>,
}

/// A point to be shaded.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Its ray, counted within the tile.
    pub ray: usize,
    /// World position, metres.
    pub position: [f32; 3],
    /// What its colour counts in its ray's colour.
    pub weight: f32,
}

/// Points, their features and all that shading them needs; reused from tile to tile.
#[derive(Default)]
pub struct Shader {
    /// The points.
    pub points: Vec<Point>,
    /// `[h; e]` of the points: `[point_features][points]`.
    pub features: Vec<f32>,
    /// Gradients of `features`.
    pub feature_gradients: Vec<f32>,
    /// Gradients with respect to the weights of the points.
    pub weight_gradients: Vec<f32>,
    /// Colour before visibility, `[3][columns]`.
    pub colour: Vec<f32>,
    /// Visibility, `[columns]`; all ones without a visibility network.
    pub visibility: Vec<f32>,
    columns: usize,
    rgb: Tape,
    vis: Tape,
    /// Codes of the lights' poses, `[156][columns]`, where the architecture takes them.
    poses: Aligned,
    /// Harmonics of the directions to the lights, `[16][columns]`, where it takes those.
    harmonics: Aligned,
    direction: [Vec<f32>; 3],
}

/// Copies rows of `n` numbers to rows of `wide`, which zeros fill up.
fn fill_rows(source: &[f32], n: usize, rows: &mut [f32], wide: usize) {
    for (row, source) in rows.chunks_exact_mut(wide).zip(source.chunks_exact(n)) {
        row[..n].copy_from_slice(source);
        row[n..].fill(0.0);
    }
}

/// Adds rows of `wide` numbers, of which `n` count, to rows of `n`.
fn add_rows(rows: &[f32], wide: usize, sums: &mut [f32], n: usize) {
    for (sums, row) in sums.chunks_exact_mut(n).zip(rows.chunks_exact(wide)) {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
}

/// What `rgb` is told of the lights.
fn light_inputs<'a>(networks: &Networks, poses: &'a [f32], harmonics: &'a [f32]) -> &'a [f32] {
    match networks.architecture.light {
        LightInput::None => &[],
        LightInput::Pose => poses,
        LightInput::Direction => harmonics,
    }
}

impl Shader {
    /// Columns of the colour and visibility rows: those of all points under the first light, then under the next, and some
    /// more that fill them up.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Columns of the rows that all lights share: the points, and some more that fill them up.
    pub fn wide(&self) -> usize {
        padded(self.points.len())
    }

    /// Shades all points: each with `lights` lights, that of pair `l` of ray `r` being `light(r, l)`.
    pub fn forward<'a>(
        &mut self,
        simd: Level,
        networks: &Networks,
        view_directions: &[[f32; 3]],
        lights: usize,
        light: impl Fn(usize, usize) -> &'a CodedLight,
    ) {
        let wide = self.wide();
        let points = self.points.len();
        self.columns = padded(points * lights);
        if points == 0 {
            self.colour.clear();
            self.visibility.clear();
            return;
        }
        networks.rgb.prepare(&mut self.rgb, self.columns, points);
        if let Some(vis) = &networks.vis {
            vis.prepare(&mut self.vis, self.columns, points);
        }
        for (axis, row) in self.direction.iter_mut().enumerate() {
            row.clear();
            row.extend(self.points.iter().map(|p| view_directions[p.ray][axis]));
            row.resize(wide, 0.0);
        }
        let [x, y, z] = &self.direction;
        spherical_harmonics(simd, [x, y, z], &mut self.rgb.shared[0]);
        self.feature_rows(networks);
        self.light_rows(simd, networks, lights, &light);
        let light = light_inputs(networks, &self.poses, &self.harmonics);
        networks.rgb.forward(simd, light, &mut self.rgb);
        self.colour.resize(3 * self.columns, 0.0);
        sigmoid(simd, self.rgb.output(), &mut self.colour);
        self.visibility.resize(self.columns, 0.0);
        if let Some(vis) = &networks.vis {
            vis.forward(simd, &self.harmonics, &mut self.vis);
            sigmoid(simd, self.vis.output(), &mut self.visibility);
        } else {
            self.visibility.fill(1.0);
        }
    }

    /// Fills the rows of `h` and `e`.
    fn feature_rows(&mut self, networks: &Networks) {
        let (n, wide) = (self.points.len(), self.wide());
        let (h, e) = self.features.split_at(networks.features * n);
        let (directions, positions) = networks.shared_rows();
        let rows = &mut self.rgb.shared[0][directions * wide..(directions + positions) * wide];
        fill_rows(h, n, rows, wide);
        let (layer, row) = networks.embedding_place();
        fill_rows(e, n, &mut self.rgb.shared[layer][row * wide..], wide);
        if networks.vis.is_some() {
            fill_rows(h, n, &mut self.vis.shared[0], wide);
        }
    }

    /// Fills the rows that describe the light, for both networks.
    fn light_rows<'a>(
        &mut self,
        simd: Level,
        networks: &Networks,
        lights: usize,
        light: &impl Fn(usize, usize) -> &'a CodedLight,
    ) {
        let (columns, points) = (self.columns, self.points.len());
        let input = networks.architecture.light;
        if input == LightInput::Pose {
            self.poses.resize(networks.architecture.light_inputs() * columns);
            let rows = &mut self.poses;
            rows.fill(0.0);
            for l in 0..lights {
                for (q, point) in self.points.iter().enumerate() {
                    let code = &light(point.ray, l).code;
                    let column = rows[l * points + q..].iter_mut().step_by(columns);
                    column.zip(code).for_each(|(value, &code)| *value = code);
                }
            }
        }
        if input != LightInput::Direction && networks.vis.is_none() {
            return;
        }
        self.direction.iter_mut().for_each(Vec::clear);
        for l in 0..lights {
            for point in &self.points {
                let to: [f32; 3] =
                    std::array::from_fn(|a| light(point.ray, l).position[a] - point.position[a]);
                let norm = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt().max(1e-12);
                for (row, component) in self.direction.iter_mut().zip(to) {
                    row.push(component / norm);
                }
            }
        }
        self.direction.iter_mut().for_each(|row| row.resize(columns, 0.0));
        let [x, y, z] = &self.direction;
        self.harmonics.resize(HARMONICS * columns);
        spherical_harmonics(simd, [x, y, z], &mut self.harmonics);
    }

    /// From `colour_gradient(ray, l)`, the gradient of the colour of a pair, to those of weights and features.
    pub fn backward(
        &mut self,
        simd: Level,
        networks: &Networks,
        lights: usize,
        colour_gradient: impl Fn(usize, usize) -> [f32; 3],
        gradients: &mut Gradients,
    ) {
        let (points, columns, wide) = (self.points.len(), self.columns, self.wide());
        self.weight_gradients.clear();
        self.weight_gradients.resize(points, 0.0);
        self.feature_gradients.clear();
        self.feature_gradients.resize(networks.point_features() * points, 0.0);
        if points == 0 {
            return;
        }
        let (_, d_rgb) = self.rgb.output_and_gradient();
        d_rgb.fill(0.0);
        // Without a visibility network its gradient goes nowhere.
        let mut none = Vec::new();
        let d_vis = if networks.vis.is_some() {
            self.vis.output_and_gradient().1
        } else {
            none.resize(columns, 0.0);
            &mut none[..]
        };
        d_vis.fill(0.0);
        for l in 0..lights {
            for (q, point) in self.points.iter().enumerate() {
                let p = l * points + q;
                let (d, o) = (colour_gradient(point.ray, l), self.visibility[p]);
                let mut d_o = 0.0;
                for channel in 0..3 {
                    let c = self.colour[channel * columns + p];
                    d_rgb[channel * columns + p] = d[channel] * point.weight * o * c * (1.0 - c);
                    d_o += d[channel] * c;
                }
                d_vis[p] = d_o * point.weight * o * (1.0 - o);
                self.weight_gradients[q] += d_o * o;
            }
        }
        let light = light_inputs(networks, &self.poses, &self.harmonics);
        networks.rgb.backward(simd, light, &mut self.rgb, &mut gradients.rgb, networks.rgb_wanted());
        let (h, e) = self.feature_gradients.split_at_mut(networks.features * points);
        let (layer, row) = networks.embedding_place();
        add_rows(&self.rgb.shared_gradient(layer)[row * wide..], wide, e, points);
        let (directions, positions) = networks.shared_rows();
        let skipped = &self.rgb.shared_gradient(0)[directions * wide..(directions + positions) * wide];
        add_rows(skipped, wide, h, points);
        if let Some(vis) = &networks.vis {
            vis.backward(simd, &self.harmonics, &mut self.vis, &mut gradients.vis, 0..networks.features);
            add_rows(self.vis.shared_gradient(0), wide, h, points);
        }
    }
}
