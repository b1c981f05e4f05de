"""What the addresses and bits in the emulator, the report and the firmware stand for, in the notation of `chip_data.Chip.evaluate`."""

TIMERS = ("TIM1", "TIM8", "TIM20", "TIM4")
# What of a slave timer's SMCR and of its master's CR2 decides on the start.
SLAVE_MASK, SLAVE, MASTER_MASK = "TIM4_SMCR: SMS SMS_3 TS TS2", "TIM4_SMCR: SMS=6 TS=2", "TIM3_CR2: MMS MMS_3"
AF_SOURCES = " ".join(["BKINE", *(f"BKCMP{n}E" for n in range(1, 8)), "BKINP", *(f"BKCMP{n}P" for n in range(1, 5))])
IDLE_LEVELS = "OIS1 OIS1N OIS2 OIS2N OIS3 OIS3N OIS4 OIS4N OIS5 OIS6"


def name_timer_registers(timer, names):
    return {name: f"{timer}_{name.upper()}{'_OUTPUT' if name.startswith('ccmr') else ''} offset" for name in names.split()}


TIMER_REGISTERS = "cr1 cr2 smcr dier sr ccmr1 ccmr2 ccer cnt psc arr ccr1 ccr2 ccr3 ccr4"
# Module -> its constants that stand for addresses and bits.
CONSTANTS = {
    "chip": {
        **{name: name for name in "TIM2 TIM3 IWDG PWR LPUART1 SYSCFG COMP EXTI ADC1 ADC2 ADC3 ADC4 DAC1 DAC3 DAC4".split()},
        "GPIO": {port: f"GPIO{port}" for port in "ABCD"}, "RCC_CSR": "RCC_CSR", "FLASH_OPTR": "FLASH_OPTR", "RNG_DATA": "RNG_DR",
        **{f"NVIC_{name}": f"NVIC_{name}0" for name in ("ISER", "ICER", "ISPR", "IPR")},
        **{name: f"SCB_{name}" for name in ("ICSR", "VTOR", "AIRCR")},
        "SYSRESETREQ": "SCB_AIRCR: SYSRESETREQ", "VECTACTIVE": "SCB_ICSR: VECTACTIVE",
        "RESET_FLAGS": {
            "power_on": "RCC_CSR: BORRSTF PINRSTF", "brown_out": "RCC_CSR: BORRSTF PINRSTF", "option_bytes": "RCC_CSR: OBLRSTF PINRSTF", "watchdog": "RCC_CSR: IWDGRSTF PINRSTF",
            "software": "RCC_CSR: SFTRSTF PINRSTF", "pin": "RCC_CSR: PINRSTF",
        },
        **{name: f"GPIOA_{name} offset" for name in ("MODER", "IDR", "ODR", "AFRL", "AFRH")},
        **{name: f"ADC1_{name} offset" for name in ("JDR1", "JSQR", "SQR1", "DR", "CR", "CFGR", "CFGR2", "SMPR1", "CALFACT")},
        "JSQR_PLACES": tuple(f"ADC1_JSQR first JSQ{n}" for n in range(1, 5)),
        "SQR1_PLACES": tuple(f"ADC1_SQR1 first SQ{n}" for n in range(1, 5)),
        "ADSTART": "ADC1_CR: ADSTART", "ADCAL": "ADC1_CR: ADCAL", "CONT": "ADC1_CFGR: CONT", "ROVSE": "ADC1_CFGR2: ROVSE", "OVSR_SHIFT": "ADC1_CFGR2 first OVSR",
        "OVSS_SHIFT": "ADC1_CFGR2 first OVSS", "SMP_BITS": "ADC1_SMPR1 first SMP1", "DAC_CR": "DAC1_CR offset",
        **{name: f"DAC1_{name} offset" for name in ("DHR12R1", "DHR12R2", "DOR1", "DOR2", "MCR")},
        "DAC_ENABLED": ("DAC1_CR: EN1", "DAC1_CR: EN2"), "MODE_SHIFTS": ("DAC1_MCR first MODE1", "DAC1_MCR first MODE2"),
        "IRQ_PVD": "interrupt PVD_PVM", "IRQ_TIM16": "interrupt TIM1_UP_TIM16", "IRQ_TIM2": "interrupt TIM2", "IRQ_UNUSED": "interrupt UART5",
        "IRQ_LPUART1": "interrupt LPUART",
    },
    "defects": {"OPTION_BYTES": "FLASH_OPTR reset"},
    "lock": {
        "LOCK_SHIFT": "TIM1_BDTR first LOCK", "LOCK_MASK": "TIM1_BDTR: LOCK",
        "BDTR_1": "TIM1_BDTR: DTG BKE BKP AOE BKF BK2F BK2E BK2P BKBID BK2ID", "BDTR_2": "TIM1_BDTR: OSSI OSSR", "AF_1": "TIM1_AF1: " + AF_SOURCES,
        "CR2_1": "TIM1_CR2: " + IDLE_LEVELS, "CCER_2": "TIM1_CCER: CC1P CC1NP", "CCXS": "TIM1_CCMR1_OUTPUT: CC1S",
        "CCMR_3": "TIM1_CCMR1_OUTPUT: OC1M OC1M_3 OC1PE", "AF1_RESET": "TIM1_AF1 reset",
        "CFGR2": "SYSCFG_CFGR2", "PVDL": "SYSCFG_CFGR2: PVDL", "PWR_CR2": "PWR_CR2", "DETECTOR": "PWR_CR2: PVDE PVDLS",
    },
    "lsi": {
        "TIM5": "TIM5", "TISEL": "TIM5_TISEL offset", "LSION": "RCC_CSR: LSION", "TI1SEL_LSI": "TIM5_TISEL: TI1SEL=1",
        "CCMR1_MASK": "TIM5_CCMR1_INPUT: CC1S IC1PSC IC1F", "CCMR1_INPUT_1": "TIM5_CCMR1_INPUT: CC1S=1", "CCER_MASK": "TIM5_CCER: CC1E CC1P CC1NP",
        "CCER_RISING": "TIM5_CCER: CC1E", "SMCR_MASK": "TIM5_SMCR: SMS SMS_3 TS TS2", "SMCR_RESET_BY_INPUT_1": "TIM5_SMCR: SMS=4 TS=5",
        "CC1IF": "TIM5_SR: CC1IF",
    },
    "machine": {
        **{name: f"TIM2_{name} offset" for name in ("DIER", "SR", "CNT", "CCR2")}, "ALARM_ENABLED": "TIM2_DIER: CC2IE",
        "LPUART1_ISR": "LPUART1_ISR", "RXNE": "LPUART1_ISR: RXNE",
    },
    "pins": {
        "OC1M_MASK": "TIM16_CCMR1_OUTPUT: OC1M OC1M_3", "OC1M_FORCED_ACTIVE": "TIM16_CCMR1_OUTPUT: OC1M=5", "CC1_MASK": "TIM16_CCER: CC1E CC1P",
        "CC1_ENABLED": "TIM16_CCER: CC1E",
    },
    "protection": {
        "ENABLED": "COMP_C1CSR: EN", "POLARITY": "COMP_C1CSR: POL", "VALUE": "COMP_C1CSR: VALUE", "INMSEL_SHIFT": "COMP_C1CSR first INMSEL",
        "BKE": "TIM1_BDTR: BKE", "BKP": "TIM1_BDTR: BKP", "BIE": "TIM1_DIER: BIE", "BIF": "TIM1_SR: BIF", "SBIF": "TIM1_SR: SBIF",
        # Comparator 1 is one bit above the pin.
        "BKCMPP_SHIFT": "TIM1_AF1 first BKINP", "CFGR2": "SYSCFG_CFGR2", "PVDL": "SYSCFG_CFGR2: PVDL",
        "BREAK_INTERRUPTS": {"TIM1": "interrupt TIM1_BRK_TIM15", "TIM8": "interrupt TIM8_BRK", "TIM20": "interrupt TIM20_BRK"},
        "OCCS": "TIM4_SMCR: OCCS", "OCRSEL_SHIFT": "TIM4_AF2 first OCRSEL", "CLEAR_ENABLES": "TIM4_CCMR1_OUTPUT: OC1CE OC2CE",
        "CR2": "PWR_CR2", "SR2": "PWR_SR2", "PVDE": "PWR_CR2: PVDE", "PVDO": "PWR_SR2: PVDO",
        **{name: f"EXTI_{name}" for name in ("IMR1", "RTSR1", "FTSR1", "SWIER1")}, "LINE_PVD": "EXTI_IMR1: IM16",
    },
    "pulses": {
        "BASES": {name: name for name in (*TIMERS, "TIM3")},
        "REGISTERS": name_timer_registers("TIM1", "cr2 smcr ccmr1 ccmr2 psc arr rcr ccr1 ccr2 ccr3 ccr4 egr ccer bdtr cr1"),
        **{name: f"TIM1_CR1: {name}" for name in ("CEN", "UDIS", "OPM", "DIR", "CMS", "ARPE", "DITHEN")},
        **{name: f"TIM1_BDTR: {name}" for name in ("OSSI", "OSSR", "BKE", "AOE", "MOE")}, "UG": "TIM1_EGR: UG", "CCPC": "TIM1_CR2: CCPC",
        "OCPE_SHIFT": "TIM1_CCMR1_OUTPUT first OC1PE", "OCM_SHIFT": "TIM1_CCMR1_OUTPUT first OC1M", "OCM_3_SHIFT": "TIM1_CCMR1_OUTPUT first OC1M_3",
        "SLAVE_MASK": SLAVE_MASK, "SLAVE_OF_TIM3": SLAVE, "MASTER_MASK": MASTER_MASK, "MASTER_TELLS_ENABLE": "TIM3_CR2: MMS=1",
    },
    "timers": {
        "OFFSETS": name_timer_registers("TIM1", TIMER_REGISTERS + " bdtr af1 af2"), "EGR": "TIM1_EGR offset", "CEN": "TIM1_CR1: CEN",
        "ARPE": "TIM1_CR1: ARPE", "UG": "TIM1_EGR: UG", "UIF": "TIM1_SR: UIF", **{name: f"TIM1_BDTR: {name}" for name in ("OSSI", "OSSR", "MOE")},
        "CCXE": "TIM1_CCER: CC1E", "CCXNE": "TIM1_CCER: CC1NE", "OIS1_SHIFT": "TIM1_CR2 first OIS1", "OC1PE_SHIFT": "TIM1_CCMR1_OUTPUT first OC1PE",
        "SLAVE_MASK": SLAVE_MASK, "SLAVE_OF_TIM3": SLAVE, "MASTER_MASK": MASTER_MASK, "MASTER_TELLS_ENABLE": "TIM3_CR2: MMS=1",
        "TIMERS": {name: name for name in TIMERS}, "TIM16": "TIM16",
    },
    "watchdog": {
        "PRESCALER": "IWDG_PR", "RELOAD": "IWDG_RLR", "PRESCALER_AFTER_RESET": "IWDG_PR reset", "RELOAD_AFTER_RESET": "IWDG_RLR reset",
    },
    "board_test_case": {name: name for name in ("RCC_AHB2ENR", "RCC_APB1ENR1", "RCC_APB2ENR")},
    "test_board": {"TIM2_CNT": "TIM2_CNT"},
    "test_first_stage": {"VTOR": "SCB_VTOR", "RCC_CRRCR": "RCC_CRRCR", "MEMRMP": "SYSCFG_MEMRMP"},
    "test_overlays": {
        "BREAK": "TIM1_BDTR: OSSI OSSR BKE BKP", "MOE": "TIM1_BDTR: MOE", "TIM1_MODES": "GPIOA_MODER: MODER8=2 MODER10=2",
        "TIM1_FUNCTIONS": "GPIOA_AFRH: AFRH8=6 AFRH10=6",
    },
}
# Constants that are no addresses and bits of registers of the chip: memory, quantities, values of fields, registers that are not of the chip.
OTHERS = set("""
    FLASH FLASH_BYTES RAM RAM_BYTES INTERRUPTS NVIC_WORDS EXCEPTIONS CLOCK_HZ STARTED STARTED_REGULAR STARTED_INJECTED RELOADED WRITABLE EOC_SET SR_SET
    SAMPLING CONVERTING CONVERTER_CLOCKS VREFINT_V DAC_MODES BUFFER_V FULL_SCALE_CODE SUPPLY_V TOUCHED TOUCHED_BITS TOUCHED_WITH_LOCK LSI_HZ
    HANGING_TICKS BOOT_LIMIT_S TICK TICK_S TICK_CLOCKS HALF_COUNT FULL_COUNT MARGIN_TICKS LOST_TICKS STACK_PAINT FINE_SLICES INMSEL_DAC OUTPUTS
    FROZEN FORCED PWM_1 PWM_2 COMBINED GUARD TWO_TICKS FREQUENCY_ERROR WINDOW_TICK HISTORY_LIMIT RAIL_FULL_SCALE_V AVERAGE_FULL_SCALE_A
    SHUNT_FULL_SCALE_A PAUSE_CLOCKS READ_CLOCKS WRONG_BY MILLISECOND FIRMWARE HEADER SYSTEM_FLASH ELECTRODES HIGH_VOLTAGE_ENABLE DISCHARGE_OPEN
    PERMIT PINS TIMER_PINS
""".split())
# File of the firmware, of its crate or of the report -> constants.
MOE = "TIM1_BDTR: MOE"
RUST_CONSTANTS = {
    "firmware/src/timers.rs": {
        "CR1_CEN": "TIM1_CR1: CEN", "CR1_UDIS": "TIM1_CR1: UDIS", "CR2_TRIGGER_IS_ENABLE": "TIM3_CR2: MMS=1", "SMCR_START_WITH_TIM3": SLAVE,
        "AF2_CLEAR_BY_COMPARATOR_4": "TIM4_AF2: OCRSEL=3", "BDTR_LOCKED": "TIM1_BDTR: LOCK OSSI OSSR BKE BKP", "BDTR_MOE": MOE,
        "AF1_COMPARATORS": "TIM1_AF1: BKCMP1E BKCMP3E BKCMP4E BKCMP5E BKCMP7E", "DIER_BIE": "TIM1_DIER: BIE",
    },
    "firmware/src/clocks.rs": {"CR5_R1MODE": "PWR_CR5: R1MODE"},
    "firmware/src/permit.rs": {"CCMR1_FORCED_ACTIVE": "TIM16_CCMR1_OUTPUT: OC1M=5", "CCER_CC1E": "TIM16_CCER: CC1E"},
    "firmware/src/clock_check.rs": {
        "TISEL_LSI": "TIM5_TISEL: TI1SEL=1", "CCMR1_CAPTURE_INPUT_1": "TIM5_CCMR1_INPUT: CC1S=1", "CCER_CC1E": "TIM5_CCER: CC1E",
        "SMCR_RESET_BY_INPUT_1": "TIM5_SMCR: SMS=4 TS=5", "CR1_CEN": "TIM5_CR1: CEN", "SR_CC1IF": "TIM5_SR: CC1IF",
    },
    "firmware/src/sense.rs": {"REFERENCE_CALIBRATION": "word VREFINTCAL"},
    "firmware/src/comparators.rs": {"POLARITY": "COMP_C1CSR: POL"},
    "firmware/src/option_bytes.rs": {
        "NEEDED_MASK": "FLASH_OPTR: IWDG_STOP IWDG_STDBY BFB2", "NEEDED": "FLASH_OPTR: IWDG_STOP IWDG_STDBY",
        "RECOMMENDED_MASK": "FLASH_OPTR: BOR_LEV N_RST_STOP N_RST_STDBY N_RST_SHDW IDWG_SW WWDG_SW N_BOOT1 SRAM2_PE N_SWBOOT0 N_BOOT0",
        "RECOMMENDED": "FLASH_OPTR: BOR_LEV=4 N_RST_STOP N_RST_STDBY N_RST_SHDW IDWG_SW WWDG_SW N_BOOT1 SRAM2_PE=0 N_SWBOOT0 N_BOOT0",
    },
    "shared/src/waveform/registers.rs": {
        "CR1_CEN": "TIM1_CR1: CEN", "CR1_DIR": "TIM1_CR1: DIR", "CR1_CMS": "TIM1_CR1: CMS", "CR1_ARPE": "TIM1_CR1: ARPE",
        "PRELOAD": "TIM1_CCMR1_OUTPUT: OC1PE", "CLEAR_ENABLE": "TIM1_CCMR1_OUTPUT: OC1CE", "BDTR_MOE": MOE,
    },
    "tools/xtask/src/emulate/report/edges.rs": {"MOE": MOE},
    "tools/xtask/src/emulate/report/expected.rs": {"CEN": "TIM1_CR1: CEN", "MOE": MOE},
    "tools/xtask/src/emulate/report/failures.rs": {"DELIVERED": "FLASH_OPTR reset"},
    "tools/xtask/src/emulate/report/permit.rs": {"NVIC_ICER0": "NVIC_ICER0", "TIM1_BREAK": "interrupts TIM1_BRK_TIM15"},
    "host/src/flash/probe.rs": {"IDCODE": "DBGMCU_IDCODE", "UNIQUE_ID": "UID"},
}
# Setting of the report (settings.rs) -> the fields that it looks at, with their values, or with all of their bits.
BREAK_TIMERS = ("TIM1", "TIM8", "TIM20", "TIM16")
COMPARATORS = "BKCMP1E BKCMP3E BKCMP4E BKCMP5E BKCMP7E".split()
COMPARATOR = "EN INMSEL={} INPSEL=0 POL={} HYST=2 BLANKSEL=0 SCALEN={}"
SETTINGS = {
    **{f"{timer} BDTR": f"{timer}_BDTR: LOCK=3 OSSI OSSR BKE BKP AOE=0 MOE=0" for timer in BREAK_TIMERS},
    **{f"{timer} AF1": f"{timer}_AF1: " + " ".join(f"{name}={int(name in COMPARATORS)}" for name in AF_SOURCES.split()) for timer in BREAK_TIMERS},
    "TIM16 CCMR1": "TIM16_CCMR1_OUTPUT: CC1S=0 OC1M=5 OC1M_3=0", "TIM16 CCER": "TIM16_CCER: CC1E CC1P=0 CC1NE=0 CC1NP=0",
    "TIM5 TISEL": "TIM5_TISEL: TI1SEL=1", "TIM5 CCMR1": "TIM5_CCMR1_INPUT: CC1S=1 IC1PSC=0 IC1F=0", "TIM5 CCER": "TIM5_CCER: CC1E CC1P=0 CC1NP=0",
    "TIM5 SMCR": "TIM5_SMCR: SMS=4 SMS_3=0 TS=5 TS2=0", "TIM4 AF2": "TIM4_AF2: OCRSEL=3",
    **{f"COMP{number} CSR": f"COMP_C{number}CSR: " + COMPARATOR.format(4, int(number >= 5), 0) for number in (1, 3, 4, 5, 7)},
    "DAC4 DHR12R1": "DAC4_DHR12R1: DACCDHR=2357", "DAC4 MCR": "DAC4_MCR: MODE1=3 MODE2=3 HFSEL=2", "DAC4 CR": "DAC4_CR: EN1",
    "DAC3 DHR12R1": "DAC3_DHR12R1: DACCDHR=3439", "DAC3 DHR12R2": "DAC3_DHR12R2: DACCDHR=2047",
    "DAC3 MCR": "DAC3_MCR: MODE1=3 MODE2=3 HFSEL=2", "DAC1 MCR": "DAC1_MCR: MODE1=2 MODE2=2 HFSEL=2", "PWR CR2": "PWR_CR2: PVDE PVDLS=6",
    "EXTI IMR1": "EXTI_IMR1: IM16", "EXTI RTSR1": "EXTI_RTSR1: RT16", "EXTI FTSR1": "EXTI_FTSR1: FT16=0",
    "SYSCFG CFGR2": "SYSCFG_CFGR2: CLL SPL PVDL ECCL",
    "ADC1 JSQR": "ADC1_JSQR: JL=2 JSQ1=1 JSQ2=2 JSQ3=6 JSQ4=0", "ADC3 JSQR": "ADC3_JSQR: JL=1 JSQ1=5 JSQ2=5 JSQ3=0 JSQ4=0",
    "ADC4 JSQR": "ADC4_JSQR: JL=1 JSQ1=4 JSQ2=4 JSQ3=0 JSQ4=0", "ADC1 SQR1": "ADC1_SQR1: L=1 SQ1=1 SQ2=18", "ADC2 SQR1": "ADC2_SQR1: L=0 SQ1=7",
    "ADC2 SMPR1": "ADC2_SMPR1: SMP7=7", "ADC2 CFGR": "ADC2_CFGR: CONT OVRMOD RES=0", "ADC2 CFGR2": "ADC2_CFGR2: ROVSE JOVSE=0 OVSR=5 OVSS=2",
    "ADC1 SMPR1": "ADC1_SMPR1: SMP1=4 SMP2=4 SMP6=4", "ADC3 SMPR1": "ADC3_SMPR1: SMP5=4", "ADC4 SMPR1": "ADC4_SMPR1: SMP4=4", "ADC1 SMPR2": "ADC1_SMPR2: SMP18=6",
    "ADC12 CCR": "ADC12_COMMON_CCR: CKMODE=3 VREFEN", "ADC345 CCR": "ADC345_COMMON_CCR: CKMODE=3", "PWR CR5": "PWR_CR5: R1MODE=0",
    "DBGMCU APB1FZ": "DBGMCU_APB1L_FZ: DBG_IWDG_STOP", "live: DBGMCU APB1FZ": "DBGMCU_APB1L_FZ: DBG_IWDG_STOP=0", "live: TIM1 DIER": "TIM1_DIER: BIE", "DBGMCU CR": "DBGMCU_CR: DBG_SLEEP=0 DBG_STOP=0 DBG_STANDBY=0",
    "DBGMCU APB2FZ": "DBGMCU_APB2_FZ: DBG_TIM1_STOP DBG_TIM8_STOP DBG_TIM16_STOP DBG_TIM20_STOP", "ACTLR": "ICB_ACTLR: DISMCYCINT=0 DISDEFWBUF DISFOLD=0",
}
# Constants of the firmware that are formed by shifts, but are no bits of registers.
RUST_OTHERS = {"ALL"}
# File -> places in it, with numbers as in `Chip.evaluate` between braces.
REPORT = "tools/xtask/src/emulate/report"
SNIPPETS = {
    "firmware/src/first_stage.rs": ('={FLASH_ECCR: ECCD ECCD2}", // ECCD', '={SCB_AIRCR: VECTKEY=0x05FA SYSRESETREQ}", // SYSRESETREQ'),
    f"{REPORT}/failures.rs": (
        'in stop mode", DELIVERED & !(1 << {FLASH_OPTR first IWDG_STOP})', 'in standby mode", DELIVERED & !(1 << {FLASH_OPTR first IWDG_STDBY})',
        'bank 2", DELIVERED | 1 << {FLASH_OPTR first BFB2}', 'level 4", DELIVERED | 4 << {FLASH_OPTR first BOR_LEV}',
        'single bank", DELIVERED & !(1 << {FLASH_OPTR first DBANK})', 'BOOT0 by option", DELIVERED & !(1 << {FLASH_OPTR first N_SWBOOT0})',
        "PARITY_ON: u32 = DELIVERED & !(1 << {FLASH_OPTR first SRAM2_PE})",
    ),
    f"{REPORT}/permit.rs": (
        "in [{TIM1}, {TIM8}, {TIM20}, {TIM16}]",
        "base + {TIM1_AF1 offset}, 0)?;\n        board.write_memory_word(base + {TIM1_BDTR offset}, {TIM1_BDTR: MOE AOE})",
    ),
    f"{REPORT}/trips.rs": (
        'mode changed", {TIM1_CCMR1_OUTPUT}, 0)', 'TIM4 changed", {TIM4_CCMR1_OUTPUT}, 0)',
        '(AF1)", {TIM8_AF1}, 0)', '(TIM16_AF1)", {TIM16_AF1}, 0)', '(BDTR)", {TIM8_BDTR}, {TIM8_BDTR: LOCK OSSI OSSR BKP MOE})',
        '(TIM16_BDTR)", {TIM16_BDTR}, {TIM16_BDTR: LOCK OSSI OSSR BKP MOE})',
        '(DAC3_MCR)", {DAC3_MCR}, {DAC3_MCR: MODE1=3 MODE2=0 HFSEL=2})', 'loops lowered (DAC4)", {DAC4_DHR12R1}, 0)', '(TIM2_PSC)", {TIM2_PSC}, 170)',
        'loops not connected (DAC4_MCR)", {DAC4_MCR}, {DAC4_MCR: MODE1=0 MODE2=3 HFSEL=2})', '(DAC3_CR)", {DAC3_CR}, {DAC3_CR: EN1})',
        '(COMP4_CSR)", {COMP_C4CSR}, 0)',
        '(COMP1_CSR)", {COMP_C1CSR}, 0)', 'voltage threshold raised (DAC3)", {DAC3_DHR12R1}, 4095)',
        'current threshold raised (DAC3)", {DAC3_DHR12R2}, 4095)', '(ADC1_CR)", {ADC1_CR})', '(ADC3_CR)", {ADC3_CR})', '(ADC4_CR)", {ADC4_CR})',
        "(name, address, 1 << {ADC1_CR first ADVREGEN})",
    ),
    "shared/src/waveform/registers.rs": (
        "({TIM1_CCMR1_OUTPUT first OC1M} + shift)) & 0b111 | ((register >> ({TIM1_CCMR1_OUTPUT first OC1M_3} + shift))",
        "1 << ({TIM1_CCER first CC2E} * (channel - 1))",
        "(mode & 0b111) << {TIM1_CCMR1_OUTPUT first OC1M} | (mode >> 3) << {TIM1_CCMR1_OUTPUT first OC1M_3}",
        "ccmr_bits_for_channel(two) << {TIM1_CCMR1_OUTPUT first CC2S}", "self.ccer & {TIM1_CCER: CC1E CC2E CC3E CC4E}",
    ),
    "tools/emulator/protection.py": ("COMP + {COMP_C2CSR offset} * (comparator - 1)",),
    "tools/emulator/timers.py": ('"ccer") >> {TIM1_CCER first CC2E} * (channel - 1)',),
    "tools/emulator/pulses.py": ('"ccer"] >> {TIM1_CCER first CC2E} * channel',),
}
# Blocks of board/chip.yaml that do not have the name of their peripheral, and the bits of RCC that enable those which do not either.
BLOCKS = {
    "ccipr": "RCC_CCIPR", "csr": "RCC_CSR", "actlr": "ICB_ACTLR", "aircr": "SCB_AIRCR", "pwr_cr5": "PWR_CR5", "pwr_sr2": "PWR_SR2", "optr": "FLASH_OPTR", "adc12": "ADC12_COMMON",
    "adc345": "ADC345_COMMON", "usb_fs": "USB", "usb_sram": "USBRAM", "vrefint_cal": "word VREFINTCAL", "nvic": "NVIC_ISER0",
    **{f"idr{port.lower()}": f"GPIO{port}_IDR" for port in "ABCD"},
}
ENABLES = {"adc1": "ADC12", "adc2": "ADC12", "adc12": "ADC12", "adc3": "ADC345", "adc4": "ADC345", "adc345": "ADC345", "comp": "SYSCFG"}
MODEL_FOLDER = "tools/emulator/board/peripherals"
# Values after a reset that are not compared: timer.yaml is for six timers, of which only TIM1, TIM8 and TIM20 have 1 in AF2; SR says "ready"; IDCODE is
# that of the device (0x469), which the data do not have.
UNLIKE_AFTER_RESET = {"AF2", "SR", "IDCODE"}
# File in board/peripherals -> peripheral, and registers in it that are not of the chip; then what starts an event, and what it does; SR_SET has
# the bits of SR.
MODELS = {
    "adc": ("ADC1", "STARTED"), "adc2": ("ADC2", "EOC_SET"), "adc_common": ("ADC12_COMMON", ""), "comparators": ("COMP", ""), "dac": ("DAC1", ""),
    "dbgmcu": ("DBGMCU", ""),
    "iwdg": ("IWDG", "STARTED RELOADED WRITABLE TOUCHED"), "rng": ("RNG", ""), "syscfg": ("SYSCFG", ""), "timer": ("TIM1", "SR_SET TOUCHED"),
}
CONVERTER_EVENTS = {
    "ready": ("CR: ADEN", "ISR: ADRDY"), "calibrated": ("CR: ADCAL", "CR: ADCAL"), "factor": ("CR: ADCAL", "CALFACT: CALFACT_S"), "disabled": ("CR: ADDIS", "CR: ADEN ADDIS"),
}
EVENTS = {
    "adc": {
        **CONVERTER_EVENTS, "converted": ("CR: ADEN JADSTART", "ISR: JEOC JEOS"), "conversion_ended": ("CR: ADEN JADSTART", "CR: JADSTART"),
        "stopped": ("CR: JADSTP", "CR: JADSTART JADSTP"), "converted_regular": ("CR: ADEN ADSTART", "ISR: EOC EOS"),
        "conversion_ended_regular": ("CR: ADEN ADSTART", "CR: ADSTART"), "started_regular": ("CR: ADEN ADSTART", None),
        "started": ("CR: ADEN JADSTART", None),
    },
    "adc2": {**CONVERTER_EVENTS, "stopped": ("CR: ADSTP", "CR: ADSTART ADSTP"), "mean": (None, "ISR: EOC")},
    "csr": {
        "lsi": ("CSR: LSION", "CSR: LSIRDY"),
        # The flags, RMVF, and a bit between them that is reserved.
        "forget": ("CSR: RMVF", None),
    },
    "iwdg": {
        "start": ("KR: KEY=0xCCCC", None), "started": ("KR: KEY=0xCCCC", None), "reload": ("KR: KEY=0xAAAA", None),
        "reloaded": ("KR: KEY=0xAAAA", None), "enable": ("KR: KEY=0x5555", None), "prescaler_comes": ("SR: PVU",),
        "prescaler_is_there": ("SR: PVU",), "reload_comes": ("SR: RVU",), "reload_is_there": ("SR: RVU",),
    },
    "timer": {
        "uif": ("SR_SET: UIF", "SR: UIF"), "cc1if": ("SR_SET: CC1IF", "SR: CC1IF"), "bif": ("SR_SET: BIF", "SR: BIF"),
        "sbif": ("SR_SET: SBIF", "SR: SBIF"),
        "moe": ("SR_SET: BIF", "BDTR: MOE"), "moe_system": ("SR_SET: SBIF", "BDTR: MOE"), "bg_flag": ("EGR: BG", "SR: BIF"),
        "bg_moe": ("EGR: BG", "BDTR: MOE"), "locked_1": ("BDTR: LOCK=1", None), "locked_2": ("BDTR: LOCK=2", None),
    },
}
