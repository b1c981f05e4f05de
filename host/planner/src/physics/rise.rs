//! When a target vibrates, and when it has stopped: the thesis' whole solution (equation 19), fast enough for every touch.
//!
//! In the state (W q, q') with W = diag(sqrt(Lambda)) the panel in time is z' = A z + (0, b) F, A = [[0, W], [-W, -C]]. With
//! D = diag(-1, 1) the transpose of A is D A D, so that the left eigenvectors are D times the right ones x = (x1, x2), and
//! velocity at a point per newton is the sum over the poles s of
//!
//! ```text
//! g / (s' - s),   g = (shape . x2) (x2 . b) / (x2 . x2 - x1 . x1)
//! ```
//!
//! Under a force f cos(w t + phase) from rest the acceleration is its steady part plus the sum of c e^(s t) with
//! c = s g F(s), F the force's Laplace transform: no matrix is inverted (equation 21 needs V^-1) and no exponential of a
//! growing number appears. Coefficients that belong to a point and a drive are a [`TransientResponse`].
//!
//! Damping: hysteretic losses count as in the simulation in time
//! ([`ModalSystem::from_reduced_with_equivalent_viscous_damping`](crate::transient::reduced::ModalSystem::from_reduced_with_equivalent_viscous_damping)). Equal and critically damped poles are
//! pulled apart by 1e-7 of their size, which moves the times by as little and leaves nine digits to the coefficients,
//! as g grows with the inverse root of the distance.
//!
//! Poles above [`HIGHEST_HZ`] count as following any force at once, which takes nothing that a finger feels: what rings up
//! there is beyond the skin's 1 kHz.

use crate::model::ReducedModel;
use crate::transient::panel::SwitchedForce;
use crate::transient::reduced::ModalSystem;
use faer::Mat;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Frequency in Hz above which poles follow any force at once; twice what the skin feels.
pub const HIGHEST_HZ: f64 = 2000.0;
/// Part of a frequency by which equal ones are pulled apart.
const APART: f64 = 1e-7;
/// Stands for the frequency 0 of rigid motions, in rad/s: 2 pi of it take two hours.
const RIGID_RAD_S: f64 = 1e-3;
/// Part of the steady peak at which a target counts as reached, and as decayed.
const REACHED: f64 = 0.9;
const DECAYED: f64 = 0.1;
/// Part of the steady peak that the poles left out of an envelope may have together.
const LEFT_OUT: f64 = 1e-3;
/// Longest time in s; what takes longer counts as never.
const LONGEST_RISE_S: f64 = 60.0;
/// Samples of an envelope, at most, and per beat between pole and drive.
const SAMPLES: f64 = 512.0;
const SAMPLES_PER_BEAT: f64 = 14.0;

/// When a target vibrates as planned, counted from when the drives start, and when it has stopped, counted from their end.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Timing {
    /// From here on the envelope stays at or above 90 % of the steady peak, in s; `None` if it never does.
    pub reaches_90_s: Option<f64>,
    /// From here on it stays at or below 10 %, in s; `None` if it never does.
    pub decays_to_10_s: Option<f64>,
}

/// The poles of a panel, found once for a scene.
#[derive(Clone, Debug)]
pub struct PanelPoles {
    /// In 1/s, imaginary part 0 or above, slowest frequencies first. One of each complex pair.
    poles: Vec<Complex64>,
    /// How many of them are below [`HIGHEST_HZ`].
    poles_below_highest_hz: usize,
    /// x2 over the root of x2 . x2 - x1 . x1, one column per pole.
    re: DMatrix<f64>,
    im: DMatrix<f64>,
    /// The same times the force of 1 N at each actuator, poles x actuators.
    force: DMatrix<Complex64>,
}

/// What one drive of 1 N does at one point, from rest: acceleration in m/s^2 (or displacement in m, see
/// [`TransientResponse::acceleration_to_displacement`]).
#[derive(Clone, Debug, PartialEq)]
pub struct TransientResponse {
    /// Angular frequency of the drive in rad/s.
    pub omega_rad_s: f64,
    /// Phasor of the steady motion.
    pub steady: Complex64,
    /// Poles s and coefficients c of the free motion, the real part of the sum of c e^(s t).
    pub free: Vec<(Complex64, Complex64)>,
}

