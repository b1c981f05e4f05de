//! The best combination that the planner finds, against all combinations, on random scenes.

use era_model::model::Accuracy;
use era_model::model::levels::ReducedLevels;
use era_model::scene::Scene;
use era_model::scene::random::random_scene_text;
use era_planner::allocate::Allocation;
use era_planner::candidates::Formulation;
use era_planner::search::CandidateSet;
use era_planner::{Objective, PlanTable, QuietZone, Request, STANDARD_GRAVITY, SearchEffort, TableOptions, Target};

/// By which part a touch, which looks at some hundred combinations, may be worse than the best; rounding, as measured here.
const TOUCH_LACKS: f64 = 1e-3;

fn table(scene: &Scene) -> PlanTable {
    // All pairs of 46 frequencies, all triples of 19, each with up to two pulse widths.
    let step_hz = if scene.actuators.len() == 2 { 8.0 } else { 20.0 };
    let options = TableOptions { step_hz, ..TableOptions::default() };
    let levels = ReducedLevels::build(scene, Accuracy::FAST, options.to_hz).unwrap();
    PlanTable::build(scene, levels.fine, options).unwrap()
}

fn same(found: &Allocation, best: &Allocation, what: &str) {
    assert!((found.met - best.met).abs() <= 1e-9 * best.met, "{what}: met {} {}", found.met, best.met);
    if best.met >= 1.0 {
        assert!((found.cost - best.cost).abs() <= 1e-9 * best.cost, "{what}: cost {} {}", found.cost, best.cost);
    }
}

#[test]
fn the_planner_finds_what_exhaustive_search_finds() {
    let any = |_: f64, _: f64| true;
    let (mut compared, mut limited, mut unproven, mut most_lack) = ([0; 4], 0, 0, 0.0_f64);
    for number in 0..24 {
        let scene = Scene::parse("random", &random_scene_text(3, number)).unwrap();
        let p = scene.actuators.len();
        if !(2..=3).contains(&p) {
            continue;
        }
        let table = table(&scene);
        let (length, width) = (scene.surface.length_m, scene.surface.width_m);
        let target = |x: f64, y: f64, intensity_g| Target { x_m: x * length, y_m: y * width, intensity_g };
        let (first, second) = (target(0.23, 0.61, None), target(0.78, 0.34, None));
        // From the bounds alone nothing is dropped that is part of the best, in corners and at ends either.
        for (x, y) in [(0.0, 0.0), (1.0, 0.5), (0.02, 0.97)] {
            for intensity_g in [0.05, 5.0] {
                let request = Request { work: SearchEffort::Study, ..Request::for_touch(&[target(x, y, None)]) };
                let formulation = Formulation::new(&table, &request);
                let wanted = intensity_g * STANDARD_GRAVITY;
                let (all, short) = (
                    formulation.list_candidates_at_all_table_frequencies(&[wanted]),
                    formulation.shortlist_for_one_target_estimating_energies_if_wish_unmet(wanted, &any),
                );
                let both = all
                    .find_best_combination_if_spacing_can_be_kept(&any)
                    .zip(short.find_best_combination_if_spacing_can_be_kept(&any));
                // At a held edge nothing is reached, and a wish counts as a million times that.
                if let Some((all, short)) = both.filter(|(all, _)| all.allocation.met > 1e-5) {
                    same(&short.allocation, &all.allocation, &format!("scene {number} at {x}, {y}: {intensity_g} g"));
                }
            }
        }
        let zone = |x: f64, y: f64, at_most_g| QuietZone { x_m: x * length, y_m: y * width, radius_m: 0.01, at_most_g };
        for (objective, quiet, targets) in [
            (Objective::Contrast, vec![], vec![first]),
            (Objective::Power, vec![], vec![first]),
            (Objective::Contrast, vec![], vec![first, second]),
            (Objective::Contrast, vec![zone(0.5, 0.5, 0.05)], vec![first]),
            (Objective::Contrast, vec![zone(0.5, 0.5, 0.02), zone(0.9, 0.8, 0.1)], vec![first, second]),
        ] {
            for intensity_g in [0.05, 0.5, 5.0] {
                let request = Request {
                    targets: targets.clone(),
                    quiet: quiet.clone(),
                    objective,
                    work: SearchEffort::Study,
                    ..Request::default()
                };
                let formulation = Formulation::new(&table, &request);
                let wanted: Vec<f64> = (0..targets.len())
                    .map(|t| intensity_g * STANDARD_GRAVITY / (1.0 + f64::from(u8::from(t > 0))))
                    .collect();
                let all = formulation.list_candidates_at_all_table_frequencies(&wanted);
                let (Some(best), Some(found)) = (
                    all.find_best_allocation_exhaustively_and_count_combinations(&any).0,
                    all.find_best_combination_if_spacing_can_be_kept(&any),
                ) else {
                    continue;
                };
                let what = format!(
                    "scene {number}, {objective:?}, {} targets, {} quiet, {intensity_g} g",
                    targets.len(),
                    quiet.len()
                );
                assert_eq!(found.gap, 0.0, "{what}");
                same(&found.allocation, &best, &what);
                let touch = CandidateSet { work: SearchEffort::Touch, ..all.clone() }
                    .find_best_combination_if_spacing_can_be_kept(&any)
                    .unwrap();
                let lack = if best.met < 1.0 {
                    1.0 - touch.allocation.met / best.met
                } else if touch.allocation.met < 1.0 {
                    1.0
                } else {
                    touch.allocation.cost / best.cost - 1.0
                };
                assert!(lack <= TOUCH_LACKS && (touch.gap > 0.0 || lack <= 1e-9), "{what}: {lack}, {}", touch.gap);
                most_lack = most_lack.max(lack);
                unproven += u32::from(touch.gap > 0.0);
                limited += u32::from(best.met < 1.0);
                compared[p] += 1;
                if wanted.len() == 1 && quiet.is_empty() && objective == Objective::Contrast {
                    // From the bounds alone nothing is dropped that is part of it.
                    let (_, found) = formulation
                        .find_best_combination_replacing_estimated_energies_at_most_once(
                            formulation.shortlist_for_one_target_estimating_energies_if_wish_unmet(wanted[0], &any),
                            &any,
                        )
                        .unwrap();
                    same(&found.allocation, &best, &format!("{what}, shortlist"));
                }
            }
        }
    }
    println!(
        "{compared:?} compared by number of actuators, {limited} beyond reach; of touches {unproven} not proven, at most \
         {most_lack:.1e} worse"
    );
    assert!(compared[2] >= 24 && compared[3] >= 24 && limited >= 10);
}
