"""Random panels in front of sealed air whose exact solution is known (`levy.py`): two opposite sides pinned, points attached inside.

Sizes are odd, points lie anywhere, and everything that a bound may depend on is there: ERAs of both mounts, springs, masses, layers, losses, air
from soft to stiff, a finger, an end that is cut off, a patch that is like its surface.
"""

import numpy as np

from .random_scenes import MATERIALS, log_uniform


def make(rng):
    """A scene's table, and that of the same panel in the reference's own words: without the end that is cut off and without the patch."""
    length, width = log_uniform(rng, 60, 1200), log_uniform(rng, 60, 1200)
    if max(length, width) > 4 * min(length, width):
        width = length * rng.uniform(0.4, 1.6)
    e, rho, nu = MATERIALS[rng.integers(len(MATERIALS))]
    a, b = length * 1e-3, width * 1e-3
    count = log_uniform(rng, 1.0, 15)
    thickness = a * b * 200 * np.sqrt(12 * rho * (1 - nu**2) / e) / count
    thickness = float(f"{np.clip(thickness, 1e-4, min(a, b) / 15) * 1e3:.4g}")
    rigidity = e * (thickness * 1e-3) ** 3 / (12 * (1 - nu**2))
    weight = rho * a * b * thickness * 1e-3
    # What the panel gives way at a point with, about.
    own_stiffness = 80 * rigidity / max(a, b) ** 2
    surface = {"kind": "plate", "length_mm": length, "width_mm": width, "thickness_mm": thickness}
    surface["material"] = {"youngs_modulus_pa": e, "density_kg_m3": rho, "poisson_ratio": nu}
    table = {"version": 1, "name": "sealed panel", "surface": surface}
    if rng.random() < 0.25:
        table["layer"] = _layers(rng, e, rho, nu, thickness)
        del surface["thickness_mm"], surface["material"]
    kind = rng.choice(["none", "loss_factor", "rayleigh"], p=[0.2, 0.5, 0.3])
    if kind == "loss_factor":
        surface["damping"] = {"loss_factor": log_uniform(rng, 3e-4, 0.1)}
    elif kind == "rayleigh":
        surface["damping"] = {"rayleigh_alpha": log_uniform(rng, 0.1, 20), "rayleigh_beta": log_uniform(rng, 1e-7, 1e-5)}

    along_x = rng.random() < 0.5
    pinned, others = (("left", "right"), ("top", "bottom")) if along_x else (("top", "bottom"), ("left", "right"))
    table["edge"] = [{"side": side, "kind": "pinned"} for side in pinned]
    held = {side: str(rng.choice(["free", "pinned", "clamped", "elastic"])) for side in others}
    for side, kind in held.items():
        if kind == "elastic":
            per_metre = own_stiffness / max(a, b) * log_uniform(rng, 0.03, 30)
            edge = {"side": side, "kind": kind, "stiffness_n_per_m2": per_metre, "rotational_stiffness_n_per_rad": rng.choice([0.0, rigidity / max(a, b) * log_uniform(rng, 0.1, 10)])}
            if rng.random() < 0.5:
                edge["loss_factor"] = log_uniform(rng, 0.01, 1.0)
            table["edge"].append(edge)
        elif kind != "free":
            table["edge"].append({"side": side, "kind": kind})

    taken = []

    def place():
        # Mostly well inside, at times near a side, and none so near to another that the two are one.
        for _ in range(1000):
            low = 0.01 if rng.random() < 0.2 else 0.08
            x, y = (side * rng.uniform(low, 1 - low) for side in (length, width))
            if all(np.hypot(x - u, y - v) > 0.03 * min(length, width) for u, v in taken):
                taken.append((x, y))
                return {"x_mm": x, "y_mm": y}
        raise ValueError("no place")

    supports = []
    for _ in range(rng.integers(0, 4)):
        support = place() | {"stiffness_n_per_m": own_stiffness * log_uniform(rng, 0.03, 1e5 if rng.random() < 0.2 else 30), "damping_n_s_per_m": 0.0}
        if rng.random() < 0.5:
            support["damping_n_s_per_m"] = log_uniform(rng, 1e-3, 0.1) * np.sqrt(weight * own_stiffness)
        if rng.random() < 0.3:
            support["loss_factor"] = log_uniform(rng, 0.02, 1.0)
        supports.append(support)
    masses = [place() | {"mass_g": 1e3 * weight * log_uniform(rng, 0.003, 0.5)} for _ in range(rng.integers(0, 3))]
    actuators = []
    for number in range(rng.integers(1, 5)):
        moving = weight * log_uniform(rng, 0.003, 0.1)
        stiffness = moving * (2 * np.pi * log_uniform(rng, 50, 300)) ** 2
        era = {"id": f"era{number}"} | place() | {"mount": str(rng.choice(["inertial", "grounded"])), "moving_mass_g": moving * 1e3}
        era |= {"stiffness_n_per_m": stiffness, "damping_n_s_per_m": 2 * log_uniform(rng, 0.003, 0.1) * np.sqrt(stiffness * moving)}
        era |= {"electrode_area_mm2": 500.0, "air_gap_um": 500.0, "max_voltage_v": 1000.0}
        if rng.random() < 0.4:
            era["housing_mass_g"] = moving * 1e3 * rng.uniform(0.1, 2)
        actuators.append(era)
    # Of the stiffness that holds the mean, four times what a pinned panel has at a point.
    air = log_uniform(rng, 0.05, 100) * 4 * own_stiffness
    table["air"] = {"sealed_depth_mm": float(np.clip(1.4 * 101325.0 * a * b / air * 1e3, 0.01, 1e4))}
    if rng.random() < 0.3:
        table["air"]["added_mass_kg_per_m2"] = weight / (a * b) * log_uniform(rng, 0.01, 0.5)
    table |= {"support": supports, "mass": masses, "actuator": actuators}
    if rng.random() < 0.4:
        stiffness = own_stiffness * log_uniform(rng, 0.01, 1.0)
        mass = weight * log_uniform(rng, 0.01, 0.3)
        table["finger"] = {
            "mass_g": min(mass * 1e3, 1000.0),
            "damping_n_s_per_m": min(2 * log_uniform(rng, 0.1, 1.0) * np.sqrt(stiffness * mass), 1000.0),
            "stiffness_n_per_m": min(stiffness, 1e6),
        }
    table = {key: value for key, value in table.items() if value != []}
    return _in_other_words(rng, table, held, others, along_x, (length, width))


