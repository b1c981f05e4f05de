//! How long a device's host waits.

use std::time::Duration;

/// How quickly a device answers, and so how long its host waits.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Longest wait for an answer.
    pub reply_timeout: Duration,
    /// Between two signs of life while armed: a fifth of the dead-man time (250 ms) in the device's own time.
    pub keep_alive: Duration,
    /// Between two looks at the state.
    pub status: Duration,
    /// Longest wait for the self-test before arming: a second for rails that still discharge, and then some 70 ms.
    pub arming: Duration,
}

/// Real boards and the simulated one: an answer takes a few ms, of which 115 200 baud costs 20 for the longest frames.
pub const REAL_TIME: Timing = Timing {
    reply_timeout: Duration::from_millis(150),
    keep_alive: Duration::from_millis(50),
    status: Duration::from_millis(100),
    arming: Duration::from_millis(1500),
};
