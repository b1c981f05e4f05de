//! Plans for ERAs that electrodes nearly hold by themselves, that move nothing, or whose pulses may be wide.

use era_planner::maps::ReachMaps;
use era_planner::{Objective, Request, Target};
use std::fmt::Write;

/// A thin bar on springs with two ERAs; `era0` has a spring of 33 N/m, which 166 V on an electrode would take away.
fn soft_bar() -> String {
    let mut text = String::from(
        "version = 1\nname = \"soft bar\"\n[surface]\nkind = \"bar\"\nlength_mm = 312.0\nwidth_mm = 29.0\nthickness_mm = 0.203\n\
         [surface.material]\nyoungs_modulus_pa = 133.7e9\ndensity_kg_m3 = 1728.5\npoisson_ratio = 0.016\n\
         [surface.damping]\nrayleigh_alpha = 17.86\nrayleigh_beta = 1.388e-6\n",
    );
    for x in [0.0, 312.0] {
        writeln!(text, "[[support]]\nx_mm = {x}\nstiffness_n_per_m = 349.6\ndamping_n_s_per_m = 0.0745").unwrap();
    }
    let eras = [
        ("era0", 109.0, 0.294, 33.24, 0.0221, 2147.8, 251.0, 648.0),
        ("era1", 78.0, 0.0784, 158.1, 0.00433, 1091.6, 637.0, 982.0),
    ];
    for (id, x, mass, stiffness, damping, area, gap, volts) in eras {
        writeln!(
            text,
            "[[actuator]]\nid = \"{id}\"\nx_mm = {x}\nmount = \"grounded\"\nmoving_mass_g = {mass}\nstiffness_n_per_m = {stiffness}\n\
             damping_n_s_per_m = {damping}\nelectrode_area_mm2 = {area}\nair_gap_um = {gap}\nmax_voltage_v = {volts}",
        )
        .unwrap();
    }
    text
}

/// A bar that is clamped on its right, with one ERA on that edge and one 20 mm from it that moves its target a thousand times less
/// than the first does.
fn clamped_bar() -> String {
    let mut text = String::from(
        "version = 1\nname = \"clamped bar\"\n[surface]\nkind = \"bar\"\nlength_mm = 586.6\nwidth_mm = 19.1\nthickness_mm = 39.1\n\
         [surface.material]\nyoungs_modulus_pa = 33.8e9\ndensity_kg_m3 = 3883.5\npoisson_ratio = 0.16\n\
         [surface.damping]\nloss_factor = 0.0025\n[[edge]]\nside = \"right\"\nkind = \"clamped\"\n",
    );
    for (id, x) in [("free", 0.0), ("edge", 586.6), ("middle", 180.2), ("beside", 565.0)] {
        writeln!(
            text,
            "[[actuator]]\nid = \"{id}\"\nx_mm = {x}\nmount = \"grounded\"\nmoving_mass_g = 9.4\nstiffness_n_per_m = 27674.0\n\
             damping_n_s_per_m = 0.35\nelectrode_area_mm2 = 2663.0\nair_gap_um = 873.0\nmax_voltage_v = 972.0",
        )
        .unwrap();
    }
    text
}

/// A bound on the force of one that is hardly held must not make others weaker than they are with a smaller wish.
#[test]
fn whoever_asks_for_more_does_not_get_less() {
    let table = super::build_table(&soft_bar());
    for x_m in [0.091, 0.1625, 0.2665, 0.312] {
        let (mut most, mut last) = (0.0_f64, 0.0_f64);
        for wanted_g in [0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 20.0, 1000.0] {
            let plan = table.plan(&[Target { x_m, y_m: 0.0, intensity_g: Some(wanted_g) }]).unwrap();
            last = plan.predicted.target_peak_g;
            assert!(last >= 0.9 * most, "{last} g where {most} g were had, {wanted_g} wanted at {x_m}: {plan:?}");
            most = most.max(last);
        }
        assert!(last >= most * (1.0 - 1e-3), "{last} of {most} at {x_m}");
    }
}

/// Of an ERA on an edge that does not move there is only rounding.
#[test]
fn an_era_that_moves_nothing_is_not_driven() {
    let table = super::build_table(&clamped_bar());
    for (x_m, wanted_g) in [(0.01, 1e-4), (0.2, 1e-3), (0.5377, 1e-6), (0.5377, 1e-4), (0.5377, 10.0)] {
        let plan = table.plan(&[Target { x_m, y_m: 0.0, intensity_g: Some(wanted_g) }]).unwrap();
        let edge = plan.drives.iter().find(|drive| drive.actuator == "edge").unwrap();
        assert_eq!((edge.voltage_v, edge.force_n), (0.0, 0.0), "{plan:?}");
    }
}

/// Contrast has no unit: of a weak peak it is that of any weaker one.
#[test]
fn contrast_maps_are_of_peaks_that_no_limit_changes() {
    let table = super::build_table(&clamped_bar());
    let maps = ReachMaps::compute(&table, None).unwrap();
    for k in (0..maps.x_mm.len()).step_by(7) {
        let Some(contrast_db) = maps.contrast_db[k] else { continue };
        let peak_g = maps.strongest_g[k].unwrap();
        // Where next to nothing moves there is nothing to compare.
        if peak_g < 1e-9 {
            continue;
        }
        let weak = Target { x_m: maps.x_mm[k] * 1e-3, y_m: 0.0, intensity_g: Some(1e-8 * peak_g) };
        let plan = table.plan(&[weak]).unwrap();
        assert!((plan.predicted.contrast_db - contrast_db).abs() < 1e-3, "{} mm: {contrast_db}", maps.x_mm[k]);
    }
}

/// For the same force the widest pulse takes the least voltage, and so the least power, whatever limits the force.
#[test]
fn least_power_takes_the_widest_pulses() {
    for text in [soft_bar(), era_model::scene::STARTING_PLATE.to_owned()] {
        let table = super::build_table(&text);
        for x_m in [0.05, 0.11, 0.2] {
            let targets = [Target { x_m, y_m: 0.02, intensity_g: Some(0.05) }];
            let request = Request { objective: Objective::Power, ..Request::for_touch(&targets) };
            let plan = table.plan_request(&request).unwrap();
            for drive in plan.drives.iter().filter(|drive| drive.force_n > 0.0) {
                // A board's guard of 200 us and a tenth.
                let widest = (1.0 - 2.0 * drive.frequency_hz * 220e-6).min(0.96);
                assert!((drive.pulse_width - widest).abs() < 2e-3, "{drive:?}, {widest}");
            }
        }
    }
}
