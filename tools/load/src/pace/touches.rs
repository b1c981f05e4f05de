//! Touches that were sent, and how each has ended.

use serde_json::Value;
use std::time::Instant;

/// A touch that was sent.
#[derive(Clone, Debug, PartialEq)]
pub struct Touch {
    /// When it was to be sent, by the rate. All times run from here: a touch that had to wait for a connection to become free has
    /// waited, though nobody had sent it yet.
    pub due: Instant,
    /// When its end was told.
    pub ended: Instant,
    /// How it has ended.
    pub end: TouchEnd,
}

/// How a touch has ended.
#[derive(Clone, Debug, PartialEq)]
pub enum TouchEnd {
    /// It was driven so.
    Driven(Vec<Drive>),
    /// A newer one of the same finger was driven in its stead, as is intended.
    Overtaken,
    /// Neither: what was said instead.
    Refused(String),
}

/// What the daemon says that an actuator does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Of the force, in Hz.
    pub frequency_hz: f64,
    /// At the electrodes, in V.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// Of the force, in rad.
    pub phase_rad: f64,
}

impl TouchEnd {
    /// By a plan.
    #[must_use]
    pub fn driven_from_plan_or_refused_if_unreadable(plan: &Value) -> Self {
        let drives = plan["drives"].as_array().map_or(&[][..], Vec::as_slice).iter().map(Drive::parse).collect();
        let unreadable = || Self::Refused("drives that cannot be read".into());
        Option::<Vec<Drive>>::map_or_else(drives, unreadable, Self::Driven)
    }

    /// By a problem.
    #[must_use]
    pub fn overtaken_if_problem_is_superseded_else_refused(problem: &Value) -> Self {
        match problem["type"].as_str().and_then(|kind| kind.rsplit(':').next()) {
            Some("superseded") => Self::Overtaken,
            Some(other) => Self::Refused(other.into()),
            None => Self::Refused("a problem without a type".into()),
        }
    }
}

impl Drive {
    fn parse(drive: &Value) -> Option<Self> {
        let number = |name: &str| drive[name].as_f64();
        Some(Self {
            frequency_hz: number("frequency_hz")?,
            voltage_v: number("voltage_v")?,
            pulse_width: number("pulse_width")?,
            phase_rad: number("phase_rad")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn an_end_is_read_from_what_the_daemon_says() {
        let drive = json!({"frequency_hz": 200.0, "voltage_v": 900.0, "pulse_width": 0.5, "phase_rad": 0.25});
        let read = Drive { frequency_hz: 200.0, voltage_v: 900.0, pulse_width: 0.5, phase_rad: 0.25 };
        assert_eq!(
            TouchEnd::driven_from_plan_or_refused_if_unreadable(&json!({"drives": [drive]})),
            TouchEnd::Driven(vec![read])
        );
        assert!(matches!(
            TouchEnd::driven_from_plan_or_refused_if_unreadable(&json!({"drives": [{"frequency_hz": 200.0}]})),
            TouchEnd::Refused(_)
        ));
        assert_eq!(
            TouchEnd::overtaken_if_problem_is_superseded_else_refused(&json!({"type": "urn:era:problem:superseded"})),
            TouchEnd::Overtaken
        );
        assert_eq!(
            TouchEnd::overtaken_if_problem_is_superseded_else_refused(&json!({"type": "urn:era:problem:queue-full"})),
            TouchEnd::Refused("queue-full".into())
        );
    }
}
