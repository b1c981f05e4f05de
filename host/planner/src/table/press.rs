//! What a finger's press does to the gaps: how far masses go off their middle under a steady force anywhere on the panel, what their
//! electrodes add to that, and where a stop holds them.
//!
//! A press of P newtons at (x, y) moves the mass of actuator i by P |G_i(x, y)|, which by reciprocity is the panel's deflection at (x, y) under
//! a steady newton of the actuator. Electrodes that are on in turn pull a mass that is a part u of its gap g off its middle with the mean force
//! s g phi(u), s what they take off its spring at rest and phi(u) = u / (1 - u^2)^2, half the difference of (1 - u)^-2 / 2 and (1 + u)^-2 / 2.
//! An inertial ERA's mass follows what is steady, and its gap stays. The sag is where the springs hold both: x_i = P |G_i| + sum_j G_ij s_j g_j phi(u_j).

use crate::model::ReducedModel;
use crate::physics::limits::{Electrodes, HELD, TRAVEL_PART};
use crate::physics::softening::static_receptance;
use crate::scene::{MAX_ACTUATORS, Mount, Scene};
use crate::table::{SurfaceGrid, WIDEST};
use nalgebra::DVector;
use serde::Serialize;
use stiffness::Loose;

mod stiffness;

/// Most rounds in which sags are found; each adds at most a part [`HELD`] of the one before.
const SAG_ROUNDS: usize = 100;
/// Change, as a part of the gap, that counts as none.
const SETTLED: f64 = 1e-9;

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

/// What a press does to one actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pressed {
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

/// Mean pull of electrodes in turn on a mass a part `u` of its gap off its middle, over what a spring as stiff as their softening at
/// rest would exert.
fn pull(u: f64) -> f64 {
    u / (1.0 - u * u).powi(2)
}

