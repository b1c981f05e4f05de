//! Another program that has a board's port open: first it only has it, later it reads what the board says.

use std::io::Write;
use std::process::{Child, Command, Stdio};

/// The program, which ends with the test.
pub struct Reader(Child);

impl Reader {
    /// One that has the port open and does nothing with it. It goes first: nobody else may open a port that a daemon has.
    pub fn with_open(port: &str) -> Self {
        let script = "exec 3<\"$1\"; echo open; read go; exec cat <&3 >/dev/null";
        let mut command = Command::new("sh");
        command.args(["-c", script, "sh", port]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut line = String::new();
        std::io::BufRead::read_line(&mut std::io::BufReader::new(child.stdout.as_mut().unwrap()), &mut line).unwrap();
        assert_eq!(line, "open\n");
        Self(child)
    }

    /// It becomes `cat`, which takes every byte that the board says.
    pub fn reads(&mut self) {
        writeln!(self.0.stdin.as_mut().unwrap(), "go").unwrap();
        let name = || std::fs::read_to_string(format!("/proc/{}/comm", self.0.id())).unwrap();
        crate::wait_until("the other program reads", || name() == "cat\n");
    }

    /// How a message names it.
    pub fn name(&self) -> String {
        format!("cat (process {})", self.0.id())
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
