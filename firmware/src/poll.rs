//! Waiting for a condition, for a limited time.

use embassy_time::{Duration, Instant};

/// For how long a pad may differ from what it was set to: 10 kohm and up to 500 pF of the permit's line and gates take 5 us.
pub const PAD_SETTLING: Duration = Duration::from_micros(20);

/// Whether `condition` becomes true within `limit`. It is evaluated at least twice, the last time after the limit.
pub fn poll_within(limit: Duration, mut condition: impl FnMut() -> bool) -> bool {
    let end = Instant::now() + limit;
    loop {
        let is_over = Instant::now() > end;
        if condition() {
            return true;
        }
        if is_over {
            return false;
        }
    }
}
