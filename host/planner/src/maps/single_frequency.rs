//! One frequency for all actuators, for comparison: the strongest that it can do everywhere at once and at every point.
//!
//! At one frequency phasors add before the magnitude is taken: |sum_i H_i(x, f) u_i| with complex forces u_i, and so do
//! travels. The largest minimum over points is not a convex problem; forces are searched on a grid of amplitude ratios and
//! phases at every frequency, and the best ones refined and made safe as plans are. The result is the best found, without a
//! proof. All limits grow with the strength of a drive, so that every ratio is taken as strong as they allow.

use crate::physics::limits::BreakdownTangent;
use crate::reach::Measure;
use crate::reach::setting::{build_setting_with_strongest_pulse, derate_setting_to_safe_fraction_if_any};
use crate::table::ActuatorSetting;
use crate::table::PlanTable;
use crate::table::PointView;
use era_shared::supply::rail_index_of_channel;
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
/// Frequencies that are refined and made safe for a point at most. One or two are usual.
const REFINED_AT_POINT: usize = 24;
/// By how much refinement may be better than the best ratio and phase of the grid. Of two equal amplitudes half a step of
/// ratio, 1.9 degrees of 45, changes one by 6.8 % and the sum by 3.4 %; half a step of phase changes it by 0.2 %. More actuators
/// have a coarser grid, and what is found for them is a little further from the best.
const GAINED: f64 = 1.05;

/// What may be chosen at the one frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phases {
    /// All in phase; amplitudes are chosen.
    Equal,
    /// Amplitudes and phases are chosen.
    Chosen,
}

/// The strongest found, as they are commanded.
#[derive(Clone, Debug)]
pub struct StrongestForAllAndEachPoint {
    /// The drive with the largest minimum over the points.
    pub one: Vec<ActuatorSetting>,
    /// That minimum.
    pub least: f64,
    /// Fraction of its forces that masses that move far have left.
    pub scale: f64,
    /// The largest peak at each point.
    pub each: Vec<f64>,
}

/// How many amplitude ratios and phases are tried per frequency before refinement.
#[must_use]
pub fn count_trial_force_ratios(actuators: usize, phases: Phases) -> usize {
    list_trial_force_ratios(actuators, phases).len()
}

/// Searches all frequencies of a table over a view; `None` if no frequency is usable. The setting for all points at once is
/// refined at the finer ones.
#[must_use]
pub fn strongest_for_all_and_each_point_if_frequencies_usable(
    table: &PlanTable,
    view: &PointView,
    measure: Measure,
    phases: Phases,
) -> Option<StrongestForAllAndEachPoint> {
    let directions = list_trial_force_ratios(table.electrodes.len(), phases);
    let mut swept: Vec<FrequencySweep> = (0..table.frequencies_hz.len())
        .into_par_iter()
        .filter_map(|frequency| {
            Some(
                FrequencyModel::new(table, &view.shapes, measure, frequency)?
                    .find_best_force_ratios_for_all_and_each_point(&directions),
            )
        })
        .collect();
    swept.sort_by(|a, b| b.least.0.total_cmp(&a.least.0));
    let refined = swept.par_iter().take(REFINED).filter_map(|swept| {
        let at = FrequencyModel::new(table, &view.finer, measure, swept.frequency)?;
        let (forces, least) = at.climb_to_forces_with_largest_least_peak(directions.get(swept.least.1)?, phases);
        let (one, scale) = at.derate_to_safe_setting_and_fraction_if_any(&forces)?;
        Some((least * scale, one, scale))
    });
    let (least, one, scale) = refined.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let each = (0..view.points.len())
        .into_par_iter()
        .map(|point| {
            let shape = view.shapes.rows(point, 1).into_owned();
            let mut candidates: Vec<(f32, &FrequencySweep)> =
                swept.iter().map(|swept| (swept.most[point].0, swept)).collect();
            candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
            let mut best = 0.0_f64;
            for (square, swept) in candidates.into_iter().take(REFINED_AT_POINT) {
                if f64::from(square).sqrt() * GAINED <= best {
                    break;
                }
                let Some(at) = FrequencyModel::new(table, &shape, measure, swept.frequency) else { continue };
                let Some(direction) = directions.get(swept.most[point].1 as usize) else { continue };
                let (forces, peak) = at.climb_to_forces_with_largest_least_peak(direction, phases);
                // Being made safe only takes away.
                if peak > best
                    && let Some((_, scale)) = at.derate_to_safe_setting_and_fraction_if_any(&forces)
                {
                    best = best.max(peak * scale);
                }
            }
            best
        })
        .collect();
    Some(StrongestForAllAndEachPoint { one, least, scale, each })
}

