//! Hostile zips: every one is refused, and for what it is.

#![allow(clippy::unwrap_used)]

mod case;
#[path = "../common/mod.rs"]
mod common;
mod faults;
mod png_writer;
mod zip_writer;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;
use std::path::Path;

use case::{Case, Random};
use common::{answers, benchmark, file};
use faults::{FAULTS, Fault};
use relight_server::benchmark::Benchmark;
use relight_server::scoring::{Scores, score};
use relight_server::submission::{Limits, SubmissionError, check, inspect};

/// The codes of all that is wrong with a case; none if it is accepted.
fn codes(case: &Case, benchmark: &Benchmark, folder: &Path) -> BTreeSet<String> {
    let zip = file(folder, "upload.zip", &case.written());
    match check(&zip, benchmark, &case.limits, &mut |_| ControlFlow::Continue(())) {
        Ok(_) => BTreeSet::new(),
        Err(SubmissionError::Refused(refusal)) => {
            assert!(!refusal.problems.is_empty());
            assert!(refusal.problems.iter().all(|problem| problem.message.len() > 10));
            refusal.problems.iter().map(|problem| problem.code.to_string()).collect()
        }
        Err(error) => panic!("a zip's fault was taken for the disk's: {error}"),
    }
}

#[test]
fn honest_zips_of_all_shapes_pass() {
    let (folder, benchmark) = benchmark();
    for seed in 0..60 {
        let answers = answers(&benchmark, seed % 2 == 0);
        let case = Case::honest(&answers, &mut Random(seed));
        assert_eq!(codes(&case, &benchmark, folder.path()), BTreeSet::new(), "seed {seed}");
    }
}

#[test]
fn every_fault_is_refused_by_its_name() {
    let (folder, benchmark) = benchmark();
    let answers = answers(&benchmark, true);
    for (n, fault) in FAULTS.iter().enumerate() {
        for seed in 0..6 {
            let mut random = Random((1000 * n + seed) as u64);
            let mut case = Case::honest(&answers, &mut random);
            (fault.apply)(&mut case, &mut random);
            let codes = codes(&case, &benchmark, folder.path());
            let told = |among: &[&str]| codes.iter().filter(|code| among.contains(&code.as_str())).count();
            assert!(told(fault.codes) > 0, "{}, seed {seed}: {codes:?}", fault.name);
            let known = [fault.codes, fault.also].concat();
            assert_eq!(told(&known), codes.len(), "{}, seed {seed}: {codes:?}", fault.name);
        }
    }
}

#[test]
fn a_thousand_hostile_zips_are_refused_with_their_reasons() {
    let (folder, benchmark) = benchmark();
    let answers = answers(&benchmark, false);
    let mut reasons = BTreeMap::<String, usize>::new();
    for seed in 0..1000 {
        let mut random = Random(seed << 20);
        let (case, applied) = Case::hostile(&answers, &mut random);
        let names: Vec<&str> = applied.iter().map(|fault| fault.name).collect();
        let codes = codes(&case, &benchmark, folder.path());
        let reason = |code: &String| {
            let of = |fault: &&Fault| [fault.codes, fault.also].concat().contains(&code.as_str());
            applied.iter().any(of)
        };
        assert!(codes.iter().any(reason), "seed {seed}, {names:?}: {codes:?}");
        codes.into_iter().for_each(|code| *reasons.entry(code).or_default() += 1);
    }
    // The grammar reaches every code.
    let all: BTreeSet<&str> = FAULTS.iter().flat_map(|fault| fault.codes).copied().collect();
    let reached: BTreeSet<&str> = reasons.keys().map(String::as_str).collect();
    assert_eq!(all.difference(&reached).collect::<Vec<_>>(), Vec::<&&str>::new());
}

/// Not every byte of a zip tells of its images: times, for one. Whatever byte is wrong, what is not refused scores as before.
#[test]
fn a_changed_byte_is_refused_or_changes_nothing() {
    let (folder, benchmark) = benchmark();
    let scored = |bytes: &[u8]| -> Option<Scores> {
        let zip = file(folder.path(), "upload.zip", bytes);
        let submission = inspect(&zip, &benchmark, &Limits::default()).ok()?;
        score(&submission, &benchmark, &Limits::default(), &mut |_| ControlFlow::Continue(())).ok()
    };
    let answers = answers(&benchmark, false);
    for seed in 0..3 {
        let mut bytes = Case::honest(&answers, &mut Random(seed)).written();
        let (before, mut harmless, mut refused) = (scored(&bytes).unwrap(), 0, 0);
        for at in (seed as usize..bytes.len()).step_by(23) {
            bytes[at] ^= 1 << (at % 8);
            match scored(&bytes) {
                Some(after) => {
                    assert_eq!(after, before, "seed {seed}, byte {at}");
                    harmless += 1;
                }
                None => refused += 1,
            }
            bytes[at] ^= 1 << (at % 8);
        }
        assert!(harmless > 0 && refused > 5 * harmless, "{harmless} of {refused}");
    }
}
