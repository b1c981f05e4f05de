"""What a plan does, from its drives alone, and the best plan that there is, by trying all of them.

Written from the contract (shapes and meanings of printed figures), the thesis (equation 23) and the chapter on the planner.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np

from . import pulses
from .electrostatics import (
    BREAKDOWN_PART,
    SUPPLY_A,
    TRAVEL_PART,
    MovingGaps,
    breakdown_v,
    force_amplitude,
    harmonic_ratio,
    widest_pulse,
)
from .perception import STANDARD_GRAVITY_M_S2, above_threshold_db
from .press import softening_growth
from .scene import VACUUM_PERMITTIVITY_F_PER_M
from .surface import Surface

HARMONICS_UP_TO_HZ = 1000.0
LEAST_DISTANCE_HZ = 20.0
GRID_HZ = np.arange(40.0, 401.0)
# What plans choose pulse widths from (docs/src/planner-internals.md, "The plan table"): without a third harmonic, least of all together, without
# a fifth, without a seventh; and the widest, which leaves this time between the electrodes and is never wider than this.
DROPPING = np.array([2 / 3, 0.72, 0.8, 6 / 7])
PLANNED_GUARD_S, WIDEST = 220e-6, 0.96
# What the board counts for each electrode, and what its two bleeders take from a rail (docs/src/safety.md, "Known limits", "Supply").
BOARD_CHARGES_F, RAIL_BLEEDER_OHM = 116e-12, 50e6


def odd_harmonics(frequency_hz):
    """3, 5, ... as far as the multiple is at most 1 kHz."""
    return range(3, int(HARMONICS_UP_TO_HZ / frequency_hz + 1e-9) + 1, 2)


@dataclass(frozen=True)
class Drive:
    """One actuator's drive as a plan prints it; `actuator` is an index into the scene's. `phase` is that of the windows, `force_phase` that
    of the force's fundamental, which is worked out here and not taken from the plan."""

    actuator: int
    frequency: float
    voltage: float
    pulse_width: float
    phase: float
    force: float
    force_phase: float


def drives_of(scene, printed):
    """The drives of a printed plan."""
    index = {actuator.id: i for i, actuator in enumerate(scene.actuators)}
    keys = ("frequency_hz", "voltage_v", "pulse_width", "phase_rad", "force_n")
    found = []
    for drive in printed:
        number = index[drive["actuator"]]
        frequency, voltage, width, phase, force = (float(drive[key]) for key in keys)
        own = pulses.coefficient(scene.actuators[number].times, frequency, width, 1) if width > 0 else 1.0
        found.append(Drive(number, frequency, voltage, width, phase, force, phase + float(np.angle(own))))
    return found


class Responses:
    """Receptances of a reduced model at some frequencies, for 1 N at each actuator: solved once, asked for many points."""

    def __init__(self, model, frequencies_hz):
        self.model = model
        self.frequencies = np.asarray(frequencies_hz, dtype=float)
        solved = model.solve(self.frequencies, model.forces)
        # Positive towards electrode A, whose pull is the positive force: on an inertial ERA's mass it acts backwards.
        signs = np.array([-1.0 if actuator.inertial else 1.0 for actuator in model.scene.actuators])
        self.gap_change = np.einsum("an,fnk->fka", signs[:, None] * model.gaps, solved)
        self.accelerations = -((2 * np.pi * self.frequencies)[:, None, None] ** 2) * solved

    def at(self, points):
        """Accelerations in m/s^2/N: [frequency, actuator, point]."""
        points = np.asarray(points)
        rows = self.model.output_rows(points)
        return np.einsum("pn,fnk->fkp", rows, self.accelerations, optimize=True) * self.model.lags(points)

    def integral(self, points, weights):
        """Weighted sum of |acceleration|^2 over points, per N^2: [frequency, actuator]."""
        rows = self.model.output_rows(points)
        gram = (rows * weights[:, None]).T @ rows
        return np.einsum("fnk,nm,fmk->fk", self.accelerations.conj(), gram, self.accelerations, optimize=True).real


