//! What breaks naive formulations: very stiff, very soft, very heavy, very thin, nothing at all, everything at once.

use crate::scenes::SceneText;
use era_model::model::{Accuracy, ModelError, PanelModel, ReducedModel};
use era_model::response;

fn modes(scene: &SceneText, max_hz: f64) -> Vec<f64> {
    let model = PanelModel::build(&scene.scene(), Accuracy::FAST, max_hz).unwrap();
    model.compute_mode_frequencies_and_poles(max_hz).unwrap().into_iter().map(|mode| mode.frequency_hz).collect()
}

fn reduced(scene: &SceneText, max_hz: f64) -> ReducedModel {
    PanelModel::build(&scene.scene(), Accuracy::FAST, max_hz)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(max_hz, &[])
        .unwrap()
}

fn zeros(scene: &SceneText) -> usize {
    modes(scene, 400.0).iter().filter(|hz| **hz == 0.0).count()
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found / expected - 1.0).abs() < tolerance, "{found} for {expected}");
}

fn plate() -> SceneText {
    SceneText::plate(0.3, 0.2, 0.33)
}

#[test]
fn rigid_motions_are_counted_by_what_holds_and_are_exactly_zero() {
    assert_eq!(zeros(&plate()), 3);
    assert_eq!(zeros(&SceneText::bar(0.25)), 2);
    assert_eq!(zeros(&plate().edge("left", "pinned")), 1);
    assert_eq!(zeros(&plate().edge("left", "clamped")), 0);
    // On the pinned edge springs hold nothing more, wherever they are.
    for places in [[1.0, 0.87153854], [0.1, 0.3], [0.5, 0.7]] {
        let hinged = |side| places.iter().fold(plate().edge(side, "pinned"), |plate, y| plate.spring(1.0, *y, 7.3e4));
        assert_eq!(zeros(&hinged("right")), 1, "{places:?}");
        assert_eq!(zeros(&hinged("left")), 0, "{places:?}");
    }
    assert_eq!(zeros(&plate().spring(0.5, 0.5, 1e4)), 2);
    assert_eq!(zeros(&plate().spring(0.0, 0.0, 1e4).spring(1.0, 1.0, 1e4)), 1);
    assert_eq!(zeros(&plate().spring(0.1, 0.1, 1e4).spring(0.5, 0.5, 1e4).spring(0.9, 0.9, 1e4)), 1, "in one line");
    assert_eq!(zeros(&plate().corner_springs(1e-9)), 0, "a spring of 1e-9 N/m holds");
    assert_eq!(zeros(&plate().corner_springs(1e18)), 0);
    assert_eq!(zeros(&plate().era("inertial", 0.3, 0.5, 0.01, 5e3, 0.0)), 3, "the ERA rides along");
    assert_eq!(zeros(&plate().era("inertial", 0.3, 0.5, 0.01, 0.0, 0.0)), 4, "a mass on no spring");
    assert_eq!(zeros(&plate().era("grounded", 0.3, 0.5, 0.01, 5e3, 0.0)), 2);
    assert_eq!(zeros(&plate().spring(0.5, 0.5, 1e4).spring(0.5, 0.5, 1e4)), 2, "twice at one place is once");
}

/// A rigid plate on four springs: sqrt(4 k / m), down to a period of weeks. At 1 N/m the plate's own bending begins to show.
#[test]
fn soft_springs_are_right_over_eighteen_decades() {
    let mass = plate().surface_mass();
    for exponent in [-12, -9, -6, -3, 0] {
        let k = 10.0_f64.powi(exponent);
        let bounce = (4.0 * k / mass).sqrt() / std::f64::consts::TAU;
        close(modes(&plate().corner_springs(k), 1000.0)[0], bounce, if exponent < 0 { 2e-5 } else { 1e-3 });
    }
}

