//! A simulated board in this process, and the cable to it: a line that can be pulled, cut and disturbed.

use crate::error::Error;
use era::device::sim::{Panel, SimBoard, SimControl, SimDevice};
use era::model::{Accuracy, PanelModel};
use era::planner::{PlanTable, TableOptions};
use era::scene::{EXAMPLE_PLATE, Scene};
use serialport::{SerialPort, TTYPort};
use std::io::{ErrorKind, Read, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How long a thread of the line waits for bytes before it looks whether it is still wanted.
const LOOK: Duration = Duration::from_millis(2);
/// What ends a frame.
const END: u8 = 0;

/// Which way bytes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From the daemon.
    ToBoard,
    /// To the daemon.
    ToHost,
}

/// Rubbish that is put into the next frame that is long enough.
#[derive(Clone, Debug)]
pub struct Rubbish {
    /// Into which frames.
    pub way: Way,
    /// Before which byte, counted from 0.
    pub at: usize,
    /// Bytes other than the one that ends a frame, so that this frame is ruined for sure.
    pub bytes: Vec<u8>,
}

#[derive(Debug, Default)]
struct Trouble {
    rubbish: Option<Rubbish>,
    /// Ways on which nothing gets through.
    cut: Vec<Way>,
    pulled: bool,
}

/// The board, the place into which it is plugged, and its cable.
#[derive(Debug)]
pub struct Bench {
    device: SimDevice,
    link: PathBuf,
    cable: Option<Cable>,
}

impl Bench {
    /// A board for the example plate, plugged in at `link` with a cable that can be disturbed.
    ///
    /// # Errors
    /// [`Error::Scene`], [`Error::Line`], [`Error::System`].
    pub fn new(link: PathBuf) -> Result<Self, Error> {
        let mut bench = Self { device: device()?, link, cable: None };
        bench.plug()?;
        Ok(bench)
    }

    /// The same without that cable, which takes time: for measurements.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn direct(link: PathBuf) -> Result<Self, Error> {
        let bench = Self { device: device()?, link, cable: None };
        bench.lead_to(bench.device.path())?;
        Ok(bench)
    }

    fn lead_to(&self, path: &str) -> Result<(), Error> {
        std::os::unix::fs::symlink(path, &self.link).map_err(Error::file(&self.link))
    }

    /// What the board has seen.
    #[must_use]
    pub fn control(&self) -> SimControl {
        self.device.control()
    }

    /// Plugs the cable in.
    ///
    /// # Errors
    /// [`Error::Line`], [`Error::System`].
    pub fn plug(&mut self) -> Result<(), Error> {
        let cable = Cable::new(self.device.path())?;
        self.lead_to(&cable.path)?;
        self.cable = Some(cable);
        Ok(())
    }

    /// Pulls the cable; the board stays as it is.
    ///
    /// # Errors
    /// [`Error::System`].
    pub fn unplug(&mut self) -> Result<(), Error> {
        self.cable = None;
        std::fs::remove_file(&self.link).map_err(Error::file(&self.link))
    }

    /// Lets nothing through on these ways, and everything on the others.
    pub fn cut(&self, ways: &[Way]) {
        if let Some(cable) = &self.cable {
            cable.trouble().cut = ways.to_vec();
        }
    }

    /// Puts rubbish on the line.
    pub fn disturb(&self, rubbish: Rubbish) {
        if let Some(cable) = &self.cable {
            cable.trouble().rubbish = Some(rubbish);
        }
    }

    /// Whether no rubbish waits for its frame.
    #[must_use]
    pub fn is_calm(&self) -> bool {
        self.cable.as_ref().is_none_or(|cable| cable.trouble().rubbish.is_none())
    }

    /// Takes rubbish back that no frame was long enough for; says whether there was any.
    #[must_use]
    pub fn calm(&self) -> bool {
        self.cable.as_ref().is_some_and(|cable| cable.trouble().rubbish.take().is_some())
    }
}

fn device() -> Result<SimDevice, Error> {
    let table = table()?;
    let volts = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
    SimDevice::start_named(Panel::of(&table), volts, SimBoard::ID).map_err(Error::system("no pseudo-terminal"))
}

