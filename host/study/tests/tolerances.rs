//! What being off does to a plan, against what follows from mechanics without a model.

mod support;

use era_model::model::Accuracy;
use era_model::model::levels::ReducedLevels;
use era_model::scene::{EdgeKind, Finger, STARTING_PLATE, Scene};
use era_planner::{Plan, PlanTable, TableOptions, Target};
use era_study::tolerances::{
    PanelDeviations, PeakRange, Spread, ToleranceKind, Tolerances, compute_target_peak_spread_under_tolerances,
};
use support::{LENGTH_M, WIDTH_M, bar};

const NOTHING: Tolerances = Tolerances { springs: 0.0, youngs_modulus: 0.0, thickness: 0.0, places_mm: 0.0 };

fn plate() -> Scene {
    Scene::parse("plate", STARTING_PLATE).unwrap()
}

fn planned(scene: Scene, at_m: (f64, f64)) -> (Scene, Plan) {
    let options = TableOptions { from_hz: 250.0, ..TableOptions::default() };
    let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
    let table = PlanTable::from_levels(&scene, levels, options).unwrap();
    let plan = table.plan(&[Target { x_m: at_m.0, y_m: at_m.1, intensity_g: Some(0.05) }]).unwrap();
    (scene, plan)
}

fn own(spread: &Spread, what: ToleranceKind) -> (f64, f64) {
    let range = find_range_of_one_change(spread, what);
    (range.least_db, range.most_db)
}

fn find_range_of_one_change(spread: &Spread, what: ToleranceKind) -> &PeakRange {
    &spread.of.iter().find(|own| own.what == what).unwrap().range
}

/// The peak at a place on a panel whose scene is this one, as the drives of other frequencies each have it.
fn peak(scene: &Scene, plan: &Plan, at_m: (f64, f64)) -> f64 {
    let hz: Vec<f64> = plan.drives.iter().map(|drive| drive.frequency_hz).collect();
    let curves = era_model::response::compute_acceleration_curves_per_newton_with_error_bounds(
        scene,
        Accuracy::BALANCED,
        at_m,
        &hz,
    )
    .unwrap();
    plan.drives.iter().enumerate().map(|(k, drive)| curves.answer[k][k].norm() * drive.force_n).sum()
}

/// A short thick bar moves as a whole in the band. Newton's second law: the acceleration of a body far above its springs goes with one over its mass, and its mass with its thickness; how
/// stiff the body, its springs are, and where they are, is of no account.
#[test]
fn a_block_is_off_by_its_mass() {
    let (scene, plan) = planned(bar(9.0), (0.5 * LENGTH_M, 0.5 * WIDTH_M));
    let off = compute_target_peak_spread_under_tolerances(&scene, &[], &plan, Tolerances::default()).unwrap();
    let (least, most) = own(&off, ToleranceKind::Thickness);
    // The outermost of 16 samples are within a sixteenth of the ends, 5 % thicker and 5 % thinner.
    let ends = (-20.0 * 1.05_f64.log10(), -20.0 * 0.95_f64.log10());
    assert!(ends.0 - 0.01 < least && least < 0.85 * ends.0, "{least} of {}", ends.0);
    assert!(0.85 * ends.1 < most && most < ends.1 + 0.01, "{most} of {}", ends.1);
    for what in [ToleranceKind::Springs, ToleranceKind::YoungsModulus, ToleranceKind::Places] {
        let (least, most) = own(&off, what);
        assert!(least.abs() < 0.1 && most.abs() < 0.1, "{what:?}: {least} to {most}");
    }
    assert!(off.range.least_db < -0.3 && off.range.most_db > 0.3 && off.range.median_db.abs() < 0.1, "{off:?}");
}

/// A finger is not part of what may be off. One whose spring has the block swing just below the drives would change the peak by decibels if it were a fifth off, or beside its place.
#[test]
fn a_finger_is_as_it_is() {
    let at_m = (0.5 * LENGTH_M, 0.5 * WIDTH_M);
    let mut scene = bar(9.0);
    let omega = std::f64::consts::TAU * 0.9 * 250.0;
    let stiffness_n_per_m = omega * omega * scene.surface_mass_with_air_kg();
    scene.finger =
        Some(Finger { mass_kg: 0.2 * scene.surface_mass_with_air_kg(), damping_n_s_per_m: 2.0, stiffness_n_per_m });
    let (touched, plan) = planned(scene.replace_finger_by_masses_and_supports_at_places(&[at_m]), at_m);
    let off = compute_target_peak_spread_under_tolerances(&scene, &[at_m], &plan, Tolerances::default()).unwrap();
    let as_a_part = compute_target_peak_spread_under_tolerances(&touched, &[], &plan, Tolerances::default()).unwrap();
    let (least, most) = own(&off, ToleranceKind::Springs);
    assert!(least.abs() < 0.15 && most.abs() < 0.15, "{least} to {most}");
    let (least, most) = own(&as_a_part, ToleranceKind::Springs);
    assert!(most - least > 1.0, "what would be found: {least} to {most}");
}

