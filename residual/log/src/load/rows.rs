//! From the tables of all logs to one frame: units, rows that cannot be used, sequences.

use super::stamps::{self, is_uneven};
use super::Table;
use crate::data::largest;
use crate::finding::Findings;
use crate::spec::{Action, Column, Spec};
use residual_columns::error::Error;
use residual_columns::expr::Expr;
use residual_columns::frame::Frame;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// All rows that can be used, in units of the model, without the filters of the model file. The
/// frame has a column `file` with the index of each row's table.
///
/// # Errors
/// [`Error::Data`] if the time of a table does not grow, or if there is no row.
pub(super) fn frame(
    tables: &mut [Table],
    spec: &Spec,
    findings: &mut Findings,
) -> Result<Frame, Error> {
    let total = tables.iter().map(Table::rows).sum();
    let names = needed_columns(spec, tables)?;
    let needed = raw_columns(spec, &names);
    let mut rows = Rows::new(spec, names, total);
    for (index, table) in tables.iter_mut().enumerate() {
        let label = table.source.display().to_string();
        if table.columns.first().is_none_or(Vec::is_empty) {
            findings.count("empty file", 1, &label, "files without a row");
        }
        for note in &table.notes {
            findings.count(&note.check, note.count, &label, &note.what);
            if note.lost {
                findings.lose(&note.what, note.count, &label);
            }
        }
        findings.count_lost(
            "broken lines",
            table.broken,
            &label,
            "lines that are no rows were left out (hygiene.text)",
        );
        let before: usize = rows.missing.iter().map(|m| m.rows).sum();
        for part in split_by(table, &spec.input.sequence) {
            for run in rows.add(table, index as u32, &part, &label, findings)? {
                rows.cut_at_gaps(run, &label, findings);
            }
        }
        let empty = rows.missing.iter().map(|m| m.rows).sum::<usize>() - before;
        if is_joined(table, &needed, table.rows() - empty) {
            findings.count(
                "joined columns",
                empty,
                &label,
                &format!("rows with an empty cell where each column has values, but in other rows. {JOINED}"),
            );
        }
        // Its rows are copied: large logs must not be in memory twice. Where no row came of any
        // log, the message below looks at them.
        if !rows.time.is_empty() {
            table.columns = vec![];
        }
    }
    if rows.time.is_empty() {
        return Err(no_rows(tables, &needed));
    }
    rows.note_missing(findings);
    let file: Vec<f64> = rows.file.into_iter().map(f64::from).collect();
    let mut named: Vec<(String, Vec<f64>)> = rows.names.into_iter().zip(rows.columns).collect();
    named.push(("file".into(), file));
    Ok(Frame::new(named, rows.time, rows.sequences))
}

/// Rows collected so far.
struct Rows<'a> {
    spec: &'a Spec,
    roles: Vec<(String, &'a Column)>,
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
    time: Vec<f64>,
    /// Index of each row's table.
    file: Vec<u32>,
    sequences: Vec<Range<usize>>,
    /// Rows that were left out as a cell of theirs has no number.
    missing: Vec<Missing>,
}

/// Rows without a number in a cell, of one table.
struct Missing {
    rows: usize,
    label: String,
    /// How many of them each column has, by its name in the log.
    of_column: BTreeMap<String, usize>,
}

/// Columns that are named where cells are empty.
const NAMED: usize = 4;

impl<'a> Rows<'a> {
    /// Room for `total` rows.
    fn new(spec: &'a Spec, names: Vec<String>, total: usize) -> Self {
        Rows {
            spec,
            roles: spec.roles.all(),
            columns: names.iter().map(|_| Vec::with_capacity(total)).collect(),
            names,
            time: Vec::with_capacity(total),
            file: Vec::with_capacity(total),
            sequences: vec![],
            missing: vec![],
        }
    }

