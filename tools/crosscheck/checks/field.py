"""Fields of a touch: `era field` as JSON and CSV, `GET /v1/field` of a daemon, for the drives that are printed beside them; and the
contrast printed there, from own mean squares."""

import csv
import io

import numpy as np

from ..harness import Result, change_all, not_comparable
from ..reference.planner import Motion, drives_of
from .plan import CONTRAST_TOLERANCE

QUANTITIES = ("field", "field as CSV", "field over HTTP", "field: contrast", "field: drives")
PLANTS = {
    "field": change_all("actuator", "x_mm", 1.01),
    "field as CSV": "answer",
    "field over HTTP": "answer",
    "field: contrast": change_all("actuator", "x_mm", 1.03),
    "field: drives": "answer",
}
EVERY = 3
MAX_HZ = 400.0
STANDARD_GRAVITY = 9.80665
# The reference's own error beyond which it says too little, of the field's largest value.
USEFUL = 5e-3
# What CSV and HTTP may round away: six decimals of a g, and a like share of the largest value.
DECIMALS_G = 1e-6
# Drives of two commands that both have the proven best.
SAME_DRIVES = 1e-9


def run(context):
    """Compares the field of one random touch."""
    rng, scene, name = context.rng("field"), context.scene, context.name
    x_px, y_px = rng.uniform(0, scene.screen.width_px), rng.uniform(0, scene.screen.height_px)
    for _ in range(1000):
        if scene.has_surface(*scene.screen.to_m(x_px, y_px)):
            break
        x_px, y_px = rng.uniform(0, scene.screen.width_px), rng.uniform(0, scene.screen.height_px)
    if scene.is_bar:
        y_px = (scene.width / 2 - scene.screen.y) * scene.screen.height_px / scene.screen.width
        y_px = min(max(y_px, 0.0), scene.screen.height_px)
    intensity = float(rng.choice([0.05, 0.5, 2.0]))
    touch = ("--at", f"{x_px!r},{y_px!r}", "--intensity-g", intensity)
    plan = context.era.json("plan", *touch)
    said = context.era.json("field", *touch)
    text = context.era.run("field", *touch, "--csv", "-")[0]
    table = np.array([[float(value) if value else np.nan for value in row] for row in list(csv.reader(io.StringIO(text)))[1:]])
    with context.era.serve() as request:
        status, over_http = request("GET", f"/v1/field?x_px={x_px!r}&y_px={y_px!r}&intensity_g={intensity}")
    if status != 200:
        return [Result("field over HTTP", name, np.inf, 0, True, f"{status}: {over_http}")]

    nx, ny = over_http["nx"], over_http["ny"]
    points = np.array([(x * 1e-3, y * 1e-3) for y in over_http["y_mm"] for x in over_http["x_mm"]])
    values = lambda numbers: np.array([np.nan if value is None else value for value in numbers])
    json_g, http_g = values(said["field"]["peak_g"]), values(over_http["peak_g"])
    if context.planted("field over HTTP"):
        http_g[[0, -1]] = http_g[[0, -1]] * 1.01 + 1e-3
    if context.planted("field as CSV"):
        table[-1, 2] = table[-1, 2] * 1.01 + 1e-3
    there = np.array([scene.has_surface(*point) for point in points])
    places = points[there]
    # A touch's search ends sooner than that of `era plan`, and may have other drives than it: the field's are those printed with it.
    drives = said["plan"]["drives"]
    wanted, own = peak_field(context.panel(MAX_HZ), drives, places)
    top = wanted.max()
    results = []
    same_size = len(json_g) == len(points) == nx * ny
    if not same_size or (np.isnan(json_g) == there).any() or (np.isnan(http_g) == there).any():
        return [Result("field", name, np.inf, 0, True, "points given or missing wrongly")]
    bound = said["error_bound"]
    if bound is None or top == 0 or own.max() > USEFUL * top:
        results.append(not_comparable("field", name, f"bound {bound}, own error {own.max() / max(top, 1e-300):.1e}"))
    else:
        difference = np.abs(json_g[there] - wanted) / top
        worst = (difference - own / top).argmax()
        x, y = places[worst] * 1e3
        note = f"at {x:.5g},{y:.5g} mm, touch {x_px:.5g},{y_px:.5g} px; bound {bound:.1e}"
        results.append(Result("field", name, difference[worst], bound + own[worst] / top, True, note))
    allowed = DECIMALS_G + 1e-6 * np.nanmax(json_g)
    results.append(Result("field over HTTP", name, np.nanmax(np.abs(http_g - json_g)), allowed))
    # The CSV has its own places, to a micrometre.
    given = table[~np.isnan(table[:, 2])]
    shifted = np.nan if len(given) != there.sum() else np.abs(given[:, :2] * 1e-3 - places).max()
    results.append(Result("field as CSV", name, max(np.abs(given[:, 2] - json_g[there]).max() if shifted < 2e-6 else np.inf, 0), allowed))
    results.append(contrast(context, drives, said["plan"]))
    results.append(same_drives(context, plan, said["plan"]))
    return results


