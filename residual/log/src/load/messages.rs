//! Text logs with several kinds of message, each line with the kind at its head: every kind becomes
//! a table of its own, and all of them one table at the times of the kind that has the target.

use super::cells::{number, Marks};
use super::text::{large, no_text, open, OldText};
use super::{rows, stamps, Note, Table};
use crate::spec::{Action, Message, Spec};
use residual_columns::error::Error;
use residual_columns::format::num;
use residual_columns::stats;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Rows of one kind.
struct Kind<'a> {
    message: &'a Message,
    columns: Vec<Vec<f64>>,
    /// Line of each row.
    lines: Vec<u64>,
}

impl Kind<'_> {
    fn column(&self, name: &str) -> Option<&[f64]> {
        let at = self.message.header.iter().position(|n| n == name)?;
        self.columns.get(at).map(Vec::as_slice)
    }

    /// Leaves out messages without a time, and with `hygiene.time` those whose time is before that
    /// of one above; the numbers of both.
    fn order(&mut self, path: &Path, spec: &Spec) -> Result<(usize, usize), Error> {
        let (mut without, mut falls) = (0, 0);
        let mut keep = Vec::new();
        let mut last = f64::NEG_INFINITY;
        let times = self.column(&spec.roles.time.column).unwrap_or(&[]);
        for (t, line) in times.iter().zip(&self.lines) {
            if *t < last && spec.hygiene.time != Action::Drop {
                return Err(Error::data(
                    format!(
                        "{}: line {line}: the time of the kind `{}` falls, from {last} to {t}",
                        path.display(),
                        self.message.begins
                    ),
                    "Split the file where a second run begins, or set hygiene.time = \"drop\" to leave such messages out",
                ));
            }
            without += usize::from(!t.is_finite());
            falls += usize::from(*t < last);
            keep.push(t.is_finite() && *t >= last);
            if t.is_finite() {
                last = last.max(*t);
            }
        }
        if without + falls > 0 {
            for column in &mut self.columns {
                let mut kept = keep.iter();
                column.retain(|_| kept.next() == Some(&true));
            }
        }
        Ok((without, falls))
    }

    /// The time between two messages of this kind beyond which nothing is known between them. It is
    /// not less than a usual step of the rows at `at`, and without end for a kind that comes as it
    /// likes.
    fn longest_step(&self, own: &[f64], at: &[f64], spec: &Spec) -> f64 {
        let scale = spec.roles.time.scale.abs();
        let gap_s = spec.hygiene.gap_s / scale;
        let limit = rows::longest_step(own, gap_s);
        let gaps = own.windows(2).filter(|w| w[1] - w[0] > limit).count();
        if gap_s == 0.0 && stamps::is_uneven(gaps, own.len()) {
            return f64::INFINITY;
        }
        let mut steps: Vec<f64> = at.windows(2).map(|w| w[1] - w[0]).collect();
        limit.max(stats::median(&mut steps).unwrap_or(0.0))
    }
}

