//! Hostile zips over HTTP: every one is refused by name, and neither the server nor its scorer grows.

#[path = "../../../../crates/relight-server/tests/hostile/case.rs"]
mod case;
#[allow(dead_code)]
#[path = "../../../../crates/relight-server/tests/common/mod.rs"]
mod common;
#[path = "../../../../crates/relight-server/tests/hostile/faults.rs"]
mod faults;
#[path = "../../../../crates/relight-server/tests/hostile/png_writer.rs"]
mod png_writer;
#[path = "../../../../crates/relight-server/tests/hostile/zip_writer.rs"]
mod zip_writer;

use std::collections::BTreeMap;
use std::fs;
use std::time::Duration;

use relight_server::submission::Limits;

use crate::board::{Board, wait_until};
use case::{Case, Random};

/// Uploads of one user; more in a row are turned away.
const OF_A_USER: usize = 50;
/// What server and scorer may need together, KiB.
const MEMORY: u64 = 300 << 10;

/// KiB that a process and its children hold in memory.
fn resident(process: u32) -> u64 {
    let proc = |id: &str, file: &str| fs::read_to_string(format!("/proc/{id}/{file}")).unwrap_or_default();
    let of = |id: &str| {
        let status = proc(id, "status");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or("0 kB").to_owned();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap()
    };
    let server = process.to_string();
    // A child is listed with the thread that started it.
    let threads = fs::read_dir(format!("/proc/{server}/task")).unwrap();
    let children: Vec<String> = threads
        .flat_map(|thread| {
            let thread = thread.unwrap().file_name().into_string().unwrap();
            let children = proc(&server, &format!("task/{thread}/children"));
            children.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
        })
        .collect();
    of(&server) + children.iter().map(|child| of(child)).sum::<u64>()
}

fn survive(uploads: usize) {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    for name in ["box", "café"] {
        common::scene(&folder.path().join("scenes").join(name), |_, _| false);
    }
    let board = Board::hosting(folder);
    // A refusal that cost anything would turn the next upload away.
    board.admin(&["quotas", "tiny", "--per-day", "1", "--total", "1"]);
    let server = board.start();
    let answers = common::answers(&board.benchmark(), false);
    // What only a server of other limits would refuse is no fault here.
    let mut hostile = (0_u64..)
        .map(|seed| Case::hostile(&answers, &mut Random(seed << 20)))
        .filter(|(case, _)| case.limits == Limits::default());
    let mut largest = 0;
    let mut reasons = BTreeMap::<String, usize>::new();
    for user in 0..uploads.div_ceil(OF_A_USER) {
        let token = board.add_user(&format!("mallory-{user}"));
        let sent: Vec<_> = hostile.by_ref().take(OF_A_USER.min(uploads)).collect();
        for (case, faults) in sent {
            let zip = case.written();
            let answer = server.upload("", &token, &zip);
            let names: Vec<&str> = faults.iter().map(|fault| fault.name).collect();
            if zip.is_empty() {
                assert_eq!((answer.status, answer.error().contains("empty")), (400, true), "{answer:?}");
                *reasons.entry("no bytes".to_owned()).or_default() += 1;
                continue;
            }
            assert_eq!(answer.status, 202, "{names:?}: {answer:?}");
            let path = format!("/api/v1/submissions/{}", answer.json()["id"].as_str().unwrap());
            let told = loop {
                largest = largest.max(resident(server.id()));
                let told = server.get(&path, Some(&token)).json();
                if !["queued", "scoring"].contains(&told["state"].as_str().unwrap()) {
                    break told;
                }
                std::thread::sleep(Duration::from_millis(1));
            };
            assert_eq!(told["state"], "refused", "{names:?}: {told}");
            let problems = told["problems"].as_array().unwrap_or_else(|| panic!("{names:?}: {told}"));
            let codes: Vec<&str> = problems.iter().map(|one| one["code"].as_str().unwrap()).collect();
            let known = |code: &&&str| {
                faults.iter().any(|fault| fault.codes.contains(code) || fault.also.contains(code))
            };
            let code = codes.iter().find(known).unwrap_or_else(|| panic!("{names:?}: {told}"));
            *reasons.entry((*code).to_owned()).or_default() += 1;
        }
    }
    eprintln!("{reasons:#?}\n{uploads} refused; server and scorer needed {} MiB at most", largest >> 10);
    assert!(largest > 0 && largest < MEMORY, "{largest} KiB");
    assert_eq!(server.get("/healthz", None).status, 200);
    for folder in ["incoming", "scoring", "submissions", "pictures"] {
        let folder = board.path("data").join(folder);
        wait_until("a refused zip leaves something", || fs::read_dir(&folder).unwrap().count() == 0);
    }
    // One that is none of these passes still.
    let zip = Case::honest(&answers, &mut Random(1)).written();
    assert_eq!(server.verdict(&server.submit("", &board.token, &zip), &board.token)["state"], "scored");
}

#[test]
fn hostile_uploads_are_refused_by_name() {
    survive(40);
}

#[test]
#[ignore = "takes minutes"]
fn a_thousand_hostile_uploads_are_refused_by_name() {
    survive(1000);
}
