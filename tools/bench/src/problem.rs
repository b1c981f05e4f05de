//! The problem that is solved side by side: the starting plate with a loss factor of 0.005, 1000 frequencies from 50 to
//! 1000 Hz, 1 N at each actuator alone, acceleration at all points of a 49 x 33 grid.

use crate::error::Error;
use era_model::model::Fineness;
use era_model::model::PanelModel;
use era_model::response::CoordinateSolver;
use era_model::scene::{STARTING_PLATE, Scene, SurfaceDamping, equidistant_numbers};
use nalgebra::DMatrix;
use num_complex::Complex64;
use serde_json::json;
use std::path::{Path, PathBuf};

/// The example's damping, and what it is replaced by.
const DAMPING: (&str, &str) = ("loss_factor = 0.01 ", "loss_factor = 0.005 ");
/// The highest frequency in Hz.
pub const MAX_HZ: f64 = 1000.0;
/// Largest error on any curve, relative to its peak, that the problem asks for.
pub const WANTED: f64 = 1e-3;

/// Scene, frequencies and points.
#[derive(Clone, Debug)]
pub struct Problem {
    /// The plate.
    pub scene: Scene,
    /// In Hz.
    pub frequencies_hz: Vec<f64>,
    /// Columns of the grid in m.
    pub x_m: Vec<f64>,
    /// Rows of the grid in m.
    pub y_m: Vec<f64>,
}

/// The starting plate's scene file with a loss factor of 0.005.
///
/// # Errors
/// [`Error::Scene`] if the example has another damping than is replaced here.
pub fn make_lightly_damped_plate_toml() -> Result<String, Error> {
    if !STARTING_PLATE.contains(DAMPING.0) {
        return Err(Error::Scene(DAMPING.0));
    }
    Ok(STARTING_PLATE.replace(DAMPING.0, DAMPING.1))
}

impl Problem {
    /// The problem that is solved side by side.
    ///
    /// # Errors
    /// [`Error::Scene`], [`Error::Parse`].
    pub fn from_starting_plate() -> Result<Self, Error> {
        let scene = Scene::parse("examples/scenes/plate.toml", &make_lightly_damped_plate_toml()?)?;
        debug_assert_eq!(scene.surface.damping, SurfaceDamping::LossFactor(0.005));
        let (length, width) = (scene.surface.length_m, scene.surface.width_m);
        Ok(Self {
            frequencies_hz: equidistant_numbers(50.0, MAX_HZ, 1000),
            x_m: equidistant_numbers(0.0, length, 49),
            y_m: equidistant_numbers(0.0, width, 33),
            scene,
        })
    }

    /// How many points the grid has.
    #[must_use]
    pub fn count_points(&self) -> usize {
        self.x_m.len() * self.y_m.len()
    }

    /// The points of the grid, all x of a row after each other.
    #[must_use]
    pub fn list_grid_points_m(&self) -> Vec<(f64, f64)> {
        self.y_m.iter().flat_map(|y| self.x_m.iter().map(move |x| (*x, *y))).collect()
    }

    /// The tightest answer, or another by the same plain way: all products in f64, no symmetry used.
    ///
    /// # Errors
    /// [`Error::Model`], [`Error::Response`].
    pub fn compute_reference_curves(&self, fineness: Fineness) -> Result<AccelerationCurves, Error> {
        compute_acceleration_curves_on_mesh(&self.scene, fineness, &self.frequencies_hz, &self.list_grid_points_m())
    }

    /// Writes the problem and its answer for another program, and returns the file to name to it.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn write_files_and_return_problem_path(
        &self,
        folder: &Path,
        reference: &AccelerationCurves,
    ) -> Result<PathBuf, Error> {
        std::fs::create_dir_all(folder).map_err(Error::file_error(folder))?;
        let (numbers, path) = (folder.join("reference.f64"), folder.join("problem.json"));
        let raw: Vec<u8> = reference.values.iter().flat_map(|z| [z.re, z.im]).flat_map(f64::to_le_bytes).collect();
        std::fs::write(&numbers, raw).map_err(Error::file_error(&numbers))?;
        let document = json!({
            "scene": self.scene, "frequencies_hz": self.frequencies_hz, "x_m": self.x_m, "y_m": self.y_m,
            "reference": numbers,
        });
        std::fs::write(&path, document.to_string()).map_err(Error::file_error(&path))?;
        Ok(path)
    }
}

