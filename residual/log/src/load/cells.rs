//! Numbers in the cells of text logs.

use super::Input;

/// The marks within numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Marks {
    pub(super) decimal: char,
    /// Between thousands.
    pub(super) thousands: Option<char>,
}

impl Marks {
    pub(super) fn of(input: &Input) -> Marks {
        Marks {
            decimal: if input.decimal == "," { ',' } else { '.' },
            thousands: input.thousands.chars().next(),
        }
    }

    /// The marks that a number with both of them shows: `1.234,5`, `1,234.5`, `1\u{27}234.5`.
    pub(super) fn seen_in(cell: &str) -> Option<Marks> {
        let cell = cell.replace(SPACES, " ");
        let candidates = [('.', ','), (',', '.'), ('\'', '.'), (' ', ','), (' ', '.')];
        let all = candidates.map(|(mark, decimal)| Marks {
            decimal,
            thousands: Some(mark),
        });
        all.into_iter().find(|marks| {
            let has = |mark: char| cell.contains(mark);
            let both = has(marks.decimal) && marks.thousands.is_some_and(has);
            both && number(&cell, *marks).is_some()
        })
    }
}

/// Blanks that stand between thousands in set type: one that does not break, and a narrow one.
const SPACES: [char; 2] = ['\u{a0}', '\u{202f}'];

/// A number without the marks between its thousands; `None` where they do not stand so.
fn without_thousands(cell: &str, mark: char, decimal: char) -> Option<String> {
    let bare = cell.trim_start_matches(['-', '+', '\u{2212}']);
    let (whole, fraction) = match bare.split_once(decimal) {
        Some((whole, fraction)) => (whole, Some(fraction)),
        None => (bare, None),
    };
    let digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    let mut groups = whole.split(mark);
    let first = groups.next()?;
    let fits = first.len() <= 3
        && digits(first)
        && groups.all(|group| group.len() == 3 && digits(group))
        && fraction.is_none_or(digits);
    fits.then(|| cell.replace(mark, ""))
}

/// The number in a cell: NaN if it is missing, `None` if it is another text.
pub(super) fn number(cell: &str, marks: Marks) -> Option<f64> {
    if cell.is_empty() {
        return Some(f64::NAN);
    }
    if let Some(mark) = marks.thousands {
        let spaced;
        let cell = if mark == ' ' && cell.contains(SPACES) {
            spaced = cell.replace(SPACES, " ");
            &spaced
        } else {
            cell
        };
        if cell.contains(mark) {
            let bare = without_thousands(cell, mark, marks.decimal)?;
            return plain(&bare, marks.decimal);
        }
    }
    plain(cell, marks.decimal)
}

/// A number without marks between thousands.
fn plain(cell: &str, decimal: char) -> Option<f64> {
    let parsed = if decimal == '.' {
        cell.parse()
    } else {
        cell.replace(decimal, ".").parse()
    };
    if let Ok(x) = parsed {
        return Some(x);
    }
    match cell.to_ascii_lowercase().as_str() {
        "true" => return Some(1.0),
        "false" => return Some(0.0),
        // What R, spreadsheets and data loggers write for a value that is missing.
        "na" | "n/a" | "#n/a" | "#nv" | "null" | "none" | "nil" | "-" | "--" | "---" | "?" => {
            return Some(f64::NAN)
        }
        // Errors of a spreadsheet in any language: `#DIV/0!`, `#WERT!`, `#NAME?`.
        text if text.starts_with('#') && text.ends_with(['!', '?']) => return Some(f64::NAN),
        _ => {}
    }
    // The minus of set type, and the exponent of Fortran.
    if cell.contains('\u{2212}') {
        return plain(&cell.replace('\u{2212}', "-"), decimal);
    }
    let (mantissa, exponent) = cell.split_once(['D', 'd'])?;
    let is_number = mantissa.ends_with(|c: char| c.is_ascii_digit() || c == decimal);
    let exponent = exponent.parse::<i32>().ok().filter(|_| is_number)?;
    plain(&format!("{mantissa}e{exponent}"), decimal)
}

/// Longest text behind a number that is taken as its unit.
const LONG: usize = 12;

/// What stands around the number in each cell of a column: `cmd=` before it, `N` behind it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Affix {
    /// With its `=` or `:`.
    before: String,
    pub(super) behind: String,
}