/// Cells shrink towards the corners of a clamped and a free edge; functions of point forces in those thin cells need as many
/// Gauss points across them as anywhere. With fewer, frequencies of orders 9 and 11 had nothing in common.
#[test]
fn point_forces_in_thin_cells() {
    let mut acrylic = SceneText::plate(0.39, 0.364, 0.37);
    (acrylic.young, acrylic.density) = (3.2e9, 1190.0);
    let scene = acrylic
        .thickness(1.44e-3)
        .edge("top", "clamped")
        .era("inertial", 1.0, 0.0823, 0.0033, 5447.6, 0.2)
        .era("grounded", 0.634, 0.171, 0.0137, 4309.5, 0.2)
        .era("inertial", 0.722, 0.252, 0.0149, 1392.2, 0.2);
    let found = era_model::model::compute_modes_with_error_bounds(&scene.scene(), Accuracy::BALANCED, 400.0).unwrap();
    let compared: Vec<_> = found.steps.iter().filter(|step| step.fineness.order >= 9).collect();
    assert!(compared.len() > 1 && compared.iter().all(|step| step.bound.is_finite()), "{compared:?}");
}

/// Soft springs keep their digits beside stiff ones: a rigid plate hinged at a corner and held by two springs k at the
/// next ones has omega^2 = k/m / (1/3 -+ 1/4).
#[test]
fn soft_springs_beside_stiff_ones() {
    let mass = plate().surface_mass();
    for (stiff, soft) in [(1e12, 1e-3), (1e18, 1e-3), (1e18, 1e-6)] {
        let found = modes(&plate().spring(0.0, 0.0, stiff).spring(1.0, 0.0, soft).spring(0.0, 1.0, soft), 400.0);
        for (found, inertia) in found.iter().zip([1.0 / 3.0 + 1.0 / 4.0, 1.0 / 3.0 - 1.0 / 4.0]) {
            close(*found, (soft / mass / inertia).sqrt() / std::f64::consts::TAU, 1e-5);
        }
    }
}

/// An ERA's own mass on a spring that is next to nothing: sqrt(k / m), however far below the panel's bending.
#[test]
fn a_moving_mass_on_a_soft_spring() {
    for k in [1e-12, 1e-9, 1e-6, 1e-3] {
        let found = modes(&plate().corner_springs(2e3).era("inertial", 0.3, 0.4, 0.01, k, 0.0), 400.0);
        close(found[0], (k / 0.01_f64).sqrt() / std::f64::consts::TAU, 1e-5);
    }
}

/// A heavy mass on soft springs moves slowly, but the surface between them bends all the same: in a bar with springs k at
/// its ends and the mass at its middle, the compliance is 1 / 2k + L^3 / 48 EI.
#[test]
fn a_heavy_mass_on_soft_springs_bends_the_surface() {
    let bar = || SceneText::bar(0.25);
    for ratio in [1e6, 1e9] {
        let mass = ratio * bar().surface_mass();
        for k in [10.0, 300.0, 1e4] {
            let compliance = 0.5 / k + 0.25_f64.powi(3) / (48.0 * bar().ei());
            let slow = (1.0 / (mass * compliance)).sqrt() / std::f64::consts::TAU;
            let scene = bar().spring(0.0, 0.5, k).spring(1.0, 0.5, k).mass(0.5, 0.5, mass);
            close(modes(&scene, 400.0)[0], slow, 1e-5);
        }
    }
}

/// Only modes up to the frequency asked for are listed, slow ones included.
#[test]
fn slow_modes_above_the_highest_frequency_are_not_listed() {
    let bounce = (4.0 * 1e-6 / plate().surface_mass()).sqrt() / std::f64::consts::TAU;
    assert_eq!(modes(&plate().corner_springs(1e-6), 0.5 * bounce).len(), 0);
    assert_eq!(modes(&plate().corner_springs(1e-6), 1.01 * bounce).len(), 1);
}

