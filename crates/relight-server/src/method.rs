//! What participants say of a submission.

use serde::{Deserialize, Serialize};

use crate::store::User;
use crate::text::text_enum;

text_enum! {
    /// Which images a submission is about.
    pub enum Phase {
        /// The validation images alone, whose ground truth is public: scored at once, with all digits and error maps.
        Val = "val",
        /// The hidden images, with or without the validation images.
        Test = "test",
    }
}

text_enum! {
    /// Who sees a submission.
    pub enum Visibility {
        /// Everyone, with all that is said of it.
        Public = "public",
        /// Everyone sees scores and the method's name; nobody sees whose it is.
        Anonymous = "anonymous",
        /// Its user alone.
        Private = "private",
    }
}

/// The longest single line, characters.
const LINE: usize = 200;
/// The longest description, characters.
const TEXT: usize = 4000;

/// What a participant says of a method. All but the name may be empty.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Method {
    /// Its name.
    pub name: String,
    /// Who made it.
    #[serde(default)]
    pub authors: String,
    /// A few words.
    #[serde(default)]
    pub description: String,
    /// Where the paper is: an http or https address.
    #[serde(default)]
    pub paper: String,
    /// Where the code is: an http or https address.
    #[serde(default)]
    pub code: String,
    /// What it was trained on.
    #[serde(default)]
    pub hardware: String,
    /// How long training a scene took.
    #[serde(default)]
    pub training_time: String,
}

/// What is wrong with what is said of a method.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {problem}")]
pub struct MethodError {
    /// The field.
    pub field: &'static str,
    /// What is wrong, and the mend.
    pub problem: String,
}

impl Method {
    /// Trims all fields and checks them.
    ///
    /// # Errors
    /// The first field that is missing, too long, holds control characters or, where an address is asked for, is none.
    pub fn checked(mut self) -> Result<Method, MethodError> {
        let fields: [(&'static str, &mut String); 7] = [
            ("method", &mut self.name),
            ("authors", &mut self.authors),
            ("description", &mut self.description),
            ("paper", &mut self.paper),
            ("code", &mut self.code),
            ("hardware", &mut self.hardware),
            ("training_time", &mut self.training_time),
        ];
        for (field, text) in fields {
            *text = text.trim().to_owned();
            let wrong = |problem: String| Err(MethodError { field, problem });
            let longest = if field == "description" { TEXT } else { LINE };
            if field == "method" && text.is_empty() {
                return wrong("give the method a name".into());
            }
            if text.chars().count() > longest {
                return wrong(format!("longer than {longest} characters; shorten it"));
            }
            let line_breaks = field == "description";
            if text.chars().any(|c| unprintable(c) && !(line_breaks && c == '\n')) {
                return wrong("holds control characters; remove them".into());
            }
            if matches!(field, "paper" | "code") && !text.is_empty() && !is_web_address(text) {
                return wrong(format!("{text:?} is no http or https address"));
            }
        }
        Ok(self)
    }

    /// Refuses what would tell everybody whose an anonymous entry is: its method's name is all that is shown of it.
    ///
    /// # Errors
    /// What is wrong, and the mend.
    pub fn check_anonymous(&self, user: &User) -> Result<(), String> {
        if self.name.to_lowercase() == user.name.to_lowercase() {
            return Err(format!(
                "method: {:?} would show whose entry it is, and it stands in the receipt for good; submit with another name of the \
                 method to be anonymous",
                self.name
            ));
        }
        Ok(())
    }
}

/// Characters that do not print, and those that turn the direction of what follows.
pub(crate) fn unprintable(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{2069}' | '\u{feff}')
}

/// Whether `text` is an address that a link may lead to: http or https, a host, nothing that ends an attribute.
fn is_web_address(text: &str) -> bool {
    let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let bad = |c: char| c.is_whitespace() || matches!(c, '"' | '\'' | '<' | '>' | '`' | '\\');
    rest.is_some_and(|rest| !rest.is_empty() && !rest.starts_with('/') && !rest.contains(bad))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_asked_for_and_links_lead_to_the_web() {
        let method =
            |name: &str, paper: &str| Method { name: name.into(), paper: paper.into(), ..Method::default() };
        assert_eq!(method("  V5 ", "https://arxiv.org/abs/1").checked().unwrap().name, "V5");
        for (wrong, field) in [
            (method(" ", ""), "method"),
            (method("a\u{202e}b", ""), "method"),
            (method("a\nb", ""), "method"),
            (method(&"x".repeat(201), ""), "method"),
            (method("a", "javascript:alert(1)"), "paper"),
            (method("a", "https://a\" onclick=\"x"), "paper"),
            (method("a", "https:///etc"), "paper"),
        ] {
            assert_eq!(wrong.clone().checked().unwrap_err().field, field, "{wrong:?}");
        }
    }
}
