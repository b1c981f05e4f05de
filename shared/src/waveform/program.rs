//! Requests in SI units to what a timer must be told, in integer arithmetic.

use crate::protocol::{AchievedDrive, ChannelDrive, ChannelLimits};
use serde::{Deserialize, Serialize};

/// Parts per million.
const PPM: u64 = 1_000_000;
/// Millionths of a turn.
const TURN: u32 = 1_000_000;
/// Steps of the digital-to-analogue converter that sets a rail: 12 bits.
const RAIL_STEPS: u64 = 4095;
/// Largest value of a 16-bit auto-reload register.
const ARR_MAX: u64 = 65_535;
/// How many prescalers are tried beyond the least possible one. Each costs less than 1/n of the resolution and the best
/// of them brings the frequency nearer than half a tick of the first would.
const PRESCALERS_TRIED: u64 = 4;

/// Every way in which a drive can be out of range, with what would be in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DriveError {
    /// The board has no such channel.
    NoSuchChannel {
        /// Channels that it has.
        channels: u8,
    },
    /// Frequency below or above the limits, all in 1/1000 Hz.
    Frequency {
        /// As asked for.
        requested_millihertz: u32,
        /// Least allowed.
        min_millihertz: u32,
        /// Most allowed.
        max_millihertz: u32,
    },
    /// Voltage above the limit, in mV.
    Voltage {
        /// As asked for.
        requested_millivolts: u32,
        /// Most allowed.
        max_millivolts: u32,
    },
    /// The windows would leave less than the guard time between them.
    PulseTooWide {
        /// As asked for.
        requested_ppm: u32,
        /// Widest at this frequency.
        widest_ppm: u32,
        /// The guard time that must remain, in ns.
        min_guard_ns: u32,
    },
    /// The windows would be shorter than one tick of the timer.
    PulseTooNarrow {
        /// As asked for.
        requested_ppm: u32,
        /// Narrowest at this frequency.
        narrowest_ppm: u32,
    },
    /// Phase of a whole turn or more, in millionths of a turn.
    Phase {
        /// As asked for.
        requested_microturns: u32,
    },
    /// No prescaler and auto-reload value give this frequency from the timer's clock.
    NotRepresentable {
        /// The timer's clock in Hz.
        timer_clock_hz: u32,
    },
}

/// What one timer is told. All are register values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimerProgram {
    /// PSC: the clock is divided by this plus one.
    pub prescaler: u16,
    /// ARR: half a period in ticks.
    pub auto_reload: u16,
    /// CCR of electrode A.
    pub compare_a: u16,
    /// CCR of electrode B.
    pub compare_b: u16,
    /// CNT at the start, counting up: the phase within a half turn.
    pub start_count: u16,
    /// A's window is centred on the counter's top and B's on zero (half a turn of phase).
    pub swapped: bool,
}

/// What one channel is told: its timer and its rail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelProgram {
    /// The timer.
    pub timer: TimerProgram,
    /// Code of the 12-bit converter that sets the rail.
    pub rail_code: u16,
    /// What all this achieves.
    pub achieved: AchievedDrive,
}

