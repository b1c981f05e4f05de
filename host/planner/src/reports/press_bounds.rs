//! What is said of a press: how wrong the figures may be, and which actuators do not bear it.

use crate::model::{Bound, ReducedModel};
use crate::scene::Actuator;
use crate::table::PlanTable;
use crate::table::press::{Pressed, Stop, sags_on};

/// Bound on the relative error of how far a press alone moves an actuator's mass ([`Pressed::alone_m`]), by the coarser models. It is that of the panel, which
/// is linear, whatever the force and wherever the mass meets an electrode. The furthest place is one of the grid's points, or an actuator's: between
/// them a mass may go 1 % further.
#[must_use]
pub fn bound_press_travel_error(table: &PlanTable, actuator: usize) -> Bound {
    let Some(([middle, coarse], estimator)) = &table.coarser else {
        return Bound::Unknown("no coarser model was made to compare with");
    };
    if table.pressed.get(actuator).is_some_and(|pressed| pressed.alone_m.is_infinite()) {
        return Bound::Unknown("nothing holds the panel");
    }
    let Some(pressed) = table.pressed.get(actuator).filter(|pressed| pressed.alone_m > 0.0) else {
        return Bound::Unknown("nothing is moved");
    };
    let at = |model: &ReducedModel| {
        let q = model.steady_coordinates_per_newton(actuator).filter(|_| model.is_surface_held())?;
        Some(model.shape_deflections_at(pressed.at_m.0, pressed.at_m.1).dot(&q))
    };
    let (Some(fine), Some(middle), Some(coarse)) = (at(&table.model), at(middle), at(coarse)) else {
        return Bound::Unknown("nothing holds the panel");
    };
    let difference = |a: f64, b: f64| (a - b).abs() / fine.abs();
    estimator.steady_deflection_error_bound(difference(coarse, middle), difference(middle, fine))
}

/// Bound on the relative error of how far a press and the electrodes move an actuator's mass ([`Pressed::sag_m`]), at the place where the press moves it furthest and
/// with the stops that there are.
#[must_use]
pub fn bound_sag_error(table: &PlanTable, actuator: usize) -> Bound {
    let Some(([middle, coarse], estimator)) = &table.coarser else {
        return Bound::Unknown("no coarser model was made to compare with");
    };
    let on = |model| sags_on(&table.scene, model, &table.electrodes, &table.pressed).get(actuator).copied();
    match (on(&table.model), on(middle), on(coarse)) {
        (Some(fine), Some(middle), Some(coarse)) if fine > 0.0 => {
            estimator.steady_deflection_error_bound((coarse - middle).abs() / fine, (middle - fine).abs() / fine)
        }
        _ => Bound::Unknown("nothing is moved"),
    }
}

/// Which actuators do not bear the scene's press, and what would do.
#[must_use]
pub fn list_press_warnings(table: &PlanTable) -> Vec<String> {
    let assumed = table.scene.actuators.iter().zip(&table.pressed).filter(|(_, own)| own.stop == Stop::Assumed);
    let text = |(actuator, pressed): (&Actuator, &Pressed)| {
        let how_far = if pressed.alone_m <= actuator.air_gap_m {
            format!("{:.0} um off its middle", pressed.alone_m * 1e6)
        } else {
            "onto its electrode".into()
        };
        let springs = pressed.stiffness_n_per_m.map_or_else(String::new, |stiffness| {
            format!(", or springs of {} N/m (stiffness_n_per_m, now {})", up(stiffness), actuator.stiffness_n_per_m)
        });
        format!(
            "a press of {} N at {:.1}, {:.1} mm moves the mass of {:?} {how_far}, and its gap of {:.0} um bears a third of \
             itself: plans are made for a stop there, which the scene does not have. Fit one and say stop_um = \
             {:.0}{springs}; [press] force_n names another force",
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

/// The next number with two digits.
fn up(value: f64) -> f64 {
    let digit = 10_f64.powf(value.log10().floor() - 1.0);
    (value / digit).ceil() * digit
}
