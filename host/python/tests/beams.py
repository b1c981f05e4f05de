"""Beams by textbook formulas: nothing here is from the package but the scenes that it is asked about.

A pinned beam of length L, mass m and bending stiffness EI has the modes sin(n pi x / L) at w_n^2 = (n pi / L)^4 EI L / m, and with the
loss factor eta a force F cos(w t) at a gives the acceleration -w^2 (2 F / m) sum_n sin(n pi a / L) sin(n pi x / L) / (w_n^2 (1 + j eta) - w^2).
"""

from __future__ import annotations

import era
import numpy as np
from numpy.typing import NDArray

YOUNGS_MODULUS_PA = 70e9
DENSITY_KG_M3 = 2700.0
LENGTH_M = 0.4
WIDTH_M = 0.03
THICKNESS_M = 0.004
LOSS_FACTOR = 0.02
PLACES_M = (0.11, 0.27)

MASS_KG = DENSITY_KG_M3 * LENGTH_M * WIDTH_M * THICKNESS_M
BENDING_N_M2 = YOUNGS_MODULUS_PA * WIDTH_M * THICKNESS_M**3 / 12.0


def scene(kind: str = "pinned", ends: tuple[str, ...] = ("left", "right")) -> era.Scene:
    """A beam, held at its ends, with two forces on it that have neither mass nor springs."""
    return era.Scene(
        "beam",
        {
            "kind": "bar",
            "length_mm": LENGTH_M * 1e3,
            "width_mm": WIDTH_M * 1e3,
            "thickness_mm": THICKNESS_M * 1e3,
            "material": {"youngs_modulus_pa": YOUNGS_MODULUS_PA, "density_kg_m3": DENSITY_KG_M3},
            "damping": {"loss_factor": LOSS_FACTOR},
        },
        edge=[{"side": side, "kind": kind} for side in ends],
        actuator=[
            {
                "id": f"force {i}",
                "x_mm": x_m * 1e3,
                "y_mm": WIDTH_M * 1e3 / 2,
                "mount": "grounded",
                "moving_mass_g": 0.0,
                "stiffness_n_per_m": 0.0,
                "electrode_area_mm2": 900.0,
                "air_gap_um": 500.0,
                "max_voltage_v": 1000.0,
            }
            for i, x_m in enumerate(PLACES_M)
        ],
        press={"force_n": 0.0},
    )


def accelerances(
    place_m: float, x_m: NDArray[np.float64], frequency_hz: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Of the pinned beam, in m/s^2 per N: [frequency, point]. Ten thousand modes leave 1e-12 of the largest one."""
    n = np.arange(1, 10_001)
    square = (n * np.pi / LENGTH_M) ** 4 * BENDING_N_M2 * LENGTH_M / MASS_KG
    force = np.sin(n * np.pi * place_m / LENGTH_M)
    shapes = np.sin(np.outer(n, np.pi * np.asarray(x_m) / LENGTH_M))
    omega = 2.0 * np.pi * np.asarray(frequency_hz)
    parts = force / (square * (1.0 + 1j * LOSS_FACTOR) - omega[:, None] ** 2)
    found: NDArray[np.complex128] = -(omega[:, None] ** 2) * (2.0 / MASS_KG) * (parts @ shapes)
    return found
