//! Clicks of more and more strength at the same place.

use super::build_table;
use era_model::scene::{EXAMPLE_BAR, EXAMPLE_PLATE, STARTING_PLATE};
use era_planner::STANDARD_GRAVITY;
use era_planner::Target;
use era_planner::click::{ClickDesign, ClickOptions, Preference, design_click_windows};
use era_planner::effects::intensity::mode_shape_values_at_point_or_on_bar_axis;
use era_planner::effects::{
    EffectRequest, EffectWindow, NamedEffect, design_effect,
    design_effect_of_windows_if_common_click_exists_else_of_drives,
    sample_acceleration_of_design_unless_undamped_m_per_s2,
};
use era_shared::waveform::{MAX_WINDOWS, Segment};

const WISHES_G: [f64; 9] = [0.1, 0.3, 0.45, 0.5, 0.6, 0.7, 1.0, 2.0, 50.0];

/// Whoever asks for more gets no weaker click, and one that is crisp if a weaker one can be and crispness is preferred; what keeps a click from
/// its wish is named.
#[test]
fn more_is_not_less() {
    for (text, places) in [
        (EXAMPLE_PLATE, [(0.150, 0.100), (0.010, 0.010), (0.0778, 0.0469), (0.1522, 0.0772)]),
        (STARTING_PLATE, [(0.213, 0.038), (0.150, 0.100), (0.031, 0.171), (0.270, 0.110)]),
        (EXAMPLE_BAR, [(0.03, 0.0), (0.11, 0.0), (0.17, 0.0), (0.26, 0.0)]),
    ] {
        let table = build_table(text);
        let poles = table.panel_poles().unwrap();
        for (x_m, y_m) in places {
            let shape = mode_shape_values_at_point_or_on_bar_axis(&table, x_m, y_m);
            for (preference, crisp_s) in
                [(Preference::Crispness, 0.045), (Preference::Crispness, 0.030), (Preference::Strength, 0.045)]
            {
                let options = ClickOptions { preference, crisp_s, ..ClickOptions::default() };
                let design = |wish_g: f64| {
                    design_click_windows(
                        &table,
                        poles,
                        std::slice::from_ref(&shape),
                        &[wish_g * STANDARD_GRAVITY],
                        options,
                    )
                    .unwrap()
                };
                let clicks: Vec<ClickDesign> = WISHES_G.into_iter().map(design).collect();
                let shown = || {
                    let each = |(click, wish): (&ClickDesign, f64)| {
                        let peak_g = click.measures.peak / STANDARD_GRAVITY;
                        format!("{wish} g: {peak_g:.3} g, crisp: {}, limits {:?}", click.is_crisp, click.limits)
                    };
                    let all: Vec<String> = clicks.iter().zip(WISHES_G).map(each).collect();
                    format!("{x_m}, {y_m}, {preference:?}, {crisp_s} s\n{}", all.join("\n"))
                };
                for (i, click) in clicks.iter().enumerate() {
                    let weaker = || clicks.iter().take(i);
                    let strongest = weaker().map(|weaker| weaker.measures.peak).fold(0.0, f64::max);
                    // Weaker clicks are tried in steps of a sixth at most.
                    assert!(click.measures.peak >= 0.85 * strongest, "{}", shown());
                    if preference == Preference::Crispness {
                        assert!(click.is_crisp || !weaker().any(|weaker| weaker.is_crisp), "{}", shown());
                    }
                    let is_short = click.measures.peak < 0.95 * WISHES_G[i] * STANDARD_GRAVITY;
                    assert_eq!(is_short, !click.limits.is_empty(), "{}", shown());
                }
            }
        }
    }
}

