//! The rails under the device: rise, set-points, what is measured of them, discharge, and when they are called safe.

mod support;

use era_shared::circuit::SUPPLY_TIME_CONSTANT_MICROSECONDS;
use era_shared::protocol::*;
use era_shared::safety::SafetyState;
use heapless::Vec as Short;
use support::{Bench, make_arm_request, make_drive, make_two_drives_request};

#[test]
fn safe_is_only_said_of_rails_that_were_measured() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    bench.wait_ms(60);
    bench.board.rails_show = [Some(900_000), None];
    bench.send_request(&Request::Stop);
    for left in (61..900).rev().step_by(80) {
        bench.board.rails_show = [Some(left * 1000), None];
        bench.wait_ms(1);
        assert_eq!(bench.state(), SafetyState::Discharging, "{left} V are left");
    }
    bench.board.rails_show = [Some(59_999), None];
    bench.wait_ms(1);
    assert_eq!(bench.state(), SafetyState::Safe);
    // And if it never falls, that is a fault, which cannot be cleared while it lasts.
    bench.board.rails_show = [None; 2];
    bench.arm_and_await_armed();
    bench.board.rails_show = [None, Some(150_000)];
    bench.send_request(&Request::Disarm);
    bench.wait_ms(14);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!(
        (fault.code, fault.detail, fault.count),
        (FaultCode::DischargeSlow, 20_150, 1),
        "the switch is too slow"
    );
    bench.wait_ms(1_000);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.count), (FaultCode::DischargeSlow, 2), "and nothing else discharges it either");
    assert_eq!(
        bench.send_request(&Request::ClearFaults),
        Reply::Refused(Refusal::StillThere(FaultCode::DischargeSlow))
    );
    bench.board.rails_show = [None; 2];
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
    bench.wait_ms(1);
    assert_eq!(bench.state(), SafetyState::Safe);
    // A rail that charges by itself is noticed too.
    bench.board.rails_show = [Some(70_000), None];
    bench.wait_ms(1);
    assert_eq!(bench.state(), SafetyState::Fault);
}

#[test]
fn a_rail_that_stays_charged_is_reported_whatever_came_first() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    bench.wait_ms(60);
    // The enclosure is opened and the discharge fails.
    bench.board.rails_show = [Some(900_000), None];
    bench.board.interlock_closed = false;
    bench.wait_ms(1_100);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!(
        (fault.code, fault.count),
        (FaultCode::InterlockOpen, 3),
        "the first reason is kept, a slow discharge and one that failed are counted"
    );
    bench.board.interlock_closed = true;
    assert_eq!(
        bench.send_request(&Request::ClearFaults),
        Reply::Refused(Refusal::StillThere(FaultCode::DischargeFailed))
    );
    bench.board.rails_show = [None; 2];
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
}

#[test]
fn asking_again_does_not_give_the_discharge_more_time() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.board.rails_show = [Some(900_000), None];
    for _ in 0..3 {
        bench.send_request(&Request::Stop);
        bench.wait_ms(400);
    }
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.count), (FaultCode::DischargeSlow, 2));
    let go = Request::Bootloader { key: BOOTLOADER_KEY };
    assert_eq!(
        bench.send_request(&go),
        Reply::Refused(Refusal::Live(SafetyState::Fault)),
        "no bootloader while charged"
    );
}

/// After a fault that says that rails may be measured wrongly, by its number as docs/src/safety.md has it, a rail that reads nothing is not safe
/// before its bleeder has had its time; after any other it is.
#[test]
fn faults_that_cast_doubt_on_the_measurement_are_waited_for() {
    const DOUBTFUL: [u8; 7] = [7, 11, 12, 13, 15, 19, 21];
    for code in FaultCode::ALL {
        let mut bench = Bench::new();
        bench.arm_and_await_armed();
        bench.wait_ms(20);
        let now_us = bench.board.now_us;
        bench.device.switch_all_off_and_latch_fault(&mut bench.board, code, 0, now_us);
        bench.wait_ms(100);
        assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared, "{code:?}");
        bench.wait_ms(2);
        let is_doubtful = DOUBTFUL.contains(&code.number());
        assert_eq!(bench.state() == SafetyState::Discharging, is_doubtful, "{code:?}: {:?}", bench.state());
    }
}

