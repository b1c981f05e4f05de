"""Runs the firmware image on the emulated board and bridges its UART to a pseudo-terminal.

usage: bridge.py --elf PATH [--free | --paused]

The first line on stdout is {"pty": "/dev/pts/N", ...}; a host opens that like a serial port. Then every line on stdin
is a command and every line on stdout its answer: {"id": 1, "op": "timers"} gets {"id": 1, "ok": true, ...} or
{"id": 1, "ok": false, "error": "..."}. The bridge ends with its stdin.

Virtual time follows the clock on the wall as well as it can; with --free it runs ahead as fast as it can,
with --paused it stands still but for what `run_for`, `exchange` and `load` make it run.

op        further keys         answer
time                           virtual_s, clock (since power-up, 170 MHz), wall_s, cycles (carried out), idle
timers                         timers: {"TIM1": {"cr1": n, ...}, "TIM8": ..., "TIM20": ..., "TIM4": ...} with cr1, cr2, smcr,
                               dier, sr, ccmr1, ccmr2, ccer, cnt, psc, arr, ccr1 to ccr4, bdtr, af1, af2 as they read back
history                        history: what each timer's outputs did since the last call, a record for each change:
                               timer, clock, origin (clock of the count's zero), outputs (whether they reach the pins and
                               may go high), psc, arr, ccr (as they count, not as preloaded), cr1, ccmr1, ccmr2, ccer;
                               lost: records that are missing
pins                           pins: {"era1_a": {"mode": "timer", "high": null, "pad": false}, ...}; pad: the level outside,
                               windows of timers apart
rails                          rails: codes of the two set-points, 0 to 4095; rail_volts: the true voltages; average_ua
stack                          size, used: bytes of stack there are, and the most that were in use since power-up
inject    see faults.py        faults by name; without any: nothing
load      seconds              busy, total: clocks in which the processor was at work, and all, over so much virtual time
resets                         resets: [{"virtual_s": s, "cause": "software"}, ...] since the start after power-up, and
                               start: those of this start
read      address              value: a 32-bit word
write     address, value       as the processor would write: what is locked keeps its value (`inject register` changes it)
symbol    name                 address
run_for   seconds              virtual_s; at once, also while paused
exchange  hex, seconds         hex: what the board's UART answers to these bytes, up to the end of the first frame, within
                               so much virtual time; virtual_s. Nothing of it passes the pseudo-terminal
pause, resume
restart   inject (see faults.py)  power off and on, with these faults there from the beginning; the pseudo-terminal
                               stays; boot_virtual_s
quit
"""

import argparse
import json
import os
import selectors
import sys
import time
import tty

from faults import Faults
from machine import Machine

# How far virtual time may be behind the wall clock before the lost time is given up, and the most that one turn of the
# loop runs before it looks at its inputs again, both in s.
LAG_LIMIT_S = 0.05
TURN_S = 0.002
# How far idle time may be passed over ahead of the wall clock: beyond one tick of the firmware's device task, so that
# the bridge can sleep from tick to tick instead of following the wall in small steps.
LEAD_S = 0.002


