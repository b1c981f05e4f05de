//! The planner: time per plan, and its optimum against all combinations.

use crate::error::Error;
use crate::table::{Table, format_relative_error, format_time};
use era_model::model::Accuracy;
use era_model::model::levels::ReducedLevels;
use era_model::scene::{STARTING_PLATE, Scene};
use era_planner::allocate::Allocation;
use era_planner::candidates::Formulation;
use era_planner::{Grouping, PlanTable, Request, STANDARD_GRAVITY, SearchEffort, TableOptions, Target};
use std::fmt::Write;
use std::time::Instant;

/// A frequency grid of 1001 frequencies from 40 to 400 Hz.
pub const FINE_HZ: f64 = 0.36;
/// Highest frequency of tables in Hz.
const HIGHEST_HZ: f64 = 400.0;
/// Touches timed.
const TOUCHES: u32 = 2000;
/// Touches held against brute force, for each number of actuators and each intensity.
const CHECKED: [u32; 4] = [40, 3, 6, 6];
/// Steps of the grids that brute force takes, in Hz: all pairs of 1001 frequencies, but of three and four actuators all
/// combinations of that many would be a billion times eight and a million million times sixteen.
const STEPS_HZ: [f64; 4] = [FINE_HZ, FINE_HZ, 7.2, 16.0];
/// Relative difference from brute force that rounding may make.
const SAME: f64 = 1e-9;
/// Where actuators three and four are put on the starting plate, in mm.
const MORE_MM: [(f64, f64); 2] = [(150.0, 60.0), (150.0, 150.0)];

/// The starting plate with its first one or two actuators, or with more of the same kind.
pub fn build_starting_plate_with_actuators(actuators: usize) -> Result<Scene, Error> {
    let mut text = STARTING_PLATE.to_owned();
    if actuators == 1 {
        let last = text.rfind("[[actuator]]").unwrap_or(text.len());
        text.truncate(last);
    }
    for (i, (x_mm, y_mm)) in MORE_MM.iter().enumerate().take(actuators.saturating_sub(2)) {
        let _ = write!(
            text,
            "\n[[actuator]]\nid = \"more{i}\"\nx_mm = {x_mm}\ny_mm = {y_mm}\nmount = \"grounded\"\nmoving_mass_g = 10.0\n\
             stiffness_n_per_m = 5000.0\ndamping_n_s_per_m = 0.7\nelectrode_area_mm2 = 1963.5\nair_gap_um = 500.0\n\
             max_voltage_v = 2000.0\n"
        );
    }
    Ok(Scene::parse("starting plate", &text)?)
}

pub fn build_plan_table(scene: &Scene, step_hz: f64) -> Result<PlanTable, Error> {
    let levels = ReducedLevels::build(scene, Accuracy::BALANCED, HIGHEST_HZ)?;
    let options = TableOptions { step_hz, to_hz: HIGHEST_HZ, ..TableOptions::default() };
    Ok(PlanTable::from_levels(scene, levels, options)?)
}

/// A touch somewhere, by a low-discrepancy sequence.
pub fn make_touch_by_number(scene: &Scene, number: u32, intensity_g: f64) -> Target {
    let fraction_of_side = |step: f64| (0.5 + step * f64::from(number + 1)).fract();
    Target {
        x_m: scene.surface.length_m * fraction_of_side(0.754_877_666),
        y_m: scene.surface.width_m * fraction_of_side(0.569_840_291),
        intensity_g: Some(intensity_g),
    }
}

