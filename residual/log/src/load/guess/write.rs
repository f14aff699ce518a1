//! The text of the model file.

use super::columns::{self, Chosen, Column};
use super::layout::{Layout, Origin};
use super::time::{self, Time};
use super::units::{self, Measure};
use super::Table;
use crate::load::is_date;
use residual_columns::format::num;
use std::fmt::Write as _;
use std::path::Path;

/// Names of columns without a role that are listed.
const LISTED: usize = 24;

/// Groups that blocks of time are to make at least.
const GROUPS: f64 = 10.0;

/// Rows that a block of time has at least.
const BLOCK_ROWS: f64 = 20.0;

/// The model file for a log that is one of `files`.
pub(super) fn model(
    path: &Path,
    files: usize,
    layout: &Layout,
    table: &Table,
    first_broken: Option<&str>,
) -> String {
    let mut columns = columns::columns(table, layout.is_nameless());
    for column in &mut columns {
        column.describe(layout.second(column.title));
        if let Some((_, unit)) = table.units.iter().find(|(name, _)| name == column.title) {
            column.describe(unit);
        }
        // A type of time was converted already, whatever its name says.
        if table.times.iter().any(|(name, _)| name == column.title) {
            column.role = Some("time");
            (column.name.unit, column.name.scale) = ("s", 1.0);
        }
    }
    // Which of the columns move together does not depend on the unit of the time.
    let first = columns::choose(&columns, None);
    let pair = first.get("angle").zip(first.get("velocity"));
    let slope = |time: usize| {
        let (angle, velocity) = pair?;
        units::slope(&columns[time], &columns[angle], &columns[velocity])
    };
    // Numbers of rows are no time where the file states its rate.
    let time = time::find(&columns, slope).filter(|t| layout.rate.is_none() || !t.counts);
    let chosen = columns::choose(&columns, time.as_ref().map(|t| t.column));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut out = format!(
        "# Guessed from {name}, one of {files} file(s). Lines with ? are questions: answer them, then remove the mark.\n\
         title = \"Which effect does the model lack?\"\n"
    );
    input(&mut out, layout);
    let rate = layout.rate.filter(|_| time.is_none());
    match rate {
        Some(rate) => {
            let _ = writeln!(
                out,
                "rate = {rate:?}   # from the step that the file states"
            );
        }
        None if time.is_none() => no_time(&mut out, table),
        None => {}
    }
    roles(&mut out, &columns, &chosen, time.as_ref());
    several_in_a_cell(&mut out, table);
    in_turn(&mut out, layout, table);
    apart(&mut out, &columns, chosen.get("target"));
    hints(&mut out, &columns, &chosen, time.as_ref(), slope);
    let repeats = time.as_ref().is_some_and(|t| t.repeats > 0);
    if repeats || first_broken.is_some() {
        out.push_str("\n[hygiene]\n");
    }
    if repeats {
        out.push_str(
            "time = \"drop\"   # ? rows that repeat the time of the row before are left out\n",
        );
    }
    if let Some(why) = first_broken {
        // One line: it is a comment.
        let why = why.replace(['\n', '\r'], " ");
        let _ = writeln!(
            out,
            "text = \"drop\"   # ? {} line(s) that are no rows are left out; the first: {why}",
            table.broken
        );
    }
    if files < 2 {
        let of_rate = rate.map(|rate| (table.rows() as f64 / rate, 1.0 / rate));
        holdout(
            &mut out,
            time.as_ref().map(|t| (t.span, t.step)).or(of_rate),
        );
    }
    terms(&mut out, &columns, &chosen);
    out
}

/// A TOML text in quotes.
fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}

/// How the file is read. Writing to a text cannot fail, here and below.
fn input(out: &mut String, layout: &Layout) {
    let input = &layout.input;
    out.push_str("\n[input]\n");
    if layout.is_text {
        let _ = writeln!(out, "separator = {}", quoted(&input.separator));
    }
    if input.decimal == "," {
        out.push_str("decimal = \",\"\n");
    }
    if !input.thousands.is_empty() {
        let _ = writeln!(
            out,
            "thousands = {}   # ? the mark between thousands: with {} as decimal mark",
            quoted(&input.thousands),
            quoted(&input.decimal)
        );
    }
    if !input.comment.is_empty() {
        let _ = writeln!(out, "comment = {}", quoted(&input.comment));
    }
    if input.skip > 0 {
        let _ = writeln!(out, "skip = {}", input.skip);
    }
    if !input.header.is_empty() {
        let names: Vec<String> = input.header.iter().map(|n| quoted(n)).collect();
        let origin = match layout.origin {
            Origin::Line(line) => {
                format!("from line {line}; a name that was empty or repeated has a number")
            }
            Origin::Comment => {
                "from the last comment line that has as many names as columns".into()
            }
            Origin::Labels => "from the labels in the rows".into(),
            _ => "the file has no header: name its columns".into(),
        };
        let code = layout.code.map_or(String::new(), |code| {
            format!("; their code is taken for {code}, as the file is no UTF-8")
        });
        let _ = writeln!(out, "header = [{}]   # ? {origin}{code}", names.join(", "));
    }
}

