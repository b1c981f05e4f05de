use super::*;
use crate::response::compute_acceleration_curves_per_newton;
use crate::scene::random::random_scene_text;
use crate::scene::{EdgeKind, Mass, Support};
use num_complex::Complex64;

const MAX_HZ: f64 = 400.0;
/// Part of the strongest ERA's response below which two answers are both none: an ERA on a clamped edge.
const NOTHING: f64 = 1e-6;

fn scene(text: &str) -> Scene {
    Scene::parse("scene", text).unwrap()
}

/// Of a plate of no round numbers, with an elastic edge, a mass, ERAs of both kinds, one of them near a support.
fn odd_plate(damping: &str, era_x: f64) -> Scene {
    let era = |id: &str, x: f64, y: f64, mount: &str| {
        format!(
            "[[actuator]]\nid = \"{id}\"\nx_mm = {x}\ny_mm = {y}\nmount = \"{mount}\"\nmoving_mass_g = 11.3\n\
             housing_mass_g = 3.1\nstiffness_n_per_m = 5300.0\ndamping_n_s_per_m = 1.1\nelectrode_area_mm2 = 900.0\n\
             air_gap_um = 250.0\nmax_voltage_v = 1500.0\n"
        )
    };
    scene(&format!(
        "version = 1\nname = \"odd\"\n[surface]\nkind = \"plate\"\nlength_mm = 412.7\nwidth_mm = 233.9\nthickness_mm = 1.83\n\
         [surface.material]\nyoungs_modulus_pa = 71e9\ndensity_kg_m3 = 2510.0\npoisson_ratio = 0.23\n\
         [surface.damping]\n{damping}\n\
         [[edge]]\nside = \"top\"\nkind = \"elastic\"\nstiffness_n_per_m2 = 2.1e4\n\
         [[support]]\nx_mm = 0.0\ny_mm = 233.9\nstiffness_n_per_m = 8100.0\ndamping_n_s_per_m = 6.3\n\
         [[support]]\nx_mm = 405.1\ny_mm = 229.0\nstiffness_n_per_m = 1.7e5\ndamping_n_s_per_m = 0.4\n\
         [[mass]]\nx_mm = 211.0\ny_mm = 93.1\nmass_g = 41.0\n{}{}{}",
        era("a", era_x, 60.3, "grounded"),
        era("b", 355.2, 97.7, "inertial"),
        era("c", 395.0, 221.0, "grounded"),
    ))
}

type Curves = Vec<Vec<Vec<Complex64>>>;

fn curves(model: &ReducedModel, scene: &Scene) -> Option<Curves> {
    let hz: Vec<f64> = (0..121).map(|k| 40.0 + 3.0 * f64::from(k)).collect();
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let places = [(0.13, 0.2), (0.5, 0.5), (0.77, 0.31), (0.31, 0.94)];
    let curve = |(u, v): &(f64, f64)| {
        compute_acceleration_curves_per_newton(model, &model.shape_deflections_at(u * length, v * width), &hz).ok()
    };
    places.iter().map(curve).collect()
}

/// Largest difference of a design's curves from those of its own finite elements, each relative to the latter's peak.
fn difference(scene: &Scene, accuracy: Accuracy) -> Option<f64> {
    let own = PanelModel::build(scene, Accuracy::REFERENCE, MAX_HZ).ok()?;
    let wanted = curves(&own.reduce_with_residual_shapes_of_actuators_damping_and_points(MAX_HZ, &[]).unwrap(), scene)?;
    let found = curves(&BarePanel::build(scene, accuracy, MAX_HZ).unwrap().couple_to_design(scene).unwrap(), scene)?;
    let most = wanted.iter().flatten().flatten().map(|z| z.norm()).fold(0.0, f64::max);
    let pairs = found.iter().zip(&wanted).flat_map(|(found, wanted)| found.iter().zip(wanted));
    let each = pairs.map(|(found, wanted)| {
        let peak = wanted.iter().map(|z| z.norm()).fold(NOTHING * most, f64::max);
        found.iter().zip(wanted).map(|(a, b)| (a - b).norm() / peak).fold(0.0, f64::max)
    });
    Some(each.fold(0.0, f64::max))
}

