//! A section of a rig file being read: values with their types and ranges, and problems with their
//! lines.

use crate::Problem;
use nalgebra::Vector3;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ops::{Range, RangeInclusive};
use toml::de::{DeTable, DeValue};

/// Text and the problems found so far.
pub(super) struct Context<'t> {
    pub(super) text: &'t str,
    pub(super) problems: RefCell<Vec<Problem>>,
}

impl Context<'_> {
    fn line_of(&self, offset: usize) -> usize {
        let end = offset.min(self.text.len());
        1 + self.text.as_bytes()[..end]
            .iter()
            .filter(|byte| **byte == b'\n')
            .count()
    }

    pub(super) fn report(
        &self,
        offset: usize,
        unit: Option<u8>,
        key: &str,
        message: impl Into<String>,
    ) {
        let problem = Problem {
            line: self.line_of(offset),
            unit,
            key: key.to_owned(),
            message: message.into(),
        };
        let mut problems = self.problems.borrow_mut();
        // A value of [defaults] is read once for each unit; its mistake is one.
        let same = problems.iter_mut().find(|known| {
            (known.line, &known.key, &known.message)
                == (problem.line, &problem.key, &problem.message)
        });
        match same {
            Some(known) if known.unit != problem.unit => known.unit = None,
            Some(_) => {}
            None => problems.push(problem),
        }
    }
}

/// Where a value stands and what it is; a stand-in where it was wrong and reported.
#[derive(Clone, Copy)]
pub(super) struct Found<T> {
    pub(super) value: T,
    /// Offset in the text, bytes.
    pub(super) at: usize,
    /// Whether the value is the file's own.
    pub(super) good: bool,
}

/// A table being read. Keys that no reader looked up are unknown.
pub(super) struct Section<'c, 't> {
    pub(super) context: &'c Context<'t>,
    pub(super) name: String,
    pub(super) unit: Option<u8>,
    pub(super) at: usize,
    pub(super) table: Option<&'c DeTable<'t>>,
    pub(super) fallback: Option<&'c DeTable<'t>>,
    pub(super) known: RefCell<BTreeSet<String>>,
}

type Value<'c, 't> = (&'c DeValue<'t>, Range<usize>);

fn look_up<'c, 't>(table: &'c DeTable<'t>, key: &str) -> Option<Value<'c, 't>> {
    table
        .iter()
        .find(|(name, _)| name.get_ref() == key)
        .map(|(_, value)| (value.get_ref(), value.span()))
}

impl<'c, 't> Section<'c, 't> {
    pub(super) fn report(&self, at: usize, key: &str, message: impl Into<String>) {
        self.context.report(at, self.unit, key, message);
    }

    pub(super) fn get(&self, key: &str) -> Option<Value<'c, 't>> {
        self.known.borrow_mut().insert(key.to_owned());
        self.table
            .and_then(|table| look_up(table, key))
            .or_else(|| self.fallback.and_then(|table| look_up(table, key)))
    }

    fn missing(&self, key: &str, example: &str) {
        let place = if self.fallback.is_some() {
            format!("to this [[{}]] or to [defaults]", self.name)
        } else if self.name.is_empty() {
            "at the top of the file".to_owned()
        } else {
            format!("to [{}]", self.name)
        };
        self.report(
            self.at,
            key,
            format!("is missing; add `{key} = {example}` {place}"),
        );
    }

    /// A number within a range, both ends included.
    pub(super) fn number(
        &self,
        key: &str,
        range: RangeInclusive<f64>,
        example: &str,
    ) -> Found<f64> {
        let bad = |at| Found {
            value: *range.start(),
            at,
            good: false,
        };
        let Some((value, span)) = self.get(key) else {
            self.missing(key, example);
            return bad(self.at);
        };
        let Some(number) = as_number(value) else {
            self.report(
                span.start,
                key,
                format!(
                    "is {}, a number is needed, as in `{key} = {example}`",
                    value.type_str()
                ),
            );
            return bad(span.start);
        };
        if !number.is_finite() {
            self.report(
                span.start,
                key,
                format!("is {number}; a finite number is needed, as in `{key} = {example}`"),
            );
            return bad(span.start);
        }
        if !range.contains(&number) {
            self.report(
                span.start,
                key,
                format!(
                    "is {number}, allowed is {} to {}; check value and unit (as in `{key} = {example}`)",
                    range.start(),
                    range.end()
                ),
            );
            return bad(span.start);
        }
        Found {
            value: number,
            at: span.start,
            good: true,
        }
    }

