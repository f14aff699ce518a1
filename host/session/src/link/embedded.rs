//! The embedded rig: the firmware image on the emulated board, a process of its own in lock-step.

use super::{EmbeddedOptions, Exchange, LinkError, RigControls, RigLink};
use emulator_link::{Injection, Report, Request, Response, LINK_VERSION};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, BufWriter};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Environment variable with the path of the rig program.
pub const RIG_VARIABLE: &str = "FORCE_RIG_BIN";
/// Environment variable with the path of the firmware image.
pub const ELF_VARIABLE: &str = "FORCE_FIRMWARE_ELF";
/// Lines of the rig's log that are kept for messages.
const LOG_LINES: usize = 12;
/// How long a response may take beside the emulated time that it covers.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(30);
/// Part of real time at which the slowest machine emulates: 1 s may take this many. Renode beside
/// other work on two cores took 100.
const SLOWEST: u32 = 200;
/// Polls of 10 ms until the log of a rig that ended counts as complete.
const LOG_POLLS: u32 = 200;

/// Where the rig program and the firmware image are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Programs {
    /// The rig program.
    pub rig: PathBuf,
    /// The firmware image (ELF).
    pub firmware: PathBuf,
}

impl Programs {
    /// From the environment, as `cargo forcectl` sets it.
    ///
    /// # Errors
    /// [`LinkError::Setup`] where a variable is missing or names no file.
    pub fn from_environment() -> Result<Self, LinkError> {
        let path = |variable: &str, what: &str| {
            let value = std::env::var_os(variable).ok_or_else(|| {
                LinkError::Setup(format!(
                    "the embedded rig needs {what}, and {variable} is not set: run through `cargo forcectl`, which builds both and sets it, or choose a board with --link usb or --link serial:PORT"
                ))
            })?;
            let path = PathBuf::from(value);
            if path.is_file() {
                Ok(path)
            } else {
                Err(LinkError::Setup(format!(
                    "{variable} names {}, which is not a file: run through `cargo forcectl`, which builds it",
                    path.display()
                )))
            }
        };
        Ok(Self {
            rig: path(RIG_VARIABLE, "its program")?,
            firmware: path(ELF_VARIABLE, "a firmware image")?,
        })
    }
}

/// A running embedded rig. Dropping it ends the process.
#[derive(Debug)]
pub struct EmbeddedRig {
    child: Child,
    to: Option<BufWriter<ChildStdin>>,
    /// Responses, read by a thread: a rig that falls silent must not hold the program for ever.
    responses: Receiver<std::io::Result<Response>>,
    log: Arc<Mutex<VecDeque<String>>>,
    log_reader: std::thread::JoinHandle<()>,
    machine: String,
    usb: bool,
    seed: u64,
    response_timeout: Duration,
}

impl EmbeddedRig {
    /// Starts the rig and loads the image; virtual time stands at zero.
    ///
    /// # Errors
    /// [`LinkError`] where it can't be started, speaks another version or refuses the image.
    pub fn start(programs: &Programs, options: &EmbeddedOptions) -> Result<Self, LinkError> {
        Self::start_within(programs, options, RESPONSE_TIMEOUT)
    }

