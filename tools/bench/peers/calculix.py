"""CalculiX on the same plate: shell elements S8R, steady-state dynamics over modes, one load. Prints one JSON document.

CalculiX makes solids of its shells, so that its plate has shear and membrane motion too (the latter's rigid part is held),
and it chooses its own frequencies, `--between` from each of its modes to the next.
"""

import argparse
import json
import os
import re
import subprocess
import time

import common
import numpy as np


def deck(scene, cells, modes, frequencies_hz, between):
    """The input file, and the mesh's corner nodes with their places."""
    surface, material = scene["surface"], scene["surface"]["material"]
    (nx, ny), (length, width) = cells, (surface["length_m"], surface["width_m"])
    # Corners and mid-sides: every place of the half-step grid but the cells' centres.
    number, places = {}, {}
    for j in range(2 * ny + 1):
        for i in range(2 * nx + 1):
            if i % 2 == 0 or j % 2 == 0:
                number[i, j] = len(number) + 1
                places[number[i, j]] = (length * i / (2 * nx), width * j / (2 * ny))
    lines = ["*NODE, NSET=PANEL"] + [f"{k},{x:.12g},{y:.12g},0" for k, (x, y) in places.items()]
    lines += ["*ELEMENT, TYPE=S8R, ELSET=PLATE"]
    element = 0
    for j in range(0, 2 * ny, 2):
        for i in range(0, 2 * nx, 2):
            element += 1
            around = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
            lines.append(f"{element}," + ",".join(str(number[i + a, j + b]) for a, b in around))
    ground, attached = len(number), []

    def node_at(x, y):
        i, j = round(x / length * 2 * nx), round(y / width * 2 * ny)
        if abs(i * length / (2 * nx) - x) + abs(j * width / (2 * ny) - y) > 1e-9 or i % 2 or j % 2:
            raise SystemExit(f"no corner node of the mesh at {x}, {y} m")
        return number[i, j]

    def attach(kind, card, own, value):
        nonlocal element
        element += 1
        nodes = f"{own}" if kind == "MASS" else f"{own},{attached[-1]}"
        card = f"*{card}, ELSET=E{element}"
        # Of an integer CalculiX would think that it is a degree of freedom.
        body = [repr(float(value))] if kind == "MASS" else ["", repr(float(value))]
        lines.extend([f"*ELEMENT, TYPE={kind}, ELSET=E{element}", f"{element},{nodes}", card, *body])

    def hold(x, y, k, c):
        nonlocal ground
        ground += 1
        lines.extend(["*NODE", f"{ground},{x:.12g},{y:.12g},-0.1"])
        attached.append(ground)
        attach("SPRINGA", "SPRING", node_at(x, y), k)
        attach("DASHPOTA", "DASHPOT", node_at(x, y), c)

    for support in scene["supports"]:
        hold(support["x_m"], support["y_m"], support["stiffness_n_per_m"], support["damping_n_s_per_m"])
    for era in scene["actuators"]:
        hold(era["x_m"], era["y_m"], era["stiffness_n_per_m"], era["damping_n_s_per_m"])
        attach("MASS", "MASS", node_at(era["x_m"], era["y_m"]), era["moving_mass_kg"] + era["housing_mass_kg"])
    corner, other = number[0, 0], number[2 * nx, 0]
    load = node_at(scene["actuators"][0]["x_m"], scene["actuators"][0]["y_m"])
    corners = {number[i, j]: places[number[i, j]] for i in range(0, 2 * nx + 1, 2) for j in range(0, 2 * ny + 1, 2)}
    lines += [
        "*MATERIAL, NAME=OWN", "*ELASTIC", f"{material['youngs_modulus_pa']:.12g},{material['poisson_ratio']:.12g}",
        "*DENSITY", f"{material['density_kg_m3']:.12g}",
        f"*DAMPING, STRUCTURAL={surface['damping']['loss_factor']:.12g}",
        "*SHELL SECTION, ELSET=PLATE, MATERIAL=OWN", f"{surface['thickness_m']:.12g}",
        "*BOUNDARY", f"{corner},1,2", f"{other},2,2", *(f"{k},1,3" for k in attached),
        "*STEP", "*FREQUENCY, STORAGE=YES", f"{modes}", "*END STEP",
        "*STEP", "*STEADY STATE DYNAMICS", f"{frequencies_hz[0]:.12g},{frequencies_hz[-1]:.12g},{between},1.",
        "*CLOAD", f"{load},3,1.", "*NODE FILE", "PU", "*END STEP", "",
    ]
    return "\n".join(lines), corners


