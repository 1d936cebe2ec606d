//! Wrong input of every kind: an error that names the file and the mend, exit status 1 or 2, never a panic.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

mod common;

use std::fs;

use common::Workshop;
use relight_scene::Image;

#[test]
fn bad_arguments_end_with_status_2() {
    let shop = Workshop::new();
    for arguments in [
        "train",
        "train scene",
        "train scene --out run --model v9",
        "train scene --out run --preset medium",
        "train scene --out run --minutes -1",
        "train scene --out run --minutes nan",
        "train scene --out run --steps 0",
        "train scene --out run --bounds 1,2,3",
        "train scene --out run --bounds 0,0,0,1,1,-1",
        "train scene --out run --bounds 0,0,0,1,1,0",
        "train scene --out run --bounds 0,0,0,1,1,nan",
        "train scene --out run --bounds -1,-1,-1,1,1,1e39",
        "train scene --out run --device abacus",
        "--threads 0 compare a b",
        "--threads 100000 compare a b",
        "eval run --split best",
        "eval run --split train",
        "render run --out a.png",
        "render run --camera 0 --light 0 --out a.png --size 10",
        "render run --camera 0 --light 0 --out a.png --map normals",
        "render run --path orbit --fps 0 --out a",
        "render run --path orbit --frames 0 --out a",
        "render run --path orbit --out film.avi",
        "render run --camera 0 --light 0 --out a.jpg",
        "render run --camera 0 --light 1,2 --out a.png",
        "render run --camera 0 --light 1e300,0,0 --out a.png",
        "render run --camera 0 --light 0 --out a.png --samples 1",
        "render run --camera 0 --light 0 --size 16384x16384 --out a.png",
        "paint",
    ] {
        shop.fail(arguments, 2);
        assert!(!shop.path("run").exists(), "{arguments}: nothing is begun");
    }
}

#[test]
fn scenes_that_are_none_are_refused_by_name() {
    let shop = Workshop::new();
    fs::create_dir(shop.path("empty")).unwrap();
    fs::write(shop.path("file"), "not a folder").unwrap();
    for scene in ["empty", "file", "nowhere"] {
        for command in ["scene info", "scene check", "train --out run"] {
            let output = shop.run(&format!("{command} {scene}"));
            let said = [output.stdout, output.stderr].concat();
            let said = String::from_utf8(said).unwrap();
            assert_eq!(output.status.code(), Some(1), "{command} {scene}: {said}");
            assert!(said.contains(scene) && !said.contains("panicked"), "{command} {scene}: {said}");
        }
        assert!(!shop.path("run").exists());
    }
}

/// The name, in the scene, of the first image of a split.
fn first_image(shop: &Workshop, split: &str) -> String {
    shop.succeed("scene info scene");
    let text = fs::read_to_string(shop.path("scene/splits.json")).unwrap();
    let splits: serde_json::Value = serde_json::from_str(&text).unwrap();
    let [camera, light] = [0, 1].map(|i| splits[split][0][i].as_u64().unwrap());
    format!("lset{light:03}/data/{camera:05}_image.png")
}

/// Leaves half of an image, and hands over the whole.
fn damage(shop: &Workshop, image: &str) -> Vec<u8> {
    let path = shop.path("scene").join(image);
    let good = fs::read(&path).unwrap();
    fs::write(&path, &good[..good.len() / 2]).unwrap();
    good
}

