"""Poles of a damped panel: the state-space eigenproblem of the thesis (equation 16), of the reference's own mesh, with all of its coordinates.

    s (x, s x) = [[0, I], [-M^-1 (K + j H), -M^-1 C]] (x, s x)

H is the hysteretic part of the stiffness: with it poles are those with Im s > 0. Which pole belongs to which undamped mode: all damping is
raised in small steps, and each pole goes to the nearest of those of the step before, moved on as they moved last; where two are nearly as near, nothing is said.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

# The local compliance has no mass, and modes have none of it: a lossy support gives way by 1 / (1 + j eta) of what it would, which is a motion of
# that. It gets mass enough for this frequency: at 400 Hz it is off by 4e-6 of itself.
LOCAL_HZ = 2e5
# Steps from damping that does next to nothing to all of it.
STEPS = 30
# How much nearer the own one has to be than any other.
CLEAR = 3.0
# Part of its modulus below which an imaginary part counts as none.
REAL = 1e-7


def modal(model):
    """Squared frequencies, viscous and hysteretic matrices over all modes of one of a panel's meshes."""
    mass = model.mass.copy()
    local = np.arange(model.size)[model.local_part]
    mass[local, local] += (2 * np.pi * LOCAL_HZ) ** -2
    omega, phi = model._eigen(mass, model.stiffness, model.size)
    omega = omega.copy()
    omega[: model.free_motions] = 0.0
    project = lambda matrix: phi.T @ matrix @ phi
    return omega**2, project(model.viscous), project(model.hysteretic)


def eigenvalues(squares, viscous, hysteretic, part=1.0):
    """All s in 1/s with `part` of the damping."""
    count = len(squares)
    # About the middle of what is asked for, so that heavy dashpots leave slow poles their digits; in units of it.
    unit = np.sqrt(np.median(squares[squares > 0]))
    stiffness = (np.diag(squares) + 1j * part * hysteretic) / unit**2 if hysteretic.any() else np.diag(squares) / unit**2
    # Velocities and displacements of stiff coordinates are of one size in units of each one's own frequency.
    own = np.sqrt(squares / unit**2 + 1)
    top = np.hstack([np.zeros((count, count)), np.diag(own)])
    bottom = np.hstack([-stiffness / own[None, :], -part * viscous / unit])
    inverse = np.linalg.inv(np.vstack([top, bottom]) - np.eye(2 * count))
    return unit * (1 + 1 / np.linalg.eigvals(inverse))


def followed(squares, viscous, hysteretic, count):
    """For each of the first `count` modes the pole that it becomes and whether that is sure: as long as it swings."""
    omega = np.sqrt(squares[:count])
    known, before = 1j * omega, 1j * omega
    sure = omega > 0
    parts = np.geomspace(min(1e-6, 1e-3 * omega[sure].min(initial=1.0) / max(np.abs(viscous).max(), 1e-9)), 1.0, STEPS)
    for part in parts:
        values = eigenvalues(squares, viscous, hysteretic, part)
        swinging = values[values.imag > REAL * np.abs(values)]
        if len(swinging) < 2:
            return known, np.zeros(count, bool)
        expected = known + (known - before)
        distance = np.abs(expected[:, None] - swinging[None, :])
        if len(swinging) < count:
            return known, np.zeros(count, bool)
        row, column = linear_sum_assignment(distance)
        nearest = np.sort(distance, axis=1)[:, :2]
        own = distance[row, column]
        sure = sure & (own <= nearest[:, 0] * (1 + 1e-12)) & (own * CLEAR < nearest[:, 1])
        before, known = known, swinging[column]
    return known, sure
