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
    /// Whether day and month may be exchanged: `4/3/2026` was read with the day first, or with the
    /// month first where AM or PM is behind it, and is another day elsewhere.
    pub unsure: bool,
}

impl Stamp {
    /// The seconds with their fraction, good to 0.2 us.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.seconds as f64 + 1e-9 * f64::from(self.nanoseconds)
    }
}

/// Reads a date, with or without a time of day, or a time of day: `2026-03-04`, `2026/03/04`,
/// `20260304`, `04.03.2026`, `04/03/2026`, `04-Mar-2026`, `23:59:50.010`, `23:59:50:010`,
/// `11:59:50 PM`, minutes and seconds with a fraction (`59:50.01`), both with a blank or a T
/// between them, with a zone behind them (`Z`, `UTC`, `+01:00`, `-0330`, `+01`) or none. `None` of
/// any other text, and of eight digits alone.
#[must_use]
pub fn stamp(cell: &str) -> Option<Stamp> {
    stamp_in(cell, false)
}

/// As [`stamp`]; `half` tells whether a time with AM or PM stands in another cell of the row: then
/// the month comes first.
#[must_use]
pub fn stamp_in(cell: &str, half: bool) -> Option<Stamp> {
    let cell = cell.trim().trim_matches('"');
    // What is not this long, or does not begin with a digit, is no date: most text ends here.
    if !(7..=40).contains(&cell.len()) || !cell.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    if let Some(day) = date(cell, half) {
        return Some(Stamp {
            seconds: day.seconds,
            nanoseconds: 0,
            kind: Kind::Date,
            zoned: false,
            unsure: day.unsure,
        });
    }
    if let Some((stamp, _)) = time_of_day(cell) {
        return Some(stamp);
    }
    let (day, time) = cell.split_once(['T', ' '])?;
    // Behind a date two numbers are hours and minutes.
    let whole = time.matches(':').count() != 1;
    if let Some((stamp, own)) = time_of_day(time.trim()).filter(|_| whole) {
        return both(date(day, half || own)?, stamp);
    }
    // Without marks: 20260304T235950.010Z.
    let (whole, rest) = time.split_at_checked(6)?;
    let digits = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    if day.len() != 8 || !digits(day) || !digits(whole) {
        return None;
    }
    let day = format!("{}-{}-{}", &day[..4], &day[4..6], &day[6..]);
    let time = format!("{}:{}:{}{rest}", &whole[..2], &whole[2..4], &whole[4..]);
    both(date(&day, false)?, time_of_day(&time)?.0)
}

/// Whether a cell is a time of day with AM or PM behind it.
#[must_use]
pub fn has_half(cell: &str) -> bool {
    let cell = cell.trim().trim_matches('"');
    let is_time = cell.starts_with(|c: char| c.is_ascii_digit()) && (7..=40).contains(&cell.len());
    is_time && time_of_day(cell).is_some_and(|(_, half)| half)
}

/// A day and a time of day.
fn both(day: Day, time: Stamp) -> Option<Stamp> {
    Some(Stamp {
        seconds: day.seconds + time.seconds,
        kind: Kind::Both,
        unsure: day.unsure,
        ..time
    })
}

