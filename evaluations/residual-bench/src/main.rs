//! `residual-bench`: runs the benchmark and prints the tables. `cargo xtask residual-bench` builds and starts it.

use lexopt::{Arg, Parser, ValueExt};
use rayon::prelude::*;
use residual_bench::case::{kind_named, Group, Plan};
use residual_bench::evaluate::{self, evaluate, Outcome};
use residual_bench::judge::Class;
use residual_bench::progress::Progress;
use residual_bench::table;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// What `--help` prints; `cargo xtask residual-bench --help` as well.
const HELP: &str = include_str!("help.txt");

struct Options {
    plan: Plan,
    group: Option<Group>,
    strength: Option<f64>,
    list: bool,
    csv: Option<PathBuf>,
    json: Option<PathBuf>,
    markdown: Option<PathBuf>,
    /// The command line, for the page's heading.
    line: String,
}

fn options() -> Result<Option<Options>, lexopt::Error> {
    let mut out = Options {
        plan: Plan {
            seeds: 1..=20,
            kind: None,
            quick: false,
        },
        group: None,
        strength: None,
        list: false,
        csv: None,
        json: None,
        markdown: None,
        line: std::env::args()
            .skip(1)
            .fold("cargo xtask residual-bench".into(), |line, word| {
                line + " " + &word
            }),
    };
    let mut parser = Parser::from_env();
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("seeds") => {
                out.plan.seeds = parser.value()?.parse_with(|text| {
                    let (a, b) = text
                        .split_once("..")
                        .ok_or("two numbers with `..` between")?;
                    let number = |x: &str| x.parse::<u64>().map_err(|_| "a seed is a whole number");
                    let (a, b) = (number(a)?, number(b)?);
                    if a > b || b > 1_000_000 {
                        return Err("the first seed must not exceed the last, nor that 1000000");
                    }
                    Ok(a..=b)
                })?;
            }
            Arg::Long("kind") => {
                out.plan.kind = Some(parser.value()?.parse_with(|text| {
                    kind_named(text).ok_or("no effect of the generator has that name")
                })?);
            }
            Arg::Long("group") => {
                out.group = Some(parser.value()?.parse_with(|text| {
                    Ok::<_, &str>(match text {
                        "known" => Group::Known,
                        "closed" => Group::Closed,
                        "empty" => Group::Empty,
                        "two" => Group::Two,
                        "uncatalogued" => Group::Uncatalogued,
                        _ => return Err("groups are known, closed, empty, two, uncatalogued"),
                    })
                })?);
            }
            Arg::Long("strength") => out.strength = Some(parser.value()?.parse()?),
            Arg::Long("quick") => out.plan.quick = true,
            Arg::Long("list") => out.list = true,
            Arg::Long("csv") => out.csv = Some(parser.value()?.into()),
            Arg::Long("json") => out.json = Some(parser.value()?.into()),
            Arg::Long("markdown") => out.markdown = Some(parser.value()?.into()),
            Arg::Short('h') | Arg::Long("help") => {
                print!("{HELP}");
                return Ok(None);
            }
            other => return Err(other.unexpected()),
        }
    }
    Ok(Some(out))
}

fn main() -> ExitCode {
    let options = match options() {
        Ok(Some(options)) => options,
        Ok(None) => return ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("residual-bench: {error}\n\n{HELP}");
            return ExitCode::from(2);
        }
    };
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("residual-bench: error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let mut cases = options.plan.cases();
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
        return cases.iter().try_for_each(|case| {
            evaluate::write(case, folder).map_err(|error| format!("{}: {error}", folder.display()))
        });
    }
    let started = Instant::now();
    let progress = Progress::new(cases.len());
    let outcomes: Vec<Outcome> = cases
        .par_iter()
        .map(|case| {
            let outcome = evaluate(case);
            progress.step();
            outcome
        })
        .collect::<Result<_, _>>()?;
    eprintln!();
    if options.list {
        for o in outcomes
            .iter()
            .filter(|o| o.class != Class::Right || o.extra > 0)
        {
            println!(
                "{:?} {} x{} seed {} {:?}: {} [{}] n.i. [{}] left [{}] rmse/oracle {:.4}",
                o.case.group,
                o.case.truth(),
                o.case.strength,
                o.case.seed,
                o.class,
                o.verdict,
                o.named.join(", "),
                o.among.join(", "),
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
    let write = |path: &PathBuf, text: String| {
        std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
    };
    if let Some(path) = &options.json {
        write(path, table::json(&outcomes))?;
    }
    if let Some(path) = &options.markdown {
        write(path, format!("{}{text}", heading(&options.line)))?;
    }
    Ok(())
}

/// What stands above the tables on the page.
fn heading(line: &str) -> String {
    format!(
        "# Synthetic benchmark of the residual analysis\n\n\
         Written by `{line}`; don't edit.\n\n\
         The generator (`evaluations/synthetic-sets`) shares no code and no constant with the analysis; a test \
         of `evaluations/residual-bench` enforces that. Each set is five to seven logs of 50 to 80 s at 20, 50 or 100 rows a \
         second, with the declared model *force = command*, and up to two effects that the model lacks, scaled to a \
         multiple of the noise's RMS. Blocks of 10 s are held out, in ten folds. What counts as right is written in `evaluations/residual-bench/src/judge.rs`. Seeds 1 to 20 \
         are reserved for this page; the analysis was tuned on seeds from 10000.\n\n"
    )
}
