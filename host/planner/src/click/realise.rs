//! From a force in a slot to a window of an electrode.

use crate::scene::ChargingTimes;
use era_shared::limits::GUARD_NANOSECONDS;
use era_shared::waveform::LEAST_WIDTH_TICKS;
use num_complex::Complex64;

/// Length of a slot in s: a window, and the guard before the next.
pub const SLOT_S: f64 = 1e-3;
/// Widest window in s: what the guard leaves of a slot, less 10 us for what windows are moved by.
pub const WIDEST_S: f64 = SLOT_S - GUARD_NANOSECONDS as f64 * 1e-9 - 10e-6;
/// A board's tick in s: 17 clocks of 170 MHz.
pub const TICK_S: f64 = 1e-7;
/// Halvings of a width: to less than a tick of 0.1 us.
const WIDTH_HALVINGS: u32 = 20;

/// Narrowest window in s that a board takes.
#[must_use]
pub fn narrowest_window_s() -> f64 {
    f64::from(LEAST_WIDTH_TICKS) * TICK_S
}

/// Integral in s of the squared voltage of an electrode, as a part of the rail's, over a window of `width_s` and what follows it. The electrode
/// begins and ends discharged.
#[must_use]
pub fn integrate_squared_relative_voltage_of_window_s(times: ChargingTimes, width_s: f64) -> f64 {
    let ChargingTimes { rise_s, hold_s, fall_s } = times;
    let left = if rise_s > 0.0 { (-width_s / rise_s).exp() } else { 0.0 };
    let risen = width_s - 2.0 * rise_s * (1.0 - left) + 0.5 * rise_s * (1.0 - left * left);
    risen + (1.0 - left).powi(2) * (hold_s + 0.5 * fall_s)
}

/// Fourier integral in s of the same, from the window's begin on, at an angular frequency above 0.
#[must_use]
pub fn fourier_integral_of_squared_relative_voltage_of_window_s(
    times: ChargingTimes,
    width_s: f64,
    omega_rad_s: f64,
) -> Complex64 {
    let ChargingTimes { rise_s, hold_s, fall_s } = times;
    let jw = Complex64::new(0.0, omega_rad_s);
    // Of a voltage that falls with the rate `rate`, over so long.
    let integrate = |rate: Complex64, length_s: f64| (1.0 - (-rate * length_s).exp()) / rate;
    let (rise, reached) = if rise_s > 0.0 {
        let rate = 1.0 / rise_s;
        let rise = integrate(jw, width_s) - 2.0 * integrate(jw + rate, width_s) + integrate(jw + 2.0 * rate, width_s);
        (rise, (1.0 - (-width_s * rate).exp()).powi(2))
    } else {
        (integrate(jw, width_s), 1.0)
    };
    let fall = if fall_s > 0.0 { 1.0 / (jw + 2.0 / fall_s) } else { Complex64::ZERO };
    let end = (-jw * width_s).exp();
    rise + reached * end * (integrate(jw, hold_s) + (-jw * hold_s).exp() * fall)
}

/// Width in s, up to [`WIDEST_S`], of the window whose integral is this part of that of the widest.
#[must_use]
pub fn find_window_width_for_force_fraction_s(times: ChargingTimes, part_of_widest: f64) -> f64 {
    let wanted_s = part_of_widest * integrate_squared_relative_voltage_of_window_s(times, WIDEST_S);
    let (mut low, mut high) = (0.0, WIDEST_S);
    for _ in 0..WIDTH_HALVINGS {
        let middle = 0.5 * (low + high);
        *(if integrate_squared_relative_voltage_of_window_s(times, middle) < wanted_s {
            &mut low
        } else {
            &mut high
        }) = middle;
    }
    high
}

