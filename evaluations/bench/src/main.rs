//! `cargo xtask bench`: the rig's figures, printed and written as one flat JSON object.
//!
//! Times are emulated times wherever a time of the rig is meant; the only clocks on the wall are
//! those of the allocation's solve, of a stop over the service and of the emulation's speed; they
//! depend on the machine.

mod computation;
mod controllers;
mod figures;
mod holding;
mod page;
mod rig;
mod sample_path;
mod stopping;
mod study;

use computation::{allocation, fixed_point};
use controllers::controllers;
use evaluation::clap::{self, Parser};
use evaluation::write;
use figures::Figures;
use holding::holding;
use page::page;
use sample_path::sample_path;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stopping::stopping;

/// Measures the figures of the rig on the embedded rig and prints them beside their goals.
#[derive(Parser)]
// xtask gives some of the options before those of the user, which count.
#[command(bin_name = "cargo xtask bench", args_override_self = true)]
struct Arguments {
    /// Write the figures as one flat JSON object (xtask: target/bench/figures.json).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write them as a page for docs/.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// 20 emulated seconds instead of ten minutes, 5,000 allocations instead of 100,000.
    #[arg(long)]
    quick: bool,
}

evaluation::test_options!(Arguments);

fn main() -> ExitCode {
    evaluation::run(|arguments: Arguments| bench(&arguments))
}

fn bench(arguments: &Arguments) -> Result<ExitCode, String> {
    let mut figures = Figures::default();
    sample_path(&mut figures, if arguments.quick { 20 } else { 600 })?;
    fixed_point(&mut figures)?;
    holding(&mut figures)?;
    let comparison = controllers(&mut figures);
    stopping(&mut figures)?;
    allocation(&mut figures, if arguments.quick { 5_000 } else { 100_000 })?;
    let mut object = Map::new();
    for figure in &figures.0 {
        object.insert(figure.key.to_owned(), Value::from(figure.value));
    }
    let json = serde_json::to_string_pretty(&object).map_err(|error| error.to_string())?;
    write(&arguments.out, &(json + "\n"))?;
    println!("written to {}", arguments.out.display());
    if let Some(path) = &arguments.markdown {
        let picture = Path::new("images/reversal.svg");
        let text =
            page(&figures, arguments.quick) + &comparison.section(&picture.to_string_lossy());
        write(path, &text)?;
        println!("written to {}", path.display());
        let picture = path.with_file_name("").join(picture);
        write(&picture, &comparison.picture())?;
        println!("written to {}", picture.display());
    }
    Ok(ExitCode::SUCCESS)
}
