"""Tests of what is laid over the chip's registers: the lock of the timers, outputs that are off, modes of the DAC, first conversions, breaks that do
not arrive. Expectations are written from the reference manual (RM0440), not from the modules that are tested.

usage: launch.py --self-test --elf PATH
"""

import unittest

from board_test_case import BoardTestCase
from chip import ADC1, ADC2, ADC3, CLOCK_HZ, COMP, DAC1, DAC3, EXTI, GPIO, JDR1, NVIC_ISPR, PWR, SYSCFG

MILLISECOND = CLOCK_HZ // 1000
# BDTR: OSSI, OSSR, BKE, BKP; and MOE.
BREAK, MOE = 0x3C00, 1 << 15
# TIM1 on port A: PA8 and PA10, alternate function 6; registers MODER, AFRH.
TIM1_MODES, TIM1_FUNCTIONS = 0b10 << 16 | 0b10 << 20, 6 << 0 | 6 << 8


class LockTest(BoardTestCase):
    def lock(self, level, name="TIM1"):
        timer = self.timer(name)
        # Channels 1 and 2 in modes 1101 and 0110, preloaded, OC1CE; channel 3 likewise, channel 4 as an input (CC4S = 01).
        modes = (("ccmr1", 0x0001_68D8), ("ccmr2", 0x6168))
        for register, value in (("af1", 0xBA), *modes, ("ccer", 0x0101), ("bdtr", BREAK | level << 8)):
            timer.write(register, value)
        self.settle()
        return timer

    def settle(self):
        """Two slices: what has been written is known in the second one at the latest."""
        self.spend(0)
        self.spend(0)

    def test_the_voltage_detector_is_locked_by_its_break(self):
        for locked, value in ((False, 0x0), (True, 0xD)):
            self.renew()
            self.sim.write_u32(PWR + 0x04, 0xD)
            self.settle()
            self.sim.write_u32(SYSCFG + 0x1C, 0b100 if locked else 0b011)
            self.settle()
            self.sim.write_u32(PWR + 0x04, 0x0)
            self.settle()
            self.assertEqual(self.sim.read_u32(PWR + 0x04), value)

    def test_what_is_locked_keeps_its_value(self):
        # Level from which each is locked, register, what is written, what is then there without the lock and with it.
        writes = (
            (1, "af1", 0x0000, 0x0000, 0x00BA),
            (1, "cr2", 0xFF00, 0xFF00, 0x0000),
            (1, "bdtr", 0x0CFF, 0x0CFF, BREAK),
            (1, "bdtr", 0x7C00, 0x7C00, BREAK),
            (2, "bdtr", 0x3000, 0x3000, BREAK),
            (2, "ccer", 0x0303, 0x0303, 0x0101),
            (3, "ccmr1", 0x0000, 0x0000, 0x0001_6858),
            (3, "ccmr2", 0x0000, 0x0000, 0x0068),
        )
        for name in ("TIM1", "TIM16"):
            for level in (0, 1, 2, 3):
                for from_level, register, written, free, locked in writes:
                    self.renew()
                    timer = self.lock(level, name)
                    timer.write(register, written)
                    self.settle()
                    lock_bits = level << 8 if register == "bdtr" else 0
                    expected = locked if level >= from_level else free
                    self.assertEqual(timer.read(register), expected | lock_bits, (name, level, register, hex(written)))
        
    def test_enables_and_compare_values_are_never_locked(self):
        timer = self.lock(3)
        for register, value in (("ccer", 0x1000), ("ccr1", 77), ("psc", 5), ("arr", 99), ("bdtr", MOE | BREAK | 0x300)):
            timer.write(register, value)
            self.settle()
            self.assertEqual(timer.read(register), value, register)

    def test_the_first_write_decides(self):
        timer = self.lock(0)
        timer.write("bdtr", BREAK | 0x300)
        self.settle()
        self.assertEqual(timer.read("bdtr"), BREAK)
        timer.write("af1", 0)
        self.settle()
        self.assertEqual(timer.read("af1"), 0)

    def test_what_comes_after_the_lock_comes_too_late(self):
        for order, expected in ((("af1", "bdtr"), 0xBA), (("bdtr", "af1"), 1)):
            self.renew()
            timer = self.timer("TIM8")
            for register in order:
                timer.write(register, {"af1": 0xBA, "bdtr": BREAK | 0x300}[register])
            self.settle()
            self.assertEqual(timer.read("af1"), expected, order)

    def test_a_register_can_change_by_itself(self):
        timer = self.lock(3)
        self.faults.inject({"register": {"address": timer.base + 0x18, "value": 0}})
        self.settle()
        self.assertEqual(timer.read("ccmr1"), 0)
        timer.write("ccmr1", 0x60)
        self.settle()
        self.assertEqual(timer.read("ccmr1"), 0)


