//! How long the device lets its channels drive: bursts, rests, and a credit that goes with the square of the force.

mod support;

use era_shared::protocol::*;
use era_shared::safety::SafetyState;
use era_shared::waveform::{Effect, Segment};
use heapless::Vec as Short;
use support::{Bench, make_arm_request, make_drive, make_two_drives_request};

#[test]
fn time_that_was_spent_off_is_no_drive() {
    let mut bench = Bench::new();
    bench.wait_ms(5_000);
    bench.send_request(&make_arm_request());
    bench.send_request(&make_two_drives_request());
    bench.wait_ms(support::ARMING_MS);
    assert_eq!(bench.state(), SafetyState::Running);
}

#[test]
fn bursts_end_and_must_rest() {
    let mut bench = Bench::new();
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(300) });
    bench.send_request(&make_two_drives_request());
    bench.wait_ms(300 + support::ARMING_MS);
    assert_eq!(bench.state(), SafetyState::Armed, "the burst is over");
    let Reply::Refused(Refusal::Duty { channel: 0, wait_ms }) = bench.send_request(&make_two_drives_request()) else {
        panic!()
    };
    assert!(wait_ms <= 100);
    bench.wait_ms(120);
    assert!(matches!(bench.send_request(&make_two_drives_request()), Reply::DrivesSet { .. }));
    for burst_ms in [0, 10_001] {
        let refusal = Refusal::Burst { requested_ms: burst_ms, min_ms: 1, max_ms: 10_000 };
        let request = Request::ArmWith { deadman_ms: None, burst_ms: Some(burst_ms) };
        assert_eq!(bench.send_request(&request), Reply::Refused(refusal));
    }
}

/// Strokes of 5 s with rests in between for `minutes`: when one was ended and refused for its credit, in s, and the least credit that
/// was seen in ms.
fn repeat_strokes_and_get_refusal_time_s_and_least_credit_ms(drive: ChannelDrive, minutes: u64) -> (Option<u64>, u32) {
    let mut bench = Bench::new();
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(10_000) });
    bench.wait_ms(20);
    let begun_us = bench.board.now_us;
    let mut least_ms = u32::MAX;
    let set = Request::SetDrives { drives: Short::from_slice(&[drive]).unwrap() };
    while bench.board.now_us - begun_us < minutes * 60_000_000 {
        assert!(matches!(bench.send_request(&set), Reply::DrivesSet { .. }));
        for _ in 0..20 {
            bench.wait_ms(250);
            let Reply::Credit(credit) = bench.send_request(&Request::Credit) else { panic!() };
            least_ms = least_ms.min(credit.channels[0].left_ms);
            if bench.state() != SafetyState::Running {
                let refused = bench.send_request(&set);
                assert!(matches!(refused, Reply::Refused(Refusal::Duty { channel: 0, .. })), "{refused:?}");
                return (Some((bench.board.now_us - begun_us) / 1_000_000), least_ms);
            }
        }
        bench.send_request(&Request::SetDrives { drives: Short::new() });
        bench.wait_ms(150);
    }
    assert_eq!(bench.send_request(&Request::Faults), Reply::Faults { latched: None });
    (None, least_ms)
}

#[test]
fn weak_strokes_never_run_out_and_strong_ones_do() {
    let minutes = if cfg!(miri) { 1 } else { 20 };
    // A quarter of the voltage's square and sin(pi/3): 0.047 of the largest force squared.
    let (refused_s, least_ms) = repeat_strokes_and_get_refusal_time_s_and_least_credit_ms(make_drive(0), minutes);
    assert!(refused_s.is_none() && least_ms > 59_000, "{refused_s:?}, {least_ms} ms");
    if cfg!(miri) {
        return;
    }
    // All of the voltage and nearly all of the half period: 60 s and what is earned meanwhile, and the rests.
    let strong = ChannelDrive { voltage_millivolts: 2_000_000, pulse_width_ppm: 930_000, ..make_drive(0) };
    let (refused_s, _) = repeat_strokes_and_get_refusal_time_s_and_least_credit_ms(strong, minutes);
    assert!(refused_s.is_some_and(|refused_s| (66..=71).contains(&refused_s)), "{refused_s:?}");
}

