//! `cargo xtask test`: every check there is, one after the other, and one closing line.
//!
//! A failed step doesn't stop the others: one run shows everything that is wrong.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Instant;

use crate::process::{self, Sees};
use crate::report::{elapsed, say, Failure, Result};
use crate::tally::{is_news, Tally};
use crate::toolchain::{setup, Arm, TARGET};
use crate::workspace::Workspace;
use crate::{
    comments, firmware, inspect, links, optional, pypi, python, renode, rig, rust_version,
    side_by_side,
};

/// How a step ended when it didn't fail.
enum Outcome {
    /// Passed, with a remark or none.
    Done(String),
    /// It doesn't apply to this machine; why.
    Skipped(String),
}

/// One check.
struct Step {
    /// What `cargo xtask test NAME` calls it.
    name: &'static str,
    /// What it is about.
    title: &'static str,
    run: fn(&mut Suite) -> Result<Outcome>,
}

/// Cheap checks first; what later steps need before them.
const STEPS: [Step; 19] = [
    Step {
        name: "lock",
        title: "Cargo.lock fits the manifests",
        run: lock,
    },
    Step {
        name: "fmt",
        title: "formatting",
        run: fmt,
    },
    Step {
        name: "links",
        title: "links between the documents",
        run: document_links,
    },
    Step {
        name: "typos",
        title: "spelling",
        run: typos,
    },
    Step {
        name: "rust-version",
        title: "the oldest supported Rust, the same in manifests, texts and scripts",
        run: oldest_rust,
    },
    Step {
        name: "deny",
        title: "dependencies by deny.toml: licences, sources, duplicates",
        run: deny,
    },
    Step {
        name: "host",
        title: "tests of the host crates and of the firmware's pure half",
        run: host,
    },
    Step {
        name: "no-std",
        title: "no_std crates, each alone, for the board",
        run: no_std,
    },
    Step {
        name: "firmware",
        title: "firmware image, and what its machine code can do",
        run: firmware_image,
    },
    Step {
        name: "on-target",
        title: "tests that run on the board: compiled, not run",
        run: on_target,
    },
    Step {
        name: "rig",
        title: "embedded rig and forcectl, built",
        run: rig_programs,
    },
    Step {
        name: "emulated",
        title: "tests of the embedded rig; scenarios with the firmware image",
        run: emulated,
    },
    Step {
        name: "ros1",
        title: "robot on ROS 1: Debian's rosmaster, rostopic and rosbag",
        run: ros1,
    },
    Step {
        name: "ros2",
        title: "robot on ROS 2: another DDS (skips itself without it)",
        run: ros2,
    },
    Step {
        name: "python",
        title: "Python package: installed by pip, its tests, its notebooks",
        run: python,
    },
    Step {
        name: "python-drivers",
        title: "drivers of the converters from PyPI on their model (skips itself without PyPI)",
        run: python_drivers,
    },
    Step {
        name: "clippy",
        title: "lints",
        run: clippy,
    },
    Step {
        name: "doc",
        title: "reference documentation, warnings denied",
        run: doc,
    },
    Step {
        name: "renode",
        title: "the same image on Renode",
        run: renode,
    },
];

/// State that steps share.
struct Suite<'a> {
    workspace: &'a Workspace,
    verbose: bool,
    tally: Tally,
    /// The compiler for the board, once it was needed.
    arm: Option<Result<Arm>>,
    /// Whether the image of this run was built.
    image: Option<Result<()>>,
    /// The step that is running.
    current: &'static str,
}

/// Which steps to run, and how much to print.
#[derive(Debug, Default)]
pub struct Options {
    /// Names of steps; all when empty.
    pub steps: Vec<String>,
    /// Print every line of the tests.
    pub verbose: bool,
}

/// The steps' names and titles, for help.
pub fn catalogue() -> impl Iterator<Item = (&'static str, &'static str)> {
    STEPS.iter().map(|step| (step.name, step.title))
}

