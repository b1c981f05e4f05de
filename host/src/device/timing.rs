//! How long a device's host waits.

use era_shared::link::{MAX_ENCODED, UART_BAUD};
use std::time::Duration;

/// How long an answer is waited for, and how often it is asked for meanwhile. Every request can be repeated without harm
/// (`era_shared::protocol::Request`), and an answer counts whichever try it is to: a frame that is lost to noise costs one short
/// wait, and an answer that is late is not lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryPolicy {
    /// How long the first try waits, from the time when its last byte is through; each further one waits twice as long as the one
    /// before. A device whose last answer took longer than half of that gets twice what it took, as what is late already is not
    /// made quicker by more to do.
    pub again: Duration,
    /// What they come to wait at last.
    pub most: Duration,
    /// So many are made.
    pub tries: u32,
    /// From the first try's last byte until the link is in doubt.
    pub doubt: Duration,
    /// From then until a stop is sent in place of further tries, where a session asks: the board may hear every one of them, and take it
    /// for a sign of life, though its answers are lost.
    pub stop: Duration,
}

impl RetryPolicy {
    /// Three tries that each wait for `timeout`, without a doubt or a stop before the end.
    #[must_use]
    pub const fn with_three_tries_of_constant_timeout(timeout: Duration) -> Self {
        Self { again: timeout, most: timeout, tries: 3, doubt: Duration::MAX, stop: Duration::MAX }
    }

    /// How long a try waits: `try_index` counts from 0, and the last answer took `last_reply_time`.
    #[must_use]
    pub fn timeout_of_try(&self, try_index: u32, last_reply_time: Duration) -> Duration {
        let longer = 1_u32.checked_shl(try_index).unwrap_or(u32::MAX);
        self.again.saturating_mul(longer).max(last_reply_time.saturating_mul(2)).min(self.most)
    }

    /// Longest time that all tries take, without what they take on the wire.
    #[must_use]
    pub const fn longest_total_wait(&self) -> Duration {
        self.most.saturating_mul(self.tries)
    }
}

/// How quickly a device answers, and so how long its host waits.
#[derive(Clone, Copy, Debug)]
pub struct LinkTiming {
    /// For an answer.
    pub retry_policy: RetryPolicy,
    /// Longest time in which nothing is asked, armed or not: then comes a sign of life. Far below the dead-man time (250 ms)
    /// in the device's own time.
    pub keep_alive: Duration,
    /// Between two looks at the state.
    pub status: Duration,
    /// Longest wait for the self-test before arming: a second for rails that still discharge, and then some 70 ms.
    pub arming: Duration,
}

/// Longest time from the loss of a board to the moment when it is told, on a machine that is not overloaded.
pub const LOSS_SEEN: Duration = Duration::from_millis(100);

/// Real boards and the simulated one. What is lost right after its last answer is asked for 30 ms later, and in doubt 50 ms
/// after that: 80 ms of the 100 of [`LOSS_SEEN`]. The other 20 are for frames on the wire, for reads, which end after 2 ms each, for a
/// thread that comes late, and for whoever looks.
///
/// The first try waits 25 ms: a board answers within a few ms, of which the simulated one takes 1 to 2, and USB or a debug probe's
/// serial port add one each way; a sign of life and its answer are some 15 bytes each, 3 ms at 115 200 baud. What a request takes on the
/// wire is added ([`uart_time_for_bytes`]), and an answer that has begun gets what the longest frame takes. So a frame lost to noise is made up
/// for before there is a doubt. A sign of life every 30 ms takes 5 % of such a line.
///
/// A board in doubt is asked ten times a second, as it is looked at otherwise, 1.1 s in all: a silence longer than that is no computer
/// that was busy for a moment, and the port is opened anew. 150 ms after the first try the question becomes a stop: a board that hears and whose
/// answers are lost takes every frame for a sign of life, and would go on. With the 30 ms since its last answer that is 180 ms, so that it is off
/// no later than one that hears nothing, which goes off by itself 250 ms after the last frame that it heard.
pub const REAL_TIME: LinkTiming = LinkTiming {
    retry_policy: RetryPolicy {
        again: Duration::from_millis(25),
        most: Duration::from_millis(100),
        tries: 12,
        doubt: Duration::from_millis(50),
        stop: Duration::from_millis(150),
    },
    keep_alive: Duration::from_millis(30),
    status: Duration::from_millis(100),
    arming: Duration::from_millis(1500),
};

/// Time that `byte_count` bytes take at the speed of the board's serial port, with a start and a stop bit each. A board on USB is quicker.
#[must_use]
pub const fn uart_time_for_bytes(byte_count: usize) -> Duration {
    // A u64 holds the nanoseconds of more bytes than any memory has.
    Duration::from_nanos(byte_count as u64 * 10 * 1_000_000_000 / UART_BAUD as u64)
}

/// Time that the longest frame takes: 22 ms.
pub const LONGEST_FRAME: Duration = uart_time_for_bytes(MAX_ENCODED);

#[cfg(test)]
mod tests {
    use super::*;
    use era_shared::limits::DEADMAN_DEFAULT_MS;

    #[test]
    fn a_loss_is_reported_in_time_with_some_to_spare() {
        let LinkTiming { retry_policy, keep_alive, .. } = REAL_TIME;
        // A sign of life has some 15 bytes.
        let told = keep_alive + retry_policy.doubt + uart_time_for_bytes(15);
        assert!(told + Duration::from_millis(15) <= LOSS_SEEN, "{told:?}");
        // One that is lost is asked for again, and answered, before that; and long before the board goes off.
        let again = retry_policy.timeout_of_try(0, Duration::ZERO) + 2 * uart_time_for_bytes(15);
        assert!(again + Duration::from_millis(15) < retry_policy.doubt, "{again:?}");
        // Answers that are lost do not keep a board on for longer than silence would.
        assert!(retry_policy.doubt < retry_policy.stop);
        assert!(
            keep_alive + retry_policy.stop + uart_time_for_bytes(15)
                < Duration::from_millis(u64::from(DEADMAN_DEFAULT_MS))
        );
        assert!(keep_alive + retry_policy.doubt < Duration::from_millis(u64::from(DEADMAN_DEFAULT_MS) / 2));
    }

    #[test]
    fn tries_wait_longer_and_longer_and_no_shorter_than_a_slow_device_needs() {
        let ms = Duration::from_millis;
        let waits = |last| [0, 1, 2, 3, 40].map(|number| REAL_TIME.retry_policy.timeout_of_try(number, last));
        assert_eq!(waits(ms(2)), [ms(25), ms(50), ms(100), ms(100), ms(100)]);
        assert_eq!(waits(ms(30)), [ms(60), ms(60), ms(100), ms(100), ms(100)]);
        assert_eq!(RetryPolicy::with_three_tries_of_constant_timeout(ms(500)).timeout_of_try(2, ms(2000)), ms(500));
    }

    #[test]
    fn the_longest_frame_takes_250_bytes_of_ten_bits() {
        assert!((LONGEST_FRAME.as_secs_f64() - 250.0 * 10.0 / 115_200.0).abs() < 1e-6);
    }
}
