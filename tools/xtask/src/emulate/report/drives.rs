//! Drives: their registers, and what their pins do while they change.

use super::board::EmulatedBoard;
use super::channels::CHANNELS;
use super::expected::{
    compute_expected_registers, compute_expected_timer_program, compute_rail_dac_code, format_read_registers,
    format_registers,
};
use super::table::ReportTable;
use crate::error::Error;
use era_shared::limits::GUARD_NANOSECONDS;
use era_shared::protocol::{ChannelDrive, Reply};
use era_shared::waveform::Pulse;

/// Two channels in step, two on their own, from slow to fast; two voltages, one for each rail.
pub const FIRST: [ChannelDrive; 4] = [
    make_drive(0, 200_000, 800_000, 0, 600_000),
    make_drive(1, 200_000, 600_000, 250_000, 500_000),
    make_drive(2, 61_500, 900_000, 0, 600_000),
    make_drive(3, 1_000_000, 500_000, 100_000, 500_000),
];

/// How long a change may take to reach the registers of all channels, in s: a soft start to 600 V takes 30 ms, a gap before
/// a common phase three periods of the slowest.
const SETTLED_S: f64 = 0.25;

/// How many changes [`add_rows_of_rapid_drive_changes`] makes.
const CHANGES: usize = 40;

/// One drive.
pub const fn make_drive(
    channel: u8,
    frequency_millihertz: u32,
    pulse_width_ppm: u32,
    phase_microturns: u32,
    voltage_millivolts: u32,
) -> ChannelDrive {
    ChannelDrive { channel, frequency_millihertz, pulse_width_ppm, phase_microturns, voltage_millivolts }
}

/// Sets drives and checks that the board comes to them, and what its pins do on the way.
///
/// # Errors
/// If the board does not answer.
pub fn set_drives_and_add_rows_comparing_registers_and_pins(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    before: Option<&[ChannelDrive; 4]>,
    drives: &[ChannelDrive; 4],
) -> Result<(), Error> {
    board.update_pin_edges_until_now()?;
    board.edges.forget_pulses_and_their_statistics();
    let began = board.read_clock_cycles()?;
    let refused = board.set_drives(drives)?;
    table.add_comparison_row(&format!("{name}: accepted"), "None", &format!("{refused:?}"));
    board.advance_time_with_keep_alives(SETTLED_S)?;
    board.update_pin_edges_until_now()?;
    let ended = board.read_clock_cycles()?;
    add_rows_of_registers_rails_and_phases(board, table, name, drives)?;
    add_row_of_overlaps_guards_and_odd_pulse_widths(board, table, name, (began, ended), &[before, Some(drives)])
}

/// Registers, rails and phases with these drives.
///
/// # Errors
/// If the board does not answer.
pub fn add_rows_of_registers_rails_and_phases(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    drives: &[ChannelDrive; 4],
) -> Result<(), Error> {
    for ((channel, drive), seen) in CHANNELS.into_iter().zip(drives).zip(board.read_timer_registers()?) {
        let expected = format_registers(channel, &compute_expected_registers(channel, Some(drive))?, true);
        table.add_comparison_row(
            &format!("{name}: {}", channel.timer),
            &expected,
            &format_read_registers(channel, &seen),
        );
    }
    let [one, two, ..] = drives;
    let expected = format!(
        "DAC {}/{}",
        compute_rail_dac_code(one.voltage_millivolts),
        compute_rail_dac_code(two.voltage_millivolts)
    );
    let [seen_one, seen_two] = board.read_set_points_and_rail_voltages()?.rails;
    table.add_comparison_row(&format!("{name}: rails"), &expected, &format!("DAC {seen_one}/{seen_two}"));
    let (first, second) = (compute_expected_timer_program(one)?, compute_expected_timer_program(two)?);
    if first.period_clocks() == second.period_clocks()
        && let [track_one, track_two, ..] = &board.edges.tracks
        && let (Some((origin_one, divider, period)), Some((origin_two, _, other))) = (
            track_one.origin_and_clocks_per_tick_and_per_period_if_any_change_seen(),
            track_two.origin_and_clocks_per_tick_and_per_period_if_any_change_seen(),
        )
    {
        table.add_comparison_row(&format!("{name}: clocks in a period"), &period.to_string(), &other.to_string());
        // Counter 1 minus counter 2 at any moment, in clocks; it should be the difference of their places at the origin.
        let seen = (origin_two + period - origin_one % period) % period;
        let wanted = (first.origin_clocks + period - second.origin_clocks % period) % period;
        let apart = seen.abs_diff(wanted);
        let error = apart.min(period - apart.min(period));
        let ticks = error as f64 / divider as f64;
        table.add_row(
            &format!("{name}: phase of 1 and 2"),
            "within 1 tick",
            &format!("{ticks:.2} ticks off"),
            ticks <= 1.0,
        );
    }
    Ok(())
}

