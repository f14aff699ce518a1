//! The whole identification on rigs with one effect that their rig file doesn't declare: one effect a seed, whether it is
//! found, and how much better the force is held after its correction.
//!
//! For each seed an effect and its size are drawn and written to a plant file. `forcectl identify` runs as a process of
//! its own and hands that file to the rig; its analysis sees the recorded session and nothing else. Only then is
//! what it reports compared with the truth.
//!
//! `cargo xtask closed-loop [--seeds 1..10] [--drive-duration 40] [--duration 16] [--size 1] [--cells] [--markdown FILE]`

mod cells;
mod effect;
mod options;
mod page;
mod run;
mod table;

use effect::truth;
use options::{options, Options, HELP};
use page::{names, page};
use run::{run, NoFindings};
use std::path::Path;
use std::process::ExitCode;
use table::{cost, row, Kinds, HEAD};

fn main() -> ExitCode {
    let options = match options() {
        Ok(Some(options)) => options,
        Ok(None) => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(why) => {
            eprintln!("closed-loop: {why}\n\n{HELP}");
            return ExitCode::from(2);
        }
    };
    if options.cells {
        return cells(&options);
    }
    let mut rows = String::new();
    let mut kinds = Kinds::default();
    let mut failed = false;
    print!("{HEAD}");
    for seed in options.seeds.0..=options.seeds.1 {
        let truth = truth(seed, options.size);
        let findings = run(&options, seed, &truth);
        failed |= matches!(findings, Err(NoFindings::Failed(_)));
        let stopped = matches!(findings, Err(NoFindings::Stopped));
        let (text, gained) = row(seed, &truth, &findings);
        print!("{text}");
        rows.push_str(&text);
        let cost = findings.ok().as_ref().and_then(cost);
        kinds.add(truth.kind, gained, cost, stopped);
    }
    println!(
        "\nkinds of effect that were named in most units and held better after: {} ({}); that had cost something, half of it gone: {} ({})",
        kinds.better.len(),
        names(&kinds.better),
        kinds.back.len(),
        names(&kinds.back)
    );
    if let Some(path) = &options.markdown {
        if let Err(why) = write(path, &page(&options, &rows, &kinds)) {
            eprintln!("closed-loop: {why}");
            return ExitCode::FAILURE;
        }
    }
    if failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    }
}

/// Weights on the rigs whose cells are curved or creep.
fn cells(options: &Options) -> ExitCode {
    let done = cells::page(options).and_then(|page| match &options.markdown {
        Some(path) => write(path, &page),
        None => {
            print!("{page}");
            Ok(())
        }
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("closed-loop: {why}");
            ExitCode::FAILURE
        }
    }
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}
