//! Numbers that JSON does not have. `serde_json` writes NaN and infinities as `null`; reading turns
//! `null` into NaN. Depends on nothing else, so that every module with a stored type can use it.

use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;

/// For `#[serde(deserialize_with = "crate::nan::from_null")]`: reads numbers, with `null` as NaN.
pub fn from_null<'de, D, T>(deserializer: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: Numbers,
{
    T::Stored::deserialize(deserializer).map(T::restored)
}

/// A number or a collection of numbers.
pub trait Numbers {
    /// The same with `None` where a number is `null`.
    type Stored: for<'de> Deserialize<'de>;

    /// The numbers, NaN where one is `None`.
    fn restored(stored: Self::Stored) -> Self;
}

impl Numbers for f64 {
    type Stored = Option<f64>;

    fn restored(stored: Option<f64>) -> f64 {
        stored.unwrap_or(f64::NAN)
    }
}

impl Numbers for [f64; 2] {
    type Stored = [Option<f64>; 2];

    fn restored(stored: Self::Stored) -> Self {
        stored.map(f64::restored)
    }
}

impl Numbers for [f64; 3] {
    type Stored = [Option<f64>; 3];

    fn restored(stored: Self::Stored) -> Self {
        stored.map(f64::restored)
    }
}

impl<T: Numbers> Numbers for Vec<T> {
    type Stored = Vec<T::Stored>;

    fn restored(stored: Self::Stored) -> Self {
        stored.into_iter().map(T::restored).collect()
    }
}

impl<T: Numbers> Numbers for BTreeMap<String, T> {
    type Stored = BTreeMap<String, T::Stored>;

    fn restored(stored: Self::Stored) -> Self {
        stored
            .into_iter()
            .map(|(name, value)| (name, T::restored(value)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(serde::Serialize, Deserialize)]
    struct Stored {
        #[serde(deserialize_with = "from_null")]
        numbers: BTreeMap<String, Vec<[f64; 2]>>,
    }

    #[test]
    fn what_is_not_finite_comes_back_as_nan_and_the_rest_unchanged() {
        let numbers =
            BTreeMap::from([("a".into(), vec![[0.1, f64::NAN], [f64::INFINITY, -2e-300]])]);
        let text = serde_json::to_string(&Stored { numbers }).unwrap();
        assert_eq!(text, r#"{"numbers":{"a":[[0.1,null],[null,-2e-300]]}}"#);
        let read: Stored = serde_json::from_str(&text).unwrap();
        let [a, b] = read.numbers["a"][..] else {
            panic!("{:?}", read.numbers)
        };
        assert!(a[0] == 0.1 && a[1].is_nan() && b[0].is_nan() && b[1] == -2e-300);
    }
}
