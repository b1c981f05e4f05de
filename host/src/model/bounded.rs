//! Answers with a bound on their error.
//!
//! The same question is put to elements of order p - 4, p - 2 and p. Their spaces are contained in each other, so that
//! frequencies fall towards the exact ones, and the differences d' (p - 4 to p - 2) and d (p - 2 to p) shrink by a ratio
//! r = d / d'. If later differences shrink no slower, the error of order p is at most d r / (1 - r). If errors fall as a power
//! p^-k, it is d / ((p / (p - 2))^k - 1): k is taken as 0.4 of what the three levels show, and as 5 at least (2 to 4 where
//! shapes are singular). The larger of the two, times a safety factor of 2.5, is the bound; to which comes what falls with the
//! least power although the three levels do not show it yet, up to a limit, and what rounding can do. Steps of two, as a step
//! of one leaves shapes of one parity as they were.
//!
//! That differences shrink so is not a theorem but what elements of rising order do once they resolve the waves. Of 1382
//! frequencies and 198 responses of random scenes (`host/tests/bounds.rs`), held against solutions a hundred times finer, the
//! power that followed was in 5 % of the cases less than half of the one shown, always where d was small: less than 1.4e-6 of
//! a frequency where nothing is singular. That is what the limits are for. `host/tests/model_reference.rs` holds bounds
//! against closed references.
//!
//! As long as the bound is above the tolerance, p grows by two, and then the cells shrink. Where a bound grows with p,
//! rounding has taken over, and the level before is the answer.

use super::corners::has_singular_corner;
use super::grid::{Fineness, expected_unknowns};
use super::panel::{PanelModel, Parts, fineness};
use super::placement::is_singular;
use super::sections::Waves;
use super::shape::HIGHEST_ORDER;
use super::{Accuracy, ModelError, ReducedModel};
use crate::scene::{Scene, SurfaceKind};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Times the estimate.
const SAFETY: f64 = 2.5;
/// Largest ratio of differences that allows a bound.
const LARGEST_RATIO: f64 = 0.7;
/// Errors fall at least as this power of the order: at corners of free edges they do (measured on the free square: 7 to 9; on
/// random scenes 4.7 and more).
const LEAST_POWER: f64 = 5.0;
/// The same with corners between clamped and free edges, towards which cells shrink (measured: 5.1 and more).
const LEAST_POWER_CORNER: f64 = 4.0;
/// The same at patches and cut-outs, and with attachments beside a corner (measured there: 4 and more).
const LEAST_POWER_SINGULAR: f64 = 2.0;
/// Part of the power that three levels show which is believed of the levels after them; none where shapes are
/// singular in ways of several strengths, which take turns.
const BELIEVED: f64 = 0.4;
/// Highest power that differences can show: r of 1e-9 or so.
const MOST_POWER: f64 = 60.0;
/// Largest difference of frequencies, relative, that may fall with the least power although three levels show a higher one.
const HIDDEN: f64 = 2e-7;
/// The same of responses, relative to the peak: resonances are sharper than frequencies.
pub const HIDDEN_IN_RESPONSES: f64 = 5e-6;
/// Relative error of a frequency by rounding on a regular mesh.
const ROUNDING: f64 = 2e-10;
/// Rounding in the entries of K on thin cells, per cube of the panel's side over the least cell.
const ROUNDING_PER_ASPECT: f64 = 1e-15;
/// The same with functions of point forces, which cancel with the elements' where a stiff support holds the point: up to 2e-5
/// was seen at an aspect of 512, 2e-7 at 128.
const ROUNDING_PER_ASPECT_AT_POINTS: f64 = 2e-13;
/// Cells shrink to this part when the highest order is not enough.
const SMALLER: f64 = 0.5;
/// Growth of the bound from one order to the next that only rounding explains.
const GETTING_WORSE: f64 = 2.0;
/// Most unknowns of a level that is tried in order to meet a tolerance.
const MOST_UNKNOWNS: usize = 8_000;

/// A bound on an error, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// The error is at most this.
    AtMost(f64),
    /// Nothing is known, for this reason.
    Unknown(&'static str),
}

