"""A board at the other end of a pseudo-terminal, played by this program: it answers as docs/src/protocol.md says, keeps all
requests with the time at which they came, and can be told to answer badly.
"""

import os
import threading
import time
import tty

from . import frames, messages

CLOCK_HZ = 170_000_000


class Board:
    """`path` is what `era serve --device` is given. Use as a context manager."""

    def __init__(self, channels=4, tamper=None, deaf=()):
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self.channels = channels
        self.requests = []
        """(seconds, name, content, sequence), in order; repeated requests of one sequence number are all kept."""
        self._deaf = deaf
        self.tamper = tamper
        """For planted mistakes: (name, content) -> (name, content) that is taken to have come."""
        self.broken = []
        """What came in that is no frame."""
        self.spoil = {}
        """Name of a request -> function of its sequence number and the right answer's bytes, whose bytes are sent in place of
        the next answer, and then forgotten."""
        self.stubborn = False
        """Whether `spoil` is not forgotten."""
        self.achieved = []
        self.deadman_ms = 250
        self.silence_s = 0.0
        """Longest time between two requests while armed or running."""
        self.state = "safe"
        self._heard = None
        self._frames = 0
        self._start = time.monotonic()
        self._closing = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._closing = True
        os.close(self._slave)
        os.close(self._master)

    def now(self):
        """Seconds since the board started."""
        return time.monotonic() - self._start

    def named(self, *names, since=0.0):
        """(seconds, name, content) of the requests with these names."""
        return [(at, name, content) for at, name, content, _ in list(self.requests) if name in names and at >= since]

    def wait_for(self, names, since, seconds=3.0):
        """The first request with one of these names after `since`, or None."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found = self.named(*names, since=since)
            if found:
                return found[0]
            time.sleep(0.002)
        return None

    def inject(self, data):
        """Sends bytes that nobody asked for."""
        os.write(self._master, data)

    def _run(self):
        splitter = frames.Splitter()
        while not self._closing:
            try:
                data = os.read(self._master, 4096)
            except OSError:
                return
            for piece in splitter.feed(data):
                try:
                    frame, name, content = messages.request(piece)
                except frames.FrameError as error:
                    self.broken.append((self.now(), str(error), piece.hex()))
                    continue
                if self.tamper is not None:
                    name, content = self.tamper(name, content)
                self._frames += 1
                now = self.now()
                if self._heard is not None and self.state in ("armed", "running"):
                    self.silence_s = max(self.silence_s, now - self._heard)
                self._heard = now
                answer = messages.reply(frame.sequence, *self._answer(name, content))
                # Kept after the state has changed, so that who waits for a request sees what it did.
                if name not in self._deaf:
                    self.requests.append((now, name, content, frame.sequence))
                try:
                    spoil = self.spoil.get(name) if self.stubborn else self.spoil.pop(name, None)
                    os.write(self._master, answer if spoil is None else spoil(frame.sequence, answer))
                except OSError:
                    return

    def _answer(self, name, content):
        uptime = int(self.now() * 1e6)
        match name:
            case "Hello":
                limits = {
                    "min_frequency_millihertz": 1_000,
                    "max_frequency_millihertz": 1_000_000,
                    "max_voltage_millivolts": 2_000_000,
                    "min_guard_ns": 200_000,
                    "timer_clock_hz": CLOCK_HZ,
                }
                firmware = {"major": 0, "minor": 0, "patch": 0, "commit": list(b"00000000")}
                return "Welcome", {
                    "protocol_min": 1,
                    "protocol_current": messages.VERSION,
                    "board": 1,
                    "board_id": list(b"played-board"),
                    "boot_id": 1,
                    "reset_cause": 0,
                    "image": "era-firmware",
                    "firmware": firmware,
                    "channels": [limits] * self.channels,
                    "failure": "",
                }
            case "ArmWith":
                self.deadman_ms = content["deadman_ms"] or 250
                self.state = "armed"
                return "ArmedWith", {"deadman_ms": self.deadman_ms, "burst_ms": content["burst_ms"] or 2000}
            case "SetDrives" | "Prepare":
                self.achieved = [achieved(drive) for drive in content["drives"]]
                self.state = "running" if content["drives"] else "armed"
                return "DrivesSet" if name == "SetDrives" else "Prepared", {"achieved": self.achieved}
            case "Play" | "PlayOnce":
                return "Playing", None
            case "PlayWindows":
                self.state = "running"
                # At once, if no time is asked for: the rails of this board need none to rise.
                return "WindowsPlaying", {"start_us": content["start_us"] or uptime}
            case "Disarm" | "Stop":
                self.state = "safe"
                self.achieved = []
                return ("Disarmed" if name == "Disarm" else "Stopped"), None
            case "KeepAlive":
                return "Alive", {"state": (self.state, None)}
            case "Status":
                drives = {drive["channel"]: drive for drive in self.achieved}
                return "Status", {
                    "state": (self.state, None),
                    "uptime_us": uptime,
                    "boot_id": 1,
                    "fault": None,
                    "channels": [{"drive": drives.get(channel)} for channel in range(self.channels)],
                    "link": {"good_frames": self._frames, "bad_frames": len(self.broken), "refused": 0},
                }
            case "Faults":
                return "Faults", {"latched": None}
            case "NumberedFault":
                return "NumberedFault", {"number": 0, "latched": None}
            case "ClearFaults" | "ClearFault":
                return "FaultsCleared", None
            case "Telemetry":
                return "Telemetry", {
                    "uptime_us": uptime,
                    "state": (self.state, None),
                    "acceleration_peak_mm_per_s2": None,
                    "rail_millivolts": [0] * self.channels,
                }
            case "Clock":
                return "Clock", {"now_us": uptime}
            case "Details":
                # Rails that are up at once; which channel is on which rail does not matter if both have the highest voltage.
                rails = [max((drive["voltage_millivolts"] for drive in self.achieved), default=0)] * 2
                return "Details", {
                    "state": (self.state, None),
                    "set_point_millivolts": rails,
                    "rail_millivolts": rails,
                    "average_microamps": 0,
                    "interlock_closed": True,
                    "stop_released": True,
                    "earth_bonded": True,
                    "credit_ms": [60_000] * self.channels,
                }
            case "Credit":
                # Full, and nothing that runs out: who asks is answered, no more.
                channel = {"left_ms": 60_000, "charge_ppm": 0}
                return "Credit", {
                    "rule": ("ForceSquared", None),
                    "earned_ppm": 100_000,
                    "channels": [channel] * self.channels,
                }
            case "Log":
                return "Log", {"bytes": b""}
        return "Refused", ("Malformed", None)


def achieved(drive):
    """What a timer that counts whole clocks would do: the period rounded to clocks, the pulse as asked for."""
    clocks = round(CLOCK_HZ * 1000 / drive["frequency_millihertz"])
    pulse = clocks * drive["pulse_width_ppm"] // 2_000_000
    return {
        "channel": drive["channel"],
        "frequency_nanohertz": round(CLOCK_HZ * 1_000_000_000 / clocks),
        "pulse_width_ppm": pulse * 2_000_000 // clocks,
        "phase_microturns": drive["phase_microturns"],
        "guard_ns": (clocks // 2 - pulse) * 1_000_000_000 // CLOCK_HZ,
        "voltage_millivolts": drive["voltage_millivolts"],
    }
