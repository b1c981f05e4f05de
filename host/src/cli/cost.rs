//! What a computation will take, told before it begins.
//!
//! The time goes into the modes: block Lanczos orthogonalises s vectors over n unknowns, 8 n s^2 operations as it does so
//! twice, and its checks are eigenvalue problems of s, some 25 s^3 in all; s is 2.2 times the modes, and some. That is for every
//! level of the ladder. The speed is this machine's, measured on a product like those of Lanczos. How many levels a
//! tolerance takes is not known before, so that one digit is all that is said of the time.

#![expect(clippy::cast_precision_loss, reason = "estimates")]

use crate::model::levels::ReducedLevels;
use crate::model::panel::are_more_residual_shapes_cheaper_than_modes_below;
use crate::model::sections::WaveRigidities;
use crate::model::{Accuracy, ModelError};
use crate::planner::TableOptions;
use crate::planner::table::SurfaceGrid;
use crate::scene::{Scene, SurfaceDamping, SurfaceKind};
use nalgebra::DMatrix;
use std::f64::consts::{PI, TAU};
use std::fmt;
use std::time::{Duration, Instant};

/// Lanczos vectors for each mode.
const VECTORS_PER_MODE: f64 = 2.2;
/// Vectors of an iteration besides.
const LEAST_VECTORS: f64 = 16.0;
/// Modes are asked for a little beyond the frequency, to compare levels.
const BEYOND_MODES: f64 = 1.3;
/// Reduced models have modes up to this multiple of the frequency, at the order that usually meets the tolerance.
const BEYOND_REDUCED: f64 = 3.0;
/// Unknowns of the levels, over those of the finest: orders 7 and 9.
const LEVELS: [f64; 2] = [0.57, 1.0];
/// Residual shapes of a force or a dashpot.
const RESIDUALS: usize = 2;
/// Operations for an entry of a plan table besides those that go with modes and points: harmonics, limits, travel.
const PER_ENTRY: f64 = 2e6;
/// What any machine does in much less than a second: not worth measuring its speed for.
const SMALL: f64 = 2e8;

/// An expected effort.
#[derive(Clone, Debug, PartialEq)]
pub struct Cost {
    unknowns: f64,
    modes: f64,
    /// Frequencies and points of responses, if any.
    responses: Option<(usize, usize)>,
    operations: f64,
}

impl Cost {
    /// Of all modes up to `max_hz`; nothing is expected where the time is what was asked for.
    ///
    /// # Errors
    /// [`ModelError`]: what cannot be meshed, which the computation would end with too.
    pub fn estimate_for_modes_unless_time_limited(
        scene: &Scene,
        accuracy: Accuracy,
        max_hz: f64,
    ) -> Result<Option<Self>, ModelError> {
        if accuracy.time_limit().is_some() {
            return Ok(None);
        }
        Self::new(scene, accuracy, max_hz, BEYOND_MODES).map(Some)
    }

    /// Of responses to every actuator at so many frequencies up to `max_hz`, at so many points, by every level.
    ///
    /// # Errors
    /// As [`Cost::estimate_for_modes_unless_time_limited`].
    pub fn estimate_for_responses_unless_time_limited(
        scene: &Scene,
        accuracy: Accuracy,
        max_hz: f64,
        (frequency_count, point_count): (usize, usize),
    ) -> Result<Option<Self>, ModelError> {
        if accuracy.time_limit().is_some() {
            return Ok(None);
        }
        let mut cost =
            Self::new(scene, accuracy, max_hz, limit_of_reduced_model_modes_as_multiple_of_max_hz(scene, max_hz))?;
        cost.operations += LEVELS.len() as f64 * cost.count_sweep_operations(scene, frequency_count, point_count);
        Ok(Some(Self { responses: Some((frequency_count, point_count)), ..cost }))
    }