/// A broken divider shows nothing of a rail that is charged. Whatever is done in which order, the rail counts as charged until a bleeder
/// alone would have discharged it: 2.26 nF and 100 Mohm, from 2 kV to 60 V and with 20 % of tolerance, take 0.95 s.
#[test]
fn a_measurement_that_was_wrong_does_not_call_a_rail_safe() {
    let broken = || {
        let mut bench = Bench::new();
        bench.arm_and_await_armed();
        bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: None });
        bench.send_request(&make_two_drives_request());
        bench.wait_ms(60);
        bench.board.rails_show = [Some(0), None];
        bench
    };
    let is_safe_after_bleeding = |bench: &mut Bench| {
        bench.wait_ms(920);
        assert_eq!(bench.state(), SafetyState::Discharging, "the bleeder has not had its time");
        bench.wait_ms(40);
        assert_eq!(bench.state(), SafetyState::Safe);
    };
    // Noticed as a fault.
    let mut bench = broken();
    bench.wait_ms(15);
    assert_eq!(bench.state(), SafetyState::Fault);
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
    is_safe_after_bleeding(&mut bench);
    // Stopped before it was noticed: no rail falls from 1 kV to nothing within a ms.
    let mut bench = broken();
    assert_eq!(bench.send_request(&Request::Stop), Reply::Stopped);
    is_safe_after_bleeding(&mut bench);
    // Nor does the board leave for its bootloader, where nothing measures or discharges.
    let mut bench = broken();
    bench.wait_ms(200);
    assert_eq!(bench.state(), SafetyState::Fault);
    let go = Request::Bootloader { key: BOOTLOADER_KEY };
    assert_eq!(bench.send_request(&go), Reply::Refused(Refusal::Live(SafetyState::Fault)));
    bench.wait_ms(800);
    assert_eq!(bench.send_request(&go), Reply::Bootloader);
    // Stopped while the rail was still far above a new, low set-point.
    let mut bench = broken();
    bench.board.rails_show = [None; 2];
    bench.wait_ms(5);
    let low = [ChannelDrive { voltage_millivolts: 60_000, ..make_drive(0) }];
    bench.send_request(&Request::SetDrives { drives: Short::from_slice(&low).unwrap() });
    bench.board.rails_show = [Some(0), None];
    assert_eq!(bench.send_request(&Request::Stop), Reply::Stopped);
    is_safe_after_bleeding(&mut bench);
    // The same with the set-point down already, so that only what was measured tells of the charge.
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: None });
    let high = [ChannelDrive { voltage_millivolts: 2_000_000, ..make_drive(0) }];
    bench.send_request(&Request::SetDrives { drives: Short::from_slice(&high).unwrap() });
    bench.wait_ms(150);
    bench.send_request(&Request::SetDrives { drives: Short::from_slice(&low).unwrap() });
    bench.wait_ms(2);
    bench.board.rails_show = [Some(0), None];
    assert_eq!(bench.send_request(&Request::Stop), Reply::Stopped);
    is_safe_after_bleeding(&mut bench);
    // Reset instead of waited for: the next run knows of it, and the bleeder has its time from there.
    let mut bench = broken();
    bench.send_request(&Request::Stop);
    bench.wait_ms(2);
    let kept = bench.board.kept;
    assert!(kept.is_some_and(|run| run.is_measurement_distrusted && !run.is_live), "{kept:?}");
    bench.board.info.kept_before_reset = kept;
    bench.device = era_shared::device::Device::new();
    bench.device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut bench.board);
    is_safe_after_bleeding(&mut bench);
    assert!(bench.board.kept.is_some_and(|run| !run.is_measurement_distrusted), "the next start is a sound one");
    // Armed again instead of waited for.
    let mut bench = broken();
    bench.send_request(&Request::Stop);
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: None });
    bench.wait_ms(930);
    assert_eq!(bench.state(), SafetyState::Arming);
    assert!(
        !bench.board.supply.is_enabled_or_any_discharge_open(),
        "nothing is charged before the bleeder has had its time"
    );
    bench.send_request(&Request::KeepAlive);
    bench.wait_ms(200);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.detail), (FaultCode::ShortCircuit, 1), "and rail 1 never shows its test voltage");
    // A divider that shows too little, at a rail of too low a voltage for an arc to be told.
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&Request::SetDrives {
        drives: Short::from_slice(&[ChannelDrive { voltage_millivolts: 150_000, ..make_drive(0) }]).unwrap(),
    });
    bench.wait_ms(60);
    bench.board.rails_show = [Some(20_000), None];
    bench.wait_ms(10);
    assert_eq!(bench.send_request(&Request::Stop), Reply::Stopped);
    is_safe_after_bleeding(&mut bench);
}

