//! Share of the processor's time.

use super::bench::Bench;
use super::drives::drive;
use super::table::Table;
use super::trips::bring_up;
use crate::budget::{Budget, Row};
use crate::error::Error;
use crate::repository_root;
use era_shared::protocol::{ChannelDrive, Reply, Request};
use era_shared::waveform::{Effect, Segment};

/// Four channels at the highest frequency.
const FASTEST: [ChannelDrive; 4] = [
    drive(0, 1_000_000, 500_000, 0, 500_000),
    drive(1, 1_000_000, 500_000, 0, 500_000),
    drive(2, 1_000_000, 500_000, 250_000, 500_000),
    drive(3, 1_000_000, 500_000, 250_000, 500_000),
];
/// Looked at in pieces of this, in s, with a keep-alive between them.
const PIECE_S: f64 = 0.05;
const PIECES: u32 = 3;

/// Steady drives, then the same with a ramp on all of them, whose windows change every period.
pub fn steps(bench: &mut Bench, table: &mut Table) {
    table.part("load", |table| {
        bring_up(bench)?;
        bench.drive(&FASTEST)?;
        bench.keep_alive(0.1)?;
        let steady = share(bench)?;
        table.figure("processor, four channels at 1 kHz", percent(steady));
        bench.request(&Request::Prepare { drives: FASTEST.into_iter().collect() })?;
        for channel in 0..4 {
            let ramp = Segment::Ramp { from: 0, to: 1000, milliseconds: 1_000 };
            let effect = Effect { segments: [ramp].into_iter().collect(), times: 1 };
            let reply = bench.request(&Request::Play { channel, start_us: 0, effect })?;
            if reply != Reply::Playing {
                return Err(Error::NoReply(format!("Play: {reply:?}")));
            }
        }
        bench.keep_alive(0.1)?;
        let busy = share(bench)?;
        table.figure("processor, the same while four envelopes play", percent(busy));
        let budget = Budget::read(&repository_root()?)?;
        let row = Row::cpu(100.0 * busy.max(steady), &budget);
        table.row("load: budget", &format!("within {} %", row.budget), &percent(busy.max(steady)), row.holds());
        Ok(())
    });
}

fn share(bench: &mut Bench) -> Result<f64, Error> {
    let (mut busy, mut total) = (0.0, 0.0);
    for _ in 0..PIECES {
        let (more_busy, more) = bench.load(PIECE_S)?;
        busy += more_busy;
        total += more;
        bench.request(&Request::KeepAlive)?;
    }
    Ok(busy / total)
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}
