//! Error bounds on the effect of a press, and warnings about actuators that do not withstand it.

use crate::model::{Bound, ReducedModel};
use crate::physics::limits::MAX_TRAVEL_FRACTION;
use crate::scene::Actuator;
use crate::table::PlanTable;
use crate::table::press::{PressEffect, Stop, recompute_mass_travel_by_press_and_pull_on_other_model_m};

/// Bound on the relative error of how far a press alone moves an actuator's mass ([`PressEffect::alone_m`]), by the coarser models. It is that of the panel, which
/// is linear, whatever the force and wherever the mass meets an electrode.
#[must_use]
pub fn bound_relative_mesh_error_of_travel_by_press_alone(table: &PlanTable, actuator: usize) -> Bound {
    let Some(([middle, coarse], estimator)) = &table.coarser else {
        return Bound::Unknown("no coarser model was computed for a comparison");
    };
    if table.pressed.get(actuator).is_some_and(|pressed| pressed.alone_m.is_infinite()) {
        return Bound::Unknown("the panel can move freely");
    }
    let Some(pressed) = table.pressed.get(actuator).filter(|pressed| pressed.alone_m > 0.0) else {
        return Bound::Unknown("the press does not move the mass");
    };
    let at = |model: &ReducedModel| {
        let q = model
            .steady_coordinates_per_newton_unless_absent_or_driving_free_motion(actuator)
            .filter(|_| model.is_surface_held())?;
        Some(model.shape_deflections_at(pressed.at_m.0, pressed.at_m.1).dot(&q))
    };
    let (Some(fine), Some(middle), Some(coarse)) = (at(&table.model), at(middle), at(coarse)) else {
        return Bound::Unknown("the panel can move freely");
    };
    let difference = |a: f64, b: f64| (a - b).abs() / fine.abs();
    estimator
        .steady_deflection_error_bound_from_relative_differences(difference(coarse, middle), difference(middle, fine))
}

/// Bound on the relative error of how far a press and the electrodes move an actuator's mass ([`PressEffect::sag_m`]), at the place where the press moves it furthest and
/// with the stops that there are.
#[must_use]
pub fn bound_relative_mesh_error_of_sag_under_press_and_electrode_pull(table: &PlanTable, actuator: usize) -> Bound {
    let Some(([middle, coarse], estimator)) = &table.coarser else {
        return Bound::Unknown("no coarser model was computed for a comparison");
    };
    let on = |model| {
        recompute_mass_travel_by_press_and_pull_on_other_model_m(&table.scene, model, &table.electrodes, &table.pressed)
            .get(actuator)
            .copied()
    };
    match (on(&table.model), on(middle), on(coarse)) {
        (Some(fine), Some(middle), Some(coarse)) if fine > 0.0 => estimator
            .steady_deflection_error_bound_from_relative_differences(
                (coarse - middle).abs() / fine,
                (middle - fine).abs() / fine,
            ),
        _ => Bound::Unknown("the press does not move the mass"),
    }
}

/// Which actuators do not bear the scene's press, and what would do.
#[must_use]
pub fn list_warnings_of_actuators_not_withstanding_press(table: &PlanTable) -> Vec<String> {
    let assumed = table.scene.actuators.iter().zip(&table.pressed).filter(|(_, own)| own.stop == Stop::Assumed);
    let text = |(actuator, pressed): (&Actuator, &PressEffect)| {
        let how_far = match pressed.alone_m {
            alone_m if alone_m > actuator.air_gap_m => "onto an electrode".into(),
            alone_m if alone_m > MAX_TRAVEL_FRACTION * actuator.air_gap_m => format!("by {:.0} um", alone_m * 1e6),
            alone_m => {
                format!("by {:.0} um, and the electrodes then pull the mass farther than is allowed", alone_m * 1e6)
            }
        };
        let springs = pressed.stiffness_n_per_m.map_or_else(String::new, |stiffness| {
            format!(
                ", or set stiffness_n_per_m = {} (in the scene, it is {})",
                round_up_to_two_significant_digits(stiffness),
                actuator.stiffness_n_per_m
            )
        });
        format!(
            "a press of {} N at {:.1}, {:.1} mm moves the mass of the actuator {:?} {how_far}, but a mass may move by \
            at most a third of its gap of {:.0} um. Plans assume a stop for this mass, but the scene has none. \
            Fit a stop \
             and set stop_um = {:.0}{springs}, or set a smaller force_n in [press]",
            table.scene.press_n,
            pressed.at_m.0 * 1e3,
            pressed.at_m.1 * 1e3,
            actuator.id,
            actuator.air_gap_m * 1e6,
            (pressed.stop_m * 1e6).floor().max(1.0),
        )
    };
    assumed.map(text).collect()
}

/// The next higher number with two digits.
fn round_up_to_two_significant_digits(value: f64) -> f64 {
    let digit = 10_f64.powf(value.log10().floor() - 1.0);
    (value / digit).ceil() * digit
}
