//! The samples of a batch, tile by tile: where they lie, and their encoded features.

use std::ops::Range;
use std::time::Instant;

use fearless_simd::Level;
use relight_field::engine::{Rays, StageCost};
use relight_field::random::Random;
use relight_field::sampling::Sampling;

use crate::aligned::Aligned;
use crate::dense::padded;
use crate::density_grid::DensityGrid;
use crate::guide::{Guide, GuideScratch, Span};
use crate::hash_grid::{HashGrid, TiledPositions, set_position};
use crate::march::{self, UnitCube, along};
use crate::networks::Networks;
use crate::packet::{first_rays, take_places};
use crate::placing::{ENDING, KNOWING, LOOKING, Placing, SEARCHING};
use crate::pool::Pool;
use crate::tile::{TileRays, Workspace};

/// Cells of the density grid for which a sample may stand on either side, wherever its neighbours are. Beyond, it stands for as much as
/// samples like it are apart. The last sample before a void would stand for half of that otherwise, and its little density would be a fog.
const REACH: f32 = 0.5;

/// How often a ray looks, at most: the last time it looks to its end.
const MOST_LOOKS: usize = 2;

/// Random numbers of one batch: number `k` of ray `r` is `index r * 2^16 + k`.
#[derive(Clone, Copy)]
pub struct Jitter(pub Option<Random>);

impl Jitter {
    /// Those of the rays from number `first` on.
    pub fn after_rays(self, first: usize) -> Self {
        Self(self.0.map(|random| random.after((first as u64) << 16)))
    }

    /// Where in its part of ray `ray` sample `k` lies, 0..1: the middle when drawing pictures.
    fn at(self, ray: usize, k: usize) -> f32 {
        self.0.map_or(0.5, |random| random.uniform_at((ray as u64) << 16 | k as u64))
    }
}

/// Everything that placing samples needs to know.
pub struct Marcher<'a> {
    /// The box.
    pub cube: UnitCube,
    /// Where density is.
    pub density: &'a DensityGrid,
    /// The encoder.
    pub grid: &'a HashGrid,
    /// The networks.
    pub networks: &'a Networks,
    /// Instruction set.
    pub simd: Level,
    /// Idle workspaces.
    pub workspaces: &'a Pool<Workspace>,
    /// See [`StepSettings::search`](relight_field::engine::StepSettings::search).
    pub search: bool,
}

impl<'a> Marcher<'a> {
    /// What the density grid tells.
    pub fn guide(&self) -> Guide<'a> {
        Guide { simd: self.simd, density: self.density, cube: self.cube }
    }

    /// Whether photographs have a place in the box in view.
    pub fn has_in_view(&self, place: [f32; 3]) -> bool {
        !self.density.is_hidden(self.density.cell(self.cube.map(place)))
    }
}

/// Samples of rays that one thread looks along. Tile `i` holds rays `i * tile_rays` and following; the columns of its samples are
/// described by [`TileRays`].
#[derive(Default)]
pub struct SampleBatch {
    /// Rays a tile.
    pub tile_rays: usize,
    /// Samples a ray.
    pub samples: usize,
    /// Columns of a tile.
    pub columns: usize,
    /// `[tile][columns]`: distances, metres.
    pub t: Vec<f32>,
    /// `[tile][columns]`: interval lengths, metres.
    pub lengths: Vec<f32>,
    /// `[tile][3][columns]`: positions in the unit cube.
    pub positions: Vec<f32>,
    /// `[tile][features][columns]`.
    pub features: Aligned,
    /// What placing and encoding the samples cost.
    pub marched: StageCost,
    /// See `marched`.
    pub encoded: StageCost,
    /// `[tile][columns]`, of the first rays of packets: how far samples as each are apart, metres.
    apart: Vec<f32>,
    /// Of each ray, where it begins to look, and where it leaves the box.
    spans: Vec<Span>,
    /// Of each ray, how far it has looked: see [`SampleBatch::look_on`].
    ends: Vec<f32>,
    /// How often rays have looked.
    looks: usize,
    /// The first ray of the packet of each ray that looks.
    firsts: Vec<usize>,
    /// The first rays of packets.
    alone: Vec<usize>,
    scratch: GuideScratch,
}

