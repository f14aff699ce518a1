//! The second test of a candidate: against decoys of what remains *after* it.

use super::significance::p_value;
use super::{Candidate, Origin, Scan};
use rayon::prelude::*;
use residual_fit::problem::{profile, slices, Scores, Sums};

impl Scan<'_> {
    /// p value against decoys of what remains after the candidate. Decoys of the residual itself
    /// carry the effect in pieces, which hides effects that are slow or act in few places.
    /// `rows` are those on which the candidate was found: this scan may have fewer of them.
    pub fn retest<O: Origin>(&self, c: &Candidate<O>, rows: usize) -> f64 {
        let added = self.contribution(c);
        if added.len() != self.fit.residual.len() {
            return c.p;
        }
        let residual: Vec<f64> = self
            .fit
            .residual
            .iter()
            .zip(&added)
            .map(|(r, a)| r - a)
            .collect();
        let columns = slices(&self.fit.x);
        let sums = Sums::new(self.problem, &columns, &residual, None, None);
        let scores = Scores::new(self.problem, &sums, &self.problem.flips);
        let fit = self.fit.on(self.problem, residual, sums, scores);
        let after = Scan { fit: &fit, ..*self };
        let mut grid = c.variant.psi.as_ref().map_or(vec![], |p| p.grid.clone());
        grid.push(c.psi);
        let points: Vec<Scores> = grid
            .par_iter()
            .filter_map(|psi| Some(after.score(&(c.variant.build)(*psi), true, false)?.0))
            .collect();
        let base = c.base * self.problem.y.len() as f64 / rows.max(1) as f64;
        let refs: Vec<&Scores> = points.iter().collect();
        let (held, _) = profile(&refs);
        let decoys: Vec<f64> = held
            .iter()
            .enumerate()
            .skip(1)
            .map(|(j, h)| (fit.scores.held_total(j) - h) / base)
            .collect();
        p_value((c.base - c.held) / c.base, &decoys)
    }
}
