//! The calibration of a rig as one TOML text: zeros, gains, exit points and axes with their covariances, serial numbers, date
//! and a hash over all of it.
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
//! [`Record::write`] puts the hash in, [`Record::read`] refuses a text whose hash is not that of its content: an edit by
//! hand is seen. Reading is strict: unknown keys, missing keys, wrong types and values that can't be are errors with
//! file, line and key. The caller gives the date; the crate has no clock.

use crate::input::Location;
use nalgebra::{DMatrix, Matrix3, SMatrix, SymmetricEigen, Vector3};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Version of the keys. Version 2 has the creep of a cell, the uncertainty of its curve, and serial numbers of unit and motor;
/// a record of version 1 is read as one of cells that do not creep.
pub const SCHEMA: u32 = 2;
/// The oldest version that is read.
pub const OLDEST_SCHEMA: u32 = 1;

/// The calibration of a rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Version of the keys: [`SCHEMA`].
    pub schema: u32,
    /// `sha256:` and 64 hexadecimal digits over the text without this line; set by [`Record::write`].
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub hash: String,
    /// Date of the calibration, `YYYY-MM-DD`.
    pub date: String,
    /// Name of the rig.
    pub rig: String,
    /// Who or what made it, and remarks.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Local acceleration of gravity used, m/s^2.
    pub gravity_m_per_s2: f64,
    /// Relative standard uncertainty of the gain that all units share: gravity, one set of weights.
    pub common_gain_relative_sd: f64,
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
}

