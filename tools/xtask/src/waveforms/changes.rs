//! Changes of drives on running timers: the sequencer over the modelled timers, at times that jitter.

use era_shared::MAX_CHANNELS;
use era_shared::protocol::{ChannelDrive, ChannelLimits};
use era_shared::waveform::{
    ChannelGoal, ChannelProgram, Effect, Electrode, ModelTimers, OutputPair, Pulse, compute_channel_program,
};
use fastrand::Rng;

const OUTPUTS: OutputPair = OutputPair { a: 1, b: 3 };
/// Steps on one set of timers before it is thrown away, so that times stay small and starts are seen too.
const STEPS: u64 = 40;

/// What was found.
#[derive(Clone, Debug)]
pub struct ChangeTally {
    pub drives: u64,
    pub steps: u64,
    pub pulses: u64,
    pub overlaps: u64,
    pub short_guards: u64,
    pub runts: u64,
    pub misses: u64,
    pub pairs: u64,
    pub least_guard_us: f64,
    pub worst_phase_ticks: f64,
}

impl Default for ChangeTally {
    fn default() -> Self {
        Self {
            drives: 0,
            steps: 0,
            pulses: 0,
            overlaps: 0,
            short_guards: 0,
            runts: 0,
            misses: 0,
            pairs: 0,
            least_guard_us: f64::INFINITY,
            worst_phase_ticks: 0.0,
        }
    }
}

impl ChangeTally {
    /// Takes in what another has found.
    pub fn merge(&mut self, other: &Self) {
        self.drives += other.drives;
        self.steps += other.steps;
        self.pulses += other.pulses;
        self.overlaps += other.overlaps;
        self.short_guards += other.short_guards;
        self.runts += other.runts;
        self.misses += other.misses;
        self.pairs += other.pairs;
        self.least_guard_us = self.least_guard_us.min(other.least_guard_us);
        self.worst_phase_ticks = self.worst_phase_ticks.max(other.worst_phase_ticks);
    }
}

struct TimerRun<'a> {
    limits: &'a ChannelLimits,
    random: Rng,
    timers: ModelTimers,
    /// The last two pulses of electrode A of each channel: the last one may still be going on.
    last_a: [[Option<Pulse>; 2]; MAX_CHANNELS],
    now_us: u64,
    missed: bool,
}

impl TimerRun<'_> {
    fn run_timers_until_now_and_record_last_a_pulses(&mut self) {
        let last_a = &mut self.last_a;
        let polled = self.timers.run_and_preload(self.now_us, |channel, pulse| {
            let Some([before, last]) = last_a.get_mut(channel) else { return };
            match last {
                _ if pulse.electrode != Electrode::A => {}
                Some(going) if going.to == pulse.from => going.to = pulse.to,
                _ => (*before, *last) = (*last, Some(pulse)),
            }
        });
        self.missed |= polled.is_err();
    }

    /// Lets time pass as on the board: looked at every ms, sometimes late, and when the sequencer wants it.
    fn pass_time_polling_timers(&mut self, milliseconds: u64) {
        let end_us = self.now_us + 1000 * milliseconds;
        while self.now_us < end_us {
            let late_us = if self.random.u32(0..20) == 0 { self.random.u64(0..2_500) } else { self.random.u64(0..30) };
            let due_us = self
                .timers
                .sequencer
                .next_extra_poll_time_us_if_playing_or_too_near()
                .unwrap_or(u64::MAX)
                .max(self.now_us + 1);
            self.now_us = (self.now_us + 1000).min(due_us) + late_us;
            self.run_timers_until_now_and_record_last_a_pulses();
        }
    }

    fn make_random_program(&mut self, channel: u8, frequency_millihertz: u32) -> Option<ChannelProgram> {
        let drive = ChannelDrive {
            channel,
            frequency_millihertz,
            pulse_width_ppm: self.random.u32(1_000..600_000),
            phase_microturns: self.random.u32(0..1_000_000),
            voltage_millivolts: 1_000_000,
        };
        compute_channel_program(self.limits, &drive).ok()
    }

    fn choose_random_frequency_millihertz(&mut self) -> u32 {
        // The whole range evenly over the octaves, mostly from 20 Hz on, and its upper end, where time is shortest.
        match self.random.u32(0..16) {
            0..4 => 1_000_000,
            4 => (10_f64.powf(3.0 + 1.301_03 * self.random.f64())) as u32,
            _ => (10_f64.powf(4.301_03 + 1.698_97 * self.random.f64())) as u32,
        }
        .clamp(self.limits.min_frequency_millihertz, self.limits.max_frequency_millihertz)
    }
}

