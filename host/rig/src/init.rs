//! A rig file from the answers to ten questions: what is different on every rig. Everything else is
//! that of the built-in file, whose comments stay.
//!
//! An answer is text. Answers for each unit are separated by semicolons, each with the number of
//! its unit: `1: 0.335 0.045 -0.110; 2: -0.480 0.010 -0.165`.

use super::{LinkChoice, DEFAULT_TEXT};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use toml_edit::{value, Array, DocumentMut, Item, Table, Value};
use wire::UNITS;

/// A question about a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Question {
    /// Name of the answer.
    pub key: &'static str,
    /// The question, with unit and an example.
    pub text: &'static str,
    /// Answer where none is given; `None`: an answer is needed.
    pub default: Option<&'static str>,
    /// Whether each unit has its own answer.
    pub per_unit: bool,
}

/// The questions, in the order in which they are asked.
pub const QUESTIONS: [Question; 10] = [
    Question {
        key: "name",
        text: "Name of the rig, for reports and recordings",
        default: None,
        per_unit: false,
    },
    Question {
        key: "link",
        text: "Connection to the board: usb, serial:PORT or embedded",
        default: Some("usb"),
        per_unit: false,
    },
    Question {
        key: "pose",
        text: "Where the robot's pose comes from: udp ADDRESS:PORT, static X Y Z (a clamped tip, m) or rig (embedded rig)",
        default: Some("udp 127.0.0.1:4711"),
        per_unit: false,
    },
    Question {
        key: "center",
        text: "Centre of the workspace of the tip, robot base frame, m, as in -0.080 0.025 -0.140",
        default: None,
        per_unit: false,
    },
    Question {
        key: "radius",
        text: "Radius of the workspace, m; a tip further out stops the rig",
        default: Some("0.05"),
        per_unit: false,
    },
    Question {
        key: "units",
        text: "Numbers of the units that are there",
        default: Some("1 2 3 4 5 6"),
        per_unit: false,
    },
    Question {
        key: "exit",
        text: "Where the cable leaves the reel, robot base frame, m, as in 0.335 0.045 -0.110",
        default: None,
        per_unit: true,
    },
    Question {
        key: "axis",
        text: "Measuring axis of the load cell, from the unit to the workspace; auto: along the cable at the centre",
        default: Some("auto"),
        per_unit: true,
    },
    Question {
        key: "scale",
        text: "Load-cell force per ADC count from a weight, N; negative where pulling lowers the code",
        default: Some("6.85e-6"),
        per_unit: true,
    },
    Question {
        key: "tension",
        text: "Least and largest tension of a cable, N",
        default: Some("2 12"),
        per_unit: false,
    },
];

/// Largest coordinate of a place, m: that of a rig file (`read`).
const PLACE_MAX_M: f64 = 10.0;

/// The first lines of a rig file that was made.
const HEADER: &str = "\
# Rig file, made by `forcectl init`. SI units throughout; every key is checked when the file is read
# (`forcectl check FILE`). Gains, limits and friction are those of the built-in example.
";

/// The question with this key.
#[must_use]
pub fn question(key: &str) -> Option<&'static Question> {
    QUESTIONS.iter().find(|question| question.key == key)
}

/// The units that an answer to `units` names, from 1.
///
/// # Errors
/// What is wrong with the answer.
pub fn units(answer: &str) -> Result<Vec<u8>, String> {
    let mut found = Vec::new();
    for word in answer.split([' ', ',']).filter(|word| !word.is_empty()) {
        match word.parse::<u8>() {
            Ok(n) if (1..=UNITS as u8).contains(&n) => found.push(n),
            _ => {
                return Err(format!(
                "units: `{word}` is not a unit; give numbers from 1 to {UNITS}, as in 1 2 3 4 5 6"
            ))
            }
        }
    }
    if found.is_empty() {
        return Err("units: at least one unit is needed".to_owned());
    }
    Ok(found)
}

/// Makes the text of a rig file. `answers` holds a text for each key; a key that is missing has its
/// default.
///
/// # Errors
/// Every answer that is missing or wrong.
pub fn rig_file(answers: &BTreeMap<String, String>) -> Result<String, Vec<String>> {
    let mut writer = Writer::new(answers)?;
    writer.rig();
    writer.units();
    if writer.problems.is_empty() {
        Ok(writer.document.to_string())
    } else {
        Err(writer.problems)
    }
}

