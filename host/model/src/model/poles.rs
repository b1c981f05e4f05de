//! Poles of damped modes: s with det(s^2 + s C + Lambda + j S) = 0 (thesis, equation 16), each followed from its undamped mode.
//!
//! The diagonal of C in undamped modes is no damping ratio where dashpots couple modes: a strong one holds its point, and the pole that began
//! as a mode ends at a motion that leaves the point at rest, with next to no damping. So all damping is scaled by t from 0 to 1, and each pole
//! is the one whose state (q, s q) is nearly the one before: where a step turns a state by more than `SAME` allows, a shorter one is tried. Where
//! two conjugate poles meet on the real axis the mode no longer swings: from there on it has the faster one of two, and the slower one beside it.
//!
//! The eigenvalues are those of (A - sigma)^-1, A the state matrix, sigma of the size of the frequencies asked for: what is near sigma keeps its
//! digits, whatever dashpots and springs there are. Loss factors have no meaning at any real s; with them a pole is one with
//! Im s > 0 of the equation with the complex stiffness, s^2 = -lambda (1 + j eta) of a mode by itself. The poles of that equation are no conjugate
//! pairs, and none that loses energy by it is real: such a mode has one pole, whatever its dashpots, and no slower one beside it.
//!
//! Motions that nothing holds stay at s = 0, as often as twice each. Those are no mode's poles, and rounding leaves them anywhere near.

use super::damping::{DampingCoupling, DampingMatrices};
use nalgebra::{ComplexField, DMatrix, DVector};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Square of the part of a state that has to be left in the next one.
const SAME: f64 = 0.8;
/// Part of its modulus below which an imaginary part is rounding: of two equal poles it is the root of that.
const REAL: f64 = 1e-8;
/// Part by which the squares of two real eigenvalues of a shape have to differ for them to be the faster and the slower one.
const NEARLY_ONE: f64 = 1e-6;
/// Part of its eigenvalue below which the distance of two modes counts as none: any mixture of theirs is a mode.
const EQUAL: f64 = 1e-9;
/// Couplings smaller than this part of the mean of the two they couple are none.
const UNCOUPLED: f64 = 1e-13;
/// Factor by which damping grows from step to step at most, and at least.
const GROWTH: (f64, f64) = (1.002, 1e4);
/// The first part of the damping that is tried after all of it, and how much less each time.
const FIRST: f64 = 0.1;
/// Part of the damping below which there is none.
const LEAST: f64 = 1e-15;
/// Parts below which a state is one of a motion that nothing holds: of its square outside of those, and of sigma that its |s| is. A double zero is
/// known by the root of rounding.
const AT_REST: f64 = 1e-10;
const AT_REST_RATE: f64 = 1e-5;
/// Ratio above which a motion dies out before it swings.
const DIES_OUT: f64 = 0.9;
/// Part of its modulus by which rounding makes the real part of a pole positive at most: nothing here drives itself.
const PASSIVE: f64 = 1e-8;
/// Part of itself by which an eigenvalue is improved at most.
const SMALL_STEP: f64 = 1e-3;
/// Most eigenproblems.
const MOST_STEPS: usize = 300;
/// Modes that are followed together, and neighbours of theirs on each side that move with them; basis shapes beyond the modes always do.
const TOGETHER: usize = 80;
const NEIGHBOURS: usize = 60;

/// What became of a mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pole {
    /// -Re s / |s|; of two that do not swing the mean of the two over their geometric mean, which is above 1. 0 for a motion that nothing holds.
    pub damping_ratio: f64,
    /// |s| / 2 pi in Hz; of two that do not swing the geometric mean.
    pub frequency_hz: f64,
    /// s in 1/s, with Im s >= 0; of two the faster one.
    pub s: Complex64,
    /// The other one of a mode that does not swing, the slower one.
    pub slower: Option<Complex64>,
    /// Whether all coordinates that are known have a part in it. Of very many modes those far away are left out, which two levels of the mesh do alike: their
    /// difference tells nothing of that.
    pub is_whole: bool,
    /// Whether damping couples it with other coordinates: it is not the solution of its own quadratic equation then.
    pub is_coupled: bool,
}