impl Bound {
    /// The number, if there is one.
    #[must_use]
    pub fn value(self) -> Option<f64> {
        match self {
            Bound::AtMost(value) => Some(value),
            Bound::Unknown(_) => None,
        }
    }

    /// Why there is none.
    #[must_use]
    pub fn reason(self) -> Option<&'static str> {
        match self {
            Bound::AtMost(_) => None,
            Bound::Unknown(reason) => Some(reason),
        }
    }
}

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
    /// Largest bound with this level as the finest; infinite if it is among the first two.
    pub bound: f64,
}

/// An answer, and how wrong it may be.
#[derive(Debug)]
pub struct Bounded<T> {
    /// From the finest level.
    pub answer: T,
    /// One for each part of the answer that has its own.
    pub bounds: Vec<Bound>,
    /// The levels, coarsest first.
    pub steps: Vec<Step>,
    /// The finest level.
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

    /// Relative differences of the parts of `fine` from those of `coarse`; infinite where they cannot be compared.
    fn differences(&self, coarse: &Self::Answer, fine: &Self::Answer) -> Vec<f64>;

    /// A factor on the bound, for answers whose errors come together in more ways than a frequency's.
    fn safety(&self) -> f64 {
        1.0
    }

    /// Largest difference that may fall with the least power although three levels show a higher one.
    fn hidden(&self) -> f64 {
        HIDDEN
    }

    /// What each part may be wrong by for reasons that no finer mesh mends; `rounding` is what a frequency's is.
    fn floors(&self, fine: &Self::Answer, rounding: Rounding) -> Vec<f64>;
}

/// Relative error of a frequency by rounding.
#[derive(Clone, Copy, Debug)]
pub struct Rounding {
    /// On a regular mesh.
    regular: f64,
    /// What thin cells add for a mode that bends the panel.
    thin: f64,
    /// About the frequency of the slowest such mode.
    bending_hz: f64,
}

impl Rounding {
    fn new(scene: &Scene, model: &PanelModel) -> Self {
        let length = scene.surface.length_m.max(scene.surface.width_m);
        // The cantilever's first mode, the slowest that `thin` was measured on: (k L)^2 = 3.52.
        let bending_hz = 3.52 / (length * length) * Waves::of(scene).mean.sqrt() / std::f64::consts::TAU;
        let per_aspect =
            if model.parts().point_functions > 0 { ROUNDING_PER_ASPECT_AT_POINTS } else { ROUNDING_PER_ASPECT };
        Self { regular: ROUNDING, thin: per_aspect * model.aspect().powi(3), bending_hz }
    }

    /// Of a frequency. What K is wrong by is a part of the panel's stiffness, and more of a soft spring's.
    #[must_use]
    pub fn of(&self, frequency_hz: f64) -> f64 {
        self.regular + self.thin * (self.bending_hz / frequency_hz).powi(2).max(1.0)
    }

    /// Of modes that bend the panel.
    #[must_use]
    pub fn of_bending(&self) -> f64 {
        self.regular + self.thin
    }
}

/// Why no bound exists for plates with rotational point springs.
const POINT_MOMENT: &str = "a plate turns freely about a point (its slope there is not bounded by its energy), so that a \
    rotational spring at a point has no limit that a finer mesh would approach";
/// Why there is none where the levels do not agree.
const NOT_SETTLED: &str =
    "the finest levels that were tried do not agree yet: ask for a looser tolerance or a lower frequency";

