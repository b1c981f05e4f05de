//! From requests to registers to edges, and back: what the edges do is what was asked for.

mod support;

use era_shared::protocol::{ChannelDrive, ChannelLimits};
use era_shared::waveform::{
    DriveError, Electrode, ElectrodeWindows, OutputPair, Pulse, TickWindow, TimerModel, TimerPeriod, TimerRegisters,
    WindowsError, compute_channel_program,
};
use proptest::prelude::*;
use support::make_channel_limits;

const OUTPUTS: OutputPair = OutputPair { a: 1, b: 3 };

/// All that must hold for a drive that was accepted, seen from the edges.
fn check_edges(drive: &ChannelDrive) -> Result<(), TestCaseError> {
    let planned = compute_channel_program(&make_channel_limits(), drive)
        .map_err(|error| TestCaseError::fail(format!("{error:?}")))?;
    let registers = TimerRegisters::for_running_timer(&planned.full_level_period(), OUTPUTS);
    let windows =
        ElectrodeWindows::from_registers(&registers).map_err(|error| TestCaseError::fail(format!("{error:?}")))?;
    prop_assert_eq!(windows.overlap_ticks(), 0);
    let tick_s = windows.tick_length_s(170_000_000);
    let guard_s = f64::from(windows.shortest_guard_ticks_if_both_have_windows().unwrap()) * tick_s;
    prop_assert!(guard_s >= 200e-6, "guard {guard_s}");
    prop_assert!((guard_s * 1e9 - f64::from(planned.achieved.guard_ns)).abs() < 1.01);
    // Half of it lies on each side of the boundary, where another drive may follow.
    let ends = [windows.a.start.min(windows.b.start), windows.period - windows.b.start - windows.b.length];
    prop_assert!(ends.iter().all(|ticks| f64::from(*ticks) * tick_s >= 100e-6), "{ends:?}");

    let frequency = 1.0 / (f64::from(windows.period) * tick_s);
    let asked = f64::from(drive.frequency_millihertz) / 1e3;
    prop_assert!((frequency / asked - 1.0).abs() < 20e-6, "{frequency} for {asked}");
    prop_assert!((frequency - planned.achieved.frequency_nanohertz as f64 / 1e9).abs() < 1e-9 + frequency * 1e-12);

    // Equal windows, half a turn apart to half a tick, each in the middle of its half; rounded down by less than two ticks.
    prop_assert_eq!(windows.a.length, windows.b.length);
    let half = f64::from(windows.period) / 2.0;
    let width = f64::from(windows.a.length) / half;
    let asked_width = f64::from(drive.pulse_width_ppm) / 1e6;
    prop_assert!(width <= asked_width + 1e-12 && width > asked_width - 1.0 / half);
    let centre = |window: TickWindow| f64::from(window.start) + f64::from(window.length) / 2.0;
    prop_assert!((centre(windows.b) - centre(windows.a) - half).abs() <= 0.5);
    prop_assert!((centre(windows.a) - half / 2.0).abs() <= 0.75, "A is in the middle of its half");

    // Phase: the time from the origin to A's centre, as a part of a turn, is minus the phase.
    let clocks = planned.period_clocks() as f64;
    let to_a = centre(windows.a) * f64::from(windows.divider) - planned.origin_clocks as f64;
    let phase = (-to_a / clocks).rem_euclid(1.0);
    let asked_phase = f64::from(drive.phase_microturns) / 1e6;
    let difference = (phase - asked_phase + 1.5).rem_euclid(1.0) - 0.5;
    prop_assert!(difference.abs() <= 0.76 / clocks, "phase {phase} for {asked_phase}");
    let reported = f64::from(planned.achieved.phase_microturns) / 1e6;
    prop_assert!(((reported - phase + 1.5).rem_euclid(1.0) - 0.5).abs() < 1e-6);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(support::reduce_case_count_under_miri(20_000)))]

    #[test]
    fn accepted_drives_have_safe_edges(
        frequency_millihertz in 1_000_u32..=1_000_000,
        share in 0.01_f64..=1.0,
        phase_microturns in 0_u32..1_000_000,
        voltage_millivolts in 0_u32..=2_000_000,
    ) {
        // The widest pulse that leaves 200 us on both sides of a half period, less one tick's rounding.
        let widest = 1.0 - 2.0 * 200e-6 * f64::from(frequency_millihertz) / 1e3 - 2e-4;
        let drive = ChannelDrive {
            channel: 0,
            frequency_millihertz,
            pulse_width_ppm: (share * widest * 1e6) as u32,
            phase_microturns,
            voltage_millivolts,
        };
        check_edges(&drive)?;
    }

    /// Whatever is asked for, an answer comes back and it is either safe edges or an error with its limits.
    #[test]
    fn any_request_is_safe_or_refused(frequency_millihertz: u32, pulse_width_ppm: u32, phase_microturns: u32, voltage_millivolts: u32) {
        let drive = ChannelDrive { channel: 0, frequency_millihertz, pulse_width_ppm, phase_microturns, voltage_millivolts };
        if compute_channel_program(&make_channel_limits(), &drive).is_ok() {
            check_edges(&drive)?;
        }
    }

    /// A board whose configuration asks for less than 88 us keeps them: 40 us until the lower switch is on, and 1.2 x 3.507 x 11.6 us.
    #[test]
    fn the_guard_is_never_under_88_us(min_guard_ns in 0_u32..88_000, frequency_millihertz in 1_000_u32..=1_000_000, pulse_width_ppm in 1_u32..=1_000_000) {
        let limits = ChannelLimits { min_guard_ns, ..make_channel_limits() };
        let drive = ChannelDrive { frequency_millihertz, pulse_width_ppm, ..support::make_drive(0) };
        if let Ok(planned) = compute_channel_program(&limits, &drive) {
            let windows = ElectrodeWindows::from_registers(&TimerRegisters::for_running_timer(&planned.full_level_period(), OUTPUTS)).unwrap();
            prop_assert!(f64::from(windows.shortest_guard_ticks_if_both_have_windows().unwrap()) * windows.tick_length_s(170_000_000) >= 88e-6);
        }
    }

    /// Registers with random bits never panic, and if both electrodes overlap the model says so at some tick.
    #[test]
    fn any_registers_are_understood(
        cr1: u32, ccmr1: u32, ccmr2: u32, ccer: u32, psc in 0_u32..4, arr in 0_u32..60,
        ccr in prop::array::uniform4(0_u32..70), proper: bool
    ) {
        let known = TimerRegisters::for_running_timer(&TimerPeriod::without_windows(1, 2), OUTPUTS);
        let registers = if proper {
            TimerRegisters { psc, arr, ccr, ..known }
        } else {
            TimerRegisters { cr1: cr1 | 1, ccmr1, ccmr2, ccer, psc, arr, ccr, bdtr: 1 << 15 }
        };
        if let Ok(windows) = ElectrodeWindows::from_registers(&registers) {
            let both = (0..windows.period).filter(|tick| windows.electrode_on_at_tick_or_err_if_both_on(*tick).is_err()).count();
            prop_assert_eq!(both as u32, windows.overlap_ticks());
        }
    }
}

