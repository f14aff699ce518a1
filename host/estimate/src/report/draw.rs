//! Which pictures a report has.

use super::super::pictures::{self, Place};
use super::super::study::CHOSEN;
use super::{save, ReportError, Results};
use estimator::metrics::Rows;
use std::path::Path;

/// Models that the pictures of errors show: those that try.
const SHOWN: [&str; 8] = [
    "mlp",
    "gru",
    "lstm",
    "convolution",
    "carried-gru",
    "linear",
    "physics",
    "hybrid",
];
/// What part of a trial is shown: from, length, s.
const FROM_S: f64 = 100.0;
const SHOWN_S: f64 = 240.0;

/// Pictures of the models on the test trials.
pub(super) fn models(
    into: &Path,
    results: &Results,
    compared: &[(String, Vec<Rows>)],
) -> Result<(), ReportError> {
    let shown = || {
        compared
            .iter()
            .filter(|(name, _)| SHOWN.contains(&name.as_str()))
    };
    let step_s = 1.0 / results.rate_hz;
    let first: Vec<(String, &Rows)> = shown()
        .filter(|(name, _)| name != "linear")
        .filter_map(|(name, trials)| Some((name.clone(), trials.first()?)))
        .collect();
    let title = "Prediction against truth, an unseen trial";
    save(
        &into.join("prediction.svg"),
        &pictures::prediction(title, &first, step_s, FROM_S, SHOWN_S).to_svg(),
    )?;
    let title = "Error over the trajectory, an unseen trial (mean of each second)";
    save(
        &into.join("trajectory.svg"),
        &pictures::over_trajectory(title, &first, step_s, FROM_S, SHOWN_S).to_svg(),
    )?;
    let boxes: Vec<(String, &[Rows])> = compared
        .iter()
        .map(|(name, trials)| (name.clone(), trials.as_slice()))
        .collect();
    save(
        &into.join("errors.svg"),
        &pictures::boxes("Errors of each model on unseen trials", &boxes).to_svg(),
    )?;
    let speeds: Vec<(String, Vec<f64>)> = (results.models.iter())
        .filter(|m| SHOWN.contains(&m.model.as_str()))
        .map(|m| {
            // A bin without rows has no bar.
            let errors = m.evaluation.by_speed.iter();
            let errors = errors.map(|b| b.mae_n.unwrap_or(0.0));
            (m.model.clone(), errors.collect())
        })
        .collect();
    let below: Vec<f64> = results.models.first().map_or_else(Vec::new, |m| {
        let bins = m.evaluation.by_speed.iter();
        bins.map(|b| b.below_m_per_s).collect()
    });
    save(
        &into.join("speed.svg"),
        &pictures::by_speed("Error by speed of the tip, unseen trials", &below, &speeds).to_svg(),
    )?;
    compared
        .last()
        .map_or(Ok(()), |(_, shipped)| maps(into, shipped))
}

/// Error against minutes of training.
pub(super) fn learning(into: &Path, results: &Results) -> Result<(), ReportError> {
    if results.learning.is_empty() {
        return Ok(());
    }
    let mut curves: Vec<(String, Vec<(f64, f64)>)> = (results.learning.iter())
        .map(|(name, points)| {
            let points = points.iter().map(|p| (p.minutes, p.figures.mae_n));
            (name.clone(), points.collect())
        })
        .collect();
    let mut title = "Error against training data".to_owned();
    if let Some(chosen) = results.choice.iter().find(|p| p.name == CHOSEN) {
        // Chosen and random minutes on the same trials, which are not those of the other curves.
        title += &format!("; squares with * tested on {} alone", results.choice_test);
        let point = (chosen.minutes, chosen.figures.mae_n);
        curves.push(("* hybrid, chosen".to_owned(), vec![point]));
        let random = results.choice.iter().filter(|p| p.name != CHOSEN);
        let random: Vec<(f64, f64)> = random.map(|p| (p.minutes, p.figures.mae_n)).collect();
        curves.push(("* hybrid, random".to_owned(), random));
    }
    let picture = pictures::curves(
        &title,
        "minutes of training",
        "mean absolute error, N",
        &curves,
    );
    save(&into.join("learning.svg"), &picture.to_svg())
}

fn maps(into: &Path, shipped: &[Rows]) -> Result<(), ReportError> {
    let degrees = |v: f64| v.to_degrees();
    let places: [Place<'_>; 6] = [
        ("shoulder, degrees", "elbow, degrees", &|r, k| {
            (degrees(r.joints[k][0]), degrees(r.joints[k][1]))
        }),
        ("shoulder, degrees", "insertion, mm", &|r, k| {
            (degrees(r.joints[k][0]), 1e3 * r.joints[k][2])
        }),
        ("tip x0, mm", "tip y0, mm", &|r, k| {
            (1e3 * r.tips[k][0], 1e3 * r.tips[k][1])
        }),
        ("shoulder, degrees/s", "elbow, degrees/s", &|r, k| {
            (degrees(r.rates[k][0]), degrees(r.rates[k][1]))
        }),
        ("shoulder, degrees/s", "insertion, mm/s", &|r, k| {
            (degrees(r.rates[k][0]), 1e3 * r.rates[k][2])
        }),
        ("tip x0, mm", "tip z0, mm", &|r, k| {
            (1e3 * r.tips[k][0], 1e3 * r.tips[k][2])
        }),
    ];
    let title =
        "Mean absolute error of the shipped model over joints, joint velocities and workspace";
    save(
        &into.join("maps.svg"),
        &pictures::error_maps(title, shipped, &places).to_svg(),
    )
}
