//! Quadrature over what lies within 10 mm of the targets: points with the areas that they stand for.
//!
//! Discs may overlap; what lies in several counts once, for the first of their targets. A disc in the middle of a panel is seven
//! points (Abramowitz and Stegun 25.4.61) where waves are long against it. Any other is Gauss' rule along chords: in each
//! rectangle of the surface, in strips between the places where the set of chords changes its form.

use crate::TARGET_RADIUS_M;
use crate::model::shape::gauss_legendre_rule_on_unit_interval;
use crate::scene::{Scene, SurfaceKind};
use std::cell::LazyCell;
use std::f64::consts::{PI, TAU};

/// Wave number times radius up to which seven points do, exact for polynomials of degree 5: of the square of a wave they leave out
/// terms of degree 6, (2 k r)^6 / 720 of it, of which they are off by a tenth, 4e-4.
const LONG_WAVE: f64 = 0.6;
/// Points across a chord, and from chord to chord, of long waves. Next to a clamped edge the square of a motion goes as the fourth power
/// of the distance from it, which is the sixth power of a cosine from chord to chord.
const LEAST_POINTS: [f64; 2] = [4.0, 8.0];
/// Most points along either: a hundred waves in a disc.
const MOST_DISC_POINTS: f64 = 256.0;

/// A point (x, y) in m on the surface, and the area in m^2 that it stands for.
pub(crate) type WeightedPoint = (f64, f64, f64);

/// Places and weights between 0 and 1.
type Rule = Vec<(f64, f64)>;

/// The quadrature points around each of `targets_m` (in m) on a panel whose shortest wave is `wave_m` long. A point in
/// several discs belongs to the first of their targets.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small counts")]
pub(crate) fn quadrature_points_around_each_target(
    scene: &Scene,
    targets_m: &[(f64, f64)],
    wave_m: f64,
) -> Vec<Vec<WeightedPoint>> {
    let reach = TAU / wave_m * TARGET_RADIUS_M;
    // The square of a wave turns by 4 k r across a chord and by 2 pi k r along an arc of half a turn; n points integrate some 2 n
    // radians.
    let [across, along] = LEAST_POINTS;
    let points = |least: f64, more: f64| {
        gauss_legendre_rule_on_unit_interval((least + more).ceil().min(MOST_DISC_POINTS) as usize)
    };
    // Made when they are needed: seven points, which most touches have, do without them, and they would take a sixth of a plan's time.
    let rules = LazyCell::new(|| [points(across, reach), points(along, 2.0 * reach)]);
    let own = targets_m.iter().enumerate().map(|(t, target)| {
        let earlier = &targets_m[..t];
        match scene.surface.kind {
            SurfaceKind::Bar => points_along_bar_around_target(scene, target.0, earlier, &rules[1]),
            SurfaceKind::Plate if reach <= LONG_WAVE && is_uncut_disc(scene, *target, earlier) => {
                seven_points_of_whole_disc(*target)
            }
            SurfaceKind::Plate => chord_rule_points_of_cut_disc(scene, *target, earlier, &rules),
        }
    });
    own.collect()
}

/// Whether no edge, cut-out or earlier disc cuts the disc around this target.
fn is_uncut_disc(scene: &Scene, (x, y): (f64, f64), earlier_targets: &[(f64, f64)]) -> bool {
    let r = TARGET_RADIUS_M;
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let apart = |other: &(f64, f64)| (other.0 - x).hypot(other.1 - y) >= 2.0 * r;
    let is_inside = x >= r && y >= r && x + r <= length && y + r <= width;
    is_inside && scene.cutouts.is_empty() && earlier_targets.iter().all(apart)
}

/// The seven points of a whole disc (Abramowitz and Stegun 25.4.61).
fn seven_points_of_whole_disc((x, y): (f64, f64)) -> Vec<WeightedPoint> {
    let r = TARGET_RADIUS_M;
    let area = PI * r * r;
    let ring = (0..6).map(|k| {
        let (sin, cos) = (PI / 3.0 * f64::from(k)).sin_cos();
        let radius = r * (2.0_f64 / 3.0).sqrt();
        (x + radius * cos, y + radius * sin, area / 8.0)
    });
    std::iter::once((x, y, area / 4.0)).chain(ring).collect()
}

