//! Commands that study a panel: response, field; and what others need of a panel.

use super::args::{At, Band, Keep, Panel, Response, Unit};
use super::cost::Cost;
use super::explain::explain;
use super::progress::{with_cost, with_progress};
use super::told::tell;
use super::{Failure, Outcome, print_json, print_text};
use crate::model::bounded::Step;
use crate::model::levels::Levels;
use crate::model::{Accuracy, Bound, ModelError};
use crate::planner::cache::{self, PrepareError, Prepared};
use crate::planner::{Plan, PlanError, PlanTable, TableOptions, Target};
use crate::response;
use crate::scene::{Finger, MAX_ACTUATORS, Scene, Side, SurfaceKind};
use num_complex::Complex64;
use serde_json::json;
use std::fmt::Write;
use std::time::Instant;

/// Most frequencies in one response.
const MOST_FREQUENCIES: f64 = 1e6;
/// Thickness over length above which thin-plate theory is off by more than a percent or two.
const THIN: f64 = 1.0 / 30.0;
/// Error of thin-plate theory in a frequency that is worth a warning.
const SHEAR: f64 = 0.02;

impl From<ModelError> for Failure {
    fn from(error: ModelError) -> Self {
        match error {
            ModelError::TooFine { .. }
            | ModelError::TooManyModes { .. }
            | ModelError::Frequency { .. }
            | ModelError::Tolerance { .. }
            | ModelError::OtherPanel { .. } => Failure::usage(error),
            ModelError::Factorisation { .. } | ModelError::NotConverged { .. } => Failure::failed(error),
        }
    }
}

impl From<response::CurveError> for Failure {
    fn from(error: response::CurveError) -> Self {
        match error {
            response::CurveError::Model(error) => error.into(),
            response::CurveError::Response(error) => Failure::failed(error),
        }
    }
}

impl From<PrepareError> for Failure {
    fn from(error: PrepareError) -> Self {
        match error {
            PrepareError::Model(error) => error.into(),
            PrepareError::Response(error) => Failure::failed(error),
        }
    }
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::NoFrequencies => Failure::failed(error),
            _ => Failure::usage(error),
        }
    }
}

/// Says where thin-plate theory ends: by the panel's side, and by the waves at the highest frequency.
pub fn warn_if_thick(scene: &Scene, max_hz: f64) {
    let side = span_m(scene);
    let thickest = scene.layout().layers().map(|(_, layer)| layer.thickness_m).fold(0.0, f64::max);
    let slenderness = thickest / side;
    if slenderness > THIN {
        tracing::warn!(
            "thickness is {:.3} of the side that bends: thin-plate theory is too stiff by some percent there",
            slenderness
        );
    }
    let too_high = too_high_by(scene, max_hz);
    if too_high > SHEAR {
        tracing::warn!(
            "at {max_hz} Hz waves are so short against the thickness that frequencies come out some {:.0} % too high: \
             thin-plate theory leaves out shear and rotary inertia",
            100.0 * too_high
        );
    }
}

/// The shortest side that the panel has to bend along at whatever low frequency: the longer one, and one with a line support
/// at its end. Across a narrow strip that nothing holds nothing bends below frequencies whose waves are as short, and for
/// those there is [`too_high_by`]; it is a bar, however it is called.
fn span_m(scene: &Scene) -> f64 {
    let surface = &scene.surface;
    let is_held = |sides: [Side; 2]| scene.edges.iter().any(|edge| sides.contains(&edge.side));
    match surface.kind {
        SurfaceKind::Bar => surface.length_m,
        SurfaceKind::Plate => {
            let longer = surface.length_m.max(surface.width_m);
            let along = is_held([Side::Left, Side::Right]).then_some(surface.length_m);
            let across = is_held([Side::Top, Side::Bottom]).then_some(surface.width_m);
            [along, across].into_iter().flatten().fold(longer, f64::min)
        }
    }
}

