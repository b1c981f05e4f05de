"""`optimality_gap`: a search of our own, over own fields, for anything better than what `era plan` prints.

Whatever keeps every limit for sure and is better than the plan by more than its gap proves the plan wrong. One and two
actuators: every combination of the grid's frequencies and of two pulse widths each. Three and four: every combination of
frequencies where no limit binds; where limits bind, random ones. With a quiet zone the same combinations, the forces of those that
would be better without it by quadratic and linear programmes; for one frequency with phases all frequencies; for `--objective reach` all
pairs, or random combinations and what can be had from the best of them by changing one frequency after the other.
"""

import csv
import io
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog, minimize

from ..harness import Result, change, not_comparable
from ..reference.electrostatics import force_amplitude, harmonic_ratio, widest_pulse
from ..reference.perception import STANDARD_GRAVITY_M_S2
from ..reference.planner import (
    Grid,
    Motion,
    Responses,
    apart,
    best_everywhere,
    best_sum,
    capacitance,
    drives_of,
    least_cost,
    odd_harmonics,
)
from .plan import named

CONTRAST, REACH, UTMOST, POWER = "optimality: contrast", "optimality: reach", "optimality: out of reach", "optimality: power"
ZONE_COST, ZONE_REACH, SHARED, EVERYWHERE = "optimality: quiet zone", "optimality: quiet zone's reach", "optimality: one frequency", "optimality: least peak"
QUANTITIES = (CONTRAST, REACH, UTMOST, POWER, ZONE_COST, ZONE_REACH, SHARED, EVERYWHERE)
wrong_panel = change(("surface", "material", "youngs_modulus_pa"), 1.3)
PLANTS = {CONTRAST: wrong_panel, REACH: wrong_panel, UTMOST: "answer", POWER: "answer"} | dict.fromkeys((ZONE_COST, ZONE_REACH, SHARED, EVERYWHERE), "answer")
EVERY = 6
# Costs are means over the surface, whose tolerance is that of `plan: mean elsewhere`; a cost counts it twice.
TOLERANCE = 5e-3
# A plan whose fields are known worse than this says nothing.
USEFUL = 5e-3
SAMPLES = 60_000
# Combinations whose forces in a quiet zone are worked out: of those that would be the best without it, of random ones, and of those that
# differ from the plan's by one frequency, so many each.
PROGRAMMES = 80
# A zone's limit in units of the peak that the plan without it has there; of that an alternative takes this part, so that crests
# between the points that either side looks at do not matter.
ZONE_LIMIT, ZONE_PART = 0.3, 0.97
# The part of either side of a plate that `--objective reach` is asked for, and random combinations for it.
AREA, DRAWN = 0.3, 3000
FINER = 4


