//! A leaderboard's page.

use maud::{Markup, html};
use relight_scene::Split;

use super::home::plural;
use super::shell::{moment, outward};
use crate::leaderboard::{Column, Leaderboard, Metric, Row, Standing, Table, View, percent_encoded};

/// Width of the picture of intervals, and its margin on both sides, in its own units.
const CHART: (f64, f64) = (120.0, 6.0);

/// What a split is called on pages, and what it asks of a method.
pub fn split_title(split: Split) -> (&'static str, &'static str) {
    match split {
        Split::Train => ("Training", "Images that methods learn from."),
        Split::Val => (
            "Validation",
            "Training cameras that were left out, under a few lights. Their photographs are public.",
        ),
        Split::Easy => {
            ("Easy", "New cameras, under lights that training has seen. The photographs are hidden.")
        }
        Split::Hard => ("Hard", "New cameras under new lights, some at the rim. The photographs are hidden."),
    }
}

/// The middle of the page of a leaderboard; the same for all visitors.
pub fn board(board: &Leaderboard, view: &View) -> Markup {
    let Some(table) = board.table(view.split) else { return html! {} };
    let base = format!("/benchmarks/{}", percent_encoded(&board.benchmark));
    let rows = view.rows(table);
    let (entries, baselines): (Vec<&Row>, Vec<&Row>) = rows.into_iter().partition(|row| !row.about.baseline);
    html! {
        section.head {
            p.crumb { a href="/" { "Benchmarks" } }
            h1 { bdi { (board.benchmark) } }
            p.lead {
                (plural(table.scenes.len(), "scene")) ", " (plural(table.images, "image")) ". "
                (split_title(view.split).1)
            }
            p.actions {
                a.button href=(format!("{base}/upload")) { "Submit" }
                a href=(format!("{base}/submit")) { "How to submit" }
            }
        }
        div.controls {
            nav.tabs aria-label="Split" {
                @for other in &board.tables {
                    @let to = View { split: other.split, column: Column::Mean(view.metric), falls: true, ..view.clone() };
                    a href=(format!("{base}{}", to.to_query(other)))
                        aria-current=[(other.split == view.split).then_some("page")] {
                        (split_title(other.split).0)
                    }
                }
            }
            nav.tabs aria-label="Metric" {
                @for metric in Metric::ALL {
                    @let to = View { metric, column: Column::Mean(metric), falls: true, ..view.clone() };
                    a href=(format!("{base}{}", to.to_query(table)))
                        aria-current=[(metric == view.metric).then_some("page")] { (metric.title()) }
                }
            }
            form.filter role="search" method="get" action=(base) {
                input type="hidden" name="split" value=(view.split);
                input type="hidden" name="metric" value=(view.metric.as_str());
                label for="q" { "Filter" }
                input #q type="search" name="q" value=(view.filter) placeholder="Method, author, user" data-filter="board";
                button.plain { "Apply" }
            }
        }
        div.scroll role="region" aria-label="Leaderboard" tabindex="0" {
            table.board #board data-sortable="" {
                caption.hidden {
                    (split_title(view.split).0) " split by " (view.metric.title()) ": means over images, then scenes"
                }
                thead { tr { (head(&base, table, view)) } }
                tbody data-rows="" {
                    @if entries.is_empty() {
                        tr.none { td colspan=(6 + table.scenes.len()) {
                            @if view.filter.is_empty() {
                                "No entry yet. " a href=(format!("{base}/submit")) { "Be the first." }
                            } @else {
                                "No entry matches “" bdi { (view.filter) } "”."
                            }
                        } }
                    }
                    @for row in &entries { (line(table, view, row, Some(table.place(row, view.metric)))) }
                }
                @if !baselines.is_empty() {
                    tbody.baselines {
                        tr { th.group scope="rowgroup" colspan=(6 + table.scenes.len()) { span { "Baselines, which learn nothing" } } }
                        @for row in &baselines { (line(table, view, row, None)) }
                    }
                }
            }
        }
        p.note {
            "Scores are means over a scene’s images, then over scenes, at full size. Rank is the mean over scenes of the rank by "
            (view.metric.title()) " in the scene; ties share their mean rank. Bars show 95 % bootstrap intervals over images. Scene "
            "columns show " (view.metric.title()) "; the best of each column is bold."
        }
        @if table.rows.iter().any(|row| row.about.evaluator != table.rows[0].about.evaluator) {
            p.note {
                "Not all of these were scored by the same version of the evaluator, so that last digits may not compare: the data tell which."
            }
        }
        p.downloads {
            "Data: "
            a href=(format!("/api/v1{base}/leaderboard.json")) { "JSON" } " "
            a href=(format!("/api/v1{base}/leaderboard.csv")) { "CSV" }
        }
    }
}

