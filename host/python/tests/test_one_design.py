"""One design at a time, for optimisers of other packages: the numbers of the study itself, limits as values."""

from __future__ import annotations

from typing import Any

import era
import era.study
import numpy as np
import pytest
import scipy.optimize

TEXT = """
version = 1
name = "one at a time"
scene = "plate.toml"
[[variable]]
key = "surface.thickness_mm"
from = 1
to = 3
[[variable]]
name = "soft"
key = "support.*.stiffness_n_per_m"
from = 500
to = 8000
scale = "log"
[[variable]]
name = "mount"
key = "actuator.*.mount"
values = ["grounded", "inertial"]
[[wish]]
figure = "rigid_mode_hz"
goal = "most"
[[wish]]
figure = "mass_g"
[[limit]]
figure = "sag_um"
most = 800
[[limit]]
figure = "mass_g"
least = 100
most = 500
[method]
way = "{way}"
designs = 8
finalists = 1
"""


@pytest.fixture(scope="module")
def study() -> era.Study:
    return era.Study(TEXT.format(way="sobol"), era.Scene.example("plate"))


def test_names(study: era.Study) -> None:
    assert study.dimensions == ("surface.thickness_mm", "soft", "mount")
    assert study.dimension_counts == (None, None, 2)
    assert study.objectives == ("most rigid_mode_hz", "least mass_g")
    assert study.constraints == ("sag_um at most 800", "mass_g at least 100", "mass_g at most 500")


def test_a_design_is_that_of_the_table(study: era.Study, tmp_path: Any) -> None:
    """The study's own designs, asked for one by one, have the table's figures bit for bit; constraints say what its status says."""
    table = era.study.run(study, folder=tmp_path / "results").table
    choices, same = {"grounded": 0.25, "inertial": 0.75}, 0
    for row in range(1, 9):
        thickness, soft, mount = (table[name][row] for name in ("surface.thickness_mm", "soft", "mount"))
        point = [(thickness - 1) / 2, np.log(soft / 500) / np.log(16), choices[mount]]
        found = study.evaluate(point)
        assert found.values["mount"] == mount and found.failed is None
        own: Any = [found.values["surface.thickness_mm"], found.values["soft"]]
        np.testing.assert_allclose(own, [thickness, soft], rtol=1e-5)
        if (found.values["surface.thickness_mm"], found.values["soft"]) == (thickness, soft):
            assert found.figures == {name: table[name][row] for name in study.figures}
            same += 1
        figures = found.figures
        # The sign that makes less better, and each bound by itself.
        assert found.objectives.tolist() == [-figures["rigid_mode_hz"], figures["mass_g"]]
        beyond = [figures["sag_um"] - 800, 100 - figures["mass_g"], figures["mass_g"] - 500]
        np.testing.assert_allclose(found.constraints, beyond, rtol=1e-12)
        assert ("kept" == table["status"][row]) == bool((found.constraints <= 0).all())
    # Values have six digits, so that the way back through the unit cube meets them.
    assert same == 8


def test_a_design_is_a_scene(study: era.Study) -> None:
    found = study.evaluate(np.array([0.5, 0.0, 0.9]))
    assert found.scene_text is not None
    scene = era.Scene.from_toml(found.scene_text)
    expected = era.Scene.example("plate").with_(
        surface={"thickness_mm": 2.0},
        support={k: {"stiffness_n_per_m": 500.0} for k in range(len(era.Scene.example("plate").support_xy_m))},
        actuator={name: {"mount": "inertial"} for name in ("left", "right")},
    )
    assert scene == expected


def test_the_method_is_of_no_account(study: era.Study) -> None:
    text = TEXT.format(way="evolution").replace("designs = 8", "designs = 32\npopulation = 4")
    other = era.Study(text, era.Scene.example("plate"))
    point = [0.3, 0.6, 0.1]
    assert other.evaluate(point).figures == study.evaluate(point).figures


def test_a_design_that_fails_says_why() -> None:
    text = TEXT.format(way="sobol").replace("from = 1\nto = 3", "from = 1\nto = 3000")
    found = era.Study(text, era.Scene.example("plate")).evaluate([1.0, 0.5, 0.5])
    assert found.failed is not None and "thickness_mm" in found.failed
    assert found.figures == {} and np.isnan(found.objectives).all() and np.isnan(found.constraints).all()


@pytest.mark.parametrize(
    ("point", "field", "value"),
    [
        ([0.5, 0.5], "len(point)", 2),
        ([0.5, 0.5, 1.5], "point[2]", 1.5),
        ([0.5, -1e-9, 0.5], "point[1]", -1e-9),
        (np.ma.array([0.5, 0.5, 0.5], mask=[False, True, False]), "point[1]", "masked"),
    ],
)
def test_points_that_are_none(study: era.Study, point: Any, field: str, value: object) -> None:
    with pytest.raises(era.RequestError) as raised:
        study.evaluate(point)
    assert (raised.value.field, raised.value.value) == (field, value)


def test_an_optimiser_of_another_package(study: era.Study) -> None:
    """SciPy finds the thickest panel that its mass allows, which is known: 500 g are the surface with all that rides on it."""

    def evaluated(x: float) -> era.Design:
        return study.evaluate([x, 0.5, 0.0])

    found = scipy.optimize.brentq(lambda x: float(evaluated(x).constraints[2]), 0.0, 1.0, xtol=1e-6)
    thickness_mm = evaluated(found).values["surface.thickness_mm"]
    plate = era.Scene.example("plate")
    grams = {t: evaluated((t - 1) / 2).figures["mass_g"] for t in (1.0, 2.0)}
    per_mm = plate.mass_kg * 1e3 / (plate.thickness_m * 1e3)
    assert grams[2.0] - grams[1.0] == pytest.approx(per_mm, rel=1e-9)
    assert thickness_mm == pytest.approx(1.0 + (500.0 - grams[1.0]) / per_mm, rel=1e-4)


def test_edges_go_by_their_sides() -> None:
    edges = [
        {"side": "left", "kind": "elastic", "stiffness_n_per_m2": 1e4},
        {"side": "top", "kind": "elastic", "stiffness_n_per_m2": 1e4},
    ]
    scene = era.Scene.example("plate").with_(edge=edges)
    text = TEXT.format(way="sobol").replace("support.*.stiffness_n_per_m", "edge.top.stiffness_n_per_m2")
    found = era.Study(text, scene).evaluate([0.5, 1.0, 0.0])
    assert found.scene_text is not None
    told = era.Scene.from_toml(found.scene_text).to_dict()["edge"]
    assert [edge["stiffness_n_per_m2"] for edge in told] == [1e4, 8000.0]
    with pytest.raises(era.SceneError, match=r"edge\.bottom"):
        era.Study(text.replace("edge.top", "edge.bottom"), scene)
