//! What differs between two records, number by number, and whether it is more than their own errors
//! explain.

use super::{Record, UnitRecord};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// A value that differs between two records.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// What it is.
    pub key: String,
    /// In the older record.
    pub old: String,
    /// In the newer record.
    pub new: String,
    /// Size of the change in standard deviations of both together, where that is known. Above 3 to
    /// 4 it is more than the calibrations' own errors explain.
    pub sigmas: Option<f64>,
}

impl Record {
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
            (
                "gravity_relative_sd",
                older.gravity_relative_sd,
                self.gravity_relative_sd,
            ),
            (
                "valid_days",
                f64::from(older.valid_days),
                f64::from(self.valid_days),
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
        let schema = |record: &Self| record.schema.to_string();
        text("schema".into(), &schema(older), &schema(self));
        let cross = |record: &Self| -> BTreeMap<(u8, u8), String> {
            let blocks = record.cross.iter();
            blocks
                .map(|block| ((block.a, block.b), format!("{:?}", block.covariance)))
                .collect()
        };
        let (old, new) = (cross(older), cross(self));
        let pairs: BTreeSet<_> = old.keys().chain(new.keys()).collect();
        for pair in pairs {
            let of = |blocks: &BTreeMap<_, String>| blocks.get(pair).cloned().unwrap_or_default();
            let key = format!("units {} and {} exit_cross_covariance", pair.0, pair.1);
            text(key, &of(&old), &of(&new));
        }
        for number in now.keys().filter(|n| !before.contains_key(n)) {
            text(format!("unit {number}"), "missing", "there");
        }
        for (number, new) in &now {
            if let Some(old) = before.get(number) {
                let common = [older, self].map(|record| record.common_gain_relative_sd);
                out.extend(unit_diff(*number, old, new, common));
            }
        }
        out
    }
}

/// A number of a unit's record.
type Number = fn(&UnitRecord) -> f64;

/// `common`: relative standard uncertainty that all gains of the older and of the newer record
/// share.
fn unit_diff(number: u8, old: &UnitRecord, new: &UnitRecord, common: [f64; 2]) -> Vec<Difference> {
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
    // A zero moves by a step at each power-up: that is the scale of its change.
    let step = |u: &UnitRecord| {
        u.zero_sd_codes
            .hypot(u.power_up_step_n / u.n_per_code.abs())
    };
    let numbers: [(&str, Number, Number); 5] = [
        ("n_per_code", |u| u.n_per_code, |u| u.n_per_code_sd),
        ("n_per_code2", |u| u.n_per_code2, |u| u.n_per_code2_sd),
        ("creep", |u| u.creep, |u| u.creep_sd),
        ("zero_codes", |u| u.zero_codes, step),
        ("mounting_n", |u| u.mounting_n, |u| u.mounting_sd_n),
    ];
    for (key, value, sd) in numbers {
        let (a, b) = (value(old), value(new));
        let mut both = sd(old).hypot(sd(new));
        if key == "n_per_code" {
            both = both.hypot(common[0] * a).hypot(common[1] * b);
        }
        let sigmas = (b - a).abs() / both;
        push(key, a.to_string(), b.to_string(), Some(sigmas));
    }
    for (key, a, b) in [
        ("n_per_code_sd", old.n_per_code_sd, new.n_per_code_sd),
        ("n_per_code2_sd", old.n_per_code2_sd, new.n_per_code2_sd),
        ("creep_sd", old.creep_sd, new.creep_sd),
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
        "gain_figures",
        format!("{:?}", old.gain),
        format!("{:?}", new.gain),
        None,
    );
    push(
        "covariance",
        format!("{:?}", old.covariance),
        format!("{:?}", new.covariance),
        None,
    );
    out
}