impl Affix {
    /// That of a cell with one number and a label or a unit; `None` of every other text.
    pub(super) fn of(cell: &str, marks: Marks) -> Option<Affix> {
        let label = cell.rfind(['=', ':']).map_or("", |at| &cell[..=at]);
        let is_label = label.is_empty()
            || (label.starts_with(char::is_alphabetic)
                && label.matches(['=', ':']).count() == 1
                && label.chars().count() > 1);
        let rest = cell[label.len()..].trim_start();
        let of_number = |c: char| c.is_ascii_digit() || "+-.,eE\u{2212}".contains(c);
        let end = rest.find(|c| !of_number(c)).unwrap_or(rest.len());
        let (value, behind) = rest.split_at(end);
        let unit = behind.trim();
        let is_unit = unit.is_empty()
            || (unit.chars().count() <= LONG
                && unit.starts_with(|c: char| c.is_alphabetic() || "%°[(".contains(c))
                && (behind.starts_with(char::is_whitespace)
                    || unit == "%"
                    || super::guess::is_symbol(unit)));
        let is_one = is_label && is_unit && (label.len() + unit.len() > 0);
        (is_one && number(value, marks).is_some_and(f64::is_finite)).then(|| Affix {
            before: label.into(),
            behind: unit.into(),
        })
    }

    /// The name in the label, or an empty text.
    pub(super) fn label(&self) -> &str {
        self.before.trim_end_matches(['=', ':']).trim()
    }

    /// The number of a cell with the same label and the same unit, as one of another unit is
    /// another number.
    pub(super) fn number(&self, cell: &str, marks: Marks) -> Option<f64> {
        if cell.is_empty() {
            return Some(f64::NAN);
        }
        let rest = cell.strip_prefix(&self.before)?;
        number(rest.strip_suffix(&self.behind)?.trim(), marks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINT: Marks = Marks {
        decimal: '.',
        thousands: None,
    };

    fn marks(decimal: char, thousands: char) -> Marks {
        Marks {
            decimal,
            thousands: Some(thousands),
        }
    }

    #[test]
    fn numbers_of_many_hands() {
        for (cell, marks, value) in [
            ("1.5", POINT, Some(1.5)),
            ("\u{2212}1.5e-3", POINT, Some(-1.5e-3)),
            ("0.25D+02", POINT, Some(25.0)),
            ("-1.D-1", POINT, Some(-0.1)),
            ("1.234,5", marks(',', '.'), Some(1234.5)),
            ("-1.234", marks(',', '.'), Some(-1234.0)),
            ("0,5", marks(',', '.'), Some(0.5)),
            ("1,234,567.5", marks('.', ','), Some(1_234_567.5)),
            ("1'234", marks('.', '\''), Some(1234.0)),
            ("1\u{202f}234,5", marks(',', ' '), Some(1234.5)),
            // No groups of three: not what the mark stands for.
            ("0.5", marks(',', '.'), None),
            ("12.34", marks(',', '.'), None),
            ("CAD", POINT, None),
            ("3D", POINT, None),
            ("1.5 N", POINT, None),
        ] {
            assert_eq!(number(cell, marks), value, "{cell}");
        }
        for missing in ["", "NA", "#N/A", "---", "n/a", "NaN"] {
            assert!(number(missing, POINT).unwrap().is_nan(), "{missing}");
        }
    }

    #[test]
    fn marks_are_seen_in_a_number_with_both() {
        for (cell, seen) in [
            ("1.234,5", Some(marks(',', '.'))),
            ("-12,345.67", Some(marks('.', ','))),
            ("1'234.5", Some(marks('.', '\''))),
            ("1\u{a0}234,5", Some(marks(',', ' '))),
            ("1.234", None),
            ("1,234", None),
            ("12.34,5", None),
            ("04.03.2026", None),
            ("192.168.100.100", None),
        ] {
            assert_eq!(Marks::seen_in(cell), seen, "{cell}");
        }
    }

    #[test]
    fn a_label_and_a_unit_are_taken_off() {
        for (cell, label, unit, value) in [
            ("0.01 sec", "", "sec", 0.01),
            ("-3.5N", "", "N", -3.5),
            ("21.5 °C", "", "°C", 21.5),
            ("50%", "", "%", 50.0),
            ("t=0.5", "t", "", 0.5),
            ("speed: 0.4 rad/s", "speed", "rad/s", 0.4),
        ] {
            let affix = Affix::of(cell, POINT).expect(cell);
            assert_eq!((affix.label(), affix.behind.as_str()), (label, unit));
            assert_eq!(affix.number(cell, POINT), Some(value));
        }
        let newtons = Affix::of("3.0 N", POINT).unwrap();
        assert_eq!(newtons.number("3.0 kN", POINT), None);
        assert!(newtons.number("", POINT).unwrap().is_nan());
        for text in [
            "CH1",
            "run",
            "1st",
            "3x4",
            "06-May-2026",
            "10:11:12.003 -> cmd: 3.0",
            "a=1 b=2",
            "=3",
            "(1.0, 2.0)",
            "12:30",
        ] {
            assert_eq!(Affix::of(text, POINT), None, "{text}");
        }
    }
}
