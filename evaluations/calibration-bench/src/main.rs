//! `cargo xtask calibration-bench`: how well a rig is known after its calibration.

use lexopt::{Arg, Parser, ValueExt};
use std::path::PathBuf;
use std::process::ExitCode;

const HELP: &str = include_str!("help.txt");

struct Options {
    draws: u64,
    markdown: Option<PathBuf>,
}

fn options() -> Result<Option<Options>, lexopt::Error> {
    let mut out = Options {
        draws: 1000,
        markdown: None,
    };
    let mut parser = Parser::from_env();
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("draws") => {
                out.draws = parser.value()?.parse()?;
                if out.draws == 0 {
                    return Err("--draws has to be 1 or more".into());
                }
            }
            Arg::Long("markdown") => out.markdown = Some(parser.value()?.into()),
            Arg::Short('h') | Arg::Long("help") => return Ok(None),
            other => return Err(other.unexpected()),
        }
    }
    Ok(Some(out))
}

fn main() -> ExitCode {
    let options = match options() {
        Ok(Some(options)) => options,
        Ok(None) => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("calibration-bench: {error}\nSee --help.");
            return ExitCode::from(2);
        }
    };
    let page = calibration_bench::page::draw(options.draws, &mut |what| eprintln!("{what}"));
    let Some(path) = options.markdown else {
        print!("{page}");
        return ExitCode::SUCCESS;
    };
    match std::fs::write(&path, page) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!(
                "calibration-bench: {} can't be written: {error}",
                path.display()
            );
            ExitCode::FAILURE
        }
    }
}
