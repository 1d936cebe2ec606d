//! `relight serve admin add-baselines`: enters what can be had without learning anything.

use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::{Context, ensure};
use rawzip::ZipArchiveWriter;
use relight_scene::{Scene, Split, Splits};
use relight_server::accounts;
use relight_server::app::{App, Settings};
use relight_server::benchmark::Benchmark;
use relight_server::method::{Method, Phase, Visibility};
use relight_server::upload::{Upload, receive_file};
use relight_train::baselines::{NearestLight, mean_image};
use tempfile::NamedTempFile;

use crate::console::{Progress, cancel_flag, print_line, unless};
use crate::stored_zip;

/// Names of the two, and what they are.
const BASELINES: [(&str, &str); 2] = [
    ("mean image", "The mean of all training images of the scene, whatever camera and light are asked for."),
    ("nearest light", "The training image of the nearest training camera under the nearest of its lights."),
];

/// Draws, enters and pins the baselines of a benchmark.
pub async fn enter(data: &Path, name: &str, quiet: bool) -> anyhow::Result<()> {
    let app = App::open(data, Settings::default()).await?;
    let benchmark = app.store.benchmark(name).await?;
    let user = accounts::baselines(&app.store).await?;
    let new = || NamedTempFile::new_in(app.folder.incoming()).context("no room for a zip");
    let zips = [new()?, new()?];
    tokio::task::block_in_place(|| draw(&Benchmark::layout(&benchmark.folder)?, &zips, quiet))?;
    for (zip, (method, description)) in zips.iter().zip(BASELINES) {
        let upload = Upload {
            user: user.clone(),
            benchmark: name.to_owned(),
            phase: Phase::Test,
            visibility: Visibility::Public,
            method: Method {
                name: method.to_owned(),
                description: description.to_owned(),
                ..Method::default()
            },
            declared: None,
        };
        let id = receive_file(&app, upload, zip.reopen()?).await?;
        app.store.set_pinned(&id, true).await?;
        print_line(&format!("{id}  {method}"))?;
    }
    app.store.close().await;
    Ok(())
}

/// Writes the zips of the mean image and of the nearest light.
fn draw(benchmark: &Benchmark, zips: &[NamedTempFile; 2], quiet: bool) -> anyhow::Result<()> {
    let cancel = cancel_flag()?;
    let [mut mean, mut nearest] =
        zips.each_ref().map(|zip| ZipArchiveWriter::new(BufWriter::new(zip.as_file())));
    let all = benchmark.scenes.len() as u64;
    let bar = Progress::new("baselines", all, quiet);
    for (done, asked) in benchmark.scenes.iter().enumerate() {
        bar.update(done as u64, all, || format!("{}, {done} of {all} scenes", asked.name));
        let one = benchmark.folder.join(&asked.name);
        let scene = Scene::open(if one.is_dir() { &one } else { &benchmark.folder })?;
        let splits = Splits::peek(&scene)?;
        let train = splits.get(Split::Train);
        let mean_picture = mean_image(&scene, train, &|_, _| unless(cancel))?
            .with_context(|| format!("{}: has no training images of one size", asked.name))?
            .png()?;
        let stand_ins = NearestLight::new(&scene, train);
        for image in &asked.images {
            ensure!(unless(cancel).is_continue(), "stopped; nothing was entered");
            let frame = scene.frames.iter().position(|frame| {
                (scene.cameras[frame.camera].label, scene.lights[frame.light].label)
                    == (image.camera, image.light)
            });
            let frame = frame.with_context(|| format!("{}: is not in the scene", image.entry))?;
            let stand_in =
                stand_ins.image(frame)?.with_context(|| format!("{}: has no training images", asked.name))?;
            stored_zip::add(&mut mean, &image.entry, &mean_picture)?;
            stored_zip::add(&mut nearest, &image.entry, &stand_in.png()?)?;
        }
    }
    for zip in [mean, nearest] {
        zip.finish()?.flush()?;
    }
    bar.clear();
    Ok(())
}
