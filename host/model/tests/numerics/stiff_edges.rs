//! Edges on stiff springs: their bounds hold, and stiffer ones close in on the pinned edge by the law of the corner's force.

use crate::scenes::SceneText;
use era_model::model::{Accuracy, compute_modes_with_error_bounds};
use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;

fn plate() -> SceneText {
    SceneText::plate(0.317, 0.203, 0.33).damping("loss_factor", 0.01).force(0.47, 0.44)
}

fn held(stiffness: f64) -> SceneText {
    plate().elastic_edge("left", stiffness)
}

/// Magnitude beside the third mode's resonance, and its bound, both in m/s^2.
fn response(scene: &SceneText, accuracy: Accuracy) -> (f64, f64) {
    let found =
        compute_acceleration_curves_per_newton_with_error_bounds(&scene.scene(), accuracy, (0.1, 0.05), &[170.0])
            .unwrap();
    let value = found.answer[0][0].norm();
    (value, found.bounds[0].limit_if_known().unwrap() * value)
}

/// Loose and tight answers agree within their bounds, and the loose one meets the default tolerance, from springs that are soft to ones
/// that were said not to be factored.
#[test]
fn bounds_hold_at_any_stiffness() {
    for exponent in [6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 18, 20] {
        let scene = held(10.0_f64.powi(exponent));
        let [(loose, its), (tight, own)] =
            [1e-3, 1e-5].map(|tolerance| response(&scene, Accuracy::from_tolerance(tolerance).unwrap()));
        assert!((loose - tight).abs() <= its + own, "1e{exponent}: {loose} +- {its:e}, {tight} +- {own:e}");
        assert!(its <= 1e-3 * loose, "1e{exponent}: {its:e} of {loose}");
    }
}

/// The corner's force R on springs over a length b = (D / k)^1/3 yields R / (k b): what is missing goes with k^-2/3.
#[test]
fn what_is_missing_goes_with_the_corners_length() {
    let accuracy = Accuracy::from_tolerance(1e-5).unwrap();
    let (pinned, _) = response(&plate().edge("left", "pinned"), accuracy);
    let missing = [10, 11, 12, 13].map(|exponent| pinned - response(&held(10.0_f64.powi(exponent)), accuracy).0);
    for (pair, exponent) in missing.windows(2).zip(10..) {
        let ratio = pair[0] / pair[1];
        assert!((ratio / 10.0_f64.powf(2.0 / 3.0) - 1.0).abs() < 0.05, "1e{exponent}: {ratio} of {missing:?}");
    }
    for exponent in [15, 16, 18, 20] {
        let (found, bound) = response(&held(10.0_f64.powi(exponent)), accuracy);
        assert!((found - pinned).abs() <= bound, "1e{exponent}: {found} +- {bound:e} for {pinned}");
    }
}

/// The same of frequencies, where the edge is a bar's end or turns freely, or is held against turning as well.
#[test]
fn frequencies_close_in_on_supports_from_below() {
    let turning = |scene: SceneText, k: f64| {
        scene.with(&format!("[[edge]]\nside = \"left\"\nkind = \"elastic\"\nstiffness_n_per_m2 = {k:e}\nrotational_stiffness_n_per_rad = {k:e}\n"))
    };
    let bar = || SceneText::bar(0.253);
    let cases: [(&dyn Fn(f64) -> SceneText, SceneText); 3] = [
        (&|k| held(k), plate().edge("left", "pinned")),
        (&|k| turning(plate(), k), plate().edge("left", "clamped")),
        (&|k| bar().elastic_edge("left", k), bar().edge("left", "pinned")),
    ];
    for (scene, ideal) in cases {
        let modes = |scene: &SceneText| {
            let found = compute_modes_with_error_bounds(&scene.scene(), Accuracy::from_tolerance(1e-5).unwrap(), 400.0)
                .unwrap();
            let bounds: Vec<f64> = found.bounds.iter().map(|bound| bound.limit_if_known().unwrap()).collect();
            (found.answer.iter().map(|mode| mode.frequency_hz).collect::<Vec<_>>(), bounds)
        };
        let (ideal, own) = modes(&ideal);
        let mut last = vec![0.0; ideal.len()];
        for exponent in [8, 10, 12, 14, 16, 18, 20] {
            let (found, bounds) = modes(&scene(10.0_f64.powi(exponent)));
            assert_eq!(found.len(), ideal.len(), "1e{exponent}");
            for (k, (hz, ideal)) in found.iter().zip(&ideal).enumerate() {
                let room = bounds[k] + own[k];
                assert!(*hz >= last[k] * (1.0 - room), "1e{exponent}, mode {k}: {hz} after {}", last[k]);
                assert!(*hz <= ideal * (1.0 + room), "1e{exponent}, mode {k}: {hz}, pinned or clamped {ideal}");
                if exponent >= 16 {
                    assert!(*hz >= ideal * (1.0 - room), "1e{exponent}, mode {k}: {hz}, pinned or clamped {ideal}");
                }
            }
            last = found;
        }
    }
}
