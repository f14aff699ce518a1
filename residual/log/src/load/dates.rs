//! Dates and times of day in text, in seconds.

/// What a text of a date or a time is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Date,
    TimeOfDay,
    Both,
}

impl Kind {
    /// In words, for a report.
    pub(super) fn words(self) -> &'static str {
        match self {
            Kind::Date => "a date",
            Kind::TimeOfDay => "a time of day",
            Kind::Both => "a date with a time of day",
        }
    }
}

const DAY_S: f64 = 86_400.0;

/// Seconds since 1970 of a date, with or without a time of day, or since midnight of a time of day:
/// `2026-03-04`, `2026/03/04`, `04.03.2026`, `23:59:50.010`, both with a blank or a T between them,
/// with a zone behind them or none. `None` of any other text.
pub(super) fn seconds(cell: &str) -> Option<(f64, Kind)> {
    let cell = cell.trim().trim_matches('"');
    // What is not this long, or does not begin with a digit, is no date: most text ends here.
    if !(8..=40).contains(&cell.len()) || !cell.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    if let Some(date) = date(cell) {
        return Some((date, Kind::Date));
    }
    if let Some(time) = time_of_day(cell) {
        return Some((time, Kind::TimeOfDay));
    }
    let (day, time) = cell.split_once(['T', ' '])?;
    Some((date(day)? + time_of_day(time.trim())?, Kind::Both))
}

/// The parts of a text, all numbers.
fn numbers(text: &str, mark: char) -> Option<[u32; 3]> {
    let mut parts = text.split(mark).map(|part| {
        let digits = !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
        digits.then(|| part.parse().ok()).flatten()
    });
    let all = [parts.next()??, parts.next()??, parts.next()??];
    parts.next().is_none().then_some(all)
}

fn date(text: &str) -> Option<f64> {
    let year_first = numbers(text, '-').or_else(|| numbers(text, '/'));
    let [year, month, day] = match year_first {
        Some(all) if all[0] >= 1900 => all,
        // Days come first only where points separate: 4/3/2026 is another day in America.
        _ => {
            let [day, month, year] = numbers(text, '.')?;
            [year, month, day]
        }
    };
    if !(1900..2200).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // Days since 1970 (a year begins in March: a leap day is its last).
    let (y, m) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let days = 365 * y + y / 4 - y / 100 + y / 400 + (153 * m + 2) / 5 + day - 1;
    Some((f64::from(days) - 719_468.0) * DAY_S)
}

fn time_of_day(text: &str) -> Option<f64> {
    let zone_at = text.find(['Z', 'z', '+', '-']).unwrap_or(text.len());
    let (time, zone) = text.split_at(zone_at);
    let (whole, fraction) = time
        .trim()
        .split_once(['.', ','])
        .unwrap_or((time.trim(), "0"));
    let [hours, minutes, seconds] = numbers(whole, ':')?;
    let digits = !fraction.is_empty() && fraction.bytes().all(|b| b.is_ascii_digit());
    if hours > 23 || minutes > 59 || seconds > 60 || !digits {
        return None;
    }
    let fraction: f64 = format!("0.{fraction}").parse().ok()?;
    let passed = f64::from(3600 * hours + 60 * minutes + seconds) + fraction;
    Some(passed - east_s(zone)?)
}

/// Seconds by which a zone is before UTC; 0 without one.
fn east_s(zone: &str) -> Option<f64> {
    let (sign, text) = match zone.split_at_checked(1) {
        None | Some(("Z" | "z", "")) => return Some(0.0),
        Some(("+", text)) => (1.0, text),
        Some(("-", text)) => (-1.0, text),
        Some(_) => return None,
    };
    let digits: String = text.chars().filter(|c| *c != ':').collect();
    let number: f64 = digits.parse().ok()?;
    let (hours, minutes) = match digits.len() {
        2 => (number, 0.0),
        4 => ((number / 100.0).floor(), number % 100.0),
        _ => return None,
    };
    Some(sign * (3600.0 * hours + 60.0 * minutes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_and_times_are_read() {
        let day = 1_772_582_400.0;
        for (text, value, kind) in [
            ("1970-01-01", 0.0, Kind::Date),
            ("2026-03-04", day, Kind::Date),
            ("2026/03/04", day, Kind::Date),
            ("04.03.2026", day, Kind::Date),
            ("2000-02-29", 951_782_400.0, Kind::Date),
            ("23:59:50.010", 86_390.01, Kind::TimeOfDay),
            ("00:00:01,5", 1.5, Kind::TimeOfDay),
            ("2026-03-04T10:00:00Z", day + 36_000.0, Kind::Both),
            ("2026-03-04 10:00:00.25", day + 36_000.25, Kind::Both),
            ("2026-03-04T10:00:00+01:00", day + 32_400.0, Kind::Both),
        ] {
            let (read, of) = seconds(text).unwrap();
            assert!(
                (read - value).abs() < 1e-6 && of == kind,
                "{text}: {read} {of:?}"
            );
        }
        for text in [
            "",
            "1.5",
            "12:30",
            "192.168.1.1",
            "1.2.3",
            "2026-13-04",
            "4/3/2026",
            "25:00:00",
            "(1.0, 2.0)",
            "21/10/2024-15:52:16",
            "run 2026-03-04",
            "10:11:12.x",
        ] {
            assert_eq!(seconds(text), None, "{text}");
        }
    }
}
