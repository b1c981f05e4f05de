//! A simulated board in this process, and the cable to it: a line that can be pulled, cut and disturbed.

use crate::error::Error;
use era::device::sim::{SimBoard, SimControl, SimDevice, SimPanel};
use era::model::{Accuracy, PanelModel};
use era::planner::{PlanTable, STANDARD_GRAVITY, TableOptions};
use era::scene::{EXAMPLE_PLATE, Scene};
use serialport::{SerialPort, TTYPort};
use std::io::{ErrorKind, Read, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// The scene of the simulated panel, which the daemon under load is started with: windows that are planned for one panel say nothing on another.
pub const PANEL_SCENE: &str = EXAMPLE_PLATE;

/// How long a thread of the line waits for bytes before it looks whether it is still wanted.
const LOOK: Duration = Duration::from_millis(2);
/// What ends a frame.
const END: u8 = 0;

/// In which direction bytes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the daemon.
    ToBoard,
    /// To the daemon.
    ToHost,
}

/// Rubbish that is put into the next frame that is long enough.
#[derive(Clone, Debug)]
pub struct Rubbish {
    /// Into which frames.
    pub direction: Direction,
    /// Before which byte, counted from 0.
    pub at: usize,
    /// Bytes other than the one that ends a frame, so that this frame is ruined for sure.
    pub bytes: Vec<u8>,
}

#[derive(Debug, Default)]
struct Disturbance {
    rubbish: Option<Rubbish>,
    /// Directions in which nothing gets through.
    cut: Vec<Direction>,
    pulled: bool,
}

/// The board, the place into which it is plugged, and its cable.
#[derive(Debug)]
pub struct Bench {
    device: SimDevice,
    table: PlanTable,
    link: PathBuf,
    cable: Option<Cable>,
}

impl Bench {
    /// A board for the starting plate, plugged in at `link` with a cable that can be disturbed.
    ///
    /// # Errors
    /// [`Error::Scene`], [`Error::Line`], [`Error::System`].
    pub fn new(link: PathBuf) -> Result<Self, Error> {
        let (device, table) = start_device()?;
        let mut bench = Self { device, table, link, cable: None };
        bench.plug_in()?;
        Ok(bench)
    }

    /// The same without that cable, which takes time: for measurements.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn new_linked_directly_to_board(link: PathBuf) -> Result<Self, Error> {
        let (device, table) = start_device()?;
        let bench = Self { device, table, link, cable: None };
        bench.point_own_link_at_serial_port(bench.device.port_path())?;
        Ok(bench)
    }

    fn point_own_link_at_serial_port(&self, path: &str) -> Result<(), Error> {
        std::os::unix::fs::symlink(path, &self.link).map_err(Error::file_error(&self.link))
    }

    /// What the board has seen.
    #[must_use]
    pub fn sim_control(&self) -> SimControl {
        self.device.control()
    }

    /// Puts the board's accelerometer under a finger: what it shows from then on is that of the touch `id`.
    ///
    /// # Errors
    /// [`Error::Scene`] for a place that is not on the surface.
    pub fn place_accelerometer_for_touch_at_px(&self, id: u64, x_px: f64, y_px: f64) -> Result<(), Error> {
        let place =
            self.table.scene.surface_point_at_px(x_px, y_px).map_err(|error| Error::Scene(error.to_string()))?;
        self.device
            .control()
            .move_accelerometer_to_touch(id, self.table.model.shape_deflections_at(place.x_m(), place.y_m()));
        Ok(())
    }

    /// What the accelerometer has shown of the touch `id`, in g; 0 if it never began, or is not one of the last 256.
    #[must_use]
    pub fn measured_peak_of_touch_or_zero_g(&self, id: u64) -> f64 {
        self.device.control().peak_of_touch_if_kept(id).map_or(0.0, |peak| peak.peak_m_per_s2 / STANDARD_GRAVITY)
    }

    /// Plugs the cable in.
    ///
    /// # Errors
    /// [`Error::Line`], [`Error::System`].
    pub fn plug_in(&mut self) -> Result<(), Error> {
        let cable = Cable::new(self.device.port_path())?;
        self.point_own_link_at_serial_port(&cable.path)?;
        self.cable = Some(cable);
        Ok(())
    }

    /// Pulls the cable; the board stays as it is.
    ///
    /// # Errors
    /// [`Error::System`].
    pub fn unplug(&mut self) -> Result<(), Error> {
        self.cable = None;
        std::fs::remove_file(&self.link).map_err(Error::file_error(&self.link))
    }

    /// Lets nothing through in these directions, and everything in the others.
    pub fn set_blocked_directions(&self, directions: &[Direction]) {
        if let Some(cable) = &self.cable {
            cable.lock_disturbance().cut = directions.to_vec();
        }
    }

    /// Puts rubbish on the line.
    pub fn insert_rubbish_into_next_fitting_frame(&self, rubbish: Rubbish) {
        if let Some(cable) = &self.cable {
            cable.lock_disturbance().rubbish = Some(rubbish);
        }
    }

    /// Whether no rubbish waits for its frame.
    #[must_use]
    pub fn has_no_pending_rubbish(&self) -> bool {
        self.cable.as_ref().is_none_or(|cable| cable.lock_disturbance().rubbish.is_none())
    }

    /// Takes rubbish back that no frame was long enough for; says whether there was any.
    #[must_use]
    pub fn withdraw_pending_rubbish(&self) -> bool {
        self.cable.as_ref().is_some_and(|cable| cable.lock_disturbance().rubbish.take().is_some())
    }
}

