//! The rig file: everything that belongs to one rig and not to the program, as TOML in SI units.
//!
//! Where the cables leave their reels, how each load cell is mounted and calibrated, gains, limits
//! and friction of each unit, the host controller, the tension policy, where the robot's pose comes
//! from and how the board is reached. `rigs/raven-left.toml` is a commented example and built in as
//! the default.
//!
//! A file is checked as a whole: every problem is reported with file, line, key, unit and what to
//! do ([`RigFileError`]), and nothing is driven with a file that has one.

pub mod init;
pub mod link_pose;
mod problem;
mod read;
mod settings;

pub use link_pose::{LinkChoice, PoseChoice};
pub use problem::{Problem, RigFileError};
pub use settings::{
    AllocationSettings, CellSettings, ControllerSettings, Filter, Reference, RippleSettings,
    UnitChecks, UnitSettings, Workspace, TIP_FORCE_LIMIT_N,
};

use nalgebra::Vector3;
use serde::Serialize;
use std::path::Path;
use wire::message::UnitConfig;
use wire::UNITS;

/// The rig file that is built in.
pub const DEFAULT_TEXT: &str = include_str!("../rigs/raven-left.toml");

/// Name by which messages call the built-in rig file.
pub const DEFAULT_NAME: &str = "built-in rigs/raven-left.toml";

/// Version of the rig file's keys.
pub const SCHEMA: i64 = 1;

/// A checked rig file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rig {
    /// Name of the rig.
    pub name: String,
    /// How the board is reached where the command line doesn't say.
    pub link: LinkChoice,
    /// Where the robot's pose comes from.
    pub pose: PoseChoice,
    /// Standard deviation of a coordinate of the tip as the pose's source tells it, m. It changes
    /// nothing that the rig does, only what is said of the force: no part of the hash.
    #[serde(skip)]
    pub pose_sd_m: f64,
    /// Where the tip works.
    pub workspace: Workspace,
    /// The host's force controller.
    pub controller: ControllerSettings,
    /// How a force is shared out over the cables.
    pub allocation: AllocationSettings,
    /// The units, unit 1 first.
    pub units: [UnitSettings; UNITS],
    /// The calibration whose numbers replaced the file's (`known::base`). Not part of the hash; its
    /// numbers are.
    #[serde(skip)]
    pub calibration: Option<Box<calibration::record::Record>>,
}

/// The text of a rig file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RigText {
    /// Its name, for messages.
    pub name: String,
    /// The text.
    pub text: String,
}

impl RigText {
    /// Reads a file; without one, the built-in text.
    ///
    /// # Errors
    /// Why the file could not be read.
    pub fn read(path: Option<&Path>) -> Result<Self, RigFileError> {
        let (name, text) = match path {
            None => (DEFAULT_NAME.to_owned(), Ok(DEFAULT_TEXT.to_owned())),
            // No pipe: what a rig is driven by can be looked at again.
            Some(path) => {
                let text = files::open(path).and_then(std::io::read_to_string);
                (path.display().to_string(), text)
            }
        };
        match text {
            Ok(text) => Ok(Self { name, text }),
            Err(error) => Err(RigFileError {
                file: name,
                problems: vec![Problem {
                    line: 0,
                    unit: None,
                    key: String::new(),
                    message: format!("cannot be read ({error}); give the path of a rig file, or leave it out for the built-in one"),
                }],
            }),
        }
    }

    /// Checks it.
    ///
    /// # Errors
    /// Every problem found.
    pub fn parse(&self) -> Result<Rig, RigFileError> {
        Rig::parse(&self.name, &self.text)
    }
}

impl Rig {
    /// The built-in example.
    ///
    /// # Errors
    /// Only where the example is wrong; a test checks it.
    pub fn built_in() -> Result<Self, RigFileError> {
        Self::parse(DEFAULT_NAME, DEFAULT_TEXT)
    }

    /// Reads and checks a file.
    ///
    /// # Errors
    /// Every problem found, or why the file could not be read.
    pub fn load(path: &Path) -> Result<Self, RigFileError> {
        RigText::read(Some(path))?.parse()
    }

