//! Surfaces of layers: against closed forms, against what they have to be equal to, and bounds against finer solutions.

use era_model::model::{Accuracy, PanelMode, compute_modes_with_error_bounds};
use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;
use era_model::scene::random::RandomSequence;
use era_model::scene::{Scene, SurfaceDamping};
use std::f64::consts::{PI, TAU};
use std::fmt::Write;

/// Birch veneer: E along the grain and across, G, Poisson's ratio, density.
const BIRCH: [f64; 5] = [15.1e9, 0.8e9, 0.73e9, 0.43, 640.0];

fn layer(thickness_mm: f64, [ex, ey, g, poisson, density]: [f64; 5], more: &str) -> String {
    format!(
        "[[layer]]\nthickness_mm = {thickness_mm}\n{more}\n[layer.material]\nex_pa = {ex:e}\ney_pa = {ey:e}\ng_pa = {g:e}\n\
         poisson_ratio = {poisson}\ndensity_kg_m3 = {density}\n"
    )
}

fn isotropic(thickness_mm: f64, [young, poisson, density]: [f64; 3], more: &str) -> String {
    format!(
        "[[layer]]\nthickness_mm = {thickness_mm}\n{more}\n[layer.material]\nyoungs_modulus_pa = {young:e}\n\
         poisson_ratio = {poisson}\ndensity_kg_m3 = {density}\n"
    )
}

fn text(kind: &str, length_mm: f64, width_mm: f64, parts: &[String]) -> String {
    format!(
        "version = 1\nname = \"layers\"\n[surface]\nkind = \"{kind}\"\nlength_mm = {length_mm}\nwidth_mm = {width_mm}\n{}",
        parts.concat()
    )
}

fn scene(kind: &str, length_mm: f64, width_mm: f64, parts: &[String]) -> Scene {
    Scene::parse("layers", &text(kind, length_mm, width_mm, parts)).unwrap()
}

fn held(kind: &str, sides: &[&str]) -> String {
    sides.iter().map(|side| format!("[[edge]]\nside = \"{side}\"\nkind = \"{kind}\"\n")).collect()
}

const SIDES: [&str; 4] = ["left", "right", "top", "bottom"];

fn modes(scene: &Scene, max_hz: f64) -> (Vec<f64>, Vec<f64>) {
    let found = compute_modes_with_error_bounds(scene, Accuracy::from_tolerance(1e-6).unwrap(), max_hz).unwrap();
    let frequency = |mode: &PanelMode| mode.frequency_hz;
    (
        found.answer.iter().map(frequency).collect(),
        found.bounds.iter().map(|bound| bound.limit_if_known().unwrap()).collect(),
    )
}

fn frequencies(scene: &Scene, max_hz: f64) -> Vec<f64> {
    modes(scene, max_hz).0
}

#[track_caller]
fn same(a: &[f64], b: &[f64], part: f64) {
    assert_eq!(a.len(), b.len(), "{a:?} {b:?}");
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= part * b.abs()), "{a:?} {b:?}");
}

/// Leissa, Vibration of Plates (1969), equation 9.26: a simply supported plate whose axes are those of its material.
#[test]
fn simply_supported_orthotropic_plates_have_closed_frequencies() {
    for [a_mm, b_mm, h_mm, max_hz] in [[437.0, 291.0, 3.7, 700.0], [211.0, 389.0, 1.3, 500.0]] {
        let [ex, ey, g, poisson, density] = BIRCH;
        let plate = scene("plate", a_mm, b_mm, &[layer(h_mm, BIRCH, ""), held("pinned", &SIDES)]);
        let cube = (h_mm * 1e-3_f64).powi(3) / 12.0;
        let reduced = 1.0 - poisson * poisson * ey / ex;
        let (d11, d22, d12, d66) = (ex / reduced * cube, ey / reduced * cube, poisson * ey / reduced * cube, g * cube);
        let (kx, ky) = (PI / (a_mm * 1e-3), PI / (b_mm * 1e-3));
        let hz = |i: f64, j: f64| {
            let (x, y) = ((i * kx).powi(2), (j * ky).powi(2));
            let stiffness = d11 * x * x + 2.0 * (d12 + 2.0 * d66) * x * y + d22 * y * y;
            (stiffness / (density * h_mm * 1e-3)).sqrt() / TAU
        };
        let mut expected: Vec<f64> = (1..40)
            .flat_map(|i| (1..40).map(move |j| hz(f64::from(i), f64::from(j))))
            .filter(|hz| *hz <= max_hz)
            .collect();
        expected.sort_by(f64::total_cmp);
        let (found, bounds) = modes(&plate, max_hz);
        assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
        assert!(found.len() > 8);
        for ((found, expected), bound) in found.iter().zip(&expected).zip(&bounds) {
            let error = (found / expected - 1.0).abs();
            assert!(error <= *bound && *bound <= 1e-6, "{found} {expected}: {error:e} {bound:e}");
        }
    }
}