impl Pole {
    /// Of a motion that nothing holds.
    pub const FREE: Self = Self {
        damping_ratio: 0.0,
        frequency_hz: 0.0,
        s: Complex64::ZERO,
        slower: None,
        is_whole: true,
        is_coupled: false,
    };
    /// Of a mode whose pole was not found: all numbers are NaN. A slower one may be known.
    pub const UNKNOWN: Self = Self {
        damping_ratio: f64::NAN,
        frequency_hz: f64::NAN,
        s: Complex64::new(f64::NAN, f64::NAN),
        slower: None,
        is_whole: false,
        is_coupled: true,
    };

    /// The pole of an eigenvalue with Im s > 0, or of the only one of a mode. One that grows by more than rounding is unknown.
    fn from_single_eigenvalue_or_unknown_if_growing(s: Complex64) -> Self {
        let modulus = s.norm();
        if s.re > PASSIVE * modulus {
            return Self::UNKNOWN;
        }
        let s = Complex64::new(s.re.min(0.0), s.im);
        let damping_ratio = if modulus > 0.0 { -s.re / modulus } else { 0.0 };
        Self { damping_ratio, frequency_hz: modulus / TAU, s, slower: None, is_whole: true, is_coupled: false }
    }

    /// The pole of a mode with two real eigenvalues, which does not oscillate.
    fn from_real_eigenvalue_pair_or_unknown_if_growing(a: Complex64, b: Complex64) -> Self {
        let (faster, slower) = if a.re <= b.re { (a.re, b.re) } else { (b.re, a.re) };
        if slower > 0.0 {
            return Self::UNKNOWN;
        }
        let mean = (faster * slower).sqrt();
        let damping_ratio = if mean > 0.0 { -0.5 * (faster + slower) / mean } else { 0.0 };
        let [s, slower] = [faster, slower].map(Complex64::from);
        Self { damping_ratio, frequency_hz: mean / TAU, s, slower: Some(slower), is_whole: true, is_coupled: false }
    }

    /// The pole without its faster eigenvalue, which was not found: the slower one is left.
    #[must_use]
    pub const fn keep_slower_eigenvalue_and_mark_rest_unknown(self) -> Self {
        Self { slower: self.slower, ..Self::UNKNOWN }
    }

    /// Whether the motion decays before it oscillates.
    #[must_use]
    pub fn is_overdamped_or_nearly(&self) -> bool {
        self.slower.is_some() || -self.s.re > DIES_OUT * self.s.norm()
    }

    /// Whether the pole was found.
    #[must_use]
    pub const fn is_known(&self) -> bool {
        !self.frequency_hz.is_nan()
    }

    /// s in 1/s of the one that swings, or of the two that do not, the faster one first; without those that were not found.
    #[must_use]
    pub fn eigenvalues_without_conjugates(&self) -> Vec<Complex64> {
        [Some(self.s).filter(|s| !s.is_nan()), self.slower].into_iter().flatten().collect()
    }

    /// How far it is from another, relative: of s, or of what two have in common. Infinite where one of them is not known, or not from all
    /// coordinates.
    #[must_use]
    pub fn relative_distance_or_infinity_to(&self, other: &Self) -> f64 {
        if !(self.is_known() && other.is_known() && self.is_whole && other.is_whole) {
            return f64::INFINITY;
        }
        match (self.slower, other.slower) {
            (None, None) => (self.s - other.s).norm() / self.s.norm().max(f64::MIN_POSITIVE),
            (Some(_), Some(_)) => {
                let relative = |a: f64, b: f64| (a - b).abs() / a.abs().max(f64::MIN_POSITIVE);
                relative(self.frequency_hz, other.frequency_hz).max(relative(self.damping_ratio, other.damping_ratio))
            }
            _ => f64::INFINITY,
        }
    }

