//! The device over a board that remembers: what each request does, and what can never happen.

mod support;

use era_shared::link::{Kind, MAX_ENCODED, encode};
use era_shared::protocol::*;
use era_shared::safety::{Event, State};
use heapless::Vec as Short;
use proptest::prelude::*;
use support::{Bench, Did, drive};

fn both() -> Request {
    Request::SetDrives { drives: Short::from_slice(&[drive(0), drive(1)]).unwrap() }
}

fn arm() -> Request {
    Request::Arm { deadman_ms: None }
}

#[test]
fn a_session_from_hello_to_disarm() {
    let mut bench = Bench::new();
    assert_eq!(bench.board.log, [Did::Off], "off at boot, before anything else");
    let Reply::Hello(hello) = bench.ask(&Request::Hello { host_min: 1, host_current: 1 }) else { panic!() };
    assert_eq!((hello.protocol_min, hello.protocol_current, hello.channels.len()), (1, 1, 2));
    assert_eq!(bench.ask(&arm()), Reply::Armed { deadman_ms: 250 });
    let Reply::DrivesSet { achieved } = bench.ask(&both()) else { panic!() };
    assert_eq!(achieved.len(), 2);
    assert_eq!(bench.state(), State::Running);
    assert_eq!(bench.ask(&Request::SetDrives { drives: Short::new() }), Reply::DrivesSet { achieved: Short::new() });
    assert_eq!(bench.state(), State::Armed);
    assert_eq!(bench.ask(&Request::Disarm), Reply::Disarmed);
    assert!(!bench.board.live);
    assert_eq!(bench.state(), State::Safe);
}

#[test]
fn nothing_is_driven_before_arming() {
    let mut bench = Bench::new();
    let refusal = Refusal::State { state: State::Safe, event: Event::Drive };
    assert_eq!(bench.ask(&both()), Reply::Refused(refusal));
    assert_eq!(bench.board.log, [Did::Off]);
}

#[test]
fn drives_are_set_all_or_none() {
    let mut bench = Bench::new();
    bench.ask(&arm());
    bench.ask(&both());
    let before = bench.board.programs;
    let bad = ChannelDrive { frequency_millihertz: 2_000_000, ..drive(1) };
    let request = Request::SetDrives { drives: Short::from_slice(&[drive(0), bad]).unwrap() };
    let Reply::Refused(Refusal::Drive { channel: 1, .. }) = bench.ask(&request) else { panic!() };
    assert_eq!(bench.board.programs, before, "the first channel was left as it was");
    let twice = Request::SetDrives { drives: Short::from_slice(&[drive(0), drive(0)]).unwrap() };
    assert_eq!(bench.ask(&twice), Reply::Refused(Refusal::DuplicateChannel { channel: 0 }));
    let third = Request::SetDrives { drives: Short::from_slice(&[drive(2)]).unwrap() };
    assert!(matches!(bench.ask(&third), Reply::Refused(Refusal::Drive { channel: 2, .. })));
    let one = Request::SetDrives { drives: Short::from_slice(&[drive(1)]).unwrap() };
    bench.ask(&one);
    assert!(bench.board.programs[0].is_none() && bench.board.programs[1].is_some(), "a channel not named is off");
}

#[test]
fn silence_switches_off_and_is_latched() {
    let mut bench = Bench::new();
    bench.ask(&arm());
    bench.ask(&both());
    for _ in 0..20 {
        bench.wait_ms(100);
        assert_eq!(bench.ask(&Request::KeepAlive), Reply::Alive { state: State::Running });
    }
    bench.wait_ms(249);
    assert_eq!(bench.state(), State::Running);
    bench.wait_ms(1);
    assert_eq!(bench.state(), State::Fault);
    assert!(!bench.board.live);
    let Reply::Faults { latched: Some(fault) } = bench.ask(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.detail), (FaultCode::HostSilent, 250));
    assert!(matches!(bench.ask(&arm()), Reply::Refused(Refusal::State { state: State::Fault, .. })));
    assert_eq!(bench.ask(&Request::ClearFaults), Reply::FaultsCleared);
    assert_eq!(bench.ask(&arm()), Reply::Armed { deadman_ms: 250 });
}

#[test]
fn a_late_keep_alive_does_not_revive() {
    let mut bench = Bench::new();
    bench.ask(&arm());
    bench.ask(&both());
    bench.board.now_us += 300_000; // no poll in between: the firmware's task was late
    assert_eq!(bench.ask(&Request::KeepAlive), Reply::Alive { state: State::Fault });
    assert!(!bench.board.live);
}

#[test]
fn another_link_may_stop_but_not_drive_nor_keep_alive() {
    let mut bench = Bench::new();
    bench.ask(&arm());
    bench.ask(&both());
    assert_eq!(bench.ask_on(1, &both()), Reply::Refused(Refusal::OtherLink));
    assert_eq!(bench.ask_on(1, &arm()), Reply::Refused(Refusal::OtherLink));
    bench.wait_ms(200);
    bench.ask_on(1, &Request::KeepAlive);
    bench.wait_ms(50);
    assert_eq!(bench.state(), State::Fault, "link 1 does not keep link 0's session alive");
    bench.ask(&Request::ClearFaults);
    bench.ask(&arm());
    bench.ask(&both());
    assert_eq!(bench.ask_on(1, &Request::Stop), Reply::Stopped);
    assert!(!bench.board.live);
}

