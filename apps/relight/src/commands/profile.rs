//! `relight profile`: where the time of a training step goes, and how near each stage comes to what the machine can do.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::bail;
use relight_cpu::limits::Limits;
use relight_field::architecture::VARIANTS;
use relight_field::engine::{RayBatch, StageCost};
use relight_field::parameters::Parameters;
use relight_train::batch::{BatchSampler, LightChoice};
use relight_train::recipe::Preset;
use relight_train::schedule::Budget;
use relight_train::trainer::views;
use serde::Serialize;

use super::train::{presets, recipe};
use crate::console::{Progress, cancel_flag, print_json, print_line, unless};
use crate::engines::{self, Device};
use crate::preparation::{Prepared, Wish, open};

/// Share of the steps at the end that are counted: by then samples lie where the surfaces are.
const COUNTED: f64 = 0.25;

/// Show where the time of a training step goes.
///
/// Trains on SCENE for some steps, keeps nothing, and prints for each stage of the last quarter of them its time, its
/// arithmetic, the bytes that it streams, the table entries that it reads or adds to in no order, and its share of the
/// limit of this machine that binds it. The limits are measured first. Run it while the machine does nothing else.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight profile SCENE --steps 8000")]
pub struct Args {
    /// Folder of the scene.
    scene: PathBuf,
    /// Architecture.
    #[arg(long, default_value = "v5", value_parser = VARIANTS.map(|(name, _)| name), ignore_case = true)]
    model: String,
    /// How to train.
    #[arg(long, default_value = "fast", value_parser = presets())]
    preset: Preset,
    /// Settings to use instead of the preset's: a TOML file as in config.toml's [recipe].
    #[arg(long, value_name = "FILE.toml")]
    recipe: Option<PathBuf>,
    /// Steps to train for.
    #[arg(long, default_value_t = 4000, value_parser = clap::value_parser!(u64).range(4..))]
    steps: u64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// One line of the table; costs are those of one step.
#[derive(Serialize)]
struct Line {
    stage: &'static str,
    milliseconds: f64,
    share_of_step: f64,
    operations: f64,
    bytes: f64,
    lookups: f64,
    updates: f64,
    /// The limit that binds, and how near the stage comes to it, 0..1.
    #[serde(skip_serializing_if = "Option::is_none")]
    limit: Option<(&'static str, f64)>,
}

/// The whole table.
#[derive(Serialize)]
struct Table {
    model: String,
    preset: &'static str,
    threads: usize,
    steps: u64,
    milliseconds: f64,
    rays_per_second: f64,
    pairs_per_second: f64,
    operations_per_second: f64,
    bytes_per_second: f64,
    lookups_per_second: f64,
    updates_per_second: f64,
    stages: Vec<Line>,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    let model = args.model.to_lowercase();
    let recipe = recipe(args.preset, args.recipe.as_deref(), &model)?;
    let (scene, splits) = open(&args.scene)?;
    let mut data = Prepared::load(scene, splits, quiet)?;
    let config = data.plan(Wish {
        model,
        preset: args.preset.name().to_owned(),
        recipe,
        seed: 0,
        budget: Budget { steps: Some(args.steps), minutes: None },
        bounds: None,
    })?;
    let field = config.field()?;
    let bounds = field.bounds;
    // A step reads the tables of all levels, and adds to those of one after another.
    let level = 1 << field.grid.log2_table;
    let entries = field.grid.entries().next_power_of_two();
    let limits = match field.grid.features {
        4 => Limits::measure::<4>(entries, level),
        _ => Limits::measure::<2>(entries, level),
    };
    let recipe = &config.recipe;
    let mut engine = engines::create(Device::Cpu, &Parameters::init(field, 0)?, config.engine())?;
    engine.set_views(&views(&data.scene, &data.pixels));
    if let Some(prior) = &data.depths {
        engine.expect_surfaces(&prior.points);
    }
    let lights = LightChoice::of(recipe);
    let (depths, rays) = (data.depths.as_ref(), recipe.rays_per_step);
    let batches = BatchSampler::new(&data.scene, &data.pixels, depths, rays, lights, 0)?;
    let cancel = cancel_flag()?;
    let bar = Progress::new("profiling", args.steps, quiet);
    let mut batch = RayBatch::default();
    let first = args.steps - (COUNTED * args.steps as f64) as u64;
    let (mut before, mut drawing, mut started) = (Vec::new(), 0.0, Instant::now());
    let (mut rays, mut pairs) = (0, 0);
    for step in 0..args.steps {
        if unless(cancel).is_break() {
            bar.clear();
            bail!("stopped");
        }
        if step == first {
            (before, started) = (engine.stages(), Instant::now());
            (drawing, rays, pairs) = (0.0, 0, 0);
        }
        let drawn = Instant::now();
        batches.fill(step, &mut batch);
        drawing += drawn.elapsed().as_secs_f64();
        let progress = step as f64 / args.steps as f64;
        let stats = engine.train_step(&batch, &recipe.step_settings(step, progress, &bounds))?;
        rays += stats.rays;
        pairs += stats.pixels;
        bar.update(step + 1, args.steps, || format!("step {}", step + 1));
    }
    let (seconds, counted) = (started.elapsed().as_secs_f64(), args.steps - first);
    bar.clear();

