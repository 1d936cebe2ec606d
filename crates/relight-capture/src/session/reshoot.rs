//! Photographs that are taken out of the journal, so that the resumed session takes them again.

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

use super::{Journal, STATE, SessionError, checks_of, open_checks, state};

/// Which photographs are to be taken again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reshoot {
    /// All of the views during which something moved.
    Moved,
    /// All of a view.
    View(usize),
    /// One, by view and light.
    Frame(usize, usize),
}

impl fmt::Display for Reshoot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reshoot::Moved => f.write_str("what moved"),
            Reshoot::View(view) => write!(f, "view {view}"),
            Reshoot::Frame(view, light) => write!(f, "view {view} under light {light}"),
        }
    }
}

impl FromStr for Reshoot {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Reshoot, Self::Err> {
        let number =
            |text: &str| text.trim().parse().map_err(|_| "this wants moved, VIEW or VIEW,LIGHT, as in 7,12");
        match text.split_once(',') {
            None if text == "moved" => Ok(Reshoot::Moved),
            None => Ok(Reshoot::View(number(text)?)),
            Some((view, light)) => Ok(Reshoot::Frame(number(view)?, number(light)?)),
        }
    }
}

/// Forgets photographs of the session in `out`. Tells which they are, by view and light.
///
/// # Errors
/// If one that is named was never taken, or the session's files cannot be read or written.
pub fn forget(out: &Path, which: &[Reshoot]) -> Result<Vec<(usize, usize)>, SessionError> {
    let path = out.join(STATE).join(state::JOURNAL);
    if !path.is_file() {
        return Err(SessionError::NothingToReshoot(out.to_owned()));
    }
    let mut journal = Journal::open(&path)?;
    // A session that looks for no movement has no file of checks, and gets none.
    let mut checks = if checks_of(out).is_file() { Some(open_checks(out)?) } else { None };
    let moved: BTreeSet<usize> = checks
        .iter()
        .flat_map(|checks| checks.entries().filter(|check| check.moved).map(|check| check.view))
        .collect();
    let is_meant = |(view, light): (usize, usize), which: &Reshoot| match *which {
        Reshoot::Moved => moved.contains(&view),
        Reshoot::View(v) => view == v,
        Reshoot::Frame(v, l) => (view, light) == (v, l),
    };
    let taken: Vec<(usize, usize)> = journal.entries().map(|entry| (entry.view, entry.light)).collect();
    if let Some(&missing) = which
        .iter()
        .find(|which| **which != Reshoot::Moved && !taken.iter().any(|&frame| is_meant(frame, which)))
    {
        return Err(SessionError::NeverShot { out: out.to_owned(), which: missing });
    }
    let meant = |frame: (usize, usize)| which.iter().any(|which| is_meant(frame, which));
    let forgotten: Vec<(usize, usize)> = taken.into_iter().filter(|&frame| meant(frame)).collect();
    let views: BTreeSet<usize> = forgotten.iter().map(|frame| frame.0).collect();
    // Killed in between, views are still known to have moved.
    journal.retain(|entry| !meant((entry.view, entry.light)))?;
    if let Some(checks) = &mut checks {
        checks.retain(|check| !views.contains(&check.view))?;
    }
    Ok(forgotten)
}
