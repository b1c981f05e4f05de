"""What `era plan` says of requests that cannot be met in full (`trade`), of targets with time windows, and of why a plan is what it is.

Points of a trade have no drives: that they can be had is seen by asking for them, and recomputing what the plan that comes does.
"""

from dataclasses import replace

import numpy as np

from ..harness import Result, not_comparable
from ..reference.electrostatics import coefficients, force_amplitude, harmonic_ratio, widest_pulse
from ..reference.perception import STANDARD_GRAVITY_M_S2
from ..reference.planner import GRID_HZ, Grid, Motion, Responses, drives_of, odd_harmonics
from ..reference.surface import Surface

ALONE, CURVE, ZONES, BEST = "trade: alone", "trade: targets", "trade: quiet zones", "trade: none better than the plan"
SPANS, PEAKS, OWN = "windows: stretches", "windows: peaks", "windows: plan of its own"
WIDTHS, CONTRASTS, REACHES, OTHERS = "explain: pulse widths", "explain: candidates", "explain: candidates' reach", "explain: alternatives"
QUANTITIES = (ALONE, CURVE, ZONES, BEST, SPANS, PEAKS, OWN, WIDTHS, CONTRASTS, REACHES, OTHERS)
PLANTS = dict.fromkeys(QUANTITIES, "answer")
EVERY, FIRST = 10, 6
# How often explanations that take longer are asked for.
ONE_MORE_EVERY = 30
MAX_HZ = 400.0
# Every point of a trade is a plan that has been made; a plan's last scaling, where moving masses ask for one, is right to a thousandth, and
# so is what counts as had.
HAD = 2e-3
# Beyond this, of the fields' bound or of the reference's own error, too little is known.
USEFUL = 0.02
# A search that has ended before it had proven its choice may find another from another wish.
PROVEN = 1e-9
# Levels in dB of single actuators: mean squares by quadrature, as `plan: contrast`, harmonics to 2 % where there are any.
LEVEL_DB, WIDTH_DB = 0.1, 0.2
# Relative, of what an actuator reaches alone: what is had for sure, and what nothing exceeds.
REACH = 0.01

# Of the alternatives those that are soon made: the options that ask for them.
ALTERNATIVES = {
    "objective power": ("--objective", "power"),
    "one shared frequency, with phases": ("--grouping", "shared"),
}


def run(context):
    """One request of two targets, one with a quiet zone, one with windows; explanations where they are soon had."""
    rng, scene = context.rng("wishes"), context.scene
    places = [context.random_point(rng) for _ in range(3)]
    results = []
    whole = context.era.json("plan", *at(places[0]), "--intensity-g", "1000")
    strong = whole["predicted"]["target_peak_g"]
    if strong < 1e-6:
        return [not_comparable(ALONE, context.name, "nothing moves")]
    results += targets(context, places, strong)
    results += zones(context, rng, places, strong)
    results += windows(context, rng, places, 0.3 * strong)
    # With a channel left one more actuator is tried at three or nine places, each a table of its own; and the least peak over a plate with
    # three or four takes a minute.
    due = context.index % ONE_MORE_EVERY == FIRST and len(scene.actuators) <= 2 or scene.is_bar and len(scene.actuators) == 4
    if due or context.plant in (WIDTHS, CONTRASTS, REACHES, OTHERS):
        results += explained(context, places[0], 0.05 * strong)
    return results


def at(place):
    """A place as arguments."""
    return "--at", f"{place[0] * 1e3!r},{place[1] * 1e3!r}", "--unit", "mm"


def also(place, peak_g, window=""):
    """One more target as arguments."""
    return "--also", f"{place[0] * 1e3!r},{place[1] * 1e3!r}:{peak_g!r}{window}"


def peaks(context, plan, places):
    """What the drives of a plan do at places in g, and how far that may be off: the program's bound and the reference's own error."""
    panel = context.panel(MAX_HZ)
    drives = drives_of(context.scene, plan["drives"])
    if not any(drive.force > 0 for drive in drives) or plan["error_bound"] is None:
        return np.zeros(len(places)), np.inf
    surface = Surface(context.scene)
    own, rough = (Motion(model, drives, surface).peaks_g(places) for model in (panel.fine, panel.coarse))
    return own, plan["error_bound"] + 2 * (np.abs(own - rough) / np.maximum(own, 1e-300)).max() + 2e-6