impl SampleBatch {
    /// Places the samples of `rays` and encodes them, `tile_rays` rays a tile.
    pub fn fill(
        &mut self,
        marcher: &Marcher<'_>,
        rays: &Rays,
        sampling: Sampling,
        tile_rays: usize,
        jitter: Jitter,
    ) {
        self.place(marcher, rays, sampling, tile_rays, jitter);
        self.encode(marcher, rays);
    }

    /// Places the samples of `rays`, `tile_rays` rays a tile; [`SampleBatch::tile`] has to wait until they are encoded.
    fn place(
        &mut self,
        marcher: &Marcher<'_>,
        rays: &Rays,
        sampling: Sampling,
        tile_rays: usize,
        jitter: Jitter,
    ) {
        (self.marched, self.encoded) = (StageCost::default(), StageCost::default());
        let started = Instant::now();
        self.enter(marcher, rays, sampling, tile_rays);
        match sampling {
            Sampling::Guided { .. } => {
                let placing = if marcher.search { &SEARCHING } else { &KNOWING };
                self.guide(marcher, rays, 0..rays.origins.len(), placing, jitter);
            }
            Sampling::Stratified { fine, .. } => self.stratify(marcher, rays, fine, jitter),
        }
        self.marched.seconds = started.elapsed().as_secs_f64() - self.encoded.seconds;
    }

    /// Lets `rays` enter the box, `tile_rays` a tile.
    pub fn enter(&mut self, marcher: &Marcher<'_>, rays: &Rays, sampling: Sampling, tile_rays: usize) {
        let samples = match sampling {
            Sampling::Guided { samples } => samples,
            Sampling::Stratified { coarse, .. } => coarse,
        };
        self.shape(rays, tile_rays, samples);
        self.spans.clear();
        let rays = rays.origins.iter().zip(&rays.directions);
        self.spans.extend(rays.map(|(&origin, &direction)| marcher.cube.clip(origin, direction)));
        self.ends.clear();
        self.ends.extend(self.spans.iter().map(|span| span.0));
        self.looks = 0;
    }

    /// Places samples of those of `rays` that are `going` on, from where they have looked to. With guided samples they look to the first
    /// void behind something, so that all samples are for that and none for what it may hide; others look to the end at once.
    pub fn look_on(&mut self, marcher: &Marcher<'_>, rays: &Rays, sampling: Sampling, going: &[usize]) {
        match sampling {
            Sampling::Guided { .. } => {
                going.iter().for_each(|&ray| self.spans[ray].0 = self.ends[ray]);
                self.looks += 1;
                let placing = if self.looks < MOST_LOOKS { &LOOKING } else { &ENDING };
                self.guide(marcher, rays, going.iter().copied(), placing, Jitter(None));
            }
            Sampling::Stratified { fine, .. } => self.stratify(marcher, rays, fine, Jitter(None)),
        }
    }

    /// Whether a ray has looked as far as where it leaves the box: its last sample is opaque.
    pub fn leaves(&self, ray: usize) -> bool {
        self.ends[ray] >= self.spans[ray].1
    }

