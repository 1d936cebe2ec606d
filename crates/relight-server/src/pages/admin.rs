//! What admins see: benchmarks with their quotas, all submissions, the audit log.

use maud::{Markup, html};

use super::entry::visibility_tag;
use super::history::{Pages, parts};
use super::shell::{Visitor, form_token, moment, page};
use crate::leaderboard::percent_encoded;
use crate::method::Phase;
use crate::store::{AuditEntry, BenchmarkEntry, Quota, SubmissionEntry};

/// All benchmarks: whether each is open, and the forms to change that and its quotas.
pub fn benchmarks(visitor: &Visitor, benchmarks: &[BenchmarkEntry]) -> Markup {
    let main = html! {
        @if benchmarks.is_empty() {
            p.empty { "No benchmarks yet: " code { "relight serve admin --data DIR add-benchmark NAME SCENES" } }
        }
        @for benchmark in benchmarks {
            @let base = format!("/admin/benchmarks/{}", percent_encoded(&benchmark.name));
            section {
                h2 {
                    a href=(format!("/benchmarks/{}", percent_encoded(&benchmark.name))) { bdi { (benchmark.name) } }
                    " " span.tag { @if benchmark.open { "open" } @else { "closed" } }
                }
                form method="post" action=(format!("{base}/open")) {
                    (form_token(visitor))
                    input type="hidden" name="open" value=(!benchmark.open);
                    button.plain { @if benchmark.open { "Take no more submissions" } @else { "Take submissions again" } }
                }
                @for phase in [Phase::Val, Phase::Test] { (quota(visitor, &base, phase, benchmark.quota(phase))) }
            }
        }
    };
    around(visitor, "Benchmarks", &main)
}

fn quota(visitor: &Visitor, base: &str, phase: Phase, quota: Quota) -> Markup {
    let number = |field: &str, label: &str, value: u32| {
        let id = format!("{base}-{phase}-{field}");
        html! {
            label for=(id) { (label) }
            input id=(id) type="number" name=(field) min="0" max=(u32::MAX) value=(value) required;
        }
    };
    html! {
        form.stack method="post" action=(format!("{base}/quota")) {
            (form_token(visitor))
            input type="hidden" name="phase" value=(phase);
            fieldset {
                legend { "How often a user may submit: " @match phase { Phase::Val => "validation", Phase::Test => "test" } }
                (number("per_day", "Submissions within any 24 hours", quota.per_day))
                (number("total", "Submissions in all", quota.total))
                (number("gap_seconds", "Seconds between two submissions", quota.gap_seconds))
                button { "Set" }
            }
        }
    }
}

/// All submissions, newest first, each with the form to hide it or to show it again.
pub fn submissions(visitor: &Visitor, entries: &[SubmissionEntry], pages: Pages) -> Markup {
    let row = |entry: &SubmissionEntry| {
        let action = format!("/admin/submissions/{}/hidden", percent_encoded(&entry.id));
        html! {
            tr {
                th scope="row" { bdi { (entry.method.name) } " " code { (entry.id) } }
                td { bdi { (entry.user_name) } }
                td { bdi { (entry.benchmark) } }
                td { (entry.phase) }
                td { span.state-tag data-state=(entry.state) { (entry.state) } }
                td {
                    (visibility_tag(entry.visibility))
                    @if entry.pinned { " " span.tag { "baseline" } }
                    @if entry.hidden { " " span.tag { "hidden" } }
                    @if entry.withdrawn_at.is_some() { " " span.tag { "withdrawn" } }
                }
                td.date { (moment(&entry.submitted_at.to_string())) }
                td {
                    form method="post" action=(action) {
                        (form_token(visitor))
                        input type="hidden" name="hidden" value=(!entry.hidden);
                        button.plain { @if entry.hidden { "Show" } @else { "Hide" } }
                    }
                }
            }
        }
    };
    let columns = ["Method", "User", "Benchmark", "Phase", "State", "Seen by", "Date", "Moderation"];
    around(
        visitor,
        "Submissions",
        &html! {
            (table("Submissions", &columns, &html! { @for entry in entries { (row(entry)) } }))
            (parts(pages))
        },
    )
}

/// The newest lines of the audit log, newest first.
pub fn audit(visitor: &Visitor, lines: &[AuditEntry]) -> Markup {
    let rows = html! {
        @for line in lines {
            tr {
                th scope="row" { time datetime=(line.at) { (line.at) } }
                td { bdi { (line.actor) } }
                td { (line.action) }
                td { bdi { (line.subject) } }
                td { bdi { (line.detail) } }
            }
        }
    };
    around(visitor, "Audit log", &table("Audit log", &["When", "Who", "What", "To what", "Detail"], &rows))
}

fn table(label: &str, columns: &[&str], rows: &Markup) -> Markup {
    html! {
        div.scroll role="region" aria-label=(label) tabindex="0" {
            table.history {
                thead { tr { @for column in columns { th scope="col" { (column) } } } }
                tbody { (rows) }
            }
        }
    }
}

/// What all pages of admins have: their title, and the way to the others.
fn around(visitor: &Visitor, title: &str, main: &Markup) -> Markup {
    page(
        Some(visitor),
        title,
        &html! {
            section.head {
                p.crumb {
                    a href="/admin" { "Benchmarks" } " · " a href="/admin/submissions" { "Submissions" } " · "
                    a href="/admin/audit" { "Audit log" }
                }
                h1 { (title) }
            }
            (main)
        },
    )
}
