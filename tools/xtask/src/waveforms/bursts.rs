//! Sequences of windows: the pulses at the pins against what the message asked for.
//!
//! What is expected is added up here from the pauses and widths of the message, in ticks of 17 clocks from one common clock on; nothing of
//! it comes from the code that places windows and cuts them into periods.

use era_shared::MAX_CHANNELS;
use era_shared::protocol::{ChannelDrive, ChannelLimits};
use era_shared::waveform::{
    ChannelGoal, Electrode, ModelTimers, OutputPair, PlacedWindows, Pulse, SequenceWindow, compute_channel_program,
};
use fastrand::Rng;

/// Clocks in a tick of a sequence: 0.1 us at 170 MHz.
const TICK_CLOCKS: u64 = 17;
/// Every pair of outputs that the board has.
const OUTPUTS: [OutputPair; 2] = [OutputPair { a: 1, b: 3 }, OutputPair { a: 1, b: 4 }];
/// Least pause and least and greatest width in ticks, as protocol.md has them.
const LEAST_WAIT: u32 = 2_000;
const WIDTHS: std::ops::RangeInclusive<u32> = 3_000..=56_034;
/// Sequences on one set of timers before it is thrown away.
const SEQUENCES: u64 = 5;
/// A look at the timers comes this late at most, in us: so long the device is busy with a request.
const LATEST_US: u64 = 250;

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct BurstTally {
    pub sequences: u64,
    pub windows: u64,
    /// Stretches in which both electrodes of an ERA were on.
    pub overlaps: u64,
    pub short_guards: u64,
    /// Edges that are not at their clock, and pulses that nobody asked for.
    pub misplaced: u64,
    /// Windows without a pulse.
    pub missed: u64,
    /// The least guard in clocks.
    pub least_guard: Option<u64>,
}

impl BurstTally {
    /// Takes in what another has found.
    pub fn merge(&mut self, other: &Self) {
        self.sequences += other.sequences;
        self.windows += other.windows;
        self.overlaps += other.overlaps;
        self.short_guards += other.short_guards;
        self.misplaced += other.misplaced;
        self.missed += other.missed;
        self.least_guard = self.least_guard.into_iter().chain(other.least_guard).min();
    }

    /// Whether nothing is wrong.
    pub const fn is_good(&self) -> bool {
        self.overlaps + self.short_guards + self.misplaced + self.missed == 0
    }

    /// Compares the pulses of one channel from the sequence's beginning on with those that were asked for.
    fn compare_pulses(&mut self, expected: &[Pulse], played: &[Pulse]) {
        let mut strays = played.to_vec();
        for asked in expected {
            let near =
                |pulse: &Pulse| pulse.electrode == asked.electrode && pulse.from < asked.to && pulse.to > asked.from;
            match strays.iter().position(near).map(|place| strays.remove(place)) {
                None => self.missed += 1,
                Some(pulse) => {
                    self.misplaced += u64::from(pulse.from != asked.from) + u64::from(pulse.to != asked.to);
                }
            }
        }
        self.misplaced += strays.len() as u64;
    }

    /// Checks what lies between the pulses of one channel.
    fn check_guards(&mut self, pulses: &[Pulse], guard_clocks: u64) {
        for two in pulses.windows(2) {
            let [before, after] = two else { continue };
            let guard = after.from.saturating_sub(before.to);
            self.overlaps += u64::from(after.from < before.to);
            self.short_guards += u64::from(guard < guard_clocks);
            self.least_guard = self.least_guard.into_iter().chain([guard]).min();
        }
    }
}

/// What the pins have to do: begin and end of each window, in clocks from `start` on, by channel.
fn list_expected_pulses(windows: &[SequenceWindow], start: u64) -> [Vec<Pulse>; MAX_CHANNELS] {
    let mut pulses: [Vec<Pulse>; MAX_CHANNELS] = Default::default();
    for window in windows {
        let Some(own) = pulses.get_mut(usize::from(window.channel)) else { continue };
        let from = own.last().map_or(start, |last| last.to) + TICK_CLOCKS * u64::from(window.wait_ticks);
        own.push(Pulse { electrode: window.electrode, from, to: from + TICK_CLOCKS * u64::from(window.width_ticks) });
    }
    pulses
}

/// Timers on which sequences are played.
struct BurstRun<'a> {
    limits: &'a ChannelLimits,
    random: Rng,
    timers: ModelTimers,
    pulses: [Vec<Pulse>; MAX_CHANNELS],
    now_us: u64,
    is_wrong: bool,
}

