//! Dry friction in several effects: which of them share a coefficient.

use super::Search;
use crate::model::Chosen;
use crate::scan::Candidate;
use residual_columns::error::Error;
use residual_effects::{Form, Friction};
use std::sync::Arc;

impl Search<'_> {
    /// A candidate as a choice. Friction that grows with load on top of plain Coulomb friction is
    /// one friction with two parameters, so the form with both is taken (and plain Coulomb pruned).
    pub(super) fn complete(&self, c: &Candidate, chosen: &[Chosen]) -> Chosen {
        let mut choice = c.choose();
        let constant = chosen
            .iter()
            .any(|x| x.effect.friction() == Some(Friction::Constant));
        if c.origin.friction() == Some(Friction::WithLoad) && constant {
            if let Ok(fitted) = self.fit(&[]) {
                let ctx = self.scan_on(&fitted).context();
                if let Some(v) = c.origin.variants(&ctx).into_iter().next() {
                    choice.variant = Arc::new(v);
                }
            }
        }
        choice
    }

    /// Gives friction in motion and friction at rest coefficients of their own, where they share
    /// one and friction in motion grows with the load. They stay together if that predicts worse.
    ///
    /// Under one coefficient they would keep richer forms of either out, and friction in motion
    /// would be reported as a difference to friction at rest.
    pub(super) fn separate_friction(&self, chosen: &mut Vec<Chosen>) -> Result<(), Error> {
        let at = |friction: Friction| {
            chosen
                .iter()
                .position(|c| c.effect.friction() == Some(friction))
        };
        let (Some(load), Some(rest)) = (at(Friction::WithLoad), at(Friction::AtRest)) else {
            return Ok(());
        };
        if chosen[rest].variant.form != Form::MotionAndRest {
            return Ok(());
        }
        let fitted = self.fit(&[])?;
        let ctx = self.scan_on(&fitted).context();
        let forms = chosen[load].effect.variants(&ctx);
        let Some(moving) = forms.into_iter().next().map(Arc::new) else {
            return Ok(());
        };
        // The plain form contains the form with one coefficient, up to rounding.
        let mut least = self.rmse(chosen)? * (1.0 + 1e-9);
        let from = chosen.clone();
        for held in from[rest].effect.variants(&ctx) {
            if ![Form::AtRest, Form::AtRestWithLoad].contains(&held.form) {
                continue;
            }
            let mut separate = from.clone();
            separate[load].variant = moving.clone();
            separate[rest].variant = Arc::new(held);
            let rmse = self.rmse(&separate)?;
            if rmse <= least {
                (least, *chosen) = (rmse, separate);
            }
        }
        Ok(())
    }
}