/// The built-in file being changed.
struct Writer<'a> {
    answers: &'a BTreeMap<String, String>,
    document: DocumentMut,
    problems: Vec<String>,
}

impl<'a> Writer<'a> {
    fn new(answers: &'a BTreeMap<String, String>) -> Result<Self, Vec<String>> {
        let mut problems: Vec<String> = answers
            .keys()
            .filter(|key| question(key).is_none())
            .map(|key| {
                format!(
                    "`{key}` is no question; known are {}",
                    QUESTIONS.map(|question| question.key).join(", ")
                )
            })
            .collect();
        problems.extend(
            QUESTIONS
                .iter()
                .filter(|q| q.default.is_none() && !answers.contains_key(q.key))
                .map(|q| format!("{}: an answer is missing ({})", q.key, q.text)),
        );
        // The built-in file is TOML; a test checks it.
        let document = DEFAULT_TEXT
            .parse()
            .map_err(|error| vec![format!("the built-in rig file: {error}")])?;
        if problems.is_empty() {
            Ok(Self {
                answers,
                document,
                problems,
            })
        } else {
            Err(problems)
        }
    }

    fn answer(&self, key: &str) -> &'a str {
        let default = question(key).and_then(|question| question.default);
        self.answers
            .get(key)
            .map_or(default.unwrap_or_default(), String::as_str)
            .trim()
    }

    /// Numbers of an answer, as many as `N`.
    fn numbers<const N: usize>(&mut self, key: &str, text: &str) -> Option<[f64; N]> {
        let found = numbers(text);
        if found.is_none() {
            self.problems.push(format!(
                "{key}: `{text}` has to be {N} number{}",
                if N == 1 { "" } else { "s" }
            ));
        }
        found
    }

    /// A place near the robot, m.
    fn place(&mut self, key: &str, text: &str) -> Option<[f64; 3]> {
        let place_m = self.numbers::<3>(key, text)?;
        if let Some(far) = place_m.iter().find(|x| x.abs() > PLACE_MAX_M) {
            self.problems.push(format!(
                "{key}: {far} m in `{text}` is too far: at most {PLACE_MAX_M} m are allowed; give metres, not millimetres"
            ));
            return None;
        }
        Some(place_m)
    }

    /// What belongs to the rig as a whole.
    fn rig(&mut self) {
        if let Some(mut first) = self.document.key_mut("schema") {
            first.leaf_decor_mut().set_prefix(HEADER);
        }
        let name = self.answer("name");
        if name.is_empty() || name.contains(char::is_control) {
            self.problems.push(format!(
                "name: {name:?} is no name; give one line of text, as in lab-3"
            ));
        }
        set(&mut self.document["name"], name);
        let link = self.answer("link");
        if let Err(error) = link.parse::<LinkChoice>() {
            self.problems.push(format!("link: {error}"));
        }
        set(&mut self.document["link"]["rig"], link);
        self.pose();
        let (center, radius) = (self.answer("center"), self.answer("radius"));
        if let Some(center_m) = self.place("center", center) {
            set(
                &mut self.document["workspace"]["center_m"],
                Array::from_iter(center_m),
            );
        }
        if let Some([radius_m]) = self.numbers("radius", radius) {
            set(&mut self.document["workspace"]["radius_m"], radius_m);
        }
        let tension = self.answer("tension");
        if let Some([least_n, largest_n]) = self.numbers("tension", tension) {
            set(&mut self.document["defaults"]["tension_min_n"], least_n);
            set(&mut self.document["defaults"]["tension_max_n"], largest_n);
            // The other limits of the built-in file belong to 12 N: the motor has to be able to
            // hold the largest tension.
            for (key, factor) in [
                ("force_limit_n", 16.0 / 12.0),
                ("over_tension_n", 20.0 / 12.0),
            ] {
                let limit_n = (largest_n * factor * 100.0).round() / 100.0;
                set(&mut self.document["defaults"][key], limit_n);
            }
        }
    }

    fn pose(&mut self) {
        let answer = self.answer("pose");
        let (source, rest) = answer.split_once(' ').unwrap_or((answer, ""));
        let rest = rest.trim();
        match source {
            "rig" if rest.is_empty() => {}
            "udp" if rest.parse::<SocketAddr>().is_ok() => {
                set(&mut self.document["pose"]["listen"], rest);
                set(&mut self.document["pose"]["max_age_s"], 0.1);
            }
            "static" => {
                if let Some(position_m) = self.place("pose", rest) {
                    set(&mut self.document["pose"]["position_m"], Array::from_iter(position_m));
                }
            }
            _ => self.problems.push(format!(
                "pose: `{answer}` is not one; give udp ADDRESS:PORT (as in udp 127.0.0.1:4711), static X Y Z, or rig"
            )),
        }
        set(&mut self.document["pose"]["source"], source);
    }

    /// What belongs to each unit.
    fn units(&mut self) {
        let there = match units(self.answer("units")) {
            Ok(there) => there,
            Err(problem) => return self.problems.push(problem),
        };
        let of_units = ["exit", "axis", "scale"].map(|key| {
            let answer = self.answer(key);
            by_unit(key, answer).unwrap_or_else(|problem| {
                self.problems.push(problem);
                BTreeMap::new()
            })
        });
        let center_m = numbers::<3>(self.answer("center")).map(Vector3::from);
        for number in 1..=UNITS as u8 {
            let enabled = there.contains(&number);
            let [exit, axis, scale] = of_units.each_ref().map(|of| {
                of.get(&number)
                    .or_else(|| of.get(&0))
                    .map(|text| text.as_str())
            });
            let exit_m = match exit {
                Some(exit) => self.place("exit", exit),
                None if enabled => {
                    self.problems
                        .push(format!("exit: unit {number} has no answer"));
                    None
                }
                None => None,
            };
            let axis = match axis {
                Some("auto") | None => exit_m.zip(center_m).and_then(|(exit_m, center_m)| {
                    let along = (center_m - Vector3::from(exit_m)).try_normalize(0.0)?;
                    Some(along.map(|v| (v * 1e6).round() / 1e6).into())
                }),
                Some(axis) => self.numbers::<3>("axis", axis),
            };
            let scale = scale.and_then(|scale| self.numbers::<1>("scale", scale));
            let Some(table) = self.unit_table(number) else {
                continue;
            };
            // Without the example's comment on the unit's place.
            table["number"] = value(i64::from(number));
            if !enabled {
                table["enabled"] = value(false);
            }
            if let Some(exit_m) = exit_m {
                table["exit_m"] = value(Array::from_iter(exit_m));
            }
            if let Some(axis) = axis {
                table["axis"] = value(Array::from_iter(axis));
            }
            if let Some([scale]) = scale {
                table["scale_n_per_count"] = value(scale);
            }
        }
    }

    fn unit_table(&mut self, number: u8) -> Option<&mut Table> {
        self.document["unit"]
            .as_array_of_tables_mut()?
            .get_mut(usize::from(number) - 1)
    }
}

