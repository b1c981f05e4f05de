"""`era study`: the weakest place of designs whose ERAs and supports move, as the quick look has it and as finalists have it."""

import copy
import json
import re
import shutil
import tomllib

import numpy as np

from ..harness import Result, change, not_comparable
from ..reference.electrostatics import TRAVEL_PART, force_amplitude
from ..reference.panel import Panel
from ..reference.perception import STANDARD_GRAVITY_M_S2
from ..reference.planner import GRID_HZ, Grid, best_sum, unrelated
from ..reference.random_scenes import to_toml
from ..reference.scene import parse

WEAKEST, PLACE, LOOK = "study: weakest place", "study: peak there", "study: quick look"
QUANTITIES = (WEAKEST, PLACE, LOOK)
PLANTS = {
    WEAKEST: "answer",
    PLACE: change(("surface", "material", "youngs_modulus_pa"), 1.05),
    LOOK: "answer",
}
EVERY, FIRST = 5, 1
MAX_HZ = 400.0
# So little that nothing but the voltage limits a force: what is compared is the panel, and the search.
VOLTS = 50.0
# Times the travel of all fundamentals together that has to have room, for harmonics and for switching on.
ROOM = 8.0
DESIGNS, FINALISTS = 4, 2
# What a quick look may be off by, relative: fewer frequencies, fewer points, coarser elements (docs/src/studies.md).
QUICK = 0.03
# The same relative to the most that any place has: beside a point that is held firmly, the mesh of the bare panel, which knows of no points, misses that
# much of a place's little motion.
BESIDE_HELD = 2.5e-3
# The reference's own error beyond which it says too little, relative, and points that are searched exactly at most.
USEFUL, MOST_POINTS = 0.01, 400


def run(context):
    """A study of a few designs of the scene, and what the reference says of its finalists."""
    rng, name, folder = context.rng("study"), context.name, context.folder
    handed = quiet(tomllib.loads(context.era.scene_path.read_text(encoding="utf-8")))
    (folder / "study-scene.toml").write_text(to_toml(handed), encoding="utf-8")
    moved = [("actuator", 0)] + [("support", 0)] * bool(context.table.get("support"))
    (folder / "study.toml").write_text(text(context, moved, rng), encoding="utf-8")
    out = folder / "study-results"
    # Of a run before this one, by another program perhaps.
    shutil.rmtree(out, ignore_errors=True)
    answer = context.era.json_alone("study", folder / "study.toml", "--out", out, "--workers", 1)
    if not answer["best"]:
        return [not_comparable(WEAKEST, name, "no design is on the surface")]
    # The lattice follows from the surface alone.
    x, y = context.random_point(context.rng("study: lattice"))
    lattice = context.era.json("field", "--at", f"{x * 1e3!r},{y * 1e3!r}", "--unit", "mm", "--intensity-g", 1e-6)["field"]
    points = np.array([(x, y) for y in lattice["y_mm"] for x in lattice["x_mm"]]) * 1e-3
    second = np.logical_and.outer(every_second(lattice["y_mm"]), every_second(lattice["x_mm"])).ravel()
    there = np.array([context.scene.has_surface(*point) for point in points])
    points = points[there], second[there]
    results, looks = [], quick_looks((out / "report.html").read_text(encoding="utf-8"))
    for number, said in enumerate(answer["best"], 1):
        design = quiet(copy.deepcopy(context.table))
        places = tomllib.loads((out / f"best-{number}.toml").read_text(encoding="utf-8"))
        for kind, k in moved:
            for key in ("x_mm", "y_mm"):
                if key in design[kind][k]:
                    design[kind][k][key] = places[kind][k][key]
        results += finalist(context, parse(to_toml(design)), points, said, looks[said["design"]], answer["tolerance"])
    return results


def quiet(table):
    """The scene with so little voltage that nothing limits a drive but that, and without what a press does."""
    table.pop("press", None)
    for actuator in table["actuator"]:
        actuator.pop("stop_um", None)
        actuator.pop("bias_voltage_v", None)
        actuator["max_voltage_v"] = VOLTS
    return table


def text(context, moved, rng):
    """The study's file: each moved part anywhere but at the borders."""
    scene = context.scene
    lines = ['version = 1', 'name = "moved"', 'scene = "study-scene.toml"']
    for kind, k in moved:
        path = f"actuator.{scene.actuators[k].id}" if kind == "actuator" else f"support[{k + 1}]"
        length, width = scene.length * 1e3, scene.width * 1e3
        if scene.is_bar:
            lines += ["[[variable]]", f'key = "{path}.x_mm"', f"from = {0.05 * length!r}", f"to = {0.95 * length!r}"]
        else:
            corners = [0.05 * length, 0.05 * width, 0.95 * length, 0.95 * width]
            lines += ["[[variable]]", f'place = "{path}"', f"within_mm = {corners!r}"]
    lines += ["[[wish]]", 'figure = "weakest_g"', "[method]", 'way = "latin_hypercube"', f"designs = {DESIGNS}"]
    lines += [f"seed = {int(rng.integers(1, 2**31))}", f"finalists = {FINALISTS}", 'look = "quick"']
    return "\n".join(lines) + "\n"