#[test]
fn every_boundary_frequency() {
    let step = if cfg!(miri) { 99_991 } else { 997 };
    for frequency_millihertz in
        (1_000..=1_000_000).step_by(step).chain([1_000, 1_001, 19_999, 20_000, 999_999, 1_000_000])
    {
        let drive = ChannelDrive {
            frequency_millihertz,
            pulse_width_ppm: 300_000,
            phase_microturns: 499_999,
            ..support::make_drive(0)
        };
        check_edges(&drive).unwrap();
    }
}

/// Counting as RM0440 28.3.10 and 28.3.13 say, tick by tick, for small timers and every choice of outputs.
#[test]
fn the_counter_follows_the_reference_manual() {
    for (a, b) in [(1, 3), (1, 4), (2, 3), (2, 4)] {
        for (ticks, width, reversed) in [(40, 12, false), (40, 12, true), (41, 7, false), (43, 1, true)] {
            let period = TimerPeriod::with_windows(1, ticks, width, reversed);
            let registers = TimerRegisters::for_running_timer(&period, OutputPair { a, b });
            let windows = ElectrodeWindows::from_registers(&registers).unwrap();
            assert_eq!(windows.period, registers.arr + 1);
            for count in 0..=registers.arr {
                // OCxREF of mode 1: CNT < CCR; of mode 2: CNT >= CCR; combined mode 2: both of the pair.
                let below = |channel: usize| count < registers.ccr[channel - 1];
                let pair = |output: u8, other: usize| !below(usize::from(output)) && below(other);
                let (on_a, on_b) = (pair(a, usize::from(3 - a)), pair(b, usize::from(7 - b)));
                let expected = match (on_a, on_b) {
                    (true, false) => Some(Electrode::A),
                    (false, true) => Some(Electrode::B),
                    (false, false) => None,
                    (true, true) => panic!("overlap at {count}"),
                };
                assert_eq!(
                    windows.electrode_on_at_tick_or_err_if_both_on(count),
                    Ok(expected),
                    "count {count} of {period:?}"
                );
            }
            let first = if reversed { windows.b } else { windows.a };
            assert!(first.start < ticks / 2, "the force begins with A unless it is reversed");
        }
    }
}

