//! What the planner knows before a touch comes: how every actuator moves the panel at every frequency of a grid.

use super::PULSE_WIDTH;
use super::limits::{Electrodes, Limit};
use crate::model::ReducedModel;
use crate::model::bounded::{Estimator, Levels};
use crate::response::{ResponseError, Solver};
use crate::scene::{Layer, Scene, SurfaceKind};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use rayon::prelude::*;

/// Least number of cells of the surface grid along the longer side, for a picture; the shorter one has as many as keep
/// the cells square.
const GRID_CELLS: f64 = 48.0;
/// Cells per bending wave at the highest frequency (0.22 m at 400 Hz on 2 mm of aluminium). A crest halfway between two
/// points is at most 1 - cos(pi/12) = 3.4 % higher than what they see.
const CELLS_PER_WAVE: f64 = 12.0;
/// Least number of cells along the shorter side.
const LEAST_CELLS: f64 = 4.0;
/// Most cells, for the memory that their mode shapes take; beyond it the cells grow, at 0.5 MB per mode.
const MOST_CELLS: f64 = 65_536.0;

/// The frequency grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableOptions {
    /// Lowest frequency in Hz.
    pub from_hz: f64,
    /// Highest frequency in Hz.
    pub to_hz: f64,
    /// Step in Hz.
    pub step_hz: f64,
}

impl Default for TableOptions {
    /// 40 to 400 Hz: what the skin feels well and ERAs reach; 2 Hz is below the half-power width of a mode of 1 % loss
    /// factor from 200 Hz on and a small part of the 18 % difference that fingers can tell.
    fn default() -> Self {
        Self { from_hz: 40.0, to_hz: 400.0, step_hz: 2.0 }
    }
}

impl TableOptions {
    /// The frequencies.
    #[must_use]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "small counts"
    )]
    pub fn frequencies_hz(&self) -> Vec<f64> {
        let steps = ((self.to_hz - self.from_hz) / self.step_hz + 1e-9).floor().max(0.0) as usize;
        (0..=steps).map(|i| self.from_hz + i as f64 * self.step_hz).collect()
    }
}

/// One actuator at one frequency, for 1 N of force amplitude.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Modal coordinates of the acceleration in m/s^2/N: the response at a point is the dot product with the mode shapes
    /// there.
    pub acceleration: DVector<Complex64>,
    /// Mean over the surface of |acceleration|^2, in (m/s^2/N)^2.
    pub mean_square: f64,
    /// Most force amplitude in N.
    pub max_force_n: f64,
    /// What sets it.
    pub limit: Limit,
}

/// A grid over the surface with the mode shapes at its points.
#[derive(Clone, Debug)]
pub struct SurfaceGrid {
    /// Columns, in m from the left edge.
    pub x_m: Vec<f64>,
    /// Rows, in m from the top edge; one row, the axis, for a bar.
    pub y_m: Vec<f64>,
    /// Mode shapes, one row per point, points row by row.
    pub shapes: DMatrix<f64>,
    /// Part of the surface that each point stands for; adds up to 1, and is 0 in a cut-out.
    pub weights: Vec<f64>,
    /// Whether there is surface at each point.
    pub there: Vec<bool>,
}

/// The table of one scene.
#[derive(Clone, Debug)]
pub struct PlanTable {
    /// The panel's reduced model.
    pub model: ReducedModel,
    /// Coarser ones, which tell how wrong it may be; without them plans have no error bound.
    pub coarser: Option<([ReducedModel; 2], Estimator)>,
    /// The scene.
    pub scene: Scene,
    /// Frequencies in Hz, ascending.
    pub frequencies_hz: Vec<f64>,
    /// `entries[actuator][frequency]`; `None` where the response is unbounded.
    pub entries: Vec<Vec<Option<Entry>>>,
    /// The electrodes of each actuator.
    pub electrodes: Vec<Electrodes>,
    /// The surface.
    pub grid: SurfaceGrid,
}

impl PlanTable {
    /// Computes the table of the finest level; the coarser ones give its plans an error bound.
    ///
    /// # Errors
    /// As [`PlanTable::build`].
    pub fn with_levels(scene: &Scene, levels: Levels, options: TableOptions) -> Result<Self, ResponseError> {
        let mut table = Self::build(scene, levels.fine, options)?;
        table.coarser = Some((levels.coarser, levels.estimator));
        Ok(table)
    }

    /// Computes the table.
    ///
    /// # Errors
    /// As the response does, other than for a single unbounded frequency, which is left out.
    pub fn build(scene: &Scene, model: ReducedModel, options: TableOptions) -> Result<Self, ResponseError> {
        let frequencies_hz = options.frequencies_hz();
        let grid = SurfaceGrid::new(scene, &model, options.to_hz);
        let electrodes: Vec<Electrodes> = scene
            .actuators
            .iter()
            .map(|actuator| Electrodes {
                area_m2: actuator.electrode_area_m2,
                gap_m: actuator.air_gap_m,
                max_voltage_v: actuator.max_voltage_v,
            })
            .collect();
        let solver = Solver::new(&model);
        let columns: Vec<Vec<Option<Entry>>> = frequencies_hz
            .par_iter()
            .map(|frequency_hz| entries_at(&model, &solver, &grid, &electrodes, *frequency_hz))
            .collect::<Result<_, _>>()?;
        let entries = (0..electrodes.len())
            .map(|actuator| columns.iter().map(|column| column.get(actuator).cloned().flatten()).collect())
            .collect();
        Ok(Self { model, coarser: None, scene: scene.clone(), frequencies_hz, entries, electrodes, grid })
    }
}

