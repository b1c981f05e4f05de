//! Scenes as numbers that can be turned, scaled and put in another order, and random ones.

use proptest::prelude::*;
use proptest::test_runner::{Config, TestCaseResult, TestRng, TestRunner};
use std::fmt::Write;

/// Environment variable: times as many cases.
const MORE: &str = "ERA_RELATIONS";
/// Modes and responses are asked for up to this frequency in Hz.
pub const HIGHEST_HZ: f64 = 400.0;

/// Tries `relation` on `cases` random inputs, the same ones every time (times what the variable says); panics with the smallest input that it
/// does not hold for.
pub fn assert_holds_for_random_inputs<S: Strategy>(
    cases: u32,
    inputs: S,
    relation: impl Fn(S::Value) -> TestCaseResult,
) {
    let times = std::env::var(MORE).ok().and_then(|text| text.parse::<u32>().ok()).unwrap_or(1);
    let config = Config { cases: cases * times, max_shrink_iters: 24, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(Default::default()));
    runner.run(&inputs, relation).unwrap();
}

/// How an edge is supported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeSupport {
    Free,
    Pinned,
    Clamped,
    /// Stiffness (N/m^2, or N/m at a bar's end), rotational stiffness (N/rad, or N m/rad), loss factor.
    Elastic(f64, f64, f64),
}

#[derive(Clone, Debug)]
pub struct Support {
    pub at_mm: [f64; 2],
    pub stiffness: f64,
    pub damping: f64,
    pub loss_factor: f64,
}

#[derive(Clone, Debug)]
pub struct Mass {
    pub at_mm: [f64; 2],
    pub grams: f64,
}

#[derive(Clone, Debug)]
pub struct Era {
    pub id: String,
    pub at_mm: [f64; 2],
    pub inertial: bool,
    pub moving_g: f64,
    pub stiffness: f64,
    pub damping: f64,
    pub housing_g: f64,
    pub area_mm2: f64,
    pub gap_um: f64,
    pub volts: f64,
}

/// A rectangle in mm: corner, sides.
pub type Rectangle = [f64; 4];

/// A scene, in the units of its file.
#[derive(Clone, Debug)]
pub struct Spec {
    pub is_bar: bool,
    pub size_mm: [f64; 2],
    pub thickness_mm: f64,
    pub young: f64,
    pub poisson: f64,
    pub density: f64,
    /// One of the file's keys, and its value.
    pub damping: (&'static str, f64),
    /// Left, right, top, bottom.
    pub edges: [EdgeSupport; 4],
    pub supports: Vec<Support>,
    pub masses: Vec<Mass>,
    pub eras: Vec<Era>,
    /// With their thickness in mm.
    pub patches: Vec<(Rectangle, f64)>,
    pub cutouts: Vec<Rectangle>,
    /// Pixels and active area, if it is not the default.
    pub screen: Option<([u32; 2], Rectangle)>,
}

/// The key of a spring's loss factor, where it has one: scenes of before it have none.
fn lossy(text: &mut String, loss_factor: f64) {
    if loss_factor != 0.0 {
        let _ = writeln!(text, "loss_factor = {loss_factor:e}");
    }
}

impl Spec {
    /// The scene that its file describes; panics if the file is not valid.
    pub fn parse_scene(&self) -> era_model::scene::Scene {
        let text = self.text();
        era_model::scene::Scene::parse("relation", &text).unwrap_or_else(|error| panic!("{error}\n{text}"))
    }

