"""Motion in time of a reduced model M q'' + C q' + K q = sum_i f_i F_i(t, x_i), x_i the change of the i-th ERA's gap.

The force of an ERA's electrodes grows as the gap closes (contract, "Drive", with the gap as it is; x positive towards A):

    F = eps0 S / 2 (V_A^2 / (g - x)^2 - V_B^2 / (g + x)^2)

and what a bias has taken from the springs of the linear model is given back, so that nothing counts twice
(docs/src/scene.md, "Softening").

Two integrators, which share only the right-hand side: SciPy's DOP853 from one edge of a pulse to the next, and an
exponential one that takes the linear part exactly. The second is some twenty times as fast; `agreement` holds it against the
first.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from . import pulses

RAIL_RISE_V_PER_S = 20e3
"""Soft start of a rail (docs/src/safety.md, "Limits")."""


@dataclass(frozen=True)
class Drive:
    """One ERA's drive. `actuator` counts from 0; without pulses of its own an actuator is off."""

    actuator: int
    frequency_hz: float
    voltage_v: float
    pulse_width: float
    phase_rad: float = 0.0


@dataclass(frozen=True)
class Window:
    """One pulse: electrode A (sign 1) or B (sign -1) of an ERA at a voltage, from `on` to `off` in s."""

    actuator: int
    on: float
    off: float
    sign: int
    voltage_v: float


def windows(drives, seconds):
    """All pulses of even drives from 0 on."""
    return [
        Window(drive.actuator, on, off, sign, drive.voltage_v)
        for drive in drives
        for on, off, sign in pulses.pulses(drive.frequency_hz, drive.pulse_width, drive.phase_rad, 0.0, seconds)
    ]


# In Hz: where what the modes left out is read off, so far below them that it stands still.
STATIC_HZ = 20.0