impl TransientResponse {
    /// The same for the displacement in m. Rigid motions, whose drift is no vibration, are left out.
    #[must_use]
    pub fn acceleration_to_displacement(mut self) -> Self {
        self.steady /= -self.omega_rad_s * self.omega_rad_s;
        self.free.retain(|(s, _)| s.norm() > 10.0 * RIGID_RAD_S);
        for (s, c) in &mut self.free {
            *c /= *s * *s;
        }
        self
    }

    /// The motion `time_s` after the start.
    #[must_use]
    pub fn value_at(&self, time_s: f64) -> f64 {
        let free: f64 = self.free.iter().map(|(s, c)| (c * (s * time_s).exp()).re).sum();
        (self.steady * Complex64::from_polar(1.0, self.omega_rad_s * time_s)).re + free
    }
}

impl PanelPoles {
    /// Finds the poles: an eigensolution of twice the model's order. `None` if it does not converge, which no scene is
    /// known to cause.
    #[must_use]
    pub fn find_poles_if_converged(model: &ReducedModel) -> Option<Self> {
        let system = ModalSystem::from_reduced_with_equivalent_viscous_damping(model);
        let n = system.lambda.len();
        let omega: Vec<f64> = (0..n)
            .map(|i| {
                // Different for every coordinate, and never zero: the fractions of multiples of the golden ratio.
                #[expect(clippy::cast_precision_loss, reason = "a small model")]
                let spread = 0.5 + (i as f64 * 0.618_033_988_749_895).fract();
                (system.lambda[i].sqrt() * (1.0 + APART * spread)).max(RIGID_RAD_S * (1.0 + spread))
            })
            .collect();
        let a = Mat::from_fn(2 * n, 2 * n, |i, j| match (i < n, j < n) {
            (true, true) => 0.0,
            (true, false) => {
                if i == j - n {
                    omega[i]
                } else {
                    0.0
                }
            }
            (false, true) => {
                if i - n == j {
                    -omega[j]
                } else {
                    0.0
                }
            }
            (false, false) => -system.damping[(i - n, j - n)],
        });
        let eigen = a.eigen().ok()?;
        let (vectors, values) = (eigen.U(), eigen.S().column_vector());
        let mut order: Vec<usize> = (0..2 * n).filter(|k| values[*k].im >= 0.0).collect();
        order.sort_by(|a, b| values[*a].norm().total_cmp(&values[*b].norm()));
        let mut shapes = DMatrix::<Complex64>::zeros(n, order.len());
        for (mut column, k) in shapes.column_iter_mut().zip(&order) {
            let square = |from: usize| (0..n).map(|i| vectors[(from + i, *k)].powi(2)).sum::<Complex64>();
            let norm = (square(n) - square(0)).sqrt();
            for i in 0..n {
                column[i] = vectors[(n + i, *k)] / norm;
            }
        }
        if shapes.iter().any(|z| !z.is_finite()) {
            return None;
        }
        let poles: Vec<Complex64> = order.iter().map(|k| values[*k]).collect();
        Some(Self {
            poles_below_highest_hz: poles.iter().filter(|s| s.norm() <= TAU * HIGHEST_HZ).count(),
            force: shapes.tr_mul(&system.force.map(Complex64::from)),
            re: shapes.map(|z| z.re),
            im: shapes.map(|z| z.im),
            poles,
        })
    }

