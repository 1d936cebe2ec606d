//! Who sees what.

use std::fs;
use std::io::Write;
use std::net::TcpStream;

use serde_json::Value;

use crate::board::{Board, read_answer};

#[test]
fn what_is_private_hidden_or_withdrawn_is_not_there_for_others() {
    let board = Board::new();
    let eve = board.add_user("eve");
    let server = board.start();
    let id = server.submit("visibility=private", &board.token, &board.zip(1, false));
    let path = format!("/api/v1/submissions/{id}");
    server.verdict(&id, &board.token);
    for page in ["", "/receipt.json", "/pictures/box_00_00.png"] {
        assert_eq!(server.get(&format!("/submissions/{id}{page}"), None).status, 404, "{page}");
    }
    let none = server.get("/api/v1/submissions/ffffffffffffffff", Some(&eve));
    assert_eq!(none.status, 404);
    let seen_by_others = || {
        let [nobody, other] = [None, Some(&*eve)].map(|token| server.get(&path, token));
        assert_eq!(nobody.status, other.status);
        if other.status == 404 {
            // Nothing tells it from one that never was.
            assert_eq!(other.error(), none.error().replace("ffffffffffffffff", &id));
        }
        other.status == 200
    };
    assert!(!seen_by_others());
    for action in ["withdraw", "visibility?to=public"] {
        assert_eq!(server.post(&format!("{path}/{action}"), Some(&eve), &[]).status, 404);
        assert_eq!(server.post(&format!("{path}/{action}"), None, &[]).status, 401);
    }
    assert_eq!(server.get("/api/v1/submissions", Some(&eve)).json()["submissions"], Value::Array(vec![]));
    assert_eq!(server.get("/api/v1/submissions", None).status, 401);
    let own = server.get("/api/v1/submissions", Some(&board.token)).json();
    assert_eq!(own["submissions"][0]["id"], *id);

    assert_eq!(server.post(&format!("{path}/visibility?to=public"), Some(&board.token), &[]).status, 200);
    assert!(seen_by_others());
    board.admin(&["hide", &id]);
    assert!(!seen_by_others());
    assert_eq!(server.get(&path, Some(&board.token)).json()["own"]["hidden"], true);
    board.admin(&["show", &id]);
    assert!(seen_by_others());
    let zip = board.path("data/submissions").join(format!("{id}.zip"));
    assert!(zip.exists());
    assert_eq!(server.post(&format!("{path}/withdraw"), Some(&board.token), &[]).status, 200);
    assert!(!seen_by_others() && !zip.exists());
    assert_eq!(server.get(&path, Some(&board.token)).status, 200);
    assert_eq!(server.post(&format!("{path}/withdraw"), Some(&board.token), &[]).status, 403);
}

#[test]
fn anonymous_entries_do_not_tell_whose_they_are() {
    let board = Board::new();
    let server = board.start();
    let query = "visibility=anonymous&method=Nameless&authors=Lovelace&paper=https://lovelace.example\
                 &code=https://lovelace.example&hardware=lovelaces-desk&description=by-lovelace&training_time=lovelace";
    let id = server.submit(query, &board.token, &board.zip(1, false));
    let told = server.verdict(&id, &board.token);
    assert_eq!(told["method"]["authors"], "Lovelace");
    let told = server.get(&format!("/api/v1/submissions/{id}"), None);
    assert_eq!(told.status, 200);
    assert_eq!(told.json()["method"]["name"], "Nameless");
    // Nor her account's name, which may be a part of a hexadecimal number.
    let told = told.text().to_lowercase();
    assert!(!told.contains("lovelace") && !told.contains("\"ada\""), "{told}");
    // Without a name of its own the method would bear hers.
    let path = "/api/v1/benchmarks/tiny/submissions?visibility=anonymous";
    let refused = server.post(path, Some(&board.token), &board.zip(1, false));
    assert!(refused.status == 400 && refused.text().contains("whose entry it is"), "{}", refused.text());
}

