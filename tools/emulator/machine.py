"""The emulated board: the firmware image in labwired with the board around it, and the time that the processor would sleep
passed over.

labwired carries out every cycle, also those of a sleeping processor, which makes a second of this firmware last over a
minute. The firmware says when it has nothing to do (its symbol ERA_CPU_IDLE). All its time comes from TIM2, so this
module then sets TIM2's counter to just before its next event: what the firmware sees is the same, only sooner.
"""

import os
import pathlib

from labwired import Sim

from chip import (
    AIRCR, CLOCK_HZ, EXCEPTIONS, FLASH_OPTR, ICSR, IRQ_LPUART1, IRQ_TIM2, IRQ_UNUSED, LPUART1, NVIC_ISER, NVIC_ISPR, NVIC_WORDS, RAM,
    RAM_BYTES, RCC_CSR, RESET_FLAGS, RNG_DATA, SYSRESETREQ, TIM2, VECTACTIVE, pend,
)
from defects import Defects
from electrodes import Electrodes
from entry import align_stack
from lock import Locks
from lsi import Lsi
from pins import HAZARDOUS, Pins
from protection import Protection
from sensing import Sensing
from supply import Supply
from timers import Timers
from watchdog import Watchdog

BOARD = pathlib.Path(__file__).resolve().parent / "board" / "system.yaml"

# What runs at a time before the machine is looked at again. Longer than one tick of the firmware's device task takes,
# so that most ticks need one slice.
SLICE = "5us"
# The same while bytes come in: what the UART's interrupt takes.
RECEIVING_SLICE = "2us"
# The same while the load is measured, which is the resolution of that, and how many of them make a slice.
FINE_SLICE, FINE_SLICES = "500ns", 10
# What is passed over at a time while the processor hangs, in ticks of the time base.
HANGING_TICKS = 100

# The firmware is up within a millisecond; one that is not hangs.
BOOT_LIMIT_S = 0.1

# Time base: one tick a microsecond, a 16-bit counter with events at half and full count, and an alarm in CCR2.
TICK_S = 1e-6
TICK_CLOCKS = CLOCK_HZ // 1_000_000
HALF_COUNT = 0x8000
FULL_COUNT = 0x10000
DIER, SR, CNT, CCR2 = 0x0C, 0x10, 0x24, 0x38
ALARM_ENABLED = 1 << 2
# The counter is set this many ticks before an event, as the model raises it when the counter passes it.
MARGIN_TICKS = 2
# What writing the counter may lose, in ticks; less than the margin.
LOST_TICKS = 1

# RM0440, section 38.7: the receive register is not empty.
LPUART1_ISR = LPUART1 + 0x1C
RXNE = 1 << 5

# What stack memory holds until the firmware writes there: a word that it hardly ever writes itself.
STACK_PAINT = 0x57AC_C01A


