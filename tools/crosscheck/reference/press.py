"""What a steady press anywhere on the surface does to the actuators' gaps (docs/src/scene.md, "A press").

A formulation of its own: K u = f with the stiffness of the surface, of springs and of sealed air, real, without any mass, dashpot or loss factor.
No frequency is near enough to nothing to stand for it: a dashpot c holds by w c, a loss factor makes a spring stiffer by sqrt(1 + eta^2), and a mass M on a
spring k takes w^2 M off it.
"""

from dataclasses import dataclass, replace

import numpy as np

from .panel import REFINEMENT
from .scene import VACUUM_PERMITTIVITY_F_PER_M

# An electrode or the other is on for this part of the time at most.
ON = 0.96
# What the electrodes may take of what holds a mass, at most (docs/src/planner.md, "Limits").
HELD = 0.6
TRAVEL_PART = 1 / 3
# Rounding of a cut-out's border, in m.
EDGE = 1e-9


@dataclass(frozen=True)
class Sag:
    """One actuator under the press."""

    alone: float
    # The reference's own error of that, absolute.
    error: float
    # With the electrodes' pull at the highest voltages; in m, as all of this.
    sag: float
    # Where it is held: its place, and who says so.
    stop: float
    kind: str
    # The reference's own error of the sag: what the errors of press and stiffness make of it, which the pull enlarges.
    sag_error: float

    def surely(self):
        """The same with as much more sag as it may be off by: by the places that are pressed, and the pull that grows with it."""
        return replace(self, sag=min(1.06 * self.sag, self.stop))

    def closed(self, travel):
        """How far the mass is off its middle at most, with a travel on top."""
        return min(self.sag + travel, self.stop)


def places(scene):
    """Points to press: a lattice from border to border and the actuators' own."""
    xs = np.linspace(0.0, scene.length, 21)
    ys = [scene.width / 2] if scene.is_bar else np.linspace(0.0, scene.width, 15)
    # Where a cut-out meets the panel's border there is no surface on its own border either.
    cut = lambda x, y: any(c.x - EDGE <= x <= c.x + c.length + EDGE and c.y - EDGE <= y <= c.y + c.width + EDGE for c in scene.cutouts)
    lattice = [(x, y) for y in ys for x in xs if not cut(x, y)]
    return lattice + [(a.x, a.y) for a in scene.actuators]


def _pull(actuator, volts, x):
    """Mean force on a mass x off its middle while one electrode or the other is on, each half of the time."""
    both = VACUUM_PERMITTIVITY_F_PER_M * actuator.electrode_area * volts**2 / 2
    near, far = np.maximum(actuator.air_gap - x, 0.02 * actuator.air_gap), actuator.air_gap + x
    return ON / 2 * both * (1 / near**2 - 1 / far**2)


# Part of the largest force below which what is left of one on a motion that nothing holds is rounding:
# 4e-8 was seen where one support of 7 N/m and one spring hold two motions of three, and a force on a motion that nothing holds leaves a hundredth.
BALANCED = 1e-6
# The rounding shows in the values of these motions, which are zero: a shape is off by that over the least value that is held, and up to so many times as
# much (2.7e-6 was seen where that ratio is 3e-6).
ROUNDED = 10.0


def steady(model):
    """Coordinates [coordinate, actuator] of one of a panel's two meshes under a steady newton of each actuator; infinite under one that moves
    what nothing holds."""
    size = model.size
    # Scaled by the stiffness of each coordinate, or by what its mass would be held with at the shift where it has none.
    scale = 1 / np.sqrt(np.diagonal(model.stiffness - model.shift * model.mass))
    stiffness = model.stiffness * scale[:, None] * scale[None, :]
    loads = scale[:, None] * model.forces
    values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
    free = vectors[:, : model.free_motions]
    held = vectors[:, model.free_motions :]
    answer = scale[:, None] * (held @ ((held.T @ loads) / values[model.free_motions :, None]))
    rounding = np.abs(values[: model.free_motions]).max(initial=0.0) / values[model.free_motions]
    balanced = max(BALANCED, ROUNDED * rounding)
    pushed = np.abs(free.T @ loads).max(axis=0, initial=0.0) > balanced * np.abs(loads).max(axis=0)
    answer[:, pushed] = np.inf
    assert answer.shape == (size, model.forces.shape[1])
    return answer


