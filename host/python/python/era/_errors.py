"""What this package raises and warns of."""

from __future__ import annotations

from typing import Any, NamedTuple, Optional


class Mistake(NamedTuple):
    """One mistake in a scene."""

    line: Optional[int]
    """Line of the text, counted from 1; `None` for scenes made from keywords."""
    text: str
    """What is wrong, in a sentence."""
    field: Optional[str]
    """The key with its path, as `support[2].x_mm`; lists count from 1, as in the messages of the command line."""
    value: Optional[str]
    """Its value as written."""
    allowed: Optional[str]
    """What is allowed there."""


class EraError(Exception):
    """Of all errors that this package raises for what it was asked.

    Attributes
    ----------
    field : str or None
        What is wrong, by its name as an argument or in the scene.
    value : object
        As given.
    allowed : str or None
        What is allowed in its place.
    """

    field: Optional[str] = None
    value: Any = None
    allowed: Optional[str] = None


class SceneError(EraError, ValueError):
    """A scene that cannot be used; `field`, `value` and `allowed` are those of the first mistake.

    Attributes
    ----------
    mistakes : tuple of Mistake
        All of them, in the order of the text's lines.
    """

    mistakes: tuple[Mistake, ...] = ()


class RequestError(EraError, ValueError):
    """An argument that is out of range, or that does not go with another."""


class ModelError(EraError, RuntimeError):
    """The panel cannot be modelled as asked: too many unknowns or modes, or matrices that cannot be factored."""


class ResonanceError(ModelError):
    """At this frequency the response is unbounded: an undamped mode is at its resonance.

    `field` is ``"frequency_hz"``, `value` the frequency in Hz.
    """


class SimulationError(EraError, RuntimeError):
    """A plan cannot be compared with the simulated device: it drives nothing, or there is no steady motion."""


class ModelWarning(UserWarning):
    """The answer is that of the model, but the model is known to be off there: a thick panel, or a press that gaps do not bear."""
