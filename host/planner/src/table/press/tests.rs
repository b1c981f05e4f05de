//! Against what springs and electrodes do by hand.

use super::*;
use crate::model::{Accuracy, PanelModel};
use crate::physics::limits::BreakdownTangent;
use crate::{PlanTable, TableOptions};

/// A stiff block on one grounded ERA in its middle: everything moves by P / k.
fn block(extra: &str, era: &str) -> PlanTable {
    let text = format!(
        r#"
        version = 1
        name = "block"
        [surface]
        kind = "bar"
        length_mm = 20.0
        width_mm = 20.0
        thickness_mm = 20.0
        [surface.material]
        youngs_modulus_pa = 70e9
        poisson_ratio = 0.33
        density_kg_m3 = 2700.0
        [screen]
        width_px = 100
        height_px = 100
        {extra}
        [[edge]]
        side = "left"
        kind = "elastic"
        stiffness_n_per_m = 0.0
        rotational_stiffness_n_m_per_rad = 1e5
        [[actuator]]
        id = "a"
        x_mm = 10.0
        mount = "grounded"
        moving_mass_g = 1.0
        stiffness_n_per_m = 40000.0
        damping_n_s_per_m = 1.0
        electrode_area_mm2 = 1963.5
        air_gap_um = 500.0
        max_voltage_v = 2000.0
        {era}
        "#
    );
    let scene = Scene::parse("block", &text).unwrap();
    let options = TableOptions { step_hz: 20.0, ..TableOptions::default() };
    let model = PanelModel::build(&scene, Accuracy::FAST, options.to_hz)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(options.to_hz, &[])
        .unwrap();
    PlanTable::build(&scene, model, options).unwrap()
}

/// To the top of a hill between the points, and to the border of a surface with a slope.
#[test]
fn the_largest_value_is_found_between_points_and_at_borders() {
    let hill = |(x, y): (f64, f64)| 3.0 - (x - 0.137).powi(2) - 2.0 * (y - 0.071).powi(2) + (x - 0.137) * (y - 0.071);
    let start = (0.1, 0.1);
    let ((x, y), top) = climb_to_largest_value((start, hill(start)), (0.05, 0.05), (0.3, 0.2), hill);
    assert!((x - 0.137).abs() < 1e-5 && (y - 0.071).abs() < 1e-5 && (top - 3.0).abs() < 1e-10, "{x} {y} {top}");
    let slope = |(x, y): (f64, f64)| if x > 0.25 { 0.0 } else { x - 0.1 * y };
    let ((x, y), _) = climb_to_largest_value((start, slope(start)), (0.04, 0.04), (0.3, 0.2), slope);
    assert!((x - 0.25).abs() < 1e-6 && y == 0.0, "{x} {y}");
    // A bar has one row.
    let ((x, y), _) = climb_to_largest_value((start, hill(start)), (0.05, f64::INFINITY), (0.3, 0.2), hill);
    assert!((x - 0.1515).abs() < 1e-5 && y == 0.1, "{x} {y}");
}

#[test]
fn springs_that_bear_it() {
    let table = block("[press]\nforce_n = 2.0", "");
    let pressed = table.pressed[0];
    // 2 N on 40 kN/m: 50 um.
    assert!((pressed.alone_m / 50e-6 - 1.0).abs() < 2e-3, "{pressed:?}");
    assert_eq!((pressed.stop, pressed.stop_m, pressed.stiffness_n_per_m), (Stop::None, f64::INFINITY, None));
    // 2 kV take 2 F / g = 555 N/m off it, for 0.96 of the time: x = (P + s x / (1 - u^2)^2) / k, by bisection.
    let s = 0.96 * 8.854e-12 * 1.9635e-3 * 2000.0_f64.powi(2) / 0.5e-3_f64.powi(3);
    let rest = |x: f64| 40e3 * x - 2.0 - s * x / (1.0 - (x / 0.5e-3).powi(2)).powi(2);
    let (mut low, mut high) = (0.0, 100e-6);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if rest(middle) > 0.0 { &mut high } else { &mut low }) = middle;
    }
    assert!((pressed.sag_m / low - 1.0).abs() < 3e-3, "{} {low}", pressed.sag_m);
    assert_eq!(table.electrodes[0].sag_m, pressed.sag_m);
}

