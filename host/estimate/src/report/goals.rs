//! What is asked of the estimators, and what a report reached.

use super::super::study::{Point, CHOICE_MARGIN_N, CHOSEN};
use super::{ModelResult, Results};
use serde::{Deserialize, Serialize};

/// The networks of the thesis.
const THESIS: [&str; 3] = ["mlp", "gru", "lstm"];
/// Passes of their training there.
const THESIS_EPOCHS: usize = 50;
/// What a goal reached that the report was not given data or models for.
pub(super) const NOT_TRIED: &str = "not tried";

/// A goal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// What is asked for.
    pub goal: String,
    /// What was found.
    pub reached: String,
    /// Whether that is enough. `None`: it was not tried, or what was found does not decide it.
    pub met: Option<bool>,
}

fn goal(text: &str, found: Option<(String, bool)>) -> Goal {
    decided(text, found.map(|(reached, met)| (reached, Some(met))))
}

/// A goal that what was found may leave open.
fn decided(text: &str, found: Option<(String, Option<bool>)>) -> Goal {
    let (reached, met) = found.unwrap_or_else(|| (NOT_TRIED.to_owned(), None));
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
    vec![
        goal(
            "shipped model: MAE at most 0.25 N",
            hybrid.map(|m| (format!("{:.3} N", mae(m)), mae(m) <= 0.25)),
        ),
        decided(
            "at most half the error of the best of the thesis's networks",
            hybrid.and_then(|m| half_of_best(m, &r.models)),
        ),
        decided(
            "slowest bin of speed: at most 1.5 times the overall error",
            hybrid.and_then(|m| {
                let Some(slowest) = m.evaluation.by_speed.first()?.mae_n else {
                    return Some(("no row is so slow".to_owned(), None));
                };
                let ratio = slowest / mae(m);
                let text = format!("{slowest:.3} N, {ratio:.2} times");
                Some((text, Some(ratio <= 1.5)))
            }),
        ),
        goal(
            "90 % interval covers 88 to 92 % of unseen rows",
            hybrid.and_then(|m| {
                let covered = m.evaluation.covered?;
                Some((percent(covered), within(covered)))
            }),
        ),
        decided(
            "and of the rows of each bin of speed",
            hybrid.and_then(|m| {
                m.evaluation.covered?;
                let covered = || m.evaluation.by_speed.iter().map(|b| b.covered);
                let text: Vec<String> = covered()
                    .map(|c| c.map_or_else(|| "no row".to_owned(), percent))
                    .collect();
                // A bin without rows says nothing of the goal; another one may miss it all the
                // same.
                let met = if covered().flatten().all(within) {
                    covered().all(|c| c.is_some()).then_some(true)
                } else {
                    Some(false)
                };
                Some((text.join(", "), met))
            }),
        ),
        goal(
            "90 % interval covers 88 to 92 % of all valid rows, from the first one of each stretch",
            hybrid.and_then(|m| {
                let stream = m.evaluation.stream.as_ref()?;
                let covered = stream.valid.covered?;
                let text = format!(
                    "{}; valid {} of the time",
                    percent(covered),
                    percent(stream.valid_share)
                );
                Some((text, within(covered)))
            }),
        ),
        decided("60 chosen minutes match 160 random ones", choice(r)),
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

/// The shipped model against the best network of the thesis. Networks whose training is not that of
/// the thesis decide nothing: the best of them could be better with all of it.
fn half_of_best(m: &ModelResult, models: &[ModelResult]) -> Option<(String, Option<bool>)> {
    let mae = |m: &ModelResult| m.evaluation.figures.mae_n;
    let networks = || models.iter().filter(|m| THESIS.contains(&m.model.as_str()));
    let best = networks().min_by(|a, b| mae(a).total_cmp(&mae(b)))?;
    let half = 0.5 * mae(best);
    let met = mae(m) <= half;
    let text = format!("{:.3} N; half of {} is {half:.3} N", mae(m), best.model);
    let cut: Vec<String> = networks()
        .filter_map(|n| Some((&n.model, n.epochs?)))
        .filter(|(_, epochs)| epochs.cut || epochs.wanted < THESIS_EPOCHS)
        .map(|(name, epochs)| {
            let done = (100.0 * epochs.done).round() / 100.0;
            format!("{done} ({name})")
        })
        .collect();
    if cut.is_empty() {
        return Some((text, Some(met)));
    }
    let met = if met { "met" } else { "not met" };
    let text = format!(
        "{text}: {met}, with networks cut off after {} of {THESIS_EPOCHS} epochs",
        cut.join(", ")
    );
    Some((text, None))
}

/// Chosen minutes against more random ones. Met where the whole interval of the difference is below
/// the margin, missed where it is above it.
fn choice(r: &Results) -> Option<(String, Option<bool>)> {
    let chosen = r.choice.iter().find(|p| p.name == CHOSEN)?;
    let most = r.choice.iter().map(|p| p.minutes).fold(0.0, f64::max);
    // Fewer minutes to draw from than are asked for: the goal is not tried.
    if most < 159.0 {
        return None;
    }
    let difference = chosen.difference?;
    let same = |minutes: f64| -> Vec<&Point> {
        (r.choice.iter())
            .filter(|p| p.name != CHOSEN && (p.minutes - minutes).abs() < 1.0)
            .collect()
    };
    let half = difference
        .half_n
        .map_or_else(String::new, |h| format!(" ± {h:.3}"));
    let few = draws(&same(chosen.minutes)).map_or_else(String::new, |d| {
        format!("; {:.0} random: {d}", chosen.minutes)
    });
    let text = format!(
        "{:.3} N with {:.0} chosen; {most:.0} random: {}; difference {:+.3}{half} N, margin {CHOICE_MARGIN_N} N{few}",
        chosen.figures.mae_n,
        chosen.minutes,
        draws(&same(most))?,
        difference.mean_n
    );
    let met = difference.half_n.and_then(|half| {
        if difference.mean_n + half <= CHOICE_MARGIN_N {
            Some(true)
        } else if difference.mean_n - half > CHOICE_MARGIN_N {
            Some(false)
        } else {
            None
        }
    });
    Some((text, met))
}

/// Mean and spread of random draws.
fn draws(points: &[&Point]) -> Option<String> {
    let errors = || points.iter().map(|p| p.figures.mae_n);
    let mean = errors().sum::<f64>() / points.len().max(1) as f64;
    let least = errors().fold(f64::INFINITY, f64::min);
    let most = errors().fold(f64::NEG_INFINITY, f64::max);
    let count = points.len();
    (count > 0).then(|| format!("{mean:.3} N ({least:.3} to {most:.3} over {count} draws)"))
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

#[cfg(test)]
mod tests {
    use super::super::super::evaluate::{Evaluation, SpeedBin};
    use super::*;
    use estimator::metrics::{Difference, Figures, StepTime};
    use estimator::model::Epochs;

    fn figures(mae_n: f64) -> Figures {
        Figures {
            mae_n,
            mae_half_n: None,
            rmse_n: mae_n,
            nrmse: None,
            rows: 1,
            trials: 1,
        }
    }

    fn model(name: &str, mae_n: f64, epochs: Option<Epochs>) -> ModelResult {
        ModelResult {
            model: name.to_owned(),
            parameters: 1,
            training_s: 1.0,
            epochs,
            evaluation: Evaluation {
                trials: vec![1],
                figures: figures(mae_n),
                by_speed: Vec::new(),
                mae_by_component_n: Vec::new(),
                mae_reversing_n: None,
                mae_sliding_n: None,
                covered: None,
                covered_by_trial: Vec::new(),
                step: StepTime {
                    median_us: 1.0,
                    p99_us: 1.0,
                },
                stream: None,
            },
            by_trial: vec![mae_n],
            difference: None,
        }
    }

    fn of(done: f64, wanted: usize) -> Option<Epochs> {
        Some(Epochs {
            done,
            wanted,
            cut: done < wanted as f64,
        })
    }

    #[test]
    fn networks_that_were_cut_off_decide_nothing() {
        let found = |gru, mlp| {
            let results = Results {
                models: vec![
                    model("gru", 0.5, gru),
                    model("mlp", 0.6, mlp),
                    model("hybrid", 0.1, None),
                ],
                ..Results::default()
            };
            goals(&results).swap_remove(1)
        };
        let whole = found(of(50.0, 50), of(50.0, 50));
        assert_eq!(whole.met, Some(true));
        assert!(!whole.reached.contains("cut off"), "{}", whole.reached);
        // The best one had all of its training, another could be better.
        let cut = found(of(50.0, 50), of(0.42, 50));
        assert_eq!(cut.met, None);
        assert!(
            cut.reached.contains(
                "half of gru is 0.250 N: met, with networks cut off after 0.42 (mlp) of 50 epochs"
            ),
            "{}",
            cut.reached
        );
        // Fewer passes than in the thesis, asked for by --epochs.
        assert_eq!(found(of(5.0, 5), of(50.0, 50)).met, None);
    }

    #[test]
    fn a_bin_without_rows_is_not_met() {
        let mut slow = model("hybrid", 0.1, None);
        slow.evaluation.by_speed = vec![SpeedBin {
            below_m_per_s: 0.001,
            mae_n: None,
            rows: 0,
            covered: None,
            half_width_n: None,
        }];
        let results = Results {
            models: vec![slow],
            ..Results::default()
        };
        let found = goals(&results).swap_remove(2);
        assert_eq!(
            (found.reached.as_str(), found.met),
            ("no row is so slow", None)
        );
        // The coverage by bin neither.
        let mut results = results;
        let evaluation = &mut results.models[0].evaluation;
        evaluation.covered = Some(0.9);
        evaluation.by_speed.push(SpeedBin {
            below_m_per_s: 0.002,
            mae_n: Some(0.1),
            rows: 10,
            covered: Some(0.9),
            half_width_n: Some(0.3),
        });
        let found = goals(&results).swap_remove(4);
        assert_eq!(
            (found.reached.as_str(), found.met),
            ("no row, 90.0 %", None)
        );
        results.models[0].evaluation.by_speed[1].covered = Some(0.5);
        assert_eq!(goals(&results).swap_remove(4).met, Some(false));
    }

    #[test]
    fn chosen_minutes_match_within_the_margin_and_its_interval() {
        let point = |name: &str, minutes, mae_n, difference| Point {
            name: name.to_owned(),
            minutes,
            figures: figures(mae_n),
            by_trial: vec![mae_n],
            difference,
        };
        let found = |mean_n, half_n| {
            let results = Results {
                choice: vec![
                    point(CHOSEN, 60.0, 0.104, Some(Difference { mean_n, half_n })),
                    point("random, draw 1", 60.0, 0.120, None),
                    point("random, draw 2", 60.0, 0.110, None),
                    point("random, draw 1", 160.0, 0.101, None),
                    point("random, draw 2", 160.0, 0.103, None),
                ],
                ..Results::default()
            };
            goals(&results).swap_remove(6)
        };
        let met = found(0.002, Some(0.002));
        assert_eq!(met.met, Some(true));
        for words in [
            "0.104 N with 60 chosen",
            "160 random: 0.102 N (0.101 to 0.103 over 2 draws)",
            "difference +0.002 ± 0.002 N, margin 0.005 N",
            "60 random: 0.115 N (0.110 to 0.120 over 2 draws)",
        ] {
            assert!(met.reached.contains(words), "{words}: {}", met.reached);
        }
        assert_eq!(found(0.002, Some(0.004)).met, None);
        assert_eq!(found(0.002, None).met, None);
        assert_eq!(found(0.010, Some(0.004)).met, Some(false));
    }
}
