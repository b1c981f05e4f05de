//! The motion that windows make: electrodes that charge, gaps that move, step by step; and the free motion after them.

use super::felt::{MEAN_S, MEANS, RECORD, SAMPLE_S, STEPS};
use super::program::LOOKED_AT;
use super::window::ClickWindow;
use crate::PlanTable;
use crate::physics::charging::ChargingElectrode;
use crate::physics::rise::PanelPoles;
use crate::physics::softening::Transducer;
use crate::scene::MAX_ACTUATORS;
use era_shared::waveform::Electrode;
use nalgebra::DVector;
use num_complex::Complex64;

/// Step in s, 25 us: a tenth of the least time constant of a board's electrodes, and an eightieth of a period of 500 Hz.
const STEP_S: f64 = 1.0 / STEPS as f64;
/// Steps over which a mean is taken.
const STEPS_OF_MEAN: usize = STEPS / MEANS;
/// Means, and steps, of a sample of what the programme looks at.
const MEANS_OF_SAMPLE: usize = MEANS / RECORD;
const STEPS_OF_SAMPLE: usize = STEPS / RECORD;
/// After the last window's end, in s: electrodes have discharged (35 time constants of the board's).
const DISCHARGED_S: f64 = 2e-3;
/// Least part of the gap that is left at a mass beyond its limits, where the force would grow without end.
const LEAST_GAP: f64 = 0.5;

/// What windows do.
#[derive(Clone, Debug)]
pub struct WindowMotion {
    /// Mean acceleration over each [`MEAN_S`] at every target in m/s^2, for 1 s.
    pub mean_acceleration: Vec<Vec<f64>>,
    /// Force of every actuator over each [`STEP_S`] in N, as long as there is one.
    pub forces_n: Vec<Vec<f64>>,
    /// Largest travel of every actuator's mass in m.
    pub travel_m: Vec<f64>,
    /// For each pole that vibrates: its pole, the largest amplitude while windows are on, and that after them.
    pub amplitudes: Vec<(Complex64, f64, f64)>,
}

