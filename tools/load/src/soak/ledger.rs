//! What was injected, and what came of it.

use crate::times::Times;
use std::collections::BTreeMap;
use std::fmt::{self, Display};
use std::time::Duration;

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FaultKind {
    /// The board's cable is pulled and plugged in again.
    Unplugged,
    /// The line lets nothing through for a while.
    DeadLine,
    /// The line lets no answers through for a while: the board hears everything.
    AnswersLost,
    /// The line lets no requests through for a while: the daemon hears whatever the board says.
    RequestsLost,
    /// Rubbish in a frame to the board.
    RubbishToBoard,
    /// Rubbish in a frame to the daemon.
    RubbishToHost,
    /// Clients that connect and say nothing.
    SlowNothing,
    /// Clients that send half a header.
    SlowHeader,
    /// Clients that send half a body.
    SlowBody,
    /// Clients that read nothing from the live socket.
    SlowReader,
    /// The daemon does not run for a while.
    DaemonSuspended,
    /// The daemon is killed and started again.
    Killed,
}

impl Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Unplugged => "cable pulled and plugged in",
            Self::DeadLine => "line dead for a while",
            Self::AnswersLost => "answers lost, requests heard",
            Self::RequestsLost => "requests lost, answers heard",
            Self::RubbishToBoard => "rubbish in a frame to the board",
            Self::RubbishToHost => "rubbish in a frame to the host",
            Self::SlowNothing => "client says nothing",
            Self::SlowHeader => "client sends half a header",
            Self::SlowBody => "client sends half a body",
            Self::SlowReader => "client reads nothing of /v1/live",
            Self::DaemonSuspended => "daemon held (SIGSTOP)",
            Self::Killed => "daemon killed (SIGKILL)",
        })
    }
}

/// Faults of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultCount {
    /// How many there were.
    pub injected: u64,
    /// How many the daemon or the board noticed.
    pub detected: u64,
    /// After how many everything went on.
    pub recovered: u64,
    /// Longest time from injecting to noticing.
    pub detection: Duration,
    /// Longest time from the fault's end to a touch that is driven.
    pub recovery: Duration,
}

/// All faults.
#[derive(Debug, Default)]
pub struct FaultLedger {
    /// By kind.
    pub counts: BTreeMap<FaultKind, FaultCount>,
    /// What did not go as it must.
    pub misses: Vec<String>,
    /// From the loss of the board, pulled or silent, until the daemon tells it.
    pub losses: Times,
}

impl FaultLedger {
    /// Records a fault: after how long it was detected and recovered from, or what was seen instead.
    pub fn record_fault_and_print_misses(
        &mut self,
        kind: FaultKind,
        detected: Result<Duration, String>,
        recovered: Result<Duration, String>,
    ) {
        let count = self.counts.entry(kind).or_default();
        count.injected += 1;
        let mut misses = Vec::new();
        match detected {
            Ok(after) => (count.detected, count.detection) = (count.detected + 1, count.detection.max(after)),
            Err(what) => misses.push(format!("{kind}: not detected: {what}")),
        }
        match recovered {
            Ok(after) => (count.recovered, count.recovery) = (count.recovered + 1, count.recovery.max(after)),
            Err(what) => misses.push(format!("{kind}: not recovered: {what}")),
        }
        for miss in misses {
            eprintln!("{miss}");
            self.misses.push(miss);
        }
    }

    /// Faults that the board may have latched for what was injected: one for each time that it, or the daemon, may have heard nothing.
    #[must_use]
    pub fn count_injected_faults_that_may_latch(&self) -> u64 {
        let is_of_clients = |kind: &FaultKind| {
            matches!(kind, FaultKind::SlowNothing | FaultKind::SlowHeader | FaultKind::SlowBody | FaultKind::SlowReader)
        };
        self.counts.iter().filter(|(kind, _)| !is_of_clients(kind)).map(|(_, count)| count.injected).sum()
    }

    /// All kinds together.
    #[must_use]
    pub fn sum_counts_with_longest_times_over_kinds(&self) -> FaultCount {
        self.counts.values().fold(FaultCount::default(), |sum, count| FaultCount {
            injected: sum.injected + count.injected,
            detected: sum.detected + count.detected,
            recovered: sum.recovered + count.recovered,
            detection: sum.detection.max(count.detection),
            recovery: sum.recovery.max(count.recovery),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_seen_is_a_miss() {
        let mut ledger = FaultLedger::default();
        ledger.record_fault_and_print_misses(
            FaultKind::DaemonSuspended,
            Ok(Duration::from_millis(3)),
            Ok(Duration::ZERO),
        );
        ledger.record_fault_and_print_misses(
            FaultKind::DaemonSuspended,
            Ok(Duration::from_millis(2)),
            Err("no answer".into()),
        );
        let total = ledger.sum_counts_with_longest_times_over_kinds();
        assert_eq!((total.injected, total.detected, total.recovered), (2, 2, 1));
        assert_eq!((total.detection, ledger.misses.len()), (Duration::from_millis(3), 1));
    }
}
