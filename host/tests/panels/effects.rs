//! Effects as designed against effects as played: the same frames that a board gets, on a panel in time.

use crate::support;
use era::device::convert::{drive_to_wire_zeroing_too_narrow_pulses, windows_to_wire_sequence_dropping_excess};
use era::device::sim::{LargestTravel, STEP_S, low_pass_response};
use era::effects::design::EffectPrediction;
use era::effects::{
    EffectDesign, EffectRequest, Intensity, NamedEffect, design_effect,
    design_effect_of_windows_if_common_click_exists_else_of_drives, intensity,
    plan_request_with_intensity_for_targets_without_one, sample_acceleration_of_design_unless_undamped_m_per_s2,
};
use era::model::Accuracy;
use era::model::levels::ReducedLevels;
use era::planner::click::{ClickOptions, LEAD_S, Preference, design_click_windows};
use era::planner::limits::Electrodes;
use era::planner::residual::{RailState, ResidualVibration, find_fraction_and_plan_within_headroom};
use era::planner::rise::PanelPoles;
use era::planner::{self, PlanTable, STANDARD_GRAVITY, TableOptions, Target};
use era::scene::random::random_scene_text;
use era::scene::{EXAMPLE_BAR, EXAMPLE_PLATE, STARTING_PLATE, Scene};
use era::verify::bench::Bench;
use era_shared::protocol::{Reply, Request, WindowSequence};
use era_shared::waveform::{Effect, Segment};
use num_complex::Complex64;

/// How long after the start is recorded, in s.
const RECORD_S: f64 = 0.5;

/// A bench for the panel of a table, with the accelerometer at the target.
fn make_bench(table: &PlanTable, target: &Target) -> Bench {
    let (mut panel, max_voltages_v) = support::panel_of(table);
    panel.place_accelerometer(&intensity::mode_shape_values_at_point_or_on_bar_axis(table, target.x_m, target.y_m));
    Bench::new(panel, &max_voltages_v)
}

/// Arms the device of a bench at its start, and waits until its rails are up.
fn arm_device(bench: &mut Bench, until_us: u64) {
    bench.send_request(&Request::ArmWith { deadman_ms: None, burst_ms: None }).unwrap();
    bench.run_until_us(until_us).unwrap();
}

/// The accelerometer's record in m/s^2 from `start_us` on, the effects' start; rails are up long before.
fn play_effects(bench: &mut Bench, design: &EffectDesign, effects: &[Effect], start_us: u64) -> Vec<f64> {
    arm_device(bench, 100_000);
    let drives = design.drives_with_board_channels().iter().map(drive_to_wire_zeroing_too_narrow_pulses).collect();
    let prepared = bench.send_request(&Request::Prepare { drives }).unwrap();
    assert!(matches!(prepared, Reply::Prepared { .. }), "{prepared:?}");
    bench.run_until_us(start_us - 20_000).unwrap();
    for (channel, effect) in (0..).zip(effects) {
        let request = Request::Play { channel, start_us, effect: effect.clone() };
        assert_eq!(bench.send_request(&request).unwrap(), Reply::Playing);
    }
    bench.run_until_us(start_us).unwrap();
    bench.accelerometer_mut().start_record();
    bench.run_until_us(start_us + (RECORD_S * 1e6) as u64).unwrap();
    bench.accelerometer_mut().stop_and_take_record()
}

/// What is felt of a click's windows at the accelerometer, as [`felt_part`] has it from [`LEAD_S`] after their start on.
fn record_felt_motion_of_windows(bench: &mut Bench, design: &EffectDesign) -> Vec<f64> {
    arm_device(bench, 300_000);
    let start_us = 600_000;
    let windows =
        Request::PlayWindows(WindowSequence { start_us, ..windows_to_wire_sequence_dropping_excess(&design.windows) });
    assert_eq!(bench.send_request(&windows).unwrap(), Reply::WindowsPlaying { start_us });
    bench.run_until_us(start_us).unwrap();
    bench.accelerometer_mut().start_record();
    bench.run_until_us(start_us + 1_000_000).unwrap();
    felt_part(&bench.accelerometer_mut().stop_and_take_record(), LEAD_S)
}

fn largest(record: &[f64]) -> f64 {
    record.iter().fold(0.0, |most, x| most.max(x.abs()))
}