/// A supply as slow as it may be feeds both rails against their closed discharge switches when their set-points are lowered: up to 2 mA each,
/// beside what the drives take. That is no over-current.
#[test]
fn lowering_both_rails_is_no_over_current() {
    for follow_us in [500.0, 1_000.0, f64::from(SUPPLY_TIME_CONSTANT_MICROSECONDS)] {
        for volts in [1_900, 1_850, 1_800, 1_500, 1_000, 500, 200] {
            let drives = |volts: u32| {
                let drive = |channel| ChannelDrive { voltage_millivolts: volts * 1_000, ..make_drive(channel) };
                Request::SetDrives { drives: (0..4).map(drive).collect() }
            };
            let mut bench = Bench::new();
            bench.board.circuit.parts.follow_us = follow_us;
            bench.arm_and_await_armed();
            for (volts, ms) in [(2_000, 200), (volts, 60), (2_000, 200)] {
                let reply = bench.send_request(&drives(volts));
                assert!(matches!(reply, Reply::DrivesSet { .. }), "{reply:?}");
                for _ in 0..ms / 10 {
                    bench.wait_ms(10);
                    bench.send_request(&Request::KeepAlive);
                }
                let Reply::Faults { latched } = bench.send_request(&Request::Faults) else { panic!() };
                assert_eq!(latched, None, "{volts} V, {follow_us} us");
            }
        }
    }
}

/// Whoever opens the enclosure is told of rails that stay charged, although the interlock was noticed first.
#[test]
fn another_fault_does_not_hide_a_dead_discharge_switch() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let drive = ChannelDrive { voltage_millivolts: 1_000_000, ..make_drive(0) };
    bench.send_request(&Request::SetDrives { drives: Short::from_slice(&[drive]).unwrap() });
    bench.wait_ms(80);
    bench.board.circuit.dead_discharge = true;
    bench.board.trip = Some((FaultCode::EmergencyStop, 0));
    bench.wait_ms(40);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.count), (FaultCode::EmergencyStop, 2), "the slow discharge is counted");
    assert_eq!(
        bench.send_request(&Request::ClearFaults),
        Reply::Refused(Refusal::StillThere(FaultCode::DischargeSlow))
    );
    // The bleeders need a second or less.
    bench.wait_ms(900);
    assert!(bench.board.circuit.rails[0] < 60_000.0, "{:?}", bench.board.circuit.rails);
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
}

/// A dead discharge switch is noticed at the first stop and at the next arming, although the bleeders discharge the rails within the
/// second that is allowed.
#[test]
fn a_dead_discharge_switch_is_a_fault() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    bench.wait_ms(60);
    bench.board.circuit.dead_discharge = true;
    bench.send_request(&Request::Stop);
    bench.wait_ms(15);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!(fault.code, FaultCode::DischargeSlow);
    assert!(!bench.board.is_live());
    bench.wait_ms(1_000);
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
    bench.wait_ms(1_000);
    assert_eq!(bench.state(), SafetyState::Safe, "the bleeders have done it");
    bench.send_request(&make_arm_request());
    bench.wait_ms(60);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!(fault.code, FaultCode::DischargeSlow, "no arming with a dead switch");
}

