"""What a check is given and what it gives back: the program through its public face, the reference, results, plants."""

import contextlib
import copy
import json
import os
import resource
import socket
import subprocess
import time
import urllib.error
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .reference.panel import Panel
from .reference.press import press
from .reference.random_scenes import to_toml
from .reference.scene import Scene

# Harmonics count up to here, and every check takes the same panel.
HARMONICS_UP_TO_HZ = 1000.0
# A run of the program that takes more processor time has failed, however busy the machine is; and one that takes this many times as
# long by the clock, that it waits for something.
TIME_LIMIT_S = 120
# The daemon is on this machine, whatever proxy the environment names.
OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))
WAITING = 10


@dataclass
class Result:
    """One comparison: it passes if `difference` is at most `bound`, both in the quantity's own measure."""

    quantity: str
    scene: str
    difference: float
    bound: float
    comparable: bool = True
    note: str = ""

    @property
    def ratio(self):
        """The difference in units of its bound."""
        return self.difference / self.bound if self.bound > 0 else (0.0 if self.difference == 0 else np.inf)

    @property
    def failed(self):
        """Whether it counts and does not hold; what is not a number does not hold."""
        return self.comparable and not self.difference <= self.bound


def not_comparable(quantity, scene, note):
    """A case that says nothing, and why."""
    return Result(quantity, scene, 0.0, 0.0, False, note)


class ProgramFailed(Exception):
    """The program refused or failed: exit code and what it said."""

    def __init__(self, command, code, stderr):
        super().__init__(f"exit code {code}: {stderr.strip()[-400:]}")
        self.command, self.code, self.stderr = command, code, stderr


def _seconds_of_children():
    """Processor time of all programs that have ended, in s."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


@dataclass
class Program:
    """The `era` binary on one scene file."""

    binary: str
    scene_path: Path
    folder: Path
    # Of processor time.
    limit_s: int = TIME_LIMIT_S

    def _environment(self):
        return os.environ | {"ERA_CACHE_DIR": str(self.folder / "cache"), "RAYON_NUM_THREADS": "1"}

    def run(self, command, *arguments):
        """Runs a subcommand on the scene and returns (standard output, standard error)."""
        return self._run([self.binary, command, "--scene", str(self.scene_path), *map(str, arguments)])

    def _run(self, line):
        limit = lambda: resource.setrlimit(resource.RLIMIT_CPU, (self.limit_s, self.limit_s + 5))
        options = {"capture_output": True, "text": True, "env": self._environment(), "check": False, "preexec_fn": limit}
        before = _seconds_of_children()
        try:
            done = subprocess.run(line, timeout=WAITING * self.limit_s, **options)
        except subprocess.TimeoutExpired:
            raise ProgramFailed(line, -1, f"did not end within {WAITING * self.limit_s} s") from None
        # The program ends in an orderly way at that signal, with 1.
        if done.returncode != 0 and _seconds_of_children() - before >= self.limit_s:
            raise ProgramFailed(line, done.returncode, f"did not end within {self.limit_s} s of processor time")
        if done.returncode != 0:
            raise ProgramFailed(line, done.returncode, done.stderr)
        return done.stdout, done.stderr

    def json(self, command, *arguments):
        """What a subcommand prints with --json."""
        return json.loads(self.run(command, *arguments, "--json")[0])

    def json_alone(self, command, *arguments):
        """The same of a subcommand whose scene is named elsewhere."""
        return json.loads(self._run([self.binary, command, *map(str, arguments), "--json"])[0])

    @contextlib.contextmanager
    def serve(self, *arguments):
        """A daemon on a free port; gives a function (method, path, body) -> (status, JSON), and its address as `.base`."""
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        # A simulated board that a busy machine has lost for a moment has nobody in front of it: the next touch arms it.
        line = [self.binary, "serve", "--scene", str(self.scene_path), "--listen", f"127.0.0.1:{port}",
                "--after-outage", "touch", *map(str, arguments)]
        log = open(self.folder / f"serve-{port}.log", "w+", encoding="utf-8")
        process = subprocess.Popen(line, stdout=log, stderr=log, env=self._environment())
        base = f"http://127.0.0.1:{port}"

        def request(method, path, body=None):
            data = None if body is None else json.dumps(body).encode()
            call = urllib.request.Request(base + path, data=data, method=method, headers={"Content-Type": "application/json"})
            try:
                with OPENER.open(call, timeout=TIME_LIMIT_S) as answer:
                    return answer.status, json.loads(answer.read() or b"null")
            except urllib.error.HTTPError as error:
                return error.code, json.loads(error.read() or b"null")

        request.base = base
        try:
            started = time.monotonic()
            while True:
                try:
                    request("GET", "/v1/state")
                    break
                except (urllib.error.URLError, ConnectionError):
                    if process.poll() is not None or time.monotonic() - started > TIME_LIMIT_S:
                        log.seek(0)
                        raise ProgramFailed(line, process.poll(), log.read()) from None
                    time.sleep(0.02)
            yield request
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(5)
            if process.poll() is None:
                process.kill()
                process.wait()
            log.close()


@dataclass
class Context:
    """One scene of a run. The reference reads `scene`; the program reads the file at `era.scene_path`.

    The two are the same unless a mistake is planted in the scene that the program is handed.
    """

    index: int
    seed: int
    name: str
    scene: Scene
    table: dict
    era: Program
    folder: Path
    plant: str | None = None
    # Clicks are integrated from the pulses that this firmware image makes on the emulated board, if it is there.
    firmware: Path | None = None
    # Whether the scene is one that the user has given, and not a random one.
    is_given_scene: bool = False
    _panels: dict = field(default_factory=dict)
    _press: list | None = None

    def rng(self, purpose):
        """Random numbers of this scene and purpose, whatever ran before."""
        return np.random.default_rng([self.seed, self.index, *purpose.encode()])

    def panel(self, max_hz):
        """The reference's panel for frequencies up to at least `max_hz`, built once: nearly every scene needs one for harmonics."""
        max_hz = max(max_hz, HARMONICS_UP_TO_HZ)
        fitting = [hz for hz in self._panels if hz >= max_hz]
        if not fitting:
            self._panels[max_hz] = Panel(self.scene, max_hz)
            fitting = [max_hz]
        return self._panels[min(fitting)]

    def press(self):
        """What a press does to each actuator, worked out once."""
        if self._press is None:
            self._press = press(self.scene, self.panel(HARMONICS_UP_TO_HZ))
        return self._press

    def random_point(self, rng, margin=0.02):
        """A place on the surface and outside cut-outs, in m."""
        scene = self.scene
        for _ in range(1000):
            x = scene.length * rng.uniform(margin, 1 - margin)
            y = scene.width / 2 if scene.is_bar else scene.width * rng.uniform(margin, 1 - margin)
            if not scene.in_cutout(x, y):
                return x, y
        raise ValueError("no surface found")

    def planted(self, quantity):
        """Whether the check itself is to alter the program's answer for `quantity`."""
        return self.plant == quantity


