//! Admins' commands beside a running server; backups.

use std::fs;
use std::ops::ControlFlow;
use std::process::Command;

use relight_metrics::psnr;
use relight_scene::{Scene, Split, Splits};
use relight_train::baselines::{NearestLight, mean_image};
use serde_json::Value;

use crate::board::{Board, Server};

#[test]
fn admins_change_a_running_server() {
    let board = Board::new();
    let server = board.start();
    assert_eq!(server.get("/api/v1/benchmarks/more", None).status, 404);
    board.admin(&["add-benchmark", "more", board.path("scenes/box").to_str().unwrap()]);
    let told = server.get("/api/v1/benchmarks/more", None).json();
    assert_eq!(told["scenes"][0]["name"], "box");
    board.admin(&["quotas", "more", "--phase", "val", "--per-day", "3", "--gap", "60"]);
    let told = server.get("/api/v1/benchmarks/more", None).json();
    assert_eq!(
        (&told["quotas"]["val"]["per_day"], &told["quotas"]["val"]["gap_seconds"]),
        (&3.into(), &60.into())
    );
    board.admin(&["close", "tiny"]);
    let answer = server.upload("", &board.token, b"x");
    assert_eq!(answer.status, 403);
    board.admin(&["open", "tiny"]);
    board.admin(&["grant-admin", "ada"]);
    assert!(board.admin(&["users"]).ends_with(", admin"));
    board.admin(&["revoke-admin", "ada"]);
    assert!(!board.admin(&["users"]).contains(", admin"));
    board.admin(&["block", "ada"]);
    assert_eq!(server.upload("", &board.token, b"x").status, 401);
    board.admin(&["approve", "ada"]);
    let other = board.admin(&["add-token", "ada"]);
    let id = server.submit("", &other, &board.zip(1, false));
    server.verdict(&id, &board.token);
    board.admin(&["pin", &id]);
    let list: Value = serde_json::from_str(&board.admin(&["list", "--json"])).unwrap();
    assert_eq!(list["submissions"][0]["pinned"], true);
    assert!(board.admin(&["list"]).contains(" pinned"));
    board.admin(&["withdraw", &id]);
    assert_eq!(server.get(&format!("/api/v1/submissions/{id}"), None).status, 404);
    let audit = board.admin(&["audit", "--json"]);
    let actions: Vec<String> = audit
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["action"].as_str().unwrap().to_owned())
        .collect();
    let newest = ["withdraw", "pin", "scored", "submit", "add-token", "user-status", "user-status"];
    assert_eq!(actions[..newest.len()], newest);
    // Faults of the command line are told, and change nothing.
    for (arguments, says) in [
        (&["hide", "none"][..], "there is no submission \"none\""),
        (&["add-user", "ada", "x@example.org"], "is taken"),
        (&["add-benchmark", "tiny", board.path("scenes").to_str().unwrap()], "is taken"),
        (&["add-benchmark", "Ti/ny", board.path("scenes").to_str().unwrap()], "cannot be a benchmark's name"),
        (&["add-benchmark", "void", board.path("data").to_str().unwrap()], "holds no scene"),
    ] {
        let output = board.try_admin(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {stderr}");
        assert!(stderr.contains(says), "{arguments:?}: {stderr}");
    }
    assert_eq!(board.admin(&["audit", "--json"]), audit);
}

#[test]
fn a_backup_taken_from_a_running_server_is_a_server_again() {
    let board = Board::new();
    let server = board.start();
    let id = server.submit("", &board.token, &board.zip(1, true));
    let before = server.verdict(&id, &board.token);
    let file = board.path("board.tar");
    let name = file.to_str().unwrap();
    board.admin(&["backup", name]);
    let key = server.get("/api/v1/receipt-key", None).json();
    drop(server);
    // Not over what is there.
    assert_eq!(board.try_admin(&["restore", name]).status.code(), Some(1));
    let restored = board.path("restored");
    let restore = |file: &std::path::Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
        command.args(["serve", "admin", "--data"]).arg(&restored).arg("restore").arg(file).output().unwrap()
    };
    // Torn, or with a byte changed: refused, and nothing is left.
    let whole = fs::read(&file).unwrap();
    let bad = board.path("bad.tar");
    for (length, flipped) in
        [(whole.len() / 2, 0), (512, 0), (whole.len(), 5000), (whole.len(), whole.len() / 2)]
    {
        let mut bytes = whole[..length].to_vec();
        bytes[flipped] ^= 1;
        fs::write(&bad, bytes).unwrap();
        let output = restore(&bad);
        assert_eq!(output.status.code(), Some(1), "{length} {flipped}");
        assert!(!restored.exists(), "{length} {flipped}");
    }
    let output = restore(&file);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let server = Server::start(&restored, &[]);
    assert_eq!(server.verdict(&id, &board.token), before);
    assert_eq!(server.get("/api/v1/receipt-key", None).json(), key);
    let zip = |data: &str| fs::read(board.path(data).join(format!("submissions/{id}.zip"))).unwrap();
    assert_eq!(zip("restored"), zip("data"));
    assert_eq!(fs::read_dir(restored.join("pictures").join(&id)).unwrap().count(), 6);
    let id = server.submit("", &board.token, &board.zip(2, false));
    assert_eq!(server.verdict(&id, &board.token)["state"], "scored");
}

