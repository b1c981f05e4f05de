//! The device over a board that remembers: what each request does, and what can never happen.

mod support;

use era_shared::link::{FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::*;
use era_shared::safety::{SafetyEvent, SafetyState};
use era_shared::waveform::{Effect, Electrode, SequenceWindow};
use heapless::Vec as Short;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use support::circuit::ElectrodeState;
use support::{Bench, Did, make_arm_request, make_drive, make_two_drives_request};

#[test]
fn a_session_from_hello_to_disarm() {
    let mut bench = Bench::new();
    assert_eq!(bench.board.log, [Did::Off, Did::Off], "off at boot, before anything else, and when found discharged");
    assert_eq!(bench.state(), SafetyState::Safe);
    let Reply::Welcome(hello) = bench.send_request(&Request::Hello { host_min: 1, host_current: 3 }) else { panic!() };
    assert_eq!((hello.protocol_min, hello.protocol_current, hello.channels.len()), (1, 4, 4));
    assert_eq!(bench.send_request(&make_arm_request()), Reply::Armed { deadman_ms: 250 });
    assert_eq!(bench.state(), SafetyState::Arming);
    bench.wait_ms(support::ARMING_MS);
    assert_eq!(bench.state(), SafetyState::Armed);
    let inputs = [[false; 2], [true, false], [true; 2]].map(Did::TestInputs);
    let pulses = [Electrode::A, Electrode::B].into_iter().flat_map(|it| (0..4).map(move |era| Did::Pulse(era, it)));
    let expected: Vec<Did> = [Did::TestTrips].into_iter().chain(inputs).chain(pulses).chain([Did::Start]).collect();
    assert_eq!(bench.board.log[2..], expected);
    // Amid the idle periods of 1 ms: at their boundaries nothing is preloaded.
    bench.board.now_us += 500;
    let Reply::DrivesSet { achieved } = bench.send_request(&make_two_drives_request()) else { panic!() };
    assert_eq!(achieved.len(), 2);
    assert_eq!(bench.state(), SafetyState::Running);
    assert!(
        bench.board.connected
            && !bench.board.find_latest_period(0).has_no_windows()
            && !bench.board.find_latest_period(1).has_no_windows()
    );
    assert_eq!(
        bench.send_request(&Request::SetDrives { drives: Short::new() }),
        Reply::DrivesSet { achieved: Short::new() }
    );
    assert_eq!(bench.state(), SafetyState::Armed);
    bench.wait_ms(20);
    assert!(
        !bench.board.connected && !bench.board.is_any_channel_driven(),
        "electrodes are let go of once they are silent"
    );
    assert_eq!(bench.send_request(&Request::Disarm), Reply::Disarmed);
    assert!(!bench.board.is_live());
    assert_eq!(bench.state(), SafetyState::Discharging);
    bench.wait_ms(support::DISCHARGE_MS);
    assert_eq!(bench.state(), SafetyState::Safe);
}

/// A slow drive goes on to the end of its period, and its electrodes with it: let go of before, a window would be cut short.
#[test]
fn electrodes_are_in_use_until_their_last_period_ends() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let slow = ChannelDrive { frequency_millihertz: 5_000, ..support::make_drive(0) };
    bench.send_request(&Request::SetDrives { drives: Short::from_slice(&[slow]).unwrap() });
    // Into the first of its periods of 200 ms.
    bench.wait_ms(50);
    bench.send_request(&Request::SetDrives { drives: Short::new() });
    assert_eq!(bench.state(), SafetyState::Armed);
    bench.wait_ms(50);
    assert!(
        bench.board.connected && bench.board.find_latest_period(0).has_no_windows(),
        "only what comes next is blank"
    );
    bench.wait_ms(200);
    assert!(!bench.board.connected);
}

