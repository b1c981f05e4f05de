//! The whole transition table: every state with every event, against rules that do not repeat the table; the self-test and the
//! budget.

use era_shared::limits::{BURST_DEFAULT_MS, DISCHARGED_MILLIVOLTS, DUTY_CREDIT_MS, REST_MS, TEST_MILLIVOLTS};
use era_shared::protocol::FaultCode;
use era_shared::safety::{
    CreditCharge, DriveBudget, LinkId, SafetyAction, SafetyEvent, SafetyMachine, SafetyState, SelfTest,
    SelfTestVerdict, Transition, look_up_transition,
};
use era_shared::supply::SensorReadings;

#[test]
fn every_entry_keeps_the_rules() {
    for state in SafetyState::ALL {
        for event in SafetyEvent::ALL {
            let outcome = look_up_transition(state, event);
            let at = format!("{state:?} x {event:?} -> {outcome:?}");
            if let Transition::Go(next, action) = outcome {
                assert_eq!(!next.is_live(), action == SafetyAction::Off, "off exactly where nothing may be live: {at}");
                if next == SafetyState::Running && state != SafetyState::Running {
                    assert_eq!(
                        (state, event),
                        (SafetyState::Armed, SafetyEvent::Drive),
                        "only an armed board starts: {at}"
                    );
                }
                if next == SafetyState::Armed && !matches!(state, SafetyState::Armed | SafetyState::Running) {
                    assert_eq!(
                        (state, event),
                        (SafetyState::Arming, SafetyEvent::TestPassed),
                        "armed after the self-test alone: {at}"
                    );
                    assert_eq!(action, SafetyAction::Enable, "{at}");
                }
                if next == SafetyState::Arming && state != SafetyState::Arming {
                    assert_eq!((event, action), (SafetyEvent::Arm, SafetyAction::Test), "{at}");
                }
                if next == SafetyState::Safe && state != SafetyState::Safe {
                    assert_eq!(
                        (state, event),
                        (SafetyState::Discharging, SafetyEvent::Discharged),
                        "safe once measured: {at}"
                    );
                }
                if state == SafetyState::Fault && next != SafetyState::Fault {
                    assert_eq!(
                        (event, next),
                        (SafetyEvent::Clear, SafetyState::Discharging),
                        "a fault ends by Clear alone: {at}"
                    );
                }
                if state == SafetyState::Boot {
                    assert!(!next.is_live(), "{at}");
                }
                assert_ne!((next, state == SafetyState::Boot), (SafetyState::Boot, false), "no way back to Boot: {at}");
            }
            match event {
                SafetyEvent::Stop | SafetyEvent::Disarm | SafetyEvent::Fault | SafetyEvent::HostSilent => {
                    assert!(
                        matches!(outcome, Transition::Go(_, SafetyAction::Off)),
                        "an order to be off is never refused: {at}"
                    );
                }
                _ => {}
            }
            match event {
                SafetyEvent::Fault => assert!(matches!(outcome, Transition::Go(SafetyState::Fault, _)), "{at}"),
                SafetyEvent::HostSilent if state.is_live() => {
                    assert!(matches!(outcome, Transition::Go(SafetyState::Fault, _)), "{at}");
                }
                SafetyEvent::Drive | SafetyEvent::Rest => {
                    assert_eq!(outcome == Transition::Refuse, !state.is_live(), "{at}")
                }
                SafetyEvent::TestPassed => {
                    assert_eq!(outcome != Transition::Refuse, state == SafetyState::Arming, "{at}")
                }
                SafetyEvent::Discharged => {
                    assert_eq!(outcome != Transition::Refuse, state == SafetyState::Discharging, "{at}")
                }
                _ => {}
            }
        }
    }
}

/// Every sequence of five events from power-on: the machine agrees with the table, live states always have a session
/// that can time out, and a fault stays until it is cleared.
#[test]
fn every_sequence_of_five_events() {
    let count = SafetyEvent::ALL.len();
    for code in 0..count.pow(5) {
        let mut safety = SafetyMachine::new();
        let mut rest = code;
        let mut faulted = false;
        for _ in 0..5 {
            let event = SafetyEvent::ALL[rest % count];
            rest /= count;
            let before = safety.state();
            match event {
                SafetyEvent::Fault => assert_eq!(safety.latch_fault(FaultCode::ReadBack, 0, 0), SafetyAction::Off),
                SafetyEvent::HostSilent if before.is_live() => {
                    assert_eq!(safety.latch_fault(FaultCode::HostSilent, 0, 0), SafetyAction::Off);
                }
                _ => {
                    if safety.apply_event(event).is_ok() && event == SafetyEvent::Arm {
                        safety.open_session(LinkId(0), 250, 0);
                    }
                }
            }
            faulted = safety.state() == SafetyState::Fault || faulted && event != SafetyEvent::Clear;
            assert_eq!(safety.state() == SafetyState::Fault, safety.fault().is_some());
            assert_eq!(faulted, safety.state() == SafetyState::Fault);
            assert_eq!(safety.state().is_live(), safety.expired_silence_us(u64::MAX).is_some());
        }
    }
}

#[test]
fn the_first_fault_is_kept_and_later_ones_are_counted() {
    let mut safety = SafetyMachine::new();
    safety.latch_fault(FaultCode::Panic, 42, 5);
    safety.latch_fault(FaultCode::HostSilent, 1, 6);
    let fault = safety.fault().unwrap();
    assert_eq!((fault.code, fault.detail, fault.at_us, fault.count), (FaultCode::Panic, 42, 5, 2));
}