/// Puts a value in the place of another one, whose comment stays.
fn set(item: &mut Item, new: impl Into<Value>) {
    let mut new = new.into();
    if let Some(old) = item.as_value() {
        *new.decor_mut() = old.decor().clone();
    }
    *item = Item::Value(new);
}

/// Finite numbers separated by spaces or commas, exactly `N`.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    text.split([' ', ','])
        .filter(|word| !word.is_empty())
        .map(|word| word.parse::<f64>().ok().filter(|number| number.is_finite()))
        .collect::<Option<Vec<_>>>()?
        .try_into()
        .ok()
}

/// Answers by unit; 0: that of every unit.
fn by_unit(key: &str, answer: &str) -> Result<BTreeMap<u8, String>, String> {
    let mut found = BTreeMap::new();
    for part in answer
        .split(';')
        .map(str::trim)
        .filter(|part| !part.is_empty())
    {
        let (number, text) = match part.split_once(':') {
            None => (0, part),
            Some((number, text)) => match units(number.trim()).as_deref() {
                Ok([number]) => (*number, text.trim()),
                _ => {
                    return Err(format!(
                        "{key}: `{part}` does not begin with the number of a unit; give `1: VALUE; 2: VALUE; ...`"
                    ))
                }
            },
        };
        if found.insert(number, text.to_owned()).is_some() {
            return Err(format!(
                "{key}: `{part}` is the second answer for this unit"
            ));
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PoseChoice, Rig};

    const EXITS: &str = "1: 0.335 0.045 -0.110; 2: -0.480 0.010 -0.165; 3: -0.055 0.440 -0.120; \
                         4: -0.090 -0.375 -0.190; 5: -0.065 0.055 0.275; 6: -0.100, -0.030, -0.520";

    fn answers(pairs: &[(&str, &str)]) -> BTreeMap<String, String> {
        [
            ("name", "lab-3"),
            ("center", "-0.080 0.025 -0.140"),
            ("exit", EXITS),
        ]
        .iter()
        .chain(pairs)
        .map(|(key, text)| ((*key).to_owned(), (*text).to_owned()))
        .collect()
    }

    #[test]
    fn the_answers_that_have_no_default_make_a_good_file_with_comments() {
        let text = rig_file(&answers(&[])).unwrap();
        let rig = Rig::parse("lab.toml", &text).unwrap();
        assert_eq!(rig.name, "lab-3");
        assert_eq!(rig.link, LinkChoice::Usb);
        assert!(matches!(rig.pose, PoseChoice::Udp { .. }));
        assert_eq!(rig.workspace.radius_m, 0.05);
        assert_eq!(rig.units[5].exit_m, Vector3::new(-0.1, -0.03, -0.52));
        // The comments stay but for those that describe the example's place: the header and one of
        // each unit.
        let comments = |text: &str| text.lines().filter(|line| line.contains('#')).count();
        assert_eq!(comments(&text), comments(DEFAULT_TEXT) - 7, "{text}");
        assert!(text.starts_with("# Rig file, made by"), "{text}");
        assert!(!text.contains("pulls towards"), "{text}");
    }

    #[test]
    fn every_answer_reaches_the_file() {
        let text = rig_file(&answers(&[
            ("link", "serial:/dev/ttyACM7"),
            ("pose", "static -0.08 0.02 -0.14"),
            ("radius", "0.07"),
            ("axis", "auto; 1: -0.996049 -0.034022 -0.082028"),
            ("scale", "7e-6; 3: -6.5e-6"),
            ("tension", "1.5 9"),
        ]))
        .unwrap();
        let rig = Rig::parse("lab.toml", &text).unwrap();
        assert_eq!(rig.link, LinkChoice::Serial("/dev/ttyACM7".into()));
        assert!(matches!(rig.pose, PoseChoice::Static { .. }));
        assert_eq!(rig.workspace.radius_m, 0.07);
        assert_eq!(rig.units[0].axis.x, -0.996_049);
        assert_eq!(rig.units[0].scale_n_per_count, 7e-6);
        assert_eq!(rig.units[2].scale_n_per_count, -6.5e-6);
        let unit = rig.units[4];
        assert_eq!(
            (
                unit.tension_min_n,
                unit.tension_max_n,
                unit.force_limit_n,
                unit.over_tension_n
            ),
            (1.5, 9.0, 12.0, 15.0)
        );
        // One unit alone: a good file.
        let text = rig_file(&answers(&[("units", "3")])).unwrap();
        assert!(!Rig::parse("one.toml", &text).unwrap().units[0].enabled);
    }

    #[test]
    fn wrong_and_missing_answers_are_all_named() {
        let none = rig_file(&BTreeMap::new()).unwrap_err();
        assert_eq!(none.len(), 3, "{none:?}");
        for (key, text, words) in [
            ("link", "pigeon", "serial:PORT"),
            ("pose", "udp nowhere", "udp ADDRESS:PORT"),
            ("pose", "static -80 25 -140", "not millimetres"),
            ("center", "-80 25 -140", "-80 m"),
            ("exit", "1: 335 45 -110", "335 m"),
            ("name", "", "one line of text"),
            ("name", " ", "one line of text"),
            ("name", "lab\n3", "one line of text"),
            ("name", "lab\u{1b}[31m", "one line of text"),
            ("pose", "static 1 2", "3 numbers"),
            ("center", "1 2 nan", "3 numbers"),
            ("radius", "wide", "1 number"),
            ("units", "1 9", "1 to 6"),
            ("units", "", "at least one"),
            ("exit", "1: 0 0 0", "unit 2 has no answer"),
            ("axis", "9: 0 0 1", "number of a unit"),
            ("scale", "1: 7e-6; 1: 8e-6", "second answer"),
            ("tension", "2", "2 numbers"),
            ("colour", "red", "no question"),
        ] {
            let problems = rig_file(&answers(&[(key, text)])).unwrap_err();
            assert!(problems[0].contains(words), "{key}: {problems:?}");
        }
    }
}