/// Random drives after each other.
pub fn check_random_drive_changes_on_running_timers(
    limits: &ChannelLimits,
    drive_count: u64,
    seed: u64,
) -> ChangeTally {
    let mut tally = ChangeTally::default();
    let mut random = Rng::with_seed(seed);
    while tally.drives < drive_count {
        let run = TimerRun {
            limits,
            random: random.fork(),
            timers: ModelTimers::new(limits.timer_clock_hz / 1_000_000, 777, OUTPUTS),
            last_a: Default::default(),
            now_us: 777,
            missed: false,
        };
        check_random_drive_changes_on_one_set_of_timers(run, drive_count - tally.drives, &mut tally);
    }
    tally
}

fn check_random_drive_changes_on_one_set_of_timers(mut run: TimerRun<'_>, max_drives: u64, tally: &mut ChangeTally) {
    let limit_clocks = u64::from(run.limits.min_guard_ns) * u64::from(run.limits.timer_clock_hz) / 1_000_000_000;
    let mut narrowest = u64::MAX;
    let mut set = 0;
    for _ in 0..STEPS {
        if set >= max_drives {
            break;
        }
        let common = run.choose_random_frequency_millihertz();
        let mut goals = [None; MAX_CHANNELS];
        let drives_without_envelope = run.random.u32(0..8) > 0;
        for (channel, goal) in (0_u8..).zip(&mut goals) {
            // Half of the channels share a frequency, the others have one each or are off.
            let frequency = match run.random.u32(0..4) {
                0 | 1 => common,
                2 => run.choose_random_frequency_millihertz(),
                _ => continue,
            };
            if let Some(program) = run.make_random_program(channel, frequency) {
                narrowest = narrowest.min(u64::from(program.width) * u64::from(program.divider));
                set += 1;
                *goal = Some(ChannelGoal { program, drives_without_envelope });
            }
        }
        run.timers.sequencer.set_or_end_drives_from_next_boundary(&goals, run.now_us);
        run.run_timers_until_now_and_record_last_a_pulses();
        if !drives_without_envelope {
            // Played, reversed and all, at a start that falls anywhere.
            for channel in 0..MAX_CHANNELS {
                let start_us = run.now_us + run.random.u64(0..20_000);
                let _ = run.timers.sequencer.queue_effect_if_goal_and_queue_not_full(
                    channel,
                    start_us,
                    &Effect::new_click(3, 2),
                );
            }
        }
        // Most changes come before the last one has had its effect.
        let settle = run.random.u32(0..4) == 0;
        // A period of up to 1 s must end, a gap of as much pass, and two periods be seen.
        let milliseconds = if settle { 4_200 } else { run.random.u64(0..30) };
        run.pass_time_polling_timers(milliseconds);
        if settle && drives_without_envelope {
            record_worst_phase_error_of_channel_pairs_at_one_frequency(&run, &goals, tally);
        }
        tally.steps += 1;
    }
    tally.drives += set;
    tally.misses += u64::from(run.missed);
    for check in &run.timers.checks {
        tally.pulses += check.pulses;
        tally.overlaps += u64::from(check.overlap > 0);
        if let Some(guard) = check.least_guard {
            tally.short_guards += u64::from(guard < limit_clocks);
            let guard_us = guard as f64 / f64::from(run.limits.timer_clock_hz) * 1e6;
            tally.least_guard_us = tally.least_guard_us.min(guard_us);
        }
        tally.runts += u64::from(check.least_pulse.is_some_and(|pulse| pulse < narrowest));
    }
}

/// Compares the phases of all channels at one frequency with what was commanded.
fn record_worst_phase_error_of_channel_pairs_at_one_frequency(
    run: &TimerRun<'_>,
    goals: &[Option<ChannelGoal>; MAX_CHANNELS],
    tally: &mut ChangeTally,
) {
    let middle = |channel: usize| {
        let [before, _] = run.last_a.get(channel)?;
        before.map(|pulse| (pulse.from + pulse.to) as f64 / 2.0)
    };
    let asked = |goal: &ChannelGoal| goal.program.achieved.phase_microturns;
    for (first, one) in goals.iter().enumerate() {
        for (second, other) in goals.iter().enumerate().skip(first + 1) {
            let (Some(one), Some(other)) = (one, other) else { continue };
            if (one.program.divider, one.program.ticks) != (other.program.divider, other.program.ticks) {
                continue;
            }
            let (Some(here), Some(there)) = (middle(first), middle(second)) else { continue };
            let clocks = one.program.period_clocks() as f64;
            let asked = (f64::from(asked(other)) - f64::from(asked(one))) / 1e6;
            let turns = ((here - there) / clocks - asked + 0.5).rem_euclid(1.0) - 0.5;
            tally.worst_phase_ticks = tally.worst_phase_ticks.max(turns.abs() * f64::from(one.program.ticks));
            tally.pairs += 1;
        }
    }
}
