//! Computes the entries of a plan table.

use super::entry::choose_widest_pulse_if_noticeably_stronger;
use super::forces::{
    DriverModel, MotionPerN, WIDEST_PULSE, WIDTHS, bound_overshoot_of_each_mass_or_whole_motion_m_per_n,
    build_pulse_option_with_max_force, choose_quietest_and_widest_pulse, compute_travel_of_each_actuator,
    compute_travel_overshoots_m_per_n_and_rail_voltage_at_max_force,
};
use super::quadrature::compute_mean_shape_products_over_surface;
use super::{ComputedTable, Entry, HARMONICS, PlanTable, SurfaceGrid, TableOptions};
use crate::model::ReducedModel;
use crate::physics::PerPair;
use crate::physics::limits::Electrodes;
use crate::physics::rise::{PanelPoles, SwitchOnModel};
use crate::physics::softening::{Transducer, static_receptance_magnitude_or_infinity_m_per_n};
use crate::response::sweep::SurfaceShapes;
use crate::response::{CoordinateSolver, ResponseError};
use crate::scene::{MAX_ACTUATORS, Scene};
use crate::table::press::{PressEffect, compute_sag_and_stop_under_press_for_each_actuator};
use crate::{HIGHEST_FELT_HZ, perception};
use era_shared::supply::rail_index_of_channel;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Frequencies of which fields are held at once: at 4 actuators and 1617 points 3 MB.
const CHUNK: usize = 32;
/// |acceleration|^2 between the points of the surface's grid over the largest at them: a crest halfway between two of twelve
/// per wave is (1 / cos(pi/12))^2 = 1.07 higher, and rounding to single precision is far below. Of slopes, which are taken
/// between points, 1.02 (pi/24 / sin(pi/24)).
const BETWEEN: f64 = 1.1;

/// Times the steady travel that a mass has room for where it is far from its limit. Switching on takes it to 2.5 times that where one pole
/// moves it; another actuator may take as much.
const FAR: f64 = 6.0;

/// Acceleration per newton, root mean square over the surface, which is as good as none, relative to that of the surface without
/// anything that holds it. Rounding leaves 1e-12 or so of it; a spring of 1e9 N/m under an actuator 1e-5.
const FIXED_POINT_MOTION_RATIO: f64 = 1e-9;

/// What a table is computed for. It decides which figures are left out.
#[derive(Clone, Copy, Debug)]
pub(super) enum TablePurpose<'a> {
    /// Plans: all of an [`Entry`].
    Plans,
    /// The strongest drives alone. They weigh no energies: mean squares are rough, those of harmonics and figures that take a look at
    /// every point are left out, and of the pulse widths that are quieter than the widest there is but one: that of another table, or the first.
    Strongest(Option<&'a PlanTable>),
    /// The same of a place that is touched, another table's, without free motion: what switching on adds is a single pole's whole motion.
    Roughly(&'a PlanTable),
}

impl<'a> TablePurpose<'a> {
    /// Whether the table has everything that a plan needs.
    fn is_for_plans(self) -> bool {
        matches!(self, Self::Plans)
    }

    /// The table of the same panel without a finger, if the purpose has one.
    fn table_without_finger(self) -> Option<&'a PlanTable> {
        match self {
            Self::Plans => None,
            Self::Strongest(untouched) => untouched,
            Self::Roughly(untouched) => Some(untouched),
        }
    }
}

/// Computes the table of a model. `known_press_effects` holds the effect of a press on the actuators; `None` computes it from this
/// model.
pub(super) fn build_table(
    scene: &Scene,
    model: ReducedModel,
    options: TableOptions,
    known_press_effects: Option<&[PressEffect]>,
) -> Result<PlanTable, ResponseError> {
    let mut computed = compute_table_without_surface_mean_max_and_slope(scene, model, options, known_press_effects)?;
    fill_surface_mean_max_and_slope_of_each_entry(scene, &mut computed)?;
    Ok(PlanTable::from_computed(scene, computed))
}

