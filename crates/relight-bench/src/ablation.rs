//! The paper's first table: what each change of the architecture brings.

use relight_field::architecture::{Architecture, EmbeddingEntry, LightInput};
use relight_scene::Split;

use crate::results::{Method, Results};
use crate::scoring::SPLITS;
use crate::table::{Row, RowKind, Table};

/// What of an architecture the paper's table names: the light's pose, the direction to it, `h(x)` given to the colour
/// network, where `e` enters, and visibility.
const FEATURES: [&str; 5] = ["γ(R,t)", "l", "skip", "inputs", "Ψvis"];

/// One table a split that has scores: a row a model, scenes side by side, as the paper has it for validation.
pub(crate) fn tables(results: &Results) -> Vec<Table> {
    let methods = results.methods();
    let table = |split: Split| {
        let mut groups: Vec<String> = results.scenes.iter().map(|(scene, _)| scene.clone()).collect();
        let several = groups.len() > 1;
        if several {
            groups.push("Mean".to_owned());
        }
        let rows = methods.iter().enumerate().map(|(i, method)| {
            let scenes = results.scenes.iter().map(|(scene, _)| results.entry(scene, method, split));
            let mean = several.then(|| results.mean(method, split));
            Row {
                stubs: stubs(method),
                kind: kind(method),
                begins: i == 0 || *method == Method::MeanImage,
                entries: scenes.chain(mean).collect(),
            }
        });
        let rows =
            rows.filter(|row| row.kind != RowKind::Published || row.entries.iter().any(Option::is_some));
        let mut table = Table {
            title: title(split).to_owned(),
            stubs: std::iter::once("Model").chain(FEATURES).map(str::to_owned).collect(),
            groups,
            rows: rows.collect(),
        };
        table.mark_best();
        table
    };
    SPLITS.map(table).into_iter().collect()
}

pub(crate) fn title(split: Split) -> &'static str {
    match split {
        Split::Train => "Training",
        Split::Val => "Validation",
        Split::Easy => "Easy",
        Split::Hard => "Hard",
    }
}

pub(crate) fn kind(method: &Method) -> RowKind {
    match method {
        Method::Model(_) => RowKind::Model,
        Method::Published(_) => RowKind::Published,
        Method::MeanImage | Method::NearestLight => RowKind::Baseline,
    }
}

fn stubs(method: &Method) -> Vec<String> {
    let architecture = match method {
        Method::Model(model) => Architecture::named(model),
        _ => None,
    };
    let features = architecture.map_or([""; 5], |a| {
        [
            a.light == LightInput::Pose,
            a.light == LightInput::Direction,
            a.position_skip,
            a.embedding == EmbeddingEntry::Layer2,
            a.visibility,
        ]
        .map(|has| if has { "✓" } else { "·" })
    });
    std::iter::once(method.name()).chain(features.map(str::to_owned)).collect()
}
