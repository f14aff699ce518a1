//! The readings of a series of weights, and what can't be used among them.

use super::{GainError, Options, Tolerance};
use crate::input::{InputError, Location, Row, Table};
use crate::{gravity, stats};

/// Whether a weight was put on or taken off to come to this load.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Direction {
    /// The load went up.
    Loading,
    /// The load went down.
    Unloading,
}

/// One reading: the mean code under one weight.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Where it was entered.
    pub at: Location,
    /// Weight as entered, g; 0 for the empty cell.
    pub weight_g: f64,
    /// Mean code.
    pub code: f64,
    /// Standard error of the mean code, autocorrelation included; see [`crate::zero::measure`].
    pub standard_error_codes: f64,
    /// Which way the load was reached, where known.
    pub direction: Option<Direction>,
    /// Middle of the reading, s from some start, where known.
    pub time_s: Option<f64>,
    /// When the load came on, s from the same start, where known.
    pub since_s: Option<f64>,
    /// Standard error of [`Self::since_s`], s, where known; else [`Options::load_time_sd_s`] stands
    /// for it.
    pub since_sd_s: Option<f64>,
    /// Temperature of the cell, degrees Celsius, where a sensor gives it.
    pub temperature_c: Option<f64>,
    /// Series of [`super::iso376`] that it belongs to: [`PRELOAD`], 1 to 6 as in the standard, or
    /// [`CREEP`]. `None`: the readings are of no such procedure.
    pub series: Option<u8>,
}

/// Series of the preloads, which count in no fit.
pub const PRELOAD: u8 = 0;
/// Series of the load that stays on at last.
pub const CREEP: u8 = 7;

/// Columns that a table of readings may have.
const COLUMNS: [&str; 9] = [
    "weight_g",
    "code",
    "standard_error",
    "direction",
    "time_s",
    "since_s",
    "since_sd_s",
    "temperature_c",
    "series",
];

/// Reads a table with the columns `weight_g`, `code`, `standard_error` (codes) and, where known,
/// `direction` (`loading` or `unloading`), `time_s`, `since_s`, `since_sd_s`, `temperature_c`,
/// `series` (0 to 7, see [`super::iso376`]). `file` is the name that errors give. Without
/// `standard_error`, the scatter of the readings of one weight stands for it.
///
/// # Errors
/// [`InputError`] with the line of the first cell that can't be used: weights from 0 to 3,000 g,
/// codes of 24 bits, standard errors above 0, standard errors of times not below 0, temperatures in
/// all lines or in none.
pub fn read(file: &str, text: &str) -> Result<Vec<Reading>, InputError> {
    let table = Table::parse(file, text)?;
    table.check_columns(&COLUMNS)?;
    let weight = table.column("weight_g")?;
    let code = table.column("code")?;
    let error = table.find("standard_error");
    let direction = table.find("direction");
    let time = table.find("time_s");
    let since = table.find("since_s");
    let since_sd = table.find("since_sd_s");
    let temperature = table.find("temperature_c");
    let series = table.find("series");
    if let Some(column) = temperature {
        let blank = |row: &&Row| table.text(row, column).is_empty();
        // The temperature would count for no reading at all then, without a word.
        if let Some(row) = table.rows().iter().find(blank) {
            if !table.rows().iter().all(|row| blank(&row)) {
                let problem = "other lines have a temperature; fill it in, or leave the column out";
                return Err(table.bad_value(row, column, problem));
            }
        }
    }
    let readings: Result<Vec<Reading>, InputError> = table
        .rows()
        .iter()
        .map(|row| {
            let weight_g = table.number(row, weight)?;
            if !(0.0..=3000.0).contains(&weight_g) {
                return Err(table.bad_value(row, weight, "a weight is 0 to 3000 g"));
            }
            let mean = table.number(row, code)?;
            if mean.abs() > f64::from(1 << 23) {
                return Err(table.bad_value(row, code, "a code has 24 bits: -8388608 to 8388607"));
            }
            if mean.abs() >= f64::from((1 << 23) - 1) {
                let problem = "the end of the converter's range, beyond which it shows no load; take the line out, and weigh less or with another gain of the converter";
                return Err(table.bad_value(row, code, problem));
            }
            let standard_error_codes = match error {
                Some(error) => {
                    let found = table.number(row, error)?;
                    if found <= 0.0 {
                        return Err(table.bad_value(row, error, "a standard error is above 0"));
                    }
                    found
                }
                // From the repeats, below.
                None => 0.0,
            };
            let direction = match direction.map(|c| (c, table.text(row, c).to_lowercase())) {
                None => None,
                Some((_, text)) if text.is_empty() => None,
                Some((_, text)) if text == "loading" => Some(Direction::Loading),
                Some((_, text)) if text == "unloading" => Some(Direction::Unloading),
                Some((c, _)) => {
                    return Err(table.bad_value(row, c, "a direction is `loading` or `unloading`"))
                }
            };
            let since_sd_s = table.optional_number(row, since_sd)?;
            if let Some(column) = since_sd.filter(|_| since_sd_s.is_some_and(|sd| sd < 0.0)) {
                return Err(table.bad_value(
                    row,
                    column,
                    "a standard error of a time is 0 or above",
                ));
            }
            Ok(Reading {
                at: row.at.clone(),
                weight_g,
                code: mean,
                standard_error_codes,
                direction,
                time_s: table.optional_number(row, time)?,
                since_s: table.optional_number(row, since)?,
                since_sd_s,
                temperature_c: table.optional_number(row, temperature)?,
                series: match table.optional_number(row, series)? {
                    None => None,
                    Some(number)
                        if number.fract() == 0.0 && (0.0..=f64::from(CREEP)).contains(&number) =>
                    {
                        Some(number as u8)
                    }
                    Some(_) => {
                        let column = series.unwrap_or_default();
                        return Err(table.bad_value(
                            row,
                            column,
                            "a series is 0 (preload), 1 to 6, or 7 (creep)",
                        ));
                    }
                },
            })
        })
        .collect();
    let mut readings = readings?;
    if error.is_none() {
        let scatter = scatter_of_repeats(&readings).map_err(|why| table.no_scatter(why))?;
        for reading in &mut readings {
            reading.standard_error_codes = scatter;
        }
    }
    Ok(readings)
}

