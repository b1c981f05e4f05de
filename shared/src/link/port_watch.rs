//! Whether a program at the other end of a link has it open.

use super::LinkArrival;

/// Follows the line with which a computer shows that a program has a serial port open: DTR, which operating systems raise when a port is opened
/// and drop when it is closed, also for a program that was killed.
#[derive(Clone, Copy, Debug)]
pub struct PortWatch {
    link: usize,
    is_open: bool,
}

impl PortWatch {
    /// A port that nobody has opened, of the link at this place.
    #[must_use]
    pub const fn new(link: usize) -> Self {
        Self { link, is_open: false }
    }

    /// Notes the line as it is now. If the program that had the port open has closed it, this is what the device has to be told: the link, and that
    /// whoever comes next is another one. A host that never raises the line closes nothing.
    pub const fn note_port_state_and_build_reopened_arrival_if_just_closed(
        &mut self,
        is_open: bool,
    ) -> Option<(usize, LinkArrival)> {
        let was_open = core::mem::replace(&mut self.is_open, is_open);
        if was_open && !is_open { Some((self.link, LinkArrival::Reopened)) } else { None }
    }
}