#[test]
fn the_credit_is_reported_with_what_it_is_charged_by() {
    let mut bench = Bench::new();
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(10_000) });
    bench.wait_ms(20);
    let strong = ChannelDrive { voltage_millivolts: 2_000_000, ..make_drive(2) };
    let drives = Short::from_slice(&[make_drive(0), strong]).unwrap();
    bench.send_request(&Request::SetDrives { drives });
    // Rails rise for 100 ms, and drives start at a boundary.
    bench.wait_ms(500);
    let Reply::Credit(credit) = bench.send_request(&Request::Credit) else { panic!() };
    assert_eq!((credit.rule, credit.earned_ppm, credit.channels.len()), (ChargeRule::ForceSquared, 100_000, 4));
    let charged: Vec<f64> = credit.channels.iter().map(|channel| f64::from(channel.charge_ppm) / 1e6).collect();
    // Channels 0 and 2 have rails of their own, or narrower windows on a common one: (U/U_max)^4 sin^2(pi/3) either way.
    assert!((charged[0] - 0.75 / 16.0).abs() < 1e-3 && (charged[2] - 0.75).abs() < 1e-3, "{charged:?}");
    assert_eq!((charged[1], charged[3]), (0.0, 0.0));
    assert!(credit.channels[2].left_ms < 60_000 && credit.channels[1].left_ms == 60_000);
    assert_eq!(
        (credit.drive_time_ms_until_credit_runs_out_if_ever(0), credit.drive_time_ms_until_credit_runs_out_if_ever(1)),
        (None, None)
    );
    assert!(
        credit.drive_time_ms_until_credit_runs_out_if_ever(2).is_some_and(|ms| (90_000..93_000).contains(&ms)),
        "{:?}",
        credit.drive_time_ms_until_credit_runs_out_if_ever(2)
    );
    // A stronger drive that is replaced costs what it does until its last boundary, and a level of an effect what it is.
    let prepare = Request::Prepare { drives: Short::from_slice(&[strong]).unwrap() };
    bench.send_request(&prepare);
    bench.wait_ms(20);
    let charge = |bench: &mut Bench| {
        let Reply::Credit(credit) = bench.send_request(&Request::Credit) else { panic!() };
        f64::from(credit.channels[2].charge_ppm) / 1e6
    };
    assert!(charge(&mut bench).abs() < 1e-9, "prepared is silent");
    let half = [Segment::Hold { level: 500, milliseconds: 400 }];
    let effect = Effect { segments: Short::from_slice(&half).unwrap(), times: 1 };
    bench.send_request(&Request::Play { channel: 2, start_us: 0, effect });
    bench.wait_ms(200);
    let played = charge(&mut bench);
    assert!((played - 0.75 / 4.0).abs() < 1e-3, "{played}");
}

/// A drive at 1 Hz is replaced by a weaker one: until its boundary, up to a second later, it costs what it did.
#[test]
fn a_replaced_drive_costs_what_it_does_until_its_boundary() {
    let mut bench = Bench::new();
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(10_000) });
    bench.wait_ms(20);
    let slow = |pulse_width_ppm| {
        let drive = ChannelDrive { frequency_millihertz: 1_000, pulse_width_ppm, ..make_drive(0) };
        Request::SetDrives { drives: Short::from_slice(&[drive]).unwrap() }
    };
    let charge = |bench: &mut Bench| {
        let Reply::Credit(credit) = bench.send_request(&Request::Credit) else { panic!() };
        credit.channels[0].charge_ppm
    };
    bench.send_request(&slow(900_000));
    bench.wait_ms(300);
    let strong = charge(&mut bench);
    bench.send_request(&slow(10_000));
    bench.wait_ms(300);
    assert_eq!(charge(&mut bench), strong);
    bench.wait_ms(900);
    bench.send_request(&Request::KeepAlive);
    bench.wait_ms(200);
    let weak = charge(&mut bench);
    assert!(strong > 60_000 && weak > 0 && weak < 20, "{strong}, {weak}");
}
