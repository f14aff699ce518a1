//! `forcectl estimate` as a program: what a model's card decides, logs that lack columns, the
//! report from end to end.

#![cfg(feature = "estimate")]

mod common;

use common::logs::{day, log};
use common::{expect, folder, run};
use experiment::table::Table;
use std::path::Path;

/// A quick training on a folder of logs; the rest of a line.
const LINEAR: &str = "--model linear --no-intervals --out";

/// Logs in `day`, and a model of them in `a.model`.
fn trained(folder: &Path) {
    day(&folder.join("day"), 3.0, &[]);
    let line = format!("estimate train day {LINEAR} a.model");
    expect(folder, &line, 0, &[]);
}

#[test]
fn without_a_card_no_trial_is_taken_for_unseen() {
    let temporary = folder();
    let folder = temporary.path();
    trained(folder);
    let eval = "estimate eval a.model day";
    expect(folder, eval, 0, &["trials [3], 1000 rows"]);

    let card = folder.join("a.card.json");
    let text = std::fs::read_to_string(&card).unwrap();
    let at = text.find("\"mae_n\": ").expect("a figure");
    let end = at + text[at..].find(',').expect("more figures");
    let broken = format!("{}\"mae_n\": null{}", &text[..at], &text[end..]);
    std::fs::write(&card, broken).unwrap();
    for what in ["cannot be read as a model card", "No such file"] {
        expect(folder, eval, 2, &["a.card.json", what, "--trials"]);
        // Who names the trials needs no card.
        expect(folder, &format!("{eval} --trials 2"), 0, &["trials [2]"]);
        let _ = std::fs::remove_file(&card);
    }
}

#[test]
fn an_output_of_estimate_never_replaces_what_is_read() {
    let temporary = folder();
    let folder = temporary.path();
    trained(folder);
    std::fs::write(folder.join("map.toml"), "robot = \"mine\"\n").unwrap();
    std::fs::write(folder.join("robot.toml"), "[robot]\n").unwrap();
    std::fs::copy(folder.join("day/trial-3.csv"), folder.join("alone.csv")).unwrap();
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let names = [
        "a.model",
        "map.toml",
        "robot.toml",
        "alone.csv",
        "day/trial-1.csv",
        "day/trial-3.csv",
    ];
    let before = names.map(read);
    let run = "estimate run a.model --replay alone.csv --mapping map.toml";
    let of_day = "estimate run a.model --replay day/trial-3.csv";
    let live = "estimate run a.model --robot robot.toml";
    let train = "estimate train day --model zero --no-intervals --mapping map.toml";
    let recalibrate = "estimate recalibrate a.model alone.csv";
    for (line, words) in [
        (format!("{run} --out alone.csv"), "would be lost"),
        (format!("{run} --plot alone.csv"), "would be lost"),
        (format!("{run} --out a.model"), "would be lost"),
        (format!("{run} --plot ./a.model"), "would be lost"),
        (format!("{run} --out map.toml"), "would be lost"),
        (
            format!("{run} --out new --plot new"),
            "--out is the same file",
        ),
        (
            format!("{of_day} --out day/trial-1.csv"),
            "it would lie in day",
        ),
        (
            format!("{of_day} --plot day/new.svg"),
            "it would lie in day",
        ),
        (format!("{live} --out robot.toml"), "would be lost"),
        (
            format!("{train} --out day/trial-1.csv"),
            "it would lie in day",
        ),
        (
            format!("{train} --out day/new.model"),
            "it would lie in day",
        ),
        (format!("{train} --out map.toml"), "would be lost"),
        (format!("{recalibrate} --out a.model"), "would be lost"),
        (format!("{recalibrate} --out alone.csv"), "would be lost"),
        (format!("{train} --out ."), "no regular file"),
    ] {
        expect(folder, &line, 2, &[words]);
        assert!(names.map(read) == before, "{line}: a file was changed");
    }
    assert!(!folder.join("new").exists());
    // A file that no command reads is replaced.
    std::fs::write(folder.join("old.svg"), "").unwrap();
    expect(
        folder,
        "estimate run a.model --replay alone.csv --plot old.svg",
        0,
        &[],
    );
    assert!(read("old.svg").starts_with(b"<svg"));
}

