//! Against a numerical solution of the circuit, the contract's law, and relations; none of them has the formulas of the module.

use super::*;
use proptest::prelude::*;
use std::f64::consts::PI;

fn times(farads: f64, up_ohm: f64, down_ohm: f64, late_s: f64) -> ChargingTimes {
    ChargingTimes { rise_s: up_ohm * farads, hold_s: late_s, fall_s: down_ohm * farads }
}

/// Harmonics of 2 v^2 cos over the last of some periods from rest, v by classical Runge-Kutta with `steps` in each piece, and the mean of
/// v_A^2 + v_B^2; Simpson's rule. A's window begins at -W/2.
fn march(times: ChargingTimes, hz: f64, width: f64, orders: &[f64], steps: u32) -> (Vec<Complex64>, f64) {
    let period = 1.0 / hz;
    let window = 0.5 * width * period;
    // After 40 time constants nothing is left; steps of more than 2.8 of them would grow.
    let rest = period - window - times.hold_s;
    let falling = rest.min(40.0 * times.fall_s);
    let pieces = [
        (window, 1.0, times.rise_s),
        (times.hold_s, 0.0, f64::INFINITY),
        (falling, 0.0, times.fall_s),
        (rest - falling, 0.0, f64::INFINITY),
    ];
    let mut v = 0.0_f64;
    let mut sums = vec![Complex64::ZERO; orders.len()];
    let mut mean = 0.0;
    for _ in 0..4 {
        let mut t = -0.5 * window;
        sums.fill(Complex64::ZERO);
        mean = 0.0;
        for (length, source, tau) in pieces {
            let h = length / f64::from(steps);
            let slope = |v: f64| (source - v) / tau;
            for step in 0..=steps {
                let weight = h / 3.0
                    * if step == 0 || step == steps {
                        1.0
                    } else if step % 2 == 1 {
                        4.0
                    } else {
                        2.0
                    };
                for (sum, n) in sums.iter_mut().zip(orders) {
                    *sum += Complex64::cis(-TAU * n * hz * t) * (4.0 * hz * weight * v * v);
                }
                mean += 2.0 * hz * weight * v * v;
                if step < steps {
                    let k1 = slope(v);
                    let k2 = slope(v + 0.5 * h * k1);
                    let k3 = slope(v + 0.5 * h * k2);
                    let k4 = slope(v + h * k3);
                    v += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
                    t += h;
                }
            }
        }
    }
    (sums, mean)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn harmonics_and_mean_square_are_those_of_the_marched_voltage(
        rise_us in 20.0_f64..500.0,
        fall in 0.05_f64..1.0,
        hold in 0.0_f64..1.0,
        hz in 40.0_f64..400.0,
        width in 0.1_f64..0.83,
    ) {
        let rise_s = rise_us * 1e-6;
        let times = ChargingTimes { rise_s, hold_s: (hold * rise_s).min(100e-6), fall_s: fall * rise_s };
        let charging = PeriodicCharging::new(times, hz);
        let orders = [1.0, 3.0, 5.0, 7.0, 9.0];
        let (found, mean) = march(times, hz, width, &orders, 4000);
        for (n, marched) in orders.iter().zip(found) {
            let own = charging.force_harmonic_phasor_per_n_at_rail_voltage(*n, width);
            prop_assert!((own - marched).norm() < 1e-6, "{n}: {own} {marched}");
        }
        prop_assert!((charging.mean_sum_of_squared_electrode_voltages_over_rail_squared(width) - mean).abs() < 1e-6);
    }

    /// The force is never above the one without resistors, and grows with the width; so does the mean square.
    #[test]
    fn force_is_at_most_the_ideal_one_and_grows_with_the_width(
        rise_us in 1.0_f64..500.0,
        fall in 0.0_f64..=1.0,
        hold in 0.0_f64..=1.0,
        hz in 40.0_f64..1000.0,
    ) {
        let rise_s = rise_us * 1e-6;
        let times = ChargingTimes { rise_s, hold_s: (hold * rise_s).min(100e-6), fall_s: fall * rise_s };
        let (charging, ideal) = (PeriodicCharging::new(times, hz), PeriodicCharging::new(ChargingTimes::default(), hz));
        let widest = (1.0 - 2.0 * hz * 200e-6_f64).min(0.96);
        let mut before = 0.0;
        for k in 1..=60 {
            let width = widest * f64::from(k) / 60.0;
            let force = charging.force_harmonic_phasor_per_n_at_rail_voltage(1.0, width).norm();
            prop_assert!(force <= ideal.force_harmonic_phasor_per_n_at_rail_voltage(1.0, width).norm() * (1.0 + 1e-12));
            prop_assert!(charging.mean_sum_of_squared_electrode_voltages_over_rail_squared(width) <= width * (1.0 + 1e-12));
            prop_assert!(force > before, "{force} at {width}");
            prop_assert!(charging.force_phase_relative_to_windows_rad(width) <= 1e-12);
            before = force;
        }
    }

    #[test]
    fn the_width_of_a_force_has_that_force(
        rise_us in 0.0_f64..500.0,
        fall in 0.0_f64..=1.0,
        hz in 40.0_f64..1000.0,
        full in 0.05_f64..1.0,
        fraction in 0.001_f64..=1.0,
    ) {
        let times = ChargingTimes { rise_s: rise_us * 1e-6, hold_s: 0.0, fall_s: fall * rise_us * 1e-6 };
        let charging = PeriodicCharging::new(times, hz);
        let full = full * (1.0 - 2.0 * hz * 200e-6_f64).min(0.96);
        let width = charging.find_pulse_width_for_force_fraction(full, fraction);
        let (wanted, found) = (charging.force_harmonic_phasor_per_n_at_rail_voltage(1.0, full).norm() * fraction, charging.force_harmonic_phasor_per_n_at_rail_voltage(1.0, width).norm());
        prop_assert!((found / wanted - 1.0).abs() < 1e-9, "{found} {wanted}");
        prop_assert!(width <= full * (1.0 + 1e-12));
    }

    /// Time has no unit of its own: the same circuit in slower time, at a lower frequency.
    #[test]
    fn frequency_times_time_constant_is_all_there_is(
        rise_us in 1.0_f64..300.0,
        hold_us in 0.0_f64..40.0,
        hz in 40.0_f64..400.0,
        factor in 0.3_f64..3.0,
        width in 0.1_f64..0.8,
    ) {
        let at = |a: f64| {
            let times = ChargingTimes { rise_s: rise_us * 1e-6 / a, hold_s: hold_us * 1e-6 / a, fall_s: 0.3e-6 * rise_us / a };
            PeriodicCharging::new(times, a * hz)
        };
        for n in [1.0, 3.0, 5.0] {
            let (one, other) = (at(1.0).force_harmonic_phasor_per_n_at_rail_voltage(n, width), at(factor).force_harmonic_phasor_per_n_at_rail_voltage(n, width));
            prop_assert!((one - other).norm() < 1e-11, "{n}: {one} {other}");
        }
    }
}

