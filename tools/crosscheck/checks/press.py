"""`era press`: how far a press moves the masses, where they are held, what is left of gap and voltage.

A press is steady: of what damps a panel and of what weighs on it nothing has part in it. The program is asked about the scene with losses, dashpots and
masses changed at random, up to heavy ones; the reference's answer is that of the springs.
"""

import tomllib
from dataclasses import replace

import numpy as np

from ..harness import Result, change, change_all, not_comparable
from ..reference.electrostatics import BREAKDOWN_PART, breakdown_v
from ..reference.press import alone, places, press
from ..reference.random_scenes import log_uniform, to_toml

ALONE, FURTHEST, SAG, HELD, LEFT = "press: alone", "press: furthest place", "press: sag", "press: held by", "press: gap and voltage left"
EVERY = 2
QUANTITIES = (ALONE, FURTHEST, SAG, HELD, LEFT)
PLANTS = {
    ALONE: change(("surface", "material", "youngs_modulus_pa"), 1.05),
    FURTHEST: "answer",
    SAG: change(("press", "force_n"), 1.3),
    HELD: change_all("actuator", "air_gap_um", 1.5),
    LEFT: change_all("actuator", "air_gap_um", 1.02),
}
# The program's place is one of the reference's points: only rounding is between the two. A place that is further than the program's is found if a
# point of the reference's own lattice is further.
ROUNDING = 1e-6
# What an actuator on a clamped edge moves, in um: nothing, of which no part is told.
NONE_UM = 1e-9
# Of a travel whose bound is unknown: the program says then that its meshes differ too much (1.2 % off was seen).
OF_TRAVEL = 0.03
# Of a sag whose bound is unknown, and how near to a third of the gap either answer is right: what is between points, and once more for the pull.
OF_SAG = 0.05


def made_heavy_and_lossy(table, rng):
    """Changes losses, dashpots and masses of a scene's table; which ones, for the notes."""
    changed = []

    def change(what, items, make):
        if items and rng.random() < 0.4:
            changed.append(what)
            for item in items:
                item.update(make(item))

    surface, supports, eras = table["surface"], table.get("support", []), table["actuator"]
    elastic = [edge for edge in table.get("edge", []) if edge["kind"] == "elastic"]
    ways = [{}, {"rayleigh_alpha": log_uniform(rng, 10, 1e3), "rayleigh_beta": log_uniform(rng, 1e-5, 1e-3)}, {"modal_ratio": log_uniform(rng, 0.01, 0.5)}]
    if "layer" not in table:
        ways.append({"loss_factor": log_uniform(rng, 0.01, 1.5)})
    if not any(layer.get("loss_factor") for layer in table.get("layer", [])):
        change("surface", [surface], lambda _: {"damping": ways[rng.integers(len(ways))]})
    change("layers", [layer for layer in table.get("layer", []) if "damping" not in surface], lambda _: {"loss_factor": log_uniform(rng, 0.01, 1.5)})
    change("losses of supports", supports, lambda _: {"loss_factor": log_uniform(rng, 0.05, 2.0)})
    change("losses of edges", elastic, lambda _: {"loss_factor": log_uniform(rng, 0.05, 2.0)})
    change("dashpots of supports", supports, lambda _: {"damping_n_s_per_m": log_uniform(rng, 1.0, 1e6)})
    change("dashpots of ERAs", eras, lambda era: {"damping_n_s_per_m": era["damping_n_s_per_m"] * log_uniform(rng, 1.0, 1e4)})
    change("masses", table.get("mass", []), lambda mass: {"mass_g": mass["mass_g"] * log_uniform(rng, 10.0, 1e5)})
    change("moving masses", eras, lambda era: {"moving_mass_g": era["moving_mass_g"] * log_uniform(rng, 1.0, 1e4)})
    change("housings", eras, lambda era: {"housing_mass_g": era["moving_mass_g"] * log_uniform(rng, 1.0, 1e4)})
    change("air that moves along", [table["air"]] if "air" in table else [], lambda _: {"added_mass_kg_per_m2": log_uniform(rng, 0.1, 100.0)})
    return ", ".join(changed) or "as it was"