#[test]
fn zips_are_kept_as_long_as_admins_say() {
    let board = Board::new();
    let server = board.start();
    let id = server.submit("", &board.token, &board.zip(1, true));
    let scored = server.verdict(&id, &board.token);
    let zip = board.path("data/submissions").join(format!("{id}.zip"));
    assert_eq!(board.admin(&["keep-zips"]), "all");
    assert_eq!(board.admin(&["prune"]), "0 zips removed, 0 MB");
    assert_eq!(board.admin(&["keep-zips", "30"]), "30 days");
    assert_eq!(board.admin(&["prune"]), "0 zips removed, 0 MB");
    assert!(zip.exists());
    assert_eq!(board.try_admin(&["keep-zips", "some"]).status.code(), Some(2));
    board.admin(&["keep-zips", "0"]);
    assert_eq!(board.admin(&["prune"]), "1 zips removed, 0 MB");
    assert!(!zip.exists());
    assert_eq!(board.admin(&["prune"]), "0 zips removed, 0 MB");
    let audit = board.admin(&["audit"]);
    assert_eq!(audit.matches(&format!("admin: prune {id}")).count(), 1, "{audit}");
    // All else is as it was, after a restart and from a backup too.
    drop(server);
    let file = board.path("board.tar");
    board.admin(&["backup", file.to_str().unwrap()]);
    let restored = board.path("restored");
    let mut restore = Command::new(env!("CARGO_BIN_EXE_relight"));
    restore.args(["serve", "admin", "--data"]).arg(&restored).arg("restore").arg(&file);
    assert!(restore.status().unwrap().success());
    for data in [board.path("data"), restored] {
        let server = Server::start(&data, &[]);
        assert_eq!(server.verdict(&id, &board.token), scored);
    }
}

#[test]
fn baselines_are_entered_scored_and_pinned() {
    let board = Board::new();
    let told = board.admin(&["add-baselines", "tiny"]);
    let ids: Vec<&str> = told.lines().map(|line| line.split(' ').next().unwrap()).collect();
    let server = board.start();
    for id in &ids {
        assert_eq!(server.verdict(id, &board.token)["state"], "scored");
    }
    let read = || server.get("/api/v1/benchmarks/tiny/leaderboard?sort=method", None).json();
    let mut leaderboard = read();
    // One that was worked out as the server started is shown for a moment longer.
    for _ in 0..100 {
        if leaderboard["splits"][1]["entries"].as_array().unwrap().len() == ids.len() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
        leaderboard = read();
    }
    let entries = leaderboard["splits"][1]["entries"].as_array().unwrap().clone();
    assert_eq!(leaderboard["splits"].as_array().unwrap().len(), 3);
    let told: Vec<_> =
        entries.iter().map(|entry| (entry["method"].as_str().unwrap(), &entry["baseline"])).collect();
    assert_eq!(told, [("mean image", &true.into()), ("nearest light", &true.into())]);
    // Those of `relight eval`, by other code: the mean of the means of the two scenes.
    let (mut sums, scenes) = ([0.0; 2], ["box", "cup"]);
    for scene in scenes {
        let scene = Scene::open(&board.path("scenes").join(scene)).unwrap();
        let splits = Splits::peek(&scene).unwrap();
        let (train, easy) = (splits.get(Split::Train), splits.get(Split::Easy));
        let mean = mean_image(&scene, train, &|_, _| ControlFlow::Continue(())).unwrap().unwrap();
        let nearest = NearestLight::new(&scene, train);
        for &frame in easy {
            let truth = scene.read_frame(frame).unwrap();
            let stand_in = nearest.image(frame).unwrap().unwrap();
            for (sum, image) in sums.iter_mut().zip([&mean, &stand_in]) {
                *sum += psnr(&image.data, &truth.data).unwrap() / easy.len() as f64 / scenes.len() as f64;
            }
        }
    }
    for (entry, mean) in entries.iter().zip(sums) {
        assert!((entry["psnr"]["mean"].as_f64().unwrap() - mean).abs() < 0.0051, "{entry} {mean}");
    }
}