    /// Checks the text of a rig file; `file` is its name for messages.
    ///
    /// # Errors
    /// Every problem found.
    pub fn parse(file: &str, text: &str) -> Result<Self, RigFileError> {
        read::parse(text).map_err(|problems| RigFileError {
            file: file.to_owned(),
            problems,
        })
    }

    /// SHA-256, in hexadecimal, of everything the file says (comments and layout left out).
    #[must_use]
    pub fn hash(&self) -> String {
        // Serialising plain numbers and strings to memory cannot fail; an empty text would still
        // hash.
        let json = serde_json::to_vec(self).unwrap_or_default();
        files::sha256_of(json)
    }

    /// Whether a calibration gave the scale of unit `i` (from 0).
    #[must_use]
    pub fn has_measured_gain(&self, i: usize) -> bool {
        self.calibration.as_ref().is_some_and(|record| {
            let number = self.units[i].number;
            let unit = record.units.iter().find(|u| u.number == number);
            unit.is_some_and(|u| !u.gain_date.is_empty())
        })
    }

    /// The tensions that an allocation stays near to, N.
    #[must_use]
    pub fn reference_n(&self) -> [f64; UNITS] {
        self.units.map(|unit| match self.allocation.reference {
            Reference::Lower => unit.tension_min_n,
            Reference::Middle => 0.5 * (unit.tension_min_n + unit.tension_max_n),
        })
    }

    /// The rig with the loops of tensions and force open: the command is the setpoint, and friction
    /// is not made up for. The board takes it with its next configuration.
    #[must_use]
    pub fn with_open_loops(&self) -> Self {
        let mut open = self.clone();
        open.controller.kp = 0.0;
        open.controller.ki_per_s = 0.0;
        for unit in &mut open.units {
            unit.kp = 0.0;
            unit.ki_per_s = 0.0;
            unit.kd_s = 0.0;
            unit.damping_n_s_per_m = 0.0;
            unit.friction_feedforward = false;
        }
        open
    }

    /// Checks a commanded force before anything is driven.
    ///
    /// # Errors
    /// What is wrong with it, and what to give instead.
    pub fn check_force(&self, commanded_n: Vector3<f64>) -> Result<(), String> {
        for (axis, value) in ["X", "Y", "Z"].iter().zip(&commanded_n) {
            if !value.is_finite() {
                return Err(format!(
                    "force {axis} is {value}: give three finite numbers in newtons, as in `set-force 0 2.5 0`"
                ));
            }
        }
        let size = commanded_n.norm();
        if size > self.controller.force_limit_n {
            return Err(format!(
                "a force of {} N is above the rig's limit of {} N (`force_limit_n` in [controller] of the rig file); nothing was driven",
                above(size, self.controller.force_limit_n),
                self.controller.force_limit_n
            ));
        }
        Ok(())
    }
}

/// A number above a limit with as few decimals as show that it is above: 12.5, 12.00004, 1000000.
fn above(value: f64, limit: f64) -> String {
    (1..=17)
        .map(|decimals| format!("{value:.decimals$}"))
        .find(|text| text.parse::<f64>().is_ok_and(|shown| shown > limit))
        .unwrap_or_else(|| format!("{value}"))
}

/// CRC-32 that the board reports for six configurations in force, zeros included.
#[must_use]
pub fn board_crc(configs: &[UnitConfig; UNITS]) -> u32 {
    // Plain integers into memory: cannot fail.
    wire::frame::crc32(&postcard::to_stdvec(configs).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_force_above_the_limit_is_shown_above_it() {
        let rig = Rig::built_in().unwrap();
        for (force_n, shown) in [
            (12.5, "a force of 12.5 N"),
            (12.000_04, "a force of 12.00004 N"),
            (1e9, "a force of 1000000000.0 N"),
        ] {
            let error = rig.check_force([0.0, force_n, 0.0].into()).unwrap_err();
            assert!(error.contains(shown), "{error}");
        }
    }

    #[test]
    fn vectors_are_arrays_in_json() {
        // The hash of a rig file, set-force.json and the recordings depend on it.
        let json = serde_json::to_string(&Vector3::new(1.0, -0.5, 0.0)).unwrap();
        assert_eq!(json, "[1.0,-0.5,0.0]");
    }
}