    /// Of a plan table.
    ///
    /// # Errors
    /// As [`Cost::estimate_for_modes_unless_time_limited`].
    pub fn estimate_for_table(scene: &Scene, accuracy: Accuracy, options: TableOptions) -> Result<Self, ModelError> {
        let mut cost = Self::new(
            scene,
            accuracy,
            options.to_hz,
            limit_of_reduced_model_modes_as_multiple_of_max_hz(scene, options.to_hz),
        )?;
        let (frequencies, points) = (options.frequencies_hz().len(), SurfaceGrid::count_points(scene, options.to_hz));
        let entries = (frequencies * scene.actuators.len()) as f64;
        cost.operations += cost.count_sweep_operations(scene, frequencies, points) + PER_ENTRY * entries;
        Ok(Self { responses: Some((frequencies, points)), ..cost })
    }

    fn new(scene: &Scene, accuracy: Accuracy, max_hz: f64, beyond: f64) -> Result<Self, ModelError> {
        let unknowns = ReducedLevels::estimate_unknown_count_of_finest_level(scene, accuracy, max_hz)?;
        let vectors = VECTORS_PER_MODE * estimate_mode_count(scene, beyond * max_hz) + LEAST_VECTORS;
        let level = |part: f64| {
            let (n, s) = (part * unknowns, vectors.min(part * unknowns));
            8.0 * n * s * s + 25.0 * s.powi(3)
        };
        let operations = LEVELS.into_iter().map(level).sum();
        Ok(Self { unknowns, modes: estimate_mode_count(scene, max_hz), responses: None, operations })
    }

    /// Operations of responses by one level: coordinates at every frequency, and two real products over the points.
    fn count_sweep_operations(&self, scene: &Scene, frequencies: usize, points: usize) -> f64 {
        let (actuators, loads) = (scene.actuators.len() as f64, (scene.actuators.len() + scene.supports.len()) as f64);
        let coordinates = BEYOND_REDUCED * self.modes + RESIDUALS as f64 * loads;
        // Complex matrices where damping couples all modes, a few couplings otherwise.
        let solution = if matches!(scene.surface.damping, SurfaceDamping::ModalRatio(_)) {
            8.0 / 3.0 * coordinates.powi(3)
        } else {
            8.0 * coordinates * loads.powi(2)
        };
        frequencies as f64 * (solution + 4.0 * actuators * coordinates * points as f64)
    }

    /// How long this machine takes for it; measures its speed first, which takes some milliseconds, unless it is little.
    #[must_use]
    pub fn estimate_time_measuring_machine_speed_if_large(&self) -> Duration {
        let speed = if self.operations > SMALL { measure_operations_per_s() } else { SMALL };
        // More than a year of seconds is no help to anybody.
        Duration::from_secs_f64((self.operations / speed).min(1e9))
    }
}

impl fmt::Display for Cost {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            out,
            "about {:.0} unknowns, {:.0} modes",
            round_to_significant_digits_or_integer_if_below_one(self.unknowns, 2),
            round_to_significant_digits_or_integer_if_below_one(self.modes, 2)
        )?;
        if let Some((frequencies, points)) = self.responses {
            write!(out, ", {frequencies} frequencies")?;
            if points > 1 {
                write!(out, ", {points} points")?;
            }
        }
        Ok(())
    }
}