/// Runs the steps and prints the closing line. Returns whether all went well.
///
/// # Errors
/// When a step's name is unknown.
pub fn run(workspace: &Workspace, options: &Options) -> Result<bool> {
    for name in &options.steps {
        if !STEPS.iter().any(|step| step.name == name) {
            let names: Vec<_> = catalogue().map(|(name, _)| name).collect();
            return Err(Failure::new(format!("`{name}` is not a step of the tests"))
                .remedy(format!("the steps are {}", names.join(", "))));
        }
    }
    let chosen: Vec<&Step> = STEPS
        .iter()
        .filter(|step| options.steps.is_empty() || options.steps.iter().any(|n| n == step.name))
        .collect();

    let mut suite = Suite {
        workspace,
        verbose: options.verbose,
        tally: Tally::default(),
        arm: None,
        image: None,
        current: "",
    };
    let started = Instant::now();
    let mut failures = Vec::new();
    let mut skipped = Vec::new();
    for (index, step) in chosen.iter().enumerate() {
        let label = format!("[{}/{}] {}", index + 1, chosen.len(), step.name);
        say(format!("{label}: {}", step.title));
        suite.current = step.name;
        let before = suite.tally;
        let step_started = Instant::now();
        let outcome = (step.run)(&mut suite);
        let time = elapsed(step_started.elapsed());
        match outcome {
            Ok(Outcome::Done(words)) if words.is_empty() => say(format!("{label}: ok, {time}")),
            Ok(Outcome::Done(words)) => say(format!("{label}: ok, {words}, {time}")),
            Ok(Outcome::Skipped(reason)) => {
                say(format!("{label}: skipped: {reason}"));
                skipped.push(skipped_line(step.name, &reason));
            }
            Err(failure) => {
                say(format!("{label}: FAILED after {time}: {failure}"));
                // A step that broke without a failing test (a compile error, say) is one failure,
                // so that a red run does not close with "0 failed".
                if suite.tally.failed == before.failed {
                    suite.tally.failed += 1;
                }
                failures.push(format!("{}: {failure}", step.name));
            }
        }
    }

    say(format!("finished in {}", elapsed(started.elapsed())));
    for line in &skipped {
        println!("{line}");
    }
    if suite.tally.ignored > 0 {
        println!("{} tests are switched off", suite.tally.ignored);
    }
    for line in &failures {
        println!("failed: {line}");
    }
    println!("{}", suite.tally);
    Ok(failures.is_empty() && suite.tally.failed == 0)
}

/// The closing remark on a skipped step.
fn skipped_line(step: &str, reason: &str) -> String {
    format!("{step}: {reason}, skipped")
}

impl Suite<'_> {
    fn arm(&mut self) -> Result<Arm> {
        if let Some(known) = &self.arm {
            return known.clone();
        }
        let arm =
            setup::route_from_environment().and_then(|route| setup::ensure(self.workspace, route));
        self.arm = Some(arm.clone());
        arm
    }

    /// Builds the image, once in a run.
    fn image(&mut self) -> Result<()> {
        if let Some(known) = &self.image {
            return known.clone();
        }
        let built = self.arm().and_then(|arm| {
            let image = firmware::build(self.workspace, &arm)?;
            firmware::print_size(self.workspace, &image);
            Ok(())
        });
        self.image = Some(built.clone());
        built
    }

    /// Runs a `cargo test` or pytest, counts its results, shows what is news and keeps everything
    /// in a log.
    fn tests(&mut self, command: &mut Command) -> Result<Outcome> {
        let mut results = Results::of(self)?;
        let ended = results.stream(command);
        self.close(results, ended)
    }

    /// The same for a `cargo test` with many executables, which run side by side.
    fn many_tests(&mut self, mut command: impl FnMut() -> Command) -> Result<Outcome> {
        // Compiling shows its progress; what is then started by cargo only notes itself.
        process::run(command().arg("--no-run"))?;
        let folder = self.workspace.notes().join("executables");
        let mut results = Results::of(self)?;
        let ended = side_by_side::arguments(&folder)
            .and_then(|runner| results.stream(command().args(runner).arg("--quiet")))
            .and_then(|()| {
                side_by_side::run(&folder, |executable, output| {
                    results.take(format!("{executable}:").as_bytes());
                    for part in [&output.stdout, &output.stderr] {
                        part.split(|byte| *byte == b'\n')
                            .for_each(|line| results.take(line));
                    }
                })
            });
        self.close(results, ended)
    }

    fn close(&mut self, results: Results, ended: Result<()>) -> Result<Outcome> {
        let Results { sum, path, .. } = results;
        self.tally += sum;
        ended.map_err(|failure| {
            let path = self.workspace.show(&path);
            Failure::new(format!("{sum}; {failure}; full output in {path}"))
        })?;
        Ok(Outcome::Done(sum.to_string()))
    }

    /// Whether cargo has an optional component, such as clippy.
    fn has(&self, component: &str) -> bool {
        process::capture(process::cargo(Sees::CompilerAndFlags).args([component, "--version"]))
            .is_ok_and(|output| output.status.success())
    }
}

