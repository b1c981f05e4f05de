//! From differences of successive levels to a bound on the finest one's error.
//!
//! Levels of order p - 2 and p have spaces that are contained in each other, so that frequencies fall towards the exact ones.
//! If errors fall as a power p^-k, the error of order p is at most d / ((p / (p - 2))^k - 1), d the difference of the two.
//! Errors fall exponentially until the waves are resolved, and then, at the corners and the points that forces act on, as a
//! power; which power is known for each kind of scene (`LEAST_POWER` and the constants below it), how large that part is
//! shows only when the waves are resolved. So d has to be that of two levels that resolve them, order 7 and 9 at least.
//! With a third level the difference before, d', is known, and the bound is at least what a ratio d / d' that stays leaves.
//!
//! This is no theorem. `host/model/tests/numerics/bounds.rs` and `cargo xtask bench model` hold it against finer solutions on random scenes:
//! with orders 7 and 9 the difference is at least 2.6 times the error of order 9, 9 times in the median; with 9 and 11 it is
//! 2.6 and 3.5 times. `host/model/tests/numerics/model_reference.rs` holds bounds against closed references.

use super::attached::all_point_attachments;
use super::bound::Bound;
use super::corners::has_singular_corner;
use super::panel::PanelModel;
use super::placement::{
    has_attachments_with_overlapping_functions, has_singularity_without_function_at_patch_cutout_or_corner,
};
use super::sections::WaveRigidities;
use crate::scene::{Scene, SurfaceDamping, SurfaceKind};

/// Times the estimate.
const SAFETY: f64 = 1.75;
/// Largest ratio of differences that is believed to stay.
const LARGEST_RATIO: f64 = 0.7;
/// The same where errors fall with the square of the order: from 9, 11 and 13 the ratio is 0.57, from 13, 15 and 17 it is 0.69.
const LARGEST_RATIO_SINGULAR: f64 = 0.8;
/// Least ratio of differences that is believed of a single value (a frequency, or a few responses), where errors fall in steps: it may hardly change
/// from one order to the next, and be off by six times as much. (Beside a bezel two levels agreed to 1/40 of the difference before; a mode's error was
/// 9e-6, 1.2e-6, 1.0e-6 and 4e-7 with orders 9 to 15.) With the fourth power of the order, as was measured, order 9 is wrong by 0.13 of the difference
/// of 5 and 7, order 11 by 0.26 of that of 7 and 9; with this and the factors above the bound is 0.21 and 0.28 of it at least.
/// A few responses do without where there are neither patches nor cut-outs: they are sums over modes, of which few are in such a step at once.
const LEAST_RATIO_IN_STEPS: f64 = 0.07;
/// The same of curves where points are nearer to each other than their functions reach: on one mesh they settle at what these functions leave
/// (differences of 3.2e-3 and 3.7e-4, and an error of 5.8e-3).
const LEAST_RATIO_AT_CLOSE_POINTS: f64 = 0.25;
/// Part of the worst mode's estimate that each other mode's is at least, where errors fall in steps: one mode may do so for three orders.
const LEAST_OF_WORST: f64 = 0.1;
/// Largest difference that is taken for small: beyond it nothing has been resolved.
const SMALL: f64 = 0.3;
/// Errors fall at least as this power of the order: at corners of free edges they do (measured on the free square: 7 to 9; on
/// random scenes 4.7 and more).
const LEAST_POWER: f64 = 5.0;
/// The same of plates with functions of point forces, in steps. What these functions leave to the elements begins with r^6 log r, and images behind
/// borders that they lack come next: errors fall exponentially at first, and then as new orders take up the one or the other. Between two orders
/// they were seen to fall with a power of 2.2 only, and with 15 in the two before (80 random panels against exact solutions,
/// `tools/crosscheck/checks/sealed.py`, with and without sealed air).
const LEAST_POWER_AT_POINTS: f64 = 2.0;
/// The same where points are nearer to each other than their functions reach: what these leave hardly falls from order to order, and all at once on a
/// finer mesh (7.7e-6, 6.6e-6 and then 5.5e-7 of a frequency; 6.2e-3, 5.8e-3 and then 3.2e-5 of a response).
const LEAST_POWER_AT_CLOSE_POINTS: f64 = 1.0;
/// The same with corners between clamped and free edges: cells shrink towards them, but no further beyond order 7 (measured: 2.1
/// and more, on a cantilever with a heavy mass on its free edge).
const LEAST_POWER_CORNER: f64 = 2.0;
/// The same at patches and cut-outs, and with attachments beside a corner (measured there: 4 and more).
const LEAST_POWER_SINGULAR: f64 = 2.0;
/// The same of responses where damping is the same ratio on every mode: it acts outside the span of the shapes kept, of which
/// there are more at higher orders.
const LEAST_POWER_MODAL: f64 = 2.0;
/// Relative error of a frequency by rounding on a regular mesh.
const ROUNDING: f64 = 2e-10;
/// Rounding in the entries of K on thin cells, per cube of the panel's side over the least cell.
const ROUNDING_PER_ASPECT: f64 = 1e-15;
/// The same with functions of point forces, which cancel with the elements' where a stiff support holds the point: up to 2e-5
/// was seen at an aspect of 512, 2e-7 at 128.
const ROUNDING_PER_ASPECT_AT_POINTS: f64 = 2e-13;

