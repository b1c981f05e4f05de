//! What the scene's own file has where a study has variables.

use super::design::{Design, VariableSetting};
use super::{DesignSpace, collect_all_places_of_paths, document};
use crate::spec::{PathStep, ScenePath, VariableKind};
use toml_edit::{ArrayOfTables, Item};

/// What a variable is set to in the scene's file; `None` where that is not one value of its kind.
pub(super) fn variable_setting_in_scene_file_if_all_places_agree(
    space: &DesignSpace,
    variable_index: usize,
) -> Option<VariableSetting> {
    match &space.variables.get(variable_index)?.what {
        VariableKind::Number { paths, .. } => {
            number_at_paths_if_same_everywhere(space, paths).map(VariableSetting::Number)
        }
        VariableKind::Choice { values, .. } => (0..values.len())
            .map(VariableSetting::Choice)
            .find(|own| leaves_scene_unchanged(space, variable_index, *own)),
        VariableKind::Place { of, .. } | VariableKind::Mirror { of, .. } => {
            let [x, y] = ["x_mm", "y_mm"].map(|key| number_at_paths_if_same_everywhere(space, &[of.child_path(key)]));
            Some(VariableSetting::Place([x?, y?]))
        }
        VariableKind::Count { list, .. } => {
            space.base.get(list).and_then(Item::as_array_of_tables).map(ArrayOfTables::len).map(VariableSetting::Count)
        }
    }
}

/// The number that all places of some paths have.
fn number_at_paths_if_same_everywhere(space: &DesignSpace, paths: &[ScenePath]) -> Option<f64> {
    let places = collect_all_places_of_paths(paths, &space.base).ok()?;
    let mut numbers = places.iter().map(|place: &Vec<PathStep>| document::number_at_place_if_any(&space.base, place));
    let first = numbers.next()??;
    numbers.all(|other| other == Some(first)).then_some(first)
}

/// Whether the scene means the same with this setting of a variable: a table may be written in many ways.
fn leaves_scene_unchanged(space: &DesignSpace, variable_index: usize, setting: VariableSetting) -> bool {
    let mut settings = vec![VariableSetting::Kept; space.variables.len()];
    settings[variable_index] = setting;
    let changed = space.design_as_scene_text(&Design { settings }).and_then(|text| space.parse_scene_text(&text));
    changed.ok().zip(space.scene_of_file_with_deviations(&[]).ok()).is_some_and(|(changed, own)| changed == own)
}
