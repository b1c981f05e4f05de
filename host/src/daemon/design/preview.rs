//! What a changed scene would do, computed without driving anything: for designers who move attachments about.
//!
//! Two previews are computed at a time, one of each client, and one of each client waits: a newer request takes the place of the client's
//! that waits. Work is bounded by limits on the scene that are checked before anything is built, by its time, and by its sender's waiting for it.

use super::attachments::{Attachments, Place, TABLES};
use super::low_priority::{Deadline, run_low_priority_until_deadline};
use super::slots::Slots;
use crate::daemon::access::client::Client;
use crate::daemon::access::sender::RequestSender;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::observe::scene::SceneView;
use crate::daemon::touch::check::build_planner_target_at_px;
use crate::daemon::touch::plan_view::{FieldView, PlanView};
use crate::model::Accuracy;
use crate::model::levels::ReducedLevels;
use crate::planner::{Plan, PlanTable, TableOptions};
use crate::scene::{MAX_ACTUATORS, Scene};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};
use utoipa::ToSchema;

/// Longest scene in bytes: twenty times the examples.
pub const MAX_SCENE: usize = 64 * 1024;
/// Most supports, masses and actuators together: time grows with nearly the cube of them, to some 5 s at 32.
const MAX_ATTACHMENTS: usize = 32;
/// Most patches and cut-outs together: a grid of all of their borders is looked at for every cell and every point of the surface.
const MAX_RECTANGLES: usize = 24;
/// Most layers.
const MAX_LAYERS: usize = 32;
/// Most unknowns of the finest level: panels with a bezel or a camera hole need up to 4500.
const MAX_UNKNOWNS: f64 = 6_000.0;
/// Most products of unknowns and attachments, as each attachment has functions of its own, which are integrated over all cells: 32 on the example plate, whose finest level has 2436.
const MAX_PRODUCT: f64 = 80_000.0;
/// Most modes that are kept ([`ReducedLevels::estimate_kept_mode_count`]): a plate of 1.3 m by 0.8 m and 2 mm has 60.
const MAX_MODES: f64 = 100.0;
/// Previews that are computed at once, each of another client.
const AT_ONCE: usize = 2;
/// Clients that may wait for one.
const MOST_WAITING: usize = 16;
/// Longest time for one.
const LONGEST: Duration = Duration::from_secs(10);
/// Tolerance of the model.
const ACCURACY: Accuracy = Accuracy::FAST;
/// What messages call a scene that came in a request.
const SOURCE: &str = "scene";

/// A changed scene, and a touch on this scene.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[schema(examples(json!({"x_px": 960, "y_px": 640, "moves": {"support[1]": {"x_mm": 40, "y_mm": 30}}})))]
#[serde(deny_unknown_fields)]
pub struct PreviewRequest {
    /// Distance of the touch from the left edge of the scene's screen in pixels: 0 to `width_px`.
    pub x_px: f64,
    /// Distance of the touch from the top edge of the screen in pixels: 0 to `height_px`.
    pub y_px: f64,
    /// Wanted peak acceleration in g; 0.5 if absent.
    pub intensity_g: Option<f64>,
    /// A complete scene file (TOML) as text; the daemon's scene if absent.
    pub scene: Option<String>,
    /// New places of supports, masses and actuators, by their names in messages: `support[2]` is the second support of the file. The new
    /// places must be on the surface.
    #[serde(default)]
    pub moves: BTreeMap<String, Place>,
}

/// The result of a preview.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Preview {
    /// The plan for the touch, with the error bound of the plan.
    pub plan: PlanView,
    /// The predicted peak acceleration over the surface.
    pub field: FieldView,
    /// The scene with the moves, with the values that a page needs to draw it.
    pub scene: SceneView,
    /// The scene file with the moves; the rest of the file is unchanged.
    pub scene_toml: String,
    /// Relative tolerance for which the model was made; `plan.error_bound` is the bound on the actual error.
    pub tolerance: f64,
    /// Time of the computation in ms, without the time in the queue.
    pub elapsed_ms: f64,
}

