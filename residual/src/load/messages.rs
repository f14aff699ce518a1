//! Text logs with several kinds of message, each line with the kind at its head: every kind becomes a table of its own,
//! and all of them one table at the times of the kind that has the target.

use super::text::{large, no_text, number, open};
use super::{rows, Table};
use crate::error::Error;
use crate::spec::{Action, Message, Spec};
use std::collections::BTreeMap;
use std::io::BufRead;
use std::path::Path;

/// Rows of one kind.
struct Kind<'a> {
    message: &'a Message,
    columns: Vec<Vec<f64>>,
}

impl Kind<'_> {
    fn column(&self, name: &str) -> Option<&[f64]> {
        let at = self.message.header.iter().position(|n| n == name)?;
        self.columns.get(at).map(Vec::as_slice)
    }
}

/// Reads one log.
///
/// # Errors
/// [`Error::Io`] and [`Error::BadCell`] with file and line; [`Error::Model`] if no kind has the target, if a kind has no
/// time, or if two have a column of the same name.
pub(super) fn read(path: &Path, spec: &Spec) -> Result<Table, Error> {
    check(spec)?;
    let used = rows::largest_cells(spec)?;
    let input = &spec.input;
    let mut kinds: Vec<Kind> = input
        .messages
        .iter()
        .map(|message| Kind {
            columns: vec![Vec::new(); message.header.len()],
            message,
        })
        .collect();
    let (mut others, mut broken) = (0, 0);
    let mut first_broken = None;
    let drop = spec.hygiene.text == Action::Drop;
    for (i, line) in open(path)?.split(b'\n').enumerate().skip(input.skip) {
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
    Ok(Table {
        others,
        broken,
        ..joined(&kinds, spec)
    })
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
    let decimal = if input.decimal == "," { ',' } else { '.' };
    let value = |(cell, name): (&&str, &String)| match number(cell, decimal) {
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
    Ok(())
}

/// One table at the times of the kind with the target; the other kinds are read between their rows along straight lines,
/// and before their first and after their last row there is no value.
fn joined(kinds: &[Kind], spec: &Spec) -> Table {
    let (time, target) = (&spec.roles.time.column, &spec.roles.target.column);
    let mut table = Table::default();
    let Some(main) = kinds.iter().find(|k| k.message.header.contains(target)) else {
        return table;
    };
    let at = main.column(time).unwrap_or(&[]);
    for kind in kinds {
        let own = kind.column(time).unwrap_or(&[]);
        for (name, values) in kind.message.header.iter().zip(&kind.columns) {
            let is_main = std::ptr::eq(kind, main);
            if name.is_empty() || (name == time && !is_main) {
                continue;
            }
            table.names.push(name.clone());
            table.columns.push(if is_main {
                values.clone()
            } else {
                between(own, values, at)
            });
        }
    }
    table
}

/// `values` at times `own`, read at other times.
fn between(own: &[f64], values: &[f64], at: &[f64]) -> Vec<f64> {
    at.iter()
        .map(|t| {
            let after = own.partition_point(|o| o <= t);
            let Some(before) = after.checked_sub(1) else {
                return f64::NAN;
            };
            if own[before] == *t {
                return values[before];
            }
            match own.get(after) {
                Some(next) => {
                    let part = (t - own[before]) / (next - own[before]);
                    values[before] + part * (values[after] - values[before])
                }
                None => f64::NAN,
            }
        })
        .collect()
}