#[test]
fn figures_on_trials_of_the_training_are_called_so() {
    let temporary = folder();
    let folder = temporary.path();
    trained(folder);
    let eval = |trials: &str| {
        let line = format!("estimate eval a.model day --trials {trials}");
        expect(folder, &line, 0, &[])
    };
    let trained = eval("1");
    assert!(
        trained.err.contains("was trained on trial 1 of"),
        "{trained:?}"
    );
    assert!(!trained.out.contains("over trials"), "{trained:?}");
    let both = eval("1,2,3");
    assert!(
        both.err.contains("was trained on trial 1, 2 of"),
        "{both:?}"
    );
    assert!(both.out.contains("N (95 % over trials)"), "{both:?}");
    let unseen = eval("3");
    assert!(!unseen.err.contains("was trained on"), "{unseen:?}");
}

#[test]
fn a_force_without_a_range_leaves_a_card_that_can_be_read() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("still"), 0.0, &[]);
    let train = "estimate train still --model zero --no-intervals --out z.model";
    expect(folder, train, 0, &[]);
    let figures = ["trials [3]", "NRMSE -\n"];
    expect(folder, "estimate eval z.model still", 0, &figures);

    // Ten seconds are left out: a log that is not longer has no figure.
    log(&folder.join("short"), 9, 9, 1.0, &[]);
    let eval = "estimate eval z.model short";
    expect(folder, eval, 2, &["no row is left to test on"]);
}

#[test]
fn a_log_without_an_effort_is_refused_or_has_a_model_of_its_own() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("whole"), 3.0, &[]);
    day(&folder.join("less"), 3.0, &["joint_effort_1"]);
    let train = format!("estimate train less {LINEAR} less.model");
    expect(folder, &train, 2, &["`joint_effort_1`", "absent = true"]);
    std::fs::write(
        folder.join("less.toml"),
        "effort = [{ absent = true }, { column = \"joint_effort_2\" }, { column = \"joint_effort_3\" }]\n",
    )
    .unwrap();
    let with = "--mapping less.toml";
    let trained = expect(folder, &format!("{train} {with}"), 0, &[]);
    assert!(trained.out.contains("joint_effort_1 (absent)"));

    // On logs with and without the column the model gives the same figures: it does not look at it.
    let mae = |data: &str| {
        let line = format!("estimate eval less.model {data} --trials 3");
        let said = expect(folder, &line, 0, &[]);
        let mae = said.out.lines().find(|l| l.starts_with("MAE"));
        mae.expect("a figure").to_owned()
    };
    assert_eq!(mae("whole"), mae(&format!("less {with}")));

    // A model of all inputs has no use for a log that lacks one.
    expect(
        folder,
        &format!("estimate train whole {LINEAR} whole.model"),
        0,
        &[],
    );
    let eval = format!("estimate eval whole.model less {with}");
    expect(
        folder,
        &eval,
        2,
        &["joint_effort_1", "which these data lack"],
    );
}

#[test]
fn a_report_goes_through_all_input_groups() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    log(&folder.join("more"), 7, 30, 3.0, &[]);
    // At 10 rows a second the models are poor, the way through all of them is the same.
    let report = "estimate report day --into page --unseen more --also itself=more --group-minutes 1 --rate 10";
    let said = expect(folder, report, 0, &[]);
    for progress in ["model `hybrid`", "input groups"] {
        assert!(said.err.contains(progress), "{said:?}");
    }
    let page = std::fs::read_to_string(folder.join("page/figures.md")).unwrap();
    assert_eq!(page.trim(), said.out.trim());
    for words in [
        "| all positions | ",
        "| shipped model: MAE at most 0.25 N | ",
        "and the 1 trials of `more`",
        "| itself | hybrid | ",
        "| 60 chosen minutes match 160 random ones | not tried | - |",
        // The last of the 12 columns of the table of models.
        "| epochs | training, s |",
    ] {
        assert!(page.contains(words), "{words}: {page}");
    }
    assert!(!page.contains("Unfinished"), "{page}");
    for picture in ["prediction", "trajectory", "errors", "speed", "maps"] {
        let path = folder.join(format!("page/{picture}.svg"));
        assert!(path.is_file(), "{picture}");
    }
    // The same trials again are no unseen ones.
    let again = "estimate report day --into page --unseen day";
    expect(folder, again, 2, &["is a file of day too"]);
}

