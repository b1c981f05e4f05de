//! What a plan does on a panel that is not quite the one it was made for: springs, material, thickness and places are never what a
//! drawing says.
//!
//! The drives stay as they are, and the panel is modelled anew for each sample. Forces are those of masses at rest, as in a plan's own
//! prediction, which is what each sample is compared with. A finger that is part of the panel is no part that may be off: it is on its place on each of them.

use crate::run::StudyObserver;
use crate::space::draw_latin_hypercube;
use era_model::model::{Accuracy, ModelError, PanelModel};
use era_model::response::{
    ResponseError, SineComponent, compute_acceleration_curves_per_newton, peak_of_sines_merging_equal_frequencies,
};
use era_model::scene::random::RandomSequence;
use era_model::scene::{EdgeKind, Scene, SurfaceKind};
use era_model::stop::StopRequest;
use era_planner::{Drive, Plan};
use num_complex::Complex64;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt::Write;

/// Samples with everything off at once.
const SAMPLES: usize = 64;
/// Samples of each kind by itself.
const EACH: usize = 16;
/// Of random numbers: the same panel has the same answer.
const SEED: u64 = 1;
/// Nearer to the border than this part of a side what is off lies on it: that changes nothing that is felt, and between the border and a point
/// that is hardly off it cells are so small that their stiffness drowns the rest in rounding.
const AT_THE_BORDER: f64 = 2e-3;
/// Most that springs, Young's modulus and thickness may be off, as a part of themselves: there is something left of each.
pub const MAX_FRACTION: f64 = 0.9;
/// Most that places may be off, in mm.
pub const MOST_MM: f64 = 100.0;
/// The fields of [`Tolerances`], with the most that each may be; the least is 0.
pub const MOST: [(&str, f64); 4] =
    [("springs", MAX_FRACTION), ("youngs_modulus", MAX_FRACTION), ("thickness", MAX_FRACTION), ("places_mm", MOST_MM)];
/// Least part of the plan's own peak, -120 dB, that a sample's peak is told as: on a node line there is none.
const MIN_FRACTION: f64 = 1e-6;

/// How far each kind of thing may be off, either way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Tolerances {
    /// Stiffness of supports, elastic edges and actuators, each by itself, relative.
    pub springs: f64,
    /// Young's modulus, the same everywhere, relative.
    pub youngs_modulus: f64,
    /// Thickness, the same everywhere, relative.
    pub thickness: f64,
    /// Places of supports, masses and actuators, each coordinate by itself, in mm.
    pub places_mm: f64,
}

impl Default for Tolerances {
    /// What is usual where nobody has measured: moulded or wound springs, a data sheet's modulus, rolled sheet, hand assembly.
    fn default() -> Self {
        Self { springs: 0.2, youngs_modulus: 0.1, thickness: 0.05, places_mm: 1.0 }
    }
}

impl Tolerances {
    /// Whether it can be looked at.
    ///
    /// # Errors
    /// [`RangeError`] of the first one that is negative, too much or no number.
    pub fn check_ranges(&self) -> Result<(), RangeError> {
        let values = [self.springs, self.youngs_modulus, self.thickness, self.places_mm];
        match MOST.into_iter().zip(values).find(|((_, most), value)| !(0.0..=*most).contains(value)) {
            Some(((field, most), value)) => Err(RangeError { field, value, most }),
            None => Ok(()),
        }
    }
}

/// A kind of thing that may be off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema), schema(as = What))]
#[serde(rename_all = "snake_case")]
pub enum ToleranceKind {
    /// [`Tolerances::springs`].
    Springs,
    /// [`Tolerances::youngs_modulus`].
    YoungsModulus,
    /// [`Tolerances::thickness`].
    Thickness,
    /// [`Tolerances::places_mm`].
    Places,
}

