"""Plays a click's windows on the firmware image, and prints the pulses that its pins made of them.

usage: play_windows.py --elf PATH; on stdin {"rails_v": [V, V], "windows": [[channel, "a" | "b", begin_us, width_us], ...]}, and on stdout
{"rails_v": [V, V], "pulses": [[channel, "a" | "b", begin_us, width_us], ...]}: the rails as they stood when the first pulse began, and all
pulses by the oracle of pulses.py. Both count times from the windows' start.
"""

import json
import sys

from board_session import BoardSession
from pulses import CLOCK_HZ, OUTPUTS, WINDOW_TICK, list_pulses, rebuild_levels

# In a microsecond.
TICKS, CLOCKS = CLOCK_HZ // 1_000_000 // WINDOW_TICK, CLOCK_HZ // 1_000_000
# After the last window, in s.
REST_S = 0.01


def count_ticks(windows, channels):
    """For each channel its windows by time: electrode, ticks of wait since the window before, ticks of width."""
    counted = [[] for _ in range(channels)]
    ends = [0] * channels
    for channel, electrode, begin_us, width_us in sorted(windows, key=lambda window: window[2]):
        begin, width = round(begin_us * TICKS), round(width_us * TICKS)
        counted[channel].append((electrode, begin - ends[channel], width))
        ends[channel] = begin + width
    return counted


def main():
    request, elf = json.load(sys.stdin), sys.argv[sys.argv.index("--elf") + 1]
    session = BoardSession(elf)
    machine, first_us = session.machine, min(window[2] for window in request["windows"])
    millivolts = [int(volts * 1000) for volts in request["rails_v"]]
    earliest, latest = session.play_windows(count_ticks(request["windows"], len(OUTPUTS)), millivolts)
    session.run_for((earliest - machine.clock) / CLOCK_HZ + first_us / 1e6)
    rails = list(machine.supply.rails)
    last_us = max(begin_us + width_us for _, _, begin_us, width_us in request["windows"])
    session.run_for((latest - machine.clock) / CLOCK_HZ + last_us / 1e6 + REST_S)
    levels = rebuild_levels(session.snapshots, machine.clock).values()
    pulses = [(channel, *pulse) for channel, own in enumerate(levels) for pulse in list_pulses(own, earliest, machine.clock)]
    if not pulses:
        sys.exit("the board played nothing")
    # The start that the board has told is known to some us; the first pulse tells it to the clock, as far as it is within that.
    start = min(begin for _, _, begin, _ in pulses) - round(first_us * CLOCKS)
    if not earliest <= start <= latest:
        sys.exit(f"the windows began {(start - earliest) / CLOCKS:.1f} us after the earliest time that the board had told")
    timed = [(channel, electrode, (begin - start) / CLOCKS, (end - begin) / CLOCKS) for channel, electrode, begin, end in pulses]
    json.dump({"rails_v": rails, "pulses": timed}, sys.stdout)
    machine.close()


if __name__ == "__main__":
    main()