    /// The scene file.
    pub fn text(&self) -> String {
        let mut text = format!(
            "version = 1\nname = \"relation\"\n[surface]\nkind = \"{}\"\nlength_mm = {:?}\nwidth_mm = {:?}\nthickness_mm = {:?}\n\
             [surface.material]\nyoungs_modulus_pa = {:e}\npoisson_ratio = {:?}\ndensity_kg_m3 = {:e}\n[surface.damping]\n{} = {:e}\n",
            if self.is_bar { "bar" } else { "plate" },
            self.size_mm[0],
            self.size_mm[1],
            self.thickness_mm,
            self.young,
            self.poisson,
            self.density,
            self.damping.0,
            self.damping.1,
        );
        if let Some(([width_px, height_px], [x, y, width, height])) = self.screen {
            let _ = write!(
                text,
                "[screen]\nwidth_px = {width_px}\nheight_px = {height_px}\nx_mm = {x:?}\ny_mm = {y:?}\nwidth_mm = {width:?}\nheight_mm = {height:?}\n"
            );
        }
        for (side, held) in ["left", "right", "top", "bottom"].into_iter().zip(self.edges) {
            let kind = match held {
                EdgeSupport::Free => continue,
                EdgeSupport::Pinned => "pinned",
                EdgeSupport::Clamped => "clamped",
                EdgeSupport::Elastic(..) => "elastic",
            };
            let _ = write!(text, "[[edge]]\nside = \"{side}\"\nkind = \"{kind}\"\n");
            if let EdgeSupport::Elastic(stiffness, rotational, loss_factor) = held {
                let keys = if self.is_bar {
                    ["stiffness_n_per_m", "rotational_stiffness_n_m_per_rad"]
                } else {
                    ["stiffness_n_per_m2", "rotational_stiffness_n_per_rad"]
                };
                let _ = write!(text, "{} = {stiffness:e}\n{} = {rotational:e}\n", keys[0], keys[1]);
                lossy(&mut text, loss_factor);
            }
        }
        let at = |[x, y]: [f64; 2]| format!("x_mm = {x:?}\ny_mm = {y:?}\n");
        for support in &self.supports {
            let _ = write!(
                text,
                "[[support]]\n{}stiffness_n_per_m = {:e}\ndamping_n_s_per_m = {:e}\n",
                at(support.at_mm),
                support.stiffness,
                support.damping
            );
            lossy(&mut text, support.loss_factor);
        }
        for mass in &self.masses {
            let _ = write!(text, "[[mass]]\n{}mass_g = {:e}\n", at(mass.at_mm), mass.grams);
        }
        for ([x, y, length, width], thickness) in &self.patches {
            let _ = write!(
                text,
                "[[patch]]\nx_mm = {x:?}\nlength_mm = {length:?}\nwidth_mm = {width:?}\nthickness_mm = {thickness:?}\n"
            );
            if !self.is_bar {
                let _ = writeln!(text, "y_mm = {y:?}");
            }
        }
        for [x, y, length, width] in &self.cutouts {
            let _ =
                write!(text, "[[cutout]]\nx_mm = {x:?}\ny_mm = {y:?}\nlength_mm = {length:?}\nwidth_mm = {width:?}\n");
        }
        for era in &self.eras {
            let _ = write!(
                text,
                "[[actuator]]\nid = \"{}\"\n{}mount = \"{}\"\nmoving_mass_g = {:e}\nstiffness_n_per_m = {:e}\n\
                 damping_n_s_per_m = {:e}\nhousing_mass_g = {:e}\nelectrode_area_mm2 = {:e}\nair_gap_um = {:?}\nmax_voltage_v = {:?}\n",
                era.id,
                at(era.at_mm),
                if era.inertial { "inertial" } else { "grounded" },
                era.moving_g,
                era.stiffness,
                era.damping,
                era.housing_g,
                era.area_mm2,
                era.gap_um,
                era.volts
            );
        }
        text
    }

    /// Everything that has a place, to be moved.
    pub fn places(&mut self) -> impl Iterator<Item = &mut [f64; 2]> {
        let supports = self.supports.iter_mut().map(|support| &mut support.at_mm);
        let masses = self.masses.iter_mut().map(|mass| &mut mass.at_mm);
        supports.chain(masses).chain(self.eras.iter_mut().map(|era| &mut era.at_mm))
    }

    fn rectangles(&mut self) -> impl Iterator<Item = &mut Rectangle> {
        let patches = self.patches.iter_mut().map(|(rectangle, _)| rectangle);
        patches.chain(&mut self.cutouts).chain(self.screen.iter_mut().map(|(_, area)| area))
    }

