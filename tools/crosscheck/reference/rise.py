"""When a point has the steady motion of even drives, and when it has stopped (thesis, equations 16 to 21, by eigenvectors).

docs/src/effects.md, "Rise and decay": of the envelope, the sum over the frequencies of the running amplitude
|steady + sum over poles of c e^((s - j w) t)|; the poles are those with an imaginary part of 0 or above.
"""

import numpy as np

# Up to here the program has the panel's own poles: twice the 400 Hz of its drives. Above, a few stand for all that there are
# (docs/src/effects.md), and when those beat is not to be had from it.
RESOLVED_HZ = 800.0


def free_motions(system, drives):
    """For each drive (actuator, Hz, N): omega, phasor A of the first point's steady acceleration, poles s and coefficients c,
    so that from rest it is Re(A e^(j w t) + sum c e^(s t)) under a force cos(w t)."""
    poles, vectors, inverse = system.modes()
    out = system.points[0] @ vectors[: system.size]
    upper = poles.imag >= 0
    result = []
    for actuator, hz, newton in drives:
        omega = 2 * np.pi * hz
        into = inverse @ system.input[:, actuator]
        weight = out * into * poles**2
        # y' = s y + b cos(w t), y(0) = 0: half of each of e^(jwt) and e^(-jwt).
        free = -newton * weight / 2 * (1 / (1j * omega - poles) + 1 / (-1j * omega - poles))
        steady = -(omega**2) * (system.points[0] @ system.steady([hz])[0][:, actuator]) * newton
        # A pole and its conjugate together are twice the real part of one.
        twice = np.where(poles.imag > 1e-9, 2.0, 1.0)
        result.append((omega, steady, poles[upper], (free * twice)[upper]))
    return result


def envelopes(motions, times):
    """Envelope from the start, and after the end, at times in s after either, of resolved poles; and what the others can add
    or take, all meeting."""
    risen, left, unresolved = (np.zeros(len(times)) for _ in range(3))
    for omega, steady, poles, coefficients in motions:
        known = np.abs(poles) <= 2 * np.pi * RESOLVED_HZ
        free = np.exp(np.outer(times, poles[known] - 1j * omega)) @ coefficients[known]
        risen += np.abs(steady + free)
        left += np.abs(free)
        unresolved += np.exp(np.outer(times, poles[~known].real)) @ np.abs(coefficients[~known])
    return risen, left, unresolved


def last(times, outside):
    """The first time from which on nothing is outside any more; None if the last one still is."""
    found = np.nonzero(outside)[0]
    if len(found) == 0:
        return 0.0
    return None if found[-1] == len(times) - 1 else float(times[found[-1] + 1])