/// The elements of the reference have lines, functions and unknowns for every attachment; those of the bare panel know of none.
#[test]
fn a_design_is_what_its_own_elements_make_of_it() {
    for damping in ["loss_factor = 0.017", "modal_ratio = 0.013", "rayleigh_alpha = 9.1\nrayleigh_beta = 3e-6"] {
        let scene = odd_plate(damping, 111.1);
        let levels = [(Accuracy::FAST, 0.1), (Accuracy::BALANCED, 0.05), (Accuracy::REFERENCE, 4e-3)];
        let off = levels.map(|(accuracy, _)| difference(&scene, accuracy).unwrap());
        let is_met = off.iter().zip(levels).all(|(off, (_, most))| *off < most);
        assert!(is_met, "{damping}: {off:?}");
    }
}

/// The same on rubber and tape, also where it loses as much as the panel, and with one support as good as rigid.
#[test]
fn a_design_on_rubber_is_too() {
    for (damping, own) in [("loss_factor = 0.0", 0.0), ("loss_factor = 0.017", 0.017), ("modal_ratio = 0.013", 0.0)] {
        let mut scene = odd_plate(damping, 111.1);
        if let EdgeKind::Elastic { loss_factor, .. } = &mut scene.edges[0].kind {
            *loss_factor = 0.4;
        }
        scene.supports[0].loss_factor = 0.7;
        scene.supports[1].loss_factor = own;
        scene.supports.push(Support {
            stiffness_n_per_m: 1e15,
            loss_factor: 0.9,
            x_m: 0.2,
            y_m: 0.1,
            ..scene.supports[0]
        });
        let levels = [(Accuracy::BALANCED, 0.05), (Accuracy::REFERENCE, 4e-3)];
        let off = levels.map(|(accuracy, _)| difference(&scene, accuracy).unwrap());
        assert!(off.iter().zip(levels).all(|(off, (_, most))| *off < most), "{damping}: {off:?}");
    }
}

/// What is as good as rigid loses nothing, however much of its energy is lost: against elements that know of no stiffest spring.
#[test]
fn a_rigid_point_of_rubber_loses_nothing() {
    for stiffness in [1e9, 1e18] {
        let mut scene = odd_plate("loss_factor = 0.017", 111.1);
        let firm = Support { stiffness_n_per_m: stiffness, loss_factor: 0.9, x_m: 0.2, y_m: 0.1, ..scene.supports[0] };
        scene.supports.push(firm);
        let off = difference(&scene, Accuracy::REFERENCE).unwrap();
        assert!(off < 4e-3, "{stiffness}: {off:e}");
    }
}

/// Sealed air is a part of the bare panel, and what it does not lose is taken out of the surface's losses.
#[test]
fn a_design_on_sealed_air_is_too() {
    for damping in ["loss_factor = 0.017", "modal_ratio = 0.013", "rayleigh_alpha = 9.1\nrayleigh_beta = 3e-6"] {
        let scene = Scene { sealed_depth_m: Some(0.03), ..odd_plate(damping, 111.1) };
        let levels = [(Accuracy::BALANCED, 0.05), (Accuracy::REFERENCE, 4e-3)];
        let off = levels.map(|(accuracy, _)| difference(&scene, accuracy).unwrap());
        assert!(off.iter().zip(levels).all(|(off, (_, most))| *off < most), "{damping}: {off:?}");
        let deeper = Scene { sealed_depth_m: Some(0.04), ..scene.clone() };
        let refused = BarePanel::build(&scene, Accuracy::FAST, MAX_HZ).unwrap().couple_to_design(&deeper).unwrap_err();
        assert_eq!(refused, ModelError::OtherPanel { part: "air" });
    }
}

