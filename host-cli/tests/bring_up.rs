//! `forcectl bring-up` on the rig without an emulated controller, and what its record does to
//! commands that drive.

#[cfg(unix)]
#[path = "common/board.rs"]
mod board;
mod common;

use common::{expect, folder, run};
use serde_json::Value;
use std::path::{Path, PathBuf};

const RIG: &str = "--link fast --weight 500";

#[test]
fn a_mistake_is_named_corrected_and_the_record_is_resumed() {
    let folder = folder();
    let wrong = "exchange-motors=2:5@start";
    let said = expect(
        folder.path(),
        &format!("bring-up {RIG} --inject {wrong}"),
        6,
        &[
            "1. units 2 and 5: their motors are exchanged",
            "do:   exchange the motors' cables",
            "reels       passed",
            "motors      1 named",
        ],
    );
    assert!(said.err.contains("pull it out by 200 mm"), "{said:?}");
    // Only what found something is repeated, and the first test.
    let said = expect(
        folder.path(),
        &format!("bring-up {RIG}"),
        0,
        &["every test passed"],
    );
    assert!(
        said.err.contains("test `motors`") && !said.err.contains("test `reels`"),
        "{said:?}"
    );
    // Without a weight its test stays open.
    let said = run(
        folder.path(),
        "bring-up --link fast --restart --unit 3 --json",
    );
    assert_eq!(said.code, Some(6), "{said:?}");
    let reply: Value = serde_json::from_str(&said.out).unwrap();
    assert_eq!(
        (&reply["verdict"], &reply["open"]),
        (&"undecided".into(), &serde_json::json!(["weights"]))
    );
    assert!(reply["figures"]["motors"][2]["pulses"]
        .as_array()
        .is_some_and(|p| p.len() > 2));
    assert!(reply["figures"]["motors"][1].is_null());
}

#[test]
fn no_motor_moves_without_an_emergency_stop_that_was_seen_to_work() {
    let folder = folder();
    let said = expect(
        folder.path(),
        "bring-up --link fast --from motors",
        6,
        &["motors      not done"],
    );
    assert!(
        said.err
            .contains("the E-stop was not tested: no motor is driven"),
        "{said:?}"
    );
    let late = expect(
        folder.path(),
        "bring-up --link fast --inject estop@1s",
        2,
        &[],
    );
    assert!(late.err.contains("WHAT@start"), "{late:?}");
}

#[test]
fn no_motor_is_tested_whose_power_the_plc_does_not_cut() {
    let folder = folder();
    let said = expect(
        folder.path(),
        &format!("bring-up {RIG} --inject bridge-relay@start"),
        6,
        &[
            "1. the amplifiers have power without the alive line: the PLC's relay is bridged",
            "power       1 named",
            "motors      not done",
        ],
    );
    assert!(
        said.err.contains("do they show power?")
            && said.err.contains("bridged: no motor is driven"),
        "{said:?}"
    );
    let said = expect(
        folder.path(),
        &format!("bring-up {RIG}"),
        0,
        &["power       passed"],
    );
    assert!(
        said.err.contains("test `motors`") && !said.err.contains("test `weights`"),
        "{said:?}"
    );
}

