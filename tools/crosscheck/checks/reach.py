"""`era field --reach` and `--schemes`: what can be had at points of the printed maps, and everywhere with one setting."""

import numpy as np

from ..harness import ProgramFailed, Result, change, change_all, not_comparable
from ..reference.electrostatics import force_amplitude, widest_pulse
from ..reference.perception import STANDARD_GRAVITY_M_S2
from ..reference.planner import Drive, Grid, Motion, best_everywhere, best_sum, drives_of

LEAST, MOST, CONTRAST, SCHEMES = "reach: strongest, from below", "reach: strongest, from above", "reach: contrast", "reach: schemes"
WEAKEST, SPREAD, RIGID = "schemes: weakest place", "schemes: spread", "schemes: rigid part"
TOUCH, BELOW, SAME = "schemes: every touch", "schemes: one setting's bound", "schemes: reach map"
QUANTITIES = (LEAST, MOST, CONTRAST, SCHEMES, WEAKEST, SPREAD, RIGID, TOUCH, BELOW, SAME)
PLANTS = {
    LEAST: change_all("actuator", "max_voltage_v", 0.7),
    MOST: change_all("actuator", "electrode_area_mm2", 1.3),
    CONTRAST: change(("surface", "material", "youngs_modulus_pa"), 1.3),
    SCHEMES: change(("surface", "material", "youngs_modulus_pa"), 1.05),
    WEAKEST: "answer",
    SPREAD: "answer",
    RIGID: "answer",
    TOUCH: "answer",
    BELOW: "answer",
    SAME: "answer",
}
EVERY, FIRST = 5, 3
# Not the whole band: every point of a map is a search of its own. Room for four frequencies 20 Hz apart.
BAND_HZ = 80
# Of plates with several actuators a rectangle of this part of either side, as every point of a map takes as long as a plan.
ZONE = 0.12
POINTS = 4
# Relative, of peaks by forces that are at a limit, whose travel the reference works out in its own way: least that a point of a map may be
# off, whatever bound is printed beside it.
TOLERANCE = 0.01
CONTRAST_DB = 0.3
# A scheme's peak at the place where it is least is a small part of its largest one.
SCHEME_PART = 2e-3
# The least peak is looked for on a lattice of up to this many parts of the maps' cells (docs/src/reach.md).
FINER = 4
# Points of such a lattice from which on it has fewer parts.
LARGE = 60_000
# Quantiles are by area: of cells that a cut-out or the zone's border divides either weight may be meant.
AREA, AREA_CUT = 0.02, 0.06
# Mean squares by the program's lattice, 24 points per wave at most; a bar's or a plate's rows have no fewer at 400 Hz.
RIGID_PART = 0.01
# Alternatives to one setting for three and four actuators: random frequencies, from the best of which more are looked for.
DRAWN = 3000
# Peaks below this are rounding: a ten-thousandth of what is felt at best (1e-3 g).
NOTHING_G = 1e-7


