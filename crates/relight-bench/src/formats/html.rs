//! HTML: a page that holds everything, pictures too.

use std::fmt::Write as _;
use std::fs;
use std::ops::Range;

use relight_field::architecture::{Architecture, EmbeddingEntry, LightInput};
use relight_metrics::error_colour;

use crate::formats::chart;
use crate::formats::markdown::MISSING;
use crate::pictures::BRIGHTEST_ERROR;
use crate::record::{Record, Shown};
use crate::report::{Kind, Report};
use crate::report_page::{ReportPage, escape, source};
use crate::results::Results;
use crate::table::{Row, RowKind, Table};

/// What tables and rows of pictures look like, beside what every page has.
const STYLE: &str = include_str!("html.css");

/// The whole page.
pub fn write(report: &Report<'_>) -> String {
    let results = report.results;
    let scenes = match results.scenes.as_slice() {
        [(scene, _)] => scene.clone(),
        scenes => format!("{} scenes", scenes.len()),
    };
    let mut page = ReportPage::styled(&format!("{}: {scenes}", report.kind.title()), STYLE);
    if let Some(how) = report.notes.first() {
        page.lead(how);
    }
    if let Some(unfinished) = report.unfinished() {
        page.warning(&unfinished);
    }
    page.html("<div class=\"sheets\">\n");
    for (i, table) in report.tables.iter().enumerate() {
        page.html("<section>\n");
        if report.tables.len() > 1 {
            page.heading(&table.title);
        }
        // What a model is need be said only once.
        page.html(&scores(table, report, i == 0));
        page.html("</section>\n");
    }
    if report.kind == Kind::Ablation {
        page.html(&chart::write(results));
    }
    page.html("</div>\n");
    page.remarks(report.notes.get(1..).unwrap_or_default());
    pictures(&mut page, results);
    page.html(&runs(&results.records));
    page.finish()
}

/// A table of scores. A benchmark's first column heads its blocks instead, so that the table stays narrow; an ablation's
/// columns that say what a model is can be left out.
fn scores(table: &Table, report: &Report<'_>, is_explained: bool) -> String {
    let headed = report.kind == Kind::Benchmark;
    let shown = if headed {
        1..2
    } else if is_explained {
        0..table.stubs.len()
    } else {
        0..1
    };
    let names = table.stubs.get(shown.clone()).unwrap_or_default();
    let mut html = String::new();
    let label = escape(&format!("{}, {}", report.kind.title(), table.title.to_lowercase()));
    // Writing to a string cannot fail, here and below.
    let _ = write!(
        html,
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{label}\"><table class=\"scores\"><thead><tr>"
    );
    for (i, _) in names.iter().enumerate() {
        html += if i == 0 { "<th class=\"name\"></th>" } else { "<th class=\"mark\"></th>" };
    }
    for group in &table.groups {
        let _ = write!(html, "<th colspan=\"2\" scope=\"colgroup\">{}</th>", escape(group));
    }
    html += "</tr><tr>";
    for (i, name) in names.iter().enumerate() {
        let class = if i == 0 { "name" } else { "mark" };
        let _ = write!(html, "<th class=\"{class}\" scope=\"col\">{}</th>", escape(name));
    }
    html += &"<th class=\"psnr\" scope=\"col\">PSNR</th><th class=\"ssim\" scope=\"col\">SSIM</th>"
        .repeat(table.groups.len());
    html += "</tr></thead>";
    for (i, row) in table.rows.iter().enumerate() {
        if row.begins {
            html += if i > 0 { "</tbody><tbody>" } else { "<tbody>" };
            if let Some(block) = row.stubs.first().filter(|_| headed) {
                let columns = 1 + 2 * table.groups.len();
                let _ = write!(
                    html,
                    "<tr class=\"block\"><th scope=\"rowgroup\" colspan=\"{columns}\">{}</th></tr>",
                    escape(block)
                );
            }
        }
        html += &line(row, shown.clone(), &report.results.records);
    }
    html += "</tbody></table></div>\n";
    html
}

/// A row of which the leading columns `shown` are.
fn line(row: &Row, shown: Range<usize>, records: &[Record]) -> String {
    let kind = match row.kind {
        RowKind::Model => "model",
        RowKind::Published => "published",
        RowKind::Baseline => "baseline",
    };
    let mut html = format!("<tr class=\"{kind}\">");
    let is_model = shown.start == 0 && row.kind == RowKind::Model;
    let names = row.stubs.get(shown).unwrap_or_default();
    for (i, name) in names.iter().enumerate() {
        let _ = if i == 0 {
            let about = if is_model { about(name) } else { "" };
            let about = if about.is_empty() { String::new() } else { format!("<small>{about}</small>") };
            write!(html, "<th class=\"name\" scope=\"row\">{}{about}</th>", escape(name))
        } else {
            write!(html, "<td class=\"mark\">{}</td>", escape(name))
        };
    }
    for (group, entry) in row.entries.iter().enumerate() {
        let Some((entry, told)) = entry.as_ref().zip(row.told(group)) else {
            for metric in ["psnr", "ssim"] {
                let _ = write!(html, "<td class=\"{metric} missing\">{MISSING}</td>");
            }
            continue;
        };
        let title = escape(&made_by(&entry.runs, records));
        for ((metric, number), best) in ["psnr", "ssim"].iter().zip(&told).zip(entry.best) {
            let best = if best { " best" } else { "" };
            let _ = write!(html, "<td class=\"{metric}{best}\" title=\"{title}\">{}</td>", escape(number));
        }
    }
    html += "</tr>\n";
    html
}

