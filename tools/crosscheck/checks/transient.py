"""`era transient`: a point after drives are switched on, sample by sample, against SciPy's integration of own modes."""

import numpy as np

from ..harness import Result, change_all, either, change, not_comparable
from ..reference import motion

QUANTITIES = ("transient: displacement", "transient: acceleration", "transient: steady peak", "transient: settled", "transient: peak")
PLANTS = {
    "transient: displacement": change_all("actuator", "moving_mass_g", 1.05),
    "transient: acceleration": either(change_all("actuator", "damping_n_s_per_m", 1.3), change(("surface", "thickness_mm"), 1.01)),
    "transient: steady peak": change(("surface", "thickness_mm"), 1.01),
    "transient: settled": "answer",
    "transient: peak": "answer",
}
EVERY, FIRST = 12, 4
MAX_HZ = 1000.0
# Modes that are integrated; what they leave out is worked out from the same with half as many.
BAND_HZ = 2500.0
# A model that is reduced has no more beyond.
HIGHEST_BAND_HZ = 1e6
SECONDS, STEP_S = 0.1, 25e-6
# Fewest: a short stiff panel has hardly one there, and half the band leaves out none of them.
FEWEST = 8
# Most modes: a share of scenes has thousands in the band.
MOST = 220
# The command prints no bound. Its steady state has the model's tolerance, 1e-3; a free motion's phase is off by the time
# times the error of its frequency, which is of the same order: 2 pi 400 Hz 0.1 s 1e-5 = 2.5e-3.
TOLERANCE = 4e-3
# Samples of the acceleration are weighted with a Hann window of this length, which leaves 1e-3 of what is above 1 kHz: how
# modes of any height ring is not a figure of either model.
WINDOW_S = 5e-3
# Beyond this the reference says too little.
USEFUL = 0.02
# Accelerations in m/s^2 below this are rounding, the program's and the reference's: a ten-thousandth of what is felt at best (1e-3 g).
NOTHING = 1e-6


def smooth(samples):
    """Weighted with the window, where it fits whole."""
    window = np.hanning(int(WINDOW_S / STEP_S) + 2)[1:-1]
    return np.convolve(samples, window / window.sum(), "valid")


