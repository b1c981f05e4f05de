//! One frequency for all actuators, for comparison: the strongest that it can do everywhere at once and at every point.
//!
//! At one frequency phasors add before the magnitude is taken: |sum_i H_i(x, f) u_i| with complex forces u_i, and so do
//! travels. The largest minimum over points is not a convex problem; forces are searched on a grid of amplitude ratios and
//! phases at every frequency, and the best ones refined. The result is the best found, without a proof. All limits grow
//! with the strength of a drive, so that every ratio is taken as strong as they allow.

use crate::planner::PULSE_WIDTH;
use crate::planner::limits::TRAVEL_PART;
use crate::planner::table::PlanTable;
use nalgebra::DMatrix;
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Amplitude ratios of two actuators: steps of a quarter circle.
const RATIOS: u32 = 24;
/// Phases between two actuators.
const PHASES: u32 = 48;
/// Ratios and phases of more than two actuators, spread evenly.
const SPREAD: u32 = 1500;
/// Frequencies at which the setting for all points is refined.
const REFINED: usize = 24;
/// Smallest step of the refinement, in parts of full force and in turns.
const LEAST_STEP: f64 = 1e-5;

/// What may be chosen at the one frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phases {
    /// All in phase; amplitudes are chosen.
    Equal,
    /// Amplitudes and phases are chosen.
    Chosen,
}

/// A drive of all actuators at one frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Together {
    /// Index of the frequency.
    pub frequency: usize,
    /// Force of each actuator in N.
    pub forces_n: Vec<Complex64>,
}

/// The strongest found.
#[derive(Clone, Debug)]
pub struct Found {
    /// The drive with the largest minimum over the points.
    pub one: Together,
    /// The drive that is strongest at each point, and its peak there in m/s^2.
    pub each: Vec<(Together, f64)>,
}

/// How many amplitude ratios and phases are tried per frequency before refinement.
#[must_use]
pub fn tried(actuators: usize, phases: Phases) -> usize {
    directions(actuators, phases).len()
}

/// Searches all frequencies of a table at points with these mode shapes (points x n); `None` if no frequency is usable.
/// The setting for all points at once is refined at `finer` ones.
#[must_use]
pub fn strongest(table: &PlanTable, shapes: &DMatrix<f64>, finer: &DMatrix<f64>, phases: Phases) -> Option<Found> {
    let directions = directions(table.electrodes.len(), phases);
    let swept = (0..table.frequencies_hz.len())
        .into_par_iter()
        .filter_map(|frequency| Some(At::new(table, shapes, frequency)?.sweep(&directions)))
        .reduce_with(Swept::join)?;
    let mut by_least = swept.least;
    by_least.sort_by(|a, b| b.0.total_cmp(&a.0));
    let one = by_least
        .into_par_iter()
        .take(REFINED)
        .filter_map(|(_, frequency, direction)| {
            let at = At::new(table, finer, frequency)?;
            let (forces_n, least) = at.refine(&directions[direction], phases);
            Some((Together { frequency, forces_n }, least))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1))?
        .0;
    let each = swept
        .most
        .into_par_iter()
        .enumerate()
        .filter_map(|(point, (_, frequency, direction))| {
            let at = At::new(table, &shapes.rows(point, 1).into_owned(), frequency)?;
            let (forces_n, peak) = at.refine(&directions[direction], phases);
            Some((Together { frequency, forces_n }, peak))
        })
        .collect();
    Some(Found { one, each })
}

/// One frequency: responses at the points, travels, limits.
struct At<'a> {
    table: &'a PlanTable,
    frequency: usize,
    /// `[actuator][point]`, per newton.
    response: Vec<Vec<Complex32>>,
    /// `[actuator][other]`: travel of `actuator` per newton at `other`, in m.
    travel: Vec<Vec<Complex64>>,
    /// Most force of each alone.
    force_n: Vec<f64>,
}

/// What the grid of directions has shown: squared peaks with the frequency and the direction that they are at.
struct Swept {
    /// The largest minimum at each frequency.
    least: Vec<(f32, usize, usize)>,
    /// The largest at each point.
    most: Vec<(f32, usize, usize)>,
}

impl Swept {
    fn join(mut self, mut other: Self) -> Self {
        self.least.append(&mut other.least);
        for (most, other) in self.most.iter_mut().zip(other.most) {
            // Equal ones by frequency, so that the order of joining does not matter.
            if (other.0, most.1) > (most.0, other.1) {
                *most = other;
            }
        }
        self
    }
}

