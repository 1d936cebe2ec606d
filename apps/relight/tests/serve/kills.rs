//! `kill -9` at any moment, while submissions come in and are scored.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::board::{Board, request};

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Uploads one zip after another until the server is gone; what was answered with 202: names and sums.
fn send(address: SocketAddr, token: &str, zips: &[Vec<u8>], next: &AtomicU8) -> Vec<(String, String)> {
    let mut accepted = Vec::new();
    loop {
        let zip = &zips[usize::from(next.fetch_add(1, Ordering::Relaxed)) % zips.len()];
        let path = "/api/v1/benchmarks/tiny/submissions";
        match request(address, "POST", path, Some(token), zip) {
            Ok(answer) if answer.status == 202 => {
                accepted.push((answer.json()["id"].as_str().unwrap().to_owned(), sha256(zip)));
            }
            Ok(answer) => panic!("{answer:?}"),
            Err(_) => return accepted,
        }
        // Some wait while others are scored, and the queue does not grow without end.
        std::thread::sleep(Duration::from_millis(40));
    }
}

/// Every file that has its final name is whole.
fn check_files(board: &Board, sums: &HashSet<String>) {
    for file in fs::read_dir(board.path("data/submissions")).unwrap() {
        let path = file.unwrap().path();
        assert!(sums.contains(&sha256(&fs::read(&path).unwrap())), "{} is half a zip", path.display());
    }
}

fn entries(folder: &Path) -> usize {
    fs::read_dir(folder).unwrap().count()
}

fn survive(kills: u64) {
    let board = Board::new();
    board.admin(&["quotas", "tiny", "--per-day", "100000", "--total", "100000"]);
    let zips: Vec<Vec<u8>> = (1..=8).map(|salt| board.zip(salt, salt % 2 == 0)).collect();
    let sums: HashSet<String> = zips.iter().map(|zip| sha256(zip)).collect();
    let next = AtomicU8::new(0);
    let mut accepted = HashMap::new();
    for i in 0..kills {
        let server = board.start();
        // Moments that differ from one start to the next, from before the first upload to amid the scoring of several.
        let moment = Duration::from_millis((i * i * 37 + i * 91) % 401);
        let address = server.address;
        let sent = std::thread::scope(|scope| {
            let send = || send(address, &board.token, &zips, &next);
            let senders = [scope.spawn(send), scope.spawn(send)];
            std::thread::sleep(moment);
            server.kill();
            senders.into_iter().flat_map(|sender| sender.join().unwrap()).collect::<Vec<_>>()
        });
        accepted.extend(sent);
        check_files(&board, &sums);
    }
    assert!(accepted.len() as u64 >= kills / 2, "only {} uploads in {kills} rounds", accepted.len());
    let server = board.start();
    assert_eq!(entries(&board.path("data/incoming")), 0);
    // What was accepted is there, with its zip's sum; so may be what was stored while the answer was lost.
    let list = || serde_json::from_str::<Value>(&board.admin(&["list", "--json"])).unwrap();
    let names: Vec<String> = list()["submissions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| entry["id"].as_str().unwrap().to_owned())
        .collect();
    let mut scores = HashMap::new();
    for id in &names {
        let told = server.verdict(id, &board.token);
        assert_eq!(told["state"], "scored", "{told}");
        let sum = told["own"]["sha256"].as_str().unwrap().to_owned();
        if let Some(sent) = accepted.remove(id) {
            assert_eq!(sent, sum);
        }
        // The same zip, the same scores, whenever and however often scoring was cut short.
        let first = scores.entry(sum).or_insert_with(|| told["scores"].clone());
        assert_eq!(*first, told["scores"]);
    }
    assert!(accepted.is_empty(), "lost: {accepted:?}");
    check_files(&board, &sums);
    // One verdict each.
    let audit = board.admin(&["audit", "--last", "1000000", "--json"]);
    let verdicts: Vec<String> = audit
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap())
        .filter(|line| line["action"] == "scored")
        .map(|line| line["subject"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(verdicts.len(), names.len());
    assert_eq!(verdicts.iter().collect::<HashSet<_>>(), names.iter().collect::<HashSet<_>>());
    assert_eq!(entries(&board.path("data/incoming")), 0);
    eprintln!("{kills} kills, {} submissions", names.len());
}

#[test]
fn kills_lose_nothing_and_score_nothing_twice() {
    survive(6);
}

#[test]
#[ignore = "takes a minute"]
fn fifty_kills_lose_nothing_and_score_nothing_twice() {
    survive(50);
}
