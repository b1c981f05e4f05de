//! Clicks that have been designed before: a key of a keypad is pressed again and again at the same place.

use crate::effects::{DesignError, EffectDesign};
use crate::planner::click::{ClickOptions, Preference};
use crate::planner::{Plan, TargetResult};
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Most clicks that are kept; before another one is added to so many, all are forgotten.
const MOST: usize = 512;

/// What a click depends on besides the panel; numbers by their bits.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct ClickKey {
    /// x and y in m, and what is wanted in g, of every target.
    targets: Vec<[u64; 3]>,
    crisp_s: u64,
    force_fraction: u64,
    prefers_crispness: bool,
    has_figures_for_comparison: bool,
}

impl ClickKey {
    fn new(targets: &[TargetResult], options: ClickOptions) -> Self {
        let list_bits = |own: &TargetResult| [own.x_m, own.y_m, own.wanted_g].map(f64::to_bits);
        Self {
            targets: targets.iter().map(list_bits).collect(),
            crisp_s: options.crisp_s.to_bits(),
            force_fraction: options.force_fraction.to_bits(),
            prefers_crispness: options.preference == Preference::Crispness,
            has_figures_for_comparison: options.with_figures_for_comparison,
        }
    }
}

/// Clicks by what they depend on.
#[derive(Debug, Default)]
pub struct KnownClicks {
    clicks: Mutex<HashMap<ClickKey, EffectDesign>>,
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
        if let Some(known) = self.lock_clicks().get(&key) {
            return Ok(known.clone());
        }
        let made = design()?;
        // What is no burst of windows depends on the plan's drives, too.
        if !made.windows.is_empty() {
            let mut clicks = self.lock_clicks();
            if clicks.len() >= MOST {
                clicks.clear();
            }
            clicks.insert(key, made.clone());
        }
        Ok(made)
    }

    fn lock_clicks(&self) -> MutexGuard<'_, HashMap<ClickKey, EffectDesign>> {
        self.clicks.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{EffectRequest, NamedEffect, design_effect_with_windows};
    use crate::model::{Accuracy, PanelModel};
    use crate::planner::{PlanTable, TableOptions, Target};
    use crate::scene::{EXAMPLE_BAR, Scene};

    #[test]
    fn a_click_is_designed_once_and_again_for_whatever_it_depends_on() {
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let options = TableOptions::default();
        let model = PanelModel::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
        let table = PlanTable::build(&scene, model.reduce(options.to_hz, &[]).unwrap(), options).unwrap();
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
                design_effect_with_windows(&table, table.panel_poles().unwrap(), plan, request, options)
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
            (
                plan(0.06, 0.5),
                ClickOptions { with_figures_for_comparison: !standard.with_figures_for_comparison, ..standard },
            ),
            (plan(0.06, 0.5), ClickOptions { preference: Preference::Crispness, ..standard }),
        ] {
            assert!(ask(&plan, options).1);
            assert!(!ask(&plan, options).1);
        }
    }
}
