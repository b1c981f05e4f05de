//! What a page declares: its controls as they come, and the same once they have been checked.

use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::touch::check::check_intensity_range;
use crate::daemon::touch::request::MAX_INTENSITY_G;
use crate::scene::Screen;
use serde::Deserialize;
use serde_json::Value;
use utoipa::ToSchema;

/// Most controls of one page: a keyboard has some 50 keys. So many fit into the longest message.
pub const MOST_CONTROLS: usize = 64;
/// Least side or radius in px: what is smaller is no place for a finger.
const LEAST_SIZE_PX: f64 = 1.0;
/// Largest one, and the highest speed in px/s: far more than any screen has, and far from where floats lose pixels.
const MOST_PX: f64 = 1e6;
/// Most positions of a slider.
const MOST_SLIDER_DETENTS: u32 = 200;
/// Most positions of a dial: one for each degree.
const MOST_DIAL_DETENTS: u32 = 360;
/// Fewest positions: between one and itself nothing is passed.
const LEAST_DETENTS: u32 = 2;
/// Strength of a control that says nothing of it, in g: that of a touch.
const DEFAULT_INTENSITY_G: f64 = 0.5;
/// Speed in px/s at which a texture that says nothing of it is felt in full: 50 to 80 mm/s on usual screens, as fingers explore surfaces.
const DEFAULT_SPEED_PX_S: f64 = 500.0;

/// Names of numbers of a control, with the least and most that any kind takes, for the description of the interface.
pub const FIELD_RANGES: [(&str, (f64, f64)); 6] = [
    ("width_px", (LEAST_SIZE_PX, MOST_PX)),
    ("height_px", (LEAST_SIZE_PX, MOST_PX)),
    ("radius_px", (LEAST_SIZE_PX, MOST_PX)),
    ("intensity_g", (0.0, MAX_INTENSITY_G)),
    ("detents", (LEAST_DETENTS as f64, MOST_DIAL_DETENTS as f64)),
    ("speed_px_s", (1.0, MOST_PX)),
];

/// A control on the screen. Which keys it has depends on its `kind`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[schema(as = Control)]
#[serde(deny_unknown_fields)]
pub struct DeclaredControl {
    /// What the control is.
    kind: DeclaredKind,
    /// Distance of the left edge of the rectangle from the left edge of the scene's screen in pixels; of a dial, distance of its centre.
    x_px: f64,
    /// Distance of the top edge of the rectangle from the top edge of the screen in pixels; of a dial, distance of its centre.
    y_px: f64,
    /// Width of the rectangle in pixels; not for a dial.
    width_px: Option<f64>,
    /// Height of the rectangle in pixels; not for a dial.
    height_px: Option<f64>,
    /// Radius of a dial in pixels.
    radius_px: Option<f64>,
    /// Peak acceleration of the strongest feedback of the control in g; 0.5 if absent.
    intensity_g: Option<f64>,
    /// Whether a toggle is on; false if absent.
    on: Option<bool>,
    /// Direction in which a slider moves; the longer side of its rectangle if absent.
    axis: Option<SliderAxis>,
    /// Number of positions: 2 to 200 along a slider, its two ends among them; 2 to 360 for each turn of a dial.
    #[serde(default, deserialize_with = "crate::whole_numbers::deserialize_whole_number_or_null")]
    detents: Option<u32>,
    /// Speed of the finger in pixels per second at which a texture has its full intensity; 500 if absent.
    speed_px_s: Option<f64>,
}

/// What a control is.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, ToSchema)]
#[schema(as = ControlKind)]
#[serde(rename_all = "lowercase")]
enum DeclaredKind {
    /// Clicks when it is pressed, and more weakly when it is released.
    Button,
    /// Changes between off and on at each press; the two states feel different.
    Toggle,
    /// A rectangle with detents along one axis.
    Slider,
    /// A circle with detents around its centre.
    Dial,
    /// A rectangle whose border is felt.
    Edge,
    /// A rectangle that vibrates under a moving finger.
    Texture,
}

