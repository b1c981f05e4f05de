//! Plans that follow each other on the simulated device, plainly or as the daemon orders them.

use super::VerifyError;
use super::bench::Bench;
use crate::device::convert::drive_to_wire;
use crate::device::sim::{Clock, SimBoard, SimPanel};
use crate::planner::drive::on_channels;
use crate::planner::plan_motion::PlanMotion;
use crate::planner::residual::{Board, Ending, NEXT_LOOK_S, ResidualVibration, Room, fitted, grown};
use crate::planner::{Plan, PlanTable};
use era_shared::MAX_CHANNELS;
use era_shared::limits::BURST_MAX_MS;
use era_shared::protocol::Request;

/// How plans are set one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Each when it comes.
    Plainly,
    /// With as much force as [`ResidualVibration`] has room for, as the daemon does.
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
    /// Most travel of every mass while anything may be driven, the wait before it included, as a part of its gap.
    pub travel: Vec<f64>,
    /// The same with nothing driven, until the next begins: motions that cancelled under the drives may go further alone.
    pub travel_after: Vec<f64>,
    /// What room there was.
    pub room: Room,
    /// Parts of the forces with which it began, and to which it grew.
    pub parts: Vec<f64>,
}

/// Runs turns on the simulated device, faster than real time. One that would have to wait for another that has hardly begun is
/// left out.
///
/// # Errors
/// [`VerifyError::Device`], [`VerifyError::Unknown`].
pub fn follow_turns(
    table: &PlanTable,
    panel: &SimPanel,
    turns: &[Turn<'_>],
    order: Order,
) -> Result<Vec<Turned>, VerifyError> {
    let volts: Vec<f64> = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
    let mut bench = Bench::new(SimBoard::new(panel.clone(), &volts, Clock::Manual(0)));
    let mut residual = ResidualVibration::new(table.decaying_modes());
    let mut board = Board::Down;
    let mut turned = Vec::with_capacity(turns.len());
    for (id, Turn { plan, hold_s, pause_s }) in (0..).zip(turns) {
        let whole_motion = table.predict_motion(plan).ok_or(VerifyError::Unknown)?;
        let of_part = |part: f64| {
            let plan = if part < 1.0 { crate::planner::plan::derate_plan(table, plan, part)? } else { (*plan).clone() };
            let motion = table.predict_motion(&plan).ok_or(VerifyError::Unknown)?;
            Ok::<_, VerifyError>((plan, motion))
        };
        let room = match order {
            Order::Plainly => Room::ALL,
            Order::AsItFits => residual.room(&whole_motion, Some(&plan.drives), bench.time_s(), board),
        };
        if room.goes_on {
            // The next one comes before, and takes its place.
            bench.run_for(hold_s + pause_s)?;
            let travel = take_travel_fractions(&mut bench, table);
            turned.push(Turned { travel, travel_after: Vec::new(), room, parts: Vec::new() });
            continue;
        }
        if room.after_s > 0.0 {
            bench.ask(&Request::SetDrives { drives: heapless::Vec::new() })?;
            residual.end(bench.time_s(), Ending::AtItsBoundary);
            bench.run_for(room.after_s)?;
            board = if board == Board::Down { Board::Down } else { Board::Up };
        }
        if board == Board::Down {
            bench.ask(&Request::ArmWith { deadman_ms: None, burst_ms: Some(BURST_MAX_MS) })?;
        }
        let (mut parts, mut left_s) = (Vec::new(), *hold_s);
        let end_s = if *pause_s > 0.0 { bench.time_s() + hold_s } else { f64::INFINITY };
        while left_s > 0.0 {
            let now_s = bench.time_s();
            let fits = |(plan, motion): &(Plan, PlanMotion)| residual.part(motion, Some(&plan.drives), now_s, board);
            let next = match (parts.last(), order) {
                (None, Order::Plainly) => Some((1.0, of_part(1.0)?)),
                (None, Order::AsItFits) => Some(fitted(of_part(1.0)?, of_part, fits)?),
                (Some(part), _) if *part < 1.0 => grown(*part, of_part, fits)?,
                (Some(_), _) => None,
            };
            if let Some((part, (next, motion))) = next {
                bench.ask(&Request::SetDrives {
                    drives: on_channels(&next.drives).iter().map(drive_to_wire).collect(),
                })?;
                residual.begin(id, &motion, Some(&next.drives), board, now_s, end_s);
                parts.push(part);
                board = Board::Driving;
            }
            let is_whole = parts.last().is_some_and(|part| *part >= 1.0);
            let step_s = if is_whole { left_s } else { left_s.min(NEXT_LOOK_S) };
            bench.run_for(step_s)?;
            left_s -= step_s;
        }
        let driven_to = take_travel_fractions(&mut bench, table);
        if *pause_s > 0.0 {
            bench.ask(&Request::SetDrives { drives: heapless::Vec::new() })?;
            bench.run_for(*pause_s)?;
            board = Board::Up;
        }
        let travel_after = take_travel_fractions(&mut bench, table);
        turned.push(Turned { travel: driven_to, travel_after, room, parts });
    }
    Ok(turned)
}

/// Most travel of every mass since it was last asked, as a part of its gap.
fn take_travel_fractions(bench: &mut Bench, table: &PlanTable) -> Vec<f64> {
    bench.board.advance_panel_to_now();
    let extremes: [_; MAX_CHANNELS] = bench.board.panel_mut().take_travel_extremes();
    extremes.iter().zip(&table.electrodes).map(|(extreme, electrodes)| extreme.travel_m / electrodes.gap_m).collect()
}
