//! The command line.

use crate::effect::Effects;
use evaluation::clap::{self, Parser};
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Finds, declares and re-runs undeclared effects for each seed, with `forcectl identify` on the
/// embedded rig.
#[derive(Parser)]
// xtask gives some of the options before those of the user, which count.
#[command(bin_name = "cargo xtask closed-loop", args_override_self = true)]
pub struct Options {
    /// Seeds to run, both included; ten in a row have each kind of effect once, four in a row with
    /// `--effects more`.
    #[arg(long, value_name = "A..B", default_value = "1..10", value_parser = seeds)]
    pub seeds: RangeInclusive<u64>,
    /// One effect in all units, one in one unit, two in all units, or one of the further kinds.
    #[arg(long, value_enum, value_name = "WHICH", default_value = "all")]
    pub effects: Effects,
    /// Length of the recorded session in seconds.
    #[arg(long = "drive-duration", value_name = "S", default_value = "40")]
    pub drive: String,
    /// Time for which the force is held before and after, in seconds.
    #[arg(long = "duration", value_name = "S", default_value = "16")]
    pub hold: String,
    /// Factor on the drawn sizes, 0.1 to 1.
    #[arg(long, value_name = "F", default_value = "1", value_parser = size)]
    pub size: f64,
    /// The rig: `embedded` runs the whole image, `fast` the firmware's own core, many times faster.
    #[arg(long, value_name = "RIG", default_value = "embedded", value_parser = ["embedded", "fast"])]
    pub link: String,
    /// Folder for plant files, recordings and reports.
    #[arg(long, value_name = "DIR", default_value = "target/closed-loop")]
    pub out: PathBuf,
    /// The seeds whose load cells are curved or creep, with weights in place of the identification.
    #[arg(long)]
    pub cells: bool,
    /// Write the table to FILE as well.
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,
    /// Read the reports that an earlier run left in DIR, and run nothing (to join several runs).
    #[arg(long)]
    pub reuse: bool,
    /// The program forcectl; xtask gives it.
    #[arg(long, value_name = "PROGRAM")]
    pub forcectl: PathBuf,
}

evaluation::test_options!(Options);

fn seeds(text: &str) -> Result<RangeInclusive<u64>, String> {
    let seeds = evaluation::seeds(text)?;
    if *seeds.start() == 0 {
        return Err("seeds begin with 1".to_owned());
    }
    Ok(seeds)
}

fn size(text: &str) -> Result<f64, String> {
    let size = text.parse().ok().filter(|x| (0.1..=1.0).contains(x));
    size.ok_or_else(|| "give 0.1 to 1".to_owned())
}
