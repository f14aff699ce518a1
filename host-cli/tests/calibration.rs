//! The guide docs/calibration.md: every command of the page, in its order, on the rig without the
//! emulated controller; and what a session by hand does when it is broken off.
//!
//! `<!-- test: code 6 -->` before a block of code says its exit code.

mod common;

use calibrate::standin::Cells;
use calibration::gain::iso376::Class;
use common::{expect, forcectl, said, words};
use serde_json::Value;
use std::io::Write;
use std::path::Path;
use std::process::Stdio;

/// Calls with their exit codes.
fn calls(page: &str) -> Vec<(&str, i32)> {
    let mut found = Vec::new();
    let mut code = 0;
    let mut fenced = false;
    for line in page.lines() {
        if let Some(rest) = line.strip_prefix("<!-- test: code ") {
            code = rest.trim_end_matches(" -->").parse().expect("a code");
        } else if line.starts_with("```") {
            if fenced {
                code = 0;
            }
            fenced = !fenced;
        } else if fenced {
            let words = line.strip_prefix("forcectl ").expect("a call of forcectl");
            found.push((words, code));
        }
    }
    found
}

#[test]
fn every_command_of_the_guide_does_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/calibration.md");
    let page = std::fs::read_to_string(path).unwrap();
    let calls = calls(&page);
    assert!(calls.len() >= 14, "{}", calls.len());
    let mut all = String::new();
    for (line, code) in calls {
        let said = expect(folder.path(), line, code, &[]);
        all += &said.out;
        all += &said.err;
    }
    for expected in [
        "station `B` moved by about",
        "went away when the cable was paid out",
        "SBA-0713",
        "times as long (",
        "entered 50 g, but the code is that of",
        "read back and compared",
        "in force on the board",
        "within ",
        "the rig stands where its calibration says",
        "over the rig as it is",
    ] {
        assert!(all.contains(expected), "`{expected}` is missing: {all}");
    }
    for word in page.split('`').filter(|w| w.starts_with("forcectl-out/")) {
        assert!(folder.path().join(word).exists(), "{word}");
    }
    // The run's uncertainty is in its figures.
    let figures = std::fs::read(folder.path().join("forcectl-out/set-force.json")).unwrap();
    let figures: Value = serde_json::from_slice(&figures).unwrap();
    let radius = figures["uncertainty"]["radius_95_n"].as_f64().unwrap();
    assert!((0.001..0.2).contains(&radius), "{radius}");
    assert_eq!(figures["uncertainty"]["nominal"], serde_json::json!([]));
}

