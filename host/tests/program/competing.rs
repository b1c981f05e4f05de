//! Plans whose targets, quiet zones or limits compete: what is had, what could be had, and what limits it.

use crate::support;
use era::planner::perception::felt_weight_relative_to_reference_hz;
use era::planner::table::acceleration_at_point_from_coordinates;
use era::planner::trade::{TradeOffs, explore_trade_offs_if_wishes_conflict, plan_and_improve_by_exploring_trade_offs};
use era::planner::{
    Grouping, Objective, Plan, PlanError, PlanTable, QuietZone, Request, STANDARD_GRAVITY, SearchEffort, Target, Weigh,
};
use era::scene::{EXAMPLE_BAR, STARTING_PLATE};
use era::verify::spread_points;

fn trade_of(table: &PlanTable, targets: &[(f64, f64, f64)], quiet: &[QuietZone]) -> (Request, TradeOffs) {
    let targets: Vec<Target> =
        targets.iter().map(|(x_m, y_m, g)| Target { x_m: *x_m, y_m: *y_m, intensity_g: Some(*g) }).collect();
    let request = Request { quiet: quiet.to_vec(), ..Request::for_touch(&targets) };
    let plan = table.plan_request(&request).unwrap();
    assert!(plan.limited_by.is_some(), "{plan:?}");
    let trade = explore_trade_offs_if_wishes_conflict(table, &request, &plan).unwrap().unwrap();
    (request, trade)
}

/// More for one is less for the others; nothing for one is all that the others can have; all points are plans, and a little more is
/// beyond reach.
#[test]
fn what_targets_can_have_together_is_a_falling_curve() {
    let table = support::table(EXAMPLE_BAR);
    let places: &[&[(f64, f64, f64)]] =
        &[&[(0.075, 0.01, 20.0), (0.2, 0.01, 20.0)], &[(0.04, 0.01, 2.0), (0.21, 0.01, 20.0), (0.13, 0.01, 9.0)]];
    let mut fell = 0;
    for targets in places {
        let (request, trade) = trade_of(&table, targets, &[]);
        assert_eq!(trade.targets.len(), if targets.len() == 2 { 1 } else { targets.len() });
        assert!(trade.quiet.is_empty());
        for (alone_g, target) in trade.alone_g.iter().zip(&request.targets) {
            let only = table.plan(&[*target]).unwrap().predicted.target_peak_g;
            assert!((alone_g / only - 1.0).abs() < 1e-9);
        }
        for curve in &trade.targets {
            let wishes = |part: f64, others: f64| {
                let wish = |t: usize| trade.alone_g[t] * if t == curve.target { part } else { others };
                let targets: Vec<Target> = request
                    .targets
                    .iter()
                    .enumerate()
                    .map(|(t, target)| Target { intensity_g: Some(wish(t)), ..*target })
                    .collect();
                table.plan(&targets).unwrap()
            };
            assert!((curve.points.last().unwrap().part - 1.0).abs() < 1e-12);
            for pair in curve.points.windows(2) {
                assert!(pair[1].part > pair[0].part && pair[1].others_part <= pair[0].others_part, "{pair:?}");
            }
            for point in &curve.points {
                for (t, peak_g) in point.peaks_g.iter().enumerate() {
                    let part = if t == curve.target { point.part } else { point.others_part };
                    assert!(*peak_g >= part * trade.alone_g[t] * 0.998, "{point:?}");
                }
                if point.others_part < 0.99 && point.part < 1.0 {
                    fell += 1;
                    let beyond = wishes(point.part, point.others_part + 0.02);
                    assert!(beyond.limited_by.is_some(), "{point:?}: {:?}", beyond.targets);
                }
            }
        }
        if targets.len() == 2 {
            // Nothing for the first is all for the second.
            let first = &trade.targets[0].points[0];
            assert!(first.part == 0.0 && first.others_part > 0.99, "{first:?}");
        }
    }
    assert!(fell > 0, "targets that do not compete test nothing");
}

