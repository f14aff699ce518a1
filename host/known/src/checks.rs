//! Whether a calibration still holds: until when it is valid, and what the checks with a known
//! weight said since.
//!
//! A check hangs one known weight where the gains were found, or on the tip, and compares the force
//! with what the stored calibration makes of the codes. It is kept in `calibration-RIG/checks.csv`,
//! one row for each unit and check.

use crate::store::Store;
use crate::{Result, StoreError};
use calibration::record::Record;
use rig::Rig;
use serde::Serialize;
use std::io::Write as _;
use std::time::{Duration, SystemTime};

/// Until when a calibration is valid.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Validity {
    /// The last day, `YYYY-MM-DD`: that of the oldest gain and the days for which it holds.
    pub until: String,
    /// Days from today to it; negative where it is over.
    pub days_left: i64,
}

const DAY: Duration = Duration::from_secs(86_400);

fn time_of(date: &str) -> Option<SystemTime> {
    humantime::parse_rfc3339(&format!("{date}T00:00:00Z")).ok()
}

fn days(from: SystemTime, to: SystemTime) -> i64 {
    let whole = |d: Duration| i64::try_from(d.as_secs() / DAY.as_secs()).unwrap_or(i64::MAX);
    match to.duration_since(from) {
        Ok(ahead) => whole(ahead),
        Err(behind) => -whole(behind.duration()),
    }
}

impl Validity {
    /// Of a calibration, on a day. `None` where nobody said for how long it holds, or no gain was
    /// measured.
    #[must_use]
    pub fn of(record: &Record, today: &str) -> Option<Self> {
        let dates = record.units.iter().map(|unit| &unit.gain_date);
        let oldest = dates.filter(|date| !date.is_empty()).min()?;
        if record.valid_days == 0 {
            return None;
        }
        let until = time_of(oldest)?.checked_add(DAY * record.valid_days)?;
        let text = humantime::format_rfc3339_seconds(until).to_string();
        Some(Self {
            until: text.chars().take(10).collect(),
            days_left: days(time_of(today)?, until),
        })
    }

    /// What the user should know, from 14 days before the end.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        match self.days_left {
            i64::MIN..0 => Some(format!(
                "the calibration was valid until {}, {} days ago: `forcectl calibrate gain`",
                self.until, -self.days_left
            )),
            0..=14 => Some(format!(
                "the calibration is valid until {}, for {} more days",
                self.until, self.days_left
            )),
            _ => None,
        }
    }
}

/// Units whose geometry no longer holds, in words: their cells were taken out for the gain after it
/// was measured. `None` where there is none, or nobody said how the cells were loaded.
#[must_use]
pub fn geometry_void(record: &Record) -> Option<String> {
    let void: Vec<String> = (record.units.iter())
        .filter(|unit| {
            let gain = unit.gain.as_ref();
            let out = gain.is_some_and(|gain| gain.loading.starts_with("dismounted"));
            // On one day, the sequence is taken to be right: gains first.
            out && !unit.geometry_date.is_empty() && unit.gain_date > unit.geometry_date
        })
        .map(|unit| unit.number.to_string())
        .collect();
    (!void.is_empty()).then(|| {
        format!(
            "unit {} was dismounted for its gain after its geometry was measured, which does not hold any more: `forcectl calibrate geometry`",
            void.join(", ")
        )
    })
}

/// Age of a calibration in days, by its oldest gain; `None` where none was measured.
#[must_use]
pub fn age_days(record: &Record, today: &str) -> Option<i64> {
    let dates = record.units.iter().map(|unit| &unit.gain_date);
    let oldest = dates.filter(|date| !date.is_empty()).min()?;
    Some(days(time_of(oldest)?, time_of(today)?))
}

/// One known weight on one unit, or on the tip.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// Date, `YYYY-MM-DD`.
    pub date: String,
    /// Unit, from 1; `None`: the tip.
    pub unit: Option<u8>,
    /// The weight, g.
    pub weight_g: f64,
    /// Its force, N.
    pub force_n: f64,
    /// The same by the cell, N. At the tip: the weight and, added to it, the size of the difference
    /// between the force by the cells and the weight, with the sign of its vertical part.
    pub measured_n: f64,
    /// 95 % uncertainty of the difference, N.
    pub uncertainty_95_n: f64,
    /// Hash of what was checked of the calibration: [`Record::gains_hash`], at the tip
    /// [`Record::tip_hash`].
    pub calibration: String,
}

