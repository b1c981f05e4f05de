"""The watchdog's oscillator (LSI), and TIM5 as far as it measures its period: input 1 is LSI, each rising edge captures the count and sets it to zero
(RM0440, sections 29.4.3 and 29.4.20, TIM5_TISEL)."""

from chip import CLOCK_HZ, RCC_CSR
from timers import CEN, SR_SET, Timer

LSI_HZ = 32_000
TIM5, TISEL = 0x4000_0C00, 0x5C
LSION = 1 << 0
TI1SEL_LSI = 0b0001
# CCMR1.CC1S (01: input 1) with its prescaler and filter off; CCER.CC1E without CC1P and CC1NP.
CCMR1_MASK, CCMR1_INPUT_1 = 0xFF, 0b01
CCER_MASK, CCER_RISING = 0b1011, 0b0001
# SMCR: SMS = 0100 (reset), TS = 00101 (filtered input 1).
SMCR_MASK, SMCR_RESET_BY_INPUT_1 = 1 << 16 | 0b11 << 20 | 0b111 << 4 | 0b111, 0b101 << 4 | 0b100
CC1IF = 1 << 1


class Lsi:
    def __init__(self, sim, defects):
        self.sim = sim
        self.defects = defects
        self.timer = Timer(sim, "TIM5", TIM5)
        self.edge_at = 0

    @property
    def hz(self):
        return LSI_HZ * self.defects.lsi

    def step(self, clock, watchdog_runs):
        """Captures the last period, if there has been an edge."""
        if not self.hz or clock - self.edge_at < CLOCK_HZ / self.hz:
            return
        self.edge_at = clock
        # The watchdog keeps its oscillator running.
        if not (watchdog_runs or self.sim.read_u32(RCC_CSR) & LSION) or not self.measures():
            return
        self.timer.write("ccr1", round(CLOCK_HZ / self.hz / (self.timer.read("psc") + 1)))
        self.sim.write_u32(TIM5 + SR_SET, CC1IF)

    def measures(self):
        timer = self.timer
        return (
            bool(timer.read("cr1") & CEN) and self.sim.read_u32(TIM5 + TISEL) & 0xF == TI1SEL_LSI
            and timer.read("ccmr1") & CCMR1_MASK == CCMR1_INPUT_1 and timer.read("ccer") & CCER_MASK == CCER_RISING
            and timer.read("smcr") & SMCR_MASK == SMCR_RESET_BY_INPUT_1
        )