/// A cantilever of two materials: (k L)^2 = 3.5160 with E I about the neutral plane.
#[test]
fn layered_bars_have_closed_frequencies() {
    let (steel, acrylic) = ([200e9, 0.3, 7850.0], [3.2e9, 0.37, 1190.0]);
    let bar = scene(
        "bar",
        187.0,
        13.0,
        &[isotropic(0.6, steel, ""), isotropic(2.3, acrylic, ""), held("clamped", &["left"])],
    );
    let neutral = (200e9 * 0.6 * 0.3 + 3.2e9 * 2.3 * 1.75) / (200e9 * 0.6 + 3.2e9 * 2.3);
    let about = |e: f64, h: f64, z: f64| e * (h * h * h / 12.0 + h * (z - neutral).powi(2)) * 1e-9;
    let stiffness = about(200e9, 0.6, 0.3) + about(3.2e9, 2.3, 1.75);
    let weight = (0.6 * 7850.0 + 2.3 * 1190.0) * 1e-3;
    let hz = 1.875_104_068_711_961_f64.powi(2) / TAU / 0.187_f64.powi(2) * (stiffness / weight).sqrt();
    let found = frequencies(&bar, 500.0);
    assert!((found[0] / hz - 1.0).abs() < 1e-6, "{found:?} {hz}");
}

/// What is attached, at places given as parts of both sides.
fn attached(length_mm: f64, width_mm: f64, swapped: bool) -> String {
    let mut text = String::new();
    let place = |x: f64, y: f64| {
        let (x, y) = if swapped { (y, x) } else { (x, y) };
        format!("x_mm = {}\ny_mm = {}", x * length_mm, y * width_mm)
    };
    let _ = write!(text, "[[support]]\n{}\nstiffness_n_per_m = 3e6\n", place(0.0, 0.31));
    let _ = write!(text, "[[support]]\n{}\nstiffness_n_per_m = 2e4\n", place(0.77, 0.94));
    let _ = write!(text, "[[mass]]\n{}\nmass_g = 41\n", place(0.38, 0.57));
    text
}

#[test]
fn layers_of_one_material_are_one_surface() {
    let glass = [70e9, 0.22, 2500.0];
    let more = [attached(271.0, 333.0, false), held("clamped", &["top"])].concat();
    let three = [isotropic(0.4, glass, ""), isotropic(0.9, glass, ""), isotropic(0.4, glass, "")].concat();
    let uniform = format!(
        "thickness_mm = 1.7\n[surface.material]\nyoungs_modulus_pa = 70e9\npoisson_ratio = 0.22\ndensity_kg_m3 = 2500\n{more}"
    );
    let plain = frequencies(&scene("plate", 271.0, 333.0, &[uniform]), 350.0);
    assert!(plain.len() > 5);
    same(&frequencies(&scene("plate", 271.0, 333.0, &[three.clone(), more.clone()]), 350.0), &plain, 1e-9);
    // The thickness may be given again; nothing changes.
    let again = format!("thickness_mm = 1.7\n{three}{more}");
    same(&frequencies(&scene("plate", 271.0, 333.0, &[again]), 350.0), &plain, 1e-9);
    // The same with axes along which nothing differs, but for digits: the other functions of point forces.
    let nearly = layer(1.7, [70e9, 70e9 * (1.0 - 1e-9), 70e9 / 2.44, 0.22, 2500.0], "");
    same(&frequencies(&scene("plate", 271.0, 333.0, &[nearly, more]), 350.0), &plain, 1e-6);
}

#[test]
fn pairs_are_the_same_upside_down_and_turned() {
    let stack = |swapped: bool, upside_down: bool| {
        let mut layers = [
            layer(0.9, BIRCH, if swapped { "angle_deg = 90" } else { "" }),
            layer(1.4, BIRCH, if swapped { "" } else { "angle_deg = 90" }),
        ];
        if upside_down {
            layers.reverse();
        }
        let (length, width) = if swapped { (233.0, 377.0) } else { (377.0, 233.0) };
        let edges = held("pinned", &[if swapped { "top" } else { "left" }]);
        let more = attached(length, width, swapped);
        frequencies(&scene("plate", length, width, &[layers.concat(), edges, more]), 500.0)
    };
    let as_it_is = stack(false, false);
    assert!(as_it_is.len() > 5);
    same(&stack(false, true), &as_it_is, 1e-9);
    same(&stack(true, false), &as_it_is, 2e-6);
}