    /// Places samples of `looking`, rays by number, where the density grid says that something is.
    fn guide(
        &mut self,
        marcher: &Marcher<'_>,
        rays: &Rays,
        looking: impl Iterator<Item = usize> + Clone,
        placing: &Placing,
        jitter: Jitter,
    ) {
        let shape = (self.tile_rays, self.samples);
        let columns = |ray: usize| columns_of(ray, shape);
        let Self { spans, ends, firsts, alone, scratch, t, lengths, apart, .. } = self;
        apart.resize(t.len(), 0.0);
        match jitter.0 {
            Some(_) => {
                firsts.clear();
                firsts.extend(looking.clone());
            }
            None => first_rays(rays, looking.clone(), spans, marcher.density.cell_size(), firsts),
        }
        alone.clear();
        alone.extend(looking.clone().zip(&*firsts).filter(|(ray, first)| ray == *first).map(|(ray, _)| ray));
        let guided = alone.iter().map(|&ray| ((rays.origins[ray], rays.directions[ray]), spans[ray]));
        marcher.guide().guided(placing, guided, scratch, |i, places| {
            let (ray, here) = (alone[i], columns(alone[i]));
            ends[ray] = if places.leaves { f32::INFINITY } else { places.end };
            places.draw(|k| jitter.at(ray, k), &mut t[here.clone()], &mut apart[here]);
        });
        let reach = if marcher.search { f32::INFINITY } else { REACH * marcher.density.cell_size() };
        for (ray, &first) in looking.zip(&*firsts) {
            let (near, far) = spans[ray];
            if first != ray {
                ends[ray] = ends[first];
                t.copy_within(columns(first), columns(ray).start);
                take_places((near, far), ends[ray] >= far, &mut t[columns(ray)]);
            }
            let (t, lengths, apart) = (&t[columns(ray)], &mut lengths[columns(ray)], &apart[columns(first)]);
            march::interval_lengths(t, (near, far.min(ends[ray])), |i| apart[i].max(reach), lengths);
        }
    }

    /// Where in `t` and `lengths` the samples of a ray are.
    pub fn columns_of(&self, ray: usize) -> Range<usize> {
        columns_of(ray, (self.tile_rays, self.samples))
    }

    /// Places a sample in each of as many equal parts of all rays as they have samples, and adds `fine` more.
    fn stratify(&mut self, marcher: &Marcher<'_>, rays: &Rays, fine: usize, jitter: Jitter) {
        let shape = (self.tile_rays, self.samples);
        place_each(&self.spans, shape, (&mut self.t, &mut self.lengths), |ray, span, t| {
            march::stratified(span, |k| jitter.at(ray, k), t);
        });
        if fine > 0 {
            self.refine(marcher, rays, fine, jitter);
        }
        self.ends.fill(f32::INFINITY);
    }

    /// Adds `fine` samples a ray, drawn from the weights of those at hand (paper section 4.3; Mildenhall et al.
    /// 2020, section 5.2).
    fn refine(&mut self, marcher: &Marcher<'_>, rays: &Rays, fine: usize, jitter: Jitter) {
        self.encode(marcher, rays);
        let (coarse, tile_rays) = (self.samples, self.tile_rays);
        let mut weights: Vec<f32> = Vec::with_capacity(self.t.len());
        marcher.workspaces.with(Workspace::default, |workspace| {
            for tile in 0..self.tiles(rays) {
                workspace.look(marcher.simd, marcher.networks, &self.tile(marcher, rays, tile));
                weights.extend(&workspace.weights);
            }
        });
        let (old_t, old_lengths) = (std::mem::take(&mut self.t), std::mem::take(&mut self.lengths));
        self.shape(rays, tile_rays, coarse + fine);
        let (shape, places) = ((tile_rays, coarse + fine), (&mut self.t[..], &mut self.lengths[..]));
        place_each(&self.spans, shape, places, |ray, span, t| {
            let before = columns_of(ray, (tile_rays, coarse));
            let (old, weights) = (&old_t[before.clone()], &weights[before.clone()]);
            let (first, rest) = t.split_at_mut(coarse);
            first.copy_from_slice(old);
            // A little everywhere, so that a ray through nothing has somewhere to draw from.
            // What the opaque last sample weighs is what no density stopped: nothing to look closer at.
            let mut mass: Vec<f32> = weights.iter().map(|w| w + 1e-5).collect();
            mass[coarse - 1] = 1e-5;
            let old_lengths = &old_lengths[before];
            let mut end = span.0;
            let ends: Vec<f32> = old_lengths
                .iter()
                .map(|l| {
                    end += l;
                    end
                })
                .collect();
            march::draw(
                &mass,
                span.0,
                |b| ends[b],
                |k| jitter.at(ray, coarse + k),
                fine,
                |i, at, _| rest[i] = at,
            );
            t.sort_by(f32::total_cmp);
        });
    }

