//! What the scene's own file has where a study has variables.

use super::design::{Design, Setting};
use super::{Space, all_places, document};
use crate::spec::{Path, Step, What};
use toml_edit::{ArrayOfTables, Item};

/// What a variable is set to in the scene's file; `None` where that is not one value of its kind.
pub(super) fn setting(space: &Space, number: usize) -> Option<Setting> {
    match &space.variables.get(number)?.what {
        What::Number { paths, .. } => same_number(space, paths).map(Setting::Number),
        What::Choice { values, .. } => {
            (0..values.len()).map(Setting::Choice).find(|own| is_no_change(space, number, *own))
        }
        What::Place { of, .. } | What::Mirror { of, .. } => {
            let [x, y] = ["x_mm", "y_mm"].map(|key| same_number(space, &[of.below(key)]));
            Some(Setting::Place([x?, y?]))
        }
        What::Count { list, .. } => {
            space.base.get(list).and_then(Item::as_array_of_tables).map(ArrayOfTables::len).map(Setting::Count)
        }
    }
}

/// The number that all places of some paths have.
fn same_number(space: &Space, paths: &[Path]) -> Option<f64> {
    let places = all_places(paths, &space.base).ok()?;
    let mut numbers = places.iter().map(|place: &Vec<Step>| document::number(&space.base, place));
    let first = numbers.next()??;
    numbers.all(|other| other == Some(first)).then_some(first)
}

/// Whether the scene means the same with this setting of a variable: a table may be written in many ways.
fn is_no_change(space: &Space, number: usize, setting: Setting) -> bool {
    let mut settings = vec![Setting::Kept; space.variables.len()];
    settings[number] = setting;
    let changed = space.text(&Design { settings }).and_then(|text| space.read(&text));
    changed.ok().zip(space.base(&[]).ok()).is_some_and(|(changed, own)| changed == own)
}