/// About how much too high thin-plate theory has a frequency, relative: (k h)^2 (1/12 + S) / 2 for the wavenumber k, S =
/// (1 + nu) / (6 kappa) for a bar's shear and 1 / (6 kappa (1 - nu)) for a plate's, kappa = 5/6 (Mindlin 1951, first order). What layers have
/// in place of h^2 / 12 and S h^2 follows from how shear is handed from one to the next; the softest of them counts most.
fn too_high_by(scene: &Scene, max_hz: f64) -> f64 {
    let (surface, material) = (&scene.surface, &scene.surface.material);
    let (h, nu) = (surface.thickness_m, material.poisson_ratio);
    let shear = match surface.kind {
        SurfaceKind::Plate => 0.2 / (1.0 - nu),
        SurfaceKind::Bar => 0.2 * (1.0 + nu),
    };
    // k^4 = 12 rho w^2 / (E h^2), a plate's less by 1 - nu^2.
    let omega = std::f64::consts::TAU * max_hz;
    if let Some(laminate) = surface.laminate() {
        let least = match surface.kind {
            SurfaceKind::Plate => laminate.rigidities.range()[0],
            SurfaceKind::Bar => laminate.rigidities.d11,
        };
        let square = omega * (laminate.per_area_kg_m2 / least).sqrt();
        return 0.5 * square * (laminate.turning_m2 + laminate.shear_m2);
    }
    let square = h * h * omega * (12.0 * material.density_kg_m3 / (material.youngs_modulus_pa * h * h)).sqrt();
    0.5 * square * (1.0 / 12.0 + shear)
}

/// Responses are to actuators.
pub fn need_actuators(scene: &Scene) -> Result<(), Failure> {
    if scene.actuators.is_empty() {
        return Err(Failure::usage("the scene has no [[actuator]]: responses are per newton at each actuator"));
    }
    Ok(())
}

/// `--explain`.
pub fn tell_steps(panel: &Panel, scene: &Scene, accuracy: Accuracy, steps: &[Step]) {
    if panel.explain {
        tell!("{}", explain(scene, accuracy, steps));
    }
}

/// What was asked for of a bound; nothing where time was.
pub fn tolerance_of(accuracy: Accuracy) -> Option<f64> {
    accuracy.time().is_none().then(|| accuracy.value())
}

/// Whether all bounds are within what was asked for; `None` where nothing was, or where one is missing and none is above it.
pub fn is_met(bounds: &[Bound], accuracy: Accuracy) -> Option<bool> {
    let tolerance = tolerance_of(accuracy)?;
    if bounds.iter().filter_map(|bound| bound.value()).any(|bound| bound > tolerance) {
        return Some(false);
    }
    bounds.iter().all(|bound| bound.value().is_some()).then_some(true)
}

/// Says on standard error why bounds are missing, and where they are above what was asked for.
pub fn tell_missing(bounds: &[Bound], accuracy: Accuracy) {
    if let Some(reason) = bounds.iter().find_map(|bound| bound.reason()) {
        tell!("error_bound is null: {reason}");
    }
    let largest = bounds.iter().filter_map(|bound| bound.value()).fold(0.0, f64::max);
    if accuracy.time().is_none() && largest > accuracy.value() {
        tell!(
            "error_bound {largest:.1e} is above the tolerance {:.1e}, and the finest meshes did not bring it down",
            accuracy.value()
        );
    }
}

/// Says on standard error where the bound on a plan's peak is missing or above what was asked for; with `--explain` also that it
/// is not. A plan's target has a bound of its own: the table's mesh is chosen once, for all of them.
pub fn tell_plan(plans: &[&Plan], accuracy: Accuracy, explain: bool) {
    if plans.iter().any(|plan| plan.error_bound.is_none()) {
        tell!("error_bound is null: nothing moves at the target, or the panel's model has none (see `era response`)");
    }
    let tolerance = accuracy.value();
    let Some(largest) = plans.iter().filter_map(|plan| plan.error_bound).reduce(f64::max) else { return };
    if largest > tolerance {
        tell!(
            "error_bound {largest:.1e} of the target's peak is above the tolerance {tolerance:.1e}: a plan is made on the mesh \
             that usually meets it; ask for a tighter --tolerance"
        );
    } else if explain {
        tell!("tolerance {tolerance:.0e} met: the target's peak is right to {largest:.0e}");
    }
}

/// The bounds of plans.
pub fn bounds_of(plans: &[&Plan]) -> Vec<Bound> {
    let bound = |plan: &&Plan| plan.error_bound.map_or(Bound::Unknown("of a plan"), Bound::AtMost);
    plans.iter().map(bound).collect()
}

