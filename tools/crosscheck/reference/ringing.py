"""When a target has most of its steady peak after switching on, and when it has decayed: the thesis' equation 19.

From rest, a force cos(w t + phase) moves a point by its steady phasor and by free motions c e^(s t), one for each pole s of
the panel. With poles of positive frequency only this is the analytic signal, and its modulus the running amplitude.
"""

import numpy as np
import scipy.linalg as la

from .rise import RESOLVED_HZ

# Poles above this follow any force at once: twice what the skin feels (docs/src/effects.md, "Rise and decay").
HIGHEST_HZ = 2000.0


class Ringing:
    """Poles of a panel in time, and what drives leave in them."""

    def __init__(self, time_model):
        """`time_model`: `Panel.time_model` with the target as its only point."""
        size = len(time_model["M"])
        inverse = np.linalg.inv(time_model["M"])
        matrix = np.block(
            [[np.zeros((size, size)), np.eye(size)], [-inverse @ time_model["K"], -inverse @ time_model["C"]]]
        )
        poles, right = la.eig(matrix)
        left = np.linalg.inv(right)
        # Acceleration at the point per force: s^2 times the displacement's residue.
        point = time_model["points"][0] @ right[:size]
        forces = left[:, size:] @ inverse @ time_model["forces"]
        keep = (poles.imag >= 0) & (np.abs(poles) <= 2 * np.pi * HIGHEST_HZ)
        self.poles = poles[keep]
        twice = np.where(self.poles.imag > 0, 2.0, 1.0)
        self.residues = (twice * self.poles**2 * point[keep])[:, None] * forces[keep]

    def free(self, actuator, frequency_hz, phase):
        """Coefficients c of the free motions for 1 N: residues times the force's Laplace transform at the poles."""
        omega = 2 * np.pi * frequency_hz
        force = (self.poles * np.cos(phase) - omega * np.sin(phase)) / (self.poles**2 + omega**2)
        return self.residues[:, actuator] * force

    def times_s(self, drives, steady, part_on, part_off, side):
        """(when the sum of the running amplitudes stays above `part_on` of the steady peak, when it stays below `part_off`).

        `steady`: complex phasors of the drives' accelerations. Drives of one frequency are one running amplitude. Poles above
        `RESOLVED_HZ` add all that they can where `side` is 1, so that it takes longer, and take it away where it is -1.
        """
        frequencies = sorted({drive.frequency for drive in drives})
        own = lambda values, frequency: [value for drive, value in zip(drives, values) if drive.frequency == frequency]
        peak = sum(abs(sum(own(steady, frequency))) for frequency in frequencies)
        free = {f: sum(d.force * self.free(d.actuator, f, d.phase) for d in own(drives, f)) for f in frequencies}
        # Until all free motion together is below a fiftieth of the peak; motions of a millionth are none.
        sizes = sum(np.abs(part) for part in free.values())
        counted = sizes > 1e-6 * peak
        end = 1e-3
        while end < 20.0 and (sizes * np.exp(self.poles.real * end))[counted].sum() > 0.02 * peak:
            end *= 1.5
        # Resolved poles beat with the drives at up to 1.2 kHz.
        time = np.arange(0.0, end, 1 / 10_000)
        rising, falling, unresolved = (np.zeros(len(time)) for _ in range(3))
        for frequency in frequencies:
            decaying = np.zeros(len(time), dtype=complex)
            for pole, coefficient in zip(self.poles[counted], free[frequency][counted]):
                if abs(pole) <= 2 * np.pi * RESOLVED_HZ:
                    decaying += coefficient * np.exp(pole * time)
                else:
                    unresolved += abs(coefficient) * np.exp(pole.real * time)
            forced = sum(own(steady, frequency)) * np.exp(2j * np.pi * frequency * time)
            rising += np.abs(forced + decaying)
            falling += np.abs(decaying)
        last = lambda wrong: time[np.nonzero(wrong)[0][-1]] if wrong.any() else 0.0
        return last(rising - side * unresolved < part_on * peak), last(falling + side * unresolved > part_off * peak)
