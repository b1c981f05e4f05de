"""`era modes --npy --csv`: mode shapes over a grid, their axes, and the same numbers as a table."""

import csv

import numpy as np

from ..harness import Result, move_actuator, not_comparable

SHAPE, AXES, TABLE = "mode shape", "mode shape: axes and surface", "mode shape as CSV"
QUANTITIES = (SHAPE, AXES, TABLE)
PLANTS = {SHAPE: move_actuator(2.0), AXES: "answer", TABLE: "answer"}
EVERY = 2
MAX_HZ = 400.0
# Neighbours nearer than this, relative, mix by errors that are none of the frequencies'.
APART = 0.03
# A shape has no printed bound: it is held to this of its largest value, and so many times the frequency's bound.
TOLERANCE, PER_BOUND = 3e-4, 50
# Digits of the table.
PRINTED = 1e-6


def run(context):
    """Compares the shapes of well separated modes, at the points of a random grid."""
    rng, scene, name = context.rng("mode shapes"), context.scene, context.name
    nx = int(rng.choice([2, 9, 20]))
    ny = 1 if scene.is_bar else int(rng.choice([2, 7, 15]))
    stem = context.folder / "modes"
    answer = context.era.json(
        "modes", "--max-hz", MAX_HZ, "--grid", f"{nx},{ny}", "--npy", f"{stem}.npy", "--csv", f"{stem}.csv"
    )["modes"]
    shapes, hz, x_m = (np.load(f"{stem}{part}.npy") for part in ("", ".frequency_hz", ".x_m"))
    y_m = np.load(f"{stem}.y_m.npy")
    if context.planted(AXES):
        x_m = x_m[::-1]
    wanted_x = scene.length * np.arange(nx) / (nx - 1)
    wanted_y = np.array([scene.width / 2]) if scene.is_bar else scene.width * np.arange(ny) / (ny - 1)
    if shapes.shape != (len(answer), ny, nx) or x_m.shape != (nx,) or y_m.shape != (ny,):
        return [Result(AXES, name, np.inf, 0.0, True, f"shapes {shapes.shape}, axes {x_m.shape}, {y_m.shape}")]
    points = [(x, y) for y in wanted_y for x in wanted_x]
    there = np.array([scene.has_surface(*point) for point in points])
    flat = shapes.reshape(len(answer), nx * ny)
    off = max(np.abs(x_m - wanted_x).max() / scene.length, np.abs(y_m - wanted_y).max() / scene.width)
    off = max(off, np.abs(hz - [mode["frequency_hz"] for mode in answer]).max(initial=0.0) / MAX_HZ)
    if (np.isnan(flat) == there[None, :]).any():
        off = np.inf
    results = [Result(AXES, name, off, 1e-12)]
    if len(answer):
        results.append(_table(context, f"{stem}.csv", flat, points))
    return results + _shapes(context, answer, flat[:, there], [point for point, is_there in zip(points, there) if is_there])


def _table(context, path, flat, points):
    """The table's lines: modes in turn, points row by row."""
    with open(path, encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if line.strip() and not line.startswith("#")))
    if len(rows) != flat.size:
        return Result(TABLE, context.name, np.inf, 0.0, True, f"{len(rows)} lines for {flat.size} values")
    values = np.array([float(row["shape_per_sqrt_kg"] or "nan") for row in rows]).reshape(flat.shape)
    if context.planted(TABLE):
        values[-1, np.nanargmax(np.abs(values[-1]))] *= 1.001
    at = np.array([(float(row["x_mm"]), float(row["y_mm"])) for row in rows[: len(points)]]) * 1e-3
    size = max(np.abs(points).max(), 1e-300)
    # On a grid of corners that edges hold, all is zero.
    worst = max(np.nanmax(np.abs(values - flat)) / max(np.nanmax(np.abs(flat)), 1e-300), np.abs(at - points).max() / size)
    return Result(TABLE, context.name, worst if (np.isnan(values) == np.isnan(flat)).all() else np.inf, PRINTED)


def _shapes(context, answer, flat, points):
    """Each elastic mode that no other is near, of either sign, relative to its largest value."""
    panel, scene, results = context.panel(MAX_HZ), context.scene, []
    weight = scene.material.density_kg_m3 * scene.length * scene.width * scene.thickness
    (hz, fine), (_, coarse) = (panel.shapes(model, points, 1.1 * MAX_HZ) for model in (panel.fine, panel.coarse))
    for k, mode in enumerate(answer):
        beside = [abs(hz[other] / mode["frequency_hz"] - 1) for other in (k - 1, k + 1) if 0 <= other < len(hz)] if mode["frequency_hz"] else [0.0]
        if k >= min(len(fine), len(coarse)) or min(beside, default=1.0) < APART:
            continue
        largest = np.abs(fine[k]).max()
        distance = lambda a, b: min(np.abs(a - b).max(), np.abs(a + b).max()) / largest
        own = 2 * distance(coarse[k], fine[k])
        # A grid of few points may have none where the mode moves.
        if mode["error_bound"] is None or largest * np.sqrt(weight) < 0.3 or own > 0.05:
            results.append(not_comparable(SHAPE, context.name, f"mode {k + 1}: own error {own:.1e}"))
            continue
        allowed = TOLERANCE + PER_BOUND * mode["error_bound"] + own
        results.append(Result(SHAPE, context.name, distance(flat[k], fine[k]), allowed, True, f"mode {k + 1}, {hz[k]:.5g} Hz"))
    return results