def run(context):
    """Three plans for one random place: a weak one, a strong one, one of least power."""
    rng, scene, name = context.rng("optimality"), context.scene, context.name
    place = context.random_point(rng)
    grid = Grid(context.panel(400.0).fine, context.panel(1000.0).fine, context.press())
    search = Search(grid, place, rng)
    at = ["--at", f"{place[0] * 1e3!r},{place[1] * 1e3!r}", "--unit", "mm"]
    results = []
    sure = search.surely_reached()
    if not sure > 1e-6:
        return [not_comparable(CONTRAST, name, "nothing moves")]
    # Peaks in g: what is met without a thought, what needs most of it, what nothing meets.
    for part in (0.05, float(rng.uniform(0.5, 0.98))):
        wanted = part * sure / STANDARD_GRAVITY_M_S2
        plan = context.era.json("plan", *at, "--intensity-g", repr(float(wanted)))
        note = f"{wanted:.4g} g at {place[0] * 1e3:.5g},{place[1] * 1e3:.5g} mm"
        allowed = tolerance(plan)
        if allowed is None:
            results.append(not_comparable(CONTRAST, name, f"bound {plan['error_bound']}"))
            continue
        if plan["limited_by"] is not None:
            short = 1 - plan["predicted"]["target_peak_g"] / wanted
            results.append(Result(REACH, name, short, allowed, True, f"{note} {plan['limited_by']}"))
            continue
        motion = Motion(context.panel(400.0).fine, drives_of(scene, plan["drives"]), grid.surface)
        peak = motion.peaks_g([place])[0] * STANDARD_GRAVITY_M_S2
        own, found = search.contrast(peak)
        cost = search.cost(motion)
        difference = 1 - own / cost
        results.append(Result(CONTRAST, name, max(difference, 0.0), allowed, True, f"{note}; {found}"))
    plan = context.era.json("plan", *at, "--intensity-g", "1000")
    if context.planted(UTMOST):
        plan["predicted"]["target_peak_g"] *= 3
    peak = plan["predicted"]["target_peak_g"] * STANDARD_GRAVITY_M_S2
    note = f"at {place[0] * 1e3:.5g},{place[1] * 1e3:.5g} mm; {plan['limited_by']}"
    motion = Motion(context.panel(400.0).fine, drives_of(scene, plan["drives"]), grid.surface)
    if (allowed := tolerance(plan)) is None:
        results.append(not_comparable(REACH, name, f"bound {plan['error_bound']}"))
    else:
        results.append(Result(REACH, name, max(1 - peak / sure, 0.0), allowed, True, note))
        results.append(Result(UTMOST, name, max(peak / search.utmost(motion) - 1, 0.0), TOLERANCE, True, note))
    wanted = float(0.05 * sure / STANDARD_GRAVITY_M_S2)
    plan = context.era.json("plan", *at, "--intensity-g", repr(wanted), "--objective", "power")
    motion = Motion(context.panel(400.0).fine, drives_of(scene, plan["drives"]), grid.surface)
    if (allowed := tolerance(plan)) is None or len(motion.drives) != 1:
        results.append(not_comparable(POWER, name, f"bound {plan['error_bound']}, {len(motion.drives)} drives"))
    else:
        own, pulse = search.power(motion.peaks_g([place])[0] * STANDARD_GRAVITY_M_S2)
        watts = motion.power_w()
        if context.planted(POWER):
            # As if the pulse without a third harmonic had been taken: the same force from a higher voltage.
            drive = motion.drives[0]
            watts *= np.sin(np.pi * drive.pulse_width / 2) / np.sin(np.pi / 3)
        difference = max(1 - own / watts, 0.0)
        results.append(Result(POWER, name, difference, allowed, True, f"{wanted:.4g} g at {motion.frequencies} Hz, width {motion.drives[0].pulse_width:.3f}; {pulse}"))
    results += spared(context, search, at, wanted)
    results += one_frequency(context, search, at)
    results += everywhere(context, search, at)
    return results


def tolerance(plan):
    """How much better than the plan a combination may seem to be: its gap, and the tolerance of costs with the fields' bound.

    None where fields are known too badly to tell.
    """
    bound = plan["error_bound"]
    return None if bound is None or bound > USEFUL else plan["optimality_gap"] + TOLERANCE + 4 * bound


