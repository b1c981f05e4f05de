"""Cubic Hermite functions on a line of cells: the parts of which bars and plates are assembled.

The unknowns of a node are deflection and slope times the node's own length scale, so that they are of like size on
cells of very different lengths.
"""

import numpy as np

_COEFFICIENTS = np.array([[1, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]], dtype=float)
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_PLACES, _WEIGHTS = (_PLACES + 1) / 2, _WEIGHTS / 2


def unit_functions(place, derivative=0):
    """The four cubics of a cell of length 1, or a derivative of them, at `place` [n]: [n, 4]."""
    columns = [np.polynomial.Polynomial(row).deriv(derivative)(np.asarray(place, dtype=float)) for row in _COEFFICIENTS]
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def node_scales(lines):
    """The length scale of each node: the mean of its cells' lengths."""
    h = np.diff(lines)
    return np.concatenate([[h[0]], (h[1:] + h[:-1]) / 2, [h[-1]]])


def cell_scales(lines):
    """What turns unit-cell functions into those of the nodes' scaled unknowns: [cell, 4]."""
    h, s = np.diff(lines), node_scales(lines)
    return np.stack([np.ones_like(h), h / s[:-1], np.ones_like(h), h / s[1:]], axis=1)


def cell_matrices(lines, left, right):
    """Integrals over each cell of the products of derivatives of order `left` and `right`: [cell, 4, 4]."""
    h, scales = np.diff(lines), cell_scales(lines)
    unit = np.einsum("ga,gb,g->ab", unit_functions(_PLACES, left), unit_functions(_PLACES, right), _WEIGHTS)
    return unit[None] * scales[:, :, None] * scales[:, None, :] * (h ** (1 - left - right))[:, None, None]


def functions_at(lines, cells, places, derivative=0):
    """The four functions of the given cells at places on the line, or a derivative: [n, 4]."""
    h = np.diff(lines)[cells]
    unit = unit_functions((places - lines[cells]) / h, derivative)
    return unit * cell_scales(lines)[cells] / (h**derivative)[:, None]


def locate(lines, places):
    """The cells that places belong to, once from below and once from above: two arrays, equal but at lines."""
    tolerance = 1e-9 * (lines[-1] - lines[0])
    places = np.asarray(places, dtype=float)
    cell = lambda shift: np.clip(np.searchsorted(lines, places + shift, side="right") - 1, 0, len(lines) - 2)
    return cell(-tolerance), cell(tolerance)


def graded_lines(fixed, length, size, steepness=0.5):
    """Lines from 0 to `length` through the `fixed` places, cells no longer than `size`.

    `fixed` maps a place to the length of the cells beside it, or to None where they are as all others. On the way there a cell is at
    most `steepness` times as long as it is far from the place at its far end.
    """
    tolerance = 1e-6 * length
    places = {0.0: None, length: None}
    for place, finest in sorted(fixed.items()):
        place = next((known for known in places if abs(known - place) <= tolerance), place)
        known = places.get(place)
        places[place] = finest if known is None else known if finest is None else min(known, finest)
    order = sorted(places)
    result = [0.0]
    for a, b in zip(order, order[1:]):
        graded = [(end, sign, places[end]) for end, sign in ((a, 1.0), (b, -1.0)) if places[end] is not None]
        reach = min(size / steepness, (b - a) / max(len(graded), 1))
        inner = {a, b}
        for end, sign, finest in graded:
            # As many equal cells as steepness allows, then longer ones.
            even = int(np.ceil(1 / steepness - 1 - 1e-9))
            first = min(finest * even, reach)
            inner.update(end + sign * first * k / even for k in range(1, even + 1))
            count = int(np.ceil(np.log(reach / first) / -np.log(1 - steepness) - 1e-9))
            inner.update(end + sign * first * (reach / first) ** (k / count) for k in range(1, count + 1))
        inner = sorted(inner)
        # Lines that come from both ends, or that are an end but for rounding.
        inner = [a] + [line for line, before in zip(inner[1:-1], inner) if line - before > tolerance and b - line > tolerance] + [b]
        for left, right in zip(inner, inner[1:]):
            count = max(1, int(np.ceil((right - left) / size - 1e-9)))
            result.extend(left + (right - left) * np.arange(1, count + 1) / count)
            result[-1] = right
    return np.array(result)
