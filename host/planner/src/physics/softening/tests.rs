//! Against ERAs stepped through time.

use super::*;
use nalgebra::DMatrix;
use std::f64::consts::{PI, TAU};

const ERA: Transducer = Transducer { newtons_per_volt_squared: 3.477e-8, gap_m: 0.5e-3, counted_n_per_m: 0.0 };
const MASS: f64 = 0.01;
const STIFFNESS: f64 = 5000.0;

/// ERAs of 10 g and 5 kN/m on a body on a spring: coordinates are the body's and, relative to it, the masses'.
struct Rig {
    body_kg: f64,
    body_n_per_m: f64,
    damping: f64,
    eras: usize,
}

impl Rig {
    /// ERAs on the ground, as good as.
    fn grounded(damping: f64) -> Self {
        Self { body_kg: 1e12, body_n_per_m: 0.0, damping, eras: 1 }
    }

    fn receptance(&self, frequency_hz: f64) -> PerPair {
        let (n, omega) = (1 + self.eras, TAU * frequency_hz);
        let mut matrix = DMatrix::<Complex64>::zeros(n, n);
        matrix[(0, 0)] = Complex64::new(self.body_n_per_m - omega * omega * self.body_kg, omega * self.damping);
        for i in 1..n {
            matrix[(0, 0)] -= omega * omega * MASS;
            matrix[(0, i)] = Complex64::from(-omega * omega * MASS);
            matrix[(i, 0)] = matrix[(0, i)];
            matrix[(i, i)] = Complex64::new(STIFFNESS - omega * omega * MASS, omega * self.damping);
        }
        let inverse = matrix.try_inverse().unwrap();
        let entry =
            |i: usize, j: usize| if i < self.eras && j < self.eras { inverse[(i + 1, j + 1)] } else { Complex64::ZERO };
        std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
    }

    /// Accelerations of the body and, relative to it, of the masses, under forces between.
    fn accelerations(&self, x: &[f64; 5], v: &[f64; 5], forces: &[f64; 4]) -> [f64; 5] {
        let on_mass = |i: usize| forces[i] - STIFFNESS * x[i + 1] - self.damping * v[i + 1];
        let back: f64 = (0..self.eras).map(on_mass).sum();
        let body = (-back - self.body_n_per_m * x[0] - self.damping * v[0]) / self.body_kg;
        let mut out = [0.0; 5];
        out[0] = body;
        for i in 0..self.eras {
            out[i + 1] = on_mass(i) / MASS - body;
        }
        out
    }

    /// Runge-Kutta steps of `step_s`, each with the windows as they are in its middle, for `settle_s`, and then for 1 s.
    /// Amplitudes of each ERA's travel at `frequencies_hz` (whole numbers), and the most that each travels.
    fn integrate(
        &self,
        eras: &[Transducer],
        drives: &[(f64, Excitation)],
        settle_s: f64,
        step_s: f64,
        frequencies_hz: &[f64],
    ) -> (Vec<Vec<f64>>, Vec<f64>) {
        let (mut x, mut v) = ([0.0; 5], [0.0; 5]);
        let mut sums = vec![vec![Complex64::ZERO; self.eras]; frequencies_hz.len()];
        let mut most = vec![0.0_f64; self.eras];
        let (before, record) = ((settle_s / step_s).round() as u64, (1.0 / step_s).round() as u64);
        for step in 0..before + record {
            let middle_s = (step as f64 + 0.5) * step_s;
            let ramp = (2.0 * middle_s / settle_s).min(1.0);
            let mut side = [0.0; 4];
            for (side, (frequency_hz, drive)) in side.iter_mut().zip(drives) {
                let turn = (frequency_hz * middle_s + drive.phase_rad / TAU).rem_euclid(1.0);
                let away = |from: f64| (turn - from).abs().min(1.0 - (turn - from).abs());
                *side = match () {
                    () if away(0.0) < 0.25 * drive.pulse_width => 1.0,
                    () if away(0.5) < 0.25 * drive.pulse_width => -1.0,
                    () => 0.0,
                };
            }
            let slope = |x: &[f64; 5], v: &[f64; 5]| {
                let mut forces = [0.0; 4];
                for (i, force) in forces.iter_mut().enumerate().take(self.eras) {
                    let left = 1.0 - side[i] * x[i + 1] / eras[i].gap_m;
                    let square = ramp * drives[i].1.voltage_v.powi(2);
                    *force = side[i] * eras[i].newtons_per_volt_squared * square / (left * left)
                        - eras[i].counted_n_per_m * x[i + 1];
                }
                self.accelerations(x, v, &forces)
            };
            let along = |a: &[f64; 5], b: &[f64; 5], h: f64| -> [f64; 5] { std::array::from_fn(|i| a[i] + h * b[i]) };
            let (x1, v1) = (x, v);
            let a1 = slope(&x1, &v1);
            let (x2, v2) = (along(&x, &v1, step_s / 2.0), along(&v, &a1, step_s / 2.0));
            let a2 = slope(&x2, &v2);
            let (x3, v3) = (along(&x, &v2, step_s / 2.0), along(&v, &a2, step_s / 2.0));
            let a3 = slope(&x3, &v3);
            let (x4, v4) = (along(&x, &v3, step_s), along(&v, &a3, step_s));
            let a4 = slope(&x4, &v4);
            for i in 0..5 {
                x[i] += step_s / 6.0 * (v1[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i]);
                v[i] += step_s / 6.0 * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i]);
            }
            if step >= before {
                let end_s = (step + 1) as f64 * step_s;
                for (sums, frequency_hz) in sums.iter_mut().zip(frequencies_hz) {
                    let turn = Complex64::cis(-TAU * (frequency_hz * end_s).fract());
                    (0..self.eras).for_each(|i| sums[i] += turn * x[i + 1] * 2.0 * step_s);
                }
                (0..self.eras).for_each(|i| most[i] = most[i].max(x[i + 1].abs()));
            }
        }
        (sums.into_iter().map(|sums| sums.into_iter().map(|z| z.norm()).collect()).collect(), most)
    }
}

