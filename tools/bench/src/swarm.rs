//! How other programs choose frequencies: a swarm of particles, as Jo, Yang and Shin localise vibration on a plate with ERAs (JICCE 22(2), 2024, 20
//! particles), and simulated annealing, as Li (2024) finds phases. Both choose a frequency and a pulse width for each actuator, and have
//! the best forces for their choice from the planner's own allocation, which their authors do not have.

use crate::error::Error;
use crate::planner::{
    FINE_HZ, build_plan_table, build_starting_plate_with_actuators, make_touch_by_number, search_best_allocation,
    sort_and_take_median_p99_and_largest,
};
use crate::table::{Table, format_relative_error, format_time};
use era_model::scene::MAX_ACTUATORS;
use era_planner::allocate::Allocation;
use era_planner::candidates::Formulation;
use era_planner::search::CandidateSet;
use era_planner::{PlanTable, Request, STANDARD_GRAVITY, SearchEffort};
use std::time::Instant;

/// Particles of the paper, and moves of each.
const PARTICLES: usize = 20;
const MOVES: usize = 100;
/// Weights of Clerc and Kennedy (2002): what is left of a particle's speed, and its pull to its own best place and to that of all.
const INERTIA: f64 = 0.7298;
const PULL: f64 = 1.4962;
/// Annealing looks at as many choices, from the first temperature to the last. One unit is a factor e of the cost.
const FIRST_TEMPERATURE: f64 = 1.0;
const LAST_TEMPERATURE: f64 = 1e-3;
/// Largest step of annealing, as a part of all choices of an actuator.
const STEP: f64 = 0.1;
/// Touches for each number of actuators and each intensity.
const TOUCHES: u32 = 40;
/// What the wish counts that is not met, against the logarithm of the cost.
const UNMET: f64 = 100.0;

/// A place for each actuator among its candidates, from 0 to 1.
type Choice = Vec<f64>;

/// The forces for a choice; `None` where two frequencies are too near to each other.
fn allocate_forces_if_frequencies_are_spaced(all: &CandidateSet, choice: &Choice) -> Option<Allocation> {
    let mut indices = [0; MAX_ACTUATORS];
    for ((index, place), list) in indices.iter_mut().zip(choice).zip(&all.candidates) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
        let at = (place * list.len() as f64) as usize;
        *index = at.min(list.len().saturating_sub(1));
    }
    let indices = &indices[..choice.len()];
    let hertz = |(list, index): (&Vec<era_planner::search::Candidate>, &usize)| all.frequencies_hz[list[*index].node];
    let mut hertz: Vec<f64> = all.candidates.iter().zip(indices).map(hertz).collect();
    hertz.sort_by(f64::total_cmp);
    let is_spaced = hertz.windows(2).all(|pair| pair[1] - pair[0] >= all.spacing_hz);
    is_spaced.then(|| all.allocate_combination(indices))
}

/// What is made least: first of all that the wish is met, then the logarithm of the cost.
fn compute_penalty_of_unmet_peak_plus_log_cost(found: Option<&Allocation>) -> f64 {
    found.map_or(f64::INFINITY, |found| UNMET * (1.0 - found.met) + found.cost.max(f64::MIN_POSITIVE).ln())
}

fn draw_random_choice(random: &mut fastrand::Rng, actuators: usize) -> Choice {
    (0..actuators).map(|_| random.f64()).collect()
}

/// A particle: where it is, how fast, and the best place that it has been at.
struct Particle {
    place: Choice,
    speed: Choice,
    least: f64,
    best_place: Choice,
}

/// The best choice of a swarm of particles.
fn find_allocation_by_swarm(all: &CandidateSet, random: &mut fastrand::Rng) -> Option<Allocation> {
    let actuators = all.candidates.len();
    let mut swarm = Vec::new();
    let mut best: (f64, Choice, Option<Allocation>) = (f64::INFINITY, draw_random_choice(random, actuators), None);
    for _ in 0..PARTICLES {
        let place = draw_random_choice(random, actuators);
        let best_place = place.clone();
        swarm.push(Particle { place, speed: vec![0.0; actuators], least: f64::INFINITY, best_place });
    }
    for _ in 0..MOVES {
        for Particle { place, speed, least, best_place } in &mut swarm {
            let found = allocate_forces_if_frequencies_are_spaced(all, place);
            let bad = compute_penalty_of_unmet_peak_plus_log_cost(found.as_ref());
            if bad < *least {
                (*least, *best_place) = (bad, place.clone());
            }
            if bad < best.0 {
                best = (bad, place.clone(), found);
            }
            for (((x, v), own), all) in place.iter_mut().zip(speed).zip(best_place.iter()).zip(&best.1) {
                *v = INERTIA * *v + PULL * (random.f64() * (own - *x) + random.f64() * (all - *x));
                *x = (*x + *v).clamp(0.0, 1.0);
            }
        }
    }
    best.2
}

