"""Panels that are off against scaling laws, and against layers that are off one by one."""

import unittest
from dataclasses import replace

import numpy as np

from ..reference.laminate import Laminate
from ..reference.off import off
from ..reference.panel import Panel
from ..reference.scene import Edge, Patch, Support
from .test_layers import layer
from .test_panel import bar, plate


class Off(unittest.TestCase):
    """What each kind does."""

    def test_frequencies_go_with_thickness_and_the_root_of_stiffness(self):
        edges = tuple(Edge(side, "pinned") for side in ("left", "right", "top", "bottom"))
        patch = Patch(0.05, 0.1, 0.1, 0.08, 0.003, plate().material)
        scene = plate(edges=edges, patches=(patch,))
        wanted = Panel(scene, 400.0).modes(400.0)[0]
        for panel, factor in (({"youngs_modulus": 1.21}, 1.1), ({"thickness": 0.9}, 0.9)):
            found = Panel(off(scene, panel), 440.0).modes(440.0)[0][: len(wanted)]
            self.assertLess(np.abs(found / wanted - factor).max(), 1e-6)

    def test_a_laminate_is_off_as_its_layers_are(self):
        layers = [layer(0.4), layer(1.1, angle_deg=90, loss_factor=0.1), layer(0.7, bond="slips")]
        scene = replace(plate(), laminate=Laminate.of(layers, False))
        thicker = [replace(own, thickness=0.93 * own.thickness, ex=1.2 * own.ex, ey=1.2 * own.ey, g=1.2 * own.g) for own in layers]
        found, wanted = off(scene, {"youngs_modulus": 1.2, "thickness": 0.93}).laminate, Laminate.of(thicker, False)
        for key in ("thickness", "weight", "bending", "loss_factor"):
            np.testing.assert_allclose(getattr(found, key), getattr(wanted, key), rtol=1e-9)

    def test_springs_and_places(self):
        supports = (Support(0.0, 0.01, 100.0, 0.3, 2.0), Support(0.25, 0.01, 200.0))
        scene = bar(supports=supports, edges=(Edge("left", "elastic", 50.0, 3.0), Edge("right", "clamped")))
        told = {"springs": {"supports": [0.5, 2.0], "edges": [3.0, 1.0]}, "places_mm": {"supports": [[10.0, 99.0], [250.00000000000003, 10.0]]}}
        found = off(scene, told)
        self.assertEqual(found.supports, (Support(0.01, 0.01, 50.0, 0.3, 1.0), Support(0.25, 0.01, 400.0)))
        self.assertEqual(found.edges, (Edge("left", "elastic", 150.0, 9.0), Edge("right", "clamped")))
        with self.assertRaises(ValueError):
            off(scene, {"springs": {"supports": [0.5], "edges": [3.0, 1.0]}})


if __name__ == "__main__":
    unittest.main()
