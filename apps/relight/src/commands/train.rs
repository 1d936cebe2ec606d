//! `relight train`: from a scene to a field.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use clap::ValueEnum;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use relight_field::architecture::VARIANTS;
use relight_field::parameters::Parameters;
use relight_scene::{Bounds, Scene, Splits, check_bounds, read_text};
use relight_train::checkpoint::{Checkpoint, Standing};
use relight_train::recipe::{Preset, Recipe};
use relight_train::run::{RunConfig, RunFolder, field_of};
use relight_train::schedule::Budget;
use relight_train::trainer::Ending;

use crate::console::{cancel_flag, unless};
use crate::engines::{self, Device};
use crate::preparation::{Prepared, Wish, check_splits, open, train};

/// A recipe's longest length, bytes.
const LONGEST_RECIPE: u64 = 1 << 20;
/// The model of a new run.
const MODEL: &str = "v5";

/// Train a field on a scene.
///
/// Reads the training and validation images of SCENE and leaves in RUN: config.toml (all that is needed to repeat the
/// run), weights.safetensors (the best by validation), metrics.jsonl, previews, and a checkpoint from which --resume
/// continues the very same run after a kill at any moment.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  relight train SCENE --out RUN --minutes 10\n  \
                  relight train SCENE --out RUN --resume           go on where it was stopped\n  \
                  relight train SCENE --out RUN --preset paper     the published recipe, slow\n\n\
                  Without --steps and --minutes it trains until validation stops improving. A run with --steps and one \
                  seed gives the same numbers each time on one machine; with --minutes the machine's speed decides.")]
pub struct Args {
    /// Folder of the scene.
    scene: PathBuf,
    /// Folder of the run, made anew.
    #[arg(long, value_name = "RUN")]
    out: PathBuf,
    /// Architecture: v0 (knows no light) to v5 (the paper's own, with visibility). [default: v5]
    #[arg(long, value_parser = VARIANTS.map(|(name, _)| name), ignore_case = true)]
    model: Option<String>,
    /// How to train: `fast` is ours, `paper` the published recipe to the letter. [default: fast]
    #[arg(long, value_parser = presets())]
    preset: Option<Preset>,
    /// Settings to use instead of the preset's: a TOML file as in config.toml's [recipe].
    #[arg(long, value_name = "FILE.toml")]
    recipe: Option<PathBuf>,
    /// Steps to train for.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Minutes to train for, stereo and validation included, loading of the images not.
    #[arg(long, value_parser = positive)]
    minutes: Option<f64>,
    /// Where to train.
    #[arg(long, default_value = "auto")]
    device: Device,
    /// Arithmetic to train in: single precision; bfloat16 was measured and is no faster on processors.
    #[arg(long, default_value = "f32")]
    precision: Precision,
    /// Seed of every random draw. [default: 0]
    #[arg(long)]
    seed: Option<u32>,
    /// World box of the field, metres; without it found from cameras and lights, and made tighter by stereo.
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = bounds, allow_hyphen_values = true)]
    bounds: Option<Bounds>,
    /// Continue the run in RUN; start it if there is none.
    #[arg(long)]
    resume: bool,
    /// One JSON object a line on standard output while it trains.
    #[arg(long)]
    json: bool,
}

/// What numbers are held and multiplied in.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Precision {
    F32,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    engines::check(args.device)?;
    // All that there is.
    let Precision::F32 = args.precision;
    let (run, config, data) = if args.resume && RunFolder::is_begun(&args.out) {
        resume(args, quiet)?
    } else {
        begin(args, quiet)?
    };
    let outcome = train(&run, &config, &data, args.device, args.json, quiet)?;
    match outcome.ending {
        Ending::Budget | Ending::Plateau => Ok(()),
        Ending::Cancelled => Err(stopped(args, &format!("at step {}", outcome.standing.step))),
    }
}

fn stopped(args: &Args, when: &str) -> anyhow::Error {
    let (scene, out) = (args.scene.display(), args.out.display());
    anyhow::anyhow!("stopped {when}; continue with relight train {scene} --out {out} --resume")
}

