//! The panel in time: modal equations of motion, integrated exactly from step to step under forces that are constant over
//! a step and depend on where the masses are in it.
//!
//! With x the travel towards electrode A, V the rail's voltage and a, b the parts of the step for which the electrodes are
//! on, the force is eps0 S/2 V^2 (a/(g - x)^2 - b/(g + x)^2). It is taken at the mean of x over the step, which the step
//! itself yields: under the last step's force first, then under that of this mean. That is of second order in the step.

use super::accelerometer::Accelerometer;
use super::rails::SimRail;
use super::timer::SimTimer;
use crate::planner::PlanTable;
use crate::planner::softening::Transducer;
use crate::transient::reduced::{ConstantForceStepper, ModalSystem, VELOCITY_SCALE, is_mode_stepped};
use era_shared::MAX_CHANNELS;
use era_shared::supply::{RAILS, rail_index_of_channel};
use nalgebra::DVector;

/// Step of the integration in s. The step itself is exact for any length; 25 us is what the accelerometer needs: the mean
/// over a step loses (pi f dt)^2/6 = 1e-3 at 1 kHz and 1.6e-4 at 400 Hz.
pub const STEP_S: f64 = 25e-6;
/// Below this part of its largest state the panel counts as at rest and costs nothing.
const AT_REST: f64 = 1e-9;

/// Part of the gap at which a mass meets a stop: 50 um of insulation in a gap of 0.5 mm. The stop gives way by a few
/// percent of the gap under what 4 kV do there; the electrodes' force does not grow beyond it.
pub const STOP: f64 = 0.9;
/// Stiffness of that stop, as a part of what would push the mass back to it within a step. Beyond 2/3 it would gain energy.
const STOP_STIFFNESS: f64 = 1.0 / 6.0;
/// Part of the push that is left once the mass is on its way back: half of its speed.
const REBOUND: f64 = 0.25;

/// Part of a step from which on an electrode counts as on: above what rounding leaves.
const SEEN_ON: f64 = 1e-6;

/// Steps between two looks at how far a motion has settled: 2^12, or 0.1 s.
const LOOK_SQUARINGS: u32 = 12;

/// How far an actuator's mass has been.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TravelExtreme {
    /// Most that it was away from its middle, in m.
    pub travel_m: f64,
    /// Whether it has met a stop: an electrode has pulled it in.
    pub snapped_in: bool,
}

/// The panel, its drives and the accelerometer on it.
#[derive(Clone, Debug)]
pub struct SimPanel {
    stepper: ConstantForceStepper,
    kept: Vec<usize>,
    omega: DVector<f64>,
    state: DVector<f64>,
    next: DVector<f64>,
    forces: DVector<f64>,
    sources: [Option<SimTimer>; MAX_CHANNELS],
    rails: [SimRail; RAILS],
    connected: bool,
    /// What stands at the electrodes, as a part of what the rails have.
    at_electrodes: f64,
    step_s: f64,
    transducers: Vec<Transducer>,
    /// Mean travel of each actuator's mass over the last step in m.
    travel: DVector<f64>,
    /// The same of this step, without this step's force.
    free_travel: DVector<f64>,
    extremes: [TravelExtreme; MAX_CHANNELS],
    /// Steps in which both electrodes of an actuator were on: guards are many steps long.
    overlaps: u64,
    probe: DVector<f64>,
    probe_velocity: f64,
    /// The sensor under the finger.
    pub accelerometer: Accelerometer,
    steps: u64,
    largest: f64,
}

impl SimPanel {
    /// A panel at rest. `transducers` has one entry per actuator (column of `system.force`).
    #[must_use]
    pub fn new(system: &ModalSystem, transducers: Vec<Transducer>) -> Self {
        Self::with_step(system, transducers, STEP_S)
    }

