//! Windows that are given one by one, and how long a channel may drive: a sequence that is accepted is played to its end.

mod support;

use era_shared::board::KeptRun;
use era_shared::protocol::*;
use era_shared::safety::SafetyState;
use era_shared::waveform::{Electrode, SequenceError, SequenceWindow};
use heapless::Vec as Short;
use proptest::prelude::*;
use support::{Bench, make_drive};

/// `count` windows of `width_ticks` ticks of 0.1 us on a channel, each after a pause of `wait_ticks`. Each is a tick wider than the one
/// before, so that its period is another one.
fn make_windows(channel: u8, count: usize, wait_ticks: u32, width_ticks: u32) -> Vec<SequenceWindow> {
    let all = (0_u32..).take(count).map(|more| width_ticks + more);
    all.map(|width_ticks| SequenceWindow { channel, electrode: Electrode::A, wait_ticks, width_ticks }).collect()
}

fn make_play_windows_request(number: u32, start_us: u64, volts: u32, windows: &[SequenceWindow]) -> Request {
    let windows = Short::from_slice(windows).unwrap();
    Request::PlayWindows(WindowSequence { number, start_us, rail_millivolts: [volts * 1_000; 2], windows })
}

fn make_set_drives_request(all: &[ChannelDrive]) -> Request {
    Request::SetDrives { drives: Short::from_slice(all).unwrap() }
}

/// Armed with this burst and this credit of channel 0, every host's silence allowed for a second.
fn arm_bench(burst_ms: u16, credit_ms: u32) -> Bench {
    let mut bench = Bench::new();
    if credit_ms < 60_000 {
        bench.board.info.kept_before_reset = Some(KeptRun {
            is_live: false,
            is_measurement_distrusted: false,
            credit_ms: [credit_ms, 60_000, 60_000, 60_000],
        });
        bench.device = era_shared::device::Device::new();
        bench.device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut bench.board);
        bench.wait_ms(2);
    }
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(burst_ms) });
    bench.wait_ms(support::ARMING_MS);
    assert_eq!(bench.state(), SafetyState::Armed);
    bench
}

/// Waits for so many ms, with signs of life.
fn wait_alive(bench: &mut Bench, mut ms: u64) {
    while ms > 0 {
        bench.wait_ms(ms.min(200));
        bench.send_request(&Request::KeepAlive);
        ms -= ms.min(200);
    }
}

fn read_latched_fault_code_and_detail(bench: &mut Bench) -> Option<(FaultCode, u32)> {
    let Reply::Faults { latched } = bench.send_request(&Request::Faults) else { panic!() };
    latched.map(|fault| (fault.code, fault.detail))
}

/// Windows of a channel that were played, if no two that follow each other are alike.
fn count_played(bench: &Bench, channel: usize) -> usize {
    let played = bench.board.preloads.iter().filter(|it| it.channel == channel && !it.period.has_no_windows());
    played.filter(|it| it.period.divider == 17).count()
}

/// A channel that has driven for most of its burst has too little left for windows, unless it rests before they begin.
#[test]
fn a_sequence_that_exceeds_the_burst_left_is_refused_beforehand() {
    let mut bench = arm_bench(500, 60_000);
    bench.send_request(&make_set_drives_request(&[make_drive(0)]));
    wait_alive(&mut bench, 420);
    // 20 windows of 5 ms: 100 ms and more, of which less than 80 are left.
    let windows = make_windows(0, 20, 3_000, 50_000);
    let refused = bench.send_request(&make_play_windows_request(1, 0, 1_000, &windows));
    let Reply::Refused(Refusal::Duty { channel: 0, wait_ms }) = refused else { panic!("{refused:?}") };
    // What is left of the drive's last two periods of 6.7 ms, then a rest of 100 ms.
    assert!((101..=120).contains(&wait_ms), "{wait_ms}");
    assert_eq!(bench.state(), SafetyState::Running, "the drive goes on");
    // Another channel is not concerned.
    let other = bench.send_request(&make_play_windows_request(2, 0, 1_000, &make_windows(1, 20, 3_000, 50_000)));
    assert!(matches!(other, Reply::WindowsPlaying { .. }), "{other:?}");
    // The drive has ended with that; after the time that was told there is a new burst.
    wait_alive(&mut bench, u64::from(wait_ms));
    let accepted = bench.send_request(&make_play_windows_request(3, 0, 1_000, &windows));
    assert!(matches!(accepted, Reply::WindowsPlaying { .. }), "{accepted:?}");
    bench.board.preloads.clear();
    wait_alive(&mut bench, 200);
    assert_eq!((read_latched_fault_code_and_detail(&mut bench), count_played(&bench, 0)), (None, 20));
    // A rest before the beginning counts.
    let mut bench = arm_bench(500, 60_000);
    bench.send_request(&make_set_drives_request(&[make_drive(0)]));
    wait_alive(&mut bench, 420);
    let start_us = bench.board.now_us + 150_000;
    assert_eq!(
        bench.send_request(&make_play_windows_request(1, start_us, 1_000, &windows)),
        Reply::WindowsPlaying { start_us }
    );
    wait_alive(&mut bench, 400);
    assert_eq!((read_latched_fault_code_and_detail(&mut bench), count_played(&bench, 0)), (None, 20));
}