/// The points of a disc that something cuts: Gauss' rule along chords, in each rectangle of the surface.
fn chord_rule_points_of_cut_disc(
    scene: &Scene,
    centre: (f64, f64),
    earlier_targets: &[(f64, f64)],
    rules: &[Rule; 2],
) -> Vec<WeightedPoint> {
    let mut points = Vec::with_capacity(rules[0].len() * rules[1].len());
    let layout = scene.layout();
    if scene.cutouts.is_empty() {
        let corner = (scene.surface.length_m, scene.surface.width_m);
        add_disc_points_in_rectangle(&mut points, centre, earlier_targets, rules, [(0.0, corner.0), (0.0, corner.1)]);
        return points;
    }
    for rows in layout.border_lines_and_outer_edges_y_m().windows(2) {
        for columns in layout.border_lines_and_outer_edges_x_m().windows(2) {
            if layout.layer_at_unless_cut_out(0.5 * (columns[0] + columns[1]), 0.5 * (rows[0] + rows[1])).is_some() {
                add_disc_points_in_rectangle(
                    &mut points,
                    centre,
                    earlier_targets,
                    rules,
                    [(columns[0], columns[1]), (rows[0], rows[1])],
                );
            }
        }
    }
    points
}

/// Adds the points of a disc that lie in a rectangle, whose ends along x and y are `sides`.
fn add_disc_points_in_rectangle(
    points: &mut Vec<WeightedPoint>,
    (x, y): (f64, f64),
    earlier_targets: &[(f64, f64)],
    [across, along]: &[Rule; 2],
    [(left, right), (bottom, top)]: [(f64, f64); 2],
) {
    let r = TARGET_RADIUS_M;
    let (left, right) = (left.max(x - r), right.min(x + r));
    if left >= right {
        return;
    }
    let mut cuts = vec![left, right];
    let on_edges = |(x, y): (f64, f64)| {
        [bottom, top].into_iter().filter(move |edge| (edge - y).abs() < r).flat_map(move |edge| {
            let along = (r * r - (edge - y) * (edge - y)).sqrt();
            [x - along, x + along]
        })
    };
    cuts.extend(on_edges((x, y)));
    for other in earlier_targets {
        cuts.extend(on_edges(*other));
        cuts.extend([other.0 - r, other.0 + r]);
        cuts.extend(x_where_target_circles_cross_m((x, y), *other));
    }
    cuts.retain(|cut| (left..=right).contains(cut));
    cuts.sort_by(f64::total_cmp);
    for ends in cuts.windows(2) {
        // x = x_0 + r sin(angle): the chords' ends are smooth in the angle.
        let (from, to) = (((ends[0] - x) / r).clamp(-1.0, 1.0).asin(), ((ends[1] - x) / r).clamp(-1.0, 1.0).asin());
        if to <= from {
            continue;
        }
        for (u, u_weight) in along {
            let angle = from + (to - from) * u;
            let (px, half) = (x + r * angle.sin(), r * angle.cos());
            let taken = earlier_targets.iter().filter_map(|other| {
                let other_half = (r * r - (px - other.0).powi(2)).max(0.0).sqrt();
                (other_half > 0.0).then_some((other.1 - other_half, other.1 + other_half))
            });
            for (low, high) in subtract_intervals(((y - half).max(bottom), (y + half).min(top)), taken) {
                for (v, v_weight) in across {
                    let weight = u_weight * (to - from) * half * v_weight * (high - low);
                    points.push((px, low + (high - low) * v, weight));
                }
            }
        }
    }
}

/// The x coordinates at which the circles around two targets cross.
fn x_where_target_circles_cross_m(centre_m: (f64, f64), other_centre_m: (f64, f64)) -> impl Iterator<Item = f64> {
    let (dx, dy) = (other_centre_m.0 - centre_m.0, other_centre_m.1 - centre_m.1);
    let distance = dx.hypot(dy);
    let across = (TARGET_RADIUS_M * TARGET_RADIUS_M - 0.25 * distance * distance).max(0.0).sqrt();
    let middle = 0.5 * (centre_m.0 + other_centre_m.0);
    let do_meet = distance > 0.0 && across > 0.0;
    [-1.0, 1.0].into_iter().filter(move |_| do_meet).map(move |side| middle + side * across * dy / distance)
}

/// What remains of an interval without those in `removed`.
fn subtract_intervals(whole: (f64, f64), removed: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut left = vec![whole];
    for (from, to) in removed {
        left = left.into_iter().flat_map(|(low, high)| [(low, high.min(from)), (low.max(to), high)]).collect();
        left.retain(|(low, high)| high > low);
    }
    left.retain(|(low, high)| high > low);
    left
}