#[test]
fn quiet_zones_are_traded_against_the_targets() {
    let table = support::table(EXAMPLE_BAR);
    let quiet = QuietZone { x_m: 0.2, y_m: 0.01, radius_m: 0.01, at_most_g: 0.01 };
    let (request, trade) = trade_of(&table, &[(0.04, 0.01, 0.5)], &[quiet]);
    assert!(trade.targets.is_empty() && trade.quiet.len() > 2, "{trade:?}");
    for pair in trade.quiet.windows(2) {
        assert!(pair[1].part >= pair[0].part * (1.0 - 1e-9), "{pair:?}");
    }
    assert_eq!(trade.quiet[0].at_most_g, Some(vec![0.01]));
    let free = trade.quiet.last().unwrap();
    assert_eq!(free.at_most_g, None);
    let without = table.plan(&request.targets).unwrap();
    assert_eq!(free.peaks_g, [without.predicted.target_peak_g]);
    // Silence asked for is silence, and each step is from there.
    let (_, trade) = trade_of(&table, &[(0.04, 0.01, 0.5)], &[QuietZone { at_most_g: 0.0, ..quiet }]);
    assert!(trade.quiet[0].part < 1e-6 && trade.quiet[1].at_most_g == Some(vec![0.002]), "{trade:?}");
    // What is met needs no trade, and one target alone has none.
    let met = Request::for_touch(&request.targets);
    assert_eq!(explore_trade_offs_if_wishes_conflict(&table, &met, &without), Ok(None));
    let far = Request::for_touch(&[Target { intensity_g: Some(1e3), ..request.targets[0] }]);
    assert_eq!(explore_trade_offs_if_wishes_conflict(&table, &far, &table.plan_request(&far).unwrap()), Ok(None));
}

/// A resonant ERA whose narrow pulses (its rail is at the voltage of another) move the mass by harmonics as well: in the zone around a
/// target alone the peak is the target's, at rest or in moving gaps, which the harmonics change.
const NARROW_PULSES: &str = r#"
version = 1
name = "narrow pulses"
[surface]
kind = "plate"
length_mm = 203.0
width_mm = 189.0
thickness_mm = 3.95
material = { youngs_modulus_pa = 13.7e9, density_kg_m3 = 954.0, poisson_ratio = 0.02 }
damping = { modal_ratio = 0.017 }
[[actuator]]
id = "resonant"
x_mm = 27.0
y_mm = 148.0
mount = "inertial"
moving_mass_g = 3.87
stiffness_n_per_m = 488.0
damping_n_s_per_m = 0.29
electrode_area_mm2 = 1050.0
air_gap_um = 320.0
max_voltage_v = 1539.0
bias_voltage_v = 372.0
[[actuator]]
id = "held"
x_mm = 0.0
y_mm = 0.0
mount = "grounded"
moving_mass_g = 1.96
stiffness_n_per_m = 2045.0
damping_n_s_per_m = 0.13
electrode_area_mm2 = 638.0
air_gap_um = 201.0
max_voltage_v = 589.0
[[actuator]]
id = "weak"
x_mm = 96.0
y_mm = 105.0
mount = "grounded"
moving_mass_g = 0.47
stiffness_n_per_m = 924.0
damping_n_s_per_m = 0.09
electrode_area_mm2 = 209.0
air_gap_um = 831.0
max_voltage_v = 797.0
[[actuator]]
id = "corner"
x_mm = 178.0
y_mm = 174.0
mount = "grounded"
moving_mass_g = 0.711
stiffness_n_per_m = 1574.0
damping_n_s_per_m = 0.0337
electrode_area_mm2 = 361.0
air_gap_um = 701.0
max_voltage_v = 625.0
"#;

