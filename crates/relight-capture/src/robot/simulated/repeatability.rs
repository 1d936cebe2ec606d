//! Where an arm comes to rest when told to go somewhere.

use relight_scene::random::{GAMMA, mix};

use super::super::arm::Joints;

/// Standard deviation of each joint, radians. At the reach of a capture it moves the flange of a UR5e by 0.03 mm (root
/// mean square), the repeatability that its maker declares.
const JOINT_NOISE: f64 = 3.2e-5;

/// Targets are told apart by so much, radians.
const SAME_TARGET: f64 = 1e-6;

/// What the noise of a motion depends on, besides the seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NoiseOf {
    /// On its number: as real arms, it comes to rest a little elsewhere each time.
    #[default]
    Motion,
    /// On where it goes: it comes to rest in the same place each time, however often it was interrupted.
    Target,
}

/// The repeatability of an arm: normal noise on every joint, a pure function of a seed and of what [`NoiseOf`] says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeatability {
    seed: u64,
    deviation: f64,
    of: NoiseOf,
}

impl Repeatability {
    /// The noise of a real arm, drawn from `seed`.
    pub fn new(seed: u64) -> Self {
        Self::of(NoiseOf::Motion, seed)
    }

    /// The same of other things.
    pub fn of(of: NoiseOf, seed: u64) -> Self {
        Self { seed, deviation: JOINT_NOISE, of }
    }

    /// Where the arm rests after motion number `motion` to `target` (rad).
    pub fn reached(&self, motion: u64, target: &Joints) -> Joints {
        let what = match self.of {
            NoiseOf::Motion => motion.wrapping_mul(GAMMA),
            NoiseOf::Target => target.iter().fold(0, |key, q| {
                let step = (q / SAME_TARGET).round() as i64;
                mix(key ^ step.cast_unsigned().wrapping_mul(GAMMA))
            }),
        };
        let key = mix(mix(self.seed.wrapping_add(GAMMA)) ^ what);
        let mut index = 0u64;
        let mut uniform = || {
            index += 1;
            // 53 bits, in (0, 1].
            ((mix(key.wrapping_add(index.wrapping_mul(GAMMA))) >> 11) as f64 + 1.0) / (1u64 << 53) as f64
        };
        target.map(|q| {
            // Box and Muller (1958).
            let (radius, angle) = ((-2.0 * uniform().ln()).sqrt(), std::f64::consts::TAU * uniform());
            q + self.deviation * radius * angle.cos()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::SimulatedModel;
    use super::*;

    #[test]
    fn the_flange_comes_back_to_within_three_hundredths_of_a_millimetre() {
        // Places of a capture dome of half a metre.
        for target in [
            [0.3, -1.2, 1.4, -1.8, -1.6, 0.2],
            [-1.0, -0.9, 1.0, -1.7, -1.4, 0.0],
            [2.0, -1.6, 2.0, -2.0, -1.57, 1.0],
        ] {
            let noise = Repeatability::new(11);
            let wanted = SimulatedModel::UR5E.flange(&target).position();
            let n = 2000;
            let sum: f64 = (0..n)
                .map(|motion| {
                    let reached = SimulatedModel::UR5E.flange(&noise.reached(motion, &target)).position();
                    reached.iter().zip(wanted).map(|(a, b)| (a - b) * (a - b)).sum::<f64>()
                })
                .sum();
            let rms = (sum / f64::from(n as u32)).sqrt();
            assert!((2e-5..4e-5).contains(&rms), "{rms}");
        }
    }

    #[test]
    fn the_noise_depends_on_seed_and_motion_alone() {
        let (noise, target) = (Repeatability::new(1), [0.1; 6]);
        assert_eq!(noise.reached(5, &target), noise.reached(5, &target));
        assert_ne!(noise.reached(5, &target), noise.reached(6, &target));
        assert_ne!(noise.reached(5, &target), Repeatability::new(2).reached(5, &target));
    }

    #[test]
    fn the_noise_of_targets_depends_on_seed_and_target_alone() {
        let (noise, target) = (Repeatability::of(NoiseOf::Target, 1), [0.1; 6]);
        assert_eq!(noise.reached(5, &target), noise.reached(6, &target));
        // What a protocol rounds away does not count; where it goes does.
        let rounded = noise.reached(7, &[0.1 + 1e-10; 6]);
        assert!(rounded.iter().zip(noise.reached(5, &target)).all(|(a, b)| (a - b).abs() < 1e-9));
        let mut other = target;
        other[5] += 1e-4;
        assert_ne!(noise.reached(5, &target)[0], noise.reached(5, &other)[0]);
        assert_ne!(noise.reached(5, &target), Repeatability::of(NoiseOf::Target, 2).reached(5, &target));
    }
}