/// Lets previews through.
#[derive(Debug)]
pub struct Previews {
    /// The daemon's own scene.
    own: Arc<str>,
    slots: Arc<Slots>,
}

impl Previews {
    /// For a daemon whose scene file has this text.
    #[must_use]
    pub fn new(own: Arc<str>) -> Self {
        Self { own, slots: Slots::new(AT_ONCE, MOST_WAITING) }
    }

    /// Computes a preview for a client once it is its turn; `parse_request` gives what was asked for, which is read in the same slot.
    ///
    /// # Errors
    /// [`Problem`]: what is wrong with the request, that a newer one came while it waited, or that it takes too long.
    pub async fn compute_preview_in_turn(
        &self,
        client: Client,
        sender: &RequestSender,
        parse_request: impl FnOnce() -> Result<PreviewRequest, Problem> + Send + 'static,
    ) -> Result<Preview, Problem> {
        let slot = sender
            .run_until_connection_closed(self.slots.wait_for_slot_replacing_waiting_request_of_same_client(client))
            .await?;
        let own = Arc::clone(&self.own);
        let work = move |deadline: &Deadline| {
            // Until the work is done, also if nobody waits for it any more.
            let _slot = slot;
            compute_preview(&parse_request()?, &own, deadline)
        };
        run_low_priority_until_deadline("preview", LONGEST, sender, work).await
    }

    /// The daemon's own scene.
    pub fn own_scene_toml(&self) -> Arc<str> {
        Arc::clone(&self.own)
    }
}

/// A changed scene with the plan for a touch.
#[derive(Debug)]
pub struct PlannedScene {
    /// Its table, with the scene.
    pub table: PlanTable,
    /// The plan.
    pub plan: Plan,
    /// The scene file with the moves.
    scene_toml: String,
}

/// The plan of a preview; `own_scene_toml` is the scene that it is of if it names none.
///
/// # Errors
/// [`Problem`]: what is wrong with the request, or that it takes too long.
pub fn plan_touch_on_changed_scene(
    request: &PreviewRequest,
    own_scene_toml: &str,
    deadline: &Deadline,
) -> Result<PlannedScene, Problem> {
    let text = request.scene.as_deref().unwrap_or(own_scene_toml);
    if text.len() > MAX_SCENE {
        return Err(limit_exceeded_problem("scene", text.len(), "bytes", MAX_SCENE, None));
    }
    let attachments = Attachments::parse(text);
    check_entry_counts(&attachments)?;
    let scene_toml = attachments.scene_text_with_moves(&request.moves)?;
    let scene = Scene::parse(SOURCE, &scene_toml)?;
    let target = build_planner_target_at_px(&scene, request.x_px, request.y_px, request.intensity_g)?;
    let options = TableOptions::for_preview();
    check_model_size(&scene, options.to_hz)?;
    let plan_levels = |levels: ReducedLevels| -> Result<_, Problem> {
        deadline.check_not_cancelled_or_expired()?;
        let table = PlanTable::from_levels(&scene, levels, options)?;
        deadline.check_not_cancelled_or_expired()?;
        let plan = table.plan(&[target])?;
        deadline.check_not_cancelled_or_expired()?;
        Ok((table, plan))
    };
    // A first try takes half the time of the levels that the daemon itself plans with, and is right to 3e-3 on the
    // example plate while a corner support is dragged inwards.
    let (mut table, mut plan) = plan_levels(ReducedLevels::build_with_order_and_two_lower(
        &scene,
        ACCURACY.choose_element_order_for_tolerance(),
        options.to_hz,
    )?)?;
    if plan.error_bound.is_none_or(|bound| bound > ACCURACY.relative_tolerance_or_tightest()) {
        (table, plan) = plan_levels(ReducedLevels::build(&scene, ACCURACY, options.to_hz)?)?;
    }
    Ok(PlannedScene { table, plan, scene_toml })
}