/// A drive of 1 Hz goes on until its boundary, up to a second later, and is no rest.
#[test]
fn the_drive_that_ends_counts_until_its_boundary() {
    let mut bench = arm_bench(1_500, 60_000);
    bench.send_request(&make_set_drives_request(&[ChannelDrive { frequency_millihertz: 1_000, ..make_drive(0) }]));
    wait_alive(&mut bench, 600);
    let refused = bench.send_request(&make_play_windows_request(1, 0, 1_000, &make_windows(0, 4, 3_000, 50_000)));
    let Reply::Refused(Refusal::Duty { channel: 0, wait_ms }) = refused else { panic!("{refused:?}") };
    assert!((500..=2_100).contains(&wait_ms), "{wait_ms}");
}

#[test]
fn a_sequence_that_no_burst_holds_is_too_long() {
    let mut bench = arm_bench(10, 60_000);
    // One of 1 ms, before which up to 9 ms count.
    let refused = bench.send_request(&make_play_windows_request(1, 0, 1_000, &make_windows(0, 1, 3_000, 10_000)));
    let too_long = SequenceError::TooLong { requested_ms: 11, max_ms: 10 };
    assert_eq!(refused, Reply::Refused(Refusal::Sequence(too_long)));
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(11) });
    assert!(matches!(
        bench.send_request(&make_play_windows_request(2, 0, 1_000, &make_windows(0, 1, 3_000, 10_000))),
        Reply::WindowsPlaying { .. }
    ));
    wait_alive(&mut bench, 200);
    assert_eq!((read_latched_fault_code_and_detail(&mut bench), count_played(&bench, 0)), (None, 1));
}

/// 24 windows of 5.5 ms and pauses of 0.3 ms cost 148 ms of credit at 2 kV, with the 9 ms that may count before them, and a sixteenth of
/// that at 1 kV.
#[test]
fn a_sequence_that_exceeds_the_credit_is_refused_beforehand() {
    let windows = make_windows(0, 24, 3_000, 55_000);
    for volts in [1_000, 2_000] {
        let mut bench = arm_bench(2_000, 105);
        let Reply::Credit(before) = bench.send_request(&Request::Credit) else { panic!() };
        assert!((105..130).contains(&before.channels[0].left_ms), "{before:?}");
        let reply = bench.send_request(&make_play_windows_request(1, 0, volts, &windows));
        if volts == 1_000 {
            assert!(matches!(reply, Reply::WindowsPlaying { .. }), "{reply:?}");
            wait_alive(&mut bench, 400);
            assert_eq!((read_latched_fault_code_and_detail(&mut bench), count_played(&bench, 0)), (None, 24));
            continue;
        }
        let Reply::Refused(Refusal::Duty { channel: 0, wait_ms }) = reply else { panic!("{reply:?}") };
        assert!(
            bench.board.preloads.iter().all(|it| it.period.has_no_windows()) && bench.state() == SafetyState::Armed
        );
        // A tenth of the time is earned.
        assert!((10..500).contains(&wait_ms), "{wait_ms}");
        wait_alive(&mut bench, u64::from(wait_ms));
        let reply = bench.send_request(&make_play_windows_request(2, 0, volts, &windows));
        assert!(matches!(reply, Reply::WindowsPlaying { .. }), "{reply:?} after {wait_ms} ms");
        wait_alive(&mut bench, 400);
        assert_eq!((read_latched_fault_code_and_detail(&mut bench), count_played(&bench, 0)), (None, 24));
    }
}

/// Nothing of a sequence is left out in silence: a channel that must stop before its windows are over is a fault.
#[test]
fn a_channel_that_must_stop_in_its_windows_is_a_fault() {
    let mut bench = arm_bench(2_000, 60_000);
    let windows = [make_windows(0, 12, 3_000, 50_000), make_windows(3, 12, 3_000, 50_000)].concat();
    let Reply::WindowsPlaying { start_us } = bench.send_request(&make_play_windows_request(1, 0, 1_000, &windows))
    else {
        panic!()
    };
    let until_begun_ms = (start_us - bench.board.now_us) / 1_000 + 10;
    wait_alive(&mut bench, until_begun_ms);
    assert_eq!(bench.state(), SafetyState::Running);
    // A shorter burst than the one that it was accepted with.
    bench.send_request(&Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(15) });
    bench.wait_ms(10);
    assert_eq!(read_latched_fault_code_and_detail(&mut bench), Some((FaultCode::DriveFailed, 0)));
    assert!(!bench.board.is_live());
}