// What is 0 is left out of the text and of the hash, so that a record of version 1 keeps its own.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
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

    /// The text of the record, with its hash. Numbers are written so that they read back bit by bit.
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

    /// `sha256:` and the SHA-256 of the content without the hash itself: the same for equal calibrations however the
    /// text is laid out.
    #[must_use]
    pub fn content_hash(&self) -> String {
        let mut bare = self.clone();
        bare.hash = String::new();
        // Serialising plain numbers and strings to a String can't fail; an empty text would match no hash.
        let text = toml::to_string(&bare).unwrap_or_default();
        let digest = Sha256::digest(text.as_bytes());
        let hex: String = digest.iter().map(|b| format!("{b:02x}")).collect();
        format!("sha256:{hex}")
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
        if !(9.7..=9.9).contains(&self.gravity_m_per_s2) {
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

    /// Covariance of exit points and axes of all units, six rows a unit, for [`crate::uncertainty`].
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

    /// Puts the covariance of all units in, six rows a unit in the order of [`Self::units`]; false where its size is
    /// another.
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

    /// What differs from an older record, unit by unit.
    #[must_use]
    pub fn diff(&self, older: &Self) -> Vec<Difference> {
        let mut out = Vec::new();
        let mut text = |key: String, old: &str, new: &str| {
            if old != new {
                out.push(Difference {
                    key,
                    old: old.to_owned(),
                    new: new.to_owned(),
                    sigmas: None,
                });
            }
        };
        text("date".into(), &older.date, &self.date);
        text("rig".into(), &older.rig, &self.rig);
        text("note".into(), &older.note, &self.note);
        for (key, old, new) in [
            (
                "gravity_m_per_s2",
                older.gravity_m_per_s2,
                self.gravity_m_per_s2,
            ),
            (
                "common_gain_relative_sd",
                older.common_gain_relative_sd,
                self.common_gain_relative_sd,
            ),
        ] {
            text(key.into(), &old.to_string(), &new.to_string());
        }
        let numbers = |r: &Self| -> BTreeMap<u8, UnitRecord> {
            r.units.iter().map(|u| (u.number, u.clone())).collect()
        };
        let (before, now) = (numbers(older), numbers(self));
        for (number, old) in &before {
            if !now.contains_key(number) {
                text(format!("unit {number}"), "there", "missing");
            } else {
                let new = &now[number];
                for (key, a, b) in [
                    ("gain_date", &old.gain_date, &new.gain_date),
                    ("zero_date", &old.zero_date, &new.zero_date),
                    ("geometry_date", &old.geometry_date, &new.geometry_date),
                ] {
                    text(format!("unit {number} {key}"), a, b);
                }
                for ((key, a), (_, b)) in old.serials().into_iter().zip(new.serials()) {
                    text(format!("unit {number} {key}"), a, b);
                }
            }
        }
        for number in now.keys().filter(|n| !before.contains_key(n)) {
            text(format!("unit {number}"), "missing", "there");
        }
        for (number, new) in &now {
            if let Some(old) = before.get(number) {
                out.extend(unit_diff(*number, old, new));
            }
        }
        out
    }
}

fn unit_diff(number: u8, old: &UnitRecord, new: &UnitRecord) -> Vec<Difference> {
    let mut out = Vec::new();
    let mut push = |key: &str, a: String, b: String, sigmas: Option<f64>| {
        if a != b {
            out.push(Difference {
                key: format!("unit {number} {key}"),
                old: a,
                new: b,
                sigmas: sigmas.filter(|s| s.is_finite()),
            });
        }
    };
    let apart = |a: f64, b: f64, sa: f64, sb: f64| Some((b - a).abs() / sa.hypot(sb));
    push(
        "n_per_code",
        old.n_per_code.to_string(),
        new.n_per_code.to_string(),
        apart(
            old.n_per_code,
            new.n_per_code,
            old.n_per_code_sd,
            new.n_per_code_sd,
        ),
    );
    push(
        "n_per_code2",
        old.n_per_code2.to_string(),
        new.n_per_code2.to_string(),
        apart(
            old.n_per_code2,
            new.n_per_code2,
            old.n_per_code2_sd,
            new.n_per_code2_sd,
        ),
    );
    push(
        "creep",
        old.creep.to_string(),
        new.creep.to_string(),
        apart(old.creep, new.creep, old.creep_sd, new.creep_sd),
    );
    // A zero moves by a step at each power-up: that is the scale of its change.
    let step = |u: &UnitRecord| {
        u.zero_sd_codes
            .hypot(u.power_up_step_n / u.n_per_code.abs())
    };
    push(
        "zero_codes",
        old.zero_codes.to_string(),
        new.zero_codes.to_string(),
        apart(old.zero_codes, new.zero_codes, step(old), step(new)),
    );
    push(
        "mounting_n",
        old.mounting_n.to_string(),
        new.mounting_n.to_string(),
        apart(
            old.mounting_n,
            new.mounting_n,
            old.mounting_sd_n,
            new.mounting_sd_n,
        ),
    );
    for (key, a, b) in [
        ("n_per_code_sd", old.n_per_code_sd, new.n_per_code_sd),
        ("creep_s", old.creep_s, new.creep_s),
        ("zero_sd_codes", old.zero_sd_codes, new.zero_sd_codes),
        ("mounting_sd_n", old.mounting_sd_n, new.mounting_sd_n),
        ("power_up_step_n", old.power_up_step_n, new.power_up_step_n),
    ] {
        push(key, a.to_string(), b.to_string(), None);
    }
    let both = old.covariance_matrix() + new.covariance_matrix();
    let exit = Vector3::from(new.exit_m) - Vector3::from(old.exit_m);
    let block: Matrix3<f64> = both.fixed_view::<3, 3>(0, 0).into_owned();
    push(
        "exit_m",
        format!("{:?}", old.exit_m),
        format!("{:?}", new.exit_m),
        block
            .try_inverse()
            .map(|w| (exit.transpose() * w * exit)[0].max(0.0).sqrt()),
    );
    let turn = Vector3::from(old.axis)
        .cross(&Vector3::from(new.axis))
        .norm();
    let block: Matrix3<f64> = both.fixed_view::<3, 3>(3, 3).into_owned();
    push(
        "axis",
        format!("{:?}", old.axis),
        format!("{:?}", new.axis),
        Some(turn / SymmetricEigen::new(block).eigenvalues.max().max(0.0).sqrt()),
    );
    push(
        "covariance",
        format!("{:?}", old.covariance),
        format!("{:?}", new.covariance),
        None,
    );
    out
}

/// A value that differs between two records.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// What it is.
    pub key: String,
    /// In the older record.
    pub old: String,
    /// In the newer record.
    pub new: String,
    /// Size of the change in standard deviations of both together, where that is known. Above 3 to 4 it is more than
    /// the calibrations' own errors explain.
    pub sigmas: Option<f64>,
}

