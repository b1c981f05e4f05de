#!/usr/bin/env python3
"""Starts the emulator bridge, making its Python environment on first use. Needs nothing but Python 3 with `venv`.

usage: launch.py --elf PATH [further options of bridge.py]

Progress goes to stderr, the bridge's own output to stdout. `--setup-only` makes the environment and ends; `--self-test`
runs the tests of the emulated board itself against the image instead of the bridge; `--play-windows` plays a click's
windows on the image (play_windows.py).
"""

import fcntl
import os
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
REQUIREMENTS = HERE / "requirements.txt"
ENVIRONMENT = HERE.parents[1] / "target" / "emulator-venv"
PYTHON = ENVIRONMENT / "bin" / "python"
# Holds the requirements that the environment was made for; written last.
STAMP = ENVIRONMENT / "requirements.installed"


def say(text):
    print(f"emulator: {text}", file=sys.stderr, flush=True)


def is_ready():
    return PYTHON.exists() and STAMP.exists() and STAMP.read_text() == REQUIREMENTS.read_text()


def set_up():
    """Makes the environment; several processes may ask for it at once."""
    if is_ready():
        return
    ENVIRONMENT.parent.mkdir(parents=True, exist_ok=True)
    with open(ENVIRONMENT.parent / "emulator-venv.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if is_ready():
            return
        say(f"making its Python environment in {ENVIRONMENT} (once, about 20 s)")
        run([sys.executable, "-m", "venv", "--clear", str(ENVIRONMENT)],
            "cannot make a Python environment; on Debian and Ubuntu: apt install python3-venv")
        run([str(PYTHON), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r", str(REQUIREMENTS)],
            f"cannot install {REQUIREMENTS.read_text().strip()}; is the package index reachable?")
        STAMP.write_text(REQUIREMENTS.read_text())
        say("ready")


def run(command, hint):
    result = subprocess.run(command, stdout=sys.stderr, stdin=subprocess.DEVNULL)
    if result.returncode != 0:
        say(f"{hint} (exit code {result.returncode})")
        sys.exit(1)


def main():
    arguments = sys.argv[1:]
    if not arguments or "--help" in arguments or "-h" in arguments:
        print(__doc__)
        return
    set_up()
    if "--self-test" in arguments:
        elf = arguments[arguments.index("--elf") + 1] if "--elf" in arguments[:-1] else None
        if elf is None:
            say("--self-test needs --elf PATH")
            sys.exit(2)
        environment = {**os.environ, "ERA_ELF": os.path.abspath(elf)}
        os.chdir(HERE)
        tests = ["test_board", "test_overlays", "test_first_stage", "test_pulses", "test_registers", "test_pin_map", "test_leash"]
        os.execve(PYTHON, [str(PYTHON), "-m", "unittest", *tests], environment)
    if "--setup-only" not in arguments:
        program = "play_windows.py" if "--play-windows" in arguments else "bridge.py"
        os.execv(PYTHON, [str(PYTHON), str(HERE / program), *(word for word in arguments if word != "--play-windows")])


if __name__ == "__main__":
    main()