/// What the tests of a step print.
struct Results {
    sum: Tally,
    verbose: bool,
    path: PathBuf,
    log: fs::File,
    state: PathBuf,
}

impl Results {
    fn of(suite: &Suite) -> Result<Self> {
        let folder = suite.workspace.notes();
        let path = folder.join(format!("{}.log", suite.current));
        let log = fs::create_dir_all(&folder)
            .and_then(|()| fs::File::create(&path))
            .map_err(|error| Failure::new(format!("{} can't be made: {error}", path.display())))?;
        // What this user has calibrated is none of the tests' business: they begin with an empty
        // folder.
        let state = folder.join("state");
        let _ = fs::remove_dir_all(&state);
        Ok(Self {
            sum: Tally::default(),
            verbose: suite.verbose,
            path,
            log,
            state,
        })
    }

    /// Takes the lines of a command while it runs.
    fn stream(&mut self, command: &mut Command) -> Result<()> {
        let mut child = command
            .env("FORCECTL_STATE_DIR", &self.state)
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| process::not_started(command, &error))?;
        if let Some(output) = child.stdout.take() {
            for line in BufReader::new(output).split(b'\n') {
                let line = line
                    .map_err(|error| Failure::new(format!("reading the tests' output: {error}")))?;
                self.take(&line);
            }
        }
        let status = child
            .wait()
            .map_err(|error| process::not_started(command, &error))?;
        process::check(command, status)
    }

    /// Bytes, not text: a failing test may print anything.
    fn take(&mut self, line: &[u8]) {
        let text = String::from_utf8_lossy(line);
        let text = text.trim_end();
        if let Some(tally) = Tally::from_line(text) {
            self.sum += tally;
        }
        if self.verbose || is_news(text) {
            println!("{text}");
        }
        // The log is a convenience: a full disk must not look like a failed test.
        let _ = self.log.write_all(&[line, b"\n"].concat());
    }
}

fn ok() -> Result<Outcome> {
    Ok(Outcome::Done(String::new()))
}

/// Switches on what no program has by default. burn's tensors alone take a tenth of the time to
/// compile all tests (368 of 3,239 s); not optimised they take 56 s, and the tests of the networks
/// 68 s more.
const NETWORKS: [&str; 4] = [
    "--features",
    "estimator/networks",
    "--config",
    "profile.dev.package.burn-flex.opt-level=0",
];

/// Leaves out what needs the image, and so a compiler for the board.
const NO_IMAGE: [&str; 4] = ["--exclude", "emulator", "--exclude", "scenarios"];

fn lock(suite: &mut Suite) -> Result<Outcome> {
    if firmware::lock_is_current(suite.workspace) {
        return ok();
    }
    Err(Failure::new("`cargo tree --locked` refuses Cargo.lock")
        .remedy("run `cargo check`, then commit Cargo.lock"))
}

fn fmt(suite: &mut Suite) -> Result<Outcome> {
    if !suite.has("fmt") {
        return Ok(Outcome::Skipped(
            "not installed (rustup component add rustfmt)".into(),
        ));
    }
    let mut command = process::cargo(Sees::CompilerAndFlags);
    command
        .current_dir(suite.workspace.root())
        // Names of files only: a whole diff would bury the rest of the report.
        .args(["fmt", "--all", "--", "--check", "-l"]);
    process::run(&mut command).map_err(|_| {
        Failure::new("the files listed above aren't formatted").remedy("run `cargo fmt --all`")
    })?;
    comments::check(suite.workspace)?;
    ok()
}

fn document_links(suite: &mut Suite) -> Result<Outcome> {
    let count = links::check(suite.workspace)?;
    Ok(Outcome::Done(format!("{count} links")))
}

fn typos(suite: &mut Suite) -> Result<Outcome> {
    by_tool(suite, &optional::TYPOS)
}

fn oldest_rust(suite: &mut Suite) -> Result<Outcome> {
    rust_version::check(suite.workspace).map(Outcome::Done)
}

fn deny(suite: &mut Suite) -> Result<Outcome> {
    by_tool(suite, &optional::DENY)
}