/// Reads one log.
///
/// # Errors
/// [`Error::Io`] and [`Error::BadCell`] with file and line; [`Error::Data`] if the time of a kind
/// falls, or if no row of the kind with the target has messages of the others beside it;
/// [`Error::Model`] if no kind has the target, if a kind has no time, or if two have a column of
/// the same name.
pub(super) fn read(path: &Path, spec: &Spec) -> Result<Table, Error> {
    check(spec)?;
    let used = rows::largest_cells(spec)?;
    let input = &spec.input;
    let mut kinds: Vec<Kind> = input
        .messages
        .iter()
        .map(|message| Kind {
            columns: vec![Vec::new(); message.header.len()],
            lines: vec![],
            message,
        })
        .collect();
    let (mut others, mut broken) = (0, 0);
    let mut first_broken = None;
    let drop = spec.hygiene.text == Action::Drop;
    for (i, line) in BufReader::new(OldText::new(open(path)?))
        .split(b'\n')
        .enumerate()
        .skip(input.skip)
    {
        let at = i as u64 + 1;
        let line = line.map_err(|e| Error::io(path, format!("line {at}: {e}")))?;
        let line = match std::str::from_utf8(&line) {
            Ok(line) => line.trim(),
            Err(_) if drop => {
                broken += 1;
                continue;
            }
            Err(_) => return Err(no_text(path, at)),
        };
        match kinds
            .iter_mut()
            .find(|k| line.starts_with(&k.message.begins))
        {
            Some(kind) => match add(kind, line, at, path, spec, &used) {
                Err(why) if drop => {
                    broken += 1;
                    first_broken.get_or_insert(why);
                }
                done => done?,
            },
            None => others += usize::from(!line.is_empty()),
        }
    }
    if let Some(none) = kinds.iter().find(|k| k.columns.iter().all(Vec::is_empty)) {
        // Where all lines of a kind are broken, the kind is.
        if let Some(why) = first_broken {
            return Err(why);
        }
        return Err(Error::io(
            path,
            format!(
                "no line begins with `{}`; correct input.messages in the model file, or leave the file out of --data",
                none.message.begins
            ),
        ));
    }
    let (mut without, mut falls) = (0, 0);
    // The rows of the kind with the target are looked at with those of other logs, after they are
    // split.
    for kind in kinds
        .iter_mut()
        .filter(|k| !k.message.header.contains(&spec.roles.target.column))
    {
        let (more_without, more_falls) = kind.order(path, spec)?;
        (without, falls) = (without + more_without, falls + more_falls);
    }
    let mut table = joined(&kinds, spec, path)?;
    table.notes.extend([
        Note::new(
            "messages",
            others,
            "lines of other kinds than input.messages lists were left out",
        ),
        Note::of_lost_rows(
            "messages without a time",
            without,
            "messages without a finite time were left out",
        ),
        Note::of_lost_rows(
            "time of a kind",
            falls,
            "messages whose time is before that of one above were left out",
        ),
    ]);
    Ok(Table { broken, ..table })
}

/// What the model file must say about messages.
fn check(spec: &Spec) -> Result<(), Error> {
    let messages = &spec.input.messages;
    let (time, target) = (&spec.roles.time.column, &spec.roles.target.column);
    let with = |name: &String| messages.iter().filter(|m| m.header.contains(name)).count();
    if with(target) != 1 {
        return Err(Error::model(format!(
            "input.messages: {} kinds have the target's column `{target}`; exactly one must",
            with(target)
        )));
    }
    if let Some(m) = messages.iter().find(|m| !m.header.contains(time)) {
        return Err(Error::model(format!(
            "input.messages: the kind `{}` has no column `{time}`, which roles.time names; every kind needs its time",
            m.begins
        )));
    }
    let names = messages.iter().flat_map(|m| &m.header);
    // A column without a name is left out.
    match names
        .clone()
        .find(|n| *n != time && !n.is_empty() && with(n) > 1)
    {
        Some(name) => Err(Error::model(format!(
            "input.messages: two kinds have a column `{name}`; give each a name of its own"
        ))),
        None => Ok(()),
    }
}

/// Adds the cells of one line: all of them, or none where one is wrong.
fn add(
    kind: &mut Kind,
    line: &str,
    at: u64,
    path: &Path,
    spec: &Spec,
    used: &BTreeMap<String, f64>,
) -> Result<(), Error> {
    let input = &spec.input;
    let cells: Vec<&str> = match input.separator.as_str() {
        "blank" => line.split_whitespace().collect(),
        separator => line.split(separator).map(str::trim).collect(),
    };
    let header = &kind.message.header;
    if cells.len() != header.len() {
        return Err(Error::io(
            path,
            format!(
                "line {at}: {} cells where the kind `{}` has {} columns; correct input.messages in the model file, or the line, or leave such lines out with hygiene.text = \"drop\"",
                cells.len(),
                kind.message.begins,
                header.len()
            ),
        ));
    }
    let marks = Marks::of(input);
    let value = |(cell, name): (&&str, &String)| match number(cell, marks) {
        Some(x) => {
            let largest = used.get(name).copied().unwrap_or(f64::INFINITY);
            rows::too_large(x, largest).map_or(Ok(x), |why| Err(large(path, at, name, &why)))
        }
        None if name.is_empty() => Ok(f64::NAN),
        None => Err(Error::BadCell {
            path: path.to_path_buf(),
            line: at,
            column: name.clone(),
            text: (*cell).to_string(),
        }),
    };
    let values: Vec<f64> = cells
        .iter()
        .zip(header)
        .map(value)
        .collect::<Result<_, _>>()?;
    for (column, value) in kind.columns.iter_mut().zip(values) {
        column.push(value);
    }
    kind.lines.push(at);
    Ok(())
}

