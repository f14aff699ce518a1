//! `instrument-bench`: the torque at the jaw of da Vinci instruments, from public measured data.

use evaluation::clap::{self, Parser};
use evaluation::{publish, write};
use instrument_bench::{page, picture, results};
use std::path::PathBuf;
use std::process::ExitCode;

/// Estimates the torque at the jaw of da Vinci instruments from motor current and positions, on
/// public measured data, and prints the errors.
#[derive(Parser)]
struct Options {
    /// Clone of https://github.com/MRDLab/mis-tool-characterization (Open Database License), or its
    /// folder `data`.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Write the page into this file instead of printing it.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Write the pictures (SVG) into this folder.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

evaluation::test_options!(Options);

fn main() -> ExitCode {
    evaluation::run(|options: Options| run(&options))
}

fn run(options: &Options) -> Result<ExitCode, String> {
    let results = results::compute(&options.data, &mut |what| eprintln!("{what}"))
        .map_err(|e| e.to_string())?;
    if let Some(folder) = &options.pictures {
        std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        let (time, load) = (picture::over_time(&results), picture::by_load(&results));
        write(&folder.join("instruments-time.svg"), &time)?;
        write(&folder.join("instruments-load.svg"), &load)?;
    }
    publish(options.markdown.as_deref(), &page::page(&results))?;
    Ok(ExitCode::SUCCESS)
}
