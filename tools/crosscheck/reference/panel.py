"""What the reference says about a scene's panel, and how far it may itself be off.

Two meshes, cells 1.5 times smaller on the finer one: answers are those of the finer, and their difference from the coarser
is the reference's estimate of its own error. (Cubic Hermite cells converge with h^4, next to cut-outs with h^1.3 or so on
graded cells, which the finer mesh also has more of towards corners; with h^4 the finer mesh is off by a quarter of the difference, so that the estimate is on the safe side.)
"""

from functools import cached_property

import numpy as np

from .free import free_motions, free_of_surface
from .reduced import Reduced

# How much finer the second mesh is.
REFINEMENT = 1.5
# Of the difference of the two meshes. Measured on 24 random scenes against a third mesh, cells 1.5 times smaller again: the finer
# mesh was off by 0.25 of the difference where h^4 rules and by up to 0.8 at stiff points and held corners, curve by curve.
SAFETY = 1.5
# The same with cut-outs, whose corners converge slowest: 1.7 of the difference.
CUTOUT_SAFETY = 4.0
# Two meshes may agree by chance (7 times closer than to what finer ones tend to was seen, for one point): what a third one says, whose cells are larger by
# this, counts too, as far as its difference shrinks from mesh to mesh where h^4 rules.
SHRINKS = REFINEMENT**4
# Even so: a plate's estimate is at least this, relative to a frequency or to a curve's largest magnitude.
FLOOR = 2e-6
# A bar's, whose nodes are exact for what stands still.
BAR_FLOOR = 2e-8


