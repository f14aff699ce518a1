//! A rig's calibration before anything was measured, and how a calibration enters the settings of a
//! rig file.
//!
//! A [`Record`] has an entry for every unit, measured or not. What was not measured is the rig
//! file's, with the uncertainty of a nominal value, and has no date. Only what has a date replaces
//! the rig file's numbers.

use crate::checks::Validity;
use crate::store::Store;
use crate::{Result, StoreError};
use calibration::record::{Record, UnitRecord, SCHEMA};
use calibration::STANDARD_GRAVITY_M_PER_S2;
use nalgebra::{Matrix3, SMatrix};
use rig::{CellSettings, Rig};

/// Relative standard uncertainty of a nominal scale: the rig's files have 6.2e-6 to 7.3e-6 N per
/// code.
pub const NOMINAL_SCALE_SD: f64 = 0.05;
/// Standard uncertainty of a coordinate taken with a tape measure, m.
pub const NOMINAL_POSITION_SD_M: f64 = 0.005;
/// Standard uncertainty of an axis taken with a protractor, about each perpendicular, rad.
pub const NOMINAL_AXIS_SD_RAD: f64 = 0.035;
/// Standard error of the zero that the board takes by itself, N: 256 samples of 5 mN, correlated.
pub const BOARD_ZERO_SD_N: f64 = 0.0005;

/// The calibration of a rig of which nothing was measured.
#[must_use]
pub fn nominal(rig: &Rig, date: &str) -> Record {
    let units = rig
        .units
        .iter()
        .map(|unit| {
            // A rig file rounds its axes: off unit length, the covariance across them would not be
            // one.
            let axis = unit.axis.normalize();
            let mut out = UnitRecord {
                number: unit.number,
                unit_serial: String::new(),
                motor_serial: String::new(),
                cell_serial: String::new(),
                converter_serial: String::new(),
                gain_date: String::new(),
                zero_date: String::new(),
                geometry_date: String::new(),
                n_per_code: unit.scale_n_per_count,
                n_per_code_sd: NOMINAL_SCALE_SD * unit.scale_n_per_count.abs(),
                n_per_code2: 0.0,
                n_per_code2_sd: 0.0,
                creep: 0.0,
                creep_sd: 0.0,
                creep_s: 0.0,
                zero_codes: unit.checks.zero_code,
                zero_sd_codes: BOARD_ZERO_SD_N / unit.scale_n_per_count.abs(),
                mounting_n: 0.0,
                mounting_sd_n: 0.0,
                power_up_step_n: 0.0,
                exit_m: unit.exit_m.into(),
                axis: axis.into(),
                covariance: Vec::new(),
                gain: None,
            };
            let mut covariance = SMatrix::<f64, 6, 6>::zeros();
            let across = Matrix3::identity() - axis * axis.transpose();
            covariance
                .fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&(Matrix3::identity() * NOMINAL_POSITION_SD_M.powi(2)));
            covariance
                .fixed_view_mut::<3, 3>(3, 3)
                .copy_from(&(across * NOMINAL_AXIS_SD_RAD.powi(2)));
            out.set_covariance(&covariance);
            out
        })
        .collect();
    Record {
        schema: SCHEMA,
        hash: String::new(),
        date: date.to_owned(),
        rig: rig.name.clone(),
        note: String::new(),
        valid_days: 0,
        gravity_m_per_s2: STANDARD_GRAVITY_M_PER_S2,
        common_gain_relative_sd: 0.0,
        gravity_relative_sd: 0.0,
        units,
        cross: Vec::new(),
    }
}

/// The record of a rig to go on with: the stored one, with the units that the rig file has now.
///
/// # Errors
/// The stored record is of another rig.
pub fn continued(
    rig: &Rig,
    stored: Option<Record>,
    date: &str,
) -> std::result::Result<Record, String> {
    let fresh = nominal(rig, date);
    let Some(mut record) = stored else {
        return Ok(fresh);
    };
    if record.rig != rig.name {
        return Err(format!(
            "the stored calibration is of rig `{}`, and the rig file is of `{}`",
            record.rig, rig.name
        ));
    }
    for (old, new) in record.units.iter_mut().zip(fresh.units) {
        // What was not measured follows the rig file.
        if old.gain_date.is_empty() {
            (old.n_per_code, old.n_per_code_sd) = (new.n_per_code, new.n_per_code_sd);
        }
        if old.geometry_date.is_empty() {
            (old.exit_m, old.axis) = (new.exit_m, new.axis);
            old.covariance = new.covariance;
        }
    }
    date.clone_into(&mut record.date);
    Ok(record)
}