/// A rail that is too high is no excuse for itself: 500 V set and 2000 V shown end within 50 ms, and so does a rail that is right in one ms of 40.
#[test]
fn a_wrong_rail_is_noticed_in_time() {
    let low = || Request::SetDrives {
        drives: Short::from_slice(&[ChannelDrive { voltage_millivolts: 500_000, ..make_drive(0) }]).unwrap(),
    };
    let live = || {
        let mut bench = Bench::new();
        bench.arm_and_await_armed();
        bench.send_request(&low());
        bench.wait_ms(60);
        assert_eq!(bench.state(), SafetyState::Running);
        bench
    };
    let mut bench = live();
    bench.board.rails_show = [Some(2_000_000), None];
    bench.wait_ms(50);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.detail), (FaultCode::DischargeSlow, 12_000));
    // Shown too low, with one good ms in 40.
    let mut bench = live();
    for ms in 0..100 {
        bench.board.rails_show = [(ms % 40 != 39).then_some(440_000), None];
        bench.wait_ms(1);
        bench.send_request(&Request::KeepAlive);
    }
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!(fault.code, FaultCode::RailImplausible);
    // One bad ms in 40 is none.
    let mut bench = live();
    for ms in 0..1_000 {
        bench.board.rails_show = [(ms % 40 == 39).then_some(440_000), None];
        bench.wait_ms(1);
        bench.send_request(&Request::KeepAlive);
    }
    assert_eq!(bench.state(), SafetyState::Running);
}

/// A measurement that is wrong in three or more of ten ms is found, in whatever rhythm it comes and goes, too low and too high; one that is
/// wrong in one of nine is not. Each wrong ms counts, and each right one takes a quarter of a ms back.
#[test]
fn a_measurement_that_comes_and_goes_is_noticed() {
    let find_fault = |wrong_ms: u64, period_ms: u64, shown_millivolts: u32, longest_ms: u64| {
        let mut bench = Bench::new();
        bench.arm_and_await_armed();
        let low = ChannelDrive { voltage_millivolts: 500_000, ..make_drive(0) };
        bench.send_request(&Request::SetDrives { drives: Short::from_slice(&[low]).unwrap() });
        bench.wait_ms(60);
        for ms in 0..longest_ms {
            bench.board.rails_show = [(ms % period_ms < wrong_ms).then_some(shown_millivolts), None];
            bench.wait_ms(1);
            bench.send_request(&Request::KeepAlive);
        }
        let Reply::Faults { latched } = bench.send_request(&Request::Faults) else { panic!() };
        latched.map(|fault| fault.code)
    };
    for period_ms in 2_u64..=20 {
        for wrong_ms in (3 * period_ms).div_ceil(10)..period_ms {
            let counted_per_ms = (5.0 * wrong_ms as f64 / period_ms as f64 - 1.0) / 4.0;
            let longest_ms = (50.0 / counted_per_ms).ceil() as u64 + period_ms;
            let found = find_fault(wrong_ms, period_ms, 440_000, longest_ms);
            assert_eq!(found, Some(FaultCode::RailImplausible), "{wrong_ms} of {period_ms} ms too low");
            let found = find_fault(wrong_ms, period_ms, 570_000, 1_500);
            let possible = [FaultCode::RailImplausible, FaultCode::DischargeSlow, FaultCode::RailCollapsed];
            assert!(
                found.is_some_and(|code| possible.contains(&code)),
                "{wrong_ms} of {period_ms} ms too high: {found:?}"
            );
        }
    }
    assert_eq!(find_fault(1, 9, 440_000, 1_500), None);
}

#[test]
fn the_rails_start_softly_and_serve_two_voltages() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let low = ChannelDrive { voltage_millivolts: 500_000, ..make_drive(2) };
    bench.send_request(&Request::SetDrives { drives: Short::from_slice(&[make_drive(0), low]).unwrap() });
    let mut last = [50_000; 2];
    for _ in 0..48 {
        bench.wait_ms(1);
        let now = bench.board.supply.set_point_millivolts;
        assert!(now[0] <= last[0] + 20_000, "{now:?} after {last:?}");
        last = now;
    }
    assert!(last[0] >= 999_000 && last[1] == 50_000, "rail 2 feeds nobody: {last:?}");
    let width = |channel: usize| {
        let period = bench.board.find_latest_period(channel);
        f64::from(period.a.off - period.a.on) / f64::from(period.ticks)
    };
    // A quarter of the force: sin(pi w/2), w being twice the part of the period.
    let force = |part: f64| (std::f64::consts::PI * part).sin();
    let ratio = force(width(2)) / force(width(0));
    assert!((ratio - 0.25).abs() < 1e-3, "{ratio}");
}

