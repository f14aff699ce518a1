//! `literature-bench`: runs the analysis on sets of the literature generator and prints rates
//! beside the goals.

use evaluation::checkpoint::each;
use evaluation::clap::{self, Parser};
use evaluation::{command_line, seeds, write};
use literature_sets::excitation::Measured;
use residual_bench::literature::judge::Class;
use residual_bench::literature::{evaluate, table, Outcome, Plan};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::process::ExitCode;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Head of the page.
const HEADING: &str = "\
# The residual analysis on sets from the literature

The sets are those of [literature-sets.md](literature-sets.md): effects, equations and ranges from the literature, by an author who
had read neither the analysis nor the first generator. What counts as right is written in
`evaluations/residual-bench/src/literature/judge.rs`. Seeds below 1000 are for this page, others for tuning. This page is written
by the command below; don't edit.

*Size* is the RMS of an effect over that of the noise. An *empty* set lacks nothing, and is *quiet* if no effect is named. The *first
group* is the first effect with those that the report says cannot be distinguished from it.
";

/// Runs the residual analysis on sets of evaluations/literature-sets and prints rates beside the
/// goals.
#[derive(Parser)]
#[command(name = "literature-bench")]
struct Options {
    /// Seeds, both ends included; tune on seeds from 1000, report on others.
    #[arg(long, value_name = "A..B", default_value = "1..1", value_parser = seeds)]
    seeds: RangeInclusive<u64>,
    /// RMS of each effect over the RMS of the noise.
    #[arg(
        long,
        value_name = "X,Y,...",
        default_value = "1,0.3",
        value_delimiter = ','
    )]
    sizes: Vec<f64>,
    /// Only sets whose effects' names (joined by +; `none`) are in this list.
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    only: Vec<String>,
    /// Empty sets for each seed.
    #[arg(long, value_name = "N", default_value_t = 10)]
    empty: u64,
    /// Sets with two or three effects for each seed and size.
    #[arg(long, value_name = "N", default_value_t = 0)]
    some: u64,
    /// Take motion and command from the measured logs in this folder.
    #[arg(long, value_name = "DIR")]
    excitation: Option<PathBuf>,
    /// Print each set that is not right, or has a name that is not there, and each interval.
    #[arg(long)]
    list: bool,
    /// Keep outcomes in a file as they come, and go on from those that it has.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Write the tables to a file.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

evaluation::test_options!(Options);

fn main() -> ExitCode {
    evaluation::run(|options: Options| run(&options))
}

fn run(options: &Options) -> Result<ExitCode, String> {
    let plan = Plan {
        seeds: options.seeds.clone(),
        sizes: options.sizes.clone(),
        empty: options.empty,
        some: options.some,
    };
    let excitation = options
        .excitation
        .as_deref()
        .map(Measured::read)
        .transpose()?;
    let mut cases = plan.cases();
    cases.retain(|c| options.only.is_empty() || options.only.contains(&c.truth()));
    if cases.is_empty() {
        return Err("no set fits these options".into());
    }
    let sets = match &options.excitation {
        Some(folder) => format!("the motion in {}", folder.display()),
        None => "a motion of their own".to_owned(),
    };
    let outcomes = each(&cases, options.checkpoint.as_deref(), &sets, |case| {
        evaluate(case, excitation.as_ref())
    })?;
    let impossible = outcomes.iter().filter(|o| o.is_none()).count();
    let outcomes: Vec<Outcome> = outcomes.into_iter().flatten().collect();
    if options.list {
        for o in outcomes
            .iter()
            .filter(|o| o.class != Class::Right || !o.wrong.is_empty())
        {
            println!(
                "{:?} {} x{} seed {} {:?}: {} [{}] left [{}]",
                o.case.group,
                o.case.truth(),
                o.case.size,
                o.case.seed,
                o.class,
                o.verdict,
                o.found.join(", "),
                o.structure.first().map_or("", String::as_str),
            );
        }
        for o in &outcomes {
            for c in &o.covered {
                println!(
                    "interval{}: {} seed {} {} truth {:.6} found {:.6} in {:.6} to {:.6} [{}]",
                    if c.holds() { "" } else { " without the truth" },
                    o.case.truth(),
                    o.case.seed,
                    c.name,
                    c.truth,
                    c.found,
                    c.interval[0],
                    c.interval[1],
                    o.found.join(", "),
                );
            }
        }
    }
    let line = command_line("cargo run -p residual-bench --bin literature-bench --");
    let seconds: f64 = outcomes.iter().map(|o| o.seconds).sum();
    let text = format!(
        "{HEADING}\n    {line}\n\n{} sets. Left out, as their effect cannot have its size on the motion: {impossible}.\n\n{}",
        outcomes.len(),
        table::text(&outcomes)
    );
    println!("{text}");
    eprintln!(
        "{:.2} s a set while others ran beside it",
        seconds / outcomes.len().max(1) as f64
    );
    if let Some(path) = &options.markdown {
        write(path, &text)?;
    }
    Ok(ExitCode::SUCCESS)
}
