//! Developer commands: `cargo xtask COMMAND`.
//!
//! Plain cargo can't do three things that this project needs: find a compiler for the board, build
//! the emulator with `--ignore-rust-version`, and sum up tests of all kinds in one line. xtask does
//! them by starting cargo; see docs/developing.md.

mod book;
mod comments;
mod elf;
mod experiment;
mod firmware;
mod flash;
mod help;
mod image_mutants;
mod inspect;
mod install;
mod links;
mod measured;
mod mutants;
mod optional;
mod process;
mod pypi;
mod python;
mod renode;
mod report;
mod rig;
mod rust_version;
mod side_by_side;
mod suite;
mod tally;
mod tested_mutants;
mod toolchain;
mod workspace;

use std::ffi::OsString;
use std::process::ExitCode;

use lexopt::{Arg, Parser, ValueExt};

use report::{say, Failure};
use toolchain::setup;
use workspace::Workspace;

/// Why xtask ends early.
enum Stop {
    /// The command line is wrong.
    Usage(String),
    /// Something couldn't be done.
    Failed(Failure),
}

impl From<lexopt::Error> for Stop {
    fn from(error: lexopt::Error) -> Self {
        Self::Usage(error.to_string())
    }
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Self::Failed(failure)
    }
}

fn main() -> ExitCode {
    match dispatch() {
        Ok(code) => ExitCode::from(code),
        Err(Stop::Usage(message)) => {
            eprintln!("xtask: {message}\nSee `cargo xtask help`.");
            ExitCode::from(2)
        }
        Err(Stop::Failed(failure)) => {
            eprintln!("xtask: error: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn dispatch() -> Result<u8, Stop> {
    let workspace = Workspace::locate();
    let mut parser = Parser::from_env();
    let command = match parser.next()? {
        None => {
            return Err(Stop::Usage("a command is missing".into()));
        }
        Some(Arg::Short('h') | Arg::Long("help")) => "help".to_string(),
        Some(Arg::Value(word)) => word.to_string_lossy().into_owned(),
        Some(other) => return Err(other.unexpected().into()),
    };
    let after: Vec<OsString> = std::env::args_os().skip(2).collect();
    if !help::is_of_program(&command) && help::is_requested(&after) {
        if let Some(page) = help::page(&command) {
            print!("{page}");
            return Ok(0);
        }
    }
    match command.as_str() {
        "setup" => run_setup(&workspace, parser),
        "build" | "size" => {
            no_more(parser)?;
            let arm = setup::ensure(&workspace, setup::route_from_environment()?)?;
            let image = firmware::build(&workspace, &arm)?;
            firmware::print_size(&workspace, &image);
            Ok(0)
        }
        "inspect" => {
            no_more(parser)?;
            build_image(&workspace)?;
            inspect::run(&workspace)?;
            Ok(0)
        }
        "build-rig" => {
            no_more(parser)?;
            rig::build(&workspace, &["rig", "forcectl"])?;
            Ok(0)
        }
        "install" => run_install(&workspace, parser),
        "flash" => run_flash(&workspace, parser),
        "forcectl" => Ok(rig::forcectl(&workspace, &rest(parser)?)?),
        "test" | "ci" => run_tests(&workspace, parser),
        "renode-test" => run_renode_tests(&workspace, parser),
        "mutants" => run_mutants(&workspace, parser),
        "agree" => {
            let renode = renode::require(&workspace)?;
            build_image(&workspace)?;
            Ok(renode::agree(&workspace, &renode, &rest(parser)?)?)
        }
        "bench" => Ok(rig::bench(&workspace, &rest(parser)?)?),
        "fuzz" => run_fuzz(&workspace, parser),
        "faults" => Ok(rig::faults(&workspace, &rest(parser)?)?),
        "closed-loop" => Ok(rig::closed_loop(&workspace, &rest(parser)?)?),
        "calibration-bench" | "residual-bench" => {
            Ok(rig::evaluation(&workspace, &command, &rest(parser)?)?)
        }
        "experiment-report" => Ok(experiment::report(&workspace, &rest(parser)?)?),
        "residual-report" => Ok(measured::report(&workspace, &rest(parser)?)?),
        "residual-compare" => Ok(measured::compare(&workspace, &rest(parser)?)?),
        "deny" => {
            no_more(parser)?;
            if !optional::run(&workspace, &optional::DENY)? {
                say(format!(
                    "cargo-deny is not installed ({}), skipped",
                    optional::DENY.install
                ));
            }
            Ok(0)
        }
        "msrv" => {
            no_more(parser)?;
            rust_version::compile(&workspace)?;
            Ok(0)
        }
        "book" => {
            book::build(&workspace, &rest(parser)?)?;
            Ok(0)
        }
        "doc" => {
            let arguments = rest(parser)?;
            process::run(
                process::cargo(process::Sees::CompilerAndFlags)
                    .current_dir(workspace.root())
                    .args(["doc", "--no-deps", "--target-dir"])
                    .arg(workspace.target())
                    .args(arguments),
            )?;
            Ok(0)
        }
        "help" => print_help(parser),
        side_by_side::RUNNER => Ok(side_by_side::note(&rest(parser)?)?),
        other => Err(not_a_command(other)),
    }
}

fn not_a_command(word: &str) -> Stop {
    Stop::Usage(format!("`{word}` is not a command"))
}

fn print_help(parser: Parser) -> Result<u8, Stop> {
    match rest(parser)?.first() {
        None => print!("{}", help::list()),
        Some(word) => {
            let word = word.to_string_lossy();
            print!("{}", help::page(&word).ok_or_else(|| not_a_command(&word))?);
        }
    }
    Ok(0)
}

fn run_setup(workspace: &Workspace, mut parser: Parser) -> Result<u8, Stop> {
    let mut route = setup::route_from_environment()?;
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("toolchain") => {
                let word = parser.value()?;
                route = setup::route(Some(&word.to_string_lossy()))?;
            }
            Arg::Long("retry") => setup::forget(workspace)?,
            other => return Err(other.unexpected().into()),
        }
    }
    let arm = setup::ensure(workspace, route)?;
    say(format!("ARM toolchain: ready: {arm}"));
    Ok(0)
}

fn run_install(workspace: &Workspace, mut parser: Parser) -> Result<u8, Stop> {
    let mut prefix = None;
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("prefix") => prefix = Some(parser.value()?.into()),
            other => return Err(other.unexpected().into()),
        }
    }
    install::install(workspace, prefix)?;
    Ok(0)
}

