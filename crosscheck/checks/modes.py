"""`era modes`: frequencies, damping ratios, rigid modes, missing and superfluous ones."""

import numpy as np

from ..harness import Result, change, change_all, change_layers, either, not_comparable

QUANTITIES = ("mode frequency", "mode damping ratio", "number of modes", "rigid modes")
PLANTS = {
    "mode frequency": either(change(("surface", "material", "youngs_modulus_pa"), 1.01), change_layers("ex_pa", 1.05)),
    "mode damping ratio": either(
        change(("surface", "damping", "loss_factor"), 2.0),
        change(("surface", "damping", "modal_ratio"), 2.0),
        change_layers("loss_factor", 2.0),
        change_all("actuator", "damping_n_s_per_m", 1.05),
    ),
    "number of modes": "answer",
    "rigid modes": "answer",
}
MAX_HZ = 400.0
# A reference less certain than this says too little about a frequency.
USEFUL = 2e-4
# Where the program prints no bound for it: a damping ratio is to be within this of itself, and of the frequency's bound.
RATIO_TOLERANCE = 2e-3
# Modes closer than this, relative, are a group.
CLOSE = 0.02


def run(context):
    """Compares the modes up to 400 Hz."""
    panel = context.panel(MAX_HZ)
    answer = context.era.json("modes", "--max-hz", MAX_HZ)["modes"]
    if context.planted("number of modes"):
        answer.pop(len(answer) // 2)
    if context.planted("rigid modes") and answer:
        answer[0]["frequency_hz"] = 1e-3 if answer[0]["frequency_hz"] == 0 else 0.0
    got = np.array([mode["frequency_hz"] for mode in answer])
    ratios = np.array([mode["damping_ratio"] for mode in answer])
    bounds = np.array([np.nan if mode["error_bound"] is None else mode["error_bound"] for mode in answer])
    # A little more, so that a mode at the border is not missed for its own error.
    wanted, damping = panel.modes(MAX_HZ * 1.02)
    own, own_damping = panel.mode_errors(MAX_HZ * 1.02)
    name = context.name
    results = []
    rigid = panel.rigid_modes()
    results.append(Result("rigid modes", name, abs(int((got == 0).sum()) - rigid), 0))
    slack = np.nanmax(bounds, initial=1e-3) + own
    surely, possibly = int((wanted * (1 + slack) <= MAX_HZ).sum()), int((wanted * (1 - slack) <= MAX_HZ).sum())
    results.append(Result("number of modes", name, max(surely - len(got), len(got) - possibly, 0), 0))
    for k in range(min(len(got), len(wanted))):
        if k < rigid:
            continue
        if np.isnan(bounds[k]) or own[k] > USEFUL:
            results.append(not_comparable("mode frequency", name, f"mode {k + 1}: own error {own[k]:.1e}, bound {bounds[k]:.1e}"))
            continue
        difference = abs(got[k] - wanted[k]) / wanted[k]
        results.append(Result("mode frequency", name, difference, bounds[k] + own[k], True, f"mode {k + 1}, {got[k]:.6g} Hz for {wanted[k]:.6g}"))
    return results + _ratios(name, rigid, ratios, bounds, wanted, damping, own, own_damping)


def _mixed(group, off, wanted, damping):
    """What errors of the modes beside a group may mix into it, relative to its ratio: 2 e sqrt(of the ratios) + e^2 of theirs, e the
    errors of the frequencies over their distance."""
    mixed, own = 0.0, damping[group].mean()
    for inside, beside in ((group.start, group.start - 1), (group.stop - 1, group.stop)):
        if 0 <= beside < len(off) and wanted[beside] > 0:
            part = (off[inside] + off[beside]) / abs(wanted[beside] / wanted[inside] - 1)
            mixed += 2 * part * np.sqrt(damping[beside] / own) + part**2 * damping[beside] / own
    return mixed


def _ratios(name, rigid, ratios, bounds, wanted, damping, own, own_damping):
    """Damping ratios. Any mixture of close modes is a mode: of a group of them the sum is compared, which mixing leaves alone."""
    results, first = [], rigid
    while first < len(wanted):
        last = first + 1
        while last < len(wanted) and wanted[last] < wanted[last - 1] * (1 + CLOSE):
            last += 1
        group, first = slice(first, last), last
        if last > len(ratios):
            break
        note = f"modes {group.start + 1} to {last}" if last - group.start > 1 else f"mode {last}"
        total = damping[group].sum()
        if np.isnan(bounds[group]).any() or own[group].max() > USEFUL:
            results.append(not_comparable("mode damping ratio", name, note))
        elif total > 0:
            # Ratios follow from shapes, which are off by more than frequencies are.
            off = (bounds[group] + own[group]).max()
            tolerance = RATIO_TOLERANCE + 20 * off + own_damping[group].sum() / total
            tolerance += _mixed(group, bounds + own[: len(bounds)], wanted, damping)
            if np.isnan(tolerance):
                # A mode beside it without a bound may be mixed into it by any amount.
                results.append(not_comparable("mode damping ratio", name, f"{note}, beside one without a bound"))
                continue
            results.append(Result("mode damping ratio", name, abs(ratios[group].sum() / total - 1), tolerance, True, note))
    return results
