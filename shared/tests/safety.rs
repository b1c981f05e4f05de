//! The whole transition table: every state with every event, against rules that do not repeat the table; the self-test and the
//! budget.

use era_shared::limits::{BURST_DEFAULT_MS, DUTY_CREDIT_MS, REST_MS, TEST_MILLIVOLTS};
use era_shared::protocol::FaultCode;
use era_shared::safety::{
    CreditCharge, DriveBudget, ElectrodeFinding, ElectrodePulses, LinkId, SafetyAction, SafetyEvent, SafetyMachine,
    SafetyState, SelfTest, SelfTestVerdict, Transition, is_silence_over_deadman_or_its_maximum, judge_electrode_pulses,
    look_up_transition,
};
use era_shared::supply::{SensorReadings, SupplyCommand};
use era_shared::waveform::Electrode;

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
            assert_eq!(safety.state().is_live(), safety.host_silence_us_if_over_deadman(u64::MAX).is_some());
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
    safety.note_sign_of_life_if_link_has_armed(LinkId(4), 200_000);
    assert_eq!(safety.host_silence_us_if_over_deadman(250_999), None);
    assert_eq!(
        safety.host_silence_us_if_over_deadman(251_000),
        Some(250_000),
        "link 4's noise does not keep link 3's session alive"
    );
    safety.note_sign_of_life_if_link_has_armed(LinkId(3), 251_000);
    assert_eq!(safety.host_silence_us_if_over_deadman(500_999), None);
    assert!(safety.is_armed_by_other_link(LinkId(4)) && !safety.is_armed_by_other_link(LinkId(3)));
}

/// A dead-man time that is longer than any that may be asked for is none that anybody has asked for.
#[test]
fn no_dead_man_time_is_longer_than_the_largest_permitted() {
    for deadman_us in [50_000, 250_000, 1_000_000] {
        assert!(
            !is_silence_over_deadman_or_its_maximum(deadman_us - 1, deadman_us)
                && is_silence_over_deadman_or_its_maximum(deadman_us, deadman_us)
        );
    }
    for bit in 20..64 {
        assert!(!is_silence_over_deadman_or_its_maximum(999_999, 1 << bit));
        assert!(is_silence_over_deadman_or_its_maximum(1_000_000, 1 << bit), "a bit of the memory has changed");
    }
}

/// Links must not be taken for each other: only the one that has armed drives, and keeps the board alive.
#[test]
fn each_link_has_a_name_of_its_own() {
    let names: Vec<LinkId> = (0..256).map(LinkId::from_index).collect();
    for (place, name) in names.iter().enumerate() {
        assert_eq!(names.iter().position(|other| other == name), Some(place));
    }
}

#[test]
fn a_live_state_without_a_session_counts_as_silence() {
    let mut safety = SafetyMachine::new();
    safety.apply_event(SafetyEvent::BootComplete).unwrap();
    safety.apply_event(SafetyEvent::Arm).unwrap();
    assert_eq!(safety.host_silence_us_if_over_deadman(0), Some(u64::MAX));
}

fn make_readings(millivolts: u32) -> SensorReadings {
    SensorReadings {
        rail_millivolts: [millivolts; 2],
        interlock_closed: true,
        stop_released: true,
        earth_bonded: true,
        ..SensorReadings::default()
    }
}

/// One step of a self-test at a time in ms, with these rails in V.
fn advance_self_test(test: &mut SelfTest, at_ms: u64, volts: [u32; 2]) -> SelfTestVerdict {
    let readings = SensorReadings { rail_millivolts: volts.map(|volts| volts * 1000), ..make_readings(0) };
    test.advance(at_ms * 1000, &readings, true)
}

fn supply_command_of_verdict(verdict: SelfTestVerdict) -> (bool, [bool; 2], [u32; 2]) {
    let SelfTestVerdict::Continue(supply) = verdict else { panic!("{verdict:?}") };
    (supply.enabled, supply.discharge, supply.set_point_millivolts.map(|millivolts| millivolts / 1000))
}

const OFF: (bool, [bool; 2], [u32; 2]) = (false, [true; 2], [0; 2]);

