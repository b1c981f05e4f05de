"""What tests share: the command line's program, and scenes."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import era
import pytest

ROOT = Path(__file__).resolve().parents[3]
Ask = Callable[..., Any]


@pytest.fixture(scope="session")
def program() -> Path:
    """The command line's program: what `ERA_PROGRAM` names, or cargo's."""
    program = Path(os.environ.get("ERA_PROGRAM", ROOT / "target/release/era"))
    assert program.exists(), f"{program} is not there: build it, or name another in ERA_PROGRAM"
    return program


@pytest.fixture(scope="session")
def ask(program: Path, tmp_path_factory: pytest.TempPathFactory) -> Ask:
    """Runs a command for a scene and returns its JSON."""
    folder = tmp_path_factory.mktemp("cli")

    def run(scene: era.Scene, *arguments: object) -> Any:
        path = folder / "scene.toml"
        path.write_text(scene.to_toml(), encoding="utf-8")
        command = [str(program), *map(str, arguments), "--scene", str(path), "--json"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@pytest.fixture(scope="session")
def plate() -> era.Scene:
    return era.Scene.example("plate")


@pytest.fixture(scope="session")
def bar() -> era.Scene:
    return era.Scene.example("bar")
