//! Running timers from one drive to the next, seen at the electrodes' pins: the model of the timers is preloaded as the
//! board's would be, at times that jitter.

mod support;

use era_shared::protocol::ChannelDrive;
use era_shared::waveform::{
    ChannelGoal, Effect, Electrode, FULL_STRENGTH, IDLE, ModelTimers, OutputPair, Pulse, Segment, TimerPreload,
    compute_channel_program,
};
use proptest::prelude::*;
use support::make_channel_limits;

const OUTPUTS: OutputPair = OutputPair { a: 1, b: 3 };
const CLOCKS_PER_US: u64 = 170;
/// 200 us.
const GUARD_CLOCKS: u64 = 200 * CLOCKS_PER_US;

/// The timers of a board and what their pins did, pulse by pulse.
struct Timers {
    model: ModelTimers,
    pulses: Vec<Vec<Pulse>>,
    now_us: u64,
}

/// Registers that are written later than 5 us before their boundary may take effect a period too late.
#[test]
fn a_preload_that_is_nearer_than_5_us_to_its_boundary_is_too_late() {
    let at_us = |at_us: u64| TimerPreload { channel: 0, period: IDLE, at: at_us * CLOCKS_PER_US };
    assert!(!at_us(1_000).is_too_late_to_write(900, CLOCKS_PER_US));
    assert!(!at_us(1_000).is_too_late_to_write(995, CLOCKS_PER_US));
    assert!(at_us(1_000).is_too_late_to_write(996, CLOCKS_PER_US));
    assert!(at_us(1_000).is_too_late_to_write(1_001, CLOCKS_PER_US), "its boundary has passed");
    let day_us = 86_400_000_000;
    assert!(!at_us(day_us).is_too_late_to_write(day_us - 5, CLOCKS_PER_US));
    assert!(at_us(day_us).is_too_late_to_write(day_us - 4, CLOCKS_PER_US));
    assert!(at_us(1).is_too_late_to_write(u64::MAX, CLOCKS_PER_US));
}

impl Timers {
    const STARTED_US: u64 = 5_000;

    fn new() -> Self {
        let model = ModelTimers::new(170, Self::STARTED_US, OUTPUTS);
        Self { model, pulses: vec![Vec::new(); 4], now_us: Self::STARTED_US }
    }

    fn run_model_and_record_pulses(&mut self) {
        let pulses = &mut self.pulses;
        let told = self.model.run_and_preload(self.now_us, |channel, pulse| match pulses[channel].last_mut() {
            // A pulse that was going on when the model last stopped is told in two parts.
            Some(last) if last.electrode == pulse.electrode && last.to == pulse.from => last.to = pulse.to,
            _ => pulses[channel].push(pulse),
        });
        assert_eq!(told, Ok(()));
    }

    fn run_ms(&mut self, milliseconds: u64) {
        let end = self.now_us + 1000 * milliseconds;
        while self.now_us < end {
            self.now_us = (self.now_us + 1000).min(
                self.model
                    .sequencer
                    .next_extra_poll_time_us_if_playing_or_too_near()
                    .unwrap_or(u64::MAX)
                    .max(self.now_us + 1),
            );
            self.run_model_and_record_pulses();
        }
    }

    fn set_drives(&mut self, drives: &[ChannelDrive], drives_without_envelope: bool) {
        let mut goals = [None; 4];
        for drive in drives {
            goals[usize::from(drive.channel)] = Some(ChannelGoal {
                program: compute_channel_program(&make_channel_limits(), drive).unwrap(),
                drives_without_envelope,
            });
        }
        self.model.sequencer.set_or_end_drives_from_next_boundary(&goals, self.now_us);
        self.run_model_and_record_pulses();
    }

    fn clear_recorded_pulses(&mut self) {
        self.pulses.iter_mut().for_each(Vec::clear);
    }

    /// Centres of A's last pulse, in half clocks.
    fn find_last_a_pulse_centre_half_clocks(&self, channel: usize) -> u64 {
        let pulse = self.pulses[channel].iter().rev().skip(1).find(|pulse| pulse.electrode == Electrode::A).unwrap();
        pulse.from + pulse.to
    }

    fn check_overlap_and_guards(&self) {
        for check in &self.model.checks {
            assert_eq!(check.overlap, 0);
            assert!(check.least_guard.is_none_or(|guard| guard >= GUARD_CLOCKS), "{check:?}");
        }
    }
}

