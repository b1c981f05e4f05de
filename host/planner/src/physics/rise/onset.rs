//! How far beyond its steady motion switching on takes a mass.
//!
//! The rails rise at a given slope, so that a force grows with the square of the time until it is up. Relative to the drive's
//! phasor, of which a pole s has the part -c of the steady motion, the motion `t` after that is
//!
//! ```text
//! Y + sum over s of c p((s - jw) T) e^((s - jw) t),   p(z) = 2 (e^z - 1 - z) / z^2
//! ```
//!
//! with T the time the rails take. A force that is real has a second phasor, which turns the other way: what it leaves of the
//! slowest poles counts in full. Where two poles beside the drive cancel (a panel's mode that takes a mass's motion away, as
//! a tuned absorber does) Y is small, and the motion on the way is not: each pole has its own time, and until the slower one
//! has come up the other moves the mass alone.

use super::{PanelPoles, RIGID_RAD_S};
use crate::model::ReducedModel;
use crate::physics::softening::{NearPole, TimeResponse};
use crate::physics::{PerPair, Phasors};
use crate::scene::MAX_ACTUATORS;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Parts of the steady motion below which what all poles together leave is not followed in time.
const NOT_FOLLOWED: f64 = 0.02;
/// Part of that sum which poles that are not followed may have.
const REST: f64 = 0.05;
/// Samples of the fastest beat that is followed: its crest is missed by 1 - cos(pi / 12) = 3 % at most.
const SAMPLES_PER_BEAT: f64 = 12.0;
/// Most samples; what is then left counts as if it came at once.
const MOST_SAMPLES: usize = 256;
/// Most poles that are followed.
const FOLLOWED: usize = 8;

/// Distance in Hz from a drive's frequency within which poles take their time; others follow at once.
const NEAR_HZ: f64 = 80.0;

/// What switching on is told from: every pole that vibrates, as actuators drive it and as it moves their masses.
#[derive(Clone, Debug)]
pub struct SwitchOnModel {
    poles: Vec<DrivenPole>,
    actuators: usize,
}

#[derive(Clone, Copy, Debug)]
struct DrivenPole {
    /// In 1/s.
    s: Complex64,
    /// x2 . b.
    input: Phasors,
    /// (row . x2) / s.
    output: Phasors,
}

impl DrivenPole {
    /// What forces drive it by.
    fn modal_force(&self, force_n: &Phasors) -> Complex64 {
        self.input.iter().zip(force_n).map(|(b, force)| b * force).sum()
    }
}

/// A pole by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoleDecayAndTravel {
    /// How fast it decays, in 1/s.
    pub rate_per_s: f64,
    /// Travel of every mass in m per amplitude of the pole.
    pub travel: [f64; MAX_ACTUATORS],
}

/// What a force does to a pole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Participation {
    /// Amplitudes of its part of the steady motion, of the phasor that turns with the force and of the one that turns against
    /// it: all of it is what is left of the pole when the force ends.
    pub steady: [Complex64; 2],
    /// Amplitude of the free motion that is there once the rails are up; of an effect, once it has ended.
    pub free_amplitude_after_rise_or_effect: f64,
    /// How much amplitude comes in a second at most.
    pub gain_per_s: f64,
}

impl PanelPoles {
    /// Of a model's actuators. Rigid motions, whose drift is no vibration, are left out.
    #[must_use]
    pub fn build_switch_on_model(&self, model: &ReducedModel) -> SwitchOnModel {
        let actuators = model.count_actuators().min(MAX_ACTUATORS);
        let seen: Vec<(DVector<f64>, DVector<f64>)> = (0..actuators)
            .map(|actuator| {
                let row = model.actuator_mass_travel_row(actuator);
                (self.re.tr_mul(&row), self.im.tr_mul(&row))
            })
            .collect();
        let poles = self
            .poles
            .iter()
            .take(self.poles_below_highest_hz)
            .enumerate()
            .filter(|(_, s)| s.norm() > 10.0 * RIGID_RAD_S);
        let own = |(k, s): (usize, &Complex64)| {
            let (mut input, mut output) = ([Complex64::ZERO; MAX_ACTUATORS], [Complex64::ZERO; MAX_ACTUATORS]);
            for (i, (re, im)) in seen.iter().enumerate() {
                input[i] = self.force[(k, i)];
                output[i] = Complex64::new(re[k], im[k]) / s;
            }
            DrivenPole { s: *s, input, output }
        };
        SwitchOnModel { poles: poles.map(own).collect(), actuators }
    }
}

