"""Pulses of the electrodes against what was requested, with the oracle of pulses.py; what the oracle makes of registers; and mistakes
planted into the registers, which it must find."""

import copy
import os
import random
import unittest

from board_session import SET_DRIVES, BoardSession
from pins import ELECTRODES
from pulses import (
    ARPE, BKE, CEN, CLOCK_HZ, DIR, MOE, OPM, OSSI, OUTPUTS, UDIS, UG, WINDOW_TICK, Drive, PulseTimer, judge_drives, judge_phase, judge_pins,
    judge_windows, list_pulses, rebuild_levels,
)

# In the order of the channels: two in step and two on their own, of which the second and the fourth are on rail 2; then other drives.
DRIVES = (
    (Drive(200.0, 0.8, 0.0, 600), Drive(200.0, 0.6, 0.25, 500), Drive(61.5, 0.9, 0.0, 600), Drive(1000.0, 0.5, 0.1, 500)),
    (Drive(173.0, 0.5, 0.9, 600), Drive(173.0, 0.7, 0.2, 500), Drive(20.0, 0.4, 0.5, 600), Drive(313.7, 0.8, 0.0, 500)),
)
# For each channel: electrode, wait and width in ticks of 0.1 us.
WINDOWS = (
    (("a", 2_000, 12_345), ("b", 2_000, 23_456), ("a", 90_001, 3_000)), (("b", 7_001, 50_001), ("b", 6_999, 3_001), ("a", 7_000, 10_000)),
    (("a", 150_000, 30_000), ("b", 2_001, 30_001)), (("a", 11_000, 56_034), ("b", 2_000, 3_000)),
)


# Sessions with sets of random drives, and a random sequence of windows at the end of each.
RANDOM_SESSIONS, RANDOM_SETS = int(os.environ.get("ERA_PULSE_SESSIONS", "1")), 3
# The guard of 200 us, and the least window of 300 us, in s and in ticks of 0.1 us; 5.6 ms are the longest window.
GUARD_S, GUARD_TICKS, LEAST_TICKS, LONGEST_TICKS = 200e-6, 2_000, 3_000, 56_034


def choose_drives(rng, volts):
    """One drive for each channel, the first two in step, with the voltage of each rail: four of 600 V at 400 Hz take 0.22 of the 0.5 mA that the
    supply delivers. A rail that falls would narrow the windows."""
    shared = round(rng.uniform(20, 400), 2)
    frequencies = [shared, shared, round(rng.uniform(20, 400), 2), round(rng.uniform(20, 400), 2)]
    widest = lambda hertz: 1 - 2 * hertz * GUARD_S
    return tuple(
        Drive(hertz, round(rng.uniform(0.3, widest(hertz) - 1e-3), 4), round(rng.random(), 4), volts[channel % 2]) for channel, hertz in enumerate(frequencies)
    )


def choose_windows(rng):
    """Up to six windows for each channel."""
    choose = lambda: (rng.choice("ab"), rng.randrange(GUARD_TICKS, 60_000), rng.randrange(LEAST_TICKS, LONGEST_TICKS))
    return tuple(tuple(choose() for _ in range(rng.randrange(1, 7))) for _ in ELECTRODES)


class Session(BoardSession):
    """Drives, and windows."""

    def __init__(self, drives=DRIVES, windows=WINDOWS):
        super().__init__(os.environ["ERA_ELF"])
        self.drives, self.windows = drives, windows
        self.driven = [self.set_drives(each) for each in drives]
        self.start = self.play_windows(windows, [drive.volts * 1000 for drive in drives[-1][:2]])
        self.run_for(0.3)
        self.ended = self.machine.clock
        self.machine.close()

    def set_drives(self, drives):
        """Drives for half a second: when they were requested, settled and ended; the rails; whether all pins are those of the timers."""
        begin = self.machine.clock
        numbers = [(of.frequency_hz * 1e3, of.width * 1e6, of.phase_turns * 1e6, of.volts * 1e3) for of in drives]
        self.send_request(SET_DRIVES, len(drives), *(round(number) for channel, of in enumerate(numbers) for number in (channel, *of)))
        self.run_for(0.25)
        settled = self.machine.clock
        self.run_for(0.25)
        connected = all(self.machine.pins.follows_timer(*pin[:3]) for _, *pair in ELECTRODES.values() for pin in pair)
        return begin, settled, self.machine.clock, list(self.machine.supply.rails), connected


