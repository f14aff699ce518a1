//! `real-bench`: runs the analysis on public measured data sets and prints what it found beside what is known.

use lexopt::prelude::*;
use residual_bench::real::{case, run, table};
use std::path::PathBuf;
use std::process::ExitCode;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const HELP: &str = "\
Runs the residual analysis on public measured data sets and prints what it found beside what is known of each machine.

Usage: real-bench --data DIR [options]

  --data DIR        folder with clones of the repositories: dvrk_dynamics_identification, laas_anti_cogging,
                    dynamic_calibration, mis-tool-characterization; those that are not there are left out
  --only TEXT       only cases whose name contains this
  --markdown FILE   write the page to a file
  --help            this text
";

struct Request {
    data: PathBuf,
    only: String,
    markdown: Option<PathBuf>,
}

fn main() -> ExitCode {
    let result = request()
        .map_err(|e| e.to_string())
        .and_then(|request| request.map_or(Ok(()), |request| bench(&request)));
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("real-bench: error: {error}; see --help");
            ExitCode::FAILURE
        }
    }
}

fn request() -> Result<Option<Request>, lexopt::Error> {
    let (mut data, mut only, mut markdown) = (None, String::new(), None);
    let mut parser = lexopt::Parser::from_env();
    while let Some(argument) = parser.next()? {
        match argument {
            Long("data") => data = Some(PathBuf::from(parser.value()?)),
            Long("only") => only = parser.value()?.string()?,
            Long("markdown") => markdown = Some(PathBuf::from(parser.value()?)),
            Short('h') | Long("help") => {
                print!("{HELP}");
                return Ok(None);
            }
            other => return Err(other.unexpected()),
        }
    }
    let data = data.ok_or("--data DIR is missing")?;
    Ok(Some(Request {
        data,
        only,
        markdown,
    }))
}

fn bench(request: &Request) -> Result<(), String> {
    let (mut outcomes, mut absent) = (Vec::new(), 0);
    for case in case::all()? {
        if !case.name.contains(&request.only) {
            continue;
        }
        eprintln!("{} ...", case.name);
        match run(&case, &request.data)? {
            Some(outcome) => outcomes.push(outcome),
            None => absent += 1,
        }
    }
    if outcomes.is_empty() {
        return Err(format!(
            "{}: no data set of the list is there; clone one of them into it",
            request.data.display()
        ));
    }
    let text = table::page(&outcomes, absent);
    println!("{text}");
    match &request.markdown {
        None => Ok(()),
        Some(path) => std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display())),
    }
}