fn entries_at(
    model: &ReducedModel,
    solver: &Solver<'_>,
    grid: &SurfaceGrid,
    electrodes: &[Electrodes],
    frequency_hz: f64,
) -> Result<Vec<Option<Entry>>, ResponseError> {
    let coordinates = match solver.coordinates(frequency_hz) {
        Ok(coordinates) => coordinates,
        Err(error) if error.is_unbounded() => return Ok(vec![None; electrodes.len()]),
        Err(error) => return Err(error),
    };
    let omega = std::f64::consts::TAU * frequency_hz;
    Ok(coordinates
        .into_iter()
        .zip(electrodes)
        .enumerate()
        .map(|(actuator, (displacement, electrodes))| {
            let travel_m_per_n = model.travel(actuator, &displacement).norm();
            let (max_force_n, limit) = electrodes.max_force(travel_m_per_n, PULSE_WIDTH);
            let acceleration = displacement * Complex64::from(-omega * omega);
            Some(Entry { mean_square: grid.mean_square(&acceleration), acceleration, max_force_n, limit })
        })
        .collect())
}

/// Response at a point: the sum of shape times coordinate.
#[must_use]
pub fn at_point(shape: &DVector<f64>, acceleration: &DVector<Complex64>) -> Complex64 {
    shape.iter().zip(acceleration.iter()).map(|(shape, coordinate)| coordinate * *shape).sum()
}

impl SurfaceGrid {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "small counts"
    )]
    fn new(scene: &Scene, model: &ReducedModel, max_hz: f64) -> Self {
        let (length, width) = (scene.surface.length_m, scene.surface.width_m);
        let cell = cell_m(scene, max_hz);
        let count = |side: f64| (side / cell - 1e-9).ceil().max(LEAST_CELLS) as usize + 1;
        let line = |side: f64, points: usize| -> Vec<f64> {
            (0..points).map(|i| side * i as f64 / (points - 1) as f64).collect()
        };
        let x_m = line(length, count(length));
        let y_m = match scene.surface.kind {
            SurfaceKind::Bar => vec![width / 2.0],
            SurfaceKind::Plate => line(width, count(width)),
        };
        let (wx, wy) = (trapezoid(x_m.len()), trapezoid(y_m.len()));
        let layout = scene.layout();
        let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
        let there: Vec<bool> = points.map(|(x, y)| layout.at(x, y).is_some()).collect();
        let whole = wy.iter().flat_map(|v| wx.iter().map(move |u| u * v));
        let mut weights: Vec<f64> = whole.zip(&there).map(|(part, there)| if *there { part } else { 0.0 }).collect();
        let sum: f64 = weights.iter().sum();
        if there.contains(&false) && sum > 0.0 {
            weights.iter_mut().for_each(|part| *part /= sum);
        }
        Self { shapes: model.shapes_on(&x_m, &y_m), x_m, y_m, weights, there }
    }

    /// Acceleration at every point, in (m/s^2) per what `acceleration` is for.
    #[must_use]
    pub fn field(&self, acceleration: &DVector<Complex64>) -> Vec<Complex64> {
        let re = &self.shapes * acceleration.map(|z| z.re);
        let im = &self.shapes * acceleration.map(|z| z.im);
        re.iter().zip(im.iter()).map(|(re, im)| Complex64::new(*re, *im)).collect()
    }

    /// Weighted mean of the squared magnitude.
    fn mean_square(&self, acceleration: &DVector<Complex64>) -> f64 {
        self.field(acceleration).iter().zip(&self.weights).map(|(z, weight)| z.norm_sqr() * weight).sum()
    }
}

/// Side of a cell of the surface grid in m.
fn cell_m(scene: &Scene, max_hz: f64) -> f64 {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let area = match scene.surface.kind {
        SurfaceKind::Plate => length * width,
        SurfaceKind::Bar => 0.0,
    };
    (length.max(width) / GRID_CELLS)
        .min(bending_wave_m(scene, max_hz) / CELLS_PER_WAVE)
        .max((area / MOST_CELLS).sqrt())
        .max(length / MOST_CELLS)
}

/// Length of the shortest bending wave in m: 2 pi (E h^2 / (12 rho w^2))^(1/4). A plate's is longer by (1 - nu^2)^(-1/4).
fn bending_wave_m(scene: &Scene, frequency_hz: f64) -> f64 {
    let omega = std::f64::consts::TAU * frequency_hz;
    let ratio = |layer: &Layer| {
        layer.material.youngs_modulus_pa * layer.thickness_m.powi(2) / (12.0 * layer.material.density_kg_m3)
    };
    let ratio = scene.layout().layers().map(|(_, layer)| ratio(&layer)).fold(f64::INFINITY, f64::min);
    std::f64::consts::TAU * (ratio / (omega * omega)).powf(0.25)
}

/// Weights of the trapezoidal rule on equidistant points, adding up to 1.
#[allow(clippy::cast_precision_loss, reason = "small counts")]
fn trapezoid(points: usize) -> Vec<f64> {
    if points < 2 {
        return vec![1.0; points];
    }
    let step = 1.0 / (points - 1) as f64;
    (0..points).map(|i| if i == 0 || i == points - 1 { 0.5 * step } else { step }).collect()
}
