//! A panel in time: what a point of it does after drives are switched on.

use super::{
    HarmonicForce, InitialState, MotionQuantity, OutputRows, Propagator, SecondOrderSystem, TimeGrid, TransientError,
};
use crate::model::{Accuracy, ModelError, PanelModel, ReducedModel};
use crate::scene::Scene;
use crate::transient::reduced::ModalSystem;
use nalgebra::{DMatrix, DVector};

/// Coordinates above this frequency follow any force statically, and are left out: their compliance is next to nothing,
/// and they would only make the exponential of a step expensive.
const HIGHEST_HZ: f64 = 200e3;
/// Least steps in a period for its largest acceleration to show: between two of 12 it is at most 1 - cos(pi/12) = 3.4 %
/// higher.
const LEAST_STEPS: f64 = 12.0;

/// Part of the steady peak within which a motion counts as settled.
const SETTLED: f64 = 0.1;
/// Frequencies up to this multiple of the drives' are modelled: switching on excites modes above the drive in proportion to
/// drive over mode frequency.
const SWITCHED_ON: f64 = 10.0;
/// Why a motion has no bound: with the mesh, acceleration after switching on does not settle but gains ever higher modes.
pub const NO_BOUND: &str = "switching a force on excites modes of all frequencies, but the model does not contain the \
    modes above its frequency band; `era response` gives an error bound for the steady state";

/// Most times of a series.
const MOST_TIMES: f64 = 1e6;

/// Why there are no times.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TimesError {
    /// A step that is none.
    #[error("the time step is {value} s, but must be above 0 s")]
    Step {
        /// As given, in s.
        value: f64,
    },
    /// No duration, or one of too many steps.
    #[error("the duration is {value} s, but must be above 0 s and at most {most_s} s ({MOST_TIMES} time steps)")]
    Duration {
        /// As given, in s.
        value: f64,
        /// Most for the step.
        most_s: f64,
    },
}

/// Times from 0 over a duration.
///
/// # Errors
/// [`TimesError`].
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked before")]
pub fn choose_time_grid(duration_s: f64, step_s: f64) -> Result<TimeGrid, TimesError> {
    if !(step_s > 0.0 && step_s.is_finite()) {
        return Err(TimesError::Step { value: step_s });
    }
    let count = (duration_s / step_s + 1e-9).floor() + 1.0;
    if !(duration_s > 0.0 && count <= MOST_TIMES) {
        return Err(TimesError::Duration { value: duration_s, most_s: MOST_TIMES * step_s });
    }
    Ok(TimeGrid { step_s, count: count as usize })
}

/// Why there is no motion of a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// No model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No motion.
    #[error(transparent)]
    Transient(#[from] TransientError),
}

/// One actuator's harmonic force, switched on at t = 0: `force_n` cos(2 pi `frequency_hz` t + `phase_rad`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwitchedForce {
    /// Index in the scene.
    pub actuator: usize,
    /// In Hz.
    pub frequency_hz: f64,
    /// Amplitude in N.
    pub force_n: f64,
    /// In rad.
    pub phase_rad: f64,
}

impl SwitchedForce {
    /// Whether its frequency and force are within what motions are computed for.
    ///
    /// # Errors
    /// [`TransientError::Range`].
    pub fn check_frequency_and_force(&self) -> Result<(), TransientError> {
        let within = |what, value: f64, min: f64, max: f64| {
            if (min..=max).contains(&value) { Ok(()) } else { Err(TransientError::Range { what, value, min, max }) }
        };
        within("frequency in Hz", self.frequency_hz, 1e-3, 20_000.0)?;
        within("force in N", self.force_n, 0.0, 1e6)
    }
}

/// The highest frequency of drives in Hz; 1 without any.
#[must_use]
pub fn highest_drive_frequency_but_at_least_1_hz(drives: &[SwitchedForce]) -> f64 {
    drives.iter().map(|drive| drive.frequency_hz).fold(1.0, f64::max)
}

