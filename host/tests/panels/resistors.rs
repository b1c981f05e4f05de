//! Electrodes behind resistors: relations between answers, and plans against the device in time.

use crate::support;
use era::device::sim::SimPanel;
use era::model::{Accuracy, PanelModel};
use era::planner::{Grouping, Plan, PlanTable, Request, TableOptions, Target};
use era::response::compute_acceleration_curves_per_newton_with_error_bounds;
use era::scene::{STARTING_PLATE, Scene};
use era::verify::{compare_plan_with_simulation, compare_planned_request_with_simulation};
use era_shared::limits::MAX_AVERAGE_MICROAMPS;
use era_shared::supply::{RAILS, mean_current_of_drives_and_bleeders_microamps, rail_index_of_channel};

/// The board's drive stage.
const STAGE: &str = "charging_resistance_ohm = 1e6\ndischarging_resistance_ohm = 1e5\ndischarging_delay_us = 15\n";
/// One resistor in common.
const ALIKE: &str = "charging_resistance_ohm = 1e6\n";
/// One target of the example plate.
const TARGET: Target = Target { x_m: 0.2, y_m: 0.06, intensity_g: Some(0.3) };

/// The example plate with a table `[electronics]` and, beside both electrodes, this many pF.
fn plate_with_electronics(electronics: &str, cables_pf: [f64; 2]) -> String {
    let mut text = String::new();
    let mut cables = cables_pf.into_iter();
    for line in STARTING_PLATE.lines() {
        text += line;
        text.push('\n');
        if line.starts_with("max_voltage_v") {
            text += &format!("cable_capacitance_pf = {}\n", cables.next().unwrap());
        }
    }
    if electronics.is_empty() { text } else { format!("{text}\n[electronics]\n{electronics}") }
}

fn table_with_electronics(electronics: &str, cables_pf: [f64; 2]) -> PlanTable {
    support::table(&plate_with_electronics(electronics, cables_pf))
}

fn plan_for_intensity_g(table: &PlanTable, intensity_g: f64) -> Plan {
    table.plan(&[Target { intensity_g: Some(intensity_g), ..TARGET }]).unwrap()
}

/// Largest relative difference of two plans' drives and peaks.
fn largest_relative_difference(a: &Plan, b: &Plan) -> f64 {
    let pairs = a.drives.iter().zip(&b.drives).flat_map(|(a, b)| {
        [
            (a.frequency_hz, b.frequency_hz),
            (a.force_n, b.force_n),
            (a.voltage_v, b.voltage_v),
            (a.pulse_width, b.pulse_width),
        ]
    });
    let all = pairs.chain([(a.predicted.target_peak_g, b.predicted.target_peak_g)]);
    all.map(|(a, b)| (a - b).abs() / a.abs().max(b.abs()).max(f64::MIN_POSITIVE)).fold(0.0, f64::max)
}

/// No resistance is no table, to the last bit, and hardly any is hardly a difference; capacitances do not matter then.
#[test]
fn without_resistance_nothing_changes() {
    let (none, zero, hardly) = (
        plan_for_intensity_g(&table_with_electronics("", [81.0, 81.0]), 0.3),
        plan_for_intensity_g(&table_with_electronics("charging_resistance_ohm = 0\n", [81.0, 81.0]), 0.3),
        plan_for_intensity_g(&table_with_electronics("charging_resistance_ohm = 10\n", [81.0, 81.0]), 0.3),
    );
    assert_eq!(none.drives, zero.drives);
    assert_eq!(none.predicted, zero.predicted);
    assert!(none.drives.iter().all(|drive| drive.force_phase_rad == drive.phase_rad));
    assert!(largest_relative_difference(&none, &hardly) < 1e-4, "{none:?} {hardly:?}");
    let other_cables = plan_for_intensity_g(&table_with_electronics("", [300.0, 20.0]), 0.3);
    assert_eq!(none.drives, other_cables.drives);
}

