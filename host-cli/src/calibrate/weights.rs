//! Gains from weights: in which order they are hung, the readings as they are kept, and the fit.

use super::store::Draft;
use super::{CalibrateError, Result};
use calibration::gain::{self, figures, Direction, Gain, GainError, Options, Reading, Term};
use calibration::record::{Record, UnitRecord};
use calibration::zero::{self, Limits};
use std::time::Duration;

/// Header of the readings; `calibration::gain::read` takes it.
pub const HEADER: &str = "weight_g,code,standard_error,direction,time_s";
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
}

/// Loads of so many rounds up and down. The empty cell stands at both ends of each round.
#[must_use]
pub fn plan(weights_g: &[f64], rounds: usize) -> Vec<Load> {
    let mut sorted = weights_g.to_vec();
    sorted.sort_by(f64::total_cmp);
    let up = |weight_g: &f64| Load {
        weight_g: *weight_g,
        direction: Some(Direction::Loading),
    };
    let down = |weight_g: &f64| Load {
        weight_g: *weight_g,
        direction: Some(Direction::Unloading),
    };
    let empty = Load {
        weight_g: 0.0,
        direction: None,
    };
    let mut out = vec![empty];
    for _ in 0..rounds {
        out.extend(sorted.iter().map(up));
        out.extend(sorted.iter().rev().map(down));
        out.push(empty);
    }
    out
}

/// Mean code and its standard error of a stream under one load.
///
/// # Errors
/// The stream gives none: it drifts, is noisy, or stands still. Limits are those of a swinging weight that has to come to
/// rest: 20 mN of drift, 50 mN of noise.
pub fn mean(codes: &[i32], nominal_n_per_code: f64) -> Result<(f64, f64)> {
    let limits = Limits {
        nominal_n_per_code: nominal_n_per_code.abs(),
        noise_n: 0.05,
        drift_n: 0.02,
        standard_error_n: 0.01,
        ..Limits::default()
    };
    let found = zero::measure(codes, &limits).map_err(CalibrateError::refused)?;
    Ok((found.mean_codes, found.mean_se_codes))
}

/// Adds a reading to a draft. `time_s`: since the first reading.
///
/// # Errors
/// The file can't be written.
pub fn keep(draft: &Draft, load: &Load, mean: (f64, f64), time_s: f64) -> Result<()> {
    let direction = match load.direction {
        Some(Direction::Loading) => "loading",
        Some(Direction::Unloading) => "unloading",
        None => "",
    };
    draft.add(
        HEADER,
        &format!(
            "{},{:.3},{:.4},{direction},{time_s:.1}",
            load.weight_g, mean.0, mean.1
        ),
    )
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
}

/// The gain of a table of readings. `file` is the name that errors give.
///
/// # Errors
/// Text that can't be read, with file and line; a wrong entry, named; too few readings, an implausible scale.
pub fn fit(file: &str, text: &str, options: &Options) -> Result<Fitted> {
    let readings: Vec<Reading> = gain::read(file, text).map_err(CalibrateError::input)?;
    let gain = gain::fit(&readings, options).map_err(|error| match error {
        GainError::WrongEntries(_) => CalibrateError::refused(format!(
            "{error}\nto correct line N: --correct N=GRAM; to leave it out: --leave-out N"
        )),
        GainError::BadReading { .. } => CalibrateError::input(error),
        other => CalibrateError::refused(format!("{file}: {other}")),
    })?;
    Ok(Fitted {
        readings: readings.len(),
        shape: figures::shape(&gain),
        gain,
    })
}

/// Curvature of a fit, N per code^2; 0 for a straight cell.
#[must_use]
pub fn curvature(gain: &Gain) -> f64 {
    // code = b F + k F^2, so F = code / b - k code^2 / b^3 to second order.
    gain.terms
        .get(&Term::Quadratic)
        .map_or(0.0, |k| -k.value / gain.codes_per_n.powi(3))
}

