//! A rig's calibration before anything was measured, and how a calibration enters the settings of a rig file.
//!
//! A [`Record`] has an entry for every unit, measured or not. What was not measured is the rig file's, with the
//! uncertainty of a nominal value, and has no date. Only what has a date replaces the rig file's numbers.

use crate::rigfile::RigFile;
use calibration::record::{Record, UnitRecord, SCHEMA};
use calibration::STANDARD_GRAVITY_M_PER_S2;
use nalgebra::{Matrix3, SMatrix};

/// Relative standard uncertainty of a nominal scale: the rig's files have 6.2e-6 to 7.3e-6 N per code.
pub const NOMINAL_SCALE_SD: f64 = 0.05;
/// Standard uncertainty of a coordinate taken with a tape measure, m.
pub const NOMINAL_POSITION_SD_M: f64 = 0.005;
/// Standard uncertainty of an axis taken with a protractor, about each perpendicular, rad.
pub const NOMINAL_AXIS_SD_RAD: f64 = 0.035;
/// Standard error of the zero that the board takes by itself, N: 256 samples of 5 mN, correlated.
pub const BOARD_ZERO_SD_N: f64 = 0.0005;

/// The calibration of a rig of which nothing was measured.
#[must_use]
pub fn nominal(rig: &RigFile, date: &str) -> Record {
    let units = rig
        .units
        .iter()
        .map(|unit| {
            // A rig file rounds its axes: off unit length, the covariance across them would not be one.
            let axis = unit.axis.normalize();
            let mut out = UnitRecord {
                number: unit.number,
                cell_serial: String::new(),
                converter_serial: String::new(),
                gain_date: String::new(),
                zero_date: String::new(),
                geometry_date: String::new(),
                n_per_code: unit.scale_n_per_count,
                n_per_code_sd: NOMINAL_SCALE_SD * unit.scale_n_per_count.abs(),
                n_per_code2: 0.0,
                zero_codes: unit.checks.zero_code,
                zero_sd_codes: BOARD_ZERO_SD_N / unit.scale_n_per_count.abs(),
                mounting_n: 0.0,
                mounting_sd_n: 0.0,
                power_up_step_n: 0.0,
                exit_m: unit.exit_m.into(),
                axis: axis.into(),
                covariance: Vec::new(),
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
        gravity_m_per_s2: STANDARD_GRAVITY_M_PER_S2,
        common_gain_relative_sd: 0.0,
        units,
        cross: Vec::new(),
    }
}

/// The record of a rig to go on with: the stored one, with the units that the rig file has now.
///
/// # Errors
/// The stored record is of another rig.
pub fn continued(rig: &RigFile, stored: Option<Record>, date: &str) -> Result<Record, String> {
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

/// Middle of the tensions of the thesis (2 to 12 N), N, and their standard deviation about it where all are equally likely.
const TENSIONS_N: (f64, f64) = (7.0, 2.9);

/// The straight scale that stands for a unit's curve, N per code, and what the curve leaves of it (relative standard
/// deviation over the tensions). The board's conversion has no quadratic term: a curved cell gets the chord at 7 N, whose
/// error is a part of that of the slope at no load.
#[must_use]
pub fn straight_scale(unit: &UnitRecord) -> (f64, f64) {
    let per_code = unit.n_per_code2 / unit.n_per_code;
    let scale = unit.n_per_code + per_code * TENSIONS_N.0;
    (scale, (per_code * TENSIONS_N.1 / unit.n_per_code).abs())
}

/// The rig with what was measured in place of the rig file's numbers.
#[must_use]
pub fn overlay(rig: &RigFile, record: &Record) -> RigFile {
    let mut out = rig.clone();
    for unit in &mut out.units {
        let Some(found) = record.units.iter().find(|u| u.number == unit.number) else {
            continue;
        };
        if !found.gain_date.is_empty() {
            unit.scale_n_per_count = straight_scale(found).0;
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
        let rig = RigFile::built_in().unwrap();
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
        // F = 7e-6 c - 1e-14 c^2: 7 N at about 1.01e6 codes.
        record.units[1].n_per_code2 = -1e-14;
        let (scale, left) = straight_scale(&record.units[1]);
        assert!((scale * 1.01e6 - (7e-6 * 1.01e6 - 1e-14 * 1.01e6f64.powi(2))).abs() < 1e-2);
        assert!((left - 1e-14 * 2.9 / 7e-6 / 7e-6).abs() < 1e-9);
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
