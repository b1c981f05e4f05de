"""The reference's own panel against closed equations and converged values (the comparison needs something to stand on)."""

import unittest

import numpy as np

from ..reference.panel import Panel
from ..reference.scene import Actuator, Edge, Material, PointMass, Scene, Support

E, RHO, NU = 70e9, 2700.0, 0.3


def era(x, y, mass, stiffness, mount="inertial", damping=0.0):
    """An ERA of which only the mechanics matter."""
    return Actuator("a", x, y, mount, mass, stiffness, damping, 0.0, 1e-3, 5e-4, 1000.0)


def plate(a=0.3, b=0.3, h=0.002, nu=NU, **parts):
    """A plate of E and RHO."""
    return Scene("test", "plate", a, b, h, Material(E, RHO, nu), **parts)


def bar(**parts):
    """A bar of 250 x 20 x 2 mm."""
    return Scene("test", "bar", 0.25, 0.02, 0.002, Material(E, RHO), **parts)


def rigidity(h=0.002, nu=NU):
    """D of a plate."""
    return E * h**3 / (12 * (1 - nu**2))


class Frequencies(unittest.TestCase):
    """Undamped frequencies as factors of the textbook's scale."""

    def held(self, scene, scale_hz, wanted, tolerance, skip=0):
        top = max(wanted) * scale_hz
        panel = Panel(scene, top * 1.05)
        found = panel.modes(top * 1.05)[0]
        own = panel.mode_errors(top * 1.05)[0]
        found, own = found[skip:], own[skip:]
        # Values that are quoted twice are to be found twice.
        for k, value in enumerate(sorted(wanted)):
            error = abs(found[k] / scale_hz / value - 1)
            self.assertLess(error, tolerance, f"{found[k] / scale_hz} for {value}")
            self.assertLess(error, own[k] + 1e-9, f"{found[k] / scale_hz} for {value}: more than its own estimate")

    def bar_held(self, scene, wanted, **more):
        scale = np.sqrt(E * 0.002**2 / 12 / RHO) / (2 * np.pi * 0.25**2)
        self.held(scene, scale, [w * w for w in wanted], 1e-6, **more)

    def test_bars(self):
        ei, mass = E * 0.02 * 0.002**3 / 12, RHO * 0.02 * 0.002 * 0.25
        y = 0.01
        self.bar_held(bar(), [4.730040745, 7.853204624, 10.99560784], skip=2)
        self.bar_held(bar(edges=(Edge("left", "clamped"),)), [1.875104069, 4.694091133, 7.854757438])
        self.bar_held(bar(edges=(Edge("left", "clamped"), Edge("right", "pinned"))), [3.926602312, 7.068582746])
        k = 10 * ei / 0.25**3
        self.bar_held(bar(supports=(Support(0, y, k), Support(0.25, y, k))), [2.03234135617, 2.76660910601])
        self.bar_held(bar(edges=(Edge("left", "elastic", k), Edge("right", "elastic", k))), [2.03234135617, 2.76660910601])
        self.bar_held(bar(edges=(Edge("left", "clamped"),), masses=(PointMass(0.25, y, mass),)), [1.24791740961, 4.03113943672])
        sprung = bar(edges=(Edge("left", "pinned"), Edge("right", "pinned")), actuators=(era(0.125, y, 0.1 * mass, k),))
        self.bar_held(sprung, [2.8181164149, 3.5225723288, 2 * np.pi, 9.4308335491])

    def test_slow_modes_of_fine_meshes(self):
        # Meshes for 1 kHz and more: what rounding takes from 2 Hz is part of the own error.
        for length, thickness in ((2.965, 0.045), (2.71, 0.021), (3.3, 0.0605)):
            scene = Scene("test", "bar", length, 0.2, thickness, Material(9.8e9, 1100.0), edges=(Edge("left", "clamped"),))
            scale = np.sqrt(9.8e9 * thickness**2 / 12 / 1100.0) / (2 * np.pi * length**2)
            for max_hz in (1000.0, 1700.0, 2600.0):
                panel = Panel(scene, max_hz)
                found, own = panel.modes(50.0)[0], panel.mode_errors(50.0)[0]
                for k, value in enumerate((1.8751040687119611, 4.694091132974174, 7.854757438237613)):
                    error = abs(found[k] / scale / value**2 - 1)
                    self.assertLess(error, own[k], f"{length} m, {max_hz} Hz, mode {k + 1}")
                    self.assertLess(own[k], 1e-4)

    def plate_held(self, scene, wanted, tolerance, **more):
        scale = np.sqrt(rigidity(nu=scene.material.poisson_ratio) / (RHO * 0.002)) / (2 * np.pi * scene.length**2)
        self.held(scene, scale, wanted, tolerance, **more)

    def test_edges(self):
        every = lambda kind: tuple(Edge(side, kind) for side in ("left", "right", "top", "bottom"))
        self.plate_held(plate(edges=every("pinned")), [np.pi**2 * s for s in (2, 5, 5, 8)], 1e-5)
        self.plate_held(plate(edges=every("clamped")), [35.98519112, 73.39384552, 73.39384552, 108.21650169], 1e-5)
        self.plate_held(plate(), [13.46819735, 19.59613736, 24.27020089, 34.80089101, 34.80089101], 1e-5, skip=3)
        self.plate_held(plate(b=0.12), [21.45394343, 32.98900231, 59.62873002], 1e-5, skip=3)
        mixed = (Edge("left", "pinned"), Edge("right", "pinned"), Edge("top", "clamped"), Edge("bottom", "clamped"))
        self.plate_held(plate(edges=mixed), [28.95085037, 54.74307075], 1e-5)

    def test_points(self):
        d, mass = rigidity(), RHO * 0.002 * 0.09
        corners = lambda k: tuple(Support(x, y, k * d / 0.09) for x in (0, 0.3) for y in (0, 0.3))
        self.plate_held(plate(supports=corners(1)), [1.929823781, 3.394616509, 3.394616509], 2e-5)
        self.plate_held(plate(supports=corners(100)), [6.723500649, 14.51720474, 14.51720474], 2e-5)
        stiff = [7.110883662, 15.77024003, 15.77024003, 19.59613736, 38.43154033]
        self.plate_held(plate(supports=corners(1e12)), stiff, 2e-5)
        pinned = tuple(Edge(side, "pinned") for side in ("left", "right", "top", "bottom"))
        sprung = plate(edges=pinned, actuators=(era(0.15, 0.15, 0.1 * mass, 100 * d / 0.09),))
        self.plate_held(sprung, [15.811037734, 36.874487505], 2e-5)
        centre = lambda k: plate(edges=pinned, supports=(Support(0.15, 0.15, k * d / 0.09),))
        # The next two of each are the untouched pair.
        self.plate_held(centre(100), [27.208098121, 5 * np.pi**2, 5 * np.pi**2], 2e-5)
        self.plate_held(centre(1e13), [5 * np.pi**2, 5 * np.pi**2, 52.618507381], 2e-5)