/// Puts a gain into the record.
///
/// # Errors
/// The record has no such unit.
pub fn apply(record: &mut Record, unit: u8, gain: &Gain, options: &Options) -> Result<()> {
    let date = record.date.clone();
    record.gravity_m_per_s2 = options.gravity_m_per_s2;
    let parts = gain.relative_parts;
    // One set of weights and one place for all units.
    record.common_gain_relative_sd = parts.weights.hypot(parts.gravity);
    let found: &mut UnitRecord = record
        .units
        .iter_mut()
        .find(|u| u.number == unit)
        .ok_or_else(|| CalibrateError::refused(format!("there is no unit {unit}")))?;
    found.n_per_code = gain.n_per_code;
    found.n_per_code_sd = parts.readings * gain.n_per_code.abs();
    found.n_per_code2 = curvature(gain);
    found.gain_date = date;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::base;
    use crate::calibrate::store::Store;
    use crate::rigfile::RigFile;

    /// Readings of a cell of 7e-6 N per code, with line `wrong` entered as another weight.
    fn table(wrong: Option<(usize, f64)>) -> String {
        let mut text = format!("{HEADER}\n");
        for (i, load) in plan(&gain::WEIGHTS_G, 2).iter().enumerate() {
            let noise = [30.0, -20.0, 10.0, -35.0][i % 4];
            let code = 1000.0 + load.weight_g * 9.80665e-3 / 7e-6 + noise;
            let weight = match wrong {
                Some((line, weight)) if line == i + 2 => weight,
                _ => load.weight_g,
            };
            text.push_str(&format!("{weight},{code},30,,\n"));
        }
        text
    }

    #[test]
    fn a_series_goes_up_and_down_and_its_gain_enters_the_record() {
        let loads = plan(&[100.0, 10.0], 2);
        let weights: Vec<f64> = loads.iter().map(|l| l.weight_g).collect();
        assert_eq!(
            weights,
            [0.0, 10.0, 100.0, 100.0, 10.0, 0.0, 10.0, 100.0, 100.0, 10.0, 0.0]
        );
        let options = Options::default();
        let found = fit("w.csv", &table(None), &options).unwrap();
        assert!((found.gain.n_per_code / 7e-6 - 1.0).abs() < 5e-4);
        let mut record = base::nominal(&RigFile::built_in().unwrap(), "2026-11-22");
        apply(&mut record, 4, &found.gain, &options).unwrap();
        assert_eq!(record.units[3].gain_date, "2026-11-22");
        assert!(record.common_gain_relative_sd >= 0.001);
        assert!(apply(&mut record, 9, &found.gain, &options).is_err());
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
        assert!(
            fails(&format!("{HEADER}\n10,1e3,30,,\n20,abc,30,,\n")).starts_with("w.csv:3: `abc`")
        );
        assert!(fails(&format!("{HEADER}\n10,NaN,30,,\n")).starts_with("w.csv:2: `NaN`"));
        assert!(fails(&format!("{HEADER}\n10,1000,30,,\n")).contains("at least 3 readings"));
        // A quadratic cell keeps its curve.
        let mut text = format!("{HEADER}\n");
        for load in plan(&gain::WEIGHTS_G, 2) {
            let force = load.weight_g * 9.80665e-3;
            let code = (force + 2e-3 * force * force) / 7e-6;
            text.push_str(&format!("{},{code},20,,\n", load.weight_g));
        }
        let curved = fit("w.csv", &text, &Options::default()).unwrap();
        let k = curvature(&curved.gain);
        let code = 5.0 / 7e-6;
        // F = c s - 2e-3 (c s)^2 with s = 7e-6.
        assert!((k * code * code + 2e-3 * 25.0).abs() < 5e-3, "{k:e}");
    }

    #[test]
    fn what_is_kept_can_be_fitted() {
        let folder = tempfile::tempdir().unwrap();
        let draft = Store::at(folder.path()).draft("gain-unit1");
        let loads = plan(&gain::WEIGHTS_G, 2);
        for (i, load) in loads.iter().enumerate() {
            let code = 500.0 + load.weight_g * 9.80665e-3 / 6.5e-6 + [9.0, -12.0, 4.0][i % 3];
            keep(&draft, load, (code, 15.0), 2.0 * i as f64).unwrap();
        }
        let text = draft.text().unwrap().unwrap();
        let found = fit("draft", &text, &Options::default()).unwrap();
        assert_eq!(found.readings, loads.len());
        assert!(found.shape.hysteresis.is_some());
        let mut codes: Vec<i32> = (0..320).map(|i| 1000 + (i * 37) % 21).collect();
        let (mean_code, se) = mean(&codes, 6.85e-6).unwrap();
        assert!((mean_code - 1010.0).abs() < 1.0 && se > 0.0);
        codes.truncate(10);
        assert!(mean(&codes, 6.85e-6).is_err());
    }
}
