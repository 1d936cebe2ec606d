//! `relight demo`: the main job from end to end, on a scene that the program makes itself.

use std::fs;
use std::io::Write;
use std::num::NonZeroU32;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use relight_bench::report_page::ReportPage;
use relight_capture::session::{self, Ending as Shot};
use relight_capture::virtual_rig::VirtualCapture;
use relight_field::engine::{Engine, Outputs, RenderSettings};
use relight_render::{Film, Map, paths, render};
use relight_scene::{Image, Scene, Split, focus};
use relight_train::Report;
use relight_train::baselines::{NearestLight, mean_image};
use relight_train::evaluation::{Evaluation, Scores, evaluate};
use relight_train::recipe::Recipe;
use relight_train::run::{RunConfig, RunFolder, write_whole};
use relight_train::schedule::Budget;
use relight_train::trainer::Ending;

use crate::console::{Progress, cancel_flag, print_line, unless};
use crate::engines::{self, Device};
use crate::places;
use crate::preparation::{Prepared, Wish, open, train};

/// The object, and how it is captured: small enough to shoot and train in two minutes, large enough to see.
const OBJECT: &str = "fruit";
const VIEWS: usize = 36;
const LIGHTS: usize = 20;
const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
const SAMPLES: u32 = 16;
/// Frames of the film, and how many of them a second.
const FRAMES: usize = 72;
const FRAME_RATE: NonZeroU32 = NonZeroU32::new(24).unwrap();
/// Size of the film and the overview over that of the photographs.
const ENLARGED: u32 = 2;
/// Held-out images shown on the page.
const SHOWN: usize = 3;

/// Capture a small scene, train on it, score it, relight it: under three minutes, nothing else needed.
///
/// Shoots an object on the virtual rig (36 cameras, 20 lights) into a folder in the layout of ReNe, trains the paper's model on
/// it, scores views and lights that it has not seen beside baselines that learn nothing, and lets the light move through a
/// view in a film. Open index.html in the folder afterwards.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight demo --out demo && xdg-open demo/index.html")]
pub struct Args {
    /// Folder for everything, made anew.
    #[arg(long, value_name = "DIR", default_value = "relight-demo")]
    out: PathBuf,
    /// Minutes to train for.
    #[arg(long, default_value_t = 1.25, value_parser = super::train::positive)]
    minutes: f64,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    let out = &args.out;
    places::check_folder(out)?;
    ensure!(
        fs::read_dir(out).map_or(true, |mut entries| entries.next().is_none()),
        "{}: exists and is not empty; remove it, or choose another folder with --out",
        out.display()
    );
    // Validated often, for the curve on the page.
    let recipe = Recipe { epoch: Some(500), ..Recipe::fast() };
    let wish = Wish {
        model: "v5".to_owned(),
        preset: "fast".to_owned(),
        recipe,
        seed: 0,
        budget: Budget { steps: None, minutes: Some(args.minutes) },
        bounds: None,
    };
    let folder = out.join("scene");
    let (data, config) = prepare(&folder, wish, quiet).inspect_err(|_| {
        // Nothing has been learnt that is worth keeping, and the next demo wants an empty folder. What went wrong is told
        // already.
        let _ = fs::remove_dir_all(&folder);
    })?;
    let run = RunFolder::create(&out.join("run"), &config)?;
    let outcome = train(&run, &config, &data, Device::Auto, false, quiet)?;
    if outcome.ending == Ending::Cancelled {
        bail!("stopped; the run so far is in {}", run.root().display());
    }
    let engine = engines::of_run(&run, &config)?;
    let mut shown = Vec::new();
    let mut scores = Vec::new();
    let cancel = cancel_flag()?;
    let mean = mean_image(&data.scene, &data.splits.train, &|_, _| unless(cancel))?;
    for split in [Split::Easy, Split::Hard] {
        let mut seen = |drawn: relight_train::evaluation::Drawn<'_>| {
            // The last ones: those of the hard split.
            shown.push((drawn.frame, drawn.image.clone()));
            Ok(unless(cancel))
        };
        let engine = (engine.as_ref(), &RenderSettings::default());
        let scored = evaluate(&data.scene, &data.splits, split, mean.as_ref(), "v5", engine, &mut seen)?;
        let Some(scored) = scored else {
            bail!("stopped before all images were scored; the run is in {}", run.root().display());
        };
        scores.push(scored);
    }
    let shown = shown.split_off(shown.len().saturating_sub(SHOWN));
    let film = out.join("relit.mp4");
    // An unseen view, the one whose maps are shown too.
    let view = shown.first().map_or(0, |(frame, _)| data.scene.frames[*frame].camera);
    draw_film(&data.scene, view, engine.as_ref(), &film, quiet)?;

    let page = page(&Told {
        scene: &data.scene,
        mean: mean.as_ref(),
        train: &data.splits.train,
        engine: engine.as_ref(),
        scores: &scores,
        shown: &shown,
        pictures: &out.join("pictures"),
        film: &film,
        metrics: &run.metrics(),
        training: format!("{} steps in {:.0} s", outcome.standing.step, outcome.standing.seconds),
    })?;
    overview(&data.scene, &shown)?.write_png(&out.join("overview.png"))?;
    let path = out.join("index.html");
    write_whole(&path, |file| file.write_all(page.as_bytes()))?;
    for row in table(&scores) {
        print_line(&format!("{:<24}{:>16}{:>16}{:>16}", row[0], row[1], row[2], row[3]))?;
    }
    print_line(&format!("report: {}", path.display()))?;
    Ok(())
}

