//! What was scanned on top of a model, and what passed the screening and is still to be scanned.

use crate::scan::{Candidate, Offer};
use residual_effects::EffectRef;

/// Share of the best gain on windows above which a form is scanned on all rows at once. The others
/// are only if none of these counts: a form that explains so much less can neither come first nor
/// be a close rival.
const AT_ONCE: f64 = 0.5;

/// Fewest forms that are scanned on all rows at once.
const FEWEST_AT_ONCE: usize = 4;

/// Forms of the catalogue on top of one model.
#[derive(Clone)]
pub(super) struct Scanned {
    /// With what each achieves.
    pub candidates: Vec<Candidate>,
    /// Those that were screened on windows and are still to be scanned on all rows.
    pub waiting: ShortList,
}

/// Forms that passed the screening on windows, the most promising first.
#[derive(Clone)]
pub(super) struct ShortList<O = EffectRef> {
    pub offers: Vec<Offer<O>>,
    /// Nonlinear parameter of each, on windows.
    pub at: Vec<f64>,
    /// Gain of each on windows; infinite for what the target itself shows.
    pub gains: Vec<f64>,
}

impl<O> Default for ShortList<O> {
    fn default() -> Self {
        ShortList {
            offers: vec![],
            at: vec![],
            gains: vec![],
        }
    }
}

impl<O> ShortList<O> {
    /// Takes off those that are scanned on all rows at once.
    pub fn first(&mut self) -> ShortList<O> {
        let finite = self.gains.iter().copied().filter(|g| g.is_finite());
        let least = AT_ONCE * finite.fold(0.0, f64::max);
        let enough = self.gains.iter().take_while(|g| **g >= least).count();
        self.take(enough.max(FEWEST_AT_ONCE))
    }

    /// Takes off the first `count`.
    fn take(&mut self, count: usize) -> ShortList<O> {
        let count = count.min(self.offers.len());
        ShortList {
            offers: self.offers.drain(..count).collect(),
            at: self.at.drain(..count).collect(),
            gains: self.gains.drain(..count).collect(),
        }
    }
}
