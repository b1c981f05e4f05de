//! The whole transition table: every state with every event, against rules that do not repeat the table.

use era_shared::protocol::FaultCode;
use era_shared::safety::{Action, Event, LinkId, Outcome, Safety, State, transition};

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
                if next == State::Armed && state == State::Safe {
                    assert_eq!((event, action), (Event::Arm, Action::Enable), "{at}");
                }
                if state == State::Fault && next != State::Fault {
                    assert_eq!((event, next), (Event::Clear, State::Safe), "a fault ends by Clear alone: {at}");
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
