//! `forcectl monitor` on a pseudo-terminal, with a service made of canned lines behind it: how it
//! ends, and that the terminal is given back.

#![cfg(unix)]

mod common;

use common::signals;
use rig::{DEFAULT_NAME, DEFAULT_TEXT};
use rustix::pty::{grantpt, openpt, ptsname, unlockpt, OpenptFlags};
use rustix::termios::{tcgetattr, tcgetwinsize, tcsetwinsize, Winsize};
use serde_json::{json, Value};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixListener;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);

/// A service with one client. It remembers what was called.
fn service(folder: &std::path::Path) -> Arc<Mutex<Vec<String>>> {
    let listener = UnixListener::bind(folder.join("fake.sock")).unwrap();
    let calls: Arc<Mutex<Vec<String>>> = Arc::default();
    let log = Arc::clone(&calls);
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(stream) = stream else { return };
            let log = Arc::clone(&log);
            std::thread::spawn(move || {
                let mut out = stream.try_clone().unwrap();
                for line in BufReader::new(stream).lines().map_while(Result::ok) {
                    let request: Value = serde_json::from_str(&line).unwrap();
                    let method = request["method"].as_str().unwrap().to_owned();
                    log.lock().unwrap().push(method.clone());
                    let result = if method == "hello" {
                        json!({
                            "version": 1, "name": "fake", "link": "a fake link", "pid": 7, "seed": null, "board": null,
                            "rig_file": DEFAULT_NAME, "rig_text": DEFAULT_TEXT, "now_ns": 0, "terminal": null,
                        })
                    } else {
                        json!({})
                    };
                    let answer = json!({"jsonrpc": "2.0", "id": request["id"], "result": result});
                    if !send(&mut out, &answer) {
                        return;
                    }
                    if method == "subscribe" {
                        let mut out = out.try_clone().unwrap();
                        std::thread::spawn(move || telemetry(&mut out));
                    }
                }
            });
        }
    });
    calls
}

/// Sends a line in one write: a value writes itself piece by piece, and two threads write to a
/// client.
fn send(out: &mut impl Write, line: &Value) -> bool {
    out.write_all(format!("{line}\n").as_bytes()).is_ok()
}