/// Stiffer and stiffer springs close in on ideal supports from below and stay there.
#[test]
fn stiff_springs_reach_the_ideal_support() {
    let ideal = modes(&plate().corner_springs(1e12), 400.0);
    let mut last = 0.0;
    for exponent in [3, 5, 7, 9, 12, 14, 16, 18] {
        let first = modes(&plate().corner_springs(10.0_f64.powi(exponent)), 400.0)[0];
        assert!(first >= last * (1.0 - 1e-9), "1e{exponent}: {first} after {last}");
        last = first;
    }
    close(last, ideal[0], 1e-7);
    // And their response, with a dashpot beside them or none: the same as without the corner's motion.
    let at = |k: f64, c: f64| {
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
        let held = corners.into_iter().fold(plate(), |plate, (x, y)| plate.spring_damper(x, y, k, c));
        let model = reduced(&held.force(0.5, 0.5).damping("loss_factor", 0.01), 400.0);
        let q = response::solve_coordinates_per_newton_at_frequency(&model, 170.0).unwrap();
        response::multiply_shape_with_coordinates(&model.shape_deflections_at(0.15, 0.1), &q[0]).norm()
    };
    for (k, c) in [(1e14, 0.0), (1e16, 0.0), (1e18, 0.0), (1e18, 1.0)] {
        close(at(k, c), at(1e12, 0.0), 1e-6);
    }
}

#[test]
fn an_attached_mass_of_a_million_plates() {
    let plate_mass = plate().surface_mass();
    let scene = plate().mass(0.5, 0.5, 1e6 * plate_mass).corner_springs(1e4);
    let found = modes(&scene, 400.0);
    let expected = modes(&plate().spring(0.5, 0.5, 1e15).corner_springs(1e4), 400.0);
    // The first is the mass on the plate's springs; the others are those of a plate held at its centre.
    assert!(found[0] > 0.0 && found[0] < 0.2, "{}", found[0]);
    for hz in expected.iter().filter(|hz| **hz > 20.0) {
        assert!(found.iter().any(|found| (found / hz - 1.0).abs() < 1e-4), "{hz} of {expected:?} in {found:?}");
    }
}

/// The heavy mass moves slowly, but on a panel as stiff as ever: its mode is as well known as the others, and a tighter
/// tolerance is met by a better answer. With its hundred entries in K and M at once, iterations took all vectors there are, and
/// the bound, taken from the frequency, stayed at 6e-5.
#[test]
fn a_million_plates_within_any_tolerance() {
    let scene = plate().mass(0.5, 0.5, 1e6 * plate().surface_mass()).corner_springs(1e4).scene();
    let answer = |tolerance: f64| {
        let found = era_model::model::compute_modes_with_error_bounds(
            &scene,
            Accuracy::from_tolerance(tolerance).unwrap(),
            500.0,
        )
        .unwrap();
        let bounds: Vec<f64> = found.bounds.iter().map(|bound| bound.limit_if_known().unwrap()).collect();
        assert!(bounds.iter().all(|bound| *bound <= tolerance), "{tolerance:e}: {bounds:?}");
        (found.answer, bounds)
    };
    let (best, best_bounds) = answer(1e-6);
    for tolerance in [1e-2, 1e-3, 1e-4] {
        let (modes, bounds) = answer(tolerance);
        for (((mode, bound), best), best_bound) in modes.iter().zip(&bounds).zip(&best).zip(&best_bounds) {
            let error = (mode.frequency_hz / best.frequency_hz - 1.0).abs();
            assert!(error <= bound + best_bound, "{tolerance:e}: {} Hz, {error:e} of {bound:e}", mode.frequency_hz);
        }
    }
}

#[test]
fn pairs_are_found_twice() {
    let square = SceneText::plate(0.3, 0.3, 0.3);
    let hz = square.plate_hz(34.80089101);
    let near = modes(&square, 1.01 * hz).into_iter().filter(|found| (found / hz - 1.0).abs() < 1e-3).count();
    assert_eq!(near, 2);
    // Four equal inertial ERAs on a heavy plate: four modes within a hair.
    let mut heavy = SceneText::plate(0.3, 0.3, 0.3);
    heavy.density = 1e6;
    heavy.young = 1e15;
    for (x, y) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
        heavy = heavy.era("inertial", x, y, 0.01, 5e3, 0.0);
    }
    let found = modes(&heavy, 150.0);
    assert_eq!(found.iter().filter(|hz| (**hz / 112.54 - 1.0).abs() < 0.01).count(), 4, "{found:?}");
}

