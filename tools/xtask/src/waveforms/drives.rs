//! Single drives: what their registers make the pins do.

use super::AUDIBLE_MILLIHERTZ;
use era_shared::protocol::{ChannelDrive, ChannelLimits};
use era_shared::waveform::{ElectrodeWindows, OutputPair, TickWindow, TimerRegisters, compute_channel_program};
use fastrand::Rng;

/// Every pair of outputs that the board has.
const OUTPUTS: [OutputPair; 2] = [OutputPair { a: 1, b: 3 }, OutputPair { a: 1, b: 4 }];
/// Phases at and beside every quarter of a turn, in millionths of a turn.
const PHASES: [u32; 9] = [0, 1, 249_999, 250_000, 499_999, 500_000, 749_999, 750_000, 999_999];

/// What was found.
#[derive(Clone, Debug)]
pub struct DriveTally {
    pub accepted: u64,
    pub refused: u64,
    pub overlaps: u64,
    pub short_guards: u64,
    pub short_half_guards: u64,
    pub misreported: u64,
    pub least_guard_us: f64,
    pub worst_ppm: f64,
    pub worst_ppm_below: f64,
    pub worst_phase_ticks: f64,
}

impl DriveTally {
    const fn new() -> Self {
        Self {
            accepted: 0,
            refused: 0,
            overlaps: 0,
            short_guards: 0,
            short_half_guards: 0,
            misreported: 0,
            least_guard_us: f64::INFINITY,
            worst_ppm: 0.0,
            worst_ppm_below: 0.0,
            worst_phase_ticks: 0.0,
        }
    }

    /// Takes in what another has found.
    pub fn merge(&mut self, other: &Self) {
        self.accepted += other.accepted;
        self.refused += other.refused;
        self.overlaps += other.overlaps;
        self.short_guards += other.short_guards;
        self.short_half_guards += other.short_half_guards;
        self.misreported += other.misreported;
        self.least_guard_us = self.least_guard_us.min(other.least_guard_us);
        self.worst_ppm = self.worst_ppm.max(other.worst_ppm);
        self.worst_ppm_below = self.worst_ppm_below.max(other.worst_ppm_below);
        self.worst_phase_ticks = self.worst_phase_ticks.max(other.worst_phase_ticks);
    }

    fn check_drive(&mut self, limits: &ChannelLimits, drive: &ChannelDrive, outputs: OutputPair) {
        let Ok(planned) = compute_channel_program(limits, drive) else {
            self.refused += 1;
            return;
        };
        self.accepted += 1;
        let registers = TimerRegisters::for_running_timer(&planned.full_level_period(), outputs);
        let Ok(windows) = ElectrodeWindows::from_registers(&registers) else {
            self.misreported += 1;
            return;
        };
        let tick_s = windows.tick_length_s(limits.timer_clock_hz);
        // In clocks, so that what is exactly long enough is.
        let clocks = |ticks: u32| u64::from(ticks) * u64::from(windows.divider) * 1_000_000_000;
        let limit = u64::from(limits.min_guard_ns) * u64::from(limits.timer_clock_hz);
        self.overlaps += u64::from(windows.overlap_ticks() > 0);
        let guard = windows.shortest_guard_ticks_if_both_have_windows().unwrap_or(0);
        let guard_s = f64::from(guard) * tick_s;
        self.short_guards += u64::from(clocks(guard) < limit);
        self.least_guard_us = self.least_guard_us.min(guard_s * 1e6);
        let end = |window: TickWindow| window.start + window.length;
        let first = windows.a.start.min(windows.b.start);
        let last = windows.period.saturating_sub(end(windows.a).max(end(windows.b)));
        self.short_half_guards += u64::from(2 * clocks(first.min(last)) < limit);

        let frequency_hz = 1.0 / (f64::from(windows.period) * tick_s);
        let ppm = (frequency_hz / (f64::from(drive.frequency_millihertz) / 1e3) - 1.0).abs() * 1e6;
        let worst = if drive.frequency_millihertz >= AUDIBLE_MILLIHERTZ {
            &mut self.worst_ppm
        } else {
            &mut self.worst_ppm_below
        };
        *worst = worst.max(ppm);
        let told_hz = planned.achieved.frequency_nanohertz as f64 / 1e9;
        let told_guard_s = f64::from(planned.achieved.guard_ns) * 1e-9;
        let as_told = (told_hz / frequency_hz - 1.0).abs() < 1e-9 && (told_guard_s - guard_s).abs() < 2e-9;
        self.misreported += u64::from(!as_told || windows.a.length != windows.b.length);

        // From the origin to the middle of A's window, the other way round, is the phase.
        let centre = f64::from(windows.a.start) + f64::from(windows.a.length) / 2.0;
        let origin = planned.origin_clocks as f64 / f64::from(windows.divider);
        let period = f64::from(windows.period);
        let asked = f64::from(drive.phase_microturns) / 1e6;
        let turns = ((origin - centre) / period - asked + 0.5).rem_euclid(1.0) - 0.5;
        self.worst_phase_ticks = self.worst_phase_ticks.max(turns.abs() * period);
    }
}

