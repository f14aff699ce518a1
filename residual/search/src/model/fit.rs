//! The fit of a model: coefficients on all rows, and the residual of each fold predicted from the
//! others.

use super::{Model, Projector};
use residual_columns::error::Error;
use residual_columns::stats;
use residual_fit::problem::{slices, Column, Problem, Scores, Sums, View};
use std::ops::Range;
use std::sync::Arc;

/// A model with its fit.
pub struct Fitted {
    /// The terms.
    pub model: Model,
    /// Their fit.
    pub fit: Fit,
}

impl Fitted {
    /// Held-out RMSE.
    pub fn rmse(&self) -> f64 {
        stats::rms(&self.fit.held)
    }

    /// Held-out squared error.
    pub fn squares(&self) -> f64 {
        self.fit.held.iter().map(|r| r * r).sum()
    }
}

/// A fitted model.
pub struct Fit {
    /// The columns as the model sees them.
    pub view: Arc<View>,
    /// Index of each fitted global term.
    pub free: Vec<usize>,
    /// Terms with a coefficient for each sequence; `None` without such terms.
    pub projector: Option<Arc<Projector>>,
    /// Columns of the fitted global terms, without what such terms explain of them.
    pub x: Vec<Column>,
    /// Coefficients of `free` on all rows.
    pub theta: Vec<f64>,
    /// Fitted terms that repeat others.
    pub dropped: Vec<bool>,
    /// Sums with the residual as flipped target.
    pub sums: Sums,
    /// In-sample prediction, where it is not the target less the residual.
    other_prediction: Option<Vec<f64>>,
    /// In-sample residual.
    pub residual: Vec<f64>,
    /// Held-out residual, row by row.
    pub held: Vec<f64>,
    /// Scores of `sums`: what a candidate must beat.
    pub scores: Scores,
    /// Amplitude-like RMS of each local term's coefficients over sequences.
    pub local: Vec<(usize, f64)>,
}

/// Terms of a model, evaluated: fixed ones summed, fitted ones with their index.
struct Terms {
    fixed: Vec<f64>,
    free: Vec<usize>,
    x: Vec<Column>,
    local: Vec<usize>,
    local_x: Vec<Column>,
}

impl Terms {
    fn new(p: &Problem, model: &Model, view: &View) -> Result<Terms, Error> {
        let mut out = Terms {
            fixed: vec![0.0; p.y.len()],
            free: vec![],
            x: vec![],
            local: vec![],
            local_x: vec![],
        };
        for (i, t) in model.terms.iter().enumerate() {
            let v = p.eval(view, &t.expr)?;
            match (t.fixed, t.local) {
                (Some(k), _) => out
                    .fixed
                    .iter_mut()
                    .zip(v.iter())
                    .for_each(|(f, v)| *f += k * v),
                (None, false) => {
                    out.free.push(i);
                    out.x.push(v);
                }
                (None, true) => {
                    out.local.push(i);
                    out.local_x.push(v);
                }
            }
        }
        Ok(out)
    }
}

/// Takes the prediction of columns with coefficients off some rows.
fn subtract(columns: &[&[f64]], theta: &[f64], range: Range<usize>, from: &mut [f64]) {
    for (c, k) in columns.iter().zip(theta) {
        if *k != 0.0 {
            from[range.clone()]
                .iter_mut()
                .zip(&c[range.clone()])
                .for_each(|(o, v)| *o -= k * v);
        }
    }
}

/// Takes off each fold the prediction from a fit to the others.
fn hold_out(p: &Problem, columns: &[&[f64]], sums: &Sums, held: &mut [f64]) {
    for f in 0..p.folds {
        let w: Vec<f64> = p
            .blocks
            .iter()
            .map(|b| if b.fold == f { 0.0 } else { 1.0 })
            .collect();
        let (theta, _) = sums.fit(Some(&w));
        for b in p.blocks.iter().filter(|b| b.fold == f) {
            subtract(columns, &theta, b.range.clone(), held);
        }
    }
}