class System:
    """The modes of a panel up to `max_hz` in time, with deflections at points, and the ERAs of its scene."""

    def __init__(self, panel, max_hz, points_m):
        model, actuators = panel.time_model(max_hz, points_m), panel.scene.actuators
        self.mass, self.damping, self.stiffness = (np.asarray(model[key], float) for key in "MCK")
        self.force = np.asarray(model["forces"], float)
        # Travel is counted the way the force pushes: F > 0 is A's pull, and moves the mass against the surface towards A.
        sign = np.array([-1.0 if era.inertial else 1.0 for era in actuators])
        self.gaps = sign[:, None] * np.asarray(model["gaps"], float)
        self.points = np.asarray(model["points"], float)
        root = np.where(model["omega"] > 0, 1 / np.sqrt(np.maximum(model["omega"], 1e-300)), 0.0)
        self.stand_in = np.asarray(model["H"], float) * np.outer(root, root)
        self.hysteretic = np.asarray(model["H"], float)
        self._panel, self._points_m = panel, points_m
        # What modes above `max_hz` add to the gaps at once, in m per N: [gap, actuator].
        self.gaps_rest = (sign[:, None] * panel.gap_change([STATIC_HZ])[0].T - self.gaps @ self._lossy([STATIC_HZ])[0]).real
        self.area = np.array([era.electrode_area for era in actuators])
        self.gap = np.array([era.air_gap for era in actuators])
        self.bias_stiffness = np.array([era.softening for era in actuators])
        self.times = [era.times for era in actuators]
        size = len(self.mass)
        inverse = np.linalg.inv(self.mass)
        self.accelerate = np.hstack([-inverse @ self.stiffness, -inverse @ self.damping])
        self.push = inverse @ self.force
        self.state = np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), self.accelerate])
        self.input = np.vstack([np.zeros_like(self.push), self.push])
        self._modes = None

    def steady(self, frequencies_hz):
        """Phasors of the coordinates per N: [frequency, coordinate, actuator] (thesis, equation 15)."""
        omega = 2 * np.pi * np.asarray(frequencies_hz, float)[:, None, None]
        return np.linalg.solve(self.stiffness + 1j * omega * self.damping - omega**2 * self.mass, self.force[None].astype(complex))

    def _lossy(self, frequencies_hz):
        """[`steady`] with the hysteretic loss itself."""
        omega = 2 * np.pi * np.asarray(frequencies_hz, float)[:, None, None]
        dynamic = self.stiffness + 1j * (self.hysteretic + omega * (self.damping - self.stand_in)) - omega**2 * self.mass
        return np.linalg.solve(dynamic, self.force[None].astype(complex))

    def points_rest(self, frequencies_hz):
        """What modes above `max_hz` add to the points' steady displacement in m per N: [frequency, point, actuator]."""
        omega = 2 * np.pi * np.asarray(frequencies_hz, float)[:, None, None]
        whole = -self._panel.accelerance(self._points_m, frequencies_hz).transpose(0, 2, 1) / omega**2
        return whole - self.points @ self._lossy(frequencies_hz)

    @property
    def size(self):
        """Coordinates of the reduced model."""
        return len(self.mass)

    def electrode_force(self, a, b, x):
        """Forces in N at gap changes `x` in m, `a` and `b` the squared voltages of the electrodes."""
        scale = pulses.EPSILON_0 * self.area / 2
        return scale * (a / (self.gap - x) ** 2 - b / (self.gap + x) ** 2) - self.bias_stiffness * x

    def rest_force(self, a, b):
        """The same with gaps as at rest."""
        return pulses.EPSILON_0 * self.area / (2 * self.gap**2) * (a - b)

    def modes(self):
        """(s, V, V^-1) of the state matrix (thesis, equation 16)."""
        if self._modes is None:
            values, vectors = np.linalg.eig(self.state)
            self._modes = values, vectors, np.linalg.pinv(vectors)
        return self._modes

    def slowest(self):
        """The longest time constant in s of a pole."""
        return float(1 / max(np.min(-self.modes()[0].real), 1e-9))

    @property
    def defective(self):
        """Whether poles coincide, as those of a rigid motion do, so that their eigenvectors do not span the states."""
        poles, vectors, inverse = self.modes()
        return not np.allclose((vectors * poles) @ inverse, self.state, rtol=0, atol=1e-7 * np.abs(self.state).max())

    def acceleration(self, states, forces):
        """Of the points, for rows of states and forces."""
        return (states @ self.accelerate.T + forces @ self.push.T) @ self.points.T


# Parts of a time constant after which the force between two times is not straight enough, and time constants for which that matters.
PANEL, PANELS = 0.5, 20


class _Charging:
    """Voltages of electrodes behind resistors, marched from edge to edge: up to the rail while a window lasts, kept for the delay, down
    after it. Edges are those of windows, the ends of delays, and more where voltages change."""

    def __init__(self, windows_, count, times):
        edges = []
        for window in windows_:
            rise, hold, fall = times[window.actuator]
            steps = PANEL * np.arange(1, PANELS + 1)
            inside = window.on + rise * steps
            edges += [window.on, window.off, window.off + hold, *inside[inside < window.off], *(window.off + hold + fall * steps)]
        self.edges = np.unique(edges)
        # An edge that is nearer to the one before than 1e-12 s is the same.
        self.edges = self.edges[np.concatenate([[True], np.diff(self.edges) > 1e-12])]
        shape = (len(self.edges) + 1, 2, count)
        # Where each electrode goes to in an interval, with which time constant, and where it begins.
        self.target, self.begin = np.zeros(shape), np.zeros(shape)
        self.constant = np.broadcast_to([fall for _, _, fall in times], shape).copy()
        for window in windows_:
            rise, hold, _ = times[window.actuator]
            first, last, free = np.searchsorted(self.edges, np.array([window.on, window.off, window.off + hold]) - 1e-12) + 1
            place = 0 if window.sign > 0 else 1
            self.target[first:last, place, window.actuator] = window.voltage_v
            self.constant[first:last, place, window.actuator] = rise
            self.constant[last:free, place, window.actuator] = np.inf
        for k in range(1, len(self.edges)):
            self.begin[k + 1] = self._later(k, self.edges[k] - self.edges[k - 1])

    def _later(self, interval, length):
        target, constant = self.target[interval], self.constant[interval]
        safe = np.where(constant > 0, constant, 1.0)
        left = np.where(constant > 0, np.exp(-length / safe), 0.0 if length > 0 else 1.0)
        return target + (self.begin[interval] - target) * left

    def squares(self, interval, time):
        """Of electrodes A and of electrodes B."""
        if interval == 0:
            return np.zeros(self.begin.shape[2]), np.zeros(self.begin.shape[2])
        a, b = self._later(interval, max(time - self.edges[interval - 1], 0.0))
        return a**2, b**2


