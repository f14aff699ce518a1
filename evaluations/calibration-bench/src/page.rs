//! The figures as a page in Markdown.

use crate::cells::{
    self, PayOutFigures, PowerUpFigures, SetErrors, LEARNT, POWER_UP_LIMIT_SD, POWER_UP_MISS_N,
};
use crate::surveys::{Estimator, GeometryFigures, Layout};
use crate::tally::Tally;
use crate::{forces, runs, surveys};
use std::fmt::Write as _;

/// Limit of a gain's relative error.
pub const GAIN_LIMIT: f64 = 1.5e-3;
/// Limit of a zero's error, N.
pub const ZERO_LIMIT_N: f64 = 5e-3;
/// Limit of an exit point's error, m.
pub const POSITION_LIMIT_M: f64 = 4e-4;
/// Limit of an axis's error, degrees.
pub const AXIS_LIMIT_DEG: f64 = 0.5;
/// Limit of an exit point from self-calibration alone, m.
pub const SELF_LIMIT_M: f64 = 2e-3;

/// Poses of the runs lie within this distance of the centre, m.
const REACH_M: f64 = 0.07;
/// Reaches that are compared, m.
const REACHES_M: [f64; 5] = [0.03, 0.05, 0.07, 0.1, 0.14];
/// Lengths of a run that are compared, s.
const LENGTHS_S: [usize; 4] = [20, 100, 300, 1000];
/// Samples that count a second: neighbouring ones have like errors (host/calibrate/src/moving.rs).
const SAMPLES_A_SECOND: usize = 5;
/// Open chains that are compared: holes of a plate and its radius, m.
const CHAIN_HOLES: [u8; 5] = [3, 4, 6, 8, 12];
const CHAIN_RADII_M: [f64; 3] = [0.15, 0.2, 0.25];
/// Touches of each point in them.
const CHAIN_TOUCHES: usize = 20;

/// A layout that is tried: its name, plate radius in m, holes of a plate, closed, touches.
const LAYOUTS: [(&str, f64, u8, bool, usize); 6] = [
    ("open", 0.15, 3, false, 5),
    ("open", 0.15, 3, false, 20),
    ("open, plates of 100 mm", 0.10, 3, false, 20),
    ("closed", 0.15, 4, true, 3),
    ("closed", 0.15, 4, true, 5),
    ("closed", 0.15, 4, true, 10),
];

/// Standard deviations of the robot's pose that are compared, m.
const POSES_M: [f64; 3] = [0.0, 5e-4, 1e-3];
/// Sets of weights: what their errors are, and the correlation that the fit counts with.
const SETS: [(SetErrors, f64); 4] = [
    (SetErrors::Own, 1.0),
    (SetErrors::Common, 1.0),
    (SetErrors::Own, 0.0),
    (SetErrors::Common, 0.0),
];

/// Draws everything and writes the page. `progress` is told what goes on.
#[must_use]
pub fn draw(draws: u64, progress: &mut dyn FnMut(&str)) -> String {
    let mut out = String::new();
    progress("gains and zeros");
    let cells = cells::cells(draws);
    let power_ups = cells::power_ups(draws);
    let pay_outs = cells::pay_outs(draws);
    let mut found: Vec<(usize, GeometryFigures)> = Vec::new();
    for (i, &(name, plate_radius_m, holes, closed, repeats)) in LAYOUTS.iter().enumerate() {
        progress(&format!("survey: {name}, {repeats} touches"));
        let layout = Layout {
            plate_radius_m,
            holes,
            closed,
            repeats,
        };
        // The chain's covariance takes most of the time; its coverage does not depend on the number
        // of touches.
        found.push((i, surveys::surveys(draws, layout, repeats == 5)));
    }
    let best = &found[LAYOUTS.len() - 1].1;
    let mut moving = Vec::new();
    for poses in [400, 3000, 10_000] {
        progress(&format!("self-calibration: {poses} poses"));
        moving.push((poses, runs::runs(draws, poses, REACH_M, best)));
    }
    progress("self-calibration: how long, how far");
    let lengths = lengths(draws.div_ceil(10), best);
    progress("open chains");
    let chains = chains(draws.div_ceil(10));
    progress("force at the tip");
    let force = POSES_M.map(|sd_m| (sd_m, forces::forces(draws, &cells, best, sd_m)));
    progress("sets of weights");
    let sets = SETS.map(|(errors, correlation)| cells::sets(draws, errors, correlation));

    head(&mut out, draws);
    goals(&mut out, &cells, best, &moving);
    cell_tables(&mut out, &cells, (&power_ups, &pay_outs), draws);
    set_table(&mut out, &sets);
    geometry_table(&mut out, &found, draws);
    chain_table(&mut out, &chains);
    run_table(&mut out, &moving);
    length_table(&mut out, &lengths, draws.div_ceil(10));
    force_table(&mut out, &force);
    out
}