def accelerations(path, corners):
    """Frequencies, and accelerations across the panel at its mid-plane, [frequency][place of `corners`], from magnitudes and
    phases of displacements. The nodes are those of the solids that CalculiX makes of its shells."""
    key = lambda x, y: (round(x * 1e5), round(y * 1e5))
    wanted = {key(x, y): k for k, (x, y) in enumerate(corners)}
    place, frequencies, blocks, block, in_nodes = {}, [], [], None, False
    with open(path, encoding="ascii") as file:
        for line in file:
            start = line[:3]
            if line.startswith("    2C"):
                in_nodes = True
            elif line.startswith("  100CL"):
                frequency = float(line[12:24])
            elif line.startswith(" -4  PDISP"):
                block = np.full(len(corners), np.nan, dtype=complex)
            elif start == " -1" and in_nodes:
                x, y, z = (float(line[13 + 12 * k : 25 + 12 * k]) for k in range(3))
                if abs(z) < 1e-6 and key(x, y) in wanted:
                    place[line[3:13]] = wanted[key(x, y)]
            elif start == " -1" and block is not None and line[3:13] in place:
                magnitude, phase = float(line[37:49]), float(line[73:85])
                block[place[line[3:13]]] = magnitude * np.exp(1j * np.deg2rad(phase))
            elif start == " -3":
                in_nodes = False
                if block is not None:
                    frequencies.append(frequency)
                    blocks.append(-((2 * np.pi * frequency) ** 2) * block)
                    block = None
    blocks = np.array(blocks)
    if not frequencies or np.isnan(blocks).any():
        raise SystemExit("CalculiX left out nodes or frequencies")
    return frequencies, blocks


def version(text):
    found = re.search(r"CalculiX Version ([0-9.]+)", text)
    return found.group(1) if found else "unknown"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problem")
    parser.add_argument("folder", help="where the deck and its results are written")
    parser.add_argument("--mesh", default="12x8")
    parser.add_argument("--modes", type=int, default=60)
    parser.add_argument("--between", type=int, default=40, help="frequencies from one mode to the next")
    parser.add_argument("--ccx", default="ccx")
    options = parser.parse_args()
    with open(options.problem, encoding="utf-8") as file:
        problem = json.load(file)
    common.refuse(problem["scene"])
    if problem["scene"]["masses"] or any(era["mount"] != "grounded" for era in problem["scene"]["actuators"]):
        raise SystemExit("masses and inertial ERAs are not written here")
    cells = tuple(int(part) for part in options.mesh.split("x"))
    text, corners = deck(problem["scene"], cells, options.modes, problem["frequencies_hz"], options.between)
    os.makedirs(options.folder, exist_ok=True)
    with open(os.path.join(options.folder, "plate.inp"), "w", encoding="utf-8") as file:
        file.write(text)
    started = time.perf_counter()
    run = subprocess.run([options.ccx, "plate"], cwd=options.folder, capture_output=True, text=True, check=False)
    elapsed = time.perf_counter() - started
    if run.returncode or "Job finished" not in run.stdout:
        raise SystemExit(f"{options.ccx} ended with {run.returncode}: {run.stdout[-800:]}")
    frequencies, blocks = accelerations(os.path.join(options.folder, "plate.frd"), list(corners.values()))
    equations = re.search(r"number of equations\s+(\d+)", run.stdout)
    print(json.dumps({
        "version": version(run.stdout), "mesh": options.mesh, "unknowns": int(equations.group(1)) if equations else 0,
        "elapsed_s": elapsed, "frequencies_hz": frequencies, "x_m": [at[0] for at in corners.values()],
        "y_m": [at[1] for at in corners.values()], "acceleration_re": blocks.real.tolist(),
        "acceleration_im": blocks.imag.tolist(),
    }))


if __name__ == "__main__":
    main()
