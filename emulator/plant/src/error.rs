//! Errors of the plant: a configuration that can't be simulated, an input that isn't a voltage.

use std::fmt;

/// A value of [`crate::PlantConfig`] outside what the physics allows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// Dotted key of the value, as in the TOML file: `units[2].position_m`.
    pub key: String,
    /// What was found and what is expected.
    pub problem: String,
}

impl ConfigError {
    pub(crate) fn new(key: impl Into<String>, problem: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            problem: problem.into(),
        }
    }
}

/// A number, or each of several.
pub(crate) trait Within {
    /// Refuses what is not finite or outside `low..=high`; `key` is where it stands in the
    /// configuration.
    fn within(&self, key: &str, low: f64, high: f64) -> Result<(), ConfigError>;
}

impl Within for f64 {
    fn within(&self, key: &str, low: f64, high: f64) -> Result<(), ConfigError> {
        if self.is_finite() && (low..=high).contains(self) {
            return Ok(());
        }
        Err(ConfigError::new(
            key,
            format!("{self} found, {low} to {high} expected"),
        ))
    }
}

impl<const N: usize> Within for [f64; N] {
    fn within(&self, key: &str, low: f64, high: f64) -> Result<(), ConfigError> {
        self.iter()
            .try_for_each(|value| value.within(key, low, high))
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "plant configuration, `{}`: {}", self.key, self.problem)
    }
}

impl std::error::Error for ConfigError {}

/// An input that the plant can't take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InputError {
    /// There is no unit of this number.
    NoSuchUnit {
        /// Number given, counted from 0.
        unit: usize,
        /// Number of units in the plant.
        units: usize,
    },
    /// The voltage is NaN or infinite; 0 V was taken in its place.
    NotAVoltage {
        /// Number of the unit, counted from 0.
        unit: usize,
    },
    /// No weight hangs so: it is negative or not finite, or there is no gravity.
    NotAWeight {
        /// Weight given, N.
        newtons: f64,
    },
    /// A model of a robot holds the tip and does not let it go.
    TipIsHeld,
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchUnit { unit, units } => {
                write!(
                    f,
                    "unit {unit} does not exist: units are 0 to {}",
                    units - 1
                )
            }
            Self::NotAVoltage { unit } => write!(
                f,
                "unit {unit}: the amplifier voltage is not a finite number; 0 V taken instead"
            ),
            Self::NotAWeight { newtons } => {
                write!(f, "a weight of {newtons} N can't hang on the tip")
            }
            Self::TipIsHeld => write!(
                f,
                "a robot model holds the tip and does not let it go: use a rig whose tip follows a path"
            ),
        }
    }
}

impl std::error::Error for InputError {}
