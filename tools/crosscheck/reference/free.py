"""Motions that nothing resists, counted from what holds a panel."""

import numpy as np


def free_motions(scene):
    """How many motions nothing resists: of the surface, and of masses of inertial ERAs without springs."""
    return free_of_surface(scene) + sum(actuator.inertial and actuator.linear_stiffness <= 0 for actuator in scene.actuators)


def free_of_surface(scene):
    """The same of the surface alone."""
    rows = []
    add = lambda x, y: rows.append([1.0, x / scene.length - 0.5, 0.0 if scene.is_bar else y / scene.width - 0.5])
    turn = [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0 if scene.is_bar else 1.0]]
    for support in scene.supports:
        if support.stiffness > 0:
            add(support.x, support.y)
        if support.rotational_stiffness > 0:
            rows.extend(turn)
    for actuator in scene.actuators:
        if not actuator.inertial and actuator.linear_stiffness > 0:
            add(actuator.x, actuator.y)
    for edge in scene.edges:
        holds = edge.kind != "elastic" or edge.stiffness > 0
        turns = edge.kind == "clamped" or (edge.kind == "elastic" and edge.rotational_stiffness > 0)
        ends = {"left": [(0, 0), (0, 1)], "right": [(1, 0), (1, 1)], "top": [(0, 0), (1, 0)], "bottom": [(0, 1), (1, 1)]}[edge.side]
        for x, y in ends:
            if holds:
                add(x * scene.length, y * scene.width)
        if turns:
            rows.append(turn[0] if edge.side in ("left", "right") else turn[1])
    if scene.air_stiffness > 0:
        # The mean is the deflection at the middle of the area that is there.
        parts = [(scene.length * scene.width, scene.length / 2, scene.width / 2)]
        parts += [(-c.length * c.width, c.x + c.length / 2, c.y + c.width / 2) for c in scene.cutouts]
        area = sum(part for part, _, _ in parts)
        add(*(sum(part[0] * part[axis] for part in parts) / area for axis in (1, 2)))
    held = np.linalg.matrix_rank(np.array(rows), tol=1e-9) if rows else 0
    return (2 if scene.is_bar else 3) - int(held)
