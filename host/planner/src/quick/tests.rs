use super::*;
use crate::STANDARD_GRAVITY;
use crate::maps::touched::TouchedReach;
use crate::maps::weakest::{
    find_weakest_place_of_touched_reach, weakest_place_with_setting_per_place_if_frequencies_usable,
};
use crate::scene::random::random_scene_text;
use era_model::model::PanelModel;
use era_model::response::compute_acceleration_curves_per_newton;
use era_model::scene::{Actuator, EXAMPLE_BAR, STARTING_PLATE};

const OPTIONS: TableOptions = TableOptions { from_hz: 40.0, to_hz: 400.0, step_hz: 1.0 };

fn plate() -> Scene {
    Scene::parse("plate", STARTING_PLATE).unwrap()
}

/// Of no round size, its ERAs anywhere.
fn odd_plate(places_m: &[(f64, f64)]) -> Scene {
    let mut scene = plate();
    let (length_m, width_m) = (0.3437, 0.2211);
    for support in &mut scene.supports {
        support.x_m *= length_m / scene.surface.length_m;
        support.y_m *= width_m / scene.surface.width_m;
    }
    (scene.surface.length_m, scene.surface.width_m) = (length_m, width_m);
    let own = scene.actuators[0].clone();
    let actuator = |(k, (x_m, y_m)): (usize, &(f64, f64))| Actuator {
        id: format!("era{k}"),
        x_m: x_m * length_m,
        y_m: y_m * width_m,
        ..own.clone()
    };
    scene.actuators = places_m.iter().enumerate().map(actuator).collect();
    scene
}

fn quick(scene: &Scene) -> WeakestPlace {
    QuickPanel::new(scene, OPTIONS).unwrap().find_place_of_least_achievable_peak(scene, Measure::G).unwrap()
}

/// Over all points and frequencies, of the scene's own elements, without bounds.
fn thorough(scene: &Scene) -> Option<f64> {
    let model = PanelModel::build(scene, Accuracy::BALANCED, OPTIONS.to_hz)
        .ok()?
        .reduce_with_residual_shapes_of_actuators_damping_and_points(OPTIONS.to_hz, &[])
        .ok()?;
    let table = PlanTable::build(scene, model, OPTIONS).ok()?;
    Some(weakest_place_with_setting_per_place_if_frequencies_usable(&table, Measure::G)?.peak)
}

#[test]
fn it_is_the_least_of_a_thorough_look() {
    let places = [(0.25, 0.5), (0.75, 0.5), (0.31, 0.22)];
    let bar = Scene::parse("bar", EXAMPLE_BAR).unwrap();
    let scenes = [plate(), bar, odd_plate(&places[..2]), odd_plate(&places), odd_plate(&[(0.13, 0.87), (0.71, 0.29)])];
    for scene in scenes {
        let (found, wanted) = (quick(&scene), thorough(&scene).unwrap());
        assert!((found.peak / wanted - 1.0).abs() < 0.02, "{}: {found:?} for {wanted}", scene.name);
    }
}

#[test]
fn designs_at_random_are_too() {
    let mut off: Vec<f64> = Vec::new();
    for number in 0..10 {
        let scene = Scene::parse("random", &random_scene_text(4711, number)).unwrap();
        let panel = QuickPanel::new(&scene, OPTIONS).unwrap();
        // Scenes that nothing can be said of are those of which a thorough look says nothing either.
        match (panel.find_place_of_least_achievable_peak(&scene, Measure::G), thorough(&scene)) {
            (Ok(found), Some(wanted)) if wanted > 1e-3 => off.push((found.peak / wanted - 1.0).abs()),
            (Ok(found), Some(wanted)) => assert!(found.peak < 2e-3, "{number}: {} for {wanted}", found.peak),
            (Err(_), None) => {}
            (found, wanted) => panic!("{number}: {found:?} {wanted:?}"),
        }
    }
    off.sort_by(f64::total_cmp);
    assert!(off.len() > 3 && off[off.len() / 2] < 0.02 && off[off.len() - 1] < 0.1, "{off:?}");
}

