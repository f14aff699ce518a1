//! `real-bench`: runs the analysis on public measured data sets and prints what it found beside
//! what is known.

use evaluation::clap::{self, Parser};
use evaluation::write;
use residual_bench::real::{case, run, table};
use std::path::PathBuf;
use std::process::ExitCode;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Runs the residual analysis on public measured data sets and prints what it found beside what is
/// known of each machine.
#[derive(Parser)]
#[command(name = "real-bench")]
struct Request {
    /// Folder with clones of the repositories: dvrk_dynamics_identification, laas_anti_cogging,
    /// dynamic_calibration, mis-tool-characterization; those that are not there are left out.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Only cases whose name contains this.
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    /// Write the page to a file.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

evaluation::test_options!(Request);

fn main() -> ExitCode {
    evaluation::run(|request: Request| bench(&request))
}

fn bench(request: &Request) -> Result<ExitCode, String> {
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
    if let Some(path) = &request.markdown {
        write(path, &text)?;
    }
    Ok(ExitCode::SUCCESS)
}