/// Why no bound exists for plates with rotational point springs.
pub(super) const POINT_MOMENT: &str = "plate theory puts no limit on the slope at a point, so the effect of a \
    rotational spring at a point does not converge on finer meshes";
/// Why there is none where the levels do not agree.
pub(super) const NOT_SETTLED: &str =
    "the results of the finest meshes still differ too much: choose a larger tolerance or a lower frequency";
/// The same of what stands still, in which no frequency has part.
const NOT_SETTLED_AT_REST: &str = "the results of the finest meshes still differ too much: choose another tolerance";
/// A deflection under one point load converges more slowly than the curves' peaks that bounds are made for: 3.2 times their bound was
/// seen.
const SLOWER: f64 = 6.0;
/// Times [`SLOWER`], the difference of levels below which a steady deflection is settled, whether or not it was less before.
const SETTLED: f64 = 1e-3;

/// Whether a rotational spring acts on a point of a plate: frequencies then have no limit.
pub(super) fn has_rotational_point_spring_on_plate(scene: &Scene) -> bool {
    scene.surface.kind == SurfaceKind::Plate
        && all_point_attachments(scene).any(|attached| attached.turning_n_m_per_rad > 0.0)
}

/// Relative error of a frequency by rounding, and by what is the same on every mesh.
#[derive(Clone, Copy, Debug)]
pub struct FrequencyRounding {
    /// On a regular mesh.
    regular: f64,
    /// What thin cells add for a mode that bends the panel.
    thin: f64,
    /// About the frequency of the slowest such mode.
    bending_hz: f64,
    /// What no mesh resolves at attachments.
    unresolved: f64,
}

impl FrequencyRounding {
    pub(super) fn new(scene: &Scene, model: &PanelModel) -> Self {
        let length = scene.surface.length_m.max(scene.surface.width_m);
        // The cantilever's first mode, the slowest that `thin` was measured on: (k L)^2 = 3.52.
        let bending_hz = 3.52 / (length * length)
            * WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene).mean.sqrt()
            / std::f64::consts::TAU;
        let per_aspect = if model.count_cells_point_functions_stiff_points_and_known_modes().stiff_points > 0 {
            ROUNDING_PER_ASPECT_AT_POINTS
        } else {
            ROUNDING_PER_ASPECT
        };
        Self {
            regular: ROUNDING,
            thin: per_aspect * model.effective_mesh_aspect_for_rounding().powi(3),
            bending_hz,
            unresolved: model.relative_frequency_error_independent_of_mesh(),
        }
    }

    /// Relative error of a frequency by rounding and by what no mesh resolves. What K is wrong by is a part of the panel's stiffness, and more of a soft spring's.
    #[must_use]
    pub fn relative_frequency_error_no_finer_mesh_removes_at(&self, frequency_hz: f64) -> f64 {
        self.unresolved + self.regular + self.thin * (self.bending_hz / frequency_hz).powi(2).max(1.0)
    }

    /// Relative error of the frequencies of modes that bend the panel.
    #[must_use]
    pub fn relative_frequency_error_of_bending_modes_no_finer_mesh_removes(&self) -> f64 {
        self.unresolved + self.regular + self.thin
    }
}

