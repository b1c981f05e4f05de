"""What a steady press anywhere on the surface does to the actuators' gaps (docs/src/scene.md, "A press")."""

from dataclasses import dataclass, replace

import numpy as np

from .scene import VACUUM_PERMITTIVITY_F_PER_M

# Slow enough to stand for a steady force: what nothing holds has no answer to one.
SLOW_HZ = 0.1
# An electrode or the other is on for this part of the time at most.
ON = 0.96
# What the electrodes may take of what holds a mass, at most (docs/src/planner.md).
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


def alone(panel, points):
    """How far a newton at each point moves each mass, [actuator, point], and the reference's own error, in m."""
    omega = 2 * np.pi * SLOW_HZ
    moved = np.abs(panel.accelerance(points, [SLOW_HZ])[0]) / omega**2
    return moved, panel.accelerance_error(points, [SLOW_HZ])[0] / omega**2


def press(scene, panel):
    """A [`Sag`] for each actuator, at the place where the press moves it furthest."""
    actuators, count = scene.actuators, len(scene.actuators)
    if scene.press <= 0:
        moved = error = np.zeros(count)
    else:
        all_moved, errors = alone(panel, places(scene))
        at = all_moved.argmax(axis=1)
        moved, error = (scene.press * values[np.arange(count), at] for values in (all_moved, errors))
        # A mass that hangs on the panel follows what is steady.
        moved[[a.inertial for a in actuators]] = 0.0
    yielding = np.abs(panel.gap_change([SLOW_HZ])[0]).T
    rails = [min(other.max_voltage for other in actuators[i % 2 :: 2]) for i in range(count)]
    taken = np.array([ON * VACUUM_PERMITTIVITY_F_PER_M * a.electrode_area * v**2 / a.air_gap**3 for a, v in zip(actuators, rails)])
    part = (yielding @ taken).max()
    volts = np.array(rails) * (np.sqrt(HELD / part) if part > HELD else 1.0)
    gaps = np.array([a.air_gap for a in actuators])
    given = np.array([np.inf if a.stop is None else a.stop for a in actuators])

    def balance(stops):
        """The nearest place to the middle where press, pull and springs are in balance, or a stop: relaxed, from the middle on."""
        x = np.zeros(count)
        for _ in range(4000):
            pulls = np.array([_pull(a, v, own) for a, v, own in zip(actuators, volts, x)])
            wanted = np.minimum(moved + yielding @ pulls, np.minimum(stops, gaps))
            if np.abs(wanted - x).max() < 1e-10 * gaps.max():
                break
            x += 0.5 * (wanted - x)
        return x

    # Stops are missing one after the other, that of the mass that the press moves furthest first.
    stops = given.copy()
    while True:
        x = balance(stops)
        loose = np.isinf(stops) & (x > TRAVEL_PART * gaps)
        if not loose.any():
            break
        i = np.where(loose, moved / gaps, -np.inf).argmax()
        stops[i] = TRAVEL_PART * gaps[i]
    kinds = ["given" if np.isfinite(own) else "assumed" if np.isfinite(stop) else "none" for own, stop in zip(given, stops)]
    return [Sag(*values) for values in zip(moved, error, x, stops, kinds)]


def softening_growth(actuator, sag):
    """How many times as much the electrodes take of the springs under the press as at rest: by differences of their pull where the
    springs hold the mass; where a stop does, what they pull over what such springs would bring back."""
    rest = 1e-5 * actuator.air_gap
    slope = lambda x: (_pull(actuator, 1.0, x + rest) - _pull(actuator, 1.0, x - rest)) / (2 * rest)
    x = min(sag.sag, 0.95 * actuator.air_gap)
    return slope(x) / slope(0.0) if sag.sag < sag.stop else _pull(actuator, 1.0, x) / x / slope(0.0)
