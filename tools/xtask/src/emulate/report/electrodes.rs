//! The current that the electrodes take: what a sound board measures at several frequencies, and how soon it notices an electrode that
//! takes too little or too much while it is driven.
//!
//! Nothing of it is shared with the firmware: an electrode of 116 pF takes 2 C V f with its partner, a rail's bleeders are 50 Mohm, and a
//! short behind 1 Mohm takes V / R while its electrode is on.

use super::board::EmulatedBoard;
use super::drives::make_drive;
use super::table::ReportTable;
use super::trips::{
    add_row_of_fault_state_and_latched_fault_code, delay_until_all_off_if_off_by_now_ms,
    heal_faults_and_add_rows_of_rearming, make_electrode_fault_json,
};
use crate::error::Error;
use era_shared::protocol::{ChannelDrive, FaultCode, Reply, Request};
use era_shared::safety::SafetyState;

/// How long a sound board is driven at each frequency, in s: ten times the time over which the current is averaged.
const SOUND_S: f64 = 1.3;
/// When a fault must be noticed, in ms: 131 ms is the time constant of the means that are compared, so that 95 % of what has changed is in
/// them after three of them.
const NOTICED_MS: f64 = 400.0;
/// Over how many looks the measured current is averaged, and how far they are apart, in ms: of a drive at 40 Hz each is at another ms of its period,
/// as 7 and 25 have no common divisor, and together they are at all 25.
const LOOKS: u32 = 25;
const LOOK_EVERY_MS: f64 = 7.0;

/// One broken electrode while its ERA is driven alone.
struct BrokenWhileDriving {
    name: &'static str,
    era: u8,
    electrode: &'static str,
    is: &'static str,
    volts: u32,
    frequency_millihertz: u32,
}

const BROKEN: [BrokenWhileDriving; 8] = [
    new_broken_electrode("electrode opens", 1, "a", "open", 1_000, 200_000),
    new_broken_electrode("electrode opens, 400 Hz", 4, "b", "open", 600, 400_000),
    new_broken_electrode("electrode is shorted", 2, "b", "shorted", 500, 200_000),
    new_broken_electrode("electrode is shorted, 40 Hz", 4, "a", "shorted", 300, 40_000),
    new_broken_electrode("lower switch stays open", 3, "a", "lower_open", 1_000, 200_000),
    new_broken_electrode("lower switch stays open, 400 Hz", 2, "b", "lower_open", 600, 400_000),
    new_broken_electrode("lower switch stays closed", 1, "b", "lower_stuck", 500, 200_000),
    new_broken_electrode("lower switch stays closed, 40 Hz", 3, "a", "lower_stuck", 300, 40_000),
];

const fn new_broken_electrode(
    name: &'static str,
    era: u8,
    electrode: &'static str,
    defect: &'static str,
    volts: u32,
    frequency_millihertz: u32,
) -> BrokenWhileDriving {
    BrokenWhileDriving { name, era, electrode, is: defect, volts, frequency_millihertz }
}

/// All of it, each from power-up.
pub fn check_electrode_currents(board: &mut EmulatedBoard, table: &mut ReportTable) {
    for frequency_millihertz in [40_000, 200_000, 400_000] {
        let name = format!("sound electrodes, {} Hz", frequency_millihertz / 1_000);
        table.run_part_adding_row_on_error(&name, |table| {
            add_rows_of_total_current_and_no_fault_of_intact_electrodes(board, table, &name, frequency_millihertz)
        });
    }
    for volts in [1_850, 1_000, 500] {
        let name = format!("both rails lowered from 2000 V to {volts} V");
        table.run_part_adding_row_on_error(&name, |table| add_row_of_lowered_rails(board, table, &name, volts));
    }
    for broken in &BROKEN {
        table.run_part_adding_row_on_error(broken.name, |table| {
            add_rows_of_broken_electrode_while_driving(board, table, broken)
        });
    }
}

