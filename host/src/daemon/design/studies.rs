//! Small design studies for the page: one at a time, beside everything else, of the daemon's own scene or one that is sent. Nothing is
//! driven by them.

use super::attachments::Attachments;
use super::background::{BackgroundJob, BackgroundPlace, BackgroundWork, JobReport, NewestJob, Stage};
use super::low_priority::Deadline;
use super::preview::{MAX_SCENE, check_entry_counts, check_model_size, limit_exceeded_problem};
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::model::ModelError;
use crate::scene::Scene;
use crate::study::bounds::{ExceededBound, StudyBounds, UnusableStudy};
use crate::study::evaluate::{EvaluateError, Evaluator, Figures, QuickEvaluator};
use crate::study::result::{DesignTable, Finalist};
use crate::study::run::{RunEnd, Shard, Study, StudyFolder, StudyObserver, compute_missing_rows_of_shard};
use crate::study::spec::WantedFigure;
use crate::study::written::{
    names_and_verified_figures_or_none_if_finalist_failed, names_and_worst_case_wish_figures_if_uncertain,
    verify_and_write_results_unless_stopped,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use utoipa::ToSchema;

/// What is taken of a study. The looks are half a minute of the example plate on one processor, a finalist is a second or two.
const BOUNDS: StudyBounds = StudyBounds { entries: 64, places: 512, written: MAX_SCENE, looks: 2000, finalists: 5 };
/// What messages call what came in a request.
const STUDY: &str = "study";
/// What messages call its scene.
const SCENE: &str = "scene";

/// A study to run.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[schema(examples(json!({"study": "version = 1\nname = \"corners\"\nscene = \"plate.toml\"\n[[variable]]\nkey = \"support.*.stiffness_n_per_m\"\nfrom = 500\nto = 8000\n[[wish]]\nfigure = \"weakest_g\"\n[method]\ndesigns = 32\n"})))]
#[serde(deny_unknown_fields)]
pub struct StudyRequest {
    /// A study file (TOML) as text; the daemon ignores the key `scene` of the study file.
    pub study: String,
    /// A complete scene file (TOML) as text; the daemon's scene if absent.
    pub scene: Option<String>,
}

/// The progress and the results of the newest study.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Study)]
pub struct StudyView {
    /// Progress of the study.
    stage: Stage,
    /// Name of the study; null before the first study.
    name: Option<String>,
    /// Number of designs that have been computed.
    there: usize,
    /// Number of all designs of the study.
    all: usize,
    /// Results of the unchanged scene; null until the study is done.
    as_it_is: Option<DesignView>,
    /// The best designs, the best one first; empty until the study is done.
    best: Vec<DesignView>,
    /// If no design keeps all limits, the design that exceeds the limits least. Null if a design keeps all limits, if all designs have failed,
    /// and until the study is done.
    nearest: Option<NearestView>,
    /// If all designs have failed, the reason why the first design has failed; otherwise null, and null until the study is done.
    all_failed: Option<String>,
    /// Why the study failed; null if it did not fail.
    problem: Option<String>,
}

/// The design that exceeds the limits least, in a study in which no design keeps all limits.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Nearest)]
pub struct NearestView {
    /// Number of the design in the study, from 1.
    design: usize,
    /// Which limits the design exceeds, with the values of the design.
    reason: String,
}

/// A finalist: a design that got the thorough evaluation at the end of the study.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Design)]
pub struct DesignView {
    /// Number of the design in the study, from 1; 0 for the unchanged scene.
    design: usize,
    /// The figures of the design that the study names, by the names of the columns of a study.
    figures: BTreeMap<String, f64>,
    /// Upper bound on the relative error of `weakest_g`; null if the bound is unknown, or if the study does not use `weakest_g`.
    error_bound: Option<f64>,
    /// The value of each wish for the worst sample of the uncertain values, from the quick evaluation; empty in a study without `[[uncertain]]`.
    worst: BTreeMap<String, f64>,
    /// The limits that the design exceeds in the thorough evaluation; null if it keeps all limits.
    breaks: Option<String>,
    /// Why the thorough evaluation failed; null if it did not fail.
    failed: Option<String>,
    /// The scene file of the design; `POST /v1/preview` accepts this text as `scene`.
    scene_toml: String,
}

/// The daemon's study.
#[derive(Debug)]
pub struct Studies {
    /// The daemon's own scene.
    own: Arc<str>,
    place: BackgroundPlace,
    newest: NewestJob<StudyFindings>,
}

/// What is known of a study.
#[derive(Clone, Debug, Default)]
struct StudyFindings {
    name: Option<String>,
    as_it_is: Option<DesignView>,
    best: Vec<DesignView>,
    nearest: Option<NearestView>,
    all_failed: Option<String>,
}

impl From<JobReport<StudyFindings>> for StudyView {
    fn from(told: JobReport<StudyFindings>) -> Self {
        let JobReport { stage, there, all, found, problem } = told;
        let StudyFindings { name, as_it_is, best, nearest, all_failed } = found;
        Self { stage, name, there, all, as_it_is, best, nearest, all_failed, problem }
    }
}

impl Studies {
    /// For a daemon whose scene file has this text.
    #[must_use]
    pub fn new(own: Arc<str>, place: BackgroundPlace) -> Arc<Self> {
        Arc::new(Self { own, place, newest: NewestJob::without_job(StudyFindings::default()) })
    }

    /// How far the newest one is.
    #[must_use]
    pub fn view_newest_study(&self) -> StudyView {
        self.newest.report_progress().into()
    }

    /// No other task of it begins.
    pub fn stop_newest_study(&self) {
        self.newest.cancel_current_job();
    }

    /// Begins one; `parse_request` gives what was asked for. It is checked aside, as the study itself is run, and only if no other work is under
    /// way: whoever comes then costs nothing.
    ///
    /// # Errors
    /// [`Problem`]: mistakes in the study or its scene, more than is looked at here, or other work that is under way.
    pub async fn begin_study(
        self: &Arc<Self>,
        asker: &Asker,
        parse_request: impl FnOnce() -> Result<StudyRequest, Problem> + Send + 'static,
    ) -> Result<StudyView, Problem> {
        let studies = Arc::clone(self);
        let check_and_begin = move |deadline: &Deadline| {
            let study = studies.parse_and_check_study(&parse_request()?)?;
            deadline.check_not_cancelled_or_expired()?;
            let taken = studies.place.occupy_for(BackgroundWork::Study)?;
            let found = StudyFindings { name: Some(study.spec.name.clone()), ..StudyFindings::default() };
            let (all, work) = (study.count_designs(), move |job: &BackgroundJob<StudyFindings>| {
                run_study_unless_stopped(&study, job)
            });
            Ok(studies.newest.start_job(taken, all, found, work)?.into())
        };
        let work = BackgroundWork::Study;
        self.place.check_in_turn_and_begin(work, asker.client, &asker.sender, check_and_begin).await
    }

    /// A study whose cost is bounded.
    fn parse_and_check_study(&self, request: &StudyRequest) -> Result<Study, Problem> {
        let scene = request.scene.as_deref().unwrap_or(&self.own);
        for (field, text) in [(STUDY, request.study.as_str()), (SCENE, scene)] {
            if text.len() > MAX_SCENE {
                return Err(limit_exceeded_problem(field, text.len(), "bytes", MAX_SCENE, None));
            }
        }
        check_entry_counts(&Attachments::parse(scene))?;
        let study = Study::parse_within_bounds(&BOUNDS, [STUDY, &request.study], [SCENE, scene])?;
        check_model_size(&Scene::parse(SCENE, scene)?, study.spec.method.to_hz)?;
        if study.spec.method.thorough {
            let detail = "method.look is \"thorough\", but must be \"quick\" in the daemon: run thorough studies with `era study`";
            let problem = Problem::new(ProblemKind::TooLarge, detail);
            return Err(problem.with_field_and_value("method.look", "thorough".into(), "\"quick\"".into(), None));
        }
        Ok(study)
    }
}

impl From<UnusableStudy> for Problem {
    fn from(error: UnusableStudy) -> Self {
        match error {
            UnusableStudy::Mistakes(mistakes) => mistakes.into(),
            UnusableStudy::Excess(ExceededBound { field, value, unit, most }) => {
                limit_exceeded_problem(field, value, unit, most, None)
            }
        }
    }
}

/// A quick look at designs that are no larger than a preview may be, until nobody wants it any more.
struct BoundedEvaluator<'a> {
    quick: QuickEvaluator,
    to_hz: f64,
    job: &'a BackgroundJob<StudyFindings>,
}

