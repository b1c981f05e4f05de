//! Answers with a bound on their error.
//!
//! The same question is put to elements of order p - 2 and p (and p - 4 where a scene's kind leaves a doubt), whose spaces are
//! contained in each other; [`super::estimator`] makes a bound of the differences. As long as it is above the tolerance, p
//! grows by two up to `MOST_ORDER`, and then the cells shrink. Every tolerance climbs the same way and ends at the first level
//! that meets it, so what a tight one meets a loose one meets, too. Levels beyond the best are forgotten: where rounding has
//! taken over, bounds grow with every step.
//!
//! [`Accuracy::best_within_time`] turns it round: the climb goes on as long as the next level, as predicted from the times of those before
//! on this machine, fits in the time.

use super::bound::Bound;
use super::corners::has_singular_corner;
use super::estimator::{
    ErrorEstimator, FrequencyRounding, NOT_SETTLED, POINT_MOMENT, RESPONSE_SAFETY, has_rotational_point_spring_on_plate,
};
use super::fineness::Fineness;
use super::grid::count_mesh_unknowns_before_edges_and_cutouts;
use super::panel::{MeshCounts, PanelModel, choose_fineness};
use super::placement::{
    has_attachments_with_overlapping_functions, has_singularity_without_function_at_patch_cutout_or_corner,
};
use super::{Accuracy, ModelError};
use crate::scene::Scene;
use crate::stop::StopRequest;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Highest order that is climbed to: with stiff springs on small cells order 15 showed its rounding (1e-2 of a response).
const MOST_ORDER: usize = 13;
/// Order of the first level whose bound is looked at: the two orders compared have to resolve the waves.
const FIRST_ORDER: usize = 9;
/// The same where the tolerance is tight.
const FIRST_ORDER_TIGHT: usize = 11;
/// The same where time is short.
const FIRST_ORDER_WITHIN: usize = 7;
/// Cells shrink to this part when the highest order is not enough.
const SMALLER: f64 = 0.5;
/// Growth of the bound from the best level to a later one that shows rounding, if the best is near what rounding does.
const GETTING_WORSE: f64 = 2.0;
/// How near: a bound above this multiple of its floor is no matter of rounding.
const NEAR_FLOOR: f64 = 100.0;
/// Most unknowns of a level that is tried in order to meet a tolerance.
const MOST_UNKNOWNS: usize = 30_000;
/// The same while no level has had a bound: an undamped resonance has none on any mesh.
const MOST_UNKNOWNS_UNSETTLED: usize = 12_000;
/// Time of a level grows at least, and at most, with this power of its unknowns.
const GROWTH: (f64, f64) = (1.0, 2.5);

/// One level of the ladder, for `--explain`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct RefinementLevel {
    /// The mesh.
    pub fineness: Fineness,
    /// What it is made of.
    pub parts: MeshCounts,
    /// Its unknowns.
    pub dofs: usize,
    /// Time for mesh, factors and answer in ms.
    pub elapsed_ms: f64,
    /// Largest bound with this level as the finest; infinite if it is there to be compared with only.
    pub bound: f64,
}

/// An answer, and how wrong it may be.
#[derive(Debug)]
pub struct BoundedAnswer<T> {
    /// From the level with the smallest bound.
    pub answer: T,
    /// One for each part of the answer that has its own.
    pub bounds: Vec<Bound>,
    /// The levels, in the order they were asked in.
    pub steps: Vec<RefinementLevel>,
    /// The level that answered.
    pub model: PanelModel,
}

/// Something that is asked at every level.
pub trait RefinableQuestion {
    /// What comes back.
    type Answer;
    /// What may go wrong.
    type Error: From<ModelError> + std::fmt::Display;

    /// Answers the question with a model of one level.
    ///
    /// # Errors
    /// Those of the model, and the question's own.
    fn answer_from_model(&self, model: &PanelModel) -> Result<Self::Answer, Self::Error>;

    /// Asks a level that is there to be compared with only: at least what [`RefinableQuestion::relative_difference_of_each_part`] needs of it.
    ///
    /// # Errors
    /// As [`RefinableQuestion::answer_from_model`].
    fn answer_enough_for_comparison(&self, model: &PanelModel) -> Result<Self::Answer, Self::Error> {
        self.answer_from_model(model)
    }

    /// Relative differences of the parts of `fine` from those of `coarse`; infinite where they cannot be compared. `coarse` may
    /// come from [`RefinableQuestion::answer_enough_for_comparison`].
    fn relative_difference_of_each_part(&self, coarse: &Self::Answer, fine: &Self::Answer) -> Vec<f64>;

    /// How many of the `part_count`, the first ones, decide how far is climbed; the others are told with what bound comes of it.
    fn count_leading_parts_that_decide_refinement(&self, part_count: usize) -> usize {
        part_count
    }

