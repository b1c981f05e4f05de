//! The ways to drive a panel, against each other and against the limits.

use era_model::model::Accuracy;
use era_model::model::levels::ReducedLevels;
use era_model::scene::{EXAMPLE_BAR, STARTING_PLATE, Scene};
use era_planner::maps::{ReachMaps, SchemeReach, rigid, schemes};
use era_planner::reach::setting::{build_setting_with_strongest_pulse, derate_setting_to_safe_fraction_if_any};
use era_planner::reach::{Measure, max_min_setting_and_relative_gap_if_spacing_can_be_kept};
use era_planner::table::{ActuatorSetting, Region};
use era_planner::{Objective, PlanError, PlanTable, Request, TableOptions, Target};

fn table(text: &str, options: TableOptions) -> PlanTable {
    let scene = Scene::parse("test", text).unwrap();
    let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
    PlanTable::build(&scene, levels.fine, options).unwrap()
}

/// The bar's rigid motions and its first bending modes.
const COARSE: TableOptions = TableOptions { from_hz: 40.0, to_hz: 240.0, step_hz: 5.0 };

fn compared(table: &PlanTable) -> Vec<SchemeReach> {
    schemes::compare_schemes(table, None, Measure::G).unwrap()
}

/// What is reported is what may be commanded: voltages within the scene's, and nothing left that safety would take away.
#[test]
fn settings_are_within_the_limits() {
    // Electrodes so large, and gaps so small, that voltage, travel and softening all matter.
    let soft = EXAMPLE_BAR
        .replace("air_gap_um = 500.0", "air_gap_um = 250.0")
        .replace("max_voltage_v = 2000.0", "max_voltage_v = 900.0");
    for text in [EXAMPLE_BAR, &soft] {
        let table = table(text, COARSE);
        let schemes = compared(&table);
        assert_eq!(schemes.len(), 3);
        for scheme in schemes {
            for (part, actuator) in scheme.setting.iter().zip(&table.scene.actuators) {
                assert!(part.drive.voltage_v <= actuator.max_voltage_v * (1.0 + 1e-9), "{scheme:?}");
                assert!(part.drive.force_n >= 0.0 && (0.5..1.0).contains(&part.drive.pulse_width), "{scheme:?}");
            }
            let mut again = scheme.setting.clone();
            let scale = derate_setting_to_safe_fraction_if_any(&table, &mut again).unwrap();
            assert!(scale > 0.995, "{scale}: {scheme:?}");
            assert!(scheme.one_setting.least <= scheme.one_setting_at_most.unwrap_or(f64::INFINITY) * (1.0 + 1e-9));
        }
    }
}

/// Where there is only one actuator that can do anything, the ways to drive are one and the same, and so have to be their
/// limits.
#[test]
fn one_actuator_reaches_the_same_in_every_way() {
    let second = EXAMPLE_BAR.rfind("max_voltage_v = 2000.0").unwrap();
    let weak = format!("{}max_voltage_v = 1.0\n", &EXAMPLE_BAR[..second]);
    let alone = &EXAMPLE_BAR[..EXAMPLE_BAR.rfind("[[actuator]]").unwrap()];
    for text in [&weak, alone] {
        let table = table(text, COARSE);
        let schemes = compared(&table);
        let same = |a: f64, b: f64| (a - b).abs() <= 0.02 * b;
        for scheme in &schemes {
            let (one, distinct) = (scheme.one_setting, schemes[2].one_setting);
            assert!(same(one.least, distinct.least) && same(one.most, distinct.most), "{one:?} {distinct:?}");
            let (one, distinct) = (scheme.per_touch, schemes[2].per_touch);
            assert!(same(one.least, distinct.least) && same(one.most, distinct.most), "{one:?} {distinct:?}");
        }
    }
}

/// In phase is one of the phases, and a setting for a touch may be the one for all.
#[test]
fn more_choice_is_not_less_reach() {
    let schemes = compared(&table(EXAMPLE_BAR, COARSE));
    let [in_phase, phases, _] = schemes.as_slice() else { panic!("{schemes:?}") };
    assert!(phases.one_setting.least >= in_phase.one_setting.least * (1.0 - 1e-6));
    for scheme in &schemes {
        for (one, touch) in scheme.one_setting_field.iter().zip(&scheme.per_touch_field) {
            // Rounding of the last step to safety, a thousandth of the forces.
            assert!(touch.unwrap() >= 0.995 * one.unwrap(), "{}", scheme.scheme.name());
        }
    }
}

/// A region's minimum is that of a subset, and of its points as much is reachable as before.
#[test]
fn a_region_is_a_part_of_the_surface() {
    let table = table(EXAMPLE_BAR, COARSE);
    let region = Region { x_m: [0.1, 0.15], y_m: [0.0, 0.02] };
    let (whole, part) = (ReachMaps::compute(&table, None).unwrap(), ReachMaps::compute(&table, Some(region)).unwrap());
    let mut seen = 0;
    for (point, x_mm) in whole.x_mm.iter().enumerate() {
        let within = (100.0 - 1e-6..=150.0 + 1e-6).contains(x_mm);
        assert_eq!(part.strongest_g[point].is_some(), within);
        if within {
            seen += 1;
            let (a, b) = (part.strongest_g[point].unwrap(), whole.strongest_g[point].unwrap());
            assert!((a - b).abs() <= 1e-6 * b, "{x_mm}: {a} {b}");
            assert!(part.strongest_hz[point].is_some() && part.contrast_hz[point].is_some());
        }
    }
    assert!(seen > 3);
    let of_region = schemes::compare_schemes(&table, Some(region), Measure::G).unwrap();
    for (whole, part) in compared(&table).iter().zip(&of_region) {
        assert!(part.one_setting.least >= 0.999 * whole.one_setting.least);
    }
    let beside = Region { x_m: [0.1001, 0.1002], y_m: [0.0, 0.02] };
    assert!(ReachMaps::compute(&table, Some(beside)).is_err());
}