impl StrongestForAllAndEachPoint {
    /// The better of two searches over the same view, as one with fewer choices may have come further.
    #[must_use]
    pub fn keep_better_of_both(mut self, other: &Self) -> Self {
        if other.least > self.least {
            (self.one, self.least, self.scale) = (other.one.clone(), other.least, other.scale);
        }
        self.each.iter_mut().zip(&other.each).for_each(|(own, other)| *own = own.max(*other));
        self
    }
}

/// One frequency: responses at the points, limits.
struct FrequencyModel<'a> {
    table: &'a PlanTable,
    frequency: usize,
    /// `[actuator][point]`, per newton.
    response: Vec<Vec<Complex32>>,
    /// `[actuator][other]`: travel of `actuator` per newton at `other`, in m.
    travel: Vec<Vec<Complex64>>,
    /// Likewise: what harmonics and switching on add to it, which have no phase to each other that could be relied on.
    added: Vec<Vec<f64>>,
    /// Square of the voltage per newton of each, with its strongest pulse width.
    square_volts_per_n: Vec<f64>,
    /// Most force of each alone.
    force_n: Vec<f64>,
}

/// What the grid of directions has shown at one frequency: squared peaks with the direction that they are at.
struct FrequencySweep {
    frequency: usize,
    /// The largest minimum.
    least: (f32, usize),
    /// The largest at each point.
    most: Vec<(f32, u32)>,
}

impl<'a> FrequencyModel<'a> {
    #[expect(clippy::cast_possible_truncation, reason = "single precision is enough for a search")]
    fn new(table: &'a PlanTable, shapes: &DMatrix<f64>, measure: Measure, frequency: usize) -> Option<Self> {
        let frequency_hz = *table.frequencies_hz.get(frequency)?;
        let weight = measure.weight_per_m_per_s2(frequency_hz);
        let entries: Vec<_> = table.entries.iter().map(|list| list.get(frequency)?.as_ref()).collect::<Option<_>>()?;
        let response = entries
            .iter()
            .map(|entry| {
                let re = shapes * entry.acceleration.map(|z| z.re * weight);
                let im = shapes * entry.acceleration.map(|z| z.im * weight);
                re.iter().zip(im.iter()).map(|(re, im)| Complex32::new(*re as f32, *im as f32)).collect()
            })
            .collect();
        let rows = 0..entries.len();
        let travel = rows.clone().map(|actuator| entries.iter().map(|entry| entry.travel[actuator]).collect());
        let widths: Vec<_> =
            entries.iter().map(|entry| (*entry, entry.widest_pulse_if_noticeably_stronger_else_quiet())).collect();
        let added = rows.map(|actuator| {
            let own =
                widths.iter().map(|(entry, width)| width.travel_m_per_n[actuator] - entry.travel[actuator].norm());
            own.map(|added| added.max(0.0)).collect()
        });
        let volts = table.electrodes.iter().zip(&widths);
        Some(Self {
            table,
            frequency,
            response,
            travel: travel.collect(),
            added: added.collect(),
            square_volts_per_n: volts
                .map(|(electrodes, (_, width))| {
                    electrodes.voltage_for_force_v(1.0, frequency_hz, width.pulse_width).powi(2)
                })
                .collect(),
            force_n: entries.iter().map(|entry| entry.max_force_n).collect(),
        })
    }

