//! Mutants of the firmware's supervision: each one a detection switched off, a limit doubled or a
//! check ignored. A campaign that finds nothing proves something only if it finds these.
//!
//! The sources that the campaign is built from are copied into `target/mutants`, changed there,
//! built and run. The checkout is not touched.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::process::{self, Sees};
use crate::report::{say, Failure, Result};
use crate::tested_mutants::TESTED;
use crate::workspace::Workspace;

/// A change of one place in one file.
pub(crate) struct Mutant {
    pub(crate) name: &'static str,
    pub(crate) file: &'static str,
    pub(crate) from: &'static str,
    pub(crate) to: &'static str,
}

impl Mutant {
    /// Changes the copy in `folder`, acts, and restores the copy.
    ///
    /// # Errors
    /// Where the place is not found once, or the file can't be written.
    pub(crate) fn applied<T>(&self, folder: &Path, act: impl FnOnce() -> Result<T>) -> Result<T> {
        let path = folder.join(self.file);
        let original = read(&path)?;
        if original.matches(self.from).count() != 1 {
            return Err(Failure::new(format!(
                "mutant {}: `{}` is not once in {}",
                self.name, self.from, self.file
            )));
        }
        write(&path, &original.replacen(self.from, self.to, 1))?;
        let outcome = act();
        write(&path, &original)?;
        outcome
    }
}

macro_rules! mutants {
    ($list:ident: $($name:literal: $file:literal, $from:literal => $to:literal;)*) => {
        pub(crate) const $list: &[Mutant] = &[$(Mutant { name: $name, file: $file, from: $from, to: $to },)*];
    };
}
pub(crate) use mutants;

