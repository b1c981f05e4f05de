//! What a click does to the whole surface: how much less it moves than the target, and how loud it is: the mean-square velocity, with the
//! A-weighting of sound level meters.
//!
//! A surface radiates more sound the faster it moves, and the ear hears low frequencies less. The figure compares clicks of one panel; it is
//! no sound pressure.

use super::felt::{LAST_SHOWN_LINE, felt_motion_from_means, list_lines_from_means};
use super::motion::simulate_windows;
use super::places::CellMiddles;
use super::window::ClickWindow;
use crate::PlanTable;
use crate::physics::rise::PanelPoles;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Columns and rows of the places on a plate; a bar has one row.
const GRID: (u32, u32) = (6, 4);
/// Velocity of 0 dB in m/s.
const REFERENCE_M_PER_S: f64 = 1e-3;

/// The A-weighting of a frequency as a factor of an amplitude, 1 at 1 kHz (IEC 61672-1).
#[must_use]
pub fn weigh_amplitude_like_ear(frequency_hz: f64) -> f64 {
    let weigh = |hz: f64| {
        let [square, low, lower_middle, upper_middle, high] =
            [hz, 20.598_997, 107.652_65, 737.862_23, 12_194.217].map(|hz| hz * hz);
        let middle = ((square + lower_middle) * (square + upper_middle)).sqrt();
        high * square * square / ((square + low) * middle * (square + high))
    };
    weigh(frequency_hz) / weigh(1000.0)
}

/// Mean square in (m/s)^2 of the A-weighted velocity, up to 1 kHz and over 1 s, of a place whose mean acceleration in m/s^2 over each sample is given.
#[must_use]
pub fn compute_weighted_mean_square_velocity(means: &[f64]) -> f64 {
    let square = |(line, hz): (Complex64, u32)| {
        let hz = f64::from(hz);
        // A line and that of the negative frequency.
        2.0 * line.norm_sqr() * (weigh_amplitude_like_ear(hz) / (TAU * hz)).powi(2)
    };
    list_lines_from_means(means, LAST_SHOWN_LINE).into_iter().zip(1_u32..).map(square).sum()
}

/// What windows do to the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFigures {
    /// The mean over places of the A-weighted mean-square velocity, in dB relative to that of 1 mm/s.
    pub sound_db: f64,
    /// Mean square over time of the felt acceleration at the target over the mean of it over places, in dB.
    pub contrast_db: f64,
}

