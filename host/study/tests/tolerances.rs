//! What being off does to a plan, against what follows from mechanics without a model.

mod support;

use era_model::model::Accuracy;
use era_model::model::levels::Levels;
use era_model::scene::{EXAMPLE_PLATE, Finger, Scene};
use era_planner::{Plan, PlanTable, TableOptions, Target};
use era_study::tolerances::{Spread, Tolerances, What, spread};
use support::{LENGTH_M, WIDTH_M, bar};

const NOTHING: Tolerances = Tolerances { springs: 0.0, youngs_modulus: 0.0, thickness: 0.0, places_mm: 0.0 };

fn plate() -> Scene {
    Scene::parse("plate", EXAMPLE_PLATE).unwrap()
}

fn planned(scene: Scene, at_m: (f64, f64)) -> (Scene, Plan) {
    let options = TableOptions { from_hz: 250.0, ..TableOptions::default() };
    let levels = Levels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
    let table = PlanTable::with_levels(&scene, levels, options).unwrap();
    let plan = table.plan(&[Target { x_m: at_m.0, y_m: at_m.1, intensity_g: Some(0.05) }]).unwrap();
    (scene, plan)
}

fn own(spread: &Spread, what: What) -> (f64, f64) {
    let range = spread.of.iter().find(|own| own.what == what).unwrap().range;
    (range.least_db, range.most_db)
}

/// A short thick bar moves as a whole in the band. Newton's second law: the acceleration of a body far above its springs goes with one over its mass, and its mass with its thickness; how
/// stiff the body, its springs are, and where they are, is of no account.
#[test]
fn a_block_is_off_by_its_mass() {
    let (scene, plan) = planned(bar(9.0), (0.5 * LENGTH_M, 0.5 * WIDTH_M));
    let off = spread(&scene, &[], &plan, Tolerances::default()).unwrap();
    let (least, most) = own(&off, What::Thickness);
    // The outermost of 16 samples are within a sixteenth of the ends, 5 % thicker and 5 % thinner.
    let ends = (-20.0 * 1.05_f64.log10(), -20.0 * 0.95_f64.log10());
    assert!(ends.0 - 0.01 < least && least < 0.85 * ends.0, "{least} of {}", ends.0);
    assert!(0.85 * ends.1 < most && most < ends.1 + 0.01, "{most} of {}", ends.1);
    for what in [What::Springs, What::YoungsModulus, What::Places] {
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
    let stiffness_n_per_m = omega * omega * scene.mass_kg();
    scene.finger = Some(Finger { mass_kg: 0.2 * scene.mass_kg(), damping_n_s_per_m: 2.0, stiffness_n_per_m });
    let (touched, plan) = planned(scene.touched(&[at_m]), at_m);
    let off = spread(&scene, &[at_m], &plan, Tolerances::default()).unwrap();
    let as_a_part = spread(&touched, &[], &plan, Tolerances::default()).unwrap();
    let (least, most) = own(&off, What::Springs);
    assert!(least.abs() < 0.15 && most.abs() < 0.15, "{least} to {most}");
    let (least, most) = own(&as_a_part, What::Springs);
    assert!(most - least > 1.0, "what would be found: {least} to {most}");
}

#[test]
fn nothing_that_is_off_changes_nothing() {
    let (scene, plan) = planned(plate(), (0.083, 0.061));
    let off = spread(&scene, &[], &plan, NOTHING).unwrap();
    assert_eq!((off.range.least_db, off.range.median_db, off.range.most_db), (0.0, 0.0, 0.0));
}

/// One value that is off in both directions, against plans' own predictions: the response of a panel that is made so in its file.
#[test]
fn a_panel_that_is_off_does_what_a_panel_that_is_made_so_does() {
    let at_m = (0.083, 0.061);
    let (scene, plan) = planned(plate(), at_m);
    let by = |part: f64| {
        let text = EXAMPLE_PLATE.replace("thickness_mm = 2.0", &format!("thickness_mm = {}", 2.0 * (1.0 + part)));
        let made = Scene::parse("made", &text).unwrap();
        let hz: Vec<f64> = plan.drives.iter().map(|drive| drive.frequency_hz).collect();
        let curves = era_model::response::bounded_curves(&made, Accuracy::BALANCED, at_m, &hz).unwrap();
        let each = plan.drives.iter().enumerate().map(|(k, drive)| curves.answer[k][k].norm() * drive.force_n);
        each.sum::<f64>()
    };
    let meant = by(0.0);
    let level = |part: f64| 20.0 * (by(part) / meant).log10();
    let off = spread(&scene, &[], &plan, Tolerances { thickness: 0.03, ..NOTHING }).unwrap();
    let (least, most) = own(&off, What::Thickness);
    // Within what a dense look at all thicknesses in between has.
    let levels: Vec<f64> = (-30..=30).map(|k| level(f64::from(k) / 1000.0)).collect();
    let ends = levels.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |ends, own| (ends.0.min(*own), ends.1.max(*own)));
    assert!(ends.0 - 0.1 < least && least < ends.0 + 0.25 * (ends.1 - ends.0), "{least} of {ends:?}");
    assert!(ends.1 - 0.25 * (ends.1 - ends.0) < most && most < ends.1 + 0.1, "{most} of {ends:?}");
    assert!(ends.1 - ends.0 > 1.0, "{ends:?}: it matters");
}