/// Middle of the tensions of the thesis (2 to 12 N), N, and their standard deviation about it where
/// all are equally likely.
const TENSIONS_N: (f64, f64) = (7.0, 2.9);

/// A correction that changes the force by less than this at most is not sent to the board, N: the
/// goal for a zero.
pub const LEAST_GAIN_N: f64 = 0.005;
/// Largest force on a cell in use, N.
const LARGEST_N: f64 = 12.0;

/// What the board's conversion of a unit is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conversion {
    /// Scale, N per code.
    pub n_per_code: f64,
    /// Curve and creep.
    pub cell: CellSettings,
    /// What curve and creep that are not corrected, or not known well, leave of the force (relative
    /// standard deviation over the tensions).
    pub left_relative_sd: f64,
    /// Largest change of the force by the curve and by the creep that were measured, N, and whether
    /// the board corrects them.
    pub curve: Correction,
    /// The same for the creep.
    pub creep: Correction,
}

/// What a correction is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// Largest change of the force by it, N.
    pub worth_n: f64,
    /// Standard uncertainty of that, N.
    pub sd_n: f64,
    /// Whether it pays: worth more than [`LEAST_GAIN_N`] and than two of its standard
    /// uncertainties.
    pub pays: bool,
}

impl Correction {
    fn new(worth_n: f64, sd_n: f64) -> Self {
        Self {
            worth_n,
            sd_n,
            pays: worth_n > LEAST_GAIN_N.max(2.0 * sd_n),
        }
    }
}

/// The conversion of a unit. A curve that pays is corrected; for one that does not, the chord at 7
/// N stands, whose error is a part of that of the slope at no load. Creep that pays is corrected.
#[must_use]
pub fn conversion(unit: &UnitRecord) -> Conversion {
    let scale = unit.n_per_code;
    // Both per N of straight reading.
    let bend = unit.n_per_code2 / (scale * scale);
    let bend_sd = unit.n_per_code2_sd / (scale * scale);
    // The chord is wrong by bend F (F - 7 N).
    let lever = LARGEST_N * (LARGEST_N - TENSIONS_N.0);
    let curve = Correction::new(bend.abs() * lever, bend_sd * lever);
    let creep = Correction::new(unit.creep.abs() * LARGEST_N, unit.creep_sd * LARGEST_N);
    let mut cell = CellSettings::default();
    let mut n_per_code = scale;
    let left_curve = if curve.pays {
        cell.curve_per_n = bend;
        bend_sd * TENSIONS_N.1
    } else {
        n_per_code += unit.n_per_code2 / scale * TENSIONS_N.0;
        bend.abs() * TENSIONS_N.1
    };
    let left_creep = if creep.pays {
        cell.creep = unit.creep;
        cell.creep_s = unit.creep_s;
        unit.creep_sd
    } else {
        unit.creep.abs()
    };
    Conversion {
        n_per_code,
        cell,
        left_relative_sd: left_curve.hypot(left_creep),
        curve,
        creep,
    }
}

/// The rig as every command and every job of the service uses it: with its stored calibration in
/// place of the rig file's numbers, where there is one. The one place for this rule. `seed`: that
/// of an emulated rig, which is another rig for each.
///
/// # Errors
/// The stored calibration is there and can't be used.
pub fn with_calibration(rig: Rig, seed: Option<u64>) -> Result<Rig> {
    // Without a folder for it, nothing was ever stored.
    let Ok(store) = Store::of_rig(&rig.name, seed) else {
        return Ok(rig);
    };
    let Some(record) = store.current()? else {
        return Ok(rig);
    };
    if record.rig != rig.name {
        return Err(StoreError::refused(format!(
            "the stored calibration in {} is of rig `{}`, and the rig file is of `{}`",
            store.folder().display(),
            record.rig,
            rig.name
        )));
    }
    Ok(overlay(&rig, &record))
}

/// The calibration in force, in words; `None` where the rig file's numbers are.
#[must_use]
pub fn words(rig: &Rig) -> Option<String> {
    rig.calibration.as_ref().map(|record| {
        let hash = record.hash.get(..19).unwrap_or(&record.hash);
        let warning = expiry(rig).map_or_else(String::new, |warning| format!("; {warning}"));
        format!("calibration of {}, {hash}{warning}", record.date)
    })
}