class Voltages:
    """Squared voltages on all electrodes: without resistors constant between edges but for rails that rise."""

    def __init__(self, windows_, count, rise_v_per_s=None, times=None):
        """`times`: of every actuator, as `Actuator.times`; None where all electrodes charge at once."""
        self._rise, self._charging = rise_v_per_s, None
        if times is not None and any(rise > 0 for rise, _, _ in times):
            self._charging = _Charging(windows_, count, times)
            self.edges = self._charging.edges
            return
        self.edges = np.unique([edge for window in windows_ for edge in (window.on, window.off)])
        self._a = np.zeros((len(self.edges) + 1, count))
        self._b = np.zeros((len(self.edges) + 1, count))
        for window in windows_:
            first, last = np.searchsorted(self.edges, [window.on, window.off]) + 1
            (self._a if window.sign > 0 else self._b)[first:last, window.actuator] = window.voltage_v**2

    def at(self, interval, time):
        """On the `interval`-th stretch between edges, at a time within it. A rail that rises limits the voltage; electrodes behind
        resistors follow it within a part of a ms."""
        a, b = self._charging.squares(interval, time) if self._charging else (self._a[interval], self._b[interval])
        if self._rise is None or time * self._rise > 1e4:
            return a, b
        limit = (self._rise * time) ** 2
        return np.minimum(a, limit), np.minimum(b, limit)

    def interval(self, time):
        """The stretch in which a time lies."""
        return int(np.searchsorted(self.edges, time, side="right"))


def _harmonics(system, drives):
    """Of even drives with gaps at rest, fundamentals and harmonics up to the ninth: angular frequency, force in N and phasor of
    the coordinates for every drive and order, of the cosine series of pulses that have A's in the middle of phase 0."""
    for drive in drives:
        electrode = pulses.EPSILON_0 * system.area[drive.actuator] * drive.voltage_v**2 / (2 * system.gap[drive.actuator] ** 2)
        for n in range(1, 10, 2):
            own = pulses.coefficient(system.times[drive.actuator], drive.frequency_hz, drive.pulse_width, n)
            force = electrode * own * np.exp(1j * n * drive.phase_rad)
            phasor = system.steady([n * drive.frequency_hz])[0][:, drive.actuator] * force
            yield 2 * np.pi * n * drive.frequency_hz, drive.actuator, force, phasor


def steady_start(system, drives):
    """State of the steady motion at 0 under even drives with gaps at rest."""
    state = np.zeros(2 * system.size)
    for omega, _, _, phasor in _harmonics(system, drives):
        state += np.concatenate([phasor.real, (1j * omega * phasor).real])
    return state


def travel_if_all_meet(system, drives):
    """Travel of every mass in m if all amplitudes of `_harmonics` met at an instant, which those of one drive need not ever do."""
    changes = (np.abs(system.gaps @ phasor + system.gaps_rest[:, actuator] * force) for _, actuator, force, phasor in _harmonics(system, drives))
    return sum(changes, np.zeros(len(system.gap)))


@dataclass
class Motion:
    """A record: times in s, gap changes in m (rows of times), accelerations of the points in m/s^2 by the modes alone, the last state, and the
    forces of the ERAs in N."""

    time: np.ndarray
    gap_change: np.ndarray
    acceleration: np.ndarray
    state: np.ndarray
    pulled_in: bool
    force: np.ndarray