/// Repeats beyond the first of each weight that give a standard error: fewer are known to a factor
/// of two only.
const LEAST_REPEATS: usize = 4;

/// Repeats of a weight scatter too much to be the same load where their standard deviation is
/// above so many times that of the others, and above this part of the range of the codes: no noise
/// is as large, and a cell's hysteresis is 1 % of the range at most.
const OTHER_LOAD: (f64, f64) = (30.0, 0.02);

/// Standard deviation of a reading, codes, from the readings of the same weight, or why they tell
/// none. A weight among whose repeats is another load does not count: it would hide itself.
fn scatter_of_repeats(readings: &[Reading]) -> Result<f64, String> {
    let mut groups: Vec<(f64, usize)> = Vec::new();
    for (i, reading) in readings.iter().enumerate() {
        let same = || readings.iter().filter(|r| r.weight_g == reading.weight_g);
        let first = readings[..i].iter().all(|r| r.weight_g != reading.weight_g);
        if first && same().count() > 1 {
            let count = same().count();
            let mean = same().map(|r| r.code).sum::<f64>() / count as f64;
            groups.push((
                same().map(|r| (r.code - mean).powi(2)).sum::<f64>(),
                count - 1,
            ));
        }
    }
    let sd = |(square, free): &(f64, usize)| (square / *free as f64).sqrt();
    let usual = stats::median(&groups.iter().map(sd).collect::<Vec<f64>>());
    let codes = || readings.iter().map(|r| r.code);
    let range = codes().fold(f64::NEG_INFINITY, f64::max) - codes().fold(f64::INFINITY, f64::min);
    let (times, part) = OTHER_LOAD;
    groups.retain(|group| !(sd(group) > times * usual && sd(group) > part * range));
    let square: f64 = groups.iter().map(|(square, _)| square).sum();
    let free: usize = groups.iter().map(|(_, free)| free).sum();
    if free < LEAST_REPEATS {
        return Err(format!(
            "lines that repeat a weight stand for it from {LEAST_REPEATS} on, here are {free}"
        ));
    }
    if square <= 0.0 {
        return Err("the lines that repeat a weight have the same code".to_owned());
    }
    Ok((square / free as f64).sqrt())
}