/// Falling rails get the time that their discharge switches take, whether they are set lower now or were a moment ago.
#[test]
fn a_sequence_waits_for_rails_that_fall() {
    for (set_volts, waits) in [(1_000, true), (500, true), (1_000, false)] {
        let mut bench = Bench::new();
        bench.arm_and_await_armed();
        bench.send_request(&make_set_drives_request(&[make_drive(0)]));
        wait_alive(&mut bench, 80);
        bench.send_request(&make_set_drives_request(&[ChannelDrive {
            voltage_millivolts: set_volts * 1_000,
            ..make_drive(0)
        }]));
        let now_us = bench.board.now_us;
        // Channel 2 has the same rail and is at rest, so that its timer is ready within 4 ms.
        let volts = if waits { 500 } else { 1_000 };
        let windows = make_windows(2, 1, 3_000, 10_000);
        let soon = bench.send_request(&make_play_windows_request(1, now_us + 12_000, volts, &windows));
        if !waits {
            assert_eq!(soon, Reply::WindowsPlaying { start_us: now_us + 12_000 });
            continue;
        }
        assert!(matches!(soon, Reply::Refused(Refusal::Start { .. })), "{soon:?}");
        let Reply::WindowsPlaying { start_us } = bench.send_request(&make_play_windows_request(2, 0, volts, &windows))
        else {
            panic!()
        };
        assert!((13_000..15_000).contains(&(start_us - now_us)), "{}", start_us - now_us);
        bench.wait_ms((start_us - now_us) / 1_000);
        assert!((bench.board.circuit.rails[0] - 500_000.0).abs() < 25_000.0, "{:?}", bench.board.circuit.rails);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(support::reduce_case_count_under_miri(150)))]

    /// Whatever was driven before, and whatever is left: what is accepted is played to its last window, without a fault.
    #[test]
    fn what_is_accepted_is_played_to_its_end(
        burst_ms in prop_oneof![10_u16..60, 60_u16..400, Just(2_000_u16)],
        credit_ms in prop_oneof![Just(60_000_u32), 100_u32..160, 100_u32..400],
        before in prop::option::of((1_000_u32..400_000, 0_u64..400)),
        volts in prop_oneof![Just(2_000_u32), 300_u32..2_000],
        windows in prop::collection::vec((0_u8..2, prop_oneof![2_000_u32..4_000, 2_000_u32..400_000], 3_000_u32..56_034), 1..=24),
        lead_us in prop_oneof![Just(0_u64), 60_000_u64..400_000],
    ) {
        let mut bench = arm_bench(burst_ms, credit_ms);
        let mut now_ms = 0;
        if let Some((frequency_millihertz, ms)) = before {
            let drive = ChannelDrive {
                frequency_millihertz,
                pulse_width_ppm: 300_000,
                voltage_millivolts: volts * 1_000,
                ..make_drive(0)
            };
            bench.send_request(&make_set_drives_request(&[drive]));
            wait_alive(&mut bench, ms);
            now_ms = ms;
        }
        let windows: Vec<SequenceWindow> = windows.iter().map(|(channel, wait_ticks, width_ticks)| {
            SequenceWindow { channel: *channel, electrode: Electrode::B, wait_ticks: *wait_ticks, width_ticks: *width_ticks }
        }).collect();
        let start_us = if lead_us == 0 { 0 } else { bench.board.now_us + lead_us + 100_000 };
        bench.board.preloads.clear();
        let reply = bench.send_request(&make_play_windows_request(1, start_us, volts, &windows));
        let told = read_latched_fault_code_and_detail(&mut bench);
        prop_assert_eq!(told, None, "{:?} after {} ms", reply, now_ms);
        if let Reply::WindowsPlaying { start_us } = reply {
            // At most 24 windows of 40 ms and 5.6 ms.
            let ms = (start_us - bench.board.now_us) / 1_000 + 24 * 46;
            wait_alive(&mut bench, ms);
            prop_assert_eq!(read_latched_fault_code_and_detail(&mut bench), None);
            for channel in 0..2 {
                let asked = windows.iter().filter(|window| usize::from(window.channel) == channel).count();
                prop_assert_eq!(count_played(&bench, channel), asked, "channel {}", channel);
            }
        } else {
            let expected = matches!(reply, Reply::Refused(
                Refusal::Duty { .. } | Refusal::Current { .. } | Refusal::Start { .. } | Refusal::Sequence(SequenceError::TooLong { .. })
            ));
            prop_assert!(expected, "{reply:?}");
        }
    }
}