#[test]
fn attachments_close_together_at_edges_and_corners() {
    let one = modes(&plate().spring(0.3, 0.4, 2e4), 500.0);
    // Two springs 0.1 mm apart, and two at the same place, are as good as one of twice the stiffness.
    let apart = modes(&plate().spring(0.3, 0.4, 1e4).spring(0.3 + 1e-4 / 0.3, 0.4, 1e4), 500.0);
    let together = modes(&plate().spring(0.3, 0.4, 1e4).spring(0.3, 0.4, 1e4), 500.0);
    // 0.1 mm apart they also resist tilting, ever so slightly: one motion less is free.
    let elastic = |all: &[f64]| all.iter().copied().filter(|hz| *hz > 1.0).collect::<Vec<_>>();
    for ((one, apart), together) in elastic(&one).iter().zip(elastic(&apart)).zip(elastic(&together)) {
        close(apart, *one, 1e-3);
        close(together, *one, 1e-6);
    }
    // Two ideal supports 0.1 mm apart clamp a slope, through the logarithm of their distance. Reference: C1 elements of
    // degree 7 and 8 graded to the pair (24.336 and 24.335 Hz; regular cells say 28.8).
    let mut aluminium = plate();
    aluminium.young = 69e9;
    let pair = aluminium.spring(1.0 / 3.0, 0.35, 1e12).spring(100.1 / 300.0, 0.35, 1e12);
    let found = modes(&pair, 400.0);
    assert_eq!(found[0], 0.0, "still free to turn about the line through them");
    for (found, expected) in found[1..].iter().zip([24.335, 96.505, 119.779, 187.3055]) {
        close(*found, expected, 2e-3);
    }
    let corners = plate()
        .force(0.0, 0.0)
        .force(1.0, 1.0)
        .force(1.0, 0.5)
        .force(1.0 - 1e-4 / 0.3, 0.5)
        .corner_springs(2e3)
        .damping("loss_factor", 0.01);
    let model = reduced(&corners, 400.0);
    let q = response::solve_coordinates_per_newton_at_frequency(&model, 120.0).unwrap();
    let at_edge =
        |k: usize| response::multiply_shape_with_coordinates(&model.shape_deflections_at(0.3, 0.1), &q[k]).norm();
    close(at_edge(3), at_edge(2), 1e-2);
    assert!(q.iter().all(|q| q.iter().all(|z| z.is_finite())));
}

/// Two rigid points inside a pinned plate, a tenth to a thousandth of a millimetre apart: through the logarithm of their
/// distance they hold the slope, from 337.27 Hz (one point alone, on the second mode's node line) upwards. The reference is
/// the plate's series of Levy, det of the receptances at both points, with forty digits; of 2 000 000 terms those beyond the
/// 150th are the infinite plate's, (1 + z) e^-z / 4 alpha^3 with z = alpha times the distance. Functions of the points'
/// forces alone said 351.599 Hz with a bound of 1e-4 at 0.01 mm.
#[test]
fn two_rigid_points_very_near_each_other() {
    for (distance_mm, expected) in [(0.1, 356.130395078), (0.01, 351.460328032), (0.001, 348.64210846)] {
        let mut pair = plate().all_edges("pinned").spring(0.5, 0.5, 1e18);
        pair.young = 69e9;
        let pair = pair.spring((150.0 + distance_mm) / 300.0, 0.5, 1e18);
        for tolerance in [1e-2, 1e-3, 1e-4, 1e-6] {
            let accuracy = Accuracy::from_tolerance(tolerance).unwrap();
            let found = era_model::model::compute_modes_with_error_bounds(&pair.scene(), accuracy, 360.0).unwrap();
            let bound = found.bounds[0].limit_if_known().unwrap();
            let error = (found.answer[0].frequency_hz / expected - 1.0).abs();
            assert!(error <= bound && bound <= tolerance, "{distance_mm} mm, {tolerance:e}: {error:e} of {bound:e}");
        }
    }
}

