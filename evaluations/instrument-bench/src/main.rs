//! `instrument-bench`: the torque at the jaw of da Vinci instruments, from public measured data.

use instrument_bench::{page, picture, results};
use lexopt::{Arg, Parser};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const HELP: &str = include_str!("help.txt");

struct Options {
    data: PathBuf,
    markdown: Option<PathBuf>,
    pictures: Option<PathBuf>,
}

fn options() -> Result<Option<Options>, lexopt::Error> {
    let (mut data, mut markdown, mut pictures) = (None, None, None);
    let mut parser = Parser::from_env();
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("data") => data = Some(parser.value()?.into()),
            Arg::Long("markdown") => markdown = Some(parser.value()?.into()),
            Arg::Long("pictures") => pictures = Some(parser.value()?.into()),
            Arg::Short('h') | Arg::Long("help") => return Ok(None),
            other => return Err(other.unexpected()),
        }
    }
    let data = data.ok_or_else(|| {
        let source = instrument_bench::data::SOURCE;
        format!("--data DIR is missing: DIR is a clone of {source} (Open Database License)")
    })?;
    Ok(Some(Options {
        data,
        markdown,
        pictures,
    }))
}

fn main() -> ExitCode {
    let options = match options() {
        Ok(Some(options)) => options,
        Ok(None) => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("instrument-bench: {error}\nSee --help.");
            return ExitCode::from(2);
        }
    };
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("instrument-bench: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let results = results::compute(&options.data, &mut |what| eprintln!("{what}"))
        .map_err(|e| e.to_string())?;
    if let Some(folder) = &options.pictures {
        std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        write(
            &folder.join("instruments-time.svg"),
            &picture::over_time(&results)?,
        )?;
        write(
            &folder.join("instruments-load.svg"),
            &picture::by_load(&results)?,
        )?;
    }
    let page = page::page(&results);
    match &options.markdown {
        None => print!("{page}"),
        Some(path) => write(path, &page)?,
    }
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|e| format!("{} can't be written: {e}", path.display()))
}