/// The points along a bar, across which nothing changes.
fn points_along_bar_around_target(
    scene: &Scene,
    x: f64,
    earlier_targets: &[(f64, f64)],
    rule: &[(f64, f64)],
) -> Vec<WeightedPoint> {
    let r = TARGET_RADIUS_M;
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let whole = ((x - r).max(0.0), (x + r).min(length));
    let free = subtract_intervals(whole, earlier_targets.iter().map(|other| (other.0 - r, other.0 + r)));
    let points = free.into_iter().flat_map(|(from, to)| {
        rule.iter().map(move |(at, weight)| (from + (to - from) * at, 0.5 * width, weight * (to - from) * width))
    });
    points.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{EXAMPLE_BAR, STARTING_PLATE};

    /// Area and moments of what lies within 10 mm of any target, against many midpoints: discs that edges, a corner, a cut-out and
    /// other discs cut.
    #[test]
    fn what_is_near_any_target_is_integrated_once() {
        let cut = format!("{STARTING_PLATE}\n[[cutout]]\nx_mm = 31.7\ny_mm = 0.0\nlength_mm = 40.3\nwidth_mm = 33.3\n");
        let r = TARGET_RADIUS_M;
        let cases: [(&str, &[(f64, f64)]); 8] = [
            (STARTING_PLATE, &[(0.1, 0.1)]),
            (STARTING_PLATE, &[(0.0, 0.0)]),
            (STARTING_PLATE, &[(0.3 * r, 0.7 * r)]),
            (STARTING_PLATE, &[(0.1, 0.04 * r)]),
            (STARTING_PLATE, &[(0.1, 0.1), (0.1 + 1.1 * r, 0.1 - 0.4 * r), (0.1 + 0.3 * r, 0.1)]),
            (STARTING_PLATE, &[(0.1, 0.002), (0.1, 0.002), (0.1 - r, 0.5 * r)]),
            (&cut, &[(29.0e-3, 30.0e-3)]),
            (&cut, &[(73.0e-3, 35.0e-3), (75.0e-3, 31.0e-3)]),
        ];
        for (text, targets) in cases {
            let scene = Scene::parse("plate", text).unwrap();
            let layout = scene.layout();
            let steps = 2000;
            let (low, high) = (targets[0].0 - 3.0 * r, targets[0].1 - 3.0 * r);
            let step = 6.0 * r / f64::from(steps);
            let middle = |k: i32| (f64::from(k) + 0.5) * step;
            let many = (0..steps).flat_map(|i| (0..steps).map(move |j| (low + middle(i), high + middle(j))));
            let near = |(x, y): &(f64, f64)| targets.iter().any(|(a, b)| (x - a).hypot(y - b) < r);
            let is_there = |(x, y): &(f64, f64)| {
                (0.0..=scene.surface.length_m).contains(x)
                    && (0.0..=scene.surface.width_m).contains(y)
                    && layout.layer_at_unless_cut_out(*x, *y).is_some()
            };
            let many: Vec<WeightedPoint> =
                many.filter(near).filter(is_there).map(|(x, y)| (x, y, step * step)).collect();
            let (x, y) = targets[0];
            // Long waves, and ones that are as long as a disc is wide.
            for wave_m in [0.22, 0.02] {
                let points: Vec<WeightedPoint> =
                    quadrature_points_around_each_target(&scene, targets, wave_m).into_iter().flatten().collect();
                let moments: [&dyn Fn(f64, f64) -> f64; 4] = [
                    &|_, _| 1.0,
                    &|px, py| (px - x).powi(2) + (py - y).powi(2),
                    &|_, py| (py / r).powi(4),
                    &|px, py| (TAU / wave_m * px).sin().powi(2) + (TAU / wave_m * (px + py) * 0.7).cos().powi(2),
                ];
                for (k, moment) in moments.into_iter().enumerate() {
                    let of =
                        |points: &[WeightedPoint]| -> f64 { points.iter().map(|(x, y, w)| w * moment(*x, *y)).sum() };
                    let (found, wanted) = (of(&points), of(&many));
                    assert!((found - wanted).abs() < 2e-3 * wanted.abs(), "{k} of {targets:?}: {found} for {wanted}");
                }
            }
        }
    }

    /// Two targets on a bar, nearer than 10 mm: a length that lies near both counts once.
    #[test]
    fn what_is_near_two_targets_of_a_bar_counts_once() {
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let width = scene.surface.width_m;
        let near = quadrature_points_around_each_target(&scene, &[(2e-3, 0.0), (5e-3, 0.0), (5e-3, 0.0)], 0.2);
        let area: Vec<f64> =
            near.iter().map(|points| points.iter().map(|(_, _, weight)| weight / width).sum()).collect();
        assert!((area[0] - 12e-3).abs() < 1e-12 && (area[1] - 3e-3).abs() < 1e-12 && area[2] == 0.0, "{area:?}");
    }
}
