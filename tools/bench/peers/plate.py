"""The plate of a problem file in cubic Hermite rectangles (Bogner, Fox, Schmit 1965) on a regular mesh, in NumPy and SciPy.

The unknowns are w, w_x, w_y and w_xy at the mesh's nodes, slopes in units of a cell. Point forces act through the
elements' own functions: nothing corrects what the mesh is too coarse for.
"""

import json

import common
import numpy as np
import scipy.sparse as sp


class Problem:
    """What the other side wrote: scene in SI units, frequencies, grid of points, and its tightest answer."""

    def __init__(self, path):
        with open(path, encoding="utf-8") as file:
            data = json.load(file)
        self.scene = data["scene"]
        self.frequencies_hz = np.array(data["frequencies_hz"])
        self.x_m, self.y_m = np.array(data["x_m"]), np.array(data["y_m"])
        self.loads = len(self.scene["actuators"])
        shape = (self.loads, len(self.x_m) * len(self.y_m), len(self.frequencies_hz))
        # Acceleration for 1 N at each actuator alone, [actuator][point, x first][frequency].
        self.reference = np.fromfile(data["reference"], dtype=np.complex128).reshape(shape)
        self.peaks = np.abs(self.reference).max(axis=2)
        common.refuse(self.scene)

    def error(self, answer, at=slice(None)):
        """Largest deviation of a curve from the reference, relative to the curve's peak, at the frequencies `at`."""
        return float((np.abs(answer - self.reference[:, :, at]) / self.peaks[:, :, None]).max())

    def worst(self, answer, count):
        """The indices of the frequencies at which an answer for all of them deviates most."""
        deviation = (np.abs(answer - self.reference) / self.peaks[:, :, None]).max(axis=(0, 1))
        return np.argsort(deviation)[-count:]


def hermite(place, derivative=0):
    """The four cubics of a cell of length 1 at `place` in 0..1, or a derivative of them."""
    coefficients = np.array([[1, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]], dtype=float)
    return np.array([np.polynomial.Polynomial(row).deriv(derivative)(place) for row in coefficients])


def line(cells, length):
    """Matrices of `cells` equal cells along a line: bend, mixed (w'' times w), slope, mass."""
    h = length / cells
    places, weights = np.polynomial.legendre.leggauss(4)
    values = [hermite((places + 1) / 2, k) for k in range(3)]
    product = lambda a, b, power: np.einsum("ag,bg,g->ab", values[a], values[b], weights / 2) * h**power
    cell = [product(2, 2, -3), product(2, 0, -1), product(1, 1, -1), product(0, 0, 1)]
    numbers = 2 * np.arange(cells)[:, None] + np.arange(4)
    rows, columns = np.repeat(numbers, 4, axis=1).ravel(), np.tile(numbers, (1, 4)).ravel()
    size = 2 * cells + 2
    return [sp.csr_matrix((np.tile(block.ravel(), cells), (rows, columns)), shape=(size, size)) for block in cell]


def line_rows(cells, length, at):
    """The deflections at the places `at` as rows over a line's unknowns."""
    h = length / cells
    cell = np.minimum((np.asarray(at) / h + 1e-9).astype(int), cells - 1)
    values = hermite(np.asarray(at) / h - cell)
    rows = np.repeat(np.arange(len(cell)), 4)
    columns = (2 * cell[:, None] + np.arange(4)).ravel()
    return sp.csr_matrix((values.T.ravel(), (rows, columns)), shape=(len(cell), 2 * cells + 2))


class Plate:
    """Matrices of a problem's plate on `cells` = (along x, along y).

    `stiffness` and `mass` are everything's, `surface` is the surface's own stiffness; the columns of `couplings` are the
    vectors that springs (`k`) and dashpots (`c`) act along; `loads` are 1 N at each actuator; `points` are the
    deflections at the grid's points.
    """

    def __init__(self, problem, cells):
        scene, self.cells = problem.scene, cells
        surface, material = scene["surface"], scene["surface"]["material"]
        sides = (surface["length_m"], surface["width_m"])
        nu, thickness = material["poisson_ratio"], surface["thickness_m"]
        rigidity = material["youngs_modulus_pa"] * thickness**3 / (12 * (1 - nu**2))
        (bx, mx, sx, gx), (by, my, sy, gy) = (line(n, side) for n, side in zip(cells, sides))
        twist = 2 * (1 - nu) * sp.kron(sx, sy)
        bending = sp.kron(bx, gy) + sp.kron(gx, by) + nu * (sp.kron(mx, my.T) + sp.kron(mx.T, my))
        self.loss_factor = surface["damping"]["loss_factor"]
        self.surface = (rigidity * (bending + twist)).tocsc()
        mass = material["density_kg_m3"] * thickness * sp.kron(gx, gy)

        inertial = [i for i, era in enumerate(scene["actuators"]) if era["mount"] == "inertial"]
        plate_unknowns = self.surface.shape[0]
        self.unknowns = plate_unknowns + len(inertial)

        def rows(x, y):
            return sp.kron(line_rows(cells[0], sides[0], [x]), line_rows(cells[1], sides[1], [y]))

        def widened(matrix, shape):
            matrix = matrix.tocoo()
            return sp.csc_matrix((matrix.data, (matrix.row, matrix.col)), shape=shape)

        def row(x, y):
            return widened(rows(x, y), (1, self.unknowns))

        square = (self.unknowns, self.unknowns)
        self.surface, mass = widened(self.surface, square), widened(mass, square)
        couplings, self.k, self.c, loads = [], [], [], []

        def couple(vector, k, c):
            couplings.append(vector)
            self.k.append(k)
            self.c.append(c)

        for support in scene["supports"]:
            couple(row(support["x_m"], support["y_m"]), support["stiffness_n_per_m"], support["damping_n_s_per_m"])
        for attached in scene["masses"]:
            here = row(attached["x_m"], attached["y_m"])
            mass = mass + attached["mass_kg"] * (here.T @ here)
        for i, era in enumerate(scene["actuators"]):
            here = row(era["x_m"], era["y_m"])
            riding = era["housing_mass_kg"]
            between = here
            if era["mount"] == "inertial":
                own = sp.csc_matrix(([1.0], ([0], [plate_unknowns + inertial.index(i)])), shape=(1, self.unknowns))
                mass = mass + era["moving_mass_kg"] * (own.T @ own)
                between = here - own
            else:
                riding += era["moving_mass_kg"]
            mass = mass + riding * (here.T @ here)
            couple(between, era["stiffness_n_per_m"], era["damping_n_s_per_m"])
            loads.append(between)
        self.couplings = sp.vstack(couplings).T.tocsc()
        self.k, self.c = np.array(self.k), np.array(self.c)
        self.loads = sp.vstack(loads).T.toarray()
        self.mass = mass.tocsc()
        self.stiffness = (self.surface + self.couplings @ sp.diags(self.k) @ self.couplings.T).tocsc()
        self.damping = (self.couplings @ sp.diags(self.c) @ self.couplings.T).tocsc()
        grid = sp.kron(line_rows(cells[0], sides[0], problem.x_m), line_rows(cells[1], sides[1], problem.y_m)).tocsr()
        # Rows have y first, as the unknowns; the points have x first.
        x_first = np.arange(grid.shape[0]).reshape(len(problem.x_m), len(problem.y_m)).T.ravel()
        self.points = widened(grid[x_first], (grid.shape[0], self.unknowns)).tocsr()
