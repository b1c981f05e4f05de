//! Mistakes in the firmware.

use super::{Mutation, new_mutation};

/// All of them.
pub const MUTATIONS: &[Mutation] = &[
    new_mutation(
        "inputs of the rails exchanged",
        "firmware/src/sense.rs",
        "const INPUTS: [usize; 3] = [1, 2, 6];",
        "const INPUTS: [usize; 3] = [2, 1, 6];",
    ),
    new_mutation(
        "the distrust of the rails is not kept over a reset",
        "firmware/src/run_record.rs",
        "        is_measurement_distrusted: u32::from(run.is_measurement_distrusted),\n",
        "        is_measurement_distrusted: 0,\n",
    ),
    new_mutation(
        "the write buffer stays on",
        "firmware/src/pre_init.rs",
        "    \"    movs r2, #2\",         // DISDEFWBUF",
        "    \"    movs r2, #0\",",
    ),
    new_mutation(
        "the permit stays while a debugger halts the processor",
        "firmware/src/watchdog.rs",
        "        w.set_tim16(true);\n",
        "        w.set_tim16(false);\n",
    ),
    new_mutation(
        "one converter that delivers is enough",
        "firmware/src/sense.rs",
        "converters.into_iter().all(|converter|",
        "converters.into_iter().any(|converter|",
    ),
    new_mutation(
        "comparators are not looked at while live",
        "firmware/src/board.rs",
        "        if !comparators::are_all_settings_intact() {",
        "        if false && !comparators::are_all_settings_intact() {",
    ),
    new_mutation("any bond is good enough", "firmware/src/sense.rs", "= 75..310;", "= 75..3100;"),
    new_mutation("a bond loop that is not fed is a bond", "firmware/src/sense.rs", "= 75..310;", "= 0..310;"),
    new_mutation(
        "the reference is not measured",
        "firmware/src/sense.rs",
        "    (CALIBRATION_MILLIVOLTS * calibration).checked_div(code).unwrap_or(u32::MAX)",
        "    (CALIBRATION_MILLIVOLTS * calibration).checked_div(code).map_or(u32::MAX, |_| 3_300)",
    ),
    new_mutation(
        "breaks without lock",
        "firmware/src/timers.rs",
        "const BDTR_LOCKED: u32 = 0b11 << 8 | 1 << 10",
        "const BDTR_LOCKED: u32 = 1 << 10",
    ),
    new_mutation(
        "outputs float when they are off",
        "firmware/src/timers.rs",
        "0b11 << 8 | 1 << 10 | 1 << 11 |",
        "0b11 << 8 | 1 << 11 |",
    ),
    new_mutation(
        "interlock not led to the breaks",
        "firmware/src/timers.rs",
        "1 << 1 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 7;",
        "1 << 1 | 1 << 3 | 1 << 4 | 1 << 7;",
    ),
    new_mutation(
        "trip at 14 mA",
        "firmware/src/comparators.rs",
        "(TRIP_MICROAMPS as u64 * FULL_CODE / MOMENTARY",
        "(TRIP_MICROAMPS as u64 * 14 / 10 * FULL_CODE / MOMENTARY",
    ),
    new_mutation("hysteresis of 70 mV", "firmware/src/comparators.rs", "Hysteresis::HYST20M", "Hysteresis::HYST70M"),
    new_mutation(
        "voltage detector at its lowest level",
        "firmware/src/brown_out.rs",
        "const LEVEL: u8 = 6;",
        "const LEVEL: u8 = 0;",
    ),
    new_mutation(
        "set-points through the buffer",
        "firmware/src/rails.rs",
        "Mode::NORMAL_EXT_BUFDIS;",
        "Mode::NORMAL_EXT_BUFEN;",
    ),
    new_mutation(
        "set-points ignore a waiting trip",
        "firmware/src/supply.rs",
        "        let tripped = trip::peek_trip_code().is_some();",
        "        let tripped = false;",
    ),
    new_mutation(
        "the break interrupt stays off",
        "firmware/src/breaks.rs",
        "pub fn arm_break_interrupt() {\n    timers::clear_break_flags();\n    timers::set_break_interrupt(true);",
        "pub fn arm_break_interrupt() {\n    timers::clear_break_flags();\n    timers::set_break_interrupt(false);",
    ),
    new_mutation(
        "the discharge switch of rail 2 is rail 1's",
        "firmware/src/pins.rs",
        "[make_pin(pac::GPIOC, 2), make_pin(pac::GPIOD, 2)];",
        "[make_pin(pac::GPIOC, 2), make_pin(pac::GPIOC, 2)];",
    ),
    new_mutation(
        "the watchdog is fed by the device alone",
        "firmware/src/watchdog.rs",
        "    if MISSING.load(Ordering::Relaxed) == 0 {",
        "    if MISSING.load(Ordering::Relaxed) & 1 == 0 {",
    ),
    new_mutation(
        "a panic leaves the outputs",
        "firmware/src/fatal.rs",
        "    cortex_m::interrupt::disable();\n    force_electrodes_and_supply_off();\n    let (file, line)",
        "    cortex_m::interrupt::disable();\n    let (file, line)",
    ),
    new_mutation(
        "a reset while live is forgotten",
        "firmware/src/identity.rs",
        "        None if was_live =>",
        "        None if was_live && dipped =>",
    ),
    new_mutation(
        "debug in sleep is left on",
        "firmware/src/clocks.rs",
        "    config.enable_debug_during_sleep = false;\n",
        "",
    ),
    new_mutation(
        "breaks are locked before they are led to the comparators",
        "firmware/src/timers.rs",
        "        timer.af1().write_value(regs::Af1Adv(AF1_COMPARATORS));\n        // Last: it locks.\n        timer.bdtr().write_value(regs::BdtrAdv(BDTR_LOCKED));",
        "        timer.bdtr().write_value(regs::BdtrAdv(BDTR_LOCKED));\n        timer.af1().write_value(regs::Af1Adv(AF1_COMPARATORS));",
    ),
    new_mutation(
        "the levels of the loops are those of the first conversion",
        "firmware/src/sense.rs",
        "scale_adc_code(converter.jdr(1).read().jdata(), PIN_FULL_SCALE_MILLIVOLTS)",
        "scale_adc_code(converter.jdr(0).read().jdata(), PIN_FULL_SCALE_MILLIVOLTS)",
    ),
    new_mutation(
        "a comparator passes its test although no timer has followed",
        "firmware/src/breaks.rs",
        "comparator.is_tripped() && are_all_cleared()",
        "comparator.is_tripped() || are_all_cleared()",
    ),
    new_mutation(
        "the voltage detector interrupts when the supply comes back",
        "firmware/src/brown_out.rs",
        "    EXTI.rtsr(0).modify(|w| w.set_line(LINE, true));",
        "    EXTI.ftsr(0).modify(|w| w.set_line(LINE, true));",
    ),
    new_mutation(
        "a current that is 3 s old is taken for the present one",
        "firmware/src/average_current.rs",
        "const LONGEST_AGE_US: u32 = 3_000;",
        "const LONGEST_AGE_US: u32 = 3_000_000;",
    ),
    new_mutation(
        "notes are read although parity is on",
        "firmware/src/pre_init.rs",
        "    \"    bmi 2f\",",
        "    \"    b 2f\",",
    ),
    new_mutation(
        "the fourth timer is not looked at while live",
        "firmware/src/board.rs",
        "        for (channel, number) in (0..CHANNELS).zip(0..) {",
        "        for (channel, number) in (0..CHANNELS - 1).zip(0..) {",
    ),
    new_mutation(
        "the sampling time of the reference is that of another input",
        "firmware/src/sense.rs",
        "usize::from(REFERENCE_INPUT) - 10, SampleTime::CYCLES247_5",
        "usize::from(REFERENCE_INPUT) - 11, SampleTime::CYCLES247_5",
    ),
];