#[test]
fn a_rig_of_which_a_part_was_exchanged_is_not_driven() {
    let folder = folder();
    let serials =
        |cell: &str| format!("calibrate serials --link fast --unit 3 --cell {cell} --replace");
    expect(folder.path(), &serials("SBA-1"), 0, &[]);
    expect(folder.path(), &format!("bring-up {RIG}"), 0, &[]);
    let hold = "hold --link fast --duration 0.2";
    expect(folder.path(), hold, 0, &[]);
    expect(folder.path(), &serials("SBA-2"), 0, &[]);
    let what = "the load cell of unit 3 was SBA-1 and is SBA-2";
    for command in [
        hold,
        "set-force 0 1 0 --link fast --duration 1 --still",
        "identify --link fast --out found",
        "calibrate zero --link fast --yes",
        "calibrate gain --link fast --yes",
        "calibrate geometry --link fast --yes",
        "calibrate self --link fast",
        "calibrate verify --link fast",
        "calibrate check --link fast --yes",
        "calibrate push --link fast",
    ] {
        expect(folder.path(), command, 2, &[what, "nothing was driven"]);
    }
    // It drives nothing, and samples of a rig that is looked into are wanted.
    let said = expect(
        folder.path(),
        "record --link fast --duration 2 recorded",
        0,
        &[],
    );
    assert!(said.err.contains(what), "{said:?}");
    // Tested again, it is driven again.
    let said = expect(folder.path(), &format!("bring-up {RIG}"), 0, &[]);
    assert!(
        said.err.contains(what) && said.err.contains("every test begins anew"),
        "{said:?}"
    );
    expect(folder.path(), hold, 0, &[]);
}

/// A setting of the rig file that tests judge by: its unit is tested again, and nothing else.
#[test]
fn a_changed_setting_is_refused_until_its_unit_was_tested_with_it() {
    let folder = folder();
    let text = expect(folder.path(), "check --print", 0, &[]).out;
    let file = folder.path().join("my.toml");
    let write = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        std::fs::write(&file, text.replacen(from, to, 1)).unwrap();
    };
    write("", "");
    let at = "--rig my.toml --link fast";
    let hold = format!("hold {at} --duration 0.2");
    expect(
        folder.path(),
        &format!("bring-up {at} --weight 500"),
        0,
        &[],
    );
    // Of the controller: no test has looked at it.
    write("kp = 0.2 ", "kp = 0.21 ");
    let said = expect(folder.path(), &hold, 0, &[]);
    assert!(
        said.err.contains("another content; no test judges by that"),
        "{said:?}"
    );
    write("number = 1 ", "coulomb_n = 0.95\nnumber = 1 ");
    let what = "coulomb_n of unit 1 was 0.909 and is 0.95";
    expect(folder.path(), &hold, 2, &[what, "nothing was driven"]);
    let said = expect(folder.path(), &format!("bring-up {at}"), 0, &[]);
    assert!(said.err.contains(what), "{said:?}");
    for (test, again) in [("reels", false), ("motors", true), ("tension", true)] {
        assert_eq!(said.err.contains(&format!("test `{test}`")), again);
    }
    expect(folder.path(), &hold, 0, &[]);
}

/// An experiment on a board: its rig has no seed, and its record is that of the rig's name.
#[test]
fn an_experiment_with_a_rig_of_which_a_part_was_exchanged_does_not_begin() {
    let folder = folder();
    let text = expect(folder.path(), "check --print", 0, &[]).out;
    std::fs::write(folder.path().join("my.toml"), text).unwrap();
    let at = "--rig my.toml --link serial:no-such-port --direct";
    let serials = |motor: &str| {
        let line = format!("calibrate serials {at} --unit 2 --motor {motor} --replace");
        expect(folder.path(), &line, 0, &[]);
    };
    serials("M-1");
    // What a bring-up leaves behind, of this rig.
    let mut serial_numbers = [[""; 4]; 6];
    serial_numbers[1][1] = "M-1";
    leave_record(folder.path(), "", serial_numbers);
    // A clamped tip: a virtual robot has a rig of its own.
    let robot = "[robot]\nkind = \"static\"\nposition_m = [-0.080, 0.025, -0.140]\n";
    let text = expect(folder.path(), "experiment check --print", 0, &[]).out;
    let (head, rest) = text.split_once("[robot]").unwrap();
    let (_, rest) = rest.split_once("[force]").unwrap();
    let text = format!("{head}rig = \"my.toml\"\n{robot}[force]{rest}");
    std::fs::write(folder.path().join("clamped.toml"), text).unwrap();
    let at = "--link serial:no-such-port --direct --out day";
    let experiment = &format!("experiment run clamped.toml --quick {at}");
    let what = "the motor of unit 2 was M-1 and is M-2";
    let said = run(folder.path(), experiment);
    assert!(!said.err.contains("since the bring-up"), "{said:?}");
    serials("M-2");
    expect(folder.path(), experiment, 2, &[what, "nothing was driven"]);
    let of_its_own = ["the robot is virtual", "nothing was driven"];
    expect(
        folder.path(),
        "experiment run --quick --link usb",
        2,
        &of_its_own,
    );
}