    /// The pole of a mode by itself, with the viscous damping c, the squared frequency lambda and the structural damping d: s^2 + c s + lambda + j d
    /// = 0.
    #[must_use]
    pub fn from_uncoupled_mode(
        squared_frequency_rad2_per_s2: f64,
        viscous_per_s: f64,
        structural_rad2_per_s2: f64,
    ) -> Self {
        if squared_frequency_rad2_per_s2 == 0.0 {
            return Self::FREE;
        }
        let root = (Complex64::new(
            0.25 * viscous_per_s * viscous_per_s - squared_frequency_rad2_per_s2,
            -structural_rad2_per_s2,
        ))
        .sqrt();
        let (plus, minus) = (-0.5 * viscous_per_s + root, -0.5 * viscous_per_s - root);
        // The slower one without cancellation.
        let slower = Complex64::new(squared_frequency_rad2_per_s2, structural_rad2_per_s2) / minus;
        if 0.25 * viscous_per_s * viscous_per_s > squared_frequency_rad2_per_s2
            && is_numerically_real(minus)
            && is_numerically_real(slower)
        {
            return Self::from_real_eigenvalue_pair_or_unknown_if_growing(minus, slower);
        }
        Self::from_single_eigenvalue_or_unknown_if_growing(if plus.im >= minus.im { plus } else { minus })
    }
}

/// The poles that continue from the first `followed_mode_count` of the undamped modes, the first `mode_count` of a mass-normalised basis of the squared
/// frequencies `lambda` in rad^2/s^2; those are ascending, and what follows them are shapes of loads. `None` if an eigenproblem has no solution.
#[must_use]
pub fn compute_poles_of_followed_modes_if_solvable(
    lambda: &[f64],
    damping: &DampingMatrices,
    mode_count_of_basis: usize,
    followed_mode_count: usize,
) -> Option<Vec<Pole>> {
    let n = lambda.len();
    let alone = |i: usize| {
        Pole::from_uncoupled_mode(lambda[i], damping.viscous[(i, i)].max(0.0), damping.structural[(i, i)].max(0.0))
    };
    if is_nearly_diagonal(&damping.viscous) && is_nearly_diagonal(&damping.structural) {
        return Some((0..followed_mode_count).map(alone).collect());
    }
    let mut found = Vec::with_capacity(followed_mode_count);
    while found.len() < followed_mode_count {
        let (from, to) = (found.len(), (found.len() + TOGETHER).min(followed_mode_count));
        let (first, last) = (from.saturating_sub(NEIGHBOURS), (to + NEIGHBOURS).min(mode_count_of_basis));
        let kept: Vec<usize> = (first..last).chain(mode_count_of_basis..n).collect();
        let part = |matrix: &DMatrix<f64>| matrix.select_rows(&kept).select_columns(&kept);
        let viscous = damping.structured.as_ref().map(|own| ViscousDamping {
            diagonal: own.viscous.select_rows(&kept),
            couplings: own
                .couplings
                .iter()
                .map(|coupling| DampingCoupling { shape: coupling.shape.select_rows(&kept), ..*coupling })
                .collect(),
        });
        let system = PoleTracker::new(
            kept.iter().map(|i| lambda[*i]).collect(),
            part(&damping.viscous),
            part(&damping.structural),
            viscous,
            from - first,
            to - first,
        );
        let is_whole = kept.len() == n;
        let told = |pole: Pole| Pole { is_whole: pole.is_whole && is_whole, is_coupled: pole != Pole::FREE, ..pole };
        found.extend(system.follow_poles_to_full_damping_if_solvable()?.into_iter().map(told));
    }
    Some(found)
}

/// Whether the imaginary part is no more than rounding.
fn is_numerically_real(s: Complex64) -> bool {
    s.im.abs() <= REAL * s.norm()
}

/// Whether the entries off the diagonal are no more than rounding.
fn is_nearly_diagonal(matrix: &DMatrix<f64>) -> bool {
    let n = matrix.nrows();
    let coupled =
        |i: usize, j: usize| matrix[(i, j)].abs() > UNCOUPLED * (matrix[(i, i)] * matrix[(j, j)]).abs().sqrt();
    (0..n).all(|j| (0..j).all(|i| !coupled(i, j)))
}

