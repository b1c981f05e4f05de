//! The search against looking at everything.

use super::*;
use crate::choose::linear::Programme;
use crate::request::SearchEffort;
use proptest::prelude::*;

/// All choices, the same linear program over all points for each.
fn find_strongest_of_all_choices(space: &ReachSpace, points: &[usize], spacing_hz: f64) -> Option<f64> {
    let mut choices: Vec<Vec<usize>> = vec![Vec::new()];
    for actuator in 0..space.count_actuators() {
        choices = choices
            .into_iter()
            .flat_map(|chosen| {
                let fitting = space.usable_frequency_indices(actuator).into_iter().filter(|f| {
                    let hz = |f: usize| space.frequencies_hz[f];
                    chosen.iter().all(|other| (hz(*other) - hz(*f)).abs() >= spacing_hz - 1e-9)
                });
                fitting.map(|f| [&chosen[..], &[f]].concat()).collect::<Vec<_>>()
            })
            .collect();
    }
    choices.iter().map(|choice| strongest(space, points, choice)).reduce(f64::max)
}

/// max t with t <= sum_i g_i(x) v_i at every point.
fn strongest(space: &ReachSpace, points: &[usize], choice: &[usize]) -> f64 {
    let mut programme = Programme::new(choice.len() + 1);
    let each = |of: &dyn Fn(usize, usize) -> f64, first: f64| -> Vec<f64> {
        std::iter::once(first).chain(choice.iter().enumerate().map(|(i, f)| of(i, *f))).collect()
    };
    for x in points {
        programme.add_row(
            each(&|i, f| -f64::from(space.weighted_acceleration_at_full_force_at_each_point(i, f)[*x]), 1.0),
            0.0,
        );
    }
    for limit in 0..space.limits {
        programme.add_row(each(&|i, f| space.usage_fraction_of_each_limit_at_max_force(i, f)[limit], 0.0), 1.0);
    }
    for k in 0..choice.len() {
        programme.add_row(each(&|i, _| f64::from(u8::from(i == k)), 0.0), 1.0);
    }
    programme.maximise_first_then_second_objective_if_bounded(&[1.0], &[]).unwrap().x[0]
}

fn scattered(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Gains such as those of standing waves, with limits that bind now and then.
fn random_space(actuators: usize, frequencies: usize, points: usize, seed: u64) -> ReachSpace {
    let mut random = scattered(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32);
    let usage = random() * 1.5;
    let choices = (0..actuators)
        .map(|_| {
            (0..frequencies)
                .map(|_| {
                    let (waves, phase, strength) = (random() * 3.0, random(), 0.1 + random());
                    let gain = (0..points).map(|x| {
                        let place = x as f64 / points as f64;
                        ((std::f64::consts::TAU * (waves * place + phase)).cos().abs() * strength) as f32
                    });
                    ReachCandidate {
                        force_n: if random() < 0.05 { 0.0 } else { 0.1 },
                        gain: gain.collect(),
                        usage: (0..2).map(|_| usage * random()).collect(),
                    }
                })
                .collect()
        })
        .collect();
    ReachSpace::new((0..frequencies).map(|f| 40.0 + 10.0 * f as f64).collect(), choices)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn the_search_finds_what_looking_at_everything_finds(
        actuators in 1_usize..4, frequencies in 6_usize..14, points in 1_usize..40, seed in any::<u64>(),
    ) {
        let space = random_space(actuators, frequencies, points, seed);
        let zone: Vec<usize> = (0..points).filter(|x| points < 5 || x % 5 != 3).collect();
        let found = search::find_frequencies_with_largest_least_gain_if_spacing_possible(&space, &zone, SearchEffort::Study, None);
        let wanted = find_strongest_of_all_choices(&space, &zone, 20.0);
        prop_assert_eq!(found.is_some(), wanted.is_some());
        if let (Some(found), Some(wanted)) = (found, wanted) {
            prop_assert!((found.least - wanted).abs() <= 1e-9 * wanted.max(1e-9), "{} {}", found.least, wanted);
            prop_assert!(found.upper >= wanted * (1.0 - 1e-9) && found.upper <= found.least * (1.0 + 1e-9));
            let peaks = space.peak_at_each_point(&found.choice, &found.parts);
            let least = zone.iter().map(|x| peaks[*x]).fold(f64::INFINITY, f64::min);
            prop_assert!((least - found.least).abs() <= 1e-12 * least.max(1e-9));
            for limit in 0..space.limits {
                let used: f64 = found.choice.iter().zip(&found.parts).enumerate()
                    .map(|(i, (f, part))| space.usage_fraction_of_each_limit_at_max_force(i, *f)[limit] * part).sum();
                prop_assert!(used <= 1.0 + 1e-9);
            }
        }
    }
}

/// The optimum is that of all 2 million combinations.
#[test]
fn long_lists_are_split() {
    let space = random_space(3, 130, 12, 7);
    let zone: Vec<usize> = (0..12).collect();
    let found =
        search::find_frequencies_with_largest_least_gain_if_spacing_possible(&space, &zone, SearchEffort::Study, None)
            .unwrap();
    let mut wanted = 0.0_f64;
    let full = [1.0; 3];
    for (a, b, c) in (0..130).flat_map(|a| (0..130).flat_map(move |b| (0..130).map(move |c| (a, b, c)))) {
        let apart = |f: usize, g: usize| f.abs_diff(g) >= 2;
        let choice = [a, b, c];
        if !(apart(a, b) && apart(b, c) && apart(a, c))
            || choice.iter().enumerate().any(|(i, f)| space.max_force_n(i, *f) == 0.0)
        {
            continue;
        }
        let at_full = zone.iter().map(|x| space.peak_at_point(*x, &choice, &full)).fold(f64::INFINITY, f64::min);
        if at_full > wanted {
            wanted = wanted.max(strongest(&space, &zone, &choice));
        }
    }
    assert!((found.least - wanted).abs() <= 1e-9 * wanted, "{} {wanted}", found.least);
}

/// A search that is cut short says how much may be missing.
#[test]
fn little_work_leaves_a_gap() {
    let space = random_space(4, 130, 12, 7);
    let zone: Vec<usize> = (0..12).collect();
    let all =
        search::find_frequencies_with_largest_least_gain_if_spacing_possible(&space, &zone, SearchEffort::Study, None)
            .unwrap();
    let cut =
        search::find_frequencies_with_largest_least_gain_if_spacing_possible(&space, &zone, SearchEffort::Touch, None)
            .unwrap();
    let rounded = 1.0 + 1e-9;
    assert!(cut.least <= all.least * rounded && cut.upper * rounded >= all.least, "{cut:?} {all:?}");
    assert!(cut.upper > cut.least * rounded, "{cut:?}");
}
