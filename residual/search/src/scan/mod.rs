//! One scan: every form on offer, fitted on top of the current model and compared with decoys.
//!
//! A [`Scan`] holds the current model and its fit. It builds the sums of products of the model with
//! a form applied, and from these the errors of the residual and of its decoys.

mod between;
mod candidate;
mod context;
mod contribution;
mod direction;
mod friction;
mod grid;
mod retest;
mod setpoint;
mod significance;
mod slow;

pub use between::Between;
pub use candidate::{catalogue_offers, Candidate, Offer, Origin};
pub use grid::{bracket, reach, vertex, FINE};
pub use setpoint::Instruments;
pub use significance::t_statistic;

use crate::model::{Chosen, Fit, Fitted, Model, WorkTerm};
use rayon::prelude::*;
use residual_columns::error::Error;
use residual_columns::expr::Expr;
use residual_columns::frame::Frame;
use residual_columns::linalg::similarity;
use residual_effects::{Build, Lookalike, Piece, Variant};
use residual_fit::problem::{slices, through_of, Column, Known, Problem, Scores, Sums};
use residual_log::spec::Spec;
use std::cell::OnceCell;

/// Difference of the similarity of two curves from 1 that may be rounding.
const SAME: f64 = 1e-9;

/// Everything a scan needs to know about the current model.
#[derive(Clone, Copy)]
pub struct Scan<'a> {
    /// The rows that are fitted.
    pub problem: &'a Problem,
    /// The model file.
    pub spec: &'a Spec,
    /// The declared model's prediction as an expression.
    pub load: &'a str,
    /// The current model.
    pub model: &'a Model,
    /// Its fit.
    pub fit: &'a Fit,
    /// Whether it only ranks the forms, on fewer rows: without decoys, with parameters to a part of
    /// a grid step. The forms that come first are scanned on all rows.
    pub screening: bool,
}

/// Whether a term has one of the columns that are replaced.
fn has_one(pairs: &[(String, String)], term: &WorkTerm) -> bool {
    let names = term.expr.names();
    pairs.iter().any(|(name, _)| names.contains(name))
}

/// A model with a form applied: its fitted columns, and their sums of products.
struct Applied {
    sums: Sums,
    /// Whether every sequence has coefficients of its own.
    local: bool,
    /// The fitted columns, without what terms with a coefficient for each sequence explain of them.
    columns: Vec<Column>,
    /// What the columns predict if the prediction stays as it is: the present one less the terms
    /// with a known coefficient, without what terms for each sequence explain of it. `None` where
    /// the form only adds columns: then they predict nothing if it stays.
    present: Option<Vec<f64>>,
}

