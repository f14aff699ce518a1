//! Outcomes of a long run, kept in a file as they come: a run that was cut off goes on where it
//! stopped.
//!
//! The file has one outcome a line, in JSON, below a line that says what they are of. Outcomes of
//! another build of the program do not count: they are put aside.

use crate::progress::Progress;
use rayon::prelude::*;
use serde::{de::DeserializeOwned, Deserialize, Serialize};
use std::collections::HashMap;
use std::fmt::{self, Display};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// The first line of a file.
#[derive(Serialize, Deserialize)]
struct Head<O> {
    /// SHA-256 of the program.
    program: String,
    /// What the outcomes are of, beside the program.
    #[serde(flatten)]
    of: O,
}

/// What the outcomes of [`each`] are of.
#[derive(PartialEq, Serialize, Deserialize)]
struct Sets {
    sets: String,
}

impl Display for Sets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sets)
    }
}

/// An outcome of [`each`] with the case that it is of.
#[derive(Serialize, Deserialize)]
struct Line<T> {
    case: serde_json::Value,
    outcome: T,
}

/// A file that takes outcomes.
pub struct Checkpoint {
    file: Mutex<File>,
}

impl Checkpoint {
    /// Opens or begins a file of outcomes `of` something, and reads those that it has of this
    /// program. A line that was cut off is left out. A file of another build is put aside, with
    /// `.old` behind its name.
    ///
    /// # Errors
    /// The file cannot be read or written, or is of something else.
    pub fn open<O, T>(path: &Path, of: &O) -> io::Result<(Self, Vec<T>)>
    where
        O: Serialize + DeserializeOwned + PartialEq + Display,
        T: DeserializeOwned,
    {
        let program = files::sha256(&std::env::current_exe()?)?;
        let mut text = String::new();
        if path.exists() {
            text = fs::read_to_string(path)?;
            match head::<O>(&text) {
                Some(head) if head.program == program && head.of == *of => {}
                Some(head) if head.program == program => {
                    return Err(io::Error::other(format!(
                        "has the outcomes of {}; give another file",
                        head.of
                    )))
                }
                _ => {
                    put_aside(path)?;
                    text.clear();
                }
            }
        }
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        if text.is_empty() {
            write_line(&mut file, &Head { program, of })?;
        } else if !text.ends_with('\n') {
            file.write_all(b"\n")?;
        }
        let file = Mutex::new(file);
        Ok((Self { file }, outcomes(&text)))
    }

    /// Adds an outcome.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn append<T: Serialize>(&self, outcome: &T) -> io::Result<()> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        write_line(&mut file, outcome)
    }
}

/// What a file's outcomes are of, and the outcomes. A line that was cut off is left out.
///
/// # Errors
/// The file cannot be read, or does not say what it is of.
pub fn read<O: DeserializeOwned, T: DeserializeOwned>(path: &Path) -> io::Result<(O, Vec<T>)> {
    let text = fs::read_to_string(path)?;
    let head = head::<O>(&text)
        .ok_or_else(|| io::Error::other("does not begin with what its outcomes are of"))?;
    Ok((head.of, outcomes(&text)))
}

/// The outcomes of all cases, in the order of the cases, on all processors, with progress on
/// standard error. With a file of outcomes of the same `sets`, what it has is not worked out again,
/// and the others are added as they come.
///
/// # Errors
/// The work's first error, or the file's with its name.
pub fn each<C, T>(
    cases: &[C],
    file: Option<&Path>,
    sets: &str,
    work: impl Fn(&C) -> Result<T, String> + Sync,
) -> Result<Vec<T>, String>
where
    C: Serialize + Sync,
    T: Serialize + DeserializeOwned + Send,
{
    let named = |error: io::Error| match file {
        Some(path) => format!("{}: {error}", path.display()),
        None => error.to_string(),
    };
    let (checkpoint, done): (_, Vec<Line<T>>) = match file {
        Some(path) => {
            let sets = sets.to_owned();
            let (checkpoint, done) = Checkpoint::open(path, &Sets { sets }).map_err(named)?;
            (Some(checkpoint), done)
        }
        None => (None, Vec::new()),
    };
    let key = |case: &serde_json::Value| case.to_string();
    let mut done: HashMap<String, T> = done
        .into_iter()
        .map(|line| (key(&line.case), line.outcome))
        .collect();
    let before: Vec<(&C, serde_json::Value, Option<T>)> = cases
        .iter()
        .map(|case| {
            let value = serde_json::to_value(case).map_err(|error| named(error.into()))?;
            let known = done.remove(&key(&value));
            Ok((case, value, known))
        })
        .collect::<Result<_, String>>()?;
    let open = before.iter().filter(|(_, _, known)| known.is_none());
    let progress = Progress::new(open.count());
    let outcomes = before
        .into_par_iter()
        .map(|(case, value, known)| {
            if let Some(outcome) = known {
                return Ok(outcome);
            }
            let line = Line {
                case: value,
                outcome: work(case)?,
            };
            if let Some(checkpoint) = &checkpoint {
                checkpoint.append(&line).map_err(named)?;
            }
            progress.step();
            Ok(line.outcome)
        })
        .collect();
    eprintln!();
    outcomes
}

