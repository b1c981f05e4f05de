"""`era plan --spread`: the weakest and the strongest of the panels with everything off, and one of both of a kind by itself, each made anew
from the told factors and places, and the peak of the plan's drives there, against the told levels."""

import numpy as np

from ..harness import TIME_LIMIT_S, Program, Result, not_comparable
from ..reference.off import off
from ..reference.panel import Panel
from ..reference.random_scenes import log_uniform, to_toml
from ..reference.scene import parse
from .field import peak_field
from .finger import finger

ALL = "tolerances: all at once"
SPRINGS, MODULUS, THICKNESS, PLACES = (f"tolerances: {what}" for what in ("springs", "Young's modulus", "thickness", "places"))
# Kinds as they are named in the answer, and fields of a panel that is off.
KINDS = {"springs": (SPRINGS, "springs"), "youngs_modulus": (MODULUS, "youngs_modulus")}
KINDS |= {"thickness": (THICKNESS, "thickness"), "places": (PLACES, "places_mm")}
QUANTITIES = (ALL, SPRINGS, MODULUS, THICKNESS, PLACES)
# The told panel is altered: another panel than the one whose level is told.
PLANTS = {quantity: "answer" for quantity in QUANTITIES}
EVERY, FIRST = 8, 2
MAX_HZ = 400.0
# It models up to 128 panels: some seconds as a rule, two minutes with patches that have actuators beside their borders.
LIMIT_S = 10 * TIME_LIMIT_S
# How often there is a finger on the place.
FINGERS = 0.4
# Each panel is modelled for a tolerance of 1e-2 of its curve, and so is the one as meant, without a bound of its own.
MODELLED = 1e-2
# The reference's own error of a level beyond which it says too little, in dB.
USEFUL_DB = 0.1
# Levels beyond which one of both panels has a node line near the target: what is left there are differences of large numbers.
NODE_DB = 40.0
# Factors and places are within what was asked for up to rounding; places that are nearer to a border than this part of a side are put on it.
ROUNDING, SNAPPED = 1e-9, 2e-3


def run(context):
    """One plan at a random place: everything at once, and one kind alone."""
    rng, scene, name = context.rng("tolerances"), context.scene, context.name
    table = context.table
    if rng.random() < FINGERS:
        weight = scene.material.density_kg_m3 * scene.length * scene.width * scene.thickness
        table = table | {"finger": finger(rng, weight)}
    path = context.folder / "tolerances.toml"
    path.write_text(to_toml(table), encoding="utf-8")
    x, y = context.random_point(rng)
    # Nothing is put into a cut-out: random scenes have everything 1 mm or more beside them.
    places_mm = 1.0 if scene.cutouts else min(log_uniform(rng, 0.5, 5.0), 0.02e3 * scene.length)
    asked = {"springs": rng.uniform(0.1, 0.5), "youngs_modulus": rng.uniform(0.05, 0.3), "thickness": rng.uniform(0.02, 0.15), "places_mm": places_mm}
    era = Program(context.era.binary, path, context.folder, LIMIT_S)
    touch = ("--at", f"{x * 1e3!r},{y * 1e3!r}", "--unit", "mm", "--intensity-g", float(rng.choice([0.05, 0.5, 5.0])))
    plan = era.json("plan", *touch, "--spread=" + ",".join(repr(float(value)) for value in asked.values()))
    said = plan["off"]
    alone = {own["what"]: own for own in said["of"]}
    chosen = str(rng.choice(list(alone)))
    chosen = next((what for what, (quantity, _) in KINDS.items() if context.planted(quantity) and what in alone), chosen)
    meant, own = level_of(parse(to_toml(table)), (x, y), plan["drives"])
    ends = (("least_db", "weakest"), ("most_db", "strongest"))
    results = []
    fields = [field for what, (_, field) in KINDS.items() if what in alone]
    # Each panel is some seconds of the reference's: of a kind by itself one end.
    looks = ((ALL, said, fields, ends), (KINDS[chosen][0], alone[chosen], [KINDS[chosen][1]], ends[int(rng.integers(2)) :][:1]))
    for quantity, told, fields, ends in looks:
        for key, which in ends:
            panel, level = told[which], told[key]
            if wrong := misfit(scene, panel, fields, asked):
                results.append(Result(quantity, name, np.inf, 0.0, True, wrong))
                continue
            if context.planted(quantity):
                spoil(panel, scene)
            if meant <= 0 or abs(level) > NODE_DB:
                results.append(not_comparable(quantity, name, f"{which} {level:.1f} dB, {meant:.2e} g as meant"))
                continue
            peak, there = level_of(off(parse(to_toml(table)), panel), (x, y), plan["drives"])
            error = decibels(own / meant) + decibels(there / max(peak, 1e-300))
            if not error < USEFUL_DB:
                results.append(not_comparable(quantity, name, f"own error {error:.1e} dB"))
                continue
            found = 20 * np.log10(peak / meant)
            note = f"{which} {level:.3f} dB, own {found:.3f} +- {error:.1e}, at {x * 1e3:.5g},{y * 1e3:.5g} mm"
            results.append(Result(quantity, name, abs(level - found), 2 * decibels(MODELLED) + error, True, note))
    return results


