"""Studies: the same as the command line, on any number of workers, whatever happens to them on the way."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import era
import era.study
import numpy as np
import pyarrow.parquet
import pytest
from distributed import Client, LocalCluster

# Dask, and what it is made of, warn of themselves.
pytestmark = pytest.mark.filterwarnings("default")

PLACES = """
version = 1
name = "places"
scene = "plate.toml"
[[variable]]
place = "actuator.left"
within_mm = [10, 10, 290, 190]
[[variable]]
place = "actuator.right"
mirror_of = "actuator.left"
mirrored = "both"
[[wish]]
figure = "weakest_g"
[method]
way = "{way}"
designs = {designs}
chunk = {chunk}
finalists = 2
"""


def places(way: str = "sobol", designs: int = 24, chunk: int = 2) -> era.Study:
    text = PLACES.format(way=way, designs=designs, chunk=chunk)
    if way == "evolution":
        text = text.replace(f"chunk = {chunk}", "population = 6\nruns = 2")
    return era.Study(text, era.Scene.example("plate"))


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@contextmanager
def dask(workers: int) -> Iterator[Client]:
    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> tuple[era.study.Result, dict[str, bytes]]:
    """What this process finds."""
    folder = tmp_path_factory.mktemp("alone")
    found = era.study.run(places(), folder=folder)
    return found, files(folder)


def test_a_study_is_that_of_the_command_line(
    alone: tuple[era.study.Result, dict[str, bytes]], program: Path, tmp_path: Path
) -> None:
    study = places()
    (tmp_path / "plate.toml").write_text(study.scene.to_toml(), encoding="utf-8")
    (tmp_path / "places.toml").write_text(study.text, encoding="utf-8")
    command = [str(program), "study", str(tmp_path / "places.toml"), "--out", str(tmp_path / "found")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert files(tmp_path / "found") == alone[1]
    # 12 chunks and the scene itself; key, table, report, two scenes.
    assert len(alone[1]) == 13 + 5


def test_a_result_is_what_other_functions_say(alone: tuple[era.study.Result, dict[str, bytes]]) -> None:
    """The strongest plan at the place that is told as the weakest, by the planner; and no place of the map is weaker."""
    found, _ = alone
    for own in (found.base, *found.best):
        assert own.failed is None and own.weakest_m is not None and own.error_bound is not None
        reach = era.reach(own.scene)
        weakest_g, at_m = reach.weakest()
        assert own.figures["weakest_g"] == pytest.approx(weakest_g, rel=own.error_bound + 2e-3)
        assert at_m == pytest.approx(own.weakest_m, abs=1e-9)
    # Where one would put the ERAs first; the example plate has them at places that a longer search found.
    on_axis = {"left": {"x_mm": 75.0, "y_mm": 100.0}, "right": {"x_mm": 225.0, "y_mm": 100.0}}
    first_g, _ = era.reach(era.Scene.example("plate").with_(actuator=on_axis)).weakest()
    assert found.best[0].figures["weakest_g"] > 1.5 * first_g


def test_the_table_is_read_by_others(alone: tuple[era.study.Result, dict[str, bytes]]) -> None:
    found, _ = alone
    table = pyarrow.parquet.read_table(found.folder / "designs.parquet").to_pydict()
    assert table.pop("design") == list(range(25))
    for name, values in found.table.items():
        there = table.pop(name)
        if isinstance(values, np.ndarray):
            np.testing.assert_array_equal(np.array([np.nan if value is None else value for value in there]), values)
        else:
            assert there == list(values), name
    assert not table
    # Mirrored: what the study was asked for.
    left, right = found.table["actuator.left.x_mm"][1:], found.table["actuator.right.x_mm"][1:]
    np.testing.assert_allclose(left + right, 300.0)


def test_what_may_be_off_is_in_the_table_and_told(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mass goes with thickness, and is at worst that of the thickest sample."""
    text = """
version = 1
name = "heavy or light"
scene = "plate.toml"
[[variable]]
key = "surface.thickness_mm"
from = 1.0
to = 3.0
[[wish]]
figure = "mass_g"
[[uncertain]]
key = "surface.thickness_mm"
part = 0.1
[method]
way = "grid"
levels = 3
robust = "corners"
finalists = 1
"""
    study = era.Study(text, era.Scene.example("plate"))
    found = era.study.run(study, folder=tmp_path / "found")
    sheet_g = 1e3 * 0.3 * 0.2 * 2700.0 * 1e-3 * np.array([1.0, 2.0, 3.0])
    low, high, meant = (found.table[f"mass_g{end}"][1:] for end in ("_low", "_high", ""))
    np.testing.assert_allclose([meant - low, high - meant], [0.1 * sheet_g, 0.1 * sheet_g], rtol=1e-9)
    (best,) = found.best
    assert best.worst == {"mass_g": high[0]} and best.figures["mass_g"] == meant[0] and best.breaks is None
    assert best.error_bound is None and best.tolerance_met is None and best.error_bounds == {"mass_g": None}
    assert f"# mass_g = {high[0]:.1f} at worst, over the samples of the uncertain values" in (found.folder / "best-1.toml").read_text()
    (tmp_path / "plate.toml").write_text(study.scene.to_toml(), encoding="utf-8")
    (tmp_path / "heavy.toml").write_text(text, encoding="utf-8")
    # A file's results are where the command line's are.
    done = subprocess.run([program, "study", "../heavy.toml"], cwd=tmp_path / "found", capture_output=True, text=True, check=False)
    assert done.returncode == 0 and f"mass_g is {high[0]:.1f} at worst" in done.stdout, done.stderr + done.stdout
    monkeypatch.chdir(tmp_path / "found")
    written = files(Path("heavy-results"))
    again = era.study.run("../heavy.toml")
    assert again.folder == Path("heavy-results") and files(again.folder) == written