def integrate_linear(system, drives, times, tolerance=1e-9):
    """Displacement in m and acceleration in m/s^2 of the points, [time, point], from rest at 0 under forces
    amplitude cos(2 pi f t + phase), `drives` (actuator, f in Hz, amplitude in N, phase in rad); by DOP853."""
    size = system.size
    number, hz, newton, phase = (np.array(column) for column in zip(*drives))
    share = np.zeros((len(drives), system.force.shape[1]))
    share[np.arange(len(drives)), number] = newton
    omega = 2 * np.pi * hz
    force = lambda t: np.cos(omega * t + phase) @ share
    slope = lambda t, z: system.state @ z + system.input @ force(t)
    # Relative to the largest of a coordinate: the steady displacement that a mode of the drive's frequency would have.
    absolute = tolerance * np.abs(system.push).max() * newton.max() / omega.max() ** 2
    scale = np.concatenate([np.full(size, absolute), np.full(size, absolute * omega.max())])
    solution = solve_ivp(slope, (times[0], times[-1]), np.zeros(2 * size), "DOP853", t_eval=times, rtol=tolerance, atol=scale)
    states = solution.y.T
    forces = np.cos(np.outer(times, omega) + phase) @ share
    displacement, acceleration = states[:, :size] @ system.points.T, system.acceleration(states, forces)
    # What is above the modes follows at once, as it does in the steady state.
    rest = system.points_rest(hz)[np.arange(len(drives)), :, number] * (newton * np.exp(1j * phase))[:, None]
    turning = np.exp(1j * np.outer(times, omega))
    return displacement + (turning @ rest).real, acceleration - (turning @ (rest * omega[:, None] ** 2)).real


def steady_acceleration(system, drives):
    """Phasors of the points' acceleration in m/s^2 under the same drives, in time's damping: frequency -> [point]."""
    result = {}
    for number, hz, newton, phase in drives:
        rows = system.points @ system.steady([hz])[0] + system.points_rest([hz])[0]
        result[hz] = result.get(hz, 0) - (2 * np.pi * hz) ** 2 * rows[:, number] * newton * np.exp(1j * phase)
    return result


def integrate(system, voltages, seconds, step, start=None, begin=0.0, moving=True):
    """From `begin` on for `seconds`, sampled every `step`. The linear part is exact; the force is taken as straight in time
    over each part of a step between two edges, found by one predictor and one corrector (exponential Runge-Kutta of second
    order, Cox and Matthews 2002, equation 22).

    `moving` false: forces as with gaps at rest. A gap that closes by nine tenths ends the record (`pulled_in`).
    """
    poles, vectors, inverse = system.modes()
    inputs = inverse @ system.input
    to_gap = system.gaps @ vectors[: system.size]
    force = system.electrode_force if moving else (lambda a, b, x: system.rest_force(a, b))
    y = inverse @ (np.zeros(2 * system.size) if start is None else start)
    count = int(round(seconds / step))
    times = begin + step * np.arange(count + 1)
    inside = voltages.edges[(voltages.edges > begin) & (voltages.edges < times[-1])]
    nodes = np.union1d(times, inside)
    # Edges nearer than a picosecond to a sample are the sample's.
    nodes = nodes[np.concatenate([[True], np.diff(nodes) > 1e-12])]
    sampled = np.searchsorted(nodes, times - 1e-12)

    states = np.empty((len(nodes), 2 * system.size), complex)
    forces = np.empty((len(nodes), len(system.gap)))
    x = (to_gap @ y).real
    now = force(*voltages.at(voltages.interval(begin + 1e-12), begin), x)
    states[0], forces[0] = y, now
    pulled_in, kept = False, {}
    for index in range(1, len(nodes)):
        t, h = nodes[index - 1], nodes[index] - nodes[index - 1]
        key = round(h * 1e12)
        if key not in kept:
            z = poles * h
            small = np.abs(z) < 1e-5
            safe = np.where(small, 1, z)
            first = np.where(small, 1 + z / 2, np.expm1(safe) / safe)
            second = np.where(small, 0.5 + z / 6, (np.expm1(safe) - safe) / safe**2)
            entry = np.exp(z), h * first, h * second
            if abs(h - step) < 1e-12:
                kept[key] = entry
        else:
            entry = kept[key]
        growth, first, second = entry
        interval = voltages.interval(t + h / 2)
        a0, b0 = voltages.at(interval, t)
        a1, b1 = voltages.at(interval, nodes[index])
        begun = force(a0, b0, x)
        base = growth * y + first * (inputs @ begun)
        guess = force(a1, b1, (to_gap @ base).real)
        y = base + second * (inputs @ (guess - begun))
        x = (to_gap @ y).real
        now = force(a1, b1, x)
        states[index], forces[index] = y, now
        if np.any(np.abs(x) > 0.9 * system.gap):
            pulled_in = True
            states, forces, sampled = states[: index + 1], forces[: index + 1], sampled[sampled <= index]
            break
    rows = (states[sampled] @ vectors.T).real
    return Motion(
        nodes[sampled],
        rows[:, : system.size] @ system.gaps.T + forces[sampled] @ system.gaps_rest.T,
        system.acceleration(rows, forces[sampled]),
        rows[-1],
        pulled_in,
        forces[sampled],
    )


