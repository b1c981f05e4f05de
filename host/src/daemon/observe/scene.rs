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

/// The scene, with the values that a page needs to draw it.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Scene)]
pub struct SceneView {
    /// Name of the scene.
    name: String,
    /// Kind of the surface: plate or bar.
    kind: SurfaceKind,
    /// Length of the surface along x in mm.
    length_mm: f64,
    /// Width of the surface along y in mm.
    width_mm: f64,
    /// Thickness of the surface in mm.
    thickness_mm: f64,
    /// The screen on the surface.
    screen: ScreenView,
    /// Rectangles with another thickness.
    patches: Vec<PatchView>,
    /// Rectangular holes.
    cutouts: Vec<RectangleView>,
    /// Springs between the surface and the ground.
    supports: Vec<SupportView>,
    /// Sides of the surface that are held.
    edges: Vec<EdgeView>,
    /// Masses on the surface.
    masses: Vec<MassView>,
    /// Actuators, in the order of the board's channels.
    actuators: Vec<ActuatorView>,
    /// The finger that the scene describes, which the plans of the daemon do not include; null if the scene describes no finger.
    finger: Option<FingerView>,
    /// Depth of the sealed cavity behind the panel in mm; null without a cavity.
    sealed_depth_mm: Option<f64>,
    /// Mass of the air that moves with the surface in kg/m^2.
    added_mass_kg_per_m2: f64,
}

/// The screen: its pixels, and its place on the surface.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Screen)]
struct ScreenView {
    /// Number of pixels from left to right.
    width_px: u32,
    /// Number of pixels from top to bottom.
    height_px: u32,
    /// Distance of the left edge of the screen from the left edge of the surface in mm.
    x_mm: f64,
    /// Distance of the top edge of the screen from the top edge of the surface in mm.
    y_mm: f64,
    /// Width of the screen in mm.
    width_mm: f64,
    /// Height of the screen in mm.
    height_mm: f64,
}

/// A rectangle on the surface.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Rectangle)]
struct RectangleView {
    /// Distance of the left edge of the rectangle from the left edge of the surface in mm.
    x_mm: f64,
    /// Distance of the top edge of the rectangle from the top edge of the surface in mm.
    y_mm: f64,
    /// Length of the rectangle along x in mm.
    length_mm: f64,
    /// Width of the rectangle along y in mm.
    width_mm: f64,
}

/// A rectangle with another thickness.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Patch)]
struct PatchView {
    /// Place of the rectangle.
    #[serde(flatten)]
    place: RectangleView,
    /// Thickness in mm.
    thickness_mm: f64,
}

/// A spring between the surface and the ground.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Support)]
struct SupportView {
    /// Distance from the left edge of the surface in mm.
    x_mm: f64,
    /// Distance from the top edge of the surface in mm.
    y_mm: f64,
    /// Stiffness in N/m.
    stiffness_n_per_m: f64,
    /// Loss factor of the spring; 0 without damping.
    loss_factor: f64,
}

/// A side of the surface that is held.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Edge)]
struct EdgeView {
    /// The side.
    side: Side,
    /// How the side is held, by the name in scene files.
    kind: &'static str,
    /// Loss factor of the springs of an elastic edge; 0 without damping.
    loss_factor: f64,
}

/// A mass on the surface.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Mass)]
struct MassView {
    /// Distance from the left edge of the surface in mm.
    x_mm: f64,
    /// Distance from the top edge of the surface in mm.
    y_mm: f64,
    /// Mass in g.
    mass_g: f64,
}

/// Mass, damping and stiffness of a finger at the touched place.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = FingerLoad)]
struct FingerView {
    /// Mass in g.
    mass_g: f64,
    /// Damping in N s/m.
    damping_n_s_per_m: f64,
    /// Stiffness in N/m.
    stiffness_n_per_m: f64,
}

/// An actuator.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Actuator)]
struct ActuatorView {
    /// Name of the actuator.
    id: String,
    /// Distance from the left edge of the surface in mm.
    x_mm: f64,
    /// Distance from the top edge of the surface in mm.
    y_mm: f64,
    /// How the actuator is mounted.
    mount: Mount,
    /// Highest voltage in V.
    max_voltage_v: f64,
    /// Diameter in mm of a round electrode with the area of the electrode.
    electrode_diameter_mm: f64,
    /// Capacitance of the cable and the switches of each electrode in pF.
    cable_capacitance_pf: f64,
    /// Time constant in ms with which an electrode charges; 0 if it charges at once.
    charging_ms: f64,
    /// Time constant in ms with which an electrode discharges; 0 if it discharges at once.
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
