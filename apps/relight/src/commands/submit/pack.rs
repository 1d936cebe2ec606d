//! `relight submit pack`: the test images of runs as a zip.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use rawzip::ZipArchiveWriter;
use relight_field::engine::{Engine, Outputs, RenderSettings};
use relight_render::{Map, RenderError, render};
use relight_scene::{Image, Scene, Split, read_bytes, write_whole};
use relight_server::benchmark::{Benchmark, TestImage};
use relight_train::run::{RunConfig, RunFolder};

use crate::console::{Progress, cancel_flag, print_line, unless};
use crate::preparation::{check_splits, open};
use crate::{engines, places, stored_zip};

/// A weights file's or a picture's longest length.
const LONGEST: u64 = 1 << 32;

/// Render the test images of runs, and zip them as a benchmark wants them.
///
/// Each run's scene must be there, though its test images may be black. What is rendered is kept beside the zip until that is whole:
/// after Ctrl-C or a kill the same command goes on. The same runs make the same bytes.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  relight submit pack runs/* --out entry.zip\n  \
                  relight submit pack runs/* --out val.zip --phase val       the public validation images\n  \
                  relight submit pack --images pictures/ --out entry.zip     pictures of any program, named\n  \
                                                                             {scene}_{light}_{camera}.png")]
pub struct Args {
    /// Folders of trained runs, one a scene.
    #[arg(required_unless_present = "images")]
    runs: Vec<PathBuf>,
    /// The zip.
    #[arg(long, value_name = "FILE.zip")]
    out: PathBuf,
    /// Which images: test (easy and hard), val, or all.
    #[arg(long, default_value = "test")]
    phase: Phase,
    /// Folder of the scenes, where they are not where they were.
    #[arg(long, value_name = "DIR", conflicts_with = "images")]
    scenes: Option<PathBuf>,
    /// Pack the PNG files of this folder instead.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["runs", "phase"])]
    images: Option<PathBuf>,
}

/// Which images are packed.
#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Phase {
    Test,
    Val,
    All,
}

impl Phase {
    fn holds(self, split: Split) -> bool {
        match self {
            Phase::All => true,
            Phase::Val => split == Split::Val,
            Phase::Test => split != Split::Val,
        }
    }
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    places::check_file(&args.out)?;
    let (pictures, rendered) = match &args.images {
        Some(folder) => (pictures_of(folder)?, None),
        None => {
            let kept = kept_beside(&args.out);
            (render_all(args, &kept, quiet)?, Some(kept))
        }
    };
    write_zip(&args.out, &pictures, quiet)?;
    if let Some(kept) = rendered {
        fs::remove_dir_all(&kept).with_context(|| kept.display().to_string())?;
    }
    print_line(&format!("{}: {} images", args.out.display(), pictures.len()))
}

/// The folder of pictures that are on their way into a zip.
fn kept_beside(out: &Path) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(".pictures");
    PathBuf::from(name)
}

/// The PNG files of a folder, by name.
fn pictures_of(folder: &Path) -> anyhow::Result<BTreeMap<String, PathBuf>> {
    let mut pictures = BTreeMap::new();
    for entry in folder.read_dir().with_context(|| folder.display().to_string())? {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        if path.extension().is_some_and(|extension| extension == "png") && path.is_file() {
            let name = path.file_name().and_then(|name| name.to_str());
            let name = name.with_context(|| format!("{}: the name is not UTF-8", path.display()))?;
            pictures.insert(name.to_owned(), path);
        }
    }
    ensure!(!pictures.is_empty(), "{}: holds no PNG file", folder.display());
    Ok(pictures)
}

/// One run with its part of the work.
struct Part {
    run: RunFolder,
    config: RunConfig,
    scene: Scene,
    images: Vec<TestImage>,
}

/// Renders what is not in the folder yet.
fn render_all(args: &Args, kept: &Path, quiet: bool) -> anyhow::Result<BTreeMap<String, PathBuf>> {
    // Everything that can be wrong with a run is told before hours are spent on another.
    let mut scenes = BTreeMap::<String, &Path>::new();
    let (mut parts, mut all) = (Vec::new(), 0);
    for path in &args.runs {
        let part = asked(args, path)?;
        all += part.images.len();
        if let Some(other) = scenes.insert(part.scene.name.clone(), path) {
            bail!(
                "{} and {} are both runs of {}: give one",
                other.display(),
                path.display(),
                part.scene.name
            );
        }
        parts.push(part);
    }
    let cancel = cancel_flag()?;
    let bar = Progress::new("drawing", all as u64, quiet);
    let (mut done, mut pictures) = (0, BTreeMap::new());
    for part in &parts {
        let (engine, folder) = ready(part, kept)?;
        for image in &part.images {
            let file = folder.join(&image.entry);
            if !file.is_file() {
                let stopped = || unless(cancel);
                let Some(picture) = draw(part, engine.as_ref(), image, &stopped)? else {
                    bail!("stopped after {done} of {all} images; the same command goes on");
                };
                picture.write_png(&file)?;
            }
            done += 1;
            bar.count(done, all, "images");
            pictures.insert(image.entry.clone(), file);
        }
    }
    bar.finish(&format!("{done} images drawn"));
    Ok(pictures)
}

/// The scene of a run, and what a benchmark asks of it.
fn asked(args: &Args, path: &Path) -> anyhow::Result<Part> {
    let (run, config) = RunFolder::open(path)?;
    let place = match (&args.scenes, config.scene.file_name()) {
        (Some(scenes), Some(name)) => scenes.join(name),
        _ => config.scene.clone(),
    };
    let (scene, splits) = open(&place)?;
    check_splits(&scene, &splits, &config)?;
    let images = Benchmark::layout(&place)?.scenes.into_iter().flat_map(|scene| scene.images);
    let images: Vec<TestImage> = images.filter(|image| args.phase.holds(image.split)).collect();
    ensure!(!images.is_empty(), "{}: its scene {} has no such images", path.display(), scene.name);
    Ok(Part { run, config, scene, images })
}

/// The engine of a run, and a folder for its pictures that no other weights share.
fn ready(part: &Part, kept: &Path) -> anyhow::Result<(Box<dyn Engine>, PathBuf)> {
    let engine = engines::of_run(&part.run, &part.config)?;
    let weights = crc32fast::hash(&read_bytes(&part.run.weights(), LONGEST)?);
    let folder = kept.join(format!("{}-{weights:08x}", part.scene.name));
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    Ok((engine, folder))
}

/// Draws an image; none if it was stopped.
fn draw(
    part: &Part,
    engine: &dyn Engine,
    image: &TestImage,
    go_on: &dyn Fn() -> ControlFlow<()>,
) -> anyhow::Result<Option<Image>> {
    let camera = part.scene.cameras.iter().find(|camera| camera.label == image.camera);
    let light = part.scene.lights.iter().find(|light| light.label == image.light);
    let (camera, light) = camera.zip(light).with_context(|| format!("{}: no such view", image.entry))?;
    let settings = RenderSettings::default();
    let progress = &mut |_: usize, _: usize| go_on();
    match render(
        engine,
        &camera.intrinsics,
        &camera.pose,
        &light.pose,
        Outputs::default(),
        &settings,
        progress,
    ) {
        Ok(picture) => Ok(Some(picture.image(Map::Final, None)?)),
        Err(RenderError::Cancelled) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Writes pictures as a zip.
fn write_zip(out: &Path, pictures: &BTreeMap<String, PathBuf>, quiet: bool) -> anyhow::Result<()> {
    let cancel = cancel_flag()?;
    let bar = Progress::new("packing", pictures.len() as u64, quiet);
    let written = write_whole(out, |file| {
        let mut zip = ZipArchiveWriter::new(BufWriter::with_capacity(1 << 20, file));
        for (done, (name, path)) in pictures.iter().enumerate() {
            if unless(cancel).is_break() {
                return Err(io::Error::new(io::ErrorKind::Interrupted, "stopped; the same command goes on"));
            }
            stored_zip::add(&mut zip, name, &read_bytes(path, LONGEST).map_err(io::Error::other)?)?;
            bar.update(done as u64 + 1, pictures.len() as u64, String::new);
        }
        zip.finish().map_err(io::Error::other)?.flush()
    });
    bar.clear();
    written.with_context(|| out.display().to_string())
}
