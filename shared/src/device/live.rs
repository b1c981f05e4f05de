//! What happens by itself: time-outs, the self-test, the rails, the timers' next periods.

use super::{Device, Goals};
use crate::MAX_CHANNELS;
use crate::board::Board;
use crate::limits::{BLEEDER_MS, DISCHARGE_LIMIT_MS};
use crate::protocol::{ChannelLimits, FaultCode, Refusal};
use crate::safety::{Action, Charge, Event, SelfTest, State, Verdict};
use crate::supply::{Finding, RAILS, Senses, charged, rail_of};
use crate::waveform::{FULL_STRENGTH, Sequencer};

/// Between two looks at the senses, in us; the soft start's steps follow it, and levels of envelopes are worked out as often
/// (they take effect at the next boundary of the drive).
const TICK_US: u64 = 1_000;
/// A rail this many parts in a hundred above its set-point is taken into account in the windows' width; what is less is the
/// measurement's own error.
const RAIL_EXCESS_PERCENT: u32 = 2;

impl Device {
    /// To be called at least every ms. Returns when it wants to be called again, in us of the board's time.
    pub fn poll(&mut self, board: &mut impl Board) -> u64 {
        let now_us = board.now_us();
        if let Some(silence_us) = self.safety.silent_for_us(now_us) {
            let silence_ms = u32::try_from(silence_us / 1000).unwrap_or(u32::MAX);
            self.raise(board, FaultCode::HostSilent, silence_ms, now_us);
        }
        if now_us >= self.next_tick_us {
            // Not a fixed grid: after a pause there is nothing to catch up with.
            self.next_tick_us = now_us + TICK_US;
            if let Err((code, detail)) = self.tick(board, now_us) {
                self.raise(board, code, detail, now_us);
            }
        }
        if let Err((code, detail)) = self.sequence(board) {
            self.raise(board, code, detail, now_us);
        }
        let due_us = self.sequencer.as_ref().and_then(Sequencer::due_us).unwrap_or(u64::MAX);
        due_us.min(self.next_tick_us)
    }

    fn tick(&mut self, board: &mut impl Board, now_us: u64) -> Result<(), Finding> {
        let senses = board.sense();
        self.measured_millivolts = senses.rail_millivolts;
        if let Some(finding) = senses.trip {
            return Err(finding);
        }
        // In every state: who is off earns and rests.
        let charges = self.charges(&board.info().channels, &senses);
        let spent = self.budget.step(now_us, charges);
        match self.state() {
            State::Boot => Ok(()),
            State::Safe => match charged(&senses) {
                Some(rail) => Err((FaultCode::RailImplausible, rail)),
                None => Ok(()),
            },
            State::Discharging | State::Fault => match charged(&senses) {
                // A measurement that was found wrong does not get to say that a rail is safe: the bleeder does.
                None if self.state() == State::Fault || self.distrusts(now_us) => Ok(()),
                None => {
                    self.distrusted = false;
                    // Accepted in this state alone, so it cannot be refused.
                    let _ = self.step(board, Event::Discharged, &Goals::default());
                    Ok(())
                }
                Some(rail)
                    if !self.still_charged
                        && now_us.saturating_sub(self.off_since_us) > u64::from(DISCHARGE_LIMIT_MS) * 1000 =>
                {
                    // Counted once, also where another fault came first.
                    self.still_charged = true;
                    Err((FaultCode::DischargeFailed, rail))
                }
                Some(_) => Ok(()),
            },
            State::Arming => self.test(board, now_us, &senses),
            State::Armed | State::Running => {
                self.end_spent(spent);
                self.supervise(board, now_us, &senses)
            }
        }
    }

    /// Whether the rails may still be charged whatever the measurement says.
    const fn distrusts(&self, now_us: u64) -> bool {
        self.distrusted && now_us.saturating_sub(self.off_since_us) < BLEEDER_MS as u64 * 1000
    }

