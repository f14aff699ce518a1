//! Zeros of the load cells with slack cables, compared with those of earlier power-ups.

use super::{CalibrateError, Result};
use calibration::input::Table;
use calibration::record::Record;
use calibration::zero::{
    self, History, Limits, Mounting, Parts, PayOut, PowerUp, Verdict, Zero, LEAST_TRAVEL_M,
};
use known::store::Store;
use known::zeros::{UnitZero, POWER_UP_MISS_N};
use known::StoreError;
use nalgebra::{Matrix3, Vector3};

/// [`POWER_UP_MISS_N`] as a standard deviation, N: all misses up to it are equally likely.
pub const POWER_UP_SD_N: f64 = POWER_UP_MISS_N / 1.732_050_8;
/// Zeros further than this many standard deviations from the earlier ones are refused
/// (docs/calibration/figures.md).
pub const LIMIT_SD: f64 = 3.0;
/// Mass of motor and rack, kg (thesis 3.5.1), and how well it is known.
pub const MOTOR_KG: (f64, f64) = (0.5, 0.02);
/// Standard error of a zero that the board took by itself, N: a slack cell creeps and drifts by as
/// much from one reading to the next (docs/calibration/figures.md, pay-out test).
const BOARD_ZERO_SE_N: f64 = 0.005;

/// The zero of one unit and what it means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Unit, from 1.
    pub unit: u8,
    /// As measured, codes.
    pub zero: Zero,
    /// Its parts, N.
    pub parts: Parts,
    /// Against the earlier power-ups.
    pub verdict: Verdict,
}

impl Found {
    /// The zero as the board takes it, ADC code.
    #[must_use]
    pub fn code(&self) -> i32 {
        self.zero.at_end_codes.round() as i32
    }
}

/// A zero of an earlier power-up, as the store has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Past {
    /// Unit, from 1.
    pub unit: u8,
    /// Date, `YYYY-MM-DD`; empty where the file has none.
    pub date: String,
    /// The zero.
    pub entry: PowerUp,
}

/// What to keep to.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Units whose zeros are accepted however far they are from the earlier ones, which are
    /// forgotten.
    pub replace: Vec<u8>,
    /// Mass of motor and rack and its standard uncertainty, kg.
    pub motor_kg: (f64, f64),
    /// Direction of gravity in the base frame.
    pub down: Vector3<f64>,
}

/// The zeros of the units whose codes are given (unit, codes), put into the record.
///
/// # Errors
/// A stream that gives no zero, or a zero that no slack cable explains; all of them are named.
pub fn evaluate(
    codes: &[(u8, Vec<i32>)],
    record: &mut Record,
    history: &[Past],
    options: &Options,
) -> Result<Vec<Found>> {
    let mut found = Vec::new();
    let mut wrong = Vec::new();
    let date = record.date.clone();
    let gravity_m_per_s2 = record.gravity_m_per_s2;
    for (number, stream) in codes {
        let Some(unit) = record.units.iter_mut().find(|u| u.number == *number) else {
            continue;
        };
        let limits = Limits {
            nominal_n_per_code: unit.n_per_code.abs(),
            ..Limits::default()
        };
        let measured = match zero::measure(stream, &limits) {
            Ok(measured) => measured,
            Err(why) => {
                wrong.push(format!("unit {number}: {why}"));
                continue;
            }
        };
        let covariance = unit.covariance_matrix();
        let axis_covariance: Matrix3<f64> = covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let parts = zero::split(
            &measured,
            (unit.n_per_code, unit.n_per_code_sd),
            &Mounting {
                mass_kg: options.motor_kg.0,
                mass_sd_kg: options.motor_kg.1,
                gravity_m_per_s2: options.down * gravity_m_per_s2,
                axis: unit.axis.into(),
                axis_covariance,
            },
        );
        let entry = PowerUp {
            zero_n: unit.n_per_code * measured.at_end_codes,
            se_n: unit.n_per_code.abs() * measured.at_end_se_codes,
            mounting_n: parts.mounting_n,
        };
        let mut past = History::new(
            history
                .iter()
                .filter(|past| past.unit == *number)
                .map(|past| past.entry)
                .collect(),
        );
        let verdict = past.judge(&entry, POWER_UP_MISS_N, LIMIT_SD);
        if options.replace.contains(number) {
            past = History::default();
        } else if !verdict.is_accepted() {
            wrong.push(refusal(*number, &verdict));
            continue;
        }
        past.add(entry);
        unit.zero_codes = measured.at_end_codes;
        unit.zero_sd_codes = measured.at_end_se_codes;
        unit.mounting_n = parts.mounting_n;
        unit.mounting_sd_n = parts.mounting_sd_n;
        unit.power_up_step_n = past
            .expected_n(POWER_UP_SD_N)
            .map_or(POWER_UP_SD_N, |(_, spread)| spread);
        unit.zero_date.clone_from(&date);
        found.push(Found {
            unit: *number,
            zero: measured,
            parts,
            verdict,
        });
    }
    if wrong.is_empty() {
        Ok(found)
    } else {
        Err(CalibrateError::refused(wrong.join("\n")))
    }
}