pub fn response(options: &Response) -> Outcome {
    let started = Instant::now();
    let scene = options.panel.load()?;
    let frequencies_hz = frequencies(&options.band)?;
    let (x_m, y_m) = surface_point(&scene, options.at.x, options.at.y, options.unit)?;
    let accuracy = options.panel.climb()?;
    need_actuators(&scene)?;
    warn_if_thick(&scene, options.band.to);
    tell_finger(&options.panel, &scene);
    let scene = scene.touched(&[(x_m, y_m)]);
    let cost = Cost::of_responses(&scene, accuracy, options.band.to, (frequencies_hz.len(), 1))?;
    let found = with_cost("computing the response", cost, || {
        response::bounded_curves(&scene, accuracy, (x_m, y_m), &frequencies_hz)
    })?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    let curves = &found.answer;
    tell_steps(&options.panel, &scene, accuracy, &found.steps);
    tell_missing(&found.bounds, accuracy);
    if options.json {
        let actuators: Vec<_> = scene
            .actuators
            .iter()
            .zip(curves)
            .zip(&found.bounds)
            .map(|((actuator, curve), bound)| {
                json!({
                    "id": actuator.id,
                    "error_bound": bound.value(),
                    "acceleration_re": curve.iter().map(|z| z.re).collect::<Vec<_>>(),
                    "acceleration_im": curve.iter().map(|z| z.im).collect::<Vec<_>>(),
                })
            })
            .collect();
        // One number for all curves; none without curves.
        let bound = found.bounds.iter().map(|bound| bound.value()).reduce(|a, b| Some(a?.max(b?))).flatten();
        return print_json(&json!({
            "dofs": found.model.dofs(), "elapsed_ms": elapsed_ms, "error_bound": bound, "tolerance": tolerance_of(accuracy),
            "tolerance_met": is_met(&found.bounds, accuracy), "frequency_hz": frequencies_hz, "actuators": actuators,
        }));
    }
    print_text(&csv(&scene, &frequencies_hz, curves, &found.bounds))
}

/// A line for each frequency: of every actuator amplitude and phase, then the bounds, each the same in all lines, so that
/// whatever reads CSV reads them; `nan` where there is none.
fn csv(scene: &Scene, frequencies_hz: &[f64], curves: &[Vec<Complex64>], bounds: &[Bound]) -> String {
    let mut text = String::from("frequency_hz");
    for actuator in &scene.actuators {
        let _ = write!(text, ",{0}_m_per_s2_per_n,{0}_phase_deg", actuator.id);
    }
    for actuator in &scene.actuators {
        let _ = write!(text, ",{}_error_bound", actuator.id);
    }
    let bounds: Vec<String> =
        bounds.iter().map(|bound| bound.value().map_or_else(|| "nan".into(), |bound| format!("{bound:.2e}"))).collect();
    for (i, frequency) in frequencies_hz.iter().enumerate() {
        let _ = write!(text, "\n{frequency}");
        for curve in curves {
            let _ = write!(text, ",{:.6e},{:.2}", curve[i].norm(), curve[i].arg().to_degrees());
        }
        for bound in &bounds {
            let _ = write!(text, ",{bound}");
        }
    }
    text
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "counts up to 1e6"
)]
pub fn frequencies(options: &Band) -> Result<Vec<f64>, Failure> {
    let (from, to, step) = (options.from, options.to, options.step);
    if !(from >= 0.0 && from.is_finite()) {
        return Err(Failure::usage(format!("--from {from} is not in the allowed range 0 Hz and up")));
    }
    if !(to >= from && to.is_finite()) {
        return Err(Failure::usage(format!("--to {to} is not in the allowed range {from} Hz (--from) and up")));
    }
    if !(step > 0.0 && step.is_finite()) {
        return Err(Failure::usage(format!("--step {step} is not in the allowed range above 0 Hz")));
    }
    let count = ((to - from) / step + 1e-9).floor();
    if count >= MOST_FREQUENCIES {
        return Err(Failure::usage(format!(
            "--step {step} gives {count} frequencies, at most {MOST_FREQUENCIES} are allowed"
        )));
    }
    Ok((0..=count as usize).map(|i| from + i as f64 * step).collect())
}

/// The point of `--at` on the surface, in m.
pub fn surface_point(scene: &Scene, x: f64, y: f64, unit: Unit) -> Result<(f64, f64), Failure> {
    point_of(scene, "--at", x, y, unit)
}

/// The point of an option on the surface, in m.
pub fn point_of(scene: &Scene, option: &str, x: f64, y: f64, unit: Unit) -> Result<(f64, f64), Failure> {
    let place = match unit {
        Unit::Px => scene.place_px(x, y),
        Unit::Mm => scene.place(x / 1e3, y / 1e3).map_err(Into::into),
    };
    Ok(place.map_err(|error| Failure::usage(format!("{option}: {error}")))?.xy_m())
}

