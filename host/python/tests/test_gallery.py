"""The gallery's scripts: they run, they find what they say, their pictures are complete. `ERA_PICTURES=DIR` keeps the pictures."""

from __future__ import annotations

import os
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import era.study
import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402

GALLERY = Path(__file__).resolve().parents[1] / "gallery"
Names = dict[str, Any]


def modes_of_a_bar(names: Names) -> None:
    frequencies = np.array(names["frequencies_hz"])
    # Stiffer springs never make a mode lower, and the first one rises with their root as long as the bar moves as a whole.
    assert (np.diff(frequencies, axis=0) > -1e-6 * frequencies[1:]).all()
    rise = np.log(frequencies[1, 0] / frequencies[0, 0]) / np.log(names["stiffnesses_n_per_m"][1] / names["stiffnesses_n_per_m"][0])
    assert abs(rise - 0.5) < 0.01


def map_of_a_panel(names: Names) -> None:
    field, reach = names["field"], names["reach"]
    # The plan gives what was asked for where the finger is, and a touch is no stronger than the strongest.
    at = np.argmin(np.abs(field.y_m - names["touch_m"][1])), np.argmin(np.abs(field.x_m - names["touch_m"][0]))
    assert 0.2 < field.peak_g[at] < 0.4 < reach.strongest_g[at]
    assert names["largest_g"] == np.nanmax(field.peak_g)


def which_frequencies(names: Names) -> None:
    # What was chosen is better than half of what there was, for each actuator.
    for drive, gains in zip(names["plan"].drives, names["gain_db"]):
        assert np.interp(drive.frequency_hz, names["frequency_hz"], gains) > np.median(gains)


def accuracy_for_speed(names: Names) -> None:
    bounds, errors = np.array(names["bounds"]), np.array(names["errors"])
    assert (bounds <= names["tolerances"]).all()
    # The reference is not exact either.
    assert (errors <= bounds + names["reference"].error_bound.max()).all()
    assert (np.diff(names["unknowns"]) >= 0).all() and names["unknowns"][-1] > names["unknowns"][0]


def placement(names: Names) -> None:
    # The study's best is what the planner says of its scene, and much better than the scene as it is.
    found, reach = names["found"], names["reaches"][1]
    assert isinstance(found, era.study.Result) and len(found.table["weakest_g"]) == names["study"].designs + 1
    assert names["best_g"] > 2.0 * names["first_g"]
    assert reach.weakest()[0] == pytest.approx(names["best_g"], rel=3e-3)
    # Of 25 mm around each ERA nothing is over the edge, or over the other one's.
    (left, right), side_m = found.best[0].scene.actuator_xy_m, (names["plate"].length_m, names["plate"].width_m)
    assert (np.minimum(left, right) >= 0.025).all() and (np.maximum(left, right) <= np.array(side_m) - 0.025).all()
    assert np.hypot(*(left - right)) >= 0.052


def calibration(names: Names) -> None:
    # Four standard deviations of what was found are seldom wrong, and what was found is worth something.
    assert (np.abs(names["found"].x - names["true"]) < 4.0 * names["spread"] + 1e-3).all()
    assert (names["spread"] < 0.02).all()


CHECKS: dict[str, Callable[[Names], None]] = {
    check.__name__: check
    for check in (modes_of_a_bar, map_of_a_panel, which_frequencies, accuracy_for_speed, placement, calibration)
}


def test_every_script_is_checked() -> None:
    assert {path.stem for path in GALLERY.glob("*.py")} == set(CHECKS)


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_gallery(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = Path(os.environ.get("ERA_PICTURES", tmp_path))
    folder.mkdir(parents=True, exist_ok=True)
    pictures: list[Path] = []

    def show() -> None:
        for number in plt.get_fignums():
            figure = plt.figure(number)
            for axis in figure.axes:
                # Colour scales have a label at their side only.
                assert axis.get_ylabel() and axis.has_data(), axis
            pictures.append(folder / f"{name}_{len(pictures) + 1}.png")
            figure.savefig(pictures[-1], dpi=80)
        plt.close("all")

    monkeypatch.setattr(plt, "show", show)
    names = runpy.run_path(str(GALLERY / f"{name}.py"))
    assert pictures and not plt.get_fignums(), "a picture was made that was not shown"
    CHECKS[name](names)
