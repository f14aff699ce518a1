//! `cargo xtask bench`: the rig's figures, printed and written as one flat JSON object.
//!
//! Times are emulated times wherever a time of the rig is meant; the only clocks on the wall are those of the
//! allocation's solve, of a stop over the service and of the emulation's speed; they depend on the machine.

mod computation;
mod controllers;
mod figures;
mod holding;
mod page;
mod rig;
mod sample_path;
mod stopping;

use computation::{allocation, fixed_point};
use controllers::controllers;
use figures::Figures;
use holding::holding;
use page::page;
use sample_path::sample_path;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stopping::stopping;

/// What `--help` prints; `cargo xtask bench --help` as well.
const HELP: &str = include_str!("help.txt");

struct Arguments {
    out: PathBuf,
    markdown: Option<PathBuf>,
    quick: bool,
}

/// Reads the command line; `None` for `--help`.
fn arguments() -> Result<Option<Arguments>, String> {
    let (mut out, mut markdown, mut quick) = (None, None, false);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut path = || {
            words
                .next()
                .map(PathBuf::from)
                .ok_or_else(|| format!("{word} needs a file\n\n{HELP}"))
        };
        match word.as_str() {
            "--out" => out = Some(path()?),
            "--markdown" => markdown = Some(path()?),
            "--quick" => quick = true,
            "-h" | "--help" => return Ok(None),
            _ => return Err(format!("{word} is not an option\n\n{HELP}")),
        }
    }
    Ok(Some(Arguments {
        out: out.ok_or_else(|| format!("--out is missing\n\n{HELP}"))?,
        markdown,
        quick,
    }))
}

fn main() -> ExitCode {
    let arguments = match arguments() {
        Ok(Some(arguments)) => arguments,
        Ok(None) => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("bench: {error}");
            return ExitCode::from(2);
        }
    };
    match bench(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench: {error}");
            ExitCode::FAILURE
        }
    }
}

fn bench(arguments: &Arguments) -> Result<(), String> {
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
    let write = |path: &PathBuf, text: String| {
        std::fs::write(path, text)
            .map_err(|error| format!("{} can't be written: {error}", path.display()))
    };
    let json = serde_json::to_string_pretty(&object).map_err(|error| error.to_string())?;
    write(&arguments.out, json + "\n")?;
    println!("written to {}", arguments.out.display());
    if let Some(path) = &arguments.markdown {
        let picture = Path::new("images/reversal.svg");
        let text =
            page(&figures, arguments.quick) + &comparison.section(&picture.to_string_lossy());
        write(path, text)?;
        println!("written to {}", path.display());
        let picture = path.with_file_name("").join(picture);
        write(&picture, comparison.picture())?;
        println!("written to {}", picture.display());
    }
    Ok(())
}
