"""`era plan`, `POST /v1/touch`, `era touch`: what the printed drives do, by own receptances, against what is said of them."""

import json

import numpy as np

from ..harness import Result, change, change_all, not_comparable
from ..reference.electrostatics import BREAKDOWN_PART, SUPPLY_A, TRAVEL_PART, breakdown_v, force_amplitude
from ..reference.perception import STANDARD_GRAVITY_M_S2, threshold_g
from ..reference.planner import Motion, broken_limits, drives_of
from ..reference.ringing import Ringing
from ..reference.surface import Surface

SOFT, HARD, MEAN, CONTRAST = "plan: softened peak", "plan: target peak", "plan: mean elsewhere", "plan: contrast"
FELT, FORCE, LIMITS, TRAVEL = "plan: above threshold", "plan: force of a voltage", "plan: limits", "plan: travel and breakdown"
QUIET, QUIET_HARMONICS, HARMONICS = "plan: quiet zones", "plan: quiet zones' harmonics", "plan: harmonics"
WAVEFORM, STRONGEST, NAMED = "plan: waveform's peak", "plan: strongest harmonic", "plan: quiet zones named"
POWER, CURRENT, RISE, DECAY, SAME, HTTP = "plan: power", "plan: supply current", "plan: rise", "plan: decay", "plan: same again", "plan: HTTP and touch"

stiffer = change(("surface", "material", "youngs_modulus_pa"), 1.03)
QUANTITIES = (HARD, SOFT, MEAN, CONTRAST, FELT, FORCE, LIMITS, TRAVEL, QUIET, QUIET_HARMONICS, HARMONICS, WAVEFORM, STRONGEST, NAMED, POWER, CURRENT, RISE, DECAY, SAME, HTTP)
PLANTS = {
    HARD: stiffer,
    SOFT: change_all("actuator", "air_gap_um", 0.98),
    MEAN: stiffer,
    CONTRAST: stiffer,
    FELT: stiffer,
    FORCE: change_all("actuator", "electrode_area_mm2", 1.001),
    LIMITS: change_all("actuator", "max_voltage_v", 1.02),
    TRAVEL: change_all("actuator", "air_gap_um", 1.25),
    QUIET: stiffer,
    QUIET_HARMONICS: "answer",
    HARMONICS: stiffer,
    WAVEFORM: "answer",
    STRONGEST: "answer",
    NAMED: "answer",
    POWER: change_all("actuator", "electrode_area_mm2", 1.02),
    CURRENT: "answer",
    RISE: "answer",
    DECAY: "answer",
    SAME: "answer",
    HTTP: "answer",
}
# Whether a scene's turn at what costs more: the daemon, power (`--explain`), times.
HTTP_EVERY, POWER_EVERY, TIMES_EVERY = 3, 10, 5
# Forces in moving gaps have harmonics, which come back to the fundamentals: a panel for the drives' 400 Hz is not enough.
MAX_HZ = 1000.0
# The reference's own error beyond which it says too little, relative.
USEFUL = 2e-3
# Two meshes may agree by chance: the least that it is taken for.
FLOOR = 2e-6

# Peaks below this are rounding, the program's and the reference's: a ten-thousandth of what is felt at best (1e-3 g).
NOTHING_G = 1e-7

# The same of a harmonic's level above its threshold, in dB.
NOTHING_DB = -110.0

# Tolerances of what has no printed bound.
# Of what softening changes, line by line (in the sum changes may cancel): harmonic balance against averages.
SOFTENING = 0.05
# Contrast in dB: mean squares by Gauss' rule on both sides, the program's of r^2 log r around its actuators to four digits.
# The mean of the peak, relative: the program's rule takes twelve points per wave, h k = 0.52. At a kink, where a modulus passes through
# zero, it is off by (h k)^2 / 12 = 2.3 % of half a wave at worst, if a point is on it, and by half that the other way between two; on
# several half waves, and on the rows of a plate, kinks fall differently.
MEAN_TOLERANCE, CONTRAST_TOLERANCE = 0.01, 0.05
# The plan's forces are scaled down in steps of a thousandth until the supply delivers enough: current goes with the force's root. 4 of
# 500 uA are left to the board's rounding.
SUPPLY_LEFT = 2e-3 + 4 / 500
# A crest of a quiet zone may lie between the points that the program looks at (docs/src/planner.md, "Quiet zones").
ZONE_TOLERANCE = 0.02
# A zone is at its limit to the steps in which forces are scaled down.
FULL = 2e-3
# Thresholds of rise and decay are met up to this part of the peak; then times to this part, and to so many seconds.
LEVEL, TIME_RELATIVE, TIME_S = 0.01, 0.02, 5e-4