/// A new run. All that can be refused is, before minutes are spent on loading.
fn begin(args: &Args, quiet: bool) -> anyhow::Result<(RunFolder, RunConfig, Prepared)> {
    RunFolder::check_vacant(&args.out)?;
    let model = args.model.as_deref().unwrap_or(MODEL).to_lowercase();
    let recipe = recipe(args.preset.unwrap_or(Preset::Fast), args.recipe.as_deref(), &model)?;
    let (scene, splits) = open(&args.scene)?;
    if let Some(bounds) = &args.bounds {
        check_bounds(&scene, bounds).map_err(|fault| {
            let scene = args.scene.display();
            anyhow::anyhow!(
                "--bounds: {fault}; relight scene info {scene} tells the box in which surfaces are looked for without it"
            )
        })?;
    }
    let wish = Wish {
        model,
        preset: args.preset.unwrap_or(Preset::Fast).name().to_owned(),
        recipe,
        seed: args.seed.unwrap_or(0),
        budget: Budget { steps: args.steps, minutes: args.minutes },
        bounds: args.bounds,
    };
    // Written before minutes are spent on loading, so that what a kill leaves is resumed as it was asked for.
    let mut config = wish.config(&scene, &splits);
    let run = RunFolder::create(&args.out, &config)?;
    match prepare(args, &run, &mut config, scene, splits, quiet) {
        Ok(data) => Ok((run, config, data)),
        Err(error) => {
            if unless(cancel_flag()?).is_continue() {
                run.abandon();
            }
            Err(error)
        }
    }
}

/// Loads the images of a run and, where nothing was learnt yet, settles what its configuration leaves open.
fn prepare(
    args: &Args,
    run: &RunFolder,
    config: &mut RunConfig,
    scene: Scene,
    splits: Splits,
    quiet: bool,
) -> anyhow::Result<Prepared> {
    let before = config.clone();
    let prepared = Prepared::load(scene, splits, quiet).and_then(|mut data| {
        if RunFolder::exists(run.root()) {
            data.find_surfaces(&config.recipe, &config.search)?;
        } else {
            data.settle(config)?;
        }
        if *config != before {
            run.write_config(config)?;
        }
        Ok(data)
    });
    if prepared.is_err() && unless(cancel_flag()?).is_break() {
        return Err(stopped(args, "while the scene was made ready"));
    }
    prepared
}

/// The recipe of a training: the preset's, with the settings in the file `changes` in place of its own.
pub fn recipe(preset: Preset, changes: Option<&Path>, model: &str) -> anyhow::Result<Recipe> {
    changed(preset.recipe(), changes, model)
}

/// A recipe with the settings in the file `changes` in place of its own.
fn changed(recipe: Recipe, changes: Option<&Path>, model: &str) -> anyhow::Result<Recipe> {
    let Some(path) = changes else { return Ok(recipe) };
    let text = read_text(path, LONGEST_RECIPE)?;
    let changed = || -> anyhow::Result<Recipe> {
        let mut settings = toml::Table::try_from(&recipe)?;
        settings.extend(toml::from_str::<toml::Table>(&text)?);
        let recipe: Recipe = settings.try_into()?;
        recipe.validate()?;
        // Neither the box nor a grid to fit it is known yet; what else a field is made of is.
        field_of(&recipe, model, Bounds { lo: [0.0; 3], hi: [1.0; 3] })?;
        Ok(recipe)
    };
    changed().with_context(|| path.display().to_string())
}

/// The run to continue. A new budget replaces the old.
fn resume(args: &Args, quiet: bool) -> anyhow::Result<(RunFolder, RunConfig, Prepared)> {
    let (run, mut config) = RunFolder::resume(&args.out)?;
    check_same(args, &config)?;
    let before = config.clone();
    let budget = Budget { steps: args.steps, minutes: args.minutes };
    if !budget.is_open() && budget != config.budget {
        check_longer(&run, &config, &budget)?;
        config.budget = budget;
    }
    let (scene, splits) = open(&args.scene)?;
    check_splits(&scene, &splits, &config)?;
    // It may have moved.
    config.scene = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
    if config != before {
        run.write_config(&config)?;
    }
    let data = prepare(args, &run, &mut config, scene, splits, quiet)?;
    Ok((run, config, data))
}