#[test]
fn peaks_in_quiet_zones_are_of_the_motion_that_targets_have() {
    let table = support::table(NARROW_PULSES);
    let target = Target { x_m: 0.105, y_m: 0.087, intensity_g: Some(2.0) };
    let there = QuietZone { x_m: target.x_m, y_m: target.y_m, radius_m: 0.0, at_most_g: 3.0 };
    let besides = QuietZone { x_m: 0.099, y_m: 0.019, radius_m: 0.035, at_most_g: 0.04 };
    let request = Request { quiet: vec![there, besides], work: SearchEffort::Study, ..Request::for_touch(&[target]) };
    let plan = table.plan_request(&request).unwrap();
    let narrow = plan.drives.iter().any(|drive| drive.voltage_v > 0.0 && drive.pulse_width < 0.4);
    let (rest_g, moving_g) = (plan.predicted.target_peak_g, plan.predicted.softened_peak_g);
    assert!(narrow && moving_g > 1.02 * rest_g, "nothing is tested: {plan:?}");
    let peak_g = plan.quiet[0].peak_g;
    assert!((peak_g / moving_g - 1.0).abs() < 1e-9, "{peak_g} g in the zone, {moving_g} g at the target");
}

/// Wide zones, whose middle and rim do not tell what is between: at every point of the surface's grid the limit holds, to the 2 %
/// of a crest between points.
#[test]
fn quiet_zones_are_quiet_everywhere() {
    let table = support::table(STARTING_PLATE);
    let mut bound = 0;
    for (x_m, y_m, radius_m) in [(0.2, 0.13, 0.05), (0.29, 0.02, 0.09), (0.1, 0.19, 0.04)] {
        for work in [SearchEffort::Touch, SearchEffort::Study] {
            let zone = QuietZone { x_m, y_m, radius_m, at_most_g: 0.05 };
            let target = Target { x_m: 0.06, y_m: 0.05, intensity_g: Some(0.5) };
            let request = Request { quiet: vec![zone], work, ..Request::for_touch(&[target]) };
            let plan = table.plan_request(&request).unwrap();
            let [told] = plan.quiet.as_slice() else { panic!("{:?}", plan.quiet) };
            assert!(told.peak_g <= 0.05 * (1.0 + 1e-9) && told.radius_m == radius_m, "{told:?}");
            let field = table.compute_peak_at_each_grid_point_m_per_s2(&plan);
            let points = table.grid.y_m.iter().flat_map(|y| table.grid.x_m.iter().map(move |x| (*x, *y)));
            let inside = points.zip(&field).filter(|((x, y), _)| (x - x_m).hypot(y - y_m) <= radius_m);
            let most_g = inside.filter_map(|(_, peak)| *peak).fold(0.0, f64::max) / STANDARD_GRAVITY;
            assert!(most_g <= 0.05 * 1.02 && most_g <= told.peak_g * 1.02, "{most_g} {told:?}");
            bound += u32::from(told.peak_g > 0.049);
        }
    }
    assert!(bound > 0, "zones that do not bind test nothing");
}

/// What targets can have together never says that all of them could have more than the plan gives.
#[test]
fn a_plan_is_as_good_as_what_it_is_traded_for() {
    let table = support::table(STARTING_PLATE);
    let target = |x_m, y_m, g| Target { x_m, y_m, intensity_g: Some(g) };
    let zone = |x_m, y_m, radius_m, at_most_g| QuietZone { x_m, y_m, radius_m, at_most_g };
    for (targets, quiet) in [
        (vec![target(0.15, 0.1, 0.5), target(0.047, 0.047, 0.3)], vec![zone(0.234, 0.156, 0.02, 0.05)]),
        (vec![target(0.075, 0.1, 0.5)], vec![zone(0.15, 0.1, 0.015, 0.02)]),
        (vec![target(0.075, 0.1, 0.5)], vec![zone(0.15, 0.1, 0.015, 0.04)]),
        (vec![target(0.1, 0.1, 8.0), target(0.25, 0.15, 6.0)], vec![]),
    ] {
        let request = Request { quiet, work: SearchEffort::Study, ..Request::for_touch(&targets) };
        let (planned, trade) = plan_and_improve_by_exploring_trade_offs(&table, &request).unwrap();
        let plan = planned.plan;
        let part = |peaks_g: &[f64]| {
            let parts = peaks_g.iter().zip(&plan.targets).map(|(peak, target)| peak / target.wanted_g);
            parts.fold(f64::INFINITY, f64::min)
        };
        let own = part(&plan.targets.iter().map(|target| target.peak_g).collect::<Vec<_>>());
        let trade = trade.unwrap();
        for point in trade.targets.iter().flat_map(|curve| &curve.points) {
            assert!(part(&point.peaks_g) <= own * (1.0 + 2e-3), "{own} {point:?}");
        }
        if let Some(first) = trade.quiet.first() {
            assert!(first.part <= own * (1.0 + 2e-3), "{own} {first:?}");
        }
        // The rest is what safety under moving masses took away.
        assert!(plan.optimality_gap < 0.02, "{}", plan.optimality_gap);
    }
}

