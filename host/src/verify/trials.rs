//! Random touches on random panels: how often prediction and simulation agree, and why not where they do not.

use super::{Comparison, VerifyError, compare};
use crate::device::sim::{Panel, STEP_S};
use crate::model::levels::Levels;
use crate::model::{Accuracy, ModelError};
use crate::planner::{PlanTable, TableOptions, Target};
use crate::response::ResponseError;
use crate::scene::random::{Random, scene_text};
use crate::scene::{Scene, SceneError};
use serde::Serialize;

/// Difference that passes beyond the plan's own error bound.
pub const ALLOWED: f64 = 0.02;
/// Intensities asked for, as powers of ten of g: gently up to what no panel does, so that the limits are met.
const INTENSITIES: (f64, f64) = (-1.5, 1.5);
/// Largest error bound that is given way to: beyond it a bound says little more than that the place hardly moves, and
/// agreement within it proves nothing.
pub const LARGEST_BOUND: f64 = 0.2;
/// Difference between the plan's own figure and the one that is worked out here from then on they count as two.
pub const SAME: f64 = 0.005;
/// Part of the gap beyond which the planner's limit is broken: a third, and the few thousandths that the steps of the simulation
/// and the rounding of registers make of it.
const TRAVEL: f64 = 1.005 / 3.0;
/// Parts of the simulation's step with which outliers are simulated once more.
const FINER: f64 = 8.0;

/// What is tried.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// First number of the random sequences; each scene has its own.
    pub seed: u64,
    /// Touches on each scene.
    pub touches: u32,
    /// Of the models.
    pub accuracy: Accuracy,
}

/// Why there are no touches on a scene.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// Not a scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// No model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No response.
    #[error(transparent)]
    Response(#[from] ResponseError),
    /// No plan or no device.
    #[error(transparent)]
    Verify(#[from] VerifyError),
}

/// One touch.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// Of the scene, from 0.
    pub scene: u64,
    /// Of the touch on it, from 0.
    pub touch: u32,
    /// Where, in mm.
    pub x_mm: f64,
    /// Where, in mm.
    pub y_mm: f64,
    /// Asked for, in g.
    pub intensity_g: f64,
    /// What came of it.
    pub outcome: Outcome,
}

/// What came of a touch.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Both figures, and, if they differ by more than is allowed, why.
    Compared {
        /// The figures.
        #[serde(flatten)]
        comparison: Box<Comparison>,
        /// The reason for an outlier.
        reason: Option<String>,
    },
    /// No steady motion to compare, for a reason that the plan does not deny.
    NotCompared {
        /// Why.
        reason: String,
    },
    /// The planner has no plan.
    NoPlan {
        /// What it says.
        reason: String,
    },
    /// There is a plan, and it cannot be: the device refuses it, or what moves under it has no steady motion. Counts as one
    /// that is not within what is allowed.
    Failed {
        /// Why.
        reason: String,
    },
}

/// How a comparison counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Within the plan's error bound and [`ALLOWED`].
    Within,
    /// Not, or a mass has gone further than a plan may take it.
    Outside,
    /// The plan's error bound is above [`LARGEST_BOUND`]: counted apart.
    BoundTooLarge,
}

impl Trial {
    /// The figures, if it was compared.
    #[must_use]
    pub fn comparison(&self) -> Option<&Comparison> {
        match &self.outcome {
            Outcome::Compared { comparison, .. } => Some(comparison),
            _ => None,
        }
    }

    /// Why it is outside, if it is.
    #[must_use]
    pub fn outlier(&self) -> Option<&str> {
        match &self.outcome {
            Outcome::Compared { reason, .. } => reason.as_deref(),
            Outcome::Failed { reason } => Some(reason),
            Outcome::NotCompared { .. } | Outcome::NoPlan { .. } => None,
        }
    }
}

