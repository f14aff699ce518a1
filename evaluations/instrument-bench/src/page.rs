//! The figures as a page in Markdown.

use crate::data::SOURCE;
use crate::features::{FEATURES, MEMORY};
use crate::results::{Results, Splits, Transfer};
use crate::score::Figure;
use std::fmt::Write as _;

/// Goals, mN·m.
const LEVEL_FILTERED: f64 = 3.0;
const LEVEL_CAUSAL: f64 = 3.5;
const LEVEL_AND_SPEED_CAUSAL: f64 = 4.0;
const OTHER_TOOL: f64 = 4.5;
/// The publication's figure, on random rows of the same runs, mN·m.
const PUBLISHED: f64 = 4.42;

/// Text between generated parts.
const HEAD: &str = include_str!("page/head.txt");
const TAIL: &str = include_str!("page/tail.txt");

/// The page.
#[must_use]
pub fn page(results: &Results) -> String {
    let mut out = HEAD
        .replace("{SOURCE}", SOURCE)
        .replace("{FEATURES}", &FEATURES.to_string());
    goals(&mut out, results);
    data(&mut out, results);
    splits(&mut out, results);
    parts(&mut out, &results.splits[results.causal]);
    ablation(&mut out, results);
    poses(&mut out, results);
    transfers(&mut out, &results.transfers);
    out += &TAIL.replace("{MEMORY}", &MEMORY.to_string());
    out
}

fn goals(out: &mut String, results: &Results) {
    let (filtered, causal) = (
        &results.splits[results.filtered],
        &results.splits[results.causal],
    );
    *out += "\n## Goals\n\n| what | RMSE, mN·m | goal | |\n|---|---:|---:|---|\n";
    let mut line = |what: &str, figure: f64, goal: f64| {
        let word = if figure <= goal {
            "reached".to_owned()
        } else {
            format!("missed by {:.2}", figure - goal)
        };
        let _ = writeln!(out, "| {what} | {figure:.2} | <= {goal:.1} | {word} |");
    };
    line(
        "one load left out, the publication's filter",
        filtered.level.rmse_mnm,
        LEVEL_FILTERED,
    );
    line(
        "one load left out, causal",
        causal.level.rmse_mnm,
        LEVEL_CAUSAL,
    );
    line(
        "load and speed left out, causal",
        causal.level_and_speed.rmse_mnm,
        LEVEL_AND_SPEED_CAUSAL,
    );
    for transfer in results.transfers.iter().take(2) {
        let what = format!(
            "`{}` to `{}`, two files, causal",
            transfer.from, transfer.to
        );
        line(&what, transfer.corrected_mnm, OTHER_TOOL);
    }
    let rows = |splits: &Splits| splits.rows.as_ref().map_or(f64::NAN, |f| f.rmse_mnm);
    let _ = writeln!(
        out,
        "\nBeside them, the publication's own split, random rows of the same runs: {:.2} with its filter, {:.2} causal; published are {PUBLISHED}. \
         A test row's neighbours a millisecond away are in the training there: it is no figure for new data.",
        rows(filtered),
        rows(causal)
    );
}

fn data(out: &mut String, results: &Results) {
    let set = &results.set;
    let runaway: usize = set.scored.iter().map(|s| s.runaway).sum();
    let _ = writeln!(
        out,
        "\n## Data\n\n`{}`: {} runs, {} rows of {} count (the jaw closes, first and last second off).",
        set.name,
        set.runs.len(),
        set.rows(),
        set.runs.iter().map(|run| run.rows.len()).sum::<usize>()
    );
    for (run, scored) in set
        .runs
        .iter()
        .zip(&set.scored)
        .filter(|(_, s)| s.runaway > 0)
    {
        let _ = writeln!(
            out,
            "`{}` has a runaway (the spindle is faster than 6 rad/s); the {} rows whose filter or memory meets it don't count.",
            run.name, scored.runaway
        );
    }
    if runaway == 0 {
        *out += "No row is left out for a runaway.\n";
    }
}

fn interval(figure: &Figure) -> String {
    let (low, high) = figure.interval_mnm;
    format!("{:.2} ({low:.2} to {high:.2})", figure.rmse_mnm)
}

