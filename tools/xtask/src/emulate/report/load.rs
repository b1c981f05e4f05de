//! Share of the processor's time.

use super::board::EmulatedBoard;
use super::drives::make_drive;
use super::table::ReportTable;
use super::trips::power_up_and_drive;
use crate::budget::{Budget, BudgetRow};
use crate::error::Error;
use crate::repository_root;
use era_shared::protocol::{ChannelDrive, Reply, Request};
use era_shared::waveform::{Effect, Segment};

/// Four channels at the highest frequency.
const FASTEST: [ChannelDrive; 4] = [
    make_drive(0, 1_000_000, 500_000, 0, 500_000),
    make_drive(1, 1_000_000, 500_000, 0, 500_000),
    make_drive(2, 1_000_000, 500_000, 250_000, 500_000),
    make_drive(3, 1_000_000, 500_000, 250_000, 500_000),
];
/// Looked at in pieces of this, in s, with a keep-alive between them.
const PIECE_S: f64 = 0.05;
const PIECES: u32 = 3;

/// Steady drives, then the same with a ramp on all of them, whose windows change every period.
pub fn check_processor_load(board: &mut EmulatedBoard, table: &mut ReportTable) {
    table.run_part_adding_row_on_error("load", |table| {
        power_up_and_drive(board)?;
        board.set_drives(&FASTEST)?;
        board.advance_time_with_keep_alives(0.1)?;
        let steady = measure_busy_fraction(board)?;
        table.add_figure("processor, four channels at 1 kHz", format_percent(steady));
        board.send_request(&Request::Prepare { drives: FASTEST.into_iter().collect() })?;
        for channel in 0..4 {
            let ramp = Segment::Ramp { from: 0, to: 1000, milliseconds: 1_000 };
            let effect = Effect { segments: [ramp].into_iter().collect(), times: 1 };
            let reply = board.send_request(&Request::Play { channel, start_us: 0, effect })?;
            if reply != Reply::Playing {
                return Err(Error::NoReply(format!("the reply to Play is {reply:?}")));
            }
        }
        board.advance_time_with_keep_alives(0.1)?;
        let busy = measure_busy_fraction(board)?;
        table.add_figure("processor, the same while four envelopes play", format_percent(busy));
        let budget = Budget::read(&repository_root()?)?;
        let row = BudgetRow::of_processor_load(100.0 * busy.max(steady), &budget);
        table.add_row(
            "load: budget",
            &format!("within {} %", row.budget),
            &format_percent(busy.max(steady)),
            row.is_within_budget(),
        );
        Ok(())
    });
}

fn measure_busy_fraction(board: &mut EmulatedBoard) -> Result<f64, Error> {
    let (mut busy, mut total) = (0.0, 0.0);
    for _ in 0..PIECES {
        let (more_busy, more) = board.measure_busy_and_total_clocks(PIECE_S)?;
        busy += more_busy;
        total += more;
        board.send_request(&Request::KeepAlive)?;
    }
    Ok(busy / total)
}

fn format_percent(fraction: f64) -> String {
    format!("{:.1} %", 100.0 * fraction)
}
