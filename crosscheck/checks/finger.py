"""A finger on the touched place: `era response`, `era plan` and `era field` of the scene with a `[finger]`, against the reference's panel
with a mass and a spring-damper there.

The finger is one that matters to the panel: it weighs a part of it, and resonates on its own spring within the band.
"""

import numpy as np

from ..harness import Program, Result, not_comparable
from ..reference.panel import Panel
from ..reference.random_scenes import log_uniform, to_toml
from ..reference.scene import parse
from .field import peak_field

RESPONSE, PEAK, FIELD = "finger: response", "finger: target peak", "finger: field"
QUANTITIES = (RESPONSE, PEAK, FIELD)
# The program is handed a finger that gives way more.
PLANTS = {quantity: "answer" for quantity in QUANTITIES}
EVERY, FIRST = 4, 1
MAX_HZ = 400.0
# The reference's own error beyond which it says too little.
USEFUL = 5e-3
# Points of a field that are compared.
POINTS = 40
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
    told = own | {"mass_g": 0.8 * own["mass_g"], "stiffness_n_per_m": 0.5 * own["stiffness_n_per_m"]} if mistaken else own
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
    return results + field(context, era, touched, touch, rng)


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