    /// The forces of a direction (parts of what each actuator can do alone, with phases) as strong as the limits of masses at
    /// rest allow: those of [`crate::table::shared_limits`], but with travels added as phasors. All are proportional to
    /// the strength, as forces are to the voltages' squares.
    fn scale_force_ratios_to_strongest_forces_within_limits(&self, force_ratios: &[Complex64]) -> Vec<Complex64> {
        let forces: Vec<Complex64> = force_ratios.iter().zip(&self.force_n).map(|(part, force)| part * force).collect();
        if let ([force], [most_n]) = (forces.as_slice(), self.force_n.as_slice()) {
            // Of one alone the table knows it all.
            return vec![Complex64::from_polar(*most_n, force.arg())];
        }
        let electrodes = &self.table.electrodes;
        let own_square_v = |i: usize| forces[i].norm() * self.square_volts_per_n[i];
        let mut used = 0.0_f64;
        for (i, electrodes) in electrodes.iter().enumerate() {
            let steady = self.travel[i].iter().zip(&forces).map(|(travel, force)| travel * force).sum::<Complex64>();
            let added: f64 = self.added[i].iter().zip(&forces).map(|(travel, force)| travel * force.norm()).sum();
            let travel = steady.norm() + added;
            let on_its_rail =
                (0..forces.len()).filter(|j| rail_index_of_channel(*j) == rail_index_of_channel(i)).map(own_square_v);
            let BreakdownTangent { slope_v2_per_m, bound_v2 } =
                electrodes.tangent_of_squared_breakdown_voltage_over_travel();
            used = used
                .max(own_square_v(i) / electrodes.max_voltage_v.powi(2))
                .max(travel / electrodes.max_travel_m())
                .max((on_its_rail.fold(0.0, f64::max) + slope_v2_per_m * travel) / bound_v2);
        }
        let scale = if used > 0.0 { 1.0 / used } else { 0.0 };
        forces.into_iter().map(|force| force * scale).collect()
    }

    /// Forces as they are commanded, and the part of them that is.
    fn derate_to_safe_setting_and_fraction_if_any(&self, forces: &[Complex64]) -> Option<(Vec<ActuatorSetting>, f64)> {
        let parts = forces.iter().enumerate();
        let mut setting: Vec<ActuatorSetting> =
            parts.map(|(i, force)| build_setting_with_strongest_pulse(self.table, i, self.frequency, *force)).collect();
        let scale = derate_setting_to_safe_fraction_if_any(self.table, &mut setting)?;
        Some((setting, scale))
    }