impl Check {
    /// Normalised error: the difference over its 95 % uncertainty.
    #[must_use]
    pub fn en(&self) -> f64 {
        (self.measured_n - self.force_n) / self.uncertainty_95_n
    }

    /// Whether the cell agrees with the weight.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.en().abs() <= 1.0
    }

    /// What was checked, in words.
    #[must_use]
    pub fn what(&self) -> String {
        self.unit
            .map_or_else(|| "tip".to_owned(), |unit| format!("unit {unit}"))
    }

    /// Whether it was made on this calibration.
    #[must_use]
    pub fn is_of(&self, record: &Record) -> bool {
        self.calibration
            == match self.unit {
                Some(_) => record.gains_hash(),
                None => record.tip_hash(),
            }
    }
}

/// How the calibration in force stands today, for a card of data: date, hash, age, validity and the
/// last checks. `None` where the rig file's numbers are in force.
#[must_use]
pub fn standing(rig: &Rig) -> Option<Standing> {
    let record = rig.calibration.as_deref()?;
    let today = crate::today();
    // A board's rig has no seed; what can't be read is no check.
    let checks = Store::of_rig(&rig.name, None).and_then(|store| store.last_checks(record));
    Some(Standing {
        date: record.date.clone(),
        hash: record.hash.clone(),
        age_days: age_days(record, &today),
        validity: Validity::of(record, &today),
        checks: (checks.unwrap_or_default().into_iter())
            .map(|check| CheckedUnit {
                unit: check.unit,
                date: check.date.clone(),
                en: check.en(),
                holds: check.passes(),
            })
            .collect(),
    })
}

/// See [`standing`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Standing {
    /// Date of the record.
    pub date: String,
    /// Its hash.
    pub hash: String,
    /// Days since the oldest gain.
    pub age_days: Option<i64>,
    /// Until when it is valid.
    pub validity: Option<Validity>,
    /// The newest check of each unit, and of the tip.
    pub checks: Vec<CheckedUnit>,
}

/// The newest check of a unit, or of the tip.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckedUnit {
    /// Unit, from 1; `None`: the tip.
    pub unit: Option<u8>,
    /// When.
    pub date: String,
    /// Normalised error.
    pub en: f64,
    /// Whether it was at most 1.
    pub holds: bool,
}

/// In place of a unit's number.
const TIP: &str = "tip";
const HEADER: &str = "date,unit,weight_g,force_n,measured_n,uncertainty_95_n,calibration";

impl Store {
    fn checks_path(&self) -> std::path::PathBuf {
        self.folder().join("checks.csv")
    }

    /// All checks, oldest first.
    ///
    /// # Errors
    /// The file can't be read, or a row is none.
    pub fn checks(&self) -> Result<Vec<Check>> {
        let path = self.checks_path();
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(StoreError::unreadable(&path, error)),
        };
        let rows = text.lines().enumerate().skip(1);
        rows.map(|(at, line)| {
            row(line).ok_or_else(|| {
                StoreError::input(format!(
                    "{}:{}: `{line}` is no check; take the line out",
                    path.display(),
                    at + 1
                ))
            })
        })
        .collect()
    }

    /// The newest check of the tip and of each unit that was made on this calibration.
    ///
    /// # Errors
    /// As [`Store::checks`].
    pub fn last_checks(&self, record: &Record) -> Result<Vec<Check>> {
        let mut newest: Vec<Check> = Vec::new();
        for check in self.checks()? {
            if check.is_of(record) {
                newest.retain(|c| c.unit != check.unit);
                newest.push(check);
            }
        }
        newest.sort_by_key(|check| check.unit);
        Ok(newest)
    }

    /// Adds checks.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn add_checks(&self, checks: &[Check]) -> Result<()> {
        let path = self.checks_path();
        let write = || {
            std::fs::create_dir_all(self.folder())?;
            let mut file = std::fs::OpenOptions::new()
                .create(true)
                .append(true)
                .open(&path)?;
            let mut text = String::new();
            if file.metadata()?.len() == 0 {
                text += HEADER;
                text.push('\n');
            }
            for c in checks {
                text += &format!(
                    "{},{},{},{:.5},{:.5},{:.5},{}\n",
                    c.date,
                    c.unit
                        .map_or_else(|| TIP.to_owned(), |unit| unit.to_string()),
                    c.weight_g,
                    c.force_n,
                    c.measured_n,
                    c.uncertainty_95_n,
                    c.calibration
                );
            }
            file.write_all(text.as_bytes())?;
            file.sync_data()
        };
        write().map_err(|error: std::io::Error| StoreError::file(&path, error))
    }
}

