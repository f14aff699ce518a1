//! New settings in the text of a rig file, with its comments and layout kept.
//!
//! The text is edited as a TOML document and then read again as a rig file: anything but the
//! intended change is an error.

use super::KEYS;
use known::base::overlay;
use rig::{Rig, UnitSettings};
use toml_edit::{DocumentMut, Item, TableLike, Value};
use wire::UNITS;

/// A rig file's text and its changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Rewritten {
    /// The text.
    pub text: String,
    /// Each change in a line, as in `units 1, 2: coulomb_n 0.909 -> 1.3`.
    pub changed: Vec<String>,
}

/// Puts new settings into the text of a rig file. A value that all units have from `[defaults]` is
/// changed there, one of a single unit in that unit's table.
///
/// # Errors
/// The text is not the rig's, or an edit changes something else as well; the message lists the
/// changes to make by hand.
pub fn rewrite(
    name: &str,
    text: &str,
    rig: &Rig,
    units: &[UnitSettings; UNITS],
) -> Result<Rewritten, String> {
    let changed = changes(rig, units);
    if changed.is_empty() {
        return Ok(Rewritten {
            text: text.to_owned(),
            changed,
        });
    }
    let failed = |why: &dyn std::fmt::Display| {
        format!(
            "{name} can't be edited ({why}); make these changes by hand: {}",
            changed.join("; ")
        )
    };
    let mut document: DocumentMut = text.parse().map_err(|error| failed(&error))?;
    for key in &KEYS {
        let old = rig.units.each_ref().map(key.get);
        let new = units.each_ref().map(key.get);
        if old != new {
            set_key(&mut document, key.name, &old, &new).map_err(|why| failed(&why))?;
        }
    }
    let before = text;
    let text = with_line_ends_of(before, document.to_string());
    let parsed = Rig::parse(name, &text).map_err(|error| failed(&error))?;
    // The numbers in use may be those of a stored calibration, which the file has not.
    let mut intended = Rig::parse(name, before).map_err(|error| failed(&error))?;
    let in_use = match &rig.calibration {
        Some(record) => overlay(&intended, record),
        None => intended.clone(),
    };
    if in_use != *rig {
        return Err(failed(&"it is not the file of this rig"));
    }
    for (unit, new) in intended.units.iter_mut().zip(units) {
        for key in &KEYS {
            (key.set)(unit, (key.get)(new));
        }
    }
    if parsed != intended {
        return Err(failed(
            &"reading it again gives other settings than intended",
        ));
    }
    Ok(Rewritten { text, changed })
}

/// What differs between a rig's settings and new ones, equal changes of several units in one line.
fn changes(rig: &Rig, units: &[UnitSettings; UNITS]) -> Vec<String> {
    let mut changed = Vec::new();
    for key in &KEYS {
        let mut groups: Vec<(String, Vec<String>)> = Vec::new();
        for (i, (old, new)) in rig.units.iter().zip(units).enumerate() {
            let (old, new) = ((key.get)(old), (key.get)(new));
            if old == new {
                continue;
            }
            let what = format!("{} {old:?} -> {new:?}", key.name);
            let number = (i + 1).to_string();
            match groups.iter_mut().find(|(w, _)| *w == what) {
                Some((_, numbers)) => numbers.push(number),
                None => groups.push((what, vec![number])),
            }
        }
        changed.extend(groups.into_iter().map(|(what, numbers)| {
            let s = if numbers.len() > 1 { "s" } else { "" };
            format!("unit{s} {}: {what}", numbers.join(", "))
        }));
    }
    changed
}

/// Sets a key of the units in their own tables where they have it, and in `[defaults]` where all
/// the others agree.
fn set_key(
    document: &mut DocumentMut,
    key: &str,
    old: &[f64; UNITS],
    new: &[f64; UNITS],
) -> Result<(), String> {
    let mut own = [false; UNITS];
    for_each_unit(document, |i, table| {
        own[i] = table.contains_key(key);
        if own[i] && old[i] != new[i] {
            set_value(table, key, new[i]);
        }
    })?;
    let shared: Vec<usize> = (0..UNITS).filter(|i| !own[*i]).collect();
    let Some(&first) = shared.first() else {
        return Ok(());
    };
    if shared.iter().any(|i| new[*i] != new[first]) {
        return for_each_unit(document, |i, table| {
            if !own[i] && old[i] != new[i] {
                set_value(table, key, new[i]);
            }
        });
    }
    if old[first] != new[first] {
        let defaults = document
            .get_mut("defaults")
            .and_then(Item::as_table_like_mut)
            .ok_or("it has no [defaults]")?;
        set_value(defaults, key, new[first]);
    }
    Ok(())
}