/// A quarter of the stiffness is half of the frequency.
#[test]
fn halves_that_slip_are_half_as_fast() {
    let free = |layers: &[String]| frequencies(&scene("plate", 311.0, 207.0, layers), 1500.0);
    let half = layer(1.1, BIRCH, "");
    let bonded = free(&[layer(2.2, BIRCH, "")]);
    let slipping: Vec<f64> = free(&[half, layer(1.1, BIRCH, "bond = \"slips\"")]).iter().map(|hz| 2.0 * hz).collect();
    assert!(bonded.len() > 5);
    same(&slipping[..bonded.len()], &bonded, 2e-6);
}

#[test]
fn losses_of_layers_are_the_surfaces() {
    let of = |layers: &[String]| scene("plate", 311.0, 207.0, layers).surface.damping;
    assert_eq!(of(&[layer(1.1, BIRCH, "")]), SurfaceDamping::None);
    let SurfaceDamping::LossFactor(core) =
        of(&[layer(1.0, BIRCH, ""), layer(1.0, BIRCH, "loss_factor = 0.27"), layer(1.0, BIRCH, "")])
    else {
        panic!("a loss factor");
    };
    assert!((core - 0.01).abs() < 1e-12, "{core}");
}

#[test]
fn mistakes_are_named() {
    let birch = |more: &str| layer(1.0, BIRCH, more);
    let two = birch("") + &birch("");
    let surface =
        "thickness_mm = 2\n[surface.material]\nyoungs_modulus_pa = 1e9\npoisson_ratio = 0.3\ndensity_kg_m3 = 1000\n";
    let patch = "[[patch]]\nx_mm = 10\ny_mm = 10\nlength_mm = 20\nwidth_mm = 20\n";
    let both = birch("").replacen("ex_pa", "youngs_modulus_pa = 1e9\nex_pa", 1);
    let cases: [(String, &[&str]); 11] = [
        (
            format!("thickness_mm = 2.1\n{two}"),
            &[
                "surface.thickness_mm is 2.1",
                "must be 2, the sum of the thicknesses of all [[layer]] tables, or be left out",
            ],
        ),
        (format!("{surface}{two}"), &["surface.material is given", "left out, because every [[layer]]"]),
        (birch("angle_deg = 45"), &["layer[1].angle_deg is 45", "0 or 90"]),
        (birch("bond = \"slips\""), &["layer[1].bond is \"slips\"", "lowest"]),
        (two.clone() + &birch("bond = \"glued\""), &["layer[3].bond", "glued", "\"bonded\", \"slips\""]),
        (birch("").replace("0.43", "4.4"), &["layer[1].material.poisson_ratio is 4.4", "between -4.34", "and 4.34"]),
        (
            birch("").replace("g_pa = ", "gpa = "),
            &["layer[1].material.g_pa is missing", "unknown key `layer[1].material.gpa`"],
        ),
        (both, &["layer[1].material.youngs_modulus_pa", "ex_pa"]),
        (two.clone() + patch, &["patch[1]", "is not allowed on a surface with [[layer]] tables"]),
        (
            format!("[surface.damping]\nmodal_ratio = 0.01\n{}", birch("loss_factor = 0.1")),
            &["surface.damping", "only one of them is allowed"],
        ),
        (layer(60.0, BIRCH, "") + &layer(60.0, BIRCH, ""), &["layer[2].thickness_mm", "120", "100 mm"]),
    ];
    for (parts, told) in cases {
        let said = Scene::parse("panel.toml", &text("plate", 311.0, 207.0, &[parts])).unwrap_err().to_string();
        for told in told {
            assert!(said.contains(told), "{told:?} in {said}");
        }
    }
}