/// A warning where the calibration in force is over, or soon will be.
#[must_use]
pub fn expiry(rig: &Rig) -> Option<String> {
    let record = rig.calibration.as_deref()?;
    Validity::of(record, &crate::today())?.warning()
}

/// The rig with what was measured in place of the rig file's numbers.
#[must_use]
pub fn overlay(rig: &Rig, record: &Record) -> Rig {
    let mut out = rig.clone();
    for unit in &mut out.units {
        let Some(found) = record.units.iter().find(|u| u.number == unit.number) else {
            continue;
        };
        if !found.gain_date.is_empty() {
            let conversion = conversion(found);
            unit.scale_n_per_count = conversion.n_per_code;
            unit.cell = conversion.cell;
        }
        if !found.geometry_date.is_empty() {
            unit.exit_m = found.exit_m.into();
            unit.axis = found.axis.into();
        }
        if !found.zero_date.is_empty() {
            unit.checks.zero_code = found.zero_codes;
        }
    }
    out.calibration = Some(Box::new(record.clone()));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_was_measured_replaces_the_rig_file() {
        let rig = Rig::built_in().unwrap();
        let mut record = nominal(&rig, "2026-11-22");
        for unit in &mut record.units {
            unit.n_per_code = 7e-6;
            unit.exit_m = [0.1, 0.2, 0.3];
        }
        record.units[1].gain_date = "2026-11-22".to_owned();
        record.units[2].geometry_date = "2026-11-22".to_owned();
        let now = overlay(&rig, &record);
        assert_eq!(now.units[0], rig.units[0]);
        assert_eq!(now.units[1].scale_n_per_count, 7e-6);
        assert_eq!(now.units[1].exit_m, rig.units[1].exit_m);
        assert_eq!(now.units[2].exit_m.x, 0.1);
        assert_eq!(
            now.units[2].scale_n_per_count,
            rig.units[2].scale_n_per_count
        );
        assert_ne!(now.hash(), rig.hash());
        // F = 7e-6 c - 1e-14 c^2: 12 N are 12 * 5 * 2.04e-4 N off the chord at 7 N.
        record.units[1].n_per_code2 = -1e-14;
        let bend = 1e-14 / 7e-6 / 7e-6;
        let found = conversion(&record.units[1]);
        assert!(found.curve.pays && (found.curve.worth_n - 60.0 * bend).abs() < 1e-9);
        assert_eq!(found.n_per_code, 7e-6);
        assert!((found.cell.curve_per_n + bend).abs() < 1e-12);
        assert_eq!(overlay(&rig, &record).units[1].cell, found.cell);
        // A curve that is not known well is not corrected: the chord stands, 7 N at about 1.01e6
        // codes.
        record.units[1].n_per_code2_sd = 6e-15;
        let found = conversion(&record.units[1]);
        assert!(!found.curve.pays && found.cell.is_none());
        let chord = 7e-6 * 1.01e6 - 1e-14 * 1.01e6f64.powi(2);
        assert!((found.n_per_code * 1.01e6 - chord).abs() < 1e-2);
        assert!((found.left_relative_sd - 2.9 * bend).abs() < 1e-9);
        record.units[1].creep = 0.02;
        record.units[1].creep_sd = 0.001;
        record.units[1].creep_s = 30.0;
        let found = conversion(&record.units[1]);
        assert_eq!((found.cell.creep, found.cell.creep_s), (0.02, 30.0));
        record.units[1].creep = 0.0003;
        assert!(!conversion(&record.units[1]).creep.pays);
        record.units[1].creep = 0.0;
        assert_eq!(
            overlay(&rig, &nominal(&rig, "2026-11-22")).hash(),
            rig.hash()
        );
        // A rig file that is corrected later counts where nothing was measured.
        let mut corrected = rig.clone();
        corrected.units[0].exit_m.x = 0.5;
        let next = continued(&corrected, Some(record.clone()), "2026-11-23").unwrap();
        assert_eq!(next.units[0].exit_m[0], 0.5);
        assert_eq!(next.units[2].exit_m[0], 0.1);
        corrected.name = "another".to_owned();
        assert!(continued(&corrected, Some(record), "2026-11-23").is_err());
    }
}