fn start_device() -> Result<(SimDevice, PlanTable), Error> {
    let table = build_plan_table_of_simulated_panel()?;
    let volts = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
    let device = SimDevice::start_with_board_id(SimPanel::from_plan_table(&table), volts, SimBoard::ID);
    Ok((device.map_err(Error::system_error("no pseudo-terminal"))?, table))
}

/// What is planned with for the panel of [`PANEL_SCENE`].
///
/// # Errors
/// [`Error::Scene`].
pub fn build_plan_table_of_simulated_panel() -> Result<PlanTable, Error> {
    let wrong = |error: &dyn std::fmt::Display| Error::Scene(error.to_string());
    let scene = Scene::parse("example plate", PANEL_SCENE).map_err(|error| wrong(&error))?;
    let options = TableOptions::default();
    let model = PanelModel::build(&scene, Accuracy::FAST, options.to_hz)
        .map_err(|error| wrong(&error))?
        .reduce_with_residual_shapes_of_actuators_damping_and_points(options.to_hz, &[])
        .map_err(|error| wrong(&error))?;
    PlanTable::build(&scene, model, options).map_err(|error| wrong(&error))
}

#[derive(Debug)]
struct Cable {
    path: String,
    disturbance: Arc<Mutex<Disturbance>>,
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
        let disturbance = Arc::new(Mutex::new(Disturbance::default()));
        let (host_too, board_too) = (host.try_clone_native()?, board.try_clone_native()?);
        let carry = |direction: Direction, from: TTYPort, to: TTYPort| {
            let disturbance = Arc::clone(&disturbance);
            let carrier = Carrier { direction, at: 0, from, to, disturbance };
            std::thread::Builder::new()
                .name("cable".into())
                .spawn(move || carrier.carry_one_direction_with_disturbances_until_pulled())
        };
        let down = carry(Direction::ToBoard, host, board).map_err(Error::system_error("no thread"))?;
        let up = carry(Direction::ToHost, board_too, host_too).map_err(Error::system_error("no thread"))?;
        Ok(Self { path, disturbance, threads: vec![down, up] })
    }

    fn lock_disturbance(&self) -> MutexGuard<'_, Disturbance> {
        self.disturbance.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.lock_disturbance().pulled = true;
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

struct Carrier {
    direction: Direction,
    /// Bytes of the present frame that have gone by.
    at: usize,
    from: TTYPort,
    to: TTYPort,
    disturbance: Arc<Mutex<Disturbance>>,
}

impl Carrier {
    fn carry_one_direction_with_disturbances_until_pulled(mut self) {
        let mut buffer = [0_u8; 512];
        loop {
            let read = self.from.read(&mut buffer);
            let mut disturbance = self.disturbance.lock().unwrap_or_else(PoisonError::into_inner);
            if disturbance.pulled {
                return;
            }
            let length = match read {
                Ok(length) => length,
                Err(error) if error.kind() == ErrorKind::TimedOut => continue,
                // Nobody has the other end open.
                Err(_) => {
                    drop(disturbance);
                    std::thread::sleep(LOOK);
                    continue;
                }
            };
            if disturbance.cut.contains(&self.direction) {
                self.at = 0;
                continue;
            }
            let bytes = insert_due_rubbish(
                buffer.get(..length).unwrap_or_default(),
                &mut self.at,
                self.direction,
                &mut disturbance.rubbish,
            );
            drop(disturbance);
            // What cannot be written is lost, as on a cable.
            let _ = self.to.write_all(&bytes);
        }
    }
}

/// The bytes with the rubbish in its place, if that is among them; `frame_position` counts the bytes of the frame that have gone by.
fn insert_due_rubbish(
    bytes: &[u8],
    frame_position: &mut usize,
    direction: Direction,
    rubbish: &mut Option<Rubbish>,
) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len() + 16);
    for byte in bytes {
        if rubbish
            .as_ref()
            .is_some_and(|rubbish| rubbish.direction == direction && rubbish.at == *frame_position && *byte != END)
        {
            out.extend(rubbish.take().into_iter().flat_map(|rubbish| rubbish.bytes));
        }
        out.push(*byte);
        *frame_position = if *byte == END { 0 } else { *frame_position + 1 };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rubbish_goes_before_its_byte_of_the_next_frame_that_has_one() {
        let mut rubbish = Some(Rubbish { direction: Direction::ToHost, at: 2, bytes: vec![9, 9] });
        let mut at = 0;
        assert_eq!(insert_due_rubbish(&[1, 2, 3, 0], &mut at, Direction::ToBoard, &mut rubbish), [1, 2, 3, 0]);
        assert_eq!(
            insert_due_rubbish(&[1, 2, 0, 1], &mut at, Direction::ToHost, &mut rubbish),
            [1, 2, 0, 1],
            "too short"
        );
        assert_eq!(
            insert_due_rubbish(&[2, 3, 0, 1, 2, 3], &mut at, Direction::ToHost, &mut rubbish),
            [2, 9, 9, 3, 0, 1, 2, 3]
        );
        assert!(rubbish.is_none() && at == 3);
    }
}
