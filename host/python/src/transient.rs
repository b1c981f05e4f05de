//! `transient`: motion after drives are switched on.

use crate::arguments::{GivenPlace, GivenTolerance, accuracy_from_either_tolerance_or_time_limit_or_balanced as asked};
use crate::errors::{Raised, emit_model_warnings};
use crate::pickles::{Reduced, pickled, reduce_for_pickle};
use crate::results::read_only_array;
use crate::run::run_in_pool_interruptibly;
use crate::scene::PyScene;
use era_model::model::validity;
use era_model::scene::Scene;
use era_model::transient::panel::{
    NO_BOUND, SwitchedForce, choose_time_grid, compute_motion_after_switch_on,
    highest_drive_frequency_but_at_least_1_hz,
};
use numpy::PyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// A point's motion from rest. Arrays are read-only.
#[pyclass(frozen, module = "era", get_all)]
pub struct Transient {
    /// The point in m.
    at_m: (f64, f64),
    /// In s from switching on: float64 [time].
    time_s: Py<PyArray1<f64>>,
    /// In m: float64 [time].
    displacement_m: Py<PyArray1<f64>>,
    /// In m/s^2: float64 [time].
    acceleration_m_s2: Py<PyArray1<f64>>,
    /// Largest acceleration in m/s^2.
    peak_m_s2: f64,
    /// Peak of the steady state in m/s^2: the amplitudes of all drives added up.
    steady_peak_m_s2: f64,
    /// From when on a single drive's motion is within 10 % of the steady state, in s; None if that is not told.
    settled_s: Option<f64>,
    /// None: a motion from switching on has no bound.
    error_bound: Option<f64>,
    /// Why.
    error_bound_missing: String,
}

pickled!(Transient {
    at_m,
    time_s,
    displacement_m,
    acceleration_m_s2,
    peak_m_s2,
    steady_peak_m_s2,
    settled_s,
    error_bound,
    error_bound_missing
});

#[pymethods]
impl Transient {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (count, (x_m, y_m)) = (self.time_s.bind(py).len()?, self.at_m);
        Ok(format!("<Transient: {count} points in time at ({x_m}, {y_m}) m, peak {:.4} m/s^2>", self.peak_m_s2))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduce_for_pickle(py, self)
    }
}

/// A drive as given, in a sequence of any kind: actuator, frequency in Hz, amplitude in N, phase of the cosine in rad.
pub struct GivenDrive {
    id: String,
    frequency_hz: f64,
    force_n: f64,
    phase_rad: f64,
}

impl<'py> FromPyObject<'_, 'py> for GivenDrive {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let parts: Vec<Bound<'py, PyAny>> = given.extract()?;
        let (id, frequency_hz, force_n, phase_rad) = match &parts[..] {
            // A sine: the force rises from nothing.
            [id, frequency_hz, force_n] => (id, frequency_hz, force_n, -FRAC_PI_2),
            [id, frequency_hz, force_n, phase_rad] => (id, frequency_hz, force_n, phase_rad.extract()?),
            parts => {
                let what =
                    "a drive must be (actuator, frequency_hz, force_n) or (actuator, frequency_hz, force_n, phase_rad)";
                return Err(PyTypeError::new_err(format!("{what}, not {} values", parts.len())));
            }
        };
        let (frequency_hz, force_n) = (frequency_hz.extract()?, force_n.extract()?);
        Ok(Self { id: id.extract()?, frequency_hz, force_n, phase_rad })
    }
}

impl GivenDrive {
    fn into_checked_force_switched_on_at_start(
        self,
        scene: &Scene,
        drive_index: usize,
    ) -> Result<SwitchedForce, Raised> {
        let Self { id, frequency_hz, force_n, phase_rad } = self;
        let known = || scene.actuators.iter().map(|actuator| actuator.id.as_str()).collect::<Vec<_>>().join(", ");
        let actuator = scene.actuators.iter().position(|actuator| actuator.id == id);
        let wrong = || {
            Raised::wrong_argument(
                format!("drives[{drive_index}][0]"),
                id.as_str(),
                format!("the id of an actuator, one of: {}", known()),
            )
        };
        let drive = SwitchedForce { actuator: actuator.ok_or_else(wrong)?, frequency_hz, force_n, phase_rad };
        drive.check_frequency_and_force()?;
        if !phase_rad.is_finite() {
            return Err(Raised::wrong_argument(
                format!("drives[{drive_index}][3]"),
                phase_rad,
                "a finite phase in rad",
            ));
        }
        Ok(drive)
    }
}

