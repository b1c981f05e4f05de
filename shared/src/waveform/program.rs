//! From a drive in SI units to the numbers for a timer, in integer arithmetic.

use super::drive_error::DriveError;
use super::period::{TimerPeriod, first_window_start};
use crate::limits::LEAST_GUARD_NANOSECONDS;
use crate::protocol::{AchievedDrive, ChannelDrive, ChannelLimits};
use crate::supply::round_down_to_dac_step_millivolts;

/// Parts per million.
const PPM: u64 = 1_000_000;
/// Millionths of a turn.
const TURN: u32 = 1_000_000;
/// How many prescalers are tried beyond the least possible one. Each costs less than 1/n of the resolution and the best
/// of them brings the frequency nearer than half a tick of the first would.
const PRESCALERS_TRIED: u64 = 8;

/// Numbers for one channel's timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelProgram {
    /// Clocks in a tick.
    pub divider: u32,
    /// Ticks in a period.
    pub ticks: u32,
    /// Ticks of each window at full level.
    pub width: u32,
    /// Clocks from a boundary to the common time origin: the phase.
    pub origin_clocks: u64,
    /// Voltage of the electrodes in mV.
    pub voltage_millivolts: u32,
    /// The drive that these numbers achieve.
    pub achieved: AchievedDrive,
}

impl ChannelProgram {
    /// The period at full level.
    #[must_use]
    pub fn full_level_period(&self) -> TimerPeriod {
        TimerPeriod::with_windows(self.divider, self.ticks, self.width, false)
    }

    /// Clocks in a period.
    #[must_use]
    pub const fn period_clocks(&self) -> u64 {
        self.divider as u64 * self.ticks as u64
    }
}

/// Turns a drive into numbers for the timer and says what they achieve.
///
/// The frequency is the nearest that a prescaler and an auto-reload value give: with at least 43 000 ticks in a period half
/// a tick is under 12 ppm (170 MHz clock, 1..1000 Hz). The pulse width and the voltage are rounded down.
///
/// # Errors
/// [`DriveError`] with the limits for everything out of range; nothing is clamped.
pub fn compute_channel_program(limits: &ChannelLimits, drive: &ChannelDrive) -> Result<ChannelProgram, DriveError> {
    let frequency = drive.frequency_millihertz;
    let least_frequency = limits.min_frequency_millihertz.max(1);
    if frequency < least_frequency || frequency > limits.max_frequency_millihertz {
        return Err(DriveError::Frequency {
            requested_millihertz: frequency,
            min_millihertz: least_frequency,
            max_millihertz: limits.max_frequency_millihertz,
        });
    }
    if drive.voltage_millivolts > limits.max_voltage_millivolts {
        return Err(DriveError::Voltage {
            requested_millivolts: drive.voltage_millivolts,
            max_millivolts: limits.max_voltage_millivolts,
        });
    }
    if drive.phase_microturns >= TURN {
        return Err(DriveError::Phase { requested_microturns: drive.phase_microturns });
    }
    let (divider, ticks) = find_divider_and_ticks(limits.timer_clock_hz, frequency)
        .ok_or(DriveError::NotRepresentable { timer_clock_hz: limits.timer_clock_hz })?;
    let (clock, ticks_u64) = (u64::from(limits.timer_clock_hz), u64::from(ticks));

    let width = saturate_to_u32(ticks_u64 * u64::from(drive.pulse_width_ppm) / (2 * PPM));
    // One tick more than the guard time, so that its halves at the boundary are each half of it or more.
    let guard_ns = limits.min_guard_ns.max(LEAST_GUARD_NANOSECONDS);
    let guard =
        saturate_to_u32((u64::from(guard_ns) * clock).div_ceil(1_000_000_000 * u64::from(divider))).saturating_add(1);
    let widest = (ticks / 2).saturating_sub(guard);
    if width > widest {
        return Err(DriveError::PulseTooWide {
            requested_ppm: drive.pulse_width_ppm,
            widest_ppm: saturate_to_u32(u64::from(widest) * 2 * PPM / ticks_u64),
            min_guard_ns: guard_ns,
        });
    }
    if width == 0 {
        return Err(DriveError::PulseTooNarrow {
            requested_ppm: drive.pulse_width_ppm,
            narrowest_ppm: saturate_to_u32((2 * PPM).div_ceil(ticks_u64)),
        });
    }

    let period_clocks = ticks_u64 * u64::from(divider);
    // The force is at its greatest in the middle of A's window, which may fall between two ticks: in half clocks.
    let centre = u64::from(2 * first_window_start(ticks, width) + width) * u64::from(divider);
    let turn = 2 * period_clocks;
    let wanted = (u64::from(drive.phase_microturns) * turn + u64::from(TURN / 2)) / u64::from(TURN);
    let origin_clocks = (centre + wanted).div_ceil(2) % period_clocks;
    let reached = (2 * origin_clocks + turn - centre) % turn;
    let phase = (reached * u64::from(TURN) + period_clocks) / turn;
    // The shorter of the two guards: the half period is rounded down between A and B.
    let guard_ticks = u64::from(ticks / 2 - width);
    let voltage_millivolts = round_down_to_dac_step_millivolts(drive.voltage_millivolts);
    Ok(ChannelProgram {
        divider,
        ticks,
        width,
        origin_clocks,
        voltage_millivolts,
        achieved: AchievedDrive {
            channel: drive.channel,
            frequency_nanohertz: (clock * 1_000_000_000 + period_clocks / 2) / period_clocks,
            pulse_width_ppm: saturate_to_u32(u64::from(width) * 2 * PPM / ticks_u64),
            phase_microturns: saturate_to_u32(phase) % TURN,
            guard_ns: saturate_to_u32(guard_ticks * u64::from(divider) * 1_000_000_000 / clock),
            voltage_millivolts,
        },
    })
}

/// Clock divider (prescaler plus one) and ticks in a period (auto-reload value plus one) that come nearest to `frequency`.
fn find_divider_and_ticks(clock_hz: u32, frequency_millihertz: u32) -> Option<(u32, u32)> {
    // A period in clocks is 1000 clock / frequency: kept as a fraction so that nothing is lost.
    let (numerator, denominator) = (u64::from(clock_hz) * 1000, u64::from(frequency_millihertz));
    let most = u64::from(TimerPeriod::MOST_TICKS);
    let least = numerator.div_ceil(denominator * most).max(1);
    let mut best: Option<(u64, u32, u32)> = None;
    for divider in least..least + PRESCALERS_TRIED {
        let step = denominator * divider;
        let ticks = (numerator + step / 2) / step;
        if divider > u64::from(TimerPeriod::MOST_DIVIDER) || !(8..=most).contains(&ticks) {
            continue;
        }
        // Compares |ticks x divider - period| across dividers; the common denominator drops out.
        let error = (ticks * step).abs_diff(numerator);
        if best.is_none_or(|(least_error, ..)| error < least_error) {
            best = Some((error, saturate_to_u32(divider), saturate_to_u32(ticks)));
        }
    }
    best.map(|(_, divider, ticks)| (divider, ticks))
}

// The callers' arithmetic keeps these in range; saturating keeps a mistake from becoming a short window.
fn saturate_to_u32(value: u64) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}
