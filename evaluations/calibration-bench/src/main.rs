//! `cargo xtask calibration-bench`: how well a rig is known after its calibration.

use evaluation::clap::{self, Parser};
use std::path::PathBuf;
use std::process::ExitCode;

/// Calibrates made-up rigs whose truth is known, and prints errors, coverage of the intervals and
/// the goals.
#[derive(Parser)]
#[command(bin_name = "cargo xtask calibration-bench")]
struct Options {
    /// Rigs.
    #[arg(long, value_name = "N", default_value_t = 1_000, value_parser = clap::value_parser!(u64).range(1..))]
    draws: u64,
    /// Write the page into this file instead of printing it.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

evaluation::test_options!(Options);

fn main() -> ExitCode {
    evaluation::run(|options: Options| {
        let page = calibration_bench::page::draw(options.draws, &mut |what| eprintln!("{what}"));
        evaluation::publish(options.markdown.as_deref(), &page)?;
        Ok(ExitCode::SUCCESS)
    })
}
