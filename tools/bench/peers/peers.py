"""Peers of the panel model: the same plate in SciPy, three ways. Prints one JSON document.

direct      the complex sparse matrix factored and solved at every frequency (scipy.sparse.linalg.splu)
modal       60 modes (scipy.sparse.linalg.eigsh, shift-invert); dashpots and springs coupled through the small receptance of
            the points they act at, all frequencies in one matrix product
modal+2     the same with two residual vectors for each load and dashpot
real        equation 15 of the thesis as written: a dense real matrix of twice the unknowns at every frequency (numpy)

`direct` and `real` are timed at some frequencies, and their sweep is the median of those times the number of
frequencies; half of them are the ones at which the mesh's answer is worst, so that their error is the whole sweep's.
"""

import argparse
import json
import time

import common  # noqa: F401, before NumPy
import numpy as np
import scipy
import scipy.sparse.linalg as sla
from plate import Plate, Problem

# A negative shift of 100 Hz keeps K - sigma M definite whatever holds the plate.
SHIFT = -((2 * np.pi * 100) ** 2)
MODES = 60


def direct(plate, problem, at):
    """Accelerations at the frequencies `at`, and the time of each."""
    stiff = plate.stiffness + 1j * plate.loss_factor * plate.surface
    out, times = np.empty((problem.loads, plate.points.shape[0], len(at)), dtype=complex), []
    for column, f in enumerate(at):
        started = time.perf_counter()
        omega = 2 * np.pi * problem.frequencies_hz[f]
        matrix = (stiff + 1j * omega * plate.damping - omega**2 * plate.mass).tocsc()
        factor = sla.splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        u = factor.solve(plate.loads.astype(complex))
        out[:, :, column] = -(omega**2) * (plate.points @ u).T
        times.append(time.perf_counter() - started)
    return out, times


def real(plate, problem, at):
    """Equation 15: [K - w^2 M, w C; -w C, K - w^2 M] [p; q] = [F; 0], the loss factor as w C = eta K of the surface."""
    k, m = plate.stiffness.toarray(), plate.mass.toarray()
    c, s = plate.damping.toarray(), plate.loss_factor * plate.surface.toarray()
    out, times = np.empty((problem.loads, plate.points.shape[0], len(at)), dtype=complex), []
    force = np.vstack([plate.loads, np.zeros_like(plate.loads)])
    n = plate.unknowns
    for column, f in enumerate(at):
        started = time.perf_counter()
        omega = 2 * np.pi * problem.frequencies_hz[f]
        dynamic, lossy = k - omega**2 * m, omega * c + s
        pq = np.linalg.solve(np.block([[dynamic, lossy], [-lossy, dynamic]]), force)
        out[:, :, column] = -(omega**2) * (plate.points @ (pq[:n] - 1j * pq[n:])).T
        times.append(time.perf_counter() - started)
    return out, times


def basis(plate, residuals):
    """Squared frequencies and mass-normalised shapes: modes, and residual vectors for loads and dashpots."""
    # eigsh would factor by itself, but so that no one else can use it.
    shifted = (plate.stiffness - SHIFT * plate.mass).tocsc()
    factor = sla.splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    inverse = sla.LinearOperator(shifted.shape, factor.solve, matmat=factor.solve, dtype=float)
    start = np.random.default_rng(1).standard_normal(plate.unknowns)
    count = min(MODES, plate.unknowns - 2)
    lam, vectors = sla.eigsh(plate.stiffness, count, M=plate.mass, sigma=SHIFT, OPinv=inverse, v0=start)
    if not residuals:
        return lam, vectors
    beside = lambda b: b - plate.mass @ (vectors @ (vectors.T @ b))
    without = lambda z: z - vectors @ (vectors.T @ (plate.mass @ z))
    load, shapes = beside(np.hstack([plate.loads, plate.couplings[:, plate.c > 0].toarray()])), []
    for _ in range(residuals):
        z = without(factor.solve(load))
        z /= np.sqrt(np.einsum("ij,ij->j", z, plate.mass @ z))
        shapes.append(z)
        load = beside(plate.mass @ z)
    z = np.hstack(shapes)
    weights, turn = np.linalg.eigh(z.T @ (plate.mass @ z))
    kept = weights > 1e-12 * weights[-1]
    z = without(z @ (turn[:, kept] / np.sqrt(weights[kept])))
    more, turn = np.linalg.eigh(z.T @ (plate.stiffness @ z))
    return np.concatenate([lam, more]), np.hstack([vectors, z @ turn])


