//! What every actuator does at every frequency, at full force: how it shakes the points, and what it uses up of the limits.

use crate::table::shared_limits::SharedLimits;
use crate::table::{Entry, PlanTable};
use nalgebra::DMatrix;

/// Frequencies that are multiplied together: 64 of them at the 65 536 points of the largest grid take 64 MB.
const TOGETHER: usize = 64;

/// The choices for a drive at distinct frequencies: `actuators` x `frequencies`, seen from some points.
///
/// Gains are kept in single precision: 6e-8 is far below any model's error, and a surface has thousands of points.
#[derive(Clone, Debug)]
pub struct ReachSpace {
    /// In Hz, ascending.
    pub frequencies_hz: Vec<f64>,
    /// Number of points.
    pub points: usize,
    /// Number of shared limits.
    pub limits: usize,
    /// `[actuator][frequency * points + point]`: peak acceleration at full force in m/s^2, or what it is weighed to.
    gain: Vec<Vec<f32>>,
    /// `[actuator][frequency * limits + limit]`: part of a limit that full force uses; uses of all actuators add up.
    usage: Vec<Vec<f64>>,
    /// `[actuator][frequency]`: most force in N; 0 where the response is unbounded.
    force_n: Vec<Vec<f64>>,
}

/// One actuator at one frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct ReachCandidate {
    /// Most force in N; 0 if this frequency cannot be used.
    pub force_n: f64,
    /// At each point, at that force.
    pub gain: Vec<f32>,
    /// Part of each shared limit, at that force.
    pub usage: Vec<f64>,
}

impl ReachSpace {
    /// The space of `choices[actuator][frequency]`, each as long as the others in its gains and in its usages.
    #[must_use]
    pub fn new(frequencies_hz: Vec<f64>, choices: Vec<Vec<ReachCandidate>>) -> Self {
        let first = choices.first().and_then(|list| list.first());
        let (points, limits) = first.map_or((0, 0), |choice| (choice.gain.len(), choice.usage.len()));
        let mut space =
            Self { frequencies_hz, points, limits, gain: Vec::new(), usage: Vec::new(), force_n: Vec::new() };
        for list in choices {
            space.force_n.push(list.iter().map(|choice| choice.force_n).collect());
            space.usage.push(list.iter().flat_map(|choice| choice.usage.iter().copied()).collect());
            space.gain.push(list.into_iter().flat_map(|choice| choice.gain).collect());
        }
        space
    }

    /// The space of a table, seen from points with these mode shapes (points x n). Accelerations are multiplied by
    /// `weight_at_hz(frequency_hz)`: 1, or the inverse of what is just felt at that frequency.
    #[must_use]
    pub fn from_table(table: &PlanTable, shapes: &DMatrix<f64>, weight_at_hz: impl Fn(f64) -> f64) -> Self {
        let limits = &table.limits;
        let choices = table.entries.iter().enumerate().map(|(actuator, list)| {
            let entries: Vec<(Option<&Entry>, f64)> =
                list.iter().map(Option::as_ref).zip(table.frequencies_hz.iter().map(|hz| weight_at_hz(*hz))).collect();
            let choice = |entry: Option<&Entry>, gain: Vec<f32>| match entry {
                None => ReachCandidate { force_n: 0.0, gain, usage: vec![0.0; limits.allowed.len()] },
                Some(entry) => ReachCandidate {
                    force_n: entry.max_force_n,
                    gain,
                    usage: usage_fraction_of_each_limit(limits, actuator, entry),
                },
            };
            let each = entries.chunks(TOGETHER).flat_map(|chunk| {
                chunk.iter().map(|(entry, _)| *entry).zip(weighted_full_force_peaks_of_each_entry(shapes, chunk))
            });
            each.map(|(entry, gain)| choice(entry, gain)).collect()
        });
        Self::new(table.frequencies_hz.clone(), choices.collect())
    }

    /// Number of actuators.
    #[must_use]
    pub fn count_actuators(&self) -> usize {
        self.force_n.len()
    }

