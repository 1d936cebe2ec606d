//! LaTeX, with the package booktabs; tables longer than a page also take longtable.

use crate::formats::markdown::MISSING;
use crate::report::Report;
use crate::table::{Row, RowKind, Table};

/// More rows than this do not fit on a page.
const LONGEST: usize = 40;

/// More columns than this do not fit beside a second column of text.
const WIDEST: usize = 8;

/// The tables, one after the other, to be included in a document.
pub fn write(report: &Report<'_>) -> String {
    let is_long = report.tables.iter().any(|table| table.rows.len() > LONGEST);
    let packages = if is_long { "\\usepackage{booktabs,longtable}" } else { "\\usepackage{booktabs}" };
    let mut text = format!("% Needs {packages}\n");
    for record in &report.results.records {
        text += &format!("% {}: {}\n", one_line(&record.job.id), one_line(&record.told()));
    }
    for table in &report.tables {
        text += "\n";
        text += &whole(report, table);
    }
    text
}

fn whole(report: &Report<'_>, table: &Table) -> String {
    let (words, groups) = (table.stubs.len(), table.groups.len());
    let columns = format!("{}{}", "l".repeat(words), "rr".repeat(groups));
    let caption =
        escape(&format!("{} ({}): PSNR in dB and SSIM.", report.kind.title(), table.title.to_lowercase()));
    let label = format!("tab:{}-{}", report.kind.name(), table.title.to_lowercase());
    let notes: Vec<String> = report.unfinished().into_iter().chain(report.notes.iter().cloned()).collect();
    let notes = escape(&notes.join(" "));
    let (head, body) = (head(table), rows(table));
    if table.rows.len() > LONGEST {
        return format!(
            "{{\\footnotesize\n\\begin{{longtable}}{{{columns}}}\n\\caption{{{caption}}}\\label{{{label}}}\\\\\n{head}\\endfirsthead\n\
             {head}\\endhead\n{body}\\bottomrule\n\\end{{longtable}}\n\\noindent\\scriptsize {notes}\\par}}\n"
        );
    }
    let float = if words + 2 * groups > WIDEST { "table*" } else { "table" };
    format!(
        "\\begin{{{float}}}\n\\centering\n\\caption{{{caption}}}\\label{{{label}}}\n\\footnotesize\n\\setlength{{\\tabcolsep}}{{4pt}}\n\
         \\begin{{tabular}}{{{columns}}}\n{head}{body}\\bottomrule\n\\end{{tabular}}\n\\par\\smallskip\n\
         \\parbox{{\\linewidth}}{{\\scriptsize {notes}}}\n\\end{{{float}}}\n"
    )
}

fn head(table: &Table) -> String {
    let words = table.stubs.len();
    let mut groups = vec![String::new(); words];
    let mut rules = String::new();
    for (i, group) in table.groups.iter().enumerate() {
        groups.push(format!("\\multicolumn{{2}}{{c}}{{{}}}", escape(group)));
        let first = words + 2 * i + 1;
        rules += &format!("\\cmidrule(lr){{{first}-{}}}", first + 1);
    }
    let scores = table.groups.iter().flat_map(|_| ["PSNR".to_owned(), "SSIM".to_owned()]);
    let names: Vec<String> = table.stubs.iter().map(|stub| escape(stub)).chain(scores).collect();
    format!("\\toprule\n{} \\\\\n{rules}\n{} \\\\\n\\midrule\n", groups.join(" & "), names.join(" & "))
}

fn rows(table: &Table) -> String {
    let mut text = String::new();
    let mut before: Option<&Row> = None;
    for row in &table.rows {
        if row.begins && before.is_some() {
            text += "\\midrule\n";
        }
        // The first column says only once what a block is about.
        let again = !row.begins && table.stubs.len() == 2;
        before = Some(row);
        let mut cells: Vec<String> = row.stubs.iter().map(|stub| escape(stub)).collect();
        if let Some(first) = cells.first_mut().filter(|_| again) {
            first.clear();
        }
        for (group, entry) in row.entries.iter().enumerate() {
            let best = entry.as_ref().map_or([false; 2], |entry| entry.best);
            let Some(told) = row.told(group) else {
                cells.extend([escape(MISSING), escape(MISSING)]);
                continue;
            };
            cells.extend(told.iter().zip(best).map(|(number, best)| match row.kind {
                RowKind::Published => format!("\\textit{{{}}}", escape(number)),
                _ if best => format!("\\textbf{{{}}}", escape(number)),
                _ => escape(number),
            }));
        }
        text += &format!("{} \\\\\n", cells.join(" & "));
    }
    text
}

fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// A text that means itself, in ASCII as far as the tables' own signs go.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => escaped.extend(['\\', c]),
            '\\' => escaped += "\\textbackslash{}",
            '~' => escaped += "\\textasciitilde{}",
            '^' => escaped += "\\textasciicircum{}",
            '<' => escaped += "\\textless{}",
            '>' => escaped += "\\textgreater{}",
            '|' => escaped += "\\textbar{}",
            '"' => escaped += "\\textquotedbl{}",
            '±' => escaped += "$\\pm$",
            '∞' => escaped += "$\\infty$",
            '–' => escaped += "--",
            '✓' => escaped += "$\\bullet$",
            '·' => {}
            'γ' => escaped += "$\\gamma$",
            'Ψ' => escaped += "$\\Psi$",
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
        assert_eq!(
            escape("50%_of {a}\\b^~"),
            "50\\%\\_of \\{a\\}\\textbackslash{}b\\textasciicircum{}\\textasciitilde{}"
        );
        assert_eq!(escape("25.1 ± 0.2 – ∞"), "25.1 $\\pm$ 0.2 -- $\\infty$");
        assert_eq!(one_line("a\n\\end{x}"), "a \\end{x}");
    }
}
