//! Firmware of the ERA haptics board (STM32G474RE).
//!
//! What the device does is in `era-shared`, which the simulated device runs too; here is only what needs this chip:
//! [`board`] gives the device its hardware, [`links`] give it bytes, [`device_task`] is the one owner of both.
//!
//! What can energise something is in [`outputs`], [`timers`] and [`supply`] (with [`rails`]); what is measured in [`sense`];
//! what switches off without asking the device in [`comparators`], [`breaks`], [`brown_out`], [`watchdog`] and [`fatal`]. Pins
//! and the circuit outside: [`pins`]. Outputs are off at boot and off without a living host.
#![no_std]
#![no_main]

mod board;
mod bootloader;
mod breaks;
mod brown_out;
mod clocks;
mod comparators;
mod device_task;
mod executor;
mod fatal;
mod first_stage;
mod heartbeat;
mod identity;
mod image;
mod links;
mod log;
mod outputs;
mod pins;
mod priorities;
mod rails;
mod sense;
mod supply;
mod timers;
mod trip;
mod watchdog;

use embassy_stm32::{bind_interrupts, peripherals, usart, usb};

bind_interrupts!(struct Interrupts {
    LPUART1 => usart::BufferedInterruptHandler<peripherals::LPUART1>;
    USB_LP => usb::InterruptHandler<peripherals::USB>;
});

#[cortex_m_rt::entry]
fn main() -> ! {
    // Before anything else: the bootloader wants the chip as the reset left it, which is with all outputs off.
    bootloader::enter_bootloader_if_requested();
    // Before the clocks are set up.
    outputs::force_outputs_off();
    let reset_cause = identity::take_reset_cause();
    let failure = identity::take_previous_failure(reset_cause);
    let peripherals = embassy_stm32::init(clocks::build_clock_config());
    priorities::set_interrupt_priorities();
    outputs::init_output_pins();
    rails::init_rail_dac();
    comparators::init_comparators();
    timers::init_timers();
    // Before the breaks: what leads the detector to them also locks its settings (RM0440, section 6.4.2).
    brown_out::init_voltage_detector();
    breaks::init_break_interrupt();
    sense::init_adc();

    let info = identity::build_board_info(reset_cause, failure);
    defmt::info!("era-firmware {}, commit {=[u8]:a}", env!("CARGO_PKG_VERSION"), info.firmware.commit);
    if let Some((code, detail)) = info.fault_before_reset {
        defmt::error!("the previous run ended in {}, {=u32}: {}", code.name(), detail, info.failure.as_str());
    }
    let board = board::Stm32Board::new(info);

    // A baud rate that cannot be reached is a mistake in the clock tree, found at the first start on a desk.
    let uart =
        defmt::unwrap!(links::uart::open_uart(peripherals.LPUART1, peripherals.PA3, peripherals.PA2, Interrupts));
    let (uart_tx, uart_rx) = uart.split();
    let (usb, usb_tx, usb_rx) =
        links::usb::open_usb_serial_port(peripherals.USB, peripherals.PA12, peripherals.PA11, Interrupts);

    watchdog::start_watchdog();
    executor::start_device_executor().spawn(defmt::unwrap!(device_task::run_device(board)));
    executor::run_thread_executor(|spawner| {
        spawner.spawn(defmt::unwrap!(bootloader::await_request_and_reset()));
        spawner.spawn(defmt::unwrap!(links::uart::receive_from_uart(uart_rx)));
        spawner.spawn(defmt::unwrap!(links::uart::transmit_to_uart(uart_tx)));
        spawner.spawn(defmt::unwrap!(links::usb::run_usb_device(usb)));
        spawner.spawn(defmt::unwrap!(links::usb::receive_over_usb(usb_rx)));
        spawner.spawn(defmt::unwrap!(links::usb::transmit_over_usb(usb_tx)));
    })
}