class Search:
    """All that can be had at one place."""

    def __init__(self, grid, place, rng):
        self.grid, self.rng, self.place = grid, rng, place
        self.peak, self.rest = grid.target(place)
        self.sure = grid.sure_force()
        # Candidates of every actuator: each frequency with the pulse that moves the rest least, and with the strongest.
        costs = self.rest[:, :, None] + grid.harmonics[0]
        take = lambda values, which: np.take_along_axis(values, which[:, :, None], 2)[:, :, 0]
        usable = np.where(self.sure > 0, costs, np.inf)
        quiet, strong = usable.argmin(axis=2), self.sure.argmax(axis=2)
        self.quiet_cost = take(costs, quiet)
        self.quiet_force = take(self.sure, quiet)
        self.strong_force = take(self.sure, strong)
        self.hz = np.concatenate([grid.grid_hz] * 2)
        self.worth = np.concatenate([self.peak] * 2)
        self.costs = np.concatenate([self.quiet_cost, take(costs, strong)])
        self.most = np.concatenate([self.quiet_force, self.strong_force])

    def surely_reached(self):
        """Peak in m/s^2 that can be had for sure."""
        return best_sum(self.peak * self.strong_force, self.grid.grid_hz)[0]

    def utmost(self, motion):
        """Peak that nothing can exceed: voltage and the widest pulse, each actuator at its best, at the grid's frequencies or
        at the plan's own, which may lie between them."""
        total = 0.0
        for i, actuator in enumerate(self.grid.scene.actuators):
            volts = actuator.max_voltage
            best = (self.peak[:, i] * force_amplitude(actuator, volts, widest_pulse(self.grid.grid_hz), self.grid.grid_hz)).max()
            for k, frequency in enumerate(motion.frequencies):
                own = np.abs(motion.responses.at([self.place])[k, i, 0])
                best = max(best, own * force_amplitude(actuator, volts, widest_pulse(frequency), frequency))
            total += best
        return total

    def contrast(self, wanted):
        """Least cost of a peak, and its frequencies."""
        count = self.peak.shape[1]
        efficiency = np.where(self.peak > 0, self.peak, 0.0) ** 2 / np.maximum(self.quiet_cost, 1e-300)
        total, chosen = best_sum(efficiency, self.grid.grid_hz)
        rows, columns = np.array(chosen), np.arange(count)
        force = wanted / total * self.peak[rows, columns] / np.maximum(self.quiet_cost[rows, columns], 1e-300)
        if (force <= self.quiet_force[rows, columns]).all():
            return wanted**2 / total, f"{self.grid.grid_hz[rows]} Hz"
        if count <= 2:
            every = np.arange(len(self.hz))
            combinations = np.stack(np.meshgrid(*[every] * count, indexing="ij"), -1).reshape(-1, count)
        else:
            combinations = self.rng.integers(0, len(self.hz), (SAMPLES, count))
        for i in range(count):
            for j in range(i):
                combinations = combinations[apart(self.hz[combinations[:, i]], self.hz[combinations[:, j]])]
        pick = lambda values: values[combinations, np.arange(count)]
        costs = least_cost(pick(self.worth), pick(self.costs), pick(self.most), wanted)
        best = int(costs.argmin())
        return costs[best], f"{self.hz[combinations[best]]} Hz, of {len(combinations)}"

    def power(self, wanted):
        """Least power of a peak from one actuator alone, the others off: 2 C V^2 f, V^2 as the force; and where it is had. With every
        pulse width that a plan may have."""
        grid, least, found = self.grid, np.inf, ""
        for i, actuator in enumerate(grid.scene.actuators):
            force = wanted / np.maximum(self.peak[:, i], 1e-300)
            per_volt2 = force_amplitude(actuator, 1.0, grid.widths, grid.grid_hz[:, None])
            watts = 2 * capacitance(actuator) * (grid.grid_hz * force)[:, None] / per_volt2
            watts = np.where(force[:, None] <= self.sure[:, i], watts, np.inf)
            k, w = np.unravel_index(watts.argmin(), watts.shape)
            if watts[k, w] < least:
                least, found = watts[k, w], f"{actuator.id} at {grid.grid_hz[k]:.0f} Hz, width {grid.widths[k, w]:.3f}"
        return least, found

    def combinations(self):
        """Indices of frequencies, each with its quiet pulse, that may be driven together: all of one and two actuators, random ones of more."""
        count, every = self.peak.shape[1], np.arange(len(self.grid.grid_hz))
        if count <= 2:
            found = np.stack(np.meshgrid(*[every] * count, indexing="ij"), -1).reshape(-1, count)
        else:
            found = self.rng.integers(0, len(every), (SAMPLES, count))
        for i in range(count):
            for j in range(i):
                found = found[apart(self.grid.grid_hz[found[:, i]], self.grid.grid_hz[found[:, j]])]
        return found

    def beside(self, motion):
        """Combinations that differ from a plan's by the frequency of one actuator; one that the plan leaves out has any."""
        grid, count = self.grid, self.peak.shape[1]
        own = self.rng.integers(0, len(grid.grid_hz), count)
        for drive in motion.drives:
            own[drive.actuator] = int(np.clip(round(drive.frequency - grid.grid_hz[0]), 0, len(grid.grid_hz) - 1))
        found = np.repeat(own[None], count * len(grid.grid_hz), axis=0)
        for i in range(count):
            found[i * len(grid.grid_hz) : (i + 1) * len(grid.grid_hz), i] = np.arange(len(grid.grid_hz))
        for i in range(count):
            for j in range(i):
                found = found[apart(grid.grid_hz[found[:, i]], grid.grid_hz[found[:, j]])]
        return found

    def cost(self, motion):
        """The same measure of a plan, from its drives: at the pulses printed, or where actuators share rails, the best."""
        total = 0.0
        for drive in motion.drives:
            k = int(np.searchsorted(motion.frequencies, drive.frequency))
            surface = self.grid.surface
            points, weights = surface.rule(motion.max_hz)
            near, inner = surface.near(*self.place, motion.max_hz)
            whole = motion.responses.integral(points, weights)[k, drive.actuator]
            close = motion.responses.integral(near, inner)[k, drive.actuator]
            square = (whole - close) / (weights.sum() - inner.sum())
            orders = list(odd_harmonics(drive.frequency))
            if orders:
                points, weights = surface.rule(1000.0)
                responses = Responses(self.grid.harmonics_model, np.array(orders) * drive.frequency)
                squares = responses.integral(points, weights)[:, drive.actuator] / weights.sum()
                widths = np.array([drive.pulse_width])
                if len(motion.scene.actuators) > 2:
                    widths = self.grid.widths[int(round(np.clip(drive.frequency, 40, 400) - 40))]
                square += sum(harmonic_ratio(motion.scene.actuators[drive.actuator], widths, drive.frequency, n) ** 2 * value for n, value in zip(orders, squares)).min()
            total += square * drive.force**2
        return total