    /// One step of the self-test.
    fn test(&mut self, board: &mut impl Board, now_us: u64, senses: &Senses) -> Result<(), Finding> {
        let Some(self_test) = &mut self.self_test else { return Err((FaultCode::ArmFailed, 0)) };
        match self_test.step(now_us, senses) {
            Verdict::Going(supply) => {
                self.supply = supply;
                board.set_supply(&supply);
                Ok(())
            }
            Verdict::TryTrips => board.test_trips(),
            Verdict::Failed(finding) => Err(finding),
            Verdict::Passed => {
                self.self_test = None;
                let held = self.held.take();
                // Faults have been raised where they arose.
                if self.step(board, Event::TestPassed, &Goals::default()).is_ok()
                    && let Some(goals) = held
                {
                    let event = if goals.iter().any(Option::is_some) { Event::Drive } else { Event::Rest };
                    let _ = self.step(board, event, &goals);
                }
                Ok(())
            }
        }
    }

    /// Which channels' electrodes are in use.
    fn driving(&self) -> [bool; MAX_CHANNELS] {
        let sequencer = self.sequencer.as_ref();
        core::array::from_fn(|channel| sequencer.is_some_and(|sequencer| sequencer.drives(channel)))
    }

    /// What the channels in use cost of their credit. By the windows that the timers go through, or will next, if those are
    /// wider, and by the rail as it is measured or set, whichever is more: so a drive is charged for what it does, not for
    /// what was asked for. An effect costs what its level does, a rail that is still on its way up or down costs what it
    /// has, and a drive that was replaced costs what it did until its last boundary.
    fn charges(&self, limits: &[ChannelLimits], senses: &Senses) -> [Option<Charge>; MAX_CHANNELS] {
        let sequencer = self.sequencer.as_ref();
        core::array::from_fn(|channel| {
            let period = sequencer.and_then(|sequencer| sequencer.strongest(channel))?;
            let rail = rail_of(channel);
            let number = |values: &[u32; RAILS]| values.get(rail).copied().unwrap_or(u32::MAX);
            let millivolts = number(&senses.rail_millivolts).max(number(&self.supply.set_point_millivolts));
            let largest = limits.get(channel).map_or(0, |limits| limits.max_voltage_millivolts);
            Some(Charge::of(&period, millivolts, largest))
        })
    }

    /// Ends the drives of channels that have driven for as long as they may.
    fn end_spent(&mut self, spent: [bool; MAX_CHANNELS]) {
        let Some(sequencer) = &mut self.sequencer else { return };
        for ((channel, spent), active) in spent.into_iter().enumerate().zip(&mut self.active) {
            if spent {
                sequencer.end(channel);
                *active = None;
            }
        }
    }

    /// Rails and plausibility while live.
    fn supervise(&mut self, board: &mut impl Board, now_us: u64, senses: &Senses) -> Result<(), Finding> {
        if let Some(finding) = self.watch.look(now_us, senses, &self.supply) {
            return Err(finding);
        }
        board.check_timers()?;
        self.supply = self.rails.step(now_us, senses);
        board.set_supply(&self.supply);
        let Some(sequencer) = &mut self.sequencer else { return Err((FaultCode::ArmFailed, 0)) };
        set_strengths(sequencer, self.rails.aims(), self.measured_millivolts);
        let wanted = (0..MAX_CHANNELS).any(|channel| sequencer.goal(channel).is_some());
        if self.state() == State::Running && !wanted {
            let _ = self.step(board, Event::Rest, &Goals::default());
        } else if self.state() == State::Armed && self.connected && !self.driving().contains(&true) {
            self.connected = false;
            board.connect_electrodes(false).map_err(|code| (code, 0))?;
        }
        Ok(())
    }

    /// Writes what the timers must do next.
    pub(super) fn sequence(&mut self, board: &mut impl Board) -> Result<(), Finding> {
        let Some(sequencer) = &mut self.sequencer else { return Ok(()) };
        for channel in 0..MAX_CHANNELS {
            // Read anew for each: working out the one before took its time, and the margin before a boundary is short.
            if let Some(preload) = sequencer.next(channel, board.now_us()) {
                board.preload(&preload).map_err(|code| (code, u32::try_from(channel).unwrap_or(0)))?;
            }
        }
        Ok(())
    }