/// When a record has fallen below `quiet` for good, in ms.
fn quiet_ms(record: &[f64], quiet: f64) -> f64 {
    record.iter().rposition(|x| x.abs() > quiet).unwrap_or(0) as f64 * STEP_S * 1e3
}

/// The felt part of a record of 1 s, line by line: full to 300 Hz, a raised cosine to nothing at 500 Hz; the accelerometer's own low-pass is
/// taken out. One sample every 1/16 ms from `from_s` on, for 0.2 s.
fn felt_part(record: &[f64], from_s: f64) -> Vec<f64> {
    let count = record.len() as f64;
    let mut felt = vec![0.0; 3200];
    for hz in 1..500_u32 {
        let turn = |at: f64| Complex64::cis(std::f64::consts::TAU * f64::from(hz) * at);
        let step = turn(-STEP_S);
        let mut phasor = Complex64::ONE;
        let mut line = Complex64::ZERO;
        for x in record {
            line += phasor * x;
            phasor *= step;
        }
        // A sample is the mean over the step that ends with it.
        let weight =
            if hz < 300 { 1.0 } else { (std::f64::consts::PI * (f64::from(hz) - 300.0) / 400.0).cos().powi(2) };
        let middle = turn(0.5 * STEP_S);
        let line = line * middle / low_pass_response(f64::from(hz)) * (2.0 * weight / count);
        let (mut now, step) = (line * turn(from_s), turn(1.0 / 16e3));
        for x in &mut felt {
            *x += now.re;
            now *= step;
        }
    }
    felt
}

/// Clicks of single windows: what the simulated device's panel does is what was designed, to 2 % of the peak (root mean square), and it is crisp
/// where the design says so.
#[test]
fn clicks_of_single_windows_do_what_is_predicted() {
    let resistors =
        "\n[electronics]\ncharging_resistance_ohm = 1e6\ndischarging_resistance_ohm = 1e5\ndischarging_delay_us = 15\n";
    let [plate, bar] = [STARTING_PLATE, EXAMPLE_BAR].map(|scene| format!("{scene}{resistors}"));
    let mut crisp = 0;
    for (scene, x_m, y_m, g) in [
        (STARTING_PLATE, 0.04, 0.03, 0.5),
        (STARTING_PLATE, 0.11, 0.1, 0.4),
        (&plate, 0.04, 0.1, 0.5),
        (EXAMPLE_BAR, 0.06, 0.01, 0.5),
        (&bar, 0.12, 0.01, 0.8),
    ] {
        let table = support::table(scene);
        let poles = table.panel_poles().unwrap();
        let target = Target { x_m, y_m, intensity_g: Some(g) };
        let plan = table.plan(&[target]).unwrap();
        let (request, options) = (EffectRequest::with_defaults(NamedEffect::Click), ClickOptions::default());
        let design =
            design_effect_of_windows_if_common_click_exists_else_of_drives(&table, poles, &plan, request, options)
                .unwrap();
        let shapes = [intensity::mode_shape_values_at_point_or_on_bar_axis(&table, x_m, y_m)];
        let click = design_click_windows(&table, poles, &shapes, &[g * STANDARD_GRAVITY], options).unwrap();
        assert_eq!(click.windows.len(), design.windows.len());
        let felt = record_felt_motion_of_windows(&mut make_bench(&table, &target), &design);
        let peak = largest(&click.felt_motion);
        let difference: f64 = felt.iter().zip(&click.felt_motion).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let error = (difference / felt.len() as f64).sqrt() / peak;
        let EffectPrediction { peak_g, peak_at_ms, quiet_ms, .. } = design.predicted;
        println!(
            "{x_m} {y_m}: {peak_g:.3} g of {g} at {peak_at_ms:.1} ms, quiet at {quiet_ms:?} ms, error {error:.1e}"
        );
        assert!(error < 0.02, "{x_m} {y_m}: {error}");
        assert!((largest(&felt) / STANDARD_GRAVITY - peak_g).abs() < 0.02 * peak_g, "{x_m} {y_m}");
        assert!(peak_g <= 1.1 * g, "{x_m} {y_m}: {peak_g} g of {g} g");
        if quiet_ms.is_some_and(|quiet_ms| quiet_ms <= 45.0) && peak_at_ms <= 15.5 && peak_g >= 0.95 * g {
            crisp += 1;
            let from = ((0.045 - LEAD_S) * 16e3) as usize;
            assert!(largest(&felt[from..]) < 0.11 * largest(&felt), "{x_m} {y_m}");
        }
    }
    assert!(crisp >= 4, "{crisp} of 5 are crisp");
}

