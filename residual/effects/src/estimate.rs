//! Parameters of an effect as they were fitted: what its bounds are held against.

use super::{Form, Param};
use residual_columns::format::num;
use std::collections::BTreeMap;

/// Largest width of the interval of an order or a frequency, as a share of it: beyond it the number
/// says nothing.
const VAGUE: f64 = 0.5;

/// Parameters of an effect with their 95 % intervals.
pub struct Estimate<'a> {
    /// The form that was fitted, and its label.
    pub form: Form,
    /// See `form`.
    pub label: &'a str,
    /// Its parameters.
    pub params: &'a [Param],
    /// Their 95 % intervals, by name.
    pub intervals: &'a BTreeMap<String, [f64; 2]>,
}

impl Estimate<'_> {
    /// A parameter; `None` if the form does not have it.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.params.iter().find(|p| p.name == name).map(|p| p.value)
    }

    /// Why a parameter outside `low..=high` is impossible.
    pub fn outside(&self, name: &str, low: f64, high: f64, why: &str) -> Option<String> {
        let x = self.get(name)?;
        let inside = x >= low && x <= high;
        (!inside).then(|| format!("{name} {}: {why}", num(x)))
    }

    /// Why a length at or below half a step of its column cannot be seen.
    pub fn below_step(&self, name: &str, step: f64, column: &str) -> Option<String> {
        let x = self.get(name)?;
        (step > 0.0 && x <= 0.5 * step).then(|| {
            format!(
                "{name} {} is below half a step of {column} ({})",
                num(x),
                num(step)
            )
        })
    }

    /// Why a parameter whose interval goes below `least` says nothing; `what` it is then.
    pub fn may_be_below(&self, name: &str, least: f64, what: &str) -> Option<String> {
        let (x, [low, _]) = (self.get(name)?, self.intervals.get(name)?);
        (*low < least).then(|| format!("{name} {} may be below {}: {what}", num(x), num(least)))
    }

    /// Why an order or a frequency is too uncertain to be one.
    pub fn vague(&self, name: &str) -> Option<String> {
        let (x, [low, high]) = (self.get(name)?, self.intervals.get(name)?);
        (high - low > VAGUE * x.abs()).then(|| {
            format!(
                "{name} {} lies between {} and {}: too uncertain to be one",
                num(x),
                num(*low),
                num(*high)
            )
        })
    }
}