    /// The same with another limit for each response.
    fn start_within(
        programs: &Programs,
        options: &EmbeddedOptions,
        response_timeout: Duration,
    ) -> Result<Self, LinkError> {
        let mut command = Command::new(&programs.rig);
        command.arg("--elf").arg(&programs.firmware);
        if let Some(seed) = options.seed {
            command.arg("--seed").arg(seed.to_string());
        }
        if options.run != 0 {
            command.arg("--run").arg(options.run.to_string());
        }
        if let Some(plant) = &options.plant {
            command.arg("--plant").arg(plant);
        }
        if options.usb {
            command.arg("--usb");
        }
        if options.paced {
            command.arg("--paced");
        }
        // A process group of its own: Ctrl-C is for this program, which then stops the rig.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let opening = |cause: String| LinkError::Open {
            name: format!("the embedded rig {}", programs.rig.display()),
            cause,
            hint: "run through `cargo forcectl`, which builds rig and firmware".to_owned(),
        };
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| opening(error.to_string()))?;
        let (Some(to), Some(from), Some(log_from)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            return Err(opening("its pipes are missing".to_owned()));
        };
        let log = Arc::new(Mutex::new(VecDeque::new()));
        let keep = Arc::clone(&log);
        let log_reader = std::thread::spawn(move || {
            for line in BufReader::new(log_from).lines().map_while(Result::ok) {
                let mut lines = keep.lock().unwrap_or_else(PoisonError::into_inner);
                if lines.len() == LOG_LINES {
                    lines.pop_front();
                }
                lines.push_back(line);
            }
        });
        let (answered, responses) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let mut from = BufReader::new(from);
            loop {
                let response = emulator_link::receive(&mut from);
                let ended = response.is_err();
                if answered.send(response).is_err() || ended {
                    return;
                }
            }
        });
        let mut rig = Self {
            child,
            to: Some(BufWriter::new(to)),
            responses,
            log,
            log_reader,
            machine: String::new(),
            usb: options.usb,
            seed: 0,
            response_timeout,
        };
        let hello = Request::Hello {
            version: LINK_VERSION,
        };
        match rig.ask(&hello)? {
            Response::Ready {
                version,
                seed,
                machine,
            } if version == LINK_VERSION => {
                rig.machine = machine;
                rig.seed = seed;
                Ok(rig)
            }
            Response::Ready { version, .. } => Err(LinkError::Setup(format!(
                "the embedded rig speaks link version {version}, this forcectl {LINK_VERSION}: run through `cargo forcectl`, which builds both alike"
            ))),
            other => Err(unexpected(&other)),
        }
    }

    fn ask(&mut self, request: &Request) -> Result<Response, LinkError> {
        let sent = match self.to.as_mut() {
            Some(to) => emulator_link::send(to, request),
            None => Err(std::io::ErrorKind::BrokenPipe.into()),
        };
        let limit = match request {
            Request::Advance { duration_ns, .. } => {
                self.response_timeout + Duration::from_nanos(*duration_ns) * SLOWEST
            }
            _ => self.response_timeout,
        };
        match sent.and_then(|()| self.response(limit)) {
            Ok(Response::Failed(why)) => Err(LinkError::Refused(why)),
            Ok(Response::Unplugged) => Err(LinkError::Lost {
                name: "the embedded rig's USB port".to_owned(),
                cause: "the board left the bus; plug it in again (`usb-in`) and start anew"
                    .to_owned(),
            }),
            Ok(response) => Ok(response),
            Err(error) => Err(self.lost(&error)),
        }
    }

    /// The next response. A rig that does not respond in time is ended.
    fn response(&mut self, limit: Duration) -> std::io::Result<Response> {
        match self.responses.recv_timeout(limit) {
            Ok(response) => response,
            Err(RecvTimeoutError::Disconnected) => Err(std::io::ErrorKind::UnexpectedEof.into()),
            Err(RecvTimeoutError::Timeout) => {
                let _ = self.child.kill();
                Err(std::io::Error::new(
                    std::io::ErrorKind::TimedOut,
                    format!("no response for {} s; it was ended", limit.as_secs()),
                ))
            }
        }
    }

    /// The error for a rig that ended, with the last lines of its log.
    fn lost(&mut self, error: &std::io::Error) -> LinkError {
        self.to = None;
        let ended = (0..50).find_map(|_| {
            std::thread::sleep(Duration::from_millis(10));
            self.child.try_wait().ok().flatten()
        });
        let mut cause = match ended {
            _ if error.kind() == std::io::ErrorKind::TimedOut => error.to_string(),
            Some(status) => format!("its process ended ({status})"),
            None => format!("its response can't be read ({error})"),
        };
        // The last lines may still be in the pipe.
        for _ in 0..LOG_POLLS {
            if ended.is_none() || self.log_reader.is_finished() {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let lines = self.log.lock().unwrap_or_else(PoisonError::into_inner);
        if !lines.is_empty() {
            cause.push_str("; its last lines:");
            for line in lines.iter() {
                cause.push_str("\n  | ");
                cause.push_str(line);
            }
        }
        LinkError::Lost {
            name: "the embedded rig".to_owned(),
            cause,
        }
    }

    fn expect_done(&mut self, request: &Request) -> Result<(), LinkError> {
        match self.ask(request)? {
            Response::Done => Ok(()),
            other => Err(unexpected(&other)),
        }
    }
}

fn unexpected(response: &Response) -> LinkError {
    let what = match response {
        Response::Ready { .. } => "ready",
        Response::Advanced(_) => "advanced",
        Response::Done => "done",
        Response::Report(_) => "a report",
        Response::Failed(_) => "failed",
        Response::Unplugged => "unplugged",
    };
    LinkError::Refused(format!("it sent the response `{what}` to another request"))
}

impl RigLink for EmbeddedRig {
    fn name(&self) -> String {
        let usb = if self.usb { " by USB" } else { "" };
        format!("embedded rig{usb}, {}, seed {}", self.machine, self.seed)
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let request = Request::Advance {
            duration_ns: u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX),
            to_board: to_board.to_vec(),
        };
        let advanced = match self.ask(&request)? {
            Response::Advanced(advanced) => advanced,
            other => return Err(unexpected(&other)),
        };
        Ok(advanced.into())
    }

    fn booted_here(&self) -> bool {
        true
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        Some(self)
    }
}

