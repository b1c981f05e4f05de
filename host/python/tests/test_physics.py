"""Against what does not come from the program: beam theory, reciprocity, mirror images."""

from __future__ import annotations

import beams
import era
import numpy as np
import pytest
from scipy.optimize import brentq

G_M_S2 = 9.80665


def test_modes_of_a_cantilever() -> None:
    """cos b cosh b = -1, w = b^2 sqrt(EI / (m L^3)); multiplied out in a form that does not overflow."""
    found = era.modes(beams.scene("clamped", ("left",)), 5000.0, tolerance=1e-6)
    roots = [
        brentq(lambda b: np.cos(b) + 1.0 / np.cosh(b), (k - 1) * np.pi + 0.5, k * np.pi, xtol=1e-14)
        for k in range(1, len(found) + 1)
    ]
    expected = np.square(roots) * np.sqrt(beams.BENDING_N_M2 / (beams.MASS_KG * beams.LENGTH_M**3)) / (2.0 * np.pi)
    assert len(found) >= 6
    # The roots are right to 1e-13.
    assert (np.abs(found.frequency_hz / expected - 1.0) <= found.error_bound + 1e-12).all()
    # Half the loss factor, as 1 + j eta on all of the stiffness.
    np.testing.assert_allclose(found.damping_ratio, beams.LOSS_FACTOR / 2.0, rtol=1e-3)


def test_shapes_of_a_pinned_beam() -> None:
    found = era.modes(beams.scene(), 2000.0, grid=(41, 3), tolerance=1e-6)
    assert found.x_m is not None and found.y_m is not None and found.shape_per_sqrt_kg is not None
    assert found.y_m.tolist() == [beams.WIDTH_M / 2.0]
    modes = np.arange(1, len(found) + 1)
    expected = np.sqrt(2.0 / beams.MASS_KG) * np.sin(np.outer(modes, np.pi * found.x_m / beams.LENGTH_M))
    shapes = found.shape_per_sqrt_kg[:, 0, :]
    signs = np.sign(np.sum(shapes * expected, axis=1))
    np.testing.assert_allclose(signs[:, None] * shapes, expected, atol=1e-4 * np.sqrt(2.0 / beams.MASS_KG))


def test_response_of_a_pinned_beam() -> None:
    frequency_hz = np.arange(20.0, 801.0, 5.0)
    found = era.response(beams.scene(), 0.17, frequency_hz, tolerance=1e-6)
    for curve, place_m, bound in zip(found.acceleration_m_s2_per_n, beams.PLACES_M, found.error_bound):
        expected = beams.accelerances(place_m, np.array([0.17]), frequency_hz)[:, 0]
        assert np.abs(curve - expected).max() <= (bound + 1e-9) * np.abs(curve).max()


def test_a_free_panel_is_accelerated_by_force_over_mass(plate: era.Scene) -> None:
    free = plate.with_(support=None, actuator={"left": {"x_mm": 150.0, "y_mm": 100.0}, "right": None})
    ids = free.to_dict()["actuator"][0]
    assert ids["mount"] == "grounded"
    free = free.with_(actuator={0: {"stiffness_n_per_m": 0.0, "damping_n_s_per_m": 0.0, "moving_mass_g": 7.0}})
    found = era.response(free, (0.15, 0.1), [0.0])
    mass_kg = 2700.0 * 0.3 * 0.2 * 0.002 + 0.007 + 1e-3 * sum(mass["mass_g"] for mass in free.to_dict().get("mass", []))
    np.testing.assert_allclose(found.acceleration_m_s2_per_n, 1.0 / mass_kg, rtol=1e-9)


def test_reciprocity(plate: era.Scene) -> None:
    """What a force at A does at B, the same force at B does at A."""
    frequency_hz = np.arange(40.0, 401.0, 3.0)
    a, b = plate.actuator_xy_m
    at_b = era.response(plate, tuple(b), frequency_hz, tolerance=1e-4)
    at_a = era.response(plate, tuple(a), frequency_hz, tolerance=1e-4)
    ab, ba = at_b.acceleration_m_s2_per_n[0], at_a.acceleration_m_s2_per_n[1]
    allowed = at_b.error_bound[0] * np.abs(ab).max() + at_a.error_bound[1] * np.abs(ba).max()
    assert 0.0 < allowed < 1e-3 * np.abs(ab).max()
    assert np.abs(ab - ba).max() <= allowed


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_sweep_of_a_pinned_beam(tolerance: float) -> None:
    frequency_hz = np.arange(40.0, 401.0, 10.0)
    found = era.sweep(beams.scene(), frequency_hz, grid=(23, 5), tolerance=tolerance)
    assert found.acceleration_m_s2_per_n.shape == (37, 2, 1, 23)
    assert found.acceleration_m_s2_per_n.dtype == (np.complex64 if tolerance > 1e-5 else np.complex128)
    inside = slice(1, -1)
    for actuator, (place_m, bound) in enumerate(zip(beams.PLACES_M, found.error_bound)):
        curves = found.acceleration_m_s2_per_n[:, actuator, 0, inside]
        difference = np.abs(curves - beams.accelerances(place_m, found.x_m[inside], frequency_hz)).max(axis=0)
        assert (difference <= (bound + 1e-9) * np.abs(curves).max(axis=0)).all()