def _of_meshes(panel, ask):
    """An answer of the finer mesh, and the reference's own error of it: from two coarser ones, as two may agree by chance, and the least that is
    believed. A force between nodes converges with h^2 alone."""
    fine, coarse, coarser = (ask(model, steady(model)) for model in (panel.fine, panel.coarse, panel.coarser))
    with np.errstate(invalid="ignore"):
        difference = np.maximum(np.abs(fine - coarse), np.abs(coarse - coarser) / REFINEMENT**2)
        error = np.maximum(panel.safety * difference, panel.floor * np.abs(fine).max(initial=0.0))
    return fine, error


def alone(panel, points):
    """How far a steady newton at each point moves each mass, [actuator, point], and the reference's own error, in m; infinite on a panel that
    nothing holds."""
    moved, error = _of_meshes(panel, lambda model, u: np.abs(model.output_rows(points) @ u).T)
    if panel.surface_is_free():
        moved[:] = np.inf
    return moved, error


def yielding(panel):
    """How far a steady newton of each actuator (column) moves each mass against its electrodes (row), and the reference's own error, in m."""
    return _of_meshes(panel, lambda model, u: np.abs(model.gaps @ u))


def press(scene, panel, more=()):
    """A [`Sag`] for each actuator, at the place where the press moves it furthest: of a lattice, and of more places to look at."""
    actuators, count = scene.actuators, len(scene.actuators)
    if scene.press <= 0:
        moved, error = np.zeros(count), np.zeros(count)
    else:
        all_moved, errors = alone(panel, [*places(scene), *more])
        at = all_moved.argmax(axis=1)
        moved, error = (scene.press * values[np.arange(count), at] for values in (all_moved, errors))
        # A mass that hangs on the panel follows what is steady.
        moved[[a.inertial for a in actuators]] = 0.0
        error[[a.inertial for a in actuators]] = 0.0
    yields, yields_error = yielding(panel)
    rails = [min(other.max_voltage for other in actuators[i % 2 :: 2]) for i in range(count)]
    taken = np.array([ON * VACUUM_PERMITTIVITY_F_PER_M * a.electrode_area * v**2 / a.air_gap**3 for a, v in zip(actuators, rails)])
    part = (yields @ taken).max()
    volts = np.array(rails) * (np.sqrt(HELD / part) if part > HELD else 1.0)
    gaps = np.array([a.air_gap for a in actuators])
    given = np.array([np.inf if a.stop is None else a.stop for a in actuators])

    def balance(stops, moved, yields):
        """The nearest place to the middle where press, pull and springs are in balance, or a stop: relaxed, from the middle on."""
        x = np.zeros(count)
        for _ in range(4000):
            pulls = np.array([_pull(a, v, own) for a, v, own in zip(actuators, volts, x)])
            wanted = np.minimum(moved + yields @ pulls, np.minimum(stops, gaps))
            if np.abs(wanted - x).max() < 1e-10 * gaps.max():
                break
            x += 0.5 * (wanted - x)
        return x

    # Stops are missing one after the other, that of the mass that the press moves furthest first.
    stops = given.copy()
    while True:
        x = balance(stops, moved, yields)
        loose = np.isinf(stops) & (x > TRAVEL_PART * gaps)
        if not loose.any():
            break
        i = np.where(loose, moved / gaps, -np.inf).argmax()
        stops[i] = TRAVEL_PART * gaps[i]
    if np.isnan(x).any() or np.isnan(yields).any():
        raise ValueError(f"the reference does not know what a press does: {x}, {yields}")
    kinds = ["given" if np.isfinite(own) else "assumed" if np.isfinite(stop) else "none" for own, stop in zip(given, stops)]
    with np.errstate(invalid="ignore"):
        more_x = balance(stops, moved + np.where(np.isfinite(moved), error, 0.0), yields + np.where(np.isfinite(yields), yields_error, 0.0))
    return [Sag(*values) for values in zip(moved, error, x, stops, kinds, more_x - x)]


def softening_growth(actuator, sag):
    """How many times as much the electrodes take of the springs under the press as at rest: by differences of their pull where the
    springs hold the mass; where a stop does, what they pull over what such springs would bring back."""
    rest = 1e-5 * actuator.air_gap
    slope = lambda x: (_pull(actuator, 1.0, x + rest) - _pull(actuator, 1.0, x - rest)) / (2 * rest)
    x = min(sag.sag, 0.95 * actuator.air_gap)
    return slope(x) / slope(0.0) if sag.sag < sag.stop else _pull(actuator, 1.0, x) / x / slope(0.0)
