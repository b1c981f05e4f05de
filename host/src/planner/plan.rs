//! The plan for a touch.

use super::search::{Candidate, Selection, search};
use super::table::{Entry, PlanTable, at_point};
use super::{DEFAULT_INTENSITY_G, PULSE_WIDTH, STANDARD_GRAVITY, TARGET_RADIUS_M};
use crate::scene::{MAX_ACTUATORS, SurfaceKind};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use serde::Serialize;
use std::time::Instant;

/// Most targets at once: ten fingers.
pub const MAX_TARGETS: usize = 10;
/// Times what all actuators together can reach, at which a wish counts: what is beyond is as far beyond reach, and its
/// shares would be lost in rounding.
const BEYOND_REACH: f64 = 1e6;
/// Largest contrast in dB, either way; more is rounding.
const MOST_CONTRAST_DB: f64 = 200.0;
/// Rings and points per ring of the quadrature over the disc around a target; equal areas, so that the mean is plain.
const DISC: (u32, u32) = (4, 12);

/// A point to be felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// From the left edge in m.
    pub x_m: f64,
    /// From the top edge in m; of no account on a bar.
    pub y_m: f64,
    /// Peak acceleration wanted in g, 0 or more; [`DEFAULT_INTENSITY_G`] if `None`. What is beyond reach is delivered as
    /// far as it goes.
    pub intensity_g: Option<f64>,
}

/// Why there is no plan.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PlanError {
    /// The scene has nothing to drive.
    #[error("the scene has no [[actuator]], so there is nothing to drive")]
    NoActuators,
    /// More actuators than a board drives.
    #[error(
        "the scene has {count} actuators, but plans are made for at most {MAX_ACTUATORS}, a board's channels (modes and \
         responses take any number)"
    )]
    Actuators {
        /// In the scene.
        count: usize,
    },
    /// No target, or too many.
    #[error("touches: {count} given, 1 to {MAX_TARGETS} allowed")]
    Count {
        /// As given.
        count: usize,
    },
    /// A number out of range.
    #[error("{field}: {value} is not in the allowed range {}", range_text(*min, *max))]
    Range {
        /// The field's name.
        field: &'static str,
        /// As given.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed; infinite where every finite number is.
        max: f64,
    },
    /// A touch where there is no surface.
    #[error("x_mm, y_mm: ({x_mm}, {y_mm}) lies in cutout[{cutout}] of the scene, where there is no surface")]
    Cutout {
        /// In mm.
        x_mm: f64,
        /// In mm.
        y_mm: f64,
        /// Which, counted from 1.
        cutout: usize,
    },
    /// No frequencies keep their distance, or the response is unbounded everywhere.
    #[error("no combination of frequencies is usable: the response is unbounded at every one (no damping at all?)")]
    NoFrequencies,
}

fn range_text(min: f64, max: f64) -> String {
    if max.is_finite() { format!("{min} to {max}") } else { format!("of finite numbers from {min} up") }
}

/// One actuator's part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drive {
    /// The actuator's `id`.
    pub actuator: String,
    /// Fundamental of its force in Hz.
    pub frequency_hz: f64,
    /// Electrode voltage in V.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// Phase of its force in rad.
    pub phase_rad: f64,
    /// Amplitude of the force's fundamental in N.
    pub force_n: f64,
}

/// What the plan should do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Predicted {
    /// Peak acceleration at the (first) target in g: equation 23.
    pub target_peak_g: f64,
    /// Mean over the rest of the surface of the peak acceleration in g.
    pub mean_elsewhere_g: f64,
    /// 10 log10 of the mean square acceleration within 10 mm of the targets over that of the rest.
    pub contrast_db: f64,
}

/// One target's share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TargetResult {
    /// In mm from the left edge.
    pub x_mm: f64,
    /// In mm from the top edge.
    pub y_mm: f64,
    /// Wanted in g.
    pub wanted_g: f64,
    /// Predicted in g.
    pub peak_g: f64,
}

/// The plan for a touch.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// The (first) target in mm.
    pub target_mm: [f64; 2],
    /// All targets.
    pub targets: Vec<TargetResult>,
    /// Time it took.
    pub elapsed_us: f64,
    /// One per actuator.
    pub drives: Vec<Drive>,
    /// What it should do.
    pub predicted: Predicted,
    /// What keeps the intensity below what was asked for, as `voltage of left`; `null` if nothing does.
    pub limited_by: Option<String>,
    /// Upper bound on the relative error of `target_peak_g`; `null` where there is none.
    pub error_bound: Option<f64>,
}

