//! What a finger's press does to the gaps: how far masses go off their middle under a steady force anywhere on the panel, what their
//! electrodes add to that, and where a stop holds them.
//!
//! A press of P newtons at (x, y) moves the mass of actuator i by P |G_i(x, y)|, which by reciprocity is the panel's deflection at (x, y) under
//! a steady newton of the actuator. Electrodes that are on in turn pull a mass that is a part u of its gap g off its middle with the mean force
//! s g phi(u), s what they take off its spring at rest and phi(u) = u / (1 - u^2)^2, half the difference of (1 - u)^-2 / 2 and (1 + u)^-2 / 2.
//! An inertial ERA's mass follows what is steady, and its gap stays. The sag is where the springs hold both: x_i = P |G_i| + sum_j G_ij s_j g_j phi(u_j).

use crate::model::ReducedModel;
use crate::physics::limits::{Electrodes, MAX_SOFTENING_FRACTION, MAX_TRAVEL_FRACTION};
use crate::physics::softening::static_receptance_magnitude_or_infinity_m_per_n;
use crate::scene::{MAX_ACTUATORS, Mount, Scene};
use crate::table::{SurfaceGrid, WIDEST_PULSE};
use nalgebra::DVector;
use serde::Serialize;
use stiffness::UnheldMasses;

mod stiffness;

/// Most rounds in which sags are found; each adds at most a part [`MAX_SOFTENING_FRACTION`] of the one before.
const SAG_ROUNDS: usize = 100;
/// Change, as a part of the gap, that counts as none.
const SETTLED: f64 = 1e-9;
/// Rounds of springs that withstand a press and furthest places with these springs. The place moves by less than a cell, so that the second round is
/// right to the second order of the first one's mistake (0.05 %).
const STIFFENING_ROUNDS: usize = 3;
/// Part of a side by which the end of a cut-out may be off the panel's border for rounding.
const ROUNDING: f64 = 1e-9;
/// How often the step of the search for the furthest place is halved, from one cell of the grid on. At a smooth maximum the remaining part is of
/// the order of 4^-18 of what the grid misses (2 %), and at a border, where the slope is not 0, of the order of 2^-18 of it.
const HALVINGS: usize = 18;

/// Where a mass is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stop {
    /// Nowhere: its springs bear the press.
    None,
    /// Where the scene says (`stop_um`).
    Given,
    /// At a third of its gap: its springs do not bear the press, and plans take it that a stop does.
    Assumed,
}

/// The effect of a press on one actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressEffect {
    /// Where a press moves its mass furthest, in m.
    pub at_m: (f64, f64),
    /// How far by itself, in m; infinite on a panel that nothing holds.
    pub alone_m: f64,
    /// How far with the electrodes' pull at the highest voltages that there are, a stop holding it.
    pub sag_m: f64,
    /// Where it is held.
    pub stop: Stop,
    /// That place in m from its middle; infinite without a stop.
    pub stop_m: f64,
    /// Springs in N/m with which it would need none, all others that need a stop having theirs; `None` where none would do, or none are
    /// needed.
    pub stiffness_n_per_m: Option<f64>,
}

/// Mean pull of electrodes in turn on a mass that is off its middle by the fraction `offset_over_gap` of its gap, relative to the
/// force of a spring with the stiffness that the electrodes take off at rest.
fn mean_pull_over_softening_times_gap_at_offset(offset_over_gap: f64) -> f64 {
    offset_over_gap / (1.0 - offset_over_gap * offset_over_gap).powi(2)
}