def _layers(rng, e, rho, nu, thickness):
    parts = rng.dirichlet(np.ones(int(rng.integers(1, 4)))) + 0.1
    layers = []
    for part in parts / parts.sum() * thickness:
        layer = {"thickness_mm": float(part), "material": {"youngs_modulus_pa": e, "density_kg_m3": rho, "poisson_ratio": nu}}
        if rng.random() < 0.6:
            ex, ey = e * log_uniform(rng, 0.3, 3), e * log_uniform(rng, 0.3, 3)
            layer["material"] = {"ex_pa": ex, "ey_pa": ey, "g_pa": np.sqrt(ex * ey) * rng.uniform(0.2, 0.5), "density_kg_m3": rho, "poisson_ratio": 0.25}
            layer["angle_deg"] = float(rng.choice([0.0, 90.0]))
        layers.append(layer)
    return layers


def _in_other_words(rng, table, held, others, along_x, size):
    """The table, and at times one that says the same with a cut-out over a free end, or with a patch that is like its surface."""
    own = dict(table)
    chosen = rng.random()
    if "layer" in table or chosen > 0.4:
        return own, table
    surface = table["surface"]
    if chosen < 0.2:
        if held[others[1]] != "free":
            return own, table
        # Longer by an end that is then cut off: at the bottom or at the right, so that places stay.
        key, extra = ("width_mm", "y_mm") if along_x else ("length_mm", "x_mm")
        more = rng.uniform(0.1, 0.4) * surface[key]
        cutout = {"x_mm": 0.0, "y_mm": 0.0, "length_mm": size[0], "width_mm": size[1]}
        cutout |= {extra: surface[key], key: more}
        return own, table | {"surface": surface | {key: surface[key] + more}, "cutout": [cutout]}
    start = [side * rng.uniform(0.1, 0.6) for side in size]
    patch = {"x_mm": start[0], "y_mm": start[1], "length_mm": size[0] * rng.uniform(0.1, 0.39), "width_mm": size[1] * rng.uniform(0.1, 0.39)}
    return own, table | {"patch": [patch | {"thickness_mm": surface["thickness_mm"]}]}