    fn shape(&mut self, rays: &Rays, tile_rays: usize, samples: usize) {
        (self.tile_rays, self.samples, self.columns) = (tile_rays, samples, padded(tile_rays * samples));
        let total = self.tiles(rays) * self.columns;
        self.t.clear();
        self.t.resize(total, 0.0);
        self.lengths.clear();
        self.lengths.resize(total, 0.0);
    }

    /// Tiles of the batch.
    pub fn tiles(&self, rays: &Rays) -> usize {
        rays.origins.len().div_ceil(self.tile_rays.max(1))
    }

    fn encode(&mut self, marcher: &Marcher<'_>, rays: &Rays) {
        let started = Instant::now();
        let (k, columns, tile_rays) = (self.samples, self.columns, self.tile_rays);
        self.positions.resize(3 * self.t.len(), 0.0);
        self.features.resize(marcher.networks.features * self.t.len());
        let tiles = self.positions.chunks_exact_mut(3 * columns).zip(self.t.chunks_exact(columns));
        for (tile, (positions, t)) in tiles.enumerate() {
            positions.fill(0.5);
            let first = tile * tile_rays;
            let here = first..(first + tile_rays).min(rays.origins.len());
            for (r, ray) in here.enumerate() {
                let (origin, direction) = (rays.origins[ray], rays.directions[ray]);
                for (column, &t) in t.iter().enumerate().skip(r * k).take(k) {
                    let unit = marcher.cube.map(along(origin, direction, t));
                    set_position(positions, column, unit);
                }
            }
        }
        let positions = TiledPositions { data: &self.positions, columns };
        marcher.grid.encode(marcher.simd, positions, &mut self.features);
        self.encoded.add(&StageCost {
            seconds: started.elapsed().as_secs_f64(),
            ..marcher.grid.encode_cost(rays.origins.len() * k)
        });
    }

    /// The positions, as the grid takes them.
    pub fn positions(&self) -> TiledPositions<'_> {
        TiledPositions { data: &self.positions, columns: self.columns }
    }

    /// The rays of one tile of a batch.
    pub fn range(&self, rays: &Rays, tile: usize) -> Range<usize> {
        let first = tile * self.tile_rays;
        first..(first + self.tile_rays).min(rays.origins.len())
    }

    /// One tile.
    pub fn tile<'a>(&'a self, marcher: &Marcher<'_>, rays: &'a Rays, tile: usize) -> TileRays<'a> {
        let here = self.range(rays, tile);
        let span = tile * self.columns..(tile + 1) * self.columns;
        let features = marcher.networks.features;
        TileRays {
            origins: &rays.origins[here.clone()],
            directions: &rays.directions[here],
            samples: self.samples,
            columns: self.columns,
            t: &self.t[span.clone()],
            lengths: &self.lengths[span.clone()],
            features: &self.features[span.start * features..span.end * features],
        }
    }
}

/// The columns of a ray's samples, in tiles of `tile_rays` rays with `samples` samples each.
fn columns_of(ray: usize, (tile_rays, samples): (usize, usize)) -> Range<usize> {
    let first = ray / tile_rays * padded(tile_rays * samples) + ray % tile_rays * samples;
    first..first + samples
}

/// Places the samples of every ray, in tiles of `tile_rays` rays with `samples` samples each: calls
/// `one(ray, span, t)`, `span` being where the ray is inside the box, to fill `t`, and works out their lengths.
fn place_each(
    spans: &[Span],
    shape: (usize, usize),
    (t, lengths): (&mut [f32], &mut [f32]),
    mut one: impl FnMut(usize, Span, &mut [f32]),
) {
    for (ray, &span) in spans.iter().enumerate() {
        let here = columns_of(ray, shape);
        let (t, lengths) = (&mut t[here.clone()], &mut lengths[here]);
        one(ray, span, t);
        march::interval_lengths(t, span, |_| f32::INFINITY, lengths);
    }
}