impl BurstRun<'_> {
    /// Lets time pass as on the board: looked at every ms and when the sequencer wants it, and a little late.
    fn pass_time_polling_timers(&mut self, end_us: u64) {
        while self.now_us < end_us {
            let due_us = self.timers.sequencer.next_extra_poll_time_us_if_playing_or_too_near().unwrap_or(u64::MAX);
            let late_us =
                if self.random.u32(0..4) == 0 { self.random.u64(0..LATEST_US) } else { self.random.u64(0..30) };
            self.now_us = (self.now_us + 1_000).min(due_us.max(self.now_us + 1)) + late_us;
            let pulses = &mut self.pulses;
            let polled = self.timers.run_and_preload(self.now_us, |channel, pulse| {
                let Some(own) = pulses.get_mut(channel) else { return };
                // A pulse that goes on from one look to the next is told in parts.
                match own.last_mut() {
                    Some(last) if last.electrode == pulse.electrode && last.to == pulse.from => last.to = pulse.to,
                    _ => own.push(pulse),
                }
            });
            self.is_wrong |= polled.is_err();
        }
    }

    /// Drives on some channels, so that the sequence finds timers in the middle of something.
    fn begin_random_drives(&mut self) {
        let mut goals = [None; MAX_CHANNELS];
        for (channel, goal) in (0_u8..).zip(&mut goals) {
            if self.random.bool() {
                continue;
            }
            let drive = ChannelDrive {
                channel,
                frequency_millihertz: self.random.u32(self.limits.min_frequency_millihertz..400_000),
                pulse_width_ppm: self.random.u32(10_000..600_000),
                phase_microturns: self.random.u32(0..1_000_000),
                voltage_millivolts: 1_000_000,
            };
            let program = compute_channel_program(self.limits, &drive).ok();
            *goal = program.map(|program| ChannelGoal { program, drives_without_envelope: true });
        }
        self.timers.sequencer.set_or_end_drives_from_next_boundary(&goals, self.now_us);
    }

    fn make_random_windows(&mut self) -> Vec<SequenceWindow> {
        let channels = self.random.u8(1..=MAX_CHANNELS as u8);
        let count = self.random.usize(1..=24);
        let random = &mut self.random;
        std::iter::repeat_with(|| {
            // Pauses from the shortest over those about as long as a blank period to those that need several; and widths at both ends.
            let wait_ticks = match random.u32(0..8) {
                0 | 1 => LEAST_WAIT + random.u32(0..3),
                2 | 3 => random.u32(LEAST_WAIT..12_000),
                4 => random.u32(6_990..7_010),
                5 => random.u32(60_000..80_000),
                6 => random.u32(LEAST_WAIT..300_000),
                _ => random.u32(LEAST_WAIT..1_000_000),
            };
            let width_ticks = match random.u32(0..4) {
                0 => *WIDTHS.start() + random.u32(0..3),
                1 => *WIDTHS.end() - random.u32(0..3),
                _ => random.u32(WIDTHS),
            };
            let electrode = if random.bool() { Electrode::A } else { Electrode::B };
            SequenceWindow { channel: random.u8(0..channels), electrode, wait_ticks, width_ticks }
        })
        .take(count)
        .collect()
    }

    /// Plays one sequence and adds what the pins did to the tally.
    fn play_random_sequence_and_count_differences(&mut self, tally: &mut BurstTally) {
        if self.random.bool() {
            self.begin_random_drives();
        }
        let wait_us = self.random.u64(0..60_000);
        self.pass_time_polling_timers(self.now_us + wait_us);
        let windows = self.make_random_windows();
        tally.sequences += 1;
        tally.windows += windows.len() as u64;
        let limits = [*self.limits; MAX_CHANNELS];
        let Ok(mut placed) = PlacedWindows::from_sequence(&limits, &windows) else {
            // Everything is within the limits.
            tally.missed += windows.len() as u64;
            return;
        };
        let used = std::array::from_fn(|channel| windows.iter().any(|window| usize::from(window.channel) == channel));
        let sequencer = &mut self.timers.sequencer;
        // As early as can be, or a little later, at any clock.
        let later = if self.random.bool() { 0 } else { self.random.u64(0..5_000_000) };
        let start = sequencer.earliest_sequence_start_clock(used, self.now_us) + later;
        placed.set_start_clock(start);
        sequencer.play_windows_at_their_times_ending_drives_at_next_boundary(&placed, self.now_us);
        let expected = list_expected_pulses(&windows, start);
        let last = expected.iter().flatten().map(|pulse| pulse.to).max().unwrap_or(start);
        let clocks_per_us = u64::from(self.limits.timer_clock_hz / 1_000_000);
        let started_us = self.timers.sequencer.board_time_of_clock_us(0);
        self.pass_time_polling_timers(started_us + last / clocks_per_us + 3_000);
        for (channel, (asked, pulses)) in expected.iter().zip(&mut self.pulses).enumerate() {
            let played: Vec<Pulse> = pulses.iter().copied().filter(|pulse| pulse.to > start).collect();
            // On a channel without windows the last period of a drive goes on.
            if used.get(channel) == Some(&true) {
                tally.compare_pulses(asked, &played);
            }
            let guard = u64::from(self.limits.min_guard_ns) * u64::from(self.limits.timer_clock_hz) / 1_000_000_000;
            tally.check_guards(pulses, guard);
            // The last one stays for the guard before the next.
            pulses.drain(..pulses.len().saturating_sub(1));
        }
        self.is_wrong |= self.timers.sequencer.first_channel_with_missed_window().is_some();
        tally.missed += u64::from(std::mem::take(&mut self.is_wrong));
    }
}

