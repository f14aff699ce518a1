//! Gains from weights: in which order they are hung, the readings as they are kept, and the fit.

use super::load_time::CameOn;
use super::{CalibrateError, Result};
use calibration::gain::{
    self, figures, iso376, Direction, Gain, GainError, Options, Reading, Term,
};
use calibration::record::{
    GainRecord, Iso376Record, Record, TemperatureRecord, UnitRecord, WeightsRecord,
};
use calibration::stats;
use calibration::zero::{self, Limits};
use known::store::Draft;
use std::time::Duration;

/// Header of the readings; `calibration::gain::read` takes it.
pub const HEADER: &str = "weight_g,code,standard_error,direction,time_s,since_s,since_sd_s";
/// The same with the series of ISO 376.
pub const ISO376_HEADER: &str =
    "weight_g,code,standard_error,direction,time_s,since_s,since_sd_s,series";
/// Time until cell and converter have settled after a weight was hung.
pub const SETTLE: Duration = Duration::from_millis(1000);
/// Time over which a weight is read.
pub const READ: Duration = Duration::from_millis(1000);

/// A load of the series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Weight, g; 0: the empty cell.
    pub weight_g: f64,
    /// Whether it is reached by putting weight on or taking it off.
    pub direction: Option<Direction>,
    /// Read once more while it stays: nothing is to be done for it.
    pub stays: bool,
    /// Time that it stays before it is read, beside [`SETTLE`].
    pub wait: Duration,
    /// Series of ISO 376; `None` in a series of another kind.
    pub series: Option<u8>,
}

impl Load {
    /// Whether the cell is mounted anew for this load, and in which position (degrees about its
    /// axis).
    #[must_use]
    pub fn turned_to(&self, before: Option<&Self>) -> Option<u16> {
        let degrees = match self.series? {
            3 => 120,
            5 => 240,
            _ => return None,
        };
        (before.and_then(|load| load.series) != self.series).then_some(degrees)
    }
}

/// Time from one reading to the next of a load that stays.
pub const HOLD_STEP: Duration = Duration::from_millis(2000);

/// Loads of so many rounds up and down. The empty cell stands at both ends of each round. Then the
/// largest weight is left on for a time, and off for as long: that shows creep.
#[must_use]
pub fn plan(weights_g: &[f64], rounds: usize, creep: Duration) -> Vec<Load> {
    let mut sorted = weights_g.to_vec();
    sorted.sort_by(f64::total_cmp);
    let up = |weight_g: &f64| Load {
        weight_g: *weight_g,
        direction: Some(Direction::Loading),
        stays: false,
        wait: Duration::ZERO,
        series: None,
    };
    let down = |weight_g: &f64| Load {
        weight_g: *weight_g,
        direction: Some(Direction::Unloading),
        ..up(weight_g)
    };
    let empty = Load {
        direction: None,
        ..up(&0.0)
    };
    let mut out = vec![empty];
    for _ in 0..rounds {
        out.extend(sorted.iter().map(up));
        out.extend(sorted.iter().rev().map(down));
        out.push(empty);
    }
    let steps = (creep.as_secs_f64() / HOLD_STEP.as_secs_f64()).ceil() as usize;
    if let Some(largest) = sorted.last().map(up).filter(|_| steps > 0) {
        for first in [largest, empty] {
            // How a load that stays was reached says nothing any more.
            let again = Load {
                direction: None,
                stays: true,
                ..first
            };
            out.push(first);
            out.extend(std::iter::repeat_n(again, steps));
        }
    }
    out
}

/// Time after a load came on at which the series of ISO 376 are read: at least 30 s, each the same.
const ISO376_READ_AT: Duration = Duration::from_secs(30);
/// Time for which a preload stays on: 60 to 90 s.
const ISO376_PRELOAD: Duration = Duration::from_secs(60);

