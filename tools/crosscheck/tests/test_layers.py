"""Layers against closed equations."""

import unittest

import numpy as np

from ..reference.laminate import Laminate, Layer, read
from ..reference.panel import Panel
from ..reference.scene import Edge, Scene, parse

BIRCH = {"ex_pa": 15.1e9, "ey_pa": 0.8e9, "g_pa": 0.73e9, "poisson_ratio": 0.43, "density_kg_m3": 640.0}


def layer(thickness_mm, **more):
    """One of birch."""
    return read({"thickness_mm": thickness_mm, "material": BIRCH} | more)


class Stacks(unittest.TestCase):
    """D and weight."""

    def same(self, a, b, part=1e-12):
        self.assertLess(np.abs(np.subtract(a, b)).max(), part * max(b))

    def test_one_layer(self):
        ex, ey, g, nu = (BIRCH[key] for key in ("ex_pa", "ey_pa", "g_pa", "poisson_ratio"))
        wanted = np.array([ex, nu * ey, ey, g * (1 - nu**2 * ey / ex)]) / (1 - nu**2 * ey / ex) * 0.0021**3 / 12
        self.same(Laminate.of([layer(2.1)], False).bending, wanted)
        three = [layer(0.3), layer(1.3), layer(0.5)]
        self.same(Laminate.of(three, False).bending, wanted)
        self.same(Laminate.of([layer(1.05), layer(1.05, bond="slips")], False).bending, wanted / 4)
        self.same(Laminate.of([layer(2.1, angle_deg=90)], False).bending, wanted[[2, 1, 0, 3]])

    def test_a_pair_about_its_neutral_plane(self):
        # D - B A^-1 B of a stack that is not symmetrical, in one direction: a bar.
        below, above = layer(0.9), layer(1.3, angle_deg=90)
        (ea, ha), (eb, hb) = (15.1e9, 0.9e-3), (0.8e9, 1.3e-3)
        wanted = (ea * ha**3 + eb * hb**3) / 12 + ea * ha * eb * hb / (ea * ha + eb * hb) * ((ha + hb) / 2) ** 2
        for pair in ([below, above], [above, below]):
            self.assertAlmostEqual(Laminate.of(pair, True).bending[0] / wanted, 1, delta=1e-12)

    def test_loss_goes_with_energy(self):
        layers = [layer(1.0), layer(1.0, loss_factor=0.27), layer(1.0)]
        self.assertAlmostEqual(Laminate.of(layers, False).loss_factor, 0.01, delta=1e-9)


class Frequencies(unittest.TestCase):
    """Of plates with axes."""

    def test_simply_supported(self):
        a, b, plies = 0.437, 0.291, [Layer(0.0037, 15.1e9, 0.8e9, 0.73e9, 0.43, 640.0)]
        laminate = Laminate.of(plies, False)
        edges = tuple(Edge(side, "pinned") for side in ("left", "right", "top", "bottom"))
        template = parse(TEXT)
        scene = Scene("test", "plate", a, b, 0.0037, template.material, edges=edges, laminate=laminate)
        d11, d12, d22, d66 = laminate.bending
        square = lambda m, n: d11 * (m / a) ** 4 + 2 * (d12 + 2 * d66) * (m * n / a / b) ** 2 + d22 * (n / b) ** 4
        wanted = sorted(np.pi / 2 * np.sqrt(square(m, n) / laminate.weight) for m in range(1, 20) for n in range(1, 20))
        panel = Panel(scene, 500.0)
        found, own = panel.modes(400.0)[0], panel.mode_errors(400.0)[0]
        self.assertGreater(len(found), 5)
        for k, hz in enumerate(found):
            self.assertLess(abs(hz / wanted[k] - 1), own[k] + 1e-9)
            self.assertLess(own[k], 1e-3)


TEXT = """
version = 1
name = "birch"
[surface]
kind = "plate"
length_mm = 437
width_mm = 291
[[layer]]
thickness_mm = 3.7
[layer.material]
ex_pa = 15.1e9
ey_pa = 0.8e9
g_pa = 0.73e9
poisson_ratio = 0.43
density_kg_m3 = 640
"""