impl UnitRecord {
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
    // An axis has no variance along itself: rounding may put an eigenvalue just below 0. Positions and axes have different
    // units: compare in units of the standard deviations.
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
    /// Line of `key` at the top (`None`) or in the unit with this index; of the unit's header where the key isn't
    /// there.
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
mod tests {
    use super::*;
    use crate::geometry::testing::UNITS;
    use proptest::prelude::*;

    fn record() -> Record {
        let units = UNITS
            .iter()
            .enumerate()
            .map(|(i, (exit, axis))| {
                let mut unit = UnitRecord {
                    number: i as u8 + 1,
                    unit_serial: String::new(),
                    motor_serial: String::new(),
                    cell_serial: format!("SBA-{i:04}"),
                    converter_serial: String::new(),
                    gain_date: "2026-03-14".into(),
                    zero_date: String::new(),
                    geometry_date: String::new(),
                    n_per_code: 6.85e-6 * (1.0 + 0.01 * i as f64),
                    n_per_code_sd: 2.1e-9,
                    n_per_code2: 0.0,
                    n_per_code2_sd: 0.0,
                    creep: 0.0,
                    creep_sd: 0.0,
                    creep_s: 0.0,
                    zero_codes: 12_345.678_9,
                    zero_sd_codes: 31.0,
                    mounting_n: 1.0 / 3.0,
                    mounting_sd_n: 0.05,
                    power_up_step_n: 0.1,
                    exit_m: *exit,
                    axis: Vector3::from(*axis).normalize().into(),
                    covariance: Vec::new(),
                };
                let axis = Vector3::from(unit.axis);
                let mut covariance = SMatrix::<f64, 6, 6>::identity() * 4e-8;
                covariance
                    .fixed_view_mut::<3, 3>(3, 3)
                    .copy_from(&((Matrix3::identity() - axis * axis.transpose()) * 1e-5));
                unit.set_covariance(&covariance);
                unit
            })
            .collect();
        Record {
            schema: SCHEMA,
            hash: String::new(),
            date: "2026-03-14".into(),
            rig: "raven-left".into(),
            note: String::new(),
            gravity_m_per_s2: 9.81,
            common_gain_relative_sd: 1e-4,
            units,
            cross: Vec::new(),
        }
    }

    #[test]
    fn what_is_written_reads_back_bit_by_bit() {
        let mut written = record();
        let mut all = written.geometry_covariance();
        all[(0, 6)] = 1e-8;
        all[(6, 0)] = 1e-8;
        assert!(written.set_geometry_covariance(&all));
        assert_eq!(written.cross.len(), 1);
        let text = written.write().unwrap();
        let read = Record::read("c.toml", &text).unwrap();
        written.hash = read.hash.clone();
        assert_eq!(read, written);
        assert_eq!(read.geometry_covariance(), all);
        assert!(read.diff(&written).is_empty());
        assert_eq!(read.write().unwrap(), text);
        // Layout and comments are not content.
        let spaced = text.replace(" = ", "  =  ") + "\n# a remark\n";
        assert!(Record::read("c.toml", &spaced).is_ok());
    }

    #[test]
    fn a_record_of_the_first_version_is_read_as_it_was_written() {
        // The first version had the same keys without creep, and the hash over them.
        let mut first = record();
        first.schema = 1;
        first.hash = first.content_hash();
        let text = toml::to_string(&first).unwrap();
        assert!(text.starts_with("schema = 1\n") && !text.contains("creep"));
        let read = Record::read("c.toml", &text).unwrap();
        assert_eq!(read.units[0].creep, 0.0);
        let mut crept = read;
        crept.units[0].creep = 0.01;
        assert!(crept.write().is_err(), "creep without a time constant");
        crept.units[0].creep_s = 60.0;
        let now = Record::read("c.toml", &crept.write().unwrap()).unwrap();
        assert_eq!((now.schema, now.units[0].creep), (SCHEMA, 0.01));
        assert_ne!(now.content_hash(), first.hash);
        let differences = now.diff(&first);
        assert!(differences.iter().any(|d| d.key == "unit 1 creep"));
    }