/// A cable before and after some of it was paid out by hand.
#[derive(Debug, Clone, PartialEq)]
pub struct PaidOut {
    /// Unit, from 1.
    pub unit: u8,
    /// Codes before and after.
    pub codes: [Vec<i32>; 2],
    /// Cable paid out between them, m; `None` where nobody turned the reel (a stand-in).
    pub travel_m: Option<f64>,
}

/// Compares the readings before and after the cables were paid out: none may change.
///
/// # Errors
/// A reel that was not turned, a stream that gives no zero, a cable that pulled; all of them are
/// named.
pub fn check_paid_out(cables: &[PaidOut], record: &Record) -> Result<Vec<(u8, PayOut)>> {
    let mut found = Vec::new();
    let mut wrong = Vec::new();
    for cable in cables {
        let number = cable.unit;
        let Some(unit) = record.units.iter().find(|u| u.number == number) else {
            continue;
        };
        if let Some(travel_m) = cable.travel_m.filter(|t| *t < LEAST_TRAVEL_M) {
            wrong.push(format!(
                "unit {number}: {:.1} mm of cable were paid out by its encoder, and {:.0} mm are needed; turn the reel further, or check the encoder",
                1e3 * travel_m,
                1e3 * LEAST_TRAVEL_M
            ));
            continue;
        }
        let limits = Limits {
            nominal_n_per_code: unit.n_per_code.abs(),
            ..Limits::default()
        };
        let [before, after] = &cable.codes;
        match (
            zero::measure(before, &limits),
            zero::measure(after, &limits),
        ) {
            (Ok(before), Ok(after)) => {
                let result = zero::pay_out(&before, &after, unit.n_per_code);
                if !result.slack {
                    wrong.push(format!(
                        "unit {number}: {:.3} N went away when the cable was paid out: it pulled before. Pay out more, see that nothing holds the cable, and measure again",
                        result.pull_n
                    ));
                }
                found.push((number, result));
            }
            (Err(why), _) | (_, Err(why)) => wrong.push(format!("unit {number}: {why}")),
        }
    }
    if wrong.is_empty() {
        Ok(found)
    } else {
        Err(CalibrateError::refused(wrong.join("\n")))
    }
}

fn refusal(unit: u8, verdict: &Verdict) -> String {
    match verdict {
        Verdict::Preloaded { excess_n, z } => format!(
            "unit {unit}: the zero is {excess_n:+.3} N from the earlier ones ({z:.1} standard deviations): the cable pulls. Let it hang slack and measure again; with a new cell or a turned unit, `forcectl calibrate zero --replace {unit}`"
        ),
        Verdict::Moved { change_n, z } => format!(
            "unit {unit}: the zero is {change_n:+.3} N from the earlier ones ({z:.1} standard deviations): the unit was turned, or the cell is damaged. If it was turned, calibrate geometry first; `forcectl calibrate zero --replace {unit}` accepts the zero"
        ),
        Verdict::First | Verdict::Plausible { .. } => String::new(),
    }
}

