//! Every kind of mistake in a rig file, and its message.

use crate::{Rig, RigFileError, DEFAULT_TEXT};
use wire::UNITS;

fn problems(text: &str) -> RigFileError {
    Rig::parse("rig.toml", text).expect_err("a problem was put in")
}

/// Line (from 1) of the n-th occurrence of a text in the example.
fn line_of(needle: &str, n: usize) -> usize {
    let (at, _) = DEFAULT_TEXT
        .match_indices(needle)
        .nth(n)
        .expect("is in the example");
    1 + DEFAULT_TEXT[..at].matches('\n').count()
}

#[test]
fn the_built_in_file_is_right() {
    let rig = Rig::built_in().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(rig.units.map(|u| u.number), [1, 2, 3, 4, 5, 6]);
    assert_eq!(rig.hash().len(), 64);
    let config = rig.units[0].to_wire();
    assert_eq!(config.coulomb_un, 909_000);
    assert_eq!(config.friction_offset_un, 155_000);
}

#[test]
fn the_hash_follows_the_values_and_not_the_comments() {
    let rig = Rig::built_in().unwrap();
    let commented = Rig::parse("x", &format!("# more\n{DEFAULT_TEXT}")).unwrap();
    assert_eq!(rig.hash(), commented.hash());
    let changed = DEFAULT_TEXT.replacen("coulomb_n = 0.909", "coulomb_n = 0.91", 1);
    assert_ne!(rig.hash(), Rig::parse("x", &changed).unwrap().hash());
}

#[test]
fn a_missing_unit_is_named() {
    let cut = DEFAULT_TEXT.rfind("[[unit]]").unwrap();
    let error = problems(&DEFAULT_TEXT[..cut]);
    assert_eq!(error.problems.len(), 1, "{error}");
    assert_eq!(error.problems[0].unit, Some(6));
    assert!(error.to_string().contains("number = 6"), "{error}");
}

#[test]
fn every_kind_of_mistake_names_line_key_and_way_out() {
    let cases: &[(&str, &str, &str, &str)] = &[
        (
            "tension_min_n = 2.0",
            "tension_min_n = 14.0",
            "tension_min_n",
            "swapped",
        ),
        (
            "coulomb_n = 0.909",
            "coulomb_n = nan",
            "coulomb_n",
            "finite",
        ),
        (
            "coulomb_n = 0.909",
            "coulomb_n = inf",
            "coulomb_n",
            "finite",
        ),
        (
            "coulomb_n = 0.909",
            "coulomb_n = 909.0",
            "coulomb_n",
            "check value and unit",
        ),
        (
            "coulomb_n = 0.909",
            "coulomb_n = \"much\"",
            "coulomb_n",
            "a number is needed",
        ),
        (
            "coulomb_n = 0.909",
            "coulom_n = 0.909",
            "coulom_n",
            "did you mean `coulomb_n`?",
        ),
        ("number = 2", "number = 1", "number", "used twice"),
        ("number = 2", "number = 7", "number", "allowed is 1 to 6"),
        ("number = 2", "number = 1.5", "number", "whole number"),
        (
            "reference = \"lower\"",
            "reference = \"low\"",
            "reference",
            "\"middle\"",
        ),
        (
            "rig = \"embedded\"",
            "rig = \"serial\"",
            "rig",
            "serial:PORT",
        ),
        ("source = \"rig\"", "source = \"ros\"", "source", "\"udp\""),
        (
            "friction_feedforward = true",
            "friction_feedforward = 1",
            "friction_feedforward",
            "true or false",
        ),
        ("schema = 1", "schema = 2", "schema", "schema 1"),
        (
            "filter = \"low_pass\"",
            "filter = \"kalman\"",
            "filter",
            "\"moving_average\"",
        ),
        (
            "center_m = [-0.080, 0.025, -0.140]",
            "center_m = [-0.080, 0.025]",
            "center_m",
            "three are needed",
        ),
        (
            "over_tension_n = 20.0",
            "over_tension_n = 11.0",
            "over_tension_n",
            "would fault",
        ),
    ];
    for (good, bad, key, way_out) in cases {
        assert!(DEFAULT_TEXT.contains(good), "{good}");
        let error = problems(&DEFAULT_TEXT.replacen(good, bad, 1));
        let line = line_of(good, 0);
        assert!(
            error
                .problems
                .iter()
                .any(|p| p.key == *key && p.message.contains(way_out) && p.line == line),
            "{bad}: {error}"
        );
        assert!(
            error.to_string().contains(&format!("rig.toml:{line}: ")),
            "{error}"
        );
    }
}

