//! Another form of an effect, together with the effect for which it leaves room.

use super::{without, Search};
use crate::model::Chosen;
use residual_columns::error::Error;
use residual_columns::progress::Progress;

/// Share of what a chosen form explains that another form of the effect must explain to be tried.
const NEARLY: f64 = 0.5;

/// Other forms of one effect that are tried.
const FORMS: usize = 2;

impl Search<'_> {
    /// Puts another form of an effect in its place and one more effect beside it, where both
    /// together predict better by what counts. Whether it did.
    ///
    /// A form with a term to spare takes a part of what a second effect does: a drift of gain, with
    /// its gain at mid-range, follows a part of a curve in the load. Then the second effect adds
    /// too little beside it, the right form is worse alone, and no step that changes one effect at
    /// a time leads to the pair.
    pub(super) fn exchange(
        &mut self,
        chosen: &mut Vec<Chosen>,
        progress: &mut dyn Progress,
    ) -> Result<bool, Error> {
        let most = self.rmse(chosen)? * (1.0 - self.spec.selection.material);
        for i in 0..chosen.len() {
            let (own, rest) = without(chosen, i);
            for form in self.other_forms(&own, &rest)? {
                progress.stage(&format!(
                    "{} in another form, and one more effect",
                    own.effect.name()
                ));
                let mut pair = rest.clone();
                pair.push(form);
                if let Some(better) = self.next(&pair)? {
                    if self.rmse(&better)? < most {
                        *chosen = better;
                        return Ok(true);
                    }
                }
            }
        }
        Ok(false)
    }

    /// Other forms of a chosen effect that count in its place, with no more parameters, best first.
    fn other_forms(&mut self, own: &Chosen, rest: &[Chosen]) -> Result<Vec<Chosen>, Error> {
        let fitted = self.fit(rest)?;
        let without_it = fitted.squares();
        let mut with_it = rest.to_vec();
        with_it.push(own.clone());
        let least = NEARLY * (without_it - self.fit(&with_it)?.squares());
        let key = self.scanned(&fitted)?;
        let acceptance = self.acceptance();
        let mut forms: Vec<_> = self
            .candidates(&key)
            .iter()
            .filter(|c| c.origin.kind() == own.effect.kind())
            .filter(|c| c.parameters <= own.parameters() && c.base - c.held >= least)
            .filter(|c| !own.is_form(&c.choose()) && acceptance.accepts(c))
            .cloned()
            .collect();
        forms.sort_by(|a, b| a.held.total_cmp(&b.held));
        forms.truncate(FORMS);
        Ok(forms.iter().map(|c| self.complete(c, rest)).collect())
    }
}
