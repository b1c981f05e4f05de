//! The program's own solution of the problem, timed.

use crate::clock::{compute_median, run_and_time_s};
use crate::error::Error;
use crate::problem::{AccelerationCurves, MAX_HZ, Problem};
use era_model::model::Fineness;
use era_model::model::{Accuracy, PanelModel};
use era_model::response::compute_acceleration_sweep_per_newton_with_error_bounds;
use era_model::response::sweep::{AccelerationSweep, Arithmetic, SurfaceShapes};
use num_complex::Complex64;

/// The mesh of the tightest answer: highest order, cells a third of what the band needs.
pub const TIGHTEST: Fineness = Fineness { cell_m: 0.05, order: 15, layers: 4 };
/// The next lower order on the same mesh: how far it is from the tightest says how far that may be from the truth.
pub const NEXT: Fineness = Fineness { order: 13, ..TIGHTEST };

/// Size, times and error of one of the program's solutions.
#[derive(Clone, Debug)]
pub struct EraMeasurement {
    /// What was done.
    pub name: String,
    /// Unknowns of the mesh.
    pub unknowns: usize,
    /// Modes and residual shapes.
    pub coordinates: usize,
    /// From the scene to modes, in s.
    pub set_up_s: f64,
    /// Shapes at the points and all responses, in s; `None` if `set_up_s` has it all.
    pub sweep_s: Option<f64>,
    /// Largest on any curve, relative to its peak.
    pub error: f64,
    /// Additions and multiplications of the sweep's products.
    pub operations: f64,
}

impl EraMeasurement {
    /// From the scene to the result, in s.
    #[must_use]
    pub fn total_time_s(&self) -> f64 {
        self.set_up_s + self.sweep_s.unwrap_or(0.0)
    }
}

/// Solves the problem `runs` times with the elements that a tolerance starts with; times are medians. Also returns
/// the last sweep.
///
/// # Errors
/// [`Error::Model`], [`Error::Response`].
pub fn measure_solution_on_one_mesh<T: Arithmetic + Into<f64>>(
    problem: &Problem,
    accuracy: Accuracy,
    reference: &AccelerationCurves,
    runs: usize,
) -> Result<(EraMeasurement, AccelerationSweep<T>), Error> {
    let solve_once = || -> Result<_, Error> {
        let ((model, reduced), set_up_s) = run_and_time_s(|| -> Result<_, Error> {
            let model = PanelModel::build(&problem.scene, accuracy, MAX_HZ)?;
            let reduced = model.reduce_with_residual_shapes_of_actuators_damping_and_points(MAX_HZ, &[])?;
            Ok((model, reduced))
        })?;
        let ((operations, sweep), sweep_s) = run_and_time_s(|| -> Result<_, Error> {
            let shapes = SurfaceShapes::<T>::new(&problem.scene, &reduced, &problem.x_m, &problem.y_m);
            Ok((
                shapes.count_multiplications_and_additions_per_frequency_and_actuator(),
                shapes.compute_accelerations_per_newton_at_all_points(&problem.frequencies_hz)?,
            ))
        })?;
        Ok((model, reduced, operations, sweep, set_up_s, sweep_s))
    };
    let (mut set_up, mut swept) = (Vec::new(), Vec::new());
    for _ in 1..runs {
        let (.., set_up_s, sweep_s) = solve_once()?;
        set_up.push(set_up_s);
        swept.push(sweep_s);
    }
    let (model, reduced, operations, sweep, set_up_s, sweep_s) = solve_once()?;
    set_up.push(set_up_s);
    swept.push(sweep_s);
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let operations = (operations * problem.frequencies_hz.len() * sweep.actuators) as f64;
    let own = EraMeasurement {
        name: format!("era, order {}, f{}", model.element_order(), 8 * size_of::<T>()),
        unknowns: model.count_unknowns(),
        coordinates: reduced.count_coordinates(),
        set_up_s: compute_median(set_up),
        sweep_s: Some(compute_median(swept)),
        error: reference
            .compute_largest_relative_error(|curve, f| get_acceleration_per_newton_of_curve(&sweep, curve, f)),
        operations,
    };
    Ok((own, sweep))
}

/// The same in f32 through the ladder of meshes that gives a bound; all of its time is in `set_up_s`.
///
/// # Errors
/// [`Error::Curves`].
pub fn measure_solution_with_bound(
    problem: &Problem,
    accuracy: Accuracy,
    reference: &AccelerationCurves,
    runs: usize,
) -> Result<EraMeasurement, Error> {
    let solve_once = || {
        let points = (problem.x_m.as_slice(), problem.y_m.as_slice());
        run_and_time_s(|| {
            compute_acceleration_sweep_per_newton_with_error_bounds::<f32>(
                &problem.scene,
                accuracy,
                points,
                &problem.frequencies_hz,
            )
        })
    };
    let mut times = Vec::new();
    for _ in 1..runs {
        times.push(solve_once()?.1);
    }
    let (found, last_s) = solve_once()?;
    times.push(last_s);
    let bounds = found.bounds.iter().map(|bound| bound.limit_if_known().unwrap_or(f64::NAN));
    let bound = bounds.reduce(|a, b| if a > b || a.is_nan() { a } else { b }).unwrap_or(f64::NAN);
    let reduced = found.model.reduce_with_residual_shapes_of_actuators_damping_and_points(MAX_HZ, &[])?;
    Ok(EraMeasurement {
        name: format!("era to {:.0e}, f32, bound {bound:.0e}", accuracy.relative_tolerance_or_tightest()),
        unknowns: found.model.count_unknowns(),
        coordinates: reduced.count_coordinates(),
        set_up_s: compute_median(times),
        sweep_s: None,
        error: reference
            .compute_largest_relative_error(|curve, f| get_acceleration_per_newton_of_curve(&found.answer, curve, f)),
        operations: f64::NAN,
    })
}

/// A value of a sweep as [`AccelerationCurves`] count them: curves are actuator times points plus point.
pub fn get_acceleration_per_newton_of_curve<T: Arithmetic + Into<f64>>(
    sweep: &AccelerationSweep<T>,
    curve: usize,
    frequency: usize,
) -> Complex64 {
    let z = sweep.acceleration_per_newton_at_indices(frequency, curve / sweep.points, curve % sweep.points);
    Complex64::new(z.re.into(), z.im.into())
}
