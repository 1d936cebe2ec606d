//! How long readers of the leaderboard wait while submissions are being scored.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use relight_scene::Image;

use crate::board::{Board, zip};
use crate::fair::Fair;

/// Readers at a time, each on a connection of its own.
const READERS: usize = 200;
/// Entries on the leaderboard, of 20 scenes.
const ENTRIES: usize = 50;
/// Submissions that wait to be scored.
const SUBMISSIONS: usize = 12;

/// Reads an address over and over, and times each answer.
fn read_on(address: SocketAddr, path: &str, stop: &AtomicBool) -> Vec<Duration> {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_nodelay(true).unwrap();
    let mut from = BufReader::with_capacity(64 << 10, stream.try_clone().unwrap());
    let asked = format!("GET {path} HTTP/1.1\r\nHost: board\r\nAccept-Encoding: gzip\r\n\r\n");
    let (mut times, mut body) = (Vec::new(), Vec::new());
    while !stop.load(Ordering::Relaxed) {
        let begun = Instant::now();
        stream.write_all(asked.as_bytes()).unwrap();
        let mut length = 0;
        for number in 0.. {
            let mut line = String::new();
            from.read_line(&mut line).unwrap();
            let line = line.trim_end().to_lowercase();
            assert!(number > 0 || line.contains(" 200 "), "{line}");
            if let Some(told) = line.strip_prefix("content-length: ") {
                length = told.parse().unwrap();
            }
            if line.is_empty() {
                break;
            }
        }
        body.resize(length, 0);
        from.read_exact(&mut body).unwrap();
        times.push(begun.elapsed());
    }
    times
}

/// Two hundred readers without a pause between two readings, of which the tables say how long they wait:
/// `cargo test --release --package relight --test serve readers -- --ignored --nocapture`.
#[test]
#[ignore = "measures; prints how long readers wait"]
fn readers_hardly_wait_while_submissions_are_scored() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let names: Vec<String> = (0..ENTRIES).map(|number| format!("Method number {number}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let fair = runtime.block_on(Fair::with(&names));
    let board = Board::with((1440, 1080), Some(fair.folder.path()));
    board.admin(&["quotas", "tiny", "--per-day", "1000", "--total", "1000"]);
    let server = board.start_with(&["--requests-per-second", "1000000"]);
    let benchmark = board.benchmark();
    let images: Vec<(String, Image)> = benchmark
        .scenes
        .iter()
        .flat_map(|scene| &scene.images)
        .map(|image| (image.entry.clone(), image.read_truth().unwrap()))
        .collect();
    let pngs: Vec<(String, Vec<u8>)> =
        images.into_iter().map(|(entry, image)| (entry, image.png().unwrap())).collect();
    let zip = zip(&pngs);
    for path in ["/benchmarks/rene", "/api/v1/benchmarks/rene/leaderboard.json"] {
        let ids: Vec<String> = (0..SUBMISSIONS).map(|_| server.submit("", &board.token, &zip)).collect();
        let stop = AtomicBool::new(false);
        let begun = Instant::now();
        let mut times: Vec<Duration> = std::thread::scope(|scope| {
            let readers: Vec<_> =
                (0..READERS).map(|_| scope.spawn(|| read_on(server.address, path, &stop))).collect();
            for id in &ids {
                assert_eq!(server.verdict(id, &board.token)["state"], "scored");
            }
            stop.store(true, Ordering::Relaxed);
            readers.into_iter().flat_map(|reader| reader.join().unwrap()).collect()
        });
        let seconds = begun.elapsed().as_secs_f64();
        times.sort();
        let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * 1000.0;
        println!(
            "{path}: {READERS} readers, {} answers in {seconds:.1} s ({:.0}/s) while {SUBMISSIONS} submissions were scored: \
             median {:.1} ms, p90 {:.1} ms, p99 {:.1} ms, longest {:.1} ms",
            times.len(),
            times.len() as f64 / seconds,
            at(0.5),
            at(0.9),
            at(0.99),
            at(1.0)
        );
    }
}