/// Both clicks of a double click on the simulated device are those that are predicted: the acceleration over time, and the weaker peak.
#[test]
fn a_double_click_on_the_simulated_device_is_as_predicted() {
    for (scene, x_m, y_m, g) in [(EXAMPLE_PLATE, 0.06, 0.05, 0.3), (EXAMPLE_BAR, 0.06, 0.01, 0.5)] {
        let table = support::table(scene);
        let poles = table.panel_poles().unwrap();
        let target = Target { x_m, y_m, intensity_g: Some(g) };
        let plan = table.plan(&[target]).unwrap();
        let request = EffectRequest { period_ms: Some(80.0), ..EffectRequest::with_defaults(NamedEffect::DoubleClick) };
        let options = ClickOptions::default();
        let design =
            design_effect_of_windows_if_common_click_exists_else_of_drives(&table, poles, &plan, request, options)
                .unwrap();
        assert!(!design.windows.is_empty(), "{design:?}");
        let felt = record_felt_motion_of_windows(&mut make_bench(&table, &target), &design);
        let shape = intensity::mode_shape_values_at_point_or_on_bar_axis(&table, x_m, y_m);
        let from = (LEAD_S * 16e3).round() as usize;
        let predicted: Vec<f64> =
            sample_acceleration_of_design_unless_undamped_m_per_s2(&table, poles, &design, &shape, 1.0 / 16e3)
                .unwrap()
                .split_off(from);
        let difference: f64 = felt.iter().zip(&predicted).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let error = (difference / felt.len() as f64).sqrt() / largest(&predicted);
        let clicks = felt.split_at((0.080 * 16e3) as usize);
        let weaker_g = largest(clicks.0).min(largest(clicks.1)) / STANDARD_GRAVITY;
        println!("{x_m} {y_m}: error {error:.1e}, weaker {weaker_g:.3} g of {:.3} g", design.predicted.peak_least_g);
        assert!(error < 0.02, "{x_m} {y_m}: {error}");
        assert!((weaker_g / design.predicted.peak_least_g - 1.0).abs() < 0.02, "{x_m} {y_m}: {weaker_g}");
    }
}

/// Its place in m, and what it is to feel in g.
type Finger = (f64, f64, f64);