class Motion:
    """Fields, peaks and gaps of a set of steady drives."""

    def __init__(self, model, drives, surface=None):
        self.scene, self.model = model.scene, model
        self.surface = surface or Surface(model.scene)
        self.drives = [drive for drive in drives if drive.force > 0]
        self.frequencies = np.unique([drive.frequency for drive in self.drives])
        self.responses = Responses(model, self.frequencies)

    def phasors(self, points):
        """Accelerations [frequency, point] in m/s^2: forces of masses at rest, phasors of one frequency added."""
        per_newton = self.responses.at(points)
        sums = np.zeros((len(self.frequencies), len(points)), dtype=complex)
        for drive in self.drives:
            k = np.searchsorted(self.frequencies, drive.frequency)
            sums[k] += per_newton[k, drive.actuator] * drive.force * np.exp(1j * drive.force_phase)
        return sums

    def peaks_g(self, points):
        """Peak acceleration at points in g: moduli of distinct frequencies add (equation 23)."""
        return np.abs(self.phasors(points)).sum(axis=0) / STANDARD_GRAVITY_M_S2

    @property
    def max_hz(self):
        """Highest of the drives' frequencies."""
        return max(self.frequencies, default=40.0)

    def means(self, targets):
        """(mean of the peak over the rest of the surface in g, mean square near the targets over that of the rest in dB).

        Near is within 10 mm of any target. The mean square of a sum of distinct frequencies is the sum of their mean squares.
        """
        # Moduli have kinks at node lines, so their mean needs many more points than a mean square.
        finer = 20.0 if self.scene.is_bar else 3.0
        sums = []
        rules = (self.surface.rule(self.max_hz, finer), self.surface.near_any(targets, self.max_hz))
        for points, weights in rules:
            amplitudes = np.abs(self.phasors(points)) / STANDARD_GRAVITY_M_S2
            squares = (amplitudes**2).sum(axis=0)
            sums.append((weights.sum(), weights @ amplitudes.sum(axis=0), weights @ squares))
        (area, peak, square), (near_area, near_peak, near_square) = sums
        rest = area - near_area
        with np.errstate(divide="ignore", invalid="ignore"):
            contrast = 10 * np.log10((near_square / near_area) / ((square - near_square) / rest))
        return (peak - near_peak) / rest, contrast

    def above_threshold_db(self, target):
        """Level of the fundamentals at the target above the threshold of feeling."""
        return above_threshold_db(self.frequencies, np.abs(self.phasors([target])[:, 0]) / STANDARD_GRAVITY_M_S2)

    def harmonics_g(self, points):
        """Most that odd harmonics up to 1 kHz can add at points, in g: the sum of all moduli."""
        total = np.zeros(len(points))
        for drive in self.drives:
            orders = list(odd_harmonics(drive.frequency))
            if orders:
                per_newton = Responses(self.model, np.array(orders) * drive.frequency).at(points)[:, drive.actuator]
                actuator = self.scene.actuators[drive.actuator]
                forces = np.array([force_amplitude(actuator, drive.voltage, drive.pulse_width, drive.frequency, n) for n in orders])
                total += (np.abs(per_newton) * forces[:, None]).sum(axis=0)
        return total / STANDARD_GRAVITY_M_S2

    def harmonic_lines(self, point):
        """(frequencies in Hz, peaks in g) of the odd harmonics up to 1 kHz at a point. Drives of one frequency have their pulses in
        step, so that their harmonics' phasors add: the n-th is turned by n times the windows' phase and by that of the pulse train's n-th
        coefficient."""
        lines = {}
        for drive in self.drives:
            orders = list(odd_harmonics(drive.frequency))
            per_newton = Responses(self.model, np.array(orders) * drive.frequency).at([point])[:, drive.actuator, 0] if orders else []
            for n, accelerance in zip(orders, per_newton):
                actuator = self.scene.actuators[drive.actuator]
                own = pulses.coefficient(actuator.times, drive.frequency, drive.pulse_width, n)
                force = actuator.force(drive.voltage) * own * np.exp(1j * n * drive.phase)
                key = n * drive.frequency, n
                lines[key] = lines.get(key, 0) + accelerance * force
        hz = np.array([hz for hz, _ in lines])
        return hz, np.abs(np.array(list(lines.values()))) / STANDARD_GRAVITY_M_S2

    def travel_m(self):
        """Most travel of every mass by the fundamentals of masses at rest: moduli of distinct frequencies added."""
        sums = np.zeros((len(self.frequencies), len(self.scene.actuators)), dtype=complex)
        for drive in self.drives:
            k = np.searchsorted(self.frequencies, drive.frequency)
            sums[k] += self.responses.gap_change[k, drive.actuator] * drive.force * np.exp(1j * drive.force_phase)
        return np.abs(sums).sum(axis=0)

    def softened(self, orders=(3, 5, 7, 9, 11)):
        """Forces [frequency, actuator] in N and travel of every mass in m with gaps as they move; None: no steady motion.

        `orders`: harmonics whose motion moves the gaps beside the fundamentals'.
        """
        count = len(self.scene.actuators)
        if not self.drives:
            return np.zeros((0, count), dtype=complex), np.zeros(count)
        index, electrical = [None] * count, [None] * count
        for drive in self.drives:
            index[drive.actuator] = int(np.searchsorted(self.frequencies, drive.frequency))
            electrical[drive.actuator] = (drive.voltage, drive.pulse_width, drive.phase)
        harmonics = {n: Responses(self.model, n * self.frequencies).gap_change for n in orders}
        gaps = MovingGaps(self.scene.actuators, self.frequencies, index, electrical, self.responses.gap_change, harmonics)
        solved = gaps.solve()
        return solved and (solved[0], np.abs(solved[1]).sum(axis=0))

    def softened_peak_g(self, points, forces):
        """Peaks with the forces of `softened`."""
        return np.abs(np.einsum("kip,ki->kp", self.responses.at(points), forces)).sum(axis=0) / STANDARD_GRAVITY_M_S2

    def softening_g(self, point, forces):
        """By how much the forces of `softened` change the amplitudes at a point: the sum over frequencies, sizes added."""
        moved = np.abs(np.einsum("kip,ki->kp", self.responses.at([point]), forces))
        return np.abs(moved - np.abs(self.phasors([point]))).sum() / STANDARD_GRAVITY_M_S2

    def current_a(self):
        """Mean current of the supply."""
        return supply_current_a(self.scene.actuators, [(d.actuator, d.voltage, d.frequency) for d in self.drives])

    def power_w(self):
        """Electrical power: 2 C V^2 f of every drive."""
        return sum(2 * capacitance(self.scene.actuators[d.actuator]) * d.voltage**2 * d.frequency for d in self.drives)