/// While the set-points fall, the supply feeds both rails against their closed discharge switches, beside four drives that take nearly all that the
/// supply may deliver. That is no over-current.
fn add_row_of_lowered_rails(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    volts: u32,
) -> Result<(), Error> {
    let drives = |volts: u32| [0, 1, 2, 3].map(|channel| make_drive(channel, 200_000, 600_000, 0, volts * 1_000));
    power_cycle_arm_and_set_drives(board, &drives(2_000))?;
    board.advance_time_with_keep_alives(0.2)?;
    let refused = board.set_drives(&drives(volts))?;
    board.advance_time_with_keep_alives(0.1)?;
    let rails = board.read_set_points_and_rail_voltages()?.rail_volts;
    let fault = board.read_latched_fault()?.map(|fault| (fault.code, fault.detail));
    let is_there = rails.into_iter().all(|rail| (rail - f64::from(volts)).abs() < 0.1 * f64::from(volts));
    let seen = format!("{refused:?}, rails at {:.0} V and {:.0} V, fault {fault:?}", rails[0], rails[1]);
    let expected = format!("no refusal, rails within 10 % of {volts} V, no fault");
    table.add_row(name, &expected, &seen, refused.is_none() && is_there && fault.is_none());
    Ok(())
}

fn power_cycle_arm_and_set_drives(board: &mut EmulatedBoard, drives: &[ChannelDrive]) -> Result<(), Error> {
    board.power_cycle_healing_faults()?;
    board.arm_and_wait()?;
    match board.set_drives(drives)? {
        Some(refusal) => Err(Error::NoReply(format!("the drives were refused: {refusal:?}"))),
        None => Ok(()),
    }
}

fn measure_mean_reported_current_advancing_time_microamps(board: &mut EmulatedBoard) -> Result<f64, Error> {
    let (mut sum, begin) = (0.0, board.read_clock_cycles()?);
    for look in 1..=LOOKS {
        // A question takes some time of the board, too.
        let ahead_ms = f64::from(look) * LOOK_EVERY_MS - board.milliseconds_since(begin)?;
        board.advance_time_with_keep_alives(ahead_ms / 1e3)?;
        match board.send_request(&Request::Details)? {
            Reply::Details(details) => sum += f64::from(details.average_microamps),
            other => return Err(Error::NoReply(format!("the reply to Details is {other:?}"))),
        }
    }
    Ok(sum / f64::from(LOOKS))
}

/// Four sound channels stay driven, and take what they should take.
fn add_rows_of_total_current_and_no_fault_of_intact_electrodes(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    frequency_millihertz: u32,
) -> Result<(), Error> {
    const VOLTS: u32 = 600;
    let drives = [0, 1, 2, 3].map(|channel| make_drive(channel, frequency_millihertz, 600_000, 0, VOLTS * 1_000));
    power_cycle_arm_and_set_drives(board, &drives)?;
    board.advance_time_with_keep_alives(SOUND_S)?;
    let (volts, hertz) = (f64::from(VOLTS), f64::from(frequency_millihertz) / 1e3);
    let expected = (4.0 * 2.0 * 116e-12 * volts * hertz + 2.0 * volts / 50e6) * 1e6;
    let seen = measure_mean_reported_current_advancing_time_microamps(board)?;
    // Single looks at a current that comes in lumps: a fifth of it.
    table.add_row(
        &format!("{name}: average current"),
        &format!("{expected:.0} uA"),
        &format!("{seen:.0} uA"),
        (seen - expected).abs() < 0.2 * expected + 1.0,
    );
    let state = board.read_status()?.state;
    table.add_comparison_row(&format!("{name}: no fault"), SafetyState::Running.name(), state.name());
    Ok(())
}

/// One ERA alone, of which an electrode breaks.
fn add_rows_of_broken_electrode_while_driving(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    broken: &BrokenWhileDriving,
) -> Result<(), Error> {
    let name = broken.name;
    power_cycle_arm_and_set_drives(
        board,
        &[make_drive(broken.era - 1, broken.frequency_millihertz, 800_000, 0, broken.volts * 1_000)],
    )?;
    board.advance_time_with_keep_alives(0.6)?;
    board.update_pin_edges_until_now()?;
    let since = board.read_clock_cycles()?;
    board.inject_fault(&make_electrode_fault_json(broken.era.into(), broken.electrode, broken.is))?;
    board.advance_time_with_keep_alives(NOTICED_MS / 1e3 + 0.01)?;
    let off = delay_until_all_off_if_off_by_now_ms(board, since)?;
    table.add_time_limit_row(&format!("{name}: electrodes off"), NOTICED_MS, off);
    add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::Electrode)?;
    heal_faults_and_add_rows_of_rearming(board, table, name)
}
