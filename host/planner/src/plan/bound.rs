//! How wrong a plan's prediction may be.

use crate::chosen_drive::ChosenDrive;
use crate::model::estimator::ErrorEstimator;
use crate::model::{Bound, ReducedModel};
use crate::plan::{Plan, TargetResult};
use crate::response;
use crate::table::{ActuatorSetting, NO_LEVELS, UNBOUNDED, acceleration_at_point_from_coordinates};
use crate::{PlanTable, STANDARD_GRAVITY};
use nalgebra::DVector;
use num_complex::Complex64;

/// Why there is no bound on what nothing moves, or what was not asked for.
const UNMOVED: &str = "no drive moves the target";

/// The error bound of a peak from the phasors of its drives on three levels, the finest last. Differences add up like
/// the magnitudes in the peak.
fn bound_relative_peak_error_from_phasors(
    estimator: &ErrorEstimator,
    peak: f64,
    [coarse, middle, fine]: [&[Complex64]; 3],
) -> Bound {
    let difference =
        |a: &[Complex64], b: &[Complex64]| a.iter().zip(b).map(|(a, b)| (a - b).norm()).sum::<f64>() / peak;
    estimator.response_error_bound_from_relative_differences(difference(coarse, middle), difference(middle, fine))
}

/// A bound on the relative error of the first target's peak: the same drives on the coarser models, and the
/// differences of the phasors, which add up like their magnitudes in the peak (equation 23).
pub(crate) fn bound_relative_peak_error_at_first_target(
    table: &PlanTable,
    drives: &[ChosenDrive],
    target: &TargetResult,
) -> Bound {
    let Some(([middle, coarse], estimator)) = &table.coarser else { return Bound::Unknown(NO_LEVELS) };
    let peak = target.peak_g * STANDARD_GRAVITY;
    if peak <= 0.0 {
        return Bound::Unknown(UNMOVED);
    }
    let at = (target.x_m, target.y_m);
    let shape = table.model.shape_deflections_at(at.0, at.1);
    let fine = drives.iter().enumerate().map(|(i, drive)| {
        drive
            .row
            .get(i)
            .map_or(Complex64::ZERO, |entry| acceleration_at_point_from_coordinates(&shape, &entry.acceleration))
            * drive.force_n
    });
    let fine: Vec<Complex64> = fine.collect();
    let phasors = |level: usize, model: &ReducedModel| -> Option<Vec<Complex64>> {
        let shape = model.shape_deflections_at(at.0, at.1);
        let each = drives.iter().enumerate().map(|(i, drive)| {
            if let Some(k) = drive.on_grid {
                let row = table.coarser_rows.get(level)?.get(k)?.as_ref()?;
                return Some(acceleration_at_point_from_coordinates(&shape, row.get(i)?) * drive.force_n);
            }
            let omega = std::f64::consts::TAU * drive.frequency_hz;
            let q = response::solve_coordinates_per_newton_at_frequency(model, drive.frequency_hz).ok()?;
            Some(acceleration_at_point_from_coordinates(&shape, q.get(i)?) * (-omega * omega * drive.force_n))
        });
        each.collect()
    };
    let (Some(middle), Some(coarse)) = (phasors(0, middle), phasors(1, coarse)) else {
        return Bound::Unknown(UNBOUNDED);
    };
    bound_relative_peak_error_from_phasors(estimator, peak, [&coarse, &middle, &fine])
}

/// Bounds on the relative errors of peaks at points of the grid, each with a setting of its own at the table's
/// frequencies.
pub(crate) fn bound_relative_peak_error_of_each_setting_at_its_point<'a>(
    table: &PlanTable,
    settings: impl Iterator<Item = (usize, &'a [ActuatorSetting])>,
) -> Vec<Bound> {
    let Some(([middle, coarse], estimator)) = &table.coarser else {
        return settings.map(|_| Bound::Unknown(NO_LEVELS)).collect();
    };
    let shapes = [middle, coarse].map(|model| model.shape_deflections_on_grid(&table.grid.x_m, &table.grid.y_m));
    let bound = |(point, setting): (usize, &[ActuatorSetting])| {
        let fine = setting.iter().enumerate().map(|(i, part)| {
            let entry = table.entries.get(i)?.get(part.frequency)?.as_ref()?;
            Some(
                acceleration_at_point_from_coordinates(&table.grid.shapes.row(point).transpose(), &entry.acceleration)
                    * part.drive.force_n,
            )
        });
        let coarser = |level: usize| -> Option<Vec<Complex64>> {
            let shape = shapes[level].row(point).transpose();
            let each = setting.iter().enumerate().map(|(i, part)| {
                let row = table.coarser_rows.get(level)?.get(part.frequency)?.as_ref()?;
                Some(acceleration_at_point_from_coordinates(&shape, row.get(i)?) * part.drive.force_n)
            });
            each.collect()
        };
        let (Some(fine), Some(middle), Some(coarse)) = (fine.collect::<Option<Vec<_>>>(), coarser(0), coarser(1))
        else {
            return Bound::Unknown(UNBOUNDED);
        };
        let peak: f64 = fine.iter().map(|phasor| phasor.norm()).sum();
        if peak > 0.0 {
            bound_relative_peak_error_from_phasors(estimator, peak, [&coarse, &middle, &fine])
        } else {
            Bound::Unknown(UNMOVED)
        }
    };
    settings.map(bound).collect()
}

/// A bound on the error of [`PlanTable::compute_peak_at_each_grid_point_m_per_s2`] at any point, relative to the largest value of the
/// field.
#[must_use]
pub fn bound_field_error_relative_to_largest_peak(table: &PlanTable, plan: &Plan) -> Bound {
    let Some(([middle, coarse], estimator)) = &table.coarser else { return Bound::Unknown(NO_LEVELS) };
    let largest = table.compute_peak_at_each_grid_point_m_per_s2(plan).into_iter().flatten().fold(0.0, f64::max);
    if largest <= 0.0 {
        return Bound::Unknown(UNMOVED);
    }
    // For each drive the accelerations at all points.
    let fields = |model: &ReducedModel| -> Option<Vec<DVector<Complex64>>> {
        let shapes = model.shape_deflections_on_grid(&table.grid.x_m, &table.grid.y_m).map(Complex64::from);
        let each = plan.drives.iter().map(|drive| {
            let actuator = table.scene.actuators.iter().position(|actuator| actuator.id == drive.actuator)?;
            let omega = std::f64::consts::TAU * drive.frequency_hz;
            let q = response::solve_coordinates_per_newton_at_frequency(model, drive.frequency_hz).ok()?;
            Some(&shapes * q.get(actuator)? * Complex64::from(-omega * omega * drive.force_n))
        });
        each.collect()
    };
    let (Some(fine), Some(middle), Some(coarse)) = (fields(&table.model), fields(middle), fields(coarse)) else {
        return Bound::Unknown(UNBOUNDED);
    };
    let difference = |a: &[DVector<Complex64>], b: &[DVector<Complex64>]| {
        let mut sum = DVector::zeros(table.grid.weights.len());
        for (a, b) in a.iter().zip(b) {
            sum += (a - b).map(|z| z.norm());
        }
        sum.amax() / largest
    };
    estimator.response_error_bound_from_relative_differences(difference(&coarse, &middle), difference(&middle, &fine))
}
