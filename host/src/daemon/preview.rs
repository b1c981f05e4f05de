//! What a changed scene would do, computed without driving anything: for designers who move attachments about.
//!
//! One preview is computed at a time, and at most one waits: a newer request takes the waiting one's place. Work is bounded
//! by limits on the scene that are checked before anything is built.

use super::answers::scene::SceneView;
use super::attachments::{Attachments, Place};
use super::problem::{Kind, Problem};
use super::view::{FieldView, PlanView};
use crate::model::Accuracy;
use crate::model::levels::Levels;
use crate::planner::{Plan, PlanTable, TableOptions, Target};
use crate::scene::{MAX_ACTUATORS, Scene};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::{Mutex, watch};
use utoipa::ToSchema;

/// Longest scene in bytes: twenty times the examples.
pub const MAX_SCENE: usize = 64 * 1024;
/// Most supports, masses and actuators together: time grows with nearly the cube of them, to some 5 s at 32.
const MAX_ATTACHMENTS: usize = 32;
/// Most unknowns of the finest level: panels with a bezel or a camera hole need up to 4500.
const MAX_UNKNOWNS: f64 = 6_000.0;
/// Most products of unknowns and attachments: each attachment has functions of its own, which are integrated over all cells.
const MAX_PRODUCT: f64 = 48_000.0;
/// Tolerance of the model.
const ACCURACY: Accuracy = Accuracy::FAST;
/// What messages call a scene that came in a request.
const SOURCE: &str = "scene";

/// A scene to be tried, and the touch to try it with.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[schema(examples(json!({"x_px": 960, "y_px": 640, "moves": {"support[1]": {"x_mm": 40, "y_mm": 30}}})))]
#[serde(deny_unknown_fields)]
pub struct PreviewRequest {
    /// In pixels of the scene's screen, from its left edge: 0 to its `width_px`.
    pub x_px: f64,
    /// From its top edge: 0 to its `height_px`.
    pub y_px: f64,
    /// Peak wanted in g; 0.5 if not given.
    pub intensity_g: Option<f64>,
    /// A whole scene file (TOML) as text; the daemon's own if not given.
    pub scene: Option<String>,
    /// Attachments to be moved, by their names in messages: `support[2]` is the second support of the file. What is moved stays
    /// within the surface.
    #[serde(default)]
    pub moves: BTreeMap<String, Place>,
}

/// What the scene would do.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Preview {
    /// The plan for the touch, with its error bound.
    pub plan: PlanView,
    /// Its field.
    pub field: FieldView,
    /// The scene with the moves, as a page draws it.
    pub scene: SceneView,
    /// The scene file with the moves; everything else in it stays as it is.
    pub scene_toml: String,
    /// Relative tolerance that the model was made for; `plan.error_bound` says what it is right to.
    pub tolerance: f64,
    /// Time from scene to field in ms, waiting left out.
    pub elapsed_ms: f64,
}

/// Lets one preview at a time through.
#[derive(Debug)]
pub struct Previews {
    /// The daemon's own scene.
    own: String,
    /// Held while a preview is computed.
    turn: Arc<Mutex<()>>,
    /// Number of the newest request.
    newest: watch::Sender<u64>,
}

impl Previews {
    /// For a daemon whose scene file has this text.
    #[must_use]
    pub fn new(own: String) -> Self {
        Self { own, turn: Arc::default(), newest: watch::channel(0).0 }
    }

    /// Computes a preview once it is its turn.
    ///
    /// # Errors
    /// [`Problem`]: what is wrong with the request, or `superseded` if a newer one came while it waited.
    pub async fn preview(&self, request: PreviewRequest) -> Result<Preview, Problem> {
        let mut newest = self.newest.subscribe();
        let mut mine = 0;
        self.newest.send_modify(|number| {
            *number += 1;
            mine = *number;
        });
        let turn = tokio::select! {
            // A turn that has come is taken: pages that ask again and again do not push each other out for ever.
            biased;
            turn = Arc::clone(&self.turn).lock_owned() => turn,
            () = newer(&mut newest, mine) => return Err(superseded()),
        };
        let text = self.text(&request);
        beside(move || {
            // Until the work is done, also if nobody waits for it any more.
            let _turn = turn;
            compute(&request, &text)
        })
        .await
    }

    /// The plan of a preview, without waiting for its turn: for work that there is one of at a time.
    ///
    /// # Errors
    /// [`Problem`]: what is wrong with the request.
    pub async fn planned(&self, request: PreviewRequest) -> Result<Planned, Problem> {
        let text = self.text(&request);
        beside(move || planned(&request, &text)).await
    }

    /// The scene that a request is of.
    fn text(&self, request: &PreviewRequest) -> String {
        request.scene.clone().unwrap_or_else(|| self.own.clone())
    }
}

/// Computes in a thread of its own, so that nothing else of the daemon waits for it.
async fn beside<T: Send + 'static>(work: impl FnOnce() -> Result<T, Problem> + Send + 'static) -> Result<T, Problem> {
    tokio::task::spawn_blocking(work).await.map_err(|error| {
        let detail = format!("the preview ended early: {error}");
        Problem::new(Kind::PreviewFailed, detail)
    })?
}

/// Resolves when there is a newer request than `mine`.
async fn newer(newest: &mut watch::Receiver<u64>, mine: u64) {
    if newest.wait_for(|number| *number > mine).await.is_err() {
        // The sender is gone with the daemon; whoever still waits gets a turn.
        std::future::pending::<()>().await;
    }
}

fn superseded() -> Problem {
    let detail = "a newer preview was asked for while this one waited";
    Problem::new(Kind::PreviewSuperseded, detail)
}