/// Four ERAs at 2 kV, by hand: 8 x 116 pF x 2 kV for each cycle and 80 uA of the bleeders are 488 uA at 220 Hz and 507 uA at 230 Hz.
#[test]
fn drives_beyond_the_supply_are_refused_before_they_begin() {
    let four = |hz: u32| {
        let one = |channel| ChannelDrive {
            frequency_millihertz: hz * 1_000,
            voltage_millivolts: 2_000_000,
            ..make_drive(channel)
        };
        Short::<_, 4>::from_slice(&[one(0), one(1), one(2), one(3)]).unwrap()
    };
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let refused = Refusal::Current { requested_microamps: 507, max_microamps: 500 };
    assert_eq!(bench.send_request(&Request::SetDrives { drives: four(230) }), Reply::Refused(refused.clone()));
    assert_eq!(bench.send_request(&Request::Prepare { drives: four(230) }), Reply::Refused(refused));
    assert_eq!(bench.state(), SafetyState::Armed, "nothing has begun");
    assert!(matches!(bench.send_request(&Request::SetDrives { drives: four(220) }), Reply::DrivesSet { .. }));
    assert_eq!(bench.state(), SafetyState::Running);
    // A rail that feeds nobody stays where it is, and its bleeders count: 0.464 uC and 80 uA, 498 uA at 900 Hz and 502 uA at 908 Hz.
    let one = |hz: u32| {
        let own = ChannelDrive {
            frequency_millihertz: hz * 1_000,
            pulse_width_ppm: 500_000,
            voltage_millivolts: 2_000_000,
            ..make_drive(0)
        };
        Request::SetDrives { drives: Short::from_slice(&[own]).unwrap() }
    };
    let Reply::Refused(Refusal::Current { requested_microamps: 502, .. }) = bench.send_request(&one(908)) else {
        panic!()
    };
    assert!(matches!(bench.send_request(&one(900)), Reply::DrivesSet { .. }));
    // To rest is allowed whatever the rails have.
    assert!(matches!(bench.send_request(&Request::SetDrives { drives: Short::new() }), Reply::DrivesSet { .. }));
}

#[test]
fn drives_that_are_set_while_arming_begin_when_it_is_done() {
    let mut bench = Bench::new();
    bench.send_request(&make_arm_request());
    let Reply::DrivesSet { .. } = bench.send_request(&make_two_drives_request()) else { panic!() };
    assert_eq!(bench.state(), SafetyState::Arming);
    assert!(!bench.board.connected);
    bench.wait_ms(support::ARMING_MS);
    assert_eq!(bench.state(), SafetyState::Running);
    assert!(bench.board.connected && !bench.board.find_latest_period(1).has_no_windows());
}

/// What was to be driven after an arming is forgotten with it: whoever arms next drives nothing.
#[test]
fn drives_that_are_set_while_arming_are_forgotten_with_it() {
    type End = fn(&mut Bench);
    let ends: [(End, &str); 3] = [
        (|bench| assert_eq!(bench.send_request(&Request::Stop), Reply::Stopped), "stop"),
        (
            |bench| {
                bench.board.interlock_closed = false;
                bench.wait_ms(2);
                bench.board.interlock_closed = true;
                assert_eq!(bench.state(), SafetyState::Fault);
                assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
            },
            "fault",
        ),
        (|bench| bench.wait_ms(1_100), "silence"),
    ];
    for (end, name) in ends {
        let mut bench = Bench::new();
        bench.send_request(&make_arm_request());
        let Reply::DrivesSet { .. } = bench.send_request(&make_two_drives_request()) else { panic!("{name}") };
        assert_eq!(bench.state(), SafetyState::Arming, "{name}");
        end(&mut bench);
        bench.send_request(&Request::ClearFaults);
        bench.wait_ms(1_000);
        assert_eq!(bench.state(), SafetyState::Safe, "{name}");
        bench.send_request(&make_arm_request());
        bench.wait_ms(support::ARMING_MS);
        assert_eq!(bench.state(), SafetyState::Armed, "{name}");
        bench.wait_ms(5);
        assert_eq!(bench.state(), SafetyState::Armed, "{name}");
        assert!(!bench.board.connected, "{name}");
    }
}