# Mistakes to plant in the scene that the program is handed: each takes a copy of the scene's table and returns whether it
# could be changed.


def change(keys, factor):
    """Multiplies surface.material.youngs_modulus_pa and the like."""

    def plant(table):
        for key in keys[:-1]:
            if key not in table:
                return False
            table = table[key]
        if not table.get(keys[-1]):
            return False
        value = table[keys[-1]]
        # Pairs of a frequency and a number.
        table[keys[-1]] = [[hz, own * factor] for hz, own in value] if isinstance(value, list) else value * factor
        return True

    return plant


def change_all(kind, key, factor):
    """Multiplies a key of every actuator, support, ..."""

    def plant(table):
        changed = False
        for item in table.get(kind, []):
            if item.get(key):
                item[key] *= factor
                changed = True
        return changed

    return plant


def change_layers(key, factor):
    """Multiplies a key of every layer, or of its material."""

    def plant(table):
        changed = False
        for layer in table.get("layer", []):
            for item in (layer, layer["material"]):
                if item.get(key):
                    item[key] *= factor
                    changed = True
        return changed

    return plant


def move_actuator(distance_mm):
    """Moves the first actuator along x, inwards."""

    def plant(table):
        place = table["actuator"][0]
        middle = table["surface"]["length_mm"] / 2
        place["x_mm"] += distance_mm if place["x_mm"] < middle else -distance_mm
        return True

    return plant


def drop(kind):
    """Leaves out the first support, mass, ..."""

    def plant(table):
        if not table.get(kind):
            return False
        table[kind].pop(0)
        return True

    return plant


def either(*plants):
    """The first of several that can be planted."""
    return lambda table: any(plant(table) for plant in plants)


def planted_text(table, plant):
    """The text of the changed scene, or None if this scene has nothing to change."""
    changed = copy.deepcopy(table)
    return to_toml(changed) if plant(changed) else None