    /// The kind of numbers that the answer consists of.
    fn kind_of_compared_values(&self) -> ComparedValues;

    /// What each part may be wrong by for reasons that no finer mesh mends; `rounding` is what a frequency's is.
    fn error_floor_of_each_part(&self, fine: &Self::Answer, rounding: FrequencyRounding) -> Vec<f64>;
}

/// What is compared from level to level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComparedValues {
    /// Frequencies, which fall towards the exact ones.
    Frequencies,
    /// Responses, so many that two levels cannot agree on all of them by chance. Errors of frequencies are multiplied by the quality
    /// of the resonances, those of shapes and of what the modes leave out come on top.
    Curves,
    /// A few of them.
    FewResponses,
}

/// Order of the first level whose bound is looked at.
fn choose_element_order_of_first_bounded_level(scene: &Scene, accuracy: Accuracy, values: ComparedValues) -> usize {
    // Loose enough for order 9: of frequencies, and of responses.
    let (frequencies, responses) = (1e-3, 1e-2);
    if accuracy.time_limit().is_some() {
        FIRST_ORDER_WITHIN
    } else if accuracy.relative_tolerance_or_tightest()
        >= if values == ComparedValues::Frequencies { frequencies } else { responses }
        || has_singular_corner(scene)
    {
        FIRST_ORDER
    } else {
        FIRST_ORDER_TIGHT
    }
}

/// The answer of the first level whose bounds are within the tolerance, or of the best that was tried.
///
/// # Errors
/// [`ModelError`]: a frequency out of range, too many unknowns, matrices that cannot be factored; and the question's own.
pub fn answer_with_error_bounds<Q: RefinableQuestion>(
    question: &Q,
    scene: &Scene,
    accuracy: Accuracy,
    max_hz: f64,
) -> Result<BoundedAnswer<Q::Answer>, Q::Error> {
    let first = choose_element_order_of_first_bounded_level(scene, accuracy, question.kind_of_compared_values());
    let mut ladder = Ladder {
        question,
        scene,
        accuracy,
        max_hz,
        started: Instant::now(),
        levels: Vec::new(),
        best: None,
        steps: Vec::new(),
    };
    ladder.solve_and_bound_first_levels_of_new_mesh(MeshRefinement { order: first, part: 1.0 })?;
    let mut rung = MeshRefinement { order: first, part: 1.0 };
    while let Some(next) = ladder.choose_next_refinement_if_needed_and_affordable(rung) {
        // Part of a rung may have failed for want of memory or time; what was found before stands.
        let climbed = if next.part < rung.part {
            ladder.solve_and_bound_first_levels_of_new_mesh(next)
        } else {
            ladder.solve_and_bound_next_level_on_same_mesh(next.order, next.part, true)
        };
        if let Err(error) = climbed {
            if StopRequest::current_request_of_thread().is_stop_requested_or_deadline_over() {
                return Err(error);
            }
            tracing::warn!(
                %error,
                "a finer mesh could not be computed, so the result is that of the coarser mesh with the smallest error \
                 bound"
            );
            return ladder.into_answer_with_smallest_bound().ok_or(error);
        }
        rung = next;
    }
    ladder.into_answer_with_smallest_bound().ok_or_else(|| ModelError::NotConverged { max_hz, vectors: 0 }.into())
}

/// A level's order, and its cells as a part of the usual ones.
#[derive(Clone, Copy)]
struct MeshRefinement {
    order: usize,
    part: f64,
}

struct AnsweredLevel<T> {
    model: PanelModel,
    answer: T,
    /// Which step it was.
    step: usize,
}

struct BestLevel {
    /// Which step it was.
    step: usize,
    bounds: Vec<f64>,
    floors: Vec<f64>,
    /// How many of them decide.
    deciding: usize,
}

impl BestLevel {
    /// The largest of the bounds that decide how far the mesh is refined.
    fn largest_bound_that_decides_refinement(&self) -> f64 {
        largest_bound_or_zero(&self.bounds[..self.deciding])
    }

    /// Whether every deciding bound is at most this multiple of its error floor: finer meshes gain no more.
    fn are_deciding_bounds_within_factor_of_floors(&self, factor: f64) -> bool {
        self.bounds.iter().zip(&self.floors).take(self.deciding).all(|(bound, floor)| *bound <= factor * floor)
    }
}

struct Ladder<'a, Q: RefinableQuestion> {
    question: &'a Q,
    scene: &'a Scene,
    accuracy: Accuracy,
    max_hz: f64,
    started: Instant,
    /// The last ones on the present mesh, and the best.
    levels: Vec<AnsweredLevel<Q::Answer>>,
    best: Option<BestLevel>,
    steps: Vec<RefinementLevel>,
}

