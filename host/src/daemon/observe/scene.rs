//! The scene as a page draws it.

use crate::scene::{Mount, Scene, Side, SurfaceKind};
use axum::body::Bytes;
use axum::extract::ws::Utf8Bytes;
use serde::Serialize;
use utoipa::ToSchema;

/// The scene as it is sent, made once: it does not change while the daemon runs.
#[derive(Clone, Debug)]
pub struct SceneTexts {
    /// To whoever asks for it.
    pub answer: Bytes,
    /// To pages, as a message of the type `scene`.
    pub message: Utf8Bytes,
}

impl SceneTexts {
    /// Of this scene.
    #[must_use]
    pub fn new(scene: &SceneView) -> Self {
        // As the live socket's `LiveMessage::Scene`, whose file imports this one.
        #[derive(Serialize)]
        struct SceneMessage<'a> {
            #[serde(rename = "type")]
            kind: &'static str,
            #[serde(flatten)]
            scene: &'a SceneView,
        }
        let answer = serde_json::to_vec(scene).unwrap_or_default().into();
        let message = serde_json::to_string(&SceneMessage { kind: "scene", scene }).unwrap_or_default().into();
        Self { answer, message }
    }
}

/// The scene, as a page draws it.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Scene)]
pub struct SceneView {
    /// Its name.
    name: String,
    /// Plate or bar.
    kind: SurfaceKind,
    /// Along x in mm.
    length_mm: f64,
    /// Along y in mm.
    width_mm: f64,
    /// In mm.
    thickness_mm: f64,
    /// Where its pixels are.
    screen: ScreenView,
    /// Places of other thickness.
    patches: Vec<PatchView>,
    /// Holes.
    cutouts: Vec<RectangleView>,
    /// Springs to ground.
    supports: Vec<SupportView>,
    /// Sides that are held.
    edges: Vec<EdgeView>,
    /// Masses on the surface.
    masses: Vec<MassView>,
    /// Actuators, in the order of the board's channels.
    actuators: Vec<ActuatorView>,
    /// What the scene says of the finger that touches, which is in no plan of the daemon; null where it says nothing.
    finger: Option<FingerView>,
    /// Depth of the sealed cavity behind the panel in mm; null where there is none.
    sealed_depth_mm: Option<f64>,
    /// Mass of the air that moves with the surface in kg/m^2.
    added_mass_kg_per_m2: f64,
}

/// A screen's pixels on the surface.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Screen)]
struct ScreenView {
    /// Pixels from left to right.
    width_px: u32,
    /// Pixels from top to bottom.
    height_px: u32,
    /// Its left edge, from the surface's, in mm.
    x_mm: f64,
    /// Its top edge, from the surface's, in mm.
    y_mm: f64,
    /// In mm.
    width_mm: f64,
    /// In mm.
    height_mm: f64,
}

/// A rectangle on the surface.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Rectangle)]
struct RectangleView {
    /// Its left edge in mm.
    x_mm: f64,
    /// Its top edge in mm.
    y_mm: f64,
    /// Along x in mm.
    length_mm: f64,
    /// Along y in mm.
    width_mm: f64,
}

/// A place of another thickness.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Patch)]
struct PatchView {
    /// Where.
    #[serde(flatten)]
    place: RectangleView,
    /// In mm.
    thickness_mm: f64,
}

/// A spring to ground.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Support)]
struct SupportView {
    /// From the left edge in mm.
    x_mm: f64,
    /// From the top edge in mm.
    y_mm: f64,
    /// In N/m.
    stiffness_n_per_m: f64,
    /// Of its springs: 0 for none.
    loss_factor: f64,
}

/// A side that is held.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Edge)]
struct EdgeView {
    /// Which.
    side: Side,
    /// How, as scene files say it.
    kind: &'static str,
    /// Of an elastic edge's springs: 0 for none.
    loss_factor: f64,
}

/// A mass on the surface.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Mass)]
struct MassView {
    /// From the left edge in mm.
    x_mm: f64,
    /// From the top edge in mm.
    y_mm: f64,
    /// In grams.
    mass_g: f64,
}