fn head(out: &mut String, draws: u64) {
    let sources = evaluation::sources();
    let _ = write!(
        out,
        "# Accuracy of the calibration\n\n\
Written by `cargo xtask calibration-bench --draws {draws} --markdown docs/calibration/figures.md` ({sources}); don't edit. What the figures\n\
mean for a lab is in the [guide](../calibration.md).\n\n\
Monte Carlo over {draws} made-up rigs of six units. The code under test sees readings only, never the truth. Assumptions: weights\n\
within +-0.1 % (equally likely), one set for all units; local gravity known to 0.01 %; load-cell noise 1.7 to 5 mN a sample, correlated\n\
from one sample to the next, with spikes and drift; digitizer noise 0.2 mm (standard deviation in one coordinate); three plates, four\n\
stations. *Six* is the part of draws in which all six units are within the limit; a draw that was refused is not within. *Coverage* is\n\
the part of the 95 % intervals that hold the truth.\n\n"
    );
}

fn percent(part: f64) -> String {
    format!("{:.1} %", 100.0 * part)
}

fn goals(
    out: &mut String,
    cells: &cells::CellFigures,
    best: &GeometryFigures,
    moving: &[(usize, (Tally, Tally))],
) {
    let _ = write!(
        out,
        "## Goals\n\n\
| goal | limit | within, all six units of a draw | 95 % of draws | coverage, 93 to 97 % |\n\
| --- | --- | ---: | --- | ---: |\n"
    );
    let covered = |tally: &Tally| {
        let covered = tally.coverage();
        let mark = if (0.93..=0.97).contains(&covered) {
            ""
        } else {
            " (outside)"
        };
        format!("{}{mark}", percent(covered))
    };
    let mut row = |name: &str, limit_text: &str, tally: &Tally, limit: f64| {
        let within = tally.draws_within(limit);
        let verdict = if within >= 0.95 { "reached" } else { "missed" };
        let _ = writeln!(
            out,
            "| {name} | {limit_text} | {} | {verdict} | {} |",
            percent(within),
            covered(tally)
        );
    };
    row("gain", "0.15 %", &cells.gain, GAIN_LIMIT);
    row("zero", "5 mN", &cells.zero, ZERO_LIMIT_N);
    row(
        "position, closed survey, 10 touches, joint estimate",
        "0.4 mm",
        &best.joint.position,
        POSITION_LIMIT_M,
    );
    row(
        "axis, the same",
        "0.5 deg",
        &best.joint.axis,
        AXIS_LIMIT_DEG.to_radians(),
    );
    for (poses, (alone, _)) in moving {
        row(
            &format!("self-calibration alone, {poses} poses"),
            "2 mm",
            alone,
            SELF_LIMIT_M,
        );
    }
    let _ = writeln!(
        out,
        "| force of 12 N, curved cells | | | | {} |\n",
        covered(&cells.gain_beyond)
    );
}

