use std::fs;
use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageFormat, RgbImage};
use proptest::prelude::*;
use tempfile::TempDir;

use super::fault;
use crate::{FaultKind, Image, SceneError, image_file, read_image};

fn picture(width: u32, height: u32) -> DynamicImage {
    RgbImage::from_fn(width, height, |x, y| image::Rgb([(x * 5) as u8, (y * 9) as u8, (x * y % 251) as u8]))
        .into()
}

fn encode(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn decode(bytes: &[u8]) -> Result<Image, SceneError> {
    image_file::decode(Path::new("image"), bytes, None)
}

const FORMATS: [ImageFormat; 3] = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP];

#[test]
fn formats_are_known_by_their_contents() {
    for format in FORMATS {
        let image = decode(&encode(&picture(40, 30), format)).unwrap();
        assert_eq!((image.width, image.height, image.data.len()), (40, 30, 3600));
        if format != ImageFormat::Jpeg {
            assert_eq!(image.data, picture(40, 30).into_rgb8().into_raw());
        }
    }
}

#[test]
fn every_truncation_is_refused() {
    for format in FORMATS {
        let whole = encode(&picture(64, 48), format);
        for length in 0..whole.len() - if format == ImageFormat::Png { 12 } else { 1 } {
            let fault = fault(decode(&whole[..length]));
            assert_eq!(fault.kind, FaultKind::Image, "{format:?} cut to {length} of {}", whole.len());
        }
    }
}

#[test]
fn a_jpeg_with_a_thumbnail_and_a_tail_is_whole_until_it_is_cut() {
    let thumbnail = encode(&picture(8, 6), ImageFormat::Jpeg);
    let whole = encode(&picture(64, 48), ImageFormat::Jpeg);
    let mut with_thumbnail = vec![0xff, 0xd8, 0xff, 0xe1];
    with_thumbnail.extend((thumbnail.len() as u16 + 2).to_be_bytes());
    with_thumbnail.extend(&thumbnail);
    with_thumbnail.extend(&whole[2..]);
    with_thumbnail.extend([0; 100]);
    assert_eq!(decode(&with_thumbnail).unwrap().width, 64);
    let cut = &with_thumbnail[..with_thumbnail.len() - 200];
    assert!(fault(decode(cut)).problem.contains("truncated"));
}

#[test]
fn sixteen_bits_grey_and_transparency_become_rgb() {
    let sixteen = image::ImageBuffer::from_pixel(2, 1, image::Rgb([65535u16, 32896, 257]));
    let read = |image: DynamicImage| decode(&encode(&image, ImageFormat::Png)).unwrap().data;
    assert_eq!(read(DynamicImage::ImageRgb16(sixteen)), [255, 128, 1, 255, 128, 1]);
    let grey = image::ImageBuffer::from_pixel(1, 1, image::Luma([77u8]));
    assert_eq!(read(DynamicImage::ImageLuma8(grey)), [77; 3]);
    let half = image::ImageBuffer::from_pixel(1, 1, image::Rgba([200u8, 100, 50, 128]));
    assert_eq!(read(DynamicImage::ImageRgba8(half)), [100, 50, 25]);
}

/// A PNG that claims a size and holds almost nothing.
fn png_claiming(width: u32, height: u32) -> Vec<u8> {
    let mut png = encode(&picture(1, 1), ImageFormat::Png);
    png[16..20].copy_from_slice(&width.to_be_bytes());
    png[20..24].copy_from_slice(&height.to_be_bytes());
    let checksum = crc32(&png[12..29]);
    png[29..33].copy_from_slice(&checksum.to_be_bytes());
    png
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(
            crc ^ u32::from(byte),
            |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 },
        )
    })
}

#[test]
fn bombs_are_refused_by_what_they_claim() {
    for (width, height) in [(60_000, 60_000), (16_384, 16_384), (u32::MAX >> 1, 1), (1, 20_000)] {
        let fault = fault(decode(&png_claiming(width, height)));
        assert_eq!(fault.kind, FaultKind::Size, "{width}x{height}: {fault}");
    }
    let fault = fault(decode(&png_claiming(8_000, 8_000)));
    assert_eq!(fault.kind, FaultKind::Image, "a size that may be, but the pixels are not there");
}

#[test]
fn what_is_no_image_is_refused() {
    let folder = TempDir::new().unwrap();
    for bytes in [b"".as_slice(), b"hello", b"GIF89a\x01\x00\x01\x00\x00\x00\x00;", b"BM", &[0xff; 1000]] {
        assert_eq!(fault(decode(bytes)).kind, FaultKind::Image);
    }
    assert_eq!(fault(read_image(folder.path())).kind, FaultKind::Unreadable);
    assert_eq!(fault(read_image(Path::new("/no/such/image.png"))).kind, FaultKind::Missing);
}

#[test]
fn black_is_black_up_to_what_codecs_leave() {
    let image = |value| Image { width: 2, height: 1, data: vec![0, 0, 0, 0, value, 0] };
    assert!(image(0).is_black() && image(2).is_black() && !image(3).is_black());
}

#[test]
fn pngs_are_written_as_they_are() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("out.png");
    let image = Image { width: 3, height: 2, data: (0..18).collect() };
    image.write_png(&path).unwrap();
    assert_eq!(read_image(&path).unwrap(), image);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    let wrong = Image { height: 5, ..image };
    assert_eq!(fault(wrong.write_png(&path)).kind, FaultKind::Image);
}

proptest! {
    #[test]
    fn damaged_images_never_panic(at in 0usize..3000, value: u8, which in 0usize..3) {
        let mut bytes = encode(&picture(32, 24), FORMATS[which]);
        let at = at % bytes.len();
        bytes[at] = value;
        let _ = decode(&bytes);
    }
}

#[test]
fn reduced_pictures_hold_the_means_of_their_blocks() {
    let image = Image { width: 5, height: 3, data: (0..45).collect() };
    let small = image.reduced(2);
    assert_eq!((small.width, small.height), (2, 1), "rows and columns that fill no block are cut off");
    // The means of 0, 3, 15 and 18, and so on.
    assert_eq!(small.data, [9, 10, 11, 15, 16, 17]);
    assert_eq!(image.reduced(1), image);
    let least = image.reduced(9);
    assert_eq!((least.width, least.height, least.data.len()), (1, 1, 3));
}

#[test]
fn jpegs_show_what_is_in_the_image() {
    let data = picture(64, 48).into_rgb8().into_raw();
    let image = Image { width: 64, height: 48, data };
    let read = decode(&image.jpeg(95).unwrap()).unwrap();
    assert_eq!((read.width, read.height), (64, 48));
    let off = image.data.iter().zip(&read.data).map(|(&a, &b)| u64::from(a.abs_diff(b))).sum::<u64>();
    assert!(off < 8 * image.data.len() as u64, "{off}");
    assert!(Image { width: 65, ..image }.jpeg(95).is_err());
}
