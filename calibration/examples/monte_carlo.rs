//! How well a rig is known after calibration: Monte Carlo over made-up rigs whose truth is hidden from the code.
//!
//! `cargo run --release -p calibration --example monte_carlo -- --draws 1000`
//!
//! Weights +-0.1 %, digitizer noise 0.2 mm in each coordinate, load-cell noise 1.7 to 5 mN a sample (idle channels of
//! the rig in the thesis), spikes and drift. Three plates, four stations. Prints tables; takes minutes.

#[path = "../tests/common/monte_carlo.rs"]
mod monte_carlo;
#[path = "../tests/common/scene.rs"]
mod scene;

use monte_carlo::{Estimator, Layout, Tally};
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut draws = 1000u64;
    let mut args = std::env::args().skip(1);
    while let Some(name) = args.next() {
        match (name.as_str(), args.next().and_then(|v| v.parse().ok())) {
            ("--draws", Some(n)) if n > 0 => draws = n,
            _ => {
                eprintln!("usage: monte_carlo [--draws N], N a whole number, at least 1");
                return ExitCode::from(2);
            }
        }
    }
    println!("{draws} draws of six units; 'draws' is the part of draws in which all six are within the limit\n");

    let cells = monte_carlo::cells(draws);
    println!("cells                 limit      units   draws   95 % below   coverage");
    line("gain (relative)", &cells.gain, 1.5e-3, "0.15 %", 1e2, "%");
    line("zero", &cells.zero, 5e-3, "5 mN", 1e3, "mN");
    println!(
        "series with an entry called wrong, none was: {}; zeros refused: {} (of {} each)\n",
        cells.false_names,
        cells.zeros_refused,
        6 * draws
    );

    println!("geometry over three plates; positions in mm, axes in degrees; limits 0.4 mm and 0.5 degrees");
    println!("plate: distance of its holes from its middle; closed: last station sees the base, each unit seen from two stations");
    println!("                                        within limit       95 % below         rms             coverage      refused");
    println!("layout            touches  estimate     units  all six     pos.   axis     pos.   axis      pos.   axis");
    let mut chosen = None;
    for (name, plate_radius_m, holes, closed) in [
        ("100 mm, 3 holes", 0.1, 3, false),
        ("150 mm, 3 holes", 0.15, 3, false),
        ("150 mm, 4, closed", 0.15, 4, true),
    ] {
        for repeats in [1, 3, 5, 10, 20] {
            let layout = Layout {
                plate_radius_m,
                holes,
                closed,
                repeats,
            };
            // The chain's covariance takes most of the time; its coverage does not depend on the number of touches.
            let found = monte_carlo::surveys(draws, layout, repeats == 5);
            let with_coverage = [true, repeats == 5, false];
            for ((what, e), coverage) in [
                ("joint", &found.joint),
                ("chain", &found.chain),
                ("bound", &found.bound),
            ]
            .into_iter()
            .zip(with_coverage)
            {
                geometry_line(name, repeats, what, e, coverage, found.false_alarms);
            }
            if name.starts_with("150 mm, 4") && repeats == 10 {
                chosen = Some(found);
            }
        }
    }

    if let Some(surveys) = chosen {
        println!("\nself-calibration from poses within 70 mm of the centre; joined with the survey of 10 touches on the closed layout");
        println!("exit points           limit      units   draws   95 % below   coverage");
        for samples in [400, 3000, 10_000] {
            let (alone, fused) = monte_carlo::runs(draws, samples, &surveys);
            line(&format!("{samples} poses"), &alone, 2e-3, "2 mm", 1e3, "mm");
            line("joined with survey", &fused, 4e-4, "0.4 mm", 1e3, "mm");
        }
        println!("\nforce at the tip, tensions 2 to 12 N, same survey; noise of a single reading left out");
        let forces = monte_carlo::forces(draws, &cells, &surveys);
        println!(
            "before (nominal scale, tape measure 5 mm, 2 degrees): rms {:.3} N, 95 % below {:.3} N",
            forces.before.rms(),
            forces.before.p95()
        );
        println!(
            "after:                                                rms {:.4} N, 95 % below {:.4} N, coverage of the 95 % ellipsoid {:.1} %",
            forces.after.rms(),
            forces.after.p95(),
            100.0 * forces.after.coverage()
        );
    }
    ExitCode::SUCCESS
}

fn line(name: &str, t: &Tally, limit: f64, limit_text: &str, scale: f64, unit: &str) {
    println!(
        "{name:<20}  {limit_text:<8}  {:>5.1} %  {:>4.1} %   {:>7.4} {unit:<3}   {:>5.1} %",
        100.0 * t.within(limit),
        100.0 * t.draws_within(limit),
        t.p95() * scale,
        100.0 * t.coverage()
    );
}

fn geometry_line(
    name: &str,
    repeats: usize,
    what: &str,
    e: &Estimator,
    coverage: bool,
    refused: usize,
) {
    let percent = |v: f64| format!("{:.1}", 100.0 * v);
    let (c1, c2) = if coverage {
        (percent(e.position.coverage()), percent(e.axis.coverage()))
    } else {
        ("-".into(), "-".into())
    };
    // The bound is drawn unit by unit, without what units share.
    let all_six = |t: &Tally, limit: f64| match what {
        "bound" => "-".to_owned(),
        _ => percent(t.draws_within(limit)),
    };
    let deg = |v: f64| v.to_degrees();
    println!(
        "{name:<18} {repeats:>5}   {what:<8}  pos {:>5} {:>5} axis {:>5} {:>5}  {:.3}  {:.3}    {:.3}  {:.3}   {c1:>5}  {c2:>5}  {refused:>5}",
        percent(e.position.within(4e-4)),
        all_six(&e.position, 4e-4),
        percent(e.axis.within(0.5f64.to_radians())),
        all_six(&e.axis, 0.5f64.to_radians()),
        1e3 * e.position.p95(),
        deg(e.axis.p95()),
        1e3 * e.position.rms(),
        deg(e.axis.rms()),
    );
}