def every_second(lines):
    """Which of a side's lines the quick look begins with: every second one and the last."""
    at = np.arange(len(lines))
    return (at % 2 == 0) | (at == len(lines) - 1)


class Strongest:
    """What can be had at places with a setting for each, where voltages alone limit forces."""

    def __init__(self, model, points):
        self.grid = Grid(model, None, [])
        volts = [force_amplitude(actuator, VOLTS, self.grid.widths, self.grid.grid_hz[:, None]).max(axis=1) for actuator in model.scene.actuators]
        self.force = np.stack(volts, axis=1)
        self.worth = self._worth(points)

    def _worth(self, points):
        return np.abs(self.grid.responses.at(points)) * self.force[:, :, None] / STANDARD_GRAVITY_M_S2

    def has_room(self):
        """Whether no gap closes far."""
        travel = (np.abs(self.grid.responses.gap_change) * self.force[:, :, None]).max(axis=0).sum(axis=0)
        return all(ROOM * own < TRAVEL_PART * actuator.air_gap for own, actuator in zip(travel, self.grid.scene.actuators))

    def at(self, place):
        """In g at one place."""
        return best_sum(self._worth(np.array([place]))[:, :, 0], GRID_HZ, unrelated)[0]

    def strongest(self):
        """The most in g that any place has, each actuator at its best frequency."""
        return self.worth.max(axis=0).sum(axis=0).max()

    def weakest(self, among):
        """The least over those of the points that are `among` and which it is, or None: what serves one point best bounds the others
        from below, so that few are looked at."""
        worth, every = self.worth, np.arange(self.worth.shape[1])
        low, best, chosen = np.where(among, 0.0, np.inf), np.inf, None
        point = int(np.where(among, worth.max(axis=0).sum(axis=0), np.inf).argmin())
        for _ in range(MOST_POINTS):
            value, choice = best_sum(worth[:, :, point], GRID_HZ, unrelated)
            if value < best:
                best, chosen = value, point
            low = np.maximum(low, worth[list(choice), every].sum(axis=0))
            low[point] = np.inf
            point = int(low.argmin())
            if low[point] >= best:
                return best, chosen
        return None


def quick_looks(report):
    """Each design's weakest place in g as it was looked at first, by its number: from the data of the report."""
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', report, re.S).group(1))
    column = [entry["name"] for entry in data["columns"]].index("weakest_g")
    return {int(values[0]): values[column] for _, values in data["rows"]}


def finalist(context, scene, points, said, look, tolerance):
    """One finalist's figures. `points`: places, and which of them the quick look begins with."""
    name, (points, second) = context.name, points
    if said["failed"] is not None:
        return [Result(WEAKEST, name, np.inf, 0.0, True, f"design {said['design']}: {said['failed']}")]
    panel = Panel(scene, MAX_HZ)
    fine, coarse = (Strongest(model, points) for model in (panel.fine, panel.coarse))
    found, among_second = fine.weakest(np.full(len(points), True)), fine.weakest(second)
    if found is None or among_second is None or not fine.has_room():
        return [not_comparable(WEAKEST, name, "gaps close far" if found and among_second else "too many points to look at")]
    own, place = found[0], points[found[1]]
    printed = np.array(said["weakest_mm"]) * 1e-3
    there = fine.at(printed)
    if own <= 0 or there <= 0 or said["error_bound"] is None:
        return [not_comparable(WEAKEST, name, "nothing moves there" if own <= 0 else "no bound")]
    error = panel.safety * max(abs(coarse.at(at) / fine.at(at) - 1) for at in (place, printed)) + panel.floor
    if error > USEFUL:
        return [not_comparable(quantity, name, f"own error {error:.1e}") for quantity in QUANTITIES]
    peak = said["figures"]["weakest_g"]
    if context.planted(LOOK):
        look *= 1.1
    note = f"design {said['design']}: {peak:.5g} at {said['weakest_mm']} mm, own {own:.5g} at {place * 1e3}, bound {said['error_bound']:.1e}"
    results = [Result(PLACE, name, abs(peak / there - 1), said["error_bound"] + error, True, note)]
    # The bound is that of the printed place: another one, that is as weak, may be off by the tolerance.
    least = 1.02 * peak if context.planted(WEAKEST) else peak
    results.append(Result(WEAKEST, name, abs(least / own - 1), max(said["error_bound"], tolerance) + error, True, note))
    # It begins with every second line and goes on around the weakest: a valley between two lines is lost to it (0.9 of the figure was seen).
    most = among_second[0]
    off = max(1 - look / own, look / most - 1, 0.0)
    allowed = QUICK + BESIDE_HELD * fine.strongest() / own + error
    results.append(Result(LOOK, name, off, allowed, True, f"design {said['design']}: {look:.5g} for {own:.5g} to {most:.5g} g"))
    return results
