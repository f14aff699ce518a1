//! `faults`: runs the fault campaign, or a shard of it, and prints its table.

use evaluation::clap::{self, Parser};
use faults::campaign::{read, Campaign, CURRENT_LIMIT_A};
use faults::case::{self, Bases, EXPECTED_N};
use faults::expected;
use faults::full_output;
use faults::healthy;
use faults::injection::Plan;
use faults::table;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Injects thousands of faults into the firmware's core on the plant, and prints what came of them.
#[derive(Parser)]
#[command(bin_name = "cargo xtask faults", after_help = OTHERS)]
struct Options {
    /// Cases of the campaign.
    #[arg(long, value_name = "N", default_value_t = 4_292)]
    cases: u64,
    /// Seed.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Only every Nth case, beginning with the Ith (1 to N).
    #[arg(long, value_name = "I/N", default_value = "1/1", value_parser = shard)]
    shard: (u64, u64),
    /// Threads (default: all processors).
    #[arg(long, value_name = "J")]
    jobs: Option<usize>,
    /// Current limit of the amplifiers (as docs/bring-up.md has it set).
    #[arg(long, value_name = "A", default_value_t = CURRENT_LIMIT_A)]
    current_limit: f64,
    /// Where outcomes are kept, one JSON a line; cases that are there are not run again (default:
    /// target/faults/seed-S.jsonl).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Only print the table of these files together.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    merge: Vec<PathBuf>,
    /// The expected fault of each kind of injection, then the first cases, without a file; ends at
    /// the first hazard or wrong fault.
    #[arg(long)]
    check: bool,
    /// Only what an output does that jumps to the end of its range, for some current limits of the
    /// amplifiers.
    #[arg(long)]
    full_output: bool,
    /// Only so many rigs in which nothing is broken, each armed four times: false alarms.
    #[arg(long, value_name = "N")]
    healthy: Option<u64>,
    /// The table without the list of hazards.
    #[arg(long)]
    quiet: bool,
}

const OTHERS: &str = "\
cargo xtask faults --image [--cases N] [--seed S] [--jobs J] [--list]: boots the whole image in the embedded rig for each case
(default 110), arms it, and flips one bit of a core register, the variables, the stack or a peripheral's register.

cargo xtask faults --mutants [NAME...]: builds the firmware's core once for each mutant of its supervision, in a copy of
the sources, and shows that the campaign kills it.

Exit code 1 where a hazard happened, or a mutant survived.";

evaluation::test_options!(Options);

fn main() -> ExitCode {
    evaluation::run(run)
}

fn run(options: Options) -> Result<ExitCode, String> {
    let campaign = Campaign {
        seed: options.seed,
        cases: options.cases,
        shard: options.shard,
        current_limit_a: options.current_limit,
        jobs: options
            .jobs
            .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from)),
    };
    if options.full_output {
        print!("{}", full_output::table(options.seed));
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(rigs) = options.healthy {
        let found = healthy::run(
            campaign.seed,
            0..rigs,
            campaign.current_limit_a,
            campaign.jobs,
        );
        print!("{}", healthy::table(campaign.seed, rigs, &found));
        return Ok(evaluation::exit_code(!found.alarms.is_empty()));
    }
    if options.check {
        return Ok(check_quickly(campaign));
    }
    let mut files = options.merge;
    if files.is_empty() {
        let out = match options.out {
            Some(out) => out,
            None => outcomes_of(campaign.seed)?,
        };
        campaign
            .run(&out)
            .map_err(|error| format!("{}: {error}", out.display()))?;
        files.push(out);
    }
    let mut outcomes = BTreeMap::new();
    for file in files {
        let (seed, found) = read(&file).map_err(|error| format!("{}: {error}", file.display()))?;
        let found = found
            .into_iter()
            .filter(|(number, _)| *number < campaign.cases);
        outcomes.extend(found.map(|(number, outcome)| ((seed, number), outcome)));
    }
    if !options.quiet {
        print!("{}", table::hazards(&outcomes));
    }
    print!("{}", table::summary(&outcomes));
    print!("{}", table::drawn(&outcomes, campaign.current_limit_a));
    let hazard = outcomes.values().any(|outcome| !outcome.hazards.is_empty());
    Ok(evaluation::exit_code(hazard))
}

/// Where the outcomes of a seed are kept unless another file is named.
fn outcomes_of(seed: u64) -> Result<PathBuf, String> {
    let folder = Path::new("target/faults");
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    Ok(folder.join(format!("seed-{seed}.jsonl")))
}

/// The expected faults, then the campaign's first cases, in memory; ends at the first thing that is
/// wrong.
fn check_quickly(campaign: Campaign) -> ExitCode {
    let bases = Bases::between(campaign.seed, campaign.current_limit_a, EXPECTED_N);
    if let Err(wrong) = expected::check(&bases) {
        println!("{wrong}");
        return ExitCode::FAILURE;
    }
    for number in 0..campaign.cases {
        let plan = Plan::draw(campaign.seed, number);
        // What these do is known beforehand: `--full-output`, and docs/safety.md.
        if plan.has_full_output() || plan.has_small_pull() {
            continue;
        }
        let outcome = case::run(&bases, number, plan);
        if !outcome.hazards.is_empty() {
            let one = BTreeMap::from([((campaign.seed, number), outcome)]);
            print!("{}", table::hazards(&one));
            return ExitCode::FAILURE;
        }
    }
    println!(
        "expected faults and {} cases: nothing wrong",
        campaign.cases
    );
    ExitCode::SUCCESS
}

fn shard(text: &str) -> Result<(u64, u64), String> {
    let number = |text: &str| text.parse::<u64>().ok();
    text.split_once('/')
        .and_then(|(shard, of)| number(shard).zip(number(of)))
        .filter(|(shard, of)| (1..=*of).contains(shard))
        .map(|(shard, of)| (shard - 1, of))
        .ok_or_else(|| "write I/N, as in 2/4".to_owned())
}
