//! Runs the executables of a `cargo test` side by side.
//!
//! Cargo runs them one after the other, each with as many threads as there are cores. Many of ours
//! end in one long test, or wait for a program that runs in real time, so on two cores less than
//! one was in use (10 min 54 s of processor time in 12 min 6 s of the step `emulated`). Here cargo
//! still chooses, compiles and describes the executables, but hands each to a *runner*, this
//! program, which only notes it. The notes are then worked off with one executable for each core,
//! each with one test at a time: the load is not higher than before. `cargo-nextest` starts a
//! process for each test, and what the tests of one executable share would be made again in each.

use std::collections::VecDeque;
use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{mpsc, Mutex};
use std::thread;

use crate::process;
use crate::report::{Failure, Result};

/// First argument of xtask as cargo's runner; the folder for notes and the executable's command
/// line follow.
pub const RUNNER: &str = "note-test-executable";

/// Executables that take longest, longest first, as the logs of the steps `host` and `emulated`
/// printed them on two cores (26 to 140 s). They start first, so that none runs alone at the end.
const LONGEST: [&str; 15] = [
    "analysis",
    "first_day",
    "mistakes",
    "terminals",
    "fast_mode",
    "identify",
    "usb_sessions",
    "silicon",
    "coverage",
    "streaming",
    "faults",
    "program",
    "holding",
    "calibration",
    "network",
];

/// An executable as cargo would start it.
#[derive(Debug, Default, PartialEq, Eq)]
struct Note {
    folder: PathBuf,
    /// The executable and its arguments.
    words: Vec<String>,
    /// Cargo's description of the package, the loader's path and all else of the environment.
    variables: Vec<(String, String)>,
}

impl Note {
    fn to_text(&self) -> String {
        let mut lines = vec![self.folder.to_string_lossy().into_owned()];
        lines.push(self.words.len().to_string());
        lines.extend(self.words.iter().cloned());
        lines.extend(
            self.variables
                .iter()
                .map(|(name, value)| format!("{name}={value}")),
        );
        lines.join("\0")
    }

    fn from_text(text: &str) -> Option<Self> {
        let mut lines = text.split('\0').map(str::to_owned);
        let folder = lines.next()?.into();
        let count = lines.next()?.parse().ok()?;
        let words: Vec<String> = lines.by_ref().take(count).collect();
        let variables = lines
            .map(|line| {
                line.split_once('=')
                    .map(|(name, value)| (name.to_owned(), value.to_owned()))
            })
            .collect::<Option<_>>()?;
        (words.len() == count && count > 0).then_some(Self {
            folder,
            words,
            variables,
        })
    }

    /// The executable's name without the hash that cargo puts behind it.
    fn name(&self) -> &str {
        let path = Path::new(&self.words[0]);
        let stem = path
            .file_stem()
            .and_then(|stem| stem.to_str())
            .unwrap_or("");
        stem.rsplit_once('-').map_or(stem, |(name, _)| name)
    }

    /// Its place among [`LONGEST`], or behind them.
    fn rank(&self) -> usize {
        let name = self.name();
        LONGEST
            .iter()
            .position(|long| *long == name)
            .unwrap_or(LONGEST.len())
    }

    fn run(&self) -> std::io::Result<Output> {
        Command::new(&self.words[0])
            .args(&self.words[1..])
            .current_dir(&self.folder)
            .env_clear()
            .envs(self.variables.iter().map(|(name, value)| (name, value)))
            .env("RUST_TEST_THREADS", "1")
            .stdin(Stdio::null())
            .output()
    }
}

/// Cargo's runner: notes the executable. One that lies outside of the folder of the executables is
/// a test of documentation, which rustdoc deletes when this program ends; it runs at once.
///
/// # Errors
/// When the note can't be written, or an argument is missing or not Unicode.
pub fn note(arguments: &[OsString]) -> Result<u8> {
    let unfit = || {
        Failure::new(format!(
            "`{RUNNER}` is for cargo: FOLDER EXECUTABLE [ARGUMENT ...]"
        ))
    };
    let [folder, words @ ..] = arguments else {
        return Err(unfit());
    };
    let [executable, rest @ ..] = words else {
        return Err(unfit());
    };
    if !Path::new(executable)
        .parent()
        .is_some_and(|folder| folder.ends_with("deps"))
    {
        let mut command = Command::new(executable);
        let status = command
            .args(rest)
            .status()
            .map_err(|error| process::not_started(&command, &error))?;
        return Ok(status
            .code()
            .and_then(|code| u8::try_from(code).ok())
            .unwrap_or(1));
    }
    let words = words
        .iter()
        // Cargo is quiet about what it starts here; the tests are not.
        .filter(|word| *word != "--quiet")
        .map(|word| word.to_str().map(str::to_owned))
        .collect::<Option<_>>();
    let note = Note {
        folder: env::current_dir()
            .map_err(|error| Failure::new(format!("the current folder is not known: {error}")))?,
        words: words.ok_or_else(unfit)?,
        variables: env::vars_os()
            .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
            .collect(),
    };
    let folder = Path::new(folder);
    let place = || -> std::io::Result<PathBuf> {
        Ok(folder.join(format!("{:05}", fs::read_dir(folder)?.count())))
    };
    place()
        .and_then(|path| fs::write(path, note.to_text()))
        .map_err(|error| Failure::new(format!("{} can't be written: {error}", folder.display())))?;
    Ok(0)
}

