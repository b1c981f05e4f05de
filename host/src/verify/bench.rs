//! The simulated device on a clock that is set by hand, and what its accelerometer's record shows.

use super::VerifyError;
use crate::device::sim::{Accelerometer, Clock, SimBoard, SimPanel, low_pass_gain};
use crate::planner::drive::SiDrive;
use era_shared::device::{Device, LinkReceiver};
use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{CURRENT_VERSION, Reply, Request};
use era_shared::safety::LinkId;
use era_shared::supply::{RAILS, rail_index_of_channel};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Between two keep-alives, in us.
const KEEP_ALIVE_US: u64 = 50_000;

/// A simulated device and its host in one thread, on a clock that is set by hand: time passes only while one of the `run` methods
/// computes what happens meanwhile.
pub struct Bench {
    device: Device,
    board: SimBoard,
    port: LinkReceiver,
    sequence: u16,
    time_us: u64,
}

impl Bench {
    /// A device that has just been switched on, at the time 0, with this panel and the highest voltages of its channels in V.
    #[must_use]
    pub fn new(panel: SimPanel, max_voltages_v: &[f64]) -> Self {
        let mut board = SimBoard::new(panel, max_voltages_v, Clock::Manual(0));
        let mut device = Device::new();
        device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut board);
        Self { device, board, port: LinkReceiver::new(LinkId(0)), sequence: 0, time_us: 0 }
    }

    /// The time by the device's clock, in us.
    #[must_use]
    pub const fn time_us(&self) -> u64 {
        self.time_us
    }

    /// The time by the device's clock, in s.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "microseconds of some seconds")]
    pub fn time_s(&self) -> f64 {
        self.time_us as f64 * 1e-6
    }

    /// The panel, with its motion up to now.
    pub const fn panel_mut(&mut self) -> &mut SimPanel {
        self.board.panel_mut()
    }

    /// The accelerometer on the panel.
    pub const fn accelerometer_mut(&mut self) -> &mut Accelerometer {
        &mut self.board.panel_mut().accelerometer
    }

    /// Lets this time pass; the host sends nothing but keep-alives.
    ///
    /// # Errors
    /// As [`Self::run_until_us()`].
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times of some seconds")]
    pub fn run_for(&mut self, seconds: f64) -> Result<(), VerifyError> {
        self.run_until_us(self.time_us + (seconds * 1e6) as u64)
    }

    /// Lets time pass until the device's clock has this time in us; the host sends nothing but keep-alives. Nothing happens if it is
    /// later already.
    ///
    /// # Errors
    /// As [`Self::send_request()`].
    pub fn run_until_us(&mut self, end_us: u64) -> Result<(), VerifyError> {
        while self.time_us < end_us {
            let keep_alive_us = (self.time_us + KEEP_ALIVE_US).min(end_us);
            while self.time_us < keep_alive_us {
                let due_us = self.device.do_due_work_and_tell_next_due_us(&mut self.board);
                self.time_us = due_us.clamp(self.time_us + 1, keep_alive_us);
                self.board.set_manual_time_us(self.time_us);
            }
            self.device.do_due_work_and_tell_next_due_us(&mut self.board);
            self.board.advance_panel_to_now();
            self.send_request(&Request::KeepAlive)?;
        }
        Ok(())
    }

    /// The drives with their phases counted from the panel's time zero. Equal frequencies have a common origin, which the
    /// first of them shows: where its windows lie is taken from the timers, and the phases of the others from the plan.
    /// Drives whose windows are shorter than a tick are none and are left out.
    pub(super) fn find_drives_from_panel_time_zero(&mut self, drives: &[SiDrive]) -> Result<Vec<SiDrive>, VerifyError> {
        let mut origins: Vec<(f64, f64)> = Vec::new();
        let mut found = Vec::with_capacity(drives.len());
        for drive in drives {
            let frequency_hz = drive.frequency_hz;
            let source = self.board.panel_mut().channel_timer_mut(usize::from(drive.channel));
            let Some(peak_s) = source.and_then(|source| source.time_s_of_force_peak_in_last_preload_unless_blank())
            else {
                continue;
            };
            let known = origins.iter().find(|(of, _)| (of - frequency_hz).abs() < 1e-9).map(|(_, origin_s)| *origin_s);
            let origin_s = known.unwrap_or_else(|| {
                let origin_s = peak_s + drive.phase_rad / (TAU * frequency_hz);
                origins.push((frequency_hz, origin_s));
                origin_s
            });
            found.push(SiDrive { phase_rad: drive.phase_rad - TAU * (frequency_hz * origin_s).fract(), ..*drive });
        }
        if found.is_empty() {
            return Err(VerifyError::Device("it drives no channel of the plan".into()));
        }
        Ok(found)
    }

    /// Sends a request, which takes no time, and gives the device's reply.
    ///
    /// # Errors
    /// [`VerifyError::Device`] if the device refuses the request, or its reply cannot be read.
    pub fn send_request(&mut self, request: &Request) -> Result<Reply, VerifyError> {
        let broken = |what: &str| VerifyError::Device(what.into());
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; MAX_ENCODED];
        let length = encode_frame(CURRENT_VERSION, FrameKind::Request, self.sequence, request, &mut frame)
            .map_err(|_| broken("the request cannot be encoded"))?;
        let mut answers = Vec::new();
        let sent = frame.get(..length).unwrap_or_default();
        self.device.receive_bytes(&mut self.board, &mut self.port, sent, |bytes| answers.extend_from_slice(bytes));
        let mut reply = None;
        Decoder::new().feed_bytes(&answers, |frame| {
            reply = frame.ok().and_then(|frame| postcard::from_bytes::<Reply>(frame.body).ok());
        });
        match reply {
            Some(Reply::Refused(refusal)) => Err(broken(&crate::device::convert::describe_refusal(&refusal))),
            Some(reply) => Ok(reply),
            None => Err(broken("its answer cannot be read")),
        }
    }
}

