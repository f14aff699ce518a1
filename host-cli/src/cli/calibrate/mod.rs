//! `forcectl calibrate`: from weights, a digitizer and a moving tip to a rig that is known, and how
//! well.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `zero.rs` | `zero` |
//! | `gain.rs` | `gain` |
//! | `geometry.rs` | `geometry` |
//! | `moving.rs` | `self`, `verify` |
//! | `check.rs` | `check` |
//! | `check_tip.rs` | `check --at tip` |
//! | `certificate.rs` | `certificate` |
//! | `records.rs` | `show`, `diff`, `use`, `push` |
//! | `series.rs` | the readings of `gain` |
//! | `standards.rs` | weights and place |
//! | `serials.rs` | `serials` |
//! | `guide.rs` | questions to the user |

mod certificate;
mod check;
mod check_tip;
pub(super) mod gain;
mod geometry;
pub(super) mod guide;
mod moving;
mod records;
mod serials;
mod series;
mod standards;
mod zero;

use super::connection::Connection;
use super::exit::{self, Failure, Reply, Result};
use super::Context;
use calibrate::standin::Mistake;
use calibrate::CalibrateError;
use clap::{Args, Subcommand};
use emulator_link::Injection;
use known::base;
use known::store::{Kept, Store};
use rig::Rig;
use session::Session;
use std::path::{Path, PathBuf};

/// Options of the steps that a user does by hand, reading by reading or point by point.
#[derive(Debug, Args)]
struct ByHand {
    /// Begin anew instead of going on with what is kept of a step that was broken off
    #[arg(long)]
    restart: bool,
    /// Ask nothing: with a file of readings or points, or on an emulated rig, where a stand-in does
    /// what the user does
    #[arg(long)]
    yes: bool,
    /// Mistake of the stand-in: weight=50:500 (500 g is hung for 50 g, once), bump=B:3 (station B
    /// is bumped by 3 mm); repeatable
    #[arg(long, value_name = "MISTAKE")]
    inject: Vec<Mistake>,
    /// Folder for the pictures of the residuals
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    out: PathBuf,
    #[command(flatten)]
    connection: Connection,
}

impl ByHand {
    /// Refuses what only a stand-in can do on a rig without one. `file`: the option that gives the
    /// readings from a file, and who would have to be there without it.
    fn check(&self, emulated: bool, file: (&str, &str)) -> Result<()> {
        let (option, nobody) = file;
        let wrong = match (emulated, self.yes, self.inject.is_empty()) {
            (true, _, _) | (false, false, true) => return Ok(()),
            (false, true, _) => {
                format!("--yes needs {option} FILE here: nobody {nobody} unattended")
            }
            (false, false, false) => "--inject works with an emulated rig only".to_owned(),
        };
        Err(Failure::usage(wrong))
    }
}

/// Below the help of the command.
pub const HELP: &str = "\
Order on a new rig: geometry, gain, zero, verify. Every step can be broken off; the same command goes on where it stopped.

  forcectl calibrate gain --link fast --yes

calibrates an emulated rig; stand-ins hang the weights and touch the points. docs/calibration.md is the guide.";

/// Arguments of `calibrate`.
#[derive(Debug, Args)]
pub struct Calibrate {
    #[command(subcommand)]
    step: Step,
}

#[derive(Debug, Subcommand)]
enum Step {
    /// Take the zeros with slack cables, and compare them with earlier power-ups
    Zero(zero::Zero),
    /// Find newtons per code from weights
    #[command(allow_negative_numbers = true)]
    Gain(Box<gain::Gain>),
    /// Find exit points and load-cell axes from points of a digitizer
    Geometry(geometry::Geometry),
    /// Find exit points from a run with the robot moving, and whether the rig was moved
    #[command(name = "self")]
    Moving(moving::Moving),
    /// Hold forces, and compare what the calibration predicts with what is measured
    Verify(moving::Verify),
    /// Check the calibration with one known weight on cells or tip, and keep the history
    Check(check::Check),
    /// Write a calibration as a page to print and sign, and as JSON
    Certificate(certificate::Certificate),
    /// Set and show the serial numbers of units, motors, cells and converters
    Serials(serials::Command),
    /// Show a calibration
    Show(records::Show),
    /// Compare two calibrations
    Diff(records::Diff),
    /// Put an older version in force again
    Use(records::Use),
    /// Send the calibration to the board, read it back and compare
    Push(records::Push),
}