/// With a finger, the least of all points, each with the finger on it; on its panel, and as a panel with a mass and a support at the place that is
/// told.
#[test]
fn with_a_finger_it_is_the_least_of_all_places_that_are_touched() {
    for places in [vec![(0.25, 0.5), (0.75, 0.5)], vec![(0.13, 0.87), (0.71, 0.29)]] {
        let untouched = Scene { press_n: 0.0, ..odd_plate(&places) };
        let finger = era_model::scene::Finger { mass_kg: 4e-3, damping_n_s_per_m: 3.0, stiffness_n_per_m: 1200.0 };
        let scene = Scene { finger: Some(finger), ..untouched.clone() };
        let (found, plain) = (quick(&scene), quick(&untouched));
        let panel = BarePanel::build(&scene, Accuracy::BALANCED, OPTIONS.to_hz).unwrap();
        let options = TableOptions { step_hz: 2.0, ..OPTIONS };
        let table = PlanTable::build(&scene, panel.couple_to_design(&scene).unwrap(), options).unwrap();
        let touched = TouchedPanel::new(&panel, &scene, &table);
        let reach = TouchedReach::compute_at_each_point_if_frequencies_usable(&table, touched, None, Measure::G)
            .unwrap()
            .unwrap();
        let wanted = find_weakest_place_of_touched_reach(&table, &reach).unwrap();
        assert!((found.peak / wanted.peak - 1.0).abs() < 0.03, "{found:?} for {wanted:?}");
        assert!((found.peak / plain.peak - 1.0).abs() > 0.01, "{found:?} {plain:?}");
        let (x_m, y_m) = found.at_m;
        let mut written = untouched;
        written.masses.push(era_model::scene::Mass { x_m, y_m, mass_kg: 4e-3 });
        written.supports.push(era_model::scene::Support {
            x_m,
            y_m,
            stiffness_n_per_m: 1200.0,
            damping_n_s_per_m: 3.0,
            rotational_stiffness_n_m_per_rad: 0.0,
            loss_factor: 0.0,
        });
        let model = PanelModel::build(&written, Accuracy::BALANCED, OPTIONS.to_hz)
            .unwrap()
            .reduce_with_residual_shapes_of_actuators_damping_and_points(OPTIONS.to_hz, &[]);
        let table = PlanTable::build(&written, model.unwrap(), OPTIONS).unwrap();
        let plan = table.plan(&[crate::Target { x_m, y_m, intensity_g: Some(1e6) }]).unwrap();
        let peak = plan.predicted.target_peak_g;
        assert!((found.peak / peak - 1.0).abs() < 0.03, "{found:?} for {peak}");
    }
}

/// With a finger places are left out by a rough look. With none left out the same is found.
#[test]
fn no_place_is_left_out_that_is_the_weakest() {
    let options = TableOptions { step_hz: 4.0, ..OPTIONS };
    for number in [3, 4, 8, 9, 12] {
        let mut scene = Scene::parse("random", &random_scene_text(815, number)).unwrap();
        let (part, own) = (f64::from(u32::try_from(number).unwrap() % 5 + 1), scene.surface_mass_with_air_kg());
        scene.finger = Some(era_model::scene::Finger {
            mass_kg: 0.01 * part * own,
            damping_n_s_per_m: 1.5 * part,
            stiffness_n_per_m: 400.0 * part * part,
        });
        let panel = QuickPanel::new(&scene, options).unwrap();
        let table = panel.build_strongest_drive_table_on_coarse_grid(&scene).unwrap();
        let look = |slack: f64| {
            panel.find_place_of_least_achievable_peak_under_finger(&scene, &table, Measure::G, slack).unwrap()
        };
        let (few, all) = (look(weakest::ROUGHLY), look(1.0));
        assert!(few == all && few.peak > 0.0, "{number}: {few:?} {all:?}");
    }
}

