//! Answers with a bound on their error.
//!
//! The same question is put to elements of order p - 2 and p (and p - 4 where a scene's kind leaves a doubt), whose spaces are
//! contained in each other; [`super::estimator`] makes a bound of the differences. As long as it is above the tolerance, p
//! grows by two up to `MOST_ORDER`, and then the cells shrink. Every tolerance climbs the same way and ends at the first level
//! that meets it, so what a tight one meets a loose one meets, too. Levels beyond the best are forgotten: where rounding has
//! taken over, bounds grow with every step.
//!
//! [`Accuracy::within`] turns it round: the climb goes on as long as the next level, as predicted from the times of those before
//! on this machine, fits in the time.

use super::bound::Bound;
use super::corners::has_singular_corner;
use super::estimator::{Estimator, NOT_SETTLED, POINT_MOMENT, RESPONSE_SAFETY, Rounding, has_point_moment};
use super::fineness::Fineness;
use super::grid::expected_unknowns;
use super::panel::{PanelModel, Parts, fineness};
use super::placement::{has_close_points, is_singular};
use super::{Accuracy, ModelError};
use crate::scene::Scene;
use crate::stop::Stop;
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
pub struct Step {
    /// The mesh.
    pub fineness: Fineness,
    /// What it is made of.
    pub parts: Parts,
    /// Its unknowns.
    pub dofs: usize,
    /// Time for mesh, factors and answer in ms.
    pub elapsed_ms: f64,
    /// Largest bound with this level as the finest; infinite if it is there to be compared with only.
    pub bound: f64,
}

/// An answer, and how wrong it may be.
#[derive(Debug)]
pub struct Bounded<T> {
    /// From the level with the smallest bound.
    pub answer: T,
    /// One for each part of the answer that has its own.
    pub bounds: Vec<Bound>,
    /// The levels, in the order they were asked in.
    pub steps: Vec<Step>,
    /// The level that answered.
    pub model: PanelModel,
}

/// Something that is asked at every level.
pub trait Question {
    /// What comes back.
    type Answer;
    /// What may go wrong.
    type Error: From<ModelError>;

    /// Asks a level.
    ///
    /// # Errors
    /// Those of the model, and the question's own.
    fn ask(&self, model: &PanelModel) -> Result<Self::Answer, Self::Error>;

    /// Asks a level that is there to be compared with only: at least what [`Question::differences`] needs of it.
    ///
    /// # Errors
    /// As [`Question::ask`].
    fn ask_to_compare(&self, model: &PanelModel) -> Result<Self::Answer, Self::Error> {
        self.ask(model)
    }

    /// Relative differences of the parts of `fine` from those of `coarse`; infinite where they cannot be compared. `coarse` may
    /// come from [`Question::ask_to_compare`].
    fn differences(&self, coarse: &Self::Answer, fine: &Self::Answer) -> Vec<f64>;

    /// How many of the `parts`, the first ones, decide how far is climbed; the others are told with what bound comes of it.
    fn deciding(&self, parts: usize) -> usize {
        parts
    }

    /// Of what the answer consists.
    fn values(&self) -> Values;

    /// What each part may be wrong by for reasons that no finer mesh mends; `rounding` is what a frequency's is.
    fn floors(&self, fine: &Self::Answer, rounding: Rounding) -> Vec<f64>;
}

/// What is compared from level to level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Values {
    /// Frequencies, which fall towards the exact ones.
    Frequencies,
    /// Responses, so many that two levels cannot agree on all of them by chance. Errors of frequencies are multiplied by the quality
    /// of the resonances, those of shapes and of what the modes leave out come on top.
    Curves,
    /// A few of them.
    FewResponses,
}

