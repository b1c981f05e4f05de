//! What clients count.

use crate::times::Times;
use serde_json::Value;
use std::collections::BTreeMap;

/// Lost touches of which is told what is known.
const PRINTED_ERRORS: usize = 20;

/// How a touch, or a request to arm, was answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestAnswer {
    /// The status and the end of the problem's type; "shown" for a plan on a live socket.
    pub kind: String,
    /// What the problem says.
    pub detail: Option<String>,
}

impl RequestAnswer {
    /// By a status and perhaps a problem.
    #[must_use]
    pub fn from_status(status: u16, problem: &Value) -> Self {
        let name = problem["type"].as_str().and_then(|kind| kind.rsplit(':').next()).filter(|_| status != 200);
        let kind = name.map_or_else(|| status.to_string(), |name| format!("{status} {name}"));
        Self { kind, detail: name.and_then(|_| problem["detail"].as_str()).map(str::to_owned) }
    }

    /// By a plan on a live socket.
    #[must_use]
    pub fn make_shown_answer_for_plan_on_live_socket() -> Self {
        Self { kind: "shown".into(), detail: None }
    }

    /// Whether it was driven.
    #[must_use]
    pub const fn was_touch_driven(&self) -> bool {
        self.detail.is_none()
    }
}

/// Refusals that every run has: touches that are wrong on purpose, stops, newer touches, channels that have to rest, a full queue.
const EXPECTED: [&str; 5] = ["400 out-of-range", "409 stopped", "409 superseded", "409 device-refused", "429 busy"];
/// Those that faults come with besides: a board that is away, late, or has latched a silence.
const OF_FAULTS: [&str; 3] = ["409 device-fault", "502 device-lost", "503 device-late"];

/// What became of touches.
#[derive(Debug, Default)]
pub struct Tally {
    /// Touches that were sent.
    pub sent: u64,
    /// Those that were answered, by what they were answered with.
    pub answered: BTreeMap<String, u64>,
    /// What the first of each kind of refusal said.
    pub details: BTreeMap<String, String>,
    /// Those without an answer whose outcome the daemon told when it was asked afterwards.
    pub told: u64,
    /// Those that a daemon had taken when it was killed.
    pub killed: u64,
    /// Those of which nobody knows.
    pub lost: u64,
    /// What is known of the first of them.
    pub losses: Vec<String>,
    /// From sending a request to its answer.
    pub times: Times,
    /// From putting a finger down to the plan for its last place.
    pub live_times: Times,
    /// Connections that had to be opened again to the same daemon.
    pub reconnects: u64,
    /// Requests to arm by hand, by what they were answered with.
    pub arming: BTreeMap<String, u64>,
    /// Other requests: stops and looks at the state.
    pub others: u64,
}

impl Tally {
    /// A touch was answered with this status and, where it was refused, this problem.
    pub fn count_answer(&mut self, answer: RequestAnswer) {
        let RequestAnswer { kind, detail } = answer;
        if let Some(detail) = detail
            && !self.details.contains_key(&kind)
        {
            self.details.insert(kind.clone(), detail);
        }
        *self.answered.entry(kind).or_default() += 1;
    }

    /// A request to arm was answered.
    pub fn count_answer_to_arm_request_by_kind(&mut self, answer: &RequestAnswer) {
        *self.arming.entry(answer.kind.clone()).or_default() += 1;
    }

    /// A touch was lost.
    pub fn record_and_print_lost_touch(&mut self, what: String) {
        eprintln!("lost: {what}");
        self.lost += 1;
        if self.losses.len() < PRINTED_ERRORS {
            self.losses.push(what);
        }
    }

    /// Adds those of another client.
    pub fn merge(&mut self, other: Self) {
        self.sent += other.sent;
        for (with, count) in other.answered {
            *self.answered.entry(with).or_default() += count;
        }
        for (with, count) in other.arming {
            *self.arming.entry(with).or_default() += count;
        }
        for (kind, detail) in other.details {
            self.details.entry(kind).or_insert(detail);
        }
        self.told += other.told;
        self.killed += other.killed;
        self.lost += other.lost;
        self.losses.extend(other.losses);
        self.losses.truncate(PRINTED_ERRORS);
        self.times.merge(other.times);
        self.live_times.merge(other.live_times);
        self.reconnects += other.reconnects;
        self.others += other.others;
    }

    /// Touches that were driven.
    #[must_use]
    pub fn count_driven(&self) -> u64 {
        ["200", "shown"].iter().filter_map(|kind| self.answered.get(*kind)).sum()
    }

    /// Refusals of touches and of arming of kinds that nothing in the run asks for, in words, and how many they are.
    #[must_use]
    pub fn count_and_describe_unexpected_refusals(&self, has_faults: bool) -> (u64, Vec<String>) {
        let is_expected = |kind: &str| {
            ["200", "shown"].contains(&kind) || EXPECTED.contains(&kind) || (has_faults && OF_FAULTS.contains(&kind))
        };
        let others: Vec<_> = self.answered.iter().chain(&self.arming).filter(|(kind, _)| !is_expected(kind)).collect();
        let told = others.iter().map(|(kind, count)| format!("{count} with {kind}")).collect();
        (others.iter().map(|(_, count)| **count).sum(), told)
    }

    /// Touches that were answered.
    #[must_use]
    pub fn count_answered_touches(&self) -> u64 {
        self.answered.values().sum()
    }
}

#[cfg(test)]
impl Tally {
    /// One touch, which was driven.
    pub fn with_one_driven_touch() -> Self {
        Self { sent: 1, answered: BTreeMap::from([("200".into(), 1)]), ..Self::default() }
    }
}
