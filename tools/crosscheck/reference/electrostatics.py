"""Electrodes: the force law of the contract, breakdown of air, charge, and the steady motion in gaps that close.

Sign of a gap's change: positive where electrode A, whose pull is the positive force, comes nearer. A static force therefore
changes its own gap by a positive amount.
"""

from itertools import product

import numpy as np
from . import pulses
from .scene import VACUUM_PERMITTIVITY_F_PER_M

# Least time between one electrode's pulse and the other's (docs/src/safety.md, "guard time").
GUARD_TIME_S = 200e-6
# Part of the breakdown voltage, and of the gap, that may be used (docs/src/planner.md, "Limits").
BREAKDOWN_PART = 0.85
TRAVEL_PART = 1 / 3
# Mean current that the board's supply delivers (docs/src/safety.md, "average current").
SUPPLY_A = 0.5e-3


def coefficients(actuator, pulse_width, frequency_hz, harmonic):
    """`pulses.coefficient` of an actuator's electrodes; widths and frequencies may be arrays that fit each other."""
    own = np.frompyfunc(lambda width, hz: pulses.coefficient(actuator.times, hz, width, harmonic), 2, 1)
    return np.asarray(own(pulse_width, frequency_hz), dtype=complex)


def force_amplitude(actuator, voltage_v, pulse_width, frequency_hz, harmonic=1):
    """Amplitude in N of an odd harmonic of the force with the mass at rest (contract, "Drive")."""
    if actuator.times[0] > 0:
        return actuator.force(voltage_v) * np.abs(coefficients(actuator, pulse_width, frequency_hz, harmonic))
    angle = harmonic * np.pi * pulse_width / 2
    return 4 / (harmonic * np.pi) * actuator.force(voltage_v) * np.abs(np.sin(angle))


def harmonic_ratio(actuator, pulse_width, frequency_hz, harmonic):
    """Amplitude of an odd harmonic over that of the fundamental."""
    if actuator.times[0] > 0:
        return np.abs(coefficients(actuator, pulse_width, frequency_hz, harmonic) / coefficients(actuator, pulse_width, frequency_hz, 1))
    return np.abs(np.sin(harmonic * np.pi * pulse_width / 2) / np.sin(np.pi * pulse_width / 2)) / harmonic


def widest_pulse(frequency_hz):
    """Widest pulse, as a part of the half period, that leaves the guard time between the electrodes."""
    return 1 - 2 * frequency_hz * GUARD_TIME_S


def breakdown_v(gap_m):
    """Breakdown voltage of an air gap: 24.22 d + 6.08 sqrt(d) kV, d in cm (the engineering fit of Paschen's curve)."""
    gap_cm = np.maximum(gap_m, 0.0) * 100
    return 1e3 * (24.22 * gap_cm + 6.08 * np.sqrt(gap_cm))


def _lattice(dimensions):
    """Points on a torus of some dimensions, in radians: a Korobov lattice, exact for low orders."""
    if dimensions == 0:
        return np.zeros((1, 0))
    if dimensions == 1:
        return 2 * np.pi * np.arange(24)[:, None] / 24
    points, generator = (89, 55) if dimensions == 2 else (307, 75)
    steps = np.array([pow(generator, k, points) for k in range(dimensions)])
    return 2 * np.pi * ((np.arange(points)[:, None] * steps) % points) / points


