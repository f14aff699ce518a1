//! A board that is ready: its configuration is read back before anything is armed with it.

use crate::error::{Fault, RunError};
use crate::fault::RunFault;
use crate::phase::{tell_configs, Observer};
use emulator_link::Report;
use rig::board_crc;
use session::link::{LinkError, RigLink};
use session::Session;
use wire::message::{Status, UnitConfig};
use wire::UNITS;

/// A board that is configured, zeroed and disarmed.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The configurations in force, zeros included.
    pub configs: [UnitConfig; UNITS],
    /// CRC-32 of them, as the board reports it.
    pub config_crc: u32,
    /// Units that take part.
    pub available: [bool; UNITS],
    /// Faults of the units that don't.
    pub faults: Vec<RunFault>,
    /// Conversions that each unit had missed until then, by the board's own count.
    missed_before: [u32; UNITS],
    /// Conversions that had stayed unread until then, by the embedded rig's count; 0 on a real rig.
    lost_before: u64,
}

impl Prepared {
    /// Reads the configuration back and takes note of what is known of a board that is ready.
    ///
    /// # Errors
    /// The board holds another configuration, or no unit takes part.
    pub(super) fn verified(
        session: &mut Session<'_>,
        configs: [UnitConfig; UNITS],
        faults: Vec<RunFault>,
        observer: &mut dyn Observer,
    ) -> Result<Self, RunError> {
        let (status, config_crc) = verify(session, &configs)?;
        tell_configs(session, observer, &configs);
        let available = configs.map(|config| config.enabled);
        if !available.contains(&true) {
            return Err(Fault::NoUnit.into());
        }
        Ok(Self {
            configs,
            config_crc,
            available,
            faults,
            missed_before: status.units.map(|unit| unit.missed),
            lost_before: conversions_lost(session.link())?,
        })
    }

    /// Conversions that were not read in time since the board was self. The embedded rig counts
    /// them itself; on a real rig the board's own count is all there is.
    pub(crate) fn samples_lost(&self, report: Option<&Report>, status: &Status) -> u64 {
        let missed: u64 = status
            .units
            .iter()
            .zip(self.missed_before)
            .map(|(unit, before)| u64::from(unit.missed.wrapping_sub(before)))
            .sum();
        let Some(report) = report else {
            return missed;
        };
        let all: u64 = report.conversions.iter().sum();
        let read: u64 = report.conversions_read.iter().sum();
        let lost = all.saturating_sub(read).saturating_sub(self.lost_before);
        // A conversion that became ready just now is not lost.
        lost.saturating_sub(UNITS as u64).max(missed)
    }
}

/// Reads the configuration back. Returns the board's status and the configuration's CRC-32.
fn verify(
    session: &mut Session<'_>,
    configs: &[UnitConfig; UNITS],
) -> Result<(Status, u32), RunError> {
    let in_force = session.get_configs()?;
    if in_force != *configs {
        return Err(Fault::ConfigDiffers(differences(configs, &in_force)).into());
    }
    let status = session.get_status()?;
    let config_crc = board_crc(&in_force);
    if status.config_crc != config_crc {
        return Err(Fault::ConfigCrc {
            board: status.config_crc,
            read_back: config_crc,
        }
        .into());
    }
    Ok((status, config_crc))
}

/// What differs between the configurations sent and those read back, in words.
fn differences(sent: &[UnitConfig; UNITS], back: &[UnitConfig; UNITS]) -> Vec<String> {
    let fields = |config: &UnitConfig| match serde_json::to_value(config) {
        Ok(serde_json::Value::Object(fields)) => fields,
        _ => serde_json::Map::new(),
    };
    let mut found = Vec::new();
    for (i, (sent, back)) in sent.iter().zip(back).enumerate() {
        let back = fields(back);
        for (name, value) in fields(sent) {
            if let Some(other) = back.get(&name).filter(|other| **other != value) {
                found.push(format!("unit {}: {name} {value} became {other}", i + 1));
            }
        }
    }
    found
}

/// Conversions that the embedded rig saw unread so far; 0 on a real rig.
fn conversions_lost(link: &mut dyn RigLink) -> Result<u64, LinkError> {
    let Some(controls) = link.controls() else {
        return Ok(0);
    };
    let report = controls.report()?;
    let lost = report
        .conversions
        .iter()
        .zip(report.conversions_read)
        .map(|(all, read)| all.saturating_sub(read));
    Ok(lost.sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::Rig;

    #[test]
    fn a_configuration_that_differs_is_named_by_unit_and_field() {
        let sent = Rig::built_in().unwrap().units.map(|unit| unit.to_wire());
        assert!(differences(&sent, &sent).is_empty());
        let mut back = sent;
        back[2].kp_q16 += 1;
        let found = differences(&sent, &back);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].starts_with("unit 3: kp_q16 "), "{found:?}");
    }
}
