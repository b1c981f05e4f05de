//! The one owner of the outputs: it carries out what arrives on the links and notices their silence.

use crate::board::Stm32Board;
use crate::heartbeat::Heartbeat;
use crate::links::{Arrival, INBOX, LINKS};
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Ticker};
use era_shared::device::{Device, Port};
use era_shared::safety::LinkId;

/// How often silence is looked for. The dead-man time is at least 50 ms, so this adds 2 % to it at most.
const TICK: Duration = Duration::from_millis(1);

/// Runs the device for ever. Lives on the interrupt executor: no link, and nothing in thread mode, can hold it up.
#[embassy_executor::task]
pub async fn run(mut board: Stm32Board) -> ! {
    let mut device = Device::new();
    device.start(&mut board);
    let mut ports: [Port; LINKS.len()] = core::array::from_fn(|index| Port::new(LinkId(index as u8)));
    let mut heartbeat = Heartbeat::new();
    let mut ticker = Ticker::every(TICK);
    let mut state = device.state();
    defmt::info!("device is up, state {}", state.name());
    loop {
        // The tick is looked at first, so that a flood of bytes cannot starve it.
        match select(ticker.next(), INBOX.receive()).await {
            Either::First(()) => {
                device.poll(&mut board);
                heartbeat.tick(device.state());
            }
            Either::Second((link, arrival)) => {
                let (Some(port), Some(outbox)) = (ports.get_mut(link), LINKS.get(link)) else { continue };
                match arrival {
                    Arrival::Bytes(bytes) => {
                        device.receive(&mut board, port, &bytes, |answer| outbox.send(answer));
                    }
                    Arrival::Reopened => port.reset(),
                }
            }
        }
        if device.state() != state {
            state = device.state();
            defmt::info!("state {}", state.name());
        }
    }
}
