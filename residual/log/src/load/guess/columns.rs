//! Which column has which role: names first; of several joints the one that moves.

use super::compound;
use super::header;
use super::names::{self, Name, COUNTERS};
use super::Table;
use residual_columns::stats;
use std::cmp::Reverse;

/// A column of the log, with what its name says.
pub(super) struct Column<'a> {
    pub(super) title: &'a str,
    pub(super) values: &'a [f64],
    pub(super) name: Name,
    /// The role that its name stands for.
    pub(super) role: Option<&'static str>,
    /// Its unit as the file has it, where that is none of those understood; else an empty text.
    pub(super) stated: String,
    /// Standard deviation; 0 where nothing moves.
    pub(super) spread: f64,
}

impl Column<'_> {
    /// Adds what the second line of a header says: a unit, or words that stand for a role where the
    /// name has none.
    pub(super) fn describe(&mut self, second: &str) {
        let text = header::bare(second);
        let torque = compound::of_cell(text, &self.name.words).map(|scale| ("N·m", scale));
        if let Some((unit, scale)) = torque.or_else(|| names::known(text)) {
            (self.name.unit, self.name.scale) = (unit, scale);
            self.stated.clear();
        } else if header::is_symbol(text) {
            self.stated = text.to_string();
        } else if self.role.is_none() {
            let name = Name::of(text);
            if let Some(role) = name.role() {
                (self.role, self.name) = (Some(role), name);
            }
        }
    }
}

/// Every column of numbers. Names that were made up say nothing.
pub(super) fn columns(table: &Table, nameless: bool) -> Vec<Column<'_>> {
    table
        .names
        .iter()
        .zip(&table.columns)
        .map(|(title, values)| {
            let name = Name::of(if nameless { "" } else { title });
            let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
            let moves = finite.windows(2).any(|w| w[0] != w[1]);
            Column {
                title,
                values,
                role: name.role(),
                stated: name.stated.clone(),
                name,
                spread: if moves {
                    stats::deviation(&finite)
                } else {
                    0.0
                },
            }
        })
        .collect()
}

/// Columns with a role, by their place in the log, and what is to be asked about the choice.
#[derive(Default)]
pub(super) struct Chosen {
    roles: Vec<(&'static str, usize, Option<String>)>,
}

impl Chosen {
    pub(super) fn get(&self, role: &str) -> Option<usize> {
        self.roles.iter().find(|r| r.0 == role).map(|r| r.1)
    }

    /// What is to be asked about the choice for a role.
    pub(super) fn question(&self, role: &str) -> Option<&str> {
        let found = self.roles.iter().find(|r| r.0 == role)?;
        found.2.as_deref()
    }

    /// Takes a setpoint for the command where the log has no command: then it is what the machine
    /// was told. Not one of a motion, whose controller stands between.
    fn command_from_setpoint(&mut self, columns: &[Column], target: usize) {
        let unit = |i: usize| columns[i].name.unit;
        let quantity = |i: usize| {
            let words = &columns[i].name.words;
            words.iter().any(|w| columns[target].name.words.contains(w))
        };
        let has_command = self.get("command").is_some();
        let of_motion = |i: usize| {
            let name = &columns[i].name;
            let measured = ["angle", "velocity"].map(|role| self.get(role));
            let as_motion = measured.into_iter().flatten();
            matches!(name.without_setpoint().role(), Some("angle" | "velocity"))
                || (!name.unit.is_empty() && as_motion.into_iter().any(|m| unit(m) == name.unit))
        };
        let Some(at) = (self.roles.iter()).position(|r| r.0 == "setpoint" && !has_command) else {
            return;
        };
        let column = self.roles[at].1;
        if of_motion(column) {
            return;
        }
        let what = if quantity(column) {
            "of the quantity of the target"
        } else if unit(column) == unit(target) && !unit(target).is_empty() {
            "in the unit of the target"
        } else {
            "of something else than the target"
        };
        let question = format!("a setpoint {what}, taken for what was commanded");
        self.roles[at].0 = "command";
        self.roles[at].2 = Some(question);
    }

    /// Takes the current of a motor for the command where the log has none that changes.
    fn command_from_current(&mut self, columns: &[Column], target: usize, time: Option<usize>) {
        let command = self.get("command");
        if is_current(&columns[target]) || command.is_some_and(|c| !is_still(&columns[c])) {
            return;
        }
        let drives = |i: &usize| {
            let column = &columns[*i];
            is_current(column)
                && column.role == Some("target")
                && column.name.index == columns[target].name.index
                && !is_still(column)
                && Some(*i) != time
        };
        if let Some(current) = (0..columns.len()).find(drives) {
            self.roles.retain(|r| r.0 != "command");
            let question = "a current, taken for what drives".to_string();
            self.roles.push(("command", current, Some(question)));
        }
    }

