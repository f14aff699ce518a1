//! `forcectl estimate` as a program: what a model's card decides, logs that lack columns, the report from end to end.

#![cfg(feature = "estimate")]

use robot::kinematics::{forward, to_crtk};
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

fn forcectl(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_forcectl"))
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .env("FORCECTL_RUNTIME_DIR", folder.join("run"))
        .env("FORCECTL_STATE_DIR", folder.join("state"))
        .output()
        .expect("forcectl runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

/// A log of `seconds` at 50 Hz: a moving arm with a force along y, of which the efforts tell a part. `but`: columns that it lacks.
fn log(folder: &Path, trial: u32, seconds: u32, force_n: f64, but: &[&str]) {
    std::fs::create_dir_all(folder).unwrap();
    let mut columns: Vec<(&str, Vec<f64>)> = Vec::new();
    for k in 0..seconds * 50 {
        let t = f64::from(k) * 0.02;
        let phase = f64::from(trial) * 1.7;
        let angle = |amplitude: f64, rate: f64| {
            let at = rate * t + phase;
            (amplitude * at.sin(), amplitude * rate * at.cos())
        };
        let moves = [angle(0.3, 0.9), angle(0.25, 1.3), angle(0.03, 0.7)];
        let q = [0.7 + moves[0].0, 1.4 + moves[1].0, 0.38 + moves[2].0];
        let tip = to_crtk(forward(&[q[0], q[1], q[2], 0.0, 0.0, 0.0]).position_m);
        let force = force_n * (0.31 * t + 2.0 * phase).sin();
        let effort = |joint: usize| {
            let friction = 0.4 * (moves[joint].1 / 0.02).tanh();
            friction + [0.2, -0.3, 0.5][joint] * force + 0.6 * q[1].sin()
        };
        let row = [
            ("t_s", t),
            ("joint_position_1", q[0]),
            ("joint_position_2", q[1]),
            ("joint_position_3", q[2]),
            ("joint_velocity_1", moves[0].1),
            ("joint_velocity_2", moves[1].1),
            ("joint_velocity_3", moves[2].1),
            ("joint_effort_1", effort(0)),
            ("joint_effort_2", effort(1)),
            ("joint_effort_3", effort(2)),
            ("force_x_n", 0.0),
            ("force_y_n", force),
            ("force_z_n", 0.0),
            ("tip_x_m", tip.x),
            ("tip_y_m", tip.y),
            ("tip_z_m", tip.z),
            ("quality", 1.0),
            ("trial", f64::from(trial)),
        ];
        if columns.is_empty() {
            columns = row.map(|(name, _)| (name, Vec::new())).into();
            columns.retain(|(name, _)| !but.contains(name));
        }
        for (name, values) in &mut columns {
            let of = row.iter().find(|(n, _)| n == name);
            values.push(of.expect("a column of the row").1);
        }
    }
    let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
    let mut text = names.join(",") + "\n";
    for k in 0..columns[0].1.len() {
        let cells: Vec<String> = columns.iter().map(|(_, v)| v[k].to_string()).collect();
        writeln!(text, "{}", cells.join(",")).unwrap();
    }
    std::fs::write(folder.join(format!("trial-{trial}.csv")), text).unwrap();
    // What an experiment's data card tells of robot and force.
    let card = r#"{"experiment": {"robot": {"kind": "virtual", "seed": 1}, "force": {"kind": "one_axis", "axis": [0, 1, 0]}}}"#;
    std::fs::write(folder.join("card.json"), card).unwrap();
}

/// Three trials of 30 s.
fn day(folder: &Path, force_n: f64, but: &[&str]) {
    for trial in 1..4 {
        log(folder, trial, 30, force_n, but);
    }
}

#[test]
fn without_a_card_no_trial_is_taken_for_unseen() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    let train = [
        "estimate",
        "train",
        "day",
        "--model",
        "linear",
        "--no-intervals",
        "--out",
        "a.model",
    ];
    let (code, _, err) = forcectl(folder, &train);
    assert_eq!(code, Some(0), "{err}");
    let eval = ["estimate", "eval", "a.model", "day"];
    let (code, out, err) = forcectl(folder, &eval);
    assert_eq!(code, Some(0), "{err}");
    assert!(out.contains("trials [3], 1000 rows"), "{out}");

    let card = folder.join("a.card.json");
    let text = std::fs::read_to_string(&card).unwrap();
    let at = text.find("\"mae_n\": ").expect("a figure");
    let end = at + text[at..].find(',').expect("more figures");
    let broken = format!("{}\"mae_n\": null{}", &text[..at], &text[end..]);
    std::fs::write(&card, broken).unwrap();
    for what in ["cannot be read as a model card", "No such file"] {
        let (code, out, err) = forcectl(folder, &eval);
        assert_eq!(code, Some(2), "{out}");
        assert!(
            err.contains("a.card.json") && err.contains(what) && err.contains("--trials"),
            "{err}"
        );
        // Who names the trials needs no card.
        let (code, out, err) = forcectl(folder, &[&eval[..], &["--trials", "2"]].concat());
        assert_eq!(code, Some(0), "{err}");
        assert!(out.contains("trials [2]"), "{out}");
        let _ = std::fs::remove_file(&card);
    }
}

#[test]
fn a_force_without_a_range_leaves_a_card_that_can_be_read() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    day(&folder.join("still"), 0.0, &[]);
    let train = [
        "estimate",
        "train",
        "still",
        "--model",
        "zero",
        "--no-intervals",
        "--out",
        "z.model",
    ];
    let (code, _, err) = forcectl(folder, &train);
    assert_eq!(code, Some(0), "{err}");
    let (code, out, err) = forcectl(folder, &["estimate", "eval", "z.model", "still"]);
    assert_eq!(code, Some(0), "{err}");
    assert!(
        out.contains("trials [3]") && out.contains("NRMSE -\n"),
        "{out}"
    );

    // Ten seconds are left out: a log that is not longer has no figure.
    log(&folder.join("short"), 9, 9, 1.0, &[]);
    let (code, _, err) = forcectl(folder, &["estimate", "eval", "z.model", "short"]);
    assert_eq!(code, Some(2));
    assert!(err.contains("no row is left to test on"), "{err}");
}

