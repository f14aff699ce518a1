//! Rigs that are kept, by their names: which one a command means, and one name for each.

#![cfg(all(unix, feature = "record"))]

mod common;

use common::{fake, folder, said, words, Said};
use std::path::Path;

/// `forcectl` in a folder, without the embedded rig's variables, as on a machine without any rig.
fn forcectl_in(folder: &Path, arguments: &[&str]) -> Said {
    let mut command = common::forcectl(folder, arguments);
    command
        .env_remove("FORCE_RIG_BIN")
        .env_remove("FORCE_FIRMWARE_ELF");
    said(&command.output().expect("forcectl runs"))
}

#[test]
fn a_second_rig_is_advised_to_take_another_name() {
    let folder = folder();
    let run = folder.path().join("run");
    std::fs::create_dir(&run).expect("a folder");
    // What a service of that name holds while it runs.
    let lock = std::fs::File::create(run.join("rig.lock")).expect("a file");
    lock.lock().expect("the lock");
    let second = forcectl_in(folder.path(), &["rig"]);
    assert_eq!(second.code, Some(4), "{second:?}");
    assert!(
        second.err.contains("rig `rig` has a service already") && second.err.contains("--name"),
        "{second:?}"
    );
    // Under another name it is the emulator that is missing here.
    let other = forcectl_in(folder.path(), &["rig", "--name", "other"]);
    assert!(other.err.contains("FORCE_RIG_BIN"), "{other:?}");
}

#[test]
fn without_a_link_the_kept_rig_of_any_name_is_meant() {
    let folder = folder();
    let run = folder.path().join("run");
    std::fs::create_dir(&run).expect("a folder");
    let called = |calls: &fake::Calls, method: &str| {
        let calls = calls.lock().expect("no panic");
        calls.iter().any(|call| call == method)
    };
    let (_one, calls) = fake::kept(&run, "one");
    for (line, method) in [
        ("disarm", "disarm"),
        ("inject unplug=3", "inject"),
        ("monitor --plain --duration 0.1", "subscribe"),
    ] {
        let said = forcectl_in(folder.path(), &words(line));
        assert_eq!(said.code, Some(0), "{line}: {said:?}");
        assert!(said.err.contains("rig `one`"), "{line}: {said:?}");
        assert!(called(&calls, method), "{line}: {calls:?}");
    }
    // Of several without the default name, none.
    let (_two, others) = fake::kept(&run, "two");
    for line in [
        "disarm",
        "zero",
        "clear",
        "status",
        "set-force 0 1 0",
        "record r",
    ] {
        let said = forcectl_in(folder.path(), &words(line));
        assert_eq!(said.code, Some(2), "{line}: {said:?}");
        for text in ["one, two", "--link rig:"] {
            assert!(said.err.contains(text), "{line}: {said:?}");
        }
    }
    assert!(!called(&others, "hello"));
    let (_rig, calls) = fake::kept(&run, "rig");
    let said = forcectl_in(folder.path(), &["disarm"]);
    assert!(said.code == Some(0) && called(&calls, "disarm"), "{said:?}");
}