/// Panels at random, bars among them; resonances with little damping show every error of a frequency many times as large.
#[test]
fn designs_at_random_are_too() {
    let mut off: Vec<f64> = Vec::new();
    for number in 0..16 {
        let scene = scene(&random_scene_text(1931, number));
        let is_damped = scene.surface.damping != crate::scene::SurfaceDamping::None;
        off.extend(is_damped.then(|| difference(&scene, Accuracy::BALANCED)).flatten());
    }
    off.sort_by(f64::total_cmp);
    let (median, most) = (off[off.len() / 2], off[off.len() - 1]);
    assert!(off.len() > 10 && median < 1e-3 && most < 3e-2, "median {median:.1e}, most {most:.1e} of {off:?}");
}

/// What is kept from one design to the next changes no bit of it.
#[test]
fn the_order_of_designs_does_not_matter() {
    let (one, other) = (odd_plate("loss_factor = 0.01", 111.1), odd_plate("loss_factor = 0.01", 97.0));
    let panel = BarePanel::build(&one, Accuracy::FAST, MAX_HZ).unwrap();
    let of = |model: ReducedModel| (model.lambda.clone(), model.force.clone(), model.structural.clone());
    let first = of(panel.couple_to_design(&one).unwrap());
    panel.couple_to_design(&other).unwrap();
    assert!(first == of(panel.couple_to_design(&one).unwrap()));
    let alone = BarePanel::build(&other, Accuracy::FAST, MAX_HZ).unwrap();
    assert!(of(alone.couple_to_design(&other).unwrap()) == of(panel.couple_to_design(&other).unwrap()));
}

/// A little more spring at a point raises every squared frequency by that times the square of the shape there, a little more mass
/// lowers it by that times itself (Rayleigh): against differences of frequencies, which know nothing of shapes.
#[test]
fn frequencies_follow_springs_and_masses_as_their_shapes_say() {
    let scene = odd_plate("loss_factor = 0.01", 111.1);
    let panel = BarePanel::build(&scene, Accuracy::BALANCED, MAX_HZ).unwrap();
    let model = panel.couple_to_design(&scene).unwrap();
    let (spring, weight) = (2.0, 2e-6);
    let mut stiffer = scene.clone();
    stiffer.supports[0].stiffness_n_per_m += spring;
    let mut heavier = scene.clone();
    heavier.masses[0].mass_kg += weight;
    let places = [(scene.supports[0].x_m, scene.supports[0].y_m), (scene.masses[0].x_m, scene.masses[0].y_m)];
    let [at_spring, at_mass] = places.map(|(x, y)| model.shape_deflections_at(x, y));
    let [stiffer, heavier] = [stiffer, heavier].map(|scene| panel.couple_to_design(&scene).unwrap());
    for k in 0..8 {
        let lambda = model.lambda[k];
        let (up, down) = (stiffer.lambda[k] - lambda, heavier.lambda[k] - lambda);
        let wanted = (spring * at_spring[k].powi(2), -weight * lambda * at_mass[k].powi(2));
        let scale =
            (spring * 0.02 * at_spring.iter().take(8).map(|z| z * z).sum::<f64>(), 0.02 * weight * lambda * 10.0);
        assert!((up - wanted.0).abs() < 0.02 * wanted.0 + scale.0 * 1e-2, "{k}: {up} for {}", wanted.0);
        assert!((down - wanted.1).abs() < -0.02 * wanted.1 + scale.1 * 1e-2, "{k}: {down} for {}", wanted.1);
    }
}

/// The limit of a spring is a point that does not move.
#[test]
fn springs_of_any_stiffness_hold_their_points() {
    let with = |stiffness: f64| {
        let mut scene = odd_plate("loss_factor = 0.01", 111.1);
        scene.supports[1].stiffness_n_per_m = stiffness;
        let model = BarePanel::build(&scene, Accuracy::BALANCED, MAX_HZ).unwrap().couple_to_design(&scene).unwrap();
        model.lambda.iter().take(6).map(|lambda| lambda.sqrt()).collect::<Vec<_>>()
    };
    let [stiff, rigid, beyond] = [1e9, 1e14, 1e18].map(with);
    for ((stiff, rigid), beyond) in stiff.iter().zip(&rigid).zip(&beyond) {
        assert!((stiff / rigid - 1.0).abs() < 1e-4 && (rigid / beyond - 1.0).abs() < 1e-6, "{stiff} {rigid} {beyond}");
    }
}