/// A click for several fingers: each of them feels the peak that is told for it, all at the same time, and none of them feels more after 45 ms than
/// a tenth of it where the click is told to be crisp. In another order the fingers feel the same.
#[test]
fn several_fingers_feel_the_same_click() {
    let mut crisp = 0;
    let cases: [(&str, &[Finger]); 5] = [
        (EXAMPLE_PLATE, &[(0.060, 0.050, 0.3), (0.240, 0.140, 0.3)]),
        (EXAMPLE_PLATE, &[(0.150, 0.100, 0.2), (0.030, 0.170, 0.35)]),
        (EXAMPLE_PLATE, &[(0.040, 0.040, 0.2), (0.260, 0.050, 0.2), (0.150, 0.160, 0.3)]),
        (STARTING_PLATE, &[(0.040, 0.030, 0.2), (0.200, 0.120, 0.2)]),
        (EXAMPLE_BAR, &[(0.060, 0.010, 0.5), (0.240, 0.010, 0.3)]),
    ];
    for (scene, fingers) in cases {
        let table = support::table(scene);
        let poles = table.panel_poles().unwrap();
        let targets: Vec<Target> =
            fingers.iter().map(|(x_m, y_m, g)| Target { x_m: *x_m, y_m: *y_m, intensity_g: Some(*g) }).collect();
        let (request, options) = (EffectRequest::with_defaults(NamedEffect::Click), ClickOptions::default());
        let design_for = |targets: &[Target]| {
            let plan = table.plan(targets).unwrap();
            design_effect_of_windows_if_common_click_exists_else_of_drives(&table, poles, &plan, request, options)
                .unwrap()
        };
        let design = design_for(&targets);
        assert!(!design.windows.is_empty() && design.peaks_g.len() == fingers.len(), "{fingers:?}: {design:?}");
        let (mut reached, mut felts) = (Vec::new(), Vec::new());
        for (target, told_g) in targets.iter().zip(&design.peaks_g) {
            let felt = record_felt_motion_of_windows(&mut make_bench(&table, target), &design);
            let peak_g = largest(&felt) / STANDARD_GRAVITY;
            assert!((peak_g - told_g).abs() < 0.02 * told_g, "{fingers:?}: {peak_g} g, told {told_g} g");
            if design.predicted.crisp == Some(true) {
                let from = ((0.045 - LEAD_S) * 16e3) as usize;
                assert!(largest(&felt[from..]) < 0.11 * largest(&felt), "{fingers:?}");
            }
            reached.push(peak_g / target.intensity_g.unwrap());
            felts.push(felt);
        }
        let is_crisp = design.predicted.crisp == Some(true);
        println!("{fingers:?}: {reached:.2?} of the wishes, crisp: {is_crisp}, limits {:?}", design.limits);
        crisp += usize::from(is_crisp);
        let (least, most) = reached.iter().fold((f64::INFINITY, 0.0_f64), |(l, m), own| (l.min(*own), m.max(*own)));
        assert!(most <= 1.1 && most < 1.15 * least, "{fingers:?}: {reached:?}");
        // At one moment all of them have nine tenths of their peaks; one may have had as much before.
        let least_part =
            |sample: usize| felts.iter().map(|felt| felt[sample].abs() / largest(felt)).fold(f64::INFINITY, f64::min);
        let together = (0..felts[0].len()).map(least_part).fold(0.0, f64::max);
        assert!(together >= 0.9, "{fingers:?}: {together} of the peaks at the same time");
        assert_eq!(least < 0.95, !design.limits.is_empty(), "{fingers:?}: {reached:?}, {:?}", design.limits);
        let reversed: Vec<Target> = targets.iter().rev().copied().collect();
        let other = design_for(&reversed);
        for (one, other) in design.peaks_g.iter().zip(other.peaks_g.iter().rev()) {
            assert!((one - other).abs() < 0.05 * one, "{fingers:?}: {:?}, reversed {other:?}", design.peaks_g);
        }
    }
    assert!(crisp >= 3, "{crisp} of 5 are crisp");
}

/// The effects up to their first segment: clicks without brakes.
fn unbraked(design: &EffectDesign) -> Vec<Effect> {
    let first = |drive: &era::effects::design::DesignedDrive| {
        let push = drive.effect.segments[0];
        assert!(matches!(push, Segment::Cycles { level: 1000, .. }), "{push:?}");
        Effect { segments: [push].into_iter().collect(), times: 1 }
    };
    design.drives.iter().map(first).collect()
}

