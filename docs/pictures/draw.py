#!/usr/bin/env python3
"""Draws the manual's pictures: docs/src/images/*.svg.

    python3 docs/pictures/draw.py --era target/release/era      all pictures
    python3 docs/pictures/draw.py --only states,wiring          some of them
    python3 docs/pictures/draw.py --check                       whether those that need no program are up to date
    python3 docs/pictures/draw.py --check --era target/release/era      whether all pictures are up to date

Results (modes, maps, motions, drives) come from the program `era`, which runs for each picture; constants of the device come
from the sources that `sources.py` reads. A picture whose source has changed in form ends the script with a message.
"""

import argparse
import sys
from pathlib import Path

from compare import find_difference
from device import draw_data_flow, draw_silence, draw_states, draw_wiring
from mechanics import draw_cross_section, draw_mounts
from motion import draw_click, draw_waveforms
from panel import draw_modes, draw_node_lines, draw_node_lines_bar
from sources import ROOT, Era

# From the sources alone.
WITHOUT_PROGRAM = {
    "mounts": draw_mounts,
    "wiring": draw_wiring,
    "states": draw_states,
    "data-flow": draw_data_flow,
    "silence": draw_silence,
}
# From what the program computes.
WITH_PROGRAM = {
    "cross-section": draw_cross_section,
    "waveforms": draw_waveforms,
    "modes": draw_modes,
    "node-lines": draw_node_lines,
    "node-lines-bar": draw_node_lines_bar,
    "click": draw_click,
}
PICTURES = WITHOUT_PROGRAM | WITH_PROGRAM
IMAGES = ROOT / "docs/src/images"
MOST_BYTES = 60_000
DEFAULT_PROGRAM = ROOT / "target/release/era"


def check(pictures, era):
    """Prints which of `pictures` are up to date, and ends the script with a message if one differs from what the sources or the
    program say now."""
    stale = {}
    for name, draw in pictures.items():
        path = IMAGES / f"{name}.svg"
        difference = find_difference(path.read_text(encoding="utf-8"), draw(era).make_svg()) if path.exists() else "no such file"
        if difference is None:
            print(f"{name}.svg is up to date")
        else:
            stale[name] = difference
    if stale:
        lines = [f"{name}.svg, old and new: {difference}" for name, difference in stale.items()]
        program = f" --era {era.program}" if era else ""
        sys.exit("\n".join([*lines, f"draw them again: python3 docs/pictures/draw.py --only {','.join(stale)}{program}"]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--era", type=Path, help=f"the program `era` (default, except for --check: {DEFAULT_PROGRAM})")
    parser.add_argument("--only", help="names of pictures, separated by commas")
    parser.add_argument(
        "--check", action="store_true", help="write nothing; fail if a picture is out of date (without --era: one that needs no program)"
    )
    options = parser.parse_args()
    possible = WITHOUT_PROGRAM if options.check and options.era is None else PICTURES
    names = options.only.split(",") if options.only else list(possible)
    unknown = [name for name in names if name not in possible]
    if unknown:
        parser.error(f"no picture {', '.join(unknown)}; there are {', '.join(possible)}")
    if options.check:
        check({name: possible[name] for name in names}, Era(options.era) if options.era else None)
        return
    era = Era(options.era or DEFAULT_PROGRAM)
    for name in names:
        text = PICTURES[name](era).make_svg()
        size = len(text.encode())
        if size > MOST_BYTES:
            sys.exit(f"{name}.svg has {size} bytes, more than {MOST_BYTES}: thin out its curves")
        (IMAGES / f"{name}.svg").write_text(text, encoding="utf-8")
        print(f"{name}.svg  {size / 1000:.1f} kB")


if __name__ == "__main__":
    main()
