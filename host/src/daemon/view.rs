//! What goes out as JSON.

use super::thin::Thinned;
use crate::device::convert::from_wire;
use crate::device::session::Played;
use crate::effects::{self, Design, NamedEffect};
use crate::planner::{Plan, PlanTable, STANDARD_GRAVITY, Times};
use crate::scene::Scene;
use era_shared::protocol::AchievedDrive;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// One finger.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchView {
    /// The page's number for it.
    #[serde(default)]
    pub id: i64,
    /// In pixels of the scene's screen.
    pub x_px: f64,
    /// In pixels of the scene's screen.
    pub y_px: f64,
    /// Peak wanted for it alone, in g.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity_g: Option<f64>,
    /// Played when it goes down; one panel plays one effect, the first finger's that has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<NamedEffect>,
}

/// The scene as a page draws it.
#[derive(Clone, Debug, Serialize)]
pub struct SceneView(Value);

impl SceneView {
    /// The view of `scene`.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let (surface, screen) = (&scene.surface, &scene.screen);
        let mm = |metres: f64| metres * 1e3;
        let supports: Vec<_> = scene
            .supports
            .iter()
            .map(|s| json!({"x_mm": mm(s.x_m), "y_mm": mm(s.y_m), "stiffness_n_per_m": s.stiffness_n_per_m}))
            .collect();
        let edges: Vec<_> = scene.edges.iter().map(|e| json!({"side": e.side, "kind": e.kind.name()})).collect();
        let masses: Vec<_> = scene
            .masses
            .iter()
            .map(|m| json!({"x_mm": mm(m.x_m), "y_mm": mm(m.y_m), "mass_g": m.mass_kg * 1e3}))
            .collect();
        let rectangle = |x: f64, y: f64, length: f64, width: f64| json!({"x_mm": mm(x), "y_mm": mm(y), "length_mm": mm(length), "width_mm": mm(width)});
        let patches: Vec<_> = scene
            .patches
            .iter()
            .map(|p| {
                let mut patch = rectangle(p.x_m, p.y_m, p.length_m, p.width_m);
                patch["thickness_mm"] = json!(mm(p.thickness_m));
                patch
            })
            .collect();
        let cutouts: Vec<_> = scene.cutouts.iter().map(|c| rectangle(c.x_m, c.y_m, c.length_m, c.width_m)).collect();
        let actuators: Vec<_> = scene
            .actuators
            .iter()
            .map(|a| {
                json!({
                    "id": a.id, "x_mm": mm(a.x_m), "y_mm": mm(a.y_m), "mount": a.mount,
                    "max_voltage_v": a.max_voltage_v,
                    "electrode_diameter_mm": mm(2.0 * (a.electrode_area_m2 / std::f64::consts::PI).sqrt()),
                })
            })
            .collect();
        Self(json!({
            "name": scene.name, "kind": surface.kind,
            "length_mm": mm(surface.length_m), "width_mm": mm(surface.width_m), "thickness_mm": mm(surface.thickness_m),
            "screen": {
                "width_px": screen.width_px, "height_px": screen.height_px,
                "x_mm": mm(screen.x_m), "y_mm": mm(screen.y_m),
                "width_mm": mm(screen.width_m), "height_mm": mm(screen.height_m),
            },
            "patches": patches, "cutouts": cutouts, "supports": supports, "edges": edges, "masses": masses, "actuators": actuators,
        }))
    }
}

/// A plan as sent to clients.
#[derive(Clone, Debug, Serialize)]
pub struct PlanView {
    #[serde(flatten)]
    plan: Plan,
    /// When the first target vibrates under it, and when it has stopped.
    times: Times,
    /// What part of its forces is driven, and why, where that is not all.
    #[serde(skip_serializing_if = "Option::is_none")]
    thinned: Option<Thinned>,
}

impl PlanView {
    /// The view of `plan`, one of this table's.
    #[must_use]
    pub fn new(table: &PlanTable, plan: Plan) -> Self {
        Self { times: table.times(&plan), plan, thinned: None }
    }

    /// The same, driven with less.
    #[must_use]
    pub fn thinned(self, thinned: Option<Thinned>) -> Self {
        Self { thinned, ..self }
    }

    /// Whether the board rests in it.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.thinned == Some(Thinned::RESTS)
    }

    /// The plan itself.
    #[must_use]
    pub const fn plan(&self) -> &Plan {
        &self.plan
    }
}

/// Predicted peak acceleration over the surface.
#[derive(Clone, Debug, Serialize)]
pub struct FieldView {
    nx: usize,
    ny: usize,
    x_mm: Vec<f64>,
    y_mm: Vec<f64>,
    peak_g: Vec<Option<f64>>,
    max_g: f64,
    plan_id: u64,
}

impl FieldView {
    /// The field of `plan` on the table's grid, null in cut-outs; zeros without one.
    #[must_use]
    pub fn new(table: &PlanTable, plan: Option<&Plan>, plan_id: u64) -> Self {
        let grid = &table.grid;
        let peak_g: Vec<Option<f64>> = match plan {
            Some(plan) => table.field(plan).into_iter().map(|peak| Some(round(peak? / STANDARD_GRAVITY))).collect(),
            None => grid.there.iter().map(|there| there.then_some(0.0)).collect(),
        };
        Self {
            nx: grid.x_m.len(),
            ny: grid.y_m.len(),
            x_mm: grid.x_m.iter().map(|x| round(x * 1e3)).collect(),
            y_mm: grid.y_m.iter().map(|y| round(y * 1e3)).collect(),
            max_g: peak_g.iter().flatten().copied().fold(0.0, f64::max),
            peak_g,
            plan_id,
        }
    }
}

/// Six decimals: a map of 1600 numbers goes over the wire at every touch.
fn round(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// What the device achieves, with the actuators' names.
#[must_use]
pub fn achieved(plan: &Plan, achieved: &[AchievedDrive]) -> Value {
    let list: Vec<_> = achieved
        .iter()
        .map(|drive| {
            let si = from_wire(drive);
            let actuator = plan.drives.get(usize::from(drive.channel)).map(|drive| drive.actuator.as_str());
            json!({
                "actuator": actuator, "channel": drive.channel, "frequency_hz": si.frequency_hz,
                "voltage_v": si.voltage_v, "pulse_width": si.pulse_width, "phase_rad": si.phase_rad,
                "guard_us": f64::from(drive.guard_ns) / 1e3,
            })
        })
        .collect();
    json!({ "acknowledged": true, "achieved": list })
}

/// The same for an effect, with its design, when it begins and how long it lasts.
#[must_use]
pub fn played(plan: &Plan, design: &Design, played: &Played) -> Value {
    let mut answer = achieved(plan, &played.achieved);
    if let Some(map) = answer.as_object_mut() {
        let mut effect = effects::view::json(design);
        effect["start_board_us"] = played.start_us.into();
        let ahead = played.start.saturating_duration_since(std::time::Instant::now());
        effect["starts_in_ms"] = (ahead.as_secs_f64() * 1e3).into();
        effect["duration_ms"] = (played.length.as_secs_f64() * 1e3).into();
        map.insert("effect".into(), effect);
    }
    answer
}
