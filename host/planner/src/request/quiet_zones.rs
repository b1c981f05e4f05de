//! Quiet zones: places where the peak acceleration stays below a limit.
//!
//! A limit at a point is a row of the problem of forces. A zone has many points; the search starts with nine of each, and where
//! its answer is too strong at another one, that becomes a row as well (cutting planes). Rows ask for a thousandth less than
//! the zone allows, so that a few of them do. What is left after the last round, or comes with the forces in moving gaps, is
//! scaled away.

use crate::STANDARD_GRAVITY;
use crate::chosen_drive::ChosenDrive;
use crate::chosen_drive::fundamental_acceleration_peak_at_point_m_per_s2;
use crate::millimetres;
use crate::request::QuietZone;
use crate::request::y_or_bar_axis_y_m;
use crate::table::PlanTable;
use nalgebra::DVector;
use serde::Serialize;

/// Points on a zone's rim with which the search starts, besides its middle.
const FIRST_POINTS: u32 = 8;
/// Part of what is allowed that rows ask for.
const ASKED: f64 = 0.999;
/// Cells of the surface's grid per side of a cell of points. The grid has at least 12 cells per bending wave at the highest
/// frequency; with twice as many no point of the zone is further than 1/34 of a wave from one that is looked at, where a crest
/// is 1 - cos(2 pi/34) = 1.7 % lower.
const FINER: f64 = 2.0;
/// Most points along a zone's diameter: 10 000 in all.
const MOST_ACROSS: f64 = 100.0;
/// Peaks in m/s^2 below this are rounding: a ten-thousandth of what is felt at best.
pub(crate) const NO_PEAK: f64 = 1e-6;

/// What a plan does in a quiet zone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct QuietResult {
    /// From the left edge, in the unit of its name.
    #[serde(rename = "x_mm", serialize_with = "millimetres::serialize_length_in_mm")]
    pub x_m: f64,
    /// From the top edge, in the unit of its name.
    #[serde(rename = "y_mm", serialize_with = "millimetres::serialize_length_in_mm")]
    pub y_m: f64,
    /// In the unit of its name.
    #[serde(rename = "radius_mm", serialize_with = "millimetres::serialize_length_in_mm")]
    pub radius_m: f64,
    /// Allowed, in g.
    pub at_most_g: f64,
    /// Largest peak in it, in g: the larger one of forces of masses at rest and in moving gaps; right to 2 %, by which a crest
    /// between the points that are looked at may be higher.
    pub peak_g: f64,
    /// Most that odd harmonics up to 1 kHz add to that where they are strongest, in g; the limit is about the fundamentals.
    pub harmonics_g: f64,
}

/// A quiet zone and its points.
#[derive(Clone, Debug)]
pub(crate) struct QuietArea {
    pub(crate) quiet: QuietZone,
    /// Mode shapes at points all over it.
    pub(crate) points: Vec<DVector<f64>>,
}

/// The quiet zones of a request.
#[derive(Clone, Debug, Default)]
pub struct QuietZones {
    pub(crate) areas: Vec<QuietArea>,
    /// Mode shapes at points whose limits are rows, and what these allow in m/s^2.
    pub rows: Vec<(DVector<f64>, f64)>,
}

impl QuietZones {
    /// The zones, which have been checked.
    #[must_use]
    pub fn new(table: &PlanTable, zones: &[QuietZone]) -> Self {
        let mut made = Self::default();
        let surface = &table.scene.surface;
        for zone in zones {
            let at = |dx: f64, dy: f64| {
                // What lies beyond an edge is moved onto it, which stays within the zone.
                let (x, y) =
                    ((zone.x_m + dx).clamp(0.0, surface.length_m), (zone.y_m + dy).clamp(0.0, surface.width_m));
                table
                    .scene
                    .cutout_number_counted_from_1_at(x, y)
                    .is_none()
                    .then(|| table.model.shape_deflections_at(x, y_or_bar_axis_y_m(table, y)))
            };
            let asked = ASKED * zone.at_most_g * STANDARD_GRAVITY;
            made.rows.extend(at(0.0, 0.0).map(|shape| (shape, asked)));
            let mut points: Vec<DVector<f64>> = at(0.0, 0.0).into_iter().collect();
            if zone.radius_m > 0.0 {
                let rim = |k: u32, of: u32| {
                    let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(of)).sin_cos();
                    at(zone.radius_m * cos, zone.radius_m * sin)
                };
                let first = (0..FIRST_POINTS).filter_map(|k| rim(k, FIRST_POINTS));
                made.rows.extend(first.map(|shape| (shape, asked)));
                let step = |line: &[f64]| line.get(1).zip(line.first()).map_or(f64::INFINITY, |(b, a)| b - a);
                let cell = step(&table.grid.x_m).min(step(&table.grid.y_m)) / FINER;
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most a hundred")]
                let across = (2.0 * zone.radius_m / cell).ceil().clamp(2.0, MOST_ACROSS) as u32;
                points.extend((0..4 * across).filter_map(|k| rim(k, 4 * across)));
                let place = |k: u32| zone.radius_m * (2.0 * f64::from(k) / f64::from(across) - 1.0);
                let lattice = (0..=across).flat_map(|i| (0..=across).map(move |j| (place(i), place(j))));
                let inside = lattice.filter(|(dx, dy)| dx.hypot(*dy) < zone.radius_m);
                points.extend(inside.filter_map(|(dx, dy)| at(dx, dy)));
            }
            made.areas.push(QuietArea { quiet: *zone, points });
        }
        made
    }

    /// For each zone where these drives exceed the limit, adds a row for the point with the largest peak; returns
    /// whether any row was added.
    pub fn add_limit_at_worst_point_of_each_violated_zone(&mut self, drives: &[ChosenDrive]) -> bool {
        let before = self.rows.len();
        for area in &self.areas {
            let allowed = area.quiet.at_most_g * STANDARD_GRAVITY;
            let peaks =
                area.points.iter().map(|shape| (fundamental_acceleration_peak_at_point_m_per_s2(drives, shape), shape));
            let worst = peaks.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(most, _)| *most > allowed.max(NO_PEAK));
            // A row that is there already is as good as rounding lets it be.
            if let Some((_, shape)) = worst.filter(|(_, shape)| self.rows.iter().all(|(known, _)| known != *shape)) {
                self.rows.push((shape.clone(), ASKED * allowed));
            }
        }
        self.rows.len() > before
    }
}
