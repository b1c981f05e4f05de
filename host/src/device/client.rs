//! One request, one reply, over any byte stream: framing, time-outs, repeats.

use super::round_trips::{self, RoundTripSummary};
use super::timing::{LONGEST_FRAME, RetryPolicy, uart_time_for_bytes};
use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{CURRENT_VERSION, MIN_VERSION, Refusal, Reply, Request};
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The port failed: most often the cable was pulled.
    #[error("the device's port failed: {0}. Check the cable and the power of the board")]
    Io(#[from] std::io::Error),
    /// The port cannot be had.
    #[error(transparent)]
    Port(#[from] super::port::PortError),
    /// The emulator has ended, and does not start again.
    #[error("{0}; the daemon tries again to start the emulator")]
    Emulator(String),
    /// Nothing, or nothing readable, came back.
    #[error(
        "the device gave no readable answer to {request}, which was sent {attempts} times in {waited:.0?}. Check \
         that the device is an ERA board, and that no other program uses its port"
    )]
    Silent {
        /// The request's name.
        request: &'static str,
        /// How long was waited in all.
        waited: Duration,
        /// How often it was sent.
        attempts: u32,
    },
    /// The port takes no bytes: the board hangs, or its USB controller does.
    #[error(
        "the device's port accepted no bytes for {waited:?}. Check that the board has power and that its cable is connected"
    )]
    Blocked {
        /// How long was waited.
        waited: Duration,
    },
    /// There is another board than before.
    #[error(
        "the board at this port is {found}, but this daemon drives {wanted}: connect {wanted} again, or restart \
         the daemon to use {found}"
    )]
    OtherBoard {
        /// Identifier of the board that the session began with.
        wanted: String,
        /// Identifier of the board that answers.
        found: String,
    },
    /// The device is too old for this request; everything else goes on.
    #[error(
        "{request} needs ERA protocol version {needed}, but this device speaks {spoken}: update the board's firmware"
    )]
    TooOld {
        /// The request's name.
        request: &'static str,
        /// Oldest version that has it.
        needed: u8,
        /// Version spoken with this device.
        spoken: u8,
    },
    /// The two sides have no protocol version in common.
    #[error(
        "this program speaks ERA protocol versions {host_min} to {host_current}, but the device speaks versions \
         {device_min} to {device_current}: update {}",
        if device_current < host_min { "the board's firmware" } else { "this program" }
    )]
    Version {
        /// Oldest spoken here.
        host_min: u8,
        /// Newest spoken here.
        host_current: u8,
        /// Oldest spoken by the device.
        device_min: u8,
        /// Newest spoken by the device.
        device_current: u8,
    },
    /// The device refused.
    #[error("the device refused the request: {}", super::convert::describe_refusal(.0))]
    Refused(Refusal),
    /// A stop was sent in its place, and the device has obeyed that.
    #[error(
        "the device gave no answer for {waited:.0?} and was stopped, so the request {request} was not carried out or \
         was interrupted"
    )]
    Halted {
        /// The request's name.
        request: &'static str,
        /// How long its answer had been waited for.
        waited: Duration,
        /// Whether somebody asked for the stop; else it is for the answer's being late.
        by_order: bool,
    },
    /// The device answered another question than was asked.
    #[error("the device answered {request} with {reply}: this program does not support the firmware of the device")]
    Unexpected {
        /// The request's name.
        request: &'static str,
        /// What came.
        reply: String,
    },
}

/// A byte stream to a device. Reads return what there is, writes take what they can, and both time out within a few ms.
pub trait Transport: Read + Write + Send {}
impl<T: Read + Write + Send + ?Sized> Transport for T {}

/// What the link has done so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkStatistics {
    /// Frames sent, repeats included.
    pub frames_sent: u64,
    /// Frames sent again as no answer came.
    pub repeats: u64,
    /// Stretches of bytes that were no frame.
    pub bad_frames: u64,
}

impl std::ops::AddAssign for LinkStatistics {
    fn add_assign(&mut self, other: Self) {
        self.frames_sent += other.frames_sent;
        self.repeats += other.repeats;
        self.bad_frames += other.bad_frames;
    }
}

/// What a session is told and asked while an answer is waited for.
pub struct WaitHooks<'a> {
    /// Told once, with the request's name and how long was waited, when the answer is so late that the device may be gone. It may
    /// still come.
    pub in_doubt: &'a mut dyn FnMut(&'static str, Duration),
    /// Whether everything is to be stopped now, whatever is waited for.
    pub is_stopped: &'a dyn Fn() -> bool,
}