/// Neighbours are as good whichever is listed first, however unlike they are, on edges and three at once; and what a force
/// at one does, a force at the other does.
#[test]
fn neighbours_in_any_order() {
    let places = [(0.4, 0.0, 1e18), (0.4 + 1e-5 / 0.3, 0.0, 1e9), (0.4, 1e-5 / 0.2, 1e18)];
    let scene = |order: [usize; 3]| {
        let edges = plate().edge("left", "pinned").edge("right", "pinned").damping("loss_factor", 0.01);
        let held = order.into_iter().fold(edges, |scene, k| scene.spring(places[k].0, places[k].1, places[k].2));
        held.force(0.7, 0.4).force(0.7 + 1e-6 / 0.3, 0.4)
    };
    let expected = modes(&scene([0, 1, 2]), 400.0);
    for order in [[2, 1, 0], [1, 0, 2], [1, 2, 0]] {
        for (found, expected) in modes(&scene(order), 400.0).iter().zip(&expected) {
            close(*found, *expected, 1e-6);
        }
    }
    let model = reduced(&scene([0, 1, 2]), 400.0);
    let q = response::solve_coordinates_per_newton_at_frequency(&model, 250.0).unwrap();
    let at = |k: usize| response::multiply_shape_with_coordinates(&model.shape_deflections_at(0.1, 0.12), &q[k]);
    assert!((at(0) - at(1)).norm() < 1e-4 * at(0).norm());
}

/// On a node line an actuator does nothing to that mode, and the response says so instead of dividing by it.
#[test]
fn undamped_resonance_is_an_error_only_where_it_is_excited() {
    let pinned = || SceneText::bar(0.25).edge("left", "pinned").edge("right", "pinned");
    let second = pinned().bar_hz(std::f64::consts::TAU);
    let at = |x: f64| {
        let model = reduced(&pinned().force(x, 0.5), 600.0);
        // The model's own frequency: the exact one is a little beside it.
        let hz = model.lambda.iter().map(|l| l.sqrt() / std::f64::consts::TAU);
        let hz = hz.min_by(|a, b| (a - second).abs().total_cmp(&(b - second).abs())).unwrap();
        response::solve_coordinates_per_newton_at_frequency(&model, hz)
    };
    let error = at(0.3).unwrap_err();
    assert!(error.is_unbounded() && error.to_string().contains("loss_factor"), "{error}");
    let q = at(0.5).unwrap();
    assert!(q[0].iter().all(|z| z.is_finite() && z.norm() < 1.0));
}

#[test]
fn thin_thick_long_and_tiny_panels() {
    for thickness in [0.05e-3, 50e-3] {
        let scene = plate().thickness(thickness);
        let expected = scene.plate_hz(0.09 * plate_two_hz());
        close(modes(&scene, 2.0 * expected)[3], expected, 2e-3);
    }
    let strip = SceneText::plate(2.0, 0.02, 0.33);
    close(modes(&strip, 60.0)[3], strip.plate_hz(21.120132), 1e-3);
}

/// Strips of 10 m by 1 mm and more are the bars that they are: free ones bend as E I says (E of the material, as their borders
/// are free to curve), and held at points they move as bars on the same springs. With values and slopes at the borders as
/// unknowns the stiffness across, 1e16 of that along, left no pivot positive.
#[test]
fn slender_strips_are_bars() {
    let bare = |mut strip: SceneText, width: f64| {
        (strip.width_m, strip.thickness_m) = (width, 1e-3);
        strip
    };
    let held = |strip: SceneText| {
        strip.spring(0.0, 0.5, 2e3).spring(1.0, 0.5, 1e18).spring(0.3, 0.5, 50.0).mass(0.7, 0.5, 0.1)
    };
    for width in [1e-3, 3e-3, 1e-2, 3e-2] {
        for is_held in [false, true] {
            let of = |scene: SceneText| if is_held { held(bare(scene, width)) } else { bare(scene, width) };
            let (strip, bar) = (of(SceneText::plate(10.0, width, 0.33)), of(SceneText::bar(10.0)));
            let (strip, bar) = (modes(&strip, 20.0), modes(&bar, 20.0));
            // Motions that turn about the strip's axis come on top, and are fast.
            let bending = |all: &[f64]| all.iter().copied().filter(|hz| (0.01..1.0).contains(hz)).collect::<Vec<_>>();
            let (strip, bar) = (bending(&strip), bending(&bar));
            assert!(!bar.is_empty() && strip.len() == bar.len(), "{width} {is_held}: {strip:?} {bar:?}");
            // Shear aside, a strip is a bar but for (width / wave)^2.
            strip.iter().zip(&bar).for_each(|(strip, bar)| close(*strip, *bar, 2e-4));
        }
    }
}

