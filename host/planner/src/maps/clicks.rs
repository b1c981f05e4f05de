//! Clicks over a surface: at every place of a grid one is designed, and its figures are mapped.

use super::{PeakField, PictureError, write_map_png};
use crate::click::ClickOptions;
use crate::click::places::CellMiddles;
use crate::effects::{DesignError, EffectRequest, design_effect_of_windows_if_common_click_exists_else_of_drives};
use crate::scene::Scene;
use crate::{DEFAULT_INTENSITY_G, PlanError, PlanTable, Target};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// Columns and rows of the places on a plate; a bar has one row.
const GRID: (u32, u32) = (12, 8);
/// Where a picture's scale ends: so many times the longest time until a crisp click is quiet.
const SCALE_END: f64 = 2.0;

/// Why there is no map.
#[derive(Debug, thiserror::Error)]
pub enum ClickMapError {
    /// A wish that has no plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// An effect that cannot be designed.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// A surface with cut-outs at all places.
    #[error("all {count} places of the map are in cut-outs")]
    NoPlaces {
        /// Places of the grid.
        count: usize,
    },
}

/// A click at one place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlaceClick {
    /// In mm.
    pub x_mm: f64,
    /// In mm.
    pub y_mm: f64,
    /// Its peak in g.
    pub peak_g: f64,
    /// When the peak comes, in ms after the start.
    pub peak_at_ms: f64,
    /// From here on it stays below a tenth of the peak, in ms; `None` if never.
    pub quiet_ms: Option<f64>,
    /// Whether the peak comes within 15 ms, and it is quiet in time.
    pub crisp: bool,
    /// Its contrast in dB; `None` of a push, or where nothing moves.
    pub contrast_db: Option<f64>,
    /// Its sound in dB; `None` of a push, or where nothing moves.
    pub sound_db: Option<f64>,
}

/// Clicks of one strength at the middles of 12 x 8 cells of a plate, or 12 of a bar.
#[derive(Clone, Debug, PartialEq)]
pub struct ClickMap {
    /// Peak asked for in g.
    pub intensity_g: f64,
    /// Longest time until a crisp click is quiet, in ms.
    pub crisp_ms: f64,
    /// Columns in mm.
    x_mm: Vec<f64>,
    /// Rows in mm.
    y_mm: Vec<f64>,
    /// Row by row; `None` in cut-outs.
    clicks: Vec<Option<PlaceClick>>,
}

impl ClickMap {
    /// Designs the click of a request at every place, as for a touch there, on the panel without a finger.
    ///
    /// # Errors
    /// [`ClickMapError`].
    pub fn compute(table: &PlanTable, request: EffectRequest, intensity_g: Option<f64>) -> Result<Self, ClickMapError> {
        let poles = table.panel_poles().ok_or(DesignError::Unbounded)?;
        let options = request.click_options();
        let crisp_ms = request.crisp_ms.unwrap_or(1e3 * ClickOptions::default().crisp_s);
        let (columns, rows) = GRID;
        let grid = CellMiddles::find_on_surface(&table.scene, columns, rows);
        if grid.places_m.iter().flatten().next().is_none() {
            return Err(ClickMapError::NoPlaces { count: grid.places_m.len() });
        }
        let design = |place: &Option<(f64, f64)>| -> Result<Option<PlaceClick>, ClickMapError> {
            let Some((x_m, y_m)) = *place else { return Ok(None) };
            let plan = table.plan(&[Target { x_m, y_m, intensity_g }])?;
            let predicted =
                design_effect_of_windows_if_common_click_exists_else_of_drives(table, poles, &plan, request, options)?
                    .predicted;
            Ok(Some(PlaceClick {
                x_mm: 1e3 * x_m,
                y_mm: 1e3 * y_m,
                peak_g: predicted.peak_g,
                peak_at_ms: predicted.peak_at_ms,
                quiet_ms: predicted.quiet_ms,
                crisp: predicted.crisp == Some(true),
                contrast_db: predicted.contrast_db,
                sound_db: predicted.sound_db,
            }))
        };
        let clicks = grid.places_m.par_iter().map(design).collect::<Result<_, _>>()?;
        let convert_to_mm = |lines_m: Vec<f64>| lines_m.into_iter().map(|line_m| 1e3 * line_m).collect();
        Ok(Self {
            intensity_g: intensity_g.unwrap_or(DEFAULT_INTENSITY_G),
            crisp_ms,
            x_mm: convert_to_mm(grid.x_m),
            y_mm: convert_to_mm(grid.y_m),
            clicks,
        })
    }

    /// The places outside cut-outs, row by row.
    pub fn places(&self) -> impl Iterator<Item = &PlaceClick> {
        self.clicks.iter().flatten()
    }

    /// Part of the places at which the click is crisp.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "some places")]
    pub fn crisp_share(&self) -> f64 {
        let crisp = self.places().filter(|place| place.crisp).count();
        crisp as f64 / self.places().count().max(1) as f64
    }

    /// The place with the least peak.
    #[must_use]
    pub fn find_weakest_place(&self) -> Option<&PlaceClick> {
        self.places().min_by(|a, b| a.peak_g.total_cmp(&b.peak_g))
    }

