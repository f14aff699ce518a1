//! `literature-bench`: runs the analysis on sets of the literature generator and prints rates beside the goals.

use lexopt::prelude::*;
use literature_sets::excitation::Measured;
use rayon::prelude::*;
use residual_bench::literature::judge::Class;
use residual_bench::literature::{evaluate, table, Outcome, Plan};
use residual_bench::progress::Progress;
use std::path::PathBuf;
use std::process::ExitCode;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const HELP: &str = "\
Runs the residual analysis on sets of evaluations/literature-sets and prints rates beside the goals.

Usage: literature-bench [options]

  --seeds A..B       seeds, both ends included (default 1..1); tune on seeds from 1000, report on others
  --sizes X,Y,...    RMS of each effect over the RMS of the noise (default 1,0.3)
  --only A,B,...     only sets whose effects' names (joined by +; `none`) are in this list
  --empty N          empty sets for each seed (default 10)
  --some N           sets with two or three effects for each seed and size (default 0)
  --excitation DIR   take motion and command from the measured logs in this folder
  --list             print each set that is not right, or has a name that is not there, and each interval
  --markdown FILE    write the tables to a file
  --help             this text
";

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

struct Options {
    plan: Plan,
    only: Vec<String>,
    excitation: Option<Measured>,
    list: bool,
    markdown: Option<PathBuf>,
}

fn main() -> ExitCode {
    let result = options()
        .map_err(|e| e.to_string())
        .and_then(|options| options.map_or(Ok(()), |options| run(&options)));
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("literature-bench: error: {error}; see --help");
            ExitCode::FAILURE
        }
    }
}

fn options() -> Result<Option<Options>, lexopt::Error> {
    let mut out = Options {
        plan: Plan {
            seeds: 1..=1,
            sizes: vec![1.0, 0.3],
            empty: 10,
            some: 0,
        },
        only: vec![],
        excitation: None,
        list: false,
        markdown: None,
    };
    let mut parser = lexopt::Parser::from_env();
    while let Some(argument) = parser.next()? {
        match argument {
            Long("seeds") => {
                out.plan.seeds = parser.value()?.parse_with(|text| {
                    let (a, b) = text
                        .split_once("..")
                        .ok_or("two numbers with `..` between")?;
                    let number = |x: &str| x.parse::<u64>().map_err(|_| "a seed is a whole number");
                    Ok::<_, &str>(number(a)?..=number(b)?)
                })?;
            }
            Long("sizes") => {
                out.plan.sizes = parser.value()?.parse_with(|text| {
                    text.split(',')
                        .map(str::parse)
                        .collect::<Result<_, std::num::ParseFloatError>>()
                })?;
            }
            Long("only") => {
                out.only = parser
                    .value()?
                    .string()?
                    .split(',')
                    .map(String::from)
                    .collect();
            }
            Long("empty") => out.plan.empty = parser.value()?.parse()?,
            Long("some") => out.plan.some = parser.value()?.parse()?,
            Long("excitation") => {
                let folder = PathBuf::from(parser.value()?);
                out.excitation = Some(Measured::read(&folder)?);
            }
            Long("list") => out.list = true,
            Long("markdown") => out.markdown = Some(parser.value()?.into()),
            Short('h') | Long("help") => {
                print!("{HELP}");
                return Ok(None);
            }
            other => return Err(other.unexpected()),
        }
    }
    Ok(Some(out))
}

fn run(options: &Options) -> Result<(), String> {
    let mut cases = options.plan.cases();
    cases.retain(|c| options.only.is_empty() || options.only.contains(&c.truth()));
    if cases.is_empty() {
        return Err("no set fits these options".into());
    }
    let progress = Progress::new(cases.len());
    let outcomes: Vec<Option<Outcome>> = cases
        .par_iter()
        .map(|case| {
            let outcome = evaluate(case, options.excitation.as_ref());
            progress.step();
            outcome
        })
        .collect::<Result<_, _>>()?;
    eprintln!();
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
    let line = std::env::args().skip(1).fold(
        String::from("cargo run --release -p residual-bench --bin literature-bench --"),
        |l, w| l + " " + &w,
    );
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
    match &options.markdown {
        None => Ok(()),
        Some(path) => std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display())),
    }
}
