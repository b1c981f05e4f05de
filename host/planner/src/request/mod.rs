//! What is asked of the planner: targets with the surface around them, quiet zones, and what is optimised.

pub(crate) mod disc_quadrature;
pub mod quiet_zones;
pub(crate) mod target_zone;

use crate::scene::{MAX_ACTUATORS, PlaceError, SurfaceKind, check_and_snap_coordinate_along_side};
use crate::table::{PlanTable, PointView, Region};
use crate::{DEFAULT_INTENSITY_G, MAX_QUIET_ZONES, MIN_SPACING_HZ};
use serde::{Deserialize, Serialize};

/// Most targets at once: ten fingers.
pub const MAX_TARGETS: usize = 10;
/// Largest radius of a quiet zone in m: a hand's width, within which its rim and its middle tell what it does.
pub const MAX_QUIET_RADIUS_M: f64 = 0.1;

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

/// A zone in which the peak acceleration has to stay below a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuietZone {
    /// From the left edge in m.
    pub x_m: f64,
    /// From the top edge in m; of no account on a bar.
    pub y_m: f64,
    /// Radius in m, 0 to [`MAX_QUIET_RADIUS_M`].
    pub radius_m: f64,
    /// Most peak acceleration there in g.
    pub at_most_g: f64,
}

/// The objective of a plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// The least mean-square acceleration away from the targets, while the targets get their requested peaks.
    #[default]
    Contrast,
    /// The largest possible peak at the weakest place of the surface, so that no place is dead; all drives are then weakened together until the
    /// target has its requested peak.
    Reach,
    /// The least electrical power with which the targets get their requested peaks.
    Power,
}

impl Objective {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Contrast, Self::Reach, Self::Power];

    /// As requests name it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Contrast => "contrast",
            Self::Reach => "reach",
            Self::Power => "power",
        }
    }
}

/// Which actuators share a frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Grouping {
    /// Each actuator has its own frequency; the phases of the drives do not matter.
    #[default]
    Distinct,
    /// All actuators have one common frequency; each has its own phase.
    Shared,
}

/// How accelerations of different frequencies count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Weigh {
    /// Accelerations of all frequencies have the same weight.
    #[default]
    Equal,
    // Also the text of `--help`, where a link of rustdoc is none: the weights are those of `crate::perception::felt_weight_relative_to_reference_hz`.
    /// Each acceleration is weighted by the sensitivity of the skin at its frequency, at the targets and elsewhere; the limits of quiet zones
    /// remain in g.
    Felt,
}

/// How much the search may compute where limits bind. After that it ends with what is proven so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SearchEffort {
    /// For a touch: some milliseconds.
    #[default]
    Touch,
    /// For a study: up to some tenths of a second.
    Study,
    /// For a whole surface: up to a minute.
    Surface,
}

impl SearchEffort {
    /// Largest number of bounds and allocations that the search computes for so many candidates. Each takes some ten
    /// microseconds, and longer with more candidates. A touch with thousands of candidates, because its wish is far
    /// out of reach, gains 0.1 dB from 400 steps over 100 in one case of twenty.
    pub(crate) fn max_search_steps(self, candidates: usize) -> usize {
        match self {
            SearchEffort::Touch => (400_000 / candidates.max(1)).clamp(100, 400),
            SearchEffort::Study => 20_000,
            SearchEffort::Surface => 200_000,
        }
    }
}

/// What a plan is requested for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Request {
    /// Where it is to be felt: 1 to [`MAX_TARGETS`].
    pub targets: Vec<Target>,
    /// Where not: at most [`MAX_QUIET_ZONES`].
    pub quiet: Vec<QuietZone>,
    /// What is made least, or most.
    pub objective: Objective,
    /// For [`Objective::Reach`]: the part of the surface that counts, if not all of it.
    pub zone: Option<Region>,
    /// Which actuators share a frequency. A shared one is for one target, without quiet zones, and for contrast.
    pub grouping: Grouping,
    /// How accelerations count. Only distinct frequencies and contrast or power can be weighed.
    pub weigh: Weigh,
    /// How much may be looked at where limits bind.
    pub work: SearchEffort,
}

impl Request {
    /// What a touch asks for: contrast, distinct frequencies.
    #[must_use]
    pub fn for_touch(targets: &[Target]) -> Self {
        Self { targets: targets.to_vec(), ..Self::default() }
    }
}

/// Why there is no plan.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PlanError {
    /// The scene has nothing to drive.
    #[error("the scene has no [[actuator]], so there is nothing to drive")]
    NoActuators,
    /// More actuators than a board drives.
    #[error(
        "the scene has {count} actuators, but a plan drives at most {MAX_ACTUATORS}, because a board has that many channels \
         (modes and responses can be computed for any number of actuators)"
    )]
    Actuators {
        /// In the scene.
        count: usize,
    },
    /// No target, or too many.
    #[error("the request has {count} targets, but must have 1 to {MAX_TARGETS}")]
    Count {
        /// As given.
        count: usize,
    },
    /// Too many quiet zones.
    #[error("the request has {count} quiet zones, but at most {MAX_QUIET_ZONES} are allowed")]
    Quiet {
        /// As given.
        count: usize,
    },
    /// A number out of range.
    #[error("{field} is {value}, but must be {}", describe_range(*min, *max))]
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
    #[error("{0}")]
    Cutout(PlaceError),
    /// No frequencies keep their distance, or the response is unbounded everywhere.
    #[error(
        "there are no usable frequencies: either the band is too narrow for one frequency per actuator with a spacing \
        of at least {MIN_SPACING_HZ} Hz, \
        or the response is unbounded at every frequency because the scene has no damping. \
         Use a wider band, or add damping to the scene"
    )]
    NoFrequencies,
    /// Whoever asked no longer waits.
    #[error("the computation was stopped before its end")]
    Stopped,
    /// A zone of which no point is looked at.
    #[error(
        "the zone contains no point of the grid on which plans are computed: make the zone larger, or move the zone out of the \
         cut-outs"
    )]
    EmptyZone,
    /// Options that do not go together.
    #[error("{option} is {value}, which is allowed only with {allowed}")]
    Together {
        /// The option's name.
        option: &'static str,
        /// As given.
        value: &'static str,
        /// With what it can be had.
        allowed: &'static str,
    },
}