#[test]
fn arming_is_refused_by_each_thing_that_is_not_as_it_should_be() {
    type Spoil = fn(&mut support::FakeBoard);
    let spoils: [(Spoil, FaultCode); 14] = [
        (|board| board.interlock_closed = false, FaultCode::InterlockOpen),
        (|board| board.stop_released = false, FaultCode::EmergencyStop),
        (|board| board.earth_bonded = false, FaultCode::EarthOpen),
        (|board| board.fail_trips = true, FaultCode::SelfTest),
        (|board| board.fail_start = true, FaultCode::ArmFailed),
        (|board| board.rails_show = [None, Some(0)], FaultCode::ShortCircuit),
        (|board| board.more_microamps = 600, FaultCode::ShortCircuit),
        (|board| board.crossed_rails = true, FaultCode::SelfTest),
        (|board| board.circuit.stuck_enable = true, FaultCode::SelfTest),
        (|board| board.dead_over_voltage = true, FaultCode::SelfTest),
        (|board| board.circuit.dead_discharge = true, FaultCode::DischargeSlow),
        (|board| board.circuit.dead_discharge_lines = true, FaultCode::DischargeSlow),
        (|board| board.circuit.dead_permit = true, FaultCode::Permit),
        (|board| board.circuit.broken[1][0] = ElectrodeState::Open, FaultCode::Electrode),
    ];
    for (spoil, code) in spoils {
        let mut bench = Bench::new();
        spoil(&mut bench.board);
        bench.send_request(&make_arm_request());
        bench.wait_ms(100);
        let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!("{code:?}") };
        assert_eq!(fault.code, code);
        assert_eq!(bench.state(), SafetyState::Fault);
        assert!(!bench.board.is_live(), "{code:?}");
    }
}

#[test]
fn every_fault_while_running_switches_everything_off() {
    type Spoil = fn(&mut support::FakeBoard);
    let spoils: [(Spoil, FaultCode); 13] = [
        (|board| board.interlock_closed = false, FaultCode::InterlockOpen),
        (|board| board.stop_released = false, FaultCode::EmergencyStop),
        (|board| board.earth_bonded = false, FaultCode::EarthOpen),
        (|board| board.standing_fault = Some((FaultCode::Permit, 1)), FaultCode::Permit),
        (|board| board.trip = Some((FaultCode::OverCurrent, 0)), FaultCode::OverCurrent),
        (|board| board.trip = Some((FaultCode::OverVoltage, 0)), FaultCode::OverVoltage),
        (|board| board.more_microamps = 700, FaultCode::OverCurrent),
        (|board| board.rails_show = [Some(2_100_001), None], FaultCode::OverVoltage),
        (|board| board.rails_show = [None, Some(790_000)], FaultCode::RailCollapsed),
        (|board| board.rails_show = [Some(850_000), None], FaultCode::RailImplausible),
        (|board| board.stopped_timer = Some(1), FaultCode::TimerStopped),
        (|board| board.rails_show = [Some(1_200_000), None], FaultCode::DischargeSlow),
        (|board| board.rails_show = [Some(1_070_000), None], FaultCode::DischargeFailed),
    ];
    for (spoil, code) in spoils {
        let mut bench = Bench::new();
        bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(10_000) });
        bench.send_request(&make_two_drives_request());
        bench.wait_ms(100);
        assert_eq!(bench.state(), SafetyState::Running);
        spoil(&mut bench.board);
        for _ in 0..11 {
            bench.wait_ms(100);
            bench.send_request(&Request::KeepAlive);
        }
        let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!("{code:?}") };
        assert_eq!(fault.code, code);
        assert_eq!(bench.state(), SafetyState::Fault);
        assert!(!bench.board.is_live(), "{code:?}");
    }
}

#[test]
fn a_fault_is_cleared_only_with_its_cause_gone() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.board.interlock_closed = false;
    bench.wait_ms(2);
    assert_eq!(
        bench.send_request(&Request::ClearFaults),
        Reply::Refused(Refusal::StillThere(FaultCode::InterlockOpen))
    );
    bench.board.interlock_closed = true;
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
    bench.wait_ms(1);
    assert_eq!(bench.state(), SafetyState::Safe);
}