#[test]
fn damaged_images_are_refused_by_whatever_reads_them() {
    let shop = Workshop::new();
    let train = "train scene --out run --recipe recipe.toml --steps 1";
    for split in ["train", "val", "easy", "hard"] {
        let image = first_image(&shop, split);
        let good = damage(&shop, &image);
        let check = shop.run("scene check scene");
        assert_eq!(check.status.code(), Some(1));
        assert!(String::from_utf8(check.stdout).unwrap().contains(&image));
        assert!(String::from_utf8(check.stderr).unwrap().contains(": 1 fault to mend"));
        let refused = |arguments: &str| assert!(shop.fail(arguments, 1).contains(&image), "{arguments}");
        match split {
            "train" => {
                refused(train);
                assert!(!shop.path("run").exists(), "nothing is left of what was not begun");
            }
            "val" => {
                refused(train);
                assert!(shop.path("run/config.toml").is_file());
                fs::remove_dir_all(shop.path("run")).unwrap();
            }
            _ => {
                shop.succeed(train);
                for other in ["val", "easy", "hard"] {
                    let eval = format!("eval run --split {other}");
                    if other == split { refused(&eval) } else { drop(shop.succeed(&eval)) }
                }
                fs::remove_dir_all(shop.path("run")).unwrap();
            }
        }
        fs::write(shop.path("scene").join(&image), good).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn runs_that_cannot_be_written_are_refused_before_images_are_read() {
    let shop = Workshop::new();
    damage(&shop, &first_image(&shop, "train"));
    // There is nowhere to make that folder.
    std::os::unix::fs::symlink("nowhere/run", shop.path("run")).unwrap();
    let said = shop.fail("train scene --out run --recipe recipe.toml --steps 1", 1);
    assert!(said.contains("run: is a link to what is not there"), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn scenes_that_a_run_could_not_name_are_refused_before_images_are_read() {
    use std::os::unix::ffi::OsStrExt;
    let shop = Workshop::new();
    damage(&shop, &first_image(&shop, "train"));
    let odd = std::ffi::OsStr::from_bytes(b"scene\xff");
    fs::rename(shop.path("scene"), shop.path("").join(odd)).unwrap();
    let output = shop.command("train --out run --steps 1").arg(odd).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("not UTF-8"), "{said}");
    assert!(!shop.path("run").exists());
}

#[test]
fn black_ground_truth_is_refused_with_the_reason() {
    let shop = Workshop::new();
    shop.train("run");
    let name = first_image(&shop, "easy");
    let black = Image { width: 24, height: 18, data: vec![0; 24 * 18 * 3] };
    black.write_png(&shop.path("scene").join(&name)).unwrap();
    let said = shop.fail("eval run --split easy --json", 1);
    assert!(said.contains(&name) && said.contains("black") && said.contains("--split val"), "{said}");
    assert!(shop.succeed("scene info scene").contains("black"));
    shop.succeed("eval run --split val");
}

#[test]
fn questions_that_make_no_sense_are_refused() {
    let shop = Workshop::new();
    shop.train("run");
    let light = "[1,0,0,0.1, 0,1,0,0.1, 0,0,1,0.4, 0,0,0,1]";
    for (question, reason) in [
        ("".to_owned(), "points"),
        ("[1, 2".to_owned(), "points"),
        (r#"{"points":[[0,0,0]],"directions":[]}"#.to_owned(), "directions"),
        (r#"{"points":[[0,0,0]],"directions":[[0,0,1]]}"#.to_owned(), "light"),
        (format!(r#"{{"points":[[0,0,1e999]],"directions":[[0,0,1]],"light":{light}}}"#), "questions"),
        (format!(r#"{{"points":[[0,0,0]],"directions":[[0,0,0]],"light":{light}}}"#), "direction 0"),
        (r#"{"points":[],"directions":[],"light":[1,2,3]}"#.to_owned(), "16 numbers"),
        (format!(r#"{{"points":[],"directions":[],"light":{light},"colour":1}}"#), "colour"),
        ("[".repeat(100_000), "questions"),
    ] {
        fs::write(shop.path("questions.json"), &question).unwrap();
        let said = shop.fail("query run questions.json --json", 1);
        assert!(said.contains("questions.json") && said.contains(reason), "{question:.80}: {said}");
    }
    assert!(shop.fail("query run nowhere.json --json", 1).contains("nowhere.json"));
}

#[test]
fn runs_that_are_none_or_damaged_are_refused_by_name() {
    let shop = Workshop::new();
    for command in ["eval", "export --weights a.safetensors", "render --camera 0 --light 0 --out a.png"] {
        assert!(shop.fail(&format!("{command} scene"), 1).contains("holds no run"));
    }
    shop.train("run");
    let weights = shop.path("run/weights.safetensors");
    let good = fs::read(&weights).unwrap();
    for (what, bytes) in
        [("cut", &good[..good.len() / 2]), ("empty", &[]), ("other", b"PK\x03\x04 something else")]
    {
        fs::write(&weights, bytes).unwrap();
        let said = shop.fail("eval run", 1);
        assert!(said.contains("weights.safetensors"), "{what}: {said}");
    }
    fs::remove_file(&weights).unwrap();
    assert!(shop.fail("eval run", 1).contains("--resume"));
    shop.succeed("train scene --out run --resume");
    shop.succeed("eval run");
    fs::write(&weights, &good).unwrap();

    // The splits must be those of the training.
    let splits = shop.path("scene/splits.json");
    let text = fs::read_to_string(&splits).unwrap();
    let mut changed: serde_json::Value = serde_json::from_str(&text).unwrap();
    changed["train"].as_array_mut().unwrap().pop();
    fs::write(&splits, changed.to_string()).unwrap();
    let said = shop.fail("eval run", 1);
    assert!(said.contains("splits"), "{said}");
    assert!(shop.fail("train scene --out run --resume", 1).contains("splits"));
    fs::remove_file(&splits).unwrap();

    // A scene that has moved is found again with --scene.
    fs::rename(shop.path("scene"), shop.path("moved")).unwrap();
    assert!(shop.fail("eval run", 1).contains("--scene"));
    shop.succeed("eval run --scene moved");
}

#[test]
fn recipes_that_make_no_sense_are_refused_by_setting() {
    let shop = Workshop::new();
    for (recipe, reason) in [
        ("rays-per-step = 0", "rays-per-step"),
        ("rays-per-stop = 10", "rays-per-stop"),
        (
            "rays-per-step = 1048576\nlights-per-ray = 1\nprobes-per-ray = 0\n[sampling.guided]\nsamples = 4096",
            "samples of a ray",
        ),
        ("learning-rate = 3", "learning-rate"),
        ("[grid]\nlevels = 99\nfeatures = 2\nlog2_table = 10\nbase = 4\nfinest = 16", "levels"),
        ("density-scale = -1.0", "density_scale"),
        ("[grid", "recipe.toml"),
    ] {
        fs::write(shop.path("recipe.toml"), recipe).unwrap();
        // There is no such scene: the recipe is looked at first.
        let said = shop.fail("train nowhere --out run --recipe recipe.toml --steps 1", 1);
        assert!(said.contains("recipe.toml") && said.contains(reason), "{recipe}: {said}");
        assert!(!shop.path("run").exists());
    }
    assert!(shop.fail("train scene --out run --device gpu --steps 1", 1).contains("--device cpu"));
    assert!(
        shop.fail("train scene --out run --precision bf16 --steps 1", 2).contains("possible values: f32")
    );
}

#[test]
fn boxes_that_the_scene_does_not_fit_are_refused() {
    let shop = Workshop::new();
    for (bounds, reason) in [
        ("-1e38,-1e38,-1e38,1e38,1e38,1e38", "too long"),
        ("0,0,0,1e-4,1e-4,1e-4", "too short"),
        ("-0.3,-0.3,0,0.3,0.3,1e-7", "too short"),
        ("20,20,20,21,21,21", "no camera sees"),
    ] {
        let said = shop.fail(&format!("train scene --out run --steps 1 --bounds {bounds}"), 1);
        assert!(said.contains("--bounds") && said.contains(reason), "{bounds}: {said}");
        assert!(!shop.path("run").exists());
    }
}

#[test]
fn what_cannot_end_well_is_not_begun() {
    let shop = Workshop::new();
    shop.train("run");
    fs::write(shop.path("file"), "something").unwrap();
    fs::create_dir(shop.path("full")).unwrap();
    fs::write(shop.path("full/file"), "something").unwrap();
    fs::create_dir(shop.path("full.png")).unwrap();
    // There is neither the scene nor the run: what is told was found before they were opened.
    for (arguments, reason) in [
        ("train nowhere --out file", "file: is a file"),
        ("demo --out file", "file: is a file"),
        ("train nowhere --out full", "full: is not empty"),
        ("train nowhere --out new --recipe none.toml", "none.toml: cannot be read"),
        ("train nowhere --out run --resume --model v3", "run: this run has model v5"),
        ("train nowhere --out run --resume --preset paper", "run: this run has preset fast"),
        ("eval nowhere --images file", "file: is a file; name a folder"),
        ("render nowhere --camera 0 --light 0 --out none/a.png", "there is no folder none; make it"),
        ("render nowhere --path orbit --out none/a.mp4", "there is no folder none; make it"),
        ("render nowhere --camera 0 --light 0 --out full.png", "full.png: is a folder"),
        ("export nowhere --weights none/w.safetensors", "there is no folder none; make it"),
        ("export nowhere --weights .", ".: is a folder"),
        ("scene sheet nowhere --out none/sheet.png", "there is no folder none; make it"),
    ] {
        let said = shop.fail(arguments, 1);
        assert!(said.contains(reason), "{arguments}: {said}");
    }
    assert!(!shop.path("none").exists() && !shop.path("new").exists());
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_not_waited_for() {
    let shop = Workshop::new();
    shop.train("run");
    let pipe = |path: &std::path::Path| {
        assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    };
    pipe(&shop.path("pipe"));
    for name in ["pipe", "/dev/zero"] {
        for arguments in [
            "query run FILE --json",
            "render run --camera FILE --light 0 --out a.png",
            "render run --path FILE --frames 2 --out a",
            "train scene --out new --recipe FILE",
            "compare FILE FILE",
        ] {
            let said = shop.fail(&arguments.replace("FILE", name), 1);
            assert!(said.contains(&format!("{name}: is not a file")), "{arguments}: {said}");
        }
    }
    for (file, arguments) in [
        ("guide.safetensors", "eval run"),
        ("checkpoint/latest.safetensors", "train scene --out run --resume"),
        ("lock", "train scene --out run --resume"),
        ("metrics.jsonl", "train scene --out run --resume"),
        ("weights.safetensors", "eval run"),
        ("config.toml", "eval run"),
    ] {
        let path = shop.path("run").join(file);
        let good = fs::read(&path).unwrap();
        fs::remove_file(&path).unwrap();
        pipe(&path);
        shop.fail(arguments, 1);
        fs::remove_file(&path).unwrap();
        fs::write(&path, good).unwrap();
    }
}

#[test]
fn pictures_that_cannot_be_compared_are_refused_by_name() {
    let shop = Workshop::new();
    let grey = |name: &str, width: u32| {
        let image = Image { width, height: 12, data: vec![100; width as usize * 36] };
        image.write_png(&shop.path(name)).unwrap();
    };
    grey("a.png", 12);
    grey("wide.png", 13);
    grey("narrow.png", 4);
    assert!(shop.fail("compare a.png wide.png --json", 1).contains("wide.png"));
    assert!(shop.fail("compare a.png nowhere.png --json", 1).contains("nowhere.png"));
    assert!(shop.fail("compare a.png recipe.toml", 1).contains("recipe.toml"));
    let small = shop.fail("compare narrow.png narrow.png", 1);
    assert!(small.contains("narrow.png: ") && small.contains("too small"), "{small}");
    Image { width: 12, height: 12, data: vec![0; 432] }.write_png(&shop.path("black.png")).unwrap();
    let black = shop.fail("compare black.png a.png", 1);
    assert!(black.contains("black.png: ") && black.contains("all black"), "{black}");
    let same = shop.json("compare a.png a.png --json");
    assert!(same["psnr"].is_null() && same["ssim"] == 1.0);
}