/// The effect of a press with the scene's force on every actuator. `static_receptance` is travel (row) per steady
/// force in m/N.
#[must_use]
pub fn compute_sag_and_stop_under_press_for_each_actuator(
    scene: &Scene,
    model: &ReducedModel,
    grid: &SurfaceGrid,
    electrodes: &[Electrodes],
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
) -> Vec<PressEffect> {
    let force_n = scene.press_n;
    let p = electrodes.len().min(MAX_ACTUATORS);
    // Where a press moves the panel without end there is no steady place.
    let is_held = model.is_surface_held();
    let steady: Vec<Option<DVector<f64>>> = (0..p)
        .map(|i| model.steady_coordinates_per_newton_unless_absent_or_driving_free_motion(i).filter(|_| is_held))
        .collect();
    let alone: Vec<((f64, f64), f64)> = (0..p)
        .map(|i| {
            // The mass of an inertial ERA follows what is steady.
            if force_n <= 0.0 || scene.actuators.get(i).is_none_or(|own| own.mount == Mount::Inertial) {
                return ((0.0, 0.0), 0.0);
            }
            steady[i].as_ref().map_or(((0.0, 0.0), f64::INFINITY), |q| {
                let (at_m, m_per_n) = find_place_and_size_of_largest_displacement(scene, model, grid, q);
                (at_m, force_n * m_per_n)
            })
        })
        .collect();
    let taken = softening_at_max_voltage_capped_for_plans_n_per_m(electrodes, static_receptance);
    let stops: Vec<Option<f64>> = scene.actuators.iter().map(|actuator| actuator.stop_m).collect();
    let given: Vec<f64> = stops.iter().take(p).map(|stop| stop.unwrap_or(f64::INFINITY)).collect();
    // With the stops that there are, and those that are missing, one after the other: what one mass on its electrode pulls another by
    // is over when a stop holds it.
    let mut all = given.clone();
    let mut sags_m =
        solve_mass_travel_by_press_and_electrode_pull_m(electrodes, &alone, static_receptance, &taken, &all);
    for _ in 0..p {
        let furthest = (0..p)
            .filter(|i| all[*i].is_infinite() && sags_m[*i] > MAX_TRAVEL_FRACTION * electrodes[*i].gap_m)
            .max_by(|a, b| (alone[*a].1 / electrodes[*a].gap_m).total_cmp(&(alone[*b].1 / electrodes[*b].gap_m)));
        let Some(i) = furthest else { break };
        all[i] = MAX_TRAVEL_FRACTION * electrodes[i].gap_m;
        sags_m = solve_mass_travel_by_press_and_electrode_pull_m(electrodes, &alone, static_receptance, &taken, &all);
    }
    let loose: Vec<usize> = (0..p).filter(|i| given[*i].is_infinite() && all[*i].is_finite()).collect();
    let springs = steady.into_iter().collect::<Option<Vec<_>>>().filter(|_| !loose.is_empty()).and_then(|steady| {
        let places: Vec<(f64, f64)> =
            list_actuator_places_m(scene).into_iter().chain(alone.iter().map(|(at_m, _)| *at_m)).collect();
        find_stiffness_to_add_against_press_if_possible_n_per_m(
            (scene, model, grid),
            (electrodes, &taken),
            &loose,
            &steady,
            places,
        )
    });
    let of = |i: usize| {
        let stop = match (given[i].is_finite(), all[i].is_finite()) {
            (true, _) => Stop::Given,
            (false, true) => Stop::Assumed,
            (false, false) => Stop::None,
        };
        let added = loose.iter().position(|own| *own == i).and_then(|k| springs.as_ref()?.get(k));
        let (at_m, alone_m) = alone[i];
        PressEffect {
            at_m,
            alone_m,
            sag_m: sags_m[i],
            stop,
            stop_m: all[i],
            stiffness_n_per_m: added.zip(scene.actuators.get(i)).map(|(added, own)| own.stiffness_n_per_m + added),
        }
    };
    (0..p).map(of).collect()
}

/// Stiffness in N/m to add to the springs of each of the actuators `loose` so that they withstand the press; `None` if no springs suffice. With
/// stiffer springs the furthest place is another one, which may be between the points of the grid: it is looked for again with the springs found.
fn find_stiffness_to_add_against_press_if_possible_n_per_m(
    (scene, model, grid): (&Scene, &ReducedModel, &SurfaceGrid),
    (electrodes, softening_n_per_m): (&[Electrodes], &[f64]),
    loose: &[usize],
    steady_coordinates: &[DVector<f64>],
    mut places: Vec<(f64, f64)>,
) -> Option<Vec<f64>> {
    let p = steady_coordinates.len();
    let receptance =
        model.steady_travel_in_gaps_or_infinity_if_driving_free_motion_m_per_n().view((0, 0), (p, p)).into_owned();
    let pulls_n: Vec<f64> = (0..p)
        .map(|i| {
            softening_n_per_m[i]
                * electrodes[i].gap_m
                * mean_pull_over_softening_times_gap_at_offset(MAX_TRAVEL_FRACTION)
        })
        .collect();
    let most_m: Vec<f64> = electrodes.iter().take(p).map(|own| MAX_TRAVEL_FRACTION * own.gap_m).collect();
    let mut added = None;
    for _ in 0..STIFFENING_ROUNDS {
        let of_actuator = |q: &DVector<f64>| -> Vec<f64> {
            let moved = evaluate_displacement_at_grid_points_and_places(model, grid, &places, q);
            moved.into_iter().map(|per_newton| scene.press_n * per_newton).collect()
        };
        let pressed_m: Vec<Vec<f64>> = steady_coordinates.iter().map(of_actuator).collect();
        let masses = UnheldMasses {
            actuators: loose,
            pressed_m: &pressed_m,
            receptance: receptance.clone(),
            pulls_n: &pulls_n,
            most_m: &most_m,
        };
        let found = masses.added_stiffness_to_withstand_press_if_possible_n_per_m()?;
        let inverse = masses.invert_stiffened_system_if_regular(&found)?;
        let furthest = loose.iter().map(|i| {
            let zero = DVector::zeros(model.count_coordinates());
            let stiffened = (0..p).fold(zero, |sum, j| sum + inverse[(*i, j)] * &steady_coordinates[j]);
            find_place_and_size_of_largest_displacement(scene, model, grid, &stiffened).0
        });
        places.extend(furthest);
        added = Some(found);
    }
    added
}

