//! What a calibration is traced to: the weights, and gravity where the rig stands.

use calibrate::weights;
use calibration::gain::{Class, Options, Tolerance, WeightSet};
use calibration::gravity;
use clap::Args;
use std::str::FromStr;

/// Arguments for weights and place.
#[derive(Debug, Args)]
pub(super) struct Standards {
    /// Class of the weights, OIML R 111: E2, F1, F2, M1, M2 or M3 [default: M2]
    #[arg(
        long,
        value_name = "CLASS",
        help_heading = "Weights and place",
        conflicts_with = "tolerance"
    )]
    class: Option<Class>,
    /// Largest relative error of the weights, where they are of no class
    #[arg(long, value_name = "PART", help_heading = "Weights and place")]
    tolerance: Option<f64>,
    /// Correlation of the errors of different weights, 0 to 1; 0: each was calibrated for itself
    #[arg(
        long,
        value_name = "R",
        help_heading = "Weights and place",
        default_value_t = 1.0
    )]
    correlation: f64,
    /// Latitude of the rig, degrees: gravity by the formula of WGS 84
    #[arg(long, value_name = "DEGREES", help_heading = "Weights and place", value_parser = latitude, allow_negative_numbers = true)]
    latitude: Option<f64>,
    /// Height of the rig above the sea, m
    #[arg(long, value_name = "M", help_heading = "Weights and place", requires = "latitude", value_parser = height, allow_negative_numbers = true)]
    height: Option<f64>,
    /// Local acceleration of gravity, m/s^2, where it is known better than by the latitude
    #[arg(
        long,
        value_name = "G",
        help_heading = "Weights and place",
        conflicts_with = "latitude"
    )]
    gravity: Option<f64>,
    /// Relative standard uncertainty of it
    #[arg(long, value_name = "PART", help_heading = "Weights and place")]
    gravity_sd: Option<f64>,
    /// How the weights load the cells: `dismounted`, or `pulley=FRICTION`, where friction is at
    /// most this part of the load (0.02 for a plain bearing, 0.001 for a ball bearing)
    #[arg(long, value_name = "HOW", help_heading = "Weights and place")]
    loading: Option<Loading>,
}

/// How weights load a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Loading {
    /// The cell is out of its unit, its axis upright.
    Dismounted,
    /// The cord runs over a pulley with such friction.
    Pulley(f64),
}

impl FromStr for Loading {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "dismounted" {
            return Ok(Self::Dismounted);
        }
        let friction = text
            .strip_prefix("pulley=")
            .and_then(|part| part.parse().ok());
        let friction = friction.filter(|part| (0.0..0.1).contains(part));
        friction.map(Self::Pulley).ok_or_else(|| {
            format!("`{text}` is neither `dismounted` nor `pulley=FRICTION` with a part of the load from 0 to 0.1, as in pulley=0.001")
        })
    }
}

fn latitude(text: &str) -> Result<f64, String> {
    let parsed = text.parse().ok().filter(|v| (-90.0..=90.0).contains(v));
    parsed.ok_or_else(|| format!("`{text}` is no latitude; give -90 to 90 degrees"))
}

fn height(text: &str) -> Result<f64, String> {
    let parsed = text.parse().ok().filter(|v| (-450.0..=5500.0).contains(v));
    parsed.ok_or_else(|| format!("`{text}` is no height of a laboratory; give -450 to 5500 m"))
}

fn celsius(text: &str) -> Result<f64, String> {
    let parsed = text.parse().ok().filter(|v| (-20.0..=60.0).contains(v));
    parsed.ok_or_else(|| {
        format!("`{text}` is no temperature of a room; give -20 to 60 degrees Celsius")
    })
}

/// Relative standard uncertainty of a local value that is given without one, for example of the
/// national survey.
const LOOKED_UP_SD: f64 = 2e-5;
/// Standard deviation of a height that is not given, m: most people live below 500 m.
const HEIGHT_SD_M: f64 = 300.0;

impl Standards {
    /// Local gravity, m/s^2, and its relative standard uncertainty.
    fn gravity(&self) -> (f64, f64) {
        let (value, sd) = match (self.gravity, self.latitude) {
            (Some(value), _) => (value, LOOKED_UP_SD),
            (None, Some(latitude)) => (
                gravity::normal_m_per_s2(latitude, self.height.unwrap_or(0.0)),
                match self.height {
                    Some(_) => gravity::ANOMALY_SD,
                    None => gravity::ANOMALY_SD.hypot(HEIGHT_SD_M * gravity::PER_METRE),
                },
            ),
            (None, None) => (gravity::STANDARD_M_PER_S2, gravity::UNKNOWN_PLACE_SD),
        };
        (value, self.gravity_sd.unwrap_or(sd))
    }

    /// Refuses a gravity that is nowhere on Earth, before anybody hangs a weight.
    pub(super) fn check(&self) -> calibrate::Result<()> {
        let (value, _) = self.gravity();
        if gravity::ON_EARTH_M_PER_S2.contains(&value) {
            return Ok(());
        }
        Err(calibrate::CalibrateError::input(format!(
            "--gravity is {value}; on Earth it is 9.76 to 9.84 m/s^2"
        )))
    }

