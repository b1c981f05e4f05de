//! One drive of an effect that is being designed: its motion at the targets, and how the drives add up.

use super::envelope::{effect_duration_s, level_in_each_period};
use super::error::DesignError;
use super::intensity::{list_switched_forces_of_plan, mode_shape_values_at_point_or_on_bar_axis};
use super::motion::{Channel, ChannelResponse};
use crate::physics::limits::Limit;
use crate::physics::rise::{PanelPoles, TransientResponse};
use crate::response::solve_coordinates_per_newton_at_frequency;
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

/// A drive of an effect that is being designed.
pub struct EffectDrive {
    pub drive: SwitchedForce,
    pub channel: Channel,
    /// At every target.
    pub responses: Vec<ChannelResponse>,
    /// Driven alone and evenly.
    pub max_force_n: f64,
    /// What sets that.
    pub limit: Limit,
}

impl EffectDrive {
    /// The fundamental at every target, and what is quiet there per N: of the part `quiet_fraction` that the sum of `drive_count` drives may
    /// leave, an equal share.
    #[expect(clippy::cast_precision_loss, reason = "at most four")]
    pub fn fundamental_response_and_quiet_level_at_each_target_per_n(
        &self,
        quiet_fraction: f64,
        wanted: &[f64],
        drive_count: usize,
    ) -> Vec<(TransientResponse, f64)> {
        let share = quiet_fraction / (drive_count.max(1) as f64 * self.drive.force_n.max(f64::MIN_POSITIVE));
        let fundamentals = self.responses.iter().map(ChannelResponse::fundamental_response);
        fundamentals.zip(wanted).filter_map(|(ringing, wanted)| Some((ringing?.clone(), wanted * share))).collect()
    }

    /// The levels of an effect in the periods of this drive.
    pub fn level_in_each_period(&self, effect: &Effect) -> Vec<f64> {
        level_in_each_period(effect, self.channel.period_s())
    }
}

/// The drives of a plan with their responses at its targets and their largest forces.
pub fn build_effect_drives(table: &PlanTable, rise: &PanelPoles, plan: &Plan) -> Result<Vec<EffectDrive>, DesignError> {
    let shapes: Vec<DVector<f64>> = plan
        .targets
        .iter()
        .map(|target| mode_shape_values_at_point_or_on_bar_axis(table, target.x_m, target.y_m))
        .collect();
    list_switched_forces_of_plan(table, plan)
        .into_iter()
        .zip(&plan.drives)
        .map(|(drive, planned)| {
            let electrodes = table.electrodes.get(drive.actuator).ok_or(DesignError::Unbounded)?;
            let channel = Channel {
                actuator: drive.actuator,
                frequency_hz: drive.frequency_hz,
                pulse_width: planned.pulse_width,
                charging: electrodes.charging_at(drive.frequency_hz),
            };
            let responses =
                shapes.iter().map(|shape| ChannelResponse::new(rise, shape, channel)).collect::<Option<Vec<_>>>();
            let responses = responses.ok_or(DesignError::Unbounded)?;
            // What is planned is allowed.
            let (max_force_n, limit) = find_max_force_n_and_limit(table, &drive, channel.pulse_width)?;
            let max_force_n = max_force_n.max(drive.force_n);
            Ok(EffectDrive { drive, channel, responses, max_force_n, limit })
        })
        .collect()
}

/// Most force in N of an actuator that is driven alone and evenly, and what sets it.
fn find_max_force_n_and_limit(
    table: &PlanTable,
    drive: &SwitchedForce,
    pulse_width: f64,
) -> Result<(f64, Limit), DesignError> {
    let coordinates = solve_coordinates_per_newton_at_frequency(&table.model, drive.frequency_hz)
        .map_err(|_| DesignError::Unbounded)?;
    let own = coordinates.get(drive.actuator).zip(table.electrodes.get(drive.actuator));
    let (coordinates, electrodes) = own.ok_or(DesignError::Unbounded)?;
    Ok(electrodes.find_max_force_n_and_limit(
        table.model.actuator_mass_travel_against_electrodes(drive.actuator, coordinates).norm(),
        drive.frequency_hz,
        pulse_width,
    ))
}

/// Acceleration at a target by every drive alone, per N.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds")]
pub fn sample_acceleration_per_n_of_each_drive(
    effect_drives: &[EffectDrive],
    effects: &[Effect],
    target: usize,
    after_s: f64,
) -> Vec<Vec<f64>> {
    let ends =
        effect_drives.iter().zip(effects).map(|(part, effect)| effect_duration_s(effect, part.channel.period_s()));
    let count = ((ends.fold(0.0, f64::max) + after_s) / STEP_S).ceil() as usize;
    let one = |(part, effect): (&EffectDrive, &Effect)| {
        part.responses
            .get(target)
            .map_or_else(Vec::new, |r| r.sample_acceleration_per_n(&part.level_in_each_period(effect), STEP_S, count))
    };
    effect_drives.iter().zip(effects).map(one).collect()
}

/// Mean, least and largest peak of a sum of drives over all offsets between their cycles.
pub struct PeakMeanAndRange {
    pub mean: f64,
    pub least: f64,
    pub most: f64,
}

/// The peaks of the sum of all drives, over the offsets between their cycles.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "counts")]
pub fn find_mean_least_and_most_peak_over_cycle_offsets(
    accelerations_per_n_of_each_drive: &[Vec<f64>],
    effect_drives: &[EffectDrive],
    force_n: impl Fn(&EffectDrive) -> f64,
) -> PeakMeanAndRange {
    let moving: Vec<(&Vec<f64>, &EffectDrive, f64)> = accelerations_per_n_of_each_drive
        .iter()
        .zip(effect_drives)
        .map(|(s, part)| (s, part, force_n(part)))
        .filter(|(_, _, f)| *f > 0.0)
        .collect();
    let drives = moving.len() as u32;
    let each = (1..=OFFSETS).rev().find(|n| n.pow(drives) <= MOST_OFFSETS).unwrap_or(1);
    let combinations = each.pow(drives);
    let mut peak = PeakMeanAndRange { mean: 0.0, least: f64::INFINITY, most: 0.0 };
    let mut sum = vec![0.0; accelerations_per_n_of_each_drive.first().map_or(0, Vec::len)];
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