impl Calibrate {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        match &self.step {
            Step::Zero(step) => step.run(context),
            Step::Gain(step) => step.run(context),
            Step::Geometry(step) => step.run(context),
            Step::Moving(step) => step.run(context),
            Step::Verify(step) => step.run(context),
            Step::Check(step) => step.run(context),
            Step::Certificate(step) => step.run(context),
            Step::Serials(step) => step.run(context),
            Step::Show(step) => step.run(context),
            Step::Diff(step) => step.run(context),
            Step::Use(step) => step.run(context),
            Step::Push(step) => step.run(context),
        }
    }
}

impl From<CalibrateError> for Failure {
    fn from(error: CalibrateError) -> Self {
        match error {
            CalibrateError::Run(error) => error.into(),
            CalibrateError::Input(_) => Self::new(exit::USAGE, error),
            CalibrateError::Refused(_) => Self::new(exit::DEGRADED, error),
            CalibrateError::ReadBack(_) => Self::new(exit::BOARD, error),
            CalibrateError::Store(error) => error.into(),
        }
    }
}

/// A rig with its store and the record that a step changes.
struct Bench {
    rig: Rig,
    store: Store,
    record: calibration::record::Record,
}

impl Bench {
    /// Loads rig file and stored calibration. Opens nothing that drives.
    fn load(connection: &Connection, context: &Context) -> Result<Self> {
        let rig = connection.load(context)?;
        connection.require_rig_file(&rig)?;
        let store = Store::of_rig(&rig.name, connection.seed(&rig))?;
        let record = base::continued(&rig, store.current()?, &known::today())
            .map_err(|why| Failure::new(exit::RIG_FILE, why))?;
        Ok(Self { rig, store, record })
    }

    /// The same for a step that drives the rig or stores what it measures of it: refuses one of
    /// which a part was exchanged since its bring-up.
    fn tested(connection: &Connection, context: &Context) -> Result<Self> {
        let bench = Self::load(connection, context)?;
        connection.require_unchanged(context)?;
        Ok(bench)
    }

    /// The rig with what the record has measured.
    fn calibrated(&self) -> Rig {
        base::overlay(&self.rig, &self.record)
    }

    /// Stores the record.
    fn keep(&self, context: &Context) -> Result<Kept> {
        let kept = self.store.keep(&self.record)?;
        context.output.note(&format!(
            "stored as version {} in {}",
            kept.version,
            kept.path.display()
        ));
        Ok(kept)
    }
}

/// Pulls on the cells of a group of an emulated rig.
fn hang(session: &mut Session<'_>, group: &[u8], force_n: f64) -> Result<()> {
    if let Some(controls) = session.link().controls() {
        for unit in group {
            controls.inject(Injection::PullCable(*unit, force_n))?;
        }
    }
    Ok(())
}

/// Writes a picture into the folder for output.
pub(super) fn picture(out: &Path, name: &str, svg: &str) -> Result<PathBuf> {
    let path = out.join(name);
    std::fs::create_dir_all(out)
        .and_then(|()| std::fs::write(&path, svg))
        .map_err(|error| Failure::file(&path, error))?;
    Ok(path)
}

/// The text of a file that the user names; `-`: standard input.
fn read(path: &Path) -> Result<(String, String)> {
    let name = path.display().to_string();
    let text = if name == "-" {
        std::io::read_to_string(std::io::stdin())
    } else {
        files::read_text(path)
    };
    text.map(|text| (name.clone(), text)).map_err(|error| {
        let why = if error.kind() == std::io::ErrorKind::InvalidData {
            "the text is not UTF-8; save it as CSV UTF-8".to_owned()
        } else {
            error.to_string()
        };
        Failure::usage(format!("{name}: {why}; nothing was stored"))
    })
}
