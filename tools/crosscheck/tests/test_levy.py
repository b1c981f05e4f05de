"""The exact solution of plates with two pinned sides against closed equations, converged values, and the reference's own finite elements."""

import unittest

import numpy as np

from ..reference.levy import Levy
from ..reference.panel import Panel
from ..reference.scene import Actuator, Damping, Edge, Material, PointMass, Scene, Support

E, RHO, NU, H = 70e9, 2700.0, 0.3, 0.002
RIGIDITY = E * H**3 / (12 * (1 - NU**2))


def pinned(*sides):
    return tuple(Edge(side, "pinned") for side in sides)


ALL_ROUND = pinned("left", "right", "top", "bottom")


def plate(a=0.3, b=0.3, **parts):
    """A plate of E, RHO and H."""
    return Scene("test", "plate", a, b, H, Material(E, RHO, NU), **parts)


def era(x, y, mass, stiffness, mount="inertial", damping=0.0):
    """An ERA of which only the mechanics matter."""
    return Actuator("a", x, y, mount, mass, stiffness, damping, 0.0, 1e-3, 5e-4, 1000.0)


def hz(factor, a=0.3):
    """lambda = omega a^2 sqrt(rho h / D)."""
    return factor / (2 * np.pi * a * a) * np.sqrt(RIGIDITY / (RHO * H))


class Frequencies(unittest.TestCase):
    def near(self, scene, factor, tolerance):
        self.assertLess(abs(Levy(scene).mode_near(hz(factor) * (1 + 1e-5)) / hz(factor) - 1), tolerance)

    def test_pinned_plates_with_a_spring_or_a_sprung_mass_in_the_middle(self):
        for stiffness, factor in ((100.0, 27.208098121), (1e12, 52.618507381)):
            self.near(plate(edges=ALL_ROUND, supports=(Support(0.15, 0.15, stiffness * RIGIDITY / 0.09),)), factor, 1e-9)
        mass = 0.1 * RHO * H * 0.09
        scene = plate(edges=ALL_ROUND, actuators=(era(0.15, 0.15, mass, 100 * RIGIDITY / 0.09),))
        for factor in (15.811037734, 36.874487505):
            self.near(scene, factor, 1e-9)

    def test_levys_plates_by_the_poles_of_their_receptance(self):
        for kind, factors in (("clamped", (28.95085037, 54.74307075)), (None, (9.63138487, 16.13477702))):
            for own, others in ((("left", "right"), ("top", "bottom")), (("top", "bottom"), ("left", "right"))):
                edges = pinned(*own) + (tuple(Edge(side, kind) for side in others) if kind else ())
                panel = Levy(plate(edges=edges))
                for factor in factors:
                    below, above = (panel.receptance(2 * np.pi * hz(factor) * (1 + part), [(0.1, 0.07)], False)[0, 0] for part in (-1e-8, 1e-8))
                    self.assertTrue(below > 0 > above, f"{kind} {factor}: {below} {above}")

    def test_a_mean_that_is_held_is_nothing(self):
        """Stiffer and stiffer air leaves motions without a mean, as elements do."""
        for depth, bound in ((1e-3, 2e-2), (1e-6, 2e-5)):
            scene = plate(a=0.3, b=0.2, edges=pinned("left", "right"), masses=(PointMass(0.11, 0.07, 0.05),), sealed_depth=depth)
            panel = Levy(scene)
            bare, alone = panel.receptance(2 * np.pi * 90.0, panel.functionals, False), scene.air_stiffness
            held = np.diag([0.0, alone])
            coupled = np.linalg.solve(np.eye(2) + bare @ held, bare)
            self.assertLess(abs(coupled[1, 0]), bound * abs(bare[1, 0]))


class Receptances(unittest.TestCase):
    def test_naviers_series(self):
        a, b, at, point = 0.3, 0.2, (0.113, 0.041), (0.121, 0.052)
        omega = 2 * np.pi * 50.0
        m, n = np.meshgrid(np.arange(1, 1500), np.arange(1, 1500), indexing="ij")
        stiffness = RIGIDITY * np.pi**4 * ((m / a) ** 2 + (n / b) ** 2) ** 2 - omega**2 * RHO * H
        shape = lambda place: np.sin(m * np.pi * place[0] / a) * np.sin(n * np.pi * place[1] / b)
        mean = (1 - np.cos(m * np.pi)) / (m * np.pi) * (1 - np.cos(n * np.pi)) / (n * np.pi)
        series = lambda one, other: 4 / (a * b) * (one * other / stiffness).sum()
        found = Levy(plate(a=a, b=b, edges=ALL_ROUND)).receptance(omega, [at, point, "mean"], False)
        for (i, j), one, other, off in (((0, 1), shape(at), shape(point), 1e-11), ((0, 0), shape(at), shape(at), 1e-6), ((0, 2), shape(at), mean, 1e-11), ((2, 2), mean, mean, 1e-11)):
            self.assertLess(abs(found[i, j] / series(one, other) - 1), off)

    def test_elements_agree_with_everything_there_is(self):
        """With losses of every kind, springs along an edge, air, ERAs of both mounts: to what the elements are right to."""
        for damping in (Damping("loss_factor", loss_factor=0.02), Damping("rayleigh", rayleigh_alpha=5.0, rayleigh_beta=2e-5)):
            edges = (*pinned("top", "bottom"), Edge("left", "elastic", 3e4, 20.0, 0.3), Edge("right", "clamped"))
            scene = plate(
                a=0.26, b=0.17, edges=edges, damping=damping, sealed_depth=0.0075, added_mass=0.4,
                supports=(Support(0.07, 0.05, 3e4, 2.0, loss_factor=0.2),), masses=(PointMass(0.2, 0.12, 0.03),),
                actuators=(era(0.15, 0.06, 0.01, 6e3, "grounded", 0.5), era(0.05, 0.11, 0.02, 9e3, "inertial", 0.7)),
            )
            elements, frequencies, place = Panel(scene, 400), np.arange(40.0, 400.0, 30.0), (0.12, 0.13)
            wanted = elements.accelerance([place], frequencies)[:, :, 0]
            own = elements.accelerance_error([place], frequencies)[:, :, 0].max(axis=0)
            found = Levy(scene).accelerance(place, frequencies)
            for k in range(2):
                peak = np.abs(wanted[:, k]).max()
                self.assertLess(np.abs(found[:, k] - wanted[:, k]).max(), own[k])
                self.assertLess(own[k], 1e-3 * peak)
            for frequency, error in zip(*[part[:3] for part in (elements.modes(400)[0], elements.mode_errors(400)[0])]):
                self.assertLess(abs(Levy(scene).mode_near(frequency) / frequency - 1), error)


if __name__ == "__main__":
    unittest.main()