#[test]
fn effects_are_played_from_a_queue() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let click = Effect::new_click(2, 1);
    let play = |channel, start_us| Request::Play { channel, start_us, effect: Effect::new_click(2, 1) };
    assert_eq!(bench.send_request(&play(0, 0)), Reply::Refused(Refusal::NoDrive { channel: 0 }));
    let prepare = Request::Prepare { drives: Short::from_slice(&[make_drive(0)]).unwrap() };
    assert!(matches!(bench.send_request(&prepare), Reply::Prepared { .. }));
    bench.wait_ms(10);
    assert!(!bench.board.is_any_channel_driven(), "prepared is silent");
    let now_us = bench.board.now_us;
    assert_eq!(bench.send_request(&play(0, now_us + 20_000)), Reply::Playing);
    bench.wait_ms(15);
    assert!(!bench.board.is_any_channel_driven());
    bench.wait_ms(15);
    assert!(bench.board.is_any_channel_driven());
    bench.wait_ms(40);
    assert!(!bench.board.is_any_channel_driven() && bench.state() == SafetyState::Running);
    bench.wait_ms(100);
    let late = bench.send_request(&play(0, now_us));
    assert!(matches!(late, Reply::Refused(Refusal::Start { .. })), "{late:?}");
    let early = bench.send_request(&play(0, u64::MAX));
    assert!(matches!(early, Reply::Refused(Refusal::Start { start_us: u64::MAX, .. })), "{early:?}");
    let bad = Request::Play { channel: 0, start_us: 0, effect: Effect { times: 0, ..click } };
    assert_eq!(bench.send_request(&bad), Reply::Refused(Refusal::Effect));
    let now_us = bench.board.now_us;
    for _ in 0..4 {
        assert_eq!(bench.send_request(&play(0, now_us + 500_000)), Reply::Playing);
    }
    assert_eq!(bench.send_request(&play(0, now_us + 500_000)), Reply::Refused(Refusal::QueueFull { channel: 0 }));
    assert_eq!(bench.send_request_on_link(1, &play(0, 0)), Reply::Refused(Refusal::OtherLink));
}

#[test]
fn the_clock_the_log_and_the_details_are_reported() {
    let mut bench = Bench::new();
    let now_us = bench.board.now_us;
    assert_eq!(bench.send_request(&Request::Clock), Reply::Clock { now_us });
    assert_eq!(bench.send_request(&Request::Log), Reply::Log { bytes: Short::from_slice(b"log").unwrap() });
    bench.arm_and_await_armed();
    let Reply::Details(details) = bench.send_request(&Request::Details) else { panic!() };
    assert_eq!((details.state, details.rail_millivolts), (SafetyState::Armed, [50_000; 2]));
    assert!(details.interlock_closed && details.stop_released && details.earth_bonded);
    assert_eq!(details.credit_ms.as_slice(), [60_000; 4]);
    bench.board.trip = Some((FaultCode::OverCurrent, 0));
    let Reply::Details(details) = bench.send_request(&Request::Details) else { panic!() };
    assert_eq!(details.state, SafetyState::Fault, "a trip is not lost to a question");
}

#[test]
fn the_bootloader_is_only_entered_when_nothing_is_live() {
    let mut bench = Bench::new();
    let go = Request::Bootloader { key: BOOTLOADER_KEY };
    bench.arm_and_await_armed();
    assert_eq!(bench.send_request(&go), Reply::Refused(Refusal::Live(SafetyState::Armed)));
    bench.send_request(&Request::Disarm);
    assert_eq!(bench.send_request(&Request::Bootloader { key: 1 }), Reply::Refused(Refusal::Malformed));
    assert!(!bench.board.bootloader);
    assert_eq!(bench.send_request(&go), Reply::Bootloader);
    assert!(bench.board.bootloader);
}

#[test]
fn nothing_is_driven_before_arming() {
    let mut bench = Bench::new();
    let refusal = Refusal::State { state: SafetyState::Safe, event: SafetyEvent::Drive };
    assert_eq!(bench.send_request(&make_two_drives_request()), Reply::Refused(refusal));
    assert!(!bench.board.is_live());
}