/// Measures the planner: the tables of the time per plan, of brute force and of phases.
pub fn build_planner_tables() -> Result<Vec<Table>, Error> {
    let mut times = Table::new(
        "Time per plan",
        &[
            "actuators",
            "touches",
            "median",
            "p99",
            "longest",
            "proven the best",
            "size of the plan table",
            "time to make the table",
        ],
    );
    times.above.push(
        "These plans are for the starting plate at the accuracy `balanced`, with 1001 frequencies and one \
         thread. The time is for the complete plan: the best combination, its proof, the refinement between the \
         frequencies of the grid, the safety check with moving masses, the prediction and the error bound. Touches ask \
         for 0.05 to 0.5 g, and for 20 g, which no place reaches."
            .into(),
    );
    let mut checks = Table::new(
        "Against brute force",
        &[
            "actuators",
            "frequencies",
            "touches",
            "combinations per touch",
            "brute force",
            "search",
            "largest difference, 20000 steps",
            "largest difference, steps of a touch",
        ],
    );
    checks.above.push(
        "The brute force computes the best forces for every combination of frequencies (at least 20 Hz \
         apart) and pulse widths. The search should find a combination of the same cost or, if the wanted peak is \
         not possible, of the same peak. The last two columns have the largest relative difference between brute \
         force and search, for 20000 steps of the search and for the number of steps of a touch. A difference above \
         1e-9 with 20000 steps is an error."
            .into(),
    );
    let mut phases = Table::new(
        "With phases",
        &["actuators", "median", "p99", "contrast minus that with distinct frequencies, median"],
    );
    phases.above.push("All actuators share one of 1001 frequencies. Touches ask for 0.1 g.".into());
    for actuators in 1..=4 {
        let scene = build_starting_plate_with_actuators(actuators)?;
        let started = Instant::now();
        let fine = build_plan_table(&scene, FINE_HZ)?;
        let made_s = started.elapsed().as_secs_f64();
        for (name, intensities) in [("0.05 to 0.5 g", [0.05, 0.1, 0.2, 0.5]), ("20 g", [20.0; 4])] {
            let (mut seconds_each, mut proven) = (Vec::new(), 0_u32);
            for number in 0..TOUCHES {
                let target = make_touch_by_number(&scene, number, intensities[number as usize % 4]);
                let started = Instant::now();
                let plan = fine.plan(&[target])?;
                seconds_each.push(started.elapsed().as_secs_f64());
                proven += u32::from(plan.optimality_gap == 0.0);
            }
            let [median, p99, longest] = sort_and_take_median_p99_and_largest(&mut seconds_each);
            times.add_row([
                actuators.to_string(),
                name.to_owned(),
                format_time(median),
                format_time(p99),
                format_time(longest),
                format!("{:.1} %", 100.0 * f64::from(proven) / f64::from(TOUCHES)),
                format!("{:.1} MB", bytes_to_mb(fine.memory_bytes())),
                format_time(made_s),
            ]);
        }
        let step_hz = STEPS_HZ[actuators - 1];
        let coarse = if step_hz == FINE_HZ { None } else { Some(build_plan_table(&scene, step_hz)?) };
        checks.add_row(build_row_of_search_against_brute_force(&scene, actuators, coarse.as_ref().unwrap_or(&fine))?);
        if actuators > 1 {
            phases.add_row(build_row_of_plans_with_phases(&scene, &fine, actuators)?);
        }
    }
    Ok(vec![times, checks, phases])
}

#[expect(clippy::cast_precision_loss, reason = "megabytes")]
fn bytes_to_mb(bytes: usize) -> f64 {
    bytes as f64 / 1e6
}

/// Median, 99th percentile and the largest.
pub fn sort_and_take_median_p99_and_largest(values: &mut [f64]) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    [last / 2, last * 99 / 100, last].map(|at| values.get(at).copied().unwrap_or(f64::NAN))
}

