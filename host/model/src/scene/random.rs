//! Panels at random, as scene files: the parser is part of what is tried.
//!
//! Why here, although only tests and `tools/bench` write scenes: the tests of model, planner, host and bench need the same scenes, a crate of its
//! own would have one file, and the sequence below is the product's, which studies and tolerances draw from. The writer has 150 lines.

use std::fmt::Write;

/// The text of a scene of the sequence.
#[must_use]
pub fn random_scene_text(seed: u64, scene_number: u64) -> String {
    write_random_scene(&mut RandomSequence::new(seed, scene_number), &format!("random {seed}.{scene_number}"))
}

/// A sequence of random numbers that is the same everywhere (splitmix64; Steele, Lea and Flood 2014).
#[derive(Clone, Debug)]
pub struct RandomSequence(u64);

impl RandomSequence {
    /// The sequence of a seed; `stream` gives independent ones.
    #[must_use]
    pub const fn new(seed: u64, stream: u64) -> Self {
        let mut random = Self(seed);
        random.0 = random.next_random_u64().wrapping_add(stream);
        random.0 = random.next_random_u64();
        random
    }

    /// Another sequence, which leaves this one unchanged.
    const fn independent_sequence(&self) -> Self {
        Self::new(self.0, 4)
    }

    const fn next_random_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number from 0 up to, and without, 1.
    #[expect(clippy::cast_precision_loss, reason = "53 bits")]
    pub const fn next_unit_number(&mut self) -> f64 {
        (self.next_random_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A number evenly distributed between `from` and `to`.
    pub const fn next_between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.next_unit_number()
    }

    /// A power of ten whose exponent is evenly distributed between `lowest_exponent` and `highest_exponent`.
    pub fn next_power_of_ten(&mut self, lowest_exponent: f64, highest_exponent: f64) -> f64 {
        10.0_f64.powf(self.next_between(lowest_exponent, highest_exponent))
    }

    /// A whole number from 0 up to, and without, `count`.
    #[expect(clippy::cast_possible_truncation, reason = "below the count")]
    pub const fn next_below(&mut self, count: u32) -> u32 {
        (self.next_random_u64() % count as u64) as u32
    }

    /// One of several choices; there has to be at least one.
    pub fn pick_one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.next_below(u32::try_from(choices.len()).unwrap_or(1)) as usize]
    }

    /// True with this probability.
    pub const fn next_true_with_probability(&mut self, probability: f64) -> bool {
        self.next_unit_number() < probability
    }
}

/// Young's modulus in Pa, Poisson's ratio, density in kg/m^3: aluminium, glass, steel, acrylic.
const MATERIALS: [(f64, f64, f64); 4] =
    [(69e9, 0.33, 2700.0), (70e9, 0.22, 2500.0), (200e9, 0.29, 7850.0), (3.2e9, 0.37, 1190.0)];

/// Part of the springs' stiffness that electrodes may take: ERAs of half of all scenes stand their own electrodes, those of
/// others can be pulled in.
const SOFTENED_BY: [f64; 4] = [0.2, 0.2, 0.5, 1.5];

/// The text of a scene with 1 to 4 ERAs that could be built: a bar or plate of 0.1 to 0.5 m, edges, supports, masses and
/// damping of every kind, gaps of 0.25 to 0.8 mm, voltages up to 2 kV.
#[must_use]
pub fn write_random_scene(random: &mut RandomSequence, name: &str) -> String {
    let softened_by = random.independent_sequence().pick_one_of(&SOFTENED_BY);
    let is_bar = random.next_true_with_probability(0.4);
    let (kind, length_mm, width_mm) = if is_bar {
        ("bar", random.next_between(120.0, 500.0), random.next_between(12.0, 40.0))
    } else {
        let length_mm = random.next_between(120.0, 450.0);
        ("plate", length_mm, length_mm * random.next_between(0.3, 1.0))
    };
    // As written, so that places at the far ends are on the surface.
    let (length_mm, width_mm) = (length_mm.round(), width_mm.round());
    let (young, poisson, density) = random.pick_one_of(&MATERIALS);
    let mut text = format!(
        "version = 1\nname = \"{name}\"\n[surface]\nkind = \"{kind}\"\nlength_mm = {length_mm}\n\
         width_mm = {width_mm}\nthickness_mm = {:.2}\n[surface.material]\nyoungs_modulus_pa = {young:e}\n\
         poisson_ratio = {poisson}\ndensity_kg_m3 = {density}\n",
        random.next_between(0.7, 4.0),
    );
    let (key, value) = match random.next_below(20) {
        0..8 => ("loss_factor", random.next_power_of_ten(-2.5, -1.0)),
        8..12 => ("modal_ratio", random.next_power_of_ten(-2.5, -1.3)),
        12..15 => ("rayleigh_alpha", random.next_between(3.0, 40.0)),
        15..19 => ("rayleigh_beta", random.next_power_of_ten(-5.5, -4.3)),
        _ => ("", 0.0),
    };
    if !key.is_empty() {
        let _ = write!(text, "[surface.damping]\n{key} = {value:.3e}\n");
    }
    write_random_edges(random, &mut text, is_bar);
    let place = |random: &mut RandomSequence| {
        let part = |random: &mut RandomSequence| {
            if random.next_true_with_probability(0.2) {
                random.pick_one_of(&[0.0, 0.5, 1.0])
            } else {
                random.next_unit_number()
            }
        };
        let (x, y) = (part(random), if is_bar { 0.5 } else { part(random) });
        format!("x_mm = {:.2}\ny_mm = {:.2}\n", x * length_mm, y * width_mm)
    };
    for _ in 0..random.next_below(5) {
        let (at, stiffness, damping) =
            (place(random), random.next_power_of_ten(2.0, 5.0), random.next_between(0.0, 4.0));
        let _ = write!(text, "[[support]]\n{at}stiffness_n_per_m = {stiffness:.1}\ndamping_n_s_per_m = {damping:.2}\n");
    }
    for _ in 0..random.next_below(3) {
        let (at, mass_g) = (place(random), random.next_power_of_ten(0.0, 1.7));
        let _ = write!(text, "[[mass]]\n{at}mass_g = {mass_g:.2}\n");
    }
    for i in 0..=random.next_below(4) {
        let at = place(random);
        write_random_actuator(random, &mut text, i + 1, &at, softened_by);
    }
    // Last, so that all else is as it was before there were resistors.
    if random.next_true_with_probability(0.3) {
        write_random_electronics(random, &mut text);
    }
    text
}

