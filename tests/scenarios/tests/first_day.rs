//! The tutorial docs/first-day.md: every command of the page, in its order, with the real image.
//! The commands are read from the page.

#![cfg(unix)]

#[path = "../../../host-cli/tests/common/page.rs"]
mod page;

use page::{steps, Step};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Time without a word of a command.
const LIMIT: Duration = Duration::from_secs(900);

fn text() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/first-day.md");
    std::fs::read_to_string(path).expect("the page is there")
}

/// The folder of one day, and what still runs there.
struct Day {
    folder: tempfile::TempDir,
    going_on: Vec<(Step, Child, PathBuf)>,
    logs: usize,
}

impl Day {
    fn forcectl(&self) -> Command {
        let rig = std::env::var_os("FORCE_RIG_BIN").expect("run through `cargo xtask test`");
        let mut command = Command::new(PathBuf::from(rig).with_file_name("forcectl"));
        command
            .current_dir(self.folder.path())
            .env("FORCECTL_RUNTIME_DIR", self.folder.path().join("run"))
            .env("FORCECTL_STATE_DIR", self.folder.path().join("state"))
            .stdin(Stdio::null());
        command
    }

    /// Starts a command; its output goes to files.
    fn start(&mut self, step: &Step) -> (Child, PathBuf) {
        self.logs += 1;
        let log = self.folder.path().join(format!("log-{}", self.logs));
        let file = std::fs::File::create(&log).unwrap();
        let out = match &step.into {
            Some(name) => std::fs::File::create(self.folder.path().join(name)).unwrap(),
            None => file.try_clone().unwrap(),
        };
        let child = self
            .forcectl()
            .args(&step.words)
            .stdout(out)
            .stderr(file)
            .spawn()
            .unwrap();
        (child, log)
    }

    fn state(&self) -> String {
        let output = self.forcectl().args(["status", "--json"]).output().unwrap();
        let status: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        status["state"].as_str().unwrap_or_default().to_owned()
    }

    fn wait(&self, what: &str, log: &Path, mut done: impl FnMut(&Self, &str) -> bool) {
        let mut until = Instant::now() + LIMIT;
        let mut seen = 0;
        loop {
            let text = std::fs::read_to_string(log).unwrap_or_default();
            if done(self, &text) {
                return;
            }
            // A command that still reports its progress is slow, not stuck.
            if text.len() != seen {
                seen = text.len();
                until = Instant::now() + LIMIT;
            }
            assert!(Instant::now() < until, "{what}: {text}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    fn ends(&self, step: &Step, child: &mut Child, log: &Path) {
        let mut status = None;
        self.wait("ends", log, |_, _| {
            status = child.try_wait().unwrap();
            status.is_some()
        });
        let code = status.and_then(|status| status.code());
        let text = std::fs::read_to_string(log).unwrap_or_default();
        assert!(
            code.is_some_and(|code| step.codes.contains(&code)),
            "forcectl {}: code {code:?}, not {:?}: {text}",
            step.words.join(" "),
            step.codes
        );
        eprintln!("forcectl {}: code {code:?}", step.words.join(" "));
    }

    fn run(&mut self, step: &Step) {
        let (mut child, log) = self.start(step);
        if step.until_ctrl_c {
            let begun = match step.words[0].as_str() {
                "rig" => "is served",
                _ => "unit 6",
            };
            self.wait(begun, &log, |_, text| text.contains(begun));
            self.going_on.push((step.clone(), child, log));
        } else if step.goes_on {
            self.wait("running", &log, |day, _| {
                assert!(child.try_wait().unwrap().is_none(), "it has ended");
                day.state() == "running"
            });
            self.going_on.push((step.clone(), child, log));
        } else {
            self.ends(step, &mut child, &log);
        }
    }

    /// A run that went on ends by what was done since.
    fn settle(&mut self) {
        let (ending, staying): (Vec<_>, Vec<_>) = std::mem::take(&mut self.going_on)
            .into_iter()
            .partition(|(step, ..)| step.goes_on);
        self.going_on = staying;
        for (step, mut child, log) in ending {
            self.ends(&step, &mut child, &log);
        }
    }
}

impl Drop for Day {
    fn drop(&mut self) {
        for (_, child, _) in &mut self.going_on {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

#[test]
fn every_command_of_the_first_day_does_what_the_page_says() {
    let mut day = Day {
        folder: tempfile::tempdir().unwrap(),
        going_on: Vec::new(),
        logs: 0,
    };
    for step in steps(&text()) {
        day.run(&step);
        // The command after one that goes on is what ends it.
        if !step.goes_on && !step.until_ctrl_c {
            day.settle();
        }
    }
    // The files that the page names are there.
    for word in text().split('`') {
        let file = day.folder.path().join(word);
        if word.starts_with("first-day") && !word.contains(char::is_whitespace) {
            assert!(file.exists(), "{word}");
        }
    }
    let plot = day.folder.path().join("monitor.svg");
    assert!(std::fs::read_to_string(plot).unwrap().contains("STOP"));
    // Ctrl-C: the view first, then the rig.
    while let Some((step, mut child, log)) = day.going_on.pop() {
        let kill = Command::new("kill")
            .args(["-s", "INT", &child.id().to_string()])
            .status();
        assert!(kill.unwrap().success());
        day.ends(&step, &mut child, &log);
    }
}

#[test]
fn the_page_is_read_as_it_is_meant() {
    let steps = steps(&text());
    let of = |name: &str| steps.iter().filter(|step| step.words[0] == name).count();
    assert!(steps.len() >= 20, "{}", steps.len());
    for name in [
        "rig",
        "monitor",
        "zero",
        "hold",
        "set-force",
        "stop",
        "clear",
        "inject",
        "identify",
        "explain",
        "check",
    ] {
        assert!(of(name) > 0, "the page never calls {name}");
    }
    assert_eq!(steps.iter().filter(|step| step.goes_on).count(), 2);
    assert_eq!(steps.iter().filter(|step| step.until_ctrl_c).count(), 2);
    assert_eq!(steps.iter().filter(|step| step.codes == [5]).count(), 3);
    assert_eq!(steps.last().unwrap().words, ["check", "my-rig.toml"]);
}
