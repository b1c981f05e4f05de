//! Filling the table.

use super::entry::stronger;
use super::forces::{
    Driver, MotionPerN, WIDEST, WIDTHS, harmonic_part, overshoots, overshoots_at_most, travel_by, width_of, widths,
};
use super::quadrature::products;
use super::{Computed, Entry, HARMONICS, PlanTable, SurfaceGrid, TableOptions};
use crate::model::ReducedModel;
use crate::physics::PerPair;
use crate::physics::limits::Electrodes;
use crate::physics::rise::{Onset, RiseTimes};
use crate::physics::softening::{Transducer, static_receptance};
use crate::response::sweep::SurfaceShapes;
use crate::response::{CoordinateSolver, ResponseError};
use crate::scene::{MAX_ACTUATORS, Scene};
use crate::table::press::{Pressed, pressed};
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
const HELD_FAST: f64 = 1e-9;

/// What a table is for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Purpose<'a> {
    /// Plans: all of an [`Entry`].
    Plans,
    /// The strongest drives alone. They weigh no energies: mean squares are rough, those of harmonics and figures that take a look at
    /// every point are left out, and of the pulse widths that are quieter than the widest there is but one: that of another table, or the first.
    Strongest(Option<&'a PlanTable>),
    /// The same of a place that is touched, another table's, without free motion: what switching on adds is a single pole's whole motion.
    Roughly(&'a PlanTable),
}

impl<'a> Purpose<'a> {
    fn is_plans(self) -> bool {
        matches!(self, Self::Plans)
    }

    /// The table of the same panel without a finger.
    fn untouched(self) -> Option<&'a PlanTable> {
        match self {
            Self::Plans => None,
            Self::Strongest(untouched) => untouched,
            Self::Roughly(untouched) => Some(untouched),
        }
    }
}

/// The table of a model; `known` is what a press does to the actuators, where that is not to be told by it.
pub(super) fn table(
    scene: &Scene,
    model: ReducedModel,
    options: TableOptions,
    known: Option<&[Pressed]>,
) -> Result<PlanTable, ResponseError> {
    let mut computed = compute_without_figures(scene, model, options, known)?;
    surface_figures(scene, &mut computed)?;
    Ok(PlanTable::of(scene, computed))
}

/// What [`table`] is made of, but for the figures that take a look at every point: `mean`, `most_square` and `steepest` of every entry are 0. All limits of voltage, force
/// and travel are among it.
pub(super) fn compute_without_figures(
    scene: &Scene,
    model: ReducedModel,
    options: TableOptions,
    known: Option<&[Pressed]>,
) -> Result<Computed, ResponseError> {
    let grid = SurfaceGrid::new(scene, &model, options.to_hz);
    let products = products(scene, &model);
    computed(scene, model, options.frequencies_hz(), (grid, products), Purpose::Plans, known)
}

/// A table for the strongest drives, and nothing else, at these frequencies and with these points. Of a panel that a finger touches the purpose has the table without
/// it, of which this one has what a press does to the actuators, and the quiet pulse widths.
pub(super) fn strongest(
    scene: &Scene,
    model: ReducedModel,
    frequencies_hz: Vec<f64>,
    grid: SurfaceGrid,
    purpose: Purpose<'_>,
) -> Result<PlanTable, ResponseError> {
    let mut weighted = grid.shapes.clone();
    for (mut row, weight) in weighted.row_iter_mut().zip(&grid.weights) {
        row *= *weight;
    }
    let products = grid.shapes.tr_mul(&weighted);
    let pressed = purpose.untouched().map(|own| &*own.pressed);
    let computed = computed(scene, model, frequencies_hz, (grid, products), purpose, pressed)?;
    Ok(PlanTable::of(scene, computed))
}

fn computed(
    scene: &Scene,
    model: ReducedModel,
    frequencies_hz: Vec<f64>,
    (grid, products): (SurfaceGrid, DMatrix<f64>),
    purpose: Purpose<'_>,
    known: Option<&[Pressed]>,
) -> Result<Computed, ResponseError> {
    let receptance = static_receptance(&model);
    let (electrodes, pressed) = electrodes_of(scene, &model, &grid, &receptance, known);
    let transducers: Vec<Transducer> = scene.actuators.iter().map(Transducer::of).collect();
    let solver = CoordinateSolver::new(&model);
    let free = if matches!(purpose, Purpose::Roughly(_)) { None } else { free_motion(&model) };
    let onset = free.as_ref().map(|(_, onset)| onset);
    let drivers = drivers(&electrodes, &transducers, &receptance);
    let mass_kg = scene.surface_mass_kg();
    let panel = Panel { model: &model, mass_kg, products: &products, drivers: &drivers, onset, purpose };
    let columns: Vec<Option<Vec<Entry>>> = frequencies_hz
        .par_iter()
        .map(|frequency_hz| entries_at(panel, &solver, *frequency_hz))
        .collect::<Result<_, _>>()?;
    let entries = (0..electrodes.len())
        .map(|actuator| columns.iter().map(|column| column.as_ref()?.get(actuator).cloned()).collect())
        .collect();
    Ok(Computed { model, frequencies_hz, entries, electrodes, pressed, grid, products, free })
}

