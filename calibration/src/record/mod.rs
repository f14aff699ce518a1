//! The calibration of a rig as one TOML text: zeros, gains, exit points and axes with their
//! covariances, serial numbers, date and a hash over all of it.
//!
//! ```toml
//! schema = 2
//! hash = "sha256:..."
//! date = "2026-03-14"
//! rig = "raven-left"
//!
//! [[unit]]
//! number = 1
//! cell_serial = "SBA-0713"
//! ...
//! ```
//!
//! [`Record::write`] puts the hash in, [`Record::read`] refuses a text whose hash is not that of
//! its content: an edit by hand is seen. Reading is strict: unknown keys, missing keys, wrong types
//! and values that can't be are errors with file, line and key. The caller gives the date; the
//! crate has no clock.

use crate::input::Location;
use nalgebra::{DMatrix, SMatrix, SymmetricEigen, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

mod diff;

pub use diff::Difference;

/// Version of the keys. Version 2 has the creep of a cell, the uncertainty of its curve, and serial
/// numbers of unit and motor; a record of version 1 is read as one of cells that do not creep.
/// Version 3 has what a certificate needs: operator, weights, how long the calibration is valid,
/// and the figures of each gain.
pub const SCHEMA: u32 = 3;
/// The oldest version that is read.
pub const OLDEST_SCHEMA: u32 = 1;

/// The calibration of a rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Version of the keys: [`SCHEMA`].
    pub schema: u32,
    /// `sha256:` and 64 hexadecimal digits over the text without this line; set by
    /// [`Record::write`].
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub hash: String,
    /// Date of the calibration, `YYYY-MM-DD`.
    pub date: String,
    /// Name of the rig.
    pub rig: String,
    /// Remarks.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Days from the date of a gain for which it is valid; 0: nobody said.
    #[serde(default, skip_serializing_if = "is_none")]
    pub valid_days: u32,
    /// Local acceleration of gravity used, m/s^2.
    pub gravity_m_per_s2: f64,
    /// Relative standard uncertainty of the gain that all units share: gravity, one set of weights.
    pub common_gain_relative_sd: f64,
    /// The part of it that is from gravity.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gravity_relative_sd: f64,
    /// The units, unit 1 first.
    #[serde(rename = "unit")]
    pub units: Vec<UnitRecord>,
    /// Covariances between exit points of different units, m^2.
    #[serde(
        default,
        rename = "exit_cross_covariance",
        skip_serializing_if = "Vec::is_empty"
    )]
    pub cross: Vec<CrossCovariance>,
}

/// The calibration of one unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitRecord {
    /// Unit, from 1.
    pub number: u8,
    /// Serial number of the unit as a whole; empty where there is none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit_serial: String,
    /// Serial number of the motor; empty where there is none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub motor_serial: String,
    /// Serial number of the load cell; empty where there is none.
    pub cell_serial: String,
    /// Serial number of the converter module; empty where there is none.
    pub converter_serial: String,
    /// Date of the gain, `YYYY-MM-DD`; empty: the gain is nominal and was not measured.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub gain_date: String,
    /// Date of the zero; empty: not measured.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub zero_date: String,
    /// Date of exit point and axis; empty: not measured.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub geometry_date: String,
    /// Scale, N per code.
    pub n_per_code: f64,
    /// Standard uncertainty of the scale, the unit's own part, N per code.
    pub n_per_code_sd: f64,
    /// Quadratic term, N per code^2; 0 for a straight cell.
    pub n_per_code2: f64,
    /// Its standard uncertainty, N per code^2.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub n_per_code2_sd: f64,
    /// Share of a lasting load by which the reading grows; 0 for a cell that does not creep.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub creep: f64,
    /// Its standard uncertainty.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub creep_sd: f64,
    /// Time constant of the creep, s; 0 without creep.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub creep_s: f64,
    /// Zero at the last power-up, codes.
    pub zero_codes: f64,
    /// Its standard error, codes.
    pub zero_sd_codes: f64,
    /// Weight of motor and rack along the axis, N.
    pub mounting_n: f64,
    /// Its standard uncertainty, N.
    pub mounting_sd_n: f64,
    /// Standard deviation of the zero's step from one power-up to the next, N.
    pub power_up_step_n: f64,
    /// Exit point, base frame, m.
    pub exit_m: [f64; 3],
    /// Measuring axis, unit vector, base frame.
    pub axis: [f64; 3],
    /// Covariance of `[exit_m, axis]`, upper triangle by rows, 21 numbers: m^2, m, 1.
    pub covariance: Vec<f64>,
    /// The figures of the gain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<GainRecord>,
}

