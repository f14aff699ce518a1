//! A first model file for logs that nobody has described yet: separator, header, roles and units as they seem to be, with the
//! questions that only a person can answer.

use super::{files, text, Table};
use crate::error::Error;
use crate::spec::Input;
use std::fmt::Write as _;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes at the head of a log that are looked at for its layout.
const LOOK: u64 = 1 << 16;

/// Parts of names by role, the likeliest first. Units at the end of a name do not count.
const WORDS: &[(&str, &[&str])] = &[
    ("time", &["time", "stamp", "sec", "t"]),
    ("setpoint", &["setpoint", "desired", "goal", "ref"]),
    (
        "command",
        &["command", "cmd", "commanded", "pwm", "voltage", "uq"],
    ),
    (
        "velocity",
        &["velocity", "speed", "vel", "omega", "dq", "qd"],
    ),
    (
        "angle",
        &["angle", "position", "pos", "encoder", "theta", "q"],
    ),
    ("temperature", &["temperature", "temp"]),
    (
        "target",
        &[
            "force", "tension", "torque", "load", "effort", "current", "iq", "measured", "tau", "y",
        ],
    ),
];

/// Endings of names and the units that they mean, with the factor to the unit of the model file.
const UNITS: &[(&str, &str, f64)] = &[
    ("rad_s", "rad/s", 1.0),
    ("deg_s", "deg/s", 1.0),
    ("m_s", "m/s", 1.0),
    ("mm_s", "mm/s", 1.0),
    ("ms", "s", 1e-3),
    ("us", "s", 1e-6),
    ("s", "s", 1.0),
    ("rad", "rad", 1.0),
    ("deg", "deg", 1.0),
    ("nm", "N·m", 1.0),
    ("n", "N", 1.0),
    ("mm", "mm", 1.0),
    ("m", "m", 1.0),
    ("a", "A", 1.0),
    ("v", "V", 1.0),
    ("c", "K", 1.0),
];

/// Writes a model file for logs: what the first of them looks like, with open questions as comments.
///
/// # Errors
/// [`Error::Io`] if there is no text log, or if no layout fits its first lines.
pub fn guess(paths: &[PathBuf]) -> Result<String, Error> {
    let files = files::find_files(paths)?;
    let path = files
        .iter()
        .find(|p| {
            !matches!(
                p.extension().and_then(|e| e.to_str()),
                Some("parquet" | "pq")
            )
        })
        .ok_or_else(|| {
            Error::io(
                &files[0],
                "only text logs are looked at; write the model file by hand",
            )
        })?;
    let layout = Layout::of(path)?;
    let table = text::read(path, &layout.input)?;
    Ok(model(path, files.len(), &layout, &table))
}

/// How a text log is laid out.
struct Layout {
    input: Input,
    /// Names that a comment line has for the columns.
    from_comment: bool,
}

impl Layout {
    fn of(path: &Path) -> Result<Layout, Error> {
        let mut head = String::new();
        let mut bytes = Vec::new();
        text::open(path)?
            .take(LOOK)
            .read_to_end(&mut bytes)
            .map_err(|e| Error::io(path, e))?;
        head.push_str(&String::from_utf8_lossy(&bytes));
        let mut lines: Vec<&str> = head.lines().collect();
        // The last line may be cut off.
        if bytes.len() as u64 == LOOK {
            lines.pop();
        }
        let is_comment = |l: &&str| l.starts_with(['%', '#']);
        let comments: Vec<&str> = lines.iter().copied().filter(is_comment).collect();
        let rows: Vec<&str> = lines
            .iter()
            .copied()
            .filter(|l| !is_comment(l) && !l.trim().is_empty())
            .collect();
        let (separator, cells) = [";", "\t", ",", "blank"]
            .into_iter()
            .filter_map(|s| Some((s, usual(&rows, s)?)))
            .find(|(_, cells)| *cells > 1)
            .ok_or_else(|| {
                Error::io(path, "no separator gives its first lines equal numbers of cells; write the model file by hand")
            })?;
        let first = rows
            .iter()
            .position(|l| split(l, separator).len() == cells)
            .unwrap_or(0);
        let decimal = if separator != "," && rows[rows.len() / 2].contains(',') {
            ","
        } else {
            "."
        };
        let plain = |cell: &str| cell.replace(decimal, ".").parse::<f64>().is_ok();
        let named = split(rows[first], separator).iter().any(|c| !plain(c));
        let mut input = Input {
            separator: separator.into(),
            decimal: decimal.into(),
            comment: comments
                .first()
                .map_or(String::new(), |c| c[..1].to_string()),
            skip: if comments.is_empty() { first } else { 0 },
            ..Input::default()
        };
        let mut from_comment = false;
        if !named {
            let last = comments
                .last()
                .map(|c| split(c.trim_start_matches(['%', '#']), separator));
            from_comment = last.as_ref().is_some_and(|names| names.len() == cells);
            input.header = match last.filter(|names| names.len() == cells) {
                Some(names) => names.iter().map(|n| n.trim().to_string()).collect(),
                None => (1..=cells).map(|k| format!("column_{k}")).collect(),
            };
        }
        Ok(Layout {
            input,
            from_comment,
        })
    }
}

