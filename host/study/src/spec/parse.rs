//! The study file's keys and what they may be.

use super::StudySpec;
use super::parse_method::{MOST_LEVELS, read_method, report_given_keys_that_must_be_left_out};
use super::path::ScenePath;
use super::variables::{
    MinimumDistance, NumberRange, NumberScale, PlaceArea, StudyVariable, UncertainValue, VariableKind,
};
use super::wishes::{Figure, FigureLimit, FrequencyGrouping, PartCosts, SettingScope, WantedFigure, Wish, WishGoal};
use era_model::scene::SceneError;
use era_model::scene::read::{self, AllowedNumbers, MistakeReport, TomlSection};
use toml_edit::{DocumentMut, Value};

/// The version of study files that is read.
const VERSION: f64 = 1.0;
/// Any number that is one.
const ANY: AllowedNumbers = AllowedNumbers::Within(-1e20, 1e20);
/// Places, in mm: a panel's sides are no longer.
const MM: AllowedNumbers = AllowedNumbers::Within(-10_000.0, 10_000.0);
/// Most values of a variable that goes in steps.
const MOST_STEPS: f64 = 1e6;
/// Most corners that uncertain values have together: 8 of them.
const MOST_CORNERS: usize = 256;

pub(super) fn parse_study_spec(source: &str, text: &str) -> Result<StudySpec, SceneError> {
    let document = read::parse_toml_document(source, text)?;
    // The same text again, for values that go into the scene as they are written.
    let values: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| {
        SceneError::from_single_mistake(source, 0, format!("not valid TOML: {}", error.message()))
    })?;
    let report = MistakeReport::new(text);
    let file = TomlSection::new(&report, document.get_ref(), String::new(), 0..0);
    let spec = read_whole_spec(&file, &values);
    file.report_unknown_keys();
    report.into_result(source)?;
    Ok(spec)
}

fn read_whole_spec(file: &TomlSection<'_, '_>, values: &DocumentMut) -> StudySpec {
    file.read_required_number_or_nan("version", AllowedNumbers::Within(VERSION, VERSION));
    let name = file.read_required_text_or_empty("name");
    let scene = file.read_required_text_or_empty("scene");
    let lists = values.get("variable").and_then(|item| item.as_array_of_tables());
    let list_of = |i: usize| lists.and_then(|lists| lists.get(i)?.get("values")?.as_array());
    let sections = file.read_tables("variable");
    let variables: Vec<StudyVariable> =
        sections.into_iter().enumerate().filter_map(|(i, section)| read_variable(section, list_of(i))).collect();
    let apart = file.read_tables("apart").into_iter().map(read_places_and_required_distance_between_them).collect();
    let sections = file.read_tables("wish");
    let is_wished = !sections.is_empty();
    let wishes: Vec<Wish> = sections.into_iter().filter_map(read_wish).collect();
    if !is_wished {
        file.mistake_report().add_mistake_at(&(0..0), "wish is missing: at least one [[wish]] is needed");
    }
    let limits = file.read_tables("limit").into_iter().filter_map(read_limit_unless_figure_invalid).collect();
    let uncertain: Vec<UncertainValue> =
        file.read_tables("uncertain").into_iter().map(read_relative_or_absolute_uncertainty_of_scene_keys).collect();
    let costs = file.read_table_if_given_and_a_table("cost").map_or_else(PartCosts::default, read_costs);
    let method = read_method(file, &uncertain);
    StudySpec { name, scene, variables, apart, wishes, limits, uncertain, costs, method }
}

/// A path, told if it is none.
fn parse_path_value_reporting_mistake(
    section: &TomlSection<'_, '_>,
    key: &'static str,
    text: &str,
) -> Option<ScenePath> {
    ScenePath::parse_path(text)
        .map_err(|error| {
            section.mistake_report().add_mistake_at(
                &section.byte_range_of_value_or_section(key),
                format!("{}: {error}", section.key_with_path(key)),
            )
        })
        .ok()
}

