//! What a study's file asks for that shows only with its scene and its variables: told with its lines, before anything is computed.

use crate::space::DesignSpace;
use crate::spec::{FrequencyGrouping, MOST_DESIGNS, PointMethod, StudySpec, VariableKind, WantedFigure};
use era_model::scene::read::{self, MistakeReport, TomlSection};
use era_model::scene::{ROUNDING, Scene, SceneError};
use era_planner::MIN_SPACING_HZ;

/// Whether a study of so many designs can be computed; `source` and `text` are its file's.
///
/// # Errors
/// [`SceneError`] with every mistake found.
pub(super) fn check_study_fits_scene(
    spec: &StudySpec,
    space: &DesignSpace,
    scene: &Scene,
    designs: usize,
    source: &str,
    text: &str,
) -> Result<(), SceneError> {
    let document = read::parse_toml_document(source, text)?;
    let report = MistakeReport::new(text);
    {
        let file = TomlSection::new(&report, document.get_ref(), String::new(), 0..0);
        if let Some(method) = file.read_table_if_given_and_a_table("method") {
            report_grid_with_too_many_designs(&method, spec, designs);
            report_band_too_narrow_for_distinct_frequencies(&method, spec, space, scene);
        }
        let wishes = file.read_tables("wish").into_iter().zip(spec.wishes.iter().map(|wish| &wish.wanted));
        let limits = file.read_tables("limit").into_iter().zip(spec.limits.iter().map(|limit| &limit.wanted));
        wishes
            .chain(limits)
            .for_each(|(section, wanted)| report_figure_place_beyond_known_sides(&section, wanted, space));
    }
    report.into_result(source)
}

/// A grid has as many designs as it has: no more than may be asked for by number.
fn report_grid_with_too_many_designs(method: &TomlSection<'_, '_>, spec: &StudySpec, designs: usize) {
    if spec.method.way != PointMethod::Grid || designs <= MOST_DESIGNS as usize {
        return;
    }
    // What cannot be counted is the largest number.
    let count = if designs == usize::MAX { "too many".to_owned() } else { designs.to_string() };
    let text = format!(
        "method.levels = {}, together with the levels and steps of the variables, gives {count} designs, but at most \
        {MOST_DESIGNS} are allowed",
        spec.method.levels
    );
    method.mistake_report().add_mistake_at(&method.byte_range_of_value_or_section("levels"), text);
}

/// A band has room for the frequencies of the fewest actuators that a design has, where each has one of its own.
fn report_band_too_narrow_for_distinct_frequencies(
    method: &TomlSection<'_, '_>,
    spec: &StudySpec,
    space: &DesignSpace,
    scene: &Scene,
) {
    let is_distinct = |wanted: &WantedFigure| {
        wanted.figure.is_evaluated_at_given_touch_place()
            || wanted.figure.is_evaluated_at_weakest_place() && wanted.drives == FrequencyGrouping::Distinct
    };
    // Whoever puts another list in place of this one may have as few as one.
    if !spec.distinct_figures_of_wishes_and_limits().iter().any(is_distinct)
        || space.is_key_or_its_table_set_by_number_or_choice_variable(&["actuator"])
    {
        return;
    }
    let counts = spec.variables.iter().filter_map(|own| match &own.what {
        VariableKind::Count { list, from, .. } if list == "actuator" => Some(*from),
        _ => None,
    });
    let fewest = counts.fold(scene.actuators.len(), usize::min);
    let between = (1..fewest).map(|_| MIN_SPACING_HZ).sum::<f64>();
    let (from_hz, to_hz) = (spec.method.from_hz, spec.method.to_hz);
    if to_hz - from_hz >= between - ROUNDING {
        return;
    }
    let why = format!("so that {fewest} actuators can have frequencies {MIN_SPACING_HZ} Hz apart");
    if method.has_key_marking_known("to_hz") {
        method.report_wrong_value("to_hz", to_hz.to_string(), &format!("at least {}, {why}", from_hz + between));
    } else {
        method.report_wrong_value("from_hz", from_hz.to_string(), &format!("at most {}, {why}", to_hz - between));
    }
}

/// A figure's place is on the surface, as far as the scene's file says where that ends.
fn report_figure_place_beyond_known_sides(section: &TomlSection<'_, '_>, wanted: &WantedFigure, space: &DesignSpace) {
    let Some(at_mm) = wanted.at_mm else { return };
    let sides_mm = space.sides_unchanged_by_variables_mm();
    let is_on = |at: f64, side: Option<f64>| at >= 0.0 && side.is_none_or(|side| at <= side * (1.0 + ROUNDING));
    if !at_mm.into_iter().zip(sides_mm).all(|(at, side)| is_on(at, side)) {
        let range = |side: Option<f64>| side.map_or_else(|| "at least 0".to_owned(), |side| format!("0 to {side}"));
        let [x, y] = sides_mm.map(range);
        section.report_wrong_list("at_mm", &format!("on the surface: x {x}, y {y}"));
    }
}
