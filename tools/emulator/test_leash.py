"""Tests of the leash: what a command has started ends with whoever holds the pipe, and its status goes through."""

import pathlib
import signal
import subprocess
import sys
import time
import unittest

LEASH = [sys.executable, str(pathlib.Path(__file__).resolve().parent / "leash.py")]
WAIT_S = 30


def runs(pid):
    """Whether the process is there, and not only its entry until somebody has asked for its status."""
    try:
        state = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


class Leash(unittest.TestCase):
    def test_all_that_was_started_ends_with_the_pipe(self):
        holder = "import subprocess, sys; subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE).wait()"
        command = ["sh", "-c", "sleep 300 & echo $!; wait"]
        process = subprocess.Popen([sys.executable, "-c", holder, *LEASH, *command], stdout=subprocess.PIPE)
        started = int(process.stdout.readline())
        self.assertTrue(runs(started))
        # As nobody can answer it: the holder gets no chance to end anything.
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
        until = time.monotonic() + WAIT_S
        while runs(started) and time.monotonic() < until:
            time.sleep(0.05)
        self.assertFalse(runs(started))

    def test_the_status_goes_through(self):
        for status in (0, 3):
            process = subprocess.Popen([*LEASH, "sh", "-c", f"exit {status}"], stdin=subprocess.PIPE)
            self.assertEqual(process.wait(WAIT_S), status)
            process.stdin.close()


if __name__ == "__main__":
    unittest.main()
