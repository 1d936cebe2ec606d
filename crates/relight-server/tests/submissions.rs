//! What is asked of a submission, how it is scored, and that nothing makes the checks fall over.

// Outside of test functions too.
#![allow(clippy::unwrap_used)]

mod common;

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use common::{SIZE, answers, benchmark, file, scene};
use proptest::prelude::*;
use rawzip::ZipArchiveWriter;
use relight_metrics::{psnr, ssim};
use relight_scene::{Image, Intrinsics, Pose, ReneWriter, Split};
use relight_server::Progress;
use relight_server::benchmark::{Benchmark, BenchmarkError};
use relight_server::scoring::{Scores, ScoringError, error_map, score};
use relight_server::submission::{Limits, SubmissionError, check, inspect};

/// A zip of these entries.
fn zip(entries: &[(String, Vec<u8>)]) -> Vec<u8> {
    use std::io::Write;
    let mut zip = ZipArchiveWriter::new(Vec::new());
    for (name, bytes) in entries {
        let (mut entry, config) = zip.new_file(name).start().unwrap();
        let mut data = config.wrap(&mut entry);
        data.write_all(bytes).unwrap();
        let (_, descriptor) = data.finish().unwrap();
        entry.finish(descriptor).unwrap();
    }
    zip.finish().unwrap()
}

