//! Random touches on random panels: how often prediction and simulation agree, and why not where they do not.

use super::scenes::{Random, random_scene};
use super::{Comparison, VerifyError, compare};
use crate::device::sim::Panel;
use crate::model::bounded::Levels;
use crate::model::{Accuracy, ModelError};
use crate::planner::{PlanTable, TableOptions, Target};
use crate::response::ResponseError;
use crate::scene::{Scene, SceneError};
use serde::Serialize;

/// Difference that passes beyond the plan's own error bound.
pub const ALLOWED: f64 = 0.02;
/// Intensities asked for, as powers of ten of g: gently up to what no panel does, so that the limits are met.
const INTENSITIES: (f64, f64) = (-1.5, 1.5);
/// Part of the gap beyond which the planner's limit is broken.
const TRAVEL: f64 = 1.0 / 3.0;
/// Motion left of switching on, as a part of the peak, that may matter.
const UNSETTLED: f64 = 2e-3;
/// Frequencies in Hz that the record of 1 s does not tell apart.
const TOGETHER_HZ: f64 = 2.0;
/// Highest harmonic that may fall on another drive.
const HARMONICS: [u32; 5] = [3, 5, 7, 9, 11];

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
    /// No steady motion to compare.
    NotCompared {
        /// Why.
        reason: String,
    },
}

impl Trial {
    /// The figures, if it was compared.
    #[must_use]
    pub fn comparison(&self) -> Option<&Comparison> {
        match &self.outcome {
            Outcome::Compared { comparison, .. } => Some(comparison),
            Outcome::NotCompared { .. } => None,
        }
    }

    /// Why it is outside, if it is.
    #[must_use]
    pub fn outlier(&self) -> Option<&str> {
        match &self.outcome {
            Outcome::Compared { reason, .. } => reason.as_deref(),
            Outcome::NotCompared { .. } => None,
        }
    }
}

/// The text of a scene of the sequence.
#[must_use]
pub fn scene_text(seed: u64, scene: u64) -> String {
    random_scene(&mut Random::new(seed, scene), &format!("random {seed}.{scene}"))
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
    for _ in 0..options.touches {
        let x_m = random.unit() * scene.surface.length_m;
        let y_m = random.unit() * scene.surface.width_m;
        let intensity_g = random.decades(INTENSITIES.0, INTENSITIES.1);
        let outcome = match compare(&table, &panel, Target { x_m, y_m, intensity_g: Some(intensity_g) }) {
            Ok(comparison) => {
                let reason = (!within(&comparison)).then(|| reason(&comparison));
                Outcome::Compared { comparison: Box::new(comparison), reason }
            }
            Err(error @ (VerifyError::Device(_) | VerifyError::Plan(_))) => return Err(error.into()),
            Err(error) => Outcome::NotCompared { reason: short(&error) },
        };
        trials.push(Trial { scene: number, intensity_g, outcome });
    }
    Ok(trials)
}

fn short(error: &VerifyError) -> String {
    match error {
        VerifyError::NeverSettles => "no steady state within the longest burst".into(),
        error => error.to_string(),
    }
}

/// Whether the simulated peak is within the plan's error bound and [`ALLOWED`] of the predicted one.
#[must_use]
pub fn within(comparison: &Comparison) -> bool {
    comparison.difference.abs() <= allowed(comparison)
}

fn allowed(comparison: &Comparison) -> f64 {
    comparison.error_bound.unwrap_or(0.0) + ALLOWED
}

/// What the figures give as the reason for a difference.
fn reason(comparison: &Comparison) -> String {
    if let Some(travel) = comparison.travel.iter().find(|travel| travel.snapped_in) {
        return format!("{} snaps in", travel.actuator);
    }
    if let Some(difference) = comparison.causal_difference.filter(|difference| difference.abs() <= allowed(comparison))
    {
        return format!(
            "the loss factor's viscous stand-in in time: {:+.2} % from the prediction with that damping",
            difference * 100.0
        );
    }
    if comparison.simulated_travel() > TRAVEL {
        return format!("travel of {:.2} of the gap, beyond a third", comparison.simulated_travel());
    }
    if comparison.unsettled > UNSETTLED {
        return format!("not settled in the longest burst: up to {:.2} % left", comparison.unsettled * 100.0);
    }
    let drives = &comparison.drives;
    for drive in drives {
        for other in drives.iter().filter(|other| other.actuator != drive.actuator) {
            let meets = |hz: f64| (hz - other.frequency_hz).abs() < TOGETHER_HZ;
            if let Some(n) = HARMONICS.iter().find(|n| meets(f64::from(**n) * drive.frequency_hz)) {
                return format!("harmonic {n} of {} is at the frequency of {}", drive.actuator, other.actuator);
            }
            for third in drives.iter().filter(|third| third.actuator != other.actuator) {
                let sums =
                    [2.0 * drive.frequency_hz - third.frequency_hz, 2.0 * drive.frequency_hz + third.frequency_hz];
                if third.actuator != drive.actuator && sums.iter().any(|hz| meets(hz.abs())) {
                    return format!(
                        "the spring of {}, pulsating at twice its frequency, takes the motion of {} to the frequency of {}",
                        drive.actuator, third.actuator, other.actuator
                    );
                }
            }
        }
    }
    "none of the known ones".into()
}
