//! Scores, quotas, receipts.

use std::ops::ControlFlow;
use std::sync::Barrier;

use relight_server::disclosure::tell;
use relight_server::receipt::Receipt;
use relight_server::scoring::score;
use relight_server::submission::{Limits, inspect};
use serde_json::Value;

use crate::board::{Board, wait_until, zip};

#[test]
fn a_submission_is_scored_as_offline_and_has_a_receipt() {
    let board = Board::new();
    let server = board.start();
    let zip = board.zip(9, true);
    let id = server.submit("method=V%205&authors=Ada&paper=https://example.org/p", &board.token, &zip);
    let told = server.verdict(&id, &board.token);
    assert_eq!(told["state"], "scored", "{told}");
    assert_eq!(told["method"]["name"], "V 5");
    let path = board.path("offline.zip");
    std::fs::write(&path, &zip).unwrap();
    let (benchmark, limits) = (board.benchmark(), Limits::default());
    let submission = inspect(&path, &benchmark, &limits).unwrap();
    let scores = score(&submission, &benchmark, &limits, &mut |_| ControlFlow::Continue(())).unwrap();
    let offline = serde_json::to_value(tell(&scores)).unwrap();
    assert_eq!(told["scores"], offline);
    // Three splits, in the tables' digits where the truth is hidden.
    let means = told["scores"]["means"].as_array().unwrap();
    assert_eq!(means.len(), 3, "{means:?}");
    for mean in means.iter().filter(|mean| mean["split"] != "val") {
        let psnr = mean["psnr"].as_f64().unwrap() * 100.0;
        let ssim = mean["ssim"].as_f64().unwrap() * 1000.0;
        assert!((psnr - psnr.round()).abs() < 1e-6 && (ssim - ssim.round()).abs() < 1e-6, "{mean}");
    }
    assert!(told["scores"]["images"].as_array().unwrap().len() < submission.images.len());

    let receipt: Receipt = serde_json::from_value(told["receipt"].clone()).unwrap();
    let key = server.get("/api/v1/receipt-key", None).json();
    receipt.verify(key["public_key"].as_str().unwrap()).unwrap();
    assert_eq!((receipt.submission, receipt.evaluator), (id.clone(), scores.evaluator));
    assert_eq!(receipt.sha256, told["own"]["sha256"]);
    assert_eq!(serde_json::to_value(receipt.scores).unwrap(), offline);
    // Pictures of validation images alone, two a scene.
    let pictures: Vec<_> = std::fs::read_dir(board.path("data/pictures").join(&id)).unwrap().collect();
    assert_eq!(pictures.len(), 6, "{pictures:?}");
}

#[test]
fn validation_has_a_phase_of_its_own() {
    let board = Board::new();
    let server = board.start();
    let benchmark = board.benchmark();
    let images = benchmark.scenes.iter().flat_map(|scene| &scene.images);
    let val: Vec<_> = images
        .filter(|image| image.split == relight_scene::Split::Val)
        .map(|image| (image.entry.clone(), std::fs::read(&image.truth).unwrap()))
        .collect();
    let told = server.verdict(&server.submit("phase=val", &board.token, &zip(&val)), &board.token);
    assert_eq!(told["state"], "scored", "{told}");
    // The truth itself: PSNR is infinite.
    assert_eq!(told["scores"]["means"][0]["psnr"], Value::Null);
    assert_eq!(told["scores"]["images"].as_array().unwrap().len(), val.len());
    // Nobody gets hidden scores at the price of validation.
    let told = server.verdict(&server.submit("phase=val", &board.token, &board.zip(1, true)), &board.token);
    assert_eq!(told["state"], "refused");
    assert!(told["reason"].as_str().unwrap().contains("hidden splits"), "{told}");
    assert_eq!(told["scores"], Value::Null);
}

#[test]
fn what_is_no_submission_costs_nothing_and_says_why() {
    let board = Board::new();
    board.admin(&["quotas", "tiny", "--per-day", "1"]);
    let server = board.start();
    let mut torn = board.zip(1, false);
    torn.truncate(torn.len() / 2);
    let lacking = zip(&[("box_00_00.png".to_owned(), b"no png".to_vec())]);
    for bad in [torn, lacking, b"hello".to_vec()] {
        let id = server.submit("", &board.token, &bad);
        let told = server.verdict(&id, &board.token);
        assert_eq!(told["state"], "refused", "{told}");
        let problem = &told["problems"][0];
        assert!(problem["code"].is_string() && problem["message"].is_string(), "{told}");
        // After the verdict is written: a kill between the two must not lose a zip that has none.
        let zip = board.path("data/submissions").join(format!("{id}.zip"));
        wait_until("the zip stays", || !zip.exists());
    }
    let id = server.submit("", &board.token, &board.zip(1, false));
    assert_eq!(server.verdict(&id, &board.token)["state"], "scored");
    let answer = server.upload("", &board.token, &board.zip(2, false));
    assert_eq!(answer.status, 429);
    assert!(answer.error().contains("1 submissions of 24 hours"), "{answer:?}");
    let wait: u64 = answer.header("retry-after").unwrap().parse().unwrap();
    assert!((23 * 3600..=24 * 3600 + 1).contains(&wait), "{wait}");
}

#[test]
fn of_uploads_at_the_same_moment_only_as_many_pass_as_the_quota_allows() {
    let board = Board::new();
    board.admin(&["quotas", "tiny", "--per-day", "2"]);
    let server = board.start();
    // Four at a time is what one user may send at all.
    let barrier = Barrier::new(4);
    let mut statuses: Vec<u16> = std::thread::scope(|scope| {
        let (board, server, barrier) = (&board, &server, &barrier);
        let senders = (0..4).map(|i| {
            scope.spawn(move || {
                let zip = board.zip(i + 1, false);
                barrier.wait();
                server.upload("", &board.token, &zip).status
            })
        });
        senders.collect::<Vec<_>>().into_iter().map(|sender| sender.join().unwrap()).collect()
    });
    statuses.sort_unstable();
    assert_eq!(statuses, [202, 202, 429, 429]);
    assert_eq!(std::fs::read_dir(board.path("data/incoming")).unwrap().count(), 0);
}

#[test]
fn a_scorer_without_memory_ends_in_a_refusal_and_not_in_a_loop() {
    let board = Board::new();
    let server = board.start_with(&["--scoring-mib", "1"]);
    let id = server.submit("", &board.token, &board.zip(1, false));
    let told = server.verdict(&id, &board.token);
    assert_eq!(told["state"], "refused");
    assert!(told["reason"].as_str().unwrap().contains("within the server's limits"), "{told}");
    assert_eq!(server.get("/healthz", None).status, 200);
}