/// The panel's free motion.
fn free_motion(model: &ReducedModel) -> Option<(RiseTimes, Onset)> {
    let rise = RiseTimes::prepare(model)?;
    let onset = rise.onset(model);
    Some((rise, onset))
}

/// What each actuator has for making force.
fn drivers<'a>(
    electrodes: &'a [Electrodes],
    transducers: &'a [Transducer],
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
) -> Vec<Driver<'a>> {
    let own = electrodes.iter().zip(transducers).enumerate();
    own.map(|(i, (electrodes, transducer))| Driver {
        electrodes,
        transducer,
        // Of one too many nothing is known; plans refuse it.
        static_receptance: static_receptance.get(i).and_then(|row| row.get(i)).copied().unwrap_or(f64::INFINITY),
    })
    .collect()
}

/// What entries are made of.
#[derive(Clone, Copy)]
struct Panel<'a> {
    model: &'a ReducedModel,
    mass_kg: f64,
    products: &'a DMatrix<f64>,
    drivers: &'a [Driver<'a>],
    onset: Option<&'a Onset>,
    purpose: Purpose<'a>,
}

/// The electrodes of a scene's actuators. Force limits are those of the electrodes; a rail's voltage is on all that hang on
/// it. With what a press does to them.
fn electrodes_of(
    scene: &Scene,
    model: &ReducedModel,
    grid: &SurfaceGrid,
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
    known: Option<&[Pressed]>,
) -> (Vec<Electrodes>, Vec<Pressed>) {
    let mut electrodes = on_rails(scene.actuators.iter().map(Electrodes::of).collect());
    let pressed = known.map_or_else(|| pressed(scene, model, grid, &electrodes, static_receptance), <[_]>::to_vec);
    for (own, pressed) in electrodes.iter_mut().zip(&pressed) {
        (own.stop_m, own.sag_m) = (pressed.stop_m, pressed.sag_m);
    }
    (electrodes, pressed)
}

/// No actuator asks for more voltage than every one on its rail may have.
fn on_rails(electrodes: Vec<Electrodes>) -> Vec<Electrodes> {
    let least = |rail: usize| {
        let own = electrodes.iter().enumerate().filter(|(i, _)| rail_index_of_channel(*i) == rail);
        own.map(|(_, electrodes)| electrodes.max_voltage_v).fold(f64::INFINITY, f64::min)
    };
    let limited =
        |(i, own): (usize, &Electrodes)| Electrodes { max_voltage_v: least(rail_index_of_channel(i)), ..*own };
    electrodes.iter().enumerate().map(limited).collect()
}

/// Accelerations of all actuators of a model at many frequencies; `None` where they are unbounded.
pub(super) fn rows(model: &ReducedModel, frequencies_hz: &[f64]) -> Vec<Option<Vec<DVector<Complex64>>>> {
    let solver = CoordinateSolver::new(model);
    let row = |frequency_hz: &f64| -> Option<Vec<DVector<Complex64>>> {
        let scale = Complex64::from(-(TAU * frequency_hz).powi(2));
        Some(solver.solve_at_frequency(*frequency_hz).ok()?.into_iter().map(|q| q * scale).collect())
    };
    frequencies_hz.par_iter().map(row).collect()
}