/// Why a stop has to be sent while an answer is waited for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum StopCause {
    /// Somebody asked for it.
    Ordered,
    /// The answer is late.
    LateAnswer,
}

/// How the wait for an answer has ended.
enum WaitOutcome {
    Answer(Box<Reply>, Instant),
    Nothing,
    /// A stop has to be sent.
    StopDue(StopCause),
}

/// The host's end of the link.
pub struct Client {
    transport: Box<dyn Transport>,
    decoder: Decoder,
    sequence: u16,
    /// The version in use: the newest, until the device says that it is older.
    version: u8,
    retry_policy: RetryPolicy,
    /// The tries of the present request, of which any may be answered: how they are numbered, and when the last byte of each was handed
    /// to the port.
    tries: Vec<(u16, Instant)>,
    statistics: LinkStatistics,
    round_trips: round_trips::RoundTripHistory,
    last_answered_frame_written: Option<Instant>,
    last_reply_read: Option<Instant>,
}

impl Client {
    /// A client over `transport` that waits `timeout` for each answer, three times.
    #[must_use]
    pub fn new(transport: Box<dyn Transport>, timeout: Duration) -> Self {
        Self::with_retry_policy(transport, RetryPolicy::with_three_tries_of_constant_timeout(timeout))
    }

    /// A client over `transport` with these times and repeats.
    #[must_use]
    pub fn with_retry_policy(transport: Box<dyn Transport>, retry_policy: RetryPolicy) -> Self {
        Self {
            transport,
            decoder: Decoder::new(),
            sequence: 0,
            version: CURRENT_VERSION,
            retry_policy,
            tries: Vec::new(),
            statistics: LinkStatistics::default(),
            round_trips: round_trips::RoundTripHistory::default(),
            last_answered_frame_written: None,
            last_reply_read: None,
        }
    }

    /// What the link has done so far.
    #[must_use]
    pub const fn link_statistics(&self) -> LinkStatistics {
        self.statistics
    }

    /// The last round trips.
    #[must_use]
    pub fn summarise_round_trips(&self) -> RoundTripSummary {
        self.round_trips.compute_median_worst_and_jitter()
    }

    /// When the last byte of the last frame that was answered was handed to the port.
    #[must_use]
    pub const fn last_answered_frame_written_at(&self) -> Option<Instant> {
        self.last_answered_frame_written
    }

    /// When the answer to the last request had been read.
    #[must_use]
    pub const fn last_reply_read_at(&self) -> Option<Instant> {
        self.last_reply_read
    }

    /// Protocol version in use.
    #[must_use]
    pub const fn protocol_version(&self) -> u8 {
        self.version
    }

    /// Sends `request` and waits for its reply; a refusal is an error. With a device that is older than this program its
    /// version is spoken from its first refusal on.
    ///
    /// # Errors
    /// [`LinkError`]; after [`LinkError::Silent`] and [`LinkError::Io`] it is not known whether the request was carried
    /// out.
    pub fn request(&mut self, request: &Request) -> Result<Reply, LinkError> {
        self.request_negotiating_version(request, &mut None)
    }

    /// As [`Self::request`], for a session: when everything has to be stopped, or the answer is as late as [`RetryPolicy::stop`], a stop is sent at
    /// once, and in place of every further try.
    ///
    /// # Errors
    /// As [`Self::request`]; [`LinkError::Halted`] when the stop has been answered.
    pub fn request_sending_stop_when_ordered_or_late(
        &mut self,
        request: &Request,
        hooks: WaitHooks<'_>,
    ) -> Result<Reply, LinkError> {
        self.request_negotiating_version(request, &mut Some(hooks))
    }

    /// Sends a last stop before this link is given up, and does not wait for a reply: the device may receive though its answers are lost.
    pub fn send_stop_without_reply(&mut self) {
        let mut frame = [0; MAX_ENCODED];
        self.sequence = self.sequence.wrapping_add(1);
        // The zero ends whatever half frame the line may hold.
        if let Ok(length) = encode_frame(self.version, FrameKind::Request, self.sequence, &Request::Stop, &mut frame) {
            let mut bytes = vec![0];
            bytes.extend_from_slice(frame.get(..length).unwrap_or_default());
            let _ = self.transport.write(&bytes);
        }
    }

