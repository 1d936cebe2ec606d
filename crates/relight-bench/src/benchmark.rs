//! The paper's second table: every scene, on easy and hard.

use crate::ablation::{kind, title};
use crate::results::{Method, Results};
use crate::scoring::SPLITS;
use crate::table::{Row, RowKind, Table};

/// A block of rows a scene, a row a method, then the means over the scenes.
pub(crate) fn tables(results: &Results) -> Vec<Table> {
    let methods = results.methods();
    let mut rows = Vec::new();
    for (scene, _) in &results.scenes {
        rows.extend(block(scene, &methods, |method| {
            SPLITS.map(|split| results.entry(scene, method, split)).into()
        }));
    }
    if results.scenes.len() > 1 {
        rows.extend(block("Mean", &methods, |method| SPLITS.map(|split| results.mean(method, split)).into()));
    }
    let mut table = Table {
        title: "Scenes".to_owned(),
        stubs: vec!["Scene".to_owned(), "Method".to_owned()],
        groups: SPLITS.map(|split| title(split).to_owned()).into(),
        rows,
    };
    table.mark_best();
    vec![table]
}

fn block(
    name: &str,
    methods: &[Method],
    entries: impl Fn(&Method) -> Vec<Option<crate::table::Entry>>,
) -> Vec<Row> {
    let rows = methods.iter().map(|method| Row {
        stubs: vec![name.to_owned(), method.name()],
        kind: kind(method),
        begins: false,
        entries: entries(method),
    });
    let mut rows: Vec<Row> = rows
        .filter(|row| row.kind != RowKind::Published || row.entries.iter().any(Option::is_some))
        .collect();
    if let Some(first) = rows.first_mut() {
        first.begins = true;
    }
    rows
}
