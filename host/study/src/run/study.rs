//! A study, ready to be computed.

use super::fits;
use super::folder::format_hex;
use super::losses::compute_search_loss_of_weighted_wishes_or_only_broken_limits;
use super::row::{DesignOutcome, DesignRow};
use super::task::StudyTask;
use crate::bounds::{StudyBounds, UnusableStudy};
use crate::evaluate::{EvaluateError, Evaluator, Figures, parts};
use crate::methods::{Evolution, KnownPoints, MOST_SOBOL};
use crate::space::{Design, DesignSpace, UncertaintySamples, VariableSetting};
use crate::spec::{Figure, PointMethod, StudySpec, UncertaintySampling, WantedFigure, can_try_all_corners};
use era_model::model::Accuracy;
use era_model::scene::{MAX_ACTUATORS, Scene, SceneError};
use era_model::stop::StopRequest;
use era_model::text_file::read_text_file;
use era_planner::TableOptions;
use era_planner::cache::Key;
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::ops::Range;
use std::path::Path;

/// Version of what rows mean.
const FORMAT: u32 = 3;
/// Time in s that a chunk of work is meant to take: 0.5 to 2.
const CHUNK_S: f64 = 1.0;
/// About what a design takes in s where only the weakest place is wanted, where a plan table is needed, and thoroughly.
const LOOK_S: [f64; 3] = [0.015, 0.15, 2.0];
/// The same with a finger, which makes each place a panel of its own: 3 s, and 25 s on two cores, were measured on the example plate; a map of it is most of the latter.
const FINGER_S: [f64; 3] = [3.0, 50.0, 50.0];
/// Most chunks: schedulers have trouble beyond 10^5 tasks.
const MOST_CHUNKS: usize = 100_000;

/// A study, ready to be computed.
#[derive(Debug)]
pub struct Study {
    /// What its file says.
    pub spec: StudySpec,
    /// What may change.
    pub space: DesignSpace,
    /// The figures that are computed of every design.
    pub figures: Vec<WantedFigure>,
    points: StudyPoints,
    scenarios: UncertaintySamples,
    chunk: usize,
    key: [u8; 32],
}

/// Which points are looked at.
#[derive(Debug)]
enum StudyPoints {
    Known(KnownPoints),
    Evolving(Evolution),
}

impl StudyPoints {
    /// Number of points; more than can be counted is the largest number.
    fn count_all_points_of_study(&self) -> usize {
        match self {
            Self::Known(samples) => samples.count_all_points_of_study(),
            Self::Evolving(own) => {
                own.designs_per_generation_of_one_search()
                    * own.searches_beside_each_other()
                    * own.generations_per_search()
            }
        }
    }
}

/// A study that cannot be computed.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// Mistakes in its file, or in the scene's.
    #[error(transparent)]
    Mistakes(#[from] SceneError),
    /// A file cannot be read.
    #[error("cannot read {path}: {error}")]
    Read {
        /// Which.
        path: String,
        /// Why.
        error: std::io::Error,
    },
}

/// Why a design has no figures.
enum NoFigures {
    /// Somebody has stopped the computation: the design has no row.
    Stopped,
    /// The design fails, for this reason.
    Failed(String),
}

impl Study {
    /// Reads a study's file, and the scene's that it names.
    ///
    /// # Errors
    /// [`StudyError`].
    pub fn load(path: &Path) -> Result<Self, StudyError> {
        let read = |path: &Path| {
            let failed = |error| StudyError::Read { path: path.display().to_string(), error };
            read_text_file(path).map_err(failed)
        };
        let text = read(path)?;
        let source = path.display().to_string();
        let spec = StudySpec::parse(&source, &text)?;
        let scene = path.parent().unwrap_or(Path::new("")).join(&spec.scene);
        let scene_text = read(&scene)?;
        Ok(Self::from_spec_and_texts(spec, &source, &text, &scene.display().to_string(), &scene_text)?)
    }

