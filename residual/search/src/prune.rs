//! Removes effects that the others make superfluous.

use super::{without, Search};
use crate::model::Chosen;
use residual_columns::error::Error;

impl Search<'_> {
    /// Removes the weakest effect, again and again, while it is worth less than half of what
    /// counts.
    pub(super) fn prune(&self, chosen: &mut Vec<Chosen>) -> Result<(), Error> {
        loop {
            let full = self.rmse(chosen)?;
            let mut weakest: Option<(usize, f64)> = None;
            for i in 0..chosen.len() {
                let rmse = self.rmse(&without(chosen, i).1)?;
                let loss = 1.0 - full / rmse.max(f64::MIN_POSITIVE);
                if loss < 0.5 * self.spec.selection.material && weakest.is_none_or(|w| loss < w.1) {
                    weakest = Some((i, loss));
                }
            }
            match weakest {
                Some((i, _)) => {
                    chosen.remove(i);
                }
                None => return Ok(()),
            }
        }
    }
}
