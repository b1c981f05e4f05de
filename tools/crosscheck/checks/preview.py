"""`POST /v1/preview`: the plan, the field and the scene file of a panel one of whose attachments has been moved."""

import copy

import numpy as np

from ..harness import Result, not_comparable
from ..reference.panel import Panel
from ..reference.planner import Motion, drives_of
from ..reference.random_scenes import to_toml
from ..reference.scene import parse
from ..reference.surface import Surface
from .frames import touch_px

PEAK, FIELD, TOML = "preview: target peak", "preview: field", "preview: scene file"
QUANTITIES = (PEAK, FIELD, TOML)
PLANTS = dict.fromkeys(QUANTITIES, "answer")
EVERY, FIRST = 15, 9
MAX_HZ = 400.0
# Points of the field that are recomputed.
POINTS = 200
# Beyond this part of the largest value the reference says too little.
USEFUL = 5e-3
# What the answer rounds away: six decimals of a g.
DECIMALS_G = 1e-6
# Peaks below this are rounding: a ten-thousandth of what is felt at best (1e-3 g).
NOTHING_G = 1e-7


def run(context):
    """One of the attachments moved to a random place, and a touch at another."""
    rng, scene, name = context.rng("preview"), context.scene, context.name
    kinds = [kind for kind in ("actuator", "support", "mass") if context.table.get(kind)]
    kind = kinds[int(rng.integers(len(kinds)))]
    number = int(rng.integers(len(context.table[kind])))
    x, y = (float(np.round(1e3 * value, 1)) for value in context.random_point(rng, 0.05))
    to = {"x_mm": x} if scene.is_bar else {"x_mm": x, "y_mm": y}
    if scene.in_cutout(x * 1e-3, y * 1e-3):
        return [not_comparable(TOML, name, "moved into a cut-out")]
    x_px, y_px = touch_px(scene, rng)
    place = scene.screen.to_m(x_px, y_px)
    place = (place[0], scene.width / 2) if scene.is_bar else place
    body = {"x_px": x_px, "y_px": y_px, "intensity_g": 0.2, "moves": {f"{kind}[{number + 1}]": to}}
    note = f"{kind}[{number + 1}] to {to}, touch at {place[0] * 1e3:.5g},{place[1] * 1e3:.5g} mm"
    with context.era.serve() as request:
        status, answer = request("POST", "/v1/preview", body)
    if status == 422:
        return [not_comparable(TOML, name, f"{answer.get('type')}: {answer.get('detail')}")]
    if status != 200:
        return [Result(TOML, name, np.inf, 0.0, True, f"{status}: {answer}, {note}")]
    wanted = copy.deepcopy(context.table)
    wanted[kind][number] |= to
    text = answer["scene_toml"]
    if context.planted(TOML):
        text = context.era.scene_path.read_text(encoding="utf-8")
    results = [Result(TOML, name, float(parse(text) != parse_table(wanted)), 0.0, True, note)]
    return results + moved(context, parse_table(wanted), answer, np.array(place), note)


def parse_table(table):
    """The scene of a table."""
    return parse(to_toml(table))


def moved(context, scene, answer, place, note):
    """The drives that the answer has, on an own panel with the attachment in its new place."""
    name, plan, field = context.name, answer["plan"], answer["field"]
    panel = Panel(scene, MAX_HZ)
    drives, surface = drives_of(scene, plan["drives"]), Surface(scene)
    motions = [Motion(model, drives, surface) for model in (panel.fine, panel.coarse)]
    bound = plan["error_bound"]
    if not motions[0].drives or plan["predicted"]["target_peak_g"] < NOTHING_G:
        return [not_comparable(PEAK, name, "nothing moves")]
    if bound is None:
        return [not_comparable(PEAK, name, "no bound")]
    own, rough = (motion.peaks_g([place])[0] for motion in motions)
    said, error = plan["predicted"]["target_peak_g"], 2 * abs(own - rough)
    if context.planted(PEAK):
        said *= 1.1
    results = []
    if error > USEFUL * own:
        results.append(not_comparable(PEAK, name, f"own error {error / own:.1e}"))
    else:
        results.append(Result(PEAK, name, abs(said - own) / said, bound + error / said, True, note))
    lattice = np.array([(x * 1e-3, y * 1e-3) for y in field["y_mm"] for x in field["x_mm"]])
    values = np.array([np.nan if value is None else value for value in field["peak_g"]])
    there = np.array([scene.has_surface(*point) for point in lattice])
    if len(values) != len(lattice) or (np.isnan(values) == there).any():
        return [*results, Result(FIELD, name, np.inf, 0.0, True, f"points given or missing wrongly, {note}")]
    if context.planted(FIELD):
        values = values[::-1] * 1.2
    chosen = context.rng("preview: points").choice(np.flatnonzero(there), min(POINTS, int(there.sum())), replace=False)
    fine, coarse = (motion.peaks_g(lattice[chosen]) for motion in motions)
    top = max(fine.max(), np.nanmax(values))
    error = 2 * np.abs(fine - coarse).max()
    if error > USEFUL * top:
        return [*results, not_comparable(FIELD, name, f"own error {error / top:.1e}")]
    # The model's tolerance, which is that of fields; the bound is about the target's peak.
    allowed = max(bound, answer["tolerance"]) + (DECIMALS_G + error) / top
    worst = np.abs(fine - values[chosen]).argmax()
    at = lattice[chosen][worst] * 1e3
    return [*results, Result(FIELD, name, abs(fine - values[chosen])[worst] / top, allowed, True, f"at {at[0]:.5g},{at[1]:.5g} mm; bound {bound:.1e}, {note}")]
