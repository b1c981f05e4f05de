//! `cargo xtask waveforms`: the waveform arithmetic over its whole parameter space, seen from the electrodes' pins.

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
    /// Seed of the random numbers
    #[arg(long, default_value_t = Self::default().seed)]
    seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self { drives: 10_000_000, changes: 200_000, seed: 1 }
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
    let mut drives = drives::at_boundaries(&limits);
    let boundaries = drives.accepted + drives.refused;
    let mut changes = changes::Tally::default();
    thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|index| {
                // Seeds far apart, so that no thread repeats another's numbers.
                let seed = options.seed.wrapping_add((index as u64) << 32);
                let (some_drives, some_changes) = (share(options.drives, index), share(options.changes, index));
                scope.spawn(move || {
                    (drives::at_random(&limits, some_drives, seed), changes::at_random(&limits, some_changes, seed))
                })
            })
            .collect();
        for worker in workers {
            let (some_drives, some_changes) = worker.join().map_err(|_| Error::Waveforms)?;
            drives.add(&some_drives);
            changes.add(&some_changes);
        }
        Ok(())
    })?;

    let guard_us = f64::from(limits.min_guard_ns) / 1e3;
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

    let good = drives.overlaps + drives.short_guards + drives.short_half_guards + drives.misreported == 0
        && changes.overlaps + changes.short_guards + changes.runts + changes.misses == 0
        && drives.worst_ppm <= WORST_FREQUENCY_PPM
        && drives.worst_phase_ticks <= WORST_PHASE_TICKS
        && changes.worst_phase_ticks <= WORST_PHASE_TICKS
        && drives.accepted > 0
        && (changes.pairs > 0 || options.changes == 0);
    if good { Ok(()) } else { Err(Error::Waveforms) }
}
