//! Windows that are given one by one: what the pins do is what was asked for, to the clock, or the whole sequence is refused.

mod support;

use era_shared::circuit::SUPPLY_TIME_CONSTANT_MICROSECONDS;
use era_shared::protocol::*;
use era_shared::safety::SafetyState;
use era_shared::supply::rail_index_of_channel;
use era_shared::waveform::{
    ChannelGoal, Electrode, ModelTimers, OutputPair, PlacedWindows, Pulse, SequenceError, SequenceWindow,
    compute_channel_program,
};
use heapless::Vec as Short;
use proptest::prelude::*;
use support::{Bench, make_channel_limits, make_drive, make_two_drives_request};

/// A tick of a sequence in clocks of 170 MHz: 0.1 us.
const TICK: u64 = 17;
/// The guard of 200 us, in clocks and ticks.
const GUARD_CLOCKS: u64 = 34_000;
const GUARD: u32 = 2_000;

fn make_window(channel: u8, electrode: Electrode, wait_ticks: u32, width_ticks: u32) -> SequenceWindow {
    SequenceWindow { channel, electrode, wait_ticks, width_ticks }
}

fn any_windows() -> impl Strategy<Value = Vec<SequenceWindow>> {
    // Pauses from the shortest over those that are about as long as a blank period to those that need several.
    let wait =
        prop_oneof![GUARD..GUARD + 3, GUARD..12_000_u32, 6_990_u32..7_010, 60_000_u32..80_000, 2_000_u32..1_000_000];
    let width = prop_oneof![3_000_u32..3_003, 3_000_u32..56_034, 56_030_u32..56_034];
    let one = (0_u8..4, any::<bool>(), wait, width).prop_map(|(channel, is_a, wait, width)| {
        make_window(channel, if is_a { Electrode::A } else { Electrode::B }, wait, width)
    });
    prop::collection::vec(one, 1..=24)
}

/// What the pins have to do, worked out from the message alone: channel, electrode, first and last clock from the beginning.
fn expected_pulses(windows: &[SequenceWindow]) -> Vec<Vec<Pulse>> {
    let mut pulses = vec![Vec::new(); 4];
    let mut ends = [0_u64; 4];
    for window in windows {
        let channel = usize::from(window.channel);
        let from = ends[channel] + u64::from(window.wait_ticks);
        ends[channel] = from + u64::from(window.width_ticks);
        pulses[channel].push(Pulse { electrode: window.electrode, from: TICK * from, to: TICK * ends[channel] });
    }
    pulses
}

/// Timers that a device looks after, and the pulses that they make, by channel.
struct Player {
    model: ModelTimers,
    pulses: Vec<Vec<Pulse>>,
    now_us: u64,
    /// By how much the device looks late, in turn.
    lates_us: std::iter::Cycle<std::vec::IntoIter<u64>>,
}

impl Player {
    fn new(lates_us: Vec<u64>) -> Self {
        let model = ModelTimers::new(170, 5_000, OutputPair { a: 1, b: 3 });
        Self { model, pulses: vec![Vec::new(); 4], now_us: 5_000, lates_us: lates_us.into_iter().cycle() }
    }

    /// Looks at once, as a device does after a request, and then when it is due, until `end_us`.
    fn run_until(&mut self, end_us: u64) {
        let mut due_us = self.now_us;
        while self.now_us < end_us {
            self.now_us = due_us + self.lates_us.next().unwrap();
            let pulses = &mut self.pulses;
            let told = self.model.run_and_preload(self.now_us, |channel, pulse| match pulses[channel].last_mut() {
                Some(last) if last.electrode == pulse.electrode && last.to == pulse.from => last.to = pulse.to,
                _ => pulses[channel].push(pulse),
            });
            assert_eq!(told, Ok(()));
            let extra_us = self.model.sequencer.next_extra_poll_time_us_if_playing_or_too_near().unwrap_or(u64::MAX);
            due_us = extra_us.min(self.now_us + 1_000).max(self.now_us + 1);
        }
    }

