//! Registers that protect, as they read back after boot, against values written from the reference manual (RM0440) and the data sheet
//! (DS12288) alone. Nothing here is shared with the firmware or with `era_shared`: a bit that is wrong in both would be seen here.

use super::board::EmulatedBoard;
use super::table::ReportTable;
use crate::error::Error;
use era_shared::protocol::Request;
use era_shared::safety::SafetyState;
use serde_json::json;

/// A register, the bits that are looked at, and what they must be.
struct Setting {
    name: &'static str,
    address: u32,
    mask: u32,
    expected: u32,
}

const fn new_register_setting(name: &'static str, address: u32, mask: u32, expected: u32) -> Setting {
    Setting { name, address, mask, expected }
}

/// BDTR (28.6.20): LOCK level 3 (bits 9:8), OSSI (10), OSSR (11), BKE (12), BKP (13), no AOE (14), no MOE (15) at rest.
const BDTR_MASK: u32 = 0xFF00;
const BDTR: u32 = 0x3F00;
/// AF1 (28.6.29): BKCMP1E, 3, 4, 5, 7 in bits 1, 3, 4, 5, 7; BKINE in bit 0 off; no polarity (bits 10 to 13) inverted.
const AF1_MASK: u32 = 0x3EFF;
const AF1: u32 = 0x00BA;
/// COMP_CxCSR (24.6): EN (0), INMSEL (6:4), INPSEL (8), POL (15), HYST (18:16), BLANKSEL (21:19), SCALEN (23).
const COMP_MASK: u32 = 0x00BF_8171;
/// Enabled, against DAC3 (100), not inverted, 20 mV of hysteresis (010).
const COMP_DAC: u32 = 0x0002_0041;
/// Enabled, against DAC4 (100), inverted, 20 mV.
const COMP_LOOP: u32 = 0x0002_8041;

