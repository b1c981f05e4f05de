//! How long each channel may drive: without a rest, and in the long run.

use crate::MAX_CHANNELS;
use crate::limits::{BURST_DEFAULT_MS, BURST_MAX_MS, DUTY_CREDIT_MS, DUTY_PERCENT, REST_MS};

/// Credit in us that a channel starts with and can have at most.
const FULL_CREDIT_US: u64 = DUTY_CREDIT_MS as u64 * 1000;
const REST_US: u64 = REST_MS as u64 * 1000;

#[derive(Clone, Copy, Debug)]
struct Account {
    credit_us: u64,
    burst_us: u64,
    rested_us: u64,
}

/// On-times of all channels.
#[derive(Clone, Debug)]
pub struct Budget {
    burst_limit_us: u64,
    last_us: u64,
    accounts: [Account; MAX_CHANNELS],
}

impl Default for Budget {
    fn default() -> Self {
        Self::new()
    }
}

impl Budget {
    /// Full credit, the default burst.
    #[must_use]
    pub const fn new() -> Self {
        let account = Account { credit_us: FULL_CREDIT_US, burst_us: 0, rested_us: REST_US };
        Self { burst_limit_us: BURST_DEFAULT_MS as u64 * 1000, last_us: 0, accounts: [account; MAX_CHANNELS] }
    }

    /// Sets the longest burst in ms, at most [`BURST_MAX_MS`] whatever the caller checked.
    pub fn limit_bursts(&mut self, burst_ms: u16) {
        self.burst_limit_us = u64::from(burst_ms.clamp(1, BURST_MAX_MS)) * 1000;
    }

    /// Takes note of who has driven since the last call, and says who must stop.
    pub fn step(&mut self, now_us: u64, driving: [bool; MAX_CHANNELS]) -> [bool; MAX_CHANNELS] {
        let elapsed_us = now_us.saturating_sub(self.last_us);
        self.last_us = now_us;
        let mut spent = [false; MAX_CHANNELS];
        for ((account, driving), spent) in self.accounts.iter_mut().zip(driving).zip(&mut spent) {
            let earned = elapsed_us * u64::from(DUTY_PERCENT) / 100;
            account.credit_us = account.credit_us.saturating_add(earned).min(FULL_CREDIT_US);
            if driving {
                account.credit_us = account.credit_us.saturating_sub(elapsed_us);
                account.burst_us = account.burst_us.saturating_add(elapsed_us);
                account.rested_us = 0;
            } else {
                account.rested_us = account.rested_us.saturating_add(elapsed_us);
                if account.rested_us >= REST_US {
                    account.burst_us = 0;
                }
            }
            *spent = driving && (account.burst_us >= self.burst_limit_us || account.credit_us == 0);
        }
        spent
    }

    /// How long a channel must wait before it may drive, in ms; `None` if it need not.
    #[must_use]
    pub fn wait_ms(&self, channel: usize) -> Option<u32> {
        let account = self.accounts.get(channel)?;
        // For a burst the time of a rest, for the credit the time until a rest's worth of it is there.
        let rest_us =
            if account.burst_us >= self.burst_limit_us { REST_US - account.rested_us.min(REST_US) } else { 0 };
        let missing_us = REST_US.saturating_sub(account.credit_us) * 100 / u64::from(DUTY_PERCENT);
        let wait_us = rest_us.max(missing_us);
        (wait_us > 0).then(|| u32::try_from(wait_us.div_ceil(1000)).unwrap_or(u32::MAX))
    }

    /// What a channel may still drive in the long run, in ms.
    #[must_use]
    pub fn credit_ms(&self, channel: usize) -> u32 {
        let credit_us = self.accounts.get(channel).map_or(0, |account| account.credit_us);
        u32::try_from(credit_us / 1000).unwrap_or(u32::MAX)
    }
}
