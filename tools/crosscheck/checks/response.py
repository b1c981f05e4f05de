"""`era response`: the complex curve at a point, as JSON and as CSV."""

import csv
import io

import numpy as np

from ..harness import Result, move_actuator, not_comparable

SURE, COARSE, ONE, CSV = "response", "response, reference coarser", "response at one frequency", "response as CSV"
QUANTITIES = (SURE, COARSE, ONE, CSV)
PLANTS = {SURE: move_actuator(1.0), COARSE: move_actuator(1.0), ONE: move_actuator(1.0), CSV: "answer"}
MAX_HZ = 400.0
# Beyond this, relative to the curve's largest magnitude, the reference says too little.
USEFUL = 5e-3
# Of a single frequency, relative to the answer there.
USEFUL_AT_ONE = 0.05
# The bound is relative to this part of the acceleration of the free surface, 1 N over its mass, where there is less (docs/src/accuracy.md,
# "Tolerance and error bound").
STILL = 1e-6
# Frequencies that the reference's own error at one of them is taken from: at a single one two meshes may agree by chance.
BESIDE = np.array([0.96, 0.98, 0.99, 1.0, 1.01, 1.02, 1.04])
# What a CSV may round away, relative to a value: seven digits and a hundredth of a degree, 8.7e-5 rad.
PRINTED = 1e-4


def frequencies(rng):
    """A range for the program, and the frequencies that it means."""
    start, step = float(rng.integers(20, 80)), [0.5, 1.0, 2.5, 7.0][rng.integers(4)]
    count = int(rng.integers(20, 120))
    stop = min(start + step * count, MAX_HZ)
    return start, stop, step, start + step * np.arange(int((stop - start) / step + 1e-9) + 1)


def tolerance(rng):
    """One that is asked for, as arguments: the default as a rule."""
    asked = rng.choice(["", "1e-2", "1e-4", "1e-5"], p=[0.5, 0.2, 0.2, 0.1])
    return ("--tolerance", asked) if asked else ()


def run(context):
    """Compares the curve at one random point, and one frequency at another."""
    rng = context.rng("response")
    panel = context.panel(MAX_HZ)
    x, y = context.random_point(rng, 0.0)
    start, stop, step, wanted_hz = frequencies(rng)
    arguments = ("--at", f"{x * 1e3!r},{y * 1e3!r}", "--from", start, "--to", stop, "--step", step, *tolerance(rng))
    answer = context.era.json("response", *arguments)
    name, results = context.name, []
    hz = np.array(answer["frequency_hz"])
    if len(hz) != len(wanted_hz) or not np.allclose(hz, wanted_hz, atol=1e-9):
        return [Result(SURE, name, np.inf, 0, True, f"{len(hz)} frequencies for {len(wanted_hz)}")]
    got = np.array([np.array(a["acceleration_re"]) + 1j * np.array(a["acceleration_im"]) for a in answer["actuators"]])
    ids = [a["id"] for a in answer["actuators"]]
    wanted = panel.accelerance([(x, y)], hz)[:, :, 0].T
    # Over the whole curve, as the bound is meant: at single frequencies two meshes may agree by chance.
    own = panel.accelerance_error([(x, y)], hz)[:, :, 0].T
    own = np.broadcast_to(own.max(axis=1, keepdims=True), own.shape)
    if ids != [actuator.id for actuator in context.scene.actuators]:
        return [Result(SURE, name, np.inf, 0, True, f"actuators {ids}")]
    for k, actuator in enumerate(answer["actuators"]):
        bound, peak, error = actuator["error_bound"], np.abs(wanted[k]).max(), own[k].max()
        if bound is None:
            results.append(not_comparable(SURE, name, "no bound"))
        elif peak == 0 or error > USEFUL * peak:
            results.append(not_comparable(SURE, name, f"own error {error / max(peak, 1e-300):.1e}"))
        else:
            difference = np.abs(got[k] - wanted[k])
            worst = difference.argmax()
            # What the reference can tell, and what it can only tell to more than the bound.
            quantity = SURE if error <= bound * peak else COARSE
            note = f"at {x * 1e3:.4g},{y * 1e3:.4g} mm, {hz[worst]:g} Hz, {ids[k]}; bound {bound:.1e}"
            results.append(Result(quantity, name, difference[worst] / peak, bound + error / peak, True, note))
    results.append(_csv(context, arguments, hz, got))
    return results + _at_one(context)


def _at_one(context):
    """Each actuator at one frequency, relative to its own answer there."""
    rng, panel = context.rng("response at one frequency"), context.panel(MAX_HZ)
    x, y = context.random_point(rng, 0.0)
    hz = float(np.round(np.exp(rng.uniform(np.log(20), np.log(MAX_HZ))), 2))
    arguments = ("--at", f"{x * 1e3!r},{y * 1e3!r}", "--from", hz, "--to", hz, *tolerance(rng))
    said = context.era.json("response", *arguments)["actuators"]
    results = _one_frequency(context, panel, (x, y), hz, said)
    # Two meshes of the reference may agree by chance, at one frequency more easily than on a curve: a third one, finer, has the last word.
    return results if not any(result.failed for result in results) else _one_frequency(context, panel.finer(), (x, y), hz, said)


def _one_frequency(context, panel, place, hz, said):
    """The comparison with one panel of the reference."""
    scene, results = context.scene, []
    weight = scene.material.density_kg_m3 * scene.length * scene.width * scene.thickness
    wanted = panel.accelerance([place], np.array([hz]))[0, :, 0]
    own = panel.accelerance_error([place], hz * BESIDE)[:, :, 0].max(axis=0)
    for k, actuator in enumerate(said):
        got = actuator["acceleration_re"][0] + 1j * actuator["acceleration_im"][0]
        size, bound = max(abs(wanted[k]), STILL / weight), actuator["error_bound"]
        if bound is None:
            results.append(not_comparable(ONE, context.name, "no bound"))
        elif own[k] > USEFUL_AT_ONE * size:
            results.append(not_comparable(ONE, context.name, f"own error {own[k] / size:.1e}"))
        else:
            note = f"{actuator['id']} at {place[0] * 1e3:.4g},{place[1] * 1e3:.4g} mm, {hz:g} Hz; bound {bound:.1e}"
            results.append(Result(ONE, context.name, abs(got - wanted[k]) / size, bound + own[k] / size, True, note))
    return results


def _csv(context, arguments, hz, curve):
    """The same values as CSV, magnitude and phase in degrees, by the columns' names."""
    text = context.era.run("response", *arguments)[0]
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
    if len(rows) != len(hz):
        return Result(CSV, context.name, np.inf, 0, True, f"{len(rows)} lines for {len(hz)} frequencies")
    column = lambda name: np.array([float(row[name]) for row in rows])
    worst = np.abs(column("frequency_hz") / hz - 1).max()
    for k, actuator in enumerate(context.scene.actuators):
        size, phase = column(f"{actuator.id}_m_per_s2_per_n"), np.deg2rad(column(f"{actuator.id}_phase_deg"))
        if context.planted(CSV) and k == 0:
            size[len(size) // 2] *= 1.01
        worst = max(worst, (np.abs(size * np.exp(1j * phase) - curve[k]) / np.maximum(np.abs(curve[k]), 1e-300)).max())
    return Result(CSV, context.name, worst, PRINTED)