impl RigControls for EmbeddedRig {
    fn robot(&mut self, moving: bool) -> Result<(), LinkError> {
        self.expect_done(&Request::Robot { moving })
    }

    fn inject(&mut self, injection: Injection) -> Result<(), LinkError> {
        self.expect_done(&Request::Inject(injection))
    }

    fn report(&mut self) -> Result<Report, LinkError> {
        match self.ask(&Request::Report)? {
            Response::Report(report) => Ok(*report),
            other => Err(unexpected(&other)),
        }
    }

    fn seed(&self) -> u64 {
        self.seed
    }
}

impl Drop for EmbeddedRig {
    fn drop(&mut self) {
        if let Some(to) = self.to.as_mut() {
            // Best effort: closing the pipe ends the rig as well.
            let _ = emulator_link::send(to, &Request::Quit);
        }
        self.to = None;
        for _ in 0..100 {
            if matches!(self.child.try_wait(), Ok(Some(_))) {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_is_no_rig_is_reported_with_its_last_words() {
        let folder = tempfile::tempdir().unwrap();
        // Cargo itself: always there, and it refuses `--elf` on its standard error.
        let programs = Programs {
            rig: PathBuf::from(env!("CARGO")),
            firmware: folder.path().join("none.elf"),
        };
        let error = EmbeddedRig::start(&programs, &EmbeddedOptions::default()).unwrap_err();
        assert!(matches!(error, LinkError::Lost { .. }), "{error}");
        assert!(error.to_string().contains("--elf"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_program_that_never_responds_is_ended() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let rig = folder.path().join("rig");
        std::fs::write(&rig, "#!/bin/sh\nexec sleep 1000\n").unwrap();
        std::fs::set_permissions(&rig, PermissionsExt::from_mode(0o755)).unwrap();
        let programs = Programs {
            firmware: rig.clone(),
            rig,
        };
        let limit = Duration::from_millis(200);
        let error = EmbeddedRig::start_within(&programs, &EmbeddedOptions::default(), limit);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("no response for"), "{error}");
    }

    #[test]
    fn a_missing_program_says_how_to_get_it() {
        let programs = Programs {
            rig: PathBuf::from("/nonexistent/rig"),
            firmware: PathBuf::from("/nonexistent/board"),
        };
        let error = EmbeddedRig::start(&programs, &EmbeddedOptions::default()).unwrap_err();
        assert!(error.to_string().contains("cargo forcectl"), "{error}");
    }
}
