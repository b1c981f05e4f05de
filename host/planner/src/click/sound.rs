//! What a click does to the whole surface: how much less it moves than the target, and how loud it is: the mean-square velocity, with the
//! A-weighting of sound level meters.
//!
//! A surface radiates more sound the faster it moves, and the ear hears low frequencies less. The figure compares clicks of one panel; it is
//! no sound pressure.
//!
//! The lines F_i of the actuators' forces move a place by the sum of a_i F_i, so that the mean of the squares over the places is the sum over all
//! pairs of mean(conj(a_i) a_j) conj(F_i) F_j. These means are worked out once for a panel, at every line. A record of 1 s begins again at its end:
//! the figures are those of a click once a second.

use super::felt::{LAST_LINE, LAST_SHOWN_LINE, spectral_lines_from_25_us_step_means, weigh_frequency};
use super::places::CellMiddles;
use crate::PlanTable;
use crate::physics::PerPair;
use crate::physics::rise::{PanelPoles, PointResidues};
use crate::scene::MAX_ACTUATORS;
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

/// What windows do to the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFigures {
    /// The mean over places of the A-weighted mean-square velocity up to 1 kHz, in dB relative to that of 1 mm/s.
    pub sound_db: f64,
    /// Mean square over time of the felt acceleration at the target over the mean of it over places, in dB.
    pub contrast_db: f64,
}

/// What forces do to the surface, given in N over each step for every actuator, `target` being the residues at the target; `None` if
/// nothing moves.
#[must_use]
pub fn compute_click_sound_and_contrast_db_if_anything_moves(
    table: &PlanTable,
    poles: &PanelPoles,
    target: &PointResidues,
    forces_n: &[Vec<f64>],
) -> Option<SurfaceFigures> {
    let products = get_or_compute_mean_acceleration_products_of_cells(table, poles);
    let forces: Vec<Vec<Complex64>> =
        forces_n.iter().map(|steps| spectral_lines_from_25_us_step_means(steps, LAST_SHOWN_LINE)).collect();
    let line_of = |forces: &Vec<Complex64>, line: usize| forces.get(line).copied().unwrap_or(Complex64::ZERO);
    let (mut velocity, mut elsewhere) = (0.0, 0.0);
    for ((line, products), hz) in products.iter().enumerate().zip((1_u32..).map(f64::from)) {
        let mut square = 0.0;
        for (row, first) in products.iter().zip(&forces) {
            for (product, second) in row.iter().zip(&forces) {
                square += (product * line_of(first, line).conj() * line_of(second, line)).re;
            }
        }
        // A line and that of the negative frequency.
        velocity += 2.0 * square * (weigh_amplitude_like_ear(hz) / (TAU * hz)).powi(2);
        elsewhere += 2.0 * square * weigh_frequency(hz).powi(2);
    }
    let last_felt_hz = u32::try_from(LAST_LINE).unwrap_or(u32::MAX);
    let at_target = target.accelerations_per_n_by_point_and_actuator_from_1_hz_poles_scaled(last_felt_hz, |_| 1.0);
    let square_at_target = |line: usize| {
        let motion: Complex64 =
            at_target.iter().zip(&forces).map(|(own, f)| line_of(own, line) * line_of(f, line)).sum();
        2.0 * motion.norm_sqr()
    };
    let target: f64 = (0..LAST_LINE)
        .zip(1_u32..)
        .map(|(line, hz)| square_at_target(line) * weigh_frequency(f64::from(hz)).powi(2))
        .sum();
    (velocity > 0.0 && elsewhere > 0.0 && target > 0.0).then(|| SurfaceFigures {
        sound_db: 10.0 * (velocity / (REFERENCE_M_PER_S * REFERENCE_M_PER_S)).log10(),
        contrast_db: 10.0 * (target / elsewhere).log10(),
    })
}

/// Mode shapes at the places.
fn mode_shape_values_at_each_cell_middle(table: &PlanTable) -> Vec<DVector<f64>> {
    let (columns, rows) = GRID;
    let places = CellMiddles::find_on_surface(&table.scene, columns, rows).places_m;
    places.into_iter().flatten().map(|(x_m, y_m)| table.model.shape_deflections_at(x_m, y_m)).collect()
}

