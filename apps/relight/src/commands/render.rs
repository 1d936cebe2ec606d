//! `relight render`: pictures and films of a run.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{bail, ensure};
use relight_field::engine::{Engine, RenderSettings};
use relight_render::{
    Film, LightName, Map, RenderError, check_picture_name, check_size, named_camera, paths, render,
    write_picture,
};
use relight_scene::{Intrinsics, Scene, focus};
use relight_train::run::RunFolder;

use crate::console::{Progress, cancel_flag, unless};
use crate::preparation::open_scene;
use crate::{engines, places};

/// Render a view under a light, or a film along a path.
///
/// A camera is the number of one of the scene's cameras, or a file with the 16 numbers of its camera-to-world matrix; one from a
/// file gets the lens of the scene's first camera.
/// A light is the number of one of the scene's lights, its position X,Y,Z in metres, or the 16 numbers of its
/// light-to-world matrix.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  relight render RUN --camera 4 --light 21 --out view.png\n  \
                  relight render RUN --camera 4 --light 0.2,-0.1,0.3 --map visibility --out shadow.exr\n  \
                  relight render RUN --path orbit --out orbit.mp4      the camera moves\n  \
                  relight render RUN --path lights --out frames/       the light moves; PNGs\n  \
                  relight render RUN --path keys.json --out film.mp4   see docs/formats.md\n\n\
                  PNG holds 8-bit sRGB. EXR holds 32-bit linear colour, or metres, or shares in 0..1.")]
pub struct Args {
    /// Folder of a trained run.
    run: PathBuf,
    /// Picture (.png, .exr), or film (.mp4, or a folder for PNGs).
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
    /// Camera: a number, or a file with a pose, seen through the first camera's lens. [default for a film: the scene's first]
    #[arg(long, value_name = "INDEX|FILE", required_unless_present = "path")]
    camera: Option<String>,
    /// Light: a number, a position, or a matrix. [default for a film: the scene's first]
    #[arg(
        long,
        value_name = "INDEX|X,Y,Z[,…]",
        required_unless_present = "path",
        allow_hyphen_values = true
    )]
    light: Option<LightName>,
    /// Draw a film: `orbit` moves the camera, `lights` the light, a file both.
    #[arg(long, value_name = "orbit|lights|FILE")]
    path: Option<String>,
    /// Frames of a film.
    #[arg(long, default_value = "120", requires = "path", value_parser = frames)]
    frames: usize,
    /// Frames a second.
    #[arg(long, default_value = "30", requires = "path")]
    fps: NonZeroU32,
    /// Size in pixels; the camera's own without it.
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u32, u32)>,
    /// What to draw: final, visibility, reflectance, depth or opacity.
    #[arg(long, default_value = "final")]
    map: Map,
    /// Samples a ray, for each thing that it looks at; the engine chooses without it.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=4096))]
    samples: Option<u32>,
    /// Folder of the scene, where it is not where it was.
    #[arg(long)]
    scene: Option<PathBuf>,
}

impl Args {
    /// Checks what no single argument shows: whether the name of the output is one of a picture or of a film.
    pub fn check(&self) -> Result<(), RenderError> {
        if self.path.is_some() { Film::check_name(&self.out) } else { check_picture_name(&self.out) }
    }
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    // Told before minutes are spent on drawing.
    if args.path.is_none() || args.out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("mp4")) {
        places::check_file(&args.out)?;
    }
    let (run, config) = RunFolder::open(&args.run)?;
    let scene = open_scene(args.scene.as_deref(), &run, &config)?;
    let engine = engines::of_run(&run, &config)?;
    match &args.path {
        Some(path) => film(args, path, &scene, engine.as_ref(), quiet),
        None => picture(args, &scene, engine.as_ref(), quiet),
    }
}