/// Calls `change` with each unit's index (from 0) and table, in the file's order.
fn for_each_unit(
    document: &mut DocumentMut,
    mut change: impl FnMut(usize, &mut dyn TableLike),
) -> Result<(), String> {
    let tables: Vec<&mut dyn TableLike> = match document.get_mut("unit") {
        Some(Item::ArrayOfTables(tables)) => {
            tables.iter_mut().map(|t| t as &mut dyn TableLike).collect()
        }
        Some(Item::Value(Value::Array(tables))) => tables
            .iter_mut()
            .filter_map(Value::as_inline_table_mut)
            .map(|t| t as &mut dyn TableLike)
            .collect(),
        _ => return Err("it has no list of units".to_owned()),
    };
    for table in tables {
        let number = table.get("number").and_then(|number| {
            let number = number
                .as_float()
                .or_else(|| number.as_integer().map(|n| n as f64))?;
            (1..=UNITS).find(|n| *n as f64 == number)
        });
        match number {
            Some(number) => change(number - 1, table),
            None => return Err(format!("a unit has no number from 1 to {UNITS}")),
        }
    }
    Ok(())
}

/// Sets a key's value. A value that is there keeps its place and the comment behind it; a new one
/// goes last.
fn set_value(table: &mut dyn TableLike, key: &str, value: f64) {
    let mut value = Value::from(value);
    if let Some(Item::Value(old)) = table.get_mut(key) {
        *value.decor_mut() = old.decor().clone();
        *old = value;
        return;
    }
    // The space before the brace of an inline table belongs to its last value.
    if let Some(Item::Value(last)) = table.iter_mut().last().map(|(_, item)| item) {
        let suffix = last.decor().suffix().and_then(|suffix| suffix.as_str());
        if suffix.is_some_and(|suffix| !suffix.is_empty() && suffix.trim().is_empty()) {
            value = value.decorated(" ", suffix.unwrap_or_default());
            last.decor_mut().set_suffix("");
        }
    }
    table.insert(key, Item::Value(value));
}