/// What the model says of the panel has no part in what the electrodes do.
#[test]
fn modes_and_responses_know_no_electronics() {
    let [without, with] = [("", [81.0, 81.0]), (STAGE, [200.0, 30.0])].map(|(text, cables)| {
        let scene = Scene::parse("plate", &plate_with_electronics(text, cables)).unwrap();
        let at = (TARGET.x_m, TARGET.y_m);
        compute_acceleration_curves_per_newton_with_error_bounds(&scene, Accuracy::FAST, at, &[60.0, 145.0, 390.0])
            .unwrap()
            .answer
    });
    assert_eq!(without, with);
}

/// Twice the capacitance behind half the resistance charges as fast: 34.7704 pF are the electrodes' own.
#[test]
fn resistance_times_capacitance_is_what_counts() {
    let own = 34.7704;
    let halves = "charging_resistance_ohm = 5e5\ndischarging_resistance_ohm = 5e4\ndischarging_delay_us = 15\n";
    let (one, other) = (
        plan_for_intensity_g(&table_with_electronics(STAGE, [81.0, 81.0]), 0.3),
        plan_for_intensity_g(&table_with_electronics(halves, [2.0 * 81.0 + own; 2]), 0.3),
    );
    assert!(largest_relative_difference(&one, &other) < 1e-5, "{one:?} {other:?}");
    let phases = |plan: &Plan| plan.drives.iter().map(|drive| drive.force_phase_rad).collect::<Vec<_>>();
    for (a, b) in phases(&one).iter().zip(phases(&other)) {
        assert!((a - b).abs() < 1e-5 && *a < -0.02, "{a} {b}");
    }
}

/// The force of a drive is never above the contract's law, 4/pi sin(pi w/2) eps0 S V^2 / (2 g^2), and a harder wish is met by less and
/// less of it the more resistance there is.
#[test]
fn more_resistance_means_less_force() {
    let mut before = f64::INFINITY;
    for ohm in [0.0, 2e5, 1e6, 2e6, 4e6] {
        let table = table_with_electronics(&format!("charging_resistance_ohm = {ohm}\n"), [81.0; 2]);
        let plan = plan_for_intensity_g(&table, 1e3);
        let mut most_lost = 0.0_f64;
        for (drive, electrodes) in plan.drives.iter().zip(&table.electrodes) {
            let law = 4.0 / std::f64::consts::PI
                * (std::f64::consts::FRAC_PI_2 * drive.pulse_width).sin()
                * electrodes.force_at_rest_n_per_v2()
                * drive.voltage_v.powi(2);
            assert!(drive.force_n <= law * (1.0 + 1e-9), "{ohm}: {drive:?}, law {law}");
            most_lost = most_lost.max(1.0 - drive.force_n / law);
        }
        assert!(ohm < 1e6 || most_lost > 0.02, "{ohm}: {most_lost}");
        // Which pulses are chosen changes what travel leaves: some per cent.
        assert!(plan.predicted.target_peak_g < 1.02 * before, "{ohm}: {} {before}", plan.predicted.target_peak_g);
        before = plan.predicted.target_peak_g;
    }
}

/// Plans in the simulated device, whose electrodes are stepped in time. The plans of a scene without resistors are off by more, so that the
/// agreement is not one of two parts that both know nothing of the circuit.
#[test]
fn simulated_electrodes_do_what_plans_say() {
    let ideal = table_with_electronics("", [81.0; 2]);
    for electronics in [STAGE, ALIKE] {
        let table = table_with_electronics(electronics, [81.0, 140.0]);
        let panel = SimPanel::from_plan_table(&table);
        for (x_m, y_m, g) in [(0.2, 0.06, 0.3), (0.1, 0.12, 0.5), (0.2, 0.06, 1e3)] {
            let target = Target { x_m, y_m, intensity_g: Some(g) };
            let found = compare_plan_with_simulation(&table, &panel, target).unwrap();
            println!(
                "{g} g: difference {:+.2e}, causal {:+.2e}, plan {:+.2e}, band {:+.2e}",
                found.difference, found.causal_difference, found.plan_difference, found.band_difference
            );
            assert!(found.causal_difference.abs() < 0.005 && found.plan_difference.abs() < 0.01, "{found:?}");
            assert!(found.band_difference.abs() < 0.05, "{found:?}");
            for travel in &found.travel {
                assert!(travel.simulated < 0.34 && travel.simulated < 1.05 * travel.predicted + 1e-3, "{found:?}");
            }
            let without = compare_plan_with_simulation(&ideal, &panel, target).unwrap();
            assert!(without.causal_difference < -0.01, "{without:?}");
            assert!(found.causal_difference.abs() < -0.2 * without.causal_difference, "{found:?} {without:?}");
        }
    }
}