impl SwitchOnModel {
    /// By how much in m the travel of every mass may be larger than the steady one while 1 N of `driven` at `frequency_hz`
    /// is switched on over `rise_s`; `steady` are the steady travels' phasors in m/N.
    #[must_use]
    pub fn bound_overshoot_of_each_mass_m_per_n(
        &self,
        driven: usize,
        frequency_hz: f64,
        rise_s: f64,
        steady: &[Complex64; MAX_ACTUATORS],
    ) -> [f64; MAX_ACTUATORS] {
        // Actuators beyond the most are not planned for.
        if driven >= self.actuators {
            return [0.0; MAX_ACTUATORS];
        }
        let push = |pole: &DrivenPole| (pole.input[driven], pole.input[driven].norm());
        self.bound_overshoot_of_each_mass_under_modal_push(push, frequency_hz, rise_s, steady)
    }

    /// The same while forces with the phasors `force_n` on all actuators are switched on together at once; `steady` in m.
    #[must_use]
    pub fn bound_overshoot_of_each_mass_under_instant_switch_on_m(
        &self,
        force_n: &Phasors,
        frequency_hz: f64,
        steady: &[Complex64; MAX_ACTUATORS],
    ) -> [f64; MAX_ACTUATORS] {
        let turned = force_n.map(|force| force.conj());
        let push = |pole: &DrivenPole| (pole.modal_force(force_n), pole.modal_force(&turned).norm());
        self.bound_overshoot_of_each_mass_under_modal_push(push, frequency_hz, 0.0, steady)
    }

    /// What every pole does by itself.
    #[must_use]
    pub fn list_decay_rate_and_travel_of_each_pole(&self) -> Vec<PoleDecayAndTravel> {
        let mode = |pole: &DrivenPole| PoleDecayAndTravel {
            rate_per_s: (-pole.s.re).max(0.0),
            travel: pole.output.map(|z| z.norm()),
        };
        self.poles.iter().map(mode).collect()
    }

    /// What forces with the phasors `force_n` at `frequency_hz` do to every pole, whose rails take `rise_s` to rise.
    #[must_use]
    pub fn participation_of_each_pole_under_steady_drive(
        &self,
        force_n: &Phasors,
        frequency_hz: f64,
        rise_s: f64,
    ) -> Vec<Participation> {
        let jw = Complex64::new(0.0, TAU * frequency_hz);
        let turned_n = force_n.map(|force| force.conj());
        let participation = |pole: &DrivenPole| {
            let (with, against) = (pole.modal_force(force_n), pole.modal_force(&turned_n));
            let steady = [with / (jw - pole.s), against / (-jw - pole.s)];
            let left =
                [pole.s - jw, pole.s + jw].map(|beat| residue_factor_of_quadratic_force_rise(beat * rise_s).norm());
            Participation {
                steady,
                free_amplitude_after_rise_or_effect: steady
                    .iter()
                    .zip(left)
                    .map(|(steady, left)| steady.norm() * left)
                    .sum(),
                gain_per_s: with.norm() + against.norm(),
            }
        };
        self.poles.iter().map(participation).collect()
    }