#[test]
fn drives_are_set_all_or_none() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    let before = bench.board.preloads.clone();
    let bad = ChannelDrive { frequency_millihertz: 2_000_000, ..make_drive(1) };
    let request = Request::SetDrives { drives: Short::from_slice(&[make_drive(0), bad]).unwrap() };
    let Reply::Refused(Refusal::Drive { channel: 1, .. }) = bench.send_request(&request) else { panic!() };
    assert_eq!(bench.board.preloads, before, "the first channel was left as it was");
    let twice = Request::SetDrives { drives: Short::from_slice(&[make_drive(0), make_drive(0)]).unwrap() };
    assert_eq!(bench.send_request(&twice), Reply::Refused(Refusal::DuplicateChannel { channel: 0 }));
    let fifth = Request::SetDrives { drives: Short::from_slice(&[make_drive(4)]).unwrap() };
    assert!(matches!(bench.send_request(&fifth), Reply::Refused(Refusal::Drive { channel: 4, .. })));
    let one = Request::SetDrives { drives: Short::from_slice(&[make_drive(1)]).unwrap() };
    bench.send_request(&one);
    bench.wait_ms(10);
    assert!(
        bench.board.find_latest_period(0).has_no_windows() && !bench.board.find_latest_period(1).has_no_windows(),
        "a channel not named is off"
    );
}

#[test]
fn silence_switches_off_and_is_latched() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    for _ in 0..15 {
        bench.wait_ms(100);
        assert_eq!(bench.send_request(&Request::KeepAlive), Reply::Alive { state: SafetyState::Running });
    }
    bench.wait_ms(249);
    assert_eq!(bench.state(), SafetyState::Running);
    bench.wait_ms(1);
    assert_eq!(bench.state(), SafetyState::Fault);
    assert!(!bench.board.is_live());
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.detail), (FaultCode::HostSilent, 250));
    assert!(matches!(
        bench.send_request(&make_arm_request()),
        Reply::Refused(Refusal::State { state: SafetyState::Fault, .. })
    ));
    assert_eq!(bench.send_request(&Request::ClearFaults), Reply::FaultsCleared);
    assert_eq!(bench.send_request(&make_arm_request()), Reply::Armed { deadman_ms: 250 });
}

#[test]
fn a_late_keep_alive_does_not_revive() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    bench.board.now_us += 300_000; // no poll in between: the firmware's task was late
    assert_eq!(bench.send_request(&Request::KeepAlive), Reply::Alive { state: SafetyState::Fault });
    assert!(!bench.board.is_live());
}

#[test]
fn another_link_may_stop_but_not_drive_nor_keep_alive() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    assert_eq!(bench.send_request_on_link(1, &make_two_drives_request()), Reply::Refused(Refusal::OtherLink));
    assert_eq!(bench.send_request_on_link(1, &make_arm_request()), Reply::Refused(Refusal::OtherLink));
    bench.wait_ms(200);
    bench.send_request_on_link(1, &Request::KeepAlive);
    bench.wait_ms(50);
    assert_eq!(bench.state(), SafetyState::Fault, "link 1 does not keep link 0's session alive");
    bench.send_request(&Request::ClearFaults);
    bench.arm_and_await_armed();
    bench.send_request(&make_two_drives_request());
    assert_eq!(bench.send_request_on_link(1, &Request::Stop), Reply::Stopped);
    assert!(!bench.board.is_live());
}

#[test]
fn failing_hardware_ends_off_with_the_reason() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.board.fail_preload = true;
    bench.board.now_us += 500;
    let Reply::Refused(Refusal::Fault(fault)) = bench.send_request(&make_two_drives_request()) else { panic!() };
    assert_eq!(fault.code, FaultCode::ReadBack);
    assert_eq!((bench.state(), bench.board.is_live()), (SafetyState::Fault, false));
    assert_eq!(bench.board.log.last(), Some(&Did::Off));
}