#[test]
fn what_limits_phases_and_even_plans_has_a_name() {
    let table = support::table(STARTING_PLATE);
    let target = Target { x_m: 0.1, y_m: 0.07, intensity_g: Some(50.0) };
    for (grouping, objective) in [(Grouping::Shared, Objective::Contrast), (Grouping::Distinct, Objective::Reach)] {
        let plan = table.plan_request(&Request { grouping, objective, ..Request::for_touch(&[target]) }).unwrap();
        let limits = plan.limited_by.unwrap();
        assert!(limits.contains(" of "), "{grouping:?} {objective:?}: {limits}");
    }
}

/// With `felt` what is asked for is had in accelerations as they are felt, with less of these elsewhere than any plan in g has.
#[test]
fn accelerations_may_count_as_they_are_felt() {
    let table = support::table(STARTING_PLATE);
    let mut differ = 0;
    for (x_m, y_m) in spread_points(12, 0.3, 0.2) {
        let target = Target { x_m, y_m, intensity_g: Some(0.2) };
        let plan = |weigh| {
            table.plan_request(&Request { weigh, work: SearchEffort::Study, ..Request::for_touch(&[target]) }).unwrap()
        };
        let (equal, felt) = (plan(Weigh::Equal), plan(Weigh::Felt));
        let shape = table.model.shape_deflections_at(x_m, y_m);
        // Felt peak at the target, and felt mean square over the surface, of the fundamentals.
        let figures = |plan: &Plan| {
            let (mut peak, mut energy) = (0.0, 0.0);
            for (i, drive) in plan.drives.iter().enumerate() {
                let row = table.compute_entries_of_all_actuators_at_hz(drive.frequency_hz).unwrap();
                let force = drive.force_n * felt_weight_relative_to_reference_hz(drive.frequency_hz);
                peak += acceleration_at_point_from_coordinates(&shape, &row[i].acceleration).norm() * force
                    / STANDARD_GRAVITY;
                energy += row[i].mean_square * force * force;
            }
            (peak, energy)
        };
        let ((peak, energy), (other_peak, other_energy)) = (figures(&felt), figures(&equal));
        assert!(felt.limited_by.is_some() || (peak / 0.2 - 1.0).abs() < 1e-6, "{peak} {felt:?}");
        if felt.limited_by.is_none() && equal.limited_by.is_none() {
            // Harmonics count as well, and the target's own place does not: about as little.
            assert!(
                energy / (peak * peak) <= other_energy / (other_peak * other_peak) * 1.1,
                "{energy} {other_energy}"
            );
        }
        differ += u32::from(felt.drives != equal.drives);
    }
    assert!(differ > 0);
    let both = Request {
        weigh: Weigh::Felt,
        objective: Objective::Reach,
        ..Request::for_touch(&[Target { x_m: 0.1, y_m: 0.1, intensity_g: None }])
    };
    assert!(matches!(table.plan_request(&both), Err(PlanError::Together { option: "weigh", .. })));
}
