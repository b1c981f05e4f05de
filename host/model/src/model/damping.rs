//! Damping over a basis, and the one kind that needs modes of its own: a ratio on every mode.

use super::assembly::{AttachedVectors, Attachment, EdgeStiffness, PanelMatrices};
use super::eigen::Modes;
use super::sparse::{SparseSymmetricMatrix, SparseVector, multiply_row_with_matrix};
use crate::scene::{ModalRatio, Scene, SurfaceDamping};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::f64::consts::TAU;

/// Part of a vector's modal mass below which what the modes leave of it is rounding.
const NOTHING_LEFT: f64 = 1e-10;

/// Part of the largest below which the forces of springs along edges are left out.
const EDGE_FRACTION: f64 = 1e-6;

/// Motion of a firmly held point under a force, over that of the whole scene under the same force, that is none: a ten-thousandth of
/// what responses are relative to at least. The shape of its reaction would add nothing, and at 1e18 N/m rounding of 6e-5.
const FIXED_POINT_MOTION_RATIO: f64 = 1e-10;

/// Loads that dashpots and losses leave unbalanced at frequencies up to `max_hz`.
///
/// With eta K_s + K_springs in place of a loss of everything, and with springs of another loss than the surface's, modes are coupled through the springs' forces (and with a loss of
/// the surface's mass through those of the masses attached): the modes left out take part as they do in the shape of a
/// dashpot, without which a motion that springs hold is off by about eta whatever the mesh.
pub(super) fn find_load_vectors_of_damping_forces_that_couple_modes(
    scene: &Scene,
    assembled: &PanelMatrices,
    modes: &Modes,
    max_hz: f64,
) -> Vec<SparseVector> {
    let own = SurfaceLosses::from_damping_unless_modal_ratio(scene.surface.damping).unwrap_or_default();
    let omega = std::f64::consts::TAU * max_hz;
    let rigid = omega * omega * scene.surface_mass_with_air_kg() / FIXED_POINT_MOTION_RATIO;
    let couples = |part: &&Attachment| {
        let by_stiffness = own.differs_from_spring_loss_factor(part.loss_factor) && part.stiffness > 0.0;
        let damps = part.damping > 0.0 || by_stiffness || own.alpha > 0.0 && part.mass > 0.0;
        damps && part.stiffness < rigid
    };
    let attached = assembled.attached.attachments.iter();
    let mut loads: Vec<_> = attached.filter(couples).map(|part| part.vector.clone()).collect();
    // Where no mode is that slow there are no amplitudes either.
    let edges = assembled.edges.iter().filter(|_| !modes.lambda.is_empty());
    for edges in edges.filter(|edges| own.differs_from_spring_loss_factor(edges.loss_factor)) {
        // The modes with the amplitudes that one force gives them, and of their forces what is not a sum of others'.
        let mut forces = edges.stiffness.multiply_columns(&modes.vectors);
        for (mut column, lambda) in forces.column_iter_mut().zip(&modes.lambda) {
            column.scale_mut(1.0 / (lambda + omega * omega));
        }
        let eigen = SymmetricEigen::new(forces.tr_mul(&forces));
        let least = EDGE_FRACTION * EDGE_FRACTION * eigen.eigenvalues.amax();
        let kept: Vec<usize> = (0..eigen.eigenvalues.len()).filter(|i| eigen.eigenvalues[*i] > least).collect();
        let independent = forces * eigen.eigenvectors.select_columns(&kept);
        let sparse =
            |column: DVector<f64>| column.iter().copied().enumerate().filter(|(_, value)| *value != 0.0).collect();
        loads.extend(independent.column_iter().map(|column| sparse(column.into_owned())));
    }
    loads.extend(
        assembled.air.iter().filter(|_| own.differs_from_spring_loss_factor(0.0)).map(|air| air.vector.clone()),
    );
    loads
}

/// The surface's own losses that are multiples of its own matrices.
#[derive(Clone, Copy, Debug, Default)]
struct SurfaceLosses {
    /// Loss factor.
    eta: f64,
    /// Per mass, in 1/s.
    alpha: f64,
    /// Per stiffness, in s.
    beta: f64,
}