/// C as a diagonal and what dashpots add: of these little is left in a shape that leaves them at rest, and nothing but rounding of it in a sum over
/// the entries of C.
struct ViscousDamping {
    diagonal: DVector<f64>,
    couplings: Vec<DampingCoupling>,
}

impl ViscousDamping {
    /// The value of x' C x.
    fn evaluate_unconjugated_quadratic_form(&self, x: &DVector<Complex64>) -> Complex64 {
        let own: Complex64 = x.iter().zip(&self.diagonal).map(|(x, c)| x * x * *c).sum();
        let couplings = self.couplings.iter().filter(|coupling| coupling.viscous != 0.0);
        let along = |coupling: &DampingCoupling| x.iter().zip(&coupling.shape).map(|(x, b)| x * *b).sum::<Complex64>();
        own + couplings.map(|coupling| along(coupling).powi(2) * coupling.viscous).sum::<Complex64>()
    }
}

/// Coordinates that move together, of which some modes are followed.
struct PoleTracker {
    lambda: Vec<f64>,
    viscous: DMatrix<f64>,
    structural: DMatrix<f64>,
    /// The same as `viscous`, where it is known in parts.
    viscous_parts: Option<ViscousDamping>,
    /// Whether there is a loss factor anywhere.
    is_lossy: bool,
    from: usize,
    to: usize,
    /// In rad/s.
    sigma: f64,
    /// sqrt(lambda + sigma^2): what coordinates are scaled by.
    scale: DVector<f64>,
}

/// Eigenvalues s and their states (scaled q, s q), of length one, without those of motions that nothing holds. As many as there are coordinates swing or
/// are the faster of two that do not; the slower ones have no part in what is followed.
struct PoleStates {
    s: Vec<Complex64>,
    states: DMatrix<Complex64>,
    is_slower: Vec<bool>,
}

impl PoleTracker {
    fn new(
        lambda: Vec<f64>,
        viscous: DMatrix<f64>,
        structural: DMatrix<f64>,
        viscous_parts: Option<ViscousDamping>,
        from: usize,
        to: usize,
    ) -> Self {
        let followed = lambda.get(from..to).unwrap_or_default();
        let held: Vec<f64> = followed.iter().copied().filter(|own| *own > 0.0).collect();
        let sigma = held.get(held.len() / 2).map_or(1.0, |own| own.sqrt());
        let scale = DVector::from_iterator(lambda.len(), lambda.iter().map(|own| (own + sigma * sigma).sqrt()));
        let is_lossy = structural.iter().any(|entry| *entry != 0.0);
        Self { lambda, viscous, structural, viscous_parts, is_lossy, from, to, sigma, scale }
    }

    /// All eigenvalues with a part `damping_fraction` of the damping; without loss factors those below the real axis are left out.
    fn solve_eigenvalues_with_damping_fraction(&self, damping_fraction: f64) -> Option<PoleStates> {
        let found = if self.is_lossy {
            let matrix = self.build_shift_inverted_state_matrix(damping_fraction, |stiffness, loss| {
                Complex64::new(stiffness, damping_fraction * loss)
            })?;
            faer::Mat::from_fn(matrix.nrows(), matrix.nrows(), |i, j| matrix[(i, j)]).eigen()
        } else {
            let matrix = self.build_shift_inverted_state_matrix(damping_fraction, |stiffness, _| stiffness)?;
            faer::MatRef::from_column_major_slice(matrix.as_slice(), matrix.nrows(), matrix.nrows()).eigen()
        };
        let found = found.ok()?;
        let n = self.lambda.len();
        let size = 2 * n;
        let s: Vec<Complex64> = found.S().column_vector().iter().map(|mu| self.sigma + 1.0 / mu).collect();
        let wanted: Vec<usize> = (0..size)
            .filter(|k| {
                s[*k].re.is_finite() && s[*k].im.is_finite() && (self.is_lossy || s[*k].im > -REAL * s[*k].norm())
            })
            .filter(|k| {
                let square = |i: usize| found.U()[(i, *k)].norm_sqr();
                let moved = |i: &usize| self.lambda[*i] > 0.0;
                let (held, all) = ((0..n).filter(moved).map(square).sum::<f64>(), (0..n).map(square).sum::<f64>());
                s[*k].norm() > AT_REST_RATE * self.sigma || held > AT_REST * all
            })
            .collect();
        let mut states = DMatrix::from_fn(size, wanted.len(), |i, k| found.U()[(i, wanted[k])]);
        for mut state in states.column_iter_mut() {
            let length = state.norm();
            state.unscale_mut(length.max(f64::MIN_POSITIVE));
        }
        let s: Vec<Complex64> = wanted.into_iter().map(|k| s[k]).collect();
        let is_slower =
            s.iter().enumerate().map(|(k, s)| self.is_slower_of_real_pair_or_below_real_axis(*s, &states, k)).collect();
        Some(PoleStates { s, states, is_slower })
    }

