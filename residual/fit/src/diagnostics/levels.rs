//! A slow part that goes back and forth between levels and is smaller than the noise.
//!
//! No single block mean shows the levels then. Two things do together. The spectrum has a hump:
//! noise of sensors (white, filtered, 1/f) has no more power at a frequency than below it. And the
//! slow part is flatter than normal noise with the same spectrum. Noise with the same spectrum is
//! made from random phases, so the two are independent without levels, and Fisher's method
//! combines them.

use residual_columns::fourier::{Complex, Planner};
use residual_columns::frame::Frame;
use residual_columns::stats::{self, Rng};
use std::ops::Range;

/// p value of both together from which on they count. An analysis asks once.
const SURE: f64 = 1e-3;

/// p value of the flatness alone from which on they count: a hump alone may be a resonance.
const FLAT: f64 = 0.05;

/// Fewest rows, or cells, of a sequence that has a spectrum.
const FEWEST: usize = 64;

/// Line of a sequence at which the lowest band begins: power of fewer lines below is uncertain.
const LOWEST: usize = 4;

/// Ratio of the ends of a band, and of the beginnings of neighbouring bands.
const BAND: usize = 2;
const STEP: f64 = std::f64::consts::SQRT_2;

/// Ends of the slow part and of the lines that show the level of the fast noise, over the beginning
/// of the band: a hump of levels reaches an octave above its own band.
const SLOW: usize = 4;
const FAST: [usize; 2] = [8, 16];

/// Cells in a period of the beginning of the band, and windows over which they are averaged: a
/// twenty-seventh to a fifth of a period. Levels stay in them, and fast noise does not.
const CELLS: f64 = 80.0;
const WINDOWS: [usize; 4] = [3, 5, 9, 15];

/// Robust sizes beyond which a value is cut: one outlier is no level.
const CUT: f64 = 4.0;

/// Most cells that are compared, and noises with the same spectrum.
const MOST_CELLS: usize = 60_000;
const NOISES: usize = 64;

/// A slow part with levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levels {
    /// Share of the variance in the slow part.
    pub share: f64,
    /// Where most of it is, in cycles per row.
    pub between: (f64, f64),
    /// p value of both together.
    pub p: f64,
}

/// Looks for a slow part with levels of at least `share` of the variance.
pub fn levels(r: &[f64], frame: &Frame, share: f64) -> Option<Levels> {
    let all: Vec<&[f64]> = frame.sequences().iter().map(|s| &r[s.clone()]).collect();
    let hump = hump(&all)?;
    if hump.share < share || hump.share.is_nan() {
        return None;
    }
    let flat = flatness(&all, hump.between.0)?;
    let both = (hump.p * flat).max(f64::MIN_POSITIVE);
    // Upper tail of chi-square with four degrees of freedom at -2 ln of the product.
    let p = both * (1.0 - both.ln());
    (p < SURE && flat < FLAT).then_some(Levels { p, ..hump })
}

/// The band that has surely more power than all lines below it; its p value counts all bands.
fn hump(sequences: &[&[f64]]) -> Option<Levels> {
    let mut planner = Planner::default();
    let mut lines = Vec::new();
    let mut count = 0;
    for s in sequences.iter().filter(|s| s.len() >= FEWEST) {
        count += 1;
        let z = spectrum(&mut planner, s);
        let n = s.len() as f64;
        let half = &z[1..s.len().div_ceil(2)];
        let line = |(k, z): (usize, &Complex<f64>)| ((k + 1) as f64 / n, z.norm_sqr() / n);
        lines.extend(half.iter().enumerate().map(line));
    }
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut sums = vec![0.0];
    sums.extend(lines.iter().scan(0.0, |sum, (_, power)| {
        *sum += power;
        Some(*sum)
    }));
    let total = *sums.last()?;
    let over = |r: Range<usize>| (sums[r.end] - sums[r.start]) / r.len() as f64;
    let mut best: Option<Levels> = None;
    let (mut at, mut tried) = ((LOWEST * count) as f64, 0);
    while count > 0 && (at as usize) * FAST[0] < lines.len() {
        let a = at as usize;
        let band = a..BAND * a;
        let ratio = over(band.clone()) / over(0..a);
        let p = stats::f_tail(ratio, (2 * band.len()) as f64, (2 * a) as f64);
        if best.is_none_or(|b| p < b.p) {
            let fast = over(FAST[0] * a..(FAST[1] * a).min(lines.len()));
            best = Some(Levels {
                share: (sums[SLOW * a] - (SLOW * a) as f64 * fast) / total,
                between: (lines[a].0, lines[band.end - 1].0),
                p,
            });
        }
        tried += 1;
        at *= STEP;
    }
    best.map(|b| Levels {
        p: (b.p * f64::from(tried)).min(1.0),
        ..b
    })
}