/// Paths that exist, with whatever may be put into them, and paths that climb.
fn paths(id: &str, image: &str) -> Vec<String> {
    let inner = [
        "",
        "/",
        "/api/v1/benchmarks",
        "/api/v1/benchmarks/tiny",
        "/api/v1/benchmarks/tiny/submissions",
        "/api/v1/benchmarks/tiny/leaderboard",
        "/api/v1/submissions",
        "/api/v1/receipt-key",
        "/api/v1/benchmarks/tiny/leaderboard.json",
        "/api/v1/benchmarks/tiny/leaderboard.csv",
        "/benchmarks/tiny",
        "/benchmarks/tiny/submit",
        "/benchmarks/tiny/upload",
        "/account",
        "/healthz",
        "/metrics",
        "/scenes",
        "/data",
        "/static",
        "/pictures",
        "/submissions",
    ];
    let climbs = [
        "../scenes",
        "../../scenes",
        "..%2f..%2fscenes",
        "%2e%2e/%2e%2e/scenes",
        "..%5c..%5cscenes",
        "%00",
        "....//....//scenes",
    ];
    let mut paths: Vec<String> = inner.iter().map(|path| (*path).to_owned()).collect();
    let one = format!("/api/v1/submissions/{id}");
    paths.extend([
        one.clone(),
        format!("{one}/withdraw"),
        format!("{one}.zip"),
        format!("/submissions/{id}.zip"),
        format!("/submissions/{id}/pictures/{image}"),
        format!("/submissions/{id}/pictures/{}", image.replace(".png", "_truth.png")),
        format!("/submissions/{id}/pictures/{}", image.replace(".png", "_error.png")),
    ]);
    let page = format!("/submissions/{id}");
    let pictures = format!("{page}/pictures");
    paths.extend([page.clone(), format!("{page}/receipt.json"), pictures.clone()]);
    for prefix in ["", "/static", "/pictures", "/api/v1/benchmarks", "/benchmarks", &one, &page, &pictures] {
        paths.push(format!("{prefix}/{image}"));
        paths.push(format!("{prefix}/server.db"));
        paths.push(format!("{prefix}/receipt-key"));
        for climb in climbs {
            paths.push(format!("{prefix}/{climb}/box/lset000/data/00000_image.png"));
            paths.push(format!("{prefix}/{climb}/../data/server.db"));
        }
    }
    paths
}

#[test]
fn ground_truth_keys_and_places_are_at_no_address() {
    let board = Board::new();
    let server = board.start();
    let id = server.submit("", &board.token, &board.zip(1, true));
    server.verdict(&id, &board.token);
    let benchmark = board.benchmark();
    let all = &benchmark.scenes[0].images;
    let image = all.iter().find(|image| image.split != relight_scene::Split::Val).unwrap();
    let hidden: Vec<Vec<u8>> = benchmark
        .scenes
        .iter()
        .flat_map(|scene| &scene.images)
        .map(|image| fs::read(&image.truth).unwrap())
        .chain([fs::read(board.path("data/receipt-key")).unwrap()])
        .collect();
    let place = board.path("").to_str().unwrap().trim_end_matches('/').to_owned();
    let mut asked = 0;
    for path in paths(&id, &image.entry) {
        for method in ["GET", "HEAD", "OPTIONS", "PUT", "DELETE"] {
            // As it stands: clients of other people do not tidy paths up.
            let mut stream = TcpStream::connect(server.address).unwrap();
            let line = format!("{method} {path} HTTP/1.1\r\nHost: b\r\nConnection: close\r\n");
            let token = format!("Authorization: Bearer {}\r\n\r\n", board.token);
            stream.write_all((line + &token).as_bytes()).unwrap();
            let Ok(answer) = read_answer(&mut stream) else { continue };
            asked += 1;
            assert!(answer.status < 500, "{method} {path}: {answer:?}");
            assert!(
                method == "GET" || answer.status >= 400 || method == "HEAD",
                "{method} {path}: {answer:?}"
            );
            let body = &answer.body;
            for secret in &hidden {
                let part = &secret[secret.len() / 2..secret.len() / 2 + 24];
                assert!(!body.windows(24).any(|window| window == part), "{method} {path} tells a secret");
            }
            assert!(!answer.text().contains(&place), "{method} {path}: {}", answer.text());
        }
    }
    assert!(asked > 300, "{asked}");
}
