//! LPUART1, which the ST-LINK on the board shows to the host as a virtual COM port.

use super::{ByteSink, ByteSource, Closed, UART};
use crate::watchdog::{WatchedTask, run_watched};
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_stm32::gpio::Pull;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{LPUART1, PA2, PA3};
use embassy_stm32::usart::{
    BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config, ConfigError,
};
use embassy_stm32::{Peri, interrupt};
use embedded_io_async::{Read, Write};
use era_shared::link::{MAX_ENCODED, MAX_PACKET, UART_BAUD};
use era_shared::log_limit::CountReport;
use static_cell::StaticCell;

/// Characters that were received with an error of the line since the start.
static LINE_ERRORS: AtomicU32 = AtomicU32::new(0);

/// Counts errors of the line. It comes before the handler of the driver, which clears their flags; the driver's own log line for each of them is
/// off (`.cargo/config.toml`), as noise on an open line would fill the log.
pub struct LineErrorCounter;

impl interrupt::typelevel::Handler<interrupt::typelevel::LPUART1> for LineErrorCounter {
    unsafe fn on_interrupt() {
        let status = pac::LPUART1.isr().read();
        if status.fe() || status.ne() || status.ore() || status.pe() {
            // Only this handler writes it.
            LINE_ERRORS.store(LINE_ERRORS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
        }
    }
}

/// Logs how many errors of the line there were, once a second at most. To be called every ms or so.
pub fn log_line_errors_if_due(report: &mut CountReport, now_us: u64) {
    if let Some(count) = report.take_increase_if_due(LINE_ERRORS.load(Ordering::Relaxed), now_us) {
        defmt::warn!("UART: {=u32} characters were received with line errors", count);
    }
}

/// Opens the port.
///
/// # Errors
/// [`ConfigError`] if the clock cannot be divided to [`UART_BAUD`].
pub fn open_uart(
    port: Peri<'static, LPUART1>,
    rx: Peri<'static, PA3>,
    tx: Peri<'static, PA2>,
    interrupts: impl interrupt::typelevel::Binding<interrupt::typelevel::LPUART1, BufferedInterruptHandler<LPUART1>>
    + 'static,
) -> Result<BufferedUart<'static>, ConfigError> {
    static TX_BUFFER: StaticCell<[u8; MAX_ENCODED]> = StaticCell::new();
    static RX_BUFFER: StaticCell<[u8; 2 * MAX_ENCODED]> = StaticCell::new();
    let mut config = Config::default();
    config.baudrate = UART_BAUD;
    // With nothing plugged in the line must read as silence.
    config.rx_pull = Pull::Up;
    // Wakes the reader at every byte: waiting for the line to fall silent would cost a character's time on every frame.
    config.eager_reads = Some(1);
    BufferedUart::new(
        port,
        rx,
        tx,
        TX_BUFFER.init([0; MAX_ENCODED]),
        RX_BUFFER.init([0; 2 * MAX_ENCODED]),
        interrupts,
        config,
    )
}

/// Receives for ever.
#[embassy_executor::task]
pub async fn receive_from_uart(rx: BufferedUartRx<'static>) -> ! {
    run_watched(WatchedTask::UartReceive, super::forward_link_openings_and_bytes_to_device(UART, rx)).await
}

/// Transmits for ever.
#[embassy_executor::task]
pub async fn transmit_to_uart(tx: BufferedUartTx<'static>) -> ! {
    run_watched(WatchedTask::UartTransmit, super::send_queued_answers_or_drop_if_host_does_not_read(UART, tx)).await
}

impl ByteSource for BufferedUartRx<'static> {
    async fn read_bytes(&mut self, buffer: &mut [u8; MAX_PACKET]) -> Result<usize, Closed> {
        loop {
            // Line errors are no end of the link; what they spoil fails its CRC.
            if let Ok(count) = Read::read(self, buffer).await {
                return Ok(count);
            }
        }
    }

    async fn await_link_opened_by_host(&mut self) {
        // A UART does not know whether there is another end.
    }
}

impl ByteSink for BufferedUartTx<'static> {
    async fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), Closed> {
        self.write_all(bytes).await.map_err(|_| Closed)
    }
}
