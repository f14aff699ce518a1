//! The size of a residual as a smooth function of columns.

use super::correlation::{autocorrelation, correlation_time, variance_of_mean};
use super::imitations::SURE;
use residual_columns::frame::Frame;
use residual_columns::parallel;
use residual_columns::stats;

/// Bins of the rows, equally many in each, between whose middles the size is linear.
const BINS: usize = 10;

/// Times that the columns are gone through, each with the sizes by the others taken out.
const ROUNDS: usize = 2;

/// Size in the loudest bins over that in the quietest from which the noise grows with a column.
const GROWS: f64 = 1.3;

/// Multiple of the usual size at which a value is cut: single outliers say nothing about it.
pub(super) const CUT: f64 = 6.0;

/// A column on which the size of the noise may depend.
#[derive(Debug, Clone)]
pub struct Along {
    /// Its name for readers.
    pub name: String,
    /// Its value at each row.
    pub values: Vec<f64>,
}

impl Along {
    /// The size of the column.
    pub fn size(&self) -> Along {
        Along {
            name: self.name.clone(),
            values: self.values.iter().map(|x| x.abs()).collect(),
        }
    }
}

/// Growth of the noise with the size of a column.
#[derive(Debug, Clone, PartialEq)]
pub struct Growth {
    /// Name of the column.
    pub name: String,
    /// Size of the noise in the fifth of the rows with the smallest values, and in that with the
    /// largest.
    pub sizes: (f64, f64),
    /// Rows of a fifth.
    pub rows: usize,
}

/// Usual size of values, whatever their tails.
pub(super) fn usual(u: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = u.iter().map(|x| x.abs()).collect();
    let middle = stats::median(&mut sizes).unwrap_or(0.0) / 0.6745;
    // Of a coarse reading half of the values can be 0.
    middle.max(0.3 * stats::rms(u))
}

/// `r` divided by its size as a smooth function of the columns, which is taken from the rows that
/// `counts` names.
pub(super) fn level(r: &[f64], columns: &[Along], counts: impl Fn(usize) -> bool) -> Vec<f64> {
    let mut u = r.to_vec();
    for _ in 0..ROUNDS {
        for column in columns {
            let rows = (0..u.len()).filter(|i| counts(*i)).collect();
            if let Some(curve) = curve(&u, &column.values, rows) {
                for (u, x) in u.iter_mut().zip(&column.values) {
                    *u /= at(&curve, *x);
                }
            }
        }
    }
    u
}

/// Mean size in each bin of a column over that of all of the `rows`, by the middle of the bin.
fn curve(u: &[f64], x: &[f64], mut rows: Vec<usize>) -> Option<Vec<(f64, f64)>> {
    let cut = CUT * usual(u);
    if cut <= 0.0 || rows.len() < 40 * BINS {
        return None;
    }
    parallel::sort(&mut rows, |a, b| x[*a].total_cmp(&x[*b]));
    let size =
        |rows: &[usize]| rows.iter().map(|i| u[*i].abs().min(cut)).sum::<f64>() / rows.len() as f64;
    let all = size(&rows);
    let mut out: Vec<(f64, f64, f64)> = Vec::new();
    for k in 0..BINS {
        let part = &rows[k * rows.len() / BINS..(k + 1) * rows.len() / BINS];
        let (middle, s) = (x[part[part.len() / 2]], size(part) / all);
        match out.last_mut() {
            // Many rows at one value, such as rest, are one bin.
            Some((m, s0, n)) if *m == middle => {
                *s0 = (*s0 * *n + s) / (*n + 1.0);
                *n += 1.0;
            }
            _ => out.push((middle, s, 1.0)),
        }
    }
    (out.len() > 1).then(|| out.into_iter().map(|(m, s, _)| (m, s.max(0.1))).collect())
}

/// The curve at a value, linear between the middles of the bins.
fn at(curve: &[(f64, f64)], x: f64) -> f64 {
    let k = curve.partition_point(|(m, _)| *m < x);
    if k == 0 {
        return curve[0].1;
    }
    let Some((m1, s1)) = curve.get(k) else {
        return curve[curve.len() - 1].1;
    };
    let (m0, s0) = curve[k - 1];
    s0 + (s1 - s0) * (x - m0) / (m1 - m0)
}

/// With which columns the noise grows.
pub fn growth(r: &[f64], frame: &Frame, columns: &[Along]) -> Vec<Growth> {
    let cut = CUT * usual(r);
    let sizes: Vec<f64> = r.iter().map(|x| x.abs().min(cut)).collect();
    let rho = autocorrelation(&sizes, frame, 64.min(r.len() / 4).max(1));
    let clump = correlation_time(&rho);
    let of = |column: &Along| {
        let x = &column.values;
        let mut rows: Vec<usize> = (0..r.len()).collect();
        parallel::sort(&mut rows, |a, b| x[*a].abs().total_cmp(&x[*b].abs()));
        let fifth = rows.len() / 5;
        let pick = |rows: &[usize]| -> Vec<f64> { rows.iter().map(|i| sizes[*i]).collect() };
        let (low, high) = (pick(&rows[..fifth]), pick(&rows[rows.len() - fifth..]));
        let (a, b) = (stats::mean(&low), stats::mean(&high));
        let error = (variance_of_mean(&low, clump) + variance_of_mean(&high, clump)).sqrt();
        // The mean size of normal noise is that much of its RMS.
        let normal = (2.0 / std::f64::consts::PI).sqrt();
        (fifth >= 100 && a > 0.0 && b > GROWS * a && b - a > SURE * error).then(|| Growth {
            name: column.name.clone(),
            sizes: (a / normal, b / normal),
            rows: fifth,
        })
    };
    columns.iter().filter_map(of).collect()
}
