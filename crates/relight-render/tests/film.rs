//! Films are read back with another program's eyes: the demultiplexer and the decoder.

#![allow(clippy::unwrap_used)]

mod common;

use std::num::NonZeroU32;
use std::ops::ControlFlow;
use std::path::Path;

use common::{Ball, lens, looking};
use openh264::decoder::Decoder;
use openh264::formats::YUVSource;
use relight_field::engine::{Outputs, RenderSettings};
use relight_render::paths::MOST_FRAMES;
use relight_render::{Film, Map, RenderError, render};
use relight_scene::{Image, read_image};
use shiguredo_mp4::bitstream::h264::{LengthSize, length_prefixed_to_annexb};

use shiguredo_mp4::boxes::SampleEntry;
use shiguredo_mp4::demux::{Input, Mp4FileDemuxer};

const RATE: NonZeroU32 = NonZeroU32::new(24).unwrap();

/// A light that goes round the ball.
fn frames(count: usize, width: u32, height: u32) -> Vec<Image> {
    (0..count)
        .map(|i| {
            let light = looking(0.5, i as f64 * 0.2, 0.6);
            let settings = RenderSettings::default();
            let progress = &mut |_, _| ControlFlow::Continue(());
            let (lens, camera) = (lens(width, height), looking(0.9, 0.3, 0.5));
            let picture =
                render(&Ball::default(), &lens, &camera, &light, Outputs::default(), &settings, progress)
                    .unwrap();
            picture.image(Map::Final, None).unwrap()
        })
        .collect()
}

/// The frames of an MP4, whether each is a key frame, and the frame rate.
fn played(path: &Path) -> (Vec<Image>, Vec<bool>, u32) {
    let bytes = std::fs::read(path).unwrap();
    let index = |name: &[u8]| bytes.windows(4).position(|window| window == name).unwrap();
    assert!(index(b"moov") < index(b"mdat"), "the index comes first, so that browsers play while loading");
    let mut demuxer = Mp4FileDemuxer::new();
    demuxer.handle_input(Input { position: 0, data: &bytes });
    let tracks = demuxer.tracks().unwrap();
    assert_eq!(tracks.len(), 1);
    let rate = tracks[0].timescale.get();
    let mut decoder = Decoder::new().unwrap();
    let (mut images, mut keys) = (Vec::new(), Vec::new());
    while let Some(sample) = demuxer.next_sample().unwrap() {
        let data = &bytes[sample.data_offset as usize..][..sample.data_size];
        let mut stream = Vec::new();
        if let Some(SampleEntry::Avc1(entry)) = sample.sample_entry {
            for unit in entry.avcc_box.sps_list.iter().chain(&entry.avcc_box.pps_list) {
                stream.extend([0, 0, 0, 1]);
                stream.extend(unit);
            }
        }
        stream.extend(length_prefixed_to_annexb(data, LengthSize::FourBytes).unwrap());
        let decoded = decoder.decode(&stream).unwrap().expect("a picture for every sample");
        let (width, height) = decoded.dimensions();
        let mut data = vec![0; 3 * width * height];
        decoded.write_rgb8(&mut data);
        images.push(Image { width: width as u32, height: height as u32, data });
        keys.push(sample.keyframe);
    }
    (images, keys, rate)
}

/// PSNR of a frame against the like part of a frame at least as large.
fn psnr(frame: &Image, shown: &Image) -> f64 {
    let at = |image: &Image, x: u32, y: u32, c: u32| {
        f64::from(image.data[(3 * (y * image.width + x) + c) as usize])
    };
    let mut squares = 0.0;
    for y in 0..frame.height {
        for x in 0..frame.width {
            squares += (0..3).map(|c| (at(frame, x, y, c) - at(shown, x, y, c)).powi(2)).sum::<f64>();
        }
    }
    10.0 * (255.0f64.powi(2) * frame.data.len() as f64 / squares).log10()
}

#[test]
fn a_video_plays_what_was_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("light.mp4");
    let drawn = frames(30, 161, 119);
    let mut film = Film::create(&path, RATE, drawn.len()).unwrap();
    drawn.iter().for_each(|frame| film.push(frame).unwrap());
    film.finish().unwrap();

    let (shown, keys, rate) = played(&path);
    assert_eq!(shown.len(), drawn.len());
    assert_eq!(rate, RATE.get());
    assert!(keys[0] && keys[24] && !keys[1], "a key frame a second");
    for (drawn, shown) in drawn.iter().zip(&shown) {
        assert_eq!((shown.width, shown.height), (162, 120), "sides are made even");
        assert!(psnr(drawn, shown) > 40.0, "{}", psnr(drawn, shown));
    }
}