/// Two ERAs at one frequency whose electrodes are not equally fast: the forces keep the phases that cancel elsewhere.
#[test]
fn phases_of_unequal_electrodes_are_kept() {
    let table = table_with_electronics(STAGE, [40.0, 300.0]);
    let panel = SimPanel::from_plan_table(&table);
    let request = Request { grouping: Grouping::Shared, ..Request::for_touch(&[TARGET]) };
    let plan = table.plan_request(&request).unwrap();
    let [left, right] = plan.drives.as_slice() else { panic!("{plan:?}") };
    let lags = [left, right].map(|drive| drive.phase_rad - drive.force_phase_rad);
    assert!(lags[1] - lags[0] > 0.05, "{lags:?}");
    let found = compare_planned_request_with_simulation(&table, &panel, &request).unwrap();
    assert!(found.causal_difference.abs() < 0.005 && found.plan_difference.abs() < 0.01, "{found:?}");
}

/// A plan that the supply limits uses it up, and the board, which counts in whole uA, does not refuse it.
#[test]
fn the_board_takes_a_plan_at_the_supplys_limit() {
    let mut text = plate_with_electronics("", [81.0; 2]);
    let era = |id: &str, x: f64, y: f64| {
        let own = STARTING_PLATE.split("[[actuator]]").nth(1).unwrap();
        let own = own.lines().map(|line| match line.split(' ').next() {
            Some("id") => format!("id = \"{id}\""),
            Some("x_mm") => format!("x_mm = {x}"),
            Some("y_mm") => format!("y_mm = {y}"),
            _ => line.to_owned(),
        });
        format!("\n[[actuator]]\n{}\n", own.collect::<Vec<_>>().join("\n"))
    };
    text += &era("third", 60.0, 50.0);
    text += &era("fourth", 240.0, 150.0);
    let scene = Scene::parse("four", &text).unwrap();
    let options = TableOptions { from_hz: 320.0, to_hz: 400.0, step_hz: 2.0 };
    let model = PanelModel::build(&scene, Accuracy::FAST, 400.0).unwrap();
    let table = PlanTable::build(
        &scene,
        model.reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[]).unwrap(),
        options,
    )
    .unwrap();
    let plan = table.plan(&[Target { intensity_g: Some(1e3), ..TARGET }]).unwrap();
    assert!(plan.limited_by.as_deref().is_some_and(|limits| limits.contains("supply")), "{plan:?}");
    let board = |scale: f64| {
        let mut rails = [0_u32; RAILS];
        for (channel, drive) in plan.drives.iter().enumerate() {
            let rail = &mut rails[rail_index_of_channel(channel)];
            *rail = (*rail).max((drive.voltage_v * scale * 1e3).round() as u32);
        }
        let driven = plan.drives.iter().enumerate().filter(|(_, drive)| drive.voltage_v > 0.0);
        mean_current_of_drives_and_bleeders_microamps(
            rails,
            driven.map(|(channel, drive)| (channel, (drive.frequency_hz * 1e9) as u64)),
        )
    };
    assert!((MAX_AVERAGE_MICROAMPS - 8..=MAX_AVERAGE_MICROAMPS).contains(&board(1.0)), "{}", board(1.0));
    assert!(board(1.02) > MAX_AVERAGE_MICROAMPS);
}
