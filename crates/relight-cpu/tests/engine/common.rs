//! Small fields in which everything matters, and rays through them.

use fearless_simd::{Level, Simd};
use relight_cpu::density_grid::DensityGrid;
use relight_cpu::hash_grid::HashGrid;
use relight_cpu::march::UnitCube;
use relight_cpu::networks::Networks;
use relight_cpu::pool::Pool;
use relight_cpu::samples::{Marcher, SampleBatch};
use relight_cpu::shade::CodedLight;
use relight_cpu::shadow::Shadow;
use relight_cpu::tile::Workspace;
use relight_field::architecture::{Architecture, VARIANTS};
use relight_field::encoding::fourier;
use relight_field::engine::{EngineState, LightPose, RayBatch, Rays, StateTensor};
use relight_field::parameters::{FieldConfig, GridConfig, Parameters};
use relight_field::random::Random;
use relight_field::reference::RaySamples;
use relight_field::sampling::Shading;
use relight_scene::{Bounds, Camera, Frustum, Intrinsics, Pose};

pub const BOUNDS: Bounds = Bounds { lo: [-0.5, -0.4, 0.0], hi: [0.5, 0.4, 0.7] };
pub const SHADINGS: [Shading; 2] = [Shading::Deferred, Shading::PerSample];

/// Every variant with either shading.
pub fn cases() -> impl Iterator<Item = (&'static str, Architecture, Shading)> {
    VARIANTS.into_iter().flat_map(|(name, a)| SHADINGS.map(|shading| (name, a, shading)))
}

/// A field whose table is not nearly zero as a fresh one's is.
pub fn field(architecture: Architecture) -> Parameters {
    field_of(architecture, 2)
}

/// The same with so many features an entry.
pub fn field_of(architecture: Architecture, features: usize) -> Parameters {
    let grid = GridConfig { levels: 4, features, log2_table: 9, base: 4, finest: 24 };
    let config = FieldConfig { architecture, grid, bounds: BOUNDS, density_scale: 2.0 };
    let mut parameters = Parameters::init(config, 5).unwrap();
    let random = Random::new(6, 0);
    (0..).zip(&mut parameters.table).for_each(|(i, v)| *v = 0.9 * (random.uniform_at(i) - 0.5));
    parameters
}

pub fn normalised(v: [f32; 3]) -> [f32; 3] {
    let norm = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    v.map(|x| x / norm)
}

/// Rays from all sides through the box. The first misses it, and the second starts inside.
pub fn rays(n: usize) -> Rays {
    let random = Random::new(7, 0);
    let uniform = |i: usize, k: usize| random.uniform_at((8 * i + k) as u64);
    let mut rays = Rays::default();
    for i in 0..n {
        let origin = normalised([0, 1, 2].map(|a| uniform(i, a) - 0.5)).map(|v| 1.5 * v);
        let target: [f32; 3] = std::array::from_fn(|a| {
            BOUNDS.lo[a] + (0.2 + 0.6 * uniform(i, 3 + a)) * (BOUNDS.hi[a] - BOUNDS.lo[a])
        });
        rays.directions.push(normalised(std::array::from_fn(|a| target[a] - origin[a])));
        rays.origins.push(origin);
    }
    rays.directions[0] = normalised(rays.origins[0]);
    rays.origins[1] = [0.1, -0.05, 0.3];
    rays
}

pub fn lights() -> Vec<LightPose> {
    let random = Random::new(8, 0);
    (0..5u64)
        .map(|l| LightPose(std::array::from_fn(|i| random.uniform_at(12 * l + i as u64) - 0.5)))
        .collect()
}

/// Rays with colours under `lights_per_ray` lights, expected depths for some of them, and two probes each, of which every fourth
/// was photographed.
pub fn batch(n: usize, lights_per_ray: usize) -> RayBatch {
    let (random, lights, pairs) = (Random::new(9, 0), lights(), n * lights_per_ray);
    RayBatch {
        rays: rays(n),
        lights_per_ray,
        light_index: (0..pairs).map(|p| ((3 * p + p / 7) % lights.len()) as u32).collect(),
        lights,
        colours: (0..pairs as u64).map(|p| [0, 1, 2].map(|c| random.uniform_at(3 * p + c))).collect(),
        depths: (0..n).map(|r| if r % 3 == 2 { f32::NAN } else { 1.0 + 0.1 * r as f32 }).collect(),
        probe_lights: (0..2 * n).map(|p| self::lights()[p % 4]).collect(),
        probe_colours: (0..2 * n).map(|p| if p % 4 == 0 { [0.3, 0.5, 0.6] } else { [f32::NAN; 3] }).collect(),
    }
}