fn splits(out: &mut String, results: &Results) {
    *out += "\n## Splits\n\nRMSE in mN·m; in brackets the 95 % interval, with what was left out drawn anew (4000 draws). \
             The penalty is chosen inside the training runs by the same kind of split.\n\n\
             | model | random rows | one run | one load | one load and speed |\n|---|---:|---:|---:|---:|\n";
    for s in &results.splits {
        let rows = s
            .rows
            .as_ref()
            .map_or("-".to_owned(), |f| format!("{:.2}", f.rmse_mnm));
        let _ = writeln!(
            out,
            "| {} | {rows} | {} | {} | {} |",
            s.words,
            interval(&s.run),
            interval(&s.level),
            interval(&s.level_and_speed)
        );
    }
}

/// Where the errors are.
fn parts(out: &mut String, causal: &Splits) {
    let mut table = |title: &str,
                     steps: u8,
                     unit: &dyn Fn(u8) -> String,
                     of: &dyn Fn(&Figure, u8) -> Option<f64>| {
        let _ = write!(out, "\n| {title} |");
        (0..steps).for_each(|step| out.push_str(&format!(" {} |", unit(step))));
        *out += "\n|---|";
        (0..steps).for_each(|_| out.push_str("---:|"));
        for (words, figure) in [
            ("one load left out", &causal.level),
            ("load and speed left out", &causal.level_and_speed),
        ] {
            let _ = write!(out, "\n| {words} |");
            for step in 0..steps {
                let text = of(figure, step).map_or("-".to_owned(), |v| format!("{v:.2}"));
                let _ = write!(out, " {text} |");
            }
        }
        out.push('\n');
    };
    table(
        "load",
        10,
        &|s| format!("{} %", 10 * (u32::from(s) + 1)),
        &|f, s| f.part(|l| l.level == s),
    );
    table("speed", 5, &|s| format!("0.{} Hz", s + 1), &|f, s| {
        f.part(|l| l.speed == s)
    });
}

/// What each group of regressors is worth.
fn ablation(out: &mut String, results: &Results) {
    let all = &results.splits[results.causal].level;
    *out += "\n## What the groups of regressors are worth\n\nOne load left out, causal; the others are fitted anew.\n\n| without | RMSE, mN·m | more by |\n|---|---:|---:|\n";
    let _ = writeln!(out, "| - | {:.2} | |", all.rmse_mnm);
    for (words, figure) in &results.ablation {
        let more = figure.rmse_mnm - all.rmse_mnm;
        let _ = writeln!(out, "| {words} | {:.2} | {more:+.2} |", figure.rmse_mnm);
    }
}

/// Poses of the shaft that the training did not have.
fn poses(out: &mut String, results: &Results) {
    *out += "\n## Another pose of the shaft\n\nFive sets at five angles each, four loads; one angle left out, causal, without any correction. RMSE in mN·m.\n\n\
             | angle | all | 1 | 2 | 3 | 4 | 5 |\n|---|---:|---:|---:|---:|---:|---:|\n";
    for (words, figure) in &results.poses {
        let _ = write!(out, "| {words} | {} |", interval(figure));
        for pose in 1..=5 {
            let text = figure
                .part(|l| l.level == pose)
                .map_or("-".to_owned(), |v| format!("{v:.2}"));
            let _ = write!(out, " {text} |");
        }
        out.push('\n');
    }
}

fn transfers(out: &mut String, all: &[Transfer]) {
    *out += "\n## Another tool, another session\n\nThe model of one set on the runs of another, causal. A correction of 18 numbers is taken from two files, and tested on all others. \
             The two files are named before the test: least load at the least speed, most load at the most speed. Beside it, all pairs of files whose loads differ by six steps \
             or more (three where there are four loads).\n\n\
             | model of | tested on | without | two files | | any such pair: median | 90 % below | worst | pairs |\n|---|---|---:|---:|---|---:|---:|---:|---:|\n";
    for t in all {
        let at =
            |share: f64| t.any_two_mnm[((t.any_two_mnm.len() - 1) as f64 * share).round() as usize];
        let short = |name: &str| name.rsplit('/').next().unwrap_or(name).to_owned();
        let _ = writeln!(
            out,
            "| {} | {} | {:.2} | {:.2} | {}, {} | {:.2} | {:.2} | {:.2} | {} |",
            t.from,
            t.to,
            t.raw_mnm,
            t.corrected_mnm,
            short(&t.files[0]),
            short(&t.files[1]),
            at(0.5),
            at(0.9),
            at(1.0),
            t.any_two_mnm.len()
        );
    }
}