fn split<'a>(line: &'a str, separator: &str) -> Vec<&'a str> {
    match separator {
        "blank" => line.split_whitespace().collect(),
        s => line.split(s).map(str::trim).collect(),
    }
}

/// The number of cells that nearly all lines have; `None` if they differ.
fn usual(rows: &[&str], separator: &str) -> Option<usize> {
    let counts: Vec<usize> = rows
        .iter()
        .take(60)
        .map(|l| split(l, separator).len())
        .collect();
    let last = *counts.last()?;
    let same = counts.iter().filter(|c| **c == last).count();
    (10 * same >= 7 * counts.len()).then_some(last)
}

/// A column with what it seems to be.
struct Guess<'a> {
    role: Option<&'static str>,
    name: &'a str,
    unit: &'static str,
    scale: f64,
}

/// A name in lower case without its unit, and the unit.
fn name_and_unit(name: &str) -> (String, &'static str, f64) {
    let plain: String = name
        .to_lowercase()
        .chars()
        .map(|c| if c.is_alphanumeric() { c } else { '_' })
        .collect();
    let plain = plain.trim_matches('_').to_string();
    for (ending, unit, scale) in UNITS {
        if let Some(rest) = plain.strip_suffix(&format!("_{ending}")) {
            return (rest.trim_end_matches('_').to_string(), unit, *scale);
        }
    }
    (plain, "", 1.0)
}

/// The role that a name stands for.
fn role(name: &str, taken: &[&str]) -> Option<&'static str> {
    let parts: Vec<&str> = name.split('_').collect();
    WORDS
        .iter()
        .filter(|(role, _)| !taken.contains(role))
        .find(|(_, words)| {
            words
                .iter()
                .any(|w| parts.iter().any(|p| p == w) || (w.len() > 3 && name.contains(w)))
        })
        .map(|(role, _)| *role)
}

/// Every column with its role; the time must grow.
fn guesses(table: &Table) -> Vec<Guess<'_>> {
    let mut taken: Vec<&str> = Vec::new();
    table
        .names
        .iter()
        .zip(&table.columns)
        .map(|(name, values)| {
            let (plain, unit, scale) = name_and_unit(name);
            let grows = values.windows(2).all(|w| w[1] > w[0]);
            let role = role(&plain, &taken).filter(|r| *r != "time" || grows);
            taken.extend(role);
            Guess {
                role,
                name,
                unit,
                scale,
            }
        })
        .collect()
}

/// A TOML text in quotes.
fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}

