//! Between the plan's SI units and the wire's integers, and refusals in words.

use crate::effects::EffectWindow;
use crate::planner::drive::SiDrive;
use era_shared::MAX_CHANNELS;
use era_shared::protocol::{AchievedDrive, ChannelDrive, Refusal, WindowSequence};
use era_shared::supply::{RAILS, rail_index_of_channel};
use era_shared::waveform::{DriveError, SequenceError, SequenceWindow};

/// Windows narrower than this, in ppm of a half period, may be shorter than a tick of the timer, of which a period has 43 000
/// or more; boards refuse them. Their force is below 1e-4 of what the rail's voltage does.
const NARROWEST_PPM: u32 = 50;

/// The nearest drive that the wire format can express. The voltage is rounded down, so that a limit met in V is met in mV; values
/// outside the wire's range saturate there and are then refused by the device with its limits. A drive whose windows are
/// shorter than a tick is sent as what it is, none: 0 V, at a pulse width that every board takes. Plans have such where two
/// actuators share a rail and one needs next to no force.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates, which is what is wanted")]
pub fn drive_to_wire_zeroing_too_narrow_pulses(drive: &SiDrive) -> ChannelDrive {
    let turns = (drive.phase_rad / std::f64::consts::TAU).rem_euclid(1.0);
    let (pulse_width_ppm, voltage_millivolts) =
        match ((drive.pulse_width * 1e6).round() as u32, (drive.voltage_v * 1e3).floor() as u32) {
            (0..NARROWEST_PPM, _) => (500_000, 0),
            driven => driven,
        };
    ChannelDrive {
        channel: drive.channel,
        frequency_millihertz: (drive.frequency_hz * 1e3).round() as u32,
        pulse_width_ppm,
        phase_microturns: (turns * 1e6).round() as u32 % 1_000_000,
        voltage_millivolts,
    }
}

/// The windows of a burst as a board plays them: each channel's in the order of time, from the end of the one before. Voltages of rails are
/// rounded down; windows beyond what a sequence holds are left out.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates, which is what is wanted")]
pub fn windows_to_wire_sequence_dropping_excess(windows: &[EffectWindow]) -> WindowSequence {
    /// Ticks of a sequence in a us.
    const TICKS: f64 = 10.0;
    let ticks = |us: f64| (us * TICKS).round() as u32;
    let mut ends = [0_u32; MAX_CHANNELS];
    let mut sequence =
        WindowSequence { number: 0, start_us: 0, rail_millivolts: [0; RAILS], windows: heapless::Vec::new() };
    let mut by_time: Vec<&EffectWindow> = windows.iter().collect();
    by_time.sort_by(|a, b| a.begin_us.total_cmp(&b.begin_us));
    for window in by_time {
        let Some(end) = ends.get_mut(window.channel) else { continue };
        let (begin, width_ticks) = (ticks(window.begin_us), ticks(window.width_us));
        let channel = u8::try_from(window.channel).unwrap_or(u8::MAX);
        let wait_ticks = begin.saturating_sub(*end);
        let placed = SequenceWindow { channel, electrode: window.electrode, wait_ticks, width_ticks };
        if sequence.windows.push(placed).is_err() {
            break;
        }
        *end = begin + width_ticks;
        if let Some(rail) = sequence.rail_millivolts.get_mut(rail_index_of_channel(window.channel)) {
            *rail = (*rail).max((window.voltage_v * 1e3).floor() as u32);
        }
    }
    sequence
}

/// What a board says it achieved, in SI units.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "nanohertz up to 1e12 are exact in an f64")]
pub fn achieved_drive_from_wire(achieved: &AchievedDrive) -> SiDrive {
    SiDrive {
        channel: achieved.channel,
        frequency_hz: achieved.frequency_nanohertz as f64 / 1e9,
        voltage_v: f64::from(achieved.voltage_millivolts) / 1e3,
        pulse_width: f64::from(achieved.pulse_width_ppm) / 1e6,
        phase_rad: f64::from(achieved.phase_microturns) / 1e6 * std::f64::consts::TAU,
    }
}