    /// Notes the rows without a number in a cell, with the columns whose cells these are.
    fn note_missing(&self, findings: &mut Findings) {
        let mut columns: BTreeMap<&str, usize> = BTreeMap::new();
        for (name, count) in self.missing.iter().flat_map(|m| &m.of_column) {
            *columns.entry(name).or_default() += count;
        }
        let mut columns: Vec<(&str, usize)> = columns.into_iter().collect();
        columns.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let said: Vec<String> = columns
            .iter()
            .take(NAMED)
            .map(|(name, count)| format!("`{name}` {count}"))
            .collect();
        let what = format!(
            "rows with an empty or non-finite cell in a mapped column were left out: {}",
            said.join(", ")
        );
        for missing in &self.missing {
            findings.count_lost("non-finite", missing.rows, &missing.label, &what);
        }
    }

    /// Adds rows of a table, in units of the model, and gives the runs of the clock among them.
    /// Rows with a missing value are left out.
    fn add(
        &mut self,
        table: &Table,
        file: u32,
        rows: &[usize],
        label: &str,
        findings: &mut Findings,
    ) -> Result<Vec<Range<usize>>, Error> {
        let tc = &self.spec.roles.time;
        let source = table.column(&tc.column).unwrap_or(&[]);
        let cells: Vec<(&[f64], f64, f64, &str)> = self
            .names
            .iter()
            .map(|n| match self.roles.iter().find(|(role, _)| role == n) {
                Some((_, c)) => {
                    let cells = table.column(&c.column).unwrap_or(&[]);
                    (cells, c.scale, c.offset, c.column.as_str())
                }
                None => (table.column(n).unwrap_or(&[]), 1.0, 0.0, n.as_str()),
            })
            .collect();
        let mut missing = Missing {
            rows: 0,
            label: label.into(),
            of_column: BTreeMap::new(),
        };
        let (mut usable, mut times) = (Vec::new(), Vec::new());
        for &i in rows {
            let t = source[i] * tc.scale + tc.offset;
            let empty = cells.iter().filter(|(c, ..)| !c[i].is_finite());
            let empty = empty.map(|(.., name)| *name);
            let mut empty = empty
                .chain((!t.is_finite()).then_some(tc.column.as_str()))
                .peekable();
            if empty.peek().is_some() {
                missing.rows += 1;
                empty.for_each(|name| *missing.of_column.entry(name.into()).or_default() += 1);
            } else {
                usable.push(i);
                times.push(t);
            }
        }
        self.missing.extend((missing.rows > 0).then_some(missing));
        // A logger may put the newest row first.
        let backwards = stamps::is_backwards(&times);
        if backwards {
            usable.reverse();
            times.reverse();
        }
        let stamps = stamps::read(&times);
        let mut left_out: Vec<usize> = [&stamps.repeated[..], &stamps.early[..]].concat();
        left_out.sort_unstable();
        if let Some(&at) = left_out
            .first()
            .filter(|_| self.spec.hygiene.time != Action::Drop)
        {
            let last = times[..at]
                .iter()
                .copied()
                .fold(f64::NEG_INFINITY, f64::max);
            return Err(Error::data(
                format!("{label}: time does not grow at row {} of the data ({} s after {last} s)", usable[at] + 1, times[at]),
                "Split the file with input.sequence, or set hygiene.time = \"drop\" to leave such rows out",
            ));
        }
        let mut left_out = left_out.into_iter().peekable();
        let mut runs = Vec::new();
        for run in stamps.runs.iter().filter(|r| !r.is_empty()) {
            let begin = self.time.len();
            for k in run.clone() {
                if left_out.next_if_eq(&k).is_some() {
                    continue;
                }
                let (i, t) = (usable[k], stamps.time[k]);
                self.time.push(t);
                self.file.push(file);
                let refuse = |name: &str, value: f64| match too_large(value, largest(name)) {
                    None => Ok(value),
                    Some(why) => Err(Error::data(
                        format!("{label}: row {} of the data: `{name}`: {why}", i + 1),
                        "Correct the value or the scale of its column",
                    )),
                };
                refuse("time", t)?;
                for ((out, (c, k, o, _)), name) in
                    self.columns.iter_mut().zip(&cells).zip(&self.names)
                {
                    out.push(refuse(name, c[i] * k + o)?);
                }
            }
            runs.push(begin..self.time.len());
        }
        findings.count_lost(
            "time",
            stamps.repeated.len(),
            label,
            "rows whose time is that of the row before were left out",
        );
        findings.count_lost(
            "early time",
            stamps.early.len(),
            label,
            "rows whose time is before that of a row above were left out",
        );
        findings.count(
            "newest first",
            if backwards { times.len() } else { 0 },
            label,
            "rows stand in the file with the newest first: they were read from its end",
        );
        findings.count(
            "clock set back",
            stamps.runs.len() - 1,
            label,
            "places where the time falls back and goes on from there: a new run of rows begins, as after a gap",
        );
        findings.count(
            "coarse time",
            stamps.even,
            label,
            "rows whose time is printed in steps longer than those of the rows: an even time between the first and the last stamp fits \
             all of them and was taken",
        );
        Ok(runs)
    }
}