/// p value of how much flatter than normal noise the slow part is whose spectrum has a hump from
/// the frequency `from` on.
fn flatness(sequences: &[&[f64]], from: f64) -> Option<f64> {
    let rows = ((1.0 / (CELLS * from)).round() as usize).max(1);
    let mut cells: Vec<Vec<f64>> = Vec::new();
    let mut count = 0;
    for s in sequences {
        let own: Vec<f64> = s.chunks_exact(rows).map(stats::mean).collect();
        if own.len() >= FEWEST && (count == 0 || count + own.len() <= MOST_CELLS) {
            count += own.len();
            let m = stats::mean(&own);
            cells.push(own.into_iter().map(|x| x - m).collect());
        }
    }
    if cells.is_empty() {
        return None;
    }
    let mut planner = Planner::default();
    let spectra: Vec<Vec<Complex<f64>>> = cells.iter().map(|c| spectrum(&mut planner, c)).collect();
    let mut rng = Rng::new(count as u64);
    let noises: Vec<[f64; WINDOWS.len()]> = (0..NOISES)
        .map(|_| {
            let noise: Vec<Vec<f64>> = spectra
                .iter()
                .map(|s| with_phases(&mut planner, s, &mut rng))
                .collect();
            flat(&noise)
        })
        .collect();
    let found = flat(&cells);
    let (mut z, mut own) = (0.0, vec![0.0; NOISES]);
    for (k, found) in found.into_iter().enumerate() {
        let values: Vec<f64> = noises.iter().map(|n| n[k]).collect();
        let (m, d) = (stats::mean(&values), stats::deviation(&values));
        if d > 0.0 {
            z += (found - m) / d;
            own.iter_mut()
                .zip(values)
                .for_each(|(o, v)| *o += (v - m) / d);
        }
    }
    let error = stats::deviation(&own);
    (error > 0.0).then(|| stats::normal_tail(z / error))
}

/// For each window, the mean size of what is averaged over it, over its deviation: 1 for two
/// levels, 0.80 for normal noise.
fn flat(cells: &[Vec<f64>]) -> [f64; WINDOWS.len()] {
    WINDOWS.map(|width| {
        let weight: Vec<f64> = (1..=width)
            .map(|i| {
                let x = std::f64::consts::PI * i as f64 / (width + 1) as f64;
                x.sin().powi(2)
            })
            .collect();
        let mut y: Vec<f64> = cells
            .iter()
            .flat_map(|c| {
                c.windows(width)
                    .map(|w| w.iter().zip(&weight).map(|(x, w)| x * w).sum::<f64>())
            })
            .collect();
        let m = stats::mean(&y);
        let mut sizes: Vec<f64> = y.iter().map(|y| (y - m).abs()).collect();
        // 0.6745 of the deviation of normal noise is its median size.
        let cut = CUT * stats::median(&mut sizes).unwrap_or(0.0) / 0.6745;
        y.iter_mut().for_each(|y| *y = (*y - m).clamp(-cut, cut));
        let size = stats::rms(&y);
        let mean = y.iter().map(|y| y.abs()).sum::<f64>() / y.len().max(1) as f64;
        if size > 0.0 {
            mean / size
        } else {
            0.0
        }
    })
}

/// All lines of a sequence less its mean.
fn spectrum(planner: &mut Planner, s: &[f64]) -> Vec<Complex<f64>> {
    let m = stats::mean(s);
    let mut z: Vec<Complex<f64>> = s.iter().map(|x| Complex::new(x - m, 0.0)).collect();
    planner.forward(z.len()).process(&mut z);
    z
}