#[test]
fn failing_hardware_ends_off_with_the_reason() {
    let mut bench = Bench::new();
    bench.board.fail_arm = true;
    let Reply::Refused(Refusal::Fault(fault)) = bench.ask(&arm()) else { panic!() };
    assert_eq!(fault.code, FaultCode::ArmFailed);
    assert_eq!(bench.board.log.last(), Some(&Did::Off));
    bench.board.fail_arm = false;
    bench.board.fail_apply = true;
    bench.ask(&Request::ClearFaults);
    bench.ask(&arm());
    let Reply::Refused(Refusal::Fault(fault)) = bench.ask(&both()) else { panic!() };
    assert_eq!(fault.code, FaultCode::DriveFailed);
    assert_eq!((bench.state(), bench.board.live), (State::Fault, false));
}

#[test]
fn a_fault_from_before_the_reset_is_told() {
    let mut bench = Bench::new();
    bench.board.info.fault_before_reset = Some((FaultCode::Panic, 77));
    bench.device = era_shared::device::Device::new();
    bench.device.start(&mut bench.board);
    assert_eq!(bench.state(), State::Fault);
    let Reply::Faults { latched: Some(fault) } = bench.ask(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.detail), (FaultCode::Panic, 77));
}

#[test]
fn a_foreign_version_is_told_both_versions() {
    let mut bench = Bench::new();
    for (got, answered_in) in [(0_u8, MIN_VERSION), (CURRENT_VERSION + 1, CURRENT_VERSION), (255, CURRENT_VERSION)] {
        let mut frame = [0; MAX_ENCODED];
        let length = encode(got, Kind::Request, 5, &Request::Status, &mut frame).unwrap();
        let (version, sequence, reply) = support::decode_reply(&bench.raw(0, &frame[..length]));
        assert_eq!((version, sequence), (answered_in, 5));
        let refusal = Refusal::Version { got, device_min: MIN_VERSION, device_current: CURRENT_VERSION };
        assert_eq!(reply, Reply::Refused(refusal));
    }
}

#[test]
fn replies_are_not_answered_and_nonsense_is_refused() {
    let mut bench = Bench::new();
    let mut frame = [0; MAX_ENCODED];
    let length = encode(1, Kind::Reply, 5, &Reply::Stopped, &mut frame).unwrap();
    assert!(bench.raw(0, &frame[..length]).is_empty());
    let length = encode(1, Kind::Request, 6, &[0xFF_u8, 0xFF, 0xFF], &mut frame).unwrap();
    assert_eq!(support::decode_reply(&bench.raw(0, &frame[..length])).2, Reply::Refused(Refusal::Malformed));
    assert!(bench.raw(0, b"no frame at all\0").is_empty());
    let Reply::Status(status) = bench.ask(&Request::Status) else { panic!() };
    assert_eq!((status.link.bad_frames, status.link.refused), (1, 1));
}

#[test]
fn deadman_times_have_limits() {
    let mut bench = Bench::new();
    for requested_ms in [0, 49, 1001, u16::MAX] {
        let reply = bench.ask(&Request::Arm { deadman_ms: Some(requested_ms) });
        assert_eq!(reply, Reply::Refused(Refusal::Deadman { requested_ms, min_ms: 50, max_ms: 1000 }));
    }
    assert_eq!(bench.ask(&Request::Arm { deadman_ms: Some(50) }), Reply::Armed { deadman_ms: 50 });
    bench.wait_ms(50);
    assert_eq!(bench.state(), State::Fault);
}

fn any_request() -> impl Strategy<Value = Request> {
    let channel = (0_u8..6, any::<u32>(), any::<u32>(), any::<u32>(), any::<u32>(), any::<bool>());
    let channel = channel.prop_map(|(channel, f, p, phase, v, good)| {
        if good {
            return drive(channel % 3);
        }
        ChannelDrive {
            channel,
            frequency_millihertz: f,
            pulse_width_ppm: p,
            phase_microturns: phase,
            voltage_millivolts: v,
        }
    });
    prop_oneof![
        Just(Request::Hello { host_min: 1, host_current: 1 }),
        prop::option::of(any::<u16>()).prop_map(|deadman_ms| Request::Arm { deadman_ms }),
        Just(arm()),
        Just(Request::Disarm),
        prop::collection::vec(channel, 0..=4)
            .prop_map(|drives| Request::SetDrives { drives: Short::from_slice(&drives).unwrap() }),
        Just(both()),
        Just(Request::Stop),
        Just(Request::KeepAlive),
        Just(Request::Status),
        Just(Request::Faults),
        Just(Request::ClearFaults),
        Just(Request::Telemetry),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    /// Whatever the hosts on two links do and however long they wait: high voltage only in a live state, drives only while
    /// running, and every request has an answer (the fake board itself asserts that drives are applied only when armed).
    #[test]
    fn no_history_leaves_it_live_when_it_should_be_off(steps in prop::collection::vec((any_request(), 0_usize..2, 0_u64..120), 1..60)) {
        let mut bench = Bench::new();
        for (request, link, wait_ms) in steps {
            bench.ask_on(link, &request);
            bench.wait_ms(wait_ms);
            let driving = bench.board.programs.iter().any(Option::is_some);
            prop_assert_eq!(bench.board.live, bench.state().is_live());
            prop_assert_eq!(driving, bench.state() == State::Running);
        }
    }

    /// Garbage between frames changes nothing but the counters.
    #[test]
    fn garbage_changes_no_state(garbage in prop::collection::vec(any::<u8>(), 0..600)) {
        let mut bench = Bench::new();
        bench.ask(&arm());
        bench.ask(&both());
        bench.raw(0, &garbage);
        bench.raw(0, &[0]);
        let Reply::Status(status) = bench.ask(&Request::Status) else { panic!() };
        prop_assert_eq!(status.state, State::Running);
    }
}