/// Puts into a checkpoint what is told of probes, sums and numbers: how far imagined colours and the field miss photographs, and how
/// little the field once did; and that shadows of each class leave another share of a colour.
pub fn tell(state: &mut EngineState, [imagined, field]: [[f32; 2]; 2], least: f32) {
    let means = [imagined, field].into_iter().flatten().chain([least]).collect();
    state.insert("probes".into(), StateTensor::F32(means));
    let shares = (0..Shadow::CLASSES).flat_map(|class| [40.0 + class as f32, 90.0, 50.0]).collect();
    state.insert("probes.shadows".into(), StateTensor::F32(shares));
}

/// Every instruction set that this machine has, the best last.
pub fn levels() -> Vec<Level> {
    let best = Level::new();
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    let lower = [
        best.as_avx2().map(|s| s.level()),
        best.as_sse4_2().map(|s| s.level()),
        best.as_sse2().map(|s| s.level()),
    ];
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    let lower = [None];
    lower.into_iter().flatten().chain([best]).collect()
}

/// The parts of an engine.
pub struct Parts {
    pub cube: UnitCube,
    pub density: DensityGrid,
    pub grid: HashGrid,
    pub networks: Networks,
    pub workspaces: Pool<Workspace>,
}

impl Parts {
    pub fn new(parameters: &Parameters) -> Self {
        let config = &parameters.config;
        Self {
            cube: UnitCube::new(&config.bounds),
            density: DensityGrid::uniform(&config.bounds, 16, config.density_scale),
            grid: HashGrid::new(&config.grid, &parameters.table),
            networks: Networks::new(parameters),
            workspaces: Pool::default(),
        }
    }

    pub fn marcher(&self, simd: Level) -> Marcher<'_> {
        Marcher {
            cube: self.cube,
            density: &self.density,
            grid: &self.grid,
            networks: &self.networks,
            simd,
            workspaces: &self.workspaces,
            search: false,
        }
    }
}

/// What a camera at `position` has in view that looks at a target: twice `tangent` of its distance from top to bottom, and a third more
/// from side to side.
pub fn view(position: [f64; 3], target: [f64; 3], tangent: f64) -> Frustum {
    let focal = 15.0 / tangent;
    let (width, height) = (40, 30);
    let intrinsics =
        Intrinsics { width, height, fx: focal, fy: focal, cx: 19.5, cy: 14.5, distortion: Vec::new() };
    Frustum::of(&Camera { label: 0, intrinsics, pose: Pose::look_at(position, target) })
}

pub fn coded(lights: &[LightPose]) -> Vec<CodedLight> {
    let code = |l: &LightPose| CodedLight { position: l.position(), code: fourier::encode(&l.0).to_vec() };
    lights.iter().map(code).collect()
}

/// The samples of every ray of a batch, as the oracle takes them.
pub fn plain_samples(samples: &SampleBatch, rays: usize) -> Vec<RaySamples<f64>> {
    let of = |r: usize| {
        let start = r / samples.tile_rays * samples.columns + r % samples.tile_rays * samples.samples;
        let f64s = |v: &[f32]| v[start..start + samples.samples].iter().map(|&v| f64::from(v)).collect();
        RaySamples { t: f64s(&samples.t), delta: f64s(&samples.lengths) }
    };
    (0..rays).map(of).collect()
}

/// Fails unless arrays differ by less than `tolerance` of the largest number of the second.
pub fn assert_close(what: &str, ours: &[f32], plain: &[f64], tolerance: f64) {
    assert_eq!(ours.len(), plain.len(), "{what}");
    let largest = plain.iter().fold(0f64, |m, v| m.max(v.abs()));
    assert!(largest > 0.0, "{what}: nothing to compare");
    for (i, (&a, &b)) in ours.iter().zip(plain).enumerate() {
        let difference = (f64::from(a) - b).abs();
        assert!(difference <= tolerance * largest, "{what}, number {i}: {a} is not {b}; largest {largest}");
    }
}