/// The file of a bring-up, in the store that there is.
fn record_path(folder: &Path) -> PathBuf {
    let files = walk(&folder.join("state"));
    let current = files.iter().find(|path| path.ends_with("current.toml"));
    current.expect("a store").with_file_name("bring-up.json")
}

/// What the package's client is told that asks for a hold and for a force.
#[cfg(unix)]
fn by_python(folder: &Path) -> String {
    let client = concat!(env!("CARGO_MANIFEST_DIR"), "/../python/forcerig");
    let program = "import _client\n\
        with _client.connect() as rig:\n    \
            for ask in (rig.hold, lambda: rig.set_force([0, 1, 0], 1)):\n        \
                try:\n            print(ask())\n        \
                except _client.RigError as error:\n            print(error.code, error)\n";
    let output = std::process::Command::new("python3")
        .args(["-c", program])
        .env("PYTHONPATH", client)
        .env("FORCECTL_RUNTIME_DIR", folder.join("run"))
        .output()
        .expect("python3 runs");
    common::said(&output).out
}

/// What a bring-up leaves behind, in the store that there is.
fn leave_record(folder: &Path, board: &str, serials: [[&str; 4]; 6]) {
    let record = serde_json::json!({"schema": 2, "rig": "raven-left-example", "tests": {}, "figures": {}, "mistakes": [],
        "identity": {"board": board, "rig_hash": "", "serials": serials}});
    std::fs::write(record_path(folder), record.to_string()).unwrap();
}

/// Two rigs whose rig files were exchanged: the file's record names the other rig's board.
#[cfg(unix)]
#[test]
fn a_rig_file_of_another_board_drives_nothing() {
    let folder = folder();
    let text = expect(folder.path(), "check --print", 0, &[]).out;
    std::fs::write(folder.path().join("my.toml"), text).unwrap();
    let board = board::Board::start(3);
    let at = format!("--rig my.toml --link serial:{}", board.port);
    let status = expect(folder.path(), &format!("status {at} --direct"), 0, &[]).out;
    let number = status
        .lines()
        .find_map(|line| line.strip_prefix("board "))
        .expect("the board's number")
        .trim();
    expect(
        folder.path(),
        &format!("calibrate serials {at} --direct --unit 2 --motor M-1 --replace"),
        0,
        &[],
    );
    let other = "003100253039510D34313737";
    leave_record(folder.path(), other, [[""; 4]; 6]);
    let done = r#""tests":{"reels":{"3":"2026-11-26"}}"#;
    let path = record_path(folder.path());
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace(r#""tests":{}"#, done)).unwrap();
    let what = format!("the board was {other} and is {number}");
    for command in [
        "zero --direct",
        "hold --direct --duration 1",
        "identify --direct --out found",
        "calibrate zero --direct --yes",
        "calibrate gain --direct --yes",
        "calibrate push --direct",
        "set-force 0 1 0 --direct --duration 1",
        // These go through the service that the first one starts.
        "arm",
        "zero",
        "hold --duration 1",
        "set-force 0 1 0 --duration 1",
        "identify --out found",
        "calibrate push",
    ] {
        let line = format!("{command} {at}");
        expect(folder.path(), &line, 2, &[&what, "nothing was driven"]);
    }
    let status = expect(folder.path(), &format!("status {at} --json"), 0, &[]).out;
    let status: Value = serde_json::from_str(&status).unwrap();
    let state = &status["status"]["units"][0]["state"];
    assert_eq!(state, 0, "nothing was configured: {status}");
    let asked = by_python(folder.path());
    assert_eq!(asked.matches(&what).count(), 2, "{asked}");
    // What ends a drive and the bring-up itself are not refused for it.
    expect(folder.path(), &format!("clear {at}"), 0, &[]);
    expect(folder.path(), &format!("disarm {at}"), 0, &[]);
    let said = run(folder.path(), &format!("bring-up {at} --yes"));
    assert!(said.err.contains("every test begins anew"), "{said:?}");
    // It was broken off: the new board is as untested as before.
    expect(
        folder.path(),
        &format!("hold {at} --direct"),
        2,
        &[&what, "it was begun; `reels` is open"],
    );
    // The right board is used.
    leave_record(folder.path(), number, [[""; 4]; 6]);
    expect(folder.path(), &format!("zero {at}"), 0, &["zero code"]);
}

/// Files of a folder and of those in it.
fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .flat_map(|entry| match entry.path() {
            path if path.is_dir() => walk(&path),
            path => vec![path],
        })
        .collect()
}