/// A finger that rests and feels nothing takes nothing from the click of another one.
#[test]
fn a_finger_without_intensity_does_not_change_a_click() {
    let table = build_table(EXAMPLE_PLATE);
    let poles = table.panel_poles().unwrap();
    let design = |targets: &[Target]| {
        let plan = table.plan(targets).unwrap();
        let request = EffectRequest::with_defaults(NamedEffect::Click);
        design_effect_of_windows_if_common_click_exists_else_of_drives(
            &table,
            poles,
            &plan,
            request,
            ClickOptions::default(),
        )
        .unwrap()
    };
    let clicking = Target { x_m: 0.06, y_m: 0.05, intensity_g: Some(0.3) };
    let resting = Target { x_m: 0.24, y_m: 0.15, intensity_g: Some(0.0) };
    let alone = design(&[clicking]);
    for (targets, place) in [([clicking, resting], 0), ([resting, clicking], 1)] {
        let both = design(&targets);
        assert!(!both.windows.is_empty() && both.windows == alone.windows, "{:?}", both.windows);
        assert_eq!(both.peaks_g[place], alone.peaks_g[0]);
        // The panel moves there, too.
        let other_g = both.peaks_g[1 - place];
        assert!(other_g > 0.01 && other_g < 1.0, "{other_g} g");
    }
}

/// Half the force is 6 dB less sound, also of a click that is made weaker after its design.
#[test]
fn a_weakened_click_is_quieter() {
    let table = build_table(EXAMPLE_PLATE);
    let poles = table.panel_poles().unwrap();
    let plan = table.plan(&[Target { x_m: 0.06, y_m: 0.05, intensity_g: Some(0.3) }]).unwrap();
    let request = EffectRequest::with_defaults(NamedEffect::Click);
    let design = |force_fraction: f64| {
        let options = ClickOptions { force_fraction, ..ClickOptions::default() };
        design_effect_of_windows_if_common_click_exists_else_of_drives(&table, poles, &plan, request, options).unwrap()
    };
    let (whole, half) = (design(1.0), design(0.5));
    let [weakened_db, half_db] =
        [whole.scale_copy_to_force_fraction(0.5), half].map(|design| design.predicted.sound_db.unwrap());
    assert!((weakened_db - half_db).abs() < 0.3, "{weakened_db} {half_db}");
    assert_eq!(whole.scale_copy_to_force_fraction(0.0).predicted.sound_db, None);
}

/// On a board that plays single windows, a double click is one burst twice: all windows of the first click come again after the period, to the
/// tick, no board has to take more than it can, and each click is as strong as requested and crisp.
#[test]
fn a_double_click_of_windows_is_the_same_click_twice() {
    for (text, places, wish_g) in [
        (EXAMPLE_PLATE, [(0.06, 0.05), (0.15, 0.10), (0.1125, 0.0625)], 0.3),
        (EXAMPLE_BAR, [(0.03, 0.0), (0.11, 0.0), (0.22, 0.0)], 0.8),
    ] {
        let table = build_table(text);
        for (x_m, y_m) in places {
            for period_ms in [50.0, 120.0, 500.0] {
                let plan = table.plan(&[Target { x_m, y_m, intensity_g: Some(wish_g) }]).unwrap();
                let request = EffectRequest {
                    period_ms: Some(period_ms),
                    ..EffectRequest::with_defaults(NamedEffect::DoubleClick)
                };
                let design = design_effect_of_windows_if_common_click_exists_else_of_drives(
                    &table,
                    table.panel_poles().unwrap(),
                    &plan,
                    request,
                    ClickOptions::default(),
                )
                .unwrap();
                let (shown, predicted) = (format!("{x_m}, {y_m}, {period_ms} ms: {design:?}"), design.predicted);
                let (first, second) = design.windows.split_at(design.windows.len() / 2);
                assert!(!first.is_empty() && design.windows.len() <= MAX_WINDOWS, "{shown}");
                for (window, again) in first.iter().zip(second) {
                    let moved = EffectWindow { begin_us: window.begin_us + 1e3 * period_ms, ..window.clone() };
                    assert!((moved.begin_us - again.begin_us).abs() < 0.01, "{shown}");
                    assert_eq!(
                        EffectWindow { begin_us: 0.0, ..moved },
                        EffectWindow { begin_us: 0.0, ..again.clone() }
                    );
                }
                assert_eq!(predicted.crisp, Some(true), "{shown}");
                assert!((0.95 * wish_g..1.1 * wish_g).contains(&predicted.peak_g), "{shown}");
                // What is left of the first click is a tenth of it at most.
                assert!((0.85 * wish_g..=predicted.peak_g).contains(&predicted.peak_least_g), "{shown}");
                assert!(predicted.quiet_ms.is_some_and(|ms| (period_ms..=period_ms + 45.0).contains(&ms)), "{shown}");
                assert!(predicted.contrast_db.is_some() && predicted.sound_db.is_some(), "{shown}");
            }
        }
    }
}