/// What a press of the scene's force does to every actuator. `static_receptance` is travel (row) per steady force in m/N.
#[must_use]
pub fn pressed(
    scene: &Scene,
    model: &ReducedModel,
    grid: &SurfaceGrid,
    electrodes: &[Electrodes],
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
) -> Vec<Pressed> {
    let force_n = scene.press_n;
    let p = electrodes.len().min(MAX_ACTUATORS);
    // Where a press moves the panel without end there is no steady place.
    let is_held = model.is_surface_held();
    let steady: Vec<Option<DVector<f64>>> =
        (0..p).map(|i| model.steady_coordinates_per_newton(i).filter(|_| is_held)).collect();
    let alone: Vec<((f64, f64), f64)> = (0..p)
        .map(|i| {
            // The mass of an inertial ERA follows what is steady.
            if force_n <= 0.0 || scene.actuators.get(i).is_none_or(|own| own.mount == Mount::Inertial) {
                return ((0.0, 0.0), 0.0);
            }
            steady[i].as_ref().map_or(((0.0, 0.0), f64::INFINITY), |q| {
                let (at_m, m_per_n) = furthest(scene, model, grid, q);
                (at_m, force_n * m_per_n)
            })
        })
        .collect();
    let taken = taken(electrodes, static_receptance);
    let stops: Vec<Option<f64>> = scene.actuators.iter().map(|actuator| actuator.stop_m).collect();
    let given: Vec<f64> = stops.iter().take(p).map(|stop| stop.unwrap_or(f64::INFINITY)).collect();
    // With the stops that there are, and those that are missing, one after the other: what one mass on its electrode pulls another by
    // is over when a stop holds it.
    let mut all = given.clone();
    let mut sags_m = sags(electrodes, &alone, static_receptance, &taken, &all);
    for _ in 0..p {
        let furthest = (0..p)
            .filter(|i| all[*i].is_infinite() && sags_m[*i] > TRAVEL_PART * electrodes[*i].gap_m)
            .max_by(|a, b| (alone[*a].1 / electrodes[*a].gap_m).total_cmp(&(alone[*b].1 / electrodes[*b].gap_m)));
        let Some(i) = furthest else { break };
        all[i] = TRAVEL_PART * electrodes[i].gap_m;
        sags_m = sags(electrodes, &alone, static_receptance, &taken, &all);
    }
    let loose: Vec<usize> = (0..p).filter(|i| given[*i].is_infinite() && all[*i].is_finite()).collect();
    let springs = steady.into_iter().collect::<Option<Vec<_>>>().filter(|_| !loose.is_empty()).and_then(|steady| {
        let pressed_m: Vec<Vec<f64>> = steady
            .iter()
            .map(|q| displaced(scene, model, grid, q).into_iter().map(|moved| force_n * moved).collect())
            .collect();
        let receptance = model.steady_travel_per_newton().view((0, 0), (p, p)).into_owned();
        let pulls_n: Vec<f64> = (0..p).map(|i| taken[i] * electrodes[i].gap_m * pull(TRAVEL_PART)).collect();
        let most_m: Vec<f64> = electrodes.iter().take(p).map(|own| TRAVEL_PART * own.gap_m).collect();
        let (pressed_m, pulls_n, most_m) = (&pressed_m, &pulls_n, &most_m);
        Loose { actuators: &loose, pressed_m, receptance, pulls_n, most_m }.springs()
    });
    let of = |i: usize| {
        let stop = match (given[i].is_finite(), all[i].is_finite()) {
            (true, _) => Stop::Given,
            (false, true) => Stop::Assumed,
            (false, false) => Stop::None,
        };
        let added = loose.iter().position(|own| *own == i).and_then(|k| springs.as_ref()?.get(k));
        let (at_m, alone_m) = alone[i];
        Pressed {
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

/// Where the steady motion with these coordinates is largest, in m, and how large, on the grid and at actuators.
fn furthest(scene: &Scene, model: &ReducedModel, grid: &SurfaceGrid, q: &DVector<f64>) -> ((f64, f64), f64) {
    let columns = grid.x_m.len();
    let at = |point: usize| match point.checked_sub(grid.there.len()) {
        Some(actuator) => (scene.actuators[actuator].x_m, scene.actuators[actuator].y_m),
        None => (grid.x_m[point % columns], grid.y_m[point / columns]),
    };
    let moved = displaced(scene, model, grid, q).into_iter().map(f64::abs).enumerate();
    // Of equals the first.
    let (point, most) = moved.fold((0, 0.0), |best, next| if next.1 > best.1 { next } else { best });
    (at(point), most)
}

/// The steady motion with these coordinates at the grid's points, 0 in cut-outs, and at the actuators.
fn displaced(scene: &Scene, model: &ReducedModel, grid: &SurfaceGrid, q: &DVector<f64>) -> Vec<f64> {
    let on_grid = &grid.shapes * q;
    let on_grid = on_grid.iter().zip(&grid.there).map(|(moved, there)| if *there { *moved } else { 0.0 });
    let at_actuators = scene.actuators.iter().map(|own| model.shape_deflections_at(own.x_m, own.y_m).dot(q));
    on_grid.chain(at_actuators).collect()
}

/// What the electrodes take off each spring at rest at the highest voltages, in N/m; of that no more than plans are allowed.
fn taken(electrodes: &[Electrodes], static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS]) -> Vec<f64> {
    let most: Vec<f64> =
        electrodes.iter().take(MAX_ACTUATORS).map(|own| WIDEST * own.softening(own.max_voltage_v, 0.0)).collect();
    let part = |row: &[f64; MAX_ACTUATORS]| row.iter().zip(&most).map(|(g, s)| g * s).sum::<f64>();
    let largest = static_receptance.iter().take(most.len()).map(part).fold(0.0, f64::max);
    let allowed = if largest > HELD { HELD / largest } else { 1.0 };
    most.into_iter().map(|s| s * allowed).collect()
}

/// The sags in m on a `model` for the places and stops that were found, all of them on another mesh's.
#[must_use]
pub fn sags_on(scene: &Scene, model: &ReducedModel, electrodes: &[Electrodes], pressed: &[Pressed]) -> Vec<f64> {
    let is_held = model.is_surface_held();
    let alone: Vec<((f64, f64), f64)> = pressed
        .iter()
        .enumerate()
        .map(|(i, Pressed { at_m, alone_m, .. })| {
            let coordinates = model.steady_coordinates_per_newton(i).filter(|_| is_held && alone_m.is_finite());
            let moved = coordinates.map(|q| scene.press_n * model.shape_deflections_at(at_m.0, at_m.1).dot(&q).abs());
            // One that follows what is steady stays where it is.
            (*at_m, if *alone_m > 0.0 { moved.unwrap_or(f64::INFINITY) } else { 0.0 })
        })
        .collect();
    let receptance = static_receptance(model);
    let stops_m: Vec<f64> = pressed.iter().map(|own| own.stop_m).collect();
    sags(electrodes, &alone, &receptance, &taken(electrodes, &receptance), &stops_m)
}

/// Where the springs hold press and pull, or a stop does, in m.
fn sags(
    electrodes: &[Electrodes],
    alone: &[((f64, f64), f64)],
    static_receptance: &[[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
    taken: &[f64],
    stops_m: &[f64],
) -> Vec<f64> {
    let p = alone.len();
    // Beyond its gap a mass is on an electrode, whatever holds it.
    let most = |i: usize| stops_m[i].min(electrodes[i].gap_m);
    let mut x: Vec<f64> = (0..p).map(|i| alone[i].1.min(most(i))).collect();
    for _ in 0..SAG_ROUNDS {
        let pulled = |i: usize| -> f64 {
            (0..p)
                .map(|j| {
                    let u = x[j] / electrodes[j].gap_m;
                    // One without voltage, or in its middle, pulls nothing, whatever another's spring is.
                    if taken[j] <= 0.0 || u <= 0.0 {
                        return 0.0;
                    }
                    let force_n = if u < 1.0 { taken[j] * electrodes[j].gap_m * pull(u) } else { f64::INFINITY };
                    static_receptance[i][j] * force_n
                })
                .sum()
        };
        let next: Vec<f64> = (0..p).map(|i| (alone[i].1 + pulled(i)).min(most(i))).collect();
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