    /// The same with another step than [`STEP_S`].
    #[must_use]
    pub fn with_step(system: &ModalSystem, transducers: Vec<Transducer>, step_s: f64) -> Self {
        let kept: Vec<usize> = (0..system.lambda.len()).filter(|i| is_mode_stepped(system.lambda[*i])).collect();
        let system = ModalSystem {
            lambda: system.lambda.select_rows(&kept),
            damping: system.damping.select_rows(&kept).select_columns(&kept),
            force: system.force.select_rows(&kept),
        };
        let n = kept.len();
        Self {
            stepper: ConstantForceStepper::new(&system, step_s),
            kept,
            omega: system.lambda.map(f64::sqrt),
            state: DVector::zeros(2 * n),
            next: DVector::zeros(2 * n),
            forces: DVector::zeros(system.force.ncols()),
            sources: [const { None }; MAX_CHANNELS],
            rails: [SimRail::new_discharging(0.0, 0.0); RAILS],
            connected: false,
            at_electrodes: 1.0,
            step_s,
            transducers,
            travel: DVector::zeros(system.force.ncols()),
            free_travel: DVector::zeros(system.force.ncols()),
            extremes: [TravelExtreme::default(); MAX_CHANNELS],
            overlaps: 0,
            probe: DVector::zeros(n),
            probe_velocity: 0.0,
            accelerometer: Accelerometer::new(step_s),
            steps: 0,
            largest: 0.0,
        }
    }

    /// The panel of a planner's table, at rest.
    #[must_use]
    pub fn from_plan_table(table: &PlanTable) -> Self {
        Self::from_plan_table_with_step(table, STEP_S)
    }

    /// The same with another step than [`STEP_S`].
    #[must_use]
    pub fn from_plan_table_with_step(table: &PlanTable, step_s: f64) -> Self {
        let transducers = table.scene.actuators.iter().map(Transducer::of).collect();
        Self::with_step(&ModalSystem::from_reduced(&table.model), transducers, step_s)
    }

    /// Between two samples of the accelerometer, in s.
    #[must_use]
    pub const fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Puts the accelerometer where the mode shapes have the values `shape` (one per coordinate of the system); what it has measured elsewhere is
    /// forgotten.
    pub fn place_accelerometer(&mut self, shape: &DVector<f64>) {
        self.probe =
            DVector::from_iterator(self.kept.len(), self.kept.iter().map(|i| shape.get(*i).copied().unwrap_or(0.0)));
        self.probe_velocity = self.probe_velocity_m_per_s();
        self.accelerometer.forget_measurements();
    }

    /// Time in s, a multiple of 0.1 s or so, after which a free motion from the coordinates `displacement` and their rates
    /// `velocity` (of the system) accelerates the probe by no more than `acceptable_m_per_s2` m/s^2, and the most that it then does; the
    /// latter is more than `acceptable_m_per_s2` if that takes longer than `longest_s`. Upper bound, over all phases of the modes.
    #[must_use]
    pub fn settling_time_and_acceleration(
        &self,
        displacement: &DVector<f64>,
        velocity: &DVector<f64>,
        acceptable_m_per_s2: f64,
        longest_s: f64,
    ) -> (f64, f64) {
        let n = self.kept.len();
        let mut motion = DVector::from_fn(2 * n, |i, _| {
            if i < n { displacement[self.kept[i]] } else { velocity[self.kept[i - n]] / VELOCITY_SCALE }
        });
        let acceleration = |motion: &DVector<f64>| -> f64 {
            (0..n)
                .map(|i| {
                    let omega = self.omega[i];
                    self.probe[i].abs() * omega * (omega * motion[i]).hypot(motion[n + i] * VELOCITY_SCALE)
                })
                .sum()
        };
        let mut propagate = self.stepper.propagate.clone();
        for _ in 0..LOOK_SQUARINGS {
            propagate = &propagate * &propagate;
        }
        let look_s = f64::from(1_u32 << LOOK_SQUARINGS) * self.step_s;
        let mut time_s = 0.0;
        loop {
            let left = acceleration(&motion);
            if left <= acceptable_m_per_s2 || time_s + look_s > longest_s {
                return (time_s, left);
            }
            motion = &propagate * motion;
            time_s += look_s;
        }
    }

    /// Sets, or ends, the timer of a channel.
    pub fn set_channel_timer(&mut self, channel: usize, timer: Option<SimTimer>) {
        if let Some(place) = self.sources.get_mut(channel) {
            *place = timer;
        }
    }

    /// The timer of a channel.
    pub fn channel_timer_mut(&mut self, channel: usize) -> Option<&mut SimTimer> {
        self.sources.get_mut(channel).and_then(Option::as_mut)
    }

