//! The two products that networks are made of, against the machine's peak.
use divan::counter::ItemsCount;
use fearless_simd::Level;
use relight_cpu::dense::{FixedPoint, Matrix, MatrixMut, Store, accumulate_outer, multiply};

const COLUMNS: usize = 192;
const FLOPS: usize = 2 * 64 * 64 * COLUMNS;

fn main() {
    divan::main();
}

#[divan::bench]
fn layer(bencher: divan::Bencher<'_, '_>) {
    let (a, x) = (vec![0.5f32; 64 * 64], vec![0.25f32; 64 * COLUMNS]);
    let mut y = vec![0.0f32; 64 * COLUMNS];
    let (level, a) = (Level::new(), Matrix::new(&a, 64, 0));
    bencher
        .counter(ItemsCount::new(FLOPS))
        .bench_local(|| multiply(level, a, &x, &mut y, (64, 64, COLUMNS), None, Store::Rectified));
}

/// The same in fixed point of 16 bits, where the processor has that.
#[divan::bench]
fn layer_in_fixed_point(bencher: divan::Bencher<'_, '_>) {
    let (a, x) = (vec![0.5f32; 64 * 64], vec![0.25f32; 64 * COLUMNS]);
    let (mut y, fixed) = (vec![0.0f32; 64 * COLUMNS], FixedPoint::new(&a, 64));
    let (level, a) = (Level::new(), Matrix { fixed: fixed.as_ref(), ..Matrix::new(&a, 64, 0) });
    bencher
        .counter(ItemsCount::new(FLOPS))
        .bench_local(|| multiply(level, a, &x, &mut y, (64, 64, COLUMNS), None, Store::Rectified));
}

#[divan::bench]
fn weight_gradient(bencher: divan::Bencher<'_, '_>) {
    let (dy, x) = (vec![0.5f32; 64 * COLUMNS], vec![0.25f32; 64 * COLUMNS]);
    let mut w = vec![0.0f32; 64 * 64];
    let level = Level::new();
    bencher.counter(ItemsCount::new(FLOPS)).bench_local(|| {
        let w = MatrixMut { data: &mut w, stride: 64, first: 0 };
        accumulate_outer(level, &dy, &x, w, (64, 64, COLUMNS));
    });
}

/// Independent fused multiply-adds that never leave the registers.
#[divan::bench]
fn peak(bencher: divan::Bencher<'_, '_>) {
    use fearless_simd::{Simd, dispatch, prelude::*};
    #[inline(always)]
    fn run<S: Simd>(simd: S, seed: f32) -> f32 {
        let mut sum = [S::f32s::splat(simd, seed); 12];
        let (a, b) = (S::f32s::splat(simd, 0.999), S::f32s::splat(simd, 1e-3));
        for _ in 0..FLOPS / 2 / 12 / S::f32s::LEN {
            for s in &mut sum {
                *s = s.mul_add(a, b);
            }
        }
        sum.iter().map(|s| s[0]).sum()
    }
    let level = Level::new();
    bencher
        .counter(ItemsCount::new(FLOPS))
        .bench_local(|| dispatch!(level, simd => run(simd, divan::black_box(0.1))));
}