/// The motion of a scene's point `at` (m) after `drives` are switched on.
///
/// # Errors
/// [`MotionError`].
pub fn compute_motion_after_switch_on(
    scene: &Scene,
    accuracy: Accuracy,
    at: (f64, f64),
    drives: &[SwitchedForce],
    grid: TimeGrid,
) -> Result<PointMotion, MotionError> {
    let modelled_hz = SWITCHED_ON * highest_drive_frequency_but_at_least_1_hz(drives);
    let model = PanelModel::build(scene, accuracy, modelled_hz)?
        .reduce_with_residual_shapes_of_actuators_damping_and_points(modelled_hz, &[at])?;
    Ok(compute_point_motion(&model, &model.shape_deflections_at(at.0, at.1), drives, grid)?)
}

/// A point's motion from rest.
#[derive(Clone, Debug, PartialEq)]
pub struct PointMotion {
    /// Times in s, from 0.
    pub time_s: Vec<f64>,
    /// Displacement in m.
    pub displacement_m: Vec<f64>,
    /// Acceleration in m/s^2.
    pub acceleration_m_per_s2: Vec<f64>,
    /// Peak acceleration of the steady state in m/s^2 (equation 23: the drives' amplitudes added up).
    pub steady_peak_m_per_s2: f64,
}

impl PointMotion {
    /// When it has settled, in s, to a tenth of its steady peak; `None` if it does not in this time, or if there are several
    /// drives: they beat, and a beat's peaks say nothing about settling.
    #[must_use]
    pub fn settling_time_if_single_drive_settles_s(&self, drives: &[SwitchedForce]) -> Option<f64> {
        match drives {
            [drive] => self.settling_time_of_period_peaks_if_settled_and_resolved_s(drive.frequency_hz, SETTLED),
            _ => None,
        }
    }

    /// When a single drive's motion has settled, in s: from there on the largest acceleration of every period is within
    /// `tolerance_fraction` of the steady one. `None` if it does not settle in this time, or if periods have too few steps to tell.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    pub fn settling_time_of_period_peaks_if_settled_and_resolved_s(
        &self,
        frequency_hz: f64,
        tolerance_fraction: f64,
    ) -> Option<f64> {
        let step_s = self.time_s.get(1)?;
        let steps = (1.0 / (frequency_hz * step_s)).ceil();
        if steps < LEAST_STEPS {
            return None;
        }
        let periods = self.acceleration_m_per_s2.chunks_exact(steps as usize);
        let is_steady = |period: &[f64]| {
            let peak = period.iter().fold(0.0_f64, |most, a| most.max(a.abs()));
            (peak - self.steady_peak_m_per_s2).abs() <= tolerance_fraction * self.steady_peak_m_per_s2
        };
        let settled = periods.clone().rev().take_while(|period| is_steady(period)).count();
        let first = periods.len() - settled;
        if settled == 0 { None } else { self.time_s.get(first * steps as usize).copied() }
    }

    /// Largest acceleration in m/s^2.
    #[must_use]
    pub fn largest_acceleration_over_time_m_per_s2(&self) -> f64 {
        self.acceleration_m_per_s2.iter().fold(0.0, |most, a| most.max(a.abs()))
    }
}

