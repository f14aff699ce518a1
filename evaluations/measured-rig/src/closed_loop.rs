//! Closed-loop runs: the rig's PID on the load cell.

use crate::data::Data;
use crate::page::Content;
use crate::text::{parameters, rest, steps, table, values};
use crate::{models, recording};
use residual::load::{from_tables, load};
use residual::spec::Spec;
use residual::{analyse, baseline, num, Error, Plot, Progress};

/// Analyses the closed-loop runs.
pub(crate) fn closed_loop(
    data: &Data,
    out: &mut Content,
    console: &mut dyn Progress,
) -> Result<(), Error> {
    if data.closed.is_none() && data.recordings.is_empty() {
        out.blocks
            .insert("closed", "No closed-loop runs in the data given.".into());
        return Ok(());
    }
    console.stage("== closed-loop runs");
    let spec = Spec::parse(models::CLOSED_LOOP)?;
    let loaded = match &data.closed {
        Some(folder) => load(std::slice::from_ref(folder), &spec)?,
        None => from_tables(
            data.recordings
                .iter()
                .map(|path| recording::read(path))
                .collect::<Result<_, _>>()?,
            &spec,
        )?,
    };
    let report = analyse(&spec, loaded.clone(), console)?;
    let declared = baseline(&spec, &loaded)?;
    let found = baseline(&report.extended, &loaded)?;
    let mean_load = values(&loaded, &declared, "command")?;
    let mean_load = mean_load.iter().sum::<f64>() / mean_load.len().max(1) as f64;
    let hygiene: Vec<Vec<String>> = report
        .hygiene
        .iter()
        .filter(|f| !f.check.starts_with("quantised"))
        .map(|f| vec![f.check.clone(), f.count.to_string(), f.what.clone()])
        .collect();
    out.blocks.insert(
        "closed",
        format!(
            "{} runs, {} records of one unit, {} rows; {} groups in {} folds. Mean declared load {} N.\n\n{}\n{}\n{}\n{}",
            report.files.len(),
            report.sequences,
            report.rows,
            report.groups,
            report.folds.len(),
            num(mean_load),
            table(&["model", "held-out RMSE, N (95 %)"], &steps(&report)),
            parameters(&report),
            rest(&report),
            table(&["hygiene", "count", "what"], &hygiene)
        ),
    );
    out.plots.insert(
        "closed-loop.svg",
        Plot::new(
            "declared load (command), N",
            &values(&loaded, &declared, "command")?,
            &declared.held,
            &found.held,
        )
        .named("residual", "declared model", "with the effects named")
        .svg("N"),
    );
    Ok(())
}
