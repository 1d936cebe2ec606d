//! Pictures and single points: the forward half of a step.

use rayon::prelude::*;
use relight_field::architecture::{EMBEDDING, LightInput};
use relight_field::engine::{EngineError, FieldValues, Outputs, Points, Rays, Samples};
use relight_field::sampling::{Sampling, Shading};

use crate::deferred;
use crate::dense::padded;
use crate::front_to_back::{self, FrontToBack};
use crate::hash_grid::{TiledPositions, set_position};
use crate::march::along;
use crate::networks::Networks;
use crate::pool::Pool;
use crate::samples::{Jitter, Marcher, SampleBatch};
use crate::shade::{CodedLight, Point, Shader};
use crate::tile::Workspace;

/// Rays that are marched and encoded together: whole tiles, and so few that what they have met stays in the second-level cache.
const BLOCK_RAYS: usize = 10 * front_to_back::TILE_RAYS;
/// Columns a tile aims at.
const TILE_COLUMNS: usize = 192;
/// Points of a query that are evaluated together.
const QUERY_POINTS: usize = 192;

/// Draws rays under one light.
pub fn draw(
    marcher: &Marcher<'_>,
    memories: &Pool<DrawMemory>,
    sampling: Sampling,
    shading: Shading,
    rays: &Rays,
    light: &CodedLight,
    outputs: Outputs,
) -> Result<Samples, EngineError> {
    let n = rays.origins.len();
    if rays.directions.len() != n {
        return Err(EngineError::Shape("origins and directions differ in number".into()));
    }
    let mut all = empty(marcher.networks, n, outputs);
    blocks(&mut all).into_par_iter().enumerate().with_max_len(1).for_each(|(number, block)| {
        memories.with(DrawMemory::default, |memory| {
            let first = number * BLOCK_RAYS;
            let range = first..first + block.colour.len();
            memory.rays.origins.clear();
            memory.rays.origins.extend_from_slice(&rays.origins[range.clone()]);
            memory.rays.directions.clear();
            memory.rays.directions.extend_from_slice(&rays.directions[range]);
            match shading {
                Shading::Deferred => draw_deferred(marcher, memory, sampling, light, block),
                Shading::PerSample => draw_per_sample(marcher, memory, sampling, light, block),
            }
        });
    });
    Ok(all)
}

/// What a block of rays shows: black so far. Maps that nobody wants are empty.
struct Block<'a> {
    colour: &'a mut [[f32; 3]],
    visibility: &'a mut [f32],
    reflectance: &'a mut [[f32; 3]],
    depth: &'a mut [f32],
    opacity: &'a mut [f32],
}

/// Shares out what rays show.
fn blocks(all: &mut Samples) -> Vec<Block<'_>> {
    let mut visibility = all.visibility.chunks_mut(BLOCK_RAYS);
    let mut reflectance = all.reflectance.chunks_mut(BLOCK_RAYS);
    let always = all.colour.chunks_mut(BLOCK_RAYS).zip(all.depth.chunks_mut(BLOCK_RAYS));
    let always = always.zip(all.opacity.chunks_mut(BLOCK_RAYS));
    let blocks = always.map(|((colour, depth), opacity)| Block {
        colour,
        visibility: visibility.next().unwrap_or_default(),
        reflectance: reflectance.next().unwrap_or_default(),
        depth,
        opacity,
    });
    blocks.collect()
}

/// Memory of one thread, reused from block to block and from picture to picture.
#[derive(Default)]
pub struct DrawMemory {
    rays: Rays,
    samples: SampleBatch,
    seen: FrontToBack,
}

/// Rays whose samples fill a tile.
fn tile_rays(sampling: Sampling) -> usize {
    (TILE_COLUMNS / sampling.samples()).max(1)
}

/// Looks along the rays, then decodes a colour for what each meets inside the box, and one for its last sample where what
/// lies beyond shows.
fn draw_deferred(
    marcher: &Marcher<'_>,
    memory: &mut DrawMemory,
    sampling: Sampling,
    light: &CodedLight,
    mut block: Block<'_>,
) {
    let DrawMemory { rays, samples, seen } = memory;
    let n = rays.origins.len();
    samples.enter(marcher, rays, sampling, tile_rays(sampling));
    seen.look(marcher, rays, sampling, samples);
    let last = |ray| samples.t[samples.columns_of(ray).end - 1];
    let inside = |ray: usize| 1.0 - seen.transmittance[ray];
    let shares = |ray| deferred::shares(inside(ray), seen.transmittance[ray]);
    for ray in 0..n {
        block.depth[ray] = seen.depths[ray] + seen.transmittance[ray] * last(ray);
        block.opacity[ray] = inside(ray);
    }
    // Rays, and for their last samples the number among those that show.
    let inner = (0..n).filter(|&ray| shares(ray).0 > 0.0).map(|ray| (ray, None));
    let outer = seen.faces.iter().enumerate().map(|(face, &ray)| (ray, Some(face)));
    let sites: Vec<(usize, Option<usize>)> = inner.chain(outer).collect();
    marcher.workspaces.with(Workspace::default, |Workspace { shader, .. }| {
        for sites in sites.chunks(TILE_COLUMNS) {
            shader.points.clear();
            shader.points.extend(sites.iter().map(|&(ray, face)| {
                let (t, weight) = match face {
                    None => (seen.depths[ray] / inside(ray), shares(ray).0),
                    Some(_) => (last(ray), shares(ray).1),
                };
                Point { ray, position: along(rays.origins[ray], rays.directions[ray], t), weight }
            }));
            shader.features.clear();
            for (of_rays, of_faces) in seen.feature_rows() {
                shader.features.extend(sites.iter().map(|&(ray, face)| match face {
                    None => of_rays[ray] / inside(ray),
                    Some(face) => of_faces[face],
                }));
            }
            shader.forward(marcher.simd, marcher.networks, &rays.directions, 1, |_, _| light);
            add_up(shader, 0, &mut block);
        }
    });
}