/// The bits, against numbers worked out by hand from the register descriptions.
#[test]
fn register_values_of_a_drive() {
    let period = TimerPeriod { divider: 3, ..TimerPeriod::with_windows(3, 56_667, 10_000, false) };
    let registers = TimerRegisters::for_running_timer(&period, OutputPair { a: 1, b: 4 });
    // ARPE | CEN.
    assert_eq!(registers.cr1, 0x81);
    // OC1M = 1101: 101 at 4, 1 at 16; OC2M = 0110: 110 at 12; OC1PE at 3, OC2PE at 11.
    assert_eq!(registers.ccmr1, 1 << 16 | 0b110 << 12 | 1 << 11 | 0b101 << 4 | 1 << 3);
    // OC3M = 0110; OC4M = 1101: 101 at 12, 1 at 24.
    assert_eq!(registers.ccmr2, 1 << 24 | 0b101 << 12 | 1 << 11 | 0b110 << 4 | 1 << 3);
    assert_eq!(registers.ccer, 1 | 1 << 12);
    assert_eq!((registers.psc, registers.arr), (2, 56_666));
    // (56667 - 20000) / 4 = 9166; half a period later: + 28333. Channel 4 opens B, channel 3 closes it.
    assert_eq!(registers.ccr, [9_166, 19_166, 47_499, 37_499]);
    // Without a break input: OC1CE and OC3CE at 7, OC2CE and OC4CE at 15.
    let cleared = registers.with_output_clear_on_trip_enabled();
    assert_eq!((cleared.ccmr1 ^ registers.ccmr1, cleared.ccmr2 ^ registers.ccmr2), (0x8080, 0x8080));
}

#[test]
fn preload_break_and_idle_of_the_model() {
    let first = TimerPeriod::with_windows(2, 100, 20, false);
    let second = TimerPeriod::with_windows(3, 80, 10, true);
    let mut timer = TimerModel::new(TimerRegisters::for_running_timer(&first, OUTPUTS), 1_000);
    timer.write_preload_registers(TimerRegisters::for_running_timer(&second, OUTPUTS));
    let mut pulses = Vec::new();
    timer.run_until(1_000 + 200 + 240, |pulse| pulses.push(pulse)).unwrap();
    let pulse = |electrode, from, to| Pulse { electrode, from, to };
    // (100 - 40) / 4 = 15 ticks of 2 clocks; then, reversed, (80 - 20) / 4 = 15 ticks of 3 clocks.
    let expected = vec![
        pulse(Electrode::A, 1_030, 1_070),
        pulse(Electrode::B, 1_130, 1_170),
        pulse(Electrode::B, 1_245, 1_275),
        pulse(Electrode::A, 1_365, 1_395),
    ];
    assert_eq!(pulses, expected, "the write took effect at the update event");
    // A break in the middle of a pulse ends it at once, and what follows stays low until MOE is set again.
    pulses.clear();
    timer.run_until(1_440 + 50, |pulse| pulses.push(pulse)).unwrap();
    timer.trip_break();
    timer.run_until(1_440 + 240, |pulse| pulses.push(pulse)).unwrap();
    assert_eq!(pulses, [pulse(Electrode::B, 1_485, 1_490)]);
    timer.enable_main_output_again();
    timer.run_until(1_680 + 60, |pulse| pulses.push(pulse)).unwrap();
    assert_eq!(pulses[1..], [pulse(Electrode::B, 1_725, 1_740)]);
}

