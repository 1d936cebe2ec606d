//! The five files are well-formed, whatever scenes are called.

use std::fs;

use super::*;
use crate::formats::{csv, html, latex, markdown};
use crate::{Kind, Report};

/// Names that mean something to each of the formats.
const NASTY: [&str; 6] = [
    "50%_of_{it}",
    "a & b \\end{tabular}",
    "<script>alert(1)</script>",
    "one|two",
    "say \"hi\", \r\nthen go",
    "~^$#*_`[x](y)",
];

fn nasty() -> JobList {
    // A slash would make them paths.
    let names: Vec<String> = NASTY.iter().map(|name| name.replace('/', "-")).collect();
    list(&names.iter().map(String::as_str).collect::<Vec<_>>(), &["v0", "v5"], &[0])
}

fn each(check: impl Fn(&Report<'_>)) {
    for kind in [Kind::Ablation, Kind::Benchmark] {
        let list = nasty();
        check(&Report::new(kind, &complete(&list, SMALL)));
        check(&Report::new(kind, &results(&list, SMALL, Vec::new(), Vec::new())));
    }
}

/// What a TeX compiler would stumble over: braces and environments that do not match, rows with too many or too few cells,
/// special characters that were not escaped.
fn check_latex(text: &str) {
    let mut open = Vec::new();
    let mut depth = 0i32;
    let mut columns = 0;
    // A TeX line ends at a comment.
    for line in text.lines().filter(|line| !line.starts_with('%')) {
        let mut escaped = false;
        for c in line.chars() {
            match c {
                _ if escaped => escaped = false,
                '\\' => escaped = true,
                '{' => depth += 1,
                '}' => depth -= 1,
                '%' | '#' | '~' | '^' | '_' => panic!("a bare {c} in {line}"),
                _ => {}
            }
            assert!(depth >= 0, "{line}");
        }
        let argument = |command: &str| {
            let (_, rest) = line.split_once(command)?;
            Some(rest.split('}').next().unwrap().to_owned())
        };
        if let Some(name) = argument("\\begin{") {
            if ["tabular", "longtable"].contains(&name.as_str()) {
                let (_, columns_of) = line.split_once(&format!("{{{name}}}{{")).unwrap();
                columns = columns_of.trim_end_matches('}').len();
                assert!(columns_of.trim_end_matches('}').chars().all(|c| c == 'l' || c == 'r'), "{line}");
            }
            open.push(name);
        }
        if let Some(name) = argument("\\end{") {
            assert_eq!(open.pop(), Some(name), "{line}");
        }
        if let Some(row) = line.strip_suffix(" \\\\")
            && !line.starts_with("\\caption")
        {
            let cells = row.replace("\\&", "").matches('&').count() + 1;
            let spanned = row.matches("\\multicolumn{2}").count();
            assert_eq!(cells + spanned, columns, "{line}");
        }
    }
    assert_eq!((depth, open), (0, vec![]));
}

#[test]
fn latex_is_whole() {
    each(|report| check_latex(&latex::write(report)));
    // Longer than a page.
    let names: Vec<String> = (0..20).map(|i| format!("scene{i:02}")).collect();
    let list = list(&names.iter().map(String::as_str).collect::<Vec<_>>(), &["v5"], &[0, 1]);
    let text = latex::write(&Report::new(Kind::Benchmark, &complete(&list, SMALL)));
    check_latex(&text);
    assert!(text.contains("\\begin{longtable}") && text.contains("booktabs,longtable"));
}

#[test]
fn html_is_whole() {
    each(|report| {
        let text = html::write(report);
        let mut open = Vec::new();
        for tag in text.split('<').skip(1) {
            let (inside, _) = tag.split_once('>').unwrap_or_else(|| panic!("<{tag}"));
            assert_eq!(inside.matches('"').count() % 2, 0, "<{inside}>");
            let name: String =
                inside.trim_start_matches('/').chars().take_while(|c| c.is_ascii_alphanumeric()).collect();
            if inside.starts_with('/') {
                assert_eq!(open.pop().as_ref(), Some(&name), "<{inside}>");
            } else if !inside.starts_with('!')
                && !inside.ends_with('/')
                && !["meta", "img", "br"].contains(&name.as_str())
            {
                open.push(name);
            }
        }
        assert!(open.is_empty(), "{open:?}");
        assert!(!text.contains("<script") && !text.contains("http"), "nothing from elsewhere, no scripts");
        assert!(text.contains("&lt;script&gt;"));
    });
}

/// Rows of RFC 4180.
fn parse_csv(text: &str) -> Vec<Vec<String>> {
    let (mut rows, mut row, mut field) = (Vec::new(), Vec::new(), String::new());
    let mut quoted = false;
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if quoted && chars.peek() == Some(&'"') => field.extend(chars.next()),
            '"' => quoted = !quoted,
            ',' if !quoted => row.push(std::mem::take(&mut field)),
            '\r' if !quoted => assert_eq!(chars.peek(), Some(&'\n')),
            '\n' if !quoted => {
                row.push(std::mem::take(&mut field));
                rows.push(std::mem::take(&mut row));
            }
            c => field.push(c),
        }
    }
    assert!(!quoted && row.is_empty() && field.is_empty());
    rows
}

#[test]
fn csv_holds_every_score_and_every_name() {
    let list = nasty();
    let results = complete(&list, SMALL);
    let rows = parse_csv(&csv::write(&Report::new(Kind::Benchmark, &results)));
    assert!(rows.iter().all(|row| row.len() == rows[0].len()));
    // Two models and two baselines on three splits.
    assert_eq!(rows.len(), 1 + NASTY.len() * 4 * 3);
    for job in &list.jobs {
        for split in [Split::Val, Split::Easy, Split::Hard] {
            let expected = scores(job, split);
            let row = rows.iter().find(|row| row[16] == job.id && row[3] == split.to_string()).unwrap();
            assert_eq!((&row[0], &row[1]), (&job.scene_name, &job.model));
            assert_eq!(row[4].parse::<f64>().unwrap(), expected.psnr);
            assert_eq!(row[5].parse::<f64>().unwrap(), expected.ssim);
        }
    }
}

#[test]
fn every_line_of_a_markdown_table_has_as_many_cells() {
    each(|report| {
        let text = markdown::write(report);
        let mut columns = None;
        for line in text.lines() {
            if !line.starts_with('|') {
                columns = None;
                continue;
            }
            let cells = line.replace("\\|", "").matches('|').count();
            assert_eq!(*columns.get_or_insert(cells), cells, "{line}");
        }
    });
}

#[test]
fn all_five_are_written_and_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let list = list(&["cube"], &["v0", "v5"], &[0]);
    let none = results(&list, SMALL, Vec::new(), Vec::new());
    let paths = Report::new(Kind::Ablation, &none).write(folder.path()).unwrap();
    let names: Vec<_> = paths.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["ablation.md", "ablation.tex", "ablation.csv", "ablation.json", "ablation.html"]);
    let text = fs::read_to_string(&paths[0]).unwrap();
    assert!(text.contains("0 of 2 runs are done") && text.contains('–'), "{text}");
    Report::new(Kind::Ablation, &complete(&list, SMALL)).write(folder.path()).unwrap();
    let text = fs::read_to_string(&paths[0]).unwrap();
    assert!(!text.contains("runs are done") && text.contains("25.40"), "{text}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 5, "nothing else is left");
}
