//! The whole identification on rigs with effects that their rig file doesn't declare: whether each
//! is found, and how much better the force is held after the correction.
//!
//! For each seed effects and their sizes are drawn and written to a plant file. `forcectl identify`
//! runs as a process of its own and hands that file to the rig; its analysis sees the recorded
//! session and nothing else. Only then is what it reports compared with the truth.
//!
//! `cargo xtask closed-loop [--seeds 1..10] [--effects all] [--drive-duration 40] [--duration 16]
//! [--size 1] [--cells] [--markdown FILE]`

mod cells;
mod effect;
mod options;
mod page;
mod run;
mod table;

use effect::truth;
use options::Options;
use page::{names, page};
use run::{run, NoFindings};
use std::process::ExitCode;
use table::{cost, row, Kinds, HEAD};

fn main() -> ExitCode {
    evaluation::run(|options: Options| {
        if options.cells {
            let page = cells::page(&options)?;
            evaluation::publish(options.markdown.as_deref(), &page)?;
            return Ok(ExitCode::SUCCESS);
        }
        effects(&options)
    })
}

fn effects(options: &Options) -> Result<ExitCode, String> {
    let mut rows = String::new();
    let mut kinds = Kinds::default();
    let mut failed = false;
    print!("{HEAD}");
    for seed in options.seeds.clone() {
        let truth = truth(seed, options.size, options.effects);
        let findings = run(options, seed, &truth);
        failed |= matches!(findings, Err(NoFindings::Failed(_)));
        let (text, gained) = row(seed, &truth, &findings);
        print!("{text}");
        rows.push_str(&text);
        let cost = findings.as_ref().ok().and_then(cost);
        for kind in truth.kinds() {
            kinds.add(kind, gained, cost, findings.as_ref().err());
        }
    }
    println!(
        "\nkinds of effect that were named in most units and held better after: {} ({}); that had cost something, half of it gone: {} ({})",
        kinds.better.len(),
        names(&kinds.better),
        kinds.back.len(),
        names(&kinds.back)
    );
    if let Some(path) = &options.markdown {
        evaluation::write(path, &page(options, &rows, &kinds))?;
    }
    Ok(evaluation::exit_code(failed))
}
