//! The nonlinear parameter of a form: where to look for it, and its golden-section search.

use super::Scan;
use crate::effects::{Psi, Variant};

/// Steps of a golden-section search that find an optimum to a 2000th of the interval.
pub(crate) const FINE: usize = 16;

/// Values around `at`: a seventh of a grid step apart.
pub(super) fn neighbourhood(p: &Psi, at: f64) -> Vec<f64> {
    let k = p.grid.partition_point(|g| *g < at);
    let (lo, hi) = (p.grid[k.saturating_sub(1)], p.grid[k.min(p.grid.len() - 1)]);
    let d = p.resolution.unwrap_or((hi - lo).abs()) / 7.0;
    [-1.0, 0.0, 1.0]
        .iter()
        .map(|s| at + s * d)
        .filter(|x| at <= 0.0 || *x > 0.0)
        .collect()
}

/// Interval around a grid point in which to refine: up to its neighbours.
pub(crate) fn bracket(grid: &[f64], at: f64) -> (f64, f64) {
    let k = grid.partition_point(|g| *g < at);
    let left = if k > 0 {
        grid[k - 1]
    } else if at > 0.0 {
        at * 0.7
    } else {
        at * 1.3
    };
    let right = grid
        .get(k + 1)
        .copied()
        .unwrap_or(if at > 0.0 { at * 1.4 } else { at * 0.7 });
    (left, right)
}

impl Scan<'_> {
    /// Golden-section search of the nonlinear parameter between `lo` and `hi`; every step takes
    /// two fifths of the interval away.
    pub fn refine(&self, variant: &Variant, lo: f64, hi: f64, steps: usize) -> f64 {
        const RATIO: f64 = 0.618_033_988_749_895;
        let log = lo > 0.0 && hi / lo > 1.05;
        let to = |x: f64| if log { x.ln() } else { x };
        let from = |u: f64| if log { u.exp() } else { u };
        let (mut a, mut b) = (to(lo), to(hi));
        let cost = |u: f64| self.in_sample(&(variant.build)(from(u)));
        let (mut c, mut d) = (b - RATIO * (b - a), a + RATIO * (b - a));
        let (mut fc, mut fd) = (cost(c), cost(d));
        for _ in 0..steps {
            if fc < fd {
                (b, d, fd) = (d, c, fc);
                c = b - RATIO * (b - a);
                fc = cost(c);
            } else {
                (a, c, fc) = (c, d, fd);
                d = a + RATIO * (b - a);
                fd = cost(d);
            }
        }
        from(0.5 * (a + b))
    }
}