/// A time in words, to one digit.
#[must_use]
pub fn describe_duration_rounded_to_one_digit(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    match seconds {
        s if s < 1.5 => "a second".into(),
        s if s < 95.0 => format!("{:.0} s", round_to_significant_digits_or_integer_if_below_one(s, 1)),
        s if s < 5400.0 => format!("{:.0} min", round_to_significant_digits_or_integer_if_below_one(s / 60.0, 1)),
        s => format!("{:.0} h", round_to_significant_digits_or_integer_if_below_one(s / 3600.0, 1)),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a power of ten")]
fn round_to_significant_digits_or_integer_if_below_one(value: f64, digits: i32) -> f64 {
    if value < 1.0 {
        return value.round();
    }
    let unit = 10_f64.powi(value.log10().floor() as i32 + 1 - digits);
    (value / unit).round() * unit
}

/// How far a reduced model's modes go, as a multiple of the highest frequency.
fn limit_of_reduced_model_modes_as_multiple_of_max_hz(scene: &Scene, max_hz: f64) -> f64 {
    BEYOND_REDUCED * if are_more_residual_shapes_cheaper_than_modes_below(scene, max_hz) { 0.5 } else { 1.0 }
}

/// About how many modes a panel has below a frequency, by Weyl's law with the term of free edges: a plate A k^2 / (4 pi) +
/// (L + W) k / pi for the wavenumber k, a bar L k / pi. Counted: 86 of 83 and 153 of 155 on a strip of 2 x 0.02 m.
fn estimate_mode_count(scene: &Scene, max_hz: f64) -> f64 {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let wavenumber =
        (TAU * max_hz).sqrt() / WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene).mean.powf(0.25);
    match scene.surface.kind {
        SurfaceKind::Plate => wavenumber * (length * width * wavenumber / 4.0 + (length + width)) / PI,
        SurfaceKind::Bar => length * wavenumber / PI,
    }
}

/// Operations per second in a product like those of Lanczos: some hundred vectors by a block of four.
fn measure_operations_per_s() -> f64 {
    const SIZE: (usize, usize, usize) = (1500, 64, 4);
    let space = DMatrix::from_fn(SIZE.0, SIZE.1, |i, j| (i + j) as f64);
    let block = DMatrix::from_fn(SIZE.0, SIZE.2, |i, j| (i * j) as f64);
    let least = (0..8).map(|_| {
        let started = Instant::now();
        let product = &block - &space * space.tr_mul(&block);
        std::hint::black_box(product);
        started.elapsed().as_secs_f64()
    });
    let operations = (4 * SIZE.0 * SIZE.1 * SIZE.2) as f64;
    operations / least.fold(f64::INFINITY, f64::min).max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::compute_modes_with_error_bounds;
    use crate::scene::{EXAMPLE_BAR, STARTING_PLATE};

    #[test]
    fn times_have_one_digit() {
        let of = |seconds: f64| describe_duration_rounded_to_one_digit(Duration::from_secs_f64(seconds));
        for (seconds, text) in [
            (0.2, "a second"),
            (3.4, "3 s"),
            (9.7, "10 s"),
            (44.0, "40 s"),
            (94.0, "90 s"),
            (170.0, "3 min"),
            (3000.0, "50 min"),
            (20_000.0, "6 h"),
        ] {
            assert_eq!(of(seconds), text);
        }
    }

    /// Against a count: what is said of the modes and the unknowns is of the right size.
    #[test]
    fn modes_and_unknowns_are_about_right() {
        for (text, max_hz) in [(STARTING_PLATE, 1500.0), (EXAMPLE_BAR, 5000.0)] {
            let scene = Scene::parse("example", text).unwrap();
            let cost = Cost::estimate_for_modes_unless_time_limited(&scene, Accuracy::FAST, max_hz).unwrap().unwrap();
            let found = compute_modes_with_error_bounds(&scene, Accuracy::FAST, max_hz).unwrap();
            let (modes, unknowns) = (found.answer.len() as f64, found.model.count_unknowns() as f64);
            assert!((cost.modes / modes).ln().abs() < 0.4, "{} {modes}", cost.modes);
            assert!((cost.unknowns / unknowns).ln().abs() < 0.8, "{} {unknowns}", cost.unknowns);
        }
    }

    #[test]
    fn more_costs_more() {
        let scene = Scene::parse("plate", STARTING_PLATE).unwrap();
        let modes = |max_hz: f64| {
            Cost::estimate_for_modes_unless_time_limited(&scene, Accuracy::BALANCED, max_hz)
                .unwrap()
                .unwrap()
                .operations
        };
        assert!(modes(4000.0) > 10.0 * modes(1000.0));
        let sweep = |size: (usize, usize)| {
            Cost::estimate_for_responses_unless_time_limited(&scene, Accuracy::BALANCED, 400.0, size).unwrap().unwrap()
        };
        assert!(sweep((361, 10_000)).operations > 5.0 * sweep((361, 1000)).operations);
        assert!(sweep((361, 1)).to_string().ends_with("361 frequencies"));
        assert!(sweep((361, 1617)).to_string().ends_with("361 frequencies, 1617 points"));
        assert!(Cost::estimate_for_modes_unless_time_limited(&scene, Accuracy::BALANCED, 1e9).is_err());
        assert_eq!(
            Cost::estimate_for_modes_unless_time_limited(
                &scene,
                Accuracy::best_within_time(Duration::from_secs(1)),
                400.0
            ),
            Ok(None)
        );
    }
}
