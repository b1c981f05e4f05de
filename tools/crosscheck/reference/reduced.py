"""A panel in a few hundred coordinates: modes of the bare surface, static shapes of its attachments, and the attachments.

The basis is made of the bare surface's modes below a multiple of the highest frequency and, for every attachment, the
Krylov vectors (K - s M)^-1 b, (K - s M)^-1 M (K - s M)^-1 b, ... about a negative shift s, which hold what the modes left
out. Everything is then projected (Rayleigh-Ritz). Attachments couple through their points only.

Coordinates y: Ritz coordinates of the surface; amplitudes of the local compliance (see `plate.Local`); moving masses of
inertial ERAs.
"""

from collections import defaultdict

import numpy as np
import scipy.linalg as la
from scipy.sparse.linalg import LinearOperator, eigsh

from .bar import Bar
from .free import free_motions
from .mesh import factor
from .plate import SMALL, Plate

# Modes of the bare surface are kept up to this multiple of the highest frequency asked for.
KEEP = 1.7
# From so many modes on they are looked for on a coarser mesh first.
MANY = 150
# Krylov vectors of each attachment: what is left at the top of the band is about KEEP^(-2 KRYLOV), some 5e-3, of a part of the response;
# panels are made for harmonics up to 1 kHz, which are held to percents, and at 400 Hz it is 5e-7.
KRYLOV = 5
# The same of the forces of springs along edges. Those are left out that are below 10^-4 of the largest on a mesh of fineness 1, 10^-6 on
# one of 1.5, so that the difference of two meshes shows what that does.
EDGE_KRYLOV = 3
EDGE_DIGITS = 4.0
# A spring this much stiffer than the surface at its point is as good as rigid: the error is its inverse, but for the point's own motion.
RIGID = 1e8


def modes(surface, total, solver, shift, limit, count, known=None):
    """As [`Reduced._modes`]; `total` is the stiffness and `solver` that of `total` - `shift` mass, `known` a coarser surface and its basis.

    On large meshes they are found on a coarser one first. What these lack is of much higher modes, which a step of inverse iteration
    takes away; Rayleigh-Ritz, which follows, does the rest.
    """
    if known is None and count > MANY and (coarse := surface.coarser()) is not None:
        stiffness = coarse.stiffness + coarse.edge_stiffness
        known = coarse, modes(coarse, stiffness, factor(stiffness - shift * coarse.mass), shift, limit, count)
    if known is not None:
        coarse, found = known
        return _orthonormalised(surface.mass, solver.solve(surface.mass @ (surface.from_coarser(coarse) @ found)))
    while count < surface.size - 1:
        inverse = LinearOperator(total.shape, matvec=solver.solve)
        start = np.random.default_rng(1).standard_normal(surface.size)
        values, vectors = eigsh(total, k=count, M=surface.mass, sigma=shift, OPinv=inverse, v0=start, tol=1e-10)
        # Some more than asked for stay with it, as a finer mesh has more below the limit.
        if values.max() > limit:
            return vectors
        count = int(1.4 * count)
    values, vectors = la.eigh(total.toarray(), surface.mass.toarray())
    return vectors[:, : max(1, int((values <= limit).sum()))]


def _orthonormalised(mass, vectors):
    """The same span, orthonormal in the mass: twice, as once leaves what rounding in the products is times their condition."""
    for _ in range(2):
        vectors = vectors / np.sqrt(np.einsum("ij,ij->j", vectors, mass @ vectors))
        product = vectors.T @ (mass @ vectors)
        vectors = la.solve_triangular(la.cholesky((product + product.T) / 2), vectors.T, trans="T").T
    return np.ascontiguousarray(vectors)


