"""`era effect click` and `double_click`: the windows as printed, played on own modes in gaps that move, with electrodes behind resistors; the rules
of a board; contrast and sound; and the strongest crisp click with free forces, as an own linear programme. With `--elf` the firmware image plays the windows on the
emulated board, and what is integrated are the pulses at its pins, rebuilt from its timers' registers, at the rails as they stood.

What the figures mean is said in docs/src/effects.md: accelerations in the felt band, full to 300 Hz and a raised cosine to nothing at
500 Hz; times from the burst's common start.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import linprog

from ..harness import ProgramFailed, Result, change_all, not_comparable
from ..reference import motion

MOVED = ("click: acceleration", "click: peak", "click: time of the peak", "click: quiet", "click: travel", "click: contrast", "click: sound")
QUANTITIES = (*MOVED, "click: rules of the board", "click: best possible")
WITH_FIRMWARE = ("click: motion by the firmware",)
PLANTS = {
    "click: acceleration": "answer",
    "click: peak": change_all("actuator", "air_gap_um", 1.04),
    "click: time of the peak": "answer",
    "click: quiet": "answer",
    "click: travel": change_all("actuator", "air_gap_um", 0.45),
    "click: contrast": "answer",
    "click: sound": "answer",
    "click: rules of the board": "answer",
    "click: best possible": "answer",
    "click: motion by the firmware": "answer",
}
EVERY, FIRST = 6, 2
LAUNCH = Path(__file__).resolve().parents[2] / "emulator" / "launch.py"
# Accelerations over time agree to this part of the peak, root mean square over the time in s in which a click is; samples of an export in Hz.
RMS, COMPARED_S, EXPORTED_HZ = 0.02, 0.2, 8000
MAX_HZ, BAND_HZ, MOST = 1000.0, 2000.0, 120
G = 9.80665
# A step is half of the program's: 25 us leave 3 % of a peak that is a twentieth of what is not felt (scene 194).
STEP_S, RECORD_S = 1.25e-5, 1.0
# A board's rules (docs/src/protocol.md, "Windows"), in us, and the supply's current in A over 10 ms.
LEAST_WIDTH_US, GUARD_US, MOST_WINDOWS, MOST_CURRENT_A = 300.0, 200.0, 24, 0.5e-3
# Of an electrode in F, as the board counts it at least, and of a rail's two bleeders in ohm.
COUNTED_F, BLEEDERS_OHM = 116e-12, 50e6
# Of the peak: gaps move between steps, which are 25 us in the program. A motion at 500 Hz that has a tenth of the peak
# moves by 0.03 of the peak in 0.1 ms.
PEAK, QUIET = 0.025, 0.035
# Of contrast and sound, in dB: forces off by PEAK are 0.2 dB. What still moves after 1 s by more than this part is left out: figures are those of
# a record that begins again after 1 s.
DECIBEL, STILL_MOVING = 0.3, 0.01
# Columns and rows of the places whose motion is the surface's, and the velocity of 0 dB in m/s.
GRID, REFERENCE_M_PER_S = (6, 4), 1e-3
# Columns and rows of places of a scene that was given, and the step from one to the next: without a common divisor with 96 or 12.
CELLS, STRIDE = (12, 8), 41
# A place that the strongest click moves by less, in g, may be without one: bounds of the gaps may forbid all voltage.
MOVABLE_G = 0.02
# What moves less, in g, is hardly felt.
NOTHING = 3e-3
# Two linear programmes over responses that differ as those of single clicks do (PEAK), at the few samples at which their bounds are tight.
BEST = 0.05
# Where what modes above the band add is taken, in Hz, and up to where it counts: that of A-weighting.
REST_HZ, HEARD_HZ = 200.0, 1000.0
# Free forces: pieces of 0.5 ms for 30 ms, peaks after so many ms, quiet from then on, samples in s.
PIECE_S, PIECES, PEAKS_MS, QUIET_MS, SAMPLE_S, LOOKED_S = 5e-4, 60, (8, 12, 15), 45, 2.5e-4, 0.25
HERTZ = np.arange(1, 500)


def felt_weight(hertz):
    """What frequencies in Hz count."""
    return np.where(hertz <= 0, 0.0, 1.0) * np.where(hertz <= 300, 1.0, np.where(hertz < 500, 0.5 * (1 + np.cos(np.pi * (hertz - 300) / 200)), 0.0))


def felt(records, step):
    """The felt part of records (one, or one in each column), which are taken to begin again at their end."""
    lines, weight = np.fft.rfft(records, axis=0), felt_weight(np.fft.rfftfreq(len(records), step))
    return np.fft.irfft(lines * weight.reshape(-1, *[1] * (records.ndim - 1)), len(records), axis=0)


def whole_acceleration(system, record):
    """Accelerations of the points in m/s^2, up to HEARD_HZ: by the modes, and by what the modes above the band add, which follows the forces at
    once (a stiff panel may have no mode of its own in the band). The record is taken to begin again at its end."""
    hertz = np.fft.rfftfreq(len(record.force), STEP_S)
    rest = system.points_rest([REST_HZ])[0].real
    lines = np.fft.rfft(record.force, axis=0) @ rest.T
    lines *= np.where(hertz <= HEARD_HZ, -((2 * np.pi * hertz) ** 2), 0.0)[:, None]
    return record.acceleration + np.fft.irfft(lines, len(record.force), axis=0)


def run(context):
    """One click: at a random point of a random scene, or of a scene that was given one of a grid, with 0.5 g as in docs/src/effects.md."""
    rng, name, scene = context.rng("clicks"), context.name, context.scene
    if context.is_given_scene:
        point, strength = place_of_grid(scene, context.index), 0.5
    else:
        point = context.random_point(rng)
        # Some ask for more than anything can make: what comes is as strong as it can be.
        strength = 1000.0 if rng.random() < 0.2 else float(np.exp(rng.uniform(np.log(0.05), np.log(2))))
    # Every fourth click of random scenes is a double one: what the second adds begins while the panel still moves.
    period_ms = None if context.is_given_scene or rng.random() < 0.75 else int(rng.integers(50, 400))
    which = ("click",) if period_ms is None else ("double_click", "--period-ms", period_ms)
    where = f"{' '.join(map(str, which))} at {point[0] * 1e3:.4g},{point[1] * 1e3:.4g} mm, {strength:.3g} g"
    at, exported = f"{point[0] * 1e3!r},{point[1] * 1e3!r}", context.folder / "click.csv"
    asked = ("--at", at, "--unit", "mm", "--intensity-g", strength, "--export", exported, "--effect", *which)
    try:
        answer = context.era.json("effect", *asked)
    except ProgramFailed as failure:
        return [not_comparable(quantity, name, f"no click: {failure}") for quantity in QUANTITIES]
    ids, predicted = [era.id for era in scene.actuators], answer["predicted"]
    windows = [
        motion.Window(ids.index(w["actuator"]), w["begin_us"] * 1e-6, (w["begin_us"] + w["width_us"]) * 1e-6, 1 if w["electrode"] == "A" else -1, w["voltage_v"])
        for w in answer["windows"]
    ]
    panel = context.panel(MAX_HZ)
    if not windows:
        none = [not_comparable(quantity, name, "nothing moves the place") for quantity in QUANTITIES[:-1]]
        return [*none, _best(context, panel, point, windows, answer, where)]
    results = [_rules(context, windows, where)]
    results.append(_best(context, panel, point, windows, answer, where))
    system = motion.System(panel, BAND_HZ, [point, *_middles_of_cells(scene)])
    if system.size > MOST or system.defective:
        return results + [not_comparable(quantity, name, f"{system.size} modes, or poles that coincide") for quantity in MOVED]
    if predicted["peak_g"] < NOTHING:
        return results + [not_comparable(quantity, name, "nothing moves") for quantity in MOVED]
    if context.firmware:
        played = _play_on_firmware(context.firmware, windows)
        results.append(_compare_with_planned(context, system, windows, played, where))
        windows = played
    planned = G * np.loadtxt(exported, delimiter=",", skiprows=1)[:, 1]
    return results + _motion(context, system, windows, predicted, planned, period_ms, where)


def place_of_grid(scene, index):
    """The middle of a cell in m; 96 indices in a row take every cell of a plate's once, and a few of them cells far from each other."""
    columns, rows = CELLS[0], 1 if scene.is_bar else CELLS[1]
    middles = [((i + 0.5) / columns * scene.length, (j + 0.5) / rows * scene.width) for j in range(rows) for i in range(columns)]
    there = [place for place in middles if not scene.in_cutout(*place)]
    return there[index * STRIDE % len(there)]


