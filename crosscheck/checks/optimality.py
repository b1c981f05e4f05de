"""`optimality_gap`: a search of our own, over own fields, for anything better than what `era plan` prints.

Whatever keeps every limit for sure and is better than the plan by more than its gap proves the plan wrong. One and two
actuators: every combination of the grid's frequencies and of two pulse widths each. Three and four: every combination of
frequencies where no limit binds; where limits bind, random ones.
"""

import numpy as np

from ..harness import Result, change, not_comparable
from ..reference.electrostatics import force_amplitude, harmonic_ratio, widest_pulse
from ..reference.perception import STANDARD_GRAVITY_M_S2
from ..reference.planner import Grid, Motion, Responses, apart, best_sum, capacitance, drives_of, least_cost, odd_harmonics

CONTRAST, REACH, UTMOST, POWER = "optimality: contrast", "optimality: reach", "optimality: out of reach", "optimality: power"
QUANTITIES = (CONTRAST, REACH, UTMOST, POWER)
wrong_panel = change(("surface", "material", "youngs_modulus_pa"), 1.3)
PLANTS = {CONTRAST: wrong_panel, REACH: wrong_panel, UTMOST: "answer", POWER: wrong_panel}
EVERY = 6
# Costs are means over the surface, whose tolerance is that of `plan: mean elsewhere`; a cost counts it twice.
TOLERANCE = 5e-3
# A plan whose fields are known worse than this says nothing.
USEFUL = 5e-3
SAMPLES = 60_000


def run(context):
    """Three plans for one random place: a weak one, a strong one, one of least power."""
    rng, scene, name = context.rng("optimality"), context.scene, context.name
    place = context.random_point(rng)
    grid = Grid(context.panel(400.0).fine, context.panel(1000.0).fine)
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
        own = search.power(motion.peaks_g([place])[0] * STANDARD_GRAVITY_M_S2, motion.drives[0].pulse_width)
        difference = max(1 - own / motion.power_w(), 0.0)
        results.append(Result(POWER, name, difference, allowed, True, f"{wanted:.4g} g at {motion.frequencies} Hz"))
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
            best = (self.peak[:, i] * force_amplitude(actuator, volts, widest_pulse(self.grid.grid_hz))).max()
            for k, frequency in enumerate(motion.frequencies):
                own = np.abs(motion.responses.at([self.place])[k, i, 0])
                best = max(best, own * force_amplitude(actuator, volts, widest_pulse(frequency)))
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

    def power(self, wanted, pulse_width):
        """Least power of a peak from one actuator alone, the others off: 2 C V^2 f, V^2 as the force.

        At the plan's own pulse width: the program offers two at each frequency, and the wider one only where it has more force.
        """
        grid, least = self.grid, np.inf
        for i, actuator in enumerate(grid.scene.actuators):
            per_volt2 = force_amplitude(actuator, 1.0, pulse_width)
            force = wanted / np.maximum(self.peak[:, i], 1e-300)
            watts = 2 * capacitance(actuator) * grid.grid_hz * force / per_volt2
            fits = (force <= self.quiet_force[:, i]) & (pulse_width <= widest_pulse(grid.grid_hz))
            least = min(least, watts[fits].min(initial=np.inf))
        return least

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
                square += sum(harmonic_ratio(widths, n) ** 2 * value for n, value in zip(orders, squares)).min()
            total += square * drive.force**2
        return total
