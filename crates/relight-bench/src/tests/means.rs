//! Means over seeds and over scenes.

use super::*;
use crate::results::Method;

fn v5() -> Method {
    Method::Model("v5".into())
}

#[test]
fn seeds_become_a_mean_with_its_deviation() {
    let list = list(&["cube"], &["v5"], &[0, 1, 2]);
    let results = complete(&list, SMALL);
    let entry = results.entry("cube", &v5(), Split::Val).unwrap();
    // 25.4, 25.65 and 25.9.
    assert_eq!(entry.psnr.told(2), "25.65 ± 0.25");
    assert_eq!(entry.runs, ["cube-v5-s0", "cube-v5-s1", "cube-v5-s2"]);
    let baseline = results.entry("cube", &Method::MeanImage, Split::Val).unwrap();
    assert_eq!(baseline.psnr.told(2), "17.55", "the same for every seed");
    assert_eq!(results.entry("cube", &Method::Model("v4".into()), Split::Val), None);
}

#[test]
fn the_mean_over_scenes_is_of_scenes_that_every_model_was_scored_on() {
    let list = list(&["ab", "abcd", "abcdefgh"], &["v1", "v5"], &[0]);
    let records = list.jobs.iter().filter(|job| job.id != "abcdefgh-v1-s0").map(record);
    let results = results(&list, SMALL, records.collect(), Vec::new());
    assert_eq!(results.common(Split::Easy), ["ab", "abcd"]);
    // 25 + 0.31 and 0.2 or 0.4 for the scene.
    assert_eq!(results.mean(&v5(), Split::Easy).unwrap().psnr.told(2), "25.61");
    assert_eq!(results.mean(&v5(), Split::Easy).unwrap().runs, ["ab-v5-s0", "abcd-v5-s0"]);
}

#[test]
fn deviations_of_the_mean_are_between_seeds_that_all_scenes_have() {
    let list = list(&["ab", "abcd"], &["v5"], &[0, 1, 2]);
    let records = list.jobs.iter().filter(|job| job.id != "abcd-v5-s1").map(record);
    let results = results(&list, SMALL, records.collect(), Vec::new());
    let mean = results.mean(&v5(), Split::Val).unwrap();
    // 25.3 with seed 0, 25.8 with seed 2.
    assert_eq!(mean.psnr.told(2), format!("25.55 ± {:.2}", 0.5 / 2f64.sqrt()));
    assert_eq!(mean.runs.len(), 4);
}

#[test]
fn splits_that_were_not_scored_have_no_scores() {
    let list = list(&["ab", "abcd"], &["v5"], &[0]);
    let records = vec![without_tests(record(&list.jobs[0])), record(&list.jobs[1])];
    let results = results(&list, SMALL, records, Vec::new());
    assert_eq!(results.entry("ab", &v5(), Split::Easy), None);
    assert_eq!(results.entry("ab", &Method::MeanImage, Split::Hard), None);
    assert!(results.entry("ab", &v5(), Split::Val).is_some());
    assert_eq!(results.common(Split::Hard), ["abcd"]);
}