    /// A study of texts; the scene that it names is of no account.
    ///
    /// # Errors
    /// [`SceneError`] with every mistake found.
    pub fn parse_texts(source: &str, text: &str, scene_source: &str, scene_text: &str) -> Result<Self, SceneError> {
        Self::from_spec_and_texts(StudySpec::parse(source, text)?, source, text, scene_source, scene_text)
    }

    /// The same within bounds, which are looked at before anything is listed or computed.
    ///
    /// # Errors
    /// [`UnusableStudy`]: mistakes, or more than the bounds allow.
    pub fn parse_within_bounds(
        bounds: &StudyBounds,
        [source, text]: [&str; 2],
        [scene_source, scene_text]: [&str; 2],
    ) -> Result<Self, UnusableStudy> {
        Self::build_within(Some(bounds), StudySpec::parse(source, text)?, [source, text], [scene_source, scene_text])
    }

    fn from_spec_and_texts(
        spec: StudySpec,
        source: &str,
        text: &str,
        scene_source: &str,
        scene_text: &str,
    ) -> Result<Self, SceneError> {
        Self::build_within(None, spec, [source, text], [scene_source, scene_text]).map_err(|error| match error {
            UnusableStudy::Mistakes(mistakes) => mistakes,
            // Without bounds there is none.
            UnusableStudy::Excess(excess) => SceneError::from_single_mistake(source, 0, excess.to_string()),
        })
    }

    fn build_within(
        bounds: Option<&StudyBounds>,
        spec: StudySpec,
        [source, text]: [&str; 2],
        [scene_source, scene_text]: [&str; 2],
    ) -> Result<Self, UnusableStudy> {
        if let Some(bounds) = bounds {
            bounds.check_summed_spec_entry_count_and_finalist_count(&spec)?;
        }
        let space = DesignSpace::from_scene_text_without_checking_study(&spec, scene_source, scene_text)?;
        if let Some(bounds) = bounds {
            bounds.check_scene_key_reference_count_and_bytes_written_per_design(&spec, &space)?;
        }
        let off = space.count_independent_uncertain_values();
        let has_corners = spec.method.robust == UncertaintySampling::Corners;
        if let Some(bounds) = bounds
            && (!has_corners || can_try_all_corners(off))
        {
            bounds.check_evaluation_count_of_study(
                &spec.method,
                &space,
                UncertaintySamples::count_samples(off, spec.method.robust),
            )?;
        }
        space.check_study_against_scene(&spec, source, text)?;
        let refused = |text: String| UnusableStudy::Mistakes(SceneError::from_single_mistake(source, 0, text));
        let scene = Scene::parse(scene_source, scene_text)?;
        let figures = spec.distinct_figures_of_wishes_and_limits();
        if scene.actuators.is_empty() || scene.actuators.len() > MAX_ACTUATORS {
            let count = scene.actuators.len();
            return Err(refused(format!("the scene has {count} actuators, but a study needs 1 to {MAX_ACTUATORS}")));
        }
        if scene.finger.is_some()
            && let Some(one) = figures.iter().find(|wanted| wanted.is_for_one_setting_on_whole_surface())
        {
            return Err(refused(format!(
                "the figure {} is for drives that are the same for every touched place, but with a [finger] in the \
                 scene, each place needs its own drives: remove this figure from the study, or [finger] from the scene",
                one.column_name()
            )));
        }
        if has_corners && !can_try_all_corners(off) {
            return Err(refused(format!(
                "method.robust is \"corners\", which allows at most 8 uncertain values, but there are {off}: set vary \
                 = \"together\" in [[uncertain]], or set robust = \"latin_hypercube\" in [method]"
            )));
        }
        let scenarios = UncertaintySamples::new(off, spec.method.robust, spec.method.seed);
        let dimensions = space.dimensions();
        if spec.method.way == PointMethod::Sobol && dimensions.len() > MOST_SOBOL {
            let count = dimensions.len();
            return Err(refused(format!(
                "method.way is \"sobol\", which allows at most {MOST_SOBOL} dimensions, but the variables have \
                 {count} dimensions in total: choose another value for method.way"
            )));
        }
        let points = match KnownPoints::new(&spec.method, dimensions) {
            Some(samples) => StudyPoints::Known(samples),
            None if dimensions.is_empty() => {
                return Err(refused(
                    "method.way is \"evolution\", which needs at least one [[variable]], but there is none".into(),
                ));
            }
            None => StudyPoints::Evolving(Evolution::new(&spec.method, dimensions.len())),
        };
        let designs = points.count_all_points_of_study();
        fits::check_study_fits_scene(&spec, &space, &scene, designs, source, text)?;
        let looks_s = estimate_evaluation_time_of_design_s(&spec, scene.finger.is_some(), &figures, scenarios.0.len());
        let chunk = spec.method.chunk.unwrap_or_else(|| choose_designs_per_chunk(looks_s, designs));
        let key = compute_study_fingerprint(&scene, &spec, text, scene_text);
        Ok(Self { spec, space, figures, points, scenarios, chunk, key })
    }

