//! Motions that nothing holds, or next to nothing.
//!
//! How many are free follows from the rank of what holds the surface, never from small eigenvalues: a spring of
//! 1e-9 N/m is a support, and rounding is not. The motions themselves are c + cx x + cy y, and that of an inertial ERA's
//! mass by itself; they are known in closed form and are kept out of the eigenvalue iteration.

use super::assembly::PanelMatrices;
use super::attached::all_point_attachments;
use super::eigen::Modes;
use crate::scene::{Actuator, EdgeKind, Scene, Side, SurfaceKind};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Part of the largest below which a direction of the (dimensionless) holding vectors counts as not held. Two supports
/// 0.1 mm apart on 300 mm give 1e-7; nearer than 1e-6 of the side they share a node.
const RANK: f64 = 1e-13;
/// Stiffness of what holds a motion, as a part of shift times the surface's mass (some sixteenth of its bending
/// stiffness), below which the surface stays straight in it. Bending lowers the eigenvalue by about this part. Of the motion as a
/// whole, whatever masses it carries, and of the springs that it works against.
const STAYS_STRAIGHT: f64 = 1e-6;
/// Travel of a spring in what hard edges allow, as a part of its travel without them, below which it is on such an edge.
const ON_EDGE: f64 = 1e-13;
/// Travel of a spring as a part of the motion below which it is a hinge.
const HINGE: f64 = 1e-9;
/// Eigenvalue as a part of the shift below which shift-invert about it loses digits: it knows eigenvalues to 1e-11 or so
/// of the shift.
const SLOW: f64 = 1e-4;
/// Part of the largest stiffness of a stage above which that stage's eigenvalues are believed; the rest is projected
/// again. Springs of 1e18 and 1e-9 N/m on one panel leave no digit of the soft one in a single eigensolution.
const STAGE: f64 = 1e-6;

/// What is known of a panel's slowest motions before any iteration.
#[derive(Clone, Debug)]
pub struct RigidModes {
    /// Modes known in closed form: eigenvalue exactly 0 where nothing holds, and those that springs so soft hold that the
    /// surface stays straight.
    pub known: Modes,
    /// Upper bounds of the eigenvalues of further motions that are slow against the shift, because springs are soft or
    /// masses heavy, but in which the surface bends.
    pub slow: Vec<f64>,
}

/// One thing that holds: stiffness times the square of vector . (c, cx L, cy W), hard or soft.
struct HoldingSpring {
    vector: [f64; 3],
    stiffness: f64,
    hard: bool,
}

/// The slowest motions of `assembled`, whose shift is `shift` (> 0).
#[must_use]
pub fn find_rigid_modes_and_eigenvalue_bounds_of_slow_motions(
    scene: &Scene,
    assembled: &PanelMatrices,
    shift: f64,
) -> RigidModes {
    let dimensions = match scene.surface.kind {
        SurfaceKind::Plate => 3,
        SurfaceKind::Bar => 2,
    };
    let holds = collect_holding_springs(scene, assembled);
    let allowed = basis_of_rigid_motions_hard_edges_allow(&holds, dimensions);
    let moving = &assembled.attached.moving_masses;
    let columns = allowed.ncols() + moving.len();
    let nothing = || Modes { lambda: Vec::new(), vectors: DMatrix::zeros(assembled.count_unknowns(), 0) };
    if columns == 0 {
        return RigidModes { known: nothing(), slow: Vec::new() };
    }
    // The surface with all masses riding on it, then each mass by itself.
    let mut all = expand_rigid_motions_to_unknowns(assembled, &allowed).resize_horizontally(columns, 0.0);
    for (k, (unknown, _)) in moving.iter().enumerate() {
        all[(*unknown, allowed.ncols() + k)] = 1.0;
    }
    let Some(to_orthonormal) = compute_mass_orthonormaliser(&all, assembled) else {
        return RigidModes { known: nothing(), slow: Vec::new() };
    };
    // What resists these motions: rows of the square root of the stiffness, and the same without their sizes.
    let on_surface = holds.iter().filter(|hold| !hold.hard && hold.stiffness > 0.0).map(|hold| {
        let full = DVector::from_iterator(dimensions, hold.vector.iter().copied().take(dimensions));
        let mut along = allowed.tr_mul(&full);
        // On a hard edge it holds nothing that the edge does not, and what is left of it is rounding.
        if along.norm() <= ON_EDGE * full.norm() {
            along.fill(0.0);
        }
        (along.resize_vertically(columns, 0.0), hold.stiffness)
    });
    let on_masses = moving.iter().enumerate().filter_map(|(k, (_, actuator))| {
        let stiffness = scene.actuators.get(*actuator).map_or(0.0, Actuator::effective_stiffness_n_per_m);
        let mut alone = DVector::zeros(columns);
        alone[allowed.ncols() + k] = 1.0;
        (stiffness > 0.0).then_some((alone, stiffness))
    });
    let (mut roots, mut directions) = (DMatrix::zeros(0, columns), DMatrix::zeros(columns, columns));
    let held_by: Vec<(DVector<f64>, f64)> = on_surface.chain(on_masses).collect();
    for (along, stiffness) in &held_by {
        let row = roots.nrows();
        roots = roots.resize_vertically(row + 1, 0.0);
        roots.set_row(row, &(along.transpose() * stiffness.sqrt()));
        directions += along * along.transpose();
    }
    let free = columns - numerical_rank(&directions);

    let straight = STAYS_STRAIGHT * shift * scene.surface_mass_with_air_kg();
    let mut known = nothing();
    let mut slow = Vec::new();
    for (lambda, motion) in compute_eigenpairs_of_gram_matrix_in_stages(&(roots * &to_orthonormal), free) {
        let motion = &to_orthonormal * motion;
        if lambda <= straight * motion.norm_squared()
            && energy_weighted_mean_stiffness_against_motion(&held_by, &motion) <= straight
        {
            let at = known.lambda.len();
            known.lambda.push(lambda);
            known.vectors = known.vectors.resize_horizontally(at + 1, 0.0);
            known.vectors.set_column(at, &(&all * motion));
        } else if lambda < SLOW * shift {
            slow.push(lambda);
        }
    }
    RigidModes { known, slow }
}

