//! Everything that the program writes to standard output and standard error.
//!
//! * A result goes to standard output: a text, or with `--json` exactly one JSON object.
//!   `monitor --json` and `estimate run --json` write one object per line.
//! * Progress, notices and errors go to standard error. An error that cannot be shown is dropped.
//! * A reader that closes the pipe (`forcectl explain | head -1`) ends the output and nothing else:
//!   the command goes on, and its exit code stays.
//! * Any other failure of standard output, such as a full disk, is reported once. It turns exit
//!   code 0 into 7.

use super::exit::{self, Failure, Reply, Result};
use clap::{ArgAction, Args};
use serde_json::Value;
use std::borrow::Cow;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::{Mutex, PoisonError, TryLockError};

/// Options of every command.
#[derive(Debug, Clone, Copy, Default, Args)]
#[command(next_help_heading = "Output")]
pub struct OutputArgs {
    /// Print one JSON object instead of text; `monitor` and `estimate run` print one object per
    /// line
    #[arg(long, global = true)]
    pub json: bool,
    /// Print details on standard error; -vv adds one line per second of a run
    #[arg(short, long, global = true, action = ArgAction::Count, conflicts_with = "quiet")]
    pub verbose: u8,
    /// Print results and errors only
    #[arg(short, long, global = true)]
    pub quiet: bool,
}

/// Where standard output stands.
#[derive(Debug)]
enum Pipe {
    Open,
    /// The reader has closed it.
    Closed,
    /// It cannot be written.
    Failed(io::Error),
}

#[derive(Debug)]
struct Standard {
    pipe: Pipe,
    /// The result or the error was printed.
    finished: bool,
}

impl Standard {
    fn write(&mut self, text: &str) {
        if !matches!(self.pipe, Pipe::Open) {
            return;
        }
        let mut out = io::stdout().lock();
        let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
        match written {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.pipe = Pipe::Closed,
            Err(error) => self.pipe = Pipe::Failed(error),
        }
    }

    /// Prints a result or an error, once.
    fn finish(&mut self, json: bool, result: &Result<Reply>) {
        if std::mem::replace(&mut self.finished, true) {
            return;
        }
        let line = |value: &Value| format!("{value}\n");
        match result {
            Ok(reply) if json => {
                if let Some(value) = &reply.json {
                    self.write(&line(value));
                }
            }
            Ok(reply) => self.write(&printable(&reply.text)),
            Err(failure) if json => self.write(&line(&failure.json())),
            Err(failure) => {
                if let Some(reply) = &failure.reply {
                    self.write(&printable(&reply.text));
                }
            }
        }
    }
}

/// Standard output and standard error of one command.
#[derive(Debug)]
pub struct Output {
    args: OutputArgs,
    standard: Mutex<Standard>,
}

impl Output {
    /// Output as the options ask for it.
    pub fn new(args: OutputArgs) -> Self {
        Self {
            args,
            standard: Mutex::new(Standard {
                pipe: Pipe::Open,
                finished: false,
            }),
        }
    }

    fn standard(&self) -> std::sync::MutexGuard<'_, Standard> {
        self.standard.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the result is JSON.
    pub fn json(&self) -> bool {
        self.args.json
    }

    /// Whether progress is shown: neither with `--quiet`, nor with `--json` unless `--verbose` asks
    /// for it.
    pub fn shows_progress(&self) -> bool {
        !self.args.quiet && (!self.args.json || self.args.verbose > 0)
    }

    /// Whether a run prints one line per second (`-vv`).
    pub fn shows_seconds(&self) -> bool {
        self.args.verbose > 1
    }

    /// Refuses `--json` for a command whose output has no JSON form.
    pub fn refuse_json(&self, what: &str) -> Result<()> {
        if self.args.json {
            return Err(Failure::usage(format!(
                "{what} has no JSON form; omit --json"
            )));
        }
        Ok(())
    }

    /// Writes a line of a stream to standard output.
    pub fn line(&self, line: &str) {
        self.standard().write(&format!("{}\n", printable(line)));
    }

    /// Writes results to standard output before the command is over.
    pub fn results(&self, text: &str) {
        self.standard().write(&printable(text));
    }

    /// Writes a text to standard output as it is, with its colours.
    pub fn print(&self, text: &str) {
        self.standard().write(text);
    }

    /// Whether standard output still takes anything.
    pub fn is_open(&self) -> bool {
        matches!(self.standard().pipe, Pipe::Open)
    }

    /// A message about progress.
    pub fn note(&self, text: &str) {
        if self.shows_progress() {
            to_stderr(&printable(text));
        }
    }

    /// A detail that `--verbose` asks for.
    pub fn detail(&self, text: &str) {
        if self.args.verbose > 0 {
            to_stderr(&printable(text));
        }
    }

    /// A message that is always shown.
    pub fn error(&self, text: &str) {
        to_stderr(&printable(text));
    }

    /// Prints the result or the error, and returns the exit code.
    pub fn finish(&self, result: &Result<Reply>) -> u8 {
        let mut standard = self.standard();
        standard.finish(self.args.json, result);
        let code = match result {
            Ok(reply) => reply.code,
            Err(failure) => {
                to_stderr(&format!("forcectl: {}", printable(&failure.message)));
                failure.code
            }
        };
        match &standard.pipe {
            Pipe::Failed(error) => {
                to_stderr(&format!(
                    "forcectl: standard output cannot be written: {error}"
                ));
                if code == exit::DONE {
                    exit::FILE
                } else {
                    code
                }
            }
            Pipe::Open | Pipe::Closed => code,
        }
    }

    /// Prints the error of a command that a signal ends at once. Does not wait for a reader that
    /// reads no more.
    pub fn finish_interrupted(&self) {
        let failure = Err(Failure::new(exit::INTERRUPTED, "interrupted"));
        match self.standard.try_lock() {
            Ok(mut standard) => standard.finish(self.args.json, &failure),
            Err(TryLockError::Poisoned(standard)) => {
                standard.into_inner().finish(self.args.json, &failure);
            }
            Err(TryLockError::WouldBlock) => {}
        }
    }
}

/// A text without control characters that a terminal would obey. Names come from rig files, boards
/// and rigs; they can hold anything. Line feeds and tabs stay.
fn printable(text: &str) -> Cow<'_, str> {
    let obeyed = |c: char| c.is_control() && c != '\n' && c != '\t';
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let mut out = String::new();
    for c in text.chars() {
        if obeyed(c) {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// Writes a line to standard error. A message that cannot be shown is no reason to stop.
pub fn to_stderr(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// A path as JSON. JSON is UTF-8: what a name has beside it becomes a replacement character, as in
/// texts. `json!` of the path itself panics there.
pub fn path_json(path: &std::path::Path) -> Value {
    path.display().to_string().into()
}

/// Whether standard output is a terminal.
pub fn stdout_is_terminal() -> bool {
    io::stdout().is_terminal()
}

/// Whether standard error is a terminal.
pub fn stderr_is_terminal() -> bool {
    io::stderr().is_terminal()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_and_not_sent() {
        assert_eq!(printable("a\n\tb °"), "a\n\tb °");
        assert_eq!(
            printable("\u{1b}[31mred\u{7}\r\u{9b}2J"),
            "\\u{1b}[31mred\\u{7}\\r\\u{9b}2J"
        );
    }
}
