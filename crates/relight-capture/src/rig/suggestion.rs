//! What a mistyped key was meant to be.

/// The parser's message, and the name that the mistyped one is likely to be. The parser quotes in backticks the name that it
/// does not know, and then those that it does.
pub fn with_suggestion(message: &str) -> String {
    let message = message.trim_end();
    let is_unknown = message.contains("unknown field") || message.contains("unknown variant");
    // The parser also shows the line, which may hold backticks of its own: what follows "unknown" counts.
    let quoted = message.split_once("unknown ").map_or("", |(_, rest)| rest);
    let mut names = quoted.split('`').skip(1).step_by(2);
    let nearest = names.next().and_then(|wrong| {
        let near = names
            .map(|name| (edits(wrong, name), name))
            .filter(|(edits, name)| is_likely(*edits, wrong, name));
        near.min()
    });
    match nearest {
        Some((_, name)) if is_unknown => format!("{message}; did you mean `{name}`?"),
        _ => message.to_owned(),
    }
}

/// Few mistakes for its length, or a name that was left unfinished.
fn is_likely(edits: usize, wrong: &str, name: &str) -> bool {
    3 * edits <= wrong.len().max(3) || (wrong.len() > 2 && name.starts_with(wrong))
}

/// Letters to insert, remove or replace to turn one word into another (Levenshtein 1966).
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, other) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(letter != *other);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_counted() {
        for (a, b, n) in [("", "", 0), ("kitten", "sitting", 3), ("", "abc", 3), ("flaw", "lawn", 2)] {
            assert_eq!((edits(a, b), edits(b, a)), (n, n));
        }
    }

    #[test]
    fn messages_without_an_unknown_name_stay() {
        assert_eq!(with_suggestion("missing field `size`"), "missing field `size`");
        assert_eq!(
            with_suggestion("unknown field `xyz`, there are no fields"),
            "unknown field `xyz`, there are no fields"
        );
    }
}
