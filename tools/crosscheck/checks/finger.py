"""A finger on the touched place: `era response`, `era plan`, `era field` and a point of `era field --reach` of the scene with a `[finger]`,
against the reference's panel with a mass and a spring-damper there.

The finger is one that matters to the panel: it weighs a part of it, and resonates on its own spring within the band.
"""

import numpy as np

from ..harness import Program, ProgramFailed, Result, not_comparable
from ..reference.electrostatics import force_amplitude, widest_pulse
from ..reference.panel import Panel
from ..reference.perception import STANDARD_GRAVITY_M_S2
from ..reference.planner import HARMONICS_UP_TO_HZ, Grid, best_sum
from ..reference.random_scenes import log_uniform, to_toml
from ..reference.scene import parse
from .field import peak_field
from .reach import BAND_HZ, held_to

RESPONSE, PEAK, FIELD = "finger: response", "finger: target peak", "finger: field"
REACH_LEAST, REACH_MOST = "finger: reach, from below", "finger: reach, from above"
QUANTITIES = (RESPONSE, PEAK, FIELD, REACH_LEAST, REACH_MOST)
# The program is handed a finger that gives way more; for what is reached at least, one that gives way less.
PLANTS = {quantity: "answer" for quantity in QUANTITIES}
EVERY, FIRST = 4, 1
MAX_HZ = 400.0
# The reference's own error beyond which it says too little.
USEFUL = 5e-3
# Points of a field that are compared.
POINTS = 40
# Sides of the rectangle of a map, in parts of the surface's: every point of it is a panel of its own.
ZONE = 0.06
# The format's limits.
MOST_G, MOST_DAMPING, MOST_STIFFNESS = 1000.0, 1000.0, 1e6


def finger(rng, weight_kg):
    """A finger's table."""
    mass = min(weight_kg * log_uniform(rng, 0.01, 0.5), MOST_G * 1e-3)
    stiffness = min(mass * (2 * np.pi * log_uniform(rng, 20, 200)) ** 2, MOST_STIFFNESS)
    damping = min(2 * log_uniform(rng, 0.1, 2.0) * np.sqrt(stiffness * mass), MOST_DAMPING)
    return {"mass_g": mass * 1e3, "damping_n_s_per_m": damping, "stiffness_n_per_m": stiffness}


def run(context):
    """One random place with a finger on it."""
    rng, scene = context.rng("finger"), context.scene
    weight = scene.material.density_kg_m3 * scene.length * scene.width * scene.thickness
    own = finger(rng, weight)
    mistaken = any(context.planted(quantity) for quantity in QUANTITIES)
    told = own
    if context.planted(REACH_LEAST):
        told = own | {"mass_g": min(20 * own["mass_g"], MOST_G)}
    elif mistaken:
        told = own | {"mass_g": 0.8 * own["mass_g"], "stiffness_n_per_m": 0.5 * own["stiffness_n_per_m"]}
    path = context.folder / "finger.toml"
    path.write_text(to_toml(context.table | {"finger": told}), encoding="utf-8")
    era = Program(context.era.binary, path, context.folder)
    x, y = context.random_point(rng)
    touched = Panel(parse(to_toml(context.table | {"finger": own})).touched(x, y), MAX_HZ)
    at = f"{x * 1e3!r},{y * 1e3!r}"
    results = response(context, era, touched, (x, y), at)
    touch = ("--at", at, "--unit", "mm", "--intensity-g", float(rng.choice([0.05, 0.5, 5.0])))
    plan = era.json("plan", *touch)
    wanted, error = (value[0] for value in peak_field(touched, plan["drives"], np.array([[x, y]])))
    peak, bound = plan["predicted"]["target_peak_g"], plan["error_bound"]
    if bound is None or wanted == 0 or error > USEFUL * wanted:
        results.append(not_comparable(PEAK, context.name, f"bound {bound}, own error {error / max(wanted, 1e-300):.1e}"))
    else:
        note = f"at {at} mm; {own}; bound {bound:.1e}"
        results.append(Result(PEAK, context.name, abs(peak - wanted) / wanted, bound + error / wanted, True, note))
    return results + field(context, era, touched, touch, rng) + reach(context, era, own, (x, y), rng)