def spared(context, search, at, wanted_g):
    """A weak plan with a quiet zone that binds: cost where the wish is met, reach where it is not."""
    grid, scene, name, rng = search.grid, context.scene, context.name, context.rng("optimality: zone")
    panel = context.panel(400.0).fine
    plan = context.era.json("plan", *at, "--intensity-g", repr(wanted_g))
    centre, radius = context.random_point(rng), float(np.round(rng.uniform(2, 8), 1)) * 1e-3
    points = grid.surface.near(*centre, 2000.0, radius)[0]
    before = Motion(panel, drives_of(scene, plan["drives"]), grid.surface)
    limit = float(f"{ZONE_LIMIT * before.peaks_g(points).max():.6g}")
    if limit < 1e-6:
        return [not_comparable(ZONE_COST, name, "nothing moves in the zone")]
    quiet = ("--quiet", f"{centre[0] * 1e3!r},{centre[1] * 1e3!r}:{radius * 1e3!r}:{limit!r}")
    plan = context.era.json("plan", *at, "--intensity-g", repr(wanted_g), *quiet)
    note = f"{wanted_g:.4g} g, {quiet[1]}, {plan['limited_by']}, gap {plan['optimality_gap']:.1e}"
    quantity = ZONE_COST if plan["limited_by"] is None else ZONE_REACH
    allowed = tolerance(plan)
    if allowed is None:
        return [not_comparable(quantity, name, f"bound {plan['error_bound']}")]
    motion = Motion(panel, drives_of(scene, plan["drives"]), grid.surface)
    if not motion.drives:
        return [not_comparable(quantity, name, "nothing is driven")]
    peak = motion.peaks_g([search.place])[0] * STANDARD_GRAVITY_M_S2
    most = ZONE_PART * limit * STANDARD_GRAVITY_M_S2
    felt = np.abs(grid.responses.at(points))
    choices, actuators = search.combinations(), np.arange(search.peak.shape[1])
    beside = search.beside(motion)
    choices = np.concatenate([choices, beside])
    pick = lambda values: values[choices, actuators]
    cost = search.cost(motion) * (20 if context.planted(ZONE_COST) else 1)
    peak_there = peak / (20 if context.planted(ZONE_REACH) else 1)
    if quantity == ZONE_COST:
        worth = -least_cost(pick(search.peak), pick(search.quiet_cost), pick(search.quiet_force), peak)
        enough = -cost * (1 - allowed)
    else:
        worth = (pick(search.peak) * pick(search.quiet_force)).sum(axis=1)
        enough = peak_there * (1 + allowed)
    # What is not even better without the zone need not be looked at.
    better = np.flatnonzero(worth > enough)
    order, near = better[np.argsort(-worth[better])], better[better >= len(choices) - len(beside)]
    some = lambda of: rng.choice(of, min(PROGRAMMES, len(of)), replace=False)
    taken = np.unique(np.concatenate([order[:PROGRAMMES], some(order), some(near)])).astype(int)
    best, found = 0.0, f"{len(taken)} of {len(choices)} looked at"
    for choice in choices[taken]:
        rows = np.stack([felt[k, i] for i, k in enumerate(choice)], axis=1)
        worth, force = search.peak[choice, actuators], search.quiet_force[choice, actuators]
        if quantity == ZONE_COST:
            value = 1 - _least_cost_in_zone(worth, search.quiet_cost[choice, actuators], force, rows, peak, most) / cost
        else:
            # More than the wish is not asked for.
            had = min(_most_in_zone(worth, force, rows, most), wanted_g * STANDARD_GRAVITY_M_S2)
            value = 1 - peak_there / max(had, 1e-300)
        if value > best:
            best, found = value, f"{grid.grid_hz[choice]} Hz for {motion.frequencies}"
    return [Result(quantity, name, best, allowed, True, f"{note}; {found}"), *named(context, plan, note)]