class OutputTest(BoardTestCase):
    def test_outputs_that_are_off(self):
        """Pads of TIM1, whose channels 1 and 3 are enabled: BDTR, CR2, whether pads without a driver are high, expected levels of PA8 and PA10."""
        cases = (
            (0, 0, True, 0b00), (0, 0, False, 0b11), (BREAK, 0, False, 0b00), (BREAK, 1 << 12, False, 0b10), (BREAK, 1 << 8, True, 0b01),
            (1 << 11, 0, False, 0b11), (MOE, 0, False, 0b00), (MOE | BREAK, 1 << 8, False, 0b00),
        )
        for bdtr, cr2, pulled_down, expected in cases:
            self.renew()
            self.faults.inject({"pull_downs": "there" if pulled_down else "missing"})
            timer = self.timer("TIM1")
            for register, value in (("ccer", 0x0101), ("cr2", cr2), ("bdtr", bdtr)):
                timer.write(register, value)
            self.sim.write_u32(GPIO["A"] + 0x24, TIM1_FUNCTIONS)
            self.sim.write_u32(GPIO["A"], TIM1_MODES)
            self.spend(0)
            levels = self.sim.read_u32(GPIO["A"] + 0x10)
            self.assertEqual((levels >> 8 & 1) | (levels >> 10 & 1) << 1, expected, (hex(bdtr), hex(cr2), pulled_down))
            high = {electrode for _, electrodes in self.machine.sensing.electrodes.levels(0, 1000) for electrode in electrodes if electrode[0] == 0}
            self.assertEqual(high, {(0, "ab"[place]) for place in (0, 1) if expected >> place & 1})

    def test_channels_that_are_disabled_float(self):
        self.faults.inject({"pull_downs": "missing"})
        timer = self.timer("TIM1")
        timer.write("ccer", 0x0001)
        timer.write("bdtr", MOE | BREAK)
        self.sim.write_u32(GPIO["A"] + 0x24, TIM1_FUNCTIONS)
        self.sim.write_u32(GPIO["A"], TIM1_MODES)
        self.spend(0)
        self.assertEqual(self.sim.read_u32(GPIO["A"] + 0x10) & 0x500, 0x400)


