//! Electrodes behind resistors: how their voltage follows the windows of a drive, and what that makes of the force.
//!
//! With T the period, W = w T / 2 the window's length, v the voltage over the rail's and s the time since the window's beginning, v rises
//! with the time constant of the upper switch, v' = (1 - v) / rise, for the window; it stays for `hold`, as the lower switch is late; and
//! it falls with the time constant of the lower switch, v' = -v / fall, for the rest L of the period. With a = e^(-W / rise) and
//! b = e^(-L / fall), periodicity gives the voltages at the end and at the beginning of the window:
//!
//!   v1 = (1 - a) / (1 - a b),   v0 = b v1.
//!
//! B does half a period later what A does, so that even harmonics of F ~ v_A^2 - v_B^2 vanish and odd ones double. v^2 is a sum of
//! exponentials, so that each harmonic is a sum of integrals of e^(-s / decay) e^(-j n w s).
//!
//! What a window gains after its end, while v stays and falls, is at most what it has lost while v rose, as long as `hold` and `fall` are at
//! most `rise`, which scenes are held to: fundamental and mean square are at most those without resistors.

use crate::physics::secants::approximate_zero_of_increasing_function_by_secants;
use crate::scene::ChargingTimes;
use num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, TAU};

/// How near, as a part of the force, secants have to come to a wanted one.
const SAME_FORCE: f64 = 1e-10;
/// Halvings of the pulse width where they do not: to 1e-12 of it.
const WIDTH_HALVINGS: usize = 40;

/// An electrode's voltage under the windows of one frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeriodicCharging {
    times: ChargingTimes,
    frequency_hz: f64,
}

/// Time constants after which 1 - v is 6e-6.
const RISEN: f64 = 12.0;
/// Time constants after which v^2 is 1e-7.
const FALLEN: f64 = 8.0;

/// The pieces of a period, and the voltage, as a part of the rail's, at the window's beginning and end.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WindowShape {
    window_s: f64,
    rest_s: f64,
    begin: f64,
    end: f64,
}

impl PeriodicCharging {
    /// Of electrodes with these times, driven at a frequency.
    #[must_use]
    pub const fn new(times: ChargingTimes, frequency_hz: f64) -> Self {
        Self { times, frequency_hz }
    }

    /// Whether electrodes follow their switches at once.
    #[must_use]
    pub fn is_instant(&self) -> bool {
        self.times.is_instant()
    }

    /// The times.
    #[must_use]
    pub const fn times(&self) -> ChargingTimes {
        self.times
    }

    fn window_times_and_voltage_fractions_at_its_edges(&self, pulse_width: f64) -> WindowShape {
        let ChargingTimes { rise_s, hold_s, fall_s } = self.times;
        let window_s = 0.5 * pulse_width / self.frequency_hz;
        let rest_s = (1.0 / self.frequency_hz - window_s - hold_s).max(0.0);
        // The lower switch takes all of it if it has no resistance.
        let fallen = if fall_s > 0.0 { rest_s / fall_s } else { f64::INFINITY };
        let end = (-window_s / rise_s).exp_m1() / (-window_s / rise_s - fallen).exp_m1();
        WindowShape { window_s, rest_s, begin: end * (-fallen).exp(), end }
    }

    /// The course of the voltage of an electrode that charges through a resistor.
    #[must_use]
    pub fn voltage_course(&self, pulse_width: f64) -> VoltageCourse {
        VoltageCourse { times: self.times, shape: self.window_times_and_voltage_fractions_at_its_edges(pulse_width) }
    }

    /// Phasor of the force's `harmonic`-th harmonic per N of one electrode's steady force at the rail's voltage, time counted from the
    /// middle of A's window; `harmonic` is odd. Without resistors 4/(n pi) sin(n pi w/2).
    #[must_use]
    pub fn force_harmonic_phasor_per_n_at_rail_voltage(&self, harmonic: f64, pulse_width: f64) -> Complex64 {
        if self.is_instant() {
            return Complex64::from((harmonic * FRAC_PI_2 * pulse_width).sin() * 2.0 / (harmonic * FRAC_PI_2));
        }
        let ChargingTimes { rise_s, hold_s, fall_s } = self.times;
        let WindowShape { window_s, rest_s, begin, end } =
            self.window_times_and_voltage_fractions_at_its_edges(pulse_width);
        let jw = Complex64::new(0.0, TAU * harmonic * self.frequency_hz);
        let missing = 1.0 - begin;
        let held = end * end * (-jw * window_s).exp();
        let integral = fourier_integral_of_unit_window(jw, window_s)
            - 2.0 * missing * fourier_integral_of_decay(rise_s, jw, window_s)
            + missing * missing * fourier_integral_of_decay(0.5 * rise_s, jw, window_s)
            + held * fourier_integral_of_unit_window(jw, hold_s)
            + held * (-jw * hold_s).exp() * fourier_integral_of_decay(0.5 * fall_s, jw, rest_s);
        integral * (jw * 0.5 * window_s).exp() * (4.0 * self.frequency_hz)
    }

