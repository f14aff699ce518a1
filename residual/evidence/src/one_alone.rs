//! What one sequence has and all others do not: something happened in one log.
//!
//! Zeros and gains that differ from log to log are usual, and show in all logs. Here all logs but
//! one agree.

use residual_columns::format::num;
use residual_columns::stats;
use residual_effects::Context;
use std::ops::Range;

/// Fewest sequences of which one can be the only one: the others must show how far they agree.
pub(crate) const FEWEST: usize = 4;

/// Probability that one of sequences that differ by chance stands out so far, over all that are
/// tried.
pub(crate) const BY_CHANCE: f64 = 0.01;

/// A coefficient that one sequence has for itself.
pub(crate) struct Alone {
    /// What it is and where, for readers.
    pub words: String,
    /// Squared error that it explains.
    pub squares: f64,
    /// p value of Student's t of its distance from the others.
    pub p: f64,
}

/// The coefficient by which one sequence stands out most: offset, gain, damping or dry friction.
/// `None` where none does.
pub(crate) fn find(ctx: &Context, residual: &[f64]) -> Option<Alone> {
    let rows = ctx.problem.rows_of_runs();
    if rows.len() < FEWEST {
        return None;
    }
    let load = ctx.range(&ctx.load).map(|_| ("gain", ctx.load.clone()));
    let of_velocity = ctx.velocity.iter().flat_map(|v| {
        let sign = format!("sgn({v}, {})", ctx.deadband);
        [("damping", v.clone()), ("dry friction", sign)]
    });
    let others = load.into_iter().chain(of_velocity);
    let bases: Vec<(&str, Vec<f64>)> = std::iter::once(("offset", vec![]))
        .chain(others.map(|(name, text)| (name, ctx.values(&text))))
        .filter(|(_, x)| x.is_empty() || x.len() == residual.len())
        .collect();
    let tried = (bases.len() * rows.len()) as f64;
    let found = bases.iter().filter_map(|(name, x)| {
        let own: Vec<Own> = rows.iter().map(|r| Own::of(x, residual, r)).collect();
        let (index, p, squares) = stands_out(&own)?;
        let p = (p * tried).min(1.0);
        (p <= BY_CHANCE).then(|| Alone {
            words: format!(
                "which sequence it is: sequence {} of {} alone has another {name} ({}; the others agree on {})",
                index + 1,
                rows.len(),
                num(own[index].size),
                num(mean_of_others(&own, index)),
            ),
            squares,
            p,
        })
    });
    found.max_by(|a, b| a.squares.total_cmp(&b.squares))
}

/// A coefficient of one sequence.
pub(crate) struct Own {
    pub size: f64,
    /// Squared error per square of the coefficient.
    pub weight: f64,
}

impl Own {
    /// Of the mean where `x` is empty, else of `x` beside the mean.
    fn of(x: &[f64], residual: &[f64], rows: &Range<usize>) -> Own {
        let r = &residual[rows.clone()];
        if x.is_empty() {
            return Own {
                size: stats::mean(r),
                weight: r.len() as f64,
            };
        }
        let x = &x[rows.clone()];
        let (x0, r0) = (stats::mean(x), stats::mean(r));
        let (mut xx, mut xr) = (0.0, 0.0);
        for (x, r) in x.iter().zip(r) {
            xx += (x - x0) * (x - x0);
            xr += (x - x0) * (r - r0);
        }
        Own {
            size: if xx > 0.0 { xr / xx } else { 0.0 },
            weight: xx,
        }
    }
}

/// Mean coefficient of all sequences but one.
pub(crate) fn mean_of_others(own: &[Own], index: usize) -> f64 {
    let others = own.iter().enumerate().filter(|(k, _)| *k != index);
    others.map(|(_, o)| o.size).sum::<f64>() / (own.len() - 1) as f64
}

/// The sequence that is farthest from the others beside their scatter: its index, the p value of
/// its distance, and the squared error that it explains. `None` where they do not scatter at all.
pub(crate) fn stands_out(own: &[Own]) -> Option<(usize, f64, f64)> {
    let n = (own.len() - 1) as f64;
    let of = |index: usize| {
        let mean = mean_of_others(own, index);
        let others = own.iter().enumerate().filter(|(k, _)| *k != index);
        let scatter = others.map(|(_, o)| (o.size - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let distance = own[index].size - mean;
        let f = distance.powi(2) / (scatter * (1.0 + 1.0 / n));
        let p = stats::f_tail(f, 1.0, n - 1.0);
        (f.is_finite()).then_some((index, p, distance.powi(2) * own[index].weight))
    };
    let all = (0..own.len()).filter_map(of);
    all.min_by(|a, b| a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_columns::stats::Rng;

    fn own(sizes: &[f64]) -> Vec<Own> {
        let of = |size: &f64| Own {
            size: *size,
            weight: 100.0,
        };
        sizes.iter().map(of).collect()
    }

    #[test]
    fn the_one_that_differs_is_found() {
        let own = own(&[0.01, -0.012, 0.9, 0.004, 0.0]);
        let (index, p, squares) = stands_out(&own).unwrap();
        assert_eq!(index, 2);
        assert!(p < 1e-4, "{p}");
        assert!((squares - 81.0).abs() < 1.0, "{squares}");
    }

    /// The p value is that of chance where all differ by chance.
    #[test]
    fn sequences_that_all_differ_have_none() {
        let mut rng = Rng::new(5);
        let all = 4000;
        let below = (0..all).filter(|_| {
            let sizes: Vec<f64> = (0..6).map(|_| rng.normal()).collect();
            stands_out(&own(&sizes)).is_some_and(|(_, p, _)| p * 6.0 <= 0.05)
        });
        let share = below.count() as f64 / f64::from(all);
        assert!((0.03..0.06).contains(&share), "{share}");
    }

    /// The mean is no part of the slope.
    #[test]
    fn a_slope_is_that_beside_the_mean() {
        let x: Vec<f64> = (0..50).map(|i| 5.0 + f64::from(i) * 0.1).collect();
        let r: Vec<f64> = x.iter().map(|x| 3.0 + 0.2 * x).collect();
        let own = Own::of(&x, &r, &(0..50));
        assert!((own.size - 0.2).abs() < 1e-9, "{}", own.size);
        assert!((Own::of(&[], &r, &(0..50)).size - stats::mean(&r)).abs() < 1e-12);
    }
}
