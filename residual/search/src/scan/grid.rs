//! The nonlinear parameter of a form: where to look for it, and its golden-section search.

use super::Scan;
use residual_effects::{Psi, Variant};

/// Steps of a golden-section search that find an optimum to a 2000th of the interval.
pub const FINE: usize = 16;

/// Steps that find it to a 30th, enough for a scan on all rows to begin there.
pub(super) const ROUGH: usize = 7;

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

/// Where the parabola through three points (parameter, error) is least, at most their span beyond
/// them; `None` if it has no minimum.
pub fn vertex(at: &[(f64, f64)]) -> Option<f64> {
    let [(a, fa), (b, fb), (c, fc)] = *at else {
        return None;
    };
    let (left, right) = ((fb - fa) / (b - a), (fc - fb) / (c - b));
    let bend = (right - left) / (c - a);
    let psi = 0.5 * (a + b) - 0.5 * left / bend;
    let (lo, hi) = (a.min(c) - (c - a).abs(), a.max(c) + (c - a).abs());
    let psi = psi.clamp(if a > 0.0 { lo.max(0.5 * a) } else { lo }, hi);
    (bend > 0.0 && psi.is_finite()).then_some(psi)
}

/// Interval around a grid point in which to refine: up to its neighbours.
pub fn bracket(grid: &[f64], at: f64) -> (f64, f64) {
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

/// How far a value may be off its grid point: by the `resolution`, or up to the neighbours.
pub fn reach(resolution: Option<f64>, grid: &[f64], at: f64) -> (f64, f64) {
    resolution.map_or_else(|| bracket(grid, at), |d| (at - d, at + d))
}

impl Scan<'_> {
    /// Golden-section search of the nonlinear parameter between `lo` and `hi`; every step takes
    /// two fifths of the interval away.
    pub fn refine(&self, variant: &Variant, lo: f64, hi: f64, steps: usize) -> f64 {
        // The golden ratio less one.
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

#[cfg(test)]
mod tests {
    use super::vertex;

    #[test]
    fn a_parabola_is_least_at_its_vertex_and_one_that_bends_down_nowhere() {
        let points = |f: &dyn Fn(f64) -> f64| [1.0, 2.0, 3.0].map(|x| (x, f(x)));
        let psi = vertex(&points(&|x| 5.0 + (x - 2.3).powi(2))).unwrap();
        assert!((psi - 2.3).abs() < 1e-12, "{psi}");
        assert_eq!(vertex(&points(&|x| -x * x)), None);
        // Far outside it is limited.
        assert_eq!(vertex(&points(&|x| (x - 40.0).powi(2))), Some(5.0));
        assert_eq!(vertex(&points(&|x| (x + 40.0).powi(2))), Some(0.5));
        assert_eq!(vertex(&[(1.0, 1.0)]), None);
    }
}