/// Equation 23 with the responses of the scene's own elements, at the place that is told.
#[test]
fn its_drives_do_there_what_is_reported() {
    let scene = odd_plate(&[(0.13, 0.87), (0.71, 0.29)]);
    let found = quick(&scene);
    let model = PanelModel::build(&scene, Accuracy::REFERENCE, OPTIONS.to_hz)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(OPTIONS.to_hz, &[])
        .unwrap();
    let shape = model.shape_deflections_at(found.at_m.0, found.at_m.1);
    let peak: f64 = found
        .drives
        .iter()
        .enumerate()
        .map(|(i, drive)| {
            compute_acceleration_curves_per_newton(&model, &shape, &[drive.frequency_hz]).unwrap()[i][0].norm()
                * drive.force_n
        })
        .sum();
    assert!(
        (peak / STANDARD_GRAVITY / found.peak - 1.0).abs() < 0.02,
        "{} for {}",
        peak / STANDARD_GRAVITY,
        found.peak
    );
    let hz = [found.drives[0].frequency_hz, found.drives[1].frequency_hz];
    assert!((hz[0] - hz[1]).abs() >= 20.0 - 1e-9 && hz.iter().all(|hz| (40.0..=400.0).contains(hz)), "{hz:?}");
}

/// A mirrored design is as strong, at the mirrored place, and one panel serves both in either order.
#[test]
fn a_mirrored_design_is_as_strong() {
    let (one, other) = (odd_plate(&[(0.13, 0.87), (0.71, 0.29)]), odd_plate(&[(0.87, 0.87), (0.29, 0.29)]));
    let panel = QuickPanel::new(&one, OPTIONS).unwrap();
    let [first, mirrored, again] =
        [&one, &other, &one].map(|scene| panel.find_place_of_least_achievable_peak(scene, Measure::G).unwrap());
    assert_eq!(first, again);
    assert!((first.peak / mirrored.peak - 1.0).abs() < 1e-4, "{} {}", first.peak, mirrored.peak);
    let turned = one.surface.length_m - mirrored.at_m.0;
    assert!(
        (first.at_m.0 - turned).abs() < 1e-6 && (first.at_m.1 - mirrored.at_m.1).abs() < 1e-6,
        "{first:?} {mirrored:?}"
    );
}

/// Neither actuators nor the panel are taken for granted.
#[test]
fn what_cannot_be_driven_says_so() {
    let scene = plate();
    let panel = QuickPanel::new(&scene, OPTIONS).unwrap();
    let mut none = scene.clone();
    none.actuators.clear();
    assert_eq!(
        panel.find_place_of_least_achievable_peak(&none, Measure::G),
        Err(QuickError::Plan(PlanError::NoActuators))
    );
    let mut many = scene.clone();
    many.actuators = vec![scene.actuators[0].clone(); MAX_ACTUATORS + 1];
    assert_eq!(
        panel.find_place_of_least_achievable_peak(&many, Measure::G),
        Err(QuickError::Plan(PlanError::Actuators { count: MAX_ACTUATORS + 1 }))
    );
    let mut thicker = scene;
    thicker.surface.thickness_m *= 2.0;
    assert_eq!(
        panel.find_place_of_least_achievable_peak(&thicker, Measure::G),
        Err(QuickError::Model(ModelError::OtherPanel { part: "surface" }))
    );
}

/// Close to a resonance every frequency of the grid is there; far from all, three times fewer.
#[test]
fn frequencies_are_close_where_resonances_are() {
    let model = PanelModel::build(&plate(), Accuracy::FAST, 400.0)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
        .unwrap();
    let hz = frequencies::choose_frequencies_denser_near_modes_hz(&model, OPTIONS);
    assert!(hz[0] == 40.0 && hz[hz.len() - 1] == 400.0);
    assert!(hz.windows(2).all(|pair| (1.0..=3.0).contains(&(pair[1] - pair[0]))), "{hz:?}");
    assert!((80..200).contains(&hz.len()), "{}", hz.len());
    // The example plate's light modes, from the crosscheck's own tables: 123.8, 125.9, 259.9 Hz.
    for resonance in [123.8, 125.9, 259.9_f64] {
        let nearest = hz.iter().map(|hz| (hz - resonance).abs()).fold(f64::INFINITY, f64::min);
        assert!(nearest <= 1.0, "{resonance}: {nearest}");
    }
}