/// The answer of the cheapest level whose bounds are within the tolerance, or of the finest that was tried.
///
/// # Errors
/// [`ModelError`]: a frequency out of range, too many unknowns, matrices that cannot be factored; and the question's own.
pub fn bounded<Q: Question>(
    question: &Q,
    scene: &Scene,
    accuracy: Accuracy,
    max_hz: f64,
) -> Result<Bounded<Q::Answer>, Q::Error> {
    let mut ladder = Ladder { question, scene, max_hz, levels: Vec::new(), steps: Vec::new() };
    let mut part = 1.0;
    let mut order = accuracy.order();
    for below in [order - 4, order - 2, order] {
        ladder.climb(fineness(scene, below, part, max_hz)?)?;
    }
    // Bounds of the level before, on the same mesh.
    let mut before: Option<Vec<f64>> = None;
    loop {
        let (bounds, floors) = ladder.bounds();
        let largest = largest(&bounds);
        if let Some(step) = ladder.steps.last_mut() {
            step.bound = largest;
        }
        if let Some(before) = before.take_if(|before| largest > GETTING_WORSE * self::largest(before)) {
            // Rounding grows with the order and has taken over: the level before was the best.
            ladder.levels.pop();
            return Ok(ladder.finish(before));
        }
        // Nothing to gain where rounding is all that is left.
        let met = largest <= accuracy.value() || bounds.iter().zip(&floors).all(|(bound, floor)| *bound <= 2.0 * floor);
        // Smaller cells do little for what is singular.
        let is_smooth = !has_singular_corner(scene) && !ladder.is_singular();
        let next = if order + 2 <= HIGHEST_ORDER || !is_smooth {
            (order + 2, part)
        } else {
            (accuracy.order(), part * SMALLER)
        };
        let finer = if met || next.0 > HIGHEST_ORDER || has_point_moment(scene) {
            None
        } else {
            fineness(scene, next.0, next.1, max_hz).ok()
        };
        let Some(finer) = finer.filter(|finer| expected_unknowns(scene, *finer) < MOST_UNKNOWNS) else {
            return Ok(ladder.finish(bounds));
        };
        before = Some(bounds).filter(|bounds| self::largest(bounds).is_finite());
        if next.1 < part {
            // A new mesh: its own three orders.
            before = None;
            ladder.levels.clear();
            for below in [next.0 - 4, next.0 - 2] {
                ladder.climb(fineness(scene, below, next.1, max_hz)?)?;
            }
        }
        (order, part) = next;
        ladder.climb(finer)?;
    }
}

fn largest(bounds: &[f64]) -> f64 {
    bounds.iter().copied().fold(0.0, f64::max)
}

fn has_point_moment(scene: &Scene) -> bool {
    scene.surface.kind == SurfaceKind::Plate
        && scene.supports.iter().any(|support| support.rotational_stiffness_n_m_per_rad > 0.0)
}

struct Ladder<'a, Q: Question> {
    question: &'a Q,
    scene: &'a Scene,
    max_hz: f64,
    /// The last three.
    levels: Vec<(PanelModel, Q::Answer)>,
    steps: Vec<Step>,
}

impl<Q: Question> Ladder<'_, Q> {
    fn climb(&mut self, fineness: Fineness) -> Result<(), Q::Error> {
        let started = Instant::now();
        let model = PanelModel::with_fineness(self.scene, fineness)?;
        let answer = self.question.ask(&model)?;
        let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
        tracing::debug!(order = fineness.order, dofs = model.dofs(), elapsed_ms, max_hz = self.max_hz, "level");
        self.steps.push(Step { fineness, parts: model.parts(), dofs: model.dofs(), elapsed_ms, bound: f64::INFINITY });
        self.levels.push((model, answer));
        if self.levels.len() > 3 {
            self.levels.remove(0);
        }
        Ok(())
    }

    fn is_singular(&self) -> bool {
        self.levels.last().is_some_and(|(model, _)| is_singular(self.scene, model.fineness()))
    }

    /// Bounds for the finest of three levels, and the part of them that no finer level mends; infinite where the differences do not shrink.
    fn bounds(&self) -> (Vec<f64>, Vec<f64>) {
        let [(_, first), (_, second), (model, third)] = self.levels.as_slice() else {
            return (vec![f64::INFINITY], vec![0.0]);
        };
        let before = self.question.differences(first, second);
        let last = self.question.differences(second, third);
        let estimator = Estimator::new(self.scene, model);
        let floors = self.question.floors(third, Rounding::new(self.scene, model));
        // The level before may have had fewer parts to compare.
        let before = before.into_iter().chain(std::iter::repeat(f64::INFINITY));
        let bounds = last.iter().zip(before).zip(&floors).map(|((last, before), floor)| {
            self.question.safety() * estimator.estimate(before, *last, self.question.hidden()) + floor
        });
        (bounds.collect(), floors)
    }

    fn finish(mut self, bounds: Vec<f64>) -> Bounded<Q::Answer> {
        let bounds = bounds
            .into_iter()
            .map(|bound| match bound {
                _ if has_point_moment(self.scene) => Bound::Unknown(POINT_MOMENT),
                bound if bound.is_finite() => Bound::AtMost(bound),
                _ => Bound::Unknown(NOT_SETTLED),
            })
            .collect();
        let (model, answer) = self.levels.remove(self.levels.len() - 1);
        Bounded { answer, bounds, steps: self.steps, model }
    }
}