def _play_on_firmware(elf, windows):
    """What the firmware image makes of windows."""
    rails = [max((window.voltage_v for window in windows if window.actuator % 2 == rail), default=0.0) for rail in range(2)]
    timed = [(w.actuator, "a" if w.sign > 0 else "b", w.on * 1e6, (w.off - w.on) * 1e6) for w in windows]
    command = [sys.executable, str(LAUNCH), "--play-windows", "--elf", str(elf)]
    done = subprocess.run(command, input=json.dumps({"rails_v": rails, "windows": timed}), capture_output=True, text=True, timeout=600, check=False)
    if done.returncode != 0:
        raise ProgramFailed(command, done.returncode, done.stderr)
    answer = json.loads(done.stdout)
    return [
        motion.Window(channel, begin_us * 1e-6, (begin_us + width_us) * 1e-6, 1 if electrode == "a" else -1, answer["rails_v"][channel % 2])
        for channel, electrode, begin_us, width_us in answer["pulses"]
    ]


def _compare_with_planned(context, system, planned, played, where):
    """How far the felt motion by the firmware's pulses is from that by the windows as printed: root mean square, in parts of the peak."""
    (quantity,), records = WITH_FIRMWARE, []
    if context.planted(quantity):
        played = played[1:]
    for windows in (planned, played):
        voltages = motion.Voltages(windows, len(system.gap), times=system.times)
        record = motion.integrate(system, voltages, RECORD_S - STEP_S, STEP_S)
        records.append(felt(whole_acceleration(system, record)[:, 0], STEP_S))
    count = int(COMPARED_S / STEP_S)
    difference = np.sqrt(np.mean((records[1] - records[0])[:count] ** 2)) / np.abs(records[0]).max()
    return Result(quantity, context.name, difference, RMS, note=f"{len(played)} pulses for {len(planned)} windows, {where}")


