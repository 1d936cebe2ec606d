use proptest::prelude::*;

use crate::formats::{camera_file, pose_file, transforms};

proptest! {
    #[test]
    fn pose_files_never_panic(text: String) {
        let _ = pose_file::parse(&text);
    }

    #[test]
    fn matrices_of_any_numbers_never_panic(numbers in prop::collection::vec(any::<f64>(), 14..18)) {
        let text = numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        if let Ok(pose) = pose_file::parse(&text) {
            prop_assert!(pose.0.iter().flatten().all(|v| v.is_finite()));
        }
    }

    #[test]
    fn camera_files_never_panic(text in "(?s).{0,300}|[\\[\\]{}:,&*!|>'\"%@` \\-0-9a-z\n]{0,300}") {
        let _ = camera_file::parse(&text);
    }

    #[test]
    fn lenses_of_any_numbers_never_panic(
        matrix in prop::collection::vec(any::<f64>(), 0..12),
        size in prop::collection::vec(any::<f64>(), 0..4),
        coefficients in prop::collection::vec(any::<f64>(), 0..16),
    ) {
        let text = format!("camera_matrix: {matrix:?}\nimage_size: {size:?}\ndist_coeffs: {coefficients:?}\n");
        if let Ok(lens) = camera_file::parse(&text) {
            prop_assert!(lens.fault().is_none());
        }
    }

    #[test]
    fn transforms_files_never_panic(text in "(?s).{0,200}|[\\[\\]{}:,\"eE.+\\-0-9a-z]{0,300}") {
        let _ = transforms::parse(&text);
    }
}

#[test]
fn yaml_bombs_do_not_go_off() {
    let mut laughs = "a: &a [1,1,1,1,1,1,1,1,1,1]\n".to_owned();
    for (from, to) in ('a'..'j').zip('b'..'k') {
        laughs += &format!(
            "{to}: &{to} [*{from},*{from},*{from},*{from},*{from},*{from},*{from},*{from},*{from}]\n"
        );
    }
    for text in
        [laughs, "[".repeat(60_000), "a:\n ".repeat(10_000), "- ".repeat(30_000), "{a: ".repeat(15_000)]
    {
        assert!(camera_file::parse(&text).is_err());
    }
}