class Bridge:
    def __init__(self, elf, free, paused):
        self.elf = elf
        self.free = free
        self.machine = Machine(elf)
        self.paused = paused
        self.running = True
        self.started = time.monotonic()
        self.wall_zero = self.started
        self.master, self.slave = os.openpty()
        # The slave stays open here, so that hosts can come and go.
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.commands = b""
        self.selector = selectors.DefaultSelector()
        self.selector.register(self.master, selectors.EVENT_READ, self.from_host)
        self.selector.register(0, selectors.EVENT_READ, self.from_control)

    def anchor(self):
        """From here on virtual time follows the wall clock."""
        self.wall_zero = time.monotonic() - self.machine.time_s

    def run(self):
        # A host that knocks before the firmware listens would have to knock twice.
        self.machine.boot()
        self.anchor()
        say({"pty": os.ttyname(self.slave), "elf": os.path.abspath(self.elf), "boot_virtual_s": self.machine.time_s})
        while self.running:
            ahead = self.machine.time_s - (time.monotonic() - self.wall_zero)
            if ahead < -LAG_LIMIT_S:
                self.wall_zero -= ahead
            if self.paused:
                wait = None
            else:
                wait = 0 if self.free else max(ahead, 0)
            for key, _ in self.selector.select(wait):
                key.data()
            if self.running and not self.paused:
                self.turn()

    def turn(self):
        """Runs until virtual time has caught up with the wall, but not for long."""
        end = time.monotonic() + TURN_S
        while (now := time.monotonic()) < end:
            if self.free:
                until = float("inf")
            else:
                until = now - self.wall_zero + LEAD_S
                if not self.machine.waiting and self.machine.time_s >= now - self.wall_zero:
                    break
            self.machine.advance(until)
            self.to_host()

    def to_host(self):
        data = self.machine.transmitted()
        if data:
            try:
                os.write(self.master, data)
            except BlockingIOError:
                pass  # Nobody reads: a serial line loses what nobody reads.

    def from_host(self):
        try:
            self.machine.receive(os.read(self.master, 4096))
        except (BlockingIOError, OSError):
            pass

    def from_control(self):
        data = os.read(0, 65536)
        if not data:
            self.running = False
            return
        *lines, self.commands = (self.commands + data).split(b"\n")
        for line in filter(None, map(bytes.strip, lines)):
            say(self.answer(line))

    def answer(self, line):
        identity = None
        try:
            command = json.loads(line)
            identity = command.get("id")
            handler = getattr(self, "op_" + str(command.get("op")), None)
            if handler is None:
                raise ValueError(f"unknown op {command.get('op')!r}")
            return {"id": identity, "ok": True, **handler(command)}
        except KeyError as missing:
            return {"id": identity, "ok": False, "error": f"missing key {missing}"}
        except Exception as error:  # Whatever goes wrong is the answer: the bridge outlives a bad command.
            return {"id": identity, "ok": False, "error": f"{type(error).__name__}: {error}"}

    def op_time(self, _):
        return {
            "virtual_s": self.machine.time_s, "clock": self.machine.clock, "wall_s": time.monotonic() - self.started,
            "cycles": self.machine.cycles, "idle": self.machine.is_idle(),
        }

    def op_timers(self, _):
        return {"timers": self.machine.timers.registers()}

    def op_history(self, _):
        timers = self.machine.timers
        answer = {"history": list(timers.history), "lost": timers.lost}
        timers.history.clear()
        timers.lost = 0
        return answer

    def op_pins(self, _):
        return {"pins": self.machine.pins.named()}

    def op_rails(self, _):
        return self.machine.rails()

    def op_stack(self, _):
        return self.machine.stack()

    def op_inject(self, command):
        Faults(self.machine).inject({key: value for key, value in command.items() if key not in ("id", "op")})
        self.machine.step_board()
        return {}

    def op_load(self, command):
        busy, total = self.machine.load(float(command["seconds"]))
        self.anchor()
        return {"busy": busy, "total": total}

    def op_resets(self, _):
        resets, count = self.machine.resets, self.machine.start_resets
        return {"resets": resets[count:], "start": resets[:count]}

    def op_read(self, command):
        return {"value": self.machine.sim.read_u32(int(command["address"]))}

    def op_write(self, command):
        self.machine.sim.write_u32(int(command["address"]), int(command["value"]))
        return {}

    def op_symbol(self, command):
        return {"address": self.machine.sim.symbol(command["name"])}

    def op_run_for(self, command):
        end = self.machine.time_s + float(command["seconds"])
        while self.machine.time_s < end:
            self.machine.advance(end)
            self.to_host()
        self.anchor()
        return {"virtual_s": self.machine.time_s}

    def op_exchange(self, command):
        end = self.machine.time_s + float(command["seconds"])
        self.to_host()
        self.machine.receive(bytes.fromhex(command["hex"]))
        answer = b""
        # A frame ends with a zero; a zero without anything before it is none.
        while self.machine.time_s < end and 0 not in answer.lstrip(b"\0"):
            self.machine.advance(end)
            answer += self.machine.transmitted()
        self.anchor()
        return {"hex": answer.hex(), "virtual_s": self.machine.time_s}

    def op_pause(self, _):
        self.paused = True
        return {"virtual_s": self.machine.time_s}

    def op_resume(self, _):
        self.paused = False
        self.anchor()
        return {"virtual_s": self.machine.time_s}

    def op_restart(self, command):
        self.machine.close()
        self.machine = Machine(self.elf)
        Faults(self.machine).inject(command.get("inject", {}))
        self.machine.boot()
        self.anchor()
        return {"boot_virtual_s": self.machine.time_s, "high_after_reset_s": self.machine.high_after_reset_s}

    def op_quit(self, _):
        self.running = False
        return {}


def say(message):
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--elf", required=True, help="firmware image")
    pace = parser.add_mutually_exclusive_group()
    pace.add_argument("--free", action="store_true", help="do not wait for the clock on the wall")
    pace.add_argument("--paused", action="store_true", help="run only when told to")
    arguments = parser.parse_args()
    try:
        Bridge(arguments.elf, arguments.free, arguments.paused).run()
    except (KeyboardInterrupt, BrokenPipeError):
        pass


if __name__ == "__main__":
    main()