    /// Amplitude of the force's harmonic in N where one electrode pulls with `rest_force_n` at the rail's voltage.
    #[must_use]
    pub fn harmonic_amplitude_n(&self, rest_force_n: f64, harmonic: f64, pulse_width: f64) -> f64 {
        if self.is_instant() {
            return rest_force_n * (harmonic * FRAC_PI_2 * pulse_width).sin().abs() * 2.0 / (harmonic * FRAC_PI_2);
        }
        rest_force_n * self.force_harmonic_phasor_per_n_at_rail_voltage(harmonic, pulse_width).norm()
    }

    /// That harmonic over the amplitude of the fundamental: sin(n pi w/2) / (n sin(pi w/2)) without resistors.
    #[must_use]
    pub fn force_harmonic_phasor_over_fundamental_amplitude(&self, harmonic: f64, pulse_width: f64) -> Complex64 {
        if self.is_instant() {
            let ratio = (harmonic * FRAC_PI_2 * pulse_width).sin() / (harmonic * (FRAC_PI_2 * pulse_width).sin());
            return Complex64::from(ratio);
        }
        self.force_harmonic_phasor_per_n_at_rail_voltage(harmonic, pulse_width)
            / self.force_harmonic_phasor_per_n_at_rail_voltage(1.0, pulse_width).norm()
    }

    /// Phase in rad of the force's fundamental relative to its windows': 0 or negative.
    #[must_use]
    pub fn force_phase_relative_to_windows_rad(&self, pulse_width: f64) -> f64 {
        if self.is_instant() || pulse_width <= 0.0 {
            0.0
        } else {
            self.force_harmonic_phasor_per_n_at_rail_voltage(1.0, pulse_width).arg()
        }
    }

    /// Mean over time of both electrodes' squared voltages, as a part of the rail's; without resistors the pulse width.
    #[must_use]
    pub fn mean_sum_of_squared_electrode_voltages_over_rail_squared(&self, pulse_width: f64) -> f64 {
        if self.is_instant() {
            return pulse_width;
        }
        let ChargingTimes { rise_s, hold_s, fall_s } = self.times;
        let WindowShape { window_s, rest_s, begin, end } =
            self.window_times_and_voltage_fractions_at_its_edges(pulse_width);
        let missing = 1.0 - begin;
        let left = |decay_s: f64, length_s: f64| if decay_s > 0.0 { -(-length_s / decay_s).exp_m1() } else { 1.0 };
        let integral = window_s - 2.0 * missing * rise_s * left(rise_s, window_s)
            + missing * missing * 0.5 * rise_s * left(0.5 * rise_s, window_s)
            + end * end * (hold_s + 0.5 * fall_s * left(0.5 * fall_s, rest_s));
        2.0 * self.frequency_hz * integral
    }

    /// Pulse width up to `full_width` whose fundamental is `force_fraction` of that of `full_width`; force grows with the width.
    #[must_use]
    pub fn find_pulse_width_for_force_fraction(&self, full_width: f64, force_fraction: f64) -> f64 {
        if self.is_instant() {
            return (force_fraction * (FRAC_PI_2 * full_width).sin()).asin() / FRAC_PI_2;
        }
        if force_fraction >= 1.0 || full_width <= 0.0 {
            return full_width;
        }
        let wanted = force_fraction * self.force_harmonic_phasor_per_n_at_rail_voltage(1.0, full_width).norm();
        let beyond =
            |pulse_width: f64| self.force_harmonic_phasor_per_n_at_rail_voltage(1.0, pulse_width).norm() - wanted;
        let near = approximate_zero_of_increasing_function_by_secants(&beyond, full_width);
        if beyond(near).abs() <= SAME_FORCE * wanted {
            return near;
        }
        let (mut low, mut high) = (0.0, full_width);
        for _ in 0..WIDTH_HALVINGS {
            let middle = 0.5 * (low + high);
            *(if beyond(middle) <= 0.0 { &mut low } else { &mut high }) = middle;
        }
        low
    }
}

/// The voltage of one electrode over a period, as a part of the rail's; times in s from the window's beginning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoltageCourse {
    times: ChargingTimes,
    shape: WindowShape,
}

impl VoltageCourse {
    /// Length of the window in s.
    #[must_use]
    pub const fn window_s(&self) -> f64 {
        self.shape.window_s
    }