    /// Lets the timers reach the electrodes, or keeps them from it.
    pub const fn set_electrodes_connected(&mut self, connected: bool) {
        self.connected = connected;
    }

    /// Sets the voltage at the electrodes as a fraction of the rails': 1 is correct.
    pub const fn set_electrode_voltage_fraction(&mut self, fraction: f64) {
        self.at_electrodes = fraction;
    }

    /// The rail with this index; a discharged one if there is no such rail.
    #[must_use]
    pub fn rail(&self, index: usize) -> SimRail {
        self.rails.get(index).copied().unwrap_or(SimRail::new_discharging(0.0, 0.0))
    }

    /// Changes the course of a rail.
    pub fn set_rail(&mut self, index: usize, state: SimRail) {
        if let Some(place) = self.rails.get_mut(index) {
            *place = state;
        }
    }

    /// Simulated time in s.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "exact up to 2^53 steps")]
    pub fn time_s(&self) -> f64 {
        self.steps as f64 * self.step_s
    }

    /// Counts time from zero again; the motion goes on.
    pub const fn restart_clock(&mut self) {
        self.steps = 0;
    }

    /// Integrates up to `time_s`.
    pub fn advance_to(&mut self, time_s: f64) {
        while self.time_s() + self.step_s <= time_s {
            self.integrate_step();
        }
    }

    /// How far the actuators' masses have moved since the last call.
    pub fn take_travel_extremes(&mut self) -> [TravelExtreme; MAX_CHANNELS] {
        std::mem::take(&mut self.extremes)
    }

    /// The largest travel of a mass since the last call, as a fraction of its gap.
    pub fn take_largest_travel_fraction(&mut self) -> f64 {
        let extremes = self.take_travel_extremes();
        let parts = extremes.iter().zip(&self.transducers).map(|(extreme, t)| extreme.travel_m / t.gap_m);
        parts.fold(0.0, f64::max)
    }

    /// Steps so far in which both electrodes of an actuator had voltage.
    #[must_use]
    pub const fn overlap_step_count(&self) -> u64 {
        self.overlaps
    }

    fn integrate_step(&mut self) {
        let from_s = self.time_s();
        self.steps += 1;
        // Over a step of 25 us the square of a rail's voltage is its value in the middle to 1e-5.
        let middle_s = from_s + 0.5 * self.step_s;
        let volts: [f64; RAILS] = if self.connected {
            self.rails.map(|rail| self.at_electrodes * rail.volts_at(middle_s))
        } else {
            [0.0; RAILS]
        };
        let mut pulls = [[0.0; 2]; MAX_CHANNELS];
        let mut driven = false;
        for ((channel, pull), transducer) in pulls.iter_mut().enumerate().zip(&self.transducers) {
            let source = self.sources.get(channel).and_then(Option::as_ref).filter(|source| !source.is_blank());
            if let (Some(source), Some(volts)) = (source, volts.get(rail_index_of_channel(channel)))
                && *volts > 0.0
            {
                driven = true;
                let newtons = transducer.newtons_per_volt_squared * volts * volts;
                let on = source.electrode_on_fractions(from_s, self.step_s);
                self.overlaps += u64::from(on.iter().all(|part| *part > SEEN_ON));
                *pull = on.map(|on| on * newtons);
            }
        }
        if driven || self.is_moving_else_zero_state() {
            self.free_travel.gemv(1.0, &self.stepper.travel, &self.state, 0.0);
            let before: [f64; MAX_CHANNELS] = std::array::from_fn(|i| self.travel.get(i).copied().unwrap_or_default());
            for _ in 0..2 {
                self.travel.copy_from(&self.free_travel);
                self.travel.gemv(1.0, &self.stepper.travel_input, &self.forces, 1.0);
                for (i, (force, transducer)) in self.forces.iter_mut().zip(&self.transducers).enumerate() {
                    let (pull, before_m) = pulls.get(i).zip(before.get(i)).unwrap_or((&[0.0; 2], &0.0));
                    let (travel_m, compliance) = (self.travel[i], self.stepper.travel_input[(i, i)]);
                    *force = electrode_force_n(transducer, *pull, travel_m)
                        + end_stop_force_n(transducer, travel_m, *before_m, compliance);
                }
            }
            self.next.gemv(1.0, &self.stepper.propagate, &self.state, 0.0);
            self.next.gemv(1.0, &self.stepper.input, &self.forces, 1.0);
            std::mem::swap(&mut self.state, &mut self.next);
            for ((extreme, travel), transducer) in self.extremes.iter_mut().zip(&self.travel).zip(&self.transducers) {
                extreme.travel_m = extreme.travel_m.max(travel.abs());
                extreme.snapped_in |= travel.abs() > STOP * transducer.gap_m;
            }
        }
        // The change of velocity is the mean acceleration over the step, edges included.
        let velocity = self.probe_velocity_m_per_s();
        self.accelerometer.add_sample((velocity - self.probe_velocity) / self.step_s);
        self.probe_velocity = velocity;
    }

