//! The table as plain numbers, to be kept on disk, and back again.
//!
//! Kept is what takes time: the reduced models, their responses, the figures over the surface. Points, electrodes and the
//! arrays that a touch reads in its own order are made again of scene and entries, so that a table read is bit for bit the
//! one that was written. Beyond sizes and finite numbers, samples of every part are computed anew and compared.

use super::build::{Panel, Purpose, drivers, electrodes_of, entries_at, figures_of, free_motion, rows};
use super::quadrature::products_of;
use super::{Computed, Entry, HARMONICS, PlanTable, SurfaceGrid, TableOptions, Width};
use crate::model::bounded::Step;
use crate::model::levels::Levels;
use crate::model::stored::{Implausible, StoredLevels, StoredMatrix, complex, expect_size, pairs};
use crate::model::{Accuracy, ReducedModel};
use crate::physics::limits::Limit;
use crate::physics::softening::static_receptance;
use crate::response::Solver;
use crate::scene::{MAX_ACTUATORS, Scene};
use nalgebra::DVector;
use num_complex::Complex64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Relative difference of a number computed anew from the one kept. They are the same on the same machine; another's vector
/// instructions round differently, and near resonance a response has a hundred times what its parts have.
const SAME_NUMBER: f64 = 1e-9;
/// The same of figures over the surface, which are summed in single precision.
const SAME_IN_SINGLE: f64 = 1e-4;
/// The same of force limits, which leave room for free motions: where poles are nearly equal each has its own share of what is
/// theirs together, as rounding will have it.
const SAME_OF_POLES: f64 = 1e-2;
/// What the mean (trapezoidal rule on the grid of pictures) or the largest value (at its points) may be off by against the mean
/// square, which is by Gauss' rule: a border of a cut-out may be half a cell, a twenty-fourth of a wave, from the grid's lines.
const OTHER_POINTS: f64 = 1.1;
/// Parts of the list of frequencies, and of that of points, at which samples are taken.
const SAMPLES: [f64; 3] = [0.15, 0.5, 0.85];

/// Accelerations of all actuators at a frequency, as pairs; `None` where they are unbounded.
type StoredRow = Option<Vec<Vec<[f64; 2]>>>;

#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredEntry {
    acceleration: Vec<[f64; 2]>,
    mean_square: f64,
    mean: f64,
    most_square: f64,
    steepest: f64,
    travel: [[f64; 2]; MAX_ACTUATORS],
    harmonic_travel: [[f64; MAX_ACTUATORS]; HARMONICS.len()],
    overshoot: [f64; MAX_ACTUATORS],
    onset_v: f64,
    widths: [Width; 2],
    max_force_n: f64,
    limit: Limit,
}

impl From<&Entry> for StoredEntry {
    fn from(entry: &Entry) -> Self {
        Self {
            acceleration: pairs(&entry.acceleration),
            mean_square: entry.mean_square,
            mean: entry.mean,
            most_square: entry.most_square,
            steepest: entry.steepest,
            travel: entry.travel.map(|z| [z.re, z.im]),
            harmonic_travel: entry.harmonic_travel,
            overshoot: entry.overshoot,
            onset_v: entry.onset_v,
            widths: entry.widths,
            max_force_n: entry.max_force_n,
            limit: entry.limit,
        }
    }
}

/// Numbers of an entry other than its acceleration and its limits.
fn figures(entry: &Entry) -> impl Iterator<Item = f64> {
    let travel = entry.travel.map(Complex64::norm).into_iter().chain(entry.harmonic_travel.into_iter().flatten());
    let widths = entry.widths.into_iter().flat_map(|width| [width.pulse_width, width.harmonics, width.felt_harmonics]);
    std::iter::once(entry.mean_square).chain(travel).chain(widths)
}

/// Force limits and what they are made of.
fn limits(entry: &Entry) -> impl Iterator<Item = f64> {
    let widths =
        entry.widths.into_iter().flat_map(|width| std::iter::once(width.max_force_n).chain(width.travel_m_per_n));
    [entry.max_force_n, entry.onset_v].into_iter().chain(entry.overshoot).chain(widths)
}

