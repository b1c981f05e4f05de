"""Tests of the board around the chip: registers are written from outside, before the firmware has got anywhere.

usage: launch.py --self-test --elf PATH
"""

import os
import unittest

from chip import (
    ADC1, AIRCR, CLOCK_HZ, COMP, DAC1, DAC3, EXTI, GPIO, IWDG, JDR1, NVIC_ISPR, ODR, PWR, RAM, RAM_BYTES, RCC_CSR, SYSCFG, TIM3,
)
from faults import Faults
from machine import Machine
from supply import DISCHARGE_S, FOLLOW_S, Supply

RCC_AHB2ENR, RCC_APB1ENR1, RCC_APB2ENR = 0x4002_104C, 0x4002_1058, 0x4002_1060
MILLISECOND = CLOCK_HZ // 1000
# A count of the time base, TIM2, in clocks.
TICK = CLOCK_HZ // 1_000_000
TIM2_CNT = 0x4000_0024


class SupplyTest(unittest.TestCase):
    def test_rail_follows_and_discharges(self):
        supply = Supply()
        for _ in range(10):
            supply.step(FOLLOW_S / 10, [0.5, 0.0], True, [True, True])
        self.assertAlmostEqual(supply.rails[0], 1000 * (1 - 0.36788), places=1)
        self.assertEqual(supply.rails[1], 0.0)
        before = supply.rails[0]
        supply.step(DISCHARGE_S, [0.5, 0.0], True, [False, True])
        self.assertAlmostEqual(supply.rails[0] / before, 0.36788, places=4)

    def test_charging_takes_current(self):
        supply = Supply()
        supply.step(1e-3, [0.1, 0.0], True, [True, True])
        self.assertGreater(supply.average_a, 40e-6)
        supply.step(1.0, [0.1, 0.0], True, [True, True])
        self.assertLess(supply.average_a, 5e-6)


class BoardTest(unittest.TestCase):
    def setUp(self):
        self.machine = Machine(os.environ["ERA_ELF"])
        self.addCleanup(lambda: self.machine.close())
        self.sim = self.machine.sim
        self.faults = Faults(self.machine)
        for register in (RCC_AHB2ENR, RCC_APB1ENR1, RCC_APB2ENR):
            self.sim.write_u32(register, 0xFFFF_FFFF)

    def spend(self, clocks):
        """Time that only the board notices, then a few clocks in which flags are set."""
        self.machine.clock_base += clocks
        self.machine.step_board()
        self.sim.run_for("100ns")

    def timer(self, name):
        return self.machine.timers.timers[name]

    def start(self, name, psc=0, arr=9999):
        """As the firmware starts a timer: preloaded, as a slave of TIM3."""
        timer = self.timer(name)
        for register, value in (
            ("psc", psc), ("arr", arr), ("ccr1", 100), ("ccr2", 200), ("ccr3", 300), ("ccr4", 400), ("ccmr1", 0x0868_09E8 | 1 << 16),
            ("ccmr2", 0x0868 | 1 << 7), ("ccer", 0x0101), ("smcr", 0x26), ("cr1", 1 << 7), ("bdtr", 1 << 15 | 1 << 13 | 1 << 12),
        ):
            timer.write(register, value)
        self.sim.write_u32(timer.base + 0x14, 1)
        self.spend(0)
        return timer

    def trigger(self):
        self.sim.write_u32(TIM3 + 0x04, 0b001 << 4)
        self.sim.write_u32(TIM3, 1)
        self.spend(0)

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

    def test_loops_trip_inverted_comparators(self):
        for comparator, fault in ((5, {"interlock": "open"}), (7, {"estop": "pressed"})):
            self.sim.write_u32(COMP + 4 * (comparator - 1), 1 << 15 | 0b011 << 4 | 1)
            self.spend(1)
            self.assertFalse(self.machine.protection.outputs[comparator])
            self.faults.inject(fault)
            self.spend(1)
            self.assertTrue(self.machine.protection.outputs[comparator])

    def test_tim4_is_cleared_until_its_next_update(self):
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
        self.sim.write_u32(GPIO["C"], 0x0550_0050)
        self.sim.write_u32(GPIO["C"] + ODR, 0b11 << 2)
        self.sim.write_u32(DAC1, 1)
        self.sim.write_u32(DAC1 + 0x08, 2048)
        self.spend(100 * MILLISECOND)
        self.assertEqual(self.sim.read_u32(DAC1 + 0x2C), 2048)
        self.assertAlmostEqual(self.sim.read_u32(ADC1 + JDR1), 2048 * 2000 / 2500, delta=1)
        self.sim.write_u32(ADC1 + 0x08, 1 << 3)
        self.sim.run_for("5us")
        self.assertEqual(self.sim.read_u32(ADC1) & 0x60, 0x60)
        self.assertEqual(self.sim.read_u32(ADC1 + 0x08) & 1 << 3, 0)

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

    def test_time_base_keeps_up_with_time_passed_over(self):
        machine = self.machine
        machine.boot()

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