/// omega a^2 sqrt(rho h / D) / a^2 of the first bending mode of the free 3:2 plate, from the 2 mm one at reference.
fn plate_two_hz() -> f64 {
    let scene = plate();
    let model = PanelModel::build(&scene.scene(), Accuracy::BALANCED, 200.0).unwrap();
    let hz = model.compute_mode_frequencies_and_poles(200.0).unwrap()[3].frequency_hz;
    hz / scene.plate_hz(0.09)
}

#[test]
fn extreme_frequencies() {
    let scene = plate().corner_springs(2e3).force(0.5, 0.5).damping("loss_factor", 0.01);
    let model = reduced(&scene, 400.0);
    let shape = model.shape_deflections_at(0.1, 0.05);
    let curve = response::compute_acceleration_curves_per_newton(&model, &shape, &[0.0, 1e-6, 1e-3, 1.0]).unwrap();
    assert_eq!(curve[0][0].norm(), 0.0, "a constant force accelerates nothing that is held");
    // Far below all modes the displacement is static and the acceleration goes with the square of the frequency.
    close((curve[0][2] / curve[0][1]).norm(), 1e6, 1e-6);
    // A free panel under a constant force accelerates as a rigid body: 1/m at the centre.
    let free = reduced(&plate().force(0.5, 0.5), 400.0);
    let centre = free.shape_deflections_at(0.15, 0.1);
    let curve = response::compute_acceleration_curves_per_newton(&free, &centre, &[0.0, 1e-6, 1e-2]).unwrap();
    for value in &curve[0] {
        close(value.re, 1.0 / plate().surface_mass(), 1e-6);
    }
    let too_fine = PanelModel::build(&SceneText::plate(9.0, 9.0, 0.33).scene(), Accuracy::BALANCED, 200_000.0)
        .map(|_| ())
        .unwrap_err();
    assert!(matches!(too_fine, ModelError::TooFine { .. }), "{too_fine}");
    assert!(too_fine.to_string().contains("lower frequency"), "{too_fine}");
    for max_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = PanelModel::build(&plate().scene(), Accuracy::BALANCED, max_hz).map(|_| ()).unwrap_err();
        assert!(matches!(error, ModelError::Frequency { .. }), "{error}");
    }
}

#[test]
fn nothing_to_move_and_nothing_that_moves() {
    // No load at all, and loads on a clamped edge: the modes alone, and no response.
    assert!(reduced(&plate().corner_springs(2e3), 400.0).count_coordinates() > 3);
    let clamped = ["left", "right", "top", "bottom"].iter().fold(plate(), |scene, side| scene.edge(side, "clamped"));
    let model = reduced(&clamped.force(0.0, 0.0), 400.0);
    let shape = model.shape_deflections_at(0.1, 0.05);
    let curve = response::compute_acceleration_curves_per_newton(&model, &shape, &[100.0]).unwrap();
    assert_eq!(curve[0][0].norm(), 0.0);
}