def asked(context, places, peaks_g, *words):
    """The plan for peaks at places: a hundred-thousandth less, as what is written is read with rounding."""
    first, *others = [(place, float(peak) * (1 - 1e-5)) for place, peak in zip(places, peaks_g)]
    more = [word for place, peak in others for word in also(place, peak)]
    return context.era.json("plan", *at(first[0]), "--intensity-g", repr(first[1]), *more, *words)


def refined(context, plan, places):
    """How much the plan's peaks gain, relative, from frequencies between the grid's. By as much, or so, a choice that is the best of
    the grid's may be behind another: these are not part of the gap (docs/src/planner-internals.md, "The optimality gap")."""
    drives = drives_of(context.scene, plan["drives"])
    fields = [Motion(context.panel(MAX_HZ).fine, own).peaks_g(places) for own in (drives, [replace(d, frequency=float(np.round(d.frequency))) for d in drives])]
    return np.abs(fields[0] / np.maximum(fields[1], 1e-300) - 1).max()


def had(context, quantity, places, claimed_g, plan, note):
    """Whether a plan's drives give at least the peaks that are claimed."""
    own, error = peaks(context, plan, places)
    if error > USEFUL:
        return not_comparable(quantity, context.name, f"known to {error:.1e}")
    if plan["optimality_gap"] > PROVEN:
        return not_comparable(quantity, context.name, f"gap {plan['optimality_gap']:.1e}")
    claimed_g = np.asarray(claimed_g)
    short = max(0.0, (1 - own / np.maximum(claimed_g, 1e-300))[claimed_g > 1e-9].max(initial=0.0))
    return Result(quantity, context.name, short, HAD + error + refined(context, plan, places), True, f"{note}: {own} for {claimed_g} g")


def targets(context, places, strong):
    """Two targets that are both to have what the first can have alone, and twice that."""
    wanted, pair = [strong, 2 * strong], places[:2]
    plan = context.era.json("plan", *at(pair[0]), "--intensity-g", repr(wanted[0]), *also(pair[1], wanted[1]))
    trade = plan.get("trade")
    if trade is None:
        wrong = plan["limited_by"] is not None
        return [Result(CURVE, context.name, float(wrong), 0.0, True, "no trade")]
    results = []
    for number, (place, wish) in enumerate(zip(pair, wanted)):
        single = context.era.json("plan", *at(place), "--intensity-g", repr(wish))
        own, error = peaks(context, single, [place])
        said = trade["alone_g"][number] * (1.05 if context.planted(ALONE) else 1.0)
        if error > USEFUL:
            results.append(not_comparable(ALONE, context.name, f"known to {error:.1e}"))
        else:
            expected = min(own[0], wish)
            results.append(Result(ALONE, context.name, abs(said / max(expected, 1e-300) - 1), HAD + error, True, f"{said:.5g} for {expected:.5g} g"))
    results.append(best(context, plan))
    curve = trade["targets"][0]
    if context.planted(CURVE):
        curve["points"][5]["others_part"] *= 1.02
        curve["points"][5]["peaks_g"][1 - curve["target"]] *= 1.02
    return results + [shape(context, trade, curve)] + points(context, pair, trade, curve)


def best(context, plan):
    """If a point gives every target a larger part of its wish than the plan does, it is the plan (docs/src/planner.md, "The trade")."""
    wanted = np.array([target["wanted_g"] for target in plan["targets"]])
    least = lambda peaks_g: (np.asarray(peaks_g) / wanted).min()
    own = least([target["peak_g"] for target in plan["targets"]]) * (0.9 if context.planted(BEST) else 1.0)
    most = max((least(point["peaks_g"]) for curve in plan["trade"]["targets"] for point in curve["points"]), default=0.0)
    return Result(BEST, context.name, max(0.0, most / own - 1), HAD, True, f"{most:.6g} of a wish for the plan's {own:.6g}; {plan['limited_by']}")


