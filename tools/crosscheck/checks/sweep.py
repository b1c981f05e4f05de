"""`era sweep`: complex accelerations over a grid from edge to edge, as a NumPy file."""

import numpy as np

from ..harness import Result, change_all, either, move_actuator, not_comparable

COARSE = "sweep, reference coarser"
QUANTITIES = ("sweep", COARSE, "sweep: surface and cut-outs", "sweep: extremes", "sweep: axes")
PLANTS = {
    "sweep": either(change_all("actuator", "damping_n_s_per_m", 1.2), move_actuator(1.0)),
    COARSE: move_actuator(1.0),
    "sweep: surface and cut-outs": "answer",
    "sweep: extremes": "answer",
    "sweep: axes": "answer",
}
MAX_HZ = 400.0
# Beyond this, relative to a point's largest magnitude, the reference says too little.
USEFUL = 5e-3
# The file has single precision, relative to a curve's largest magnitude.
SINGLE = 3e-6
# A curve weaker than this part of the acceleration of the free panel, 1 N over its mass, is that of a held place, and the bound is
# relative to that much (docs/src/accuracy.md, "Tolerance and error bound").
STILL = 1e-6


def run(context):
    """Compares a random grid at random frequencies."""
    rng, scene, name = context.rng("sweep"), context.scene, context.name
    nx = int(rng.choice([2, 7, 13, 25, 49]))
    ny = 1 if scene.is_bar else int(rng.choice([2, 5, 11, 17]))
    start, step, count = float(rng.integers(30, 200)), float(rng.choice([1.0, 3.5, 11.0])), int(rng.integers(3, 25))
    stop = min(start + step * (count - 1), MAX_HZ)
    hz = start + step * np.arange(int((stop - start) / step + 1e-9) + 1)
    path = context.folder / "sweep.npy"
    said = context.era.json("sweep", "--grid", f"{nx},{ny}", "--from", start, "--to", stop, "--step", step, "--npy", path)
    got = np.load(path)
    wanted_shape = (len(hz), len(scene.actuators), ny, nx)
    if got.shape != wanted_shape:
        return [Result("sweep", name, np.inf, 0, True, f"shape {got.shape} for {wanted_shape}")]
    got = got.astype(complex)
    if context.planted("sweep: surface and cut-outs"):
        got[:, :, 0, nx - 1] = np.nan
    if context.planted("sweep: extremes"):
        said["actuators"][0]["most"]["acceleration_m_per_s2_per_n"] *= 1.01

    y_m = [scene.width / 2] if scene.is_bar else scene.width * np.arange(ny) / (ny - 1)
    x_m = scene.length * np.arange(nx) / (nx - 1)
    results = [_axes(context, path, {"frequency_hz": hz, "y_m": y_m, "x_m": x_m})]
    points = [(x, y) for y in y_m for x in x_m]
    there = np.array([scene.has_surface(*point) for point in points])
    flat = got.reshape(len(hz), len(scene.actuators), -1)
    # Where there is no surface the file has zeros or nothing.
    missing, given = np.isnan(flat).any(axis=(0, 1)), (np.nan_to_num(flat) != 0).any(axis=(0, 1))
    wrong = int((missing & there).sum() + (given & ~there).sum())
    results.append(Result("sweep: surface and cut-outs", name, wrong, 0, True, "points given or missing wrongly"))
    kept = np.flatnonzero(there & ~missing)
    panel = context.panel(MAX_HZ)
    places = [points[k] for k in kept]
    wanted, own = panel.accelerance(places, hz), panel.accelerance_error(places, hz)
    # Of each point's own curve; places that an edge holds have none.
    weight = scene.material.density_kg_m3 * scene.length * scene.width * scene.thickness
    peak = np.maximum(np.abs(wanted).max(axis=0, keepdims=True), STILL / weight)
    difference = np.abs(flat[:, :, kept] - wanted) / peak
    own = (own / peak).max(axis=0, keepdims=True)
    # The reference's meshes may agree at one point by chance: no point's error is estimated lower than the median of all points.
    own = np.broadcast_to(np.maximum(own, np.median(own, axis=2, keepdims=True)), difference.shape)
    useful = own[0] <= USEFUL
    for k, actuator in enumerate(said["actuators"]):
        if actuator["error_bound"] is None:
            results.append(not_comparable("sweep", name, "no bound"))
            continue
        if not useful[k].any():
            results.append(not_comparable("sweep", name, f"own error {own[:, k].max():.1e}"))
            continue
        ratio = np.where(useful[k], difference[:, k] / (actuator["error_bound"] + SINGLE + own[:, k]), -np.inf)
        f, p = np.unravel_index(ratio.argmax(), ratio.shape)
        x, y = places[p]
        note = f"{actuator['id']}, {hz[f]:g} Hz, {x * 1e3:.5g},{y * 1e3:.5g} mm of {nx} x {ny}; bound {actuator['error_bound']:.1e}"
        # What the reference can tell, and what it can only tell to more than the bound.
        quantity = "sweep" if own[f, k, p] <= actuator["error_bound"] + SINGLE else COARSE
        results.append(Result(quantity, name, difference[f, k, p], actuator["error_bound"] + SINGLE + own[f, k, p], True, note))
    results.append(_extremes(said, flat[:, :, there], name))
    return results


def _extremes(said, flat, name):
    """The largest value and the point with the least peak, printed beside the file, follow from the file; points without surface, 0 in it, are none."""
    worst = 0.0
    for k, actuator in enumerate(said["actuators"]):
        magnitude = np.abs(flat[:, k])
        pairs = ((actuator["most"], np.nanmax(magnitude)), (actuator["least_peak"], np.nanmin(magnitude.max(axis=0))))
        for printed, value in pairs:
            worst = max(worst, abs(printed["acceleration_m_per_s2_per_n"] - value) / max(np.nanmax(magnitude), 1e-300))
    return Result("sweep: extremes", name, worst, 2 * SINGLE)


def _axes(context, path, wanted):
    """The files of the axes beside the file, `sweep.x_m.npy` and so on: what the answer's dimensions stand for."""
    worst, note = 0.0, ""
    for name, values in wanted.items():
        got = np.load(path.with_name(f"{path.stem}.{name}.npy"))
        if context.planted("sweep: axes") and name == "x_m":
            got = got[::-1]
        values = np.asarray(values, dtype=float)
        off = np.abs(got - values).max() / np.abs(values).max() if got.shape == values.shape else np.inf
        if off >= worst:
            worst, note = off, name
    # Doubles: rounding of two ways to space them evenly.
    return Result("sweep: axes", context.name, worst, 1e-12, True, note)
