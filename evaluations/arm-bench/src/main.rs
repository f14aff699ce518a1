//! `arm-bench`: force on two measured robot arms from joint torques, from public data.

use arm_bench::{page, psm, ur10e};
use evaluation::clap::{self, Parser};
use evaluation::publish;
use std::path::PathBuf;
use std::process::ExitCode;

/// Estimates loads of a UR10e and of a da Vinci patient-side arm from joint torques, on public
/// measured data, and prints the errors.
#[derive(Parser)]
struct Options {
    /// Clone of https://github.com/shamilmamedov/dynamic_calibration.
    #[arg(long, value_name = "DIR")]
    ur10e: PathBuf,
    /// Clone of https://github.com/WPI-AIM/dvrk_dynamics_identification.
    #[arg(long, value_name = "DIR")]
    psm: PathBuf,
    /// Write the page into this file instead of printing it.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

evaluation::test_options!(Options);

fn main() -> ExitCode {
    evaluation::run(|options: Options| {
        let mut say = |what: &str| eprintln!("{what}");
        let ur10e = ur10e::compute(&options.ur10e, &mut say).map_err(|e| e.to_string())?;
        let psm = psm::compute(&options.psm, &mut say).map_err(|e| e.to_string())?;
        publish(options.markdown.as_deref(), &page::page(&ur10e, &psm))?;
        Ok(ExitCode::SUCCESS)
    })
}
