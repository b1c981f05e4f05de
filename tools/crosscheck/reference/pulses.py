"""Electrode pulses of one ERA from its drive (contract, "Drive"): A and B are energised in turn, each for the fraction
`pulse_width` of its half period and centred in it, never both. The force's fundamental is cos(2 pi f t + phase), so the
middle of A's pulse is where that is 1, and the middle of B's half a period later.
"""

import math

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


def both_on(frequency_hz, pulse_width, phase_rad, seconds=1.0):
    """Least time in s between the end of a pulse and the beginning of the next; negative: both electrodes on at once."""
    list_ = pulses(frequency_hz, pulse_width, phase_rad, 0.0, seconds)
    return min((after[0] - before[1] for before, after in zip(list_, list_[1:])), default=math.inf)
