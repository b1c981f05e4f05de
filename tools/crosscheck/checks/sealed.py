"""`era modes` and `era response` of panels in front of sealed air, with ERAs, springs and masses inside, against exact solutions (`reference/levy.py`).

Scenes are this check's own (`reference/sealed_scenes.py`). The reference has no mesh, so that bounds down to 1e-9 are held to what they say.
"""

import json

import numpy as np

from ..harness import Program, Result, not_comparable
from ..reference.levy import Levy
from ..reference.random_scenes import to_toml
from ..reference.scene import parse
from ..reference.sealed_scenes import make

MODE, CURVE, MET = "sealed air: mode frequency", "sealed air: response", "sealed air: tolerance that is met"
QUANTITIES = (MODE, CURVE, MET)
# The program is handed a cavity that is 2 % less deep.
PLANTS = {quantity: "answer" for quantity in QUANTITIES}
EVERY, FIRST = 4, 2
MAX_HZ = 400.0
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
# What the series and the arithmetic of the reference are off by, relative to a frequency and to a curve's peak.
OWN = 1e-10
# Answers for one mode at two tolerances are nearer to each other than this.
SAME_MODE = 1e-6
# Curves lower than this part of 1 N over the panel's mass are rounding (docs/src/accuracy.md).
STILL = 1e-6


def run(context):
    """One panel of this check's own, at two tolerances for its modes and two for curves."""
    rng = context.rng("sealed air")
    table, told = make(rng)
    if any(context.planted(quantity) for quantity in QUANTITIES):
        told = told | {"air": told["air"] | {"sealed_depth_mm": told["air"]["sealed_depth_mm"] * 0.98}}
    path = context.folder / "sealed.toml"
    path.write_text(to_toml(told), encoding="utf-8")
    era = Program(context.era.binary, path, context.folder)
    scene = parse(to_toml(table))
    results, known = [], []
    for tolerance in rng.choice(TOLERANCES, 2, replace=False):
        results += frequencies(context.name, era, scene, float(tolerance), known)
    for tolerance in rng.choice(TOLERANCES, 2, replace=False):
        results += curves(context.name, era, scene, float(tolerance), rng)
    return results


def frequencies(name, era, scene, tolerance, known):
    """Every mode's frequency against the exact one nearest to it; `known` keeps these."""
    panel, results = Levy(scene), []
    answer = era.json("modes", "--max-hz", MAX_HZ, "--tolerance", tolerance)
    for k, mode in enumerate(answer["modes"]):
        hz, bound = mode["frequency_hz"], mode["error_bound"]
        note = f"mode {k + 1}, {hz:.12g} Hz at {tolerance:g}"
        wanted = None
        if hz > 0 and bound is not None:
            wanted = next((own for own in known if abs(own / hz - 1) < SAME_MODE), None) or panel.mode_near(hz)
        if wanted is None:
            results.append(not_comparable(MODE, name, note))
            continue
        known.append(wanted)
        off = abs(hz / wanted - 1)
        results.append(Result(MODE, name, off, bound + OWN, True, f"{note} for {wanted:.12g}"))
        if bound <= tolerance:
            results.append(Result(MET, name, off, tolerance + OWN, True, note))
    return results


def curves(name, era, scene, tolerance, rng):
    """The curve at one place, with the finger there if the scene has one: anywhere, or where something is attached."""
    place = (scene.length * rng.uniform(0.03, 0.97), scene.width * rng.uniform(0.03, 0.97))
    if rng.random() < 0.2:
        place = (scene.actuators[0].x, scene.actuators[0].y)
    panel = Levy(scene.touched(*place) if scene.finger else scene)
    step = float(rng.choice([2.0, 5.0, 11.0]))
    start = float(rng.integers(20, 200))
    at = f"{place[0] * 1e3!r},{place[1] * 1e3!r}"
    said = era.json("response", "--at", at, "--from", start, "--to", min(start + 40 * step, MAX_HZ), "--step", step, "--tolerance", tolerance)
    hz = np.array(said["frequency_hz"])
    wanted = panel.accelerance(place, hz).T
    # The reference's own error, where resonances make most of it.
    highest = np.argsort(np.abs(wanted).max(axis=0))[-3:]
    shifted = panel.accelerance(place, hz[highest] * (1 + OWN)).T - wanted[:, highest]
    least, results = STILL / (panel.weight * scene.length * scene.width), []
    for k, actuator in enumerate(said["actuators"]):
        got, bound = np.array(actuator["acceleration_re"]) + 1j * np.array(actuator["acceleration_im"]), actuator["error_bound"]
        note = f"{actuator['id']} at {at} mm from {start:g} Hz in {step:g} at {tolerance:g}, bound {json.dumps(bound)}"
        if bound is None:
            results.append(not_comparable(CURVE, name, note))
            continue
        peak = max(np.abs(wanted[k]).max(), least)
        own = np.abs(shifted[k]).max() / peak + OWN
        off = np.abs(got - wanted[k])
        note += f", worst at {hz[off.argmax()]:g} Hz"
        results.append(Result(CURVE, name, off.max() / peak, bound + own, True, note))
        if bound <= tolerance:
            results.append(Result(MET, name, off.max() / peak, tolerance + own, True, note))
    return results
