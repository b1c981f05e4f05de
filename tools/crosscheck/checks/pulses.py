"""Forces of the electrodes' pulses, and what the simulated device makes of them."""

import numpy as np

from ..harness import ProgramFailed, Result, not_comparable
from ..reference import pulses
from .frames import touch_px

PHASE = "plan: phase of the force"
QUANTITIES = ("force of a drive", PHASE, "harmonics of a plan", "guard of a plan", "pulses as achieved")
PLANTS = dict.fromkeys(QUANTITIES, "answer")
EVERY, FIRST = 6, 1
# `pulses as achieved` starts a daemon.
DAEMON_EVERY, DAEMON_FIRST = 18, 7
MAX_HZ = 1000.0
G = 9.80665
# Accelerations in m/s^2 below this are rounding, the program's and the reference's: a ten-thousandth of what is felt at best (1e-3 g).
NOTHING = 1e-6
# CODATA's values of eps0 of 2014, 2018 and 2022 agree to 1e-9; the rest is rounding.
CONSTANT = 1e-8
# Of the actuators' timers (docs/src/protocol.md leaves them to `Hello`, which tells 170 MHz), 16 bits wide.
CLOCK_HZ = 170e6
MOST_TICKS = 65_535
# A rail is set in steps of half a volt, rounded down (docs/src/accuracy.md).
RAIL_STEP_V = 0.5


def forces(context, plan):
    """Largest relative difference of `force_n` from the fundamental of the pulses' own Fourier integral."""
    eras = {era.id: era for era in context.scene.actuators}
    worst = 0.0
    for drive in plan["drives"]:
        era = eras[drive["actuator"]]
        rest = pulses.rest_force(era.electrode_area, era.air_gap, drive["voltage_v"])
        if era.times[0] > 0:
            own = rest * abs(pulses.coefficient(era.times, drive["frequency_hz"], drive["pulse_width"], 1)) if rest > 0 else 0.0
            worst = max(worst, abs(drive["force_n"] / own - 1) if own > 0 else drive["force_n"])
            continue
        own = pulses.harmonic(drive["frequency_hz"], drive["pulse_width"], 1) * rest
        law = 4 / np.pi * np.sin(np.pi * drive["pulse_width"] / 2) * pulses.rest_force(era.electrode_area, era.air_gap, drive["voltage_v"])
        assert abs(own - law) <= 1e-12 * law, "the contract's law is not the pulses' integral"
        worst = max(worst, abs(drive["force_n"] / own - 1) if own > 0 else drive["force_n"])
    return worst


def phases(context, plan):
    """Largest difference in rad of `force_phase_rad` from `phase_rad` and the lag of the fundamental of the marched voltage."""
    eras = {era.id: era for era in context.scene.actuators}
    worst = 0.0
    for drive in plan["drives"]:
        times, width = eras[drive["actuator"]].times, drive["pulse_width"]
        if context.planted(PHASE) and times[0] > 0:
            times = (1.02 * times[0], *times[1:])
        own = np.angle(pulses.coefficient(times, drive["frequency_hz"], width, 1)) if width > 0 else 0.0
        apart = drive["force_phase_rad"] - drive["phase_rad"] - own
        worst = max(worst, abs((apart + np.pi) % (2 * np.pi) - np.pi))
    return worst


def harmonics(context, plan, point):
    """Largest acceleration in m/s^2 at a point that odd harmonics from the third to 1 kHz can make, with gaps at rest, and the
    reference's own error of it."""
    scene, total, error = context.scene, {}, {}
    panel = context.panel(MAX_HZ)
    ids = [era.id for era in scene.actuators]
    for drive in plan["drives"]:
        number = ids.index(drive["actuator"])
        era = scene.actuators[number]
        orders = [n for n in range(3, 60, 2) if n * drive["frequency_hz"] <= MAX_HZ]
        if not orders:
            continue
        hz = [n * drive["frequency_hz"] for n in orders]
        own = panel.accelerance([point], hz)[:, number, 0]
        off = panel.accelerance_error([point], hz)[:, number, 0]
        for n, f, a, e in zip(orders, hz, own, off):
            force = pulses.rest_force(era.electrode_area, era.air_gap, drive["voltage_v"]) * abs(
                pulses.coefficient(era.times, drive["frequency_hz"], drive["pulse_width"], n)
            )
            total[f] = total.get(f, 0.0) + force * abs(a)
            error[f] = error.get(f, 0.0) + force * e
    return sum(total.values()), sum(error.values())


def achieved_bounds(frequency_hz):
    """What counting ticks may cost: relative error of the frequency (half a tick of a period), and of the pulse's width
    (a tick of it, rounded down), with the coarsest prescaler of eight."""
    prescaler = np.ceil(CLOCK_HZ / frequency_hz / MOST_TICKS) + 7
    ticks = CLOCK_HZ / frequency_hz / prescaler
    return 0.5 / ticks, 2.0 / ticks