/// Two ERAs at one point: each moves what the other does, and their stiffness adds up.
#[test]
fn actuators_at_one_point() {
    let two = || {
        let scene = plate().corner_springs(2e3).damping("loss_factor", 0.01);
        scene.era("grounded", 0.3, 0.4, 0.01, 5e3, 0.7).era("grounded", 0.3, 0.4, 0.01, 5e3, 0.7)
    };
    let one = plate().corner_springs(2e3).damping("loss_factor", 0.01).era("grounded", 0.3, 0.4, 0.02, 1e4, 1.4);
    let (model, single) = (reduced(&two(), 400.0), reduced(&one, 400.0));
    for hz in [30.0, 113.0, 262.0, 400.0] {
        let at = |model: &ReducedModel, actuator: usize| {
            let q = response::solve_coordinates_per_newton_at_frequency(model, hz).unwrap();
            response::multiply_shape_with_coordinates(&model.shape_deflections_at(0.2, 0.1), &q[actuator])
        };
        assert!((at(&model, 0) - at(&model, 1)).norm() < 1e-9 * at(&model, 0).norm(), "{hz} Hz");
        assert!((at(&model, 0) - at(&single, 0)).norm() < 1e-4 * at(&single, 0).norm(), "{hz} Hz");
    }
}

/// A band far above the first modes: the mesh and the modes kept follow the frequency asked for. A mesh for 2 kHz, or its
/// modes, would be wrong altogether at 100 kHz.
#[test]
fn a_hundred_kilohertz_against_the_series() {
    let eta = 0.02;
    let scene = SceneText::bar(0.25).edge("left", "pinned").edge("right", "pinned");
    let scene = scene.force(0.3, 0.5).damping("loss_factor", eta);
    let frequencies: Vec<f64> = (0..100).map(|step| 90e3 + 100.0 * f64::from(step)).collect();
    let found = response::compute_acceleration_curves_per_newton_with_error_bounds(
        &scene.scene(),
        Accuracy::BALANCED,
        (0.71 * 0.25, 0.01),
        &frequencies,
    )
    .unwrap();
    let (mut worst, mut peak) = (0.0_f64, 0.0_f64);
    for (hz, found) in frequencies.iter().zip(&found.answer[0]) {
        let omega = std::f64::consts::TAU * hz;
        let series: num_complex::Complex64 = (1..3000)
            .map(|n| {
                let n_pi = f64::from(n) * std::f64::consts::PI;
                let square = (std::f64::consts::TAU * scene.bar_hz(n_pi)).powi(2);
                let below = num_complex::Complex64::new(square - omega * omega, eta * square);
                -omega * omega * 2.0 / scene.surface_mass() * (n_pi * 0.3).sin() * (n_pi * 0.71).sin() / below
            })
            .sum();
        worst = worst.max((found - series).norm());
        peak = peak.max(series.norm());
    }
    let bound = found.bounds[0].limit_if_known().unwrap();
    // The series is cut off too: its rest is 1e-7 of the peak.
    assert!(worst <= bound * peak + 1e-6 * peak && bound < 1e-3, "{:e} {bound:e}", worst / peak);
}

/// Half of a mode's shapes of equal frequency are arbitrary, what they do together is not: the same panel, turned round.
#[test]
fn equal_modes_answer_alike_whichever_way_round() {
    let square = |x: f64, y: f64| SceneText::plate(0.3, 0.3, 0.3).force(x, y).damping("loss_factor", 0.01);
    let (model, turned) = (reduced(&square(0.2, 0.3), 600.0), reduced(&square(0.7, 0.2), 600.0));
    for hz in [50.0, 240.0, 241.0, 600.0] {
        let at = |model: &ReducedModel, x: f64, y: f64| {
            response::multiply_shape_with_coordinates(
                &model.shape_deflections_at(x * 0.3, y * 0.3),
                &response::solve_coordinates_per_newton_at_frequency(model, hz).unwrap()[0],
            )
        };
        // A quarter turn takes (x, y) to (1 - y, x).
        let (a, b) = (at(&model, 0.9, 0.6), at(&turned, 1.0 - 0.6, 0.9));
        assert!((a - b).norm() < 1e-4 * a.norm(), "{hz} Hz: {a} {b}");
    }
}

