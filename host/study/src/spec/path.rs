//! Places of keys in a scene's document: `surface.thickness_mm`, `support[2].x_mm`, `actuator.left.mount`, `edge.top.kind`, `support.*.x_mm`.

use std::fmt;
use toml_edit::{DocumentMut, Item, Table};

/// The keys by which tables of a list have names, list by list.
pub const TABLE_NAMES: [(&str, &str); 2] = [("actuator", "id"), ("edge", "side")];

/// A key's place, or that of a table (`actuator.left`). Tables of a list are counted from one, as messages about scenes do; actuators
/// go by their `id` too, edges by their `side`, and `*` stands for all of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScenePath {
    text: String,
    segments: Vec<PathSegment>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum PathSegment {
    /// A key of a table, or the name of a list's table.
    Name(String),
    /// A list's table, from one.
    Number(usize),
    /// All tables of a list.
    All,
}

/// Why a path leads nowhere.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PathError {
    /// Not of a path's form.
    #[error(
        "{path:?} is not a path to a key or table of a scene; examples of paths: surface.thickness_mm, \
         support[1].x_mm, support.*.x_mm, actuator.left.x_mm, edge.top.kind"
    )]
    Form {
        /// As written.
        path: String,
    },
    /// A list is too short.
    #[error("`to` is {wanted}, but the scene has only {found} [[{list}]] tables")]
    Few {
        /// The list.
        list: String,
        /// How many it has.
        found: usize,
        /// How many it should have.
        wanted: usize,
    },
    /// There is no list by that name.
    #[error("the scene has no [[{list}]]; {hint}")]
    List {
        /// As written.
        list: String,
        /// What may have been meant.
        hint: String,
    },
    /// It ends at a table of a list, for which a value is no table.
    #[error(
        "{path} is the path of a table, not of a single value: add a key of this table to the path, or make each \
    entry of `values` a table"
    )]
    Table {
        /// As written.
        path: String,
    },
    /// There is nothing by that name.
    #[error("{path}: the scene has no {missing}")]
    Missing {
        /// As written.
        path: String,
        /// What is missing.
        missing: String,
    },
}

/// What a path leads to: the steps of one place, indices of lists from zero.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathStep {
    /// A table's key.
    Key(String),
    /// A list's table.
    Index(usize),
}

impl ScenePath {
    /// Parses a path.
    ///
    /// # Errors
    /// [`PathError::Form`].
    pub fn parse_path(text: &str) -> Result<Self, PathError> {
        let form = || PathError::Form { path: text.into() };
        let mut segments = Vec::new();
        for part in text.split('.') {
            let (name, number) = match part.split_once('[') {
                Some((name, rest)) => (name, Some(rest.strip_suffix(']').ok_or_else(form)?)),
                None => (part, None),
            };
            if name.is_empty() || name.contains([']', ' ', '"']) {
                return Err(form());
            }
            segments.push(if name == "*" { PathSegment::All } else { PathSegment::Name(name.into()) });
            match number {
                Some("*") => segments.push(PathSegment::All),
                Some(number) => {
                    let number = number.parse().ok().filter(|number| *number >= 1).ok_or_else(form)?;
                    segments.push(PathSegment::Number(number));
                }
                None => {}
            }
        }
        if segments.first().is_none_or(|first| *first == PathSegment::All) {
            return Err(form());
        }
        Ok(Self { text: text.into(), segments })
    }

    /// The path of a key below this one.
    #[must_use]
    pub fn child_path(&self, key: &str) -> Self {
        let mut segments = self.segments.clone();
        segments.push(PathSegment::Name(key.into()));
        Self { text: format!("{}.{key}", self.text), segments }
    }

