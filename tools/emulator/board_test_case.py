"""What the tests of the board around the chip have in common: registers are written from outside, before the firmware has got anywhere."""

import os
import unittest

from chip import ADCAL, CR, TIM3
from faults import Faults
from machine import Machine

RCC_AHB2ENR, RCC_APB1ENR1, RCC_APB2ENR = 0x4002_104C, 0x4002_1058, 0x4002_1060


class BoardTestCase(unittest.TestCase):
    def setUp(self):
        self.machine = Machine(os.environ["ERA_ELF"])
        self.addCleanup(lambda: self.machine.close())
        self.sim = self.machine.sim
        self.faults = Faults(self.machine)
        for register in (RCC_AHB2ENR, RCC_APB1ENR1, RCC_APB2ENR):
            self.sim.write_u32(register, 0xFFFF_FFFF)

    def renew(self):
        """Another board, as at the beginning."""
        self.machine.close()
        self.setUp()

    def spend(self, clocks):
        """Time that only the board notices, then a few clocks in which flags are set."""
        self.machine.clock_base += clocks
        self.machine.step_board()
        self.sim.run_for("100ns")

    def calibrate(self, *converters):
        for converter in converters:
            self.sim.write_u32(converter + CR, ADCAL)
        # 200 clocks of 170 MHz.
        self.sim.run_for("2us")

    def timer(self, name):
        return self.machine.timers.permit_timer if name == "TIM16" else self.machine.timers.timers[name]

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