#[test]
fn nothing_that_is_off_changes_nothing() {
    let (scene, plan) = planned(plate(), (0.083, 0.061));
    let off = compute_target_peak_spread_under_tolerances(&scene, &[], &plan, NOTHING).unwrap();
    assert_eq!((off.range.least_db, off.range.median_db, off.range.most_db), (0.0, 0.0, 0.0));
}

/// One value that is off in both directions, against plans' own predictions: the response of a panel that is made so in its file.
#[test]
fn a_panel_that_is_off_does_what_a_panel_that_is_made_so_does() {
    let at_m = (0.083, 0.061);
    let (scene, plan) = planned(plate(), at_m);
    let by = |part: f64| {
        let text = STARTING_PLATE.replace("thickness_mm = 2.0", &format!("thickness_mm = {}", 2.0 * (1.0 + part)));
        peak(&Scene::parse("made", &text).unwrap(), &plan, at_m)
    };
    let meant = by(0.0);
    let level = |part: f64| 20.0 * (by(part) / meant).log10();
    let off =
        compute_target_peak_spread_under_tolerances(&scene, &[], &plan, Tolerances { thickness: 0.03, ..NOTHING })
            .unwrap();
    let (least, most) = own(&off, ToleranceKind::Thickness);
    // Within what a dense look at all thicknesses in between has.
    let levels: Vec<f64> = (-30..=30).map(|k| level(f64::from(k) / 1000.0)).collect();
    let ends = levels.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |ends, own| (ends.0.min(*own), ends.1.max(*own)));
    assert!(ends.0 - 0.1 < least && least < ends.0 + 0.25 * (ends.1 - ends.0), "{least} of {ends:?}");
    assert!(ends.1 - 0.25 * (ends.1 - ends.0) < most && most < ends.1 + 0.1, "{most} of {ends:?}");
    assert!(ends.1 - ends.0 > 1.0, "{ends:?}: it matters");
}

/// The example plate with something of everything that may be off.
fn everything() -> Scene {
    let more = "\n[[edge]]\nside = \"left\"\nkind = \"elastic\"\nstiffness_n_per_m2 = 2e4\nrotational_stiffness_n_per_rad = 20\n\
                [[edge]]\nside = \"right\"\nkind = \"pinned\"\n[[mass]]\nx_mm = 130\ny_mm = 0.2\nmass_g = 40\n";
    Scene::parse("everything", &format!("{STARTING_PLATE}{more}")).unwrap()
}

/// The scene that a told panel is, made from what is told alone.
fn made(scene: &Scene, told: &PanelDeviations) -> Scene {
    let mut scene = scene.clone();
    if let Some(springs) = &told.springs {
        assert_eq!((springs.supports.len(), springs.edges.len(), springs.actuators.len()), (4, 2, 2), "{springs:?}");
        for (own, factor) in scene.supports.iter_mut().zip(&springs.supports) {
            own.stiffness_n_per_m *= factor;
        }
        for (own, factor) in scene.actuators.iter_mut().zip(&springs.actuators) {
            own.stiffness_n_per_m *= factor;
        }
        for (own, factor) in scene.edges.iter_mut().zip(&springs.edges) {
            match &mut own.kind {
                EdgeKind::Elastic { stiffness, rotational_stiffness, .. } => {
                    (*stiffness, *rotational_stiffness) = (*stiffness * factor, *rotational_stiffness * factor);
                }
                _ => assert!((factor - 1.0).abs() < 1e-15, "what has no spring is not off: {factor}"),
            }
        }
    }
    scene.surface.material.youngs_modulus_pa *= told.youngs_modulus.unwrap_or(1.0);
    scene.surface.thickness_m *= told.thickness.unwrap_or(1.0);
    if let Some(places) = &told.places_mm {
        assert_eq!((places.supports.len(), places.masses.len(), places.actuators.len()), (4, 1, 2), "{places:?}");
        let supports = scene.supports.iter_mut().map(|own| (&mut own.x_m, &mut own.y_m)).zip(&places.supports);
        let masses = scene.masses.iter_mut().map(|own| (&mut own.x_m, &mut own.y_m)).zip(&places.masses);
        let actuators = scene.actuators.iter_mut().map(|own| (&mut own.x_m, &mut own.y_m)).zip(&places.actuators);
        for ((x_m, y_m), [x_mm, y_mm]) in supports.chain(masses).chain(actuators) {
            // Along each side, and on the border where it was hardly beside it.
            assert!((*x_m * 1e3 - x_mm).abs() < 2.5 && (*y_m * 1e3 - y_mm).abs() < 2.5, "{places:?}");
            assert!((0.0..=300.0).contains(x_mm) && (0.0..=200.0).contains(y_mm), "{places:?}");
            (*x_m, *y_m) = (x_mm / 1e3, y_mm / 1e3);
        }
    }
    scene
}