mutants! { MUTANTS:
    "over-tension-off": "control/src/unit.rs", "self.over >= TRIP_SAMPLES" => "self.over == u8::MAX";
    "saturation-off": "control/src/unit.rs", "self.saturated >= TRIP_SAMPLES" => "self.saturated == u8::MAX";
    "authority-ignored": "control/src/unit.rs", "most.saturating_add(config.authority)" => "most.saturating_add(config.force_limit)";
    "frozen-off": "control/src/plausible.rs", "pub const FROZEN_SAMPLES: u8 = 8;" => "pub const FROZEN_SAMPLES: u8 = 255;";
    "negative-limit-times-ten": "control/src/plausible.rs", "Newton::from_un(-1_000_000)" => "Newton::from_un(-10_000_000)";
    "command-at-limit-off": "control/src/plausible.rs", "pub const LIMIT_SAMPLES: u8 = 64;" => "pub const LIMIT_SAMPLES: u8 = 255;";
    "impulse-limit-times-eight": "control/src/plausible.rs", "Newton::from_un(50_000_000)" => "Newton::from_un(400_000_000)";
    "sliding-off": "control/src/plausible.rs", "mean_nm.abs() < SLIDING_NM" => "mean_nm.abs() < i32::MAX";
    "surge-off": "control/src/plausible.rs", "(surged && (" => "(surged && false && (";
    "let-go-off": "control/src/let_go.rs", "waited > LET_GO_US && waited < u32::MAX / 2" => "waited > LET_GO_US && waited < 0";
    "doubt-ignored": "control/src/let_go.rs", "self.doubted = true;" => "self.doubted = false;";
    "reel-at-zero-off": "control/src/let_go.rs", "speed_nm - self.slowest_nm > DRIVEN_NM" => "speed_nm - self.slowest_nm > i32::MAX - 1";
    "tip-limit-doubled": "control/src/tip.rs", "self.over = if size > self.limit_n" => "self.over = if size > 2.0 * self.limit_n";
    "sensor-silent-off": "control/src/supervisor.rs", "silent_us: 12_500" => "silent_us: 12_500_000";
    "sensor-fast-off": "control/src/supervisor.rs", "min_us: 2_900" => "min_us: 290";
    "sensor-slow-off": "control/src/supervisor.rs", "max_us: 3_370" => "max_us: 33_700";
    "expiry-ignored": "control/src/supervisor.rs", ".is_some_and(|(at, valid_us)| now.since(at) > valid_us)" => ".is_some_and(|(at, _)| now.since(at) > 2_000_000_000)";
    "encoder-watch-off": "control/src/friction.rs", "pub const STILL_SWING: Newton = Newton::from_un(6_000_000);" => "pub const STILL_SWING: Newton = Newton::from_un(60_000_000);";
    "encoder-noise-off": "board/src/machine/supervision.rs", "const ENCODER_NOISE_EVENTS: u8 = 5;" => "const ENCODER_NOISE_EVENTS: u8 = 255;";
    "e-stop-ignored": "board/src/machine/supervision.rs", "if !self.estop_closed {" => "if false {";
    "loop-overrun-doubled": "board/src/machine/mod.rs", "pub const MAX_PASS_US: u32 = 1_500;" => "pub const MAX_PASS_US: u32 = 3_000;";
    "queue-overflow-ignored": "board/src/machine/supervision.rs", "if health.events_lost != self.events_lost {" => "if false {";
    "dac-link-ignored": "board/src/machine/supervision.rs", "if let Some(status) = health.dac_error {" => "if let Some(status) = health.dac_error.filter(|_| false) {";
    "register-change-ignored": "board/src/machine/supervision.rs", "if let Some(address) = health.register_changed {" => "if let Some(address) = health.register_changed.filter(|_| false) {";
    "failed-reads-ignored": "board/src/machine/mod.rs", "pub const MAX_FAILED_READS: u8 = 4;" => "pub const MAX_FAILED_READS: u8 = 255;";
    "alive-never-withheld": "board/src/machine/mod.rs", "!self.released || self.has_lost_power()" => "false";
    "stop-refused-elsewhere": "board/src/machine/commands.rs", "            Command::Stop => {" => "            Command::Stop if self.commander.is_some_and(|(commander, _)| commander == link) => {";
    "takeover-while-driving": "board/src/machine/commands.rs", "now.since(last) > COMMANDER_SILENT_US" => "now.since(last) < u32::MAX / 2";
    "setpoint-range-ignored": "control/src/unit.rs", "if !(0..=most_un).contains(&wire.tension_un) {" => "if wire.tension_un == i32::MIN {";
    "memory-check-off": "control/src/config.rs", "Self::from_wire(&self.wire).is_ok_and(|fresh| fresh == *self)" => "Self::from_wire(&self.wire).is_ok()";
    "seal-ignored": "control/src/config.rs", "self.seal == self.sum()" => "self.seal != self.sum() || self.seal != 0";
    "frame-crc-off": "wire/src/frame.rs", "if crc32(payload) != u32::from_le_bytes(*crc) {" => "if crc32(payload) == 0 && *crc == [1; 4] {";
    "crash-record-not-latched": "board/src/machine/mod.rs", "latch.latch(fault, record.detail);" => "let _ = (fault, record.detail);";
}

/// What the campaign is built from, besides the workspace's own files.
const PARTS: [&str; 15] = [
    "board",
    "control",
    "drivers",
    "wire",
    "emulator",
    "emulator/core-sim",
    "emulator/link",
    "emulator/plant",
    "emulator/usb",
    "common/files",
    "common/random",
    "common/scene",
    "robot",
    "evaluations/evaluation",
    "evaluations/faults",
];

/// Cases of the campaign that every mutant faces.
const CASES: &str = "300";