def response(context, era, touched, place, at):
    """Curves at the touched place."""
    said = era.json("response", "--at", at, "--from", 30, "--to", MAX_HZ, "--step", 10)
    hz = np.array(said["frequency_hz"])
    wanted = touched.accelerance([place], hz)[:, :, 0].T
    own = touched.accelerance_error([place], hz)[:, :, 0].T.max(axis=1)
    results = []
    for k, actuator in enumerate(said["actuators"]):
        got = np.array(actuator["acceleration_re"]) + 1j * np.array(actuator["acceleration_im"])
        peak, bound = np.abs(wanted[k]).max(), actuator["error_bound"]
        if bound is None or peak == 0 or own[k] > USEFUL * peak:
            results.append(not_comparable(RESPONSE, context.name, f"bound {bound}, own error {own[k] / max(peak, 1e-300):.1e}"))
            continue
        note = f"{actuator['id']} at {at} mm; bound {bound:.1e}"
        results.append(Result(RESPONSE, context.name, np.abs(got - wanted[k]).max() / peak, bound + own[k] / peak, True, note))
    return results


def field(context, era, touched, touch, rng):
    """Some points of the map of the touch, where everything moves otherwise than without the finger."""
    said = era.json("field", *touch)
    peaks, bound = said["field"]["peak_g"], said["error_bound"]
    places = [(x * 1e-3, y * 1e-3) for y in said["field"]["y_mm"] for x in said["field"]["x_mm"]]
    there = [k for k, peak in enumerate(peaks) if peak is not None]
    chosen = rng.choice(there, min(POINTS, len(there)), replace=False)
    wanted, own = peak_field(touched, said["plan"]["drives"], np.array([places[k] for k in chosen]))
    top = max(peak for peak in peaks if peak is not None)
    if bound is None or top == 0 or own.max() > USEFUL * top:
        return [not_comparable(FIELD, context.name, f"bound {bound}, own error {own.max() / max(top, 1e-300):.1e}")]
    difference = np.abs(np.array([peaks[k] for k in chosen]) - wanted) / top
    worst = (difference - own / top).argmax()
    return [Result(FIELD, context.name, difference[worst], bound + own[worst] / top, True, f"bound {bound:.1e}")]


def reach(context, era, own, place, rng):
    """A point of the map of what can be reached, each with the finger on it: no less than the best forces that surely keep all limits, and no more
    than full force of every actuator at its best frequency."""
    scene, name = context.scene, context.name
    start = int(rng.integers(40, 321))
    ends = [(max(at - ZONE * side, 0.0), min(at + ZONE * side, side)) for at, side in zip(place, (scene.length, scene.width))]
    zone = ",".join(repr(ends[axis][end] * 1e3) for end in (0, 1) for axis in (0, 1))
    try:
        maps = era.json("field", "--reach", "--from", start, "--to", start + BAND_HZ, "--zone", zone)["maps"]
    except ProgramFailed as failure:
        if "zone contains no point" not in failure.stderr:
            raise
        return [not_comparable(REACH_LEAST, name, "no point of the map in the zone")]
    there = [k for k, value in enumerate(maps["strongest_g"]) if value is not None]
    k = int(rng.choice(there))
    x, y = maps["x_mm"][k % len(maps["x_mm"])] * 1e-3, maps["y_mm"][k // len(maps["x_mm"])] * 1e-3
    touched = parse(to_toml(context.table | {"finger": own})).touched(x, y)
    fine = Panel(touched, HARMONICS_UP_TO_HZ).fine
    grid = Grid(fine, fine, context.press(), np.arange(start, start + BAND_HZ + 1.0))
    peak, _ = grid.target(np.array([x, y]))
    strongest = maps["strongest_g"][k] * STANDARD_GRAVITY_M_S2
    sure = best_sum(peak * grid.sure_force().max(axis=2), grid.grid_hz)[0]
    most = sum(
        (peak[:, i] * force_amplitude(actuator, actuator.max_voltage, widest_pulse(grid.grid_hz), grid.grid_hz)).max()
        for i, actuator in enumerate(scene.actuators)
    )
    if most < 1e-9:
        return [not_comparable(REACH_LEAST, name, "nothing moves")]
    room = held_to(maps, k)
    note = f"at {x * 1e3:.5g},{y * 1e3:.5g} mm; {own}; held to {room:.1e}"
    return [
        Result(REACH_LEAST, name, max(0.0, 1 - strongest / sure), room, True, note),
        Result(REACH_MOST, name, max(0.0, strongest / most - 1), room, True, note),
    ]
