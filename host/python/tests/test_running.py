"""While something is computed: other threads run, signals are heard, forks work; what comes back belongs to the caller."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import era
import numpy as np
import pytest

BAND = np.arange(40.0, 400.0)


def test_other_threads_run_meanwhile(plate: era.Scene) -> None:
    """The interpreter changes threads by itself once a quarter of an hour here, so that another one runs only where the lock is let go."""
    count, is_over = 0, threading.Event()

    def work() -> None:
        nonlocal count
        while not is_over.is_set():
            count += 1
            # Lets go of the lock for the one that waits.
            time.sleep(0.001)

    before_s = sys.getswitchinterval()
    other = threading.Thread(target=work)
    sys.setswitchinterval(1000.0)
    try:
        other.start()
        before = count
        era.sweep(plate, BAND)
        assert count > before
    finally:
        is_over.set()
        sys.setswitchinterval(before_s)
        other.join()


def test_many_threads_ask_at_once(plate: era.Scene) -> None:
    """The same table, made and asked by all at once; the setting for the whole surface is found once and waited for."""
    scene = plate.with_(actuator={"left": {"x_mm": 71.5}})

    def ask(_: int) -> object:
        return era.plan(scene, (0.1, 0.05), objective="reach").to_dict()["drives"]

    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(ask, range(12)))
    assert all(drives == found[0] for drives in found)


LONG = """
import era
import sys
import threading

# No change of threads but where the lock is let go: the other one tells that the call is under way.
sys.setswitchinterval(1000.0)
is_next = threading.Event()
threading.Thread(target=lambda: is_next.wait() and print("started", flush=True), daemon=True).start()
try:
    is_next.set()
    {call}
except KeyboardInterrupt:
    # The interpreter is as it was.
    print("interrupted", len(era.modes(era.Scene.example("bar"), 200.0)), flush=True)
else:
    print("finished", flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of Unix")
@pytest.mark.parametrize(
    "call",
    [
        # Hours.
        "era.verify(era.Scene.example('plate'), points=100_000)",
        # Minutes.
        "era.sweep(era.Scene.example('plate'), [30.0 * k for k in range(1, 100)], grid=(400, 400), tolerance=1e-8)",
    ],
)
def test_interrupts_are_heard(call: str) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", LONG.format(call=call)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert child.stdout is not None and child.stdout.readline() == "started\n"
    try:
        child.send_signal(signal.SIGINT)
        output, errors = child.communicate(timeout=600)
    finally:
        child.kill()
    assert output.startswith("interrupted ") and int(output.split()[1]) > 0, (output, errors)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of Unix")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_computes(plate: era.Scene) -> None:
    """Threads are not forked: whoever waited for its parent's would wait for ever."""
    expected = era.modes(plate, 300.0).frequency_hz
    drives = era.plan(plate, (0.1, 0.05)).to_dict()["drives"]
    child = os.fork()
    if child == 0:
        same = np.array_equal(era.modes(plate, 300.0).frequency_hz, expected)
        same = same and era.plan(plate, (0.1, 0.05)).to_dict()["drives"] == drives
        os._exit(0 if same else 3)
    signal.alarm(600)
    _, status = os.waitpid(child, 0)
    signal.alarm(0)
    assert os.waitstatus_to_exitcode(status) == 0


def test_results_are_read_only_and_outlive_their_owner(plate: era.Scene) -> None:
    values = era.response(plate, (0.1, 0.05), BAND).acceleration_m_s2_per_n
    assert values.flags.c_contiguous and not values.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        values[0, 0] = 0.0
    assert np.isfinite(values).all()


def test_frequencies_of_any_kind(plate: era.Scene) -> None:
    expected = era.response(plate, (0.1, 0.05), [50.0, 70.0, 90.0]).acceleration_m_s2_per_n
    for given in (
        np.array([50, 70, 90]),
        np.array([50, 70, 90], dtype=np.float32),
        np.arange(50.0, 100.0, 10.0)[::2],
        (50, 70, 90),
        range(50, 100, 20),
    ):
        found = era.response(plate, (0.1, 0.05), given)
        np.testing.assert_array_equal(found.acceleration_m_s2_per_n, expected)
        assert found.frequency_hz.tolist() == [50.0, 70.0, 90.0]


def test_a_time_instead_of_a_tolerance(plate: era.Scene) -> None:
    found = era.modes(plate, 200.0, within_s=0.01)
    assert found.tolerance is None and found.tolerance_met is None
    assert np.isfinite(found.error_bound).all()
