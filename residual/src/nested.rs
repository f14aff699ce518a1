//! Nested evaluation: the error on groups that took no part in the selection.
//!
//! The held-out figure of a report is not that. Each fold's coefficients come from the other folds,
//! but the effects were selected by the held-out error of all folds, and nonlinear parameters are
//! refined on all rows. Here each fold is left out of everything, and the whole selection is repeated
//! without it. That costs as many analyses as there are folds.

use crate::data::Data;
use crate::declared::{check_selection, fit_declared};
use crate::effects::EffectKind;
use crate::error::Error;
use crate::model::{Chosen, Fit, Model};
use crate::problem::Problem;
use crate::progress::Progress;
use crate::search::Search;
use crate::spec::Spec;
use crate::stats;

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
    let count = data.fold_names.len();
    if count < 3 {
        return Err(Error::data(
            format!("{count} folds: without one of them nothing is left to hold out"),
            "A nested evaluation needs at least three groups; bring more data, or shorten holdout.block_s",
        ));
    }
    let mut problem = data.problem(&spec.selection);
    let declared = fit_declared(&mut problem, spec)?;
    let mut squares = 0.0;
    let mut folds = Vec::new();
    for (fold, name) in data.fold_names.iter().enumerate() {
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
    Ok(search.run(progress)?.chosen)
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
    use crate::stats::Rng;

    /// Four runs with an effect in the last one only: what the others select cannot know of it.
    fn data(last: f64) -> Data {
        let mut rng = Rng::new(5);
        let rows = 4 * 300;
        let time = (0..rows).map(|i| (i % 300) as f64 * 0.02).collect();
        let command: Vec<f64> = (0..rows).map(|i| 3.0 + (0.07 * i as f64).sin()).collect();
        let velocity: Vec<f64> = (0..rows).map(|i| (0.031 * i as f64).cos()).collect();
        let target = (0..rows)
            .map(|i| {
                let friction = if i >= 900 { last } else { 0.4 };
                command[i] - friction * velocity[i].signum() + 0.02 * rng.normal()
            })
            .collect();
        let columns = [
            ("command", command),
            ("velocity", velocity),
            ("target", target),
        ];
        Data::from_columns(time, columns)
            .sequences((0..4).map(|k| 300 * k..300 * (k + 1)))
            .build()
            .unwrap()
    }

    fn spec() -> Spec {
        Spec::parse(
            "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
             command = { column = \"c\" }\nvelocity = { column = \"v\" }\n\
             [selection]\nonly = [\"coulomb\", \"gain\"]\n\
             [[terms]]\nname = \"a\"\nexpr = \"command\"\nfixed = 1.0\n",
        )
        .unwrap()
    }

    #[test]
    fn a_fold_that_is_unlike_the_others_scores_with_their_selection() {
        let same = nested(&spec(), &data(0.4), &mut ()).unwrap();
        assert_eq!(same.folds.len(), 4);
        for fold in &same.folds {
            assert_eq!(fold.effects, [EffectKind::Coulomb]);
            assert!(fold.rmse < 0.03 && fold.declared_rmse > 0.3, "{fold:?}");
        }
        assert!((same.rmse - 0.02).abs() < 0.003, "{}", same.rmse);
        let other = nested(&spec(), &data(-0.4), &mut ()).unwrap();
        let last = &other.folds[3];
        assert_eq!(last.effects, [EffectKind::Coulomb]);
        assert!((last.rmse - 0.8).abs() < 0.05, "{last:?}");
    }

    #[test]
    fn two_folds_are_too_few() {
        let mut two = data(0.4);
        two.fold.iter_mut().for_each(|f| *f /= 2);
        two.fold_names.truncate(2);
        let error = nested(&spec(), &two, &mut ()).unwrap_err().to_string();
        assert!(error.contains("2 folds"), "{error}");
    }
}
