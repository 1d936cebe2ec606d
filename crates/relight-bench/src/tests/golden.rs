//! The tables of fixed scores, letter by letter. `RELIGHT_BLESS=1 cargo test -p relight-bench golden` writes them anew, for eyes
//! to compare.

use std::fs;
use std::path::Path;

use super::*;
use crate::formats::{csv, html, latex};
use crate::{Kind, Report};

fn check(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if std::env::var_os("RELIGHT_BLESS").is_some() {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
    }
    let expected = fs::read_to_string(&path).unwrap_or_default();
    assert!(text == expected, "{} differs:\n{text}", path.display());
}

fn check_all(report: &Report<'_>) {
    let name = report.kind.name();
    check(&format!("{name}.md"), &report.markdown());
    check(&format!("{name}.tex"), &latex::write(report));
    check(&format!("{name}.csv"), &csv::write(report).replace("\r\n", "\n"));
    check(&format!("{name}.html"), &html::write(report));
}

#[test]
fn an_ablation_with_a_failure_and_several_seeds() {
    let list = list(&["cube", "50% of_it"], &["v1", "v4", "v5"], &[0, 1]);
    let failure = Failure { job: "cube-v4-s1".into(), reason: "step 12: the loss is not finite".into() };
    let records = list.jobs.iter().filter(|job| job.id != "cube-v4-s1").map(record).collect();
    let results = results(&list, FULL, records, vec![failure]);
    check_all(&Report::new(Kind::Ablation, &results));
}

#[test]
fn a_benchmark_of_own_and_official_scenes() {
    let list = list(&["reflective", "kettle"], &["v5"], &[0]);
    let records = vec![without_tests(record(&list.jobs[0])), record(&list.jobs[1])];
    let facts = |scene: &str| Some(if scene == "kettle" { SMALL } else { FULL });
    let results = Results::gather(&list, Path::new("/nowhere"), &facts, records, Vec::new());
    check_all(&Report::new(Kind::Benchmark, &results));
}