    pub(super) fn has(&self, column: usize) -> bool {
        self.roles.iter().any(|r| r.1 == column)
    }
}

/// Chooses target, velocity, angle and what drives them, all of one joint where there are several.
/// `time` is taken already.
pub(super) fn choose(columns: &[Column], time: Option<usize>) -> Chosen {
    let mut chosen = Chosen::default();
    let Some((target, question)) = target(columns, time) else {
        return chosen;
    };
    chosen.roles.push(("target", target, question));
    let mut index = columns[target].name.index.clone();
    if index.is_empty() {
        index = moving_index(columns);
    }
    for role in ["command", "velocity", "angle", "temperature", "setpoint"] {
        if let Some((column, question)) = companion(columns, role, target, &index, time) {
            chosen.roles.push((role, column, question));
        }
    }
    let of_unit = |i: &usize| *i != target && is_temperature(&columns[*i]);
    if let Some(column) = free(columns, time).find(of_unit) {
        if chosen.get("temperature").is_none() {
            let question = Some("by its unit".to_string());
            chosen.roles.push(("temperature", column, question));
        }
    }
    chosen.command_from_setpoint(columns, target);
    chosen.command_from_current(columns, target, time);
    chosen
}

/// The columns whose names stand for a role.
fn of_role<'a>(
    columns: &'a [Column<'a>],
    role: &'a str,
    time: Option<usize>,
) -> impl Iterator<Item = usize> + 'a {
    (0..columns.len()).filter(move |i| Some(*i) != time && columns[*i].role == Some(role))
}

/// Of the columns, the one with the greatest spread; the first of equals.
fn moves_most(columns: &[Column], of: impl Iterator<Item = usize>) -> Option<usize> {
    of.max_by(|a, b| {
        let spread = |i: &usize| columns[*i].spread;
        spread(a).total_cmp(&spread(b)).then(b.cmp(a))
    })
}

/// Index of the joint that moves most; empty if no column shows it.
fn moving_index(columns: &[Column]) -> String {
    ["velocity", "angle"]
        .iter()
        .find_map(|role| moves_most(columns, of_role(columns, role, None)))
        .map_or(String::new(), |i| columns[i].name.index.clone())
}

/// What is asked about a target that is a length or an angle.
const COORDINATE: &str = "a coordinate, as no force is named: what is to be predicted";

/// Whether a column is a length or an angle by its unit: `y` in mm is no force.
fn is_coordinate(column: &Column) -> bool {
    ["mm", "m", "rad", "mrad", "deg", "rev"].contains(&column.name.unit)
}

/// A column that is a force or a torque by its unit only, the first that changes.
fn by_unit(columns: &[Column], time: Option<usize>) -> Option<(usize, &'static str)> {
    let is_force = |i: &usize| ["N", "N·m"].contains(&columns[*i].name.unit);
    let found = free(columns, time).filter(is_force);
    let first = found.min_by_key(|i| (columns[*i].spread == 0.0, *i))?;
    Some((first, "by its unit: what is to be predicted"))
}

/// The last column that changes of those without a role. A temperature is the last choice: it is
/// what acts on a machine.
fn without_role(columns: &[Column], time: Option<usize>) -> Option<(usize, &'static str)> {
    let key = |i: &usize| (columns[*i].spread > 0.0, !is_temperature(&columns[*i]), *i);
    let last = free(columns, time).max_by_key(key)?;
    Some((
        last,
        "the last column without a role: what is to be predicted",
    ))
}