fn make_drive(channel: u8, frequency_millihertz: u32, phase_microturns: u32) -> ChannelDrive {
    ChannelDrive { frequency_millihertz, phase_microturns, pulse_width_ppm: 400_000, ..support::make_drive(channel) }
}

/// How far the phase of channel 1 against channel 0 is from what was asked, in ticks.
fn measure_phase_error_ticks(timers: &Timers, first: &ChannelDrive, second: &ChannelDrive) -> f64 {
    let planned = compute_channel_program(&make_channel_limits(), first).unwrap();
    let clocks = planned.period_clocks() as f64;
    let later = (timers.find_last_a_pulse_centre_half_clocks(0) as f64
        - timers.find_last_a_pulse_centre_half_clocks(1) as f64)
        / 2.0;
    let asked = (f64::from(second.phase_microturns) - f64::from(first.phase_microturns)) / 1e6;
    let turns = (later / clocks - asked + 0.5).rem_euclid(1.0) - 0.5;
    turns.abs() * f64::from(planned.ticks)
}

#[test]
fn a_drive_begins_within_two_ms_and_ends_at_a_boundary() {
    let mut timers = Timers::new();
    timers.run_ms(3);
    let began = (timers.now_us - Timers::STARTED_US) * CLOCKS_PER_US;
    timers.set_drives(&[make_drive(0, 150_000, 0)], true);
    timers.run_ms(100);
    let planned = compute_channel_program(&make_channel_limits(), &make_drive(0, 150_000, 0)).unwrap();
    let first = timers.pulses[0][0];
    assert_eq!(first.electrode, Electrode::A);
    let boundary = first.from - u64::from(planned.full_level_period().a.on) * u64::from(planned.divider);
    assert!(boundary > began && boundary <= began + 2 * 170_000, "{boundary} {began}");
    assert!(timers.pulses[1].is_empty());
    timers.set_drives(&[], true);
    timers.run_ms(20);
    timers.clear_recorded_pulses();
    timers.run_ms(50);
    assert!(timers.pulses[0].is_empty() && !timers.model.sequencer.is_active_or_preloaded_period_driving(0));
    timers.check_overlap_and_guards();
    let width = u64::from(planned.width) * u64::from(planned.divider);
    assert_eq!(timers.model.checks[0].least_pulse, Some(width), "no pulse was cut short");
}

#[test]
fn an_unchanged_drive_goes_on_undisturbed() {
    let mut timers = Timers::new();
    let (first, second) = (make_drive(0, 100_000, 0), make_drive(1, 100_000, 250_000));
    timers.set_drives(&[first, second], true);
    timers.run_ms(200);
    let before = timers.pulses[0].len();
    let expected = timers.find_last_a_pulse_centre_half_clocks(0) / 2;
    // The other channel changes its phase, its width, then its frequency; a third one comes.
    timers.set_drives(&[first, make_drive(1, 100_000, 500_000)], true);
    timers.run_ms(100);
    timers.set_drives(
        &[
            first,
            ChannelDrive { pulse_width_ppm: 200_000, ..make_drive(1, 100_000, 500_000) },
            make_drive(2, 77_000, 0),
        ],
        true,
    );
    timers.run_ms(100);
    let period = compute_channel_program(&make_channel_limits(), &first).unwrap().period_clocks();
    let told: Vec<_> = timers.pulses[0][before..].iter().filter(|pulse| pulse.electrode == Electrode::A).collect();
    assert!(told.len() >= 18);
    for pulse in told {
        assert_eq!(((pulse.from + pulse.to) / 2).abs_diff(expected) % period, 0, "still on its own lattice");
    }
    timers.check_overlap_and_guards();
}

#[test]
fn a_click_has_its_cycles_and_its_brake() {
    for frequency_millihertz in [40_000, 150_000, 333_300, 700_000, 999_999] {
        let mut timers = Timers::new();
        timers.set_drives(&[make_drive(0, frequency_millihertz, 0)], false);
        timers.run_ms(50);
        assert!(timers.pulses[0].is_empty(), "prepared is silent");
        assert!(timers.model.sequencer.queue_effect_if_goal_and_queue_not_full(
            0,
            timers.now_us + 7_300,
            &Effect::new_click(3, 2)
        ));
        timers.run_ms(200);
        let electrodes: Vec<_> = timers.pulses[0].iter().map(|pulse| pulse.electrode).collect();
        use Electrode::{A, B};
        assert_eq!(electrodes, [A, B, A, B, A, B, B, A, B, A], "at {frequency_millihertz} mHz");
        let planned = compute_channel_program(&make_channel_limits(), &make_drive(0, frequency_millihertz, 0)).unwrap();
        let start = (50_000 + 7_300) * CLOCKS_PER_US;
        let boundary =
            timers.pulses[0][0].from - u64::from(planned.full_level_period().a.on) * u64::from(planned.divider);
        assert!(boundary >= start && boundary < start + planned.period_clocks(), "the first boundary after its start");
        timers.check_overlap_and_guards();
    }
}