fn read_paths(section: &TomlSection<'_, '_>, key: &'static str) -> Vec<ScenePath> {
    let texts = section.read_text_or_texts_if_given_and_valid(key).unwrap_or_default();
    texts.iter().filter_map(|text| parse_path_value_reporting_mistake(section, key, text)).collect()
}

fn read_path(section: &TomlSection<'_, '_>, key: &'static str) -> Option<ScenePath> {
    parse_path_value_reporting_mistake(section, key, &section.read_required_text_or_empty(key))
}

fn read_variable(section: TomlSection<'_, '_>, list: Option<&toml_edit::Array>) -> Option<StudyVariable> {
    let kinds = ["key", "place", "count"].map(|kind| section.has_key_marking_known(kind));
    let given =
        if section.has_key_marking_known("name") { Some(section.read_required_text_or_empty("name")) } else { None };
    let levels = section
        .has_key_marking_known("levels")
        .then(|| section.read_required_positive_count_or_1("levels", MOST_LEVELS) as usize);
    let line = section.mistake_report().line_number_at(section.byte_range_of_value_or_section("name").start);
    let (usual, what) = match kinds {
        [true, false, false] => {
            let paths = read_paths(&section, "key");
            let name = paths.first().map_or_else(String::new, ToString::to_string);
            let what = if section.has_key_marking_known("values") {
                report_given_keys_that_must_be_left_out(
                    &section,
                    ["from", "to", "scale", "step"],
                    "because `values` are given",
                );
                read_choice_variable(&section, paths, list)
            } else {
                report_given_keys_that_must_be_left_out(&section, ["names", "costs"], "because there are no `values`");
                Some(VariableKind::Number { paths, numbers: read_number_range(&section, "step", ANY) })
            };
            (name, what)
        }
        [false, true, false] => {
            let of = read_path(&section, "place");
            let name = of.as_ref().map_or_else(String::new, ToString::to_string);
            (name, of.and_then(|of| read_place_or_mirror_variable(&section, of)))
        }
        [false, false, true] => {
            let list = section.read_required_text_or_empty("count");
            let (from, to) = (
                section.read_required_positive_count_or_1("from", 1000) as usize,
                section.read_required_positive_count_or_1("to", 1000) as usize,
            );
            if from > to {
                section.report_wrong_value("from", from.to_string(), &format!("no larger than `to`, which is {to}"));
            }
            (format!("number of {}", pluralise_list_name(&list)), Some(VariableKind::Count { list, from, to }))
        }
        _ => {
            report_that_not_exactly_one_key_is_given(
                &section,
                "name",
                [("key", kinds[0]), ("place", kinds[1]), ("count", kinds[2])],
            );
            return None;
        }
    };
    let name = given.unwrap_or(usual);
    section.report_unknown_keys();
    what.map(|what| StudyVariable { name, what, levels, line })
}

/// Several of what a scene has a list of.
fn pluralise_list_name(list: &str) -> String {
    match list {
        "mass" | "patch" => format!("{list}es"),
        _ => format!("{}s", list.trim_end_matches('s')),
    }
}

/// Tells that not one of three keys is given, but none or several; `key_to_point_at` is the key whose line is told.
fn report_that_not_exactly_one_key_is_given(
    section: &TomlSection<'_, '_>,
    key_to_point_at: &str,
    given: [(&str, bool); 3],
) {
    let [a, b, c] = given.map(|(key, _)| key);
    let there: Vec<&str> = given.into_iter().filter(|(_, is_given)| *is_given).map(|(key, _)| key).collect();
    let text = match there.is_empty() {
        true => format!("{}: exactly one of the keys `{a}`, `{b}` and `{c}` is needed", section.path_in_messages()),
        false => {
            format!(
                "{}: the keys `{}` are given, but only one of `{a}`, `{b}` and `{c}` is allowed",
                section.path_in_messages(),
                there.join("` and `")
            )
        }
    };
    section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section(key_to_point_at), text);
}

