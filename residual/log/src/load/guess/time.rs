//! Which column is the time, and in which unit.

use super::columns::Column;
use super::names::COUNTERS;
use crate::load::stamps;

use residual_columns::format::num;
use residual_columns::stats;

/// Units of time: name, in seconds, and where the clock of a computer stands in it, in seconds
/// since 1970.
const CLOCKS: &[(&str, f64)] = &[("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)];

/// Seconds since 1970 of logs: from 2001 to 2065.
pub(super) const EPOCH: std::ops::Range<f64> = 1e9..3e9;

/// Days since the end of 1899, as spreadsheets count them, of logs: from 2000 to 2065.
const SERIAL_DAYS: std::ops::Range<f64> = 36_526.0..60_268.0;

/// Median step up to which such numbers are days: 1 s. In seconds it would be a row each 12 us.
const LARGEST_STEP_DAYS: f64 = 1.01 / 86_400.0;

/// Largest and smallest share of the likely slope at which angle and velocity agree.
const AGREE: std::ops::Range<f64> = 0.8..1.25;

/// Rows from which steps of half a second or more are not believed.
const MANY: usize = 200;

/// The column of the time.
pub(super) struct Time {
    pub(super) column: usize,
    /// Seconds per unit of the column.
    pub(super) scale: f64,
    /// What is to be asked about column and unit.
    pub(super) questions: Vec<String>,
    /// Median step, in s.
    pub(super) step: f64,
    /// Sum of all steps, in s.
    pub(super) span: f64,
    /// Rows with the time of the row before.
    pub(super) repeats: usize,
    /// Whether every step is 1: it may be the number of the row.
    pub(super) counts: bool,
}

/// How a column grows.
struct Growth {
    /// Steps upwards, sorted.
    up: Vec<f64>,
    /// Rows that repeat the value before.
    repeats: usize,
    /// Rows that are below the value before, and the first of them.
    falls: usize,
    first_fall: usize,
}

impl Growth {
    /// Of the values from the other end where the newest row is the first.
    fn of_any_order(values: &[f64]) -> (Growth, bool) {
        let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        let backwards = stamps::is_backwards(&finite);
        let reversed = || finite.iter().rev().copied().collect::<Vec<f64>>();
        let ordered = if backwards { reversed() } else { finite };
        (Growth::of(&ordered), backwards)
    }

    fn of(values: &[f64]) -> Growth {
        let mut growth = Growth {
            up: vec![],
            repeats: 0,
            falls: 0,
            first_fall: 0,
        };
        let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        for (i, pair) in finite.windows(2).enumerate() {
            match pair[1] - pair[0] {
                d if d > 0.0 => growth.up.push(d),
                0.0 => growth.repeats += 1,
                _ => {
                    growth.falls += 1;
                    if growth.falls == 1 {
                        growth.first_fall = i + 1;
                    }
                }
            }
        }
        growth.up.sort_by(f64::total_cmp);
        growth
    }

    fn is_strict(&self) -> bool {
        !self.up.is_empty() && self.repeats + self.falls == 0
    }

    /// Whether a column with the name of a time may be one: repeated stamps and a second run are no
    /// hindrance.
    fn mostly(&self) -> bool {
        self.up.len() > self.repeats && 100 * self.falls < self.up.len()
    }

    /// Whether nearly all steps are of one size.
    fn is_steady(&self) -> bool {
        let at = |q| stats::quantile_sorted(&self.up, q);
        self.is_strict() && at(0.9) <= 3.0 * at(0.1)
    }

    fn counts(&self) -> bool {
        self.up.iter().all(|d| *d == 1.0)
    }
}

/// Finds the time: a column with such a name that grows, else one that grows in steps of about one
/// size. `slope` gives, for a column taken as time, the slope of the angle as a multiple of the
/// velocity.
pub(super) fn find(columns: &[Column], slope: impl Fn(usize) -> Option<f64>) -> Option<Time> {
    let (grown, backwards): (Vec<Growth>, Vec<bool>) = columns
        .iter()
        .map(|c| match c.role {
            Some("time") => Growth::of_any_order(c.values),
            _ => (Growth::of(c.values), false),
        })
        .unzip();
    let all = 0..columns.len();
    let counter = |i: &usize| {
        let words = &columns[*i].name.words;
        words.iter().any(|w| COUNTERS.contains(&w.as_str()))
    };
    let named = all
        .clone()
        .filter(|i| columns[*i].role == Some("time") && grown[*i].mostly())
        .min_by_key(|i| (counter(i), !grown[*i].is_strict(), *i));
    // A unit of time says more than a name that is not understood.
    let may_be = |i: &usize| columns[*i].role.is_none() || columns[*i].name.unit == "s";
    let column = named.or_else(|| {
        all.filter(|i| may_be(i) && !counter(i) && grown[*i].is_steady())
            .min_by_key(|i| (columns[*i].name.unit != "s", grown[*i].counts(), *i))
    })?;
    let growth = &grown[column];
    let step = stats::quantile_sorted(&growth.up, 0.5);
    let mut questions = Vec::new();
    if named.is_none() {
        questions.push(format!(
            "it grows as a time does, in steps of {}",
            num(step)
        ));
    }
    let (scale, question) = unit(&columns[column], step, slope(column));
    questions.extend(question);
    if backwards[column] {
        questions
            .push("the newest row is the first: rows are read from the end of the file".into());
    }
    if growth.falls > 0 {
        questions.push(format!(
            "it falls after row {} of the data: does a second run begin there? Then name the column that numbers the runs in input.sequence",
            growth.first_fall
        ));
    }
    Some(Time {
        column,
        scale,
        questions,
        step: step * scale,
        span: growth.up.iter().sum::<f64>() * scale,
        repeats: growth.repeats,
        counts: growth.counts(),
    })
}

/// Seconds per unit of a column: by its name, by the date that it shows, by angle and velocity,
/// else by the size of its steps.
fn unit(column: &Column, step: f64, slope: Option<f64>) -> (f64, Option<String>) {
    if column.name.unit == "s" {
        return (column.name.scale, None);
    }
    // A unit that is not one of those of names, such as minutes.
    if let Some(scale) = residual_columns::units::seconds(&column.stated) {
        return (scale, None);
    }
    let first = column.values.iter().copied().find(|v| v.is_finite());
    let dated = CLOCKS
        .iter()
        .find(|(_, s)| EPOCH.contains(&(first.unwrap_or(0.0) * s)) && step * s < 60.0);
    if let Some((name, scale)) = dated {
        return (*scale, (*scale < 1.0).then(|| format!("a date in {name}")));
    }
    // A unit of time in the name would have been seen above.
    if SERIAL_DAYS.contains(&first.unwrap_or(0.0)) && step < LARGEST_STEP_DAYS {
        return (
            86_400.0,
            Some("a date in days, as spreadsheets count them".into()),
        );
    }
    let fits = |slope: f64| CLOCKS.iter().find(|(_, s)| AGREE.contains(&(slope / s)));
    if let Some((name, scale)) = slope.and_then(fits) {
        return (
            *scale,
            (*scale < 1.0)
                .then(|| format!("in {name}: then the slope of the angle is the velocity")),
        );
    }
    let (name, scale) = match step {
        ..0.5 => return (1.0, None),
        ..500.0 => CLOCKS[1],
        ..2e5 => CLOCKS[2],
        _ => CLOCKS[3],
    };
    if column.values.len() < MANY {
        let question = format!(
            "the median step is {} s: if it is in {name}, write scale = {scale:e}",
            num(step)
        );
        return (1.0, Some(question));
    }
    let question = format!(
        "the median step is {}: taken as {name}; if it is in s, remove the scale; if it counts rows, set input.rate",
        num(step)
    );
    (scale, Some(question))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::guess::columns::columns;
    use crate::load::Table;

    fn guessed(name: &str, values: impl Fn(f64) -> f64) -> Option<Time> {
        let values: Vec<f64> = (0..400).map(|i| values(f64::from(i))).collect();
        let other: Vec<f64> = (0..400).map(|i| f64::from(i * i % 7)).collect();
        let table = Table::new("a").with("y", other).with(name, values);
        find(&columns(&table, name.starts_with("column_")), |_| None)
    }

    #[test]
    fn units_of_time_by_steps_and_dates() {
        for (name, step, first, scale, asked) in [
            ("t", 0.01, 0.0, 1.0, false),
            ("Time", 1.0, 0.0, 1e-3, true),
            ("Time", 10.0, 0.0, 1e-3, true),
            ("t", 1000.0, 0.0, 1e-6, true),
            ("t", 1e6, 0.0, 1e-9, true),
            ("t_us", 1000.0, 0.0, 1e-6, false),
            ("t", 0.01, 1.7e9, 1.0, false),
            ("stamp", 10.0, 1.7e12, 1e-3, true),
            ("stamp", 1e7, 1.7e18, 1e-9, true),
            ("column_2", 10.0, 0.0, 1e-3, true),
            ("column_2", 0.01, 1.7e9, 1.0, true),
            ("Date", 0.01 / 86_400.0, 46_148.5, 86_400.0, true),
            ("Date", 1.0 / 86_400.0, 46_148.5, 86_400.0, true),
            // The clock of a computer that has run for half a day.
            ("t", 0.001, 46_148.5, 1.0, false),
            ("Time/min", 0.01 / 60.0, 0.0, 60.0, false),
        ] {
            let time = guessed(name, |i| first + step * i).unwrap();
            assert_eq!(time.scale, scale, "{name} {step} {first}");
            assert_eq!(!time.questions.is_empty(), asked, "{:?}", time.questions);
        }
    }

    #[test]
    fn a_counter_or_an_unsteady_column_is_no_time() {
        assert!(guessed("seq", |i| i).is_none());
        assert!(guessed("x", |i| i * i).is_none());
        assert!(guessed("time", |i| i % 5.0).is_none());
    }

    #[test]
    fn repeated_stamps_and_a_second_run_are_no_hindrance() {
        let time = guessed("time_ms", |i| (0.7 * i).floor()).unwrap();
        assert!(time.repeats > 100);
        let time = guessed("time", |i| 0.01 * (i % 200.0)).unwrap();
        assert!(
            time.questions[0].contains("after row 200"),
            "{:?}",
            time.questions
        );
    }

    #[test]
    fn angle_and_velocity_show_the_unit() {
        let values: Vec<f64> = (0..400).map(|i| 0.4 * f64::from(i)).collect();
        let table = Table::new("a").with("t", values);
        let columns = columns(&table, false);
        assert_eq!(find(&columns, |_| Some(1.02e-3)).unwrap().scale, 1e-3);
        assert_eq!(find(&columns, |_| Some(1.02)).unwrap().scale, 1.0);
    }
}