/// Loads of the procedure of ISO 376 ([`iso376`]): preloads, two rising series, a rising and a
/// falling one in each of two further positions, and the largest load for five minutes.
#[must_use]
pub fn iso376_plan(weights_g: &[f64]) -> Vec<Load> {
    let mut sorted = weights_g.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    let until_read = SETTLE + READ / 2;
    let load = |series: u8, weight_g: f64, direction: Option<Direction>| Load {
        weight_g,
        direction,
        stays: false,
        wait: ISO376_READ_AT.saturating_sub(until_read),
        series: Some(series),
    };
    let (up, down) = (Some(Direction::Loading), Some(Direction::Unloading));
    let largest_g = sorted.last().copied().unwrap_or_default();
    let mut out = Vec::new();
    for _ in 0..iso376::PRELOADS {
        out.push(Load {
            wait: ISO376_PRELOAD.saturating_sub(until_read),
            ..load(gain::PRELOAD, largest_g, up)
        });
        out.push(load(gain::PRELOAD, 0.0, None));
    }
    for series in [1, 2, 3, 5] {
        out.push(load(series, 0.0, None));
        out.extend(sorted.iter().map(|w| load(series, *w, up)));
        let falls = series > 2;
        let last = series + u8::from(falls);
        if falls {
            // It begins at the largest load, which hangs already.
            let falling = sorted.iter().rev().skip(1);
            out.extend(falling.map(|w| load(last, *w, down)));
        }
        out.push(load(last, 0.0, None));
    }
    for weight_g in [largest_g, 0.0] {
        // Soon after the change, where most cells creep; then at 30 s and each 30 s to 300 s.
        let first = Load {
            wait: Duration::ZERO,
            ..load(gain::CREEP, weight_g, None)
        };
        out.push(first);
        let stays = |step: Duration| Load {
            stays: true,
            wait: step.saturating_sub(SETTLE + READ),
            ..first
        };
        // 1.5 s, and 14 times 2 s: 29.5 s.
        out.extend(std::iter::repeat_n(stays(HOLD_STEP), 14));
        out.extend(std::iter::repeat_n(stays(ISO376_READ_AT), 9));
    }
    out
}

/// The codes under one load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean {
    /// Mean code.
    pub code: f64,
    /// Its standard error, codes.
    pub standard_error: f64,
    /// Standard deviation of a single code.
    pub sd: f64,
}

/// Mean code and its standard error of a stream under one load.
///
/// # Errors
/// The stream gives none: it drifts by more than `drift_n` (N), is noisy, or stands still. The
/// limit of the noise is that of a swinging weight that has to come to rest: 50 mN.
pub fn mean(codes: &[i32], nominal_n_per_code: f64, drift_n: f64) -> Result<Mean> {
    let limits = Limits {
        nominal_n_per_code: nominal_n_per_code.abs(),
        noise_n: 0.05,
        drift_n,
        standard_error_n: 0.01,
        ..Limits::default()
    };
    let found = zero::measure(codes, &limits).map_err(CalibrateError::refused)?;
    let all: Vec<f64> = codes.iter().map(|code| f64::from(*code)).collect();
    Ok(Mean {
        code: found.mean_codes,
        standard_error: found.mean_se_codes,
        sd: stats::robust_sd(&all),
    })
}

/// How far a reading may drift while it is taken, N: what a weight that comes to rest does, and
/// where creep is looked for, what a cell does that creeps by a fifth of its load (g) in 6 s.
#[must_use]
pub fn drift_limit_n(largest_g: f64, creep: bool) -> f64 {
    let creeps = if creep {
        0.03e-3 * largest_g * 9.81
    } else {
        0.0
    };
    0.02 + creeps
}

/// Adds a reading to a draft. `at_s`: when it was read, s from the start of the series; `since`:
/// when the load came on.
///
/// # Errors
/// The file can't be written, or holds other columns.
pub fn keep(
    draft: &Draft,
    load: &Load,
    mean: &Mean,
    at_s: f64,
    since: Option<CameOn>,
) -> Result<()> {
    let direction = match load.direction {
        Some(Direction::Loading) => "loading",
        Some(Direction::Unloading) => "unloading",
        None => "",
    };
    let since = since.map_or_else(
        || ",".to_owned(),
        |since| format!("{:.3},{:.3}", since.at_s, since.sd_s),
    );
    let (weight_g, code, standard_error) = (load.weight_g, mean.code, mean.standard_error);
    let row = format!("{weight_g},{code:.3},{standard_error:.4},{direction},{at_s:.3},{since}");
    Ok(match load.series {
        None => draft.add(HEADER, &row),
        Some(series) => draft.add(ISO376_HEADER, &format!("{row},{series}")),
    }?)
}

/// A gain with the figures of its cell.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The readings that it rests on.
    pub readings: usize,
    /// The gain.
    pub gain: Gain,
    /// Linearity and hysteresis.
    pub shape: figures::Shape,
    /// The figures of ISO 376, where the readings are of its procedure.
    pub iso376: Option<iso376::Figures>,
    /// Lowest and highest temperature of the readings, degrees Celsius, where they have one.
    pub temperature_c: Option<(f64, f64)>,
}

