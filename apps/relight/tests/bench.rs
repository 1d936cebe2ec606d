//! Tables from end to end: what the five files say, and that nothing stops them for good.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::Workshop;
use serde_json::Value;

const STEPS: &str = "--steps 20 --recipe recipe.toml";

fn read(shop: &Workshop, path: &str) -> String {
    fs::read_to_string(shop.path(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn json(shop: &Workshop, path: &str) -> Value {
    serde_json::from_str(&read(shop, path)).unwrap()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &to.join(entry.file_name()));
        } else {
            fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    }
}

/// Cells of the Markdown table's row that begins with `words`.
fn row(markdown: &str, heading: &str, words: &[&str]) -> Vec<String> {
    let (_, text) = markdown.split_once(heading).unwrap_or_else(|| panic!("no {heading} in\n{markdown}"));
    let cells =
        |line: &str| -> Vec<String> { line.split('|').map(|cell| cell.trim().replace('*', "")).collect() };
    let rows = text.lines().map(cells);
    let is_it = |row: &Vec<String>| row.len() > words.len() + 1 && row[1..=words.len()] == *words;
    rows.into_iter().find(is_it).unwrap_or_else(|| panic!("no {words:?} in\n{text}"))
}

#[test]
fn the_ablation_leaves_five_files_that_say_what_eval_says() {
    let shop = Workshop::new();
    let out = shop.succeed(&format!("bench ablation scene --out tables --models v1,v5 {STEPS}"));
    let markdown = read(&shop, "tables/ablation.md");
    assert_eq!(out.trim(), markdown.trim());
    let (tex, html) = (read(&shop, "tables/ablation.tex"), read(&shop, "tables/ablation.html"));
    let (csv, table) = (read(&shop, "tables/ablation.csv"), json(&shop, "tables/ablation.json"));
    for (place, (split, heading)) in
        [("val", "## Validation"), ("easy", "## Easy"), ("hard", "## Hard")].iter().enumerate()
    {
        for (model, name) in [("v1", "V1"), ("v5", "V5")] {
            let run = format!("tables/runs/scene-{model}-s0");
            let scores = shop.json(&format!("eval {run} --split {split} --json"));
            let [psnr, ssim] = ["psnr", "ssim"].map(|metric| scores[metric].as_f64().unwrap());
            let told = [format!("{psnr:.2}"), format!("{ssim:.3}")];
            assert_eq!(row(&markdown, heading, &[name])[7..9], told, "{split} {model}");
            let entry = &table["tables"][place]["rows"]
                .as_array()
                .unwrap()
                .iter()
                .find(|r| r["stubs"][0] == name)
                .unwrap()["entries"][0];
            assert_eq!(
                (entry["psnr"]["mean"].as_f64(), entry["ssim"]["mean"].as_f64()),
                (Some(psnr), Some(ssim))
            );
            assert_eq!(entry["runs"], serde_json::json!([format!("scene-{model}-s0")]));
            assert!(csv.contains(&format!("scene,{model},run,{split},{psnr},{ssim},")), "{csv}");
            for text in [&tex, &html] {
                assert!(told.iter().all(|number| text.contains(number.as_str())), "{told:?} in {text}");
            }
            let baseline = &scores["baselines"]["nearest-light"];
            let told = format!("{:.2}", baseline["psnr"].as_f64().unwrap());
            assert_eq!(row(&markdown, heading, &["Nearest light"])[7], told);
        }
    }
    // What each number is made of.
    let record = &table["records"][1];
    assert_eq!((&record["config"]["seed"], &record["config"]["budget"]["steps"]), (&0.into(), &20.into()));
    assert_eq!(record["config"]["recipe"]["rays-per-step"], 32);
    assert!(record["made"]["device"].as_str().unwrap().starts_with("cpu"), "{record}");
    assert!(!record["made"]["commit"].as_str().unwrap().is_empty());
    assert!(markdown.contains("preset fast, changed, 20 steps, seed 0, by relight"), "{markdown}");
    assert!(html.contains("title=\"scene-v5-s0: v5, seed 0, preset fast, 20 steps, cpu"));
    // Photograph, prediction and error of both, and the visibility of V5.
    assert_eq!(html.matches("<img ").count(), 7);
    assert_eq!(html.matches("V1 has no visibility").count(), 1);
    assert!(!markdown.contains(", published"), "nobody published this scene");
    assert!(tex.contains("\\begin{tabular}{llllllrr}"));
}

#[test]
fn a_benchmark_of_several_seeds_has_means_and_deviations_and_trains_only_what_is_new() {
    let shop = Workshop::new();
    copy(&shop.path("scene"), &shop.path("other"));
    let command = format!("bench benchmark scene other --out tables {STEPS}");
    shop.succeed(&command);
    let markdown = read(&shop, "tables/benchmark.md");
    let one = row(&markdown, "# Benchmark", &["scene", "V5"]);
    // The same photographs under another name.
    assert_eq!(one[3..], row(&markdown, "# Benchmark", &["other", "V5"])[3..]);
    assert_eq!(one[3..], row(&markdown, "# Benchmark", &["Mean", "V5"])[3..]);
    let stamp = |run: &str| fs::metadata(shop.path(run)).unwrap().modified().unwrap();
    let kept = "tables/runs/scene-v5-s0/weights.safetensors";
    let before = stamp(kept);
    shop.succeed(&format!("{command} --seeds 0,1"));
    assert_eq!(stamp(kept), before, "trained once");
    let psnr = |seed: u32| {
        let record = json(&shop, &format!("tables/runs/scene-v5-s{seed}/result.json"));
        record["splits"][2]["outcome"]["scored"]["psnr"].as_f64().unwrap()
    };
    let (a, b) = (psnr(0), psnr(1));
    let told = format!("{:.2} ± {:.2}", (a + b) / 2.0, (a - b).abs() / 2f64.sqrt());
    assert_eq!(row(&read(&shop, "tables/benchmark.md"), "# Benchmark", &["scene", "V5"])[7], told);
    // Both tables can be made of the same runs.
    shop.succeed(&format!("bench ablation scene other --out tables --models v5 {STEPS}"));
    assert_eq!(stamp(kept), before);
    assert_eq!(json(&shop, "tables/jobs.json")["jobs"].as_array().unwrap().len(), 4);
}

#[test]
fn a_scene_that_cannot_be_read_stops_no_other() {
    let shop = Workshop::new();
    copy(&shop.path("scene"), &shop.path("broken"));
    fs::write(shop.path("broken/lset000/camera.yml"), "nothing of the kind").unwrap();
    let said = shop.fail(&format!("bench benchmark broken nowhere scene --out tables {STEPS}"), 1);
    assert!(said.contains("2 of 3 runs failed") && said.contains("camera.yml"), "{said}");
    let markdown = read(&shop, "tables/benchmark.md");
    assert_eq!(row(&markdown, "# Benchmark", &["broken", "V5"])[3..5], ["–", "–"]);
    assert!(row(&markdown, "# Benchmark", &["scene", "V5"])[3].parse::<f64>().is_ok());
    assert!(
        markdown.contains("broken-v5-s0 failed") && markdown.contains("nowhere-v5-s0 failed"),
        "{markdown}"
    );
}

#[test]
fn a_training_that_fails_stops_no_other() {
    let shop = Workshop::new();
    shop.succeed(&format!("bench benchmark scene --out tables --models v4 {STEPS}"));
    fs::create_dir_all(shop.path("tables/runs/scene-v5-s0")).unwrap();
    fs::write(shop.path("tables/runs/scene-v5-s0/mine.txt"), "not a run").unwrap();
    let said = shop.fail(&format!("bench benchmark scene --out tables --models v5,v3 {STEPS}"), 1);
    assert!(said.contains("1 of 2 runs failed") && said.contains("scene-v5-s0: is not empty"), "{said}");
    let markdown = read(&shop, "tables/benchmark.md");
    assert!(row(&markdown, "# Benchmark", &["scene", "V3"])[3].parse::<f64>().is_ok());
    fs::remove_file(shop.path("tables/runs/scene-v5-s0/mine.txt")).unwrap();
    shop.succeed(&format!("bench benchmark scene --out tables --models v5,v3 {STEPS}"));
}

#[test]
fn a_loss_that_is_not_finite_is_told_in_the_table_and_stops_no_other() {
    let shop = Workshop::new();
    let recipe = format!("learning-rate = {{ constant = 1e30 }}\n{}", common::TINY);
    fs::write(shop.path("recipe.toml"), recipe).unwrap();
    let said = shop.fail(&format!("bench benchmark scene --out tables --models v5,v3 --jobs 1 {STEPS}"), 1);
    assert!(said.contains("2 of 2 runs failed"), "{said}");
    let markdown = read(&shop, "tables/benchmark.md");
    for model in ["v5", "v3"] {
        assert_eq!(row(&markdown, "# Benchmark", &["scene", &model.to_uppercase()])[3..9], ["–"; 6]);
        let why = markdown.lines().find(|line| line.contains(&format!("scene-{model}-s0 failed")));
        assert!(why.is_some_and(|why| why.contains("is not finite")), "{markdown}");
    }
    assert!(read(&shop, "tables/benchmark.html").contains("is not finite"));
}

#[test]
fn a_test_image_that_cannot_be_read_is_told_and_costs_no_training() {
    let shop = Workshop::new();
    shop.train("run");
    let images = shop.json("eval run --split easy --json")["images"].clone();
    let [camera, light] = ["camera", "light"].map(|key| images[0][key].as_u64().unwrap());
    let path = shop.path(&format!("scene/lset{light:03}/data/{camera:05}_image.png"));
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let command = format!("bench benchmark scene --out tables {STEPS}");
    let said = shop.fail(&command, 1);
    assert!(
        said.contains("1 of 1 runs failed") && said.contains(&format!("{camera:05}_image.png")),
        "{said}"
    );
    let weights = shop.path("tables/runs/scene-v5-s0/weights.safetensors");
    let metrics = shop.path("tables/runs/scene-v5-s0/metrics.jsonl");
    let before = [fs::read(&weights).unwrap(), fs::read(&metrics).unwrap()];
    fs::write(&path, &whole).unwrap();
    shop.succeed(&command);
    assert!(
        [fs::read(&weights).unwrap(), fs::read(&metrics).unwrap()] == before,
        "scored, not trained again"
    );
}

#[test]
fn black_test_images_are_never_scored() {
    let shop = Workshop::new();
    shop.train("run");
    for split in ["easy", "hard"] {
        for image in shop.json(&format!("eval run --split {split} --json"))["images"].as_array().unwrap() {
            let [camera, light] = ["camera", "light"].map(|key| image[key].as_u64().unwrap());
            let path = shop.path(&format!("scene/lset{light:03}/data/{camera:05}_image.png"));
            let black = relight_scene::Image { width: 24, height: 18, data: vec![0; 3 * 24 * 18] };
            black.write_png(&path).unwrap();
        }
    }
    shop.succeed(&format!("bench benchmark scene --out tables {STEPS}"));
    let markdown = read(&shop, "tables/benchmark.md");
    let row = row(&markdown, "# Benchmark", &["scene", "V5"]);
    assert!(row[3].parse::<f64>().is_ok());
    assert_eq!(row[5..9], ["–", "–", "–", "–"]);
    assert!(markdown.contains("Not scored: scene (easy and hard)"), "{markdown}");
    let images =
        |split| json(&shop, "tables/runs/scene-v5-s0/result.json")["splits"][split]["outcome"].clone();
    assert!(
        images(0)["scored"].is_object()
            && images(1)["skipped"].is_string()
            && images(2)["skipped"].is_string()
    );
}

#[test]
fn what_cannot_be_is_refused_before_any_work() {
    let shop = Workshop::new();
    shop.fail("bench ablation --out tables", 2);
    shop.fail("bench ablation scene", 2);
    shop.fail("bench ablation scene --out tables --models v9", 2);
    shop.fail("bench ablation scene --out tables --minutes 0", 2);
    assert!(shop.fail("bench ablation scene scene --out tables", 1).contains("named twice"));
    assert!(shop.fail("bench ablation scene --out recipe.toml", 1).contains("is a file"));
    assert!(!shop.path("tables").exists());
    shop.succeed(&format!("bench benchmark scene --out tables {STEPS}"));
    let said = shop.fail("bench benchmark scene --out tables --steps 30 --recipe recipe.toml", 1);
    assert!(
        said.contains(
            "other settings (preset fast, changed, 20 steps, and now preset fast, changed, 30 steps)"
        ),
        "{said}"
    );
    fs::remove_file(shop.path("tables/jobs.json")).unwrap();
    let said = shop.fail("bench benchmark scene --out tables --steps 30 --recipe recipe.toml", 1);
    assert!(said.contains("scene-v5-s0: was trained with other settings (steps or minutes)"), "{said}");
}

#[cfg(unix)]
mod stopping {
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};

    use super::*;

    /// Two models for 300 steps.
    const LONG: &str = "--models v1,v5 --steps 300 --recipe recipe.toml";

    /// Starts a command, and sends it `signal` once `awaited` is there.
    fn signalled(
        shop: &Workshop,
        arguments: &str,
        awaited: &[PathBuf],
        signal: &str,
    ) -> (Option<i32>, String) {
        let mut child = shop.command(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let patience = Instant::now();
        while !awaited.iter().all(|path| path.exists()) {
            assert!(patience.elapsed() < Duration::from_secs(120), "no {awaited:?}");
            std::thread::sleep(Duration::from_millis(2));
        }
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let mut said = String::new();
        std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut said).unwrap();
        (child.wait().unwrap().code(), said)
    }

    /// The first job is done, the second half trained.
    fn halfway(shop: &Workshop) -> [PathBuf; 2] {
        ["scene-v1-s0/result.json", "scene-v5-s0/checkpoint/latest.safetensors"]
            .map(|path| shop.path("stopped/runs").join(path))
    }

    /// JSON without the times that trainings took.
    fn timeless(mut value: Value) -> Value {
        for record in value["records"].as_array_mut().unwrap() {
            assert!(record["made"].as_object_mut().unwrap().remove("seconds").is_some());
        }
        value
    }

    fn csv_timeless(text: &str) -> Vec<String> {
        let without = |line: &str| {
            line.split(',')
                .enumerate()
                .filter(|(i, _)| *i != 12)
                .map(|(_, f)| f)
                .collect::<Vec<_>>()
                .join(",")
        };
        text.lines().map(without).collect()
    }

    fn resumed_equals_whole(shop: &Workshop) {
        shop.succeed(&format!("bench ablation scene --out stopped {LONG} --jobs 1"));
        shop.succeed(&format!("bench ablation scene --out whole {LONG} --jobs 1"));
        for file in ["ablation.md", "ablation.tex"] {
            assert_eq!(read(shop, &format!("stopped/{file}")), read(shop, &format!("whole/{file}")));
        }
        let [stopped, whole] =
            ["stopped", "whole"].map(|out| timeless(json(shop, &format!("{out}/ablation.json"))));
        assert!(stopped == whole, "{stopped}\n{whole}");
        let [stopped, whole] =
            ["stopped", "whole"].map(|out| csv_timeless(&read(shop, &format!("{out}/ablation.csv"))));
        assert_eq!(stopped, whole);
        let picture = |out: &str| fs::read(shop.path(out).join("runs/scene-v5-s0/prediction.png")).unwrap();
        assert!(picture("stopped") == picture("whole"));
    }

    #[test]
    fn after_a_kill_the_same_command_ends_in_the_same_tables() {
        let shop = Workshop::new();
        let command = format!("bench ablation scene --out stopped {LONG} --jobs 1");
        let (status, _) = signalled(&shop, &command, &halfway(&shop), "-KILL");
        assert_eq!(status, None, "it was killed before its end");
        let so_far = read(&shop, "stopped/ablation.md");
        assert!(
            so_far.contains("1 of 2 runs are done") && row(&so_far, "## Hard", &["V5"])[7] == "–",
            "{so_far}"
        );
        assert!(row(&so_far, "## Hard", &["V1"])[7].parse::<f64>().is_ok());
        resumed_equals_whole(&shop);
    }

    #[test]
    fn ctrl_c_stops_cleanly_and_the_same_command_goes_on() {
        let shop = Workshop::new();
        let command = format!("bench ablation scene --out stopped {LONG} --jobs 1");
        let (status, said) = signalled(&shop, &command, &halfway(&shop), "-INT");
        assert_eq!(status, Some(1), "{said}");
        assert!(said.contains("stopped with 1 of 2 runs done; the same command goes on"), "{said}");
        resumed_equals_whole(&shop);
    }
}

#[test]
fn side_by_side_the_tables_are_the_same() {
    let shop = Workshop::new();
    let command =
        |out: &str, jobs: u32| format!("bench ablation scene --out {out} {STEPS} --jobs {jobs} --threads 2");
    shop.succeed(&command("alone", 1));
    shop.succeed(&command("together", 3));
    let scores = |out: &str| {
        let table = json(&shop, &format!("{out}/ablation.json"));
        assert_eq!(table["records"].as_array().unwrap().len(), 6);
        table["tables"].clone()
    };
    assert_eq!(scores("alone"), scores("together"));
}