def capacitance(actuator):
    """Of one electrode with its cable, in F."""
    return actuator.capacitance


def supply_current_a(actuators, drives):
    """Mean current of the supply for `drives` (actuator, V, Hz): both electrodes are charged once a period, as what the board counts at
    least, and the bleeders of each rail in use take their own. Rails feed every other actuator."""
    charges = sum(2 * max(capacitance(actuators[i]), BOARD_CHARGES_F) * volts * hz for i, volts, hz in drives)
    rails = [max((volts for i, volts, _ in drives if i % 2 == rail), default=0.0) for rail in range(2)]
    return charges + sum(rails) / RAIL_BLEEDER_OHM


def broken_limits(motion):
    """What the published limits say against a plan, as text: voltage, pulse, band, distance."""
    found = []
    scene = motion.scene
    for drive in motion.drives:
        actuator = scene.actuators[drive.actuator]
        if drive.voltage > actuator.max_voltage * (1 + 1e-9):
            found.append(f"{actuator.id}: {drive.voltage} V of {actuator.max_voltage}")
        if drive.pulse_width > widest_pulse(drive.frequency) + 1e-9:
            found.append(f"{actuator.id}: pulse {drive.pulse_width} leaves less than the guard time")
        if not 40 - 1e-9 <= drive.frequency <= 400 + 1e-9:
            found.append(f"{actuator.id}: {drive.frequency} Hz")
    gaps = np.diff(motion.frequencies)
    if len(gaps) and gaps.min() < LEAST_DISTANCE_HZ - 1e-9:
        found.append(f"frequencies {gaps.min()} Hz apart")
    return found