/// Acceleration in m/s^2 for 1 N at each actuator alone.
#[derive(Clone, Debug)]
pub struct AccelerationCurves {
    /// `[actuator][point, x first][frequency]`.
    pub values: Vec<Complex64>,
    /// Frequencies.
    pub count: usize,
}

impl AccelerationCurves {
    /// From a function of the curve (actuator times points plus point) and the frequency, both as indices.
    pub fn from_fn(curves: usize, frequencies: usize, value_of: impl Fn(usize, usize) -> Complex64) -> Self {
        let value_of = &value_of;
        let values = (0..curves).flat_map(|curve| (0..frequencies).map(move |f| value_of(curve, f))).collect();
        Self { values, count: frequencies }
    }

    /// Largest deviation of other values from these on any curve, relative to the peak of the curve here;
    /// `other_value_of` gives them by actuator times points plus point, and frequency.
    #[must_use]
    pub fn compute_largest_relative_error(&self, other_value_of: impl Fn(usize, usize) -> Complex64) -> f64 {
        let relative_error_of_curve = |(place, curve): (usize, &[Complex64])| {
            let peak = curve.iter().map(|z| z.norm()).fold(f64::MIN_POSITIVE, f64::max);
            let off = curve.iter().enumerate().map(|(f, z)| (z - other_value_of(place, f)).norm()).fold(0.0, f64::max);
            off / peak
        };
        self.values.chunks_exact(self.count).enumerate().map(relative_error_of_curve).fold(0.0, f64::max)
    }
}

/// Most places that get residual shapes of their own.
const FEW: usize = 4;

/// Accelerations at some places by the definition, from a mesh of the given fineness.
///
/// # Errors
/// [`Error::Model`], [`Error::Response`].
pub fn compute_acceleration_curves_on_mesh(
    scene: &Scene,
    fineness: Fineness,
    frequencies_hz: &[f64],
    places: &[(f64, f64)],
) -> Result<AccelerationCurves, Error> {
    let residual = if places.len() <= FEW { places } else { &[] };
    let reduced = PanelModel::build_with_fineness(scene, fineness)?
        .reduce_with_residual_shapes_of_actuators_damping_and_points(MAX_HZ, residual)?;
    let (n, loads, count) = (reduced.count_coordinates(), reduced.count_actuators(), frequencies_hz.len());
    let mut shapes = DMatrix::zeros(n, places.len());
    for (mut column, (x, y)) in shapes.column_iter_mut().zip(places) {
        column.copy_from(&reduced.shape_deflections_at(*x, *y));
    }
    let solver = CoordinateSolver::new(&reduced);
    let mut parts = [DMatrix::zeros(count * loads, n), DMatrix::zeros(count * loads, n)];
    for (f, frequency_hz) in frequencies_hz.iter().enumerate() {
        let scale = -(std::f64::consts::TAU * frequency_hz).powi(2);
        for (load, q) in solver.solve_coordinates_per_newton_at(*frequency_hz)?.iter().enumerate() {
            for (i, q) in q.iter().enumerate() {
                (parts[0][(load * count + f, i)], parts[1][(load * count + f, i)]) = (scale * q.re, scale * q.im);
            }
        }
    }
    let [re, im] = parts.map(|part| part * &shapes);
    let mut values = Vec::with_capacity(count * loads * places.len());
    for load in 0..loads {
        for (re, im) in re.column_iter().zip(im.column_iter()) {
            let own = load * count..(load + 1) * count;
            values.extend(own.map(|row| Complex64::new(re[row], im[row])));
        }
    }
    Ok(AccelerationCurves { values, count })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_becomes_the_problem() {
        let problem = Problem::from_starting_plate().unwrap();
        assert_eq!(problem.scene.surface.damping, SurfaceDamping::LossFactor(0.005));
        assert_eq!((problem.count_points(), problem.frequencies_hz.len()), (49 * 33, 1000));
        assert_eq!(problem.frequencies_hz.last(), Some(&1000.0));
    }

    #[test]
    fn an_error_is_relative_to_its_curve() {
        let curves = AccelerationCurves { values: [1.0, 10.0, 0.1, 0.0].map(Complex64::from).to_vec(), count: 2 };
        // 0.5 off on a curve of 10, 0.02 off on a curve of 0.1.
        let error = curves.compute_largest_relative_error(|place, f| match (place, f) {
            (0, 1) => Complex64::from(10.5),
            (1, 0) => Complex64::from(0.12),
            (place, f) => curves.values[2 * place + f],
        });
        assert!((error - 0.2).abs() < 1e-12, "{error}");
    }
}