fn compute_preview(request: &PreviewRequest, own_scene_toml: &str, deadline: &Deadline) -> Result<Preview, Problem> {
    let started = Instant::now();
    let PlannedScene { table, plan, scene_toml } = plan_touch_on_changed_scene(request, own_scene_toml, deadline)?;
    let field = FieldView::new(&table, Some(&plan), 0);
    Ok(Preview {
        scene: SceneView::new(&table.scene),
        plan: PlanView::new(&table, plan),
        field,
        scene_toml,
        tolerance: ACCURACY.relative_tolerance_or_tightest(),
        elapsed_ms: started.elapsed().as_secs_f64() * 1e3,
    })
}

/// How much a scene has of everything that costs time, told before it is read as a scene: what no plan can be made of, or too much would have to
/// be computed for.
///
/// # Errors
/// [`Problem`] that says what is too much, with its line where there is one.
pub(super) fn check_entry_counts(attachments: &Attachments<'_>) -> Result<(), Problem> {
    let actuators = attachments.count_entries_of_tables(&["actuator"]);
    if actuators > MAX_ACTUATORS {
        let line = attachments.find_line_of_entry("actuator", MAX_ACTUATORS + 1);
        return Err(limit_exceeded_problem("actuator", actuators, "actuators", MAX_ACTUATORS, line));
    }
    for (tables, what, most) in [
        (&TABLES[..], "supports, masses and actuators", MAX_ATTACHMENTS),
        (&["patch", "cutout"], "patches and cut-outs", MAX_RECTANGLES),
        (&["layer"], "layers", MAX_LAYERS),
    ] {
        let count = attachments.count_entries_of_tables(tables);
        if count > most {
            return Err(limit_exceeded_problem("scene", count, what, most, None));
        }
    }
    Ok(())
}

/// How large a model a scene needs for frequencies up to `to_hz`, told before it is built. Designs of a study may have more attachments than
/// its scene's file, so these are counted here as well.
///
/// # Errors
/// [`Problem`] that says what is too much.
pub(super) fn check_model_size(scene: &Scene, to_hz: f64) -> Result<(), Problem> {
    let attachments = scene.supports.len() + scene.masses.len() + scene.actuators.len();
    if attachments > MAX_ATTACHMENTS {
        return Err(limit_exceeded_problem(
            "scene",
            attachments,
            "supports, masses and actuators",
            MAX_ATTACHMENTS,
            None,
        ));
    }
    let rectangles = scene.patches.len() + scene.cutouts.len();
    if rectangles > MAX_RECTANGLES {
        return Err(limit_exceeded_problem("scene", rectangles, "patches and cut-outs", MAX_RECTANGLES, None));
    }
    let expected = ReducedLevels::estimate_unknown_count_of_finest_level(scene, ACCURACY, to_hz)?;
    #[expect(clippy::cast_precision_loss, reason = "at most 32")]
    let most = MAX_UNKNOWNS.min((MAX_PRODUCT / attachments.max(1) as f64).floor());
    if expected > most {
        return Err(limit_exceeded_problem("surface", expected, "unknowns", most, None));
    }
    let modes = ReducedLevels::estimate_kept_mode_count(scene, to_hz).round();
    if modes > MAX_MODES { Err(limit_exceeded_problem("surface", modes, "modes", MAX_MODES, None)) } else { Ok(()) }
}

/// More than is computed here; `line` is that of the scene's text.
pub(super) fn limit_exceeded_problem<T: std::fmt::Display + Into<serde_json::Value>>(
    field: &str,
    value: T,
    unit: &str,
    limit: T,
    line: Option<usize>,
) -> Problem {
    let place = line.map_or_else(String::new, |line| format!("{SOURCE}:{line}: "));
    let detail = format!(
        "{place}{field}: there are {value} {unit}, but in a preview or study that the daemon computes, the limit is \
         {limit}"
    );
    let allowed = format!("at most {limit} {unit}");
    Problem::new(ProblemKind::TooLarge, detail).with_field_and_value(field, value.into(), allowed, line)
}
