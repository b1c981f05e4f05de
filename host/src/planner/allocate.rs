//! How strong each actuator has to be once its frequency is chosen: a small convex problem.
//!
//! Minimise sum_i E_i u_i^2 (mean square elsewhere) subject to sum_i h_ti u_i >= a_t for every target t (peaks add,
//! equation 23) and 0 <= u_i <= U_i. Solved by Hildreth's method: the dual is maximised over one target's multiplier at a
//! time, each step exactly, as the constraint is piecewise linear in it. One target is done in one step.

/// Relative change of the multipliers at which the iteration ends.
const TOLERANCE: f64 = 1e-10;
/// Most rounds over the targets.
const ROUNDS: usize = 60;

/// One actuator at its chosen frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice<'a> {
    /// Acceleration per newton at each target, in m/s^2/N.
    pub gain: &'a [f64],
    /// Mean square elsewhere per N^2; more than zero.
    pub energy: f64,
    /// Most force in N.
    pub max_force_n: f64,
}

/// The forces in N, one per actuator. Targets that cannot be had are served as far as the limits go.
#[must_use]
pub fn allocate(choices: &[Choice<'_>], wanted: &[f64]) -> Vec<f64> {
    let mut multipliers = vec![0.0; wanted.len()];
    for _ in 0..ROUNDS {
        let mut change = 0.0_f64;
        for target in 0..wanted.len() {
            let before = multipliers[target];
            multipliers[target] = best_multiplier(choices, &multipliers, target, wanted[target]);
            let scale = before.abs().max(multipliers[target].abs()).max(f64::MIN_POSITIVE);
            change = change.max((multipliers[target] - before).abs() / scale);
        }
        if wanted.len() == 1 || change < TOLERANCE {
            break;
        }
    }
    choices.iter().map(|choice| force(choice, pull(choice, &multipliers))).collect()
}

/// sum_t lambda_t h_t: what the targets together ask of this actuator.
fn pull(choice: &Choice<'_>, multipliers: &[f64]) -> f64 {
    choice.gain.iter().zip(multipliers).map(|(gain, multiplier)| gain * multiplier).sum()
}

fn force(choice: &Choice<'_>, pull: f64) -> f64 {
    (pull / choice.energy).clamp(0.0, choice.max_force_n)
}

/// The least multiplier of `target`, at least 0, at which the target has what it wants; the multiplier at which every
/// actuator that helps is at its limit if that is not enough.
fn best_multiplier(choices: &[Choice<'_>], multipliers: &[f64], target: usize, wanted: f64) -> f64 {
    let gain = |choice: &Choice<'_>| choice.gain.get(target).copied().unwrap_or(0.0);
    let without: Vec<f64> =
        choices.iter().map(|choice| pull(choice, multipliers) - gain(choice) * multipliers[target]).collect();
    let reached = |multiplier: f64| -> f64 {
        choices
            .iter()
            .zip(&without)
            .map(|(choice, rest)| gain(choice) * force(choice, rest + gain(choice) * multiplier))
            .sum()
    };
    // Where an actuator meets its limit the slope changes.
    let mut corners: Vec<f64> = choices
        .iter()
        .zip(&without)
        .filter(|(choice, _)| gain(choice) > 0.0)
        .map(|(choice, rest)| (choice.max_force_n * choice.energy - rest) / gain(choice))
        .filter(|corner| *corner > 0.0 && corner.is_finite())
        .collect();
    corners.sort_by(f64::total_cmp);
    let (mut low, mut at_low) = (0.0, reached(0.0));
    if at_low >= wanted {
        return 0.0;
    }
    for corner in corners {
        let at_corner = reached(corner);
        if at_corner >= wanted {
            return low + (corner - low) * (wanted - at_low) / (at_corner - at_low);
        }
        (low, at_low) = (corner, at_corner);
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn objective(choices: &[Choice<'_>], forces: &[f64]) -> f64 {
        choices.iter().zip(forces).map(|(choice, force)| choice.energy * force * force).sum()
    }

    #[test]
    fn without_limits_forces_follow_gain_over_energy() {
        let choices = [
            Choice { gain: &[3.0], energy: 2.0, max_force_n: 1e9 },
            Choice { gain: &[1.0], energy: 0.5, max_force_n: 1e9 },
        ];
        let forces = allocate(&choices, &[10.0]);
        assert!((3.0 * forces[0] + forces[1] - 10.0).abs() < 1e-12);
        assert!((forces[0] / forces[1] - (3.0 / 2.0) / (1.0 / 0.5)).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_had_is_given_as_far_as_it_goes() {
        let choices = [
            Choice { gain: &[1.0], energy: 1.0, max_force_n: 0.1 },
            Choice { gain: &[2.0], energy: 1.0, max_force_n: 0.2 },
        ];
        assert_eq!(allocate(&choices, &[100.0]), [0.1, 0.2]);
        assert_eq!(allocate(&choices, &[0.0]), [0.0, 0.0]);
    }

    proptest! {
        /// Against a fine search over the feasible box, for one and two targets.
        #[test]
        fn no_feasible_point_is_better(
            gains in prop::array::uniform4(0.05_f64..5.0),
            energies in prop::array::uniform2(0.1_f64..5.0),
            limits in prop::array::uniform2(0.1_f64..2.0),
            wanted in prop::array::uniform2(0.05_f64..2.0),
        ) {
            let (first, second) = ([gains[0], gains[1]], [gains[2], gains[3]]);
            let choices = [
                Choice { gain: &first, energy: energies[0], max_force_n: limits[0] },
                Choice { gain: &second, energy: energies[1], max_force_n: limits[1] },
            ];
            let reaches = |forces: &[f64], target: usize| choices.iter().zip(forces).map(|(c, u)| c.gain[target] * u).sum::<f64>();
            let at_limits = [limits[0], limits[1]];
            prop_assume!((0..2).all(|target| reaches(&at_limits, target) > 1.02 * wanted[target]));
            let forces = allocate(&choices, &wanted);
            for (target, wanted) in wanted.iter().enumerate() {
                prop_assert!(reaches(&forces, target) >= wanted * (1.0 - 1e-6));
            }
            let found = objective(&choices, &forces);
            for i in 0..=60 {
                for j in 0..=60 {
                    let trial = [limits[0] * f64::from(i) / 60.0, limits[1] * f64::from(j) / 60.0];
                    if (0..2).all(|target| reaches(&trial, target) >= wanted[target]) {
                        prop_assert!(found <= objective(&choices, &trial) * (1.0 + 1e-6));
                    }
                }
            }
        }
    }
}
