//! What needs no rig: fixed point against f64, and the allocation against its oracle.

use crate::figures::{Figures, Goal};
use crate::study;
use std::process::Command;
use std::time::Duration;

/// The control core's own comparison with its f64 reference.
pub fn fixed_point(figures: &mut Figures) -> Result<(), String> {
    println!("\nfixed point: a million samples against the f64 reference");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args([
            "run",
            "--quiet",
            "--package",
            "control",
            "--example",
            "fixed_point_error",
        ])
        .args(["--", "--samples", "1000000"])
        .output()
        .map_err(|error| format!("cargo can't be started: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let value = text.lines().find_map(|line| {
        line.strip_prefix("fixed_point_error_n ")?
            .trim()
            .parse()
            .ok()
    });
    let value = value.ok_or_else(|| {
        format!(
            "no figure in its output: {text}{}",
            String::from_utf8_lossy(&output.stderr)
        )
    })?;
    figures.add(
        "fixed_point_error_n",
        value,
        Goal::AtMost(1e-3),
        "load code to DAC code, worst difference to f64",
    );
    Ok(())
}

/// Accuracy, time and steps of the allocation.
pub fn allocation(figures: &mut Figures, cases: u32) -> Result<(), String> {
    println!("\nallocation: {cases} random cases against all 3^6 active sets");
    let report = study::oracle_comparison(cases, 1).map_err(|error| error.to_string())?;
    figures.add(
        "allocation_max_error_n",
        report.max_error_n,
        Goal::AtMost(1e-5),
        "largest difference to the exact oracle",
    );
    figures.add(
        "allocation_cases",
        f64::from(report.cases),
        Goal::None,
        "cases compared",
    );
    let in_loop = study::cycle_times(40_000, 2).map_err(|error| error.to_string())?;
    let cold = study::cold_times(10_000, 2).map_err(|error| error.to_string())?;
    let us = |time: Duration| time.as_secs_f64() * 1e6;
    figures.add(
        "allocation_us",
        us(in_loop.median),
        Goal::AtMost(10.0),
        "a solve in the control loop, tip and force moving, median (this machine)",
    );
    figures.add(
        "allocation_us_p999",
        us(in_loop.p999),
        Goal::AtMost(100.0),
        "the same, 99.9th percentile of 40,000 (this machine)",
    );
    figures.add(
        "allocation_us_max",
        us(in_loop.longest),
        Goal::None,
        "the same, longest (this machine)",
    );
    figures.add(
        "allocation_cold_us",
        us(cold.median),
        Goal::None,
        "a solve of a random case without a solution before it, median (this machine)",
    );
    figures.add(
        "allocation_cold_us_p999",
        us(cold.p999),
        Goal::None,
        "the same, 99.9th percentile of 10,000 (this machine)",
    );
    let steps = study::path_steps(3).map_err(|error| error.to_string())?;
    figures.add(
        "allocation_step_n",
        steps.largest_step_n,
        Goal::None,
        "largest step between neighbours of a 400-step path",
    );
    figures.add(
        "allocation_step_n_thesis",
        steps.thesis_largest_step_n,
        Goal::None,
        "the same for the thesis's formulation, without tie-break",
    );
    Ok(())
}