def _most_in_zone(worth, most_force, rows, limit):
    """Largest peak of one combination: forces in units of their most."""
    scaled = rows * most_force / limit
    solved = linprog(-worth * most_force, A_ub=scaled, b_ub=np.ones(len(rows)), bounds=(0, 1), method="highs")
    return -solved.fun if solved.status == 0 else 0.0


def _least_cost_in_zone(worth, costs, most_force, rows, wanted, limit):
    """Least cost of one combination; infinite if there is none."""
    if _most_in_zone(worth, most_force, rows, limit) < wanted:
        return np.inf
    share, scale = worth * most_force / wanted, costs * most_force**2
    size = max(scale.max(), 1e-300)
    limits = rows * most_force / limit
    start = linprog(scale / size, A_ub=limits, b_ub=np.ones(len(rows)), A_eq=[share], b_eq=[1.0], bounds=(0, 1), method="highs")
    if start.status != 0:
        return np.inf
    solved = minimize(
        lambda x: (scale / size) @ x**2,
        start.x,
        jac=lambda x: 2 * scale / size * x,
        bounds=[(0, 1)] * len(worth),
        constraints=[
            {"type": "eq", "fun": lambda x: share @ x - 1, "jac": lambda x: share},
            {"type": "ineq", "fun": lambda x: 1 - limits @ x, "jac": lambda x: -limits},
        ],
        method="SLSQP",
        options={"ftol": 1e-10, "maxiter": 100},
    )
    # Only what is feasible counts; the start is.
    x = solved.x if abs(share @ solved.x - 1) < 1e-6 and (limits @ solved.x).max() < 1 + 1e-6 and solved.x.min() > -1e-9 else start.x
    return scale @ x**2


def one_frequency(context, search, at):
    """`--grouping shared` against every frequency of the grid: the least of u* E u for the peak is at E^-1 conj(h); where that takes
    more force than is sure, E with a multiple of the identity, which has less."""
    grid, scene, name = search.grid, context.scene, context.name
    count = len(scene.actuators)
    if count < 2:
        return []
    accelerance = grid.responses.at([search.place])[:, :, 0]
    sure = (np.abs(accelerance) * search.quiet_force).sum(axis=1).max()
    wanted_g = float(0.05 * sure / STANDARD_GRAVITY_M_S2)
    if wanted_g < 1e-7:
        return [not_comparable(SHARED, name, "nothing moves")]
    plan = context.era.json("plan", *at, "--intensity-g", repr(wanted_g), "--grouping", "shared")
    allowed = tolerance(plan)
    if allowed is None:
        return [not_comparable(SHARED, name, f"bound {plan['error_bound']}")]
    motion = Motion(context.panel(400.0).fine, drives_of(scene, plan["drives"]), grid.surface)
    if len(motion.frequencies) != 1:
        return [Result(SHARED, name, np.inf, 0.0, True, f"frequencies {motion.frequencies}")]
    if context.planted(SHARED):
        # As if the phases had not been turned.
        motion.drives = [replace(drive, force_phase=0.0) for drive in motion.drives]
    if plan["limited_by"] is not None:
        short = 1 - plan["predicted"]["target_peak_g"] / wanted_g
        return [Result(SHARED, name, short, allowed, True, f"{wanted_g:.4g} g, {plan['limited_by']}")]
    # Products of all pairs of actuators over the rest of the surface.
    points, weights = grid.surface.rule(grid.grid_hz.max())
    near, inner = grid.surface.near(*search.place, grid.grid_hz.max())
    gram = sum(sign * (rows := motion.model.output_rows(p)).T @ (w[:, None] * rows) for sign, p, w in ((1, points, weights), (-1, near, inner)))
    gram /= weights.sum() - inner.sum()
    products = lambda own: np.einsum("fni,nm,fmj->fij", own.accelerations.conj(), gram, own.accelerations, optimize=True)
    pairs = products(grid.responses)
    # The force's harmonics are of different drives; whether and how they count is not said: better is what is better either way.
    quiet_harmonics = search.quiet_cost - search.rest
    force = np.zeros(count, dtype=complex)
    for drive in motion.drives:
        force[drive.actuator] = drive.force * np.exp(1j * drive.force_phase)
    peak = motion.peaks_g([search.place])[0] * STANDARD_GRAVITY_M_S2
    own = (force.conj() @ products(motion.responses)[0] @ force).real
    k = int(np.clip(round(motion.frequencies[0] - grid.grid_hz[0]), 0, len(grid.grid_hz) - 1))
    own_with = own + quiet_harmonics[k] @ np.abs(force) ** 2
    best, found = 0.0, ""
    scale = np.einsum("fii->f", pairs).real / count
    for part in (0.0, *10.0 ** np.arange(-6, 2.1, 0.5)):
        for harmonics in (0.0, 1.0):
            matrix = pairs + (part * scale[:, None, None] + harmonics * quiet_harmonics[:, :, None] + 1e-12 * scale[:, None, None]) * np.eye(count)
            turned = np.linalg.solve(matrix, accelerance.conj()[:, :, None])[:, :, 0]
            reached = np.einsum("fi,fi->f", accelerance, turned)
            tried = peak * turned / reached[:, None]
            plain = np.einsum("fi,fij,fj->f", tried.conj(), pairs, tried).real
            ratios = np.maximum(plain / own, (plain + (quiet_harmonics * np.abs(tried) ** 2).sum(axis=1)) / own_with)
            ratios = np.where((np.abs(tried) <= search.quiet_force).all(axis=1), ratios, np.inf)
            k = int(np.nanargmin(ratios))
            if 1 - ratios[k] > best:
                best, found = 1 - ratios[k], f"{grid.grid_hz[k]:.0f} Hz"
    return [Result(SHARED, name, best, allowed, True, f"{wanted_g:.4g} g at {motion.frequencies[0]} Hz; {found}")]