    /// A number within a range, or `default` where the key is not there.
    pub(super) fn optional(
        &self,
        key: &str,
        range: RangeInclusive<f64>,
        default: f64,
    ) -> Found<f64> {
        if self.get(key).is_some() {
            let example = if range.contains(&default) {
                format!("{default}")
            } else {
                format!("{}", range.start())
            };
            return self.number(key, range, &example);
        }
        Found {
            value: default,
            at: self.at,
            good: true,
        }
    }

    pub(super) fn flag(&self, key: &str, default: Option<bool>) -> bool {
        match (self.get(key), default) {
            (None, Some(default)) => default,
            (None, None) => {
                self.missing(key, "true");
                false
            }
            (Some((value, span)), _) => value.as_bool().unwrap_or_else(|| {
                self.report(
                    span.start,
                    key,
                    format!("is {}, write true or false", value.type_str()),
                );
                false
            }),
        }
    }

    pub(super) fn text(&self, key: &str, example: &str) -> Found<String> {
        let bad = |at| Found {
            value: String::new(),
            at,
            good: false,
        };
        match self.get(key) {
            None => {
                self.missing(key, &format!("\"{example}\""));
                bad(self.at)
            }
            Some((value, span)) => match value.as_str() {
                Some(text) => Found {
                    value: text.to_owned(),
                    at: span.start,
                    good: true,
                },
                None => {
                    self.report(
                        span.start,
                        key,
                        format!(
                            "is {}, write text in quotes, as in \"{example}\"",
                            value.type_str()
                        ),
                    );
                    bad(span.start)
                }
            },
        }
    }

    /// Three finite numbers.
    pub(super) fn vector(&self, key: &str, largest: f64, example: &str) -> Found<Vector3<f64>> {
        let Some((value, span)) = self.get(key) else {
            self.missing(key, example);
            return Found {
                value: Vector3::zeros(),
                at: self.at,
                good: false,
            };
        };
        let at = span.start;
        let numbers: Option<Vec<f64>> = value
            .as_array()
            .and_then(|array| array.iter().map(|v| as_number(v.get_ref())).collect());
        let mut found = Found {
            value: Vector3::zeros(),
            at,
            good: false,
        };
        match numbers.as_deref() {
            Some(&[x, y, z]) => {
                if [x, y, z]
                    .iter()
                    .all(|v| v.is_finite() && v.abs() <= largest)
                {
                    found.value = Vector3::new(x, y, z);
                    found.good = true;
                } else {
                    self.report(
                        at,
                        key,
                        format!("is [{x}, {y}, {z}]; each has to be finite and within +-{largest}; check the unit"),
                    );
                }
            }
            Some(other) => {
                self.report(
                    at,
                    key,
                    format!(
                        "has {} numbers, three are needed, as in `{key} = {example}`",
                        other.len()
                    ),
                );
            }
            None => self.report(
                at,
                key,
                format!("has to be three numbers, as in `{key} = {example}`"),
            ),
        }
        found
    }

    /// A section inside this one.
    pub(super) fn section(&self, key: &str) -> Section<'c, 't> {
        let (table, at) = match self.get(key) {
            None => {
                self.report(self.at, key, format!("is missing; add a [{key}] section (the built-in rig file shows all keys: `forcectl check --print`)"));
                (None, self.at)
            }
            Some((value, span)) => match value.as_table() {
                Some(table) => (Some(table), span.start),
                None => {
                    self.report(
                        span.start,
                        key,
                        format!("is {}, a [{key}] section is needed", value.type_str()),
                    );
                    (None, span.start)
                }
            },
        };
        Section {
            context: self.context,
            name: key.to_owned(),
            unit: None,
            at,
            table,
            fallback: None,
            known: RefCell::default(),
        }
    }

    /// Reports keys that no reader looked up.
    pub(super) fn finish(&self) {
        let known = self.known.borrow();
        for (name, _) in self.table.into_iter().flat_map(|table| table.iter()) {
            let key = name.get_ref();
            if !known.contains(key.as_ref()) {
                let near = known
                    .iter()
                    .map(|name| (strsim::levenshtein(name, key), name))
                    .min()
                    .filter(|(d, _)| *d <= 3);
                let hint = match near {
                    Some((_, name)) => format!("did you mean `{name}`?"),
                    None => format!(
                        "known here: {}",
                        known.iter().cloned().collect::<Vec<_>>().join(", ")
                    ),
                };
                self.report(name.span().start, key, format!("unknown key; {hint}"));
            }
        }
    }
}

fn as_number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(n) if n.radix() == 10 => n.as_str().parse().ok(),
        DeValue::Float(x) => x.as_str().parse().ok(),
        _ => None,
    }
}