class ConverterTest(BoardTestCase):
    def test_modes_of_the_set_points(self):
        """MODE1 -> rail 1 in V at codes 0, 2048 and 4095: 0.2 V of the buffer's 3.3 V are 121 V of 2000 V."""
        unbuffered, buffered, nothing = (0, 1000, 2000), (121, 1000, 1879), (0, 0, 0)
        modes = (buffered, buffered, unbuffered, nothing, nothing, nothing, nothing, nothing)
        for mode, volts in enumerate(modes):
            for code, expected in zip((0, 2048, 4095), volts):
                self.sim.write_u32(DAC1, 0)
                self.sim.write_u32(DAC1 + 0x3C, mode)
                self.sim.write_u32(DAC1 + 0x08, code)
                self.sim.write_u32(DAC1, 1)
                # Enable, discharge switches and permit are high.
                for name in ("high_voltage_enable", "discharge1", "discharge2", "permit"):
                    self.faults.inject({"pin": {"name": name, "stuck": True}})
                self.machine.supply.rails[0] = self.machine.supply.followed[0] = 0.0
                self.spend(0)
                self.spend(100 * MILLISECOND)
                self.assertAlmostEqual(self.machine.supply.rails[0], expected, delta=3, msg=(mode, code))
        self.sim.write_u32(DAC1 + 0x3C, 0b010)
        self.sim.write_u32(DAC1, 0)
        self.spend(0)
        self.spend(500 * MILLISECOND)
        self.assertLess(self.machine.supply.rails[0], 15)

    def test_modes_of_the_thresholds(self):
        """COMP4 against DAC3's channel 2 at code 100, 0.08 V or 0.5 mA, with 1 mA at its input."""
        self.sim.write_u32(COMP + 12, 0b100 << 4 | 1)
        self.sim.write_u32(DAC3 + 0x14, 100)
        for mode, trips_at_ma in enumerate((0, 1.2, 0, 0.5, 0, 0, 0, 0)):
            self.sim.write_u32(DAC3, 0)
            self.sim.write_u32(DAC3 + 0x3C, mode << 16)
            self.sim.write_u32(DAC3, 1 << 16)
            for milliamps in (0.1, 0.8, 1.4):
                self.faults.inject({"overcurrent_ma": milliamps})
                self.spend(0)
                self.assertEqual(self.machine.protection.outputs[4], milliamps > trips_at_ma, (mode, milliamps))

    def start_sequence(self, converter, bit):
        """Starts a sequence and waits until it has ended; the board is looked at in between, as it is every 5 us."""
        self.sim.write_u32(converter + 0x08, 1 | bit)
        self.sim.run_for("2us")
        self.machine.step_board()
        self.sim.run_for("6us")

    def test_the_first_conversion_after_a_pause_is_wrong(self):
        regular, injected = 1 << 2, 1 << 3
        self.calibrate(ADC1, ADC3)
        # ADC3 converts the interlock's level twice: 2.185 V.
        self.sim.write_u32(ADC1 + 0x4C, 6 << 9)
        self.sim.write_u32(ADC3 + 0x4C, 5 << 15 | 5 << 9 | 1)
        codes = lambda converter: [round(self.sim.read_u32(converter + JDR1 + 4 * place) / 4095 * 3.3, 2) for place in (0, 1)]
        for pause_ms, first in ((1.0, 0.54), (0.2, 2.19), (1.0, 0.54), (0.999, 0.54)):
            self.spend(int(pause_ms * MILLISECOND))
            self.start_sequence(ADC3, injected)
            self.assertEqual(codes(ADC3), [first, 2.19], pause_ms)
        # A regular sequence before the injected one takes the wrong result: the bond is at 0.14 V.
        for bits, wrong in (((regular, injected), False), ((injected,), True)):
            self.spend(MILLISECOND)
            for bit in bits:
                self.start_sequence(ADC1, bit)
            self.assertEqual(abs(codes(ADC1)[0] - 0.14) > 1, wrong, bits)
        # The data register: of one conversion it is the first, of two the second.
        for sequence, wrong in ((18 << 6, True), (18 << 12 | 1 << 6 | 1, False)):
            self.sim.write_u32(ADC1 + 0x30, sequence)
            self.spend(MILLISECOND)
            self.start_sequence(ADC1, regular)
            self.assertEqual(abs(self.sim.read_u32(ADC1 + 0x40) / 4095 * 3.3 - 1.212) > 1, wrong, sequence)

    def test_a_converter_that_is_off_converts_nothing(self):
        """ISR: EOC, EOS, JEOC and JEOS, after both kinds of sequences."""
        for enabled in (True, False):
            self.sim.write_u32(ADC1, 0xFF)
            self.sim.write_u32(ADC1 + 0x08, enabled | 1 << 2 | 1 << 3)
            self.sim.run_for("10us")
            self.assertEqual(self.sim.read_u32(ADC1) & 0x6C, 0x6C * enabled)

    def test_adc2_can_stop(self):
        for offset, value in ((0x0C, 1 << 13), (0x30, 7 << 6), (0x08, 1 << 2)):
            self.sim.write_u32(ADC2 + offset, value)
        self.spend(0)
        for stops in (False, True, False):
            self.faults.inject({"average": "stops" if stops else "converts"})
            self.spend(0)
            self.sim.write_u32(ADC2, 1 << 2)
            self.sim.run_for("100ns")
            self.spend(MILLISECOND)
            self.spend(MILLISECOND)
            self.assertEqual(self.sim.read_u32(ADC2) & 1 << 2 == 0, stops)


class TripTest(BoardTestCase):
    def test_a_break_that_does_not_arrive(self):
        self.sim.write_u32(COMP + 16, 1 << 15 | 0b011 << 4 | 1)
        for name in ("TIM1", "TIM8", "TIM20", "TIM16"):
            self.timer(name).write("af1", 1 << 5)
            self.timer(name).write("bdtr", MOE | BREAK)
        self.faults.inject({"break": {"timer": "TIM20", "works": False}})
        self.spend(0)
        self.faults.inject({"interlock": "open"})
        self.spend(0)
        enabled = lambda: [name for name in ("TIM1", "TIM8", "TIM20", "TIM16") if self.timer(name).read("bdtr") & MOE]
        self.assertEqual(enabled(), ["TIM20"])
        self.faults.inject({"break": {"timer": "TIM20", "works": True}})
        self.spend(0)
        self.assertEqual(enabled(), [])

    def test_the_voltage_detector_has_two_edges(self):
        """EXTI: RTSR1 at 0x08, FTSR1 at 0x0C, PR1 at 0x14; the output of the detector rises when the supply falls."""
        self.sim.write_u32(PWR + 0x04, 1)
        for rising, falling, expected in ((1, 0, (True, False)), (0, 1, (False, True)), (1, 1, (True, True)), (0, 0, (False, False))):
            self.sim.write_u32(EXTI, 1 << 16)
            self.sim.write_u32(EXTI + 0x08, rising << 16)
            self.sim.write_u32(EXTI + 0x0C, falling << 16)
            for state, pends in zip(("low", "ok"), expected):
                self.sim.write_u32(EXTI + 0x14, 1 << 16)
                self.sim.write_u32(NVIC_ISPR + 0x80, 1 << 1)
                self.faults.inject({"pvd": state})
                self.machine.step_board()
                self.assertEqual(bool(self.sim.read_u32(NVIC_ISPR) & 1 << 1), pends, (rising, falling, state))


if __name__ == "__main__":
    unittest.main()
