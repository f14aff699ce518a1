//! The figures of a report as Markdown.

use super::super::card::{newtons, percent as percent_2};
use super::super::study::{CHOICE_MARGIN_N, WHOLE};
use super::goals::NOT_TRIED;
use super::{ModelResult, Results};
use estimator::metrics::Difference;
use std::fmt::Write as _;

macro_rules! line {
    ($text:expr, $($arg:tt)*) => {{
        // A String takes every line.
        let _ = writeln!($text, $($arg)*);
    }};
}

fn interval(half: Option<f64>) -> String {
    half.map_or_else(String::new, |h| format!(" ± {h:.3}"))
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{:.1}", 100.0 * s))
}

fn difference(difference: Option<Difference>) -> String {
    difference.map_or_else(
        || "-".to_owned(),
        |d| format!("{:+.3}{}", d.mean_n, interval(d.half_n)),
    )
}

/// Tables in Markdown.
#[must_use]
pub fn tables(r: &Results) -> String {
    let mut text = String::new();
    head(&mut text, r);
    if !r.goals.is_empty() {
        line!(text, "## Goals\n");
        line!(text, "| goal | reached | |\n| --- | --- | --- |");
        for goal in &r.goals {
            let met = match goal.met {
                Some(true) => "met",
                Some(false) => "missed",
                None if goal.reached == NOT_TRIED => "-",
                None => "not decided",
            };
            line!(text, "| {} | {} | {met} |", goal.goal, goal.reached);
        }
        line!(text, "");
    }
    line!(text, "## Models\n");
    models_table(&mut text, &r.models);
    by_speed(&mut text, &r.models);
    intervals(&mut text, &r.models);
    elsewhere(&mut text, r);
    if !r.three_axes.is_empty() {
        line!(
            text,
            "## Three-dimensional forces: length of the error vector\n"
        );
        models_table(&mut text, &r.three_axes);
        components(&mut text, &r.three_axes);
    }
    studies(&mut text, r);
    text.trim_end().to_owned() + "\n"
}

fn head(text: &mut String, r: &Results) {
    let list = |trials: &[usize]| {
        let trials: Vec<String> = trials.iter().map(ToString::to_string).collect();
        trials.join(", ")
    };
    let more = r.unseen.as_ref().map_or_else(String::new, |(name, count)| {
        format!(" and the {count} trials of `{name}`")
    });
    line!(text, "# Figures of the estimators\n");
    if !r.finished {
        line!(
            text,
            "**Unfinished: the report was broken off**, or is still being written. What it had found until then:\n"
        );
    }
    line!(
        text,
        "`forcectl estimate report` wrote this page. Training: trials {} of `{}`. Test: trials {}{more}. {} rows per second.",
        list(&r.training),
        r.data,
        list(&r.test),
        r.rate_hz
    );
    line!(
        text,
        "MAE with the 95 % interval over test trials. Differences are paired over the test trials, with their 95 % intervals. Times are of the machine that wrote this page.\n"
    );
}

fn models_table(text: &mut String, models: &[ModelResult]) {
    line!(text, "| model | MAE, N | less the last row's, N | RMSE, N | NRMSE | parameters | epochs | training, s | step, us: median | p99 | 90 % interval covers, % |");
    line!(
        text,
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    );
    for (n, m) in models.iter().enumerate() {
        let (e, f) = (&m.evaluation, &m.evaluation.figures);
        let less = if n + 1 == models.len() {
            "-".to_owned()
        } else {
            difference(m.difference)
        };
        let epochs = m.epochs.map_or_else(
            || "-".to_owned(),
            |e| format!("{e}{}", if e.cut { ", cut off" } else { "" }),
        );
        line!(
            text,
            "| {} | {:.3}{} | {less} | {:.3} | {} | {} | {epochs} | {:.1} | {:.1} | {:.1} | {} |",
            m.model,
            f.mae_n,
            interval(f.mae_half_n),
            f.rmse_n,
            percent_2(f.nrmse),
            m.parameters,
            m.training_s,
            e.step.median_us,
            e.step.p99_us,
            percent(e.covered)
        );
    }
    line!(text, "");
}

fn by_speed(text: &mut String, models: &[ModelResult]) {
    let Some(first) = models.first() else {
        return;
    };
    line!(text, "## By speed of the tip\n");
    let bins = &first.evaluation.by_speed;
    let heads: Vec<String> = (bins.iter())
        .map(|b| format!("below {:.1} mm/s", 1e3 * b.below_m_per_s))
        .collect();
    line!(
        text,
        "| model, MAE in N | {} | slowest per overall | turning round | sliding |",
        heads.join(" | ")
    );
    line!(text, "| --- |{}", " --- |".repeat(heads.len() + 3));
    let rows: Vec<String> = bins.iter().map(|b| b.rows.to_string()).collect();
    line!(text, "| rows | {} | | | |", rows.join(" | "));
    for m in models {
        let e = &m.evaluation;
        let bins: Vec<String> = e.by_speed.iter().map(|b| newtons(b.mae_n)).collect();
        let slowest = e.by_speed.first().and_then(|b| b.mae_n);
        let ratio = slowest.map(|s| format!("{:.2}", s / e.figures.mae_n));
        line!(
            text,
            "| {} | {} | {} | {} | {} |",
            m.model,
            bins.join(" | "),
            ratio.unwrap_or_else(|| "-".to_owned()),
            newtons(e.mae_reversing_n),
            newtons(e.mae_sliding_n)
        );
    }
    line!(text, "");
}