    let per_step = |total: f64| total / counted as f64;
    let mut stages =
        vec![line("draw rays", &StageCost { seconds: per_step(drawing), ..StageCost::default() }, &limits)];
    for ((name, after), (_, before)) in engine.stages().into_iter().zip(before) {
        let cost = StageCost {
            seconds: per_step(after.seconds - before.seconds),
            operations: per_step(after.operations - before.operations),
            bytes: per_step(after.bytes - before.bytes),
            lookups: per_step(after.lookups - before.lookups),
            updates: per_step(after.updates - before.updates),
        };
        stages.push(line(name, &cost, &limits));
    }
    stages.retain(|stage| stage.milliseconds > 0.0);
    let milliseconds = 1e3 * per_step(seconds);
    stages.iter_mut().for_each(|stage| stage.share_of_step = stage.milliseconds / milliseconds);
    let table = Table {
        model: config.model.clone(),
        preset: args.preset.name(),
        threads: rayon::current_num_threads(),
        steps: counted,
        milliseconds,
        rays_per_second: rays as f64 / seconds,
        pairs_per_second: pairs as f64 / seconds,
        operations_per_second: limits.operations,
        bytes_per_second: limits.bytes,
        lookups_per_second: limits.lookups,
        updates_per_second: limits.updates,
        stages,
    };
    if args.json { print_json(&table) } else { print_table(&table) }
}

/// The line of a stage.
fn line(stage: &'static str, cost: &StageCost, limits: &Limits) -> Line {
    let least = [
        ("arithmetic", cost.operations / limits.operations),
        ("bandwidth", cost.bytes / limits.bytes),
        ("lookups", cost.lookups / limits.lookups),
        ("updates", cost.updates / limits.updates),
    ];
    let binding = least.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
    let limit = binding.filter(|(_, seconds)| *seconds > 0.0 && cost.seconds > 0.0);
    Line {
        stage,
        milliseconds: 1e3 * cost.seconds,
        share_of_step: 0.0,
        operations: cost.operations,
        bytes: cost.bytes,
        lookups: cost.lookups,
        updates: cost.updates,
        limit: limit.map(|(name, seconds)| (name, seconds / cost.seconds)),
    }
}

fn print_table(table: &Table) -> anyhow::Result<()> {
    print_line(&format!(
        "{} threads; limits: {:.0} GFLOP/s, {:.0} GB/s, {:.2} G lookups/s, {:.2} G updates/s",
        table.threads,
        table.operations_per_second / 1e9,
        table.bytes_per_second / 1e9,
        table.lookups_per_second / 1e9,
        table.updates_per_second / 1e9
    ))?;
    print_line(&format!(
        "{} {}, last {} steps: {:.2} ms a step, {:.0} rays/s, {:.0} pairs/s",
        table.model,
        table.preset,
        table.steps,
        table.milliseconds,
        table.rays_per_second,
        table.pairs_per_second
    ))?;
    print_line(&format!(
        "{:<32}{:>8}{:>7}{:>10}{:>8}{:>10}{:>10}  share of limit",
        "stage", "ms", "%", "MFLOP", "MB", "k lookups", "k updates"
    ))?;
    for stage in &table.stages {
        let limit = stage
            .limit
            .map_or("not counted".to_owned(), |(name, share)| format!("{:>3.0} % of {name}", 100.0 * share));
        print_line(&format!(
            "{:<32}{:>8.3}{:>7.1}{:>10.1}{:>8.1}{:>10.0}{:>10.0}  {limit}",
            stage.stage,
            stage.milliseconds,
            100.0 * stage.share_of_step,
            stage.operations / 1e6,
            stage.bytes / 1e6,
            stage.lookups / 1e3,
            stage.updates / 1e3
        ))?;
    }
    Ok(())
}
