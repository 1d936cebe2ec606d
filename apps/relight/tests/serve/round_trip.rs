//! A run's way to the leaderboard: pack, check, serve, send, restart, back up, verify.

use std::process::Output;

use serde_json::Value;

use crate::board::Server;
use crate::common::Workshop;

/// A workshop with two scenes and a run of each.
fn workshop() -> Workshop {
    let shop = Workshop::new();
    std::fs::create_dir(shop.path("scenes")).unwrap();
    std::fs::rename(shop.path("scene"), shop.path("scenes/first")).unwrap();
    shop.succeed(
        "capture run --rig virtual --object wheel --out scenes/second --size 24x18 --views 8 --lights 6 --samples 4 --seed 1",
    );
    for scene in ["first", "second"] {
        shop.succeed(&format!("train scenes/{scene} --out runs/{scene} --recipe recipe.toml --steps 20"));
    }
    shop
}

/// PSNR and SSIM of a split as `relight eval` has them: the mean over both scenes.
fn evaluated(shop: &Workshop, split: &str) -> [f64; 2] {
    let [a, b] = ["first", "second"].map(|run| shop.json(&format!("eval runs/{run} --split {split} --json")));
    ["psnr", "ssim"].map(|name| (a[name].as_f64().unwrap() + b[name].as_f64().unwrap()) / 2.0)
}

/// Whether the server's PSNR and SSIM are those, though it rounds each scene's to the tables' digits, and then their mean.
fn are_equal(told: [f64; 2], offline: &[f64; 2]) -> bool {
    (told[0] - offline[0]).abs() < 0.0101 && (told[1] - offline[1]).abs() < 0.00101
}

/// Numbers that a line of scores tells, `split PSNR x dB, SSIM y`.
fn numbers(line: &str) -> [f64; 2] {
    let words: Vec<&str> = line.split_whitespace().collect();
    let &[_, "PSNR", psnr, "dB,", "SSIM", ssim] = &words[..] else { panic!("{line}") };
    [psnr, ssim].map(|number| number.parse().unwrap())
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&[&output.stdout[..], &output.stderr].concat()).into_owned()
}

#[test]
fn a_run_is_on_the_leaderboard_with_the_scores_that_it_has_offline_and_stays_there() {
    let shop = workshop();
    shop.succeed("submit pack runs/first runs/second --out entry.zip --phase all");
    shop.succeed("submit check entry.zip --scenes scenes");
    shop.succeed("serve admin --data board add-benchmark rig scenes");
    let token = shop.succeed("serve admin --data board add-user ada ada@example.org");
    let server = Server::start(&shop.path("board"), &[]);
    let address = format!("http://{}", server.address);
    let send = format!("submit send entry.zip --to {address} --benchmark rig --method V5 --wait");
    let output = shop.command(&send).env("RELIGHT_TOKEN", token.trim()).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let told = String::from_utf8(output.stdout).unwrap();
    let (id, told) = told.split_once('\n').unwrap();
    let scores = ["val", "easy", "hard"].map(|split| (split, evaluated(&shop, split)));
    assert_eq!(told.lines().count(), 3);
    for (line, (split, offline)) in told.lines().zip(&scores) {
        assert!(line.starts_with(split) && are_equal(numbers(line), offline), "{line} {offline:?}");
    }

    let path = "/api/v1/benchmarks/rig/leaderboard.json";
    let board = server.get(path, None).json();
    for ((split, offline), table) in scores.iter().zip(board["splits"].as_array().unwrap()) {
        let entry = &table["entries"][0];
        assert_eq!((&table["split"], &entry["id"]), (&Value::from(*split), &Value::from(id)));
        let means = ["psnr", "ssim"].map(|name| entry[name]["mean"].as_f64().unwrap());
        assert!(are_equal(means, offline), "{means:?} {offline:?}");
    }

    // A restart, and a backup on another machine, change nothing.
    let answer = server.get(&format!("/api/v1/submissions/{id}"), Some(token.trim()));
    std::fs::write(shop.path("answer.json"), &answer.body).unwrap();
    drop(server);
    shop.succeed("serve admin --data board backup board.tar");
    shop.succeed("serve admin --data again restore board.tar");
    for data in ["board", "again"] {
        let server = Server::start(&shop.path(data), &[]);
        assert_eq!(server.get(path, None).json(), board, "{data}");
        let address = format!("http://{}", server.address);
        let verified = shop.succeed(&format!("submit verify answer.json --from {address} --zip entry.zip"));
        assert!(verified.starts_with("answer.json: genuine\n") && verified.contains(told), "{verified}");
    }
    receipts_are_believed_only_as_they_were_signed(&shop, &answer.json());
}

/// The servers are gone; their key is remembered.
fn receipts_are_believed_only_as_they_were_signed(shop: &Workshop, answer: &Value) {
    let receipt = &answer["receipt"];
    let key = receipt["public_key"].as_str().unwrap();
    let verify = |receipt: &Value, arguments: &str| {
        std::fs::write(shop.path("receipt.json"), receipt.to_string()).unwrap();
        shop.run(&format!("submit verify receipt.json {arguments}"))
    };
    let output = verify(receipt, &format!("--key {key}"));
    assert!(output.status.success(), "{}", said(&output));
    let mut better = receipt.clone();
    better["scores"]["means"][1]["psnr"] = 99.0.into();
    let mut embellished = receipt.clone();
    embellished["prize"] = "the first".into();
    let other = "3b6a27bcceb6a42d62a3a8d02a6f0d73653215771de243a63ac048a18b59da29";
    std::fs::write(shop.path("other.zip"), "another zip").unwrap();
    let mut queued = answer.clone();
    queued["receipt"] = Value::Null;
    for (receipt, arguments, says) in [
        (&better, format!("--key {key}"), "changed after it was signed"),
        (&embellished, format!("--key {key}"), "prize"),
        (receipt, format!("--key {other}"), "not with the expected one"),
        (receipt, format!("--key {key} --zip other.zip"), "other.zip: is not the zip"),
        (receipt, "--from http://127.0.0.1:1".to_owned(), "cannot be reached"),
        (&queued, format!("--key {key}"), "holds no receipt"),
    ] {
        let output = verify(receipt, &arguments);
        assert_eq!(output.status.code(), Some(1), "{says}: {}", said(&output));
        assert!(said(&output).contains(says) && output.stdout.is_empty(), "{says}: {}", said(&output));
    }
    shop.fail("submit verify receipt.json", 2);
}
