//! Steady forces: what they do depends on springs alone. No damping, no loss factor and no mass changes a press, what masses yield to a steady
//! force, or what limits follow from it; and what they do is held against closed formulas.

use era_model::model::levels::ReducedLevels;
use era_model::model::{Accuracy, BarePanel};
use era_model::scene::random::random_scene_text;
use era_model::scene::{EXAMPLE_BAR, EdgeKind, Finger, Mass, ModalRatio, Mount, STARTING_PLATE, Scene, SurfaceDamping};
use era_planner::press_bounds::{
    bound_relative_mesh_error_of_sag_under_press_and_electrode_pull, bound_relative_mesh_error_of_travel_by_press_alone,
};
use era_planner::softening::static_receptance_magnitude_or_infinity_m_per_n;
use era_planner::{PlanTable, TableOptions};

const OPTIONS: TableOptions = TableOptions { from_hz: 60.0, to_hz: 120.0, step_hz: 30.0 };

fn table(scene: &Scene) -> PlanTable {
    let levels = ReducedLevels::build(scene, Accuracy::FAST, OPTIONS.to_hz).unwrap();
    PlanTable::from_levels(scene, levels, OPTIONS).unwrap()
}

/// A change of a panel, and its name.
type Change = (&'static str, fn(&mut Scene));

/// What damps a panel and what weighs on it, changed one by one.
fn list_changes() -> Vec<Change> {
    vec![
        ("no damping of the surface", |scene| scene.surface.damping = SurfaceDamping::None),
        ("loss factor of the surface or its layers", |scene| scene.surface.damping = SurfaceDamping::LossFactor(1.7)),
        ("modal ratio", |scene| scene.surface.damping = SurfaceDamping::ModalRatio(ModalRatio::from_single_ratio(0.4))),
        ("Rayleigh's damping", |scene| scene.surface.damping = SurfaceDamping::Rayleigh { alpha: 900.0, beta: 1e-3 }),
        ("loss factors of supports", |scene| scene.supports.iter_mut().for_each(|own| own.loss_factor = 2.0)),
        ("dashpots of supports", |scene| scene.supports.iter_mut().for_each(|own| own.damping_n_s_per_m = 1e6)),
        ("loss factors of edges", |scene| {
            for edge in &mut scene.edges {
                if let EdgeKind::Elastic { loss_factor, .. } = &mut edge.kind {
                    *loss_factor = 1.5;
                }
            }
        }),
        ("dashpots of ERAs", |scene| scene.actuators.iter_mut().for_each(|own| own.damping_n_s_per_m = 1e5)),
        ("moving masses", |scene| scene.actuators.iter_mut().for_each(|own| own.moving_mass_kg = 300.0)),
        ("housings", |scene| scene.actuators.iter_mut().for_each(|own| own.housing_mass_kg = 300.0)),
        ("a heavy mass", |scene| {
            let (x_m, y_m) = (scene.actuators[0].x_m, scene.actuators[0].y_m);
            scene.masses.push(Mass { x_m, y_m, mass_kg: 1e4 });
        }),
        ("air that moves along", |scene| scene.surface.added_mass_kg_per_m2 = 40.0),
        ("all at once", |scene| {
            scene.surface.damping = SurfaceDamping::LossFactor(1.0);
            scene.supports.iter_mut().for_each(|own| (own.loss_factor, own.damping_n_s_per_m) = (1.1, 1e3));
            scene.masses.iter_mut().for_each(|own| own.mass_kg *= 1e3);
            scene.actuators.iter_mut().for_each(|own| (own.moving_mass_kg, own.damping_n_s_per_m) = (5.0, 1e4));
        }),
    ]
}

/// Random bars and plates, every other one with sealed air, every third plate with a cut-out; `ERA_RELATIONS=20` tries twenty times as many.
fn scenes() -> Vec<Scene> {
    let of = |stream: u64| {
        let mut text = random_scene_text(34, stream);
        if stream.is_multiple_of(2) {
            text += &format!("[air]\nsealed_depth_mm = {}.5\n", 3 + stream);
        }
        let plain = Scene::parse("random", &text).ok()?;
        let cut = format!("{text}[[cutout]]\nx_mm = 40.0\ny_mm = 20.0\nlength_mm = 21.0\nwidth_mm = 13.0\n");
        Some(if stream.is_multiple_of(3) { Scene::parse("random", &cut).unwrap_or(plain) } else { plain })
    };
    let times = std::env::var("ERA_RELATIONS").map_or(1, |times| times.parse().unwrap());
    (0..6 * times).filter_map(of).collect()
}

const LAYERED: &str = r#"
    version = 1
    name = "layers"
    [surface]
    kind = "plate"
    length_mm = 240.0
    width_mm = 150.0
    [[layer]]
    thickness_mm = 1.1
    loss_factor = 0.4
    [layer.material]
    youngs_modulus_pa = 70e9
    poisson_ratio = 0.22
    density_kg_m3 = 2500.0
    [[layer]]
    thickness_mm = 2.0
    [layer.material]
    youngs_modulus_pa = 3e9
    poisson_ratio = 0.37
    density_kg_m3 = 1190.0
    [[edge]]
    side = "left"
    kind = "elastic"
    stiffness_n_per_m2 = 3e4
    rotational_stiffness_n_per_rad = 2.0
    loss_factor = 0.7
    [[support]]
    x_mm = 240.0
    y_mm = 0.0
    stiffness_n_per_m = 4000.0
    damping_n_s_per_m = 3.0
    [[actuator]]
    id = "a"
    x_mm = 150.0
    y_mm = 90.0
    mount = "grounded"
    moving_mass_g = 8.0
    stiffness_n_per_m = 9000.0
    damping_n_s_per_m = 1.0
    electrode_area_mm2 = 1200.0
    air_gap_um = 500.0
    max_voltage_v = 1500.0
    [[actuator]]
    id = "b"
    x_mm = 60.0
    y_mm = 40.0
    mount = "inertial"
    moving_mass_g = 8.0
    stiffness_n_per_m = 9000.0
    damping_n_s_per_m = 1.0
    electrode_area_mm2 = 1200.0
    air_gap_um = 500.0
    max_voltage_v = 1500.0
"#;

/// Two figures of one thing: infinite both, or within a bound and what rounding makes of heavy masses. A tenth of a nanometre, 3e-7 of the narrowest gap here, is none: an
/// inertial ERA's mass of 300 kg follows what is steady to 16 pm.
fn are_equal(a: f64, b: f64, bound: f64) -> bool {
    a == b || (a - b).abs() <= (bound + 1e-6) * a.abs().max(b.abs()) + 1e-10
}

/// Before, a hundredth of 10 Hz stood for nothing: losses, dashpots and heavy masses changed each of these by up to all of it.
#[test]
fn nothing_but_springs_changes_what_a_steady_force_does() {
    let (mut compared, mut most) = (0, 0.0_f64);
    let mut all = scenes();
    all.push(Scene::parse("layers", LAYERED).unwrap());
    for scene in &all {
        let before = table(scene);
        let yields = static_receptance_magnitude_or_infinity_m_per_n(&before.model);
        let sags = sag(scene);
        for (what, change) in list_changes() {
            let mut changed = scene.clone();
            change(&mut changed);
            let after = table(&changed);
            let yields_now = static_receptance_magnitude_or_infinity_m_per_n(&after.model);
            let said = || format!("{what}: {:?}\n{scene:#?}", scene.name);
            for i in 0..scene.actuators.len() {
                let bounds = [&before, &after].map(|own| {
                    bound_relative_mesh_error_of_travel_by_press_alone(own, i).limit_if_known().unwrap_or(1e-3)
                });
                let bound = bounds[0] + bounds[1];
                let (one, other) = (&before.pressed[i], &after.pressed[i]);
                assert!(are_equal(one.alone_m, other.alone_m, bound), "{}: {one:?} {other:?} {bound:e}", said());
                // The electrodes' pull grows with the sag, and more so.
                assert!(are_equal(one.sag_m, other.sag_m, 10.0 * bound), "{}: {one:?} {other:?} {bound:e}", said());
                for j in 0..scene.actuators.len() {
                    let own = yields[i][i].max(yields[j][j]);
                    let (a, b) = (yields[i][j], yields_now[i][j]);
                    assert!(a == b || (a - b).abs() <= (bound + 1e-5) * own, "{}: {a} {b}", said());
                    if a.is_finite() {
                        (compared, most) = (compared + 1, most.max((a - b).abs() / own));
                    }
                }
            }
            for (k, (a, b)) in sags.iter().zip(sag(&changed)).enumerate() {
                assert!(are_equal(a.0, b.0, (a.1 + b.1) / a.0), "{}: place {k}, {a:?} {b:?}", said());
            }
        }
    }
    println!("{compared} figures, {most:.1e} of the largest apart at most");
    assert!(compared > 150, "{compared}");
}

/// What studies say of a sag, and its error.
fn sag(scene: &Scene) -> Vec<(f64, f64)> {
    let panel = BarePanel::build(scene, Accuracy::FAST, OPTIONS.to_hz).unwrap();
    let (x, y) = (0.37 * scene.surface.length_m, 0.71 * scene.surface.width_m);
    let own = panel.compute_static_compliance_at_grid_points(scene, &[x], &[y]).unwrap();
    own.m_per_n.into_iter().zip(own.error_m_per_n).collect()
}

/// A finger's spring holds the mass under it, its mass and its dashpot do not.
#[test]
fn of_a_finger_the_spring_alone_is_steady() {
    let scene = |mass_kg: f64, damping_n_s_per_m: f64, stiffness_n_per_m: f64| {
        let mut scene = Scene::parse("layers", LAYERED).unwrap();
        scene.finger = Some(Finger { mass_kg, damping_n_s_per_m, stiffness_n_per_m });
        scene.replace_finger_by_masses_and_supports_at_places(&[(0.1, 0.05)])
    };
    let yields = |scene: &Scene| static_receptance_magnitude_or_infinity_m_per_n(&table(scene).model);
    let [plain, heavy, soft] =
        [scene(1e-3, 1.0, 800.0), scene(2.0, 1e4, 800.0), scene(1e-3, 1.0, 8.0)].map(|own| yields(&own));
    assert!(are_equal(plain[0][0], heavy[0][0], 1e-4), "{plain:?} {heavy:?}");
    assert!(soft[0][0] > 1.001 * plain[0][0], "{soft:?} {plain:?}");
}

/// An aluminium plate of 300 x 200 x 4 mm on four corner supports of 3000 N/m, and a probe that weighs nothing at a place.
fn on_corners(x_mm: f64, extra: &str, loss: &str, dashpot: f64) -> Scene {
    let support = |x: f64, y: f64| {
        format!(
            "[[support]]\nx_mm = {x}\ny_mm = {y}\nstiffness_n_per_m = 3000.0\ndamping_n_s_per_m = {dashpot}\n{loss}\n"
        )
    };
    let corners: String = [(0.0, 0.0), (300.0, 0.0), (0.0, 200.0), (300.0, 200.0)].map(|(x, y)| support(x, y)).concat();
    let text = format!(
        "version = 1\nname = \"corners\"\n[surface]\nkind = \"plate\"\nlength_mm = 300.0\nwidth_mm = 200.0\nthickness_mm = 4.0\n\
         [surface.material]\nyoungs_modulus_pa = 70e9\npoisson_ratio = 0.33\ndensity_kg_m3 = 2700.0\n{corners}{extra}\
         [press]\nforce_n = 1.0\n[[actuator]]\nid = \"probe\"\nx_mm = {x_mm}\ny_mm = 100.0\nmount = \"grounded\"\n\
         moving_mass_g = 0.0\nstiffness_n_per_m = 0.0\ndamping_n_s_per_m = 0.0\nelectrode_area_mm2 = 900.0\n\
         air_gap_um = 500.0\nmax_voltage_v = 1000.0\n"
    );
    Scene::parse("corners", &text).unwrap()
}

/// Under 1 N in its middle it sinks by 83.333 um with its springs, and bends: 91.2231 um, by the independent reference's elements
/// (`tools/crosscheck/reference/press.py`, right to 2e-6). What damps it and what weighs on it has no part in it. Before, supports of a loss factor of 2 took 55 % off, and
/// dashpots of 1e6 N s/m 91 %, with bounds of 5e-7 and 2e-6.
#[test]
fn a_plate_on_its_corners_sags_by_its_springs_and_its_bending() {
    let heavy = "[[mass]]\nx_mm = 100.0\ny_mm = 60.0\nmass_g = 1e7\n";
    let cases = [
        ("", "", 0.0),
        ("", "loss_factor = 0.3", 0.0),
        ("", "loss_factor = 1.0", 0.0),
        ("", "loss_factor = 2.0", 0.0),
        ("", "", 1e3),
        ("", "", 1e4),
        ("", "", 1e6),
        (heavy, "", 0.0),
        (heavy, "loss_factor = 2.0", 1e5),
    ];
    for (x_mm, expected) in [(150.0, 91.223_106e-6), (75.0, 127.856_461e-6)] {
        for (extra, loss, dashpot) in cases {
            let scene = on_corners(x_mm, extra, loss, dashpot);
            let table = table(&scene);
            let (found, bound) = (
                table.pressed[0].alone_m,
                bound_relative_mesh_error_of_travel_by_press_alone(&table, 0).limit_if_known().unwrap(),
            );
            println!("{x_mm} {extra:?} {loss:?} {dashpot}: {:.5} um, bound {bound:.1e}", found * 1e6);
            // The furthest place is a corner's edge, where the grid has a point.
            assert!((found / expected - 1.0).abs() < bound + 3e-6, "{x_mm} {loss} {dashpot}: {found}, {bound:e}");
            assert!(bound < 1e-3, "a bound that says nothing: {bound:e}");
        }
        // What studies say of the softest place is no less.
        let scene = on_corners(x_mm, "", "loss_factor = 2.0", 1e3);
        let panel = BarePanel::build(&scene, Accuracy::BALANCED, OPTIONS.to_hz).unwrap();
        let own = panel.compute_static_compliance_at_grid_points(&scene, &[x_mm / 1e3], &[0.1]).unwrap();
        let by_plan = static_receptance_magnitude_or_infinity_m_per_n(&table(&scene).model)[0][0];
        assert!((own.m_per_n[0] / by_plan - 1.0).abs() < own.error_m_per_n[0] / by_plan + 1e-4, "{own:?} {by_plan}");
    }
}

/// Nothing holds these against a press: infinite, and never a number that a frequency near nothing makes up.
#[test]
fn a_panel_that_nothing_holds_has_no_steady_place_under_a_press() {
    let parse = |text: &str| Scene::parse("free", text).unwrap();
    let mut scene = parse(LAYERED);
    scene.edges.clear();
    // A support and a grounded ERA: it turns about the line through both.
    let turns = table(&scene);
    assert!(turns.pressed[0].alone_m.is_infinite(), "{:?}", turns.pressed[0]);
    assert!(bound_relative_mesh_error_of_travel_by_press_alone(&turns, 0).limit_if_known().is_none());
    // The ERA's own spring still holds its mass against its own electrodes, and the inertial one's against its own.
    let yields = static_receptance_magnitude_or_infinity_m_per_n(&turns.model);
    assert!(yields[0][0].is_finite() && yields[0][0] > 0.0 && yields[1][1].is_finite(), "{yields:?}");
    // With dashpots that before stood in for what holds it.
    scene.supports.iter_mut().for_each(|own| (own.stiffness_n_per_m, own.damping_n_s_per_m) = (0.0, 1e5));
    let floats = table(&scene);
    assert!(floats.pressed[0].alone_m.is_infinite(), "{:?}", floats.pressed[0]);
    // Two inertial ERAs on a panel in the air: springs of their own, whatever moves with them.
    scene.supports.clear();
    scene.actuators.iter_mut().for_each(|own| own.mount = Mount::Inertial);
    let free = static_receptance_magnitude_or_infinity_m_per_n(&table(&scene).model);
    for (own, actuator) in (0..2).zip(&scene.actuators) {
        assert!((free[own][own] * actuator.stiffness_n_per_m - 1.0).abs() < 1e-9, "{free:?}");
        assert!(free[own][1 - own].abs() * actuator.stiffness_n_per_m < 1e-9, "{free:?}");
    }
}

fn table_at(scene: &Scene, tolerance: f64) -> PlanTable {
    let levels = ReducedLevels::build(scene, Accuracy::from_tolerance(tolerance).unwrap(), 400.0).unwrap();
    PlanTable::from_levels(scene, levels, OPTIONS).unwrap()
}

/// A panel without its electrodes is linear: how far a press moves it is force times the same, with the same bound, on either side of the force that brings a
/// mass to its electrode. Before, there was none beyond it.
#[test]
fn the_bound_of_a_press_does_not_depend_on_the_force() {
    for name in [STARTING_PLATE, EXAMPLE_BAR] {
        let mut scene = Scene::parse("example", name).unwrap();
        let mut per_n = Vec::new();
        for force_n in [1e-3, 1.0, 4.7, 4.8, 50.0, 1000.0] {
            scene.press_n = force_n;
            let table = table_at(&scene, 1e-3);
            for (i, own) in table.pressed.iter().enumerate() {
                let bound = bound_relative_mesh_error_of_travel_by_press_alone(&table, i)
                    .limit_if_known()
                    .unwrap_or_else(|| panic!("{force_n} N: {own:?}"));
                assert!(bound > 0.0 && bound < 1e-3, "{force_n} N: {bound:e}");
                per_n.push((i, own.alone_m / force_n, bound));
                // Between electrodes and springs the sag is known no worse than some times that, and where a stop is exactly.
                let of_sag = bound_relative_mesh_error_of_sag_under_press_and_electrode_pull(&table, i)
                    .limit_if_known()
                    .unwrap_or_else(|| panic!("{force_n} N: {own:?}"));
                assert!(of_sag > 0.0 && of_sag < 20.0 * bound + 1e-6, "{force_n} N: {of_sag:e} {bound:e} {own:?}");
            }
        }
        for (i, alone, bound) in &per_n {
            let (_, first, first_bound) = per_n.iter().find(|(own, ..)| own == i).unwrap();
            assert!((alone / first - 1.0).abs() < 1e-12 && (bound / first_bound - 1.0).abs() < 1e-6, "{per_n:?}");
        }
    }
}

/// Two ERAs whose own masses are of no account at rest, from 10 g to a thousand tonnes: one answer, each with a bound. Before, one of 1 t had none.
#[test]
fn moving_masses_take_no_bound_from_a_press() {
    let eras = |mass_kg: f64| {
        let mut scene = on_corners(75.0, "", "loss_factor = 0.0", 0.0);
        let mut second = scene.actuators[0].clone();
        (second.id, second.x_m, second.y_m) = ("second".into(), 0.2, 0.03);
        scene.actuators.push(second);
        for own in &mut scene.actuators {
            (own.moving_mass_kg, own.stiffness_n_per_m) = (mass_kg, 5000.0);
        }
        let table = table_at(&scene, 1e-3);
        [0, 1].map(|i| {
            (
                table.pressed[i].alone_m,
                bound_relative_mesh_error_of_travel_by_press_alone(&table, i)
                    .limit_if_known()
                    .unwrap_or_else(|| panic!("{mass_kg} kg")),
            )
        })
    };
    let first = eras(0.01);
    for mass_kg in [1.0, 10.0, 100.0, 300.0, 1e3, 3e3, 1e4, 1e5, 1e6] {
        for ((alone, bound), (first, first_bound)) in eras(mass_kg).into_iter().zip(first) {
            println!("{mass_kg} kg: {alone:e}, {bound:e}");
            assert!((alone / first - 1.0).abs() <= bound + first_bound, "{mass_kg} kg: {alone} {bound:e}, {first}");
            assert!(bound < 1e-4, "{mass_kg} kg: {bound:e}");
        }
    }
}

/// A large sheet on few supports, some of them near ERAs: what a looser tolerance bounds a tighter one does, too, and they agree. Before, 1e-4 and 1e-5 had no bound.
#[test]
fn a_tighter_tolerance_takes_no_bound_from_a_press() {
    let support = |x: f64, y: f64, stiffness: f64| {
        format!("[[support]]\nx_mm = {x}\ny_mm = {y}\nstiffness_n_per_m = {stiffness:?}\n")
    };
    let era = |id: &str, x: f64, y: f64, mass_g: f64, stiffness: f64| {
        format!(
            "[[actuator]]\nid = \"{id}\"\nx_mm = {x}\ny_mm = {y}\nmount = \"grounded\"\nmoving_mass_g = {mass_g}\nstiffness_n_per_m = \
             {stiffness:?}\ndamping_n_s_per_m = 1.0\nelectrode_area_mm2 = 100.0\nair_gap_um = 200.0\nmax_voltage_v = 500.0\n"
        )
    };
    let text = [
        "version = 1\nname = \"sheet\"\n[surface]\nkind = \"plate\"\nlength_mm = 2000\nwidth_mm = 838.2\nthickness_mm = 4\n\
         [surface.material]\nyoungs_modulus_pa = 70e9\npoisson_ratio = 0.33\ndensity_kg_m3 = 2700\n[press]\nforce_n = 1.0\n\
         [[edge]]\nside = \"top\"\nkind = \"elastic\"\nstiffness_n_per_m2 = 6781.977\nrotational_stiffness_n_per_rad = 93.962\n\
         [[mass]]\nx_mm = 2000\ny_mm = 0\nmass_g = 68364.0\n"
            .into(),
        support(1271.23, 0.0, 508.405),
        support(0.0, 0.0, 234_749.0),
        support(1475.34, 838.2, 7035.33),
        support(2000.0, 510.7, 108.592),
        support(502.52, 83.22, 597_180.0),
        era("first", 1569.02, 90.43, 0.5736, 1093.01),
        era("second", 387.39, 0.0, 0.44978, 3150.28),
        era("third", 866.22, 260.61, 0.13342, 19058.0),
    ]
    .concat();
    let scene = Scene::parse("sheet", &text).unwrap();
    let found = [1e-2, 1e-3, 1e-4].map(|tolerance| {
        let table = table_at(&scene, tolerance);
        [0, 1, 2].map(|i| {
            let bound = bound_relative_mesh_error_of_travel_by_press_alone(&table, i);
            let own = &table.pressed[i];
            println!("{tolerance} {i}: {:e} {bound:?}", own.alone_m);
            (own.alone_m, bound.limit_if_known().unwrap_or_else(|| panic!("{tolerance}: {own:?} {bound:?}")))
        })
    });
    for pair in found.windows(2) {
        for ((loose, loose_bound), (tight, tight_bound)) in pair[0].iter().zip(&pair[1]) {
            assert!((loose / tight - 1.0).abs() <= loose_bound + tight_bound, "{found:?}");
            assert!(*tight_bound < 2e-4, "{found:?}");
        }
    }
}