    /// Lets an event happen and carries out what the table says, or refuses.
    pub(super) fn step(&mut self, board: &mut impl Board, event: Event, goals: &Goals) -> Result<(), Refusal> {
        let action = self.safety.on(event).map_err(|state| Refusal::State { state, event })?;
        let now_us = board.now_us();
        self.carry_out(board, action, goals, now_us).map_err(|(code, detail)| {
            self.raise(board, code, detail, now_us);
            self.safety.fault().map_or(Refusal::Malformed, Refusal::Fault)
        })
    }

    fn carry_out(&mut self, board: &mut impl Board, action: Action, goals: &Goals, now_us: u64) -> Result<(), Finding> {
        match action {
            Action::Keep => Ok(()),
            Action::Off => {
                self.all_off(board, now_us);
                Ok(())
            }
            Action::Test => {
                self.self_test = Some(SelfTest::new(now_us));
                Ok(())
            }
            Action::Enable => {
                board.start_timers().map_err(|code| (code, 0))?;
                let started_us = board.now_us();
                let clock_hz = board.info().channels.first().map_or(0, |limits| limits.timer_clock_hz);
                self.sequencer = Some(Sequencer::new(clock_hz / 1_000_000, started_us));
                // The rails stay where the self-test has brought them until a drive asks for more.
                self.rails.aim(self.supply.set_point_millivolts);
                self.rails.begin(self.supply.set_point_millivolts, now_us);
                Ok(())
            }
            Action::Apply if self.state() == State::Arming => {
                self.held = Some(*goals);
                self.show(goals);
                Ok(())
            }
            Action::Apply => self.apply(board, goals, now_us),
        }
    }

    fn apply(&mut self, board: &mut impl Board, goals: &Goals, now_us: u64) -> Result<(), Finding> {
        // A rail that feeds nobody stays charged, so that the next touch need not wait for its soft start.
        let mut aims = self.rails.aims();
        for (rail, aim) in aims.iter_mut().enumerate() {
            let fed = goals.iter().enumerate().filter(|(channel, _)| rail_of(*channel) == rail);
            let highest = fed.filter_map(|(_, goal)| goal.map(|goal| goal.program.voltage_millivolts)).max();
            *aim = highest.unwrap_or(*aim);
        }
        self.rails.aim(aims);
        let sequencer = self.sequencer.as_mut().ok_or((FaultCode::DriveFailed, 0))?;
        sequencer.set_goals(goals, now_us);
        // From the first period on, which may begin before the next look: a rail that was higher is let down in some ms.
        set_strengths(sequencer, aims, self.measured_millivolts);
        if goals.iter().any(Option::is_some) && !self.connected {
            board.connect_electrodes(true).map_err(|code| (code, 0))?;
            self.connected = true;
        }
        self.show(goals);
        self.sequence(board)
    }

    fn show(&mut self, goals: &Goals) {
        self.active = goals.map(|goal| goal.map(|goal| goal.program.achieved));
    }
}

/// Sets the strengths of all drives for rails that go to `aims` and have `measured`, both in mV: of a rail that is still above, what was
/// measured counts.
fn set_strengths(sequencer: &mut Sequencer, aims: [u32; RAILS], measured: [u32; RAILS]) {
    for channel in 0..MAX_CHANNELS {
        let Some(goal) = sequencer.goal(channel) else { continue };
        let of_rail = |values: [u32; RAILS]| values.get(rail_of(channel)).copied().unwrap_or(0);
        let (aim, measured) = (of_rail(aims), of_rail(measured));
        let excess = measured > aim.saturating_add(aim / 100 * RAIL_EXCESS_PERCENT);
        let there = if excess { measured } else { aim };
        sequencer.set_strength(channel, strength(goal.program.voltage_millivolts, there));
    }
}

/// The part of the full force that windows must make when `wanted` mV are to act and the rail has `there` mV, in parts of
/// [`FULL_STRENGTH`]: the force goes with the voltage's square.
fn strength(wanted: u32, there: u32) -> u32 {
    if there <= wanted {
        return FULL_STRENGTH;
    }
    let full = u64::from(FULL_STRENGTH);
    let ratio = u64::from(wanted) * full / u64::from(there);
    u32::try_from(ratio * ratio / full).unwrap_or(FULL_STRENGTH)
}
