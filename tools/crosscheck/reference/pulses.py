"""Electrode pulses of one ERA from its drive (contract, "Drive"): A and B are energised in turn, each for the fraction
`pulse_width` of its half period and centred in it, never both. The force's fundamental is cos(2 pi f t + phase), so the
middle of A's pulse is where that is 1, and the middle of B's half a period later.
"""

import math
from functools import lru_cache

import numpy as np

EPSILON_0 = 8.8541878128e-12
"""Permittivity of the vacuum in F/m (CODATA 2018)."""
GUARD_S = 200e-6
"""Least time between two pulses with both electrodes off (docs/src/safety.md, "Limits")."""


def rest_force(area_m2, gap_m, voltage_v):
    """Force in N of one electrode on a mass at rest: eps0 S V^2 / (2 g^2)."""
    return EPSILON_0 * area_m2 * voltage_v**2 / (2 * gap_m**2)


def middles(frequency_hz, phase_rad, start_s, end_s):
    """(time of the middle, sign) of every pulse that may reach into the interval: +1 of A, -1 of B."""
    # 2 pi f t + phase = pi k has an A for even k, a B for odd k.
    first = math.floor(2 * frequency_hz * start_s + phase_rad / math.pi) - 1
    last = math.ceil(2 * frequency_hz * end_s + phase_rad / math.pi) + 1
    return [((k - phase_rad / math.pi) / (2 * frequency_hz), 1 if k % 2 == 0 else -1) for k in range(first, last + 1)]


def pulses(frequency_hz, pulse_width, phase_rad, start_s, end_s):
    """(on, off, sign) of every pulse within the interval, cut to it, in order."""
    half = pulse_width / (4 * frequency_hz)
    cut = [(max(at - half, start_s), min(at + half, end_s), sign) for at, sign in middles(frequency_hz, phase_rad, start_s, end_s)]
    return [(on, off, sign) for on, off, sign in cut if off > on]


def guard(frequency_hz, pulse_width):
    """Time in s between two pulses with both electrodes off."""
    return (1 - pulse_width) / (2 * frequency_hz)


def harmonic(frequency_hz, pulse_width, order, points=24):
    """Amplitude of the force's harmonic per N of one electrode's force: Fourier's integral over one period, by
    Gauss-Legendre quadrature over the two pulses. 24 points integrate cos over +-order pi / 2 to 1e-15 up to order 9;
    more are taken above that."""
    node, weight = np.polynomial.legendre.leggauss(points + 2 * order)
    period = 1 / frequency_hz
    total = 0.0
    # Half a pulse before 0 belongs to the period as well: begin where both are off.
    begin = -period / 4
    for on, off, sign in pulses(frequency_hz, pulse_width, 0.0, begin, begin + period):
        t = on + (off - on) * (node + 1) / 2
        total += sign * float(np.sum(weight * np.cos(2 * np.pi * order * frequency_hz * t))) * (off - on) / 2
    return abs(2 / period * total)


# An electrode's voltage is known when it repeats from period to period to this part of the rail's.
REPEATS = 1e-13
# Time constants after which nothing changes any more; then no finer panels are needed.
SETTLED = 30
# Parts of a period that a panel is at most: the 25th harmonic turns by 0.4 in it.
LEAST_PANELS = 64


def follow(voltage, target, time_constant, time):
    """Voltage over the rail's after some time towards a target; time may be an array."""
    if time_constant <= 0:
        return np.where(np.asarray(time) > 0, target, voltage)
    return target + (voltage - target) * np.exp(-np.asarray(time) / time_constant)


def begin_voltage(times, frequency_hz, pulse_width):
    """Voltage over the rail's at the beginning of a window: marched from rest, window by window, until it repeats."""
    rise, hold, fall = times
    window = pulse_width / frequency_hz / 2
    begin, before = 0.0, -1.0
    while abs(begin - before) > REPEATS:
        before = begin
        begin = float(follow(follow(begin, 1.0, rise, window), 0.0, fall, 1 / frequency_hz - window - hold))
    return begin


def voltage_at(times, frequency_hz, pulse_width, begin, time):
    """Voltage over the rail's at a time, up to a period, from the window's beginning, where it is `begin`: up while the upper switch is
    on, kept while neither is, down while the lower one is."""
    rise, hold, fall = times
    window = pulse_width / frequency_hz / 2
    if time <= window:
        return float(follow(begin, 1.0, rise, time))
    end = float(follow(begin, 1.0, rise, window))
    return float(follow(end, 0.0, fall, max(0.0, time - window - hold)))


@lru_cache(maxsize=4096)
def electrode(times, frequency_hz, pulse_width):
    """(time, weight, squared voltage over the rail's) of electrode A at the points of a quadrature over one period; times from the middle of
    its window."""
    rise, hold, fall = times
    period = 1 / frequency_hz
    window = pulse_width * period / 2
    pieces = [(window, 1.0, rise), (hold, None, np.inf), (period - window - hold, 0.0, fall)]
    begin = begin_voltage(times, frequency_hz, pulse_width)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    found, voltage, at = [], begin, -window / 2
    for length, target, constant in pieces:
        edges = [0.0]
        while length > 0 and edges[-1] < length * (1 - 1e-12):
            step = period / LEAST_PANELS
            if target is not None and edges[-1] < SETTLED * constant:
                step = min(step, constant / 2)
            edges.append(min(edges[-1] + step, length))
        for left, right in zip(edges, edges[1:]):
            time = left + (right - left) * (nodes + 1) / 2
            own = np.full(len(time), voltage) if target is None else follow(voltage, target, constant, time)
            found.append((at + time, weights * (right - left) / 2, own**2))
        voltage = voltage if target is None else float(follow(voltage, target, constant, length))
        at += length
    return tuple(np.concatenate(column) for column in zip(*found))


def coefficient(times, frequency_hz, pulse_width, order):
    """Complex amplitude of the force's harmonic per N of one electrode's steady force, time from the middle of A's window: Fourier's
    integral of v_A^2 - v_B^2 over a period, B half a period after A. `times` as `Actuator.times`; without resistors the contract's law."""
    if times[0] <= 0:
        return complex(4 / (order * np.pi) * np.sin(order * np.pi * pulse_width / 2))
    time, weight, square = electrode(tuple(times), float(frequency_hz), float(pulse_width))
    omega = 2 * np.pi * order * frequency_hz
    both = np.exp(-1j * omega * time) - np.exp(-1j * omega * (time + 0.5 / frequency_hz))
    return complex(2 * frequency_hz * np.sum(weight * square * both))


def both_on(frequency_hz, pulse_width, phase_rad, seconds=1.0):
    """Least time in s between the end of a pulse and the beginning of the next; negative: both electrodes on at once."""
    list_ = pulses(frequency_hz, pulse_width, phase_rad, 0.0, seconds)
    return min((after[0] - before[1] for before, after in zip(list_, list_[1:])), default=math.inf)
