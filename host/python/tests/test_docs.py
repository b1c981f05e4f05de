"""Examples in docstrings, and what docstrings have to say."""

from __future__ import annotations

import doctest
import inspect
from typing import Any

import era
import era.study
import pytest

FUNCTIONS = [name for name in era.__all__ if inspect.isroutine(getattr(era, name))]
CLASSES = [name for name in era.__all__ if inspect.isclass(getattr(era, name))]


def documented() -> list[tuple[str, Any]]:
    """The package, its public names, and what its classes have."""
    found: list[tuple[str, Any]] = [("era", era), ("era.study", era.study), ("era.study.run", era.study.run)]
    for name in FUNCTIONS + CLASSES:
        value = getattr(era, name)
        found.append((name, value))
        if inspect.isclass(value) and value.__module__ == "era":
            found += [(f"{name}.{member}", getattr(value, member)) for member in vars(value) if not member.startswith("_")]
    return found


ALL = documented()


def test_everything_has_a_docstring() -> None:
    assert len(ALL) > 100 and len(FUNCTIONS) == 10
    assert [name for name, value in ALL if not inspect.getdoc(value)] == []


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_say_what_they_take_and_give(name: str) -> None:
    function = getattr(era, name)
    text = inspect.getdoc(function) or ""
    assert all(f"\n{heading}\n---" in text for heading in ("Parameters", "Returns", "Raises", "Examples"))
    described = text.split("Parameters\n")[1].split("Returns\n")[0]
    for parameter in inspect.signature(function).parameters:
        # Alone, or with another in one line.
        lines = [line.split(" :")[0].split(", ") for line in described.splitlines() if line[:1].strip()]
        assert any(parameter in names for names in lines), parameter


EXAMPLES = [
    test
    for name, value in ALL
    for test in [doctest.DocTestFinder(recurse=False).find(value, name, module=False)]
    if test and test[0].examples
]


@pytest.mark.parametrize("tests", EXAMPLES, ids=lambda tests: str(tests[0].name))
def test_examples(tests: list[doctest.DocTest]) -> None:
    for test in tests:
        report: list[str] = []
        failed = doctest.DocTestRunner(verbose=False).run(test, out=report.append).failed
        assert failed == 0, "".join(report)


def test_examples_are_found() -> None:
    names = {tests[0].name for tests in EXAMPLES}
    assert {"era", "Scene", "Scene.with_", *FUNCTIONS} <= names