/// The zeros over the power-ups, oldest first, whichever command took them. Of the zeros of one
/// power-up the last counts, so that measuring twice teaches nothing about power-ups. A zero that
/// was accepted whatever the former ones were makes the unit forget those. `record` has the scales
/// and the mounting parts for zeros that the board took by itself.
///
/// # Errors
/// A file is there and can't be used; the message names it.
pub fn history(store: &Store, record: &Record) -> Result<Vec<Past>> {
    let mut all: Vec<(Past, bool)> = power_ups(store)?.into_iter().map(|p| (p, false)).collect();
    for (date, zero) in store.zeros().all()? {
        let Some(unit) = record.units.iter().find(|u| u.number == zero.unit) else {
            continue;
        };
        let scale = unit.n_per_code.abs();
        let (se_n, mounting_n) = match zero.parts {
            Some((se_codes, mounting_n)) => (scale * se_codes, mounting_n),
            None => (BOARD_ZERO_SE_N, unit.mounting_n),
        };
        let entry = PowerUp {
            zero_n: unit.n_per_code * f64::from(zero.code),
            se_n,
            mounting_n,
        };
        let past = Past {
            unit: zero.unit,
            date,
            entry,
        };
        all.push((past, zero.accepted));
    }
    all.sort_by(|(a, _), (b, _)| a.date.cmp(&b.date));
    let mut history: Vec<Past> = Vec::new();
    for (past, accepted) in all {
        if accepted {
            history.retain(|earlier| earlier.unit != past.unit);
        }
        let last = history
            .iter()
            .rposition(|earlier| earlier.unit == past.unit);
        if let Some(last) = last.filter(|n| history[*n].entry.is_of_the_same_power_up(&past.entry))
        {
            history.remove(last);
        }
        history.push(past);
    }
    Ok(history)
}

/// The zeros that an older version kept in a file of their own.
fn power_ups(store: &Store) -> Result<Vec<Past>> {
    let path = store.power_ups();
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(StoreError::unreadable(&path, error).into()),
    };
    let read = || -> std::result::Result<Vec<Past>, calibration::input::InputError> {
        let table = Table::parse(&path.display().to_string(), &text)?;
        let column = |name| table.column(name);
        let (unit, zero, se, mounting) = (
            column("unit")?,
            column("zero_n")?,
            column("se_n")?,
            column("mounting_n")?,
        );
        let date = table.find("date");
        table
            .rows()
            .iter()
            .map(|row| {
                Ok(Past {
                    unit: table.number(row, unit)? as u8,
                    date: date.map_or("", |date| table.text(row, date)).to_owned(),
                    entry: PowerUp {
                        zero_n: table.number(row, zero)?,
                        se_n: table.number(row, se)?,
                        mounting_n: table.number(row, mounting)?,
                    },
                })
            })
            .collect()
    };
    read().map_err(CalibrateError::input)
}