/// The figures of a double click are those of its motion, also where the masses may hardly move, where both clicks are weakened because the second one
/// takes a mass further than the first, and of a part of the force.
#[test]
fn figures_of_a_double_click_are_those_of_its_motion() {
    let stopped = EXAMPLE_BAR
        .replace("damping_n_s_per_m = 1.1", "damping_n_s_per_m = 0.3")
        .replace("stop_um = 170.0", "stop_um = 30.0");
    let mut weakened = 0;
    for (text, places, wish_g) in [
        (EXAMPLE_PLATE, [0.06, 0.15, 0.27], 0.3),
        (EXAMPLE_BAR, [0.03, 0.11, 0.2], 1.0),
        (&stopped, [0.02, 0.06, 0.15], 2.0),
    ] {
        let table = build_table(text);
        let poles = table.panel_poles().unwrap();
        for x_m in places {
            for (period_ms, force_fraction) in [(50.0, 1.0), (60.0, 1.0), (60.0, 0.6), (120.0, 1.0)] {
                let plan = table.plan(&[Target { x_m, y_m: 0.01, intensity_g: Some(wish_g) }]).unwrap();
                let double = EffectRequest {
                    period_ms: Some(period_ms),
                    ..EffectRequest::with_defaults(NamedEffect::DoubleClick)
                };
                let options = ClickOptions { force_fraction, ..ClickOptions::default() };
                let design = design_effect_of_windows_if_common_click_exists_else_of_drives(
                    &table, poles, &plan, double, options,
                )
                .unwrap();
                let shown = format!("{x_m}, {period_ms} ms, {force_fraction}: {design:?}");
                let target = &plan.targets[0];
                let shape = mode_shape_values_at_point_or_on_bar_axis(&table, target.x_m, target.y_m);
                let step_s = 1.0 / 16e3;
                let motion =
                    sample_acceleration_of_design_unless_undamped_m_per_s2(&table, poles, &design, &shape, step_s)
                        .unwrap();
                let (first, second) = motion.split_at((1e-3 * period_ms / step_s) as usize);
                let largest_g =
                    |part: &[f64]| part.iter().fold(0.0_f64, |most, x| most.max(x.abs())) / STANDARD_GRAVITY;
                let (first_g, second_g) = (largest_g(first), largest_g(second));
                let predicted = design.predicted;
                assert!((predicted.peak_g / first_g - 1.0).abs() < 0.01, "{first_g} g, {shown}");
                assert!((predicted.peak_least_g / first_g.min(second_g) - 1.0).abs() < 0.01, "{second_g} g, {shown}");
                // The mass that the voltages are lowered for has what travel it may use, and no more.
                for (travel_m, own) in design.travel_m.iter().zip(&table.electrodes) {
                    assert!(*travel_m <= own.max_travel_m(), "{shown}");
                }
                weakened += u32::from(design.limits.iter().any(|limit| limit.code() == "travel"));
                if design.limits.is_empty() {
                    assert!(predicted.peak_g >= 0.95 * force_fraction * wish_g, "{shown}");
                }
            }
        }
    }
    assert!(weakened > 0, "no double click is weakened for its travel");
}