    /// A force and nothing else: an ERA without weight or spring that stands on the ground.
    pub fn with_probe(&self, id: &str, at_mm: [f64; 2]) -> Self {
        let mut spec = self.clone();
        spec.eras.push(Era {
            id: id.into(),
            at_mm,
            inertial: false,
            moving_g: 0.0,
            stiffness: 0.0,
            damping: 0.0,
            housing_g: 0.0,
            area_mm2: 900.0,
            gap_um: 500.0,
            volts: 1000.0,
        });
        spec
    }

    /// The mirror image about the middle of axis 0 (left and right change places) or 1 (top and bottom).
    pub fn mirrored(&self, axis: usize) -> Self {
        let mut spec = self.clone();
        let side = self.size_mm[axis];
        for at in spec.places() {
            at[axis] = side - at[axis];
        }
        for rectangle in spec.rectangles() {
            rectangle[axis] = side - rectangle[axis] - rectangle[axis + 2];
        }
        spec.edges.swap(2 * axis, 2 * axis + 1);
        spec
    }

    /// The plate with its sides exchanged: x for y.
    pub fn transposed(&self) -> Self {
        assert!(!self.is_bar);
        let mut spec = self.clone();
        spec.size_mm.swap(0, 1);
        for at in spec.places() {
            at.swap(0, 1);
        }
        for [x, y, length, width] in spec.rectangles() {
            (*x, *y, *length, *width) = (*y, *x, *width, *length);
        }
        if let Some((pixels, _)) = &mut spec.screen {
            pixels.swap(0, 1);
        }
        let [left, right, top, bottom] = self.edges;
        spec.edges = [top, bottom, left, right];
        spec
    }

    /// The same with its lists in another order.
    pub fn reordered(&self) -> Self {
        let mut spec = self.clone();
        spec.supports.reverse();
        spec.masses.reverse();
        spec.eras.rotate_left(1);
        spec
    }