fn by_tool(suite: &Suite, tool: &optional::Tool) -> Result<Outcome> {
    if optional::run(suite.workspace, tool)? {
        ok()
    } else {
        Ok(Outcome::Skipped(format!(
            "not installed ({})",
            tool.install
        )))
    }
}

fn host(suite: &mut Suite) -> Result<Outcome> {
    let workspace = suite.workspace;
    suite.many_tests(|| {
        let mut command = rig::cargo(workspace, "test");
        command.arg("--no-fail-fast").args(NO_IMAGE).args(NETWORKS);
        command
    })
}

fn no_std(suite: &mut Suite) -> Result<Outcome> {
    let arm = suite.arm()?;
    // One call each: together, one crate's features could hide what another lacks. `build` in the
    // firmware's profile rather than `check`, for it shares the compiled `core` with the image.
    for package in ["control", "drivers", "wire"] {
        process::run(firmware::cargo(suite.workspace, &arm, "build").args([
            "--package",
            package,
            "--no-default-features",
        ]))?;
    }
    ok()
}

fn firmware_image(suite: &mut Suite) -> Result<Outcome> {
    suite.image()?;
    inspect::run(suite.workspace)?;
    ok()
}

fn on_target(suite: &mut Suite) -> Result<Outcome> {
    let arm = suite.arm()?;
    let mut command = firmware::cargo(suite.workspace, &arm, "test");
    command.args(["--package", "on-target", "--test", "board", "--no-run"]);
    if let Arm::Debian { .. } = arm {
        // Tests of a crate with `panic = "abort"` would otherwise want a `core` of their own.
        command.args(["-Z", "panic-abort-tests"]);
    }
    process::run(&mut command)?;
    ok()
}

fn rig_programs(suite: &mut Suite) -> Result<Outcome> {
    rig::build(suite.workspace, &["rig", "forcectl"])?;
    ok()
}

fn emulated(suite: &mut Suite) -> Result<Outcome> {
    // Without a fresh image the scenarios would test an old one, or nothing.
    suite.image()?;
    let workspace = suite.workspace;
    rig::build(workspace, &["rig", "forcectl"])?;
    let stack = inspect::stack_bound(workspace)?.to_string();
    suite.many_tests(|| {
        let mut command = rig::cargo_for(workspace, "test");
        command
            .arg("--no-fail-fast")
            .args(rig::EMULATED)
            .env(rig::ELF_VARIABLE, workspace.firmware_elf())
            .env(rig::RIG_VARIABLE, workspace.program("rig"))
            .env(rig::STACK_VARIABLE, &stack);
        command
    })
}

fn ros1(suite: &mut Suite) -> Result<Outcome> {
    const TOOLS: [&str; 3] = ["rosmaster", "rostopic", "rosbag"];
    if let Some(missing) = (TOOLS.iter()).find(|tool| process::find_program(tool).is_none()) {
        return Ok(Outcome::Skipped(format!(
            "{missing} is not installed (Debian: python3-rosmaster, python3-rostopic, python3-rosbag, python3-rospy, python3-sensor-msgs)"
        )));
    }
    robot_on_ros(suite, rig::ROS[0], "ros1")
}

