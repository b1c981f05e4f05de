"""Layers that make a surface: the stack's stiffness in the plane and out of it, whole, and its compliance inverted (Reddy, Mechanics of Laminated
Composite Plates and Shells): what a stack is bent by, with nothing pulling at its sides, is the bending part of the inverse.
"""

from dataclasses import dataclass

import numpy as np

# Step of the difference that says what losses do.
STEP = 1e-4
# Directions of a quarter turn.
DIRECTIONS = 400


@dataclass(frozen=True)
class Layer:
    """From the bottom to the top; moduli along x and y of the surface, Poisson's ratio of y for a pull along x."""

    thickness: float
    ex: float
    ey: float
    g: float
    nu_xy: float
    density: float
    loss_factor: float = 0.0
    slips: bool = False


def _turned(layer, degrees):
    """The compliance of a layer whose material is turned, [3, 3] over the strains along x and y and the shear angle."""
    compliance = np.array(
        [
            [1 / layer.ex, -layer.nu_xy / layer.ex, 0],
            [-layer.nu_xy / layer.ex, 1 / layer.ey, 0],
            [0, 0, 1 / layer.g],
        ]
    )
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    stress = np.array([[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]])
    return stress.T @ compliance @ stress


def read(table):
    """A layer of the scene's table."""
    material, number = table["material"], lambda of, key, default=None: float(of[key] if default is None else of.get(key, default))
    nu = number(material, "poisson_ratio", 0.0)
    if "ex_pa" in material:
        ex, ey, g = (number(material, key) for key in ("ex_pa", "ey_pa", "g_pa"))
    else:
        ex = ey = number(material, "youngs_modulus_pa")
        g = ex / (2 + 2 * nu)
    layer = Layer(number(table, "thickness_mm") * 1e-3, ex, ey, g, nu, number(material, "density_kg_m3"))
    compliance = _turned(layer, number(table, "angle_deg", 0.0))
    return Layer(
        layer.thickness,
        1 / compliance[0, 0],
        1 / compliance[1, 1],
        1 / compliance[2, 2],
        -compliance[0, 1] / compliance[0, 0],
        layer.density,
        number(table, "loss_factor", 0.0),
        table.get("bond", "bonded") == "slips",
    )


def _stack(layers, bar, stiffer):
    """Bending stiffness [3, 3] of layers that are bonded, each stiffer by 1 + `stiffer` times its loss factor."""
    whole = np.zeros((6, 6))
    height = 0.0
    nodes, weights = np.polynomial.legendre.leggauss(4)
    for layer in layers:
        stiffness = np.linalg.inv(_turned(layer, 0.0)) if not bar else np.diag([layer.ex, layer.ey, layer.g])
        stiffness = stiffness * (1 + stiffer * layer.loss_factor)
        for node, weight in zip(nodes, weights):
            z = height + layer.thickness * (node + 1) / 2
            whole += weight * layer.thickness / 2 * np.kron(np.array([[1, z], [z, z * z]]), stiffness)
        height += layer.thickness
    # In units of the height, or the inverse loses digits.
    units = np.repeat([1.0, height], 3)
    inverse = np.linalg.inv(whole / np.outer(units, units) / whole[0, 0])
    return np.linalg.inv(inverse[3:, 3:]) * whole[0, 0] * height**2


def _bending(layers, bar, stiffer=0.0):
    """(D11, D12, D22, D66) of all stacks, each about its own neutral plane."""
    stacks = []
    for layer in layers:
        if layer.slips or not stacks:
            stacks.append([])
        stacks[-1].append(layer)
    total = sum(_stack(stack, bar, stiffer) for stack in stacks)
    return np.array([total[0, 0], total[0, 1], total[1, 1], total[2, 2]])


def along(bending, angle):
    """Stiffness against waves along a direction: D11 c^4 + 2 (D12 + 2 D66) c^2 s^2 + D22 s^4, of `bending` [..., 4]."""
    d11, d12, d22, d66 = np.moveaxis(np.asarray(bending), -1, 0)[..., None]
    c, s = np.cos(angle) ** 2, np.sin(angle) ** 2
    return d11 * c * c + 2 * (d12 + 2 * d66) * c * s + d22 * s * s


def directions():
    """Directions of a quarter turn, in rad."""
    return np.linspace(0, np.pi / 2, DIRECTIONS, endpoint=False) + np.pi / 4 / DIRECTIONS


@dataclass(frozen=True)
class Laminate:
    """What layers are together; of a bar D11 is E I over the width."""

    thickness: float
    weight: float
    bending: tuple[float, float, float, float]
    loss_factor: float

    @staticmethod
    def of(layers, bar):
        """Of layers from the bottom to the top."""
        bending = _bending(layers, bar)
        lost = (_bending(layers, bar, STEP) - _bending(layers, bar, -STEP)) / (2 * STEP)
        mean = lambda of: of[0] if bar else along(of, directions()).mean()
        weight = sum(layer.thickness * layer.density for layer in layers)
        return Laminate(sum(layer.thickness for layer in layers), weight, tuple(bending), float(mean(lost) / mean(bending)))

    def softest(self, bar):
        """Least stiffness against waves in any direction."""
        return self.bending[0] if bar else float(along(self.bending, np.linspace(0, np.pi / 2, DIRECTIONS)).min())


def isotropic(rigidity, nu):
    """(D11, D12, D22, D66) of a plate that is the same in all directions."""
    return rigidity, nu * rigidity, rigidity, (1 - nu) / 2 * rigidity