def _heavy_and_lossy(context):
    """The program on such a scene, and what was changed."""
    table = tomllib.loads(context.era.scene_path.read_text(encoding="utf-8"))
    what = made_heavy_and_lossy(table, context.rng("heavy and lossy"))
    path = context.folder / "heavy.toml"
    path.write_text(to_toml(table), encoding="utf-8")
    return replace(context.era, scene_path=path), what


def run(context):
    scene = context.scene
    era, what = _heavy_and_lossy(context)
    answer = era.json("press")
    panel = context.panel(400.0)
    ats = [tuple(1e-3 * c for c in said["at_mm"]) for said in answer["actuators"]]
    ats = [(at[0], scene.width / 2) for at in ats] if scene.is_bar else ats
    own = press(scene, panel, ats)
    results = []
    for i, (actuator, sag, said, at) in enumerate(zip(scene.actuators, own, answer["actuators"], ats)):
        name = f"{actuator.id}: {sag.kind}; {what}"
        printed = said["alone_um"]
        gap = actuator.air_gap * 1e6
        if context.planted(FURTHEST):
            printed *= 0.9
        if scene.press > 0 and not actuator.inertial and (printed is None) != np.isinf(sag.alone):
            results.append(Result(ALONE, context.name, np.inf, 0.0, True, f"{name}; {printed} um for {1e6 * sag.alone}"))
        if scene.press > 0 and printed is not None and np.isfinite(sag.alone) and not actuator.inertial:
            moved, error = alone(panel, [at])
            here, off = (1e6 * scene.press * values[i, 0] for values in (moved, error))
            bound = said["error_bound"]
            if bound is None or off > 0.05 * here:
                results.append(not_comparable(ALONE, context.name, f"{name}; own error {off / max(here, 1e-300):.1e}"))
            elif not context.planted(FURTHEST):
                results.append(Result(ALONE, context.name, abs(printed - here) / max(here, NONE_UM), bound + off / max(here, NONE_UM) + 1e-9, True, f"{name}; {here:.4g} um"))
            results.append(Result(FURTHEST, context.name, max(0.0, 1e6 * sag.alone / max(printed, NONE_UM) - 1), ROUNDING + (OF_TRAVEL if said["error_bound"] is None else said["error_bound"]) + 2 * sag.error / max(sag.alone, 1e-300), True, name))
        # Where the springs nearly bear it, or nearly do not, either answer is right.
        near = sag.kind != "given" and abs(sag.sag / actuator.air_gap - 1 / 3) < OF_SAG / 3 and printed is not None and 0.8 < said["sag_um"] / gap * 3 < 1.2
        nearly = any(other.kind != "given" and abs(other.sag / a.air_gap - 1 / 3) < OF_SAG / 3 and other.kind == "none" for other, a in zip(own, scene.actuators))
        if near and sag.kind == "none" or nearly:
            results.append(not_comparable(HELD, context.name, f"{name}; nearly borne"))
            continue
        stop = np.inf if said["stop_um"] is None else said["stop_um"]
        same = said["stop"] == sag.kind and (stop == 1e6 * sag.stop or abs(stop - 1e6 * sag.stop) < 1e-6 * gap)
        results.append(Result(HELD, context.name, 0.0 if same else 1.0, 0.0, True, f"{name}, {1e6 * sag.stop:.4g} um; {said['stop']}, {stop:.4g} um"))
        part, bound = sag.sag / actuator.air_gap, said["sag_error_bound"]
        allowed = OF_SAG * max(part, 1e-3) if bound is None else bound * part + 2 * sag.sag_error / actuator.air_gap + ROUNDING
        results.append(Result(SAG, context.name, abs(said["sag_um"] - 1e6 * sag.sag) / gap, allowed, True, f"{name}; {1e6 * sag.sag:.4g} um"))
        # From the program's own sag on, so that this is of gap and voltage alone.
        left = actuator.air_gap - min(1e-6 * said["sag_um"], sag.stop)
        rail = min(other.max_voltage for other in scene.actuators[i % 2 :: 2])
        volts = min(BREAKDOWN_PART * breakdown_v(left), rail)
        off = max(abs(said["gap_left_um"] - 1e6 * left) / gap, abs(said["holds_v"] - volts) / rail)
        results.append(Result(LEFT, context.name, off, 1e-6, True, name))
    return results