#[test]
fn a_fault_from_before_the_reset_is_reported() {
    let mut bench = Bench::new();
    bench.board.info.fault_before_reset = Some((FaultCode::Panic, 77));
    bench.board.info.failure = "panicked at src/main.rs:77".try_into().unwrap();
    bench.device = era_shared::device::Device::new();
    bench.device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut bench.board);
    assert_eq!(bench.state(), SafetyState::Fault);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((fault.code, fault.detail), (FaultCode::Panic, 77));
    let Reply::Welcome(hello) = bench.send_request(&Request::Hello { host_min: 1, host_current: 3 }) else { panic!() };
    assert_eq!(hello.failure, "panicked at src/main.rs:77");
    assert!(
        matches!(
            bench.send_request(&make_arm_request()),
            Reply::Refused(Refusal::State { state: SafetyState::Fault, .. })
        ),
        "latched"
    );
}

#[test]
fn replies_are_not_answered_and_nonsense_is_refused() {
    let mut bench = Bench::new();
    let mut frame = [0; MAX_ENCODED];
    let length = encode_frame(1, FrameKind::Reply, 5, &Reply::Stopped, &mut frame).unwrap();
    assert!(bench.send_bytes_and_collect_answers(0, &frame[..length]).is_empty());
    let length = encode_frame(1, FrameKind::Request, 6, &[0xFF_u8, 0xFF, 0xFF], &mut frame).unwrap();
    assert_eq!(
        support::decode_reply(&bench.send_bytes_and_collect_answers(0, &frame[..length])).2,
        Reply::Refused(Refusal::Malformed)
    );
    assert!(bench.send_bytes_and_collect_answers(0, b"no frame at all\0").is_empty());
    let Reply::Status(status) = bench.send_request(&Request::Status) else { panic!() };
    assert_eq!((status.link.bad_frames, status.link.refused), (1, 1));
}

#[test]
fn deadman_times_have_limits() {
    let mut bench = Bench::new();
    for requested_ms in [0, 49, 1001, u16::MAX] {
        let reply = bench.send_request(&Request::Arm { deadman_ms: Some(requested_ms) });
        assert_eq!(reply, Reply::Refused(Refusal::Deadman { requested_ms, min_ms: 50, max_ms: 1000 }));
    }
    assert_eq!(bench.send_request(&Request::Arm { deadman_ms: Some(50) }), Reply::Armed { deadman_ms: 50 });
    bench.wait_ms(50);
    assert_eq!(bench.state(), SafetyState::Fault);
}

