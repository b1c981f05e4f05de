//! What steady forces do to a reduced model: K u = f with the real stiffness, at exactly 0 Hz.
//!
//! Over mass-normalised shapes with the squared frequencies Lambda a steady force b gives the coordinates b / Lambda, and the shapes of
//! the loads carry what the modes left out. Neither damping nor a loss factor nor a mass has part in it: dashpots bear nothing that
//! stands still, a spring that loses energy holds as much as one that does not, and what weighs on the panel moves along.
//! A motion that nothing holds (Lambda exactly 0) has no steady place under a force that drives it.

use super::reduced::ReducedModel;
use nalgebra::{DMatrix, DVector};

/// Part of the largest force on a coordinate below which the force on a motion that nothing holds is rounding, as are the forces of an
/// ERA on the surface and on its own mass.
const NOT_DRIVEN: f64 = 1e-9;
/// Part of a shape's largest entry below which the surface is at rest in it.
const AT_REST: f64 = 1e-9;

impl ReducedModel {
    /// Coordinates of the steady displacement for 1 N at an actuator alone (q in m kg^1/2, length n); `None` where that drives a
    /// motion that nothing holds, and where there is no such actuator.
    #[must_use]
    pub fn steady_coordinates_per_newton_unless_absent_or_driving_free_motion(
        &self,
        actuator: usize,
    ) -> Option<DVector<f64>> {
        let force = (actuator < self.count_actuators()).then(|| self.force.column(actuator))?;
        let rounding = NOT_DRIVEN * force.amax();
        let mut coordinates = DVector::zeros(self.count_coordinates());
        for ((q, force), lambda) in coordinates.iter_mut().zip(force.iter()).zip(self.lambda.iter()) {
            if *lambda > 0.0 {
                *q = force / lambda;
            } else if force.abs() > rounding {
                return None;
            }
        }
        Some(coordinates)
    }

    /// Travel of each actuator's mass against its electrodes (row) per steady newton of each one (column) in m/N, with its sign: p x p;
    /// infinite in the column of an actuator that drives a motion that nothing holds.
    #[must_use]
    pub fn steady_travel_in_gaps_or_infinity_if_driving_free_motion_m_per_n(&self) -> DMatrix<f64> {
        let p = self.count_actuators();
        let mut travel = DMatrix::from_element(p, p, f64::INFINITY);
        for (actuator, mut column) in travel.column_iter_mut().enumerate() {
            if let Some(coordinates) = self.steady_coordinates_per_newton_unless_absent_or_driving_free_motion(actuator)
            {
                column.copy_from(&(&self.travel * coordinates));
            }
        }
        travel
    }

    /// Whether the surface has a steady place under any force: nothing that moves it is free.
    #[must_use]
    pub fn is_surface_held(&self) -> bool {
        let surface = self.grid.free.min(self.count_mesh_unknowns());
        let free = (0..self.count_coordinates()).filter(|i| self.lambda[*i] == 0.0);
        let mut moved =
            free.map(|i| self.shapes.row(i).columns(0, surface).amax() > AT_REST * self.shapes.row(i).amax());
        !moved.any(|moves| moves)
    }
}
