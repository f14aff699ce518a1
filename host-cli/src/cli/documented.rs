//! Every command line of `forcectl` in the pages of the root folder and docs/, and in the program's
//! own help, is one that the parser takes. The changelog may name options of earlier versions.

use super::Cli;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser};
use std::path::{Path, PathBuf};

/// A command line in a text.
#[derive(Debug)]
struct Line {
    place: String,
    text: String,
    /// A line of its own, to be typed as it is. In a sentence a line may lack required arguments
    /// and values.
    to_type: bool,
}

/// Markdown files of a folder, and of the folders in it where `deep`.
fn pages(folder: &Path, deep: bool, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("the folder is there") {
        let path = entry.expect("is readable").path();
        if path.is_dir() {
            if deep {
                pages(&path, deep, found);
            }
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
}

/// The words after `forcectl`, if the text is a call of it.
fn call(text: &str) -> Option<&str> {
    let text = text.trim().trim_start_matches("$ ");
    let text = text.strip_prefix("cargo ").unwrap_or(text);
    let rest = text.strip_prefix("forcectl")?;
    (rest.is_empty() || rest.starts_with(' ')).then_some(rest)
}

/// The calls in a page: in blocks of code, and between backticks.
fn calls(place: &str, page: &str) -> Vec<Line> {
    let mut found = Vec::new();
    let mut fenced = false;
    // A call that goes on in the next line of the block.
    let mut begun = String::new();
    for (number, line) in page.lines().enumerate() {
        let mut push = |text: &str, to_type| {
            found.push(Line {
                place: format!("{place}:{}", number + 1),
                text: text.to_owned(),
                to_type,
            });
        };
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        } else if fenced || line.starts_with("    ") {
            // A comment of the shell is not part of the call.
            let code = line.split(" #").next().unwrap_or(line);
            if let Some(part) = code.trim_end().strip_suffix('\\') {
                begun.push_str(part);
                continue;
            }
            let code = std::mem::take(&mut begun) + code;
            if let Some(rest) = call(&code) {
                push(rest, true);
            }
        } else {
            for code in line.split('`').skip(1).step_by(2) {
                if let Some(rest) = call(code) {
                    push(rest, false);
                }
            }
        }
    }
    found
}

/// Words that stand for something else: `N`, `FILE`, `ARGS...`, a variable of the shell.
fn is_placeholder(word: &str) -> bool {
    if word.contains('$') {
        return true;
    }
    let letters = word.trim_end_matches('.');
    !letters.is_empty() && letters.chars().all(|c| c.is_ascii_uppercase())
}

fn named_only(error: &clap::Error) -> bool {
    let value = error.get(ContextKind::InvalidValue);
    matches!(value, Some(ContextValue::String(value)) if value.is_empty())
}

/// What is wrong with a call; `None`: nothing.
fn mistake(line: &Line) -> Option<String> {
    let Some(words) = shlex::split(&line.text) else {
        return Some(format!(
            "{}: forcectl{}\nthe quotes are not in pairs",
            line.place, line.text
        ));
    };
    let words: Vec<String> = words
        .into_iter()
        .take_while(|word| !["|", ">", "<", "&&", "..."].contains(&word.as_str()))
        .collect();
    if words.is_empty() || words.iter().any(|word| is_placeholder(word)) {
        return None;
    }
    let error = Cli::try_parse_from(std::iter::once("forcectl".to_owned()).chain(words)).err()?;
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => None,
        ErrorKind::MissingRequiredArgument if !line.to_type => None,
        // A command that is named without its step.
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand
            if !line.to_type =>
        {
            None
        }
        // An option that is named without its value.
        ErrorKind::InvalidValue if !line.to_type && named_only(&error) => None,
        _ => Some(format!("{}: forcectl{}\n{error}", line.place, line.text)),
    }
}

#[test]
fn documented_calls_are_understood() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    pages(&root, false, &mut files);
    files.retain(|file| !file.ends_with("CHANGELOG.md"));
    pages(&root.join("docs"), true, &mut files);
    assert!(files.iter().any(|file| file.ends_with("README.md")));
    let mut lines = Vec::new();
    for file in &files {
        let text = std::fs::read_to_string(file).expect("is readable");
        lines.extend(calls(&file.display().to_string(), &text));
    }
    for command in Cli::command().get_subcommands_mut() {
        let help = command.render_long_help().to_string();
        lines.extend(calls(&format!("{} --help", command.get_name()), &help));
    }
    let count = |to_type| lines.iter().filter(|line| line.to_type == to_type).count();
    // If the calls were not found, nothing would be tested.
    assert!(count(true) > 5 && count(false) > 15, "{lines:#?}");
    let mistakes: Vec<String> = lines.iter().filter_map(mistake).collect();
    assert!(mistakes.is_empty(), "{}", mistakes.join("\n"));
}

#[test]
fn calls_are_found_and_wrong_ones_told() {
    let page = "Type `forcectl status --rig usb` or `cargo forcectl explain N`, not `forcectl::x`.\n\
                `forcectl residual --apply` too.\n```sh\ncargo forcectl set-force 0 1 0 --for 3 # old\n```\n    \
                forcectl residual --apply x\n\n    forcectl completions bash \\\n      --no-such-option\n    forcectl \
                explain \"33\"\n";
    let lines = calls("page", page);
    assert_eq!(lines.len(), 7, "{lines:#?}");
    let wrong: Vec<bool> = lines.iter().map(|line| mistake(line).is_some()).collect();
    assert_eq!(
        wrong,
        [true, false, false, true, true, true, false],
        "{lines:#?}"
    );
}
