//! Sample points that depend on nothing but their names: the same for any number of threads and in any order.

/// SplitMix64's finaliser (Steele, Lea and Flood 2014).
const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A hash of a few numbers, in order.
pub(super) fn hash(numbers: &[u64]) -> u64 {
    numbers.iter().fold(0x9E37_79B9_7F4A_7C15, |key, &n| {
        mix(key ^ n.wrapping_mul(0xD6E8_FEB8_6659_FD93)).wrapping_add(0x9E37_79B9_7F4A_7C15)
    })
}

/// A number in [0, 1), from the upper bits of a hash.
pub(super) fn uniform(hash: u64) -> f32 {
    (hash >> 40) as f32 * (1.0 / 16_777_216.0)
}

/// Two independent normal numbers (Box and Muller), from a hash.
pub(super) fn normals(hash: u64) -> [f64; 2] {
    let u = ((hash >> 32) as f64 + 0.5) / 4_294_967_296.0;
    let angle = std::f64::consts::TAU * (hash & 0xFFFF_FFFF) as f64 / 4_294_967_296.0;
    let radius = (-2.0 * u.ln()).sqrt();
    [radius * angle.cos(), radius * angle.sin()]
}

/// Owen's nested scramble of a number's bits, by the hash of Laine and Karras in the constants of Burley (2020).
fn scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x ^= x.wrapping_mul(0x3D20_ADEA);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6C56);
    x ^= x.wrapping_mul(0x53A2_2864);
    x.reverse_bits()
}

/// Point `index` of a scrambled and shuffled (0, 2)-sequence (Sobol's first two dimensions): any first 2^n points are
/// stratified in every way in which 2^n points can be. Each `seed` has a sequence of its own.
pub(super) fn stratified(index: u32, seed: u64) -> [f32; 2] {
    let index = scramble(index, (seed >> 32) as u32 ^ 0x68E3_1DA4);
    let (mut second, mut direction, mut rest) = (0u32, 1u32 << 31, index);
    while rest != 0 {
        if rest & 1 == 1 {
            second ^= direction;
        }
        rest >>= 1;
        direction ^= direction >> 1;
    }
    let to_unit = |bits: u32| (bits >> 8) as f32 * (1.0 / 16_777_216.0);
    let key = mix(seed);
    [to_unit(scramble(index.reverse_bits(), key as u32)), to_unit(scramble(second, (key >> 32) as u32))]
}

/// A point of the unit square onto the unit disc, areas kept (Shirley and Chiu 1997).
pub(super) fn to_disc([u, v]: [f32; 2]) -> [f32; 2] {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0, 0.0];
    }
    let quarter = std::f32::consts::FRAC_PI_4;
    let (radius, angle) =
        if a.abs() > b.abs() { (a, quarter * (b / a)) } else { (b, 2.0 * quarter - quarter * (a / b)) };
    [radius * angle.cos(), radius * angle.sin()]
}