/// What a scene's and a mesh's kind says about how fast differences shrink.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Estimator {
    order: usize,
    /// Least power that errors fall with.
    power: f64,
    /// Part of the power shown that is believed.
    believed: f64,
    /// Relative error of a frequency by rounding.
    rounding: f64,
    has_point_moment: bool,
}

impl Estimator {
    fn new(scene: &Scene, model: &PanelModel) -> Self {
        // What the mesh has no functions for: patches, cut-outs, attachments beside a corner.
        let singular = is_singular(scene, model.fineness());
        Self {
            order: model.fineness().order,
            believed: if singular { 0.0 } else { BELIEVED },
            power: if singular {
                LEAST_POWER_SINGULAR
            } else if has_singular_corner(scene) {
                LEAST_POWER_CORNER
            } else {
                LEAST_POWER
            },
            rounding: Rounding::new(scene, model).of_bending(),
            has_point_moment: has_point_moment(scene),
        }
    }

    /// Whether it can belong to elements of this order.
    pub(super) fn is_plausible(&self, order: usize) -> bool {
        let numbers = [self.power, self.believed, self.rounding];
        self.order == order && numbers.iter().all(|number| number.is_finite() && *number >= 0.0)
    }

    /// The bound from two successive differences, infinite where they do not shrink.
    fn estimate(&self, before: f64, last: f64, hidden: f64) -> f64 {
        if last == 0.0 {
            return 0.0;
        }
        let ratio = if before.is_finite() { last / before } else { LARGEST_RATIO };
        if ratio.is_nan() || ratio > LARGEST_RATIO || !last.is_finite() {
            // Before the waves are resolved differences need not shrink; rounding need not either.
            return if last <= self.rounding { last } else { f64::INFINITY };
        }
        let power = self.power.max(self.believed * self.power_shown(ratio));
        SAFETY * (last * self.rest(power).max(ratio / (1.0 - ratio)) + last.min(hidden) * self.rest(self.power))
    }

    /// Error of order p over the difference from order p - 2, if errors fall as this power of the order.
    #[allow(clippy::cast_precision_loss, reason = "orders are small")]
    fn rest(&self, power: f64) -> f64 {
        let p = self.order as f64;
        1.0 / ((p / (p - 2.0)).powf(power) - 1.0)
    }

    /// The power k of errors p^-k whose differences shrink by `ratio` over the three orders: by bisection, as the ratio falls
    /// with k.
    #[allow(clippy::cast_precision_loss, reason = "orders are small")]
    fn power_shown(&self, ratio: f64) -> f64 {
        let p = self.order as f64;
        // All over the error of the first order.
        let error = |order: f64, power: f64| ((p - 4.0) / order).powf(power);
        let ratio_of = |power: f64| (error(p - 2.0, power) - error(p, power)) / (1.0 - error(p - 2.0, power));
        let (mut low, mut high) = (0.1, MOST_POWER);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if ratio_of(middle) > ratio { low = middle } else { high = middle }
        }
        low
    }

    /// The bound of a response from the relative differences of the two coarser levels and of the two finer ones.
    #[must_use]
    pub fn response_bound(&self, before: f64, last: f64) -> Bound {
        match RESPONSE_SAFETY * self.estimate(before, last, HIDDEN_IN_RESPONSES) + SHARPEST * self.rounding {
            _ if self.has_point_moment => Bound::Unknown(POINT_MOMENT),
            bound if bound.is_finite() => Bound::AtMost(bound),
            _ => Bound::Unknown(NOT_SETTLED),
        }
    }
}