/// Builds and runs every mutant, or those named. `true`: all were killed.
///
/// # Errors
/// A name is unknown, a mutant's place is not found once, or the unchanged sources fail.
pub fn run(workspace: &Workspace, names: &[String]) -> Result<bool> {
    let all = MUTANTS.iter().map(|mutant| (mutant, campaign as Judge));
    let all = all.chain(TESTED.iter().map(|mutant| (mutant, tests as Judge)));
    let all: Vec<(&Mutant, Judge)> = all.collect();
    let chosen = choose(all.iter().collect(), |(mutant, _)| mutant.name, names)?;
    let target = workspace.target();
    let copy = Workspace::of_copy(target.join("mutants"), target.join("mutants-build"));
    copy_workspace(workspace, copy.root())?;
    say("mutants: the unchanged sources first");
    for judge in [campaign as Judge, tests] {
        if let Verdict::Wrong(why) = judge(&copy)? {
            return Err(Failure::new(format!("without a mutant: {why}")));
        }
    }
    println!("| mutant | killed by |\n| --- | --- |");
    let mut survived = 0;
    for (mutant, judge) in &chosen {
        let verdict = mutant.applied(copy.root(), || judge(&copy));
        match verdict? {
            Verdict::Wrong(why) => println!("| {} | {why} |", mutant.name),
            Verdict::Fine => {
                survived += 1;
                println!("| {} | SURVIVED |", mutant.name);
            }
        }
    }
    println!("{} mutants, {survived} survived", chosen.len());
    Ok(survived == 0)
}

/// Those that are named; all where no name is given.
///
/// # Errors
/// A name that none of them has.
pub(crate) fn choose<'a, T>(
    mut all: Vec<&'a T>,
    name: fn(&T) -> &str,
    names: &[String],
) -> Result<Vec<&'a T>> {
    let known: Vec<&str> = all.iter().map(|one| name(one)).collect();
    if let Some(unknown) = names.iter().find(|name| !known.contains(&name.as_str())) {
        return Err(Failure::new(format!("`{unknown}` is not a mutant"))
            .remedy(format!("the mutants are {}", known.join(", "))));
    }
    all.retain(|one| names.is_empty() || names.iter().any(|given| given == name(one)));
    Ok(all)
}

/// What finds a mutant or does not.
type Judge = fn(&Workspace) -> Result<Verdict>;

enum Verdict {
    Fine,
    Wrong(String),
}

/// Builds the campaign in the copy and runs its check.
fn campaign(copy: &Workspace) -> Result<Verdict> {
    let mut build = process::cargo(Sees::CompilerAndFlags);
    build
        .current_dir(copy.root())
        .args(["build", "--quiet", "--package", "faults", "--target-dir"])
        .arg(copy.target())
        .stderr(Stdio::null());
    if process::run(&mut build).is_err() {
        return Ok(Verdict::Wrong("does not build".into()));
    }
    let program = copy.program("faults");
    let output = Command::new(&program)
        .args(["--check", "--cases", CASES])
        .output()
        .map_err(|error| Failure::new(format!("{}: {error}", program.display())))?;
    if output.status.success() {
        return Ok(Verdict::Fine);
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let why = text.lines().next().unwrap_or("the rig cannot be armed");
    Ok(Verdict::Wrong(why.to_owned()))
}

/// Runs the tests of `control` and `board` in the copy.
fn tests(copy: &Workspace) -> Result<Verdict> {
    for package in ["control", "board"] {
        let mut test = process::cargo(Sees::CompilerAndFlags);
        test.current_dir(copy.root())
            .args(["test", "--package", package, "--target-dir"])
            .arg(copy.target());
        let output = test
            .output()
            .map_err(|error| Failure::new(format!("{package}: {error}")))?;
        if !output.status.success() {
            let text = String::from_utf8_lossy(&output.stdout);
            let failed = text.lines().find(|line| line.ends_with("FAILED"));
            let why = failed.unwrap_or("does not build");
            return Ok(Verdict::Wrong(why.to_owned()));
        }
    }
    Ok(Verdict::Fine)
}

/// Copies the sources, with a workspace of these parts only.
pub(crate) fn copy_workspace(workspace: &Workspace, folder: &Path) -> Result<()> {
    let root = workspace.root();
    for part in PARTS {
        copy(&root.join(part), &folder.join(part))?;
    }
    for file in ["Cargo.lock", "docs/wiring.md"] {
        let to = folder.join(file);
        if let Some(parent) = to.parent() {
            fs::create_dir_all(parent).map_err(|error| problem(parent, &error))?;
        }
        fs::copy(root.join(file), &to).map_err(|error| problem(&to, &error))?;
    }
    let manifest = read(&root.join("Cargo.toml"))?;
    let list = |name: &str| format!("{name} = [\n");
    let mut cut = manifest;
    for name in ["members", "default-members"] {
        let begin = format!("\n{}", list(name));
        let Some(at) = cut.find(&begin) else { continue };
        let end = cut[at..].find("\n]").map_or(cut.len(), |n| at + n + 2);
        let parts = if name == "members" {
            format!("\nmembers = {PARTS:?}")
        } else {
            String::new()
        };
        cut.replace_range(at..end, &parts);
    }
    write(&folder.join("Cargo.toml"), &cut)
}

/// Copies a folder's files that differ, so that cargo builds only what has changed.
fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to).map_err(|error| problem(to, &error))?;
    for entry in fs::read_dir(from).map_err(|error| problem(from, &error))? {
        let entry = entry.map_err(|error| problem(from, &error))?;
        let (source, copied) = (entry.path(), to.join(entry.file_name()));
        if source.is_dir() {
            copy(&source, &copied)?;
        } else if fs::read(&source).ok() != fs::read(&copied).ok() {
            fs::copy(&source, &copied).map_err(|error| problem(&copied, &error))?;
        }
    }
    Ok(())
}