def run(context):
    """Some points of the maps, and every setting of `--schemes`; of plates with several actuators within a small rectangle."""
    rng, scene, name = context.rng("reach"), context.scene, context.name
    start = int(rng.integers(40, 321))
    words = ("--from", start, "--to", start + BAND_HZ)
    zone = [(0.0, scene.length), (0.0, scene.width)]
    if not scene.is_bar and len(scene.actuators) > 1:
        x, y = context.random_point(context.rng("reach: zone"), 0.0)
        zone = [(max(at - ZONE / 2 * side, 0.0), min(at + ZONE / 2 * side, side)) for at, (_, side) in zip((x, y), zone)]
        words += ("--zone", ",".join(repr(zone[axis][end] * 1e3) for end in (0, 1) for axis in (0, 1)))
    try:
        maps = context.era.json("field", "--reach", *words)["maps"]
    except ProgramFailed as failure:
        if "zone contains no point" not in failure.stderr:
            raise
        return [not_comparable(LEAST, name, "no point of the map in the zone")]
    grid = Grid(context.panel(400.0).fine, context.panel(1000.0).fine, context.press(), np.arange(start, start + BAND_HZ + 1.0))
    xs, ys = maps["x_mm"], maps["y_mm"]
    there = [k for k, value in enumerate(maps["strongest_g"]) if value is not None]
    ids = [actuator.id for actuator in scene.actuators]
    order = [ids.index(actuator) for actuator in maps["actuators"]]
    results = []
    for k in rng.choice(there, min(POINTS, len(there)), replace=False):
        place = np.array([xs[k % len(xs)], ys[k // len(xs)]]) * 1e-3
        peak, rest = grid.target(place)
        strongest = maps["strongest_g"][k] * STANDARD_GRAVITY_M_S2
        note = f"at {place[0] * 1e3:.5g},{place[1] * 1e3:.5g} mm"
        sure = best_sum(peak * grid.sure_force().max(axis=2), grid.grid_hz)[0]
        most = sum(
            (peak[:, i] * force_amplitude(actuator, actuator.max_voltage, widest_pulse(grid.grid_hz), grid.grid_hz)).max()
            for i, actuator in enumerate(scene.actuators)
        )
        if most < 1e-9:
            results.append(not_comparable(LEAST, name, "nothing moves"))
            continue
        room = held_to(maps, k)
        results.append(Result(LEAST, name, max(0.0, 1 - strongest / sure), room, True, note))
        results.append(Result(MOST, name, max(0.0, strongest / most - 1), room, True, note))
        results.append(quietest(context, grid, place, peak, rest, maps["contrast_db"][k], maps["contrast_hz"][k], order, note))
    return [result for result in results if result] + schemes(context, grid, maps, there, zone, words)


def held_to(maps, k):
    """What the strongest peak at point `k` of the maps may be off: the printed bound, or `TOLERANCE` if that is more. A map with a finger has a
    bound only where a peak is the least of all: the others are of the same model there, and are held to that."""
    bounds = maps["error_bound"]
    own = bounds[k] if bounds[k] is not None else max((bound for bound in bounds if bound is not None), default=0.0)
    return max(TOLERANCE, own)


def quietest(context, grid, place, peak, rest, printed_db, printed_hz, order, note):
    """Contrast of the drive with the least mean square elsewhere: forces as worth over cost, at the printed frequencies."""
    costs = (rest[:, :, None] + grid.harmonics[0]).min(axis=2)
    drives = []
    for actuator, frequency in zip(order, printed_hz):
        k = int(round(frequency - grid.grid_hz[0]))
        if abs(grid.grid_hz[k] - frequency) > 1e-6:
            return None
        if costs[k, actuator] <= 0:
            continue
        drives.append(Drive(actuator, float(frequency), 0.0, 2 / 3, 0.0, peak[k, actuator] / costs[k, actuator], 0.0))
    if not drives:
        return None
    _, contrast = Motion(context.panel(400.0).fine, drives, grid.surface).means([place])
    return Result(CONTRAST, context.name, abs(contrast - printed_db), CONTRAST_DB, True, f"{note}; {printed_hz} Hz")


class Seen:
    """The maps' lattice as far as it is looked at: its points with their share of the surface, and those between them."""

    def __init__(self, scene, maps, there, zone):
        xs, ys = (np.array(maps[key]) * 1e-3 for key in ("x_mm", "y_mm"))
        shares = np.outer(_shares(ys), _shares(xs)).ravel()
        self.points = np.array([(xs[k % len(xs)], ys[k // len(xs)]) for k in there])
        self.share = shares[there] / shares[there].sum()
        xs, ys = (np.array([v for v in _between(lines) if a - 1e-9 <= v <= b + 1e-9]) for lines, (a, b) in zip((xs, ys), zone))
        finer = np.stack(np.meshgrid(xs, ys, indexing="ij"), -1).reshape(-1, 2)
        self.finer = finer[[scene.has_surface(*point) for point in finer]] if scene.cutouts else finer
        cut = AREA_CUT if scene.cutouts else AREA
        self.whole = len(maps["strongest_g"])
        # A quantile falls on one point or the next.
        self.doubt = cut + self.share.max()

    def quantile(self, values, part):
        """Between which values a part of the area lies that is known no better than `doubt`."""
        order = np.argsort(values)
        upto = np.cumsum(self.share[order])
        at = lambda wanted: values[order[min(int(np.searchsorted(upto, wanted)), len(order) - 1)]]
        return at(max(part - self.doubt, 0.0)), at(min(part + self.doubt, 1.0))


def _shares(lines):
    """What of a side belongs to each of its lines: half of what is between it and the next."""
    if len(lines) < 2:
        return np.ones(len(lines))
    steps = np.diff(lines) / 2
    return np.concatenate([steps, [0.0]]) + np.concatenate([[0.0], steps])


def _between(lines):
    """The lines, and `FINER` - 1 between every two."""
    parts = [a + (b - a) * np.arange(FINER) / FINER for a, b in zip(lines, lines[1:])]
    return np.concatenate([*parts, lines[-1:]])


def schemes(context, grid, maps, there, zone, words):
    """Every scheme's one setting over all that is looked at, and what is said of a setting for every touch."""
    answer = context.era.json("field", "--schemes", *words)
    scene, results = context.scene, []
    seen = Seen(scene, maps, there, zone)
    if not any(part["force_n"] > 0 for scheme in answer["schemes"] for part in scheme["setting"]):
        return [not_comparable(SCHEMES, context.name, "nothing moves")]
    spoil(context, answer["schemes"])
    for scheme in answer["schemes"]:
        motion = Motion(context.panel(400.0).fine, drives_of(scene, scheme["setting"]), grid.surface)
        said = scheme["one_setting"]
        places = np.array([said["least_at_mm"], said["most_at_mm"]]) * 1e-3
        own = motion.peaks_g(places)
        top = max(said["most"], 1e-300)
        worst = np.abs(own - [said["least"], said["most"]]).max() / top
        results.append(Result(SCHEMES, context.name, worst, SCHEME_PART, True, scheme["scheme"]))
        results += _spread(context, seen, motion, scheme, top)
        results.append(_rigid(context, motion, scheme))
    return results + _every_touch(context, grid, seen, maps, there, answer["schemes"]) + _alternatives(context, grid, seen, answer["schemes"])


def spoil(context, said):
    """Mistakes in the answer itself."""
    if context.planted(WEAKEST):
        said[0]["one_setting"]["least"] += 0.02 * said[0]["one_setting"]["most"]
    if context.planted(SPREAD):
        said[0]["one_setting"]["median"] = said[0]["one_setting"]["most"]
    if context.planted(RIGID):
        said[0]["rigid"] = (said[0]["rigid"] or 0.0) / 2 + 0.4
    if context.planted(TOUCH):
        said[0]["per_touch"]["most"] *= 1e4
    if context.planted(BELOW):
        said[2]["one_setting_at_most"] *= 0.1
    if context.planted(SAME):
        said[2]["per_touch"]["least"] *= 0.97


def _spread(context, seen, motion, scheme, top):
    """Least and most over the lattice, where they are, quantiles, and the part that is dead."""
    said, name, note = scheme["one_setting"], context.name, scheme["scheme"]
    coarse, finer = motion.peaks_g(seen.points), motion.peaks_g(seen.finer)
    room = SCHEME_PART * top
    # With fewer lines between, where a lattice is large, the least found may be as much as that of the maps' own points.
    most = finer.min() if seen.whole * FINER**2 <= LARGE else coarse.min()
    outside = max(said["least"] - most, finer.min() - said["least"], 0.0)
    text = f"{note}: {said['least']:.5g} for {finer.min():.5g} g, at {said['least_at_mm']} mm"
    results = [Result(WEAKEST, name, outside / top, SCHEME_PART, True, text)]
    worst = abs(coarse.max() - said["most"]) / top
    text = f"most {said['most']:.5g} for {coarse.max():.5g}"
    for key, part in (("tenth", 0.1), ("median", 0.5)):
        low, high = seen.quantile(coarse, part)
        off = max(low - said[key], said[key] - high, 0.0) / top
        if off > worst:
            worst, text = off, f"{key} {said[key]:.5g} for {low:.5g} to {high:.5g} g"
    results.append(Result(SPREAD, name, worst, SCHEME_PART, True, f"{note}: {text}"))
    level = 0.1 * said["most"]
    low, high = (seen.share[coarse < level + side * room].sum() for side in (-1, 1))
    off = max(low - said["dead"], said["dead"] - high, 0.0)
    results.append(Result(SPREAD, name, off, seen.doubt, True, f"{note}: dead {said['dead']:.4f} for {low:.4f} to {high:.4f}"))
    return results


def _rigid(context, motion, scheme):
    """The part of the mean square that translation and rotations have: all of the surface, by Gauss' rule."""
    if scheme["rigid"] is None or not motion.drives:
        return not_comparable(RIGID, context.name, "nothing moves")
    points, weights = motion.surface.rule(motion.max_hz, 1.5)
    root = np.sqrt(weights)
    columns = [np.ones(len(points)), points[:, 0]] + ([] if context.scene.is_bar else [points[:, 1]])
    basis = np.linalg.qr(root[:, None] * np.column_stack(columns))[0]
    field = motion.phasors(points) * root
    whole = (np.abs(field) ** 2).sum()
    own = (np.abs(field @ basis) ** 2).sum() / whole if whole > 0 else 0.0
    return Result(RIGID, context.name, abs(own - scheme["rigid"]), RIGID_PART, True, f"{scheme['scheme']}: {scheme['rigid']:.4f} for {own:.4f}")


def _every_touch(context, grid, seen, maps, there, said):
    """With a setting for every touch: at most what nothing exceeds; with distinct frequencies, of which the program says that none are
    better, at least what is had for sure at every point, and what the map has."""
    name, results = context.name, []
    per_newton = np.abs(grid.responses.at(seen.points))
    strong = grid.sure_force().max(axis=2)
    most = np.stack([force_amplitude(era, era.max_voltage, widest_pulse(grid.grid_hz), grid.grid_hz) for era in context.scene.actuators], axis=1)
    utmost = (per_newton * most[:, :, None]).max(axis=0).sum(axis=0) / STANDARD_GRAVITY_M_S2
    alone = (per_newton * strong[:, :, None]).max(axis=(0, 1)) / STANDARD_GRAVITY_M_S2
    nothing = np.zeros_like(alone)
    for scheme, sure in zip(said, (nothing, nothing, alone)):
        spread = scheme["per_touch"]
        ends = ((spread["least"], sure.min(), utmost.min()), (spread["most"], sure.max(), utmost.max()))
        off = max(0.0, *(max((low - value) / max(low, NOTHING_G), (value - high) / max(high, NOTHING_G)) for value, low, high in ends))
        note = f"{scheme['scheme']}: {spread['least']:.4g} to {spread['most']:.4g} g, sure {sure.min():.4g} to {sure.max():.4g}, at most {utmost.min():.4g} to {utmost.max():.4g}"
        results.append(Result(TOUCH, name, off, TOLERANCE, True, note))
    own = np.array([maps["strongest_g"][k] for k in there])
    spread = said[2]["per_touch"]
    off = max(abs(spread["least"] - own.min()), abs(spread["most"] - own.max())) / max(own.max(), 1e-300)
    results.append(Result(SAME, name, off, 1e-9, True, f"{spread['least']:.6g} for {own.min():.6g} g"))
    return results


def _alternatives(context, grid, seen, said):
    """Settings that surely keep every limit: none may have a larger least peak than the bound that is said for distinct
    frequencies, on the lattice where the program looks for it."""
    at_most = said[2]["one_setting_at_most"]
    if at_most is None:
        return [not_comparable(BELOW, context.name, "no bound")]
    own, found = best_everywhere(grid, seen.points, seen.finer, context.rng("reach: alternatives"), DRAWN)
    if own <= NOTHING_G:
        return [not_comparable(BELOW, context.name, "nothing for sure")]
    return [Result(BELOW, context.name, max(1 - at_most / own, 0.0), TOLERANCE, True, f"{own:.5g} g at {found} Hz for at most {at_most:.5g}")]
