//! Motions that nothing holds.
//!
//! How many there are follows from the rank of what holds the surface, never from small eigenvalues: a spring of
//! 1e-9 N/m is a support, and rounding is not. The motions themselves are c + cx x + cy y, known in closed form, and are
//! kept out of the eigenvalue iteration.

use super::assembly::Assembled;
use crate::scene::{EdgeKind, Mount, Scene, Side, SurfaceKind};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Part of the largest below which a direction of the (dimensionless) holding vectors counts as not held. Two supports
/// 0.1 mm apart on 300 mm give 1e-7.
const RANK: f64 = 1e-13;
/// Part of the shift below which a mode is taken as rigid. Its eigenvalue is then under 1e-7 of the first bending one, and
/// by about that part the surface's bending lowers it; the iteration, for its part, knows eigenvalues to 1e-11 or so of the
/// shift, no better than 1e-5 of one this small.
const NEARLY_RIGID: f64 = 1e-6;

/// Modes found without iteration: rigid ones, and those that springs so soft hold that the surface stays straight.
#[derive(Clone, Debug)]
pub struct RigidModes {
    /// Squared angular frequencies, ascending; exactly 0 where nothing holds.
    pub lambda: Vec<f64>,
    /// M-orthonormal shapes, one column each.
    pub vectors: DMatrix<f64>,
}

/// One thing that holds: stiffness times the square of vector . (c, cx L, cy W), hard or soft.
struct Hold {
    vector: [f64; 3],
    stiffness: f64,
    hard: bool,
}

/// The rigid modes of `assembled`, whose shift is `shift` (> 0).
#[must_use]
pub fn rigid_modes(scene: &Scene, assembled: &Assembled, shift: f64) -> RigidModes {
    let dimensions = match scene.surface.kind {
        SurfaceKind::Plate => 3,
        SurfaceKind::Bar => 2,
    };
    let holds = holds(scene);
    let allowed = null_space(&holds, dimensions);
    let surface = surface_vectors(scene, assembled, &allowed);
    let loose: Vec<usize> = assembled
        .moving_masses
        .iter()
        .filter(|(_, actuator)| scene.actuators.get(*actuator).is_some_and(|a| a.stiffness_n_per_m == 0.0))
        .map(|(unknown, _)| *unknown)
        .collect();
    let columns = surface.ncols() + loose.len();
    let mut all = surface.resize_horizontally(columns, 0.0);
    for (k, unknown) in loose.iter().enumerate() {
        // A mass on no spring moves by itself.
        let column = columns - loose.len() + k;
        all.row_mut(*unknown).fill(0.0);
        all[(*unknown, column)] = 1.0;
    }
    if columns == 0 {
        return RigidModes { lambda: Vec::new(), vectors: all };
    }
    let Some(to_orthonormal) = orthonormaliser(&all, assembled) else {
        return RigidModes { lambda: Vec::new(), vectors: DMatrix::zeros(assembled.unknowns(), 0) };
    };

    // Stiffness of the soft holds over the allowed motions.
    let mut held = DMatrix::zeros(columns, columns);
    let mut rank_matrix = DMatrix::zeros(columns, columns);
    for hold in holds.iter().filter(|hold| !hold.hard && hold.stiffness > 0.0) {
        let full = DVector::from_iterator(dimensions, hold.vector.iter().copied().take(dimensions));
        let along = (allowed.transpose() * full).resize_vertically(columns, 0.0);
        held += hold.stiffness * &along * along.transpose();
        rank_matrix += &along * along.transpose();
    }
    let free = columns - rank(&rank_matrix);
    let energy = to_orthonormal.transpose() * held * &to_orthonormal;
    let eigen = SymmetricEigen::new(0.5 * (&energy + energy.transpose()));
    let mut order: Vec<usize> = (0..columns).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let kept: Vec<usize> = order
        .iter()
        .enumerate()
        .filter(|(i, k)| *i < free || eigen.eigenvalues[**k] < NEARLY_RIGID * shift)
        .map(|(_, k)| *k)
        .collect();
    let lambda =
        kept.iter().enumerate().map(|(i, k)| if i < free { 0.0 } else { eigen.eigenvalues[*k].max(0.0) }).collect();
    let vectors = all * to_orthonormal * eigen.eigenvectors.select_columns(&kept);
    RigidModes { lambda, vectors }
}

