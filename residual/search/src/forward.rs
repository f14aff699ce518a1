//! Forward search: adds effects until nothing material is left.

use super::Search;
use crate::model::Chosen;
use residual_columns::error::Error;
use residual_columns::progress::Progress;

impl Search<'_> {
    /// Adds effects until nothing material is left.
    pub(super) fn forward(
        &mut self,
        chosen: &mut Vec<Chosen>,
        progress: &mut dyn Progress,
    ) -> Result<(), Error> {
        self.limited = None;
        loop {
            progress.stage(&format!(
                "searching the catalogue on top of {} effect(s)",
                chosen.len()
            ));
            match self.next(chosen)? {
                Some(next) => *chosen = next,
                None => return Ok(()),
            }
            // What is built on the load before a late command would have to make up for the
            // lateness.
            self.load_behind(chosen)?;
        }
    }

    /// The chosen effects with one more; `None` if no candidate lowers the error by what counts.
    pub(super) fn next(&mut self, chosen: &[Chosen]) -> Result<Option<Vec<Chosen>>, Error> {
        let selection = &self.spec.selection;
        let fitted = self.fit(chosen)?;
        let most = fitted.rmse() * (1.0 - selection.material);
        let mut tried: Vec<Chosen> = Vec::new();
        loop {
            // The winner may be a form of an effect that is there already and turn out to add
            // nothing.
            for c in self.step(&fitted)?.in_turn() {
                let form = c.choose();
                if tried.iter().any(|t| t.is_form(&form)) {
                    continue;
                }
                tried.push(form);
                let mut next = chosen.to_vec();
                if !c.origin.repeatable() {
                    next.retain(|x| x.effect.kind() != c.origin.kind());
                }
                next.push(self.complete(c, &next));
                self.separate_friction(&mut next)?;
                self.prune(&mut next)?;
                if self.rmse(&next)? > most {
                    continue;
                }
                if next.len() <= selection.max_effects {
                    return Ok(Some(next));
                }
                self.limited.get_or_insert(c.origin.kind());
            }
            if !self.scan_waiting(&fitted) {
                return Ok(None);
            }
        }
    }
}
