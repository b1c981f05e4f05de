//! How long each channel may drive: without a rest, and in the long run.

use super::charge::CreditCharge;
use crate::MAX_CHANNELS;
use crate::limits::{BURST_DEFAULT_MS, BURST_MAX_MS, DUTY_CREDIT_MS, DUTY_PERCENT, REST_MS};

/// Credit is counted in millionths of a us at the largest force, so that nothing is rounded while it is earned and spent: us
/// times [`CreditCharge::as_ppm`]. A minute is 6e13 of them.
const CREDIT_PER_US: u64 = CreditCharge::FULL.as_ppm() as u64;
/// Credit that a channel starts with and can have at most.
const FULL_CREDIT: u64 = DUTY_CREDIT_MS as u64 * 1000 * CREDIT_PER_US;
/// Credit that a us brings, whether the channel drives or not: a drive of no more force squared than this never runs out.
const EARNED_PER_US: u64 = DUTY_PERCENT as u64 * CREDIT_PER_US / 100;
const REST_US: u64 = REST_MS as u64 * 1000;

#[derive(Clone, Copy, Debug)]
struct ChannelAccount {
    credit: u64,
    /// What the channel's drive cost when time was last charged.
    charge: CreditCharge,
    burst_us: u64,
    rested_us: u64,
}

/// On-times and exposures of all channels.
#[derive(Clone, Debug)]
pub struct DriveBudget {
    burst_limit_us: u64,
    last_us: u64,
    accounts: [ChannelAccount; MAX_CHANNELS],
}

impl Default for DriveBudget {
    fn default() -> Self {
        Self::new()
    }
}

impl DriveBudget {
    /// What a channel earns in the long run, in millionths of the time at the largest force.
    pub const EARNED_PPM: u32 = DUTY_PERCENT * CreditCharge::FULL.as_ppm() / 100;

    /// Full credit for all channels, and the default limit of a burst.
    #[must_use]
    pub const fn new() -> Self {
        let account =
            ChannelAccount { credit: FULL_CREDIT, charge: CreditCharge::NONE, burst_us: 0, rested_us: REST_US };
        Self { burst_limit_us: BURST_DEFAULT_MS as u64 * 1000, last_us: 0, accounts: [account; MAX_CHANNELS] }
    }

    /// Sets the longest burst in ms, at most [`BURST_MAX_MS`] whatever the caller checked.
    pub fn set_burst_limit(&mut self, burst_ms: u16) {
        self.burst_limit_us = u64::from(burst_ms.clamp(1, BURST_MAX_MS)) * 1000;
    }

    /// Charges each channel for the time since the last call, and returns for each channel whether it must stop. `charges` has what each
    /// channel's drive costs, `None` where nothing drives.
    ///
    /// Bursts count time, whatever the force; credit is charged by force. A drive whose force has changed since the last
    /// call is charged at the greater of what was seen then and what is seen now.
    pub fn account_and_find_spent(
        &mut self,
        now_us: u64,
        charges: [Option<CreditCharge>; MAX_CHANNELS],
    ) -> [bool; MAX_CHANNELS] {
        let elapsed_us = now_us.saturating_sub(self.last_us);
        self.last_us = now_us;
        let mut spent = [false; MAX_CHANNELS];
        for ((account, driving), spent) in self.accounts.iter_mut().zip(charges).zip(&mut spent) {
            let earned = elapsed_us.saturating_mul(EARNED_PER_US);
            account.credit = account.credit.saturating_add(earned).min(FULL_CREDIT);
            if let Some(charge) = driving {
                let cost = u64::from(charge.max(account.charge).as_ppm());
                account.credit = account.credit.saturating_sub(elapsed_us.saturating_mul(cost));
                account.burst_us = account.burst_us.saturating_add(elapsed_us);
                account.rested_us = 0;
            } else {
                account.rested_us = account.rested_us.saturating_add(elapsed_us);
                if account.rested_us >= REST_US {
                    account.burst_us = 0;
                }
            }
            account.charge = driving.unwrap_or(CreditCharge::NONE);
            *spent = driving.is_some() && (account.burst_us >= self.burst_limit_us || account.credit == 0);
        }
        spent
    }

    /// Time in ms that a channel must wait before it may drive; `None` if it may drive now.
    #[must_use]
    pub fn required_wait_ms(&self, channel: usize) -> Option<u32> {
        let account = self.accounts.get(channel)?;
        // For a burst the time of a rest, for the credit the time until a rest's worth of it is there.
        let rest_us =
            if account.burst_us >= self.burst_limit_us { REST_US - account.rested_us.min(REST_US) } else { 0 };
        let missing_us = (REST_US * CREDIT_PER_US).saturating_sub(account.credit).div_ceil(EARNED_PER_US);
        let wait_us = rest_us.max(missing_us);
        (wait_us > 0).then(|| u32::try_from(wait_us.div_ceil(1000)).unwrap_or(u32::MAX))
    }

    /// Time in ms for which a channel may still drive at its largest force, by its credit, rounded down.
    #[must_use]
    pub fn remaining_credit_ms(&self, channel: usize) -> u32 {
        let credit = self.accounts.get(channel).map_or(0, |account| account.credit);
        u32::try_from(credit / (1000 * CREDIT_PER_US)).unwrap_or(u32::MAX)
    }

    /// What a channel's drive cost when time was last charged.
    #[must_use]
    pub fn last_charge(&self, channel: usize) -> CreditCharge {
        self.accounts.get(channel).map_or(CreditCharge::NONE, |account| account.charge)
    }
}
