"""Addresses and bits of the STM32G474's registers (RM0440) that the board around it looks at or sets."""

CLOCK_HZ = 170_000_000

# Section 2.2.2.
FLASH, FLASH_BYTES = 0x0800_0000, 512 * 1024
RAM, RAM_BYTES = 0x2000_0000, 128 * 1024
TIM2 = 0x4000_0000
TIM3 = 0x4000_0400
IWDG = 0x4000_3000
PWR = 0x4000_7000
LPUART1 = 0x4000_8000
SYSCFG = 0x4001_0000
COMP = 0x4001_0200
EXTI = 0x4001_0400
RCC_CSR = 0x4002_1094
GPIO = {"A": 0x4800_0000, "B": 0x4800_0400, "C": 0x4800_0800, "D": 0x4800_0C00}
ADC1 = 0x5000_0000
DAC1 = 0x5000_0800
DAC3 = 0x5000_1000
RNG_DATA = 0x5006_0808
NVIC_ISER, NVIC_ICER, NVIC_ISPR, NVIC_IPR = 0xE000_E100, 0xE000_E180, 0xE000_E200, 0xE000_E400
ICSR = 0xE000_ED04
VTOR = 0xE000_ED08
AIRCR = 0xE000_ED0C
# Interrupts, and words of enable and pending bits for them.
INTERRUPTS, NVIC_WORDS = 102, 4

# Reset flags in RCC_CSR (section 7.4.29). Every reset pulls the pin low, so PINRSTF comes with each of them.
RESET_FLAGS = {
    "power_on": 1 << 27 | 1 << 26,
    "brown_out": 1 << 27 | 1 << 26,
    "watchdog": 1 << 29 | 1 << 26,
    "software": 1 << 28 | 1 << 26,
    "pin": 1 << 26,
}
# Cortex-M4, AIRCR.SYSRESETREQ; ICSR.VECTACTIVE.
SYSRESETREQ = 1 << 2
VECTACTIVE = 0x1FF
# The processor's own exceptions; the first interrupt comes after them.
EXCEPTIONS = 16

# General-purpose ports, section 9.4.
MODER, ODR, AFRL = 0x00, 0x14, 0x20
PIN_MODES = ("input", "output", "timer", "analog")

# Converters, sections 21.7 and 22.7.
JDR1 = 0x80
DAC_CR, DHR12R1, DHR12R2, DOR1, DOR2 = 0x00, 0x08, 0x14, 0x2C, 0x30
DAC_ENABLED = (1 << 0, 1 << 16)
FULL_SCALE_CODE = 4095
SUPPLY_V = 3.3

# Interrupts, section 14.3.
IRQ_PVD = 1
IRQ_TIM2 = 28
# UART5: not on this board.
IRQ_UNUSED = 53
IRQ_LPUART1 = 91


def pend(sim, irq):
    """Makes an interrupt pending."""
    word, bit = divmod(irq, 32)
    sim.write_u32(NVIC_ISPR + 4 * word, 1 << bit)


def pin_mode(sim, port, number):
    return PIN_MODES[sim.read_u32(GPIO[port] + MODER) >> (2 * number) & 0b11]


def is_driven_high(sim, port, number):
    """Whether a pin is an output and told to be high; everything else is left to the resistors outside."""
    return pin_mode(sim, port, number) == "output" and bool(sim.read_u32(GPIO[port] + ODR) >> number & 1)


def dac_code(sim, dac, channel):
    """What a converter's channel puts out, 0 or 1 for its first or second; moves the holding register over."""
    holding, output = (DHR12R1, DOR1) if channel == 0 else (DHR12R2, DOR2)
    if not sim.read_u32(dac + DAC_CR) & DAC_ENABLED[channel]:
        return 0
    code = sim.read_u32(dac + holding) & FULL_SCALE_CODE
    if sim.read_u32(dac + output) != code:
        sim.write_u32(dac + output, code)
    return code
