//! What this machine can do at most: the roofs that `relight profile` holds the stages of a step against, at all sizes of
//! table, and what bfloat16 arithmetic would bring.

use relight_cpu::limits::Limits;

/// Largest table, base-2 logarithm of its entries.
const LARGEST: u32 = 22;

fn main() {
    let threads = rayon::current_num_threads();
    let limits = Limits::measure::<2>(1 << LARGEST, 1 << LARGEST);
    println!("{threads} threads");
    println!("f32 multiply-adds    {:8.0} GFLOP/s", limits.operations / 1e9);
    match bf16::dot_products() {
        Some(rate) => println!("bf16 dot products    {:8.0} GFLOP/s", rate / 1e9),
        None => println!("bf16 dot products           not on this processor"),
    }
    println!("copy                 {:8.0} GB/s", limits.bytes / 1e9);
    random_access::<2>();
    random_access::<4>();
}

/// Rates of entries of `F` features.
fn random_access<const F: usize>() {
    let bytes = size_of::<[f32; F]>();
    println!("\nentries of {bytes:2} bytes      looked up in no order    added to in no order");
    for log2 in (12..=LARGEST).step_by(2) {
        let limits = Limits::measure::<F>(1 << log2, 1 << log2);
        println!(
            "2^{log2} ({:6} kB) {:18.2} G/s {:18.2} G/s",
            (bytes << log2) / 1024,
            limits.lookups / 1e9,
            limits.updates / 1e9
        );
    }
}

#[cfg(target_arch = "x86_64")]
mod bf16 {
    use std::arch::x86_64::{__m512bh, _mm512_dpbf16_ps, _mm512_reduce_add_ps, _mm512_set1_ps};
    use std::hint::black_box;

    use relight_cpu::limits::on_all_threads;

    /// Independent sums: enough for two units of latency six.
    const INDEPENDENT: usize = 16;
    const ROUNDS: usize = 1 << 16;
    /// Operations of an instruction: 32 products and as many additions.
    const OPERATIONS: usize = 64;

    /// Operations a second of dot products in registers, on all threads.
    pub fn dot_products() -> Option<f64> {
        if !is_x86_feature_detected!("avx512bf16") {
            return None;
        }
        // SAFETY: the processor has the instructions.
        Some(on_all_threads(|_| 0.1, |x| unsafe { run(x) }))
    }

    #[target_feature(enable = "avx512bf16,avx512f")]
    fn run(x: &mut f32) -> usize {
        let mut sums = [_mm512_set1_ps(*x); INDEPENDENT];
        // SAFETY: any bits are 32 numbers; these are all 1.0 and all 0.0078125.
        let [a, b]: [__m512bh; 2] =
            unsafe { std::mem::transmute(black_box([[0x3f80u16; 32], [0x3c00; 32]])) };
        for _ in 0..ROUNDS {
            for sum in &mut sums {
                *sum = _mm512_dpbf16_ps(*sum, a, b);
            }
        }
        *x = black_box(sums.iter().map(|&sum| _mm512_reduce_add_ps(sum)).sum::<f32>()) % 1.0;
        ROUNDS * INDEPENDENT * OPERATIONS
    }
}

#[cfg(not(target_arch = "x86_64"))]
mod bf16 {
    pub fn dot_products() -> Option<f64> {
        None
    }
}