#[test]
fn silence_counts_from_the_arming_link_alone_and_ends_exactly_at_the_limit() {
    let mut safety = SafetyMachine::new();
    safety.apply_event(SafetyEvent::BootComplete).unwrap();
    safety.apply_event(SafetyEvent::Arm).unwrap();
    safety.open_session(LinkId(3), 250, 1_000);
    safety.note_sign_of_life(LinkId(4), 200_000);
    assert_eq!(safety.expired_silence_us(250_999), None);
    assert_eq!(
        safety.expired_silence_us(251_000),
        Some(250_000),
        "link 4's noise does not keep link 3's session alive"
    );
    safety.note_sign_of_life(LinkId(3), 251_000);
    assert_eq!(safety.expired_silence_us(500_999), None);
    assert!(safety.is_armed_by_other_link(LinkId(4)) && !safety.is_armed_by_other_link(LinkId(3)));
}

#[test]
fn a_live_state_without_a_session_counts_as_silence() {
    let mut safety = SafetyMachine::new();
    safety.apply_event(SafetyEvent::BootComplete).unwrap();
    safety.apply_event(SafetyEvent::Arm).unwrap();
    assert_eq!(safety.expired_silence_us(0), Some(u64::MAX));
}

fn readings(millivolts: u32) -> SensorReadings {
    SensorReadings {
        rail_millivolts: [millivolts; 2],
        interlock_closed: true,
        stop_released: true,
        earth_bonded: true,
        ..SensorReadings::default()
    }
}

#[test]
fn the_self_test_passes_in_order_and_each_way_to_fail_has_its_code() {
    let mut test = SelfTest::new(0);
    assert!(
        matches!(test.advance(0, &readings(300_000)), SelfTestVerdict::Continue(supply) if !supply.enabled && supply.discharge == [true; 2])
    );
    assert_eq!(test.advance(20_000, &readings(DISCHARGED_MILLIVOLTS - 1)), SelfTestVerdict::TryTrips);
    assert!(matches!(test.advance(21_000, &readings(0)), SelfTestVerdict::Continue(supply) if supply.enabled));
    assert!(matches!(test.advance(22_000, &readings(20_000)), SelfTestVerdict::Continue(_)));
    assert_eq!(test.advance(23_000, &readings(TEST_MILLIVOLTS)), SelfTestVerdict::Passed);

    let failed = |verdict| match verdict {
        SelfTestVerdict::Failed((code, _)) => Some(code),
        _ => None,
    };
    let open = [
        (SensorReadings { interlock_closed: false, ..readings(0) }, FaultCode::InterlockOpen),
        (SensorReadings { stop_released: false, ..readings(0) }, FaultCode::EmergencyStop),
        (SensorReadings { earth_bonded: false, ..readings(0) }, FaultCode::EarthOpen),
    ];
    for (readings, code) in open {
        assert_eq!(failed(SelfTest::new(0).advance(0, &readings)), Some(code));
    }
    assert_eq!(failed(SelfTest::new(0).advance(1_000_001, &readings(60_000))), Some(FaultCode::DischargeFailed));
    // A rail that does not come up; one that runs away; a current at rest.
    let bad = [
        SensorReadings { rail_millivolts: [TEST_MILLIVOLTS, 10_000], ..readings(0) },
        readings(90_000),
        SensorReadings { average_microamps: 21, ..readings(TEST_MILLIVOLTS) },
    ];
    for bad in bad {
        let mut test = SelfTest::new(0);
        test.advance(0, &readings(0));
        test.advance(1_000, &readings(0));
        assert_eq!(failed(test.advance(60_000, &bad)), None, "it has until 60 ms");
        assert_eq!(failed(test.advance(61_001, &bad)), Some(FaultCode::ShortCircuit));
    }
}

#[test]
fn bursts_and_duty_are_bounded() {
    let only_first = [Some(CreditCharge::FULL), None, None, None];
    let mut budget = DriveBudget::new();
    let mut now_us = 0;
    let mut on_ms = 0_u32;
    let mut run = |budget: &mut DriveBudget, driving| {
        now_us += 1_000;
        budget.account_and_find_spent(now_us, driving)
    };
    while run(&mut budget, only_first) == [false; 4] {
        on_ms += 1;
    }
    assert_eq!(on_ms + 1, u32::from(BURST_DEFAULT_MS));
    assert_eq!((budget.required_wait_ms(0), budget.required_wait_ms(1)), (Some(REST_MS), None));
    for left in (0..REST_MS).rev() {
        run(&mut budget, [None; 4]);
        assert_eq!(budget.required_wait_ms(0), (left > 0).then_some(left));
    }
    // Driving whenever it may: the credit is spent, and then it is one part in ten.
    let mut share = |budget: &mut DriveBudget, seconds: u32| {
        let mut on = 0;
        let mut driving = true;
        for _ in 0..seconds * 1000 {
            driving =
                driving && budget.required_wait_ms(0).is_none() || !driving && budget.required_wait_ms(0).is_none();
            on += u32::from(driving);
            if run(budget, [driving.then_some(CreditCharge::FULL), None, None, None])[0] {
                driving = false;
            }
        }
        on
    };
    let first = share(&mut budget, 600);
    assert!(first <= DUTY_CREDIT_MS + 60_000 && first > DUTY_CREDIT_MS, "{first}");
    let later = share(&mut budget, 600);
    assert!(later <= 60_100 && later > 50_000, "{later} ms in 10 minutes");
}
