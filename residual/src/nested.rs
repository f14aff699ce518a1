//! Nested evaluation: the error on groups that took no part in the selection.
//!
//! The held-out figure of a report is not that. Each fold's coefficients come from the other folds,
//! but the effects were selected by the held-out error of all folds, and nonlinear parameters are
//! refined on all rows. Here each fold is left out of everything, and the whole selection is
//! repeated without it. That costs as many analyses as there are folds.

use residual_columns::error::Error;
use residual_columns::progress::Progress;
use residual_columns::stats;
use residual_effects::EffectKind;
use residual_fit::problem::Problem;
use residual_log::data::Data;
use residual_log::spec::Spec;
use residual_search::declared::{check_selection, fit_declared, problem};
use residual_search::model::{Chosen, Fit, Model};
use residual_search::Search;

/// Errors on groups that took no part in the selection.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Nested {
    /// RMSE over all folds, in the target's unit.
    pub rmse: f64,
    /// The folds.
    pub folds: Vec<NestedFold>,
}

/// One fold that was left out of the selection.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct NestedFold {
    /// Names of its groups.
    pub name: String,
    /// Its rows that are scored.
    pub rows: usize,
    /// Effects that the selection named without it.
    pub effects: Vec<EffectKind>,
    /// RMSE on it of the declared model, in the target's unit.
    pub declared_rmse: f64,
    /// RMSE on it of the model selected and fitted without it.
    pub rmse: f64,
}

/// Refuses data with fewer than three folds: without one of them no fold could be held out.
pub(crate) fn check_folds(data: &Data) -> Result<(), Error> {
    let count = data.folds().len();
    if count < 3 {
        return Err(Error::data(
            format!("{count} folds: without one of them nothing is left to hold out"),
            "A nested evaluation needs at least three groups; bring more data, or shorten holdout.block_s",
        ));
    }
    Ok(())
}

/// Repeats the whole selection with each fold left out, and scores that fold.
///
/// Selection, nonlinear parameters and coefficients come from the other folds. Only coefficients
/// that every sequence has for itself (a tone with a phase for each run) come from the fold: each
/// half of a sequence is predicted from its other half.
///
/// # Errors
/// [`Error::Data`] for fewer than three folds; any error of [`analyse`](crate::analyse) without one
/// of the folds.
pub fn nested(spec: &Spec, data: &Data, progress: &mut dyn Progress) -> Result<Nested, Error> {
    check_selection(spec)?;
    check_folds(data)?;
    let count = data.folds().len();
    let mut problem = problem(data, &spec.selection);
    let declared = fit_declared(&mut problem, spec)?;
    let mut squares = 0.0;
    let mut folds = Vec::new();
    for (fold, name) in data.folds().iter().enumerate() {
        progress.stage(&format!("without {name} ({} of {count})", fold + 1));
        let chosen = selected(spec, &data.without_fold(fold as u32), progress)?;
        let fit = Fit::new(&problem, &Model::with(spec, &chosen)?)?;
        let own = of_fold(&problem, &fit.held, fold);
        squares += own.iter().map(|r| r * r).sum::<f64>();
        folds.push(NestedFold {
            name: name.clone(),
            rows: own.len(),
            effects: chosen.iter().map(|c| c.effect.kind()).collect(),
            declared_rmse: stats::rms(&of_fold(&problem, &declared.fit.held, fold)),
            rmse: stats::rms(&own),
        });
    }
    Ok(Nested {
        rmse: (squares / problem.y.len() as f64).sqrt(),
        folds,
    })
}

/// Effects that the search chooses on some data.
fn selected(spec: &Spec, data: &Data, progress: &mut dyn Progress) -> Result<Vec<Chosen>, Error> {
    let mut search = Search::new(spec, data, progress)?;
    let outcome = search.run(progress)?;
    Ok(search.other_paths(outcome, progress)?.chosen)
}

/// Values on the rows of one fold. A held-out residual there comes from a fit to the other folds.
fn of_fold(problem: &Problem, values: &[f64], fold: usize) -> Vec<f64> {
    problem
        .blocks
        .iter()
        .filter(|b| b.fold == fold)
        .flat_map(|b| values[b.range.clone()].iter().copied())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_columns::stats::Rng;

    /// Rows of a run, 20 ms apart.
    const ROWS: usize = 300;

    fn command(run: usize, t: f64) -> f64 {
        let phase = run as f64;
        3.0 + (2.0 * t + phase).sin() + 0.5 * (5.1 * t + 2.0 * phase).sin()
    }

    /// Four runs in which the target follows the command with a delay, another one in the last run.
    fn data(delay: f64, last: f64, folds: usize) -> Data {
        let mut rng = Rng::new(5);
        let rows: Vec<(usize, f64)> = (0..4 * ROWS)
            .map(|i| (i / ROWS, (i % ROWS) as f64 * 0.02))
            .collect();
        let of = |f: &mut dyn FnMut(usize, f64) -> f64| -> Vec<f64> {
            rows.iter().map(|(run, t)| f(*run, *t)).collect()
        };
        let target = of(&mut |run, t| {
            let late = if run == 3 { last } else { delay };
            command(run, t - late) + 0.02 * rng.normal()
        });
        let columns = [
            ("command", of(&mut |run, t| command(run, t))),
            ("target", target),
        ];
        Data::from_columns(of(&mut |_, t| t), columns)
            .sequences((0..4).map(|k| ROWS * k..ROWS * (k + 1)))
            .folds(folds)
            .build()
            .unwrap()
    }

    fn spec() -> Spec {
        Spec::parse(
            "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
             command = { column = \"c\" }\n[selection]\nonly = [\"delay\"]\n\
             [[terms]]\nname = \"a\"\nexpr = \"command\"\nfixed = 1.0\n",
        )
        .unwrap()
    }

    #[test]
    fn a_fold_does_not_influence_the_parameter_it_is_scored_with() {
        let same = nested(&spec(), &data(0.06, 0.06, 4), &mut ()).unwrap();
        assert_eq!(same.folds.len(), 4);
        for fold in &same.folds {
            assert_eq!(fold.effects, [EffectKind::Delay]);
            assert!(fold.rmse < 0.05 && fold.declared_rmse > 0.08, "{fold:?}");
        }
        let other = nested(&spec(), &data(0.06, 0.20, 4), &mut ()).unwrap();
        let off = |i: usize| {
            let t = i as f64 * 0.02;
            command(3, t - 0.20) - command(3, t - 0.06)
        };
        let want = stats::rms(&(0..ROWS).map(off).collect::<Vec<f64>>());
        let last = &other.folds[3];
        assert!((last.rmse / want - 1.0).abs() < 0.05, "{want} {last:?}");
    }

    #[test]
    fn two_folds_are_too_few() {
        let two = data(0.06, 0.06, 2);
        let error = nested(&spec(), &two, &mut ()).unwrap_err().to_string();
        assert!(error.contains("2 folds"), "{error}");
    }
}