#[test]
fn a_report_refuses_before_it_trains() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    for trial in 1..3 {
        log(&folder.join("two"), trial, 30, 3.0, &[]);
    }
    log(&folder.join("one"), 8, 30, 3.0, &[]);
    // Of 30 s in each of six trials 10 s are left.
    for trial in 1..9 {
        log(&folder.join("long"), trial, 30, 3.0, &[]);
    }
    for model in ["fast.model", "all.model --rate 10 --all-axes"] {
        expect(
            folder,
            &format!("estimate train day {LINEAR} {model}"),
            0,
            &[],
        );
    }
    std::fs::write(folder.join("file"), "").unwrap();
    let refused: [(&str, i32, &[&str]); 6] = [
        (
            "day --into file/page",
            7,
            &["file/page", "cannot be written"],
        ),
        ("two --into page", 2, &["two", "at least 3 trials"]),
        (
            "day --into page --three-axes one",
            2,
            &["one", "--three-axes needs at least 2 trials"],
        ),
        (
            "day --into page --with fast.model",
            2,
            &["fast.model", "rate (50.00 Hz, 10.00 Hz)"],
        ),
        (
            "day --into page --with all.model",
            2,
            &[
                "all.model",
                "components of the force ([0, 1, 2], [1]; 0 is x)",
            ],
        ),
        (
            "long --into page --group-minutes 1",
            2,
            &["--group-minutes 1", "trial 1 of long"],
        ),
    ];
    for (arguments, code, words) in refused {
        let line = format!("estimate report {arguments} --rate 10");
        let said = expect(folder, &line, code, words);
        assert!(!said.err.contains("model `zero`"), "{said:?}");
    }
    // Nothing was written, and nothing is left of the probing.
    assert_eq!(std::fs::read_dir(folder.join("page")).unwrap().count(), 0);
}

#[test]
fn a_file_of_a_dataset_is_of_the_robot_of_its_card() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    for (model, kind) in [("m.1", "linear"), ("m.2", "zero")] {
        let line = format!("estimate train day --model {kind} --no-intervals --out {model}");
        expect(folder, &line, 0, &[]);
    }
    let replay = |log: &str, code: i32, words: &[&str]| {
        let line = format!("estimate run m.1 --replay {log}");
        expect(folder, &line, code, words)
    };
    let rows = ["1500 rows, begun anew 0 times"];
    let said = replay("day/trial-2.csv", 0, &rows);
    assert!(!said.err.contains("names the robot"), "{said:?}");

    // The same log alone, then beside the card of another robot.
    std::fs::create_dir(folder.join("other")).unwrap();
    std::fs::copy(folder.join("day/trial-2.csv"), folder.join("other/log.csv")).unwrap();
    let warned = replay("other/log.csv", 0, &[]).err;
    let warning = ["names the robot of this log", "`virtual seed 1`"];
    assert!(warning.iter().all(|w| warned.contains(w)), "{warned}");
    let card = std::fs::read_to_string(folder.join("day/card.json")).unwrap();
    let card = card.replace("\"seed\": 1", "\"seed\": 2");
    std::fs::write(folder.join("other/card.json"), card).unwrap();
    replay("other/log.csv", 2, &["these data are of `virtual seed 2`"]);

    // Each model has its own card, and takes no other.
    let eval = "estimate eval m.1 day";
    expect(folder, eval, 0, &["model linear on day"]);
    std::fs::copy(folder.join("m.2.card.json"), folder.join("m.1.card.json")).unwrap();
    let refused = ["m.1.card.json", "card of another model file"];
    expect(folder, eval, 2, &refused);
}

