"""The plate of a scene as a mesh, and what the mesh is short of at point forces.

A point force makes the deflection go as r^2 log r around it, which cubics on cells of size h miss by c h^2 / D
(numerics: c = 0.002052 at a node between square cells). That part is local. So around every attachment the same problem is
solved twice, on a window of the mesh and on a much finer one, held at the window's inner border: the difference is a local
compliance, in series with the attachment, and a local shape.
"""

import numpy as np

from . import hermite
from .mesh import Mesh, factor

# Cells of a window to each side of the point, in units of the larger side of the cell that it is in.
WINDOW_CELLS = 3.0
# Layers of the fine mesh of a window towards its point, each a third of the one before.
WINDOW_LAYERS = 6


def part_of(scene, x, y):
    """(D, nu, mass per area) of the surface at a place; the weight is 0 in a cut-out."""
    thickness, material = scene.thickness, scene.material
    for patch in scene.patches:
        if patch.x < x < patch.x + patch.length and patch.y < y < patch.y + patch.width:
            thickness, material = patch.thickness, patch.material
    if scene.in_cutout(x, y):
        return 1.0, 0.0, 0.0
    nu = material.poisson_ratio
    rigidity = material.youngs_modulus_pa * thickness**3 / (12 * (1 - nu**2))
    return rigidity, nu, material.density_kg_m3 * thickness


def shortest_wavelength(scene, max_hz):
    """Of bending waves at `max_hz` in the slowest part: 2 pi (D / (mu omega^2))^(1/4), in m."""
    parts = [(scene.thickness, scene.material)] + [(patch.thickness, patch.material) for patch in scene.patches]
    omega = 2 * np.pi * max_hz
    lengths = []
    for thickness, m in parts:
        rigidity = m.youngs_modulus_pa * thickness**3 / (12 * (1 - m.poisson_ratio**2))
        lengths.append(2 * np.pi * (rigidity / (m.density_kg_m3 * thickness * omega**2)) ** 0.25)
    return min(lengths)


class Plate:
    """The mesh of a scene's plate for frequencies up to `max_hz`, cells smaller by `fineness`."""

    def __init__(self, scene, max_hz, fineness, shift):
        self.scene, self.shift = scene, shift
        a, b = scene.length, scene.width
        size = min(max(a, b) / 10, min(a, b) / 6, shortest_wavelength(scene, max_hz) / 13) / fineness
        # More layers where moments are singular: r^-0.36 at a cut-out's corner, less at a patch's.
        extra = round(np.log(fineness) / np.log(4) * 2) if fineness > 1 else 0
        at_x, at_y = {}, {}
        for parts, layers in ((scene.patches, 1 + extra), (scene.cutouts, 3 + extra)):
            for part in parts:
                for places, start, span, side in ((at_x, part.x, part.length, a), (at_y, part.y, part.width, b)):
                    for place in (start, start + span):
                        inside = 1e-6 * side < place < (1 - 1e-6) * side
                        if inside:
                            places[place] = max(places.get(place, 0), layers)
        x = hermite.graded_lines(at_x, a, size, 3 + extra)
        y = hermite.graded_lines(at_y, b, size, 3 + extra)
        middle_x, middle_y = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
        parts = np.array([[part_of(scene, u, v) for v in middle_y] for u in middle_x])
        edges = {edge.side: (edge.kind, edge.stiffness, edge.rotational_stiffness) for edge in scene.edges}
        self.mesh = Mesh(x, y, parts[:, :, 0], parts[:, :, 1], parts[:, :, 2], edges)
        self.size = self.mesh.size

    @property
    def stiffness(self):
        """Of the surface's own material: sparse, N/m."""
        return self.mesh.stiffness

    @property
    def edge_stiffness(self):
        """Of elastic edges."""
        return self.mesh.edge_stiffness

    @property
    def mass(self):
        """Of the surface."""
        return self.mesh.mass

    def rows(self, points):
        """Deflection at points."""
        return self.mesh.rows(points)

    def slope_rows(self, point):
        """Slopes along x and y at a point."""
        return [self.mesh.rows([point], 1, 0), self.mesh.rows([point], 0, 1)]

    def local(self, points):
        """What the mesh is short of at attachments, [`Local`]."""
        return Local(self, points)


