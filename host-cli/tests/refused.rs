//! Files and values that the program refuses, and what a rig can't do, in words.

#![cfg(all(unix, feature = "estimate"))]

mod common;

use common::{expect, folder};

#[test]
fn a_plant_that_cannot_be_is_refused_with_its_file() {
    let folder = folder();
    let text = "[drive]\nencoder_counts_per_turn = 0\n";
    std::fs::write(folder.path().join("plant.toml"), text).expect("written");
    for command in ["status --link fast", "set-force 0 1 0 --link fast", "rig"] {
        for (file, what) in [("plant.toml", "encoder_counts_per_turn"), ("none.toml", "")] {
            let option = format!("--plant {file}");
            let line = format!("{command} {option}");
            expect(folder.path(), &line, 2, &[&format!("{option}: "), what]);
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_port_that_cannot_be_opened_is_told_as_that() {
    let folder = folder();
    let long = format!("serial:/dev/serial/by-id/usb-{}-if02", "x".repeat(120));
    for (link, words) in [
        ("serial:-t", "port -t can't be opened"),
        (long.as_str(), "-if02 can't be opened"),
    ] {
        let said = expect(folder.path(), &format!("status --link {link}"), 4, &[words]);
        assert!(!said.err.contains("too long"), "{said:?}");
    }
    // No terminal. It is this process that has it open.
    let said = expect(
        folder.path(),
        "status --link serial:/dev/null --direct",
        4,
        &[],
    );
    assert!(!said.err.contains("process self"), "{said:?}");
}

#[test]
fn a_picture_of_the_monitor_never_replaces_what_is_read() {
    let folder = folder();
    let names = ["rig.toml", "plant.toml", "a.model", "robot.toml"];
    let read = |name: &str| std::fs::read(folder.path().join(name)).expect("is there");
    for name in names {
        std::fs::write(folder.path().join(name), name).expect("written");
    }
    let before = names.map(read);
    for name in names {
        let line = "monitor --link fast --rig rig.toml --plant plant.toml --estimate a.model --robot robot.toml --picture";
        expect(
            folder.path(),
            &format!("{line} {name}"),
            2,
            &["would be lost"],
        );
        assert!(names.map(read) == before, "{name}");
    }
}

#[test]
fn what_a_rig_cannot_do_is_told_in_words() {
    let folder = folder();
    let words = [
        "along +x                    not even zero",
        "zero force is out of reach",
    ];
    let said = expect(folder.path(), "workspace --radius 0.3", 0, &words);
    assert!(!said.out.contains("inf"), "{said:?}");
    let said = expect(folder.path(), "workspace", 0, &[]);
    assert!(!said.out.contains("out of reach"), "{said:?}");
    for force in ["0", "-1", "nan"] {
        let line = format!("calibrate verify --link fast --force {force}");
        expect(folder.path(), &line, 2, &[force]);
    }
}

#[test]
fn a_run_too_short_to_tell_whether_the_rig_was_moved_says_so() {
    let folder = folder();
    let line = "calibrate self --link fast --duration 5";
    let untold = "does not tell whether the rig was moved: of unit 1, 2, 3, 4, 5, 6 ";
    let said = expect(folder.path(), &format!("{line} --store"), 6, &[untold]);
    assert!(!said.out.contains("stands where"), "{said:?}");
    assert!(said.out.contains("nothing was stored"), "{said:?}");
    let said = expect(
        folder.path(),
        &format!("{line} --json"),
        6,
        &["\"moved\":null"],
    );
    assert!(said.out.contains("\"version\":null"), "{said:?}");
}