/// What only a design of the same panel may ask, and elements of the lowest order, of which there is none lower.
#[test]
fn other_panels_are_refused_and_any_order_does() {
    let scene = odd_plate("loss_factor = 0.01", 111.1);
    let panel = BarePanel::build(&scene, Accuracy::FAST, MAX_HZ).unwrap();
    let mut thicker = scene.clone();
    thicker.surface.thickness_m *= 1.01;
    let mut without_edge = scene.clone();
    without_edge.edges.clear();
    assert_eq!(panel.couple_to_design(&thicker).unwrap_err(), ModelError::OtherPanel { part: "surface" });
    assert_eq!(panel.couple_to_design(&without_edge).unwrap_err(), ModelError::OtherPanel { part: "edge" });
    let fineness = Fineness { order: 3, cell_m: 0.03, layers: 1 };
    let coarse = BarePanel::new(&scene, fineness, MAX_HZ).unwrap().couple_to_design(&scene).unwrap();
    let fine = panel.couple_to_design(&scene).unwrap();
    assert!((coarse.lambda[0] / fine.lambda[0] - 1.0).abs() < 1e-2, "{} {}", coarse.lambda[0], fine.lambda[0]);
}

/// A plate that nothing holds has three motions without a frequency, with ERAs that carry their masses as well.
#[test]
fn motions_that_nothing_holds_have_no_frequency() {
    let mut scene = odd_plate("loss_factor = 0.01", 111.1);
    scene.supports.clear();
    scene.edges.clear();
    scene.actuators.retain(|actuator| actuator.mount == crate::scene::Mount::Inertial);
    let model = BarePanel::build(&scene, Accuracy::FAST, MAX_HZ).unwrap().couple_to_design(&scene).unwrap();
    assert_eq!(model.lambda.iter().filter(|lambda| **lambda == 0.0).count(), 3, "{}", model.lambda.rows(0, 6));
}

/// What a point does that a force acts on, off resonance too, where much of its motion is what the mesh misses: a heavy finger beside a clamped
/// edge of a thin plate.
#[test]
fn a_point_that_is_pushed_moves_as_its_own_elements_say() {
    let mut scene = odd_plate("modal_ratio = 0.01", 111.1);
    scene.surface.thickness_m = 1.1e-3;
    scene.edges[0].kind = EdgeKind::Clamped;
    let at = (0.0931, 0.0352);
    scene.supports.push(Support {
        stiffness_n_per_m: 17_500.0,
        damping_n_s_per_m: 25.0,
        loss_factor: 0.0,
        x_m: at.0,
        y_m: at.1,
        ..scene.supports[0]
    });
    scene.masses.push(Mass { x_m: at.0, y_m: at.1, mass_kg: 0.21 });
    let hz: Vec<f64> = (0..37).map(|k| 40.0 + 10.0 * f64::from(k)).collect();
    let of = |model: &ReducedModel| {
        compute_acceleration_curves_per_newton(model, &model.shape_deflections_at(at.0, at.1), &hz).unwrap()
    };
    let wanted = of(&PanelModel::build(&scene, Accuracy::REFERENCE, MAX_HZ)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(MAX_HZ, &[])
        .unwrap());
    let found = of(&BarePanel::build(&scene, Accuracy::BALANCED, MAX_HZ).unwrap().couple_to_design(&scene).unwrap());
    let most = wanted.iter().flatten().map(|z| z.norm()).fold(0.0, f64::max);
    let values = found.iter().flatten().zip(wanted.iter().flatten()).filter(|(_, wanted)| wanted.norm() > 1e-3 * most);
    let off: Vec<f64> = values.map(|(found, wanted)| (found - wanted).norm() / wanted.norm()).collect();
    let worst = off.iter().copied().fold(0.0, f64::max);
    assert!(off.len() > 50 && worst < 0.04, "{worst} of {off:?}");
}