    /// Whether an eigenvalue is the slower one of its shape's two, m s^2 + c s + k = 0 with the product k / m. With a loss factor that is the one below
    /// the real axis.
    fn is_slower_of_real_pair_or_below_real_axis(&self, s: Complex64, states: &DMatrix<Complex64>, k: usize) -> bool {
        // Nearer to the axis the sign is rounding: a shape that has no part in the losses, or hardly any.
        if s.im.abs() > REAL * s.norm() {
            return s.im < 0.0;
        }
        let shape = || self.scale.iter().enumerate().map(|(i, scale)| (states[(i, k)] / scale).norm_sqr());
        let (mass, stiffness) =
            (shape().sum::<f64>(), shape().zip(&self.lambda).map(|(own, lambda)| own * lambda).sum::<f64>());
        // Of two that are nearly one either may be followed.
        s.norm_sqr() * mass < stiffness * (1.0 - NEARLY_ONE)
    }

    /// (A - sigma)^-1 over scaled coordinates and their velocities: with P = K + sigma C + sigma^2,
    /// [[-P^-1 (C + sigma), -P^-1], [P^-1 K, -sigma P^-1]].
    fn build_shift_inverted_state_matrix<T: ComplexField<RealField = f64>>(
        &self,
        damping_fraction: f64,
        combine_stiffness_and_loss: impl Fn(f64, f64) -> T,
    ) -> Option<DMatrix<T>> {
        let (n, sigma) = (self.lambda.len(), self.sigma);
        let over = |i: usize, j: usize| 1.0 / (self.scale[i] * self.scale[j]);
        let elastic = DMatrix::from_fn(n, n, |i, j| {
            combine_stiffness_and_loss(if i == j { self.lambda[i] } else { 0.0 }, self.structural[(i, j)])
                .scale(over(i, j))
        });
        let viscous = DMatrix::from_fn(n, n, |i, j| {
            T::from_real((damping_fraction * self.viscous[(i, j)] + if i == j { sigma } else { 0.0 }) * over(i, j))
        });
        let inverse = (&elastic + &viscous * T::from_real(sigma)).try_inverse()?;
        let by_spring = &inverse * &elastic;
        // P^-1 (C + sigma) is what is left: as a product it would lose what a heavy dashpot leaves of the slow motions.
        let by_velocity = (DMatrix::identity(n, n) - &by_spring) * T::from_real(1.0 / sigma);
        let mut out = DMatrix::zeros(2 * n, 2 * n);
        for j in 0..n {
            for i in 0..n {
                let (row, column) = (1.0 / self.scale[i], 1.0 / self.scale[j]);
                out[(i, j)] = -by_velocity[(i, j)].clone();
                out[(i, n + j)] = -inverse[(i, j)].clone().scale(column);
                out[(n + i, j)] = by_spring[(i, j)].clone().scale(row);
                out[(n + i, n + j)] = -inverse[(i, j)].clone().scale(sigma * row * column);
            }
        }
        Some(out)
    }