class Wish:
    """A random request: arguments of the command line, and the same as a body over HTTP."""

    def __init__(self, context, rng):
        scene = context.scene
        self.place = self._pixel(context, rng)
        self.intensity = float(rng.choice([0.02, 0.1, 0.5, 2.0, 20.0], p=[0.2, 0.25, 0.25, 0.15, 0.15]))
        self.kind = str(rng.choice(["one", "two", "quiet", "shared", "power", "felt"], p=[0.4, 0.1, 0.2, 0.15, 0.1, 0.05]))
        x, y = self.place
        self.arguments = ["--at", f"{x!r},{y!r}", "--intensity-g", repr(self.intensity)]
        self.body = {"x_px": x, "y_px": y, "intensity_g": self.intensity}
        if self.kind == "two":
            also = self._pixel(context, rng)
            self.arguments += ["--also", f"{also[0]!r},{also[1]!r}:{self.intensity / 2!r}"]
            self.body["also"] = [{"x_px": also[0], "y_px": also[1], "intensity_g": self.intensity / 2}]
        if self.kind == "quiet":
            spared, radius = self._pixel(context, rng), float(np.round(rng.uniform(2, 40), 1))
            most = self.intensity * float(rng.choice([0.02, 0.2, 1.0]))
            self.arguments += ["--quiet", f"{spared[0]!r},{spared[1]!r}:{radius!r}:{most!r}"]
            self.body["quiet"] = [{"x_px": spared[0], "y_px": spared[1], "radius_mm": radius, "at_most_g": most}]
        if self.kind == "shared":
            self.arguments += ["--grouping", "shared"]
            self.body["grouping"] = "shared"
        if self.kind == "power":
            self.arguments += ["--objective", "power"]
            self.body["objective"] = "power"
        if self.kind == "felt":
            self.arguments += ["--weigh", "felt"]
            self.body["weigh"] = "felt"

    def _pixel(self, context, rng):
        """A random pixel on the surface; the pixel of a bar's axis where it is within the screen."""
        scene = context.scene
        for _ in range(1000):
            x, y = rng.uniform(0, scene.screen.width_px), rng.uniform(0, scene.screen.height_px)
            place = scene.screen.to_m(x, y)
            if not scene.in_cutout(*place):
                return float(np.round(x, 2)), float(np.round(y, 2))
        raise ValueError("no surface found")

    def place_m(self, scene):
        """The touched place on the surface."""
        x, y = scene.screen.to_m(*self.place)
        return x, scene.width / 2 if scene.is_bar else y


def run(context):
    """Compares one random plan, and everything that is said of it."""
    rng, name = context.rng("plan"), context.name
    wish = Wish(context, rng)
    explained = context.index % POWER_EVERY == 0 and len(context.scene.actuators) <= 2 or context.planted(POWER)
    plan = context.era.json("plan", *wish.arguments)
    target = wish.place_m(context.scene)
    placed = np.abs(np.array(plan["target_mm"]) * 1e-3 - target).max()
    if placed > 1e-9 * context.scene.length:
        return [Result(HARD, name, np.inf, 0, True, f"target at {plan['target_mm']}, not {target}")]
    if any(context.planted(quantity) for quantity in (QUIET_HARMONICS, RISE, DECAY, CURRENT, WAVEFORM, STRONGEST, NAMED)):
        spoil(context, plan)
    results = figures(context, wish, plan, target)
    again = context.era.json("plan", *wish.arguments)
    if context.planted(SAME):
        again["drives"][0]["voltage_v"] *= 1 + 1e-9
    results.append(Result(SAME, name, float(stripped(again) != stripped(plan)), 0.0, True, wish.kind))
    if explained:
        results.append(power(context, wish))
    if context.index % HTTP_EVERY == 1 or context.planted(HTTP):
        results += over_http(context, wish, plan)
    return results


