//! Logs in JSON, as the CSV text that they stand for, so that one reader takes times, units and
//! missing values of both. An object is a row: one a line, or all in one list. Columns as lists,
//! `{"t": [..], "y": [..]}`, and what pandas writes (`{"columns": .., "data": ..}` and
//! `{"t": {"0": ..}, ..}`) are turned. `a.b` is the value `b` in the object `a`, `a[0]` the first
//! of a list.
//!
//! The header is a line more than the file has: an object that stands alone on line 5 is told of as
//! line 6.

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use std::collections::HashMap;
use std::fmt::Write as _;

/// Whether a text begins as JSON does.
pub(super) fn is_json(head: &[u8]) -> bool {
    let mut bytes = head.iter().filter(|b| !b.is_ascii_whitespace());
    match (bytes.next(), bytes.next()) {
        (Some(b'{'), Some(b'"' | b'}')) | (Some(b'['), Some(b'{' | b'[')) => true,
        (Some(b'['), Some(b'-' | b'0'..=b'9')) => begins_with_a_list(head),
        _ => false,
    }
}

/// Whether the first line is a list of numbers, or the beginning of one. Other logs have a number
/// in brackets before their values: a level, a channel, the time of a console.
fn begins_with_a_list(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut lines = text.trim_start().lines();
    let first = lines.next().unwrap_or("").trim().trim_end_matches(',');
    match first.find(']') {
        Some(end) => end + 1 == first.len() && first.contains(','),
        None => first
            .chars()
            .all(|c| c.is_ascii_digit() || "[,.+-eE \t".contains(c)),
    }
}

/// A value, with the names of an object in the order of the file.
#[derive(Debug, Clone, PartialEq)]
enum Item {
    /// A cell; empty for `null`.
    Cell(String),
    List(Vec<Item>),
    Object(Vec<(String, Item)>),
}

impl<'de> Deserialize<'de> for Item {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Item, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = Item;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a value")
            }
            fn visit_unit<E>(self) -> Result<Item, E> {
                Ok(Item::Cell(String::new()))
            }
            fn visit_bool<E>(self, x: bool) -> Result<Item, E> {
                Ok(Item::Cell(x.to_string()))
            }
            fn visit_u64<E>(self, x: u64) -> Result<Item, E> {
                Ok(Item::Cell(x.to_string()))
            }
            fn visit_i64<E>(self, x: i64) -> Result<Item, E> {
                Ok(Item::Cell(x.to_string()))
            }
            fn visit_f64<E>(self, x: f64) -> Result<Item, E> {
                Ok(Item::Cell(x.to_string()))
            }
            fn visit_str<E>(self, x: &str) -> Result<Item, E> {
                Ok(Item::Cell(x.to_string()))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut from: A) -> Result<Item, A::Error> {
                let mut list = Vec::new();
                while let Some(item) = from.next_element()? {
                    list.push(item);
                }
                Ok(Item::List(list))
            }
            fn visit_map<A: MapAccess<'de>>(self, mut from: A) -> Result<Item, A::Error> {
                let mut object = Vec::new();
                while let Some(entry) = from.next_entry()? {
                    object.push(entry);
                }
                Ok(Item::Object(object))
            }
        }
        from.deserialize_any(Any)
    }
}

impl Item {
    /// The values of a list or an object, in order; `None` for a cell.
    fn values(&self) -> Option<Vec<&Item>> {
        match self {
            Item::Cell(_) => None,
            Item::List(all) => Some(all.iter().collect()),
            Item::Object(all) => Some(all.iter().map(|(_, item)| item).collect()),
        }
    }

    /// Every cell with its name, of so many levels as there are.
    fn flatten(&self, name: &str, found: &mut Vec<(String, String)>) {
        match self {
            Item::Cell(cell) => found.push((name.to_string(), cell.clone())),
            Item::List(all) => {
                for (i, item) in all.iter().enumerate() {
                    let name = match name {
                        "" => format!("column_{}", i + 1),
                        _ => format!("{name}[{i}]"),
                    };
                    item.flatten(&name, found);
                }
            }
            Item::Object(all) => {
                for (key, item) in all {
                    let name = match name {
                        "" => key.clone(),
                        _ => format!("{name}.{key}"),
                    };
                    item.flatten(&name, found);
                }
            }
        }
    }

    fn entry(&self, name: &str) -> Option<&Item> {
        match self {
            Item::Object(all) => all.iter().find(|(key, _)| key == name).map(|(_, i)| i),
            _ => None,
        }
    }
}

/// One line of the text.
enum Line {
    Row(Item),
    /// What is no JSON, as it stands there.
    Other(String),
}