class MovingGaps:
    """Steady motion of drives whose forces grow as their gaps close: harmonic balance.

    The frequencies are taken as incommensurate, so time averages are averages over the torus of their phases. The gaps move
    at the fundamentals and at odd harmonics. Fundamentals are found by Newton's method with the harmonics fixed; then the
    forces' harmonics with the gaps as they move, and again until both stand still. The force on every mass
    is that of the window of its electrodes and of the gap of that moment,
    eps0 A / 2 (V_A^2 / (g - x)^2 - V_B^2 / (g + x)^2); what a bias already took from the springs is given back.
    """

    def __init__(self, actuators, hz, drive_frequency, drives, gap_change, harmonic_gap_change):
        """`hz`: the distinct frequencies. `drive_frequency[i]`: index into them, or None where actuator i is not driven.

        `drives[i]`: (voltage, pulse width, phase). `gap_change` [frequency, loaded, actuator] at the fundamentals;
        `harmonic_gap_change`: {harmonic: the same at that multiple}.
        """
        self.actuators = actuators
        self.hz, self.frequencies = hz, len(hz)
        self.index = drive_frequency
        self.drives = drives
        self.gap_change = gap_change
        self.harmonics = harmonic_gap_change
        self.nodes = [self._nodes(i) for i in range(len(actuators))]
        self.still = self._harmonics_at_rest()
        self._move_harmonics(self.still)

    def _nodes(self, i):
        """Where actuator i pulls: phasors e^(j theta) [point, frequency], weights, signs (+ electrode A, - B). None where it
        is not driven."""
        own = self.index[i]
        if own is None:
            return None
        _, pulse, phase = self.drives[i]
        others = _lattice(self.frequencies - 1)
        phases, all_weights, signs = [], [], []
        for sign, centre in ((1.0, 0.0), (-1.0, np.pi)):
            for angle, weight in self._angles(i):
                # A window of electrode A has its middle at theta = -phase.
                phases.append(np.insert(others, own, centre - phase + angle, axis=1))
                all_weights.append(np.full(len(others), weight / len(others)))
                signs.append(np.full(len(others), sign))
        turns = np.exp(1j * np.concatenate(phases))
        return turns, np.concatenate(all_weights), np.concatenate(signs)

    def _angles(self, i):
        """(angle from the middle of A's window, weight of a mean over the period, with the squared voltage over the rail's)."""
        _, pulse, _ = self.drives[i]
        times = self.actuators[i].times
        nodes, weights = np.polynomial.legendre.leggauss(8)
        if times[0] <= 0:
            window = np.pi / 2 * pulse
            return [(window * node, weight * window / (2 * np.pi)) for node, weight in zip(nodes, weights)]
        # Where the voltage rises, where it stays and where it falls: points beyond these pull with less than 1e-8 of it.
        hz = self.hz[self.index[i]]
        rise, hold, fall = times
        width = pulse / hz / 2
        risen = min(width, 10 * rise)
        ends = [0.0, 0.25 * risen, risen, width + hold, *(width + hold + min(1 / hz - width - hold, 10 * fall) * part for part in (0.25, 1.0))]
        begin = pulses.begin_voltage(times, hz, pulse)
        found = []
        for left, right in zip(ends, ends[1:]):
            for node, weight in zip(nodes, weights):
                time = left + (right - left) * (node + 1) / 2
                square = pulses.voltage_at(times, hz, pulse, begin, time) ** 2
                found.append((2 * np.pi * hz * (time - width / 2), weight * (right - left) / 2 * hz * square))
        return found

    def _move_harmonics(self, forces):
        """Takes {(harmonic, actuator): complex amplitude of the force} for the ones that move the gaps: their changes at the
        points of `nodes`, and {(harmonic, frequency): complex amplitude} of every gap."""
        self.moved = [{} for _ in self.actuators]
        for (harmonic, loaded), force in forces.items():
            own = self.index[loaded]
            for i, moved in enumerate(self.moved):
                moved[harmonic, own] = moved.get((harmonic, own), 0) + force * self.harmonics[harmonic][own, loaded, i]
        self.changes = [
            None if nodes is None else sum((nodes[0][:, k] ** n * x for (n, k), x in moved.items()), np.zeros(len(nodes[0]))).real
            for nodes, moved in zip(self.nodes, self.moved)
        ]

    def _forces(self, motion, level):
        """Complex amplitudes [frequency, actuator] of the forces for a motion [frequency, actuator] of the gaps, and slopes.

        Slopes [actuator, 2, frequency, frequency]: of the amplitudes by real and imaginary part of the motion's.
        """
        forces = np.zeros((self.frequencies, len(self.actuators)), dtype=complex)
        slopes = np.zeros((len(self.actuators), 2, self.frequencies, self.frequencies), dtype=complex)
        for i, actuator in enumerate(self.actuators):
            if self.index[i] is not None:
                turns, weights, signs = self.nodes[i]
                pull, gap = self._pull(i, motion, level)
                forces[:, i] = 2 * (weights * signs * pull) @ turns.conj()
                steep = (2 * weights * 2 * pull / gap)[:, None] * turns.conj()
                slopes[i] = steep.T @ turns.real, -(steep.T @ turns.imag)
            forces[:, i] -= actuator.softening * motion[:, i]
            slopes[i] -= actuator.softening * np.multiply.outer([1, 1j], np.eye(self.frequencies))
        return forces, slopes

    def _pull(self, i, motion, level):
        """Force of the electrode that is on, in N, and its gap in m, at the points of `nodes`."""
        turns, _, signs = self.nodes[i]
        actuator = self.actuators[i]
        gap = actuator.air_gap - signs * ((turns @ motion[:, i]).real + level**2 * self.changes[i])
        volts = self.drives[i][0] * level
        return VACUUM_PERMITTIVITY_F_PER_M * actuator.electrode_area / 2 * volts**2 / gap**2, gap

    def _harmonics_at_rest(self):
        """{(harmonic, actuator): complex amplitude} of the forces on masses at rest."""
        rest = {}
        for harmonic, loaded in product(self.harmonics, range(len(self.actuators))):
            if self.index[loaded] is None:
                continue
            volts, pulse, phase = self.drives[loaded]
            # Without resistors the n-th harmonic of the pulse train is 4/(n pi) sin(n pi w / 2) cos(n theta).
            actuator = self.actuators[loaded]
            force = actuator.force(volts) * pulses.coefficient(actuator.times, self.hz[self.index[loaded]], pulse, harmonic)
            rest[harmonic, loaded] = force * np.exp(1j * harmonic * phase)
        return rest

    def _harmonics_moving(self, motion):
        """The same with the gaps as they move, each at multiples of its own drive."""
        found = {}
        for harmonic, i in self.still:
            turns, weights, signs = self.nodes[i]
            own = self.index[i]
            force = 2 * (weights * signs * self._pull(i, motion, 1.0)[0]) @ (turns[:, own].conj() ** harmonic)
            found[harmonic, i] = force - self.actuators[i].softening * self.moved[i][harmonic, own]
        return found

    def solve(self):
        """Forces and motions, both [frequency, actuator], of the branch that rising voltages lead to. None if there is none."""
        motion = self._fundamentals(np.zeros((self.frequencies, len(self.actuators)), dtype=complex), np.linspace(1 / 6, 1, 6))
        forces = self.still
        size = max((abs(force) for force in forces.values()), default=0.0)
        for _ in range(60):
            if motion is None:
                return None
            following = self._harmonics_moving(motion)
            if all(abs(following[key] - forces[key]) <= 1e-6 * size for key in forces):
                return self._forces(motion, 1.0)[0], motion
            # Half the way: a resonance at a harmonic may answer by more than it is asked.
            forces = {key: (forces[key] + following[key]) / 2 for key in forces}
            self._move_harmonics(forces)
            motion = self._fundamentals(motion, [1.0])
        return None

    def _fundamentals(self, motion, levels):
        """The motion [frequency, actuator] at parts `levels` of the voltages, one after the other, by Newton's method from
        `motion`. None if there is none."""
        count, actuators = self.frequencies, len(self.actuators)
        gaps = np.array([actuator.air_gap for actuator in self.actuators])
        identity = np.eye(count * actuators)
        for level in levels:
            for _ in range(30):
                forces, slopes = self._forces(motion, level)
                wrong = np.einsum("kl,kli->ki", forces, self.gap_change) - motion
                if np.abs(wrong / gaps).max() < 1e-10:
                    break
                # d wrong[k, i] / d (part of motion[m, l]) = gap_change[k, l, i] slopes[l, part, k, m], less the identity's.
                by_part = np.einsum("kli,lpkm->pkiml", self.gap_change, slopes).reshape(2, count * actuators, -1)
                real, imaginary = by_part[0] - identity, by_part[1] - 1j * identity
                matrix = np.block([[real.real, imaginary.real], [real.imag, imaginary.imag]])
                step = np.linalg.solve(matrix, -np.concatenate([wrong.real.ravel(), wrong.imag.ravel()]))
                step = (step[: count * actuators] + 1j * step[count * actuators :]).reshape(count, actuators)
                # A step that would close a gap is shortened.
                motion = motion + step * min(1.0, 0.3 / np.abs(step / gaps).max())
            else:
                return None
            if (np.abs(motion).sum(axis=0) >= gaps).any():
                return None
        return motion
