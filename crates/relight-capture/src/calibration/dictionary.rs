//! Dictionaries of square markers.

use calib_targets_charuco::{builtins, resolve_dictionary};
use serde::{Deserialize, Serialize};

/// A dictionary of square binary markers, by OpenCV's names.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Dictionary(calib_targets_charuco::Dictionary);

/// No dictionary has this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no dictionary of markers is called {name:?}; known are {}", Dictionary::names().join(", "))]
pub struct UnknownDictionary {
    /// The name asked for.
    pub name: String,
}

impl Dictionary {
    /// The dictionary that OpenCV calls `name`, such as `DICT_4X4_50`; case and the prefix `DICT_` do not matter.
    ///
    /// # Errors
    /// If there is none: the message lists those that are known.
    pub fn named(name: &str) -> Result<Dictionary, UnknownDictionary> {
        let is_called = |known: &&&str| {
            let short = known.strip_prefix("DICT_").unwrap_or(known);
            known.eq_ignore_ascii_case(name) || short.eq_ignore_ascii_case(name)
        };
        let known = builtins::BUILTIN_DICTIONARY_NAMES.iter().find(is_called);
        known
            .and_then(|known| resolve_dictionary(known))
            .map(Dictionary)
            .ok_or_else(|| UnknownDictionary { name: name.to_owned() })
    }

    /// Names of all dictionaries.
    pub fn names() -> &'static [&'static str] {
        builtins::BUILTIN_DICTIONARY_NAMES
    }

    /// OpenCV's name.
    pub fn name(&self) -> &'static str {
        self.0.name()
    }

    /// How many markers there are.
    pub fn markers(&self) -> usize {
        self.0.codes().len()
    }

    /// Cells along a side of a marker, without its black rim of one cell.
    pub fn cells(&self) -> usize {
        self.0.marker_size()
    }

    /// Whether a cell of a marker is black; the rim, one cell outside, is. `None` beyond the rim or without such a marker.
    pub fn is_black(&self, marker: usize, row: isize, column: isize) -> Option<bool> {
        let code = *self.0.codes().get(marker)?;
        let cells = self.cells() as isize;
        let on_rim = |cell: isize| cell == -1 || cell == cells;
        let is_inside = |cell: isize| (0..cells).contains(&cell);
        match (is_inside(row) && is_inside(column), on_rim(row) || on_rim(column)) {
            (true, _) => Some(code >> (row * cells + column) & 1 == 1),
            (false, true) if (-1..=cells).contains(&row) && (-1..=cells).contains(&column) => Some(true),
            _ => None,
        }
    }

    pub(super) fn codes(&self) -> calib_targets_charuco::Dictionary {
        self.0
    }
}

impl PartialEq for Dictionary {
    fn eq(&self, other: &Dictionary) -> bool {
        self.name() == other.name()
    }
}

impl From<Dictionary> for String {
    fn from(dictionary: Dictionary) -> String {
        dictionary.name().to_owned()
    }
}

impl TryFrom<String> for Dictionary {
    type Error = UnknownDictionary;

    fn try_from(name: String) -> Result<Dictionary, UnknownDictionary> {
        Dictionary::named(&name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_in_any_case_with_or_without_their_prefix() {
        for name in ["DICT_4X4_50", "4X4_50", "dict_4x4_50"] {
            assert_eq!(Dictionary::named(name).unwrap().name(), "DICT_4X4_50");
        }
        assert_eq!(Dictionary::named("DICT_APRILTAG_36H11").unwrap().name(), "DICT_APRILTAG_36h11");
    }

    #[test]
    fn an_unknown_name_lists_those_that_are_known() {
        let fault = Dictionary::named("DICT_9X9_50").unwrap_err().to_string();
        assert!(fault.contains("\"DICT_9X9_50\"") && fault.contains("DICT_4X4_50, "), "{fault}");
        assert!(Dictionary::named("").is_err());
        assert!(Dictionary::named("DICT_").is_err());
    }
}