    /// Plays windows as soon as that is possible; the windows, and the clock at which they begin.
    fn play_windows(&mut self, windows: &[SequenceWindow]) -> (PlacedWindows, u64) {
        let used = std::array::from_fn(|channel| windows.iter().any(|window| usize::from(window.channel) == channel));
        let start = self.model.sequencer.earliest_sequence_start_clock(used, self.now_us);
        let mut placed = PlacedWindows::from_sequence(&[make_channel_limits(); 4], windows).unwrap();
        placed.set_start_clock(start);
        self.model.sequencer.play_windows_at_their_times_ending_drives_at_next_boundary(&placed, self.now_us);
        (placed, start)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(support::reduce_case_count_under_miri(500)))]

    /// Whatever was driven before and however late the device looks (a request that it answers takes up to 0.25 ms), every window of every
    /// channel is where it was asked to be, to the clock, from one common clock edge on; and around them all guards are kept.
    #[test]
    fn windows_are_played_to_the_clock(
        before in prop::collection::vec((1_000_u32..400_000, 0_u32..1_000_000), 0..=4),
        windows in any_windows(),
        waits_us in prop::collection::vec(0_u64..5_000, 2),
        lates_us in prop::collection::vec(0_u64..250, 1..50),
    ) {
        let mut player = Player::new(lates_us);
        let goals: [Option<ChannelGoal>; 4] = std::array::from_fn(|channel| {
            let (frequency, phase) = *before.get(channel)?;
            let drive = ChannelDrive {
                frequency_millihertz: frequency,
                phase_microturns: phase,
                pulse_width_ppm: 300_000,
                ..make_drive(0)
            };
            let program = compute_channel_program(&make_channel_limits(), &drive).unwrap();
            Some(ChannelGoal { program, drives_without_envelope: true })
        });
        player.run_until(5_000 + waits_us[0]);
        player.model.sequencer.set_or_end_drives_from_next_boundary(&goals, player.now_us);
        player.run_until(player.now_us + waits_us[1] * 10);

        let (placed, start) = player.play_windows(&windows);
        let length_us = u64::from(placed.last_window_end_tick()) / 10;
        player.run_until(5_000 + start / 170 + length_us + 5_000);
        prop_assert_eq!(player.model.sequencer.first_channel_with_missed_window(), None);
        for (channel, expected) in expected_pulses(&windows).iter().enumerate() {
            // Nothing of what was driven before is cut short or too near; on channels without windows a last period goes on.
            prop_assert!(player.pulses[channel].windows(2).all(|two| two[1].from - two[0].to >= GUARD_CLOCKS));
            if expected.is_empty() {
                continue;
            }
            let expected: Vec<Pulse> = expected.iter().map(|pulse| Pulse { from: pulse.from + start, to: pulse.to + start, ..*pulse }).collect();
            let played: Vec<Pulse> = player.pulses[channel].iter().copied().filter(|pulse| pulse.from >= start).collect();
            prop_assert_eq!(&played, &expected, "channel {}", channel);
            prop_assert!(!player.model.sequencer.has_unfinished_window_sequence(channel) && !player.model.sequencer.is_active_or_preloaded_period_driving(channel));
        }
    }

    /// Drives that take the place of windows at any moment: the guard is kept between every window and the drives, and no window that has begun
    /// is cut short.
    #[test]
    fn drives_that_replace_playing_windows_keep_guards_and_whole_windows(
        windows in any_windows(),
        after in prop::collection::vec((10_000_u32..1_000_000, 0_u32..1_000_000, prop_oneof![20_000_u32..400_000, Just(1_000_000)]), 0..=4),
        replaced_at in 0.0_f64..1.2,
        lates_us in prop::collection::vec(0_u64..250, 1..50),
    ) {
        let mut player = Player::new(lates_us);
        player.run_until(8_000);
        let (placed, start) = player.play_windows(&windows);
        let length_us = f64::from(placed.last_window_end_tick()) / 10.0;
        let until_us = 5_000 + start / 170 + (length_us * replaced_at) as u64;
        player.run_until(until_us);
        let goals: [Option<ChannelGoal>; 4] = std::array::from_fn(|channel| {
            let (frequency, phase, width) = *after.get(channel)?;
            // What the guards leave of half a period of 5e11 ns over the frequency in mHz, as the widest window.
            let min_guard_ns = make_channel_limits().min_guard_ns;
            let guards_ppm = (f64::from(frequency) * f64::from(min_guard_ns) * 2e-6).ceil() as u32;
            let width = width.min(999_000 - guards_ppm);
            let drive = ChannelDrive {
                frequency_millihertz: frequency,
                phase_microturns: phase,
                pulse_width_ppm: width,
                ..make_drive(0)
            };
            let program = compute_channel_program(&make_channel_limits(), &drive).unwrap();
            Some(ChannelGoal { program, drives_without_envelope: true })
        });
        player.model.sequencer.set_or_end_drives_from_next_boundary(&goals, player.now_us);
        player.run_until(player.now_us + 300_000);
        for (channel, expected) in expected_pulses(&windows).iter().enumerate() {
            for two in player.pulses[channel].windows(2) {
                prop_assert!(two[1].from - two[0].to >= GUARD_CLOCKS, "channel {channel}: {two:?}");
            }
            // Windows are those that were asked for, from the first one on, until the drives begin.
            let expected = expected.iter().map(|pulse| Pulse { from: pulse.from + start, to: pulse.to + start, ..*pulse });
            let whole = player.pulses[channel].iter().zip(expected).take_while(|(played, asked)| *played == asked).count();
            let narrowest = after.get(channel).map_or(u64::MAX, |_| {
                let program = goals[channel].unwrap().program;
                u64::from(program.width) * u64::from(program.divider)
            });
            // The last one goes on.
            for pulse in player.pulses[channel][whole..].iter().rev().skip(1) {
                prop_assert!(pulse.to - pulse.from >= narrowest, "channel {channel}: {pulse:?} is neither a whole window nor of a drive");
            }
        }
    }

    /// What is refused is named with its limits, and what is not keeps them.
    #[test]
    fn any_sequence_is_refused_or_keeps_its_limits(
        windows in prop::collection::vec((0_u8..6, any::<bool>(), any::<u32>(), any::<u32>(), any::<bool>()), 0..=24),
        guard_ns in prop_oneof![Just(200_000_u32), 0_u32..2_000_000, any::<u32>()],
    ) {
        let windows: Vec<SequenceWindow> = windows.iter().map(|(channel, is_a, wait, width, is_good)| {
            let (wait, width) = if *is_good { (wait % 100_000 + 20_000, width % 40_000 + 3_000) } else { (*wait, *width) };
            make_window(*channel, if *is_a { Electrode::A } else { Electrode::B }, wait, width)
        }).collect();
        let limit = ChannelLimits { min_guard_ns: guard_ns, ..make_channel_limits() };
        let guard_ticks = u64::from(guard_ns.max(88_000)).div_ceil(100);
        match PlacedWindows::from_sequence(&[limit; 4], &windows) {
            Ok(mut placed) => {
                placed.set_start_clock(1_000_000);
                prop_assert!(!windows.is_empty());
                for window in &windows {
                    prop_assert!(window.channel < 4 && u64::from(window.wait_ticks) >= guard_ticks);
                }
                for (channel, pulses) in (0..4).zip(expected_pulses(&windows)) {
                    let (mut boundary, end) = (1_000_000, 1_000_000 + pulses.last().map_or(0, |pulse| pulse.to));
                    while let Some(period) = placed.period_from_boundary_unless_windows_over(channel, boundary) {
                        prop_assert!(period.ticks >= 2 && period.ticks <= 65_535, "{:?}", period);
                        prop_assert!(period.a.off.max(period.b.off) == 0 || u32::from(period.a.off.max(period.b.off)) < period.ticks);
                        boundary += period.length_clocks();
                        prop_assert!(boundary <= end + TICK * guard_ticks);
                    }
                    prop_assert!(boundary >= end);
                }
            }
            Err(SequenceError::Empty) => prop_assert!(windows.is_empty()),
            Err(SequenceError::NoSuchChannel { window, channels }) => prop_assert!(channels == 4 && windows[usize::from(window)].channel >= 4),
            Err(SequenceError::Width { window, requested_ticks, min_ticks, max_ticks }) => {
                prop_assert_eq!(windows[usize::from(window)].width_ticks, requested_ticks);
                prop_assert!(requested_ticks < min_ticks || requested_ticks > max_ticks);
            }
            Err(SequenceError::Wait { window, requested_ticks, min_ticks, max_ticks }) => {
                prop_assert_eq!(windows[usize::from(window)].wait_ticks, requested_ticks);
                prop_assert!(requested_ticks < min_ticks || requested_ticks > max_ticks);
            }
            Err(other) => prop_assert!(false, "{other:?}"),
        }
    }
}