class Machine:
    """One board, powered up."""

    def __init__(self, elf):
        self.elf = elf
        self.supply = Supply()
        self.defects = Defects()
        self.history = None
        self.waiting = bytearray()
        # Clocks of the chip's earlier lives and clocks passed over, and the same as carried-out cycles alone.
        self.clock_base = 0
        self.cycles_base = 0
        self.resets = []
        # How many of them belong to the start after power-up, and how long after one of them a pad that can energise something was high.
        self.start_resets, self.high_after_reset_s = 0, 0.0
        self.fit("power_on")
        self.paint_stack()

    def fit(self, cause):
        """A chip that has just been reset, on the board as it is."""
        self.sim = Sim(self.elf, system=BOARD, uart="lpuart1")
        self.sim.write_u32(RCC_CSR, RESET_FLAGS[cause])
        self.sim.write_u32(FLASH_OPTR, self.defects.option_bytes)
        align_stack(self.sim)
        self.stir()
        self.idle_address = self.sim.symbol("ERA_CPU_IDLE")
        self.timers = Timers(self.sim, self.history)
        self.locks = Locks(self.timers)
        self.history = self.timers.history
        self.pins = Pins(self.sim, self.defects)
        self.sensing = Sensing(self.sim, self.supply, self.pins, Electrodes(self.timers, self.pins), self.defects)
        self.sensing.clock = self.clock
        self.protection = Protection(self.sim, self.sensing, self.supply, self.timers, self.defects)
        self.lsi = Lsi(self.sim, self.defects)
        self.watchdog = Watchdog(self.sim, self.defects, self.lsi, has_reset_chip=cause == "watchdog")
        # Whether faults.py has made an endless handler.
        self.looping = False
        # Whether an event of the time base was already due at the end of the last slice.
        self.due_before = False
        # The clock at which the time base's count was zero, see `pass_over_ticks`.
        self.time_base_zero = None

    def reset(self, cause):
        """Resets the chip; RAM is kept, flash is as it was built."""
        ram = self.sim.read_memory(RAM, RAM_BYTES)
        low = self.protection.supply_low
        self.waiting.clear()
        self.clock_base = self.clock
        self.cycles_base += self.sim.cycles
        self.sim.close()
        self.fit(cause)
        self.protection.supply_low = low
        for address in range(0, RAM_BYTES, 4):
            word = int.from_bytes(ram[address : address + 4], "little")
            if word:
                self.sim.write_u32(RAM + address, word)
        # What the last life said of itself is over, before the start-up code gets to clear it.
        self.sim.write_u32(self.idle_address & ~3, 0)
        self.resets.append({"virtual_s": self.time_s, "cause": cause})
        self.timers.note_all(self.clock)

    def close(self):
        self.sim.close()

    def boot(self):
        """Runs until the firmware has nothing to do for the first time: its links are then open."""
        end = self.time_s + BOOT_LIMIT_S
        while not self.is_idle():
            if self.time_s > end:
                raise RuntimeError(f"the firmware is not up after {BOOT_LIMIT_S} s of its own time")
            self.run_slice(SLICE)
            if any(self.pins.is_high(*pin) for pin in HAZARDOUS):
                # Nothing is passed over meanwhile: since the last reset, all clocks are carried-out ones.
                self.high_after_reset_s = max(self.high_after_reset_s, self.sim.cycles / CLOCK_HZ)
        self.start_resets = len(self.resets)

    def stir(self):
        """Puts a fresh number into the hardware random number generator, from which the firmware takes one at every
        start. 0 would mean that it failed."""
        self.sim.write_u32(RNG_DATA, int.from_bytes(os.urandom(4), "little") | 1)

    def paint_stack(self):
        """Fills the memory that the stack can grow into, before the first instruction."""
        # cortex-m-rt: the stack grows down from _stack_start, and _stack_end is where variables end.
        self.stack_top = self.sim.symbol("_stack_start")
        self.stack_bottom = self.sim.symbol("_stack_end")
        for address in range(self.stack_bottom, self.stack_top, 4):
            self.sim.write_u32(address, STACK_PAINT)

    def stack(self):
        """Bytes of stack there are, and the most that were in use at once since power-up: down to the lowest word that
        was written."""
        words = self.sim.read_memory(self.stack_bottom, self.stack_top - self.stack_bottom)
        paint = STACK_PAINT.to_bytes(4, "little")
        untouched = 0
        while words[untouched:untouched + 4] == paint:
            untouched += 4
        return {"size": len(words), "used": len(words) - untouched}

    @property
    def clock(self):
        """Clocks of 170 MHz since power-up."""
        return self.clock_base + self.sim.cycles

    @property
    def time_s(self):
        """Virtual time since power-up in s."""
        return self.clock / CLOCK_HZ

    @property
    def cycles(self):
        """Cycles that were carried out; those that were passed over are not in it."""
        return self.cycles_base + self.sim.cycles

    def receive(self, data):
        """Bytes from the host to the board's UART."""
        self.waiting += data

    def transmitted(self):
        """Bytes that the board's UART has sent since the last call."""
        return self.sim.read_uart_bytes()

    def advance(self, until_s):
        """Runs one slice, then passes over idle time, but not beyond `until_s`."""
        self.run_slice(RECEIVING_SLICE if self.feed() else SLICE)
        self.pass_over(until_s)

    def feed(self):
        """Hands the next byte to the UART; whether there is one."""
        if not self.waiting:
            return False
        # The UART model takes a byte but raises no interrupt, so it is raised here, byte by byte. The next byte
        # waits until the firmware has taken this one, so a burst never overruns it; this is faster than a real line
        # at 115 200 baud, which would take 87 us for each.
        if not self.sim.read_u32(LPUART1_ISR) & RXNE:
            self.sim.send_bytes(self.waiting[:1])
            del self.waiting[0]
        pend(self.sim, IRQ_LPUART1)
        return True

    def run_slice(self, length):
        self.sim.run_for(length)
        self.step_board()

    def pass_over(self, until_s):
        """Passes over time in which nothing happens."""
        if self.waiting:
            return
        if self.is_idle():
            self.pass_over_idle_time(until_s)
            self.stir()
        elif self.hangs():
            due = self.event_is_due()
            if not due:
                self.pass_over_idle_time(until_s)
            elif self.due_before:
                # Nobody serves it.
                self.pass_over_ticks(min(HANGING_TICKS, self.ticks_until(until_s)))
            self.due_before = due

    def step_board(self):
        """Lets the board around the processor catch up with it."""
        if self.sim.read_u32(AIRCR) & SYSRESETREQ:
            self.reset("software")
        clock = self.clock
        self.locks.step()
        self.pins.step(self.timers, clock)
        self.timers.step(clock)
        self.sensing.step(clock)
        self.protection.step(clock)
        if self.pins.with_timer:
            self.pins.step_levels(self.timers, clock)
        self.lsi.step(clock, self.watchdog.started)
        if self.watchdog.step(clock):
            self.reset("watchdog")

    def is_idle(self):
        """Whether the processor sleeps: the firmware says so, no handler runs, and none is about to."""
        read = self.sim.read_u32
        if read(self.idle_address) & 0xFF == 0 or read(ICSR) & VECTACTIVE:
            return False
        return not any(read(NVIC_ISER + 4 * word) & read(NVIC_ISPR + 4 * word) for word in range(NVIC_WORDS))

    def hangs(self):
        """Whether the processor is in the endless handler that faults.py has put there, with nothing to interrupt it."""
        return self.looping and self.sim.read_u32(ICSR) & VECTACTIVE == EXCEPTIONS + IRQ_UNUSED

    def event_is_due(self):
        return bool(self.sim.read_u32(TIM2 + SR) & self.sim.read_u32(TIM2 + DIER))

    def ticks_until(self, until_s):
        return int((until_s - self.time_s) / TICK_S)

    def pass_over_idle_time(self, until_s):
        read = self.sim.read_u32
        ticks = self.ticks_until(until_s)
        if self.event_is_due():
            if read(NVIC_ISER + 4 * (IRQ_TIM2 // 32)) >> IRQ_TIM2 % 32 & 1:
                return  # It is about to be served.
            self.pass_over_ticks(min(HANGING_TICKS, ticks))
            return
        count = read(TIM2 + CNT) & 0xFFFF
        events = [HALF_COUNT, FULL_COUNT]
        if read(TIM2 + DIER) & ALARM_ENABLED:
            events.append(read(TIM2 + CCR2) & 0xFFFF)
        distance = min((event - count) % FULL_COUNT or FULL_COUNT for event in events)
        self.pass_over_ticks(min(distance - MARGIN_TICKS, ticks))

    def pass_over_ticks(self, ticks):
        if ticks > 0:
            count = self.sim.read_u32(TIM2 + CNT) & 0xFFFF
            if self.time_base_zero is None:
                self.time_base_zero = self.clock - count * TICK_CLOCKS
            self.clock_base += ticks * TICK_CLOCKS
            # The model begins a tick anew when its count is written. Counted from what it then has, the part of a tick that is
            # lost each time would add up to some 0.4 ms in a second, which the electrodes' timers do not lose.
            due = (self.clock - self.time_base_zero) // TICK_CLOCKS
            behind = (due - count - ticks + HALF_COUNT) % FULL_COUNT - HALF_COUNT
            if abs(behind) > LOST_TICKS:
                # It was stopped or set by somebody else.
                self.time_base_zero, behind = None, 0
            self.sim.write_u32(TIM2 + CNT, (count + ticks + max(behind, 0)) % FULL_COUNT)
            self.step_board()

    def load(self, seconds):
        """Runs for so long and returns the clocks in which the processor was at work, and all clocks."""
        begin, busy = self.clock, 0
        end_s = self.time_s + seconds
        while self.time_s < end_s:
            for _ in range(FINE_SLICES):
                before, was_busy = self.cycles, not self.is_idle()
                self.sim.run_for(FINE_SLICE)
                is_busy = not self.is_idle()
                # A slice at whose beginning or end it slept counts half.
                busy += (self.cycles - before) * (was_busy + is_busy) / 2
                if not was_busy and not is_busy:
                    break
            self.step_board()
            self.pass_over(end_s)
        return busy, self.clock - begin

    def rails(self):
        """Codes of the two set-points, the true rail voltages, and the average current."""
        return {
            "rails": self.sensing.set_points(), "rail_volts": list(self.supply.rails),
            "average_ua": self.supply.measured_current() * 1e6,
        }
