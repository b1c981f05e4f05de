//! `cargo xtask waveforms`: the waveform arithmetic over its whole parameter space, seen from the electrodes' pins.

mod bursts;
mod changes;
mod drives;

use crate::error::Error;
use era_shared::protocol::ChannelLimits;
use std::thread;

/// The frequency error that is allowed between [`AUDIBLE_MILLIHERTZ`] and the highest frequency, in parts per million.
const WORST_FREQUENCY_PPM: f64 = 20.0;
/// From where on it is allowed no more, in 1/1000 Hz.
const AUDIBLE_MILLIHERTZ: u32 = 20_000;
/// The phase error that is allowed, in ticks of the timer.
const WORST_PHASE_TICKS: f64 = 1.0;

/// Options of `cargo xtask waveforms`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Random drives to check
    #[arg(long, default_value_t = Self::default().drives)]
    drives: u64,
    /// Random changes of drives on running timers to check
    #[arg(long, default_value_t = Self::default().changes)]
    changes: u64,
    /// Random sequences of windows to check
    #[arg(long, default_value_t = Self::default().bursts)]
    bursts: u64,
    /// Seed of the random numbers
    #[arg(long, default_value_t = Self::default().seed)]
    seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self { drives: 10_000_000, changes: 200_000, bursts: 100_000, seed: 1 }
    }
}

/// Checks and prints.
///
/// # Errors
/// [`Error::Waveforms`] if anything is not as it must be.
pub fn check_waveforms(options: &Options) -> Result<(), Error> {
    let limits = ChannelLimits::BOARD;
    let threads = thread::available_parallelism().map_or(1, usize::from).min(8);
    let share = |total: u64, index: usize| {
        let (threads, index) = (threads as u64, index as u64);
        total * (index + 1) / threads - total * index / threads
    };
    let mut drives = drives::check_boundary_drives(&limits);
    let boundaries = drives.accepted + drives.refused;
    let mut changes = changes::ChangeTally::default();
    let mut bursts = bursts::BurstTally::default();
    thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|index| {
                // Seeds far apart, so that no thread repeats another's numbers.
                let seed = options.seed.wrapping_add((index as u64) << 32);
                let (some_drives, some_changes) = (share(options.drives, index), share(options.changes, index));
                let some_bursts = share(options.bursts, index);
                scope.spawn(move || {
                    (
                        drives::check_random_drives(&limits, some_drives, seed),
                        changes::check_random_drive_changes_on_running_timers(&limits, some_changes, seed),
                        bursts::check_random_window_sequences(&limits, some_bursts, seed),
                    )
                })
            })
            .collect();
        for worker in workers {
            let (some_drives, some_changes, some_bursts) = worker.join().map_err(|_| Error::Waveforms)?;
            drives.merge(&some_drives);
            changes.merge(&some_changes);
            bursts.merge(&some_bursts);
        }
        Ok(())
    })?;

    let guard_us = f64::from(limits.min_guard_ns) / 1e3;
    let clocks_per_us = f64::from(limits.timer_clock_hz) / 1e6;
    println!("single drives, from their registers");
    println!("  random drives              {} (seed {})", options.drives, options.seed);
    println!("  drives at boundaries       {boundaries}");
    println!("  accepted / refused         {} / {}", drives.accepted, drives.refused);
    println!("  overlaps                   {}", drives.overlaps);
    println!(
        "  guards under the limit     {} (limit {guard_us} us, least {:.3} us)",
        drives.short_guards, drives.least_guard_us
    );
    println!("  half guards at a boundary under half the limit  {}", drives.short_half_guards);
    println!("  registers not as achieved  {}", drives.misreported);
    println!(
        "  worst frequency error      {:.2} ppm (20 Hz to 1 kHz; {:.2} ppm below)",
        drives.worst_ppm, drives.worst_ppm_below
    );
    println!("  worst phase error          {:.3} ticks", drives.worst_phase_ticks);
    println!("changes on running timers, from the pulses at the pins");
    println!("  drives set                 {} in {} steps, pulses {}", changes.drives, changes.steps, changes.pulses);
    println!("  overlaps                   {}", changes.overlaps);
    println!("  guards under the limit     {} (least {:.3} us)", changes.short_guards, changes.least_guard_us);
    println!("  pulses cut short           {}", changes.runts);
    println!("  boundaries not as computed {}", changes.misses);
    println!(
        "  worst phase error          {:.3} ticks between channels at one frequency ({} pairs)",
        changes.worst_phase_ticks, changes.pairs
    );
    println!("sequences of windows, from the pulses at the pins");
    println!("  sequences                  {}, windows {}", bursts.sequences, bursts.windows);
    println!("  overlaps                   {}", bursts.overlaps);
    let least_guard_us = bursts.least_guard.map_or(f64::INFINITY, |clocks| clocks as f64 / clocks_per_us);
    println!("  guards under the limit     {} (least {least_guard_us:.3} us)", bursts.short_guards);
    println!("  edges not at their clock   {}", bursts.misplaced);
    println!("  windows missed             {}", bursts.missed);

    let good = drives.overlaps + drives.short_guards + drives.short_half_guards + drives.misreported == 0
        && changes.overlaps + changes.short_guards + changes.runts + changes.misses == 0
        && bursts.is_good()
        && drives.worst_ppm <= WORST_FREQUENCY_PPM
        && drives.worst_phase_ticks <= WORST_PHASE_TICKS
        && changes.worst_phase_ticks <= WORST_PHASE_TICKS
        && drives.accepted > 0
        && (changes.pairs > 0 || options.changes == 0);
    if good { Ok(()) } else { Err(Error::Waveforms) }
}