/// Random sequences, on timers that drive something or rest.
pub fn check_random_window_sequences(limits: &ChannelLimits, count: u64, seed: u64) -> BurstTally {
    let mut tally = BurstTally::default();
    let mut random = Rng::with_seed(seed);
    while tally.sequences < count {
        let outputs = OUTPUTS[random.usize(0..OUTPUTS.len())];
        let started_us = random.u64(0..100_000);
        let mut run = BurstRun {
            limits,
            random: random.fork(),
            timers: ModelTimers::new(limits.timer_clock_hz / 1_000_000, started_us, outputs),
            pulses: Default::default(),
            now_us: started_us,
            is_wrong: false,
        };
        for _ in 0..SEQUENCES.min(count - tally.sequences) {
            run.play_random_sequence_and_count_differences(&mut tally);
        }
    }
    tally
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pulse(electrode: Electrode, from: u64, to: u64) -> Pulse {
        Pulse { electrode, from, to }
    }

    #[test]
    fn what_is_expected_follows_from_the_message() {
        let window = |channel, electrode, wait_ticks, width_ticks| SequenceWindow {
            channel,
            electrode,
            wait_ticks,
            width_ticks,
        };
        let message = [
            window(0, Electrode::A, 2_000, 3_000),
            window(2, Electrode::B, 2_500, 4_000),
            window(0, Electrode::B, 5_000, 10_000),
        ];
        let pulses = list_expected_pulses(&message, 1_000);
        // 2000, 5000, 10 000 and 20 000 ticks of 17 clocks after clock 1000.
        assert_eq!(pulses[0], [pulse(Electrode::A, 35_000, 86_000), pulse(Electrode::B, 171_000, 341_000)]);
        assert_eq!(pulses[2], [pulse(Electrode::B, 43_500, 111_500)]);
        assert!(pulses[1].is_empty() && pulses[3].is_empty());
    }

    #[test]
    fn every_kind_of_difference_is_counted() {
        let asked = [pulse(Electrode::A, 100, 200), pulse(Electrode::B, 300, 400)];
        let count = |played: &[Pulse]| {
            let mut tally = BurstTally::default();
            tally.compare_pulses(&asked, played);
            tally.check_guards(played, 100);
            (tally.overlaps, tally.short_guards, tally.misplaced, tally.missed)
        };
        assert_eq!(count(&asked), (0, 0, 0, 0));
        assert_eq!(count(&[asked[0], pulse(Electrode::B, 301, 401)]), (0, 0, 2, 0), "late by a clock");
        assert_eq!(count(&[asked[0], pulse(Electrode::B, 300, 399)]), (0, 0, 1, 0), "short by a clock");
        assert_eq!(count(&asked[..1]), (0, 0, 0, 1));
        assert_eq!(count(&[asked[0], pulse(Electrode::A, 300, 400)]), (0, 0, 1, 1), "the other electrode");
        assert_eq!(count(&[asked[0], pulse(Electrode::B, 299, 400)]), (0, 1, 1, 0), "a guard short by a clock");
        assert_eq!(count(&[pulse(Electrode::A, 100, 310), asked[1]]), (1, 1, 1, 0));
        assert_eq!(count(&[asked[0], asked[1], pulse(Electrode::A, 500, 600)]), (0, 0, 1, 0), "one too many");
    }

    #[test]
    fn sequences_are_played_to_the_clock() {
        let tally = check_random_window_sequences(&ChannelLimits::BOARD, 200, 3);
        assert!(tally.is_good() && tally.sequences == 200 && tally.windows > 1_000, "{tally:?}");
    }
}
