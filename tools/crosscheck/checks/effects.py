"""`era effect`: the segments as printed, played on own modes: peak and when it comes, decay with and without a click's brake, the
supply's current.

What the figures mean (peak over how the cycles fall together, decay of all beginning together, both with gaps at rest and
harmonics up to 1 kHz) is said in docs/src/effects.md and, to the letter, in the program's description of `EffectPrediction`.
"""

import numpy as np

from ..harness import ProgramFailed, Result, change_all, not_comparable
from ..reference import effects, motion, planner, pulses, rise

MOVED = ("effect: peak", "effect: least and most", "effect: decay", "effect: residual", "effect: time of the peak", "effect: decay without brake")
QUANTITIES = (*MOVED, "effect: supply current", "effect: length", "rise and decay")
PLANTS = {
    "effect: peak": change_all("actuator", "air_gap_um", 1.03),
    "effect: least and most": "answer",
    "effect: decay": "answer",
    "effect: residual": "answer",
    "effect: time of the peak": "answer",
    "effect: decay without brake": "answer",
    "effect: supply current": "answer",
    "effect: length": "answer",
    "rise and decay": "answer",
}
EVERY, FIRST = 12, 1
MAX_HZ, BAND_HZ, MOST = 1000.0, 2000.0, 150
STEP_S = 1e-4
G = 9.80665
# How long after the end a time of quiet is told, and how long it has to be quiet to count: between two crests anything is.
AFTER_S, QUIET_FOR_S = 0.3, 0.05
# Motions in m/s^2 below this are rounding, the program's and the reference's: a ten-thousandth of what is felt at best (1e-3 g).
NOTHING = 1e-6
# How long envelopes are looked at, and in how many samples.
TIMED_S, TIMED = 2.0, 10_000
# The mean over delays is one over 8 per drive, or 4 or 2 where there are three or four; a mean over many differs by as much.
# Samples 0.1 ms apart miss a crest by 0.8 % at most, the program's and these.
PEAK = {1: 0.016, 2: 0.02, 3: 0.03, 4: 0.05}
# Of crests: a sample misses 0.8 %, the program's and the reference's; and what the fields differ by.
CREST = 0.02
# Beyond this the reference says too little.
USEFUL = 0.03
MOST_CURRENT_A = 0.5e-3


