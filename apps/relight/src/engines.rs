//! Which engine trains and draws.

use anyhow::{Context, ensure};
use clap::ValueEnum;
use relight_cpu::CpuEngine;
use relight_field::engine::Engine;
use relight_field::parameters::Parameters;
use relight_field::sampling::EngineConfig;
use relight_field::weights_file;
use relight_train::guide_file::{self, Guide};
use relight_train::run::{RunConfig, RunFolder};

/// Where a field is trained and drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Device {
    /// The fastest there is.
    Auto,
    /// All cores of the processor.
    Cpu,
    /// The graphics card.
    Gpu,
}

/// Whether this build and machine have the device.
pub fn check(device: Device) -> anyhow::Result<()> {
    ensure!(device != Device::Gpu, "--device gpu: this build has no GPU engine; use --device cpu");
    Ok(())
}

/// What a device is, on this machine: the processor's name, as far as the system tells it, and the threads at work.
pub fn told(_: Device) -> String {
    // The only one that there is.
    let name = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    });
    let threads = rayon::current_num_threads();
    let threads = if threads == 1 { "1 thread".to_owned() } else { format!("{threads} threads") };
    format!("cpu ({}{threads})", name.map_or(String::new(), |name| format!("{name}, ")))
}

/// An engine that holds `parameters`.
pub fn create(
    device: Device,
    parameters: &Parameters,
    config: EngineConfig,
) -> anyhow::Result<Box<dyn Engine>> {
    check(device)?;
    Ok(Box::new(CpuEngine::new(parameters, config)?))
}

/// The best weights of a run, of the field that its configuration tells.
pub fn weights(run: &RunFolder, config: &RunConfig) -> anyhow::Result<Parameters> {
    let path = run.weights();
    ensure!(
        path.is_file(),
        "{}: is missing; relight train SCENE --out {} --resume writes it from the run's checkpoint, or goes on to where \
         there are weights",
        path.display(),
        run.root().display()
    );
    let parameters = weights_file::load(&path)?;
    let told = config.field()?;
    // Else scores would be told of another model than they are of.
    ensure!(
        (parameters.config.architecture, parameters.config.grid) == (told.architecture, told.grid),
        "{}: is not of the model {} and the grid that config.toml beside it tells; put back the one that belongs to the \
         other",
        path.display(),
        config.model
    );
    Ok(parameters)
}

/// An engine that holds the best weights of a run, and knows all that the field holds: where the run's guide does not tell it, it looks,
/// which takes a second, and keeps nothing, since who reads a run may not be allowed to write.
pub fn of_run(run: &RunFolder, config: &RunConfig) -> anyhow::Result<Box<dyn Engine>> {
    guided_by(guide_file::load(&run.guide())?, run, config)
}

/// Keeps in the guide of a run, whose training has ended and which the caller has locked, where the field holds anything: nobody who opens the
/// run has to look again then.
pub fn complete_guide(run: &RunFolder, config: &RunConfig) -> anyhow::Result<()> {
    let guide = guide_file::load(&run.guide()).unwrap_or_else(|damaged| {
        tracing::warn!("{damaged}; it is made anew");
        None
    });
    if guide.as_ref().is_none_or(|guide| !guide.surveyed) {
        let learnt = guided_by(guide, run, config)?.guide();
        guide_file::save(&Guide { learnt, surveyed: true }, &run.guide())?;
    }
    Ok(())
}

/// An engine that holds the best weights of a run, with this guide.
fn guided_by(guide: Option<Guide>, run: &RunFolder, config: &RunConfig) -> anyhow::Result<Box<dyn Engine>> {
    let parameters = weights(run, config)?;
    let mut engine = create(Device::Auto, &parameters, config.engine())
        .with_context(|| run.weights().display().to_string())?;
    // Without one, from nothing at all.
    let guide = guide.unwrap_or_else(|| Guide { learnt: vec![0; engine.guide().len()], surveyed: false });
    engine.set_guide(&guide.learnt).with_context(|| run.guide().display().to_string())?;
    if !guide.surveyed {
        engine.survey();
    }
    Ok(engine)
}