/// Turns a drive into register values and says what they achieve.
///
/// The frequency is the nearest that a prescaler and an auto-reload value give: with ARR >= 27 000 half a tick is under
/// 20 ppm (170 MHz clock, 1..1000 Hz). The pulse width and the voltage are rounded down.
///
/// # Errors
/// [`DriveError`] with the limits for everything out of range; nothing is clamped.
pub fn program(limits: &ChannelLimits, drive: &ChannelDrive) -> Result<ChannelProgram, DriveError> {
    let frequency = drive.frequency_millihertz;
    if frequency < limits.min_frequency_millihertz.max(1) || frequency > limits.max_frequency_millihertz {
        return Err(DriveError::Frequency {
            requested_millihertz: frequency,
            min_millihertz: limits.min_frequency_millihertz.max(1),
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
    let (divider, reload) = divide(limits.timer_clock_hz, frequency)
        .ok_or(DriveError::NotRepresentable { timer_clock_hz: limits.timer_clock_hz })?;
    let (divider_u64, clock) = (u64::from(divider), u64::from(limits.timer_clock_hz));
    let reload_u64 = u64::from(reload);

    // A window is 2 x compare ticks wide and its half period has ARR ticks.
    let half_window = reload_u64 * u64::from(drive.pulse_width_ppm) / (2 * PPM);
    let guard_needed = (u64::from(limits.min_guard_ns) * clock).div_ceil(1_000_000_000 * divider_u64).max(1);
    let widest_half = reload_u64.saturating_sub(guard_needed) / 2;
    if half_window > widest_half {
        return Err(DriveError::PulseTooWide {
            requested_ppm: drive.pulse_width_ppm,
            widest_ppm: to_u32(widest_half * 2 * PPM / reload_u64),
            min_guard_ns: limits.min_guard_ns,
        });
    }
    if half_window == 0 {
        return Err(DriveError::PulseTooNarrow {
            requested_ppm: drive.pulse_width_ppm,
            narrowest_ppm: to_u32((2 * PPM).div_ceil(reload_u64)),
        });
    }
    let low = to_u16(half_window);
    let high = reload - low;
    let guard_ticks = u64::from(high - low);

    let (start_count, swapped) = start(reload, drive.phase_microturns);
    let max_voltage = u64::from(limits.max_voltage_millivolts);
    let rail_code = (u64::from(drive.voltage_millivolts) * RAIL_STEPS).checked_div(max_voltage).unwrap_or(0);

    let half_turns = u64::from(start_count) * u64::from(TURN / 2);
    let phase = (half_turns + reload_u64 / 2) / reload_u64 + if swapped { u64::from(TURN / 2) } else { 0 };
    let period_ticks = 2 * reload_u64 * divider_u64;
    Ok(ChannelProgram {
        timer: TimerProgram {
            prescaler: to_u16(divider_u64 - 1),
            auto_reload: reload,
            compare_a: if swapped { high } else { low },
            compare_b: if swapped { low } else { high },
            start_count,
            swapped,
        },
        rail_code: to_u16(rail_code),
        achieved: AchievedDrive {
            channel: drive.channel,
            frequency_nanohertz: (clock * 1_000_000_000 + period_ticks / 2) / period_ticks,
            pulse_width_ppm: to_u32(half_window * 2 * PPM / reload_u64),
            phase_microturns: to_u32(phase) % TURN,
            guard_ns: to_u32(guard_ticks * divider_u64 * 1_000_000_000 / clock),
            voltage_millivolts: to_u32(rail_code * max_voltage / RAIL_STEPS),
        },
    })
}

/// Clock divider (prescaler plus one) and auto-reload value that come nearest to `frequency`: a period is
/// 2 ARR (PSC + 1) clocks in centre-aligned mode.
fn divide(clock_hz: u32, frequency_millihertz: u32) -> Option<(u32, u16)> {
    // Half a period in clocks is 500 clock / frequency: kept as a fraction so that nothing is lost.
    let (numerator, denominator) = (u64::from(clock_hz) * 500, u64::from(frequency_millihertz));
    let least = numerator.div_ceil(denominator * ARR_MAX).max(1);
    let mut best: Option<(u64, u32, u16)> = None;
    for divider in least..least + PRESCALERS_TRIED {
        let step = denominator * divider;
        let reload = (numerator + step / 2) / step;
        if divider > ARR_MAX + 1 || !(4..=ARR_MAX).contains(&reload) {
            continue;
        }
        // Compares |ARR x divider - half period| across dividers; the common denominator drops out.
        let error = (reload * step).abs_diff(numerator);
        if best.is_none_or(|(least_error, ..)| error < least_error) {
            best = Some((error, to_u32(divider), to_u16(reload)));
        }
    }
    best.map(|(_, divider, reload)| (divider, reload))
}

/// Start value of the counter and whether the electrodes change places, for a phase in millionths of a turn.
fn start(reload: u16, phase_microturns: u32) -> (u16, bool) {
    let half = TURN / 2;
    let (within, swapped) = (phase_microturns % half, phase_microturns % TURN >= half);
    let count = (u64::from(within) * u64::from(reload) + u64::from(half / 2)) / u64::from(half);
    // The top of the count is the start of the next half turn.
    if count >= u64::from(reload) { (0, !swapped) } else { (to_u16(count), swapped) }
}

// The callers' arithmetic keeps these in range; saturating keeps a mistake from becoming a short window.
fn to_u16(value: u64) -> u16 {
    u16::try_from(value).unwrap_or(u16::MAX)
}

fn to_u32(value: u64) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}