/// `from`, `to`, `scale` and a step.
fn read_number_range(section: &TomlSection<'_, '_>, step_key: &'static str, allowed: AllowedNumbers) -> NumberRange {
    let (from, to) =
        (section.read_required_number_or_nan("from", allowed), section.read_required_number_or_nan("to", allowed));
    if from > to {
        section.report_wrong_value("from", from.to_string(), &format!("no larger than `to`, which is {to}"));
    }
    let words = [("linear", NumberScale::Linear), ("log", NumberScale::Log)];
    let scale = if section.has_key_marking_known("scale") { section.read_required_word("scale", &words) } else { None };
    let scale = scale.unwrap_or(NumberScale::Linear);
    if scale == NumberScale::Log && from <= 0.0 {
        section.report_wrong_value("from", from.to_string(), "above 0, because the scale is \"log\"");
    }
    let step = read_step_or_nan_if_given(section, step_key, to - from);
    if scale == NumberScale::Log && step.is_some() {
        section.report_wrong_value(
            step_key,
            step.unwrap_or_default().to_string(),
            "left out, because the scale is \"log\"",
        );
    }
    NumberRange { from, to, scale, step }
}

fn read_step_or_nan_if_given(section: &TomlSection<'_, '_>, key: &'static str, span: f64) -> Option<f64> {
    let least = (span / MOST_STEPS).max(f64::MIN_POSITIVE);
    section
        .has_key_marking_known(key)
        .then(|| section.read_required_number_or_nan(key, AllowedNumbers::Within(least, 1e20)))
}

fn read_choice_variable(
    section: &TomlSection<'_, '_>,
    paths: Vec<ScenePath>,
    list: Option<&toml_edit::Array>,
) -> Option<VariableKind> {
    let Some(list) = list.filter(|list| !list.is_empty()) else {
        section.report_wrong_value("values", "empty, or not a list".into(), "a list with at least one value or table");
        return None;
    };
    let values: Vec<Value> = list.iter().cloned().map(Value::without_decor).collect();
    let written = || values.iter().map(|value| value.as_str().map_or_else(|| value.to_string(), str::to_owned));
    let names = section
        .has_key_marking_known("names")
        .then(|| section.read_text_or_texts_if_given_and_valid("names"))
        .flatten()
        .unwrap_or_else(|| written().collect());
    let costs = section
        .has_key_marking_known("costs")
        .then(|| section.read_numbers_if_given_and_allowed("costs", &[values.len()], ANY))
        .flatten();
    if names.len() != values.len() {
        section.report_wrong_value(
            "names",
            format!("a list of length {}", names.len()),
            &format!("a list with one name for each value (length {})", values.len()),
        );
    }
    let costs = costs.unwrap_or_else(|| vec![0.0; values.len()]);
    Some(VariableKind::Choice { paths, values, names, costs })
}

/// Values without the blanks and comments that are around them in the study's file.
trait Plain {
    fn without_decor(self) -> Self;
}

impl Plain for Value {
    fn without_decor(mut self) -> Self {
        self.decor_mut().clear();
        self
    }
}