fn model(path: &Path, files: usize, layout: &Layout, table: &Table) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut out = format!(
        "# Guessed from {name}, the first of {files} file(s). Lines with ? are questions: answer them, then remove the mark.\n\
         title = \"Which effect does the model lack?\"\n\n[input]\n"
    );
    let input = &layout.input;
    // Writing to a text cannot fail.
    let _ = writeln!(out, "separator = {}", quoted(&input.separator));
    if input.decimal == "," {
        out.push_str("decimal = \",\"\n");
    }
    if !input.comment.is_empty() {
        let _ = writeln!(out, "comment = {}", quoted(&input.comment));
    }
    if input.skip > 0 {
        let _ = writeln!(out, "skip = {}", input.skip);
    }
    if !input.header.is_empty() {
        let names: Vec<String> = input.header.iter().map(|n| quoted(n)).collect();
        let origin = if layout.from_comment {
            "from the last comment line"
        } else {
            "the file has no header: name its columns"
        };
        let _ = writeln!(out, "header = [{}]   # ? {origin}", names.join(", "));
    }
    let found = guesses(table);
    let of = |role: &str| found.iter().find(|g| g.role == Some(role));
    if of("time").is_none() {
        out.push_str("rate = 100.0   # ? rows per second: no column grows as a time does\n");
    }
    out.push_str("\n[roles]\n");
    let line = |out: &mut String, role: &str, g: &Guess| {
        let scale = if g.scale == 1.0 {
            String::new()
        } else {
            format!(", scale = {}", g.scale)
        };
        let asked = if g.unit.is_empty() { "   # ? unit" } else { "" };
        let _ = writeln!(
            out,
            "{role} = {{ column = {}, unit = {}{scale} }}{asked}",
            quoted(g.name),
            quoted(g.unit)
        );
    };
    match of("time") {
        Some(g) => {
            let g = Guess {
                role: g.role,
                name: g.name,
                unit: "s",
                scale: g.scale,
            };
            line(&mut out, "time", &g);
        }
        None => out.push_str("time = { column = \"row_time\", unit = \"s\" }\n"),
    }
    match of("target").or_else(|| found.iter().rev().find(|g| g.role.is_none())) {
        Some(g) => line(&mut out, "target", g),
        None => out
            .push_str("target = { column = \"?\", unit = \"N\" }   # ? what the model predicts\n"),
    }
    for role in ["command", "velocity", "angle", "temperature", "setpoint"] {
        if let Some(g) = of(role) {
            line(&mut out, role, g);
        }
    }
    out.push_str("# ? velocity: give it `deadband`, the largest speed that is still a rest\n");
    let rest: Vec<String> = found
        .iter()
        .filter(|g| g.role.is_none())
        .map(|g| quoted(g.name))
        .collect();
    if !rest.is_empty() {
        let _ = writeln!(
            out,
            "# ? without a role: {}. Joint angles go under [roles.pose], other loads under [roles.channels]",
            rest.join(", ")
        );
    }
    if files < 2 {
        out.push_str("\n[holdout]\nblock_s = 10.0   # one file: blocks of time are held out\n");
    }
    // The command predicts where it is of the target's unit.
    let same = of("command")
        .zip(of("target"))
        .is_some_and(|(c, t)| c.unit == t.unit && !c.unit.is_empty());
    out.push_str("\n# ? what you believe: the prediction is the sum of the terms\n");
    if same {
        out.push_str("[[terms]]\nname = \"as commanded\"\nexpr = \"command\"\nfixed = 1.0\n");
    } else if of("command").is_some() {
        out.push_str("[[terms]]\nname = \"gain of the command\"\nexpr = \"command\"\n\n[[terms]]\nname = \"offset\"\nexpr = \"1\"\n");
    } else {
        out.push_str("[[terms]]\nname = \"offset\"\nexpr = \"1\"\n");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::Spec;

    fn of(text: &str) -> (Spec, String) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, text).unwrap();
        let text = guess(&[path]).unwrap();
        let spec = Spec::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        (spec, text)
    }

    fn rows(separator: &str, decimal: &str) -> String {
        (0..80)
            .map(|i| {
                let cells = [0.01 * f64::from(i), f64::from(i % 7) + 0.5, 2.25];
                let cells: Vec<String> = cells
                    .iter()
                    .map(|c| format!("{c:.3}").replace('.', decimal))
                    .collect();
                cells.join(separator) + "\n"
            })
            .collect()
    }

    #[test]
    fn names_give_roles_and_units() {
        let (spec, text) = of(&format!("time_ms,force_n,speed_rad_s\n{}", rows(",", ".")));
        assert_eq!(
            (spec.roles.time.column.as_str(), spec.roles.time.scale),
            ("time_ms", 1e-3)
        );
        assert_eq!(
            (
                spec.roles.target.column.as_str(),
                spec.roles.target.unit.as_str()
            ),
            ("force_n", "N")
        );
        assert_eq!(spec.roles.velocity.unwrap().unit, "rad/s");
        assert_eq!(spec.holdout.block_s, Some(10.0));
        assert!(text.contains("# ?"), "{text}");
    }

    #[test]
    fn layouts_are_recognised() {
        let (spec, _) = of(&format!("logger 7\nTime;Iq;Position\n{}", rows(";", ",")));
        assert_eq!(
            (
                spec.input.skip,
                spec.input.decimal.as_str(),
                spec.input.separator.as_str()
            ),
            (1, ",", ";")
        );
        assert_eq!(spec.roles.target.column, "Iq");
        let (spec, text) = of(&format!(
            "%made by hand\n%Time, Torque, Position\n{}",
            rows(",", ".")
        ));
        assert_eq!(spec.input.header, ["Time", "Torque", "Position"], "{text}");
        let (spec, text) = of(&rows(" ", "."));
        assert_eq!(spec.input.header.len(), 3, "{text}");
        assert_eq!(spec.input.separator, "blank");
    }
}
