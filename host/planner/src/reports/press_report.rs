//! What a press does to every actuator, as commands and the Python package print it.

use crate::physics::limits::Electrodes;
use crate::reports::press_bounds::{
    bound_relative_mesh_error_of_sag_under_press_and_electrode_pull, bound_relative_mesh_error_of_travel_by_press_alone,
};
use crate::scene::Actuator;
use crate::table::PlanTable;
use crate::table::press::{PressEffect, Stop};
use serde::Serialize;

/// What a press does to the gaps of all actuators.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PressReport {
    /// The press in N.
    pub force_n: f64,
    /// One for each actuator, in the scene's order.
    pub actuators: Vec<PressedActuator>,
}

/// What a press does to one actuator.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PressedActuator {
    /// The actuator's id.
    pub actuator: String,
    /// Where a press moves its mass furthest, in mm.
    pub at_mm: [f64; 2],
    /// How far by itself, in um; `None` on a panel that nothing holds.
    pub alone_um: Option<f64>,
    /// Upper bound on the error of `alone_um`, relative to it; `None` where there is none.
    pub error_bound: Option<f64>,
    /// How far with the electrodes' pull at the highest voltages, a stop holding it, in um.
    pub sag_um: f64,
    /// Upper bound on the error of `sag_um`, relative to it, and so of what is left of the gap; `None` where there is none.
    pub sag_error_bound: Option<f64>,
    /// Where it is held.
    pub stop: Stop,
    /// That place in um from its middle; `None` without a stop.
    pub stop_um: Option<f64>,
    /// Springs in N/m with which it would need no stop; `None` where none would do, or none are needed.
    pub stiffness_n_per_m: Option<f64>,
    /// What is left of its gap on the nearer side, in um.
    pub gap_left_um: f64,
    /// The highest voltage that is safe from breakdown there, in V.
    pub holds_v: f64,
}

/// What the scene's press does to every actuator.
#[must_use]
pub fn build_press_report(table: &PlanTable) -> PressReport {
    let finite = |value: f64| value.is_finite().then_some(value);
    let all = table.scene.actuators.iter().zip(&table.pressed).zip(&table.electrodes).enumerate();
    let report =
        |(i, ((actuator, pressed), electrodes)): (usize, ((&Actuator, &PressEffect), &Electrodes))| PressedActuator {
            actuator: actuator.id.clone(),
            at_mm: [pressed.at_m.0 * 1e3, pressed.at_m.1 * 1e3],
            alone_um: finite(pressed.alone_m * 1e6),
            error_bound: bound_relative_mesh_error_of_travel_by_press_alone(table, i).limit_if_known(),
            sag_um: pressed.sag_m * 1e6,
            sag_error_bound: bound_relative_mesh_error_of_sag_under_press_and_electrode_pull(table, i).limit_if_known(),
            stop: pressed.stop,
            stop_um: finite(pressed.stop_m * 1e6),
            stiffness_n_per_m: pressed.stiffness_n_per_m,
            gap_left_um: electrodes.remaining_gap_under_press_m(0.0) * 1e6,
            holds_v: electrodes.breakdown_voltage_of_remaining_gap_with_margin_v(0.0).min(electrodes.max_voltage_v),
        };
    PressReport { force_n: table.scene.press_n, actuators: all.map(report).collect() }
}