class Grid:
    """Every actuator at every frequency of the planner's grid: what a search needs to know about a target."""

    def __init__(self, model, harmonics_model, sags, grid_hz=GRID_HZ):
        """`harmonics_model`: one that holds up to 1 kHz; `sags`: what a press does to each actuator."""
        self.sags = sags
        self.scene, self.grid_hz = model.scene, np.asarray(grid_hz, dtype=float)
        self.harmonics_model = harmonics_model
        self.surface = Surface(self.scene)
        self.responses = Responses(model, self.grid_hz)

    @cached_property
    def whole(self):
        """Integral over the surface of |acceleration|^2 per N^2 at the grid's frequencies, and its area."""
        points, weights = self.surface.rule(self.grid_hz.max())
        return self.responses.integral(points, weights), weights.sum()

    @cached_property
    def widths(self):
        """Pulse widths that a plan may have at every frequency [frequency, width] (docs/src/planner-internals.md, "The plan table"): those
        that drop harmonics, as far as they fit, and the widest."""
        widest = np.minimum(1 - 2 * self.grid_hz * PLANNED_GUARD_S, WIDEST)[:, None]
        return np.concatenate([np.where(DROPPING <= widest, DROPPING, widest), widest], axis=1)

    @cached_property
    def harmonics(self):
        """What harmonics up to 1 kHz bring with 1 N of the fundamental: mean square over the surface
        [frequency, actuator, width], and travel of every mass, moduli added [frequency, actuator, width, mass]."""
        multiples = np.unique([n * f for f in self.grid_hz for n in odd_harmonics(f)])
        count = len(self.scene.actuators)
        squares = np.zeros((len(self.grid_hz), count, self.widths.shape[1]))
        travel = np.zeros((*squares.shape, count))
        if len(multiples) == 0:
            return squares, travel
        points, weights = self.surface.rule(HARMONICS_UP_TO_HZ)
        responses = Responses(self.harmonics_model, multiples)
        means = responses.integral(points, weights) / weights.sum()
        for k, frequency in enumerate(self.grid_hz):
            for n in odd_harmonics(frequency):
                at = np.searchsorted(multiples, n * frequency)
                ratio = np.stack([harmonic_ratio(actuator, self.widths[k], frequency, n) for actuator in self.scene.actuators])
                squares[k] += means[at][:, None] * ratio**2
                travel[k] += np.abs(responses.gap_change[at])[:, None, :] * ratio[:, :, None]
        return squares, travel

    def target(self, place):
        """(|acceleration| at the target, mean square over the rest) per N, both [frequency, actuator]."""
        peak = np.abs(self.responses.at([place])[:, :, 0])
        points, weights = self.surface.near(*place, self.grid_hz.max())
        whole, area = self.whole
        rest = (whole - self.responses.integral(points, weights)) / (area - weights.sum())
        return peak, rest

    def sure_force(self, margin=4.0):
        """Forces [frequency, actuator, width] that surely keep every limit, all actuators driven at once.

        Each has its share of the supply's current and of every gap's travel, and that is taken `margin` times: harmonics,
        softening and the motion of switching on have to find room. Breakdown is that of the gap closed as far as it may.
        """
        count = len(self.scene.actuators)
        sags = [sag.surely() for sag in self.sags]
        room = np.array([min(actuator.air_gap * TRAVEL_PART, sag.stop) for actuator, sag in zip(self.scene.actuators, sags)])
        most = np.empty((len(self.grid_hz), count, self.widths.shape[1]))
        for i, actuator in enumerate(self.scene.actuators):
            travel = np.abs(self.responses.gap_change[:, i, None, :]) + self.harmonics[1][:, i]
            by_travel = (room / np.maximum(margin * count * travel, 1e-300)).min(axis=2)
            # From three on actuators share rails: one may be at the other's voltage.
            hz = self.grid_hz if count <= 2 else np.full(len(self.grid_hz), self.grid_hz.max())
            # Each may have a rail to itself.
            by_current = 0.95 * SUPPLY_A / count / (2 * max(capacitance(actuator), BOARD_CHARGES_F) * hz + 1 / RAIL_BLEEDER_OHM)
            # The electrodes' mean softening, eps0 A V^2 / g^3, stays far below the spring.
            growth = softening_growth(actuator, sags[i])
            by_pull = np.sqrt(actuator.stiffness / growth / (2 * margin) * actuator.air_gap**3 / (VACUUM_PERMITTIVITY_F_PER_M * actuator.electrode_area))
            # The first and third actuator are on one rail, the second and fourth on the other: one voltage for both, which both
            # have to bear.
            by_rail = min(
                min(other.max_voltage, BREAKDOWN_PART * breakdown_v(other.air_gap - sag.closed(reach)))
                for other, sag, reach in list(zip(self.scene.actuators, sags, room))[i % 2 :: 2]
            )
            volts = np.minimum(min(by_rail, by_pull), by_current)
            most[:, i] = np.minimum(force_amplitude(actuator, volts[:, None], self.widths, self.grid_hz[:, None]), by_travel)
        return most