/// Adds zeros to those of the rig. `fresh` has the units (of `--replace`) whose earlier ones are
/// forgotten.
///
/// # Errors
/// The file can't be written.
pub fn remember(store: &Store, rig: &str, found: &[Found], fresh: &[u8]) -> Result<()> {
    let zero = |f: &Found| UnitZero {
        unit: f.unit,
        code: f.code(),
        parts: Some((f.zero.at_end_se_codes, f.parts.mounting_n)),
        accepted: fresh.contains(&f.unit),
    };
    let zeros: Vec<UnitZero> = found.iter().map(zero).collect();
    Ok(store.zeros().add_units(rig, &zeros)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use known::base;
    use rig::Rig;

    /// A stream of codes about a middle with 3 mN of noise.
    fn stream(middle: i32) -> Vec<i32> {
        let mut noise = random::SplitMix64::stream(5, "codes", middle as usize);
        (0..3200)
            .map(|_| middle + (400.0 * noise.normal_within(2.5)) as i32)
            .collect()
    }

    fn options() -> Options {
        Options {
            replace: Vec::new(),
            motor_kg: MOTOR_KG,
            down: -Vector3::z(),
        }
    }

    #[test]
    fn a_cable_that_pulled_before_it_was_paid_out_is_named() {
        let record = base::nominal(&Rig::built_in().unwrap(), "2026-11-22");
        let cable = |unit, before, travel_m| PaidOut {
            unit,
            codes: [stream(before), stream(20_000)],
            travel_m,
        };
        let slack = [cable(1, 20_100, Some(0.01)), cable(2, 19_900, None)];
        let found = check_paid_out(&slack, &record).unwrap();
        assert!(found.len() == 2 && found.iter().all(|(_, f)| f.slack));
        // 0.2 N on unit 3, which the history of a few power-ups would not see, and a reel that
        // nobody turned.
        let pulled = [
            cable(1, 20_000, Some(0.01)),
            cable(3, 20_000 + 29_200, Some(0.01)),
            cable(4, 20_000, Some(0.001)),
        ];
        let told = check_paid_out(&pulled, &record).unwrap_err().to_string();
        assert!(
            told.contains("unit 3: 0.2") && told.contains("unit 4: 1.0 mm"),
            "{told}"
        );
        assert!(!told.contains("unit 1"), "{told}");
    }

    #[test]
    fn a_preloaded_cable_is_refused_and_the_record_keeps_its_zero() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let rig = Rig::built_in().unwrap();
        let mut record = base::nominal(&rig, "2026-11-22");
        let first = evaluate(
            &[(1, stream(20_000)), (2, stream(-9_000))],
            &mut record,
            &[],
            &options(),
        );
        let first = first.unwrap();
        assert!((record.units[0].zero_codes - 20_000.0).abs() < 40.0);
        assert_eq!(record.units[1].zero_date, "2026-11-22");
        remember(&store, &rig.name, &first, &[]).unwrap();
        let past = history(&store, &record).unwrap();
        assert_eq!(past.len(), 2);
        // 0.9 N more on unit 1.
        let before = record.clone();
        let pulled = [(1, stream(20_000 + 131_000)), (2, stream(-8_000))];
        let error = evaluate(&pulled, &mut record, &past, &options()).unwrap_err();
        assert!(
            error.to_string().contains("unit 1: the zero is +0.8"),
            "{error}"
        );
        assert!(error.to_string().contains("--replace 1`"), "{error}");
        assert_eq!(record.units[0], before.units[0]);
        // What is accepted for another unit is not for this one.
        let accept = |unit| Options {
            replace: vec![unit],
            ..options()
        };
        assert!(evaluate(&pulled, &mut record.clone(), &past, &accept(2)).is_err());
        record.date = "2026-11-23".to_owned();
        let again = evaluate(&pulled, &mut record, &past, &accept(1)).unwrap();
        // One power-up is known of unit 1, and two of unit 2.
        assert!((record.units[0].power_up_step_n - POWER_UP_SD_N).abs() < 1e-12);
        remember(&store, &rig.name, &again, &[1]).unwrap();
        let kept = history(&store, &record).unwrap();
        let of = |unit| kept.iter().filter(|past| past.unit == unit).count();
        assert_eq!((of(1), of(2)), (1, 2));
        std::fs::write(store.power_ups(), "unit,zero_n,se_n,mounting_n\n1,x,0,0\n").unwrap();
        let error = history(&store, &record).unwrap_err().to_string();
        assert!(error.contains("power-ups.csv:2"), "{error}");
    }

    #[test]
    fn a_zero_taken_twice_in_one_power_up_counts_once() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let mut record = base::nominal(&Rig::built_in().unwrap(), "2026-11-22");
        // Ten codes are 0.07 mN, and the standard error of a zero is about as much.
        for (middle, power_ups) in [(20_000, 1), (20_010, 1), (9_000, 2)] {
            let past = history(&store, &record).unwrap();
            let codes = [(1, stream(middle))];
            let found = evaluate(&codes, &mut record, &past, &options()).unwrap();
            remember(&store, "a rig", &found, &[]).unwrap();
            let kept = history(&store, &record).unwrap();
            assert_eq!(kept.len(), power_ups, "{kept:?}");
        }
    }

    /// The files of two days and an older version's file, in the order of their dates; a code that
    /// is carried on is no zero.
    #[test]
    fn zeros_have_the_date_of_their_measurement() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let record = base::nominal(&Rig::built_in().unwrap(), "2026-11-22");
        let entry = |day: u8, codes: &str| {
            format!("[[zero]]\nmeasured_at = \"2026-11-{day}T10:00:00Z\"\nzero_code = [{codes}]\n")
        };
        let zeros = [
            entry(20, "20000, 70000, 0, 0, 0, 0"),
            entry(22, "20000, 90000, 0, 0, 0, 0"),
            entry(23, "40000, 90000, 0, 0, 0, 0"),
        ];
        let text = format!("rig = \"a rig\"\n{}", zeros.concat());
        std::fs::write(folder.path().join("zeros.toml"), text).unwrap();
        let older = "unit,date,zero_n,se_n,mounting_n\n1,2026-11-21,0.01,0.0001,0\n";
        std::fs::write(store.power_ups(), older).unwrap();
        let past = history(&store, &record).unwrap();
        let of = |unit| -> Vec<&str> {
            let of = past.iter().filter(|past| past.unit == unit);
            of.map(|past| past.date.as_str()).collect()
        };
        assert_eq!(of(1), ["2026-11-20", "2026-11-21", "2026-11-23"]);
        assert_eq!(of(2), ["2026-11-20", "2026-11-22"]);
    }

    /// What `forcectl zero` and runs measured counts here, what is measured here is what they
    /// compare with, and an older version's file is read.
    #[test]
    fn zeros_of_all_commands_are_one_history() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let rig = Rig::built_in().unwrap();
        let mut record = base::nominal(&rig, "2026-11-22");
        let scale = record.units[0].n_per_code;
        let text = format!(
            "unit,date,zero_n,se_n,mounting_n\n1,2026-11-20,{},0.0001,0\n",
            scale * 1_000.0
        );
        std::fs::write(store.power_ups(), text).unwrap();
        let mut configs = rig.units.map(|unit| unit.to_wire());
        configs[0].zero_code = 20_000;
        store.zeros().add(&rig.name, &configs, false).unwrap();
        let past = history(&store, &record).unwrap();
        let codes: Vec<f64> = past.iter().map(|p| p.entry.zero_n / scale).collect();
        assert_eq!(codes.len(), 2, "{past:?}");
        assert!((codes[0] - 1_000.0).abs() < 1e-6 && (codes[1] - 20_000.0).abs() < 1e-6);
        // 0.9 N more than both.
        let pulled = [(1, stream(20_000 + 131_000))];
        assert!(evaluate(&pulled, &mut record, &past, &options()).is_err());
        let accept = Options {
            replace: vec![1],
            ..options()
        };
        let found = evaluate(&pulled, &mut record, &past, &accept).unwrap();
        remember(&store, &rig.name, &found, &[1]).unwrap();
        let references = store.zeros().references().unwrap();
        assert_eq!(references.len(), 2);
        assert!(references.iter().all(|codes| codes[0] == found[0].code()));
        assert_eq!(history(&store, &record).unwrap().len(), 1);
    }
}
