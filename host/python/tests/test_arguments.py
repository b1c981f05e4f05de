"""What arguments may be: whatever NumPy makes an array of, but nothing that it would have to guess."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import era
import numpy as np
import pytest

PLATE = era.Scene.example("plate")
BAR = era.Scene.example("bar")
BAND = [100.0, 150.0]


class Series:
    """A stand-in for the series and arrays of other packages, which NumPy knows by this method alone."""

    def __init__(self, *values: float) -> None:
        self.values = values

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.array(self.values, dtype=dtype)


PLACES = [
    (0.1, 0.05),
    [0.1, 0.05],
    np.array([0.1, 0.05]),
    np.array([0.1, 0.7, 0.05])[::2],
    np.array([0.1, 0.05], dtype=np.longdouble),
    np.ma.array([0.1, 0.05]),
    np.ma.array([0.1, 0.05], mask=[False, False]),
    (np.float64(0.1), np.array(0.05)),
    (Decimal("0.1"), Decimal("0.05")),
    Series(0.1, 0.05),
]


@pytest.mark.parametrize("place", PLACES, ids=lambda place: type(place).__name__)
def test_places(place: Any) -> None:
    assert era.response(PLATE, place, BAND).at_m == (0.1, 0.05)


def test_places_of_every_function() -> None:
    """Each function that takes a place takes a list, and an array."""
    at, other = [0.1, 0.05], np.array([0.2, 0.15])
    calls: list[Callable[[Any], Any]] = [
        lambda place: era.response(PLATE, place, BAND).acceleration_m_s2_per_n,
        lambda place: era.transient(PLATE, place, [["left", 100.0, 1.0]], duration_s=0.01).displacement_m,
        lambda place: [drive.voltage_v for drive in era.plan(PLATE, place).drives],
        lambda place: [drive.voltage_v for drive in era.plan(PLATE, (0.02, 0.02), also=[place]).drives],
        lambda place: era.field(PLATE, place).peak_g,
        lambda place: era.effect(PLATE, place, "buzz").to_dict()["drives"][0]["voltage_v"],
        lambda place: era.verify(PLATE, points=[place]).predicted_g,
    ]
    for call in calls:
        for place in (at, other):
            expected = call(tuple(map(float, place)))
            for given in (list(place), np.asarray(place), np.ma.asarray(place)):
                np.testing.assert_array_equal(call(given), expected)


def test_one_coordinate_is_enough_on_a_bar() -> None:
    expected = era.response(BAR, 0.1, BAND).at_m
    for place in (np.float32(0.125), np.array(0.125), [0.125], np.array([0.125]), 0.125):
        found = era.response(BAR, place, BAND).at_m
        assert found == (0.125, expected[1])


def test_rows_of_arrays() -> None:
    """Lists of places and zones may be the rows of one array."""

    def planned(**wishes: Any) -> Any:
        told = era.plan(PLATE, (0.1, 0.05), **wishes).to_dict()
        return {key: value for key, value in told.items() if key != "elapsed_us"}

    also = np.array([[0.2, 0.15], [0.25, 0.03]])
    assert planned(also=also) == planned(also=[tuple(row) for row in also.tolist()])
    assert planned(also=[(0.2, 0.15, None)]) == planned(also=[[0.2, 0.15, None]]) == planned(also=[[0.2, 0.15]])
    assert planned(also=[(0.2, 0.15, 0.1)]) == planned(also=np.array([[0.2, 0.15, 0.1]])) != planned(also=[(0.2, 0.15)])
    assert planned(quiet=np.array([[0.2, 0.15, 0.01, 0.02]])) == planned(quiet=[(0.2, 0.15, 0.01, 0.02)])
    corners = np.array([[0.1, 0.05], [0.15, 0.1]])
    np.testing.assert_array_equal(
        era.reach(PLATE, zone_m=corners).strongest_g, era.reach(PLATE, zone_m=(0.1, 0.05, 0.15, 0.1)).strongest_g
    )
    np.testing.assert_array_equal(era.verify(PLATE, points=also).xy_m, also)  # type: ignore[arg-type]


@pytest.mark.parametrize("call", [lambda hz: era.response(PLATE, (0.1, 0.05), hz), lambda hz: era.sweep(PLATE, hz, grid=(3, 3))])
def test_frequencies(call: Callable[[Any], Any]) -> None:
    """One frequency is an axis of one entry, so that the result's shape does not depend on what the frequency came in."""
    for one in (120.0, 120, np.float32(120), np.int16(120), np.array(120.0), [120], (120.0,), Decimal(120), Series(120.0)):
        assert call(one).frequency_hz.tolist() == [120.0]
    for several in ([100, 150], range(100, 200, 50), np.array([100, 150], dtype=np.uint8), np.ma.array(BAND), Series(100, 150)):
        assert call(several).frequency_hz.tolist() == BAND


