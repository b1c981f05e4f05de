"""`era response`: the complex curve at a point, as JSON and as CSV."""

import csv
import io

import numpy as np

from ..harness import Result, move_actuator, not_comparable

QUANTITIES = ("response", "response as CSV")
PLANTS = {"response": move_actuator(1.0), "response as CSV": "answer"}
MAX_HZ = 400.0
# Beyond this, relative to the curve's largest magnitude, the reference says too little.
USEFUL = 5e-3
# What a CSV may round away, relative to a value: seven digits and a hundredth of a degree, 8.7e-5 rad.
PRINTED = 1e-4


def frequencies(rng):
    """A range for the program, and the frequencies that it means."""
    start, step = float(rng.integers(20, 80)), [0.5, 1.0, 2.5, 7.0][rng.integers(4)]
    count = int(rng.integers(20, 120))
    stop = min(start + step * count, MAX_HZ)
    return start, stop, step, start + step * np.arange(int((stop - start) / step + 1e-9) + 1)


def run(context):
    """Compares the curve at one random point."""
    rng = context.rng("response")
    panel = context.panel(MAX_HZ)
    x, y = context.random_point(rng, 0.0)
    start, stop, step, wanted_hz = frequencies(rng)
    arguments = ("--at", f"{x * 1e3!r},{y * 1e3!r}", "--from", start, "--to", stop, "--step", step)
    answer = context.era.json("response", *arguments)
    name, results = context.name, []
    hz = np.array(answer["frequency_hz"])
    if len(hz) != len(wanted_hz) or not np.allclose(hz, wanted_hz, atol=1e-9):
        return [Result("response", name, np.inf, 0, True, f"{len(hz)} frequencies for {len(wanted_hz)}")]
    got = np.array([np.array(a["acceleration_re"]) + 1j * np.array(a["acceleration_im"]) for a in answer["actuators"]])
    ids = [a["id"] for a in answer["actuators"]]
    wanted = panel.accelerance([(x, y)], hz)[:, :, 0].T
    # Over the whole curve, as the bound is meant: at single frequencies two meshes may agree by chance.
    own = panel.accelerance_error([(x, y)], hz)[:, :, 0].T
    own = np.broadcast_to(own.max(axis=1, keepdims=True), own.shape)
    peak = np.abs(wanted).max()
    if ids != [actuator.id for actuator in context.scene.actuators]:
        return [Result("response", name, np.inf, 0, True, f"actuators {ids}")]
    bound = answer["error_bound"]
    if bound is None:
        results.append(not_comparable("response", name, "no bound"))
    elif peak == 0 or own.max() > USEFUL * peak:
        results.append(not_comparable("response", name, f"own error {own.max() / max(peak, 1e-300):.1e}"))
    else:
        excess = np.abs(got - wanted) - own
        worst = np.unravel_index(excess.argmax(), excess.shape)
        note = f"at {x * 1e3:.4g},{y * 1e3:.4g} mm, {hz[worst[1]]:g} Hz, {ids[worst[0]]}; bound {bound:.1e}"
        results.append(Result("response", name, np.abs(got - wanted)[worst] / peak, bound + own[worst] / peak, True, note))
    results.append(_csv(context, arguments, hz, got))
    return results


def _csv(context, arguments, hz, curve):
    """The same values as CSV, magnitude and phase in degrees, by the columns' names."""
    text = context.era.run("response", *arguments)[0]
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
    if len(rows) != len(hz):
        return Result("response as CSV", context.name, np.inf, 0, True, f"{len(rows)} lines for {len(hz)} frequencies")
    column = lambda name: np.array([float(row[name]) for row in rows])
    worst = np.abs(column("frequency_hz") / hz - 1).max()
    for k, actuator in enumerate(context.scene.actuators):
        size, phase = column(f"{actuator.id}_m_per_s2_per_n"), np.deg2rad(column(f"{actuator.id}_phase_deg"))
        if context.planted("response as CSV") and k == 0:
            size[len(size) // 2] *= 1.01
        worst = max(worst, (np.abs(size * np.exp(1j * phase) - curve[k]) / np.maximum(np.abs(curve[k]), 1e-300)).max())
    return Result("response as CSV", context.name, worst, PRINTED)
