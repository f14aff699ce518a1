//! Zeros that are carried over, and compared with those that are known.

use crate::error::{MovedZero, RunError};
use known::zeros::{ZeroStore, ZERO_TOLERANCE_N};
use rig::Rig;
use session::Session;
use wire::message::UnitConfig;
use wire::UNITS;

/// The rig file's configuration with what belongs to the board: its zeros, and an emulated rig's
/// calibrated scales.
pub(super) fn carried_over(
    session: &mut Session<'_>,
    rig: &Rig,
    in_force: &[UnitConfig; UNITS],
) -> [UnitConfig; UNITS] {
    let emulated = session.link().controls().is_some();
    let mut configs = rig.units.map(|unit| unit.to_wire());
    for (i, (config, before)) in configs.iter_mut().zip(in_force).enumerate() {
        config.zero_code = before.zero_code;
        if emulated && before.zero_code != 0 && !rig.has_measured_gain(i) {
            config.scale_pn_per_count = before.scale_pn_per_count;
        }
    }
    configs
}

/// What measured zeros are compared with.
pub(super) enum References {
    /// With none: the user has them accepted as they are.
    Replaced,
    /// With these, ADC codes.
    Stored(Vec<[i32; UNITS]>),
}

/// The zeros to compare with: the stored ones, else those in force.
pub(super) fn references(
    store: &ZeroStore,
    in_force: &[UnitConfig; UNITS],
) -> Result<Vec<[i32; UNITS]>, RunError> {
    let stored = store.references()?;
    if !stored.is_empty() {
        return Ok(stored);
    }
    // A code of 0 is no zero, and compared with none.
    Ok(vec![in_force.map(|config| config.zero_code)])
}

/// Units whose zero is too far from a reference.
pub(super) fn far(configs: &[UnitConfig; UNITS], references: &[[i32; UNITS]]) -> Vec<MovedZero> {
    let mut wrong = Vec::new();
    for (i, config) in configs.iter().enumerate().filter(|(_, c)| c.enabled) {
        let newton_per_count = f64::from(config.scale_pn_per_count) * 1e-12;
        let moved_n = references
            .iter()
            .filter(|codes| codes[i] != 0)
            .map(|codes| (f64::from(config.zero_code) - f64::from(codes[i])) * newton_per_count)
            .max_by(|a, b| a.abs().total_cmp(&b.abs()));
        if let Some(moved_n) = moved_n.filter(|moved_n| moved_n.abs() > ZERO_TOLERANCE_N) {
            wrong.push(MovedZero {
                unit: i as u8 + 1,
                moved_n,
            });
        }
    }
    wrong
}
