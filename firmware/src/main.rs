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
    bootloader::enter_if_asked();
    // Before the clocks are set up.
    outputs::force_off();
    let reset_cause = identity::take_reset_cause();
    let failure = identity::previous_failure(reset_cause);
    let peripherals = embassy_stm32::init(clocks::config());
    priorities::init();
    outputs::init();
    rails::init();
    comparators::init();
    timers::init();
    // Before the breaks: what leads the detector to them also locks its settings (RM0440, section 6.4.2).
    brown_out::init();
    breaks::init();
    sense::init();

    let info = identity::board_info(reset_cause, failure);
    defmt::info!("era-firmware {}, commit {=[u8]:a}", env!("CARGO_PKG_VERSION"), info.firmware.commit);
    if let Some((code, detail)) = info.fault_before_reset {
        defmt::error!("the previous run ended in {}, {=u32}: {}", code.name(), detail, info.failure.as_str());
    }
    let board = board::Stm32Board::new(info);

    // A baud rate that cannot be reached is a mistake in the clock tree, found at the first start on a desk.
    let uart = defmt::unwrap!(links::uart::open(peripherals.LPUART1, peripherals.PA3, peripherals.PA2, Interrupts));
    let (uart_tx, uart_rx) = uart.split();
    let (usb, usb_tx, usb_rx) = links::usb::open(peripherals.USB, peripherals.PA12, peripherals.PA11, Interrupts);

    watchdog::start();
    executor::start_device().spawn(defmt::unwrap!(device_task::run(board)));
    executor::run_thread(|spawner| {
        spawner.spawn(defmt::unwrap!(bootloader::run()));
        spawner.spawn(defmt::unwrap!(links::uart::receive(uart_rx)));
        spawner.spawn(defmt::unwrap!(links::uart::transmit(uart_tx)));
        spawner.spawn(defmt::unwrap!(links::usb::run(usb)));
        spawner.spawn(defmt::unwrap!(links::usb::receive(usb_rx)));
        spawner.spawn(defmt::unwrap!(links::usb::transmit(usb_tx)));
    })
}