#[test]
fn a_session_by_hand_goes_on_where_it_was_broken_off() {
    let folder = tempfile::tempdir().unwrap();
    let call = |input: &str, more: &str, code: i32, expected: &[&str]| {
        let line =
            format!("calibrate gain --link fast --unit 2 --rounds 1 --weights 100 500 1000 {more}");
        let mut child = forcectl(folder.path(), &words(&line))
            .stdin(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdin = child.stdin.take().unwrap();
        stdin.write_all(input.as_bytes()).unwrap();
        drop(stdin);
        let said = said(&child.wait_with_output().unwrap());
        assert_eq!(said.code, Some(code), "{said:?}");
        for text in expected {
            let printed = said.out.contains(text) || said.err.contains(text);
            assert!(printed, "no `{text}`: {said:?}");
        }
    };
    // Two readings, one taken back, one more, then the end of the input.
    let stopped = [
        "How the weights load a cell",
        "over a pulley",
        "then `calibrate geometry`",
        "reading 1 of 10: take all weights off",
        "hang 100 g",
        "stopped after 2 of 10 readings",
    ];
    call("\n\nu\n\n", "", 130, &stopped);
    let done = ["2 of 10 readings are kept from before", "version 0001"];
    call(&"\n".repeat(8), "", 0, &done);
    // `--yes` alone is nothing for a table, and bad tables store nothing.
    let bad = folder.path().join("bad.csv");
    std::fs::write(&bad, "weight_g,code,standard_error\n10,1e3,30\n20,abc,30\n").unwrap();
    let refused = ["bad.csv:3: `abc`", "nothing was stored"];
    call("", "--readings bad.csv", 2, &refused);
    let line = "calibrate show --versions --link fast";
    let versions = expect(folder.path(), line, 0, &[]);
    assert_eq!(versions.out.matches("sha256:").count(), 1, "{versions:?}");
}

#[test]
fn the_procedure_of_iso_376_finds_what_the_cells_do() {
    let folder = tempfile::tempdir().unwrap();
    let (share, tau_s): (f64, f64) = (6e-4, 90.0);
    let plant =
        format!("[[effects]]\nkind = \"creep\"\nfraction = {share}\ntime_constant_s = {tau_s}\n");
    std::fs::write(folder.path().join("creep.toml"), plant).unwrap();
    let rig = "--link fast --seed 11";
    let line = format!(
        "calibrate gain {rig} --plant creep.toml --unit 4 5 --iso-376 --yes --json --gravity 9.80665 --gravity-sd 1e-6 \
         --inject hysteresis=4:12 --inject remount=4:0.05 --inject hysteresis=5:1 --inject remount=5:0.2 \
         --loading dismounted --temperature 21 --operator Q --weights-serial 17"
    );
    let told = expect(folder.path(), &line, 0, &[]);
    let reply: Value = serde_json::from_str(&told.out).unwrap();
    let gains = reply["gains"].as_array().unwrap();
    let mut cells = Cells::new(
        11,
        &[
            "remount=4:0.05".parse().unwrap(),
            "remount=5:0.2".parse().unwrap(),
        ],
    );
    let mut scales = |unit: u8| {
        [0, 120, 240].map(|degrees| {
            cells.turn(degrees);
            cells.mounting(unit).0
        })
    };
    for (gain, (unit, loop_n)) in gains.iter().zip([(4, 0.012), (5, 0.001)]) {
        let iso = &gain["iso376"];
        let found = |key: &str| iso[key].as_f64().unwrap();
        let scales = scales(unit);
        let spread = scales.iter().fold(f64::MIN, |a, b| a.max(*b))
            - scales.iter().fold(f64::MAX, |a, b| a.min(*b));
        let largest = 9.805;
        let mut worst = 0.0f64;
        for load in iso["loads"].as_array().unwrap() {
            let numbers: Vec<f64> = serde_json::from_value(load.clone()).unwrap();
            let [force, b, b2, _, v, ..] = numbers[..] else {
                panic!("{load}");
            };
            if force < 4.0 {
                continue;
            }
            // What creeps from one load to the next is in all of them.
            assert!(
                (b - spread).abs() < 2.0 * share / 3.0,
                "unit {unit}, {force} N: b {b}, {spread}"
            );
            assert!(b2 < share / 2.0, "unit {unit}, {force} N: b' {b2}");
            let loop_v = 4.0 * loop_n * (largest - force) / (largest * largest);
            assert!(
                (v - loop_v).abs() < share,
                "unit {unit}, {force} N: v {v}, {loop_v}"
            );
            worst = worst.max(loop_v);
        }
        let creep = share * ((-30.0 / tau_s).exp() - (-300.0 / tau_s).exp());
        assert!((found("creep") / creep - 1.0).abs() < 0.25, "{iso}");
        // The class is that of the true parameters: of the loop at half of the load, and weights of
        // class M2.
        let wanted = Class::ALL.into_iter().find(|class| {
            let limits = class.limits();
            spread <= limits.reproducibility
                && worst <= limits.reversibility
                && creep <= limits.creep
                && 1.9e-4 <= limits.force_95
        });
        assert_eq!(
            iso["class"],
            wanted.map_or(String::new(), |c| c.to_string()),
            "{spread} {iso}"
        );
        // The next mounting is in the interval of the scale.
        let parts = &gain["parts_relative"];
        assert!(
            parts["remounting"].as_f64().unwrap() > 0.3 * spread,
            "{gain}"
        );
        assert_eq!(gain["temperature"]["from_c"], 21.0);
    }
    let told = expect(
        folder.path(),
        &format!("calibrate certificate {rig}"),
        0,
        &[],
    );
    assert!(told.out.contains("certificate.html"));
    let page =
        std::fs::read_to_string(folder.path().join("forcectl-out/certificate.html")).unwrap();
    for text in [
        "Figures by ISO 376",
        "version 0001",
        "<b>1</b> from ",
        "reversibility v",
        "next mounting (A)",
        "dismounted, axis upright",
        "21.0 degrees Celsius; too small a range",
    ] {
        assert!(page.contains(text), "`{text}` is missing");
    }
}

/// A weight on a free tip checks what a weight on the cells can't: where the cables leave the
/// reels.
#[test]
fn a_weight_on_the_tip_checks_the_calibration_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let here = "--link fast --seed 5 --yes";
    let place = "--gravity 9.80665";
    for step in [
        "geometry --touches 3",
        &format!("gain --creep 0 {place}"),
        "zero",
    ] {
        expect(folder.path(), &format!("calibrate {step} {here}"), 0, &[]);
    }
    let check = |more: &str, code: i32, expected: &[&str]| {
        let line = format!("--json calibrate check --at tip {place} {here} {more}");
        let said = expect(folder.path(), &line, code, expected);
        serde_json::from_str::<Value>(&said.out).unwrap()
    };
    let found = check("", 0, &[]);
    let row = &found["checks"][0];
    let of = |key: &str| row[key].as_f64().unwrap();
    assert!(row["holds"] == true && of("en").abs() <= 1.0, "{found}");
    assert!((of("force_n") - 4.903).abs() < 0.01, "{found}");
    // Calibration and pose leave some tens of millinewtons.
    assert!((0.001..0.1).contains(&of("uncertainty_95_n")), "{found}");
    // 10 g less than what is said, and a place of the tip that is less well known.
    let wrong = check("--inject weight=500:490", 6, &[]);
    assert_eq!(wrong["checks"][0]["holds"], false);
    let wide = check("--inject weight=500:490 --pose-sd 5", 0, &[]);
    assert_eq!(wide["checks"][0]["holds"], true);
    let said = expect(
        folder.path(),
        "calibrate certificate --link fast --seed 5",
        0,
        &[],
    );
    assert!(said.out.contains("certificate.html"), "{said:?}");
    let page = std::fs::read_to_string(folder.path().join("forcectl-out/certificate.html"));
    let page = page.unwrap();
    let rows = page.matches("<td>tip</td><td>500</td>").count();
    assert_eq!(rows, 3);
    for (more, expected) in [
        ("--unit 2", "--unit is for a weight on the cells"),
        ("--duration 8", "give at least 15 s"),
        ("--weight 1500", "above the rig's limit"),
    ] {
        let line = format!("calibrate check --at tip {here} {more}");
        expect(folder.path(), &line, 2, &[expected]);
    }
}

