//! What a session does without being asked, and what a scene needs of a board.

use crate::device::convert::drive_to_wire_zeroing_too_narrow_pulses;
use crate::device::identity::DeviceIdentity;
use crate::planner::drive::SiDrive;
use era_shared::MAX_CHANNELS;
use era_shared::protocol::{ChannelDrive, ChannelLimits};
use std::time::Duration;

/// What a session does without being asked.
#[derive(Clone, Copy, Debug)]
pub struct SessionPolicy {
    /// Time without a drive after which it disarms: high voltage is not kept ready for a touch that may never come.
    pub idle: Duration,
    /// Whether a latched silence of this host is cleared by the next touch. The board has gone off, and nothing is wrong with
    /// it: the host was busy.
    pub clears_silence: bool,
    /// Whether a board that was away (unplugged, restarted, silent) is armed by the next touch. If not it waits for a person: whoever
    /// unplugged it may have a hand in it.
    pub arms_after_outage: bool,
}

impl SessionPolicy {
    /// Idle time unless told otherwise.
    pub const IDLE: Duration = Duration::from_secs(5);
}

impl Default for SessionPolicy {
    fn default() -> Self {
        Self { idle: Self::IDLE, clears_silence: false, arms_after_outage: false }
    }
}

/// What a scene needs of a board.
#[derive(Clone, Debug, Default)]
pub struct SceneNeeds {
    /// Most voltage of every actuator in V: actuator i is on channel i.
    pub max_voltages_v: Vec<f64>,
    /// Voltage in V at which the rail of every actuator may stand before a touch: what the gaps on it hold under a press, which no plan goes beyond.
    pub ready_v: Vec<f64>,
}

/// In the middle of what boards do, in Hz.
const SILENT_HZ: f64 = 100.0;

/// How a board fits a scene.
#[derive(Clone, Debug, PartialEq)]
pub enum BoardFit {
    /// It has what is needed.
    Good,
    /// It drives less than the scene allows.
    Weaker(String),
    /// It cannot drive this scene.
    Unfit(String),
}

impl SceneNeeds {
    /// Drives at the voltages at which the rails stand ready. They are prepared and never played, so that only the rails rise.
    #[must_use]
    pub fn make_drives_to_prepare_without_playing_at_standby_voltages(
        &self,
        board: &DeviceIdentity,
    ) -> heapless::Vec<ChannelDrive, MAX_CHANNELS> {
        let drive = |((channel, limits), volts): ((u8, &ChannelLimits), &f64)| {
            let silent =
                SiDrive { channel, frequency_hz: SILENT_HZ, pulse_width: 0.5, phase_rad: 0.0, voltage_v: *volts };
            let wire = drive_to_wire_zeroing_too_narrow_pulses(&silent);
            ChannelDrive { voltage_millivolts: wire.voltage_millivolts.min(limits.max_voltage_millivolts), ..wire }
        };
        (0..).zip(&board.channels).zip(&self.ready_v).map(drive).take(MAX_CHANNELS).collect()
    }

    /// How a board fits these needs.
    #[must_use]
    pub fn judge_board_channels_and_voltages(&self, board: &DeviceIdentity) -> BoardFit {
        let (wanted, there) = (self.max_voltages_v.len(), board.channels.len());
        if there < wanted {
            return BoardFit::Unfit(format!(
                "the scene has {wanted} actuators, but the board has only {there} channels"
            ));
        }
        let less = self.max_voltages_v.iter().zip(&board.channels).zip(1..).find_map(|((volts, channel), number)| {
            let most_v = f64::from(channel.max_voltage_millivolts) / 1e3;
            (most_v < *volts).then(|| {
                format!(
                    "the scene allows {volts} V for actuator {number}, but the board allows at most {most_v} V on \
                     the channel of this actuator"
                )
            })
        });
        less.map_or(BoardFit::Good, BoardFit::Weaker)
    }
}
