//! `image-faults`: flips bits of the running image in the embedded rig and prints what came of
//! them; `cargo xtask faults --image` builds what it needs and runs it.

use lexopt::{Arg, Parser, ValueExt};
use scenarios::image_faults::{table, Memory, Outcome, Plan, Stage};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

const USAGE: &str = "\
usage: image-faults [--cases N] [--seed S] [--jobs J] [--list]

  --cases N  cases (default 110): bits of core registers, variables, stack and peripheral registers in turn
  --seed S   seed (default 1)
  --jobs J   rigs side by side (default: all processors)
  --list     print every case, not only those with a hazard

Exit code 1 where a hazard happened, detected or not.";

fn main() -> ExitCode {
    run().unwrap_or_else(|error| {
        eprintln!("image-faults: {error}\n{USAGE}");
        ExitCode::from(2)
    })
}

fn run() -> Result<ExitCode, Box<dyn std::error::Error>> {
    let (mut cases, mut seed, mut list) = (110, 1, false);
    let mut jobs = std::thread::available_parallelism().map_or(1, usize::from);
    let mut parser = Parser::from_env();
    while let Some(argument) = parser.next()? {
        match argument {
            // The name of the campaign, where xtask passes everything on.
            Arg::Long("image") => {}
            Arg::Long("cases") => cases = parser.value()?.parse()?,
            Arg::Long("seed") => seed = parser.value()?.parse()?,
            Arg::Long("jobs") => jobs = parser.value()?.parse()?,
            Arg::Long("list") => list = true,
            Arg::Short('h') | Arg::Long("help") => {
                println!("{USAGE}");
                return Ok(ExitCode::SUCCESS);
            }
            other => return Err(other.unexpected().into()),
        }
    }
    let stage = Stage::new()?;
    let memory = stage.memory()?;
    let mut outcomes = campaign(&stage, &memory, seed, cases, jobs)?;
    outcomes.sort_by_key(|outcome| outcome.number);
    for outcome in &outcomes {
        if list || !outcome.hazards.is_empty() {
            println!("{}", table::words(outcome));
        }
    }
    print!("{}", table::summary(&outcomes));
    let hazard = outcomes.iter().any(|outcome| !outcome.hazards.is_empty());
    Ok(ExitCode::from(u8::from(hazard)))
}

fn campaign(
    stage: &Stage,
    memory: &Memory,
    seed: u64,
    cases: u64,
    jobs: usize,
) -> Result<Vec<Outcome>, String> {
    let next = AtomicU64::new(0);
    let outcomes = Mutex::new(Ok(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..jobs.max(1) {
            scope.spawn(|| loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                if number >= cases {
                    return;
                }
                let plan = Plan::draw(seed, number, memory);
                let outcome = stage.run(&plan);
                let mut all = outcomes.lock().unwrap_or_else(PoisonError::into_inner);
                match (outcome, all.as_mut()) {
                    (Ok(outcome), Ok(done)) => {
                        done.push(outcome);
                        if done.len().is_multiple_of(10) {
                            eprintln!("image-faults: {} of {cases} cases", done.len());
                        }
                    }
                    (Err(error), Ok(_)) => *all = Err(format!("case {number}: {error}")),
                    (_, Err(_)) => return,
                }
            });
        }
    });
    outcomes
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner)
}