fn write_random_edges(random: &mut RandomSequence, text: &mut String, is_bar: bool) {
    let sides: &[&str] = if is_bar { &["left", "right"] } else { &["left", "right", "top", "bottom"] };
    for side in sides {
        let kind = random.pick_one_of(&["", "", "", "", "pinned", "clamped", "elastic"]);
        if kind.is_empty() {
            continue;
        }
        let _ = write!(text, "[[edge]]\nside = \"{side}\"\nkind = \"{kind}\"\n");
        if kind == "elastic" {
            let key = if is_bar { "stiffness_n_per_m" } else { "stiffness_n_per_m2" };
            let _ = writeln!(text, "{key} = {:.1}", random.next_power_of_ten(3.0, 6.0));
        }
    }
}

/// Springs that an ERA of this weight resonates on at 50 to 250 Hz. At the highest voltage the electrodes take at most the part
/// `largest_softening_fraction` of the stiffness.
fn write_random_actuator(
    random: &mut RandomSequence,
    text: &mut String,
    number: u32,
    position_lines: &str,
    largest_softening_fraction: f64,
) {
    let mount = if random.next_true_with_probability(0.7) { "inertial" } else { "grounded" };
    let mass_kg = random.next_power_of_ten(-2.5, -1.5);
    let stiffness = mass_kg * (std::f64::consts::TAU * random.next_between(50.0, 250.0)).powi(2);
    let damping = 2.0 * random.next_power_of_ten(-2.0, -1.0) * (stiffness * mass_kg).sqrt();
    let (area_m2, gap_m) = (random.next_between(6e-4, 2.5e-3), random.next_between(0.25e-3, 0.8e-3));
    let highest_v = (largest_softening_fraction * stiffness * gap_m.powi(3) / (crate::scene::EPS0 * area_m2)).sqrt();
    let max_voltage_v = random.next_between(700.0, 2000.0).min(highest_v);
    let housing_g = if random.next_true_with_probability(0.5) { random.next_between(1.0, 10.0) } else { 0.0 };
    let bias_v =
        if random.next_true_with_probability(0.2) { max_voltage_v * random.next_between(0.3, 0.8) } else { 0.0 };
    let _ = write!(
        text,
        "[[actuator]]\nid = \"era{number}\"\n{position_lines}mount = \"{mount}\"\nmoving_mass_g = {:.3}\nhousing_mass_g = {housing_g:.2}\n\
         stiffness_n_per_m = {stiffness:.1}\ndamping_n_s_per_m = {damping:.4}\nelectrode_area_mm2 = {:.1}\n\
         air_gap_um = {:.1}\nmax_voltage_v = {max_voltage_v:.1}\nbias_voltage_v = {bias_v:.1}\n",
        mass_kg * 1e3,
        area_m2 * 1e6,
        gap_m * 1e6,
    );
}

/// Resistors up to twice those of the board's drive stage; electrodes have 90 to 170 pF with their cables.
fn write_random_electronics(random: &mut RandomSequence, text: &mut String) {
    let charging_ohm = random.next_power_of_ten(5.0, 6.3);
    let discharging_ohm = charging_ohm * random.next_power_of_ten(-1.3, 0.0);
    // No longer than the shortest time constant.
    let most_us = (charging_ohm * 85e-6).min(40.0);
    let delay_us = if random.next_true_with_probability(0.5) { random.next_between(0.0, most_us) } else { 0.0 };
    let _ = write!(
        text,
        "[electronics]\ncharging_resistance_ohm = {charging_ohm:.0}\ndischarging_resistance_ohm = {discharging_ohm:.0}\n\
         discharging_delay_us = {delay_us:.2}\n",
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    #[test]
    fn every_random_scene_is_one() {
        for stream in 0..500 {
            let text = write_random_scene(&mut RandomSequence::new(1, stream), "random");
            let scene = Scene::parse("random", &text).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert!((1..=4).contains(&scene.actuators.len()));
            assert_eq!(text, write_random_scene(&mut RandomSequence::new(1, stream), "random"));
        }
        assert_ne!(
            write_random_scene(&mut RandomSequence::new(1, 0), ""),
            write_random_scene(&mut RandomSequence::new(2, 0), "")
        );
    }
}