/// A point's motion after drives are switched on, from rest.
///
/// The same as `era transient`, bit for bit. It has no error bound: switching on excites modes of any frequency.
///
/// Parameters
/// ----------
/// scene : Scene
/// at_m : (float, float) or float
///     The point in m from the top left corner; on a bar x alone will do.
/// drives : sequence of (str, float, float) or (str, float, float, float)
///     Of each an actuator's id, frequency in Hz, force amplitude in N, and the phase of the cosine in rad: -pi/2, a sine, unless given.
/// duration_s : float, default 1.0
///     How long in s.
/// step_s : float, default 1e-4
///     Between two times in s.
/// tolerance : float or {"fast", "balanced", "reference"}, optional
///     What the mesh is chosen for: 1e-8 to 0.1, 1e-3 unless given.
///
/// Returns
/// -------
/// Transient
///
/// Raises
/// ------
/// RequestError
///     An argument is out of range, or names no actuator.
/// ResonanceError
///     A drive is at the resonance of an undamped mode.
/// ModelError
///     Too many unknowns or modes, or matrices that cannot be factored.
///
/// Examples
/// --------
/// >>> import era
/// >>> plate = era.Scene.example("plate")
/// >>> found = era.transient(plate, (0.1, 0.05), [("left", 126.0, 0.1)], duration_s=0.5)
/// >>> found.time_s.shape, float(found.displacement_m[0]) == 0.0, found.error_bound
/// ((5001,), True, None)
#[pyfunction]
#[pyo3(name = "transient", signature = (scene, at_m, drives, *, duration_s=1.0, step_s=1e-4, tolerance=None))]
pub fn compute_transient_motion(
    py: Python<'_>,
    scene: &PyScene,
    at_m: GivenPlace,
    drives: Vec<GivenDrive>,
    duration_s: f64,
    step_s: f64,
    tolerance: Option<GivenTolerance>,
) -> PyResult<Transient> {
    let scene = scene.shared_scene();
    let at_m = at_m.check_place_on_surface_m(&scene, "at_m")?;
    let accuracy = asked(tolerance, None)?;
    let drives = drives
        .into_iter()
        .enumerate()
        .map(|(at, drive)| drive.into_checked_force_switched_on_at_start(&scene, at))
        .collect::<Result<Vec<_>, _>>()?;
    if drives.is_empty() {
        return Err(Raised::wrong_argument("len(drives)", 0, "at least 1").into());
    }
    let grid = choose_time_grid(duration_s, step_s).map_err(Raised::from)?;
    emit_model_warnings(
        py,
        validity::list_thin_plate_warnings(&scene, highest_drive_frequency_but_at_least_1_hz(&drives)),
    )?;
    let (motion, settled_s) = run_in_pool_interruptibly(py, move || {
        let motion = compute_motion_after_switch_on(&scene, accuracy, at_m, &drives, grid)?;
        let settled_s = motion.settling_time_if_single_drive_settles_s(&drives);
        Ok((motion, settled_s))
    })?;
    Ok(Transient {
        at_m,
        peak_m_s2: motion.largest_acceleration_over_time_m_per_s2(),
        steady_peak_m_s2: motion.steady_peak_m_per_s2,
        settled_s,
        time_s: read_only_array(py, motion.time_s),
        displacement_m: read_only_array(py, motion.displacement_m),
        acceleration_m_s2: read_only_array(py, motion.acceleration_m_per_s2),
        error_bound: None,
        error_bound_missing: NO_BOUND.to_owned(),
    })
}