/// Begin in s of a window of this width in a slot from its beginning: the mean time of its force is that of the widest window, whose motion the
/// programme knows.
#[must_use]
pub fn place_window_in_slot_s(times: ChargingTimes, width_s: f64) -> f64 {
    // At a frequency that is far below what is felt, the phase is that of the mean time.
    const OMEGA_RAD_S: f64 = 1.0;
    let mean_time_s = |width_s: f64| {
        -fourier_integral_of_squared_relative_voltage_of_window_s(times, width_s, OMEGA_RAD_S).arg() / OMEGA_RAD_S
    };
    (mean_time_s(WIDEST_S) - mean_time_s(width_s)).clamp(0.0, WIDEST_S - width_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::charging::ChargingElectrode;

    /// The closed integral is that of an electrode that is stepped in time.
    #[test]
    fn windows_charge_as_an_electrode_in_time_does() {
        for times in [
            ChargingTimes { rise_s: 0.0, hold_s: 0.0, fall_s: 0.0 },
            ChargingTimes { rise_s: 116e-6, hold_s: 15e-6, fall_s: 11.6e-6 },
            ChargingTimes { rise_s: 250e-6, hold_s: 0.0, fall_s: 250e-6 },
        ] {
            for width_s in [100e-6, 300e-6, WIDEST_S] {
                let (mut electrode, mut sum_s, step_s) = (ChargingElectrode::default(), 0.0, 5e-6);
                for step in 0..1000_u32 {
                    let from_s = f64::from(step) * step_s;
                    let on_s = (from_s < width_s).then(|| (0.0, step_s.min(width_s - from_s)));
                    sum_s += electrode.advance_step_and_get_mean_square_v2(times, 1.0, on_s, step_s) * step_s;
                }
                let found_s = integrate_squared_relative_voltage_of_window_s(times, width_s);
                assert!((found_s - sum_s).abs() < 1e-9, "{times:?} {width_s}: {found_s} {sum_s}");
            }
            for (width_s, hz) in [(300e-6, 50.0), (WIDEST_S, 480.0), (WIDEST_S, 1e-3)] {
                let omega_rad_s = std::f64::consts::TAU * hz;
                let (mut electrode, mut sum_s, step_s) = (ChargingElectrode::default(), Complex64::ZERO, 1e-6);
                for step in 0..5000_u32 {
                    let from_s = f64::from(step) * step_s;
                    let on_s = (from_s < width_s).then(|| (0.0, step_s.min(width_s - from_s)));
                    let mean = electrode.advance_step_and_get_mean_square_v2(times, 1.0, on_s, step_s);
                    sum_s += mean * step_s * Complex64::cis(-omega_rad_s * (from_s + 0.5 * step_s));
                }
                let found_s = fourier_integral_of_squared_relative_voltage_of_window_s(times, width_s, omega_rad_s);
                assert!((found_s - sum_s).norm() < 1e-8, "{times:?} {width_s} {hz} Hz: {found_s} {sum_s}");
            }
            for width_s in [300e-6, 500e-6, WIDEST_S] {
                // The mean time of the force, stepped in time.
                let mean_time_s = |begin_s: f64, width_s: f64| {
                    let (mut electrode, step_s) = (ChargingElectrode::default(), 1e-6);
                    let (mut sum, mut moment_s) = (0.0, 0.0);
                    for step in 0..5000_u32 {
                        let from_s = f64::from(step) * step_s;
                        let is_on = (begin_s..begin_s + width_s).contains(&(from_s + 0.5 * step_s));
                        let mean = electrode.advance_step_and_get_mean_square_v2(
                            times,
                            1.0,
                            is_on.then_some((0.0, step_s)),
                            step_s,
                        );
                        (sum, moment_s) = (sum + mean, moment_s + mean * (from_s + 0.5 * step_s));
                    }
                    moment_s / sum
                };
                let begin_s = place_window_in_slot_s(times, width_s);
                let off_s = mean_time_s(begin_s, width_s) - mean_time_s(0.0, WIDEST_S);
                assert!(off_s.abs() < 3e-6, "{times:?} {width_s}: {off_s}");
            }
            for part in [0.05, 0.4, 1.0] {
                let width_s = find_window_width_for_force_fraction_s(times, part);
                let found = integrate_squared_relative_voltage_of_window_s(times, width_s)
                    / integrate_squared_relative_voltage_of_window_s(times, WIDEST_S);
                assert!((found - part).abs() < 1e-4 && width_s <= WIDEST_S, "{times:?} {part}: {found}");
            }
        }
    }
}
