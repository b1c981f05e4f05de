//! Whether a program at the other end of a link has it open.

/// Follows the line with which a computer shows that a program has a serial port open: DTR, which operating systems raise when a port is opened
/// and drop when it is closed, also for a program that was killed.
#[derive(Clone, Copy, Debug, Default)]
pub struct PortWatch {
    is_open: bool,
}

impl PortWatch {
    /// A port that nobody has opened.
    #[must_use]
    pub const fn new() -> Self {
        Self { is_open: false }
    }

    /// Notes the line as it is now, and tells whether the program that had the port open has closed it. A host that never raises the line
    /// closes nothing.
    pub const fn note_line_and_tell_whether_closed(&mut self, is_open: bool) -> bool {
        let was_open = core::mem::replace(&mut self.is_open, is_open);
        was_open && !is_open
    }
}