/// Decodes a colour at every sample that weighs something.
fn draw_per_sample(
    marcher: &Marcher<'_>,
    memory: &mut DrawMemory,
    sampling: Sampling,
    light: &CodedLight,
    mut block: Block<'_>,
) {
    let DrawMemory { rays, samples: batch, .. } = memory;
    batch.fill(marcher, rays, sampling, tile_rays(sampling), Jitter(None));
    marcher.workspaces.with(Workspace::default, |workspace| {
        for tile in 0..batch.tiles(rays) {
            let here = batch.tile(marcher, rays, tile);
            workspace.forward(marcher.simd, marcher.networks, Shading::PerSample, &here, 1, |_, _| light);
            let first = batch.range(rays, tile).start;
            for (r, depth) in workspace.depths.iter().enumerate() {
                block.depth[first + r] = *depth;
                block.opacity[first + r] = 1.0 - workspace.weights[(r + 1) * here.samples - 1];
            }
            add_up(&workspace.shader, first, &mut block);
        }
    });
}

/// What `n` rays show, to be added up: black so far.
fn empty(networks: &Networks, n: usize, outputs: Outputs) -> Samples {
    let visibility = if outputs.visibility && networks.vis.is_some() { n } else { 0 };
    let reflectance = if outputs.reflectance { n } else { 0 };
    Samples {
        colour: vec![[0.0; 3]; n],
        visibility: vec![0.0; visibility],
        reflectance: vec![[0.0; 3]; reflectance],
        depth: vec![0.0; n],
        opacity: vec![0.0; n],
    }
}

/// Adds the points of a shader to what their rays show, which are numbered from `first` on.
fn add_up(shader: &Shader, first: usize, block: &mut Block<'_>) {
    let columns = shader.columns();
    for (q, point) in shader.points.iter().enumerate() {
        let (ray, visibility) = (first + point.ray, shader.visibility[q]);
        let reflectance = [0, 1, 2].map(|c| point.weight * shader.colour[c * columns + q]);
        block.colour[ray].iter_mut().zip(reflectance).for_each(|(sum, c)| *sum += visibility * c);
        if let Some(sum) = block.visibility.get_mut(ray) {
            *sum += point.weight * visibility;
        }
        if let Some(sum) = block.reflectance.get_mut(ray) {
            sum.iter_mut().zip(reflectance).for_each(|(sum, c)| *sum += c);
        }
    }
}

/// The field at points.
pub fn query(
    marcher: &Marcher<'_>,
    points: &Points,
    light: Option<&CodedLight>,
) -> Result<FieldValues, EngineError> {
    let n = points.positions.len();
    if points.directions.len() != n {
        return Err(EngineError::Shape("positions and directions differ in number".into()));
    }
    let networks = marcher.networks;
    let architecture = networks.architecture;
    let nowhere = CodedLight { position: [0.0; 3], code: Vec::new() };
    let needed = architecture.light != LightInput::None || architecture.visibility;
    let light = match light {
        None if needed => return Err(EngineError::Shape("this field needs a light".into())),
        light => light.unwrap_or(&nowhere),
    };
    let columns = padded(QUERY_POINTS);
    let mut values =
        FieldValues { visibility: networks.vis.is_some().then(Vec::new), ..FieldValues::default() };
    let mut workspace = Workspace::default();
    let mut positions = vec![0.0; 3 * columns];
    let mut features = vec![0.0; networks.features * columns];
    let mut embeddings = vec![0.0; EMBEDDING * columns];
    let chunks = points.positions.chunks(QUERY_POINTS).zip(points.directions.chunks(QUERY_POINTS));
    for (world, directions) in chunks {
        let single = |v: &[f64; 3]| v.map(|c| c as f32);
        let world: Vec<[f32; 3]> = world.iter().map(single).collect();
        let directions: Vec<[f32; 3]> = directions.iter().map(single).collect();
        positions.fill(0.5);
        for (i, &p) in world.iter().enumerate() {
            set_position(&mut positions, i, marcher.cube.map(p));
        }
        marcher.grid.encode(marcher.simd, TiledPositions { data: &positions, columns }, &mut features);
        workspace.densities(marcher.simd, networks, &features, columns);
        for (&p, &density) in world.iter().zip(&workspace.density) {
            let inside = marcher.cube.map(p).iter().all(|u| (0.0..=1.0).contains(u));
            values.density.push(if inside { density } else { 0.0 });
        }
        let mut shader = std::mem::take(&mut workspace.shader);
        shader.points.clear();
        shader.points.extend(world.iter().enumerate().map(|(ray, &position)| Point {
            ray,
            position,
            weight: 1.0,
        }));
        shader.features.clear();
        networks.embeddings(marcher.simd, workspace.hidden_activations(), columns, &mut embeddings);
        let rows = features.chunks_exact(columns).chain(embeddings.chunks_exact(columns));
        shader.features.extend(rows.flat_map(|row| &row[..world.len()]));
        shader.forward(marcher.simd, networks, &directions, 1, |_, _| light);
        let width = shader.columns();
        for i in 0..world.len() {
            let o = shader.visibility[i];
            values.rgb.push([0, 1, 2].map(|channel| o * shader.colour[channel * width + i]));
            if let Some(visibility) = &mut values.visibility {
                visibility.push(o);
            }
        }
        workspace.shader = shader;
    }
    Ok(values)
}
