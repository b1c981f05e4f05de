//! What tolerances do to a plan: its drives on panels that are not quite the one it was made for. Nothing is driven for it.

use super::attachments::Place as Moved;
use super::background::{BackgroundJob, BackgroundPlace, BackgroundWork, JobReport, NewestJob, Stage};
use super::low_priority::Deadline;
use super::preview::{PlannedScene, PreviewRequest, plan_touch_on_changed_scene};
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::check::{build_planner_target_at_px, check_intensity_range};
use crate::daemon::touch::plan_view::PlanView;
use crate::planner::{Plan, PlanTable};
use crate::study::tolerances::{
    RangeError, Spread, ToleranceError, Tolerances, compute_target_peak_spread_under_tolerances_with_observer,
    count_varied_panels_of_tolerance_study,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use utoipa::ToSchema;

/// The field of a request that has [`WantedTolerances`].
const TOLERANCES: &str = "tolerances";

/// Manufacturing tolerances: largest deviation of each quantity in both directions.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[schema(as = WantedTolerances)]
#[serde(deny_unknown_fields)]
pub struct WantedTolerances {
    /// Relative deviation of the stiffness of supports, elastic edges and actuators, independent for each; 0.2 if absent.
    pub springs: Option<f64>,
    /// Relative deviation of Young's modulus, the same everywhere; 0.1 if absent.
    pub youngs_modulus: Option<f64>,
    /// Relative deviation of the thickness, the same everywhere; 0.05 if absent.
    pub thickness: Option<f64>,
    /// Deviation of the places of supports, masses and actuators in mm, independent for each coordinate; 1 if absent.
    pub places_mm: Option<f64>,
}

impl WantedTolerances {
    /// With what is usual for the rest.
    fn with_defaults_for_missing(self) -> Tolerances {
        let usual = Tolerances::default();
        Tolerances {
            springs: self.springs.unwrap_or(usual.springs),
            youngs_modulus: self.youngs_modulus.unwrap_or(usual.youngs_modulus),
            thickness: self.thickness.unwrap_or(usual.thickness),
            places_mm: self.places_mm.unwrap_or(usual.places_mm),
        }
    }
}

/// The touch whose plan is examined, and the tolerances.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[schema(examples(json!({"x_px": 960, "y_px": 640, "tolerances": {"thickness": 0.02}})))]
#[serde(deny_unknown_fields)]
pub struct TolerancesRequest {
    /// Distance of the touch from the left edge of the scene's screen in pixels: 0 to `width_px`.
    pub x_px: f64,
    /// Distance of the touch from the top edge of the screen in pixels: 0 to `height_px`.
    pub y_px: f64,
    /// Wanted peak acceleration in g; 0.5 if absent.
    pub intensity_g: Option<f64>,
    /// A complete scene file (TOML) as text; the daemon's scene if absent.
    pub scene: Option<String>,
    /// New places of supports, masses and actuators, as in a preview. If `moves` (also an empty one) or `scene` is given, the plan is that of
    /// `POST /v1/preview`; without both, the plan is that of `POST /v1/touch`.
    pub moves: Option<BTreeMap<String, Moved>>,
    /// The tolerances; defaults for all that are absent.
    pub tolerances: Option<WantedTolerances>,
}

impl TolerancesRequest {
    /// How far things may be off, with what is usual for what is not given.
    ///
    /// # Errors
    /// [`Problem`] that names a tolerance, or the intensity, that is out of range.
    pub fn check_intensity_and_tolerances_filling_in_defaults(&self) -> Result<Tolerances, Problem> {
        let tolerances = self.tolerances.unwrap_or_default().with_defaults_for_missing();
        tolerances.check_ranges()?;
        check_intensity_range(self.intensity_g)?;
        Ok(tolerances)
    }
}

/// The progress and the results of the newest tolerance study.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct TolerancesView {
    /// Number of the tolerance study, from 1; 0 before the first one. A number above yours belongs to a newer tolerance study of any client.
    id: u64,
    /// Progress of the tolerance study.
    stage: Stage,
    /// Number of panels that have been computed.
    there: usize,
    /// Number of all panels of the tolerance study.
    all: usize,
    /// The plan that is examined, with its error bound; null before the first tolerance study.
    plan: Option<PlanView>,
    /// Effect of the plan's drives on panels that differ from the scene; null until the tolerance study is done.
    off: Option<Spread>,
    /// `off` in words, as `era plan --spread` prints it; null until the tolerance study is done.
    words: Option<String>,
    /// Why the tolerance study failed; null if it did not fail.
    problem: Option<String>,
}

