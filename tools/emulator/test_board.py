"""Tests of the board around the chip: registers are written from outside, before the firmware has got anywhere.

usage: launch.py --self-test --elf PATH
"""

import math
import unittest

from board_test_case import BoardTestCase
from chip import (
    ADC1, ADC2, ADC3, ADC4, AIRCR, CLOCK_HZ, COMP, DAC1, DAC3, DAC4, EXTI, GPIO, IWDG, JDR1, NVIC_ISPR, ODR, PWR, RAM, RAM_BYTES, RCC_CSR, SYSCFG,
    TIM3,
)
from supply import DISCHARGE_S, FOLLOW_S, LEAKAGE_S, Supply

MILLISECOND = CLOCK_HZ // 1000
# A count of the time base, TIM2, in clocks.
TICK = CLOCK_HZ // 1_000_000
TIM2_CNT = 0x4000_0024


class SupplyTest(unittest.TestCase):
    def test_rail_follows_and_discharges(self):
        supply = Supply()
        for _ in range(10):
            supply.step(FOLLOW_S / 10, [0.5, 0.0], True, [True, True], True)
        # The rail is behind its supply by the time of the source's resistor.
        self.assertAlmostEqual(supply.rails[0], 1000 * (1 - math.exp(-1 + 47e3 * 1.8e-9 / FOLLOW_S)), delta=15)
        self.assertEqual(supply.rails[1], 0.0)
        before = supply.rails[0]
        supply.step(DISCHARGE_S, [0.5, 0.0], False, [False, True], True)
        self.assertAlmostEqual(supply.rails[0] / before, 0.36788, places=4)
        before = supply.rails[0]
        supply.step(DISCHARGE_S, [0.5, 0.0], True, [True, True], False)
        self.assertAlmostEqual(supply.rails[0] / before, 0.36788, places=4)

    def test_a_closed_switch_does_not_stop_a_supply(self):
        """1 Mohm against 47 kohm: the rail stays at 955 of 1000 V, from which 955 uA flow. Without the permit both gates together stop it."""
        supply = Supply()
        for permitted, ignored, line_open, rail_v, current_a in (
            (True, (), False, 1000 / 1.047, 974e-6),
            (False, ("enable",), True, 1000 / 1.047, 974e-6),
            (False, ("enable", "discharge"), True, 1000, 20e-6),
        ):
            supply.permit_ignored = ignored
            for _ in range(2):
                supply.step(1.0, [0.5, 0.0], True, [line_open, True], permitted)
            self.assertAlmostEqual(supply.rails[0], rail_v, delta=1)
            self.assertAlmostEqual(supply.average_a, current_a, delta=2e-6)
        supply.permit_ignored = ()
        before = supply.rails[0]
        supply.step(DISCHARGE_S, [0.5, 0.0], True, [True, True], False)
        self.assertAlmostEqual(supply.rails[0] / before, 0.36788, places=4)

    def test_a_switch_without_its_line_closes_by_the_permit_alone(self):
        supply = Supply()
        supply.discharge_lines_work = False
        for permitted, left in ((True, math.exp(-DISCHARGE_S / LEAKAGE_S)), (False, math.exp(-1))):
            supply.rails = [50.0, 50.0]
            supply.step(DISCHARGE_S, [0.0, 0.0], False, [False, False], permitted)
            self.assertAlmostEqual(supply.rails[0], 50.0 * left, places=3)

    def test_charging_takes_current(self):
        supply = Supply()
        supply.step(1e-3, [0.1, 0.0], True, [True, True], True)
        self.assertGreater(supply.average_a, 40e-6)
        supply.step(1.0, [0.1, 0.0], True, [True, True], True)
        self.assertLess(supply.average_a, 5e-6)

    def test_an_electrode_takes_its_charge_and_what_is_broken_does_not(self):
        """100 pulses of 1 ms at 1 kV, 500 in a second: C V f of 116 pF, and 20 uA for the bleeders."""
        for is_broken, expected in ((None, 58e-6), ("open", 0.0), ("lower_open", 0.0), ("shorted", 500e-6), ("lower_stuck", 455e-6)):
            supply = Supply()
            supply.broken = {(2, "b"): is_broken}
            for high in (frozenset(), frozenset([(2, "b")])):
                supply.step(0.1, [0.5, 0.0], True, [True, True], True, high)
            supply.average_sum = 0.0
            for _ in range(100):
                for high in (frozenset(), frozenset([(2, "b")])):
                    for _ in range(10):
                        supply.step(1e-4, [0.5, 0.0], True, [True, True], True, high)
            # A lasting load lowers the rail at its source by some per cent.
            self.assertAlmostEqual(supply.average_sum / 0.2, 20e-6 + expected, delta=0.06 * expected + 1e-6)

    def test_a_rail_without_its_supply_shares_its_charge(self):
        supply = Supply()
        supply.rails = [50.0, 50.0]
        supply.step(0.4e-3, [0.0, 0.0], False, [True, True], True, frozenset([(0, "a")]))
        self.assertAlmostEqual(supply.rails[0], 50.0 * (1 - 116 / 1916 * (1 - math.exp(-0.4 / 0.109)) - 0.4 / 90), delta=0.05)
        self.assertAlmostEqual(supply.rails[1], 50.0 * math.exp(-0.4 / 90), places=3)