#[test]
fn a_replay_gives_every_estimate_with_its_interval_and_its_label() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    let train = "estimate train day --model physics --rate 50 --test 3 --out m.model";
    expect(folder, train, 0, &[]);
    let line = "estimate run m.model --replay day/trial-3.csv --json --every 100 --out rows.parquet --plot rows.svg";
    let said = expect(folder, line, 0, &[]);
    let objects: Vec<serde_json::Value> = (said.out.lines())
        .map(|line| serde_json::from_str(line).expect("one object per line"))
        .collect();
    // 15 rows of 1500, and the sum.
    assert_eq!(objects.len(), 16);
    assert_eq!(objects[0]["valid"], false);
    assert!(objects[1]["half_width_n"].as_f64().expect("a width") > 0.0);
    assert!(objects[1]["estimate_y_n"].is_f64());
    assert_eq!(objects[15]["rows"], 1500);
    let rows = Table::read(&folder.join("rows.parquet")).expect("the rows");
    assert_eq!(rows.rows(), 1500);
    let column = |name: &str| rows.column(name).expect(name);
    let valid = column("valid").iter().sum::<f64>();
    assert_eq!(Some(valid as u64), objects[15]["valid"].as_u64());
    assert!(column("force_y_n").iter().any(|force| force.abs() > 1.0));
    assert_eq!(
        column("estimate_y_n")[100],
        objects[1]["estimate_y_n"].as_f64().unwrap()
    );
    let svg = std::fs::read_to_string(folder.join("rows.svg")).unwrap();
    assert!(svg.contains("90 % interval") && svg.contains("measured"));

    // Starts and gaps are counted, and each row of them.
    let eval = "estimate eval m.model day --starts 2 --gaps 2";
    expect(
        folder,
        eval,
        0,
        &["row by row, 3 starts and 2 gaps", "valid rows"],
    );
}

/// One log of five whose force has the other sign: the command goes on, and names it.
#[test]
fn a_training_trial_unlike_the_others_is_named() {
    let temporary = folder();
    let folder = temporary.path();
    let day = folder.join("day");
    for trial in 1..7 {
        log(&day, trial, 30, 3.0, &[]);
    }
    let train = "estimate train day --model linear --no-intervals --test 6";
    let said = expect(folder, &format!("{train} --out m.model"), 0, &[]);
    assert!(!said.out.contains("unlike"), "{said:?}");
    let file = day.join("trial-2.csv");
    let text = std::fs::read_to_string(&file).unwrap();
    let (head, rows) = text.split_once('\n').unwrap();
    let force = head.split(',').position(|name| name == "force_y_n");
    let force = force.expect("a force");
    let reversed = |row: &str| {
        let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
        cells[force] = format!("{}", -cells[force].parse::<f64>().expect("a number"));
        cells.join(",") + "\n"
    };
    let rows: String = rows.lines().map(reversed).collect();
    std::fs::write(&file, format!("{head}\n{rows}")).unwrap();
    let words = ["Look at this first", "unlike the others", "trial 2: "];
    expect(folder, &format!("{train} --out n.model"), 0, &words);
    let card = std::fs::read_to_string(folder.join("n.card.json")).unwrap();
    assert!(card.contains("trial 2: "), "{card}");
}

#[test]
fn a_training_that_would_be_lost_is_refused_before_it_begins() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    log(&folder.join("day"), 9, 9, 3.0, &[]);
    for (line, code, words) in [
        ("--test 9 --out a.model", 2, "no row is left to test on"),
        ("--test 3 --out none/a.model", 7, "none/a.model"),
    ] {
        let said = expect(
            folder,
            &format!("estimate train day {line}"),
            code,
            &[words],
        );
        assert!(!said.err.contains("training `hybrid`"), "{said:?}");
    }
}

