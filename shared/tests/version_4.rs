//! What came with version 4 of the protocol beside windows: numbers of effects and faults, and what outlasts a reset.

mod support;

use era_shared::board::KeptRun;
use era_shared::link::LinkArrival;
use era_shared::protocol::*;
use era_shared::safety::SafetyState;
use era_shared::waveform::Effect;
use heapless::Vec as Short;
use support::{Bench, make_arm_request, make_drive, make_two_drives_request};

/// A repeated request is not played again: 12 ms of a drive stay 12 ms. Another one is played after it, and loses nothing.
#[test]
fn an_effect_is_played_once_and_the_next_after_it() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let prepare = Request::Prepare { drives: Short::from_slice(&[make_drive(0)]).unwrap() };
    bench.send_request(&prepare);
    bench.wait_ms(60);
    let play = |number| Request::PlayOnce { number, channel: 0, start_us: 0, effect: Effect::new_click(2, 2) };
    // Periods in which something is on.
    let driven = |bench: &mut Bench| {
        for _ in 0..20 {
            bench.send_request(&Request::KeepAlive);
            bench.wait_ms(10);
        }
        let own: Vec<_> = bench.board.preloads.iter().filter(|it| it.channel == 0).collect();
        let clocks = own.windows(2).filter(|two| !two[0].period.has_no_windows()).map(|two| two[1].at - two[0].at);
        let clocks: u64 = clocks.sum();
        bench.board.preloads.clear();
        clocks as f64 * 150.0 / 170e6
    };
    assert_eq!(bench.send_request(&play(1)), Reply::Playing);
    bench.wait_ms(1);
    assert_eq!(bench.send_request(&play(1)), Reply::Playing, "its answer was lost");
    let periods = driven(&mut bench);
    assert!((periods - 4.0).abs() < 0.4, "{periods}");
    bench.send_request(&prepare);
    assert_eq!(bench.send_request(&play(2)), Reply::Playing);
    bench.board.now_us += 1_000;
    assert_eq!(bench.send_request(&play(3)), Reply::Playing);
    let periods = driven(&mut bench);
    assert!((periods - 8.0).abs() < 0.4, "two clicks of four periods: {periods}");
}

/// What was played before a stop is not: whoever repeats the request then is not told that it plays.
#[test]
fn a_request_that_is_repeated_after_a_stop_is_not_answered_as_playing() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&Request::Prepare { drives: Short::from_slice(&[make_drive(0)]).unwrap() });
    bench.wait_ms(60);
    let play = Request::PlayOnce { number: 1, channel: 0, start_us: 0, effect: Effect::new_click(2, 2) };
    assert_eq!(bench.send_request(&play), Reply::Playing);
    assert_eq!(bench.send_request(&Request::Stop), Reply::Stopped);
    let answer = bench.send_request(&play);
    assert!(matches!(answer, Reply::Refused(_)), "{answer:?}");
}

/// An effect that is refused is not remembered: whoever repeats the request, because its answer was lost, is not told that it plays.
#[test]
fn a_refused_effect_that_is_repeated_is_refused_again_until_it_plays() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let play = Request::PlayOnce { number: 1, channel: 0, start_us: 0, effect: Effect::new_click(2, 2) };
    for _ in 0..3 {
        assert_eq!(bench.send_request(&play), Reply::Refused(Refusal::NoDrive { channel: 0 }));
    }
    bench.send_request(&Request::Prepare { drives: Short::from_slice(&[make_drive(0)]).unwrap() });
    bench.wait_ms(60);
    bench.board.preloads.clear();
    assert_eq!(bench.send_request(&play), Reply::Playing);
    bench.send_request(&Request::KeepAlive);
    bench.wait_ms(20);
    assert!(bench.board.preloads.iter().any(|it| !it.period.has_no_windows()), "it is played");
}