/// The CSV text that a log in JSON stands for.
///
/// # Errors
/// In words, with the line: the text is no JSON, or has no rows.
pub(super) fn as_csv(bytes: &[u8]) -> Result<String, String> {
    let text = String::from_utf8_lossy(bytes);
    let text = with_nulls(text.trim_start_matches('\u{feff}'));
    let lines = match serde_json::from_str::<Item>(&text) {
        Ok(whole) => rows_of(whole)?.into_iter().map(Line::Row).collect(),
        Err(why) => {
            let lines = lines(&text);
            let rows = lines.iter().filter(|l| matches!(l, Line::Row(_))).count();
            if 2 * rows <= lines.len() {
                return Err(format!(
                    "it begins as JSON and is none ({why}); write one object a line, a list of objects, or CSV"
                ));
            }
            lines
        }
    };
    csv(&lines)
}

/// The rows of one value that is the whole log.
fn rows_of(whole: Item) -> Result<Vec<Item>, String> {
    let is_cell = |item: &&Item| matches!(item, Item::Cell(_));
    if let Item::List(rows) = whole {
        return Ok(if rows.iter().all(|row| is_cell(&row)) {
            vec![Item::List(rows)]
        } else {
            rows
        });
    }
    if let (Some(Item::List(names)), Some(Item::List(rows))) =
        (whole.entry("columns"), whole.entry("data"))
    {
        let of_row = |row: &Item| {
            let named = names.iter().zip(row.values()?).filter_map(|(name, item)| {
                let Item::Cell(name) = name else { return None };
                Some((name.clone(), item.clone()))
            });
            Some(Item::Object(named.collect()))
        };
        return Ok(rows.iter().filter_map(of_row).collect());
    }
    let Item::Object(entries) = whole else {
        return Err("it is one value; a log has rows".into());
    };
    let columns: Vec<Vec<&Item>> = entries.iter().filter_map(|(_, i)| i.values()).collect();
    let length = columns.first().map_or(0, Vec::len);
    let are_columns = columns.len() == entries.len()
        && length > 1
        && columns
            .iter()
            .all(|c| c.len() == length && c.iter().all(is_cell));
    if are_columns {
        let row = |i: usize| {
            let cells = entries.iter().zip(&columns);
            Item::Object(cells.map(|((n, _), c)| (n.clone(), c[i].clone())).collect())
        };
        return Ok((0..length).map(row).collect());
    }
    // Something about the log, and its rows under a name.
    let is_rows = |item: &Item| matches!(item, Item::List(all) if all.iter().all(|i| matches!(i, Item::Object(_))));
    let (mut lists, rest): (Vec<_>, Vec<_>) =
        entries.into_iter().partition(|(_, item)| is_rows(item));
    if let [(a, _), (b, _), ..] = &lists[..] {
        return Err(format!(
            "it has several lists of objects, `{a}` and `{b}` among them; write each to a file of its own"
        ));
    }
    Ok(match lists.pop() {
        Some((_, Item::List(rows))) => rows,
        _ => vec![Item::Object(rest)],
    })
}

/// One object a line; empty lines are left out.
fn lines(text: &str) -> Vec<Line> {
    let of = |line: &str| match serde_json::from_str(line) {
        Ok(item @ (Item::Object(_) | Item::List(_))) => Line::Row(item),
        _ => Line::Other(line.to_string()),
    };
    text.lines()
        .filter(|l| !l.trim().is_empty())
        .map(of)
        .collect()
}

fn csv(lines: &[Line]) -> Result<String, String> {
    let (mut names, mut places) = (Vec::new(), HashMap::new());
    let cells = |item: &Item| {
        let mut found = Vec::new();
        item.flatten("", &mut found);
        found
    };
    let rows = || {
        lines.iter().filter_map(|line| match line {
            Line::Row(item) => Some(item),
            Line::Other(_) => None,
        })
    };
    for (name, _) in rows().flat_map(cells) {
        if !places.contains_key(&name) {
            places.insert(name.clone(), names.len());
            names.push(name);
        }
    }
    if names.is_empty() {
        return Err("it is JSON without a value; give another log".into());
    }
    let mut text = String::new();
    write_row(&mut text, &names);
    for line in lines {
        match line {
            Line::Row(item) => {
                let mut row = vec![String::new(); names.len()];
                for (name, cell) in cells(item) {
                    row[places[&name]] = cell;
                }
                write_row(&mut text, &row);
            }
            Line::Other(other) => {
                text.push_str(other);
                text.push('\n');
            }
        }
    }
    Ok(text)
}

fn write_row(text: &mut String, cells: &[String]) {
    for (i, cell) in cells.iter().enumerate() {
        if i > 0 {
            text.push(',');
        }
        let cell = cell.replace(['\n', '\r'], " ");
        if cell.contains([',', '"', '#', '%']) {
            // Writing to a string cannot fail.
            let _ = write!(text, "\"{}\"", cell.replace('"', "\"\""));
        } else {
            text.push_str(&cell);
        }
    }
    text.push('\n');
}