    /// States of the undamped modes that are followed; among equal modes the mixtures that damping keeps apart.
    fn build_undamped_states_of_followed_modes(&self) -> PoleStates {
        let n = self.lambda.len();
        let omega: Vec<f64> = self.lambda.iter().map(|own| own.sqrt()).collect();
        let mut mixtures = DMatrix::<f64>::identity(n, n);
        let mut first = 0;
        // Those at the ends of what is followed may have equals beyond.
        let end = (self.to + NEIGHBOURS).min(n);
        while first < end {
            let mut last = first + 1;
            while last < end && (self.lambda[last] - self.lambda[first]).abs() <= EQUAL * self.lambda[last] {
                last += 1;
            }
            if last - first > 1 && self.lambda[first] > 0.0 {
                let count = last - first;
                let lost = self.viscous.view((first, first), (count, count)) * omega[first]
                    + self.structural.view((first, first), (count, count));
                let axes = nalgebra::SymmetricEigen::new(0.5 * (&lost + lost.transpose())).eigenvectors;
                mixtures.view_mut((first, first), (count, count)).copy_from(&axes);
            }
            first = last;
        }
        let count = self.to - self.from;
        let mut states = DMatrix::zeros(2 * n, count);
        for k in 0..count {
            for i in 0..n {
                let q = mixtures[(i, self.from + k)];
                states[(i, k)] = Complex64::from(q * self.scale[i]);
                states[(n + i, k)] = Complex64::new(0.0, q * omega[self.from + k]);
            }
            let length = states.column(k).norm();
            states.column_mut(k).unscale_mut(length);
        }
        let s = (self.from..self.to).map(|i| Complex64::new(0.0, omega[i])).collect();
        PoleStates { s, states, is_slower: vec![false; count] }
    }

    /// Follows the modes' poles while damping grows from none to all; `None` if an eigenproblem has no solution.
    fn follow_poles_to_full_damping_if_solvable(&self) -> Option<Vec<Pole>> {
        let mut known = self.build_undamped_states_of_followed_modes();
        let (mut t, mut next) = (0.0, 1.0);
        for _ in 0..MOST_STEPS {
            let all = self.solve_eigenvalues_with_damping_fraction(next)?;
            let (chosen, is_clear) = self.match_states_to_previous_and_tell_if_overlaps_are_large(&known, &all);
            let is_short = next <= LEAST || t > 0.0 && next <= GROWTH.0 * t;
            if !is_clear && !is_short {
                next = if t > 0.0 { t * (next / t).sqrt() } else { next * FIRST };
                continue;
            }
            if next >= 1.0 {
                return Some(self.build_refined_poles_of_chosen_states_with_slower_partners(&chosen, &all));
            }
            for (k, at) in chosen.iter().enumerate() {
                let Some(at) = at else { continue };
                known.s[k] = all.s[*at];
                known.states.set_column(k, &all.states.column(*at));
            }
            // As much further as the step before, and more where that was no trouble.
            let grown = if t > 0.0 { next / t } else { 1.0 / FIRST };
            let growth = if is_clear { grown * grown } else { grown };
            (t, next) = (next, (next * growth.clamp(GROWTH.0, GROWTH.1)).min(1.0));
        }
        // Frequencies are known all the same: which mode has which pole is not.
        let unknown = |own: &f64| if *own > 0.0 { Pole::UNKNOWN } else { Pole::FREE };
        Some(self.lambda.get(self.from..self.to).unwrap_or_default().iter().map(unknown).collect())
    }