/// Normal noise with these powers.
fn with_phases(planner: &mut Planner, s: &[Complex<f64>], rng: &mut Rng) -> Vec<f64> {
    let n = s.len();
    let mut z = vec![Complex::new(0.0, 0.0); n];
    for k in 1..n.div_ceil(2) {
        let turned = Complex::from_polar(s[k].norm(), std::f64::consts::TAU * rng.uniform());
        z[k] = turned;
        z[n - k] = turned.conj();
    }
    if n.is_multiple_of(2) {
        z[n / 2] = s[n / 2] * rng.sign();
    }
    planner.inverse(n).process(&mut z);
    z.iter().map(|z| z.re / n as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 3200;
    const SEQUENCES: usize = 6;

    fn frame() -> Frame {
        let n = ROWS * SEQUENCES;
        let time = (0..n).map(|i| i as f64 * 0.02).collect();
        let sequences = (0..SEQUENCES).map(|k| k * ROWS..(k + 1) * ROWS).collect();
        Frame::new(vec![], time, sequences)
    }

    /// White noise with a part that forgets within five rows, as a filter makes it.
    fn noise(rng: &mut Rng) -> Vec<f64> {
        let mut slow = 0.0;
        (0..ROWS * SEQUENCES)
            .map(|_| {
                slow = 0.82 * slow + 0.25 * rng.normal();
                0.89 * rng.normal() + slow
            })
            .collect()
    }

    /// Levels of 0.3 that change each 40 to 190 rows.
    fn level(rng: &mut Rng) -> Vec<f64> {
        let (mut level, mut left) = (0.3, 0.0);
        (0..ROWS * SEQUENCES)
            .map(|_| {
                if left <= 0.0 {
                    level = -level;
                    left = 40.0 + 150.0 * rng.uniform();
                }
                left -= 1.0;
                level
            })
            .collect()
    }

    /// White noise, smoothed over a band: a resonance.
    fn resonance(rng: &mut Rng) -> Vec<f64> {
        let (mut a, mut b) = (0.0, 0.0);
        let mut out: Vec<f64> = (0..ROWS * SEQUENCES)
            .map(|_| {
                let next = 1.93 * a - 0.95 * b + rng.normal();
                (a, b) = (next, a);
                next
            })
            .collect();
        let size = stats::rms(&out);
        out.iter_mut().for_each(|x| *x *= 0.3 / size);
        out
    }

    fn found(seed: u64, add: impl Fn(&mut Rng) -> Vec<f64>) -> bool {
        let mut rng = Rng::new(seed);
        let r = noise(&mut rng);
        let more = add(&mut rng);
        let r: Vec<f64> = r.iter().zip(more).map(|(r, m)| r + m).collect();
        levels(&r, &frame(), 0.04).is_some()
    }

    #[test]
    fn levels_below_the_noise_are_found() {
        let seen = (0..10).filter(|seed| found(*seed, level)).count();
        assert!(seen >= 8, "{seen} of 10");
    }

    #[test]
    fn noise_and_resonances_have_no_levels() {
        let none = |_: &mut Rng| vec![0.0; ROWS * SEQUENCES];
        assert_eq!((0..20).filter(|seed| found(*seed, none)).count(), 0);
        let seen = (0..20).filter(|seed| found(*seed, resonance)).count();
        assert!(seen <= 2, "{seen} of 20");
        // Much slow noise of the first order.
        let slow = |rng: &mut Rng| {
            let mut x = 0.0;
            (0..ROWS * SEQUENCES)
                .map(|_| {
                    x = 0.99 * x + 0.1 * rng.normal();
                    x
                })
                .collect()
        };
        assert_eq!((0..20).filter(|seed| found(*seed, slow)).count(), 0);
    }

    #[test]
    fn short_and_constant_rows_show_nothing() {
        let few = Frame::new(vec![], vec![0.0, 1.0, 2.0], std::iter::once(0..3).collect());
        assert_eq!(levels(&[1.0, 2.0, 3.0], &few, 0.0), None);
        assert_eq!(levels(&[0.5; ROWS * SEQUENCES], &frame(), 0.0), None);
    }
}
