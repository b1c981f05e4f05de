//! What a drive costs a channel's credit, by its force.

use crate::waveform::TimerPeriod;
use crate::waveform::sine::{ONE, quarter_sine_q30_upper_bound};

/// Parts of [`CreditCharge::FULL`].
const PPM: u32 = 1_000_000;

/// What a drive costs: credit per time, in millionths of what driving at the channel's largest force costs, rounded up.
///
/// Exposure goes with the square of the acceleration and the time: A(8)^2 is the mean of a^2 over 8 h (EU 2002/44/EC, annex, part
/// A; ISO 5349-1). A panel's acceleration goes with the force, so that a drive costs (F / F_max)^2. The fundamental of an ERA's
/// force is 4/pi eps0 S U^2 / (2 g^2) sin(pi w/2), with the voltage U and w, the part of a half period for which an electrode
/// is on; the rest is the same for every drive of a channel, so that
///
/// F / F_max = (U / U_max)^2 sin(pi w/2)
///
/// where F_max is the force at the channel's highest voltage and w = 1, which guard times keep every drive below.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct CreditCharge(u32);

impl CreditCharge {
    /// No force.
    pub const NONE: Self = Self(0);
    /// The largest force: as much credit as time. Nothing costs more, a rail above its limit does not either.
    pub const FULL: Self = Self(PPM);

    /// What a period costs on a rail of `millivolts`, on a channel whose limit is `max_millivolts`.
    ///
    /// In integers, each step rounded up: never below the exact value, and above it by less than 3e-5 of [`Self::FULL`]. A higher voltage
    /// or a wider window never costs less.
    #[must_use]
    pub fn from_period(period: &TimerPeriod, millivolts: u32, max_millivolts: u32) -> Self {
        let width = ratio_q30_rounded_up_capped(2 * u32::from(period.widest_window_ticks()), period.ticks);
        Self::from_width_sine_and_voltage(quarter_sine_q30_upper_bound(width), millivolts, max_millivolts)
    }

    /// The most that any windows cost on a rail of `millivolts`, on a channel whose limit is `max_millivolts`.
    #[must_use]
    pub fn from_voltage_with_widest_windows(millivolts: u32, max_millivolts: u32) -> Self {
        Self::from_width_sine_and_voltage(ONE, millivolts, max_millivolts)
    }

    fn from_width_sine_and_voltage(width_sine_q30: u32, millivolts: u32, max_millivolts: u32) -> Self {
        let voltage = ratio_q30_rounded_up_capped(millivolts, max_millivolts);
        let force = multiply_q30_rounding_up(multiply_q30_rounding_up(voltage, voltage), width_sine_q30);
        // Below 2^51, and no more than PPM.
        let ppm = (u64::from(multiply_q30_rounding_up(force, force)) * u64::from(PPM)).div_ceil(u64::from(ONE));
        Self(u32::try_from(ppm).unwrap_or(PPM).min(PPM))
    }

    /// In millionths of [`Self::FULL`].
    #[must_use]
    pub const fn as_ppm(self) -> u32 {
        self.0
    }
}

/// `numerator / denominator` with 30 bits behind the point, rounded up; 1 at most, also if `denominator` is 0 and `numerator` is not.
fn ratio_q30_rounded_up_capped(numerator: u32, denominator: u32) -> u32 {
    if numerator == 0 {
        return 0;
    }
    if numerator >= denominator {
        return ONE;
    }
    u32::try_from((u64::from(numerator) << 30).div_ceil(u64::from(denominator))).unwrap_or(ONE)
}

/// Product of two numbers up to 1 with 30 bits behind the point, rounded up.
fn multiply_q30_rounding_up(a: u32, b: u32) -> u32 {
    u32::try_from((u64::from(a) * u64::from(b)).div_ceil(u64::from(ONE))).unwrap_or(ONE)
}
