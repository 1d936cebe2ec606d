//! The command line that scripts rely on: arguments, JSON, files, exit status.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

mod common;

use std::fs;

use common::{Workshop, lines, metrics};
use relight_field::weights_file;
use relight_scene::{Frame, Scene, read_image};

#[test]
fn training_reports_json_lines_and_leaves_a_run() {
    let shop = Workshop::new();
    let out = shop.succeed("train scene --out run --recipe recipe.toml --steps 20 --seed 3 --json");
    let reports = lines(&out);
    assert_eq!(reports, metrics(&shop.path("run")), "metrics.jsonl holds the same lines");
    let steps: Vec<u64> = reports.iter().map(|r| r["step"].as_u64().unwrap()).collect();
    assert_eq!(steps, [5, 10, 15, 20]);
    for report in &reports {
        let step = report["step"].as_u64().unwrap();
        assert_eq!(report["rays"], 32 * step);
        assert_eq!(report["pixels"], 64 * step);
        assert!(report["loss"].as_f64().unwrap() > 0.0);
        let validated = step.is_multiple_of(10);
        assert_eq!((report["psnr"].is_f64(), report["ssim"].is_f64()), (validated, validated));
    }
    let config = fs::read_to_string(shop.path("run/config.toml")).unwrap();
    for setting in ["format = \"relight-run-1\"", "model = \"v5\"", "seed = 3", "rays-per-step = 32"] {
        assert!(config.contains(setting), "{setting}\n{config}");
    }
    weights_file::load(&shop.path("run/weights.safetensors")).unwrap();
    let preview = read_image(&shop.path("run/previews/00000010.png")).unwrap();
    assert_eq!((preview.width, preview.height), (48, 18));
}

#[test]
fn the_same_seed_gives_the_same_run_whatever_the_threads() {
    let shop = Workshop::new();
    let run = |name: &str, options: &str| {
        shop.succeed(&format!("train scene --out {name} --recipe recipe.toml --steps 20 {options}"));
        (metrics(&shop.path(name)), weights_file::load(&shop.path(name).join("weights.safetensors")).unwrap())
    };
    let one = run("one", "--threads 1");
    assert!(one == run("three", "--threads 3"));
    assert!(one != run("other", "--seed 1"));
}