    /// The options of a fit with weights and gravity as given.
    pub(super) fn options(&self) -> Options {
        let (gravity_m_per_s2, gravity_relative_sd) = self.gravity();
        let set = WeightSet::default();
        let tolerance = match (self.class, self.tolerance) {
            (Some(class), _) => Tolerance::Class(class),
            (None, Some(part)) => Tolerance::Relative(part),
            (None, None) => set.tolerance,
        };
        Options {
            gravity_m_per_s2,
            gravity_relative_sd,
            weights: WeightSet {
                tolerance,
                correlation: self.correlation,
            },
            pulley_friction: match self.loading {
                Some(Loading::Pulley(friction)) => Some(friction),
                Some(Loading::Dismounted) | None => None,
            },
            ..Options::default()
        }
    }

    /// How the weights load the cells, in words; empty where nobody said.
    fn loading(&self) -> String {
        match self.loading {
            None => String::new(),
            Some(Loading::Dismounted) => weights::DISMOUNTED.to_owned(),
            Some(Loading::Pulley(friction)) => {
                format!(
                    "over a pulley with friction of at most {} %",
                    100.0 * friction
                )
            }
        }
    }

    /// What the user should know of these.
    pub(super) fn note(&self) -> Option<&'static str> {
        (self.gravity.is_none() && self.latitude.is_none()).then_some(
            "where the rig stands is not given: gravity is taken as 9.80665 m/s^2 +- 0.27 %; --latitude DEGREES and --height M tell it to 0.01 %",
        )
    }
}

/// Arguments for what a certificate says beside the numbers.
#[derive(Debug, Args)]
pub(super) struct Traced {
    /// Number of the weights' calibration certificate
    #[arg(long, value_name = "TEXT", help_heading = "Certificate")]
    weights_certificate: Option<String>,
    /// Serial number of the set of weights
    #[arg(long, value_name = "TEXT", help_heading = "Certificate")]
    weights_serial: Option<String>,
    /// Who calibrates
    #[arg(long, value_name = "NAME", help_heading = "Certificate")]
    operator: Option<String>,
    /// Remarks
    #[arg(long, value_name = "TEXT", help_heading = "Certificate")]
    note: Option<String>,
    /// Temperature at the cells, degrees Celsius, where no sensor gives it
    #[arg(long, value_name = "CELSIUS", help_heading = "Certificate", value_parser = celsius, allow_negative_numbers = true)]
    temperature: Option<f64>,
    /// Days for which the gains are valid
    #[arg(long, value_name = "DAYS", help_heading = "Certificate", default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3650))]
    valid_days: u32,
}

impl Traced {
    /// Days for which the gains are valid.
    pub(super) const fn valid_days(&self) -> u32 {
        self.valid_days
    }

    /// For the record of the gains. What is not given is empty there: a certificate of other
    /// weights must not stay.
    pub(super) fn of_gains(&self, standards: &Standards) -> weights::Traced {
        let text = |given: &Option<String>| given.clone().unwrap_or_default();
        weights::Traced {
            certificate: text(&self.weights_certificate),
            serial: text(&self.weights_serial),
            operator: text(&self.operator),
            note: text(&self.note),
            loading: standards.loading(),
            temperature_c: self.temperature,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Call {
        #[command(flatten)]
        standards: Standards,
    }

    #[test]
    fn place_and_weights_make_the_options() {
        let of = |line: &str| {
            Call::try_parse_from(line.split(' '))
                .map(|call| call.standards.options())
                .map_err(|error| error.to_string())
        };
        let nothing = of("x").unwrap();
        assert_eq!(nothing.gravity_relative_sd, gravity::UNKNOWN_PLACE_SD);
        assert_eq!(nothing.weights, WeightSet::default());
        let singapore = of("x --latitude 1.35 --height 15 --class F2").unwrap();
        assert!((singapore.gravity_m_per_s2 - 9.7806).abs() < 1e-3);
        assert!(singapore.gravity_relative_sd < 1e-4);
        assert_eq!(singapore.weights.tolerance, Tolerance::Class(Class::F2));
        let rough = of("x --latitude -33.9 --tolerance 0.001 --correlation 0").unwrap();
        assert!(rough.gravity_relative_sd > 1e-4);
        assert_eq!(rough.weights.correlation, 0.0);
        let pulley = of("x --loading pulley=0.002").unwrap();
        assert_eq!(pulley.pulley_friction, Some(0.002));
        assert_eq!(of("x --loading dismounted").unwrap().pulley_friction, None);
        let known = of("x --gravity 9.8127").unwrap();
        assert_eq!(known.gravity_relative_sd, 2e-5);
        for (line, refused) in [
            ("x --gravity 9.75", true),
            ("x --gravity 9.88", true),
            ("x --gravity 9.7639", false),
            ("x --latitude 90 --height 0", false),
        ] {
            let call = Call::try_parse_from(line.split(' ')).unwrap();
            assert_eq!(call.standards.check().is_err(), refused, "{line}");
        }
        for bad in [
            "x --latitude 91",
            "x --height 100",
            "x --gravity 9.8 --latitude 3",
            "x --class M2 --tolerance 0.001",
            "x --class M9",
            "x --loading pulley",
            "x --loading pulley=2",
        ] {
            assert!(of(bad).is_err(), "{bad}");
        }
    }
}
