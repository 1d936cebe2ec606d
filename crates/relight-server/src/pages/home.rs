//! The first page: which benchmarks there are.

use maud::{Markup, html};
use relight_scene::Split;

use super::shell::{Visitor, page};
use crate::leaderboard::percent_encoded;

/// A benchmark in the list.
#[derive(Clone, Debug)]
pub struct Card {
    /// Its name.
    pub name: String,
    /// Its scenes.
    pub scenes: usize,
    /// Images that are scored.
    pub images: usize,
    /// Width and height of the first.
    pub size: (u32, u32),
    /// Whether it takes submissions.
    pub open: bool,
    /// Entries that everyone sees, baselines aside.
    pub entries: usize,
    /// The best of a split: the split, the method, its PSNR as tables show it.
    pub best: Option<(Split, String, String)>,
}

/// The list of all benchmarks.
pub fn home(visitor: &Visitor, benchmarks: &[Card]) -> Markup {
    page(
        Some(visitor),
        "Benchmarks",
        &html! {
            section.hero {
                h1 { "Who relights best?" }
                p.lead {
                    "Photographs of a scene from many places, under one light at a time, go in; pictures from places and under lights "
                    "that nobody has shown the method come out. This server scores them against photographs that are kept back."
                }
            }
            @if benchmarks.is_empty() {
                p.empty { "There is no benchmark yet. The host adds one with " code { "relight serve admin add-benchmark" } "." }
            }
            ul.cards {
                @for card in benchmarks { li { (benchmark(card)) } }
            }
        },
    )
}

fn benchmark(card: &Card) -> Markup {
    let address = format!("/benchmarks/{}", percent_encoded(&card.name));
    html! {
        article.card {
            h2 { a href=(address) { bdi { (card.name) } } @if !card.open { " " span.tag { "closed" } } }
            p.facts {
                span { (plural(card.scenes, "scene")) } " "
                span { (plural(card.images, "image")) " of " (card.size.0) " × " (card.size.1) } " "
                span { (plural(card.entries, "entry")) }
            }
            @if let Some((split, method, psnr)) = &card.best {
                p.best {
                    "Best on " (split) ": " bdi { strong { (method) } } ", " (psnr) " dB"
                }
            } @else {
                p.best { "No entry yet: be the first." }
            }
            p.links {
                a href=(address) { "Leaderboard" } " "
                a href=(format!("{address}/submit")) { "How to submit" }
            }
        }
    }
}

/// A number and its noun.
pub fn plural(number: usize, noun: &str) -> String {
    match (number, noun.strip_suffix('y')) {
        (1, _) => format!("1 {noun}"),
        (_, Some(stem)) => format!("{number} {stem}ies"),
        _ => format!("{number} {noun}s"),
    }
}
