//! Clicks that have been designed before: a key of a keypad is pressed again and again at the same place.

use crate::effects::{DesignError, EffectDesign};
use crate::planner::click::{ClickOptions, MAX_STANDING_RAIL_RATIO, Preference};
use crate::planner::{Plan, TargetResult};
use era_shared::supply::RAILS;
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Most clicks that are kept; before another one is added to so many, all are forgotten.
const MOST: usize = 512;

/// Most designs that are kept of one click.
const MOST_OF_ONE: usize = 16;

/// What a click depends on besides the panel; numbers by their bits.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct ClickKey {
    /// x and y in m, and what is wanted in g, of every target.
    targets: Vec<[u64; 3]>,
    crisp_s: u64,
    force_fraction: u64,
    prefers_crispness: bool,
    has_best_possible: bool,
    second_click_after_s: Option<u64>,
}

impl ClickKey {
    fn new(targets: &[TargetResult], options: ClickOptions) -> Self {
        let list_bits = |own: &TargetResult| [own.x_m, own.y_m, own.wanted_g].map(f64::to_bits);
        Self {
            targets: targets.iter().map(list_bits).collect(),
            crisp_s: options.crisp_s.to_bits(),
            force_fraction: options.force_fraction.to_bits(),
            prefers_crispness: options.preference == Preference::Crispness,
            has_best_possible: options.with_best_possible,
            second_click_after_s: options.second_click_after_s.map(f64::to_bits),
        }
    }
}

/// A click that was designed for rails that stood at these voltages in V.
#[derive(Clone, Debug)]
struct KnownClick {
    made_for_v: [f64; RAILS],
    design: EffectDesign,
}

/// Clicks by what they depend on.
#[derive(Debug, Default)]
pub struct KnownClicks {
    /// Of each, the designs for rails that stood at different voltages.
    clicks: Mutex<HashMap<ClickKey, Vec<KnownClick>>>,
}

impl KnownClicks {
    /// The click of single windows for the targets of a plan: that of before, or what `design` makes.
    ///
    /// # Errors
    /// As `design`.
    pub fn get_or_design(
        &self,
        plan: &Plan,
        options: ClickOptions,
        design: impl FnOnce() -> Result<EffectDesign, DesignError>,
    ) -> Result<EffectDesign, DesignError> {
        let key = ClickKey::new(&plan.targets, options);
        let known = self.lock_clicks().get(&key).and_then(|known| {
            choose_design_fitting_rails_unless_redesign_could_fit_better(known, options.standing_rails_v).cloned()
        });
        if let Some(known) = known {
            return Ok(known);
        }
        let made = design()?;
        // What is no burst of windows depends on the plan's drives, too.
        if !made.windows.is_empty() {
            let mut clicks = self.lock_clicks();
            if clicks.len() >= MOST {
                clicks.clear();
            }
            let designs = clicks.entry(key).or_default();
            if designs.len() >= MOST_OF_ONE {
                designs.clear();
            }
            designs.push(KnownClick { made_for_v: options.standing_rails_v, design: made.clone() });
        }
        Ok(made)
    }

