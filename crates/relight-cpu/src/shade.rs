//! Colour and visibility of points under lights: the networks `rgb` and `vis` on all pairs of a tile.
//!
//! A point has features (`h` and `e`), a position and a ray; each point meets the same number of lights, and a pair
//! is a column of the networks.

use fearless_simd::Level;
use relight_field::architecture::{EMBEDDING, HARMONICS, LightInput};

use crate::dense::padded;
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
    direction: [Vec<f32>; 3],
    harmonics: Vec<f32>,
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// Repeats each number of `source` `times` times, and fills up with zeros.
fn spread(source: &[f32], times: usize, row: &mut [f32]) {
    let (pairs, rest) = row.split_at_mut(source.len() * times);
    if times > 0 {
        for (chunk, &value) in pairs.chunks_exact_mut(times).zip(source) {
            chunk.fill(value);
        }
    }
    rest.fill(0.0);
}

/// Adds each `times` neighbouring numbers of `row` to one number of `sums`.
fn gather(row: &[f32], times: usize, sums: &mut [f32]) {
    for (sum, chunk) in sums.iter_mut().zip(row.chunks_exact(times)) {
        *sum += chunk.iter().sum::<f32>();
    }
}

impl Shader {
    /// Columns of the colour and visibility rows.
    pub fn columns(&self) -> usize {
        self.columns
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
        let points = self.points.len();
        let columns = padded(points * lights);
        self.columns = columns;
        networks.rgb.prepare(&mut self.rgb, columns);
        for (axis, row) in self.direction.iter_mut().enumerate() {
            row.clear();
            row.extend(self.points.iter().map(|p| view_directions[p.ray][axis]));
            row.resize(padded(points), 0.0);
        }
        self.harmonics.resize(HARMONICS * padded(points), 0.0);
        let [x, y, z] = &self.direction;
        spherical_harmonics(simd, [x, y, z], &mut self.harmonics);
        for (row, source) in
            self.rgb.values[0].chunks_exact_mut(columns).zip(self.harmonics.chunks_exact(padded(points)))
        {
            spread(&source[..points], lights, row);
        }
        self.light_rows(simd, networks, lights, &light);
        self.feature_rows(networks, lights);
        networks.rgb.forward(simd, &mut self.rgb);
        self.colour.clear();
        self.colour.extend(self.rgb.output().iter().map(|&x| sigmoid(x)));
        self.visibility.clear();
        if let Some(vis) = &networks.vis {
            vis.forward(simd, &mut self.vis);
            self.visibility.extend(self.vis.output().iter().map(|&x| sigmoid(x)));
        } else {
            self.visibility.resize(columns, 1.0);
        }
    }

    /// Fills the rows that describe the light, in both networks.
    fn light_rows<'a>(
        &mut self,
        simd: Level,
        networks: &Networks,
        lights: usize,
        light: &impl Fn(usize, usize) -> &'a CodedLight,
    ) {
        let columns = self.columns;
        let input = networks.architecture.light;
        let first = networks.light_row() * columns;
        let rows = &mut self.rgb.values[0][first..networks.position_row() * columns];
        if input == LightInput::Pose {
            for (i, row) in rows.chunks_exact_mut(columns).enumerate() {
                let (pairs, rest) = row.split_at_mut(self.points.len() * lights);
                for (point, chunk) in self.points.iter().zip(pairs.chunks_exact_mut(lights)) {
                    for (l, value) in chunk.iter_mut().enumerate() {
                        *value = light(point.ray, l).code[i];
                    }
                }
                rest.fill(0.0);
            }
        }
        if input != LightInput::Direction && networks.vis.is_none() {
            return;
        }
        self.direction.iter_mut().for_each(Vec::clear);
        for point in &self.points {
            for l in 0..lights {
                let to: [f32; 3] =
                    std::array::from_fn(|a| light(point.ray, l).position[a] - point.position[a]);
                let norm = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt().max(1e-12);
                for (row, component) in self.direction.iter_mut().zip(to) {
                    row.push(component / norm);
                }
            }
        }
        self.direction.iter_mut().for_each(|d| d.resize(columns, 0.0));
        let [x, y, z] = &self.direction;
        if input == LightInput::Direction {
            spherical_harmonics(simd, [x, y, z], rows);
        }
        if let Some(vis) = &networks.vis {
            vis.prepare(&mut self.vis, columns);
            let start = networks.features * columns;
            spherical_harmonics(simd, [x, y, z], &mut self.vis.values[0][start..]);
        }
    }

    /// Fills the rows of `h` and `e`.
    fn feature_rows(&mut self, networks: &Networks, lights: usize) {
        let (points, columns) = (self.points.len(), self.columns);
        let (h, e) = self.features.split_at(networks.features * points);
        let fill = |rows: &mut [f32], source: &[f32]| {
            if points > 0 {
                for (row, source) in rows.chunks_exact_mut(columns).zip(source.chunks_exact(points)) {
                    spread(source, lights, row);
                }
            }
        };
        if networks.architecture.position_skip {
            fill(&mut self.rgb.values[0][networks.position_row() * columns..], h);
        }
        let (layer, row) = networks.embedding_place();
        fill(&mut self.rgb.values[layer][row * columns..(row + EMBEDDING) * columns], e);
        if networks.vis.is_some() {
            fill(&mut self.vis.values[0][..networks.features * columns], h);
        }
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
        let (points, columns) = (self.points.len(), self.columns);
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
        for (q, point) in self.points.iter().enumerate() {
            for l in 0..lights {
                let (p, d, o) =
                    (q * lights + l, colour_gradient(point.ray, l), self.visibility[q * lights + l]);
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
        let last = networks.rgb.inputs();
        networks.rgb.backward(simd, &mut self.rgb, &mut gradients.rgb, networks.position_row()..last);
        let (h, e) = self.feature_gradients.split_at_mut(networks.features * points);
        let (layer, row) = networks.embedding_place();
        for (i, sums) in e.chunks_exact_mut(points).enumerate() {
            gather(self.rgb.input_gradient(layer, row + i), lights, sums);
        }
        if networks.architecture.position_skip {
            for (i, sums) in h.chunks_exact_mut(points).enumerate() {
                gather(self.rgb.input_gradient(0, networks.position_row() + i), lights, sums);
            }
        }
        if let Some(vis) = &networks.vis {
            vis.backward(simd, &mut self.vis, &mut gradients.vis, 0..networks.features);
            for (i, sums) in h.chunks_exact_mut(points).enumerate() {
                gather(self.vis.input_gradient(0, i), lights, sums);
            }
        }
    }
}
