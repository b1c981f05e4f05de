"""The plate of a scene as a mesh, and what the mesh is short of at point forces.

A point force makes the deflection go as r^2 log r around it, which cubics on cells of size h miss by c h^2 / D
(c = 0.002052 at a node between square cells). That part is local. So around every attachment the panel's own static solution is
solved again on a much finer mesh of a window around it, whose inner border stays as it was: the difference is a local
shape, and its work a local compliance in series with the attachment.
"""

import numpy as np
import scipy.sparse as sp

from . import hermite, laminate
from .mesh import Mesh, factor

# Cells per wave: 15 where figures are held against the program's bounds, the band of the drives; beyond it, where harmonics are
# held to percents, 10, which are off by (2 pi / 10)^4 / 720 = 2e-4 on the coarser mesh.
CELLS_PER_WAVE = {400.0: 15, np.inf: 10}
# Cells beside lines on which moments are singular, in units of the others: r^-0.36 at a cut-out's corner, less at the corner of a patch
# and where a held side ends at a free one.
CUTOUT, HELD_CORNER, PATCH = 1 / 32, 1 / 16, 1 / 4
# Cells on the way there, over their distance from it.
STEEPNESS, STEEPEST = 0.5, 0.8
# A line goes through every support, unless another one is as near as this part of a coarser mesh's cell: what the mesh is short of at a stiff
# point depends on where in its cell it is, and would else change from mesh to mesh by chance.
NO_NEARER = 0.35
# But not below this part of the side: rounding grows with the cube of a thin cell's aspect, and at 3e-4 already counted for 2e-4 of a curve.
NEAREST = 2e-3
# Cells of a window to each side of the point, in units of the larger side of the cell that it is in.
WINDOW_CELLS = 4.0
# Layers of the fine mesh of a window towards its point, each a third of the one before.
WINDOW_LAYERS = 6
# Meshes on which modes are looked for first: cells larger by this, from so many unknowns on, and the coarsest, of some four cells per wave at
# the highest mode's frequency.
COARSENING, SMALL, COARSEST = 1.5, 6000, 0.44


def part_of(scene, x, y):
    """(D11, D12, D22, D66, mass per area) of the surface at a place; the weight is 0 in a cut-out."""
    thickness, material = scene.thickness, scene.material
    for patch in scene.patches:
        if patch.x < x < patch.x + patch.length and patch.y < y < patch.y + patch.width:
            thickness, material = patch.thickness, patch.material
    if scene.in_cutout(x, y):
        return 1.0, 0.0, 1.0, 0.5, 0.0
    if scene.laminate:
        return *scene.laminate.bending, scene.laminate.weight + scene.added_mass
    nu = material.poisson_ratio
    rigidity = material.youngs_modulus_pa * thickness**3 / (12 * (1 - nu**2))
    return *laminate.isotropic(rigidity, nu), material.density_kg_m3 * thickness + scene.added_mass


def shortest_wavelength(scene, max_hz):
    """Of bending waves at `max_hz` in the slowest part: 2 pi (D / (mu omega^2))^(1/4), in m."""
    parts = [(scene.thickness, scene.material)] + [(patch.thickness, patch.material) for patch in scene.patches]
    omega = 2 * np.pi * max_hz
    lengths = []
    if scene.laminate:
        return 2 * np.pi * (scene.laminate.softest(False) / (scene.laminate.weight * omega**2)) ** 0.25
    for thickness, m in parts:
        rigidity = m.youngs_modulus_pa * thickness**3 / (12 * (1 - m.poisson_ratio**2))
        lengths.append(2 * np.pi * (rigidity / (m.density_kg_m3 * thickness * omega**2)) ** 0.25)
    return min(lengths)


