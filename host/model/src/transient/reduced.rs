//! The panel's modes in time.

use crate::model::ReducedModel;
use nalgebra::{DMatrix, DVector};

/// Modes above this frequency follow any force within the step statically; their compliance is below 1e-4 of that of the
/// modes kept, and leaving them out keeps the matrix exponential well scaled.
const HIGHEST_MODE_HZ: f64 = 200e3;
/// Velocities are divided by this in the state (rad/s), to be of the size of displacements.
pub const VELOCITY_SCALE: f64 = 1e3;

/// q'' + C q' + Lambda q = B f: mass-normalised, n coordinates, p forces.
#[derive(Clone, Debug)]
pub struct ModalSystem {
    /// Squared angular frequencies in rad^2/s^2, length n.
    pub lambda: DVector<f64>,
    /// Damping in 1/s, n x n.
    pub damping: DMatrix<f64>,
    /// Modal force of 1 N at each actuator, n x p, in kg^-1/2.
    pub force: DMatrix<f64>,
}

impl ModalSystem {
    /// The reduced model in time. Hysteretic damping, j S, has no causal form; each mode gets the viscous damping that
    /// loses as much at its own resonance, S_rs / sqrt(w_r w_s), which differs from it by less than half the loss factor
    /// of a mode's part anywhere else.
    #[must_use]
    pub fn from_reduced_with_equivalent_viscous_damping(model: &ReducedModel) -> Self {
        Self {
            lambda: model.lambda.clone(),
            damping: viscous_damping_plus_equivalent_of_hysteretic(model),
            force: model.force.clone(),
        }
    }
}

/// The model with the damping that it has in time ([`ModalSystem::from_reduced_with_equivalent_viscous_damping`]), for the frequency domain; `None` if that
/// is its own.
#[must_use]
pub fn with_viscous_damping_if_hysteretic(model: &ReducedModel) -> Option<ReducedModel> {
    if model.structural.iter().all(|entry| *entry == 0.0) {
        return None;
    }
    let mut causal = model.clone();
    causal.structural.fill(0.0);
    causal.viscous = viscous_damping_plus_equivalent_of_hysteretic(model);
    causal.structured = None;
    Some(causal)
}

/// The model with the damping and the modes that it has in time (those up to 200 kHz), for the frequency
/// domain; `None` if all of its modes are stepped. Those left out have no force and no coupling, and stay at rest.
#[must_use]
pub fn make_viscous_and_silence_fast_modes_unless_all_modes_are_slow(model: &ReducedModel) -> Option<ReducedModel> {
    let left_out: Vec<usize> =
        (0..model.count_coordinates()).filter(|i| !is_mode_slow_enough_to_step(model.lambda[*i])).collect();
    if left_out.is_empty() {
        return None;
    }
    let mut kept = with_viscous_damping_if_hysteretic(model).unwrap_or_else(|| model.clone());
    for i in left_out {
        kept.force.row_mut(i).fill(0.0);
        kept.viscous.row_mut(i).fill(0.0);
        kept.viscous.column_mut(i).fill(0.0);
    }
    kept.structured = None;
    Some(kept)
}

/// Whether a mode with the squared angular frequency `lambda` (rad^2/s^2) is stepped in time.
#[must_use]
pub fn is_mode_slow_enough_to_step(lambda: f64) -> bool {
    lambda < (std::f64::consts::TAU * HIGHEST_MODE_HZ).powi(2)
}

fn viscous_damping_plus_equivalent_of_hysteretic(model: &ReducedModel) -> DMatrix<f64> {
    let omega = model.lambda.map(f64::sqrt);
    let n = model.count_coordinates();
    DMatrix::from_fn(n, n, |i, j| {
        let scale = (omega[i] * omega[j]).sqrt();
        let structural = if scale > 0.0 { model.structural[(i, j)] / scale } else { 0.0 };
        model.viscous[(i, j)] + structural
    })
}

/// Exact propagation over one step under constant force: z' = E z + G f with z = (q, q'/scale), and the mean over the step
/// of the actuators' travel, B' q: the row that the force's work goes by is the one that the travel is read by.
#[derive(Clone, Debug)]
pub struct ConstantForceStepper {
    /// E, 2n x 2n.
    pub propagate: DMatrix<f64>,
    /// G, 2n x p.
    pub input: DMatrix<f64>,
    /// Mean travel per z, p x 2n.
    pub travel: DMatrix<f64>,
    /// Mean travel per force in m/N, p x p.
    pub travel_input: DMatrix<f64>,
}

impl ConstantForceStepper {
    /// Of a system with n coordinates and p forces, for steps of `step_s`.
    #[must_use]
    pub fn new(system: &ModalSystem, step_s: f64) -> Self {
        let (n, p) = (system.lambda.len(), system.force.ncols());
        // exp([[A, B], [0, 0]] dt) holds both matrices (Van Loan 1978), and with rows y' = B' q / dt the mean.
        let mut block = DMatrix::zeros(2 * n + 2 * p, 2 * n + 2 * p);
        for i in 0..n {
            block[(i, n + i)] = VELOCITY_SCALE * step_s;
            block[(n + i, i)] = -system.lambda[i] / VELOCITY_SCALE * step_s;
            for j in 0..n {
                block[(n + i, n + j)] = -system.damping[(i, j)] * step_s;
            }
            for j in 0..p {
                block[(n + i, 2 * n + j)] = system.force[(i, j)] / VELOCITY_SCALE * step_s;
                block[(2 * n + p + j, i)] = system.force[(i, j)];
            }
        }
        let exponential = block.exp();
        Self {
            propagate: exponential.view((0, 0), (2 * n, 2 * n)).into_owned(),
            input: exponential.view((0, 2 * n), (2 * n, p)).into_owned(),
            travel: exponential.view((2 * n + p, 0), (p, 2 * n)).into_owned(),
            travel_input: exponential.view((2 * n + p, 2 * n), (p, p)).into_owned(),
        }
    }
}
