//! The page of a submission: how it is scored and, once it is, of its method.

use maud::{Markup, html};
use relight_scene::Split;

use super::board::{links, split_title};
use super::shell::{Visitor, alert, form_token, moment, page, size};
use crate::Progress;
use crate::disclosure::{ToldImage, ToldMean, ToldScores};
use crate::leaderboard::{Metric, percent_encoded};
use crate::method::{Method, Phase, Visibility};
use crate::store::State;
use crate::submission::Problem;

/// A submission as whoever looks at it may see it.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Its name.
    pub id: String,
    /// The benchmark's name.
    pub benchmark: String,
    /// What is said of it; all but the name is empty if that is kept from whoever looks.
    pub method: Method,
    /// Whose it is; empty if that is kept from whoever looks.
    pub user: String,
    /// Whether it is pinned as a baseline.
    pub baseline: bool,
    /// Which images it is about.
    pub phase: Phase,
    /// Who sees it.
    pub visibility: Visibility,
    /// How far it is.
    pub state: State,
    /// How far scoring is.
    pub progress: Option<Progress>,
    /// When it was taken in, RFC 3339.
    pub submitted_at: String,
    /// Why it was refused.
    pub reason: String,
    /// What is wrong with its zip.
    pub problems: Vec<Problem>,
    /// Further problems that are not listed.
    pub more_problems: usize,
    /// Its scores, as they are told.
    pub scores: Option<ToldScores>,
    /// Its pictures.
    pub pictures: Vec<Pictures>,
    /// What only its user sees.
    pub own: Option<Own>,
}

/// The pictures of a validation image: names of files under the submission's `pictures/`.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// Scene, camera, light and scores.
    pub image: ToldImage,
    /// Width and height.
    pub size: (u32, u32),
    /// What was submitted.
    pub submitted: String,
    /// The photograph.
    pub truth: String,
    /// Where it errs.
    pub error: String,
}

/// What only its user sees of a submission.
#[derive(Clone, Debug)]
pub struct Own {
    /// SHA-256 of the zip, in hexadecimal digits.
    pub sha256: String,
    /// Bytes of the zip.
    pub bytes: u64,
    /// Whether an admin has hidden it.
    pub hidden: bool,
    /// Whether it is withdrawn.
    pub withdrawn: bool,
}

/// The page of a submission. `message` is shown above all.
pub fn entry(visitor: &Visitor, shown: &Shown, message: &str) -> Markup {
    let base = format!("/submissions/{}", percent_encoded(&shown.id));
    let board = format!("/benchmarks/{}", percent_encoded(&shown.benchmark));
    page(
        Some(visitor),
        &shown.method.name,
        &html! {
            section.head {
                p.crumb {
                    a href="/" { "Benchmarks" } " / " a href=(board) { bdi { (shown.benchmark) } }
                }
                h1 dir="auto" { (shown.method.name) }
                p.facts {
                    @if shown.baseline { span.tag { "baseline" } " " }
                    @if shown.own.is_some() { (visibility_tag(shown.visibility)) " " }
                    (moment(&shown.submitted_at)) " "
                    @if !shown.method.authors.is_empty() { bdi { (shown.method.authors) } " " }
                    @if shown.user.is_empty() { span { "by someone who stays anonymous" } }
                    @else { span { "entered by " bdi { (shown.user) } } }
                }
            }
            (alert(message))
            (state(shown))
            @if !shown.method.description.is_empty() { p.description dir="auto" { (shown.method.description) } }
            (about(&shown.method))
            @if let Some(scores) = &shown.scores {
                (score_tables(scores))
                (pictures(&base, &shown.pictures))
                p.downloads {
                    a href=(format!("{base}/receipt.json")) { "Signed receipt" }
                    " — the scores, the zip’s SHA-256 and the evaluator, under this server’s key"
                }
            }
            @if let Some(own) = &shown.own { (own_section(visitor, &base, shown, own)) }
        },
    )
}

/// How far a submission is. A script replaces it by what it has become, until it says that it is final.
fn state(shown: &Shown) -> Markup {
    let waiting = matches!(shown.state, State::Queued | State::Scoring);
    html! {
        section.state #state aria-live="polite" data-waiting=[waiting.then_some("")] {
            @match shown.state {
                State::Queued => {
                    h2 { "Waiting" }
                    p { "The zip is safely stored and waits for its turn to be scored. You may close this page." }
                }
                State::Scoring => {
                    h2 { "Scoring" }
                    @if let Some(Progress { done, all, .. }) = shown.progress {
                        progress max=(all) value=(done) { (done) " of " (all) }
                        p { (done) " of " (all) " images" }
                    } @else {
                        progress {}
                        p { "Starting" }
                    }
                }
                State::Refused => {
                    h2 { "Refused" }
                    p.alert role="alert" { bdi { (shown.reason) } }
                    @if !shown.problems.is_empty() {
                        p { "It costs nothing: mend this, then submit again." }
                        ul.problems {
                            @for problem in &shown.problems { li dir="auto" { (problem) } }
                            @if shown.more_problems > 0 { li { "and " (shown.more_problems) " more" } }
                        }
                    }
                }
                State::Scored => {}
            }
            @if waiting { noscript { meta http-equiv="refresh" content="3"; } }
        }
    }
}