const SETTINGS: [Setting; 54] = [
    new_register_setting("TIM1 BDTR", 0x4001_2C44, BDTR_MASK, BDTR),
    new_register_setting("TIM8 BDTR", 0x4001_3444, BDTR_MASK, BDTR),
    new_register_setting("TIM20 BDTR", 0x4001_5044, BDTR_MASK, BDTR),
    new_register_setting("TIM1 AF1", 0x4001_2C60, AF1_MASK, AF1),
    new_register_setting("TIM8 AF1", 0x4001_3460, AF1_MASK, AF1),
    new_register_setting("TIM20 AF1", 0x4001_5060, AF1_MASK, AF1),
    // The permit: TIM16 (30.6) has BDTR and AF1 at the same places. OC1M (6:4): 101, forced active, as an output (CC1S = 00); CC1E (0), not CC1P (1).
    new_register_setting("TIM16 BDTR", 0x4001_4444, BDTR_MASK, BDTR),
    new_register_setting("TIM16 AF1", 0x4001_4460, AF1_MASK, AF1),
    new_register_setting("TIM16 CCMR1", 0x4001_4418, 0x0001_0073, 0x50),
    new_register_setting("TIM16 CCER", 0x4001_4420, 0xF, 1),
    // TIM5 measures LSI (29.5): TI1SEL (3:0) = 0001; CC1S (1:0) = 01, no prescaler, no filter; CC1E; TS (21:20, 6:4) = 00101, SMS (16, 2:0) = 0100.
    new_register_setting("TIM5 TISEL", 0x4000_0C5C, 0xF, 1),
    new_register_setting("TIM5 CCMR1", 0x4000_0C18, 0xFF, 0x01),
    new_register_setting("TIM5 CCER", 0x4000_0C20, 0xB, 0x1),
    new_register_setting("TIM5 SMCR", 0x4000_0C08, 0x0031_0077, 0x54),
    // OCRSEL (18:16): 011, the output of comparator 4.
    new_register_setting("TIM4 AF2", 0x4000_0864, 0x0007_0000, 0x0003_0000),
    new_register_setting("COMP1 CSR", 0x4001_0200, COMP_MASK, COMP_DAC),
    new_register_setting("COMP3 CSR", 0x4001_0208, COMP_MASK, COMP_DAC),
    new_register_setting("COMP4 CSR", 0x4001_020C, COMP_MASK, COMP_DAC),
    new_register_setting("COMP5 CSR", 0x4001_0210, COMP_MASK, COMP_LOOP),
    new_register_setting("COMP7 CSR", 0x4001_0218, COMP_MASK, COMP_LOOP),
    // 2100 V of 2500 V and 10 mA of 20 mA, of 4095 steps.
    new_register_setting("DAC3 DHR12R1", 0x5000_1008, 0xFFF, 3439),
    new_register_setting("DAC3 DHR12R2", 0x5000_1014, 0xFFF, 2047),
    // MODE1 and MODE2 (2:0 and 18:16): 011, to the chip's inside without buffer; HFSEL (15:14): 10, above 160 MHz.
    new_register_setting("DAC3 MCR", 0x5000_103C, 0x0007_C007, 0x0003_8003),
    // 1.9 V of 3.3 V, to the chip's inside; EN1 (0).
    new_register_setting("DAC4 DHR12R1", 0x5000_1408, 0xFFF, 2357),
    new_register_setting("DAC4 MCR", 0x5000_143C, 0x0007_C007, 0x0003_8003),
    new_register_setting("DAC4 CR", 0x5000_1400, 1, 1),
    // 010, to the pin without buffer: the buffer cannot go below 0.2 V, which is a rail of 120 V.
    new_register_setting("DAC1 MCR", 0x5000_083C, 0x0007_C007, 0x0002_8002),
    // PVDE (0) and PLS (3:1): 110, 2.9 V.
    new_register_setting("PWR CR2", 0x4000_7004, 0xF, 0xD),
    // R1MODE (8): off, as the processor runs faster than 150 MHz (6.1.5).
    new_register_setting("PWR CR5", 0x4000_7080, 1 << 8, 0),
    // EXTI line 16 (15.3.2) is the output of the detector, which rises when the supply falls: IM16, RT16, and not FT16.
    new_register_setting("EXTI IMR1", 0x4001_0400, 1 << 16, 1 << 16),
    new_register_setting("EXTI RTSR1", 0x4001_0408, 1 << 16, 1 << 16),
    new_register_setting("EXTI FTSR1", 0x4001_040C, 1 << 16, 0),
    // Interrupts 1, PVD_PVM, and 24, TIM1_BRK_TIM15 (14.3), are enabled and of the highest priority, 0: NVIC (PM0214, 4.3).
    new_register_setting("NVIC ISER0", 0xE000_E100, 1 << 24 | 1 << 1, 1 << 24 | 1 << 1),
    new_register_setting("NVIC IPR0, PVD_PVM", 0xE000_E400, 0x0000_FF00, 0),
    new_register_setting("NVIC IPR6, TIM1_BRK_TIM15", 0xE000_E418, 0x0000_00FF, 0),
    // CLL, SPL, PVDL, ECCL: lock-up, SRAM parity, voltage detector and flash errors break the timers.
    new_register_setting("SYSCFG CFGR2", 0x4001_001C, 0xF, 0xF),
    // Three conversions (JL = 2) of inputs 1, 2, 6: PA0, PA1, PC0.
    new_register_setting("ADC1 JSQR", 0x5000_004C, 0xFBEF_BE03, 0x00C1_0202),
    // Two conversions each (JL = 1): ADC3 of input 5, PB13; ADC4 of input 4, PB14.
    new_register_setting("ADC3 JSQR", 0x5000_044C, 0xFBEF_BE03, 0x0002_8A01),
    new_register_setting("ADC4 JSQR", 0x5000_054C, 0xFBEF_BE03, 0x0002_0801),
    // Two conversions (L = 1) of input 1 and VREFINT, input 18.
    new_register_setting("ADC1 SQR1", 0x5000_0030, 0x0001_F7CF, 0x0001_2041),
    // One conversion (L = 0) of input 7, PC1; 640.5 clocks (111) of sampling; CONT (13) and OVRMOD (12), RES (4:3) for 12 bits.
    new_register_setting("ADC2 SQR1", 0x5000_0130, 0x0000_07CF, 0x0000_01C0),
    new_register_setting("ADC2 SMPR1", 0x5000_0114, 0x00E0_0000, 0x00E0_0000),
    new_register_setting("ADC2 CFGR", 0x5000_010C, 0x0000_3018, 0x0000_3000),
    // ROVSE (0), no JOVSE (1), OVSR (4:2) 101 for 64 conversions, OVSS (8:5) 2.
    new_register_setting("ADC2 CFGR2", 0x5000_0110, 0x0000_01FF, 0x0000_0055),
    // CKMODE (17:16): 11, a quarter of 170 MHz, as a converter takes 60 MHz at most (DS12288); VREFEN (22).
    new_register_setting("ADC12 CCR", 0x5000_0308, 0x0043_0000, 0x0043_0000),
    new_register_setting("ADC345 CCR", 0x5000_0708, 0x0003_0000, 0x0003_0000),
    // SMP6, SMP2 and SMP1 of the rails and the bond: 47.5 clocks. SMP18 of VREFINT: 247.5 clocks, as it takes 4 us.
    new_register_setting("ADC1 SMPR1", 0x5000_0014, 0x001C_01F8, 0x0010_0120),
    new_register_setting("ADC1 SMPR2", 0x5000_0018, 0x0700_0000, 0x0600_0000),
    // SMP5 of ADC3 and SMP4 of ADC4, the loops: 47.5 clocks (100).
    new_register_setting("ADC3 SMPR1", 0x5000_0414, 0x0003_8000, 0x0002_0000),
    new_register_setting("ADC4 SMPR1", 0x5000_0514, 0x0000_7000, 0x0000_4000),
    // DBG_SLEEP, DBG_STOP, DBG_STANDBY: off in a shipped image (ES0430, 2.2.8).
    new_register_setting("DBGMCU CR", 0xE004_2004, 0b111, 0),
    // DBG_TIM1_STOP (11), TIM8 (13), TIM16 (17) and TIM20 (20): outputs with a break go off while a debugger halts the processor.
    new_register_setting("DBGMCU APB2FZ", 0xE004_2010, 0x0012_2800, 0x0012_2800),
    // DBG_IWDG_STOP (12): with the supply off, a debugger may halt the processor without a reset.
    new_register_setting("DBGMCU APB1FZ", 0xE004_2008, 1 << 12, 1 << 12),
    // DISDEFWBUF (1): no write buffer (Cortex-M4 erratum 838869); not DISMCYCINT (0), nor DISFOLD (2).
    new_register_setting("ACTLR", 0xE000_E008, 0b111, 0b010),
];

