//! Sine and cosine of many numbers, four at once: ripples and tones are most of what a scan
//! evaluates.

use wide::f64x4;

/// Up to here the vector functions reduce an angle to a quarter turn without loss, rad. Beyond it,
/// and for what is not a number, the standard library's are used.
const LARGEST: f64 = 1e7;

fn each(values: &mut [f64], one: impl Fn(f64) -> f64, four: impl Fn(f64x4) -> f64x4) {
    let (quads, rest) = values.as_chunks_mut::<4>();
    for quad in quads {
        if quad.iter().all(|x| x.abs() < LARGEST) {
            *quad = four(f64x4::from(*quad)).to_array();
        } else {
            quad.iter_mut().for_each(|x| *x = one(*x));
        }
    }
    rest.iter_mut().for_each(|x| *x = one(*x));
}

/// Sines in place of angles in rad.
pub(super) fn sines(values: &mut [f64]) {
    each(values, f64::sin, |x| x.sin_cos().0);
}

/// Cosines in place of angles in rad.
pub(super) fn cosines(values: &mut [f64]) {
    each(values, f64::cos, |x| x.sin_cos().1);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_at_once_agree_with_the_standard_library() {
        for scale in [1e-3, 1.0, 1e3, 1e6, 9.9e6, 1e9] {
            let angles: Vec<f64> = (-501..502).map(|n| scale * f64::from(n) / 500.0).collect();
            let (mut s, mut c) = (angles.clone(), angles.clone());
            sines(&mut s);
            cosines(&mut c);
            for ((x, s), c) in angles.iter().zip(&s).zip(&c) {
                let error = (s - x.sin()).abs().max((c - x.cos()).abs());
                assert!(error < 4e-16, "{x}: {error}");
            }
        }
    }

    #[test]
    fn what_is_no_number_stays_none() {
        let mut values = [0.5, f64::NAN, f64::INFINITY, 1.0, f64::NEG_INFINITY];
        sines(&mut values);
        assert_eq!(values[0], 0.5f64.sin());
        assert!([1, 2, 4].iter().all(|i| values[*i].is_nan()));
    }
}
