//! Firmware of the ERA haptics board (STM32G474RE).
//!
//! What the device does is in `era-shared`, which the simulated device runs too; here is only what needs this chip:
//! [`board`] gives the device its hardware, [`links`] give it bytes, [`device_task`] is the one owner of both.
//!
//! What can energise something is in [`outputs`], [`timers`], [`permit`] and [`supply`] (with [`rails`]); what is measured in [`sense`] and
//! [`average_current`]; what switches off without asking the device in [`comparators`], [`breaks`], [`brown_out`], [`watchdog`] and
//! [`fatal`]; what is tried or compared beside the self-test in [`watchdog_proof`], [`clock_check`] and [`option_bytes`]. Pins
//! and the circuit outside: [`pins`]. Outputs are off at boot and off without a living host.
#![no_std]
#![no_main]

mod average_current;
mod board;
mod bootloader;
mod breaks;
mod brown_out;
mod clock_check;
mod clocks;
mod comparators;
mod device_task;
mod electrode_test;
mod executor;
mod fatal;
mod first_stage;
mod heartbeat;
mod identity;
mod image;
mod links;
mod log;
mod option_bytes;
mod outputs;
mod permit;
mod pins;
mod poll;
mod pre_init;
mod priorities;
mod rails;
mod run_record;
mod sense;
mod supply;
mod timers;
mod trip;
mod watchdog;
mod watchdog_proof;

use embassy_stm32::{bind_interrupts, peripherals, usart, usb};
use era_shared::protocol::FaultCode;

bind_interrupts!(struct Interrupts {
    LPUART1 => links::uart::LineErrorCounter, usart::BufferedInterruptHandler<peripherals::LPUART1>;
    USB_LP => usb::InterruptHandler<peripherals::USB>;
});

#[cortex_m_rt::entry]
fn main() -> ! {
    // Before anything else: the bootloader wants the chip as the reset left it, which is with all outputs off.
    bootloader::enter_bootloader_if_requested();
    // Before the clocks are set up.
    outputs::force_outputs_off_withdraw_permit_and_stop_timers();
    // Before notes of the previous run are taken: it resets the chip once.
    let (reset_cause, is_watchdog_proven) =
        watchdog_proof::prove_watchdog_and_tell_original_cause_and_success(identity::take_reset_cause());
    let previous_run = run_record::read_run_record_of_previous_run();
    let failure = identity::take_previous_failure(reset_cause, previous_run.is_some_and(|run| run.is_live));
    let peripherals = clocks::init_chip_and_clocks();
    priorities::disable_unused_interrupts_and_lower_time_and_link_priorities();
    outputs::init_electrode_and_supply_pins_low();
    rails::init_rail_dac_at_zero();
    comparators::init_comparators_and_await_settling();
    timers::init_timers_and_lock_break_routing();
    permit::init_permit_timer_with_permit_withdrawn();
    // Before the breaks: what leads the detector to them also locks its settings (RM0440, section 6.4.2).
    brown_out::init_voltage_detector();
    breaks::connect_core_failures_to_breaks_and_enable_interrupt();
    sense::init_adcs_of_rails_loops_earth_bond_and_reference();
    average_current::init_average_current();
    clock_check::init_clock_check();

    let info = identity::build_board_info_without_channels(reset_cause, failure, previous_run);
    defmt::info!("era-firmware {}, commit {=[u8]:a}", env!("CARGO_PKG_VERSION"), info.firmware.commit);
    if let Some((code, detail)) = info.fault_before_reset {
        defmt::error!(
            "the previous run ended with the fault {}, detail {=u32}: {}",
            code.name(),
            detail,
            info.failure.as_str()
        );
    }
    // A baud rate that cannot be reached is a mistake in the clock tree, found at the first start on a desk.
    let uart =
        defmt::unwrap!(links::uart::open_uart(peripherals.LPUART1, peripherals.PA3, peripherals.PA2, Interrupts));
    let (uart_tx, uart_rx) = uart.split();
    let (usb, usb_tx, usb_rx, usb_line) =
        links::usb::open_usb_serial_port(peripherals.USB, peripherals.PA12, peripherals.PA11, Interrupts);

    let is_watchdog_set_up = watchdog::start_watchdog_and_tell_whether_settings_hold();
    // None of these can go before the next start.
    let lasting_fault = if is_watchdog_proven && is_watchdog_set_up {
        option_bytes::read_option_bytes_if_unsafe_logging_deviations().map(|options| (FaultCode::OptionBytes, options))
    } else {
        Some((FaultCode::Watchdog, watchdog_proof::DETAIL_UNPROVEN))
    };
    let board = board::Stm32Board::new(info, lasting_fault);
    executor::start_device_executor().spawn(defmt::unwrap!(device_task::run_device(board)));
    executor::run_thread_executor(|spawner| {
        spawner.spawn(defmt::unwrap!(bootloader::await_request_and_reset()));
        spawner.spawn(defmt::unwrap!(links::uart::receive_from_uart(uart_rx)));
        spawner.spawn(defmt::unwrap!(links::uart::transmit_to_uart(uart_tx)));
        spawner.spawn(defmt::unwrap!(links::usb::run_usb_device(usb)));
        spawner.spawn(defmt::unwrap!(links::usb::receive_over_usb(usb_rx)));
        spawner.spawn(defmt::unwrap!(links::usb::transmit_over_usb(usb_tx)));
        spawner.spawn(defmt::unwrap!(links::usb::watch_dtr_and_report_usb_port_closings(usb_line)));
    })
}