    /// What the study follows from, as one number: its file, the scene's, and this program.
    #[must_use]
    pub const fn fingerprint(&self) -> [u8; 32] {
        self.key
    }

    /// The frequencies that plan tables cover.
    #[must_use]
    pub fn plan_table_options(&self) -> TableOptions {
        TableOptions { from_hz: self.spec.method.from_hz, to_hz: self.spec.method.to_hz, ..TableOptions::default() }
    }

    /// Number of designs, the scene itself not counted.
    #[must_use]
    pub fn count_designs(&self) -> usize {
        self.points.count_all_points_of_study()
    }

    /// How many samples of what may be off each design is looked at with.
    #[must_use]
    pub fn count_uncertainty_samples(&self) -> usize {
        self.scenarios.0.len()
    }

    /// The evolution, if points depend on results.
    #[must_use]
    pub const fn evolution_if_points_depend_on_results(&self) -> Option<&Evolution> {
        match &self.points {
            StudyPoints::Known(_) => None,
            StudyPoints::Evolving(evolution) => Some(evolution),
        }
    }

    /// All tasks, those of a search in their order.
    pub fn list_tasks(&self) -> impl Iterator<Item = StudyTask> + use<> {
        let (chunks, runs, generations) = match &self.points {
            StudyPoints::Known(samples) => (samples.count_all_points_of_study().div_ceil(self.chunk), 0, 0),
            StudyPoints::Evolving(own) => (0, own.searches_beside_each_other(), own.generations_per_search()),
        };
        let designs = (0..chunks).map(|chunk| StudyTask::Designs { chunk });
        let searches = (0..runs)
            .flat_map(move |run| (0..generations).map(move |generation| StudyTask::Generation { run, generation }));
        std::iter::once(StudyTask::Base).chain(designs).chain(searches)
    }

    /// Number of designs of a task.
    #[must_use]
    pub fn count_designs_of_task(&self, task: StudyTask) -> usize {
        match (task, &self.points) {
            (StudyTask::Base, _) => 1,
            (StudyTask::Designs { chunk }, StudyPoints::Known(samples)) => {
                self.point_range_of_chunk(chunk, samples.count_all_points_of_study()).len()
            }
            (StudyTask::Generation { .. }, StudyPoints::Evolving(own)) => own.designs_per_generation_of_one_search(),
            _ => 0,
        }
    }

    const fn point_range_of_chunk(&self, chunk_index: usize, point_count: usize) -> Range<usize> {
        let from = chunk_index * self.chunk;
        let to = from + self.chunk;
        from..if to < point_count { to } else { point_count }
    }

