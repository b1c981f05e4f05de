//! Frames that the simulated device has heard, for whoever asks what came over its line and when.

use era_shared::protocol::ChannelDrive;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// A frame that set drives, prepared them for an effect, or had a sequence of windows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveFrame {
    /// When its last byte was received.
    pub at: Instant,
    /// The drives that it asked for; none if it had windows.
    pub drives: Vec<ChannelDrive>,
    /// How many windows it had.
    pub window_count: usize,
    /// From then on until its windows begin, if the board has accepted them.
    pub windows_begin_after: Option<Duration>,
}

/// The last frames, none unless that is asked for.
#[derive(Debug, Default)]
pub struct DriveFrameRecord {
    most: usize,
    kept: VecDeque<DriveFrame>,
}

impl DriveFrameRecord {
    /// A record of no more than the last `most` frames.
    pub const fn new(most: usize) -> Self {
        Self { most, kept: VecDeque::new() }
    }

    /// Adds these frames, the newest last.
    pub fn add_frames(&mut self, frames: Vec<DriveFrame>) {
        self.kept.extend(frames);
        let beyond = self.kept.len().saturating_sub(self.most);
        self.kept.drain(..beyond);
    }

    /// Takes all frames that are kept; from here on none are kept.
    pub fn stop_recording_and_take_frames(&mut self) -> Vec<DriveFrame> {
        std::mem::take(self).kept.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_are_kept_than_were_asked_for() {
        let frame = |channel| DriveFrame {
            at: Instant::now(),
            drives: vec![ChannelDrive {
                channel,
                frequency_millihertz: 1,
                pulse_width_ppm: 1,
                phase_microturns: 0,
                voltage_millivolts: 1,
            }],
            window_count: 0,
            windows_begin_after: None,
        };
        let mut frames = DriveFrameRecord::default();
        frames.add_frames(vec![frame(0)]);
        assert_eq!(frames.stop_recording_and_take_frames(), []);
        frames = DriveFrameRecord::new(2);
        frames.add_frames(vec![frame(1), frame(2), frame(3)]);
        let channels: Vec<u8> =
            frames.stop_recording_and_take_frames().iter().map(|frame| frame.drives[0].channel).collect();
        assert_eq!(channels, [2, 3]);
        frames.add_frames(vec![frame(4)]);
        assert_eq!(frames.stop_recording_and_take_frames(), []);
    }
}
