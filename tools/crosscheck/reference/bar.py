"""The bar of a scene: Euler-Bernoulli beam in cubic Hermite elements, a node at every attachment and step.

Statically exact at the nodes, so nothing is lacking at point forces.
"""

import numpy as np
import scipy.sparse as sp

from . import hermite


def part_of(scene, x):
    """(E I, mass per length) at a place: I = b h^3 / 12."""
    width, thickness, material = scene.width, scene.thickness, scene.material
    for patch in scene.patches:
        if patch.x < x < patch.x + patch.length:
            width, thickness, material = patch.width, patch.thickness, patch.material
    if scene.laminate:
        return scene.laminate.bending[0] * width, (scene.laminate.weight + scene.added_mass) * width
    return material.youngs_modulus_pa * width * thickness**3 / 12, (material.density_kg_m3 * thickness + scene.added_mass) * width


class Bar:
    """The mesh of a scene's bar for frequencies up to `max_hz`, cells smaller by `fineness`."""

    def __init__(self, scene, max_hz, fineness, points):
        length = scene.length
        fixed = {float(x): None for x, _ in points}
        for patch in scene.patches:
            fixed |= {patch.x: None, patch.x + patch.length: None}
        parts = [part_of(scene, x) for x in self._middles(sorted({0.0, length, *fixed}))]
        # Bending waves: 2 pi (E I / (mu omega^2))^(1/4).
        wave = min(2 * np.pi * (ei / (mu * (2 * np.pi * max_hz) ** 2)) ** 0.25 for ei, mu in parts)
        # Not finer: what rounding takes from slow motions goes with the fourth power of the number of cells.
        self.lines = hermite.graded_lines(fixed, length, min(length / 20, wave / 40) / fineness)
        parts = np.array([part_of(scene, x) for x in self._middles(self.lines)])
        # Entries of a cell, 12 E I / h^3 over its mass mu h, are rounded; over n cells that adds up as its square root.
        cells = 12 * parts[:, 0] / (parts[:, 1] * np.diff(self.lines) ** 4)
        self.rounding = np.finfo(float).eps * cells.max() / np.sqrt(len(cells))
        nodes = len(self.lines)
        free = np.ones((nodes, 2), dtype=bool)
        for edge in scene.edges:
            node = 0 if edge.side == "left" else nodes - 1
            if edge.kind != "elastic":
                free[node] = [False, edge.kind == "pinned"]
        self.number = np.full((nodes, 2), -1)
        self.size = int(free.sum())
        self.number[free] = np.arange(self.size)
        self._slowness = float((np.diff(self.lines) * (parts[:, 1] / parts[:, 0]) ** 0.25).sum())
        self.stiffness = self._sum(parts[:, 0, None, None] * hermite.cell_matrices(self.lines, 2, 2))
        self.mass = self._sum(parts[:, 1, None, None] * hermite.cell_matrices(self.lines, 0, 0))
        unknowns = self._cell_unknowns(np.arange(len(self.lines) - 1))
        values = hermite.cell_matrices(self.lines, 0, 0) @ np.array([1.0, 0.0, 1.0, 0.0]) / length
        self.mean_row = np.zeros(self.size)
        np.add.at(self.mean_row, unknowns[unknowns >= 0], values[unknowns >= 0])
        self.edge_stiffness = self.edge_loss = sp.csc_matrix((self.size, self.size))
        for edge in scene.edges:
            if edge.kind == "elastic":
                end = [(0.0 if edge.side == "left" else length, scene.width / 2)]
                for rows, amount in ((self.rows(end), edge.stiffness), (self.slope_rows(end[0])[0], edge.rotational_stiffness)):
                    self.edge_stiffness = self.edge_stiffness + amount * (rows.T @ rows)
                    self.edge_loss = self.edge_loss + edge.loss_factor * amount * (rows.T @ rows)
        self.edge_stiffness, self.edge_loss = self.edge_stiffness.tocsc(), self.edge_loss.tocsc()

    def mode_count(self, hz):
        """About how many modes lie below a frequency: length times (mu omega^2 / E I)^(1/4) / pi."""
        return self._slowness * np.sqrt(2 * np.pi * hz) / np.pi

    @staticmethod
    def _middles(lines):
        lines = np.asarray(lines)
        return (lines[1:] + lines[:-1]) / 2

    def _cell_unknowns(self, cells):
        return np.stack([self.number[cells, 0], self.number[cells, 1], self.number[cells + 1, 0], self.number[cells + 1, 1]], axis=1)

    def _sum(self, blocks):
        unknowns = self._cell_unknowns(np.arange(len(blocks)))
        rows, columns = np.repeat(unknowns[:, :, None], 4, axis=2).ravel(), np.repeat(unknowns[:, None, :], 4, axis=1).ravel()
        keep = (rows >= 0) & (columns >= 0)
        return sp.csc_matrix((blocks.ravel()[keep], (rows[keep], columns[keep])), shape=(self.size, self.size))

    def coarser(self):
        """None: a bar is small."""
        return None

    def rows(self, points, derivative=0):
        """Deflection, or slope, at points: sparse [n, unknowns]."""
        places = np.asarray(points, dtype=float).reshape(-1, 2)[:, 0]
        cells = hermite.locate(self.lines, places)[0]
        values = hermite.functions_at(self.lines, cells, places, derivative)
        columns = self._cell_unknowns(cells)
        rows = np.repeat(np.arange(len(places))[:, None], 4, axis=1)
        keep = columns >= 0
        return sp.csr_matrix((values[keep], (rows[keep], columns[keep])), shape=(len(places), self.size))

    def slope_rows(self, point):
        """Slope along the bar at a point."""
        return [self.rows([point], 1)]

    def local(self, points, _solutions):
        """Nothing is lacking at nodes."""
        return NothingLacking(len(points))


class NothingLacking:
    """The local compliance of a bar: none."""

    def __init__(self, count):
        self.count = count
        self.compliance = np.zeros((count, count))

    def at(self, points):
        """[point, attachment], all 0."""
        return np.zeros((len(points), self.count))