impl SurfaceLosses {
    /// The losses of a surface's damping that is a multiple of its own matrices; `None` for a ratio of modes.
    fn from_damping_unless_modal_ratio(surface: SurfaceDamping) -> Option<Self> {
        match surface {
            SurfaceDamping::None => Some(Self::default()),
            SurfaceDamping::LossFactor(eta) => Some(Self { eta, ..Self::default() }),
            SurfaceDamping::Rayleigh { alpha, beta } => Some(Self { eta: 0.0, alpha, beta }),
            SurfaceDamping::ModalRatio(_) => None,
        }
    }

    /// Whether springs with this loss factor lose another part of their energy than the surface does.
    fn differs_from_spring_loss_factor(self, loss_factor: f64) -> bool {
        self.beta > 0.0 || self.eta.total_cmp(&loss_factor).is_ne()
    }
}

/// Springs that hold a surface otherwise than at points.
#[derive(Clone, Copy, Debug)]
pub(super) struct DistributedSprings<'a> {
    /// Along edges.
    pub edges: &'a [EdgeStiffness],
    /// Sealed air, which loses nothing.
    pub air: Option<&'a Attachment>,
}

/// Damping matrices over some basis.
#[derive(Clone, Debug)]
pub struct DampingMatrices {
    /// Viscous, multiplies velocities.
    pub viscous: DMatrix<f64>,
    /// Hysteretic, already times the loss factor: multiplies j times displacements.
    pub structural: DMatrix<f64>,
    /// Both as a diagonal and a few couplings, where they are that over a basis of modes.
    pub structured: Option<StructuredDamping>,
}

impl DampingMatrices {
    /// The damping of a scene's surface, of what is attached to it and of its other `springs`, over mass-normalised `vectors` of the squared
    /// frequencies `lambda`.
    pub(super) fn project_onto_vectors(
        surface: SurfaceDamping,
        attached: &AttachedVectors,
        springs: DistributedSprings<'_>,
        lambda: &[f64],
        vectors: &DMatrix<f64>,
    ) -> Self {
        if let Some(structured) = StructuredDamping::new(surface, &attached.attachments, springs, lambda, vectors) {
            return structured.into_full_matrices();
        }
        let n = vectors.ncols();
        let mut damping = Self { viscous: DMatrix::zeros(n, n), structural: DMatrix::zeros(n, n), structured: None };
        for attachment in &attached.attachments {
            let along = multiply_row_with_matrix(&attachment.vector, vectors);
            damping.viscous += attachment.damping * along.transpose() * &along;
            let loss = attachment.loss_factor * attachment.stiffness;
            if loss > 0.0 {
                damping.structural += loss * along.transpose() * along;
            }
        }
        for edges in springs.edges.iter().filter(|edges| edges.loss_factor > 0.0) {
            for shape in factor_edge_stiffness_into_shapes(&edges.stiffness, lambda, vectors) {
                damping.structural.ger(edges.loss_factor, &shape, &shape, 1.0);
            }
        }
        if let SurfaceDamping::ModalRatio(ratio) = surface {
            damping.viscous +=
                compute_modal_ratio_damping_without_actuators(ratio, lambda, vectors, attached.actuator_attachments());
        }
        damping
    }
}

/// Shapes b_k (an entry for each vector), in 1/s over mass-normalised vectors, with V' K_e V = sum of b_k b_k', for the stiffness K_e of springs along
/// edges over `vectors` V [unknown, vector] of the squared frequencies `lambda` in rad^2/s^2; fewer than there are vectors, as motions
/// of an edge are few.
///
/// Entries are compared with sqrt(lambda_i lambda_j), above which none can be: a stiff vector's are not to hide those of the slow modes.
pub(super) fn factor_edge_stiffness_into_shapes(
    edges: &SparseSymmetricMatrix,
    lambda: &[f64],
    vectors: &DMatrix<f64>,
) -> Vec<DVector<f64>> {
    let n = lambda.len();
    let own = vectors.rows(0, edges.dimension()).into_owned();
    let over = own.tr_mul(&edges.multiply_columns(&own));
    let Some(between) = median_of_positive_if_any(lambda) else { return Vec::new() };
    let scale = DVector::from_iterator(n, lambda.iter().map(|lambda| (lambda + between).sqrt()));
    let eigen =
        SymmetricEigen::new(DMatrix::from_fn(n, n, |i, j| 0.5 * (over[(i, j)] + over[(j, i)]) / (scale[i] * scale[j])));
    let kept = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()).filter(|(part, _)| **part > NOTHING_LEFT);
    kept.map(|(part, direction)| direction.component_mul(&scale) * part.sqrt()).collect()
}