/// An effect that waits for a drive ends with it: other drives, none at all, or a sequence of windows.
#[test]
fn effects_that_wait_do_not_outlive_their_drives() {
    let prepare = |channels: &[u8]| {
        let drives: Vec<_> = channels.iter().map(|channel| make_drive(*channel)).collect();
        Request::Prepare { drives: Short::from_slice(&drives).unwrap() }
    };
    for between in [prepare(&[]), prepare(&[1]), prepare(&[0])] {
        let mut bench = Bench::new();
        bench.arm_and_await_armed();
        bench.send_request(&prepare(&[0]));
        bench.wait_ms(60);
        let start_us = bench.board.now_us + 200_000;
        let play = Request::PlayOnce { number: 1, channel: 0, start_us, effect: Effect::new_click(3, 0) };
        assert_eq!(bench.send_request(&play), Reply::Playing);
        bench.send_request(&between);
        bench.wait_ms(20);
        bench.send_request(&prepare(&[0]));
        bench.board.preloads.clear();
        for _ in 0..40 {
            bench.send_request(&Request::KeepAlive);
            bench.wait_ms(10);
        }
        assert!(bench.board.now_us > start_us + 100_000 && bench.state().is_live());
        assert!(bench.board.preloads.iter().all(|it| it.period.has_no_windows()), "{between:?}");
    }
}

/// A late request to clear a fault does not clear a newer one.
#[test]
fn a_fault_is_cleared_by_its_number() {
    let mut bench = Bench::new();
    bench.board.trip = Some((FaultCode::OverCurrent, 0));
    bench.wait_ms(1);
    // Faults are counted from the boot id on, which is 7 here.
    let Reply::NumberedFault { number: 8, latched: Some(fault) } = bench.send_request(&Request::NumberedFault) else {
        panic!()
    };
    assert_eq!(fault.code, FaultCode::OverCurrent);
    assert_eq!(bench.send_request(&Request::ClearFault { number: 8 }), Reply::FaultsCleared);
    assert_eq!(bench.send_request(&Request::ClearFault { number: 8 }), Reply::FaultsCleared, "repeated");
    bench.board.trip = Some((FaultCode::EmergencyStop, 0));
    bench.wait_ms(1);
    assert_eq!(
        bench.send_request(&Request::ClearFault { number: 8 }),
        Reply::Refused(Refusal::OtherFault { number: 9 })
    );
    assert_eq!(bench.send_request(&Request::ClearFault { number: 9 }), Reply::FaultsCleared);
}

/// A link that was closed and opened again has another program at its end: the session of the one before is over.
#[test]
fn a_reopened_link_ends_its_session() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    let [first, second] = &mut bench.ports;
    bench.device.handle_received_bytes_or_link_reopening(&mut bench.board, second, &LinkArrival::Reopened, |_| {});
    assert_eq!(bench.device.state(), SafetyState::Running, "another link is nobody's session");
    bench.device.handle_received_bytes_or_link_reopening(&mut bench.board, first, &LinkArrival::Reopened, |_| {});
    assert!(!bench.board.is_live());
    bench.wait_ms(20);
    assert_eq!(bench.state(), SafetyState::Safe, "which is no fault");
}

/// Requests that are refused are no sign that somebody looks after the drive.
#[test]
fn refused_requests_do_not_feed_the_dead_man_timer() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    for _ in 0..3 {
        bench.wait_ms(100);
        let refused = bench.send_request(&Request::Arm { deadman_ms: Some(7) });
        assert!(matches!(refused, Reply::Refused(_)), "{refused:?}");
    }
    assert_eq!(bench.state(), SafetyState::Fault);
}

#[test]
fn the_bootloader_swallows_no_trip_and_nothing_is_armed_on_the_way() {
    let mut bench = Bench::new();
    let go = Request::Bootloader { key: BOOTLOADER_KEY };
    bench.board.trip = Some((FaultCode::OverVoltage, 0));
    assert_eq!(bench.send_request(&go), Reply::Refused(Refusal::StillThere(FaultCode::OverVoltage)));
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!(fault.code, FaultCode::OverVoltage);
    bench.send_request(&Request::ClearFaults);
    bench.wait_ms(1_000);
    assert_eq!(bench.send_request(&go), Reply::Bootloader);
    assert_eq!(bench.send_request(&make_arm_request()), Reply::Refused(Refusal::Restarting));
}

