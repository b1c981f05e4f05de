//! Mistakes in the firmware.

use super::{BoardCheck, Mutation, new_mutation, new_undetectable_mutation};
use crate::emulate::report::ReportPart;

/// All of them.
pub const MUTATIONS: &[Mutation] = &[
    new_mutation(
        "inputs of the rails exchanged",
        "firmware/src/sense.rs",
        "const INPUTS: [usize; 3] = [1, 2, 6];",
        "const INPUTS: [usize; 3] = [2, 1, 6];",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "the distrust of the rails is not kept over a reset",
        "firmware/src/run_record.rs",
        "        is_measurement_distrusted: u32::from(run.is_measurement_distrusted),\n",
        "        is_measurement_distrusted: 0,\n",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "every reset refills the credit",
        "firmware/src/run_record.rs",
        "        credit_ms: run.credit_ms,",
        "        credit_ms: [60_000; CHANNELS],",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "the interrupt of the breaks is off while live",
        "firmware/src/timers.rs",
        "    clear_break_flags();\n    set_break_interrupt(true);",
        "    clear_break_flags();\n    set_break_interrupt(false);",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "converters at 170 MHz",
        "firmware/src/sense.rs",
        "        w.set_ckmode(Ckmode::SYNC_DIV4);\n        w.set_vrefen(true);",
        "        w.set_ckmode(Ckmode::SYNC_DIV1);\n        w.set_vrefen(true);",
    ),
    new_mutation(
        "an NMI leaves everything on until its reset",
        "firmware/src/fatal.rs",
        "    force_outputs_off_withdraw_permit_and_stop_timers();\n    let flash = FLASH.eccr().read().0;",
        "    let flash = FLASH.eccr().read().0;",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "a permit that is stuck high is only noticed at arming",
        "firmware/src/permit.rs",
        "    let is_as_set = || is_line_high() == GIVEN.load(Ordering::Relaxed);",
        "    let is_as_set = || is_line_high() || !GIVEN.load(Ordering::Relaxed);",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "170 MHz in the mode for 150 MHz",
        "firmware/src/clocks.rs",
        "    PWR.cr5().modify(|w| w.0 &= !CR5_R1MODE);\n",
        "",
    ),
    new_mutation(
        "pads are believed to follow their registers",
        "firmware/src/outputs.rs",
        "    let high = (port.odr().read().0 | port.idr().read().0) & pins;",
        "    let high = port.odr().read().0 & pins;",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the watchdog stands still in a debugger while live",
        "firmware/src/supply.rs",
        "watchdog::set_watchdog_frozen_in_debug_and_freeze_timers(false);",
        "watchdog::set_watchdog_frozen_in_debug_and_freeze_timers(true);",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "an electrode is tried without a look at the others",
        "firmware/src/electrode_test.rs",
        ".and_then(|()| fail_arming_if_pin_not_low(find_other_electrode_not_low(pin)));",
        ".map(|()| {});",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "an electrode's pad is believed to follow its register",
        "firmware/src/outputs.rs",
        "poll_within(PAD_SETTLING, || port.idr().read().0 & (1 << number) != 0);",
        "poll_within(PAD_SETTLING, || port.odr().read().0 & (1 << number) != 0);",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
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
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "comparators are not looked at while live",
        "firmware/src/board.rs",
        "        if !comparators::are_all_settings_intact() {",
        "        if false && !comparators::are_all_settings_intact() {",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation("any bond is good enough", "firmware/src/sense.rs", "= 75..310;", "= 75..3100;")
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation("a bond loop that is not fed is a bond", "firmware/src/sense.rs", "= 75..310;", "= 0..310;")
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "the reference is not measured",
        "firmware/src/sense.rs",
        "    (CALIBRATION_MILLIVOLTS * calibration).checked_div(code).unwrap_or(u32::MAX)",
        "    (CALIBRATION_MILLIVOLTS * calibration).checked_div(code).map_or(u32::MAX, |_| 3_300)",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "breaks without lock",
        "firmware/src/timers.rs",
        "const BDTR_LOCKED: u32 = 0b11 << 8 | 1 << 10",
        "const BDTR_LOCKED: u32 = 1 << 10",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "outputs float when they are off",
        "firmware/src/timers.rs",
        "0b11 << 8 | 1 << 10 | 1 << 11 |",
        "0b11 << 8 | 1 << 11 |",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "interlock not led to the breaks",
        "firmware/src/timers.rs",
        "1 << 1 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 7;",
        "1 << 1 | 1 << 3 | 1 << 4 | 1 << 7;",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "trip at 14 mA",
        "firmware/src/comparators.rs",
        "(TRIP_MICROAMPS as u64 * FULL_CODE / MOMENTARY",
        "(TRIP_MICROAMPS as u64 * 14 / 10 * FULL_CODE / MOMENTARY",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation("hysteresis of 70 mV", "firmware/src/comparators.rs", "Hysteresis::HYST20M", "Hysteresis::HYST70M")
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
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
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the break interrupt stays off",
        "firmware/src/breaks.rs",
        "pub fn arm_break_interrupt() {\n    timers::clear_break_flags();\n    timers::set_break_interrupt(true);",
        "pub fn arm_break_interrupt() {\n    timers::clear_break_flags();\n    timers::set_break_interrupt(false);",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Permit)),
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
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "a panic leaves the outputs",
        "firmware/src/fatal.rs",
        "    cortex_m::interrupt::disable();\n    force_outputs_off_withdraw_permit_and_stop_timers();\n    let (file, line)",
        "    cortex_m::interrupt::disable();\n    let (file, line)",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "a reset while live is forgotten",
        "firmware/src/identity.rs",
        "        None if was_live =>",
        "        None if was_live && dipped =>",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
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
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "a comparator passes its test although no timer has followed",
        "firmware/src/breaks.rs",
        "comparator.is_tripped() && are_all_cleared()",
        "comparator.is_tripped() || are_all_cleared()",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Permit)),
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
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "notes are read although parity is on",
        "firmware/src/pre_init.rs",
        "    \"    bmi 2f\",",
        "    \"    b 2f\",",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "the fourth timer is not looked at while live",
        "firmware/src/board.rs",
        "        for (channel, number) in (0..CHANNELS).zip(0..) {",
        "        for (channel, number) in (0..CHANNELS - 1).zip(0..) {",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the sampling time of the reference is that of another input",
        "firmware/src/sense.rs",
        "usize::from(REFERENCE_INPUT) - 10, SampleTime::CYCLES247_5",
        "usize::from(REFERENCE_INPUT) - 11, SampleTime::CYCLES247_5",
    ),
    new_mutation(
        "the watchdog keeps its 512 ms",
        "firmware/src/watchdog.rs",
        "    IWDG.kr().write(|w| w.set_key(Key::ENABLE));\n",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "the watchdog is tried with its longest time",
        "firmware/src/watchdog_proof.rs",
        "    IWDG.kr().write(|w| w.set_key(Key::ENABLE));\n",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "the watchdog's settings are not read back",
        "firmware/src/main.rs",
        "if is_watchdog_proven && is_watchdog_set_up {",
        "if is_watchdog_proven || is_watchdog_set_up && false {",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "breaks of the electrodes' timers are not looked at while live",
        "firmware/src/timers.rs",
        "timer.af1().read().0 == AF1_COMPARATORS && timer.bdtr().read().0 & !BDTR_MOE == BDTR_LOCKED",
        "timer.af1().read().0 == AF1_COMPARATORS",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the break of the permit is not looked at",
        "firmware/src/permit.rs",
        "        && TIMER.bdtr().read().0 & !BDTR_MOE == BDTR_LOCKED\n",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "a converter that delivers nothing shows discharged rails",
        "firmware/src/sense.rs",
        "    rail_millivolts: [u32::MAX; 2],\n",
        "    rail_millivolts: [0; 2],\n",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "a clock that is wrong by a third is accepted",
        "firmware/src/clock_check.rs",
        "const LSI_HZ: Range<u32> = 28_000..36_000;",
        "const LSI_HZ: Range<u32> = 23_000..41_000;",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "the thresholds' way to the comparators is not looked at",
        "firmware/src/comparators.rs",
        "converter.mcr().read().0 == build_threshold_dac_mode_register().0\n            && ",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the thresholds' enable is not looked at",
        "firmware/src/comparators.rs",
        "\n            && converter.cr().read().0 == build_threshold_dac_control_register().0",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "with parity on the stack is not written first",
        "firmware/src/pre_init.rs",
        "    \"    mov r2, sp\",",
        "    \"    ldr r2, =0x20018000\",",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "the comparators of the loops are tried without their inputs",
        "firmware/src/breaks.rs",
        "        .and_then(|()| test_interlock_and_stop_loop_comparators())\n",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the threshold of the loops is not looked at",
        "firmware/src/comparators.rs",
        "        && DAC4.dor(0).read().dor() == LOOP_CODE\n",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "a wrong rate of the board's time is accepted",
        "firmware/src/clock_check.rs",
        "    TIM2.psc().read() == TIME_PRESCALER",
        "    TIM2.psc().read() >= TIME_PRESCALER",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the permit's step proves the supply's gate no more",
        "firmware/src/supply.rs",
        "let enabled = command.enabled && !tripped;",
        "let enabled = command.enabled && command.permitted && !tripped;",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the voltage detector is locked before it is set up",
        "firmware/src/main.rs",
        "    brown_out::init_voltage_detector();\n    breaks::connect_core_failures_to_breaks_and_enable_interrupt();",
        "    breaks::connect_core_failures_to_breaks_and_enable_interrupt();\n    brown_out::init_voltage_detector();",
    ),
    new_mutation(
        "nothing looks at what clears the timer without a break",
        "firmware/src/timers.rs",
        "pac::TIM4.af2().read().0 == AF2_CLEAR_BY_COMPARATOR_4 && pac::TIM4.smcr()",
        "pac::TIM4.smcr()",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "loaded option bytes leave memory as it is",
        "firmware/src/pre_init.rs",
        "    \"    tst r1, #0x0A000000\",",
        "    \"    tst r1, #0x08000000\",",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_undetectable_mutation(
        "no write before the first return address",
        "firmware/src/pre_init.rs",
        ["    \"    str r0, [sp, #-8]\",\n", ""],
        "the emulated memory loses no write after a reset, and the erratum's conditions are not published",
    ),
    new_mutation(
        "converters are not calibrated",
        "firmware/src/sense.rs",
        "    converter.cr().modify(|w| w.set_adcal(true));\n",
        "",
    ),
    new_mutation(
        "a HardFault leaves the outputs",
        "firmware/src/fatal.rs",
        "    // Only an NMI can interrupt this, and it ends here too.\n    force_outputs_off_withdraw_permit_and_stop_timers();\n",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "an interrupt that nobody has enabled leaves the outputs",
        "firmware/src/fatal.rs",
        "    force_outputs_off_withdraw_permit_and_stop_timers();\n    write_note_and_reset(EXCEPTION, number",
        "    write_note_and_reset(EXCEPTION, number",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_undetectable_mutation(
        "the device checks in without a tick",
        "firmware/src/device_task.rs",
        ["if device.take_tick_done() {", "if device.take_tick_done() || true {"],
        "a tick is missing only when time stands still, and then nothing wakes the other tasks to check in",
    ),
    new_undetectable_mutation(
        "a preload is written while update events are allowed",
        "firmware/src/timers.rs",
        ["regs::Cr1Gp16(registers.cr1 | CR1_UDIS)", "regs::Cr1Gp16(registers.cr1)"],
        "the emulator looks at registers every 5 us, and the writes take some ten clocks",
    ),
    new_undetectable_mutation(
        "a link does not tell that a program has opened it",
        "firmware/src/links/mod.rs",
        ["        INBOX.send((link, LinkArrival::Reopened)).await;\n", ""],
        "a UART is opened once, at the start, and the emulator has no USB",
    ),
    new_undetectable_mutation(
        "RTS is taken for DTR",
        "firmware/src/links/usb.rs",
        ["line.dtr()", "line.rts()"],
        "the emulator has no USB",
    ),
    new_undetectable_mutation(
        "the watchdog does not wait for the tasks of USB",
        "firmware/src/watchdog.rs",
        ["const ALL: u32 = (1 << NAMES.len()) - 1;", "const ALL: u32 = 0b111;"],
        "the emulator has no USB, so these tasks never hang",
    ),
];