    /// Which of the states continue those that are known, and whether that is clear; `None` for motions that nothing holds, which stay at s = 0.
    fn match_states_to_previous_and_tell_if_overlaps_are_large(
        &self,
        known: &PoleStates,
        all: &PoleStates,
    ) -> (Vec<Option<usize>>, bool) {
        let overlap = (known.states.adjoint() * &all.states).map(|own| own.norm_sqr());
        let count = known.s.len();
        let mut chosen = vec![None; count];
        let mut taken = all.is_slower.clone();
        let mut order: Vec<usize> = (0..count).filter(|k| self.lambda[self.from + k] > 0.0).collect();
        let best = |k: usize| overlap.row(k).iter().copied().fold(0.0, f64::max);
        order.sort_by(|a, b| best(*b).total_cmp(&best(*a)));
        let mut is_clear = true;
        for k in order {
            let mut at = None;
            for (j, own) in overlap.row(k).iter().enumerate() {
                if !taken[j] && at.is_none_or(|at: usize| *own > overlap[(k, at)]) {
                    at = Some(j);
                }
            }
            let Some(at) = at else { continue };
            is_clear &= overlap[(k, at)] >= SAME;
            taken[at] = true;
            chosen[k] = Some(at);
        }
        (chosen, is_clear)
    }

    /// The poles of the chosen states, each with the slower one beside it where it does not oscillate.
    fn build_refined_poles_of_chosen_states_with_slower_partners(
        &self,
        chosen: &[Option<usize>],
        all: &PoleStates,
    ) -> Vec<Pole> {
        let mut taken = vec![false; all.s.len()];
        chosen.iter().flatten().for_each(|at| taken[*at] = true);
        let mut out = Vec::with_capacity(chosen.len());
        for (k, at) in chosen.iter().enumerate() {
            let lambda = self.lambda[self.from + k];
            let Some(at) = *at else {
                // A motion that nothing holds stays where it is; any other has lost its state.
                out.push(if lambda > 0.0 { Pole::UNKNOWN } else { Pole::FREE });
                continue;
            };
            let s = self.refine_eigenvalue_by_one_newton_step(all.s[at], &all.states.column(at).into_owned());
            let slower = is_numerically_real(s)
                .then(|| {
                    let is_slower = |j: &usize| all.is_slower[*j] || (all.s[*j] - s).norm() < NEARLY_ONE * s.norm();
                    let free =
                        (0..all.s.len()).filter(|j| is_slower(j) && !taken[*j] && is_numerically_real(all.s[*j]));
                    let misses = |j: &usize| (s.norm() * all.s[*j].norm() / lambda).ln().abs();
                    free.min_by(|a, b| misses(a).total_cmp(&misses(b)))
                })
                .flatten();
            out.push(match slower {
                Some(other) => {
                    taken[other] = true;
                    Pole::from_real_eigenvalue_pair_or_unknown_if_growing(
                        s,
                        self.refine_eigenvalue_by_one_newton_step(all.s[other], &all.states.column(other).into_owned()),
                    )
                }
                None => Pole::from_single_eigenvalue_or_unknown_if_growing(s),
            });
        }
        out
    }

    /// A step of Newton's method on x' (s^2 + s C + K) x = 0, x the eigenvalue's own shape: exact to the square of what that is wrong by.
    fn refine_eigenvalue_by_one_newton_step(&self, s: Complex64, state: &DVector<Complex64>) -> Complex64 {
        let n = self.lambda.len();
        let x = DVector::from_fn(n, |i, _| state[i] / self.scale[i]);
        let times = |matrix: &DMatrix<f64>| -> Complex64 {
            (0..n).map(|j| x[j] * (0..n).map(|i| x[i] * matrix[(i, j)]).sum::<Complex64>()).sum()
        };
        let mass: Complex64 = x.iter().map(|x| x * x).sum();
        let viscous = self
            .viscous_parts
            .as_ref()
            .map_or_else(|| times(&self.viscous), |parts| parts.evaluate_unconjugated_quadratic_form(&x));
        let elastic: Complex64 = x.iter().zip(&self.lambda).map(|(x, lambda)| x * x * *lambda).sum();
        let elastic = elastic + Complex64::I * if self.is_lossy { times(&self.structural) } else { Complex64::ZERO };
        let step = (s * s * mass + s * viscous + elastic) / (2.0 * s * mass + viscous);
        // Where two are equal the step may lead anywhere.
        if step.norm() <= SMALL_STEP * s.norm() { s - step } else { s }
    }
}
