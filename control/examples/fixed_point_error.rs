//! Worst difference between the fixed-point step and its `f64` reference, from load code to the
//! command before it is rounded to a DAC code, over random configurations and inputs.
//!
//! `cargo run -p control --example fixed_point_error -- --samples 1000000`

#[path = "../tests/common/compare.rs"]
mod compare;
#[path = "../tests/common/reference.rs"]
mod reference;

use std::process::ExitCode;

fn main() -> ExitCode {
    let (mut samples, mut seed) = (1_000_000u64, 1u64);
    let mut args = std::env::args().skip(1);
    while let Some(name) = args.next() {
        let value = args.next().and_then(|v| v.parse().ok());
        match (name.as_str(), value) {
            ("--samples", Some(n)) if n > 0 => samples = n,
            ("--seed", Some(n)) => seed = n,
            _ => {
                eprintln!("usage: fixed_point_error [--samples N] [--seed N], both whole numbers, N samples at least 1");
                return ExitCode::from(2);
            }
        }
    }
    // Half of it in long runs (5 minutes of one unit), where an integrator would drift.
    let mut found = compare::compare(seed, samples / 2, 5_000);
    let long = compare::compare(seed ^ 0x5555, samples - samples / 2, 100_000);
    found.worst_command = found.worst_command.max(long.worst_command);
    found.worst_codes = found.worst_codes.max(long.worst_codes);
    for (worst, other) in found.worst_terms.iter_mut().zip(long.worst_terms) {
        *worst = worst.max(other);
    }
    println!("samples_compared {}", found.samples + long.samples);
    println!("samples_without_limit {}", found.free + long.free);
    println!(
        "runs_too_close_to_call {}",
        found.undecided + long.undecided
    );
    println!(
        "largest_command_n {:.3}",
        found.largest_command.max(long.largest_command)
    );
    for (name, worst) in ["tension", "p", "i", "d", "feedforward"]
        .iter()
        .zip(found.worst_terms)
    {
        println!("worst_{name}_n {worst:.7}");
    }
    println!("worst_dac_codes {:.4}", found.worst_codes);
    println!("fixed_point_error_n {:.7}", found.worst_command);
    ExitCode::SUCCESS
}
