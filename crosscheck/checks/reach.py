"""`era field --reach` and `--schemes`: what can be had at points of the printed maps, and everywhere with one setting."""

import numpy as np

from ..harness import Result, change, change_all, not_comparable
from ..reference.electrostatics import force_amplitude, widest_pulse
from ..reference.perception import STANDARD_GRAVITY_M_S2
from ..reference.planner import Drive, Grid, Motion, best_sum, drives_of

LEAST, MOST, CONTRAST, SCHEMES = "reach: strongest, from below", "reach: strongest, from above", "reach: contrast", "reach: schemes"
QUANTITIES = (LEAST, MOST, CONTRAST, SCHEMES)
PLANTS = {
    LEAST: change_all("actuator", "max_voltage_v", 0.7),
    MOST: change_all("actuator", "electrode_area_mm2", 1.3),
    CONTRAST: change(("surface", "material", "youngs_modulus_pa"), 1.3),
    SCHEMES: change(("surface", "material", "youngs_modulus_pa"), 1.05),
}
EVERY, FIRST = 5, 3
# Not the whole band: every point of a map is a search of its own. Room for four frequencies 20 Hz apart.
BAND_HZ = 80
POINTS = 4
# Relative, of peaks by forces that are at a limit; the maps' fields have the default tolerance of 1e-3.
TOLERANCE = 0.01
CONTRAST_DB = 0.3
# A scheme's peak at the place where it is least is a small part of its largest one.
SCHEME_PART = 2e-3


def run(context):
    """Some points of the maps, and every setting of `--schemes`, of bars and of plates with one actuator.

    Maps of other plates are thousands of searches: minutes of the program's time.
    """
    if not context.scene.is_bar and len(context.scene.actuators) > 1:
        return []
    rng, scene, name = context.rng("reach"), context.scene, context.name
    start = int(rng.integers(40, 321))
    band = ("--from", start, "--to", start + BAND_HZ)
    maps = context.era.json("field", "--reach", *band)["maps"]
    grid = Grid(context.panel(400.0).fine, context.panel(1000.0).fine, np.arange(start, start + BAND_HZ + 1.0))
    xs, ys = maps["x_mm"], maps["y_mm"]
    there = [k for k, value in enumerate(maps["strongest_g"]) if value is not None]
    ids = [actuator.id for actuator in scene.actuators]
    order = [ids.index(actuator) for actuator in maps["actuators"]]
    results = []
    for k in rng.choice(there, min(POINTS, len(there)), replace=False):
        place = np.array([xs[k % len(xs)], ys[k // len(xs)]]) * 1e-3
        peak, rest = grid.target(place)
        strongest = maps["strongest_g"][k] * STANDARD_GRAVITY_M_S2
        note = f"at {place[0] * 1e3:.5g},{place[1] * 1e3:.5g} mm"
        sure = best_sum(peak * grid.sure_force().max(axis=2), grid.grid_hz)[0]
        most = sum(
            (peak[:, i] * force_amplitude(actuator, actuator.max_voltage, widest_pulse(grid.grid_hz))).max()
            for i, actuator in enumerate(scene.actuators)
        )
        if most < 1e-9:
            results.append(not_comparable(LEAST, name, "nothing moves"))
            continue
        results.append(Result(LEAST, name, max(0.0, 1 - strongest / sure), TOLERANCE, True, note))
        results.append(Result(MOST, name, max(0.0, strongest / most - 1), TOLERANCE, True, note))
        results.append(quietest(context, grid, place, peak, rest, maps["contrast_db"][k], maps["contrast_hz"][k], order, note))
    return [result for result in results if result] + schemes(context, band)


def quietest(context, grid, place, peak, rest, printed_db, printed_hz, order, note):
    """Contrast of the drive with the least mean square elsewhere: forces as worth over cost, at the printed frequencies."""
    costs = (rest[:, :, None] + grid.harmonics[0]).min(axis=2)
    drives = []
    for actuator, frequency in zip(order, printed_hz):
        k = int(round(frequency - grid.grid_hz[0]))
        if abs(grid.grid_hz[k] - frequency) > 1e-6:
            return None
        if costs[k, actuator] <= 0:
            continue
        drives.append(Drive(actuator, float(frequency), 0.0, 2 / 3, 0.0, peak[k, actuator] / costs[k, actuator]))
    if not drives:
        return None
    _, contrast = Motion(context.panel(400.0).fine, drives, grid.surface).means([place])
    return Result(CONTRAST, context.name, abs(contrast - printed_db), CONTRAST_DB, True, f"{note}; {printed_hz} Hz")


def schemes(context, band):
    """The peak at the place where each scheme's one setting is weakest, and where it is strongest."""
    answer = context.era.json("field", "--schemes", *band)
    results = []
    for scheme in answer["schemes"]:
        motion = Motion(context.panel(400.0).fine, drives_of(context.scene, scheme["setting"]))
        said = scheme["one_setting"]
        places = np.array([said["least_at_mm"], said["most_at_mm"]]) * 1e-3
        own = motion.peaks_g(places)
        worst = np.abs(own - [said["least"], said["most"]]).max() / max(said["most"], 1e-300)
        results.append(Result(SCHEMES, context.name, worst, SCHEME_PART, True, scheme["scheme"]))
    return results