/// Order of the first level whose bound is looked at.
fn first_order(scene: &Scene, accuracy: Accuracy, values: Values) -> usize {
    // Loose enough for order 9: of frequencies, and of responses.
    let (frequencies, responses) = (1e-3, 1e-2);
    if accuracy.time().is_some() {
        FIRST_ORDER_WITHIN
    } else if accuracy.value() >= if values == Values::Frequencies { frequencies } else { responses }
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
pub fn bounded<Q: Question>(
    question: &Q,
    scene: &Scene,
    accuracy: Accuracy,
    max_hz: f64,
) -> Result<Bounded<Q::Answer>, Q::Error> {
    let first = first_order(scene, accuracy, question.values());
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
    ladder.mesh(Rung { order: first, part: 1.0 })?;
    let mut rung = Rung { order: first, part: 1.0 };
    while let Some(next) = ladder.next(rung) {
        // Part of a rung may have failed for want of memory or time; what was found before stands.
        let climbed = if next.part < rung.part { ladder.mesh(next) } else { ladder.climb(next.order, next.part, true) };
        if let Err(error) = climbed {
            if Stop::current().is_asked() {
                return Err(error);
            }
            tracing::warn!("a finer level has no answer, the best before it is given");
            return ladder.finish().ok_or(error);
        }
        rung = next;
    }
    ladder.finish().ok_or_else(|| ModelError::NotConverged { max_hz, vectors: 0 }.into())
}

/// A level's order, and its cells as a part of the usual ones.
#[derive(Clone, Copy)]
struct Rung {
    order: usize,
    part: f64,
}

struct Level<T> {
    model: PanelModel,
    answer: T,
    /// Which step it was.
    step: usize,
}

struct Best {
    /// Which step it was.
    step: usize,
    bounds: Vec<f64>,
    floors: Vec<f64>,
    /// How many of them decide.
    deciding: usize,
}

impl Best {
    fn largest(&self) -> f64 {
        largest(&self.bounds[..self.deciding])
    }

    /// Whether rounding is all, or nearly all, that is left.
    fn is_near_floor(&self, times: f64) -> bool {
        self.bounds.iter().zip(&self.floors).take(self.deciding).all(|(bound, floor)| *bound <= times * floor)
    }
}

struct Ladder<'a, Q: Question> {
    question: &'a Q,
    scene: &'a Scene,
    accuracy: Accuracy,
    max_hz: f64,
    started: Instant,
    /// The last ones on the present mesh, and the best.
    levels: Vec<Level<Q::Answer>>,
    best: Option<Best>,
    steps: Vec<Step>,
}

