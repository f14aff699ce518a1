//! Evidence that lies between sequences: an effect that acts in the means of the sequences has as many observations as there are
//! sequences, however many rows and blocks these have.

use super::Scan;
use crate::effects::Variant;
use crate::stats;

/// Share of what a form explains from which on the means of the sequences are the evidence for it.
const MOSTLY: f64 = 0.5;

/// Fewest sequences whose scatter says anything. Two logs at two loads show a gain, and nothing against it.
const FEWEST: f64 = 2.5;

impl Scan<'_> {
    /// p value of a form at `psi` by the means of the sequences alone, by an F test; `None` where most of what it explains is within
    /// sequences, or where there are two sequences or fewer. 1 where there are no more sequences than parameters.
    ///
    /// Decoys can't show this: their signs change from block to block, so the mean of a decoy over a sequence is near zero, while
    /// the zero of a sensor often differs from one sequence to the next.
    pub fn between_sequences(&self, variant: &Variant, psi: f64) -> Option<f64> {
        let added = self.added(variant, psi);
        if added.len() != self.fit.residual.len() {
            return None;
        }
        let mut sums: Vec<Means> = Vec::new();
        let mut last = usize::MAX;
        for block in &self.problem.blocks {
            if block.sequence != last {
                sums.push(Means::default());
                last = block.sequence;
            }
            let Some(own) = sums.last_mut() else { continue };
            let residual = &self.fit.residual[block.range.clone()];
            for (r, a) in residual.iter().zip(&added[block.range.clone()]) {
                own.add(*r, *a);
            }
        }
        p_of_means(&sums, variant.parameters(psi))
    }
}

/// Sums over the rows of one sequence.
#[derive(Debug, Clone, Copy, Default)]
struct Means {
    rows: f64,
    before: f64,
    after: f64,
    /// Fall of the squared error.
    fall: f64,
}

impl Means {
    /// A row with the residual `r`, of which a form explains `a`.
    fn add(&mut self, r: f64, a: f64) {
        self.rows += 1.0;
        self.before += r;
        self.after += r - a;
        self.fall += r * r - (r - a) * (r - a);
    }
}

/// p value of the fall in the means of sequences by `parameters` parameters. Short sequences count for less: the number of
/// sequences is Kish's effective one.
fn p_of_means(sequences: &[Means], parameters: usize) -> Option<f64> {
    let total = |f: &dyn Fn(&Means) -> f64| sequences.iter().map(f).sum::<f64>();
    let rows = total(&|s| s.rows);
    let count = rows * rows / total(&|s| s.rows * s.rows).max(1.0);
    let before = total(&|s| s.before * s.before / s.rows);
    let after = total(&|s| s.after * s.after / s.rows);
    let parameters = parameters.max(1) as f64;
    let freedom = count - parameters;
    let mostly = before - after > MOSTLY * total(&|s| s.fall);
    (mostly && count >= FEWEST).then(|| match freedom {
        f if f < 1.0 => 1.0,
        _ => {
            let f = ((before - after) / parameters) / (after / freedom);
            stats::f_tail(f, parameters, freedom)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::Rng;

    /// Sequences of `rows` rows with a zero that differs from one to the next by `scatter`, and a line of `slope` over a
    /// temperature that is another in each, fitted with its intercept.
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
                let mut s = Means::default();
                for (x, y) in sequence {
                    s.add(*y, my + sxy / sxx * (x - mx));
                }
                s
            })
            .collect();
        p_of_means(&sums, 2)
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
        let s = |before| Means {
            rows: 100.0,
            before,
            after: 0.0,
            fall: 1.0,
        };
        assert_eq!(p_of_means(&[s(10.0), s(-10.0)], 2), None);
        assert_eq!(p_of_means(&[s(10.0), s(-10.0), s(12.0)], 3), Some(1.0));
    }
}
