//! LPUART1, which the ST-LINK on the board shows to the host as a virtual COM port.

use super::{ByteSink, ByteSource, CHUNK, Closed, UART};
use crate::watchdog::{WatchedTask, run_watched};
use embassy_stm32::gpio::Pull;
use embassy_stm32::peripherals::{LPUART1, PA2, PA3};
use embassy_stm32::usart::{
    BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config, ConfigError,
};
use embassy_stm32::{Peri, interrupt};
use embedded_io_async::{Read, Write};
use era_shared::link::{MAX_ENCODED, UART_BAUD};
use static_cell::StaticCell;

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
    run_watched(WatchedTask::UartReceive, super::forward_received_bytes(UART, rx)).await
}

/// Transmits for ever.
#[embassy_executor::task]
pub async fn transmit_to_uart(tx: BufferedUartTx<'static>) -> ! {
    run_watched(WatchedTask::UartTransmit, super::send_queued_answers(UART, tx)).await
}

impl ByteSource for BufferedUartRx<'static> {
    async fn read_bytes(&mut self, buffer: &mut [u8; CHUNK]) -> Result<usize, Closed> {
        loop {
            // Line errors are no end of the link; what they spoil fails its CRC.
            if let Ok(count) = Read::read(self, buffer).await {
                return Ok(count);
            }
        }
    }

    async fn await_connection(&mut self) {
        // A UART does not know whether there is another end.
    }
}

impl ByteSink for BufferedUartTx<'static> {
    async fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), Closed> {
        self.write_all(bytes).await.map_err(|_| Closed)
    }
}
