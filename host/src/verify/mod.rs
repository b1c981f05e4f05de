//! Prediction against measurement: the planner works in the frequency domain, the simulated device in time. Both are told
//! the same plan, the device by the same frames that a board would get, and its accelerometer is read.

use crate::daemon::wire_drives;
use crate::device::convert::{SiDrive, from_wire, to_wire};
use crate::device::sim::{Accelerometer, Clock, STEP_S, SimBoard, attenuation};
use crate::planner::{Plan, PlanError, PlanTable, STANDARD_GRAVITY, Target};
use crate::response;
use era_shared::device::{Device, Port};
use era_shared::limits::BURST_MAX_MS;
use era_shared::link::{Decoder, Kind, MAX_ENCODED, encode};
use era_shared::protocol::{CURRENT_VERSION, Reply, Request};
use era_shared::safety::LinkId;
use era_shared::supply::{RAILS, rail_of};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::f64::consts::{FRAC_PI_2, TAU};

mod waveform;

pub use waveform::Waveform;

/// Part of the predicted peak to which the motion of switching on must have fallen before the record starts.
const SETTLED: f64 = 1e-4;
/// Part at which the longest settling time will do; less than half the difference that is allowed, as all modes are taken to
/// add up.
const NEARLY_SETTLED: f64 = 2e-2;
/// Longest settling time in s: with soft start and record it fills the longest burst that the board drives, 10 s. A mode at
/// 40 Hz with a damping ratio of 2e-3 has 1.4e-2 left.
const LONGEST_SETTLE_S: f64 = 8.5;
/// From the drives' frame to steady drives, in s: the self-test takes 10 ms, the soft start to 2 kV 100 ms, the supply's own
/// 2 ms leave nothing after 40 more, and a channel at 20 Hz may wait for its phase for 150 ms.
const SOFT_START_S: f64 = 0.3;
/// Shortest settling time in s, for the accelerometer's own low-pass.
const SHORTEST_SETTLE_S: f64 = 0.1;
/// Length of the record in s: several dozen periods, twenty beats at the least spacing of 20 Hz, and two common periods of
/// drives on the planner's grid of 2 Hz.
const RECORD_S: f64 = 1.0;
/// Between two keep-alives, in us.
const KEEP_ALIVE_US: u64 = 50_000;

/// Why a point could not be verified.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// No plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// No response at a harmonic.
    #[error(transparent)]
    Response(#[from] response::ResponseError),
    /// There is no steady state to compare with.
    #[error(
        "{LONGEST_SETTLE_S} s after it was switched on the panel's motion has not settled, so that there is no steady state \
         to compare with, as the board drives no longer than 10 s: give the scene more damping (surface.damping.loss_factor, say)"
    )]
    NeverSettles,
    /// The simulated device did not do as told.
    #[error("the simulated device answered {0}")]
    Device(String),
}

/// One point, predicted and measured. "Fundamentals" is equation 23 over the drives' own frequencies, the planner's
/// `target_peak_g`; "band" is the largest acceleration of the whole waveform, odd harmonics of the square-edged force
/// included, through the accelerometer's 1 kHz low-pass.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The point in mm.
    pub x_mm: f64,
    /// The point in mm.
    pub y_mm: f64,
    /// The drives.
    pub drives: Vec<crate::planner::Drive>,
    /// Equation 23, in g.
    pub predicted_g: f64,
    /// Sum of the amplitudes at the drives' frequencies in the record, in g.
    pub simulated_g: f64,
    /// Relative difference of the two.
    pub difference: f64,
    /// Peak of the whole waveform, in g.
    pub predicted_band_g: f64,
    /// Largest magnitude in the record, in g.
    pub simulated_band_g: f64,
    /// Relative difference of the two.
    pub band_difference: f64,
}

/// Runs a plan for `target` on the simulated device, faster than real time, and compares.
///
/// # Errors
/// [`VerifyError`].
pub fn compare(
    table: &PlanTable,
    panel: &crate::device::sim::Panel,
    target: Target,
) -> Result<Comparison, VerifyError> {
    let plan = table.plan(&[target])?;
    let [x_mm, y_mm] = plan.target_mm;
    let shape = table.model.shape_at(x_mm / 1e3, y_mm / 1e3);
    let mut panel = panel.clone();
    panel.set_probe(&shape);
    let record = run(table, panel, &shape, &plan)?;
    let frequencies: Vec<f64> = record.achieved.iter().map(|drive| drive.frequency_hz).collect();
    let simulated_g = amplitudes(&record.samples, &frequencies).iter().sum::<f64>() / STANDARD_GRAVITY;
    let simulated_band_g = record.samples.iter().fold(0.0_f64, |most, a| most.max(a.abs())) / STANDARD_GRAVITY;
    let predicted_band_g = record.predicted_peak / STANDARD_GRAVITY;
    let predicted_g = plan.predicted.target_peak_g;
    let relative = |simulated: f64, predicted: f64| (simulated - predicted) / predicted.max(f64::MIN_POSITIVE);
    Ok(Comparison {
        x_mm,
        y_mm,
        predicted_g,
        simulated_g,
        difference: relative(simulated_g, predicted_g),
        predicted_band_g,
        simulated_band_g,
        band_difference: relative(simulated_band_g, predicted_band_g),
        drives: plan.drives,
    })
}