/// Drives anywhere in the space that a channel accepts, and a little beyond.
pub fn check_random_drives(limits: &ChannelLimits, count: u64, seed: u64) -> DriveTally {
    let mut random = Rng::with_seed(seed);
    let mut tally = DriveTally::new();
    for _ in 0..count {
        // Half of them evenly over the frequencies, half evenly over the octaves.
        let frequency_millihertz = if random.bool() {
            random.u32(limits.min_frequency_millihertz..=limits.max_frequency_millihertz)
        } else {
            (10_f64.powf(3.0 + 3.0 * random.f64())) as u32
        };
        let drive = ChannelDrive {
            channel: 0,
            frequency_millihertz,
            // The widest that the guard leaves is 0.6 at 1 kHz and more below; what is too wide must be refused.
            pulse_width_ppm: random.u32(0..=1_000_000),
            phase_microturns: random.u32(0..1_000_000),
            voltage_millivolts: random.u32(0..=limits.max_voltage_millivolts),
        };
        tally.check_drive(limits, &drive, OUTPUTS[usize::from(random.bool())]);
    }
    tally
}

/// Drives at every place where the arithmetic changes: the ends of the range, every change of the prescaler, the widest and the
/// narrowest pulse, every quarter of a turn.
pub fn check_boundary_drives(limits: &ChannelLimits) -> DriveTally {
    let mut tally = DriveTally::new();
    let ends = [1_000, 1_001, 19_999, 20_000, 20_001, 999_999, 1_000_000];
    // The least prescaler changes where a period has 65 535 ticks of it.
    let clock_millihertz = u64::from(limits.timer_clock_hz) * 1000;
    let changes = (1..=2_600_u64).flat_map(|divider| {
        let at = clock_millihertz / (65_535 * divider);
        (at.saturating_sub(2)..=at + 2).filter_map(|frequency| u32::try_from(frequency).ok())
    });
    for frequency_millihertz in changes.chain(ends) {
        let drive = |pulse_width_ppm, phase_microturns| ChannelDrive {
            channel: 0,
            frequency_millihertz,
            pulse_width_ppm,
            phase_microturns,
            voltage_millivolts: limits.max_voltage_millivolts,
        };
        for (index, phase_microturns) in PHASES.into_iter().enumerate() {
            for width in list_pulse_widths_at_and_beyond_both_limits_and_at_two_thirds_ppm(limits, frequency_millihertz)
            {
                tally.check_drive(limits, &drive(width, phase_microturns), OUTPUTS[index % OUTPUTS.len()]);
            }
        }
    }
    tally
}

/// The narrowest and the widest pulse that a frequency allows, what lies just beyond both, and the one without a third harmonic.
fn list_pulse_widths_at_and_beyond_both_limits_and_at_two_thirds_ppm(
    limits: &ChannelLimits,
    frequency_millihertz: u32,
) -> [u32; 5] {
    use era_shared::waveform::DriveError;
    let refused = |pulse_width_ppm| {
        let drive = ChannelDrive {
            channel: 0,
            frequency_millihertz,
            pulse_width_ppm,
            phase_microturns: 0,
            voltage_millivolts: 0,
        };
        compute_channel_program(limits, &drive).err()
    };
    let widest = match refused(1_000_000) {
        Some(DriveError::PulseTooWide { widest_ppm, .. }) => widest_ppm,
        _ => 1_000_000,
    };
    let narrowest = match refused(0) {
        Some(DriveError::PulseTooNarrow { narrowest_ppm, .. }) => narrowest_ppm,
        _ => 1,
    };
    [narrowest.saturating_sub(1), narrowest, 666_667, widest, widest + 1]
}