/// The steps in order, with the rails of a sound board.
#[test]
fn the_self_test_passes_in_order() {
    let mut test = SelfTest::new(0, 2);
    assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 0, [300, 0])), OFF);
    assert_eq!(advance_self_test(&mut test, 6, [59, 59]), SelfTestVerdict::TryTrips);
    assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 7, [40, 12])), OFF);
    assert_eq!(advance_self_test(&mut test, 9, [15, 15]), SelfTestVerdict::TryOverVoltageInputs([false; 2]));
    assert_eq!(
        supply_command_of_verdict(advance_self_test(&mut test, 10, [10, 3])),
        (true, [false, true], [50, 0]),
        "rail 1 alone"
    );
    assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 11, [20, 40])), (true, [false, true], [50, 0]));
    assert_eq!(advance_self_test(&mut test, 13, [48, 15]), SelfTestVerdict::TryOverVoltageInputs([true, false]));
    assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 14, [50, 4])), (true, [false; 2], [50; 2]));
    assert_eq!(advance_self_test(&mut test, 17, [50, 45]), SelfTestVerdict::TryOverVoltageInputs([true; 2]));
    assert_eq!(
        supply_command_of_verdict(advance_self_test(&mut test, 18, [50, 48])),
        (false, [false; 2], [50; 2]),
        "disabled, and nothing else"
    );
    assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 28, [46, 44])), (false, [false; 2], [50; 2]));
    for (at_ms, volts) in [(29, [46, 44]), (30, [30, 28])] {
        let discharge = SupplyCommand { permitted: true, ..SupplyCommand::OFF };
        let verdict = advance_self_test(&mut test, at_ms, volts);
        assert_eq!(verdict, SelfTestVerdict::Continue(discharge), "now the switches, by their own lines");
    }
    assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 31, [15, 15])), (true, [false; 2], [50; 2]));
    for at_ms in [34, 35] {
        let SelfTestVerdict::Continue(supply) = advance_self_test(&mut test, at_ms, [48, 48]) else { panic!() };
        let withdrawn = SupplyCommand { permitted: false, ..CHARGED };
        assert_eq!(supply, withdrawn, "the permit is withdrawn, and nothing else");
    }
    assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 38, [14, 12])), (true, [false; 2], [50; 2]));
    for (at_ms, channel, electrode) in
        [(41, 0, Electrode::A), (46, 1, Electrode::A), (49, 0, Electrode::B), (52, 1, Electrode::B)]
    {
        let verdict = SelfTestVerdict::TryElectrode { channel, electrode };
        assert_eq!(advance_self_test(&mut test, at_ms, [48, 48]), verdict, "every electrode that there is, each alone");
        assert_eq!(
            supply_command_of_verdict(advance_self_test(&mut test, at_ms + 1, [34, 48])),
            (true, [false; 2], [50; 2]),
            "its rail recovers"
        );
    }
    assert_eq!(advance_self_test(&mut test, 55, [48, 48]), SelfTestVerdict::Passed);
}

/// While rails are charged again a current flows; before the first electrode and after the last one none may.
#[test]
fn nothing_may_flow_before_and_after_the_electrodes() {
    let with = |microamps: u32| SensorReadings { average_microamps: microamps, ..make_readings(50_000) };
    let mut test = SelfTest::new(0, 1);
    advance_self_test(&mut test, 0, [0, 0]);
    advance_self_test(&mut test, 0, [0, 0]);
    advance_self_test(&mut test, 1, [0, 0]);
    advance_self_test(&mut test, 2, [50, 0]);
    advance_self_test(&mut test, 3, [50, 0]);
    advance_self_test(&mut test, 4, [50, 50]);
    advance_self_test(&mut test, 5, [50, 50]);
    advance_self_test(&mut test, 16, [45, 45]);
    advance_self_test(&mut test, 20, [0, 0]);
    let withdrawn = SupplyCommand { permitted: false, ..CHARGED };
    assert_eq!(test.advance(25_000, &with(21), true), SelfTestVerdict::Continue(CHARGED));
    assert_eq!(
        test.advance(26_000, &with(20), true),
        SelfTestVerdict::Continue(withdrawn),
        "before the permit likewise"
    );
    advance_self_test(&mut test, 29, [0, 0]);
    assert_eq!(test.advance(34_000, &with(21), true), SelfTestVerdict::Continue(CHARGED));
    let is_tried = |verdict| matches!(verdict, SelfTestVerdict::TryElectrode { .. });
    assert!(is_tried(test.advance(35_000, &with(20), true)));
    assert!(is_tried(test.advance(38_000, &with(30), true)));
    assert_eq!(test.advance(41_000, &with(30), true), SelfTestVerdict::Continue(CHARGED));
    assert_eq!(test.advance(98_000, &with(30), true), SelfTestVerdict::Continue(CHARGED));
    assert_eq!(test.advance(98_001, &with(30), true), SelfTestVerdict::Failed((FaultCode::ShortCircuit, 0)));
}