#[test]
fn a_log_without_an_effort_is_refused_or_has_a_model_of_its_own() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    day(&folder.join("whole"), 3.0, &[]);
    day(&folder.join("less"), 3.0, &["joint_effort_1"]);
    let train = |data: &'static str, out: &'static str| {
        vec![
            "estimate",
            "train",
            data,
            "--model",
            "linear",
            "--no-intervals",
            "--out",
            out,
        ]
    };
    let (code, _, err) = forcectl(folder, &train("less", "less.model"));
    assert_eq!(code, Some(2));
    assert!(
        err.contains("`joint_effort_1`") && err.contains("absent = true"),
        "{err}"
    );
    std::fs::write(
        folder.join("less.toml"),
        "effort = [{ absent = true }, { column = \"joint_effort_2\" }, { column = \"joint_effort_3\" }]\n",
    )
    .unwrap();
    let with = ["--mapping", "less.toml"];
    let (code, out, err) = forcectl(folder, &[&train("less", "less.model")[..], &with].concat());
    assert_eq!(code, Some(0), "{err}");
    assert!(out.contains("joint_effort_1 (absent)"), "{out}");

    // On logs with and without the column the model gives the same figures: it does not look at it.
    let mae = |arguments: &[&str]| {
        let (code, out, err) = forcectl(folder, arguments);
        assert_eq!(code, Some(0), "{err}");
        let line = out
            .lines()
            .find(|l| l.starts_with("MAE"))
            .map(str::to_owned);
        line.expect("a figure")
    };
    let on = |data: &'static str| vec!["estimate", "eval", "less.model", data, "--trials", "3"];
    assert_eq!(mae(&on("whole")), mae(&[&on("less")[..], &with].concat()));

    // A model of all inputs has no use for a log that lacks one.
    let (code, _, err) = forcectl(folder, &train("whole", "whole.model"));
    assert_eq!(code, Some(0), "{err}");
    let eval = [
        "estimate",
        "eval",
        "whole.model",
        "less",
        "--mapping",
        "less.toml",
    ];
    let (code, _, err) = forcectl(folder, &eval);
    assert_eq!(code, Some(2));
    assert!(
        err.contains("joint_effort_1") && err.contains("which these data lack"),
        "{err}"
    );
}