    /// Squared magnitudes at all points.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is enough for a search")]
    fn fill_squared_peak_of_each_point(&self, forces: &[Complex64], out: &mut Vec<f32>) {
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
    fn least_peak_over_points(&self, forces: &[Complex64]) -> f64 {
        let mut squares = Vec::new();
        self.fill_squared_peak_of_each_point(forces, &mut squares);
        f64::from(find_minimum(&squares)).sqrt()
    }

    fn find_best_force_ratios_for_all_and_each_point(&self, force_ratios_to_try: &[Vec<Complex64>]) -> FrequencySweep {
        let points = self.response.first().map_or(0, Vec::len);
        let mut squares = Vec::with_capacity(points);
        let (mut least, mut of_least) = (-1.0_f32, 0);
        let (mut most, mut of_most) = (vec![-1.0_f32; points], vec![0_u32; points]);
        for (index, direction) in force_ratios_to_try.iter().enumerate() {
            self.fill_squared_peak_of_each_point(
                &self.scale_force_ratios_to_strongest_forces_within_limits(direction),
                &mut squares,
            );
            let lowest = find_minimum(&squares);
            if lowest > least {
                (least, of_least) = (lowest, index);
            }
            #[expect(clippy::cast_possible_truncation, reason = "thousands")]
            let index = index as u32;
            for ((most, of), square) in most.iter_mut().zip(&mut of_most).zip(&squares) {
                *of = if *square > *most { index } else { *of };
                *most = if *square > *most { *square } else { *most };
            }
        }
        let most = most.into_iter().zip(of_most).collect();
        FrequencySweep { frequency: self.frequency, least: (least, of_least), most }
    }

    /// Climbs from a direction by ever smaller steps along the axes and across them. Steps across find the way along
    /// the ridges that a minimum over points has, where no axis leads up.
    fn climb_to_forces_with_largest_least_peak(
        &self,
        start_force_ratios: &[Complex64],
        phases: Phases,
    ) -> (Vec<Complex64>, f64) {
        let actuators = start_force_ratios.len();
        let turns = if phases == Phases::Chosen { actuators.saturating_sub(1) } else { 0 };
        let mut at: Vec<f64> = start_force_ratios.iter().map(|part| part.norm()).collect();
        at.extend(start_force_ratios.iter().skip(1).take(turns).map(|part| part.arg() / TAU));
        let direction = |at: &[f64]| -> Vec<Complex64> {
            (0..actuators)
                .map(|i| {
                    let turn = if i == 0 { 0.0 } else { at.get(actuators + i - 1).copied().unwrap_or(0.0) };
                    Complex64::from_polar(at[i].max(0.0), TAU * turn)
                })
                .collect()
        };
        let mut forces = self.scale_force_ratios_to_strongest_forces_within_limits(&direction(&at));
        let mut best = self.least_peak_over_points(&forces);
        let (mut step, mut number) = (1.0 / f64::from(RATIOS), 0);
        while step >= LEAST_STEP {
            let before = best;
            for axis in 0..4 * at.len() {
                let mut trial = at.clone();
                if axis < 2 * at.len() {
                    trial[axis / 2] += if axis % 2 == 0 { step } else { -step };
                } else {
                    number += 1;
                    let across = low_discrepancy_point(number, at.len());
                    trial.iter_mut().zip(across).for_each(|(value, part)| *value += step * (2.0 * part - 1.0));
                }
                let there = self.scale_force_ratios_to_strongest_forces_within_limits(&direction(&trial));
                let found = self.least_peak_over_points(&there);
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

fn find_minimum(values: &[f32]) -> f32 {
    values.iter().fold(f32::INFINITY, |least, value| if *value < least { *value } else { least })
}

/// Directions to try: complex parts of full force, the first real.
fn list_trial_force_ratios(actuators: usize, phases: Phases) -> Vec<Vec<Complex64>> {
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
        return both.chain(force_ratios_of_each_actuator_alone(2)).collect();
    }
    let dimensions = if chosen { 2 * actuators - 1 } else { actuators };
    let spread = (1..=SPREAD).map(|number| {
        let place = low_discrepancy_point(number, dimensions);
        (0..actuators)
            .map(|i| {
                let turn = if i == 0 { 0.0 } else { place.get(actuators + i - 1).copied().unwrap_or(0.0) };
                polar(place[i], turn)
            })
            .collect()
    });
    spread.chain(force_ratios_of_each_actuator_alone(actuators)).chain([vec![polar(1.0, 0.0); actuators]]).collect()
}

/// Each actuator by itself.
fn force_ratios_of_each_actuator_alone(actuators: usize) -> impl Iterator<Item = Vec<Complex64>> {
    (0..actuators).map(move |on| (0..actuators).map(|i| Complex64::from(f64::from(u8::from(i == on)))).collect())
}

/// The `number`-th of a sequence that fills the unit cube evenly: multiples of powers of the root of g^(d+1) = g + 1,
/// modulo 1 (Roberts' generalisation of the golden ratio).
fn low_discrepancy_point(number: u32, dimensions: usize) -> Vec<f64> {
    #[expect(clippy::cast_precision_loss, reason = "a small count")]
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