const CHARGED: SupplyCommand =
    SupplyCommand { enabled: true, discharge: [false; 2], set_point_millivolts: [TEST_MILLIVOLTS; 2], permitted: true };

/// The fall of a rail of 1.8 nF at 50 V over three pulses of 0.4 ms with pauses of 0.2 ms, worked out from the parts, with tolerances
/// of 20 % for capacitances and 5 % for resistances: what is sound passes with two steps of the converter (1.2 V) to spare, and what is
/// open or shorted does not, with as much to spare.
#[test]
fn pulses_distinguish_a_sound_electrode_from_an_open_and_a_shorted_one() {
    let verdict = |from: f64, left: f64, by: f64| {
        let pulses = ElectrodePulses {
            after_first_millivolts: (from * 1e3) as u32,
            after_last_millivolts: ((from * left + by) * 1e3) as u32,
        };
        judge_electrode_pulses(2, &pulses)
    };
    let noise = 1.2;
    for from in [35.0, 50.0] {
        for (rail, electrode) in [(0.8, 1.2), (1.0, 1.0), (1.2, 0.8), (0.8, 0.8), (1.2, 1.2)] {
            let (rail, electrode) = (1.8e-9 * rail, 116e-12 * electrode);
            for ohms in [0.95, 1.05] {
                let bled = (-1.8e-3_f64 / (50e6 * ohms * rail)).exp();
                let charged = 1.0 - (-0.4e-3_f64 / (1e6 * ohms * electrode)).exp();
                let sound = (1.0 - electrode / (electrode + rail) * charged).powi(3) * bled;
                let drawn = (-1.2e-3_f64 / (1.1e6 * ohms * (rail + electrode))).exp() * bled;
                for by in [-noise, noise] {
                    assert_eq!(verdict(from, sound, by), ElectrodeFinding::Sound, "{rail} {electrode} {ohms} {by}");
                    assert_eq!(verdict(from, bled, by), ElectrodeFinding::NoCharge);
                    assert_eq!(verdict(from, drawn, by), ElectrodeFinding::Draws);
                }
            }
        }
    }
}

