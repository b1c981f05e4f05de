//! Plans that follow each other on the simulated device, plainly or as the daemon orders them.

use super::VerifyError;
use super::bench::Bench;
use crate::daemon::wire_drives;
use crate::device::convert::to_wire;
use crate::device::sim::{Clock, Panel, SimBoard};
use crate::planner::moving::{Board, Ending, Moving, Verdict};
use crate::planner::{Plan, PlanTable};
use era_shared::MAX_CHANNELS;
use era_shared::limits::BURST_MAX_MS;
use era_shared::protocol::Request;

/// How plans are set one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Each when it comes.
    Plainly,
    /// As [`Moving`] says.
    AsItFits,
}

/// A plan, and how long it is driven, in s.
#[derive(Clone, Copy, Debug)]
pub struct Turn<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// In s.
    pub hold_s: f64,
    /// With nothing driven after it, in s; without a pause it goes on until the next begins.
    pub pause_s: f64,
}

/// What came of a turn.
#[derive(Clone, Debug, PartialEq)]
pub struct Turned {
    /// Most travel of every mass from its beginning to that of the next, as a part of its gap.
    pub travel: Vec<f64>,
    /// What it was told.
    pub verdict: Verdict,
}

/// Runs turns on the simulated device, faster than real time. One that does not fit within the longest wait is left out, and
/// so is one that would have to wait for another that has hardly begun.
///
/// # Errors
/// [`VerifyError::Device`], [`VerifyError::Unknown`].
pub fn follow(table: &PlanTable, panel: &Panel, turns: &[Turn<'_>], order: Order) -> Result<Vec<Turned>, VerifyError> {
    let volts: Vec<f64> = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
    let mut bench = Bench::new(SimBoard::new(panel.clone(), &volts, Clock::Manual(0)));
    let mut moving = Moving::new(table.rings());
    let mut board = Board::Down;
    let mut turned = Vec::with_capacity(turns.len());
    for (id, Turn { plan, hold_s, pause_s }) in (0..).zip(turns) {
        let swing = table.swing(plan).ok_or(VerifyError::Unknown)?;
        let verdict = match order {
            Order::Plainly => Verdict::AtOnce,
            Order::AsItFits => moving.fits(&swing, Some(&plan.drives), bench.time_s(), board),
        };
        if let Verdict::Later { .. } = verdict {
            // The next one comes before, and takes its place.
            bench.run_for(hold_s + pause_s)?;
            turned.push(Turned { travel: travel(&mut bench, table), verdict });
            continue;
        }
        if let Verdict::Softly { after_s } = verdict {
            bench.ask(&Request::SetDrives { drives: heapless::Vec::new() })?;
            moving.end(bench.time_s(), Ending::AtItsBoundary);
            bench.run_for(after_s)?;
            bench.ask(&Request::Disarm)?;
            board = Board::Down;
        }
        if !matches!(verdict, Verdict::TooFar { .. }) {
            if board == Board::Down {
                bench.ask(&Request::ArmWith { deadman_ms: None, burst_ms: Some(BURST_MAX_MS) })?;
            }
            bench.ask(&Request::SetDrives { drives: wire_drives(plan).iter().map(to_wire).collect() })?;
            let now_s = bench.time_s();
            let until_s = if *pause_s > 0.0 { now_s + hold_s } else { f64::INFINITY };
            moving.begin(id, &swing, Some(&plan.drives), board, now_s, until_s);
            bench.run_for(*hold_s)?;
            board = Board::Driving;
        }
        if *pause_s > 0.0 {
            bench.ask(&Request::SetDrives { drives: heapless::Vec::new() })?;
            bench.run_for(*pause_s)?;
            board = Board::Up;
        }
        turned.push(Turned { travel: travel(&mut bench, table), verdict });
    }
    Ok(turned)
}

/// Most travel of every mass since it was last asked, as a part of its gap.
fn travel(bench: &mut Bench, table: &PlanTable) -> Vec<f64> {
    bench.board.advance();
    let extremes: [_; MAX_CHANNELS] = bench.board.panel_mut().take_extremes();
    extremes.iter().zip(&table.electrodes).map(|(extreme, electrodes)| extreme.travel_m / electrodes.gap_m).collect()
}
