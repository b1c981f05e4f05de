"""`era modes`: what damping makes of each mode, against the state-space eigenproblem (thesis, equation 16).

Every other scene has its dashpots changed, from next to none to such as hold their points, and loss factors.
"""

import tomllib
from dataclasses import replace

import numpy as np

from ..harness import Result, change, change_all, change_layers, either, not_comparable
from ..reference import poles
from ..reference.panel import Panel
from ..reference.random_scenes import log_uniform, to_toml
from ..reference.scene import parse

POLE, OWN, TWICE, RATIO = "pole", "pole of its mode", "poles told twice", "mode damping ratio"
QUANTITIES = (POLE, OWN, TWICE, RATIO)
_LOSSES = either(
    change(("surface", "damping", "loss_factor"), 2.0),
    change(("surface", "damping", "modal_ratio"), 2.0),
    change_layers("loss_factor", 2.0),
    change_all("actuator", "damping_n_s_per_m", 1.3),
)
PLANTS = {POLE: _LOSSES, OWN: "answer", TWICE: "answer", RATIO: "answer"}
EVERY = 2
MAX_HZ = 400.0
# A reference less certain than this says too little about a pole.
USEFUL = 1e-2
# Least that is believed of the program's bound, and of the reference's own.
FLOOR = 1e-6
# Of the panel's estimate of the reference's own error: real parts go with shapes at dashpots, which settle later than frequencies beside stiff
# points. On scene 1-10 the finer mesh was off by 1.8 times the difference of the two, against two meshes that are finer still.
LATER = 2.0
# Following poles takes an eigenproblem for each step.
MOST_FOLLOWED = 110


def with_other_dashpots(table, rng):
    """Changes dashpots and loss factors of a scene's table; how, for the notes."""
    changed = []
    supports, eras = table.get("support", []), table["actuator"]
    if supports and rng.random() < 0.7:
        size = log_uniform(rng, 1e-2, 1e6)
        for support in supports:
            support["damping_n_s_per_m"] = size * (1.0 if rng.random() < 0.5 else log_uniform(rng, 0.1, 10.0))
        changed.append(f"supports {size:.1e} N s/m")
    if rng.random() < 0.5:
        size = log_uniform(rng, 1e-1, 1e4)
        for era in eras:
            era["damping_n_s_per_m"] *= size
        changed.append(f"ERAs {size:.1e} times")
    if rng.random() < 0.3 and supports:
        for support in supports:
            support["loss_factor"] = log_uniform(rng, 0.05, 1.5)
        changed.append("losses of supports")
    return ", ".join(changed) or "as it is"


def _asked(context):
    """Scene, program and the reference's panel."""
    if context.index // EVERY % 2 == 0:
        return context.scene, context.era, context.panel(MAX_HZ), "as it is"
    own = tomllib.loads(context.era.scene_path.read_text(encoding="utf-8"))
    what = with_other_dashpots(own, context.rng("dashpots"))
    path = context.folder / "dashpots.toml"
    path.write_text(to_toml(own), encoding="utf-8")
    right = tomllib.loads(to_toml(context.table))
    with_other_dashpots(right, context.rng("dashpots"))
    scene = parse(to_toml(right))
    return scene, replace(context.era, scene_path=path), Panel(scene, MAX_HZ), what


def run(context):
    """Compares the poles of modes up to 400 Hz."""
    _, era, panel, what = _asked(context)
    name = context.name
    listed = [mode for mode in era.json("modes", "--max-hz", MAX_HZ)["modes"] if mode["frequency_hz"] > 0]
    # Of a motion that dies out beside a dashpot meshes do not agree on the pole, and the program tells none.
    places = [k for k, mode in enumerate(listed) if mode["damping_ratio"] is not None]
    modes = [listed[k] for k in places]
    found = [np.array([complex(*s) for s in mode["poles_per_s"]]) for mode in modes]
    if context.planted(TWICE) and len(found) > 1:
        found[-1] = found[0]
    if context.planted(OWN) and len(found) > 1:
        found = found[1:] + found[:1]
    if context.planted(RATIO):
        modes = [mode | {"damping_ratio": 1.01 * mode["damping_ratio"]} for mode in modes]
    fine, coarse = poles.modal(panel.fine), poles.modal(panel.coarse)
    values, others = poles.eigenvalues(*fine), poles.eigenvalues(*coarse)

    def own_error(s):
        return LATER * panel.safety * np.abs(others - s).min() / abs(s) + panel.floor

    results = [not_comparable(POLE, name, f"not told; {what}")] * (len(listed) - len(modes))
    seen = []
    for k, (mode, ours) in enumerate(zip(modes, found)):
        note = f"mode at {mode['frequency_hz']:.5g} Hz; {what}"
        modulus = np.sqrt(np.abs(np.prod(ours))) if len(ours) == 2 else abs(ours[0])
        ratio = -ours.real.mean() / modulus
        off = max(abs(mode["damping_ratio"] - max(ratio, 0.0)) / max(ratio, 1e-9), abs(mode["pole_frequency_hz"] * 2 * np.pi / modulus - 1), len(ours) == 2 and ratio <= 1)
        results.append(Result(RATIO, name, float(off), 1e-6, True, note))
        bound = mode["pole_error_bound"]
        for s in ours:
            seen.append(s)
            nearest = values[np.abs(values - s).argmin()]
            # Of two that do not swing the bound is of their mean and ratio.
            loose = 4.0 if len(ours) == 2 else 1.0
            error = own_error(nearest)
            if bound is None or error > USEFUL or bound > 0.1:
                results.append(not_comparable(POLE, name, f"{note}; bound {bound}, own error {error:.1e}"))
            else:
                results.append(Result(POLE, name, abs(nearest - s) / abs(s), loose * bound + error + FLOOR, True, f"{note}; {s:.6g} for {nearest:.6g}, ratio {ratio:.3g}"))
    apart = [abs(a - b) / abs(a) for i, a in enumerate(seen) for b in seen[:i]]
    equal = [np.sort(np.abs(values - s) / abs(s))[1] for s in seen]
    same = sum(own < 1e-9 for own in apart)
    # Equal poles of a symmetric panel are told as often as they are there.
    results.append(Result(TWICE, name, float(same), float(sum(own < 1e-6 for own in equal)), True, f"{len(seen)} poles; {what}"))
    squares = fine[0]
    free = panel.fine.free_motions
    if len(squares) <= MOST_FOLLOWED and free == 0:
        count = min(len(listed), int((squares <= (2 * np.pi * MAX_HZ) ** 2).sum()))
        known, sure = poles.followed(*fine, count)
        known, sure = ([of_all[k] for k in places if k < count] for of_all in (known, sure))
        for k in range(len(known)):
            if not sure[k] or modes[k]["pole_error_bound"] is None or len(found[k]) == 2:
                results.append(not_comparable(OWN, name, f"mode {k + 1}; {what}"))
                continue
            bound = modes[k]["pole_error_bound"] + own_error(known[k]) + FLOOR
            results.append(Result(OWN, name, abs(found[k][0] - known[k]) / abs(known[k]), bound, True, f"mode {k + 1}, {found[k][0]:.5g} for {known[k]:.5g}; {what}"))
    return results
