//! Plans that follow each other on the simulated device, plainly or as the daemon orders them.

use era::device::convert::drive_to_wire_zeroing_too_narrow_pulses;
use era::device::sim::SimPanel;
use era::planner::drive::assign_channels_in_order_of_drives;
use era::planner::plan::derate_plan;
use era::planner::plan_motion::PlanMotion;
use era::planner::residual::{
    Ending, NEXT_LOOK_S, RailState, ResidualVibration, StartHeadroom, find_fraction_and_plan_within_headroom,
    find_larger_fraction_and_plan_within_headroom_if_any,
};
use era::planner::{Plan, PlanTable};
use era::verify::bench::Bench;
use era_shared::limits::BURST_MAX_MS;
use era_shared::protocol::Request;

/// How plans are set one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SuccessionMode {
    /// Each when it comes.
    AtFullForce,
    /// With as much force as [`ResidualVibration`] has room for, as the daemon does.
    FittedToHeadroom,
}

/// A plan, and how long it is driven, in s.
#[derive(Clone, Copy, Debug)]
pub struct PlannedTurn<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// In s.
    pub hold_s: f64,
    /// With nothing driven after it, in s; without a pause it goes on until the next begins.
    pub pause_s: f64,
}

/// What came of a turn.
#[derive(Clone, Debug, PartialEq)]
pub struct TurnResult {
    /// Most travel of every mass while anything may be driven, the wait before it included, as a part of its gap.
    pub travel: Vec<f64>,
    /// The same with nothing driven, until the next begins: motions that cancelled under the drives may go further alone.
    pub travel_after: Vec<f64>,
    /// What room there was.
    pub room: StartHeadroom,
    /// Parts of the forces with which it began, and to which it grew.
    pub parts: Vec<f64>,
}

/// The vibration that remains after the end of a plan cannot be computed: a drive excites an undamped mode at its resonance.
#[derive(Debug)]
pub struct UnknownFreeMotion;

/// Runs turns on the simulated device, faster than real time. One that would have to wait for another that has hardly begun is
/// left out.
pub fn simulate_turns(
    table: &PlanTable,
    panel: &SimPanel,
    turns: &[PlannedTurn<'_>],
    mode: SuccessionMode,
) -> Result<Vec<TurnResult>, UnknownFreeMotion> {
    let volts: Vec<f64> = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
    let mut bench = Bench::new(panel.clone(), &volts);
    let mut residual = ResidualVibration::new(table.decay_rate_and_travel_of_each_pole());
    let mut board = RailState::Down;
    let mut turned = Vec::with_capacity(turns.len());
    for (id, PlannedTurn { plan, hold_s, pause_s }) in (0..).zip(turns) {
        let predict =
            |plan: &Plan| table.predict_travel_and_free_motion_of_plan_if_poles_known(plan).ok_or(UnknownFreeMotion);
        let whole_motion = predict(plan)?;
        let of_part = |part: f64| {
            let plan = if part < 1.0 { derate_plan(table, plan, part).unwrap() } else { (*plan).clone() };
            predict(&plan).map(|motion| (plan, motion))
        };
        let room = match mode {
            SuccessionMode::AtFullForce => StartHeadroom::ALL,
            SuccessionMode::FittedToHeadroom => residual.find_wait_and_force_fraction_within_travel_limits(
                &whole_motion,
                Some(&plan.drives),
                bench.time_s(),
                board,
            ),
        };
        if room.goes_on {
            // The next one comes before, and takes its place.
            bench.run_for(hold_s + pause_s).unwrap();
            let travel = take_travel_fractions(&mut bench, table);
            turned.push(TurnResult { travel, travel_after: Vec::new(), room, parts: Vec::new() });
            continue;
        }
        if room.wait_s > 0.0 {
            bench.send_request(&Request::SetDrives { drives: heapless::Vec::new() }).unwrap();
            residual.record_end_of_current_drives(bench.time_s(), Ending::AtItsBoundary);
            bench.run_for(room.wait_s).unwrap();
            board = if board == RailState::Down { RailState::Down } else { RailState::Up };
        }
        if board == RailState::Down {
            bench.send_request(&Request::ArmWith { deadman_ms: None, burst_ms: Some(BURST_MAX_MS) }).unwrap();
        }
        let (mut parts, mut left_s) = (Vec::new(), *hold_s);
        let end_s = if *pause_s > 0.0 { bench.time_s() + hold_s } else { f64::INFINITY };
        while left_s > 0.0 {
            let now_s = bench.time_s();
            let fits = |(plan, motion): &(Plan, PlanMotion)| {
                residual.max_force_fraction_that_fits_without_wait(motion, Some(&plan.drives), now_s, board)
            };
            let next = match (parts.last(), mode) {
                (None, SuccessionMode::AtFullForce) => Some((1.0, of_part(1.0)?)),
                (None, SuccessionMode::FittedToHeadroom) => {
                    Some(find_fraction_and_plan_within_headroom(of_part(1.0)?, of_part, fits)?)
                }
                (Some(part), _) if *part < 1.0 => {
                    find_larger_fraction_and_plan_within_headroom_if_any(*part, of_part, fits)?
                }
                (Some(_), _) => None,
            };
            if let Some((part, (next, motion))) = next {
                let drives = assign_channels_in_order_of_drives(&next.drives)
                    .iter()
                    .map(drive_to_wire_zeroing_too_narrow_pulses)
                    .collect();
                bench.send_request(&Request::SetDrives { drives }).unwrap();
                residual.record_drives_that_begin_in_place_of_others(
                    id,
                    &motion,
                    Some(&next.drives),
                    board,
                    now_s,
                    end_s,
                );
                parts.push(part);
                board = RailState::Driving;
            }
            let is_whole = parts.last().is_some_and(|part| *part >= 1.0);
            let step_s = if is_whole { left_s } else { left_s.min(NEXT_LOOK_S) };
            bench.run_for(step_s).unwrap();
            left_s -= step_s;
        }
        let driven_to = take_travel_fractions(&mut bench, table);
        if *pause_s > 0.0 {
            bench.send_request(&Request::SetDrives { drives: heapless::Vec::new() }).unwrap();
            bench.run_for(*pause_s).unwrap();
            board = RailState::Up;
        }
        let travel_after = take_travel_fractions(&mut bench, table);
        turned.push(TurnResult { travel: driven_to, travel_after, room, parts });
    }
    Ok(turned)
}

/// Most travel of every mass since it was last asked, as a part of its gap.
fn take_travel_fractions(bench: &mut Bench, table: &PlanTable) -> Vec<f64> {
    bench
        .panel_mut()
        .take_largest_travels_since_last_call()
        .iter()
        .zip(&table.electrodes)
        .map(|(largest_travel, electrodes)| largest_travel.travel_m / electrodes.gap_m)
        .collect()
}
