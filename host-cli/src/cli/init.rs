//! `forcectl init`: makes a rig file from the answers to ten questions.

use super::exit::{self, Failure, Reply, Result};
use super::output::path_json;
use super::{output, Context};
use clap::Args;
use rig::init::{self, Question, QUESTIONS};
use rig::Rig;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use toml::Value;

/// Below the help of the command.
pub const HELP: &str = "\
The questions, which are asked on a terminal unless they are answered: name, link, pose, center, radius, units, exit, axis,
scale, tension. Without a terminal a question that is not answered takes its default, and name, center and exit have none.

  forcectl init my-rig.toml --answers answers.toml --set name=lab-3

answers.toml has a key for each question:

  name = \"lab-3\"
  center = [-0.080, 0.025, -0.140]
  exit = [[0.335, 0.045, -0.110], [-0.480, 0.010, -0.165]]    # units 1, 2, ...; or \"1: X Y Z; 2: X Y Z\"";

/// Arguments of `init`.
#[derive(Debug, Args)]
pub struct Init {
    /// Rig file to write; an existing file is not overwritten
    file: PathBuf,
    /// Answers (TOML)
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    /// One answer; repeatable, and stronger than --answers
    #[arg(long, value_name = "KEY=ANSWER", value_parser = pair)]
    set: Vec<(String, String)>,
}

/// Reads `key=answer`.
fn pair(text: &str) -> std::result::Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, answer)) if init::question(key).is_some() => {
            Ok((key.to_owned(), answer.to_owned()))
        }
        _ => Err(format!(
            "`{text}` is not KEY=ANSWER; the keys are {}",
            QUESTIONS.map(|question| question.key).join(", ")
        )),
    }
}

impl Init {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        if self.file.exists() {
            return Err(Failure::usage(format!(
                "{} is there already and is not overwritten; give another name",
                self.file.display()
            )));
        }
        let mut answers = match &self.answers {
            Some(path) => read(path)?,
            None => BTreeMap::new(),
        };
        answers.extend(self.set.iter().cloned());
        if std::io::IsTerminal::is_terminal(&std::io::stdin()) && !context.output.json() {
            ask(&mut answers)?;
        }
        let text =
            init::rig_file(&answers).map_err(|problems| Failure::usage(problems.join("\n")))?;
        let name = self.file.display().to_string();
        let unwritten =
            |why: String| Failure::new(exit::RIG_FILE, format!("{why}\nthe file was not written"));
        let rig = Rig::parse(&name, &text).map_err(|error| unwritten(error.to_string()))?;
        run::require_feasible(&rig).map_err(|error| unwritten(format!("{name}: {error}")))?;
        std::fs::File::create_new(&self.file)
            .and_then(|mut file| file.write_all(text.as_bytes()))
            .map_err(|error| Failure::file(&self.file, error))?;
        Ok(Reply::new(
            format!(
                "{name}: written and checked. Gains, limits and friction are those of the built-in example; see \
                 docs/bring-up.md before anything is armed.\n"
            ),
            json!({"file": path_json(&self.file), "name": rig.name, "hash": rig.hash()}),
        ))
    }
}

/// Asks on the terminal what is not answered yet.
fn ask(answers: &mut BTreeMap<String, String>) -> Result<()> {
    let mut lines = std::io::stdin().lock().lines();
    let mut line = |prompt: &str| -> Result<String> {
        output::to_stderr(prompt);
        match lines.next() {
            Some(Ok(line)) => Ok(line.trim().to_owned()),
            _ => Err(Failure::usage(
                "the questions were not answered; nothing was written",
            )),
        }
    };
    for question in &QUESTIONS {
        if answers.contains_key(question.key) {
            continue;
        }
        let default = question
            .default
            .map_or_else(String::new, |default| format!(" [{default}]"));
        let mut found = Vec::new();
        for unit in asked_units(question, answers) {
            let who = unit.map_or_else(String::new, |unit| format!("Unit {unit}. "));
            let answer = line(&format!("{who}{}{default}:", question.text))?;
            match unit {
                _ if answer.is_empty() => {}
                Some(unit) => found.push(format!("{unit}: {answer}")),
                None => found.push(answer),
            }
        }
        if !found.is_empty() {
            answers.insert(question.key.to_owned(), found.join("; "));
        }
    }
    Ok(())
}

/// The units that a question is asked for; `None` where it is asked once.
fn asked_units(question: &Question, answers: &BTreeMap<String, String>) -> Vec<Option<u8>> {
    if !question.per_unit {
        return vec![None];
    }
    let there = answers.get("units").map(String::as_str);
    let default = init::question("units").and_then(|question| question.default);
    let units = there.or(default).map(init::units);
    units
        .and_then(std::result::Result::ok)
        .unwrap_or_default()
        .into_iter()
        .map(Some)
        .collect()
}

/// Answers from a file.
fn read(path: &Path) -> Result<BTreeMap<String, String>> {
    let wrong = |why: String| Failure::usage(format!("{}: {why}", path.display()));
    let text = files::read_text(path).map_err(|error| wrong(error.to_string()))?;
    let table: toml::Table = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    table
        .iter()
        .map(|(key, value)| match answer(value) {
            Some(answer) => Ok((key.clone(), answer)),
            None => Err(wrong(format!(
                "`{key}` has to be text, a number, a list of numbers or a list of such lists"
            ))),
        })
        .collect()
}

/// An answer of a file as text.
fn answer(value: &Value) -> Option<String> {
    let number = |value: &Value| match value {
        Value::Integer(n) => Some(n.to_string()),
        Value::Float(x) => Some(x.to_string()),
        _ => None,
    };
    let row = |values: &[Value]| -> Option<String> {
        Some(
            values
                .iter()
                .map(number)
                .collect::<Option<Vec<_>>>()?
                .join(" "),
        )
    };
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Array(values) => row(values).or_else(|| {
            let rows = values.iter().enumerate().map(|(i, value)| {
                let text = row(value.as_array()?)?;
                Some(format!("{}: {text}", i + 1))
            });
            Some(rows.collect::<Option<Vec<_>>>()?.join("; "))
        }),
        other => number(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_of_a_file_become_text() {
        let text = |toml: &str| answer(&toml::from_str::<toml::Table>(toml).expect("TOML")["a"]);
        assert_eq!(text("a = \"usb\""), Some("usb".into()));
        assert_eq!(text("a = 0.05"), Some("0.05".into()));
        assert_eq!(text("a = [1, 2.5]"), Some("1 2.5".into()));
        assert_eq!(
            text("a = [[1, 2, 3], [4, 5, 6]]"),
            Some("1: 1 2 3; 2: 4 5 6".into())
        );
        assert_eq!(text("a = [[\"x\"]]"), None);
        assert_eq!(text("a = true"), None);
    }

    #[test]
    fn questions_for_each_unit_are_asked_for_those_that_are_there() {
        let exit = init::question("exit").expect("is a question");
        let mut answers = BTreeMap::new();
        assert_eq!(asked_units(exit, &answers).len(), 6);
        answers.insert("units".to_owned(), "2, 5".to_owned());
        assert_eq!(asked_units(exit, &answers), [Some(2), Some(5)]);
        let name = init::question("name").expect("is a question");
        assert_eq!(asked_units(name, &answers), [None]);
    }
}
