//! Supports, masses and actuators in a scene's text: where they stand, and moving them.
//!
//! The text is changed, not written anew: comments, order and whatever else is in the file stay as they are.

use crate::daemon::api::problem::{Problem, ProblemKind};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ops::Range;
use toml::de::{DeTable, DeValue};
use utoipa::ToSchema;

/// Tables of a scene whose entries are fixed to a place of the surface.
pub const TABLES: [&str; 3] = ["support", "mass", "actuator"];

/// New place of an attachment (a support, a mass or an actuator).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Distance from the left edge of the surface in mm.
    pub x_mm: f64,
    /// Distance from the top edge of the surface in mm; unchanged if absent, and ignored on a bar.
    pub y_mm: Option<f64>,
}

/// One entry of such a table.
struct Attachment {
    /// As in messages: `support[2]`.
    path: String,
    line: usize,
    /// Where the numbers stand in the text, if there are any.
    x_mm: Option<Range<usize>>,
    y_mm: Option<Range<usize>>,
}

/// All attachments of a scene's text.
pub struct Attachments<'t> {
    text: &'t str,
    list: Vec<Attachment>,
    /// How many entries every list of the file has.
    counts: BTreeMap<String, usize>,
}

impl<'t> Attachments<'t> {
    /// Finds them. Text that is no TOML has none, and entries of a wrong kind are left out: what is wrong with them is told
    /// when the scene is read.
    pub fn parse(text: &'t str) -> Self {
        let document = DeTable::parse(text);
        let document = document.as_ref().ok().map(toml::Spanned::get_ref);
        let line = |offset: usize| text.bytes().take(offset).filter(|byte| *byte == b'\n').count() + 1;
        let entries = |name: &'static str| {
            let list = match document.and_then(|document| document.get(name)).map(toml::Spanned::get_ref) {
                Some(DeValue::Array(list)) => list.iter().collect(),
                _ => Vec::new(),
            };
            list.into_iter().enumerate().filter_map(move |(i, entry)| {
                let DeValue::Table(table) = entry.get_ref() else { return None };
                let span = |key: &str| table.get(key).map(toml::Spanned::span);
                // People count from one.
                let path = format!("{name}[{}]", i + 1);
                Some(Attachment { path, line: line(entry.span().start), x_mm: span("x_mm"), y_mm: span("y_mm") })
            })
        };
        let counts = document.into_iter().flat_map(DeTable::iter).filter_map(|(name, value)| match value.get_ref() {
            DeValue::Array(list) => Some((name.get_ref().clone().into_owned(), list.len())),
            _ => None,
        });
        Self { text, list: TABLES.into_iter().flat_map(entries).collect(), counts: counts.collect() }
    }

    /// How many entries some of the file's lists have together, attachments or not.
    pub fn count_entries_of_tables(&self, table_names: &[&str]) -> usize {
        table_names.iter().filter_map(|name| self.counts.get(*name)).sum()
    }

    /// The line at which the table's `entry_number`-th entry (from 1) begins.
    pub fn find_line_of_entry(&self, table: &str, entry_number: usize) -> Option<usize> {
        let path = format!("{table}[{entry_number}]");
        self.list.iter().find(|known| known.path == path).map(|known| known.line)
    }

    /// The text with some of them moved. A coordinate that an entry does not have (a bar's `y_mm`) is not given to it.
    ///
    /// # Errors
    /// [`Problem`] for a name that no attachment has.
    pub fn scene_text_with_moves(&self, moves: &BTreeMap<String, Place>) -> Result<String, Problem> {
        let mut changes = Vec::new();
        for (path, place) in moves {
            let known = self
                .list
                .iter()
                .find(|known| known.path == *path)
                .ok_or_else(|| self.unknown_attachment_problem(path))?;
            changes.extend(known.x_mm.clone().map(|at| (at, place.x_mm)));
            changes.extend(known.y_mm.clone().zip(place.y_mm));
        }
        // From the end, so that the places before stay valid.
        changes.sort_by_key(|(at, _)| std::cmp::Reverse(at.start));
        let mut text = self.text.to_owned();
        for (at, value) in changes {
            text.replace_range(at, &format!("{value:?}"));
        }
        Ok(text)
    }

    fn unknown_attachment_problem(&self, name: &str) -> Problem {
        let names: Vec<String> = TABLES
            .iter()
            .filter_map(|table| {
                let count = self.list.iter().filter(|known| known.path.starts_with(&format!("{table}["))).count();
                match count {
                    0 => None,
                    1 => Some(format!("{table}[1]")),
                    _ => Some(format!("{table}[1] to {table}[{count}]")),
                }
            })
            .collect();
        let allowed = if names.is_empty() { "none (this scene has no attachments)".into() } else { names.join(", ") };
        let detail = format!("`moves` contains {name:?}, but can contain only these attachments: {allowed}");
        Problem::new(ProblemKind::OutOfRange, detail).with_field_and_value("moves", name.into(), allowed, None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apply_moves(text: &str, moves: &[(&str, f64, Option<f64>)]) -> Result<String, Problem> {
        let moves = moves.iter().map(|(path, x_mm, y_mm)| ((*path).to_owned(), Place { x_mm: *x_mm, y_mm: *y_mm }));
        Attachments::parse(text).scene_text_with_moves(&moves.collect())
    }

    #[test]
    fn only_the_numbers_change() {
        let text = "# top\n[[support]]\nx_mm = 1 # left\ny_mm=2.5\n[[support]]\ny_mm = 4\nx_mm = 3\n\
                    [[actuator]]\nx_mm = 10 # on a bar, without y\n";
        let wanted = "# top\n[[support]]\nx_mm = 1 # left\ny_mm=2.5\n[[support]]\ny_mm = 8.0\nx_mm = 7.25\n\
                      [[actuator]]\nx_mm = 1e20 # on a bar, without y\n";
        assert_eq!(
            apply_moves(text, &[("actuator[1]", 1e20, Some(3.0)), ("support[2]", 7.25, Some(8.0))]).unwrap(),
            wanted
        );
        assert_eq!(apply_moves(text, &[]).unwrap(), text);
        let inline = "mass = [{x_mm = 1, y_mm = 2, mass_g = 3}, {y_mm = 5, x_mm = 4}]";
        let wanted = "mass = [{x_mm = 9.0, y_mm = 2, mass_g = 3}, {y_mm = 6.0, x_mm = 7.0}]";
        assert_eq!(apply_moves(inline, &[("mass[1]", 9.0, None), ("mass[2]", 7.0, Some(6.0))]).unwrap(), wanted);
    }

    #[test]
    fn what_is_not_there_is_not_moved() {
        for (text, path, allowed) in [
            ("[[support]]\nx_mm = 1\n[[support]]\n", "support[3]", "support[1] to support[2]"),
            ("[[mass]]\n", "support[0]", "mass[1]"),
            ("not TOML at all", "mass[1]", "no attachments"),
            ("support = 3\nmass = [1]", "mass[1]", "no attachments"),
        ] {
            let problem = apply_moves(text, &[(path, 1.0, None)]).unwrap_err();
            assert!(problem.detail().contains(path) && problem.detail().contains(allowed), "{}", problem.detail());
        }
    }

    #[test]
    fn lines_are_those_of_the_entries() {
        let text = "\n[[support]]\nx_mm = 1\n\n[[support]]\n";
        let found = Attachments::parse(text);
        assert_eq!(
            (
                found.count_entries_of_tables(&TABLES),
                found.find_line_of_entry("support", 2),
                found.find_line_of_entry("support", 3)
            ),
            (2, Some(5), None)
        );
    }
}
