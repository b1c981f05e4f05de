"""`era modes`: what the layers of a surface are together."""

import numpy as np

from ..harness import Result, change_layers

QUANTITIES = ("stiffness of layers", "weight of layers", "loss of layers")
PLANTS = {
    "stiffness of layers": change_layers("thickness_mm", 1.0001),
    "weight of layers": change_layers("density_kg_m3", 1.0001),
    "loss of layers": change_layers("loss_factor", 1.01),
}
# Both sides have all digits but a few: the reference inverts a matrix of six.
TOLERANCE = 1e-8
# A frequency of which nothing is asked.
MAX_HZ = 1.0


def run(context):
    """Compares rigidities, mass per area and loss factor, where there are layers."""
    wanted = context.scene.laminate
    if wanted is None:
        return []
    got = context.era.json("modes", "--max-hz", MAX_HZ)["layers"]
    if context.scene.is_bar:
        found, expected = [got["bending_stiffness_n_m2"]], [wanted.bending[0] * context.scene.width]
    else:
        found, expected = [got[f"d{which}_n_m"] for which in (11, 12, 22, 66)], wanted.bending
    off = np.abs(np.subtract(found, expected)).max() / max(expected)
    weight = abs(got["mass_kg_per_m2"] / wanted.weight - 1)
    # By a difference quotient.
    loss = abs(got["loss_factor"] - wanted.loss_factor)
    return [
        Result("stiffness of layers", context.name, off, TOLERANCE),
        Result("weight of layers", context.name, weight, TOLERANCE),
        Result("loss of layers", context.name, loss, 1e-7 + 1e-6 * wanted.loss_factor),
    ]