/// Points around the targets.
struct Zone {
    /// Mode shapes at the targets.
    targets: Vec<DVector<f64>>,
    /// Mode shapes at the points of the discs, one row each.
    shapes: DMatrix<f64>,
    /// Part of the surface that the discs cover.
    part: f64,
}

impl PlanTable {
    /// The drives for `targets`.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn plan(&self, targets: &[Target]) -> Result<Plan, PlanError> {
        let started = Instant::now();
        let wanted_g = self.check(targets)?;
        let zone = self.zone(targets);
        let candidates: Vec<Vec<Candidate>> =
            (0..self.entries.len()).map(|actuator| self.candidates(actuator, &zone)).collect();
        let wanted: Vec<f64> = wanted_g
            .iter()
            .enumerate()
            .map(|(target, g)| countable(g * STANDARD_GRAVITY, &candidates, target))
            .collect();
        let selection = search(&candidates, &wanted).ok_or(PlanError::NoFrequencies)?;
        let drives = self.drives(&selection);
        let peak_g = |target: usize| {
            let sum: f64 = selection.drives.iter().map(|(c, force)| c.gain.get(target).unwrap_or(&0.0) * force).sum();
            sum / STANDARD_GRAVITY
        };
        let results: Vec<TargetResult> = targets
            .iter()
            .zip(&wanted_g)
            .enumerate()
            .map(|(i, (target, wanted_g))| TargetResult {
                x_mm: target.x_m * 1e3,
                y_mm: self.y_m(target) * 1e3,
                wanted_g: *wanted_g,
                peak_g: peak_g(i),
            })
            .collect();
        let first = results.first().ok_or(PlanError::Count { count: 0 })?;
        Ok(Plan {
            target_mm: [first.x_mm, first.y_mm],
            predicted: self.predict(&selection, &zone, targets, first.peak_g),
            limited_by: self.limited_by(&selection),
            error_bound: self.bound(&selection, first).value(),
            targets: results,
            drives,
            elapsed_us: started.elapsed().as_secs_f64() * 1e6,
        })
    }

    /// Peak acceleration (equation 23) at every point of the grid in m/s^2, for drives at distinct frequencies of the
    /// table's grid; `None` in cut-outs.
    #[must_use]
    pub fn field(&self, plan: &Plan) -> Vec<Option<f64>> {
        let mut sum = vec![0.0; self.grid.weights.len()];
        for drive in &plan.drives {
            let Some(entry) = self.entry_of(drive) else { continue };
            for (sum, z) in sum.iter_mut().zip(self.grid.field(&entry.acceleration)) {
                *sum += z.norm() * drive.force_n;
            }
        }
        sum.into_iter().zip(&self.grid.there).map(|(sum, there)| there.then_some(sum)).collect()
    }

    fn entry_of(&self, drive: &Drive) -> Option<&Entry> {
        let actuator = self.scene.actuators.iter().position(|actuator| actuator.id == drive.actuator)?;
        let frequency = self.frequencies_hz.iter().position(|f| (f - drive.frequency_hz).abs() < 1e-6)?;
        self.entries.get(actuator)?.get(frequency)?.as_ref()
    }

    /// The intensities in g, after everything has been looked at.
    fn check(&self, targets: &[Target]) -> Result<Vec<f64>, PlanError> {
        if self.scene.actuators.is_empty() {
            return Err(PlanError::NoActuators);
        }
        if self.scene.actuators.len() > MAX_ACTUATORS {
            return Err(PlanError::Actuators { count: self.scene.actuators.len() });
        }
        if targets.is_empty() || targets.len() > MAX_TARGETS {
            return Err(PlanError::Count { count: targets.len() });
        }
        let within = |field, value: f64, min, max, scale: f64| {
            if value.is_finite() && (min..=max).contains(&value) {
                return Ok(());
            }
            Err(PlanError::Range { field, value: value * scale, min: min * scale, max: max * scale })
        };
        targets
            .iter()
            .map(|target| {
                within("x_mm", target.x_m, 0.0, self.scene.surface.length_m, 1e3)?;
                within("y_mm", target.y_m, 0.0, self.scene.surface.width_m, 1e3)?;
                if let Some(cutout) = self.scene.cutout_at(target.x_m, target.y_m) {
                    let mm = |metres: f64| (metres * 1e9).round() / 1e6;
                    return Err(PlanError::Cutout { x_mm: mm(target.x_m), y_mm: mm(target.y_m), cutout });
                }
                let intensity_g = target.intensity_g.unwrap_or(DEFAULT_INTENSITY_G);
                within("intensity_g", intensity_g, 0.0, f64::INFINITY, 1.0)?;
                Ok(intensity_g)
            })
            .collect()
    }

    /// A bar's points lie on its axis.
    fn y_m(&self, target: &Target) -> f64 {
        match self.scene.surface.kind {
            SurfaceKind::Bar => self.scene.surface.width_m / 2.0,
            SurfaceKind::Plate => target.y_m,
        }
    }

    fn zone(&self, targets: &[Target]) -> Zone {
        let surface = &self.scene.surface;
        let layout = self.scene.layout();
        let inside = |x: f64, y: f64| {
            (0.0..=surface.length_m).contains(&x) && (0.0..=surface.width_m).contains(&y) && layout.at(x, y).is_some()
        };
        let mut rows = Vec::new();
        let mut area = 0.0;
        for target in targets {
            let (x, y) = (target.x_m, self.y_m(target));
            let points = match surface.kind {
                SurfaceKind::Plate => disc_points(x, y),
                SurfaceKind::Bar => segment_points(x, y),
            };
            let whole = match surface.kind {
                SurfaceKind::Plate => std::f64::consts::PI * TARGET_RADIUS_M * TARGET_RADIUS_M,
                SurfaceKind::Bar => 2.0 * TARGET_RADIUS_M * surface.width_m,
            };
            let kept: Vec<_> = points.iter().copied().filter(|(x, y)| inside(*x, *y)).collect();
            #[allow(clippy::cast_precision_loss, reason = "at most 48")]
            let share = kept.len() as f64 / points.len() as f64;
            area += whole * share;
            // On a surface smaller than the first ring only the target itself is left.
            let kept = if kept.is_empty() { vec![(x, y)] } else { kept };
            rows.extend(kept.into_iter().map(|(x, y)| self.model.shape_at(x, y).transpose()));
        }
        Zone {
            targets: targets.iter().map(|target| self.model.shape_at(target.x_m, self.y_m(target))).collect(),
            shapes: DMatrix::from_rows(&rows),
            // Discs may overlap or cover a small surface whole; some of it is always "elsewhere".
            part: (area / self.scene.area_m2()).min(0.9),
        }
    }

    fn candidates(&self, actuator: usize, zone: &Zone) -> Vec<Candidate> {
        let entries = self.entries.get(actuator).map(Vec::as_slice).unwrap_or_default();
        entries
            .iter()
            .zip(&self.frequencies_hz)
            .enumerate()
            .filter_map(|(frequency, (entry, frequency_hz))| {
                let entry = entry.as_ref()?;
                let near = zone.mean_square(&entry.acceleration);
                // The difference may round to nothing on a surface that is all target; it stays positive.
                let energy = ((entry.mean_square - zone.part * near) / (1.0 - zone.part))
                    .max(1e-9 * entry.mean_square)
                    .max(f64::MIN_POSITIVE);
                Some(Candidate {
                    frequency,
                    frequency_hz: *frequency_hz,
                    gain: zone.targets.iter().map(|shape| at_point(shape, &entry.acceleration).norm()).collect(),
                    energy,
                    max_force_n: entry.max_force_n,
                    limit: entry.limit,
                })
            })
            .collect()
    }

    fn drives(&self, selection: &Selection) -> Vec<Drive> {
        selection
            .drives
            .iter()
            .zip(self.scene.actuators.iter().zip(&self.electrodes))
            .map(|((candidate, force_n), (actuator, electrodes))| Drive {
                actuator: actuator.id.clone(),
                frequency_hz: candidate.frequency_hz,
                voltage_v: electrodes.voltage_for(*force_n, PULSE_WIDTH).min(electrodes.max_voltage_v),
                pulse_width: PULSE_WIDTH,
                phase_rad: 0.0,
                force_n: *force_n,
            })
            .collect()
    }

    fn predict(&self, selection: &Selection, zone: &Zone, targets: &[Target], target_peak_g: f64) -> Predicted {
        let (mut near, mut rest) = (0.0, 0.0);
        let mut peaks = vec![0.0; self.grid.weights.len()];
        for (actuator, (candidate, force)) in selection.drives.iter().enumerate() {
            let entry = self.entries.get(actuator).and_then(|list| list.get(candidate.frequency)?.as_ref());
            let Some(entry) = entry else { continue };
            near += zone.mean_square(&entry.acceleration) * force * force;
            rest += candidate.energy * force * force;
            for (peak, z) in peaks.iter_mut().zip(self.grid.field(&entry.acceleration)) {
                *peak += z.norm() * force;
            }
        }
        let (mut sum, mut weight) = (0.0, 0.0);
        let points = self.grid.y_m.iter().flat_map(|y| self.grid.x_m.iter().map(move |x| (*x, *y)));
        for (((x, y), peak), part) in points.zip(&peaks).zip(&self.grid.weights) {
            let far = |target: &Target| (x - target.x_m).hypot(y - self.y_m(target)) > TARGET_RADIUS_M;
            if targets.iter().all(far) {
                sum += peak * part;
                weight += part;
            }
        }
        Predicted {
            target_peak_g,
            mean_elsewhere_g: if weight > 0.0 { sum / weight / STANDARD_GRAVITY } else { 0.0 },
            contrast_db: contrast_db(near, rest),
        }
    }

    fn limited_by(&self, selection: &Selection) -> Option<String> {
        const MET: f64 = 1.0 - 1e-6;
        if selection.met >= MET {
            return None;
        }
        let at_limit =
            selection.drives.iter().zip(&self.scene.actuators).filter_map(|((candidate, force), actuator)| {
                let full = *force >= candidate.max_force_n * MET;
                full.then(|| format!("{} of {}", candidate.limit.name(), actuator.id))
            });
        let all: Vec<String> = at_limit.collect();
        Some(if all.is_empty() { "node".into() } else { all.join(", ") })
    }
}