/// The weights that a gain is traced to.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightsRecord {
    /// Class or tolerance, in words.
    pub tolerance: String,
    /// Correlation of the errors of different weights.
    pub correlation: f64,
    /// Number of their calibration certificate; empty: none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub certificate: String,
    /// Serial number of the set; empty: none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub serial: String,
}

/// The temperature of the cell while its gain was measured, and what it changes, where the readings
/// tell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemperatureRecord {
    /// Lowest, degrees Celsius.
    pub from_c: f64,
    /// Highest, degrees Celsius.
    pub to_c: f64,
    /// Relative change of the scale (N per code) with each kelvin above the mean; 0: not seen.
    pub scale_per_k: f64,
    /// Its standard uncertainty; 0 where it was not looked for.
    pub scale_per_k_sd: f64,
    /// Change of the zero, N/K; 0: not seen.
    pub zero_n_per_k: f64,
    /// Its standard uncertainty; 0 where it was not looked for.
    pub zero_n_per_k_sd: f64,
}

/// The figures of the procedure of ISO 376 ([`crate::gain::iso376`]), relative to the force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Iso376Record {
    /// The class that results: `00`, `0.5`, `1` or `2`; empty: none.
    pub class: String,
    /// Smallest force of the class, N.
    pub from_n: f64,
    /// Largest, N.
    pub to_n: f64,
    /// Figures that keep the cell from the next better class.
    pub in_the_way: Vec<String>,
    /// Zero error f0, the largest of the series, with its sign.
    pub zero: f64,
    /// Creep c from 30 to 300 s; none where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub creep: Option<f64>,
    /// Resolution, N.
    pub resolution_n: f64,
    /// Degree of the interpolation.
    pub degree: u8,
    /// Of each load: force (N), b, b', fc, v, expanded uncertainty (k = 2) of the calibrating
    /// force, and of a force by the cell.
    pub loads: Vec<[f64; 7]>,
}

/// How good the fit of a gain was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GainRecord {
    /// Readings.
    pub readings: u32,
    /// Largest load, N.
    pub largest_n: f64,
    /// Half of the 95 % interval of the scale up to 12 N, everything included, relative.
    pub half_95_relative: f64,
    /// Relative standard uncertainties of the scale: from the readings,
    pub readings_sd: f64,
    /// from the weights,
    pub weights_sd: f64,
    /// from gravity and air,
    pub gravity_sd: f64,
    /// from what the largest weight leaves open beyond it,
    pub beyond_sd: f64,
    /// from the next mounting of the cell,
    #[serde(default, skip_serializing_if = "is_zero")]
    pub remounting_sd: f64,
    /// and from a pulley.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub pulley_sd: f64,
    /// Repeatability beyond the readings' own standard errors, N (standard deviation).
    pub repeatability_n: f64,
    /// Chi-square of the fit without repeatability.
    pub chi_square: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: u32,
    /// Largest mean deviation from the fitted curve at one load, N.
    pub linearity_n: f64,
    /// Largest difference between unloading and loading, N; 0 where nothing was read in both
    /// directions.
    pub hysteresis_n: f64,
    /// Standard error of that, N.
    pub hysteresis_se_n: f64,
    /// Gravity at the place, m/s^2.
    pub gravity_m_per_s2: f64,
    /// Who weighed; empty: nobody said.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub operator: String,
    /// Remarks.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// How the weights loaded the cell, in words; empty: nobody said.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub loading: String,
    /// Load (N), residual and its expected standard deviation (mN) of each reading.
    pub residuals: Vec<[f64; 3]>,
    /// The weights.
    pub weights: WeightsRecord,
    /// Temperature; none where nobody said and no sensor gave it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<TemperatureRecord>,
    /// The figures of ISO 376, where its procedure was followed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iso376: Option<Iso376Record>,
}