/// What helps where columns have their values in different rows.
const JOINED: &str = "Where columns of unlike rates are joined in one table, interpolate them to the times of the target first";

/// Share of the rows of a table that are left out from which on its columns may be joined ones.
const MANY: f64 = 0.4;

/// Share of the rows in which each of such columns has a value.
const SOME: f64 = 0.1;

/// Whether a table of which some rows are `used` looks like columns of unlike rates joined: many
/// rows have an empty cell, and each column that is needed has values in some.
fn is_joined(table: &Table, needed: &[Needed], used: usize) -> bool {
    let rows = table.rows() as f64;
    let filled = |n: &Needed| {
        let values = table.column(&n.column).unwrap_or(&[]);
        values.iter().filter(|x| x.is_finite()).count() as f64 >= SOME * rows
    };
    (used as f64) <= (1.0 - MANY) * rows && rows > 0.0 && needed.iter().all(filled)
}

/// A column of the logs without whose value a row is left out.
struct Needed {
    column: String,
    role: Option<String>,
}

/// The columns of the logs that have these names in the model, and that of the time.
fn raw_columns(spec: &Spec, names: &[String]) -> Vec<Needed> {
    let roles = spec.roles.all();
    let names = names.iter().map(String::as_str);
    let of = |name: &str| match roles.iter().find(|(role, _)| role == name) {
        Some((role, c)) => Needed {
            column: c.column.clone(),
            role: Some(role.clone()),
        },
        None => Needed {
            column: name.into(),
            role: None,
        },
    };
    std::iter::once("time").chain(names).map(of).collect()
}

/// Why there is no row: the columns that have no value at all, or values in different rows.
fn no_rows(tables: &[Table], needed: &[Needed]) -> Error {
    let has_some = |n: &Needed, table: &Table| {
        let values = table.column(&n.column).unwrap_or(&[]);
        values.iter().any(|x| x.is_finite())
    };
    let empty: Vec<String> = needed
        .iter()
        .filter(|n| !tables.iter().any(|t| has_some(n, t)))
        .map(|n| match &n.role {
            Some(role) => format!("`{}` ({role})", n.column),
            None => format!("`{}`", n.column),
        })
        .collect();
    let no_cells = tables.iter().all(|r| r.columns.iter().all(Vec::is_empty));
    let joined = tables.iter().any(|t| is_joined(t, needed, 0));
    let which = if empty.is_empty() || no_cells {
        String::new()
    } else {
        format!("; {} has none at all", empty.join(", "))
    };
    Error::data(
        format!("no row with finite values in every mapped column{which}"),
        if joined {
            JOINED
        } else {
            "Look at the columns named in [roles], or leave a role out that was not logged"
        },
    )
}

/// Columns of a log that the model names: those of roles, and what expressions and the hold-out
/// name.
pub(super) fn used_columns(spec: &Spec) -> Result<BTreeSet<String>, Error> {
    let mut used = named_columns(spec)?;
    used.extend(spec.roles.all().into_iter().map(|(_, c)| c.column.clone()));
    Ok(used)
}

/// The largest magnitude that a cell may have, by column that the model uses, in the unit of the
/// log: beyond it the value cannot be squared and summed.
pub(super) fn largest_cells(spec: &Spec) -> Result<BTreeMap<String, f64>, Error> {
    let roles = spec.roles.all();
    let limit = |column: &str| {
        let own = roles.iter().filter(|(_, c)| c.column == column);
        own.map(|(role, c)| largest(role) / c.scale.abs())
            .reduce(f64::min)
            .unwrap_or_else(|| largest(column))
    };
    let used = used_columns(spec)?.into_iter();
    Ok(used
        .map(|column| {
            let limit = limit(&column);
            (column, limit)
        })
        .collect())
}