/// At 1, 2, ... Hz the means over the places of conj(a_i) a_j, a the acceleration in m/s^2 for 1 N at one actuator: computed at the first call.
pub fn get_or_compute_mean_acceleration_products_of_cells<'a>(
    table: &'a PlanTable,
    poles: &PanelPoles,
) -> &'a [PerPair] {
    table.products_of_cells.get_or_init(|| compute_mean_acceleration_products_of_cells_at_each_hz(table, poles))
}

fn compute_mean_acceleration_products_of_cells_at_each_hz(table: &PlanTable, poles: &PanelPoles) -> Vec<PerPair> {
    let shapes = mode_shape_values_at_each_cell_middle(table);
    let actuators = table.electrodes.len().clamp(1, MAX_ACTUATORS);
    let last_hz = u32::try_from(LAST_SHOWN_LINE).unwrap_or(u32::MAX);
    let accelerations = poles
        .residues_at_shapes(&shapes)
        .accelerations_per_n_by_point_and_actuator_from_1_hz_poles_scaled(last_hz, |_| 1.0);
    let mut products = vec![PerPair::default(); LAST_SHOWN_LINE];
    #[expect(clippy::cast_precision_loss, reason = "some places")]
    let part = 1.0 / shapes.len().max(1) as f64;
    for place in accelerations.chunks(actuators) {
        for (i, first) in place.iter().enumerate() {
            for (j, second) in place.iter().enumerate() {
                for ((products, a), b) in products.iter_mut().zip(first).zip(second) {
                    products[i][j] += part * a.conj() * b;
                }
            }
        }
    }
    products
}

#[cfg(test)]
mod tests {
    use super::super::felt::{MEAN_S, MEANS, filter_50_us_means_to_felt_motion_at_16_khz};
    use super::super::motion::{WindowMotion, simulate_windows};
    use super::super::window::ClickWindow;
    use super::*;
    use crate::TableOptions;
    use crate::model::{Accuracy, levels::ReducedLevels};
    use crate::scene::{EXAMPLE_BAR, EXAMPLE_PLATE, Scene};
    use era_shared::waveform::Electrode;

    fn build_table(text: &str) -> PlanTable {
        let (scene, grid) = (Scene::parse("panel", text).unwrap(), TableOptions::default());
        let levels = ReducedLevels::build(&scene, Accuracy::FAST, grid.to_hz).unwrap();
        PlanTable::from_levels(&scene, levels, grid).unwrap()
    }

    fn make_window(actuator: usize, electrode: Electrode, begin_s: f64, voltage_v: f64) -> ClickWindow {
        ClickWindow { actuator, electrode, begin_s, width_s: 0.6e-3, voltage_v }
    }

    /// What the windows do at the places, and the figures of the surface with the target at the place with this number.
    fn simulate_and_compute_figures(
        table: &PlanTable,
        windows: &[ClickWindow],
        target: usize,
    ) -> (WindowMotion, Option<SurfaceFigures>) {
        let (poles, shapes) = (table.panel_poles().unwrap(), mode_shape_values_at_each_cell_middle(table));
        let motion = simulate_windows(table, poles, &shapes, windows);
        let residues = poles.residues_at_shape(&shapes[target]);
        let figures = compute_click_sound_and_contrast_db_if_anything_moves(table, poles, &residues, &motion.forces_n);
        (motion, figures)
    }

    /// Sines of 1 mm/s have the weighting of the table in IEC 61672-1.
    #[test]
    fn frequencies_have_the_tabulated_weighting() {
        for (hz, expected_db) in [(100.0, -19.1), (200.0, -10.9), (500.0, -3.2), (1000.0, 0.0)] {
            let found_db = 20.0 * weigh_amplitude_like_ear(hz).log10();
            assert!((found_db - expected_db).abs() < 0.1, "{hz} Hz: {found_db} dB");
        }
    }