/// Settings while the board is armed.
const SETTINGS_WHILE_LIVE: [Setting; 2] = [
    // BIE (7; 28.6.4): the breaks raise the interrupt that takes the pins of the timer without a break.
    new_register_setting("live: TIM1 DIER", 0x4001_2C0C, 1 << 7, 1 << 7),
    // DBG_IWDG_STOP: a processor that a debugger has halted is reset, and the supply goes off.
    new_register_setting("live: DBGMCU APB1FZ", 0xE004_2008, 1 << 12, 0),
];

/// The whole part of the report.
pub fn check_protective_register_settings_and_trip_thresholds(board: &mut EmulatedBoard, table: &mut ReportTable) {
    table.run_part_adding_row_on_error("settings", |table| {
        add_rows_of_settings_and_of_faults_just_within_and_beyond_limits(board, table)
    });
}

/// One row for each setting.
fn add_rows_of_settings(settings: &[Setting], board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    for Setting { name, address, mask, expected } in settings {
        let seen = board.read_memory_word(*address)? & mask;
        table.add_comparison_row(&format!("setting: {name}"), &format!("{expected:#010x}"), &format!("{seen:#010x}"));
    }
    Ok(())
}

/// The numbers of the interrupts that are enabled and that no other can interrupt (PM0214, 4.3: NVIC_ISERx and NVIC_IPRx; the chip has
/// 102 interrupts and 4 bits of priority).
fn list_enabled_interrupts_of_highest_priority(board: &mut EmulatedBoard) -> Result<Vec<u32>, Error> {
    let mut found = Vec::new();
    for number in 0..102 {
        let enabled = board.read_memory_word(0xE000_E100 + 4 * (number / 32))? >> (number % 32) & 1 == 1;
        let priority = board.read_memory_word(0xE000_E400 + 4 * (number / 4))? >> (8 * (number % 4)) & 0xF0;
        if enabled && priority == 0 {
            found.push(number);
        }
    }
    Ok(found)
}