#[test]
fn ramps_widen_and_trains_pulse() {
    let mut timers = Timers::new();
    timers.set_drives(&[make_drive(0, 200_000, 0)], false);
    timers.run_ms(5);
    assert!(timers.model.sequencer.queue_effect_if_goal_and_queue_not_full(
        0,
        timers.now_us,
        &Effect::new_swell(50, 20, 50)
    ));
    timers.run_ms(150);
    let widths: Vec<u64> = timers.pulses[0].iter().map(|pulse| pulse.to - pulse.from).collect();
    let top = widths.iter().position(|width| width == widths.iter().max().unwrap()).unwrap();
    assert!(widths[..top].is_sorted() && top >= 18, "{widths:?}");
    assert!(widths[top..].is_sorted_by(|one, next| one >= next));
    // A force of half the height: sin(pi w / 2) halves. The ramp's middle of 50 ms is between cycles 4 and 5.
    let planned = compute_channel_program(&make_channel_limits(), &make_drive(0, 200_000, 0)).unwrap();
    let force = |width: u64| {
        let part = 2.0 * width as f64 / planned.period_clocks() as f64;
        (std::f64::consts::FRAC_PI_2 * part).sin()
    };
    let half = force(widths[2 * 4]) / force(widths[top]);
    assert!((half - 0.45).abs() < 0.06, "{half}");
    timers.clear_recorded_pulses();
    assert!(timers.model.sequencer.queue_effect_if_goal_and_queue_not_full(
        0,
        timers.now_us,
        &Effect::new_pulse_train(20, 30, 3)
    ));
    timers.run_ms(300);
    let gaps = timers.pulses[0].windows(2).filter(|pair| pair[1].from - pair[0].to > 20_000 * CLOCKS_PER_US).count();
    assert_eq!((timers.pulses[0].len(), gaps), (3 * 4 * 2, 2), "4 cycles of 5 ms, three times");
    timers.check_overlap_and_guards();
}

#[test]
fn effects_are_checked_and_queued_in_order() {
    let nothing = Effect::default();
    assert!(!nothing.is_valid());
    assert!(!Effect { times: 0, ..Effect::new_click(1, 0) }.is_valid());
    assert!(!Effect { times: 1_001, ..Effect::new_click(1, 0) }.is_valid());
    for level in [-1_001, 1_001, i16::MIN, i16::MAX] {
        let segments = [Segment::Hold { level, milliseconds: 1 }].into_iter().collect();
        assert!(!Effect { segments, times: 1 }.is_valid());
    }
    let mut timers = Timers::new();
    assert!(
        !timers.model.sequencer.queue_effect_if_goal_and_queue_not_full(0, timers.now_us, &Effect::new_click(1, 0)),
        "no drive"
    );
    timers.set_drives(&[make_drive(0, 500_000, 0)], false);
    let now_us = timers.now_us;
    for (start_ms, cycles) in [(90, 4), (30, 2), (60, 3), (10, 1)] {
        assert!(timers.model.sequencer.queue_effect_if_goal_and_queue_not_full(
            0,
            now_us + 1000 * start_ms,
            &Effect::new_click(cycles, 0)
        ));
    }
    assert!(
        !timers.model.sequencer.queue_effect_if_goal_and_queue_not_full(0, now_us, &Effect::new_click(1, 0)),
        "four wait"
    );
    timers.run_ms(200);
    let starts: Vec<u64> = timers.pulses[0].iter().map(|pulse| pulse.from / 170_000).collect();
    assert_eq!(starts.len(), 2 * (1 + 2 + 3 + 4));
    assert!(starts.is_sorted());
    assert_eq!(starts.iter().filter(|at| (30..60).contains(*at)).count(), 4);
}