def judge_session(session, timer=None, alter=None):
    """All that is wrong with a session, with the registers of a timer altered."""
    snapshots = copy.deepcopy(session.snapshots)
    for _, registers in snapshots if alter else ():
        alter(registers[timer])
    levels = list(rebuild_levels(snapshots, session.ended).values())
    first = session.driven[0][0]
    wrong = [text for level in levels for text in judge_pins(level, first, session.ended)]
    for index, (drives, (_, settled, end, *_)) in enumerate(zip(session.drives, session.driven)):
        steady = [list_pulses(level, settled, end) for level in levels]
        for channel, drive in enumerate(drives):
            wrong += judge_drives(steady[channel], [drive])
            wrong += judge_drives(list_pulses(levels[channel], first, end), [of[channel] for of in session.drives[:index + 1]])
        wrong += judge_phase(drives[:2], steady[:2])
    played = [list_pulses(level, session.start[0], session.ended) for level in levels]
    start = played[0][0].begin - WINDOW_TICK * session.windows[0][0][1] if played[0] else 0
    if not session.start[0] <= start <= session.start[1]:
        wrong.append(f"windows begin at {start}")
    return wrong + [text for windows, pulses in zip(session.windows, played) for text in judge_windows(windows, pulses, start)]


class RandomTest(unittest.TestCase):
    """Drives and windows that nobody has chosen, the same ones every time."""

    def test_pulses_are_what_was_requested(self):
        for seed in range(RANDOM_SESSIONS):
            rng = random.Random(seed)
            volts = [rng.randrange(100, 600), rng.randrange(100, 600)]
            drives = tuple(choose_drives(rng, volts) for _ in range(RANDOM_SETS))
            with self.subTest(seed):
                self.assertEqual(judge_session(Session(drives, choose_windows(rng))), [], drives)


class FirmwareTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.session = Session()

    def judge_session(self, timer=None, alter=None):
        return judge_session(self.session, timer, alter)

    def assert_found(self, timer, alter, *words):
        wrong = self.judge_session(timer, alter)
        for word in words:
            self.assertTrue(any(word in text for text in wrong), f"{timer}: {word} in {wrong[:5]}")

    def test_pulses_are_what_was_requested(self):
        self.assertEqual(self.judge_session(), [])
        for drives, (*_, rails, connected) in zip(DRIVES, self.session.driven):
            self.assertTrue(connected)
            for channel, drive in enumerate(drives):
                self.assertAlmostEqual(rails[channel % 2] / drive.volts, 1, delta=0.03)

    def test_exchanged_electrodes_are_found(self):
        for timer, (_, b) in OUTPUTS.items():
            names = ("ccr1", "ccr2", "ccr3", "ccr4") if b == 3 else ("ccr1", "ccr2", "ccr4", "ccr3")

            def exchange(registers):
                values = [registers[name] for name in names]
                registers.update(zip(names, values[2:] + values[:2]))

            self.assert_found(timer, exchange, "windows are", *(["phase"] if timer in ("TIM1", "TIM8") else []))

    def test_wrong_compare_values_are_found(self):
        for timer in OUTPUTS:
            for names in (("ccr1",), ("ccr2",), ("ccr3",), ("ccr4",), ("ccr1", "ccr2", "ccr3", "ccr4")):
                # By 10 %; what is never reached stays so.
                alter = lambda registers: registers.update({name: registers[name] * 9 // 10 for name in names if registers[name] < 0xFFFF})
                self.assert_found(timer, alter, "width of", "windows are")

    def test_missing_preload_is_found(self):
        for timer in OUTPUTS:
            for name, bits in (("ccmr1", 0x0808), ("ccmr2", 0x0808), ("cr1", ARPE)):
                self.assert_found(timer, lambda registers: registers.update({name: registers[name] & ~bits}), "windows are")

    def test_halved_guard_is_found(self):
        for timer, (_, b) in OUTPUTS.items():

            def halve(registers):
                """A ends halfway to B."""
                if registers["ccr2"] < registers[f"ccr{b}"] < 0xFFFF:
                    registers["ccr2"] = (registers["ccr2"] + registers[f"ccr{b}"]) // 2

            self.assert_found(timer, halve, "guard is", "width of A")

    def test_other_mistakes_are_found(self):
        for timer in OUTPUTS:
            for change, word in (
                ({"psc": 1}, "period"), ({"arr": -2}, "period"), ({"ccmr1": -(1 << 16)}, "together"), ({"ccer": 1 << 1}, "together"),
                ({"ccer": -1}, "floats"), ({"smcr": -6}, "windows are"), ({"bdtr": -OSSI}, "floats"), ({"rcr": 1}, "windows are"),
            ):
                # TIM4 has neither a main output enable nor a repetition counter.
                if timer != "TIM4" or change.keys().isdisjoint(("bdtr", "rcr")):
                    alter = lambda registers: registers.update({name: max(registers[name] + by, 0) for name, by in change.items()})
                    self.assert_found(timer, alter, word)


class RulesTest(unittest.TestCase):
    """Output 1 in PWM mode 1, high for 30 of 100 clocks, at every change of the registers that follows."""

    def rebuild_output(self, *writes, has_break=True):
        timer = PulseTimer(has_break)
        start = (("ccmr1", 0x68), ("arr", 99), ("ccr1", 30), ("bdtr", MOE), ("ccer", 1), ("cr1", ARPE), ("egr", UG), ("cr1", ARPE | CEN))
        for clock, register, value in (*((0, *write) for write in start), *writes):
            timer.run_until(clock)
            timer.set_break(value) if register == "break" else timer.write_register(register, value)
            timer.note_levels()
        timer.run_until(199)
        # The last of several at one clock.
        return list(dict(timer.levels[0]).items())

    def test_rules(self):
        usual = [(0, 1), (30, 0), (100, 1), (130, 0)]
        for what, expected, *writes in (
            ("nothing else", usual),
            ("preloaded compare value", [(0, 1), (30, 0), (100, 1), (160, 0)], (10, "ccr1", 60)),
            ("compare value without preload", [(0, 1), (60, 0), (100, 1), (160, 0)], (0, "ccmr1", 0x60), (10, "ccr1", 60)),
            ("preloaded period", [(0, 1), (30, 0), (100, 1), (130, 0), (150, 1), (180, 0)], (10, "arr", 49)),
            ("period without preload", [(0, 1), (30, 0), (50, 1), (80, 0), (100, 1), (130, 0), (150, 1), (180, 0)], (10, "cr1", CEN),
             (10, "arr", 49)),
            ("period below the count", [(0, 1), (30, 0)], (10, "cr1", CEN), (60, "arr", 49)),
            ("prescaler", [(0, 1), (30, 0), (100, 1), (160, 0)], (10, "psc", 1)),
            ("no update events", usual, (10, "cr1", ARPE | CEN | UDIS), (20, "ccr1", 60)),
            ("update event by software", [(0, 1), (50, 0), (120, 1), (150, 0)], (20, "egr", UG)),
            ("repetition", usual, (0, "rcr", 1), (0, "egr", UG), (0, "ccr1", 60)),
            ("one pulse", [(0, 1), (30, 0), (100, 1)], (10, "cr1", ARPE | CEN | OPM)),
            ("downwards", [(0, 0), (69, 1), (100, 0), (169, 1)], (0, "cr1", ARPE | CEN | DIR), (0, "egr", UG)),
            ("mode 2", [(0, 0), (30, 1), (100, 0), (130, 1)], (0, "ccmr1", 0x78)),
            ("forced active, then inactive", [(0, 1), (150, 0)], (0, "ccmr1", 0x58), (150, "ccmr1", 0x48)),
            ("combined mode 2", [(0, 0), (30, 1), (70, 0), (130, 1), (170, 0)], (0, "ccr2", 70), (0, "ccmr1", 1 << 16 | 0x6058)),
            ("combined mode 1", [(0, 1), (70, 0), (100, 1), (170, 0)], (0, "ccr2", 70), (0, "ccmr1", 1 << 16 | 0x6048)),
            ("active low", [(0, 0), (30, 1), (100, 0), (130, 1)], (0, "ccer", 0b11)),
            ("output disabled", [(0, 1), (10, None)], (10, "ccer", 0)),
            ("off, floating", [(0, 1), (10, None)], (10, "bdtr", 0)),
            ("off, held", [(0, 1), (10, 0)], (10, "bdtr", OSSI)),
            ("off, idle level", [(0, 1), (10, 0), (20, 1)], (10, "bdtr", OSSI), (20, "cr2", 1 << 8)),
            ("break", [(0, 1), (10, 0)], (5, "bdtr", MOE | OSSI | BKE), (10, "break", True), (20, "bdtr", MOE | OSSI | BKE)),
            ("break that is over", [(0, 1), (10, 0), (100, 1), (130, 0)], (5, "bdtr", MOE | OSSI | BKE), (10, "break", True),
             (50, "break", False), (60, "bdtr", MOE | OSSI | BKE)),
            ("break, automatic output enable", [(0, 1), (10, 0), (100, 1), (130, 0)], (5, "bdtr", MOE | OSSI | BKE | 1 << 14),
             (10, "break", True), (20, "break", False)),
        ):
            with self.subTest(what):
                self.assertEqual(self.rebuild_output(*writes), expected)

    def test_other_modes_are_refused(self):
        for register, value in (("cr1", 1 << 5), ("cr1", 1 << 12), ("cr2", 1), ("ccmr1", 0x18), ("ccmr1", 1 << 16 | 0x68)):
            with self.assertRaises(ValueError):
                self.rebuild_output((10, register, value))

    def test_without_a_break_there_is_no_main_output_enable(self):
        self.assertEqual(self.rebuild_output((10, "bdtr", 0), has_break=False), [(0, 1), (30, 0), (100, 1), (130, 0)])


if __name__ == "__main__":
    unittest.main()
