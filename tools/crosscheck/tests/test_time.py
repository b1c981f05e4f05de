"""The reference's frames, pulses and motion against values known from elsewhere."""

import unittest
from types import SimpleNamespace

import numpy as np

from ..reference import effects, frames, motion, pulses, rise


class Frames(unittest.TestCase):
    def test_checksum(self):
        # The check value of CRC-32 in every catalogue of such sums.
        self.assertEqual(frames.crc32(b"123456789"), 0xCBF43926)

    def test_byte_stuffing(self):
        # Examples of the paper's encoding; 254 bytes without a zero are one block without one after it.
        long = bytes(range(1, 255))
        for plain, stuffed in [
            (b"", b"\x01"),
            (b"\x00", b"\x01\x01"),
            (b"\x11\x22\x00\x33", b"\x03\x11\x22\x02\x33"),
            (long, b"\xff" + long),
            (long + b"\x01", b"\xff" + long + b"\x02\x01"),
            (b"\x00" + long, b"\x01\xff" + long),
        ]:
            self.assertEqual(frames.cobs_encode(plain), stuffed)
            self.assertEqual(frames.cobs_decode(stuffed), plain)

    def test_integers(self):
        # Of the format's own description.
        for value, raw in [(0, "00"), (127, "7f"), (128, "8001"), (16383, "ff7f"), (16384, "808001"), (65535, "ffff03")]:
            self.assertEqual(frames.written("u16", value).hex(), raw)
            self.assertEqual(frames.read("u16", bytes.fromhex(raw)), value)
        for value, raw in [(0, "00"), (-1, "01"), (1, "02"), (-64, "7f"), (64, "8001"), (-32768, "ffff03")]:
            self.assertEqual(frames.written("i16", value).hex(), raw)
            self.assertEqual(frames.read("i16", bytes.fromhex(raw)), value)

    def test_broken_frames(self):
        good = frames.Frame(2, 1, 7, b"\x05").encoded()[:-1]
        self.assertEqual(frames.frame(good), frames.Frame(2, 1, 7, b"\x05"))
        for place in range(len(good)):
            for bit in range(8):
                changed = bytearray(good)
                changed[place] ^= 1 << bit
                with self.assertRaises(frames.FrameError):
                    frames.frame(bytes(changed))


class Pulses(unittest.TestCase):
    def test_harmonics(self):
        # A square wave has 4 / (n pi); with two thirds of it the third harmonic is gone.
        for n in (1, 3, 5, 7):
            self.assertAlmostEqual(pulses.harmonic(150.0, 1.0, n), 4 / (n * np.pi), 12)
        self.assertAlmostEqual(pulses.harmonic(150.0, 2 / 3, 3), 0.0, 12)

    def test_electrodes_behind_resistors(self):
        # Hardly any resistance is the contract's law.
        for n in (1, 3, 5):
            law = 4 / (n * np.pi) * np.sin(n * np.pi * 0.3)
            self.assertEqual(pulses.coefficient((0.0, 0.0, 0.0), 200.0, 0.6, n), law)
            self.assertAlmostEqual(abs(pulses.coefficient((1e-9, 0.0, 1e-9), 200.0, 0.6, n) - law), 0.0, 5)
        # A voltage stepped by Euler's method in 1e-7 s, from rest, over the fourth period.
        times, hz, width, step = (116e-6, 15e-6, 11.6e-6), 200.0, 2 / 3, 1e-7
        period = 1 / hz
        count = round(period / step)
        voltage, since = 0.0, np.inf
        squares = np.empty(count)
        for _ in range(4):
            for k in range(count):
                on = (k + 0.5) * step < width * period / 2
                since = 0.0 if on else since + step
                before = voltage
                if on or since > times[1]:
                    voltage += ((1.0 if on else 0.0) - voltage) * step / (times[0] if on else times[2])
                squares[k] = (before**2 + voltage**2) / 2
        force = squares - np.roll(squares, count // 2)
        middle = (np.arange(count) + 0.5) * step - width * period / 4
        for n in (1, 3, 5):
            stepped = 2 * hz * step * np.sum(force * np.exp(-2j * np.pi * n * hz * middle))
            self.assertLess(abs(pulses.coefficient(times, hz, width, n) - stepped), 2e-3)

    def test_marched_windows_are_the_periodic_voltage(self):
        era = SimpleNamespace(times=(116e-6, 15e-6, 11.6e-6))
        drive = motion.Drive(0, 200.0, 1000.0, 2 / 3, 0.4)
        voltages = motion.Voltages(motion.windows([drive], 0.1), 1, times=[era.times])
        begin = pulses.begin_voltage(era.times, 200.0, 2 / 3)
        for time in np.linspace(0.05, 0.055, 40):
            a, _ = voltages.at(voltages.interval(time), time)
            since = (time + 0.4 / (2 * np.pi * 200.0) + 2 / 3 / 800.0) % (1 / 200.0)
            self.assertAlmostEqual(float(a[0]) / 1e6, pulses.voltage_at(era.times, 200.0, 2 / 3, begin, since) ** 2, 9)

    def test_never_both(self):
        for phase in (0.0, 1.0, 4.0):
            self.assertAlmostEqual(pulses.both_on(100.0, 0.9, phase), pulses.guard(100.0, 0.9), 12)


class Effects(unittest.TestCase):
    def test_levels(self):
        segments = [{"cycles": 2, "level": 1.0}, {"duration_ms": 30, "level": 0.0}]
        # The pause ends within the fifth period: the sixth boundary, at 50 ms, is beyond all.
        self.assertEqual(effects.levels(segments, 1, 0.01), [1.0, 1.0, 0.0, 0.0, 0.0])
        ramp = [{"duration_ms": 40, "from_level": 0.0, "to_level": 1.0}]
        np.testing.assert_allclose(effects.levels(ramp, 1, 0.01), [0.125, 0.375, 0.625, 0.875])


class Oscillator:
    """One coordinate of 1 kg at 100 Hz, in the words of `motion.System`."""

    def __init__(self, ratio):
        self.omega, self.size, self.points = 2 * np.pi * 100, 1, np.ones((1, 1))
        self.state = np.array([[0.0, 1.0], [-self.omega**2, -2 * ratio * self.omega]])
        self.input = np.array([[0.0], [1.0]])
        self.damping = 2 * ratio * self.omega

    def modes(self):
        values, vectors = np.linalg.eig(self.state)
        return values, vectors, np.linalg.inv(vectors)

    def steady(self, frequencies_hz):
        w = 2 * np.pi * np.asarray(frequencies_hz, float)[:, None, None]
        return 1 / (self.omega**2 + 1j * w * self.damping - w**2)


class Rise(unittest.TestCase):
    def test_at_resonance(self):
        # There the envelope is 1 - exp(-z w t) of the steady peak: 90 % after ln 10 / (z w), and as long to decay to 10 %.
        ratio = 0.01
        system = Oscillator(ratio)
        motions = rise.free_motions(system, [(0, 100.0, 1.0)])
        times = np.linspace(0, 1, 20_001)
        risen, left, _ = rise.envelopes(motions, times)
        peak = abs(motions[0][1])
        wanted = np.log(10) / (ratio * system.omega)
        self.assertAlmostEqual(rise.last(times, risen < 0.9 * peak) / wanted, 1, 2)
        self.assertAlmostEqual(rise.last(times, left > 0.1 * peak) / wanted, 1, 2)


if __name__ == "__main__":
    unittest.main()