/// The gain of a table of readings. `file` is the name that errors give.
///
/// # Errors
/// Text that can't be read, with file and line; a wrong entry, named; too few readings, an
/// implausible scale.
pub fn fit(file: &str, text: &str, options: &Options) -> Result<Fitted> {
    let readings: Vec<Reading> = gain::read(file, text).map_err(CalibrateError::input)?;
    let gain = gain::fit(&readings, options).map_err(|error| match &error {
        GainError::WrongEntries(_) => CalibrateError::refused(format!(
            "{error}\nto correct line N: --correct N=GRAM; to leave it out: --leave-out N"
        )),
        GainError::BadReading { .. }
        | GainError::BadOption { .. }
        | GainError::NoSuchLine { .. } => CalibrateError::input(&error),
        GainError::Copied { at, .. } => {
            CalibrateError::input(format!("{error}: --leave-out {}", at.line))
        }
        other => CalibrateError::refused(format!("{file}: {other}")),
    })?;
    let iso376 = iso376::is_procedure(&readings)
        .then(|| iso376::figures(&readings, &gain, options))
        .transpose()
        .map_err(|missing| CalibrateError::refused(format!("{file}: {missing}")))?;
    let temperatures = || readings.iter().filter_map(|r| r.temperature_c);
    let from = temperatures().fold(f64::INFINITY, f64::min);
    let to = temperatures().fold(f64::NEG_INFINITY, f64::max);
    Ok(Fitted {
        readings: readings.len(),
        shape: figures::shape(&gain),
        gain,
        iso376,
        temperature_c: (from <= to).then_some((from, to)),
    })
}

/// Largest normalised error En of a gain against another that agrees with it (ISO/IEC 17043): their
/// difference over the root of the sum of the squares of both 95 % uncertainties.
const LARGEST_EN: f64 = 1.0;
/// Coverage factor of 95 %.
const COVERAGE: f64 = 2.0;
/// Force at which gains are compared, N: the middle of what the weights cover. A curve may be in
/// one of two gains only.
const COMPARED_AT_N: f64 = 5.0;

/// How far a new gain is from the stored one of a unit, measured with the same acceleration of
/// gravity: relative, and as normalised error En. `None` where the unit's gain was not measured. In
/// one place, gravity is wrong by the same both times and counts in neither.
fn change(
    record: &Record,
    unit: &UnitRecord,
    gain: &Gain,
    options: &Options,
) -> Option<(f64, f64)> {
    if unit.gain_date.is_empty() {
        return None;
    }
    let new = gain.conversion();
    let code = COMPARED_AT_N / new.n_per_code;
    let force_n = |linear: f64, square: f64| (linear + square * code) * code;
    let gravity = options.gravity_m_per_s2 / record.gravity_m_per_s2;
    let old_n = gravity * force_n(unit.n_per_code, unit.n_per_code2);
    let part = force_n(new.n_per_code, new.n_per_code2) / old_n - 1.0;
    let here = gravity == 1.0;
    let without = |all: f64, gravity: f64| {
        let left = all.powi(2) - if here { gravity.powi(2) } else { 0.0 };
        left.max(0.0)
    };
    let parts = &gain.relative_parts;
    let beyond = if COMPARED_AT_N <= gain.largest_n {
        parts.beyond
    } else {
        0.0
    };
    let new_sd = gain.n_per_code_sd / gain.n_per_code;
    let variance = unit.scale_relative_sd(COMPARED_AT_N).powi(2)
        + without(record.common_gain_relative_sd, record.gravity_relative_sd)
        + without(new_sd, parts.gravity)
        - beyond.powi(2);
    Some((part, part.abs() / (COVERAGE * variance.sqrt())))
}