def shape(context, trade, curve):
    """A curve's parts follow from its peaks, go from nothing to all in steps of a tenth, and the others' never rise."""
    target, worst, note = curve["target"], 0.0, ""
    alone = np.array(trade["alone_g"])
    before = 1.0
    for number, point in enumerate(curve["points"]):
        part = np.array(point["peaks_g"]) / np.maximum(alone, 1e-300)
        others = min(1.0, min(np.delete(part, target)))
        off = max(
            abs(point["part"] - number / 10),
            max(0.0, point["part"] - part[target] - 1e-3),
            abs(point["others_part"] - others),
            max(0.0, point["others_part"] - before),
        )
        before = point["others_part"]
        if off >= worst:
            worst, note = off, f"{point}"
    if len(curve["points"]) != 11:
        worst = np.inf
    return Result(CURVE, context.name, worst, 1e-9 + HAD, True, note)


def points(context, pair, trade, curve):
    """Two points of the curve, asked for."""
    results = []
    for number in (3, 5):
        point = curve["points"][number]
        plan = asked(context, pair, point["peaks_g"])
        results.append(had(context, CURVE, pair, point["peaks_g"], plan, f"{point['part']} of one"))
        if plan.get("trade"):
            results.append(best(context, plan))
    return results


def zones(context, rng, places, strong):
    """One target with a quiet zone that limits it: its limits doubled again and again, and none."""
    radius, limit = float(np.round(rng.uniform(3, 20), 1)), float(f"{0.02 * strong:.3g}")
    spared, wish = places[2], 0.5 * strong
    quiet = lambda most: ("--quiet", f"{spared[0] * 1e3!r},{spared[1] * 1e3!r}:{radius!r}:{most!r}")
    plan = context.era.json("plan", *at(places[0]), "--intensity-g", repr(wish), *quiet(limit))
    trade = plan.get("trade")
    if trade is None or not trade["quiet"]:
        return [not_comparable(ZONES, context.name, f"limited by {plan['limited_by']}")]
    given = trade["quiet"]
    if context.planted(ZONES):
        given[1]["peaks_g"][0] *= 1.05
        given[1]["part"] *= 1.05
    worst, expected = 0.0, limit
    for point in given:
        worst = max(worst, abs(point["part"] - min(1.0, point["peaks_g"][0] / wish)))
        if point is given[-1]:
            worst = max(worst, float(point["at_most_g"] is not None))
        else:
            worst = max(worst, abs(point["at_most_g"][0] / expected - 1))
            expected = 2 * max(expected, 1e-3)
    results = [Result(ZONES, context.name, worst, HAD, True, f"{len(given)} points")]
    for point in (given[1], given[-1]):
        words = () if point["at_most_g"] is None else quiet(point["at_most_g"][0])
        again = asked(context, places[:1], point["peaks_g"], *words)
        results.append(had(context, ZONES, places[:1], point["peaks_g"], again, f"at most {point['at_most_g']}"))
    return results


