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

/// Values tried around a parameter before it is refined: the error of a form with corners (a gap, a limit, a delay in
/// rows) has several minima.
const COARSE: i32 = 4;

/// The nonlinear parameter with the least in-sample error near the present one.
fn polished(scan: &Scan, own: &Chosen) -> f64 {
    let Some(psi) = &own.variant.psi else {
        return own.psi;
    };
    // Beyond the grid an effect turns into another one: a fast creep is a gain.
    let limits = psi.limits();
    let inside = |(lo, hi): (f64, f64)| (lo.max(limits.0), hi.min(limits.1));
    let error = |x: f64| scan.in_sample(&(own.variant.build)(x));
    let (mut best, mut least) = (own.psi, error(own.psi));
    let mut reach = match psi.resolution {
        Some(d) => d,
        None => {
            let (lo, hi) = bracket(&psi.grid, own.psi);
            0.6 * (hi - lo)
        }
    };
    for _ in 0..MOVES {
        let (lo, hi) = inside((best - 0.5 * reach, best + 0.5 * reach));
        if hi <= lo {
            break;
        }
        let step = (hi - lo) / f64::from(2 * COARSE);
        let mut at = best;
        let mut here = least;
        for k in -COARSE..=COARSE {
            let x = 0.5 * (lo + hi) + f64::from(k) * step;
            let e = error(x);
            if e < here {
                (at, here) = (x, e);
            }
        }
        let (a, b) = inside((at - step, at + step));
        let fine = scan.refine(&own.variant, a, b, FINE / 2);
        let e = error(fine);
        if e < here {
            (at, here) = (fine, e);
        }
        let moved = (at - best).abs();
        (best, least) = (at, here);
        // An optimum at the edge of the interval means that it lies further on.
        if moved < 0.45 * reach {
            reach = 2.0 * step;
        }
        if reach < 2e-3 * (hi - lo).max(best.abs() * 1e-3) || step == 0.0 {
            break;
        }
        if moved < 0.02 * step {
            break;
        }
    }
    best
}