/// One table at the times of the kind with the target; the other kinds are read between their rows
/// along straight lines. Rows before the first and after the last of another kind, and rows in its
/// gaps, are left out.
///
/// # Errors
/// [`Error::Data`] if no row is left.
fn joined(kinds: &[Kind], spec: &Spec, path: &Path) -> Result<Table, Error> {
    let (time, target) = (&spec.roles.time.column, &spec.roles.target.column);
    let mut table = Table::default();
    let Some(main) = kinds.iter().find(|k| k.message.header.contains(target)) else {
        return Ok(table);
    };
    let at = main.column(time).unwrap_or(&[]);
    let mut keep = vec![true; at.len()];
    let (mut outside, mut in_gaps) = (0, 0);
    for kind in kinds.iter().filter(|k| !std::ptr::eq(*k, main)) {
        let own = kind.column(time).unwrap_or(&[]);
        let limit = kind.longest_step(own, at, spec);
        for (keep, t) in keep.iter_mut().zip(at).filter(|(keep, _)| **keep) {
            match around(own, *t) {
                Some((before, after)) if own[after] - own[before] <= limit => continue,
                Some(_) => in_gaps += 1,
                None => outside += 1,
            }
            *keep = false;
        }
        if !at.is_empty() && !keep.contains(&true) {
            let span = |t: &[f64]| {
                let (lo, hi) = stats::range(t);
                format!("{} to {}", num(lo), num(hi))
            };
            return Err(Error::data(
                format!(
                    "{}: no message of the kind `{}` (time {}) has one of the kind `{}` (time {}) beside it",
                    path.display(),
                    main.message.begins,
                    span(at),
                    kind.message.begins,
                    span(own)
                ),
                "Give both kinds one clock, or leave the file out of --data",
            ));
        }
    }
    for kind in kinds {
        let own = kind.column(time).unwrap_or(&[]);
        let is_main = std::ptr::eq(kind, main);
        for (name, values) in kind.message.header.iter().zip(&kind.columns) {
            if name.is_empty() || (name == time && !is_main) {
                continue;
            }
            let rows = (0..at.len()).filter(|i| keep[*i]);
            table.names.push(name.clone());
            table.columns.push(if is_main {
                rows.map(|i| values[i]).collect()
            } else {
                rows.map(|i| between(own, values, at[i])).collect()
            });
        }
    }
    table.notes = vec![
        Note::of_lost_rows(
            "messages of others",
            outside,
            "rows before the first or after the last message of another kind were left out",
        ),
        Note::of_lost_rows(
            "gap of a kind",
            in_gaps,
            "rows where another kind of message is missing for longer than hygiene.gap_s (0: 20 of its median steps) were left out",
        ),
    ];
    Ok(table)
}

/// Places of the messages before and after a time, in the times `own` that do not fall; of one at
/// that very time, that place twice.
fn around(own: &[f64], t: f64) -> Option<(usize, usize)> {
    let after = own.partition_point(|o| *o <= t);
    let before = after.checked_sub(1)?;
    if own[before] == t {
        return Some((before, before));
    }
    (after < own.len()).then_some((before, after))
}

/// `values` at times `own`, read at another time along a straight line.
fn between(own: &[f64], values: &[f64], t: f64) -> f64 {
    match around(own, t) {
        None => f64::NAN,
        Some((before, after)) if before == after => values[before],
        Some((before, after)) => {
            let part = (t - own[before]) / (own[after] - own[before]);
            values[before] + part * (values[after] - values[before])
        }
    }
}
