//! Files and values that the program refuses, and what a rig can't do, in words.

#![cfg(all(unix, feature = "estimate"))]

mod common;

use common::{expect, folder, run};

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

/// Files that have no end, or that are read twice and can't be: each command says so at once.
#[test]
fn a_file_without_an_end_is_refused_by_every_command_that_reads_one() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("dir")).expect("made");
    let made = std::process::Command::new("mkfifo")
        .arg(folder.path().join("fifo"))
        .status();
    assert!(made.expect("mkfifo runs").success());
    std::fs::write(folder.path().join("robot.toml"), "").expect("written");
    std::fs::write(folder.path().join("log.csv"), "t\n1800000000\n").expect("written");
    for (command, code) in [
        ("recording check FILE", 2),
        ("recording export FILE --out out", 2),
        (
            "recording merge FILE --log log.csv --time t --out o.parquet",
            2,
        ),
        (
            "recording merge robot.toml --log FILE --time t --out o.parquet",
            2,
        ),
        (
            "recording merge robot.toml --log FILE.parquet --time t --out o.parquet",
            2,
        ),
        ("calibrate gain --link fast --unit 3 --readings FILE", 2),
        ("calibrate geometry --link fast --yes --points FILE", 2),
        (
            "calibrate geometry --link fast --yes --points robot.toml --base FILE",
            2,
        ),
        ("calibrate diff ./FILE --link fast", 2),
        ("check FILE", 3),
        ("status --link fast --rig FILE", 3),
        ("status --link fast --plant FILE", 2),
        ("init new.toml --answers FILE", 2),
        ("experiment check FILE", 2),
        ("experiment run FILE", 2),
        ("estimate train FILE --out a.model", 2),
        ("residual --data FILE --model new.toml --init", 3),
        ("residual --data robot.toml --model FILE", 2),
    ] {
        for file in ["fifo", "/dev/zero", "dir"] {
            let suffix = ["FILE.parquet", "./FILE"]
                .iter()
                .any(|name| command.contains(name));
            // A folder is a recording, an experiment's data or a log.
            let takes_folder = ["recording", "estimate train", "--data FILE"];
            let folder_may_be = takes_folder.iter().any(|word| command.contains(word));
            // A text may come from a pipe, as from `<(...)` of a shell.
            let texts = ["calibrate", "init", "experiment", "--plant", "--model FILE"];
            let is_text = texts.iter().any(|word| command.contains(word));
            let pipe_may_be = is_text && file == "fifo";
            if suffix && file != "fifo" || folder_may_be && file == "dir" || pipe_may_be {
                continue;
            }
            if command.contains("FILE.parquet") {
                let link = folder.path().join("fifo.parquet");
                let _ = std::os::unix::fs::symlink("fifo", link);
            }
            let line = command.replace("FILE", file);
            let said = run(folder.path(), &format!("{line} --json"));
            assert_eq!(said.code, Some(code), "{line}: {said:?}");
            let words = ["not a regular file", "Not a directory"];
            assert!(
                words.iter().any(|word| said.out.contains(word)),
                "{line}: {said:?}"
            );
        }
    }
}

#[test]
fn codes_of_what_was_not_read_or_asked_for_wrongly_are_those_of_the_table() {
    let folder = folder();
    for line in [
        "calibrate gain --link fast --unit 3 --yes --gravity 5",
        "calibrate gain --link fast --unit 9 --yes",
        "calibrate gain --link fast --unit 3 --readings w.csv --correct 99=5",
        "calibrate gain --link fast --unit 3 --readings w.csv --leave-out 99",
        "calibrate serials --link fast --unit 9 --cell X",
        "calibrate show 99 --link fast",
        "calibrate diff 99 --link fast",
        "calibrate use 99 --link fast",
        "recording check none",
        "recording export none",
        "recording export none --out out",
        "recording merge none --log w.csv --time weight_g --out o.parquet",
    ] {
        let text = "weight_g,code,standard_error\n0,1,1\n100,143001,1\n200,286001,1\n";
        std::fs::write(folder.path().join("w.csv"), text).expect("written");
        let said = expect(folder.path(), line, 2, &[]);
        assert!(!said.out.contains("cut off"), "{said:?}");
    }
    assert!(!folder.path().join("none").exists() && !folder.path().join("out").exists());
}

#[test]
fn direct_without_a_port_is_refused_and_keeps_no_rig_from_being_stopped() {
    let folder = folder();
    for line in [
        "status --direct --link rig:one",
        "set-force 0 1 0 --direct --link fast",
        "clear --direct",
        "experiment run --quick --direct",
    ] {
        expect(folder.path(), line, 2, &["--direct"]);
    }
    let run = folder.path().join("run");
    std::fs::create_dir(&run).expect("made");
    let calls = common::fake::service(&run);
    for line in ["stop --direct --link rig:fake", "stop --direct"] {
        let before = calls.lock().unwrap().len();
        expect(folder.path(), line, 0, &["stopped"]);
        let called = calls.lock().unwrap()[before..].contains(&"stop".to_owned());
        assert!(called, "{line}");
    }
}