impl GainRecord {
    /// Relative standard uncertainties of the scale with their names.
    #[must_use]
    pub fn budget(&self) -> [(&'static str, f64); 6] {
        [
            ("readings (A)", self.readings_sd),
            ("next mounting (A)", self.remounting_sd),
            ("weights (B)", self.weights_sd),
            ("gravity, air (B)", self.gravity_sd),
            ("pulley (B)", self.pulley_sd),
            ("beyond the weights (B)", self.beyond_sd),
        ]
    }

    /// All of them together.
    #[must_use]
    pub fn combined_sd(&self) -> f64 {
        self.budget()
            .iter()
            .map(|(_, sd)| sd * sd)
            .sum::<f64>()
            .sqrt()
    }

    /// Standard uncertainty of a force on the cell from its hysteresis, N. The scale goes through
    /// the middle of the loop, and any place in it is as likely as another: a rectangle as wide as
    /// the loop. 0 where the readings show none.
    #[must_use]
    pub fn hysteresis_sd_n(&self) -> f64 {
        if self.hysteresis_n.abs() > 2.0 * self.hysteresis_se_n {
            self.hysteresis_n.abs() / 12f64.sqrt()
        } else {
            0.0
        }
    }
}

// What is 0 is left out of the text and of the hash, so that a record of version 1 keeps its own.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_none(value: &u32) -> bool {
    *value == 0
}

/// Covariance between the exit points of two units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrossCovariance {
    /// Unit of the rows.
    pub a: u8,
    /// Unit of the columns, above `a`.
    pub b: u8,
    /// Covariance of `[exit_m, axis]` of both, by rows, 36 numbers.
    pub covariance: Vec<f64>,
}

/// What is wrong with a record.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RecordError {
    /// The text is no TOML, or a key is unknown, missing or of the wrong type.
    #[error("{at}: {problem}")]
    Syntax {
        /// Where.
        at: Location,
        /// What the parser says; names the key.
        problem: String,
    },
    /// A value that can't be.
    #[error("{at}: `{key}` {problem}")]
    Value {
        /// Where.
        at: Location,
        /// The key with its table.
        key: String,
        /// What is wrong with it.
        problem: String,
    },
    /// Another version of the keys.
    #[error("{at}: `schema` is {found}; this program reads {OLDEST_SCHEMA} to {SCHEMA}: read the record with the forcectl that wrote it, or calibrate again")]
    Schema {
        /// Where.
        at: Location,
        /// Version found.
        found: u32,
    },
    /// The content is not what was written.
    #[error("{at}: `hash` does not match the content ({expected}): the file was changed after it was written; restore it or calibrate again")]
    Hash {
        /// Where.
        at: Location,
        /// The hash of the content.
        expected: String,
    },
}

impl Record {
    /// Reads and checks a record. `file` is the name that errors give.
    ///
    /// # Errors
    /// [`RecordError`] with the first problem.
    pub fn read(file: &str, text: &str) -> Result<Self, RecordError> {
        let record: Self = toml::from_str(text).map_err(|e| syntax(file, text, &e))?;
        let lines = Lines { file, text };
        if !(OLDEST_SCHEMA..=SCHEMA).contains(&record.schema) {
            return Err(RecordError::Schema {
                at: lines.at(None, "schema"),
                found: record.schema,
            });
        }
        record.check(&lines)?;
        let expected = record.content_hash();
        if record.hash != expected {
            return Err(RecordError::Hash {
                at: lines.at(None, "hash"),
                expected,
            });
        }
        Ok(record)
    }