/// A file's first line; `None` where it is none.
fn head<O: DeserializeOwned>(text: &str) -> Option<Head<O>> {
    serde_json::from_str(text.lines().next()?).ok()
}

/// The outcomes of a file.
fn outcomes<T: DeserializeOwned>(text: &str) -> Vec<T> {
    let lines = text.lines().skip(1);
    lines
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}

/// Renames a file to the first of `.old`, `.old2`, `.old3` and so on that is free.
fn put_aside(path: &Path) -> io::Result<()> {
    let mut old = path.with_added_extension("old");
    let mut number = 1;
    while old.exists() {
        number += 1;
        old = path.with_added_extension(format!("old{number}"));
    }
    fs::rename(path, &old)?;
    eprintln!(
        "{} has no outcomes of this build of the program: beginning anew, it is kept as {}",
        path.display(),
        old.display()
    );
    Ok(())
}

fn write_line(file: &mut File, value: &impl Serialize) -> io::Result<()> {
    let mut line = serde_json::to_string(value)?;
    line.push('\n');
    file.write_all(line.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn what_is_in_the_file_is_not_worked_out_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("outcomes.jsonl");
        let worked = AtomicUsize::new(0);
        let run = |cases: &[u32], sets: &str| {
            worked.store(0, Ordering::Relaxed);
            each(cases, Some(&path), sets, |case| {
                worked.fetch_add(1, Ordering::Relaxed);
                match case {
                    7 => Err("seven".to_owned()),
                    other => Ok(other * 2),
                }
            })
        };
        assert_eq!(run(&[3, 1, 2], "numbers"), Ok(vec![6, 2, 4]));
        assert_eq!(run(&[2, 4, 1], "numbers"), Ok(vec![4, 8, 2]));
        assert_eq!(worked.load(Ordering::Relaxed), 1);
        assert_eq!(run(&[7], "numbers"), Err("seven".to_owned()));
        // The last line was cut off in the middle: its case runs again, and the next line is whole.
        let text = fs::read_to_string(&path).expect("the file");
        fs::write(&path, &text[..text.len() - 4]).expect("written");
        assert_eq!(run(&[1, 2, 3, 4], "numbers"), Ok(vec![2, 4, 6, 8]));
        assert_eq!(worked.load(Ordering::Relaxed), 1);
        assert_eq!(run(&[1, 2, 3, 4], "numbers"), Ok(vec![2, 4, 6, 8]));
        assert_eq!(worked.load(Ordering::Relaxed), 0);
        let told = run(&[1], "others").expect_err("of something else");
        assert!(told.contains("the outcomes of numbers"), "{told}");
        // Another build: its outcomes are put aside.
        let text = fs::read_to_string(&path).expect("the file");
        let other = text.replacen("\"program\":\"", "\"program\":\"x", 1);
        fs::write(&path, &other).expect("written");
        assert_eq!(run(&[1], "numbers"), Ok(vec![2]));
        assert_eq!(worked.load(Ordering::Relaxed), 1);
        let old = fs::read_to_string(folder.path().join("outcomes.jsonl.old"));
        assert_eq!(old.expect("kept"), other);
        // The next one does not take its place.
        fs::write(&path, &other).expect("written");
        assert_eq!(run(&[1], "numbers"), Ok(vec![2]));
        assert!(folder.path().join("outcomes.jsonl.old2").exists());
    }
}
