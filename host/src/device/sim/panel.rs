//! The panel in time: modal equations of motion, integrated exactly from step to step.

use super::accelerometer::Accelerometer;
use super::rails::Rail;
use super::source::Source;
use crate::model::ReducedModel;
use crate::planner::PlanTable;
use crate::planner::limits::Electrodes;
use era_shared::MAX_CHANNELS;
use era_shared::supply::{RAILS, rail_of};
use nalgebra::{DMatrix, DVector};

/// Step of the integration in s. The step itself is exact for any length; 25 us is what the accelerometer needs: the mean
/// over a step loses (pi f dt)^2/6 = 1e-3 at 1 kHz and 1.6e-4 at 400 Hz.
pub const STEP_S: f64 = 25e-6;
/// Modes above this frequency follow any force within the step statically; their compliance is below 1e-4 of that of the
/// modes kept, and leaving them out keeps the matrix exponential well scaled.
const HIGHEST_MODE_HZ: f64 = 200e3;
/// Velocities are divided by this in the state (rad/s), to be of the size of displacements.
const VELOCITY_SCALE: f64 = 1e3;
/// Below this part of its largest state the panel counts as at rest and costs nothing.
const AT_REST: f64 = 1e-9;

/// Steps between two looks at how far a motion has settled: 2^12, or 0.1 s.
const LOOK_SQUARINGS: u32 = 12;

/// q'' + C q' + Lambda q = B f: mass-normalised, n coordinates, p forces.
#[derive(Clone, Debug)]
pub struct ModalSystem {
    /// Squared angular frequencies in rad^2/s^2, length n.
    pub lambda: DVector<f64>,
    /// Damping in 1/s, n x n.
    pub damping: DMatrix<f64>,
    /// Modal force of 1 N at each actuator, n x p, in kg^-1/2.
    pub force: DMatrix<f64>,
}

impl ModalSystem {
    /// The reduced model in time. Hysteretic damping, j S, has no causal form; each mode gets the viscous damping that
    /// loses as much at its own resonance, S_rs / sqrt(w_r w_s), which differs from it by less than half the loss factor
    /// of a mode's part anywhere else.
    #[must_use]
    pub fn from_reduced(model: &ReducedModel) -> Self {
        let omega = model.lambda.map(f64::sqrt);
        let n = model.order();
        let damping = DMatrix::from_fn(n, n, |i, j| {
            let scale = (omega[i] * omega[j]).sqrt();
            let structural = if scale > 0.0 { model.structural[(i, j)] / scale } else { 0.0 };
            model.viscous[(i, j)] + structural
        });
        Self { lambda: model.lambda.clone(), damping, force: model.force.clone() }
    }
}

/// Exact propagation over one step under constant force: z' = E z + G f with z = (q, q'/scale).
#[derive(Clone, Debug)]
struct Stepper {
    propagate: DMatrix<f64>,
    input: DMatrix<f64>,
}

impl Stepper {
    fn new(system: &ModalSystem) -> Self {
        let (n, p) = (system.lambda.len(), system.force.ncols());
        // exp([[A, B], [0, 0]] dt) holds both matrices (Van Loan 1978).
        let mut block = DMatrix::zeros(2 * n + p, 2 * n + p);
        for i in 0..n {
            block[(i, n + i)] = VELOCITY_SCALE * STEP_S;
            block[(n + i, i)] = -system.lambda[i] / VELOCITY_SCALE * STEP_S;
            for j in 0..n {
                block[(n + i, n + j)] = -system.damping[(i, j)] * STEP_S;
            }
            for j in 0..p {
                block[(n + i, 2 * n + j)] = system.force[(i, j)] / VELOCITY_SCALE * STEP_S;
            }
        }
        let exponential = block.exp();
        Self {
            propagate: exponential.view((0, 0), (2 * n, 2 * n)).into_owned(),
            input: exponential.view((0, 2 * n), (2 * n, p)).into_owned(),
        }
    }
}

