//! One effect in the place of two.

use super::{without, Search};
use crate::model::Chosen;
use residual_columns::error::Error;
use residual_columns::progress::Progress;

/// Numbers of effects for which pairs are tried. With more effects the pairs are many, and two in
/// place of one would have been removed before.
const PAIRED: std::ops::RangeInclusive<usize> = 2..=3;

impl Search<'_> {
    /// Two effects that one explains as well are one: tries every pair against the whole catalogue.
    /// Whether a pair was replaced.
    pub(super) fn merge(
        &mut self,
        chosen: &mut Vec<Chosen>,
        progress: &mut dyn Progress,
    ) -> Result<bool, Error> {
        if !PAIRED.contains(&chosen.len()) {
            return Ok(false);
        }
        let current = self.fit(chosen)?.squares();
        for j in 1..chosen.len() {
            for i in 0..j {
                let name = |k: usize| chosen[k].effect.name();
                progress.stage(&format!("one effect for {} and {}", name(i), name(j)));
                if let Some(one) = self.one_for_two(chosen, (i, j), current)? {
                    *chosen = one;
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    /// The chosen effects with one in the place of `i` and `j`, if it explains as much with as few
    /// parameters. `current` is the squared error with both.
    fn one_for_two(
        &mut self,
        chosen: &[Chosen],
        (i, j): (usize, usize),
        current: f64,
    ) -> Result<Option<Vec<Chosen>>, Error> {
        // A hundredth of what two large effects explain may be a third effect that was found beside
        // them.
        let most = current * (1.0 + self.spec.selection.material).powi(2);
        let spent = chosen[i].parameters() + chosen[j].parameters();
        let (_, rest) = without(chosen, j);
        let (_, rest) = without(&rest, i);
        let fitted = self.fit(&rest)?;
        let pair = fitted.squares() - current;
        let step = self.step(&fitted)?;
        for c in step.good.iter().map(|g| &step.ranked[*g]) {
            let may = c.parameters <= spent
                && c.held - current < 0.05 * pair
                && !rest.iter().any(|r| r.excludes(c.origin.kind()));
            if !may {
                continue;
            }
            let mut one = rest.clone();
            one.push(c.choose());
            self.polish(&mut one)?;
            let left = self.fit(&one)?.squares();
            if left - current < 0.01 * pair && left < most {
                return Ok(Some(one));
            }
        }
        Ok(None)
    }
}
