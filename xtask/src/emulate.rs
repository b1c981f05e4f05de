//! `cargo xtask emulate`: the firmware image on the emulated board.

use crate::error::Error;
use crate::process::shown;
use crate::{elf, firmware, root};
use era_shared::link::{Decoder, Kind, MAX_ENCODED, encode};
use era_shared::protocol::{CURRENT_VERSION, HelloReply, MIN_VERSION, Reply, Request};
use serde::Deserialize;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// How long the emulated board may take to answer on the wall clock. It answers within 30 ms on a quiet machine.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);

/// Options of `cargo xtask emulate`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Say hello this many times, print how long the answers took, and end.
    #[arg(long, value_name = "TIMES")]
    measure: Option<usize>,
}

/// Builds, starts the bridge, says hello, then hands the bridge's control channel to the terminal until it is closed.
///
/// # Errors
/// What went wrong on the way.
pub fn command(options: &Options) -> Result<(), Error> {
    let (image, _) = firmware::build(false)?;
    let usage = elf::usage(&image)?;
    eprintln!("emulate: image of {} bytes, {}", usage.flash, image.display());
    let mut bridge = Bridge::start(&image)?;
    println!("{}", bridge.terminal.display());

    let mut link = Link::open(&bridge.terminal)?;
    let started = Instant::now();
    let hello = link.hello()?;
    let version = hello.firmware;
    eprintln!(
        "emulate: hello from board {} after {:.0} ms: firmware {}.{}.{}, protocol {} to {}, {} channels",
        String::from_utf8_lossy(&hello.board_id),
        started.elapsed().as_secs_f64() * 1e3,
        version.major,
        version.minor,
        version.patch,
        hello.protocol_min,
        hello.protocol_current,
        hello.channels.len()
    );
    if let Some(times) = options.measure {
        return measure(&mut bridge, &mut link, times);
    }
    drop(link);
    eprintln!("emulate: commands of the bridge can be typed here, one JSON object a line; Ctrl-D ends it");
    bridge.hand_over()
}

fn measure(bridge: &mut Bridge, link: &mut Link, times: usize) -> Result<(), Error> {
    let mut milliseconds = Vec::with_capacity(times);
    let before = bridge.time()?;
    for _ in 0..times {
        let started = Instant::now();
        link.hello()?;
        milliseconds.push(started.elapsed().as_secs_f64() * 1e3);
    }
    let after = bridge.time()?;
    milliseconds.sort_by(f64::total_cmp);
    let at = |fraction: f64| {
        let index = (fraction * (milliseconds.len().max(1) - 1) as f64).round() as usize;
        milliseconds.get(index).copied().unwrap_or(f64::NAN)
    };
    println!("round trips     {times}");
    println!("median          {:.1} ms", at(0.5));
    println!("99 % within     {:.1} ms", at(0.99));
    println!("virtual / wall  {:.2}", (after.virtual_s - before.virtual_s) / (after.wall_s - before.wall_s));
    Ok(())
}

/// The running bridge. It ends when this is dropped, as its standard input then closes.
struct Bridge {
    child: Child,
    commands: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    terminal: PathBuf,
}

#[derive(Deserialize)]
struct Ready {
    pty: PathBuf,
}

#[derive(Deserialize)]
struct Times {
    virtual_s: f64,
    wall_s: f64,
}

impl Bridge {
    fn start(image: &std::path::Path) -> Result<Self, Error> {
        let mut python = Command::new("python3");
        python.arg(root()?.join("emulator/launch.py")).arg("--elf").arg(image);
        python.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = python.spawn().map_err(|source| Error::Start { command: shown(&python), source })?;
        let (Some(commands), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(Error::Bridge("has no standard input and output".to_owned()));
        };
        let mut bridge =
            Self { child, commands: Some(commands), answers: BufReader::new(answers), terminal: PathBuf::new() };
        let ready: Ready = bridge.answer()?;
        bridge.terminal = ready.pty;
        Ok(bridge)
    }

    fn answer<T: for<'de> Deserialize<'de>>(&mut self) -> Result<T, Error> {
        let mut line = String::new();
        match self.answers.read_line(&mut line) {
            Ok(0) => Err(Error::Bridge("ended without an answer; its messages are above".to_owned())),
            Ok(_) => serde_json::from_str(&line).map_err(|error| Error::Bridge(format!("{error} in {line}"))),
            Err(error) => Err(Error::Bridge(error.to_string())),
        }
    }

    fn time(&mut self) -> Result<Times, Error> {
        let commands = self.commands.as_mut().ok_or_else(|| Error::Bridge("its input is closed".to_owned()))?;
        commands.write_all(b"{\"op\":\"time\"}\n").map_err(|error| Error::Bridge(error.to_string()))?;
        self.answer()
    }

    /// Connects the bridge's control channel with this program's input and output until the input ends.
    fn hand_over(mut self) -> Result<(), Error> {
        if let Some(mut commands) = self.commands.take() {
            // Not joined: it may wait for a key for ever, and ends with the program.
            thread::spawn(move || io::copy(&mut io::stdin().lock(), &mut commands));
        }
        io::copy(&mut self.answers, &mut io::stdout().lock()).map_err(|error| Error::Bridge(error.to_string()))?;
        Ok(())
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        drop(self.commands.take());
        // It ends by itself now; waiting keeps it from becoming a zombie.
        let _ = self.child.wait();
    }
}

/// The serial link to the board.
struct Link {
    port: File,
    bytes: mpsc::Receiver<Vec<u8>>,
    decoder: Decoder,
    sequence: u16,
}

impl Link {
    fn open(path: &std::path::Path) -> Result<Self, Error> {
        let file_error = |source| Error::File { what: "cannot open", path: path.to_path_buf(), source };
        let port = OpenOptions::new().read(true).write(true).open(path).map_err(file_error)?;
        let mut reader = port.try_clone().map_err(file_error)?;
        let (sender, bytes) = mpsc::channel();
        // A file has no time-out for reading, a channel has. The thread ends with the bridge.
        thread::spawn(move || {
            let mut buffer = [0; MAX_ENCODED];
            while let Ok(count @ 1..) = reader.read(&mut buffer) {
                if sender.send(buffer.iter().take(count).copied().collect()).is_err() {
                    break;
                }
            }
        });
        Ok(Self { port, bytes, decoder: Decoder::new(), sequence: 0 })
    }

    fn hello(&mut self) -> Result<HelloReply, Error> {
        self.sequence = self.sequence.wrapping_add(1);
        let request = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
        let mut frame = [0; MAX_ENCODED];
        let length =
            encode(CURRENT_VERSION, Kind::Request, self.sequence, &request, &mut frame).map_err(Error::Encode)?;
        let bytes = frame.get(..length).unwrap_or(&[]);
        self.port.write_all(bytes).map_err(|error| Error::Bridge(error.to_string()))?;
        let end = Instant::now() + ANSWER_LIMIT;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let bytes = self.bytes.recv_timeout(left).map_err(|_| Error::Silent(ANSWER_LIMIT))?;
            for byte in bytes {
                if let Some(Ok(frame)) = self.decoder.push(byte)
                    && frame.sequence == self.sequence
                    && let Ok(Reply::Hello(reply)) = postcard::from_bytes(frame.body)
                {
                    return Ok(reply);
                }
            }
        }
    }
}
