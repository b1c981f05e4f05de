"""`python -m crosscheck --era PATH`: random scenes through the program and through the reference, side by side."""

import os

# Before NumPy is loaded: one thread per worker process.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse
import sys
from pathlib import Path

from . import runner


def main():
    """Exit code 0 if everything holds (with --prove: if every planted mistake is found)."""
    parser = argparse.ArgumentParser(prog="python -m crosscheck", description=__doc__)
    parser.add_argument("--era", required=True, type=Path, help="the program's binary")
    parser.add_argument("--scenes", type=int, default=300, help="how many random scenes")
    parser.add_argument("--first", type=int, default=0, help="index of the first one, to go on where a run ended")
    parser.add_argument("--seed", type=int, default=1, help="of the random scenes")
    parser.add_argument("--only", type=int, help="one scene, by its index")
    parser.add_argument("--scene", type=Path, help="this scene file instead of random scenes; each index is another place on it")
    parser.add_argument("--elf", type=Path, help="firmware image: clicks are integrated from the pulses that it makes on the emulated board")
    parser.add_argument("--part", help="checks to run, by name, with commas between")
    parser.add_argument("--plant", metavar="QUANTITY", help="a mistake in this quantity: the run must fail")
    parser.add_argument("--prove", action="store_true", help="plant a mistake in every quantity, one after the other, and see it found")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    parser.add_argument("--work", type=Path, default=Path("target/crosscheck"), help="folder for scene files and the like")
    parser.add_argument("--verbose", action="store_true", help="every result, and the time of every check")
    options = parser.parse_args()
    options.era = options.era.resolve()
    return runner.prove(options) if options.prove else runner.run(options)


if __name__ == "__main__":
    sys.exit(main())
