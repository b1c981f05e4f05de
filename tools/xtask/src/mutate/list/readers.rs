//! Mistakes that readers of the code thought of, because they suspected that nothing looks there.

use super::{BoardCheck, Mutation, new_mutation};
use crate::emulate::report::ReportPart;

/// All of them.
pub const MUTATIONS: &[Mutation] = &[
    new_mutation(
        "a sequence may begin at any time",
        "shared/src/device/windows.rs",
        "if asked_us < ready_us || asked_us > now_us.saturating_add(EARLIEST_US) {",
        "if asked_us < ready_us {",
    ),
    new_mutation(
        "a preload is late only in the wrong unit",
        "shared/src/waveform/sequencer.rs",
        "elapsed_us.saturating_add(TOO_LATE_US).saturating_mul(clocks_per_us) > self.at",
        "elapsed_us.saturating_add(TOO_LATE_US) > self.at && clocks_per_us > 0",
    ),
    new_mutation(
        "an effect that was refused is remembered as played",
        "shared/src/device/answers.rs",
        "                let reply =\n                    self.queue_effect_and_write_due_preloads(board, link, *channel, *start_us, effect, now_us)?;\n                self.remember_played(link, *number, None);\n",
        "                self.remember_played(link, *number, None);\n                let reply =\n                    self.queue_effect_and_write_due_preloads(board, link, *channel, *start_us, effect, now_us)?;\n",
    ),
    new_mutation(
        "effects that wait outlive the drives that they were for",
        "shared/src/waveform/sequencer.rs",
        "            track.queue.clear();\n            track.plays_windows = false;\n        }\n        let before: [Option",
        "            track.plays_windows = false;\n        }\n        let before: [Option",
    ),
    new_mutation(
        "a rail of 15 V does not count as absent",
        "shared/src/limits.rs",
        "pub const TEST_ABSENT_MILLIVOLTS: u32 = 15_000;",
        "pub const TEST_ABSENT_MILLIVOLTS: u32 = 14_000;",
    ),
    new_mutation(
        "a rail that is too high in the self-test is waited for",
        "shared/src/safety/arming.rs",
        "&& !matches!(self.phase, SelfTestPhase::Discharge)",
        "&& matches!(self.phase, SelfTestPhase::Discharge)",
    ),
    new_mutation(
        "the current through discharge switches counts as an over-current",
        "shared/src/supply/watch.rs",
        "microamps.saturating_sub(through_switches_microamps)",
        "microamps.saturating_sub(through_switches_microamps / 8)",
    ),
    new_mutation(
        "another fault hides a slow discharge",
        "shared/src/device/answers.rs",
        "                if self.discharges_slowly {\n                    return Err(",
        "                if self.discharges_slowly && self.still_charged {\n                    return Err(",
    ),
    new_mutation(
        "faults are numbered from 1 after every start",
        "shared/src/device/mod.rs",
        "self.safety.number_faults_after_boot_id(board.info().boot_id);",
        "self.safety.number_faults_after_boot_id(0);",
    ),
    new_mutation(
        "the inputs of the over-voltage comparators are not tried",
        "firmware/src/breaks.rs",
        "poll_within_trip_time(|| comparator.is_tripped() == charged);",
        "poll_within_trip_time(|| true || comparator.is_tripped() == charged);",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the electrodes' test leaves out a pulse that its limits count",
        "firmware/src/electrode_test.rs",
        "        if number == 0 {",
        "        if number == 1 {",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "a trip does not end the pulses of the electrodes' test",
        "firmware/src/electrode_test.rs",
        "            take_trip_as_error()?;\n            fail_arming_if_pin_not_low(find_electrode_not_low())?;",
        "            fail_arming_if_pin_not_low(find_electrode_not_low())?;",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "pins that energise float while the watchdog is tried",
        "firmware/src/main.rs",
        "    // Before the clocks are set up.\n    outputs::force_outputs_off_withdraw_permit_and_stop_timers();\n",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "both copies of the run's record are one",
        "firmware/src/run_record.rs",
        "    [first, first.wrapping_add(1)]",
        "    [first, first.wrapping_add(0)]",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "the note of a failure stays after it has been told",
        "firmware/src/fatal.rs",
        "    unsafe { (&raw mut (*place).magic).write_volatile(0) };",
        "    unsafe { (&raw mut (*place).magic).write_volatile(MAGIC) };",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "a voltage detector that is off passes the self-test",
        "firmware/src/brown_out.rs",
        "    control.pvde() && control.pls() == LEVEL",
        "    control.pvde() || control.pls() == LEVEL",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Trips)),
    new_mutation(
        "the UART interrupts at the priority of what switches off",
        "firmware/src/priorities.rs",
        "    Interrupt::LPUART1.set_priority(Priority::P3);\n",
        "",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "interrupts that nobody uses are enabled",
        "firmware/src/priorities.rs",
        "        disable(word, !0);",
        "        disable(word, 0);",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
    new_mutation(
        "every start has the same boot id",
        "firmware/src/identity.rs",
        "        boot_id: read_random_number().unwrap_or_else(derive_boot_id_without_rng),",
        "        boot_id: read_random_number().and(None).unwrap_or_else(derive_boot_id_without_rng),",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Failures)),
    new_mutation(
        "a break leaves the set-points",
        "firmware/src/outputs.rs",
        "    timers::stop_timers_outputs_and_break_interrupt();\n    rails::set_all_rails_to_zero();\n",
        "    timers::stop_timers_outputs_and_break_interrupt();\n",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Permit)),
    new_mutation(
        "the loops are sampled for the shortest time",
        "firmware/src/sense.rs",
        "converter.smpr().modify(|w| w.set_smp(input, SampleTime::CYCLES47_5));",
        "converter.smpr().modify(|w| w.set_smp(input, SampleTime::CYCLES2_5));",
    )
    .with_first_check(BoardCheck::Report(ReportPart::Settings)),
];