/// The best choice of simulated annealing.
fn find_allocation_by_annealing(all: &CandidateSet, random: &mut fastrand::Rng) -> Option<Allocation> {
    let looks = PARTICLES * MOVES;
    let mut place = draw_random_choice(random, all.candidates.len());
    let mut bad =
        compute_penalty_of_unmet_peak_plus_log_cost(allocate_forces_if_frequencies_are_spaced(all, &place).as_ref());
    let mut best = (f64::INFINITY, None);
    for look in 0..looks {
        let temperature = FIRST_TEMPERATURE * (LAST_TEMPERATURE / FIRST_TEMPERATURE).powf(look as f64 / looks as f64);
        let other: Choice = place.iter().map(|x| (x + STEP * (2.0 * random.f64() - 1.0)).rem_euclid(1.0)).collect();
        let found = allocate_forces_if_frequencies_are_spaced(all, &other);
        let next = compute_penalty_of_unmet_peak_plus_log_cost(found.as_ref());
        if next < best.0 {
            best = (next, found);
        }
        if next <= bad || random.f64() < ((bad - next) / temperature).exp() {
            (place, bad) = (other, next);
        }
    }
    best.1
}

/// How far a choice is from the best: of its cost, or of what it reaches.
fn compute_relative_distance_from_best(found: Option<&Allocation>, best: &Allocation) -> f64 {
    match found {
        None => 1.0,
        Some(found) if best.met < 1.0 || found.met < 1.0 - 1e-9 => 1.0 - found.met / best.met,
        Some(found) => found.cost / best.cost - 1.0,
    }
}

/// The tables of the planner, and this comparison.
///
/// # Errors
/// As the planner.
pub fn build_planner_tables_with_swarm_and_annealing() -> Result<Vec<Table>, Error> {
    let mut tables = crate::planner::build_planner_tables()?;
    tables.push(build_table_of_swarm_and_annealing()?);
    Ok(tables)
}

fn build_table_of_swarm_and_annealing() -> Result<Table, Error> {
    let mut rows = Table::new(
        "Swarm and annealing",
        &["actuators", "touches", "method", "within 1 %", "median distance", "largest distance", "median time"],
    );
    rows.above.push(format!(
        "Frequencies and pulse widths by a swarm of {PARTICLES} particles (Jo, Yang and Shin 2024) and by simulated annealing (the method \
         of Li 2024), {} choices each, against the search of the planner. All three use the planner's allocation of forces. The distance \
         is that of the cost from the cost of the optimum; where the wanted peak is out of reach, that of the peak.",
        PARTICLES * MOVES
    ));
    for actuators in 2..=4 {
        let scene = build_starting_plate_with_actuators(actuators)?;
        let table = build_plan_table(&scene, FINE_HZ)?;
        for intensity_g in [0.1, 20.0] {
            for row in build_row_of_each_method(&scene, &table, actuators, intensity_g)? {
                rows.add_row(row);
            }
        }
    }
    Ok(rows)
}

fn build_row_of_each_method(
    scene: &era_model::scene::Scene,
    table: &PlanTable,
    actuators: usize,
    intensity_g: f64,
) -> Result<[[String; 7]; 3], Error> {
    let wanted = intensity_g * STANDARD_GRAVITY;
    let mut random = fastrand::Rng::with_seed(1);
    let mut distances: [Vec<f64>; 3] = Default::default();
    let mut times: [Vec<f64>; 3] = Default::default();
    for number in 0..TOUCHES {
        let target = make_touch_by_number(scene, number, intensity_g);
        let best = search_best_allocation(table, target, SearchEffort::Study)?;
        let started = Instant::now();
        let own = search_best_allocation(table, target, SearchEffort::Touch)?;
        let own_s = started.elapsed().as_secs_f64();
        let request = Request::for_touch(&[target]);
        let all = Formulation::new(table, &request).list_candidates_at_all_table_frequencies(&[wanted]);
        let started = Instant::now();
        let swarm = find_allocation_by_swarm(&all, &mut random);
        let swarm_s = started.elapsed().as_secs_f64();
        let started = Instant::now();
        let annealed = find_allocation_by_annealing(&all, &mut random);
        let annealed_s = started.elapsed().as_secs_f64();
        let found = [(Some(&own), own_s), (swarm.as_ref(), swarm_s), (annealed.as_ref(), annealed_s)];
        for ((found, s), (distances, times)) in found.into_iter().zip(distances.iter_mut().zip(&mut times)) {
            distances.push(compute_relative_distance_from_best(found, &best));
            times.push(s);
        }
    }
    let mut methods = ["search", "swarm", "annealing"].into_iter().zip(distances.iter_mut().zip(&mut times));
    Ok(std::array::from_fn(|_| {
        let Some((name, (distances, times))) = methods.next() else { return Default::default() };
        let near = distances.iter().filter(|distance| **distance < 0.01).count() as f64 / f64::from(TOUCHES);
        let ([median, _, largest], [time, ..]) =
            (sort_and_take_median_p99_and_largest(distances), sort_and_take_median_p99_and_largest(times));
        [
            actuators.to_string(),
            format!("{TOUCHES} of {intensity_g} g"),
            name.to_owned(),
            format!("{:.0} %", 100.0 * near),
            format_relative_error(median),
            format_relative_error(largest),
            format_time(time),
        ]
    }))
}