fn ros2(suite: &mut Suite) -> Result<Outcome> {
    let python = std::env::var("ROS2_TEST_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has_dds = process::command(&python, Sees::CompilerAndFlags)
        .args(["-c", "import cyclonedds"])
        .stderr(Stdio::null())
        .status();
    if !has_dds.is_ok_and(|status| status.success()) {
        return Ok(Outcome::Skipped(format!(
            "{python} has no cyclonedds (pip install cyclonedds; ROS2_TEST_PYTHON names another Python)"
        )));
    }
    robot_on_ros(suite, rig::ROS[1], "ros2")
}

/// The selection of `host`, so that robot-ros, experiment and forcectl alone compile again.
fn robot_on_ros(suite: &mut Suite, features: &str, test: &str) -> Result<Outcome> {
    let mut command = rig::cargo(suite.workspace, "test");
    command
        .args(NO_IMAGE)
        .args(NETWORKS)
        .args(["--features", features, "--test", test]);
    suite.tests(&mut command)
}

fn python(suite: &mut Suite) -> Result<Outcome> {
    let workspace = suite.workspace;
    // They compare with the command, and one of them holds a force of the emulated rig.
    suite.image()?;
    rig::build(workspace, &["rig", "forcectl"])?;
    let python = match python::environment(workspace)? {
        python::Environment::Ready(python) => python,
        python::Environment::Missing(what) => return Ok(Outcome::Skipped(what)),
    };
    let mut command = python::tests(workspace, &python);
    command
        .env(rig::ELF_VARIABLE, workspace.firmware_elf())
        .env(rig::RIG_VARIABLE, workspace.program("rig"));
    suite.tests(&mut command)
}

fn python_drivers(suite: &mut Suite) -> Result<Outcome> {
    let requirements =
        (suite.workspace.root()).join("emulator/core-sim/tests/python/requirements.txt");
    // Without a word and without patience: no network is no failure here.
    let pip = ["-qqq", "--retries", "1", "--timeout", "15"];
    let name = "python-drivers";
    let python = match pypi::environment(suite.workspace, name, &requirements, &pip) {
        Ok(python) => python,
        Err(failure) => {
            let what = failure.to_string();
            return Ok(Outcome::Skipped(
                what.lines().next().unwrap_or_default().into(),
            ));
        }
    };
    // The selection of `host`, which has compiled the test.
    let mut command = rig::cargo(suite.workspace, "test");
    command
        .args(NO_IMAGE)
        .args(NETWORKS)
        .args(["--test", "python_drivers"])
        .env("CHIP_TEST_PYTHON", python);
    suite.tests(&mut command)
}

fn clippy(suite: &mut Suite) -> Result<Outcome> {
    if !suite.has("clippy") {
        return Ok(Outcome::Skipped(
            "not installed (rustup component add clippy)".into(),
        ));
    }
    const DENY: [&str; 3] = ["--", "-D", "warnings"];
    // All parts, even when one has findings.
    let mut failures = Vec::new();
    let mut attempt = |command: &mut Command| {
        if let Err(failure) = process::run(command) {
            failures.push(failure.to_string());
        }
    };
    attempt(
        rig::cargo(suite.workspace, "clippy")
            .arg("--all-targets")
            .args(NETWORKS)
            .args(DENY),
    );
    // The first build of a new user, with code that no other build has.
    attempt(
        rig::cargo_for(suite.workspace, "clippy")
            .args(rig::LIGHT_BUILD)
            .args(DENY),
    );
    // Debian's packages bring no clippy for their compiler.
    let mut words = String::new();
    match suite.arm() {
        Ok(arm @ Arm::Host { .. }) => attempt(
            firmware::cargo(suite.workspace, &arm, "clippy")
                .args(["--package", "board", "--bins"])
                .args(DENY),
        ),
        _ => words = format!("without the code that exists on {TARGET} only"),
    }
    if failures.is_empty() {
        Ok(Outcome::Done(words))
    } else {
        Err(Failure::new(failures.join("; ")))
    }
}

fn doc(suite: &mut Suite) -> Result<Outcome> {
    let mut command = rig::cargo(suite.workspace, "doc");
    command
        .arg("--no-deps")
        .args(NO_IMAGE)
        .args(NETWORKS)
        .env("RUSTDOCFLAGS", "-D warnings");
    process::run(&mut command)?;
    ok()
}

fn renode(suite: &mut Suite) -> Result<Outcome> {
    let Some(found) = renode::find(suite.workspace) else {
        return Ok(Outcome::Skipped("not installed".into()));
    };
    suite.image()?;
    let tally = renode::run(suite.workspace, &found, &[])?;
    suite.tally += tally;
    if tally.failed > 0 {
        return Err(Failure::new(format!(
            "{tally}; logs in {}",
            suite
                .workspace
                .show(&suite.workspace.target().join("renode-test"))
        )));
    }
    Ok(Outcome::Done(tally.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_have_names_of_their_own() {
        let names: std::collections::HashSet<_> = catalogue().map(|(name, _)| name).collect();
        assert_eq!(names.len(), STEPS.len());
    }

    #[test]
    fn unknown_steps_are_refused_before_anything_runs() {
        let options = Options {
            steps: vec!["renod".into()],
            verbose: false,
        };
        let error = run(&Workspace::locate(), &options).unwrap_err().to_string();
        assert!(error.contains("renod") && error.contains("renode"));
    }

    #[test]
    fn a_skipped_step_says_so_in_one_line() {
        assert_eq!(
            skipped_line("renode", "not installed"),
            "renode: not installed, skipped"
        );
    }
}