fn head(base: &str, table: &Table, view: &View) -> Markup {
    let column = |column: Column, text: &str, class: &str| {
        let chosen = column == view.column;
        let falls = if chosen { !view.falls } else { column.falls_by_default() };
        let to = View { column, falls, ..view.clone() };
        let sorted = if view.falls { "descending" } else { "ascending" };
        html! {
            th scope="col" class=(class) aria-sort=[chosen.then_some(sorted)]
                data-falls=[column.falls_by_default().then_some("")] {
                a href=(format!("{base}{}", to.to_query(table))) { (text) }
            }
        }
    };
    let metric = view.metric;
    let other = if metric == Metric::Psnr { Metric::Ssim } else { Metric::Psnr };
    html! {
        (column(Column::Method, "Method", "method"))
        (column(Column::Mean(metric), metric.title(), "number main"))
        th.interval scope="col" { "95 % interval" }
        (column(Column::Mean(other), other.title(), "number"))
        (column(Column::Rank, "Rank", "number"))
        @for (index, scene) in table.scenes.iter().enumerate() {
            (column(Column::Scene(index), scene, "number scene"))
        }
        (column(Column::Submitted, "Date", "number"))
    }
}

fn line(table: &Table, view: &View, row: &Row, place: Option<usize>) -> Markup {
    let about = &row.about;
    let metric = view.metric;
    let other = if metric == Metric::Psnr { Metric::Ssim } else { Metric::Psnr };
    let standing = row.standing(metric);
    let best = |of: &dyn Fn(&Row) -> Option<f64>| {
        let height = |score: Option<f64>| score.unwrap_or(f64::INFINITY);
        table.rows.iter().all(|another| height(of(another)) <= height(of(row)))
    };
    let number = |metric: Metric, of: &dyn Fn(&Row) -> Option<f64>, class: &str| {
        let value = of(row);
        let key = value.map_or_else(|| "Infinity".to_owned(), |value| value.to_string());
        html! {
            td class=(class) data-value=(key) {
                @if best(of) { strong { (metric.show(value)) } } @else { (metric.show(value)) }
            }
        }
    };
    let mean = |metric: Metric| move |row: &Row| row.standing(metric).mean;
    html! {
        tr data-text=[place.map(|_| format!("{} {} {}", about.method, about.authors, about.user).to_lowercase())] {
            th.method scope="row" data-value=(about.method.to_lowercase()) {
                span.place aria-hidden="true" { @if let Some(place) = place { (place) } }
                span.name {
                    a href=(format!("/submissions/{}", percent_encoded(&about.id))) dir="auto" { (about.method) }
                    @if !about.authors.is_empty() || !about.user.is_empty() {
                        small dir="auto" { (if about.authors.is_empty() { &about.user } else { &about.authors }) }
                    } @else if place.is_some() {
                        small { "anonymous" }
                    }
                }
            }
            (number(metric, &mean(metric), "number main"))
            td.interval { (chart(table, metric, standing)) }
            (number(other, &mean(other), "number"))
            td.number data-value=(standing.rank) { (format!("{:.1}", standing.rank)) }
            @for scene in 0..table.scenes.len() {
                (number(metric, &|row: &Row| row.standing(metric).scenes[scene], "number scene"))
            }
            td.number.date data-value=(about.submitted_at) { (moment(&about.submitted_at)) }
        }
    }
}

/// Where a mean and its interval lie among those that compete; baselines may lie beyond the left end.
fn chart(table: &Table, metric: Metric, standing: &Standing) -> Markup {
    let (Some(mean), Some((low, high))) = (standing.mean, standing.interval) else { return html! { "–" } };
    let rows = table.rows.iter().filter(|row| !row.about.baseline);
    let intervals = rows.filter_map(|row| row.standing(metric).interval);
    let (least, most) = intervals.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), (low, high)| {
        (least.min(low), most.max(high))
    });
    let (width, margin) = CHART;
    let x = |value: f64| {
        let share = (value - least) / (most - least).max(f64::MIN_POSITIVE);
        format!("{:.1}", margin + (width - 2.0 * margin) * share.clamp(0.0, 1.0))
    };
    html! {
        svg aria-hidden="true" viewBox=(format!("0 0 {width} 12")) width=(width) height="12" {
            line.rail x1="0" x2=(width) y1="6" y2="6" {}
            line.range x1=(x(low)) x2=(x(high)) y1="6" y2="6" {}
            circle cx=(x(mean)) cy="6" r="4" {}
        }
        small { (metric.show(Some(low))) "–" (metric.show(Some(high))) }
    }
}

/// The links of a method.
pub fn links(paper: &str, code: &str) -> Markup {
    html! { (outward(paper, "Paper")) " " (outward(code, "Code")) }
}