def spoil(context, plan):
    """Mistakes in the answer itself."""
    if context.planted(CURRENT):
        # Another limit's plan, said to be the supply's.
        plan["limited_by"] = "supply"
    if context.planted(NAMED) and plan["limited_by"] is not None:
        plan["limited_by"] = "voltage of era0"
    if context.planted(QUIET_HARMONICS):
        for zone in plan["quiet"]:
            zone["harmonics_g"] *= 0.9
    details = plan.get("details")
    if context.planted(WAVEFORM) and details:
        # As if the harmonics had been left out.
        details["waveform_peak_g"] -= details["harmonics_g"]
    if context.planted(STRONGEST) and details and details["strongest_harmonic_db"] is not None:
        # As if its part of the peak, not of the force's amplitude, were meant.
        details["strongest_harmonic_db"] += 3.01
    for quantity, key in ((RISE, "reaches_90_ms"), (DECAY, "decays_to_10_ms")):
        if context.planted(quantity) and plan["details"][key] is not None:
            plan["details"][key] = plan["details"][key] * 1.3 + 3


def stripped(plan):
    """A plan without what may differ from one run to the next: how long it took."""
    return {key: value for key, value in plan.items() if key != "elapsed_us"}


def figures(context, wish, plan, target):
    """All comparisons of one plan."""
    name, scene, said = context.name, context.scene, plan["predicted"]
    panel = context.panel(MAX_HZ)
    surface = Surface(scene)
    drives = drives_of(scene, plan["drives"])
    fine, coarse = (Motion(model, drives, surface) for model in (panel.fine, panel.coarse))
    results = [force_law(context, drives), supply(context, fine, plan)]
    note = f"{wish.kind}, {wish.intensity} g at {target[0] * 1e3:.5g},{target[1] * 1e3:.5g} mm"
    wrong = broken_limits(fine)
    results.append(Result(LIMITS, name, float(len(wrong)), 0.0, True, f"{note}; {'; '.join(wrong)}" if wrong else note))
    peak = said["target_peak_g"]
    if not fine.drives or max(peak, fine.peaks_g([target])[0]) <= NOTHING_G:
        return [*results, not_comparable(HARD, name, "nothing moves")]

    def compare(quantity, own, other, printed, allowed, scale):
        """Own answer (and that of the coarser mesh) against the printed one; `allowed` and `scale` absolute."""
        error = 2 * abs(own - other) + FLOOR * abs(scale)
        if error > USEFUL * 5 * abs(scale):
            results.append(not_comparable(quantity, name, f"own error {error / abs(scale):.1e}"))
        else:
            results.append(Result(quantity, name, abs(printed - own) / scale, (allowed + error) / scale, True, note))

    wanted, rough = fine.peaks_g([target])[0], coarse.peaks_g([target])[0]
    bound = plan["error_bound"]
    if bound is None:
        # Said to be: the panel's levels do not agree, which is so at resonances that next to nothing damps.
        return [*results, not_comparable(HARD, name, "no bound")]
    compare(HARD, wanted, rough, peak, bound * peak, peak)
    # A field that is weak at the target is known less well elsewhere: the bound is about the target's peak.
    targets = [np.array([place["x_mm"], place["y_mm"]]) * 1e-3 for place in plan["targets"]]
    (mean, contrast), (rough_mean, rough_contrast) = fine.means(targets), coarse.means(targets)
    # The bound is about the target; elsewhere the same models are off by as much of the target's peak.
    compare(MEAN, mean, rough_mean, said["mean_elsewhere_g"], MEAN_TOLERANCE * mean + bound * peak, mean)
    levels = 8.69 * bound * (1 + peak / mean)
    compare(CONTRAST, contrast, rough_contrast, said["contrast_db"], CONTRAST_TOLERANCE + levels, 10.0)
    amplitudes = np.abs(fine.phasors([target])[:, 0]) / STANDARD_GRAVITY_M_S2
    # What an error of the bound does to the level, if all of it is at the frequency that is felt best.
    levels = amplitudes / threshold_g(fine.frequencies)
    felt = 8.69 * bound * peak / threshold_g(fine.frequencies).min() / levels.sum()
    compare(FELT, fine.above_threshold_db(target), coarse.above_threshold_db(target), said["above_threshold_db"], felt + 8.69 * FLOOR, 1.0)
    found, soft = softened(context, fine, coarse, target, said, bound, compare, note)
    results += found
    details = plan.get("details")
    harmonics, rough_harmonics = (motion.harmonics_g([target])[0] for motion in (fine, coarse))
    # Harmonics have a bound of their own: they lie above the band of the plan's.
    their_bound = details["harmonics_error_bound"] if details is not None else None
    if details is not None and harmonics > 1e-6 * peak:
        if their_bound is None:
            results.append(not_comparable(HARMONICS, name, "no bound"))
        else:
            compare(HARMONICS, harmonics, rough_harmonics, details["harmonics_g"], their_bound * harmonics, harmonics)
        compare_lines(context, fine, coarse, target, details, results, note)
    if details is not None and soft is not None and (their_bound is not None or harmonics <= 1e-6 * peak):
        own, other, off = soft
        whole = own + harmonics
        off += (their_bound or 0.0) * harmonics
        # From below: in moving gaps the springs pulsate and add to the third and fifth harmonic, at a resonance as much as there is
        # of the rest. What is said to be the most is held in time, too (`travel.py`).
        compare(WAVEFORM, whole, other + rough_harmonics, min(details["waveform_peak_g"], whole), off, whole)
    results += zones(context, fine, coarse, plan, note) + named(context, plan, note)
    if details is not None and (context.index % TIMES_EVERY == 2 or context.plant in (RISE, DECAY)):
        # Times to a part of the peak say nothing where either side knows the peak to no better than that.
        off = 2 * abs(wanted - rough) / peak + bound
        if off <= LEVEL:
            results += times(context, drives, target, details, note)
        else:
            results += [not_comparable(quantity, name, f"peak known to {off:.1e}") for quantity in (RISE, DECAY)]
    return results