#[test]
fn clicks_do_what_is_predicted() {
    let resistors =
        "\n[electronics]\ncharging_resistance_ohm = 1e6\ndischarging_resistance_ohm = 1e5\ndischarging_delay_us = 15\n";
    let [plate, bar] = [STARTING_PLATE, EXAMPLE_BAR].map(|scene| format!("{scene}{resistors}"));
    let places = [
        (STARTING_PLATE, 0.15, 0.06, 0.4),
        (STARTING_PLATE, 0.08, 0.1, 0.3),
        (EXAMPLE_BAR, 0.06, 0.01, 0.5),
        (EXAMPLE_BAR, 0.15, 0.01, 0.5),
        // Electrodes behind resistors.
        (&plate, 0.15, 0.06, 0.4),
        (&bar, 0.06, 0.01, 0.5),
    ];
    let mut sooner = 0;
    for (scene, x_m, y_m, g) in places {
        let table = support::table(scene);
        let rise = PanelPoles::find_poles_if_converged(&table.model).unwrap();
        let target = Target { x_m, y_m, intensity_g: None };
        let plan = plan_request_with_intensity_for_targets_without_one(
            &table,
            || Some(&rise),
            &planner::Request::for_touch(&[target]),
            Some(Intensity::G(g)),
        )
        .unwrap();
        let design = design_effect(&table, &rise, &plan, EffectRequest::with_defaults(NamedEffect::Click)).unwrap();
        let predicted = design.predicted;
        if design.limited_by.is_none() {
            assert!((predicted.peak_g - g).abs() < 0.02 * g, "{predicted:?}");
        }
        let effects: Vec<Effect> = design.drives.iter().map(|drive| drive.effect.clone()).collect();
        let (mut peaks, mut braked_ms, mut plain_ms) = (Vec::new(), 0.0, 0.0);
        // Cycles fall together otherwise at each start.
        for start_us in [400_000, 403_100, 407_700, 411_900] {
            let record = play_effects(&mut make_bench(&table, &target), &design, &effects, start_us);
            peaks.push(largest(&record) / STANDARD_GRAVITY);
            let quiet = 0.1 * predicted.peak_g * STANDARD_GRAVITY;
            braked_ms += quiet_ms(&record, quiet) / 4.0;
            let plain = play_effects(&mut make_bench(&table, &target), &design, &unbraked(&design), start_us);
            plain_ms += quiet_ms(&plain, quiet) / 4.0;
        }
        let mean: f64 = peaks.iter().sum::<f64>() / 4.0;
        assert!((mean / predicted.peak_g - 1.0).abs() < 0.15, "{mean} g, {predicted:?}");
        for peak in peaks {
            let range = 0.85 * predicted.peak_least_g..1.15 * predicted.peak_most_g;
            assert!(range.contains(&peak), "{peak} g, {predicted:?}");
        }
        // Where there is a brake it must not make things worse, and mostly make them better.
        assert!(braked_ms < 1.1 * plain_ms + 5.0, "quiet after {braked_ms} ms, {plain_ms} ms unbraked");
        sooner += u32::from(braked_ms < 0.9 * plain_ms);
    }
    assert!(sooner >= 3, "brakes shorten the decay at {sooner} of {} places", places.len());
}

#[test]
fn even_effects_are_as_strong_as_planned() {
    let table = support::table(EXAMPLE_BAR);
    let rise = PanelPoles::find_poles_if_converged(&table.model).unwrap();
    let target = Target { x_m: 0.06, y_m: 0.01, intensity_g: Some(0.5) };
    let plan = plan_request_with_intensity_for_targets_without_one(
        &table,
        || Some(&rise),
        &planner::Request::for_touch(&[target]),
        None,
    )
    .unwrap();
    for effect in [NamedEffect::Buzz, NamedEffect::PulseTrain, NamedEffect::Texture] {
        let design = design_effect(&table, &rise, &plan, EffectRequest::with_defaults(effect)).unwrap();
        let effects: Vec<Effect> = design.drives.iter().map(|drive| drive.effect.clone()).collect();
        let record = play_effects(&mut make_bench(&table, &target), &design, &effects, 400_000);
        let peak = largest(&record) / STANDARD_GRAVITY;
        let predicted = design.predicted;
        assert!((0.85 * predicted.peak_least_g..1.15 * predicted.peak_most_g).contains(&peak), "{peak}, {predicted:?}");
        for (drive, planned) in design.drives.iter().zip(&plan.drives) {
            assert!(drive.drive.voltage_v <= planned.voltage_v * (1.0 + 1e-9));
        }
    }
}