def _rules(context, windows, where):
    """How many of a board's rules are broken."""
    scene = context.scene
    broken = int(len(windows) > MOST_WINDOWS)
    rails = {}
    for window in windows:
        rails.setdefault(window.actuator % 2, set()).add(window.voltage_v)
        era = scene.actuators[window.actuator]
        broken += window.voltage_v > min(era.max_voltage, 2000.0) + 1e-9
        broken += (window.off - window.on) * 1e6 < LEAST_WIDTH_US - 1e-6
    broken += sum(len(volts) > 1 for volts in rails.values())
    for actuator in {window.actuator for window in windows}:
        own = sorted((w.on, w.off) for w in windows if w.actuator == actuator)
        edges = [0.0, *[off for _, off in own]]
        broken += sum((on - off) * 1e6 < GUARD_US - 1e-6 for (on, _), off in zip(own, edges))
    charge = lambda w: max(COUNTED_F, scene.actuators[w.actuator].capacitance) * w.voltage_v
    bleeders = sum(max(volts) for volts in rails.values()) / BLEEDERS_OHM
    within = lambda start: sum(charge(w) for w in windows if start <= w.on < start + 0.01) / 0.01
    broken += bleeders + max(within(w.on) for w in windows) > MOST_CURRENT_A
    if context.planted("click: rules of the board"):
        broken += 1
    return Result("click: rules of the board", context.name, float(broken), 0.0, note=where)