/// A refusal as a sentence with its values and limits.
#[must_use]
pub fn describe_refusal(refusal: &Refusal) -> String {
    match refusal {
        Refusal::Version { got, device_min, device_current } => {
            format!(
                "the request has protocol version {got}, but the device supports versions {device_min} to \
                     {device_current}"
            )
        }
        Refusal::Malformed => "the device could not decode the request".into(),
        Refusal::State { state, event } => {
            format!("the command {} is not possible in the state {}", event.name(), state.name())
        }
        Refusal::Drive { channel, error } => format!("channel {channel}: {}", describe_drive_error(error)),
        Refusal::DuplicateChannel { channel } => format!("channel {channel} is given twice"),
        Refusal::OtherLink => "another host has armed the board; that host must disarm the board first".into(),
        Refusal::Deadman { requested_ms, min_ms, max_ms } => {
            format!("deadman_ms is {requested_ms}, but must be {min_ms} to {max_ms}")
        }
        Refusal::Fault(fault) => {
            format!("fault {} ({}): {}", fault.code.number(), fault.code.name(), fault.code.advice())
        }
        Refusal::Duty { channel, wait_ms } => {
            format!(
                "channel {channel} has driven for the longest allowed time; the channel can drive again in {wait_ms} ms"
            )
        }
        Refusal::StillThere(code) => {
            format!("the cause of fault {} ({}) is still present. {}", code.number(), code.name(), code.advice())
        }
        Refusal::NoDrive { channel } => {
            format!("channel {channel} has no drive: set a drive on this channel before you send an effect")
        }
        Refusal::Start { start_us, now_us } => {
            format!(
                "the effect (or the window sequence) must start at most 100 ms before and at most 10 s after the present \
                time, but its start is {start_us} us and the board's clock shows {now_us} us. A window sequence must \
                also start after the high-voltage rails have reached their voltage, and after the drives of its \
                channels have ended"
            )
        }
        Refusal::Effect => {
            "the effect is invalid: an effect must have at least one segment, 1 to 1000 repeats, and levels from -1000 \
             to 1000 (thousandths of the full strength)"
                .into()
        }
        Refusal::QueueFull { channel } => format!(
            "the queue of effects for channel {channel} is full (4 effects): send the effect again after an earlier \
             effect has ended"
        ),
        Refusal::Burst { requested_ms, min_ms, max_ms } => {
            format!("burst_ms is {requested_ms}, but must be {min_ms} to {max_ms}")
        }
        Refusal::Live(state) => {
            format!(
                "the board (state {}) does not restart into its bootloader, because high voltage may be on: the board \
                is armed, a rail is still charged, or the board has no reliable measurement of the rail voltages yet. \
                Disarm the board, wait for 2 s, and run the command again",
                state.name()
            )
        }
        Refusal::Restarting => "the board is about to restart into its bootloader".into(),
        Refusal::OtherFault { number } => {
            format!(
                "no fault was cleared, because the board has latched another fault in the meantime (fault number \
                 {number} since the board started): read this fault with `era state`, then clear the fault"
            )
        }
        Refusal::Sequence(error) => describe_sequence_error(error),
        Refusal::Current { requested_microamps, max_microamps } => format!(
            "the drives take {requested_microamps} uA from the supply on average, but must take at most {max_microamps} uA"
        ),
    }
}

fn describe_sequence_error(error: &SequenceError) -> String {
    let us = |ticks: u32| f64::from(ticks) / 10.0;
    match *error {
        SequenceError::Empty => "the sequence has no windows, but must have at least one".into(),
        SequenceError::NoSuchChannel { window, channels } => {
            format!(
                "window {window} is for a channel that the board does not have: the board has {channels} channels, numbered from 0"
            )
        }
        SequenceError::Width { window, requested_ticks, min_ticks, max_ticks } => format!(
            "the width of window {window} is {} us, but must be {} to {} us",
            us(requested_ticks),
            us(min_ticks),
            us(max_ticks)
        ),
        SequenceError::Wait { window, requested_ticks, min_ticks, max_ticks } => format!(
            "the pause before window {window} is {} us, but must be {} to {} us",
            us(requested_ticks),
            us(min_ticks),
            us(max_ticks)
        ),
        SequenceError::TooLong { requested_ms, max_ms } => {
            format!("the sequence lasts {requested_ms} ms, but must last at most {max_ms} ms")
        }
        SequenceError::Voltage { rail, requested_millivolts, max_millivolts } => format!(
            "the voltage of rail {rail} is {} V, but must be at most {} V",
            f64::from(requested_millivolts) / 1e3,
            f64::from(max_millivolts) / 1e3
        ),
    }
}

fn describe_drive_error(error: &DriveError) -> String {
    let si = |milli: u32| f64::from(milli) / 1e3;
    match *error {
        DriveError::NoSuchChannel { channels } => {
            format!("this channel does not exist; the board has {channels} channels, numbered from 0")
        }
        DriveError::Frequency { requested_millihertz, min_millihertz, max_millihertz } => format!(
            "the frequency is {} Hz, but must be {} to {} Hz",
            si(requested_millihertz),
            si(min_millihertz),
            si(max_millihertz)
        ),
        DriveError::Voltage { requested_millivolts, max_millivolts } => {
            format!("the voltage is {} V, but must be at most {} V", si(requested_millivolts), si(max_millivolts))
        }
        DriveError::PulseTooWide { requested_ppm, widest_ppm, min_guard_ns } => format!(
            "the pulse width is {} of half a period, which leaves less time between the pulses than the guard time of \
             {} us; at this frequency the pulse width must be at most {} of half a period",
            f64::from(requested_ppm) / 1e6,
            f64::from(min_guard_ns) / 1e3,
            f64::from(widest_ppm) / 1e6
        ),
        DriveError::PulseTooNarrow { requested_ppm, narrowest_ppm } => format!(
            "the pulse width is {} of half a period, which is shorter than a step of the timer; at this frequency the \
             pulse width must be at least {} of half a period",
            f64::from(requested_ppm) / 1e6,
            f64::from(narrowest_ppm) / 1e6
        ),
        DriveError::Phase { requested_microturns } => {
            format!("the phase is {} turns, but must be below one turn", f64::from(requested_microturns) / 1e6)
        }
        DriveError::NotRepresentable { timer_clock_hz } => {
            format!(
                "the timer cannot generate the requested frequency from its clock of {timer_clock_hz} Hz: request \
                another frequency"
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_below_a_tick_are_none() {
        let drive =
            |pulse_width| SiDrive { channel: 1, frequency_hz: 60.0, voltage_v: 900.0, pulse_width, phase_rad: 0.0 };
        for pulse_width in [0.0, 17e-6, 49e-6] {
            let wire = drive_to_wire_zeroing_too_narrow_pulses(&drive(pulse_width));
            assert_eq!((wire.pulse_width_ppm, wire.voltage_millivolts), (500_000, 0), "{pulse_width}");
        }
        let wire = drive_to_wire_zeroing_too_narrow_pulses(&drive(51e-6));
        assert_eq!((wire.pulse_width_ppm, wire.voltage_millivolts), (51, 900_000));
    }
}