    /// The text of the record, with its hash. Numbers are written so that they read back bit by
    /// bit.
    ///
    /// # Errors
    /// [`RecordError::Value`] where the record holds a value that [`Record::read`] would refuse.
    pub fn write(&self) -> Result<String, RecordError> {
        let lines = Lines {
            file: "record",
            text: "",
        };
        self.check(&lines)?;
        let mut out = self.clone();
        out.schema = SCHEMA;
        out.hash = out.content_hash();
        toml::to_string(&out).map_err(|e| RecordError::Syntax {
            at: lines.at(None, ""),
            problem: e.to_string(),
        })
    }

    /// `sha256:` and the SHA-256 of the content without the hash itself: the same for equal
    /// calibrations however the text is laid out.
    #[must_use]
    pub fn content_hash(&self) -> String {
        let mut bare = self.clone();
        bare.hash = String::new();
        // Serialising plain numbers and strings to a String can't fail; an empty text would match
        // no hash.
        let text = toml::to_string(&bare).unwrap_or_default();
        format!("sha256:{}", files::sha256_of(text))
    }

    /// SHA-256 of what makes forces of codes: the same until a gain is measured again, whatever
    /// else changes.
    #[must_use]
    pub fn gains_hash(&self) -> String {
        let gains: Vec<String> = (self.units.iter())
            .map(|u| {
                format!(
                    "{} {:e} {:e} {:e} {:e}",
                    u.number, u.n_per_code, u.n_per_code2, u.creep, u.creep_s
                )
            })
            .collect();
        files::sha256_of(gains.join("\n"))
    }

    /// SHA-256 of what makes a force at the tip of codes: gains, exit points and axes.
    #[must_use]
    pub fn tip_hash(&self) -> String {
        let places: Vec<String> = (self.units.iter())
            .map(|u| format!("{:?} {:?}", u.exit_m, u.axis))
            .collect();
        files::sha256_of(format!("{}\n{}", self.gains_hash(), places.join("\n")))
    }