/// Without resistors the contract's law, 4/(n pi) sin(n pi w/2), and nearly so with hardly any.
#[test]
fn hardly_any_resistance_is_the_contracts_law() {
    for (hz, width) in [(40.0, 0.3), (200.0, 2.0 / 3.0), (400.0, 0.84)] {
        for n in [1.0, 3.0, 5.0, 7.0] {
            let law = 4.0 / (n * PI) * (n * PI * width / 2.0).sin();
            let none = PeriodicCharging::new(ChargingTimes::default(), hz)
                .force_harmonic_phasor_per_n_at_rail_voltage(n, width);
            assert!((none - law).norm() < 1e-14, "{none} {law}");
            let hardly = times(1e-12, 1e3, 1e3, 0.0);
            let found = PeriodicCharging::new(hardly, hz).force_harmonic_phasor_per_n_at_rail_voltage(n, width);
            assert!((found - law).norm() < 1e-5, "{found} {law}");
        }
    }
}

/// Level and phase of the fundamental against instantaneous charging, in dB and degrees: the table of docs/src/accuracy.md. The numbers are
/// those of a program in Python that marches the voltage (classical Runge-Kutta, Simpson's rule).
#[test]
fn levels_and_phases_of_some_circuits() {
    // pF, Mohm up, Mohm down, us late, then at 200 Hz and 2/3, 200 Hz and 0.920, 500 Hz and 2/3, 500 Hz and 0.800.
    let known: [([f64; 4], [[f64; 2]; 4]); 6] = [
        ([100.0, 1.0, 1.0, 0.0], [[-0.39, -7.0], [-0.14, -7.1], [-1.21, -16.6], [-0.85, -17.0]]),
        ([100.0, 1.0, 0.1, 0.0], [[-0.55, -5.4], [-0.18, -5.5], [-1.68, -12.1], [-1.13, -12.6]]),
        ([100.0, 1.0, 0.1, 40.0], [[-0.40, -6.8], [-0.13, -6.9], [-1.21, -15.9], [-0.83, -16.4]]),
        ([116.0, 1.0, 0.1, 0.0], [[-0.65, -6.2], [-0.22, -6.4], [-2.03, -13.6], [-1.39, -14.3]]),
        ([116.0, 1.0, 0.1, 15.0], [[-0.59, -6.7], [-0.20, -6.9], [-1.84, -15.0], [-1.26, -15.7]]),
        ([116.0, 1.0, 0.1, 40.0], [[-0.50, -7.6], [-0.17, -7.8], [-1.53, -17.4], [-1.07, -18.1]]),
    ];
    for ([picofarads, up, down, late], expected) in known {
        let own = times(picofarads * 1e-12, up * 1e6, down * 1e6, late * 1e-6);
        for ((hz, width), [decibels, degrees]) in
            [(200.0, 2.0 / 3.0), (200.0, 0.92), (500.0, 2.0 / 3.0), (500.0, 0.8)].into_iter().zip(expected)
        {
            let phasor = PeriodicCharging::new(own, hz).force_harmonic_phasor_per_n_at_rail_voltage(1.0, width);
            let ideal = PeriodicCharging::new(ChargingTimes::default(), hz)
                .force_harmonic_phasor_per_n_at_rail_voltage(1.0, width);
            let level = 20.0 * (phasor.norm() / ideal.norm()).log10();
            let phase = phasor.arg().to_degrees();
            let third =
                PeriodicCharging::new(own, hz).force_harmonic_phasor_over_fundamental_amplitude(3.0, width).norm();
            println!(
                "{picofarads} pF, {up} and {down} Mohm, {late} us late, {hz} Hz, {width:.3}: {level:.2} dB, {phase:.1} degrees, \
                 third harmonic {third:.3}"
            );
            assert!((level - decibels).abs() <= 0.0051 && (phase - degrees).abs() <= 0.051, "{level} {phase}");
        }
    }
}

