//! Refines nonlinear parameters with the other effects in place.

use super::{without, Search};
use crate::error::Error;
use crate::model::Chosen;
use crate::scan::{bracket, Scan, FINE};

/// Times that the interval of a parameter may move on.
const MOVES: usize = 6;

impl Search<'_> {
    /// Refines every nonlinear parameter with the other effects in place, on all rows.
    pub(super) fn polish(&self, chosen: &mut [Chosen]) -> Result<(), Error> {
        for _ in 0..2 {
            for i in 0..chosen.len() {
                if !chosen[i].variant.psi.as_ref().is_some_and(|p| p.refine) {
                    continue;
                }
                let (own, rest) = without(chosen, i);
                let fitted = self.fit(&rest)?;
                chosen[i].psi = polished(&self.scan_on(&fitted), &own);
            }
        }
        Ok(())
    }
}

/// The nonlinear parameter with the least in-sample error near the present one.
fn polished(scan: &Scan, own: &Chosen) -> f64 {
    let Some(psi) = &own.variant.psi else {
        return own.psi;
    };
    let (mut lo, mut hi) = match psi.resolution {
        Some(d) => (own.psi - 0.5 * d, own.psi + 0.5 * d),
        None => {
            let (lo, hi) = bracket(&psi.grid, own.psi);
            (
                own.psi - 0.3 * (own.psi - lo).abs(),
                own.psi + 0.3 * (hi - own.psi).abs(),
            )
        }
    };
    // An optimum at the edge of the interval means that it lies further on.
    let mut best = own.psi;
    for _ in 0..MOVES {
        best = scan.refine(&own.variant, lo, hi, FINE);
        let reach = hi - lo;
        if best - lo > 0.04 * reach && hi - best > 0.04 * reach {
            break;
        }
        let positive = lo > 0.0;
        (lo, hi) = (best - 0.7 * reach, best + 0.7 * reach);
        if positive {
            lo = lo.max(0.3 * best);
        }
    }
    best
}
