//! Published figures stand beside official scenes at full size, and nowhere else.

use super::*;
use crate::{Kind, Report};

fn shows_published(scene: &str, facts: SceneFacts, kind: Kind) -> bool {
    let list = list(&[scene], &["v0", "v5"], &[0]);
    let results = complete(&list, facts);
    let report = Report::new(kind, &results);
    let texts =
        [report.markdown(), crate::formats::latex::write(&report), crate::formats::html::write(&report)];
    let shown: Vec<bool> = texts.iter().map(|text| text.contains("V5, published")).collect();
    let in_csv = crate::formats::csv::write(&report).contains(",published,");
    assert!(shown.iter().all(|&shown| shown == in_csv), "{shown:?} {in_csv}");
    in_csv
}

#[test]
fn only_official_scenes_at_full_size_have_published_figures() {
    for kind in [Kind::Ablation, Kind::Benchmark] {
        assert!(shows_published("cube", FULL, kind));
        assert!(shows_published("wooden", FULL, kind));
        assert!(!shows_published("cube", SMALL, kind));
        assert!(!shows_published("cube", SceneFacts { official: false, ..FULL }, kind));
        assert!(!shows_published("cube", SceneFacts { size: None, ..FULL }, kind));
        assert!(!shows_published("my-cube", FULL, kind));
        assert!(!shows_published("empty", FULL, kind));
    }
}

#[test]
fn they_are_the_papers_with_its_digits() {
    let list = list(&["cube", "savannah"], &["v0", "v5"], &[0]);
    let results = complete(&list, FULL);
    let text = Report::new(Kind::Benchmark, &results).markdown();
    let row = |scene: &str, method: &str| -> Vec<String> {
        let is_it =
            |line: &&str| line.starts_with(&format!("| {scene} ")) && line.contains(&format!("| {method} "));
        let line = text.lines().find(is_it).unwrap_or_else(|| panic!("no {scene} {method} in\n{text}"));
        line.split('|').skip(3).map(|cell| cell.trim().to_owned()).filter(|cell| !cell.is_empty()).collect()
    };
    assert_eq!(row("cube", "V5, published"), ["*26.11*", "*0.61*", "*24.90*", "*0.54*", "*23.98*", "*0.53*"]);
    assert_eq!(row("savannah", "V0, published"), ["–", "–", "*19.08*", "*0.40*", "*19.18*", "*0.40*"]);
    assert_eq!(row("Mean", "V5, published"), ["*25.67*", "*0.61*", "*25.02*", "*0.58*", "*24.14*", "*0.57*"]);
    assert!(text.contains("CVPR 2023"));
}

#[test]
fn figures_of_the_paper_stand_there_even_where_tests_are_withheld() {
    let list = list(&["reflective"], &["v5"], &[0]);
    let records = list.jobs.iter().map(|job| without_tests(record(job))).collect();
    let results = results(&list, FULL, records, Vec::new());
    let text = Report::new(Kind::Benchmark, &results).markdown();
    assert!(text.contains("*25.28*") && text.contains("black"), "{text}");
    assert!(!text.contains("25.53"), "no score of a black image: {text}");
}