def same_drives(context, plan, said):
    """What both commands say is the best, they say alike."""
    name, quantity = context.name, "field: drives"
    if said["optimality_gap"] > 0 or plan["optimality_gap"] > 0:
        return not_comparable(quantity, name, f"gaps {said['optimality_gap']:.1e} and {plan['optimality_gap']:.1e}")
    if context.planted(quantity):
        said["drives"][0]["frequency_hz"] += 1.0
    worst = 0.0
    for own, other in zip(said["drives"], plan["drives"], strict=True):
        for key in ("frequency_hz", "force_n"):
            worst = max(worst, abs(own[key] - other[key]) / max(abs(other[key]), 1e-300) if own[key] != other[key] else 0.0)
    return Result(quantity, name, worst, SAME_DRIVES)


def contrast(context, drives, said):
    """Mean square near the target over that of the rest, by own quadrature of both meshes' fields."""
    name, panel = context.name, context.panel(MAX_HZ)
    drives, target = drives_of(context.scene, drives), np.array(said["target_mm"]) * 1e-3
    motions = [Motion(model, drives) for model in (panel.fine, panel.coarse)]
    if not motions[0].drives or said["predicted"]["target_peak_g"] == 0:
        return not_comparable("field: contrast", name, "nothing moves")
    own, rough = (motion.means([target])[1] for motion in motions)
    error = 2 * abs(own - rough)
    if not error < CONTRAST_TOLERANCE:
        return not_comparable("field: contrast", name, f"own error {error:.1e} dB")
    predicted = said["predicted"]
    # As in `plan`: what the bound of the target's peak is of levels there and elsewhere.
    levels = 8.69 * (said["error_bound"] or 0.0) * (1 + predicted["target_peak_g"] / max(predicted["mean_elsewhere_g"], 1e-300))
    return Result("field: contrast", name, abs(predicted["contrast_db"] - own), CONTRAST_TOLERANCE + levels + error)


def peak_field(panel, drives, places):
    """Peak acceleration in g at places, equation 23, and the reference's own error of it.

    Phasors of one frequency are added before their sizes are.
    """
    ids = [actuator.id for actuator in panel.scene.actuators]
    wanted, own = np.zeros(len(places)), np.zeros(len(places))
    for hz in sorted({drive["frequency_hz"] for drive in drives}):
        curve = panel.accelerance(places, [hz])[0]
        # At neighbours too: at a single frequency two meshes may agree by chance.
        error = panel.accelerance_error(places, [0.98 * hz, hz, 1.02 * hz]).max(axis=0)
        phasor = np.zeros(len(places), dtype=complex)
        for drive in drives:
            if drive["frequency_hz"] == hz:
                k = ids.index(drive["actuator"])
                phasor += drive["force_n"] * np.exp(1j * drive["phase_rad"]) * curve[k]
                own += drive["force_n"] * error[k]
        wanted += np.abs(phasor)
    return wanted / STANDARD_GRAVITY, own / STANDARD_GRAVITY