    #[test]
    fn an_edit_by_hand_is_seen() {
        let text = record().write().unwrap();
        let edited = text.replacen("zero_codes = 12345.6789", "zero_codes = 12345.6788", 1);
        assert_ne!(edited, text);
        let error = Record::read("c.toml", &edited).unwrap_err();
        assert!(
            matches!(&error, RecordError::Hash { at, .. } if at.line == 2),
            "{error}"
        );
    }

    #[test]
    fn every_mistake_names_line_and_key() {
        let text = record().write().unwrap();
        let line_of = |needle: &str| 1 + text.lines().position(|l| l.starts_with(needle)).unwrap();
        for (from, to, line, word) in [
            (
                "zero_sd_codes = 31.0",
                "zero_sd_codes = -31.0",
                line_of("zero_sd_codes"),
                "zero_sd_codes",
            ),
            (
                "zero_sd_codes = 31.0",
                "zero_sd_codes = nan",
                line_of("zero_sd_codes"),
                "zero_sd_codes",
            ),
            (
                "zero_sd_codes = 31.0",
                "zero_sd_codes = \"x\"",
                line_of("zero_sd_codes"),
                "zero_sd_codes",
            ),
            (
                "zero_sd_codes = 31.0",
                "zero_sd = 31.0",
                line_of("zero_sd_codes"),
                "zero_sd",
            ),
            ("schema = 2", "schema = 3", 1, "schema"),
            (
                "date = \"2026-03-14\"",
                "date = \"2026-02-30\"",
                line_of("date"),
                "date",
            ),
            (
                "number = 2",
                "number = 1",
                1 + text.lines().position(|l| l == "number = 2").unwrap(),
                "unit[2].number",
            ),
            ("rig = \"raven-left\"", "rig = raven", line_of("rig"), "rig"),
        ] {
            let edited = text.replacen(from, to, 1);
            assert_ne!(edited, text, "{from}");
            let message = Record::read("c.toml", &edited).unwrap_err().to_string();
            assert!(
                message.starts_with(&format!("c.toml:{line}: ")),
                "{line} {message}"
            );
            assert!(message.contains(word), "{word}: {message}");
        }
        let missing: String = text
            .lines()
            .filter(|l| !l.starts_with("gravity"))
            .map(|l| format!("{l}\n"))
            .collect();
        let message = Record::read("c.toml", &missing).unwrap_err().to_string();
        assert!(message.contains("gravity_m_per_s2"), "{message}");
        assert!(Record::read("c.toml", "").is_err());
    }

    #[test]
    fn impossible_values_are_not_written() {
        for change in [
            (|r: &mut Record| r.units[0].exit_m[0] = 335.0) as fn(&mut Record),
            |r| r.units[0].axis = [0.0; 3],
            |r| r.units[0].covariance[0] = -1.0,
            |r| r.units[0].covariance[1] = 1.0,
            |r| r.units[0].covariance.truncate(6),
            |r| r.units[0].n_per_code = 0.0,
            |r| r.units.clear(),
            |r| r.gravity_m_per_s2 = f64::NAN,
        ] {
            let mut bad = record();
            change(&mut bad);
            assert!(matches!(bad.write(), Err(RecordError::Value { .. })));
        }
    }

    #[test]
    fn differences_are_told_in_standard_deviations() {
        let old = record();
        let mut new = old.clone();
        new.units[2].exit_m[1] += 0.002;
        new.units[4].n_per_code *= 1.0001;
        new.units[5].cell_serial = "other".into();
        let found = new.diff(&old);
        assert_eq!(found.len(), 3, "{found:?}");
        let exit = found.iter().find(|d| d.key == "unit 3 exit_m").unwrap();
        assert!((exit.sigmas.unwrap() - 0.002 / (2.0 * 4e-8f64).sqrt()).abs() < 1e-6);
        let gain = found.iter().find(|d| d.key == "unit 5 n_per_code").unwrap();
        assert!(gain.sigmas.unwrap() < 1.0);
        assert_eq!(found.iter().filter(|d| d.sigmas.is_none()).count(), 1);
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "\\PC{0,80}", cut in 0usize..2000) {
            let _ = Record::read("f", &text);
            let good = record().write().unwrap();
            let short: String = good.chars().take(cut).collect();
            prop_assert!(Record::read("f", &short).is_err());
        }
    }
}