/// What is asked where no column is the time. A date is none, and says what to do about it.
fn no_time(out: &mut String, table: &Table) {
    out.push_str(
        "# rate = ...   # ? rows per second: no column grows as a time does. Remove the # and write the number\n",
    );
    let read = table.times.first().map(|(name, what)| (name, *what));
    if let Some((name, what)) = read {
        let _ = writeln!(
            out,
            "# ? column {} is {what}, and does not grow",
            quoted(name)
        );
    }
    if let Some((name, cell, _)) = table.text.iter().find(|(_, cell, _)| is_date(cell)) {
        let _ = writeln!(
            out,
            "# ? column {} is a date or a time of day ({}): write it into the log as seconds (in pandas: (t - t[0]).dt.total_seconds()) \
             and name it in roles.time, or set the rate",
            quoted(name),
            cell.replace(['\n', '\r'], " ")
        );
    }
}

/// Names the columns whose cells hold several numbers as text, as a list or a tuple of a converter.
fn several_in_a_cell(out: &mut String, table: &Table) {
    let is_list = |cell: &str| {
        let inner = cell.trim().trim_matches(['(', ')', '[', ']', '"']);
        let mut parts = inner
            .split([',', ' ', ';'])
            .map(str::trim)
            .filter(|p| !p.is_empty());
        let numbers = parts.clone().filter(|p| p.parse::<f64>().is_ok()).count();
        numbers > 1 && parts.all(|p| p.parse::<f64>().is_ok())
    };
    let lists = table.text.iter().filter(|(_, cell, _)| is_list(cell));
    let names: Vec<String> = lists.map(|(name, ..)| quoted(name)).collect();
    if !names.is_empty() {
        let _ = writeln!(
            out,
            "# ? several numbers in one cell, as text: {}. Split them into a column for each number",
            names.join(", ")
        );
    }
}

/// Names the column that tells which variable a row has, where each row has one.
fn in_turn(out: &mut String, layout: &Layout, table: &Table) {
    let Some((_, words)) = &layout.turns else {
        return;
    };
    let is_it = |cell: &str| words.first().is_some_and(|w| w == cell);
    let Some((name, ..)) = table.text.iter().find(|(_, cell, _)| is_it(cell)) else {
        return;
    };
    let _ = writeln!(
        out,
        "# ? column {name} has {} in turn: each row seems to have one variable. Write a column for each (in pandas: pivot_table with columns={name})",
        words[..words.len().min(LISTED)].join(", "),
        name = quoted(name),
    );
}

/// Names the columns that have values only in rows without one of the target: topics of unlike
/// rates that were joined.
fn apart(out: &mut String, columns: &[Column], target: Option<usize>) {
    let Some(target) = target.map(|i| &columns[i]) else {
        return;
    };
    let is_apart = |c: &&Column| {
        let mut pairs = c.values.iter().zip(target.values);
        let some = c.values.iter().any(|v| v.is_finite());
        some && !pairs.any(|(a, b)| a.is_finite() && b.is_finite())
    };
    let names: Vec<String> = columns
        .iter()
        .filter(is_apart)
        .map(|c| quoted(c.title))
        .collect();
    if !names.is_empty() {
        let _ = writeln!(
            out,
            "# ? columns of unlike rates are joined: no row has both the target and {}. Interpolate them to the times of the target first",
            names[..names.len().min(LISTED)].join(", ")
        );
    }
}

/// One column with its unit and the questions about it.
fn role(out: &mut String, role: &str, column: &str, measure: &Measure, questions: &[String]) {
    let scale = if measure.scale == 1.0 {
        String::new()
    } else {
        format!(", scale = {}", measure.scale)
    };
    let mut asked = questions.to_vec();
    asked.extend(measure.question.clone());
    let asked = if asked.is_empty() {
        String::new()
    } else {
        format!("   # ? {}", asked.join("; "))
    };
    let _ = writeln!(
        out,
        "{role} = {{ column = {}, unit = {}{scale} }}{asked}",
        quoted(column),
        quoted(&measure.unit)
    );
}