/// A rail that is measured 5 % above its set-point, as while it is discharged to a lower one, drives no harder: narrower windows make
/// the force of the voltage that was asked for, sin(pi w/2) V^2.
#[test]
fn a_rail_above_its_set_point_makes_no_more_force() {
    let force = |rail_v: f64, bench: &Bench| {
        let period = bench.board.find_latest_period(0);
        let part = f64::from(period.a.off - period.a.on) / f64::from(period.ticks);
        (std::f64::consts::PI * part).sin() * rail_v * rail_v
    };
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&Request::SetDrives { drives: Short::from_slice(&[make_drive(0)]).unwrap() });
    bench.wait_ms(60);
    let asked = force(1_000.0, &bench);
    bench.board.rails_show = [Some(1_050_000), None];
    bench.wait_ms(20);
    assert_eq!(bench.state(), SafetyState::Running);
    let ratio = force(1_050.0, &bench) / asked;
    assert!((ratio - 1.0).abs() < 2e-3, "{ratio}");
}

/// A rail that never showed its test voltage may be charged and measured wrongly: when that fault is cleared, the bleeder still gets its time.
#[test]
fn a_rail_that_did_not_come_up_is_not_believed_to_be_discharged() {
    let mut bench = Bench::new();
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: None });
    bench.board.rails_show = [Some(0), None];
    for ms in 0.. {
        assert!(ms < 100, "no fault");
        bench.wait_ms(1);
        if bench.state() == SafetyState::Fault {
            break;
        }
    }
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.detail), (FaultCode::ShortCircuit, 1));
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
    bench.wait_ms(930);
    assert_eq!(bench.state(), SafetyState::Discharging, "the bleeder has not had its time");
    bench.wait_ms(30);
    assert_eq!(bench.state(), SafetyState::Safe);
}

/// A device that did not look for 50 ms while a rail rises goes on where it was, by 5 ms of its slope of 20 V/ms at most.
#[test]
fn a_late_look_does_not_make_a_rail_jump() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    bench.wait_ms(10);
    let before = bench.board.supply.set_point_millivolts;
    assert!(before[0] > 100_000 && before[0] < 400_000, "{before:?}");
    bench.board.now_us += 50_000;
    bench.device.do_due_work_and_tell_next_due_us(&mut bench.board);
    let after = bench.board.supply.set_point_millivolts;
    for (after, before) in after.into_iter().zip(before) {
        assert!(after > before && after <= before + 100_000, "{after} mV after {before} mV");
    }
    bench.wait_ms(60);
    assert_eq!(bench.state(), SafetyState::Running);
}

/// A rail that is measured too low, within what is tolerated, is charged by its set-point: what drives cost does not depend on the divider.
#[test]
fn a_rail_that_shows_too_little_does_not_save_credit() {
    let left_ms = |shown: Option<u32>| {
        let mut bench = Bench::new();
        bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(10_000) });
        bench.wait_ms(support::ARMING_MS);
        let strong = [ChannelDrive { voltage_millivolts: 1_800_000, pulse_width_ppm: 900_000, ..make_drive(0) }];
        bench.send_request(&Request::SetDrives { drives: Short::from_slice(&strong).unwrap() });
        bench.wait_ms(200);
        bench.board.rails_show = [shown, None];
        for _ in 0..20 {
            bench.wait_ms(100);
            bench.send_request(&Request::KeepAlive);
        }
        assert_eq!(bench.state(), SafetyState::Running);
        let Reply::Credit(credit) = bench.send_request(&Request::Credit) else { panic!() };
        credit.channels[0].left_ms
    };
    let sound = left_ms(None);
    assert!(sound < left_ms_of_idle_board());
    assert!(left_ms(Some(1_750_000)) <= sound);
}

fn left_ms_of_idle_board() -> u32 {
    let Reply::Credit(credit) = Bench::new().send_request(&Request::Credit) else { panic!() };
    credit.channels[0].left_ms
}