    /// The same in units of `length` m, `mass` kg and `time` s instead of one each: all numbers change as their dimensions say.
    pub fn scaled(&self, [length, mass, time]: [f64; 3]) -> Self {
        let mut spec = self.clone();
        let (per_length, viscous) = (mass / (time * time), mass / time);
        for side in &mut spec.size_mm {
            *side *= length;
        }
        for at in spec.places() {
            *at = at.map(|part| part * length);
        }
        for rectangle in spec.rectangles() {
            *rectangle = rectangle.map(|part| part * length);
        }
        for (_, thickness) in &mut spec.patches {
            *thickness *= length;
        }
        spec.thickness_mm *= length;
        spec.young *= per_length / length;
        spec.density *= mass / length.powi(3);
        spec.damping.1 *= match self.damping.0 {
            "rayleigh_alpha" => 1.0 / time,
            "rayleigh_beta" => time,
            _ => 1.0,
        };
        for held in &mut spec.edges {
            if let EdgeSupport::Elastic(stiffness, rotational, _) = held {
                let along = if self.is_bar { 1.0 } else { length };
                *stiffness *= per_length / along;
                *rotational *= per_length * length * length / along;
            }
        }
        for support in &mut spec.supports {
            support.stiffness *= per_length;
            support.damping *= viscous;
        }
        for own in &mut spec.masses {
            own.grams *= mass;
        }
        for era in &mut spec.eras {
            era.moving_g *= mass;
            era.housing_g *= mass;
            era.stiffness *= per_length;
            era.damping *= viscous;
        }
        spec
    }
}

/// Anywhere on a side, in parts of it; often at its ends or in its middle. Not close beside an end: such points take minutes, and
/// `cargo xtask crosscheck` has them.
fn part() -> impl Strategy<Value = f64> {
    prop_oneof![6 => 0.06..=0.94, 1 => Just(0.0), 1 => Just(1.0), 1 => Just(0.5)]
}

fn decades(from: f64, to: f64) -> impl Strategy<Value = f64> {
    (from..to).prop_map(|exponent| 10.0_f64.powf(exponent))
}

/// Whole odd millimetres, or any number.
fn side(from: f64, to: f64) -> impl Strategy<Value = f64> {
    (from..to, any::<bool>()).prop_map(|(side, whole)| if whole { 2.0 * (side / 2.0).floor() + 1.0 } else { side })
}

/// Young's modulus, Poisson's ratio, density: aluminium, glass, steel, acrylic, or anything between.
fn material() -> impl Strategy<Value = (f64, f64, f64)> {
    prop_oneof![
        prop::sample::select(vec![
            (69e9, 0.33, 2700.0),
            (70e9, 0.22, 2500.0),
            (200e9, 0.29, 7850.0),
            (3.2e9, 0.37, 1190.0)
        ]),
        (decades(9.4, 11.3), -0.2..0.48_f64, 800.0..9000.0_f64)
    ]
}

fn damping() -> impl Strategy<Value = (&'static str, f64)> {
    prop_oneof![
        2 => (Just("loss_factor"), 0.005..0.1_f64),
        1 => (Just("modal_ratio"), 0.003..0.05_f64),
        1 => (Just("rayleigh_alpha"), 5.0..50.0_f64),
        1 => (Just("rayleigh_beta"), 3e-6..5e-5_f64)
    ]
}

fn arbitrary_edge_support() -> impl Strategy<Value = EdgeSupport> {
    prop_oneof![
        6 => Just(EdgeSupport::Free),
        1 => Just(EdgeSupport::Pinned),
        1 => Just(EdgeSupport::Clamped),
        1 => (decades(2.0, 7.0), decades(-1.0, 3.0)).prop_map(|(k, turning)| EdgeSupport::Elastic(k, turning, loss(k, turning))),
    ]
}

/// Loss factor of a spring: none for one in two, for the others 0.01 to 1.6 as tape and rubber have it. From digits of two of its numbers, so that
/// everything else is as it was before there were losses.
fn loss(stiffness: f64, other: f64) -> f64 {
    let digits = |number: f64| (number.ln() * 1e3).rem_euclid(1.0);
    if other == 0.0 || digits(other) < 0.5 { 0.0 } else { 10.0_f64.powf(-2.0 + 2.2 * digits(stiffness)) }
}

/// Place in parts of the sides; whether it is inertial, its mass in g, resonance in Hz, damping ratio, housing in g.
type PlacedEra = (f64, f64, (bool, f64, f64, f64, f64));

fn era() -> impl Strategy<Value = PlacedEra> {
    (part(), part(), (any::<bool>(), 2.0..40.0_f64, 40.0..250.0_f64, 0.01..0.2_f64, 0.0..10.0_f64))
}

/// Modes that a bare plate has below [`HIGHEST_HZ`], at most: more take long, and show nothing else.
const MOST_MODES: f64 = 25.0;

/// Thickness in mm at which a bare plate has so many modes: A k^2 / 4 pi (Weyl) with k^2 = w sqrt(12 rho (1 - nu^2) / E) / h.
fn least_thickness_mm([length, width]: [f64; 2], (young, poisson, density): (f64, f64, f64)) -> f64 {
    let per_thickness =
        std::f64::consts::TAU * HIGHEST_HZ * (12.0 * density * (1.0 - poisson * poisson) / young).sqrt();
    length * width * 1e-6 * per_thickness / (2.0 * std::f64::consts::TAU * MOST_MODES) * 1e3
}

/// Bars of 0.1 to 0.6 m and plates of 0.1 to 0.45 m of any material, all kinds of edges and damping, supports, masses, one to four ERAs of both mounts.
pub fn scenes() -> impl Strategy<Value = Spec> {
    any::<bool>().prop_flat_map(scenes_of)
}

/// The same of plates or of bars alone.
pub fn scenes_of(is_bar: bool) -> impl Strategy<Value = Spec> {
    let size = if is_bar {
        (side(100.0, 600.0), side(12.0, 40.0)).boxed()
    } else {
        (side(100.0, 450.0), 0.25..1.3_f64)
            .prop_flat_map(|(l, aspect)| (Just(l), side(aspect * l, aspect * l + 2.0)))
            .boxed()
    };
    let supports = prop::collection::vec((part(), part(), (decades(1.0, 7.0), 0.0..5.0_f64)), 0..4);
    let masses = prop::collection::vec((part(), part(), decades(-1.0, 2.0)), 0..3);
    let eras = prop::collection::vec(era(), 1..5);
    let edges =
        [arbitrary_edge_support(), arbitrary_edge_support(), arbitrary_edge_support(), arbitrary_edge_support()];
    (size, 0.7..4.0_f64, material(), damping(), edges, (supports, masses, eras)).prop_map(
        move |((length, width), thickness_mm, (young, poisson, density), damping, edges, (supports, masses, eras))| {
            let at = |x: f64, y: f64| [x * length, if is_bar { 0.5 * width } else { y * width }];
            let [left, right, top, bottom] = edges;
            let edges =
                if is_bar { [left, right, EdgeSupport::Free, EdgeSupport::Free] } else { [left, right, top, bottom] };
            let numbered = |(i, (x, y, (inertial, moving_g, hz, ratio, housing_g))): (usize, PlacedEra)| {
                let stiffness = moving_g * 1e-3 * (std::f64::consts::TAU * hz).powi(2);
                Era {
                    id: format!("era{i}"),
                    at_mm: at(x, y),
                    inertial,
                    moving_g,
                    stiffness,
                    damping: 2.0 * ratio * (stiffness * moving_g * 1e-3).sqrt(),
                    housing_g,
                    area_mm2: 1963.5,
                    gap_um: 500.0,
                    volts: 1000.0,
                }
            };
            let mut spec = Spec {
                is_bar,
                size_mm: [length, width],
                thickness_mm: if is_bar {
                    thickness_mm
                } else {
                    thickness_mm.max(least_thickness_mm([length, width], (young, poisson, density)))
                },
                young,
                poisson: if is_bar { poisson.abs() } else { poisson },
                density,
                damping,
                edges,
                supports: supports
                    .into_iter()
                    .map(|(x, y, (stiffness, damping))| Support {
                        at_mm: at(x, y),
                        stiffness,
                        damping,
                        loss_factor: loss(stiffness, damping),
                    })
                    .collect(),
                masses: masses.into_iter().map(|(x, y, grams)| Mass { at_mm: at(x, y), grams }).collect(),
                eras: eras.into_iter().enumerate().map(numbered).collect(),
                patches: Vec::new(),
                cutouts: Vec::new(),
                screen: None,
            };
            spec.spread();
            spec
        },
    )
}

/// Least distance of two points in parts of the longer side.
const APART: f64 = 0.1;

impl Spec {
    /// Leaves out what is close to something else: as points beside an edge, it takes minutes.
    fn spread(&mut self) {
        let least = APART * self.size_mm[0].max(self.size_mm[1]);
        let mut taken: Vec<[f64; 2]> = Vec::new();
        let mut is_free = |at: [f64; 2]| {
            let free = taken.iter().all(|other| (at[0] - other[0]).hypot(at[1] - other[1]) >= least);
            if free {
                taken.push(at);
            }
            free
        };
        self.eras.retain(|era| is_free(era.at_mm));
        self.supports.retain(|support| is_free(support.at_mm));
        self.masses.retain(|mass| is_free(mass.at_mm));
    }
}

/// A point of a surface, in parts of its sides.
pub fn point() -> impl Strategy<Value = [f64; 2]> {
    [part(), part()]
}

/// It, in mm on a scene.
pub fn on(spec: &Spec, [x, y]: [f64; 2]) -> [f64; 2] {
    [x * spec.size_mm[0], if spec.is_bar { 0.5 } else { y } * spec.size_mm[1]]
}