class Air(unittest.TestCase):
    """Sealed air behind a panel: a spring on its mean deflection."""

    def test_piston(self):
        scene = plate(a=0.7, b=0.4, h=0.1, sealed_depth=0.02, added_mass=27.0)
        panel = Panel(scene, 300)
        hz = panel.modes(300)[0]
        wanted = np.sqrt(1.4 * 101325.0 / 0.02 / (RHO * 0.1 + 27.0)) / (2 * np.pi)
        self.assertEqual((panel.rigid_modes(), list(hz[:2])), (2, [0.0, 0.0]))
        self.assertAlmostEqual(hz[2] / wanted, 1, delta=1e-3)

    def test_pinned_plate_by_its_secular_equation(self):
        a, b, depth = 0.3, 0.2, 0.02
        pinned = tuple(Edge(side, "pinned") for side in ("left", "right", "top", "bottom"))
        found = Panel(plate(a=a, b=b, edges=pinned, sealed_depth=depth), 900).modes(900)[0]
        m, n = np.meshgrid(np.arange(1, 400), np.arange(1, 400), indexing="ij")
        own = np.pi**2 * ((m / a) ** 2 + (n / b) ** 2) * np.sqrt(rigidity() / (RHO * 0.002))
        mean = np.where((m % 2) * (n % 2) == 1, 8 / (np.pi**2 * m * n), 0.0) / np.sqrt(RHO * 0.002 * a * b)
        stiffness = 1.4 * 101325.0 * a * b / depth
        odd = mean != 0
        for hz in found:
            omega = 2 * np.pi * hz
            still = np.abs(own[~odd] / omega - 1).min()
            # Zero at a frequency that is off by a part d: d omega times the slope.
            value = 1 + stiffness * (mean[odd] ** 2 / (own[odd] ** 2 - omega**2)).sum()
            slope = stiffness * (mean[odd] ** 2 * 2 * omega**2 / (own[odd] ** 2 - omega**2) ** 2).sum()
            self.assertLess(min(still, abs(value / slope)), 1e-5, f"{hz} Hz")
        self.assertGreater(len(found), 4)