#[test]
fn a_model_is_recalibrated_on_free_motion_alone() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    for (kind, file) in [("physics", "m"), ("linear", "l")] {
        let line =
            format!("estimate train day --model {kind} --no-intervals --test 3 --out {file}.model");
        expect(folder, &line, 0, &[]);
    }
    log(&folder.join("loaded"), 8, 60, 3.0, &[]);
    log(
        &folder.join("free"),
        8,
        60,
        0.0,
        &["force_x_n", "force_y_n", "force_z_n"],
    );
    let to = "--out today.model";
    let refused = |line: &str, words: &[&str]| {
        expect(
            folder,
            &format!("estimate recalibrate {line} {to}"),
            2,
            words,
        );
        assert!(!folder.join("today.model").exists());
    };
    refused(
        "m.model loaded/trial-8.csv",
        &["N RMS on the tool", "nothing at the tool"],
    );
    // One value that is missing does not make the others unseen.
    let log_file = folder.join("loaded/trial-8.csv");
    let text = std::fs::read_to_string(&log_file).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let place = names.iter().position(|n| *n == "force_y_n").unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut cells: Vec<&str> = lines[100].split(',').collect();
    cells[place] = "";
    lines[100] = cells.join(",");
    std::fs::write(folder.join("gap.csv"), lines.join("\n") + "\n").unwrap();
    refused("m.model gap.csv --any-robot", &["N RMS on the tool"]);
    refused("l.model free/trial-8.csv", &["no torque balance"]);
    log(&folder.join("short"), 8, 20, 0.0, &[]);
    refused("m.model short/trial-8.csv", &["at least 30 s"]);
    let line = format!("estimate recalibrate m.model free/trial-8.csv {to}");
    expect(folder, &line, 0, &["N RMS before", "elbow", "today.card"]);
    let card = std::fs::read_to_string(folder.join("today.card.json")).unwrap();
    assert!(card.contains("Recalibrated on"), "{card}");
    let with = "estimate run today.model --replay loaded/trial-8.csv";
    expect(folder, with, 0, &["3000 rows"]);
}