    /// All places that the path leads to; the last key need not be there.
    ///
    /// # Errors
    /// [`PathError::Missing`].
    pub fn find_places_allowing_new_last_key(&self, document: &DocumentMut) -> Result<Vec<Vec<PathStep>>, PathError> {
        let mut places: Vec<(Vec<PathStep>, PathTarget<'_>)> =
            vec![(Vec::new(), PathTarget::Table(document.as_table()))];
        for (number, segment) in self.segments.iter().enumerate() {
            let is_last = number + 1 == self.segments.len();
            let mut next = Vec::new();
            for (steps, at) in places {
                let found = at.find_targets_of_segment_if_any_allowing_new_key_if_last(segment, is_last);
                let missing =
                    || PathError::Missing { path: self.text.clone(), missing: self.format_up_to_segment(number) };
                for (step, at) in found.ok_or_else(missing)? {
                    next.push(([steps.as_slice(), &[step]].concat(), at));
                }
            }
            places = next;
        }
        Ok(places.into_iter().map(|(steps, _)| steps).collect())
    }

    /// The path's beginning as it is written in messages.
    fn format_up_to_segment(&self, segment: usize) -> String {
        let mut text = String::new();
        for segment in &self.segments[..=segment] {
            match segment {
                PathSegment::Name(name) if text.is_empty() => text.push_str(name),
                PathSegment::Name(name) => text.push_str(&format!(".{name}")),
                PathSegment::Number(number) => text.push_str(&format!("[{number}]")),
                PathSegment::All => text.push_str(".*"),
            }
        }
        text
    }
}

impl fmt::Display for ScenePath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Where a path has led so far.
#[derive(Clone, Copy)]
enum PathTarget<'d> {
    Table(&'d Table),
    /// With the key that names its tables, if they have names.
    List(&'d toml_edit::ArrayOfTables, Option<&'static str>),
    /// A table in braces: its keys are values.
    Inline,
    Value,
}

impl<'d> PathTarget<'d> {
    /// Where a segment leads: one place, or all of a list; `None` if nothing is there and the last key may not be new.
    fn find_targets_of_segment_if_any_allowing_new_key_if_last(
        self,
        segment: &PathSegment,
        is_last: bool,
    ) -> Option<Vec<(PathStep, PathTarget<'d>)>> {
        match (self, segment) {
            (PathTarget::Table(table), PathSegment::Name(name)) => {
                let step = PathStep::Key(name.clone());
                match table.get(name) {
                    Some(Item::Table(table)) => Some(vec![(step, PathTarget::Table(table))]),
                    Some(Item::ArrayOfTables(list)) => {
                        let named_by = TABLE_NAMES.iter().find(|(own, _)| own == name).map(|(_, key)| *key);
                        Some(vec![(step, PathTarget::List(list, named_by))])
                    }
                    Some(Item::Value(toml_edit::Value::InlineTable(_))) => Some(vec![(step, PathTarget::Inline)]),
                    Some(_) => is_last.then(|| vec![(step, PathTarget::Value)]),
                    None => is_last.then(|| vec![(step, PathTarget::Value)]),
                }
            }
            (PathTarget::Inline, PathSegment::Name(name)) => {
                is_last.then(|| vec![(PathStep::Key(name.clone()), PathTarget::Value)])
            }
            (PathTarget::List(list, named_by), PathSegment::Name(name)) => {
                let key = named_by?;
                let has_name = |table: &Table| table.get(key).and_then(Item::as_str) == Some(name);
                let index = list.iter().position(has_name)?;
                Some(vec![(PathStep::Index(index), PathTarget::Table(list.get(index)?))])
            }
            (PathTarget::List(list, _), PathSegment::Number(number)) => {
                Some(vec![(PathStep::Index(number - 1), PathTarget::Table(list.get(number - 1)?))])
            }
            (PathTarget::List(list, _), PathSegment::All) if !list.is_empty() => Some(
                list.iter()
                    .enumerate()
                    .map(|(index, table)| (PathStep::Index(index), PathTarget::Table(table)))
                    .collect(),
            ),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document() -> DocumentMut {
        "[surface]\nthickness_mm = 2.0\nmaterial = { density_kg_m3 = 1.0 }\n[[support]]\nx_mm = 0\n[[support]]\nx_mm = 1\n\
         [[actuator]]\nid = \"left\"\n[[actuator]]\nid = \"right\"\n[[edge]]\nside = \"left\"\n[[edge]]\nside = \"top\"\n"
            .parse()
            .unwrap()
    }

    fn find_places(path: &str) -> Result<Vec<Vec<PathStep>>, PathError> {
        ScenePath::parse_path(path)?.find_places_allowing_new_last_key(&document())
    }

    #[test]
    fn places_are_found_by_number_name_and_all() {
        let key = |name: &str| PathStep::Key(name.into());
        assert_eq!(find_places("surface.thickness_mm").unwrap(), [[key("surface"), key("thickness_mm")]]);
        assert_eq!(find_places("support[2].x_mm").unwrap(), [[key("support"), PathStep::Index(1), key("x_mm")]]);
        assert_eq!(find_places("actuator.right.x_mm").unwrap(), [[key("actuator"), PathStep::Index(1), key("x_mm")]]);
        assert_eq!(find_places("edge.top.kind").unwrap(), [[key("edge"), PathStep::Index(1), key("kind")]]);
        assert_eq!(find_places("edge.top").unwrap(), find_places("edge[2]").unwrap());
        let all = find_places("support.*.damping_n_s_per_m").unwrap();
        assert_eq!(all, find_places("support[*].damping_n_s_per_m").unwrap());
        assert_eq!(all.len(), 2);
        assert_eq!(find_places("surface.material.density_kg_m3").unwrap()[0].len(), 3);
    }

    #[test]
    fn what_is_not_there_is_named() {
        for (path, missing) in [
            ("support[3].x_mm", "support[3]"),
            ("actuator.middle.x_mm", "actuator.middle"),
            ("edge.bottom.kind", "edge.bottom"),
            ("support.left.x_mm", "support.left"),
            ("mass.*.mass_g", "mass"),
            ("surface.damping.loss_factor", "surface.damping"),
        ] {
            let found = find_places(path).unwrap_err();
            assert_eq!(found, PathError::Missing { path: path.into(), missing: missing.into() });
        }
        for path in ["", "support[0].x_mm", "support[2.x_mm", "a..b", "*.x", "support[x].y"] {
            assert!(matches!(ScenePath::parse_path(path), Err(PathError::Form { .. })), "{path}");
        }
    }
}