def test_a_stiff_free_bar_moves_as_a_mass() -> None:
    """m x'' = F sin(w t) from rest: x = F / (m w) (t - sin(w t) / w). It is so stiff that its first bending mode, at 490 kHz, is left out."""
    bar = beams.scene(ends=()).with_(
        surface={"material": {"youngs_modulus_pa": 1e18}, "damping": None},
        actuator={0: {"x_mm": beams.LENGTH_M * 500.0}, 1: None},
    )
    omega = 2.0 * np.pi * 80.0
    found = era.transient(bar, beams.LENGTH_M / 2.0, [("force 0", 80.0, 0.3)], duration_s=0.1)
    expected = 0.3 / (beams.MASS_KG * omega) * (found.time_s - np.sin(omega * found.time_s) / omega)
    np.testing.assert_allclose(found.displacement_m, expected, atol=1e-6 * expected.max())
    acceleration = 0.3 / beams.MASS_KG * np.sin(omega * found.time_s)
    np.testing.assert_allclose(found.acceleration_m_s2, acceleration, atol=1e-5 * acceleration.max())


def peaks_g(drives: list[era.Drive], x_m: np.ndarray) -> np.ndarray:
    """Of drives at distinct frequencies on the pinned beam: amplitudes add."""
    each = [
        drive.force_n * np.abs(beams.accelerances(place_m, x_m, np.array([drive.frequency_hz]))[0])
        for place_m, drive in zip(beams.PLACES_M, drives)
    ]
    total: np.ndarray = np.sum(each, axis=0) / G_M_S2
    return total


def test_a_plans_peak_is_what_its_forces_do() -> None:
    found = era.plan(beams.scene(), 0.17, 0.2)
    expected = peaks_g(found.drives, np.array([0.17]))[0]
    assert found.error_bound is not None and found.error_bound < 1e-2
    assert abs(found.predicted.target_peak_g / expected - 1.0) <= found.error_bound + 1e-9
    # A force of one electrode at a time: 4 / pi sin(pi w / 2) eps0 A V^2 / (2 g^2).
    for drive in found.drives:
        static_n = 8.8541878128e-12 * 900e-6 * drive.voltage_v**2 / (2.0 * 500e-6**2)
        assert drive.force_n == pytest.approx(static_n * 4.0 / np.pi * np.sin(np.pi * drive.pulse_width / 2.0), rel=0.02)


def test_a_field_is_what_its_forces_do() -> None:
    scene = beams.scene()
    found = era.field(scene, 0.17, 0.2)
    expected = peaks_g(era.plan(scene, 0.17, 0.2).drives, found.x_m)
    assert found.error_bound is not None and found.error_bound < 1e-2
    assert np.abs(found.peak_g[0] - expected).max() <= (found.error_bound + 1e-9) * found.peak_g.max()
    np.testing.assert_array_equal(found.acceleration_m_s2 / G_M_S2, found.peak_g)


def test_a_mirrored_panel_has_the_mirrored_reach(plate: era.Scene) -> None:
    crooked = plate.with_(actuator={"left": {"x_mm": 61.0, "y_mm": 83.0}})
    tables = crooked.to_dict()
    mirrored = crooked.with_(
        **{
            key: [{**entry, "x_mm": 300.0 - entry["x_mm"]} for entry in tables[key]]
            for key in ("support", "mass", "actuator")
            if key in tables
        }
    )
    one, other = era.reach(crooked), era.reach(mirrored)
    # Both are proven optima of equal problems; what is left is the two models' error.
    allowed = np.nanmax(one.error_bound) + np.nanmax(other.error_bound)
    assert 0.0 < allowed < 0.02
    np.testing.assert_allclose(one.strongest_g, other.strongest_g[:, ::-1], rtol=allowed)
    weakest_g, (x_m, y_m) = one.weakest()
    assert weakest_g == np.nanmin(one.strongest_g)
    row, column = np.argwhere(one.strongest_g == weakest_g)[0]
    assert (x_m, y_m) == (one.x_m[column], one.y_m[row])


def test_reach_is_what_a_plan_for_too_much_gets(plate: era.Scene) -> None:
    found = era.reach(plate, zone_m=(0.0, 0.0, 0.1, 0.1))
    row, column = np.argwhere(~np.isnan(found.strongest_g))[-1]
    plan = era.plan(plate, (found.x_m[column], found.y_m[row]), 1e4)
    assert plan.limited_by is not None
    # A plan is refined between the grid's frequencies.
    assert plan.predicted.target_peak_g == pytest.approx(found.strongest_g[row, column], rel=0.02)
    outside = found.x_m > 0.1 + 1e-9
    assert np.isnan(found.strongest_g[:, outside]).all() and not np.isnan(found.strongest_g[0, 0])


def test_prediction_and_simulation_agree(plate: era.Scene) -> None:
    found = era.verify(plate, points=[(0.1, 0.05), (0.2, 0.12)], intensity_g=0.1)
    assert found.xy_m.tolist() == [[0.1, 0.05], [0.2, 0.12]]
    np.testing.assert_allclose(found.simulated_g, found.predicted_g, rtol=0.02)
    # For little motion forces are those of masses at rest, and peaks as was asked for.
    np.testing.assert_allclose(found.linear_g, 0.1, rtol=1e-6)
    np.testing.assert_allclose(found.difference, found.simulated_g / found.predicted_g - 1.0, atol=1e-12)
