//! How strong each actuator has to be once its frequency is chosen: a small convex problem.
//!
//! Minimise sum_i (E_i u_i^2 + P_i u_i), energy elsewhere or electrical power, subject to sum_i h_ti u_i >= a_t for every
//! target t (peaks add, equation 23), sum_i r_ci u_i <= b_c for every limit that actuators share (travel, breakdown in
//! the gap that all of them close, quiet zones, the supply), and 0 <= u_i <= U_i. What cannot be had is cut by one and the
//! same part s < 1 for all targets, the greatest possible.
//!
//! s is a linear programme. The rest is one as well where there is no E; otherwise the dual method of Goldfarb and Idnani
//! (1983), which starts at the unlimited optimum and adds one violated limit after the other. Both give each row's dual variable,
//! what one more unit of it would cost, from which [`crate::choose::search`] knows what no other frequencies can beat.

use crate::choose::linear::Programme;
use crate::scene::MAX_ACTUATORS;

/// Part of a row's size by which it may be violated: rounding.
const FEASIBLE: f64 = 1e-13;
/// Rows that the dual method exchanges at most; the tests count up to 12.
const MOST_EXCHANGES: usize = 200;
/// Part by which a wish that cannot be met is lowered further before the energy is minimised, so that rounding leaves room.
const ROUNDING_MARGIN: f64 = 1e-11;

/// The terms of one actuator at its frequency in the problem of forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorTerms<'a> {
    /// E: mean square elsewhere per N^2; 0 or more.
    pub energy: f64,
    /// P: cost per N; 0 or more.
    pub power: f64,
    /// U: most force in N.
    pub max_force_n: f64,
    /// h: what it adds to each target per N; 0 or more.
    pub gain: &'a [f64],
    /// r: what it adds to each shared limit per N; 0 or more.
    pub load: &'a [f64],
}

/// The answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Allocation {
    /// Force of each actuator in N.
    pub forces_n: [f64; MAX_ACTUATORS],
    /// s: the part of what was wanted that every target gets, at most 1.
    pub met: f64,
    /// What is minimised.
    pub cost: f64,
    /// Dual variables of the cost where all is met, of s otherwise.
    pub duals: DualVariables,
}

/// The dual variables: what one more unit of each row would cost, or add.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DualVariables {
    /// Of each target.
    pub gain: Vec<f64>,
    /// Of each shared limit.
    pub load: Vec<f64>,
}