    /// Whether the panel still moves; a panel that has come to rest is set to exactly zero.
    fn is_moving_else_zero_state(&mut self) -> bool {
        let now = self.state.amax();
        self.largest = self.largest.max(now);
        if now > AT_REST * self.largest {
            return true;
        }
        self.state.fill(0.0);
        self.travel.fill(0.0);
        self.forces.fill(0.0);
        self.largest = 0.0;
        false
    }

    fn probe_velocity_m_per_s(&self) -> f64 {
        let n = self.kept.len();
        self.probe.dot(&self.state.rows(n, n)) * VELOCITY_SCALE
    }
}

/// Force of the electrodes on a mass that is `travel_m` away from its middle, in N: `rest_forces_n` has what A and B would do at
/// rest. What the model's springs are softened by already is added back.
fn electrode_force_n(transducer: &Transducer, rest_forces_n: [f64; 2], travel_m: f64) -> f64 {
    let part = (travel_m / transducer.gap_m).clamp(-STOP, STOP);
    let [a, b] = rest_forces_n;
    a / ((1.0 - part) * (1.0 - part)) - b / ((1.0 + part) * (1.0 + part)) - transducer.counted_n_per_m * travel_m
}

/// Force of the stops in N; `compliance_m_per_n` is the mean travel in a step for 1 N, in m/N.
fn end_stop_force_n(transducer: &Transducer, travel_m: f64, before_m: f64, compliance_m_per_n: f64) -> f64 {
    let beyond_m = travel_m.abs() - STOP * transducer.gap_m;
    if beyond_m <= 0.0 || compliance_m_per_n <= 0.0 {
        return 0.0;
    }
    let rebound = if travel_m.abs() < before_m.abs() { REBOUND } else { 1.0 };
    -travel_m.signum() * beyond_m * rebound * STOP_STIFFNESS / compliance_m_per_n
}

#[cfg(test)]
mod tests {
    use super::*;
    use era_shared::supply::SupplyCommand;
    use era_shared::waveform::TimerPeriod;
    use nalgebra::DMatrix;

    /// One mode of w rad/s and the viscous damping c in 1/s.
    fn panel(omega: f64, c: f64) -> SimPanel {
        let system = ModalSystem {
            lambda: DVector::from_element(1, omega * omega),
            damping: DMatrix::from_element(1, 1, c),
            force: DMatrix::from_element(1, 1, 1.0),
        };
        SimPanel::new(&system, vec![Transducer::fixed(1.0)])
    }

    #[test]
    fn settling_follows_the_slowest_pole() {
        let part = 1e-4_f64;
        let one = DVector::from_element(1, 1.0);
        // Weak damping: exp(-c t / 2). Strong: one pole at -c, the slow one at -w^2 / c.
        for (omega, c, rate) in [(600.0, 12.0, 6.0), (100.0, 2000.0, 5.01)] {
            let mut panel = panel(omega, c);
            panel.place_accelerometer(&one);
            let (found, left) = panel.settling_time_and_acceleration(&one, &(0.0 * &one), part * omega * omega, 20.0);
            let rough = -part.ln() / rate;
            assert!((found - rough).abs() < 0.2 * rough, "{omega} {c}: {found} s, about {rough} s");
            assert!(left <= part * omega * omega);
        }
        let mut undamped = panel(600.0, 0.0);
        undamped.place_accelerometer(&one);
        let (_, left) = undamped.settling_time_and_acceleration(&one, &one, 1.0, 20.0);
        assert!((left - 600.0 * 600.0_f64.hypot(1.0)).abs() < 1e-6 * left);
        let mut free = panel(0.0, 0.0);
        free.place_accelerometer(&one);
        assert_eq!(
            free.settling_time_and_acceleration(&one, &one, 0.0, 20.0),
            (0.0, 0.0),
            "a drift is no acceleration"
        );
    }