#[test]
fn a_stop_holds_what_springs_do_not() {
    // 10 N: 250 um, half of the gap.
    let assumed = block("[press]\nforce_n = 10.0", "").pressed[0];
    assert_eq!(assumed.stop, Stop::Assumed);
    assert!((assumed.sag_m - 0.5e-3 / 3.0).abs() < 1e-12 && assumed.sag_m == assumed.stop_m, "{assumed:?}");
    // Springs of a bit more than 1.5 times the stiffness would do; with them it is borne, with some less it is not.
    let enough = assumed.stiffness_n_per_m.unwrap();
    assert!(enough > 60e3 && enough < 63e3, "{enough}");
    let with = |stiffness: f64| stop_with_stiffness(&block("[press]\nforce_n = 10.0", ""), stiffness);
    assert_eq!(with(enough * 1.001), Stop::None);
    assert_eq!(with(enough * 0.99), Stop::Assumed);
    let given = block("[press]\nforce_n = 10.0", "stop_um = 120").pressed[0];
    assert_eq!((given.stop, given.stiffness_n_per_m), (Stop::Given, None));
    assert!((given.sag_m - 120e-6).abs() < 1e-12);
    // One that is not reached.
    let far = block("[press]\nforce_n = 2.0", "stop_um = 120").pressed[0];
    assert!(far.stop == Stop::Given && far.sag_m < 60e-6, "{far:?}");
    let none = block("[press]\nforce_n = 0.0", "").pressed[0];
    assert_eq!((none.alone_m, none.sag_m, none.stop), (0.0, 0.0, Stop::None));
}

/// Where the mass is held with springs of another stiffness.
fn stop_with_stiffness(table: &PlanTable, stiffness_n_per_m: f64) -> Stop {
    let mut scene = table.scene.clone();
    scene.actuators[0].stiffness_n_per_m = stiffness_n_per_m;
    let options = TableOptions { step_hz: 20.0, ..TableOptions::default() };
    let model = PanelModel::build(&scene, Accuracy::FAST, options.to_hz)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(options.to_hz, &[])
        .unwrap();
    PlanTable::build(&scene, model, options).unwrap().pressed[0].stop
}

/// The force law of one electrode after the other, at its two ends.
#[test]
fn what_a_press_leaves_of_gap_and_springs() {
    let free = Electrodes {
        area_m2: 1e-3,
        gap_m: 0.5e-3,
        max_voltage_v: 2000.0,
        stop_m: f64::INFINITY,
        sag_m: 0.0,
        capacitance_f: 116e-12,
        charging: crate::scene::ChargingTimes::default(),
    };
    let sagging = Electrodes { sag_m: 100e-6, ..free };
    assert!((sagging.remaining_gap_under_press_m(50e-6) - 350e-6).abs() < 1e-12);
    assert!((free.softening_under_press_relative_to_rest() - 1.0).abs() < 1e-12);
    // The slope of u / (1 - u^2)^2 by differences.
    let h = 1e-6;
    assert!(
        (sagging.softening_under_press_relative_to_rest()
            - (mean_pull_over_softening_times_gap_at_offset(0.2 + h)
                - mean_pull_over_softening_times_gap_at_offset(0.2 - h))
                / (2.0 * h))
            .abs()
            < 1e-6
    );
    let stopped = Electrodes { sag_m: 150e-6, stop_m: 150e-6, ..free };
    assert!((stopped.remaining_gap_under_press_m(100e-6) - 350e-6).abs() < 1e-12);
    assert!(
        (stopped.softening_under_press_relative_to_rest() - mean_pull_over_softening_times_gap_at_offset(0.3) / 0.3)
            .abs()
            < 1e-12
    );
    assert!((stopped.max_travel_m() - 150e-6).abs() < 1e-12);
    // No voltage that the tangent allows is above what the gap holds.
    for electrodes in [free, sagging, stopped, Electrodes { stop_m: 200e-6, ..sagging }] {
        let BreakdownTangent { slope_v2_per_m, bound_v2 } =
            electrodes.tangent_of_squared_breakdown_voltage_over_travel();
        for part in 0..=20 {
            let travel = electrodes.max_travel_m() * f64::from(part) / 20.0;
            let most_v = (bound_v2 - slope_v2_per_m * travel).max(0.0).sqrt();
            assert!(
                most_v <= electrodes.breakdown_voltage_of_remaining_gap_with_margin_v(travel) * (1.0 + 1e-12),
                "{electrodes:?} {part}"
            );
            assert!(
                most_v >= 0.8 * electrodes.breakdown_voltage_of_remaining_gap_with_margin_v(travel),
                "{electrodes:?} {part}"
            );
        }
    }
}
