//! Clicks of more and more strength at the same place.

use super::build_table;
use era_model::scene::{EXAMPLE_BAR, EXAMPLE_PLATE, STARTING_PLATE};
use era_planner::STANDARD_GRAVITY;
use era_planner::click::{ClickDesign, ClickOptions, Preference, design_click_windows};
use era_planner::effects::intensity::mode_shape_values_at_point_or_on_bar_axis;

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