class Reduced:
    """The scene's panel on one mesh.

    Matrices over the coordinates: `mass`, `surface_stiffness` (the surface's own, with the local compliance), `edge_stiffness`,
    `spring_stiffness` (supports, ERAs, sealed air), `losses` (stiffness of edges and supports times their loss factors), `surface_mass`, `dashpots`. `forces` has a column per actuator (1 N), `gaps` a
    row per actuator (travel of the mass against its electrodes). `coarser`, the same on larger cells, saves it the search for modes.
    """

    def __init__(self, scene, max_hz, fineness, coarser=None):
        self.scene, self.max_hz, self.fineness = scene, max_hz, fineness
        self.free_motions = free_motions(scene)
        self.shift = -((2 * np.pi * 0.25 * max_hz) ** 2)
        attached = list(scene.supports) + list(scene.masses) + list(scene.actuators)
        self.points = sorted({(item.x, item.y) for item in attached})
        if scene.is_bar:
            self.surface = Bar(scene, max_hz, fineness, self.points)
        else:
            self.surface = Plate(scene, max_hz, fineness, self.shift)
        self._basis(coarser and (coarser.surface, coarser.bare))
        self._attach()

    # The bare surface.

    def _basis(self, known):
        surface = self.surface
        total = surface.stiffness + surface.edge_stiffness
        solver = factor(total - self.shift * surface.mass)
        self.bare = vectors = self._modes(total, solver, known)
        turning = [support for support in self.scene.supports if support.rotational_stiffness > 0]
        self.turning_rows = [row for support in turning for row in surface.slope_rows((support.x, support.y))]
        self.turning_springs = [(s.rotational_stiffness, s.loss_factor) for s in turning for _ in range(1 if self.scene.is_bar else 2)]
        rows = [surface.rows(self.points).toarray()] if self.points else []
        rows += [row.toarray() for row in self.turning_rows]
        if self.scene.air_stiffness > 0:
            rows += [surface.mean_row[None]]
        block = np.vstack(rows).T if rows else np.zeros((surface.size, 0))
        solutions = solver.solve(np.ascontiguousarray(block[:, : len(self.points)])) if self.points else block
        self.local = surface.local(self.points, solutions)
        krylov = self._krylov(solver, block, KRYLOV) + self._krylov(solver, self._edge_loads(vectors), EDGE_KRYLOV)
        if krylov:
            vectors = self._orthonormal(vectors, np.hstack(krylov))
        stiffness = vectors.T @ (total @ vectors)
        mass = vectors.T @ (surface.mass @ vectors)
        # Against K - s M, so that stiff shapes do not blur soft ones.
        theta, turn = la.eigh((mass + mass.T) / 2, (stiffness + stiffness.T) / 2 - self.shift * mass)
        keep = theta > 1e-13 * theta.max()
        theta, turn = theta[keep][::-1], turn[:, keep][:, ::-1]
        self.ritz = self.shift + 1 / theta
        self.shapes = vectors @ (turn / np.sqrt(theta))
        edge = self.shapes.T @ (surface.edge_stiffness @ self.shapes)
        self.edge_reduced = (edge + edge.T) / 2
        loss = self.shapes.T @ (surface.edge_loss @ self.shapes)
        self.edge_loss_reduced = (loss + loss.T) / 2

    def _krylov(self, solver, block, count):
        """`count` blocks of Krylov vectors of loads [unknowns, load], each vector of length one."""
        mass, result = self.surface.mass, []
        for _ in range(count if block.shape[1] else 0):
            block = solver.solve(np.ascontiguousarray(block))
            block = block / np.maximum(np.sqrt(np.einsum("ij,ij->j", block, mass @ block)), 1e-300)
            result.append(block)
            block = mass @ block
        return result

    def _edge_loads(self, modes):
        """Forces of the springs along edges, of which all modes' are sums: where the surface loses another part than they do, the two
        do not share their modes, and these are what the losses leave unbalanced. Of edges of several loss factors those of their
        losses as well."""
        edges, loss, damping = self.surface.edge_stiffness, self.surface.edge_loss, self.scene.damping
        if edges.nnz == 0 or damping.loss_factor == damping.rayleigh_beta == loss.nnz == 0:
            return np.zeros((self.surface.size, 0))
        forces = edges @ modes
        if loss.nnz > 0:
            lost = loss @ modes
            forces = np.hstack([forces, lost * (np.linalg.norm(forces) / np.linalg.norm(lost))])
        left, sizes, _ = np.linalg.svd(forces, full_matrices=False)
        return left[:, sizes > 10.0 ** (-EDGE_DIGITS * self.fineness) * sizes[0]]

    def _modes(self, total, solver, known):
        """A basis, orthonormal in the mass, that holds the bare surface's modes up to KEEP times the highest frequency."""
        surface, hz = self.surface, KEEP * self.max_hz
        if self.scene.is_bar and self.scene.damping.kind == "modal_ratio":
            # All that a bar's few unknowns span: modes of every frequency have the ratio, and those beside a firm support, far above the band, leave
            # 2e-4 of the losses' part to no Krylov vector.
            return modes(surface, total, solver, self.shift, np.inf, surface.size)
        known = None if surface.size < SMALL else known
        return modes(surface, total, solver, self.shift, (2 * np.pi * hz) ** 2, 12 + int(1.2 * surface.mode_count(hz)), known)

    def _orthonormal(self, modes, more):
        mass = self.surface.mass
        # All columns against the modes at once, twice, then one against another.
        for _ in range(2):
            more = more - modes @ (modes.T @ (mass @ more))
        result, count = np.empty_like(more), 0
        for column in more.T:
            size = 1.0
            for _ in range(3):
                own = result[:, :count]
                column = column - own @ (own.T @ (mass @ column))
                column = column - modes @ (modes.T @ (mass @ column))
                size = np.sqrt(max(column @ (mass @ column), 0.0))
                if size < 1e-9:
                    break
                column = column / size
            if size > 0.5:
                result[:, count] = column
                count += 1
        return np.hstack([modes, result[:, :count]])

    # What is attached to it.

    def _attach(self):
        scene, surface = self.scene, self.surface
        values, vectors = la.eigh(self.local.compliance) if self.points else (np.zeros(0), np.zeros((0, 0)))
        keep = values > 1e-9 * max(values.max(initial=0.0), 1e-300)
        series = vectors[:, keep] * np.sqrt(values[keep])
        # Amplitudes a of the local compliance back to the forces: E F = E U S^(-1/2) a.
        self.forces_of_amplitudes = vectors[:, keep] / np.sqrt(values[keep])
        inertial = [n for n, actuator in enumerate(scene.actuators) if actuator.inertial]
        n, r = len(self.ritz), series.shape[1]
        size = n + r + len(inertial)
        self.surface_part, self.local_part = slice(0, n), slice(n, n + r)
        self.size = size
        at = np.zeros((len(self.points), size))
        if self.points:
            at[:, :n] = surface.rows(self.points) @ self.shapes
            at[:, n : n + r] = series
        self.at = {point: at[k] for k, point in enumerate(self.points)}

        self.surface_stiffness = np.zeros((size, size))
        self.surface_stiffness[:n, :n] = np.diag(self.ritz) - self.edge_reduced
        self.surface_stiffness[self.local_part, self.local_part] = np.eye(r)
        self.edge_stiffness = np.zeros((size, size))
        self.edge_stiffness[:n, :n] = self.edge_reduced
        self.surface_mass = np.zeros((size, size))
        self.surface_mass[:n, :n] = np.eye(n)
        self.mass = self.surface_mass.copy()
        # Air acts on the mean, in which what the mesh lacks beside a point force is nothing: a square of the cell's area over the panel's.
        mean = np.zeros(size)
        mean[:n] = surface.mean_row @ self.shapes
        self.spring_stiffness, self.dashpots = scene.air_stiffness * np.outer(mean, mean), np.zeros((size, size))
        self.losses = np.zeros((size, size))
        self.losses[:n, :n] = self.edge_loss_reduced
        # The held surface without ERAs, which is what a modal ratio refers to.
        self.held_mass, self.held_stiffness = self.mass.copy(), self.surface_stiffness + self.edge_stiffness + self.spring_stiffness

        # A held point's own motion is the force in its springs over their stiffness, the true one.
        used, true, lossy = defaultdict(float), defaultdict(float), defaultdict(lambda: np.zeros(2, complex))
        for support in scene.supports:
            row = self.at[support.x, support.y]
            capped = self._capped(support.stiffness, row)
            used[support.x, support.y] += capped
            true[support.x, support.y] += support.stiffness
            spring = capped * np.outer(row, row)
            self.spring_stiffness += spring
            self.held_stiffness += spring
            # What it loses goes with the motion of the true one under the same force.
            softer = capped / support.stiffness if support.stiffness > 0 else 1.0
            self.losses += support.loss_factor * softer * spring
            lossy[support.x, support.y] += [capped * (1 + 1j * support.loss_factor * softer), support.stiffness * (1 + 1j * support.loss_factor)]
            self.dashpots += support.damping * softer**2 * np.outer(row, row)
        self.own_motion = {place: used[place] / true[place] if true[place] > 0 else 1.0 for place in self.at}
        # Under a harmonic force a lossy spring's motion lags behind the force, and the capped one's less.
        ratio = {place: part[0] / part[1] if part[1] != 0 else 1.0 for place, part in lossy.items()}
        self.own_lag = {place: ratio[place] / self.own_motion[place] for place in ratio}
        for slope, (stiffness, loss_factor) in zip(self.turning_rows, self.turning_springs):
            row = np.zeros(size)
            row[:n] = (slope @ self.shapes)[0]
            spring = self._capped(stiffness, row) * np.outer(row, row)
            self.spring_stiffness += spring
            self.held_stiffness += spring
            self.losses += loss_factor * spring
        for mass in scene.masses:
            row = self.at[mass.x, mass.y]
            self.mass += mass.mass * np.outer(row, row)
            self.held_mass += mass.mass * np.outer(row, row)
        self.forces, self.gaps = np.zeros((size, len(scene.actuators))), np.zeros((len(scene.actuators), size))
        for k, actuator in enumerate(scene.actuators):
            row = self.at[actuator.x, actuator.y]
            self.mass += actuator.housing_mass * np.outer(row, row)
            travel = -row
            if actuator.inertial:
                own = np.zeros(size)
                own[n + r + inertial.index(k)] = 1.0
                self.mass += actuator.moving_mass * np.outer(own, own)
                travel = own - row
                # A force on the surface, the opposite one on the moving mass.
                self.forces[:, k] = row - own
                self.gaps[k] = travel
            else:
                self.mass += actuator.moving_mass * np.outer(row, row)
                self.forces[:, k] = row
                self.gaps[k] = row
            self.spring_stiffness += self._capped(actuator.linear_stiffness, travel) * np.outer(travel, travel)
            self.dashpots += actuator.damping * np.outer(travel, travel)
        self.stiffness = self.surface_stiffness + self.edge_stiffness + self.spring_stiffness
        self._damping()

    def _capped(self, stiffness, row):
        surface = row[self.surface_part]
        compliance = surface @ (surface / (self.ritz - self.shift)) + row[self.local_part] @ row[self.local_part]
        return min(stiffness, RIGID / compliance) if compliance > 0 else stiffness

    def _damping(self):
        """The viscous matrix and the hysteretic part of the stiffness."""
        damping = self.scene.damping
        self.viscous = self.dashpots.copy()
        if damping.kind == "rayleigh":
            self.viscous += damping.rayleigh_alpha * self.surface_mass + damping.rayleigh_beta * self.surface_stiffness
        if damping.kind == "modal_ratio":
            # C = M sum(2 zeta omega_n phi_n phi_n^T) M over the modes of the held surface.
            omega, phi = self._eigen(self.held_mass, self.held_stiffness, self.surface_part.stop + self.local_part.stop - self.local_part.start)
            weighted = self.held_mass[:, : phi.shape[0]] @ phi
            ratio = damping.modal_ratio
            if isinstance(ratio, tuple):
                # By each mode's own frequency: straight between the pairs, constant beyond them.
                ratio = np.interp(omega / (2 * np.pi), *zip(*ratio))
            self.viscous += 2 * (weighted * ratio * omega) @ weighted.T
        self.hysteretic = damping.loss_factor * self.surface_stiffness + self.losses

    def _eigen(self, mass, stiffness, size):
        """Angular frequencies and mass-normalised shapes, of the first `size` coordinates."""
        mass, stiffness = mass[:size, :size], stiffness[:size, :size]
        theta, phi = la.eigh(mass, stiffness - self.shift * mass)
        keep = theta > 1e-13 * theta.max()
        theta, phi = theta[keep][::-1], phi[:, keep][:, ::-1]
        return np.sqrt(np.maximum(self.shift + 1 / theta, 0.0)), phi / np.sqrt(theta)

    # Answers.

    def modes(self):
        """Angular frequencies (rad/s) and mass-normalised shapes [coordinate, mode] of the undamped panel."""
        return self._eigen(self.mass, self.stiffness, self.size)

    def output_rows(self, points):
        """Deflection at points over the coordinates: [n, coordinate]."""
        rows = np.zeros((len(points), self.size))
        rows[:, self.surface_part] = self.surface.rows(points) @ self.shapes
        if self.forces_of_amplitudes.shape[1]:
            rows[:, self.local_part] = self.local.at(points) @ self.forces_of_amplitudes
        # At an attachment mesh and local part cancel as far as it is held: there the very row that its spring has.
        near = 1e-9 * max(self.scene.length, self.scene.width)
        for row, point in zip(rows, points):
            for place, own in self.at.items():
                if abs(place[0] - point[0]) < near and abs(place[1] - point[1]) < near:
                    row[:] = own * self.own_motion[place]
        return rows

    def lags(self, points):
        """Factors [n] on the harmonic motion at points: that of a spring which is stiffer, and loses more, than the one that stands in for it."""
        near = 1e-9 * max(self.scene.length, self.scene.width)
        factors = np.ones(len(points), complex)
        for k, point in enumerate(points):
            for place, lag in self.own_lag.items():
                if abs(place[0] - point[0]) < near and abs(place[1] - point[1]) < near:
                    factors[k] = lag
        return factors

    def solve(self, frequencies_hz, forces):
        """Coordinates under harmonic forces [coordinate, load]: [frequency, coordinate, load]."""
        omega = 2 * np.pi * np.atleast_1d(np.asarray(frequencies_hz, dtype=float))
        result = np.empty((len(omega), self.size, forces.shape[1]), dtype=complex)
        # Coordinates scaled by their stiffness at the shift: the local compliance and the surface are then of one size.
        scale = 1 / np.sqrt(np.diagonal(self.stiffness - self.shift * self.mass))
        scaled = lambda matrix: matrix * scale[:, None] * scale[None, :]
        k, c, m = scaled(self.stiffness + 1j * self.hysteretic), scaled(self.viscous), scaled(self.mass)
        loads = scale[:, None] * forces
        for start in range(0, len(omega), 32):
            w = omega[start : start + 32, None, None]
            result[start : start + 32] = np.linalg.solve(k + 1j * w * c - w**2 * m, loads[None]) * scale[None, :, None]
        return result
