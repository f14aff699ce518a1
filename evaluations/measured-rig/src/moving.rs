//! Gauge records, rows in motion.

use crate::data::Data;
use crate::models;
use crate::page::Content;
use crate::text::{
    by_fold, declaring, parameters, percent, rest, steps, table, values, with_interval, COULOMB,
    SHARE,
};
use residual::load::load;
use residual::spec::Spec;
use residual::{analyse, baseline, num, Baseline, Error, Plot, Progress, Report};

/// Turns of the reel in one turn of the motor.
const REEL_ORDER: f64 = 7.0 / 26.0;

/// The analysis, and what goes with it.
struct Moving {
    spec: Spec,
    loaded: residual::Data,
    report: Report,
    /// Fit of the declared model.
    declared: Baseline,
    /// Fit of the final model.
    found: Baseline,
}

impl Moving {
    /// Fit of the declared model with more terms.
    fn fit(&self, terms: &[&str]) -> Result<Baseline, Error> {
        baseline(&declaring(&self.spec, terms), &self.loaded)
    }

    /// Values of an expression on the fitted rows.
    fn values(&self, expr: &str) -> Result<Vec<f64>, Error> {
        values(&self.loaded, &self.declared, expr)
    }
}

/// Analyses the rows in motion of the uncompensated records.
pub(crate) fn moving_rows(
    data: &Data,
    out: &mut Content,
    console: &mut dyn Progress,
) -> Result<Report, Error> {
    console.stage("== gauge records, moving rows");
    let spec = models::gauge(data, models::GAUGE_MOVING, "comp == 0")?;
    let loaded = load(data.gauge.as_slice(), &spec)?;
    let report = analyse(&spec, loaded.clone(), console)?;
    let moving = Moving {
        declared: baseline(&spec, &loaded)?,
        found: baseline(&report.extended, &loaded)?,
        spec,
        loaded,
        report,
    };
    out.blocks.insert("moving", models_and_rivals(&moving)?);
    out.blocks.insert("not-material", not_material(&moving)?);
    out.blocks.insert("moving-rest", rest(&moving.report));
    plots(&moving, out)?;
    Ok(moving.report)
}

fn models_and_rivals(moving: &Moving) -> Result<String, Error> {
    let report = &moving.report;
    let mut rows = steps(report);
    for (name, terms) in [
        ("rival: plain Coulomb friction alone", &[COULOMB][..]),
        ("rival: plain Coulomb friction and offset", &[COULOMB, "1"]),
    ] {
        rows.push(vec![
            name.into(),
            with_interval(&moving.fit(terms)?.figures),
        ]);
    }
    Ok(format!(
        "{} uncompensated records, {} rows in motion.\n\n{}\n{}\n{}",
        report.sequences,
        report.rows,
        table(&["model", "held-out RMSE, N (95 %)"], &rows),
        parameters(report),
        by_fold(&moving.loaded, &moving.declared, &moving.found)
    ))
}

/// Effects that are tested by name, each added to the final model as declared terms. The Stribeck
/// speed is given, so nothing here pays for a search.
fn not_material(moving: &Moving) -> Result<String, Error> {
    let base = &[COULOMB, SHARE, "1"][..];
    let mut tested = Vec::new();
    let mut ask = |name: String, over: &[&str], more: &[String]| -> Result<(), Error> {
        let before = moving.fit(over)?.figures.heldout_rmse;
        let added = more.iter().map(String::as_str);
        let terms: Vec<&str> = over.iter().copied().chain(added).collect();
        let after = moving.fit(&terms)?.figures.heldout_rmse;
        tested.push(vec![
            name,
            num(before),
            num(after),
            percent(1.0 - after / before),
        ]);
        Ok(())
    };
    ask("viscous".into(), base, &["velocity".into()])?;
    let stribeck = |v: f64| vec![format!("{COULOMB} * exp(-(velocity / {v})^2)")];
    for v in [100.0, 300.0, 1500.0] {
        ask(format!("Stribeck at {v} deg/s"), base, &stribeck(v))?;
    }
    ask(
        "Stribeck at 1500 deg/s, on top of viscous".into(),
        &[COULOMB, SHARE, "1", "velocity"],
        &stribeck(1500.0),
    )?;
    let ripple = |scale: &str| -> Vec<String> {
        ["sin", "cos"]
            .map(|f| format!("{scale}{f}(integ(velocity) * {REEL_ORDER} * pi / 180)"))
            .to_vec()
    };
    ask("ripple once per turn of the reel".into(), base, &ripple(""))?;
    ask(
        "the same, in proportion to load".into(),
        base,
        &ripple("command * "),
    )?;
    let searched = moving
        .report
        .tested
        .iter()
        .find(|t| t.name == "stribeck")
        .map_or(String::new(), |t| {
            let at = t.params.values().next().copied().unwrap_or(0.0);
            format!(
                "\nThe search itself, which chooses the Stribeck speed on the training units alone ({} deg/s on all of them), credits it with {}.\n",
                num(at),
                percent(t.gain)
            )
        });
    let head = [
        "added to the final model",
        "before, N",
        "after, N",
        "reduction of held-out RMSE",
    ];
    Ok(format!(
        "{}{searched}\n{}",
        table(&head, &tested),
        by_speed(moving)?
    ))
}

/// The residual of the final model by bands of speed: what friction does with speed.
fn by_speed(moving: &Moving) -> Result<String, Error> {
    let speed = moving.values("abs(velocity)")?;
    let sign = moving.values(COULOMB)?;
    let held = &moving.found.held;
    let total: f64 = held.iter().map(|r| r * r).sum();
    let bands: Vec<Vec<String>> = [5.0, 100.0, 200.0, 400.0, 800.0, 1500.0, f64::INFINITY]
        .windows(2)
        .map(|w| {
            let rows: Vec<usize> = (0..speed.len())
                .filter(|i| speed[*i] > w[0] && speed[*i] <= w[1])
                .collect();
            let mean =
                rows.iter().map(|i| held[*i] * sign[*i]).sum::<f64>() / rows.len().max(1) as f64;
            let share = rows.iter().map(|i| held[*i].powi(2)).sum::<f64>() / total;
            let band = if w[1].is_finite() {
                format!("{} to {}", w[0], w[1])
            } else {
                format!("above {}", w[0])
            };
            vec![band, rows.len().to_string(), num(mean), percent(share)]
        })
        .collect();
    let head = [
        "speed, deg/s",
        "rows",
        "mean residual along the motion, N",
        "share of the squared error",
    ];
    Ok(table(&head, &bands))
}

fn plots(moving: &Moving, out: &mut Content) -> Result<(), Error> {
    let (before, after) = (&moving.declared.held, &moving.found.held);
    out.plots.insert(
        "moving-velocity.svg",
        Plot::new(
            "motor speed, deg/s",
            &moving.values("velocity")?,
            before,
            after,
        )
        .named("residual", "declared model", "with what was found")
        .svg("N"),
    );
    // Along the motion friction has one sign, so its growth with load is a slope.
    let sign = moving.values(COULOMB)?;
    let along = |r: &[f64]| -> Vec<f64> { r.iter().zip(&sign).map(|(r, s)| r * s).collect() };
    out.plots.insert(
        "moving-load.svg",
        Plot::new(
            "declared load, N",
            &moving.values("command / 0.010")?,
            &along(before),
            &along(after),
        )
        .named(
            "residual times sign of speed",
            "declared model",
            "with what was found",
        )
        .svg("N"),
    );
    Ok(())
}