fn make_play_windows_request(number: u32, windows: &[SequenceWindow]) -> Request {
    Request::PlayWindows(WindowSequence {
        number,
        start_us: 0,
        rail_millivolts: [500_000, 800_000],
        windows: Short::from_slice(windows).unwrap(),
    })
}

/// 1 ms of A, then 1.5 ms of B, on two channels.
fn make_click_windows() -> [SequenceWindow; 4] {
    [
        make_window(0, Electrode::A, 2_000, 10_000),
        make_window(0, Electrode::B, 5_000, 15_000),
        make_window(1, Electrode::B, 12_000, 10_000),
        make_window(1, Electrode::A, 2_000, 15_000),
    ]
}

#[test]
fn a_sequence_waits_for_its_rails_is_played_once_and_ends() {
    let mut bench = Bench::new();
    let refusal = bench.send_request(&make_play_windows_request(1, &make_click_windows()));
    assert!(matches!(refusal, Reply::Refused(Refusal::State { state: SafetyState::Safe, .. })), "{refusal:?}");
    bench.arm_and_await_armed();
    let asked_us = bench.board.now_us;
    let Reply::WindowsPlaying { start_us } = bench.send_request(&make_play_windows_request(7, &make_click_windows()))
    else {
        panic!()
    };
    // The rails rise by 20 V/ms from 50 V, and settle for 10 ms.
    assert!(start_us >= asked_us + 37_500 + 10_000 && start_us < asked_us + 60_000, "{}", start_us - asked_us);
    assert_eq!(bench.state(), SafetyState::Running);
    bench.wait_ms(5);
    assert_eq!(
        bench.send_request(&make_play_windows_request(7, &make_click_windows())),
        Reply::WindowsPlaying { start_us },
        "the same again is the same"
    );
    bench.wait_ms((start_us - bench.board.now_us) / 1000);
    assert!((bench.board.circuit.rails[1] - 800_000.0).abs() < 8_000.0, "{:?}", bench.board.circuit.rails);
    bench.wait_ms(10);
    let of = |channel: usize| {
        let windows =
            bench.board.preloads.iter().filter(move |it| it.channel == channel && !it.period.has_no_windows());
        windows.map(|it| {
            let (which, window) =
                if it.period.a.off > 0 { (Electrode::A, it.period.a) } else { (Electrode::B, it.period.b) };
            (which, it.at + TICK * u64::from(window.on), TICK * u64::from(window.off - window.on))
        })
    };
    let (first, second): (Vec<_>, Vec<_>) = (of(0).collect(), of(1).collect());
    let zero = first[0].1 - TICK * 2_000;
    assert_eq!(
        first,
        [(Electrode::A, zero + TICK * 2_000, TICK * 10_000), (Electrode::B, zero + TICK * 17_000, TICK * 15_000)]
    );
    assert_eq!(
        second,
        [(Electrode::B, zero + TICK * 12_000, TICK * 10_000), (Electrode::A, zero + TICK * 24_000, TICK * 15_000)]
    );
    bench.wait_ms(5);
    assert_eq!(bench.state(), SafetyState::Armed, "nothing is driven any more");
    assert!(!bench.board.is_any_channel_driven());
    let count = bench.board.preloads.len();
    assert_eq!(
        bench.send_request(&make_play_windows_request(7, &make_click_windows())),
        Reply::WindowsPlaying { start_us }
    );
    bench.wait_ms(100);
    assert_eq!(bench.board.preloads.len(), count, "a repeated request plays nothing");
}