def everywhere(context, search, at):
    """`--objective reach`: its least peak over the lattice that it is looked for on, in a part of a plate or on a whole bar."""
    grid, scene, name = search.grid, context.scene, context.name
    zone = [(0.0, scene.length), (0.0, scene.width)]
    words = ()
    if not scene.is_bar:
        zone = [(max(a - AREA / 2 * side, 0.0), min(a + AREA / 2 * side, side)) for a, (_, side) in zip(search.place, zone)]
        words = ("--zone", ",".join(repr(zone[axis][end] * 1e3) for end in (0, 1) for axis in (0, 1)))
    plan = context.era.json("plan", *at, "--intensity-g", "1000", "--objective", "reach", *words)
    allowed = tolerance(plan)
    if allowed is None:
        return [not_comparable(EVERYWHERE, name, f"bound {plan['error_bound']}")]
    table = list(csv.reader(io.StringIO(context.era.run("field", *at, "--csv", "-")[0])))[1:]
    lines = [np.unique(np.array([float(row[axis]) for row in table])) * 1e-3 for axis in (0, 1)]
    within = lambda values, ends: values[(values >= ends[0] - 1e-9) & (values <= ends[1] + 1e-9)]
    finer = [np.unique(np.concatenate([a + (b - a) * np.arange(FINER) / FINER for a, b in zip(l, l[1:])] + [l[-1:]])) for l in lines]
    coarse, finer = (
        np.array([(x, y) for x in within(a, zone[0]) for y in within(b, zone[1]) if scene.has_surface(x, y)]) for a, b in (lines, finer)
    )
    if len(coarse) == 0:
        return [not_comparable(EVERYWHERE, name, "no point in the rectangle")]
    motion = Motion(context.panel(400.0).fine, drives_of(scene, plan["drives"]), grid.surface)
    own = motion.peaks_g(finer).min()
    if context.planted(EVERYWHERE):
        own *= 1e-3
    best, found = best_everywhere(grid, coarse, finer, search.rng, DRAWN)
    if best < 1e-7:
        return [not_comparable(EVERYWHERE, name, "nothing for sure")]
    note = f"{own:.4g} g at {motion.frequencies} Hz, {plan['limited_by']}, gap {plan['optimality_gap']:.1e}; sure {best:.4g} g at {found} Hz"
    return [Result(EVERYWHERE, name, max(1 - own / best, 0.0), allowed, True, note)]