    /// Twice the force is 6.02 dB; nothing is no number.
    #[test]
    fn forces_twice_as_large_are_6_db_louder() {
        let table = build_table(EXAMPLE_BAR);
        let sound_db = |voltage_v: f64| {
            let windows = [make_window(0, Electrode::A, 1e-3, voltage_v)];
            simulate_and_compute_figures(&table, &windows, 0).1.map(|found| found.sound_db)
        };
        // Forces grow with the square of the voltage.
        let added_db = sound_db(20.0 * 2.0_f64.sqrt()).unwrap() - sound_db(20.0).unwrap();
        assert!((added_db - 6.02).abs() < 0.005, "{added_db} dB");
        assert_eq!(simulate_and_compute_figures(&table, &[], 0).1, None);
    }

    /// The motion of every place in time gives the same figures: the mean squares of its felt acceleration, and of its velocity, whose sines
    /// are weighed one by one.
    #[test]
    fn figures_are_those_of_the_motion_in_time() {
        for text in [EXAMPLE_BAR, EXAMPLE_PLATE] {
            let table = build_table(text);
            let last = table.electrodes.len() - 1;
            let windows = [
                make_window(0, Electrode::A, 1e-3, 1700.0),
                make_window(last, Electrode::B, 2.3e-3, 1500.0),
                make_window(0, Electrode::B, 6e-3, 1700.0),
                make_window(last, Electrode::A, 9e-3, 1500.0),
            ];
            let (motion, found) = simulate_and_compute_figures(&table, &windows, 2);
            let found = found.unwrap();
            let places = motion.mean_acceleration.len();
            let felt: Vec<f64> = motion
                .mean_acceleration
                .iter()
                .map(|means| filter_50_us_means_to_felt_motion_at_16_khz(means).iter().map(|x| x * x).sum::<f64>())
                .collect();
            #[expect(clippy::cast_precision_loss, reason = "24 places")]
            let count = places as f64;
            let contrast_db = 10.0 * (felt[2] * count / felt.iter().sum::<f64>()).log10();
            assert!((found.contrast_db - contrast_db).abs() < 0.002, "{} {contrast_db}", found.contrast_db);
            let mut square = 0.0;
            for means in &motion.mean_acceleration {
                for hz in (1..=1000).map(f64::from) {
                    // The velocity's part at this frequency, from the accelerations' sum with a sine and a cosine.
                    let turn = |k: usize| {
                        #[expect(clippy::cast_precision_loss, reason = "20000 means")]
                        let time_s = (k as f64 + 0.5) / MEANS as f64;
                        Complex64::cis(-TAU * hz * time_s)
                    };
                    let line: Complex64 = means.iter().enumerate().map(|(k, x)| x * MEAN_S * turn(k)).sum();
                    let mean = (TAU * hz * MEAN_S / 2.0).sin() / (TAU * hz * MEAN_S / 2.0);
                    let velocity = line.norm() / mean / (TAU * hz) * weigh_amplitude_like_ear(hz);
                    square += 2.0 * velocity * velocity / count;
                }
            }
            let sound_db = 10.0 * (square / 1e-6).log10();
            assert!((found.sound_db - sound_db).abs() < 0.01, "{} {sound_db}", found.sound_db);
        }
    }

    /// The mean of the contrasts' ratios, inverted, over the places is 1: each place is as likely a target as any other.
    #[test]
    fn contrasts_of_the_places_average_out() {
        let table = build_table(EXAMPLE_BAR);
        let windows = [make_window(1, Electrode::B, 1e-3, 900.0)];
        let ratio = |target: usize| {
            let found = simulate_and_compute_figures(&table, &windows, target).1.unwrap();
            10.0_f64.powf(found.contrast_db / 10.0)
        };
        let ratios: Vec<f64> = (0..6).map(ratio).collect();
        let mean = ratios.iter().sum::<f64>() / 6.0;
        assert!((mean - 1.0).abs() < 1e-9 && ratios.iter().any(|ratio| *ratio > 1.2), "{ratios:?}");
    }
}