#[test]
fn a_robot_is_known_by_its_name_and_not_by_its_address() {
    let temporary = folder();
    let folder = temporary.path();
    for trial in 1..3 {
        log(&folder.join("day"), trial, 30, 3.0, &[]);
    }
    let card = |robot: &str| {
        let text = format!("{{\"experiment\": {{\"robot\": {robot}, \"force\": {{\"kind\": \"one_axis\", \"axis\": [0, 1, 0]}}}}}}");
        std::fs::write(folder.join("day/card.json"), text).unwrap();
    };
    let train = |out: &str, words: &[&str]| {
        let line = format!("estimate train day --model zero --no-intervals --out {out}");
        let said = expect(folder, &line, 0, &[]);
        assert!(words.iter().all(|w| said.err.contains(w)), "{said:?}");
    };
    card(r#"{"kind": "udp", "listen": "127.0.0.1:18901", "name": "left arm"}"#);
    train("named.model", &[]);
    card(r#"{"kind": "udp", "listen": "127.0.0.1:18901"}"#);
    train("unnamed.model", &["nothing will tell", "`name` in [robot]"]);

    let live = |model: &str, name: &str, code: i32, words: &[&str]| {
        let robot = format!("[robot]\nkind = \"udp\"\nlisten = \"127.0.0.1:0\"\n{name}");
        std::fs::write(folder.join("robot.toml"), robot).unwrap();
        let line = format!("estimate run {model}.model --robot robot.toml --duration 0.1");
        expect(folder, &line, code, words);
    };
    // The same name at another port is the same robot.
    // It is silent: no row, no time of a step, no success.
    let silent = ["0 rows", "a step takes - (median), - (p99)"];
    live("named", "name = \"left arm\"", 6, &silent);
    live(
        "named",
        "name = \"right arm\"",
        2,
        &["`right arm`", "`left arm`"],
    );
    live("named", "", 2, &["has no `name`", "name = \"left arm\""]);
    live(
        "unnamed",
        "name = \"left arm\"",
        2,
        &["nothing named the robot"],
    );
}

#[test]
fn tips_of_test_trials_do_not_reach_a_model() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    let train = "estimate train day --model physics --test 3 --no-intervals --out";
    expect(folder, &format!("{train} a.model"), 0, &[]);
    // Another mount of the test trial: a millimetre here and there turns its base.
    let file = folder.join("day/trial-3.csv");
    let text = std::fs::read_to_string(&file).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let place = |name: &str| names.iter().position(|n| *n == name).unwrap();
    let (x, y) = (place("tip_x_m"), place("tip_y_m"));
    let turned: Vec<String> = (text.lines().enumerate())
        .map(|(k, line)| {
            let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            if k > 0 {
                let at: f64 = cells[y].parse().unwrap();
                let tip: f64 = cells[x].parse().unwrap();
                cells[x] = (tip + 0.02 * at).to_string();
            }
            cells.join(",")
        })
        .collect();
    std::fs::write(&file, turned.join("\n") + "\n").unwrap();
    expect(folder, &format!("{train} b.model"), 0, &[]);
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    assert_eq!(read("a.model"), read("b.model"));
    // With that trial in the training it is another one.
    let other = "estimate train day --model physics --test 1 --no-intervals --out";
    expect(folder, &format!("{other} c.model"), 0, &[]);
    let base = |name: &str| {
        let model: serde_json::Value = serde_json::from_str(&read(name)).unwrap();
        model["base"].clone()
    };
    assert_ne!(base("a.model"), base("c.model"));
}

#[test]
fn trials_without_numbers_and_a_single_trial_are_refused() {
    let temporary = folder();
    let folder = temporary.path();
    log(&folder.join("one"), 1, 30, 3.0, &[]);
    let train = |data: &str, words: &[&str]| {
        let line = format!("estimate train {data} {LINEAR} a.model");
        expect(folder, &line, 2, words);
    };
    train("one", &["one", "none is left for testing"]);
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
    train(
        "text",
        &["trial-1.csv", "`trial`", "line 2", "`trial = \"\"`"],
    );
}

#[test]
fn a_network_goes_on_where_it_ended_and_its_export_has_a_card_of_its_inputs() {
    let temporary = folder();
    let folder = temporary.path();
    day(&folder.join("day"), 3.0, &[]);
    let trained = run(
        folder,
        "estimate train day --model carried-gru --no-intervals --rate 10 --limit 0.1 --epochs 100000 --out net.model",
    );
    if trained.err.contains("built without neural networks") {
        return;
    }
    assert_eq!(trained.code, Some(0), "{trained:?}");
    let ended = "of 100000; --limit ended the training";
    assert!(trained.out.contains(ended), "{trained:?}");
    // Whole passes are kept for `--resume`, and not lost to a training that begins anew.
    assert!(folder.join("net.model.training").is_file());
    let again = "estimate train day --model carried-gru --no-intervals --rate 10 --limit 0.1 --epochs 100000";
    let words = ["net.model.training", "--resume goes on with it"];
    expect(folder, &format!("{again} --out net.model"), 2, &words);
    let other = format!("{again} --seed 2 --resume --out net.model");
    expect(folder, &other, 2, &["other settings"]);
    let on = format!("{again} --resume --out net.model");
    expect(folder, &on, 0, &["--limit ended the training"]);
    let none = format!("{again} --resume --out other.model");
    expect(folder, &none, 2, &["other.model.training", "can't be read"]);
    let linear = "estimate train day --resume --model linear --no-intervals --out l.model";
    expect(folder, linear, 2, &["`linear` is no network"]);
    // A training that is whole leaves nothing to go on from.
    let whole = "estimate train day --model carried-gru --no-intervals --rate 10 --epochs 1 --out whole.model";
    expect(folder, whole, 0, &[]);
    assert!(!folder.join("whole.model.training").exists());
    let before = std::fs::read(folder.join("net.model")).unwrap();
    let export = "estimate export net.model --out";
    let lost = ["is read by this command and would be lost"];
    expect(folder, &format!("{export} ./net.model"), 2, &lost);
    assert_eq!(std::fs::read(folder.join("net.model")).unwrap(), before);
    expect(folder, &format!("{export} net.onnx"), 0, &[]);
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