/// Makes the scene in `folder`, looks at it, and settles how to train on it.
fn prepare(folder: &Path, wish: Wish, quiet: bool) -> anyhow::Result<(Prepared, RunConfig)> {
    shoot(folder, quiet)?;
    let (scene, splits) = open(folder)?;
    let mut data = Prepared::load(scene, splits, quiet)?;
    let config = data.plan(wish)?;
    Ok((data, config))
}

/// Captures the object on the virtual rig.
fn shoot(folder: &Path, quiet: bool) -> anyhow::Result<()> {
    let capture = VirtualCapture {
        object: OBJECT.to_owned(),
        views: VIEWS,
        lights: LIGHTS,
        width: WIDTH,
        height: HEIGHT,
        samples: SAMPLES,
        seed: 0,
    };
    let cancel = cancel_flag()?;
    let bar = Progress::new("shooting", (VIEWS * LIGHTS) as u64, quiet);
    let ending = capture.shoot(folder, false, &mut |session::Progress { done, total, .. }| {
        bar.count(done, total, "photographs");
        unless(cancel)
    });
    bar.clear();
    ensure!(ending? != Shot::Stopped, "stopped before the scene was shot");
    Ok(())
}

/// A film of the view of one camera, by index, in which the light moves.
fn draw_film(
    scene: &Scene,
    view: usize,
    engine: &dyn Engine,
    path: &Path,
    quiet: bool,
) -> anyhow::Result<()> {
    let camera = &scene.cameras[view];
    let lens =
        camera.intrinsics.resized(ENLARGED * camera.intrinsics.width, ENLARGED * camera.intrinsics.height);
    let focus = focus(&scene.cameras, &scene.lights);
    let shots = paths::lights(&scene.lights, focus, &camera.pose, FRAMES)?;
    let mut film = Film::create(path, FRAME_RATE, FRAMES)?;
    let bar = Progress::new("filming", FRAMES as u64, quiet);
    let cancel = cancel_flag()?;
    for (i, shot) in shots.iter().enumerate() {
        let picture = render(
            engine,
            &lens,
            &shot.camera,
            &shot.light,
            Outputs::default(),
            &RenderSettings::default(),
            &mut |_, _| unless(cancel),
        )?;
        film.push(&picture.image(Map::Final, None)?)?;
        bar.update(i as u64 + 1, FRAMES as u64, String::new);
    }
    film.finish()?;
    bar.clear();
    Ok(())
}

/// What the page tells.
struct Told<'a> {
    scene: &'a Scene,
    /// The mean of the training photographs.
    mean: Option<&'a Image>,
    train: &'a [usize],
    engine: &'a dyn Engine,
    scores: &'a [Evaluation],
    /// Frames with their renderings.
    shown: &'a [(usize, Image)],
    /// Folder for the pictures.
    pictures: &'a Path,
    film: &'a Path,
    metrics: &'a Path,
    training: String,
}

