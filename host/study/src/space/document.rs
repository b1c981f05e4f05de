//! A design written into the scene's document.

use super::design::VariableSetting;
use crate::spec::{MinimumDistance, PathError, PathStep, ScenePath, StudyVariable, VariableKind};
use era_model::scene::{Scene, SceneError};
use toml_edit::{DocumentMut, InlineTable, Item, TableLike, Value};

/// Mistakes of one design that are told: every row of a study has its own.
const MAX_LISTED_VALUES: usize = 8;

/// Why a design is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RefusedDesign {
    /// A path leads nowhere.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The scene is refused, by its own rules.
    #[error("{0}")]
    Scene(String),
    /// Two places are too near.
    #[error("{first} and {second} are {distance_mm} mm apart, but must be at least {least_mm} mm apart")]
    Near {
        /// One.
        first: String,
        /// The other.
        second: String,
        /// How far.
        distance_mm: String,
        /// How far they must be.
        least_mm: String,
    },
}

impl RefusedDesign {
    fn from_scene_error(error: &SceneError) -> Self {
        // Without the file's name and lines: the text is the design's, not the file's.
        let told: Vec<&str> =
            error.mistakes.iter().take(MAX_LISTED_VALUES).map(|mistake| mistake.text.as_str()).collect();
        let more = error.mistakes.len().saturating_sub(MAX_LISTED_VALUES);
        let more = if more == 0 { String::new() } else { format!("; number of further mistakes: {more}") };
        Self::Scene(told.join("; ") + &more)
    }
}

/// Whether a variable's paths lead somewhere in a scene.
pub(super) fn check_variable_can_be_set_in_document(
    base: &DocumentMut,
    variable: &StudyVariable,
) -> Result<(), PathError> {
    let missing = |path: &ScenePath, what: String| PathError::Missing { path: path.to_string(), missing: what };
    match &variable.what {
        VariableKind::Number { paths, .. } => paths
            .iter()
            .try_for_each(|path| check_path_exists_and_values_are_tables_if_it_leads_to_list_entry(base, path, false)),
        VariableKind::Choice { paths, values, .. } => {
            let are_tables = values.iter().all(Value::is_inline_table);
            paths.iter().try_for_each(|path| {
                check_path_exists_and_values_are_tables_if_it_leads_to_list_entry(base, path, are_tables)
            })
        }
        VariableKind::Place { of, .. } | VariableKind::Mirror { of, .. } => {
            let places = of.find_places_allowing_new_last_key(base)?;
            let is_one = matches!(places.as_slice(), [place] if find_table_at_place(base, place).is_some());
            if is_one {
                Ok(())
            } else {
                Err(missing(of, "table at this path, or has several, but must have exactly one".into()))
            }
        }
        VariableKind::Count { list, to, .. } => {
            let Some(tables) = base.get(list).and_then(Item::as_array_of_tables) else {
                return Err(PathError::List { list: list.clone(), hint: suggest_list_names(base, list) });
            };
            let found = tables.len();
            if found >= *to { Ok(()) } else { Err(PathError::Few { list: list.clone(), found, wanted: *to }) }
        }
    }
}

/// Which list a name may stand for that is none.
fn suggest_list_names(base: &DocumentMut, name: &str) -> String {
    let all: Vec<&str> = base.iter().filter(|(_, item)| item.is_array_of_tables()).map(|(key, _)| key).collect();
    // Whoever counts writes the plural.
    match all.iter().find(|own| name.starts_with(**own) || own.starts_with(name)) {
        Some(own) => format!("did you mean {own}?"),
        None => format!("lists in the scene: {}", all.join(", ")),
    }
}

/// Whether what a path leads to takes tables, or other values: a table of a list takes nothing but tables.
fn check_path_exists_and_values_are_tables_if_it_leads_to_list_entry(
    base: &DocumentMut,
    path: &ScenePath,
    are_values_tables: bool,
) -> Result<(), PathError> {
    let places = path.find_places_allowing_new_last_key(base)?;
    let is_table = places.iter().any(|place| matches!(place.last(), Some(PathStep::Index(_))));
    if is_table && !are_values_tables { Err(PathError::Table { path: path.to_string() }) } else { Ok(()) }
}

