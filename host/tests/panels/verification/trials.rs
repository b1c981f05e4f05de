//! Random touches on random panels: how often prediction and simulation agree, and why they differ where they do.

use era::device::sim::{STEP_S, SimPanel};
use era::model::Accuracy;
use era::model::levels::ReducedLevels;
use era::planner::{PlanTable, TableOptions, Target};
use era::scene::Scene;
use era::scene::random::{RandomSequence, random_scene_text};
use era::verify::{SimulationComparison, VerifyError, compare_plan_with_simulation};

/// A figure of one comparison.
type FigureOf = fn(&SimulationComparison) -> f64;

/// Difference that passes beyond the plan's own error bound.
const ALLOWED: f64 = 0.02;
/// Intensities asked for, as powers of ten of g: from a gentle touch to one that no panel reaches, so that the limits are met.
const INTENSITY_DECADES: (f64, f64) = (-1.5, 1.5);
/// Largest error bound that proves something: a place with a larger bound hardly moves, and agreement within it is no evidence.
const LARGEST_BOUND: f64 = 0.2;
/// Fraction of the gap beyond which the planner's limit is broken: a third, and the few thousandths that the simulation's steps and
/// the rounding of registers add.
const TRAVEL_LIMIT: f64 = 1.005 / 3.0;
/// Fraction of the simulation's step with which outliers are simulated once more.
const FINER: f64 = 8.0;

/// One touch.
#[derive(Debug)]
pub struct Trial {
    /// Scene, touch, place in mm and intensity, for messages.
    pub name: String,
    /// What came of it.
    pub outcome: TrialOutcome,
}

/// What came of a touch.
#[derive(Debug)]
pub enum TrialOutcome {
    /// Both figures, and, if they differ by more than is allowed, why.
    Compared { comparison: Box<SimulationComparison>, reason: Option<String> },
    /// The planner has no plan, or the plan has no steady motion to compare, which it does not claim to have.
    NotCompared(String),
    /// There is a plan that cannot be driven: the device refuses it, or the masses have no steady motion under it.
    Failed(String),
}

/// How a comparison counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Within the plan's error bound and [`ALLOWED`].
    Within,
    /// Not, or a mass has gone further than a plan may take it.
    Outside,
    /// The plan's error bound is above [`LARGEST_BOUND`]: counted apart.
    BoundTooLarge,
}

impl Trial {
    /// The figures, if it was compared.
    pub fn comparison(&self) -> Option<&SimulationComparison> {
        match &self.outcome {
            TrialOutcome::Compared { comparison, .. } => Some(comparison),
            TrialOutcome::NotCompared(_) | TrialOutcome::Failed(_) => None,
        }
    }

    /// Why it does not pass, if it does not.
    pub fn failure_reason(&self) -> Option<&str> {
        match &self.outcome {
            TrialOutcome::Compared { reason, .. } => reason.as_deref(),
            TrialOutcome::Failed(reason) => Some(reason),
            TrialOutcome::NotCompared(_) => None,
        }
    }
}

