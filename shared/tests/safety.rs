//! The whole transition table: every state with every event, against rules that do not repeat the table; the self-test and the
//! budget.

use era_shared::limits::{BURST_DEFAULT_MS, DISCHARGED_MILLIVOLTS, DUTY_CREDIT_MS, REST_MS, TEST_MILLIVOLTS};
use era_shared::protocol::FaultCode;
use era_shared::safety::{
    Action, Budget, Charge, Event, LinkId, Outcome, Safety, SelfTest, State, Verdict, transition,
};
use era_shared::supply::Senses;

#[test]
fn every_entry_keeps_the_rules() {
    for state in State::ALL {
        for event in Event::ALL {
            let outcome = transition(state, event);
            let at = format!("{state:?} x {event:?} -> {outcome:?}");
            if let Outcome::Go(next, action) = outcome {
                assert_eq!(!next.is_live(), action == Action::Off, "off exactly where nothing may be live: {at}");
                if next == State::Running && state != State::Running {
                    assert_eq!((state, event), (State::Armed, Event::Drive), "only an armed board starts: {at}");
                }
                if next == State::Armed && !matches!(state, State::Armed | State::Running) {
                    assert_eq!(
                        (state, event),
                        (State::Arming, Event::TestPassed),
                        "armed after the self-test alone: {at}"
                    );
                    assert_eq!(action, Action::Enable, "{at}");
                }
                if next == State::Arming && state != State::Arming {
                    assert_eq!((event, action), (Event::Arm, Action::Test), "{at}");
                }
                if next == State::Safe && state != State::Safe {
                    assert_eq!((state, event), (State::Discharging, Event::Discharged), "safe once measured: {at}");
                }
                if state == State::Fault && next != State::Fault {
                    assert_eq!((event, next), (Event::Clear, State::Discharging), "a fault ends by Clear alone: {at}");
                }
                if state == State::Boot {
                    assert!(!next.is_live(), "{at}");
                }
                assert_ne!((next, state == State::Boot), (State::Boot, false), "no way back to Boot: {at}");
            }
            match event {
                Event::Stop | Event::Disarm | Event::Fault | Event::HostSilent => {
                    assert!(
                        matches!(outcome, Outcome::Go(_, Action::Off)),
                        "an order to be off is never refused: {at}"
                    );
                }
                _ => {}
            }
            match event {
                Event::Fault => assert!(matches!(outcome, Outcome::Go(State::Fault, _)), "{at}"),
                Event::HostSilent if state.is_live() => {
                    assert!(matches!(outcome, Outcome::Go(State::Fault, _)), "{at}");
                }
                Event::Drive | Event::Rest => assert_eq!(outcome == Outcome::Refuse, !state.is_live(), "{at}"),
                Event::TestPassed => assert_eq!(outcome != Outcome::Refuse, state == State::Arming, "{at}"),
                Event::Discharged => assert_eq!(outcome != Outcome::Refuse, state == State::Discharging, "{at}"),
                _ => {}
            }
        }
    }
}

/// Every sequence of five events from power-on: the machine agrees with the table, live states always have a session
/// that can time out, and a fault stays until it is cleared.
#[test]
fn every_sequence_of_five_events() {
    let count = Event::ALL.len();
    for code in 0..count.pow(5) {
        let mut safety = Safety::new();
        let mut rest = code;
        let mut faulted = false;
        for _ in 0..5 {
            let event = Event::ALL[rest % count];
            rest /= count;
            let before = safety.state();
            match event {
                Event::Fault => assert_eq!(safety.raise(FaultCode::ReadBack, 0, 0), Action::Off),
                Event::HostSilent if before.is_live() => {
                    assert_eq!(safety.raise(FaultCode::HostSilent, 0, 0), Action::Off);
                }
                _ => {
                    if safety.on(event).is_ok() && event == Event::Arm {
                        safety.open_session(LinkId(0), 250, 0);
                    }
                }
            }
            faulted = safety.state() == State::Fault || faulted && event != Event::Clear;
            assert_eq!(safety.state() == State::Fault, safety.fault().is_some());
            assert_eq!(faulted, safety.state() == State::Fault);
            assert_eq!(safety.state().is_live(), safety.silent_for_us(u64::MAX).is_some());
        }
    }
}

#[test]
fn the_first_fault_is_kept_and_later_ones_are_counted() {
    let mut safety = Safety::new();
    safety.raise(FaultCode::Panic, 42, 5);
    safety.raise(FaultCode::HostSilent, 1, 6);
    let fault = safety.fault().unwrap();
    assert_eq!((fault.code, fault.detail, fault.at_us, fault.count), (FaultCode::Panic, 42, 5, 2));
}