def request(rng):
    """An effect and its options: the arguments, and how long it is meant to take in s where that is given."""
    # Clicks are made of single windows, which checks/clicks.py plays, but for boards that play none: there each is a push and a brake.
    name = str(rng.choice(["buzz", "double_click", "pulse_train", "texture", "swell"], p=[0.12, 0.52, 0.12, 0.12, 0.12]))
    period = int(rng.integers(60, 120))
    match name:
        case "buzz" | "swell":
            duration = int(rng.integers(30, 150))
            return name, ["--duration-ms", duration], duration * 1e-3
        case "double_click":
            return name, ["--period-ms", period], None
        case "pulse_train":
            return name, ["--count", 3, "--period-ms", period // 2], 3 * (period // 2) * 1e-3
        case "texture":
            return name, ["--duration-ms", 150, "--period-ms", 50], 0.15
    return name, [], None


def length(segments, times, period_s):
    """Of all segments in s."""
    once = sum(segment["cycles"] * period_s if "cycles" in segment else segment["duration_ms"] * 1e-3 for segment in segments)
    return once * times


def electrode(scene, drive):
    """Force of one electrode in N at full level."""
    era = next(era for era in scene.actuators if era.id == drive["actuator"])
    return pulses.rest_force(era.electrode_area, era.air_gap, drive["voltage_v"])


def times_of(scene, drive):
    """Times of its electrodes."""
    return next(era for era in scene.actuators if era.id == drive["actuator"]).times


def run(context):
    """One effect at a random point."""
    rng, name, scene = context.rng("effects"), context.name, context.scene
    point = context.random_point(rng)
    effect, words, duration = request(rng)
    strength = float(np.exp(rng.uniform(np.log(0.1), np.log(2))))
    where = f"{effect} {' '.join(map(str, words))} at {point[0] * 1e3:.4g},{point[1] * 1e3:.4g} mm, {strength:.3g} g"
    at = f"{point[0] * 1e3!r},{point[1] * 1e3!r}"
    try:
        answer = context.era.json("effect", "--at", at, "--unit", "mm", "--effect", effect, "--intensity-g", strength, "--envelopes", *words)
    except ProgramFailed as failure:
        return [not_comparable(quantity, name, f"no effect: {failure}") for quantity in QUANTITIES]
    if any(drive["force_n"] is None for drive in answer["drives"]):
        return [Result("effect: peak", name, np.inf, 0.0, note=f"a force that is no number, {where}")]
    drives = [drive for drive in answer["drives"] if drive["force_n"] > 0]
    if not drives:
        return [not_comparable(quantity, name, "nothing is driven") for quantity in QUANTITIES]
    results = [_current(context, answer, where)]
    if duration is not None:
        longest = max(abs(length(drive["segments"], drive["times"], 1 / drive["frequency_hz"]) - duration) for drive in drives)
        # Rises and falls of a swell are rounded to whole ms.
        longest += 0.01 if context.planted("effect: length") else 0.0
        results.append(Result("effect: length", name, longest, 2e-3, note=where))
    else:
        # Each drive's second click begins at the boundary of its periods that is nearest to the time asked for.
        periods_s, every_s = [1 / drive["frequency_hz"] for drive in drives], words[1] * 1e-3
        begins_s = [np.ceil(length(drive["segments"], 1, period) / period - 1e-6) * period for drive, period in zip(drives, periods_s)]
        late = max(abs(begin - every_s) - period / 2 for begin, period in zip(begins_s, periods_s))
        late += 0.02 if context.planted("effect: length") else 0.0
        results.append(Result("effect: length", name, max(late, 0.0), 1e-6, note=where))
    panel = context.panel(MAX_HZ)
    system = motion.System(panel, BAND_HZ, [point])
    if system.size > MOST:
        return results + [not_comparable(quantity, name, f"{system.size} modes") for quantity in (*MOVED, "rise and decay")]
    results.append(_timing(context, system, answer, where))
    half = motion.System(panel, BAND_HZ / 2, [point])
    answer["effect_has_brake"] = effect == "double_click"
    answer["period_s"] = words[1] * 1e-3 if effect == "double_click" else None
    return results + _motion(context, system, half, drives, answer, where)


def _motion(context, system, half, drives, answer, where):
    scene, name, predicted = context.scene, context.name, answer["predicted"]
    ids = [era.id for era in scene.actuators]
    forces = [
        effects.Force(d["frequency_hz"], d["pulse_width"], electrode(scene, d), effects.levels(d["segments"], d["times"], 1 / d["frequency_hz"]), times_of(scene, d))
        for d in drives
    ]
    ends = max(force.end_s for force in forces)
    seconds = ends + AFTER_S + QUIET_FOR_S
    play = lambda model: [effects.response(model, ids.index(d["actuator"]), force, seconds, STEP_S) for d, force in zip(drives, forces)]
    signals, rough = play(system), play(half)
    periods = [force.period_s for force in forces]
    mean, least, most = effects.peaks(signals, periods, STEP_S)
    if mean < NOTHING and predicted["peak_g"] * G < NOTHING:
        return [not_comparable(quantity, name, "nothing moves") for quantity in MOVED]
    # What modes above the band make of a start is worth about what those of its upper half do, at most.
    error = abs(effects.peaks(rough, periods, STEP_S)[0] / mean - 1)
    if error > USEFUL:
        return [not_comparable(quantity, name, f"own error {error:.1e}") for quantity in MOVED]
    together = sum(signals)
    if context.planted("effect: least and most"):
        predicted["peak_most_g"] *= 1.1
    if context.planted("effect: decay") and predicted["quiet_ms"]:
        predicted["quiet_ms"] += 12
    if context.planted("effect: residual"):
        predicted["residual"] += 0.5
    tolerance = PEAK[len(drives)]
    spread = (most - least) / mean
    results = [
        Result("effect: peak", name, abs(predicted["peak_g"] * G - mean) / mean, tolerance + 0.05 * spread + error, note=where),
        Result(
            "effect: least and most",
            name,
            # The program's few delays lie within what many find, but for what a sample misses of a crest.
            max((least - predicted["peak_least_g"] * G) / mean, (predicted["peak_most_g"] * G - most) / mean, 0.0),
            0.03 + error,
            note=where,
        ),
    ]
    # The end is that of the slowest drive's segments or of the period in which they end, and a swing is half a period long.
    over = max(length(d["segments"], d["times"], 1 / d["frequency_hz"]) for d in drives)
    after = lambda time: np.abs(together[int(np.ceil(time / STEP_S - 1e-9)) :]).max() / mean
    high, low = after(over - max(periods) / 2), after(ends + max(periods) / 2)
    outside = max(predicted["residual"] - high, low - predicted["residual"], 0.0)
    results.append(Result("effect: residual", name, outside, 0.02 * max(1.0, high) + error, note=f"{predicted['left']:.3g} for {low:.3g} to {high:.3g}, {where}"))
    results.append(_decay(context, "effect: decay", together, mean, predicted["quiet_ms"], ends, where))
    results.append(_peak_at(context, together, predicted["peak_at_ms"], error, where))
    printed = predicted["quiet_unbraked_ms"]
    plain = [without_brake(d["segments"], d["times"], 1 / d["frequency_hz"], answer["period_s"]) for d in drives]
    if None in plain or not answer["effect_has_brake"]:
        if printed is not None:
            results.append(Result("effect: decay without brake", name, np.inf, 0.0, note=f"{printed} ms, {where}"))
        return results
    if context.planted("effect: decay without brake"):
        printed = predicted["quiet_ms"]
    pushes = [
        effects.Force(d["frequency_hz"], d["pulse_width"], electrode(scene, d), effects.levels(segments, d["times"], 1 / d["frequency_hz"]), times_of(scene, d))
        for d, segments in zip(drives, plain)
    ]
    over = max(push.end_s for push in pushes)
    seconds = over + AFTER_S + QUIET_FOR_S
    pushed = sum(effects.response(system, ids.index(d["actuator"]), push, seconds, STEP_S) for d, push in zip(drives, pushes))
    # Below a tenth of the peak that the click has with its brake.
    results.append(_decay(context, "effect: decay without brake", pushed, mean, printed, over, where))
    return results


def without_brake(segments, times, period_s, every_s):
    """A click's segments without its brake: of whole cycles the first, its push, and where clicks are repeated every so often the pause, in
    whole ms, up to the boundary of a period that is nearest to the next one. None if these are no click's."""
    push = segments[0]
    if "cycles" not in push or push["level"] != 1.0:
        return None
    if times == 1:
        return [push]
    nearest_s = np.round(every_s / period_s) * period_s
    return [push, {"level": 0.0, "duration_ms": max(1.0, np.floor((nearest_s - push["cycles"] * period_s) * 1e3))}]


def _peak_at(context, together, printed_ms, error, where):
    """When the acceleration is largest, all drives beginning together: crests that are all but as large come at other times, so that
    one of these is to be there, within a sample."""
    name, quantity = context.name, "effect: time of the peak"
    if context.planted(quantity):
        printed_ms *= 1.37
    at, size = int(round(printed_ms * 1e-3 / STEP_S)), np.abs(together)
    if at >= len(size):
        return Result(quantity, name, np.inf, 0.0, note=f"{printed_ms} ms, {where}")
    there = size[max(at - 1, 0) : at + 2].max()
    note = f"{printed_ms:.4g} ms, own {size.argmax() * STEP_S * 1e3:.4g} ms, {where}"
    return Result(quantity, name, 1 - there / size.max(), CREST + 2 * error, note=note)


def _timing(context, system, answer, where):
    """When the plan's envelope has 90 % of its steady peak, and when it has decayed to 10 %: printed is to lie between the times
    at which own envelopes, with all that unresolved poles can add or take, pass levels of 2 % of the peak to either side."""
    name, quantity = context.name, "rise and decay"
    ids = [era.id for era in context.scene.actuators]
    drives = [(ids.index(d["actuator"]), d["frequency_hz"], d["force_n"]) for d in answer["plan"]["drives"] if d["force_n"] > 0]
    hz = [drive[1] for drive in drives]
    if system.defective or len(set(hz)) < len(hz):
        return not_comparable(quantity, name, "poles coincide, or frequencies do")
    motions = rise.free_motions(system, drives)
    peak = sum(abs(steady) for _, steady, _, _ in motions)
    if peak < NOTHING:
        return not_comparable(quantity, name, "nothing moves")
    times = np.linspace(0, TIMED_S, TIMED + 1)
    risen, left, unresolved = rise.envelopes(motions, times)
    printed = [answer["plan_timing"][key] for key in ("reaches_90_s", "decays_to_10_s")]
    if context.planted(quantity):
        printed = [None if value is None else 1.3 * value + 0.01 for value in printed]
    brackets = [
        (rise.last(times, risen + unresolved < 0.88 * peak), rise.last(times, risen - unresolved < 0.92 * peak)),
        (rise.last(times, left - unresolved > 0.12 * peak), rise.last(times, left + unresolved > 0.08 * peak)),
    ]
    # Free motions that are left may, as they beat with the steady one, take it below again.
    if left[-1] + unresolved[-1] > 0.08 * peak:
        brackets[0] = (brackets[0][0], None)
    worst, note = 0.0, ""
    for got, (early, late) in zip(printed, brackets):
        got, early, late = (TIMED_S if value is None or value > TIMED_S else value for value in (got, early, late))
        outside = max(early - got, got - late, 0.0)
        if outside >= worst:
            worst, note = outside, f"{got:.4g} for {early:.4g} to {late:.4g} s, "
    # Samples here, and the program's, a five-hundredth of the decay.
    return Result(quantity, name, worst, TIMED_S / TIMED + 0.004 * brackets_end(brackets), note=note + where)


def brackets_end(brackets):
    """The latest time in brackets of times, `TIMED_S` where there is none."""
    return max(TIMED_S if late is None else late for _, late in brackets)


def _decay(context, quantity, together, mean, printed_ms, ends, where):
    """When the acceleration stays below a tenth of the peak: with a tenth that is 4 % higher and lower, as an envelope may
    pass it slowly. Printed is one of the times between."""
    def stays_below(limit):
        above = np.nonzero(np.abs(together) > limit * mean)[0]
        first = above[-1] + 1 if len(above) else 0
        return None if len(together) - first < QUIET_FOR_S / STEP_S - 1 else first * STEP_S * 1e3

    early, late = stays_below(0.104), stays_below(0.096)
    note = f"{printed_ms} for {early} to {late} ms, {where}"
    if printed_ms is None:
        # Not within 300 ms of the end, as drives' periods round it; near that either may be said.
        sooner = late is not None and late < (ends + AFTER_S) * 1e3 - 15
        return Result(quantity, context.name, float(sooner), 0.0, note=note)
    early, late = (np.inf if value is None else value for value in (early, late))
    outside = max(early - printed_ms, printed_ms - late, 0.0)
    # A sample of 0.1 ms, and a half swing of the slowest drive.
    return Result(quantity, context.name, outside, 1.0, note=note)


def _current(context, answer, where):
    """Mean current from the supply while all drives are at full level: both electrodes are charged once a period."""
    number = {actuator.id: i for i, actuator in enumerate(context.scene.actuators)}
    of = lambda drives: planner.supply_current_a(
        context.scene.actuators, [(number[drive["actuator"]], drive["voltage_v"], drive["frequency_hz"]) for drive in drives]
    )
    if context.planted("effect: supply current"):
        # As if the last scaling to what the supply delivers had been forgotten.
        factor = 1.05 * max(1.0, MOST_CURRENT_A / max(of(answer["drives"]), 1e-300))
        answer["drives"] = [drive | {"voltage_v": drive["voltage_v"] * factor} for drive in answer["drives"]]
    total = of(answer["drives"])
    return Result("effect: supply current", context.name, total / MOST_CURRENT_A, 1.0 + 1e-9, note=where)