/// What a scene's and a mesh's kind says about how fast differences shrink.
#[derive(Clone, Copy, Debug)]
pub struct ErrorEstimator {
    order: usize,
    /// Least power that errors fall with.
    power: f64,
    /// The same of responses.
    response_power: f64,
    /// Largest ratio of successive differences that is believed.
    largest_ratio: f64,
    /// Whether errors of one mode fall in steps.
    modes_in_steps: bool,
    /// Least ratio of differences that is believed of a few responses.
    least_ratio_of_few: f64,
    /// The same of curves.
    least_ratio_of_curves: f64,
    /// Whether a larger one may be more than chance, as the power is not known.
    may_stall: bool,
    /// Relative error of a frequency by rounding.
    rounding: f64,
    has_point_moment: bool,
}

impl ErrorEstimator {
    pub(super) fn new(scene: &Scene, model: &PanelModel) -> Self {
        // What the mesh has no functions for: patches, cut-outs, attachments beside a corner.
        let singular = has_singularity_without_function_at_patch_cutout_or_corner(scene, model.fineness());
        let has_points = model.count_cells_point_functions_stiff_points_and_known_modes().point_functions > 0;
        let has_close_points = has_attachments_with_overlapping_functions(scene, model.fineness());
        let power = if has_points && has_close_points {
            LEAST_POWER_AT_CLOSE_POINTS
        } else if singular {
            LEAST_POWER_SINGULAR
        } else if has_singular_corner(scene) {
            LEAST_POWER_CORNER
        } else if has_points {
            LEAST_POWER_AT_POINTS
        } else {
            LEAST_POWER
        };
        let is_modal = matches!(scene.surface.damping, SurfaceDamping::ModalRatio(_));
        Self {
            order: model.fineness().order,
            power,
            response_power: if is_modal { power.min(LEAST_POWER_MODAL) } else { power },
            largest_ratio: if singular { LARGEST_RATIO_SINGULAR } else { LARGEST_RATIO },
            modes_in_steps: singular || has_points,
            least_ratio_of_few: if singular { LEAST_RATIO_IN_STEPS } else { 0.0 },
            least_ratio_of_curves: if has_close_points { LEAST_RATIO_AT_CLOSE_POINTS } else { 0.0 },
            may_stall: has_close_points,
            rounding: FrequencyRounding::new(scene, model)
                .relative_frequency_error_of_bending_modes_no_finer_mesh_removes(),
            has_point_moment: has_rotational_point_spring_on_plate(scene),
        }
    }

    /// The bound from the difference of the last two levels and, where it is known, that of the two before; infinite where they
    /// do not shrink.
    pub(super) fn estimate_frequency_error_bound(&self, previous_difference: Option<f64>, last_difference: f64) -> f64 {
        self.estimate_error_bound_for_power_of_element_order(
            self.power,
            previous_difference,
            raise_last_difference_to_least_plausible(
                if self.modes_in_steps { LEAST_RATIO_IN_STEPS } else { 0.0 },
                previous_difference,
                last_difference,
            ),
        )
    }

    /// Error bounds of all modes, each from its previous and its last difference.
    pub(super) fn estimate_mode_error_bounds(&self, differences: &[(Option<f64>, f64)]) -> Vec<f64> {
        let own: Vec<f64> =
            differences.iter().map(|(before, last)| self.estimate_frequency_error_bound(*before, *last)).collect();
        let worst = own.iter().copied().filter(|own| own.is_finite()).fold(0.0, f64::max);
        let least = if self.modes_in_steps { LEAST_OF_WORST * worst } else { 0.0 };
        // A rigid motion's is nothing.
        own.into_iter().map(|own| if own > 0.0 { own.max(least) } else { own }).collect()
    }

    /// Error bound of curves of responses, without [`RESPONSE_SAFETY`].
    pub(super) fn estimate_curve_error_bound_without_safety_factor(
        &self,
        previous_difference: Option<f64>,
        last_difference: f64,
    ) -> f64 {
        self.estimate_error_bound_for_power_of_element_order(
            self.response_power,
            previous_difference,
            raise_last_difference_to_least_plausible(self.least_ratio_of_curves, previous_difference, last_difference),
        )
    }

    /// Error bound of a few responses, on which two levels may agree by chance.
    pub(super) fn estimate_few_responses_error_bound_without_safety_factor(
        &self,
        previous_difference: Option<f64>,
        last_difference: f64,
    ) -> f64 {
        self.estimate_error_bound_for_power_of_element_order(
            self.response_power,
            previous_difference,
            raise_last_difference_to_least_plausible(self.least_ratio_of_few, previous_difference, last_difference),
        )
    }