    const ERA: Transducer = Transducer { newtons_per_volt_squared: 3.477e-8, gap_m: 0.5e-3, counted_n_per_m: 0.0 };

    /// An ERA of 10 g and 5 kN/m on the ground (112.5 Hz), driven with windows of 2/3 at `period_ticks` of 1 us, its rail on
    /// the way to `volts`.
    fn driven_era(step_s: f64, period_ticks: u32, volts: u32) -> SimPanel {
        let (mass, stiffness, damping) = (0.01_f64, 5000.0, 0.7);
        let system = ModalSystem {
            lambda: DVector::from_element(1, stiffness / mass),
            damping: DMatrix::from_element(1, 1, damping / mass),
            force: DMatrix::from_element(1, 1, 1.0 / mass.sqrt()),
        };
        let mut panel = SimPanel::with_step(&system, vec![ERA], step_s);
        let mut source = SimTimer::new(0.0).expect("idle");
        source
            .preload_period(&TimerPeriod::with_windows(170, period_ticks, period_ticks / 3, false), 0.0, 0.0)
            .expect("a period");
        panel.set_channel_timer(0, Some(source));
        panel.set_electrodes_connected(true);
        let mut supply = SupplyCommand { enabled: true, discharge: [false; RAILS], ..SupplyCommand::default() };
        supply.set_point_millivolts[0] = volts * 1000;
        let mut rail = SimRail::new_discharging(0.0, 0.0);
        rail.apply_supply_command(0.0, &supply, 0, false);
        panel.set_rail(0, rail);
        panel
    }

    #[test]
    fn the_steps_error_is_below_1e_4() {
        // At 100, 105 and 167 Hz, the first two of them up to a fifth of the gap. At 400 Hz it is 4e-4, from the windows' edges.
        for (period_ticks, volts) in [(10_000, 1300), (9_524, 1200), (6_000, 1900)] {
            let mut panels = [STEP_S, STEP_S / 2.0, STEP_S / 8.0].map(|step_s| driven_era(step_s, period_ticks, volts));
            let (mut most, mut errors) = (0.0_f64, [0.0_f64; 2]);
            for i in 1..=16_000_u32 {
                let [coarse, half, fine] = panels.each_mut().map(|panel| {
                    panel.advance_to(f64::from(i) * STEP_S + 1e-9);
                    panel.state[0] * 10.0
                });
                most = most.max(fine.abs());
                errors = [errors[0].max((coarse - fine).abs()), errors[1].max((half - fine).abs())];
            }
            let [coarse, half] = errors.map(|error| error / most);
            println!(
                "{volts} V: {:.3} of the gap, error {coarse:.1e}, with half the step {half:.1e}",
                most / ERA.gap_m
            );
            assert!(coarse < 1e-4 && half < 0.5 * coarse, "{coarse} {half}");
        }
    }

    #[test]
    fn an_era_that_is_driven_too_hard_snaps_in_and_stays_between_its_stops() {
        let mut panel = driven_era(STEP_S, 9_524, 1200);
        panel.advance_to(0.5);
        let [extreme, ..] = panel.take_travel_extremes();
        assert!(!extreme.snapped_in && extreme.travel_m > 0.1 * ERA.gap_m && extreme.travel_m < ERA.gap_m / 3.0);
        let mut panel = driven_era(STEP_S, 9_524, 4000);
        panel.advance_to(0.5);
        let [extreme, ..] = panel.take_travel_extremes();
        assert!(extreme.snapped_in && extreme.travel_m < ERA.gap_m, "{extreme:?}");
        panel.set_electrodes_connected(false);
        panel.advance_to(1.0);
        panel.take_travel_extremes();
        panel.advance_to(1.5);
        let [extreme, ..] = panel.take_travel_extremes();
        assert!(!extreme.snapped_in && extreme.travel_m < 0.01 * ERA.gap_m, "{extreme:?}");
    }
}
