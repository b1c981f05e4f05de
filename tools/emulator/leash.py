#!/usr/bin/env python3
"""Runs a command, and ends it with all that it has started when standard input ends: whoever held its other end is gone.

usage: leash.py COMMAND [ARGUMENT...]

A program that is killed cannot end what it started; the end of its pipe is noticed however it went.
"""

import os
import signal
import subprocess
import sys
import threading


def watch(child):
    """Waits for the end of standard input; a group of its own has in it what the command starts."""
    while os.read(0, 4096):
        pass
    try:
        os.killpg(child.pid, signal.SIGTERM)
    except ProcessLookupError:
        pass


def main():
    if len(sys.argv) < 2:
        print(__doc__)
        sys.exit(2)
    # Ctrl-C ends whoever holds the pipe, and the pipe with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    child = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL, start_new_session=True)
    threading.Thread(target=watch, args=(child,), daemon=True).start()
    status = child.wait()
    sys.exit(status if status >= 0 else 128 - status)


if __name__ == "__main__":
    main()