#[test]
fn a_sequence_is_refused_as_a_whole() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let mut ask = |change: &dyn Fn(&mut WindowSequence)| {
        let Request::PlayWindows(mut asked) = make_play_windows_request(9, &make_click_windows()) else { panic!() };
        change(&mut asked);
        let Reply::Refused(refusal) = bench.send_request(&Request::PlayWindows(asked)) else { panic!() };
        refusal
    };
    let too_high = SequenceError::Voltage { rail: 2, requested_millivolts: 2_000_001, max_millivolts: 2_000_000 };
    assert_eq!(ask(&|it| it.rail_millivolts[1] = 2_000_001), Refusal::Sequence(too_high));
    let narrow = SequenceError::Width { window: 3, requested_ticks: 2_999, min_ticks: 3_000, max_ticks: 56_034 };
    assert_eq!(ask(&|it| it.windows[3].width_ticks = 2_999), Refusal::Sequence(narrow));
    let early = SequenceError::Wait { window: 1, requested_ticks: 1_999, min_ticks: 2_000, max_ticks: 10_000_000 };
    assert_eq!(ask(&|it| it.windows[1].wait_ticks = 1_999), Refusal::Sequence(early));
    let long = SequenceError::TooLong { requested_ms: 2_003, max_ms: 2_000 };
    let lasts = |it: &mut WindowSequence| {
        it.windows[2].wait_ticks = 10_000_000;
        it.windows[3].wait_ticks = 10_000_000;
    };
    assert_eq!(ask(&lasts), Refusal::Sequence(long));
    // 24 windows of 2 kV in 12.5 ms, of which 20 begin within 10 ms: 20 x 116 pF x 2 kV / 10 ms are 464 uA; of two channels twice as much,
    // and the bleeders of both rails take 80 uA.
    let crowd = |it: &mut WindowSequence| {
        it.rail_millivolts = [2_000_000; 2];
        it.windows = (0..24).map(|i| make_window(i % 2, Electrode::A, 2_000, 3_000)).collect();
    };
    let Refusal::Current { requested_microamps, max_microamps: 500 } = ask(&crowd) else { panic!() };
    assert!((600..=640).contains(&requested_microamps), "{requested_microamps}");
    // The same on one rail, while the other one is at 50 V: each window counts at the voltage of its own rail.
    for rail in 0..2 {
        let own: Vec<u8> = (0..4).filter(|channel| rail_index_of_channel(usize::from(*channel)) == rail).collect();
        let crowd = |it: &mut WindowSequence| {
            it.rail_millivolts = [50_000; 2];
            it.rail_millivolts[rail] = 2_000_000;
            it.windows = (0..24).map(|i| make_window(own[i % own.len()], Electrode::A, 2_000, 3_000)).collect();
        };
        let Refusal::Current { requested_microamps, max_microamps: 500 } = ask(&crowd) else { panic!("rail {rail}") };
        assert!((560..=640).contains(&requested_microamps), "{requested_microamps}");
    }
    assert!(matches!(ask(&|it| it.start_us = 1), Refusal::Start { start_us: 1, .. }));
    let now_us = bench.board.now_us;
    let mut soon = |start_us: u64| {
        let Request::PlayWindows(asked) = make_play_windows_request(10, &make_click_windows()) else { panic!() };
        bench.send_request(&Request::PlayWindows(WindowSequence { start_us, ..asked }))
    };
    assert!(matches!(soon(now_us + 20_000), Reply::Refused(Refusal::Start { .. })), "the rails are not there by then");
    assert_eq!(soon(now_us + 100_000), Reply::WindowsPlaying { start_us: now_us + 100_000 });
    assert_eq!(
        bench.send_request_on_link(1, &make_play_windows_request(1, &make_click_windows())),
        Reply::Refused(Refusal::OtherLink)
    );
}