    /// What each of `drives` does where `shape` holds the shapes' deflections (or an actuator's travel), for 1 N whatever
    /// their `force_n`. `None` where a drive meets the resonance of an undamped mode, or an actuator that there is not.
    #[must_use]
    pub fn transient_response_per_n_of_each_drive_if_finite(
        &self,
        shape: &DVector<f64>,
        drives: &[SwitchedForce],
    ) -> Option<Vec<TransientResponse>> {
        let (re, im) = (self.re.tr_mul(shape), self.im.tr_mul(shape));
        drives
            .iter()
            .map(|drive| {
                let jw = Complex64::new(0.0, TAU * drive.frequency_hz);
                let phasor = Complex64::from_polar(1.0, drive.phase_rad);
                let force = (drive.actuator < self.force.ncols()).then(|| self.force.column(drive.actuator))?;
                let mut steady = Complex64::ZERO;
                let mut free = Vec::with_capacity(self.poles_below_highest_hz);
                for (k, s) in self.poles.iter().enumerate() {
                    let g = Complex64::new(re[k], im[k]) * force[k];
                    let is_pair = s.im > 0.0;
                    steady += jw * g / (jw - s);
                    if is_pair {
                        steady += jw * g.conj() / (jw - s.conj());
                    }
                    if k < self.poles_below_highest_hz {
                        let transform = 0.5 * (phasor / (s - jw) + phasor.conj() / (s + jw));
                        free.push((*s, s * g * transform * if is_pair { 2.0 } else { 1.0 }));
                    }
                }
                let ringing = TransientResponse { omega_rad_s: jw.im, steady: steady * phasor, free };
                let is_finite = ringing.steady.is_finite() && ringing.free.iter().all(|(_, c)| c.is_finite());
                is_finite.then_some(ringing)
            })
            .collect()
    }

    /// When the target with the mode shapes `shape` reaches its steady peak after all `drives` have started from rest, and
    /// when it has decayed after all have ended.
    ///
    /// The envelope is the sum over the frequencies of the running amplitude |steady + sum of c e^((s - jw) t)|, phasors of
    /// equal frequencies added first (equation 23 for each instant; poles that do not vibrate count with what they do); after the end, which is a whole number of periods of
    /// every drive after its start, the steady part is missing. The steady peak is what equation 23 makes of the damping
    /// in time.
    #[must_use]
    pub fn find_rise_and_decay_times(&self, shape: &DVector<f64>, drives: &[SwitchedForce]) -> Timing {
        const NEVER: Timing = Timing { reaches_90_s: None, decays_to_10_s: None };
        let Some(ringings) = self.transient_response_per_n_of_each_drive_if_finite(shape, drives) else {
            return NEVER;
        };
        let mut parts: Vec<TransientResponse> = Vec::with_capacity(drives.len());
        for (mut ringing, drive) in ringings.into_iter().zip(drives) {
            ringing.steady *= drive.force_n;
            ringing.free.iter_mut().for_each(|(_, c)| *c *= drive.force_n);
            match parts.iter_mut().find(|part| part.omega_rad_s.to_bits() == ringing.omega_rad_s.to_bits()) {
                Some(part) => {
                    part.steady += ringing.steady;
                    part.free.iter_mut().zip(&ringing.free).for_each(|((_, sum), (_, c))| *sum += c);
                }
                None => parts.push(ringing),
            }
        }
        envelope_rise_and_decay_times_unless_at_rest_or_slow(&mut parts).unwrap_or(NEVER)
    }
}

fn envelope_rise_and_decay_times_unless_at_rest_or_slow(parts: &mut [TransientResponse]) -> Option<Timing> {
    let peak: f64 = parts.iter().map(|part| part.steady.norm()).sum();
    if peak <= 0.0 {
        return None;
    }
    let count = parts.iter().map(|part| part.free.len()).sum::<usize>().max(1);
    #[expect(clippy::cast_precision_loss, reason = "a few hundred")]
    let small = LEFT_OUT * peak / count as f64;
    for part in parts.iter_mut() {
        part.free.retain(|(_, c)| c.norm() > small);
    }
    let latest_s = bound_time_until_free_motion_below_limit_if_short_s(parts, DECAYED.min(1.0 - REACHED) * peak)?;
    let beat = |part: &TransientResponse| {
        part.free.iter().map(|(s, _)| (s.im - part.omega_rad_s).abs() / TAU).fold(1.0 / LONGEST_RISE_S, f64::max)
    };
    let fastest_hz = parts.iter().map(beat).fold(1.0 / LONGEST_RISE_S, f64::max);
    let step_s = (1.0 / (SAMPLES_PER_BEAT * fastest_hz)).min(latest_s / 64.0).max(latest_s / SAMPLES);
    if step_s <= 0.0 {
        return Some(Timing { reaches_90_s: Some(0.0), decays_to_10_s: Some(0.0) });
    }
    let mut walks: Vec<BackwardWalk> = parts.iter().map(|part| BackwardWalk::new(part, latest_s, step_s)).collect();
    // Backwards, until each condition fails for the first time.
    let (mut reached, mut decayed) = (None, None);
    let mut before = (0.0, 0.0);
    let mut time_s = latest_s;
    loop {
        let (mut with, mut without) = (0.0, 0.0);
        for (part, walk) in parts.iter().zip(&mut walks) {
            let free = walk.sum_phasors_and_step_back();
            with += (part.steady + free).norm();
            without += free.norm();
        }
        // How far each is from its condition: negative where it is met. Between two samples the crossing is interpolated.
        let now = (REACHED * peak - with, without - DECAYED * peak);
        let crossing = |was: f64, is: f64| time_s + if is > was { step_s * is / (is - was) } else { step_s };
        if reached.is_none() && now.0 > 0.0 {
            reached = Some(crossing(before.0, now.0).min(latest_s));
        }
        if decayed.is_none() && now.1 > 0.0 {
            decayed = Some(crossing(before.1, now.1).min(latest_s));
        }
        if (reached.is_some() && decayed.is_some()) || time_s < step_s {
            let found = |time: Option<f64>| Some(time.unwrap_or(0.0));
            return Some(Timing { reaches_90_s: found(reached), decays_to_10_s: found(decayed) });
        }
        before = now;
        time_s -= step_s;
    }
}

