//! Three ways to drive a panel, side by side: what each can do everywhere at once, and touch by touch.

use super::maps;
use super::search::{self, Options};
use super::shared::{self, Phases, Together};
use super::space::Space;
use super::spread::Spread;
use crate::planner::table::PlanTable;
use crate::planner::{PULSE_WIDTH, PlanError, STANDARD_GRAVITY};
use nalgebra::DMatrix;
use num_complex::Complex64;
use serde::Serialize;

/// Lines from one of the table's grid to the next on the finer grid, as a minimum may hide between the points.
const FINER: usize = 4;
/// Most points of the finer grid; with more, fewer lines are added.
const MOST_POINTS: usize = 65_536;
/// Points of the finer grid that are added at once to those that the weakest place is looked for at.
const ADDED: usize = 12;
/// Rounds of that. A dozen is usual.
const ROUNDS: usize = 200;
/// Relative difference of minima that counts as none.
const SAME: f64 = 1e-6;

/// A way to drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// One frequency for all actuators, in phase.
    OneFrequencyInPhase,
    /// One frequency for all actuators, with phases.
    OneFrequencyWithPhases,
    /// A frequency for each actuator.
    DistinctFrequencies,
}

impl Scheme {
    /// All of them.
    pub const ALL: [Scheme; 3] =
        [Scheme::OneFrequencyInPhase, Scheme::OneFrequencyWithPhases, Scheme::DistinctFrequencies];

    /// In words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Scheme::OneFrequencyInPhase => "one frequency, in phase",
            Scheme::OneFrequencyWithPhases => "one frequency, phases chosen",
            Scheme::DistinctFrequencies => "distinct frequencies",
        }
    }
}

/// One actuator's part of a setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// The actuator's `id`.
    pub actuator: String,
    /// In Hz.
    pub frequency_hz: f64,
    /// Amplitude of the force's fundamental in N.
    pub force_n: f64,
    /// Phase of the force in rad.
    pub phase_rad: f64,
    /// Electrode voltage in V.
    pub voltage_v: f64,
    /// The same as an index.
    #[serde(skip)]
    pub frequency: usize,
}

/// One scheme on one panel. Peaks are in g.
#[derive(Clone, Debug, Serialize)]
pub struct SchemeReach {
    /// Which.
    pub scheme: Scheme,
    /// The one setting with the largest minimum over the surface.
    pub setting: Vec<Part>,
    /// What it does; the minimum is that of a grid up to four times as fine as the table's.
    pub one_setting: Spread,
    /// No setting of the scheme at the table's frequencies has a larger minimum; `None` where the best found is not proven.
    pub one_setting_at_most: Option<f64>,
    /// With a setting of its own for every point: the largest peak there.
    pub per_touch: Spread,
    /// The field of the one setting, row by row.
    #[serde(skip)]
    pub one_setting_g: Vec<Option<f64>>,
    /// The largest peak at every point, row by row.
    #[serde(skip)]
    pub per_touch_g: Vec<Option<f64>>,
}

/// All schemes on a panel.
///
/// # Errors
/// [`PlanError::NoActuators`], and [`PlanError::NoFrequencies`] where no frequencies are usable.
pub fn compare(table: &PlanTable) -> Result<Vec<SchemeReach>, PlanError> {
    if table.electrodes.is_empty() {
        return Err(PlanError::NoActuators);
    }
    let compared = Compared::new(table);
    Scheme::ALL
        .into_iter()
        .map(|scheme| {
            let found = match scheme {
                Scheme::OneFrequencyInPhase => compared.together(Phases::Equal),
                Scheme::OneFrequencyWithPhases => compared.together(Phases::Chosen),
                Scheme::DistinctFrequencies => compared.distinct(),
            };
            found.and_then(|found| compared.told(scheme, found)).ok_or(PlanError::NoFrequencies)
        })
        .collect()
}

/// The setting at distinct frequencies with the largest minimum over the surface, and by which part another could have a larger
/// one. `None` where no frequencies are usable.
#[must_use]
pub fn everywhere(table: &PlanTable) -> Option<(Vec<Part>, f64)> {
    let compared = Compared::new(table);
    let space = Space::of(table, &compared.shapes, |_| 1.0);
    let (setting, at_most) = compared.everywhere(space)?;
    let least = peaks(table, &compared.finer, &setting).into_iter().fold(f64::INFINITY, f64::min);
    Some((setting, if least > 0.0 { (at_most / least - 1.0).max(0.0) } else { 0.0 }))
}