def related(first_hz, second_hz):
    """Whether one frequency lies within 0.5 Hz of three, five or seven times the other."""
    low, high = np.minimum(first_hz, second_hz), np.maximum(first_hz, second_hz)
    return np.any([np.abs(high - n * low) <= 0.5 for n in (3, 5, 7)], axis=0)


def unrelated(first_hz, second_hz):
    """The same where harmonics are no matter: in maps and settings of what can be had (docs/src/reach.md)."""
    return np.zeros(np.broadcast(first_hz, second_hz).shape, dtype=bool)


def apart(first_hz, second_hz, meets=related):
    """Whether two frequencies may be driven together."""
    return (np.abs(first_hz - second_hz) >= LEAST_DISTANCE_HZ) & ~meets(first_hz, second_hz)


def best_sum(worth, frequencies, meets=related):
    """Greatest sum of worth[frequency, actuator] over one frequency for each actuator, all of them `apart`.

    Exhaustive: every pair for two actuators. For more: for every order of the actuators along the band a table over the
    prefixes of the frequencies, which is every combination of the 20 Hz rule; where its best one breaks the rule on
    harmonics, each of the two offenders is forbidden in turn and the search is done again.
    """
    actuators = worth.shape[1]
    if actuators == 1:
        k = int(np.argmax(worth[:, 0]))
        return worth[k, 0], (k,)
    if actuators == 2:
        sums = np.where(apart(frequencies[:, None], frequencies[None, :], meets), worth[:, None, 0] + worth[None, :, 1], -np.inf)
        k = np.unravel_index(np.argmax(sums), sums.shape)
        return sums[k], tuple(int(i) for i in k)
    best, chosen = -np.inf, None
    waiting = [worth]
    while waiting:
        allowed = waiting.pop()
        found, places = _best_ordered(allowed, frequencies)
        if found <= best:
            continue
        pairs = [(i, j) for i in range(actuators) for j in range(i) if meets(frequencies[places[i]], frequencies[places[j]])]
        if not pairs:
            best, chosen = found, places
            continue
        for offender in pairs[0]:
            without = allowed.copy()
            without[places[offender], offender] = -np.inf
            waiting.append(without)
    return best, chosen