class Plate:
    """The mesh of a scene's plate for frequencies up to `max_hz`, cells smaller by `fineness`."""

    def __init__(self, scene, max_hz, fineness, shift):
        self.scene, self.max_hz, self.fineness, self.shift = scene, max_hz, fineness, shift
        # What rounding takes is below the floor of every plate's own error.
        self.rounding = 0.0
        a, b = scene.length, scene.width
        waves = min(shortest_wavelength(scene, min(hz, max_hz)) / cells for hz, cells in CELLS_PER_WAVE.items())
        size = min(max(a, b) / 12, min(a, b) / 8, waves) / fineness
        at_x, at_y = {}, {}
        for parts, finest in ((scene.patches, PATCH), (scene.cutouts, CUTOUT)):
            for part in parts:
                for places, start, span, side in ((at_x, part.x, part.length, a), (at_y, part.y, part.width, b)):
                    for place in (start, start + span):
                        inside = 1e-6 * side < place < (1 - 1e-6) * side
                        if inside:
                            places[place] = min(places.get(place, 1.0), finest)
        # Nor are they regular where a held side ends at a free one.
        held = {edge.side for edge in scene.edges if edge.kind != "elastic"}
        for end_x, place_x in (("left", 0.0), ("right", a)):
            for end_y, place_y in (("top", 0.0), ("bottom", b)):
                if (end_x in held) != (end_y in held):
                    at_x[place_x] = at_y[place_y] = HELD_CORNER
        for support in scene.supports:
            for places, place, side in ((at_x, support.x, a), (at_y, support.y, b)):
                if all(abs(place - other) > NO_NEARER * size * fineness for other in (0.0, side, *places)):
                    places[place] = None
        # Towards singular places the finer mesh has smaller last cells and more on the way there, so that its error falls there as elsewhere.
        x, y = (
            hermite.graded_lines({place: finest and max(finest * size, NEAREST * side) / fineness for place, finest in places.items()}, side, size, min(STEEPNESS / fineness, STEEPEST))
            for places, side in ((at_x, a), (at_y, b))
        )
        middle_x, middle_y = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
        parts = np.array([[part_of(scene, u, v) for v in middle_y] for u in middle_x])
        edges = {edge.side: (edge.kind, edge.stiffness, edge.rotational_stiffness, edge.loss_factor) for edge in scene.edges}
        self.mesh = Mesh(x, y, parts[:, :, :4], parts[:, :, 4], edges)
        self.size = self.mesh.size

    def mode_count(self, hz):
        """About how many modes lie below a frequency (Weyl): area times omega sqrt(mu / D) / (4 pi), D^-1/2 the mean over all directions."""
        mesh = self.mesh
        area = np.diff(mesh.x)[:, None] * np.diff(mesh.y)[None, :]
        slowness = (1 / np.sqrt(laminate.along(mesh.bending, laminate.directions()))).mean(-1)
        return float((area * np.sqrt(mesh.weight) * slowness).sum() * hz / 2)

    @property
    def stiffness(self):
        """Of the surface's own material: sparse, N/m."""
        return self.mesh.stiffness

    @property
    def edge_stiffness(self):
        """Of elastic edges."""
        return self.mesh.edge_stiffness

    @property
    def mean_row(self):
        """The mean deflection over the unknowns."""
        return self.mesh.mean_row

    @property
    def edge_loss(self):
        """The same, each times its loss factor."""
        return self.mesh.edge_loss

    @property
    def mass(self):
        """Of the surface."""
        return self.mesh.mass

    def coarser(self):
        """The same on a mesh with larger cells, or None where that would be too coarse for the waves, or this one is small."""
        fineness = self.fineness / COARSENING
        if self.size < SMALL or fineness < COARSEST:
            return None
        return Plate(self.scene, self.max_hz, fineness, self.shift)

    def from_coarser(self, coarse):
        """What a vector of the coarser mesh is on this one, sparse."""
        return interpolation(coarse.mesh, self.mesh)

    def rows(self, points):
        """Deflection at points."""
        return self.mesh.rows(points)

    def slope_rows(self, point):
        """Slopes along x and y at a point."""
        return [self.mesh.rows([point], 1, 0), self.mesh.rows([point], 0, 1)]

    def local(self, points, solutions):
        """What the mesh is short of at attachments, [`Local`]."""
        return Local(self, points, solutions)


def interpolation(mesh, fine):
    """Unknowns of a mesh to those of a finer one of the same surface: deflection and slopes at its nodes, sparse."""
    scale_x, scale_y = hermite.node_scales(fine.x), hermite.node_scales(fine.y)
    blocks, order = [], []
    for a in (0, 1):
        for b in (0, 1):
            numbers = fine.number[:, 2 * a + b]
            nodes = np.flatnonzero(numbers >= 0)
            at_x, at_y = nodes // (fine.ny + 1), nodes % (fine.ny + 1)
            places = np.stack([fine.x[at_x], fine.y[at_y]], axis=1)
            blocks.append(sp.diags(scale_x[at_x] ** a * scale_y[at_y] ** b) @ mesh.rows(places, a, b))
            order.append(numbers[nodes])
    return sp.vstack(blocks).tocsr()[np.argsort(np.concatenate(order))]


