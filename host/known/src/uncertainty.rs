//! How well the force at the tip is known, from the calibration in force: for the table of a run and for its recording.
//!
//! Taken as exact: the robot's pose. Left out: friction between load cell and tip.

use calibration::record::Record;
use calibration::uncertainty::{self, Geometry, UnitInput};
use force::metrics::{Step, STEADY_AFTER_S};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use serde::Serialize;
use wire::UNITS;

use super::base::{conversion, BOARD_ZERO_SD_N};

/// Uncertainty of the force at the tip. All of it one standard deviation, unless it says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ForceUncertainty {
    /// Hash of the calibration.
    pub calibration: String,
    /// Its date.
    pub date: String,
    /// Of the force's size, N.
    pub size_sd_n: f64,
    /// Of its direction, degrees; `None` for no force.
    pub direction_sd_deg: Option<f64>,
    /// Radius of the ball that holds the force with 95 %, N.
    pub radius_95_n: f64,
    /// The largest parts by source, N, in their worst direction.
    pub parts_n: PartsN,
    /// What was not measured and is nominal, in words.
    pub nominal: Vec<String>,
}

/// Standard deviations of the force in the worst direction by source, N.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PartsN {
    /// Gains.
    pub gains: f64,
    /// Zeros.
    pub zeros: f64,
    /// Exit points and axes.
    pub geometry: f64,
    /// How the tensions are held.
    pub held: f64,
}

/// What a run held while steady, added up cycle by cycle.
#[derive(Debug, Clone, Default)]
pub struct Steady {
    count: u64,
    tip_m: Vector3<f64>,
    tension_n: [f64; UNITS],
    off_n: [f64; UNITS],
    available: [bool; UNITS],
}

impl Steady {
    /// Adds a cycle; those before the run is steady do not count.
    pub fn add(&mut self, step: &Step) {
        if step.t_s < STEADY_AFTER_S {
            return;
        }
        self.count += 1;
        self.tip_m += step.tip_m;
        self.available = step.available;
        for i in 0..UNITS {
            self.tension_n[i] += step.measured_tension_n[i];
            self.off_n[i] += step.measured_tension_n[i] - step.tension_setpoint_n[i];
        }
    }

    /// Uncertainty of the mean force. `None` without a steady cycle or where a cable stands across its cell.
    #[must_use]
    pub fn uncertainty(&self, record: &Record) -> Option<ForceUncertainty> {
        if self.count == 0 {
            return None;
        }
        let count = self.count as f64;
        of_tensions(
            record,
            &(self.tip_m / count),
            &self.tension_n.map(|sum| sum / count),
            // The mean of what the loop leaves: its noise averages out.
            &self.off_n.map(|sum| (sum / count).abs()),
            &self.available,
        )
    }
}

/// Uncertainty of the mean force that a run held while steady; see [`Steady::uncertainty`].
#[must_use]
pub fn of_run(record: &Record, steps: &[Step]) -> Option<ForceUncertainty> {
    let mut steady = Steady::default();
    steps.iter().for_each(|step| steady.add(step));
    steady.uncertainty(record)
}

/// Uncertainty of the force of these tensions, N, at a tip, m. `held_n`: how far the tensions are from their setpoints.
#[must_use]
pub fn of_tensions(
    record: &Record,
    tip_m: &Vector3<f64>,
    tension_n: &[f64; UNITS],
    held_n: &[f64; UNITS],
    available: &[bool; UNITS],
) -> Option<ForceUncertainty> {
    let mut nominal = Vec::new();
    let inputs: Vec<UnitInput> = record
        .units
        .iter()
        .take(UNITS)
        .enumerate()
        .map(|(i, unit)| {
            if available[i] {
                let missing = [
                    (unit.gain_date.is_empty(), "gain"),
                    (unit.geometry_date.is_empty(), "geometry"),
                ];
                nominal.extend(
                    missing
                        .iter()
                        .filter(|(missing, _)| *missing)
                        .map(|(_, what)| format!("{what} of unit {}", unit.number)),
                );
            }
            let on = if available[i] { 1.0 } else { 0.0 };
            let cell_zero = unit.n_per_code.abs() * unit.zero_sd_codes;
            UnitInput {
                exit_m: unit.exit_m.into(),
                axis: unit.axis.into(),
                tension_n: on * tension_n[i],
                gain_relative_sd: (unit.n_per_code_sd / unit.n_per_code.abs())
                    .hypot(conversion(unit).left_relative_sd),
                zero_sd_n: on * cell_zero.max(BOARD_ZERO_SD_N),
                held_sd_n: on * held_n[i],
            }
        })
        .collect();
    let geometry = Geometry {
        covariance: record.geometry_covariance(),
        tip_covariance_m2: Matrix3::zeros(),
    };
    let found =
        uncertainty::tip_force(&inputs, tip_m, &geometry, record.common_gain_relative_sd).ok()?;
    let worst = |m: &Matrix3<f64>| SymmetricEigen::new(*m).eigenvalues.max().max(0.0).sqrt();
    Some(ForceUncertainty {
        calibration: record.content_hash(),
        date: record.date.clone(),
        size_sd_n: found.size_sd_n(),
        direction_sd_deg: found.direction_sd_rad().map(f64::to_degrees),
        radius_95_n: found.radius_95_n(),
        parts_n: PartsN {
            gains: worst(&(found.parts.gains + found.parts.common_gain)),
            zeros: worst(&found.parts.zeros),
            geometry: worst(&found.parts.geometry),
            held: worst(&found.parts.held),
        },
        nominal,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base;
    use rig::Rig;

    #[test]
    fn a_measured_rig_is_known_better_than_a_nominal_one() {
        let rig = Rig::built_in().unwrap();
        let mut record = base::nominal(&rig, "2026-11-22");
        let tip = rig.workspace.center_m;
        let at = |record: &Record| {
            of_tensions(
                record,
                &tip,
                &[5.0, 2.0, 2.0, 2.0, 2.0, 2.0],
                &[0.0; 6],
                &[true; 6],
            )
            .unwrap()
        };
        let before = at(&record);
        assert_eq!(before.nominal.len(), 12);
        for unit in &mut record.units {
            unit.gain_date = "2026-11-22".to_owned();
            unit.geometry_date = "2026-11-22".to_owned();
            unit.n_per_code_sd = 3e-4 * unit.n_per_code;
            let small = unit.covariance_matrix() * 0.0025;
            unit.set_covariance(&small);
        }
        let after = at(&record);
        assert!(after.nominal.is_empty());
        assert!(
            after.radius_95_n < 0.1 * before.radius_95_n,
            "{before:?} {after:?}"
        );
        // 5 % of 5 N along one cable: the gains lead before.
        assert!((0.2..0.4).contains(&before.parts_n.gains), "{before:?}");
        assert!(after.size_sd_n <= after.radius_95_n);
        assert!(after.direction_sd_deg.unwrap() > 0.0);
        assert_eq!(of_run(&record, &[]), None);
    }
}
