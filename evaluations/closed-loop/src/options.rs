//! The command line.

use lexopt::{Arg, Parser, ValueExt};
use std::path::PathBuf;

/// What `--help` prints; `cargo xtask closed-loop --help` as well.
pub const HELP: &str = include_str!("help.txt");

/// The command line.
pub struct Options {
    pub forcectl: PathBuf,
    pub seeds: (u64, u64),
    pub drive: String,
    pub hold: String,
    pub size: f64,
    pub out: PathBuf,
    pub markdown: Option<PathBuf>,
    pub reuse: bool,
    /// Weights on the rigs whose cells are curved or creep, in place of the identification.
    pub cells: bool,
}

/// Reads the command line; `None` for `--help`.
pub fn options() -> Result<Option<Options>, lexopt::Error> {
    let mut options = Options {
        forcectl: PathBuf::new(),
        seeds: (1, 10),
        drive: "40".to_owned(),
        hold: "16".to_owned(),
        size: 1.0,
        out: PathBuf::from("target/closed-loop"),
        markdown: None,
        reuse: false,
        cells: false,
    };
    let mut parser = Parser::from_env();
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("forcectl") => options.forcectl = parser.value()?.into(),
            Arg::Long("seeds") => options.seeds = parser.value()?.parse_with(seeds)?,
            Arg::Long("drive-duration") => options.drive = parser.value()?.string()?,
            Arg::Long("duration") => options.hold = parser.value()?.string()?,
            Arg::Long("size") => options.size = parser.value()?.parse_with(size)?,
            Arg::Long("out") => options.out = parser.value()?.into(),
            Arg::Long("reuse") => options.reuse = true,
            Arg::Long("cells") => options.cells = true,
            Arg::Long("markdown") => options.markdown = Some(parser.value()?.into()),
            Arg::Short('h') | Arg::Long("help") => return Ok(None),
            other => return Err(other.unexpected()),
        }
    }
    if options.forcectl.as_os_str().is_empty() {
        return Err("--forcectl is missing".into());
    }
    Ok(Some(options))
}

fn seeds(text: &str) -> Result<(u64, u64), String> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let seed = |t: &str| t.trim_start_matches('=').parse::<u64>().ok();
    seed(first)
        .zip(seed(last))
        .filter(|(first, last)| (1..=*last).contains(first))
        .ok_or_else(|| format!("{text}: give FIRST..LAST, whole numbers from 1"))
}

fn size(text: &str) -> Result<f64, String> {
    let size = text.parse().ok().filter(|x| (0.1..=1.0).contains(x));
    size.ok_or_else(|| format!("{text}: give 0.1 to 1"))
}
