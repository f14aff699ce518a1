//! How far weights are from what is written on them: the classes of OIML R 111, a tolerance, and
//! what the weights of a set share.
//!
//! Weights of one set were adjusted with one balance against one reference, so their errors are
//! alike. How alike is rarely known. OIML R 111-1 (2004), annex C, adds the uncertainties of
//! weights whose covariance is not known, as if their correlation were 1; [`WeightSet::default`]
//! does the same.

use std::fmt;
use std::str::FromStr;

/// Accuracy class of a weight, OIML R 111-1 (2004), table 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// Class E2.
    E2,
    /// Class F1.
    F1,
    /// Class F2.
    F2,
    /// Class M1.
    M1,
    /// Class M2.
    M2,
    /// Class M3.
    M3,
}

/// Nominal value, g, and the maximum permissible errors, mg, of the classes E2, F1, F2, M1, M2, M3
/// (table 1).
const TABLE: [(f64, [f64; 6]); 11] = [
    (2000.0, [3.0, 10.0, 30.0, 100.0, 300.0, 1000.0]),
    (1000.0, [1.6, 5.0, 16.0, 50.0, 160.0, 500.0]),
    (500.0, [0.8, 2.5, 8.0, 25.0, 80.0, 250.0]),
    (200.0, [0.3, 1.0, 3.0, 10.0, 30.0, 100.0]),
    (100.0, [0.16, 0.5, 1.6, 5.0, 16.0, 50.0]),
    (50.0, [0.10, 0.3, 1.0, 3.0, 10.0, 30.0]),
    (20.0, [0.08, 0.25, 0.8, 2.5, 8.0, 25.0]),
    (10.0, [0.06, 0.20, 0.6, 2.0, 6.0, 20.0]),
    (5.0, [0.05, 0.16, 0.5, 1.6, 5.0, 16.0]),
    (2.0, [0.04, 0.12, 0.4, 1.2, 4.0, 12.0]),
    (1.0, [0.03, 0.10, 0.3, 1.0, 3.0, 10.0]),
];

impl Class {
    /// Largest permissible error of a weight, g. One that is no nominal value counts as made of the
    /// fewest that are, whose errors add; a part below 1 g as a weight of 1 g.
    #[must_use]
    pub fn limit_g(self, weight_g: f64) -> f64 {
        let mut left_g = weight_g;
        let mut limit_mg = 0.0;
        for (nominal_g, limits) in TABLE {
            // A slip of the last digit makes no piece more or less.
            let pieces = (left_g / nominal_g + 1e-9).floor();
            limit_mg += pieces * limits[self as usize];
            left_g -= pieces * nominal_g;
        }
        if left_g > 1e-6 {
            limit_mg += TABLE[TABLE.len() - 1].1[self as usize];
        }
        1e-3 * limit_mg
    }
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self:?}")
    }
}

impl FromStr for Class {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let all = [Self::E2, Self::F1, Self::F2, Self::M1, Self::M2, Self::M3];
        let found = all
            .into_iter()
            .find(|class| class.to_string().eq_ignore_ascii_case(text));
        found.ok_or_else(|| {
            format!(
                "`{text}` is no class of weights; known are E2, F1, F2, M1, M2 and M3 (OIML R 111)"
            )
        })
    }
}

/// What is known of the errors of weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// Within the limits of a class.
    Class(Class),
    /// Within a part of the value: 0.001 for +-0.1 %.
    Relative(f64),
}

impl fmt::Display for Tolerance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Class(class) => write!(f, "OIML class {class}"),
            Self::Relative(part) => write!(f, "+-{} %", 100.0 * part),
        }
    }
}

/// A set of weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeightSet {
    /// Limit of each error; any error within is equally likely (standard uncertainty limit / sqrt
    /// 3, GUM 4.3.7).
    pub tolerance: Tolerance,
    /// Correlation of the errors of different weights, 0 to 1.
    pub correlation: f64,
}

impl Default for WeightSet {
    /// Class M2, the widest that is sold as calibration weights, and one error in common.
    fn default() -> Self {
        Self {
            tolerance: Tolerance::Class(Class::M2),
            correlation: 1.0,
        }
    }
}

impl WeightSet {
    /// Relative standard uncertainty of a weight, g; 0 for none.
    #[must_use]
    pub fn relative_sd(&self, weight_g: f64) -> f64 {
        if weight_g <= 0.0 {
            return 0.0;
        }
        let limit = match self.tolerance {
            Tolerance::Class(class) => class.limit_g(weight_g) / weight_g,
            Tolerance::Relative(part) => part,
        };
        limit / 3f64.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_those_of_the_table_and_add_up_over_pieces() {
        for (class, weight_g, limit_mg) in [
            (Class::M1, 1000.0, 50.0),
            (Class::M2, 10.0, 6.0),
            (Class::F2, 500.0, 8.0),
            (Class::M2, 0.0, 0.0),
            // 500 + 200 + 50; 1 and 0.5 g.
            (Class::M1, 750.0, 38.0),
            (Class::M1, 1.5, 2.0),
            (Class::E2, 3000.0, 4.6),
        ] {
            let found = 1e3 * class.limit_g(weight_g);
            assert!(
                (found - limit_mg).abs() < 1e-9,
                "{class} {weight_g} {found}"
            );
        }
        assert_eq!("m1".parse(), Ok(Class::M1));
        assert!("M4".parse::<Class>().is_err());
        let set = WeightSet::default();
        assert!((set.relative_sd(1000.0) * 3f64.sqrt() - 1.6e-4).abs() < 1e-12);
        assert_eq!(set.relative_sd(0.0), 0.0);
    }
}
