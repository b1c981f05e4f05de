"""What an effect's segments do at a point, with gaps at rest: forces period by period, own modes stepped by SciPy.

docs/src/effects.md and docs/src/protocol.md: levels change at boundaries of the drive's periods, where the fundamental is a
sine at zero; a period of a ramp has the level of its middle; a level is made by a narrower window. Odd harmonics up to 1 kHz
count. Every channel begins at the first boundary of its own period after the common start, so that its delay is any part
of a period.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import qmc

from . import pulses

HIGHEST_HZ = 1000.0


def levels(segments, times, period_s):
    """The level of every period from the first boundary on."""
    lengths = [segment["cycles"] * period_s if "cycles" in segment else segment["duration_ms"] * 1e-3 for segment in segments]
    ends = np.cumsum(lengths)
    result, index = [], 0
    while True:
        at = index * period_s
        # A boundary that falls on an end, but for rounding, is beyond it.
        turn = int((at + 1e-9) / ends[-1])
        if turn >= times:
            return result
        at = max(at - turn * ends[-1], 0.0)
        place = int(np.searchsorted(ends, at + 1e-9, side="right"))
        segment = segments[place]
        if "from_level" in segment:
            part = min((at - (ends[place] - lengths[place]) + period_s / 2) / lengths[place], 1.0)
            result.append(segment["from_level"] + part * (segment["to_level"] - segment["from_level"]))
        else:
            result.append(segment["level"])
        index += 1


def width(level, pulse_width):
    """The window that makes a level of a drive's fundamental: it goes with sin(pi w / 2)."""
    return 2 / np.pi * np.arcsin(abs(level) * np.sin(np.pi * pulse_width / 2))


class Force:
    """One drive's force over time in N, from its first boundary on; `electrode_n` is one electrode's at full level, `times` those of
    electrodes behind resistors, as `Actuator.times`. What such an electrode has left of a window beyond its period is left out."""

    def __init__(self, frequency_hz, pulse_width, electrode_n, levels_, times=(0.0, 0.0, 0.0)):
        self.frequency_hz, self.levels = frequency_hz, levels_
        self.period_s = 1 / frequency_hz
        self.orders = [n for n in range(1, 60, 2) if n == 1 or n * frequency_hz <= HIGHEST_HZ]
        self.table = np.array([[self._amplitude(level, pulse_width, n, times) * electrode_n for n in self.orders] for level in levels_])

    def _amplitude(self, level, pulse_width, n, times):
        """Complex amplitude of e^(j n 2 pi f t), t from a boundary: A's pulse in the middle of the first half, B's of the second. Rounded, as
        ramps have a level for every period."""
        if level == 0:
            return 0.0
        own = pulses.coefficient(times, self.frequency_hz, round(float(width(level, pulse_width)), 9), n)
        return np.sign(level) * own * np.exp(-1j * n * np.pi / 2)

    @property
    def end_s(self):
        """The end of the last period."""
        return len(self.levels) * self.period_s

    def at(self, index, time):
        """In the `index`-th period."""
        if index >= len(self.levels):
            return 0.0
        phase = 2 * np.pi * self.frequency_hz * (time - index * self.period_s)
        return sum((b * np.exp(1j * n * phase)).real for n, b in zip(self.orders, self.table[index]))

    def second(self, times):
        """Second derivative of the force."""
        index = np.minimum((times / self.period_s + 1e-9).astype(int), len(self.levels))
        table = np.vstack([self.table, np.zeros(len(self.orders))])[index]
        omega = 2 * np.pi * self.frequency_hz * np.array(self.orders)
        return -np.sum((table * np.exp(1j * np.outer(times, omega))).real * omega**2, axis=1)


def response(system, actuator, force, seconds, step, tolerance=1e-7):
    """Acceleration of the system's first point in m/s^2 every `step` under one drive's force. What modes above the system's add
    is taken as it is at the drive's frequency."""
    size, times = system.size, np.arange(int(round(seconds / step)) + 1) * step
    column = system.input[:, actuator]
    scale = np.abs(system.push[:, actuator]).max() * np.abs(force.table).max() / (2 * np.pi * force.frequency_hz) ** 2
    absolute = tolerance * scale * np.concatenate([np.ones(size), np.full(size, 2 * np.pi * force.frequency_hz)])
    state, result = np.zeros(2 * size), np.zeros(len(times))
    edges = [*(np.arange(len(force.levels) + 1) * force.period_s), seconds]
    edges = [edge for edge in edges if edge <= seconds]
    for index, (left, right) in enumerate(zip(edges, edges[1:])):
        if right - left < 1e-12:
            continue
        wanted = np.nonzero((times >= left - 1e-12) & (times < right - 1e-12))[0]
        slope = lambda t, z: system.state @ z + column * force.at(index, t)
        inside = np.clip(times[wanted], left, right)
        asked = np.union1d(inside, [right])
        solution = solve_ivp(slope, (left, right), state, "DOP853", t_eval=asked, rtol=tolerance, atol=absolute)
        state = solution.y[:, -1]
        if len(wanted):
            rows = solution.y[:, np.searchsorted(asked, inside)].T
            forces = np.array([force.at(index, t) for t in inside])
            result[wanted] = rows @ (system.accelerate.T @ system.points[0]) + forces * (system.points[0] @ system.push[:, actuator])
    rest = system.points_rest([force.frequency_hz])[0, 0, actuator].real
    return result + rest * force.second(times)


def peaks(signals, periods_s, step, count=1024):
    """(mean, least, most) of the largest acceleration over delays of the signals by parts of their periods, quasi-random
    ones (Sobol). Of 128 the mean is as good, but the most 4 % lower, where effects are as short as some periods."""
    delays = qmc.Sobol(len(signals), scramble=False).random(count) * np.array(periods_s)
    found = []
    for row in delays:
        total = np.zeros(len(signals[0]))
        for signal, delay in zip(signals, row):
            shift = int(round(delay / step))
            total[shift:] += signal[: len(signal) - shift]
        found.append(np.abs(total).max())
    return float(np.mean(found)), min(found), max(found)