/// A wanted acceleration in m/s^2, at most [`BEYOND_REACH`] times the sum of what the actuators reach at their best.
fn countable(wanted: f64, candidates: &[Vec<Candidate>], target: usize) -> f64 {
    let reach = |candidate: &Candidate| candidate.gain.get(target).unwrap_or(&0.0) * candidate.max_force_n;
    let most: f64 = candidates.iter().map(|list| list.iter().map(reach).fold(0.0, f64::max)).sum();
    // Where nothing is reached the wish stands, so that it is not met.
    wanted.min(if most > 0.0 { BEYOND_REACH * most } else { f64::MAX })
}

/// 10 log10(near / rest); 0 where nothing moves.
fn contrast_db(near: f64, rest: f64) -> f64 {
    if near <= 0.0 && rest <= 0.0 {
        return 0.0;
    }
    (10.0 * (near / rest).log10()).clamp(-MOST_CONTRAST_DB, MOST_CONTRAST_DB)
}

impl Zone {
    fn mean_square(&self, acceleration: &DVector<Complex64>) -> f64 {
        let re = &self.shapes * acceleration.map(|z| z.re);
        let im = &self.shapes * acceleration.map(|z| z.im);
        #[allow(clippy::cast_precision_loss, reason = "at most 480 points")]
        let points = self.shapes.nrows().max(1) as f64;
        (re.norm_squared() + im.norm_squared()) / points
    }
}

fn disc_points(x: f64, y: f64) -> Vec<(f64, f64)> {
    let (rings, spokes) = DISC;
    (0..rings)
        .flat_map(|ring| {
            let radius = TARGET_RADIUS_M * ((f64::from(ring) + 0.5) / f64::from(rings)).sqrt();
            (0..spokes).map(move |spoke| {
                let angle = std::f64::consts::TAU * (f64::from(spoke) + 0.5 * f64::from(ring % 2)) / f64::from(spokes);
                (x + radius * angle.cos(), y + radius * angle.sin())
            })
        })
        .collect()
}

fn segment_points(x: f64, y: f64) -> Vec<(f64, f64)> {
    const POINTS: u32 = 9;
    (0..POINTS).map(|i| (x + TARGET_RADIUS_M * ((2.0 * f64::from(i) + 1.0) / f64::from(POINTS) - 1.0), y)).collect()
}