/// The axis along which a slider moves.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum SliderAxis {
    /// From left to right.
    X,
    /// From top to bottom.
    Y,
}

/// A control that has been checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Control {
    /// Where it is, and what it is there.
    pub shape: Shape,
    /// Peak of its strongest feedback in g.
    pub intensity_g: f64,
    /// Of a toggle: its state.
    pub is_on: bool,
}

/// Where a control is, and what it is there: two controls with the same shape are the same control.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "documented at DeclaredControl")]
pub enum Shape {
    Button(Rectangle),
    Toggle(Rectangle),
    Slider { area: Rectangle, axis: SliderAxis, detents: u32 },
    Dial { x_px: f64, y_px: f64, radius_px: f64, detents: u32 },
    Edge(Rectangle),
    Texture { area: Rectangle, speed_px_s: f64 },
}

/// A rectangle on the screen, in px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Its left edge.
    pub x: f64,
    /// Its top edge.
    pub y: f64,
    /// Its width.
    pub width: f64,
    /// Its height.
    pub height: f64,
}

impl Rectangle {
    /// Whether a place is in it, its border included.
    #[must_use]
    pub fn contains(&self, x: f64, y: f64) -> bool {
        self.signed_distance_inside_border_px(x, y) >= 0.0
    }

    /// How far a place is inside of the border, along the axis on which it is the least; outside, it is negative.
    #[must_use]
    pub fn signed_distance_inside_border_px(&self, x: f64, y: f64) -> f64 {
        let depth = |at: f64, start: f64, length: f64| (at - start).min(start + length - at);
        depth(x, self.x, self.width).min(depth(y, self.y, self.height))
    }
}

impl Control {
    /// Whether a place is on it.
    #[must_use]
    pub fn contains(&self, x: f64, y: f64) -> bool {
        match self.shape {
            Shape::Button(area)
            | Shape::Toggle(area)
            | Shape::Edge(area)
            | Shape::Slider { area, .. }
            | Shape::Texture { area, .. } => area.contains(x, y),
            Shape::Dial { x_px, y_px, radius_px, .. } => (x - x_px).hypot(y - y_px) <= radius_px,
        }
    }
}

/// The controls of a page.
///
/// # Errors
/// [`Problem`] that names the first field that is wrong, such as `controls[3].detents`, with its value and its range.
pub fn check_controls(declared: &[DeclaredControl], screen: &Screen) -> Result<Vec<Control>, Problem> {
    if declared.len() > MOST_CONTROLS {
        let detail = format!(
            "controls has {} entries, but must have at most {MOST_CONTROLS}: the daemon ignores the whole list",
            declared.len()
        );
        let allowed = format!("at most {MOST_CONTROLS} entries");
        let problem = Problem::new(ProblemKind::OutOfRange, detail);
        return Err(problem.with_field_and_value("controls", declared.len().into(), allowed, None));
    }
    let check = |(i, control): (usize, &DeclaredControl)| {
        control
            .check_all_keys_and_convert_to_control(screen)
            .map_err(|problem| problem.prefix_field_and_detail_if_prefix_given(Some(format!("controls[{i}]"))))
    };
    declared.iter().enumerate().map(check).collect()
}

