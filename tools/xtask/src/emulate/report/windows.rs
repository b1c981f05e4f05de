//! Windows that the host gives one by one.

use super::board::{CLOCKS_PER_MS, EmulatedBoard};
use super::drives::merge_adjacent_pulses_of_same_electrode;
use super::edges::electrode_letter;
use super::table::ReportTable;
use crate::error::Error;
use era_shared::protocol::{Reply, Request, WindowSequence};
use era_shared::waveform::{Electrode, SequenceWindow};

/// Clocks in a tick of a sequence, 0.1 us, as protocol.md says.
const TICK_CLOCKS: u64 = 17;
/// What the board's clock and the electrodes' timers may differ by, in clocks: a few microseconds.
const CLOCKS_APART: u64 = 10 * 170;

/// Windows on all four channels: channel, electrode, ticks since its last window, ticks of width.
const WINDOWS: [(u8, Electrode, u32, u32); 12] = [
    (0, Electrode::A, 2_000, 12_345),
    (0, Electrode::B, 2_000, 23_456),
    (0, Electrode::A, 90_001, 3_000),
    (1, Electrode::B, 7_001, 50_001),
    (1, Electrode::B, 6_999, 3_001),
    (1, Electrode::A, 7_000, 10_000),
    (2, Electrode::A, 150_000, 30_000),
    (2, Electrode::B, 2_001, 30_001),
    (2, Electrode::A, 2_003, 30_003),
    (3, Electrode::A, 11_000, 56_034),
    (3, Electrode::B, 2_000, 3_000),
    (3, Electrode::A, 2_000, 3_000),
];

/// Plays a sequence and compares every pulse at the pins with it, to the clock.
///
/// # Errors
/// If the board does not answer.
pub fn add_rows_of_window_sequence_at_pins(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let windows = WINDOWS.map(|(channel, electrode, wait_ticks, width_ticks)| SequenceWindow {
        channel,
        electrode,
        wait_ticks,
        width_ticks,
    });
    let rail_millivolts = [400_000, 700_000];
    let sequence = WindowSequence { number: 1, start_us: 0, rail_millivolts, windows: windows.into_iter().collect() };
    board.update_pin_edges_until_now()?;
    board.edges.forget_pulses_and_their_statistics();
    let (before, Reply::Clock { now_us }) = (board.read_clock_cycles()?, board.send_request(&Request::Clock)?) else {
        return Err(Error::NoReply("no reply to Clock".to_owned()));
    };
    let after = board.read_clock_cycles()?;
    let reply = board.send_request(&Request::PlayWindows(sequence.clone()))?;
    let Reply::WindowsPlaying { start_us } = reply else {
        table.add_row("windows: accepted", "WindowsPlaying", &format!("{reply:?}"), false);
        return Ok(());
    };
    let again = board.send_request(&Request::PlayWindows(sequence))?;
    let told = Reply::WindowsPlaying { start_us };
    table.add_comparison_row("windows: the same again", &format!("{told:?}"), &format!("{again:?}"));
    board.advance_time_with_keep_alives(0.15)?;
    board.update_pin_edges_until_now()?;

    // The start that the board has told, in clocks since power-up; its clock was read between `before` and `after`.
    let ahead = (start_us - now_us) * 170;
    let (earliest, latest) = (before + ahead - CLOCKS_APART, after + ahead + CLOCKS_APART);
    let first = WINDOWS.map(|(_, _, wait, _)| u64::from(wait))[0] * TICK_CLOCKS;
    let pulses = |board: &EmulatedBoard, channel: usize| {
        merge_adjacent_pulses_of_same_electrode(&board.edges.tracks[channel].pulses)
    };
    let Some(start) = pulses(board, 0).first().map(|pulse| pulse.from - first) else {
        table.add_row("windows: played", "pulses", "none", false);
        return Ok(());
    };
    let unsure_ms = (latest - earliest) as f64 / CLOCKS_PER_MS;
    let late_ms = (start as f64 - earliest as f64) / CLOCKS_PER_MS;
    let expected = format!("0 to {unsure_ms:.2} ms after its earliest");
    let right = (earliest..=latest).contains(&start);
    table.add_row("windows: start as told", &expected, &format!("{late_ms:.2} ms"), right);
    for channel in 0..4 {
        let (mut at, mut wanted) = (start, String::new());
        for (_, electrode, wait, width) in WINDOWS.iter().filter(|(of, ..)| usize::from(*of) == channel) {
            let from = at + u64::from(*wait) * TICK_CLOCKS;
            at = from + u64::from(*width) * TICK_CLOCKS;
            wanted += &format!("{} {}-{} ", electrode_letter(*electrode), from - start, at - start);
        }
        let seen = |pulse: &era_shared::waveform::Pulse| {
            format!("{} {}-{} ", electrode_letter(pulse.electrode), pulse.from - start, pulse.to - start)
        };
        let seen: String = pulses(board, channel).iter().map(seen).collect();
        table.add_comparison_row(&format!("windows: channel {channel}, clocks"), &wanted, &seen);
    }
    Ok(())
}
