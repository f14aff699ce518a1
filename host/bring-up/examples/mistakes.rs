//! All mistakes of wiring with every slack on the rigs of some seeds, and the right rig as often:
//! how many are named first, and how hard a cable was pulled; then ten pairs of mistakes, of which
//! one has to be named. Prints two tables; some minutes.
//!
//! `cargo run -p bring-up --example mistakes -- [SEEDS [WORDS]]`: number of seeds (5), and only the
//! mistakes with these words.

#[path = "../tests/common/mod.rs"]
mod common;

use bring_up::steps::Test;
use common::{cases, is_named, one_is_named, pairs, run, told, Case, Run, SLACK_MM};

/// What all runs have in common.
#[derive(Default)]
struct All {
    named: usize,
    of: usize,
    most_n: f64,
    command_n: f64,
    pulse_ms: u32,
    /// Longest time of each test, s.
    seconds: [f64; Test::ALL.len()],
}

impl All {
    fn take(&mut self, run: &Run, good: bool) {
        self.named += usize::from(good);
        self.of += 1;
        self.most_n = self.most_n.max(run.most_n);
        self.command_n = self.command_n.max(run.command_n);
        self.pulse_ms = self.pulse_ms.max(run.longest_ms);
        for (most, seconds) in self.seconds.iter_mut().zip(run.seconds) {
            *most = most.max(seconds);
        }
    }

    fn row(&self, what: &str) {
        println!(
            "| {what} | {} of {} | {:.2} |",
            self.named, self.of, self.most_n
        );
    }
}

/// A case with every slack on the rigs of all seeds, on all processors: runs, slacks, seeds.
fn runs(case: &Case, seeds: u64) -> Vec<(Run, f64, u64)> {
    let all: Vec<(f64, u64)> = SLACK_MM
        .into_iter()
        .flat_map(|slack_mm| (1..=seeds).map(move |seed| (slack_mm, seed)))
        .collect();
    let jobs = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        let run_some = |some: &[(f64, u64)]| -> Vec<(Run, f64, u64)> {
            (some.iter())
                .map(|(slack_mm, seed)| (run(200.0, case, *slack_mm, *seed), *slack_mm, *seed))
                .collect()
        };
        let threads: Vec<_> = all
            .chunks(all.len().div_ceil(jobs))
            .map(|some| scope.spawn(move || run_some(some)))
            .collect();
        let ended = threads.into_iter().map(|thread| thread.join());
        ended
            .flat_map(|done| done.expect("no run panics"))
            .collect()
    })
}

fn table(title: &str, cases: &[Case], seeds: u64, good: &dyn Fn(&Case, &Run) -> bool) {
    println!("| {title} | named | largest true tension, N |\n| --- | --- | --- |");
    let mut all = All::default();
    for case in cases {
        let mut of_case = All::default();
        for (run, slack_mm, seed) in runs(case, seeds) {
            let good = good(case, &run);
            if !good {
                eprintln!("{} ({slack_mm} mm, seed {seed}):{}", case.what, told(&run));
            }
            of_case.take(&run, good);
            all.take(&run, good);
        }
        of_case.row(case.what);
    }
    all.row("all");
    println!(
        "\nstrongest command {:.2} N, longest pulse {} ms",
        all.command_n, all.pulse_ms
    );
    let times = Test::ALL.iter().zip(all.seconds);
    let times: Vec<String> = times.map(|(test, s)| format!("{test} {s:.0}")).collect();
    println!(
        "longest time of the rig, six units, emulated hands: {} s\n",
        times.join(", ")
    );
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let seeds = match arguments.next().map(|n| n.parse::<u64>()) {
        None => 5,
        Some(Ok(seeds)) if seeds > 0 => seeds,
        Some(_) => {
            eprintln!("give the number of seeds, 1 or more");
            std::process::exit(2);
        }
    };
    let only = arguments.next().unwrap_or_default();
    let right = Case::of("none", &[]);
    let chosen = |mut cases: Vec<Case>| {
        cases.retain(|case| case.what.contains(&only));
        cases
    };
    let singles = chosen(cases().into_iter().chain([right]).collect());
    let pairs = chosen(pairs());
    table("mistake", &singles, seeds, &|case, run| {
        if case.what == "none" {
            run.found.is_empty() && run.figures.tension.iter().all(Option::is_some)
        } else {
            is_named(case, run)
        }
    });
    table(
        "two mistakes, one has to be named",
        &pairs,
        seeds,
        &one_is_named,
    );
}
