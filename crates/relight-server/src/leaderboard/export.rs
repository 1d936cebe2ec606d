//! Leaderboards for programs: JSON and CSV.

use std::fmt::Write as _;

use relight_scene::Split;
use serde::Serialize;

use super::{CONFIDENCE, Leaderboard, Metric, RESAMPLES, Row, Table, View, ViewError, ViewQuery};

/// A leaderboard as programs read it. Versioned by its member `format`; an infinite PSNR is null.
#[derive(Debug, Serialize)]
pub struct JsonBoard<'a> {
    format: &'static str,
    benchmark: &'a str,
    confidence: f64,
    resamples: usize,
    splits: Vec<JsonTable<'a>>,
}

#[derive(Debug, Serialize)]
struct JsonTable<'a> {
    split: Split,
    images: usize,
    scenes: &'a [String],
    entries: Vec<JsonRow<'a>>,
}

#[derive(Debug, Serialize)]
struct JsonRow<'a> {
    id: &'a str,
    method: &'a str,
    authors: &'a str,
    user: &'a str,
    baseline: bool,
    submitted_at: &'a str,
    evaluator: &'a str,
    psnr: JsonStanding,
    ssim: JsonStanding,
    scenes: Vec<JsonScene<'a>>,
}

#[derive(Debug, Serialize)]
struct JsonStanding {
    mean: Option<f64>,
    interval: Option<(f64, f64)>,
    average_rank: f64,
}

#[derive(Debug, Serialize)]
struct JsonScene<'a> {
    scene: &'a str,
    psnr: Option<f64>,
    ssim: Option<f64>,
}

/// Tables and how they are asked for: that of the query's split, or all.
fn views<'a>(board: &'a Leaderboard, query: &ViewQuery) -> Result<Vec<(&'a Table, View)>, ViewError> {
    let wanted = |split: Split| {
        let query = ViewQuery { split: Some(split.to_string()), ..query.clone() };
        View::new(board, &query)
    };
    if query.split.is_some() {
        let view = View::new(board, query)?;
        return Ok(board.table(view.split).map(|table| (table, view)).into_iter().collect());
    }
    board.tables.iter().map(|table| Ok((table, wanted(table.split)?))).collect()
}

/// The tables that are asked for, as one JSON object.
///
/// # Errors
/// [`ViewError`] for a query with a value that is not known.
pub fn to_json<'a>(board: &'a Leaderboard, query: &ViewQuery) -> Result<JsonBoard<'a>, ViewError> {
    let table = |(table, view): (&'a Table, View)| JsonTable {
        split: table.split,
        images: table.images,
        scenes: &table.scenes,
        entries: view.rows(table).into_iter().map(|row| json_row(table, row)).collect(),
    };
    Ok(JsonBoard {
        format: "relight-leaderboard-1",
        benchmark: &board.benchmark,
        confidence: CONFIDENCE,
        resamples: RESAMPLES,
        splits: views(board, query)?.into_iter().map(table).collect(),
    })
}

fn json_row<'a>(table: &'a Table, row: &'a Row) -> JsonRow<'a> {
    let standing = |metric| {
        let standing = row.standing(metric);
        JsonStanding {
            mean: standing.mean,
            interval: standing.interval,
            average_rank: (standing.rank * 100.0).round() / 100.0,
        }
    };
    let scene = |(index, name): (usize, &'a String)| JsonScene {
        scene: name,
        psnr: row.standing(Metric::Psnr).scenes[index],
        ssim: row.standing(Metric::Ssim).scenes[index],
    };
    let about = &row.about;
    JsonRow {
        id: &about.id,
        method: &about.method,
        authors: &about.authors,
        user: &about.user,
        baseline: about.baseline,
        submitted_at: &about.submitted_at,
        evaluator: &about.evaluator,
        psnr: standing(Metric::Psnr),
        ssim: standing(Metric::Ssim),
        scenes: table.scenes.iter().enumerate().map(scene).collect(),
    }
}

/// The tables that are asked for, as one CSV file (RFC 4180): a line for every entry in every split, with two columns a scene. An
/// infinite PSNR is `inf`; a scene that a split lacks is empty.
///
/// # Errors
/// [`ViewError`] for a query with a value that is not known.
pub fn to_csv(board: &Leaderboard, query: &ViewQuery) -> Result<String, ViewError> {
    let views = views(board, query)?;
    let mut scenes: Vec<&String> = Vec::new();
    for name in views.iter().flat_map(|(table, _)| &table.scenes) {
        if !scenes.contains(&name) {
            scenes.push(name);
        }
    }
    let mut csv = "split,id,method,authors,user,baseline,submitted_at,evaluator,images".to_owned();
    for metric in Metric::ALL.map(Metric::as_str) {
        csv += &format!(",{metric},{metric}_low,{metric}_high,{metric}_average_rank");
    }
    for (scene, metric) in scenes.iter().flat_map(|scene| Metric::ALL.map(|metric| (scene, metric))) {
        csv += &format!(",{}", field(&format!("{scene}_{}", metric.as_str())));
    }
    csv += "\r\n";
    for (table, view) in &views {
        for row in view.rows(table) {
            push_line(&mut csv, table, row, &scenes);
        }
    }
    Ok(csv)
}

fn push_line(csv: &mut String, table: &Table, row: &Row, scenes: &[&String]) {
    let about = &row.about;
    let texts = [&about.id, &about.method, &about.authors, &about.user];
    *csv += &table.split.to_string();
    for text in texts {
        *csv += &format!(",{}", field(text));
    }
    *csv += &format!(",{},{}", about.baseline, field(&about.submitted_at));
    *csv += &format!(",{},{}", field(&about.evaluator), table.images);
    let number = |metric: Metric, value: Option<f64>| {
        value.map_or_else(|| "inf".to_owned(), |value| format!("{value:.*}", metric.digits()))
    };
    for metric in Metric::ALL {
        let standing = row.standing(metric);
        let (low, high) = standing.interval.unzip();
        let end = |end: Option<f64>| end.map_or_else(String::new, |end| number(metric, Some(end)));
        // Writing to a string cannot fail.
        let _ = write!(csv, ",{},{},{}", number(metric, standing.mean), end(low), end(high));
        let _ = write!(csv, ",{:.2}", standing.rank);
    }
    for scene in scenes {
        let index = table.scenes.iter().position(|name| name == *scene);
        for metric in Metric::ALL {
            let score = index.map(|index| number(metric, row.standing(metric).scenes[index]));
            csv.push(',');
            *csv += &score.unwrap_or_default();
        }
    }
    *csv += "\r\n";
}

/// A field of text: quoted where it must be, and kept from being run as a formula by spreadsheets (OWASP, CSV injection), which
/// take what begins like one for one.
fn field(text: &str) -> String {
    let formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    let text = if formula { format!("'{text}") } else { text.to_owned() };
    if text.contains(['"', ',', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}