class Panel:
    """A scene's panel for frequencies up to `max_hz`. Phasors are those of e^(+j w t), deflection toward the user."""

    def __init__(self, scene, max_hz, fineness=1.0):
        self.scene, self.max_hz, self.fineness = scene, float(max_hz), fineness

    @cached_property
    def fine(self):
        """The model that answers."""
        return Reduced(self.scene, self.max_hz, self.fineness * REFINEMENT, self.coarse)

    @property
    def floor(self):
        """The least that the reference's own error is taken for, relative."""
        return BAR_FLOOR if self.scene.is_bar else FLOOR

    @property
    def safety(self):
        """How often the difference of the two meshes is taken for the finer one's error."""
        return CUTOUT_SAFETY if self.scene.cutouts else SAFETY

    @cached_property
    def coarse(self):
        """The model that it is compared with."""
        return Reduced(self.scene, self.max_hz, self.fineness)

    @cached_property
    def coarser(self):
        """A third one, in case the two agree by chance; a bar needs none."""
        return self.coarse if self.scene.is_bar else Reduced(self.scene, self.max_hz, self.fineness / REFINEMENT)

    def finer(self):
        """The same with cells 1.5 times smaller: answers with a third mesh and is compared with this one's answers."""
        return Panel(self.scene, self.max_hz, self.fineness * REFINEMENT)

    # Modes.

    def surface_is_free(self):
        """Whether nothing resists some motion of the surface."""
        return free_of_surface(self.scene) > 0

    def rigid_modes(self):
        """How many motions nothing resists, counted from what holds the panel."""
        return free_motions(self.scene)

    def modes(self, max_hz):
        """Frequencies (Hz, rigid ones 0) and damping ratios of the modes up to `max_hz`."""
        return self._modes(self.fine, max_hz)

    def mode_errors(self, max_hz):
        """The reference's own error of each frequency and damping ratio of [`modes`], relative and absolute."""
        f, z = self._modes(self.fine, max_hz)
        g, y = self._modes(self.coarse, max_hz * 1.05)
        count = min(len(f), len(g))
        frequency, ratio = np.full(len(f), np.inf), np.full(len(f), np.inf)
        frequency[:count] = self.safety * np.abs(f[:count] - g[:count]) / np.maximum(f[:count], 1e-300)
        ratio[:count] = self.safety * np.abs(z[:count] - y[:count])
        # For a mode by itself two meshes may agree by chance: no estimate is below a third of the worst mode's.
        frequency = np.maximum(frequency, max(self.floor, frequency[:count].max(initial=0.0) / 3))
        # Two meshes are rounded differently: half of what that does to omega^2, and twice, as it is an estimate.
        rounding = self.fine.surface.rounding / np.maximum((2 * np.pi * f) ** 2, 1e-300)
        return frequency + rounding, ratio + self.floor

    def _modes(self, model, max_hz):
        omega, phi = model.modes()
        omega = omega.copy()
        omega[: self.rigid_modes()] = 0.0
        keep = omega <= 2 * np.pi * max_hz
        omega, phi = omega[keep], phi[:, keep]
        viscous = np.einsum("in,ij,jn->n", phi, model.viscous, phi, optimize=True)
        lossy = np.einsum("in,ij,jn->n", phi, model.hysteretic, phi, optimize=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(omega > 0, viscous / (2 * omega) + lossy / (2 * omega**2), 0.0)
        return omega / (2 * np.pi), ratio

    def shapes(self, model, points_m, max_hz):
        """Frequencies (Hz) of one of the two models' modes and their mass-normalised deflections [mode, point], kg^-1/2."""
        omega, phi = model.modes()
        keep = omega <= 2 * np.pi * max_hz
        return omega[keep] / (2 * np.pi), (model.output_rows(points_m) @ phi[:, keep]).T

    # Responses.

    def accelerance(self, points_m, frequencies_hz):
        """Acceleration at points per newton at each actuator alone: [frequency, actuator, point], m/s^2 per N."""
        return self._accelerance(self.fine, points_m, frequencies_hz)

    def accelerance_error(self, points_m, frequencies_hz):
        """The reference's own error of [`accelerance`], absolute, of the same shape."""
        fine, coarse, coarser = (
            self._accelerance(model, points_m, frequencies_hz) for model in (self.fine, self.coarse, self.coarser)
        )
        # Resonances that are off by the floor: much beside a sharp one.
        shifted = self._accelerance(self.fine, points_m, np.atleast_1d(frequencies_hz) * (1 + self.floor))
        least = np.maximum(np.abs(shifted - fine), self.floor * np.abs(fine).max(axis=0, keepdims=True))
        difference = np.maximum(np.abs(fine - coarse), np.abs(coarse - coarser) / SHRINKS)
        return np.maximum(self.safety * difference, least)

    def _accelerance(self, model, points_m, frequencies_hz):
        f = np.atleast_1d(np.asarray(frequencies_hz, dtype=float))
        rows = model.output_rows(points_m)
        answer = np.einsum("pn,fnk->fkp", rows, model.solve(f, model.forces), optimize=True) * model.lags(points_m)
        return -((2 * np.pi * f)[:, None, None] ** 2) * answer

    def gap_change(self, frequencies_hz):
        """Displacement of each moving mass against its electrodes: [frequency, loaded actuator, actuator], m per N."""
        return self._gap_change(self.fine, frequencies_hz)

    def gap_change_error(self, frequencies_hz):
        """The reference's own error of [`gap_change`], absolute."""
        fine, coarse = (self._gap_change(model, frequencies_hz) for model in (self.fine, self.coarse))
        return np.maximum(self.safety * np.abs(fine - coarse), self.floor * np.abs(fine).max(axis=0, keepdims=True))

    def _gap_change(self, model, frequencies_hz):
        f = np.atleast_1d(np.asarray(frequencies_hz, dtype=float))
        return np.einsum("an,fnk->fka", model.gaps, model.solve(f, model.forces), optimize=True)

    # Time.

    def time_model(self, max_hz, points_m):
        """A reduced model for integration in time, of the modes up to `max_hz` and the static shapes of the rest.

        `M`, `C`, `K` [n, n] with the moving masses in them; `forces` [n, actuator] for 1 N (the pair, for inertial mounts);
        `points` [point, n] deflection in m; `gaps` [actuator, n] travel of each mass against its electrodes in m.
        Hysteretic loss, `H` (K + j H), is stood in for in `C` by the viscous damping that loses as much at each mode's own resonance, the coupling of
        two modes by the geometric mean of their frequencies: C_mn = eta phi_m^T K_surface phi_n / sqrt(omega_m omega_n).
        """
        model = self.fine
        omega, phi = model.modes()
        omega = omega.copy()
        omega[: self.rigid_modes()] = 0.0
        keep = omega <= 2 * np.pi * max_hz
        phi, omega = phi[:, keep], omega[keep]
        root = np.where(omega > 0, 1 / np.sqrt(np.maximum(omega, 1e-300)), 0.0)
        hysteretic = phi.T @ model.hysteretic @ phi
        damping = phi.T @ model.viscous @ phi + hysteretic * np.outer(root, root)
        return {
            "M": np.eye(len(omega)),
            "C": damping,
            "K": np.diag(omega**2),
            "H": hysteretic,
            "forces": phi.T @ model.forces,
            "points": model.output_rows(points_m) @ phi,
            "gaps": model.gaps @ phi,
            "omega": omega,
        }