fn intervals(text: &mut String, models: &[ModelResult]) {
    let with: Vec<&ModelResult> = models
        .iter()
        .filter(|m| m.evaluation.covered.is_some())
        .collect();
    if with.is_empty() {
        return;
    }
    line!(
        text,
        "## Intervals: coverage of 90 % intervals, and mean half width\n"
    );
    for m in with {
        let by_trial: Vec<String> = m
            .evaluation
            .covered_by_trial
            .iter()
            .map(|c| format!("{:.1}", 100.0 * c))
            .collect();
        line!(
            text,
            "{}: {} % of all rows; by trial {} %.\n",
            m.model,
            percent(m.evaluation.covered),
            by_trial.join(", ")
        );
        line!(
            text,
            "| speed below, mm/s | covers, % | half width, N |\n| --- | --- | --- |"
        );
        for b in &m.evaluation.by_speed {
            let width = newtons(b.half_width_n);
            line!(
                text,
                "| {:.1} | {} | {width} |",
                1e3 * b.below_m_per_s,
                percent(b.covered)
            );
        }
        line!(text, "");
    }
}

/// Errors of the components of a force.
fn components(text: &mut String, models: &[ModelResult]) {
    line!(
        text,
        "| model, MAE in N | x | y | z |\n| --- | --- | --- | --- |"
    );
    for m in models {
        let by = m.evaluation.mae_by_component_n.iter();
        let by: Vec<String> = by.map(|n| format!("{n:.3}")).collect();
        line!(text, "| {} | {} |", m.model, by.join(" | "));
    }
    line!(text, "");
}

fn elsewhere(text: &mut String, r: &Results) {
    if r.elsewhere.is_empty() {
        return;
    }
    line!(text, "## On other data, not trained anew\n");
    line!(text, "| data | model | MAE, N | RMSE, N | slowest bin, N | rows | 90 % interval covers, % |\n| --- | --- | --- | --- | --- | --- | --- |");
    for other in &r.elsewhere {
        for (model, e) in &other.models {
            line!(
                text,
                "| {} | {model} | {:.3}{} | {:.3} | {} | {} | {} |",
                other.name,
                e.figures.mae_n,
                interval(e.figures.mae_half_n),
                e.figures.rmse_n,
                newtons(e.by_speed.first().and_then(|b| b.mae_n)),
                e.figures.rows,
                percent(e.covered)
            );
        }
    }
    line!(text, "");
}

fn studies(text: &mut String, r: &Results) {
    if !r.learning.is_empty() {
        line!(text, "## Minutes of training, drawn at random\n");
        line!(text, "| model | minutes | MAE, N |\n| --- | --- | --- |");
        for (name, points) in &r.learning {
            for p in points {
                line!(
                    text,
                    "| {name} | {:.0} | {:.3}{} |",
                    p.minutes,
                    p.figures.mae_n,
                    interval(p.figures.mae_half_n)
                );
            }
        }
        line!(text, "");
    }
    if let Some(first) = r.choice.first() {
        line!(
            text,
            "## Choice of minutes: the shipped model on {} test trials (`{}`)\n",
            first.by_trial.len(),
            r.choice_test
        );
        let most = r.choice.iter().map(|p| p.minutes).fold(0.0, f64::max);
        line!(
            text,
            "| minutes | | MAE, N | less the mean of the draws of {most:.0} min, N |\n| --- | --- | --- | --- |"
        );
        for p in &r.choice {
            line!(
                text,
                "| {:.0} | {} | {:.3}{} | {} |",
                p.minutes,
                p.name,
                p.figures.mae_n,
                interval(p.figures.mae_half_n),
                difference(p.difference)
            );
        }
        line!(text, "");
        line!(
            text,
            "Chosen minutes match where their error is at most {CHOICE_MARGIN_N} N above that of {most:.0} random ones, with the whole 95 % interval of the difference. The margin was set before the figures were known. The interval is over test trials; how much the draws differ is in the rows.\n"
        );
    }
    if let Some(first) = r.ablation.first() {
        line!(
            text,
            "## Without a group of inputs: the shipped model, trained anew on {:.0} min\n",
            first.minutes
        );
        line!(
            text,
            "| held at its mean | MAE, N | less the MAE with all inputs, N |\n| --- | --- | --- |"
        );
        for p in &r.ablation {
            let less = if p.name == WHOLE {
                "-".to_owned()
            } else {
                difference(p.difference)
            };
            line!(
                text,
                "| {} | {:.3}{} | {less} |",
                p.name,
                p.figures.mae_n,
                interval(p.figures.mae_half_n)
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_says_whether_it_is_finished() {
        let mut results = Results::default();
        let mark = "**Unfinished: the report was broken off**";
        assert!(tables(&results).contains(mark));
        results.finished = true;
        assert!(!tables(&results).contains(mark));
    }
}