fn read_place_or_mirror_variable(section: &TomlSection<'_, '_>, table_path: ScenePath) -> Option<VariableKind> {
    let given = ["within_mm", "line_mm", "mirror_of"].map(|key| section.has_key_marking_known(key));
    let linear = |from: f64, to: f64, step: Option<f64>| NumberRange { from, to, scale: NumberScale::Linear, step };
    if given[2] {
        report_given_keys_that_must_be_left_out(section, ["step_mm"], "because the place follows from `mirror_of`");
    } else {
        report_given_keys_that_must_be_left_out(section, ["mirrored"], "because there is no `mirror_of`");
    }
    match given {
        [true, false, false] => {
            let corners = section.read_numbers_if_given_and_allowed("within_mm", &[4], MM)?;
            let (x, y) = ([corners[0], corners[2]], [corners[1], corners[3]]);
            let order = |[a, b]: [f64; 2]| (a.min(b), a.max(b));
            let step = read_step_or_nan_if_given(section, "step_mm", (x[1] - x[0]).abs().max((y[1] - y[0]).abs()));
            let ((x0, x1), (y0, y1)) = (order(x), order(y));
            Some(VariableKind::Place {
                of: table_path,
                area: PlaceArea::Rectangle { x: linear(x0, x1, step), y: linear(y0, y1, step) },
            })
        }
        [false, true, false] => {
            let ends = section.read_numbers_if_given_and_allowed("line_mm", &[4], MM)?;
            let (from, to) = ([ends[0], ends[1]], [ends[2], ends[3]]);
            let length = (to[0] - from[0]).hypot(to[1] - from[1]);
            let step = read_step_or_nan_if_given(section, "step_mm", length);
            Some(VariableKind::Place {
                of: table_path,
                area: PlaceArea::Line { from, to, along: linear(0.0, length, step) },
            })
        }
        [false, false, true] => {
            let from = read_path(section, "mirror_of");
            let words = [("x", (true, false)), ("y", (false, true)), ("both", (true, true))];
            let (x, y) = section.read_required_word("mirrored", &words)?;
            Some(VariableKind::Mirror { of: table_path, from: from?, x, y })
        }
        _ => {
            report_that_not_exactly_one_key_is_given(
                section,
                "place",
                [("within_mm", given[0]), ("line_mm", given[1]), ("mirror_of", given[2])],
            );
            None
        }
    }
}

fn read_places_and_required_distance_between_them(section: TomlSection<'_, '_>) -> MinimumDistance {
    let apart = MinimumDistance {
        places: read_paths(&section, "places"),
        distance_mm: section.read_required_number_or_nan("distance_mm", AllowedNumbers::Within(0.0, 1e4)),
        line: section.mistake_report().line_number_at(section.byte_range_of_value_or_section("places").start),
    };
    section.report_unknown_keys();
    apart
}

fn read_wanted_figure(section: &TomlSection<'_, '_>) -> Option<WantedFigure> {
    let words = Figure::ALL.map(|figure| (figure.name(), figure));
    let Some(figure) = section.read_required_word("figure", &words) else {
        // Known, but nobody can say whether they apply.
        for key in ["setting", "drives", "at_mm", "force_n"] {
            let _ = section.has_key_marking_known(key);
        }
        return None;
    };
    let settings = [("every_touch", SettingScope::EveryTouch), ("one", SettingScope::One)];
    let setting = if figure.is_evaluated_at_weakest_place() && section.has_key_marking_known("setting") {
        section.read_required_word("setting", &settings)
    } else {
        None
    };
    let mut drives = FrequencyGrouping::Distinct;
    if figure.is_weakest_place_peak() && section.has_key_marking_known("drives") {
        drives = section
            .read_required_word("drives", &FrequencyGrouping::ALL.map(|drives| (drives.name(), drives)))
            .unwrap_or(drives);
        if drives != FrequencyGrouping::Distinct && setting == Some(SettingScope::One) {
            section.report_wrong_value(
                "drives",
                format!("{:?}", drives.name()),
                "\"distinct\", because setting is \"one\"",
            );
        }
    }
    let at_mm = if figure.is_evaluated_at_given_touch_place() {
        if !section.has_key_marking_known("at_mm") {
            section.report_wrong_value("at_mm", "missing".into(), "[x, y] in mm, the touched point");
        }
        Some(section.read_numbers_if_given_and_allowed("at_mm", &[2], MM).map(|at| [at[0], at[1]])?)
    } else {
        None
    };
    let is_unused = |key: &str| format!("because the figure {} does not use `{key}`", figure.name());
    if !figure.is_evaluated_at_weakest_place() {
        report_given_keys_that_must_be_left_out(section, ["setting"], &is_unused("setting"));
    }
    if !figure.is_weakest_place_peak() {
        report_given_keys_that_must_be_left_out(section, ["drives"], &is_unused("drives"));
    }
    if !figure.is_evaluated_at_given_touch_place() {
        report_given_keys_that_must_be_left_out(section, ["at_mm"], &is_unused("at_mm"));
    }
    if figure != Figure::SagUm {
        report_given_keys_that_must_be_left_out(section, ["force_n"], &is_unused("force_n"));
    }
    let is_pressed = figure == Figure::SagUm && section.has_key_marking_known("force_n");
    let force_n = is_pressed.then(|| {
        section.read_required_number_or_nan("force_n", AllowedNumbers::Within(0.0, era_model::scene::MOST_PRESS_N))
    });
    Some(WantedFigure { figure, setting: setting.unwrap_or(SettingScope::EveryTouch), drives, at_mm, force_n })
}