fn any_request() -> impl Strategy<Value = Request> {
    let channel = (0_u8..6, any::<u32>(), any::<u32>(), any::<u32>(), any::<u32>(), any::<bool>());
    let channel = channel.prop_map(|(channel, f, p, phase, v, good)| {
        if good {
            return make_drive(channel % 5);
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
        Just(make_arm_request()),
        Just(Request::Disarm),
        prop::collection::vec(channel, 0..=4)
            .prop_map(|drives| Request::SetDrives { drives: Short::from_slice(&drives).unwrap() }),
        Just(make_two_drives_request()),
        Just(Request::Stop),
        Just(Request::KeepAlive),
        Just(Request::Status),
        Just(Request::Faults),
        Just(Request::ClearFaults),
        Just(Request::Telemetry),
        Just(Request::ArmWith { deadman_ms: None, burst_ms: Some(10) }),
        Just(Request::Prepare { drives: Short::from_slice(&[make_drive(0), make_drive(3)]).unwrap() }),
        (0_u8..6, any_start_us(), 0_u16..5, 0_u16..5).prop_map(|(channel, start_us, cycles, brake)| Request::Play {
            channel,
            start_us,
            effect: Effect::new_click(cycles, brake),
        }),
        Just(Request::Clock),
        Just(Request::Details),
        Just(Request::Log),
        Just(Request::Credit),
        any::<u32>().prop_map(|key| Request::Bootloader { key }),
        (0_u32..3, 0_u8..6, any_start_us(), 0_u16..5).prop_map(|(number, channel, start_us, cycles)| {
            Request::PlayOnce { number, channel, start_us, effect: Effect::new_click(cycles, 1) }
        }),
        (
            0_u32..3,
            any_start_us(),
            prop::array::uniform2(0_u32..3_000_000),
            prop::collection::vec(any_window(), 0..=24)
        )
            .prop_map(|(number, start_us, rail_millivolts, windows)| {
                let windows = Short::from_slice(&windows).unwrap();
                Request::PlayWindows(WindowSequence { number, start_us, rail_millivolts, windows })
            }),
        Just(Request::NumberedFault),
        // From the boot id, 7, on.
        (7_u32..11).prop_map(|number| Request::ClearFault { number }),
    ]
}

/// At once, soon, or at the end of the range, in clocks and in us.
fn any_start_us() -> impl Strategy<Value = u64> {
    prop_oneof![Just(0), 0_u64..30_000_000, any::<u64>(), Just(u64::MAX / 170), Just(u64::MAX)]
}

/// Good ones of a few channels mostly.
fn any_window() -> impl Strategy<Value = SequenceWindow> {
    let good = (0_u8..4, any::<bool>(), 2_000_u32..20_000, 3_000_u32..9_000);
    let any = (any::<u8>(), any::<bool>(), any::<u32>(), any::<u32>());
    prop_oneof![200 => good, 1 => any].prop_map(|(channel, is_a, wait_ticks, width_ticks)| {
        let electrode = if is_a { Electrode::A } else { Electrode::B };
        SequenceWindow { channel, electrode, wait_ticks, width_ticks }
    })
}

/// A request that is added has to be added to [`any_request`] too.
#[test]
fn every_kind_of_request_is_among_the_random_ones() {
    let name = |request: &Request| format!("{request:?}").split(['(', ' ']).next().unwrap_or_default().to_owned();
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let strategy = any_request();
    let drawn: std::collections::BTreeSet<String> =
        (0..2_000).map(|_| name(&strategy.new_tree(&mut runner).unwrap().current())).collect();
    // The first byte of a message is its kind; 0 is a value of everything that follows.
    let is_kind = |kind: &u8| postcard::from_bytes::<Request>(&[&[*kind][..], &[0; 200]].concat()).is_ok();
    assert_eq!(drawn.len(), (0..=u8::MAX).take_while(is_kind).count(), "{drawn:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(support::reduce_case_count_under_miri(2_000)))]

    /// Whatever the hosts on two links do and however long they wait: high voltage only in a live state, drives only while
    /// running, and every request has an answer (the fake board itself asserts that drives are applied only when armed).
    #[test]
    fn no_history_leaves_it_live_when_it_should_be_off(steps in prop::collection::vec((any_request(), 0_usize..2, 0_u64..120), 1..60)) {
        let mut bench = Bench::new();
        for (request, link, wait_ms) in steps {
            bench.send_request_on_link(link, &request);
            bench.wait_ms(wait_ms);
            prop_assert!(bench.state().is_live() || !bench.board.is_live());
            prop_assert!(bench.board.connected || !bench.board.is_any_channel_driven());
            prop_assert!(!bench.board.connected || matches!(bench.state(), SafetyState::Armed | SafetyState::Running));
        }
    }

    /// Garbage between frames changes nothing but the counters.
    #[test]
    fn garbage_changes_no_state(garbage in prop::collection::vec(any::<u8>(), 0..600)) {
        let mut bench = Bench::new();
        bench.arm_and_await_armed();
        bench.send_request(&make_two_drives_request());
        bench.send_bytes_and_collect_answers(0, &garbage);
        bench.send_bytes_and_collect_answers(0, &[0]);
        let Reply::Status(status) = bench.send_request(&Request::Status) else { panic!() };
        prop_assert_eq!(status.state, SafetyState::Running);
    }
}

/// A board that is looked at only every 60 ms, because its computer is busy or its answers are slow, passes its self-test all the same.
#[test]
fn a_self_test_that_is_looked_at_late_passes() {
    let mut bench = Bench::new();
    bench.send_request(&Request::Arm { deadman_ms: Some(1_000) });
    for _ in 0..20 {
        bench.board.now_us += 65_000;
        bench.send_request(&Request::KeepAlive);
    }
    let Reply::Faults { latched } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!((bench.state(), latched), (SafetyState::Armed, None));
}
