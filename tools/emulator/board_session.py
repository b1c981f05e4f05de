"""The firmware image on the emulated board, driven over its serial link, with a record of its timers' registers."""

import zlib

from machine import Machine
from pulses import CLOCK_HZ, record_registers

# The protocol's version, its requests and replies by their numbers, and the state "armed" (docs/src/protocol.md).
VERSION, SET_DRIVES, KEEP_ALIVE, ARM_WITH, CLOCK, PLAY_WINDOWS, ALIVE, REFUSED, ARMED = 4, 3, 5, 10, 13, 19, 5, 10, 2
# What the emulator may notice the timers' start late, and the board's own clock is exact to, in clocks.
APART = 10 * CLOCK_HZ // 1_000_000


def encode_varints(*numbers):
    """Unsigned numbers in postcard's format."""
    result = bytearray()
    for number in numbers:
        while number > 0x7F:
            result.append(number & 0x7F | 0x80)
            number >>= 7
        result.append(number)
    return bytes(result)


def read_varint(body):
    return sum((byte & 0x7F) << 7 * place for place, byte in enumerate(body))


class BoardSession:
    """A board that is armed."""

    def __init__(self, elf):
        self.machine = Machine(elf)
        self.machine.boot()
        self.snapshots = record_registers(self.machine)
        self.run_for(0.1)
        self.send_request(ARM_WITH, 0, 1, 10_000)
        while self.send_request(KEEP_ALIVE) != bytes([ALIVE, ARMED]):
            self.run_for(0.01)

    def play_windows(self, windows, rail_millivolts):
        """Plays windows, of each channel electrode, ticks of wait and ticks of width; the clocks between which they begin as the board says."""
        numbers = [(channel, "ab".index(of), wait, width) for channel, some in enumerate(windows) for of, wait, width in some]
        before, now_us, after = self.machine.clock, read_varint(self.send_request(CLOCK)[1:]), self.machine.clock
        numbers = [len(numbers), *(number for window in numbers for number in window)]
        start_us = read_varint(self.send_request(PLAY_WINDOWS, 1, 0, *rail_millivolts, *numbers)[1:])
        ahead = (start_us - now_us) * CLOCK_HZ // 1_000_000
        return before + ahead - APART, after + ahead + APART

    def run_for(self, seconds):
        """Lets time pass with a keep-alive every 50 ms."""
        end = self.machine.time_s + seconds
        while self.machine.time_s < end:
            self.send_request(KEEP_ALIVE)
            until = min(self.machine.time_s + 0.05, end)
            while self.machine.time_s < until:
                self.machine.advance(until)

    def send_request(self, *numbers):
        """Sends a request and returns the body of its reply."""
        frame = bytes([VERSION, 1, 0, 0]) + encode_varints(*numbers)
        frame += zlib.crc32(frame).to_bytes(4, "little")
        # COBS: in place of each zero, and before the first byte, the distance to the next zero.
        self.machine.receive(b"".join(bytes([len(part) + 1]) + part for part in frame.split(b"\0")) + b"\0")
        answer, end = b"", self.machine.time_s + 0.1
        while not answer.endswith(b"\0"):
            if self.machine.time_s > end:
                raise AssertionError(f"request {numbers}: no answer")
            self.machine.advance(end)
            answer += self.machine.transmitted()
        frame, rest = b"", answer.strip(b"\0")
        while rest:
            frame, rest = frame + rest[1:rest[0]] + b"\0", rest[rest[0]:]
        body = frame[4:-5]
        if body[0] == REFUSED:
            raise AssertionError(f"request {numbers}: refused, {body.hex()}")
        return body