/// The median of the positive ones among squared frequencies.
fn median_of_positive_if_any(lambda: &[f64]) -> Option<f64> {
    let mut positive: Vec<f64> = lambda.iter().copied().filter(|lambda| *lambda > 0.0).collect();
    positive.sort_by(f64::total_cmp);
    positive.get(positive.len() / 2).copied()
}

/// Damping of a rank that is lower than the basis is long: of one motion, a point's or an edge's.
#[derive(Clone, Debug)]
pub struct DampingCoupling {
    /// The motion d = shape . q, length n.
    pub shape: DVector<f64>,
    /// Force over the velocity of d, in N s/m.
    pub viscous: f64,
    /// Force over j d, in N/m.
    pub structural: f64,
}

/// C = diag(viscous) + sum of viscous_k b_k b_k' and likewise S, over a basis in which mass and stiffness are diagonal.
///
/// The surface's own stiffness is all stiffness less that of the springs attached, V' K_s V = Lambda - sum of k_i b_i b_i'
/// (the thesis' proportional damping with the discrete part taken out), and its mass likewise.
#[derive(Clone, Debug)]
pub struct StructuredDamping {
    /// Diagonal of C in 1/s.
    pub viscous: DVector<f64>,
    /// Diagonal of S in rad^2/s^2.
    pub structural: DVector<f64>,
    /// What couples the modes.
    pub couplings: Vec<DampingCoupling>,
}

impl StructuredDamping {
    /// Damping of a surface by a loss factor and by mass and stiffness (Rayleigh), and of what is attached to it and along its
    /// edges by dashpots and loss factors, over mass-normalised vectors with the squared frequencies `lambda`.
    pub(super) fn new(
        surface: SurfaceDamping,
        attachments: &[Attachment],
        DistributedSprings { edges, air }: DistributedSprings<'_>,
        lambda: &[f64],
        vectors: &DMatrix<f64>,
    ) -> Option<Self> {
        let own = SurfaceLosses::from_damping_unless_modal_ratio(surface)?;
        let SurfaceLosses { eta, alpha, beta } = own;
        let couplings = attachments.iter().chain(air).map(
            |Attachment { vector, stiffness, loss_factor, damping, mass, .. }| DampingCoupling {
                shape: multiply_row_with_matrix(vector, vectors).transpose(),
                viscous: damping - beta * stiffness - alpha * mass,
                structural: (loss_factor - eta) * stiffness,
            },
        );
        let of_edges =
            edges.iter().filter(|edges| own.differs_from_spring_loss_factor(edges.loss_factor)).flat_map(|edges| {
                let shapes = factor_edge_stiffness_into_shapes(&edges.stiffness, lambda, vectors).into_iter();
                shapes.map(|shape| DampingCoupling { shape, viscous: -beta, structural: edges.loss_factor - eta })
            });
        let couplings = couplings.chain(of_edges);
        let lambda = DVector::from_column_slice(lambda);
        Some(Self {
            viscous: lambda.map(|lambda| alpha + beta * lambda),
            structural: lambda.map(|lambda| eta * lambda),
            couplings: couplings.filter(|coupling| coupling.viscous != 0.0 || coupling.structural != 0.0).collect(),
        })
    }

    /// The damping over some of the coordinates.
    pub(super) fn restrict_to_coordinates(&self, coordinates: &[usize]) -> Self {
        Self {
            viscous: self.viscous.select_rows(coordinates),
            structural: self.structural.select_rows(coordinates),
            couplings: self
                .couplings
                .iter()
                .map(|coupling| DampingCoupling { shape: coupling.shape.select_rows(coordinates), ..*coupling })
                .collect(),
        }
        .reduce_couplings_of_equal_damping_to_independent_shapes()
    }

    /// With couplings that are alike replaced by fewer: Z B B' = Z (U S) (U S)' for B = U S V', without the columns that
    /// are nothing, as when the springs of a panel's corners are asked about one parity of its modes.
    fn reduce_couplings_of_equal_damping_to_independent_shapes(self) -> Self {
        let mut couplings: Vec<DampingCoupling> = Vec::new();
        let mut left = self.couplings;
        while let Some(first) = left.first() {
            let alike =
                |other: &DampingCoupling| (other.viscous, other.structural) == (first.viscous, first.structural);
            let (viscous, structural) = (first.viscous, first.structural);
            let (group, others): (Vec<_>, Vec<_>) = left.iter().cloned().partition(alike);
            left = others;
            let shapes: Vec<_> = group.iter().map(|coupling| coupling.shape.clone()).collect();
            let svd = DMatrix::from_columns(&shapes).svd(true, false);
            let largest = svd.singular_values.amax();
            for (direction, size) in svd.u.iter().flat_map(DMatrix::column_iter).zip(&svd.singular_values) {
                if *size > NOTHING_LEFT * largest {
                    couplings.push(DampingCoupling { shape: direction * *size, viscous, structural });
                }
            }
        }
        Self { couplings, ..self }
    }

