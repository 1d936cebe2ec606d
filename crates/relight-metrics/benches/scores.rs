//! Scores of a picture of the official size: pixels a second on one thread, and on as many as there are.
use divan::counter::ItemsCount;
use relight_metrics::{psnr, psnr_and_ssim, ssim, ssim_uniform7};

const SIZE: (u32, u32) = (1440, 1080);
const PIXELS: u32 = SIZE.0 * SIZE.1;

fn main() {
    divan::main();
}

/// Two pictures that differ a little.
fn pictures() -> (Vec<u8>, Vec<u8>) {
    let byte = |i: u32, noise: u32| {
        (i / 7 % 160 + i / 1000 % 60 + ((i.wrapping_mul(2_654_435_761) >> 28) & noise)) as u8
    };
    ((0..3 * PIXELS).map(|i| byte(i, 15)).collect(), (0..3 * PIXELS).map(|i| byte(i, 7)).collect())
}

/// What scoring a submission does with each image: many at a time, one on a thread.
#[divan::bench(threads = [1, 2])]
fn psnr_and_ssim_of_one_on_each_thread(bencher: divan::Bencher<'_, '_>) {
    let (a, b) = pictures();
    bencher.counter(ItemsCount::new(PIXELS)).bench(|| psnr_and_ssim(&a, &b, SIZE.0, SIZE.1));
}

#[divan::bench]
fn psnr_alone(bencher: divan::Bencher<'_, '_>) {
    let (a, b) = pictures();
    bencher.counter(ItemsCount::new(PIXELS)).bench(|| psnr(&a, &b));
}

#[divan::bench]
fn ssim_of_one_on_all_threads(bencher: divan::Bencher<'_, '_>) {
    let (a, b) = pictures();
    bencher.counter(ItemsCount::new(PIXELS)).bench(|| ssim(&a, &b, SIZE.0, SIZE.1));
}

#[divan::bench]
fn ssim_uniform7_of_one_on_all_threads(bencher: divan::Bencher<'_, '_>) {
    let (a, b) = pictures();
    bencher.counter(ItemsCount::new(PIXELS)).bench(|| ssim_uniform7(&a, &b, SIZE.0, SIZE.1));
}