impl ToleranceKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Springs, Self::YoungsModulus, Self::Thickness, Self::Places];

    /// In words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Springs => "springs",
            Self::YoungsModulus => "Young's modulus",
            Self::Thickness => "thickness",
            Self::Places => "positions",
        }
    }
}

/// The target's peak over some samples, in dB of what the plan predicts.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema), schema(as = PeakRange))]
pub struct PeakRange {
    /// Of the weakest sample.
    pub least_db: f64,
    /// Of the middle one.
    pub median_db: f64,
    /// Of the strongest one.
    pub most_db: f64,
    /// The sample of `least_db`.
    pub weakest: PanelDeviations,
    /// The sample of `most_db`.
    pub strongest: PanelDeviations,
}

/// A panel that is off, as it was modelled. What was not off has no field.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema), schema(as = OffPanel))]
pub struct PanelDeviations {
    /// Factors on the stiffness of springs.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(nullable = false))]
    pub springs: Option<SpringFactors>,
    /// Factor on Young's moduli of surface, layers and patches, and on layers' shear moduli.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(nullable = false))]
    pub youngs_modulus: Option<f64>,
    /// Factor on the thickness of surface, layers and patches.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(nullable = false))]
    pub thickness: Option<f64>,
    /// Where everything was, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(nullable = false))]
    pub places_mm: Option<ShiftedPlaces>,
}

/// Factors on stiffness, in the scene's order. Of what the scene has none there is no list.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct SpringFactors {
    /// Of both springs of each support.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub supports: Vec<f64>,
    /// Of both springs of each edge; 1 for one that has none, being pinned or clamped.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub edges: Vec<f64>,
    /// Of each actuator's own springs, before its bias softens them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub actuators: Vec<f64>,
}

/// Places `[x, y]` on the surface in mm, in the scene's order; on a bar y is that of its axis. Of what the scene has none there is no list.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema), schema(as = OffPlaces))]
pub struct ShiftedPlaces {
    /// Of supports.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub supports: Vec<[f64; 2]>,
    /// Of masses.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub masses: Vec<[f64; 2]>,
    /// Of actuators.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub actuators: Vec<[f64; 2]>,
}

/// One kind by itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema), schema(as = OneTolerance))]
pub struct OneTolerance {
    /// Which.
    pub what: ToleranceKind,
    /// What it does.
    #[serde(flatten)]
    pub range: PeakRange,
}

/// What tolerances do to a plan's (first) target.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Spread {
    /// What may be off.
    pub tolerances: Tolerances,
    /// Everything off at once, each by as much as it likes.
    #[serde(flatten)]
    pub range: PeakRange,
    /// How many panels that is of. Others would be off further: the ends are no bounds.
    pub samples: usize,
    /// Each kind by itself that the scene has something of.
    pub of: Vec<OneTolerance>,
}

impl Spread {
    /// It in words: a line for everything at once, and one for each kind by itself.
    #[must_use]
    pub fn describe_in_words(&self) -> String {
        let Tolerances { springs, youngs_modulus, thickness, places_mm } = self.tolerances;
        let percent = |part: f64| format!("{} %", (1e4 * part).round() / 1e2);
        let by = |what: ToleranceKind| match what {
            ToleranceKind::Springs => percent(springs),
            ToleranceKind::YoungsModulus => percent(youngs_modulus),
            ToleranceKind::Thickness => percent(thickness),
            ToleranceKind::Places => format!("{places_mm} mm"),
        };
        let ends = |range: &PeakRange| {
            format!("{:+.1} to {:+.1} dB, median {:+.1} dB", range.least_db, range.most_db, range.median_db)
        };
        let (all, samples) = (ends(&self.range), self.samples);
        let mut text = format!(
            "if all properties below deviate from the scene at the same time, each by up to its tolerance, \
             the peak at the target changes by {all} (estimate from {samples} simulated panels; the peak of a real panel may change \
             more)"
        );
        for OneTolerance { what, range } in &self.of {
            let _ = write!(text, "\n  {} alone, changed by up to {}: {}", what.name(), by(*what), ends(range));
        }
        text
    }
}

