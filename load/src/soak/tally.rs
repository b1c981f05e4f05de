//! What clients count.

use crate::times::Times;
use std::collections::BTreeMap;

/// Lost touches of which is told what is known.
const TOLD: usize = 20;

/// What became of touches.
#[derive(Debug, Default)]
pub struct Tally {
    /// Touches that were sent.
    pub sent: u64,
    /// Those that were answered, by what they were answered with.
    pub answered: BTreeMap<String, u64>,
    /// Those without an answer whose outcome the daemon told when it was asked afterwards.
    pub told: u64,
    /// Those that a daemon had taken when it was killed.
    pub killed: u64,
    /// Those of which nobody knows.
    pub lost: u64,
    /// What is known of the first of them.
    pub losses: Vec<String>,
    /// From sending to the answer.
    pub times: Times,
    /// Connections that had to be opened again to the same daemon.
    pub reconnects: u64,
    /// Other requests: stops and looks at the state.
    pub others: u64,
}

impl Tally {
    /// A touch was answered.
    pub fn answered(&mut self, with: String) {
        *self.answered.entry(with).or_default() += 1;
    }

    /// A touch was lost.
    pub fn lost(&mut self, what: String) {
        eprintln!("lost: {what}");
        self.lost += 1;
        if self.losses.len() < TOLD {
            self.losses.push(what);
        }
    }

    /// Adds those of another client.
    pub fn join(&mut self, other: Self) {
        self.sent += other.sent;
        for (with, count) in other.answered {
            *self.answered.entry(with).or_default() += count;
        }
        self.told += other.told;
        self.killed += other.killed;
        self.lost += other.lost;
        self.losses.extend(other.losses);
        self.losses.truncate(TOLD);
        self.times.join(other.times);
        self.reconnects += other.reconnects;
        self.others += other.others;
    }

    /// Touches that were answered.
    #[must_use]
    pub fn all_answered(&self) -> u64 {
        self.answered.values().sum()
    }
}