def _best_ordered(worth, frequencies):
    count, actuators = worth.shape
    # The last frequency that is far enough below each one, or -1.
    before = np.searchsorted(frequencies, frequencies - LEAST_DISTANCE_HZ + 1e-9, side="right") - 1
    best, chosen = -np.inf, None
    for order in permutations(range(actuators)):
        sums, back = worth[:, order[0]], []
        for actuator in order[1:]:
            upto = np.maximum.accumulate(sums)
            which = np.maximum.accumulate(np.where(sums >= upto, np.arange(count), 0))
            sums = np.where(before >= 0, upto[before], -np.inf) + worth[:, actuator]
            back.append(which[before])
        k = int(np.argmax(sums))
        if sums[k] > best:
            best, chosen = sums[k], [0] * actuators
            for actuator, which in zip(reversed(order[1:]), reversed(back)):
                chosen[actuator] = k
                k = int(which[k])
            chosen[order[0]] = k
    return best, tuple(chosen)


def least_cost(worth, cost, most, wanted):
    """Least sum of cost u^2 with sum of worth u = wanted and 0 <= u <= most, for arrays [..., actuator]; inf if impossible.

    Without limits u goes as worth / cost; what would exceed its limit is put there, and the rest is asked of the others.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        fixed = np.zeros(worth.shape, dtype=bool)
        for _ in range(worth.shape[-1] + 1):
            left = wanted - np.where(fixed, worth * most, 0.0).sum(axis=-1)
            free = np.where(fixed, 0.0, worth**2 / cost).sum(axis=-1)
            force = np.where(fixed, most, (np.maximum(left, 0.0) / free)[..., None] * worth / cost)
            over = (force > most) & ~fixed
            if not over.any():
                break
            fixed |= over
        total = (cost * force**2).sum(axis=-1)
        reached = (worth * force).sum(axis=-1) >= wanted * (1 - 1e-9)
    return np.where(reached & np.isfinite(total), total, np.inf)


def best_everywhere(grid, coarse, finer, rng, drawn, counted=20):
    """A large least peak in g over a lattice of places, of settings that surely keep every limit, and its frequencies.

    What is sure is sure for all actuators at once, so that each is at its most. One and two actuators: all frequencies that may be
    driven together; more: `drawn` random ones, and from the best of them one actuator after the other moved to where it serves best.
    Looked for at the places `coarse`; of the `counted` best the least over `finer` is told.
    """
    strong = grid.sure_force().max(axis=2) / STANDARD_GRAVITY_M_S2
    worth = np.abs(grid.responses.at(coarse)) * strong[:, :, None]
    every, count = np.arange(len(grid.grid_hz)), worth.shape[1]
    least = lambda choice: sum(worth[choice[:, i], i] for i in range(count)).min(axis=1)
    if count <= 2:
        choices = np.stack(np.meshgrid(*[every] * count, indexing="ij"), -1).reshape(-1, count)
    else:
        choices = rng.integers(0, len(every), (drawn, count))
    choices = _together(grid, choices)
    if len(choices) == 0:
        return 0.0, None
    values = np.concatenate([least(part) for part in np.array_split(choices, 1 + len(choices) * len(coarse) // 2_000_000)])
    if count > 2:
        for start in choices[np.argsort(values)[-3:]]:
            for i in list(range(count)) * 2:
                moved = np.repeat(start[None], len(every), axis=0)
                moved[:, i] = every
                moved = np.concatenate([start[None], _together(grid, moved)])
                own = least(moved)
                start = moved[int(own.argmax())]
                choices, values = np.vstack([choices, start]), np.append(values, own.max())
    rows = grid.responses.model.output_rows(np.asarray(finer))
    best, chosen = 0.0, None
    for choice in choices[np.argsort(values)[-counted:]]:
        fields = (np.abs(rows @ grid.responses.accelerations[k, :, i]) * strong[k, i] for i, k in enumerate(choice))
        value = sum(fields).min()
        if value > best:
            best, chosen = value, grid.grid_hz[choice]
    return best, chosen


def _together(grid, choices):
    """Those whose frequencies may be driven together."""
    hz = grid.grid_hz
    for i in range(choices.shape[1]):
        for j in range(i):
            choices = choices[apart(hz[choices[:, i]], hz[choices[:, j]])]
    return choices