    /// The damping as full matrices.
    #[must_use]
    pub fn into_full_matrices(self) -> DampingMatrices {
        let mut viscous = DMatrix::from_diagonal(&self.viscous);
        let mut structural = DMatrix::from_diagonal(&self.structural);
        for DampingCoupling { shape, viscous: c, structural: s } in &self.couplings {
            viscous.ger(*c, shape, shape, 1.0);
            structural.ger(*s, shape, shape, 1.0);
        }
        DampingMatrices { viscous, structural, structured: Some(self) }
    }
}

/// Damping of the viscous `ratio` on every mode of the panel without its ERAs, by that mode's frequency, over mass-normalised `vectors` of the squared
/// frequencies `lambda` of the panel with them; `actuators` is what the ERAs attach.
///
/// On each such mode it is 2 zeta omega, so that with one zeta for all it is 2 zeta M # K, the geometric mean of mass and stiffness: of what they are
/// over the vectors, M = I - sum of m_i b_i b_i' and K = Lambda - sum of k_i b_i b_i'. The modes without the ERAs are in the
/// span of the modes with them and of the shapes of forces at the ERAs, as exactly as the answers are.
fn compute_modal_ratio_damping_without_actuators(
    ratio: ModalRatio,
    lambda: &[f64],
    vectors: &DMatrix<f64>,
    actuators: &[Attachment],
) -> DMatrix<f64> {
    let mut mass = DMatrix::identity(lambda.len(), lambda.len());
    let mut stiffness = DMatrix::from_diagonal(&DVector::from_column_slice(lambda));
    for Attachment { vector, stiffness: spring, mass: own, .. } in actuators {
        let along = multiply_row_with_matrix(vector, vectors).transpose();
        mass.ger(-own, &along, &along, 1.0);
        stiffness.ger(-spring, &along, &along, 1.0);
    }
    2.0 * weighted_geometric_mean_of_matrices(&mass, &stiffness, lambda, |lambda| {
        ratio.damping_ratio_at_frequency(lambda.sqrt() / TAU)
    })
}

/// A # B = A^1/2 (A^-1/2 B A^-1/2)^1/2 A^1/2 for symmetric semidefinite A and B that are at most the identity and the diagonal
/// `upper_bound_diagonal_of_b`; zero where both are. What it is in each direction in which B x = lambda A x is multiplied by `weight(lambda)`.
///
/// In the basis in which s A + B is the identity, A = diag(a) and B = 1 - s a commute, and A # B is diag(sqrt(a (1 - s a))), lambda = 1 / a - s. With
/// s of the size of the slow modes, a is of the size of one for these and goes to zero for stiff ones: points held all but
/// rigidly have lambda a million million times those of the modes, and rounding in sums with those would be all that is left of the modes.
fn weighted_geometric_mean_of_matrices(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    upper_bound_diagonal_of_b: &[f64],
    weight_of_generalised_eigenvalue: impl Fn(f64) -> f64,
) -> DMatrix<f64> {
    let n = a.nrows();
    let Some(between) = median_of_positive_if_any(upper_bound_diagonal_of_b) else { return DMatrix::zeros(n, n) };
    let scale: Vec<f64> = upper_bound_diagonal_of_b.iter().map(|lambda| (lambda + between).sqrt()).collect();
    let scaled = |value: &dyn Fn(usize, usize) -> f64| {
        DMatrix::from_fn(n, n, |i, j| 0.5 * (value(i, j) + value(j, i)) / (scale[i] * scale[j]))
    };
    let both = SymmetricEigen::new(scaled(&|i, j| between * a[(i, j)] + b[(i, j)]));
    let range: Vec<usize> = (0..n).filter(|i| both.eigenvalues[*i] > NOTHING_LEFT).collect();
    if range.is_empty() {
        return DMatrix::zeros(n, n);
    }
    let axes = both.eigenvectors.select_columns(&range);
    let lengths = DVector::from_iterator(range.len(), range.iter().map(|i| both.eigenvalues[*i].sqrt()));
    let inner = axes.tr_mul(&(scaled(&|i, j| between * a[(i, j)]) * &axes));
    let inner = DMatrix::from_fn(range.len(), range.len(), |i, j| {
        0.5 * (inner[(i, j)] + inner[(j, i)]) / (lengths[i] * lengths[j])
    });
    let of_a = SymmetricEigen::new(inner);
    let root = of_a.eigenvalues.map(|part| {
        let part = part.clamp(0.0, 1.0);
        // Infinite where there is no mass, which has no part in the product.
        let lambda = between * (1.0 - part) / part.max(f64::MIN_POSITIVE);
        weight_of_generalised_eigenvalue(lambda) * (part * (1.0 - part) / between).sqrt()
    });
    let middle = &of_a.eigenvectors * DMatrix::from_diagonal(&root) * of_a.eigenvectors.transpose();
    let half = DMatrix::from_diagonal(&DVector::from_vec(scale)) * axes * DMatrix::from_diagonal(&lengths);
    &half * middle * half.transpose()
}