    fn request_negotiating_version(
        &mut self,
        request: &Request,
        hooks: &mut Option<WaitHooks<'_>>,
    ) -> Result<Reply, LinkError> {
        match self.request_with_retries_sending_stop_when_due(request, hooks)? {
            Reply::Refused(Refusal::Version { device_min, device_current, .. }) => {
                let common = device_current.min(CURRENT_VERSION);
                if common >= device_min.max(MIN_VERSION) && common != self.version {
                    tracing::info!(version = common, "the device speaks an older protocol version");
                    self.version = common;
                    return self.request_negotiating_version(request, hooks);
                }
                Err(LinkError::Version {
                    host_min: MIN_VERSION,
                    host_current: CURRENT_VERSION,
                    device_min,
                    device_current,
                })
            }
            Reply::Refused(refusal) => Err(LinkError::Refused(refusal)),
            reply => Ok(reply),
        }
    }

    fn request_with_retries_sending_stop_when_due(
        &mut self,
        request: &Request,
        hooks: &mut Option<WaitHooks<'_>>,
    ) -> Result<Reply, LinkError> {
        if request.introduced_in_version() > self.version {
            return Err(LinkError::TooOld {
                request: request_name(request),
                needed: request.introduced_in_version(),
                spoken: self.version,
            });
        }
        self.tries.clear();
        let last = self.round_trips.newest_round_trip().unwrap_or_default();
        let (mut doubt, mut stop): (Option<Instant>, Option<Instant>) = (None, None);
        let mut halted: Option<LinkError> = None;
        let begun = Instant::now();
        for attempt in 0..self.retry_policy.tries {
            if attempt > 0 {
                self.statistics.repeats += 1;
                tracing::debug!(
                    request = request_name(request),
                    attempt,
                    halted = halted.is_some(),
                    "the device gave no answer in time; the request is sent again"
                );
                // A zero ends whatever half frame the line may hold, so that the repeat is not spoiled by it.
                self.write_all_bytes(&[0])?;
            }
            let on_wire =
                self.send_one_try_and_compute_frame_wire_time(if halted.is_some() { &Request::Stop } else { request })?;
            let deadline = Instant::now() + self.retry_policy.timeout_of_try(attempt, last) + on_wire;
            if attempt == 0 {
                doubt = Instant::now().checked_add(self.retry_policy.doubt.saturating_add(on_wire));
                stop = Instant::now().checked_add(self.retry_policy.stop.saturating_add(on_wire));
            }
            let may_halt = halted.is_none() && !matches!(request, Request::Stop);
            let mut check_if_stop_due = |now: Instant| {
                let hooks = hooks.as_mut()?;
                if doubt.take_if(|doubt| now >= *doubt).is_some() {
                    (hooks.in_doubt)(request_name(request), now - begun);
                }
                if !may_halt {
                    None
                } else if (hooks.is_stopped)() {
                    Some(StopCause::Ordered)
                } else {
                    stop.filter(|stop| now >= *stop).map(|_| StopCause::LateAnswer)
                }
            };
            match self.await_reply_until_deadline_or_stop_due(deadline, &mut check_if_stop_due)? {
                WaitOutcome::Answer(reply, sent) => {
                    let read = Instant::now();
                    self.last_reply_read = Some(read);
                    self.last_answered_frame_written = Some(sent);
                    self.round_trips.add_round_trip(read - sent);
                    return halted.map_or(Ok(*reply), Err);
                }
                WaitOutcome::Nothing => {}
                WaitOutcome::StopDue(cause) => {
                    halted = Some(LinkError::Halted {
                        request: request_name(request),
                        waited: begun.elapsed(),
                        by_order: cause == StopCause::Ordered,
                    });
                    // From here on only the stop's answer counts.
                    self.tries.clear();
                }
            }
        }
        if halted.is_some() && self.tries.is_empty() {
            // It came due in the last try.
            self.send_stop_without_reply();
        }
        let attempts = self.retry_policy.tries;
        Err(LinkError::Silent { request: request_name(request), waited: begun.elapsed(), attempts })
    }

