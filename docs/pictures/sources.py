"""Where the numbers of the pictures come from: the program `era`, and the sources of the device logic."""

import ast
import csv
import io
import json
import re
import struct
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def read_source(path):
    """A file of the repository."""
    return (ROOT / path).read_text(encoding="utf-8")


def read_scene(name):
    """An example scene, as its TOML says it."""
    # Here, because Python has it from 3.11 on, and pictures without a scene need less.
    import tomllib

    return tomllib.loads(read_source(f"examples/scenes/{name}.toml"))


def read_constant(path, name):
    """The whole number that a Rust constant or field `name` has in the file `path`."""
    found = re.search(rf"\b{name}: (?:\w+ = )?([0-9][0-9_]*)\b", read_source(path))
    if found is None:
        raise SystemExit(f"{path} has no number {name}: adapt docs/pictures")
    return int(found.group(1).replace("_", ""))


def read_duration_ms(name):
    """A duration of `REAL_TIME` in host/src/device/timing.rs, in ms."""
    path = "host/src/device/timing.rs"
    text = read_source(path).split("pub const REAL_TIME", 1)[1]
    found = re.search(rf"\b{name}: Duration::from_millis\(([0-9_]+)\)", text)
    if found is None:
        raise SystemExit(f"{path} has no duration {name} in REAL_TIME: adapt docs/pictures")
    return int(found.group(1))


class Era:
    """The program `era`."""

    def __init__(self, program):
        self.program = program

    def run(self, *arguments):
        """Its standard output."""
        command = [str(self.program), *map(str, arguments)]
        result = subprocess.run(command, check=False, capture_output=True, text=True)
        if result.returncode != 0:
            raise SystemExit(f"{' '.join(command)} failed:\n{result.stderr}")
        return result.stdout

    def json(self, *arguments):
        return json.loads(self.run(*arguments, "--json"))

    def columns(self, *arguments):
        """The columns of a CSV on its standard output, by their names."""
        rows = list(csv.reader(io.StringIO(self.run(*arguments, "--csv", "-"))))
        start = next(index for index, row in enumerate(rows) if row and row[0] in ("x_mm", "time_s"))
        width = len(rows[start])
        values = []
        for row in rows[start + 1 :]:
            if len(row) != width:
                break
            values.append([float(value) for value in row])
        return dict(zip(rows[start], map(list, zip(*values, strict=True)), strict=True))

    def arrays(self, *arguments):
        """The arrays of `--npy`, as nested lists: the values, then those of its axes by name."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "values.npy"
            self.run(*arguments, "--npy", path)
            axes = {other.name.split(".")[1]: read_npy(other) for other in Path(folder).glob("values.*.npy")}
            return read_npy(path), axes


def read_npy(path):
    """A NumPy file of float64 or complex64 as nested lists."""
    data = path.read_bytes()
    length = struct.unpack("<H", data[8:10])[0]
    header = ast.literal_eval(data[10 : 10 + length].decode())
    body = data[10 + length :]
    kind = {"<f8": "d", "<f4": "f", "<c8": "f", "<c16": "d"}[header["descr"]]
    values = list(struct.unpack(f"<{len(body) // struct.calcsize(kind)}{kind}", body))
    if header["descr"].startswith("<c"):
        values = [complex(values[index], values[index + 1]) for index in range(0, len(values), 2)]

    def nest(shape, flat):
        if len(shape) == 1:
            return flat
        part = len(flat) // shape[0]
        return [nest(shape[1:], flat[index * part : (index + 1) * part]) for index in range(shape[0])]

    return nest(header["shape"], values)