    /// Computes a task; `None` if the thread's [`StopRequest`] stopped it. `earlier_losses` are the losses of all earlier generations of its
    /// search; of no account for others.
    #[must_use]
    pub fn compute_task_rows_unless_stopped(
        &self,
        task: StudyTask,
        earlier_losses: &[Vec<f64>],
        evaluator: &dyn Evaluator,
    ) -> Option<Vec<DesignRow>> {
        let points = match (task, &self.points) {
            (StudyTask::Base, _) => {
                let design = Design { settings: vec![VariableSetting::Kept; self.space.variables().len()] };
                return Some(vec![self.compute_design_row_unless_stopped(Vec::new(), design, evaluator)?]);
            }
            (StudyTask::Designs { chunk }, StudyPoints::Known(samples)) => {
                samples.points_in_range(self.point_range_of_chunk(chunk, samples.count_all_points_of_study()))
            }
            (StudyTask::Generation { run, .. }, StudyPoints::Evolving(own)) => {
                own.points_of_next_generation_restarting_ended_search(run, earlier_losses)
            }
            _ => Vec::new(),
        };
        // A design belongs to this study's request on whatever thread it is computed.
        let stop = StopRequest::current_request_of_thread();
        let row_at = |point: Vec<f64>| {
            let design = self.space.design_at_point(&point);
            stop.run_with_self_as_current_stop_request_of_thread(|| {
                self.compute_design_row_unless_stopped(point, design, evaluator)
            })
        };
        points.into_par_iter().map(row_at).collect()
    }

    /// The design at a point of the unit cube, one number from 0 to 1 for each dimension of the space, and what comes of it: for searches of
    /// another program. `None` if the thread's [`StopRequest`] stopped it.
    #[must_use]
    pub fn compute_row_at_point_unless_stopped(&self, point: Vec<f64>, evaluator: &dyn Evaluator) -> Option<DesignRow> {
        let design = self.space.design_at_point(&point);
        self.compute_design_row_unless_stopped(point, design, evaluator)
    }

    /// What the designs of a generation are worth to their search.
    #[must_use]
    pub fn compute_losses_for_search_run(&self, run_index: usize, base: &DesignRow, rows: &[DesignRow]) -> Vec<f64> {
        let weights = self
            .evolution_if_points_depend_on_results()
            .map(|own| own.wish_weights_of_run(run_index, self.spec.wishes.len()))
            .unwrap_or_default();
        rows.iter()
            .map(|row| {
                compute_search_loss_of_weighted_wishes_or_only_broken_limits(
                    &self.spec,
                    &self.figures,
                    Some(base),
                    &weights,
                    row,
                )
            })
            .collect()
    }

    fn compute_design_row_unless_stopped(
        &self,
        point: Vec<f64>,
        design: Design,
        evaluator: &dyn Evaluator,
    ) -> Option<DesignRow> {
        let outcome = match self.evaluate_design_over_uncertainty_samples(&design, evaluator) {
            Ok(outcome) => outcome,
            Err(NoFigures::Failed(reason)) => DesignOutcome::Failed(reason),
            Err(NoFigures::Stopped) => return None,
        };
        Some(DesignRow { point, design, outcome })
    }

    fn evaluate_design_over_uncertainty_samples(
        &self,
        design: &Design,
        evaluator: &dyn Evaluator,
    ) -> Result<DesignOutcome, NoFigures> {
        let figures = self.evaluate_design_with_deviations(design, &[], evaluator)?;
        let (mut low, mut high) = (Vec::new(), Vec::new());
        if !self.scenarios.0.is_empty() {
            (low, high) = (figures.values.clone(), figures.values.clone());
        }
        for (number, off) in self.scenarios.0.iter().enumerate() {
            let own = self.evaluate_design_with_deviations(design, off, evaluator);
            let own = own.map_err(|none| match none {
                NoFigures::Stopped => NoFigures::Stopped,
                NoFigures::Failed(reason) => {
                    NoFigures::Failed(format!("{reason} (with sample {} of the uncertain values)", number + 1))
                }
            })?;
            low.iter_mut().zip(&own.values).for_each(|(low, value)| *low = low.min(*value));
            high.iter_mut().zip(&own.values).for_each(|(high, value)| *high = high.max(*value));
        }
        Ok(DesignOutcome::Found { figures, low, high })
    }