fn build_row_of_search_against_brute_force(
    scene: &Scene,
    actuators: usize,
    table: &PlanTable,
) -> Result<[String; 8], Error> {
    let count = CHECKED[actuators - 1];
    let (mut brute_s, mut search_s, mut worst, mut of_touch, mut combinations) = (0.0, 0.0, 0.0_f64, 0.0_f64, 0_u64);
    let mut touches = 0;
    for intensity_g in [0.1, 1.0, 20.0] {
        for number in 0..count {
            let target = make_touch_by_number(scene, number, intensity_g);
            let wanted = intensity_g * STANDARD_GRAVITY;
            let started = Instant::now();
            let study = search_best_allocation(table, target, SearchEffort::Study)?;
            search_s += started.elapsed().as_secs_f64();
            let touch = search_best_allocation(table, target, SearchEffort::Touch)?;
            let started = Instant::now();
            let all = Formulation::new(table, &Request::for_touch(&[target]))
                .list_candidates_at_all_table_frequencies(&[wanted]);
            let (best, looked) = all.find_best_allocation_exhaustively_and_count_combinations(&|_, _| true);
            brute_s += started.elapsed().as_secs_f64();
            combinations = combinations.max(looked);
            let best = best.ok_or_else(make_no_frequencies_error)?;
            worst = worst.max(compute_relative_difference_of_cost_or_reach(&study, &best));
            of_touch = of_touch.max(compute_relative_difference_of_cost_or_reach(&touch, &best));
            touches += 1;
        }
    }
    if worst > SAME {
        return Err(Error::NotTheBest { actuators, difference: worst });
    }
    Ok([
        actuators.to_string(),
        table.frequencies_hz.len().to_string(),
        touches.to_string(),
        combinations.to_string(),
        format_time(brute_s / f64::from(touches)),
        format_time(search_s / f64::from(touches)),
        format_relative_error(worst),
        format_relative_error(of_touch),
    ])
}

/// The forces of the best combination of frequencies and pulse widths for one target, as the search of the planner finds it.
///
/// # Errors
/// The planner's, if no frequencies keep their distance.
pub fn search_best_allocation(table: &PlanTable, target: Target, work: SearchEffort) -> Result<Allocation, Error> {
    let request = Request { work, ..Request::for_touch(&[target]) };
    let formulation = Formulation::new(table, &request);
    let wanted = target.intensity_g.unwrap_or(0.0) * STANDARD_GRAVITY;
    let found = formulation.find_best_combination_replacing_estimated_energies_at_most_once(
        formulation.shortlist_for_one_target_estimating_energies_if_wish_unmet(wanted, &|_, _| true),
        &|_, _| true,
    );
    found.map(|(_, found)| found.allocation).ok_or_else(make_no_frequencies_error)
}

/// Relative difference of the cost, or of the reach where the wish is out of reach.
fn compute_relative_difference_of_cost_or_reach(found: &Allocation, best: &Allocation) -> f64 {
    let reach = (found.met - best.met).abs() / best.met;
    let cost = if best.met < 1.0 { 0.0 } else { (found.cost - best.cost).abs() / best.cost };
    reach.max(cost)
}

fn make_no_frequencies_error() -> Error {
    era_planner::PlanError::NoFrequencies.into()
}

fn build_row_of_plans_with_phases(scene: &Scene, table: &PlanTable, actuators: usize) -> Result<[String; 4], Error> {
    const PLANS: u32 = 100;
    let (mut times, mut gains) = (Vec::new(), Vec::new());
    for number in 0..PLANS {
        let target = make_touch_by_number(scene, number, 0.1);
        let plan = |grouping| {
            let request = Request { grouping, ..Request::for_touch(&[target]) };
            table.plan_request(&request)
        };
        let distinct = plan(Grouping::Distinct)?;
        let started = Instant::now();
        let found = plan(Grouping::Shared)?;
        times.push(started.elapsed().as_secs_f64());
        gains.push(found.predicted.contrast_db - distinct.predicted.contrast_db);
    }
    let [median, p99, _] = sort_and_take_median_p99_and_largest(&mut times);
    let [gain_db, _, _] = sort_and_take_median_p99_and_largest(&mut gains);
    Ok([actuators.to_string(), format_time(median), format_time(p99), format!("{gain_db:+.2} dB")])
}