/// Changes of everything but the voltages, faster than the slower channels can follow: what has not been taken over when the
/// next one comes must leave no trace.
///
/// # Errors
/// If the board does not answer.
pub fn add_rows_of_rapid_drive_changes(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    before: &[ChannelDrive; 4],
) -> Result<(), Error> {
    board.update_pin_edges_until_now()?;
    board.edges.forget_pulses_and_their_statistics();
    let began = board.read_clock_cycles()?;
    // Knuth's generator (MMIX): the same changes every time.
    let mut state = 1_u64;
    let mut random = |least: u32, most: u32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        least + u32::try_from((state >> 33) % u64::from(most - least + 1)).unwrap_or(0)
    };
    let mut sets = vec![*before];
    for _ in 0..CHANGES {
        let mut drives = FIRST;
        let common = random(20_000, 400_000);
        for drive in &mut drives {
            // Two channels in step in every second set on average, so that phases are moved too.
            drive.frequency_millihertz = if random(0, 1) == 0 { common } else { random(20_000, 400_000) };
            drive.pulse_width_ppm = random(50_000, 800_000);
            drive.phase_microturns = random(0, 999_999);
        }
        if let Some(refusal) = board.set_drives(&drives)? {
            return Err(Error::NoReply(format!("{drives:?} was refused: {refusal:?}")));
        }
        board.advance_time(f64::from(random(1, 40)) * 1e-3)?;
        sets.push(drives);
    }
    board.advance_time_with_keep_alives(SETTLED_S)?;
    board.update_pin_edges_until_now()?;
    let ended = board.read_clock_cycles()?;
    if let Some(last) = sets.last() {
        add_rows_of_registers_rails_and_phases(board, table, "many changes", last)?;
    }
    let sets: Vec<_> = sets.iter().map(Some).collect();
    add_row_of_overlaps_guards_and_odd_pulse_widths(board, table, "many changes", (began, ended), &sets)
}

/// Overlaps, guards and pulses that neither the drives before nor those after make.
fn add_row_of_overlaps_guards_and_odd_pulse_widths(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    (began, ended): (u64, u64),
    drives: &[Option<&[ChannelDrive; 4]>],
) -> Result<(), Error> {
    let (overlap, guard, count) = board.edges.overlap_and_least_guard_clocks_and_pulse_count();
    let mut odd = 0;
    for (index, track) in board.edges.tracks.iter().enumerate() {
        let mut widths = Vec::new();
        for drive in drives.iter().filter_map(|set| set.and_then(|set| set.get(index))) {
            let program = compute_expected_timer_program(drive)?;
            widths.push(u64::from(program.width) * u64::from(program.divider));
        }
        let whole = merge_adjacent_pulses_of_same_electrode(&track.pulses)
            .into_iter()
            .filter(|pulse| pulse.from > began && pulse.to < ended);
        odd += whole.filter(|pulse| !widths.contains(&(pulse.to - pulse.from))).count();
    }
    let least = u64::from(GUARD_NANOSECONDS) * 170 / 1000;
    let microseconds = guard.map_or(f64::NAN, |clocks| clocks as f64 / 170.0);
    table.add_row(
        &format!("{name}: pins"),
        &format!("overlap 0, guard >= {} us, runts 0", GUARD_NANOSECONDS / 1000),
        &format!("overlap {overlap}, guard {microseconds:.1} us, runts {odd} of {count} pulses"),
        overlap == 0 && guard.is_some_and(|guard| guard >= least) && odd == 0 && count > 0,
    );
    Ok(())
}

/// Pulses of which those that touch are one.
pub fn merge_adjacent_pulses_of_same_electrode(pulses: &[Pulse]) -> Vec<Pulse> {
    let mut whole: Vec<Pulse> = Vec::new();
    for pulse in pulses {
        match whole.last_mut() {
            Some(last) if last.electrode == pulse.electrode && last.to == pulse.from => last.to = pulse.to,
            _ => whole.push(*pulse),
        }
    }
    whole
}

/// A row for a reply.
pub fn add_reply_row(seen: Reply, expected: Reply, table: &mut ReportTable, name: &str) {
    table.add_comparison_row(name, &format!("{expected:?}"), &format!("{seen:?}"));
}
