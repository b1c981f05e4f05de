//! One drive of an effect in the making: what it does at the targets, and how drives add up.

use super::envelope::{length_s, levels};
use super::error::DesignError;
use super::intensity::{forces, shape_of};
use super::motion::{Channel, Response};
use crate::physics::limits::Limit;
use crate::physics::rise::{RiseTimes, TransientResponse};
use crate::response::solve_coordinates_at_frequency;
use crate::transient::panel::SwitchedForce;
use crate::{Plan, PlanTable};
use era_shared::waveform::Effect;
use nalgebra::DVector;

/// Step of predicted motions in s: ten in a period of 1 kHz.
pub const STEP_S: f64 = 1e-4;
/// To how much an effect's segments and repetitions are cut for its prediction, in s: whatever moves has settled by then.
pub const PREDICTED_S: f64 = 1.0;
/// Times, over its period, at which each drive may begin: it waits for a boundary of its own.
const OFFSETS: usize = 8;
/// Most combinations of them.
const MOST_OFFSETS: usize = 64;

/// A drive in the making.
pub struct Part {
    pub drive: SwitchedForce,
    pub channel: Channel,
    /// At every target.
    pub responses: Vec<Response>,
    /// Driven alone and evenly.
    pub max_force_n: f64,
    /// What sets that.
    pub limit: Limit,
}

impl Part {
    /// The fundamental at every target, and what is quiet there per N: of the part `quiet` that the sum of `drives` may
    /// leave, an equal share.
    #[expect(clippy::cast_precision_loss, reason = "at most four")]
    pub fn quiet(&self, quiet: f64, wanted: &[f64], drives: usize) -> Vec<(TransientResponse, f64)> {
        let share = quiet / (drives.max(1) as f64 * self.drive.force_n.max(f64::MIN_POSITIVE));
        let fundamentals = self.responses.iter().map(Response::fundamental);
        fundamentals.zip(wanted).filter_map(|(ringing, wanted)| Some((ringing?.clone(), wanted * share))).collect()
    }

    pub fn levels(&self, effect: &Effect) -> Vec<f64> {
        levels(effect, self.channel.period_s())
    }
}

pub fn parts(table: &PlanTable, rise: &RiseTimes, plan: &Plan) -> Result<Vec<Part>, DesignError> {
    let shapes: Vec<DVector<f64>> = plan.targets.iter().map(|target| shape_of(table, target.x_m, target.y_m)).collect();
    forces(table, plan)
        .into_iter()
        .zip(&plan.drives)
        .map(|(drive, planned)| {
            let channel = Channel {
                actuator: drive.actuator,
                frequency_hz: drive.frequency_hz,
                pulse_width: planned.pulse_width,
            };
            let responses = shapes.iter().map(|shape| Response::new(rise, shape, channel)).collect::<Option<Vec<_>>>();
            let responses = responses.ok_or(DesignError::Unbounded)?;
            // What is planned is allowed.
            let (max_force_n, limit) = max_force_n(table, &drive, channel.pulse_width)?;
            let max_force_n = max_force_n.max(drive.force_n);
            Ok(Part { drive, channel, responses, max_force_n, limit })
        })
        .collect()
}

/// Most force in N of an actuator that is driven alone and evenly, and what sets it.
fn max_force_n(table: &PlanTable, drive: &SwitchedForce, pulse_width: f64) -> Result<(f64, Limit), DesignError> {
    let coordinates =
        solve_coordinates_at_frequency(&table.model, drive.frequency_hz).map_err(|_| DesignError::Unbounded)?;
    let own = coordinates.get(drive.actuator).zip(table.electrodes.get(drive.actuator));
    let (coordinates, electrodes) = own.ok_or(DesignError::Unbounded)?;
    Ok(electrodes.max_force(table.model.actuator_travel(drive.actuator, coordinates).norm(), pulse_width))
}

/// Acceleration at a target by every drive alone, per N.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds")]
pub fn signals(parts: &[Part], effects: &[Effect], target: usize, after_s: f64) -> Vec<Vec<f64>> {
    let ends = parts.iter().zip(effects).map(|(part, effect)| length_s(effect, part.channel.period_s()));
    let count = ((ends.fold(0.0, f64::max) + after_s) / STEP_S).ceil() as usize;
    let one = |(part, effect): (&Part, &Effect)| {
        part.responses.get(target).map_or_else(Vec::new, |r| r.samples(&part.levels(effect), STEP_S, count))
    };
    parts.iter().zip(effects).map(one).collect()
}

/// Peak of a sum of drives over how their cycles may fall together.
pub struct Peak {
    pub mean: f64,
    pub least: f64,
    pub most: f64,
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "counts")]
pub fn combined(signals: &[Vec<f64>], parts: &[Part], force_n: impl Fn(&Part) -> f64) -> Peak {
    let moving: Vec<(&Vec<f64>, &Part, f64)> =
        signals.iter().zip(parts).map(|(s, part)| (s, part, force_n(part))).filter(|(_, _, f)| *f > 0.0).collect();
    let drives = moving.len() as u32;
    let each = (1..=OFFSETS).rev().find(|n| n.pow(drives) <= MOST_OFFSETS).unwrap_or(1);
    let combinations = each.pow(drives);
    let mut peak = Peak { mean: 0.0, least: f64::INFINITY, most: 0.0 };
    let mut sum = vec![0.0; signals.first().map_or(0, Vec::len)];
    for combination in 0..combinations {
        sum.fill(0.0);
        let mut rest = combination;
        for (signal, part, force_n) in &moving {
            // The combination's digits.
            let offset = rest % each;
            rest /= each;
            let delay_s = offset as f64 / each as f64 * part.channel.period_s();
            let delay = (delay_s / STEP_S).round() as usize;
            for (sum, x) in sum.iter_mut().skip(delay).zip(signal.iter()) {
                *sum += x * force_n;
            }
        }
        let most = sum.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        (peak.least, peak.most) = (peak.least.min(most), peak.most.max(most));
        peak.mean += most / combinations as f64;
    }
    peak
}