/// Computes the parts of a table except the figures that need every point of the surface: `mean_magnitude_over_surface`,
/// `max_square` and `max_slope` of every entry are 0. All limits of voltage, force and travel are included.
pub(super) fn compute_table_without_surface_mean_max_and_slope(
    scene: &Scene,
    model: ReducedModel,
    options: TableOptions,
    known_press_effects: Option<&[PressEffect]>,
) -> Result<ComputedTable, ResponseError> {
    let grid = SurfaceGrid::new(scene, &model, options.to_hz);
    let products = compute_mean_shape_products_over_surface(scene, &model);
    compute_table_parts(
        scene,
        model,
        options.frequencies_hz(),
        (grid, products),
        TablePurpose::Plans,
        known_press_effects,
    )
}

/// Computes a table for the strongest drives only, at these frequencies and over these points. For a touched panel
/// the purpose holds the table without the finger, from which the press effects and the quiet pulse widths are taken.
pub(super) fn build_table_for_strongest_drives_only(
    scene: &Scene,
    model: ReducedModel,
    frequencies_hz: Vec<f64>,
    grid: SurfaceGrid,
    purpose: TablePurpose<'_>,
) -> Result<PlanTable, ResponseError> {
    let mut weighted = grid.shapes.clone();
    for (mut row, weight) in weighted.row_iter_mut().zip(&grid.weights) {
        row *= *weight;
    }
    let products = grid.shapes.tr_mul(&weighted);
    let pressed = purpose.table_without_finger().map(|own| &*own.pressed);
    let computed = compute_table_parts(scene, model, frequencies_hz, (grid, products), purpose, pressed)?;
    Ok(PlanTable::from_computed(scene, computed))
}

/// Computes the parts of a table from a model, frequencies, points and shape products.
fn compute_table_parts(
    scene: &Scene,
    model: ReducedModel,
    frequencies_hz: Vec<f64>,
    (grid, products): (SurfaceGrid, DMatrix<f64>),
    purpose: TablePurpose<'_>,
    known_press_effects: Option<&[PressEffect]>,
) -> Result<ComputedTable, ResponseError> {
    let receptance = static_receptance_magnitude_or_infinity_m_per_n(&model);
    let (electrodes, pressed) =
        find_electrodes_and_press_effects(scene, &model, &grid, &receptance, known_press_effects);
    let transducers: Vec<Transducer> = scene.actuators.iter().map(Transducer::from_actuator).collect();
    let solver = CoordinateSolver::new(&model);
    let free = if matches!(purpose, TablePurpose::Roughly(_)) {
        None
    } else {
        find_poles_and_switch_on_model_if_converged(&model)
    };
    let onset = free.as_ref().map(|(_, onset)| onset);
    let drivers = list_electrodes_transducer_and_receptance_of_each_actuator(&electrodes, &transducers, &receptance);
    let mass_kg = scene.surface_mass_with_air_kg();
    let panel = EntryContext { model: &model, mass_kg, products: &products, drivers: &drivers, onset, purpose };
    let columns: Vec<Option<Vec<Entry>>> = frequencies_hz
        .par_iter()
        .map(|frequency_hz| compute_entries_of_all_actuators_unless_unbounded(panel, &solver, *frequency_hz))
        .collect::<Result<_, _>>()?;
    let entries = (0..electrodes.len())
        .map(|actuator| columns.iter().map(|column| column.as_ref()?.get(actuator).cloned()).collect())
        .collect();
    Ok(ComputedTable { model, frequencies_hz, entries, electrodes, pressed, grid, products, free })
}

/// The poles of the panel's free motion and their effect when drives are switched on; `None` if the poles cannot be
/// found.
fn find_poles_and_switch_on_model_if_converged(model: &ReducedModel) -> Option<(PanelPoles, SwitchOnModel)> {
    let rise = PanelPoles::find_poles_if_converged(model)?;
    let onset = rise.build_switch_on_model(model);
    Some((rise, onset))
}