/// Factor on the bound of a response: it has errors of shapes, frequencies and truncation, which need not shrink together.
pub const RESPONSE_SAFETY: f64 = 1.5;

/// Error of a response, relative to its peak, over that of the frequencies by rounding: what the sharpest resonance that
/// anyone has (a quality of a thousand) makes of it.
pub const SHARPEST: f64 = 500.0;

/// Reduced models of three levels, for answers that are asked for over and over.
#[derive(Clone, Debug)]
pub struct Levels {
    /// The finest.
    pub fine: ReducedModel,
    /// The next coarser one, and the one before that.
    pub coarser: [ReducedModel; 2],
    /// What makes a bound of their differences.
    pub estimator: Estimator,
    /// The levels, coarsest first; bounds belong to each answer.
    pub steps: Vec<Step>,
}

impl Levels {
    /// About how many unknowns the finest level has, before anything is built.
    ///
    /// # Errors
    /// As [`bounded`], if the mesh would be too fine.
    #[allow(clippy::cast_precision_loss, reason = "about")]
    pub fn expected_unknowns(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<f64, ModelError> {
        Ok(expected_unknowns(scene, fineness(scene, Self::order(accuracy), 1.0, max_hz)?) as f64)
    }

    /// Levels that meet a tolerance for frequencies up to `max_hz`, unless a panel is hardly damped.
    ///
    /// # Errors
    /// As [`bounded`].
    pub fn build(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Self, ModelError> {
        Self::of_order(scene, Self::order(accuracy), max_hz)
    }

    /// Order of the finest level's elements: one step finer than a first try, as nobody climbs from here.
    pub(super) fn order(accuracy: Accuracy) -> usize {
        accuracy.order() + 2
    }

    /// Levels of elements of `order` (7 and above) and of the orders 2 and 4 below it.
    ///
    /// # Errors
    /// As [`bounded`].
    pub fn of_order(scene: &Scene, order: usize, max_hz: f64) -> Result<Self, ModelError> {
        let mut steps = Vec::new();
        let mut level = |order: usize| -> Result<_, ModelError> {
            let started = Instant::now();
            let fineness = fineness(scene, order, 1.0, max_hz)?;
            let model = PanelModel::with_fineness(scene, fineness)?;
            let reduced = model.reduce(max_hz, &[])?;
            let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
            steps.push(Step { fineness, parts: model.parts(), dofs: model.dofs(), elapsed_ms, bound: f64::INFINITY });
            Ok((Estimator::new(scene, &model), reduced))
        };
        let (_, coarse) = level(order - 4)?;
        let (_, middle) = level(order - 2)?;
        let (estimator, fine) = level(order)?;
        Ok(Self { fine, coarser: [middle, coarse], estimator, steps })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimates_bound_geometric_and_algebraic_convergence() {
        let of = |order| Estimator {
            order,
            power: LEAST_POWER,
            believed: BELIEVED,
            rounding: ROUNDING,
            has_point_moment: false,
        };
        // Errors q^p: the ratio of differences over two orders is q^2.
        for q in [0.01_f64, 0.2, 0.5, 0.8] {
            let error = |p: i32| q.powi(p);
            let bound = of(7).estimate(error(3) - error(5), error(5) - error(7), HIDDEN);
            assert!(bound >= error(7), "{q}");
        }
        // Errors p^-k.
        for k in [6, 8, 12] {
            // Large against what may be hidden.
            let error = |p: f64| 1e9 * p.powi(-k);
            let bound = of(9).estimate(error(5.0) - error(7.0), error(7.0) - error(9.0), HIDDEN);
            assert!(bound >= error(9.0) && bound < 20.0 * error(9.0), "{k}: {bound:e} {:e}", error(9.0));
        }
        assert_eq!(of(7).estimate(1e-3, 2e-3, HIDDEN), f64::INFINITY);
    }
}