def test_a_press_that_gaps_do_not_bear_is_told(tmp_path: Path) -> None:
    """As other functions tell it, once, of the scene itself."""
    plate = era.Scene.example("plate")
    bare = plate.with_(actuator={own: {"stop_um": None} for own in plate.actuator_ids})
    study = era.Study(places(designs=2).text, bare)
    with pytest.warns(era.ModelWarning, match="press"):
        era.study.run(study, folder=tmp_path / "found")
    with pytest.warns(era.ModelWarning, match="press"):
        era.plan(bare, (0.1, 0.05))


def test_the_start_may_be_no_design(tmp_path: Path) -> None:
    """The scene as it is breaks what designs have to keep; it is what they are compared with all the same."""
    study = era.Study(places(designs=3).text + "[[apart]]\nplaces = [\"actuator.*\"]\ndistance_mm = 160\n", era.Scene.example("plate"))
    found = era.study.run(study, folder=tmp_path / "found")
    assert found.base.failed is None and found.base.figures["weakest_g"] > 0.1
    assert (tmp_path / "found" / "report.html").exists()


def test_progress_is_told_without_a_client(alone: tuple[era.study.Result, dict[str, bytes]], tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    threads: set[int] = set()

    def progress(there: int, of: int) -> None:
        seen.append((there, of))
        threads.add(threading.get_ident())

    # What is there already is told as one.
    for name in ("base", "designs-0000000", "designs-0000003"):
        places().keep(tmp_path, name, alone[1][f"rows/{name}.rows"])
    era.study.run(places(), folder=tmp_path, progress=progress)
    assert files(tmp_path) == alone[1]
    assert seen == [(2 * k, 24) for k in range(2, 13)]
    assert threads == {threading.get_ident()}


def test_what_progress_raises_ends_a_study_which_goes_on_later(
    alone: tuple[era.study.Result, dict[str, bytes]], tmp_path: Path
) -> None:
    def progress(there: int, _: int) -> None:
        if there >= 4:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        era.study.run(places(), folder=tmp_path, progress=progress)
    assert not (tmp_path / "report.html").exists()
    era.study.run(places(), folder=tmp_path)
    assert files(tmp_path) == alone[1]


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_any_number_of_workers_finds_the_same_bytes(
    workers: int, alone: tuple[era.study.Result, dict[str, bytes]], tmp_path: Path
) -> None:
    seen: list[tuple[int, int]] = []
    with dask(workers) as client:
        found = era.study.run(places(), client, folder=tmp_path, progress=lambda there, of: seen.append((there, of)))
    assert files(tmp_path) == alone[1]
    assert seen == [(2 * k, 24) for k in range(1, 13)]
    assert [own.figures for own in found.best] == [own.figures for own in alone[0].best]


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("searched")
    era.study.run(places("evolution", 48), folder=folder)
    return files(folder)


def test_a_search_finds_the_same_bytes_and_goes_on(searched: dict[str, bytes], tmp_path: Path) -> None:
    study = places("evolution", 48)
    # Some of it is there: the first run's first two generations, and the second's none.
    for name in ("base", "run-0000-generation-00000", "run-0000-generation-00001"):
        study.keep(tmp_path, name, searched[f"rows/{name}.rows"])
    seen: list[int] = []
    with dask(2) as client:
        era.study.run(study, client, folder=tmp_path, progress=lambda there, _: seen.append(there))
    assert files(tmp_path) == searched
    assert seen == [6 * k for k in range(1, 9)]
    # The same without a client: all is there, of each search in its turn.
    seen.clear()
    era.study.run(study, folder=tmp_path, progress=lambda there, _: seen.append(there))
    assert files(tmp_path) == searched
    assert seen == [6 * k for k in range(1, 9)]


def rows_in(folder: Path) -> int:
    return len(list(folder.glob("rows/*.rows")))


def await_rows(folder: Path, count: int) -> None:
    until = time.monotonic() + 300.0
    while rows_in(folder) < count:
        assert time.monotonic() < until
        time.sleep(0.01)


def test_a_worker_that_is_killed_costs_time_only(
    alone: tuple[era.study.Result, dict[str, bytes]], tmp_path: Path
) -> None:
    killed: list[int] = []
    with dask(2) as client:
        worker = next(iter(client.run(os.getpid).values()))

        def kill() -> None:
            await_rows(tmp_path, 3)
            os.kill(worker, signal.SIGKILL)
            killed.append(rows_in(tmp_path))

        killer = threading.Thread(target=kill)
        killer.start()
        era.study.run(places(), client, folder=tmp_path)
        killer.join()
        assert worker not in client.run(os.getpid).values()
    # In the middle: some rows were there, some were not.
    assert 3 <= killed[0] < 13
    assert files(tmp_path) == alone[1]


def start(*arguments: str) -> subprocess.Popen[bytes]:
    # As its own group, to be killed with its children.
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def kill_group(child: subprocess.Popen[bytes]) -> None:
    try:
        os.killpg(child.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    child.wait()


def test_a_study_goes_on_after_its_scheduler_has_died(
    alone: tuple[era.study.Result, dict[str, bytes]], tmp_path: Path
) -> None:
    book, folder = tmp_path / "scheduler.json", tmp_path / "found"
    scheduler = start("dask_scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(book))
    worker = start("dask_worker", "--nthreads", "1", "--no-dashboard", "--scheduler-file", str(book))
    try:
        with Client(scheduler_file=str(book), timeout=120) as client:
            client.wait_for_workers(1, timeout=120)

            def kill() -> None:
                await_rows(folder, 3)
                kill_group(scheduler)

            killer = threading.Thread(target=kill)
            killer.start()
            with pytest.raises(Exception) as raised:  # noqa: PT011 - Dask's own, of several kinds
                era.study.run(places(), client, folder=folder)
            killer.join()
            assert not isinstance(raised.value, (era.EraError, AssertionError))
    finally:
        kill_group(worker)
        kill_group(scheduler)
    there = rows_in(folder)
    assert 3 <= there < 13
    seen: list[int] = []
    with dask(1) as client:
        era.study.run(places(), client, folder=folder, progress=lambda count, _: seen.append(count))
    assert files(folder) == alone[1]
    assert seen[-1] == 24


def test_a_poisoned_design_is_a_row_with_its_reason(tmp_path: Path) -> None:
    text = PLACES.split("[[variable]]")[0] + """
[[variable]]
key = "actuator.left.x_mm"
values = [75.0, 1e4, 80.0]
[[wish]]
figure = "weakest_g"
[method]
way = "grid"
finalists = 1
chunk = 1
"""
    with dask(2) as client:
        found = era.study.run(era.Study(text, era.Scene.example("plate")), client, folder=tmp_path)
    assert found.table["status"] == ["kept", "kept", "failed", "kept"]
    reason = found.table["reason"][2]
    assert "x_mm" in reason and "10000" in reason
    assert (found.kept, found.broken, found.failed) == (2, 0, 1)
    assert np.isnan(found.table["weakest_g"]).tolist() == [False, False, True, False]


FULL = """
import resource, signal, sys
import era, era.study
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
study = era.Study(open(sys.argv[1]).read(), era.Scene.example("plate"))
resource.setrlimit(resource.RLIMIT_FSIZE, (90, resource.RLIM_INFINITY))
try:
    era.study.run(study, folder=sys.argv[2])
except OSError as error:
    print("no room:", error)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
print([str(path) for path in __import__("pathlib").Path(sys.argv[2]).rglob("*.rows")])
era.study.run(study, folder=sys.argv[2])
"""


def test_a_full_disk_is_told_and_leaves_nothing_half_written(
    alone: tuple[era.study.Result, dict[str, bytes]], tmp_path: Path
) -> None:
    """A limit on the size of files stands for a disk without room: the key fits, and no row."""
    (tmp_path / "places.toml").write_text(places().text, encoding="utf-8")
    arguments = [sys.executable, "-c", FULL, str(tmp_path / "places.toml"), str(tmp_path / "found")]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told, left = done.stdout.splitlines()
    assert told.startswith("no room: [Errno 27] cannot write: File too large: ") and "base.rows" in told
    assert left == "[]"
    assert files(tmp_path / "found") == alone[1]


def test_what_does_not_belong_is_refused(
    alone: tuple[era.study.Result, dict[str, bytes]], tmp_path: Path
) -> None:
    study, other = places(), places(designs=22)
    rows = alone[1]["rows/designs-0000000.rows"]
    assert study.compute("designs-0000000") == rows
    with pytest.raises(era.RequestError) as raised:
        other.keep(tmp_path, "designs-0000000", rows)
    assert raised.value.field == "rows"
    with pytest.raises(era.RequestError) as raised:
        study.keep(tmp_path, "designs-0000000", rows)
    assert raised.value.field == "folder" and raised.value.value == str(tmp_path)
    for task in ("designs-0000012", "designs-12", "run-0000-generation-00000", ""):
        with pytest.raises(era.RequestError) as raised:
            study.compute(task)
        assert (raised.value.field, raised.value.value) == ("task", task)
    with pytest.raises(era.RequestError) as raised:
        places("evolution", 48).compute("run-0000-generation-00001", [])
    assert raised.value.field == "len(losses)"
    with pytest.raises(era.RequestError, match="of 24 designs are missing"):
        study.write(tmp_path / "empty")
    with pytest.raises(era.SceneError) as mistakes:
        era.Study("version = 1\nname = 'x'\nscene = 'y'\n[[wish]]\nfigure = 'beauty'\n", era.Scene.example("plate"))
    assert any(found.line == 5 for found in mistakes.value.mistakes)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        era.study.run(tmp_path / "nowhere.toml")


def test_a_study_is_pickled(tmp_path: Path) -> None:
    study = places()
    again = pickle.loads(pickle.dumps(study))
    assert (again.key, again.text, again.scene) == (study.key, study.text, study.scene)
    (tmp_path / "plate.toml").write_text(study.scene.to_toml(), encoding="utf-8")
    (tmp_path / "places.toml").write_text(study.text, encoding="utf-8")
    assert era.Study.from_file(tmp_path / "places.toml").key == study.key


STOPPED = """
import era, era.study, sys
study = era.Study(open(sys.argv[1]).read(), era.Scene.example("plate"))
print("started", flush=True)
try:
    era.study.run(study, folder=sys.argv[2], progress=lambda there, of: None)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


def test_ctrl_c_ends_a_study_which_goes_on_later(tmp_path: Path) -> None:
    study, folder = places(designs=4000), tmp_path / "found"
    (tmp_path / "places.toml").write_text(study.text, encoding="utf-8")
    arguments = [sys.executable, "-c", STOPPED, str(tmp_path / "places.toml"), str(folder)]
    child = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    try:
        await_rows(folder, 3)
        child.send_signal(signal.SIGINT)
        output, _ = child.communicate(timeout=600)
    finally:
        child.kill()
    assert output.split() == ["started", "interrupted"]
    assert 3 <= rows_in(folder) < 2001
    assert all(study.kept(folder, path.stem) is not None for path in folder.glob("rows/*.rows"))

