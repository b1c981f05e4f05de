//! What version 3 adds to the device's answers.

use crate::MAX_CHANNELS;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// What driving costs. Boards of versions 1 and 2 charge by time, if they do not speak version 3 as well; one that does says
/// here which it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ChargeRule {
    /// Every drive costs its time.
    Time,
    /// A drive costs its time times the square of its force, as a part of the channel's largest force.
    ForceSquared,
}

impl ChargeRule {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Time => "time",
            Self::ForceSquared => "force-squared",
        }
    }
}

/// What the channels may still drive in the long run, and what they are charged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CreditReply {
    /// How drives are charged.
    pub rule: ChargeRule,
    /// Credit that a channel earns, driving or not, in millionths of the time: what costs no more than this never runs out.
    pub earned_ppm: u32,
    /// One per channel.
    pub channels: Vec<ChannelCredit, MAX_CHANNELS>,
}

/// The credit of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelCredit {
    /// For how long in ms it may still drive at its largest force; the same as in [`super::DetailsReply`].
    pub left_ms: u32,
    /// What it costs now, in millionths of the time; 0 while it does not drive.
    pub charge_ppm: u32,
}

impl CreditReply {
    /// Time in ms for which a channel may go on driving with its present force: its credit divided by what is charged less what is
    /// earned. Limits of bursts and rests are not counted. `None` if the credit never runs out, or if there is no such channel.
    #[must_use]
    pub fn drive_time_ms_until_credit_runs_out_if_ever(&self, channel: usize) -> Option<u64> {
        let ChannelCredit { left_ms, charge_ppm } = *self.channels.get(channel)?;
        let net_ppm = u64::from(charge_ppm.saturating_sub(self.earned_ppm));
        (u64::from(left_ms) * 1_000_000).checked_div(net_ppm)
    }
}