/// The second push of each drive begins at the boundary of its periods that is nearest to the time asked for, however long a push wants to be.
#[test]
fn a_double_click_keeps_its_period() {
    for (text, places) in
        [(EXAMPLE_PLATE, [(0.06, 0.05), (0.15, 0.10)]), (STARTING_PLATE, [(0.213, 0.038), (0.031, 0.171)])]
    {
        let table = build_table(text);
        for (x_m, y_m) in places {
            for (period_ms, intensity_g) in [(50.0, 2.0), (50.0, 0.1), (73.0, 0.5), (120.0, 1.0), (500.0, 0.5)] {
                let plan = table.plan(&[Target { x_m, y_m, intensity_g: Some(intensity_g) }]).unwrap();
                let request = EffectRequest {
                    period_ms: Some(period_ms),
                    ..EffectRequest::with_defaults(NamedEffect::DoubleClick)
                };
                let design = design_effect(&table, table.panel_poles().unwrap(), &plan, request).unwrap();
                for drive in &design.drives {
                    let period = 1e3 / drive.drive.frequency_hz;
                    let length_ms = |segment: &Segment| match segment {
                        Segment::Cycles { count, .. } => f64::from(*count) * period,
                        Segment::Hold { milliseconds, .. } | Segment::Ramp { milliseconds, .. } => {
                            f64::from(*milliseconds)
                        }
                    };
                    let once_ms: f64 = drive.effect.segments.iter().map(length_ms).sum();
                    let second_ms = (once_ms / period - 1e-6).ceil() * period;
                    assert!(
                        (second_ms - period_ms).abs() <= 0.5 * period + 1e-6,
                        "{x_m}, {y_m}, {period_ms} ms, {intensity_g} g: {second_ms} ms, {:?} at {} Hz",
                        drive.effect,
                        drive.drive.frequency_hz
                    );
                }
            }
        }
    }
}

/// A click that finds its rails higher than it needs is as crisp, and hardly weaker, and leaves them there at most places.
#[test]
fn rails_that_stand_higher_change_a_click_little() {
    let (mut kept, mut tried) = (0, 0);
    for text in [EXAMPLE_PLATE, STARTING_PLATE, EXAMPLE_BAR] {
        let table = build_table(text);
        let poles = table.panel_poles().unwrap();
        for place in 0..6_u32 {
            let at = |step: f64| (0.5 + step * f64::from(place + 1)).fract();
            let (x_m, y_m) =
                (at(0.754_877_666) * table.scene.surface.length_m, at(0.569_840_291) * table.scene.surface.width_m);
            let plan = table.plan(&[Target { x_m, y_m, intensity_g: Some(0.3) }]).unwrap();
            let request = EffectRequest::with_defaults(NamedEffect::Click);
            let design = |standing_rails_v: [f64; 2]| {
                let options = ClickOptions { standing_rails_v, ..ClickOptions::default() };
                design_effect_of_windows_if_common_click_exists_else_of_drives(&table, poles, &plan, request, options)
                    .unwrap()
            };
            let own = design([0.0; 2]);
            let needed_v = own.find_rail_voltages_v();
            for factor in [1.05, 1.2, 1.35, 1.45] {
                let standing_v = needed_v.map(|volts| (factor * volts).floor());
                let found = design(standing_v);
                let name = format!("{} at {x_m:.3}, {y_m:.3}, rails {factor} times as high", table.scene.name);
                assert!(
                    found.predicted.crisp >= own.predicted.crisp,
                    "{name}: {:?} {:?}",
                    found.predicted,
                    own.predicted
                );
                assert!(found.predicted.peak_g >= 0.94 * own.predicted.peak_g, "{name}: {} g", found.predicted.peak_g);
                kept += u32::from(found.find_rail_voltages_v() == standing_v);
                tried += 1;
            }
        }
    }
    // Where all of an actuator's force is needed, its rail is as high as it may be, and cannot stand higher.
    println!("{kept} of {tried} keep their rails");
    assert!(3 * kept > tried, "{kept} of {tried}");
}
