//! What can be typed.

use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;
use emulator_link::Injection;
use host_cli::rigfile::LinkChoice;
use std::path::PathBuf;

/// Below the help of every command.
const EXIT_CODES: &str = "\
Exit codes:
  0  done as asked
  2  the arguments are wrong; nothing was driven
  3  the rig file is wrong; nothing was driven
  4  the link can't be opened, was lost, or the other end is no board of this version
  5  the board refused, or a fault stopped the rig
  6  done, but not as asked: a unit dropped out, the amplifiers lost power, or the force is out of
     reach and the nearest one was held
  7  a file could not be written
130  ended by Ctrl-C; the rig was disarmed";

#[derive(Debug, Parser)]
#[command(name = "forcectl", version, about = "Command line of the force rig", after_help = EXIT_CODES, disable_help_subcommand = true)]
pub struct Cli {
    #[command(flatten)]
    pub global: Global,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Args)]
pub struct Global {
    /// How the board is reached: embedded, usb, or serial:PORT. Default: the rig file's
    #[arg(long, global = true, value_name = "LINK")]
    pub rig: Option<LinkChoice>,
    /// Rig file (TOML). Default: the built-in example rig
    #[arg(long, global = true, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Seed of everything random in the embedded rig
    #[arg(long, global = true, value_name = "N")]
    pub seed: Option<u64>,
    /// Configuration of the embedded rig's physics (TOML). Default: the rig of the thesis
    #[arg(long, global = true, value_name = "FILE")]
    pub plant: Option<PathBuf>,
    /// Let the embedded rig run no faster than real time
    #[arg(long, global = true)]
    pub paced: bool,
    /// Print one JSON object instead of words and tables
    #[arg(long, global = true)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Hold a force at the tip, and report how well
    #[command(allow_negative_numbers = true, after_help = SET_FORCE_HELP)]
    SetForce(SetForce),
    /// Show the state of board and units
    Status,
    /// Show tensions as they come
    Monitor {
        /// End after this many seconds; default: at Ctrl-C (embedded rig: 3)
        #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
        seconds: Option<f64>,
    },
    /// Send the rig file's configuration and take zeros; the cables have to be slack
    Zero,
    /// Let the motors act on setpoints
    Arm,
    /// Ramp the torques down
    Disarm,
    /// 0 V on all motors now, latched until `clear`
    Stop,
    /// Forget latched faults whose cause is gone; does not arm
    Clear,
    /// Explain a fault: what it means and how to leave it
    Explain {
        /// Number of the fault; without it, all are listed
        number: Option<u16>,
    },
    /// Check a rig file
    Check {
        /// The rig file
        #[arg(required_unless_present = "print")]
        file: Option<PathBuf>,
        /// Print the built-in rig file, to start your own from
        #[arg(long)]
        print: bool,
    },
    /// Record every sample, driving nothing (to record a force: set-force --record DIR)
    #[cfg(feature = "record")]
    Record {
        /// Folder for the recording
        folder: PathBuf,
        /// End after this many seconds; default: at Ctrl-C (embedded rig: 3)
        #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
        seconds: Option<f64>,
    },
    /// Find what a force model lacks, from logs; drives nothing
    #[cfg(feature = "residual")]
    #[command(after_help = RESIDUAL_HELP)]
    Residual(Residual),
    /// Find what the rig file lacks on this rig, correct it, and see whether it was better
    #[cfg(feature = "residual")]
    #[command(allow_negative_numbers = true, after_help = IDENTIFY_HELP)]
    Identify(Identify),
    /// Print completions for a shell
    Completions {
        /// The shell
        shell: Shell,
    },
}

#[cfg(feature = "residual")]
const RESIDUAL_HELP: &str = "\
Data: a path that does not exist as given is looked for below the folder of data, which is the environment
variable FORCE_DATA, else ./data, else ../shared/data. Without --data all of that folder is read.

--apply changes friction, gain, offset, viscous friction (speed in m/s or mm/s) and, for a delay, the loop's gains, where
found, in all units; it says what it changed and what the board can't use. Ripples need the board's own angle:
`forcectl identify` finds them. Nothing is changed where structure without a name is left that would take more than a
tenth of what the findings took off the error. Read the changes before you arm.

Exit codes:
  0  analysed, whatever the verdict
  2  the arguments or the model file are wrong
  3  a log or the rig file can't be read
  4  the logs can't answer: too few rows, one group, constant excitation, terms that repeat each other
  6  analysed, but the board can use nothing of it (--apply wrote no rig file)
  7  a report or rig file could not be written";

