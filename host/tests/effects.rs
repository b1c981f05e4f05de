//! Effects as designed against effects as played: the same frames that a board gets, on a panel in time.

mod support;

use era::device::convert::drive_to_wire;
use era::device::sim::{Clock, STEP_S, SimBoard, SimPanel};
use era::effects::{Design, EffectRequest, Intensity, NamedEffect, design, intensity, plan_with};
use era::planner::rise::RiseTimes;
use era::planner::{self, PlanTable, STANDARD_GRAVITY, Target};
use era::scene::{EXAMPLE_BAR, EXAMPLE_PLATE};
use era_shared::device::{Device, LinkReceiver};
use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{CURRENT_VERSION, Reply, Request};
use era_shared::safety::LinkId;
use era_shared::waveform::{Effect, Segment};

/// How long after the start is recorded, in s.
const RECORD_S: f64 = 0.5;

/// A device on a clock that is set by hand.
struct Bench {
    device: Device,
    board: SimBoard,
    port: LinkReceiver,
    sequence: u16,
    time_us: u64,
}

impl Bench {
    fn new(table: &PlanTable, target: &Target) -> Self {
        let volts: Vec<f64> = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
        let mut panel = SimPanel::from_plan_table(table);
        panel.place_accelerometer(&intensity::shape_of(table, target.x_m, target.y_m));
        let mut board = SimBoard::new(panel, &volts, Clock::Manual(0));
        let mut device = Device::new();
        device.complete_boot(&mut board);
        Self { device, board, port: LinkReceiver::new(LinkId(0)), sequence: 0, time_us: 0 }
    }

    fn ask(&mut self, request: &Request) -> Reply {
        self.sequence += 1;
        let mut frame = [0; MAX_ENCODED];
        let length = encode_frame(CURRENT_VERSION, FrameKind::Request, self.sequence, request, &mut frame).unwrap();
        let mut answers = Vec::new();
        self.device
            .receive_bytes(&mut self.board, &mut self.port, &frame[..length], |bytes| answers.extend_from_slice(bytes));
        let mut reply = None;
        Decoder::new().feed_bytes(&answers, |frame| reply = postcard::from_bytes::<Reply>(frame.unwrap().body).ok());
        reply.unwrap()
    }

    fn run_to(&mut self, end_us: u64) {
        while self.time_us < end_us {
            let keep_alive_us = (self.time_us + 50_000).min(end_us);
            while self.time_us < keep_alive_us {
                let due_us = self.device.poll_next_due_us(&mut self.board);
                self.time_us = due_us.clamp(self.time_us + 1, keep_alive_us);
                self.board.set_time_us(self.time_us);
            }
            self.device.poll_next_due_us(&mut self.board);
            self.board.advance_panel_to_now();
            self.ask(&Request::KeepAlive);
        }
    }

    /// The accelerometer's record in m/s^2 from `start_us` on, the effects' start; rails are up long before.
    fn play(&mut self, design: &Design, effects: &[Effect], start_us: u64) -> Vec<f64> {
        self.ask(&Request::ArmWith { deadman_ms: None, burst_ms: None });
        self.run_to(100_000);
        let prepared = self.ask(&Request::Prepare { drives: design.wire_drives().iter().map(drive_to_wire).collect() });
        assert!(matches!(prepared, Reply::Prepared { .. }), "{prepared:?}");
        self.run_to(start_us - 20_000);
        for (channel, effect) in (0..).zip(effects) {
            assert_eq!(self.ask(&Request::Play { channel, start_us, effect: effect.clone() }), Reply::Playing);
        }
        self.run_to(start_us);
        self.board.panel_mut().accelerometer.start_record();
        self.run_to(start_us + (RECORD_S * 1e6) as u64);
        self.board.panel_mut().accelerometer.take_record()
    }
}

fn largest(record: &[f64]) -> f64 {
    record.iter().fold(0.0, |most, x| most.max(x.abs()))
}

/// When a record has fallen below `quiet` for good, in ms.
fn quiet_ms(record: &[f64], quiet: f64) -> f64 {
    record.iter().rposition(|x| x.abs() > quiet).unwrap_or(0) as f64 * STEP_S * 1e3
}

/// The effects up to their first segment: clicks without brakes.
fn unbraked(design: &Design) -> Vec<Effect> {
    let first = |drive: &era::effects::design::DesignedDrive| {
        let push = drive.effect.segments[0];
        assert!(matches!(push, Segment::Cycles { level: 1000, .. }), "{push:?}");
        Effect { segments: [push].into_iter().collect(), times: 1 }
    };
    design.drives.iter().map(first).collect()
}