def achieved(answer):
    """Worst of what the device acknowledges, in units of what its ticks and its rails' steps may do."""
    worst = 0.0
    by_actuator = {drive["actuator"]: drive for drive in answer["device"]["achieved"]}
    if sorted(by_actuator) != sorted(drive["actuator"] for drive in answer["drives"]):
        return np.inf
    for drive in answer["drives"]:
        got = by_actuator[drive["actuator"]]
        relative, width = achieved_bounds(drive["frequency_hz"])
        # On the link frequencies are in mHz and widths in ppm.
        frequency = abs(got["frequency_hz"] - drive["frequency_hz"]) / (relative * drive["frequency_hz"] + 0.5e-3)
        narrower = drive["pulse_width"] - got["pulse_width"]
        lower = drive["voltage_v"] - got["voltage_v"]
        guard = pulses.guard(got["frequency_hz"], got["pulse_width"])
        worst = max(
            worst,
            frequency,
            abs(narrower) / (width + 1e-6),
            lower / (RAIL_STEP_V + 1e-3) if lower >= -1e-9 else np.inf,
            pulses.GUARD_S / guard,
            # The shorter of two guards, half a tick short at most, and rounded down to whole ns.
            abs(got["guard_us"] * 1e-6 - guard) / (width / (2 * drive["frequency_hz"]) + 1e-9),
        )
    return worst


def run(context):
    """A plan at a random point, and the same as driven."""
    rng, name = context.rng("pulses"), context.name
    point = context.random_point(rng)
    strength = float(np.exp(rng.uniform(np.log(0.05), np.log(5))))
    try:
        plan = context.era.json("plan", "--at", f"{point[0] * 1e3!r},{point[1] * 1e3!r}", "--unit", "mm", "--intensity-g", strength)
    except ProgramFailed as failure:
        return [not_comparable(quantity, name, f"no plan: {failure}") for quantity in QUANTITIES[:4]]
    if context.planted("force of a drive"):
        plan["drives"][0]["voltage_v"] *= 1 + 1e-7
    if context.planted("harmonics of a plan"):
        plan["details"]["harmonics_g"] *= 1.05
    if context.planted("guard of a plan"):
        plan["drives"][0]["pulse_width"] = 1 - 2 * 199e-6 * plan["drives"][0]["frequency_hz"]
    where = f"at {point[0] * 1e3:.4g},{point[1] * 1e3:.4g} mm, {strength:.3g} g"
    results = []
    if not plan["drives"] or all(drive["voltage_v"] == 0 for drive in plan["drives"]):
        return [not_comparable(quantity, name, "nothing is driven") for quantity in QUANTITIES[:4]]
    results.append(Result("force of a drive", name, forces(context, plan), CONSTANT, note=where))
    if context.planted(PHASE) and all(era.times[0] <= 0 for era in context.scene.actuators):
        plan["drives"][0]["force_phase_rad"] += 1e-6
    results.append(Result(PHASE, name, phases(context, plan), CONSTANT, note=where))
    guards = [pulses.guard(drive["frequency_hz"], drive["pulse_width"]) for drive in plan["drives"]]
    results.append(Result("guard of a plan", name, max(0.0, 1 - min(guards) / pulses.GUARD_S), 1e-9, note=where))
    own, error = harmonics(context, plan, point)
    printed = plan["details"]["harmonics_g"] * G
    floor = max(1e-9 * plan["predicted"]["target_peak_g"] * G, NOTHING)
    if own <= floor and printed <= floor:
        results.append(not_comparable("harmonics of a plan", name, "none"))
    elif plan["details"]["harmonics_error_bound"] is None:
        results.append(not_comparable("harmonics of a plan", name, "no bound"))
    else:
        allowed = plan["details"]["harmonics_error_bound"] + error / own
        results.append(Result("harmonics of a plan", name, abs(printed - own) / own, allowed, note=where))
    if context.index % DAEMON_EVERY == DAEMON_FIRST or context.planted("pulses as achieved"):
        results.append(_achieved(context, rng))
    return results


def _achieved(context, rng):
    x_px, y_px = touch_px(context.scene, rng)
    with context.era.serve() as request:
        status, answer = request("POST", "/v1/touch", {"x_px": x_px, "y_px": y_px, "intensity_g": 0.2, "duration_ms": 50})
        if status != 200:
            return not_comparable("pulses as achieved", context.name, f"touch: {answer}")
        if context.planted("pulses as achieved"):
            answer["device"]["achieved"][0]["frequency_hz"] *= 1 + 5e-5
        return Result("pulses as achieved", context.name, achieved(answer), 1.0, note=f"touch {x_px:.1f} {y_px:.1f}")
