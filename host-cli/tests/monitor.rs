//! `forcectl monitor` on a pseudo-terminal, with a service made of canned lines behind it: how it
//! ends, and that the terminal is given back.

#![cfg(unix)]

mod common;

use common::fake::service;
use common::signals;
use rustix::pty::{grantpt, openpt, ptsname, unlockpt, OpenptFlags};
use rustix::termios::{tcgetattr, tcgetwinsize, tcsetwinsize, Winsize};
use serde_json::{json, Value};
use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);

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

/// The force that a model tells stands beside that of the load cells, with how sure it is.
#[cfg(feature = "estimate")]
#[test]
fn an_estimate_is_shown_while_the_robot_tells_its_state_and_an_alarm_once_it_does_not_fit() {
    use common::logs::{day, joints, Joints};
    use common::{expect, forcectl, words};
    use std::io::{BufRead, BufReader};
    use std::net::UdpSocket;

    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    std::fs::create_dir(folder.join("run")).unwrap();
    service(&folder.join("run"));
    day(&folder.join("day"), 3.0, &[]);
    let train = "estimate train day --model physics --test 3 --out m.model";
    expect(folder, train, 0, &[]);
    let to = UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let robot = format!(
        "[robot]\nkind = \"udp\"\nlisten = \"{to}\"\nname = \"arm\"\n[robot.watch]\nmax_age_s = 2.0\nmax_clock_step_s = 60.0\n"
    );
    std::fs::write(folder.join("robot.toml"), robot).unwrap();
    let line = "monitor --link rig:fake --estimate m.model --robot robot.toml --duration";
    // The model is of another robot.
    expect(folder, &format!("{line} 1"), 2, &["`arm`", "--any-robot"]);
    let line = format!("{line} 600 --any-robot --json");
    let mut child = forcectl(folder, &words(&line)).spawn().unwrap();
    let lines: Arc<Mutex<Vec<Value>>> = Arc::default();
    let (out, into) = (child.stdout.take().unwrap(), Arc::clone(&lines));
    std::thread::spawn(move || {
        for line in BufReader::new(out).lines().map_while(Result::ok) {
            let object = serde_json::from_str(&line).unwrap();
            into.lock().unwrap().push(object);
        }
    });
    let tensions = |line: &&Value| line["tension_n"].is_array();
    let last = || lines.lock().unwrap().iter().rfind(tensions).cloned();
    let until = Instant::now() + LIMIT;
    while last().is_none() {
        assert!(Instant::now() < until, "no line");
        std::thread::sleep(Duration::from_millis(10));
    }
    // Before the first state.
    assert!(last().unwrap()["estimate"].is_null());
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut sent = 0;
    // States at 50 Hz by their stamps, with so much more torque at the elbow, until a line is so.
    let mut states = |more: f64, done: &dyn Fn(&Value) -> bool| {
        let until = Instant::now() + LIMIT;
        while !lines.lock().unwrap().iter().any(done) {
            assert!(Instant::now() < until, "{:?}", lines.lock().unwrap().last());
            let t = f64::from(sent) * 0.02;
            sent += 1;
            let Joints {
                position,
                velocity,
                mut effort,
                ..
            } = joints(t, 3, 3.0);
            effort[1] += more;
            let state = json!({"stamp_s": 1000.0 + t, "measured_js": {
                "name": ["shoulder", "elbow", "insertion"],
                "position": position, "velocity": velocity, "effort": effort,
            }});
            socket.send_to(state.to_string().as_bytes(), to).unwrap();
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    states(0.0, &|line| line["estimate"]["valid"] == true);
    states(20.0, &|line| line["event"] == "misfit");
    states(20.0, &|line| line["estimate"]["misfits"] == true);
    let lines_of = |what: &dyn Fn(&Value) -> bool| -> Vec<Value> {
        let lines = lines.lock().unwrap();
        lines.iter().filter(|line| what(line)).cloned().collect()
    };
    let valid = lines_of(&|line| line["estimate"]["valid"] == true);
    assert!(valid[0]["estimate"]["estimate_y_n"].is_f64());
    assert!(valid[0]["estimate"]["half_width_n"].as_f64() > Some(0.0));
    // What does not fit is not valid.
    let misfit = lines_of(&|line| line["estimate"]["misfits"] == true);
    assert_eq!(misfit[0]["estimate"]["valid"], false);
    let alarm = &lines_of(&|line| line["event"] == "misfit")[0];
    let text = alarm["text"].as_str().unwrap();
    assert!(
        text.contains("this model no longer fits this robot"),
        "{text}"
    );
    // The robot falls silent, and the estimate with it.
    let until = Instant::now() + LIMIT;
    while !last().unwrap()["estimate"].is_null() {
        assert!(Instant::now() < until, "the estimate stays");
        std::thread::sleep(Duration::from_millis(10));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}