#[test]
fn each_way_to_fail_the_self_test_has_its_code() {
    let failed = |verdict| match verdict {
        SelfTestVerdict::Failed(finding) => Some(finding),
        _ => None,
    };
    let open = [
        (SensorReadings { interlock_closed: false, ..make_readings(0) }, FaultCode::InterlockOpen),
        (SensorReadings { stop_released: false, ..make_readings(0) }, FaultCode::EmergencyStop),
        (SensorReadings { earth_bonded: false, ..make_readings(0) }, FaultCode::EarthOpen),
    ];
    for (readings, code) in open {
        assert_eq!(failed(SelfTest::new(0, 2).advance(0, &readings, true)), Some((code, 0)));
    }
    let mut test = SelfTest::new(0, 2);
    assert_eq!(failed(advance_self_test(&mut test, 1_000, [60, 0])), None);
    assert_eq!(failed(advance_self_test(&mut test, 1_001, [60, 0])), Some((FaultCode::DischargeFailed, 10_060)));
    // Whose measurement is not trusted waits, whatever is measured.
    let mut test = SelfTest::new(0, 2);
    assert_eq!(test.advance(0, &make_readings(0), false), SelfTestVerdict::Continue(SupplyCommand::OFF));
    assert_eq!(test.advance(1_000, &make_readings(0), true), SelfTestVerdict::TryTrips);

    // After the trips the rails have to be where the over-voltage comparators do not see them.
    let mut test = SelfTest::new(0, 2);
    assert_eq!(advance_self_test(&mut test, 0, [59, 0]), SelfTestVerdict::TryTrips);
    assert_eq!(failed(advance_self_test(&mut test, 13, [0, 16])), None);
    assert_eq!(failed(advance_self_test(&mut test, 14, [0, 16])), Some((FaultCode::DischargeSlow, 20_016)));
    let at_first = || {
        let mut test = SelfTest::new(0, 2);
        advance_self_test(&mut test, 0, [0; 2]);
        advance_self_test(&mut test, 0, [0; 2]);
        advance_self_test(&mut test, 1, [0; 2]);
        test
    };
    // Too high a rail ends it at once: nothing else would, for the time that a rail has to come up.
    for (volts, detail) in [([66, 0], 10_066), ([2_000, 0], 12_000), ([50, 66], 20_066)] {
        let mut test = at_first();
        assert_eq!(failed(advance_self_test(&mut test, 2, volts)), None, "one look may be disturbed");
        assert_eq!(
            failed(advance_self_test(&mut test, 3, volts)),
            Some((FaultCode::RailImplausible, detail)),
            "{volts:?}"
        );
    }
    let mut test = at_first();
    for at_ms in 2..10 {
        assert_eq!(failed(advance_self_test(&mut test, at_ms, [64 + u32::from(at_ms % 2 == 0) * 9, 0])), None);
    }
    for (volts, finding) in [
        ([10, 0], (FaultCode::ShortCircuit, 1)),
        // The measurements are exchanged, or the rails hang together.
        ([0, 50], (FaultCode::SelfTest, 2_002)),
        ([50, 50], (FaultCode::SelfTest, 2_002)),
    ] {
        let mut test = at_first();
        assert_eq!(failed(advance_self_test(&mut test, 61, volts)), None, "it has until 60 ms");
        assert_eq!(failed(advance_self_test(&mut test, 62, volts)), Some(finding), "{volts:?}");
    }
    let at_both = || {
        let mut test = at_first();
        assert_eq!(advance_self_test(&mut test, 5, [50, 0]), SelfTestVerdict::TryOverVoltageInputs([true, false]));
        assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 6, [50, 0])), (true, [false; 2], [50; 2]));
        test
    };
    let mut test = at_both();
    advance_self_test(&mut test, 7, [50, 66]);
    assert_eq!(
        failed(advance_self_test(&mut test, 8, [50, 66])),
        Some((FaultCode::RailImplausible, 20_066)),
        "of both"
    );
    for (volts, detail) in [([50, 10], 2), ([34, 50], 1)] {
        assert_eq!(
            failed(advance_self_test(&mut at_both(), 67, volts)),
            Some((FaultCode::ShortCircuit, detail)),
            "{volts:?}"
        );
    }
    let leaks = SensorReadings { average_microamps: 21, ..make_readings(TEST_MILLIVOLTS) };
    assert_eq!(failed(at_both().advance(67_000, &leaks, true)), Some((FaultCode::ShortCircuit, 0)));
    let at_enable = || {
        let mut test = at_both();
        assert_eq!(advance_self_test(&mut test, 10, [50; 2]), SelfTestVerdict::TryOverVoltageInputs([true; 2]));
        test
    };
    let at_bleeding = || {
        let mut test = at_enable();
        assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 11, [50; 2])), (false, [false; 2], [50; 2]));
        test
    };
    // The supply goes on though it is disabled.
    assert_eq!(failed(advance_self_test(&mut at_bleeding(), 22, [46, 49])), Some((FaultCode::SelfTest, 2_012)));
    assert_eq!(failed(advance_self_test(&mut at_bleeding(), 22, [50, 46])), Some((FaultCode::SelfTest, 2_011)));
    // A discharge switch does not close.
    let mut test = at_bleeding();
    assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 22, [46; 2])), OFF);
    assert_eq!(failed(advance_self_test(&mut test, 35, [5, 42])), None);
    assert_eq!(failed(advance_self_test(&mut test, 36, [5, 41])), Some((FaultCode::DischargeSlow, 20_041)));
    // A rail stays up without the permit.
    for (volts, detail) in [([50, 50], 21), ([16, 5], 21), ([5, 16], 22)] {
        let mut test = at_bleeding();
        assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 22, [46; 2])), OFF);
        assert_eq!(supply_command_of_verdict(advance_self_test(&mut test, 26, [5; 2])), (true, [false; 2], [50; 2]));
        advance_self_test(&mut test, 30, [50; 2]);
        assert_eq!(failed(advance_self_test(&mut test, 43, volts)), None, "it has until 13 ms");
        assert_eq!(failed(advance_self_test(&mut test, 44, volts)), Some((FaultCode::Permit, detail)), "{volts:?}");
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
        budget.account_and_find_channels_to_stop(now_us, driving)
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