fn read(path: &Path) -> Result<String> {
    fs::read_to_string(path).map_err(|error| problem(path, &error))
}

fn write(path: &Path, text: &str) -> Result<()> {
    fs::write(path, text).map_err(|error| problem(path, &error))
}

fn problem(path: &Path, error: &std::io::Error) -> Failure {
    Failure::new(format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_no_mutant_has_is_refused() {
        let choose = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|&name| name.into()).collect();
            choose(MUTANTS.iter().collect(), |mutant| mutant.name, &names)
        };
        assert_eq!(choose(&[]).unwrap().len(), MUTANTS.len());
        assert_eq!(choose(&["surge-off"]).unwrap().len(), 1);
        for names in [&["surge-of"][..], &["surge-off", "--quick"]] {
            let error = choose(names).err().unwrap().to_string();
            assert!(error.contains(names[names.len() - 1]) && error.contains("surge-off"));
        }
    }

    /// What a part needs of the workspace, in its tests as well, is copied with it.
    #[test]
    fn parts_need_only_parts() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let output = Command::new(env!("CARGO"))
            .current_dir(root)
            .args(["metadata", "--no-deps", "--offline", "--format-version=1"])
            .output()
            .unwrap();
        let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let list = |value: &serde_json::Value| value.as_array().unwrap().clone();
        let parts = PARTS.map(|part| root.join(part));
        let mut found = 0;
        for package in list(&metadata["packages"]) {
            let manifest = Path::new(package["manifest_path"].as_str().unwrap());
            if !parts.iter().any(|part| manifest.parent() == Some(part)) {
                continue;
            }
            found += 1;
            for needed in list(&package["dependencies"]) {
                let copied = |path| parts.iter().any(|part| Path::new(path).starts_with(part));
                assert!(
                    needed["path"].as_str().is_none_or(copied),
                    "{} needs {}, which is not in PARTS",
                    package["name"],
                    needed["path"]
                );
            }
        }
        assert_eq!(found, PARTS.len());
    }

    /// A mutant whose place has changed would be no mutant.
    #[test]
    fn every_mutant_has_its_place_once() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        assert!(MUTANTS.len() >= 20 && TESTED.len() >= 60);
        for mutant in MUTANTS.iter().chain(TESTED) {
            let text = fs::read_to_string(root.join(mutant.file)).unwrap();
            assert_eq!(text.matches(mutant.from).count(), 1, "{}", mutant.name);
            assert_ne!(mutant.from, mutant.to, "{}", mutant.name);
        }
    }
}
