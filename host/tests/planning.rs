//! Plans on real panels: limits are kept, requests are met, and the simulated device agrees.

mod support;

use era::device::sim::Panel;
use era::planner::limits::breakdown_v;
use era::planner::{STANDARD_GRAVITY, Target};
use era::scene::{EXAMPLE_BAR, EXAMPLE_PLATE};
use era::verify::{compare, spread};

#[test]
fn plans_meet_the_request_or_say_what_limits_them() {
    for text in [EXAMPLE_PLATE, EXAMPLE_BAR] {
        let table = support::table(text);
        let surface = &table.scene.surface;
        let mut limited = 0;
        for (x_m, y_m) in spread(40, surface.length_m, surface.width_m) {
            for wanted_g in [0.05, 0.5, 3.0, 20.0] {
                let plan = table.plan(&[Target { x_m, y_m, intensity_g: Some(wanted_g) }]).unwrap();
                let reached = plan.predicted.target_peak_g;
                match &plan.limited_by {
                    None => assert!((reached / wanted_g - 1.0).abs() < 1e-6, "{reached} for {wanted_g}"),
                    Some(limit) => {
                        limited += 1;
                        assert!(reached < wanted_g && !limit.is_empty());
                    }
                }
                let frequencies: Vec<f64> = plan.drives.iter().map(|drive| drive.frequency_hz).collect();
                assert!((frequencies[0] - frequencies[1]).abs() >= 20.0 - 1e-9, "{frequencies:?}");
                for (i, drive) in plan.drives.iter().enumerate() {
                    assert!(drive.voltage_v <= 2000.0 && drive.force_n >= 0.0);
                    // Travel and breakdown, computed here from the response itself.
                    let q = era::response::modal_coordinates(&table.model, drive.frequency_hz).unwrap();
                    let travel = table.model.travel(i, &q[i]).norm() * drive.force_n;
                    assert!(travel <= 500e-6 / 3.0 * (1.0 + 1e-9), "{travel}");
                    assert!(drive.voltage_v <= 0.85 * breakdown_v(500e-6 - travel) * (1.0 + 1e-6));
                }
            }
        }
        assert!(limited > 0, "20 g is beyond these panels");
    }
}

/// The grid's best pair, against all pairs by brute force over finely divided forces.
#[test]
fn no_other_pair_has_less_energy_elsewhere() {
    let table = support::table(EXAMPLE_BAR);
    let target = Target { x_m: 0.04, y_m: 0.01, intensity_g: Some(0.2) };
    let plan = table.plan(&[target]).unwrap();
    let shape = table.model.shape_at(0.04, 0.01);
    let wanted = 0.2 * STANDARD_GRAVITY;
    let rest = |weights: [(usize, usize, f64); 2]| -> f64 {
        // Mean square beyond 10 mm on the table's own grid.
        let (mut sum, mut weight) = (0.0, 0.0);
        for (i, x) in table.grid.x_m.iter().enumerate() {
            if (x - 0.04).abs() > 0.010 {
                for (actuator, frequency, force) in weights {
                    let entry = table.entries[actuator][frequency].as_ref().unwrap();
                    let a = era::response::dot(&table.grid.shapes.row(i).transpose(), &entry.acceleration);
                    sum += table.grid.weights[i] * a.norm_sqr() * force * force;
                }
                weight += table.grid.weights[i];
            }
        }
        sum / weight
    };
    let index = |hz: f64| table.frequencies_hz.iter().position(|f| (f - hz).abs() < 1e-9).unwrap();
    let own = rest([0, 1].map(|i| (i, index(plan.drives[i].frequency_hz), plan.drives[i].force_n)));
    let mut best = f64::INFINITY;
    for a in (0..table.frequencies_hz.len()).step_by(3) {
        for b in (0..table.frequencies_hz.len()).step_by(3) {
            if (table.frequencies_hz[a] - table.frequencies_hz[b]).abs() < 20.0 {
                continue;
            }
            let gain = |i: usize, f: usize| {
                era::response::dot(&shape, &table.entries[i][f].as_ref().unwrap().acceleration).norm()
            };
            for share in 0..=10 {
                let share = f64::from(share) / 10.0;
                let forces = [share * wanted / gain(0, a), (1.0 - share) * wanted / gain(1, b)];
                let fits = |i: usize, f: usize| forces[i] <= table.entries[i][f].as_ref().unwrap().max_force_n;
                if fits(0, a) && fits(1, b) {
                    best = best.min(rest([(0, a, forces[0]), (1, b, forces[1])]));
                }
            }
        }
    }
    // The disc's own quadrature differs from the grid's by a little.
    assert!(own <= best * 1.05, "{own} against {best}");
}

/// Ten points of each example scene: the time-domain device and the frequency-domain plan, within 5 %.
#[test]
fn simulation_and_prediction_agree() {
    for text in [EXAMPLE_PLATE, EXAMPLE_BAR] {
        let table = support::table(text);
        let panel = Panel::of(&table);
        let surface = &table.scene.surface;
        for (x_m, y_m) in spread(10, surface.length_m, surface.width_m) {
            let found = compare(&table, &panel, Target { x_m, y_m, intensity_g: Some(0.5) }).unwrap();
            assert!(found.difference.abs() < 0.01, "fundamentals: {found:?}");
            assert!(found.band_difference.abs() < 0.05, "whole waveform: {found:?}");
        }
    }
}
