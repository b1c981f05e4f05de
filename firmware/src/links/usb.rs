//! USB full speed: the board as a CDC-ACM serial port.

use super::{ByteSink, ByteSource, Closed, INBOX, USB as USB_LINK};
use crate::watchdog::{WatchedTask, run_watched};
use embassy_stm32::peripherals::{PA11, PA12, USB};
use embassy_stm32::usb::{Driver, InterruptHandler};
use embassy_stm32::{Peri, interrupt, uid};
use embassy_usb::class::cdc_acm::{CdcAcmClass, ControlChanged, Receiver, Sender, State};
use embassy_usb::{Builder, Config, UsbDevice};
use era_shared::link::{MAX_PACKET, PortWatch, USB_PRODUCT, USB_PRODUCT_NAME, USB_VENDOR};
use static_cell::StaticCell;

/// What the board itself may draw from the bus in mA; the high-voltage supply has its own.
const MAX_CURRENT_MA: u16 = 200;

/// The driver of this chip.
pub type UsbDriver = Driver<'static, USB>;

/// The port: the device to run, the two directions of the link, and the line that tells whether a program has it open.
pub type UsbSerialPort =
    (UsbDevice<'static, UsbDriver>, Sender<'static, UsbDriver>, Receiver<'static, UsbDriver>, ControlChanged<'static>);

/// Sets up the port.
pub fn open_usb_serial_port(
    port: Peri<'static, USB>,
    dp: Peri<'static, PA12>,
    dm: Peri<'static, PA11>,
    interrupts: impl interrupt::typelevel::Binding<interrupt::typelevel::USB_LP, InterruptHandler<USB>> + 'static,
) -> UsbSerialPort {
    static CONFIGURATION: StaticCell<[u8; 128]> = StaticCell::new();
    static BOS: StaticCell<[u8; 32]> = StaticCell::new();
    static CONTROL: StaticCell<[u8; 64]> = StaticCell::new();
    static STATE: StaticCell<State<'static>> = StaticCell::new();

    let mut config = Config::new(USB_VENDOR, USB_PRODUCT);
    config.manufacturer = Some("ERA haptics");
    config.product = Some(USB_PRODUCT_NAME);
    config.serial_number = Some(uid::uid_hex());
    config.max_power = MAX_CURRENT_MA;
    let mut builder = Builder::new(
        Driver::new(port, interrupts, dp, dm),
        config,
        CONFIGURATION.init([0; 128]),
        BOS.init([0; 32]),
        &mut [],
        CONTROL.init([0; 64]),
    );
    let class = CdcAcmClass::new(&mut builder, STATE.init(State::new()), MAX_PACKET as u16);
    let (sender, receiver, line) = class.split_with_control();
    (builder.build(), sender, receiver, line)
}

/// Answers the host's USB requests for ever.
#[embassy_executor::task]
pub async fn run_usb_device(mut device: UsbDevice<'static, UsbDriver>) -> ! {
    run_watched(WatchedTask::Usb, device.run()).await
}

/// Receives for ever.
#[embassy_executor::task]
pub async fn receive_over_usb(receiver: Receiver<'static, UsbDriver>) -> ! {
    run_watched(WatchedTask::UsbReceive, super::forward_link_openings_and_bytes_to_device(USB_LINK, receiver)).await
}

/// Transmits for ever.
#[embassy_executor::task]
pub async fn transmit_over_usb(sender: Sender<'static, UsbDriver>) -> ! {
    run_watched(WatchedTask::UsbTransmit, super::send_queued_answers_or_drop_if_host_does_not_read(USB_LINK, sender))
        .await
}

/// Tells the device for ever when a program has closed the port. Its cable may stay: whoever opens the port next is another one.
#[embassy_executor::task]
pub async fn watch_dtr_and_report_usb_port_closings(line: ControlChanged<'static>) -> ! {
    run_watched(WatchedTask::UsbLine, async {
        let mut port = PortWatch::new(USB_LINK);
        loop {
            line.control_changed().await;
            if let Some(arrival) = port.note_port_state_and_build_reopened_arrival_if_just_closed(line.dtr()) {
                INBOX.send(arrival).await;
            }
        }
    })
    .await
}

impl ByteSource for Receiver<'static, UsbDriver> {
    async fn read_bytes(&mut self, buffer: &mut [u8; MAX_PACKET]) -> Result<usize, Closed> {
        self.read_packet(buffer).await.map_err(|_| Closed)
    }

    async fn await_link_opened_by_host(&mut self) {
        self.wait_connection().await;
    }
}

impl ByteSink for Sender<'static, UsbDriver> {
    async fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), Closed> {
        for packet in bytes.chunks(MAX_PACKET) {
            self.write_packet(packet).await.map_err(|_| Closed)?;
        }
        if bytes.len().is_multiple_of(MAX_PACKET) {
            // The host hands data on when a packet is short; a full last packet needs an empty one after it.
            self.write_packet(&[]).await.map_err(|_| Closed)?;
        }
        Ok(())
    }
}
