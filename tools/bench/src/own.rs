//! The program's own solution of the problem, timed.

use crate::clock::{median, timed};
use crate::error::Error;
use crate::problem::{Curves, MAX_HZ, Problem};
use era_model::model::Fineness;
use era_model::model::{Accuracy, PanelModel};
use era_model::response::sweep::{AccelerationSweep, Arithmetic, SurfaceShapes};
use era_model::response::sweep_with_error_bounds;
use num_complex::Complex64;

/// The mesh of the tightest answer: highest order, cells a third of what the band needs.
pub const TIGHTEST: Fineness = Fineness { cell_m: 0.05, order: 15, layers: 4 };
/// The next lower order on the same mesh: how far it is from the tightest says how far that may be from the truth.
pub const NEXT: Fineness = Fineness { order: 13, ..TIGHTEST };

/// One solution.
#[derive(Clone, Debug)]
pub struct Own {
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

impl Own {
    /// From the scene to the result, in s.
    #[must_use]
    pub fn total_s(&self) -> f64 {
        self.set_up_s + self.sweep_s.unwrap_or(0.0)
    }
}

/// Solves the problem `runs` times with the elements that a tolerance starts with; times are medians. Also the last sweep.
///
/// # Errors
/// [`Error::Model`], [`Error::Response`].
pub fn solve<T: Arithmetic + Into<f64>>(
    problem: &Problem,
    accuracy: Accuracy,
    reference: &Curves,
    runs: usize,
) -> Result<(Own, AccelerationSweep<T>), Error> {
    let once = || -> Result<_, Error> {
        let ((model, reduced), set_up_s) = timed(|| -> Result<_, Error> {
            let model = PanelModel::build(&problem.scene, accuracy, MAX_HZ)?;
            let reduced = model.reduce(MAX_HZ, &[])?;
            Ok((model, reduced))
        })?;
        let ((operations, sweep), sweep_s) = timed(|| -> Result<_, Error> {
            let shapes = SurfaceShapes::<T>::new(&problem.scene, &reduced, &problem.x_m, &problem.y_m);
            Ok((
                shapes.count_operations_per_frequency_and_actuator(),
                shapes.compute_accelerations(&problem.frequencies_hz)?,
            ))
        })?;
        Ok((model, reduced, operations, sweep, set_up_s, sweep_s))
    };
    let (mut set_up, mut swept) = (Vec::new(), Vec::new());
    for _ in 1..runs {
        let (.., set_up_s, sweep_s) = once()?;
        set_up.push(set_up_s);
        swept.push(sweep_s);
    }
    let (model, reduced, operations, sweep, set_up_s, sweep_s) = once()?;
    set_up.push(set_up_s);
    swept.push(sweep_s);
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let operations = (operations * problem.frequencies_hz.len() * sweep.actuators) as f64;
    let own = Own {
        name: format!("era, order {}, f{}", model.element_order(), 8 * size_of::<T>()),
        unknowns: model.count_unknowns(),
        coordinates: reduced.count_coordinates(),
        set_up_s: median(set_up),
        sweep_s: Some(median(swept)),
        error: reference.error_of(|curve, f| value(&sweep, curve, f)),
        operations,
    };
    Ok((own, sweep))
}

/// The same in f32 through the ladder of meshes that gives a bound; all of its time is in `set_up_s`.
///
/// # Errors
/// [`Error::Curves`].
pub fn solve_bounded(problem: &Problem, accuracy: Accuracy, reference: &Curves, runs: usize) -> Result<Own, Error> {
    let once = || {
        let points = (problem.x_m.as_slice(), problem.y_m.as_slice());
        timed(|| sweep_with_error_bounds::<f32>(&problem.scene, accuracy, points, &problem.frequencies_hz))
    };
    let mut times = Vec::new();
    for _ in 1..runs {
        times.push(once()?.1);
    }
    let (found, last_s) = once()?;
    times.push(last_s);
    let bounds = found.bounds.iter().map(|bound| bound.limit_if_known().unwrap_or(f64::NAN));
    let bound = bounds.reduce(|a, b| if a > b || a.is_nan() { a } else { b }).unwrap_or(f64::NAN);
    let reduced = found.model.reduce(MAX_HZ, &[])?;
    Ok(Own {
        name: format!("era to {:.0e}, f32, bound {bound:.0e}", accuracy.relative_tolerance_or_tightest()),
        unknowns: found.model.count_unknowns(),
        coordinates: reduced.count_coordinates(),
        set_up_s: median(times),
        sweep_s: None,
        error: reference.error_of(|curve, f| value(&found.answer, curve, f)),
        operations: f64::NAN,
    })
}

/// A value of a sweep as [`Curves`] count them: curves are actuator times points plus point.
pub fn value<T: Arithmetic + Into<f64>>(sweep: &AccelerationSweep<T>, curve: usize, frequency: usize) -> Complex64 {
    let z = sweep.acceleration_per_newton_at_indices(frequency, curve / sweep.points, curve % sweep.points);
    Complex64::new(z.re.into(), z.im.into())
}