/// Compares gains (unit, gain) with the stored ones. The readings of another unit, or of another
/// cell, are not to take the place of a gain without a word.
///
/// # Errors
/// A gain that is not that of the unit's cell; all of them are named, and a unit whose stored gain
/// fits.
pub fn check_changes(record: &Record, found: &[(u8, &Gain)], options: &Options) -> Result<()> {
    let mut wrong = Vec::new();
    for (number, gain) in found {
        let own = record.units.iter().find(|unit| unit.number == *number);
        let Some((part, en)) = own.and_then(|unit| change(record, unit, gain, options)) else {
            continue;
        };
        if en <= LARGEST_EN {
            continue;
        }
        let fits = record
            .units
            .iter()
            .filter(|unit| unit.number != *number)
            .filter_map(|unit| Some((unit.number, change(record, unit, gain, options)?.1)))
            .filter(|(_, en)| *en <= LARGEST_EN)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let other = fits.map_or_else(String::new, |(other, _)| {
            format!(
                "; the stored gain of unit {other} fits them: are they readings of unit {other}?"
            )
        });
        wrong.push(format!(
            "unit {number}: these readings change its gain by {:+.2} % (En {en:.1}: more than 1 is more than the uncertainties of both){other}\nare weights, gravity and place those of the last time, and is the cell at rest and warm? Weigh with another set, or hang one weight once more.\nif the cell was exchanged: `forcectl calibrate serials --unit {number} --cell SERIAL --replace`; --replace accepts the gain",
            100.0 * part
        ));
    }
    if wrong.is_empty() {
        Ok(())
    } else {
        Err(CalibrateError::refused(wrong.join("\n")))
    }
}

/// How a cell is loaded that is out of its unit, in words.
pub const DISMOUNTED: &str = "dismounted, axis upright";

/// What a certificate says of a gain beside its numbers; empty where nobody said.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Traced {
    /// Number of the weights' calibration certificate.
    pub certificate: String,
    /// Serial number of the set of weights.
    pub serial: String,
    /// Who weighed.
    pub operator: String,
    /// Remarks.
    pub note: String,
    /// How the weights loaded the cell.
    pub loading: String,
    /// Temperature of the room, degrees Celsius, where no sensor gives that of the cell.
    pub temperature_c: Option<f64>,
}

/// Puts gains (unit, gain) that were measured with one set of weights in one place into the record.
/// Returns what that changed besides, in words.
///
/// Gravity and the error that all gains share stand once in a record. Where measured gains of other
/// units stay, those are carried over to the new gravity, and the larger of the two errors holds
/// for all.
///
/// # Errors
/// The record has no such unit.
pub fn apply(
    record: &mut Record,
    found: &[(u8, &Fitted)],
    options: &Options,
    traced: &Traced,
) -> Result<Vec<String>> {
    // One set of weights and one place for all units of the run.
    let shared = |gain: &Gain| {
        gain.relative_parts
            .weights
            .hypot(gain.relative_parts.gravity)
            .hypot(gain.relative_parts.pulley)
    };
    let mut common = found
        .iter()
        .map(|(_, found)| shared(&found.gain))
        .fold(0.0, f64::max);
    let old_gravity = record.gravity_m_per_s2;
    let ratio = options.gravity_m_per_s2 / old_gravity;
    let mut carried = Vec::new();
    for unit in &mut record.units {
        let stays = found.iter().all(|(number, _)| *number != unit.number);
        if stays && !unit.gain_date.is_empty() {
            // Its force per code was found with the weights' masses and the old acceleration.
            for value in [
                &mut unit.n_per_code,
                &mut unit.n_per_code_sd,
                &mut unit.n_per_code2,
                &mut unit.n_per_code2_sd,
            ] {
                *value *= ratio;
            }
            carried.push(unit.number.to_string());
        }
    }
    let mut notes = Vec::new();
    if !carried.is_empty() {
        common = common.max(record.common_gain_relative_sd);
        if ratio != 1.0 {
            notes.push(format!(
                "gravity is {} m/s^2 and was {old_gravity}: the gains of unit {}, which are not of this run, are multiplied by {ratio:.6}",
                options.gravity_m_per_s2,
                carried.join(", ")
            ));
        }
    }
    record.gravity_m_per_s2 = options.gravity_m_per_s2;
    record.common_gain_relative_sd = common;
    record.gravity_relative_sd = options.gravity_relative_sd;
    for (unit, found) in found {
        enter(record, *unit, found, options, traced)?;
    }
    Ok(notes)
}