    /// Error bound if errors fall with this power of the element order; infinite where differences do not shrink.
    fn estimate_error_bound_for_power_of_element_order(
        &self,
        power: f64,
        previous_difference: Option<f64>,
        last_difference: f64,
    ) -> f64 {
        if last_difference == 0.0 {
            return 0.0;
        }
        if last_difference.is_nan() || last_difference > SMALL {
            return f64::INFINITY;
        }
        let ratio = match previous_difference {
            Some(previous_difference) if previous_difference.is_finite() && previous_difference > 0.0 => {
                last_difference / previous_difference
            }
            _ => 0.0,
        };
        let ratio = if ratio > self.largest_ratio {
            // By rounding, or by chance: a response's differences are those of several modes, which may cancel for once. Where
            // the power is known they have to shrink all the same.
            if self.may_stall && last_difference > self.rounding {
                return f64::INFINITY;
            }
            self.largest_ratio
        } else {
            ratio
        };
        SAFETY * last_difference * self.remaining_error_over_last_difference(power).max(ratio / (1.0 - ratio))
    }

    /// Error of order p over the difference from order p - 2, if errors fall as this power of the order.
    #[expect(clippy::cast_precision_loss, reason = "orders are small")]
    fn remaining_error_over_last_difference(&self, power: f64) -> f64 {
        let p = self.order as f64;
        1.0 / ((p / (p - 2.0)).powf(power) - 1.0)
    }

    /// The bound of a response from the relative differences of the two coarser levels and of the two finer ones.
    #[must_use]
    pub fn response_error_bound_from_relative_differences(
        &self,
        previous_difference: f64,
        last_difference: f64,
    ) -> Bound {
        match RESPONSE_SAFETY
            * self.estimate_few_responses_error_bound_without_safety_factor(Some(previous_difference), last_difference)
            + SHARPEST * self.rounding
        {
            _ if self.has_point_moment => Bound::Unknown(POINT_MOMENT),
            bound if bound.is_finite() => Bound::AtMost(bound),
            _ => Bound::Unknown(NOT_SETTLED),
        }
    }
}

impl ErrorEstimator {
    /// The bound of a steady deflection from the relative differences of the two coarser levels and of the two finer ones.
    ///
    /// Where they no longer shrink, by rounding beside heavy masses or at points near to each other, the larger one counts as the last: what is left is
    /// settled to that, and may be wrong by as much as errors fall no faster from there.
    #[must_use]
    pub fn steady_deflection_error_bound_from_relative_differences(
        &self,
        previous_difference: f64,
        last_difference: f64,
    ) -> Bound {
        let (previous_difference, last_difference) = (SLOWER * previous_difference, SLOWER * last_difference);
        let is_stalled = last_difference > self.largest_ratio * previous_difference;
        let largest = previous_difference.max(last_difference);
        match self.response_error_bound_from_relative_differences(previous_difference, last_difference) {
            _ if is_stalled && !self.has_point_moment && largest <= SETTLED => {
                self.response_error_bound_from_relative_differences(largest / self.largest_ratio, largest)
            }
            Bound::Unknown(NOT_SETTLED) => Bound::Unknown(NOT_SETTLED_AT_REST),
            bound => bound,
        }
    }
}

/// The last difference, or what is believed at least of it after the one before.
fn raise_last_difference_to_least_plausible(
    least_ratio: f64,
    previous_difference: Option<f64>,
    last_difference: f64,
) -> f64 {
    let previous_difference = previous_difference.filter(|previous_difference| previous_difference.is_finite());
    let least = previous_difference.map_or(0.0, |previous_difference| least_ratio * previous_difference.min(SMALL));
    if last_difference < least { least } else { last_difference }
}

/// Factor on the bound of a response: it has errors of shapes, frequencies and truncation, which need not shrink together.
pub const RESPONSE_SAFETY: f64 = 1.15;

