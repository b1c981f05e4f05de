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
FLASH_OPTR = 0x4002_2020
GPIO = {"A": 0x4800_0000, "B": 0x4800_0400, "C": 0x4800_0800, "D": 0x4800_0C00}
ADC1, ADC2, ADC3, ADC4 = 0x5000_0000, 0x5000_0100, 0x5000_0400, 0x5000_0500
DAC1 = 0x5000_0800
DAC3, DAC4 = 0x5000_1000, 0x5000_1400
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
    "option_bytes": 1 << 25 | 1 << 26,
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
MODER, IDR, ODR, AFRL, AFRH = 0x00, 0x10, 0x14, 0x20, 0x24
PIN_MODES = ("input", "output", "timer", "analog")

# Converters, sections 21.7 and 22.7.
JDR1, JSQR, SQR1, DR = 0x80, 0x4C, 0x30, 0x40
# Where JSQ1 to JSQ4 and SQ1 to SQ4 are in these registers.
JSQR_PLACES, SQR1_PLACES = (9, 15, 21, 27), (6, 12, 18, 24)
CALFACT, ADCAL = 0xB4, 1 << 31
CR, CFGR, CFGR2, ADSTART, CONT, ROVSE = 0x08, 0x0C, 0x10, 1 << 2, 1 << 13, 1 << 0
# Where CFGR2.OVSR and OVSS are; bits of each SMPx in SMPR1.
OVSR_SHIFT, OVSS_SHIFT, SMP_BITS = 2, 5, 3
# Not of the chip: which sequences have been started, see board/peripherals/adc.yaml.
STARTED, STARTED_REGULAR, STARTED_INJECTED = 0xD4, 1 << 0, 1 << 1
# Sampling times by their code, and what a conversion of 12 bits takes besides, in clocks of the converter: 170 MHz / 4.
SMPR1, SAMPLING, CONVERTING, CONVERTER_CLOCKS = 0x14, (2.5, 6.5, 12.5, 24.5, 47.5, 92.5, 247.5, 640.5), 12.5, 4
# Not of the chip: raises EOC, see board/peripherals/adc2.yaml.
EOC_SET = 0xD0
# The chip's own reference, and where its code at a supply of 3.0 V is kept.
VREFINT_V = 1.212
DAC_CR, DHR12R1, DHR12R2, DOR1, DOR2, MCR = 0x00, 0x08, 0x14, 0x2C, 0x30, 0x3C
DAC_ENABLED = (1 << 0, 1 << 16)
# MCR.MODEx without sample and hold -> whether the channel's pin and the inside of the chip are connected, and whether the buffer is on.
MODE_SHIFTS, DAC_MODES = (0, 16), {0b000: ("pin", True), 0b001: ("pin inside", True), 0b010: ("pin", False), 0b011: ("inside", False)}
# The buffer comes as near to either supply (DS12288, DAC characteristics).
BUFFER_V = 0.2
FULL_SCALE_CODE = 4095
SUPPLY_V = 3.3

# Interrupts, section 14.3.
IRQ_PVD = 1
IRQ_TIM16 = 25
IRQ_TIM2 = 28
# UART5: not on this board.
IRQ_UNUSED = 53
IRQ_LPUART1 = 91


def pend(sim, irq):
    """Makes an interrupt pending."""
    word, bit = divmod(irq, 32)
    sim.write_u32(NVIC_ISPR + 4 * word, 1 << bit)


def dac_code(sim, dac, channel):
    """The code of a converter's channel, 0 or 1 for its first or second; moves the holding register over."""
    holding, output = (DHR12R1, DOR1) if channel == 0 else (DHR12R2, DOR2)
    if not sim.read_u32(dac + DAC_CR) & DAC_ENABLED[channel]:
        return 0
    code = sim.read_u32(dac + holding) & FULL_SCALE_CODE
    if sim.read_u32(dac + output) != code:
        sim.write_u32(dac + output, code)
    return code


def dac_volts(sim, dac, channel, place):
    """The voltage that a converter's channel brings to its "pin", or to the "inside" of the chip; 0 where it is not connected."""
    code = dac_code(sim, dac, channel)
    connected, is_buffered = DAC_MODES.get(sim.read_u32(dac + MCR) >> MODE_SHIFTS[channel] & 0b111, ("", False))
    if place not in connected or not sim.read_u32(dac + DAC_CR) & DAC_ENABLED[channel]:
        return 0.0
    volts = code / FULL_SCALE_CODE * SUPPLY_V
    return min(max(volts, BUFFER_V), SUPPLY_V - BUFFER_V) if is_buffered else volts
