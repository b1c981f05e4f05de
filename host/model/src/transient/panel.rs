//! A panel in time: what a point of it does after drives are switched on.

use super::{Harmonic, Initial, Outputs, Propagator, Quantity, SecondOrder, TimeGrid, TransientError};
use crate::model::ReducedModel;
use crate::transient::reduced::ModalSystem;
use nalgebra::{DMatrix, DVector};

/// Coordinates above this frequency follow any force statically, and are left out: their compliance is next to nothing,
/// and they would only make the exponential of a step expensive.
const HIGHEST_HZ: f64 = 200e3;
/// Least steps in a period for its largest acceleration to show: between two of 12 it is at most 1 - cos(pi/12) = 3.4 %
/// higher.
const LEAST_STEPS: f64 = 12.0;

/// One actuator's harmonic force, switched on at t = 0: `force_n` cos(2 pi `frequency_hz` t + `phase_rad`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Index in the scene.
    pub actuator: usize,
    /// In Hz.
    pub frequency_hz: f64,
    /// Amplitude in N.
    pub force_n: f64,
    /// In rad.
    pub phase_rad: f64,
}

/// A point's motion from rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Times in s, from 0.
    pub time_s: Vec<f64>,
    /// Displacement in m.
    pub displacement_m: Vec<f64>,
    /// Acceleration in m/s^2.
    pub acceleration_m_per_s2: Vec<f64>,
    /// Peak acceleration of the steady state in m/s^2 (equation 23: the drives' amplitudes added up).
    pub steady_peak_m_per_s2: f64,
}

impl Motion {
    /// When a single drive's motion has settled, in s: from there on the largest acceleration of every period is within
    /// `part` of the steady one. `None` if it does not settle in this time, or if periods have too few steps to tell.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    pub fn settles_s(&self, frequency_hz: f64, part: f64) -> Option<f64> {
        let step_s = self.time_s.get(1)?;
        let steps = (1.0 / (frequency_hz * step_s)).ceil();
        if steps < LEAST_STEPS {
            return None;
        }
        let periods = self.acceleration_m_per_s2.chunks_exact(steps as usize);
        let is_steady = |period: &[f64]| {
            let peak = period.iter().fold(0.0_f64, |most, a| most.max(a.abs()));
            (peak - self.steady_peak_m_per_s2).abs() <= part * self.steady_peak_m_per_s2
        };
        let settled = periods.clone().rev().take_while(|period| is_steady(period)).count();
        let first = periods.len() - settled;
        if settled == 0 { None } else { self.time_s.get(first * steps as usize).copied() }
    }

    /// Largest acceleration in m/s^2.
    #[must_use]
    pub fn peak_m_per_s2(&self) -> f64 {
        self.acceleration_m_per_s2.iter().fold(0.0, |most, a| most.max(a.abs()))
    }
}

/// The motion of the point whose mode shapes are `shape`. Hysteretic damping counts as the viscous damping that loses as
/// much at each mode's own resonance ([`ModalSystem::from_reduced`]).
///
/// # Errors
/// [`TransientError`]: numbers out of range, or a drive at an undamped resonance, whose steady state has no bound.
pub fn motion_at(
    model: &ReducedModel,
    shape: &DVector<f64>,
    drives: &[Drive],
    grid: TimeGrid,
) -> Result<Motion, TransientError> {
    let modal = ModalSystem::from_reduced(model);
    let highest = (std::f64::consts::TAU * HIGHEST_HZ).powi(2);
    // Ascending, so what is kept comes first.
    let n = modal.lambda.iter().filter(|lambda| **lambda <= highest).count();
    let system = SecondOrder {
        m: DMatrix::identity(n, n),
        c: modal.damping.view((0, 0), (n, n)).into_owned(),
        k: DMatrix::from_diagonal(&modal.lambda.rows(0, n).into_owned()),
    };
    let row = DMatrix::from_fn(1, n, |_, j| shape[j]);
    let forces: Vec<Harmonic> = drives
        .iter()
        .map(|drive| Harmonic {
            omega_rad_s: std::f64::consts::TAU * drive.frequency_hz,
            phase_rad: drive.phase_rad,
            force_n: DVector::from_fn(n, |i, _| modal.force[(i, drive.actuator)] * drive.force_n),
        })
        .collect();
    let propagator = Propagator::new(&system, grid)?;
    let rest = Initial { displacement: DVector::zeros(n), velocity: DVector::zeros(n) };
    let series = |quantity| -> Result<Vec<f64>, TransientError> {
        Ok(propagator.harmonic(&rest, &forces, Outputs::Rows(&row), quantity)?.column(0).iter().copied().collect())
    };
    let mut steady_peak_m_per_s2 = 0.0;
    for force in &forces {
        let amplitude = (&row * propagator.steady(force)?.map(|z| z.re))[0]
            .hypot((&row * propagator.steady(force)?.map(|z| z.im))[0]);
        steady_peak_m_per_s2 += amplitude * force.omega_rad_s * force.omega_rad_s;
    }
    #[expect(clippy::cast_precision_loss, reason = "at most 1e7 times")]
    let time_s = (0..grid.count).map(|i| i as f64 * grid.step_s).collect();
    Ok(Motion {
        time_s,
        displacement_m: series(Quantity::Displacement)?,
        acceleration_m_per_s2: series(Quantity::Acceleration)?,
        steady_peak_m_per_s2,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Accuracy, PanelModel};
    use crate::response;
    use crate::scene::{EXAMPLE_PLATE, Scene};

    /// After long enough the motion is the response's, which is computed in another way and with hysteretic damping.
    #[test]
    fn motion_settles_to_the_response() {
        let scene = Scene::parse("plate", EXAMPLE_PLATE).unwrap();
        let model = PanelModel::build(&scene, Accuracy::FAST, 150.0).unwrap().reduce(150.0, &[]).unwrap();
        let shape = model.shape_at(0.1, 0.06);
        let hz = 126.0;
        let drive = Drive { actuator: 0, frequency_hz: hz, force_n: 0.1, phase_rad: -std::f64::consts::FRAC_PI_2 };
        let motion = motion_at(&model, &shape, &[drive], TimeGrid { step_s: 1e-4, count: 20_001 }).unwrap();
        let curve = response::acceleration_curves(&model, &shape, &[hz]).unwrap();
        let expected = 0.1 * curve[0][0].norm();
        assert!(
            (motion.steady_peak_m_per_s2 / expected - 1.0).abs() < 0.01,
            "{} {expected}",
            motion.steady_peak_m_per_s2
        );
        let late = motion.acceleration_m_per_s2[18_000..].iter().fold(0.0_f64, |most, a| most.max(a.abs()));
        assert!((late / motion.steady_peak_m_per_s2 - 1.0).abs() < 0.01, "{late}");
        let settled = motion.settles_s(hz, 0.1).unwrap();
        assert!(settled > 0.005 && settled < 1.0, "{settled}");
        assert!(motion.displacement_m[0].abs() < 1e-15);
    }
}