impl<'a> Scan<'a> {
    /// The scan on top of a fitted model.
    pub fn new(problem: &'a Problem, spec: &'a Spec, load: &'a str, on: &'a Fitted) -> Scan<'a> {
        Scan {
            problem,
            spec,
            load,
            model: &on.model,
            fit: &on.fit,
            screening: false,
        }
    }

    /// The same scan on other rows to which the model was fitted, if there are any.
    pub fn on(self, other: Option<&'a (&'a Problem, Fit)>) -> Scan<'a> {
        match other {
            Some((problem, fit)) => Scan {
                problem,
                fit,
                ..self
            },
            None => self,
        }
    }

    /// Sums of the current model with a build applied; `keep` its columns for the next scan.
    fn sums(&self, build: &Build, keep: bool) -> Result<Applied, Error> {
        match build {
            Build::Add(pieces) => self.sums_with(pieces, keep),
            Build::Local(pieces) => self.sums_of(pieces, keep),
            Build::Swap(pairs) => {
                let declared = |t: &WorkTerm| t.chosen.is_none() && has_one(pairs, t);
                let changed = |t: &WorkTerm| declared(t).then(|| t.expr.clone());
                self.sums_changed(pairs, &changed, &[], keep)
            }
            Build::SwapAll(pairs) => {
                let changed = |t: &WorkTerm| has_one(pairs, t).then(|| t.expr.clone());
                self.sums_changed(pairs, &changed, &[], keep)
            }
            Build::Through(text) => {
                let through = Expr::parse(text)?;
                let changed = |t: &WorkTerm| Some(through_of(&through, &t.expr));
                self.sums_changed(&[], &changed, &[], keep)
            }
            Build::Known(pieces) => self.sums_changed(&[], &|_| None, pieces, keep),
        }
    }

    /// Sums of the current model with terms added.
    pub fn sums_beside(&self, pieces: &[Piece]) -> Result<Sums, Error> {
        Ok(self.sums_with(pieces, false)?.sums)
    }

    fn columns(&self, pieces: &[Piece], keep: bool) -> Result<Vec<Column>, Error> {
        pieces
            .iter()
            .map(|p| {
                let column = self.problem.eval_text(&self.fit.view, &p.text, keep)?;
                Ok(self.rest(column))
            })
            .collect()
    }

    /// A column without what terms with a coefficient for each sequence explain of it.
    fn rest(&self, column: Column) -> Column {
        match &self.fit.projector {
            None => column,
            Some(projector) => projector.rest(&column),
        }
    }

    /// Sums of the model's terms and further ones.
    fn sums_with(&self, pieces: &[Piece], keep: bool) -> Result<Applied, Error> {
        let mut columns = self.fit.x.clone();
        columns.append(&mut self.columns(pieces, keep)?);
        let at: Vec<Option<usize>> = (0..self.fit.x.len()).map(Some).collect();
        let known = Known {
            sums: &self.fit.sums,
            at: &at,
        };
        let (x, r) = (slices(&columns), &self.fit.residual);
        Ok(Applied {
            sums: Sums::new(self.problem, &x, r, None, Some(known)),
            local: false,
            columns,
            present: None,
        })
    }

    /// Sums of terms whose coefficients every sequence has for itself.
    fn sums_of(&self, pieces: &[Piece], keep: bool) -> Result<Applied, Error> {
        let columns = self.columns(pieces, keep)?;
        let (x, r) = (slices(&columns), &self.fit.residual);
        Ok(Applied {
            sums: Sums::new(self.problem, &x, r, None, None),
            local: true,
            columns,
            present: None,
        })
    }

    /// Sums of the model's terms with some of them `changed`, columns replaced by `pairs` in what
    /// they become, and with terms added that have the coefficient 1.
    fn sums_changed(
        &self,
        pairs: &[(String, String)],
        changed: &dyn Fn(&WorkTerm) -> Option<Expr>,
        added: &[Piece],
        keep: bool,
    ) -> Result<Applied, Error> {
        // A column that is replaced is evaluated once, however many terms use it.
        let view = &self.fit.view;
        let frame = OnceCell::new();
        let swapped = || -> Result<&Frame, Error> {
            if let Some(known) = frame.get() {
                return Ok(known);
            }
            let mut new = view.frame.clone();
            for (name, text) in pairs {
                new.insert(name, Expr::parse(text)?.eval(&view.frame)?);
            }
            Ok(frame.get_or_init(|| new))
        };
        let mut present = self.fit.prediction(self.problem);
        let (mut x, mut at): (Vec<Column>, Vec<_>) = (vec![], vec![]);
        let mut fixed = vec![0.0; self.problem.y.len()];
        for piece in added {
            let v = self.problem.eval_text(view, &piece.text, keep)?;
            fixed.iter_mut().zip(v.iter()).for_each(|(f, v)| *f += v);
        }
        for t in self.model.terms.iter().filter(|t| !t.local) {
            let changed = changed(t);
            let v = match &changed {
                Some(e) => self.problem.eval_swapped(view, pairs, e, keep, swapped)?,
                None => self.problem.eval(view, &t.expr)?,
            };
            match t.fixed {
                Some(k) => fixed
                    .iter_mut()
                    .zip(v.iter())
                    .for_each(|(f, v)| *f += k * v),
                None => {
                    at.push(changed.is_none().then_some(x.len()));
                    x.push(self.rest(v));
                }
            }
        }
        let known = Known {
            sums: &self.fit.sums,
            at: &at,
        };
        present.iter_mut().zip(&fixed).for_each(|(p, f)| *p -= f);
        if let Some(projector) = &self.fit.projector {
            projector.take_out(&mut present);
        }
        let (columns, r) = (slices(&x), &self.fit.residual);
        Ok(Applied {
            sums: Sums::new(self.problem, &columns, r, Some(&present), Some(known)),
            local: false,
            columns: x,
            present: Some(present),
        })
    }

    /// Errors of the residual and of every decoy with a build applied, and the held-out squared
    /// error by block if `by_block`, else nothing.
    fn score(&self, build: &Build, keep: bool, by_block: bool) -> Option<(Scores, Vec<f64>)> {
        let p = self.problem;
        let Applied { sums, local, .. } = self.sums(build, keep).ok()?;
        let decoys: &[Vec<f64>] = if self.screening { &[] } else { &p.flips };
        let mut losses = vec![f64::NAN; if by_block { p.blocks.len() } else { 0 }];
        let scores = if local {
            if by_block {
                sums.hold_out_halves(p, &mut losses);
            }
            Scores::local(p, &sums, decoys)
        } else {
            if by_block {
                sums.hold_out(p, &|_| true, &mut losses);
            }
            Scores::new(p, &sums, decoys)
        };
        Some((scores, losses))
    }

    /// In-sample squared error with a build (cheaper than scores: no decoys).
    pub fn in_sample(&self, build: &Build) -> f64 {
        match self.sums(build, false) {
            Ok(Applied {
                sums, local: false, ..
            }) => {
                let (x, _) = sums.fit(None);
                (0..sums.yy.len()).map(|k| sums.block_error(k, &x)).sum()
            }
            Ok(Applied {
                sums, local: true, ..
            }) => Scores::local(self.problem, &sums, &[]).train_total(),
            Err(_) => f64::INFINITY,
        }
    }

    /// The value of a form's nonlinear parameter that fits best of its grid; `None` if none does.
    pub fn best_of_grid(&self, form: &Variant) -> Option<f64> {
        let grid = form.psi.as_ref().map_or(vec![0.0], |psi| psi.grid.clone());
        let error = |psi: &f64| (*psi, self.in_sample(&(form.build)(*psi)));
        let errors: Vec<(f64, f64)> = grid.par_iter().map(error).collect();
        let finite = errors.iter().filter(|(_, error)| error.is_finite());
        let best = finite.min_by(|a, b| a.1.total_cmp(&b.1));
        best.map(|(psi, _)| *psi)
    }

    /// Whether the data exclude a form at `psi` in the place of a chosen one: it predicts worse, or
    /// explains less than half as much. A form that is the chosen one itself beside the terms of
    /// the model is excluded, too: it is no other effect.
    pub fn excludes(&self, other: &Lookalike, psi: f64, own: &Chosen) -> bool {
        let at = |psi: f64| vec![psi; self.problem.folds];
        let with = self.losses(&other.form, &at(psi));
        let without = self.losses(&own.variant, &at(own.psi));
        let total = |losses: &[f64]| losses.iter().sum::<f64>();
        let half = 0.5 * (total(&self.base_losses(false)) + total(&without));
        let same = || {
            let (own, other) = (
                self.added(&own.variant, own.psi),
                self.added(&other.form, psi),
            );
            similarity(&own, &other) > 1.0 - SAME
        };
        let enough = total(&with) <= half && self.possible(&other.form, psi);
        !enough || t_statistic(&with, &without) > other.excluded_from || same()
    }

    /// Held-out squared error by block when each fold uses its own choice of parameter.
    fn losses(&self, variant: &Variant, psis: &[f64]) -> Vec<f64> {
        let mut out = vec![f64::NAN; self.problem.blocks.len()];
        let mut distinct: Vec<f64> = psis.to_vec();
        distinct.sort_by(f64::total_cmp);
        distinct.dedup();
        for psi in distinct {
            let Ok(Applied { sums, local, .. }) = self.sums(&(variant.build)(psi), false) else {
                continue;
            };
            if local {
                sums.hold_out_halves(self.problem, &mut out);
            } else {
                sums.hold_out(self.problem, &|fold| psis[fold] == psi, &mut out);
            }
        }
        out
    }

    /// Held-out squared error by block of the current model; for forms that are `local` to
    /// sequences that of its residual.
    pub fn base_losses(&self, local: bool) -> Vec<f64> {
        let sums = &self.fit.sums;
        if local {
            return sums.yy.iter().map(|y| y[0]).collect();
        }
        let mut out = vec![0.0; sums.yy.len()];
        sums.hold_out(self.problem, &|_| true, &mut out);
        out
    }
}