/// Whoever is told which panel was the weakest and which the strongest finds the told levels on them.
#[test]
fn the_reported_panels_have_the_reported_levels() {
    let at_m = (0.083, 0.061);
    let (scene, plan) = planned(everything(), at_m);
    let tolerances = Tolerances { springs: 0.4, places_mm: 2.0, ..Tolerances::default() };
    let off = compute_target_peak_spread_under_tolerances(&scene, &[], &plan, tolerances).unwrap();
    let meant = peak(&scene, &plan, at_m);
    let kinds = off.of.iter().map(|own| (Some(own.what), &own.range));
    for (what, range) in kinds.chain([(None, &off.range)]) {
        for (told, level_db) in [(&range.weakest, range.least_db), (&range.strongest, range.most_db)] {
            let found = 20.0 * (peak(&made(&scene, told), &plan, at_m) / meant).log10();
            assert!((found - level_db).abs() < 0.1, "{what:?}: {found} for {level_db} dB, {told:?}");
            // With one kind alone nothing else is off.
            let is_off = |own: ToleranceKind| what.is_none_or(|what| what == own);
            assert_eq!(told.springs.is_some(), is_off(ToleranceKind::Springs), "{what:?}: {told:?}");
            assert_eq!(told.youngs_modulus.is_some(), is_off(ToleranceKind::YoungsModulus), "{what:?}: {told:?}");
            assert_eq!(told.thickness.is_some(), is_off(ToleranceKind::Thickness), "{what:?}: {told:?}");
            assert_eq!(told.places_mm.is_some(), is_off(ToleranceKind::Places), "{what:?}: {told:?}");
        }
        assert!(range.most_db > range.least_db && range.weakest != range.strongest, "{what:?}: {range:?}");
    }
    // The level is the panel's own: with the other end's it would be off.
    let other = 20.0 * (peak(&made(&scene, &off.range.strongest), &plan, at_m) / meant).log10();
    assert!((other - off.range.least_db).abs() > 1.0, "{other} dB");
}

/// What is told has the names of the tolerances, and nothing of what the scene has not; a bar has no y that could be off.
#[test]
fn what_the_scene_has_none_of_is_not_reported() {
    let (scene, plan) = planned(bar(9.0), (0.5 * LENGTH_M, 0.5 * WIDTH_M));
    let off = compute_target_peak_spread_under_tolerances(&scene, &[], &plan, Tolerances::default()).unwrap();
    let told = serde_json::to_value(&off).unwrap();
    let keys = |value: &serde_json::Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    let mut weakest = keys(&told["weakest"]);
    weakest.sort();
    assert_eq!(weakest, ["places_mm", "springs", "thickness", "youngs_modulus"]);
    for list in ["springs", "places_mm"] {
        let mut own = keys(&told["weakest"][list]);
        own.sort();
        assert_eq!(own, ["actuators", "supports"], "{told}");
    }
    for own in told["of"].as_array().unwrap() {
        assert_eq!((keys(&own["weakest"]).len(), keys(&own["strongest"]).len()), (1, 1), "{own}");
    }
    for [x_mm, y_mm] in &off.range.strongest.places_mm.as_ref().unwrap().supports {
        assert!((0.0..=137.0).contains(x_mm) && (y_mm - 20.5).abs() < 1e-9, "{x_mm}, {y_mm} mm");
    }
}

/// Nothing is put into a hole, where it would move nothing: an actuator beside a cut-out is on its border instead, and drives the plate as before.
#[test]
fn what_would_be_in_a_cutout_is_on_its_border() {
    let hole = "\n[[cutout]]\nx_mm = 75.3\ny_mm = 80\nlength_mm = 40\nwidth_mm = 50\n";
    let at_m = (0.15, 0.15);
    let (scene, plan) = planned(Scene::parse("hole", &format!("{STARTING_PLATE}{hole}")).unwrap(), at_m);
    let off = compute_target_peak_spread_under_tolerances(&scene, &[], &plan, Tolerances { places_mm: 5.0, ..NOTHING })
        .unwrap();
    for range in [&off.range, find_range_of_one_change(&off, ToleranceKind::Places)] {
        for panel in [&range.weakest, &range.strongest] {
            let [x_mm, y_mm] = panel.places_mm.as_ref().unwrap().actuators[0];
            assert_eq!(scene.cutout_number_counted_from_1_at(x_mm / 1e3, y_mm / 1e3), None, "{x_mm}, {y_mm} mm");
        }
        assert!(range.least_db > -3.0, "{range:?}");
    }
}