def force_law(context, drives):
    """Forces by the contract's law from voltage and pulse width."""
    worst = 0.0
    for drive in drives:
        expected = force_amplitude(context.scene.actuators[drive.actuator], drive.voltage, drive.pulse_width, drive.frequency)
        worst = max(worst, abs(drive.force - expected) / max(drive.force, expected, 1e-300))
    return Result(FORCE, context.name, worst, 1e-9)


def supply(context, motion, plan):
    """Mean current that charges all electrodes, 2 C V f each, and of the bleeders, as a part of what the supply delivers. Where that is said
    to limit the plan it is to be used up."""
    part = motion.current_a() / SUPPLY_A
    short = max(0.0, 1 - part - SUPPLY_LEFT) if "supply" in (plan["limited_by"] or "") else 0.0
    return Result(CURRENT, context.name, max(part, 1.0) - 1 + short, 1e-9, True, f"{part:.3f} of the supply; {plan['limited_by']}")


def softened(context, fine, coarse, target, said, bound, compare, note):
    """Peak at the target and travel of every mass with the forces of gaps as they move; and that peak of either mesh, with what it
    may be off by."""
    solved, rough = fine.softened(), coarse.softened()
    if solved is None or rough is None:
        return [Result(SOFT, context.name, np.inf, 0.0, True, f"{note}; no steady motion")], None
    own, other = (motion.softened_peak_g([target], forces)[0] for motion, (forces, _) in ((fine, solved), (coarse, rough)))
    hard = fine.peaks_g([target])[0]
    # Of narrow pulses the program counts what the third and the fifth harmonic's motion does, no more (docs/src/planner.md, "Keys of
    # a plan"); and how many are counted here is seen too.
    counts = [fine.softened(orders) for orders in ((3, 5), (3, 5, 7))]
    left_out = sum(abs(own - fine.softened_peak_g([target], count[0])[0]) if count else np.inf for count in counts)
    allowed = bound * hard + SOFTENING * fine.softening_g(target, solved[0]) + left_out
    compare(SOFT, own, other, said["softened_peak_g"], allowed, hard)
    worst, where = 0.0, ""
    for i, actuator in enumerate(context.scene.actuators):
        travel = solved[1][i]
        volts = max((drive.voltage for drive in fine.drives if drive.actuator == i), default=0.0)
        sag = context.press()[i]
        most = min(TRAVEL_PART * actuator.air_gap, sag.stop)
        # The reference presses points of a lattice, between which a mass may go 2 % further.
        left = actuator.air_gap - min(0.98 * sag.sag + travel, sag.stop)
        parts = (travel / most, volts / (BREAKDOWN_PART * breakdown_v(left)))
        if max(parts) > worst:
            worst, where = max(parts), f"{actuator.id} at {parts[0]:.3f} of its travel, {parts[1]:.3f} of its voltage"
    return [Result(TRAVEL, context.name, worst, 1.0 + bound + 1e-3, True, f"{note}; {where}")], (own, other, allowed)


