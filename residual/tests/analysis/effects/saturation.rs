//! Saturation: a limit of the command or the prediction.

use crate::rig::names;
use residual::{analyse, Data, Report};
use residual_columns::stats::Rng;
use residual_log::spec::Spec;

#[test]
fn is_named() {
    names("saturation", |s| s.command.min(4.2) - s.command);
}

/// Six runs of which one comes to `limit`, with a gain and an offset to fit; noise of 20 mN before
/// the limit.
fn one_run_at(limit: f64) -> Report {
    let (runs, rows) = (6, 1500);
    let mut rng = Rng::new(3);
    let command: Vec<f64> = (0..runs * rows)
        .map(|i| {
            let (run, t) = (i / rows, 0.02 * (i % rows) as f64);
            let top = if run == 4 { 1.6 } else { 1.0 };
            2.0 + 0.1 * run as f64 + top * (0.9 * t).sin()
        })
        .collect();
    let target = command
        .iter()
        .map(|c| (1.04 * c + 0.3 + 0.02 * rng.normal()).min(limit))
        .collect();
    let model = r#"
        roles.time = { column = "t", unit = "s" }
        roles.target = { column = "y", unit = "N" }
        roles.command = { column = "u", unit = "N" }
        [[terms]]
        name = "gain"
        expr = "command"
        [[terms]]
        name = "offset"
        expr = "1"
    "#;
    let time = (0..runs * rows).map(|i| 0.02 * (i % rows) as f64).collect();
    let data = Data::from_columns(time, [("command", command), ("target", target)])
        .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
        .build()
        .expect("the columns are whole");
    let model = Spec::parse(model).expect("the model is right");
    analyse(&model, data, &mut ()).expect("the analysis runs")
}

/// One run cannot be held out and predicted from the others, but its reading shows where it stops.
#[test]
fn a_reading_at_the_end_of_its_range_is_named_in_one_run_of_six() {
    let report = one_run_at(4.0);
    let found: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(found, ["saturation"], "{}", report.markdown());
    let effect = &report.effects[0];
    assert_eq!(effect.form, "of the reading, above");
    assert_eq!(effect.params["upper_limit"], 4.0);
    let [low, high] = effect.ci["upper_limit"];
    assert!(
        (low..=high).contains(&4.0) && high - low < 0.002,
        "{low} {high}"
    );
    assert!(
        (report.last.heldout_rmse - 0.02).abs() < 0.002,
        "{}",
        report.last.heldout_rmse
    );
}

#[test]
fn a_reading_that_does_not_stop_has_no_limit() {
    let report = one_run_at(9.0);
    assert!(report.effects.is_empty(), "{}", report.markdown());
}