/// The motion of the point whose mode shapes are `shape`. Hysteretic damping counts as the viscous damping that loses as
/// much at each mode's own resonance ([`ModalSystem::from_reduced_with_equivalent_viscous_damping`]).
///
/// # Errors
/// [`TransientError`]: numbers out of range, or a drive at an undamped resonance, whose steady state has no bound.
pub fn compute_point_motion(
    model: &ReducedModel,
    shape: &DVector<f64>,
    drives: &[SwitchedForce],
    grid: TimeGrid,
) -> Result<PointMotion, TransientError> {
    let modal = ModalSystem::from_reduced_with_equivalent_viscous_damping(model);
    let highest = (std::f64::consts::TAU * HIGHEST_HZ).powi(2);
    // Ascending, so what is kept comes first.
    let n = modal.lambda.iter().filter(|lambda| **lambda <= highest).count();
    let system = SecondOrderSystem {
        m: DMatrix::identity(n, n),
        c: modal.damping.view((0, 0), (n, n)).into_owned(),
        k: DMatrix::from_diagonal(&modal.lambda.rows(0, n).into_owned()),
    };
    let row = DMatrix::from_fn(1, n, |_, j| shape[j]);
    let forces: Vec<HarmonicForce> = drives
        .iter()
        .map(|drive| HarmonicForce {
            omega_rad_s: std::f64::consts::TAU * drive.frequency_hz,
            phase_rad: drive.phase_rad,
            force_n: DVector::from_fn(n, |i, _| modal.force[(i, drive.actuator)] * drive.force_n),
        })
        .collect();
    let propagator = Propagator::new(&system, grid)?;
    let rest = InitialState { displacement: DVector::zeros(n), velocity: DVector::zeros(n) };
    let series = |quantity| -> Result<Vec<f64>, TransientError> {
        Ok(propagator
            .compute_motion_under_harmonics_row_per_time(&rest, &forces, OutputRows::Rows(&row), quantity)?
            .column(0)
            .iter()
            .copied()
            .collect())
    };
    let mut steady_peak_m_per_s2 = 0.0;
    for force in &forces {
        let amplitude = (&row * propagator.solve_steady_amplitudes(force)?.map(|z| z.re))[0]
            .hypot((&row * propagator.solve_steady_amplitudes(force)?.map(|z| z.im))[0]);
        steady_peak_m_per_s2 += amplitude * force.omega_rad_s * force.omega_rad_s;
    }
    #[expect(clippy::cast_precision_loss, reason = "at most 1e7 times")]
    let time_s = (0..grid.count).map(|i| i as f64 * grid.step_s).collect();
    Ok(PointMotion {
        time_s,
        displacement_m: series(MotionQuantity::Displacement)?,
        acceleration_m_per_s2: series(MotionQuantity::Acceleration)?,
        steady_peak_m_per_s2,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Accuracy, PanelModel};
    use crate::response;
    use crate::scene::{STARTING_PLATE, Scene};

    /// After long enough the motion is the response's, which is computed in another way and with hysteretic damping.
    #[test]
    fn motion_settles_to_the_response() {
        let scene = Scene::parse("plate", STARTING_PLATE).unwrap();
        let model = PanelModel::build(&scene, Accuracy::FAST, 150.0)
            .unwrap()
            .reduce_with_residual_shapes_of_actuators_damping_and_points(150.0, &[])
            .unwrap();
        let shape = model.shape_deflections_at(0.1, 0.06);
        let hz = 126.0;
        let drive =
            SwitchedForce { actuator: 0, frequency_hz: hz, force_n: 0.1, phase_rad: -std::f64::consts::FRAC_PI_2 };
        let motion = compute_point_motion(&model, &shape, &[drive], TimeGrid { step_s: 1e-4, count: 20_001 }).unwrap();
        let curve = response::compute_acceleration_curves_per_newton(&model, &shape, &[hz]).unwrap();
        let expected = 0.1 * curve[0][0].norm();
        assert!(
            (motion.steady_peak_m_per_s2 / expected - 1.0).abs() < 0.01,
            "{} {expected}",
            motion.steady_peak_m_per_s2
        );
        let late = motion.acceleration_m_per_s2[18_000..].iter().fold(0.0_f64, |most, a| most.max(a.abs()));
        assert!((late / motion.steady_peak_m_per_s2 - 1.0).abs() < 0.01, "{late}");
        let settled = motion.settling_time_of_period_peaks_if_settled_and_resolved_s(hz, 0.1).unwrap();
        assert!(settled > 0.005 && settled < 1.0, "{settled}");
        assert!(motion.displacement_m[0].abs() < 1e-15);
    }
}
