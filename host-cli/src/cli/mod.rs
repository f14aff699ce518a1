//! The command line: one file for each command, and what the commands share.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `set_force.rs`, `status.rs`, ... | a command: its arguments, what it does, what it prints |
//! | `connection.rs` | options of the commands that talk to a board (`--link`, `--rig`, ...) |
//! | `values.rs` | what reads as a number, a duration, a link |
//! | `usage.rs` | mistakes on the command line, and hints |
//! | `output.rs` | standard output and standard error; text or JSON |
//! | `exit.rs` | exit codes and failures |
//! | `interrupt.rs` | Ctrl-C, SIGTERM, SIGHUP |
//! | `progress.rs`, `watch.rs` | progress and recording of a run |

/// Adds a line to a text. A `String` takes any line, so there is no error to handle.
macro_rules! row {
    ($text:expr, $($arg:tt)*) => {{
        let _ = writeln!($text, $($arg)*);
    }};
}

mod arm;
mod bring_up;
mod calibrate;
mod check;
mod clear;
mod completions;
mod connection;
mod disarm;
#[cfg(test)]
mod documented;
#[cfg(feature = "estimate")]
mod estimate;
mod exit;
#[cfg(feature = "record")]
mod experiment;
mod explain;
mod hold;
#[cfg(feature = "residual")]
mod identify;
mod init;
#[cfg(unix)]
mod inject;
mod interrupt;
mod man;
mod monitor;
mod output;
mod progress;
#[cfg(feature = "record")]
mod record;
#[cfg(feature = "record")]
mod recording;
#[cfg(feature = "residual")]
mod residual;
#[cfg(unix)]
mod rig;
#[cfg(unix)]
mod serve;
mod set_force;
mod status;
mod stop;
mod tested;
mod usage;
mod values;
mod watch;
mod workspace;
mod zero;

use clap::{Parser, Subcommand};
use exit::{Reply, Result};
use interrupt::Interrupt;
use output::{Output, OutputArgs};
use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;

/// Command line of the force rig.
#[derive(Debug, Parser)]
#[command(name = "forcectl", version, after_help = exit::TABLE)]
struct Cli {
    #[command(flatten)]
    output: OutputArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Hold a force at the tip, and report how well
    #[command(allow_negative_numbers = true, after_help = set_force::HELP)]
    SetForce(set_force::SetForce),
    /// Show the state of board and units
    Status(status::Status),
    /// Show tensions as they come
    Monitor(monitor::Monitor),
    /// Take zeros; the cables have to be slack
    Zero(zero::Zero),
    /// Test a rig that was just wired, unit by unit, and name its mistakes
    #[command(after_help = bring_up::HELP)]
    BringUp(bring_up::BringUp),
    /// Calibrate a rig: zeros, gains, geometry, and how well the force is known
    #[command(after_help = calibrate::HELP)]
    Calibrate(calibrate::Calibrate),
    /// Show which forces are feasible where, and where the units should stand
    Workspace(workspace::Workspace),
    /// Keep an emulated rig that many commands and terminals can use, until Ctrl-C
    #[cfg(unix)]
    Rig(rig::Rig),
    /// Own the link to a board and let many clients share it; other commands start it by themselves
    #[cfg(unix)]
    Serve(serve::Serve),
    /// Arm and hold tensions until Ctrl-C
    Hold(hold::Hold),
    /// Arm, and let the rig's service hold the least tensions until `disarm`
    Arm(arm::Arm),
    /// Ramp the torques down
    Disarm(disarm::Disarm),
    /// Set all motors to 0 V at once, latched until `clear`; works from every terminal
    Stop(stop::Stop),
    /// Clear latched faults whose cause is gone; arms nothing
    Clear(clear::Clear),
    /// Cause a fault in an emulated rig that is kept
    #[cfg(unix)]
    Inject(inject::Inject),
    /// Explain a fault: what it means and how to clear it
    Explain(explain::Explain),
    /// Check a rig file
    Check(check::Check),
    /// Make a rig file from the answers to ten questions
    #[command(after_help = init::HELP)]
    Init(init::Init),
    /// Record every sample and drive nothing (to record a force: set-force --record DIR)
    #[cfg(feature = "record")]
    Record(record::Record),
    /// Check a recording, write its Parquet files, or join it with a robot's log
    #[cfg(feature = "record")]
    #[command(after_help = recording::HELP)]
    Recording(recording::Recording),
    /// Run an experiment: trials with a moving robot and a known force, as one dataset
    #[cfg(feature = "record")]
    #[command(after_help = experiment::HELP)]
    Experiment(experiment::ExperimentCommand),
    /// Estimate the contact force from a robot's state: train, evaluate, run
    #[cfg(feature = "estimate")]
    #[command(after_help = estimate::HELP)]
    Estimate(estimate::Estimate),
    /// Find what a force model lacks, from logs; drives nothing
    #[cfg(feature = "residual")]
    #[command(after_help = residual::HELP)]
    Residual(residual::Residual),
    /// Find what the rig file lacks on this rig, correct it, and measure whether that is better
    #[cfg(feature = "residual")]
    #[command(allow_negative_numbers = true, after_help = identify::HELP)]
    Identify(identify::Identify),
    /// Print a completion script for a shell
    Completions(completions::Completions),
    /// Write manual pages
    Man(man::Man),
}