/// Soft ERAs, far more asked for than they can do: voltage, travel and the air's strength keep the effects within bounds,
/// with forces that grow as gaps close.
#[test]
fn no_effect_goes_beyond_the_actuators_limits() {
    for (stiffness, damping, volts) in
        [("1500.0", "0.3", "2000.0"), ("5000.0", "1.1", "2600.0"), ("2500.0", "4.0", "1200.0")]
    {
        let scene = EXAMPLE_BAR
            .replace("stiffness_n_per_m = 5000.0", &format!("stiffness_n_per_m = {stiffness}"))
            .replace("damping_n_s_per_m = 1.1", &format!("damping_n_s_per_m = {damping}"))
            .replace("max_voltage_v = 2000.0", &format!("max_voltage_v = {volts}"));
        let table = support::table(&scene);
        let rise = PanelPoles::find_poles_if_converged(&table.model).unwrap();
        // The swell has its full level between 200 and 300 ms.
        for (x_m, effect) in [
            (0.02, NamedEffect::Click),
            (0.11, NamedEffect::DoubleClick),
            (0.2, NamedEffect::PulseTrain),
            (0.06, NamedEffect::Swell),
        ] {
            let target = Target { x_m, y_m: 0.01, intensity_g: None };
            let plan = plan_request_with_intensity_for_targets_without_one(
                &table,
                || Some(&rise),
                &planner::Request::for_touch(&[target]),
                Some(Intensity::G(30.0)),
            )
            .unwrap();
            let design = design_effect(&table, &rise, &plan, EffectRequest::with_defaults(effect)).unwrap();
            assert!(design.limited_by.as_ref().is_some_and(|by| by.contains(" of ")), "{:?}", design.limited_by);
            let effects: Vec<Effect> = design.drives.iter().map(|drive| drive.effect.clone()).collect();
            let mut bench = make_bench(&table, &target);
            play_effects(&mut bench, &design, &effects, 400_000);
            let largest_travels = bench.panel_mut().take_largest_travels_since_last_call();
            for ((largest_travel, electrodes), drive) in
                largest_travels.iter().zip(&table.electrodes).zip(&design.drives)
            {
                let part = largest_travel.travel_m / electrodes.gap_m;
                assert!(!largest_travel.snapped_in && part <= 1.0 / 3.0, "{effect:?}: {part} of the gap");
                assert!(drive.drive.voltage_v <= electrodes.max_voltage_v);
                let holds = era::planner::limits::breakdown_voltage_v(electrodes.gap_m - largest_travel.travel_m);
                assert!(
                    drive.drive.voltage_v <= 0.851 * holds,
                    "{effect:?}: {} V, {holds} V break down",
                    drive.drive.voltage_v
                );
            }
        }
    }
}

/// What rests on a touched place of every second panel below.
const FINGER: &str = "\n[finger]\nmass_g = 8.0\ndamping_n_s_per_m = 2.0\nstiffness_n_per_m = 800.0\n";
/// How long rails have to rise for a push, in us.
const RISE_US: u64 = 10_000;
/// Effects that take longer than this, in us, have a rest behind them.
const LONG_US: u64 = 200_000;
/// From the start of one burst to the next, in us: a slider with 17 detents a second.
const NEXT_BURST_US: u64 = 60_000;

/// Plays clicks in quick succession, bursts of windows and pushes, each as weak as what is left of those before makes it.
fn play_effects_in_quick_succession(bench: &mut Bench, table: &PlanTable, designs: &[&EffectDesign], name: &str) {
    arm_device(bench, 300_000);
    let predict =
        |design: &EffectDesign| design.predict_travel_and_free_motion_left_by_effect_if_poles_known(table).unwrap();
    let mut residual = ResidualVibration::new(table.decay_rate_and_travel_of_each_pole());
    for (design, number) in designs.iter().zip(1_u32..) {
        let now_s = bench.time_s();
        let headroom = |design: &EffectDesign| {
            residual.max_force_fraction_that_fits_without_wait(&predict(design), None, now_s, RailState::Up)
        };
        let weaken = |part: f64| Ok::<_, ()>(design.scale_copy_to_force_fraction(part));
        let (part, fitting) = find_fraction_and_plan_within_headroom((*design).clone(), weaken, headroom).unwrap();
        if part > 0.0 {
            let start_us = start_effect_soon(bench, &fitting, number, name);
            let until_s = start_us as f64 * 1e-6 + 1e-3 * fitting.length_ms;
            let id = u64::from(number);
            residual.record_drives_that_begin_in_place_of_others(
                id,
                &predict(&fitting),
                None,
                RailState::Up,
                now_s,
                until_s,
            );
            bench.run_until_us(start_us).unwrap();
        }
        let length_us = (1e3 * fitting.length_ms) as u64;
        // After a long effect the board rests, before a channel has driven for its longest time.
        let rest_us = if length_us > LONG_US { 1_000 * u64::from(2 * era_shared::limits::REST_MS) } else { 0 };
        bench.run_until_us(bench.time_us() + length_us.max(NEXT_BURST_US) + rest_us).unwrap();
    }
    bench.run_until_us(bench.time_us() + 100_000).unwrap();
}