    fn check(&self, lines: &Lines<'_>) -> Result<(), RecordError> {
        let fail = |unit: Option<usize>, key: &str, problem: &str| -> Result<(), RecordError> {
            Err(RecordError::Value {
                at: lines.at(unit, key),
                key: match unit {
                    Some(i) => format!("unit[{}].{key}", i + 1),
                    None => key.to_owned(),
                },
                problem: problem.to_owned(),
            })
        };
        if !is_date(&self.date) {
            return fail(None, "date", "is not a date; write YYYY-MM-DD");
        }
        if !crate::gravity::ON_EARTH_M_PER_S2.contains(&self.gravity_m_per_s2) {
            return fail(
                None,
                "gravity_m_per_s2",
                "is no acceleration of gravity on Earth: 9.76 to 9.84 m/s^2",
            );
        }
        if !(0.0..0.1).contains(&self.common_gain_relative_sd) {
            return fail(
                None,
                "common_gain_relative_sd",
                "has to be 0 to 0.1 (relative)",
            );
        }
        if !(0.0..0.1).contains(&self.gravity_relative_sd) {
            return fail(None, "gravity_relative_sd", "has to be 0 to 0.1 (relative)");
        }
        if self.units.is_empty() {
            return fail(
                None,
                "unit",
                "is missing: a record has at least one [[unit]]",
            );
        }
        for (i, unit) in self.units.iter().enumerate() {
            if unit.number == 0 || self.units[..i].iter().any(|u| u.number >= unit.number) {
                return fail(
                    Some(i),
                    "number",
                    "has to be 1 or more and rise from unit to unit",
                );
            }
            for (key, date) in [
                ("gain_date", &unit.gain_date),
                ("zero_date", &unit.zero_date),
                ("geometry_date", &unit.geometry_date),
            ] {
                if !(date.is_empty() || is_date(date)) {
                    return fail(
                        Some(i),
                        key,
                        "is not a date; write YYYY-MM-DD, or leave it out",
                    );
                }
            }
            for (key, value) in [
                ("n_per_code", unit.n_per_code),
                ("n_per_code2", unit.n_per_code2),
                ("creep", unit.creep),
                ("zero_codes", unit.zero_codes),
                ("mounting_n", unit.mounting_n),
            ] {
                if !value.is_finite() {
                    return fail(Some(i), key, "has to be finite");
                }
            }
            for (key, value) in [
                ("n_per_code_sd", unit.n_per_code_sd),
                ("n_per_code2_sd", unit.n_per_code2_sd),
                ("creep_sd", unit.creep_sd),
                ("creep_s", unit.creep_s),
                ("zero_sd_codes", unit.zero_sd_codes),
                ("mounting_sd_n", unit.mounting_sd_n),
                ("power_up_step_n", unit.power_up_step_n),
            ] {
                if !(value >= 0.0 && value.is_finite()) {
                    return fail(
                        Some(i),
                        key,
                        "is a standard deviation: finite and 0 or above",
                    );
                }
            }
            if let Some(gain) = &unit.gain {
                let numbers = [
                    gain.largest_n,
                    gain.half_95_relative,
                    gain.readings_sd,
                    gain.weights_sd,
                    gain.gravity_sd,
                    gain.beyond_sd,
                    gain.remounting_sd,
                    gain.pulley_sd,
                    gain.repeatability_n,
                    gain.chi_square,
                    gain.hysteresis_se_n,
                    gain.gravity_m_per_s2,
                    gain.weights.correlation,
                ];
                let signed = [gain.linearity_n, gain.hysteresis_n];
                let warm = gain.temperature.unwrap_or_default();
                let warm = [warm.from_c, warm.to_c, warm.scale_per_k, warm.zero_n_per_k];
                let standard = gain.iso376.iter();
                let standard = standard.flat_map(|iso| {
                    let whole = [iso.from_n, iso.to_n, iso.zero, iso.resolution_n];
                    let loads = iso.loads.iter().flatten().copied();
                    whole.into_iter().chain(iso.creep).chain(loads)
                });
                let further: Vec<f64> = warm.into_iter().chain(standard).collect();
                let residuals = gain.residuals.iter().flatten().chain(&further);
                let sound = numbers.iter().all(|v| *v >= 0.0 && v.is_finite())
                    && signed.iter().chain(residuals).all(|v| v.is_finite());
                if !sound {
                    return fail(
                        Some(i),
                        "gain",
                        "has a figure that is not finite, or negative where it can't be",
                    );
                }
            }
            if unit.creep != 0.0 && unit.creep_s == 0.0 {
                return fail(
                    Some(i),
                    "creep_s",
                    "is missing: a cell that creeps has a time constant",
                );
            }
            if unit.n_per_code == 0.0 {
                return fail(
                    Some(i),
                    "n_per_code",
                    "is 0: the cell would never see a force",
                );
            }
            if !unit.exit_m.iter().all(|v| v.abs() < 10.0) {
                return fail(
                    Some(i),
                    "exit_m",
                    "has to be finite and within 10 m; are these millimetres?",
                );
            }
            let unit_length = (Vector3::from(unit.axis).norm() - 1.0).abs() < 1e-3;
            if !unit_length {
                return fail(Some(i), "axis", "has to be of unit length");
            }
            if unit.covariance.len() != 21 {
                return fail(
                    Some(i),
                    "covariance",
                    "has to have 21 numbers: the upper triangle of 6 x 6 by rows",
                );
            }
            if !is_covariance(&unit.covariance_matrix()) {
                return fail(
                    Some(i),
                    "covariance",
                    "is no covariance: finite, with no negative eigenvalue",
                );
            }
        }
        for pair in &self.cross {
            let known = |n: u8| self.units.iter().any(|u| u.number == n);
            if !(known(pair.a) && known(pair.b) && pair.a < pair.b) {
                return fail(
                    None,
                    "exit_cross_covariance",
                    "needs two units of this record, a below b",
                );
            }
            if pair.covariance.len() != 36 || !pair.covariance.iter().all(|v| v.is_finite()) {
                return fail(
                    None,
                    "exit_cross_covariance",
                    "has to have 36 finite numbers",
                );
            }
        }
        Ok(())
    }