impl DeclaredControl {
    fn check_all_keys_and_convert_to_control(&self, screen: &Screen) -> Result<Control, Problem> {
        self.refuse_keys_of_other_kinds()?;
        check_intensity_range(self.intensity_g)?;
        let shape = match self.kind {
            DeclaredKind::Button => Shape::Button(self.build_rectangle_if_large_enough_and_reaching_screen(screen)?),
            DeclaredKind::Toggle => Shape::Toggle(self.build_rectangle_if_large_enough_and_reaching_screen(screen)?),
            DeclaredKind::Edge => Shape::Edge(self.build_rectangle_if_large_enough_and_reaching_screen(screen)?),
            DeclaredKind::Slider => {
                let area = self.build_rectangle_if_large_enough_and_reaching_screen(screen)?;
                let longer = if area.height > area.width { SliderAxis::Y } else { SliderAxis::X };
                let detents = self.check_detents(MOST_SLIDER_DETENTS)?;
                Shape::Slider { area, axis: self.axis.unwrap_or(longer), detents }
            }
            DeclaredKind::Dial => {
                let radius_px = self.require_number_from_least_to_max_px("radius_px", self.radius_px, LEAST_SIZE_PX)?;
                self.require_overlap_with_screen(screen, [radius_px; 2], [radius_px; 2])?;
                let detents = self.check_detents(MOST_DIAL_DETENTS)?;
                Shape::Dial { x_px: self.x_px, y_px: self.y_px, radius_px, detents }
            }
            DeclaredKind::Texture => {
                let area = self.build_rectangle_if_large_enough_and_reaching_screen(screen)?;
                let speed_px_s = self.speed_px_s.unwrap_or(DEFAULT_SPEED_PX_S);
                Shape::Texture { area, speed_px_s: check_number_from_least_to_max_px("speed_px_s", speed_px_s, 1.0)? }
            }
        };
        let intensity_g = self.intensity_g.unwrap_or(DEFAULT_INTENSITY_G);
        Ok(Control { shape, intensity_g, is_on: self.on.unwrap_or(false) })
    }

    fn build_rectangle_if_large_enough_and_reaching_screen(&self, screen: &Screen) -> Result<Rectangle, Problem> {
        let width = self.require_number_from_least_to_max_px("width_px", self.width_px, LEAST_SIZE_PX)?;
        let height = self.require_number_from_least_to_max_px("height_px", self.height_px, LEAST_SIZE_PX)?;
        self.require_overlap_with_screen(screen, [width, height], [0.0; 2])?;
        Ok(Rectangle { x: self.x_px, y: self.y_px, width, height })
    }

    /// That a finger on the screen can be on it: from its place, it reaches so far back to the screen's left and top edge (`max_px_left_of_and_above_screen`), and may begin
    /// so far behind the others (`max_px_right_of_and_below_screen`).
    fn require_overlap_with_screen(
        &self,
        screen: &Screen,
        max_px_left_of_and_above_screen: [f64; 2],
        max_px_right_of_and_below_screen: [f64; 2],
    ) -> Result<(), Problem> {
        let sides = [screen.width_px, screen.height_px].map(f64::from);
        let fields = [("x_px", self.x_px), ("y_px", self.y_px)];
        for (((field, value), side), (before, behind)) in fields
            .into_iter()
            .zip(sides)
            .zip(max_px_left_of_and_above_screen.into_iter().zip(max_px_right_of_and_below_screen))
        {
            if !(-before..=side + behind).contains(&value) {
                return Err(Problem::out_of_range(field, value, -before, side + behind));
            }
        }
        Ok(())
    }

    fn check_detents(&self, most: u32) -> Result<u32, Problem> {
        let detents = self.detents.ok_or_else(|| self.missing_key_problem("detents"))?;
        if (LEAST_DETENTS..=most).contains(&detents) {
            Ok(detents)
        } else {
            Err(Problem::out_of_range("detents", detents.into(), LEAST_DETENTS, most))
        }
    }

    fn require_number_from_least_to_max_px(&self, field: &str, value: Option<f64>, least: f64) -> Result<f64, Problem> {
        check_number_from_least_to_max_px(field, value.ok_or_else(|| self.missing_key_problem(field))?, least)
    }

    fn missing_key_problem(&self, field: &str) -> Problem {
        Problem::bad_body(format!("{field} is missing: {} must have this key", self.kind.name_with_article()))
            .with_field(field.to_owned())
    }

