"""Panels with electrostatic resonant actuators, for NumPy.

A `Scene` is a panel with what holds and drives it; functions tell what it does:

>>> import era, numpy as np
>>> plate = era.Scene.example("plate")
>>> found = era.modes(plate, 200.0)
>>> curves = era.response(plate, (0.1, 0.05), np.linspace(40.0, 400.0, 181))
>>> curves.acceleration_m_s2_per_n.shape
(2, 181)

Lengths are in m from the surface's top left corner, x to the right, y down; everything else is in the unit of its name. Phasors are
those of e^(+j w t), deflections positive towards the user. Results have an `error_bound` against the exact solution of the scene's own
equations. While something is computed other threads of Python run, and Ctrl-C is heard.
"""

from era._era import (
    Design,
    Drive,
    Effect,
    Field,
    Modes,
    Plan,
    Predicted,
    Press,
    QuietResult,
    Reach,
    Response,
    Scene,
    Study,
    Sweep,
    TargetResult,
    Transient,
    Verification,
    __version__,
    effect,
    field,
    modes,
    plan,
    press,
    reach,
    response,
    sweep,
    transient,
    verify,
)
from era._errors import (
    EraError,
    Mistake,
    ModelError,
    ModelWarning,
    RequestError,
    ResonanceError,
    SceneError,
    SimulationError,
)

__all__ = [
    "Design",
    "Drive",
    "Effect",
    "EraError",
    "Field",
    "Mistake",
    "ModelError",
    "ModelWarning",
    "Modes",
    "Plan",
    "Predicted",
    "Press",
    "QuietResult",
    "Reach",
    "RequestError",
    "ResonanceError",
    "Response",
    "Scene",
    "SceneError",
    "SimulationError",
    "Study",
    "Sweep",
    "TargetResult",
    "Transient",
    "Verification",
    "__version__",
    "effect",
    "field",
    "modes",
    "plan",
    "press",
    "reach",
    "response",
    "sweep",
    "transient",
    "verify",
]