    /// Covariance of exit points and axes of all units, six rows a unit, for
    /// [`crate::uncertainty`].
    #[must_use]
    pub fn geometry_covariance(&self) -> DMatrix<f64> {
        let n = self.units.len();
        let mut out = DMatrix::zeros(6 * n, 6 * n);
        for (i, unit) in self.units.iter().enumerate() {
            out.fixed_view_mut::<6, 6>(6 * i, 6 * i)
                .copy_from(&unit.covariance_matrix());
        }
        let place = |number: u8| self.units.iter().position(|u| u.number == number);
        for pair in &self.cross {
            if let (Some(a), Some(b), 36) = (place(pair.a), place(pair.b), pair.covariance.len()) {
                let block = SMatrix::<f64, 6, 6>::from_row_slice(&pair.covariance);
                out.fixed_view_mut::<6, 6>(6 * a, 6 * b).copy_from(&block);
                out.fixed_view_mut::<6, 6>(6 * b, 6 * a)
                    .copy_from(&block.transpose());
            }
        }
        out
    }

    /// Puts the covariance of all units in, six rows a unit in the order of [`Self::units`]; false
    /// where its size is another.
    pub fn set_geometry_covariance(&mut self, all: &DMatrix<f64>) -> bool {
        let n = self.units.len();
        if all.nrows() != 6 * n || all.ncols() != 6 * n {
            return false;
        }
        self.cross.clear();
        for i in 0..n {
            let block: SMatrix<f64, 6, 6> = all.fixed_view::<6, 6>(6 * i, 6 * i).into_owned();
            self.units[i].set_covariance(&block);
            for j in i + 1..n {
                let block: SMatrix<f64, 6, 6> = all.fixed_view::<6, 6>(6 * i, 6 * j).into_owned();
                if block.amax() > 0.0 {
                    self.cross.push(CrossCovariance {
                        a: self.units[i].number,
                        b: self.units[j].number,
                        covariance: block.transpose().iter().copied().collect(),
                    });
                }
            }
        }
        true
    }
}

impl UnitRecord {
    /// Relative standard uncertainty of the scale at a force, N, without what all units share. What
    /// the weights leave open beyond the largest one does not count for a force that they reach.
    #[must_use]
    pub fn scale_relative_sd(&self, force_n: f64) -> f64 {
        let all = self.n_per_code_sd / self.n_per_code.abs();
        let within = (self.gain.as_ref()).filter(|gain| force_n <= gain.largest_n);
        let beyond = within.map_or(0.0, |gain| gain.beyond_sd);
        (all * all - beyond * beyond).max(0.0).sqrt()
    }