fn cell_tables(
    out: &mut String,
    cells: &cells::CellFigures,
    (power_ups, pay_outs): (&PowerUpFigures, &PayOutFigures),
    draws: u64,
) {
    let _ = write!(
        out,
        "## Cells\n\n\
| | limit | units within | six | 95 % below | coverage |\n\
| --- | --- | ---: | ---: | ---: | ---: |\n"
    );
    for (name, limit_text, tally, limit, scale, unit) in [
        (
            "gain, seven weights twice up and down, 1 s each",
            "0.15 %",
            &cells.gain,
            GAIN_LIMIT,
            1e2,
            "%",
        ),
        (
            "zero, 10 s, spikes and drift",
            "5 mN",
            &cells.zero,
            ZERO_LIMIT_N,
            1e3,
            "mN",
        ),
    ] {
        let _ = writeln!(
            out,
            "| {name} | {limit_text} | {} | {} | {:.3} {unit} | {} |",
            percent(tally.within(limit)),
            percent(tally.draws_within(limit)),
            scale * tally.p95(),
            percent(tally.coverage())
        );
    }
    let ratio = |(part, of): (usize, usize)| percent(part as f64 / of as f64);
    let (fitted, beyond) = (cells.curve_fitted, &cells.gain_beyond);
    let straight = (beyond.hits - fitted.0, beyond.intervals - fitted.1);
    let _ = write!(
        out,
        "\nA gain has two intervals: for forces that the weights reach, which is that of the table, and up to 12 N, where 1 kg is 9.8 N and a curve\n\
that the weights don't exclude bends the rest. The cells of the table are straight; nobody knows that of a cell, so that their intervals up to\n\
12 N are too wide on purpose and hold the truth in {}. Six more cells a draw are curved, with curves drawn from what the fit assumes\n\
(standard deviation 0.004 /N). Their intervals hold the true force of 12 N in {} of the cells that gave a gain: in {} of the {} with\n\
a curve in the fit, in {} of the {} without. {} of {} were refused, most with the question whether the cell is curved. The errors of their\n\
weights are normally distributed. Where any error within the limits is equally likely, as in the table, it is {}: the error at 12 N is\n\
mostly that of the largest weight, and that never reaches two standard deviations.\n",
        percent(cells.gain_to_largest.coverage()),
        percent(cells.gain_beyond.coverage()),
        ratio(fitted),
        fitted.1,
        ratio(straight),
        straight.1,
        6 * draws as usize - cells.gain_beyond.intervals,
        6 * draws,
        percent(cells.gain_beyond_rectangular.coverage()),
    );
    let _ = write!(
        out,
        "\nSeries without a wrong entry in which an entry was called wrong: {} of {}. Zeros refused: {} of {}.\n\n\
Power-ups: units at any mounting angle (axis known to 0.003 rad, mass of motor and rack 0.5 kg known to 5 g), 12 power-ups each, in each of\n\
which the converter's own calibration misses the zero by up to {POWER_UP_MISS_N} N. A zero further than {POWER_UP_LIMIT_SD} standard deviations from the ones\n\
before, or outside of what they leave possible with such misses, is refused. *Pay-out test*: read before and after 3 mm of the cable are\n\
paid out (`calibrate zero --pay-out`); it needs no earlier power-up.\n\n\
| | |\n| --- | ---: |\n\
| zeros of slack cables refused | {} |\n\
| zeros of cables that pull with 0.7 to 1.0 N accepted, fewer than {LEARNT} power-ups before | {} |\n\
| the same, from the {LEARNT}th power-up on | {} |\n\
| pay-out test: slack cables refused | {} |\n\
| pay-out test: cables that pull with 0.7 to 1.0 N accepted | {} |\n\
| pay-out test: cables that pull with 0.03 to 0.1 N accepted | {} |\n\
| coverage of the part of the mounting angle | {} |\n\
| coverage of the converter's own offset | {} |\n\n",
        cells.false_names,
        6 * draws,
        cells.zeros_refused,
        6 * draws,
        ratio((power_ups.slack_refused, power_ups.slack)),
        ratio(power_ups.preloaded_early),
        ratio(power_ups.preloaded),
        ratio(pay_outs.slack),
        ratio(pay_outs.preloaded),
        ratio(pay_outs.faint),
        ratio(power_ups.mounting),
        ratio(power_ups.converter),
    );
}