/// A tolerance that is not in its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{field} is {value}, but must be 0 to {most}")]
pub struct RangeError {
    /// Its name in [`Tolerances`].
    pub field: &'static str,
    /// Its value, in the field's unit.
    pub value: f64,
    /// Most that is allowed, in the same.
    pub most: f64,
}

/// Tolerances that cannot be looked at.
#[derive(Debug, thiserror::Error)]
pub enum ToleranceError {
    /// One of them is not in its range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// Whoever watched wanted no more of it.
    #[error("the computation was stopped before all panels were evaluated")]
    Stopped,
    /// A panel cannot be modelled.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Its response is unbounded.
    #[error(transparent)]
    Response(#[from] ResponseError),
}

/// What being off does to a plan. The scene's finger is on each of `finger_places_m`, as when the plan was made.
///
/// # Errors
/// [`ToleranceError`].
pub fn compute_target_peak_spread_under_tolerances(
    scene: &Scene,
    finger_places_m: &[(f64, f64)],
    plan: &Plan,
    tolerances: Tolerances,
) -> Result<Spread, ToleranceError> {
    compute_target_peak_spread_under_tolerances_with_observer(scene, finger_places_m, plan, tolerances, &())
}

/// How many panels [`compute_target_peak_spread_under_tolerances`] looks at for this scene.
#[must_use]
pub fn count_varied_panels_of_tolerance_study(scene: &Scene) -> usize {
    let kinds = ToleranceKind::ALL.iter().filter(|what| count_deviating_numbers(scene, **what) > 0).count();
    EACH * kinds + if kinds > 0 { SAMPLES } else { 0 }
}

/// The same as [`compute_target_peak_spread_under_tolerances`], for an observer that is told of every panel and may stop it.
///
/// # Errors
/// [`ToleranceError`].
pub fn compute_target_peak_spread_under_tolerances_with_observer(
    scene: &Scene,
    finger_places_m: &[(f64, f64)],
    plan: &Plan,
    tolerances: Tolerances,
    observer: &dyn StudyObserver,
) -> Result<Spread, ToleranceError> {
    tolerances.check_ranges()?;
    let at = (plan.target_m[0], plan.target_m[1]);
    let peak = |scene: &Scene| {
        compute_steady_peak_acceleration_m_per_s2(
            &scene.replace_finger_by_masses_and_supports_at_places(finger_places_m),
            &plan.drives,
            at,
        )
    };
    let meant = peak(scene)?;
    let level = |scene: &Scene| -> Result<f64, ToleranceError> {
        if observer.is_stop_wanted() {
            return Err(ToleranceError::Stopped);
        }
        let part = if meant > 0.0 { peak(scene)? / meant } else { 1.0 };
        observer.report_newly_computed_designs(1);
        Ok(20.0 * part.max(MIN_FRACTION).log10())
    };
    // A stream of random numbers for each question: none changes with those before it.
    let range = |kinds: &[ToleranceKind], samples: usize, stream: u64| -> Result<Option<PeakRange>, ToleranceError> {
        let count: usize = kinds.iter().map(|what| count_deviating_numbers(scene, *what)).sum();
        if count == 0 {
            return Ok(None);
        }
        let points = draw_latin_hypercube(count, samples, &mut RandomSequence::new(SEED, stream));
        let stop = StopRequest::current_request_of_thread();
        let look = |point: Vec<f64>| {
            let (scene, panel) = scene_with_deviations_at_point(scene, kinds, &point, tolerances);
            Ok((stop.run_with_self_as_current_stop_request_of_thread(|| level(&scene))?, panel))
        };
        let mut looked: Vec<(f64, PanelDeviations)> =
            points.into_par_iter().map(look).collect::<Result<_, ToleranceError>>()?;
        looked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let at = |k: usize| looked.get(k).cloned().unwrap_or_default();
        let ((least_db, weakest), (median_db, _), (most_db, strongest)) = (at(0), at(samples / 2), at(samples - 1));
        Ok(Some(PeakRange { least_db, median_db, most_db, weakest, strongest }))
    };
    let mut of = Vec::new();
    for (stream, what) in (1..).zip(ToleranceKind::ALL) {
        of.extend(range(&[what], EACH, stream)?.map(|range| OneTolerance { what, range }));
    }
    Ok(Spread { tolerances, range: range(&ToleranceKind::ALL, SAMPLES, 0)?.unwrap_or_default(), samples: SAMPLES, of })
}

/// How many numbers of a kind are off by themselves.
fn count_deviating_numbers(scene: &Scene, kind: ToleranceKind) -> usize {
    match kind {
        ToleranceKind::Springs => scene.supports.len() + scene.edges.len() + scene.actuators.len(),
        ToleranceKind::YoungsModulus | ToleranceKind::Thickness => 1,
        ToleranceKind::Places => 2 * (scene.supports.len() + scene.masses.len() + scene.actuators.len()),
    }
}

/// The scene with some kinds off, and what is off of it: `point` is in the unit cube, its middle being the scene itself.
fn scene_with_deviations_at_point(
    scene: &Scene,
    kinds: &[ToleranceKind],
    point: &[f64],
    tolerances: Tolerances,
) -> (Scene, PanelDeviations) {
    let (mut scene, mut panel) = (scene.clone(), PanelDeviations::default());
    let mut parts = point.iter().map(|at| 2.0 * at - 1.0);
    let mut next = || parts.next().unwrap_or(0.0);
    for what in kinds {
        match what {
            // What the scene has nothing of takes no numbers.
            _ if count_deviating_numbers(&scene, *what) == 0 => {}
            ToleranceKind::Springs => {
                panel.springs = Some(scale_each_spring(&mut scene, || 1.0 + tolerances.springs * next()))
            }
            ToleranceKind::YoungsModulus => {
                let factor = 1.0 + tolerances.youngs_modulus * next();
                scene.scale_all_elastic_moduli(factor);
                panel.youngs_modulus = Some(factor);
            }
            ToleranceKind::Thickness => {
                let factor = 1.0 + tolerances.thickness * next();
                scene.scale_all_thicknesses(factor);
                panel.thickness = Some(factor);
            }
            ToleranceKind::Places => {
                panel.places_mm = Some(shift_each_coordinate_keeping_places_on_surface(&mut scene, || {
                    tolerances.places_mm / 1e3 * next()
                }))
            }
        }
    }
    (scene, panel)
}

/// Every spring times a factor of its own.
fn scale_each_spring(scene: &mut Scene, mut next_factor: impl FnMut() -> f64) -> SpringFactors {
    let supports = scene.supports.iter_mut().map(|support| {
        let factor = next_factor();
        support.stiffness_n_per_m *= factor;
        support.rotational_stiffness_n_m_per_rad *= factor;
        factor
    });
    let supports = supports.collect();
    let edges = scene.edges.iter_mut().map(|edge| {
        let factor = next_factor();
        let EdgeKind::Elastic { stiffness, rotational_stiffness, .. } = &mut edge.kind else { return 1.0 };
        *stiffness *= factor;
        *rotational_stiffness *= factor;
        factor
    });
    let edges = edges.collect();
    let actuators = scene.actuators.iter_mut().map(|actuator| {
        let factor = next_factor();
        actuator.stiffness_n_per_m *= factor;
        factor
    });
    SpringFactors { supports, edges, actuators: actuators.collect() }
}

/// Every place off by so many metres along x and y; on a bar along x alone.
fn shift_each_coordinate_keeping_places_on_surface(
    scene: &mut Scene,
    mut next_shift_m: impl FnMut() -> f64,
) -> ShiftedPlaces {
    let meant = scene.clone();
    let (length_m, width_m, is_bar) =
        (scene.surface.length_m, scene.surface.width_m, scene.surface.kind == SurfaceKind::Bar);
    let mut off = |x_m: &mut f64, y_m: &mut f64| {
        let at_m = (
            snap_to_border_if_near_or_beyond_m(*x_m + next_shift_m(), length_m),
            snap_to_border_if_near_or_beyond_m(*y_m + next_shift_m(), width_m),
        );
        // A number for y is drawn on a bar as well: which panels are looked at does not depend on it.
        (*x_m, *y_m) =
            if is_bar { (at_m.0, *y_m) } else { move_to_nearest_border_if_in_cutout(&meant, (*x_m, *y_m), at_m) };
        [*x_m * 1e3, *y_m * 1e3]
    };
    ShiftedPlaces {
        supports: scene.supports.iter_mut().map(|own| off(&mut own.x_m, &mut own.y_m)).collect(),
        masses: scene.masses.iter_mut().map(|own| off(&mut own.x_m, &mut own.y_m)).collect(),
        actuators: scene.actuators.iter_mut().map(|own| off(&mut own.x_m, &mut own.y_m)).collect(),
    }
}

/// `at_m`, or, if that is in a cut-out, the nearest place on the cut-outs' borders that has surface beside it; `fallback_m` if there is none.
fn move_to_nearest_border_if_in_cutout(scene: &Scene, fallback_m: (f64, f64), at_m: (f64, f64)) -> (f64, f64) {
    if scene.cutout_number_counted_from_1_at(at_m.0, at_m.1).is_none() {
        return at_m;
    }
    let borders = scene.cutouts.iter().flat_map(|cutout| {
        let along_x = [cutout.x_m, cutout.x_m + cutout.length_m].map(|x_m| (x_m, at_m.1));
        let along_y = [cutout.y_m, cutout.y_m + cutout.width_m].map(|y_m| (at_m.0, y_m));
        along_x.into_iter().chain(along_y)
    });
    let distance = |(x_m, y_m): &(f64, f64)| (x_m - at_m.0).hypot(y_m - at_m.1);
    let there = borders.filter(|(x_m, y_m)| scene.surface_or_bar_axis_point_outside_cutouts(*x_m, *y_m).is_ok());
    there.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(fallback_m)
}

/// A coordinate on a side of some length.
fn snap_to_border_if_near_or_beyond_m(at_m: f64, side_m: f64) -> f64 {
    if at_m < AT_THE_BORDER * side_m {
        0.0
    } else if at_m > (1.0 - AT_THE_BORDER) * side_m {
        side_m
    } else {
        at_m
    }
}

/// The peak in m/s^2 at a place with these drives.
fn compute_steady_peak_acceleration_m_per_s2(
    scene: &Scene,
    drives: &[Drive],
    (x_m, y_m): (f64, f64),
) -> Result<f64, ToleranceError> {
    let frequencies: Vec<f64> = drives.iter().map(|drive| drive.frequency_hz).collect();
    let Some(most_hz) = frequencies.iter().copied().reduce(f64::max) else { return Ok(0.0) };
    let model = PanelModel::build(scene, Accuracy::FAST, most_hz)?
        .reduce_with_residual_shapes_of_actuators_damping_and_points(most_hz, &[(x_m, y_m)])?;
    let curves = compute_acceleration_curves_per_newton(&model, &model.shape_deflections_at(x_m, y_m), &frequencies)?;
    let components: Vec<SineComponent> = drives
        .iter()
        .enumerate()
        .map(|(k, drive)| SineComponent {
            frequency_hz: drive.frequency_hz,
            phasor: curves[k][k] * Complex64::from_polar(drive.force_n, drive.force_phase_rad),
        })
        .collect();
    Ok(peak_of_sines_merging_equal_frequencies(&components))
}