/// Points spread over the surface by a low-discrepancy sequence (Roberts' R2, the plastic number), none on an edge.
#[must_use]
pub fn spread(count: u32, length_m: f64, width_m: f64) -> Vec<(f64, f64)> {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    (0..count)
        .map(|i| {
            let at = |step: f64| (0.5 + step * f64::from(i + 1)).fract();
            (length_m * at(1.0 / PLASTIC), width_m * at(1.0 / (PLASTIC * PLASTIC)))
        })
        .collect()
}

/// What the device did.
struct Record {
    /// The drives as its registers achieve them, their phases counted from the panel's time zero.
    achieved: Vec<SiDrive>,
    /// What the frequency domain has for the peak over the same window, in m/s^2.
    predicted_peak: f64,
    /// The accelerometer's samples in m/s^2, [`STEP_S`] apart.
    samples: Vec<f64>,
}

/// The accelerometer's record after the panel has settled.
fn run(
    table: &PlanTable,
    panel: crate::device::sim::Panel,
    shape: &DVector<f64>,
    plan: &Plan,
) -> Result<Record, VerifyError> {
    let volts: Vec<f64> = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
    let mut bench = Bench::new(SimBoard::new(panel, &volts, Clock::Manual(0)));
    bench.ask(&Request::ArmWith { deadman_ms: None, burst_ms: Some(BURST_MAX_MS) })?;
    let drives = wire_drives(plan).iter().map(to_wire).collect();
    let Reply::DrivesSet { achieved } = bench.ask(&Request::SetDrives { drives })? else {
        return Err(VerifyError::Device("something else than the drives it has set".into()));
    };
    // The device holds the drives until its self-test has passed, and brings the rails up.
    bench.run_for(SOFT_START_S)?;
    let achieved = bench.in_time(&on_rails(achieved.iter().map(from_wire).collect()))?;
    let waveform = Waveform::new(&table.model, &table.electrodes, shape, &achieved)?;
    // From rest, the motion is the steady one and a free one that cancels it at first.
    let peak = waveform.peak(0.0, STEP_S, samples_of(RECORD_S));
    let (settling_s, left) =
        bench.board.panel_mut().settling(&waveform.displacement, &waveform.velocity, SETTLED * peak, LONGEST_SETTLE_S);
    if left > NEARLY_SETTLED * peak {
        return Err(VerifyError::NeverSettles);
    }
    bench.run_for(settling_s.max(SHORTEST_SETTLE_S))?;
    // A sample is the mean over a step and stands for the step's middle.
    let from_s = bench.board.panel_mut().time_s() + 0.5 * STEP_S;
    bench.accelerometer().start_record();
    bench.run_for(RECORD_S)?;
    let samples = bench.accelerometer().take_record();
    bench.ask(&Request::Stop)?;
    Ok(Record { achieved, predicted_peak: waveform.peak(from_s, STEP_S, samples.len()), samples })
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a second or so")]
fn samples_of(seconds: f64) -> usize {
    (seconds / STEP_S) as usize
}

/// The drives as they are once channels share rails: a rail stands at the highest voltage of its channels, and the others
/// get windows of the same fundamental force, (V / V_rail)^2 sin(pi w / 2) = sin(pi w' / 2).
fn on_rails(drives: Vec<SiDrive>) -> Vec<SiDrive> {
    let mut rails_v = [0.0_f64; RAILS];
    for drive in &drives {
        if let Some(rail_v) = rails_v.get_mut(rail_of(usize::from(drive.channel))) {
            *rail_v = rail_v.max(drive.voltage_v);
        }
    }
    let shared = |drive: SiDrive| {
        let rail_v = rails_v.get(rail_of(usize::from(drive.channel))).copied().unwrap_or(drive.voltage_v);
        if rail_v <= drive.voltage_v {
            return drive;
        }
        let part = (drive.voltage_v / rail_v).powi(2) * (FRAC_PI_2 * drive.pulse_width).sin();
        SiDrive { voltage_v: rail_v, pulse_width: part.asin() / FRAC_PI_2, ..drive }
    };
    drives.into_iter().map(shared).collect()
}

/// A device and a host in one thread, on a clock that is set by hand.
struct Bench {
    device: Device,
    board: SimBoard,
    port: Port,
    sequence: u16,
    time_us: u64,
}

impl Bench {
    fn new(mut board: SimBoard) -> Self {
        let mut device = Device::new();
        device.start(&mut board);
        Self { device, board, port: Port::new(LinkId(0)), sequence: 0, time_us: 0 }
    }

    fn accelerometer(&mut self) -> &mut Accelerometer {
        &mut self.board.panel_mut().accelerometer
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times of some seconds")]
    fn run_for(&mut self, seconds: f64) -> Result<(), VerifyError> {
        let end_us = self.time_us + (seconds * 1e6) as u64;
        while self.time_us < end_us {
            let keep_alive_us = (self.time_us + KEEP_ALIVE_US).min(end_us);
            while self.time_us < keep_alive_us {
                let due_us = self.device.poll(&mut self.board);
                self.time_us = due_us.clamp(self.time_us + 1, keep_alive_us);
                self.board.set_time_us(self.time_us);
            }
            self.device.poll(&mut self.board);
            self.board.advance();
            self.ask(&Request::KeepAlive)?;
        }
        Ok(())
    }

    /// The drives with their phases counted from the panel's time zero. Equal frequencies have a common origin, which the
    /// first of them shows: where its windows lie is taken from the timers, and the phases of the others from the plan.
    fn in_time(&mut self, drives: &[SiDrive]) -> Result<Vec<SiDrive>, VerifyError> {
        let mut origins: Vec<(f64, f64)> = Vec::new();
        let mut found = Vec::with_capacity(drives.len());
        for drive in drives {
            let frequency_hz = drive.frequency_hz;
            let known = origins.iter().find(|(of, _)| (of - frequency_hz).abs() < 1e-9).map(|(_, origin_s)| *origin_s);
            let origin_s = match known {
                Some(origin_s) => origin_s,
                None => {
                    let source = self.board.panel_mut().source_mut(usize::from(drive.channel));
                    let peak_s = source.and_then(|source| source.peak_s());
                    let peak_s =
                        peak_s.ok_or_else(|| VerifyError::Device("no drive on a channel of the plan".into()))?;
                    let origin_s = peak_s + drive.phase_rad / (TAU * frequency_hz);
                    origins.push((frequency_hz, origin_s));
                    origin_s
                }
            };
            found.push(SiDrive { phase_rad: drive.phase_rad - TAU * (frequency_hz * origin_s).fract(), ..*drive });
        }
        Ok(found)
    }

    fn ask(&mut self, request: &Request) -> Result<Reply, VerifyError> {
        let broken = |what: &str| VerifyError::Device(what.into());
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; MAX_ENCODED];
        let length = encode(CURRENT_VERSION, Kind::Request, self.sequence, request, &mut frame)
            .map_err(|_| broken("nothing"))?;
        let mut answers = Vec::new();
        let sent = frame.get(..length).unwrap_or_default();
        self.device.receive(&mut self.board, &mut self.port, sent, |bytes| answers.extend_from_slice(bytes));
        let mut reply = None;
        Decoder::new().feed(&answers, |frame| {
            reply = frame.ok().and_then(|frame| postcard::from_bytes::<Reply>(frame.body).ok());
        });
        match reply {
            Some(Reply::Refused(refusal)) => Err(broken(&crate::device::convert::refusal_text(&refusal))),
            Some(reply) => Ok(reply),
            None => Err(broken("nothing readable")),
        }
    }
}

/// Amplitudes of sines at the given frequencies in a record: least squares over all of them at once, so that they do not
/// leak into each other. The low-pass has made each smaller by a known factor, which is taken out again.
#[allow(clippy::cast_precision_loss, reason = "sample numbers")]
fn amplitudes(record: &[f64], frequencies_hz: &[f64]) -> Vec<f64> {
    let columns = 2 * frequencies_hz.len();
    let mut normal = DMatrix::<f64>::zeros(columns, columns);
    let mut right = DVector::<f64>::zeros(columns);
    let mut row = DVector::<f64>::zeros(columns);
    for (i, value) in record.iter().enumerate() {
        for (k, frequency_hz) in frequencies_hz.iter().enumerate() {
            let (sin, cos) = (TAU * frequency_hz * i as f64 * STEP_S).sin_cos();
            row[2 * k] = cos;
            row[2 * k + 1] = sin;
        }
        normal.ger(1.0, &row, &row, 1.0);
        right.axpy(*value, &row, 1.0);
    }
    let fit = normal.cholesky().map_or_else(|| DVector::zeros(columns), |factor| factor.solve(&right));
    frequencies_hz
        .iter()
        .enumerate()
        .map(|(k, frequency_hz)| fit[2 * k].hypot(fit[2 * k + 1]) / attenuation(*frequency_hz))
        .collect()
}