fn page(told: &Told<'_>) -> anyhow::Result<String> {
    let mut page = ReportPage::new("relight: a scene learnt from photographs, lit anew");
    page.paragraph(&format!(
        "The virtual rig photographed an object, one light on at a time: {VIEWS} views under {LIGHTS} lights, {WIDTH}x{HEIGHT} \
         pixels. From {} of the photographs the program learnt the paper's model v5 ({}), then drew views and lights that it \
         had not seen.",
        told.train.len(),
        told.training
    ));
    page.video(&fs::read(told.film).with_context(|| told.film.display().to_string())?);

    page.heading("Scores");
    page.paragraph(
        "Easy: unseen cameras under known lights. Hard: unseen cameras under unseen lights. Beside them two baselines \
         that learn nothing: the mean of all training photographs, and the photograph of the nearest training camera \
         under the nearest training light.",
    );
    page.table(&table(told.scores));

    page.heading("Unseen view, unseen light");
    let nearest = NearestLight::new(told.scene, told.train);
    for (frame, drawn) in told.shown {
        let (camera, light) = (told.scene.frames[*frame].camera, told.scene.frames[*frame].light);
        let name =
            format!("view {}, light {}", told.scene.cameras[camera].label, told.scene.lights[light].label);
        let mut row = vec![
            (
                png(told, &format!("{frame}-photograph"), &told.scene.read_frame(*frame)?)?,
                format!("photograph: {name}"),
            ),
            (png(told, &format!("{frame}-drawn"), drawn)?, "drawn by the field".to_owned()),
        ];
        if let Some(image) = nearest.image(*frame)? {
            row.push((
                png(told, &format!("{frame}-nearest"), &image)?,
                "nearest photograph, copied".to_owned(),
            ));
        }
        if let Some(image) = told.mean {
            row.push((png(told, &format!("{frame}-mean"), image)?, "mean photograph".to_owned()));
        }
        page.pictures(&row);
    }

    if let Some((frame, _)) = told.shown.first() {
        page.heading("What the field knows");
        page.pictures(&maps(told, *frame)?);
    }

    page.heading("Training");
    let lines = fs::read_to_string(told.metrics).with_context(|| told.metrics.display().to_string())?;
    let reports = lines.lines().filter_map(|line| serde_json::from_str::<Report>(line).ok());
    let curve: Vec<(f64, f64)> = reports.filter_map(|r| r.psnr.map(|psnr| (r.seconds, psnr))).collect();
    page.curve("seconds", "validation PSNR, dB", &curve);

    page.heading("Your own scene");
    page.code(
        "relight scene check SCENE\nrelight train SCENE --out RUN --minutes 10\nrelight eval RUN --split easy\n\
         relight render RUN --path lights --out relit.mp4",
    );
    Ok(page.finish())
}

/// The maps of a frame's view under its light.
fn maps(told: &Told<'_>, frame: usize) -> anyhow::Result<Vec<(Vec<u8>, String)>> {
    let frame = &told.scene.frames[frame];
    let (camera, light) = (&told.scene.cameras[frame.camera], &told.scene.lights[frame.light]);
    let picture = render(
        told.engine,
        &camera.intrinsics,
        &camera.pose,
        &light.pose,
        Outputs { visibility: true, reflectance: true },
        &RenderSettings::default(),
        &mut |_, _| ControlFlow::Continue(()),
    )?;
    let captions = [
        (Map::Visibility, "visibility: how much of the light arrives"),
        (Map::Reflectance, "reflectance: the colour before shadows"),
        (Map::Depth, "depth: near red, far blue"),
        (Map::Opacity, "opacity: what is inside the box"),
    ];
    captions
        .into_iter()
        .map(|(map, caption)| {
            let image = picture.image(map, None)?;
            Ok((png(told, &map.to_string(), &image)?, caption.to_owned()))
        })
        .collect()
}

/// Photographs above, renderings below, enlarged so that their pixels show.
fn overview(scene: &Scene, shown: &[(usize, Image)]) -> anyhow::Result<Image> {
    let photographs: Vec<Image> =
        shown.iter().map(|(frame, _)| scene.read_frame(*frame)).collect::<Result<_, _>>()?;
    let zoom = ENLARGED as usize;
    let mut data = Vec::new();
    for row in [photographs.iter().collect::<Vec<_>>(), shown.iter().map(|(_, drawn)| drawn).collect()] {
        for v in 0..HEIGHT as usize * zoom {
            for image in &row {
                let line = image.data.chunks(3 * image.width as usize).nth(v / zoom).unwrap_or_default();
                data.extend(line.chunks(3).flat_map(|pixel| pixel.repeat(zoom)));
            }
        }
    }
    let width = WIDTH * ENLARGED * shown.len() as u32;
    Ok(Image { width, height: 2 * HEIGHT * ENLARGED, data })
}

/// Writes a picture beside the page and hands its bytes to the page.
fn png(told: &Told<'_>, name: &str, image: &Image) -> anyhow::Result<Vec<u8>> {
    fs::create_dir_all(told.pictures).with_context(|| told.pictures.display().to_string())?;
    let path = told.pictures.join(format!("{name}.png"));
    image.write_png(&path)?;
    fs::read(&path).with_context(|| path.display().to_string())
}

fn table(scores: &[Evaluation]) -> Vec<Vec<String>> {
    let cell = |s: Option<Scores>| s.map_or("-".to_owned(), |s| format!("{:.2} / {:.3}", s.psnr, s.ssim));
    let head = ["PSNR in dB / SSIM", "field (v5)", "nearest-light", "mean-image"];
    let row = |s: &Evaluation| {
        let name = format!("{} ({} images)", s.split, s.images.len());
        vec![name, cell(Some(s.mean)), cell(s.baselines.nearest_light), cell(s.baselines.mean_image)]
    };
    std::iter::once(head.map(str::to_owned).to_vec()).chain(scores.iter().map(row)).collect()
}