impl StoredEntry {
    /// `nothing`: acceleration in (m/s^2)/N up to which figures are rounding.
    fn restore(self, n: usize, nothing: f64) -> Result<Entry, Implausible> {
        const WHAT: &str = "entries";
        let entry = Entry {
            acceleration: complex(WHAT, &self.acceleration, n)?,
            mean_square: self.mean_square,
            mean: self.mean,
            most_square: self.most_square,
            steepest: self.steepest,
            travel: self.travel.map(|[re, im]| Complex64::new(re, im)),
            harmonic_travel: self.harmonic_travel,
            overshoot: self.overshoot,
            onset_v: self.onset_v,
            widths: self.widths,
            max_force_n: self.max_force_n,
            limit: self.limit,
        };
        let over_surface = [entry.mean, entry.most_square, entry.steepest];
        if !figures(&entry).chain(limits(&entry)).chain(over_surface).all(|figure| figure.is_finite() && figure >= 0.0)
        {
            return Err(Implausible::NotFinite(WHAT));
        }
        // No mean is above the root of the mean square, and no mean square above the largest: but for the points that they are taken at.
        let is_above = |low: f64, high: f64| low > OTHER_POINTS * high;
        let is_motion = entry.most_square.sqrt() > nothing;
        if is_motion
            && (is_above(entry.mean.powi(2), entry.mean_square) || is_above(entry.mean_square, entry.most_square))
        {
            return Err(Implausible::Differs("figures over the surface"));
        }
        Ok(entry)
    }
}

/// A [`PlanTable`] made by [`PlanTable::with_levels`], and the steps of its levels.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StoredTable {
    levels: StoredLevels,
    entries: Vec<Vec<Option<StoredEntry>>>,
    coarser_rows: [Vec<StoredRow>; 2],
    shapes: StoredMatrix,
    products: StoredMatrix,
}

impl StoredTable {
    /// Of a table with coarser levels, whose steps are given; `None` of one without.
    #[must_use]
    pub fn new(table: &PlanTable, steps: &[Step]) -> Option<Self> {
        let (coarser, estimator) = table.coarser.as_ref()?;
        let entries = |list: &Vec<Option<Entry>>| list.iter().map(|entry| entry.as_ref().map(Into::into)).collect();
        let row = |row: &Option<Vec<DVector<Complex64>>>| row.as_ref().map(|row| row.iter().map(pairs).collect());
        Some(Self {
            levels: StoredLevels::new(&table.model, coarser, *estimator, steps),
            entries: table.entries.iter().map(entries).collect(),
            coarser_rows: table.coarser_rows.each_ref().map(|rows| rows.iter().map(row).collect()),
            shapes: (&table.grid.shapes).into(),
            products: (&table.products).into(),
        })
    }

    /// The table again, and the steps.
    ///
    /// # Errors
    /// [`Implausible`], if it cannot be that of this scene with these options.
    pub fn restore(
        self,
        scene: &Scene,
        accuracy: Accuracy,
        options: TableOptions,
    ) -> Result<(PlanTable, Vec<Step>), Implausible> {
        let Levels { fine: model, coarser, estimator, steps } = self.levels.restore(scene, accuracy, options.to_hz)?;
        let (n, p) = (model.order(), scene.actuators.len());
        let frequencies_hz = options.frequencies_hz();
        expect_size("actuators", self.entries.len(), p)?;
        let nothing = HARDLY_MOVING / scene.mass_kg();
        let restored = |list: Vec<Option<StoredEntry>>| -> Result<Vec<Option<Entry>>, Implausible> {
            expect_size("frequencies", list.len(), frequencies_hz.len())?;
            list.into_iter().map(|entry| entry.map(|entry| entry.restore(n, nothing)).transpose()).collect()
        };
        let entries = self.entries.into_par_iter().map(restored).collect::<Result<Vec<_>, _>>()?;
        let grid = SurfaceGrid::without_shapes(scene, options.to_hz);
        let points = grid.weights.len();
        let grid = SurfaceGrid { shapes: self.shapes.restore("shapes at the surface's points", points, n)?, ..grid };
        let products = self.products.restore("products over the surface", n, n)?;
        let (electrodes, pressed) = electrodes_of(scene, &model, &grid, &static_receptance(&model), None);
        let free = free_motion(&model);
        let computed = Computed { model, frequencies_hz, entries, electrodes, pressed, grid, products, free };
        let mut table = PlanTable::of(scene, computed);
        let [middle, coarse] = self.coarser_rows;
        table.coarser_rows = [
            restore_rows(middle, &coarser[0], table.frequencies_hz.len())?,
            restore_rows(coarse, &coarser[1], table.frequencies_hz.len())?,
        ];
        table.coarser = Some((coarser, estimator));
        check_samples(&table)?;
        Ok((table, steps))
    }
}

fn restore_rows(
    stored: Vec<StoredRow>,
    model: &ReducedModel,
    frequencies: usize,
) -> Result<Vec<Option<Vec<DVector<Complex64>>>>, Implausible> {
    const WHAT: &str = "responses of a coarser level";
    expect_size(WHAT, stored.len(), frequencies)?;
    let row = |row: Vec<Vec<[f64; 2]>>| {
        expect_size(WHAT, row.len(), model.actuators())?;
        row.iter().map(|values| complex(WHAT, values, model.order())).collect()
    };
    stored.into_par_iter().map(|stored| stored.map(row).transpose()).collect()
}