def _motion(context, system, windows, predicted, planned, period_ms, where):
    name = context.name
    voltages = motion.Voltages(windows, len(system.gap), times=system.times)
    record = motion.integrate(system, voltages, RECORD_S - STEP_S, STEP_S)
    if record.pulled_in:
        return [Result("click: travel", name, np.inf, 1.0, note=f"pulled in, {where}")]
    travel = np.abs(record.gap_change / system.gap).max()
    acceleration = whole_acceleration(system, record)
    own = felt(acceleration[:, 0], STEP_S)
    count = int((COMPARED_S + 1e-3 * (period_ms or 0)) * EXPORTED_HZ)
    # A planted mistake: 1 ms late.
    planned = np.roll(planned, 8) if context.planted("click: acceleration") else planned
    difference = own[:: round(1 / (EXPORTED_HZ * STEP_S))][:count] - planned[:count]
    difference = np.sqrt(np.mean(difference**2)) / np.abs(own).max()
    own = np.abs(own)
    # What comes before the beginning, as the band has no phase, is at the end.
    own = own[: int(0.9 * len(own))]
    # Of two clicks, where the second begins in the felt record; the peak is that of the first, and one of the two is the weaker one.
    second = len(own) if period_ms is None else round(1e-3 * period_ms / STEP_S)
    peak, time = own[:second].max(), STEP_S * np.arange(len(own))
    weaker = min(half.max() for half in (own[:second], own[second:]) if len(half))
    printed_ms = predicted["peak_at_ms"] * (1.4 if context.planted("click: time of the peak") else 1.0)
    there = own[np.abs(time - printed_ms * 1e-3) <= 1.5e-4].max(initial=0.0)
    note = f"{predicted['peak_g']:.3g} g for {peak / G:.3g} g, quiet at {predicted['quiet_ms']} ms, {where}"
    quiet_s = 1e-3 * (predicted["quiet_ms"] or 900.0) - (0.008 if context.planted("click: quiet") else 0.0)
    after, before = own[time > quiet_s + 1e-4], own[time > quiet_s - 2e-4]
    # From then on it is below a tenth, and just before it was not.
    missed = max(after.max(initial=0.0) / peak - 0.1, 0.1 - before.max(initial=0.0) / peak if predicted["quiet_ms"] else 0.0, 0.0)
    return [
        *_surface(context, acceleration, predicted, where),
        Result("click: acceleration", name, difference, RMS, note=note),
        Result("click: peak", name, max(abs(predicted["peak_g"] * G / peak - 1), abs(predicted["peak_least_g"] * G / weaker - 1)), PEAK, note=note),
        Result("click: time of the peak", name, 1 - there / peak, PEAK, note=note),
        Result("click: quiet", name, missed, QUIET, note=note),
        Result("click: travel", name, 3 * travel, 1.0, note=where),
    ]


def _middles_of_cells(scene):
    """Places in m on which the surface's motion is averaged: the middles of 6 x 4 cells, 6 of a bar, none in cut-outs."""
    columns, rows = GRID[0], 1 if scene.is_bar else GRID[1]
    middles = [((i + 0.5) / columns * scene.length, (j + 0.5) / rows * scene.width) for j in range(rows) for i in range(columns)]
    return [place for place in middles if not scene.in_cutout(*place)]


def _surface(context, acceleration, predicted, where):
    """Contrast and sound, from accelerations in m/s^2 over 1 s: of the target, then of the places on the surface."""
    name, quantities = context.name, ("click: contrast", "click: sound")
    energy = np.sum(acceleration**2, axis=0)
    if np.max(np.sqrt(np.mean(acceleration[-4000:] ** 2, axis=0)) / np.abs(acceleration).max(axis=0)) > STILL_MOVING or energy[1:].max() == 0:
        return [not_comparable(quantity, name, "still moves after 1 s") for quantity in quantities]
    squares = np.sum(felt(acceleration, STEP_S) ** 2, axis=0)
    contrast = 10 * np.log10(squares[0] / squares[1:].mean())
    # Velocities of each frequency up to 1 kHz, weighed as in IEC 61672-1: poles at 20.6 Hz (twice), 107.7, 737.9 and 12194 Hz (twice).
    hertz = np.fft.rfftfreq(len(acceleration), STEP_S)
    heard = (hertz > 0) & (hertz <= 1000)
    jw = 2j * np.pi * hertz[heard]
    poles = 2 * np.pi * np.array([20.598997, 20.598997, 107.65265, 737.86223, 12194.217, 12194.217])
    weigh = lambda s: np.abs(s**4 / np.prod([s + pole for pole in poles], axis=0))
    weight = weigh(jw) / weigh(np.array([2j * np.pi * 1000.0]))
    lines = np.fft.rfft(acceleration[:, 1:], axis=0)[heard] * STEP_S / jw[:, None] * weight[:, None]
    sound = 10 * np.log10(2 * np.sum(np.abs(lines) ** 2, axis=0).mean() / REFERENCE_M_PER_S**2)
    told = [predicted["contrast_db"], predicted["sound_db"]]
    told = [value + (1.0 if context.planted(quantity) else 0.0) for value, quantity in zip(told, quantities)]
    return [
        Result(quantity, name, abs(value - own), DECIBEL, note=f"{value:.3f} dB for {own:.3f} dB, {where}")
        for quantity, value, own in zip(quantities, told, (contrast, sound))
    ]