def integrate_scipy(system, voltages, seconds, step, start=None, begin=0.0, moving=True, tolerance=1e-9):
    """The same by SciPy's DOP853 (Hairer, Norsett and Wanner 1993) from edge to edge."""
    force = system.electrode_force if moving else (lambda a, b, x: system.rest_force(a, b))
    size = system.size
    count = int(round(seconds / step))
    times = begin + step * np.arange(count + 1)
    inside = voltages.edges[(voltages.edges > begin + 1e-12) & (voltages.edges < times[-1] - 1e-12)]
    stops = np.concatenate([[begin], inside, [times[-1]]])
    state = np.zeros(2 * size) if start is None else np.array(start, float)
    # Absolute tolerance: of a travel of a thousandth of the gap, and the velocity that goes with it at 100 Hz.
    scale = float(np.min(system.gap)) * 1e-3 / max(1e-9, float(np.max(np.abs(system.gaps))))
    absolute = tolerance * np.concatenate([np.full(size, scale), np.full(size, scale * 2 * np.pi * 100)])
    rows, forces = np.empty((count + 1, 2 * size)), np.empty((count + 1, len(system.gap)))
    for left, right in zip(stops, stops[1:]):
        interval = voltages.interval((left + right) / 2)

        def slope(t, y):
            return system.state @ y + system.input @ force(*voltages.at(interval, t), system.gaps @ y[:size])

        wanted = np.nonzero((times >= left - 1e-12) & (times <= right + 1e-12))[0]
        solution = solve_ivp(slope, (left, right), state, "DOP853", rtol=tolerance, atol=absolute, dense_output=len(wanted) > 0)
        for index in wanted:
            rows[index] = solution.sol(min(max(times[index], left), right))
            forces[index] = force(*voltages.at(interval, times[index]), system.gaps @ rows[index, :size])
        state = solution.y[:, -1]
    return Motion(times, rows[:, :size] @ system.gaps.T + forces @ system.gaps_rest.T, system.acceleration(rows, forces), state, False, forces)


def amplitudes(time, record, frequencies):
    """Amplitudes of sines at these frequencies in a record (rows of times), by weighted least squares with a constant. The
    Blackman-Harris window (Harris 1978) keeps what is at other frequencies out, 92 dB below, from 4 lines away on."""
    columns = [np.ones_like(time)]
    for frequency in frequencies:
        columns += [np.cos(2 * np.pi * frequency * time), np.sin(2 * np.pi * frequency * time)]
    turn = 2 * np.pi * np.arange(len(time)) / (len(time) - 1)
    weight = 0.35875 - 0.48829 * np.cos(turn) + 0.14128 * np.cos(2 * turn) - 0.01168 * np.cos(3 * turn)
    root = np.sqrt(np.maximum(weight, 0))[:, None]
    found = np.linalg.lstsq(root * np.column_stack(columns), root * record.reshape(len(time), -1), rcond=None)[0]
    return np.hypot(found[1::2], found[2::2])