/// Telemetry as an older service sends it: without some of the newer keys.
fn telemetry(out: &mut impl Write) {
    for n in 0.. {
        let params = json!({
            "t_s": f64::from(n) * 0.02, "tension_n": [1.5, null, null, null, null, null],
            "setpoint_n": [null, null, null, null, null, null], "state": "running", "tip_m": null, "true_force_n": null,
            "encoder_counts": [4000, null, -17, null, null, null], "adc_code": [123_456, null, null, null, null, null],
        });
        let line = json!({"jsonrpc": "2.0", "method": "telemetry", "params": params});
        if !send(out, &line) {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The monitor on a pseudo-terminal of its own.
struct OnTerminal {
    child: Child,
    terminal: File,
    keyboard: File,
    seen: Arc<Mutex<Vec<u8>>>,
    calls: Arc<Mutex<Vec<String>>>,
    _folder: tempfile::TempDir,
}

impl OnTerminal {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let calls = service(folder.path());
        let keyboard = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&keyboard).unwrap();
        unlockpt(&keyboard).unwrap();
        let path = ptsname(&keyboard, Vec::new()).unwrap();
        let open = || {
            File::options()
                .read(true)
                .write(true)
                .open(path.to_str().unwrap())
        };
        let (terminal, keyboard) = (open().unwrap(), File::from(keyboard));
        let size = Winsize {
            ws_row: 24,
            ws_col: 80,
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        tcsetwinsize(&terminal, size).unwrap();
        assert_eq!(tcgetwinsize(&terminal).unwrap().ws_col, 80);
        let child = Command::new(env!("CARGO_BIN_EXE_forcectl"))
            .args(["monitor", "--link", "rig:fake"])
            .env("FORCECTL_RUNTIME_DIR", folder.path())
            .env("TERM", "xterm-256color")
            .stdin(Stdio::from(terminal.try_clone().unwrap()))
            .stdout(Stdio::from(terminal.try_clone().unwrap()))
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn()
            .unwrap();
        let seen: Arc<Mutex<Vec<u8>>> = Arc::default();
        let (mut screen, into) = (keyboard.try_clone().unwrap(), Arc::clone(&seen));
        std::thread::spawn(move || {
            let mut chunk = [0; 4096];
            while let Ok(length @ 1..) = screen.read(&mut chunk) {
                into.lock().unwrap().extend_from_slice(&chunk[..length]);
            }
        });
        let on = Self {
            child,
            terminal,
            keyboard,
            seen,
            calls,
            _folder: folder,
        };
        // The whole view has been drawn, and keys are not echoed.
        on.wait("the view", |on| on.text().contains("RUNNING"));
        on.wait("raw keys", |on| !on.echoes());
        on
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(&self.seen.lock().unwrap()).into_owned()
    }

    /// Whether the terminal is in the state in which a shell expects it.
    fn echoes(&self) -> bool {
        let modes = tcgetattr(&self.terminal).unwrap().local_modes;
        modes.contains(rustix::termios::LocalModes::ECHO | rustix::termios::LocalModes::ICANON)
    }

    fn wait(&self, what: &str, done: impl Fn(&Self) -> bool) {
        let until = Instant::now() + LIMIT;
        while !done(self) {
            assert!(Instant::now() < until, "{what}: {}", self.text());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn press(&mut self, key: &str) {
        self.keyboard.write_all(key.as_bytes()).unwrap();
    }

    /// It has ended with this code and left the terminal as it was.
    fn ends(mut self, code: i32) {
        let until = Instant::now() + LIMIT;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            if Instant::now() >= until {
                self.child.kill().unwrap();
                panic!("it does not end: {}", self.text());
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        let mut said = String::new();
        let mut err = self.child.stderr.take().unwrap();
        err.read_to_string(&mut said).unwrap();
        assert_eq!(status.code(), Some(code), "{said}");
        assert!(self.echoes(), "the terminal is still raw");
        // Left the second screen, and the cursor is back.
        self.wait("the first screen", |on| {
            let text = on.text();
            text.rfind("\u{1b}[?1049l") > text.rfind("\u{1b}[?1049h")
                && text.rfind("\u{1b}[?25h") > text.rfind("\u{1b}[?25l")
        });
        assert!(!said.contains("Interrupted"), "{said}");
    }
}

#[test]
fn q_ends_the_view_and_the_terminal_is_as_before() {
    let mut on = OnTerminal::start();
    on.wait("the keys", |on| on.text().contains("STOP the rig"));
    // An older service says nothing about zeros: its tension is not called one.
    on.wait("the zeros", |on| on.text().contains("zero not read yet"));
    on.press("q");
    on.ends(0);
}

#[test]
fn s_stops_the_rig_and_the_view_goes_on() {
    let mut on = OnTerminal::start();
    on.press("s");
    on.wait("the stop", |on| {
        on.calls.lock().unwrap().iter().any(|call| call == "stop")
    });
    on.wait("the note", |on| on.text().contains("stopped"));
    on.press("q");
    on.ends(0);
}

#[test]
fn ctrl_c_and_sigterm_give_the_terminal_back() {
    let mut on = OnTerminal::start();
    on.press("\u{3}");
    on.ends(130);
    // Ctrl-C is SIGINT.
    for signal in signals().into_iter().filter(|name| *name != "INT") {
        let on = OnTerminal::start();
        let id = on.child.id().to_string();
        let kill = Command::new("kill").args(["-s", signal, &id]).status();
        assert!(kill.unwrap().success());
        on.ends(130);
    }
}

/// A reel that is turned by hand shows its counts: as lines, and in the JSON.
#[test]
fn counts_and_codes_are_printed() {
    let folder = tempfile::tempdir().unwrap();
    service(folder.path());
    let said = |option: &str| {
        let line = format!("monitor --link rig:fake --duration 0.5 {option}");
        let output = Command::new(env!("CARGO_BIN_EXE_forcectl"))
            .args(line.split_whitespace())
            .env("FORCECTL_RUNTIME_DIR", folder.path())
            .output()
            .unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let lines = said("--counts");
    assert!(
        lines.lines().any(|line| {
            let words: Vec<_> = line.split_whitespace().collect();
            words.windows(3).any(|words| words == ["4000", "-", "-17"])
        }),
        "{lines}"
    );
    let json = said("--json");
    let first: Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    assert_eq!(
        first["encoder_counts"],
        json!([4000, null, -17, null, null, null])
    );
    assert_eq!(first["adc_code"][0], 123_456);
}