fn row(line: &str) -> Option<Check> {
    let cells: Vec<&str> = line.split(',').collect();
    let [date, unit, weight, force, measured, uncertainty, calibration] = cells[..] else {
        return None;
    };
    let number = |text: &str| text.parse().ok().filter(|v: &f64| v.is_finite());
    time_of(date)?;
    Some(Check {
        date: date.to_owned(),
        unit: match unit {
            TIP => None,
            number => Some(number.parse().ok()?),
        },
        weight_g: number(weight)?,
        force_n: number(force)?,
        measured_n: number(measured)?,
        uncertainty_95_n: number(uncertainty).filter(|u| *u > 0.0)?,
        calibration: calibration.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base;

    fn record() -> Record {
        let mut record = base::nominal(&Rig::built_in().unwrap(), "2026-03-01");
        record.units[0].gain_date = "2026-03-01".to_owned();
        record.units[1].gain_date = "2026-02-01".to_owned();
        record.valid_days = 365;
        record
    }

    #[test]
    fn a_calibration_is_as_old_as_its_oldest_gain() {
        let mut record = record();
        let on = |record: &Record, day: &str| Validity::of(record, day).unwrap();
        let later = on(&record, "2026-12-01");
        assert_eq!((later.until.as_str(), later.days_left), ("2027-02-01", 62));
        assert_eq!(later.warning(), None);
        assert_eq!(age_days(&record, "2026-12-01"), Some(303));
        let soon = on(&record, "2027-01-25").warning().unwrap();
        assert!(soon.contains("for 7 more days"), "{soon}");
        let over = on(&record, "2027-02-03").warning().unwrap();
        assert!(over.contains("2 days ago"), "{over}");
        assert!(on(&record, "2027-02-01")
            .warning()
            .is_some_and(|w| w.contains("0 more")));
        record.valid_days = 0;
        assert_eq!(Validity::of(&record, "2026-12-01"), None);
        let nominal = base::nominal(&Rig::built_in().unwrap(), "2026-03-01");
        assert_eq!(age_days(&nominal, "2026-12-01"), None);
    }

    #[test]
    fn checks_are_kept_for_the_gains_that_they_were_made_on() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        assert_eq!(store.checks().unwrap(), []);
        let mut record = record();
        let check = |unit, measured_n, record: &Record| Check {
            date: "2026-03-02".to_owned(),
            unit: Some(unit),
            weight_g: 500.0,
            force_n: 4.9,
            measured_n,
            uncertainty_95_n: 0.01,
            calibration: record.gains_hash(),
        };
        store.add_checks(&[check(1, 4.905, &record)]).unwrap();
        store
            .add_checks(&[check(2, 4.9, &record), check(1, 4.93, &record)])
            .unwrap();
        let last = store.last_checks(&record).unwrap();
        assert_eq!(last.len(), 2);
        assert!(!last[0].passes() && (last[0].en() - 3.0).abs() < 1e-6);
        assert!(last[1].passes());
        // A zero of a later power-up is the same gain; another gain is not.
        record.units[0].zero_codes += 5.0;
        assert_eq!(store.last_checks(&record).unwrap().len(), 2);
        // The tip's check is of the geometry too.
        let tip = Check {
            unit: None,
            calibration: record.tip_hash(),
            ..check(1, 4.9, &record)
        };
        store.add_checks(std::slice::from_ref(&tip)).unwrap();
        let last = store.last_checks(&record).unwrap();
        assert_eq!((last.len(), &last[0]), (3, &tip));
        record.units[2].exit_m[0] += 1e-4;
        let units = store.last_checks(&record).unwrap();
        assert!(units.len() == 2 && units.iter().all(|check| check.unit.is_some()));
        record.units[0].n_per_code *= 1.001;
        assert_eq!(store.last_checks(&record).unwrap(), []);
        let path = folder.path().join("checks.csv");
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replace("4.93000", "x")).unwrap();
        let told = store.checks().unwrap_err().to_string();
        assert!(told.contains("checks.csv:4"), "{told}");
    }
}