/// What a model has that the one before it has not.
fn about(model: &str) -> &'static str {
    let Some(a) = Architecture::named(model) else { return "" };
    match a {
        _ if a.visibility => "+ visibility",
        _ if a.embedding == EmbeddingEntry::Layer2 => "+ e at layer 2",
        _ if a.position_skip => "+ h(x) to colour",
        _ if a.light == LightInput::Direction => "light direction",
        _ if a.light == LightInput::Pose => "light pose",
        _ => "no light",
    }
}

/// How a number came about: every run that it was made of.
fn made_by(runs: &[String], records: &[Record]) -> String {
    let told = runs.iter().map(|id| match records.iter().find(|record| record.job.id == *id) {
        Some(record) => format!("{id}: {}", record.told()),
        None => id.clone(),
    });
    let told: Vec<String> = told.collect();
    if told.is_empty() { "published".to_owned() } else { told.join("\n") }
}

/// For each scene the pictures of one image: a row a model.
fn pictures(page: &mut ReportPage, results: &Results) {
    let mut is_first = true;
    for (scene, _) in &results.scenes {
        // One a model: that of the first seed that is done.
        let mut shown: Vec<(&Record, &Shown)> = Vec::new();
        for record in results.records.iter().filter(|r| r.job.scene_name == *scene) {
            if let Some(image) = &record.shown
                && !shown.iter().any(|(other, _)| other.job.model == record.job.model)
            {
                shown.push((record, image));
            }
        }
        let Some((_, first)) = shown.first() else { continue };
        if std::mem::take(&mut is_first) {
            page.heading("Pictures");
            page.html(&scale());
        }
        let of = format!("{scene}: camera {} under light {} ({})", first.camera, first.light, first.split);
        page.html(&format!("<h3>{}</h3>\n", escape(&of)));
        for (record, image) in shown {
            page.html(&shots(record, image, results));
        }
    }
}

/// One model's pictures.
fn shots(record: &Record, image: &Shown, results: &Results) -> String {
    let folder = record.job.folder(&results.folder);
    let model = record.job.model.to_uppercase();
    let scores = format!("{:.2} dB, {:.3}", image.scores.psnr, image.scores.ssim);
    let mut html = String::from("<div class=\"shots\">");
    let pictures = [
        (Some(&image.truth), "Photograph".to_owned()),
        (Some(&image.prediction), format!("{model}: {scores}")),
        (Some(&image.error), format!("{model}: error")),
        (image.visibility.as_ref(), format!("{model}: visibility")),
    ];
    for (file, caption) in pictures {
        let caption = escape(&caption);
        let _ = match file.map(|file| fs::read(folder.join(file))) {
            Some(Ok(bytes)) => writeln!(
                html,
                "<figure><img alt=\"{caption}\" src=\"{}\"><figcaption>{caption}</figcaption></figure>",
                source(&bytes)
            ),
            Some(Err(_)) => writeln!(html, "<div class=\"none\">the picture is missing</div>"),
            None => writeln!(html, "<div class=\"none\">{model} has no visibility</div>"),
        };
    }
    html += "</div>\n";
    html
}

/// What the colours of errors mean.
fn scale() -> String {
    let stops: Vec<String> = (0..=8)
        .map(|i| {
            let [r, g, b] = error_colour(f64::from(i) / 8.0);
            format!("#{r:02x}{g:02x}{b:02x}")
        })
        .collect();
    format!(
        "<p class=\"scale\"><span>Error, the mean over the channels:</span> <span>0 <i style=\"background:linear-gradient(90deg,{})\"></i> \
         {BRIGHTEST_ERROR} of 255 and more</span> <span>Visibility: black where no light arrives</span></p>\n",
        stops.join(",")
    )
}

/// How each run was trained.
fn runs(records: &[Record]) -> String {
    let mut html = String::from(
        "<details open><summary>Runs</summary><div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Runs\"><table class=\"runs\">\
         <thead><tr><th>run</th><th>seed</th><th>preset</th><th>steps</th><th>minutes</th><th>by</th><th>on</th></tr></thead><tbody>\n",
    );
    for record in records {
        let made = &record.made;
        let _ = writeln!(
            html,
            "<tr><td><a href=\"runs/{}/config.toml\">{}</a></td><td>{}</td><td>{}</td><td>{}</td><td>{:.1}</td><td>relight {} ({})</td><td>{}</td></tr>",
            percent_encoded(&record.job.id),
            escape(&record.job.id),
            record.job.seed,
            escape(&record.config.preset),
            made.steps,
            made.seconds / 60.0,
            escape(&made.version),
            escape(&made.commit),
            escape(&made.device)
        );
    }
    html += "</tbody></table></div></details>\n";
    html
}

/// A part of a path in an address.
fn percent_encoded(text: &str) -> String {
    let mut encoded = String::new();
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            encoded.push(char::from(byte));
        } else {
            let _ = write!(encoded, "%{byte:02X}");
        }
    }
    encoded
}