/// As [`stamp`], in seconds. Their fraction is good to 0.2 us.
#[must_use]
pub fn seconds(cell: &str) -> Option<(f64, Kind)> {
    stamp(cell).map(|stamp| (stamp.value(), stamp.kind))
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

/// A day, by its midnight.
struct Day {
    /// Seconds since 1970.
    seconds: i64,
    unsure: bool,
}

/// First letters of the months, in English, then as others write them: MATLAB writes those of the
/// system's language.
const MONTHS: [(&str, u32); 16] = [
    ("jan", 1),
    ("feb", 2),
    ("mar", 3),
    ("apr", 4),
    ("may", 5),
    ("jun", 6),
    ("jul", 7),
    ("aug", 8),
    ("sep", 9),
    ("oct", 10),
    ("nov", 11),
    ("dec", 12),
    ("mär", 3),
    ("mai", 5),
    ("okt", 10),
    ("dez", 12),
];

/// The month that stands as a word in the middle of a date, as a number there.
fn with_month_as_number(text: &str) -> Option<String> {
    let mut parts = text.split('-');
    let (day, month, year) = (parts.next()?, parts.next()?, parts.next()?);
    let month = month.to_lowercase();
    let number = MONTHS.iter().find(|(word, _)| month == *word)?.1;
    parts
        .next()
        .is_none()
        .then(|| format!("{day}.{number}.{year}"))
}

/// A date; `half` tells whether its time is one of AM or PM, as in America, where the month comes
/// first.
fn date(text: &str, half: bool) -> Option<Day> {
    let year_first = numbers(text, '-').or_else(|| numbers(text, '/'));
    let word = with_month_as_number(text);
    let mut unsure = false;
    let [year, month, day] = match year_first {
        Some(all) if all[0] >= 1900 => all,
        _ => {
            let text = word.as_deref().unwrap_or(text);
            if let Some([day, month, year]) = numbers(text, '.') {
                [year, month, day]
            } else {
                let [a, b, year] = numbers(text, '/')?;
                let month_first = b > 12 || (half && a <= 12);
                unsure = a <= 12 && b <= 12 && a != b;
                if month_first {
                    [year, a, b]
                } else {
                    [year, b, a]
                }
            }
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
    Some(Day {
        seconds: (i64::from(days) - 719_468) * DAY_S,
        unsure,
    })
}

/// The hours to add for AM or PM at the end of a time, and the time before them: `AM`, `p. m.`.
fn half_of_day(text: &str) -> Option<(u32, &str)> {
    let lower = text.to_ascii_lowercase();
    let bare = lower.trim_end_matches('.');
    let before = bare
        .strip_suffix('m')?
        .trim_end_matches([' ', '.', '\u{a0}']);
    let hours = match before.chars().last()? {
        'a' => 0,
        'p' => 12,
        _ => return None,
    };
    Some((hours, text[..before.len() - 1].trim_end()))
}

/// A time of day, and whether AM or PM tells its half.
fn time_of_day(text: &str) -> Option<(Stamp, bool)> {
    let half = half_of_day(text);
    let (add, text) = half.unwrap_or((0, text));
    let zone_at = text.find(['Z', 'z', 'U', '+', '-']).unwrap_or(text.len());
    let (time, zone) = text.split_at(zone_at);
    let time = time.trim();
    // A third colon stands before thousandths.
    let last = time
        .rsplit_once(':')
        .filter(|_| time.matches(':').count() == 3);
    let (whole, fraction) = last
        .or_else(|| time.split_once(['.', ',']))
        .unwrap_or((time, "0"));
    let [mut hours, minutes, seconds] =
        numbers(whole, ':').or_else(|| minutes_and_seconds(whole, time, half.is_some()))?;
    let digits = !fraction.is_empty() && fraction.bytes().all(|b| b.is_ascii_digit());
    if half.is_some() {
        hours = (1..=12).contains(&hours).then_some(hours % 12 + add)?;
    }
    if hours > 23 || minutes > 59 || seconds > 60 || !digits || last.is_some_and(|l| l.1.len() != 3)
    {
        return None;
    }
    let stamp = Stamp {
        seconds: i64::from(3600 * hours + 60 * minutes + seconds) - east_s(zone)?,
        nanoseconds: format!("{fraction:0<9}")[..9].parse().ok()?,
        kind: Kind::TimeOfDay,
        zoned: !zone.is_empty(),
        unsure: false,
    };
    Some((stamp, half.is_some()))
}

/// Hours, minutes and seconds of a time of minutes and seconds: `19:59.5`, as spreadsheets show
/// one. Without a fraction it may be hours and minutes.
fn minutes_and_seconds(whole: &str, time: &str, half: bool) -> Option<[u32; 3]> {
    let (minutes, seconds) = whole.split_once(':')?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let is_one = whole.len() < time.len() && !half && digits(minutes) && digits(seconds);
    let minutes: u32 = minutes
        .parse()
        .ok()
        .filter(|_| is_one && seconds.len() == 2)?;
    Some([minutes / 60, minutes % 60, seconds.parse().ok()?])
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
            ("13/03/2026", day + 9.0 * 86_400.0, Kind::Date),
            (
                "3/13/2026 10:00:00",
                day + 9.0 * 86_400.0 + 36_000.0,
                Kind::Both,
            ),
            ("04/03/2026 10:00:00,25", day + 36_000.25, Kind::Both),
            ("3/4/2026 12:00:01.5 AM", day + 1.5, Kind::Both),
            ("3/4/2026 12:00:00 PM", day + 43_200.0, Kind::Both),
            ("2026-03-04 1:00:00 p. m.", day + 46_800.0, Kind::Both),
            ("04-Mar-2026 10:00:00.25", day + 36_000.25, Kind::Both),
            ("04-Mär-2026", day, Kind::Date),
            ("20260304T100000.25Z", day + 36_000.25, Kind::Both),
            ("23:59:50:010", 86_390.01, Kind::TimeOfDay),
            ("11:59:50 PM", 86_390.0, Kind::TimeOfDay),
            ("00:19.99", 19.99, Kind::TimeOfDay),
            ("75:10.5", 4510.5, Kind::TimeOfDay),
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
            "0012:30",
            "0016:9.5",
            "00:19.99 PM",
            "2026-03-04 10:11.5",
            "192.168.1.1",
            "1.2.3",
            "2026-13-04",
            "4/31/20",
            "13/13/2026",
            "04-Foo-2026",
            "20260304",
            "20261304T100000",
            "10:00:00:1",
            "13:00:00 PM",
            "0:00:00 AM",
            "10:00:00 XM",
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

    #[test]
    fn the_month_comes_first_beside_am_and_pm() {
        let day = |cell, half| stamp_in(cell, half).map(|s| s.seconds / DAY_S);
        assert_eq!(day("3/11/2025", true), day("2025-03-11", false));
        assert_eq!(day("3/11/2025", false), day("2025-11-03", false));
        assert_eq!(day("13/3/2025", true), day("2025-03-13", false));
        assert_eq!(day("3.11.2025", true), day("2025-11-03", false));
        for (cell, expected) in [
            ("11:59:50.25 PM", true),
            ("1:00:00 a. m.", true),
            ("11:59:50.25", false),
            ("3/11/2025 1:00:00 AM", false),
            ("PM", false),
        ] {
            assert_eq!(has_half(cell), expected, "{cell}");
        }
    }

    #[test]
    fn a_day_that_may_be_a_month_is_unsure() {
        for (text, unsure) in [
            ("4/3/2026 10:00:00Z", true),
            ("4/3/2026 10:00:00 AM", true),
            ("4/4/2026 10:00:00Z", false),
            ("13/3/2026 10:00:00Z", false),
            ("4.3.2026 10:00:00Z", false),
            ("2026-03-04T10:00:00Z", false),
        ] {
            assert_eq!(stamp(text).map(|s| s.unsure), Some(unsure), "{text}");
        }
    }
}