/// What is wrong with a value that is too large, or nothing.
pub(super) fn too_large(value: f64, largest: f64) -> Option<String> {
    (value.is_finite() && value.abs() > largest)
        .then(|| format!("{value:e} is beyond {largest:e}, so it cannot be squared and summed"))
}

/// What expressions, the hold-out and the cut into sequences name.
fn named_columns(spec: &Spec) -> Result<BTreeSet<String>, Error> {
    let mut out = expression_names(spec)?;
    out.extend(spec.holdout.by.iter().cloned());
    out.extend(spec.input.sequence.iter().cloned());
    Ok(out)
}

/// Names in the expressions of the model.
pub(super) fn expression_names(spec: &Spec) -> Result<BTreeSet<String>, Error> {
    let mut out = BTreeSet::new();
    let terms = spec.terms.iter().map(|t| &t.expr);
    let filters = [&spec.rows.keep, &spec.rows.sequences];
    for text in terms.chain(filters).filter(|t| !t.is_empty()) {
        out.extend(Expr::parse(text)?.names());
        // The constant is no name to the parser.
        let is_name = |c: char| c.is_alphanumeric() || c == '_' || c == '.';
        if text.split(|c| !is_name(c)).any(|word| word == "pi") {
            out.insert("pi".into());
        }
    }
    Ok(out)
}

/// Columns to keep in memory: roles, and raw columns that an expression or the hold-out names.
fn needed_columns(spec: &Spec, tables: &[Table]) -> Result<Vec<String>, Error> {
    let mut names: Vec<String> = spec
        .roles
        .all()
        .into_iter()
        .map(|(n, _)| n)
        .filter(|n| n != "time")
        .collect();
    for n in named_columns(spec)? {
        if !names.contains(&n)
            && !["time", "elapsed", "file"].contains(&n.as_str())
            && tables.iter().all(|r| r.column(&n).is_some())
        {
            names.push(n);
        }
    }
    Ok(names)
}

/// Rows of each combination of the sequence columns, in order of appearance.
fn split_by(table: &Table, by: &[String]) -> Vec<Vec<usize>> {
    let n = table.columns.first().map_or(0, Vec::len);
    if by.is_empty() {
        return vec![(0..n).collect()];
    }
    let cols: Vec<&[f64]> = by.iter().filter_map(|b| table.column(b)).collect();
    let mut order = Vec::new();
    let mut groups: BTreeMap<Vec<u64>, Vec<usize>> = BTreeMap::new();
    for i in 0..n {
        let key: Vec<u64> = cols.iter().map(|c| c[i].to_bits()).collect();
        groups
            .entry(key.clone())
            .or_insert_with(|| {
                order.push(key);
                Vec::new()
            })
            .push(i);
    }
    order.iter().filter_map(|k| groups.remove(k)).collect()
}

/// Median steps beyond which a step of time is a gap, unless `hygiene.gap_s` says otherwise.
const GAP_STEPS: f64 = 20.0;

/// The step of time beyond which there is a gap, in s: `gap_s`, or if that is 0 the usual number of
/// median steps.
pub(super) fn longest_step(time: &[f64], gap_s: f64) -> f64 {
    if gap_s > 0.0 {
        return gap_s;
    }
    let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    residual_columns::stats::median(&mut steps).map_or(f64::INFINITY, |step| GAP_STEPS * step)
}

/// Pieces from which a log may be a map, held point by point.
const FEWEST_POINTS: usize = 5;

/// How many times farther it goes from point to point than at the points, where a log is a map.
const HELD: f64 = 10.0;