fn geometry_table(out: &mut String, found: &[(usize, GeometryFigures)], draws: u64) {
    let _ = write!(
        out,
        "## Geometry over three plates\n\n\
*Open*: the first station sees the base, each further one the plate before it and the plate after it, each unit is measured from one\n\
station; plates of three holes 150 mm from their middle. *Closed*: the last station sees the base too, each unit is measured from two\n\
stations, plates have four holes. *Touches*: times that each point is touched from each station. *Bound*: draws from the Cramer-Rao bound,\n\
what the best unbiased estimate could show.\n\n\
| layout | touches | estimate | within 0.4 mm | six | 95 % below | axis within 0.5 deg | six | 95 % below | coverage position, axis |\n\
| --- | ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | --- |\n"
    );
    for (i, figures) in found {
        let (name, .., repeats) = LAYOUTS[*i];
        for (what, estimator) in [
            ("joint", &figures.joint),
            ("chain", &figures.chain),
            ("bound", &figures.bound),
        ] {
            let stated = what == "joint" || (what == "chain" && repeats == 5);
            // The bound is drawn unit by unit, without what units share.
            geometry_row(
                out,
                (name, repeats, what),
                estimator,
                stated,
                what != "bound",
            );
        }
    }
    let refused: Vec<String> = found
        .iter()
        .map(|(_, figures)| figures.false_alarms.to_string())
        .collect();
    let _ = write!(
        out,
        "\nSurveys without a fault that were refused, in the order of the table: {} of {draws} each (the alarm level is 0.1 %).\n\n",
        refused.join(", ")
    );
}

fn geometry_row(
    out: &mut String,
    (name, repeats, what): (&str, usize, &str),
    e: &Estimator,
    stated: bool,
    together: bool,
) {
    let six = |tally: &Tally, limit: f64| {
        if together {
            percent(tally.draws_within(limit))
        } else {
            String::new()
        }
    };
    let axis_limit = AXIS_LIMIT_DEG.to_radians();
    let coverage = if stated {
        format!(
            "{}, {}",
            percent(e.position.coverage()),
            percent(e.axis.coverage())
        )
    } else {
        String::new()
    };
    let _ = writeln!(
        out,
        "| {name} | {repeats} | {what} | {} | {} | {:.2} mm | {} | {} | {:.2} deg | {coverage} |",
        percent(e.position.within(POSITION_LIMIT_M)),
        six(&e.position, POSITION_LIMIT_M),
        1e3 * e.position.p95(),
        percent(e.axis.within(axis_limit)),
        six(&e.axis, axis_limit),
        e.axis.p95().to_degrees(),
    );
}

fn run_table(out: &mut String, moving: &[(usize, (Tally, Tally))]) {
    let _ = write!(
        out,
        "## Self-calibration\n\n\
Poses within 70 mm of the centre, 0.1 mm of travel noise, 0.2 mm of noise of the tip, both independent from sample to sample; scale of the\n\
reel known to 0.1 %, stretch to 0.05 mm/N. *Joined*: with the closed survey of 10 touches.\n\n\
| run | within 2 mm | six | 95 % below | coverage | joined, 95 % below | joined, coverage |\n\
| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n"
    );
    for (poses, (alone, fused)) in moving {
        let _ = writeln!(
            out,
            "| {poses} poses | {} | {} | {:.2} mm | {} | {:.2} mm | {} |",
            percent(alone.within(SELF_LIMIT_M)),
            percent(alone.draws_within(SELF_LIMIT_M)),
            1e3 * alone.p95(),
            percent(alone.coverage()),
            1e3 * fused.p95(),
            percent(fused.coverage()),
        );
    }
    out.push('\n');
}

/// Part of draws with all six exit points within 2 mm, by length of the run (rows) and reach of the
/// motion.
fn lengths(draws: u64, surveys: &GeometryFigures) -> Vec<Vec<f64>> {
    LENGTHS_S
        .iter()
        .map(|seconds| {
            REACHES_M
                .iter()
                .map(|reach_m| {
                    let samples = SAMPLES_A_SECOND * seconds;
                    let (alone, _) = runs::runs(draws, samples, *reach_m, surveys);
                    alone.draws_within(SELF_LIMIT_M)
                })
                .collect()
        })
        .collect()
}

fn length_table(out: &mut String, lengths: &[Vec<f64>], draws: u64) {
    let reaches: Vec<String> = REACHES_M
        .iter()
        .map(|r| format!("{:.0} mm", 1e3 * r))
        .collect();
    let _ = write!(
        out,
        "How long and how far the robot has to move: part of {draws} draws with all six exit points within 2 mm, by the reach of the poses to\n\
every side. One sample in 0.2 s counts, since errors of neighbouring ones are alike.\n\n\
| run | {} |\n| --- |{}\n",
        reaches.join(" | "),
        " ---: |".repeat(reaches.len())
    );
    for (seconds, row) in LENGTHS_S.iter().zip(lengths) {
        let cells: Vec<String> = row.iter().map(|part| percent(*part)).collect();
        let _ = writeln!(out, "| {seconds} s | {} |", cells.join(" | "));
    }
    out.push('\n');
}