/// What sets an entry's limits.
fn limited_by(entry: &Entry) -> impl Iterator<Item = Limit> {
    std::iter::once(entry.limit).chain(entry.widths.into_iter().map(|width| width.limit))
}

/// Acceleration, relative to that of the surface under the same force, which is as good as none.
const HARDLY_MOVING: f64 = 1e-6;

/// Whether an entry's figures over the surface are those of its acceleration.
fn over_surface(table: &PlanTable, acceleration: &DVector<Complex64>, kept: &Entry) -> bool {
    let anew = figures_of(table.grid.field(acceleration).into_iter(), &table.grid);
    // The steepest slope is a difference of neighbours in single precision: of what rounding makes of the largest value.
    let [mean, most_square, steepest] = anew;
    let (dx, dy) = table.grid.steps_m();
    // Of a force on an edge that does not move there is only rounding, whose figures are not the same twice.
    let nothing = HARDLY_MOVING / table.scene.mass_kg();
    if most_square.max(kept.most_square).sqrt() <= nothing {
        return true;
    }
    let slope = most_square.sqrt() / dx.min(dy);
    is_same(mean, kept.mean, SAME_IN_SINGLE)
        && is_same(most_square, kept.most_square, SAME_IN_SINGLE)
        && (steepest - kept.steepest).abs() <= SAME_IN_SINGLE * slope
}

/// Computes samples anew: entries with their limits, responses of the coarser levels, products and shapes.
fn check_samples(table: &PlanTable) -> Result<(), Implausible> {
    let solver = Solver::new(&table.model);
    let drivers = drivers(&table.electrodes, &table.transducers, &table.static_receptance);
    let panel = Panel {
        model: &table.model,
        mass_kg: table.scene.mass_kg(),
        products: &table.products,
        drivers: &drivers,
        onset: table.onset(),
        purpose: Purpose::Plans,
    };
    for k in samples(table.frequencies_hz.len()) {
        let hz = table.frequencies_hz[k];
        let anew = entries_at(panel, &solver, hz).map_err(|_| Implausible::Differs("entries"))?;
        let kept: Option<Vec<&Entry>> = table.entries.iter().map(|list| list[k].as_ref()).collect();
        let is_same = match (&anew, &kept) {
            (Some(anew), Some(kept)) => anew.iter().zip(kept).all(|(anew, kept)| {
                is_close(&anew.acceleration, &kept.acceleration)
                    && figures(anew).zip(figures(kept)).all(|(anew, kept)| is_same(anew, kept, SAME_NUMBER))
                    && limits(anew).zip(limits(kept)).all(|(anew, kept)| is_same(anew, kept, SAME_OF_POLES))
                    && limited_by(anew).eq(limited_by(kept))
                    && over_surface(table, &anew.acceleration, kept)
            }),
            (anew, kept) => anew.is_none() && kept.is_none(),
        };
        if !is_same {
            return Err(Implausible::Differs("entries"));
        }
        for (model, kept) in table.coarser.iter().flat_map(|(models, _)| models).zip(&table.coarser_rows) {
            let is_same = match (rows(model, &[hz]).pop().flatten(), &kept[k]) {
                (Some(anew), Some(kept)) => anew.iter().zip(kept).all(|(anew, kept)| is_close(anew, kept)),
                (anew, kept) => anew.is_none() && kept.is_none(),
            };
            if !is_same {
                return Err(Implausible::Differs("responses of a coarser level"));
            }
        }
    }
    let columns: Vec<usize> = samples(table.model.order()).collect();
    for (anew, column) in products_of(&table.scene, &table.model, &columns).column_iter().zip(&columns) {
        if (anew - table.products.column(*column)).amax() > SAME_NUMBER * anew.amax() {
            return Err(Implausible::Differs("products over the surface"));
        }
    }
    let columns = table.grid.x_m.len();
    for point in samples(table.grid.weights.len()) {
        let anew = table.model.shape_at(table.grid.x_m[point % columns], table.grid.y_m[point / columns]);
        let kept = table.grid.shapes.row(point).transpose();
        if (&anew - kept).amax() > SAME_NUMBER * anew.amax() {
            return Err(Implausible::Differs("shapes at the surface's points"));
        }
    }
    Ok(())
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "parts of a length"
)]
fn samples(length: usize) -> impl Iterator<Item = usize> {
    SAMPLES.into_iter().map(move |part| (part * length as f64) as usize).filter(move |at| *at < length)
}

fn is_same(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * a.abs().max(b.abs())
}

fn is_close(a: &DVector<Complex64>, b: &DVector<Complex64>) -> bool {
    a.len() == b.len() && (a - b).norm() <= SAME_NUMBER * a.norm()
}
