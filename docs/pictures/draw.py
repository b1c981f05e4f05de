#!/usr/bin/env python3
"""Draws the manual's pictures: docs/src/images/*.svg.

    python3 docs/pictures/draw.py --era target/release/era      all pictures
    python3 docs/pictures/draw.py --only states,wiring          some of them
    python3 docs/pictures/draw.py --check                       whether those that need no program are up to date

Results (modes, maps, motions, drives) come from the program `era`, which runs for each picture; constants of the device come
from the sources that `sources.py` reads. A picture whose source has changed in form ends the script with a message.
"""

import argparse
import sys
from pathlib import Path

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


def check():
    """Ends the script with a message if a picture differs from what the sources say now."""
    stale = [
        name
        for name, draw in WITHOUT_PROGRAM.items()
        if (IMAGES / f"{name}.svg").read_text(encoding="utf-8") != draw(None).make_svg()
    ]
    if stale:
        sys.exit(f"the sources have changed: python3 docs/pictures/draw.py --only {','.join(stale)} draws the pictures again")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--era", type=Path, default=ROOT / "target/release/era", help="the program `era` (default: %(default)s)")
    parser.add_argument("--only", help="names of pictures, separated by commas")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if a picture that needs no program is out of date")
    options = parser.parse_args()
    if options.check:
        check()
        return
    names = options.only.split(",") if options.only else list(PICTURES)
    unknown = [name for name in names if name not in PICTURES]
    if unknown:
        parser.error(f"no picture {', '.join(unknown)}; there are {', '.join(PICTURES)}")
    era = Era(options.era)
    for name in names:
        text = PICTURES[name](era).make_svg()
        size = len(text.encode())
        if size > MOST_BYTES:
            sys.exit(f"{name}.svg has {size} bytes, more than {MOST_BYTES}: thin out its curves")
        (IMAGES / f"{name}.svg").write_text(text, encoding="utf-8")
        print(f"{name}.svg  {size / 1000:.1f} kB")


if __name__ == "__main__":
    main()