class Window:
    """One point force on a piece of the mesh and on a finer mesh of the same piece."""

    def __init__(self, plate, point):
        mesh = plate.mesh
        self.point = point
        i, j = mesh.cell_of(*point)
        reach = WINDOW_CELLS * max(self._cell_size(mesh.x, point[0], i), self._cell_size(mesh.y, point[1], j))
        i0, i1 = self._span(mesh.x, point[0], reach)
        j0, j1 = self._span(mesh.y, point[1], reach)
        x, y = mesh.x[i0 : i1 + 1], mesh.y[j0 : j1 + 1]
        self.box = (x[0], x[-1], y[0], y[-1])
        edges = {}
        inner = {"left": i0 > 0, "right": i1 < mesh.nx, "top": j0 > 0, "bottom": j1 < mesh.ny}
        for side, cut in inner.items():
            if cut:
                edges[side] = ("clamped", 0.0, 0.0)
            elif side in mesh.edges:
                edges[side] = mesh.edges[side]
        cells = np.ix_(range(i0, i1), range(j0, j1))
        self.coarse = Mesh(x, y, mesh.rigidity[cells], mesh.poisson[cells], mesh.weight[cells], edges)
        fine_x, fine_y = self._refined(x, point[0]), self._refined(y, point[1])
        of_x = np.searchsorted(x, (fine_x[1:] + fine_x[:-1]) / 2) - 1
        of_y = np.searchsorted(y, (fine_y[1:] + fine_y[:-1]) / 2) - 1
        pick = np.ix_(i0 + of_x, j0 + of_y)
        self.fine = Mesh(fine_x, fine_y, mesh.rigidity[pick], mesh.poisson[pick], mesh.weight[pick], edges)
        self.solutions = []
        for part in (self.coarse, self.fine):
            load = part.rows([point]).toarray()[0]
            self.solutions.append(factor(part.dynamic(plate.shift)).solve(load) if part.size else load)

    @staticmethod
    def _cell_size(lines, place, index):
        sizes = [lines[k + 1] - lines[k] for k in hermite.locate(lines, place)]
        return max(sizes + [lines[index + 1] - lines[index]])

    @staticmethod
    def _span(lines, place, reach):
        low = int(np.searchsorted(lines, place - reach, side="right")) - 1
        high = int(np.searchsorted(lines, place + reach, side="left"))
        return max(low, 0), min(high, len(lines) - 1)

    @staticmethod
    def _refined(lines, place):
        """Every cell in two, and layers towards the point."""
        keep = list(lines) + list((lines[1:] + lines[:-1]) / 2)
        size = max(lines[k + 1] - lines[k] for k in hermite.locate(lines, place)) / 2
        extra = [place]
        for k in range(WINDOW_LAYERS):
            extra += [place - size * 3.0**-k, place + size * 3.0**-k]
        result = sorted(keep)
        tolerance = size * 3.0 ** (-WINDOW_LAYERS) / 2
        for line in extra:
            if lines[0] < line < lines[-1] and min(abs(line - known) for known in result) > tolerance:
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
            coarse, fine = (m.rows(points[inside]) @ s for m, s in zip((self.coarse, self.fine), self.solutions))
            result[inside] = fine - coarse
        return result


class Local:
    """Local compliance of all attachments [n, n] m/N, and their local shapes."""

    def __init__(self, plate, points):
        self.points = np.asarray(points, dtype=float).reshape(-1, 2)
        self.windows = [Window(plate, tuple(point)) for point in self.points]
        raw = self.at(self.points)
        self.compliance = (raw + raw.T) / 2

    def at(self, points):
        """What the mesh lacks at points per newton at each attachment: [point, attachment]."""
        if not self.windows:
            return np.zeros((len(points), 0))
        return np.stack([window.difference(points) for window in self.windows], axis=1)