/// What windows do to the surface, `felt_motion` being the felt acceleration of [`felt_motion_from_means`] at the target; `None` if nothing
/// moves.
#[must_use]
pub fn compute_surface_figures_if_anything_moves(
    table: &PlanTable,
    poles: &PanelPoles,
    windows: &[ClickWindow],
    felt_motion: &[f64],
) -> Option<SurfaceFigures> {
    let (columns, rows) = GRID;
    let places = CellMiddles::find_on_surface(&table.scene, columns, rows).places_m;
    let shapes: Vec<DVector<f64>> =
        places.into_iter().flatten().map(|(x_m, y_m)| table.model.shape_deflections_at(x_m, y_m)).collect();
    let motion = simulate_windows(table, poles, &shapes, windows);
    #[expect(clippy::cast_precision_loss, reason = "some places")]
    let mean_over_places = |square: &dyn Fn(&[f64]) -> f64| {
        motion.mean_acceleration.iter().map(|means| square(means)).sum::<f64>() / shapes.len().max(1) as f64
    };
    let sum_of_squares = |felt: &[f64]| felt.iter().map(|x| x * x).sum::<f64>();
    let velocity = mean_over_places(&compute_weighted_mean_square_velocity);
    let elsewhere = mean_over_places(&|means| sum_of_squares(&felt_motion_from_means(means)));
    let target = sum_of_squares(felt_motion);
    (velocity > 0.0 && elsewhere > 0.0 && target > 0.0).then(|| SurfaceFigures {
        sound_db: 10.0 * (velocity / (REFERENCE_M_PER_S * REFERENCE_M_PER_S)).log10(),
        contrast_db: 10.0 * (target / elsewhere).log10(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::felt::SAMPLE_S;
    use super::*;
    use crate::TableOptions;
    use crate::model::{Accuracy, levels::ReducedLevels};
    use crate::scene::{EXAMPLE_BAR, Scene};
    use era_shared::waveform::Electrode;

    fn build_bar_table() -> PlanTable {
        let (scene, grid) = (Scene::parse("bar", EXAMPLE_BAR).unwrap(), TableOptions::default());
        let levels = ReducedLevels::build(&scene, Accuracy::FAST, grid.to_hz).unwrap();
        PlanTable::from_levels(&scene, levels, grid).unwrap()
    }

    /// Sines of 1 mm/s have the weighting of the table in IEC 61672-1.
    #[test]
    fn sines_have_the_tabulated_weighting() {
        for (hz, expected_db) in [(100.0, -19.1), (200.0, -10.9), (500.0, -3.2), (1000.0, 0.0)] {
            // Mean accelerations of the velocity sqrt(2) mm/s sin(2 pi f t), whose mean square is (1 mm/s)^2.
            let velocity = |k: u32| 2.0_f64.sqrt() * 1e-3 * (TAU * hz * f64::from(k) * SAMPLE_S).sin();
            let means: Vec<f64> = (0..4000).map(|k| (velocity(k + 1) - velocity(k)) / SAMPLE_S).collect();
            let found_db = 10.0 * (compute_weighted_mean_square_velocity(&means) / 1e-6).log10();
            assert!((found_db - expected_db).abs() < 0.1, "{hz} Hz: {found_db} dB");
        }
    }

    /// Twice the force is 6.02 dB; nothing is no number.
    #[test]
    fn forces_twice_as_large_are_6_db_louder() {
        let table = build_bar_table();
        let poles = table.panel_poles().unwrap();
        let sound_db = |voltage_v: f64| {
            let window =
                ClickWindow { actuator: 0, electrode: Electrode::A, begin_s: 1e-3, width_s: 0.5e-3, voltage_v };
            compute_surface_figures_if_anything_moves(&table, poles, &[window], &[1.0]).map(|found| found.sound_db)
        };
        // Forces grow with the square of the voltage.
        let added_db = sound_db(20.0 * 2.0_f64.sqrt()).unwrap() - sound_db(20.0).unwrap();
        assert!((added_db - 6.02).abs() < 0.005, "{added_db} dB");
        assert_eq!(compute_surface_figures_if_anything_moves(&table, poles, &[], &[1.0]), None);
    }

    /// The mean of the contrasts' ratios, inverted, over the places is 1: each place is as likely a target as any other. A place that does not
    /// feel anything has no contrast.
    #[test]
    fn contrasts_of_the_places_average_out() {
        let table = build_bar_table();
        let poles = table.panel_poles().unwrap();
        let window =
            ClickWindow { actuator: 1, electrode: Electrode::B, begin_s: 1e-3, width_s: 0.5e-3, voltage_v: 900.0 };
        let shapes: Vec<DVector<f64>> = CellMiddles::find_on_surface(&table.scene, GRID.0, GRID.1)
            .places_m
            .into_iter()
            .flatten()
            .map(|(x_m, y_m)| table.model.shape_deflections_at(x_m, y_m))
            .collect();
        let motion = simulate_windows(&table, poles, &shapes, &[window]);
        let ratio = |means: &Vec<f64>| {
            let felt = felt_motion_from_means(means);
            let found = compute_surface_figures_if_anything_moves(&table, poles, &[window], &felt).unwrap();
            10.0_f64.powf(found.contrast_db / 10.0)
        };
        let ratios: Vec<f64> = motion.mean_acceleration.iter().map(ratio).collect();
        #[expect(clippy::cast_precision_loss, reason = "six places")]
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        assert!((mean - 1.0).abs() < 1e-9 && ratios.iter().any(|ratio| *ratio > 1.2), "{ratios:?}");
        assert_eq!(compute_surface_figures_if_anything_moves(&table, poles, &[window], &[0.0]), None);
    }
}
