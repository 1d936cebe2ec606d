//! `relight capture calibrate`: lens, camera waypoints and light from photographs and touches of a board.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail, ensure};
use rayon::prelude::*;
use relight_capture::calibration::{
    BOARD, Board, BoardFile, CALIBRATION, Calibration, LENS_VIEWS, Measurements, RECHECK, Tolerance, VIEWS,
    WaypointView, calibrate, load, recheck, store,
};
use relight_capture::rig::RigFile;
use relight_scene::read_image;

use crate::console::{Progress, print_json, print_line};

/// Calibrate the lens, every camera waypoint and the light's arm from photographs and touches of a ChArUco board.
///
/// Reads SESSION/board.toml and the photographs SESSION/board/LABEL.png, one a waypoint (LABEL-2.png and so on for more of the
/// same), refines lens and viewpoints together, and writes SESSION/calibration.json. Photographs in SESSION/lens, of any names,
/// help to determine the lens: the board may lie anywhere in them, and the camera be anywhere, at the same focus. The
/// residuals of each waypoint are told in pixels and millimetres, with the error that is to be expected of its pose; bad
/// waypoints and weak geometry are named.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  relight capture calibrate SESSION\n  \
                  relight capture calibrate SESSION --recheck    does it still hold? photographs SESSION/recheck/LABEL.png\n  \
                  relight capture calibrate TODAY --lens LAST-WEEK/calibration.json    the same camera at the same focus\n\n\
                  SESSION/board.toml:\n\n  \
                  columns = 12                             # squares\n  \
                  rows = 9\n  \
                  square-metres = 0.027                    # measured on the print\n  \
                  marker-metres = 0.02025\n  \
                  dictionary = \"DICT_5X5_100\"\n  \
                  # The board lies flat in the middle of the world (+X along its columns, +Z out of the paper), or where\n  \
                  # this says: board-to-world = [16 numbers]\n\n  \
                  # Where the tip of the light's arm touched the board, metres: three or more touches, not on a line; or one,\n  \
                  # and light-base-to-world = [16 numbers], whose rotation is taken.\n  \
                  [[touches]]\n  \
                  on-board-metres = [0.0, 0.0, 0.0]        # the board's frame: its outer corner at the top left\n  \
                  in-arm-metres = [-0.31, 0.12, 0.004]     # the frame of the arm's base")]
pub struct Args {
    /// Folder of the session.
    session: PathBuf,
    /// An earlier calibration of the same camera at the same focus: what was known of the lens then counts too.
    #[arg(long, value_name = "FILE", conflicts_with = "recheck")]
    lens: Option<PathBuf>,
    /// A rig file whose table `[board]` tells of the board, where SESSION/board.toml does not.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Say whether the stored calibration still holds, by new photographs of some waypoints; exit status 1 if not.
    #[arg(long)]
    recheck: bool,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    let of_rig = args.rig.as_deref().map(RigFile::read).transpose()?.and_then(|file| file.board);
    let of_rig = of_rig.map(|board| board.board()).transpose()?;
    let file = BoardFile::read(&args.session.join(BOARD), of_rig)?;
    let board = file.board;
    if args.recheck {
        return check(args, &board, quiet);
    }
    let earlier = args.lens.as_deref().map(load).transpose()?.map(|(earlier, _)| earlier);
    let (views, image_size) = look(&by_waypoint(&args.session.join(VIEWS))?, &board, quiet)?;
    let for_the_lens = in_order(&args.session.join(LENS_VIEWS))?;
    let (lens_views, lens_size) = look(&for_the_lens, &board, quiet)?;
    ensure!(
        lens_views.is_empty() || lens_size == image_size,
        "{}: the photographs of {VIEWS} are {}x{}, those of {LENS_VIEWS} {}x{}; shoot both with the same camera",
        args.session.display(),
        image_size.0,
        image_size.1,
        lens_size.0,
        lens_size.1
    );
    let calibration = calibrate(&Measurements {
        board: &board,
        board_to_world: file.board_to_world.unwrap_or_else(|| board.lying_flat()),
        image_size,
        views: &views,
        lens_views: &lens_views,
        earlier: earlier.as_ref(),
        touches: &file.touches,
        declared_alignment: file.light_base_to_world,
    })
    .with_context(|| args.session.display().to_string())?;
    let out = args.session.join(CALIBRATION);
    let made = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    store(&calibration, made, &out)?;
    for photograph in &calibration.lens_photographs {
        if let (Some(problem), Some((_, path))) = (&photograph.problem, for_the_lens.get(photograph.label)) {
            tracing::warn!("{}: took no part in the lens: {problem}", path.display());
        }
    }
    for warning in calibration.warnings() {
        tracing::warn!("{}: {warning}", args.session.display());
    }
    tell(&calibration, &out, args.json)
}

/// The calibration, for people; or as its file has it, and which waypoints are bad or weak.
fn tell(calibration: &Calibration, file: &Path, json: bool) -> anyhow::Result<()> {
    if json {
        let mut value: serde_json::Value = serde_json::from_str(&fs::read_to_string(file)?)?;
        value["bad_waypoints"] = calibration.bad().into();
        value["weak_waypoints"] = calibration.weak().into();
        return print_json(&value);
    }
    print_line(&format!("{calibration}{}", file.display()))
}

