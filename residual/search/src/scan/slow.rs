//! Slow forms against slow noise: what a form adds that hardly changes within a sequence is
//! compared with the noise at its own frequencies.
//!
//! Decoys cannot show this: their signs change from block to block, so they are white at periods
//! longer than a block. The zero of a sensor often wanders instead (noise of 1/f), and over a few
//! sequences a wander can look like a creep or a warming.

use super::between::{means_of, mostly_between, FEWEST_MEANS};
use super::Scan;
use residual_columns::fourier::{Complex, Planner};
use residual_columns::stats;
use residual_effects::Variant;
use std::ops::Range;

/// Cells into which the longest sequence is cut, about: slow forms need no more.
const CELLS: usize = 1024;

/// Fewest cells of a sequence that has a spectrum.
const FEWEST: usize = 16;

/// Lowest frequencies of a sequence: half a period of what is in them is a quarter of the sequence
/// or more.
const LOWEST: usize = 2;

/// Share of its power within sequences in the lowest frequencies from which on a form is slow.
const SLOW: f64 = 0.5;

/// Ratio of the ends of the two lowest bands whose powers show how the noise falls with the
/// frequency.
const BAND: f64 = 3.0;

/// Most of what a form varies in sequences without a spectrum, over what it varies in those with
/// one.
const SHORT: f64 = 0.1;

/// Fewest lines of the spectrum that the noise at a frequency is taken from.
const LINES: usize = 4;

impl Scan<'_> {
    /// p value of what a slow form, which adds `added` to the prediction, explains within
    /// sequences: an F test against the noise at its frequencies. `None` for a form that is not
    /// slow, where sequences are too short to tell, and for two logs in whose means the evidence
    /// is.
    pub fn against_slow_noise(&self, variant: &Variant, added: &[f64]) -> Option<f64> {
        if added.len() != self.fit.residual.len() {
            return None;
        }
        let tried = variant.psi.as_ref().map_or(1, |psi| psi.grid.len());
        let rows = self.problem.rows_of_runs();
        if rows.len() < FEWEST_MEANS && mostly_between(&means_of(&self.fit.residual, added, &rows))
        {
            return None;
        }
        let p = p_value(&self.fit.residual, added, &rows)?;
        Some((p * tried as f64).min(1.0))
    }
}

/// p value of what is `added` to explain a residual: how sure its direction is, so that it counts
/// as one parameter.
fn p_value(residual: &[f64], added: &[f64], rows: &[Range<usize>]) -> Option<f64> {
    let longest = rows.iter().map(|r| r.len()).max()?;
    let per_cell = (longest / CELLS).max(1);
    let (long, short): (Vec<_>, Vec<_>) = rows
        .iter()
        .cloned()
        .partition(|r| r.len() / per_cell >= FEWEST);
    let varies = |rows: &[Range<usize>]| -> f64 {
        let one = |r: &Range<usize>| stats::deviation(&added[r.clone()]).powi(2) * r.len() as f64;
        rows.iter().map(one).sum()
    };
    if varies(&short) > SHORT * varies(&long) {
        return None;
    }
    let after: Vec<f64> = residual.iter().zip(added).map(|(r, a)| r - a).collect();
    let mut planner = Planner::default();
    let mut spectra = |u: &[f64]| -> Vec<Vec<f64>> {
        long.iter()
            .map(|r| power(&mut planner, &u[r.clone()], per_cell))
            .collect()
    };
    let form = spectra(added);
    let lowest: f64 = form.iter().flat_map(|p| &p[1..=LOWEST]).sum();
    let whole: f64 = form.iter().flat_map(|p| &p[1..]).sum();
    if !whole.is_finite() || lowest <= SLOW * whole {
        return None;
    }
    let cells: Vec<usize> = long.iter().map(|r| r.len() / per_cell).collect();
    let noise = Noise::new(&spectra(&after), &cells);
    let (mut variance, mut heaviest, mut count) = (0.0, 0.0, 0);
    for (p, cells) in form.iter().zip(cells) {
        for (k, p) in p.iter().enumerate().skip(1) {
            let (density, lines) = noise.at(k as f64 / cells as f64)?;
            let part = 2.0 * p * density;
            variance += part;
            if part > heaviest {
                (heaviest, count) = (part, lines);
            }
        }
    }
    let score: f64 = long
        .iter()
        .map(|r| {
            let cells = |u: &[f64]| means(&u[r.clone()], per_cell).collect::<Vec<f64>>();
            let (r, a) = (cells(residual), cells(added));
            let m = stats::mean(&a);
            r.iter().zip(&a).map(|(r, a)| r * (a - m)).sum::<f64>()
        })
        .sum();
    if score <= 0.0 {
        return Some(1.0);
    }
    // The form itself has taken one degree of freedom of the noise.
    let (all, freedom) = ((2 * count) as f64, (2 * count) as f64 - 1.0);
    let f = score * score / (variance * all / freedom);
    Some(stats::f_tail(f, 1.0, freedom))
}