class Losses(unittest.TestCase):
    """Springs that lose a part of their energy."""

    def test_rigid_panels_have_half_the_loss_factor(self):
        turning = Support(0.18, 0.01, 1e4, rotational_stiffness=100.0, loss_factor=0.34)
        thick = dict(length=0.2, width=0.02, thickness=0.05, material=Material(E, RHO))
        scenes = [Scene("test", "bar", supports=(Support(0, 0.01, 2e4, loss_factor=0.34), turning), **thick)]
        edges = (Edge("top", "elastic", 1e5, 100.0, 0.34), Edge("right", "elastic", 2e5, 0.0, 0.34))
        scenes.append(plate(a=0.2, b=0.2, h=0.05, edges=edges))
        for scene in scenes:
            hz, ratios = Panel(scene, 400).modes(400)
            self.assertGreater(len(hz), 1)
            np.testing.assert_allclose(ratios, 0.17, rtol=2e-3)

    def test_at_one_frequency_they_are_dashpots(self):
        hz, k, eta = 143.0, 6e3, 0.45
        places = ((0.0, 0.0), (0.3, 0.02), (0.1, 0.2))
        own = dict(a=0.3, b=0.2, actuators=(era(0.07, 0.1, 0.0, 0.0, "grounded"),))
        rubber = plate(supports=tuple(Support(x, y, k, loss_factor=eta) for x, y in places), **own)
        dashpots = plate(supports=tuple(Support(x, y, k, k * eta / (2 * np.pi * hz)) for x, y in places), **own)
        one, other = (Panel(scene, 400).accelerance([(0.21, 0.05)], [hz, 2 * hz]) for scene in (rubber, dashpots))
        np.testing.assert_allclose(one[0], other[0], rtol=1e-9)
        self.assertGreater(abs(one[1] - other[1]).max(), 0.01 * abs(one[1]).max())


class Static(unittest.TestCase):
    """Deflection under a point load."""

    def test_centre_load_of_a_pinned_plate(self):
        pinned = tuple(Edge(side, "pinned") for side in ("left", "right", "top", "bottom"))
        panel = Panel(plate(edges=pinned, actuators=(era(0.15, 0.15, 0.0, 0.0, "grounded"),)), 300)
        low = 1e-2
        acceleration = panel.accelerance([(0.15, 0.15)], [low])[0, 0, 0]
        deflection = -acceleration.real / (2 * np.pi * low) ** 2
        self.assertAlmostEqual(deflection / (0.011600839772 * 0.09 / rigidity()), 1, delta=1e-5)

    def test_off_centre_load_by_naviers_series(self):
        a, b, at, point = 0.3, 0.2, (0.113, 0.041), (0.121, 0.052)
        pinned = tuple(Edge(side, "pinned") for side in ("left", "right", "top", "bottom"))
        panel = Panel(plate(a=a, b=b, edges=pinned, actuators=(era(*at, 0.0, 0.0, "grounded"),)), 400)
        m, n = np.meshgrid(np.arange(1, 1500), np.arange(1, 1500), indexing="ij")
        shape = lambda x, y: np.sin(m * np.pi * x / a) * np.sin(n * np.pi * y / b)
        series = 4 / (a * b) * shape(*at) * shape(*point) / (rigidity() * np.pi**4 * ((m / a) ** 2 + (n / b) ** 2) ** 2)
        low = 1e-2
        acceleration = panel.accelerance([point], [low])[0, 0, 0]
        self.assertAlmostEqual(-acceleration.real / (2 * np.pi * low) ** 2 / series.sum(), 1, delta=2e-5)


if __name__ == "__main__":
    unittest.main()
