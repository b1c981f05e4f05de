"""Design studies, here or on the workers of Dask.

>>> import era, era.study, tempfile
>>> text = '''
... version = 1
... name = "how soft the corners are"
... scene = "plate.toml"
... [[variable]]
... key = "support.*.stiffness_n_per_m"
... from = 500
... to = 8000
... [[wish]]
... figure = "rigid_mode_hz"
... [method]
... designs = 4
... finalists = 1
... '''
>>> study = era.Study(text, era.Scene.example("plate"))
>>> with tempfile.TemporaryDirectory() as folder:
...     found = era.study.run(study, folder=folder)
...     found.table["rigid_mode_hz"].shape, len(found.best)
((5,), 1)

A study's work is a number of tasks (`Study.tasks`), each of which gives the same bytes whoever computes it. Rows come back to the
caller, who writes them into the study's folder; workers need no disk that they share. What is in the folder is not computed again, so
that the same call goes on after anything that has ended it.
"""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Optional, Union

from era._era import Scene, Study

if TYPE_CHECKING:
    from distributed import Client, Future

__all__ = ["Best", "Result", "Study", "run"]

# Tasks on their way for each thread of the workers: one is computed, the next is there when it is done, and the scheduler, which needs about
# 1 ms a task, never knows of more than these, however many a study has.
_AHEAD = 3

_Told = tuple[tuple[float, ...], ...]
Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Best:
    """One of the best designs, computed anew thoroughly; or the scene as it is."""

    design: int
    """Its row in the table."""
    scene: Scene
    """Ready for everything else of this package, and for `era serve`."""
    figures: dict[str, float]
    """By the names of the table's columns."""
    weakest_m: Optional[tuple[float, float]]
    """The weakest place, if a figure is of it."""
    error_bound: Optional[float]
    """Upper bound on the relative error of `weakest_g`; `None` where there is none, or that is no figure of the study."""
    error_bounds: dict[str, Optional[float]]
    """The same of every figure; `None` where none is known, which is of all but `weakest_g` with distinct drives for every touch, modes' frequencies, and sags."""
    tolerance_met: Optional[bool]
    """Whether all bounds that are known are within the tolerance; `None` where none is known."""
    worst: dict[str, float]
    """Of each figure that is wished for the worst of what may be off, as the design was looked at first; empty where nothing may be off."""
    breaks: Optional[str]
    """The limits that the figures break, as computed anew; `None` if they keep all."""
    failed: Optional[str]
    """Why it could not be computed anew; figures are missing then."""


@dataclass(frozen=True)
class Result:
    """What came of a study."""

    folder: Path
    """Where `report.html`, `designs.parquet`, `best-1.toml`, ... are."""
    table: dict[str, Any] = field(repr=False)
    """Column by column, a row for each design, the first one being the scene as it is: see `Study.table`."""
    base: Best
    """The scene as it is."""
    best: tuple[Best, ...]
    """The best first."""
    tolerance: float
    """What base and best were computed for."""
    kept: int
    """Designs within all limits."""
    broken: int
    """Designs that break one."""
    failed: int
    """Designs that have no figures: `table["reason"]` says why."""
    nearest: Optional[tuple[int, str]]
    """Where none keeps all limits, the design that is least beyond them, and what it breaks."""


def run(
    study: Union[Study, str, PathLike[str]],
    client: Optional[Client] = None,
    *,
    folder: Optional[Union[str, PathLike[str]]] = None,
    progress: Optional[Progress] = None,
) -> Result:
    """Computes what is not in the study's folder yet, then the best designs anew, and writes the results.

    Parameters
    ----------
    study : Study, str or os.PathLike
        A study, or its file.
    client : distributed.Client, optional
        Whose workers compute: processes here, a cluster, Slurm's nodes by dask-jobqueue. Each needs this package in the same version.
        This process's threads compute unless given.
    folder : str or os.PathLike, optional
        Made if it is not there. Unless given it is in the current directory, with ``-results`` after the name of the study's file without its
        ending, as for `era study`, or after the study's own name where `study` is not a file.
    progress : callable, optional
        Called in this thread with the number of designs that are there, and of all, as they come. What it raises ends the work; what was
        computed before is kept.

    Returns
    -------
    Result

    Raises
    ------
    SceneError
        Mistakes in the study or its scene.
    RequestError
        The folder is another study's.
    OSError
        Something cannot be written: what was computed before is kept, and the same call goes on from there.
    Exception
        Whatever Dask raises: a worker that died again and again, a scheduler that is gone. The same call goes on.

    Warns
    -----
    ModelWarning
        Gaps of the scene as it is do not bear its press.

    Examples
    --------
    With Dask, here:

    >>> from distributed import Client  # doctest: +SKIP
    >>> with Client(n_workers=4, threads_per_worker=1) as client:  # doctest: +SKIP
    ...     found = era.study.run("placement.toml", client)
    """
    if isinstance(study, Study):
        usual = _file_name(study.name)
    else:
        usual = Path(study).stem
        study = Study.from_file(study)
    place = Path(f"{usual}-results" if folder is None else folder)
    if client is None:
        study.compute_all(place, progress)
    else:
        _Work(study, place, progress).by(client)
    summary = study.write(place)
    table = study.table(place)
    nearest = summary["nearest"]

    def best(told: dict[str, Any], path: Optional[Path]) -> Best:
        text = study.scene.to_toml() if path is None else path.read_text(encoding="utf-8")
        at_mm = told["weakest_mm"]
        return Best(
            design=told["design"],
            scene=Scene.from_toml(text),
            figures=told["figures"],
            weakest_m=None if at_mm is None else (at_mm[0] / 1e3, at_mm[1] / 1e3),
            error_bound=told["error_bound"],
            error_bounds=told["error_bounds"],
            tolerance_met=told["tolerance_met"],
            worst=told["worst"],
            breaks=told["breaks"],
            failed=told["failed"],
        )

    return Result(
        folder=place,
        table=table,
        base=best(summary["as_it_is"], None),
        best=tuple(best(told, place / f"best-{k}.toml") for k, told in enumerate(summary["best"], 1)),
        tolerance=summary["tolerance"],
        kept=summary["kept"],
        broken=summary["broken"],
        failed=summary["failed"],
        nearest=None if nearest is None else (nearest["design"], nearest["reason"]),
    )


