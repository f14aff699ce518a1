//! Starting a Renode, or waiting for one, and asking it.

use crate::{text, Arguments};
use emulator_link::{Report, Request, Response};
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How long Renode may take to start and to compile the models.
const START_WITHIN: Duration = Duration::from_secs(300);

/// A Renode that this program moves.
pub struct Machine {
    child: Option<Child>,
    from: BufReader<TcpStream>,
    to: TcpStream,
    seed: u64,
    started: Instant,
}

impl Machine {
    /// Starts Renode with the image, or waits for one that runs.
    ///
    /// # Errors
    /// What is missing or went wrong, and what to do.
    pub fn start(arguments: &Arguments) -> Result<Self, String> {
        let attach = match std::env::var("FORCE_RENODE_ATTACH") {
            Ok(text) => Some(
                text.parse::<u16>()
                    .map_err(|_| format!("FORCE_RENODE_ATTACH={text}: not a port"))?,
            ),
            Err(_) => None,
        };
        let listener = TcpListener::bind(("127.0.0.1", attach.unwrap_or(0)))
            .map_err(|e| format!("no port to listen at: {e}"))?;
        listener
            .set_nonblocking(true)
            .map_err(|e| format!("the port can't be watched: {e}"))?;
        let mut child = match attach {
            Some(_) => None,
            None => {
                let port = listener
                    .local_addr()
                    .map_err(|e| format!("the port has no number: {e}"))?
                    .port();
                Some(spawn(arguments, port)?)
            }
        };
        let stream = accept(&listener, child.as_mut())?;
        let clone = stream
            .try_clone()
            .map_err(|e| format!("Renode's connection can't be shared: {e}"))?;
        let mut machine = Self {
            child,
            from: BufReader::new(clone),
            to: stream,
            seed: arguments.seed,
            started: Instant::now(),
        };
        let hello = machine.line()?;
        machine.seed = hello
            .strip_prefix("ready ")
            .and_then(|s| s.trim().parse().ok())
            .ok_or_else(|| format!("who connects is no RigServer: `{}`", hello.trim()))?;
        if arguments.usb {
            writeln!(machine.to, "usb").map_err(|e| format!("Renode is gone: {e}"))?;
            let answer = machine.line()?;
            if answer.trim() != "done" {
                return Err(format!("Renode has no USB: `{}`", answer.trim()));
            }
        }
        Ok(machine)
    }

    /// Seed of this run.
    pub const fn seed(&self) -> u64 {
        self.seed
    }

    /// What this machine is called.
    pub fn name(&self) -> String {
        "STM32H753 in Renode".to_owned()
    }

    /// Passes a request on.
    ///
    /// # Errors
    /// The connection is gone, or the answer is none.
    pub fn ask(&mut self, request: &Request) -> Result<Response, String> {
        let line = text::request(request).ok_or("this request is not for the machine")?;
        writeln!(self.to, "{line}").map_err(|e| format!("Renode is gone: {e}"))?;
        let answer = self.line()?;
        let mut response = text::response(&answer)?;
        if let Response::Report(report) = &mut response {
            let wall = u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX);
            **report = Report {
                wall_ns: wall,
                ..std::mem::take(&mut **report)
            };
        }
        Ok(response)
    }

    fn line(&mut self) -> Result<String, String> {
        let mut line = String::new();
        match self.from.read_line(&mut line) {
            Ok(0) => Err("Renode closed the connection".to_owned()),
            Ok(_) => Ok(line),
            Err(e) => Err(format!("Renode's answer can't be read: {e}")),
        }
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        // A Renode that was only attached to stays. One of our own ends itself when the connection
        // does: its starter is a shell script, and killing that would leave Renode behind.
        let _ = writeln!(self.to, "quit");
        let _ = self.to.shutdown(Shutdown::Both);
        if let Some(child) = &mut self.child {
            for _ in 0..200 {
                if matches!(child.try_wait(), Ok(Some(_))) {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn spawn(arguments: &Arguments, port: u16) -> Result<Child, String> {
    let renode = std::env::var_os("RENODE").unwrap_or_else(|| OsString::from("renode"));
    let folder = match std::env::var_os("FORCE_RENODE_DIR") {
        Some(folder) => PathBuf::from(folder),
        None => Path::new(env!("CARGO_MANIFEST_DIR"))
            .parent()
            .map_or_else(PathBuf::new, Path::to_path_buf),
    };
    let board = existing(
        &folder.join("board.resc"),
        "FORCE_RENODE_DIR names the project's folder `renode`",
    )?;
    let library = match std::env::var_os("FORCE_PLANT_LIBRARY") {
        Some(path) => PathBuf::from(path),
        None => std::env::current_exe()
            .map_err(|e| format!("this program doesn't know where it is: {e}"))?
            .with_file_name(library_name()),
    };
    let library = existing(
        &library,
        "build it with `cargo build -p plant-abi`, or name it in FORCE_PLANT_LIBRARY",
    )?;
    let elf = existing(&arguments.elf, "`cargo xtask build` makes it")?;
    let mut script = format!("$bin=@{elf}; $plant=@{library}; $seed={}; ", arguments.seed);
    if let Some(plant) = &arguments.plant {
        let plant = existing(plant, "name a plant configuration in TOML")?;
        script.push_str(&format!("$config=\"{plant}\"; "));
    }
    script.push_str(&format!("include @{board}; server Connect {port} true"));
    Command::new(&renode)
        .args(["--disable-xwt", "--console", "--plain", "-e", &script])
        // Kept open with the child: at its end the monitor's console would quit.
        .stdin(Stdio::piped())
        // Standard output is the link's.
        .stdout(Stdio::from(std::io::stderr()))
        .spawn()
        .map_err(|e| {
            format!(
                "{} can't be started ({e}); install Renode 1.16 (docs/renode.md) or name it in RENODE",
                renode.to_string_lossy()
            )
        })
}

/// The name that the system gives a library.
const fn library_name() -> &'static str {
    if cfg!(target_os = "macos") {
        "libplant_abi.dylib"
    } else if cfg!(windows) {
        "plant_abi.dll"
    } else {
        "libplant_abi.so"
    }
}

/// An absolute path as the monitor takes it: blanks are written with a backslash.
fn existing(path: &Path, hint: &str) -> Result<String, String> {
    let absolute = path
        .canonicalize()
        .map_err(|e| format!("{}: {e}; {hint}", path.display()))?;
    Ok(absolute.to_string_lossy().replace(' ', "\\ "))
}

fn accept(listener: &TcpListener, mut child: Option<&mut Child>) -> Result<TcpStream, String> {
    let began = Instant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream
                    .set_nonblocking(false)
                    .and_then(|()| stream.set_nodelay(true))
                    .map_err(|e| format!("Renode's connection can't be set up: {e}"))?;
                return Ok(stream);
            }
            Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(e) => return Err(format!("the port can't be watched: {e}")),
        }
        if let Some(child) = child.as_deref_mut() {
            if let Ok(Some(status)) = child.try_wait() {
                return Err(format!(
                    "Renode ended ({status}) before the board was up; its log states the reason"
                ));
            }
        }
        if began.elapsed() > START_WITHIN {
            if let Some(child) = child {
                let _ = child.kill();
            }
            return Err(format!(
                "no Renode connected within {} s",
                START_WITHIN.as_secs()
            ));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