/// A changed scene with the plan for a touch.
#[derive(Debug)]
pub struct Planned {
    /// Its table, with the scene.
    pub table: PlanTable,
    /// The plan.
    pub plan: Plan,
    /// The scene file with the moves.
    scene_toml: String,
}

fn planned(request: &PreviewRequest, text: &str) -> Result<Planned, Problem> {
    if text.len() > MAX_SCENE {
        return Err(too_large("scene", text.len(), "bytes", MAX_SCENE, None));
    }
    let attachments = Attachments::of(text);
    let scene_toml = attachments.moved(&request.moves)?;
    let scene = Scene::parse(SOURCE, &scene_toml)?;
    check(&scene, &attachments)?;
    let (x_m, y_m) = scene.place_px(request.x_px, request.y_px)?.xy_m();
    let target = Target { x_m, y_m, intensity_g: request.intensity_g };
    let options = TableOptions::preview();
    check_unknowns(&scene, attachments.count())?;
    let planned = |levels: Levels| -> Result<_, Problem> {
        let table = PlanTable::with_levels(&scene, levels, options)?;
        let plan = table.plan(&[target])?;
        Ok((table, plan))
    };
    // A first try takes half the time of the levels that the daemon itself plans with, and is right to 3e-3 on the
    // example plate while a corner support is dragged inwards.
    let (mut table, mut plan) = planned(Levels::of_order(&scene, ACCURACY.order(), options.to_hz)?)?;
    if plan.error_bound.is_none_or(|bound| bound > ACCURACY.value()) {
        (table, plan) = planned(Levels::build(&scene, ACCURACY, options.to_hz)?)?;
    }
    Ok(Planned { table, plan, scene_toml })
}

fn compute(request: &PreviewRequest, text: &str) -> Result<Preview, Problem> {
    let started = Instant::now();
    let Planned { table, plan, scene_toml } = planned(request, text)?;
    let field = FieldView::new(&table, Some(&plan), 0);
    Ok(Preview {
        scene: SceneView::new(&table.scene),
        plan: PlanView::new(&table, plan),
        field,
        scene_toml,
        tolerance: ACCURACY.value(),
        elapsed_ms: started.elapsed().as_secs_f64() * 1e3,
    })
}

/// The same for a scene's text.
///
/// # Errors
/// [`Problem`] that says what is too much.
pub(super) fn check_size(scene: &Scene, text: &str) -> Result<(), Problem> {
    check(scene, &Attachments::of(text))?;
    check_unknowns(scene, scene.supports.len() + scene.masses.len() + scene.actuators.len())
}

fn check_unknowns(scene: &Scene, attachments: usize) -> Result<(), Problem> {
    let expected = Levels::expected_unknowns(scene, ACCURACY, TableOptions::preview().to_hz)?;
    #[expect(clippy::cast_precision_loss, reason = "at most 32")]
    let most = MAX_UNKNOWNS.min((MAX_PRODUCT / attachments.max(1) as f64).floor());
    if expected > most { Err(too_large("surface", expected, "unknowns", most, None)) } else { Ok(()) }
}

/// What no plan can be made of, or too much would have to be computed for, is told with its line before that is tried.
fn check(scene: &Scene, attachments: &Attachments<'_>) -> Result<(), Problem> {
    if scene.actuators.len() > MAX_ACTUATORS {
        let line = attachments.line("actuator", MAX_ACTUATORS + 1);
        return Err(too_large("actuator", scene.actuators.len(), "actuators", MAX_ACTUATORS, line));
    }
    if attachments.count() > MAX_ATTACHMENTS {
        let what = "supports, masses and actuators";
        return Err(too_large("scene", attachments.count(), what, MAX_ATTACHMENTS, None));
    }
    Ok(())
}

/// More than is computed here; `line` is that of the scene's text.
pub(super) fn too_large<T: std::fmt::Display + Into<serde_json::Value>>(
    field: &str,
    value: T,
    unit: &str,
    most: T,
    line: Option<usize>,
) -> Problem {
    let place = line.map_or_else(String::new, |line| format!("{SOURCE}:{line}: "));
    let detail =
        format!("{place}{field} has {value} {unit}, but the daemon takes at most {most} for what is not driven");
    let allowed = format!("at most {most} {unit}");
    Problem::new(Kind::TooLarge, detail).at(field, value.into(), allowed, line)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::EXAMPLE_PLATE;

    fn request(x_px: f64) -> PreviewRequest {
        PreviewRequest { x_px, y_px: 300.0, intensity_g: None, scene: None, moves: BTreeMap::new() }
    }

    /// One is computed, one waits: a third takes the place of the one that waits, never of the one that is computed.
    #[test]
    fn a_newer_request_supersedes_the_one_that_waits() {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(async {
            let previews = Arc::new(Previews::new(EXAMPLE_PLATE.into()));
            let held = Arc::clone(&previews.turn).lock_owned().await;
            let ask = |x_px| {
                let previews = Arc::clone(&previews);
                tokio::spawn(async move { previews.preview(request(x_px)).await })
            };
            let mut seen = previews.newest.subscribe();
            let older = ask(100.0);
            seen.wait_for(|number| *number == 1).await.unwrap();
            let newer = ask(960.0);
            let problem = older.await.unwrap().unwrap_err();
            assert!(problem.detail().contains("newer"), "{}", problem.detail());
            assert!(!newer.is_finished());
            drop(held);
            let preview = newer.await.unwrap().unwrap();
            assert_eq!(serde_json::to_value(&preview).unwrap()["plan"]["target_mm"][0], 150.0);
            // Nothing is left behind: the next one has its turn at once.
            previews.preview(request(960.0)).await.unwrap();
        });
    }
}
