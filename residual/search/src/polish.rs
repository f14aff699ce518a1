//! Refines nonlinear parameters with the other effects in place.

use super::{without, Search};
use crate::model::{Chosen, Fit};
use crate::scan::{bracket, vertex, Scan, FINE};
use rayon::prelude::*;
use residual_columns::error::Error;

/// Times that the interval of a parameter may move on.
const MOVES: usize = 6;

impl Search<'_> {
    /// Refines every nonlinear parameter with the other effects in place, on all rows.
    pub fn polish(&self, chosen: &mut [Chosen]) -> Result<(), Error> {
        for _ in 0..2 {
            let before: Vec<f64> = chosen.iter().map(|c| c.psi).collect();
            for i in 0..chosen.len() {
                if !chosen[i].variant.psi.as_ref().is_some_and(|p| p.refine) {
                    continue;
                }
                let (own, rest) = without(chosen, i);
                let fitted = self.fit(&rest)?;
                let scan = self.scan_on(&fitted);
                chosen[i].psi = match &self.thin {
                    None => polished(&scan, &own),
                    // Windows of the data show about where it is, at a small part of the cost.
                    Some(problem) => {
                        let fit = &Fit::new(problem, &fitted.model)?;
                        let psi = polished(
                            &Scan {
                                problem,
                                fit,
                                ..scan
                            },
                            &own,
                        );
                        settled(&scan, &own, psi)
                    }
                };
            }
            let same = |(c, psi): (&Chosen, &f64)| (c.psi - psi).abs() <= 1e-3 * psi.abs();
            if self.thin.is_some() && chosen.iter().zip(&before).all(same) {
                break;
            }
        }
        Ok(())
    }

    /// Refines the parameters after a forward search, which ended with a scan on top of `chosen`.
    /// Where rows are many that scan stands for one on top of the refined effects, unless they
    /// predict better by what matters. Whether they do, so that another scan is needed; where rows
    /// are few there is none to save, and the answer is no.
    pub(super) fn polish_last(&mut self, chosen: &mut [Chosen]) -> Result<bool, Error> {
        if self.thin.is_none() {
            self.polish(chosen)?;
            return Ok(false);
        }
        // Only the figures are kept: a fit has many columns of all rows.
        let figures = |chosen: &[Chosen]| -> Result<_, Error> {
            let fitted = self.fit(chosen)?;
            Ok((fitted.rmse(), fitted.model.key()))
        };
        let (before, old) = figures(chosen)?;
        self.polish(chosen)?;
        let (after, new) = figures(chosen)?;
        let same = before < after * (1.0 + SAME);
        if let Some(scanned) = self.scans.get(&old).filter(|_| same).cloned() {
            self.scans.entry(new).or_insert(scanned);
        }
        Ok(!same)
    }
}

/// Relative fall of the error below which a scan of the catalogue on top of a model is not
/// repeated: a tenth of the smallest that counts, with the usual setting.
const SAME: f64 = 0.002;

/// Values tried around a parameter before it is refined: the error of a form with corners (a gap, a
/// limit, a delay in rows) has several minima.
const COARSE: i32 = 4;

/// Width of the interval in which [`settled`] looks, over that between the neighbours of a grid
/// point.
const NEAR: f64 = 0.1;

/// Parabolas that [`settled`] puts through values on all rows.
const PARABOLAS: usize = 3;

/// The nonlinear parameter with the least in-sample error near `psi`, which was found on fewer
/// rows.
fn settled(scan: &Scan, own: &Chosen, psi: f64) -> f64 {
    let Some(range) = &own.variant.psi else {
        return psi;
    };
    let limits = range.limits();
    let error = |x: f64| scan.in_sample(&(own.variant.build)(x));
    let reach = range.resolution.unwrap_or_else(|| {
        let (lo, hi) = bracket(&range.grid, psi);
        hi - lo
    });
    let mut h = 0.5 * NEAR * reach.abs();
    let (mut best, mut least) = (psi, error(psi));
    for _ in 0..PARABOLAS {
        let sides: Vec<(f64, f64)> = [best - h, best + h]
            .into_par_iter()
            .map(|x| x.clamp(limits.0, limits.1))
            .map(|x| (x, error(x)))
            .collect();
        let mut three = vec![sides[0], (best, least), sides[1]];
        if let Some(x) = vertex(&three) {
            let x = x.clamp(limits.0, limits.1);
            three.push((x, error(x)));
        }
        let before = best;
        for (x, e) in three {
            if e < least {
                (best, least) = (x, e);
            }
        }
        // Beyond the sides the parabola is a guess: look there with the same width again.
        if (best - before).abs() < h {
            h *= 0.25;
        }
    }
    best
}

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
        let tried: Vec<(f64, f64)> = (-COARSE..=COARSE)
            .into_par_iter()
            .map(|k| 0.5 * (lo + hi) + f64::from(k) * step)
            .map(|x| (x, error(x)))
            .collect();
        let mut at = best;
        let mut here = least;
        for (x, e) in tried {
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