/// How many amplitude ratios and phases the schemes with one frequency try at each, before refinement.
#[must_use]
pub fn tried(table: &PlanTable) -> [usize; 2] {
    [Phases::Equal, Phases::Chosen].map(|phases| shared::tried(table.electrodes.len(), phases))
}

struct Compared<'a> {
    table: &'a PlanTable,
    /// Points of the grid that are surface, and their mode shapes.
    points: Vec<usize>,
    shapes: DMatrix<f64>,
    /// The same of the finer grid.
    places_m: Vec<(f64, f64)>,
    finer: DMatrix<f64>,
}

struct Found {
    setting: Vec<Part>,
    at_most: Option<f64>,
    /// At each of the points, in m/s^2.
    per_touch: Vec<f64>,
}

impl<'a> Compared<'a> {
    fn new(table: &'a PlanTable) -> Self {
        let grid = &table.grid;
        let layout = table.scene.layout();
        let times = (1..=FINER).rev().find(|k| k * k * grid.there.len() <= MOST_POINTS).unwrap_or(1);
        let (x, y) = (between(&grid.x_m, times), between(&grid.y_m, times));
        let places = y.iter().flat_map(|y| x.iter().map(move |x| (*x, *y)));
        let (there, places_m): (Vec<usize>, Vec<(f64, f64)>) =
            places.enumerate().filter(|(_, (x, y))| layout.at(*x, *y).is_some()).unzip();
        let points: Vec<usize> = (0..grid.there.len()).filter(|point| grid.there[*point]).collect();
        let shapes = grid.shapes.select_rows(&points);
        Self { table, points, shapes, places_m, finer: table.model.shapes_on(&x, &y).select_rows(&there) }
    }

    fn together(&self, phases: Phases) -> Option<Found> {
        let found = shared::strongest(self.table, &self.shapes, &self.finer, phases)?;
        let Together { frequency, forces_n } = found.one;
        let setting = forces_n.iter().enumerate().map(|(i, force)| self.part(i, frequency, *force)).collect();
        Some(Found { setting, at_most: None, per_touch: found.each.into_iter().map(|(_, peak)| peak).collect() })
    }

    fn distinct(&self) -> Option<Found> {
        let space = Space::of(self.table, &self.shapes, |_| 1.0);
        let all: Vec<usize> = (0..space.points).collect();
        let touches = maps::strongest(&space, &all, Options::default());
        let per_touch = touches.into_iter().map(|touch| Some(touch?.least)).collect::<Option<_>>()?;
        let (setting, at_most) = self.everywhere(space)?;
        Some(Found { setting, at_most: Some(at_most / STANDARD_GRAVITY), per_touch })
    }

    /// The setting with the largest minimum on the finer grid, and a bound on that: the optimum at some points is one, and
    /// points where its setting does less join them.
    fn everywhere(&self, mut space: Space) -> Option<(Vec<Part>, f64)> {
        let mut added: Vec<usize> = Vec::new();
        let mut strongest: Option<(f64, Vec<Part>)> = None;
        let mut upper = f64::INFINITY;
        let mut hint: Option<Vec<usize>> = None;
        for _ in 0..ROUNDS {
            let all: Vec<usize> = (0..space.points).collect();
            let best = search::best(&space, &all, Options::default(), hint.as_deref())?;
            upper = upper.min(best.upper);
            let each = best.choice.iter().zip(&best.parts).enumerate();
            let setting: Vec<Part> =
                each.map(|(i, (f, part))| self.part(i, *f, Complex64::from(part * space.force_n(i, *f)))).collect();
            let peaks = peaks(self.table, &self.finer, &setting);
            let mut weaker: Vec<usize> =
                (0..peaks.len()).filter(|x| peaks[*x] < best.least * (1.0 - SAME) && !added.contains(x)).collect();
            weaker.sort_by(|a, b| peaks[*a].total_cmp(&peaks[*b]));
            let least = peaks.iter().copied().fold(f64::INFINITY, f64::min);
            if strongest.as_ref().is_none_or(|strongest| least > strongest.0) {
                strongest = Some((least, setting));
            }
            if weaker.is_empty() {
                break;
            }
            // The worst, and others from all of the range.
            added.extend(weaker.iter().step_by(weaker.len().div_ceil(ADDED)));
            let shapes = self.finer.select_rows(&added);
            let rows: Vec<_> = self.shapes.row_iter().chain(shapes.row_iter()).collect();
            space = Space::of(self.table, &DMatrix::from_rows(&rows), |_| 1.0);
            hint = Some(best.choice);
        }
        let (least, setting) = strongest?;
        Some((setting, if upper <= least * (1.0 + 2.0 * SAME) { least } else { upper }))
    }

