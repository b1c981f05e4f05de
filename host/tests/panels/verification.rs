//! Random scenes: the simulated device against the prediction, and what the electrodes do to the masses.

use era::device::sim::SimPanel;
use era::model::levels::ReducedLevels;
use era::model::{Accuracy, PanelModel};
use era::planner::softening::{Excitation, Line, Transducer, compute_travel_receptance, solve_steady_motion};
use era::planner::{PlanTable, TableOptions, Target};
use era::response::CoordinateSolver;
use era::scene::random::random_scene_text;
use era::scene::{EXAMPLE_BAR, Scene};
use era::verify::{VerifyError, compare_plan_with_simulation};
use era_shared::supply::{RAILS, rail_index_of_channel};
use rayon::prelude::*;
use trials::{Tally, Trial, TrialOutcome, Verdict, exceeds_travel_limit, try_scene, verdict_on};

mod trials;

#[test]
fn prediction_and_simulation_agree_on_random_scenes() {
    let trials: Vec<Trial> = (0..5).flat_map(|scene| try_scene(1, scene, 2)).collect();
    let compared: Vec<_> = trials.iter().filter_map(Trial::comparison).collect();
    assert!(compared.len() >= 7, "{} of {}", compared.len(), trials.len());
    for trial in &trials {
        assert!(trial.failure_reason().is_none(), "{trial:?}");
    }
    assert!(compared.iter().all(|comparison| verdict_on(comparison) == Verdict::Within));
    // With the damping that the panel has in time all that is left is small.
    assert!(compared.iter().map(|c| c.causal_difference.abs()).fold(0.0, f64::max) < 0.005);
    // The plan itself says what the device does but for what a register rounds.
    assert!(compared.iter().map(|c| c.plan_difference.abs()).fold(0.0, f64::max) < 0.01);
    // A bound that says little does not make anything pass, and a figure that is off is outside.
    let mut other = compared[0].clone();
    other.error_bound = Some(0.3);
    assert_eq!(verdict_on(&other), Verdict::BoundTooLarge);
    (other.error_bound, other.difference) = (Some(0.001), 0.022);
    assert_eq!(verdict_on(&other), Verdict::Outside);
    // Softening is not nothing here.
    assert!(compared.iter().any(|c| c.linear_difference.abs() > 0.02));
}

/// The figures of the manual: of 200 scenes with 10 touches each, unless `ERA_SCENES` says another number of scenes.
#[test]
#[ignore = "takes nine minutes of processor time; run by hand for the figures of the manual"]
fn many_random_touches_are_within_their_bounds() {
    let scenes = std::env::var("ERA_SCENES").ok().and_then(|count| count.parse().ok()).unwrap_or(200_u64);
    let trials: Vec<Trial> = (0..scenes).into_par_iter().flat_map_iter(|scene| try_scene(1, scene, 10)).collect();
    for Trial { name, outcome } in &trials {
        match outcome {
            TrialOutcome::NotCompared(reason) => println!("{name}: not compared: {reason}"),
            TrialOutcome::Failed(reason) => println!("{name}: failed: {reason}"),
            TrialOutcome::Compared { comparison, reason: Some(reason) } => println!(
                "{name}: planned {:.3e} g, simulated {:.3e} g, {:+.2} %: {reason}",
                comparison.predicted_g,
                comparison.simulated_g,
                comparison.difference * 100.0
            ),
            TrialOutcome::Compared { reason: None, .. } => {}
        }
    }
    let tally = Tally::of(&trials);
    tally.print_tables();
    assert!(!trials.iter().filter_map(Trial::comparison).any(exceeds_travel_limit));
    assert!(100 * tally.within.len() >= 95 * tally.count_judged(), "fewer than 95 % are within");
}

/// Two actuators of this scene share a rail, and one needs so little force that its windows would be shorter than a tick of
/// the timer: it is sent as none, and the board takes the plan.
#[test]
fn a_drive_of_next_to_nothing_on_a_rail_is_taken() {
    for trial in try_scene(1, 107, 4) {
        assert!(!matches!(trial.outcome, TrialOutcome::Failed(_)), "{trial:?}");
    }
}