/// Plans and simulates touches at random places and intensities on one scene of the sequence that begins with `seed`.
pub fn try_scene(seed: u64, scene_number: u64, touches: u32) -> Vec<Trial> {
    let scene = Scene::parse("random", &random_scene_text(seed, scene_number)).unwrap();
    let options = TableOptions::default();
    let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
    let table = PlanTable::from_levels(&scene, levels, options).unwrap();
    let panel = SimPanel::from_plan_table(&table);
    let mut random = RandomSequence::new(seed, !scene_number);
    let mut try_touch = |touch: u32| {
        let x_m = random.next_unit_number() * scene.surface.length_m;
        let y_m = random.next_unit_number() * scene.surface.width_m;
        let intensity_g = random.next_power_of_ten(INTENSITY_DECADES.0, INTENSITY_DECADES.1);
        let target = Target { x_m, y_m, intensity_g: Some(intensity_g) };
        let outcome = match compare_plan_with_simulation(&table, &panel, target) {
            Ok(comparison) => {
                let finer = || {
                    compare_plan_with_simulation(
                        &table,
                        &SimPanel::from_plan_table_with_step(&table, STEP_S / FINER),
                        target,
                    )
                    .ok()
                };
                let reason = (verdict_on(&comparison) == Verdict::Outside).then(|| find_reason(&comparison, finer));
                TrialOutcome::Compared { comparison: Box::new(comparison), reason }
            }
            Err(error @ (VerifyError::NeverSettles | VerifyError::Nothing | VerifyError::Plan(_))) => {
                TrialOutcome::NotCompared(error.to_string())
            }
            Err(error) => TrialOutcome::Failed(error.to_string()),
        };
        let (x_mm, y_mm) = (x_m * 1e3, y_m * 1e3);
        let name =
            format!("scene {scene_number}, touch {touch}, ({x_mm:.1}, {y_mm:.1}) mm, {intensity_g:.3} g asked for");
        Trial { name, outcome }
    };
    (0..touches).map(&mut try_touch).collect()
}

/// Whether the simulated peak is within the plan's error bound and [`ALLOWED`] of the planned one, and no mass has gone beyond a
/// third of its gap.
pub fn verdict_on(comparison: &SimulationComparison) -> Verdict {
    if exceeds_travel_limit(comparison) {
        return Verdict::Outside;
    }
    if comparison.error_bound.is_some_and(|bound| bound > LARGEST_BOUND) {
        return Verdict::BoundTooLarge;
    }
    if comparison.difference.abs() <= allowed_difference(comparison) { Verdict::Within } else { Verdict::Outside }
}

/// Whether a mass has gone beyond a third of its gap, which no plan may do.
pub fn exceeds_travel_limit(comparison: &SimulationComparison) -> bool {
    comparison.simulated_travel() > TRAVEL_LIMIT || comparison.travel.iter().any(|travel| travel.snapped_in)
}

/// Relative difference that passes; a plan without a bound gets none.
fn allowed_difference(comparison: &SimulationComparison) -> f64 {
    comparison.error_bound.unwrap_or(0.0) + ALLOWED
}

/// The reason for a difference, where it can be tested: what was seen in the simulation, or the first effect that brings the
/// prediction within what is allowed.
fn find_reason(comparison: &SimulationComparison, finer: impl FnOnce() -> Option<SimulationComparison>) -> String {
    if let Some(travel) = comparison.travel.iter().find(|travel| travel.snapped_in) {
        return format!("{} snaps in", travel.actuator);
    }
    if exceeds_travel_limit(comparison) {
        return format!("travel of {:.3} of the gap, beyond a third", comparison.simulated_travel());
    }
    let steps = [
        (comparison.rounded_g, "voltages and frequencies as the board's registers round them"),
        (comparison.achieved_g, "the harmonics' motion, which closes the gaps further"),
        (comparison.causal_g, "the viscous damping that stands in for the loss factor in time"),
        (comparison.kept_g, "the modes above 200 kHz, which the simulation leaves out"),
    ];
    let difference_from =
        |predicted_g: f64| (comparison.simulated_g - predicted_g) / predicted_g.max(f64::MIN_POSITIVE);
    let allowed = allowed_difference(comparison);
    if let Some((predicted_g, what)) =
        steps.iter().find(|(predicted_g, _)| difference_from(*predicted_g).abs() <= allowed)
    {
        return format!("{what}: {:+.2} % from the prediction with that", difference_from(*predicted_g) * 100.0);
    }
    // Where a place hardly moves, the error of a step at the place's own frequency is not small beside its motion.
    if let Some(finer) = finer().filter(|finer| finer.difference.abs() <= allowed) {
        return format!("the simulation's own steps: {:+.2} % with an eighth of them", finer.difference * 100.0);
    }
    let left = difference_from(comparison.kept_g).abs() - allowed;
    if comparison.coinciding >= left {
        let percent = comparison.coinciding * 100.0;
        return format!("harmonics, or sums and differences of frequencies, at a drive's own: up to {percent:.2} %");
    }
    if comparison.unsettled >= left {
        return format!("not settled in the longest burst: up to {:.2} % left", comparison.unsettled * 100.0);
    }
    "none of the known ones".into()
}

