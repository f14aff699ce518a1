//! Evidence that lies between sequences: an effect that acts in the means of the sequences has as
//! many observations as there are sequences, however many rows and blocks these have.

use super::Scan;
use residual_columns::linalg::Cholesky;
use residual_columns::stats;
use residual_effects::Variant;
use residual_fit::problem::{Column, RANK_TOL};
use std::ops::Range;

/// Share of what a form explains from which on the means of the sequences are the evidence for it.
const MOSTLY: f64 = 0.5;

/// Fewest sequences whose means can confirm anything.
pub(super) const FEWEST_MEANS: usize = 3;

/// What the means of the sequences say about a form that acts mostly in them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Between {
    /// p value by an F test over the means; 1 where there are too few sequences for a test.
    pub p: f64,
    /// p value of what the form explains within sequences.
    pub within: f64,
    /// Number of means, smaller where their sequences have unequal lengths (Kish's effective
    /// number).
    pub sequences: f64,
    /// Parameters fitted to the means: those of the form, and what the model has used of them
    /// already.
    pub fitted: f64,
}

impl Scan<'_> {
    /// What the means of the sequences say about a form at `psi` that adds `added` to the
    /// prediction; `None` where most of what it explains is within sequences, or where there are
    /// fewer than three: two logs at two loads show a gain, and nothing against it.
    ///
    /// Decoys can't show this: their signs change from block to block, so the mean of a decoy over
    /// a sequence is near zero, while the zero of a sensor often differs from one sequence to the
    /// next.
    pub fn between_sequences(&self, variant: &Variant, psi: f64, added: &[f64]) -> Option<Between> {
        let rows = self.problem.rows_of_runs();
        if rows.len() < FEWEST_MEANS || added.len() != self.fit.residual.len() {
            return None;
        }
        let sums = means_of(&self.fit.residual, added, &rows);
        let fitted = self.used_between(&rows) + variant.parameters(psi) as f64;
        let tried = variant.psi.as_ref().map_or(1, |psi| psi.grid.len());
        let (sequences, p) = p_of_means(&sums, variant.parameters(psi), fitted)?;
        Some(Between {
            p: (p * tried as f64).min(1.0),
            within: self.within(&self.problem.runs(), &sums, added),
            sequences,
            fitted,
        })
    }

    /// Degrees of freedom of the sequences' means that the model's fitted terms use: the trace of
    /// inv(G) B, with the sums of products of its columns G and that of their means in the
    /// sequences B.
    fn used_between(&self, rows: &[Range<usize>]) -> f64 {
        let q = self.fit.x.len();
        let mut all = vec![0.0; q * q];
        for block in self.fit.sums.g.chunks_exact((q * q).max(1)) {
            all.iter_mut().zip(block).for_each(|(a, b)| *a += b);
        }
        let mut between = vec![vec![0.0; q]; q];
        for rows in rows {
            let sum = |x: &Column| x[rows.clone()].iter().sum::<f64>();
            let sums: Vec<f64> = self.fit.x.iter().map(sum).collect();
            for (row, a) in between.iter_mut().zip(&sums) {
                for (b, c) in row.iter_mut().zip(&sums) {
                    *b += a * c / rows.len() as f64;
                }
            }
        }
        let inverse = Cholesky::new(&all, q, RANK_TOL);
        (0..q).map(|k| inverse.solve(&between[k])[k]).sum()
    }

    /// p value of a form by what it explains within sequences: a score test with blocks as
    /// observations.
    fn within(&self, runs: &[Range<usize>], sums: &[Means], added: &[f64]) -> f64 {
        let (mut total, mut squares) = (0.0, 0.0);
        for (run, s) in runs.iter().zip(sums) {
            let (before, explained) = (s.before / s.rows, (s.before - s.after) / s.rows);
            for block in &self.problem.blocks[run.clone()] {
                let residual = &self.fit.residual[block.range.clone()];
                let score: f64 = residual
                    .iter()
                    .zip(&added[block.range.clone()])
                    .map(|(r, a)| (r - before) * (a - explained))
                    .sum();
                total += score;
                squares += score * score;
            }
        }
        if squares > 0.0 {
            stats::normal_tail(total / squares.sqrt())
        } else {
            1.0
        }
    }
}

/// Sums over the rows of one sequence.
#[derive(Debug, Clone, Copy)]
pub(super) struct Means {
    rows: f64,
    before: f64,
    after: f64,
    /// Fall of the squared error.
    fall: f64,
}

impl Means {
    /// Of the residual, of which a form explains `added`.
    fn new(residual: &[f64], added: &[f64]) -> Means {
        let mut out = Means {
            rows: residual.len() as f64,
            before: 0.0,
            after: 0.0,
            fall: 0.0,
        };
        for (r, a) in residual.iter().zip(added) {
            out.before += r;
            out.after += r - a;
            out.fall += r * r - (r - a) * (r - a);
        }
        out
    }
}

/// Sums over the rows of each sequence, of a residual of which a form explains `added`.
pub(super) fn means_of(residual: &[f64], added: &[f64], rows: &[Range<usize>]) -> Vec<Means> {
    rows.iter()
        .map(|rows| Means::new(&residual[rows.clone()], &added[rows.clone()]))
        .collect()
}