def settled(acceleration, steady, period_s):
    """Start of the first period from which on the largest acceleration of each is within 10 % of the steady one, or None;
    periods of whole samples (docs/src/accuracy.md, "Motion in time")."""
    steps = int(np.ceil(period_s / STEP_S))
    periods = np.abs(acceleration[: len(acceleration) // steps * steps]).reshape(-1, steps).max(axis=1)
    off = np.nonzero(np.abs(periods - steady) > 0.1 * steady)[0]
    first = off[-1] + 1 if len(off) else 0
    return first * steps * STEP_S if first < len(periods) else None


def run(context):
    """One to three drives at a random point."""
    rng, name, scene = context.rng("transient"), context.name, context.scene
    point = context.random_point(rng)
    count = int(rng.integers(1, 4))
    drives = []
    for _ in range(count):
        number = int(rng.integers(len(scene.actuators)))
        degrees = -90.0 if rng.random() < 0.5 else float(np.round(rng.uniform(-180, 180)))
        drives.append((number, float(np.round(rng.uniform(40, 400), 1)), float(np.round(rng.uniform(0.02, 0.2), 3)), np.radians(degrees), degrees))
    words = [word for n, hz, newton, _, degrees in drives for word in ("--drive", f"{scene.actuators[n].id}:{hz}:{newton}:{degrees}")]
    where = f"at {point[0] * 1e3:.4g},{point[1] * 1e3:.4g} mm {' '.join(words)}"
    panel = context.panel(MAX_HZ)
    band_hz, system = BAND_HZ, motion.System(panel, BAND_HZ, [point])
    while system.size < FEWEST and (more := motion.System(panel, 2 * band_hz, [point])).size <= MOST and band_hz < HIGHEST_BAND_HZ:
        band_hz, system = 2 * band_hz, more
    if system.size > MOST:
        return [not_comparable(quantity, name, f"{system.size} modes") for quantity in QUANTITIES]
    at = f"{point[0] * 1e3!r},{point[1] * 1e3!r}"
    answer = context.era.json("transient", "--at", at, "--duration", SECONDS, "--step", STEP_S, *words)
    times = np.array(answer["time_s"])
    if len(times) != round(SECONDS / STEP_S) + 1 or not np.allclose(times, STEP_S * np.arange(len(times)), atol=1e-12):
        return [Result(QUANTITIES[0], name, np.inf, 0.0, note=f"{len(times)} times")]
    plain = [drive[:4] for drive in drives]
    moved = sum(abs(value[0]) for value in motion.steady_acceleration(system, plain).values())
    if moved < NOTHING and answer["steady_peak_m_per_s2"] < NOTHING:
        return [not_comparable(quantity, name, "nothing moves") for quantity in QUANTITIES]
    own = motion.integrate_linear(system, plain, times)
    rougher = motion.System(panel, band_hz / 2, [point])
    half = motion.integrate_linear(rougher, plain, times)
    # What modes above the band add is taken as in the steady state. Its part out of phase is damping's, and goes with velocities, which
    # at the start are not the steady ones.
    lag = [(newton * abs(system.points_rest([hz])[0, 0, number].imag), 2 * np.pi * hz) for number, hz, newton, _ in plain]
    displacement, acceleration = np.array(answer["displacement_m"]), np.array(answer["acceleration_m_per_s2"])
    results = []
    for quantity, got, index, power, look in (
        ("transient: displacement", displacement, 0, 0, lambda samples: samples),
        ("transient: acceleration", acceleration, 1, 2, smooth),
    ):
        wanted, rough = look(own[index][:, 0]), look(half[index][:, 0])
        scale = np.abs(wanted).max()
        error = (np.abs(wanted - rough).max() + sum(part * omega**power for part, omega in lag)) / scale if scale > 0 else np.inf
        if error > USEFUL:
            results.append(not_comparable(quantity, name, f"own error {error:.1e}"))
        else:
            results.append(Result(quantity, name, np.abs(look(got) - wanted).max() / scale, TOLERANCE + error, note=where))
    results += _peak(context, answer, acceleration, own[1][:, 0], half[1][:, 0], sum(part * omega**2 for part, omega in lag), where)
    # A spring with losses has a part in every mode: as many modes as there may be, or all of them.
    systems = [rougher, system]
    while systems[-1].size > systems[-2].size and band_hz < HIGHEST_BAND_HZ and (more := motion.System(panel, 2 * band_hz, [point])).size <= MOST:
        band_hz *= 2
        systems.append(more)
    results += _steady(context, (systems[-1], systems[-2]), panel, [point], plain, answer, own[1][:, 0], where)
    return results


def _peak(context, answer, samples, own, half, lag, where):
    """The largest acceleration is that of the samples that are printed, and at least that of own ones as they are smoothed, an average.
    How much more it is is what modes of any height ring, of which every octave may add as much as the one below."""
    name, quantity = context.name, "transient: peak"
    printed = answer["peak_m_per_s2"]
    if context.planted(quantity):
        printed *= 0.5
    results = [Result(quantity, name, abs(printed / np.abs(samples).max() - 1), 1e-12, note=where)]
    wanted, rough = smooth(own), smooth(half)
    most = np.abs(wanted).max()
    error = (np.abs(wanted - rough).max() + lag) / most if most > 0 else np.inf
    if error > USEFUL:
        return results + [not_comparable(quantity, name, f"own error {error:.1e}")]
    return results + [Result(quantity, name, max(1 - printed / most, 0.0), TOLERANCE + error, note=where)]


def _steady(context, systems, panel, point, drives, answer, acceleration, where):
    """The steady peak (equation 23, of the damping that there is in time), and for one drive when it is reached."""
    name = context.name
    peak, rough = (sum(abs(value[0]) for value in motion.steady_acceleration(system, drives).values()) for system in systems)
    # With fewer modes losses of springs are spread over others: their stand-in in time goes with modes.
    error = abs(peak - rough) / peak + sum(newton * panel.accelerance_error(point, [hz])[0, number, 0] for number, hz, newton, _ in drives) / peak
    printed = answer["steady_peak_m_per_s2"]
    results = [Result("transient: steady peak", name, abs(printed - peak) / peak, TOLERANCE + error, note=where)]
    if len(drives) > 1:
        return results
    own = settled(acceleration, peak, 1 / drives[0][1])
    got = answer["settled_s"]
    if context.planted("transient: settled"):
        got = None if got is not None else 0.0
    period = 1 / drives[0][1]
    difference = 0.0 if got is None and own is None else SECONDS if got is None or own is None else abs(got - own)
    results.append(Result("transient: settled", name, difference / period, 1.01, note=f"{got} for {own}, {where}"))
    return results