/// Checks that the arguments do not ask for another run than the one to continue.
fn check_same(args: &Args, config: &RunConfig) -> anyhow::Result<()> {
    let differs = |what: &str, there: &dyn std::fmt::Display| {
        anyhow::anyhow!(
            "{}: this run has {what} {there}; leave the option out, or train into another folder",
            args.out.display()
        )
    };
    if args.model.as_ref().is_some_and(|m| !m.eq_ignore_ascii_case(&config.model)) {
        return Err(differs("model", &config.model));
    }
    if args.preset.is_some_and(|p| p.name() != config.preset) {
        return Err(differs("preset", &config.preset));
    }
    if args.recipe.is_some()
        && changed(config.recipe.clone(), args.recipe.as_deref(), &config.model)? != config.recipe
    {
        return Err(differs("another recipe, told in", &"config.toml"));
    }
    if args.seed.is_some_and(|s| s != config.seed) {
        return Err(differs("seed", &config.seed));
    }
    if args.bounds.is_some() && args.bounds != config.bounds {
        let told = |bounds: Bounds| format!("{:?} to {:?}", bounds.lo, bounds.hi);
        return Err(differs("bounds", &config.bounds.map_or("that are yet to be found".to_owned(), told)));
    }
    Ok(())
}

/// Checks that no more is done than a new budget allows: its schedules could not be followed any more.
fn check_longer(run: &RunFolder, config: &RunConfig, budget: &Budget) -> anyhow::Result<()> {
    if !run.checkpoint().is_file() {
        return Ok(());
    }
    let field = Parameters::init(config.field()?, 0)?;
    let done = Checkpoint::load(&run.checkpoint(), field)?.map_or_else(Standing::default, |c| c.standing);
    ensure!(
        !budget.is_exceeded(done.step, done.seconds),
        "{}: {} steps in {:.1} minutes are done already: give more --steps or --minutes than that, or leave both out",
        run.root().display(),
        done.step,
        done.seconds / 60.0
    );
    Ok(())
}

/// The presets, by name.
pub fn presets() -> impl TypedValueParser<Value = Preset> {
    PossibleValuesParser::new(Preset::ALL.map(Preset::name)).try_map(|name| name.parse::<Preset>())
}

/// A positive, finite number.
pub fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err("must be above 0".to_owned()) }
}

/// A box from its six numbers.
fn bounds(text: &str) -> Result<Bounds, String> {
    let numbers: Vec<f32> = text
        .split(',')
        .map(|n| {
            n.trim().parse::<f32>().ok().filter(|v| v.is_finite()).ok_or(format!("\"{n}\" is no number"))
        })
        .collect::<Result<_, _>>()?;
    let [x0, y0, z0, x1, y1, z1] = numbers[..] else {
        return Err(format!("{} numbers; a box has six: x0,y0,z0,x1,y1,z1", numbers.len()));
    };
    if x0 < x1 && y0 < y1 && z0 < z1 {
        Ok(Bounds { lo: [x0, y0, z0], hi: [x1, y1, z1] })
    } else {
        Err("each low corner must be below the high one: x0,y0,z0,x1,y1,z1".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_read_and_checked() {
        let b = bounds("-0.5,-0.5, -0.1,0.5,0.5,0.6").unwrap();
        assert_eq!((b.lo, b.hi), ([-0.5, -0.5, -0.1], [0.5, 0.5, 0.6]));
        assert!(bounds("1,2,3").unwrap_err().contains("six"));
        assert!(bounds("0,0,0,1,1,nan").unwrap_err().contains("nan"));
        assert!(bounds("0,0,0,1,-1,1").unwrap_err().contains("below"));
    }
}