impl Rows<'_> {
    /// Cuts a run of rows into sequences at gaps in time; see [`longest_step`].
    fn cut_at_gaps(&mut self, run: Range<usize>, label: &str, log: &mut Findings) {
        let time = &self.time;
        if run.is_empty() {
            return;
        }
        let gap_s = self.spec.hygiene.gap_s;
        let limit = longest_step(&time[run.clone()], gap_s);
        let mut pieces = Vec::new();
        let mut start = run.start;
        for i in run.start + 1..run.end {
            if time[i] - time[i - 1] > limit {
                pieces.push(start..i);
                start = i;
            }
        }
        pieces.push(start..run.end);
        let gaps = pieces.len() - 1;
        // A map that is sampled point by point has steps of every size: to cut it would leave
        // nothing with a history.
        if gap_s == 0.0 && is_uneven(gaps, run.len()) {
            self.sequences.push(run);
            log.count(
                "uneven steps",
                gaps,
                label,
                "steps of time longer than 20 median steps, too many to be gaps: the log was not cut there; set hygiene.gap_s to cut it",
            );
        } else if gap_s == 0.0 && self.is_map(&pieces) {
            self.sequences.push(run);
            log.count(
                "held points",
                gaps,
                label,
                "gaps in time between points that are held still: the log was not cut there, and operators with memory go from \
                 point to point; set hygiene.gap_s, in s, to less than these gaps to cut it",
            );
        } else {
            self.sequences.extend(pieces);
            log.count(
                "gap",
                gaps,
                label,
                "gaps in time, longer than hygiene.gap_s (0: 20 median steps); operators with memory start again after each. \
                 Where one motion goes on over the gaps, as in a map taken point by point, set hygiene.gap_s, in s, to more \
                 than them",
            );
        }
    }

    /// Whether what has a position stands still in nearly all pieces and moves in the gaps between
    /// them. Without a position it is the command that tells; with a velocity alone nothing does.
    fn is_map(&self, pieces: &[Range<usize>]) -> bool {
        let roles = &self.spec.roles;
        let is_place = |n: &String| n == "angle" || roles.pose.contains_key(n);
        let has_place = self.names.iter().any(is_place);
        let is_driven = |n: &String| !has_place && roles.velocity.is_none() && n == "command";
        let (mut at_points, mut between) = (0.0, 0.0);
        for (_, x) in self
            .names
            .iter()
            .zip(&self.columns)
            .filter(|(n, _)| is_place(n) || is_driven(n))
        {
            let span = |r: &Range<usize>| {
                let (lo, hi) = residual_columns::stats::range(&x[r.clone()]);
                hi - lo
            };
            let all = span(&(pieces[0].start..pieces[pieces.len() - 1].end));
            if all > 0.0 {
                at_points += pieces.iter().map(span).sum::<f64>() / all;
                let jumps = pieces
                    .windows(2)
                    .map(|w| (x[w[1].start] - x[w[0].end - 1]).abs());
                between += jumps.sum::<f64>() / all;
            }
        }
        pieces.len() >= FEWEST_POINTS && between > HELD * at_points
    }
}

/// The frame without the sequences in which the expression is 0 on every row.
///
/// # Errors
/// [`Error::Data`] if nothing is left, [`Error::Expression`].
pub(super) fn keep_sequences(frame: &Frame, keep: &Expr) -> Result<Frame, Error> {
    let mask = keep.eval(frame)?;
    let kept: Vec<_> = frame
        .sequences()
        .iter()
        .filter(|r| mask[(*r).clone()].iter().any(|m| *m != 0.0))
        .cloned()
        .collect();
    if kept.is_empty() {
        return Err(Error::data(
            format!("rows.sequences = \"{keep}\" keeps nothing"),
            "Check the expression",
        ));
    }
    let gather = |c: &[f64]| {
        kept.iter()
            .flat_map(|r| c[r.clone()].iter().copied())
            .collect::<Vec<f64>>()
    };
    let columns = frame
        .names()
        .iter()
        .filter(|n| *n != "time" && *n != "elapsed")
        .map(|n| (n.clone(), gather(frame.column(n).unwrap_or(&[]))))
        .collect();
    let mut at = 0;
    let sequences = kept
        .iter()
        .map(|r| {
            at += r.len();
            at - r.len()..at
        })
        .collect();
    Ok(Frame::new(columns, gather(frame.time()), sequences))
}