impl<Q: Question> Ladder<'_, Q> {
    /// The levels of a new mesh up to a rung.
    fn mesh(&mut self, rung: Rung) -> Result<(), Q::Error> {
        let best = self.best.as_ref().map(|best| best.step);
        self.levels.retain(|level| Some(level.step) == best);
        let fineness = fineness(self.scene, rung.order, rung.part, self.max_hz)?;
        let first = self.steps.len();
        if is_doubtful(self.scene, fineness) {
            self.ask(rung.order - 4, rung.part, false)?;
        }
        self.ask(rung.order - 2, rung.part, false)?;
        self.ask(rung.order, rung.part, true)?;
        self.judge(first);
        Ok(())
    }

    /// One level more on the present mesh.
    fn climb(&mut self, order: usize, part: f64, is_finest: bool) -> Result<(), Q::Error> {
        let first = self.steps.len().saturating_sub(2);
        self.ask(order, part, is_finest)?;
        self.judge(first);
        Ok(())
    }

    fn ask(&mut self, order: usize, part: f64, is_finest: bool) -> Result<(), Q::Error> {
        if Stop::current().is_asked() {
            return Err(ModelError::Stopped.into());
        }
        let started = Instant::now();
        let fineness = fineness(self.scene, order, part, self.max_hz)?;
        let model = PanelModel::with_fineness(self.scene, fineness)?;
        let answer = if is_finest { self.question.ask(&model)? } else { self.question.ask_to_compare(&model)? };
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        tracing::debug!(order = fineness.order, dofs = model.dofs(), elapsed_ms, max_hz = self.max_hz, "level");
        let step = self.steps.len();
        self.steps.push(Step { fineness, parts: model.parts(), dofs: model.dofs(), elapsed_ms, bound: f64::INFINITY });
        self.levels.push(Level { model, answer, step });
        Ok(())
    }

    /// The bounds of the last level from those before it, of which `first` is the first on its mesh.
    fn judge(&mut self, first: usize) {
        let mut before = self.levels.iter().rev().filter(|level| level.step >= first);
        let (Some(fine), Some(middle)) = (before.next(), before.next()) else { return };
        let last = self.question.differences(&middle.answer, &fine.answer);
        let earlier = before.next().map(|coarse| self.question.differences(&coarse.answer, &middle.answer));
        let estimator = Estimator::new(self.scene, &fine.model);
        let floors = self.question.floors(&fine.answer, Rounding::new(self.scene, &fine.model));
        // The level before may have had fewer parts to compare.
        let before = |k: usize| earlier.as_ref().map(|earlier| earlier.get(k).copied().unwrap_or(f64::INFINITY));
        let differences: Vec<(Option<f64>, f64)> =
            last.iter().enumerate().map(|(k, last)| (before(k), *last)).collect();
        let responses = |estimate: &dyn Fn(Option<f64>, f64) -> f64| -> Vec<f64> {
            differences.iter().map(|(before, last)| RESPONSE_SAFETY * estimate(*before, *last)).collect()
        };
        let deciding = self.question.deciding(differences.len());
        let estimates = match self.question.values() {
            Values::Frequencies => {
                let (modes, others) = differences.split_at(deciding);
                let others = others.iter().map(|(before, last)| estimator.estimate(*before, *last));
                estimator.estimate_modes(modes).into_iter().chain(others).collect()
            }
            Values::Curves => responses(&|before, last| estimator.estimate_curves(before, last)),
            Values::FewResponses => responses(&|before, last| estimator.estimate_few(before, last)),
        };
        let bounds: Vec<f64> = estimates.iter().zip(&floors).map(|(estimate, floor)| estimate + floor).collect();
        let (step, found) = (fine.step, largest(&bounds[..deciding]));
        if let Some(step) = self.steps.get_mut(step) {
            step.bound = found;
        }
        if self.best.as_ref().is_none_or(|best| found <= best.largest() || !best.largest().is_finite()) {
            self.best = Some(Best { step, bounds, floors, deciding });
        }
        let best = self.best.as_ref().map(|best| best.step);
        let kept = self.steps.len().saturating_sub(2);
        self.levels.retain(|level| level.step >= kept || Some(level.step) == best);
    }

    /// The next rung; `None` where the answer is good enough, or nothing better can be had.
    fn next(&self, rung: Rung) -> Option<Rung> {
        let best = self.best.as_ref()?;
        let last = self.steps.last()?.bound;
        // Nothing to gain where rounding is all that is left, or has begun to grow.
        let is_rounding =
            best.is_near_floor(2.0) || (last > GETTING_WORSE * best.largest() && best.is_near_floor(NEAR_FLOOR));
        if best.largest() <= self.accuracy.value() || is_rounding || has_point_moment(self.scene) {
            return None;
        }
        let next = if rung.order + 2 <= MOST_ORDER {
            Rung { order: rung.order + 2, ..rung }
        } else {
            Rung { order: FIRST_ORDER_TIGHT, part: rung.part * SMALLER }
        };
        let finer = fineness(self.scene, next.order, next.part, self.max_hz).ok()?;
        let unknowns = expected_unknowns(self.scene, finer);
        let most = if best.largest().is_finite() { MOST_UNKNOWNS } else { MOST_UNKNOWNS_UNSETTLED };
        (unknowns <= most && self.has_time(unknowns, next.part < rung.part)).then_some(next)
    }

    /// Whether a level of so many unknowns fits in the time that is left: by the last level's time and the power of the
    /// unknowns that the last two levels grew with. A new mesh begins with two levels.
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    fn has_time(&self, unknowns: usize, is_new_mesh: bool) -> bool {
        let Some(within) = self.accuracy.time() else { return true };
        let [.., before, last] = self.steps.as_slice() else { return true };
        let grown = last.dofs as f64 / before.dofs.max(1) as f64;
        let power = if grown > 1.0 { (last.elapsed_ms / before.elapsed_ms).ln() / grown.ln() } else { GROWTH.1 };
        let more = (unknowns as f64 / last.dofs.max(1) as f64).max(1.0);
        let predicted_ms =
            last.elapsed_ms * more.powf(power.clamp(GROWTH.0, GROWTH.1)) * if is_new_mesh { 2.0 } else { 1.0 };
        self.started.elapsed() + Duration::from_secs_f64(predicted_ms / 1e3) <= within
    }

    /// The best level's answer; `None` if there is none.
    fn finish(mut self) -> Option<Bounded<Q::Answer>> {
        let best = self.best?;
        let at = self.levels.iter().position(|level| level.step == best.step)?;
        let Level { model, answer, .. } = self.levels.swap_remove(at);
        let bound = |bound: f64| match bound {
            _ if has_point_moment(self.scene) => Bound::Unknown(POINT_MOMENT),
            bound if bound.is_finite() => Bound::AtMost(bound),
            _ => Bound::Unknown(NOT_SETTLED),
        };
        Some(Bounded { answer, bounds: best.bounds.into_iter().map(bound).collect(), steps: self.steps, model })
    }
}

fn largest(bounds: &[f64]) -> f64 {
    bounds.iter().copied().fold(0.0, f64::max)
}

/// Whether errors may fall so slowly that two levels do not show it: a third is asked.
fn is_doubtful(scene: &Scene, fineness: Fineness) -> bool {
    has_singular_corner(scene) || is_singular(scene, fineness) || has_close_points(scene, fineness)
}
