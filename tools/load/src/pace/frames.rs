//! Which frame on the board's line is which touch's: by what it drives, and never by when it came alone.

use super::touches::{Drive, Touch, TouchEnd};
use era::device::sim::DriveFrame;
use std::collections::BTreeMap;
use std::time::Instant;

/// How far a number on the wire may be from what the daemon said in words: a unit of the wire's, as it was rounded one way or another.
const UNIT: f64 = 1.0;
/// Narrower windows are sent as no voltage, in parts of a half period.
const NARROWEST: f64 = 50e-6;

/// When the last byte of each touch's frame came, in the order of the touches; `None` for those that have none.
///
/// # Errors
/// For people: one frame is as two touches want it, so that nobody knows whose it is.
pub fn find_last_frame_arrivals_unless_ambiguous(
    touches: &[Touch],
    frames: &[DriveFrame],
) -> Result<Vec<Option<Instant>>, String> {
    let mut owners = BTreeMap::new();
    let mut all = Vec::with_capacity(touches.len());
    for (number, touch) in touches.iter().enumerate() {
        let TouchEnd::Driven(drives) = &touch.end else {
            all.push(None);
            continue;
        };
        let (from, to) =
            (frames.partition_point(|f| f.at < touch.due), frames.partition_point(|f| f.at <= touch.ended));
        let mut between = frames.iter().enumerate().take(to).skip(from);
        // The last: what a board refuses at first is sent again.
        let found = between.rfind(|(_, frame)| frame_sets_drives(frame, drives));
        if let Some((place, _)) = found
            && let Some(other) = owners.insert(place, number)
        {
            return Err(format!(
                "touches {other} and {number} of this load have the same drives: the touch of this frame is unknown"
            ));
        }
        all.push(found.map(|(_, frame)| frame.at));
    }
    Ok(all)
}

/// Whether a frame asks for these drives, which are those of channels 0, 1, 2 and so on.
fn frame_sets_drives(frame: &DriveFrame, drives: &[Drive]) -> bool {
    frame.drives.len() == drives.len()
        && frame.drives.iter().zip(drives).zip(0_u8..).all(|((asked, drive), channel)| {
            let near = |wire: u32, said: f64| (f64::from(wire) - said).abs() <= UNIT;
            let turns = (drive.phase_rad / std::f64::consts::TAU).rem_euclid(1.0) * 1e6;
            let is_narrow = drive.pulse_width < NARROWEST;
            let is_shaped = is_narrow && asked.voltage_millivolts == 0
                || near(asked.pulse_width_ppm, drive.pulse_width * 1e6)
                    && near(asked.voltage_millivolts, drive.voltage_v * 1e3);
            asked.channel == channel
                && is_shaped
                && near(asked.frequency_millihertz, drive.frequency_hz * 1e3)
                // A whole turn is none.
                && [turns, turns - 1e6, turns + 1e6].iter().any(|turns| near(asked.phase_microturns, *turns))
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use era_shared::protocol::ChannelDrive;
    use std::time::Duration;

    fn frame(at: Instant, frequency_millihertz: u32) -> DriveFrame {
        let drive = ChannelDrive {
            channel: 0,
            frequency_millihertz,
            pulse_width_ppm: 400_000,
            phase_microturns: 0,
            voltage_millivolts: 900_000,
        };
        DriveFrame { at, drives: vec![drive], window_count: 0, windows_begin_after: None }
    }

    fn touch(due: Instant, ended: Instant, frequency_hz: f64) -> Touch {
        let drive = Drive { frequency_hz, voltage_v: 900.0004, pulse_width: 0.4, phase_rad: -1e-8 };
        Touch { due, ended, end: TouchEnd::Driven(vec![drive]) }
    }

    /// Two touches at once, the later answered first: by time alone each would take the other's frame.
    #[test]
    fn a_frame_of_another_touch_is_not_taken_for_this_ones() {
        let ms = |ms| zero() + Duration::from_millis(ms);
        let frames = [frame(ms(3), 210_000), frame(ms(5), 200_000)];
        let touches = [touch(ms(0), ms(9), 200.0), touch(ms(1), ms(6), 210.0)];
        assert_eq!(find_last_frame_arrivals_unless_ambiguous(&touches, &frames), Ok(vec![Some(ms(5)), Some(ms(3))]));
        // Its own never came: another's, however near in time, is none.
        assert_eq!(find_last_frame_arrivals_unless_ambiguous(&[touch(ms(0), ms(9), 220.0)], &frames), Ok(vec![None]));
        // Nor is one of the same drives from before it was due, or after its answer.
        assert_eq!(
            find_last_frame_arrivals_unless_ambiguous(
                &[touch(ms(6), ms(9), 200.0), touch(ms(0), ms(2), 210.0)],
                &frames
            ),
            Ok(vec![None, None])
        );
        // Once more, as it was refused.
        let again = [frame(ms(5), 200_000), frame(ms(7), 200_000)];
        assert_eq!(
            find_last_frame_arrivals_unless_ambiguous(&[touch(ms(0), ms(9), 200.0)], &again),
            Ok(vec![Some(ms(7))])
        );
    }

    #[test]
    fn touches_that_drive_the_same_are_no_measurement() {
        let ms = |ms| zero() + Duration::from_millis(ms);
        let touches = [touch(ms(0), ms(9), 200.0), touch(ms(1), ms(8), 200.0)];
        assert!(find_last_frame_arrivals_unless_ambiguous(&touches, &[frame(ms(4), 200_000)]).is_err());
    }

    #[test]
    fn all_that_is_driven_must_agree() {
        let now = zero();
        let sent = frame(now, 200_000);
        let drive = Drive { frequency_hz: 200.0, voltage_v: 900.0, pulse_width: 0.4, phase_rad: 0.0 };
        assert!(frame_sets_drives(&sent, &[drive]));
        for other in [
            Drive { frequency_hz: 200.01, ..drive },
            Drive { voltage_v: 900.01, ..drive },
            Drive { pulse_width: 0.40001, ..drive },
            Drive { phase_rad: 1e-3, ..drive },
        ] {
            assert!(!frame_sets_drives(&sent, &[other]), "{other:?}");
        }
        assert!(!frame_sets_drives(&sent, &[]) && !frame_sets_drives(&sent, &[drive, drive]));
    }

    fn zero() -> Instant {
        static ZERO: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
        *ZERO.get_or_init(Instant::now)
    }
}