def modal(plate, problem, residuals):
    """Accelerations at all frequencies, and the times of setting up and of the sweep."""
    started = time.perf_counter()
    lam, vectors = basis(plate, residuals)
    couplings, loads, points = plate.couplings.T @ vectors, vectors.T @ plate.loads, plate.points @ vectors
    set_up = time.perf_counter() - started
    started = time.perf_counter()
    omega = 2 * np.pi * problem.frequencies_hz
    eta = plate.loss_factor
    inverse = 1 / (lam * (1 + 1j * eta) - omega[:, None] ** 2)
    # Dashpots, and springs, which have no part in the surface's loss factor.
    z = 1j * (omega[:, None] * plate.c - eta * plate.k)
    r = len(plate.k)
    own = (inverse @ (couplings.T[:, :, None] * couplings.T[:, None, :]).reshape(len(lam), r * r)).reshape(-1, r, r)
    across = (inverse @ (couplings.T[:, :, None] * loads[:, None, :]).reshape(len(lam), -1)).reshape(-1, r, problem.loads)
    forces = np.linalg.solve(np.eye(r) + z[:, :, None] * own, z[:, :, None] * across)
    q = inverse[:, :, None] * (loads - np.einsum("rn,frp->fnp", couplings, forces))
    q *= -(omega**2)[:, None, None]
    q = np.ascontiguousarray(q.transpose(1, 2, 0)).reshape(len(lam), -1)
    # Two real products cost half of a complex one with a real matrix made complex.
    answer = np.empty((points.shape[0], q.shape[1]), dtype=complex)
    answer.real, answer.imag = points @ q.real, points @ q.imag
    sweep = time.perf_counter() - started
    return answer.reshape(points.shape[0], problem.loads, -1).transpose(1, 0, 2), set_up, sweep


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problem")
    parser.add_argument("--meshes", nargs="+", default=["12x8", "24x16", "48x32"])
    parser.add_argument("--direct-most", type=int, default=48, help="most cells along x for the direct solution")
    parser.add_argument("--real-most", type=int, default=12, help="most cells along x for equation 15")
    parser.add_argument("--solves", type=int, default=8, help="frequencies at which the direct solution is timed")
    options = parser.parse_args()
    problem = Problem(options.problem)
    results = []

    def tell(method, plate, assembly, set_up, sweep, error, timed):
        results.append({
            "method": method, "mesh": "x".join(map(str, plate.cells)), "cells": plate.cells[0], "unknowns": plate.unknowns,
            "set_up_s": assembly + set_up, "sweep_s": sweep, "timed_frequencies": timed, "error": error,
        })

    count = len(problem.frequencies_hz)
    for mesh in options.meshes:
        cells = tuple(int(part) for part in mesh.split("x"))
        started = time.perf_counter()
        plate = Plate(problem, cells)
        assembly = time.perf_counter() - started
        for residuals, method in ((0, "modal"), (2, "modal+2")):
            runs = [modal(plate, problem, residuals) for _ in range(3 if cells[0] <= 48 else 1)]
            set_up, sweep = (float(np.median([run[k] for run in runs])) for k in (1, 2))
            answer = runs[-1][0]
            tell(method, plate, assembly, set_up, sweep, problem.error(answer), count)
        for method, run, most in (("direct", direct, options.direct_most), ("real", real, options.real_most)):
            if cells[0] <= most:
                half = options.solves // 2
                at = np.unique(np.concatenate([problem.worst(answer, half), np.linspace(0, count - 1, half).astype(int)]))
                solved, times = run(plate, problem, at)
                tell(method, plate, assembly, 0.0, float(np.median(times)) * count, problem.error(solved, at), len(at))
    print(json.dumps({"numpy": np.__version__, "scipy": scipy.__version__, "results": results}))


if __name__ == "__main__":
    main()