fn holds(scene: &Scene) -> Vec<Hold> {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let is_bar = scene.surface.kind == SurfaceKind::Bar;
    let at = |x: f64, y: f64| [1.0, x / length, if is_bar { 0.0 } else { y / width }];
    let mut holds = Vec::new();
    let mut soft = |vector, stiffness| holds.push(Hold { vector, stiffness, hard: false });
    for support in &scene.supports {
        soft(at(support.x_m, support.y_m), support.stiffness_n_per_m);
        // The slope is cx L / L.
        let turning = support.rotational_stiffness_n_m_per_rad;
        soft([0.0, 1.0, 0.0], turning / (length * length));
        if !is_bar {
            soft([0.0, 0.0, 1.0], turning / (width * width));
        }
    }
    for actuator in scene.actuators.iter().filter(|actuator| actuator.mount == Mount::Grounded) {
        soft(at(actuator.x_m, actuator.y_m), actuator.stiffness_n_per_m);
    }
    for edge in &scene.edges {
        let (ends, side_length, turn, lever): ([(f64, f64); 2], f64, [f64; 3], f64) = match edge.side {
            Side::Left => ([(0.0, 0.0), (0.0, width)], width, [0.0, 1.0, 0.0], length),
            Side::Right => ([(length, 0.0), (length, width)], width, [0.0, 1.0, 0.0], length),
            Side::Top => ([(0.0, 0.0), (length, 0.0)], length, [0.0, 0.0, 1.0], width),
            Side::Bottom => ([(0.0, width), (length, width)], length, [0.0, 0.0, 1.0], width),
        };
        let weight = if is_bar { 1.0 } else { side_length };
        // Two Gauss points integrate the square of a linear function exactly; on a bar both are the same point.
        let gauss = [0.5 - 0.5 / 3.0_f64.sqrt(), 0.5 + 0.5 / 3.0_f64.sqrt()];
        let points =
            gauss.map(|t| at(ends[0].0 + t * (ends[1].0 - ends[0].0), ends[0].1 + t * (ends[1].1 - ends[0].1)));
        let (stiffness, turning, hard) = match edge.kind {
            EdgeKind::Pinned => (1.0, 0.0, true),
            EdgeKind::Clamped => (1.0, 1.0, true),
            EdgeKind::Elastic { stiffness, rotational_stiffness } => (stiffness, rotational_stiffness, false),
        };
        for vector in points {
            holds.push(Hold { vector, stiffness: stiffness * 0.5 * weight, hard });
        }
        holds.push(Hold { vector: turn, stiffness: turning * weight / (lever * lever), hard });
    }
    holds
}

/// Orthonormal basis of the motions (c, cx L, cy W) that hard edges allow.
fn null_space(holds: &[Hold], dimensions: usize) -> DMatrix<f64> {
    let mut gram = DMatrix::zeros(dimensions, dimensions);
    for hold in holds.iter().filter(|hold| hold.hard && hold.stiffness > 0.0) {
        let vector = DVector::from_iterator(dimensions, hold.vector.iter().copied().take(dimensions));
        gram += &vector * vector.transpose();
    }
    let eigen = SymmetricEigen::new(gram);
    let largest = eigen.eigenvalues.amax().max(f64::MIN_POSITIVE);
    let free: Vec<usize> = (0..dimensions).filter(|i| eigen.eigenvalues[*i] <= RANK * largest).collect();
    eigen.eigenvectors.select_columns(&free)
}

fn rank(gram: &DMatrix<f64>) -> usize {
    let eigenvalues = SymmetricEigen::new(gram.clone()).eigenvalues;
    let largest = eigenvalues.amax();
    eigenvalues.iter().filter(|value| largest > 0.0 && **value > RANK * largest).count()
}

/// The allowed motions over all unknowns: the surface, and the moving masses that ride on it.
fn surface_vectors(scene: &Scene, assembled: &Assembled, allowed: &DMatrix<f64>) -> DMatrix<f64> {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let mut out = DMatrix::zeros(assembled.unknowns(), allowed.ncols());
    for (motion, mut column) in allowed.column_iter().zip(out.column_iter_mut()) {
        let (c, cx) = (motion[0], motion[1] / length);
        let cy = motion.get(2).copied().unwrap_or(0.0) / width;
        for (entry, value) in column.iter_mut().zip(assembled.grid.linear(c, cx, cy)) {
            *entry = value;
        }
        for (unknown, actuator) in &assembled.moving_masses {
            if let Some(actuator) = scene.actuators.get(*actuator) {
                column[*unknown] = c + cx * actuator.x_m + cy * actuator.y_m;
            }
        }
    }
    out
}

/// T such that (V T)' M (V T) = 1.
fn orthonormaliser(vectors: &DMatrix<f64>, assembled: &Assembled) -> Option<DMatrix<f64>> {
    let gram = vectors.transpose() * assembled.mass.times(vectors);
    let lower = gram.cholesky()?.l();
    lower.transpose().try_inverse()
}
