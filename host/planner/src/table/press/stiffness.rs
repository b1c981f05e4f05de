//! Springs with which masses without a stop withstand a press: each actuator's own need times one common factor, the
//! smallest that suffices for all. Stiffer springs under one ERA change the axis about which the panel turns, so that
//! another mass may travel further than before.

use nalgebra::{DMatrix, DVector};

/// Most times its own need that an actuator's springs are made stiffer.
const MOST_STIFFER: f64 = 1e3;
/// Halvings of that factor: to 1e-4 of itself.
const SPRING_HALVINGS: u32 = 24;

/// Masses whose springs do not withstand a press, with everything that moves them.
pub(super) struct UnheldMasses<'a> {
    /// Which actuators.
    pub actuators: &'a [usize],
    /// Displacement of every actuator's mass in m when the press is at each point: [actuator][point].
    pub pressed_m: &'a [Vec<f64>],
    /// Travel (row) per steady force, m/N, with its sign.
    pub receptance: DMatrix<f64>,
    /// The electrodes' mean pull in N where each mass may go.
    pub pulls_n: &'a [f64],
    /// How far each may go, in m.
    pub most_m: &'a [f64],
}

impl UnheldMasses<'_> {
    /// Stiffness in N/m to add to the springs of each of the actuators; `None` if no springs suffice.
    pub fn added_stiffness_to_withstand_press_if_possible_n_per_m(&self) -> Option<Vec<f64>> {
        let pulled = self.travel_of_each_mass_by_pull_of_all_electrodes_m(&self.receptance);
        let own = |i: &usize| {
            let furthest = self.pressed_m[*i].iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            ((furthest + pulled[*i]) / self.most_m[*i] - 1.0) / self.receptance[(*i, *i)]
        };
        let needs: Vec<f64> = self.actuators.iter().map(own).collect();
        if !needs.iter().all(|need| need.is_finite() && *need > 0.0) {
            return None;
        }
        let times = |factor: f64| -> Vec<f64> { needs.iter().map(|need| factor * need).collect() };
        let (mut low, mut high) = (0.0, 1.0);
        while !self.keeps_travel_limits_with_added_stiffness(&times(high)) {
            (low, high) = (high, 2.0 * high);
            if high > MOST_STIFFER {
                return None;
            }
        }
        for _ in 0..SPRING_HALVINGS {
            let middle = 0.5 * (low + high);
            *(if self.keeps_travel_limits_with_added_stiffness(&times(middle)) { &mut high } else { &mut low }) =
                middle;
        }
        Some(times(high))
    }

    /// Travel of every mass in m that the electrodes' pull causes.
    fn travel_of_each_mass_by_pull_of_all_electrodes_m(&self, receptance: &DMatrix<f64>) -> DVector<f64> {
        receptance.map(f64::abs) * DVector::from_column_slice(self.pulls_n)
    }

    /// The matrix (1 + G K)^-1, which makes of the displacements x of all masses those with the stiffnesses `added_n_per_m`; `None` if there is
    /// no inverse.
    pub fn invert_stiffened_system_if_regular(&self, added_n_per_m: &[f64]) -> Option<DMatrix<f64>> {
        let p = self.receptance.nrows();
        let mut springs = DVector::zeros(p);
        self.actuators.iter().zip(added_n_per_m).for_each(|(i, k)| springs[*i] = *k);
        (DMatrix::identity(p, p) + &self.receptance * DMatrix::from_diagonal(&springs)).try_inverse()
    }

    /// Whether all these masses stay within their limits with the stiffnesses `added_n_per_m`.
    fn keeps_travel_limits_with_added_stiffness(&self, added_n_per_m: &[f64]) -> bool {
        let p = self.receptance.nrows();
        let Some(inverse) = self.invert_stiffened_system_if_regular(added_n_per_m) else { return false };
        let pulled = self.travel_of_each_mass_by_pull_of_all_electrodes_m(&(&inverse * &self.receptance));
        let points = self.pressed_m.first().map_or(0, Vec::len);
        (0..points).all(|point| {
            let moved = |i: usize| (0..p).map(|j| inverse[(i, j)] * self.pressed_m[j][point]).sum::<f64>().abs();
            self.actuators.iter().all(|i| moved(*i) + pulled[*i] <= self.most_m[*i])
        })
    }
}
