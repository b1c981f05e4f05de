//! Against all combinations.

use super::*;
use proptest::prelude::*;

fn any_candidate_set() -> impl Strategy<Value = CandidateSet> {
    (2_usize..=3, 1_usize..=3, 0_usize..=4, 0..3_u8).prop_flat_map(|(p, targets, limits, kind)| {
        let nodes = if p == 2 { 24 } else { 12 };
        let per = nodes * 2;
        let unit = |n: usize| prop::collection::vec(prop::collection::vec(0.0_f64..1.0, n), p);
        (
            prop::collection::vec(1.0_f64..15.0, nodes),
            unit(per * targets),
            unit(per * limits),
            unit(per),
            unit(per),
            prop::collection::vec(0.0_f64..1.5, targets),
            prop::collection::vec(0.05_f64..1.0, limits),
        )
            .prop_map(move |(steps, gains, loads, energies, forces, wanted, allowed)| {
                let frequencies_hz: Vec<f64> = steps
                    .iter()
                    .scan(40.0, |hz, step| {
                        *hz += step;
                        Some(*hz)
                    })
                    .collect();
                let candidates = (0..p)
                    .map(|i| {
                        (0..per)
                            .map(|index| Candidate {
                                node: index / 2,
                                energy: if kind == 0 { 0.0 } else { 10_f64.powf(2.0 * energies[i][index] - 1.0) },
                                power: if kind == 0 { energies[i][index] } else { 0.0 },
                                max_force_n: forces[i][index],
                                tag: index,
                            })
                            .collect()
                    })
                    .collect();
                CandidateSet {
                    is_estimated: false,
                    frequencies_hz,
                    candidates,
                    gains,
                    loads,
                    wanted,
                    allowed,
                    spacing_hz: 20.0,
                    work: SearchEffort::Study,
                }
            })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn it_is_the_exhaustive_optimum(choices in any_candidate_set(), picky in any::<bool>()) {
        let fits = |a: f64, b: f64| !picky || (a - b).abs() % 7.0 > 2.0;
        let found = choices.find_best_combination_if_spacing_can_be_kept(&fits);
        match choices.find_best_allocation_exhaustively_and_count_combinations(&fits).0 {
            None => prop_assert!(found.is_none()),
            Some(expected) => {
                let found = found.unwrap();
                prop_assert_eq!(found.gap, 0.0);
                prop_assert!((found.allocation.met - expected.met).abs() <= 1e-9 * expected.met, "{} {}", found.allocation.met, expected.met);
                let (cost, least) = (found.allocation.cost, expected.cost);
                if expected.met >= 1.0 {
                    prop_assert!((cost - least).abs() <= 1e-9 * least, "{cost} {least}");
                }
                // A touch is no further from it than it says.
                let touch = CandidateSet { work: SearchEffort::Touch, ..choices.clone() }.find_best_combination_if_spacing_can_be_kept(&fits).unwrap();
                let Allocation { met, cost, .. } = touch.allocation;
                if expected.met < 1.0 {
                    prop_assert!(met * (1.0 + touch.gap) >= expected.met * (1.0 - 1e-9), "{met} {}", touch.gap);
                } else if met >= 1.0 {
                    prop_assert!(cost * (1.0 - touch.gap) <= least * (1.0 + 1e-9), "{cost} {least} {}", touch.gap);
                } else {
                    prop_assert!(touch.gap > 0.0);
                }
            }
        }
    }
}

/// A touch is given what may be driven, however much has been looked at before that is found.
#[test]
fn the_only_pair_that_fits_is_found() {
    let frequencies_hz: Vec<f64> = (0..300).map(|k| 40.0 + 25.0 * f64::from(k)).collect();
    let only = [frequencies_hz[70], frequencies_hz[220]];
    let candidate = |node| Candidate { node, energy: 1.0, power: 0.0, max_force_n: 1.0, tag: node };
    let choices = CandidateSet {
        candidates: vec![(0..300).map(candidate).collect(); 2],
        gains: vec![vec![1.0; 300]; 2],
        loads: vec![Vec::new(); 2],
        wanted: vec![0.5],
        frequencies_hz,
        spacing_hz: 20.0,
        ..CandidateSet::default()
    };
    let found =
        choices.find_best_combination_if_spacing_can_be_kept(&|a, b| only.contains(&a) && only.contains(&b)).unwrap();
    let mut chosen = found.chosen[..2].to_vec();
    chosen.sort_unstable();
    assert_eq!(chosen, [70, 220]);
    assert_eq!(found.gap, 0.0);
}