/// What the softened motion says is within the limits stays within them in time, switching on included: travel of a third of
/// the gap, 0.85 of the breakdown voltage of what is left of it.
#[test]
fn a_motion_that_is_said_to_be_safe_is() {
    let (mut safe, mut near) = (0, 0);
    // The last one has a lightly damped ERA between two modes that nearly cancel in the steady state, but not before.
    for (seed, number) in (0..6).map(|number| (7, number)).chain([(1, 171)]) {
        let scene = Scene::parse("random", &random_scene_text(seed, number)).unwrap();
        let options = TableOptions { step_hz: 4.0, ..TableOptions::default() };
        let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
        let table = PlanTable::build(&scene, levels.fine, options).unwrap();
        let panel = SimPanel::from_plan_table(&table);
        for (x, y, intensity_g) in [(0.31, 0.62, 3.0), (0.87, 0.13, 1e3)] {
            let (x_m, y_m) = (x * scene.surface.length_m, y * scene.surface.width_m);
            let found =
                match compare_plan_with_simulation(&table, &panel, Target { x_m, y_m, intensity_g: Some(intensity_g) })
                {
                    Ok(found) => found,
                    Err(VerifyError::NeverSettles | VerifyError::Nothing) => continue,
                    Err(error) => panic!("{error}"),
                };
            // Channels on one rail are at the higher of their voltages.
            let mut rails_v = [0.0_f64; RAILS];
            for (channel, drive) in found.drives.iter().enumerate() {
                rails_v[rail_index_of_channel(channel)] = rails_v[rail_index_of_channel(channel)].max(drive.voltage_v);
            }
            let violates = |parts: &dyn Fn(usize) -> f64| {
                table.electrodes.iter().enumerate().any(|(channel, electrodes)| {
                    let travel_m = parts(channel) * electrodes.gap_m;
                    // A voltage at its limit is there but for the last digits.
                    let rail_v = (1.0 - 1e-12) * rails_v[rail_index_of_channel(channel)].min(electrodes.max_voltage_v);
                    electrodes.first_violated_limit_if_any(travel_m, rail_v).is_some()
                })
            };
            assert!(!violates(&|channel| found.travel[channel].predicted), "scene {number}: {found:?}");
            safe += 1;
            near += u32::from(found.predicted_travel() > 0.2);
            // 2 % for the soft start, and for motion at sums and differences of the frequencies.
            assert!(!violates(&|channel| found.travel[channel].simulated / 1.02), "scene {number}: {found:?}");
            assert!(found.travel.iter().all(|travel| !travel.snapped_in), "scene {number}: {found:?}");
        }
    }
    println!("{safe} safe, {near} of them beyond a fifth of the gap");
    assert!(safe >= 8 && near >= 3, "{safe} safe, {near} near the limit");
}

/// Touches that used to go further, to 0.67 of the gap: in the first scene a mode of the panel takes an ERA's motion away, and
/// takes its time over it; in the second electrodes soften two such modes; in the third harmonics close a soft ERA's gap for its fundamental.
#[test]
fn no_touch_goes_beyond_a_third_of_the_gap() {
    for (seed, scene, touches) in [(1, 130, 10), (1, 93, 10), (2, 144, 4)] {
        let trials = try_scene(seed, scene, touches);
        assert!(trials.iter().filter_map(Trial::comparison).count() >= 4, "{trials:?}");
        for trial in &trials {
            assert!(!trial.comparison().is_some_and(exceeds_travel_limit), "{trial:?}");
        }
    }
    let mut other = try_scene(1, 0, 1).remove(0);
    let TrialOutcome::Compared { comparison, .. } = &mut other.outcome else { panic!("{other:?}") };
    assert_eq!(verdict_on(comparison), Verdict::Within);
    comparison.travel[0].simulated = 0.34;
    assert_eq!(verdict_on(comparison), Verdict::Outside);
}

/// The prediction of one touch, from the reduced model on: travel grows with softening on the low side of a resonance.
#[test]
fn a_drive_of_the_example_bar_is_softened_as_the_spring_law_says() {
    let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
    let model = PanelModel::build(&scene, Accuracy::FAST, 400.0)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
        .unwrap();
    let solver = CoordinateSolver::new(&model);
    let transducers: Vec<Transducer> = scene.actuators.iter().map(Transducer::from_actuator).collect();
    let travel = |frequency_hz: f64, voltage_v: f64| {
        let receptance =
            compute_travel_receptance(&model, &solver.solve_coordinates_per_newton_at(frequency_hz).unwrap());
        let drive = |voltage_v: f64| Excitation {
            frequency: 0,
            frequency_hz,
            voltage_v,
            pulse_width: 2.0 / 3.0,
            phase_rad: 0.0,
        };
        let mut drives = vec![drive(0.0); transducers.len()];
        drives[0] = drive(voltage_v);
        let motion =
            solve_steady_motion(&transducers, &drives, &[Line { frequency: 0, harmonic: 1, receptance }]).unwrap();
        motion.travel_m[0][0].norm() / (voltage_v * voltage_v)
    };
    // Far below all resonances the spring alone counts: k_e = w eps0 S V^2 / g^3 and its pulsation, sin(pi w) / pi of it
    // for motion in phase, are taken off.
    let (transducer, volts) = (transducers[0], 500.0);
    let receptance = compute_travel_receptance(&model, &solver.solve_coordinates_per_newton_at(1.0).unwrap())[0][0].re;
    let slope = 2.0 * transducer.newtons_per_volt_squared * volts * volts / transducer.gap_m;
    let width = 2.0 / 3.0_f64;
    let softening = slope * (width + (std::f64::consts::PI * width).sin() / std::f64::consts::PI);
    let expected = 1.0 / (1.0 - softening * receptance);
    let found = travel(1.0, volts) / travel(1.0, 1.0);
    assert!((found - expected).abs() < 0.01 * (expected - 1.0), "{found} {expected}");
}
