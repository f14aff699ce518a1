//! Force held at a moving tip.

use crate::figures::{Figures, Goal};
use crate::rig::start;
use ::rig::Rig;
use force::metrics::Metrics;
use run::{self, NoopObserver, Options};
use session::link::RigLink;
use test_stand::rig_file;

/// Seeds of the runs whose worst figure is quoted.
const SEEDS: [u64; 3] = [1, 2, 3];

/// A run of some seconds, and its figures.
fn hold(rig: &Rig, seed: u64, seconds: f64) -> Result<Metrics, String> {
    let mut link = start(seed)?;
    let options = Options::new([0.0, 2.5, 0.0], seconds);
    let link: &mut dyn RigLink = &mut link;
    let outcome = run::set_force(link, rig, &options, &mut NoopObserver)
        .map_err(|error| error.to_string())?;
    outcome
        .metrics
        .ok_or_else(|| "the run was too short for figures".to_owned())
}

fn worst(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// Force held at a moving tip, with and without the friction feedforward.
pub fn holding(figures: &mut Figures) -> Result<(), String> {
    println!("\nholding 0 2.5 0 N for 10 s at a moving tip, seeds {SEEDS:?}, worst of all runs and cables");
    let with = rig_file();
    let mut without = rig_file();
    for unit in &mut without.units {
        unit.friction_feedforward = false;
    }
    let runs = |rig: &Rig| {
        SEEDS
            .iter()
            .map(|seed| hold(rig, *seed, 10.0))
            .collect::<Result<Vec<_>, _>>()
    };
    let (with, without) = (runs(&with)?, runs(&without)?);
    let rms = |runs: &[Metrics]| worst(runs.iter().flat_map(|m| m.tension_rms_n));
    let mean = |runs: &[Metrics]| {
        runs.iter().flat_map(|m| m.tension_rms_n).sum::<f64>() / (runs.len() * 6) as f64
    };
    figures.add(
        "tension_rms_n",
        rms(&with),
        Goal::AtMost(0.12),
        "tension error, worst cable, RMS",
    );
    figures.add(
        "tension_rms_n_mean",
        mean(&with),
        Goal::None,
        "the same, mean of the cables",
    );
    figures.add(
        "tension_rms_n_no_feedforward",
        rms(&without),
        Goal::AtMost(0.12),
        "worst cable without friction feedforward, RMS",
    );
    figures.add(
        "tension_rms_n_no_feedforward_mean",
        mean(&without),
        Goal::None,
        "the same, mean of the cables",
    );
    figures.add(
        "tip_force_error_n",
        worst(with.iter().map(|m| m.tip_force_error_n)),
        Goal::AtMost(0.05),
        "steady error of the force at the tip",
    );
    figures.add(
        "tip_force_rms_n",
        worst(with.iter().map(|m| m.tip_force_rms_n)),
        Goal::None,
        "its RMS",
    );
    // A run that never settles counts as its whole length.
    figures.add(
        "settling_s",
        worst(with.iter().map(|m| m.settling_s.unwrap_or(10.0))),
        Goal::AtMost(0.5),
        "time until the whole force vector stays within 0.125 N for 0.5 s, friction reversals across it included",
    );
    figures.add(
        "settling_along_s",
        worst(with.iter().map(|m| m.settling_along_s.unwrap_or(10.0))),
        Goal::None,
        "the same for the force along the commanded direction alone: the step response",
    );
    Ok(())
}