    /// A key that does nothing would hide a mistake.
    fn refuse_keys_of_other_kinds(&self) -> Result<(), Problem> {
        let (is_dial, is_slider) = (self.kind == DeclaredKind::Dial, self.kind == DeclaredKind::Slider);
        let keys = [
            ("width_px", self.width_px.map(Value::from), !is_dial),
            ("height_px", self.height_px.map(Value::from), !is_dial),
            ("radius_px", self.radius_px.map(Value::from), is_dial),
            ("on", self.on.map(Value::from), self.kind == DeclaredKind::Toggle),
            ("axis", self.axis.map(|axis| axis.name().into()), is_slider),
            ("detents", self.detents.map(Value::from), is_slider || is_dial),
            ("speed_px_s", self.speed_px_s.map(Value::from), self.kind == DeclaredKind::Texture),
        ];
        let wrong = keys.into_iter().find_map(|(key, value, is_own)| Some((key, value.filter(|_| !is_own)?)));
        let Some((key, value)) = wrong else { return Ok(()) };
        let kind = self.kind.name_with_article();
        let problem = Problem::bad_body(format!("{key} is {value}, but {kind} does not have this key: remove the key"));
        Err(problem.with_field_and_value(key, value, format!("absent, because {kind} does not have this key"), None))
    }
}

fn check_number_from_least_to_max_px(field: &str, value: f64, least: f64) -> Result<f64, Problem> {
    if (least..=MOST_PX).contains(&value) {
        Ok(value)
    } else {
        Err(Problem::out_of_range(field, value, least, MOST_PX))
    }
}

impl DeclaredKind {
    const fn name_with_article(self) -> &'static str {
        match self {
            Self::Button => "a button",
            Self::Toggle => "a toggle",
            Self::Slider => "a slider",
            Self::Dial => "a dial",
            Self::Edge => "an edge",
            Self::Texture => "a texture",
        }
    }
}

impl SliderAxis {
    const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const SCREEN: Screen =
        Screen { width_px: 1920, height_px: 1280, x_m: 0.0, y_m: 0.0, width_m: 0.24, height_m: 0.16 };

    fn check_controls_from_json(declared: &[Value]) -> Result<Vec<Control>, Problem> {
        let declared: Vec<DeclaredControl> =
            declared.iter().map(|one| serde_json::from_str(&one.to_string()).unwrap()).collect();
        check_controls(&declared, &SCREEN)
    }

    fn make_control_json(kind: &str, more: &Value) -> Value {
        let mut control = match kind {
            "dial" => json!({"x_px": 900, "y_px": 600, "radius_px": 100, "detents": 24}),
            "slider" => json!({"x_px": 100, "y_px": 100, "width_px": 400, "height_px": 60, "detents": 11}),
            _ => json!({"x_px": 100, "y_px": 100, "width_px": 400, "height_px": 60}),
        };
        control["kind"] = kind.into();
        control.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        control
    }

    #[test]
    fn each_kind_has_its_defaults() {
        let kinds = ["button", "toggle", "slider", "dial", "edge", "texture"];
        let controls = check_controls_from_json(&kinds.map(|kind| make_control_json(kind, &json!({})))).unwrap();
        let area = Rectangle { x: 100.0, y: 100.0, width: 400.0, height: 60.0 };
        let shapes = [
            Shape::Button(area),
            Shape::Toggle(area),
            Shape::Slider { area, axis: SliderAxis::X, detents: 11 },
            Shape::Dial { x_px: 900.0, y_px: 600.0, radius_px: 100.0, detents: 24 },
            Shape::Edge(area),
            Shape::Texture { area, speed_px_s: 500.0 },
        ];
        assert_eq!(controls, shapes.map(|shape| Control { shape, intensity_g: 0.5, is_on: false }));
        let upright =
            check_controls_from_json(&[make_control_json("slider", &json!({"width_px": 60, "height_px": 400}))])
                .unwrap();
        assert!(matches!(upright[0].shape, Shape::Slider { axis: SliderAxis::Y, .. }));
        let across =
            check_controls_from_json(&[make_control_json("slider", &json!({"axis": "y", "detents": 200.0}))]).unwrap();
        assert!(matches!(across[0].shape, Shape::Slider { axis: SliderAxis::Y, detents: 200, .. }));
        assert!(
            check_controls_from_json(&[make_control_json("toggle", &json!({"on": true, "intensity_g": 0}))]).unwrap()
                [0]
            .is_on
        );
        assert_eq!(check_controls_from_json(&[]).unwrap(), []);
        // What reaches onto the screen from outside.
        check_controls_from_json(&[
            make_control_json("edge", &json!({"x_px": -399, "y_px": 1279})),
            make_control_json("dial", &json!({"x_px": -99})),
        ])
        .unwrap();
    }

