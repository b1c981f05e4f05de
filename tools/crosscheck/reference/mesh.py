"""A Kirchhoff plate in bicubic Hermite rectangles (Bogner, Fox and Schmit 1965), on lines that need not be regular.

Unknowns of a node: w, w_x, w_y, w_xy, slopes in units of the node's own scales. Energy:
1/2 [D11 w_xx^2 + D22 w_yy^2 + 2 D12 w_xx w_yy + 4 D66 w_xy^2] (Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells).
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from . import hermite


def factor(matrix):
    """A sparse direct solver of a symmetric positive definite matrix."""
    options = {"SymmetricMode": True}
    return splu(sp.csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


class Mesh:
    """A plate on the given lines.

    `bending` [nx, ny, 4] (D11, D12, D22, D66 in N m) and `weight` [nx, ny] (mass per area in kg/m^2) are per cell; a cell of weight 0 is
    not there. `edges` maps a side to (kind, stiffness, rotational stiffness, loss factor).
    """

    def __init__(self, x, y, bending, weight, edges):
        self.x, self.y = np.asarray(x), np.asarray(y)
        self.bending, self.weight, self.edges = bending, weight, edges
        self.there = weight > 0
        self.nx, self.ny = len(self.x) - 1, len(self.y) - 1
        self._number()
        self._assemble()

    def _node(self, i, j):
        return np.asarray(i) * (self.ny + 1) + np.asarray(j)

    def _cell_unknowns(self, i, j):
        """The 16 unknowns of cells: x's four functions times y's four, [n, 16]; -1 where held."""
        i, j = np.asarray(i), np.asarray(j)
        result = np.empty((len(i), 4, 4), dtype=int)
        for a in range(4):
            for b in range(4):
                node = self._node(i + a // 2, j + b // 2)
                result[:, a, b] = self.number[node, (a % 2) * 2 + b % 2]
        return result.reshape(len(i), 16)

    def _number(self):
        used = np.zeros((self.nx + 1, self.ny + 1), dtype=bool)
        for a in (0, 1):
            for b in (0, 1):
                used[a : self.nx + a, b : self.ny + b] |= self.there
        free = np.repeat(used[:, :, None], 4, axis=2)
        for side, (kind, *_) in self.edges.items():
            if kind == "elastic":
                continue
            for i, j in self._side_nodes(side):
                # Along left and right w and w_y are held, clamped w_x and w_xy too; along top and bottom likewise.
                held = (0, 1) if side in ("left", "right") else (0, 2)
                free[i, j, list(held) if kind == "pinned" else [0, 1, 2, 3]] = False
        flat = free.reshape(-1, 4)
        self.number = np.full(flat.shape, -1)
        self.size = int(flat.sum())
        self.number[flat] = np.arange(self.size)

    def _side_cells(self, side):
        if side in ("left", "right"):
            i = 0 if side == "left" else self.nx - 1
            return [(i, j) for j in range(self.ny) if self.there[i, j]]
        j = 0 if side == "top" else self.ny - 1
        return [(i, j) for i in range(self.nx) if self.there[i, j]]

    def _side_nodes(self, side):
        nodes = set()
        for i, j in self._side_cells(side):
            if side in ("left", "right"):
                end = 0 if side == "left" else self.nx
                nodes |= {(end, j), (end, j + 1)}
            else:
                end = 0 if side == "top" else self.ny
                nodes |= {(i, end), (i + 1, end)}
        return nodes

    def _assemble(self):
        i, j = np.nonzero(self.there)
        x = {key: hermite.cell_matrices(self.x, *key)[i] for key in ((0, 0), (1, 1), (2, 2), (0, 2), (2, 0))}
        y = {key: hermite.cell_matrices(self.y, *key)[j] for key in ((0, 0), (1, 1), (2, 2), (0, 2), (2, 0))}
        product = lambda p, q: np.einsum("nac,nbd->nabcd", p, q).reshape(len(i), 16, 16)
        d11, d12, d22, d66 = self.bending[i, j].T[:, :, None, None]
        stiffness = d11 * product(x[2, 2], y[0, 0]) + d22 * product(x[0, 0], y[2, 2])
        stiffness += d12 * (product(x[2, 0], y[0, 2]) + product(x[0, 2], y[2, 0]))
        stiffness += 4 * d66 * product(x[1, 1], y[1, 1])
        unknowns = self._cell_unknowns(i, j)
        self.stiffness = self._sum(unknowns, stiffness)
        self.mass = self._sum(unknowns, self.weight[i, j][:, None, None] * product(x[0, 0], y[0, 0]))
        # The mean deflection: every function's integral over the cells that are there.
        ones = np.array([1.0, 0.0, 1.0, 0.0])
        values = np.einsum("na,nb->nab", x[0, 0] @ ones, y[0, 0] @ ones).reshape(len(i), 16)
        area = (np.diff(self.x)[i] * np.diff(self.y)[j]).sum()
        self.mean_row = np.zeros(self.size)
        np.add.at(self.mean_row, unknowns[unknowns >= 0], values[unknowns >= 0] / area)
        self.edge_stiffness = self._edge_matrix(lambda _loss_factor: 1.0)
        self.edge_loss = self._edge_matrix(lambda loss_factor: loss_factor)

    def _sum(self, unknowns, blocks):
        rows = np.repeat(unknowns[:, :, None], unknowns.shape[1], axis=2).ravel()
        columns = np.repeat(unknowns[:, None, :], unknowns.shape[1], axis=1).ravel()
        keep = (rows >= 0) & (columns >= 0)
        return sp.csc_matrix((blocks.ravel()[keep], (rows[keep], columns[keep])), shape=(self.size, self.size))

    def _edge_matrix(self, part):
        """The stiffness of all elastic edges, each times a part that follows from its loss factor."""
        total = sp.csc_matrix((self.size, self.size))
        for side, (kind, stiffness, rotational, loss_factor) in self.edges.items():
            cells = self._side_cells(side)
            if kind != "elastic" or not cells or part(loss_factor) == 0:
                continue
            i, j = np.array(cells).T
            along, across = (self.y, self.x) if side in ("left", "right") else (self.x, self.y)
            index, end = (j, i) if side in ("left", "right") else (i, j)
            border = np.full(len(cells), across[0] if side in ("left", "top") else across[-1])
            line = hermite.cell_matrices(along, 0, 0)[index]
            for derivative, amount in ((0, stiffness), (1, rotational)):
                f = hermite.functions_at(across, end, border, derivative)
                normal = f[:, :, None] * f[:, None, :]
                pair = (normal, line) if side in ("left", "right") else (line, normal)
                blocks = np.einsum("nac,nbd->nabcd", *pair).reshape(len(cells), 16, 16)
                total = total + self._sum(self._cell_unknowns(i, j), part(loss_factor) * amount * blocks)
        return total.tocsc()

    def cells_of(self, points):
        """A cell each that is there and holds the point [n, 2], which may be on its border: arrays i and j."""
        found_i, found_j = np.full(len(points), -1), np.full(len(points), -1)
        for i in hermite.locate(self.x, points[:, 0]):
            for j in hermite.locate(self.y, points[:, 1]):
                take = (found_i < 0) & self.there[i, j]
                found_i[take], found_j[take] = i[take], j[take]
        if (found_i < 0).any():
            raise ValueError(f"there is no surface at {points[found_i < 0][0]} m")
        return found_i, found_j

    def rows(self, points, x_derivative=0, y_derivative=0):
        """Rows that give the deflection, or a derivative of it, at points [n, 2] m: sparse [n, unknowns]."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        i, j = self.cells_of(points)
        fx = hermite.functions_at(self.x, i, points[:, 0], x_derivative)
        fy = hermite.functions_at(self.y, j, points[:, 1], y_derivative)
        values = np.einsum("na,nb->nab", fx, fy).reshape(len(points), 16)
        columns = self._cell_unknowns(i, j)
        rows = np.repeat(np.arange(len(points))[:, None], 16, axis=1)
        keep = columns >= 0
        return sp.csr_matrix((values[keep], (rows[keep], columns[keep])), shape=(len(points), self.size))

    def dynamic(self, shift):
        """K - shift M, edges included."""
        return self.stiffness + self.edge_stiffness - shift * self.mass
