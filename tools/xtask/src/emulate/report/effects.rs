//! Envelopes that the board plays by itself.

use super::board::{CLOCKS_PER_MS, EmulatedBoard};
use super::drives::{make_drive, merge_adjacent_pulses_of_same_electrode};
use super::edges::electrode_letter;
use super::expected::compute_expected_timer_program;
use super::table::ReportTable;
use crate::error::Error;
use era_shared::protocol::{ChannelDrive, Reply, Request};
use era_shared::waveform::{Effect, Segment};
use std::f64::consts::PI;

/// What is played on: 200 Hz, so that a cycle takes 5 ms.
const CLICK: ChannelDrive = make_drive(0, 200_000, 800_000, 0, 600_000);
const RAMP: ChannelDrive = make_drive(1, 400_000, 600_000, 0, 500_000);
/// How far ahead the effects are set, in us of the board's time.
const LEAD_US: u64 = 30_000;
/// What the board's clock and the electrodes' timers may differ by, in ms: a few ticks of a microsecond.
const CLOCKS_APART_MS: f64 = 0.01;
const RAMP_MS: u16 = 100;
/// How far the force's fundamental may be from the level commanded, as a part of full force: a thousandth is the level's own
/// step, a tick of the width at 400 Hz is another ten-thousandth.
const LEVEL_TOLERANCE: f64 = 0.002;

/// A click with its brake on one channel, a ramp on another.
///
/// # Errors
/// If the board does not answer.
pub fn add_rows_of_click_and_ramp_envelopes(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let prepared = board.send_request(&Request::Prepare { drives: [CLICK, RAMP].into_iter().collect() })?;
    let is_prepared = matches!(prepared, Reply::Prepared { .. });
    table.add_row("prepare", "Prepared", &format!("{prepared:?}").chars().take(8).collect::<String>(), is_prepared);
    board.advance_time_with_keep_alives(0.15)?;
    board.update_pin_edges_until_now()?;
    board.edges.forget_pulses_and_their_statistics();
    board.advance_time_with_keep_alives(0.05)?;
    board.update_pin_edges_until_now()?;
    table.add_comparison_row(
        "prepared: pulses before the start",
        "0",
        &board.edges.overlap_and_least_guard_clocks_and_pulse_count().2.to_string(),
    );

    // The board looks at its clock at some time between these two; its answer is read up to one tick of its task later.
    let before = board.read_clock_cycles()?;
    let Reply::Clock { now_us } = board.send_request(&Request::Clock)? else {
        return Err(Error::NoReply("no reply to Clock".to_owned()));
    };
    let start = [before, board.read_clock_cycles()?].map(|clock| clock + LEAD_US * 170);
    let ramp = Segment::Ramp { from: 0, to: 1000, milliseconds: RAMP_MS };
    let swell = Effect { segments: [ramp].into_iter().collect(), times: 1 };
    for (channel, effect) in [(0, Effect::new_click(4, 2)), (1, swell)] {
        let reply = board.send_request(&Request::Play { channel, start_us: now_us + LEAD_US, effect })?;
        table.add_comparison_row(&format!("play on channel {channel}"), "Playing", &format!("{reply:?}"));
    }
    board.advance_time_with_keep_alives(0.25)?;
    board.update_pin_edges_until_now()?;
    let (overlap, guard, _) = board.edges.overlap_and_least_guard_clocks_and_pulse_count();
    let guard_us = guard.map_or(f64::NAN, |clocks| clocks as f64 / 170.0);
    let seen = format!("overlap {overlap}, guard {guard_us:.1} us");
    table.add_row("effects: pins", "overlap 0, guard >= 200 us", &seen, overlap == 0 && guard_us >= 200.0);
    add_rows_of_click_electrode_order_and_start_time(board, table, start)?;
    add_row_of_ramp_force_levels(board, table)
}

/// Four cycles, two reversed ones, then nothing; from the first boundary after the start.
fn add_rows_of_click_electrode_order_and_start_time(
    board: &EmulatedBoard,
    table: &mut ReportTable,
    earliest_and_latest_start_clock: [u64; 2],
) -> Result<(), Error> {
    let [track, ..] = &board.edges.tracks;
    let pulses = merge_adjacent_pulses_of_same_electrode(&track.pulses);
    let order: String = pulses.iter().map(|pulse| electrode_letter(pulse.electrode)).collect();
    table.add_comparison_row("click: electrodes in order", "ABABABABBABA", &order);
    let program = compute_expected_timer_program(&CLICK)?;
    let period_ms = program.period_clocks() as f64 / CLOCKS_PER_MS;
    let [earliest, latest] = earliest_and_latest_start_clock;
    let unsure_ms = (latest - earliest) as f64 / CLOCKS_PER_MS;
    let late = pulses.first().map(|first| {
        let boundary = first.from - u64::from(program.full_level_period().a.on) * u64::from(program.divider);
        (boundary as f64 - earliest as f64) / CLOCKS_PER_MS
    });
    let expected = format!("0 to {:.1} ms after it, which is known to {unsure_ms:.1} ms", period_ms);
    let seen = late.map_or("never".to_owned(), |late| format!("{late:.2} ms after its earliest"));
    let possible = -CLOCKS_APART_MS..=period_ms + unsure_ms + CLOCKS_APART_MS;
    let right = late.is_some_and(|late| possible.contains(&late));
    table.add_row("click: boundary against the start set", &expected, &seen, right);
    Ok(())
}

/// The fundamental of the force goes with sin(pi w / 2), w the part of a half period that a window takes.
fn add_row_of_ramp_force_levels(board: &EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let [_, track, ..] = &board.edges.tracks;
    let program = compute_expected_timer_program(&RAMP)?;
    let clocks = program.period_clocks();
    let force = |width: u64| (PI * width as f64 / clocks as f64).sin();
    let full = force(u64::from(program.width) * u64::from(program.divider));
    let Some((origin, _, _)) = track.origin_and_clocks_per_tick_and_per_period_if_any_change_seen() else {
        return Err(Error::NoReply("no pulses of the ramp".to_owned()));
    };
    let pulses = merge_adjacent_pulses_of_same_electrode(&track.pulses);
    let Some(first) = pulses.first() else { return Err(Error::NoReply("no pulses of the ramp".to_owned())) };
    // Period of a pulse, counted from that of the first one, which begins at the ramp's start or one period later.
    let period = |at: u64| ((at + clocks - origin % clocks) / clocks) as f64;
    let cycles = f64::from(RAMP_MS) * CLOCKS_PER_MS / clocks as f64;
    let mut worst: f64 = 0.0;
    for pulse in &pulses {
        let wanted = (period(pulse.from) - period(first.from) + 0.5) / cycles;
        worst = worst.max((force(pulse.to - pulse.from) / full - wanted).abs());
    }
    let seen = format!("{} pulses, worst {:.4} of full force", pulses.len(), worst);
    let expected = format!("{} pulses, each within {LEVEL_TOLERANCE} of its level", (2.0 * cycles).round());
    let right = pulses.len() == (2.0 * cycles).round() as usize && worst <= LEVEL_TOLERANCE;
    table.add_row("ramp: fundamental of the force", &expected, &seen, right);
    Ok(())
}
