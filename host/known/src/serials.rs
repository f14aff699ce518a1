//! Serial numbers of units, motors, cells and converters: which parts a calibration is of.
//!
//! Gain and zero are those of a cell with its converter. A unit that gets another cell has no gain
//! until it was weighed again.

use crate::base::nominal;
use crate::store::Store;
use crate::{Result, StoreError};
use calibration::record::{Record, UnitRecord};
use rig::Rig;

/// Longest serial number, characters.
const LONGEST: usize = 40;

/// Serial numbers to set on one unit; `None` leaves what is there.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Serials {
    /// The unit as a whole.
    pub unit: Option<String>,
    /// Motor.
    pub motor: Option<String>,
    /// Load cell.
    pub cell: Option<String>,
    /// Converter module.
    pub converter: Option<String>,
}

impl Serials {
    /// Whether nothing is to be set.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// A serial number as typed.
///
/// # Errors
/// It is empty, too long, or has characters that no label has.
pub fn parse(text: &str) -> std::result::Result<String, String> {
    let text = text.trim();
    let good = !text.is_empty()
        && text.chars().count() <= LONGEST
        && text.chars().all(|c| !c.is_control() && c != '"');
    if good {
        Ok(text.to_owned())
    } else {
        Err(format!(
            "`{text}` is not a serial number: 1 to {LONGEST} characters as on the label, for example SBA-0713"
        ))
    }
}

/// Sets serial numbers of a unit. Returns what that changed besides, in words.
///
/// # Errors
/// There is no such unit; another unit has this serial number; a cell or converter would be
/// exchanged under a measured gain and `replace` is not set.
pub fn set(
    record: &mut Record,
    rig: &Rig,
    unit: u8,
    serials: &Serials,
    replace: bool,
) -> Result<Vec<String>> {
    let fresh = nominal(rig, &record.date);
    let others: Vec<UnitRecord> = record
        .units
        .iter()
        .filter(|other| other.number != unit)
        .cloned()
        .collect();
    let found = find(record, unit)?;
    let mut exchanged = Vec::new();
    for (what, new, old, others_of, measured_with) in [
        ("unit", &serials.unit, &mut found.unit_serial, 0, false),
        ("motor", &serials.motor, &mut found.motor_serial, 1, false),
        ("cell", &serials.cell, &mut found.cell_serial, 2, true),
        (
            "converter",
            &serials.converter,
            &mut found.converter_serial,
            3,
            true,
        ),
    ] {
        let Some(new) = new else { continue };
        let taken = |other: &&UnitRecord| other.serials()[others_of].1 == new;
        if let Some(other) = others.iter().find(taken) {
            return Err(StoreError::refused(format!(
                "unit {unit}: {what} {new} is that of unit {} already; set the other one first",
                other.number
            )));
        }
        if !old.is_empty() && old != new && measured_with {
            exchanged.push(format!("{what} {old} by {new}"));
        }
        new.clone_into(old);
    }
    if exchanged.is_empty() || found.gain_date.is_empty() && found.zero_date.is_empty() {
        return Ok(Vec::new());
    }
    let exchanged = exchanged.join(", ");
    if !replace {
        return Err(StoreError::refused(format!(
            "unit {unit}: gain and zero were measured before the exchange of {exchanged}; --replace takes them out, then `forcectl calibrate gain --unit {unit}`"
        )));
    }
    if let Some(fresh) = fresh.units.iter().find(|u| u.number == unit) {
        without_cell(found, fresh);
    }
    Ok(vec![format!(
        "unit {unit}: exchange of {exchanged}; its gain is nominal until `forcectl calibrate gain --unit {unit}`"
    )])
}

/// Discards the readings of a gain that is not finished where the cell or converter was exchanged
/// after they were taken. `before`: the record before [`set`]. Returns that in words.
///
/// # Errors
/// The file can't be removed.
pub fn discard_readings(
    store: &Store,
    before: &Record,
    after: &Record,
    unit: u8,
) -> Result<Option<String>> {
    let parts = |record: &Record| {
        let unit = record.units.iter().find(|u| u.number == unit);
        unit.map(|u| [u.cell_serial.clone(), u.converter_serial.clone()])
    };
    let (Some(old), Some(new)) = (parts(before), parts(after)) else {
        return Ok(None);
    };
    let exchanged = old
        .iter()
        .zip(&new)
        .any(|(old, new)| !old.is_empty() && old != new);
    let mut discarded = false;
    for step in ["gain", "iso376"] {
        let draft = store.draft(&format!("{step}-unit{unit}"));
        if exchanged && draft.text()?.is_some() {
            draft.discard()?;
            discarded = true;
        }
    }
    Ok(discarded.then(|| format!(
        "unit {unit}: the readings of a gain that was not finished are of the old parts and were discarded"
    )))
}

/// Takes out what was measured with a cell that is not there any more.
fn without_cell(unit: &mut UnitRecord, nominal: &UnitRecord) {
    unit.gain_date.clear();
    unit.zero_date.clear();
    (unit.n_per_code, unit.n_per_code_sd) = (nominal.n_per_code, nominal.n_per_code_sd);
    (unit.n_per_code2, unit.n_per_code2_sd) = (0.0, 0.0);
    (unit.creep, unit.creep_sd, unit.creep_s) = (0.0, 0.0, 0.0);
    (unit.zero_codes, unit.zero_sd_codes) = (nominal.zero_codes, nominal.zero_sd_codes);
}

/// Compares the serial number of the cell that is weighed with the store; enters it where the store
/// has none.
///
/// # Errors
/// The store has another one for this unit, or has this one for another unit.
pub fn check_cell(record: &mut Record, unit: u8, serial: &str) -> Result<()> {
    let elsewhere = |other: &&UnitRecord| other.number != unit && other.cell_serial == serial;
    if let Some(other) = record.units.iter().find(elsewhere) {
        return Err(StoreError::refused(format!(
            "cell {serial} is that of unit {}, and unit {unit} was named: is it in the right unit? `forcectl calibrate serials` shows all",
            other.number
        )));
    }
    let found = find(record, unit)?;
    if !found.cell_serial.is_empty() && found.cell_serial != serial {
        return Err(StoreError::refused(format!(
            "unit {unit} has cell {}, and cell {serial} is weighed; if the cell was exchanged: `forcectl calibrate serials --unit {unit} --cell {serial} --replace`",
            found.cell_serial
        )));
    }
    serial.clone_into(&mut found.cell_serial);
    Ok(())
}

fn find(record: &mut Record, unit: u8) -> Result<&mut UnitRecord> {
    record
        .units
        .iter_mut()
        .find(|u| u.number == unit)
        .ok_or_else(|| StoreError::input(format!("there is no unit {unit}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(serial: &str) -> Serials {
        Serials {
            cell: Some(serial.to_owned()),
            ..Serials::default()
        }
    }

    #[test]
    fn an_exchanged_cell_takes_its_gain_with_it() {
        let rig = Rig::built_in().unwrap();
        let mut record = nominal(&rig, "2026-11-22");
        assert_eq!(
            set(&mut record, &rig, 3, &cell("SBA-1"), false).unwrap(),
            [""; 0]
        );
        record.units[2].gain_date = "2026-11-22".to_owned();
        record.units[2].n_per_code = 7e-6;
        record.units[2].creep = 0.01;
        record.units[2].creep_s = 9.0;
        // The same again changes nothing, another motor neither.
        set(&mut record, &rig, 3, &cell("SBA-1"), false).unwrap();
        let motor = Serials {
            motor: Some("M 7".to_owned()),
            ..Serials::default()
        };
        set(&mut record, &rig, 3, &motor, false).unwrap();
        assert_eq!(record.units[2].n_per_code, 7e-6);
        let mut tried = record.clone();
        let told = set(&mut tried, &rig, 3, &cell("SBA-2"), false)
            .unwrap_err()
            .to_string();
        assert!(
            told.contains("cell SBA-1 by SBA-2") && told.contains("--replace"),
            "{told}"
        );
        let notes = set(&mut record, &rig, 3, &cell("SBA-2"), true).unwrap();
        assert!(notes[0].contains("nominal until"), "{notes:?}");
        let unit = &record.units[2];
        assert!(unit.gain_date.is_empty() && unit.creep == 0.0);
        assert_eq!(unit.n_per_code, rig.units[2].scale_n_per_count);
        record.write().unwrap();
    }

    #[test]
    fn readings_of_a_cell_do_not_outlive_its_exchange() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let rig = Rig::built_in().unwrap();
        let mut record = nominal(&rig, "2026-11-22");
        for step in ["gain-unit3", "iso376-unit3", "gain-unit4"] {
            store.draft(step).add("weight_g", "10").unwrap();
        }
        let mut exchange = |serial: &str| {
            let before = record.clone();
            set(&mut record, &rig, 3, &cell(serial), true).unwrap();
            discard_readings(&store, &before, &record, 3).unwrap()
        };
        // The number that the cell had all the time is entered, and entered once more.
        assert_eq!(exchange("SBA-1"), None);
        assert_eq!(exchange("SBA-1"), None);
        assert_eq!(store.draft("gain-unit3").rows().unwrap(), 1);
        // No gain was finished with the old cell: the readings go all the same.
        assert!(exchange("SBA-2").unwrap().contains("were discarded"));
        assert_eq!(store.draft("gain-unit3").text().unwrap(), None);
        assert_eq!(store.draft("iso376-unit3").text().unwrap(), None);
        assert_eq!(exchange("SBA-3"), None);
        assert_eq!(store.draft("gain-unit4").rows().unwrap(), 1);
    }

    #[test]
    fn a_cell_of_another_unit_is_named() {
        let rig = Rig::built_in().unwrap();
        let mut record = nominal(&rig, "2026-11-22");
        check_cell(&mut record, 3, "SBA-1").unwrap();
        assert_eq!(record.units[2].cell_serial, "SBA-1");
        check_cell(&mut record, 3, "SBA-1").unwrap();
        let told = |record: &mut Record, unit, serial| {
            check_cell(record, unit, serial).unwrap_err().to_string()
        };
        assert!(told(&mut record, 3, "SBA-2").contains("unit 3 has cell SBA-1"));
        assert!(told(&mut record, 4, "SBA-1").contains("that of unit 3"));
        let taken = set(&mut record, &rig, 4, &cell("SBA-1"), true);
        assert!(taken.unwrap_err().to_string().contains("of unit 3 already"));
        assert!(set(&mut record, &rig, 9, &cell("X"), true).is_err());
        for bad in ["", "  ", "a\"b", "a\tb", &"x".repeat(41)] {
            assert!(parse(bad).is_err(), "{bad}");
        }
        assert_eq!(parse(" SBA-0713 "), Ok("SBA-0713".to_owned()));
    }
}
