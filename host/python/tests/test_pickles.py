"""Every result goes to other processes, and comes back as it was."""

from __future__ import annotations

import copy
import inspect
import multiprocessing
import pickle
from collections.abc import Callable
from typing import Any

import era
import numpy as np
import pytest

PLATE = era.Scene.example("plate")
AT_M = (0.1, 0.05)

STUDY = era.Study(
    """
version = 1
name = "pickled"
scene = "plate.toml"
[[variable]]
key = "surface.thickness_mm"
from = 1
to = 3
[[variable]]
name = "mount"
key = "actuator.*.mount"
values = ["grounded", "inertial"]
[[wish]]
figure = "mass_g"
[method]
designs = 1
""",
    PLATE,
)

RESULTS: dict[str, Callable[[], Any]] = {
    "Modes": lambda: era.modes(PLATE, 200.0, grid=(5, 3)),
    "Response": lambda: era.response(PLATE, AT_M, [100.0, 200.0]),
    "Sweep": lambda: era.sweep(PLATE, [100.0], grid=(3, 3)),
    "Transient": lambda: era.transient(PLATE, AT_M, [("left", 100.0, 1.0)], duration_s=0.01),
    "Plan": lambda: era.plan(PLATE, AT_M, also=[(0.2, 0.15)], quiet=[(0.28, 0.02, 0.01, 0.1)], explain=True),
    "Drive": lambda: era.plan(PLATE, AT_M).drives[0],
    "Predicted": lambda: era.plan(PLATE, AT_M).predicted,
    "TargetResult": lambda: era.plan(PLATE, AT_M).targets[0],
    "QuietResult": lambda: era.plan(PLATE, AT_M, quiet=[(0.28, 0.02, 0.01, 0.1)]).quiet[0],
    "Press": lambda: era.press(era.Scene.example("bar"), 1.0),
    "Field": lambda: era.field(PLATE, AT_M),
    "Reach": lambda: era.reach(era.Scene.example("bar")),
    "Verification": lambda: era.verify(PLATE, points=1),
    "Effect": lambda: era.effect(PLATE, AT_M, "click"),
    "Design": lambda: STUDY.evaluate([0.25, 0.9]),
    "Scene": lambda: PLATE,
    "Study": lambda: STUDY,
}


def told(value: Any) -> Any:
    """All that can be read of a result, with arrays as bytes."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes(), value.flags.writeable
    if isinstance(value, (list, tuple)):
        return [told(entry) for entry in value]
    if type(value).__module__ != "era":
        return repr(value)
    names = [name for name, _ in inspect.getmembers(type(value)) if not name.startswith("_")]
    values = [(name, getattr(value, name)) for name in names]
    plain = [(name, told(own)) for name, own in values if not callable(own)]
    dicts = [(name, own()) for name, own in values if name in ("to_dict", "to_dicts")]
    return type(value).__name__, plain, dicts


def test_all_results_are_here() -> None:
    """A class that is added has to be added here."""
    classes = {name for name in era.__all__ if isinstance(getattr(era, name), type)}
    exceptions = {name for name in classes if issubclass(getattr(era, name), BaseException)}
    assert classes - exceptions - {"Mistake"} == set(RESULTS)


@pytest.mark.parametrize("name", RESULTS)
def test_results_are_pickled(name: str) -> None:
    found = RESULTS[name]()
    assert type(found).__name__ == name
    expected = told(found)
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(found, protocol))
        assert type(again) is type(found) and told(again) == expected and repr(again) == repr(found)
    for again in (copy.copy(found), copy.deepcopy(found)):
        assert told(again) == expected


def plan_of(x_m: float) -> Any:
    return era.plan(PLATE, (x_m, 0.05))


def test_a_pool_returns_results() -> None:
    """Processes that share nothing with this one."""
    places = [0.05, 0.1, 0.15]
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        found = pool.map(plan_of, places)
    for own, x_m in zip(found, places):
        here, there = (dict(told(plan)[1], plan=plan.to_dict()) for plan in (plan_of(x_m), own))
        # How long it took is no part of what was found.
        assert here["plan"].pop("elapsed_us") > 0 < there["plan"].pop("elapsed_us")
        assert here == there


def test_damaged_pickles_are_refused() -> None:
    restore, (name, fields) = RESULTS["Drive"]().__reduce__()
    with pytest.raises(ValueError, match="version"):
        restore(name, {**fields, "force_n": "much"})
    del fields["force_n"]
    with pytest.raises(ValueError, match="version"):
        restore(name, fields)
    with pytest.raises(ValueError, match="Nothing"):
        restore("Nothing", {})
