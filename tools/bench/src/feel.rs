//! Clicks over grids of places: how many are crisp, before and now, on the panel and on panels whose stiffness is off, beside what is possible; and
//! clicks for two fingers, on pairs of keys.

use crate::clock::compute_median;
use crate::error::Error;
use crate::table::Table;
use era_model::model::{Accuracy, levels::ReducedLevels};
use era_model::scene::{EXAMPLE_BAR, EXAMPLE_PLATE, STARTING_PLATE, Scene};
use era_planner::click::measures::{ClickMeasures, QUIET, measure_click};
use era_planner::click::places::CellMiddles;
use era_planner::click::{
    ClickDesign, ClickOptions, LATEST_PEAK_S, design_click_windows, simulate_felt_acceleration_of_windows_m_per_s2,
};
use era_planner::effects::design::EffectPrediction;
use era_planner::effects::intensity::mode_shape_values_at_point_or_on_bar_axis;
use era_planner::effects::{EffectRequest, NamedEffect, design_effect};
use era_planner::{PlanTable, STANDARD_GRAVITY, TableOptions, Target};
use std::fmt::Write;
use std::time::Instant;

/// Columns and rows of places of a plate, and of the keys of a keypad; a bar has one row.
const GRID: (u32, u32) = (12, 8);
const KEYPAD: (u32, u32) = (4, 3);
/// Peak asked for in g.
const ASKED_G: f64 = 0.5;
/// From when on a click is quiet, in s.
const QUIET_S: f64 = 0.045;
/// Part of the peak that may be left then on panels off the scene.
const QUIET_OFF: f64 = 0.2;
/// How far modulus and springs are off.
const OFF: f64 = 0.05;

/// The resistors of the power stage that the firmware is made for (`shared/src/circuit.rs`).
const REFERENCE_POWER_STAGE: &str =
    "\n[electronics]\ncharging_resistance_ohm = 1e6\ndischarging_resistance_ohm = 1e5\ndischarging_delay_us = 15.0\n";

/// A sheet of 700 x 400 mm on eight springs, with four ERAs.
fn make_sheet_scene_toml() -> String {
    let mut text = String::from(
        "version = 1\nname = \"sheet\"\n[surface]\nkind = \"plate\"\nlength_mm = 700.0\nwidth_mm = 400.0\nthickness_mm = 3.0\n\
         [surface.material]\nyoungs_modulus_pa = 69e9\npoisson_ratio = 0.33\ndensity_kg_m3 = 2700.0\n[surface.damping]\nloss_factor = 0.01\n\
         [screen]\nwidth_px = 3840\nheight_px = 2160\n",
    );
    for (x, y) in [(0, 0), (350, 0), (700, 0), (0, 200), (700, 200), (0, 400), (350, 400), (700, 400)] {
        let _ =
            write!(text, "[[support]]\nx_mm = {x}\ny_mm = {y}\nstiffness_n_per_m = 6000.0\ndamping_n_s_per_m = 5.0\n");
    }
    for (number, (x, y)) in [(90, 70), (300, 330), (420, 60), (640, 300)].into_iter().enumerate() {
        let _ = write!(
            text,
            "[[actuator]]\nid = \"era{}\"\nx_mm = {x}\ny_mm = {y}\nmount = \"grounded\"\nmoving_mass_g = 10.0\nstiffness_n_per_m = 5000.0\n\
             damping_n_s_per_m = 0.7\nelectrode_area_mm2 = 1963.5\nair_gap_um = 500.0\nmax_voltage_v = 2000.0\nstop_um = 120.0\n",
            number + 1
        );
    }
    text
}

/// A scene whose values of a key are so many times as large.
fn scale_values_of_key(text: &str, key: &str, factor: f64) -> String {
    let scaled = |line: &str| {
        let (name, value) = line.split_once('=').filter(|(name, _)| name.trim() == key)?;
        let number = value.split('#').next()?.trim().parse::<f64>().ok()?;
        Some(format!("{name}= {:e}", number * factor))
    };
    text.lines().map(|line| scaled(line).unwrap_or_else(|| line.to_owned()) + "\n").collect()
}