    /// Sends one try of a request; returns how long its frame takes on the wire.
    fn send_one_try_and_compute_frame_wire_time(&mut self, request: &Request) -> Result<Duration, LinkError> {
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; MAX_ENCODED];
        let length = encode_frame(self.version, FrameKind::Request, self.sequence, request, &mut frame)
            .map_err(|error| std::io::Error::new(ErrorKind::InvalidInput, format!("{error:?}")))?;
        self.write_all_bytes(frame.get(..length).unwrap_or_default())?;
        self.tries.push((self.sequence, Instant::now()));
        self.statistics.frames_sent += 1;
        Ok(uart_time_for_bytes(length))
    }

    /// Writes all bytes to the port, within the time that a try may wait. Does not flush: that is `tcdrain`, which waits without a limit for a
    /// device that takes nothing, and the system sends what it has anyway.
    fn write_all_bytes(&mut self, mut bytes: &[u8]) -> Result<(), LinkError> {
        let begun = Instant::now();
        while !bytes.is_empty() {
            match self.transport.write(bytes) {
                Ok(0) => return Err(std::io::Error::from(ErrorKind::WriteZero).into()),
                Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
                Err(error)
                    if is_to_be_retried(&error)
                        && begun.elapsed() < self.retry_policy.most.min(self.retry_policy.doubt) => {}
                Err(error) if is_to_be_retried(&error) => {
                    return Err(LinkError::Blocked { waited: begun.elapsed() });
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Waits for the reply to one of the tries; nothing if no reply has begun to arrive by the deadline. A reply that has begun may take as long as
    /// the longest frame takes on the wire. `check_if_stop_due` is called at times at which nothing had come; the wait ends if it gives why a stop
    /// has to be sent.
    fn await_reply_until_deadline_or_stop_due(
        &mut self,
        mut deadline: Instant,
        check_if_stop_due: &mut dyn FnMut(Instant) -> Option<StopCause>,
    ) -> Result<WaitOutcome, LinkError> {
        let mut buffer = [0_u8; 512];
        let last = deadline + LONGEST_FRAME;
        loop {
            // Before the read: what has come by the time of it counts, however late this thread is.
            let now = Instant::now();
            let length = match self.transport.read(&mut buffer) {
                Ok(0) => return Err(std::io::Error::from(ErrorKind::UnexpectedEof).into()),
                Ok(length) => length,
                Err(error) if is_to_be_retried(&error) => {
                    if let Some(cause) = check_if_stop_due(now) {
                        return Ok(WaitOutcome::StopDue(cause));
                    }
                    if now >= deadline {
                        return Ok(WaitOutcome::Nothing);
                    }
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            let mut found = None;
            let (tries, mut bad) = (&self.tries, 0);
            self.decoder.feed_bytes(buffer.get(..length).unwrap_or_default(), |result| match result {
                Ok(frame) if frame.kind == FrameKind::Reply as u8 => {
                    // Others are late answers to requests that have had theirs.
                    let sent = tries.iter().find(|(sequence, _)| *sequence == frame.sequence).map(|(_, sent)| *sent);
                    match (sent, postcard::from_bytes(frame.body)) {
                        (Some(sent), Ok(reply)) => found = Some((reply, sent)),
                        (Some(_), Err(_)) => bad += 1,
                        (None, _) => {}
                    }
                }
                Ok(_) => {}
                Err(_) => bad += 1,
            });
            self.statistics.bad_frames += bad;
            if let Some((reply, sent)) = found {
                return Ok(WaitOutcome::Answer(Box::new(reply), sent));
            }
            if now >= last {
                return Ok(WaitOutcome::Nothing);
            }
            deadline = deadline.max(Instant::now() + LONGEST_FRAME).min(last);
        }
    }
}

/// Whether this error of a port only means that it has to be tried again.
fn is_to_be_retried(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// A request's name, as in logs and messages.
#[must_use]
pub const fn request_name(request: &Request) -> &'static str {
    match request {
        Request::Hello { .. } => "hello",
        Request::Arm { .. } => "arm",
        Request::Disarm => "disarm",
        Request::SetDrives { .. } => "set-drives",
        Request::Stop => "stop",
        Request::KeepAlive => "keep-alive",
        Request::Status => "status",
        Request::Faults => "faults",
        Request::ClearFaults => "clear-faults",
        Request::Telemetry => "telemetry",
        Request::ArmWith { .. } => "arm-with",
        Request::Prepare { .. } => "prepare",
        Request::Play { .. } => "play",
        Request::Clock => "clock",
        Request::Details => "details",
        Request::Log => "log",
        Request::Bootloader { .. } => "bootloader",
        Request::Credit => "credit",
        Request::PlayOnce { .. } => "play-once",
        Request::PlayWindows(_) => "play-windows",
        Request::NumberedFault => "numbered-fault",
        Request::ClearFault { .. } => "clear-fault",
    }
}