/// Starts an effect of either kind as soon as the board can; when that is, in us.
fn start_effect_soon(bench: &mut Bench, design: &EffectDesign, number: u32, name: &str) -> u64 {
    if !design.windows.is_empty() {
        let windows =
            WindowSequence { number, start_us: 0, ..windows_to_wire_sequence_dropping_excess(&design.windows) };
        let reply = bench.send_request(&Request::PlayWindows(windows));
        let Ok(Reply::WindowsPlaying { start_us }) = reply else { panic!("{name}, effect {number}: {reply:?}") };
        return start_us;
    }
    let drives = design.drives_with_board_channels().iter().map(drive_to_wire_zeroing_too_narrow_pulses).collect();
    let prepared = bench.send_request(&Request::Prepare { drives });
    assert!(matches!(prepared, Ok(Reply::Prepared { .. })), "{name}, effect {number}: {prepared:?}");
    let start_us = bench.time_us() + RISE_US;
    for (channel, drive) in (0..).zip(&design.drives) {
        let request = Request::Play { channel, start_us, effect: drive.effect.clone() };
        assert_eq!(bench.send_request(&request).unwrap(), Reply::Playing, "{name}, effect {number}");
    }
    start_us
}

/// With a bias, whose softening is in the springs of the model, an effect's forces are not softened twice: its travel, of which 0.92 may be used, is
/// that of the simulated device. (Before, a panel with fingers went 3 % beyond its limit.)
#[test]
fn the_travel_of_an_effect_with_a_bias_is_that_of_the_device() {
    let scene = Scene::parse("bias", &(random_scene_text(31, 245) + FINGER)).unwrap();
    assert!(scene.actuators.iter().any(|actuator| actuator.softening_n_per_m() > 0.0), "{scene:?}");
    let (x_m, y_m) = (0.4 * scene.surface.length_m, 0.3 * scene.surface.width_m);
    let scene = scene.replace_finger_by_masses_and_supports_at_places(&[(x_m, y_m)]);
    let options = TableOptions { step_hz: 4.0, ..TableOptions::default() };
    let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
    let table = PlanTable::from_levels(&scene, levels, options).unwrap();
    let target = Target { x_m, y_m, intensity_g: Some(1e3) };
    let plan = table.plan(&[target]).unwrap();
    let request = EffectRequest::with_defaults(NamedEffect::DoubleClick);
    let design = design_effect(&table, table.panel_poles().unwrap(), &plan, request).unwrap();
    let mut bench = make_bench(&table, &target);
    let effects: Vec<Effect> = design.drives.iter().map(|drive| drive.effect.clone()).collect();
    play_effects(&mut bench, &design, &effects, 400_000);
    let travels = bench.panel_mut().take_largest_travels_since_last_call();
    for (told_m, travel) in design.travel_m.iter().zip(&travels) {
        let ratio = travel.travel_m / (0.92 * told_m);
        println!("{:.2} um, told {:.2} um for 0.92 of it: {ratio:.3}", 1e6 * travel.travel_m, 1e6 * told_m);
        assert!((0.95..1.03).contains(&ratio), "{ratio}");
    }
}