    fn part(&self, actuator: usize, frequency: usize, force: Complex64) -> Part {
        Part {
            actuator: self.table.scene.actuators[actuator].id.clone(),
            frequency_hz: self.table.frequencies_hz[frequency],
            force_n: force.norm(),
            phase_rad: if force.norm() > 0.0 { force.arg() } else { 0.0 },
            voltage_v: self.table.electrodes[actuator].voltage_for(force.norm(), PULSE_WIDTH),
            frequency,
        }
    }

    fn told(&self, scheme: Scheme, found: Found) -> Option<SchemeReach> {
        let grid = &self.table.grid;
        let on_grid = |values: Vec<f64>| {
            let mut all = vec![None; grid.there.len()];
            for (point, value) in self.points.iter().zip(values) {
                all[*point] = Some(value / STANDARD_GRAVITY);
            }
            all
        };
        let one_setting_g = on_grid(peaks(self.table, &self.shapes, &found.setting));
        let per_touch_g = on_grid(found.per_touch);
        let mut one_setting = Spread::of(grid, &one_setting_g)?;
        let finer = peaks(self.table, &self.finer, &found.setting);
        let (least, (x_m, y_m)) = finer.iter().zip(&self.places_m).min_by(|a, b| a.0.total_cmp(b.0))?;
        one_setting.least = least / STANDARD_GRAVITY;
        one_setting.least_at_mm = [x_m * 1e3, y_m * 1e3];
        Some(SchemeReach {
            scheme,
            one_setting,
            one_setting_at_most: found.at_most,
            per_touch: Spread::of(grid, &per_touch_g)?,
            setting: found.setting,
            one_setting_g,
            per_touch_g,
        })
    }
}

/// Peak acceleration in m/s^2 of a setting at points with these mode shapes (points x n): phasors of one frequency add,
/// peaks of distinct ones do (equation 23).
fn peaks(table: &PlanTable, shapes: &DMatrix<f64>, setting: &[Part]) -> Vec<f64> {
    let mut sum = vec![0.0; shapes.nrows()];
    for (first, part) in setting.iter().enumerate() {
        if setting.iter().take(first).any(|before| before.frequency == part.frequency) {
            continue;
        }
        let mut coordinates = nalgebra::DVector::<Complex64>::zeros(shapes.ncols());
        for (actuator, drive) in setting.iter().enumerate().filter(|(_, drive)| drive.frequency == part.frequency) {
            let entry = table.entries.get(actuator).and_then(|list| list.get(drive.frequency)?.as_ref());
            if let Some(entry) = entry {
                coordinates += &entry.acceleration * Complex64::from_polar(drive.force_n, drive.phase_rad);
            }
        }
        let (re, im) = (shapes * coordinates.map(|z| z.re), shapes * coordinates.map(|z| z.im));
        for ((sum, re), im) in sum.iter_mut().zip(re.iter()).zip(im.iter()) {
            *sum += re.hypot(*im);
        }
    }
    sum
}

/// The lines, and `times` - 1 between every two.
fn between(lines: &[f64], times: usize) -> Vec<f64> {
    #[allow(clippy::cast_precision_loss, reason = "a small count")]
    let parts = |pair: &[f64]| {
        let (from, to) = (pair[0], pair[1]);
        (0..times).map(|k| from + (to - from) * k as f64 / times as f64).collect::<Vec<_>>()
    };
    lines.windows(2).flat_map(parts).chain(lines.last().copied()).collect()
}