impl From<PlaceError> for PlanError {
    fn from(error: PlaceError) -> Self {
        match error {
            PlaceError::Outside { field, value, max } => Self::Range { field, value, min: 0.0, max },
            PlaceError::Cutout { .. } => Self::Cutout(error),
        }
    }
}

fn describe_range(min: f64, max: f64) -> String {
    if max.is_finite() { format!("{min} to {max}") } else { format!("a finite number of at least {min}") }
}

/// Checks everything about a request; returns it with its targets and quiet zones moved onto the surface, and the wanted intensity of each target
/// in g.
pub(crate) fn check_request_and_snap_to_surface_returning_wanted_peaks_g(
    table: &PlanTable,
    request: &Request,
) -> Result<(Request, Vec<f64>), PlanError> {
    let targets = &request.targets;
    if table.scene.actuators.is_empty() {
        return Err(PlanError::NoActuators);
    }
    if table.scene.actuators.len() > MAX_ACTUATORS {
        return Err(PlanError::Actuators { count: table.scene.actuators.len() });
    }
    if targets.is_empty() || targets.len() > MAX_TARGETS {
        return Err(PlanError::Count { count: targets.len() });
    }
    if request.quiet.len() > MAX_QUIET_ZONES {
        return Err(PlanError::Quiet { count: request.quiet.len() });
    }
    if request.grouping == Grouping::Shared {
        let is_plain = targets.len() == 1 && request.quiet.is_empty() && request.objective == Objective::Contrast;
        if !is_plain {
            let allowed = "one target, no quiet zones and the objective contrast";
            return Err(PlanError::Together { option: "grouping", value: "shared", allowed });
        }
    }
    if request.objective == Objective::Reach && !(targets.len() == 1 && request.quiet.is_empty()) {
        let allowed = "one target and no quiet zones";
        return Err(PlanError::Together { option: "objective", value: "reach", allowed });
    }
    if let Some(zone) = request.zone {
        if request.objective != Objective::Reach {
            return Err(PlanError::Together { option: "zone", value: "given", allowed: "the objective `reach`" });
        }
        for (x_m, y_m) in zone.x_m.into_iter().zip(zone.y_m) {
            check_and_snap_coordinate_along_side("zone.x_mm", x_m, table.scene.surface.length_m)?;
            check_and_snap_coordinate_along_side("zone.y_mm", y_m, table.scene.surface.width_m)?;
        }
        if PointView::new(table, Some(zone)).is_none() {
            return Err(PlanError::EmptyZone);
        }
    }
    if request.weigh == Weigh::Felt && (request.grouping == Grouping::Shared || request.objective == Objective::Reach) {
        let allowed = "distinct frequencies and the objective contrast or power";
        return Err(PlanError::Together { option: "weigh", value: "felt", allowed });
    }
    let mut request = request.clone();
    for quiet in &mut request.quiet {
        (quiet.x_m, quiet.y_m) =
            table.scene.surface_or_bar_axis_point_outside_cutouts(quiet.x_m, quiet.y_m)?.coordinates_m();
        check_range("radius_mm", quiet.radius_m, 0.0, MAX_QUIET_RADIUS_M, 1e3)?;
        check_range("at_most_g", quiet.at_most_g, 0.0, f64::INFINITY, 1.0)?;
    }
    let mut wanted_g = Vec::with_capacity(request.targets.len());
    for target in &mut request.targets {
        (target.x_m, target.y_m) =
            table.scene.surface_or_bar_axis_point_outside_cutouts(target.x_m, target.y_m)?.coordinates_m();
        let intensity_g = target.intensity_g.unwrap_or(DEFAULT_INTENSITY_G);
        check_range("intensity_g", intensity_g, 0.0, f64::INFINITY, 1.0)?;
        wanted_g.push(intensity_g);
    }
    Ok((request, wanted_g))
}

/// The y coordinate of a point in m: on a bar that of its axis.
pub(crate) fn y_or_bar_axis_y_m(table: &PlanTable, y_m: f64) -> f64 {
    match table.scene.surface.kind {
        SurfaceKind::Bar => table.scene.surface.width_m / 2.0,
        SurfaceKind::Plate => y_m,
    }
}

/// Checks that a value is finite and in its range. The error states both multiplied by `shown_scale`.
pub(crate) fn check_range(
    field: &'static str,
    value: f64,
    min: f64,
    max: f64,
    shown_scale: f64,
) -> Result<(), PlanError> {
    if value.is_finite() && (min..=max).contains(&value) {
        return Ok(());
    }
    Err(PlanError::Range { field, value: value * shown_scale, min: min * shown_scale, max: max * shown_scale })
}