/// Fall of the squared error in the means of the sequences.
fn fall_between(sequences: &[Means]) -> f64 {
    let fall = |s: &Means| (s.before * s.before - s.after * s.after) / s.rows;
    sequences.iter().map(fall).sum()
}

/// Whether most of what a form explains is in the means of the sequences.
pub(super) fn mostly_between(sequences: &[Means]) -> bool {
    let whole: f64 = sequences.iter().map(|s| s.fall).sum();
    fall_between(sequences) > MOSTLY * whole
}

/// Kish's effective number of sequences, and the p value of the fall in their means by `parameters`
/// parameters where `fitted` are fitted to them in all; `None` where most of the fall is within
/// sequences.
fn p_of_means(sequences: &[Means], parameters: usize, fitted: f64) -> Option<(f64, f64)> {
    let total = |f: &dyn Fn(&Means) -> f64| sequences.iter().map(f).sum::<f64>();
    let rows = total(&|s| s.rows);
    let count = rows * rows / total(&|s| s.rows * s.rows).max(1.0);
    if !mostly_between(sequences) {
        return None;
    }
    let after = total(&|s| s.after * s.after / s.rows);
    let parameters = parameters.max(1) as f64;
    let freedom = count - fitted;
    let p = if freedom < 0.99 {
        1.0
    } else {
        let f = (fall_between(sequences) / parameters) / (after / freedom);
        stats::f_tail(f, parameters, freedom)
    };
    Some((count, p))
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_columns::stats::Rng;

    /// Sequences of `rows` rows with a zero that differs from one to the next by `scatter`, and a
    /// line of `slope` over a temperature that is another in each, fitted with its intercept.
    fn p(slope: f64, scatter: f64, within: f64, seed: u64) -> Option<f64> {
        let mut rng = Rng::new(seed);
        let rows: Vec<Vec<(f64, f64)>> = (0..6)
            .map(|_| {
                let (degrees, zero) = (10.0 * rng.normal(), scatter * rng.normal());
                (0..400)
                    .map(|_| {
                        let t = degrees + within * rng.normal();
                        (t, slope * t + zero + rng.normal())
                    })
                    .collect()
            })
            .collect();
        let all: Vec<(f64, f64)> = rows.iter().flatten().copied().collect();
        let n = all.len() as f64;
        let (mx, my) = all
            .iter()
            .fold((0.0, 0.0), |m, v| (m.0 + v.0 / n, m.1 + v.1 / n));
        let sxy: f64 = all.iter().map(|v| (v.0 - mx) * (v.1 - my)).sum();
        let sxx: f64 = all.iter().map(|v| (v.0 - mx) * (v.0 - mx)).sum();
        let sums: Vec<Means> = rows
            .iter()
            .map(|sequence| {
                let (x, y): (Vec<f64>, Vec<f64>) = sequence.iter().copied().unzip();
                let line: Vec<f64> = x.iter().map(|x| my + sxy / sxx * (x - mx)).collect();
                Means::new(&y, &line)
            })
            .collect();
        Some(p_of_means(&sums, 2, 2.0)?.1)
    }

    #[test]
    fn zeros_that_differ_by_chance_have_a_p_value_of_chance() {
        let p: Vec<f64> = (0..2000)
            .filter_map(|seed| p(0.0, 0.3, 0.01, seed))
            .collect();
        assert!(p.len() > 1900, "{}", p.len());
        for level in [0.01, 0.1, 0.5] {
            let below = p.iter().filter(|p| **p < level).count();
            let share = below as f64 / p.len() as f64;
            let error = 4.0 * (level * (1.0 - level) / p.len() as f64).sqrt();
            assert!((share - level).abs() < error, "{share} at {level}");
        }
    }

    #[test]
    fn a_line_over_the_temperature_is_sure() {
        for seed in 0..20 {
            let p = p(0.2, 0.05, 0.01, seed);
            assert!(p.is_some_and(|p| p < 1e-3), "{p:?}");
        }
    }

    #[test]
    fn a_line_that_each_sequence_shows_needs_no_others() {
        assert_eq!(p(1.0, 0.3, 30.0, 1), None);
    }

    #[test]
    fn as_many_parameters_as_sequences_show_nothing() {
        let s = |before, rows| Means {
            rows,
            before,
            after: 0.0,
            fall: 1.0,
        };
        let equal = [s(10.0, 100.0), s(-10.0, 100.0), s(12.0, 100.0)];
        assert_eq!(p_of_means(&equal, 3, 3.0), Some((3.0, 1.0)));
        // Two of them are the declared model's.
        assert_eq!(p_of_means(&equal, 1, 3.0), Some((3.0, 1.0)));
        // Short sequences beside a long one are hardly any.
        let unequal = [s(1e3, 6000.0), s(-1e3, 500.0), s(1e3, 500.0)];
        assert!(p_of_means(&unequal, 1, 1.0).is_some_and(|(n, p)| n < 1.5 && p == 1.0));
    }
}