def _best(context, panel, point, windows, answer, where):
    """The strongest peak of free forces that are at most as large as the program says. Those must be at least the forces at the voltages of its
    windows, and at most those at the highest voltage of the scene and the board."""
    scene, name, quantity = context.scene, context.name, "click: best possible"
    forces = np.array(answer["best_possible_forces_n"])
    least = np.zeros(len(scene.actuators))
    for window in windows:
        least[window.actuator] = max(least[window.actuator], window.voltage_v)
    most = np.array([min(era.max_voltage, 2000.0) for era in scene.actuators])
    rest_force = lambda volts: np.array([motion.pulses.rest_force(era.electrode_area, era.air_gap, v) for era, v in zip(scene.actuators, volts)])
    response = panel.accelerance([point], HERTZ)[:, :, 0]
    # Where no window is told, nothing that fingers feel can be reached.
    if not windows:
        own = _strongest(response, rest_force(most))
        return Result(quantity, name, 0.0 if own < MOVABLE_G * G else np.inf, BEST, note=f"{own / G:.3g} g, {where}")
    if len(forces) != len(least) or np.any(forces < 0.99 * rest_force(least)) or np.any(forces > 1.01 * rest_force(most)):
        return Result(quantity, name, np.inf, BEST, note=f"forces of {forces} N, {where}")
    own = _strongest(response, forces)
    best = (answer["predicted"]["best_possible_g"] or 0.0) * (1.1 if context.planted(quantity) else 1) * G
    if max(own, best) < NOTHING * G:
        return not_comparable(quantity, name, "nothing moves")
    return Result(quantity, name, abs(best / own - 1) if own > 0 else np.inf, BEST, note=f"{best / G:.4g} g for {own / G:.4g} g, {where}")


def _strongest(response, forces_n):
    """In m/s^2, for forces of at most so many N."""
    count = int(round(1 / SAMPLE_S))
    omega = 2 * np.pi * HERTZ
    piece = (1 - np.exp(-1j * omega * PIECE_S)) / (1j * omega)
    columns = []
    for actuator, force in enumerate(forces_n):
        if force <= 0:
            continue
        lines = np.zeros(count // 2 + 1, complex)
        lines[HERTZ] = response[:, actuator] * felt_weight(HERTZ) * piece * force
        record = np.fft.irfft(lines, count) * count
        columns += [np.roll(record, k * int(round(PIECE_S / SAMPLE_S))) for k in range(PIECES)]
    if not columns:
        return 0.0
    rows = np.array(columns).T[: int(LOOKED_S / SAMPLE_S)]
    # The solver's tolerances are absolute.
    scale = np.abs(rows).max()
    if scale == 0.0:
        return 0.0
    rows = rows / scale
    quiet = int(QUIET_MS * 1e-3 / SAMPLE_S)
    part = np.where(np.arange(len(rows)) >= quiet, 0.1, 1.0)
    best = 0.0
    for peak_ms in PEAKS_MS:
        at = rows[int(peak_ms * 1e-3 / SAMPLE_S)]
        bounds = np.vstack([rows - part[:, None] * at, -rows - part[:, None] * at])
        solved = linprog(-at, A_ub=bounds, b_ub=np.zeros(len(bounds)), bounds=(-1, 1), method="highs")
        best = max(best, -solved.fun * scale if solved.status == 0 else 0.0)
    return best