fn about(method: &Method) -> Markup {
    let facts = [("Hardware", &method.hardware), ("Training time per scene", &method.training_time)];
    let has_links = !method.paper.is_empty() || !method.code.is_empty();
    html! {
        @if has_links || facts.iter().any(|(_, text)| !text.is_empty()) {
            dl.about {
                @for (name, text) in facts {
                    @if !text.is_empty() { div { dt { (name) } dd dir="auto" { (text) } } }
                }
                @if has_links { div { dt { "Links" } dd { (links(&method.paper, &method.code)) } } }
            }
        }
    }
}

fn score_tables(scores: &ToldScores) -> Markup {
    let splits: Vec<Split> = scores.means.iter().map(|mean| mean.split).collect();
    let of = |means: &[ToldMean], split: Split| means.iter().find(|mean| mean.split == split).copied();
    let cells = |mean: Option<ToldMean>| {
        html! {
            @if let Some(mean) = mean {
                td.number { (Metric::Psnr.show(mean.psnr)) }
                td.number { (Metric::Ssim.show(Some(mean.ssim))) }
            } @else { td.number { "–" } td.number { "–" } }
        }
    };
    html! {
        h2 { "Scores" }
        div.scroll role="region" aria-label="Scores by scene" tabindex="0" {
            table.scores {
                thead {
                    tr {
                        th scope="col" rowspan="2" { "Scene" }
                        @for split in &splits { th scope="colgroup" colspan="2" { (split_title(*split).0) } }
                    }
                    tr { @for _ in &splits { th.number scope="col" { "PSNR" } th.number scope="col" { "SSIM" } } }
                }
                tbody {
                    @for scene in &scores.scenes {
                        tr {
                            th scope="row" { bdi { (scene.scene) } }
                            @for split in &splits { (cells(of(&scene.means, *split))) }
                        }
                    }
                }
                tfoot {
                    tr {
                        th scope="row" { "Mean" }
                        @for split in &splits { (cells(of(&scores.means, *split))) }
                    }
                }
            }
        }
    }
}

fn pictures(base: &str, pictures: &[Pictures]) -> Markup {
    let address = |file: &str| format!("{base}/pictures/{}", percent_encoded(file));
    html! {
        @if !pictures.is_empty() {
            h2 { "Pictures" }
            p.note {
                "One validation image of each scene, whose photographs are public. Drag the handle, or use the arrow keys, to "
                "compare; the error map is brighter where the two differ more."
            }
            div.pictures {
                @for one in pictures {
                    @let image = &one.image;
                    @let (width, height) = one.size;
                    figure {
                        figcaption {
                            strong { bdi { (image.scene) } } " camera " (image.camera) ", light " (image.light) ": "
                            (Metric::Psnr.show(image.psnr)) " dB, " (Metric::Ssim.show(Some(image.ssim)))
                        }
                        div.trio {
                            div.compare data-compare="" {
                                div.pane {
                                    img src=(address(&one.truth)) alt=(format!("Photograph of {}", image.scene))
                                        width=(width) height=(height) loading="lazy" decoding="async";
                                    span.label { "Photograph" }
                                }
                                div.pane.over {
                                    img src=(address(&one.submitted)) alt=(format!("Submitted picture of {}", image.scene))
                                        width=(width) height=(height) loading="lazy" decoding="async";
                                    span.label { "Submitted" }
                                }
                            }
                            div.pane {
                                img src=(address(&one.error)) alt=(format!("Error map of {}", image.scene))
                                    width=(width) height=(height) loading="lazy" decoding="async";
                                span.label { "Error" }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Who sees a submission, as a word.
pub fn visibility_tag(visibility: Visibility) -> Markup {
    html! { span.tag { (visibility) } }
}

/// What the three choices mean.
pub const VISIBILITIES: [(Visibility, &str); 3] = [
    (Visibility::Public, "on the leaderboard, with all that you say of it"),
    (Visibility::Anonymous, "on the leaderboard, with the method’s name alone"),
    (Visibility::Private, "for you alone"),
];

fn own_section(visitor: &Visitor, base: &str, shown: &Shown, own: &Own) -> Markup {
    html! {
        section.own {
            h2 { "Yours alone" }
            @if own.hidden { p.alert { "The hosts have hidden this submission. Ask them why." } }
            @if own.withdrawn { p.alert { "Withdrawn: nobody but you sees it." } }
            dl.about {
                div { dt { "Submission" } dd { code { (shown.id) } } }
                div { dt { "Zip" } dd { (size(own.bytes)) } }
                div { dt { "SHA-256" } dd { code.hash { (own.sha256) } } }
            }
            @if !own.withdrawn {
                form.row method="post" action=(format!("{base}/visibility")) {
                    (form_token(visitor))
                    label for="to" { "Who sees it" }
                    select #to name="to" {
                        @for (visibility, meaning) in VISIBILITIES {
                            option value=(visibility) selected[visibility == shown.visibility] {
                                (visibility) ": " (meaning)
                            }
                        }
                    }
                    button { "Change" }
                }
                details {
                    summary { "Withdraw" }
                    form.row method="post" action=(format!("{base}/withdraw")) {
                        (form_token(visitor))
                        p {
                            "It leaves the leaderboard for good, and its zip and pictures are deleted. Scores that you have seen "
                            "keep counting against your quota."
                        }
                        button.danger { "Withdraw for good" }
                    }
                }
            }
        }
    }
}