def _file_name(name: str) -> str:
    """A study's name as that of a folder."""
    return "".join(letter if letter.isalnum() else "-" for letter in name).strip("-") or "study"


# A worker's studies by their files: what they know of a panel is found once. The last few, as a worker may serve many.
_STUDIES: dict[tuple[str, str], Study] = {}
_KEPT = 4


def _study(text: str, scene: str) -> Study:
    known = _STUDIES.get((text, scene))
    if known is None:
        while len(_STUDIES) >= _KEPT:
            # Another thread may have taken the same one away.
            _STUDIES.pop(next(iter(_STUDIES)), None)
        known = _STUDIES[text, scene] = Study(text, Scene.from_toml(scene))
    return known


def _compute(text: str, scene: str, task: str, told: _Told, threads: int) -> bytes:
    """Runs on a worker."""
    return _study(text, scene).compute(task, told, threads=threads)


class _Work:
    """The tasks of a study, and what is known of them."""

    def __init__(self, study: Study, folder: Path, progress: Optional[Progress]) -> None:
        self.study, self.folder, self.progress = study, folder, progress
        self.there = 0
        self.base = b""
        self.told: dict[str, list[tuple[float, ...]]] = {}

    def by(self, client: Client) -> None:
        """Has a client's workers compute what is missing."""
        from distributed import as_completed

        self.base = self.study.kept(self.folder, "base") or b""
        if not self.base:
            self.base = self._result(self._submit(client, "base"))
            self.study.keep(self.folder, "base", self.base)
        ready, later = self._ready()
        flying: dict[Future, str] = {}
        try:
            coming = as_completed()
            while True:
                while len(flying) < self._most(client):
                    task = ready.popleft() if ready else next(later, None)
                    if task is None:
                        break
                    future = self._submit(client, task)
                    flying[future] = task
                    coming.add(future)
                if not flying:
                    return
                future = next(coming)
                task = flying.pop(future)
                rows = self._result(future)
                self.study.keep(self.folder, task, rows)
                self._has(task, rows)
                follower = self._follower(task)
                if follower is not None:
                    ready.append(follower)
        finally:
            # Nobody waits for them any more.
            if flying:
                client.cancel(list(flying))

    def _ready(self) -> tuple[deque[str], Iterator[str]]:
        """Tasks that can be computed now and are not there: the next generation of each search, and all that need no other."""
        ready: deque[str] = deque()
        others = (task for task in self.study.tasks() if task.startswith("designs-"))
        for first in (task for task in self.study.tasks() if task.endswith("-generation-00000")):
            task: Optional[str] = first
            while task is not None and (rows := self.study.kept(self.folder, task)) is not None:
                self._has(task, rows)
                task = self._follower(task)
            if task is not None:
                ready.append(task)
        return ready, (task for task in others if not self._is_there(task))

    def _is_there(self, task: str) -> bool:
        is_there = self.study.kept(self.folder, task) is not None
        if is_there:
            self._count(task)
        return is_there

    def _has(self, task: str, rows: bytes) -> None:
        self._count(task)
        if not task.startswith("designs-"):
            self.told.setdefault(_run(task), []).append(tuple(self.study.losses(task, self.base, rows)))

    def _count(self, task: str) -> None:
        self.there += self.study.size(task)
        if self.progress is not None:
            self.progress(self.there, self.study.designs)

    def _follower(self, task: str) -> Optional[str]:
        """The generation after this one."""
        if task.startswith("designs-"):
            return None
        follower = f"{_run(task)}-generation-{len(self.told[_run(task)]):05}"
        return follower if follower in self._generations else None

    @functools.cached_property
    def _generations(self) -> frozenset[str]:
        return frozenset(task for task in self.study.tasks() if "-generation-" in task)

    def _submit(self, client: Client, task: str) -> Future:
        told = tuple(self.told.get(_run(task), ()))
        texts = self.study.text, self.study.scene.to_toml()
        # A name of its own for each task: whatever a scheduler still knows of the same study is the same bytes.
        key = f"era-study-{self.study.key[:16]}-{task}"
        return client.submit(_compute, *texts, task, told, 1, key=key)

    @staticmethod
    def _result(future: Future) -> bytes:
        rows: bytes = future.result()
        future.release()
        return rows

    @staticmethod
    def _most(client: Client) -> int:
        """Tasks that may be on their way, as many workers as there are now."""
        threads = sum(client.nthreads().values())
        return max(_AHEAD * threads, _AHEAD)


def _run(task: str) -> str:
    """Which search a generation is of."""
    return task.split("-generation-")[0]