/// Whether the stored calibration still holds.
fn check(args: &Args, board: &Board, quiet: bool) -> anyhow::Result<()> {
    let file = args.session.join(CALIBRATION);
    let (calibration, _) = load(&file)?;
    ensure!(
        calibration.board == *board,
        "{}: was made with another board than {} tells of; calibrate anew",
        file.display(),
        args.session.join(BOARD).display()
    );
    let (views, size) = look(&by_waypoint(&args.session.join(RECHECK))?, board, quiet)?;
    let lens = &calibration.intrinsics;
    ensure!(
        size == (lens.width, lens.height),
        "{}: the photographs are {}x{}, those of the calibration {}x{}; shoot them as those were",
        args.session.join(RECHECK).display(),
        size.0,
        size.1,
        lens.width,
        lens.height
    );
    let found = recheck(&calibration, &views, Tolerance::default())?;
    if args.json {
        print_json(&found)?;
    } else {
        print_line("waypoint  corners  shift px  shift mm  camera moved mm")?;
        for w in &found.waypoints {
            let number = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.3}"));
            let [pixels, shift, moved] =
                [w.pixels, w.metres.map(|m| m * 1e3), w.camera_moved.map(|m| m * 1e3)];
            let says = match (w.pixels, w.has_moved) {
                (None, _) => "  the board is not seen",
                (_, true) => "  moved",
                _ => "",
            };
            let (pixels, shift, moved) = (number(pixels), number(shift), number(moved));
            print_line(&format!(
                "{:8}  {:7}  {pixels:>8}  {shift:>8}  {moved:>15}{says}",
                w.label, w.corners
            ))?;
        }
    }
    if found.waypoints.iter().any(|w| w.has_moved) {
        bail!("{}: no longer holds; calibrate anew", file.display());
    }
    let unseen: Vec<String> =
        found.waypoints.iter().filter(|w| w.pixels.is_none()).map(|w| w.label.to_string()).collect();
    ensure!(
        found.holds,
        "the board is not seen from waypoint {}, so nobody knows whether the calibration holds there; lay it where it lay, \
         light it, and photograph it again",
        unseen.join(", ")
    );
    Ok(())
}

/// The corners in numbered photographs, by number, and the size of these.
fn look(
    photographs: &[(usize, PathBuf)],
    board: &Board,
    quiet: bool,
) -> anyhow::Result<(Vec<WaypointView>, (u32, u32))> {
    let bar = Progress::new("detecting", photographs.len() as u64, quiet);
    let done = std::sync::atomic::AtomicU64::new(0);
    let seen = photographs.par_iter().map(|(label, path)| -> anyhow::Result<_> {
        let image = read_image(path)?;
        let size = (image.width, image.height);
        let view =
            WaypointView::of_images(*label, &[image], board).with_context(|| path.display().to_string())?;
        let done = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        bar.update(done, photographs.len() as u64, String::new);
        Ok((view, size))
    });
    let seen: Vec<_> = seen.collect::<anyhow::Result<_>>()?;
    bar.clear();
    let mut views: Vec<WaypointView> = Vec::new();
    let size = seen.first().map_or((0, 0), |(_, size)| *size);
    for ((view, this), (_, path)) in seen.into_iter().zip(photographs) {
        ensure!(
            this == size,
            "{}: is {}x{}, others are {}x{}",
            path.display(),
            this.0,
            this.1,
            size.0,
            size.1
        );
        match views.last_mut().filter(|last| last.label == view.label) {
            Some(last) => last.corners.extend(view.corners),
            None => views.push(view),
        }
    }
    Ok((views, size))
}

/// Photographs of a folder with the waypoint that each is of, by waypoint.
fn by_waypoint(folder: &Path) -> anyhow::Result<Vec<(usize, PathBuf)>> {
    let label = |path: &Path| path.file_stem()?.to_str()?.split('-').next()?.parse().ok();
    let mut found = Vec::new();
    for path in files(folder).with_context(|| folder.display().to_string())? {
        let label = label(&path).with_context(|| {
            format!("{}: is named after no waypoint; photographs are named like 00013.png", path.display())
        })?;
        found.push((label, path));
    }
    ensure!(!found.is_empty(), "{}: holds no photographs; name them like 00013.png", folder.display());
    found.sort();
    Ok(found)
}

/// Photographs of a folder in the order of their names, numbered; none without a folder.
fn in_order(folder: &Path) -> anyhow::Result<Vec<(usize, PathBuf)>> {
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let mut found = files(folder).with_context(|| folder.display().to_string())?;
    found.sort();
    Ok(found.into_iter().enumerate().collect())
}

/// All files that are not hidden.
fn files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let is_hidden =
        |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    let paths = fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path()));
    paths.filter(|path| !path.as_ref().is_ok_and(is_hidden)).collect()
}