/// Puts the gain of one unit in.
fn enter(
    record: &mut Record,
    unit: u8,
    fitted: &Fitted,
    options: &Options,
    traced: &Traced,
) -> Result<()> {
    let date = record.date.clone();
    let gain = &fitted.gain;
    let parts = gain.relative_parts;
    let found: &mut UnitRecord = record
        .units
        .iter_mut()
        .find(|u| u.number == unit)
        .ok_or_else(|| CalibrateError::input(format!("there is no unit {unit}")))?;
    let conversion = gain.conversion();
    found.n_per_code = conversion.n_per_code;
    found.n_per_code_sd =
        parts.readings.hypot(parts.beyond).hypot(parts.remounting) * conversion.n_per_code.abs();
    found.n_per_code2 = conversion.n_per_code2;
    found.n_per_code2_sd = conversion.n_per_code2_sd;
    (found.creep, found.creep_sd, found.creep_s) = gain
        .creep
        .map_or((0.0, 0.0, 0.0), |c| (c.share, c.share_se, c.time_s));
    found.gain_date = date;
    let hysteresis = fitted.shape.hysteresis;
    found.gain = Some(GainRecord {
        readings: fitted.readings as u32,
        largest_n: gain.largest_n,
        half_95_relative: gain.n_per_code_half_95 / gain.n_per_code.abs(),
        readings_sd: parts.readings,
        weights_sd: parts.weights,
        gravity_sd: parts.gravity,
        beyond_sd: parts.beyond,
        remounting_sd: parts.remounting,
        pulley_sd: parts.pulley,
        repeatability_n: gain.repeatability_codes * gain.n_per_code.abs(),
        chi_square: gain.chi_square,
        degrees_of_freedom: gain.degrees_of_freedom as u32,
        linearity_n: fitted.shape.linearity_n,
        hysteresis_n: hysteresis.map_or(0.0, |h| h.largest_n),
        hysteresis_se_n: hysteresis.map_or(0.0, |h| h.standard_error_n),
        residuals: (gain.residuals.iter())
            .map(|r| [r.force_n, 1e3 * r.residual_n, 1e3 * r.sd_n])
            .collect(),
        gravity_m_per_s2: options.gravity_m_per_s2,
        operator: traced.operator.clone(),
        note: traced.note.clone(),
        loading: traced.loading.clone(),
        weights: WeightsRecord {
            tolerance: options.weights.tolerance.to_string(),
            correlation: options.weights.correlation,
            certificate: traced.certificate.clone(),
            serial: traced.serial.clone(),
        },
        temperature: temperature(fitted, traced),
        iso376: fitted.iso376.as_ref().map(iso376_record),
    });
    Ok(())
}

/// The temperature of a series, and what it changes.
fn temperature(fitted: &Fitted, traced: &Traced) -> Option<TemperatureRecord> {
    let room = traced.temperature_c.map(|c| (c, c));
    let (from_c, to_c) = fitted.temperature_c.or(room)?;
    let gain = &fitted.gain;
    let slope = gain.codes_per_n;
    let term = |term: Term| {
        let found = gain.terms.get(&term);
        found.map_or((0.0, 0.0), |c| {
            (c.value / slope, (c.standard_error / slope).abs())
        })
    };
    let (scale, zero) = (term(Term::SlopeTemperature), term(Term::ZeroTemperature));
    Some(TemperatureRecord {
        from_c,
        to_c,
        // More codes for a newton are fewer newtons for a code.
        scale_per_k: -scale.0,
        scale_per_k_sd: scale.1,
        zero_n_per_k: zero.0,
        zero_n_per_k_sd: zero.1,
    })
}

