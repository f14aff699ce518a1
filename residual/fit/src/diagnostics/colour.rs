//! The colour of a residual: an autoregression, what it leaves, and noise of the same colour from
//! shuffled innovations.

use super::correlation::autocorrelation;
use residual_columns::frame::Frame;
use residual_columns::stats::Rng;

/// Order of the autoregression: filters of sensors are of a few orders, and white noise on top
/// makes them longer.
const ORDER: usize = 16;

/// Rows before a sequence in which noise of the same colour forgets how it began.
const RUN_IN: usize = 256;

/// A residual as an autoregression on itself.
pub struct Colour {
    coefficients: Vec<f64>,
    /// What is left of each row; 0 in the first rows of a sequence.
    pub innovations: Vec<f64>,
    /// Innovations in the order in which shuffles draw them.
    pool: Vec<f64>,
}

impl Colour {
    /// Fits it over the sequences.
    pub fn new(u: &[f64], frame: &Frame) -> Colour {
        let shortest = frame.sequences().iter().map(|r| r.len()).min();
        let order = ORDER.min(shortest.unwrap_or(0) / 4);
        let coefficients = levinson(&autocorrelation(u, frame, order));
        let mut innovations = vec![0.0; u.len()];
        let mut pool = Vec::with_capacity(u.len());
        for range in frame.sequences() {
            for i in range.start + order..range.end {
                let told: f64 = coefficients
                    .iter()
                    .enumerate()
                    .map(|(k, c)| c * u[i - 1 - k])
                    .sum();
                innovations[i] = u[i] - told;
                pool.push(innovations[i]);
            }
        }
        Colour {
            coefficients,
            innovations,
            pool,
        }
    }

    /// Innovations in another order: what the values of the rows are stays, when they come does
    /// not. The frame may have fewer rows than the residual.
    pub fn shuffled(&mut self, rng: &mut Rng, frame: &Frame) -> Vec<f64> {
        self.shuffle(rng, frame.len());
        let order = self.coefficients.len();
        let mut out = vec![0.0; frame.len()];
        let mut next = self.pool.iter();
        for range in frame.sequences() {
            for (o, x) in out[range.clone()].iter_mut().skip(order).zip(&mut next) {
                *o = *x;
            }
        }
        out
    }

    /// Noise of the same colour and the same distribution. The frame may have fewer rows than the
    /// residual.
    pub fn noise(&mut self, rng: &mut Rng, frame: &Frame) -> Vec<f64> {
        self.shuffle(rng, frame.len());
        let n = self.pool.len().max(1);
        let order = self.coefficients.len();
        let mut out = Vec::with_capacity(frame.len());
        let mut next = self.pool.iter().cycle();
        for range in frame.sequences() {
            let mut own = vec![0.0; order];
            own.reserve(RUN_IN + range.len());
            for i in 0..RUN_IN + range.len() {
                let told: f64 = self
                    .coefficients
                    .iter()
                    .zip(own.iter().rev())
                    .map(|(c, x)| c * x)
                    .sum();
                let new = if i < RUN_IN {
                    self.pool.get(rng.below(n))
                } else {
                    next.next()
                };
                own.push(told + new.copied().unwrap_or(0.0));
            }
            out.extend_from_slice(&own[order + RUN_IN..]);
        }
        out
    }

    /// Draws the first `count` innovations from all (Fisher and Yates).
    fn shuffle(&mut self, rng: &mut Rng, count: usize) {
        let all = self.pool.len();
        for i in 0..count.min(all) {
            self.pool.swap(i, i + rng.below(all - i));
        }
    }
}

/// Coefficients of the autoregression with this autocorrelation (Levinson and Durbin); always
/// stable.
fn levinson(rho: &[f64]) -> Vec<f64> {
    let mut a: Vec<f64> = Vec::new();
    let mut left = rho.first().copied().unwrap_or(0.0);
    for k in 1..rho.len() {
        if left < 1e-9 {
            break;
        }
        let told: f64 = a.iter().enumerate().map(|(j, c)| c * rho[k - 1 - j]).sum();
        let reflection = (rho[k] - told) / left;
        let old = a.clone();
        for (j, c) in a.iter_mut().enumerate() {
            *c -= reflection * old[k - 2 - j];
        }
        a.push(reflection);
        left *= 1.0 - reflection * reflection;
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::coloured;
    use residual_columns::stats;

    #[test]
    fn noise_of_the_same_colour_has_the_same_size_and_correlation() {
        let n = 20_000;
        let time = (0..n).map(|i| i as f64).collect();
        let frame = Frame::new(vec![], time, vec![0..n / 2, n / 2..n]);
        let x = coloured(4, n);
        let mut colour = Colour::new(&x, &frame);
        assert!((stats::rms(&colour.innovations) - 1.0).abs() < 0.02);
        let y = colour.noise(&mut Rng::new(1), &frame);
        let of = |x: &[f64]| (stats::rms(x), autocorrelation(x, &frame, 20)[20]);
        let ((a, p), (b, q)) = (of(&x), of(&y));
        assert!((a / b - 1.0).abs() < 0.1, "{a} {b}");
        assert!((p - q).abs() < 0.1, "{p} {q}");
        let mut shuffled = colour.shuffled(&mut Rng::new(2), &frame);
        assert!(autocorrelation(&shuffled, &frame, 1)[1].abs() < 0.03);
        let mut plain = colour.innovations.clone();
        plain.sort_by(f64::total_cmp);
        shuffled.sort_by(f64::total_cmp);
        assert_eq!(plain, shuffled);
    }
}
