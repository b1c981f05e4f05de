"""The thesis' Table 1 in SciPy: an explicit solver, and equations 15 to 21 in NumPy. Prints one JSON document.

The systems come from the other side, with the answer to compare with.
"""

import argparse
import json
import time

import common  # noqa: F401, before NumPy
import numpy as np
from scipy.integrate import solve_ivp


def explicit(m, c, k, force, omega, times):
    """Runge and Kutta's pair of orders 5 and 4 (Dormand and Prince), as ode45, with its default tolerances."""
    n, mass = len(force), np.diag(m)
    lower = -np.hstack([k / mass[:, None], c / mass[:, None]])
    push = force / mass

    def rate(t, state):
        return np.concatenate([state[n:], lower @ state + push * np.sin(omega * t)])

    return solve_ivp(rate, (times[0], times[-1]), np.zeros(2 * n), "RK45", times, rtol=1e-3, atol=1e-6).y[:n].T


def published(m, c, k, force, omega, times):
    """Equations 15 to 21."""
    n, zero = len(force), np.zeros(len(force))
    dynamic, lossy = k - omega**2 * m, omega * c
    # A sine: the force is F sin(w t), so that it stands in the second row.
    pq = np.linalg.solve(np.block([[dynamic, lossy], [-lossy, dynamic]]), np.concatenate([zero, force]))
    p, q = pq[:n], pq[n:]
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(m, k), -np.linalg.solve(m, c)]])
    s, v = np.linalg.eig(state)
    a = np.linalg.solve(v, np.concatenate([-p, -omega * q]))
    free = (np.exp(times[:, None] * s) @ (v[:n] * a).T).real
    return np.outer(np.cos(omega * times), p) + np.outer(np.sin(omega * times), q) + free


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("systems")
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    with open(options.systems, encoding="utf-8") as file:
        data = json.load(file)
    times, results = np.arange(data["count"]) * data["step_s"], []
    for system in data["systems"]:
        m, c, k = (np.array(system[name]) for name in "mck")
        answer = np.fromfile(system["answer"]).reshape(len(times), len(m))
        result = {}
        for name, solve in (("explicit", explicit), ("published", published)):
            elapsed = []
            for _ in range(options.runs):
                started = time.perf_counter()
                found = solve(m, c, k, np.array(system["force"]), data["omega_rad_s"], times)
                elapsed.append(time.perf_counter() - started)
            result[name + "_s"] = float(np.median(elapsed))
            result[name + "_error"] = float(np.abs(found - answer).max() / np.abs(answer).max())
        results.append(result)
    print(json.dumps(results))


if __name__ == "__main__":
    main()