    /// Half of the places are quiet at this time in ms; `None` if they never are.
    #[must_use]
    pub fn median_time_until_quiet_ms_unless_half_never_quiet(&self) -> Option<f64> {
        let mut times: Vec<f64> = self.places().map(|place| place.quiet_ms.unwrap_or(f64::INFINITY)).collect();
        times.sort_by(f64::total_cmp);
        let middle = |index: usize| times.get(index).copied();
        let (low, high) = (middle(times.len().saturating_sub(1) / 2)?, middle(times.len() / 2)?);
        Some(0.5 * (low + high)).filter(|median| median.is_finite())
    }

    /// The sound in dB of all places' clicks: of the mean of their mean-square velocities; `None` if none of them has a sound.
    #[must_use]
    pub fn sound_db_of_mean_square_velocity_over_places_if_any(&self) -> Option<f64> {
        let squares: Vec<f64> =
            self.places().filter_map(|place| place.sound_db).map(|db| 10.0_f64.powf(db / 10.0)).collect();
        #[expect(clippy::cast_precision_loss, reason = "some places")]
        let mean = squares.iter().sum::<f64>() / squares.len() as f64;
        (!squares.is_empty()).then(|| 10.0 * mean.log10())
    }

    /// Lines of `x_mm,y_mm,peak_g,peak_at_ms,quiet_ms,crisp,contrast_db,sound_db`; the time is empty where it is never quiet, contrast and sound are
    /// empty where there are none.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = String::from("x_mm,y_mm,peak_g,peak_at_ms,quiet_ms,crisp,contrast_db,sound_db\n");
        for PlaceClick { x_mm, y_mm, peak_g, peak_at_ms, quiet_ms, crisp, contrast_db, sound_db } in self.places() {
            let [quiet_ms, contrast_db, sound_db] = [quiet_ms, contrast_db, sound_db]
                .map(|value| value.map_or_else(String::new, |value| format!("{value:.3}")));
            let _ = writeln!(
                text,
                "{x_mm:.3},{y_mm:.3},{peak_g:.6},{peak_at_ms:.3},{quiet_ms},{crisp},{contrast_db},{sound_db}"
            );
        }
        text
    }

    /// Draws the time until the click is quiet, to scale, white in cut-outs. Places that are quiet after the scale's end, or never, have its last
    /// colour. The picture's size in pixels.
    ///
    /// # Errors
    /// [`PictureError`] if the file cannot be written.
    pub fn write_quiet_time_png(&self, path: &Path, scene: &Scene) -> Result<(u32, u32), PictureError> {
        let end_ms = SCALE_END * self.crisp_ms;
        let draw = |click: &Option<PlaceClick>| click.map(|click| click.quiet_ms.unwrap_or(end_ms).min(end_ms));
        let times = self.clicks.iter().map(draw).collect();
        let field = PeakField { x_mm: self.x_mm.clone(), y_mm: self.y_mm.clone(), peak_g: times };
        let title = format!(
            "{}: time until the motion of a click of {} g stays below a tenth of its peak (times above {end_ms:.0} ms have the \
             colour of {end_ms:.0} ms)",
            scene.name, self.intensity_g
        );
        write_map_png(path, scene, &field, &title, ((0.0, end_ms), "time in ms"), &[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn make_map(quiet_ms: &[Option<f64>]) -> ClickMap {
        let make = |(k, quiet_ms): (u32, &Option<f64>)| {
            let crisp = quiet_ms.is_some_and(|quiet_ms| quiet_ms <= 45.0);
            let peak_g = 0.5 - 0.1 * f64::from(k);
            Some(PlaceClick {
                x_mm: f64::from(k),
                y_mm: 10.0,
                peak_g,
                peak_at_ms: 12.1,
                quiet_ms: *quiet_ms,
                crisp,
                contrast_db: quiet_ms.map(|_| 1.5),
                sound_db: quiet_ms.map(|quiet_ms| if quiet_ms < 35.0 { -20.0 } else { -30.0 }),
            })
        };
        let clicks: Vec<_> = (0..).zip(quiet_ms).map(make).chain([None]).collect();
        ClickMap { intensity_g: 0.5, crisp_ms: 45.0, x_mm: Vec::new(), y_mm: Vec::new(), clicks }
    }

    #[test]
    fn figures_count_places_outside_cutouts_only() {
        let map = make_map(&[Some(30.0), None, Some(40.0), Some(50.0)]);
        assert_eq!((map.places().count(), map.crisp_share()), (4, 0.5));
        assert_eq!(map.median_time_until_quiet_ms_unless_half_never_quiet(), Some(45.0));
        assert!((map.find_weakest_place().unwrap().x_mm - 3.0).abs() < 1e-9);
        assert_eq!(map.to_csv().lines().nth(2), Some("1.000,10.000,0.400000,12.100,,false,,"));
        assert_eq!(map.to_csv().lines().nth(1), Some("0.000,10.000,0.500000,12.100,30.000,true,1.500,-20.000"));
        // 0.01, 0.001 and 0.001, of three places that have a sound.
        assert!(
            (map.sound_db_of_mean_square_velocity_over_places_if_any().unwrap() - 10.0 * 0.004_f64.log10()).abs()
                < 1e-9
        );
        assert_eq!(make_map(&[None]).sound_db_of_mean_square_velocity_over_places_if_any(), None);
        assert_eq!(make_map(&[None, Some(30.0), None]).median_time_until_quiet_ms_unless_half_never_quiet(), None);
        assert_eq!(make_map(&[]).find_weakest_place(), None);
    }
}