def windows(context, rng, places, peak_g):
    """Two targets with random windows: the stretches by own reckoning, each with the plan that its targets have by themselves."""
    name = context.name
    times = [sorted(rng.choice(np.arange(0, 1001, 50), 2, replace=False)) for _ in range(2)]
    wishes = [(places[0], peak_g), (places[1], 0.5 * peak_g)]
    first, second = (f"{a}-{b}" for a, b in times)
    answer = context.era.json("plan", *at(places[0]), "--intensity-g", repr(peak_g), "--window", first, *also(places[1], 0.5 * peak_g, f":{second}"))
    note = f"{first} and {second} ms"
    borders = sorted({0, *map(int, times[0]), *map(int, times[1])})
    spans = []
    for a, b in zip(borders, borders[1:]):
        active = [n for n, (start, end) in enumerate(times) if start <= a and b <= end]
        if spans and spans[-1][2] == active:
            spans[-1][1] = b
        else:
            spans.append([a, b, active])
    stretches = answer["stretches"]
    if context.planted(SPANS):
        stretches[-1]["to_ms"] += 1.0
    if context.planted(OWN):
        driven = next(s for s in stretches if s["plan"])["plan"]["drives"]
        driven[0]["frequency_hz"] += 1.0
    got = [[s["from_ms"], s["to_ms"], s["targets"]] for s in stretches]
    begins = [s for s in stretches if s["targets"][:1] == [0]]
    right = got == spans and all((s["plan"] is None) == (not s["targets"]) for s in stretches) and answer["drives"] == begins[0]["plan"]["drives"]
    results = [Result(SPANS, name, float(not right and not context.planted(OWN)), 0.0, True, f"{note}: {got} for {spans}")]
    for stretch in stretches:
        if stretch["plan"] is None:
            continue
        plan, own = stretch["plan"], [wishes[n] for n in stretch["targets"]]
        there = [place for place, _ in own]
        moved, error = peaks(context, plan, there)
        said = np.array([target["peak_g"] for target in plan["targets"]])
        if context.planted(PEAKS):
            said *= 1.01
        if error > USEFUL:
            results.append(not_comparable(PEAKS, name, f"known to {error:.1e}"))
        else:
            results.append(Result(PEAKS, name, np.abs(said - moved).max() / moved.max(), error, True, f"{note}: {said} for {moved} g"))
        alone = context.era.json("plan", *at(own[0][0]), "--intensity-g", repr(own[0][1]), *[word for place, peak in own[1:] for word in also(place, peak)])
        if plan["optimality_gap"] > PROVEN:
            results.append(not_comparable(OWN, name, f"gap {plan['optimality_gap']:.1e}"))
            continue
        keys = ("frequency_hz", "voltage_v", "pulse_width", "phase_rad", "force_n")
        off = max(abs(a[key] - b[key]) / max(abs(b[key]), 1e-12) if a[key] != b[key] else 0.0 for a, b in zip(plan["drives"], alone["drives"]) for key in keys)
        results.append(Result(OWN, name, off, 1e-9, True, f"{note}: targets {stretch['targets']}"))
    return results


def explained(context, place, peak_g):
    """Pulse widths, and each actuator's candidates, of a weak plan."""
    name, scene = context.name, context.scene
    plan = context.era.json("plan", *at(place), "--intensity-g", repr(peak_g), "--explain")
    explanation = plan["explanations"][0]
    if context.planted(WIDTHS):
        explanation["pulse_widths"][0]["harmonics_db"] = (explanation["pulse_widths"][0]["harmonics_db"] or 0.0) + 1.0
    panel = context.panel(1000.0)
    drives = [drive for drive in drives_of(scene, plan["drives"]) if drive.force > 0]
    if not drives or plan["error_bound"] is None or plan["error_bound"] > USEFUL:
        return [not_comparable(WIDTHS, name, f"bound {plan['error_bound']}")]
    surface = Surface(scene)
    points, weights = surface.rule(1000.0)
    results = []
    fundamental, lines = 0.0, []
    for drive in drives:
        orders = [1, *odd_harmonics(drive.frequency)]
        squares = Responses(panel.fine, np.array(orders) * drive.frequency).integral(points, weights)[:, drive.actuator] * drive.force**2
        fundamental += squares[0]
        lines += ((scene.actuators[drive.actuator], drive.frequency, n, square) for n, square in zip(orders[1:], squares[1:]))
    for said in explanation["pulse_widths"]:
        width = said["pulse_width"]
        square = sum(harmonic_ratio(actuator, width, hz, n) ** 2 * value for actuator, hz, n, value in lines)
        own = 10 * np.log10(square / fundamental) if square > 0 else None
        # Of the most that there is at a voltage, 4/pi of an electrode's steady force: the mean over the drives.
        each = [np.abs(coefficients(scene.actuators[drive.actuator], width, drive.frequency, 1)) * np.pi / 4 for drive in drives]
        off = abs(said["force"] - np.mean(each)) * 1e6
        # A harmonic that a width drops is rounding.
        if (own is None or own < -200) and (said["harmonics_db"] is None or said["harmonics_db"] < -200):
            own = said["harmonics_db"] = 0.0
        off = np.inf if own is None or said["harmonics_db"] is None else max(off, abs(own - said["harmonics_db"]))
        results.append(Result(WIDTHS, name, off, WIDTH_DB, True, f"width {width:.3g}: {said['harmonics_db']} for {own} dB"))
    results += candidates(context, place, explanation)
    for change, words in ALTERNATIVES.items():
        told = [other for other in explanation["alternatives"] if other["change"] == change]
        if told:
            results.append(alternative(context, place, peak_g, told[0], words))
    return results


