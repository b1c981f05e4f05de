//! Faults that the board finds in itself.

mod support;

use era_shared::protocol::{FaultCode, Refusal, Reply, Request};
use era_shared::safety::SafetyState;
use support::Bench;

/// What the board finds wrong with itself is a fault in every state, and stays one for as long as it is there.
#[test]
fn a_fault_of_the_board_itself_lasts_as_long_as_it_is_there() {
    for is_live in [false, true] {
        let mut bench = Bench::new();
        if is_live {
            bench.arm_and_await_armed();
        }
        bench.board.standing_fault = Some((FaultCode::Permit, 2));
        bench.wait_ms(20);
        let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
        assert_eq!((fault.code, fault.detail, fault.count), (FaultCode::Permit, 2, 1), "told once");
        assert!(!bench.board.is_live());
        assert_eq!(bench.send_request(&Request::ClearFaults), Reply::Refused(Refusal::StillThere(FaultCode::Permit)));
        bench.board.standing_fault = None;
        assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
        bench.wait_ms(30);
        assert_eq!(bench.state(), SafetyState::Safe);
    }
    // A fault of something else is not cleared either while it is there.
    let mut bench = Bench::new();
    bench.board.trip = Some((FaultCode::OverCurrent, 0));
    bench.wait_ms(2);
    bench.board.standing_fault = Some((FaultCode::Permit, 1));
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::Refused(Refusal::StillThere(FaultCode::Permit)));
}

/// A loop that is not closed tells its level, in the self-test and while the board is live.
#[test]
fn a_loop_that_is_not_closed_reports_its_level() {
    type Open = fn(&mut support::FakeBoard);
    let loops: [(Open, FaultCode, u32); 2] = [
        (|board| board.interlock_closed = false, FaultCode::InterlockOpen, 3_300),
        (|board| board.stop_released = false, FaultCode::EmergencyStop, 1_900),
    ];
    for (open, code, millivolts) in loops {
        for is_live in [false, true] {
            let mut bench = Bench::new();
            if is_live {
                bench.arm_and_await_armed();
            }
            bench.board.loop_millivolts = [3_300, 1_900];
            open(&mut bench.board);
            bench.send_request(&support::make_arm_request());
            bench.wait_ms(2);
            let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
            assert_eq!((fault.code, fault.detail), (code, millivolts));
        }
    }
}

/// A tick that lies further ahead than one tick is due at once. A clock that is put back makes one, as a bit of the memory would that changes.
#[test]
fn a_tick_that_is_far_ahead_is_due() {
    const FAR_US: u64 = 1 << 40;
    let mut bench = Bench::new();
    bench.board.now_us += FAR_US;
    bench.wait_ms(2);
    bench.board.now_us -= FAR_US;
    bench.board.standing_fault = Some((FaultCode::Permit, 1));
    bench.wait_ms(1);
    assert_eq!(bench.state(), SafetyState::Fault);
}

/// Only the checks of a ms are a sign of life: looking again before the next ones are due is none.
#[test]
fn a_device_that_checks_nothing_gives_no_sign_of_life() {
    let mut bench = Bench::new();
    assert!(bench.device.take_tick_done());
    assert!(!bench.device.take_tick_done(), "told once");
    for _ in 0..3 {
        bench.device.do_due_work_and_tell_next_due_us(&mut bench.board);
        assert!(!bench.device.take_tick_done(), "nothing was due");
    }
    bench.board.now_us += 1_000;
    bench.device.do_due_work_and_tell_next_due_us(&mut bench.board);
    assert!(bench.device.take_tick_done());
}
