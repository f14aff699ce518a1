//! From a fitted cell to the numbers of a conversion: force `n c + m c^2` of a code `c` above the
//! zero.
//!
//! The fit has the code over the force, a conversion needs the force over the code. The inverse of
//! a parabola is none; the conversion is the parabola through 0 that is nearest to it over the
//! range that was calibrated. For a cell that bends by 0.01 /N, what that leaves is below 10 mN up
//! to 10 N.

use super::{Gain, Term};

/// Points of the range at which the parabola is fitted.
const POINTS: usize = 64;

/// A conversion with its standard uncertainties.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conversion {
    /// Scale at no load, N per code.
    pub n_per_code: f64,
    /// Quadratic term, N per code^2; 0 for a straight cell.
    pub n_per_code2: f64,
    /// Standard uncertainty of [`Self::n_per_code2`], N per code^2.
    pub n_per_code2_sd: f64,
}

impl Gain {
    /// The conversion of this cell over the range that was calibrated.
    #[must_use]
    pub fn conversion(&self) -> Conversion {
        let straight = Conversion {
            n_per_code: self.n_per_code,
            n_per_code2: 0.0,
            n_per_code2_sd: 0.0,
        };
        let Some(curve) = self.terms.get(&Term::Quadratic) else {
            return straight;
        };
        let code = |force: f64| self.codes_per_n * force + curve.value * force * force;
        let [mut s2, mut s3, mut s4, mut y1, mut y2] = [0.0; 5];
        for i in 1..=POINTS {
            let force = self.largest_n * i as f64 / POINTS as f64;
            // In units of the largest code, so that the sums keep their digits.
            let c = code(force) / code(self.largest_n);
            s2 += c * c;
            s3 += c * c * c;
            s4 += c * c * c * c;
            y1 += c * force;
            y2 += c * c * force;
        }
        let determinant = s2 * s4 - s3 * s3;
        let top = code(self.largest_n);
        let slope = (y1 * s4 - y2 * s3) / determinant / top;
        let bend = (y2 * s2 - y1 * s3) / determinant / (top * top);
        if !(slope.is_finite() && bend.is_finite()) {
            return straight;
        }
        Conversion {
            n_per_code: slope,
            n_per_code2: bend,
            n_per_code2_sd: (bend * curve.standard_error / curve.value).abs(),
        }
    }
}