/// The third harmonic, which the pulse width 2/3 drops without resistors.
#[test]
fn two_thirds_has_a_third_harmonic_behind_resistors() {
    let own = times(116e-12, 1e6, 1e5, 0.0);
    for (hz, known) in [(100.0, 0.060), (200.0, 0.119), (300.0, 0.17), (500.0, 0.243)] {
        let found =
            PeriodicCharging::new(own, hz).force_harmonic_phasor_over_fundamental_amplitude(3.0, 2.0 / 3.0).norm();
        assert!((found - known).abs() < 0.005, "{hz}: {found}");
    }
}

/// The steps of one electrode, whatever they are, have the harmonics of its voltage: Fourier's sum over step means is that of the voltage
/// less what a mean over a step takes, (pi n f h)^2 / 6. And Parseval's sum over harmonics is the mean square of v_A^2 - v_B^2.
#[test]
fn stepped_electrodes_have_the_same_harmonics() {
    let circuits = [
        times(116e-12, 1e6, 1e5, 0.0),
        times(116e-12, 1e6, 1e5, 40e-6),
        times(100e-12, 1e6, 1e6, 0.0),
        times(300e-12, 1e6, 0.0, 20e-6),
    ];
    for own in circuits {
        for (hz, width, step_s) in [(200.0, 2.0 / 3.0, 25e-6), (400.0, 0.5, 25e-6), (125.0, 0.9, 40e-6)] {
            let charging = PeriodicCharging::new(own, hz);
            let (period, window) = (1.0 / hz, 0.5 * width / hz);
            let steps = (period / step_s).round() as i32;
            let mut electrode = ChargingElectrode::default();
            let (mut sum, mut mean) = (Complex64::ZERO, 0.0);
            for cycle in 0..6 {
                for k in 0..steps {
                    let from = f64::from(k) * step_s;
                    // A's window begins a tenth of a period in.
                    let (on, off) = (0.1 * period, 0.1 * period + window);
                    let cut = (on.max(from) - from, off.min(from + step_s) - from);
                    let on_s = (cut.1 > cut.0).then_some(cut);
                    let square = electrode.advance_step_and_get_mean_square_v2(own, 1.0, on_s, step_s);
                    if cycle == 5 {
                        let middle = from + 0.5 * step_s - 0.1 * period - 0.5 * window;
                        sum += Complex64::cis(-TAU * hz * middle) * (4.0 * hz * step_s * square);
                        mean += 2.0 * hz * step_s * square;
                    }
                }
            }
            let expected = charging.force_harmonic_phasor_per_n_at_rail_voltage(1.0, width);
            assert!((sum - expected).norm() < 3e-4 * expected.norm(), "{hz}: {sum} {expected}");
            assert!(
                (mean - charging.mean_sum_of_squared_electrode_voltages_over_rail_squared(width)).abs() < 1e-5,
                "{mean}"
            );
        }
        // In fine steps: half the sum of squared amplitudes against the mean of (v_A^2 - v_B^2)^2, B half a period later.
        let (hz, width, count) = (200.0, 2.0 / 3.0, 20_000_usize);
        let charging = PeriodicCharging::new(own, hz);
        let step_s = 1.0 / hz / count as f64;
        let mut electrode = ChargingElectrode::default();
        let mut squares = vec![0.0; count];
        for _ in 0..4 {
            for (k, square) in squares.iter_mut().enumerate() {
                let on_s = (k < count / 3).then_some((0.0, step_s));
                *square = electrode.advance_step_and_get_mean_square_v2(own, 1.0, on_s, step_s);
            }
        }
        let force = |k: usize| squares[k] - squares[(k + count / 2) % count];
        let mean = (0..count).map(|k| force(k).powi(2)).sum::<f64>() / count as f64;
        let sum: f64 = (0..4000)
            .map(|k| 0.5 * charging.force_harmonic_phasor_per_n_at_rail_voltage(f64::from(2 * k + 1), width).norm_sqr())
            .sum();
        assert!((sum / mean - 1.0).abs() < 2e-4, "{sum} {mean}");
    }
}

/// 1 Mohm and 100 pF both ways: 13.5 % of the voltage are left after the guard of 200 us, 270 V of 2 kV.
#[test]
fn what_is_left_after_the_guard() {
    let mut electrode = ChargingElectrode { volts: 2000.0, waited_s: 0.0 };
    electrode.advance_step_and_get_mean_square_v2(times(100e-12, 1e6, 1e6, 0.0), 2000.0, None, 200e-6);
    assert!((electrode.volts - 270.7).abs() < 0.5, "{}", electrode.volts);
    // The stage: half after 81 us, as simulated within 3 % (79 us).
    let mut rising = ChargingElectrode::default();
    rising.advance_step_and_get_mean_square_v2(times(116e-12, 1e6, 1e5, 0.0), 2000.0, Some((0.0, 79e-6)), 79e-6);
    assert!((rising.volts / 2000.0 - 0.5).abs() < 0.015, "{}", rising.volts);
    rising.advance_step_and_get_mean_square_v2(times(116e-12, 1e6, 1e5, 0.0), 2000.0, Some((0.0, 182e-6)), 182e-6);
    assert!((rising.volts / 2000.0 - 0.9).abs() < 0.01, "{}", rising.volts);
}
