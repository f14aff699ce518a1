//! All mistakes of wiring with every slack on the rigs of some seeds, and the right rig as often: how many are named first, and how
//! hard a cable was pulled. Prints a table; a minute and more.
//!
//! `cargo run -p bring-up --example mistakes -- [SEEDS [WORDS]]`: number of seeds (5), and only the mistakes with these words.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{cases, is_named, run, told, Case, SLACK_MM};

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
    let mut all = (0, 0, 0.0_f64);
    let (mut command_n, mut pulse_ms) = (0.0_f64, 0);
    println!("| mistake | named | largest true tension, N |\n| --- | --- | --- |");
    let right = Case {
        what: "none",
        injections: vec![],
        is_right: |_| false,
    };
    let all_cases = cases();
    let chosen = all_cases.iter().chain([&right]);
    for case in chosen.filter(|case| case.what.contains(&only)) {
        let (mut named, mut of, mut most_n) = (0, 0, 0.0_f64);
        for slack_mm in SLACK_MM {
            for seed in 1..=seeds {
                let run = run(200.0, &case.injections, slack_mm, seed);
                let good = if case.what == "none" {
                    run.found.is_empty() && run.figures.motors.iter().all(Option::is_some)
                } else {
                    is_named(case, &run)
                };
                if !good {
                    eprintln!("{} ({slack_mm} mm, seed {seed}):{}", case.what, told(&run));
                }
                (named, of) = (named + usize::from(good), of + 1);
                most_n = most_n.max(run.most_n);
                command_n = command_n.max(run.command_n);
                pulse_ms = pulse_ms.max(run.longest_ms);
            }
        }
        println!("| {} | {named} of {of} | {most_n:.2} |", case.what);
        all = (all.0 + named, all.1 + of, all.2.max(most_n));
    }
    println!("| all | {} of {} | {:.2} |", all.0, all.1, all.2);
    println!("\nstrongest command {command_n:.2} N, longest pulse {pulse_ms} ms");
}