/// The columns without a role that measure something.
fn free<'a>(columns: &'a [Column<'a>], time: Option<usize>) -> impl Iterator<Item = usize> + 'a {
    let is_free = move |i: &usize| {
        Some(*i) != time && columns[*i].role.is_none() && !is_counter(&columns[*i])
    };
    (0..columns.len()).filter(is_free)
}

/// Whether a column is a temperature by its unit. The `c` of `phase_c` is none.
fn is_temperature(column: &Column) -> bool {
    column.name.unit == "K" && !column.title.to_lowercase().ends_with("_c")
}

/// The column to predict, and the question about it.
fn target(columns: &[Column], time: Option<usize>) -> Option<(usize, Option<String>)> {
    let coordinate = |i: &usize| is_coordinate(&columns[*i]);
    let (coordinates, named): (Vec<usize>, Vec<usize>) =
        of_role(columns, "target", time).partition(coordinate);
    if named.is_empty() {
        return by_unit(columns, time)
            .or_else(|| coordinates.first().map(|i| (*i, COORDINATE)))
            .or_else(|| without_role(columns, time))
            .map(|(column, question)| (column, Some(question.to_string())));
    }
    let joints = |i: &usize| &columns[*i].name.index;
    let several = named.iter().any(|i| joints(i) != joints(&named[0]));
    let index = if several {
        moving_index(columns)
    } else {
        String::new()
    };
    // `force_n` says more than `f_v`, and that more than `y`, which may be any output.
    let is_letter = |i: &usize| columns[*i].name.words.iter().all(|w| w.len() == 1);
    let is_output = |i: &usize| columns[*i].name.words == ["y"];
    let key = |i: &usize| {
        let other = several && joints(i) != &index;
        let still = columns[*i].spread == 0.0;
        (
            other,
            still,
            is_current(&columns[*i]),
            is_letter(i),
            is_output(i),
        )
    };
    let best = named.iter().copied().min_by_key(|i| (key(i), *i))?;
    let found = joints(&best) == &index;
    let alike = others(columns, &named, best, |i| joints(&i) == joints(&best));
    let question = several.then(|| {
        let why = if found {
            "of the joint that moves most"
        } else {
            "the first of several"
        };
        format!("{why}: name another column for another joint")
    });
    // What is measured elsewhere, as a force beside the torques of joints.
    let elsewhere = others(columns, &named, best, |i| {
        joints(&i) != joints(&best) && joints(&i).is_empty()
    });
    let question = match (question, elsewhere) {
        (Some(question), Some(elsewhere)) => Some(format!("{question}; {elsewhere}")),
        (question, _) => question.or(alike),
    };
    Some((best, question))
}

/// Words of a current, in the languages of the names.
const CURRENTS: &[&str] = &[
    "current",
    "iq",
    "strom",
    "courant",
    "corrente",
    "corriente",
    "電流",
    "电流",
];

/// Whether a column is the current of a motor: beside a force it is what drives.
fn is_current(column: &Column) -> bool {
    let has = |w: &String| CURRENTS.contains(&w.as_str());
    column.name.unit == "A" || column.name.words.iter().any(has)
}

/// Whether a column counts rows or messages, or is a part of a stamp: nothing to predict.
fn is_counter(column: &Column) -> bool {
    let words = &column.name.words;
    let has = |all: &[&str]| words.iter().any(|w| all.contains(&w.as_str()));
    has(COUNTERS) || has(&["nsec", "nsecs", "nanosec", "secs", "stamp"])
}

/// Columns that are named in a question.
const NAMED: usize = 4;

/// The question which of several columns it is.
fn others(
    columns: &[Column],
    all: &[usize],
    best: usize,
    of: impl Fn(usize) -> bool,
) -> Option<String> {
    let other = all.iter().filter(|i| **i != best && of(**i));
    let names: Vec<String> = other
        .map(|i| format!("\"{}\"", columns[*i].title))
        .collect();
    let more = if names.len() > NAMED { " ..." } else { "" };
    (!names.is_empty()).then(|| {
        format!(
            "or is it {}{more}",
            names[..names.len().min(NAMED)].join(", ")
        )
    })
}

/// Spread of a column as a share of its mean up to which it is a supply and no command.
/// Raised from 0.01 for supplies that sag.
const SUPPLY: f64 = 0.05;

/// Whether a column stands still but for its noise.
fn is_still(column: &Column) -> bool {
    let finite: Vec<f64> = column
        .values
        .iter()
        .copied()
        .filter(|v| v.is_finite())
        .collect();
    column.spread <= SUPPLY * stats::mean(&finite).abs()
}

/// The column of a role that belongs to the target, and the question about it.
fn companion(
    columns: &[Column],
    role: &str,
    target: usize,
    index: &str,
    time: Option<usize>,
) -> Option<(usize, Option<String>)> {
    let of = |i: &usize| columns[*i].name.index.as_str();
    let all: Vec<usize> = of_role(columns, role, time)
        .filter(|i| *i != target)
        .collect();
    let own = all
        .iter()
        .copied()
        .filter(|i| of(i) == index || of(i).is_empty());
    let shares = |i: &usize| {
        let words = &columns[target].name.words;
        columns[*i].name.words.iter().any(|w| words.contains(w))
    };
    // A voltage may be a supply; a command is one by its name.
    let is_command = |i: &usize| {
        let words = &columns[*i].name.words;
        role == "command"
            && words
                .iter()
                .any(|w| ["command", "cmd", "commanded"].contains(&w.as_str()))
    };
    let still = |i: &usize| match role {
        "command" => is_still(&columns[*i]),
        _ => columns[*i].spread == 0.0,
    };
    let own: Vec<usize> = own.collect();
    let best = own.iter().copied().min_by_key(|i| {
        let other = of(i) != index;
        (other, still(i), !is_command(i), Reverse(shares(i)), *i)
    });
    if let Some(best) = best {
        let question = match role {
            "command" if is_still(&columns[best]) => {
                Some("it does not change: is it the command".to_string())
            }
            "command" => others(columns, &own, best, |i| !is_still(&columns[i])),
            _ => None,
        };
        return Some((best, question));
    }
    // A command or a temperature of another joint says nothing about this one.
    if !["velocity", "angle"].contains(&role) {
        return None;
    }
    let best = moves_most(columns, all.into_iter())?;
    let question = (!index.is_empty() || !of(&best).is_empty()).then(|| {
        "of the columns of this kind it moves most: is it of the joint of the target".to_string()
    });
    Some((best, question))
}