/// All touches on one scene of the sequence: places, intensities, plans, simulations.
///
/// # Errors
/// [`TrialError`] where there is none because of the scene or the device.
pub fn try_scene(options: &Options, scene: u64) -> Result<Vec<Trial>, TrialError> {
    let number = scene;
    let scene = Scene::parse("random", &scene_text(options.seed, number))?;
    let grid = TableOptions::default();
    let levels = Levels::build(&scene, options.accuracy, grid.to_hz)?;
    let table = PlanTable::with_levels(&scene, levels, grid)?;
    let panel = Panel::of(&table);
    let mut random = Random::new(options.seed, !number);
    let mut trials = Vec::new();
    for touch in 0..options.touches {
        let x_m = random.unit() * scene.surface.length_m;
        let y_m = random.unit() * scene.surface.width_m;
        let intensity_g = random.decades(INTENSITIES.0, INTENSITIES.1);
        let target = Target { x_m, y_m, intensity_g: Some(intensity_g) };
        let outcome = match compare(&table, &panel, target) {
            Ok(comparison) => {
                let finer = || compare(&table, &Panel::of_with_step(&table, STEP_S / FINER), target).ok();
                let reason = (verdict(&comparison) == Verdict::Outside).then(|| reason(&comparison, finer));
                Outcome::Compared { comparison: Box::new(comparison), reason }
            }
            Err(error) => not_compared(&error),
        };
        trials.push(Trial { scene: number, touch, x_mm: x_m * 1e3, y_mm: y_m * 1e3, intensity_g, outcome });
    }
    Ok(trials)
}

fn not_compared(error: &VerifyError) -> Outcome {
    match error {
        VerifyError::NeverSettles => Outcome::NotCompared { reason: "no steady state within the longest burst".into() },
        VerifyError::Nothing => Outcome::NotCompared { reason: error.to_string() },
        VerifyError::Plan(error) => Outcome::NoPlan { reason: error.to_string() },
        VerifyError::NotSafe(_) | VerifyError::Device(_) | VerifyError::Response(_) | VerifyError::Unknown => {
            Outcome::Failed { reason: error.to_string() }
        }
    }
}

/// Whether the simulated peak is within the plan's error bound and [`ALLOWED`] of the one that the plan states, and no mass has
/// gone beyond a third of its gap.
#[must_use]
pub fn verdict(comparison: &Comparison) -> Verdict {
    if goes_too_far(comparison) {
        return Verdict::Outside;
    }
    if comparison.error_bound.is_some_and(|bound| bound > LARGEST_BOUND) {
        return Verdict::BoundTooLarge;
    }
    if comparison.difference.abs() <= allowed(comparison) { Verdict::Within } else { Verdict::Outside }
}

/// Whether a mass has gone beyond a third of its gap, which no plan may take it.
#[must_use]
pub fn goes_too_far(comparison: &Comparison) -> bool {
    comparison.simulated_travel() > TRAVEL || comparison.travel.iter().any(|travel| travel.snapped_in)
}

/// Relative difference that passes; a plan without a bound gets none.
fn allowed(comparison: &Comparison) -> f64 {
    comparison.error_bound.unwrap_or(0.0) + ALLOWED
}

/// The reason for a difference, as far as it can be tested: what was seen in the simulation, or the first thing that,
/// taken into the prediction, brings it within what is allowed.
fn reason(comparison: &Comparison, finer: impl FnOnce() -> Option<Comparison>) -> String {
    if let Some(travel) = comparison.travel.iter().find(|travel| travel.snapped_in) {
        return format!("{} snaps in", travel.actuator);
    }
    if goes_too_far(comparison) {
        return format!("travel of {:.3} of the gap, beyond a third", comparison.simulated_travel());
    }
    let steps = [
        (comparison.rounded_g, "voltages and frequencies as the board's registers round them"),
        (comparison.achieved_g, "the harmonics' motion, which closes the gaps further"),
        (comparison.causal_g, "the viscous damping that stands in for the loss factor in time"),
        (comparison.kept_g, "the modes above 200 kHz, which the simulation leaves out"),
    ];
    let of = |predicted_g: f64| (comparison.simulated_g - predicted_g) / predicted_g.max(f64::MIN_POSITIVE);
    if let Some((predicted_g, what)) =
        steps.iter().find(|(predicted_g, _)| of(*predicted_g).abs() <= allowed(comparison))
    {
        return format!("{what}: {:+.2} % from the prediction with that", of(*predicted_g) * 100.0);
    }
    // Where a place hardly moves, what a step leaves of motions at its own frequency is not small beside it.
    if let Some(finer) = finer().filter(|finer| finer.difference.abs() <= allowed(comparison)) {
        return format!("the simulation's own steps: {:+.2} % with an eighth of them", finer.difference * 100.0);
    }
    let left = of(comparison.kept_g).abs() - allowed(comparison);
    if comparison.coinciding >= left {
        return format!(
            "harmonics, or sums and differences of frequencies, at a drive's own frequency: up to {:.2} %",
            comparison.coinciding * 100.0
        );
    }
    if comparison.unsettled >= left {
        return format!("not settled in the longest burst: up to {:.2} % left", comparison.unsettled * 100.0);
    }
    "none of the known ones".into()
}