fn excitation(frequency: usize, voltage_v: f64, pulse_width: f64, phase_rad: f64) -> Excitation {
    Excitation { frequency, voltage_v, pulse_width, phase_rad }
}

#[test]
fn one_era_below_at_and_above_its_resonance() {
    // Alone it resonates at 112.5 Hz, at 1.7 kV some 3 Hz lower.
    let mut seen = Vec::new();
    for (damping, pulse_width) in [(0.7, 2.0 / 3.0), (2.0, 1.0)] {
        let rig = Rig::grounded(damping);
        for frequency_hz in [40.0, 80.0, 100.0, 105.0, 108.0, 112.0, 120.0, 200.0] {
            for voltage_v in [400.0, 900.0, 1300.0, 1700.0, 2000.0] {
                let drive = excitation(0, voltage_v, pulse_width, 0.4);
                let line = |harmonic: u32| Line {
                    frequency: 0,
                    harmonic,
                    receptance: rig.receptance(f64::from(harmonic) * frequency_hz),
                };
                let Ok(motion) = settle(&[ERA], &[drive], &[line(1), line(3), line(5)]) else { continue };
                if motion.largest_m[0] > ERA.gap_m / 3.0 {
                    continue;
                }
                let step_s = 1.0 / (frequency_hz * 240.0);
                let step_s = 1.0 / (1.0 / step_s).round();
                let (found, most) = rig.integrate(&[ERA], &[(frequency_hz, drive)], 0.8, step_s, &[frequency_hz]);
                let predicted = motion.travel_m[0][0].norm();
                let error = predicted / found[0][0] - 1.0;
                let linear = (rig.receptance(frequency_hz)[0][0] * 4.0 / PI * (PI / 2.0 * pulse_width).sin()).norm()
                    * ERA.newtons_per_volt_squared
                    * voltage_v.powi(2);
                println!(
                    "c {damping} w {pulse_width:.2} {frequency_hz} Hz {voltage_v} V: {:.3} g, error {error:.1e}, linear {:+.3}, most {:.3}",
                    predicted / ERA.gap_m,
                    linear / found[0][0] - 1.0,
                    most[0] / motion.largest_m[0]
                );
                assert!(error.abs() < 1e-2, "{frequency_hz} Hz {voltage_v} V: {error}");
                assert!(most[0] < motion.largest_m[0] * 1.01);
                seen.push((predicted / ERA.gap_m, (linear / found[0][0] - 1.0).abs()));
            }
        }
    }
    assert!(seen.iter().any(|(part, _)| *part > 0.25) && seen.iter().any(|(_, linear)| *linear > 0.3));
    assert!(seen.len() > 45, "{}", seen.len());
}