/// A supply as slow as it may be holds its rail up while it falls itself, against the discharge switch: the board waits for both, and does not
/// take the rail for a wrong one.
#[test]
fn windows_wait_for_a_slow_supply_whose_rail_is_lowered() {
    for volts in [60, 100, 200, 400, 500, 700, 1_000, 1_500] {
        let mut bench = Bench::new();
        bench.board.circuit.parts.follow_us = f64::from(SUPPLY_TIME_CONSTANT_MICROSECONDS);
        bench.arm_and_await_armed();
        let drive = ChannelDrive { voltage_millivolts: 2_000_000, ..make_drive(0) };
        bench.send_request(&Request::SetDrives { drives: Short::from_slice(&[drive]).unwrap() });
        for _ in 0..20 {
            bench.wait_ms(10);
            bench.send_request(&Request::KeepAlive);
        }
        assert!(bench.board.circuit.rails[0] > 1_990_000.0, "{:?}", bench.board.circuit.rails);
        let Request::PlayWindows(asked) = make_play_windows_request(1, &make_click_windows()) else { panic!() };
        let rail_millivolts = [volts * 1_000, 50_000];
        let windows = asked.windows.iter().filter(|window| window.channel == 0).copied().collect();
        let asked = WindowSequence { rail_millivolts, windows, ..asked };
        let reply = bench.send_request(&Request::PlayWindows(asked));
        let Reply::WindowsPlaying { start_us } = reply else { panic!("{volts} V: {reply:?}") };
        while bench.board.now_us + 1_000 < start_us {
            bench.wait_ms(1);
        }
        let (is, set) = (bench.board.circuit.rails[0] / 1e3, f64::from(volts));
        assert!(is <= 1.05 * set + 40.0, "{is} V for {set} V when the windows begin");
        for _ in 0..10 {
            bench.wait_ms(10);
            bench.send_request(&Request::KeepAlive);
        }
        let Reply::Faults { latched } = bench.send_request(&Request::Faults) else { panic!() };
        assert_eq!(latched, None, "{volts} V");
    }
}