/// The text with the line ends of the original, which editing turns to line feeds.
fn with_line_ends_of(original: &str, text: String) -> String {
    if original.contains("\r\n") {
        text.replace("\r\n", "\n").replace('\n', "\r\n")
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::{RippleSettings, DEFAULT_TEXT};

    /// The lines of `b` that `a` doesn't have, each once per surplus.
    fn added<'t>(a: &str, b: &'t str) -> Vec<&'t str> {
        let mut left: Vec<&str> = a.lines().collect();
        b.lines()
            .filter(|line| match left.iter().position(|l| l == line) {
                Some(i) => {
                    left.remove(i);
                    false
                }
                None => true,
            })
            .collect()
    }

    /// Rewrites with `change` on all units; the text must read back as intended.
    fn rewritten(text: &str, change: impl Fn(usize, &mut UnitSettings)) -> Rewritten {
        let rig = Rig::parse("rig", text).unwrap_or_else(|error| panic!("{error}"));
        let mut units = rig.units;
        for (i, unit) in units.iter_mut().enumerate() {
            change(i, unit);
        }
        let new = rewrite("rig", text, &rig, &units).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(Rig::parse("rig", &new.text).unwrap().units, units);
        new
    }

    #[test]
    fn a_rig_file_is_changed_where_its_values_stand() {
        let rig = Rig::built_in().expect("the built-in rig is good");
        let mut units = rig.units;
        for unit in &mut units {
            unit.coulomb_n = 1.3;
            unit.viscous_n_s_per_m = 4.0;
        }
        units[2].ripples[0] = RippleSettings {
            period_m: 0.0169,
            amplitude_n: 0.4,
            amplitude_per_n: 0.0,
            phase_rad: -0.7,
        };
        units[4].kp = 0.1;
        let new = rewrite("rig", DEFAULT_TEXT, &rig, &units).expect("changes");
        let parsed = Rig::parse("rig", &new.text).expect("still a rig file");
        assert_eq!(parsed.units, units);
        // Comments are all there; new keys got lines of their own.
        let comments = |text: &str| text.matches('#').count();
        assert_eq!(comments(&new.text), comments(DEFAULT_TEXT));
        assert_eq!(
            new.text.lines().count(),
            DEFAULT_TEXT.lines().count() + 1 + 3 + 1
        );
        assert!(new
            .changed
            .contains(&"units 1, 2, 3, 4, 5, 6: coulomb_n 0.909 -> 1.3".to_owned()));
        assert!(new.changed.contains(&"unit 5: kp 0.3 -> 0.1".to_owned()));
        // Once more: a unit's own line is changed, not doubled.
        let mut again = units;
        again[4].kp = 0.2;
        again[2].ripples[0].phase_rad = 0.0;
        let newer = rewrite("rig", &new.text, &parsed, &again).expect("changes");
        assert_eq!(newer.text.lines().count(), new.text.lines().count());
        assert_eq!(Rig::parse("rig", &newer.text).expect("good").units, again);
        // Nothing to do leaves every byte.
        let same = rewrite("rig", &new.text, &parsed, &units).expect("nothing");
        assert_eq!((same.text, same.changed.len()), (new.text, 0));
    }

    #[test]
    fn a_stored_calibration_stays_out_of_the_file() {
        let file = Rig::built_in().unwrap();
        let mut record = known::base::nominal(&file, "2026-11-22");
        record.units[1].gain_date = "2026-11-22".to_owned();
        record.units[1].n_per_code = 7e-6;
        let rig = overlay(&file, &record);
        let mut units = rig.units;
        units[1].coulomb_n = 1.3;
        let new = rewrite("rig", DEFAULT_TEXT, &rig, &units).unwrap();
        let parsed = Rig::parse("rig", &new.text).unwrap();
        assert_eq!(parsed.units[1].coulomb_n, 1.3);
        assert_eq!(
            parsed.units[1].scale_n_per_count,
            file.units[1].scale_n_per_count
        );
    }

    #[test]
    fn only_the_value_of_a_line_changes() {
        let new = rewritten(DEFAULT_TEXT, |_, unit| unit.dac_codes_per_n = 300.5);
        assert_eq!(
            added(DEFAULT_TEXT, &new.text),
            ["dac_codes_per_n = 300.5 # Z6A6 at +-10 V: 0.6 A/V, 52.1 mN m/A, 26:7, 10 mm"]
        );
        assert_eq!(
            new.text.lines().count(),
            DEFAULT_TEXT.lines().count(),
            "{}",
            new.text
        );
    }

    #[test]
    fn line_ends_stay_as_they_are() {
        let crlf = DEFAULT_TEXT.replace('\n', "\r\n");
        let new = rewritten(&crlf, |i, unit| {
            unit.kp = 0.2;
            if i == 1 {
                unit.viscous_n_s_per_m = 5.0;
            }
        });
        assert_eq!(
            new.text.matches("\r\n").count(),
            new.text.matches('\n').count()
        );
        let lines = rewritten(DEFAULT_TEXT, |i, unit| {
            unit.kp = 0.2;
            if i == 1 {
                unit.viscous_n_s_per_m = 5.0;
            }
        });
        assert_eq!(new.text.replace("\r\n", "\n"), lines.text);
        // Without a line end after the last line.
        let cut = DEFAULT_TEXT.trim_end();
        rewritten(cut, |i, unit| unit.viscous_n_s_per_m = f64::from(i as u8));
    }

    /// The built-in file with all units in inline tables.
    fn inline_units() -> String {
        let (head, units) = DEFAULT_TEXT.split_once("[[unit]]").unwrap();
        let units: Vec<String> = format!("[[unit]]{units}")
            .split("[[unit]]")
            .skip(1)
            .map(|unit| {
                let pairs: Vec<&str> = unit
                    .lines()
                    .filter(|line| line.contains('='))
                    .map(|line| line.split('#').next().unwrap_or_default().trim())
                    .collect();
                format!("  {{ {} }},\n", pairs.join(", "))
            })
            .collect();
        let (name, rest) = head.split_once("[link]").unwrap();
        format!("{name}unit = [\n{}]\n[link]{rest}", units.concat())
    }

    #[test]
    fn units_in_inline_tables_are_changed_in_place() {
        let text = inline_units();
        let new = rewritten(&text, |i, unit| {
            unit.coulomb_n = 1.3;
            if i == 3 {
                unit.viscous_n_s_per_m = 4.0;
            }
        });
        let lines = added(&text, &new.text);
        assert_eq!(lines.len(), 2, "{lines:?}");
        assert!(
            lines[0].ends_with("], viscous_n_s_per_m = 4.0 },"),
            "{lines:?}"
        );
        assert_eq!(lines[1], "coulomb_n = 1.3");
    }

    #[test]
    fn dotted_and_quoted_keys_are_changed_in_place() {
        let (head, rest) = DEFAULT_TEXT.split_once("[defaults]").unwrap();
        let (defaults, units) = rest.split_once("# exit_m:").unwrap();
        let dotted: String = defaults
            .lines()
            .map(|line| match line.contains('=') && !line.starts_with('#') {
                true => format!("defaults.{line}\n"),
                false => format!("{line}\n"),
            })
            .collect();
        let (name, sections) = head.split_once("[link]").unwrap();
        let text = format!("{name}{dotted}\n[link]{sections}\n# exit_m:{units}").replacen(
            "defaults.kp",
            "defaults.\"kp\"",
            1,
        );
        let new = rewritten(&text, |_, unit| {
            unit.kp = 0.25;
            unit.viscous_n_s_per_m = 2.0;
        });
        let lines = added(&text, &new.text);
        assert_eq!(
            lines,
            [
                "defaults.\"kp\" = 0.25                 # N per N",
                "defaults.viscous_n_s_per_m = 2.0"
            ]
        );
    }

    #[test]
    fn units_in_any_order_get_their_own_values() {
        let (head, units) = DEFAULT_TEXT.split_once("[[unit]]").unwrap();
        let mut units: Vec<&str> = units.split("[[unit]]").collect();
        units.reverse();
        let text: String = std::iter::once(head.to_owned())
            .chain(units.iter().map(|unit| format!("[[unit]]{unit}\n")))
            .collect();
        let new = rewritten(&text, |i, unit| unit.kp = 0.1 * (i + 1) as f64);
        for (i, unit) in Rig::parse("rig", &new.text)
            .unwrap()
            .units
            .iter()
            .enumerate()
        {
            assert_eq!((unit.number, unit.kp), (i as u8 + 1, 0.1 * (i + 1) as f64));
        }
        let last = new.text.rfind("[[unit]]").unwrap();
        assert!(
            new.text[last..].contains("kp = 0.1"),
            "{}",
            &new.text[last..]
        );
    }

    #[test]
    fn a_key_in_defaults_stays_there_beside_a_unit_with_its_own() {
        let text = DEFAULT_TEXT.replacen("number = 3", "kp = 0.6 # stiffer\nnumber = 3", 1);
        let new = rewritten(&text, |i, unit| unit.kp = if i == 2 { 0.5 } else { 0.2 });
        assert_eq!(
            added(&text, &new.text),
            ["kp = 0.2                 # N per N", "kp = 0.5 # stiffer"]
        );
    }

    #[test]
    fn a_text_that_is_not_the_rigs_is_left_with_the_changes_listed() {
        let rig = Rig::built_in().unwrap();
        let mut units = rig.units;
        units.iter_mut().for_each(|unit| unit.kp = 0.2);
        let cut = DEFAULT_TEXT.rfind("[[unit]]").unwrap();
        let other = DEFAULT_TEXT.replacen("coulomb_n = 0.909", "coulomb_n = 0.5", 1);
        for (text, words) in [
            (&DEFAULT_TEXT[..cut], "number = 6"),
            (&other, "not the file of this rig"),
            ("kp = [", "can't be edited"),
            ("", "no list of units"),
        ] {
            let error = rewrite("mine.toml", text, &rig, &units).expect_err("is another file");
            assert!(error.contains(words), "{error}");
            assert!(
                error.contains("mine.toml") && error.contains("kp 0.3 -> 0.2"),
                "{error}"
            );
        }
    }
}