#[test]
fn a_report_goes_through_all_input_groups() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    log(&folder.join("more"), 7, 30, 3.0, &[]);
    let report = [
        "estimate",
        "report",
        "day",
        "--into",
        "page",
        "--unseen",
        "more",
        "--also",
        "itself=more",
        "--group-minutes",
        "1",
        // Fewer rows: the models are poor, the way through all of them is the same.
        "--rate",
        "10",
    ];
    let (code, out, err) = forcectl(folder, &report);
    assert_eq!(code, Some(0), "{err}");
    assert!(
        err.contains("model `hybrid`") && err.contains("input groups"),
        "{err}"
    );
    let page = std::fs::read_to_string(folder.join("page/figures.md")).unwrap();
    assert_eq!(page.trim(), out.trim());
    for words in [
        "| all positions | ",
        "| shipped model: MAE at most 0.25 N | ",
        "and the 1 trials of `more`",
        "| itself | hybrid | ",
        "| 60 chosen minutes match 160 random ones | not tried | - |",
    ] {
        assert!(page.contains(words), "{words}: {page}");
    }
    // The 12 columns of the table of models, and the page's end.
    assert!(page.contains("| epochs | training, s |"), "{page}");
    assert!(!page.contains("Unfinished"), "{page}");
    for picture in ["prediction", "trajectory", "errors", "speed", "maps"] {
        let path = folder.join(format!("page/{picture}.svg"));
        assert!(path.is_file(), "{picture}");
    }
    // The same trials again are no unseen ones.
    let again = [
        "estimate", "report", "day", "--into", "page", "--unseen", "day",
    ];
    let (code, _, err) = forcectl(folder, &again);
    assert_eq!(code, Some(2));
    assert!(err.contains("is a file of day too"), "{err}");
}

#[test]
fn a_report_refuses_before_it_trains() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    for trial in 1..3 {
        log(&folder.join("two"), trial, 30, 3.0, &[]);
    }
    log(&folder.join("one"), 8, 30, 3.0, &[]);
    let train = |model: &'static str, more: &[&'static str]| {
        let start = ["estimate", "train", "day", "--model", "linear", "--out"];
        let arguments = [&start[..], &[model, "--no-intervals"], more].concat();
        let (code, _, err) = forcectl(folder, &arguments);
        assert_eq!(code, Some(0), "{err}");
    };
    train("fast.model", &[]);
    train("all.model", &["--rate", "10", "--all-axes"]);
    std::fs::write(folder.join("file"), "").unwrap();
    let refused = |data: &str, more: &[&str], exit: i32, words: &[&str]| {
        let start = ["estimate", "report", data, "--rate", "10"];
        let (code, _, err) = forcectl(folder, &[&start[..], more].concat());
        assert_eq!(code, Some(exit), "{err}");
        for word in words {
            assert!(err.contains(word), "{word}: {err}");
        }
        assert!(!err.contains("model `zero`"), "{err}");
    };
    let page = ["--into", "page"];
    let with = |more: &[&'static str]| [&page[..], more].concat();
    refused(
        "day",
        &["--into", "file/page"],
        7,
        &["file/page", "cannot be written"],
    );
    refused("two", &page, 2, &["two", "at least 3 trials"]);
    refused(
        "day",
        &with(&["--three-axes", "one"]),
        2,
        &["one", "--three-axes needs at least 2 trials"],
    );
    refused(
        "day",
        &with(&["--with", "fast.model"]),
        2,
        &["fast.model", "rate (50.00 Hz, 10.00 Hz)"],
    );
    refused(
        "day",
        &with(&["--with", "all.model"]),
        2,
        &[
            "all.model",
            "components of the force ([0, 1, 2], [1]; 0 is x)",
        ],
    );
    // Of 30 s in each of six trials 10 s are left.
    for trial in 1..9 {
        log(&folder.join("long"), trial, 30, 3.0, &[]);
    }
    refused(
        "long",
        &with(&["--group-minutes", "1"]),
        2,
        &["--group-minutes 1", "trial 1 of long"],
    );
    // Nothing was written, and nothing is left of the probing.
    assert_eq!(std::fs::read_dir(folder.join("page")).unwrap().count(), 0);
}