fn build_plan_table_from_toml(text: &str) -> Result<PlanTable, Error> {
    let scene = Scene::parse("bench feel", text)?;
    let grid = TableOptions::default();
    Ok(PlanTable::from_levels(&scene, ReducedLevels::build(&scene, Accuracy::BALANCED, grid.to_hz)?, grid)?)
}

/// The click at one place, and how it compares.
struct ClickAtPlace {
    /// A push with a brake, as in earlier versions.
    before: EffectPrediction,
    click: ClickDesign,
    took_ms: f64,
    /// On the panels off the scene.
    perturbed_measures: Vec<ClickMeasures>,
    is_quiet_when_perturbed: bool,
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a sample number")]
fn is_below_fraction_of_peak_after_quiet_time(motion: &[f64], fraction: f64) -> bool {
    let peak = motion.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let from = (QUIET_S * motion.len() as f64) as usize;
    let counted = motion.len() * 9 / 10;
    motion.get(from..counted).is_some_and(|rest| rest.iter().all(|x| x.abs() <= fraction * peak))
}

fn design_and_measure_click(
    table: &PlanTable,
    perturbed_tables: &[PlanTable],
    (x_m, y_m): (f64, f64),
) -> Option<ClickAtPlace> {
    let poles = table.panel_poles()?;
    let shape = mode_shape_values_at_point_or_on_bar_axis(table, x_m, y_m);
    let (shapes, wishes) = ([shape], [ASKED_G * STANDARD_GRAVITY]);
    let begun = Instant::now();
    let click = design_click_windows(table, poles, &shapes, &wishes, ClickOptions::default())?;
    let took_ms = 1e3 * begun.elapsed().as_secs_f64();
    let compared = ClickOptions { with_best_possible: true, ..ClickOptions::default() };
    let best_possible = design_click_windows(table, poles, &shapes, &wishes, compared)?.best_possible;
    let click = ClickDesign { best_possible, ..click };
    let plan = table.plan(&[Target { x_m, y_m, intensity_g: Some(ASKED_G) }]).ok()?;
    let before = design_effect(table, poles, &plan, EffectRequest::with_defaults(NamedEffect::Click)).ok()?.predicted;
    let motions: Vec<Vec<f64>> = perturbed_tables
        .iter()
        .filter_map(|table| {
            let shape = mode_shape_values_at_point_or_on_bar_axis(table, x_m, y_m);
            simulate_felt_acceleration_of_windows_m_per_s2(table, table.panel_poles()?, &[shape], &click.windows).pop()
        })
        .collect();
    let perturbed_measures: Vec<ClickMeasures> = motions.iter().map(|motion| measure_click(motion)).collect();
    let is_quiet_when_perturbed =
        motions.iter().all(|motion| is_below_fraction_of_peak_after_quiet_time(motion, QUIET_OFF));
    Some(ClickAtPlace { before, click, took_ms, perturbed_measures, is_quiet_when_perturbed })
}

/// Measures clicks: a table of places, and one of pairs of keys.
///
/// # Errors
/// [`Error`]: a scene that cannot be modelled.
pub fn build_click_tables() -> Result<Vec<Table>, Error> {
    let scenes = [
        ("plate", EXAMPLE_PLATE.to_owned(), GRID),
        ("plate, reference power stage", EXAMPLE_PLATE.to_owned() + REFERENCE_POWER_STAGE, GRID),
        ("plate, keypad of 4 x 3 keys", EXAMPLE_PLATE.to_owned(), KEYPAD),
        ("starting plate", STARTING_PLATE.to_owned(), GRID),
        ("bar", EXAMPLE_BAR.to_owned(), GRID),
        ("camera", include_str!("../../../examples/scenes/camera.toml").to_owned(), GRID),
        ("bezel", include_str!("../../../examples/scenes/bezel.toml").to_owned(), GRID),
        ("sheet 700 x 400 mm, 4 actuators", make_sheet_scene_toml(), GRID),
    ];
    let mut table = Table::new(
        "Clicks of 0.5 g at 12 x 8 places (at 12 of the bar, and at the keys of a keypad)",
        &[
            "scene",
            "crisp before",
            "crisp",
            "modulus or springs 5 % off: places where less than a fifth of the peak is left",
            "peak after (median)",
            "quiet after (median)",
            "least peak",
            "least bound",
            "least value of peak / min(0.5 g, bound)",
            "pulse to ring (median)",
            "sharpness (median)",
            "contrast (median)",
            "time (median, 99 %)",
        ],
    );
    let mut kinds = Table::new(
        "The same clicks beside pushes with a brake, and on panels whose modulus or springs are 5 % off (medians)",
        &[
            "scene",
            "click",
            "crisp, or less than a fifth left",
            "peak",
            "peak after",
            "quiet after",
            "pulse to ring",
            "sharpness",
        ],
    );
    for (name, text, (columns, rows)) in scenes {
        let own = build_plan_table_from_toml(&text)?;
        let variants = [
            ("youngs_modulus_pa", 1.0 + OFF),
            ("youngs_modulus_pa", 1.0 - OFF),
            ("stiffness_n_per_m", 1.0 + OFF),
            ("stiffness_n_per_m", 1.0 - OFF),
        ];
        let perturbed_tables = variants
            .iter()
            .map(|(key, factor)| build_plan_table_from_toml(&scale_values_of_key(&text, key, *factor)))
            .collect::<Result<Vec<_>, _>>()?;
        let places = CellMiddles::find_on_surface(&own.scene, columns, rows).places_m;
        let places: Vec<(f64, f64)> = places.into_iter().flatten().collect();
        let clicked: Vec<ClickAtPlace> =
            places.iter().filter_map(|place| design_and_measure_click(&own, &perturbed_tables, *place)).collect();
        // A place without a click counts as one that is not crisp.
        table.add_row(build_row_of_clicks(name, places.len(), &clicked));
        for row in build_rows_of_push_click_and_click_off(name, places.len(), &clicked) {
            kinds.add_row(row);
        }
        eprintln!("{name}: {} places", clicked.len());
    }
    Ok(vec![table, kinds, build_table_of_pairs()?])
}

/// Clicks for two fingers at once, on every pair of keys of a keypad that covers the panel.
fn build_table_of_pairs() -> Result<Table, Error> {
    let scenes = [
        ("plate", EXAMPLE_PLATE.to_owned()),
        ("starting plate", STARTING_PLATE.to_owned()),
        ("bar, 4 keys", EXAMPLE_BAR.to_owned()),
        ("sheet 700 x 400 mm, 4 actuators", make_sheet_scene_toml()),
    ];
    let mut table = Table::new(
        "Clicks of 0.5 g for two fingers, on all pairs of 4 x 3 keys",
        &[
            "scene",
            "pairs",
            "crisp at both",
            "0.4 g or more at both",
            "peak of the weaker (median)",
            "least peak of the weaker finger",
            "contrast (median)",
            "time (median, longest)",
        ],
    );
    for (name, text) in scenes {
        let own = build_plan_table_from_toml(&text)?;
        let Some(poles) = own.panel_poles() else { continue };
        let keys = CellMiddles::find_on_surface(&own.scene, KEYPAD.0, KEYPAD.1).places_m;
        let keys: Vec<(f64, f64)> = keys.into_iter().flatten().collect();
        let pairs =
            keys.iter().enumerate().flat_map(|(i, one)| keys.iter().skip(i + 1).map(move |other| [*one, *other]));
        let design = |pair: [(f64, f64); 2]| {
            let shapes = pair.map(|(x_m, y_m)| mode_shape_values_at_point_or_on_bar_axis(&own, x_m, y_m));
            let begun = Instant::now();
            let click =
                design_click_windows(&own, poles, &shapes, &[ASKED_G * STANDARD_GRAVITY; 2], ClickOptions::default());
            (click, 1e3 * begun.elapsed().as_secs_f64())
        };
        let clicked: Vec<(Option<ClickDesign>, f64)> = pairs.map(design).collect();
        table.add_row(build_row_of_pairs(name, &clicked));
        eprintln!("{name}: {} pairs", clicked.len());
    }
    Ok(table)
}

/// A pair without a click counts as one that is not crisp, with a peak of 0.
#[expect(clippy::cast_precision_loss, reason = "some pairs")]
fn build_row_of_pairs(name: &str, clicked: &[(Option<ClickDesign>, f64)]) -> Vec<String> {
    let share_where = |is_counted: &dyn Fn(&ClickDesign) -> bool| {
        let counted = clicked.iter().filter(|(click, _)| click.as_ref().is_some_and(is_counted)).count();
        format!("{:.0} %", 100.0 * counted as f64 / clicked.len().max(1) as f64)
    };
    let weaker_g = |click: &ClickDesign| click.peaks.iter().copied().fold(f64::INFINITY, f64::min) / STANDARD_GRAVITY;
    let peaks_g: Vec<f64> = clicked.iter().map(|(click, _)| click.as_ref().map_or(0.0, weaker_g)).collect();
    let times_ms: Vec<f64> = clicked.iter().map(|(_, took_ms)| *took_ms).collect();
    let contrast_db = |(click, _): &(Option<ClickDesign>, f64)| Some(click.as_ref()?.surface?.contrast_db);
    let contrasts_db: Vec<f64> = clicked.iter().filter_map(contrast_db).collect();
    vec![
        name.to_owned(),
        clicked.len().to_string(),
        share_where(&|click| click.is_crisp),
        share_where(&|click| weaker_g(click) >= 0.8 * ASKED_G),
        format!("{:.2} g", compute_median(peaks_g.clone())),
        format!("{:.2} g", peaks_g.iter().copied().fold(f64::INFINITY, f64::min)),
        format!("{:.1} dB", compute_median(contrasts_db)),
        format!("{:.1} ms, {:.1} ms", compute_median(times_ms.clone()), times_ms.iter().copied().fold(0.0, f64::max)),
    ]
}

fn is_push_crisp(own: &ClickAtPlace) -> bool {
    let before = &own.before;
    before.peak_at_ms <= 1e3 * LATEST_PEAK_S && before.quiet_ms.is_some_and(|quiet_ms| quiet_ms <= 1e3 * QUIET_S)
}

fn is_click_quiet_when_perturbed(own: &ClickAtPlace) -> bool {
    own.is_quiet_when_perturbed && own.perturbed_measures.iter().all(|measures| measures.peak_s <= LATEST_PEAK_S)
}

/// A scene's pushes, its clicks, and its clicks on all panels that are off; what is not quiet counts as quiet after an infinite time.
#[expect(clippy::cast_precision_loss, reason = "some places")]
fn build_rows_of_push_click_and_click_off(name: &str, places: usize, clicked: &[ClickAtPlace]) -> [Vec<String>; 3] {
    let row = |kind: &str, is_counted: &dyn Fn(&ClickAtPlace) -> bool, figures: [Vec<f64>; 5]| {
        let share = 100.0 * clicked.iter().filter(|own| is_counted(own)).count() as f64 / places.max(1) as f64;
        let [peak_g, peak_ms, quiet_ms, ring_db, sharpness] = figures.map(compute_median);
        vec![
            name.to_owned(),
            kind.to_owned(),
            format!("{share:.0} %"),
            format!("{peak_g:.2} g"),
            format!("{peak_ms:.1} ms"),
            format!("{quiet_ms:.1} ms"),
            format!("{ring_db:.1} dB"),
            format!("{sharpness:.2} dB/ms"),
        ]
    };
    let of_pushes = |value_of: &dyn Fn(&EffectPrediction) -> Option<f64>| -> Vec<f64> {
        clicked.iter().filter_map(|own| value_of(&own.before)).collect()
    };
    let figures_of = |all: &[&ClickMeasures]| {
        let of = |value_of: &dyn Fn(&ClickMeasures) -> Option<f64>| -> Vec<f64> {
            all.iter().filter_map(|own| value_of(own)).collect()
        };
        [
            of(&|own| Some(own.peak / STANDARD_GRAVITY)),
            of(&|own| Some(1e3 * own.peak_s)),
            of(&|own| Some(1e3 * own.quiet_s.unwrap_or(f64::INFINITY))),
            of(&|own| own.pulse_to_ring_db),
            of(&ClickMeasures::sharpness_db_per_ms_if_pulse_to_ring_ratio_known),
        ]
    };
    let nominal: Vec<&ClickMeasures> = clicked.iter().map(|own| &own.click.measures).collect();
    let off: Vec<&ClickMeasures> = clicked.iter().flat_map(|own| &own.perturbed_measures).collect();
    [
        row(
            "push with a brake",
            &is_push_crisp,
            [
                of_pushes(&|own| Some(own.peak_g)),
                of_pushes(&|own| Some(own.peak_at_ms)),
                of_pushes(&|own| Some(own.quiet_ms.unwrap_or(f64::INFINITY))),
                of_pushes(&|own| own.pulse_to_ring_db),
                of_pushes(&|own| own.sharpness_db_per_ms),
            ],
        ),
        row("windows", &|own| own.click.is_crisp, figures_of(&nominal)),
        row("windows, 5 % off", &is_click_quiet_when_perturbed, figures_of(&off)),
    ]
}

#[expect(clippy::cast_precision_loss, clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some places")]
fn build_row_of_clicks(name: &str, places: usize, clicked: &[ClickAtPlace]) -> Vec<String> {
    let count = places.max(1) as f64;
    let share_where = |is_counted: &dyn Fn(&ClickAtPlace) -> bool| {
        format!("{:.0} %", 100.0 * clicked.iter().filter(|own| is_counted(own)).count() as f64 / count)
    };
    let median_of =
        |value_of: &dyn Fn(&ClickAtPlace) -> Option<f64>| compute_median(clicked.iter().filter_map(value_of).collect());
    let least_of = |value_of: &dyn Fn(&ClickAtPlace) -> f64| clicked.iter().map(value_of).fold(f64::INFINITY, f64::min);
    let peak_g = |own: &ClickAtPlace| own.click.measures.peak / STANDARD_GRAVITY;
    let bound_g = |own: &ClickAtPlace| own.click.best_possible.unwrap_or(0.0) / STANDARD_GRAVITY;
    let mut times: Vec<f64> = clicked.iter().map(|own| own.took_ms).collect();
    times.sort_by(f64::total_cmp);
    let slow = times.get((0.99 * (times.len().max(1) - 1) as f64).round() as usize).copied().unwrap_or(0.0);
    vec![
        name.to_owned(),
        share_where(&is_push_crisp),
        share_where(&|own| own.click.is_crisp),
        share_where(&is_click_quiet_when_perturbed),
        format!("{:.1} ms", 1e3 * median_of(&|own| Some(own.click.measures.peak_s))),
        format!("{:.1} ms", 1e3 * median_of(&|own| Some(own.click.measures.quiet_s.unwrap_or(f64::INFINITY)))),
        format!("{:.2} g", least_of(&peak_g)),
        format!("{:.2} g", least_of(&bound_g)),
        format!(
            "{:.2}",
            least_of(&|own| peak_g(own)
                / own.click.best_possible.map_or(ASKED_G, |bound| (bound / STANDARD_GRAVITY).min(ASKED_G)))
        ),
        format!("{:.1} dB", median_of(&|own| own.click.measures.pulse_to_ring_db)),
        format!("{:.2} dB/ms", median_of(&|own| own.click.measures.sharpness_db_per_ms_if_pulse_to_ring_ratio_known())),
        format!("{:.1} dB", median_of(&|own| own.click.surface.map(|surface| surface.contrast_db))),
        format!("{:.1} ms, {slow:.1} ms", compute_median(times)),
    ]
}

const _: () = assert!(QUIET < QUIET_OFF);