/// Means of cells of so many rows.
fn means(u: &[f64], rows: usize) -> impl Iterator<Item = f64> + '_ {
    u.chunks_exact(rows).map(stats::mean)
}

/// Power of a sequence over its cells, at 0 to half a cycle per cell: the squared amplitude over
/// the number of cells.
fn power(planner: &mut Planner, u: &[f64], per_cell: usize) -> Vec<f64> {
    let mut buffer: Vec<Complex<f64>> = means(u, per_cell).map(|m| Complex::new(m, 0.0)).collect();
    let n = buffer.len();
    planner.forward(n).process(&mut buffer);
    buffer[..=n / 2]
        .iter()
        .map(|z| z.norm_sqr() / n as f64)
        .collect()
}

/// Density of the noise over frequency: a power of the frequency within two octaves, so that the
/// lowest lines of a slow noise, which have higher neighbours only, are not taken for lower than
/// they are.
struct Noise {
    /// Cycles per cell, in order.
    frequency: Vec<f64>,
    /// The density falls with the frequency to this power.
    slope: f64,
    /// Sum of the power times the frequency to `slope` up to each frequency, 0 first.
    sum: Vec<f64>,
}

impl Noise {
    fn new(spectra: &[Vec<f64>], cells: &[usize]) -> Noise {
        let mut all: Vec<(f64, f64)> = spectra
            .iter()
            .zip(cells)
            .flat_map(|(p, cells)| {
                let lines = p.iter().enumerate().skip(1);
                lines.map(move |(k, p)| (k as f64 / *cells as f64, *p))
            })
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let lowest = all.first().map_or(0.0, |(f, _)| *f);
        let band = |lines: Range<f64>| {
            let inside = all.iter().filter(|(f, _)| lines.contains(f));
            let power: Vec<f64> = inside.map(|(_, p)| *p).collect();
            stats::mean(&power)
        };
        // Two bands of equal ratio; a filter's slope at most.
        let ratio = band(lowest..BAND * lowest) / band(BAND * lowest..BAND * BAND * lowest);
        let slope = ratio.ln() / BAND.ln();
        let slope = if slope.is_finite() {
            slope.clamp(0.0, 2.0)
        } else {
            0.0
        };
        let mut sum = vec![0.0];
        for (i, (f, p)) in all.iter().enumerate() {
            sum.push(sum[i] + p * f.powf(slope));
        }
        Noise {
            frequency: all.into_iter().map(|(f, _)| f).collect(),
            slope,
            sum,
        }
    }

