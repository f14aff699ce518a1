//! Each effect must hold its place against the whole catalogue with the others in place.

use super::{without, Rival, Search, Standing};
use crate::model::{Chosen, Fitted};
use crate::ranking::{indistinguishable, Step, STEADY};
use crate::scan::Candidate;
use residual_columns::error::Error;
use residual_columns::progress::Progress;
use residual_effects::{effect, EffectRef};

impl Search<'_> {
    /// Lets the whole catalogue compete for the place of each effect. `None` if an effect was
    /// replaced, which may happen only if `may_replace`.
    pub(super) fn rivals(
        &mut self,
        chosen: &mut Vec<Chosen>,
        may_replace: bool,
        progress: &mut dyn Progress,
    ) -> Result<Option<Vec<Standing>>, Error> {
        let mut out = Vec::new();
        let current = self.rmse(chosen)?;
        for i in 0..chosen.len() {
            progress.stage(&format!("rivals of {}", chosen[i].effect.name()));
            let (own, rest) = without(chosen, i);
            let fitted = self.fit(&rest)?;
            let step = self.step(&fitted)?;
            if may_replace {
                if let Some(better) = self.replacement(&own, &rest, &step, current)? {
                    *chosen = better;
                    return Ok(None);
                }
            }
            out.push(self.judge(&own, &rest, &step, &fitted, current));
        }
        Ok(Some(out))
    }

    /// The effects with the winner of a step in the place of `own`, if it predicts better, or is
    /// simpler and predicts nearly as well. With no more parameters a small difference decides if
    /// it is steady: `own` was chosen when other effects were still missing.
    fn replacement(
        &self,
        own: &Chosen,
        rest: &[Chosen],
        step: &Step,
        current: f64,
    ) -> Result<Option<Vec<Chosen>>, Error> {
        // Another form of the same effect may fit better now that others are in place.
        let Some(c) = step.winner().filter(|c| {
            !own.is_form(&c.choose()) && !rest.iter().any(|r| r.excludes(c.origin.kind()))
        }) else {
            return Ok(None);
        };
        let mut other = rest.to_vec();
        let form = self.complete(c, &other);
        // Completed, it may be what is there already.
        let same = own.is_form(&form);
        let factor = if form.parameters() < own.parameters() {
            1.005
        } else {
            0.99
        };
        let as_simple = form.parameters() <= own.parameters();
        other.push(form);
        let fitted = self.fit(&other)?;
        let steadily = || -> Result<bool, Error> {
            let mut with_own = rest.to_vec();
            with_own.push(own.clone());
            Ok(as_simple && self.worse(&fitted, &self.fit(&with_own)?) < -STEADY)
        };
        let better = !same && (fitted.rmse() < current * factor || steadily()?);
        if better {
            self.prune(&mut other)?;
        }
        Ok(better.then_some(other))
    }

    /// The nearest rival of an effect that keeps its place, and what cannot be told from it.
    fn judge(
        &self,
        own: &Chosen,
        rest: &[Chosen],
        step: &Step,
        fitted: &Fitted,
        current: f64,
    ) -> Standing {
        let kind = own.effect.kind();
        let there = |c: &Candidate| rest.iter().any(|r| r.excludes(c.origin.kind()));
        let rows = self.problem.y.len() as f64;
        let first = step
            .ranked
            .iter()
            .find(|c| c.origin.kind() != kind && !there(c));
        let rival = first.map(|c| {
            let rmse = (c.held / rows).sqrt();
            Rival {
                name: c.origin.kind(),
                heldout_rmse: rmse,
                behind: rmse / current - 1.0,
            }
        });
        Standing {
            rival,
            rival_is_simpler: first.is_some_and(|c| c.parameters < own.parameters()),
            ties: self.ties(own, rest, step, fitted),
        }
    }

    /// Effects that the data cannot distinguish from `own`, beside the `rest`.
    fn ties(&self, own: &Chosen, rest: &[Chosen], step: &Step, on: &Fitted) -> Vec<EffectRef> {
        let scan = self.scan_on(on);
        let kind = own.effect.kind();
        let place = step.ranked.iter().position(|c| c.origin.kind() == kind);
        let mut ties = place.map_or(vec![], |at| indistinguishable(&scan, step, at));
        // Windows show as well as all rows which of many values fits best.
        let small = self.fit_on_windows(on);
        let on_windows = scan.on(small.as_ref());
        for other in own.effect.lookalikes(&on_windows.context()) {
            let there = rest.iter().any(|r| r.excludes(other.kind));
            let known = ties.iter().any(|e| e.kind() == other.kind);
            let may_be = match other.though_refused {
                true => self.is_offered(effect(other.kind)),
                false => self.allowed(effect(other.kind)),
            };
            if there || known || !may_be {
                continue;
            }
            let best = on_windows.best_of_grid(&other.form);
            if best.is_some_and(|psi| !scan.excludes(&other, psi, own)) {
                ties.push(effect(other.kind));
            }
        }
        ties
    }
}
