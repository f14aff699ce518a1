//! The gain of a load cell from a table of readings under weights, without forcectl:
//!
//! `cargo run -p calibration --example gain -- weights.csv`
//!
//! The table has the columns `weight_g`, `code`, `standard_error` and, where known, `direction`,
//! `time_s`, `since_s`, `temperature_c`. Exit code 1: the table gives no gain; the message says why
//! and names the line.

use calibration::gain::{self, figures, Options};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args()
        .nth(1)
        .ok_or("name a table of readings: gain weights.csv")?;
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{path}: {error}"))?;
    let readings = gain::read(&path, &text)?;
    let found = gain::fit(&readings, &Options::default())?;
    println!(
        "{:.5e} N per code, +- {:.3} % (95 %; {:.3} % up to 12 N), from {} readings",
        found.n_per_code,
        100.0 * found.within_half_95 / found.n_per_code.abs(),
        100.0 * found.n_per_code_half_95 / found.n_per_code.abs(),
        readings.len()
    );
    for (term, coefficient) in &found.terms {
        println!(
            "{term:?}: {:.4e} (p {:.1e})",
            coefficient.value, coefficient.p
        );
    }
    if let Some(creep) = found.creep {
        println!(
            "creep {:.2} +- {:.2} % in {:.1} s",
            100.0 * creep.share,
            196.0 * creep.share_se,
            creep.time_s
        );
    }
    let conversion = found.conversion();
    println!(
        "force = {:.6e} c + {:.6e} c^2 of a code c above the zero",
        conversion.n_per_code, conversion.n_per_code2
    );
    let shape = figures::shape(&found);
    println!(
        "linearity {:.1} mN at {:.2} N",
        1e3 * shape.linearity_n,
        shape.linearity_at_n
    );
    Ok(())
}