    /// Begin and length in s of the stretches that matter: the rise, the time for which the voltage hardly changes, and the fall to
    /// where v^2 is 1e-7.
    #[must_use]
    pub fn begin_and_length_of_rise_plateau_and_fall_s(&self) -> [(f64, f64); 3] {
        let WindowShape { window_s, rest_s, .. } = self.shape;
        let risen_s = window_s.min(RISEN * self.times.rise_s);
        let held_s = window_s + self.times.hold_s;
        [(0.0, risen_s), (risen_s, held_s - risen_s), (held_s, rest_s.min(FALLEN * self.times.fall_s))]
    }

    /// The voltage at a time from 0 to a period.
    #[must_use]
    pub fn fraction_at(&self, at_s: f64) -> f64 {
        let WindowShape { window_s, begin, end, .. } = self.shape;
        let since_s = at_s - window_s - self.times.hold_s;
        match () {
            () if at_s < window_s => 1.0 - (1.0 - begin) * (-at_s / self.times.rise_s).exp(),
            () if since_s <= 0.0 => end,
            () if self.times.fall_s > 0.0 => end * (-since_s / self.times.fall_s).exp(),
            () => 0.0,
        }
    }
}

/// Voltage in V below which an electrode has none: its force is 1e-18 of that at 1 kV.
const NO_VOLTAGE_V: f64 = 1e-6;

/// One electrode in time, from step to step, under any windows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChargingElectrode {
    volts: f64,
    /// For how long the window has been over, at most until the electrode falls.
    waited_s: f64,
}

impl ChargingElectrode {
    /// Its voltage in V.
    #[must_use]
    pub const fn volts(&self) -> f64 {
        self.volts
    }

    /// Mean over a step of the squared voltage in V^2; the electrode is then where the step leaves it. `on_s` is the stretch of the step,
    /// from and to in s from its beginning, in which the upper switch is on to a rail of `rail_v`.
    pub fn advance_step_and_get_mean_square_v2(
        &mut self,
        times: ChargingTimes,
        rail_v: f64,
        on_s: Option<(f64, f64)>,
        step_s: f64,
    ) -> f64 {
        let (from_s, to_s) = on_s.unwrap_or((step_s, step_s));
        let mut integral = self.hold_then_fall_and_integrate_squared_volts(times, from_s);
        if to_s > from_s {
            integral += self.charge_towards_and_integrate_squared_volts(rail_v, times.rise_s, to_s - from_s);
            self.waited_s = 0.0;
            integral += self.hold_then_fall_and_integrate_squared_volts(times, step_s - to_s);
        }
        if self.volts < NO_VOLTAGE_V {
            self.volts = 0.0;
        }
        integral / step_s
    }

    /// Stays for what is left of the delay, then falls; returns the integral of the squared voltage in V^2 s.
    fn hold_then_fall_and_integrate_squared_volts(&mut self, times: ChargingTimes, length_s: f64) -> f64 {
        // Begin and end of a stretch may be beyond the step's by rounding.
        let length_s = length_s.max(0.0);
        let wait_s = (times.hold_s - self.waited_s).clamp(0.0, length_s);
        self.waited_s += wait_s;
        self.volts * self.volts * wait_s
            + self.charge_towards_and_integrate_squared_volts(0.0, times.fall_s, length_s - wait_s)
    }

    /// Goes to `target_v` for `length_s`; returns the integral of the squared voltage in V^2 s.
    fn charge_towards_and_integrate_squared_volts(
        &mut self,
        target_v: f64,
        time_constant_s: f64,
        length_s: f64,
    ) -> f64 {
        if length_s <= 0.0 {
            return 0.0;
        }
        let away_v = target_v - self.volts;
        let left = if time_constant_s > 0.0 { (-length_s / time_constant_s).exp() } else { 0.0 };
        self.volts = target_v - away_v * left;
        target_v * target_v * length_s - 2.0 * target_v * away_v * time_constant_s * (1.0 - left)
            + away_v * away_v * 0.5 * time_constant_s * (1.0 - left * left)
    }
}

/// Integral from 0 to `length_s` of e^(-`jw` s).
fn fourier_integral_of_unit_window(jw: Complex64, length_s: f64) -> Complex64 {
    (1.0 - (-jw * length_s).exp()) / jw
}

/// Integral from 0 to `length_s` of e^(-s / `decay_s`) e^(-`jw` s); 0 for a decay in no time.
fn fourier_integral_of_decay(decay_s: f64, jw: Complex64, length_s: f64) -> Complex64 {
    if decay_s <= 0.0 {
        return Complex64::ZERO;
    }
    decay_s * (1.0 - (-length_s / decay_s - jw * length_s).exp()) / (1.0 + jw * decay_s)
}

#[cfg(test)]
mod tests;