    /// The same of an effect on one actuator, period by period at `levels` of `force_n`: the largest amplitude as the steady
    /// one. A period P of sin(wt) brings the pole s, which is driven by b, w (e^(sP) - 1) / (s^2 + w^2) b.
    #[must_use]
    pub fn compute_participation_of_each_pole_in_effect(
        &self,
        actuator: usize,
        force_n: f64,
        frequency_hz: f64,
        levels: &[f64],
    ) -> Vec<Participation> {
        let omega = TAU * frequency_hz;
        let participation = |pole: &DrivenPole| {
            // Twice, as a pole stands for its conjugate too.
            let push = pole.input.get(actuator).copied().unwrap_or_default() * (2.0 * force_n);
            let turn = (pole.s / frequency_hz).exp();
            let brought = push * omega * (turn - 1.0) / (pole.s * pole.s + omega * omega);
            let (mut now, mut most) = (Complex64::ZERO, 0.0_f64);
            for level in levels {
                now = now * turn + brought * level;
                most = most.max(now.norm_sqr());
            }
            Participation {
                steady: [most.sqrt().into(), Complex64::ZERO],
                free_amplitude_after_rise_or_effect: now.norm(),
                gain_per_s: push.norm(),
            }
        };
        self.poles.iter().map(participation).collect()
    }

    /// `push` is what drives a pole, and how much in the second phasor.
    fn bound_overshoot_of_each_mass_under_modal_push(
        &self,
        modal_force_and_counter_rotating_size: impl Fn(&DrivenPole) -> (Complex64, f64),
        frequency_hz: f64,
        rise_s: f64,
        steady: &[Complex64; MAX_ACTUATORS],
    ) -> [f64; MAX_ACTUATORS] {
        let jw = Complex64::new(0.0, TAU * frequency_hz);
        // What does not depend on the mass.
        let mut against = [0.0; MAX_ACTUATORS];
        let motions: Vec<(Complex64, Complex64, &Phasors)> = self
            .poles
            .iter()
            .map(|pole| {
                let beat = pole.s - jw;
                let sum = pole.s + jw;
                let (modal_force_and_counter_rotating_size, turned) = modal_force_and_counter_rotating_size(pole);
                let left = bound_residue_factor_of_quadratic_force_rise(sum.norm() * rise_s) / sum.norm() * turned;
                against.iter_mut().zip(&pole.output).for_each(|(against, output)| *against += left * output.norm());
                (
                    beat,
                    residue_factor_of_quadratic_force_rise(beat * rise_s) / beat
                        * modal_force_and_counter_rotating_size,
                    &pole.output,
                )
            })
            .collect();
        let mut overshoots = [0.0; MAX_ACTUATORS];
        for (other, overshoot) in overshoots.iter_mut().enumerate().take(self.actuators) {
            let parts = motions.iter().map(|(beat, left, output)| (*beat, left * output[other]));
            *overshoot = bound_overshoot_of_free_motions(parts, steady[other]) + against[other];
        }
        overshoots
    }

    /// What the poles that [`SwitchOnModel::split_receptance_into_near_poles_and_instant_part`] takes to follow at once may leave of their parts on the way, in m, for these
    /// forces at `frequency_hz` over `rise_s` each, and the phasors that turn the other way.
    #[must_use]
    pub fn bound_transients_of_instantly_following_poles_m(
        &self,
        frequency_hz: f64,
        forces: &Phasors,
        rise_s: &[f64; MAX_ACTUATORS],
    ) -> [f64; MAX_ACTUATORS] {
        let jw = Complex64::new(0.0, TAU * frequency_hz);
        let mut sums = [0.0; MAX_ACTUATORS];
        for pole in &self.poles {
            let left = |beat: Complex64| -> f64 {
                let of = |((input, force), rise_s): ((&Complex64, &Complex64), &f64)| {
                    bound_residue_factor_of_quadratic_force_rise(beat.norm() * rise_s) / beat.norm()
                        * (input * force).norm()
                };
                pole.input.iter().zip(forces).zip(rise_s).map(of).sum()
            };
            let far = if is_oscillating_pole_near_drive_frequency(pole, jw) { 0.0 } else { left(pole.s - jw) };
            let all = far + left(pole.s + jw);
            sums.iter_mut().zip(&pole.output).for_each(|(sum, output)| *sum += all * output.norm());
        }
        sums
    }