#[test]
fn silence_counts_from_the_arming_link_alone_and_ends_exactly_at_the_limit() {
    let mut safety = Safety::new();
    safety.on(Event::BootComplete).unwrap();
    safety.on(Event::Arm).unwrap();
    safety.open_session(LinkId(3), 250, 1_000);
    safety.heard(LinkId(4), 200_000);
    assert_eq!(safety.silent_for_us(250_999), None);
    assert_eq!(safety.silent_for_us(251_000), Some(250_000), "link 4's noise does not keep link 3's session alive");
    safety.heard(LinkId(3), 251_000);
    assert_eq!(safety.silent_for_us(500_999), None);
    assert!(safety.held_by_other(LinkId(4)) && !safety.held_by_other(LinkId(3)));
}

#[test]
fn a_live_state_without_a_session_counts_as_silence() {
    let mut safety = Safety::new();
    safety.on(Event::BootComplete).unwrap();
    safety.on(Event::Arm).unwrap();
    assert_eq!(safety.silent_for_us(0), Some(u64::MAX));
}

fn senses(millivolts: u32) -> Senses {
    Senses {
        rail_millivolts: [millivolts; 2],
        interlock_closed: true,
        stop_released: true,
        earth_bonded: true,
        ..Senses::default()
    }
}

#[test]
fn the_self_test_passes_in_order_and_each_way_to_fail_has_its_code() {
    let mut test = SelfTest::new(0);
    assert!(
        matches!(test.step(0, &senses(300_000)), Verdict::Going(supply) if !supply.enabled && supply.discharge == [true; 2])
    );
    assert_eq!(test.step(20_000, &senses(DISCHARGED_MILLIVOLTS - 1)), Verdict::TryTrips);
    assert!(matches!(test.step(21_000, &senses(0)), Verdict::Going(supply) if supply.enabled));
    assert!(matches!(test.step(22_000, &senses(20_000)), Verdict::Going(_)));
    assert_eq!(test.step(23_000, &senses(TEST_MILLIVOLTS)), Verdict::Passed);

    let failed = |verdict| match verdict {
        Verdict::Failed((code, _)) => Some(code),
        _ => None,
    };
    let open = [
        (Senses { interlock_closed: false, ..senses(0) }, FaultCode::InterlockOpen),
        (Senses { stop_released: false, ..senses(0) }, FaultCode::EmergencyStop),
        (Senses { earth_bonded: false, ..senses(0) }, FaultCode::EarthOpen),
    ];
    for (senses, code) in open {
        assert_eq!(failed(SelfTest::new(0).step(0, &senses)), Some(code));
    }
    assert_eq!(failed(SelfTest::new(0).step(1_000_001, &senses(60_000))), Some(FaultCode::DischargeFailed));
    // A rail that does not come up; one that runs away; a current at rest.
    let bad = [
        Senses { rail_millivolts: [TEST_MILLIVOLTS, 10_000], ..senses(0) },
        senses(90_000),
        Senses { average_microamps: 21, ..senses(TEST_MILLIVOLTS) },
    ];
    for bad in bad {
        let mut test = SelfTest::new(0);
        test.step(0, &senses(0));
        test.step(1_000, &senses(0));
        assert_eq!(failed(test.step(60_000, &bad)), None, "it has until 60 ms");
        assert_eq!(failed(test.step(61_001, &bad)), Some(FaultCode::ShortCircuit));
    }
}

#[test]
fn bursts_and_duty_are_bounded() {
    let only_first = [Some(Charge::FULL), None, None, None];
    let mut budget = Budget::new();
    let mut now_us = 0;
    let mut on_ms = 0_u32;
    let mut run = |budget: &mut Budget, driving| {
        now_us += 1_000;
        budget.step(now_us, driving)
    };
    while run(&mut budget, only_first) == [false; 4] {
        on_ms += 1;
    }
    assert_eq!(on_ms + 1, u32::from(BURST_DEFAULT_MS));
    assert_eq!((budget.wait_ms(0), budget.wait_ms(1)), (Some(REST_MS), None));
    for left in (0..REST_MS).rev() {
        run(&mut budget, [None; 4]);
        assert_eq!(budget.wait_ms(0), (left > 0).then_some(left));
    }
    // Driving whenever it may: the credit is spent, and then it is one part in ten.
    let mut share = |budget: &mut Budget, seconds: u32| {
        let mut on = 0;
        let mut driving = true;
        for _ in 0..seconds * 1000 {
            driving = driving && budget.wait_ms(0).is_none() || !driving && budget.wait_ms(0).is_none();
            on += u32::from(driving);
            if run(budget, [driving.then_some(Charge::FULL), None, None, None])[0] {
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