/// What a finger is to the place that it touches.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = FingerLoad)]
struct FingerView {
    /// In grams.
    mass_g: f64,
    /// In N s/m.
    damping_n_s_per_m: f64,
    /// In N/m.
    stiffness_n_per_m: f64,
}

/// An actuator.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Actuator)]
struct ActuatorView {
    /// Its name.
    id: String,
    /// From the left edge in mm.
    x_mm: f64,
    /// From the top edge in mm.
    y_mm: f64,
    /// How it is mounted.
    mount: Mount,
    /// Most voltage in V.
    max_voltage_v: f64,
    /// Of a round electrode of its area, in mm.
    electrode_diameter_mm: f64,
    /// Of what hangs on each electrode beside it, its cable and its switches, in pF.
    cable_capacitance_pf: f64,
    /// Time constant in ms with which an electrode charges; 0: at once.
    charging_ms: f64,
    /// Time constant in ms with which an electrode discharges; 0: at once.
    discharging_ms: f64,
}

fn to_mm(metres: f64) -> f64 {
    metres * 1e3
}

impl RectangleView {
    fn new(x_m: f64, y_m: f64, length_m: f64, width_m: f64) -> Self {
        Self { x_mm: to_mm(x_m), y_mm: to_mm(y_m), length_mm: to_mm(length_m), width_mm: to_mm(width_m) }
    }
}

impl SceneView {
    /// The view of `scene`.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let (surface, screen) = (&scene.surface, &scene.screen);
        let patch = |p: &crate::scene::Patch| PatchView {
            place: RectangleView::new(p.x_m, p.y_m, p.length_m, p.width_m),
            thickness_mm: to_mm(p.thickness_m),
        };
        let support = |s: &crate::scene::Support| SupportView {
            x_mm: to_mm(s.x_m),
            y_mm: to_mm(s.y_m),
            stiffness_n_per_m: s.stiffness_n_per_m,
            loss_factor: s.loss_factor,
        };
        let actuator = |a: &crate::scene::Actuator| ActuatorView {
            id: a.id.clone(),
            x_mm: to_mm(a.x_m),
            y_mm: to_mm(a.y_m),
            mount: a.mount,
            max_voltage_v: a.max_voltage_v,
            electrode_diameter_mm: to_mm(2.0 * (a.electrode_area_m2 / std::f64::consts::PI).sqrt()),
            cable_capacitance_pf: a.cable_capacitance_f * 1e12,
            charging_ms: a.charging.rise_s * 1e3,
            discharging_ms: a.charging.fall_s * 1e3,
        };
        Self {
            name: scene.name.clone(),
            kind: surface.kind,
            length_mm: to_mm(surface.length_m),
            width_mm: to_mm(surface.width_m),
            thickness_mm: to_mm(surface.thickness_m),
            screen: ScreenView {
                width_px: screen.width_px,
                height_px: screen.height_px,
                x_mm: to_mm(screen.x_m),
                y_mm: to_mm(screen.y_m),
                width_mm: to_mm(screen.width_m),
                height_mm: to_mm(screen.height_m),
            },
            patches: scene.patches.iter().map(patch).collect(),
            cutouts: scene.cutouts.iter().map(|c| RectangleView::new(c.x_m, c.y_m, c.length_m, c.width_m)).collect(),
            supports: scene.supports.iter().map(support).collect(),
            edges: scene
                .edges
                .iter()
                .map(|e| EdgeView { side: e.side, kind: e.kind.name(), loss_factor: e.kind.spring_loss_factor() })
                .collect(),
            masses: scene
                .masses
                .iter()
                .map(|m| MassView { x_mm: to_mm(m.x_m), y_mm: to_mm(m.y_m), mass_g: m.mass_kg * 1e3 })
                .collect(),
            actuators: scene.actuators.iter().map(actuator).collect(),
            finger: scene.finger.map(|finger| FingerView {
                mass_g: finger.mass_kg * 1e3,
                damping_n_s_per_m: finger.damping_n_s_per_m,
                stiffness_n_per_m: finger.stiffness_n_per_m,
            }),
            sealed_depth_mm: scene.sealed_depth_m.map(to_mm),
            added_mass_kg_per_m2: surface.added_mass_kg_per_m2,
        }
    }
}
