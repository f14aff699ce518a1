//! Dates and times of day in text.

/// What a text of a date or a time is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A date.
    Date,
    /// A time of day.
    TimeOfDay,
    /// A date with a time of day.
    Both,
}

impl Kind {
    /// In words, for a report.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Kind::Date => "a date",
            Kind::TimeOfDay => "a time of day",
            Kind::Both => "a date with a time of day",
        }
    }
}

const DAY_S: i64 = 86_400;

/// A date, a time of day, or both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// Whole seconds since 1970 of a date, since midnight of a time of day alone; UTC where the
    /// text has a zone, else of the zone that is not told.
    pub seconds: i64,
    /// Nanoseconds behind them.
    pub nanoseconds: u32,
    /// What the text is.
    pub kind: Kind,
    /// Whether the text tells its zone.
    pub zoned: bool,
}

/// Reads a date, with or without a time of day, or a time of day: `2026-03-04`, `2026/03/04`,
/// `04.03.2026`, `23:59:50.010`, both with a blank or a T between them, with a zone behind them
/// (`Z`, `UTC`, `+01:00`, `-0330`, `+01`) or none. `None` of any other text.
#[must_use]
pub fn stamp(cell: &str) -> Option<Stamp> {
    let cell = cell.trim().trim_matches('"');
    // What is not this long, or does not begin with a digit, is no date: most text ends here.
    if !(8..=40).contains(&cell.len()) || !cell.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    if let Some(seconds) = date(cell) {
        return Some(Stamp {
            seconds,
            nanoseconds: 0,
            kind: Kind::Date,
            zoned: false,
        });
    }
    if let Some(stamp) = time_of_day(cell) {
        return Some(stamp);
    }
    let (day, time) = cell.split_once(['T', ' '])?;
    let time = time_of_day(time.trim())?;
    Some(Stamp {
        seconds: date(day)? + time.seconds,
        kind: Kind::Both,
        ..time
    })
}

/// As [`stamp`], in seconds. Their fraction is good to 0.2 us.
#[must_use]
pub fn seconds(cell: &str) -> Option<(f64, Kind)> {
    let stamp = stamp(cell)?;
    let seconds = stamp.seconds as f64 + 1e-9 * f64::from(stamp.nanoseconds);
    Some((seconds, stamp.kind))
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

fn date(text: &str) -> Option<i64> {
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
    Some((i64::from(days) - 719_468) * DAY_S)
}

fn time_of_day(text: &str) -> Option<Stamp> {
    let zone_at = text.find(['Z', 'z', 'U', '+', '-']).unwrap_or(text.len());
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
    Some(Stamp {
        seconds: i64::from(3600 * hours + 60 * minutes + seconds) - east_s(zone)?,
        nanoseconds: format!("{fraction:0<9}")[..9].parse().ok()?,
        kind: Kind::TimeOfDay,
        zoned: !zone.is_empty(),
    })
}

/// Seconds by which a zone is before UTC; 0 without one.
fn east_s(zone: &str) -> Option<i64> {
    let (sign, text) = match zone {
        "" | "Z" | "z" | "UTC" => return Some(0),
        _ => match zone.split_at_checked(1)? {
            ("+", text) => (1, text),
            ("-", text) => (-1, text),
            _ => return None,
        },
    };
    let digits: String = text.chars().filter(|c| *c != ':').collect();
    if !digits.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let (hours, minutes) = match digits.len() {
        2 => (digits.as_str(), "0"),
        4 => digits.split_at(2),
        _ => return None,
    };
    let (hours, minutes): (i64, i64) = (hours.parse().ok()?, minutes.parse().ok()?);
    (hours < 24 && minutes < 60).then_some(sign * (3600 * hours + 60 * minutes))
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
            ("04.03.2026 10:00:00 -0330", day + 48_600.0, Kind::Both),
            ("2026-03-04 10:00:00.5 UTC", day + 36_000.5, Kind::Both),
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
            "10:11:12+25:00",
            "10:11:12 CET",
            "10:11:12+é1",
        ] {
            assert_eq!(seconds(text), None, "{text}");
        }
    }

    #[test]
    fn a_stamp_is_exact_and_tells_whether_it_has_a_zone() {
        let of = |text| stamp(text).map(|s| (s.seconds, s.nanoseconds, s.zoned));
        let second = 1_795_640_363;
        assert_eq!(
            of("2026-11-25T21:59:23.877021589+01:00"),
            Some((second, 877_021_589, true))
        );
        assert_eq!(
            of("2026-11-25 20:59:23.8770215894"),
            Some((second, 877_021_589, false))
        );
        assert_eq!(of("2026-11-25"), Some((1_795_564_800, 0, false)));
    }
}