/// The arguments that make this program the runner of a `cargo test`.
///
/// # Errors
/// When the folder can't be made empty, or this program's path is not known.
pub fn arguments(folder: &Path) -> Result<[String; 2]> {
    let _ = fs::remove_dir_all(folder);
    fs::create_dir_all(folder)
        .map_err(|error| Failure::new(format!("{} can't be made: {error}", folder.display())))?;
    let program = env::current_exe()
        .map_err(|error| Failure::new(format!("the path of xtask is not known: {error}")))?;
    // TOML's literal strings: a path may hold a backslash.
    let words =
        [program.as_path(), Path::new(RUNNER), folder].map(|word| format!("'{}'", word.display()));
    Ok([
        "--config".to_owned(),
        format!("target.'cfg(all())'.runner=[{}]", words.join(", ")),
    ])
}

/// Runs what was noted in `folder`; `each` is given every executable's path and output as it ends.
///
/// # Errors
/// Names the executables that failed or could not be started.
pub fn run(folder: &Path, mut each: impl FnMut(&str, &Output)) -> Result<()> {
    let mut notes = read(folder)?;
    notes.sort_by_key(Note::rank);
    let count = notes.len();
    let queue = Mutex::new(VecDeque::from(notes));
    let (sender, receiver) = mpsc::channel();
    let workers = thread::available_parallelism().map_or(1, usize::from);
    let mut failed = Vec::new();
    thread::scope(|scope| {
        for _ in 0..workers {
            let (queue, sender) = (&queue, sender.clone());
            scope.spawn(move || loop {
                // The lock is held for this statement only.
                let next = queue.lock().ok().and_then(|mut queue| queue.pop_front());
                let Some(note) = next else { break };
                let ended = note.run();
                if sender.send((note, ended)).is_err() {
                    break;
                }
            });
        }
        drop(sender);
        for (note, ended) in receiver {
            match ended {
                Ok(output) => {
                    each(&note.words[0], &output);
                    if !output.status.success() {
                        failed.push(format!("{} ({})", note.name(), output.status));
                    }
                }
                Err(error) => failed.push(format!("{} could not be started: {error}", note.name())),
            }
        }
    });
    if failed.is_empty() {
        Ok(())
    } else {
        Err(Failure::new(format!(
            "{} of {count} test executables failed: {}",
            failed.len(),
            failed.join(", ")
        )))
    }
}

fn read(folder: &Path) -> Result<Vec<Note>> {
    let unfit = |what: String| Failure::new(format!("{}: {what}", folder.display()));
    let mut paths = fs::read_dir(folder)
        .and_then(|entries| {
            entries
                .map(|entry| Ok(entry?.path()))
                .collect::<std::io::Result<Vec<_>>>()
        })
        .map_err(|error| unfit(error.to_string()))?;
    paths.sort();
    paths
        .iter()
        .map(|path| {
            let text = fs::read_to_string(path).map_err(|error| unfit(error.to_string()))?;
            Note::from_text(&text)
                .ok_or_else(|| unfit(format!("{} is not a note of this program", path.display())))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn note(words: &[&str]) -> Note {
        Note {
            folder: "/t".into(),
            words: words.iter().map(|word| (*word).to_owned()).collect(),
            variables: vec![("PATH".into(), env::var("PATH").unwrap_or_default())],
        }
    }

    #[test]
    fn a_note_is_read_as_it_was_written() {
        let mut note = note(&["/t/deps/a-0f", "--exact", "", "two words"]);
        note.variables.push(("EMPTY".into(), String::new()));
        note.variables.push(("LINES".into(), "a=b\nc".into()));
        assert_eq!(Note::from_text(&note.to_text()), Some(note));
        for text in [
            "",
            "/",
            "/\0one",
            "/\x001",
            "/\x000",
            "/\x001\0a\0no variable",
        ] {
            assert_eq!(Note::from_text(text), None, "{text:?}");
        }
    }

    #[test]
    fn long_ones_come_first() {
        let mut notes = [
            note(&["/t/deps/small-1"]),
            note(&["/t/deps/first_day-2"]),
            note(&["/t/deps/analysis-3"]),
        ];
        notes.sort_by_key(Note::rank);
        assert_eq!(
            notes.each_ref().map(Note::name),
            ["analysis", "first_day", "small"]
        );
    }

    #[cfg(unix)]
    #[test]
    fn each_is_run_and_every_failure_is_named() {
        let folder = tempfile::tempdir().unwrap();
        for (place, code) in ["exit 0", "exit 3", "echo $RUST_TEST_THREADS", "exit 4"]
            .iter()
            .enumerate()
        {
            let note = Note {
                folder: folder.path().into(),
                ..note(&["/bin/sh", "-c", code])
            };
            fs::write(folder.path().join(format!("{place:05}")), note.to_text()).unwrap();
        }
        let mut printed: Vec<u8> = Vec::new();
        let error = run(folder.path(), |_, output| printed.extend(&output.stdout)).unwrap_err();
        assert_eq!(printed, b"1\n");
        let text = error.to_string();
        assert!(
            text.contains("2 of 4") && text.contains("status: 3") && text.contains("status: 4"),
            "{text}"
        );
    }

    #[test]
    fn a_runner_without_an_executable_is_refused() {
        assert!(super::note(&[]).is_err() && super::note(&["folder".into()]).is_err());
    }
}
