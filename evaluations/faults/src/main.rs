//! `faults`: runs the fault campaign, or a shard of it, and prints its table.

use faults::campaign::{read, Campaign, CURRENT_LIMIT_A};
use faults::case::{self, Bases};
use faults::expected;
use faults::injection::Plan;
use faults::table;
use lexopt::{Arg, Parser, ValueExt};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

const USAGE: &str = "\
usage: faults [--cases N] [--seed S] [--shard I/N] [--jobs J] [--out FILE] [--merge FILE...] [--quiet]

  --cases N    cases of the campaign (default 4292)
  --seed S     seed (default 1)
  --shard I/N  only every Nth case, beginning with the Ith (1 to N)
  --jobs J     threads (default: all processors)
  --current-limit A  current limit of the amplifiers (default 0.9, as docs/bring-up.md has it set)
  --out FILE   where outcomes are kept, one JSON a line; cases that are there are not run again (default faults.jsonl)
  --merge      only print the table of these files together
  --check      the expected fault of each kind of injection, then the first cases, without a file; ends at the first
               hazard or wrong fault
  --quiet      the table without the list of hazards

Exit code 1 where a hazard went undetected.";

fn main() -> ExitCode {
    match run() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("faults: {error}\n{USAGE}");
            ExitCode::from(2)
        }
    }
}

fn run() -> Result<ExitCode, Box<dyn std::error::Error>> {
    let mut campaign = Campaign {
        seed: 1,
        cases: 4_292,
        shard: (0, 1),
        current_limit_a: CURRENT_LIMIT_A,
        jobs: std::thread::available_parallelism().map_or(1, usize::from),
    };
    let mut out = PathBuf::from("faults.jsonl");
    let mut merge: Vec<PathBuf> = Vec::new();
    let mut quiet = false;
    let mut check = false;
    let mut parser = Parser::from_env();
    while let Some(argument) = parser.next()? {
        match argument {
            Arg::Long("cases") => campaign.cases = parser.value()?.parse()?,
            Arg::Long("seed") => campaign.seed = parser.value()?.parse()?,
            Arg::Long("jobs") => campaign.jobs = parser.value()?.parse()?,
            Arg::Long("current-limit") => campaign.current_limit_a = parser.value()?.parse()?,
            Arg::Long("out") => out = parser.value()?.into(),
            Arg::Long("shard") => campaign.shard = shard(&parser.value()?.string()?)?,
            Arg::Long("merge") => merge.extend(parser.values()?.map(PathBuf::from)),
            Arg::Long("quiet") => quiet = true,
            Arg::Long("check") => check = true,
            Arg::Short('h') | Arg::Long("help") => {
                println!("{USAGE}");
                return Ok(ExitCode::SUCCESS);
            }
            other => return Err(other.unexpected().into()),
        }
    }
    if check {
        return Ok(check_quickly(campaign));
    }
    if merge.is_empty() {
        campaign
            .run(&out)
            .map_err(|error| format!("{}: {error}", out.display()))?;
        merge.push(out);
    }
    let mut outcomes = BTreeMap::new();
    for file in merge {
        outcomes.extend(read(&file).map_err(|error| format!("{}: {error}", file.display()))?);
    }
    outcomes.retain(|number, _| *number < campaign.cases);
    if !quiet {
        print!("{}", table::hazards(&outcomes));
    }
    print!("{}", table::summary(&outcomes));
    let undetected = outcomes.values().any(|outcome| outcome.is_undetected());
    Ok(ExitCode::from(u8::from(undetected)))
}

/// The expected faults, then the campaign's first cases, in memory; ends at the first thing that is wrong.
fn check_quickly(campaign: Campaign) -> ExitCode {
    let bases = Bases::new(campaign.seed, campaign.current_limit_a);
    if let Err(wrong) = expected::check(&bases) {
        println!("{wrong}");
        return ExitCode::FAILURE;
    }
    for number in 0..campaign.cases {
        let outcome = case::run(&bases, number, Plan::draw(campaign.seed, number));
        if !outcome.hazards.is_empty() {
            let one = BTreeMap::from([(number, outcome)]);
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
    let wrong = || format!("--shard {text}: write I/N, as in 2/4");
    let (number, of) = text.split_once('/').ok_or_else(wrong)?;
    let number: u64 = number.parse().map_err(|_| wrong())?;
    let of: u64 = of.parse().map_err(|_| wrong())?;
    if number == 0 || number > of {
        return Err(wrong());
    }
    Ok((number - 1, of))
}