/// One part's free motion relative to its drive's phasor, backwards in equal steps.
struct BackwardWalk {
    /// Of the poles that vibrate: phasor and factor of a step.
    swinging: Vec<(Complex64, Complex64)>,
    /// Of the others, not relative to the drive.
    creeping: Vec<(Complex64, Complex64)>,
    /// The drive's own, turned the other way.
    carrier: (Complex64, Complex64),
}

impl BackwardWalk {
    fn new(part: &TransientResponse, from_s: f64, step_s: f64) -> Self {
        let jw = Complex64::new(0.0, part.omega_rad_s);
        let (mut swinging, mut creeping) = (Vec::with_capacity(part.free.len()), Vec::new());
        for (s, c) in &part.free {
            // Damped by more than 1/sqrt(2) of critical a motion has no amplitude to speak of, only itself; and near the
            // critical value the coefficients of a pair are large and cancel.
            if s.im > s.re.abs() {
                swinging.push((c * ((s - jw) * from_s).exp(), ((jw - s) * step_s).exp()));
            } else {
                creeping.push((c * (s * from_s).exp(), (-s * step_s).exp()));
            }
        }
        Self { swinging, creeping, carrier: ((-jw * from_s).exp(), (jw * step_s).exp()) }
    }

    /// The sum here, after which the walk goes back by one step.
    fn sum_phasors_and_step_back(&mut self) -> Complex64 {
        let step = |(phasor, turn): &mut (Complex64, Complex64)| {
            let here = *phasor;
            *phasor *= *turn;
            here
        };
        let creeping: f64 = self.creeping.iter_mut().map(step).map(|z| z.re).sum();
        let swinging: Complex64 = self.swinging.iter_mut().map(step).sum();
        swinging + step(&mut self.carrier) * creeping
    }
}

/// A time in s from which on all free motion together is surely below `limit`; `None` beyond [`LONGEST_RISE_S`].
fn bound_time_until_free_motion_below_limit_if_short_s(responses: &[TransientResponse], limit: f64) -> Option<f64> {
    let bound = |time_s: f64| -> f64 {
        responses.iter().flat_map(|part| &part.free).map(|(s, c)| c.norm() * (s.re * time_s).exp()).sum()
    };
    if bound(0.0) <= limit {
        return Some(0.0);
    }
    let mut high = 1e-3;
    while bound(high) > limit {
        high *= 2.0;
        if high > LONGEST_RISE_S {
            return None;
        }
    }
    let mut low = 0.5 * high;
    for _ in 0..6 {
        let middle = 0.5 * (low + high);
        *(if bound(middle) > limit { &mut low } else { &mut high }) = middle;
    }
    Some(high)
}

mod onset;
mod residues;
mod stepper;
#[cfg(test)]
mod tests;

pub use onset::{Participation, PoleDecayAndTravel, SwitchOnModel};
pub use residues::PointResidues;
pub use stepper::Stepper;