fn read_wish(section: TomlSection<'_, '_>) -> Option<Wish> {
    let wanted = read_wanted_figure(&section);
    let words = [("most", WishGoal::Most), ("least", WishGoal::Least)];
    let goal = if section.has_key_marking_known("goal") { section.read_required_word("goal", &words) } else { None };
    section.report_unknown_keys();
    let wanted = wanted?;
    let goal = goal.unwrap_or(wanted.figure.default_goal());
    Some(Wish { wanted, goal })
}

fn read_limit_unless_figure_invalid(section: TomlSection<'_, '_>) -> Option<FigureLimit> {
    let wanted = read_wanted_figure(&section);
    if !section.has_key_marking_known("least") & !section.has_key_marking_known("most") {
        section.mistake_report().add_mistake_at(
            &section.byte_range_of_value_or_section("figure"),
            format!("{}: at least one of the keys `least` and `most` is needed", section.path_in_messages()),
        );
    }
    let least = section.read_optional_number_or_nan("least", f64::NEG_INFINITY, ANY);
    let most = section.read_optional_number_or_nan("most", f64::INFINITY, ANY);
    if least > most {
        section.report_wrong_value("least", least.to_string(), &format!("no larger than `most`, which is {most}"));
    }
    section.report_unknown_keys();
    Some(FigureLimit { wanted: wanted?, least, most })
}

fn read_relative_or_absolute_uncertainty_of_scene_keys(section: TomlSection<'_, '_>) -> UncertainValue {
    let paths = read_paths(&section, "key");
    let usual = paths.first().map_or_else(String::new, ToString::to_string);
    let name = if section.has_key_marking_known("name") { section.read_required_text_or_empty("name") } else { usual };
    if section.has_key_marking_known("part") == section.has_key_marking_known("by") {
        section.mistake_report().add_mistake_at(
            &section.byte_range_of_value_or_section("key"),
            format!("{}: exactly one of the keys `part` and `by` is needed", section.path_in_messages()),
        );
    }
    let part = section.read_optional_number_or_nan("part", 0.0, AllowedNumbers::Within(0.0, 0.99));
    let by = section.read_optional_number_or_nan("by", 0.0, AllowedNumbers::Within(0.0, 1e20));
    let words = [("each", false), ("together", true)];
    let together = section
        .has_key_marking_known("vary")
        .then(|| section.read_required_word("vary", &words))
        .flatten()
        .unwrap_or(false);
    let line = section.mistake_report().line_number_at(section.byte_range_of_value_or_section("key").start);
    section.report_unknown_keys();
    UncertainValue { name, paths, part, by, together, line }
}

fn read_costs(section: TomlSection<'_, '_>) -> PartCosts {
    let each = |key| section.read_optional_number_or_nan(key, 0.0, AllowedNumbers::Within(0.0, 1e12));
    let costs =
        PartCosts { actuator: each("actuator"), support: each("support"), mass: each("mass"), per_kg: each("per_kg") };
    section.report_unknown_keys();
    costs
}

/// Whether so many uncertain values have few enough corners.
#[must_use]
pub(crate) fn can_try_all_corners(uncertain_values: usize) -> bool {
    uncertain_values < usize::BITS as usize && 1_usize << uncertain_values <= MOST_CORNERS
}