/// The panel, its drives and the accelerometer on it.
#[derive(Clone, Debug)]
pub struct Panel {
    stepper: Stepper,
    kept: Vec<usize>,
    omega: DVector<f64>,
    state: DVector<f64>,
    next: DVector<f64>,
    forces: DVector<f64>,
    sources: [Option<Source>; MAX_CHANNELS],
    rails: [Rail; RAILS],
    connected: bool,
    /// Force of 1 V^2 at each actuator in N: eps0 S / (2 g^2).
    newtons_per_volt_squared: Vec<f64>,
    probe: DVector<f64>,
    probe_velocity: f64,
    /// The sensor under the finger.
    pub accelerometer: Accelerometer,
    steps: u64,
    largest: f64,
}

impl Panel {
    /// A panel at rest. `newtons_per_volt_squared` has one entry per actuator (column of `system.force`).
    #[must_use]
    pub fn new(system: &ModalSystem, newtons_per_volt_squared: Vec<f64>) -> Self {
        let highest = (std::f64::consts::TAU * HIGHEST_MODE_HZ).powi(2);
        let kept: Vec<usize> = (0..system.lambda.len()).filter(|i| system.lambda[*i] < highest).collect();
        let system = ModalSystem {
            lambda: system.lambda.select_rows(&kept),
            damping: system.damping.select_rows(&kept).select_columns(&kept),
            force: system.force.select_rows(&kept),
        };
        let n = kept.len();
        Self {
            stepper: Stepper::new(&system),
            kept,
            omega: system.lambda.map(f64::sqrt),
            state: DVector::zeros(2 * n),
            next: DVector::zeros(2 * n),
            forces: DVector::zeros(system.force.ncols()),
            sources: [const { None }; MAX_CHANNELS],
            rails: [Rail::discharging(0.0, 0.0); RAILS],
            connected: false,
            newtons_per_volt_squared,
            probe: DVector::zeros(n),
            probe_velocity: 0.0,
            accelerometer: Accelerometer::new(STEP_S),
            steps: 0,
            largest: 0.0,
        }
    }

    /// The panel of a planner's table, at rest.
    #[must_use]
    pub fn of(table: &PlanTable) -> Self {
        let forces = table.electrodes.iter().map(Electrodes::newtons_per_volt_squared).collect();
        Self::new(&ModalSystem::from_reduced(&table.model), forces)
    }

    /// Puts the accelerometer where the mode shapes have the values `shape` (one per coordinate of the system).
    pub fn set_probe(&mut self, shape: &DVector<f64>) {
        self.probe =
            DVector::from_iterator(self.kept.len(), self.kept.iter().map(|i| shape.get(*i).copied().unwrap_or(0.0)));
        self.probe_velocity = self.velocity_at_probe();
    }

    /// Time in s, a multiple of 0.1 s or so, after which a free motion from the coordinates `displacement` and their rates
    /// `velocity` (of the system) accelerates the probe by no more than `enough` m/s^2, and the most that it then does; the
    /// latter is more than `enough` if that takes longer than `longest_s`. Upper bound, over all phases of the modes.
    #[must_use]
    pub fn settling(
        &self,
        displacement: &DVector<f64>,
        velocity: &DVector<f64>,
        enough: f64,
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
        let look_s = f64::from(1_u32 << LOOK_SQUARINGS) * STEP_S;
        let mut time_s = 0.0;
        loop {
            let left = acceleration(&motion);
            if left <= enough || time_s + look_s > longest_s {
                return (time_s, left);
            }
            motion = &propagate * motion;
            time_s += look_s;
        }
    }

    /// Sets, or ends, the timer of a channel.
    pub fn set_source(&mut self, channel: usize, source: Option<Source>) {
        if let Some(place) = self.sources.get_mut(channel) {
            *place = source;
        }
    }

    /// The timer of a channel.
    pub fn source_mut(&mut self, channel: usize) -> Option<&mut Source> {
        self.sources.get_mut(channel).and_then(Option::as_mut)
    }

    /// Lets the timers reach the electrodes, or keeps them from it.
    pub const fn connect(&mut self, connected: bool) {
        self.connected = connected;
    }

    /// A rail, counted from 0; one that there is not is at zero.
    #[must_use]
    pub fn rail(&self, rail: usize) -> Rail {
        self.rails.get(rail).copied().unwrap_or(Rail::discharging(0.0, 0.0))
    }