/// Takes off each sequence the prediction of coefficients of its own: in-sample, or each half of
/// its blocks (odd, even) predicted from the other half.
fn subtract_local(p: &Problem, columns: &[&[f64]], halves: bool, values: &mut [f64]) -> Vec<f64> {
    let sums = Sums::new(p, columns, values, None, None);
    let mut squares = vec![0.0; columns.len()];
    let mut weight = 0.0;
    for run in p.runs() {
        for half in 0..if halves { 2 } else { 1 } {
            let w: Vec<f64> = (0..p.blocks.len())
                .map(|k| {
                    let fitted = run.contains(&k) && (!halves || (k - run.start) % 2 != half);
                    f64::from(u8::from(fitted))
                })
                .collect();
            let (theta, _) = sums.fit(Some(&w));
            for k in run.clone() {
                if halves && (k - run.start) % 2 != half {
                    continue;
                }
                let r = p.blocks[k].range.clone();
                for (c, a) in columns.iter().zip(&theta) {
                    values[r.clone()]
                        .iter_mut()
                        .zip(&c[r.clone()])
                        .for_each(|(o, v)| *o -= a * v);
                }
            }
            let rows = (p.blocks[run.end - 1].range.end - p.blocks[run.start].range.start) as f64;
            squares
                .iter_mut()
                .zip(&theta)
                .for_each(|(s, t)| *s += rows * t * t);
            weight += rows;
        }
    }
    squares
        .iter()
        .map(|s| (s / f64::max(weight, 1.0)).sqrt())
        .collect()
}

impl Fit {
    /// Fits and holds out.
    pub fn new(p: &Problem, model: &Model) -> Result<Fit, Error> {
        let n = p.y.len();
        let view = p.view(&model.replaced)?;
        let terms = Terms::new(p, model, &view)?;
        let y: Vec<f64> = p.y.iter().zip(&terms.fixed).map(|(y, f)| y - f).collect();
        let projector = Projector::new(p, terms.local_x.clone()).map(Arc::new);
        let x: Vec<Column> = match &projector {
            None => terms.x.clone(),
            Some(projector) => terms.x.iter().map(|c| projector.rest(c)).collect(),
        };
        let mut held = y.clone();
        let mut residual = y;
        if let Some(projector) = &projector {
            projector.take_out(&mut residual);
        }
        let columns = slices(&x);
        let raw = Sums::new(p, &columns, &residual, None, None);
        let (theta, dropped) = raw.fit(None);
        subtract(&columns, &theta, 0..n, &mut residual);
        hold_out(p, &slices(&terms.x), &raw, &mut held);
        let mut local = Vec::new();
        if !terms.local.is_empty() {
            let own = slices(&terms.local_x);
            subtract_local(p, &own, true, &mut held);
            let mut rest: Vec<f64> = p.y.iter().zip(&terms.fixed).map(|(y, f)| y - f).collect();
            subtract(&slices(&terms.x), &theta, 0..n, &mut rest);
            let sizes = subtract_local(p, &own, false, &mut rest);
            local = terms.local.iter().copied().zip(sizes).collect();
        }
        let sums = raw.on(p, &columns, &residual);
        let scores = Scores::new(p, &sums, &p.flips);
        Ok(Fit {
            view,
            projector,
            free: terms.free,
            x,
            other_prediction: None,
            theta,
            dropped,
            sums,
            residual,
            held,
            scores,
            local,
        })
    }

    /// In-sample prediction of the target on the kept rows.
    pub fn prediction(&self, p: &Problem) -> Vec<f64> {
        match &self.other_prediction {
            Some(prediction) => prediction.clone(),
            None => {
                let rows = p.y.iter().zip(&self.residual);
                rows.map(|(y, r)| y - r).collect()
            }
        }
    }

    /// What another model with the same terms predicts with these coefficients, terms with a
    /// coefficient for each sequence left out.
    pub fn with_coefficients(&self, p: &Problem, model: &Model) -> Result<Vec<f64>, Error> {
        let view = p.view(&model.replaced)?;
        let Terms {
            fixed: mut out, x, ..
        } = Terms::new(p, model, &view)?;
        for (x, k) in x.iter().zip(&self.theta) {
            out.iter_mut().zip(x.iter()).for_each(|(o, x)| *o += k * x);
        }
        Ok(out)
    }

    /// The same fit with another residual in its place.
    pub fn on(&self, p: &Problem, residual: Vec<f64>, sums: Sums, scores: Scores) -> Fit {
        Fit {
            view: self.view.clone(),
            projector: self.projector.clone(),
            free: self.free.clone(),
            x: self.x.clone(),
            other_prediction: Some(self.prediction(p)),
            theta: self.theta.clone(),
            dropped: self.dropped.clone(),
            sums,
            residual,
            held: vec![],
            scores,
            local: vec![],
        }
    }
}