fn go_on(_: Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn codes(zip: &Path, benchmark: &Benchmark) -> Vec<String> {
    match check(zip, benchmark, &Limits::default(), &mut go_on) {
        Ok(_) => Vec::new(),
        Err(SubmissionError::Refused(refusal)) => {
            refusal.problems.iter().map(|problem| problem.code.to_string()).collect()
        }
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn an_official_scene_asks_for_the_published_images() {
    let folder = tempfile::tempdir().unwrap();
    let lens =
        Intrinsics { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.2, cy: 0.2, distortion: vec![0.0; 5] };
    let at = |i: usize, radius: f64| {
        Pose::look_at([radius * (i as f64).cos(), radius * (i as f64).sin(), 0.4], [0.0; 3])
    };
    let cameras = (0..50).map(|i| at(i, 0.5)).collect();
    let lights: Vec<Pose> = (0..40).map(|i| at(i, 0.2)).collect();
    let writer = ReneWriter::create(&folder.path().join("apple"), &lens, cameras, &lights).unwrap();
    let black = Image { width: 1, height: 1, data: vec![0; 3] }.png().unwrap();
    (0..50).for_each(|view| writer.write_frame(view, 0, &black).unwrap());
    let data = |light: usize| folder.path().join(format!("apple/lset{light:03}/data"));
    for file in data(0).read_dir().unwrap().map(|entry| entry.unwrap().path()) {
        (1..40).for_each(|light| {
            assert_eq!(
                fs::copy(&file, data(light).join(file.file_name().unwrap())).unwrap(),
                file.metadata().unwrap().len()
            )
        });
    }
    let benchmark = Benchmark::layout(folder.path()).unwrap();
    let images = &benchmark.scenes[0].images;
    let names = |split| -> Vec<&str> {
        let of_split = images.iter().filter(|image| image.split == split);
        of_split.map(|image| image.entry.as_str()).collect()
    };
    assert_eq!((names(Split::Val).len(), names(Split::Easy).len()), (9, 111));
    let hard = [2, 21, 34].map(|light| [4, 8, 15].map(|camera| format!("apple_{light:02}_{camera:02}.png")));
    assert_eq!(names(Split::Hard), hard.concat());
    assert!(
        names(Split::Val).contains(&"apple_12_25.png") && names(Split::Easy).contains(&"apple_00_15.png")
    );
    assert_eq!(benchmark.find("apple_00_15.png").map(|(scene, _)| scene), Some(0));
}

#[test]
fn participants_need_no_ground_truth_and_servers_do() {
    let (folder, benchmark) = benchmark();
    let tests: Vec<(usize, usize)> = benchmark.scenes[0].images.iter().map(|i| (i.camera, i.light)).collect();
    let copy = tempfile::tempdir().unwrap();
    for name in ["box", "café"] {
        scene(&copy.path().join(name), |view, light| tests.contains(&(view, light)));
    }
    let theirs = Benchmark::layout(copy.path()).unwrap();
    let asked = |benchmark: &Benchmark| -> Vec<(String, Split, u32)> {
        let images = benchmark.scenes.iter().flat_map(|scene| &scene.images);
        images.map(|image| (image.entry.clone(), image.split, image.width)).collect()
    };
    assert_eq!(asked(&theirs), asked(&benchmark));
    let upload = file(folder.path(), "a.zip", &zip(&answers(&benchmark, true)));
    assert_eq!(codes(&upload, &theirs), Vec::<String>::new());
    let refused = Benchmark::open(copy.path());
    assert!(
        matches!(&refused, Err(BenchmarkError::BlackTruth(path)) if path.starts_with(copy.path())),
        "{refused:?}"
    );
    // Nothing is left in the folders.
    assert!(!copy.path().join("box/splits.json").exists());
    // A folder that is a scene is a benchmark too.
    assert_eq!(Benchmark::layout(&copy.path().join("box")).unwrap().scenes.len(), 1);
    let empty = tempfile::tempdir().unwrap();
    assert!(matches!(Benchmark::layout(empty.path()), Err(BenchmarkError::Empty(_))));
}

#[test]
fn all_ground_truth_is_looked_at_when_a_benchmark_is_added() {
    let (_folder, benchmark) = benchmark();
    benchmark.verify(&mut go_on).unwrap();
    let last = benchmark.scenes[1].images.last().unwrap();
    let black = Image { width: SIZE.0, height: SIZE.1, data: vec![1; 3 * (SIZE.0 * SIZE.1) as usize] };
    black.write_png(&last.truth).unwrap();
    assert!(
        matches!(benchmark.verify(&mut go_on), Err(BenchmarkError::BlackTruth(path)) if path == last.truth)
    );
    let wide = Image { width: 2, height: 1, data: vec![9; 6] };
    wide.write_png(&last.truth).unwrap();
    assert!(benchmark.verify(&mut go_on).is_err());
    let stop = &mut |_| ControlFlow::Break(());
    assert!(matches!(benchmark.verify(stop), Err(BenchmarkError::Stopped)));
}

#[test]
fn scores_are_those_of_each_image_and_the_same_on_any_number_of_threads() {
    let (folder, benchmark) = benchmark();
    let limits = Limits::default();
    let answers = answers(&benchmark, true);
    let upload = file(folder.path(), "a.zip", &zip(&answers));
    let submission = check(&upload, &benchmark, &limits, &mut go_on).unwrap();
    assert_eq!(submission.splits, [Split::Val, Split::Easy, Split::Hard]);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| score(&submission, &benchmark, &limits, &mut go_on)).unwrap()
    };
    let scores = on(1);
    assert_eq!(serde_json::to_string(&scores).unwrap(), serde_json::to_string(&on(3)).unwrap());
    let images =
        benchmark.scenes.iter().flat_map(|scene| scene.images.iter().map(move |image| (scene, image)));
    for (((scene, image), scored), (name, png)) in images.zip(&scores.images).zip(&answers) {
        assert_eq!((&scored.scene, scored.split), (&scene.name, image.split));
        assert_eq!((scored.camera, scored.light), (image.camera, image.light));
        assert_eq!(name, &image.entry);
        let (truth, answer) =
            (image.read_truth().unwrap(), relight_scene::decode_image(&upload, png).unwrap());
        assert_eq!(scored.psnr, psnr(&answer.data, &truth.data).unwrap());
        assert_eq!(scored.ssim, ssim(&answer.data, &truth.data, SIZE.0, SIZE.1).unwrap());
    }
    // Every scene counts alike in the mean over scenes.
    for (i, mean) in scores.means.iter().enumerate() {
        let of_scene = |s: usize| {
            let of_split = |i: &&relight_server::scoring::ImageScore| {
                i.split == mean.split && i.scene == benchmark.scenes[s].name
            };
            let psnr: Vec<f64> = scores.images.iter().filter(of_split).map(|image| image.psnr).collect();
            psnr.iter().sum::<f64>() / psnr.len() as f64
        };
        assert!((mean.psnr - (of_scene(0) + of_scene(1)) / 2.0).abs() < 1e-12);
        assert!((scores.scenes[0].means[i].psnr - of_scene(0)).abs() < 1e-12);
    }
    assert_eq!(scores.means.iter().map(|mean| mean.images).sum::<usize>(), answers.len());
}

#[test]
fn perfect_scores_survive_json() {
    let (folder, benchmark) = benchmark();
    let perfect: Vec<(String, Vec<u8>)> = answers(&benchmark, false)
        .into_iter()
        .map(|(name, _)| {
            let (scene, image) = benchmark.find(&name).unwrap();
            let truth = benchmark.scenes[scene].images[image].read_truth().unwrap();
            (name, truth.png().unwrap())
        })
        .collect();
    let upload = file(folder.path(), "a.zip", &zip(&perfect));
    let submission = inspect(&upload, &benchmark, &Limits::default()).unwrap();
    assert_eq!(submission.splits, [Split::Easy, Split::Hard]);
    let scores = score(&submission, &benchmark, &Limits::default(), &mut go_on).unwrap();
    assert!(scores.means.iter().all(|mean| mean.psnr == f64::INFINITY && mean.ssim == 1.0));
    let text = serde_json::to_string(&scores).unwrap();
    assert!(text.contains("\"psnr\":null"));
    assert_eq!(serde_json::from_str::<Scores>(&text).unwrap(), scores);
}

#[test]
fn a_bad_image_is_no_score_but_a_refusal() {
    let (folder, benchmark) = benchmark();
    let mut answers = answers(&benchmark, false);
    let wide = Image { width: 2, height: 1, data: vec![9; 6] }.png().unwrap();
    (answers[1].1, answers[3].1) = (wide, b"GIF89a".to_vec());
    let upload = file(folder.path(), "a.zip", &zip(&answers));
    let submission = inspect(&upload, &benchmark, &Limits::default()).unwrap();
    match score(&submission, &benchmark, &Limits::default(), &mut go_on) {
        Err(ScoringError::Refused(refusal)) => {
            let told: Vec<(Option<&str>, String)> =
                refusal.problems.iter().map(|p| (p.entry.as_deref(), p.code.to_string())).collect();
            let name = |i: usize| Some(answers[i].0.as_str());
            assert_eq!(told, [(name(1), "wrong-size".to_owned()), (name(3), "not-png".to_owned())]);
        }
        other => panic!("{other:?}"),
    }
    let stop = &mut |progress: Progress| {
        if progress.done == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    assert!(matches!(score(&submission, &benchmark, &Limits::default(), stop), Err(ScoringError::Stopped)));
}

#[test]
fn validation_is_whole_or_absent() {
    let (folder, benchmark) = benchmark();
    let all = answers(&benchmark, true);
    let is_val = |name: &str| {
        let (scene, image) = benchmark.find(name).unwrap();
        benchmark.scenes[scene].images[image].split == Split::Val
    };
    let val: Vec<_> = all.iter().filter(|(name, _)| is_val(name)).cloned().collect();
    let upload = |entries: &[(String, Vec<u8>)]| file(folder.path(), "a.zip", &zip(entries));
    let submission = check(&upload(&val), &benchmark, &Limits::default(), &mut go_on).unwrap();
    assert_eq!(submission.splits, [Split::Val]);
    assert!(val.len() > 1);
    let partly: Vec<_> = all.iter().filter(|(name, _)| *name != val[0].0).cloned().collect();
    assert_eq!(codes(&upload(&partly), &benchmark), ["missing-image"]);
    assert_eq!(codes(&upload(&val[1..]), &benchmark), ["missing-image"]);
}

#[test]
fn error_maps_are_black_where_nothing_errs() {
    let (folder, benchmark) = benchmark();
    let answers = answers(&benchmark, true);
    let upload = file(folder.path(), "a.zip", &zip(&answers));
    let submission = inspect(&upload, &benchmark, &Limits::default()).unwrap();
    let map = error_map(&submission, &benchmark, &Limits::default(), 1).unwrap();
    assert_eq!((map.width, map.height), SIZE);
    // Every third byte is off by 5 or less in the second image, so some pixels are and some are not.
    let darkest = map.data.chunks(3).filter(|pixel| *pixel == [0, 0, 4]).count();
    assert!(darkest < map.data.len() / 3, "{darkest}");
    assert_eq!(map, error_map(&submission, &benchmark, &Limits::default(), 1).unwrap());
    assert!(error_map(&submission, &benchmark, &Limits::default(), 10_000).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Bytes changed, cut out, doubled or put in: a verdict, always.
    #[test]
    fn no_mutation_of_a_zip_escapes_a_verdict(
        mutations in prop::collection::vec((any::<prop::sample::Index>(), 0..6_u8, any::<u8>(), 1..40_usize), 1..6),
        near_the_end in any::<bool>(),
    ) {
        static VALID: std::sync::LazyLock<(tempfile::TempDir, Benchmark, Vec<u8>)> = std::sync::LazyLock::new(|| {
            let (folder, benchmark) = benchmark();
            let zip = zip(&answers(&benchmark, false));
            (folder, benchmark, zip)
        });
        let (folder, benchmark, valid) = &*VALID;
        let mut bytes = valid.clone();
        for (place, kind, value, length) in mutations {
            if bytes.is_empty() {
                break;
            }
            let range = if near_the_end { bytes.len().min(1500) } else { bytes.len() };
            let at = bytes.len() - 1 - place.index(range);
            let end = (at + length).min(bytes.len());
            match kind {
                0 => bytes[at] = value,
                1 => bytes[at] ^= 1 << (value % 8),
                2 => drop(bytes.drain(at..end)),
                3 => { let part = bytes[at..end].to_vec(); bytes.splice(at..at, part); }
                4 => bytes[at..end].fill(value),
                _ => bytes.truncate(at),
            }
        }
        let upload = file(folder.path(), "mutated.zip", &bytes);
        match check(&upload, benchmark, &Limits::default(), &mut go_on) {
            Ok(submission) => {
                // What is accepted can be scored.
                score(&submission, benchmark, &Limits::default(), &mut go_on).unwrap();
            }
            Err(SubmissionError::Refused(refusal)) => prop_assert!(!refusal.problems.is_empty()),
            Err(error) => prop_assert!(false, "{error}"),
        }
    }
}

#[test]
fn the_documentation_explains_every_code() {
    let text =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/submissions.md"))
            .unwrap();
    let source = include_str!("../src/submission/problem.rs");
    let list =
        &source[source.find("pub enum Code {").unwrap()..source.find("impl fmt::Display for Code").unwrap()];
    let variants: Vec<&str> = list
        .lines()
        .map(|line| line.trim().trim_end_matches(','))
        .filter(|line| !line.is_empty() && line.chars().all(char::is_alphanumeric))
        .collect();
    assert!(variants.len() > 35, "{variants:?}");
    for variant in variants {
        let mut code = String::new();
        for (i, c) in variant.chars().enumerate() {
            if i > 0 && c.is_uppercase() {
                code.push('-');
            }
            code.extend(c.to_lowercase());
        }
        assert!(text.contains(&format!("| `{code}` |")), "{code} is not explained");
    }
}