/// Layers at random: from nearly isotropic to thirty times stiffer along one axis, twist of any strength.
fn random_panel(random: &mut RandomSequence) -> Scene {
    let (length, width) = (random.next_between(120.0, 450.0).round(), random.next_between(120.0, 450.0).round());
    let ex = random.next_power_of_ten(9.0, 11.0);
    let ey = ex * random.next_power_of_ten(-1.5, 0.0);
    let mean = (ex * ey).sqrt();
    let material = [
        ex,
        ey,
        mean * random.next_between(0.05, 0.6),
        random.next_between(0.0, 0.4),
        random.next_between(500.0, 2000.0),
    ];
    let mut parts = layer(
        (random.next_between(0.5, 2.5) * 100.0).round() / 100.0,
        material,
        if random.next_true_with_probability(0.5) { "angle_deg = 90" } else { "" },
    );
    parts.push_str("[surface.damping]\nloss_factor = 0.02\n");
    if random.next_true_with_probability(0.2) {
        let _ = write!(
            parts,
            "[[cutout]]\nx_mm = {}\ny_mm = {}\nlength_mm = {}\nwidth_mm = {}\n",
            0.3 * length,
            0.4 * width,
            0.25 * length,
            0.2 * width
        );
    }
    for side in SIDES {
        match random.next_below(8) {
            0 => parts.push_str(&held("pinned", &[side])),
            1 => parts.push_str(&held("clamped", &[side])),
            2 => {
                let _ = write!(
                    parts,
                    "[[edge]]\nside = \"{side}\"\nkind = \"elastic\"\nstiffness_n_per_m2 = {:e}\n",
                    random.next_power_of_ten(2.0, 6.0)
                );
            }
            _ => (),
        }
    }
    let place = |random: &mut RandomSequence| {
        let part = |random: &mut RandomSequence| {
            if random.next_true_with_probability(0.2) {
                random.pick_one_of(&[0.0, 0.02, 1.0])
            } else {
                random.next_unit_number()
            }
        };
        let (x, mut y) = (part(random), part(random));
        // Not in the cut-out.
        if (0.29..0.56).contains(&x) && (0.39..0.61).contains(&y) {
            y = 0.75;
        }
        format!("x_mm = {}\ny_mm = {}\n", x * length, y * width)
    };
    for _ in 0..random.next_below(4) {
        let (at, stiffness) = (place(random), random.next_power_of_ten(2.0, 8.0));
        let _ = write!(parts, "[[support]]\n{at}stiffness_n_per_m = {stiffness:e}\n");
    }
    let _ = write!(
        parts,
        "[[actuator]]\nid = \"era\"\n{}mount = \"inertial\"\nmoving_mass_g = 8\nstiffness_n_per_m = 6000\n\
         damping_n_s_per_m = 1\nelectrode_area_mm2 = 1500\nair_gap_um = 500\nmax_voltage_v = 1000\n",
        place(random)
    );
    scene("plate", length, width, &[parts])
}

/// What is printed beside modes and responses holds: against a solution at a hundredth of the tolerance. `ERA_LAYERS_BOUNDS` says how many panels,
/// `ERA_LAYERS_FIRST` from which on, `ERA_LAYERS_TELL` prints them.
#[test]
fn bounds_hold() {
    let count = std::env::var("ERA_LAYERS_BOUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(6);
    let first: u64 = std::env::var("ERA_LAYERS_FIRST").ok().and_then(|text| text.parse().ok()).unwrap_or(0);
    for stream in first..first + count {
        let scene = random_panel(&mut RandomSequence::new(7, stream));
        let coarse = compute_modes_with_error_bounds(&scene, Accuracy::FAST, 400.0).unwrap();
        let fine = compute_modes_with_error_bounds(&scene, Accuracy::from_tolerance(1e-4).unwrap(), 400.0).unwrap();
        let (mut worst, modes) = (0.0_f64, fine.answer.len());
        for ((a, bound), (b, finer)) in
            coarse.answer.iter().zip(&coarse.bounds).zip(fine.answer.iter().zip(&fine.bounds))
        {
            if let (Some(bound), Some(finer)) = (bound.limit_if_known(), finer.limit_if_known()) {
                let error = (a.frequency_hz - b.frequency_hz).abs() / b.frequency_hz.max(1e-9);
                worst = worst.max(error / (bound + finer));
            }
        }
        let hz = [37.0, 113.0, 241.0, 389.0];
        let at = (0.61 * scene.surface.length_m, 0.83 * scene.surface.width_m);
        let coarse = compute_acceleration_curves_per_newton_with_error_bounds(&scene, Accuracy::FAST, at, &hz).unwrap();
        let fine = compute_acceleration_curves_per_newton_with_error_bounds(
            &scene,
            Accuracy::from_tolerance(1e-4).unwrap(),
            at,
            &hz,
        )
        .unwrap();
        let mut worst_curve = 0.0_f64;
        for ((a, bound), (b, finer)) in
            coarse.answer.iter().zip(&coarse.bounds).zip(fine.answer.iter().zip(&fine.bounds))
        {
            let peak = b.iter().map(|z| z.norm()).fold(0.0, f64::max);
            if let (Some(bound), Some(finer)) = (bound.limit_if_known(), finer.limit_if_known()) {
                let error = a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / peak;
                worst_curve = worst_curve.max(error / (bound + finer));
            }
        }
        if std::env::var_os("ERA_LAYERS_TELL").is_some() {
            println!(
                "{stream}: {modes} modes {worst:.3} ({:.0e}), curves {worst_curve:.3}, fine {:.0e}",
                coarse.bounds.iter().filter_map(|bound| bound.limit_if_known()).fold(0.0, f64::max),
                fine.bounds.iter().filter_map(|bound| bound.limit_if_known()).fold(0.0, f64::max),
            );
        }
        assert!(worst <= 1.0 && worst_curve <= 1.0, "{stream}: {worst} {worst_curve}");
    }
}
