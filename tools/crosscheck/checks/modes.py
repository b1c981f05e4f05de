"""`era modes`: frequencies, rigid modes, missing and superfluous ones. What damping makes of them: `poles.py`."""

import numpy as np

from ..harness import Result, change, change_layers, either, not_comparable

QUANTITIES = ("mode frequency", "number of modes", "rigid modes")
PLANTS = {
    "mode frequency": either(change(("surface", "material", "youngs_modulus_pa"), 1.01), change_layers("ex_pa", 1.05)),
    "number of modes": "answer",
    "rigid modes": "answer",
}
MAX_HZ = 400.0
# A reference less certain than this says too little about a frequency.
USEFUL = 2e-4


def run(context):
    """Compares the modes up to 400 Hz."""
    panel = context.panel(MAX_HZ)
    answer = context.era.json("modes", "--max-hz", MAX_HZ)["modes"]
    if context.planted("number of modes"):
        answer.pop(len(answer) // 2)
    if context.planted("rigid modes") and answer:
        answer[0]["frequency_hz"] = 1e-3 if answer[0]["frequency_hz"] == 0 else 0.0
    got = np.array([mode["frequency_hz"] for mode in answer])
    bounds = np.array([np.nan if mode["error_bound"] is None else mode["error_bound"] for mode in answer])
    # A little more, so that a mode at the border is not missed for its own error.
    wanted = panel.modes(MAX_HZ * 1.02)[0]
    own = panel.mode_errors(MAX_HZ * 1.02)[0]
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
    return results
