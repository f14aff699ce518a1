//! What is asked of the estimators, and what a report reached.

use super::super::study::CHOSEN;
use super::{ModelResult, Results};
use serde::{Deserialize, Serialize};

/// The networks of the thesis.
const THESIS: [&str; 3] = ["mlp", "gru", "lstm"];

/// A goal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// What is asked for.
    pub goal: String,
    /// What was found.
    pub reached: String,
    /// Whether that is enough. `None`: the report was not given what it needs for it.
    pub met: Option<bool>,
}

fn goal(text: &str, found: Option<(String, bool)>) -> Goal {
    let (reached, met) = found.map_or_else(
        || ("not tried".to_owned(), None),
        |(reached, met)| (reached, Some(met)),
    );
    Goal {
        goal: text.to_owned(),
        reached,
        met,
    }
}

/// All goals, with the figures of a report.
pub(super) fn goals(r: &Results) -> Vec<Goal> {
    let model = |name: &str| r.models.iter().find(|m| m.model == name);
    let hybrid = model("hybrid");
    let mae = |m: &ModelResult| m.evaluation.figures.mae_n;
    let best = (r.models.iter())
        .filter(|m| THESIS.contains(&m.model.as_str()))
        .min_by(|a, b| mae(a).total_cmp(&mae(b)));
    vec![
        goal(
            "shipped model: MAE at most 0.25 N",
            hybrid.map(|m| (format!("{:.3} N", mae(m)), mae(m) <= 0.25)),
        ),
        goal(
            "at most half the error of the best of the thesis's networks",
            hybrid.zip(best).map(|(m, best)| {
                let half = 0.5 * mae(best);
                let text = format!("{:.3} N; half of {} is {half:.3} N", mae(m), best.model);
                (text, mae(m) <= half)
            }),
        ),
        goal(
            "slowest bin of speed: at most 1.5 times the overall error",
            hybrid.and_then(|m| {
                let slowest = m.evaluation.by_speed.first()?.mae_n;
                let ratio = slowest / mae(m);
                Some((format!("{slowest:.3} N, {ratio:.2} times"), ratio <= 1.5))
            }),
        ),
        goal(
            "90 % interval covers 88 to 92 % of unseen rows",
            hybrid.and_then(|m| {
                let covered = m.evaluation.covered?;
                Some((percent(covered), within(covered)))
            }),
        ),
        goal(
            "and of the rows of each bin of speed",
            hybrid.and_then(|m| {
                let covered: Option<Vec<f64>> =
                    m.evaluation.by_speed.iter().map(|b| b.covered).collect();
                let covered = covered?;
                let text: Vec<String> = covered.iter().map(|c| percent(*c)).collect();
                Some((text.join(", "), covered.into_iter().all(within)))
            }),
        ),
        goal("60 chosen minutes match 160 random ones", choice(r)),
        goal(
            "p99 of a step: at most 1 ms",
            hybrid.map(|m| step(m, 1000.0)),
        ),
        goal(
            "p99 of a step of the small model (`physics`): at most 50 us",
            model("physics").map(|m| step(m, 50.0)),
        ),
    ]
}

fn choice(r: &Results) -> Option<(String, bool)> {
    let chosen = r.choice.iter().find(|p| p.name == CHOSEN)?;
    let most = r.choice.iter().map(|p| p.minutes).fold(0.0, f64::max);
    // Fewer minutes to draw from than are asked for: the goal is not tried.
    if most < 159.0 {
        return None;
    }
    let random: Vec<f64> = (r.choice.iter())
        .filter(|p| p.minutes > most - 1.0)
        .map(|p| p.figures.mae_n)
        .collect();
    let random = random.iter().sum::<f64>() / random.len().max(1) as f64;
    let mae = chosen.figures.mae_n;
    let text = format!(
        "{mae:.3} N with {:.0} chosen, {random:.3} N with {most:.0} random",
        chosen.minutes
    );
    Some((text, mae <= random))
}

fn step(m: &ModelResult, limit_us: f64) -> (String, bool) {
    let p99 = m.evaluation.step.p99_us;
    (format!("{p99:.1} us"), p99 <= limit_us)
}

fn within(covered: f64) -> bool {
    (0.88..=0.92).contains(&covered)
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}