/// Thin cells towards a corner where a clamped and a free edge meet, and a rigid point in the middle, whose function cancels
/// with the elements' across them: four layers of such cells were off by 2e-5 and said 5e-6. The reference is the same plate
/// on another mesh, which is settled to 1e-8.
#[test]
fn a_rigid_point_far_from_thin_cells() {
    for (x, y) in [(0.5, 0.5), (0.500_003, 0.500_005)] {
        let scene = SceneText::plate(0.3, 0.2, 0.3).edge("left", "clamped").edge("top", "pinned").spring(x, y, 1e9);
        let fine = era_model::model::Fineness { cell_m: 0.075, order: 11, layers: 2 };
        let expected = PanelModel::build_with_fineness(&scene.scene(), fine)
            .unwrap()
            .compute_mode_frequencies_and_poles(600.0)
            .unwrap();
        for tolerance in [1e-2, 1e-3, 1e-6] {
            let accuracy = Accuracy::from_tolerance(tolerance).unwrap();
            let found = era_model::model::compute_modes_with_error_bounds(&scene.scene(), accuracy, 600.0).unwrap();
            for ((found, bound), expected) in found.answer.iter().zip(&found.bounds).zip(&expected) {
                let error = (found.frequency_hz / expected.frequency_hz - 1.0).abs();
                let bound = bound.limit_if_known().unwrap();
                assert!(error <= bound + 1e-7, "{tolerance:e}: {} Hz, {error:e} of {bound:e}", found.frequency_hz);
            }
        }
    }
}

/// Where no mode is slower than what is asked for, whatever loses energy: an edge on springs of another loss than the surface's used to be a panic.
#[test]
fn no_mode_is_listed_where_all_are_faster() {
    let edge =
        |kind: &str| format!("[[edge]]\nside = \"left\"\nkind = \"clamped\"\n[[edge]]\nside = \"right\"\n{kind}\n");
    let elastic = |loss: f64| {
        edge(&format!(
            "kind = \"elastic\"\nstiffness_n_per_m2 = 1e6\nrotational_stiffness_n_per_rad = 10.0\nloss_factor = {loss:?}"
        ))
    };
    let (clamped, soft, lossy) = (edge("kind = \"clamped\""), elastic(0.0), elastic(0.4));
    let dashpot = "[[support]]\nx_mm = 100.0\ny_mm = 10.0\nstiffness_n_per_m = 1e5\ndamping_n_s_per_m = 50.0\nloss_factor = 0.3\n";
    for kind in ["plate", "bar"] {
        for damping in ["", "loss_factor = 0.01", "rayleigh_alpha = 3.0\nrayleigh_beta = 1e-6", "modal_ratio = 0.02"] {
            for edges in [&clamped, &soft, &lossy] {
                for attached in ["", dashpot, "[air]\nsealed_depth_mm = 5.0\n"] {
                    if kind == "bar" && attached.starts_with("[air]") {
                        continue;
                    }
                    let per_m = if kind == "bar" {
                        edges.replace("_n_per_m2", "_n_per_m").replace("_n_per_rad", "_n_m_per_rad")
                    } else {
                        edges.clone()
                    };
                    let text = format!(
                        "version = 1\nname = \"fast\"\n[surface]\nkind = \"{kind}\"\nlength_mm = 200.0\nwidth_mm = 20.0\nthickness_mm = 3.0\n\
                         [surface.material]\nyoungs_modulus_pa = 70e9\npoisson_ratio = 0.33\ndensity_kg_m3 = 2700.0\n[surface.damping]\n{damping}\n{per_m}{attached}"
                    );
                    let scene =
                        era_model::scene::Scene::parse("fast", &text).unwrap_or_else(|error| panic!("{error}\n{text}"));
                    for hz in [0.5, 10.0] {
                        let found =
                            era_model::model::compute_modes_with_error_bounds(&scene, Accuracy::FAST, hz).unwrap();
                        assert!(found.answer.is_empty(), "{text}");
                    }
                    let found = era_model::response::compute_acceleration_curves_per_newton_with_error_bounds(
                        &scene,
                        Accuracy::FAST,
                        (0.1, 0.01),
                        &[0.5, 3.0],
                    )
                    .unwrap();
                    assert!(found.answer.is_empty(), "no ERA, no curve");
                }
            }
        }
    }
}