/// For each actuator its electrodes, its transducer and its own static receptance.
fn list_electrodes_transducer_and_receptance_of_each_actuator<'a>(
    electrodes: &'a [Electrodes],
    transducers: &'a [Transducer],
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
) -> Vec<DriverModel<'a>> {
    let own = electrodes.iter().zip(transducers).enumerate();
    own.map(|(i, (electrodes, transducer))| DriverModel {
        electrodes,
        transducer,
        // Of one too many nothing is known; plans refuse it.
        static_receptance: static_receptance.get(i).and_then(|row| row.get(i)).copied().unwrap_or(f64::INFINITY),
    })
    .collect()
}

/// What all entries of a table have in common.
#[derive(Clone, Copy)]
struct EntryContext<'a> {
    model: &'a ReducedModel,
    mass_kg: f64,
    products: &'a DMatrix<f64>,
    drivers: &'a [DriverModel<'a>],
    onset: Option<&'a SwitchOnModel>,
    purpose: TablePurpose<'a>,
}

/// The electrodes of the scene's actuators, with the rail's voltage limit and the gap that a press leaves, and the
/// press effects themselves.
fn find_electrodes_and_press_effects(
    scene: &Scene,
    model: &ReducedModel,
    grid: &SurfaceGrid,
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
    known_press_effects: Option<&[PressEffect]>,
) -> (Vec<Electrodes>, Vec<PressEffect>) {
    let mut electrodes =
        lower_max_voltages_to_lowest_on_same_rail(scene.actuators.iter().map(Electrodes::from_actuator).collect());
    let pressed = known_press_effects.map_or_else(
        || compute_sag_and_stop_under_press_for_each_actuator(scene, model, grid, &electrodes, static_receptance),
        <[_]>::to_vec,
    );
    for (own, pressed) in electrodes.iter_mut().zip(&pressed) {
        (own.stop_m, own.sag_m) = (pressed.stop_m, pressed.sag_m);
    }
    (electrodes, pressed)
}

/// Lowers every actuator's highest voltage to the least one of all actuators on its rail.
fn lower_max_voltages_to_lowest_on_same_rail(electrodes: Vec<Electrodes>) -> Vec<Electrodes> {
    let least = |rail: usize| {
        let own = electrodes.iter().enumerate().filter(|(i, _)| rail_index_of_channel(*i) == rail);
        own.map(|(_, electrodes)| electrodes.max_voltage_v).fold(f64::INFINITY, f64::min)
    };
    let limited =
        |(i, own): (usize, &Electrodes)| Electrodes { max_voltage_v: least(rail_index_of_channel(i)), ..*own };
    electrodes.iter().enumerate().map(limited).collect()
}

/// For each frequency the acceleration coordinates of all actuators of a model per newton; `None` where the response
/// is unbounded.
pub(super) fn acceleration_coordinates_per_newton_of_each_actuator_by_frequency(
    model: &ReducedModel,
    frequencies_hz: &[f64],
) -> Vec<Option<Vec<DVector<Complex64>>>> {
    let solver = CoordinateSolver::new(model);
    let row = |frequency_hz: &f64| -> Option<Vec<DVector<Complex64>>> {
        let scale = Complex64::from(-(TAU * frequency_hz).powi(2));
        Some(solver.solve_coordinates_per_newton_at(*frequency_hz).ok()?.into_iter().map(|q| q * scale).collect())
    };
    frequencies_hz.par_iter().map(row).collect()
}

