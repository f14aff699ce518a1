//! What the programs of `evaluations/` have in common. Each is a package of its own, because they
//! need very different things built: `residual-bench` no rig, `bench` all of it, and `residual`
//! must not see the generators that test it.
//!
//! A program declares its options as a [`clap::Parser`], whose comments are its help, and hands
//! over to [`run`].

pub mod checkpoint;
mod progress;

pub use clap;

use clap::Parser;
use std::ops::RangeInclusive;
use std::path::Path;
use std::process::{Command, ExitCode};

/// Largest seed: some programs multiply it.
const MAX_SEED: u64 = 1_000_000;

/// Reads the command line and does the work. Exit code 2 for wrong usage, 1 where the work fails.
pub fn run<A: Parser>(work: impl FnOnce(A) -> Result<ExitCode, String>) -> ExitCode {
    work(A::parse()).unwrap_or_else(|error| {
        eprintln!("{}: {error}", A::command().get_name());
        ExitCode::FAILURE
    })
}

/// Makes a test that clap finds nothing wrong in a program's options.
#[macro_export]
macro_rules! test_options {
    ($options:ty) => {
        #[cfg(test)]
        #[test]
        fn clap_accepts_the_options() {
            <$options as $crate::clap::CommandFactory>::command().debug_assert();
        }
    };
}

/// The exit code of work whose result is bad where `bad`.
#[must_use]
pub fn exit_code(bad: bool) -> ExitCode {
    ExitCode::from(u8::from(bad))
}

/// Seeds as `A..B`, both included, or as one number.
///
/// # Errors
/// What to write instead.
pub fn seeds(text: &str) -> Result<RangeInclusive<u64>, String> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let seed = |text: &str| text.trim_start_matches('=').parse::<u64>().ok();
    seed(first)
        .zip(seed(last))
        .filter(|(first, last)| first <= last && *last <= MAX_SEED)
        .map(|(first, last)| first..=last)
        .ok_or_else(|| format!("give FIRST..LAST, whole numbers up to {MAX_SEED}"))
}

/// The command that was called, for a page's heading; `program`: how it is started.
#[must_use]
pub fn command_line(program: &str) -> String {
    std::env::args()
        .skip(1)
        .fold(program.to_owned(), |line, word| line + " " + &word)
}

/// The sources that a page was printed with, for its heading: "version 0.2.0, commit abcdef0", and
/// whether files differed from it.
#[must_use]
pub fn sources() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    let version = concat!("version ", env!("CARGO_PKG_VERSION"));
    match git(&["rev-parse", "--short", "HEAD"]) {
        None => format!("{version}, commit unknown"),
        Some(commit) => {
            let clean = git(&["status", "--porcelain"]).is_some_and(|changes| changes.is_empty());
            let changes = if clean { "" } else { " with changes" };
            format!("{version}, commit {commit}{changes}")
        }
    }
}

/// Writes a file.
///
/// # Errors
/// With the file's name.
pub fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text)
        .map_err(|error| format!("{} can't be written: {error}", path.display()))
}

/// Writes a page into a file where one is given, and prints it otherwise.
///
/// # Errors
/// As [`write()`].
pub fn publish(markdown: Option<&Path>, page: &str) -> Result<(), String> {
    match markdown {
        Some(path) => write(path, page),
        None => {
            print!("{page}");
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_a_range_or_one() {
        for (text, expected) in [
            ("1..20", Some(1..=20)),
            ("3", Some(3..=3)),
            ("1..=10", Some(1..=10)),
            ("5..4", None),
            ("1..1000001", None),
            ("a..b", None),
            ("-1", None),
        ] {
            assert_eq!(seeds(text).ok(), expected, "{text}");
        }
    }
}
