//! Markdown, which can be read as it is.

use crate::report::Report;
use crate::table::{Row, RowKind, Table};

/// What stands where there are no scores.
pub(crate) const MISSING: &str = "–";

/// The tables, one below the other, and the notes.
pub fn write(report: &Report<'_>) -> String {
    let mut text = format!("# {}\n", report.kind.title());
    if let Some(unfinished) = report.unfinished() {
        text += &format!("\n**{unfinished}**\n");
    }
    for table in &report.tables {
        if report.tables.len() > 1 {
            text += &format!("\n## {}\n", table.title);
        }
        text += "\n";
        text += &aligned(table);
    }
    text += "\n";
    for note in &report.notes {
        text += &format!("- {}\n", escape(note));
    }
    text
}

fn aligned(table: &Table) -> String {
    let words = table.stubs.len();
    let scores = table.groups.iter().flat_map(|g| [format!("{g} PSNR"), "SSIM".to_owned()]);
    let head: Vec<String> = table.stubs.iter().cloned().chain(scores).map(|cell| escape(&cell)).collect();
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(table.rows.iter().map(cells)).collect();
    let columns = words + 2 * table.groups.len();
    let width = |column: usize| {
        rows.iter()
            .filter_map(|row| row.get(column))
            .map(|cell| cell.chars().count())
            .max()
            .unwrap_or(0)
            .max(3)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for (i, row) in rows.iter().enumerate() {
        text += "|";
        for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
            text += &if column < words { format!(" {cell:<width$} |") } else { format!(" {cell:>width$} |") };
        }
        text += "\n";
        if i == 0 {
            text += "|";
            for (column, width) in widths.iter().enumerate() {
                let rule = "-".repeat(width + 1);
                text += &if column < words { format!("{rule}-|") } else { format!("{rule}:|") };
            }
            text += "\n";
        }
    }
    text
}

fn cells(row: &Row) -> Vec<String> {
    let mut cells: Vec<String> = row.stubs.iter().map(|stub| escape(stub)).collect();
    for (group, entry) in row.entries.iter().enumerate() {
        let best = entry.as_ref().map_or([false; 2], |entry| entry.best);
        match row.told(group) {
            Some(told) => cells.extend(told.into_iter().zip(best).map(|(number, best)| match row.kind {
                RowKind::Published => format!("*{number}*"),
                _ if best => format!("**{number}**"),
                _ => number,
            })),
            None => cells.extend([MISSING.to_owned(), MISSING.to_owned()]),
        }
    }
    cells
}

/// A text that means itself.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\\' | '`' | '*' | '_' | '[' | ']' | '<' | '>' | '|' | '#' | '~' => escaped.extend(['\\', c]),
            c if c.is_control() => escaped.push(' '),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_mean_themselves() {
        assert_eq!(escape("a|b_c*\n<i>"), "a\\|b\\_c\\* \\<i\\>");
        assert_eq!(escape("γ(R,t) 25.1 ± 0.2"), "γ(R,t) 25.1 ± 0.2");
    }
}
