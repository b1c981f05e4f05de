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

/// A rest of a channel that is to come, and for how long it drives after it.
#[derive(Clone, Copy, Debug)]
pub struct PlannedDrive {
    /// For how long it rests first, in us: no more than it will.
    pub rest_us: u64,
    /// For how long it drives then, in us: no less than it will.
    pub drive_us: u64,
    /// What that costs at most.
    pub charge: CreditCharge,
}

/// What a plan takes of a channel's account.
struct PlanCost {
    /// The longest time without a rest, in us.
    longest_burst_us: u64,
    /// All of its credit.
    credit: u64,
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

    /// Gives the channels the credit in ms that a previous run has left them.
    pub fn restore_credit(&mut self, credit_ms: [u32; MAX_CHANNELS]) {
        for (account, credit_ms) in self.accounts.iter_mut().zip(credit_ms) {
            account.credit = (u64::from(credit_ms) * 1000 * CREDIT_PER_US).min(FULL_CREDIT);
        }
    }

    /// The longest burst in ms.
    #[must_use]
    pub fn burst_limit_ms(&self) -> u16 {
        u16::try_from(self.burst_limit_us / 1000).unwrap_or(BURST_MAX_MS)
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
    pub fn account_and_find_channels_to_stop(
        &mut self,
        now_us: u64,
        charges: [Option<CreditCharge>; MAX_CHANNELS],
    ) -> [bool; MAX_CHANNELS] {
        let elapsed_us = now_us.saturating_sub(self.last_us);
        self.last_us = now_us;
        let mut must_stop = [false; MAX_CHANNELS];
        for ((account, driving), must_stop) in self.accounts.iter_mut().zip(charges).zip(&mut must_stop) {
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
            *must_stop = driving.is_some() && (account.burst_us >= self.burst_limit_us || account.credit == 0);
        }
        must_stop
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

    /// Whether a channel that has rested may drive as planned without being stopped in between; if not, the longest time in ms without a
    /// rest that it would take.
    #[must_use]
    pub fn planned_burst_ms_if_at_or_over_burst_limit(&self, plan: impl Iterator<Item = PlannedDrive>) -> Option<u32> {
        let burst_us = compute_longest_burst_and_credit_of_plan(0, REST_US, plan).longest_burst_us;
        // A channel must stop in the moment in which its burst reaches the limit.
        (burst_us >= self.burst_limit_us).then(|| u32::try_from(burst_us / 1000 + 1).unwrap_or(u32::MAX))
    }

    /// Time in ms that a channel must wait before it may drive as planned without being stopped in between; `None` if it may now. `last` is
    /// what it drives before the plan begins. What is earned meanwhile is not counted.
    #[must_use]
    pub fn required_wait_ms_for_burst_and_credit_of_plan(
        &self,
        channel: usize,
        last: PlannedDrive,
        plan: impl Iterator<Item = PlannedDrive>,
    ) -> Option<u32> {
        let account = self.accounts.get(channel)?;
        let cost = compute_longest_burst_and_credit_of_plan(
            account.burst_us,
            account.rested_us,
            core::iter::once(last).chain(plan),
        );
        let rest_us = if cost.longest_burst_us < self.burst_limit_us {
            0
        } else if last.drive_us == 0 {
            REST_US.saturating_sub(account.rested_us).max(1)
        } else {
            last.drive_us.saturating_add(REST_US)
        };
        // A channel must stop in the moment in which nothing is left.
        let missing = cost.credit.saturating_add(1).saturating_sub(account.credit);
        let wait_us = rest_us.max(missing.div_ceil(EARNED_PER_US));
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
    pub fn last_credit_charge_rate(&self, channel: usize) -> CreditCharge {
        self.accounts.get(channel).map_or(CreditCharge::NONE, |account| account.charge)
    }
}

/// What a plan takes of an account with this burst and this rest.
fn compute_longest_burst_and_credit_of_plan(
    mut burst_us: u64,
    mut rested_us: u64,
    plan: impl Iterator<Item = PlannedDrive>,
) -> PlanCost {
    let mut cost = PlanCost { longest_burst_us: 0, credit: 0 };
    for PlannedDrive { rest_us, drive_us, charge } in plan {
        rested_us = rested_us.saturating_add(rest_us);
        if rested_us >= REST_US {
            burst_us = 0;
        }
        if drive_us > 0 {
            (burst_us, rested_us) = (burst_us.saturating_add(drive_us), 0);
            cost.longest_burst_us = cost.longest_burst_us.max(burst_us);
            cost.credit = cost.credit.saturating_add(drive_us.saturating_mul(u64::from(charge.as_ppm())));
        }
    }
    cost
}