/// Sets a variable in a document. Paths are followed in `base`, the scene's file.
pub(super) fn set_variable(
    document: &mut DocumentMut,
    base: &DocumentMut,
    variable: &StudyVariable,
    setting: VariableSetting,
) -> Result<(), PathError> {
    match (&variable.what, setting) {
        (VariableKind::Number { paths, .. }, VariableSetting::Number(number)) => {
            put_value_at_paths(document, base, paths, &Value::from(number))
        }
        (VariableKind::Choice { paths, values, .. }, VariableSetting::Choice(choice)) => match values.get(choice) {
            Some(value) => put_value_at_paths(document, base, paths, value),
            None => Ok(()),
        },
        (VariableKind::Place { of, .. } | VariableKind::Mirror { of, .. }, VariableSetting::Place(at_mm)) => {
            for (key, at_mm) in ["x_mm", "y_mm"].into_iter().zip(at_mm) {
                put_value_at_paths(document, base, &[of.child_path(key)], &Value::from(at_mm))?;
            }
            Ok(())
        }
        (VariableKind::Count { list, .. }, VariableSetting::Count(count)) => {
            if let Some(tables) = document.get_mut(list).and_then(Item::as_array_of_tables_mut) {
                while tables.len() > count {
                    tables.remove(tables.len() - 1);
                }
            }
            Ok(())
        }
        _ => Ok(()),
    }
}

fn put_value_at_paths(
    document: &mut DocumentMut,
    base: &DocumentMut,
    paths: &[ScenePath],
    value: &Value,
) -> Result<(), PathError> {
    for path in paths {
        for place in path.find_places_allowing_new_last_key(base)? {
            put_value_if_its_table_exists(document, &place, value);
        }
    }
    Ok(())
}

/// Puts a value at a place; nothing where the place is gone, as that of an actuator that this design does without.
pub(super) fn put_value_if_its_table_exists(document: &mut DocumentMut, place: &[PathStep], value: &Value) {
    match (place.split_last(), value) {
        (Some((PathStep::Index(_), _)), Value::InlineTable(new)) => {
            if let Some(own) = find_table_at_place_mut(document, place) {
                replace_table_content(own, new);
            }
        }
        (Some((PathStep::Key(key), above)), _) => {
            let Some(table) = find_table_at_place_mut(document, above) else { return };
            match (table.get_mut(key), value) {
                (Some(Item::Table(own)), Value::InlineTable(new)) => replace_table_content(own, new),
                _ => replace_value_keeping_decor(table, key, value),
            }
        }
        // What leads to a table of a list has tables for values, as [`check_variable_can_be_set_in_document`] makes sure.
        _ => {}
    }
}

/// Gives a table other keys and values. It stays where it is, with its heading and its comments.
fn replace_table_content(table: &mut dyn TableLike, new: &InlineTable) {
    let gone: Vec<String> = table.iter().map(|(key, _)| key.to_owned()).filter(|key| !new.contains_key(key)).collect();
    for key in gone {
        table.remove(&key);
    }
    for (key, value) in new {
        replace_value_keeping_decor(table, key, value);
    }
}

/// A key's value, what is written around the old one left as it is.
fn replace_value_keeping_decor(table: &mut dyn TableLike, key: &str, value: &Value) {
    let mut new = value.clone();
    if let Some(old) = table.get(key).and_then(Item::as_value) {
        *new.decor_mut() = old.decor().clone();
    }
    table.insert(key, Item::Value(new));
}

/// The number at a place; `None` if there is none.
pub(super) fn number_at_place_if_any(document: &DocumentMut, place: &[PathStep]) -> Option<f64> {
    let (PathStep::Key(key), above) = place.split_last()? else { return None };
    let value = find_table_at_place(document, above)?.get(key)?;
    #[expect(clippy::cast_precision_loss, reason = "as in any other number")]
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// Length and width of the surface in mm, where they are numbers.
pub(super) fn surface_sides_if_numbers_mm(document: &DocumentMut) -> [Option<f64>; 2] {
    let side =
        |key: &str| number_at_place_if_any(document, &[PathStep::Key("surface".into()), PathStep::Key(key.into())]);
    [side("length_mm"), side("width_mm")]
}

fn find_table_at_place<'d>(document: &'d DocumentMut, place: &[PathStep]) -> Option<&'d dyn TableLike> {
    let mut own: &dyn TableLike = document.as_table();
    let mut steps = place.iter();
    while let Some(step) = steps.next() {
        let PathStep::Key(key) = step else { return None };
        own = match own.get(key)? {
            Item::ArrayOfTables(list) => {
                let Some(PathStep::Index(index)) = steps.next() else { return None };
                list.get(*index)?
            }
            item => item.as_table_like()?,
        };
    }
    Some(own)
}