#[test]
fn a_lower_voltage_than_the_rails_narrows_the_windows_to_the_same_force() {
    let mut timers = Timers::new();
    timers.set_drives(&[make_drive(0, 100_000, 0)], true);
    timers.model.sequencer.set_force_fraction_q16_of_drive_windows(0, FULL_STRENGTH / 4);
    timers.run_ms(50);
    let planned = compute_channel_program(&make_channel_limits(), &make_drive(0, 100_000, 0)).unwrap();
    let angle = |ticks: f64| std::f64::consts::PI * ticks / f64::from(planned.ticks);
    let width = timers.model.checks[0].least_pulse.unwrap() as f64 / f64::from(planned.divider);
    let ratio = angle(width).sin() / angle(f64::from(planned.width)).sin();
    assert!((ratio - 0.25).abs() < 1e-4, "{ratio}");
    timers.model.sequencer.set_force_fraction_q16_of_drive_windows(0, 0);
    timers.run_ms(20);
    assert!(!timers.model.sequencer.is_active_or_preloaded_period_driving(0));
}

fn any_drive(channel: u8) -> impl Strategy<Value = ChannelDrive> {
    // Few frequencies, so that they often meet; the whole range; and its ends.
    let frequency = prop_oneof![Just(100_000_u32), Just(1_000_000), Just(173_300), 1_000_u32..=1_000_000, Just(20_000)];
    (frequency, 0_u32..1_000_000, 1_000_u32..590_000).prop_map(
        move |(frequency_millihertz, phase_microturns, pulse_width_ppm)| ChannelDrive {
            channel,
            frequency_millihertz,
            phase_microturns,
            pulse_width_ppm,
            voltage_millivolts: 1_000_000,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(support::reduce_case_count_under_miri(3_000)))]

    /// Any drives after any others, at any time, with polls that come late: never both on, never less than the guard, never a
    /// pulse shorter than one that was asked for.
    #[test]
    fn any_changes_keep_guards_and_whole_pulses(
        steps in prop::collection::vec((prop::array::uniform4(any::<bool>()), (any_drive(0), any_drive(1), any_drive(2), any_drive(3)), 1_u64..40, 0_u64..999, 0_u64..3_000), 1..12)
    ) {
        let mut timers = Timers::new();
        let mut narrowest = u64::MAX;
        for (on, drives, wait_ms, offset_us, late_us) in steps {
            let all = [drives.0, drives.1, drives.2, drives.3];
            let chosen: Vec<_> = all.into_iter().zip(on).filter(|(_, on)| *on).map(|(drive, _)| drive).collect();
            for drive in &chosen {
                let planned = compute_channel_program(&make_channel_limits(), drive).unwrap();
                narrowest = narrowest.min(u64::from(planned.width) * u64::from(planned.divider));
            }
            timers.set_drives(&chosen, true);
            timers.run_ms(wait_ms);
            // Once a poll is late.
            timers.now_us += offset_us + late_us;
            timers.run_model_and_record_pulses();
        }
        timers.run_ms(20);
        timers.check_overlap_and_guards();
        for check in &timers.model.checks {
            prop_assert!(check.least_pulse.is_none_or(|pulse| pulse >= narrowest), "{:?} {}", check, narrowest);
        }
    }

    /// Channels at one frequency have the commanded phase to a tick, whatever they did before, and keep it.
    #[test]
    fn equal_frequencies_keep_their_phase(
        before in (any_drive(0), any_drive(1)), frequency_millihertz in 20_000_u32..=1_000_000,
        phases in prop::array::uniform2(0_u32..1_000_000), later in 0_u32..1_000_000, wait_ms in 0_u64..50
    ) {
        let mut timers = Timers::new();
        timers.set_drives(&[before.0, before.1], true);
        timers.run_ms(wait_ms);
        let first = make_drive(0, frequency_millihertz, phases[0]);
        let second = make_drive(1, frequency_millihertz, phases[1]);
        timers.set_drives(&[first, second], true);
        // A period of 1 Hz may have to end first.
        timers.run_ms(1_300);
        timers.clear_recorded_pulses();
        timers.run_ms(400);
        let error = measure_phase_error_ticks(&timers, &first, &second);
        prop_assert!(error <= 1.0, "{error} ticks");
        // One of them is given another phase while the other goes on.
        let second = make_drive(1, frequency_millihertz, later);
        timers.set_drives(&[first, second], true);
        timers.run_ms(300);
        timers.clear_recorded_pulses();
        timers.run_ms(2_000);
        let error = measure_phase_error_ticks(&timers, &first, &second);
        prop_assert!(error <= 1.0, "{error} ticks after a change");
        timers.check_overlap_and_guards();
    }
}