#[cfg(test)]
mod tests {
    use super::super::sparse::MatrixEntries;
    use super::*;

    /// X = A # B is what solves X A^-1 X = B, whatever way it is computed.
    #[test]
    fn the_geometric_mean_solves_its_equation() {
        let a = DMatrix::from_row_slice(3, 3, &[4.0, 1.0, 0.5, 1.0, 3.0, 0.2, 0.5, 0.2, 2.0]) / 8.0;
        let b = DMatrix::from_row_slice(3, 3, &[9.0, -2.0, 1.0, -2.0, 5.0, 0.3, 1.0, 0.3, 70.0]);
        let x = weighted_geometric_mean_of_matrices(&a, &b, &[20.0, 20.0, 80.0], |_| 1.0);
        let back = &x * a.try_inverse().unwrap() * &x;
        assert!((back - b).amax() < 1e-11, "{x}");
    }

    /// Against the product itself, entry by entry relative to what it is of, with a vector that is all but rigidly held.
    #[test]
    fn shapes_of_edges_make_up_their_stiffness() {
        let mut entries = MatrixEntries::default();
        for (row, value) in [(0, 3e4), (1, 5e4), (3, 2e4)] {
            entries.add_outer_product(&[(row, 1.0), (row + 1, -0.4)], value);
        }
        let edges = entries.build_matrix(5).unwrap();
        let lambda: [f64; 4] = [1e4, 4e5, 2e6, 1e19];
        let vectors =
            DMatrix::from_fn(5, 4, |i, j| lambda[j].sqrt() / 4e2 * [0.3, -0.9, 0.7, 0.1, -0.5][(2 * i + 3 * j) % 5]);
        let wanted = vectors.tr_mul(&edges.multiply_columns(&vectors));
        let shapes = factor_edge_stiffness_into_shapes(&edges, &lambda, &vectors);
        assert!(shapes.len() <= 3, "rank 3");
        let off = DMatrix::from_fn(4, 4, |i, j| {
            let found: f64 = shapes.iter().map(|shape| shape[i] * shape[j]).sum();
            (found - wanted[(i, j)]) / (lambda[i] * lambda[j]).sqrt()
        });
        assert!(off.amax() < 1e-9 && wanted[(0, 0)] > 1e-3 * lambda[0], "{off}");
    }

    /// The same with a point that is held all but rigidly, entry by entry relative to what it is of.
    #[test]
    fn a_stiff_point_leaves_the_modes_their_damping() {
        let (lambda, along) = ([1e4, 4e4, 9e5, 1e21], DVector::from_row_slice(&[0.5, -0.3, 0.2, 1e-3]));
        let (mut a, mut b) = (DMatrix::identity(4, 4), DMatrix::from_diagonal(&DVector::from_row_slice(&lambda)));
        a.ger(-0.3, &along, &along, 1.0);
        b.ger(-2e3, &along, &along, 1.0);
        let x = weighted_geometric_mean_of_matrices(&a, &b, &lambda, |_| 1.0);
        let back = &x * a.try_inverse().unwrap() * &x;
        let off = DMatrix::from_fn(4, 4, |i, j| (back[(i, j)] - b[(i, j)]) / (lambda[i] * lambda[j]).sqrt());
        assert!(off.amax() < 1e-6, "{off}");
    }
}