#[cfg(feature = "residual")]
#[derive(Debug, Args)]
pub struct Residual {
    /// Logs (CSV, gzip, JSON, Parquet) or folders of them
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pub data: Vec<PathBuf>,
    /// The model file (TOML): columns, units, declared terms
    #[arg(long, value_name = "MODEL.toml")]
    pub model: PathBuf,
    /// Folder for the reports and the extended model
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Write a copy of this rig file, with what the board can use, to DIR as NAME.residual.toml
    #[arg(long, value_name = "RIG.toml")]
    pub apply: Option<PathBuf>,
    /// With --apply: the model declares what the rig file says already; add to its values
    #[arg(long, requires = "apply")]
    pub increment: bool,
}

#[cfg(feature = "residual")]
const IDENTIFY_HELP: &str = "\
Three sessions on the rig: a force is held with the rig file as it is; the cables are driven to and fro with the
tension loops open, which is recorded and analysed; the same force is held with what the board can use of the
findings. The robot has to move all along (an embedded rig's does), and the cables have to be slack at the start
of each session, where zeros are taken.

The corrected rig file is written to DIR as rig.after.toml beside rig.before.toml, whatever comes of it. --apply
also puts it in the place of --config FILE, keeping the old one as FILE.before-N, but only where the findings were
clear and the last session was better than the first: the worst cable's tension by 2 %, the tip by no less than 5 %
worse.

Exit codes:
  0  something was found, corrected, and better for it (and applied where asked)
  2  the arguments are wrong; nothing was driven
  3  the rig file is wrong; nothing was driven
  4  the link can't be opened, was lost, or the other end is no board of this version
  5  the board refused, or a fault stopped the rig
  6  done, but nothing was changed: nothing clear was found, the board can't use it, or it was no better
  7  a file could not be written
  8  the recording can't answer";

#[cfg(feature = "residual")]
#[derive(Debug, Args)]
pub struct Identify {
    /// Folder for recordings, reports, plots and rig files; made where it isn't there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// How long the cables are driven for the recording
    #[arg(long, value_name = "SECONDS", default_value = "40", value_parser = seconds)]
    pub seconds: f64,
    /// Force that is held before and after, N along x, y and z
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], default_values = ["0", "2.5", "0"], allow_hyphen_values = true, value_parser = newton)]
    pub force: Vec<f64>,
    /// How long that force is held
    #[arg(long = "for", value_name = "SECONDS", default_value = "16", value_parser = seconds)]
    pub hold: f64,
    /// Put the corrected rig file in the place of --config FILE, where it was better
    #[arg(long)]
    pub apply: bool,
}

const SET_FORCE_HELP: &str = "\
The force is in newtons in the robot's base frame, as in `forcectl set-force 0 2.5 0`.

On a real rig the robot's pose comes from where [pose] of the rig file says: source = \"udp\" listens for JSON lines
as in {\"measured_cp\": {\"position\": [-0.08, 0.025, -0.14]}} (metres, robot base frame, 100 Hz or faster);
source = \"static\" takes a clamped tip.

Exit codes: see `forcectl --help`.";

#[derive(Debug, Args)]
pub struct SetForce {
    /// Force along x, N
    #[arg(allow_hyphen_values = true, value_parser = newton)]
    pub x: f64,
    /// Force along y, N
    #[arg(allow_hyphen_values = true, value_parser = newton)]
    pub y: f64,
    /// Force along z, N
    #[arg(allow_hyphen_values = true, value_parser = newton)]
    pub z: f64,
    /// How long the force is held
    #[arg(long = "for", value_name = "SECONDS", default_value = "5", value_parser = seconds)]
    pub seconds: f64,
    /// Keep the embedded rig's robot still
    #[arg(long)]
    pub still: bool,
    /// Break something in the embedded rig, as in unplug=3@2s; may be given several times. See `--inject help`
    #[arg(long, value_name = "WHAT@TIME", value_parser = host_cli::inject::parse, allow_hyphen_values = true)]
    pub inject: Vec<(f64, Injection)>,
    /// Folder for the plot (SVG) and the figures (JSON)
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    pub out: PathBuf,
    /// Record every sample to this folder (MCAP and Parquet)
    #[cfg(feature = "record")]
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
}

/// A force component: any number that reads as one; the rig's limits are checked with the rig file.
fn newton(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .parse()
        .map_err(|_| format!("`{text}` is no number; give newtons, as in 2.5"))?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(format!(
            "`{text}` is no force; give a finite number of newtons, as in 2.5. Nothing was driven"
        ))
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    text.trim_end_matches('s')
        .parse::<f64>()
        .ok()
        .filter(|s| (0.1..=86_400.0).contains(s))
        .ok_or_else(|| format!("`{text}` is no time; give 0.1 to 86400 seconds"))
}