/// The entries of all actuators at one frequency, without the figures that need every point of the surface; `None`
/// where the response is unbounded.
fn compute_entries_of_all_actuators_unless_unbounded(
    panel: EntryContext<'_>,
    solver: &CoordinateSolver<'_>,
    frequency_hz: f64,
) -> Result<Option<Vec<Entry>>, ResponseError> {
    let EntryContext { model, mass_kg, products, drivers, onset, purpose } = panel;
    let coordinates = match solver.solve_coordinates_per_newton_at(frequency_hz) {
        Ok(coordinates) => coordinates,
        Err(error) if error.is_unbounded() => return Ok(None),
        Err(error) => return Err(error),
    };
    let harmonics = compute_mean_squares_and_travel_at_each_odd_harmonic(
        model,
        solver,
        purpose.is_for_plans().then_some(products),
        frequency_hz,
    );
    let scale = Complex64::from(-(TAU * frequency_hz).powi(2));
    let entries = coordinates.into_iter().zip(drivers).enumerate().map(|(actuator, (displacement, driver))| {
        let travel = compute_travel_of_each_actuator(model, &displacement);
        let mut harmonic_travel = [[0.0; MAX_ACTUATORS]; HARMONICS.len()];
        for (row, harmonic) in harmonic_travel.iter_mut().zip(&harmonics) {
            *row = harmonic.travel.get(actuator).copied().unwrap_or_default();
        }
        // With a finger every place has a table of its own, and what two masses share of a limit is not looked at again elsewhere.
        let is_far = matches!(purpose, TablePurpose::Strongest(None))
            && is_far_from_travel_limits_at_max_voltage(drivers, driver.electrodes, frequency_hz, &travel);
        let onset = onset.filter(|_| !is_far);
        let (overshoot, onset_v) = compute_travel_overshoots_m_per_n_and_rail_voltage_at_max_force(
            onset,
            actuator,
            frequency_hz,
            driver.electrodes,
            &travel,
        );
        let charging = driver.electrodes.charging_at(frequency_hz);
        let width = |pulse_width: f64| {
            let square = |harmonic: &HarmonicResponse| {
                charging.force_harmonic_phasor_over_fundamental_amplitude(harmonic.number, pulse_width).norm_sqr()
                    * harmonic.squares.get(actuator).copied().unwrap_or(0.0)
            };
            let surface = harmonics.iter().map(square).sum();
            let felt = |harmonic: &HarmonicResponse| {
                // What no one feels has no square.
                let hz = (harmonic.number * frequency_hz).min(HIGHEST_FELT_HZ);
                perception::felt_weight_relative_to_reference_hz(hz).powi(2) * square(harmonic)
            };
            let surface = [surface, harmonics.iter().map(felt).sum()];
            let motion = MotionPerN { travel: &travel, harmonics: &harmonic_travel, overshoot: &overshoot, charging };
            build_pulse_option_with_max_force(*driver, actuator, motion, frequency_hz, pulse_width, surface)
        };
        let known = purpose
            .table_without_finger()
            .and_then(|other| other.quiet_pulse_width_if_frequency_in_table(actuator, frequency_hz));
        let quieter = known
            .as_ref()
            .map_or(if purpose.is_for_plans() { &WIDTHS[..] } else { &WIDTHS[..1] }, std::slice::from_ref);
        let widths = choose_quietest_and_widest_pulse(frequency_hz, quieter, width);
        let strongest = *choose_widest_pulse_if_noticeably_stronger(&widths);
        let mut acceleration = displacement * scale;
        let mean_square = mean_square_over_surface(products, &acceleration);
        if mean_square.sqrt() <= FIXED_POINT_MOTION_RATIO / mass_kg {
            // An ERA on an edge that does not move: of what rounding leaves a touch would ask for all its force.
            acceleration.fill(Complex64::ZERO);
        }
        Entry {
            charging,
            mean_square,
            mean: 0.0,
            most_square: 0.0,
            steepest: 0.0,
            acceleration,
            travel,
            harmonic_travel,
            overshoot,
            onset_v,
            widths,
            max_force_n: strongest.max_force_n,
            limit: strongest.limit,
        }
    });
    Ok(Some(entries.collect()))
}