/// The forces for up to [`MAX_ACTUATORS`] actuators, for the wishes at the targets and the amounts that the shared
/// limits allow.
#[must_use]
pub fn allocate_forces(actuator_terms: &[ActuatorTerms<'_>], wanted: &[f64], limits_per_row: &[f64]) -> Allocation {
    let actuator_terms = &actuator_terms[..actuator_terms.len().min(MAX_ACTUATORS)];
    if let Some(found) = allocate_for_one_target_if_no_shared_limit_binds(actuator_terms, wanted, limits_per_row) {
        return found;
    }
    let reach = find_forces_for_largest_common_wish_fraction(actuator_terms, wanted, limits_per_row);
    let quadratic = actuator_terms.iter().any(|setting| setting.energy > 0.0);
    let met = reach.met;
    if !quadratic {
        return reach;
    }
    let reachable_fraction = if met < 1.0 { met * (1.0 - ROUNDING_MARGIN) } else { 1.0 };
    match find_cheapest_forces_for_wish_fraction(actuator_terms, wanted, limits_per_row, reachable_fraction) {
        Some(found) if met < 1.0 => Allocation { met: reachable_fraction, duals: reach.duals, ..found },
        Some(found) => found,
        None => reach,
    }
}

/// The closed solution for one target if no shared limit binds: the force of each actuator is lambda h / 2E, up to
/// its limit. `None` if it does not apply.
fn allocate_for_one_target_if_no_shared_limit_binds(
    actuator_terms: &[ActuatorTerms<'_>],
    wanted: &[f64],
    limits_per_row: &[f64],
) -> Option<Allocation> {
    let [wanted] = wanted else { return None };
    if actuator_terms.iter().any(|setting| setting.power > 0.0 || setting.energy <= 0.0) {
        return None;
    }
    let gain = |setting: &ActuatorTerms<'_>| setting.gain.first().copied().unwrap_or(0.0);
    let mut limited = [false; MAX_ACTUATORS];
    let lambda = loop {
        // Those at their limit give what they can; the others share the rest.
        let (mut rest, mut slope) = (*wanted, 0.0);
        for (setting, limited) in actuator_terms.iter().zip(&limited) {
            if *limited {
                rest -= gain(setting) * setting.max_force_n;
            } else {
                slope += gain(setting).powi(2) / (2.0 * setting.energy);
            }
        }
        if rest <= 0.0 {
            break 0.0;
        }
        if slope <= 0.0 {
            return None;
        }
        let lambda = rest / slope;
        let mut changed = false;
        for (setting, limited) in actuator_terms.iter().zip(&mut limited) {
            if !*limited && lambda * gain(setting) / (2.0 * setting.energy) > setting.max_force_n {
                *limited = true;
                changed = true;
            }
        }
        if !changed {
            break lambda;
        }
    };
    let mut forces_n = [0.0; MAX_ACTUATORS];
    for ((force, setting), limited) in forces_n.iter_mut().zip(actuator_terms).zip(&limited) {
        *force = if *limited { setting.max_force_n } else { lambda * gain(setting) / (2.0 * setting.energy) };
    }
    let holds = |(row, limit): (usize, &f64)| load_on_shared_limit(actuator_terms, &forces_n, row) <= *limit;
    limits_per_row.iter().enumerate().all(holds).then(|| Allocation {
        forces_n,
        met: 1.0,
        cost: total_allocation_cost(actuator_terms, &forces_n),
        duals: DualVariables { gain: vec![lambda], load: vec![0.0; limits_per_row.len()] },
    })
}

/// What the forces use of one row.
fn load_on_shared_limit(actuator_terms: &[ActuatorTerms<'_>], forces_n: &[f64], row: usize) -> f64 {
    actuator_terms
        .iter()
        .zip(forces_n)
        .map(|(setting, force)| setting.load.get(row).copied().unwrap_or(0.0) * force)
        .sum()
}

/// The cost that is minimised.
fn total_allocation_cost(actuator_terms: &[ActuatorTerms<'_>], forces_n: &[f64]) -> f64 {
    actuator_terms.iter().zip(forces_n).map(|(setting, force)| (setting.energy * force + setting.power) * force).sum()
}

/// The allocation with the largest common fraction s of all wishes, and of those the one with the least P . u.
fn find_forces_for_largest_common_wish_fraction(
    actuator_terms: &[ActuatorTerms<'_>],
    wanted: &[f64],
    limits_per_row: &[f64],
) -> Allocation {
    let p = actuator_terms.len();
    // Variables: each force over its limit, and s; rows of the size of one.
    let mut programme = Programme::new(p + 1);
    let mut scales = Vec::with_capacity(wanted.len() + limits_per_row.len());
    for (row, limit) in limits_per_row.iter().enumerate() {
        let entries = actuator_terms.iter().map(|s| s.load.get(row).copied().unwrap_or(0.0) * s.max_force_n);
        let scale = entries.clone().fold(*limit, f64::max).max(f64::MIN_POSITIVE);
        programme.add_row(entries.map(|entry| entry / scale), limit / scale);
        scales.push(scale);
    }
    for (row, wanted) in wanted.iter().enumerate() {
        let entries = actuator_terms.iter().map(|s| s.gain.get(row).copied().unwrap_or(0.0) * s.max_force_n);
        // A target that wants nothing is met.
        let scale = entries.clone().fold(*wanted, f64::max).max(f64::MIN_POSITIVE);
        programme.add_row(entries.map(|entry| -entry / scale).chain([wanted / scale]), 0.0);
        scales.push(scale);
    }
    for i in 0..=p {
        programme.add_row((0..=p).map(|j| f64::from(u8::from(i == j))), 1.0);
    }
    let first: Vec<f64> = (0..=p).map(|j| f64::from(u8::from(j == p))).collect();
    let second: Vec<f64> = actuator_terms.iter().map(|setting| -setting.power * setting.max_force_n).collect();
    let Some(vertex) = programme.maximise_first_then_second_objective_if_bounded(&first, &second) else {
        return Allocation { forces_n: [0.0; MAX_ACTUATORS], met: 0.0, cost: 0.0, duals: DualVariables::default() };
    };
    let mut forces_n = [0.0; MAX_ACTUATORS];
    for ((force, setting), x) in forces_n.iter_mut().zip(actuator_terms).zip(&vertex.x) {
        *force = x.clamp(0.0, 1.0) * setting.max_force_n;
    }
    let met = vertex.x.last().copied().unwrap_or(0.0).clamp(0.0, 1.0);
    let duals = if met < 1.0 - ROUNDING_MARGIN { &vertex.first } else { &vertex.second };
    let mut duals = duals.iter().zip(&scales).map(|(dual, scale)| dual / scale);
    let load = duals.by_ref().take(limits_per_row.len()).collect();
    let gain = duals.take(wanted.len()).collect();
    let met = if met < 1.0 - ROUNDING_MARGIN { met } else { 1.0 };
    Allocation {
        forces_n,
        met,
        cost: total_allocation_cost(actuator_terms, &forces_n),
        duals: DualVariables { gain, load },
    }
}

/// A row a . x >= b of the quadratic programme, of the size of one.
#[derive(Clone, Copy)]
struct QuadraticRow {
    a: [f64; MAX_ACTUATORS],
    b: f64,
    scale: f64,
}

/// The least cost with every target at the fraction `wish_fraction` of its wish; `None` if rounding leaves nothing feasible.
fn find_cheapest_forces_for_wish_fraction(
    actuator_terms: &[ActuatorTerms<'_>],
    wanted: &[f64],
    limits_per_row: &[f64],
    wish_fraction: f64,
) -> Option<Allocation> {
    let p = actuator_terms.len();
    // Forces over their limits; an actuator without one stays at rest.
    let size = |i: usize| actuator_terms[i].max_force_n.max(f64::MIN_POSITIVE);
    let of = |entry: &dyn Fn(&ActuatorTerms<'_>) -> f64| {
        let mut a = [0.0; MAX_ACTUATORS];
        for i in 0..p {
            a[i] = entry(&actuator_terms[i]) * size(i);
        }
        a
    };
    let mut rows: Vec<QuadraticRow> = Vec::with_capacity(wanted.len() + limits_per_row.len() + 2 * p);
    let mut add = |a: [f64; MAX_ACTUATORS], b: f64, sign: f64| {
        let scale = a.iter().fold(b.abs(), |most, a| most.max(a.abs())).max(f64::MIN_POSITIVE);
        rows.push(QuadraticRow { a: a.map(|a| sign * a / scale), b: sign * b / scale, scale });
    };
    for (t, wanted) in wanted.iter().enumerate() {
        add(of(&|s| s.gain.get(t).copied().unwrap_or(0.0)), wish_fraction * wanted, 1.0);
    }
    for (c, limit) in limits_per_row.iter().enumerate() {
        add(of(&|s| s.load.get(c).copied().unwrap_or(0.0)), *limit, -1.0);
    }
    for i in 0..p {
        let mut unit = [0.0; MAX_ACTUATORS];
        unit[i] = 1.0;
        add(unit, 1.0, -1.0);
        add(unit, 0.0, 1.0);
    }
    // The cost in units of the largest E U^2, so that its rows are of the size of one as well.
    let mut d = [0.0; MAX_ACTUATORS];
    let mut c = [0.0; MAX_ACTUATORS];
    for i in 0..p {
        d[i] = 2.0 * actuator_terms[i].energy * size(i) * size(i);
        c[i] = actuator_terms[i].power * size(i);
    }
    let unit = d.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    for i in 0..p {
        d[i] = (d[i] / unit).max(1e-14);
        c[i] /= unit;
    }
    let (x, multipliers) = solve_quadratic_program_if_feasible(p, &d, &c, &rows)?;
    let mut forces_n = [0.0; MAX_ACTUATORS];
    for i in 0..p {
        forces_n[i] = x[i].clamp(0.0, 1.0) * actuator_terms[i].max_force_n;
    }
    let mut duals = DualVariables { gain: vec![0.0; wanted.len()], load: vec![0.0; limits_per_row.len()] };
    for (row, multiplier) in multipliers {
        let dual = multiplier * unit / rows[row].scale;
        if let Some(gain) = duals.gain.get_mut(row) {
            *gain = dual;
        } else if let Some(load) = duals.load.get_mut(row - wanted.len()) {
            *load = dual;
        }
    }
    Some(Allocation { forces_n, met: 1.0, cost: total_allocation_cost(actuator_terms, &forces_n), duals })
}

/// Rows that bind, with their multipliers.
type ActiveRows = Vec<(usize, f64)>;

/// Minimises x . D x / 2 + c . x subject to the rows: Goldfarb and Idnani. D is diagonal (`quadratic_costs`), c is `linear_costs`, so that the few active rows'
/// equations are solved anew each time instead of updating factors. Returns x and the active rows with their multipliers.
fn solve_quadratic_program_if_feasible(
    actuators: usize,
    quadratic_costs: &[f64; MAX_ACTUATORS],
    linear_costs: &[f64; MAX_ACTUATORS],
    rows: &[QuadraticRow],
) -> Option<([f64; MAX_ACTUATORS], ActiveRows)> {
    let mut x = [0.0; MAX_ACTUATORS];
    for i in 0..actuators {
        x[i] = -linear_costs[i] / quadratic_costs[i];
    }
    let mut active: ActiveRows = Vec::with_capacity(MAX_ACTUATORS + 1);
    let value =
        |row: &QuadraticRow, x: &[f64; MAX_ACTUATORS]| (0..actuators).map(|i| row.a[i] * x[i]).sum::<f64>() - row.b;
    for _ in 0..MOST_EXCHANGES {
        let worst = rows
            .iter()
            .enumerate()
            .filter(|(i, _)| active.iter().all(|(known, _)| known != i))
            .map(|(i, row)| (i, value(row, &x)))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((entering, _)) = worst.filter(|(_, value)| *value < -FEASIBLE) else {
            return Some(recompute_solution_of_active_rows(actuators, quadratic_costs, linear_costs, rows, active, x));
        };
        let mut dual = 0.0;
        for _ in 0..MOST_EXCHANGES {
            let row = &rows[entering];
            // r: how the active multipliers change; z: how x moves, per unit of the entering row's multiplier.
            let right =
                |active: &QuadraticRow| inner_product_divided_by_weights(actuators, quadratic_costs, &active.a, &row.a);
            let r = solve_multipliers_of_active_rows_unless_singular(actuators, quadratic_costs, rows, &active, right)?;
            let mut z = [0.0; MAX_ACTUATORS];
            for i in 0..actuators {
                let held: f64 = active.iter().zip(&r).map(|((k, _), r)| rows[*k].a[i] * r).sum();
                z[i] = (row.a[i] - held) / quadratic_costs[i];
            }
            let slope: f64 = (0..actuators).map(|i| row.a[i] * z[i]).sum();
            let reference: f64 = (0..actuators).map(|i| row.a[i] * row.a[i] / quadratic_costs[i]).sum();
            let blocking = active
                .iter()
                .enumerate()
                .filter(|(j, _)| r[*j] > 1e-14)
                .map(|(j, (_, multiplier))| (j, multiplier / r[j]))
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let full = if active.len() < actuators && slope > 1e-13 * reference {
                -value(row, &x) / slope
            } else {
                f64::INFINITY
            };
            let step = blocking.map_or(full, |(_, step)| step.min(full));
            if !step.is_finite() {
                return None;
            }
            for ((_, multiplier), r) in active.iter_mut().zip(&r) {
                *multiplier -= step * r;
            }
            dual += step;
            if full.is_finite() {
                for i in 0..actuators {
                    x[i] += step * z[i];
                }
            }
            if step >= full {
                active.push((entering, dual));
                break;
            }
            if let Some((j, _)) = blocking {
                active.remove(j);
            }
        }
    }
    None
}

/// Solves x and the multipliers again from the active rows alone, D x + c = N multipliers and N' x = b. Many
/// exchanges make them drift if some actuators cost a million times as much as others.
fn recompute_solution_of_active_rows(
    actuators: usize,
    quadratic_costs: &[f64; MAX_ACTUATORS],
    linear_costs: &[f64; MAX_ACTUATORS],
    rows: &[QuadraticRow],
    mut active: ActiveRows,
    mut x: [f64; MAX_ACTUATORS],
) -> ([f64; MAX_ACTUATORS], ActiveRows) {
    let rest =
        |row: &QuadraticRow, x: &[f64; MAX_ACTUATORS]| row.b - (0..actuators).map(|i| row.a[i] * x[i]).sum::<f64>();
    let mut start = [0.0; MAX_ACTUATORS];
    for i in 0..actuators {
        start[i] = -linear_costs[i] / quadratic_costs[i];
    }
    if let Some(multipliers) =
        solve_multipliers_of_active_rows_unless_singular(actuators, quadratic_costs, rows, &active, |row| {
            rest(row, &start)
        })
    {
        for ((_, multiplier), fresh) in active.iter_mut().zip(multipliers) {
            *multiplier = fresh.max(0.0);
        }
    }
    for _ in 0..2 {
        let Some(r) =
            solve_multipliers_of_active_rows_unless_singular(actuators, quadratic_costs, rows, &active, |row| {
                rest(row, &x)
            })
        else {
            break;
        };
        for ((row, _), r) in active.iter().zip(&r) {
            for i in 0..actuators {
                x[i] += rows[*row].a[i] * r / quadratic_costs[i];
            }
        }
    }
    (x, active)
}

fn inner_product_divided_by_weights(
    actuators: usize,
    weights: &[f64; MAX_ACTUATORS],
    u: &[f64; MAX_ACTUATORS],
    v: &[f64; MAX_ACTUATORS],
) -> f64 {
    (0..actuators).map(|i| u[i] * v[i] / weights[i]).sum()
}

/// (N' D^-1 N) r = right for the active rows N: at most four equations.
fn solve_multipliers_of_active_rows_unless_singular(
    actuators: usize,
    weights: &[f64; MAX_ACTUATORS],
    rows: &[QuadraticRow],
    active: &[(usize, f64)],
    right_side: impl Fn(&QuadraticRow) -> f64,
) -> Option<[f64; MAX_ACTUATORS]> {
    let m = active.len();
    let mut matrix = [[0.0; MAX_ACTUATORS + 1]; MAX_ACTUATORS];
    for (i, (row, _)) in active.iter().enumerate() {
        for (j, (column, _)) in active.iter().enumerate() {
            matrix[i][j] = inner_product_divided_by_weights(actuators, weights, &rows[*row].a, &rows[*column].a);
        }
        matrix[i][MAX_ACTUATORS] = right_side(&rows[*row]);
    }
    for k in 0..m {
        let pivot = (k..m).max_by(|a, b| matrix[*a][k].abs().total_cmp(&matrix[*b][k].abs()))?;
        if matrix[pivot][k] == 0.0 {
            return None;
        }
        matrix.swap(pivot, k);
        for i in k + 1..m {
            let factor = matrix[i][k] / matrix[k][k];
            for j in (k..m).chain([MAX_ACTUATORS]) {
                matrix[i][j] -= factor * matrix[k][j];
            }
        }
    }
    let mut r = [0.0; MAX_ACTUATORS];
    for k in (0..m).rev() {
        let known: f64 = (k + 1..m).map(|j| matrix[k][j] * r[j]).sum();
        r[k] = (matrix[k][MAX_ACTUATORS] - known) / matrix[k][k];
    }
    Some(r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn without_limits_forces_follow_gain_over_energy() {
        let of = |gain, energy| ActuatorTerms { energy, power: 0.0, max_force_n: 1e9, gain, load: &[] };
        let found = allocate_forces(&[of(&[3.0], 2.0), of(&[1.0], 0.5)], &[10.0], &[]);
        assert!((3.0 * found.forces_n[0] + found.forces_n[1] - 10.0).abs() < 1e-12);
        assert!((found.forces_n[0] / found.forces_n[1] - (3.0 / 2.0) / (1.0 / 0.5)).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_had_is_given_as_far_as_it_goes() {
        let of = |gain, max_force_n| ActuatorTerms { energy: 1.0, power: 0.0, max_force_n, gain, load: &[1.0] };
        let settings = [of(&[1.0], 0.1), of(&[2.0], 0.2)];
        let found = allocate_forces(&settings, &[100.0], &[1.0]);
        assert!((found.forces_n[0] - 0.1).abs() < 1e-9 && (found.forces_n[1] - 0.2).abs() < 1e-9, "{found:?}");
        assert!((found.met - 0.005).abs() < 1e-10);
        assert_eq!(allocate_forces(&settings, &[0.0], &[1.0]).forces_n, [0.0; 4]);
        // A shared limit of 0.15: the second takes all of it.
        let found = allocate_forces(&settings, &[100.0], &[0.15]);
        assert!(found.forces_n[0] < 1e-9 && (found.forces_n[1] - 0.15).abs() < 1e-9, "{found:?}");
    }

    fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    proptest! {
        /// The conditions of Karush, Kuhn and Tucker, which are sufficient: feasible, dual variables at least zero and only where a
        /// row binds, and no better point of the Lagrangian. Checked as strong duality.
        #[test]
        fn cost_equals_its_dual(
            p in 1_usize..=4,
            gains in prop::collection::vec(prop::array::uniform4(0.0_f64..1.0), 4),
            loads in prop::collection::vec(prop::array::uniform6(0.0_f64..1.0), 4),
            energies in prop::array::uniform4(-4.0_f64..1.0),
            powers in prop::array::uniform4(0.0_f64..1.0),
            limits in prop::array::uniform4(0.01_f64..2.0),
            wanted in prop::array::uniform4(0.0_f64..1.0),
            targets in 1_usize..=4,
            allowed in prop::array::uniform6(0.0_f64..2.0),
            kind in 0..3,
        ) {
            let settings: Vec<ActuatorTerms<'_>> = (0..p).map(|i| ActuatorTerms {
                energy: if kind == 0 { 0.0 } else { 10_f64.powf(energies[i]) },
                power: if kind == 1 { 0.0 } else { powers[i] },
                max_force_n: limits[i], gain: &gains[i][..targets], load: &loads[i],
            }).collect();
            let wanted = &wanted[..targets];
            let found = allocate_forces(&settings, wanted, &allowed);
            let u = &found.forces_n;
            for (i, setting) in settings.iter().enumerate() {
                prop_assert!(u[i] >= 0.0 && u[i] <= setting.max_force_n * (1.0 + 1e-12));
            }
            for (t, wanted) in wanted.iter().enumerate() {
                let got: f64 = settings.iter().zip(u).map(|(s, u)| s.gain[t] * u).sum();
                prop_assert!(got >= found.met * wanted - 1e-8, "target {t}: {got} of {wanted}, met {}", found.met);
            }
            for (c, allowed) in allowed.iter().enumerate() {
                prop_assert!(load_on_shared_limit(&settings, u, c) <= allowed + 1e-8);
            }
            let pull = |s: &ActuatorTerms<'_>| dot(&found.duals.gain, s.gain) - dot(&found.duals.load, s.load);
            if found.met < 1.0 {
                // s <= sum duals . allowed + sum max(0, pull) U, with duals . wanted = 1.
                prop_assert!((dot(&found.duals.gain, wanted) - 1.0).abs() < 1e-8);
                let dual = dot(&found.duals.load, &allowed) + settings.iter().map(|s| pull(s).max(0.0) * s.max_force_n).sum::<f64>();
                prop_assert!((dual - found.met).abs() < 1e-8, "{dual} {}", found.met);
            } else {
                let phi = |s: &ActuatorTerms<'_>| {
                    let pull = pull(s) - s.power;
                    if s.energy <= 0.0 { return pull.max(0.0) * s.max_force_n; }
                    let u = (pull / (2.0 * s.energy)).clamp(0.0, s.max_force_n);
                    pull * u - s.energy * u * u
                };
                let dual = dot(&found.duals.gain, wanted) - dot(&found.duals.load, &allowed) - settings.iter().map(phi).sum::<f64>();
                prop_assert!((dual - found.cost).abs() < 1e-8 * found.cost.max(1.0), "{dual} {}", found.cost);
            }
        }
    }
}