/// Part of draws with all six exit points within 0.4 mm by an open chain, by holes of a plate
/// (rows) and its radius.
fn chains(draws: u64) -> Vec<Vec<f64>> {
    CHAIN_HOLES
        .iter()
        .map(|&holes| {
            CHAIN_RADII_M
                .iter()
                .map(|&plate_radius_m| {
                    let layout = Layout {
                        plate_radius_m,
                        holes,
                        closed: false,
                        repeats: CHAIN_TOUCHES,
                    };
                    let found = surveys::surveys(draws, layout, false);
                    found.joint.position.draws_within(POSITION_LIMIT_M)
                })
                .collect()
        })
        .collect()
}

fn chain_table(out: &mut String, chains: &[Vec<f64>]) {
    let radii: Vec<String> = CHAIN_RADII_M
        .iter()
        .map(|r| format!("plates of {:.0} mm", 1e3 * r))
        .collect();
    let _ = write!(
        out,
        "What an open chain needs: part of draws with all six exit points within 0.4 mm, {CHAIN_TOUCHES} touches, by the holes of each plate\n\
and their distance from its middle. The joint estimate is used, which is as good as the bound.\n\n\
| holes of a plate | {} |\n| --- |{}\n",
        radii.join(" | "),
        " ---: |".repeat(radii.len())
    );
    for (holes, row) in CHAIN_HOLES.iter().zip(chains) {
        let cells: Vec<String> = row.iter().map(|part| percent(*part)).collect();
        let _ = writeln!(out, "| {holes} | {} |", cells.join(" | "));
    }
    out.push('\n');
}

fn force_table(out: &mut String, force: &[(f64, forces::ForceFigures)]) {
    out.push_str(
        "## Force at the tip\n\n\
Tensions of 2 to 12 N at random poses. *Pose*: standard deviation of each coordinate of the tip as the robot reports it. *Ball*: the radius that is\n\
stated for the mean force, median over the draws. Left out: friction between cell and tip, noise of a single reading.\n\
The real force at the tip is worse by these.\n\n\
| | pose | error, RMS | 95 % below | ball | coverage of the ball | of the ellipsoid |\n\
| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n",
    );
    if let Some((sd_m, figures)) = force.first() {
        let _ = writeln!(
            out,
            "| before: nominal scale, tape measure (5 mm), protractor (2 degrees) | {:.1} mm | {:.3} N | {:.3} N | | | |",
            1e3 * sd_m,
            figures.before.rms(),
            figures.before.p95(),
        );
    }
    for (sd_m, figures) in force {
        let _ = writeln!(
            out,
            "| after: gains, zeros, closed survey of 10 touches | {:.1} mm | {:.4} N | {:.4} N | {:.4} N | {} | {} |",
            1e3 * sd_m,
            figures.after.rms(),
            figures.after.p95(),
            calibration::stats::median(&figures.radii_n),
            percent(figures.balls.coverage()),
            percent(figures.after.coverage())
        );
    }
}

fn set_table(out: &mut String, sets: &[Tally]) {
    out.push_str(
        "Sets of weights of class M2, gravity known, one cell a draw. *Own*: each weight has its own error within the limits of the class.\n\
*Common*: all have the same part of their limits. *Correlation*: what the fit counts with (`--correlation`; 1 without it).\n\n\
| errors of the set | correlation | 95 % below | coverage |\n| --- | ---: | ---: | ---: |\n",
    );
    for ((errors, correlation), found) in SETS.iter().zip(sets) {
        let what = match errors {
            SetErrors::Own => "own",
            SetErrors::Common => "common",
        };
        let _ = writeln!(
            out,
            "| {what} | {correlation} | {:.4} % | {} |",
            100.0 * found.p95(),
            percent(found.coverage())
        );
    }
    out.push('\n');
}