/// A text with `null` for the numbers that JSON has not and Python writes: `NaN`, `Infinity`.
fn with_nulls(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let (mut inside, mut escaped, mut rest) = (false, false, text);
    while let Some(c) = rest.chars().next() {
        let number = ["NaN", "-Infinity", "Infinity"]
            .iter()
            .find(|word| !inside && rest.starts_with(**word));
        if let Some(word) = number {
            out.push_str("null");
            rest = &rest[word.len()..];
            continue;
        }
        match c {
            '"' if !escaped => inside = !inside,
            // A line that was cut off within a string.
            '\n' => inside = false,
            _ => {}
        }
        escaped = c == '\\' && !escaped;
        out.push(c);
        rest = &rest[c.len_utf8()..];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shape_becomes_the_same_table() {
        let table = "t,y\n0,1.5\n1,\n2,-3\n";
        for text in [
            "{\"t\": 0, \"y\": 1.5}\n{\"t\": 1, \"y\": null}\n\n{\"t\": 2, \"y\": -3}\n",
            "{\"t\": 0, \"y\": 1.5}\n{\"t\": 1}\n{\"y\": -3, \"t\": 2}",
            "[{\"t\": 0, \"y\": 1.5},\n {\"t\": 1, \"y\": NaN},\n {\"t\": 2, \"y\": -3}]",
            "{\"t\": [0, 1, 2], \"y\": [1.5, NaN, -3]}",
            "{\"t\":{\"0\":0,\"1\":1,\"2\":2},\"y\":{\"0\":1.5,\"1\":null,\"2\":-3}}",
            "{\"columns\":[\"t\",\"y\"],\"index\":[0,1,2],\"data\":[[0,1.5],[1,null],[2,-3]]}",
            "\u{feff}{\"rig\": \"a\", \"rows\": [{\"t\": 0, \"y\": 1.5}, {\"t\": 1}, {\"t\": 2, \"y\": -3}]}",
        ] {
            assert_eq!(as_csv(text.as_bytes()).as_deref(), Ok(table), "{text}");
        }
    }

    #[test]
    fn what_lies_deeper_has_the_names_of_its_way() {
        let text =
            "{\"h\": {\"stamp\": 5}, \"q\": [1, 2], \"note\": \"a, \\\"b\\\" NaN\", \"on\": true}";
        assert_eq!(
            as_csv(text.as_bytes()).unwrap(),
            "h.stamp,q[0],q[1],note,on\n5,1,2,\"a, \"\"b\"\" NaN\",true\n"
        );
        // A list of lists, and lists of Python a line.
        assert_eq!(as_csv(b"[1, 2]").unwrap(), "column_1,column_2\n1,2\n");
        for text in ["[[1, 2], [3, 4]]", "[1, 2]\n[3, 4]\n"] {
            assert!(is_json(text.as_bytes()), "{text}");
            assert_eq!(
                as_csv(text.as_bytes()).unwrap(),
                "column_1,column_2\n1,2\n3,4\n"
            );
        }
    }

    #[test]
    fn a_number_in_brackets_is_no_json() {
        for text in [
            "[1]\n0.1 2.5\n0.2 2.6\n",
            "[0.125] 2.5, 3.5\n[0.250] 2.6, 3.4\n",
            "[2024-05-01 10:00:00] 2.5\n",
            "[12:30:01",
            "[1 warm start",
        ] {
            assert!(!is_json(text.as_bytes()), "{text}");
        }
        for text in [
            "[\n  1,\n  2\n]",
            "[1, 2],\n[3, 4]",
            "[-1.5, 2e3, 7",
            " [1,2]",
        ] {
            assert!(is_json(text.as_bytes()), "{text}");
        }
    }

    /// A log whose writer was killed, and one with messages between the rows.
    #[test]
    fn lines_that_are_no_json_stay_for_the_reader_of_text() {
        let text = "{\"t\": 0}\n{\"t\": 1}\nready\n{\"t\": 2}\n{\"t\": 3, \"no";
        assert_eq!(
            as_csv(text.as_bytes()).unwrap(),
            "t\n0\n1\nready\n2\n{\"t\": 3, \"no\n"
        );
    }

    #[test]
    fn what_has_no_rows_is_refused() {
        for (text, part) in [
            ("{\"t\": 0\n,,", "is none"),
            ("{}", "without a value"),
            ("[[]]", "without a value"),
            ("{\"a\": [{\"t\": 1}], \"b\": [{\"t\": 2}]}", "`a` and `b`"),
        ] {
            let why = as_csv(text.as_bytes()).unwrap_err();
            assert!(why.contains(part), "{text}: {why}");
        }
    }

    #[test]
    fn damage_is_no_panic() {
        let text = "{\"t\": 0, \"é\": [1, {\"x\": NaN}]}\n{\"t\": 1, \"é\": [2, {\"x\": \"a\"}]}\n";
        for end in 0..text.len() {
            let _ = as_csv(&text.as_bytes()[..end]);
        }
        for at in 0..text.len() {
            let mut bytes = text.as_bytes().to_vec();
            for b in [b'"', b'{', b']', b'\\', 0xC3] {
                bytes[at] = b;
                let _ = as_csv(&bytes);
            }
        }
    }
}