def level_of(scene, place, drives):
    """Peak of the drives in g at a place with the scene's finger on it, and the reference's own error of it."""
    if scene.finger is not None:
        scene = scene.touched(*place)
    wanted, own = peak_field(Panel(scene, MAX_HZ), drives, np.array([place]))
    return wanted[0], own[0]


def decibels(part):
    """A relative error in dB, at most."""
    return -20 * np.log10(1 - part) if part < 1 else np.inf


def misfit(scene, panel, fields, asked):
    """What a told panel has that it must not have, or has not: parts, and how far each is off."""
    if sorted(panel) != sorted(fields):
        return f"off are {', '.join(panel)} instead of {', '.join(fields)}"
    counts = {kind: len(getattr(scene, kind)) for kind in ("supports", "edges", "masses", "actuators")}
    for field, kinds in (("springs", ("supports", "edges", "actuators")), ("places_mm", ("supports", "masses", "actuators"))):
        wanted = {kind: counts[kind] for kind in kinds if counts[kind]}
        if field in panel and {kind: len(values) for kind, values in panel[field].items()} != wanted:
            return f"{field} has other parts than the scene"
    factors = [("springs", factor) for values in panel.get("springs", {}).values() for factor in values]
    factors += [(field, panel[field]) for field in ("youngs_modulus", "thickness") if field in panel]
    for field, factor in factors:
        if abs(factor - 1) > asked[field] + ROUNDING:
            return f"{field}: {factor} is off by more than {asked[field]}"
    for kind, places in panel.get("places_mm", {}).items():
        for item, place in zip(getattr(scene, kind), places):
            for at, mm, side in ((item.x, place[0], scene.length), (item.y, place[1], scene.width)):
                if abs(mm - at * 1e3) > asked["places_mm"] + (SNAPPED + ROUNDING) * side * 1e3 or not -ROUNDING <= mm / side / 1e3 <= 1 + ROUNDING:
                    return f"{kind}: {place} mm is off by more than {asked['places_mm']} mm"
    return None


def spoil(panel, scene):
    """Another panel: springs half as stiff, what else is off the other way, places elsewhere."""
    for kind, factors in panel.get("springs", {}).items():
        panel["springs"][kind] = [factor / 2 for factor in factors]
    for field in ("youngs_modulus", "thickness"):
        if field in panel:
            panel[field] = 2 - panel[field]
    for places in panel.get("places_mm", {}).values():
        for place in places:
            place[0] += (50.0 if place[0] < 5e2 * scene.length else -50.0) * scene.length