/// The planner's table for a scene.
pub fn plan_table(panel: &Panel, keep: Keep, scene: &Scene) -> Result<PlanTable, Failure> {
    Ok(prepared_table(panel, keep, scene)?.table)
}

/// The same, and where it came from.
pub fn prepared_table(panel: &Panel, keep: Keep, scene: &Scene) -> Result<Prepared, Failure> {
    let options = TableOptions::default();
    if scene.actuators.len() > MAX_ACTUATORS {
        // Before minutes are spent on a table that no plan comes from.
        return Err(PlanError::Actuators { count: scene.actuators.len() }.into());
    }
    let accuracy = panel.accuracy()?;
    warn_if_thick(scene, TableOptions::default().to_hz);
    let prepare = || cache::prepare(keep.cache().as_ref(), scene, accuracy, options);
    let what = "computing modes and the response of every actuator";
    let prepared = if cache::is_kept(keep.cache().as_ref(), scene, accuracy, options) {
        with_progress(what, prepare)
    } else {
        with_cost(what, Cost::of_table(scene, accuracy, options)?, prepare)
    }?;
    tell_steps(panel, scene, accuracy, &prepared.steps);
    for warning in prepared.table.press_warnings() {
        tracing::warn!("{warning}");
    }
    Ok(prepared)
}

/// The planner's table for touches of these places (m): of the panel with the scene's finger on them, where it has one.
pub fn touched_table(panel: &Panel, keep: Keep, scene: &Scene, places: &[(f64, f64)]) -> Result<PlanTable, Failure> {
    let table = plan_table(panel, keep, scene)?;
    if scene.finger.is_none() {
        return Ok(table);
    }
    let (accuracy, options, touched) = (panel.accuracy()?, TableOptions::default(), scene.touched(places));
    tell_finger(panel, scene);
    let cost = Cost::of_table(&touched, accuracy, options)?;
    with_cost("computing the panel with the finger on it", cost, || -> Result<_, Failure> {
        table.touched(&touched, Levels::build(&touched, accuracy, options.to_hz)?, options).map_err(Failure::failed)
    })
}

/// What an answer has of the finger, to those who want to know.
fn tell_finger(panel: &Panel, scene: &Scene) {
    if let Some(Finger { mass_kg, damping_n_s_per_m, stiffness_n_per_m }) = scene.finger.filter(|_| panel.explain) {
        let mass_g = mass_kg * 1e3;
        tell!(
            "a finger of {mass_g} g, {damping_n_s_per_m} N s/m and {stiffness_n_per_m} N/m is on the place asked for"
        );
    }
}

pub fn target(scene: &Scene, at: &At) -> Result<Target, Failure> {
    let (x_m, y_m) = surface_point(scene, at.at.x, at.at.y, at.unit)?;
    Ok(Target { x_m, y_m, intensity_g: at.intensity_g })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip is the same panel as a plate and as a bar; it is stubby where it has to bend along a short side.
    #[test]
    fn the_side_that_bends_counts() {
        let strip = |kind: &str, length_mm: f64, width_mm: f64, edges: &str| {
            let text = format!(
                "version = 1\nname = \"strip\"\n[surface]\nkind = \"{kind}\"\nlength_mm = {length_mm}\nwidth_mm = {width_mm}\n\
                 thickness_mm = 2\n[surface.material]\nyoungs_modulus_pa = 69e9\npoisson_ratio = 0.33\n\
                 density_kg_m3 = 2700\n{edges}"
            );
            Scene::parse("strip", &text).unwrap()
        };
        let edge = |side: &str, kind: &str| format!("[[edge]]\nside = \"{side}\"\nkind = \"{kind}\"\n");
        for scene in [
            strip("bar", 300.0, 40.0, ""),
            strip("plate", 300.0, 40.0, ""),
            strip("plate", 40.0, 300.0, ""),
            strip("plate", 300.0, 40.0, &edge("left", "clamped")),
        ] {
            assert_eq!(span_m(&scene), 0.3, "{scene:?}");
        }
        assert_eq!(span_m(&strip("plate", 300.0, 40.0, &edge("top", "pinned"))), 0.04);
        assert_eq!(span_m(&strip("plate", 40.0, 30.0, "")), 0.04);
        assert_eq!(span_m(&strip("bar", 40.0, 30.0, "")), 0.04);
    }
}