    fn evaluate_design_with_deviations(
        &self,
        design: &Design,
        tolerance_fractions: &[f64],
        evaluator: &dyn Evaluator,
    ) -> Result<Figures, NoFigures> {
        let scene = self
            .space
            .build_scene_of_design_with_deviations_checking_distances(design, tolerance_fractions)
            .map_err(|refused| NoFigures::Failed(refused.to_string()))?;
        // A design that no one has thought of must not end the study.
        let found = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            self.evaluate_figures_with_mass_and_cost(&scene, design, evaluator)
        }));
        let figures = found.map_err(|_| {
            NoFigures::Failed(
                "the program failed at this design because of a bug: please report this message with the scene".into(),
            )
        })?;
        figures.map_err(|error: EvaluateError| match error.is_of_stopped_computation() {
            true => NoFigures::Stopped,
            false => NoFigures::Failed(error.to_string()),
        })
    }

    /// The figures of a scene: those of its parts from here, all else from the evaluator.
    ///
    /// # Errors
    /// As the evaluator's.
    pub fn evaluate_figures_with_mass_and_cost(
        &self,
        scene: &Scene,
        design: &Design,
        evaluator: &dyn Evaluator,
    ) -> Result<Figures, EvaluateError> {
        let mut figures = evaluator.compute_scene_figures(scene, &self.figures)?;
        self.fill_in_mass_and_cost_figures(scene, design, &mut figures);
        Ok(figures)
    }

    /// Fills in the figures of parts, which no evaluator knows.
    pub fn fill_in_mass_and_cost_figures(&self, scene: &Scene, design: &Design, figures: &mut Figures) {
        for (value, wanted) in figures.values.iter_mut().zip(&self.figures) {
            match wanted.figure {
                Figure::MassG => *value = parts::mass_of_surface_masses_and_actuators_without_air_g(scene),
                Figure::Cost => {
                    let known = self.space.replace_kept_choices_by_scene_file_values(design);
                    *value = parts::parts_and_choices_cost_or_nan_if_priced_choice_keeps_scene_value(
                        scene,
                        &self.spec.costs,
                        self.space.variables(),
                        &known,
                    );
                }
                _ => {}
            }
        }
    }
}

/// About what the looks at a design, with all samples of what may be off, take in s.
#[expect(clippy::cast_precision_loss, reason = "small counts")]
fn estimate_evaluation_time_of_design_s(
    spec: &StudySpec,
    has_finger: bool,
    figures: &[WantedFigure],
    uncertainty_samples: usize,
) -> f64 {
    let is_quick = figures.iter().all(|wanted| wanted.needs_no_plan_table());
    let [quick_s, table_s, thorough_s] = if has_finger { FINGER_S } else { LOOK_S };
    let each_s = match (spec.method.thorough, is_quick) {
        (true, _) => thorough_s,
        (false, false) => table_s,
        (false, true) => quick_s,
    };
    each_s * (1 + uncertainty_samples) as f64
}

/// Designs of a chunk, of so many that take so long each.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small counts")]
fn choose_designs_per_chunk(evaluation_s: f64, design_count: usize) -> usize {
    let fitting = (CHUNK_S / evaluation_s).floor().max(1.0) as usize;
    fitting.max(design_count.div_ceil(MOST_CHUNKS))
}

fn compute_study_fingerprint(scene: &Scene, spec: &StudySpec, text: &str, scene_text: &str) -> [u8; 32] {
    let options = TableOptions { from_hz: spec.method.from_hz, to_hz: spec.method.to_hz, ..TableOptions::default() };
    // The planner's own key stands for its code and the model's.
    let code = Key::new(scene, Accuracy::BALANCED, options).map_or_else(String::new, |key| key.to_string());
    let parts = [&FORMAT.to_string(), env!("CARGO_PKG_VERSION"), &code, text, scene_text];
    let mut hash = Sha256::new();
    for part in parts {
        hash.update(format_hex(&Sha256::digest(part)));
    }
    hash.finalize().into()
}