#[test]
fn clicks_do_what_is_predicted() {
    let places = [
        (EXAMPLE_PLATE, 0.15, 0.06, 0.4),
        (EXAMPLE_PLATE, 0.08, 0.1, 0.3),
        (EXAMPLE_BAR, 0.06, 0.01, 0.5),
        (EXAMPLE_BAR, 0.15, 0.01, 0.5),
    ];
    let mut sooner = 0;
    for (scene, x_m, y_m, g) in places {
        let table = support::table(scene);
        let rise = RiseTimes::prepare(&table.model).unwrap();
        let target = Target { x_m, y_m, intensity_g: None };
        let plan =
            plan_with(&table, || Some(&rise), &planner::Request::touch(&[target]), Some(Intensity::G(g))).unwrap();
        let design = design(&table, &rise, &plan, EffectRequest::of(NamedEffect::Click)).unwrap();
        let predicted = design.predicted;
        if design.limited_by.is_none() {
            assert!((predicted.peak_g - g).abs() < 0.02 * g, "{predicted:?}");
        }
        let effects: Vec<Effect> = design.drives.iter().map(|drive| drive.effect.clone()).collect();
        let (mut peaks, mut braked_ms, mut plain_ms) = (Vec::new(), 0.0, 0.0);
        // Cycles fall together otherwise at each start.
        for start_us in [400_000, 403_100, 407_700, 411_900] {
            let record = Bench::new(&table, &target).play(&design, &effects, start_us);
            peaks.push(largest(&record) / STANDARD_GRAVITY);
            let quiet = 0.1 * predicted.peak_g * STANDARD_GRAVITY;
            braked_ms += quiet_ms(&record, quiet) / 4.0;
            let plain = Bench::new(&table, &target).play(&design, &unbraked(&design), start_us);
            plain_ms += quiet_ms(&plain, quiet) / 4.0;
        }
        let mean: f64 = peaks.iter().sum::<f64>() / 4.0;
        assert!((mean / predicted.peak_g - 1.0).abs() < 0.15, "{mean} g, {predicted:?}");
        for peak in peaks {
            let range = 0.85 * predicted.peak_least_g..1.15 * predicted.peak_most_g;
            assert!(range.contains(&peak), "{peak} g, {predicted:?}");
        }
        // Where there is a brake it must not make things worse, and mostly make them better.
        assert!(braked_ms < 1.1 * plain_ms + 5.0, "quiet after {braked_ms} ms, {plain_ms} ms unbraked");
        sooner += u32::from(braked_ms < 0.9 * plain_ms);
    }
    assert!(sooner >= 3, "brakes shorten the decay at {sooner} of {} places", places.len());
}

#[test]
fn even_effects_are_as_strong_as_planned() {
    let table = support::table(EXAMPLE_BAR);
    let rise = RiseTimes::prepare(&table.model).unwrap();
    let target = Target { x_m: 0.06, y_m: 0.01, intensity_g: Some(0.5) };
    let plan = plan_with(&table, || Some(&rise), &planner::Request::touch(&[target]), None).unwrap();
    for effect in [NamedEffect::Buzz, NamedEffect::PulseTrain, NamedEffect::Texture] {
        let design = design(&table, &rise, &plan, EffectRequest::of(effect)).unwrap();
        let effects: Vec<Effect> = design.drives.iter().map(|drive| drive.effect.clone()).collect();
        let peak = largest(&Bench::new(&table, &target).play(&design, &effects, 400_000)) / STANDARD_GRAVITY;
        let predicted = design.predicted;
        assert!((0.85 * predicted.peak_least_g..1.15 * predicted.peak_most_g).contains(&peak), "{peak}, {predicted:?}");
        for (drive, planned) in design.drives.iter().zip(&plan.drives) {
            assert!(drive.drive.voltage_v <= planned.voltage_v * (1.0 + 1e-9));
        }
    }
}

/// Soft ERAs, far more asked for than they can do: voltage, travel and the air's strength keep the effects within bounds,
/// with forces that grow as gaps close.
#[test]
fn no_effect_goes_beyond_the_actuators_limits() {
    for (stiffness, damping, volts) in
        [("1500.0", "0.3", "2000.0"), ("5000.0", "1.1", "2600.0"), ("2500.0", "4.0", "1200.0")]
    {
        let scene = EXAMPLE_BAR
            .replace("stiffness_n_per_m = 5000.0", &format!("stiffness_n_per_m = {stiffness}"))
            .replace("damping_n_s_per_m = 1.1", &format!("damping_n_s_per_m = {damping}"))
            .replace("max_voltage_v = 2000.0", &format!("max_voltage_v = {volts}"));
        let table = support::table(&scene);
        let rise = RiseTimes::prepare(&table.model).unwrap();
        // The swell has its full level between 200 and 300 ms.
        for (x_m, effect) in [
            (0.02, NamedEffect::Click),
            (0.11, NamedEffect::DoubleClick),
            (0.2, NamedEffect::PulseTrain),
            (0.06, NamedEffect::Swell),
        ] {
            let target = Target { x_m, y_m: 0.01, intensity_g: None };
            let plan = plan_with(&table, || Some(&rise), &planner::Request::touch(&[target]), Some(Intensity::G(30.0)))
                .unwrap();
            let design = design(&table, &rise, &plan, EffectRequest::of(effect)).unwrap();
            assert!(design.limited_by.as_ref().is_some_and(|by| by.contains(" of ")), "{:?}", design.limited_by);
            let effects: Vec<Effect> = design.drives.iter().map(|drive| drive.effect.clone()).collect();
            let mut bench = Bench::new(&table, &target);
            bench.play(&design, &effects, 400_000);
            let extremes = bench.board.panel_mut().take_travel_extremes();
            for ((extreme, electrodes), drive) in extremes.iter().zip(&table.electrodes).zip(&design.drives) {
                let part = extreme.travel_m / electrodes.gap_m;
                assert!(!extreme.snapped_in && part <= 1.0 / 3.0, "{effect:?}: {part} of the gap");
                assert!(drive.drive.voltage_v <= electrodes.max_voltage_v);
                let holds = era::planner::limits::breakdown_v(electrodes.gap_m - extreme.travel_m);
                assert!(
                    drive.drive.voltage_v <= 0.851 * holds,
                    "{effect:?}: {} V, {holds} V break down",
                    drive.drive.voltage_v
                );
            }
        }
    }
}