fn find_table_at_place_mut<'d>(document: &'d mut DocumentMut, place: &[PathStep]) -> Option<&'d mut dyn TableLike> {
    let mut own: &mut dyn TableLike = document.as_table_mut();
    let mut steps = place.iter();
    while let Some(step) = steps.next() {
        let PathStep::Key(key) = step else { return None };
        let item = own.get_mut(key)?;
        own = match item {
            Item::ArrayOfTables(list) => {
                let Some(PathStep::Index(index)) = steps.next() else { return None };
                list.get_mut(*index)?
            }
            item => item.as_table_like_mut()?,
        };
    }
    Some(own)
}

/// Checks that places keep their minimum distances.
pub(super) fn check_minimum_distances(
    document: &DocumentMut,
    minimum_distances: &[MinimumDistance],
) -> Result<(), RefusedDesign> {
    let kind = find_table_at_place(document, &[PathStep::Key("surface".into())])
        .and_then(|surface| surface.get("kind")?.as_str());
    // A bar has no y, whatever stands in its file.
    let is_bar = kind == Some("bar");
    for apart in minimum_distances {
        let mut places: Vec<(String, [f64; 2])> = Vec::new();
        for path in &apart.places {
            // One that this design does without keeps any distance.
            for place in path.find_places_allowing_new_last_key(document).unwrap_or_default() {
                let at = |key: &str| {
                    number_at_place_if_any(document, &[place.as_slice(), &[PathStep::Key(key.into())]].concat())
                };
                let Some(x) = at("x_mm") else { continue };
                let name = id_or_path_of_table(document, &place);
                if places.iter().all(|(other, _)| *other != name) {
                    places.push((name, [x, at("y_mm").filter(|_| !is_bar).unwrap_or(0.0)]));
                }
            }
        }
        for (k, (first, one)) in places.iter().enumerate() {
            for (second, other) in &places[k + 1..] {
                let distance = (one[0] - other[0]).hypot(one[1] - other[1]);
                if distance < apart.distance_mm {
                    return Err(RefusedDesign::Near {
                        first: first.clone(),
                        second: second.clone(),
                        distance_mm: format!("{distance:.1}"),
                        least_mm: apart.distance_mm.to_string(),
                    });
                }
            }
        }
    }
    Ok(())
}

/// A table's place as people name it: an actuator by its `id`.
fn id_or_path_of_table(document: &DocumentMut, place: &[PathStep]) -> String {
    let id = find_table_at_place(document, place).and_then(|table| table.get("id")?.as_str().map(str::to_owned));
    id.unwrap_or_else(|| format_place_as_path_with_indices_from_one(place))
}

/// A place as a path to it is written.
pub(super) fn format_place_as_path_with_indices_from_one(place: &[PathStep]) -> String {
    let mut text = String::new();
    for step in place {
        match step {
            PathStep::Key(key) if text.is_empty() => text.push_str(key),
            PathStep::Key(key) => text.push_str(&format!(".{key}")),
            PathStep::Index(index) => text.push_str(&format!("[{}]", index + 1)),
        }
    }
    text
}

/// A document as a scene.
pub(super) fn parse_document_as_scene(source: &str, document: &DocumentMut) -> Result<Scene, RefusedDesign> {
    parse_text_as_scene(source, &document.to_string())
}

/// A scene of its text.
pub(super) fn parse_text_as_scene(source: &str, text: &str) -> Result<Scene, RefusedDesign> {
    Scene::parse(source, text).map_err(|error| RefusedDesign::from_scene_error(&error))
}