impl Evaluator for BoundedEvaluator<'_> {
    fn compute_scene_figures(&self, scene: &Scene, wanted: &[WantedFigure]) -> Result<Figures, EvaluateError> {
        if self.job.is_stop_wanted() {
            return Err(ModelError::Stopped.into());
        }
        check_model_size(scene, self.to_hz).map_err(|problem| EvaluateError::Refused(problem.detail().into()))?;
        self.job.run_stoppable_by_cancel_or_time_limit(|| self.quick.compute_scene_figures(scene, wanted))
    }
}

/// Runs a study in a folder that is gone afterwards; `None` if it was stopped.
fn run_study_unless_stopped(
    study: &Study,
    job: &BackgroundJob<StudyFindings>,
) -> Result<Option<StudyFindings>, String> {
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let place = tempfile::tempdir().map_err(|error| told(&error))?;
    let folder = StudyFolder::open_or_create_refusing_folder_of_other_study(place.path(), study.fingerprint())
        .map_err(|error| told(&error))?;
    let quick = QuickEvaluator::new(study.plan_table_options());
    let evaluator = BoundedEvaluator { quick, to_hz: study.spec.method.to_hz, job };
    let ended = compute_missing_rows_of_shard(study, &folder, &evaluator, Shard::ALL, job);
    if ended.map_err(|error| told(&error))? == RunEnd::Early || job.is_stop_wanted() {
        return Ok(None);
    }
    job.set_stage_to_finishing();
    let Some(written) = verify_and_write_results_unless_stopped(study, &folder, &|| job.is_stop_wanted())
        .map_err(|error| told(&error))?
    else {
        return Ok(None);
    };
    let view = |own: &Finalist| build_design_view(study, &written.table, own);
    let nearest = written
        .table
        .find_one_based_design_nearest_to_limits_if_none_meets_them()
        .map(|(design, entry)| NearestView { design, reason: entry.reason.clone().unwrap_or_default() });
    let (as_it_is, best) = (Some(view(&written.finals.base)), written.finals.best.iter().map(view).collect());
    let first = || written.table.entries.iter().find_map(|entry| entry.reason.clone());
    let all_failed = written.table.have_all_designs_failed().then(first).flatten();
    Ok(Some(StudyFindings { name: Some(study.spec.name.clone()), as_it_is, best, nearest, all_failed }))
}

fn build_design_view(study: &Study, table: &DesignTable, finalist: &Finalist) -> DesignView {
    let verified = finalist.verified.as_ref();
    DesignView {
        design: finalist.design,
        figures: names_and_verified_figures_or_none_if_finalist_failed(study, finalist)
            .into_iter()
            .filter(|(_, value)| value.is_finite())
            .collect(),
        error_bound: verified.ok().and_then(|verified| verified.bound),
        worst: names_and_worst_case_wish_figures_if_uncertain(study, table, finalist)
            .into_iter()
            .filter(|(_, value)| value.is_finite())
            .collect(),
        breaks: finalist.describe_broken_limits_if_any_unless_verification_failed(study),
        failed: verified.err().cloned(),
        scene_toml: finalist.text.clone(),
    }
}