/// Everything but the figures that take a look at every point; `None` where the response is unbounded.
fn entries_at(
    panel: Panel<'_>,
    solver: &CoordinateSolver<'_>,
    frequency_hz: f64,
) -> Result<Option<Vec<Entry>>, ResponseError> {
    let Panel { model, mass_kg, products, drivers, onset, purpose } = panel;
    let coordinates = match solver.solve_at_frequency(frequency_hz) {
        Ok(coordinates) => coordinates,
        Err(error) if error.is_unbounded() => return Ok(None),
        Err(error) => return Err(error),
    };
    let harmonics = harmonics(model, solver, purpose.is_plans().then_some(products), frequency_hz);
    let scale = Complex64::from(-(TAU * frequency_hz).powi(2));
    let entries = coordinates.into_iter().zip(drivers).enumerate().map(|(actuator, (displacement, driver))| {
        let travel = travel_by(model, &displacement);
        let mut harmonic_travel = [[0.0; MAX_ACTUATORS]; HARMONICS.len()];
        for (row, harmonic) in harmonic_travel.iter_mut().zip(&harmonics) {
            *row = harmonic.travel.get(actuator).copied().unwrap_or_default();
        }
        // With a finger every place has a table of its own, and what two masses share of a limit is not looked at again elsewhere.
        let is_far =
            matches!(purpose, Purpose::Strongest(None)) && is_far_from_limits(drivers, driver.electrodes, &travel);
        let onset = onset.filter(|_| !is_far);
        let (overshoot, onset_v) = overshoots_at_most(onset, actuator, frequency_hz, driver.electrodes, &travel);
        let width = |pulse_width: f64| {
            let square = |harmonic: &Harmonic| {
                harmonic_part(harmonic.number, pulse_width).powi(2)
                    * harmonic.squares.get(actuator).copied().unwrap_or(0.0)
            };
            let surface = harmonics.iter().map(square).sum();
            let felt = |harmonic: &Harmonic| {
                // What no one feels has no square.
                let hz = (harmonic.number * frequency_hz).min(HIGHEST_FELT_HZ);
                perception::weight(hz).powi(2) * square(harmonic)
            };
            let surface = [surface, harmonics.iter().map(felt).sum()];
            let motion = MotionPerN { travel: &travel, harmonics: &harmonic_travel, overshoot: &overshoot };
            width_of(*driver, actuator, motion, pulse_width, surface)
        };
        let known = purpose.untouched().and_then(|other| other.quiet_width(actuator, frequency_hz));
        let quieter =
            known.as_ref().map_or(if purpose.is_plans() { &WIDTHS[..] } else { &WIDTHS[..1] }, std::slice::from_ref);
        let widths = widths(frequency_hz, quieter, width);
        let strongest = *stronger(&widths);
        let mut acceleration = displacement * scale;
        let mean_square = mean_square(products, &acceleration);
        if mean_square.sqrt() <= HELD_FAST / mass_kg {
            // An ERA on an edge that does not move: of what rounding leaves a touch would ask for all its force.
            acceleration.fill(Complex64::ZERO);
        }
        Entry {
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

/// Whether no mass comes near its limit, whatever switching on adds, under the most force that an actuator's voltage makes.
fn is_far_from_limits(drivers: &[Driver<'_>], driven: &Electrodes, travel: &[Complex64; MAX_ACTUATORS]) -> bool {
    let most_n = driven.harmonic_per_volt_squared(1, WIDEST) * driven.max_voltage_v.powi(2);
    travel.iter().zip(drivers).all(|(z, other)| FAR * most_n * z.norm() < other.electrodes.most_travel_m())
}

/// Mean square over the surface of a motion with these coordinates.
pub(super) fn mean_square(products: &DMatrix<f64>, coordinates: &DVector<Complex64>) -> f64 {
    let part = |of: &dyn Fn(&Complex64) -> f64| {
        let x = DVector::from_iterator(coordinates.len(), coordinates.iter().map(of));
        x.dot(&(products * &x))
    };
    (part(&|z| z.re) + part(&|z| z.im)).max(0.0)
}

/// Means over the surface of conj(a_i) a_j at every frequency of the grid; zeros where the response is unbounded.
pub(super) fn over_surface(products: &DMatrix<f64>, entries: &[Vec<Option<Entry>>]) -> Vec<PerPair> {
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

/// What all actuators do at an odd multiple of a frequency, per N.
struct Harmonic {
    number: f64,
    /// Mean square over the surface.
    squares: Vec<f64>,
    /// Of each actuator's force the |travel| of all.
    travel: Vec<[f64; MAX_ACTUATORS]>,
}

/// Every odd harmonic up to the highest frequency that is felt, and [`HARMONICS`] in any case; these alone, and no mean squares,
/// without `products`. What is unbounded there is left out: a resonance without damping, which an edge of finite length does not meet.
fn harmonics(
    model: &ReducedModel,
    solver: &CoordinateSolver<'_>,
    products: Option<&DMatrix<f64>>,
    frequency_hz: f64,
) -> Vec<Harmonic> {
    let last = HARMONICS[HARMONICS.len() - 1];
    let is_felt = |number: f64| products.is_some() && number * frequency_hz <= HIGHEST_FELT_HZ;
    let numbers = (1..).map(|k| f64::from(2 * k + 1)).take_while(|n| *n <= last || is_felt(*n));
    numbers
        .map(|number| {
            let scale = Complex64::from(-(TAU * number * frequency_hz).powi(2));
            let coordinates = solver.solve_at_frequency(number * frequency_hz).unwrap_or_default();
            let square = |q: &DVector<Complex64>| {
                products.filter(|_| is_felt(number)).map_or(0.0, |products| mean_square(products, &(q * scale)))
            };
            Harmonic {
                number,
                squares: coordinates.iter().map(square).collect(),
                travel: coordinates.iter().map(|q| travel_by(model, q).map(|z| z.norm())).collect(),
            }
        })
        .collect()
}

/// Mean and largest magnitude over the surface.
fn surface_figures(scene: &Scene, computed: &mut Computed) -> Result<(), ResponseError> {
    let Computed { model, grid, frequencies_hz, entries, .. } = computed;
    let known: Vec<usize> =
        (0..frequencies_hz.len()).filter(|k| entries.iter().all(|list| list[*k].is_some())).collect();
    let shapes = SurfaceShapes::<f32>::new(scene, model, &grid.x_m, &grid.y_m);
    let chunks: Vec<Vec<[f64; 3]>> = known
        .par_chunks(CHUNK)
        .map(|chunk| {
            let hz: Vec<f64> = chunk.iter().map(|k| frequencies_hz[*k]).collect();
            let sweep = shapes.compute_accelerations(&hz)?;
            let figures = (0..chunk.len()).flat_map(|k| (0..sweep.actuators).map(move |i| (k, i)));
            Ok(figures.map(|(k, i)| figures_of(sweep.accelerations_of_all_points(k, i), grid)).collect())
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

/// Weighted mean of the magnitude, a bound of its square, and one of its slope per m.
pub(super) fn figures_of(field: impl Iterator<Item = Complex64>, grid: &SurfaceGrid) -> [f64; 3] {
    let (mut mean, mut most, mut steepest) = (0.0, 0.0_f64, 0.0_f64);
    let columns = grid.x_m.len();
    let (dx, dy) = grid.steps_m();
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

/// The entries of all actuators off the grid. The mean magnitude is the mean square's root times what the two have to each
/// other at the frequencies beside it; harmonics are those of the frequency below. Forces and pulse widths are worked out for
/// `driven` only, if it is told; the others' are those of the frequency below.
pub(super) fn row_at(table: &PlanTable, frequency_hz: f64, driven: Option<usize>) -> Result<Vec<Entry>, ResponseError> {
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
    let coordinates = CoordinateSolver::new(model).solve_at_frequency(frequency_hz)?;
    // Without a neighbour there is nothing to say which widths are quiet.
    let unbounded = || ResponseError::Unbounded { frequency_hz, resonance_hz: frequency_hz };
    let nearest = below.as_ref().or(above.as_ref()).ok_or_else(unbounded)?;
    let scale = Complex64::from(-(TAU * frequency_hz).powi(2));
    let drivers = drivers(&table.electrodes, &table.transducers, &table.static_receptance);
    let own = coordinates.into_iter().zip(drivers).zip(nearest).enumerate();
    Ok(own
        .map(|(actuator, ((displacement, driver), nearest))| {
            let travel = travel_by(model, &displacement);
            // Those of the frequencies beside it, whichever is more: a harmonic's resonance is seldom narrower than their distance.
            let mut harmonic_travel = nearest.harmonic_travel;
            for other in [&below, &above].into_iter().flatten().filter_map(|row| row.get(actuator)) {
                for (own, other) in harmonic_travel.iter_mut().flatten().zip(other.harmonic_travel.iter().flatten()) {
                    *own = own.max(*other);
                }
            }
            let is_driven = driven.is_none_or(|driven| driven == actuator);
            let onset_v = nearest.onset_v;
            let overshoot = match is_driven {
                true => overshoots(table.onset(), actuator, frequency_hz, onset_v, &travel),
                false => nearest.overshoot,
            };
            let motion = MotionPerN { travel: &travel, harmonics: &harmonic_travel, overshoot: &overshoot };
            let widths = nearest.widths.map(|width| match is_driven {
                true => {
                    let harmonics = [width.harmonics, width.felt_harmonics];
                    width_of(driver, actuator, motion, width.pulse_width, harmonics)
                }
                false => width,
            });
            let strongest = *stronger(&widths);
            let acceleration = displacement * scale;
            let mean_square = mean_square(&table.products, &acceleration);
            let known = [&below, &above].map(|row| row.as_ref().and_then(|row| row.get(actuator).copied()));
            let known = || known.into_iter().flatten().filter(|known| known.mean_square > 0.0);
            let (sum, count) = known()
                .fold((0.0, 0.0), |(sum, count), known| (sum + known.mean / known.mean_square.sqrt(), count + 1.0));
            let most = known().map(|known| known.most_square / known.mean_square).fold(0.0, f64::max);
            Entry {
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