/// Set-points, measurements and trips refer to one supply: if it is wrong, all of them agree with each other. The chip's own reference tells.
#[test]
fn a_wrong_reference_is_a_fault_in_every_state() {
    for millivolts in [3_200, 3_400, 0, u32::MAX] {
        for is_live in [false, true] {
            let mut bench = Bench::new();
            if is_live {
                bench.arm_and_await_armed();
            }
            bench.board.reference_millivolts = millivolts;
            bench.wait_ms(8);
            let Reply::NumberedFault { latched: Some(fault), .. } = bench.send_request(&Request::NumberedFault) else {
                panic!()
            };
            assert_eq!((fault.code, fault.detail), (FaultCode::Reference, millivolts));
            assert!(!bench.board.is_live());
            assert_eq!(
                bench.send_request(&Request::ClearFaults),
                Reply::Refused(Refusal::StillThere(FaultCode::Reference))
            );
            bench.board.reference_millivolts = 3_300;
            bench.wait_ms(40);
            assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
            if is_live {
                // Rails that were measured against a wrong reference are safe when the bleeders have had their 0.95 s.
                bench.wait_ms(800);
                assert_eq!(bench.state(), SafetyState::Discharging);
                bench.wait_ms(150);
                assert_eq!(bench.state(), SafetyState::Safe);
            }
        }
    }
    let mut bench = Bench::new();
    bench.board.reference_millivolts = 3_390;
    bench.wait_ms(100);
    assert_eq!(bench.state(), SafetyState::Safe, "within 3 %");
}

/// A reset gives no channel new credit, and one while the board is live is told.
#[test]
fn credit_and_whether_it_was_live_are_kept_over_a_reset() {
    let mut bench = Bench::new();
    let idle = KeptRun { is_live: false, is_measurement_distrusted: false, credit_ms: [60_000; 4] };
    assert_eq!(bench.board.kept, Some(idle));
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(10_000) });
    bench.wait_ms(support::ARMING_MS);
    assert!(bench.board.kept.is_some_and(|run| run.is_live), "the rails are up, though nothing is driven");
    let strong = ChannelDrive { voltage_millivolts: 2_000_000, ..make_drive(0) };
    bench.send_request(&Request::SetDrives { drives: Short::from_slice(&[strong]).unwrap() });
    for _ in 0..8 {
        bench.wait_ms(500);
        bench.send_request(&Request::KeepAlive);
    }
    let Some(kept @ KeptRun { is_live: true, credit_ms, .. }) = bench.board.kept else {
        panic!("{:?}", bench.board.kept)
    };
    assert!(credit_ms[0] < 59_000 && credit_ms[1] == 60_000, "{credit_ms:?}");
    // As a board starts that finds this record.
    let mut next = Bench::new();
    next.board.info.kept_before_reset = Some(kept);
    next.board.info.fault_before_reset = Some((FaultCode::ResetWhileLive, 0));
    next.board.info.boot_id = 1_000;
    next.device = era_shared::device::Device::new();
    next.device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut next.board);
    let Reply::Credit(credit) = next.send_request(&Request::Credit) else { panic!() };
    assert_eq!(credit.channels[0].left_ms, credit_ms[0]);
    assert_eq!(next.state(), SafetyState::Fault);
    let Reply::NumberedFault { number: 1_001, latched: Some(fault) } = next.send_request(&Request::NumberedFault)
    else {
        panic!()
    };
    assert_eq!(fault.code, FaultCode::ResetWhileLive);
    // A late request of the run before does not clear it.
    assert_eq!(
        next.send_request(&Request::ClearFault { number: 8 }),
        Reply::Refused(Refusal::OtherFault { number: 1_001 })
    );
    bench.send_request(&Request::Stop);
    assert_eq!(bench.board.kept.map(|run| run.is_live), Some(false), "at once, and not a ms later");
}
