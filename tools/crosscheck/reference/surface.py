"""Quadrature over a panel's surface, over the 10 mm around a target and over the rest.

A bar is a line: its means are over its length. A plate's cut-outs are no surface.
"""

import numpy as np

TARGET_RADIUS_M = 10e-3


def _between(values, low, high):
    """Sorted distinct values within [low, high], ends included; nearer than a thousand-millionth of the whole is one."""
    found = [low]
    for value in sorted(v for v in values if low < v < high):
        if value - found[-1] > 1e-9 * (high - low):
            found.append(value)
    if high - found[-1] <= 1e-9 * (high - low):
        found.pop()
    return found + [high]


class Surface:
    """Points and weights that integrate |acceleration|^2 up to a highest frequency."""

    def __init__(self, scene):
        self.scene = scene
        attached = (*scene.actuators, *scene.supports, *scene.masses)
        # Lines at every border of a patch or cut-out and through every actuator, where fields are least smooth.
        areas = (*scene.patches, *scene.cutouts)
        xs = [a.x for a in areas] + [a.x + a.length for a in areas] + [a.x for a in attached]
        ys = [a.y for a in areas] + [a.y + a.width for a in areas] + [a.y for a in attached]
        self.xs = _between(xs, 0.0, scene.length)
        self.ys = [scene.width / 2] * 2 if scene.is_bar else _between(ys, 0.0, scene.width)
        self.cells = [
            (x0, x1, y0, y1)
            for x0, x1 in zip(self.xs, self.xs[1:])
            for y0, y1 in zip(self.ys, self.ys[1:])
            if not scene.in_cutout((x0 + x1) / 2, (y0 + y1) / 2)
        ]

    def wave_number(self, frequency_hz):
        """Largest wave number of free bending waves on any part of the surface, in rad/m."""
        scene = self.scene
        parts = [(scene.thickness, scene.material)] + [(p.thickness, p.material) for p in scene.patches]
        largest = 0.0
        for thickness, material in parts:
            rigidity = material.youngs_modulus_pa * thickness**3 / 12
            if not scene.is_bar:
                rigidity /= 1 - material.poisson_ratio**2
            largest = max(largest, material.density_kg_m3 * thickness / rigidity)
        return (largest * (2 * np.pi * frequency_hz) ** 2) ** 0.25

    def rule(self, max_hz, finer=1.0):
        """Points [n, 2] and weights (in m^2, for a bar in m) over the whole surface. `finer`: for moduli, which have kinks."""
        number = self.wave_number(max_hz)
        # Gauss: pi nodes per wave of cos(2 k x), which |field|^2 has, is k L; and some for near fields.
        count = lambda length: int(np.ceil(finer * (4 + number * length)))
        points, weights = [], []
        for x0, x1, y0, y1 in self.cells:
            x, wx = _gauss(x0, x1, count(x1 - x0))
            y, wy = (np.array([y0]), np.ones(1)) if self.scene.is_bar else _gauss(y0, y1, count(y1 - y0))
            points.append(np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2))
            weights.append(np.outer(wx, wy).ravel())
        return np.concatenate(points), np.concatenate(weights)

    def near(self, x, y, max_hz, radius=TARGET_RADIUS_M, but=()):
        """Points and weights over what lies within `radius` of a place, but not as near to any of the places `but`."""
        extra = int(np.ceil(self.wave_number(max_hz) * 2 * radius))
        points, weights = [np.zeros((0, 2))], [np.zeros(0)]
        for x0, x1, y0, y1 in self.cells:
            left, right = max(x0, x - radius), min(x1, x + radius)
            if left >= right:
                continue
            if self.scene.is_bar:
                for a, b in _without((left, right), [(px - radius, px + radius) for px, _ in but]):
                    px, wx = _gauss(a, b, 8 + extra)
                    points.append(np.stack([px, np.full_like(px, y0)], -1))
                    weights.append(wx)
                continue
            # Strips between the places where a circle crosses the cell's top and bottom or another one. In x = x_c - r cos(t)
            # the chord's length is smooth up to the circle's ends.
            crossings = []
            for px, py in ((x, y), *but):
                crossings += [px + side * np.sqrt(radius**2 - (edge - py) ** 2) for edge in (y0, y1) if abs(edge - py) < radius for side in (-1, 1)]
                crossings += [px - radius, px + radius]
                apart = np.hypot(px - x, py - y)
                if 0 < apart < 2 * radius:
                    half = np.sqrt(radius**2 - apart**2 / 4)
                    crossings += [(px + x) / 2 + side * half * (py - y) / apart for side in (-1, 1)]
            cuts = _between(crossings, left, right)
            for a, b in zip(cuts, cuts[1:]):
                low, high = (np.arccos(np.clip((x - end) / radius, -1, 1)) for end in (a, b))
                angles, turns = _gauss(low, high, 10 + extra)
                for angle, turn in zip(angles, turns):
                    half, at = radius * np.sin(angle), x - radius * np.cos(angle)
                    others = [(py, np.sqrt(max(radius**2 - (at - px) ** 2, 0.0))) for px, py in but]
                    for bottom, top in _without((max(y0, y - half), min(y1, y + half)), [(py - h, py + h) for py, h in others]):
                        py, wy = _gauss(bottom, top, 8 + extra)
                        points.append(np.stack([np.full_like(py, at), py], -1))
                        weights.append(wy * turn * radius * np.sin(angle))
        return np.concatenate(points), np.concatenate(weights)

    def near_any(self, places, max_hz):
        """The same within the targets' radius of any of some places, each point once."""
        parts = [self.near(*place, max_hz, but=places[:k]) for k, place in enumerate(places)]
        return [np.concatenate(part) for part in zip(*parts)]


def _without(whole, taken):
    """What is left of an interval without some others."""
    left = [whole]
    for low, high in taken:
        left = [part for a, b in left for part in ((a, min(b, low)), (max(a, high), b))]
        left = [(a, b) for a, b in left if a < b]
    return [(a, b) for a, b in left if a < b]


def _gauss(low, high, count):
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (low + high) / 2 + (high - low) / 2 * nodes, (high - low) / 2 * weights