def compare_lines(context, fine, coarse, target, details, results, note):
    """Level of the strongest odd harmonic up to 1 kHz above the threshold at its own frequency, in dB."""
    levels = []
    for motion in (fine, coarse):
        hz, peaks = motion.harmonic_lines(target)
        levels.append(20 * np.log10(np.maximum(peaks / threshold_g(hz), 1e-300)))
    own, other = (lines.max() for lines in levels)
    # Two meshes may agree by chance at one line, but hardly at those near it too.
    near = hz <= 2 * hz[levels[0].argmax()]
    own_error = max(abs(own - other), np.abs(levels[0] - levels[1])[near].max())
    printed = details["strongest_harmonic_db"]
    if own < NOTHING_DB and (printed is None or printed < NOTHING_DB):
        results.append(not_comparable(STRONGEST, context.name, "nothing but rounding"))
        return
    bound_db = details["strongest_harmonic_error_db"]
    if own_error > 1.0 or bound_db is None:
        results.append(not_comparable(STRONGEST, context.name, f"own error {own_error:.1e} dB, bound {bound_db} dB"))
        return
    allowed = bound_db + 2 * own_error + 8.69 * FLOOR
    difference = abs(own - printed) if printed is not None else np.inf
    results.append(Result(STRONGEST, context.name, difference, allowed, True, f"{note}; {printed} for {own:.4g} dB"))


def zones(context, fine, coarse, plan, note):
    """Largest peak in every quiet zone, and its harmonics."""
    results = []
    for zone in plan["quiet"]:
        centre = zone["x_mm"] * 1e-3, zone["y_mm"] * 1e-3
        points = fine.surface.near(*centre, MAX_HZ, zone["radius_mm"] * 1e-3)[0]
        rim = np.linspace(0, 2 * np.pi, 73)
        around = np.array(centre) + zone["radius_mm"] * 1e-3 * np.stack([np.cos(rim), np.sin(rim)], -1)
        if context.scene.is_bar:
            around = np.array([[x, centre[1]] for x in (centre[0] - zone["radius_mm"] * 1e-3, centre[0], centre[0] + zone["radius_mm"] * 1e-3)])
        there = [
            0 <= x <= context.scene.length and 0 <= y <= context.scene.width and not context.scene.in_cutout(x, y) for x, y in around
        ]
        points = np.concatenate([points, around[there]])
        peak, other = fine.peaks_g(points).max(), coarse.peaks_g(points).max()
        error = 2 * abs(peak - other)
        # Printed is the largest of masses at rest and in moving gaps.
        solved = fine.softened()
        moving = fine.softened_peak_g(points, solved[0]).max() if solved else np.inf
        largest = max(peak, moving)
        bound = (plan["error_bound"] or 1e-2) * max(plan["predicted"]["target_peak_g"], largest)
        allowed = ZONE_TOLERANCE * largest + bound + error
        short = abs(zone["peak_g"] - largest) if peak > zone["at_most_g"] * 1e-3 else 0.0
        over = max(0.0, largest - zone["at_most_g"])
        worst = max(short, over)
        results.append(Result(QUIET, context.name, worst / zone["at_most_g"], allowed / zone["at_most_g"], True, f"{note}; {zone}"))
        harmonics = fine.harmonics_g(points).max()
        if harmonics > 1e-3 * zone["at_most_g"]:
            # "At most": it may be above, by the crests' 2 %, and as moduli of several drives add at different places.
            missing = max(0.0, harmonics - zone["harmonics_g"])
            results.append(Result(QUIET_HARMONICS, context.name, missing / harmonics, 2 * ZONE_TOLERANCE, True, note))
    return results


