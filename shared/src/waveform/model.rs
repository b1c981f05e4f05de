//! A timer as RM0440 describes it, seen from the electrodes' pins: for tests and reports, which rebuild from register writes
//! what the pins did and check it.
//!
//! Modelled: counting up with prescaler (28.3.2), update events and preload (28.3.1, 28.3.4), combined PWM (28.3.13), break
//! and idle state with OSSI set (28.3.17: outputs low while MOE is 0, MOE cleared by hardware and set by software alone).

use super::edges::{Electrode, ElectrodeWindows, TickWindow, WindowsError};
use super::period::IDLE;
use super::registers::{OutputPair, TimerRegisters};
use super::sequencer::Sequencer;
use crate::MAX_CHANNELS;

/// One stretch of time in which an electrode's pin is high, in clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulse {
    /// Which electrode.
    pub electrode: Electrode,
    /// First clock.
    pub from: u64,
    /// First clock after it.
    pub to: u64,
}

/// A running timer.
#[derive(Clone, Debug)]
pub struct TimerModel {
    active: TimerRegisters,
    preload: TimerRegisters,
    /// When the running period began, in clocks.
    began: u64,
    /// Up to which clock pulses have been reported.
    told: u64,
    broken: bool,
}

impl TimerModel {
    /// A timer that begins to count at `began`, its registers loaded by an update event.
    #[must_use]
    pub const fn new(registers: TimerRegisters, began: u64) -> Self {
        Self { active: registers, preload: registers, began, told: began, broken: false }
    }

    /// Writes the preload registers. The caller has run the model up to the time of the write.
    pub const fn write_preload_registers(&mut self, registers: TimerRegisters) {
        self.preload = registers;
    }

    /// A break clears MOE at once.
    pub const fn trip_break(&mut self) {
        self.broken = true;
    }

    /// Software sets MOE again.
    pub const fn enable_main_output_again(&mut self) {
        self.broken = false;
    }

    /// Clock at which the running period ends.
    #[must_use]
    pub const fn next_update_clock(&self) -> u64 {
        self.began + ((self.active.psc & 0xFFFF) as u64 + 1) * ((self.active.arr & 0xFFFF) as u64 + 1)
    }

    /// Runs up to `until_clock` and reports every pulse, or the part of it before `until_clock`: a pulse that goes on is reported in two
    /// parts that touch.
    ///
    /// # Errors
    /// [`WindowsError`] if the registers make anything but windows.
    pub fn run_until(&mut self, until_clock: u64, mut on_pulse: impl FnMut(Pulse)) -> Result<(), WindowsError> {
        while self.told < until_clock {
            let end = self.next_update_clock().min(until_clock);
            if !self.broken {
                let windows = ElectrodeWindows::from_registers(&self.active)?;
                let mut told = [(Electrode::A, windows.a), (Electrode::B, windows.b)];
                told.sort_unstable_by_key(|(_, window)| window.start);
                for (electrode, TickWindow { start, length }) in told {
                    let at = |tick: u32| self.began + u64::from(tick) * u64::from(windows.divider);
                    let (from, to) = (at(start).max(self.told), at(start + length).min(end));
                    if from < to {
                        on_pulse(Pulse { electrode, from, to });
                    }
                }
            }
            self.told = end;
            if end == self.next_update_clock() {
                (self.began, self.active) = (end, self.preload);
            }
        }
        Ok(())
    }
}

/// Checks the pulses of one ERA as they come.
#[derive(Clone, Debug, Default)]
pub struct PulseCheck {
    last: Option<Pulse>,
    /// Clocks in which both electrodes were on.
    pub overlap: u64,
    /// The shortest time between two pulses, in clocks; `None` before there were two.
    pub least_guard: Option<u64>,
    /// The shortest pulse, in clocks; one that is still going on does not count.
    pub least_pulse: Option<u64>,
    /// Pulses that have ended.
    pub pulses: u64,
}

impl PulseCheck {
    /// Adds the next pulse to the statistics.
    pub fn add_pulse_to_guard_and_overlap_statistics(&mut self, next: Pulse) {
        if let Some(last) = &mut self.last {
            if last.electrode == next.electrode && last.to == next.from {
                last.to = next.to;
                return;
            }
            let (ended, guard) = (last.to - last.from, next.from.saturating_sub(last.to));
            self.overlap += last.to.saturating_sub(next.from);
            self.least_guard = Some(self.least_guard.map_or(guard, |least| least.min(guard)));
            self.least_pulse = Some(self.least_pulse.map_or(ended, |least| least.min(ended)));
            self.pulses += 1;
        }
        self.last = Some(next);
    }
}

/// All timers of a board, their pins watched, under a [`Sequencer`].
#[derive(Clone, Debug)]
pub struct ModelTimers {
    /// Decides what the timers do.
    pub sequencer: Sequencer,
    /// Statistics of the pulses at each channel's pins.
    pub checks: [PulseCheck; MAX_CHANNELS],
    timers: [TimerModel; MAX_CHANNELS],
    outputs: OutputPair,
}

/// What the sequencer got wrong about a timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelError {
    /// The registers make no windows.
    Windows(WindowsError),
    /// A preload was meant for a boundary that is not the timer's next.
    Boundary {
        /// The channel.
        channel: usize,
        /// The boundary that was meant, in clocks.
        meant: u64,
        /// The next one.
        next: u64,
    },
}

impl ModelTimers {
    /// Timers that start together at `started_us`, with a clock of `clocks_per_us` MHz.
    #[must_use]
    pub fn new(clocks_per_us: u32, started_us: u64, outputs: OutputPair) -> Self {
        let timer = TimerModel::new(TimerRegisters::for_running_timer(&IDLE, outputs), 0);
        Self {
            sequencer: Sequencer::new(clocks_per_us, started_us),
            checks: Default::default(),
            timers: core::array::from_fn(|_| timer.clone()),
            outputs,
        }
    }

    /// Runs the timers up to `now_us`, reports every pulse with its channel, then writes the preloads that the sequencer asks for.
    ///
    /// # Errors
    /// [`ModelError`].
    pub fn run_and_preload(&mut self, now_us: u64, mut on_pulse: impl FnMut(usize, Pulse)) -> Result<(), ModelError> {
        let now = self.sequencer.clocks_since_start(now_us);
        for (channel, (timer, check)) in self.timers.iter_mut().zip(&mut self.checks).enumerate() {
            let told = timer.run_until(now, |told| {
                check.add_pulse_to_guard_and_overlap_statistics(told);
                on_pulse(channel, told);
            });
            told.map_err(ModelError::Windows)?;
        }
        for preload in self.sequencer.take_due_preloads(now_us) {
            let Some(timer) = self.timers.get_mut(preload.channel) else { continue };
            let next = timer.next_update_clock();
            if preload.at != next || next <= now {
                return Err(ModelError::Boundary { channel: preload.channel, meant: preload.at, next });
            }
            timer.write_preload_registers(TimerRegisters::for_running_timer(&preload.period, self.outputs));
        }
        Ok(())
    }
}