class Window:
    """One attachment's piece of the mesh, on a much finer mesh, held to the panel's own solution at its inner border.

    `solutions` [unknowns of the panel's mesh, attachment] are those of the panel's mesh for unit forces at all `points`.
    """

    def __init__(self, plate, points, own, solutions):
        mesh = plate.mesh
        point = points[own]
        reach = WINDOW_CELLS * max(self._cell_size(mesh.x, point[0]), self._cell_size(mesh.y, point[1]))
        i0, i1 = self._span(mesh.x, point[0], reach)
        j0, j1 = self._span(mesh.y, point[1], reach)
        x, y = mesh.x[i0 : i1 + 1], mesh.y[j0 : j1 + 1]
        self.box = (x[0], x[-1], y[0], y[-1])
        inner = {"left": i0 > 0, "right": i1 < mesh.nx, "top": j0 > 0, "bottom": j1 < mesh.ny}
        edges = {side: edge for side, edge in mesh.edges.items() if not inner[side]}
        size = reach / WINDOW_CELLS / 2
        fine_x, fine_y = self._refined(x, point[0], size), self._refined(y, point[1], size)
        of_x = np.searchsorted(x, (fine_x[1:] + fine_x[:-1]) / 2) - 1
        of_y = np.searchsorted(y, (fine_y[1:] + fine_y[:-1]) / 2) - 1
        pick = np.ix_(i0 + of_x, j0 + of_y)
        self.fine = Mesh(fine_x, fine_y, mesh.bending[pick], mesh.weight[pick], edges)

        prolonged, free = self._prolongation(mesh, inner)
        loads = np.zeros((self.fine.size, len(points)))
        inside = np.flatnonzero(self.holds(points))
        loads[:, inside] = self.fine.rows(points[inside]).toarray().T
        dynamic = self.fine.dynamic(plate.shift)
        # What the panel's solutions leave unbalanced on the fine mesh.
        residuals = (loads - dynamic @ (prolonged @ solutions))[free]
        inverse = factor(dynamic[free][:, free])
        self.error = np.zeros(self.fine.size)
        self.error[free] = inverse.solve(residuals[:, own])
        # The work of every attachment's residual on this one's error: what the compliances lack.
        self.lacking = residuals.T @ self.error[free]

    def _prolongation(self, mesh, inner):
        """Unknowns of the panel's mesh to those of the fine one (sparse), and which of these lie off the inner border."""
        fine = self.fine
        held = np.zeros((fine.nx + 1, fine.ny + 1), dtype=bool)
        for side, index in (("left", np.s_[0, :]), ("right", np.s_[-1, :]), ("top", np.s_[:, 0]), ("bottom", np.s_[:, -1])):
            held[index] |= inner[side]
        numbers = fine.number[~held.ravel()]
        return interpolation(mesh, fine), np.sort(numbers[numbers >= 0])

    @staticmethod
    def _cell_size(lines, place):
        return max(float(lines[k + 1] - lines[k]) for k in hermite.locate(lines, place))

    @staticmethod
    def _span(lines, place, reach):
        low = int(np.searchsorted(lines, place - reach, side="right")) - 1
        high = int(np.searchsorted(lines, place + reach, side="left"))
        return max(low, 0), min(high, len(lines) - 1)

    @staticmethod
    def _refined(lines, place, size):
        """Cells in halves, and layers towards the point, from `size` down. Cells already thin against that are let be:
        thinner ones lose digits."""
        finest = size * 3.0 ** (1 - WINDOW_LAYERS)
        halves = [(a + b) / 2 for a, b in zip(lines, lines[1:]) if b - a > 8 * finest]
        result = sorted([*lines, *halves])
        layers = [place] + [place + sign * size * 3.0**-k for k in range(WINDOW_LAYERS) for sign in (-1, 1)]
        for line in layers:
            if lines[0] < line < lines[-1] and min(abs(line - known) for known in result) > finest / 2:
                result.append(line)
        return np.array(sorted(result))

    def holds(self, points):
        """Which points lie within the window."""
        x0, x1, y0, y1 = self.box
        points = np.atleast_2d(points)
        return (points[:, 0] >= x0) & (points[:, 0] <= x1) & (points[:, 1] >= y0) & (points[:, 1] <= y1)

    def difference(self, points):
        """Deflection per newton that the mesh lacks, at points [n, 2]; 0 outside."""
        points = np.atleast_2d(np.asarray(points, dtype=float))
        result = np.zeros(len(points))
        inside = self.holds(points)
        if inside.any():
            result[inside] = self.fine.rows(points[inside]) @ self.error
        return result


class Local:
    """Local compliance of all attachments [n, n] m/N, and their local shapes."""

    def __init__(self, plate, points, solutions):
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        self.windows = [Window(plate, points, own, solutions) for own in range(len(points))]
        raw = np.array([window.lacking for window in self.windows]).reshape(len(points), len(points))
        self.compliance = (raw + raw.T) / 2

    def at(self, points):
        """What the mesh lacks at points per newton at each attachment: [point, attachment]."""
        if not self.windows:
            return np.zeros((len(points), 0))
        return np.stack([window.difference(points) for window in self.windows], axis=1)
