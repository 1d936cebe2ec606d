//! How to submit.

use maud::{Markup, html};

use super::home::plural;
use super::shell::{Visitor, page};
use crate::leaderboard::percent_encoded;
use crate::store::{BenchmarkEntry, Quota};

/// How to submit to a benchmark. `server` is this server's address, as commands need it.
pub fn guide(visitor: &Visitor, benchmark: &BenchmarkEntry, server: &str) -> Markup {
    let base = format!("/benchmarks/{}", percent_encoded(&benchmark.name));
    let scene = benchmark.scenes.first();
    let name = scene.map_or("scene", |scene| scene.name.as_str());
    let (width, height) = scene.map_or((0, 0), |scene| (scene.width, scene.height));
    let sum =
        |count: fn(&crate::store::SceneEntry) -> usize| benchmark.scenes.iter().map(count).sum::<usize>();
    let (val, test) = (sum(|scene| scene.val), sum(|scene| scene.easy + scene.hard));
    page(
        Some(visitor),
        "How to submit",
        &html! {
            section.head {
                p.crumb {
                    a href="/" { "Benchmarks" } " / " a href=(base) { bdi { (benchmark.name) } }
                }
                h1 { "How to submit" }
                p.lead { "Train on what is public, draw the images that are asked for, send them as a zip." }
            }
            div.prose {
                h2 { "1. Get a token" }
                p {
                    @if visitor.name.is_some() { "Make a token on " a href="/account" { "your account’s page" } }
                    @else { a href="/sign-up" { "Sign up" } ", then make a token on your account’s page" }
                    ". It is shown once; keep it like a password. Uploading " a href=(format!("{base}/upload")) { "on this site" }
                    " needs none."
                }
                h2 { "2. Make the zip" }
                p { "With runs of " code { "relight train" } ":" }
                pre tabindex="0" { code {
                    "relight submit pack RUNS… --out submission.zip\n"
                    "relight submit check submission.zip --scenes DIR"
                } }
                p {
                    "The check is exactly this server’s, and needs no network. With anything else: a zip with PNG images at its root, called "
                    code { "{scene}_{light:02}_{camera:02}.png" } ", such as " code { (name) "_02_04.png" } ", of 8-bit RGB without "
                    "transparency, at full size (" (width) " × " (height) ")."
                }
                ul {
                    li {
                        strong { "Validation: " } (plural(val, "image")) ". Scored at once, with all digits, error maps and pictures. "
                        (quota(benchmark.val))
                    }
                    li {
                        strong { "Test: " } (plural(test, "image")) " of the easy and hard splits, with or without the validation images. "
                        "The photographs are hidden; scores are told to the digits of the table. " (quota(benchmark.test))
                    }
                }
                p { "Whatever is sent must be whole: all validation images or none, all test images or none. A zip that is refused costs nothing." }
                h2 { "3. Send it" }
                pre tabindex="0" { code {
                    "relight submit send submission.zip --to " (server) " --benchmark " (benchmark.name) " --token TOKEN"
                } }
                p { "Without " code { "relight" } ", by any program that speaks HTTP:" }
                pre tabindex="0" { code {
                    "curl --fail-with-body -X POST --upload-file submission.zip \\\n"
                    "  -H 'Authorization: Bearer TOKEN' \\\n"
                    "  '" (server) "/api/v1" (base) "/submissions?method=NAME&phase=test'\n"
                    "curl -H 'Authorization: Bearer TOKEN' " (server) "/api/v1/submissions/ID"
                } }
                h2 { "What is fair" }
                ul {
                    li { "Test cameras and test lights are never trained on, nor are training cameras under test lights." }
                    li { "One set of settings for all scenes; the test scores are no place to tune them." }
                    li { "A private or anonymous entry can be made public later." }
                }
            }
        },
    )
}

fn quota(quota: Quota) -> Markup {
    let Quota { per_day, total, gap_seconds } = quota;
    html! {
        "At most " (per_day) " in 24 hours, " (total) " in all"
        @if gap_seconds > 0 { ", " (gap_seconds) " s apart" }
        "."
    }
}