/// The readings with corrections made and lines left out, or what can't be used.
pub(super) fn usable(readings: &[Reading], options: &Options) -> Result<Vec<Reading>, GainError> {
    let bad = |name, value, advice| GainError::BadOption {
        name,
        value,
        advice,
    };
    let g = options.gravity_m_per_s2;
    if !gravity::ON_EARTH_M_PER_S2.contains(&g) {
        return Err(bad("gravity_m_per_s2", g, "on Earth it is 9.76 to 9.84"));
    }
    let correlation = options.weights.correlation;
    if !(0.0..=1.0).contains(&correlation) {
        return Err(bad("correlation", correlation, "it is 0 to 1"));
    }
    let tolerance = match options.weights.tolerance {
        Tolerance::Relative(part) => part,
        Tolerance::Class(_) => 0.0,
    };
    for (name, value) in [
        ("gravity_relative_sd", options.gravity_relative_sd),
        ("air_buoyancy", options.air_buoyancy),
        ("pulley_friction", options.pulley_friction.unwrap_or(0.0)),
        ("tolerance", tolerance),
    ] {
        if !(0.0..0.1).contains(&value) {
            return Err(bad(
                name,
                value,
                "it is relative, 0 to 0.1 (0.1 % is 0.001)",
            ));
        }
    }
    if !(0.0..=60.0).contains(&options.load_time_sd_s) {
        let advice = "a standard error of a time is 0 to 60 s";
        return Err(bad("load_time_sd_s", options.load_time_sd_s, advice));
    }
    for &line in options.left_out.iter().chain(options.corrections_g.keys()) {
        if !readings.iter().any(|r| r.at.line == line) {
            return Err(GainError::NoSuchLine { line });
        }
    }
    let mut used = Vec::new();
    for reading in readings {
        let preload = reading.series == Some(PRELOAD);
        if preload || options.left_out.contains(&reading.at.line) {
            continue;
        }
        let mut reading = reading.clone();
        if let Some(&weight) = options.corrections_g.get(&reading.at.line) {
            reading.weight_g = weight;
        }
        let check = |what, value: f64, ok: bool, advice| {
            if ok && value.is_finite() {
                Ok(())
            } else {
                Err(GainError::BadReading {
                    at: reading.at.clone(),
                    what,
                    value,
                    advice,
                })
            }
        };
        check(
            "the weight",
            reading.weight_g,
            reading.weight_g >= 0.0,
            "it has to be finite and not negative",
        )?;
        check("the code", reading.code, true, "it has to be finite")?;
        check(
            "the standard error",
            reading.standard_error_codes,
            reading.standard_error_codes > 0.0,
            "it has to be finite and above 0",
        )?;
        for (what, value) in [
            ("the time", reading.time_s),
            ("the time of the load", reading.since_s),
            ("the standard error of that time", reading.since_sd_s),
            ("the temperature", reading.temperature_c),
        ] {
            check(what, value.unwrap_or(0.0), true, "it has to be finite")?;
        }
        used.push(reading);
    }
    no_copies(&used)?;
    level(&mut used);
    let weights = different_weights(&used);
    if used.len() < 3 || weights < 3 {
        return Err(GainError::TooFew {
            readings: used.len(),
            weights,
        });
    }
    Ok(used)
}

/// Refuses rows that are there twice: they would count as readings of their own and make the
/// interval too narrow.
fn no_copies(readings: &[Reading]) -> Result<(), GainError> {
    for (i, reading) in readings.iter().enumerate() {
        let is_copy = |earlier: &&Reading| {
            let same = earlier.weight_g == reading.weight_g && earlier.code == reading.code;
            same && match (earlier.time_s, reading.time_s) {
                (Some(a), Some(b)) => a == b,
                // Without times: two means with all their digits equal. A whole number may come
                // back by chance.
                (None, None) => {
                    reading.code.fract() != 0.0
                        && earlier.standard_error_codes == reading.standard_error_codes
                }
                _ => false,
            }
        };
        if let Some(of) = readings[..i].iter().find(is_copy) {
            return Err(GainError::Copied {
                at: reading.at.clone(),
                of: of.at.line,
            });
        }
    }
    Ok(())
}

/// Takes the steps of the zero from one mounting of the cell to the next off the codes: they are no
/// mistake of the readings. What the empty cells don't tell exactly is a column of the fit.
fn level(used: &mut [Reading]) {
    let empty = |used: &[Reading], mounting: u8| {
        let codes = used.iter().filter(|r| r.weight_g == 0.0);
        let codes: Vec<f64> = codes
            .filter(|r| r.mounting() == mounting)
            .map(|r| r.code)
            .collect();
        Some(stats::median(&codes)).filter(|code| code.is_finite())
    };
    let Some(first) = empty(used, 0) else {
        return;
    };
    for mounting in [1, 2] {
        let Some(code) = empty(used, mounting) else {
            continue;
        };
        for reading in used.iter_mut().filter(|r| r.mounting() == mounting) {
            reading.code += first - code;
        }
    }
}

/// How many different weights there are, the empty cell counted.
pub(super) fn different_weights(readings: &[Reading]) -> usize {
    let mut weights: Vec<f64> = readings.iter().map(|r| r.weight_g).collect();
    weights.sort_by(f64::total_cmp);
    weights.dedup();
    weights.len()
}