fn iso376_record(figures: &iso376::Figures) -> Iso376Record {
    let class = figures.class();
    Iso376Record {
        class: class.map_or_else(String::new, |found| found.class.to_string()),
        from_n: class.map_or(0.0, |found| found.from_n),
        to_n: class.map_or(0.0, |found| found.to_n),
        in_the_way: figures
            .in_the_way()
            .into_iter()
            .map(str::to_owned)
            .collect(),
        zero: figures.zero,
        creep: figures.creep,
        resolution_n: figures.resolution_n,
        degree: figures.degree as u8,
        loads: (figures.loads.iter())
            .map(|load| {
                [
                    load.force_n,
                    load.reproducibility,
                    load.repeatability,
                    load.interpolation,
                    load.reversibility,
                    load.force_95,
                    2.0 * load.u,
                ]
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calibration::gain::{Class, Tolerance, WeightSet};
    use calibration::STANDARD_GRAVITY_M_PER_S2;
    use known::base;
    use known::store::Store;
    use rig::Rig;

    /// Readings of a cell of 7e-6 N per code, with line `wrong` entered as another weight.
    fn table(wrong: Option<(usize, f64)>) -> String {
        table_of(7e-6, wrong)
    }

    fn table_of(n_per_code: f64, wrong: Option<(usize, f64)>) -> String {
        let mut text = format!("{HEADER}\n");
        for (i, load) in plan(&gain::WEIGHTS_G, 2, Duration::ZERO).iter().enumerate() {
            let noise = [30.0, -20.0, 10.0, -35.0][i % 4];
            let code = 1000.0 + load.weight_g * 9.80665e-3 / n_per_code + noise + 1e-3 * i as f64;
            let weight = match wrong {
                Some((line, weight)) if line == i + 2 => weight,
                _ => load.weight_g,
            };
            text.push_str(&format!("{weight},{code},30,,,,\n"));
        }
        text
    }

    #[test]
    fn a_series_goes_up_and_down_and_its_gain_enters_the_record() {
        let loads = plan(&[100.0, 10.0], 2, Duration::ZERO);
        let weights: Vec<f64> = loads.iter().map(|l| l.weight_g).collect();
        assert_eq!(
            weights,
            [0.0, 10.0, 100.0, 100.0, 10.0, 0.0, 10.0, 100.0, 100.0, 10.0, 0.0]
        );
        let options = Options::default();
        let found = fit("w.csv", &table(None), &options).unwrap();
        assert!((found.gain.n_per_code / 7e-6 - 1.0).abs() < 5e-4);
        let mut record = base::nominal(&Rig::built_in().unwrap(), "2026-11-22");
        let notes = apply(&mut record, &[(4, &found)], &options, &Traced::default()).unwrap();
        assert!(notes.is_empty(), "{notes:?}");
        assert_eq!(record.units[3].gain_date, "2026-11-22");
        assert!(record.common_gain_relative_sd >= 0.001);
        assert!(apply(
            &mut record.clone(),
            &[(9, &found)],
            &options,
            &Traced::default()
        )
        .is_err());
        record.write().unwrap();
    }

    #[test]
    fn the_procedure_of_iso_376_has_its_sequence_and_times() {
        let loads = iso376_plan(&iso376::WEIGHTS_G);
        let of = |series: u8| loads.iter().filter(move |l| l.series == Some(series));
        assert_eq!(
            of(gain::PRELOAD).filter(|l| l.weight_g == 1000.0).count(),
            3
        );
        for (series, count) in [(1, 10), (2, 10), (3, 9), (4, 8), (5, 9), (6, 8)] {
            assert_eq!(of(series).count(), count, "{series}");
        }
        let turned: Vec<(usize, u16)> = (loads.iter().enumerate())
            .filter_map(|(i, l)| Some((i, l.turned_to(i.checked_sub(1).map(|b| &loads[b]))?)))
            .collect();
        assert_eq!(turned.iter().map(|t| t.1).collect::<Vec<_>>(), [120, 240]);
        assert!(turned.iter().all(|(i, _)| loads[*i].weight_g == 0.0));
        // Each load of a series is read 30 s after it came on; the last stays until 300 s.
        let at = |l: &Load| (l.wait + SETTLE + READ / 2).as_secs_f64();
        assert!((1..=6).flat_map(of).all(|l| at(l) == 30.0 && !l.stays));
        let on = of(gain::CREEP).filter(|l| l.weight_g > 0.0);
        let read: Vec<f64> = on
            .scan(0.0, |now, l| {
                *now += (l.wait + SETTLE + READ).as_secs_f64();
                Some(*now - 0.5)
            })
            .collect();
        for wanted in [30.0, 300.0] {
            assert!(read.iter().any(|t| (t - wanted).abs() < 1.0), "{read:?}");
        }
    }

    #[test]
    fn temperature_is_kept_with_what_it_changes() {
        let mut text = "weight_g,code,standard_error,temperature_c\n".to_owned();
        for (i, load) in plan(&gain::WEIGHTS_G, 3, Duration::ZERO).iter().enumerate() {
            let warm = 6.0 * (0.4 * i as f64).sin();
            let force = load.weight_g * 9.80665e-3;
            let noise = [30.0, -20.0, 10.0, -35.0][i % 4] + 1e-3 * i as f64;
            let code = (force * (1.0 + 3e-4 * warm) + 2e-3 * warm) / 7e-6 + noise;
            text.push_str(&format!("{},{code},30,{:.3}\n", load.weight_g, 23.0 + warm));
        }
        let options = Options::default();
        let found = fit("w.csv", &text, &options).unwrap();
        let mut record = base::nominal(&Rig::built_in().unwrap(), "2026-11-22");
        apply(&mut record, &[(1, &found)], &options, &Traced::default()).unwrap();
        let kept = record.units[0].gain.clone().unwrap().temperature.unwrap();
        assert!((kept.scale_per_k + 3e-4).abs() < 3e-5, "{kept:?}");
        assert!(
            (kept.zero_n_per_k - 2e-3).abs() < 2e-4 && kept.scale_per_k_sd > 0.0,
            "{kept:?}"
        );
        assert!(kept.from_c < 18.0 && kept.to_c > 28.0);
        record.write().unwrap();
        // Without a sensor, what the user says; nothing where nobody did.
        let plain = fit("w.csv", &table(None), &options).unwrap();
        let room = Traced {
            temperature_c: Some(22.5),
            ..Traced::default()
        };
        apply(&mut record, &[(1, &plain), (2, &plain)], &options, &room).unwrap();
        let kept = record.units[1].gain.clone().unwrap().temperature.unwrap();
        assert_eq!((kept.from_c, kept.scale_per_k_sd), (22.5, 0.0));
        apply(&mut record, &[(1, &plain)], &options, &Traced::default()).unwrap();
        assert_eq!(record.units[0].gain.clone().unwrap().temperature, None);
    }

    #[test]
    fn readings_of_another_unit_do_not_take_the_place_of_a_gain() {
        let options = Options::default();
        let gain = |scale| fit("w.csv", &table_of(scale, None), &options).unwrap();
        let mut record = base::nominal(&Rig::built_in().unwrap(), "2026-11-22");
        let (three, four) = (gain(7e-6), gain(6.8e-6));
        // Nothing was measured: anything is taken.
        check_changes(&record, &[(3, &three.gain), (4, &four.gain)], &options).unwrap();
        apply(
            &mut record,
            &[(3, &three), (4, &four)],
            &options,
            &Traced::default(),
        )
        .unwrap();
        let told = check_changes(&record, &[(3, &four.gain)], &options)
            .unwrap_err()
            .to_string();
        assert!(
            told.contains("unit 3: these readings change its gain by -2.8")
                && told.contains("stored gain of unit 4 fits")
                && told.contains("serials --unit 3 --cell SERIAL --replace"),
            "{told}"
        );
        // A cell that no unit has.
        let told = check_changes(&record, &[(3, &gain(6.9e-6).gain)], &options)
            .unwrap_err()
            .to_string();
        assert!(told.contains("-1.4") && !told.contains("fits"), "{told}");
        // What a cell does from year to year, a set of weights that is 0.5 % low, and the same cell
        // in another place.
        check_changes(&record, &[(3, &gain(7.001e-6).gain)], &options).unwrap();
        let low = gain(0.995 * 7e-6);
        let told = check_changes(&record, &[(3, &low.gain)], &options)
            .unwrap_err()
            .to_string();
        assert!(
            told.contains("-0.50 % (En ") && told.contains("--replace accepts"),
            "{told}"
        );
        let elsewhere = Options {
            gravity_m_per_s2: 9.79,
            ..Options::default()
        };
        let moved = fit("w.csv", &table_of(7e-6, None), &elsewhere)
            .unwrap()
            .gain;
        assert!((moved.n_per_code / three.gain.n_per_code - 9.79 / 9.80665).abs() < 1e-5);
        check_changes(&record, &[(3, &moved)], &elsewhere).unwrap();
    }

    #[test]
    fn a_unit_weighed_alone_leaves_the_others_as_well_known_as_they_are() {
        let rough = Options::default();
        let fine = Options {
            gravity_m_per_s2: 9.7807,
            gravity_relative_sd: 2e-5,
            weights: WeightSet {
                tolerance: Tolerance::Class(Class::F2),
                ..WeightSet::default()
            },
            ..Options::default()
        };
        let gain = |options: &Options| fit("w.csv", &table(None), options).unwrap();
        let (first, again) = (gain(&rough), gain(&fine));
        let mut record = base::nominal(&Rig::built_in().unwrap(), "2026-11-22");
        apply(
            &mut record,
            &[(1, &first), (2, &first)],
            &rough,
            &Traced::default(),
        )
        .unwrap();
        let before = record.clone();
        let notes = apply(&mut record, &[(2, &again)], &fine, &Traced::default()).unwrap();
        assert!(
            notes.len() == 1 && notes[0].contains("gains of unit 1, which"),
            "{notes:?}"
        );
        let ratio = 9.7807 / STANDARD_GRAVITY_M_PER_S2;
        let (old, new) = (&before.units[0], &record.units[0]);
        assert!((new.n_per_code / old.n_per_code / ratio - 1.0).abs() < 1e-12);
        assert!((new.n_per_code_sd / old.n_per_code_sd / ratio - 1.0).abs() < 1e-12);
        // Unit 3 was never weighed.
        assert_eq!(before.units[2].n_per_code, record.units[2].n_per_code);
        // The weights of unit 1 are still those of the first run.
        assert_eq!(
            record.common_gain_relative_sd,
            before.common_gain_relative_sd
        );
        assert_eq!(record.gravity_m_per_s2, 9.7807);
        // All that are measured in one run: its own error, and nothing is carried over.
        let notes = apply(
            &mut record,
            &[(1, &again), (2, &again)],
            &fine,
            &Traced::default(),
        )
        .unwrap();
        assert!(notes.is_empty(), "{notes:?}");
        assert!(record.common_gain_relative_sd < 1e-4);
        record.write().unwrap();
    }

    #[test]
    fn bad_readings_are_named_with_file_and_line() {
        let fails = |text: &str| {
            fit("w.csv", text, &Options::default())
                .unwrap_err()
                .to_string()
        };
        // 500 for 50, in line 5.
        let wrong = fails(&table(Some((5, 500.0))));
        assert!(
            wrong.contains("w.csv:5: entered 500 g") && wrong.contains("probably 50 g"),
            "{wrong}"
        );
        assert!(wrong.contains("--correct") && wrong.contains("nothing was stored"));
        let corrected = Options {
            corrections_g: [(5, 50.0)].into(),
            ..Options::default()
        };
        assert!(fit("w.csv", &table(Some((5, 500.0))), &corrected).is_ok());
        assert!(fails("").contains("w.csv: the file is empty"));
        assert!(fails(&format!("{HEADER}\n10,1e3,30,,,,\n20,abc,30,,,,\n"))
            .starts_with("w.csv:3: `abc`"));
        assert!(fails(&format!("{HEADER}\n10,NaN,30,,,,\n")).starts_with("w.csv:2: `NaN`"));
        assert!(fails(&format!("{HEADER}\n10,1000,30,,,,\n")).contains("at least 3 readings"));
        // A quadratic cell keeps its curve.
        let mut text = format!("{HEADER}\n");
        for (i, load) in plan(&gain::WEIGHTS_G, 2, Duration::ZERO).iter().enumerate() {
            let force = load.weight_g * 9.80665e-3;
            let code = (force + 2e-3 * force * force) / 7e-6 + 1e-3 * i as f64;
            text.push_str(&format!("{},{code},20,,,,\n", load.weight_g));
        }
        let curved = fit("w.csv", &text, &Options::default()).unwrap();
        let found = curved.gain.conversion();
        let code = (5.0 + 2e-3 * 25.0) / 7e-6;
        let force = found.n_per_code * code + found.n_per_code2 * code * code;
        assert!((force - 5.0).abs() < 1e-3, "{found:?}");
        assert!(found.n_per_code2_sd < -0.05 * found.n_per_code2);
    }

    #[test]
    fn what_is_kept_can_be_fitted() {
        let folder = tempfile::tempdir().unwrap();
        let draft = Store::at(folder.path()).draft("gain-unit1");
        let loads = plan(&gain::WEIGHTS_G, 2, Duration::ZERO);
        for (i, load) in loads.iter().enumerate() {
            let code = 500.0 + load.weight_g * 9.80665e-3 / 6.5e-6 + [9.0, -12.0, 4.0][i % 3];
            let mean = Mean {
                code,
                standard_error: 15.0,
                sd: 200.0,
            };
            let at_s = 2.0 * i as f64;
            // One that was not seen.
            let since = (i != 4).then_some(CameOn {
                at_s: at_s - 1.5,
                sd_s: 0.02,
            });
            keep(&draft, load, &mean, at_s, since).unwrap();
        }
        let text = draft.text().unwrap().unwrap();
        let found = fit("draft", &text, &Options::default()).unwrap();
        assert_eq!(found.readings, loads.len());
        assert!(found.shape.hysteresis.is_some());
        let mut codes: Vec<i32> = (0..320).map(|i| 1000 + (i * 37) % 21).collect();
        let found = mean(&codes, 6.85e-6, 0.02).unwrap();
        assert!((found.code - 1010.0).abs() < 1.0 && found.standard_error > 0.0);
        assert!((3.0..12.0).contains(&found.sd), "{found:?}");
        codes.truncate(10);
        assert!(mean(&codes, 6.85e-6, 0.02).is_err());
    }
}