/// What every command has.
struct Context {
    output: Arc<Output>,
    interrupt: Interrupt,
}

/// Runs the command line.
pub fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().collect();
    #[cfg(unix)]
    if arguments.iter().any(|argument| argument == "stop") {
        service::stop::hurry();
    }
    let cli = match usage::parse(&arguments) {
        Ok(cli) => cli,
        Err(code) => return ExitCode::from(code),
    };
    let output = Arc::new(Output::new(cli.output));
    let result = run(&cli.command, &output);
    ExitCode::from(output.finish(&result))
}

/// Runs a command. A command that Ctrl-C ended has one exit code, whatever it did until then.
fn run(command: &Command, output: &Arc<Output>) -> Result<Reply> {
    let context = Context {
        output: Arc::clone(output),
        interrupt: Interrupt::install(output)?,
    };
    let interrupted = || context.interrupt.requested();
    match dispatch(command, &context) {
        Ok(reply) if interrupted() => Ok(reply.with_code(exit::INTERRUPTED)),
        // What did not answer after a signal was no longer waited for. A fault of the board or a
        // lost file keeps its code.
        Err(failure) if interrupted() && failure.code == exit::LINK => {
            Err(failure.with_code(exit::INTERRUPTED))
        }
        result => result,
    }
}

fn dispatch(command: &Command, context: &Context) -> Result<Reply> {
    match command {
        Command::SetForce(command) => command.run(context),
        Command::Status(command) => command.run(context),
        Command::Monitor(command) => command.run(context),
        Command::Zero(command) => command.run(context),
        Command::BringUp(command) => command.run(context),
        Command::Calibrate(command) => command.run(context),
        Command::Workspace(command) => command.run(context),
        #[cfg(unix)]
        Command::Rig(command) => command.run(context),
        #[cfg(unix)]
        Command::Serve(command) => command.run(context),
        #[cfg(unix)]
        Command::Inject(command) => command.run(context),
        Command::Hold(command) => command.run(context),
        Command::Arm(command) => command.run(context),
        Command::Disarm(command) => command.run(context),
        Command::Stop(command) => command.run(context),
        Command::Clear(command) => command.run(context),
        Command::Explain(command) => command.run(),
        Command::Check(command) => command.run(context),
        Command::Init(command) => command.run(context),
        #[cfg(feature = "record")]
        Command::Record(command) => command.run(context),
        #[cfg(feature = "record")]
        Command::Recording(command) => command.run(context),
        #[cfg(feature = "record")]
        Command::Experiment(command) => command.run(context),
        #[cfg(feature = "estimate")]
        Command::Estimate(command) => command.run(context),
        #[cfg(feature = "residual")]
        Command::Residual(command) => command.run(context),
        #[cfg(feature = "residual")]
        Command::Identify(command) => command.run(context),
        Command::Completions(command) => command.run(context),
        Command::Man(command) => command.run(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;
    use std::collections::BTreeSet;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    /// Adds the commands that may start an embedded rig: those with its option `--usb`.
    fn add_emulating(command: &clap::Command, path: &str, found: &mut BTreeSet<String>) {
        if (command.get_arguments()).any(|argument| argument.get_long() == Some("usb")) {
            found.insert(path.to_owned());
        }
        for step in command.get_subcommands() {
            let path = format!("{path} {}", step.get_name());
            add_emulating(step, path.trim_start(), found);
        }
    }

    #[test]
    fn the_list_of_commands_that_start_a_rig_is_complete() {
        let mut found = BTreeSet::new();
        add_emulating(&Cli::command(), "", &mut found);
        let listed = include_str!("../../emulating.txt")
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| line.trim_start_matches("not ").to_owned())
            .collect();
        assert_eq!(found, listed);
    }
}