/// Compares every setting, and tries thresholds from both sides.
fn add_rows_of_settings_and_of_faults_just_within_and_beyond_limits(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
) -> Result<(), Error> {
    super::trips::power_up_and_drive(board)?;
    add_rows_of_settings(&SETTINGS_WHILE_LIVE, board, table)?;
    // Off, whatever came before: the main output enable of TIM16, which gives the permit, is set while the board is armed.
    board.send_request(&Request::Stop)?;
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 1000)?;
    table.add_time_limit_row("settings: stopped, safe", 1000.0, safe.ok());
    add_rows_of_settings(&SETTINGS, board, table)?;
    let urgent = list_enabled_interrupts_of_highest_priority(board)?;
    table.add_comparison_row("setting: enabled interrupts of priority 0", "[1, 24]", &format!("{urgent:?}"));
    // What trips and what does not: 5 % around 10 mA and 2100 V, with the hysteresis of 20 mV (0.12 mA, 15 V); a bond of 12 ohm and one of 40 ohm
    // at 330 ohm from 3.3 V.
    let thresholds = [
        ("9.5 mA", json!({"overcurrent_ma": 9.5}), false),
        ("10.5 mA", json!({"overcurrent_ma": 10.5}), true),
        ("a bond of 12 ohm", json!({"earth": 12}), false),
        ("a bond of 40 ohm", json!({"earth": 40}), true),
        ("a bond that is not fed", json!({"earth": "unfed"}), true),
        // LSI has 29.5 to 34 kHz, the processor's oscillator 2 %.
        ("watchdog's clock 29.0 kHz", json!({"lsi": 29.0 / 32.0}), false),
        ("watchdog's clock 34.7 kHz", json!({"lsi": 34.7 / 32.0}), false),
        ("watchdog's clock 27 kHz", json!({"lsi": 27.0 / 32.0}), true),
        ("watchdog's clock 37 kHz", json!({"lsi": 37.0 / 32.0}), true),
        // A closed loop is at 2.185 V; 1 % for each resistor and 500 ohm of wire make 2.10 to 2.20 V.
        ("interlock at 2.08 V", json!({"interlock": 2.08}), false),
        ("interlock at 2.25 V", json!({"interlock": 2.25}), false),
        ("interlock at 1.90 V", json!({"interlock": 1.90}), true),
        ("interlock at 2.45 V", json!({"interlock": 2.45}), true),
        ("emergency stop at 2.08 V", json!({"estop": 2.08}), false),
        ("emergency stop at 2.25 V", json!({"estop": 2.25}), false),
        ("emergency stop at 1.90 V", json!({"estop": 1.90}), true),
        ("emergency stop at 2.45 V", json!({"estop": 2.45}), true),
    ];
    for (name, fault, trips) in thresholds {
        super::trips::power_up_and_drive(board)?;
        board.inject_fault(&fault)?;
        board.advance_time_with_keep_alives(0.01)?;
        let state = board.read_status()?.state;
        let expected = if trips { SafetyState::Fault } else { SafetyState::Running };
        table.add_comparison_row(&format!("threshold: {name}"), expected.name(), state.name());
        board.inject_fault(&json!({"heal": true}))?;
    }
    // The detail is the level in mV, to the converter's step of 0.8 mV.
    super::trips::power_up_and_drive(board)?;
    board.inject_fault(&json!({"interlock": 2.45}))?;
    board.advance_time_with_keep_alives(0.01)?;
    let detail = board.read_latched_fault()?.map(|fault| fault.detail);
    let is_right = detail.is_some_and(|millivolts| millivolts.abs_diff(2_450) <= 1);
    table.add_row("threshold: interlock's level in the detail", "2450 mV", &format!("{detail:?}"), is_right);
    board.inject_fault(&json!({"heal": true}))?;
    Ok(())
}