    /// Density at a frequency and the number of lines in it: those from half to twice the
    /// frequency, with so many above them that they are not too few.
    fn at(&self, frequency: f64) -> Option<(f64, usize)> {
        let first = self.frequency.partition_point(|f| *f < 0.5 * frequency);
        let end = self.frequency.partition_point(|f| *f <= 2.0 * frequency);
        let end = end.max(first + LINES).min(self.frequency.len());
        let count = end.checked_sub(first).filter(|count| *count > 0)?;
        let mean = (self.sum[end] - self.sum[first]) / count as f64;
        Some((mean / frequency.powf(self.slope), count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_columns::stats::Rng;

    const ROWS_OF_ONE: usize = 3000;

    /// Noise of 1/f about: the sum of filtered noises with memories of 4 to 4096 rows, of equal
    /// size, and white noise.
    fn wandering(rng: &mut Rng) -> Vec<f64> {
        let mut states: Vec<(f64, f64)> = (0..6)
            .map(|k| ((-0.25 / 4f64.powi(k)).exp(), rng.normal()))
            .collect();
        (0..ROWS_OF_ONE)
            .map(|_| {
                for (keep, x) in &mut states {
                    *x = *keep * *x + (1.0 - *keep * *keep).sqrt() * rng.normal();
                }
                states.iter().map(|s| s.1).sum::<f64>() + rng.normal()
            })
            .collect()
    }

    /// p value of a form fitted with an offset to noise in some sequences and `size` of the form
    /// itself.
    fn p(
        noise: impl Fn(&mut Rng) -> Vec<f64>,
        form: impl Fn(f64, usize) -> f64,
        size: f64,
        runs: usize,
        seed: u64,
    ) -> Option<f64> {
        let mut rng = Rng::new(seed);
        let (mut x, mut y, mut rows) = (vec![], vec![], vec![]);
        for run in 0..runs {
            let first = x.len();
            for (i, n) in noise(&mut rng).into_iter().enumerate() {
                let v = form(i as f64 / ROWS_OF_ONE as f64, run);
                x.push(v);
                y.push(n + size * v);
            }
            rows.push(first..x.len());
        }
        let (mx, my) = (stats::mean(&x), stats::mean(&y));
        let sxy: f64 = x.iter().zip(&y).map(|(x, y)| (x - mx) * (y - my)).sum();
        let sxx: f64 = x.iter().map(|x| (x - mx).powi(2)).sum();
        let residual: Vec<f64> = y.iter().map(|y| y - my).collect();
        let added: Vec<f64> = x.iter().map(|x| sxy / sxx * (x - mx)).collect();
        p_value(&residual, &added, &rows)
    }

    /// What warms, with another sign in each sequence.
    fn warming(t: f64, run: usize) -> f64 {
        (1.0 + run as f64) * (-1f64).powi(run as i32) * (1.0 - (-3.0 * t).exp())
    }

    #[test]
    fn a_wander_that_looks_like_warming_has_a_p_value_of_chance() {
        let white =
            |rng: &mut Rng| -> Vec<f64> { (0..ROWS_OF_ONE).map(|_| rng.normal()).collect() };
        let shares = |p: &dyn Fn(u64) -> Option<f64>| {
            let all: Vec<f64> = (0..400).filter_map(p).collect();
            assert!(all.len() > 300, "{}", all.len());
            [0.01, 0.1, 0.5]
                .map(|l| all.iter().filter(|p| **p < l).count() as f64 / all.len() as f64)
        };
        // One log has so few slow lines that its density is uncertain.
        for (runs, most) in [(1, 0.08), (2, 0.03), (5, 0.03)] {
            let slow = shares(&|seed| p(wandering, warming, 0.0, runs, seed));
            assert!(
                slow[0] <= most && slow[1] <= 0.3 && slow[2] <= 0.7,
                "{runs}: {slow:?}"
            );
            let white = shares(&|seed| p(white, warming, 0.0, runs, seed));
            assert!(white[0] <= 0.03 && white[1] <= 0.15, "{runs}: {white:?}");
            assert!((0.2..0.6).contains(&white[2]), "{runs}: {white:?}");
        }
    }

    #[test]
    fn warming_above_the_wander_is_sure() {
        for seed in 0..20 {
            let p = p(wandering, warming, 3.0, 5, seed);
            assert!(p.is_some_and(|p| p < 1e-3), "{p:?} at {seed}");
        }
    }

    #[test]
    fn a_form_that_is_fast_is_not_tested() {
        let fast = |t: f64, _: usize| (60.0 * t).sin();
        assert_eq!(p(wandering, fast, 1.0, 5, 1), None);
    }

    #[test]
    fn sequences_too_short_for_a_spectrum_are_not_tested() {
        let rows: Vec<Range<usize>> = (0..100).map(|k| 10 * k..10 * k + 10).collect();
        let u: Vec<f64> = (0..1000).map(|i| (f64::from(i) / 300.0).sin()).collect();
        assert_eq!(p_value(&u, &u, &rows), None);
        assert_eq!(p_value(&[], &[], &[]), None);
    }
}