/// What is known of the newest.
#[derive(Clone, Debug, Default)]
struct ToleranceFindings {
    id: u64,
    plan: Option<PlanView>,
    off: Option<Spread>,
}

impl From<JobReport<ToleranceFindings>> for TolerancesView {
    fn from(told: JobReport<ToleranceFindings>) -> Self {
        let JobReport { stage, there, all, found: ToleranceFindings { id, plan, off }, problem } = told;
        Self { id, stage, there, all, plan, words: off.as_ref().map(Spread::describe_in_words), off, problem }
    }
}

/// The daemon's newest look at tolerances.
#[derive(Debug)]
pub struct ToleranceStudies {
    place: BackgroundPlace,
    newest: NewestJob<ToleranceFindings>,
    /// How many there were.
    count: AtomicU64,
}

impl ToleranceStudies {
    /// None yet.
    #[must_use]
    pub fn new(place: BackgroundPlace) -> Self {
        Self { place, newest: NewestJob::without_job(ToleranceFindings::default()), count: AtomicU64::new(0) }
    }

    /// How far the newest one is.
    #[must_use]
    pub fn view_newest_study(&self) -> TolerancesView {
        self.newest.report_progress().into()
    }

    /// No other panel of it is begun.
    pub fn stop_newest_study(&self) {
        self.newest.cancel_current_job();
    }

    /// Begins to look at what tolerances do to the plan for a touch on the scene of `table`, or on a changed one; drives nothing.
    /// `own_scene` is the text of the daemon's scene; `parse_request` gives what was asked for.
    ///
    /// # Errors
    /// [`Problem`]: a touch, tolerance, scene or move that cannot be used, a scene without a plan, or work that is under way.
    pub async fn begin_study_for_request_unless_busy(
        self: &Arc<Self>,
        table: &Arc<PlanTable>,
        own_scene: Arc<str>,
        asker: &Asker,
        parse_request: impl FnOnce() -> Result<TolerancesRequest, Problem> + Send + 'static,
    ) -> Result<TolerancesView, Problem> {
        let (looks, table) = (Arc::clone(self), Arc::clone(table));
        let check_and_begin = move |deadline: &Deadline| {
            let request = parse_request()?;
            let tolerances = request.check_intensity_and_tolerances_filling_in_defaults()?;
            let TolerancesRequest { x_px, y_px, intensity_g, scene, moves, .. } = request;
            if scene.is_none() && moves.is_none() {
                let plan = table.plan(&[build_planner_target_at_px(&table.scene, x_px, y_px, intensity_g)?])?;
                deadline.check_not_cancelled_or_expired()?;
                return looks.begin_study_of_plan(&table, plan, tolerances);
            }
            let request = PreviewRequest { x_px, y_px, intensity_g, scene, moves: moves.unwrap_or_default() };
            let PlannedScene { table, plan, .. } = plan_touch_on_changed_scene(&request, &own_scene, deadline)?;
            deadline.check_not_cancelled_or_expired()?;
            looks.begin_study_of_plan(&table, plan, tolerances)
        };
        let work = BackgroundWork::Tolerances;
        self.place.check_in_turn_and_begin(work, asker.client, &asker.sender, check_and_begin).await
    }

    /// Begins one, of a table's plan.
    fn begin_study_of_plan(
        &self,
        table: &PlanTable,
        plan: Plan,
        tolerances: Tolerances,
    ) -> Result<TolerancesView, Problem> {
        let taken = self.place.occupy_for(BackgroundWork::Tolerances)?;
        let id = 1 + self.count.fetch_add(1, Ordering::Relaxed);
        let scene = table.scene.clone();
        let found = ToleranceFindings { id, plan: Some(PlanView::new(table, plan.clone())), off: None };
        let (all, known) = (count_varied_panels_of_tolerance_study(&scene), found.clone());
        let work = move |job: &BackgroundJob<ToleranceFindings>| {
            match compute_target_peak_spread_under_tolerances_with_observer(&scene, &[], &plan, tolerances, job) {
                Ok(off) => Ok(Some(ToleranceFindings { off: Some(off), ..known })),
                Err(ToleranceError::Stopped) => Ok(None),
                Err(error) => Err(error.to_string()),
            }
        };
        Ok(self.newest.start_job(taken, all, found, work)?.into())
    }
}

impl From<RangeError> for Problem {
    fn from(RangeError { field, value, most }: RangeError) -> Self {
        Self::out_of_range(field, value, 0, most).prefix_field_and_detail_if_prefix_given(Some(TOLERANCES.into()))
    }
}