/// Position in m and size of the largest steady displacement with these coordinates anywhere on the surface. The points of the grid and the
/// actuators show about where it is; a search from there finds it to rounding, so that it does not depend on how fine the grid is, which depends
/// on the mass of the panel.
fn find_place_and_size_of_largest_displacement(
    scene: &Scene,
    model: &ReducedModel,
    grid: &SurfaceGrid,
    coordinates: &DVector<f64>,
) -> ((f64, f64), f64) {
    let places = list_actuator_places_m(scene);
    let at = |point: usize| match point.checked_sub(grid.there.len()) {
        Some(actuator) => places[actuator],
        None => grid.point_position_m(point),
    };
    let moved = evaluate_displacement_at_grid_points_and_places(model, grid, &places, coordinates)
        .into_iter()
        .map(f64::abs)
        .enumerate();
    // Of equals the first.
    let (point, most) = moved.fold((0, 0.0), |best, next| if next.1 > best.1 { next } else { best });
    let (layout, length_m, width_m) = (scene.layout(), scene.surface.length_m, scene.surface.width_m);
    // The layout takes what is at most a millionth of a side inside a cut-out for its border, and the panel goes on rising there.
    let is_within = |at: f64, from: f64, to: f64, side: f64| {
        (at > from || from <= ROUNDING * side) && (at < to || to >= (1.0 - ROUNDING) * side)
    };
    let is_inside_cutout = |x_m: f64, y_m: f64| {
        scene.cutouts.iter().any(|cutout| {
            is_within(x_m, cutout.x_m, cutout.x_m + cutout.length_m, length_m)
                && is_within(y_m, cutout.y_m, cutout.y_m + cutout.width_m, width_m)
        })
    };
    let size_at = |(x_m, y_m): (f64, f64)| {
        let is_on_surface = layout.layer_at_unless_cut_out(x_m, y_m).is_some() && !is_inside_cutout(x_m, y_m);
        if is_on_surface { model.shape_deflections_at(x_m, y_m).dot(coordinates).abs() } else { 0.0 }
    };
    let steps_m = grid.column_and_row_spacing_or_infinity_m();
    climb_to_largest_value((at(point), most), steps_m, (length_m, width_m), size_at)
}

/// The place in m near `start`, and the value there, from which no step along a side of the surface leads to a larger value (compass search:
/// Kolda, Lewis and Torczon, SIAM Review 45, 2003). The first steps along x and y are `steps_m` long, or none if infinite.
fn climb_to_largest_value(
    start: ((f64, f64), f64),
    steps_m: (f64, f64),
    (length_m, width_m): (f64, f64),
    value_at: impl Fn((f64, f64)) -> f64,
) -> ((f64, f64), f64) {
    let step_or_none = |step: f64| if step.is_finite() { step } else { 0.0 };
    let (mut step_x, mut step_y) = (step_or_none(steps_m.0), step_or_none(steps_m.1));
    let ((mut x, mut y), mut most) = start;
    for _ in 0..HALVINGS {
        // A value only rises, and a surface ends: two steps of each length are enough but on a ridge.
        for _ in 0..8 {
            let around = [(step_x, 0.0), (-step_x, 0.0), (0.0, step_y), (0.0, -step_y)];
            let neighbours = around.map(|(dx, dy)| ((x + dx).clamp(0.0, length_m), (y + dy).clamp(0.0, width_m)));
            let better = neighbours.into_iter().map(|at| (at, value_at(at))).filter(|(_, value)| *value > most);
            let Some(best) = better.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            ((x, y), most) = best;
        }
        (step_x, step_y) = (0.5 * step_x, 0.5 * step_y);
    }
    ((x, y), most)
}

fn list_actuator_places_m(scene: &Scene) -> Vec<(f64, f64)> {
    scene.actuators.iter().map(|own| (own.x_m, own.y_m)).collect()
}