    fn lock_clicks(&self) -> MutexGuard<'_, HashMap<ClickKey, Vec<KnownClick>>> {
        self.clicks.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The design that needs no change of the rails from these voltages, or that was made for them; or any, if no other design would spare the change.
fn choose_design_fitting_rails_unless_redesign_could_fit_better(
    designs: &[KnownClick],
    standing_v: [f64; RAILS],
) -> Option<&EffectDesign> {
    let all_used_rails = |design: &EffectDesign, is_fine: &dyn Fn(f64, f64) -> bool| {
        let needed_v = design.find_rail_voltages_v();
        needed_v
            .into_iter()
            .zip(standing_v)
            .all(|(needed_v, standing_v)| needed_v <= 0.0 || is_fine(needed_v, standing_v))
    };
    let are_equal = |a: f64, b: f64| (a - b).abs() < 0.5;
    let stands = |design: &EffectDesign| all_used_rails(design, &are_equal);
    let is_made_for = |made_for_v: &[f64; RAILS]| made_for_v.iter().zip(standing_v).all(|(a, b)| are_equal(*a, b));
    let could_stand = |design: &EffectDesign| {
        all_used_rails(design, &|needed_v, standing_v| {
            (needed_v..=MAX_STANDING_RAIL_RATIO * needed_v).contains(&standing_v)
        })
    };
    let found = designs.iter().find(|known| stands(&known.design));
    let found = found.or_else(|| designs.iter().find(|known| is_made_for(&known.made_for_v)));
    found.or_else(|| designs.iter().find(|known| !could_stand(&known.design))).map(|known| &known.design)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{EffectRequest, NamedEffect, design_effect_of_windows_if_common_click_exists_else_of_drives};
    use crate::model::{Accuracy, PanelModel};
    use crate::planner::{PlanTable, TableOptions, Target};
    use crate::scene::{EXAMPLE_BAR, Scene};

    #[test]
    fn a_click_is_designed_once_and_again_for_whatever_it_depends_on() {
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let options = TableOptions::default();
        let model = PanelModel::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
        let table = PlanTable::build(
            &scene,
            model.reduce_with_residual_shapes_of_actuators_damping_and_points(options.to_hz, &[]).unwrap(),
            options,
        )
        .unwrap();
        let target = |x_m: f64, g: f64| Target { x_m, y_m: 0.01, intensity_g: Some(g) };
        let plan = |x_m: f64, g: f64| table.plan(&[target(x_m, g)]).unwrap();
        let plan_for_two = |other_g: f64| table.plan(&[target(0.06, 0.5), target(0.24, other_g)]).unwrap();
        let clicks = KnownClicks::default();
        let mut designs = 0;
        let mut ask = |plan: &Plan, options: ClickOptions| {
            let before = designs;
            let request = EffectRequest::with_defaults(NamedEffect::Click);
            let design = || {
                designs += 1;
                design_effect_of_windows_if_common_click_exists_else_of_drives(
                    &table,
                    table.panel_poles().unwrap(),
                    plan,
                    request,
                    options,
                )
            };
            let click = clicks.get_or_design(plan, options, design).unwrap();
            (click, designs > before)
        };
        let standard = ClickOptions::default();
        let (first, is_new) = ask(&plan(0.06, 0.5), standard);
        assert!(is_new && !first.windows.is_empty());
        let (again, is_new) = ask(&plan(0.06, 0.5), standard);
        assert!(!is_new && again == first);
        for (plan, options) in [
            (plan(0.061, 0.5), standard),
            (plan(0.06, 0.4), standard),
            (plan_for_two(0.5), standard),
            (plan_for_two(0.4), standard),
            (plan(0.06, 0.5), ClickOptions { crisp_s: 0.05, ..standard }),
            (plan(0.06, 0.5), ClickOptions { force_fraction: 0.5, ..standard }),
            (plan(0.06, 0.5), ClickOptions { with_best_possible: !standard.with_best_possible, ..standard }),
            (plan(0.06, 0.5), ClickOptions { preference: Preference::Crispness, ..standard }),
            (plan(0.06, 0.5), ClickOptions { second_click_after_s: Some(0.12), ..standard }),
            (plan(0.06, 0.5), ClickOptions { second_click_after_s: Some(0.13), ..standard }),
        ] {
            assert!(ask(&plan, options).1);
            assert!(!ask(&plan, options).1);
        }
        // Rails that stand a little higher are left there; from any other voltage they have to change, whatever the design.
        let needed_v = first.find_rail_voltages_v();
        let with_rails =
            |factor: f64| ClickOptions { standing_rails_v: needed_v.map(|volts| (factor * volts).round()), ..standard };
        for (factor, needs_design) in [(1.0, false), (1.2, true), (1.2, false), (1.7, false), (0.8, false)] {
            let (click, is_new) = ask(&plan(0.06, 0.5), with_rails(factor));
            assert_eq!(is_new, needs_design, "rails at {factor} of what is needed");
            let stays = click.find_rail_voltages_v() == with_rails(factor).standing_rails_v;
            assert_eq!(stays, (1.0..=1.2).contains(&factor), "rails at {factor} of what is needed");
        }
    }
}