/// The touches by how they count.
pub struct Tally<'a> {
    pub within: Vec<&'a SimulationComparison>,
    pub outside: Vec<&'a SimulationComparison>,
    /// Whose error bound is too large to prove anything.
    pub apart: Vec<&'a SimulationComparison>,
    /// Plans that cannot be driven.
    pub failed: usize,
}

impl<'a> Tally<'a> {
    /// Counts them.
    pub fn of(trials: &'a [Trial]) -> Self {
        let of = |wanted: Verdict| {
            trials.iter().filter_map(Trial::comparison).filter(|comparison| verdict_on(comparison) == wanted).collect()
        };
        let failed = trials.iter().filter(|trial| matches!(trial.outcome, TrialOutcome::Failed(_))).count();
        Self { within: of(Verdict::Within), outside: of(Verdict::Outside), apart: of(Verdict::BoundTooLarge), failed }
    }

    /// How many there are of which a fraction must be within.
    pub fn count_judged(&self) -> usize {
        self.within.len() + self.outside.len() + self.failed
    }

    /// The tables of the manual (`docs/src/accuracy.md`, "Random panels").
    pub fn print_tables(&self) {
        let judged: Vec<&SimulationComparison> = self.within.iter().chain(&self.outside).copied().collect();
        let passing = |difference: fn(&SimulationComparison) -> f64, limit: fn(&SimulationComparison) -> f64| {
            judged.iter().filter(|comparison| difference(comparison).abs() <= limit(comparison)).count()
        };
        println!("within the bound and 2 %: {} of {}", self.within.len(), self.count_judged());
        println!("within 2 % without any bound: {}", passing(|c| c.difference, |_| ALLOWED));
        println!("target_peak_g within the bound and 2 %: {}", passing(|c| c.linear_difference, allowed_difference));
        let apart_within = self.apart.iter().filter(|c| c.difference.abs() <= ALLOWED).count();
        println!("bound too large: {}, {apart_within} of them within 2 %", self.apart.len());
        let compared = || judged.iter().chain(&self.apart);
        println!(
            "softened_peak_g, and target_peak_g, more than 0.5 % from the figure that is worked out: {}, {} of {}",
            compared().filter(|c| c.plan_difference.abs() > 0.005).count(),
            compared().filter(|c| (c.linear_g / c.achieved_g - 1.0).abs() > 0.005).count(),
            compared().count()
        );
        println!("difference, % of the prediction    median     90 %     95 %     99 %  largest");
        let rows: [(&str, FigureOf); 9] = [
            ("the plan's softened_peak_g", |c| c.difference),
            ("with harmonics, rounded", |c| c.achieved_difference),
            ("and the damping it has in time", |c| c.causal_difference),
            ("the plan's target_peak_g, linear", |c| c.linear_difference),
            ("whole waveform, with softening", |c| c.band_difference),
            ("softened from worked out", |c| c.plan_difference),
            ("error bound", |c| c.error_bound.unwrap_or(f64::NAN)),
            ("travel, % of the gap, predicted", SimulationComparison::predicted_travel),
            ("travel, simulated", SimulationComparison::simulated_travel),
        ];
        for (name, figure_of) in rows {
            let mut figures: Vec<f64> = judged.iter().map(|comparison| figure_of(comparison).abs()).collect();
            figures.retain(|figure| figure.is_finite());
            figures.sort_by(f64::total_cmp);
            let count = figures.len();
            let quantiles = [50, 90, 95, 99, 100].map(|percent| (percent * count).div_ceil(100).max(1) - 1);
            let columns =
                quantiles.map(|place| format!(" {:8.3}", figures.get(place).map_or(f64::NAN, |it| it * 100.0)));
            println!("{name:32} {}", columns.concat());
        }
    }
}