#[test]
fn values_that_can_not_be_are_refused_and_nothing_is_stored() {
    let folder = tempfile::tempdir().unwrap();
    let latin = folder.path().join("latin.csv");
    std::fs::write(&latin, b"weight_g,code,standard_error\n10,1,3 \xb5\n").unwrap();
    let comma = folder.path().join("comma.csv");
    std::fs::write(&comma, "weight_g;code;standard_error\n10;1,5;3\n").unwrap();
    for (call, expected) in [
        ("verify --duration 0.5", "give at least 2 s"),
        ("geometry --yes --digitizer-sd 0.0002", "mm, not m?"),
        ("gain --weights 0 --yes", "`0` is not a weight"),
        ("gain --weights nan --yes", "`nan` is not a weight"),
        ("gain --iso-376 --rounds 3 --yes", "cannot be used with"),
        ("gain --loading rope --yes", "neither `dismounted` nor"),
        ("gain --temperature 300 --yes", "no temperature of a room"),
        ("zero --replace 9 --yes", "no unit 9 is enabled"),
        ("gain --unit 2 --readings latin.csv", "save it as CSV UTF-8"),
        ("gain --unit 2 --readings comma.csv", "write a point"),
        ("gain --yes --gravity 9.88", "on Earth it is 9.76 to 9.84"),
        ("check --yes --gravity 9.75", "on Earth it is 9.76 to 9.84"),
    ] {
        let line = format!("calibrate {call} --link fast");
        expect(folder.path(), &line, 2, &[expected]);
    }
    let said = common::run(folder.path(), "calibrate use 1 --link fast");
    let refused = said.code != Some(0) && said.err.contains("0001.toml");
    assert!(refused, "{said:?}");
}