/// The steady displacement with these coordinates at the points of the grid, 0 in cut-outs, and then at `places`, in m.
fn evaluate_displacement_at_grid_points_and_places(
    model: &ReducedModel,
    grid: &SurfaceGrid,
    places: &[(f64, f64)],
    coordinates: &DVector<f64>,
) -> Vec<f64> {
    let on_grid = &grid.shapes * coordinates;
    let on_grid = on_grid.iter().zip(&grid.there).map(|(moved, there)| if *there { *moved } else { 0.0 });
    on_grid.chain(places.iter().map(|(x, y)| model.shape_deflections_at(*x, *y).dot(coordinates))).collect()
}

/// Stiffness in N/m that the electrodes take off each spring at rest at the highest voltages, but no more than plans
/// are allowed.
fn softening_at_max_voltage_capped_for_plans_n_per_m(
    electrodes: &[Electrodes],
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
) -> Vec<f64> {
    let most: Vec<f64> = electrodes
        .iter()
        .take(MAX_ACTUATORS)
        .map(|own| WIDEST_PULSE * own.max_softening_n_per_m(own.max_voltage_v, 0.0))
        .collect();
    let part = |row: &[f64; MAX_ACTUATORS]| row.iter().zip(&most).map(|(g, s)| g * s).sum::<f64>();
    let largest = static_receptance.iter().take(most.len()).map(part).fold(0.0, f64::max);
    let allowed = if largest > MAX_SOFTENING_FRACTION { MAX_SOFTENING_FRACTION / largest } else { 1.0 };
    most.into_iter().map(|s| s * allowed).collect()
}

/// The sags in m on another `model` for positions and stops that are already known.
#[must_use]
pub fn recompute_mass_travel_by_press_and_pull_on_other_model_m(
    scene: &Scene,
    model: &ReducedModel,
    electrodes: &[Electrodes],
    pressed: &[PressEffect],
) -> Vec<f64> {
    let is_held = model.is_surface_held();
    let alone: Vec<((f64, f64), f64)> = pressed
        .iter()
        .enumerate()
        .map(|(i, PressEffect { at_m, alone_m, .. })| {
            let coordinates = model
                .steady_coordinates_per_newton_unless_absent_or_driving_free_motion(i)
                .filter(|_| is_held && alone_m.is_finite());
            let moved = coordinates.map(|q| scene.press_n * model.shape_deflections_at(at_m.0, at_m.1).dot(&q).abs());
            // One that follows what is steady stays where it is.
            (*at_m, if *alone_m > 0.0 { moved.unwrap_or(f64::INFINITY) } else { 0.0 })
        })
        .collect();
    let receptance = static_receptance_magnitude_or_infinity_m_per_n(model);
    let stops_m: Vec<f64> = pressed.iter().map(|own| own.stop_m).collect();
    solve_mass_travel_by_press_and_electrode_pull_m(
        electrodes,
        &alone,
        &receptance,
        &softening_at_max_voltage_capped_for_plans_n_per_m(electrodes, &receptance),
        &stops_m,
    )
}

/// The sag of every mass in m: where the springs balance press and pull, or where a stop holds the mass.
fn solve_mass_travel_by_press_and_electrode_pull_m(
    electrodes: &[Electrodes],
    place_and_travel_by_press_alone_m: &[((f64, f64), f64)],
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
    max_softening_n_per_m: &[f64],
    stops_m: &[f64],
) -> Vec<f64> {
    let p = place_and_travel_by_press_alone_m.len();
    // Beyond its gap a mass is on an electrode, whatever holds it.
    let most = |i: usize| stops_m[i].min(electrodes[i].gap_m);
    let mut x: Vec<f64> = (0..p).map(|i| place_and_travel_by_press_alone_m[i].1.min(most(i))).collect();
    for _ in 0..SAG_ROUNDS {
        let pulled = |i: usize| -> f64 {
            (0..p)
                .map(|j| {
                    let u = x[j] / electrodes[j].gap_m;
                    // One without voltage, or in its middle, pulls nothing, whatever another's spring is.
                    if max_softening_n_per_m[j] <= 0.0 || u <= 0.0 {
                        return 0.0;
                    }
                    let force_n = if u < 1.0 {
                        max_softening_n_per_m[j] * electrodes[j].gap_m * mean_pull_over_softening_times_gap_at_offset(u)
                    } else {
                        f64::INFINITY
                    };
                    static_receptance[i][j] * force_n
                })
                .sum()
        };
        let next: Vec<f64> =
            (0..p).map(|i| (place_and_travel_by_press_alone_m[i].1 + pulled(i)).min(most(i))).collect();
        let change = (0..p).map(|i| (next[i] - x[i]).abs() / electrodes[i].gap_m).fold(0.0, f64::max);
        x = next;
        if change < SETTLED {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests;
