"""What is refused, and what is warned of."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import beams
import era
import numpy as np
import pytest

PLATE = era.Scene.example("plate")
AT_M = (0.1, 0.05)
BAND = np.arange(100.0, 200.0, 10.0)
CUT = era.Scene.from_toml(PLATE.to_toml()).with_(cutout=[{"x_mm": 130.0, "y_mm": 5.0, "length_mm": 30.0, "width_mm": 20.0}])

Call = Callable[[], object]

WRONG: list[tuple[str, Call, object]] = [
    ("tolerance", lambda: era.modes(PLATE, 100.0, tolerance=1.0), 1.0),
    ("tolerance", lambda: era.modes(PLATE, 100.0, tolerance="exact"), "exact"),  # type: ignore[arg-type]
    ("within_s", lambda: era.modes(PLATE, 100.0, within_s=-1.0), -1.0),
    ("within_s", lambda: era.modes(PLATE, 100.0, within_s=1.0, tolerance=1e-3), 1.0),
    ("frequency_hz", lambda: era.modes(PLATE, -5.0), -5.0),
    ("grid[1]", lambda: era.modes(PLATE, 100.0, grid=(5, 0)), 0),
    ("grid", lambda: era.modes(PLATE, 400.0, grid=(10_000, 10_000)), 10_000 * 10_000),
    ("at_m[0]", lambda: era.response(PLATE, (0.4, 0.05), BAND), 0.4),
    ("at_m[1]", lambda: era.response(PLATE, (0.1, -0.05), BAND), -0.05),
    ("at_m", lambda: era.response(PLATE, 0.1, BAND), 0.1),
    ("at_m", lambda: era.response(CUT, (0.145, 0.015), BAND), (0.145, 0.015)),
    ("frequency_hz[1]", lambda: era.response(PLATE, AT_M, [100.0, float("inf")]), float("inf")),
    ("frequency_hz[0]", lambda: era.sweep(PLATE, [0.0]), 0.0),
    ("len(frequency_hz)", lambda: era.sweep(PLATE, []), 0),
    ("grid", lambda: era.sweep(PLATE, BAND, grid=(9000, 9000)), 81_000_000),
    ("actuator", lambda: era.response(PLATE.with_(actuator=None), AT_M, BAND), 0),
    ("drives[0][0]", lambda: era.transient(PLATE, AT_M, [("middle", 100.0, 1.0)]), "middle"),
    ("frequency in Hz", lambda: era.transient(PLATE, AT_M, [("left", 1e5, 1.0)]), 1e5),
    ("drives[1][3]", lambda: era.transient(PLATE, AT_M, [("left", 1e2, 1.0), ("left", 1.0, 1.0, float("inf"))]), float("inf")),
    ("len(drives)", lambda: era.transient(PLATE, AT_M, []), 0),
    ("step_s", lambda: era.transient(PLATE, AT_M, [("left", 1e2, 1.0)], step_s=0.0), 0.0),
    ("duration_s", lambda: era.transient(PLATE, AT_M, [("left", 1e2, 1.0)], duration_s=1e6), 1e6),
    ("intensity_g", lambda: era.plan(PLATE, AT_M, -1.0), -1.0),
    ("intensity_db", lambda: era.plan(PLATE, AT_M, intensity_db=99.0), 99.0),
    ("objective", lambda: era.plan(PLATE, AT_M, objective="fun"), "fun"),  # type: ignore[arg-type]
    ("grouping", lambda: era.plan(PLATE, AT_M, grouping="mixed"), "mixed"),  # type: ignore[arg-type]
    ("weigh", lambda: era.plan(PLATE, AT_M, weigh="felt", objective="reach"), "felt"),
    ("also[0][0]", lambda: era.plan(PLATE, AT_M, also=[(0.5, 0.1)]), 0.5),
    ("quiet[0][1]", lambda: era.plan(PLATE, AT_M, quiet=[(0.1, 0.5, 0.01, 0.1)]), 0.5),
    ("radius_mm", lambda: era.plan(PLATE, AT_M, quiet=[(0.1, 0.1, 5.0, 0.1)]), 5000.0),
    ("zone_m", lambda: era.reach(PLATE, zone_m=(0.0, 0.0, 0.5, 0.1)), (0.0, 0.0, 0.5, 0.1)),
    ("zone_m", lambda: era.reach(PLATE, zone_m=(0.001, 0.001, 0.002, 0.002)), None),
    ("from_hz", lambda: era.reach(PLATE, from_hz=390.0), 390.0),
    ("actuator", lambda: era.reach(PLATE.with_(actuator=None)), 0),
    ("force_n", lambda: era.press(PLATE, -1.0), -1.0),
    ("force_n", lambda: era.press(PLATE, 1e4), 1e4),
    ("actuator", lambda: era.press(PLATE.with_(actuator=None)), 0),
    ("effect", lambda: era.effect(PLATE, AT_M, "boom"), "boom"),  # type: ignore[arg-type]
    ("intensity_g", lambda: era.effect(PLATE, AT_M, "click", -1.0), -1.0),
    ("intensity_db", lambda: era.effect(PLATE, AT_M, "click", 0.5, intensity_db=10.0), 10.0),
    ("intensity_db", lambda: era.effect(PLATE, AT_M, "click", intensity_db=99.0), 99.0),
    ("duration_ms", lambda: era.effect(PLATE, AT_M, "click", duration_ms=10.0), 10.0),
    ("duration_ms", lambda: era.effect(PLATE, AT_M, "buzz", duration_ms=1e6), 1e6),
    ("count", lambda: era.effect(PLATE, AT_M, "pulse_train", count=0), 0.0),
    ("period_ms", lambda: era.effect(PLATE, AT_M, "texture", period_ms=1.0), 1.0),
    ("crisp_ms", lambda: era.effect(PLATE, AT_M, "click", crisp_ms=1.0), 1.0),
    ("crisp_ms", lambda: era.effect(PLATE, AT_M, "buzz", crisp_ms=45.0), 45.0),
    ("prefer", lambda: era.effect(PLATE, AT_M, "buzz", prefer="strength"), "strength"),
    ("prefer", lambda: era.effect(PLATE, AT_M, "click", prefer="both"), "both"),  # type: ignore[arg-type]
    ("actuator", lambda: era.effect(PLATE.with_(actuator=None), AT_M, "click"), 0),
    ("points", lambda: era.verify(PLATE, points=0), 0),
    ("points[1][0]", lambda: era.verify(PLATE, points=[AT_M, (1.0, 0.1)]), 1.0),
    ("intensity_g", lambda: era.verify(PLATE, points=1, intensity_g=float("nan")), None),
]


@pytest.mark.parametrize(("field", "call", "value"), WRONG, ids=[f"{i} {field}" for i, (field, _, _) in enumerate(WRONG)])
def test_requests_that_cannot_be_met_name_the_argument(field: str, call: Call, value: object) -> None:
    with pytest.raises(era.RequestError) as caught:
        call()
    error = caught.value
    assert error.field == field and isinstance(error, ValueError)
    if value is not None:
        assert error.value == value
        assert error.allowed
    # The sentence names it, too.
    assert field.split("[")[0].split(" ")[-1].split("_")[0] in str(error)


@pytest.mark.parametrize(
    "call",
    [
        lambda: era.modes("plate", 100.0),  # type: ignore[arg-type]
        lambda: era.modes(PLATE, "high"),  # type: ignore[arg-type]
        lambda: era.response(PLATE, AT_M, "low"),
        lambda: era.response(PLATE, AT_M, [[100.0]]),
        lambda: era.response(PLATE, AT_M, BAND * 1j),
        lambda: era.plan(PLATE, None),  # type: ignore[arg-type]
    ],
)
def test_other_types_are_type_errors(call: Call) -> None:
    with pytest.raises((TypeError, ValueError)) as caught:
        call()
    assert not isinstance(caught.value, era.EraError)


def test_an_undamped_resonance_has_no_response() -> None:
    undamped = beams.scene().with_(surface={"damping": None})
    (first_hz,) = era.modes(undamped, 100.0, tolerance=1e-8).frequency_hz
    with pytest.raises(era.ResonanceError, match="undamped") as caught:
        era.response(undamped, 0.17, [first_hz * 0.5, first_hz], tolerance=1e-6)
    assert caught.value.field == "frequency_hz" and isinstance(caught.value, era.ModelError)
    assert caught.value.value == pytest.approx(first_hz)


def test_what_is_too_much_for_the_model() -> None:
    with pytest.raises(era.ModelError, match="lower frequency") as caught:
        era.modes(PLATE, 2e5)
    assert not isinstance(caught.value, ValueError) and caught.value.allowed


def test_too_many_actuators_for_a_plan_are_told_before_anything_is_computed() -> None:
    one: dict[str, Any] = PLATE.to_dict()["actuator"][0]
    many = PLATE.with_(actuator=[{**one, "id": str(i), "x_mm": 40.0 * (i + 1)} for i in range(5)])
    with pytest.raises(era.RequestError, match="at most 4") as caught:
        era.plan(many, AT_M)
    assert caught.value.value == 5
    assert era.response(many, AT_M, BAND).acceleration_m_s2_per_n.shape == (5, 10)


def test_nothing_to_simulate() -> None:
    with pytest.raises(era.SimulationError, match="drives nothing"):
        era.verify(PLATE, points=[AT_M], intensity_g=0.0)


def test_thick_panels_are_warned_of() -> None:
    thick = PLATE.with_(surface={"thickness_mm": 12.0})
    with pytest.warns(era.ModelWarning, match="thin-plate theory") as caught:
        found = era.modes(thick, 200.0)
    # Where the call stands, not somewhere inside.
    assert caught[0].filename == __file__ and len(found) > 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(era.ModelWarning):
            era.response(thick, AT_M, BAND)


def test_gaps_that_do_not_bear_the_press_are_warned_of() -> None:
    soft = PLATE.with_(actuator={"left": {"stop_um": None}})
    with pytest.warns(era.ModelWarning, match="press"):
        era.plan(soft, AT_M)