    /// Most force of an actuator at a frequency in N.
    #[must_use]
    pub fn max_force_n(&self, actuator: usize, frequency_index: usize) -> f64 {
        self.force_n.get(actuator).and_then(|list| list.get(frequency_index)).copied().unwrap_or(0.0)
    }

    /// The gains of an actuator at a frequency, at every point.
    #[must_use]
    pub fn weighted_acceleration_at_full_force_at_each_point(&self, actuator: usize, frequency_index: usize) -> &[f32] {
        &self.gain[actuator][frequency_index * self.points..(frequency_index + 1) * self.points]
    }

    /// What an actuator at a frequency uses up of each shared limit.
    #[must_use]
    pub fn usage_fraction_of_each_limit_at_max_force(&self, actuator: usize, frequency_index: usize) -> &[f64] {
        &self.usage[actuator][frequency_index * self.limits..(frequency_index + 1) * self.limits]
    }

    /// The frequencies at which an actuator can be used.
    #[must_use]
    pub fn usable_frequency_indices(&self, actuator: usize) -> Vec<usize> {
        let list = self.force_n.get(actuator).map(Vec::as_slice).unwrap_or_default();
        (0..list.len()).filter(|frequency| list[*frequency] > 0.0).collect()
    }

    /// Equation 23 at a point: the sum over actuators of gain times the part of full force.
    #[must_use]
    pub fn peak_at_point(&self, point: usize, frequency_indices: &[usize], force_fractions: &[f64]) -> f64 {
        frequency_indices
            .iter()
            .zip(force_fractions)
            .enumerate()
            .map(|(actuator, (frequency, part))| {
                f64::from(self.weighted_acceleration_at_full_force_at_each_point(actuator, *frequency)[point]) * part
            })
            .sum()
    }

    /// Equation 23 at every point.
    #[must_use]
    pub fn peak_at_each_point(&self, frequency_indices: &[usize], force_fractions: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.points];
        for (actuator, (frequency, part)) in frequency_indices.iter().zip(force_fractions).enumerate() {
            for (sum, gain) in
                sum.iter_mut().zip(self.weighted_acceleration_at_full_force_at_each_point(actuator, *frequency))
            {
                *sum += f64::from(*gain) * part;
            }
        }
        sum
    }
}

/// Of some entries, with what their accelerations are multiplied by, the magnitude at full force, for each entry at each point; 0 without an entry.
/// One product of matrices for all of them.
#[expect(clippy::cast_possible_truncation, reason = "single precision is meant")]
fn weighted_full_force_peaks_of_each_entry(shapes: &DMatrix<f64>, entries: &[(Option<&Entry>, f64)]) -> Vec<Vec<f32>> {
    let mut coordinates = DMatrix::zeros(shapes.ncols(), 2 * entries.len());
    for (k, (entry, weight)) in entries.iter().enumerate() {
        let Some(entry) = entry else { continue };
        let scale = entry.max_force_n * weight;
        for (i, z) in entry.acceleration.iter().enumerate() {
            (coordinates[(i, 2 * k)], coordinates[(i, 2 * k + 1)]) = (z.re * scale, z.im * scale);
        }
    }
    let values = shapes * coordinates;
    let magnitude = |(re, im): (&f64, &f64)| (re * re + im * im).sqrt() as f32;
    let of = |k: usize| values.column(2 * k).iter().zip(values.column(2 * k + 1).iter()).map(magnitude).collect();
    (0..entries.len()).map(of).collect()
}

/// Part of each shared limit that an actuator uses up at its largest force.
fn usage_fraction_of_each_limit(limits: &SharedLimits, actuator: usize, entry: &Entry) -> Vec<f64> {
    let strongest = entry.widest_pulse_if_noticeably_stronger_else_quiet();
    let loads = limits.load_per_n_on_each_limit_in_unit_of_limit(actuator, strongest).zip(&limits.allowed);
    loads.map(|(load, allowed)| load * strongest.max_force_n / allowed).collect()
}
