//! Between the plan's SI units and the wire's integers, and refusals in words.

use crate::planner::drive::SiDrive;
use era_shared::protocol::{AchievedDrive, ChannelDrive, Refusal};
use era_shared::waveform::DriveError;

/// Windows narrower than this, in ppm of a half period, may be shorter than a tick of the timer, of which a period has 43 000
/// or more; boards refuse them. Their force is below 1e-4 of what the rail's voltage does.
const NARROWEST_PPM: u32 = 50;

/// The nearest drive that the wire format can express. The voltage is rounded down, so that a limit met in V is met in mV; values
/// outside the wire's range saturate there and are then refused by the device with its limits. A drive whose windows are
/// shorter than a tick is sent as what it is, none: 0 V, at a pulse width that every board takes. Plans have such where two
/// actuators share a rail and one needs next to no force.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates, which is what is wanted")]
pub fn drive_to_wire(drive: &SiDrive) -> ChannelDrive {
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
            format!("protocol version {got} is not one of the device's {device_min} to {device_current}")
        }
        Refusal::Malformed => "the device could not decode the request".into(),
        Refusal::State { state, event } => format!("{} is not allowed in state {}", event.name(), state.name()),
        Refusal::Drive { channel, error } => format!("channel {channel}: {}", describe_drive_error(error)),
        Refusal::DuplicateChannel { channel } => format!("channel {channel} is named twice"),
        Refusal::OtherLink => "another host has armed the board; it must disarm first".into(),
        Refusal::Deadman { requested_ms, min_ms, max_ms } => {
            format!("deadman_ms {requested_ms} is outside {min_ms} to {max_ms}")
        }
        Refusal::Fault(fault) => {
            format!("fault {} ({}): {}", fault.code.number(), fault.code.name(), fault.code.advice())
        }
        Refusal::Duty { channel, wait_ms } => {
            format!("channel {channel} has driven for as long as it may; it can drive again in {wait_ms} ms")
        }
        Refusal::StillThere(code) => {
            format!("the cause of fault {} ({}) is still there. {}", code.number(), code.name(), code.advice())
        }
        Refusal::NoDrive { channel } => format!("channel {channel} has no drive, and an effect needs one"),
        Refusal::Start { start_us, now_us } => {
            format!("the start at {start_us} us of the board's time is too far from its present time, {now_us} us")
        }
        Refusal::Effect => {
            "the effect has no segments, has a level beyond 1000, or is repeated 0 or more than 1000 times".into()
        }
        Refusal::QueueFull { channel } => format!("the queue of effects for channel {channel} is full"),
        Refusal::Burst { requested_ms, min_ms, max_ms } => {
            format!("burst_ms {requested_ms} is outside {min_ms} to {max_ms}")
        }
        Refusal::Live(state) => format!("not in state {}: high voltage may be on", state.name()),
    }
}

fn describe_drive_error(error: &DriveError) -> String {
    let si = |milli: u32| f64::from(milli) / 1e3;
    match *error {
        DriveError::NoSuchChannel { channels } => format!("the board has {channels} channels, counted from 0"),
        DriveError::Frequency { requested_millihertz, min_millihertz, max_millihertz } => format!(
            "frequency {} Hz is outside {} to {} Hz",
            si(requested_millihertz),
            si(min_millihertz),
            si(max_millihertz)
        ),
        DriveError::Voltage { requested_millivolts, max_millivolts } => {
            format!("voltage {} V is above {} V", si(requested_millivolts), si(max_millivolts))
        }
        DriveError::PulseTooWide { requested_ppm, widest_ppm, min_guard_ns } => format!(
            "pulse width {} would leave less than the guard time of {} us; at this frequency at most {}",
            f64::from(requested_ppm) / 1e6,
            f64::from(min_guard_ns) / 1e3,
            f64::from(widest_ppm) / 1e6
        ),
        DriveError::PulseTooNarrow { requested_ppm, narrowest_ppm } => format!(
            "pulse width {} is shorter than the timer's step; at this frequency at least {}",
            f64::from(requested_ppm) / 1e6,
            f64::from(narrowest_ppm) / 1e6
        ),
        DriveError::Phase { requested_microturns } => {
            format!("phase {} turns is not below one turn", f64::from(requested_microturns) / 1e6)
        }
        DriveError::NotRepresentable { timer_clock_hz } => {
            format!("no timer setting gives this frequency from a clock of {timer_clock_hz} Hz")
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
            let wire = drive_to_wire(&drive(pulse_width));
            assert_eq!((wire.pulse_width_ppm, wire.voltage_millivolts), (500_000, 0), "{pulse_width}");
        }
        let wire = drive_to_wire(&drive(51e-6));
        assert_eq!((wire.pulse_width_ppm, wire.voltage_millivolts), (51, 900_000));
    }
}