#[test]
fn a_file_of_a_dataset_is_of_the_robot_of_its_card() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    let train = |model: &'static str, kind: &'static str| {
        let arguments = [
            "estimate",
            "train",
            "day",
            "--model",
            kind,
            "--no-intervals",
            "--out",
            model,
        ];
        let (code, _, err) = forcectl(folder, &arguments);
        assert_eq!(code, Some(0), "{err}");
    };
    train("m.1", "linear");
    train("m.2", "zero");
    let replay = |log: &str| forcectl(folder, &["estimate", "run", "m.1", "--replay", log]);
    let (code, out, err) = replay("day/trial-2.csv");
    assert_eq!(code, Some(0), "{err}");
    assert!(out.contains("1500 rows, begun anew 0 times"), "{out}");
    assert!(!err.contains("names the robot"), "{err}");

    // The same log alone, then beside the card of another robot.
    std::fs::create_dir(folder.join("other")).unwrap();
    std::fs::copy(folder.join("day/trial-2.csv"), folder.join("other/log.csv")).unwrap();
    let (code, _, err) = replay("other/log.csv");
    assert_eq!(code, Some(0), "{err}");
    assert!(
        err.contains("names the robot of this log") && err.contains("`virtual seed 1`"),
        "{err}"
    );
    let card = std::fs::read_to_string(folder.join("day/card.json")).unwrap();
    let card = card.replace("\"seed\": 1", "\"seed\": 2");
    std::fs::write(folder.join("other/card.json"), card).unwrap();
    let (code, _, err) = replay("other/log.csv");
    assert_eq!(code, Some(2));
    assert!(err.contains("these data are of `virtual seed 2`"), "{err}");

    // Each model has its own card, and takes no other.
    let eval = ["estimate", "eval", "m.1", "day"];
    let (code, out, err) = forcectl(folder, &eval);
    assert_eq!(code, Some(0), "{err}");
    assert!(out.contains("model linear on day"), "{out}");
    std::fs::copy(folder.join("m.2.card.json"), folder.join("m.1.card.json")).unwrap();
    let (code, _, err) = forcectl(folder, &eval);
    assert_eq!(code, Some(2));
    assert!(
        err.contains("m.1.card.json") && err.contains("card of another model file"),
        "{err}"
    );
}

#[test]
fn trials_without_numbers_and_a_single_trial_are_refused() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    log(&folder.join("one"), 1, 30, 3.0, &[]);
    let train = |data: &'static str| {
        let start = ["estimate", "train", data, "--model", "linear"];
        forcectl(
            folder,
            &[&start[..], &["--no-intervals", "--out", "a.model"]].concat(),
        )
    };
    let (code, _, err) = train("one");
    assert_eq!(code, Some(2));
    assert!(
        err.contains("one") && err.contains("none is left for testing"),
        "{err}"
    );
    // T1 in place of 1.
    day(&folder.join("text"), 3.0, &[]);
    let file = folder.join("text/trial-1.csv");
    let text = std::fs::read_to_string(&file).unwrap();
    let rows: Vec<String> = (text.lines())
        .map(|line| {
            line.strip_suffix(",1")
                .map_or(line.to_owned(), |l| l.to_owned() + ",T1")
        })
        .collect();
    assert!(rows[1].ends_with(",T1"), "{}", rows[1]);
    std::fs::write(&file, rows.join("\n") + "\n").unwrap();
    let (code, _, err) = train("text");
    assert_eq!(code, Some(2));
    for word in ["trial-1.csv", "`trial`", "line 2", "`trial = \"\"`"] {
        assert!(err.contains(word), "{word}: {err}");
    }
}

#[test]
fn an_exported_network_has_a_card_of_its_inputs() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    let train = [
        "estimate",
        "train",
        "day",
        "--model",
        "carried-gru",
        "--no-intervals",
        "--rate",
        "10",
        "--limit",
        "0.1",
        "--epochs",
        "100000",
        "--out",
        "net.model",
    ];
    let (code, out, err) = forcectl(folder, &train);
    if err.contains("built without neural networks") {
        return;
    }
    assert_eq!(code, Some(0), "{err}");
    assert!(
        out.contains("of 100000; --limit ended the training"),
        "{out}"
    );
    let before = std::fs::read(folder.join("net.model")).unwrap();
    let export = |out: &str| forcectl(folder, &["estimate", "export", "net.model", "--out", out]);
    let (code, _, err) = export("./net.model");
    assert_eq!(code, Some(2));
    assert!(err.contains("is the model file and would be lost"), "{err}");
    assert_eq!(std::fs::read(folder.join("net.model")).unwrap(), before);
    let (code, _, err) = export("net.onnx");
    assert_eq!(code, Some(0), "{err}");
    let card = std::fs::read_to_string(folder.join("net.onnx.card.json")).unwrap();
    for words in [
        "\"joint_1\"",
        "\"torque_force_z\"",
        "\"rate_hz\": 10.0",
        "\"window\": 1,",
        "\"force_y (N)\"",
        "\"robot\": \"virtual seed 1\"",
    ] {
        assert!(card.contains(words), "{words}: {card}");
    }
    assert_eq!(card.matches("\"unit\"").count(), 18);
}