/// Error of a response, relative to its peak, over that of the frequencies by rounding: what the sharpest resonance that
/// anyone has (a quality of a thousand) makes of it.
pub const SHARPEST: f64 = 500.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn of(order: usize, may_stall: bool) -> ErrorEstimator {
        ErrorEstimator {
            order,
            power: LEAST_POWER,
            response_power: LEAST_POWER,
            largest_ratio: LARGEST_RATIO,
            modes_in_steps: false,
            least_ratio_of_few: 0.0,
            least_ratio_of_curves: 0.0,
            may_stall,
            rounding: ROUNDING,
            has_point_moment: false,
        }
    }

    #[test]
    fn estimates_bound_geometric_and_algebraic_convergence() {
        // Errors q^p: the ratio of differences over two orders is q^2.
        for q in [0.01_f64, 0.2, 0.5, 0.8] {
            let error = |p: i32| q.powi(p);
            let bound = of(9, true).estimate_frequency_error_bound(Some(error(5) - error(7)), error(7) - error(9));
            assert!(bound >= error(9), "{q}");
        }
        // Errors p^-k, without and with the level before.
        for k in [5, 6, 8, 12] {
            let error = |p: f64| p.powi(-k);
            let last = error(7.0) - error(9.0);
            for before in [None, Some(error(5.0) - error(7.0))] {
                let bound = of(9, true).estimate_frequency_error_bound(before, last);
                assert!(bound >= error(9.0) && bound < 20.0 * error(9.0), "{k}: {bound:e} {:e}", error(9.0));
            }
        }
    }

    /// Of 1e-2 and 1e-5 in succession the second is taken for chance where errors fall in steps, and for a fact elsewhere.
    #[test]
    fn what_shrinks_at_once_is_not_believed_where_errors_fall_in_steps() {
        let regular = of(9, false).estimate_few_responses_error_bound_without_safety_factor(Some(1e-2), 1e-5);
        let in_steps =
            ErrorEstimator { modes_in_steps: true, least_ratio_of_few: LEAST_RATIO_IN_STEPS, ..of(9, false) };
        assert!(in_steps.estimate_few_responses_error_bound_without_safety_factor(Some(1e-2), 1e-5) > 10.0 * regular);
        assert!(in_steps.estimate_frequency_error_bound(Some(1e-2), 1e-5) > 10.0 * regular);
        assert!(in_steps.estimate_few_responses_error_bound_without_safety_factor(Some(1e-2), f64::NAN).is_infinite());
    }

    /// A rigid motion, one that is all but settled and the worst one.
    #[test]
    fn no_mode_is_far_better_than_the_worst_where_errors_fall_in_steps() {
        let differences = [(None, 0.0), (None, 1e-9), (None, 1e-5), (None, f64::INFINITY)];
        let [regular, in_steps] = [false, true].map(|modes_in_steps| {
            ErrorEstimator { modes_in_steps, ..of(9, false) }.estimate_mode_error_bounds(&differences)
        });
        assert_eq!((regular[0], in_steps[0]), (0.0, 0.0));
        assert!(in_steps[1] == LEAST_OF_WORST * in_steps[2] && regular[1] < 1e-3 * regular[2]);
        assert_eq!((regular[2], regular[3]), (in_steps[2], in_steps[3]));
    }

    /// At rest what is left of small differences is a bound, whichever of the two is larger, and of large ones none.
    #[test]
    fn small_differences_bound_what_stands_still() {
        for may_stall in [false, true] {
            let at_rest = |before, last| {
                of(9, may_stall).steady_deflection_error_bound_from_relative_differences(before, last).limit_if_known()
            };
            let [shrinking, stalled, growing] =
                [(2e-7, 2e-8), (2e-7, 2e-7), (2e-8, 2e-7)].map(|(before, last)| at_rest(before, last).unwrap());
            assert!(shrinking < stalled && stalled <= growing, "{shrinking:e} {stalled:e} {growing:e}");
            assert!(growing > 10.0 * 2e-7 && growing < 1e-4, "{growing:e}");
            assert!(at_rest(1e-2, 9e-2).is_none(), "{may_stall}");
        }
        let reason = of(9, true)
            .steady_deflection_error_bound_from_relative_differences(1e-2, 9e-2)
            .reason_if_unknown()
            .unwrap();
        assert!(!reason.contains("frequency"), "{reason}");
    }

    #[test]
    fn what_does_not_shrink_or_is_not_small_has_no_bound() {
        assert_eq!(of(9, true).estimate_frequency_error_bound(Some(1e-3), 2e-3), f64::INFINITY);
        assert!(of(9, false).estimate_frequency_error_bound(Some(1e-3), 2e-3) > 2e-3);
        assert_eq!(of(9, true).estimate_frequency_error_bound(None, 0.5), f64::INFINITY);
        assert_eq!(of(9, true).estimate_frequency_error_bound(None, f64::NAN), f64::INFINITY);
        assert_eq!(of(9, true).estimate_frequency_error_bound(Some(1e-3), f64::INFINITY), f64::INFINITY);
    }
}