#[test]
fn every_model_trains_and_answers() {
    let shop = Workshop::new();
    let light = "[1,0,0,0.1, 0,1,0,0.1, 0,0,1,0.4, 0,0,0,1]";
    let question =
        format!(r#"{{"points":[[0,0,0.05],[9,9,9]],"directions":[[0,0,-1],[0,3,0]],"light":{light}}}"#);
    fs::write(shop.path("points.json"), question).unwrap();
    for model in ["v0", "v1", "v2", "v3", "v4", "v5"] {
        shop.succeed(&format!("train scene --out {model} --model {model} --recipe recipe.toml --steps 3 --bounds -0.4,-0.4,-0.1,0.4,0.4,0.5"));
        let answer = shop.json(&format!("query {model} points.json --json"));
        assert!(answer["density"][0].as_f64().unwrap() > 0.0);
        assert_eq!(answer["density"][1], 0.0, "outside the box there is nothing");
        let rgb = answer["rgb"][0].as_array().unwrap();
        assert!(rgb.len() == 3 && rgb.iter().all(|c| (0.0..=1.0).contains(&c.as_f64().unwrap())));
        assert_eq!(answer["visibility"].is_null(), model != "v5");
        let scores = shop.json(&format!("eval {model} --json"));
        assert_eq!(scores["model"], model);
    }
}

#[test]
fn evaluation_scores_each_image_with_the_baselines_beside() {
    let shop = Workshop::new();
    shop.train("run");
    let scores = shop.json("eval run --split easy --images pictures --json");
    assert_eq!(
        (&scores["scene"], &scores["model"], &scores["split"]),
        (&"scene".into(), &"v5".into(), &"easy".into())
    );
    let images = scores["images"].as_array().unwrap();
    let mean = images.iter().map(|i| i["psnr"].as_f64().unwrap()).sum::<f64>() / images.len() as f64;
    assert!((scores["psnr"].as_f64().unwrap() - mean).abs() < 1e-9);
    for baseline in ["mean-image", "nearest-light"] {
        let psnr = scores["baselines"][baseline]["psnr"].as_f64().unwrap();
        assert!((5.0..40.0).contains(&psnr), "{baseline}: {psnr}");
        assert!(scores["baselines"][baseline]["ssim"].is_f64());
    }
    // The pictures are those that were scored.
    let image = &images[0];
    let (camera, light) = (image["camera"].as_u64().unwrap(), image["light"].as_u64().unwrap());
    let comparison = shop.json(&format!(
        "compare scene/lset{light:03}/data/{camera:05}_image.png pictures/scene_{light:02}_{camera:02}.png --json"
    ));
    assert!((comparison["psnr"].as_f64().unwrap() - image["psnr"].as_f64().unwrap()).abs() < 1e-9);
    assert!((comparison["ssim"].as_f64().unwrap() - image["ssim"].as_f64().unwrap()).abs() < 1e-9);
    assert!(comparison["ssim_uniform7"].is_f64());
    assert!(shop.succeed("eval run").contains("nearest-light"));
    let coarse = shop.json("eval run --split easy --samples 2 --json");
    assert_ne!(coarse["psnr"], scores["psnr"]);
    assert_eq!(coarse["baselines"], scores["baselines"]);
}

#[test]
fn pictures_maps_and_films_are_rendered() {
    let shop = Workshop::new();
    shop.train("run");
    shop.succeed("render run --camera 2 --light 1 --out a.png");
    let own = read_image(&shop.path("a.png")).unwrap();
    assert_eq!((own.width, own.height), (24, 18));
    shop.succeed("render run --camera 2 --light -0.1,0.2,0.3 --size 30x20 --out b.png");
    assert_eq!(read_image(&shop.path("b.png")).unwrap().width, 30);
    shop.succeed("render run --camera scene/lset000/data/00002_pose.txt --light 1 --out c.png");
    assert_eq!(read_image(&shop.path("c.png")).unwrap(), own, "the same pose by file");
    for map in ["visibility", "reflectance", "depth", "opacity"] {
        shop.succeed(&format!("render run --camera 0 --light 0 --map {map} --out {map}.png"));
        shop.succeed(&format!("render run --camera 0 --light 0 --map {map} --out {map}.exr"));
        assert!(fs::read(shop.path(&format!("{map}.exr"))).unwrap().starts_with(&[0x76, 0x2f, 0x31, 0x01]));
    }
    for path in ["orbit", "lights"] {
        shop.succeed(&format!("render run --path {path} --frames 3 --out {path}"));
        assert!(shop.path(path).join("00002.png").is_file());
    }
    // A film may be drawn again in its folder, but in no other that holds something.
    shop.succeed("render run --path orbit --frames 2 --out lights");
    assert!(!shop.path("lights/00002.png").exists());
    let said = shop.fail("render run --path orbit --frames 2 --out scene", 1);
    assert!(said.contains("scene: is not empty and holds no film"), "{said}");
    shop.succeed("render run --path lights --frames 3 --fps 5 --out film.mp4");
    assert_eq!(&fs::read(shop.path("film.mp4")).unwrap()[4..8], b"ftyp");
}

/// Writes the scene as `flat/transforms.json`, where lights have positions alone.
fn flatten(shop: &Workshop) -> Scene {
    let scene = Scene::open(&shop.path("scene")).unwrap();
    let lens = &scene.cameras[0].intrinsics;
    let frame = |frame: &Frame| {
        // OpenGL's camera axes.
        let rows = scene.cameras[frame.camera].pose.0.map(|[x, y, z, t]| [x, -y, -z, t]);
        serde_json::json!({
            "file_path": frame.path,
            "transform_matrix": rows,
            "pl_pos": scene.lights[frame.light].pose.position(),
        })
    };
    let file = serde_json::json!({
        "w": lens.width, "h": lens.height, "fl_x": lens.fx, "fl_y": lens.fy,
        "frames": scene.frames.iter().map(frame).collect::<Vec<_>>(),
    });
    fs::create_dir(shop.path("flat")).unwrap();
    fs::write(shop.path("flat/transforms.json"), file.to_string()).unwrap();
    Scene::open(&shop.path("flat")).unwrap()
}

#[test]
fn a_light_is_the_same_by_number_and_by_position() {
    let shop = Workshop::new();
    let scene = flatten(&shop);
    // The model that is told how a light is turned, too.
    shop.succeed("train flat --out run --model v1 --recipe recipe.toml --steps 60");
    let draw = |light: &str| {
        shop.succeed(&format!("render run --camera 2 --light {light} --out a.png"));
        read_image(&shop.path("a.png")).unwrap()
    };
    let by_number = draw("1");
    let [x, y, z] = scene.lights[1].pose.position();
    assert_eq!(draw(&format!("{x},{y},{z}")), by_number);
    assert_ne!(draw("2"), by_number);
}

#[test]
fn a_run_scores_what_its_last_validation_said() {
    let shop = Workshop::new();
    shop.train("run");
    let best = metrics(&shop.path("run")).iter().filter_map(|r| r["psnr"].as_f64()).fold(0.0, f64::max);
    let scored = shop.json("eval run --split val --json")["psnr"].as_f64().unwrap();
    // Tiny splits are validated in full, and the engine that scores knows what the one that trained knew.
    assert!((scored - best).abs() < 1e-9, "{scored} dB against {best} dB");
}

#[test]
fn exported_weights_are_those_of_the_run() {
    let shop = Workshop::new();
    shop.train("run");
    shop.succeed("export run --weights out.safetensors");
    let exported = weights_file::load(&shop.path("out.safetensors")).unwrap();
    assert!(exported == weights_file::load(&shop.path("run/weights.safetensors")).unwrap());

    // Weights of another model than the configuration tells are never scored as that model's.
    let config = fs::read_to_string(shop.path("run/config.toml")).unwrap();
    fs::write(shop.path("run/config.toml"), config.replace("model = \"v5\"", "model = \"v1\"")).unwrap();
    for command in ["eval run", "export run --weights other.safetensors"] {
        assert!(shop.fail(command, 1).contains("weights.safetensors: is not of the model v1"), "{command}");
    }
}

#[test]
fn a_profile_tells_where_the_time_of_a_step_goes() {
    let shop = Workshop::new();
    let table = shop.json("profile scene --recipe recipe.toml --steps 20 --json");
    let stages = table["stages"].as_array().unwrap();
    let named = |name: &str| stages.iter().find(|stage| stage["stage"] == name).unwrap();
    let encode = named("encode");
    // 32 rays of 8 samples, 4 levels of 8 corners; more rays where views have fewer lights.
    assert_eq!(encode["lookups"].as_f64().unwrap(), f64::from(32 * 8 * 4 * 8));
    assert_eq!(encode["limit"][0], "lookups");
    for name in ["draw rays", "march", "geometry", "composite", "scatter", "optimise grid"] {
        assert!(named(name)["share_of_step"].is_f64(), "{name}");
    }
    let said = shop.succeed("profile scene --model v0 --recipe recipe.toml --steps 4");
    assert!(said.contains("GFLOP/s") && said.contains("scatter") && !said.contains("shadow"), "{said}");
}

#[test]
fn scenes_are_described_checked_and_shown() {
    let shop = Workshop::new();
    let info = shop.json("scene info scene --json");
    assert_eq!((&info["views"], &info["lights"], &info["images"]), (&8.into(), &6.into(), &48.into()));
    assert!(shop.succeed("scene info scene").contains("8 views"));
    shop.succeed("scene check scene");
    shop.succeed("scene sheet scene --out sheet.png");
    assert!(read_image(&shop.path("sheet.png")).unwrap().width > 400);
}

#[test]
fn what_may_be_wrong_with_a_scene_is_told_by_its_check_and_its_training_alone() {
    let shop = Workshop::new();
    for file in ["image.png", "pose.txt"] {
        fs::remove_file(shop.path(&format!("scene/lset001/data/00003_{file}"))).unwrap();
    }
    // It may name the frame that is missing.
    fs::remove_file(shop.path("scene/splits.json")).unwrap();
    let tells = |arguments: &str| {
        let output = shop.run(arguments);
        assert!(output.status.success(), "{arguments}");
        let said = [output.stdout, output.stderr].concat();
        String::from_utf8(said).unwrap().contains("the scene's view 3 is missing here")
    };
    assert!(tells("scene check scene"));
    assert!(tells("train scene --out run --recipe recipe.toml --steps 1"));
    for quiet in ["scene info scene", "eval run", "render run --camera 0 --light 0 --out a.png"] {
        assert!(!tells(quiet), "{quiet}");
    }
}

#[test]
fn the_help_teaches() {
    let shop = Workshop::new();
    // Each command's is looked at beside the commands themselves.
    assert!(shop.succeed("--help").contains("Start here"));
    assert!(shop.succeed("train --help").contains("Examples:\n  relight train SCENE"));
    for command in ["train", "profile", "bench ablation"] {
        let help = shop.succeed(&format!("{command} --help"));
        assert!(help.contains("[possible values: fast, paper]"), "{help}");
    }
    // Whatever is wrong with a command's arguments, its own usage is told.
    for arguments in
        ["--camera 0 --light 0 --out a.jpg", "--path orbit --out a.avi", "--camera 0 --out a.png"]
    {
        let said = shop.fail(&format!("render run {arguments}"), 2);
        assert!(said.contains("Usage: relight render"), "{arguments}: {said}");
    }
    let said = shop.fail("--threads 100000 compare a.png b.png", 2);
    assert!(said.contains("--threads") && said.contains("1..=1024"), "{said}");
}

#[test]
fn a_run_is_repeated_from_its_configuration() {
    let shop = Workshop::new();
    shop.succeed("train scene --out first --recipe recipe.toml --model v3 --seed 7 --steps 20");
    fs::create_dir(shop.path("again")).unwrap();
    fs::copy(shop.path("first/config.toml"), shop.path("again/config.toml")).unwrap();
    shop.succeed("train scene --out again --resume");
    assert_eq!(metrics(&shop.path("again")), metrics(&shop.path("first")));
    let weights = |run: &str| fs::read(shop.path(run).join("weights.safetensors")).unwrap();
    assert!(weights("again") == weights("first"));
}

#[test]
fn a_finished_run_is_only_lengthened() {
    let shop = Workshop::new();
    shop.train("first");
    let again = shop.run("train scene --out first --steps 20");
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8(again.stderr).unwrap().contains("--resume"));
    // A finished run that is resumed is still finished, and stays what it is; with more steps it goes on.
    shop.succeed("train scene --out first --resume");
    let config = fs::read(shop.path("first/config.toml")).unwrap();
    for less in ["--steps 1", "--minutes 1e-9"] {
        let said = shop.fail(&format!("train nowhere --out first --resume {less}"), 1);
        assert!(said.contains("first: 20 steps in") && said.contains("are done already"), "{said}");
    }
    assert_eq!(fs::read(shop.path("first/config.toml")).unwrap(), config);
    assert_eq!(metrics(&shop.path("first")).last().unwrap()["step"], 20);
    shop.succeed("train scene --out first --resume --steps 30");
    assert_eq!(metrics(&shop.path("first")).last().unwrap()["step"], 30);
    assert!(shop.fail("train scene --out first --resume --seed 9", 1).contains("seed"));
    // There is nothing to resume: it starts.
    shop.succeed("train scene --out fresh --resume --steps 2 --model v0");
}
