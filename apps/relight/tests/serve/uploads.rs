//! Uploads that are too long, too short, broken off or sent while the server stops.

use std::io::Write;
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

use crate::board::{Board, head, read_answer};

const PATH: &str = "/api/v1/benchmarks/tiny/submissions";

fn files(board: &Board, folder: &str) -> usize {
    std::fs::read_dir(board.path("data").join(folder)).unwrap().count()
}

#[test]
fn uploads_that_are_none_are_told_why_and_leave_nothing() {
    let board = Board::new();
    let server = board.start_with(&["--zip-mib", "1"]);
    let long = vec![7; (1 << 20) + 1];
    for (path, token, body, status, says) in [
        (PATH, None, &b"x"[..], 401, "Authorization"),
        (PATH, Some("relight_1_00"), b"x", 401, "Authorization"),
        (PATH, Some(&*board.token), b"", 400, "empty"),
        (PATH, Some(&*board.token), &long, 413, "1048576 bytes"),
        ("/api/v1/benchmarks/none/submissions", Some(&*board.token), b"x", 404, "no benchmark \"none\""),
        (&format!("{PATH}?paper=javascript:x"), Some(&*board.token), b"x", 400, "paper"),
        (&format!("{PATH}?phase=easy"), Some(&*board.token), b"x", 400, "none of val, test"),
    ] {
        let answer = server.post(path, token, body);
        assert_eq!(answer.status, status, "{path}: {answer:?}");
        assert!(answer.error().contains(says), "{path}: {answer:?}");
    }
    // Its length not announced, it is found to be too long on the way.
    let mut stream = TcpStream::connect(server.address).unwrap();
    let chunked =
        head("POST", PATH, Some(&board.token), 0).replace("Content-Length: 0", "Transfer-Encoding: chunked");
    stream.write_all(chunked.as_bytes()).unwrap();
    stream
        .write_all(&[format!("{:x}\r\n", long.len()).as_bytes(), &long, b"\r\n0\r\n\r\n"].concat())
        .unwrap();
    assert_eq!(read_answer(&mut stream).unwrap().status, 413);
    assert_eq!((files(&board, "incoming"), files(&board, "submissions")), (0, 0));
    // Words of the query that mean nothing are not passed over.
    assert_eq!(server.upload("visiblity=private", &board.token, b"x").status, 400);
    assert_eq!((files(&board, "incoming"), files(&board, "submissions")), (0, 0));
    assert_eq!(board.admin(&["list"]), "");
}

#[test]
fn an_upload_that_breaks_off_leaves_nothing() {
    let board = Board::new();
    let server = board.start();
    let zip = board.zip(1, false);
    let mut stream = TcpStream::connect(server.address).unwrap();
    stream.write_all(head("POST", PATH, Some(&board.token), zip.len()).as_bytes()).unwrap();
    stream.write_all(&zip[..zip.len() / 2]).unwrap();
    let begun = Instant::now();
    while files(&board, "incoming") == 0 {
        assert!(begun.elapsed() < Duration::from_secs(30), "the upload does not begin");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(files(&board, "submissions"), 0);
    stream.shutdown(Shutdown::Both).unwrap();
    while files(&board, "incoming") > 0 {
        assert!(begun.elapsed() < Duration::from_secs(30), "the half stays");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(board.admin(&["list"]), "");
    server.verdict(&server.submit("", &board.token, &zip), &board.token);
}

#[test]
fn a_server_that_is_asked_to_stop_takes_the_upload_in_first() {
    let board = Board::new();
    let server = board.start();
    let zip = board.zip(1, false);
    let mut stream = TcpStream::connect(server.address).unwrap();
    stream.write_all(head("POST", PATH, Some(&board.token), zip.len()).as_bytes()).unwrap();
    stream.write_all(&zip[..100]).unwrap();
    let begun = Instant::now();
    while files(&board, "incoming") == 0 && begun.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(5));
    }
    server.ask_to_stop();
    while TcpStream::connect(server.address).is_ok() && begun.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(20));
    }
    stream.write_all(&zip[100..]).unwrap();
    let answer = read_answer(&mut stream).unwrap();
    assert_eq!(answer.status, 202, "{answer:?}");
    server.join();
    let server = board.start();
    let id = answer.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(server.verdict(&id, &board.token)["state"], "scored");
}

#[test]
fn the_log_is_read_by_programs_too() {
    use std::io::{BufRead, BufReader};

    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_relight"));
    command.args(["serve", "--listen", "127.0.0.1:0", "--log-json", "--data"]).arg(folder.path());
    let null = std::process::Stdio::null;
    let mut server =
        command.stdin(null()).stdout(null()).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(server.stderr.take().unwrap()).read_line(&mut line).unwrap();
    server.kill().unwrap();
    server.wait().unwrap();
    let line: serde_json::Value = serde_json::from_str(&line).unwrap();
    assert_eq!((&line["level"], &line["message"]), (&"INFO".into(), &"serving".into()), "{line}");
    assert!(line["timestamp"].is_string() && line["address"].is_string(), "{line}");
}

#[test]
fn one_server_serves_a_folder_and_answers_what_monitors_ask() {
    let board = Board::new();
    let server = board.start();
    let second = std::process::Command::new(env!("CARGO_BIN_EXE_relight"))
        .args(["serve", "--listen", "127.0.0.1:0", "--data"])
        .arg(board.path("data"))
        .output()
        .unwrap();
    assert_eq!(second.status.code(), Some(1));
    let stderr = String::from_utf8(second.stderr).unwrap();
    assert!(stderr.contains("another relight server serves this folder"), "{stderr}");
    assert_eq!(server.get("/healthz", None).json()["status"], "ok");
    let id = server.submit("", &board.token, &board.zip(1, false));
    server.verdict(&id, &board.token);
    // The verdict is there before it is counted.
    let counted = || server.get("/metrics", None).text().contains("relight_submissions_scored_total 1\n");
    (0..1000)
        .take_while(|_| !counted())
        .for_each(|_| std::thread::sleep(std::time::Duration::from_millis(10)));
    let metrics = server.get("/metrics", None);
    assert!(metrics.header("content-type").unwrap().starts_with("text/plain; version=0.0.4"));
    let metrics = metrics.text();
    for line in [
        "relight_submissions{state=\"scored\"} 1",
        "relight_submissions_scored_total 1",
        "relight_http_requests_total{route=\"/healthz\",status=\"200\"} 1",
        "relight_http_request_seconds_count{route=\"/healthz\"} 1",
        "relight_http_request_seconds_bucket{route=\"/healthz\",le=\"+Inf\"} 1",
        "relight_http_requests_in_flight 1",
    ] {
        assert!(metrics.lines().any(|told| told == line), "{line}\n{metrics}");
    }
    assert_eq!(server.get("/nothing", None).status, 404);
}