impl<'a> At<'a> {
    #[allow(clippy::cast_possible_truncation, reason = "single precision is enough for a search")]
    fn new(table: &'a PlanTable, shapes: &DMatrix<f64>, frequency: usize) -> Option<Self> {
        let omega = TAU * table.frequencies_hz.get(frequency)?;
        let entries: Vec<_> = table.entries.iter().map(|list| list.get(frequency)?.as_ref()).collect::<Option<_>>()?;
        let response = entries
            .iter()
            .map(|entry| {
                let re = shapes * entry.acceleration.map(|z| z.re);
                let im = shapes * entry.acceleration.map(|z| z.im);
                re.iter().zip(im.iter()).map(|(re, im)| Complex32::new(*re as f32, *im as f32)).collect()
            })
            .collect();
        let travel = (0..entries.len())
            .map(|actuator| {
                let per_newton = entries.iter().map(|entry| table.model.travel(actuator, &entry.acceleration));
                per_newton.map(|acceleration| acceleration / (-omega * omega)).collect()
            })
            .collect();
        let force_n = entries.iter().map(|entry| entry.max_force_n).collect();
        Some(Self { table, frequency, response, travel, force_n })
    }

    /// The forces of a direction (parts of what each actuator can do alone, with phases) as strong as all limits allow.
    fn forces(&self, direction: &[Complex64]) -> Vec<Complex64> {
        let forces: Vec<Complex64> = direction.iter().zip(&self.force_n).map(|(part, force)| part * force).collect();
        let mut scale = f64::INFINITY;
        for ((own, travels), electrodes) in forces.iter().zip(&self.travel).zip(&self.table.electrodes) {
            let travel = travels.iter().zip(&forces).map(|(travel, force)| travel * force).sum::<Complex64>().norm();
            let most = if own.norm() > 0.0 {
                electrodes.max_force(travel / own.norm(), PULSE_WIDTH).0 / own.norm()
            } else {
                electrodes.gap_m * TRAVEL_PART / travel
            };
            scale = scale.min(most);
        }
        let scale = if scale.is_finite() { scale } else { 0.0 };
        forces.into_iter().map(|force| force * scale).collect()
    }

    /// Squared magnitudes at all points.
    #[allow(clippy::cast_possible_truncation, reason = "single precision is enough for a search")]
    fn squares(&self, forces: &[Complex64], out: &mut Vec<f32>) {
        let forces: Vec<Complex32> = forces.iter().map(|z| Complex32::new(z.re as f32, z.im as f32)).collect();
        out.clear();
        match (self.response.as_slice(), forces.as_slice()) {
            // By far the most common, and so worth a loop of its own that the compiler makes a vector's.
            ([a, b], [u, v]) => out.extend(a.iter().zip(b).map(|(a, b)| {
                let re = a.re * u.re - a.im * u.im + b.re * v.re - b.im * v.im;
                let im = a.re * u.im + a.im * u.re + b.re * v.im + b.im * v.re;
                re * re + im * im
            })),
            (responses, forces) => {
                let points = responses.first().map_or(0, Vec::len);
                out.extend(
                    (0..points)
                        .map(|x| responses.iter().zip(forces).map(|(h, u)| h[x] * u).sum::<Complex32>().norm_sqr()),
                );
            }
        }
    }

    /// Least peak over the points.
    fn least(&self, forces: &[Complex64]) -> f64 {
        let mut squares = Vec::new();
        self.squares(forces, &mut squares);
        f64::from(least_of(&squares)).sqrt()
    }

    fn sweep(&self, directions: &[Vec<Complex64>]) -> Swept {
        let points = self.response.first().map_or(0, Vec::len);
        let mut squares = Vec::with_capacity(points);
        let (mut least, mut of_least) = (-1.0_f32, 0);
        let (mut most, mut of_most) = (vec![-1.0_f32; points], vec![0_u32; points]);
        for (index, direction) in directions.iter().enumerate() {
            self.squares(&self.forces(direction), &mut squares);
            let lowest = least_of(&squares);
            if lowest > least {
                (least, of_least) = (lowest, index);
            }
            #[allow(clippy::cast_possible_truncation, reason = "thousands")]
            let index = index as u32;
            for ((most, of), square) in most.iter_mut().zip(&mut of_most).zip(&squares) {
                *of = if *square > *most { index } else { *of };
                *most = if *square > *most { *square } else { *most };
            }
        }
        let most = most.into_iter().zip(of_most).map(|(most, of)| (most, self.frequency, of as usize)).collect();
        Swept { least: vec![(least, self.frequency, of_least)], most }
    }