#[test]
fn each_way_to_be_out_of_range_has_its_error() {
    let good = support::make_drive(0);
    let fails = |drive: ChannelDrive| compute_channel_program(&make_channel_limits(), &drive).unwrap_err();
    assert!(compute_channel_program(&make_channel_limits(), &good).is_ok());
    assert_eq!(
        fails(ChannelDrive { frequency_millihertz: 999, ..good }),
        DriveError::Frequency { requested_millihertz: 999, min_millihertz: 1_000, max_millihertz: 1_000_000 }
    );
    assert!(matches!(
        fails(ChannelDrive { frequency_millihertz: 0, ..good }),
        DriveError::Frequency { requested_millihertz: 0, .. }
    ));
    assert!(matches!(fails(ChannelDrive { frequency_millihertz: u32::MAX, ..good }), DriveError::Frequency { .. }));
    assert_eq!(
        fails(ChannelDrive { voltage_millivolts: 2_000_001, ..good }),
        DriveError::Voltage { requested_millivolts: 2_000_001, max_millivolts: 2_000_000 }
    );
    assert_eq!(
        fails(ChannelDrive { phase_microturns: 1_000_000, ..good }),
        DriveError::Phase { requested_microturns: 1_000_000 }
    );
    assert!(matches!(fails(ChannelDrive { pulse_width_ppm: 0, ..good }), DriveError::PulseTooNarrow { .. }));
    let DriveError::PulseTooWide { widest_ppm, min_guard_ns, .. } =
        fails(ChannelDrive { pulse_width_ppm: 1_000_000, ..good })
    else {
        panic!("a full-width pulse leaves no guard time");
    };
    // 150 Hz: half a period is 3333 us, of which 200 us must stay free: 94 %.
    assert_eq!((widest_ppm / 1000, min_guard_ns), (939, 200_000));
    check_edges(&ChannelDrive { pulse_width_ppm: widest_ppm, ..good }).unwrap();
    let slow_clock = ChannelLimits { timer_clock_hz: 1_000, ..make_channel_limits() };
    assert!(matches!(
        compute_channel_program(&slow_clock, &good),
        Err(DriveError::NotRepresentable { timer_clock_hz: 1_000 })
    ));
}

#[test]
fn a_stopped_timer_energises_nothing_and_other_modes_are_refused() {
    let planned = compute_channel_program(&make_channel_limits(), &support::make_drive(0)).unwrap();
    let running = TimerRegisters::for_running_timer(&planned.full_level_period(), OUTPUTS);
    let off = ElectrodeWindows::from_registers(&TimerRegisters { bdtr: 0, ..running }).unwrap();
    assert_eq!((off.a.length, off.b.length, off.shortest_guard_ticks_if_both_have_windows()), (0, 0, None));
    let refused = |registers: TimerRegisters| ElectrodeWindows::from_registers(&registers).unwrap_err();
    assert_eq!(refused(TimerRegisters { cr1: running.cr1 | 1 << 5, ..running }), WindowsError::NotUpwards);
    assert_eq!(refused(TimerRegisters { ccer: running.ccer | 2, ..running }), WindowsError::Polarity);
    assert_eq!(refused(TimerRegisters { ccer: running.ccer | 4, ..running }), WindowsError::Polarity);
    assert_eq!(refused(TimerRegisters { cr1: 1, ..running }), WindowsError::NotPreloaded);
    assert_eq!(refused(TimerRegisters { ccmr2: running.ccmr2 & !8, ..running }), WindowsError::NotPreloaded);
    assert_eq!(refused(TimerRegisters { ccer: 0x111, ..running }), WindowsError::Outputs(Electrode::A));
    assert_eq!(refused(TimerRegisters { ccmr1: running.ccmr1 & !0x70, ..running }), WindowsError::Mode(Electrode::A));
    let blank = ElectrodeWindows::from_registers(&TimerRegisters::for_running_timer(
        &TimerPeriod::without_windows(3, 56_667),
        OUTPUTS,
    ))
    .unwrap();
    assert_eq!((blank.a.length, blank.b.length), (0, 0), "a blank period has no windows though outputs are enabled");
}

#[test]
fn the_rail_is_rounded_down() {
    use era_shared::supply::{rail_dac_code, round_down_to_dac_step_millivolts};
    for voltage_millivolts in (0..=2_000_000).step_by(1_237) {
        let planned = compute_channel_program(
            &make_channel_limits(),
            &ChannelDrive { voltage_millivolts, ..support::make_drive(0) },
        )
        .unwrap();
        let achieved = planned.achieved.voltage_millivolts;
        assert!(achieved <= voltage_millivolts && voltage_millivolts - achieved <= 2_000_000 / 4095 + 1);
        assert_eq!(rail_dac_code(achieved), rail_dac_code(voltage_millivolts), "the same step of the converter");
        assert_eq!(round_down_to_dac_step_millivolts(achieved), achieved);
    }
    assert_eq!((rail_dac_code(2_000_000), rail_dac_code(u32::MAX), rail_dac_code(0)), (4095, 4095, 0));
}
