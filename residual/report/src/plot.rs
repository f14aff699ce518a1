//! Data of a residual plot: thinned points and binned means, before and after a change of the
//! model.

use residual_columns::nan;
use residual_columns::parallel;
use residual_columns::stats;
use serde::{Deserialize, Serialize};

/// Data of a plot: thinned points, binned means and RMS of all rows. Residuals are in the target's
/// unit. A default plot is empty.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Plot {
    /// Label of the x axis, with its unit.
    pub against: String,
    /// Label of the y axis, without its unit.
    pub value: String,
    /// Titles of the panels before and after.
    pub names: [String; 2],
    /// x values of the thinned points, in the unit that `against` names.
    #[serde(deserialize_with = "nan::from_null")]
    pub x: Vec<f64>,
    /// Residual at these points before: of the declared model, or of the final one without an
    /// effect.
    #[serde(deserialize_with = "nan::from_null")]
    pub before: Vec<f64>,
    /// Residual at these points after: of the final model.
    #[serde(deserialize_with = "nan::from_null")]
    pub after: Vec<f64>,
    /// Means `[x, before, after]` of all rows in about 30 bins with about equal numbers of rows; a
    /// value of x that many rows have is a bin of its own.
    #[serde(deserialize_with = "nan::from_null")]
    pub means: Vec<[f64; 3]>,
    /// RMS `[before, after]` of all rows.
    #[serde(deserialize_with = "nan::from_null")]
    pub rms: [f64; 2],
}

/// Title of the panel of a model without one effect of the final model.
pub const WITHOUT: &str = "without it";

impl Plot {
    /// Data of a plot of the residual before and after against `x`: about a thousand points, and
    /// means of all rows. Empty if the lists are empty or their lengths differ.
    pub fn new(against: &str, x: &[f64], before: &[f64], after: &[f64]) -> Plot {
        if x.is_empty() || before.len() != x.len() || after.len() != x.len() {
            return Plot::default();
        }
        let rows = thinned(x.len());
        let pick = |v: &[f64]| rows.iter().map(|i| v[*i]).collect::<Vec<f64>>();
        Plot {
            against: against.into(),
            value: "residual".into(),
            names: ["before".into(), "after".into()],
            x: pick(x),
            before: pick(before),
            after: pick(after),
            means: binned(x, before, after),
            rms: [stats::rms(before), stats::rms(after)],
        }
    }

    /// The same with another label of its y axis (without unit) and other titles of its panels.
    #[must_use]
    pub fn named(mut self, value: &str, before: &str, after: &str) -> Plot {
        self.value = value.into();
        self.names = [before.into(), after.into()];
        self
    }
}

/// About a thousand of `rows` rows: one at random in each stretch, as every n-th row would stand
/// still in a motion whose period is a multiple of n rows.
fn thinned(rows: usize) -> Vec<usize> {
    let stride = rows.div_ceil(1000);
    let mut rng = stats::Rng::new(1);
    (0..rows)
        .step_by(stride)
        .map(|start| start + rng.below(stride.min(rows - start)))
        .collect()
}

/// Means over bins of x. Equal values of x stay in one bin.
fn binned(x: &[f64], before: &[f64], after: &[f64]) -> Vec<[f64; 3]> {
    let mut order: Vec<usize> = (0..x.len()).collect();
    parallel::sort(&mut order, |a, b| x[*a].total_cmp(&x[*b]));
    let mut means = Vec::new();
    let mut rest = order.as_slice();
    while !rest.is_empty() {
        let least = x.len().div_ceil(30).min(rest.len());
        let last = x[rest[least - 1]];
        let (from, to) = (
            rest.partition_point(|i| x[*i] < last),
            rest.partition_point(|i| x[*i] <= last),
        );
        // Many rows of one value are a bin of their own, so the bin before ends where they begin.
        let count = if to >= from + least && 8 * from >= least {
            from
        } else {
            to.max(least)
        };
        let (rows, tail) = rest.split_at(count);
        let mean = |v: &[f64]| rows.iter().map(|i| v[*i]).sum::<f64>() / rows.len() as f64;
        means.push([mean(x), mean(before), mean(after)]);
        rest = tail;
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every sixth row of a motion with a period of six rows would be at the same place.
    #[test]
    fn points_do_not_stand_in_columns_of_a_periodic_motion() {
        let x: Vec<f64> = (0..6000).map(|i| f64::from(i % 6)).collect();
        let plot = Plot::new("x", &x, &x, &x);
        assert_eq!(plot.x.len(), 1000);
        for place in 0..6 {
            let count = plot.x.iter().filter(|x| **x == f64::from(place)).count();
            assert!(count > 100, "{place}: {count}");
        }
    }

    #[test]
    fn rows_of_one_value_have_a_bin_of_their_own() {
        let x: Vec<f64> = (0..3000)
            .map(|i| if i % 50 == 0 { -1.0 } else { 0.0 })
            .chain((0..3000).map(f64::from))
            .collect();
        let y: Vec<f64> = x.iter().map(|x| 2.0 * x).collect();
        let means = Plot::new("x", &x, &y, &y).means;
        assert!(means.iter().any(|m| *m == [-1.0, -2.0, -2.0]), "{means:?}");
        assert!(means.len() > 10 && means.len() < 34, "{means:?}");
        let nan = [f64::NAN; 40];
        assert!(!Plot::new("x", &nan, &nan, &nan).means.is_empty());
    }
}
