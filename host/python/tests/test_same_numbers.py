"""The command line's numbers, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import era
import numpy as np
import pytest
from conftest import Ask

AT_MM = (100.0, 50.0)
AT_M = (AT_MM[0] / 1e3, AT_MM[1] / 1e3)
AT = f"{AT_MM[0]},{AT_MM[1]}"


def numbers(values: Any) -> list[Any]:
    """As JSON has them: null for what is no number."""
    return [None if value != value else value for value in np.asarray(values, dtype=float).ravel().tolist()]


@pytest.fixture(params=["plate", "bar"])
def scene(request: pytest.FixtureRequest) -> era.Scene:
    return era.Scene.example(request.param)


@pytest.fixture
def at(scene: era.Scene) -> tuple[str, tuple[float, float]]:
    y_mm = AT_MM[1] if scene.kind == "plate" else 10.0
    return f"{AT_MM[0]},{y_mm}", (AT_MM[0] / 1e3, y_mm / 1e3)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_modes(ask: Ask, scene: era.Scene, tolerance: float, tmp_path: Path) -> None:
    told = ask(scene, "modes", "--max-hz", 400, "--tolerance", tolerance, "--npy", tmp_path / "m.npy", "--grid", "9,7")
    found = era.modes(scene, 400.0, tolerance=tolerance, grid=(9, 7))
    assert len(found) == len(told["modes"]) > 2
    for name in ("frequency_hz", "damping_ratio", "pole_frequency_hz", "error_bound", "pole_error_bound"):
        assert numbers(getattr(found, name)) == [mode[name] for mode in told["modes"]]
    assert (found.unknowns, found.tolerance, found.tolerance_met) == (told["dofs"], tolerance, told["tolerance_met"])
    assert found.shape_per_sqrt_kg is not None
    np.testing.assert_array_equal(np.load(tmp_path / "m.npy"), found.shape_per_sqrt_kg)
    np.testing.assert_array_equal(np.load(tmp_path / "m.x_m.npy"), np.asarray(found.x_m))


@pytest.mark.parametrize("alpha", [1.0, 3e3])
def test_poles(ask: Ask, alpha: float) -> None:
    """One pole of each mode that swings, two of each that does not, whose product is the square of the frequency that is told and whose mean is the ratio."""
    scene = era.Scene.example("bar").with_(surface={"damping": None}).with_(surface={"damping": {"rayleigh_alpha": alpha, "rayleigh_beta": 0.0}})
    found = era.modes(scene, 400.0)
    told = ask(scene, "modes", "--max-hz", 400)["modes"]
    assert found.poles_per_s.shape == (len(found), 2) and len(found) == len(told)
    for poles, mode in zip(found.poles_per_s, told):
        known = poles[~np.isnan(poles)]
        assert [[s.real, s.imag] for s in known.tolist()] == mode["poles_per_s"]
        if mode["damping_ratio"] is None:
            assert np.isnan(poles[0])
            continue
        modulus = np.sqrt(np.abs(np.prod(known))) if len(known) == 2 else abs(known[0])
        assert modulus == pytest.approx(2 * np.pi * mode["pole_frequency_hz"], rel=1e-12)
        assert -known.real.mean() == pytest.approx(mode["damping_ratio"] * modulus, rel=1e-12)
        assert len(known) == 1 or mode["damping_ratio"] > 1 and (known.imag == 0).all()
    assert (~np.isnan(found.poles_per_s[:, 1])).any() == (alpha > 1.0)


@pytest.mark.parametrize("kind", ["plate", "bar"])
def test_layers(ask: Ask, kind: str) -> None:
    """What layers are together, as the command line has it; two halves of one material that are bonded are a sheet, whose stiffness everybody knows."""
    glass = {"youngs_modulus_pa": 71e9, "poisson_ratio": 0.21, "density_kg_m3": 2480.0}
    half = {"thickness_mm": 0.85, "material": glass}
    plain = era.Scene.example("plate" if kind == "plate" else "bar")
    uniform = {"thickness_mm": None, "material": None, "damping": None}
    scene = plain.with_(surface=uniform, layer=[half, half], patch=None)
    told, found = ask(scene, "modes", "--max-hz", 300)["layers"], era.modes(scene, 300.0).layers
    assert found is not None and found.pop("thickness_m") == told.pop("thickness_mm") / 1e3 == pytest.approx(1.7e-3)
    assert found == told
    assert found["mass_kg_per_m2"] == pytest.approx(2480.0 * 1.7e-3)
    ei = 71e9 * 1.7e-3**3 / 12
    if kind == "bar":
        assert found["bending_stiffness_n_m2"] == pytest.approx(ei * plain.width_m)
    else:
        d = ei / (1 - 0.21**2)
        expected = {"d11_n_m": d, "d22_n_m": d, "d12_n_m": 0.21 * d, "d66_n_m": 0.5 * (1 - 0.21) * d}
        assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert era.modes(plain, 300.0).layers is None


def test_response(ask: Ask, scene: era.Scene, at: tuple[str, tuple[float, float]]) -> None:
    told = ask(scene, "response", "--at", at[0], "--from", 40, "--to", 400, "--step", 2.5)
    found = era.response(scene, at[1], np.array(told["frequency_hz"]))
    assert found.actuators == [actuator["id"] for actuator in told["actuators"]] == list(scene.actuator_ids)
    for curve, bound, actuator in zip(found.acceleration_m_s2_per_n, found.error_bound, told["actuators"]):
        assert curve.real.tolist() == actuator["acceleration_re"]
        assert curve.imag.tolist() == actuator["acceleration_im"]
        assert bound == actuator["error_bound"]
    assert (found.unknowns, found.tolerance_met) == (told["dofs"], told["tolerance_met"])


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_sweep(ask: Ask, scene: era.Scene, tolerance: float, tmp_path: Path) -> None:
    file = tmp_path / "sweep.npy"
    options = ("--grid", "13,9", "--from", 50, "--to", 300, "--step", 10, "--tolerance", tolerance, "--npy", file)
    told = ask(scene, "sweep", *options)
    frequency_hz = np.load(tmp_path / "sweep.frequency_hz.npy")
    found = era.sweep(scene, frequency_hz, grid=(13, 9), tolerance=tolerance)
    values = np.load(file)
    assert values.dtype == found.acceleration_m_s2_per_n.dtype
    np.testing.assert_array_equal(values, found.acceleration_m_s2_per_n)
    np.testing.assert_array_equal(np.load(tmp_path / "sweep.x_m.npy"), found.x_m)
    np.testing.assert_array_equal(np.load(tmp_path / "sweep.y_m.npy"), found.y_m)
    assert found.error_bound.tolist() == [actuator["error_bound"] for actuator in told["actuators"]]


def test_transient(ask: Ask, scene: era.Scene, at: tuple[str, tuple[float, float]]) -> None:
    first, phase_deg = scene.actuator_ids[0], 30.0
    drives = ("--drive", f"{first}:120:0.1", "--drive", f"{first}:150:0.2:{phase_deg}")
    told = ask(scene, "transient", "--at", at[0], *drives, "--duration", 0.2)
    # As Rust has it: degrees times pi / 180.
    sine, phased = (first, 120.0, 0.1), (first, 150.0, 0.2, phase_deg * (np.pi / 180.0))
    found = era.transient(scene, at[1], [sine, phased], duration_s=0.2)
    assert found.time_s.tolist() == told["time_s"]
    assert found.displacement_m.tolist() == told["displacement_m"]
    assert found.acceleration_m_s2.tolist() == told["acceleration_m_per_s2"]
    assert (found.peak_m_s2, found.steady_peak_m_s2) == (told["peak_m_per_s2"], told["steady_peak_m_per_s2"])
    assert found.settled_s == told["settled_s"] and found.error_bound is None is told["error_bound"]


PLANS: list[tuple[tuple[object, ...], dict[str, Any]]] = [
    ((), {}),
    (("--intensity-g", 0.3), {"intensity_g": 0.3}),
    (("--intensity-g", 50), {"intensity_g": 50.0}),
    (("--intensity-db", 15), {"intensity_db": 15.0}),
    (("--objective", "power"), {"objective": "power"}),
    (("--grouping", "shared"), {"grouping": "shared"}),
    (("--weigh", "felt"), {"weigh": "felt"}),
]


@pytest.mark.parametrize(("options", "keywords"), PLANS)
def test_plan(
    ask: Ask, scene: era.Scene, at: tuple[str, tuple[float, float]], options: tuple[object, ...], keywords: Any
) -> None:
    told = ask(scene, "plan", "--no-cache", "--unit", "mm", "--at", at[0], *options)
    compare_plan(era.plan(scene, at[1], **keywords), told)


def test_plan_with_more_wishes(ask: Ask, plate: era.Scene) -> None:
    options = ("--also", "220,140:0.4", "--quiet", "150,100:12:0.02", "--intensity-g", 0.4)
    told = ask(plate, "plan", "--no-cache", "--unit", "mm", "--at", AT, *options)
    wishes = {"also": [(0.22, 0.14, 0.4)], "quiet": [(0.15, 0.1, 0.012, 0.02)]}
    found = era.plan(plate, AT_M, 0.4, **wishes)  # type: ignore[arg-type]
    assert found.trade is not None and len(found.targets) == 2 and len(found.quiet) == 1
    compare_plan(found, told)
    told = ask(plate, "plan", "--no-cache", "--unit", "mm", "--at", AT, "--objective", "reach", "--zone", "0,0,100,80")
    compare_plan(era.plan(plate, AT_M, objective="reach", zone_m=(0.1, 0.08, 0.0, 0.0)), told)
    told = ask(plate, "plan", "--no-cache", "--unit", "mm", "--at", AT, "--explain")
    assert [era.plan(plate, AT_M, explain=True).explanation] == told["explanations"]


def test_with_a_finger(ask: Ask, plate: era.Scene) -> None:
    touched = plate.with_(finger={"mass_g": 5.0, "damping_n_s_per_m": 4.0, "stiffness_n_per_m": 1500.0})
    told = ask(touched, "response", "--at", AT, "--step", 20)
    found = era.response(touched, AT_M, told["frequency_hz"])
    assert found.acceleration_m_s2_per_n[0].real.tolist() == told["actuators"][0]["acceleration_re"]
    told = ask(touched, "plan", "--no-cache", "--unit", "mm", "--at", AT, "--also", "200,120")
    compare_plan(era.plan(touched, AT_M, also=[(0.2, 0.12)]), told)
    told = ask(touched, "plan", "--no-cache", "--unit", "mm", "--at", AT, "--objective", "reach")
    compare_plan(era.plan(touched, AT_M, objective="reach"), told)
    told = ask(touched, "field", "--no-cache", "--unit", "mm", "--at", AT)
    found_field = era.field(touched, AT_M)
    assert numbers(found_field.peak_g) == told["field"]["peak_g"]
    assert not np.array_equal(found_field.peak_g, era.field(plate, AT_M).peak_g)


def compare_plan(found: era.Plan, told: dict[str, Any]) -> None:
    own = found.to_dict()
    own.pop("elapsed_us")
    assert own == {key: told[key] for key in own} and own["drives"]
    assert (found.details, found.trade) == (told["details"], told.get("trade"))
    assert (found.tolerance, found.tolerance_met) == (told["tolerance"], told["tolerance_met"])
    assert (found.error_bound, found.optimality_gap) == (told["error_bound"], told["optimality_gap"])
    assert found.limited_by == told["limited_by"]
    for drive, other in zip(found.drives, told["drives"]):
        assert {name: getattr(drive, name) for name in other} == other
    assert {name: getattr(found.predicted, name) for name in told["predicted"]} == told["predicted"]
    for kind in ("targets", "quiet"):
        own_parts = getattr(found, kind)
        assert len(own_parts) == len(told[kind])
        for part, other in zip(own_parts, told[kind]):
            in_mm = {name: 1e3 * getattr(part, name[:-3] + "_m") for name in other if name.endswith("_mm")}
            assert {**{name: getattr(part, name) for name in other if name not in in_mm}, **in_mm} == other


def test_field(ask: Ask, scene: era.Scene, at: tuple[str, tuple[float, float]]) -> None:
    told = ask(scene, "field", "--no-cache", "--unit", "mm", "--at", at[0], "--intensity-g", 0.3)
    found = era.field(scene, at[1], 0.3)
    assert numbers(found.peak_g) == told["field"]["peak_g"]
    assert (found.x_m * 1e3).tolist() == told["field"]["x_mm"] and (found.y_m * 1e3).tolist() == told["field"]["y_mm"]
    assert (found.error_bound, found.tolerance_met) == (told["error_bound"], told["tolerance_met"])
    assert found.frequency_hz.tolist() == [drive["frequency_hz"] for drive in told["plan"]["drives"]]
    assert found.contrast_db == told["plan"]["predicted"]["contrast_db"]


def test_reach(ask: Ask, scene: era.Scene) -> None:
    y_mm = 90.0 if scene.kind == "plate" else 5.0
    told = ask(scene, "field", "--no-cache", "--reach", "--zone", f"0,0,120,{y_mm}", "--from", 60)["maps"]
    found = era.reach(scene, zone_m=(0.0, 0.0, 0.12, y_mm / 1e3), from_hz=60.0)
    assert found.actuators == told["actuators"]
    for name in ("strongest_g", "contrast_db", "error_bound"):
        assert numbers(getattr(found, name)) == told[name]
    for name in ("strongest_hz", "contrast_hz"):
        by_point = getattr(found, name).reshape(len(found.actuators), -1).T
        assert [None if np.isnan(hz).any() else hz.tolist() for hz in by_point] == told[name]


def test_verify(ask: Ask, plate: era.Scene) -> None:
    told = ask(plate, "verify", "--no-cache", "--points", 3, "--intensity-g", 0.2)
    found = era.verify(plate, points=3, intensity_g=0.2)
    assert found.to_dicts() == told["points"] and found.largest_difference == told["largest_difference"]
    for name in ("predicted_g", "simulated_g", "difference", "linear_g", "predicted_band_g", "simulated_band_g"):
        assert getattr(found, name).tolist() == [point[name] for point in told["points"]]
    assert found.band_difference.tolist() == [point["band_difference"] for point in told["points"]]
    assert numbers(found.error_bound) == [point["error_bound"] for point in told["points"]]
    assert (found.xy_m * 1e3).tolist() == [[point["x_mm"], point["y_mm"]] for point in told["points"]]


def test_tables_that_are_kept_are_the_right_ones(ask: Ask, plate: era.Scene) -> None:
    """More scenes than are kept, each asked twice, and one at two tolerances."""
    scenes = [plate.with_(actuator={"left": {"x_mm": 60.0 + i}}) for i in range(6)]
    first = [era.plan(scene, AT_M).to_dict()["drives"] for scene in scenes]
    again = [era.plan(scene, AT_M).to_dict()["drives"] for scene in scenes]
    assert first == again and len({str(drives) for drives in first}) == 6
    told = ask(plate, "plan", "--no-cache", "--unit", "mm", "--at", AT, "--accuracy", "reference")
    assert era.plan(plate, AT_M).to_dict()["drives"] != told["drives"]
    assert era.plan(plate, AT_M, tolerance="reference").to_dict()["drives"] == told["drives"]


EFFECTS: list[tuple[str, tuple[object, ...], dict[str, Any]]] = [
    ("click", (), {}),
    ("click", ("--intensity-g", 0.3), {"intensity_g": 0.3}),
    ("click", ("--intensity-g", 50), {"intensity_g": 50.0}),
    ("click", ("--crisp-ms", 30, "--prefer", "crispness"), {"crisp_ms": 30.0, "prefer": "crispness"}),
    ("double_click", ("--period-ms", 200), {"period_ms": 200.0}),
    ("buzz", ("--duration-ms", 100, "--intensity-db", 15), {"duration_ms": 100.0, "intensity_db": 15.0}),
    ("swell", (), {}),
    ("pulse_train", ("--count", 3, "--period-ms", 80), {"count": 3, "period_ms": 80.0}),
    ("texture", (), {}),
]


@pytest.mark.parametrize(("name", "options", "keywords"), EFFECTS)
def test_effect(
    ask: Ask,
    scene: era.Scene,
    at: tuple[str, tuple[float, float]],
    name: Any,
    options: tuple[object, ...],
    keywords: dict[str, Any],
) -> None:
    told = ask(scene, "effect", "--effect", name, "--at", at[0], "--unit", "mm", *options)
    found = era.effect(scene, at[1], name, **keywords)
    own = found.to_dict()
    # How long it took is no number of the effect's.
    for plan in (own["plan"], told["plan"]):
        plan.pop("elapsed_us")
    assert own == {key: told[key] for key in own}
    assert (found.name, found.limited_by, found.predicted, found.drives) == (
        name,
        told["limited_by"],
        told["predicted"],
        told["drives"],
    )


@pytest.mark.parametrize("force_n", [None, 1.0, 0.0])
def test_press(ask: Ask, scene: era.Scene, force_n: float | None) -> None:
    told = ask(scene, "press", *(() if force_n is None else ("--force-n", force_n)))
    found = era.press(scene, force_n)
    assert found.to_dict() == told and found.force_n == told["force_n"]
    for name, key, unit in [("alone_m", "alone_um", 1e6), ("sag_m", "sag_um", 1e6), ("gap_left_m", "gap_left_um", 1e6)]:
        assert numbers(getattr(found, name)) == [own[key] and own[key] / unit for own in told["actuators"]]
    for name in ("error_bound", "sag_error_bound", "holds_v"):
        assert numbers(getattr(found, name)) == [own[name] for own in told["actuators"]]