/// Whatever start a host asks for, even one whose clocks do not fit into 64 bits, it gets an answer.
#[test]
fn a_start_that_is_too_far_away_is_refused() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let latest_us = bench.board.now_us + 10_000_000;
    for start_us in [latest_us + 1, 1 << 40, u64::MAX / 170, u64::MAX / 170 + 10_000_000, 1 << 60, u64::MAX] {
        let Request::PlayWindows(asked) = make_play_windows_request(1, &make_click_windows()) else { panic!() };
        let reply = bench.send_request(&Request::PlayWindows(WindowSequence { start_us, ..asked }));
        assert!(
            matches!(reply, Reply::Refused(Refusal::Start { start_us: told, .. }) if told == start_us),
            "{reply:?}"
        );
    }
    let Request::PlayWindows(asked) = make_play_windows_request(1, &make_click_windows()) else { panic!() };
    let reply = bench.send_request(&Request::PlayWindows(WindowSequence { start_us: latest_us, ..asked }));
    assert!(matches!(reply, Reply::WindowsPlaying { .. }), "{reply:?}");
}

/// A window that cannot be prepared in time would come at another time: everything goes off.
#[test]
fn a_missed_window_is_a_fault() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    let Reply::WindowsPlaying { start_us } = bench.send_request(&make_play_windows_request(1, &make_click_windows()))
    else {
        panic!()
    };
    bench.wait_ms((start_us - bench.board.now_us) / 1000);
    // The device does not look for 4 ms.
    bench.board.now_us += 4_000;
    bench.wait_ms(1);
    let Reply::Faults { latched: Some(fault) } = bench.send_request(&Request::Faults) else { panic!() };
    assert_eq!(fault.code, FaultCode::DriveFailed);
    assert!(!bench.board.is_live());
}

#[test]
fn a_stop_ends_a_sequence_and_drives_replace_it() {
    let mut bench = Bench::new();
    bench.arm_and_await_armed();
    bench.send_request(&make_play_windows_request(1, &make_click_windows()));
    bench.wait_ms(20);
    assert!(matches!(bench.send_request(&make_two_drives_request()), Reply::DrivesSet { .. }));
    bench.wait_ms(60);
    let plays =
        |bench: &Bench| bench.board.preloads.iter().any(|it| it.period.divider == 17 && !it.period.has_no_windows());
    assert!(!plays(&bench) && bench.board.is_any_channel_driven(), "the drives, and no window");
    bench.send_request(&make_play_windows_request(2, &make_click_windows()));
    bench.wait_ms(20);
    assert_eq!(bench.send_request(&Request::Stop), Reply::Stopped);
    assert!(!bench.board.is_live());
    bench.wait_ms(100);
    assert!(!bench.board.is_live() && bench.board.preloads.is_empty());
}
