//! More than one path: an effect that can take the shape of many others may be chosen first and
//! keep them out.
//!
//! Every step of a search changes one or two effects. Where several ripples of low order have taken
//! the place of friction and weight, no such step leads out of it. So the search is repeated
//! without these effects, which are offered again on top of what was found then, and the best of
//! the paths is taken.

use super::{declared, Outcome, Search};
use crate::model::{Chosen, Fitted};
use crate::scan::t_statistic;
use residual_columns::error::Error;
use residual_columns::progress::Progress;
use residual_effects::EffectKind;

/// Periods in the motion below which a ripple is a curve like any other.
pub const FEW_PERIODS: f64 = 8.0;

/// Standard errors of the difference of two errors, block by block, below which they are equal.
const EQUAL: f64 = 2.0;

/// Effects that take the shape of others from which on they may have kept them out: one alone is
/// put to the test by its rivals.
const FEWEST_SHAPES: usize = 2;

/// What belongs to a path beside its outcome.
struct Path {
    outcome: Outcome,
    load: String,
    load_is_behind: bool,
}

impl Search<'_> {
    /// Searches again without each kind of effect that can take the shape of others, and without
    /// all of them, where the first search chose some. Gives the best outcome: one of another path
    /// must predict better by what counts, or as well with fewer parameters. Nothing is repeated
    /// where rows are many.
    pub fn other_paths(
        &mut self,
        first: Outcome,
        progress: &mut dyn Progress,
    ) -> Result<Outcome, Error> {
        let kinds = self.shapes(&first.chosen)?;
        if kinds.is_empty() || self.thin.is_some() {
            return Ok(first);
        }
        let mut left_out: Vec<Vec<EffectKind>> = kinds.iter().map(|k| vec![*k]).collect();
        if kinds.len() > 1 {
            left_out.push(kinds);
        }
        let start = declared::load_expression(&self.declared);
        let mut best = self.path(first);
        for kinds in left_out {
            let names: Vec<&str> = kinds.iter().map(|k| k.as_str()).collect();
            progress.stage(&format!("again without {}", names.join(", ")));
            (self.load, self.load_is_behind) = (start.clone(), false);
            let other = self.without_kinds(&kinds, progress)?;
            if self.is_better(&other, &best.outcome) {
                best = self.path(other);
            }
        }
        self.load = best.load;
        self.load_is_behind = best.load_is_behind;
        self.limited = best.outcome.limited;
        self.scans.clear();
        Ok(best.outcome)
    }

    fn path(&self, outcome: Outcome) -> Path {
        Path {
            outcome,
            load: self.load.clone(),
            load_is_behind: self.load_is_behind,
        }
    }

    /// A search without some kinds of effects, which are then offered on top of it.
    fn without_kinds(
        &mut self,
        kinds: &[EffectKind],
        progress: &mut dyn Progress,
    ) -> Result<Outcome, Error> {
        self.leave_out(kinds);
        let outcome = self.run(progress);
        self.offer_again(kinds);
        let outcome = outcome?;
        let (before, rmse) = (outcome.chosen.len(), outcome.fitted.rmse());
        let mut whole = self.resume(outcome.chosen.clone(), true)?;
        if whole.chosen.len() <= before || whole.fitted.rmse() >= rmse {
            return Ok(outcome);
        }
        self.judge_again(&mut whole)?;
        Ok(whole)
    }

    /// Whether an outcome predicts better than another by what counts, or as well with fewer
    /// parameters.
    fn is_better(&self, other: &Outcome, best: &Outcome) -> bool {
        let losses = |f: &Fitted| -> Vec<f64> {
            let of = |rows: &std::ops::Range<usize>| {
                f.fit.held[rows.clone()].iter().map(|r| r * r).sum()
            };
            self.problem.blocks.iter().map(|b| of(&b.range)).collect()
        };
        let worse = t_statistic(&losses(&other.fitted), &losses(&best.fitted));
        let of = |o: &Outcome| {
            let parameters = o.chosen.iter().map(Chosen::parameters).sum();
            (o.fitted.rmse(), parameters)
        };
        takes_over(of(other), of(best), worse, self.spec.selection.material)
    }

    /// The kinds among chosen effects that can take the shape of others: ripples of few periods in
    /// the motion, friction that depends on the angle, curves over the pose.
    fn shapes(&self, chosen: &[Chosen]) -> Result<Vec<EffectKind>, Error> {
        let declared = self.scan_on(&self.declared);
        let turns = declared.context().turns();
        let takes_a_shape = |c: &Chosen| match c.effect.kind() {
            EffectKind::PeriodicAngle => turns.is_some_and(|turns| c.psi * turns < FEW_PERIODS),
            EffectKind::AngleFriction | EffectKind::Geometry => true,
            _ => false,
        };
        let shapes: Vec<&Chosen> = chosen.iter().filter(|c| takes_a_shape(c)).collect();
        if shapes.len() < FEWEST_SHAPES {
            return Ok(vec![]);
        }
        let mut kinds: Vec<EffectKind> = Vec::new();
        for c in shapes {
            if !kinds.contains(&c.effect.kind()) {
                kinds.push(c.effect.kind());
            }
        }
        Ok(kinds)
    }
}

/// Whether a path takes over from another, by their errors and numbers of parameters: it is better
/// by what counts (`material`), or no `worse` in standard errors and smaller.
fn takes_over(new: (f64, usize), old: (f64, usize), worse: f64, material: f64) -> bool {
    new.0 < old.0 * (1.0 - material) || (new.1 < old.1 && worse < EQUAL)
}

#[cfg(test)]
mod tests {
    use super::takes_over;

    #[test]
    fn a_path_must_be_better_or_as_good_and_smaller() {
        for (new, old, worse, expected) in [
            ((0.356, 9), (0.540, 13), -9.0, true),
            ((0.356, 13), (0.540, 9), -9.0, true),
            ((0.418_3, 7), (0.418_0, 10), 0.8, true),
            ((0.43, 7), (0.418, 10), 3.0, false),
            ((0.418_3, 10), (0.418_0, 10), 0.8, false),
            ((0.415, 12), (0.418, 10), -1.0, false),
        ] {
            assert_eq!(
                takes_over(new, old, worse, 0.02),
                expected,
                "{new:?} {old:?}"
            );
        }
    }
}