/// Coefficients of the four-term Blackman-Harris window (Harris 1978): side lobes 92 dB down from 4/T on.
const WINDOW: [f64; 4] = [0.358_75, -0.488_29, 0.141_28, -0.011_68];

/// Amplitudes of sines at the frequencies `wanted_hz` in a record of samples `step_s` apart: weighted least squares over all of them at once, and over
/// those at `beside_hz`, so that they do not leak into each other. The weights are a window's, so that lines far off, which
/// may be ten thousand times stronger where a panel hardly moves, do not either. The low-pass has made each smaller by a
/// known factor, which is taken out again.
#[expect(clippy::cast_precision_loss, reason = "sample numbers")]
pub(super) fn fit_amplitudes(record: &[f64], step_s: f64, wanted_hz: &[f64], beside_hz: &[f64]) -> Vec<f64> {
    let frequencies_hz: Vec<f64> = wanted_hz.iter().chain(beside_hz).copied().collect();
    let columns = 2 * frequencies_hz.len();
    let mut normal = DMatrix::<f64>::zeros(columns, columns);
    let mut right = DVector::<f64>::zeros(columns);
    let mut row = DVector::<f64>::zeros(columns);
    for (i, value) in record.iter().enumerate() {
        for (k, frequency_hz) in frequencies_hz.iter().enumerate() {
            let (sin, cos) = (TAU * frequency_hz * i as f64 * step_s).sin_cos();
            row[2 * k] = cos;
            row[2 * k + 1] = sin;
        }
        let turn = TAU * (i as f64 + 0.5) / record.len() as f64;
        let weight: f64 = WINDOW.iter().zip(0_u32..).map(|(part, k)| part * (f64::from(k) * turn).cos()).sum();
        normal.ger(weight, &row, &row, 1.0);
        right.axpy(weight * value, &row, 1.0);
    }
    let fit = normal.cholesky().map_or_else(|| DVector::zeros(columns), |factor| factor.solve(&right));
    let amplitude = |(k, hz): (usize, &f64)| fit[2 * k].hypot(fit[2 * k + 1]) / low_pass_gain(*hz);
    wanted_hz.iter().enumerate().map(amplitude).collect()
}

/// The drives as they are once channels share rails: a rail stands at the highest voltage of its channels, and the others
/// get windows of the same fundamental force, (V / V_rail)^2 sin(pi w / 2) = sin(pi w' / 2).
pub(super) fn convert_to_shared_rails(drives: Vec<SiDrive>) -> Vec<SiDrive> {
    let mut rails_v = [0.0_f64; RAILS];
    for drive in &drives {
        if let Some(rail_v) = rails_v.get_mut(rail_index_of_channel(usize::from(drive.channel))) {
            *rail_v = rail_v.max(drive.voltage_v);
        }
    }
    let shared = |drive: SiDrive| {
        let rail_v = rails_v.get(rail_index_of_channel(usize::from(drive.channel))).copied().unwrap_or(drive.voltage_v);
        if rail_v <= drive.voltage_v {
            return drive;
        }
        let part = (drive.voltage_v / rail_v).powi(2) * (FRAC_PI_2 * drive.pulse_width).sin();
        SiDrive { voltage_v: rail_v, pulse_width: part.asin() / FRAC_PI_2, ..drive }
    };
    drives.into_iter().map(shared).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::sim::STEP_S;

    #[test]
    fn weak_sines_are_found_beside_strong_ones() {
        let lines = [(101.3, 1e-3), (160.0, 0.5), (303.9, 3.0), (102.1, 2e-3)];
        let at = |i: u32| {
            let time_s = f64::from(i) * STEP_S;
            lines.iter().map(|(hz, a)| a * low_pass_gain(*hz) * (TAU * hz * time_s + hz).cos()).sum::<f64>()
        };
        let record: Vec<f64> = (0..40_000).map(at).collect();
        let found = fit_amplitudes(&record, STEP_S, &[101.3, 160.0], &[102.1]);
        assert!((found[0] / 1e-3 - 1.0).abs() < 5e-3 && (found[1] / 0.5 - 1.0).abs() < 1e-6, "{found:?}");
    }
}
