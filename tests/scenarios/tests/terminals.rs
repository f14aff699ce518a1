//! One rig, many terminals: the real `forcectl` in several processes, the real image behind them.

#![cfg(unix)]

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The program, beside the rig that `cargo xtask` built with it.
fn program() -> PathBuf {
    let rig = std::env::var_os("FORCE_RIG_BIN").expect("run through `cargo xtask test`");
    Path::new(&rig).with_file_name("forcectl")
}

/// A folder with the sockets of one test, and the processes in it. One at a time: a rig wants a
/// core, and its clients' time is that of the clock on the wall.
struct Lab {
    folder: TempDir,
    rig: Option<Child>,
    _alone: MutexGuard<'static, ()>,
}

static ALONE: Mutex<()> = Mutex::new(());

impl Lab {
    fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            rig: None,
            _alone: ALONE.lock().unwrap_or_else(PoisonError::into_inner),
        }
    }

    /// With a rig that is kept.
    fn with_rig(seed: u64) -> Self {
        let mut lab = Self::new();
        lab.start_rig(seed);
        lab
    }

    fn command(&self, line: &str) -> Command {
        let mut command = Command::new(program());
        command
            .args(line.split_whitespace())
            .current_dir(self.folder.path())
            .env("FORCECTL_RUNTIME_DIR", self.folder.path().join("run"))
            .env("FORCECTL_STATE_DIR", self.folder.path().join("state"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    fn start_rig(&mut self, seed: u64) {
        let log = std::fs::File::create(self.folder.path().join("rig.log")).unwrap();
        let child = self
            .command(&format!("rig --wait --seed {seed}"))
            .stderr(log)
            .spawn()
            .unwrap();
        self.rig = Some(child);
        self.wait("the rig is served", Duration::from_secs(120), |lab| {
            lab.rig_log().contains("is served")
        });
    }

    fn rig_log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("rig.log")).unwrap_or_default()
    }

    /// The pseudo-terminal of the rig.
    fn terminal(&self) -> String {
        let log = self.rig_log();
        let line = log
            .lines()
            .find(|line| line.starts_with("terminal"))
            .unwrap();
        line.split_whitespace().nth(1).unwrap().to_owned()
    }

    fn start(&self, line: &str) -> Child {
        self.command(line).spawn().unwrap()
    }

    /// Starts a command that drives, and waits until the board does.
    fn drive(&self, line: &str) -> Child {
        let child = self.start(line);
        self.wait_for_state("running");
        child
    }

    fn run(&self, line: &str) -> Output {
        self.command(line).output().unwrap()
    }

    /// Runs a command that has to end with this code, and returns what it printed.
    fn code(&self, line: &str, code: i32) -> (String, String) {
        let output = self.run(line);
        let out = String::from_utf8(output.stdout).unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{line}: {out}{err}");
        (out, err)
    }

    fn status(&self) -> Value {
        // A latched fault has exit code 5 and the same object.
        let out = self.run("status --json").stdout;
        serde_json::from_slice(&out).unwrap_or_default()
    }

    fn wait(&self, what: &str, limit: Duration, done: impl Fn(&Self) -> bool) {
        let until = Instant::now() + limit;
        while !done(self) {
            assert!(Instant::now() < until, "{what}: {}", self.rig_log());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn wait_for_state(&self, state: &str) {
        self.wait(state, Duration::from_secs(60), |lab| {
            lab.status()["state"] == state
        });
    }
}

impl Drop for Lab {
    fn drop(&mut self) {
        if let Some(rig) = &mut self.rig {
            signal(rig, "TERM");
            let _ = rig.wait();
        }
    }
}

/// Waits for the end of a process that has to end with this code; returns what it wrote to standard
/// error.
fn ends_with(child: Child, code: i32) -> String {
    let output = child.wait_with_output().unwrap();
    let err = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{err}");
    err
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill")
        .args(["-s", name, &child.id().to_string()])
        .status();
    assert!(status.unwrap().success());
}

#[test]
fn commands_for_a_rig_that_exists_do_not_start_one() {
    let lab = Lab::new();
    for line in ["stop", "arm", "disarm", "zero", "clear", "inject estop"] {
        let (out, err) = lab.code(line, 4);
        assert!(
            out.is_empty() && err.contains("forcectl rig"),
            "{line}: {err}"
        );
        // Not even where a new one is asked for.
        lab.code(&format!("{line} --link embedded"), 4);
    }
}

#[test]
fn an_observer_watches_and_stops_what_another_terminal_holds() {
    let lab = Lab::with_rig(31);
    let commander = lab.drive("set-force 0 2.5 0 --duration 600");
    let (out, err) = lab.code("monitor --duration 1 --json", 0);
    assert!(err.is_empty(), "{err}");
    let last: Value = serde_json::from_str(out.lines().last().unwrap()).unwrap();
    assert!(last["tension_n"][2].as_f64().unwrap() > 1.0, "{last}");
    let (_, err) = lab.code("set-force 1 0 0", 5);
    assert!(err.contains("forcectl set-force (process"), "{err}");
    lab.code("disarm", 5);
    let (_, err) = lab.code("stop", 0);
    // Behind what is said of a service that takes its time on a busy computer.
    let mut lines = err.lines();
    assert!(
        lines.any(|line| line.starts_with("rig `rig`: embedded rig")),
        "{err}"
    );
    let err = ends_with(commander, 5);
    assert!(err.contains("fault 3"), "{err}");
    assert_eq!(lab.status()["state"], "fault");
    lab.code("clear", 0);
    assert_eq!(lab.status()["state"], "ready");
}

#[test]
fn a_commander_that_is_killed_or_hangs_leaves_no_motor_pulling() {
    let lab = Lab::with_rig(32);
    let mut killed = lab.drive("set-force 0 2.5 0 --duration 600");
    killed.kill().unwrap();
    killed.wait().unwrap();
    lab.wait_for_state("ready");
    // Hangs: its setpoints expire, and the other terminal is not locked out.
    let hung = lab.drive("set-force 0 2.5 0 --duration 600");
    signal(&hung, "STOP");
    lab.wait_for_state("fault");
    assert_eq!(lab.status()["status"]["fault"], 2);
    lab.code("stop", 0);
    signal(&hung, "CONT");
    ends_with(hung, 5);
    lab.code("clear", 0);
}

#[test]
fn arm_stays_armed_and_zeros_survive_what_friction_leaves() {
    let lab = Lab::with_rig(33);
    lab.code("arm", 0);
    assert_eq!(lab.status()["state"], "running");
    // Longer than setpoints are valid, with no client there.
    std::thread::sleep(Duration::from_millis(1500));
    let status = lab.status();
    assert_eq!(status["state"], "running", "{status}");
    lab.code("set-force 0 1 0", 5);
    lab.code("disarm", 0);
    assert_eq!(lab.status()["state"], "ready");
    // Friction holds part of the tension: no time for a zero.
    let (_, err) = lab.code("zero", 5);
    assert!(err.contains("the zeros are refused"), "{err}");
    for _ in 0..2 {
        let (out, _) = lab.code("set-force 0 2.5 0 --duration 3 --json", 0);
        let run: Value = serde_json::from_str(&out).unwrap();
        let metrics = &run["metrics"];
        assert_eq!(metrics["from_truth"], true);
        assert!(
            metrics["tip_force_error_n"].as_f64().unwrap() < 0.1,
            "{metrics}"
        );
    }
    lab.code("hold --tension 2 3 2 3 2 3 --duration 1", 0);
}

#[test]
fn a_program_on_the_pseudo_terminal_commands_like_any_other() {
    let mut lab = Lab::with_rig(34);
    let terminal = lab.terminal();
    // A board reports no pose: this one's tip is clamped where the rig's robot stands.
    let text = rig::DEFAULT_TEXT.replacen(
        "source = \"rig\"",
        "source = \"static\"\nposition_m = [-0.080, 0.025, -0.140]",
        1,
    );
    std::fs::write(lab.folder.path().join("clamped.toml"), text).unwrap();
    // Opened directly: a client of the rig's service as seen from the other side.
    let line = format!("hold --direct --duration 600 --rig clamped.toml --link serial:{terminal}");
    let on_terminal = lab.start(&line);
    // It is a board for that program: it has no zeros of its own, but those that are in force.
    lab.wait_for_state("running");
    let (_, err) = lab.code("set-force 1 0 0", 5);
    assert!(err.contains("the program on"), "{err}");
    lab.code("stop", 0);
    ends_with(on_terminal, 5);
    lab.code("clear", 0);
    // Through a service of its own, started on demand, and killed while it holds.
    let port = format!("--rig clamped.toml --link serial:{terminal}");
    let held = lab.drive(&format!("hold --duration 600 {port}"));
    // The first line of every command names the process of the service.
    let watcher = lab.run(&format!("status {port}"));
    let err = String::from_utf8_lossy(&watcher.stderr).into_owned();
    let service = err
        .split("(service: process ")
        .nth(1)
        .unwrap_or_else(|| panic!("{err}"));
    let service = service.split(')').next().unwrap();
    let killed = Command::new("kill").args(["-s", "KILL", service]).status();
    assert!(killed.unwrap().success());
    lab.wait_for_state("fault");
    assert_eq!(lab.status()["status"]["fault"], 2);
    ends_with(held, 4);
    lab.code("clear", 0);
    // The rig goes away while a program on its line holds, and comes back under the same link.
    let held = lab.drive(&format!("hold --duration 600 {port}"));
    let mut rig = lab.rig.take().unwrap();
    signal(&rig, "KILL");
    rig.wait().unwrap();
    ends_with(held, 4);
    lab.start_rig(34);
    assert_eq!(lab.status()["state"], "ready");
}

#[test]
fn the_python_client_holds_a_force_and_reads_the_tensions() {
    if Command::new("python3").arg("--version").output().is_err() {
        eprintln!("skipped: python3 is not installed");
        return;
    }
    let lab = Lab::with_rig(35);
    let client = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../python");
    let script = "\
import sys
sys.path.insert(0, sys.argv[1])
from forcerig import RigError, connect
rig = connect(client='a test')
rig.subscribe(telemetry=True)
rig.start('set_force', force_n=[0, 2.5, 0], duration_s=3)
largest = max(line['tension_n'][2] or 0 for line in rig.telemetry())
print(largest, rig.result['metrics']['applied_n'][1])
try:
    rig.call('explode')
except RigError as error:
    print(error.code)
rig.stop()
";
    let output = Command::new("python3")
        .arg("-c")
        .arg(script)
        .arg(client)
        .env("FORCECTL_RUNTIME_DIR", lab.folder.path().join("run"))
        .output()
        .unwrap();
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let numbers: Vec<f64> = out
        .split_whitespace()
        .map(|word| word.parse().unwrap())
        .collect();
    assert!(numbers[0] > 3.0 && (numbers[1] - 2.5).abs() < 0.1, "{out}");
    assert_eq!(numbers[2], -32602.0);
    assert_eq!(lab.status()["state"], "fault");
}