/// Random panels, with and without fingers, places, strengths and effects, from far too weak to far too strong, for one, two and three fingers, bursts
/// and pushes in quick succession, the same three times or up to six of other places and strengths: on the simulated device, which integrates with gaps as they move, no mass goes beyond a third of its gap.
/// `ERA_CASES=2000 cargo test --release -p era-host --test panels effects::the_travel_of_random -- --nocapture` tries many more.
#[test]
fn the_travel_of_random_effects_stays_within_a_third_of_the_gap() {
    let wanted = std::env::var("ERA_CASES").ok().and_then(|count| count.parse().ok()).unwrap_or(100_u32);
    let effects = [
        NamedEffect::Click,
        NamedEffect::DoubleClick,
        NamedEffect::Click,
        NamedEffect::PulseTrain,
        NamedEffect::Swell,
        NamedEffect::Click,
        NamedEffect::Texture,
    ];
    let (mut tried, mut bursts, mut for_several, mut near, mut furthest) = (0_u32, 0_u32, 0_u32, 0_u32, 0.0_f64);
    let (mut mixed, mut pushes) = (0_u32, 0_u32);
    for number in 0..u64::from(4 * wanted) {
        let with_fingers = number % 2 == 1;
        let text = random_scene_text(31, number) + if with_fingers { FINGER } else { "" };
        let scene = Scene::parse("random", &text).unwrap();
        let place = |k: u64| {
            let at = |step: f64| (0.5 + step * (k + 1) as f64).fract();
            (at(0.754_877_666) * scene.surface.length_m, at(0.569_840_291) * scene.surface.width_m)
        };
        let touched: Vec<(f64, f64)> = (0..=number / 2 % 3).map(|finger| place(6 * number + finger)).collect();
        let scene =
            if with_fingers { scene.replace_finger_by_masses_and_supports_at_places(&touched) } else { scene.clone() };
        let options = TableOptions { step_hz: 4.0, ..TableOptions::default() };
        let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
        let table = PlanTable::from_levels(&scene, levels, options).unwrap();
        // A panel whose poles are not known has no effects.
        let Some(poles) = table.panel_poles() else { continue };
        // Clicks of earlier cases on this panel, which may be played between each other.
        let mut earlier: Vec<EffectDesign> = Vec::new();
        for case in 0..6_u32 {
            let k = 6 * u32::try_from(number).unwrap() + case;
            let g = [0.2, 1.0, 1e3][k as usize % 3];
            let places = if with_fingers {
                touched.clone()
            } else {
                (0..=u64::from(k / 3 % 3)).map(|finger| place(u64::from(k) + 100 * finger)).collect()
            };
            let targets: Vec<Target> =
                places.into_iter().map(|(x_m, y_m)| Target { x_m, y_m, intensity_g: Some(g) }).collect();
            let request = EffectRequest::with_defaults(effects[k as usize % effects.len()]);
            // A place in a cut-out, or one that nothing moves, has none either.
            let Ok(plan) = table.plan(&targets) else { continue };
            let prefer = if case % 2 == 0 { Preference::Strength } else { Preference::Crispness };
            let options = ClickOptions { preference: prefer, ..ClickOptions::default() };
            // Two thirds of the clicks are bursts of windows, one third are pushes with brakes, as older boards play them.
            let design = if k % 3 == 0 {
                design_effect(&table, poles, &plan, request)
            } else {
                design_effect_of_windows_if_common_click_exists_else_of_drives(&table, poles, &plan, request, options)
            };
            let Ok(design) = design else { continue };
            let mut bench = make_bench(&table, &targets[0]);
            let fingers = targets.len();
            let name = format!("panel {number}, case {case}, {:?} of {g} g, {fingers} fingers", request.effect);
            if earlier.is_empty() && design.windows.is_empty() {
                let effects: Vec<Effect> = design.drives.iter().map(|drive| drive.effect.clone()).collect();
                play_effects(&mut bench, &design, &effects, 400_000);
            } else {
                pushes += u32::from(design.windows.is_empty());
                let others = earlier.iter().flat_map(|earlier| [earlier, &design]).take(6);
                let mixture: Vec<&EffectDesign> = others.collect();
                mixed += u32::from(!mixture.is_empty());
                let designs = if mixture.is_empty() { vec![&design; 3] } else { mixture };
                play_effects_in_quick_succession(&mut bench, &table, &designs, &name);
                bursts += u32::from(!design.windows.is_empty());
                for_several += u32::from(fingers > 1);
            }
            let travels = bench.panel_mut().take_largest_travels_since_last_call();
            for (travel, electrodes) in travels.iter().zip(&table.electrodes) {
                let part = travel.travel_m / electrodes.gap_m;
                assert!(!travel.snapped_in && part <= 1.0 / 3.0, "{name}: {part:.4} of the gap");
                furthest = furthest.max(part);
            }
            let is_near = |(travel, own): (&LargestTravel, &Electrodes)| travel.travel_m > own.gap_m / 6.0;
            near += u32::from(travels.iter().zip(&table.electrodes).any(is_near));
            tried += 1;
            earlier.push(design);
            if tried == wanted {
                println!(
                    "{tried} effects: {bursts} bursts of windows and {pushes} pushes in quick succession, {for_several} for several fingers, \
                     {mixed} between others: {furthest:.3} of the gap at most, {near} beyond a sixth"
                );
                assert!(
                    bursts > wanted / 5 && pushes > wanted / 5 && for_several > 0 && mixed > 0 && near > 0,
                    "{bursts} {pushes} {for_several} {mixed} {near}"
                );
                return;
            }
        }
    }
    panic!("only {tried} effects could be designed");
}
