//! The publication's filter: a Butterworth low-pass of order 3 at 50 Hz, run forwards and
//! backwards, and a smooth derivative.

use crate::data::RATE_HZ;
use std::f64::consts::PI;

/// Corner of the low-pass, Hz.
pub const CORNER_HZ: f64 = 50.0;

/// A stage of second order in the transposed direct form.
#[derive(Debug, Clone, Copy)]
struct Stage {
    b: [f64; 3],
    a: [f64; 2],
}

impl Stage {
    /// Filters in place, from the rest state of the first value.
    fn run(&self, values: &mut [f64]) {
        let Some(&first) = values.first() else { return };
        // Unit gain at zero frequency: at rest output and input are the first value.
        let mut s2 = (self.b[2] - self.a[1]) * first;
        let mut s1 = (self.b[1] - self.a[0]) * first + s2;
        for value in values {
            let x = *value;
            let y = self.b[0] * x + s1;
            s1 = self.b[1] * x - self.a[0] * y + s2;
            s2 = self.b[2] * x - self.a[1] * y;
            *value = y;
        }
    }
}

/// Poles of the analogue prototype 1 / ((s + 1) (s² + s + 1)), carried over by the bilinear
/// transform with a prewarped corner.
fn stages() -> [Stage; 2] {
    let k = (PI * CORNER_HZ / RATE_HZ).tan();
    let first = 1.0 + k;
    let second = 1.0 + k + k * k;
    [
        Stage {
            b: [k / first, k / first, 0.0],
            a: [(k - 1.0) / first, 0.0],
        },
        Stage {
            b: [k * k / second, 2.0 * k * k / second, k * k / second],
            a: [2.0 * (k * k - 1.0) / second, (1.0 - k + k * k) / second],
        },
    ]
}

/// Filters forwards and backwards: no phase, and every value knows the future. The ends within 50
/// ms are not to be used.
#[must_use]
pub fn zero_phase(values: &[f64]) -> Vec<f64> {
    let mut out = values.to_vec();
    for _ in 0..2 {
        for stage in stages() {
            stage.run(&mut out);
        }
        out.reverse();
    }
    out
}

/// Derivative over eleven values, exact for polynomials up to order 4 (Holoborodko's smooth
/// noise-robust differentiator, the publication's choice), per second. The five values at each end
/// take the nearest full one.
#[must_use]
pub fn derivative(values: &[f64]) -> Vec<f64> {
    const WEIGHTS: [f64; 5] = [322.0, 256.0, 39.0, -32.0, -11.0];
    let reach = WEIGHTS.len();
    let n = values.len();
    if n <= 2 * reach {
        return vec![0.0; n];
    }
    let at = |row: usize| {
        let sum: f64 = (1..=reach)
            .map(|d| WEIGHTS[d - 1] * (values[row + d] - values[row - d]))
            .sum();
        sum / 1536.0 * RATE_HZ
    };
    (0..n)
        .map(|row| at(row.clamp(reach, n - 1 - reach)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(hz: f64) -> Vec<f64> {
        (0..4000)
            .map(|n| (2.0 * PI * hz * f64::from(n) / RATE_HZ).sin())
            .collect()
    }

    #[test]
    fn the_corner_loses_half_and_low_frequencies_pass_without_phase() {
        // Forwards and backwards: the power 1/2 of one pass is the amplitude of two.
        for (hz, gain) in [(50.0, 0.5), (2.0, 1.0)] {
            let (x, y) = (sine(hz), zero_phase(&sine(hz)));
            let middle = 1000..3000;
            let product: f64 = middle.clone().map(|n| x[n] * y[n]).sum();
            let power: f64 = middle.map(|n| x[n] * x[n]).sum();
            assert!(
                (product / power - gain).abs() < 2e-3,
                "{hz}: {}",
                product / power
            );
        }
    }

    #[test]
    fn a_constant_stays_and_the_derivative_of_a_polynomial_is_exact() {
        assert!(zero_phase(&[2.5; 300])
            .iter()
            .all(|y| (y - 2.5).abs() < 1e-12));
        let t = |n: i32| f64::from(n) / RATE_HZ;
        let cubic: Vec<f64> = (0..100).map(|n| t(n).powi(3)).collect();
        for n in 5..95 {
            assert!((derivative(&cubic)[n as usize] - 3.0 * t(n).powi(2)).abs() < 1e-9);
        }
    }
}