def test_grids() -> None:
    grids: list[Any] = [(5, 3), [5, 3], np.array([5, 3]), (np.int8(5), np.uint64(3))]
    for grid in grids:
        found = era.modes(PLATE, 100.0, grid=grid).shape_per_sqrt_kg
        assert found is not None and found.shape[1:] == (3, 5)


# A row of a nested sequence that is an array, beside one that is not.
ROWS: Any = [np.ma.array([0.1, 0.1], mask=[False, True]), [0.2, 0.2]]
MASKED: list[tuple[str, Callable[[], object]]] = [
    ("at_m[1]", lambda: era.response(PLATE, np.ma.array([0.1, 0.05], mask=[False, True]), BAND)),
    ("at_m[0]", lambda: era.plan(PLATE, np.ma.array([0.1, 0.05], mask=True))),
    ("frequency_hz[1]", lambda: era.response(PLATE, (0.1, 0.05), np.ma.array(BAND, mask=[False, True]))),
    ("frequency_hz[0]", lambda: era.sweep(PLATE, np.ma.masked_less(BAND, 120.0))),
    ("also[0][1]", lambda: era.plan(PLATE, (0.1, 0.05), also=[np.ma.array([0.2, 0.1], mask=[False, True])])),
    ("quiet[0][3]", lambda: era.plan(PLATE, (0.1, 0.05), quiet=[np.ma.array([0.2, 0.1, 0.01, 0.1], mask=[False, False, False, True])])),
    ("zone_m[2]", lambda: era.reach(PLATE, zone_m=np.ma.array([[0.1, 0.1], [0.2, 0.2]], mask=[[False, False], [True, False]]))),
    ("zone_m[1]", lambda: era.reach(PLATE, zone_m=ROWS)),
    ("points[0][0]", lambda: era.verify(PLATE, points=[np.ma.array([0.1, 0.05], mask=[True, False])])),
]


@pytest.mark.parametrize(("field", "call"), MASKED, ids=[field for field, _ in MASKED])
def test_masked_entries_are_refused(field: str, call: Callable[[], object]) -> None:
    """The value below a mask is of no account, so that nothing may be computed with it."""
    with pytest.raises(era.RequestError) as raised:
        call()
    assert (raised.value.field, raised.value.value) == (field, "masked")


def test_masked_numbers_are_refused() -> None:
    """The constant `np.ma.masked` has no value at all."""
    nothing: Any = np.ma.masked
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for call in (
            lambda: era.response(PLATE, (nothing, 0.05), BAND),
            lambda: era.response(PLATE, (0.1, 0.05), nothing),
            lambda: era.plan(PLATE, (0.1, 0.05), nothing),
            lambda: era.modes(PLATE, nothing),
        ):
            with pytest.raises((era.RequestError, TypeError)):
                call()


@pytest.mark.parametrize(
    "place",
    [[0.1, 0.05, 0.0], [[0.1, 0.05]], [], "ab", ["0.1", "0.05"], [0.1, 1j], [0.1, [0.2]], None, {"x": 1}, np.array(["a", "b"])]
    + [np.array(["0.1", "0.05"], dtype=object), [True, False], np.array([1, 2], dtype="timedelta64[s]"), [0.1, b"0.05"]],
    ids=repr,
)
def test_what_is_no_place(place: Any) -> None:
    with pytest.raises(TypeError, match="at_m"):
        era.response(PLATE, place, BAND)


@pytest.mark.parametrize("band", [[[100.0, 150.0]], "100", ["100", "150"], [100 + 1j], None, [True], np.array(["100"], dtype=object)], ids=repr)
def test_what_is_no_frequency(band: Any) -> None:
    with pytest.raises(TypeError, match="frequency_hz"):
        era.response(PLATE, (0.1, 0.05), band)


def test_scenes_of_arrays() -> None:
    """Keys whose values are lists take arrays; numbers of NumPy are numbers."""
    damping = {"modal_ratio": [[50.0, 0.02], [400.0, 0.005]]}
    expected = PLATE.with_(surface={"damping": None}).with_(surface={"damping": damping})
    ratios = np.array(damping["modal_ratio"])
    found = PLATE.with_(surface={"damping": None}).with_(surface={"damping": {"modal_ratio": ratios}})
    assert found == expected
    for number in (np.float32(2.0), np.float64(2.0), np.int64(2), np.longdouble(2.0), np.array(2.0)):
        assert PLATE.with_(surface={"thickness_mm": number}).thickness_m == 0.002
    masked = np.ma.array(ratios, mask=[[False, False], [False, True]])
    with pytest.raises(TypeError, match="masked"):
        PLATE.with_(surface={"damping": {"modal_ratio": masked}})