/// Stiffness of what a motion works against, the mean weighted by energy: sum of (k d)^2 over sum of k d^2. With forces k d a surface of
/// rigidity that makes k_b lowers the eigenvalue by this over k_b. Three springs that are nearly in a line hold a slow motion, each with little
/// travel and all of its stiffness.
fn energy_weighted_mean_stiffness_against_motion(held_by: &[(DVector<f64>, f64)], motion: &DVector<f64>) -> f64 {
    let (mut forces, mut energy) = (0.0, 0.0);
    for (along, stiffness) in held_by {
        let travel = along.dot(motion);
        // A hinge, whose travel is rounding; its force is of the size of the others'.
        if travel.abs() > HINGE * along.norm() * motion.norm() {
            forces += (stiffness * travel).powi(2);
            energy += stiffness * travel * travel;
        }
    }
    if energy > 0.0 { forces / energy } else { 0.0 }
}

/// Eigenvalues and vectors of roots' roots, ascending, of which `zero_count` are known to be zero. Stage by stage from the
/// stiffest down, each on the space that the stiffer ones leave: every eigenvalue keeps its own digits.
fn compute_eigenpairs_of_gram_matrix_in_stages(roots: &DMatrix<f64>, zero_count: usize) -> Vec<(f64, DVector<f64>)> {
    let mut rest = DMatrix::identity(roots.ncols(), roots.ncols());
    let mut pairs = Vec::with_capacity(roots.ncols());
    while rest.ncols() > zero_count {
        let here = roots * &rest;
        let eigen = SymmetricEigen::new(here.tr_mul(&here));
        let mut order: Vec<usize> = (0..rest.ncols()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let largest = eigen.eigenvalues[order[0]];
        let held = rest.ncols() - zero_count;
        let taken = order.iter().take(held).take_while(|k| eigen.eigenvalues[**k] >= STAGE * largest).count().max(1);
        for k in order.iter().take(taken) {
            pairs.push((eigen.eigenvalues[*k].max(0.0), &rest * eigen.eigenvectors.column(*k)));
        }
        rest *= eigen.eigenvectors.select_columns(order.iter().skip(taken));
    }
    pairs.extend(rest.column_iter().map(|column| (0.0, column.into_owned())));
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    pairs
}

/// Everything that holds the surface against rigid motions: springs, edges, sealed air.
fn collect_holding_springs(scene: &Scene, assembled: &PanelMatrices) -> Vec<HoldingSpring> {
    let grid = &assembled.grid;
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let is_bar = scene.surface.kind == SurfaceKind::Bar;
    let at = |x: f64, y: f64| [1.0, x / length, if is_bar { 0.0 } else { y / width }];
    // Where the matrices have it: attachments that share a bar's node hold nothing against each other.
    let at_node = |x: f64, y: f64| {
        let (x, y) = grid.merged_attachment_position_m(x, y);
        at(x, y)
    };
    let mut holds = Vec::new();
    let mut soft = |vector, stiffness| holds.push(HoldingSpring { vector, stiffness, hard: false });
    for attached in all_point_attachments(scene) {
        soft(at_node(attached.at.0, attached.at.1), attached.stiffness_n_per_m);
        // The slope is cx L / L.
        let turning = attached.turning_n_m_per_rad;
        soft([0.0, 1.0, 0.0], turning / (length * length));
        if !is_bar {
            soft([0.0, 0.0, 1.0], turning / (width * width));
        }
    }
    if let Some(air) = &assembled.air {
        let mean = |c: f64, cx: f64, cy: f64| -> f64 {
            let motion = grid.unknown_values_of_rigid_deflection(c, cx, cy);
            air.vector.iter().map(|(unknown, value)| value * motion[*unknown]).sum()
        };
        let along_y = if is_bar { 0.0 } else { mean(0.0, 0.0, 1.0 / width) };
        soft([mean(1.0, 0.0, 0.0), mean(0.0, 1.0 / length, 0.0), along_y], air.stiffness);
    }
    let layout = scene.layout();
    for edge in &scene.edges {
        let (is_upright, turn, lever) = match edge.side {
            Side::Left | Side::Right => (true, [0.0, 1.0, 0.0], length),
            Side::Top | Side::Bottom => (false, [0.0, 0.0, 1.0], width),
        };
        let across = match edge.side {
            Side::Left | Side::Top => 0.0,
            Side::Right | Side::Bottom => lever,
        };
        let (stiffness, turning, hard) = match edge.kind {
            EdgeKind::Pinned => (1.0, 0.0, true),
            EdgeKind::Clamped => (1.0, 1.0, true),
            EdgeKind::Elastic { stiffness, rotational_stiffness, .. } => (stiffness, rotational_stiffness, false),
        };
        // Two Gauss points integrate the square of a linear function exactly; on a bar both are the same point.
        let gauss = [0.5 - 0.5 / 3.0_f64.sqrt(), 0.5 + 0.5 / 3.0_f64.sqrt()];
        for [from, to] in layout.remaining_stretches_of_side_m(edge.side) {
            let weight = if is_bar { 1.0 } else { to - from };
            for along in gauss.map(|t| from + t * (to - from)) {
                let vector = if is_upright { at(across, along) } else { at(along, across) };
                holds.push(HoldingSpring { vector, stiffness: stiffness * 0.5 * weight, hard });
            }
            holds.push(HoldingSpring { vector: turn, stiffness: turning * weight / (lever * lever), hard });
        }
    }
    holds
}

/// Orthonormal basis of the motions (c, cx L, cy W) that hard edges allow.
fn basis_of_rigid_motions_hard_edges_allow(holds: &[HoldingSpring], dimensions: usize) -> DMatrix<f64> {
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

/// The number of eigenvalues that are more than rounding.
fn numerical_rank(gram: &DMatrix<f64>) -> usize {
    let eigenvalues = SymmetricEigen::new(gram.clone()).eigenvalues;
    let largest = eigenvalues.amax();
    eigenvalues.iter().filter(|value| largest > 0.0 && **value > RANK * largest).count()
}

/// The allowed motions over all unknowns: the surface, and the moving masses that ride on it.
fn expand_rigid_motions_to_unknowns(assembled: &PanelMatrices, allowed: &DMatrix<f64>) -> DMatrix<f64> {
    let grid = &assembled.grid;
    let (length, width) = grid.length_and_width_or_1_m();
    let mut out = DMatrix::zeros(assembled.count_unknowns(), allowed.ncols());
    for (motion, mut column) in allowed.column_iter().zip(out.column_iter_mut()) {
        let (c, cx) = (motion[0], motion[1] / length);
        let cy = motion.get(2).copied().unwrap_or(0.0) / width;
        for (entry, value) in column.iter_mut().zip(grid.unknown_values_of_rigid_deflection(c, cx, cy)) {
            *entry = value;
        }
        for (unknown, actuator) in &assembled.attached.moving_masses {
            if let Some(actuator) = assembled.attached.actuators.get(*actuator) {
                // Its travel is the surface's deflection there minus its own.
                let others = actuator.travel.iter().filter(|(index, _)| index != unknown);
                column[*unknown] = others.map(|(index, value)| column[*index] * value).sum();
            }
        }
    }
    out
}

/// The matrix T with (V T)' M (V T) = 1; `None` if the vectors depend on each other.
fn compute_mass_orthonormaliser(vectors: &DMatrix<f64>, assembled: &PanelMatrices) -> Option<DMatrix<f64>> {
    let gram = vectors.transpose() * assembled.mass.multiply_columns(vectors);
    let lower = gram.cholesky()?.l();
    lower.transpose().try_inverse()
}
