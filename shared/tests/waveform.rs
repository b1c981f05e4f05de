//! From requests to registers to edges, and back: what the edges do is what was asked for.

mod support;

use era_shared::protocol::ChannelDrive;
use era_shared::waveform::{DriveError, Electrode, TimerRegisters, Windows, WindowsError, program};
use proptest::prelude::*;
use support::limits;

/// All that must hold for a drive that was accepted, seen from the edges.
fn check_edges(drive: &ChannelDrive) -> Result<(), TestCaseError> {
    let planned = program(&limits(), drive).map_err(|error| TestCaseError::fail(format!("{error:?}")))?;
    let registers = TimerRegisters::running(&planned.timer);
    let windows = Windows::from_registers(&registers).map_err(|error| TestCaseError::fail(format!("{error:?}")))?;
    prop_assert_eq!(windows.overlap(), 0);
    let tick_s = windows.tick_s(170_000_000);
    let guard_s = f64::from(windows.guard().unwrap()) * tick_s;
    prop_assert!(guard_s >= 200e-6, "guard {guard_s}");
    prop_assert!((guard_s * 1e9 - f64::from(planned.achieved.guard_ns)).abs() < 1.01);

    let frequency = 1.0 / (f64::from(windows.period) * tick_s);
    let asked = f64::from(drive.frequency_millihertz) / 1e3;
    prop_assert!((frequency / asked - 1.0).abs() < 20e-6, "{frequency} for {asked}");
    prop_assert!((frequency - planned.achieved.frequency_nanohertz as f64 / 1e9).abs() < 1e-9 + frequency * 1e-12);

    // Equal windows, half a turn apart, rounded down by less than two ticks.
    prop_assert_eq!(windows.a.length, windows.b.length);
    let width = f64::from(windows.a.length) / (f64::from(windows.period) / 2.0);
    let asked_width = f64::from(drive.pulse_width_ppm) / 1e6;
    prop_assert!(width <= asked_width + 1e-12 && width > asked_width - 2.0 * 2.0 / f64::from(windows.period));
    let centre = |window: era_shared::waveform::Window| (window.start + window.length / 2) % windows.period;
    let apart = (centre(windows.b) + windows.period - centre(windows.a)) % windows.period;
    prop_assert_eq!(apart, windows.period / 2);

    // Phase: the time from the start to A's centre, as a part of a turn, is minus the phase.
    let to_a = (centre(windows.a) + windows.period - u32::from(planned.timer.start_count)) % windows.period;
    let phase = 1.0 - f64::from(to_a) / f64::from(windows.period);
    let asked_phase = f64::from(drive.phase_microturns) / 1e6;
    let difference = (phase - asked_phase + 1.5).rem_euclid(1.0) - 0.5;
    prop_assert!(difference.abs() <= 0.51 / f64::from(windows.period) + 1e-12, "phase {phase} for {asked_phase}");
    let reported = f64::from(planned.achieved.phase_microturns) / 1e6;
    prop_assert!(((reported - phase + 1.5).rem_euclid(1.0) - 0.5).abs() < 1e-6);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

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
        if program(&limits(), &drive).is_ok() {
            check_edges(&drive)?;
        }
    }

    /// Registers with random bits never panic, and if both electrodes overlap the model says so at some tick.
    #[test]
    fn any_registers_are_understood(cr1: u32, ccmr1: u32, ccer: u32, psc in 0_u32..4, arr in 0_u32..60, ccr1 in 0_u32..70, ccr2 in 0_u32..70) {
        let registers = TimerRegisters { cr1: cr1 | 0x21, ccmr1, ccer, psc, arr, ccr1, ccr2, bdtr: 1 << 15 };
        if let Ok(windows) = Windows::from_registers(&registers) {
            let both = (0..windows.period).filter(|tick| windows.on_at(*tick).is_err()).count();
            prop_assert_eq!(both as u32, windows.overlap());
        }
    }
}

#[test]
fn every_boundary_frequency() {
    for frequency_millihertz in
        (1_000..=1_000_000).step_by(997).chain([1_000, 1_001, 19_999, 20_000, 999_999, 1_000_000])
    {
        let drive = ChannelDrive {
            frequency_millihertz,
            pulse_width_ppm: 300_000,
            phase_microturns: 499_999,
            ..support::drive(0)
        };
        check_edges(&drive).unwrap();
    }
}

#[test]
fn the_counter_follows_the_reference_manual() {
    // Counting up and down as RM0440 28.3.11 says, tick by tick, for a small timer.
    for (swapped, arr, low) in [(false, 20_u32, 6_u32), (true, 20, 6), (false, 7, 3), (true, 9, 1)] {
        let high = arr - low;
        let (compare_a, compare_b) = if swapped { (high, low) } else { (low, high) };
        let registers = TimerRegisters {
            cr1: 1 | 1 << 5,
            ccmr1: TimerRegisters::ccmr1_for(swapped),
            ccer: 0x11,
            psc: 0,
            arr,
            ccr1: compare_a,
            ccr2: compare_b,
            bdtr: 1 << 15,
        };
        let windows = Windows::from_registers(&registers).unwrap();
        for tick in 0..2 * arr {
            let (count, up) = if tick < arr { (tick, true) } else { (2 * arr - tick, false) };
            let below = |compare: u32| if up { count < compare } else { count <= compare };
            let (a, b) =
                if swapped { (!below(compare_a), below(compare_b)) } else { (below(compare_a), !below(compare_b)) };
            let expected = match (a, b) {
                (true, false) => Some(Electrode::A),
                (false, true) => Some(Electrode::B),
                (false, false) => None,
                (true, true) => panic!("overlap at {tick}"),
            };
            assert_eq!(windows.on_at(tick), Ok(expected), "tick {tick}, swapped {swapped}");
        }
    }
}

#[test]
fn each_way_to_be_out_of_range_has_its_error() {
    let good = support::drive(0);
    let fails = |drive: ChannelDrive| program(&limits(), &drive).unwrap_err();
    assert!(program(&limits(), &good).is_ok());
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
    let slow_clock = era_shared::protocol::ChannelLimits { timer_clock_hz: 1_000, ..limits() };
    assert!(matches!(program(&slow_clock, &good), Err(DriveError::NotRepresentable { timer_clock_hz: 1_000 })));
}

#[test]
fn a_stopped_timer_energises_nothing_and_other_modes_are_refused() {
    let planned = program(&limits(), &support::drive(0)).unwrap();
    let running = TimerRegisters::running(&planned.timer);
    let off = Windows::from_registers(&TimerRegisters { bdtr: 0, ..running }).unwrap();
    assert_eq!((off.a.length, off.b.length, off.guard()), (0, 0, None));
    assert_eq!(Windows::from_registers(&TimerRegisters { cr1: 1, ..running }), Err(WindowsError::NotCentreAligned));
    assert_eq!(Windows::from_registers(&TimerRegisters { ccer: 0x13, ..running }), Err(WindowsError::Polarity));
    assert_eq!(Windows::from_registers(&TimerRegisters { ccmr1: 0, ..running }), Err(WindowsError::Mode(Electrode::A)));
}

#[test]
fn the_rail_is_rounded_down() {
    for voltage_millivolts in (0..=2_000_000).step_by(1_237) {
        let planned = program(&limits(), &ChannelDrive { voltage_millivolts, ..support::drive(0) }).unwrap();
        let achieved = planned.achieved.voltage_millivolts;
        assert!(achieved <= voltage_millivolts && voltage_millivolts - achieved <= 2_000_000 / 4095 + 1);
        assert!(planned.rail_code <= 4095);
    }
}