/// Computes the motion of a panel at rest under windows, at the targets whose mode shapes are `shapes`.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "some thousand steps")]
pub fn simulate_windows(
    table: &PlanTable,
    poles: &PanelPoles,
    shapes: &[DVector<f64>],
    windows: &[ClickWindow],
) -> WindowMotion {
    let transducers: Vec<Transducer> = table.scene.actuators.iter().map(Transducer::from_actuator).collect();
    let rows: Vec<DVector<f64>> =
        (0..transducers.len()).map(|actuator| table.model.actuator_mass_travel_row(actuator)).collect();
    let mut stepper = poles.build_stepper_with_velocities(&rows, shapes, STEP_S);
    let mut electrodes = [[ChargingElectrode::default(); 2]; MAX_ACTUATORS];
    let (mut forces, mut motion) = (vec![0.0; transducers.len()], vec![0.0; rows.len() + shapes.len()]);
    let mut travel_m = vec![0.0_f64; rows.len()];
    let mut forces_n = vec![Vec::new(); transducers.len()];
    let mut velocity = vec![vec![0.0]; shapes.len()];
    // Mean displacement over each [`MEAN_S`] by what follows the forces at once.
    let mut followed = vec![vec![0.0]; shapes.len()];
    let mut largest: Vec<f64> = Vec::new();
    let end_s = windows.iter().map(|window| window.begin_s + window.width_s).fold(0.0, f64::max) + DISCHARGED_S;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    let samples = ((end_s / SAMPLE_S).ceil() as usize).min(RECORD);
    // A bias is in the model's springs: what it takes off them is given back for as long as the motion matters.
    let is_biased = transducers.iter().any(|transducer| transducer.counted_n_per_m > 0.0);
    let driven_samples = samples;
    let samples = if is_biased { (driven_samples + LOOKED_AT).min(RECORD) } else { driven_samples };
    let mut left: Vec<f64> = Vec::new();
    for step in 0..samples * STEPS_OF_SAMPLE {
        let from_s = step as f64 * STEP_S;
        for (actuator, (force, transducer)) in forces.iter_mut().zip(&transducers).enumerate() {
            let travel = motion.get(actuator).copied().unwrap_or(0.0);
            let closed = (travel / transducer.gap_m).clamp(-LEAST_GAP, LEAST_GAP);
            *force = -transducer.counted_n_per_m * travel;
            let Some(own) = electrodes.get_mut(actuator) else { continue };
            for (electrode, (state, towards)) in
                [Electrode::A, Electrode::B].into_iter().zip(own.iter_mut().zip([1.0, -1.0]))
            {
                let on = windows.iter().find(|window| {
                    window.actuator == actuator
                        && window.electrode == electrode
                        && window.begin_s < from_s + STEP_S
                        && window.begin_s + window.width_s > from_s
                });
                let on_s = on.map(|window| {
                    let from = (window.begin_s - from_s).max(0.0);
                    (from, (window.begin_s + window.width_s - from_s).min(STEP_S))
                });
                let rail_v = on.map_or(0.0, |window| window.voltage_v);
                let square = state.advance_step_and_get_mean_square_v2(transducer.charging, rail_v, on_s, STEP_S);
                *force += towards * transducer.newtons_per_volt_squared * square / (1.0 - towards * closed).powi(2);
            }
        }
        stepper.advance_one_step(&forces, &mut motion);
        travel_m.iter_mut().zip(&motion).for_each(|(most, travel)| *most = most.max(travel.abs()));
        if step % STEPS_OF_MEAN == 0 {
            followed.iter_mut().for_each(|own| own.push(0.0));
        }
        forces_n.iter_mut().zip(&forces).for_each(|(own, force_n)| own.push(*force_n));
        for (target, own) in followed.iter_mut().enumerate() {
            if let Some(mean) = own.last_mut() {
                *mean += stepper.displacement_of_row_by_instantly_following_poles_m(rows.len() + target, &forces)
                    / STEPS_OF_MEAN as f64;
            }
        }
        if (step + 1) % STEPS_OF_MEAN == 0 {
            for (kept, now) in velocity.iter_mut().zip(motion.iter().skip(rows.len())) {
                kept.push(*now);
            }
        }
        if (step + 1) % STEPS_OF_SAMPLE == 0 {
            let amplitudes = stepper.list_vibrating_poles_with_their_amplitudes();
            largest.resize(amplitudes.len(), 0.0);
            largest.iter_mut().zip(&amplitudes).for_each(|(most, (_, now))| *most = most.max(*now));
            if step + 1 == driven_samples * STEPS_OF_SAMPLE {
                left = amplitudes.iter().map(|(_, now)| *now).collect();
            }
        }
    }
    travel_m.iter_mut().zip(stepper.bound_free_motion_of_each_row()).for_each(|(most, free)| *most = most.max(free));
    let mean_acceleration = velocity
        .into_iter()
        .zip(followed)
        .enumerate()
        .map(|(target, (mut velocity, mut followed))| {
            let left = MEANS - samples * MEANS_OF_SAMPLE;
            velocity.extend(stepper.sample_free_motion_of_row(rows.len() + target, MEAN_S, left));
            // Nothing follows where there is no force: before the beginning, after the end.
            followed.resize(MEANS + 2, 0.0);
            let bends = followed.windows(3).map(|three| (three[2] - 2.0 * three[1] + three[0]) / (MEAN_S * MEAN_S));
            velocity.windows(2).zip(bends).map(|(pair, bend)| (pair[1] - pair[0]) / MEAN_S + bend).collect()
        })
        .collect();
    let amplitudes = stepper
        .list_vibrating_poles_with_their_amplitudes()
        .into_iter()
        .zip(largest.into_iter().zip(left))
        .map(|((pole, _), (most, left))| (pole, most, left))
        .collect();
    WindowMotion { mean_acceleration, forces_n, travel_m, amplitudes }
}