#[test]
fn frames_go_into_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/frames");
    let drawn = frames(2, 20, 15);
    let mut film = Film::create(&path, RATE, 2).unwrap();
    drawn.iter().for_each(|frame| film.push(frame).unwrap());
    film.finish().unwrap();
    for (i, frame) in drawn.iter().enumerate() {
        assert_eq!(read_image(&path.join(format!("0000{i}.png"))).unwrap(), *frame);
    }
    // A shorter film in its place is all that is there then.
    let mut film = Film::create(&path, RATE, 1).unwrap();
    film.push(&drawn[1]).unwrap();
    film.finish().unwrap();
    let names = |path: &Path| {
        let names = std::fs::read_dir(path).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        names.collect::<std::collections::BTreeSet<String>>()
    };
    assert_eq!(names(&path), ["00000.png", "film.json"].map(str::to_owned).into());
    assert_eq!(read_image(&path.join("00000.png")).unwrap(), drawn[1]);

    // What is no film's is neither overwritten nor removed.
    std::fs::write(path.join("00001.png"), "a photograph").unwrap();
    let told = Film::create(&path, RATE, 2).err().unwrap().to_string();
    assert!(told.contains("00001.png: is there already"), "{told}");
    let mut film = Film::create(&path, RATE, 1).unwrap();
    film.push(&drawn[0]).unwrap();
    assert!(film.push(&drawn[1]).unwrap_err().to_string().contains("gets no more"));
    film.finish().unwrap();
    assert_eq!(read_image(&path.join("00000.png")).unwrap(), drawn[0]);
    assert_eq!(std::fs::read(path.join("00001.png")).unwrap(), b"a photograph");

    let other = folder.path().join("photographs");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("00000.png"), "a photograph").unwrap();
    let told = Film::create(&other, RATE, 1).err().unwrap().to_string();
    assert!(told.contains("photographs: is not empty and holds no film"), "{told}");
    std::fs::write(other.join("film.json"), "{\"format\":\"relight-film-9\",\"frames\":1,\"frame_rate\":1}")
        .unwrap();
    let told = Film::create(&other, RATE, 1).err().unwrap().to_string();
    assert!(told.contains("film.json: format \"relight-film-9\""), "{told}");
    std::fs::write(
        other.join("film.json"),
        "{\"format\":\"relight-film-1\",\"frames\":18446744073709551615,\"frame_rate\":1}",
    )
    .unwrap();
    let told = Film::create(&other, RATE, 1).err().unwrap().to_string();
    assert!(told.contains("film.json: tells of 18446744073709551615 frames"), "{told}");
    let told = Film::create(&folder.path().join("long"), RATE, MOST_FRAMES + 1).err().unwrap().to_string();
    assert!(told.contains("a film of 100001 frames cannot be"), "{told}");
    assert_eq!(std::fs::read(other.join("00000.png")).unwrap(), b"a photograph");
}

#[test]
fn a_film_that_was_stopped_is_drawn_again_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames");
    let drawn = frames(3, 20, 15);
    let mut film = Film::create(&path, RATE, 3).unwrap();
    film.push(&drawn[0]).unwrap();
    drop(film);
    let mut film = Film::create(&path, RATE, 3).unwrap();
    drawn.iter().for_each(|frame| film.push(frame).unwrap());
    film.finish().unwrap();
    assert_eq!(read_image(&path.join("00002.png")).unwrap(), drawn[2]);
}

#[test]
fn what_cannot_be_a_film_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.mp4");
    let black =
        |width: u32, height: u32| Image { width, height, data: vec![0; (3 * width * height) as usize] };
    for frame in
        [black(8, 8), black(4000, 100), black(2200, 2200), Image { data: vec![0; 5], ..black(32, 32) }]
    {
        let mut film = Film::create(&path, RATE, 1).unwrap();
        assert!(
            matches!(film.push(&frame), Err(RenderError::Film { .. })),
            "{}x{}",
            frame.width,
            frame.height
        );
    }
    let mut film = Film::create(&path, RATE, 2).unwrap();
    film.push(&black(32, 32)).unwrap();
    assert!(film.push(&black(32, 48)).is_err(), "another size");
    assert!(Film::create(&path, RATE, 0).unwrap().finish().is_err(), "no frames");
    assert!(Film::create(&folder.path().join("film.avi"), RATE, 1).is_err());
    drop(film);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "what is not finished leaves nothing");
}