def named(context, plan, note):
    """Where a wish is not met and a quiet zone is as strong as it may be, it is named among what limits (docs/src/planner.md, "Several
    targets and quiet zones")."""
    full = [zone for zone in plan["quiet"] if zone["peak_g"] > zone["at_most_g"] * (1 - FULL)]
    if plan["limited_by"] is None or not full or all(target["peak_g"] <= NOTHING_G for target in plan["targets"]):
        return []
    return [Result(NAMED, context.name, float("quiet zone" not in plan["limited_by"]), 0.0, True, f"{note}; {plan['limited_by']}")]


def times(context, drives, target, details, note):
    """Rise and decay, by own poles: between the times of thresholds a little lower and a little higher."""
    panel = context.panel(MAX_HZ)
    driven = [drive for drive in drives if drive.force > 0]
    motion = Motion(panel.fine, driven)
    steady = []
    for drive in driven:
        k = np.searchsorted(motion.frequencies, drive.frequency)
        per_newton = motion.responses.at([target])[k, drive.actuator, 0]
        steady.append(per_newton * drive.force * np.exp(1j * drive.phase))
    ringing = Ringing(panel.time_model(2000.0, [target]))
    early, late = (ringing.times_s(driven, steady, 0.9 + side * LEVEL, 0.1 - side * LEVEL, side) for side in (-1, 1))
    results = []
    for quantity, key, low, high in ((RISE, "reaches_90_ms", early[0], late[0]), (DECAY, "decays_to_10_ms", early[1], late[1])):
        if details[key] is None or high > 15.0:
            results.append(not_comparable(quantity, context.name, f"{details[key]} ms"))
            continue
        printed = details[key] * 1e-3
        outside = max(0.0, low - printed, printed - high)
        results.append(Result(quantity, context.name, outside, TIME_S + TIME_RELATIVE * high, True, f"{note}; {printed} s in {low:.4f} to {high:.4f} s"))
    return results


def power(context, wish):
    """`power_mw` of `--explain`: 2 C V^2 f."""
    plan = context.era.json("plan", *wish.arguments, "--explain")
    own = [other for other in plan["explanations"][0]["alternatives"] if other["change"] == "this plan"][0]
    motion = Motion(context.panel(MAX_HZ).fine, drives_of(context.scene, plan["drives"]))
    wanted = motion.power_w() * 1e3
    return Result(POWER, context.name, abs(own["power_mw"] - wanted) / max(wanted, 1e-300), 1e-6, True, wish.kind)


def over_http(context, wish, plan):
    """`POST /v1/touch` and `era touch` give the plan of `era plan`, where both have proven theirs."""
    with context.era.serve() as request:
        status, answer = request("POST", "/v1/touch", wish.body | {"duration_ms": 50})
        if status != 200:
            return [Result(HTTP, context.name, np.inf, 0.0, True, f"{status}: {json.dumps(answer)[:300]}")]
    if context.planted(HTTP):
        answer["drives"][0]["frequency_hz"] += 1.0
    if plan["optimality_gap"] != 0 or answer["optimality_gap"] != 0:
        return [not_comparable(HTTP, context.name, "not proven within a touch's time")]
    if max(plan["predicted"]["target_peak_g"], answer["predicted"]["target_peak_g"]) <= NOTHING_G:
        return [not_comparable(HTTP, context.name, "nothing moves but by rounding")]
    worst = 0.0
    for key in ("frequency_hz", "voltage_v", "pulse_width", "phase_rad", "force_n"):
        for a, b in zip(plan["drives"], answer["drives"]):
            worst = max(worst, abs(a[key] - b[key]) / max(abs(a[key]), 1e-12) if a[key] != b[key] else 0.0)
    for key, value in plan["predicted"].items():
        if value is not None:
            worst = max(worst, abs(value - answer["predicted"][key]) / max(abs(value), 1e-12))
    same = plan["limited_by"] == answer["limited_by"] and len(plan["drives"]) == len(answer["drives"])
    return [Result(HTTP, context.name, worst if same else np.inf, 1e-9, True, wish.kind)]
