//! What the electrodes' pins did, rebuilt from the registers that counted.

use super::channels::CHANNELS;
use crate::error::Error;
use era_shared::waveform::{Electrode, Pulse, PulseCheck, TimerModel, TimerRegisters};
use serde::Deserialize;

/// A change of what a timer's outputs do, from the bridge's op `history`.
#[derive(Clone, Debug, Deserialize)]
pub struct TimerChange {
    timer: String,
    /// When, in clocks since power-up.
    clock: u64,
    /// When the counter was zero, with these registers.
    origin: u64,
    /// Whether the outputs reach the pins.
    outputs: bool,
    psc: u32,
    arr: u32,
    ccr: [u32; 4],
    cr1: u32,
    ccmr1: u32,
    ccmr2: u32,
    ccer: u32,
}

impl TimerChange {
    fn timer_registers(&self) -> TimerRegisters {
        /// BDTR.MOE.
        const MOE: u32 = 1 << 15;
        TimerRegisters {
            cr1: self.cr1,
            ccmr1: self.ccmr1,
            ccmr2: self.ccmr2,
            ccer: self.ccer,
            psc: self.psc,
            arr: self.arr,
            ccr: self.ccr,
            bdtr: if self.outputs { MOE } else { 0 },
        }
    }
}

/// One channel's pins.
#[derive(Debug, Default)]
pub struct ChannelPins {
    current: Option<(TimerChange, TimerModel)>,
    /// What its pulses were like since the last [`PinEdges::forget_pulses_and_their_statistics`].
    pub check: PulseCheck,
    /// Every pulse since then; one that was cut in two by the end of a look is told in two parts that touch.
    pub pulses: Vec<Pulse>,
    /// Since when the outputs have been off, in clocks; `None` while they are on.
    pub off_since: Option<u64>,
}

impl ChannelPins {
    /// Origin of the counting and clocks in a tick and in a period, of the registers that count now.
    pub fn origin_and_clocks_per_tick_and_per_period_if_any_change_seen(&self) -> Option<(u64, u64, u64)> {
        let (record, _) = self.current.as_ref()?;
        let divider = u64::from(record.psc) + 1;
        Some((record.origin, divider, divider * (u64::from(record.arr) + 1)))
    }

    fn record_pulses_until(&mut self, until_clock: u64) -> Result<(), Error> {
        let Some((record, model)) = &mut self.current else { return Ok(()) };
        if !record.outputs {
            return Ok(());
        }
        let (check, pulses, from) = (&mut self.check, &mut self.pulses, record.clock);
        let told = model.run_until(until_clock, |pulse| {
            // The outputs were not yet connected in what lies before.
            let pulse = Pulse { from: pulse.from.max(from), ..pulse };
            if pulse.from < pulse.to {
                check.add_pulse_to_guard_and_overlap_statistics(pulse);
                pulses.push(pulse);
            }
        });
        told.map_err(|error| Error::NoReply(format!("windows of {}: {error:?}", record.timer)))
    }

    fn apply_timer_change(&mut self, change: &TimerChange) -> Result<(), Error> {
        self.record_pulses_until(change.clock)?;
        self.off_since = if change.outputs { None } else { Some(self.off_since.unwrap_or(change.clock)) };
        self.current = Some((change.clone(), TimerModel::new(change.timer_registers(), change.origin)));
        Ok(())
    }
}

/// All channels.
#[derive(Debug, Default)]
pub struct PinEdges {
    /// In the order of the channels.
    pub tracks: [ChannelPins; 4],
}

impl PinEdges {
    /// Takes note of changes, and of what happened up to `now_clock`.
    ///
    /// # Errors
    /// [`Error::NoReply`] if registers made something else than windows.
    pub fn apply_timer_changes(&mut self, changes: &[TimerChange], now_clock: u64) -> Result<(), Error> {
        for record in changes {
            let place = CHANNELS.iter().position(|channel| channel.timer == record.timer);
            if let Some(track) = place.and_then(|place| self.tracks.get_mut(place)) {
                track.apply_timer_change(record)?;
            }
        }
        self.tracks.iter_mut().try_for_each(|track| track.record_pulses_until(now_clock))
    }

    /// Forgets the pulses so far.
    pub fn forget_pulses_and_their_statistics(&mut self) {
        for track in &mut self.tracks {
            track.check = PulseCheck::default();
            track.pulses.clear();
        }
    }

    /// When the last of the outputs went off, if all are off.
    pub fn all_off_since_clock(&self) -> Option<u64> {
        self.tracks.iter().map(|track| track.off_since).try_fold(0, |latest, off| off.map(|off| latest.max(off)))
    }

    /// Overlap, least guard and number of pulses over all channels.
    pub fn overlap_and_least_guard_clocks_and_pulse_count(&self) -> (u64, Option<u64>, u64) {
        let checks = || self.tracks.iter().map(|track| &track.check);
        (
            checks().map(|check| check.overlap).sum(),
            checks().filter_map(|check| check.least_guard).min(),
            checks().map(|check| check.pulses).sum(),
        )
    }
}

/// Whether electrode A or B, as a letter.
pub fn electrode_letter(electrode: Electrode) -> char {
    match electrode {
        Electrode::A => 'A',
        Electrode::B => 'B',
    }
}
