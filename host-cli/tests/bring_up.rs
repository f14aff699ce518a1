//! `forcectl bring-up` on the rig without an emulated controller, and what its record does to commands that drive.

mod common;

use common::{expect, folder, run};
use serde_json::Value;

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
    ] {
        expect(folder.path(), command, 2, &[what, "nothing was driven"]);
    }
    // Tested again, it is driven again.
    let said = expect(folder.path(), &format!("bring-up {RIG}"), 0, &[]);
    assert!(
        said.err.contains(what) && said.err.contains("every test begins anew"),
        "{said:?}"
    );
    expect(folder.path(), hold, 0, &[]);
}
