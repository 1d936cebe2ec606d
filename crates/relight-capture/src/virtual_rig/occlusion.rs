//! Whether anything stands between points and the lamp, for sixteen rays at a time.
//!
//! The rays of a packet go from neighbouring points to one lamp, or from one point to neighbouring lamps, and so visit
//! nearly the same boxes. What is found for a ray does not depend on the others of its packet: it goes on only where it
//! meets the box itself.

use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};

use super::geometry::{EDGE, Geometry};

/// Rays of a packet.
pub(super) const LANES: usize = 16;

/// Rays with an origin, a unit direction and an end.
pub(super) struct Packet {
    pub origin: [[f32; LANES]; 3],
    pub direction: [[f32; LANES]; 3],
    /// Distance to the lamp, metres.
    pub length: [f32; LANES],
    /// One bit for each ray that is asked about.
    pub asked: u32,
}

/// Nodes that are still to visit, and the rays that visit them; kept between calls to save its memory.
pub(super) type Stack = Vec<(u32, u32)>;

impl Geometry {
    /// One bit for each ray that meets a surface before its end.
    pub(super) fn occluded(&self, level: Level, packet: &Packet, stack: &mut Stack) -> u32 {
        if packet.asked == 0 {
            return 0;
        }
        dispatch!(level, simd => simd.vectorize(
            #[inline(always)]
            || self.occluded_simd(simd, packet, stack)
        ))
    }

    #[inline(always)]
    fn occluded_simd<S: Simd>(&self, simd: S, packet: &Packet, stack: &mut Stack) -> u32 {
        let rays = Rays::load(simd, packet);
        let (nodes, mut occluded) = (&self.tree.nodes, 0u32);
        stack.clear();
        stack.push((0, packet.asked));
        while let Some((index, asked)) = stack.pop() {
            let asked = asked & !occluded;
            if asked == 0 {
                continue;
            }
            let node = &nodes[index as usize];
            let bounds = node.aabb();
            let inside = asked & rays.meet_box(simd, bounds.min.to_array(), bounds.max.to_array());
            if inside == 0 {
                continue;
            }
            let first = node.first_index;
            if node.is_leaf() {
                for triangle in &self.triangles[first as usize..(first + node.prim_count) as usize] {
                    let corners = [triangle.corner, triangle.first, triangle.second, triangle.normal];
                    occluded |= inside & rays.meet_triangle(simd, corners.map(|v| v.to_array()));
                }
                if occluded & packet.asked == packet.asked {
                    break;
                }
            } else {
                stack.push((first, inside));
                stack.push((first + 1, inside));
            }
        }
        occluded & packet.asked
    }
}

/// A packet in registers.
struct Rays<S: Simd> {
    origin: [f32x16<S>; 3],
    direction: [f32x16<S>; 3],
    inverse: [f32x16<S>; 3],
    length: f32x16<S>,
}

impl<S: Simd> Rays<S> {
    #[inline(always)]
    fn load(simd: S, packet: &Packet) -> Self {
        let load = |values: &[f32; LANES]| f32x16::load_array(simd, *values);
        let invert = |direction: &[f32; LANES]| {
            // No component may vanish: zero times infinity would be no number.
            let inverse = direction.map(|d| if d.abs() < 1e-18 { 1e18f32.copysign(d) } else { 1.0 / d });
            f32x16::load_array(simd, inverse)
        };
        let [ox, oy, oz] = &packet.origin;
        let [dx, dy, dz] = &packet.direction;
        Self {
            origin: [load(ox), load(oy), load(oz)],
            direction: [load(dx), load(dy), load(dz)],
            inverse: [invert(dx), invert(dy), invert(dz)],
            length: load(&packet.length),
        }
    }

    /// One bit for each ray that passes the box.
    #[inline(always)]
    fn meet_box(&self, simd: S, low: [f32; 3], high: [f32; 3]) -> u32 {
        let (mut enter, mut leave) = (f32x16::splat(simd, 0.0), self.length);
        for axis in 0..3 {
            let near = (f32x16::splat(simd, low[axis]) - self.origin[axis]) * self.inverse[axis];
            let far = (f32x16::splat(simd, high[axis]) - self.origin[axis]) * self.inverse[axis];
            enter = enter.max(near.min(far));
            leave = leave.min(near.max(far));
        }
        // A little wider than it is, against rounding (Ize 2013).
        enter.simd_le(leave * 1.000_000_5).to_bitmask() as u32
    }

    /// One bit for each ray that meets the triangle: a corner, two edges and their cross product.
    #[inline(always)]
    fn meet_triangle(&self, simd: S, [corner, first, second, normal]: [[f32; 3]; 4]) -> u32 {
        let dot = |a: [f32; 3], b: [f32x16<S>; 3]| b[0] * a[0] + b[1] * a[1] + b[2] * a[2];
        let [dx, dy, dz] = self.direction;
        let c = [0, 1, 2].map(|k| f32x16::splat(simd, corner[k]) - self.origin[k]);
        let r = [dy * c[2] - dz * c[1], dz * c[0] - dx * c[2], dx * c[1] - dy * c[0]];
        let inverse = f32x16::splat(simd, 1.0) / dot(normal, self.direction);
        let u = dot(second, r) * inverse * -1.0;
        let v = dot(first, r) * inverse;
        let distance = dot(normal, c) * inverse;
        // Parallel rays have infinite or undefined numbers here, and fail.
        let inside = u.simd_ge(-EDGE) & v.simd_ge(-EDGE) & (u + v).simd_le(1.0 + EDGE);
        (inside & distance.simd_gt(0.0) & distance.simd_lt(self.length)).to_bitmask() as u32
    }
}
