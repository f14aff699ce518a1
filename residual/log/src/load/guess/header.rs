//! Headers of two lines: names, then units or what was connected.

use super::names::{self, Name};
use std::collections::BTreeSet;

/// Symbols of units. A prefix may stand before each; capitals count, so that `v` and `a` stay
/// names.
const SYMBOLS: &[&str] = &[
    "s", "sec", "second", "seconds", "Second", "Volt", "Volts", "volt", "volts", "min", "h", "Hz",
    "m", "in", "ft", "g", "N", "Nm", "lb", "lbf", "lbs", "oz", "ozf", "kgf", "gf", "V", "A", "W",
    "J", "K", "C", "F", "Pa", "bar", "psi", "rad", "deg", "rev", "r", "rpm", "RPM", "U", "dps",
    "Ohm", "Ω", "pulse", "pulses", "counts", "inc", "digit", "dB",
];

/// Prefixes of units.
const PREFIXES: &[char] = &['k', 'm', 'M', 'c', 'd', 'n', 'µ', 'μ', 'u'];

/// Words that stand in the first cell of a line of units.
const LABELS: &[&str] = &["unit", "units", "einheit", "einheiten"];

/// Longest text in brackets that is taken as a unit.
const LONG: usize = 12;

/// A cell without quotation marks and brackets.
pub(super) fn bare(cell: &str) -> &str {
    cell.trim_matches(|c: char| c == '"' || c.is_whitespace())
        .trim_matches(['[', ']', '(', ')', '{', '}', '<', '>'])
        .trim()
}

/// Whether a text without brackets is made of symbols of units: `kN`, `m/s²`, `1/min`.
pub(in crate::load) fn is_symbol(text: &str) -> bool {
    let known = |part: &str| {
        let rest = part.strip_prefix(PREFIXES);
        [Some(part), rest]
            .into_iter()
            .flatten()
            .any(|p| SYMBOLS.contains(&p))
    };
    let mut parts = text
        .split(|c: char| !c.is_alphabetic())
        .filter(|p| !p.is_empty())
        .peekable();
    parts.peek().is_some() && parts.all(known)
}

/// Whether a text shows how times are written: `hh:mm:ss`, `HH:MM:SS.fff`, `yyyy-mm-dd`.
fn is_time_format(text: &str) -> bool {
    let letters = |c: char| "hmsfyd".contains(c.to_ascii_lowercase());
    let between = |c: char| matches!(c, ':' | '.' | ',' | '-' | '/' | ' ');
    text.chars().all(|c| letters(c) || between(c)) && text.matches([':', '-', '/']).count() == 2
}

/// Whether a cell may stand in a line of units: a symbol, a text in brackets, nothing, a form of
/// times, or a sign such as `-` and `%`.
fn is_unit(cell: &str) -> bool {
    let text = bare(cell);
    let in_brackets =
        cell.trim_matches('"').starts_with(['[', '(', '{', '<']) && text.chars().count() <= LONG;
    let is_sign = text == "1" || !text.contains(char::is_alphanumeric);
    let is_label = LABELS.contains(&text.to_lowercase().as_str());
    in_brackets || is_sign || is_label || is_symbol(text) || is_time_format(text)
}

/// Whether a line is the second of a header, below a line of `names`: a unit of time stands below
/// the name of a time, or every cell may be a unit. Where all are single letters they may be names
/// below a line of prose, unless a letter is repeated or a name above says what it is.
pub(super) fn is_second(names: &[&str], second: &[&str]) -> bool {
    let role = |name: &str| Name::of(name).role();
    let units = second.iter().map(|cell| bare(cell));
    let below_time = |(name, unit): (&&str, &str)| {
        role(name) == Some("time") && names::known(unit).is_some_and(|(unit, _)| unit == "s")
    };
    if names.iter().zip(units.clone()).any(below_time) {
        return true;
    }
    let filled: Vec<&str> = units.filter(|u| !u.is_empty()).collect();
    let different: BTreeSet<&&str> = filled.iter().collect();
    let sure = different.len() < filled.len()
        || second
            .iter()
            .any(|c| c.trim_matches('"').chars().count() != 1)
        || names.iter().any(|n| role(n).is_some());
    sure && second.iter().all(|c| is_unit(c)) && !names.iter().all(|n| is_unit(n))
}

/// Whether a line has nothing but units, two of them alike or below names that are numbers, as
/// channels are: then the line above it names the columns whatever stands there.
pub(super) fn are_units(names: &[&str], second: &[&str]) -> bool {
    let filled: Vec<&str> = second
        .iter()
        .map(|c| bare(c))
        .filter(|u| !u.is_empty())
        .collect();
    let symbols = filled.iter().all(|u| is_symbol(u) && u.chars().count() > 1);
    names.len() == second.len() && filled.len() == second.len() && symbols
}

/// Names that can be used: without quotation marks, none empty, none twice, and none with bytes of
/// another code than the ones that are read, which come out as control characters.
pub(super) fn usable(names: &[&str]) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let name = match name.trim_matches('"').trim() {
            name if name.is_empty() || name.contains(char::is_control) => {
                format!("column_{}", i + 1)
            }
            name => name.to_string(),
        };
        let is_free = |n: &String| !all.contains(n);
        let numbered = (2..).map(|k| format!("{name}_{k}"));
        let free = std::iter::once(name.clone()).chain(numbered).find(is_free);
        all.extend(free);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_a_line_of_units() {
        for cell in [
            "s",
            "[N]",
            "(deg/s)",
            "V",
            "Nm",
            "°C",
            "-",
            "",
            "\"mm\"",
            "m/s²",
            "1/min",
            "%",
            "kN",
            "N·m",
            "[a.u.]",
            "Unit",
            "µs",
            "rad/s^2",
            "hh:mm:ss",
            "yyyy-mm-dd",
            "HH:MM:SS.fff",
        ] {
            assert!(is_unit(cell), "{cell}");
        }
        for cell in [
            "t", "x", "v", "a", "Force", "q1", "Time [s]", "run 3", "0.25",
        ] {
            assert!(!is_unit(cell), "{cell}");
        }
    }

    #[test]
    fn a_second_line_is_told_from_names() {
        for (names, second, expected) in [
            (["Time", "Force"], ["s", "N"], true),
            (["Elapsed", "Torque"], ["hh:mm:ss", "N·m"], true),
            (["Time", "Analog 1"], ["ms", "Motor speed"], true),
            (["Kanal 1", "Kanal 2"], ["V", "V"], true),
            (["Kanal 1", "Kanal 2"], ["mm", "V"], true),
            (["Kanal 1", "Kanal 2"], ["[s]", ""], true),
            (["Rig 4", "cold"], ["t", "v"], false),
            (["Rig 4", "cold"], ["s", "F"], false),
            (["Rig 4", "cold"], ["Time", "Force"], false),
            (["", ""], ["s", "N"], false),
        ] {
            assert_eq!(is_second(&names, &second), expected, "{names:?} {second:?}");
        }
    }

    #[test]
    fn names_become_usable() {
        let names = usable(&["t", "\"Force\"", "", "Force", "Force_2", "Force", " "]);
        let expected = [
            "t",
            "Force",
            "column_3",
            "Force_2",
            "Force_2_2",
            "Force_3",
            "column_7",
        ];
        assert_eq!(names, expected);
    }
}