/// The load cells agree with a wrong geometry; the cables' lengths do not, and `verify` says what
/// is wrong.
#[test]
fn a_wrong_geometry_is_named_by_verify() {
    let folder = folder();
    let text = expect(folder.path(), "check --print", 0, &[]).out;
    let of_unit = |number: usize| -> (String, String) {
        let from = text.find(&format!("number = {number}")).expect("the unit");
        let line = |key: &str| {
            let lines = text[from..].lines();
            let line = lines.into_iter().find(|line| line.starts_with(key));
            line.expect("its key").to_owned()
        };
        (line("exit_m"), line("axis"))
    };
    let ((exit_a, axis_a), (exit_b, axis_b)) = (of_unit(1), of_unit(2));
    let exchanged = (text.replace(&exit_a, "EXIT").replace(&axis_a, "AXIS"))
        .replace(&exit_b, &exit_a)
        .replace(&axis_b, &axis_a)
        .replace("EXIT", &exit_b)
        .replace("AXIS", &axis_b);
    std::fs::write(folder.path().join("wrong.toml"), exchanged).unwrap();
    let verify = "calibrate verify --link fast --duration 4";
    expect(
        folder.path(),
        &format!("{verify} --rig wrong.toml"),
        6,
        &[
            "DISAGREES",
            "what fits: exits 1 and 2 exchanged in the rig file",
        ],
    );
    let said = run(folder.path(), verify);
    assert!(!said.out.contains("what fits"), "{said:?}");
}

/// A service refuses a clear that a stop overtakes. The link is there, so that is no lost link.
#[cfg(unix)]
#[test]
fn a_clear_beside_stops_is_refused_with_the_code_of_a_stop() {
    let board = board::Board::start(4);
    let folder = folder();
    let at = format!("--link serial:{}", board.port);
    expect(folder.path(), &format!("status {at}"), 0, &[]);
    let over = std::sync::atomic::AtomicBool::new(false);
    let codes = std::thread::scope(|scope| {
        let stops = || {
            while !over.load(std::sync::atomic::Ordering::Relaxed) {
                run(folder.path(), &format!("stop {at}"));
            }
        };
        scope.spawn(stops);
        scope.spawn(stops);
        let codes: Vec<_> = (0..40)
            .map(|_| run(folder.path(), &format!("clear {at}")))
            .collect();
        over.store(true, std::sync::atomic::Ordering::Relaxed);
        codes
    });
    for said in &codes {
        assert!(matches!(said.code, Some(0 | 5)), "{said:?}");
    }
    assert!(codes.iter().any(|said| said.code == Some(5)), "{codes:?}");
}