#[test]
fn axes_are_checked_against_the_geometry() {
    let text: String = DEFAULT_TEXT
        .lines()
        .map(|line| match line.strip_prefix("axis = [") {
            Some(rest) => {
                let numbers: Vec<f64> = rest
                    .trim_end_matches(']')
                    .split(',')
                    .map(|n| n.trim().parse().unwrap())
                    .collect();
                format!(
                    "axis = [{}, {}, {}]\n",
                    -numbers[0], -numbers[1], -numbers[2]
                )
            }
            None => format!("{line}\n"),
        })
        .collect();
    let error = problems(&text);
    assert_eq!(error.problems.len(), UNITS, "{error}");
    assert!(
        error.problems.iter().all(|p| p.message.contains("flip")),
        "{error}"
    );
    let error = problems(&DEFAULT_TEXT.replacen("axis = [", "axis = [0.3, 0.0, 0.0] # [", 1));
    assert!(
        error.to_string().contains("unit 1: `axis`: has length 0.3"),
        "{error}"
    );
    assert!(error.to_string().contains("write [1.0"), "{error}");
}

#[test]
fn broken_toml_names_the_line() {
    let error = problems("schema = 1\nname = [\n");
    assert!(error.problems[0].line >= 2, "{error}");
    assert!(error.to_string().contains("not TOML"), "{error}");
    assert!(!problems("").problems.is_empty());
    assert!(!problems("\u{0}\u{fffd}").problems.is_empty());
}

#[test]
fn a_mistake_in_the_defaults_is_one_problem() {
    let text = DEFAULT_TEXT.replacen("kp = 0.3 ", "kp = 300.0 ", 1);
    let error = problems(&text);
    assert_eq!(error.problems.len(), 1, "{error}");
    assert_eq!(error.problems[0].unit, None, "{error}");
    assert_eq!(error.problems[0].line, line_of("kp = 0.3 ", 0));
    // A key that no unit has is one problem.
    let text = DEFAULT_TEXT.replacen("kp = 0.3 ", "# kp = 0.3 ", 1);
    let error = problems(&text);
    assert_eq!(error.problems.len(), 1, "{error}");
    assert!(error.to_string().contains("is missing"), "{error}");
    assert!(error.to_string().contains("all 6 units"), "{error}");
    // The same mistake in two units is two.
    let text = DEFAULT_TEXT.replace("axis = [-0.996049,", "kp = 300.0\naxis = [-0.996049,");
    let text = text.replace("axis = [0.998327,", "kp = 300.0\naxis = [0.998327,");
    assert_eq!(problems(&text).problems.len(), 2);
}

#[test]
fn a_file_without_an_enabled_unit_names_the_line() {
    let text = DEFAULT_TEXT.replacen("[defaults]", "[defaults]\nenabled = false", 1);
    let error = problems(&text);
    assert_eq!(error.problems.len(), 1, "{error}");
    assert_eq!(error.problems[0].line, line_of("[defaults]", 0) + 1);
    assert!(error.to_string().contains("no unit is enabled"), "{error}");
    // One unit is enough.
    let one = text.replacen("number = 3 ", "enabled = true\nnumber = 3 ", 1);
    Rig::parse("rig.toml", &one).unwrap();
}

/// Who copies the example of a message gets a rig that works.
#[test]
fn the_example_of_a_message_is_the_built_in_value() {
    let mut compared = 0;
    for line in DEFAULT_TEXT.lines() {
        let Some((key, rest)) = line.split_once(" = ") else {
            continue;
        };
        let number = |text: &str| text.trim().parse::<f64>().ok();
        let Some(value) = rest.split('#').next().and_then(number) else {
            continue;
        };
        let text = DEFAULT_TEXT.replacen(line, &format!("{key} = 1e12"), 1);
        let error = problems(&text).to_string();
        let Some((_, example)) = error.split_once(&format!("as in `{key} = ")) else {
            continue;
        };
        let example = example.split('`').next().and_then(number).unwrap();
        if key == "number" {
            continue;
        }
        // What need not be there is shown switched off.
        let off = example == 0.0 && line.contains("off unless given");
        assert!(
            off || (example - value).abs() <= 1e-3 * value.abs(),
            "{line}: {error}"
        );
        compared += 1;
    }
    assert!(compared > 20, "{compared}");
}