/// What is planned with for the example plate.
///
/// # Errors
/// [`Error::Scene`].
pub fn table() -> Result<PlanTable, Error> {
    let wrong = |error: &dyn std::fmt::Display| Error::Scene(error.to_string());
    let scene = Scene::parse("example plate", EXAMPLE_PLATE).map_err(|error| wrong(&error))?;
    let options = TableOptions::default();
    let model = PanelModel::build(&scene, Accuracy::FAST, options.to_hz)
        .map_err(|error| wrong(&error))?
        .reduce(options.to_hz, &[])
        .map_err(|error| wrong(&error))?;
    PlanTable::build(&scene, model, options).map_err(|error| wrong(&error))
}

#[derive(Debug)]
struct Cable {
    path: String,
    trouble: Arc<Mutex<Trouble>>,
    threads: Vec<JoinHandle<()>>,
}

impl Cable {
    fn new(board: &str) -> Result<Self, Error> {
        let (mut host, line) = TTYPort::pair()?;
        let path = line.name().unwrap_or_default();
        // The daemon opens it by its path; this end must not hold it.
        drop(line);
        let mut board = serialport::new(board, 115_200).open_native()?;
        host.set_timeout(LOOK)?;
        board.set_timeout(LOOK)?;
        let trouble = Arc::new(Mutex::new(Trouble::default()));
        let (host_too, board_too) = (host.try_clone_native()?, board.try_clone_native()?);
        let carry = |way: Way, from: TTYPort, to: TTYPort| {
            let trouble = Arc::clone(&trouble);
            let carrier = Carrier { way, at: 0, from, to, trouble };
            std::thread::Builder::new().name("cable".into()).spawn(move || carrier.run())
        };
        let down = carry(Way::ToBoard, host, board).map_err(Error::system("no thread"))?;
        let up = carry(Way::ToHost, board_too, host_too).map_err(Error::system("no thread"))?;
        Ok(Self { path, trouble, threads: vec![down, up] })
    }

    fn trouble(&self) -> MutexGuard<'_, Trouble> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.trouble().pulled = true;
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

struct Carrier {
    way: Way,
    /// Bytes of the present frame that have gone by.
    at: usize,
    from: TTYPort,
    to: TTYPort,
    trouble: Arc<Mutex<Trouble>>,
}

impl Carrier {
    fn run(mut self) {
        let mut buffer = [0_u8; 512];
        loop {
            let read = self.from.read(&mut buffer);
            let mut trouble = self.trouble.lock().unwrap_or_else(PoisonError::into_inner);
            if trouble.pulled {
                return;
            }
            let length = match read {
                Ok(length) => length,
                Err(error) if error.kind() == ErrorKind::TimedOut => continue,
                // Nobody has the other end open.
                Err(_) => {
                    drop(trouble);
                    std::thread::sleep(LOOK);
                    continue;
                }
            };
            if trouble.cut.contains(&self.way) {
                self.at = 0;
                continue;
            }
            let bytes = spoilt(buffer.get(..length).unwrap_or_default(), &mut self.at, self.way, &mut trouble.rubbish);
            drop(trouble);
            // What cannot be written is lost, as on a cable.
            let _ = self.to.write_all(&bytes);
        }
    }
}

/// The bytes with the rubbish in its place, if that is among them; `at` counts the bytes of the frame that have gone by.
fn spoilt(bytes: &[u8], at: &mut usize, way: Way, rubbish: &mut Option<Rubbish>) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len() + 16);
    for byte in bytes {
        if rubbish.as_ref().is_some_and(|rubbish| rubbish.way == way && rubbish.at == *at && *byte != END) {
            out.extend(rubbish.take().into_iter().flat_map(|rubbish| rubbish.bytes));
        }
        out.push(*byte);
        *at = if *byte == END { 0 } else { *at + 1 };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rubbish_goes_before_its_byte_of_the_next_frame_that_has_one() {
        let mut rubbish = Some(Rubbish { way: Way::ToHost, at: 2, bytes: vec![9, 9] });
        let mut at = 0;
        assert_eq!(spoilt(&[1, 2, 3, 0], &mut at, Way::ToBoard, &mut rubbish), [1, 2, 3, 0]);
        assert_eq!(spoilt(&[1, 2, 0, 1], &mut at, Way::ToHost, &mut rubbish), [1, 2, 0, 1], "too short");
        assert_eq!(spoilt(&[2, 3, 0, 1, 2, 3], &mut at, Way::ToHost, &mut rubbish), [2, 9, 9, 3, 0, 1, 2, 3]);
        assert!(rubbish.is_none() && at == 3);
    }
}
