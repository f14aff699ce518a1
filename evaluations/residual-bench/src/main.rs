//! `residual-bench`: runs the benchmark and prints the tables. `cargo xtask residual-bench` builds
//! and starts it.

use evaluation::checkpoint::each;
use evaluation::clap::{self, Parser};
use evaluation::{command_line, seeds, write};
use residual_bench::arm;
use residual_bench::case::{kind_named, Group, Plan};
use residual_bench::evaluate::{self, evaluate};
use residual_bench::judge::Class;
use residual_bench::table;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;
use synthetic_sets::Kind;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Analyses synthetic logs with undeclared effects and compares the verdicts with the truth.
#[derive(Parser)]
#[command(bin_name = "cargo xtask residual-bench")]
struct Options {
    /// Seeds, both included (1..20 are the reported ones; tune on 10000 and up).
    #[arg(long, value_name = "A..B", default_value = "1..20", value_parser = seeds)]
    seeds: RangeInclusive<u64>,
    /// Only sets with this effect.
    #[arg(long, value_name = "NAME", value_parser = kind)]
    kind: Option<Kind>,
    /// Only sets of this group.
    #[arg(long, value_name = "NAME")]
    group: Option<Group>,
    /// Only sets of this strength (3, 1 or 0.3).
    #[arg(long, value_name = "X")]
    strength: Option<f64>,
    /// Joints of an arm in place of the rig's sets.
    #[arg(long, conflicts_with_all = ["kind", "group", "strength", "quick", "csv", "json", "markdown"])]
    arm: bool,
    /// With --arm: how far names and errors depend on the logs, by a selection without each of
    /// them.
    #[arg(long, requires = "arm", conflicts_with = "list")]
    nested: bool,
    /// A small selection.
    #[arg(long)]
    quick: bool,
    /// Print one line for each set that is not right.
    #[arg(long)]
    list: bool,
    /// Write the logs of the chosen sets instead of analysing them.
    #[arg(long, value_name = "FOLDER")]
    csv: Option<PathBuf>,
    /// Keep outcomes in a file as they come, and go on from those that it has.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Write every outcome.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the tables with a heading.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

fn kind(text: &str) -> Result<Kind, &'static str> {
    kind_named(text).ok_or("no effect of the generator has that name")
}

evaluation::test_options!(Options);

fn main() -> ExitCode {
    evaluation::run(|options: Options| run(&options))
}

fn run(options: &Options) -> Result<ExitCode, String> {
    if options.arm {
        let seeds = options.seeds.clone();
        let text = match options.nested {
            true => arm::nested(seeds)?,
            false => arm::table(seeds, options.list)?,
        };
        print!("{text}");
        return Ok(ExitCode::SUCCESS);
    }
    let plan = Plan {
        seeds: options.seeds.clone(),
        kind: options.kind,
        quick: options.quick,
    };
    let mut cases = plan.cases();
    cases.retain(|case| {
        options.group.is_none_or(|group| case.group == group)
            && options
                .strength
                .is_none_or(|strength| case.strength == strength)
    });
    if cases.is_empty() {
        return Err("no set fits these options".into());
    }
    if let Some(folder) = &options.csv {
        for case in &cases {
            evaluate::write(case, folder)
                .map_err(|error| format!("{}: {error}", folder.display()))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let started = Instant::now();
    let outcomes = each(
        &cases,
        options.checkpoint.as_deref(),
        "the synthetic sets",
        evaluate,
    )?;
    if options.list {
        for o in outcomes
            .iter()
            .filter(|o| o.class != Class::Right || o.extra + o.grouped > 0)
        {
            println!(
                "{:?} {} x{} seed {} {:?}: {} [{}] or [{}] left [{}] rmse/oracle {:.4}",
                o.case.group,
                o.case.truth(),
                o.case.strength,
                o.case.seed,
                o.class,
                o.verdict,
                o.named.join(", "),
                o.others.join(", "),
                o.structure.first().map_or("", String::as_str),
                o.over_oracle(),
            );
        }
    }
    let text = table::text(&outcomes);
    println!("{text}");
    let cpu: f64 = outcomes.iter().map(|o| o.seconds).sum();
    eprintln!(
        "{:.0} s in all; {:.2} s a set on average while it ran",
        started.elapsed().as_secs_f64(),
        cpu / outcomes.len() as f64
    );
    if let Some(path) = &options.json {
        write(path, &table::json(&outcomes))?;
    }
    if let Some(path) = &options.markdown {
        let line = command_line("cargo xtask residual-bench");
        write(path, &format!("{}{text}", heading(&line)))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// What stands above the tables on the page.
fn heading(line: &str) -> String {
    format!(
        "# Synthetic benchmark of the residual analysis\n\n\
         Written by `{line}` ({}); don't edit.\n\n\
         The generator (`evaluations/synthetic-sets`) shares no code and no constant with the analysis; a test \
         of `evaluations/residual-bench` enforces that. Each set is five to seven logs of 50 to 80 s at 20, 50 or 100 rows a \
         second, with the declared model *force = command*, and up to three effects that the model lacks, scaled to a \
         multiple of the noise's RMS. Blocks of 10 s are held out, in ten folds. What counts as right is written in `evaluations/residual-bench/src/judge.rs`. Seeds 1 to 20 \
         are reserved for this page; the analysis was tuned on seeds from 10000.\n\n",
        evaluation::sources()
    )
}