    /// Serial numbers with their keys; empty where there is none.
    #[must_use]
    pub fn serials(&self) -> [(&'static str, &str); 4] {
        [
            ("unit_serial", &self.unit_serial),
            ("motor_serial", &self.motor_serial),
            ("cell_serial", &self.cell_serial),
            ("converter_serial", &self.converter_serial),
        ]
    }

    /// Covariance of `[exit_m, axis]`; 0 where the list has not 21 numbers.
    #[must_use]
    pub fn covariance_matrix(&self) -> SMatrix<f64, 6, 6> {
        let mut out = SMatrix::zeros();
        if self.covariance.len() == 21 {
            let mut numbers = self.covariance.iter();
            for i in 0..6 {
                for j in i..6 {
                    let value = numbers.next().copied().unwrap_or(0.0);
                    out[(i, j)] = value;
                    out[(j, i)] = value;
                }
            }
        }
        out
    }

    /// Puts a covariance of `[exit_m, axis]` in.
    pub fn set_covariance(&mut self, matrix: &SMatrix<f64, 6, 6>) {
        self.covariance = (0..6)
            .flat_map(|i| (i..6).map(move |j| (i, j)))
            .map(|(i, j)| matrix[(i, j)])
            .collect();
    }
}

fn is_covariance(matrix: &SMatrix<f64, 6, 6>) -> bool {
    if !matrix.iter().all(|v| v.is_finite()) {
        return false;
    }
    // An axis has no variance along itself: rounding may put an eigenvalue just below 0. Positions
    // and axes have different units: compare in units of the standard deviations.
    let sd = matrix.diagonal().map(|v| v.max(0.0).sqrt());
    if matrix.diagonal().iter().any(|v| *v < 0.0) {
        return false;
    }
    let scaled = SMatrix::<f64, 6, 6>::from_fn(|i, j| {
        let size = sd[i] * sd[j];
        if size > 0.0 {
            matrix[(i, j)] / size
        } else {
            // No variance and yet a covariance is impossible; an identity entry otherwise.
            match (i == j, matrix[(i, j)] == 0.0) {
                (true, _) => 1.0,
                (false, true) => 0.0,
                (false, false) => 2.0,
            }
        }
    });
    SymmetricEigen::new(scaled).eigenvalues.min() > -1e-6
}

fn is_date(text: &str) -> bool {
    let parts: Vec<&str> = text.split('-').collect();
    let digits = |t: &str, n: usize| t.len() == n && t.bytes().all(|b| b.is_ascii_digit());
    let [year, month, day] = parts[..] else {
        return false;
    };
    if !(digits(year, 4) && digits(month, 2) && digits(day, 2)) {
        return false;
    }
    let (y, m, d): (u32, u32, u32) = match (year.parse(), month.parse(), day.parse()) {
        (Ok(y), Ok(m), Ok(d)) => (y, m, d),
        _ => return false,
    };
    let leap = y % 4 == 0 && (y % 100 != 0 || y % 400 == 0);
    let most = match m {
        2 if leap => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return false,
    };
    (1..=most).contains(&d)
}

/// Finds the line of a key.
struct Lines<'t> {
    file: &'t str,
    text: &'t str,
}

impl Lines<'_> {
    /// Line of `key` at the top (`None`) or in the unit with this index; of the unit's header where
    /// the key isn't there.
    fn at(&self, unit: Option<usize>, key: &str) -> Location {
        let mut seen = 0;
        let mut line = 1;
        for (i, content) in self.text.lines().enumerate() {
            let content = content.trim();
            if content.starts_with("[[unit]]") {
                seen += 1;
                if unit == Some(seen - 1) {
                    line = i + 1;
                }
            } else if content.trim_matches(['[', ']']) == key && content.starts_with('[') {
                line = i + 1;
                break;
            }
            let name = content.split('=').next().unwrap_or("").trim();
            let here = match unit {
                None => seen == 0,
                Some(u) => seen == u + 1,
            };
            if here && name == key && content.contains('=') {
                line = i + 1;
                break;
            }
        }
        Location {
            file: Arc::from(self.file),
            line,
        }
    }
}

fn syntax(file: &str, text: &str, error: &toml::de::Error) -> RecordError {
    let start = error.span().map_or(0, |s| s.start.min(text.len()));
    let line = 1 + text.as_bytes()[..start]
        .iter()
        .filter(|b| **b == b'\n')
        .count();
    let content = text.lines().nth(line - 1).unwrap_or("");
    let key = content.split('=').next().unwrap_or("").trim();
    let message = error.message().trim();
    let problem = if key.is_empty() || message.contains(&format!("`{key}`")) {
        message.to_owned()
    } else {
        format!("`{key}`: {message}")
    };
    RecordError::Syntax {
        at: Location {
            file: Arc::from(file),
            line,
        },
        problem,
    }
}

#[cfg(test)]
mod tests;