def alternative(context, place, peak_g, told, words):
    """An alternative against the plan that is made when it is asked for: its peak and contrast recomputed, its power 2 C V^2 f."""
    name = context.name
    plan = context.era.json("plan", *at(place), "--intensity-g", repr(peak_g), *words)
    panel, surface = context.panel(MAX_HZ), Surface(context.scene)
    drives = drives_of(context.scene, plan["drives"])
    own, rough = (Motion(model, drives, surface) for model in (panel.fine, panel.coarse))
    if not own.drives or plan["error_bound"] is None or plan["error_bound"] > USEFUL:
        return not_comparable(OTHERS, name, f"bound {plan['error_bound']}")
    if context.planted(OTHERS):
        told["power_mw"] *= 1.05
    (mean, contrast), (_, other) = own.means([place]), rough.means([place])
    peak, bound = own.peaks_g([place])[0], plan["error_bound"]
    # In units of what each may be off by: the bound, the tolerance of `plan: contrast` with the bound's levels, and a millionth.
    levels = LEVEL_DB + 8.69 * bound * (1 + peak / max(mean, 1e-300)) + 2 * abs(contrast - other)
    parts = (
        abs(told["target_peak_g"] / peak - 1) / (bound + 2 * abs(rough.peaks_g([place])[0] / peak - 1) + 2e-6),
        abs(told["contrast_db"] - contrast) / levels,
        abs(told["power_mw"] / (own.power_w() * 1e3) - 1) / 1e-6,
    )
    note = f"{told} for {peak:.5g} g, {contrast:.4g} dB, {own.power_w() * 1e3:.6g} mW"
    return Result(OTHERS, name, max(parts), 1.0, True, note)


def candidates(context, place, explanation):
    """Contrast of every frequency that is told, and the best one over the band; what is reached there."""
    name, scene = context.name, context.scene
    grid = Grid(context.panel(400.0).fine, context.panel(1000.0).fine, context.press())
    near, weights = grid.surface.near(*place, GRID_HZ.max())
    close = grid.responses.integral(near, weights) / weights.sum()
    peak, rest = grid.target(place)
    elsewhere = (rest[:, :, None] + grid.harmonics[0]).min(axis=2)
    results = []
    for number, told in enumerate(explanation["candidates"]):
        actuator = scene.actuators[number]
        with np.errstate(divide="ignore", invalid="ignore"):
            contrast = 10 * np.log10(close[:, number] / elsewhere[:, number])
        if context.planted(CONTRASTS) and number == 0 and told["frequencies"]:
            told["frequencies"][0]["contrast_db"] += 1.0
        if not np.isfinite(contrast).any() or not told["frequencies"]:
            results.append(not_comparable(CONTRASTS, name, f"{actuator.id} moves nothing"))
            continue
        best = max(f["contrast_db"] for f in told["frequencies"])
        off, note = abs(best - np.nanmax(contrast)), f"best {best:.4g} for {np.nanmax(contrast):.4g} dB"
        for frequency in told["frequencies"]:
            k = int(round(frequency["frequency_hz"] - GRID_HZ[0]))
            own = contrast[k]
            if abs(own - frequency["contrast_db"]) > off:
                off, note = abs(own - frequency["contrast_db"]), f"{frequency['frequency_hz']} Hz: {frequency['contrast_db']:.5g} for {own:.5g} dB"
            most = peak[k, number] * force_amplitude(actuator, actuator.max_voltage, widest_pulse(GRID_HZ[k]), GRID_HZ[k]) / STANDARD_GRAVITY_M_S2
            sure = peak[k, number] * grid.sure_force()[k, number].max() / STANDARD_GRAVITY_M_S2
            reach = frequency["reach_g"] * (10 if context.planted(REACHES) else 1)
            over = max(reach / max(most, 1e-300) - 1, 1 - reach / max(sure, 1e-300), 0.0)
            results.append(Result(REACHES, name, over, REACH, True, f"{actuator.id}, {frequency['frequency_hz']} Hz: {reach:.4g} g in {sure:.4g} to {most:.4g}"))
        results.append(Result(CONTRASTS, name, off, LEVEL_DB, True, f"{actuator.id}, {note}"))
    return results