    #[test]
    fn what_is_wrong_is_named_with_its_value_and_range() {
        for (kind, more, field, allowed) in [
            ("slider", json!({"detents": 1}), "detents", "2 to 200"),
            ("slider", json!({"detents": 201}), "detents", "2 to 200"),
            ("dial", json!({"detents": 361}), "detents", "2 to 360"),
            ("dial", json!({"radius_px": 0.5}), "radius_px", "1 to 1000000"),
            ("dial", json!({"x_px": 2021}), "x_px", "-100 to 2020"),
            ("button", json!({"width_px": 0}), "width_px", "1 to 1000000"),
            ("button", json!({"height_px": 1e7}), "height_px", "1 to 1000000"),
            ("button", json!({"x_px": -401}), "x_px", "-400 to 1920"),
            ("edge", json!({"y_px": 1281}), "y_px", "-60 to 1280"),
            ("button", json!({"intensity_g": -0.1}), "intensity_g", "0 to 1000"),
            ("texture", json!({"speed_px_s": 0}), "speed_px_s", "1 to 1000000"),
            ("button", json!({"detents": 5}), "detents", "absent, because a button does not have this key"),
            ("slider", json!({"on": false}), "on", "absent, because a slider does not have this key"),
            ("dial", json!({"axis": "x"}), "axis", "absent, because a dial does not have this key"),
            ("edge", json!({"radius_px": 5}), "radius_px", "absent, because an edge does not have this key"),
        ] {
            let problem =
                check_controls_from_json(&[make_control_json("button", &json!({})), make_control_json(kind, &more)])
                    .unwrap_err();
            let told = serde_json::to_value(&problem).unwrap();
            assert_eq!(told["field"], format!("controls[1].{field}"), "{told}");
            assert_eq!((told["value"].as_f64(), &told["allowed"]), (more[field].as_f64(), &json!(allowed)), "{told}");
            assert!(problem.detail().starts_with(&format!("controls[1].{field} is ")), "{told}");
        }
        for (control, field) in [
            (json!({"kind": "button", "x_px": 1, "y_px": 1, "width_px": 9}), "height_px"),
            (json!({"kind": "dial", "x_px": 1, "y_px": 1, "detents": 9}), "radius_px"),
            (json!({"kind": "slider", "x_px": 1, "y_px": 1, "width_px": 9, "height_px": 9}), "detents"),
        ] {
            let problem = check_controls_from_json(&[control]).unwrap_err();
            assert!(
                problem.detail().starts_with(&format!("controls[0].{field} is missing: a")),
                "{}",
                problem.detail()
            );
        }
        let problem =
            check_controls_from_json(&vec![make_control_json("button", &json!({})); MOST_CONTROLS + 1]).unwrap_err();
        assert!(
            problem.detail().starts_with("controls has 65 entries, but must have at most 64"),
            "{}",
            problem.detail()
        );
    }

    #[test]
    fn the_border_is_a_part_of_a_control() {
        let area = Rectangle { x: 10.0, y: 20.0, width: 30.0, height: 40.0 };
        for (x, y, depth_px) in
            [(10.0, 20.0, 0.0), (40.0, 60.0, 0.0), (25.0, 40.0, 15.0), (9.0, 40.0, -1.0), (25.0, 65.0, -5.0)]
        {
            assert_eq!(
                (area.signed_distance_inside_border_px(x, y), area.contains(x, y)),
                (depth_px, depth_px >= 0.0),
                "{x}, {y}"
            );
        }
        let dial = Shape::Dial { x_px: 0.0, y_px: 0.0, radius_px: 5.0, detents: 2 };
        let dial = Control { shape: dial, intensity_g: 0.5, is_on: false };
        assert!(dial.contains(3.0, 4.0) && !dial.contains(4.0, 4.0));
    }
}