    /// How masses follow forces at `frequency_hz`, where their steady travel is `receptance` per force.
    #[must_use]
    pub fn split_receptance_into_near_poles_and_instant_part(
        &self,
        frequency_hz: f64,
        receptance: &PerPair,
    ) -> TimeResponse {
        let jw = Complex64::new(0.0, TAU * frequency_hz);
        let near = |pole: &DrivenPole| NearPole { beat: pole.s - jw, input: pole.input, output: pole.output };
        let near_poles: Vec<NearPole> =
            self.poles.iter().filter(|pole| is_oscillating_pole_near_drive_frequency(pole, jw)).map(near).collect();
        let mut at_once = *receptance;
        for near in &near_poles {
            for (row, output) in at_once.iter_mut().zip(&near.output) {
                for (entry, input) in row.iter_mut().zip(&near.input) {
                    *entry += output * input / near.beat;
                }
            }
        }
        TimeResponse { near_poles, at_once }
    }
}

/// Whether a pole takes its time beside a drive; one that hardly swings has no amplitude to speak of.
fn is_oscillating_pole_near_drive_frequency(pole: &DrivenPole, jw: Complex64) -> bool {
    pole.s.im > pole.s.re.abs() && (pole.s - jw).norm() < TAU * NEAR_HZ
}

/// |p(z)| for |z| at most, the real part of z not above 0: |e^z - 1 - z| is neither above 2 + |z| nor above |z|^2 / 2.
fn bound_residue_factor_of_quadratic_force_rise(z: f64) -> f64 {
    (2.0 * (2.0 + z) / (z * z)).min(1.0)
}

/// p(z) of the module's text.
fn residue_factor_of_quadratic_force_rise(z: Complex64) -> Complex64 {
    // The series, where the difference loses more than it leaves out.
    if z.norm_sqr() < 1e-4 { 1.0 + z / 3.0 } else { 2.0 * (z.exp() - 1.0 - z) / (z * z) }
}

/// Of free motions (rate relative to the drive, phasor when the force is up) beside a steady one.
fn bound_overshoot_of_free_motions(
    rates_and_phasors: impl Iterator<Item = (Complex64, Complex64)> + Clone,
    steady: Complex64,
) -> f64 {
    let at_rest = steady.norm();
    let sum: f64 = rates_and_phasors.clone().map(|(_, phasor)| phasor.norm()).sum();
    if sum <= NOT_FOLLOWED * at_rest || !sum.is_finite() {
        return sum;
    }
    // The strongest are followed, the rest adds up.
    let mut followed = [(Complex64::ZERO, Complex64::ZERO); FOLLOWED];
    let mut count = 0;
    let least = REST * sum / FOLLOWED as f64;
    for (beat, phasor) in rates_and_phasors.filter(|(_, phasor)| phasor.norm_sqr() > least * least) {
        if count < FOLLOWED {
            followed[count] = (beat, phasor);
            count += 1;
        } else if let Some(weakest) = followed.iter_mut().min_by(|a, b| a.1.norm_sqr().total_cmp(&b.1.norm_sqr()))
            && weakest.1.norm_sqr() < phasor.norm_sqr()
        {
            *weakest = (beat, phasor);
        }
    }
    let followed = &mut followed[..count];
    let rest = sum - followed.iter().map(|(_, phasor)| phasor.norm()).sum::<f64>();
    let fastest = followed.iter().map(|(beat, _)| beat.im.abs()).fold(0.0, f64::max);
    let slowest = followed.iter().map(|(beat, _)| -beat.re).fold(f64::INFINITY, f64::min);
    // Poles in step with the drive rise without a crest.
    let step_s = (TAU / SAMPLES_PER_BEAT / fastest).min(0.5 / slowest.max(f64::MIN_POSITIVE));
    let mut most = at_rest;
    if step_s.is_finite() {
        for (beat, _) in followed.iter_mut() {
            *beat = (*beat * step_s).exp();
        }
        for _ in 0..MOST_SAMPLES {
            let (mut here, mut left) = (steady, 0.0);
            for (turn, phasor) in followed.iter_mut() {
                here += *phasor;
                left += phasor.l1_norm();
                *phasor *= *turn;
            }
            most = most.max(here.norm());
            if at_rest + left <= most {
                return most + rest - at_rest;
            }
        }
    }
    let left: f64 = followed.iter().map(|(_, phasor)| phasor.norm()).sum();
    most.max(at_rest + left) + rest - at_rest
}
