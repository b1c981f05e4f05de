//! What a study's file asks for that shows only with its scene and its variables: told with its lines, before anything is computed.

use crate::space::Space;
use crate::spec::{Drives, MOST_DESIGNS, Spec, Wanted, Way, What};
use era_model::scene::read::{self, Report, Section};
use era_model::scene::{ROUNDING, Scene, SceneError};
use era_planner::MIN_SPACING_HZ;

/// Whether a study of so many designs can be computed; `source` and `text` are its file's.
///
/// # Errors
/// [`SceneError`] with every mistake found.
pub(super) fn check(
    spec: &Spec,
    space: &Space,
    scene: &Scene,
    designs: usize,
    source: &str,
    text: &str,
) -> Result<(), SceneError> {
    let document = read::document(source, text)?;
    let report = Report::new(text);
    {
        let file = Section::new(&report, document.get_ref(), String::new(), 0..0);
        if let Some(method) = file.table("method") {
            grid(&method, spec, designs);
            band(&method, spec, space, scene);
        }
        let wishes = file.tables("wish").into_iter().zip(spec.wishes.iter().map(|wish| &wish.wanted));
        let limits = file.tables("limit").into_iter().zip(spec.limits.iter().map(|limit| &limit.wanted));
        wishes.chain(limits).for_each(|(section, wanted)| place(&section, wanted, space));
    }
    report.finish(source)
}

/// A grid has as many designs as it has: no more than may be asked for by number.
fn grid(method: &Section<'_, '_>, spec: &Spec, designs: usize) {
    if spec.method.way != Way::Grid || designs <= MOST_DESIGNS as usize {
        return;
    }
    // What cannot be counted is the largest number.
    let count = if designs == usize::MAX { "more than can be counted".to_owned() } else { designs.to_string() };
    let text = format!(
        "method.levels is {}: with the levels and steps of the variables that makes {count} designs, but there may be at most {MOST_DESIGNS}",
        spec.method.levels
    );
    method.report().add(&method.place("levels"), text);
}

/// A band has room for the frequencies of the fewest actuators that a design has, where each has one of its own.
fn band(method: &Section<'_, '_>, spec: &Spec, space: &Space, scene: &Scene) {
    let is_distinct = |wanted: &Wanted| {
        wanted.figure.is_of_a_place() || wanted.figure.is_of_settings() && wanted.drives == Drives::Distinct
    };
    // Whoever puts another list in place of this one may have as few as one.
    if !spec.figures().iter().any(is_distinct) || space.changes(&["actuator"]) {
        return;
    }
    let counts = spec.variables.iter().filter_map(|own| match &own.what {
        What::Count { list, from, .. } if list == "actuator" => Some(*from),
        _ => None,
    });
    let fewest = counts.fold(scene.actuators.len(), usize::min);
    let between = (1..fewest).map(|_| MIN_SPACING_HZ).sum::<f64>();
    let (from_hz, to_hz) = (spec.method.from_hz, spec.method.to_hz);
    if to_hz - from_hz >= between - ROUNDING {
        return;
    }
    let why = format!("so that {fewest} actuators have frequencies {MIN_SPACING_HZ} Hz apart");
    if method.has("to_hz") {
        method.wrong("to_hz", to_hz.to_string(), &format!("at least {}, {why}", from_hz + between));
    } else {
        method.wrong("from_hz", from_hz.to_string(), &format!("at most {}, {why}", to_hz - between));
    }
}

/// A figure's place is on the surface, as far as the scene's file says where that ends.
fn place(section: &Section<'_, '_>, wanted: &Wanted, space: &Space) {
    let Some(at_mm) = wanted.at_mm else { return };
    let sides_mm = space.known_sides_mm();
    let is_on = |at: f64, side: Option<f64>| at >= 0.0 && side.is_none_or(|side| at <= side * (1.0 + ROUNDING));
    if !at_mm.into_iter().zip(sides_mm).all(|(at, side)| is_on(at, side)) {
        let range = |side: Option<f64>| side.map_or_else(|| "0 and above".to_owned(), |side| format!("0 to {side}"));
        let [x, y] = sides_mm.map(range);
        section.wrong_list("at_mm", &format!("on the surface: x {x}, y {y}"));
    }
}