fn run_flash(workspace: &Workspace, mut parser: Parser) -> Result<u8, Stop> {
    let mut options = flash::Options::default();
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("run") => options.run = true,
            Arg::Long("under-reset") => options.under_reset = true,
            other => return Err(other.unexpected().into()),
        }
    }
    flash::flash(workspace, options)?;
    Ok(0)
}

fn run_tests(workspace: &Workspace, mut parser: Parser) -> Result<u8, Stop> {
    let mut options = suite::Options::default();
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("verbose") | Arg::Short('v') => options.verbose = true,
            Arg::Long("list") => {
                for (name, title) in suite::catalogue() {
                    println!("{name:<12}{title}");
                }
                return Ok(0);
            }
            Arg::Value(name) => options.steps.push(name.to_string_lossy().into_owned()),
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(u8::from(!suite::run(workspace, &options)?))
}

/// Cases of each test of `cargo xtask fuzz`.
const FUZZ_CASES: &str = "20000";

fn run_fuzz(workspace: &Workspace, mut parser: Parser) -> Result<u8, Stop> {
    let (mut cases, mut seed) = (FUZZ_CASES.to_owned(), "1".to_owned());
    let mut minutes = 0;
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("cases") => cases = parser.value()?.parse::<u32>()?.to_string(),
            Arg::Long("seed") => seed = parser.value()?.parse::<u32>()?.to_string(),
            Arg::Long("minutes") => minutes = parser.value()?.parse::<u32>()?,
            other => return Err(other.unexpected().into()),
        }
    }
    let mut command = process::cargo(process::Sees::CompilerAndFlags);
    command
        .current_dir(workspace.root())
        .args(["test", "--package", "fuzz", "--target-dir"])
        .arg(workspace.target())
        .env("FORCE_FUZZ_CASES", cases)
        .env("FORCE_FUZZ_SEED", seed);
    if minutes > 0 {
        // One target after the other, each for so long; its number of cases is what it prints.
        command
            .env("FORCE_FUZZ_MINUTES", minutes.to_string())
            .args(["--test", "frames", "--test", "files"])
            .args(["--", "--nocapture", "--test-threads=1"]);
    }
    process::run(&mut command)?;
    Ok(0)
}

fn build_image(workspace: &Workspace) -> Result<(), Failure> {
    let arm = setup::ensure(workspace, setup::route_from_environment()?)?;
    firmware::build(workspace, &arm).map(|_| ())
}

fn run_renode_tests(workspace: &Workspace, parser: Parser) -> Result<u8, Stop> {
    let mut arguments = rest(parser)?;
    if arguments.iter().any(|argument| argument == "--install") {
        arguments.retain(|argument| argument != "--install");
        renode::install(workspace)?;
    }
    let renode = renode::require(workspace)?;
    build_image(workspace)?;
    let tally = renode::run(workspace, &renode, &arguments)?;
    println!("{tally}");
    Ok(u8::from(tally.failed > 0))
}

fn run_mutants(workspace: &Workspace, mut parser: Parser) -> Result<u8, Stop> {
    let (mut machine, mut names) = (image_mutants::Machine::Rig, Vec::new());
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("renode") => machine = image_mutants::Machine::Renode,
            Arg::Value(name) => names.push(name.to_string_lossy().into_owned()),
            other => return Err(other.unexpected().into()),
        }
    }
    let arm = setup::ensure(workspace, setup::route_from_environment()?)?;
    Ok(u8::from(!image_mutants::run(
        workspace, &arm, machine, &names,
    )?))
}

/// The remaining arguments, unchanged, for another program.
fn rest(mut parser: Parser) -> Result<Vec<OsString>, Stop> {
    Ok(parser.raw_args()?.collect())
}

fn no_more(mut parser: Parser) -> Result<(), Stop> {
    match parser.next()? {
        None => Ok(()),
        Some(other) => Err(other.unexpected().into()),
    }
}