/// Every column with a role.
fn roles(out: &mut String, columns: &[Column], chosen: &Chosen, time: Option<&Time>) {
    out.push_str("\n[roles]\n");
    let seconds = |scale: f64| Measure {
        unit: "s".into(),
        scale,
        question: None,
    };
    match time {
        Some(t) => {
            let name = columns[t.column].title;
            role(out, "time", name, &seconds(t.scale), &t.questions);
        }
        None => role(out, "time", "row_time", &seconds(1.0), &[]),
    }
    if chosen.get("target").is_none() {
        out.push_str("target = { column = \"?\", unit = \"N\" }   # ? what the model predicts\n");
    }
    let at = |role| chosen.get(role).map(|i| &columns[i]);
    let angle = at("angle").map(|c| units::angle(c, at("velocity")));
    for name in [
        "target",
        "command",
        "velocity",
        "angle",
        "temperature",
        "setpoint",
    ] {
        let Some(column) = at(name) else {
            continue;
        };
        let measure = match (name, &angle) {
            ("angle", Some(angle)) => angle.clone(),
            ("velocity", angle) => units::velocity(column, angle.as_ref()),
            _ => Measure::of(column),
        };
        let question: Vec<String> = chosen
            .question(name)
            .map(str::to_string)
            .into_iter()
            .collect();
        role(out, name, column.title, &measure, &question);
    }
}

/// What else is to be asked: the deadband, columns that contradict each other, columns without a
/// role.
fn hints(
    out: &mut String,
    columns: &[Column],
    chosen: &Chosen,
    time: Option<&Time>,
    slope: impl Fn(usize) -> Option<f64>,
) {
    if chosen.get("velocity").is_some() {
        out.push_str("# ? velocity: give it `deadband`, the largest speed that is still a rest\n");
    }
    let contradiction = time
        .and_then(|t| Some(slope(t.column)? / t.scale))
        .and_then(units::contradiction);
    if let Some(what) = contradiction {
        let _ = writeln!(out, "# ? {what}");
    }
    let time = time.map(|t| t.column);
    let rest: Vec<String> = (0..columns.len())
        .filter(|i| Some(*i) != time && !chosen.has(*i))
        .map(|i| quoted(columns[i].title))
        .collect();
    if !rest.is_empty() {
        let more = match rest.len().saturating_sub(LISTED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let _ = writeln!(
            out,
            "# ? without a role: {}{more}. Joint angles go under [roles.pose], other loads under [roles.channels]",
            rest[..rest.len().min(LISTED)].join(", ")
        );
    }
}

/// Blocks of time are held out where there is one file only.
fn holdout(out: &mut String, span_and_step: Option<(f64, f64)>) {
    out.push_str("\n[holdout]\n");
    let _ = match span_and_step {
        Some((span, step)) => writeln!(
            out,
            "block_s = {:?}   # one file of {} s: blocks of time are held out",
            block(span, step),
            num(span)
        ),
        None => writeln!(
            out,
            "# block_s = ...   # ? one file: blocks of time are held out. Remove the # and write a tenth of the file's duration, or less"
        ),
    };
}

/// Length of the blocks of time, in s: 10, or less where that makes too few groups; never of too
/// few rows, but always two.
fn block(span: f64, step: f64) -> f64 {
    let wanted = (span / GROUPS)
        .min(10.0)
        .max(BLOCK_ROWS * step)
        .min(span / 2.0);
    if !(wanted > 0.0 && wanted.is_finite()) {
        return 10.0;
    }
    // The next round number below: 1, 2 or 5 times a power of ten.
    let power = 10f64.powi(wanted.log10().floor() as i32);
    let mantissa = [5.0, 2.0, 1.0]
        .into_iter()
        .find(|m| m * power <= wanted * (1.0 + 1e-9));
    let round = mantissa.unwrap_or(1.0) * power;
    // Written without the last bits of the product.
    num(round).parse().unwrap_or(round)
}

/// The declared terms. The command predicts where it is of the target's unit.
fn terms(out: &mut String, columns: &[Column], chosen: &Chosen) {
    let unit = |role| chosen.get(role).map(|i| columns[i].name.unit);
    let command = unit("command");
    out.push_str("\n# ? what you believe: the prediction is the sum of the terms\n");
    if command.is_some_and(|c| !c.is_empty()) && command == unit("target") {
        out.push_str("[[terms]]\nname = \"as commanded\"\nexpr = \"command\"\nfixed = 1.0\n");
    } else if command.is_some() {
        out.push_str("[[terms]]\nname = \"gain of the command\"\nexpr = \"command\"\n\n[[terms]]\nname = \"offset\"\nexpr = \"1\"\n");
    } else {
        out.push_str("[[terms]]\nname = \"offset\"\nexpr = \"1\"\n");
    }
}

#[cfg(test)]
mod tests {
    use super::block;

    #[test]
    fn blocks_make_ten_groups_where_rows_allow() {
        for (span, step, expected) in [
            (3600.0, 0.01, 10.0),
            (100.0, 0.01, 10.0),
            (13.6, 0.001, 1.0),
            (6.1, 0.001, 0.5),
            (0.5, 0.001, 0.05),
            // 50 rows: two blocks of at least 20.
            (0.5, 0.01, 0.2),
            (0.3, 0.01, 0.1),
        ] {
            assert_eq!(block(span, step), expected, "{span} {step}");
        }
    }
}
