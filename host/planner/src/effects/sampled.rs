//! The acceleration of a place over time while a designed effect plays.

use super::design::{EffectDesign, build_full_level_channel_for_drive};
use super::envelope::{effect_duration_s, level_in_each_period};
use super::motion::ChannelResponse;
use crate::PlanTable;
use crate::click::felt::FINE_RECORD;
use crate::click::{ClickWindow, simulate_felt_acceleration_of_windows_m_per_s2};
use crate::physics::rise::PanelPoles;
use nalgebra::DVector;

/// After the end of an envelope, in s: what is left by then is far below what is felt.
const AFTER_S: f64 = 0.5;

/// Acceleration in m/s^2 where `shape` holds the mode shapes, at times 0, `step_s`, ... from the effect's start on. Of windows it is that of the
/// felt band. Of envelopes it has all harmonics up to 1 kHz, and all drives begin at the same time: one of the phases that they
/// may have. `None` at an undamped resonance.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "some seconds"
)]
pub fn sample_acceleration_of_design_unless_undamped_m_per_s2(
    table: &PlanTable,
    rise: &PanelPoles,
    design: &EffectDesign,
    shape: &DVector<f64>,
    step_s: f64,
) -> Option<Vec<f64>> {
    if !design.windows.is_empty() {
        let windows: Vec<ClickWindow> = design
            .windows
            .iter()
            .map(|window| ClickWindow {
                actuator: window.channel,
                electrode: window.electrode,
                begin_s: 1e-6 * window.begin_us,
                width_s: 1e-6 * window.width_us,
                voltage_v: window.voltage_v,
            })
            .collect();
        let felt =
            simulate_felt_acceleration_of_windows_m_per_s2(table, rise, std::slice::from_ref(shape), &windows).pop()?;
        // What precedes the beginning is at the record's end: nine tenths of it follow the click.
        let count = (0.9 / step_s) as usize;
        let sample = |i: usize| felt.get((i as f64 * step_s * FINE_RECORD as f64).round() as usize).copied();
        return Some((0..count).map_while(sample).collect());
    }
    let ends_s =
        design.drives.iter().map(|designed| effect_duration_s(&designed.effect, 1.0 / designed.drive.frequency_hz));
    let count = ((ends_s.fold(0.0, f64::max) + AFTER_S) / step_s).ceil() as usize;
    let mut sum = vec![0.0; count];
    for (actuator, designed) in design.drives.iter().enumerate() {
        let channel = build_full_level_channel_for_drive(actuator, &designed.drive, table.electrodes.get(actuator)?);
        let levels = level_in_each_period(&designed.effect, channel.period_s());
        let alone = ChannelResponse::new(rise, shape, channel)?.sample_acceleration_per_n(&levels, step_s, count);
        sum.iter_mut().zip(alone).for_each(|(sum, one)| *sum += designed.drive.force_n * one);
    }
    Some(sum)
}
