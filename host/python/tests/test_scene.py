"""Scenes: what they are made from, equality, changed copies, mistakes."""

from __future__ import annotations

import copy
import errno
import importlib.metadata
import inspect
import pickle
from pathlib import Path
from typing import Any

import era
import numpy as np
import pytest
from conftest import ROOT

SCENES = sorted((ROOT / "examples/scenes").glob("*.toml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: str(path.stem))
def test_every_way_makes_the_same_scene(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    scene = era.Scene.from_file(path)
    tables = scene.to_dict()
    assert tables.pop("version") == 1
    for other in (
        era.Scene.from_toml(text),
        era.Scene(**tables),
        era.Scene.from_toml(scene.to_toml()),
        pickle.loads(pickle.dumps(scene)),
        copy.deepcopy(scene),
        scene.with_(),
    ):
        assert other == scene and hash(other) == hash(scene) and other is not scene
    assert len(SCENES) >= 5


def test_scenes_are_equal_by_what_they_mean(plate: era.Scene) -> None:
    surface = plate.to_dict()["surface"]
    assert isinstance(surface["length_mm"], float)
    # Whole numbers, NumPy's numbers, another order of keys, a default that is written down, minus zero.
    assert plate.with_(surface={"length_mm": int(surface["length_mm"])}) == plate
    assert plate.with_(surface={"length_mm": np.float32(surface["length_mm"])}) == plate
    assert plate.with_(surface={"width_mm": np.int64(surface["width_mm"])}) == plate
    assert plate.with_(press={"force_n": 5.0}) == plate
    zeros = [plate.with_(support={0: {"rotational_stiffness_n_m_per_rad": zero}}) for zero in (0.0, -0.0)]
    assert zeros[0] == zeros[1] == plate and hash(zeros[0]) == hash(zeros[1]) == hash(plate)
    # Every number counts, the last digit too.
    longer = plate.with_(surface={"length_mm": float(np.nextafter(surface["length_mm"], 1e9))})
    assert longer != plate and hash(longer) != hash(plate)
    assert plate != "plate" and plate in {plate: 1}


def test_changed_copies(plate: era.Scene) -> None:
    before = plate.to_dict()
    changed = plate.with_(
        name="other",
        surface={"thickness_mm": 1.5, "material": {"density_kg_m3": 2800.0}},
        actuator={"left": {"x_mm": 61.0}, -1: {"y_mm": 62.0}},
        mass=[{"x_mm": 10.0, "y_mm": 20.0, "mass_g": 3.0}],
        support={0: None},
    )
    tables = changed.to_dict()
    assert tables["name"] == "other" and changed.name == "other"
    assert tables["surface"]["material"] == {**before["surface"]["material"], "density_kg_m3": 2800.0}
    assert changed.thickness_m == 1.5 / 1e3
    assert changed.actuator_xy_m.tolist() == [[0.061, before["actuator"][0]["y_mm"] / 1e3], [before["actuator"][1]["x_mm"] / 1e3, 0.062]]
    assert tables["support"] == before["support"][1:] and len(changed.support_xy_m) == len(plate.support_xy_m) - 1
    assert tables["mass"] == [{"x_mm": 10.0, "y_mm": 20.0, "mass_g": 3.0}]
    # The first one is as it was.
    assert plate.to_dict() == before
    assert changed.with_(support=None).support_xy_m.shape == (0, 2)
    assert plate.with_(actuator={"left": None, "right": None}).actuator_ids == ()
    held = plate.with_(edge=[{"side": "left", "kind": "pinned"}])
    assert held.with_(edge={"left": {"kind": "clamped"}}).to_dict()["edge"] == [{"side": "left", "kind": "clamped"}]


def test_electronics_and_cables_are_tables_and_keys(plate: era.Scene) -> None:
    resistors = {"charging_resistance_ohm": 1e6, "discharging_resistance_ohm": 1e5, "discharging_delay_us": 15.0}
    behind = plate.with_(electronics=resistors, actuator={"left": {"cable_capacitance_pf": 120.0}})
    assert behind != plate and behind.to_dict()["electronics"] == resistors
    assert behind.with_(electronics={"charging_resistance_ohm": 0.0, "discharging_resistance_ohm": 0.0, "discharging_delay_us": 0.0}) != behind
    tables = behind.to_dict()
    tables.pop("version")
    assert era.Scene(**tables) == behind
    assert behind.with_(electronics=None, actuator={"left": {"cable_capacitance_pf": None}}) == plate
    with pytest.raises(era.SceneError, match="electronics.charging_resistance_ohm"):
        plate.with_(electronics={"charging_resistance_ohm": 1e7})
    drives = [era.plan(scene, (0.1, 0.05), intensity_g=0.2, tolerance="fast").drives for scene in (plate, behind)]
    assert all(drive.force_phase_rad == drive.phase_rad == 0.0 for drive in drives[0])
    assert all(drive.phase_rad == 0.0 and -0.5 < drive.force_phase_rad < -0.02 for drive in drives[1])


def test_what_a_scene_tells(plate: era.Scene, bar: era.Scene) -> None:
    assert (plate.kind, plate.length_m, plate.width_m, plate.thickness_m) == ("plate", 0.3, 0.2, 0.002)
    assert plate.mass_kg == pytest.approx(2700.0 * 0.3 * 0.2 * 0.002)
    assert bar.kind == "bar"
    assert plate.point_m(960.0, 640.0) == (0.15, 0.1)
    assert repr(plate).startswith("<Scene ") and "actuators: 2" in repr(plate)
    with pytest.raises(AttributeError):
        plate.name = "other"  # type: ignore[misc]


def test_mistakes_are_told_with_their_lines(plate: era.Scene) -> None:
    text = plate.to_toml().replace("thickness_mm = 2.0", "thickness_mm = 2000.0\nthicknes_mm = 1")
    assert text != plate.to_toml()
    with pytest.raises(era.SceneError, match="thickness_mm") as caught:
        era.Scene.from_toml(text)
    lines = text.splitlines()
    wrong, unknown = caught.value.mistakes
    assert wrong.line is not None and lines[wrong.line - 1].startswith("thickness_mm")
    assert wrong[2:] == ("surface.thickness_mm", "2000", "0.001 to 100")
    assert unknown.line is not None and lines[unknown.line - 1].startswith("thicknes_mm")
    error = caught.value
    assert (error.field, error.value, error.allowed) == ("surface.thickness_mm", "2000", "0.001 to 100")
    assert isinstance(error, ValueError) and isinstance(error, era.EraError)
    again = pickle.loads(pickle.dumps(error))
    assert again.mistakes == error.mistakes and str(again) == str(error)


def test_mistakes_in_keywords_have_no_lines(plate: era.Scene) -> None:
    with pytest.raises(era.SceneError) as caught:
        plate.with_(actuator={"right": {"x_mm": 400.0}})
    (mistake,) = caught.value.mistakes
    assert mistake.line is None and mistake.field == "actuator[2].x_mm" and mistake.allowed == "0 to 300"
    assert str(caught.value) == f"Scene: {mistake.text}"
    with pytest.raises(era.SceneError, match="surface.width_mm is missing"):
        era.Scene("x", {"kind": "bar", "length_mm": 100.0})


@pytest.mark.parametrize(
    ("changes", "field", "value"),
    [
        ({"actuator": {"middle": {"x_mm": 1.0}}}, "actuator", "middle"),
        ({"actuator": {2: {"x_mm": 1.0}}}, "actuator", 2),
        ({"support": {-9: None}}, "support", -9),
        ({"support": {"left": {}}}, "support", "left"),
    ],
)
def test_entries_that_are_not_there(plate: era.Scene, changes: dict[str, Any], field: str, value: object) -> None:
    with pytest.raises(era.RequestError) as caught:
        plate.with_(**changes)
    assert (caught.value.field, caught.value.value) == (field, value) and caught.value.allowed


def test_what_is_no_value_of_a_scene(plate: era.Scene) -> None:
    with pytest.raises(TypeError, match="complex"):
        plate.with_(surface={"length_mm": 1j})
    with pytest.raises(era.SceneError, match="surface.length_mm is NaN"):
        plate.with_(surface={"length_mm": float("nan")})
    with pytest.raises(TypeError):
        era.Scene("x", {}, actuators=[])  # type: ignore[call-arg]


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nothing.toml") as missing:
        era.Scene.from_file(tmp_path / "nothing.toml")
    assert (missing.value.errno, missing.value.filename) == (errno.ENOENT, str(tmp_path / "nothing.toml"))
    with pytest.raises(IsADirectoryError):
        era.Scene.from_file(tmp_path)
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(OSError, match="bytes.toml"):
        era.Scene.from_file(tmp_path / "bytes.toml")
    with pytest.raises(era.RequestError, match="name"):
        era.Scene.example("disc")  # type: ignore[arg-type]


def test_the_version_is_the_packages() -> None:
    assert era.__version__ == importlib.metadata.version("era")


def test_the_text_of_a_file_is_not_taken_for_a_name(plate: era.Scene) -> None:
    with pytest.raises(TypeError, match=r"needs the argument `surface` .* use Scene\.from_file\(path\) or Scene\.from_toml\(text\)"):
        era.Scene(plate.to_toml())  # type: ignore[call-arg]
    # To those who ask, it is still an argument that has to be there.
    assert inspect.signature(era.Scene).parameters["surface"].default is inspect.Parameter.empty
