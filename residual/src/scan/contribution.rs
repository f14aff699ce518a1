//! What a form adds to the prediction, row by row.

use super::{Applied, Candidate, Scan};
use crate::effects::{Build, Variant};
use crate::linalg::dot;
use crate::problem::Column;

impl Scan<'_> {
    /// What a candidate adds to the prediction; empty if it cannot be evaluated.
    pub fn contribution<O>(&self, c: &Candidate<O>) -> Vec<f64> {
        self.added(&c.variant, c.psi)
    }

    /// What a form at `psi` adds to the prediction: 0 on every row for a form whose coefficients
    /// every sequence has for itself, empty if it cannot be evaluated.
    pub fn added(&self, variant: &Variant, psi: f64) -> Vec<f64> {
        let build = (variant.build)(psi);
        let Ok(Applied { sums, local }) = self.sums(&build, false) else {
            return vec![];
        };
        let mut out = vec![0.0; self.problem.y.len()];
        if local {
            return out;
        }
        let (x, _) = sums.fit(None);
        let Build::Add(pieces) = &build else {
            return self.added_by_swap(&build, &x).unwrap_or_default();
        };
        let columns: Vec<Column> = pieces
            .iter()
            .filter_map(|p| self.problem.eval_text(&self.fit.view, &p.text, false).ok())
            .map(|column| self.rest(column))
            .collect();
        for (column, k) in self.fit.x.iter().chain(&columns).zip(&x) {
            out.iter_mut()
                .zip(column.iter())
                .for_each(|(o, v)| *o += k * v);
        }
        out
    }

    /// Prediction of the model with columns replaced and coefficients `x`, less the current one.
    fn added_by_swap(&self, build: &Build, x: &[f64]) -> Option<Vec<f64>> {
        let mut out = vec![0.0; self.problem.y.len()];
        let mut model = self.model.clone();
        model.apply(build, usize::MAX).ok()?;
        let mut k = x.iter();
        let view = self.problem.view(&model.replaced).ok()?;
        for t in model.terms.iter().filter(|t| !t.local) {
            let v = self.problem.eval(&view, &t.expr).ok()?;
            let a = t.fixed.unwrap_or_else(|| k.next().copied().unwrap_or(0.0));
            out.iter_mut().zip(v.iter()).for_each(|(o, v)| *o += a * v);
        }
        out.iter_mut()
            .zip(&self.fit.prediction(self.problem))
            .for_each(|(o, p)| *o -= p);
        if let Some(projector) = &self.fit.projector {
            projector.take_out(&mut out);
        }
        Some(out)
    }
}

/// Squared correlation about zero; 0 for values of different lengths.
pub(crate) fn similarity(a: &[f64], b: &[f64]) -> f64 {
    if a.len() != b.len() {
        return 0.0;
    }
    let (aa, bb, ab) = (dot(a, a), dot(b, b), dot(a, b));
    if aa > 0.0 && bb > 0.0 {
        ab * ab / (aa * bb)
    } else {
        0.0
    }
}
