"""What the skin feels: the threshold of acceleration against frequency."""

import numpy as np

STANDARD_GRAVITY_M_S2 = 9.80665

# Least acceleration that is felt, in dB re 1 g, as the Android vibrator service has it (`BasicToPwleSegmentAdapter.java`,
# Apache-2.0); linear in Hz and dB between its rows. Only the part that planner frequencies (40 to 400 Hz) and their
# neighbours need.
THRESHOLD_HZ = np.array([10, 20, 30, 40, 60, 80, 100, 150, 200, 250, 300, 400], dtype=float)
THRESHOLD_DB = np.array(
    [-48.90, -40.36, -34.31, -32.81, -31.77, -31.77, -31.90, -31.35, -30.86, -28.98, -26.81, -19.81]
)


def threshold_g(frequency_hz):
    """Least acceleration in g that is felt at a frequency from 10 Hz on; above 400 Hz the last slope goes on (docs/src/planner.md,
    "Keys of a plan")."""
    frequency_hz = np.asarray(frequency_hz, dtype=float)
    slope = (THRESHOLD_DB[-1] - THRESHOLD_DB[-2]) / (THRESHOLD_HZ[-1] - THRESHOLD_HZ[-2])
    beyond = slope * np.maximum(frequency_hz - THRESHOLD_HZ[-1], 0.0)
    return 10 ** ((np.interp(frequency_hz, THRESHOLD_HZ, THRESHOLD_DB) + beyond) / 20)


def above_threshold_db(frequencies_hz, peaks_g):
    """Level of a sum of vibrations of distinct frequencies: amplitudes in units of their thresholds add, as peaks do."""
    with np.errstate(divide="ignore"):
        return 20 * np.log10(np.sum(np.asarray(peaks_g) / threshold_g(np.asarray(frequencies_hz))))
