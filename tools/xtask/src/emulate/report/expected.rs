//! What the registers should hold, in the words of the table.

use super::board::{EmulatedBoard, Pin, Registers};
use super::channels::{CHANNELS, Channel};
use crate::error::Error;
use era_shared::protocol::{ChannelDrive, ChannelLimits};
use era_shared::supply::rail_dac_code;
use era_shared::waveform::{ChannelProgram, IDLE, TimerPeriod, TimerRegisters, compute_channel_program};
use std::collections::BTreeMap;

/// CR1.CEN, BDTR.MOE.
const CEN: u32 = 1;
const MOE: u32 = 1 << 15;

/// What a board with everything off looks like.
pub const ALL_OFF: &str = "CEN 0000 MOE 000 electrodes low 8 HV 0 discharge 00 DAC 0/0";

/// The same of the board as it is.
///
/// # Errors
/// [`Error::Bridge`].
pub fn describe_timer_enables_output_pins_and_rail_dac_codes(board: &mut EmulatedBoard) -> Result<String, Error> {
    let timers = board.read_timer_registers()?;
    let bit =
        |registers: &Registers, name: &str, mask: u32| u8::from(find_register_or_zero(registers, name) & mask != 0);
    let counting: String = timers.iter().map(|timer| bit(timer, "cr1", CEN).to_string()).collect();
    let enabled: String = timers
        .iter()
        .zip(CHANNELS)
        .filter(|(_, channel)| channel.has_break)
        .map(|(timer, _)| bit(timer, "bdtr", MOE).to_string())
        .collect();
    let pins = board.read_pins()?;
    let low = pins.iter().filter(|(name, pin)| name.starts_with("era") && is_output_driven_low(pin)).count();
    let [one, two] = board.read_set_points_and_rail_voltages()?.rails;
    Ok(format!(
        "CEN {counting} MOE {enabled} electrodes low {low} {} DAC {one}/{two}",
        describe_high_voltage_enable_and_discharge_pins(&pins)
    ))
}

/// Supply and discharge as `HV 1 discharge 11`: high means that it is on, and that a switch is open.
pub fn describe_high_voltage_enable_and_discharge_pins(pins: &BTreeMap<String, Pin>) -> String {
    let high = |name: &str| u8::from(pins.get(name).is_some_and(|pin| pin.high == Some(true)));
    format!("HV {} discharge {}{}", high("high_voltage_enable"), high("discharge1"), high("discharge2"))
}

fn is_output_driven_low(pin: &Pin) -> bool {
    pin.mode == "output" && pin.high == Some(false)
}

/// What a drive comes to.
///
/// # Errors
/// [`Error::NoReply`] if the drive is none: a mistake in this report.
pub fn compute_expected_timer_program(drive: &ChannelDrive) -> Result<ChannelProgram, Error> {
    compute_channel_program(&ChannelLimits::BOARD, drive)
        .map_err(|error| Error::NoReply(format!("{drive:?}: {error:?}")))
}

/// A timer's registers with a drive at full level, or idle.
pub fn compute_expected_registers(channel: Channel, drive: Option<&ChannelDrive>) -> Result<TimerRegisters, Error> {
    let period: TimerPeriod = match drive {
        Some(drive) => compute_expected_timer_program(drive)?.full_level_period(),
        None => IDLE,
    };
    let registers = TimerRegisters::for_running_timer(&period, channel.outputs);
    Ok(if channel.has_break { registers } else { registers.with_output_clear_on_trip_enabled() })
}

/// The code of a rail's set-point.
pub fn compute_rail_dac_code(millivolts: u32) -> u16 {
    rail_dac_code(millivolts)
}

/// Registers in the words of the table, those that differ from drive to drive first.
pub fn format_registers(channel: Channel, registers: &TimerRegisters, main_output: bool) -> String {
    let [one, two, three, four] = registers.ccr;
    let enabled = if channel.has_break { u8::from(main_output).to_string() } else { "-".to_owned() };
    format!(
        "{} PSC {} ARR {} CCR {one}/{two}/{three}/{four} CCMR {:x}/{:x} CCER {:x} CEN {} MOE {enabled}",
        channel.timer,
        registers.psc,
        registers.arr,
        registers.ccmr1,
        registers.ccmr2,
        registers.ccer,
        registers.cr1 & CEN,
    )
}

/// The same of what was read back.
pub fn format_read_registers(channel: Channel, registers: &Registers) -> String {
    let ccr = ["ccr1", "ccr2", "ccr3", "ccr4"].map(|name| find_register_or_zero(registers, name));
    let read = TimerRegisters {
        cr1: find_register_or_zero(registers, "cr1"),
        ccmr1: find_register_or_zero(registers, "ccmr1"),
        ccmr2: find_register_or_zero(registers, "ccmr2"),
        ccer: find_register_or_zero(registers, "ccer"),
        psc: find_register_or_zero(registers, "psc"),
        arr: find_register_or_zero(registers, "arr"),
        ccr,
        bdtr: find_register_or_zero(registers, "bdtr"),
    };
    format_registers(channel, &read, read.is_main_output_enabled())
}

fn find_register_or_zero(registers: &Registers, name: &str) -> u32 {
    registers.get(name).copied().unwrap_or(0)
}
