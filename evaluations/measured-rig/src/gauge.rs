//! Gauge records: all rows, and the compensated records.

use crate::data::Data;
use crate::models;
use crate::page::Content;
use crate::text::{
    by_fold, declaring, parameters, rest, rmse, steps, table, values, with_interval, COULOMB,
    SHARE, STANDSTILL,
};
use residual::load::load;
use residual::spec::Spec;
use residual::{analyse, baseline, num, Baseline, Error, Plot, Progress, Report};

/// Analyses all rows of the uncompensated records.
pub(crate) fn all_rows(
    data: &Data,
    out: &mut Content,
    console: &mut dyn Progress,
) -> Result<(), Error> {
    console.stage("== gauge records, all rows");
    let spec = models::gauge(data, models::GAUGE_ALL, "comp == 0")?;
    let loaded = load(data.gauge.as_slice(), &spec)?;
    let report = analyse(&spec, loaded.clone(), console)?;
    let declared = baseline(&spec, &loaded)?;
    let same = baseline(&declaring(&spec, &[COULOMB, SHARE, "1"]), &loaded)?;
    let found = baseline(&report.extended, &loaded)?;
    let mut rows = steps(&report);
    rows.push(vec![
        "for comparison: the terms of the moving rows, fitted here".into(),
        with_interval(&same.figures),
    ]);
    let velocity = values(&loaded, &declared, "velocity")?;
    let held = values(&loaded, &declared, "held(velocity, 5)")?;
    let models = [&declared, &same, &found];
    out.blocks.insert(
        "all",
        format!(
            "{} records, {} rows; none was filtered.\n\n{}\n{}\n{}\n{}",
            report.sequences,
            report.rows,
            table(&["model", "held-out RMSE, N (95 %)"], &rows),
            table(
                &[
                    "rows",
                    "count",
                    "declared, N",
                    "terms of the moving rows, N",
                    "with what was found, N"
                ],
                &by_motion(&velocity, &held, models)
            ),
            parameters(&report),
            rest(&report)
        ),
    );
    let load_n = values(&loaded, &declared, "command / 0.010")?;
    out.plots.insert(
        "rest.svg",
        at_rest(&velocity, &held, &load_n, &same, &found),
    );
    Ok(())
}

/// RMSE of the models on the rows in motion, at rest and before the first motion. `velocity` is in
/// deg/s, `held` the sign of the last motion.
fn by_motion(velocity: &[f64], held: &[f64], models: [&Baseline; 3]) -> Vec<Vec<String>> {
    type Part = fn(f64, f64) -> bool;
    let parts: [(&str, Part); 3] = [
        ("in motion", |v, _| v.abs() > STANDSTILL),
        ("at rest after a motion", |v, h| {
            v.abs() <= STANDSTILL && h != 0.0
        }),
        ("before the first motion", |v, h| {
            v.abs() <= STANDSTILL && h == 0.0
        }),
    ];
    parts
        .iter()
        .map(|(name, is)| {
            let rows: Vec<usize> = (0..velocity.len())
                .filter(|i| is(velocity[*i], held[*i]))
                .collect();
            let of = |b: &Baseline| num(rmse(rows.iter().map(|i| b.held[*i])));
            [name.to_string(), rows.len().to_string()]
                .into_iter()
                .chain(models.map(of))
                .collect()
        })
        .collect()
}

/// Plot of the rows at rest: what the friction that keeps its direction does there.
fn at_rest(
    velocity: &[f64],
    held: &[f64],
    load_n: &[f64],
    before: &Baseline,
    after: &Baseline,
) -> String {
    let rows: Vec<usize> = (0..velocity.len())
        .filter(|i| velocity[*i].abs() <= STANDSTILL && held[*i] != 0.0)
        .collect();
    let pick = |v: &[f64]| rows.iter().map(|i| v[*i]).collect::<Vec<f64>>();
    let x: Vec<f64> = rows.iter().map(|i| held[*i] * load_n[*i]).collect();
    Plot::new(
        "declared load times direction held, N",
        &x,
        &pick(&before.held),
        &pick(&after.held),
    )
    .named("residual", "terms of moving rows", "with what was found")
    .svg("N")
}

/// Tests the final model of the moving rows, all coefficients fixed, on the compensated records.
pub(crate) fn compensated(
    data: &Data,
    moving: &Report,
    out: &mut Content,
    console: &mut dyn Progress,
) -> Result<(), Error> {
    console.stage("== compensated records, model of the moving rows frozen");
    let mut frozen = Spec::parse(&moving.frozen()?)?;
    let model = models::gauge(data, models::GAUGE_MOVING, "comp > 0")?;
    frozen.title = "Compensated records, frozen model".into();
    frozen.rows = model.rows.clone();
    let loaded = load(data.gauge.as_slice(), &frozen)?;
    let declared = baseline(&model, &loaded)?;
    let test = baseline(&frozen, &loaded)?;
    let report = analyse(&frozen, loaded.clone(), console)?;
    let mut rows = vec![
        vec![
            "force = command / 0.010 m".into(),
            with_interval(&declared.figures),
        ],
        vec![
            "frozen model of the uncompensated records, nothing fitted".into(),
            with_interval(&test.figures),
        ],
    ];
    rows.extend(steps(&report).into_iter().skip(1));
    out.blocks.insert(
        "compensated",
        format!(
            "{} records, {} rows in motion, none of them in the fit.\n\n{}\n{}\n{}\n{}",
            report.sequences,
            report.rows,
            table(&["model", "RMSE, N (95 %)"], &rows),
            by_fold(&loaded, &declared, &test).replace("with what was found", "frozen model"),
            parameters(&report),
            rest(&report)
        ),
    );
    out.plots.insert(
        "compensated.svg",
        Plot::new(
            "motor speed, deg/s",
            &values(&loaded, &test, "velocity")?,
            &declared.held,
            &test.held,
        )
        .named("residual", "declared model", "frozen model")
        .svg("N"),
    );
    Ok(())
}