    /// Changes the course of a rail.
    pub fn set_rail(&mut self, rail: usize, state: Rail) {
        if let Some(place) = self.rails.get_mut(rail) {
            *place = state;
        }
    }

    /// Simulated time in s.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "exact up to 2^53 steps")]
    pub fn time_s(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    /// Counts time from zero again; the motion goes on.
    pub const fn restart_clock(&mut self) {
        self.steps = 0;
    }

    /// Integrates up to `time_s`.
    pub fn advance_to(&mut self, time_s: f64) {
        while self.time_s() + STEP_S <= time_s {
            self.step();
        }
    }

    fn step(&mut self) {
        let from_s = self.time_s();
        self.steps += 1;
        // Over a step of 25 us the square of a rail's voltage is its value in the middle to 1e-5.
        let middle_s = from_s + 0.5 * STEP_S;
        let volts: [f64; RAILS] =
            if self.connected { self.rails.map(|rail| rail.volts_at(middle_s)) } else { [0.0; RAILS] };
        let mut driven = false;
        for (channel, force) in self.forces.iter_mut().enumerate() {
            let source = self.sources.get(channel).and_then(Option::as_ref).filter(|source| !source.is_blank());
            let (volts, scale) = (volts.get(rail_of(channel)), self.newtons_per_volt_squared.get(channel));
            *force = match (source, volts, scale) {
                (Some(source), Some(volts), Some(scale)) if *volts > 0.0 => {
                    driven = true;
                    scale * volts * volts * source.mean_balance(from_s, STEP_S)
                }
                _ => 0.0,
            };
        }
        if driven || self.is_moving() {
            self.next.gemv(1.0, &self.stepper.propagate, &self.state, 0.0);
            self.next.gemv(1.0, &self.stepper.input, &self.forces, 1.0);
            std::mem::swap(&mut self.state, &mut self.next);
        }
        // The change of velocity is the mean acceleration over the step, edges included.
        let velocity = self.velocity_at_probe();
        self.accelerometer.sample((velocity - self.probe_velocity) / STEP_S);
        self.probe_velocity = velocity;
    }

    /// Whether anything is left of earlier drives; a panel that has come to rest is set to exactly zero.
    fn is_moving(&mut self) -> bool {
        let now = self.state.amax();
        self.largest = self.largest.max(now);
        if now > AT_REST * self.largest {
            return true;
        }
        self.state.fill(0.0);
        self.largest = 0.0;
        false
    }

    fn velocity_at_probe(&self) -> f64 {
        let n = self.kept.len();
        self.probe.dot(&self.state.rows(n, n)) * VELOCITY_SCALE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One mode of w rad/s and the viscous damping c in 1/s.
    fn panel(omega: f64, c: f64) -> Panel {
        let system = ModalSystem {
            lambda: DVector::from_element(1, omega * omega),
            damping: DMatrix::from_element(1, 1, c),
            force: DMatrix::from_element(1, 1, 1.0),
        };
        Panel::new(&system, vec![1.0])
    }

    #[test]
    fn settling_follows_the_slowest_pole() {
        let part = 1e-4_f64;
        let one = DVector::from_element(1, 1.0);
        // Weak damping: exp(-c t / 2). Strong: one pole at -c, the slow one at -w^2 / c.
        for (omega, c, rate) in [(600.0, 12.0, 6.0), (100.0, 2000.0, 5.01)] {
            let mut panel = panel(omega, c);
            panel.set_probe(&one);
            let (found, left) = panel.settling(&one, &(0.0 * &one), part * omega * omega, 20.0);
            let rough = -part.ln() / rate;
            assert!((found - rough).abs() < 0.2 * rough, "{omega} {c}: {found} s, about {rough} s");
            assert!(left <= part * omega * omega);
        }
        let mut undamped = panel(600.0, 0.0);
        undamped.set_probe(&one);
        let (_, left) = undamped.settling(&one, &one, 1.0, 20.0);
        assert!((left - 600.0 * 600.0_f64.hypot(1.0)).abs() < 1e-6 * left);
        let mut free = panel(0.0, 0.0);
        free.set_probe(&one);
        assert_eq!(free.settling(&one, &one, 0.0, 20.0), (0.0, 0.0), "a drift is no acceleration");
    }
}