#[test]
fn two_eras_on_one_body_at_two_frequencies() {
    let rig = Rig { body_kg: 0.05, body_n_per_m: 20e3, damping: 1.5, eras: 2 };
    let eras = [ERA, Transducer { gap_m: 0.4e-3, ..ERA }];
    let mut most_moved = 0.0_f64;
    for (frequencies_hz, volts) in
        [([89.0, 131.0], [1500.0, 1200.0]), ([121.0, 150.0], [1700.0, 1500.0]), ([60.0, 101.0], [1900.0, 1100.0])]
    {
        let drives = [excitation(0, volts[0], 2.0 / 3.0, 0.0), excitation(1, volts[1], 0.8, 1.0)];
        let line = |frequency: usize, harmonic: u32| Line {
            frequency,
            harmonic,
            receptance: rig.receptance(f64::from(harmonic) * frequencies_hz[frequency]),
        };
        let motion = settle(&eras, &drives, &[line(0, 1), line(1, 1), line(0, 3), line(1, 3)]).unwrap();
        let timed = [(frequencies_hz[0], drives[0]), (frequencies_hz[1], drives[1])];
        let (found, most) = rig.integrate(&eras, &timed, 1.0, 1e-5, &frequencies_hz);
        for (l, found) in found.iter().enumerate() {
            for (i, found) in found.iter().enumerate() {
                let predicted = motion.travel_m[l][i].norm();
                let scale = motion.largest_m[i];
                println!(
                    "{} Hz era {i}: {:.3} g, error {:.1e}, most {:.3}",
                    frequencies_hz[l],
                    predicted / eras[i].gap_m,
                    (predicted - found) / scale,
                    most[i] / scale
                );
                assert!((predicted - found).abs() < 1e-2 * found.max(0.1 * scale), "{predicted} {found}");
                assert!(motion.largest_m[i] <= eras[i].gap_m / 3.0 && most[i] < 1.02 * scale);
                most_moved = most_moved.max(most[i] / eras[i].gap_m);
            }
        }
    }
    assert!(most_moved > 0.2, "{most_moved}");
}

#[test]
fn what_the_model_has_softened_already_is_not_softened_twice() {
    // The same ERA with part of its spring's softening in the model.
    let rig = Rig::grounded(1.0);
    let counted = 300.0;
    let drive = excitation(0, 1500.0, 2.0 / 3.0, 0.0);
    let plain = rig.receptance(90.0);
    let mut softened = plain;
    softened[0][0] = 1.0 / (1.0 / plain[0][0] - counted);
    let line = |receptance: PerPair| Line { frequency: 0, harmonic: 1, receptance };
    let one = settle(&[ERA], &[drive], &[line(plain)]).unwrap();
    let other = settle(&[Transducer { counted_n_per_m: counted, ..ERA }], &[drive], &[line(softened)]).unwrap();
    let (one, other) = (one.travel_m[0][0], other.travel_m[0][0]);
    assert!((one - other).norm() < 1e-6 * one.norm(), "{one} {other}");
}

#[test]
fn a_shared_frequency_adds_with_phase_and_no_gap_is_the_linear_law() {
    let rig = Rig { body_kg: 0.05, body_n_per_m: 20e3, damping: 1.5, eras: 2 };
    let drives = [excitation(0, 1000.0, 0.5, 0.3), excitation(0, 1200.0, 1.0, -1.9)];
    let fixed = [Transducer::fixed(3e-8); 2];
    let receptance = rig.receptance(75.0);
    let motion = settle(&fixed, &drives, &[Line { frequency: 0, harmonic: 1, receptance }]).unwrap();
    let force = |drive: &Excitation| {
        let amplitude = 4.0 / PI * (PI / 2.0 * drive.pulse_width).sin() * 3e-8 * drive.voltage_v.powi(2);
        Complex64::from_polar(amplitude, drive.phase_rad)
    };
    for (i, drive) in drives.iter().enumerate() {
        assert!((motion.force_n[0][i] - force(drive)).norm() < 1e-12);
        let travel = receptance[i][0] * force(&drives[0]) + receptance[i][1] * force(&drives[1]);
        assert!((motion.travel_m[0][i] - travel).norm() < 1e-12 * travel.norm());
    }
}

#[test]
fn what_has_no_steady_motion_is_not_safe() {
    // 4 kV take 2 kN/m of 5 kN/m in the mean; at resonance that goes beyond half of the gap.
    let at = |rig: &Rig, frequency_hz: f64, voltage_v: f64| {
        let line = Line { frequency: 0, harmonic: 1, receptance: rig.receptance(frequency_hz) };
        settle(&[ERA], &[excitation(0, voltage_v, 2.0 / 3.0, 0.0)], &[line])
    };
    assert_eq!(at(&Rig::grounded(0.7), 105.0, 4000.0).unwrap_err(), NotSafe::Travel { actuator: 0 });
    assert!(at(&Rig::grounded(0.7), 105.0, 1000.0).is_ok());
    assert!(matches!(settle(&[ERA], &[], &[]), Err(NotSafe::Shape { .. })));
    assert!(matches!(settle(&[ERA], &[excitation(0, 1.0, 1.0, 0.0)], &[]), Err(NotSafe::Shape { .. })));
}

#[test]
fn limits_are_told_in_their_order() {
    let (stop_m, sag_m) = (f64::INFINITY, 0.0);
    let electrodes = Electrodes { area_m2: 1.9635e-3, gap_m: 0.5e-3, max_voltage_v: 2000.0, stop_m, sag_m };
    assert_eq!(electrodes.violated(0.0, 2001.0), Some(Limit::Voltage));
    assert_eq!(electrodes.violated(167e-6, 1000.0), Some(Limit::Travel));
    assert_eq!(electrodes.violated(100e-6, 1900.0), Some(Limit::Breakdown));
    assert_eq!(electrodes.violated(100e-6, 1800.0), None);
}
