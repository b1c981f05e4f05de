//! Scenes for the model's tests, as text: the parser is part of what is tested.

use std::f64::consts::TAU;
use std::fmt::Write;

/// A scene under construction.
#[derive(Clone, Debug)]
pub struct SceneText {
    kind: &'static str,
    pub length_m: f64,
    pub width_m: f64,
    pub thickness_m: f64,
    pub young: f64,
    pub poisson: f64,
    pub density: f64,
    damping: String,
    parts: String,
    actuators: usize,
}

impl SceneText {
    /// A bar of aluminium.
    pub fn bar(length_m: f64) -> Self {
        Self::new("bar", length_m, 0.02, 0.002)
    }

    /// A plate with Poisson's ratio `poisson`.
    pub fn plate(length_m: f64, width_m: f64, poisson: f64) -> Self {
        Self { poisson, ..Self::new("plate", length_m, width_m, 0.002) }
    }

    fn new(kind: &'static str, length_m: f64, width_m: f64, thickness_m: f64) -> Self {
        Self {
            kind,
            length_m,
            width_m,
            thickness_m,
            young: 70e9,
            poisson: 0.3,
            density: 2700.0,
            damping: String::new(),
            parts: String::new(),
            actuators: 0,
        }
    }

    pub fn thickness(mut self, thickness_m: f64) -> Self {
        self.thickness_m = thickness_m;
        self
    }

    pub fn damping(mut self, key: &str, value: f64) -> Self {
        self.damping = format!("[surface.damping]\n{key} = {value:e}\n");
        self
    }

    pub fn edge(mut self, side: &str, kind: &str) -> Self {
        let _ = write!(self.parts, "[[edge]]\nside = \"{side}\"\nkind = \"{kind}\"\n");
        self
    }

    /// An edge on springs: per metre on a plate, at a bar's end.
    pub fn elastic_edge(mut self, side: &str, stiffness: f64) -> Self {
        let key = if self.kind == "bar" { "stiffness_n_per_m" } else { "stiffness_n_per_m2" };
        let _ = write!(self.parts, "[[edge]]\nside = \"{side}\"\nkind = \"elastic\"\n{key} = {stiffness:e}\n");
        self
    }

    /// The same of a loss factor.
    pub fn lossy_edge(mut self, side: &str, stiffness: f64, loss_factor: f64) -> Self {
        self = self.elastic_edge(side, stiffness);
        let _ = writeln!(self.parts, "loss_factor = {loss_factor:e}");
        self
    }

    /// More of a scene file's text.
    pub fn with(mut self, text: &str) -> Self {
        self.parts.push_str(text);
        self
    }

    pub fn all_edges(mut self, kind: &str) -> Self {
        for side in ["left", "right", "top", "bottom"] {
            self = self.edge(side, kind);
        }
        self
    }

    /// A spring at a place given in parts of the sides.
    pub fn spring(self, x: f64, y: f64, stiffness: f64) -> Self {
        self.spring_damper(x, y, stiffness, 0.0)
    }

    pub fn lossy_spring(mut self, x: f64, y: f64, stiffness: f64, loss_factor: f64) -> Self {
        self = self.spring(x, y, stiffness);
        let _ = writeln!(self.parts, "loss_factor = {loss_factor:e}");
        self
    }

    pub fn spring_damper(mut self, x: f64, y: f64, stiffness: f64, damping: f64) -> Self {
        let (x, y) = (x * self.length_m * 1e3, y * self.width_m * 1e3);
        let _ = write!(
            self.parts,
            "[[support]]\nx_mm = {x:?}\ny_mm = {y:?}\nstiffness_n_per_m = {stiffness:e}\ndamping_n_s_per_m = {damping:e}\n"
        );
        self
    }

    pub fn corner_springs(mut self, stiffness: f64) -> Self {
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            self = self.spring(x, y, stiffness);
        }
        self
    }

    pub fn mass(mut self, x: f64, y: f64, mass_kg: f64) -> Self {
        let (x, y) = (x * self.length_m * 1e3, y * self.width_m * 1e3);
        let _ = write!(self.parts, "[[mass]]\nx_mm = {x:?}\ny_mm = {y:?}\nmass_g = {:e}\n", mass_kg * 1e3);
        self
    }

    pub fn era(mut self, mount: &str, x: f64, y: f64, mass_kg: f64, stiffness: f64, damping: f64) -> Self {
        let (x, y) = (x * self.length_m * 1e3, y * self.width_m * 1e3);
        self.actuators += 1;
        let _ = write!(
            self.parts,
            "[[actuator]]\nid = \"era{}\"\nx_mm = {x:?}\ny_mm = {y:?}\nmount = \"{mount}\"\nmoving_mass_g = {:e}\n\
             stiffness_n_per_m = {stiffness:e}\ndamping_n_s_per_m = {damping:e}\nelectrode_area_mm2 = 1963.5\n\
             air_gap_um = 500.0\nmax_voltage_v = 2000.0\n",
            self.actuators,
            mass_kg * 1e3
        );
        self
    }

    /// A force and nothing else: an ERA without weight or spring, standing on the ground.
    pub fn force(self, x: f64, y: f64) -> Self {
        self.era("grounded", x, y, 1e-15, 0.0, 0.0)
    }

    pub fn text(&self) -> String {
        format!(
            "version = 1\nname = \"test\"\n[surface]\nkind = \"{}\"\nlength_mm = {:?}\nwidth_mm = {:?}\nthickness_mm = {:?}\n\
             [surface.material]\nyoungs_modulus_pa = {:e}\npoisson_ratio = {:?}\ndensity_kg_m3 = {:?}\n{}{}",
            self.kind,
            self.length_m * 1e3,
            self.width_m * 1e3,
            self.thickness_m * 1e3,
            self.young,
            self.poisson,
            self.density,
            self.damping,
            self.parts
        )
    }

    pub fn scene(&self) -> era_model::scene::Scene {
        era_model::scene::Scene::parse("test scene", &self.text())
            .unwrap_or_else(|error| panic!("{error}\n{}", self.text()))
    }

    /// Bending stiffness E I of the bar in N m^2.
    pub fn ei(&self) -> f64 {
        self.young * self.width_m * self.thickness_m.powi(3) / 12.0
    }

    /// Mass of the surface in kg.
    pub fn surface_mass(&self) -> f64 {
        self.density * self.length_m * self.width_m * self.thickness_m
    }

    /// Rigidity D of the plate in N m.
    pub fn rigidity(&self) -> f64 {
        self.young * self.thickness_m.powi(3) / (12.0 * (1.0 - self.poisson * self.poisson))
    }

    /// Frequency of a bar's mode with (beta L).
    pub fn bar_hz(&self, beta_l: f64) -> f64 {
        let per_length = self.surface_mass() / self.length_m;
        beta_l * beta_l / (self.length_m * self.length_m) * (self.ei() / per_length).sqrt() / TAU
    }

    /// Frequency of a plate's mode with lambda = omega a^2 sqrt(rho h / D).
    pub fn plate_hz(&self, lambda: f64) -> f64 {
        let per_area = self.density * self.thickness_m;
        lambda / (self.length_m * self.length_m) * (self.rigidity() / per_area).sqrt() / TAU
    }
}