/// Draws one picture.
fn picture(args: &Args, scene: &Scene, engine: &dyn Engine, quiet: bool) -> anyhow::Result<()> {
    let (Some(camera), Some(light)) = (&args.camera, &args.light) else {
        bail!("--camera and --light are needed without --path");
    };
    let (lens, pose) = named_camera(&scene.cameras, camera)?;
    let light = light.pose(&scene.lights, focus(&scene.cameras, &scene.lights))?;
    let cancel = cancel_flag()?;
    let bar = Progress::new("drawing", 1, quiet);
    let lens = resized(&lens, args.size);
    let mut progress = |done: usize, all: usize| {
        bar.update(done as u64, all as u64, String::new);
        unless(cancel)
    };
    let started = Instant::now();
    let picture =
        render(engine, &lens, &pose, &light, args.map.outputs(), &settings(args.samples), &mut progress);
    bar.clear();
    let picture = picture?;
    tracing::info!("drawn in {:.3} s", started.elapsed().as_secs_f64());
    Ok(write_picture(&picture, args.map, &args.out)?)
}

/// Draws a film.
fn film(args: &Args, path: &str, scene: &Scene, engine: &dyn Engine, quiet: bool) -> anyhow::Result<()> {
    ensure!(!scene.cameras.is_empty() && !scene.lights.is_empty(), "{} has no cameras or lights", scene.name);
    let first_camera = scene.cameras[0].label.to_string();
    let first_light = LightName::Label(scene.lights[0].label);
    let (lens, pose) = named_camera(&scene.cameras, args.camera.as_ref().unwrap_or(&first_camera))?;
    let focus = focus(&scene.cameras, &scene.lights);
    let light = args.light.as_ref().unwrap_or(&first_light).pose(&scene.lights, focus)?;
    let shots = match path {
        "orbit" => paths::orbit(&scene.cameras, &lens, focus, &light, args.frames)?,
        "lights" => paths::lights(&scene.lights, focus, &pose, args.frames)?,
        file => paths::from_file(Path::new(file), focus, args.frames)?,
    };
    let lens = resized(&lens, args.size);
    let cancel = cancel_flag()?;
    let bar = Progress::new("filming", shots.len() as u64, quiet);
    let mut film = Film::create(&args.out, args.fps, shots.len())?;
    let (mut near_far, mut drawing) = (None, Duration::ZERO);
    for (done, shot) in shots.iter().enumerate() {
        let started = Instant::now();
        let picture = render(
            engine,
            &lens,
            &shot.camera,
            &shot.light,
            args.map.outputs(),
            &settings(args.samples),
            &mut |_, _| unless(cancel),
        )?;
        drawing += started.elapsed();
        let near_far = *near_far.get_or_insert_with(|| picture.near_far());
        film.push(&picture.image(args.map, Some(near_far))?)?;
        bar.update(done as u64 + 1, shots.len() as u64, String::new);
    }
    film.finish()?;
    let each = drawing.as_secs_f64() / shots.len() as f64;
    bar.finish(&format!("{}: {} frames, drawn in {each:.3} s each", args.out.display(), shots.len()));
    Ok(())
}

/// With so many samples a ray, if that is given.
pub fn settings(samples: Option<u32>) -> RenderSettings {
    RenderSettings { samples: samples.map(|n| n as usize), ..RenderSettings::default() }
}

fn resized(lens: &Intrinsics, size: Option<(u32, u32)>) -> Intrinsics {
    size.map_or_else(|| lens.clone(), |(width, height)| lens.resized(width, height))
}

/// A size as `640x480`.
pub fn size(text: &str) -> Result<(u32, u32), String> {
    let side = |text: &str| text.parse::<u32>().ok();
    let (width, height) = text
        .split_once(['x', 'X'])
        .and_then(|(w, h)| side(w).zip(side(h)))
        .ok_or("a size is two numbers of pixels, as 640x480")?;
    check_size(width, height).map_err(|error| error.to_string())?;
    Ok((width, height))
}

/// A number of frames.
fn frames(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|frames| (1..=paths::MOST_FRAMES).contains(frames))
        .ok_or_else(|| format!("a path has 1 to {} frames", paths::MOST_FRAMES))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_and_checked() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        for bad in ["640", "0x4", "axb", "640x480x3", "99999x1", "16384x16384"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }
}