    /// Climbs from a direction by ever smaller steps along the axes and across them. Steps across find the way along
    /// the ridges that a minimum over points has, where no axis leads up.
    fn refine(&self, start: &[Complex64], phases: Phases) -> (Vec<Complex64>, f64) {
        let actuators = start.len();
        let turns = if phases == Phases::Chosen { actuators.saturating_sub(1) } else { 0 };
        let mut at: Vec<f64> = start.iter().map(|part| part.norm()).collect();
        at.extend(start.iter().skip(1).take(turns).map(|part| part.arg() / TAU));
        let direction = |at: &[f64]| -> Vec<Complex64> {
            (0..actuators)
                .map(|i| {
                    let turn = if i == 0 { 0.0 } else { at.get(actuators + i - 1).copied().unwrap_or(0.0) };
                    Complex64::from_polar(at[i].max(0.0), TAU * turn)
                })
                .collect()
        };
        let mut forces = self.forces(&direction(&at));
        let mut best = self.least(&forces);
        let (mut step, mut number) = (1.0 / f64::from(RATIOS), 0);
        while step >= LEAST_STEP {
            let before = best;
            for axis in 0..4 * at.len() {
                let mut trial = at.clone();
                if axis < 2 * at.len() {
                    trial[axis / 2] += if axis % 2 == 0 { step } else { -step };
                } else {
                    number += 1;
                    let across = evenly(number, at.len());
                    trial.iter_mut().zip(across).for_each(|(value, part)| *value += step * (2.0 * part - 1.0));
                }
                let there = self.forces(&direction(&trial));
                let found = self.least(&there);
                if found > best {
                    (at, forces, best) = (trial, there, found);
                }
            }
            if best <= before * (1.0 + 1e-6) {
                step *= 0.5;
            }
        }
        (forces, best)
    }
}

fn least_of(values: &[f32]) -> f32 {
    values.iter().fold(f32::INFINITY, |least, value| if *value < least { *value } else { least })
}

/// Directions to try: complex parts of full force, the first real.
fn directions(actuators: usize, phases: Phases) -> Vec<Vec<Complex64>> {
    let polar = |part: f64, turn: f64| Complex64::from_polar(part, TAU * turn);
    let chosen = phases == Phases::Chosen;
    if actuators <= 1 {
        return vec![vec![polar(1.0, 0.0); actuators]];
    }
    if actuators == 2 {
        let turns = if chosen { PHASES } else { 1 };
        let both = (1..RATIOS).flat_map(|k| {
            let (sin, cos) = (f64::from(k) / f64::from(RATIOS) * TAU / 4.0).sin_cos();
            (0..turns).map(move |n| vec![polar(cos, 0.0), polar(sin, f64::from(n) / f64::from(PHASES))])
        });
        return both.chain(alone(2)).collect();
    }
    let dimensions = if chosen { 2 * actuators - 1 } else { actuators };
    let spread = (1..=SPREAD).map(|number| {
        let place = evenly(number, dimensions);
        (0..actuators)
            .map(|i| {
                let turn = if i == 0 { 0.0 } else { place.get(actuators + i - 1).copied().unwrap_or(0.0) };
                polar(place[i], turn)
            })
            .collect()
    });
    spread.chain(alone(actuators)).chain([vec![polar(1.0, 0.0); actuators]]).collect()
}

/// Each actuator by itself.
fn alone(actuators: usize) -> impl Iterator<Item = Vec<Complex64>> {
    (0..actuators).map(move |on| (0..actuators).map(|i| Complex64::from(f64::from(u8::from(i == on)))).collect())
}

/// The `number`-th of a sequence that fills the unit cube evenly: multiples of powers of the root of g^(d+1) = g + 1,
/// modulo 1 (Roberts' generalisation of the golden ratio).
fn evenly(number: u32, dimensions: usize) -> Vec<f64> {
    #[allow(clippy::cast_precision_loss, reason = "a small count")]
    let power = 1.0 / (dimensions as f64 + 1.0);
    let root = (0..40).fold(2.0_f64, |g, _| (1.0 + g).powf(power));
    let mut step = 1.0;
    (0..dimensions)
        .map(|_| {
            step /= root;
            (0.5 + step * f64::from(number)).fract()
        })
        .collect()
}
