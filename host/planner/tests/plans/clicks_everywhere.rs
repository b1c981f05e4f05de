//! What the example plate promises: crisp clicks of 0.5 g at every place, also on panels 5 % off and through the reference board's resistors;
//! and two frequencies that reach more than one.
//!
//! Crispness is judged here from the felt motion, sample by sample; that this motion is right is for the crosscheck, whose integration is its own.

use era_model::model::{Accuracy, levels::ReducedLevels};
use era_model::scene::{EXAMPLE_PLATE, Scene};
use era_planner::click::places::CellMiddles;
use era_planner::click::{ClickOptions, LEAD_S, design_click_windows, simulate_felt_acceleration_of_windows_m_per_s2};
use era_planner::effects::intensity::mode_shape_values_at_point_or_on_bar_axis;
use era_planner::maps::schemes::compare_schemes;
use era_planner::reach::Measure;
use era_planner::{PlanTable, STANDARD_GRAVITY, TableOptions};

const ASKED: f64 = 0.5 * STANDARD_GRAVITY;
/// The latest peak of a click that is felt at once, and the time from which on nothing may be felt of it, in s.
const LATEST_PEAK_S: f64 = 0.015;
const QUIET_S: f64 = 0.045;
/// As `shared/src/circuit.rs` has them.
const REFERENCE_RESISTORS: &str =
    "\n[electronics]\ncharging_resistance_ohm = 1e6\ndischarging_resistance_ohm = 1e5\ndischarging_delay_us = 15.0\n";

/// A click's peak in m/s^2, when it comes, and from when on the motion is below a fraction of it, in s from the burst's start.
struct FeltClick {
    peak: f64,
    peak_s: f64,
    quiet_s: f64,
}

#[expect(clippy::cast_precision_loss, reason = "16000 samples")]
fn judge_motion(motion: &[f64], quiet_fraction: f64) -> FeltClick {
    // The band has no phase: what comes before the beginning is at the record's end.
    let record = &motion[..motion.len() * 9 / 10];
    let (at, peak) =
        record.iter().enumerate().fold((0, 0.0), |best, (at, x)| if x.abs() > best.1 { (at, x.abs()) } else { best });
    let last = record.iter().rposition(|x| x.abs() > quiet_fraction * peak).unwrap_or(0);
    let time_s = |sample: usize| LEAD_S + sample as f64 / motion.len() as f64;
    FeltClick { peak, peak_s: time_s(at), quiet_s: time_s(last) }
}

fn build_balanced_table(text: &str) -> PlanTable {
    let (scene, grid) = (Scene::parse("plate", text).unwrap(), TableOptions::default());
    let levels = ReducedLevels::build(&scene, Accuracy::BALANCED, grid.to_hz).unwrap();
    PlanTable::from_levels(&scene, levels, grid).unwrap()
}

/// The scene with every value of a key multiplied.
fn multiply_values_of_key(text: &str, key: &str, factor: f64) -> String {
    let mut found = false;
    let changed: Vec<String> = text
        .lines()
        .map(|line| {
            let value =
                line.split('#').next().and_then(|line| line.split_once('=')).filter(|(name, _)| name.trim() == key);
            value.map_or_else(
                || line.to_owned(),
                |(_, value)| {
                    found = true;
                    format!("{key} = {:e}", value.trim().parse::<f64>().unwrap() * factor)
                },
            )
        })
        .collect();
    assert!(found, "{key}");
    changed.join("\n")
}

/// The middle one of the values in rising order; of an even number of them the upper middle one.
fn find_median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// At least this share of `count`.
#[expect(clippy::cast_precision_loss, reason = "some places")]
fn is_share(found: usize, share: f64, count: usize) -> bool {
    found as f64 >= share * count as f64
}

#[test]
fn clicks_are_crisp_all_over_the_example_plate() {
    let resistors = format!("{EXAMPLE_PLATE}{REFERENCE_RESISTORS}");
    for (text, (columns, rows), crisp_share, least_ratio) in
        // Through resistors, windows make less of each force, and a board has 24 of them.
        [
            (EXAMPLE_PLATE, (12, 8), 0.95, 0.8),
            (EXAMPLE_PLATE, (4, 3), 1.0, 0.8),
            (&resistors, (12, 8), 0.95, 0.75),
        ]
    {
        let table = build_balanced_table(text);
        let off: Vec<PlanTable> = ["youngs_modulus_pa", "stiffness_n_per_m"]
            .into_iter()
            .flat_map(|key| [0.95, 1.05].map(|factor| build_balanced_table(&multiply_values_of_key(text, key, factor))))
            .collect();
        let places: Vec<_> =
            CellMiddles::find_on_surface(&table.scene, columns, rows).places_m.into_iter().flatten().collect();
        let (mut crisp, mut quiet_off, mut quiet_s, mut weakest) = (0, 0, Vec::new(), f64::INFINITY);
        for (x_m, y_m) in &places {
            let shape_on = |table: &PlanTable| [mode_shape_values_at_point_or_on_bar_axis(table, *x_m, *y_m)];
            let options = ClickOptions { with_best_possible: true, ..ClickOptions::default() };
            let click =
                design_click_windows(&table, table.panel_poles().unwrap(), &shape_on(&table), &[ASKED], options)
                    .unwrap();
            let own = judge_motion(&click.felt_motion, 0.1);
            crisp += usize::from(own.peak_s <= LATEST_PEAK_S && own.quiet_s <= QUIET_S);
            quiet_s.push(own.quiet_s);
            weakest = f64::min(weakest, own.peak / click.best_possible.unwrap().min(ASKED));
            let is_quiet_on = |table: &PlanTable| {
                let (poles, shapes) = (table.panel_poles().unwrap(), shape_on(table));
                let motion = simulate_felt_acceleration_of_windows_m_per_s2(table, poles, &shapes, &click.windows);
                judge_motion(&motion[0], 0.2).quiet_s <= QUIET_S
            };
            quiet_off += usize::from(off.iter().all(is_quiet_on));
        }
        let told = format!(
            "of {} places {crisp} crisp, {quiet_off} on panels off, quiet after {:.4} s, weakest {weakest:.3}",
            places.len(),
            find_median(quiet_s.clone())
        );
        assert!(is_share(crisp, crisp_share, places.len()) && is_share(quiet_off, 0.9, places.len()), "{told}");
        assert!(find_median(quiet_s) <= 0.035 && weakest >= least_ratio, "{told}");
    }
}

/// The method's own claim, on the panel that is shipped with it: the weakest place has more with a frequency for each actuator.
#[test]
fn distinct_frequencies_reach_more_than_one_on_the_example_plate() {
    let schemes = compare_schemes(&build_balanced_table(EXAMPLE_PLATE), None, Measure::G).unwrap();
    let least: Vec<f64> = schemes.iter().map(|scheme| scheme.one_setting.least).collect();
    assert!(least.len() == 3 && least[2] > 1.1 * least[0].max(least[1]), "{least:?}");
}
