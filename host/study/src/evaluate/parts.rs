//! Figures of a design's parts, which need no model.

use crate::space::{Design, VariableSetting};
use crate::spec::{PartCosts, StudyVariable, VariableKind};
use era_model::scene::Scene;

/// Mass in g of the surface and of all that is fixed to it or rides on it. Air that moves along is none of it.
#[must_use]
pub fn mass_of_surface_masses_and_actuators_without_air_g(scene: &Scene) -> f64 {
    let masses: f64 = scene.masses.iter().map(|mass| mass.mass_kg).sum();
    let actuators: f64 = scene.actuators.iter().map(|own| own.moving_mass_kg + own.housing_mass_kg).sum();
    (scene.surface_mass_without_air_kg() + masses + actuators) * 1e3
}

/// What the parts cost, choices included; NaN where the scene's own value is kept in place of a choice that has costs, as nobody knows what it costs.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "small counts")]
pub fn parts_and_choices_cost_or_nan_if_priced_choice_keeps_scene_value(
    scene: &Scene,
    costs: &PartCosts,
    variables: &[StudyVariable],
    design: &Design,
) -> f64 {
    let chosen = variables.iter().zip(&design.settings).map(|(variable, setting)| match (&variable.what, setting) {
        (VariableKind::Choice { costs, .. }, VariableSetting::Choice(choice)) => {
            costs.get(*choice).copied().unwrap_or(0.0)
        }
        (VariableKind::Choice { costs, .. }, VariableSetting::Kept) if costs.iter().any(|cost| *cost != 0.0) => {
            f64::NAN
        }
        _ => 0.0,
    });
    costs.actuator * scene.actuators.len() as f64
        + costs.support * scene.supports.len() as f64
        + costs.mass * scene.masses.len() as f64
        + costs.per_kg * scene.surface_mass_without_air_kg()
        + chosen.sum::<f64>()
}
