//! Reads the command line. Mistakes get a hint where the program knows one: options that were
//! renamed, options that only other commands have, and options of a command that stand before it.

use super::exit::{self, Failure, Reply};
use super::output::{self, Output, OutputArgs};
use super::Cli;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser};
use std::ffi::OsString;

/// Options that were renamed: old name, command (`None`: any command), new name.
const RENAMED: [(&str, Option<&str>, &str); 4] = [
    ("--config", None, "--rig"),
    ("--for", None, "--duration"),
    ("--seconds", Some("identify"), "--drive-duration"),
    ("--seconds", None, "--duration"),
];

/// Whether nothing is left out. `cargo forcectl` builds less for the first commands.
const WHOLE: bool = cfg!(all(
    feature = "estimate",
    feature = "foxglove",
    feature = "record",
    feature = "residual",
    feature = "web"
));

/// Reads the command line. Where it is wrong, or asks for help, the answer is printed and the exit
/// code returned.
pub fn parse(arguments: &[OsString]) -> Result<Cli, u8> {
    Cli::try_parse_from(arguments).map_err(|error| answer(error, arguments))
}

fn answer(mut error: clap::Error, arguments: &[OsString]) -> u8 {
    let words: Vec<&str> = arguments
        .iter()
        .skip(1)
        .filter_map(|word| word.to_str())
        .take_while(|word| *word != "--")
        .collect();
    let output = Output::new(OutputArgs {
        json: words.contains(&"--json"),
        ..OutputArgs::default()
    });
    if let Some(hint) = hint(&error, &words).or_else(|| left_out(&error)) {
        error.insert(
            ContextKind::Suggested,
            ContextValue::StyledStrs(vec![hint.into()]),
        );
        // This hint is more exact than clap's own suggestion.
        error.remove(ContextKind::SuggestedArg);
        error.remove(ContextKind::SuggestedSubcommand);
    }
    let text = error.render();
    if !error.use_stderr() {
        let text = if output::stdout_is_terminal() {
            text.ansi().to_string()
        } else {
            text.to_string()
        };
        output.print(&text);
        return output.finish(&Ok(Reply::text("")));
    }
    if output.json() {
        let message = message(&error, &text.to_string());
        return output.finish(&Err(Failure::usage(message)));
    }
    output::to_stderr(&if output::stderr_is_terminal() {
        text.ansi().to_string()
    } else {
        text.to_string()
    });
    exit::USAGE
}

/// The error without usage and layout, which are for people.
fn message(error: &clap::Error, text: &str) -> String {
    if matches!(
        error.kind(),
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand
    ) {
        return "a command is missing; `forcectl --help` lists the commands".to_owned();
    }
    let end = ["\n\nUsage:", "\n\nFor more information"]
        .iter()
        .filter_map(|tail| text.find(tail))
        .min()
        .unwrap_or(text.len());
    let words: Vec<&str> = text[..end].split_whitespace().collect();
    words.join(" ").trim_start_matches("error: ").to_owned()
}

/// Where a forcectl that lacks some commands and options gets them.
fn left_out(error: &clap::Error) -> Option<String> {
    let unknown = [ErrorKind::InvalidSubcommand, ErrorKind::UnknownArgument];
    (!WHOLE && unknown.contains(&error.kind())).then(|| {
        "this forcectl was built for the first commands only; `cargo forcectl` in place of `forcectl` \
         builds the rest"
            .to_owned()
    })
}

/// What is known about an option that clap does not expect.
fn hint(error: &clap::Error, words: &[&str]) -> Option<String> {
    if error.kind() != ErrorKind::UnknownArgument {
        return None;
    }
    let Some(ContextValue::String(option)) = error.get(ContextKind::InvalidArg) else {
        return None;
    };
    let option = option.split(['=', ' ']).next()?;
    let cli = Cli::command();
    let has = |command: &clap::Command, option: &str| {
        command.get_arguments().any(|arg| {
            arg.get_long()
                .is_some_and(|long| option == format!("--{long}"))
        })
    };
    let command = words.iter().find_map(|word| cli.find_subcommand(word));
    let name = command.map(clap::Command::get_name);
    let new = RENAMED
        .iter()
        .find(|(old, of, _)| *old == option && (of.is_none() || *of == name))
        .map(|(_, _, new)| *new);
    let current_name = new.unwrap_or(option);
    let renamed = new.map_or(String::new(), |new| format!("`{option}` is now `{new}`"));
    let with: Vec<&str> = cli
        .get_subcommands()
        .filter(|command| has(command, current_name))
        .map(clap::Command::get_name)
        .collect();
    let place = match (command, name) {
        (Some(command), Some(name)) if has(command, current_name) => {
            match new {
                // The option is right and stands before its command.
                None => {
                    format!("`{current_name}` stands after the command: forcectl {name} {current_name} ...")
                }
                Some(_) => String::new(),
            }
        }
        (_, Some(name)) if !with.is_empty() => {
            format!(
                "`{name}` does not use `{current_name}`; these commands do: {}",
                with.join(", ")
            )
        }
        _ => String::new(),
    };
    let hint = [renamed, place]
        .into_iter()
        .filter(|part| !part.is_empty())
        .collect::<Vec<_>>()
        .join("; ");
    (!hint.is_empty()).then_some(hint)
}