impl<Q: RefinableQuestion> Ladder<'_, Q> {
    /// Solves the first levels of a new mesh, up to the given order.
    fn solve_and_bound_first_levels_of_new_mesh(&mut self, refinement: MeshRefinement) -> Result<(), Q::Error> {
        let best = self.best.as_ref().map(|best| best.step);
        self.levels.retain(|level| Some(level.step) == best);
        let fineness = choose_fineness(self.scene, refinement.order, refinement.part, self.max_hz)?;
        let first = self.steps.len();
        if may_errors_fall_too_slowly_for_two_levels(self.scene, fineness) {
            self.solve_and_record_level(refinement.order - 4, refinement.part, false)?;
        }
        self.solve_and_record_level(refinement.order - 2, refinement.part, false)?;
        self.solve_and_record_level(refinement.order, refinement.part, true)?;
        self.bound_error_of_last_level_update_best_and_drop_old_levels(first);
        Ok(())
    }

    /// Solves one more level on the present mesh.
    fn solve_and_bound_next_level_on_same_mesh(
        &mut self,
        order: usize,
        cell_fraction: f64,
        is_finest: bool,
    ) -> Result<(), Q::Error> {
        let first = self.steps.len().saturating_sub(2);
        self.solve_and_record_level(order, cell_fraction, is_finest)?;
        self.bound_error_of_last_level_update_best_and_drop_old_levels(first);
        Ok(())
    }

    /// Meshes, factors and solves a level, and records what it took.
    fn solve_and_record_level(&mut self, order: usize, cell_fraction: f64, is_finest: bool) -> Result<(), Q::Error> {
        if StopRequest::current_request_of_thread().is_stop_requested_or_deadline_over() {
            return Err(ModelError::Stopped.into());
        }
        let started = Instant::now();
        let fineness = choose_fineness(self.scene, order, cell_fraction, self.max_hz)?;
        let model = PanelModel::build_with_fineness(self.scene, fineness)?;
        let answer = if is_finest {
            self.question.answer_from_model(&model)?
        } else {
            self.question.answer_enough_for_comparison(&model)?
        };
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        tracing::debug!(
            order = fineness.order,
            dofs = model.count_unknowns(),
            elapsed_ms,
            max_hz = self.max_hz,
            "level"
        );
        let step = self.steps.len();
        self.steps.push(RefinementLevel {
            fineness,
            parts: model.count_cells_point_functions_stiff_points_and_known_modes(),
            dofs: model.count_unknowns(),
            elapsed_ms,
            bound: f64::INFINITY,
        });
        self.levels.push(AnsweredLevel { model, answer, step });
        Ok(())
    }

    /// The bounds of the last level from those before it, of which `first_level_of_mesh` is the first on its mesh.
    fn bound_error_of_last_level_update_best_and_drop_old_levels(&mut self, first_level_of_mesh: usize) {
        let mut before = self.levels.iter().rev().filter(|level| level.step >= first_level_of_mesh);
        let (Some(fine), Some(middle)) = (before.next(), before.next()) else { return };
        let last = self.question.relative_difference_of_each_part(&middle.answer, &fine.answer);
        let earlier =
            before.next().map(|coarse| self.question.relative_difference_of_each_part(&coarse.answer, &middle.answer));
        let estimator = ErrorEstimator::new(self.scene, &fine.model);
        let floors =
            self.question.error_floor_of_each_part(&fine.answer, FrequencyRounding::new(self.scene, &fine.model));
        // The level before may have had fewer parts to compare.
        let before = |k: usize| earlier.as_ref().map(|earlier| earlier.get(k).copied().unwrap_or(f64::INFINITY));
        let differences: Vec<(Option<f64>, f64)> =
            last.iter().enumerate().map(|(k, last)| (before(k), *last)).collect();
        let responses = |estimate: &dyn Fn(Option<f64>, f64) -> f64| -> Vec<f64> {
            differences.iter().map(|(before, last)| RESPONSE_SAFETY * estimate(*before, *last)).collect()
        };
        let deciding = self.question.count_leading_parts_that_decide_refinement(differences.len());
        let estimates = match self.question.kind_of_compared_values() {
            ComparedValues::Frequencies => {
                let (modes, others) = differences.split_at(deciding);
                let others =
                    others.iter().map(|(before, last)| estimator.estimate_frequency_error_bound(*before, *last));
                estimator.estimate_mode_error_bounds(modes).into_iter().chain(others).collect()
            }
            ComparedValues::Curves => {
                responses(&|before, last| estimator.estimate_curve_error_bound_without_safety_factor(before, last))
            }
            ComparedValues::FewResponses => responses(&|before, last| {
                estimator.estimate_few_responses_error_bound_without_safety_factor(before, last)
            }),
        };
        let bounds: Vec<f64> = estimates.iter().zip(&floors).map(|(estimate, floor)| estimate + floor).collect();
        let (step, found) = (fine.step, largest_bound_or_zero(&bounds[..deciding]));
        if let Some(step) = self.steps.get_mut(step) {
            step.bound = found;
        }
        if self.best.as_ref().is_none_or(|best| {
            found <= best.largest_bound_that_decides_refinement()
                || !best.largest_bound_that_decides_refinement().is_finite()
        }) {
            self.best = Some(BestLevel { step, bounds, floors, deciding });
        }
        let best = self.best.as_ref().map(|best| best.step);
        let kept = self.steps.len().saturating_sub(2);
        self.levels.retain(|level| level.step >= kept || Some(level.step) == best);
    }

    /// The next rung; `None` where the answer is good enough, or nothing better can be had.
    fn choose_next_refinement_if_needed_and_affordable(&self, current: MeshRefinement) -> Option<MeshRefinement> {
        let best = self.best.as_ref()?;
        let last = self.steps.last()?.bound;
        // Nothing to gain where rounding is all that is left, or has begun to grow.
        let is_rounding = best.are_deciding_bounds_within_factor_of_floors(2.0)
            || (last > GETTING_WORSE * best.largest_bound_that_decides_refinement()
                && best.are_deciding_bounds_within_factor_of_floors(NEAR_FLOOR));
        if best.largest_bound_that_decides_refinement() <= self.accuracy.relative_tolerance_or_tightest()
            || is_rounding
            || has_rotational_point_spring_on_plate(self.scene)
        {
            return None;
        }
        let next = if current.order + 2 <= MOST_ORDER {
            MeshRefinement { order: current.order + 2, ..current }
        } else {
            MeshRefinement { order: FIRST_ORDER_TIGHT, part: current.part * SMALLER }
        };
        let finer = choose_fineness(self.scene, next.order, next.part, self.max_hz).ok()?;
        let unknowns = count_mesh_unknowns_before_edges_and_cutouts(self.scene, finer);
        let most = if best.largest_bound_that_decides_refinement().is_finite() {
            MOST_UNKNOWNS
        } else {
            MOST_UNKNOWNS_UNSETTLED
        };
        (unknowns <= most && self.has_time_for_level(unknowns, next.part < current.part)).then_some(next)
    }

    /// Whether a level of so many unknowns fits in the time that is left: by the last level's time and the power of the
    /// unknowns that the last two levels grew with. A new mesh begins with two levels.
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    fn has_time_for_level(&self, unknowns: usize, is_new_mesh: bool) -> bool {
        let Some(within) = self.accuracy.time_limit() else { return true };
        let [.., before, last] = self.steps.as_slice() else { return true };
        let grown = last.dofs as f64 / before.dofs.max(1) as f64;
        let power = if grown > 1.0 { (last.elapsed_ms / before.elapsed_ms).ln() / grown.ln() } else { GROWTH.1 };
        let more = (unknowns as f64 / last.dofs.max(1) as f64).max(1.0);
        let predicted_ms =
            last.elapsed_ms * more.powf(power.clamp(GROWTH.0, GROWTH.1)) * if is_new_mesh { 2.0 } else { 1.0 };
        self.started.elapsed() + Duration::from_secs_f64(predicted_ms / 1e3) <= within
    }

    /// The answer with the smallest bound; `None` if no level has been solved.
    fn into_answer_with_smallest_bound(mut self) -> Option<BoundedAnswer<Q::Answer>> {
        let best = self.best?;
        let at = self.levels.iter().position(|level| level.step == best.step)?;
        let AnsweredLevel { model, answer, .. } = self.levels.swap_remove(at);
        let bound = |bound: f64| match bound {
            _ if has_rotational_point_spring_on_plate(self.scene) => Bound::Unknown(POINT_MOMENT),
            bound if bound.is_finite() => Bound::AtMost(bound),
            _ => Bound::Unknown(NOT_SETTLED),
        };
        Some(BoundedAnswer { answer, bounds: best.bounds.into_iter().map(bound).collect(), steps: self.steps, model })
    }
}

/// The largest of some bounds; 0 without any.
fn largest_bound_or_zero(bounds: &[f64]) -> f64 {
    bounds.iter().copied().fold(0.0, f64::max)
}

/// Whether errors may fall so slowly that two levels do not show it: a third is asked.
fn may_errors_fall_too_slowly_for_two_levels(scene: &Scene, fineness: Fineness) -> bool {
    has_singular_corner(scene)
        || has_singularity_without_function_at_patch_cutout_or_corner(scene, fineness)
        || has_attachments_with_overlapping_functions(scene, fineness)
}
