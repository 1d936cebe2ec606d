//! What someone has submitted, and the form to submit more.

use maud::{Markup, html};

use super::entry::{VISIBILITIES, visibility_tag};
use super::home::plural;
use super::shell::{Visitor, alert, form_token, moment, page};
use crate::leaderboard::{Metric, percent_encoded};
use crate::method::{Phase, Visibility};
use crate::store::{QuotaUse, State};

/// A submission in the list of its user.
#[derive(Clone, Debug)]
pub struct Line {
    /// Its name.
    pub id: String,
    /// The benchmark's name.
    pub benchmark: String,
    /// The method's name.
    pub method: String,
    /// Which images it is about.
    pub phase: Phase,
    /// Who sees it.
    pub visibility: Visibility,
    /// How far it is.
    pub state: State,
    /// When it was taken in, RFC 3339.
    pub submitted_at: String,
    /// Whether it is withdrawn.
    pub withdrawn: bool,
    /// Mean scores as told: of each split its name, PSNR and SSIM.
    pub means: Vec<(String, Option<f64>, f64)>,
}

/// Which part of a list is shown, from 1, and whether another follows.
#[derive(Clone, Copy, Debug)]
pub struct Pages {
    /// The part.
    pub page: u32,
    /// Whether there are older ones.
    pub has_more: bool,
}

/// The ways from this part of a list to those beside it.
pub fn parts(Pages { page, has_more }: Pages) -> Markup {
    html! {
        @if page > 1 || has_more {
            nav.actions aria-label="Parts of the list" {
                @if page > 1 { a href=(format!("?page={}", page - 1)) rel="prev" { "Newer" } " " }
                @if has_more { a href=(format!("?page={}", page.saturating_add(1))) rel="next" { "Older" } }
            }
        }
    }
}

/// Submissions of a user, newest first; `benchmarks` are those that they may submit to.
pub fn history(visitor: &Visitor, lines: &[Line], pages: Pages, benchmarks: &[String]) -> Markup {
    page(
        Some(visitor),
        "My submissions",
        &html! {
            section.head {
                h1 { "My submissions" }
                p.actions {
                    @for name in benchmarks {
                        a.button href=(format!("/benchmarks/{}/upload", percent_encoded(name))) { "Submit to " bdi { (name) } } " "
                    }
                }
            }
            @if lines.is_empty() {
                p.empty { "Nothing yet." }
            } @else {
                div.scroll role="region" aria-label="Submissions" tabindex="0" {
                    table.history {
                        thead { tr {
                            th scope="col" { "Method" } th scope="col" { "Benchmark" } th scope="col" { "Phase" }
                            th scope="col" { "State" } th scope="col" { "Scores" } th scope="col" { "Seen by" }
                            th scope="col" { "Date" }
                        } }
                        tbody {
                            @for line in lines {
                                tr {
                                    th scope="row" {
                                        a href=(format!("/submissions/{}", percent_encoded(&line.id))) dir="auto" { (line.method) }
                                    }
                                    td { a href=(format!("/benchmarks/{}", percent_encoded(&line.benchmark))) { bdi { (line.benchmark) } } }
                                    td { (line.phase) }
                                    td { span.state-tag data-state=(line.state) { (line.state) } }
                                    td.means {
                                        @for (split, psnr, ssim) in &line.means {
                                            span { (split) " " (Metric::Psnr.show(*psnr)) " / " (Metric::Ssim.show(Some(*ssim))) } " "
                                        }
                                    }
                                    td { @if line.withdrawn { span.tag { "withdrawn" } } @else { (visibility_tag(line.visibility)) } }
                                    td.date { (moment(&line.submitted_at)) }
                                }
                            }
                        }
                    }
                }
            }
            (parts(pages))
        },
    )
}

/// The form to upload a zip to a benchmark, with what the quotas of the two phases leave.
pub fn upload(
    visitor: &Visitor,
    benchmark: &str,
    open: bool,
    quotas: [(Phase, QuotaUse); 2],
    problem: &str,
) -> Markup {
    let base = format!("/benchmarks/{}", percent_encoded(benchmark));
    let line = |id: &str, label: &str, about: &str, kind: &str, required: bool| {
        html! {
            label for=(id) { (label) @if !about.is_empty() { small { (about) } } }
            input id=(id) name=(id) type=(kind) maxlength="200" required[required];
        }
    };
    page(
        Some(visitor),
        "Submit",
        &html! {
            section.head {
                p.crumb { a href="/" { "Benchmarks" } " / " a href=(base) { bdi { (benchmark) } } }
                h1 { "Submit" }
                p { a href=(format!("{base}/submit")) { "What the zip must hold" } }
            }
            (alert(problem))
            @if !open { p.alert { "This benchmark takes no submissions any more." } }
            // The zip comes last: all that is said of it must be known before it streams in.
            form.stack.upload method="post" action=(format!("{base}/upload")) enctype="multipart/form-data" data-upload="" {
                (form_token(visitor))
                fieldset {
                    legend { "Images" }
                    @for (index, (phase, usage)) in quotas.iter().enumerate() {
                        @let id = format!("phase-{phase}");
                        div.choice {
                            input id=(id) type="radio" name="phase" value=(phase) checked[index == 0];
                            label for=(id) {
                                @match phase {
                                    Phase::Val => { "Validation, whose photographs are public" }
                                    Phase::Test => { "Test, easy and hard (and validation, if the zip has it)" }
                                }
                                small {
                                    (usage.quota.per_day.saturating_sub(usage.used_in_day)) " of "
                                    (plural(usage.quota.per_day as usize, "submission")) " left in these 24 hours, "
                                    (usage.quota.total.saturating_sub(usage.used)) " in all"
                                }
                            }
                        }
                    }
                }
                fieldset {
                    legend { "Method" }
                    (line("method", "Name", "", "text", true))
                    (line("authors", "Authors", "", "text", false))
                    label for="description" { "Description" small { "A few words; optional, as all that follows." } }
                    textarea #description name="description" rows="3" maxlength="4000" {}
                    (line("paper", "Paper", "An address.", "url", false))
                    (line("code", "Code", "An address.", "url", false))
                    (line("hardware", "Hardware", "", "text", false))
                    (line("training_time", "Training time per scene", "", "text", false))
                }
                fieldset {
                    legend { "Seen by" }
                    @for (index, (visibility, meaning)) in VISIBILITIES.iter().enumerate() {
                        @let id = format!("visibility-{visibility}");
                        div.choice {
                            input id=(id) type="radio" name="visibility" value=(visibility) checked[index == 0];
                            label for=(id) { (visibility) small { (meaning) } }
                        }
                    }
                }
                fieldset {
                    legend { "Zip" }
                    label.hidden for="zip" { "Zip file" }
                    input #zip type="file" name="zip" accept=".zip,application/zip" required;
                }
                button { "Upload" }
                div.sending role="status" hidden {
                    progress max="1" {}
                    p {}
                }
            }
        },
    )
}