class BoardTest(BoardTestCase):
    def test_slaves_start_together_and_preload(self):
        timers = [self.start(name) for name in ("TIM1", "TIM8", "TIM20", "TIM4")]
        self.trigger()
        self.assertEqual(len({timer.origin for timer in timers}), 1)
        timer = timers[0]
        self.assertTrue(timer.running)
        timer.write("ccr1", 555)
        self.spend(5000)
        self.assertEqual(timer.shadow["ccr"][0], 100)
        self.assertEqual(timer.read("cnt") // 100, 50)
        self.spend(5000)
        self.assertEqual(timer.shadow["ccr"][0], 555)
        self.assertEqual(timer.read("sr") & 1, 1)
        timer.write("sr", 0)
        self.assertEqual(timer.read("sr"), 0)

    def test_start_is_known_to_the_clock(self):
        timer = self.start("TIM8")
        self.sim.write_u32(TIM3 + 0x04, 0b001 << 4)
        for _ in range(2):
            begin = self.machine.clock
            self.sim.write_u32(TIM3, 1)
            self.sim.run_for("3us")
            self.machine.step_board()
            self.assertAlmostEqual(timer.origin, begin, delta=3)
            self.sim.write_u32(TIM3, 0)
            timer.write("cr1", 1 << 7)
            timer.write("cnt", 0)
            self.spend(100)

    def test_compare_modes_keep_their_fourth_bit(self):
        self.assertEqual(self.start("TIM20").read("ccmr1"), 0x0868_09E8 | 1 << 16)

    def over_voltage(self, name):
        """TIM's break from COMP3, rail 1 against 2100 V."""
        self.sim.write_u32(DAC3 + 0x3C, 0b011)
        self.sim.write_u32(DAC3 + 0x00, 1)
        self.sim.write_u32(DAC3 + 0x08, round(2100 / 2500 * 4095))
        self.sim.write_u32(COMP + 8, 0b100 << 4 | 1)
        timer = self.start(name)
        timer.write("af1", 1 << 3)
        timer.write("dier", 1 << 7)
        self.trigger()
        return timer

    def test_over_voltage_clears_the_main_output(self):
        for name, irq in (("TIM1", 24), ("TIM8", 43), ("TIM20", 77)):
            timer = self.over_voltage(name)
            self.assertTrue(timer.read("bdtr") & 1 << 15)
            self.faults.inject({"rail_fault": {"rail": 1, "volts": 2050}})
            self.spend(100)
            self.assertTrue(timer.read("bdtr") & 1 << 15)
            self.faults.inject({"rail_fault": {"rail": 1, "volts": 2150}})
            self.machine.clock_base += 100
            self.machine.step_board()
            self.assertTrue(self.sim.read_u32(NVIC_ISPR + 4 * (irq // 32)) >> irq % 32 & 1, name)
            self.assertFalse(timer.read("bdtr") & 1 << 15)
            self.assertTrue(self.sim.read_u32(COMP + 8) & 1 << 30)
            # It does not stick while the trip lasts.
            timer.write("bdtr", timer.read("bdtr") | 1 << 15)
            self.machine.step_board()
            self.assertFalse(timer.read("bdtr") & 1 << 15)
            self.faults.inject({"rail_fault": {"rail": 1, "volts": None}})
            self.machine.supply.rails[0] = 0.0
            self.machine.step_board()
            timer.write("bdtr", timer.read("bdtr") | 1 << 15)
            self.machine.step_board()
            self.assertTrue(timer.read("bdtr") & 1 << 15)

    def give_permit(self):
        """PA6 is TIM16's output, which is held active."""
        timer = self.machine.timers.permit_timer
        for register, value in (("ccmr1", 0b101 << 4), ("ccer", 1), ("bdtr", 1 << 15 | 1 << 13 | 1 << 12)):
            timer.write(register, value)
        self.sim.write_u32(GPIO["A"] + 0x20, 1 << 24)
        self.sim.write_u32(GPIO["A"], 0b10 << 12)
        self.spend(0)
        return timer

    def test_permit_is_a_held_output_of_tim16(self):
        pins, levels = self.machine.pins, lambda: self.sim.read_u32(GPIO["A"] + 0x10)
        timer = self.give_permit()
        self.assertTrue(pins.permit)
        self.assertEqual(levels(), 1 << 6)
        for register, wrong in (("ccmr1", 0b100 << 4), ("ccer", 0), ("ccer", 0b11), ("bdtr", 1 << 13 | 1 << 12)):
            right = timer.read(register)
            timer.write(register, wrong)
            self.spend(0)
            self.assertFalse(pins.permit, register)
            timer.write(register, right)
        self.sim.write_u32(GPIO["A"] + 0x20, 2 << 24)
        self.spend(0)
        self.assertFalse(pins.permit, "another function")
        self.faults.inject({"pin": {"name": "permit", "stuck": True}})
        self.spend(0)
        self.assertEqual(levels(), 1 << 6)
        self.assertTrue(pins.permit)
        self.give_permit()
        self.faults.inject({"pin": {"name": "permit", "stuck": False}})
        self.spend(0)
        self.assertFalse(pins.permit)

    def test_break_withdraws_the_permit(self):
        self.sim.write_u32(COMP + 16, 1 << 15 | 0b011 << 4 | 1)
        timer = self.give_permit()
        timer.write("af1", 1 << 5)
        self.spend(0)
        self.assertTrue(self.machine.pins.permit)
        electrodes = self.start("TIM4")
        self.trigger()
        self.sim.write_u32(GPIO["B"] + 0x20, 2 << 24)
        self.sim.write_u32(GPIO["B"] + 0x24, 2 << 4)
        self.sim.write_u32(GPIO["B"], 0b10 << 12 | 0b10 << 18)
        self.spend(0)
        self.assertTrue(electrodes.recorded["outputs"])
        # Enable and the two discharge switches, on ports C and D.
        self.sim.write_u32(GPIO["C"], 0b0101 << 4)
        self.sim.write_u32(GPIO["C"] + ODR, 0b11 << 2)
        self.sim.write_u32(DAC1 + 0x3C, 0b010)
        self.sim.write_u32(DAC1, 1)
        self.sim.write_u32(DAC1 + 0x08, 2048)
        self.spend(100 * MILLISECOND)
        self.assertAlmostEqual(self.machine.supply.rails[0], 1000, delta=2)
        self.faults.inject({"interlock": "open"})
        self.machine.step_board()
        self.assertFalse(self.machine.pins.permit)
        self.assertFalse(electrodes.recorded["outputs"])
        self.spend(8 * MILLISECOND)
        self.assertLess(self.machine.supply.rails[0], 60)
        # The chip's pins still say that all is on.
        self.assertEqual(self.sim.read_u32(GPIO["C"] + 0x10), 0b11 << 2)

    def test_loops_trip_inverted_comparators(self):
        for comparator, fault in ((5, {"interlock": "open"}), (7, {"estop": "pressed"})):
            self.sim.write_u32(COMP + 4 * (comparator - 1), 1 << 15 | 0b011 << 4 | 1)
            self.spend(1)
            self.assertFalse(self.machine.protection.outputs[comparator])
            self.faults.inject(fault)
            self.spend(1)
            self.assertTrue(self.machine.protection.outputs[comparator])

    def test_loops_against_dac4(self):
        """Closed loops are at 2.185 V, and the threshold is relative to the same supply; an input that is not connected sees none of it."""
        self.sim.write_u32(DAC4 + 0x3C, 0b011)
        self.sim.write_u32(DAC4, 1)
        for comparator in (5, 7):
            self.sim.write_u32(COMP + 4 * (comparator - 1), 1 << 15 | 0b100 << 4 | 1)
        for volts, reference, trips in ((2.15, 1.0, False), (2.22, 1.0, True), (2.15, 0.9, False), (2.22, 0.9, True)):
            self.sim.write_u32(DAC4 + 0x08, round(volts / 3.3 * 4095))
            self.faults.inject({"reference": reference})
            self.spend(1)
            self.assertEqual([self.machine.protection.outputs[comparator] for comparator in (5, 7)], [trips] * 2, (volts, reference))
        self.faults.inject({"comparator_in": {"number": 5, "volts": 3.3}})
        self.spend(1)
        self.assertEqual([self.machine.protection.outputs[comparator] for comparator in (5, 7)], [False, True])
        self.faults.inject({"comparator_in": {"number": 5, "volts": None}})
        self.spend(1)
        self.assertTrue(self.machine.protection.outputs[5])

    def test_tim4_is_cleared_until_its_next_update(self):
        self.sim.write_u32(DAC3 + 0x3C, 0b011 << 16)
        self.sim.write_u32(DAC3 + 0x00, 1 << 16)
        self.sim.write_u32(DAC3 + 0x14, 2048)
        self.sim.write_u32(COMP + 12, 0b100 << 4 | 1)
        timer = self.start("TIM4")
        timer.write("af2", 3 << 16)
        self.trigger()
        cleared = self.machine.timers.cleared
        self.faults.inject({"overcurrent_ma": 11})
        self.spend(1000)
        self.assertTrue(cleared["TIM4"])
        self.faults.inject({"overcurrent_ma": 0})
        self.spend(1000)
        self.assertTrue(cleared["TIM4"])
        self.spend(9000)
        self.assertFalse(cleared["TIM4"])

    def test_converter_and_rails(self):
        self.calibrate(ADC1)
        self.give_permit()
        self.sim.write_u32(GPIO["C"], 0x0550_0050)
        self.sim.write_u32(GPIO["C"] + ODR, 0b11 << 2)
        self.sim.write_u32(DAC1 + 0x3C, 0b010)
        self.sim.write_u32(DAC1, 1)
        self.sim.write_u32(DAC1 + 0x08, 2048)
        # Two conversions, of rail 1 (ADC1 input 1) and rail 2 (input 2); then the other way round; and the chip's own reference.
        self.sim.write_u32(ADC1 + 0x4C, 2 << 15 | 1 << 9 | 1)
        self.sim.write_u32(ADC1 + 0x30, 18 << 12 | 1 << 6 | 1)
        self.spend(100 * MILLISECOND)
        self.assertAlmostEqual(self.sim.read_u32(ADC1 + 0x40), 1.212 / 3.3 * 4095, delta=1)
        self.assertEqual(self.sim.read_u32(ADC1 + JDR1 + 4), 0)
        self.sim.write_u32(ADC1 + 0x4C, 1 << 15 | 2 << 9 | 1)
        self.spend(1000)
        self.assertAlmostEqual(self.sim.read_u32(ADC1 + JDR1 + 4), 2048 * 2000 / 2500, delta=1)
        self.faults.inject({"reference": 0.9})
        self.spend(1000)
        self.assertAlmostEqual(self.sim.read_u32(ADC1 + 0x40), 1.212 / 2.97 * 4095, delta=1)
        self.faults.inject({"heal": True})
        self.sim.write_u32(ADC1 + 0x4C, 2 << 15 | 1 << 9 | 1)
        # The first conversion after a pause is another one's.
        self.sim.write_u32(ADC1 + 0x08, 1 | 1 << 2)
        self.sim.run_for("8us")
        self.spend(1000)
        self.assertEqual(self.sim.read_u32(ADC1) & 0x0C, 0x0C)
        self.assertEqual(self.sim.read_u32(DAC1 + 0x2C), 2048)
        self.assertAlmostEqual(self.sim.read_u32(ADC1 + JDR1), 2048 * 2000 / 2500, delta=1)
        self.sim.write_u32(ADC1 + 0x08, 1 | 1 << 3)
        self.sim.run_for("5us")
        self.assertEqual(self.sim.read_u32(ADC1) & 0x60, 0x60)
        self.assertEqual(self.sim.read_u32(ADC1 + 0x08) & 1 << 3, 0)

    def test_a_converter_that_is_not_calibrated_is_off(self):
        self.sim.write_u32(ADC1 + 0x4C, 5 << 15 | 5 << 9 | 1)
        self.spend(1000)
        before = self.sim.read_u32(ADC1 + JDR1 + 4)
        self.calibrate(ADC1)
        self.spend(1000)
        self.assertEqual(before - self.sim.read_u32(ADC1 + JDR1 + 4), 63)

    def test_loops_have_levels(self):
        # ADC3 converts its input 5, ADC4 its input 4, twice each.
        self.calibrate(ADC1, ADC3, ADC4)
        for converter, place in ((ADC3, 5), (ADC4, 4)):
            self.sim.write_u32(converter + 0x4C, place << 15 | place << 9 | 1)
        self.sim.write_u32(ADC1 + 0x4C, 5 << 15 | 5 << 9 | 1)
        for faults, volts in (({}, (2.185, 2.185)), ({"interlock": "open", "estop": "shorted"}, (0.0, 3.3)), ({"interlock": 1.9, "estop": "pressed"}, (1.9, 0.0))):
            self.faults.inject(faults)
            self.spend(1000)
            for address, level in zip((ADC3 + JDR1 + 4, ADC4 + JDR1 + 4, ADC1 + JDR1 + 4), (*volts, volts[1])):
                self.assertAlmostEqual(self.sim.read_u32(address) / 4095 * 3.3, level, delta=2e-3)

    def test_average_current_is_a_mean_of_64_conversions(self):
        """ADC2 at 42.5 MHz: 64 times 640.5 + 12.5 clocks are 0.983 ms."""
        self.calibrate(ADC2)
        self.faults.inject({"average_ma": 0.5})
        for offset, value in ((0x14, 0b111 << 21), (0x0C, 1 << 13), (0x10, 2 << 5 | 0b101 << 2 | 1), (0x30, 7 << 6), (0x08, 1 << 2)):
            self.sim.write_u32(ADC2 + offset, value)
        self.spend(0)
        self.spend(int(0.97 * MILLISECOND))
        self.assertEqual(self.sim.read_u32(ADC2) & 1 << 2, 0)
        self.spend(int(0.02 * MILLISECOND))
        self.assertEqual(self.sim.read_u32(ADC2) & 1 << 2, 1 << 2)
        self.assertAlmostEqual(self.sim.read_u32(ADC2 + 0x40), 0.5 / 2.0 * 64 * 4095 / 4, delta=1)
        self.sim.write_u32(ADC2, 1 << 2)
        self.sim.run_for("100ns")
        self.assertEqual(self.sim.read_u32(ADC2) & 1 << 2, 0)

    def test_which_electrodes_are_high(self):
        """TIM8: A from 100 to 200 of 10 000 ticks, B (channel 4) from 400 to 300, which is never; then as a plain output."""
        timer = self.start("TIM8")
        self.trigger()
        self.machine.timers.connected["TIM8"] = True
        origin, levels = timer.origin, self.machine.sensing.electrodes.levels
        self.assertEqual(
            levels(origin, origin + 1000),
            [(origin + 100, frozenset()), (origin + 200, frozenset([(1, "a")])), (origin + 1000, frozenset())],
        )
        self.machine.timers.connected["TIM8"] = False
        self.assertEqual(levels(origin, origin + 1000), [(origin + 1000, frozenset())])
        self.sim.write_u32(GPIO["C"], 0b01 << 18)
        self.sim.write_u32(GPIO["C"] + ODR, 1 << 9)
        self.machine.pins.step(self.machine.timers, origin)
        self.assertEqual(levels(origin, origin + 1000), [(origin + 1000, frozenset([(1, "b")]))])

    def test_the_gate_of_era_4_follows_the_permit(self):
        self.sim.write_u32(GPIO["B"], 0b01 << 12)
        self.sim.write_u32(GPIO["B"] + ODR, 1 << 6)
        levels = self.machine.sensing.electrodes.levels
        for high, electrodes in ((False, []), (True, [(3, "a")])):
            self.faults.inject({"pin": {"name": "permit", "stuck": high}})
            self.machine.pins.step(self.machine.timers, 0)
            self.assertEqual(levels(0, 1000), [(1000, frozenset(electrodes))])

    def test_voltage_detector(self):
        self.sim.write_u32(PWR + 0x04, 1)
        self.sim.write_u32(EXTI, 1 << 16)
        self.sim.write_u32(EXTI + 0x08, 1 << 16)
        self.sim.write_u32(SYSCFG + 0x1C, 1 << 2)
        timer = self.start("TIM1")
        self.trigger()
        self.faults.inject({"pvd": "low"})
        self.machine.step_board()
        self.assertTrue(self.sim.read_u32(PWR + 0x14) & 1 << 11)
        self.assertTrue(self.sim.read_u32(EXTI + 0x14) & 1 << 16)
        self.assertTrue(self.sim.read_u32(NVIC_ISPR) & 1 << 1)
        self.assertFalse(timer.read("bdtr") & 1 << 15)

    def test_watchdog_resets_unless_fed(self):
        watchdog = IWDG
        for offset, value in ((0x00, 0xCCCC), (0x00, 0x5555), (0x04, 0), (0x08, 79)):
            self.sim.write_u32(watchdog + offset, value)
        self.sim.run_for("100ns")
        for _ in range(5):  # 10 ms each
            self.machine.clock_base += 8 * MILLISECOND
            self.machine.step_board()
            self.sim.write_u32(watchdog, 0xAAAA)
            self.sim.run_for("100ns")
            self.machine.step_board()
        self.assertEqual(self.machine.resets, [])
        self.machine.clock_base += 11 * MILLISECOND
        self.machine.step_board()
        self.assertEqual([reset["cause"] for reset in self.machine.resets], ["watchdog"])
        self.assertEqual(self.machine.sim.read_u32(RCC_CSR), 1 << 29 | 1 << 26)

    def test_watchdog_takes_settings_after_their_key_alone(self):
        """RM0440, section 42.3.4; the values after a reset are 0 and 0xFFF. At first SR says that they are on their way."""
        settings = lambda: (self.sim.read_u32(IWDG + 4), self.sim.read_u32(IWDG + 8))
        for keys, expected in (
            ((), (0, 0xFFF)), ((0xCCCC,), (0, 0xFFF)), ((0xCCCC, 0x5555), (3, 99)), ((0x5555,), (3, 99)), ((0x5555, 0xAAAA), (0, 0xFFF)),
            ((0x5555, 0xCCCC), (0, 0xFFF)),
        ):
            self.renew()
            for key in keys:
                self.sim.write_u32(IWDG, key)
                self.spend(0)
                self.machine.step_board()
            self.sim.write_u32(IWDG + 4, 3)
            self.sim.write_u32(IWDG + 8, 99)
            self.sim.run_for("100ns")
            self.assertEqual(self.sim.read_u32(IWDG + 0xC), 0b11)
            self.machine.step_board()
            self.assertEqual(settings(), expected, keys)

    def test_tim5_measures_the_watchdogs_oscillator(self):
        tim5 = 0x4000_0C00
        registers = {0x5C: 1, 0x18: 0b01, 0x20: 1, 0x08: 0b101 << 4 | 0b100, 0x00: 1}
        flag_and_period = lambda: (self.sim.read_u32(tim5 + 0x10) & 2, self.sim.read_u32(tim5 + 0x34))
        for offset, value in registers.items():
            self.sim.write_u32(tim5 + offset, value)
        self.spend(MILLISECOND)
        self.assertEqual(flag_and_period(), (0, 0), "the oscillator is off")
        self.sim.write_u32(RCC_CSR, 1)
        self.spend(MILLISECOND)
        self.assertEqual(flag_and_period(), (2, CLOCK_HZ // 32_000))
        self.faults.inject({"lsi": 1.25})
        self.spend(MILLISECOND)
        self.assertEqual(flag_and_period(), (2, CLOCK_HZ // 40_000))
        self.sim.write_u32(tim5 + 0x10, 0)
        for offset, value in registers.items():
            self.sim.write_u32(tim5 + offset, 0)
            self.spend(MILLISECOND)
            self.assertEqual(flag_and_period()[0], 0, hex(offset))
            self.sim.write_u32(tim5 + offset, value)
        self.faults.inject({"lsi": 0})
        self.spend(MILLISECOND)
        self.assertEqual(flag_and_period()[0], 0)

    def test_broken_watchdog_resets_nothing(self):
        self.faults.inject({"watchdog": "broken"})
        for offset, value in ((0x00, 0xCCCC), (0x00, 0x5555), (0x04, 0), (0x08, 0), (0x00, 0xAAAA)):
            self.sim.write_u32(IWDG + offset, value)
        self.sim.run_for("100ns")
        # It is started at the first step, and should reset the chip at the second.
        self.spend(0)
        self.spend(MILLISECOND)
        self.assertEqual(self.machine.resets, [])
        self.faults.inject({"heal": True})
        self.machine.step_board()
        self.assertEqual([reset["cause"] for reset in self.machine.resets], ["watchdog"])

    def test_time_base_keeps_up_with_time_passed_over(self):
        machine = self.machine
        machine.boot()
        # The start has reset the chip once, to try the watchdog.
        self.sim = machine.sim

        def apart():
            """Clocks that the time base's count is off, up to a constant."""
            full = 0x1_0000 * TICK
            off = (machine.clock - (self.sim.read_u32(TIM2_CNT) & 0xFFFF) * TICK - begin) % full
            return (off + full // 2) % full - full // 2

        begin = 0
        begin = apart()
        # Some 2000 sleeps of the device task.
        while machine.time_s < 2.0:
            machine.advance(2.0)
            self.assertLess(abs(apart()), 3 * TICK)
        self.assertGreater(machine.clock_base, CLOCK_HZ)

    def test_reset_keeps_ram_and_voltage_but_no_register(self):
        spare = RAM + RAM_BYTES // 2
        self.sim.write_u32(spare, 0x1234_5678)
        self.start("TIM1")
        self.machine.supply.rails[0] = 500.0
        before = self.machine.clock
        self.sim.write_u32(AIRCR, 0x05FA_0004)
        self.machine.run_slice("1us")
        self.assertEqual([reset["cause"] for reset in self.machine.resets], ["software"])
        self.assertEqual(self.machine.sim.read_u32(spare), 0x1234_5678)
        self.assertEqual(self.timer("TIM1").read("bdtr"), 0)
        self.assertGreater(self.machine.supply.rails[0], 490.0)
        self.assertGreaterEqual(self.machine.clock, before)


if __name__ == "__main__":
    unittest.main()