/// The bar on its two springs moves as a rigid body at 60 Hz, and bends at 200 Hz; free, it would first bend at 1.028 h / L^2
/// sqrt(E / rho) = 166 Hz, which masses of 10 g near its ends lower.
#[test]
fn rigid_motion_is_told_from_bending() {
    let table = table(EXAMPLE_BAR, COARSE);
    let first = rigid::first_bending_mode_moving_surface_if_any_hz(&table).unwrap();
    assert!((100.0..170.0).contains(&first), "{first}");
    let setting = |hz: f64| -> Vec<ActuatorSetting> {
        let frequency = table.frequencies_hz.iter().position(|other| *other == hz).unwrap();
        (0..2).map(|i| build_setting_with_strongest_pulse(&table, i, frequency, 0.01.into())).collect()
    };
    let part = |hz: f64| rigid::rigid_fraction_of_mean_square_unless_at_rest(&table, &setting(hz)).unwrap();
    assert!(part(60.0) > 0.95 && part(200.0) < 0.5, "{} {}", part(60.0), part(200.0));
    assert_eq!(rigid::rigid_fraction_of_mean_square_unless_at_rest(&table, &[]), None);
}

/// Frequencies left out of a table, and a table that never had them: the same entries, limits and plans.
#[test]
fn a_part_of_a_band_is_that_band() {
    for text in [EXAMPLE_BAR, STARTING_PLATE] {
        let whole = TableOptions { from_hz: 40.0, to_hz: 240.0, step_hz: 4.0 };
        let cut = table(text, whole).keep_frequencies_between_if_any(119.0, 240.0).unwrap();
        let built = table(text, TableOptions { from_hz: 120.0, ..whole });
        assert_eq!(cut.frequencies_hz, built.frequencies_hz);
        for (a, b) in cut.entries.iter().flatten().zip(built.entries.iter().flatten()) {
            let (a, b) = (a.as_ref().unwrap(), b.as_ref().unwrap());
            assert!((&a.acceleration - &b.acceleration).norm() <= 1e-9 * b.acceleration.norm());
            assert!((a.max_force_n - b.max_force_n).abs() <= 1e-9 * b.max_force_n);
            assert!((a.mean_square - b.mean_square).abs() <= 1e-9 * b.mean_square);
        }
        let touch = Target { x_m: 0.06, y_m: 0.01, intensity_g: Some(0.3) };
        let (a, b) = (cut.plan(&[touch]).unwrap(), built.plan(&[touch]).unwrap());
        for (a, b) in a.drives.iter().zip(&b.drives) {
            assert!((a.frequency_hz - b.frequency_hz).abs() <= 1e-6 * b.frequency_hz, "{a:?} {b:?}");
            assert!((a.force_n - b.force_n).abs() <= 1e-6 * b.force_n, "{a:?} {b:?}");
        }
        let (a, b) = (
            max_min_setting_and_relative_gap_if_spacing_can_be_kept(&cut, None).unwrap(),
            max_min_setting_and_relative_gap_if_spacing_can_be_kept(&built, None).unwrap(),
        );
        assert!(a.0.iter().zip(&b.0).all(|(a, b)| a.frequency == b.frequency));
    }
    let narrow = table(EXAMPLE_BAR, COARSE);
    assert!(
        narrow.clone().keep_frequencies_between_if_any(401.0, 500.0).is_none()
            && narrow.keep_frequencies_between_if_any(200.0, 100.0).is_none()
    );
}

/// A touch for the objective reach, of a part of the surface: nowhere in it is it weaker than the whole surface's is anywhere in it,
/// and what makes no sense is refused by name.
#[test]
fn a_touch_may_ask_for_the_reach_of_a_region() {
    let table = table(EXAMPLE_BAR, COARSE);
    let target = Target { x_m: 0.12, y_m: 0.0, intensity_g: Some(1e3) };
    let region = Region { x_m: [0.1, 0.15], y_m: [0.0, 0.02] };
    let request = |zone| Request { objective: Objective::Reach, zone, ..Request::for_touch(&[target]) };
    let weakest = |zone| {
        let plan = table.plan_request(&request(zone)).unwrap();
        let peaks = table.compute_peak_at_each_grid_point_m_per_s2(&plan);
        let columns = table.grid.x_m.len();
        let own = peaks.iter().enumerate().filter(|(point, _)| (0.1..=0.15).contains(&table.grid.x_m[point % columns]));
        own.filter_map(|(_, peak)| *peak).fold(f64::INFINITY, f64::min)
    };
    let (part, whole) = (weakest(Some(region)), weakest(None));
    assert!(part > 1.02 * whole, "{part} {whole}");
    let refused = |request: Request| table.plan_request(&request).unwrap_err();
    let contrast = Request { objective: Objective::Contrast, ..request(Some(region)) };
    assert!(matches!(refused(contrast), PlanError::Together { option: "zone", .. }));
    let outside = Region { x_m: [0.1, 3.0], ..region };
    assert!(matches!(refused(request(Some(outside))), PlanError::Range { field: "zone.x_mm", .. }));
    let beside = Region { x_m: [0.1001, 0.1002], ..region };
    assert_eq!(refused(request(Some(beside))), PlanError::EmptyZone);
}
