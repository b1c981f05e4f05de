//! The panel in time: modal equations of motion, integrated exactly from step to step under forces that are constant over
//! a step and depend on where the masses are in it.
//!
//! With x the travel towards electrode A, V the rail's voltage and a, b the parts of the step for which the electrodes are
//! on, the force is eps0 S/2 V^2 (a/(g - x)^2 - b/(g + x)^2). Of electrodes behind resistors, a V^2 and b V^2 are the means over the step of
//! the squares of their own voltages. The force is taken at the mean of x over the step, which the step
//! itself yields: under the last step's force first, then under that of this mean. That is of second order in the step.

use super::accelerometer::Accelerometer;
use super::electrodes::SimElectrodes;
use super::outputs::SimOutputs;
use super::rails::SimRail;
use super::timer::SimTimer;
use crate::planner::PlanTable;
use crate::planner::charging::ChargingElectrode;
use crate::planner::softening::Transducer;
use crate::transient::reduced::{ConstantForceStepper, ModalSystem, VELOCITY_SCALE, is_mode_slow_enough_to_step};
use era_shared::MAX_CHANNELS;
use era_shared::safety::ElectrodePulses;
use era_shared::supply::{RAILS, rail_index_of_channel};
use era_shared::waveform::Electrode;
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
pub struct LargestTravel {
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
    /// What the electrodes take from the rails.
    pub electrodes: SimElectrodes,
    /// What stands at the electrodes, as a part of what the rails have.
    at_electrodes: f64,
    step_s: f64,
    transducers: Vec<Transducer>,
    /// Voltages of the electrodes that charge through resistors.
    charging_electrodes: [[ChargingElectrode; 2]; MAX_CHANNELS],
    /// Mean travel of each actuator's mass over the last step in m.
    travel: DVector<f64>,
    /// The same of this step, without this step's force.
    free_travel: DVector<f64>,
    largest_travels: [LargestTravel; MAX_CHANNELS],
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
        let kept: Vec<usize> =
            (0..system.lambda.len()).filter(|i| is_mode_slow_enough_to_step(system.lambda[*i])).collect();
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
            rails: [SimRail::new_discharging_since(0.0, 0.0); RAILS],
            connected: false,
            electrodes: SimElectrodes::new(step_s),
            at_electrodes: 1.0,
            step_s,
            transducers,
            charging_electrodes: [[ChargingElectrode::default(); 2]; MAX_CHANNELS],
            travel: DVector::zeros(system.force.ncols()),
            free_travel: DVector::zeros(system.force.ncols()),
            largest_travels: [LargestTravel::default(); MAX_CHANNELS],
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
        let transducers = table.scene.actuators.iter().map(Transducer::from_actuator).collect();
        Self::with_step(&ModalSystem::from_reduced_with_equivalent_viscous_damping(&table.model), transducers, step_s)
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
        self.accelerometer.forget_all_but_record();
    }

    /// Time in s, a multiple of 0.1 s or so, after which a free motion from the coordinates `displacement` and their rates
    /// `velocity` (of the system) accelerates the probe by no more than `acceptable_m_per_s2` m/s^2, and the most that it then does; the
    /// latter is more than `acceptable_m_per_s2` if that takes longer than `longest_s`. Upper bound, over all phases of the modes.
    #[must_use]
    pub fn settling_time_s_and_acceleration_after_it_m_per_s2(
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
    pub const fn set_timers_connected_to_electrodes(&mut self, connected: bool) {
        self.connected = connected;
    }

    /// What the timers do at the electrodes now.
    #[must_use]
    pub fn timer_outputs_at_electrodes_now(&self) -> SimOutputs {
        let (time_s, connected) = (self.time_s(), self.connected);
        let active_periods = self.sources.each_ref().map(|source| {
            let mut active = source.as_ref()?.active_period_at_or_first_if_none_has_begun(time_s)?;
            if !connected {
                (active.windows.a.length, active.windows.b.length) = (0, 0);
            }
            Some(active)
        });
        SimOutputs { time_s, connected, active_periods }
    }

    /// Sets the voltage at the electrodes as a fraction of the rails': 1 is correct.
    pub const fn set_electrode_fraction_of_rail_voltage(&mut self, fraction: f64) {
        self.at_electrodes = fraction;
    }

    /// The rail with this index; a discharged one if there is no such rail.
    #[must_use]
    pub fn rail(&self, index: usize) -> SimRail {
        self.rails.get(index).copied().unwrap_or(SimRail::new_discharging_since(0.0, 0.0))
    }

    /// Changes the course of a rail.
    pub fn set_rail(&mut self, index: usize, state: SimRail) {
        if let Some(place) = self.rails.get_mut(index) {
            *place = state;
        }
    }

    /// The self-test's pulses on one electrode.
    pub fn pulse_electrode_and_get_rail_mv_after_first_and_last(
        &mut self,
        channel: usize,
        electrode: Electrode,
    ) -> ElectrodePulses {
        let time_s = self.time_s();
        let index = rail_index_of_channel(channel);
        let mut rail = self.rail(index);
        let pulses = self
            .electrodes
            .apply_self_test_pulses_and_get_rail_mv_after_first_and_last(time_s, channel, electrode, &mut rail);
        self.set_rail(index, rail);
        pulses
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
    pub fn take_largest_travels_since_last_call(&mut self) -> [LargestTravel; MAX_CHANNELS] {
        std::mem::take(&mut self.largest_travels)
    }

    /// The largest travel of a mass since the last call, as a fraction of its gap.
    pub fn take_largest_travel_as_fraction_of_gap_since_last_call(&mut self) -> f64 {
        let largest_travels = self.take_largest_travels_since_last_call();
        let parts =
            largest_travels.iter().zip(&self.transducers).map(|(largest_travel, t)| largest_travel.travel_m / t.gap_m);
        parts.fold(0.0, f64::max)
    }

    /// Steps so far in which both electrodes of an actuator had voltage.
    #[must_use]
    pub const fn count_steps_with_both_electrodes_on(&self) -> u64 {
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
        let mut on_parts = [[0.0; 2]; MAX_CHANNELS];
        let mut driven = false;
        for (((channel, pull), on_part), transducer) in
            pulls.iter_mut().enumerate().zip(&mut on_parts).zip(&self.transducers)
        {
            let source = self
                .sources
                .get(channel)
                .and_then(Option::as_ref)
                .filter(|source| !source.has_no_electrode_windows_now_or_preloaded());
            let volts = volts.get(rail_index_of_channel(channel)).copied().unwrap_or(0.0);
            let source = source.filter(|_| volts > 0.0);
            if let Some(source) = source {
                driven = true;
                let newtons = transducer.newtons_per_volt_squared * volts * volts;
                let on = source.electrode_on_fractions(from_s, self.step_s);
                self.overlaps += u64::from(on.iter().all(|part| *part > SEEN_ON));
                *pull = on.map(|on| on * newtons);
                *on_part = on;
            }
            let Some(electrodes) =
                self.charging_electrodes.get_mut(channel).filter(|_| !transducer.charging.is_instant())
            else {
                continue;
            };
            // Without a timer the lower switches are on.
            let on_s = source
                .map_or([None; 2], |source| source.on_stretch_of_each_electrode_from_step_start_s(from_s, self.step_s));
            for ((pull, electrode), on_s) in pull.iter_mut().zip(electrodes).zip(on_s) {
                let square =
                    electrode.advance_step_and_get_mean_square_v2(transducer.charging, volts, on_s, self.step_s);
                *pull = transducer.newtons_per_volt_squared * square;
                driven |= square > 0.0;
            }
        }
        self.electrodes.step(from_s, self.step_s, &on_parts, &mut self.rails);
        if driven || self.is_moving_else_zero_state() {
            self.free_travel.gemv(1.0, &self.stepper.travel, &self.state, 0.0);
            let before: [f64; MAX_CHANNELS] = std::array::from_fn(|i| self.travel.get(i).copied().unwrap_or_default());
            for _ in 0..2 {
                self.travel.copy_from(&self.free_travel);
                self.travel.gemv(1.0, &self.stepper.travel_input, &self.forces, 1.0);
                for (i, (force, transducer)) in self.forces.iter_mut().zip(&self.transducers).enumerate() {
                    let (pull, before_m) = pulls.get(i).zip(before.get(i)).unwrap_or((&[0.0; 2], &0.0));
                    let (travel_m, compliance) = (self.travel[i], self.stepper.travel_input[(i, i)]);
                    *force = electrode_force_at_travel_less_counted_softening_n(transducer, *pull, travel_m)
                        + end_stop_force_n(transducer, travel_m, *before_m, compliance);
                }
            }
            self.next.gemv(1.0, &self.stepper.propagate, &self.state, 0.0);
            self.next.gemv(1.0, &self.stepper.input, &self.forces, 1.0);
            std::mem::swap(&mut self.state, &mut self.next);
            for ((largest_travel, travel), transducer) in
                self.largest_travels.iter_mut().zip(&self.travel).zip(&self.transducers)
            {
                largest_travel.travel_m = largest_travel.travel_m.max(travel.abs());
                largest_travel.snapped_in |= travel.abs() > STOP * transducer.gap_m;
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
fn electrode_force_at_travel_less_counted_softening_n(
    transducer: &Transducer,
    rest_forces_n: [f64; 2],
    travel_m: f64,
) -> f64 {
    let part = (travel_m / transducer.gap_m).clamp(-STOP, STOP);
    let [a, b] = rest_forces_n;
    a / ((1.0 - part) * (1.0 - part)) - b / ((1.0 + part) * (1.0 + part)) - transducer.counted_n_per_m * travel_m
}

/// Force of the stops in N; `compliance_m_per_n` is the mean travel in a step for 1 N, in m/N.
fn end_stop_force_n(
    transducer: &Transducer,
    travel_m: f64,
    previous_travel_m: f64,
    step_travel_per_force_m_per_n: f64,
) -> f64 {
    let beyond_m = travel_m.abs() - STOP * transducer.gap_m;
    if beyond_m <= 0.0 || step_travel_per_force_m_per_n <= 0.0 {
        return 0.0;
    }
    let rebound = if travel_m.abs() < previous_travel_m.abs() { REBOUND } else { 1.0 };
    -travel_m.signum() * beyond_m * rebound * STOP_STIFFNESS / step_travel_per_force_m_per_n
}

#[cfg(test)]
mod tests;