/// Whether every mass stays far below its travel limit under the largest force that the actuator's voltage allows,
/// whatever switching on adds.
fn is_far_from_travel_limits_at_max_voltage(
    drivers: &[DriverModel<'_>],
    driven: &Electrodes,
    frequency_hz: f64,
    travel: &[Complex64; MAX_ACTUATORS],
) -> bool {
    let most_n = driven.harmonic_force_n_per_v2(1, frequency_hz, WIDEST_PULSE) * driven.max_voltage_v.powi(2);
    travel.iter().zip(drivers).all(|(z, other)| FAR * most_n * z.norm() < other.electrodes.max_travel_m())
}

/// Mean square over the surface of a motion with these coordinates.
pub(super) fn mean_square_over_surface(products: &DMatrix<f64>, coordinates: &DVector<Complex64>) -> f64 {
    let part = |of: &dyn Fn(&Complex64) -> f64| {
        let x = DVector::from_iterator(coordinates.len(), coordinates.iter().map(of));
        x.dot(&(products * &x))
    };
    (part(&|z| z.re) + part(&|z| z.im)).max(0.0)
}

/// For each frequency of the grid the means over the surface of conj(a_i) a_j for all pairs of actuators; zeros where
/// the response is unbounded.
pub(super) fn mean_products_over_surface_at_each_frequency(
    products: &DMatrix<f64>,
    entries: &[Vec<Option<Entry>>],
) -> Vec<PerPair> {
    let frequencies = entries.first().map_or(0, Vec::len);
    (0..frequencies)
        .into_par_iter()
        .map(|k| {
            let mut sums = PerPair::default();
            let row: Vec<_> = entries.iter().filter_map(|list| list[k].as_ref()).collect();
            let part = |of: fn(&Complex64) -> f64, entry: &Entry| entry.acceleration.map(|z| of(&z));
            for (j, b) in row.iter().enumerate().take(MAX_ACTUATORS) {
                let (re, im) = (products * part(|z| z.re, b), products * part(|z| z.im, b));
                for (i, a) in row.iter().enumerate().take(MAX_ACTUATORS) {
                    let terms = a.acceleration.iter().zip(re.iter().zip(im.iter()));
                    sums[i][j] = terms.map(|(a, (re, im))| a.conj() * Complex64::new(*re, *im)).sum();
                }
            }
            sums
        })
        .collect()
}

/// Response of all actuators at an odd multiple of a frequency, per newton.
struct HarmonicResponse {
    number: f64,
    /// Mean square over the surface.
    squares: Vec<f64>,
    /// Of each actuator's force the |travel| of all.
    travel: Vec<[f64; MAX_ACTUATORS]>,
}

/// The responses at every odd harmonic up to the highest frequency that is felt, and at [`HARMONICS`] in any case.
/// Without `products` only [`HARMONICS`] are computed, without mean squares. A harmonic with an unbounded response is
/// left out: that is an undamped resonance, which a force edge of finite length does not excite.
fn compute_mean_squares_and_travel_at_each_odd_harmonic(
    model: &ReducedModel,
    solver: &CoordinateSolver<'_>,
    products: Option<&DMatrix<f64>>,
    frequency_hz: f64,
) -> Vec<HarmonicResponse> {
    let last = HARMONICS[HARMONICS.len() - 1];
    let is_felt = |number: f64| products.is_some() && number * frequency_hz <= HIGHEST_FELT_HZ;
    let numbers = (1..).map(|k| f64::from(2 * k + 1)).take_while(|n| *n <= last || is_felt(*n));
    numbers
        .map(|number| {
            let scale = Complex64::from(-(TAU * number * frequency_hz).powi(2));
            let coordinates = solver.solve_coordinates_per_newton_at(number * frequency_hz).unwrap_or_default();
            let square = |q: &DVector<Complex64>| {
                products
                    .filter(|_| is_felt(number))
                    .map_or(0.0, |products| mean_square_over_surface(products, &(q * scale)))
            };
            HarmonicResponse {
                number,
                squares: coordinates.iter().map(square).collect(),
                travel: coordinates
                    .iter()
                    .map(|q| compute_travel_of_each_actuator(model, q).map(|z| z.norm()))
                    .collect(),
            }
        })
        .collect()
}

/// Fills in the mean and the largest magnitude and the largest slope of every entry over the surface.
fn fill_surface_mean_max_and_slope_of_each_entry(
    scene: &Scene,
    computed: &mut ComputedTable,
) -> Result<(), ResponseError> {
    let ComputedTable { model, grid, frequencies_hz, entries, .. } = computed;
    let known: Vec<usize> =
        (0..frequencies_hz.len()).filter(|k| entries.iter().all(|list| list[*k].is_some())).collect();
    let shapes = SurfaceShapes::<f32>::new(scene, model, &grid.x_m, &grid.y_m);
    let chunks: Vec<Vec<[f64; 3]>> = known
        .par_chunks(CHUNK)
        .map(|chunk| {
            let hz: Vec<f64> = chunk.iter().map(|k| frequencies_hz[*k]).collect();
            let sweep = shapes.compute_accelerations_per_newton_at_all_points(&hz)?;
            let figures = (0..chunk.len()).flat_map(|k| (0..sweep.actuators).map(move |i| (k, i)));
            Ok(figures
                .map(|(k, i)| {
                    mean_magnitude_and_bounds_of_square_and_slope(
                        sweep.accelerations_per_newton_of_all_points(k, i),
                        grid,
                    )
                })
                .collect())
        })
        .collect::<Result<_, ResponseError>>()?;
    let mut figures = chunks.into_iter().flatten();
    for k in known {
        for list in entries.iter_mut() {
            if let (Some(entry), Some([mean, most_square, steepest])) = (&mut list[k], figures.next()) {
                entry.mean = mean;
                entry.most_square = most_square;
                entry.steepest = steepest;
            }
        }
    }
    Ok(())
}

/// Of a field: the weighted mean of its magnitude, an upper bound on the square of its magnitude, and an upper bound
/// on its slope per m.
pub(super) fn mean_magnitude_and_bounds_of_square_and_slope(
    field: impl Iterator<Item = Complex64>,
    grid: &SurfaceGrid,
) -> [f64; 3] {
    let (mut mean, mut most, mut steepest) = (0.0, 0.0_f64, 0.0_f64);
    let columns = grid.x_m.len();
    let (dx, dy) = grid.column_and_row_spacing_or_infinity_m();
    let mut above = vec![Complex64::ZERO; columns];
    let mut left = Complex64::ZERO;
    for (at, ((z, weight), there)) in field.zip(&grid.weights).zip(&grid.there).enumerate() {
        let column = at % columns;
        if *there {
            let square = z.norm_sqr();
            mean += weight * square.sqrt();
            most = most.max(square);
            let along = if column > 0 && grid.there[at - 1] { (z - left).norm_sqr() / (dx * dx) } else { 0.0 };
            let is_below = at >= columns && grid.there[at - columns];
            let across = if is_below { (z - above[column]).norm_sqr() / (dy * dy) } else { 0.0 };
            steepest = steepest.max(along + across);
        }
        (left, above[column]) = (z, z);
    }
    [mean, BETWEEN * most, BETWEEN * steepest.sqrt()]
}

/// The entries of all actuators at a frequency between those of the grid. The mean magnitude is the root mean square
/// times the ratio of the two at the neighbouring frequencies; the harmonics are those of the frequency below. If
/// `compute_limits_only_for` is given, forces and pulse widths are computed for that actuator only, and the others keep those of the
/// frequency below.
pub(super) fn look_up_or_compute_entries_of_all_actuators_at_hz(
    table: &PlanTable,
    frequency_hz: f64,
    compute_limits_only_for: Option<usize>,
) -> Result<Vec<Entry>, ResponseError> {
    let after = table.frequencies_hz.partition_point(|hz| *hz <= frequency_hz);
    let at = |k: Option<usize>| {
        k.and_then(|k| table.entries.iter().map(|list| list.get(k)?.as_ref()).collect::<Option<Vec<_>>>())
    };
    let (below, above) = (at(after.checked_sub(1)), at(Some(after)));
    if let (Some(below), Some(k)) = (&below, after.checked_sub(1))
        && table.frequencies_hz[k] == frequency_hz
    {
        return Ok(below.iter().map(|entry| (*entry).clone()).collect());
    }
    let model = &table.model;
    let coordinates = CoordinateSolver::new(model).solve_coordinates_per_newton_at(frequency_hz)?;
    // Without a neighbour there is nothing to say which widths are quiet.
    let unbounded = || ResponseError::Unbounded { frequency_hz, resonance_hz: frequency_hz };
    let nearest = below.as_ref().or(above.as_ref()).ok_or_else(unbounded)?;
    let scale = Complex64::from(-(TAU * frequency_hz).powi(2));
    let drivers = list_electrodes_transducer_and_receptance_of_each_actuator(
        &table.electrodes,
        &table.transducers,
        &table.static_receptance,
    );
    let own = coordinates.into_iter().zip(drivers).zip(nearest).enumerate();
    Ok(own
        .map(|(actuator, ((displacement, driver), nearest))| {
            let travel = compute_travel_of_each_actuator(model, &displacement);
            // Those of the frequencies beside it, whichever is more: a harmonic's resonance is seldom narrower than their distance.
            let mut harmonic_travel = nearest.harmonic_travel;
            for other in [&below, &above].into_iter().flatten().filter_map(|row| row.get(actuator)) {
                for (own, other) in harmonic_travel.iter_mut().flatten().zip(other.harmonic_travel.iter().flatten()) {
                    *own = own.max(*other);
                }
            }
            let is_driven = compute_limits_only_for.is_none_or(|driven| driven == actuator);
            let onset_v = nearest.onset_v;
            let overshoot = match is_driven {
                true => bound_overshoot_of_each_mass_or_whole_motion_m_per_n(
                    table.switch_on_model(),
                    actuator,
                    frequency_hz,
                    onset_v,
                    &travel,
                ),
                false => nearest.overshoot,
            };
            let charging = driver.electrodes.charging_at(frequency_hz);
            let motion = MotionPerN { travel: &travel, harmonics: &harmonic_travel, overshoot: &overshoot, charging };
            let widths = nearest.widths.map(|width| match is_driven {
                true => {
                    let harmonics = [width.harmonics, width.felt_harmonics];
                    let pulse_width = width.pulse_width;
                    build_pulse_option_with_max_force(driver, actuator, motion, frequency_hz, pulse_width, harmonics)
                }
                false => width,
            });
            let strongest = *choose_widest_pulse_if_noticeably_stronger(&widths);
            let acceleration = displacement * scale;
            let mean_square = mean_square_over_surface(&table.products, &acceleration);
            let known = [&below, &above].map(|row| row.as_ref().and_then(|row| row.get(actuator).copied()));
            let known = || known.into_iter().flatten().filter(|known| known.mean_square > 0.0);
            let (sum, count) = known()
                .fold((0.0, 0.0), |(sum, count), known| (sum + known.mean / known.mean_square.sqrt(), count + 1.0));
            let most = known().map(|known| known.most_square / known.mean_square).fold(0.0, f64::max);
            Entry {
                charging,
                mean: if count > 0.0 { sum / count * mean_square.sqrt() } else { 0.0 },
                most_square: most * mean_square,
                steepest: 0.0,
                mean_square,
                acceleration,
                travel,
                harmonic_travel,
                overshoot,
                onset_v,
                widths,
                max_force_n: strongest.max_force_n,
                limit: strongest.limit,
            }
        })
        .collect())
}
